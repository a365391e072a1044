"""What a hand-held calibration looks for: independent unknowns, their priors, and the parameters.

Misalignments are looked for as rotation and non-orthogonality of a triad, of which priors are
known. Without a table nothing says how the accelerometers' triad is turned in b: its rotation is
no unknown, and what is known of it is added at the end, to both triads alike.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from math import hypot

import numpy as np

from alignment.arrays import Array, set_owned
from alignment.calibration.result import PAIRS, Key, Sensor, Term
from alignment.options import Priors

# terms beyond bias, scale factor and misalignment, and what priors call them
MORE: tuple[tuple[Sensor, Term, str], ...] = (
    ("gyro", "asymmetry", "gyro_asymmetry"),
    ("gyro", "g_sensitivity", "gyro_g_sensitivity"),
    ("gyro", "g2_sensitivity", "gyro_g2_sensitivity"),
    ("accel", "asymmetry", "accel_asymmetry"),
    ("accel", "k2", "accel_quadratic"),
    ("accel", "k3", "accel_cubic"),
)


@dataclass(frozen=True, slots=True, eq=False)
class Unknowns:
    """Parameters and the unknowns they are made of.

    `keys` (p,) of the parameters; `basis` (p, q) takes unknowns to them; `sigmas` (q,) of the
    unknowns' priors, infinite where nothing is known; `rotation` (p, 3): what a rotation of b
    against the case does to both triads.
    """

    keys: tuple[Key, ...]
    basis: Array
    sigmas: Array
    rotation: Array

    def __post_init__(self) -> None:
        p, q = len(self.keys), len(self.sigmas)
        object.__setattr__(self, "sigmas", np.array(self.sigmas))
        set_owned(self, basis=(self.basis, (p, q), float), rotation=(self.rotation, (p, 3), float))

    def of(self, sensor: Sensor) -> list[int]:
        """Which parameters are those of a triad."""
        return [n for n, key in enumerate(self.keys) if key.sensor == sensor]


def unknowns_of(priors: Priors | None, g_sensitivity: bool = True) -> Unknowns:
    """What to look for.

    Parameters
    ----------
    priors : Priors or None
        Of the unit's data sheet. Bias, scale factor, rotation and non-orthogonality that it does
        not state are free; further terms that it does not state are none. Without a sheet the
        gyros' g-sensitivity is free and there are no further terms.
    g_sensitivity : bool
        Whether gyros may feel force at all.
    """
    columns = list(_columns(priors, g_sensitivity))
    keys = tuple(dict.fromkeys(key for parts, _ in columns for key, _ in parts))
    at = {key: n for n, key in enumerate(keys)}
    basis = np.zeros((len(keys), len(columns)))
    for n, (parts, _) in enumerate(columns):
        for key, size in parts:
            basis[at[key], n] = size
    rotation = np.zeros((len(keys), 3))
    for sensor in ("gyro", "accel"):
        for axis in range(3):
            for key, size in _turned(sensor, axis):
                rotation[at[key], axis] = size
    return Unknowns(keys, basis, np.array([sigma for _, sigma in columns]), rotation)


_Parts = list[tuple[Key, float]]


def _columns(priors: Priors | None, g_sensitivity: bool) -> Iterator[tuple[_Parts, float]]:
    """Each unknown: what it adds to parameters, and the sigma of its prior."""
    for sensor in ("gyro", "accel"):
        for term in ("bias", "scale"):
            sigma = _known(priors, f"{sensor}_{term}")
            for axis in range(3):
                yield [(Key(sensor, term, axis), 1.0)], sigma
        if sensor == "gyro":
            sigma = hypot(*(_known(priors, f"{s}_misalignment") for s in _BOTH))
            for axis in range(3):
                yield _turned(sensor, axis), sigma
        sigma = _known(priors, f"{sensor}_non_orthogonality")
        for i, j in PAIRS:
            keys = Key(sensor, "misalignment", i, j), Key(sensor, "misalignment", j, i)
            yield [(key, 0.5) for key in keys], sigma
    for sensor, term, name in MORE:
        if priors is None:
            sigma = np.inf if term == "g_sensitivity" else 0.0
        else:
            sigma = getattr(priors, name)
        if sigma > 0 and (g_sensitivity or not term.startswith("g")):
            for axis in range(3):
                for toward in range(3) if term.startswith("g") else (None,):
                    yield [(Key(sensor, term, axis, toward), 1.0)], sigma


_BOTH = ("gyro", "accel")


def _known(priors: Priors | None, name: str) -> float:
    """Sigma of a prior; infinite where none is stated."""
    sigma = 0.0 if priors is None else getattr(priors, name)
    return sigma if sigma > 0 else np.inf


def _turned(sensor: Sensor, axis: int) -> _Parts:
    """What a rotation of a triad about an axis does: it reads ``x - r x x``."""
    i, j = PAIRS[axis]
    return [
        (Key(sensor, "misalignment", i, j), 1.0),
        (Key(sensor, "misalignment", j, i), -1.0),
    ]
