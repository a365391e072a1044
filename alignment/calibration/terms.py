"""The unknowns of a unit: where each stands, its prior, and the constants that they come to.

Inside a fit the axes of a triad are its case's rotation and its non-orthogonalities, whose priors
are independent; outside they are six misalignments.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from alignment.arrays import Array, set_owned
from alignment.calibration.bench import SENSORS, Bench
from alignment.calibration.result import PAIRS, Key, Sensor
from alignment.constant_errors import BY_AXIS
from alignment.readings import BoolArray

TERMS = {
    "gyro": (
        "bias",
        "scale",
        "misalignment",
        "non_orthogonality",
        "asymmetry",
        "k2",
        "k3",
        "g_sensitivity",
        "g2_sensitivity",
        "lag",
        "temperature_bias",
        "temperature_scale",
    ),
    "accel": (
        "bias",
        "scale",
        "misalignment",
        "non_orthogonality",
        "asymmetry",
        "k2",
        "k3",
        "lever_arm",
        "lag",
        "temperature_bias",
        "temperature_scale",
    ),
}
TRIAD_AXES = ("misalignment", "non_orthogonality")
NINE = ("g_sensitivity", "g2_sensitivity", "lever_arm")
_COLUMNS = {"k2": "quadratic", "k3": "cubic"}


@dataclass(frozen=True, slots=True)
class Term:
    """Columns of one term of one triad, from `at` on: three, or nine."""

    sensor: Sensor
    name: str
    at: int
    size: int

    @property
    def columns(self) -> slice:
        """Among all unknowns of the unit."""
        return slice(self.at, self.at + self.size)


def _terms() -> tuple[Term, ...]:
    found: list[Term] = []
    at = 0
    for sensor in SENSORS:
        for name in TERMS[sensor]:
            size = 9 if name in NINE else 3
            found.append(Term(sensor, name, at, size))  # pyright: ignore[reportArgumentType]
            at += size
    return tuple(found)


UNIT = _terms()
COUNT = UNIT[-1].at + UNIT[-1].size
BY_NAME = {(t.sensor, t.name): t for t in UNIT}


def columns_of(sensor: str, name: str) -> slice:
    """Of one term."""
    return BY_NAME[sensor, name].columns  # pyright: ignore[reportArgumentType]


def priors(bench: Bench, turning: bool, warm: bool) -> tuple[Array, Array]:
    """Expected values and standard deviations (COUNT,) of all unknowns.

    `turning`: whether anything turns, without which nothing depends on lags and lever arms;
    `warm`: whether the temperature changes.
    """
    value, sigma = np.zeros(COUNT), np.zeros(COUNT)
    for term in UNIT:
        own = term.columns
        k = SENSORS.index(term.sensor)
        if term.name == "lever_arm":
            value[own] = bench.places.ravel()
            sigma[own] = bench.place_sigma * turning
        elif term.name == "lag":
            value[own] = bench.lag[k]
            sigma[own] = bench.lag_sigma[k] * turning
        elif not term.name.startswith("temperature") or warm:
            sigma[own] = np.repeat(bench.sheet(term.sensor, term.name), term.size // 3)
    _by_value(bench, value, sigma)
    return value, sigma


def _by_value(bench: Bench, value: Array, sigma: Array) -> None:
    """Fill in what is known by value; of misalignments, where both of a pair are."""
    own = {key: (x, s) for key, x, s in bench.known}
    for key, (x, s) in own.items():
        if key.term != "misalignment":
            at = BY_NAME[key.sensor, key.term].at
            at += key.axis if key.toward is None else 3 * key.axis + key.toward
            value[at], sigma[at] = x, s
    for sensor in SENSORS:
        for k, (i, j) in enumerate(PAIRS):
            pair = [own.get(Key(sensor, "misalignment", *one)) for one in ((i, j), (j, i))]
            if pair[0] is not None and pair[1] is not None:
                (a, s), (b, t) = pair[0], pair[1]
                spread = np.hypot(s, t)
                turn, lean = (BY_NAME[sensor, n].at + k for n in TRIAD_AXES)
                value[turn], sigma[turn] = (a - b) / 2, spread / 2
                value[lean], sigma[lean] = a + b, spread


def columns(sensor: str, name: str, x: Array, f: Array, warmth: Array) -> Array:
    """What a triad's readings (n, 3) take from a term, per unit of it: (n, 3, 3 or 9).

    `x` (n, 3) true input, `f` (n, 3) force, `warmth` (n,) [K]; of lags and lever arms nothing.
    """
    if name == "temperature_bias":
        return warmth[:, None, None] * np.eye(3)
    if name == "temperature_scale":
        return (warmth[:, None] * x)[..., None] * np.eye(3)
    if name in ("lag", "lever_arm"):
        return np.zeros((len(x), 3, 9 if name == "lever_arm" else 3))
    return BY_AXIS[_COLUMNS.get(name, name)](x, f)


# --- as others know them -------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class Outside:
    """The parameters by their keys: ``values = matrix @ unknowns``; `matrix` (k, COUNT)."""

    keys: tuple[Key, ...]
    matrix: Array

    def __post_init__(self) -> None:
        set_owned(self, matrix=(self.matrix, (len(self.keys), COUNT), float))


def outside(present: Sequence[bool] | BoolArray) -> Outside:
    """Parameters of the unknowns that are `present` (COUNT,)."""
    keys, rows = [], []

    def add(key: Key, *parts: tuple[int, float]) -> None:
        if any(present[at] for at, _ in parts):
            row = np.zeros(COUNT)
            for at, part in parts:
                row[at] += part
            keys.append(key)
            rows.append(row)

    for term in UNIT:
        at = term.at
        if term.name == "misalignment":
            lean = BY_NAME[term.sensor, "non_orthogonality"].at
            # M = -[rotation x] + half of what the pairs lean together
            for k, (i, j) in enumerate(PAIRS):
                add(Key(term.sensor, "misalignment", i, j), (at + k, 1.0), (lean + k, 0.5))
                add(Key(term.sensor, "misalignment", j, i), (at + k, -1.0), (lean + k, 0.5))
        elif term.size == 9:
            for i in range(3):
                for j in range(3):
                    key = Key(term.sensor, term.name, i, j)  # pyright: ignore[reportArgumentType]
                    add(key, (at + 3 * i + j, 1.0))
        elif term.name != "non_orthogonality":
            for i in range(3):
                add(Key(term.sensor, term.name, i), (at + i, 1.0))  # pyright: ignore[reportArgumentType]
    return Outside(tuple(keys), np.array(rows).reshape(len(rows), COUNT))


ALL = outside([True] * COUNT)
