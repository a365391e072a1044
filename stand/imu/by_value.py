"""Constants of a unit that are known by value, as errors to first order.

Such a constant is the same in every run: a bias of whatever is estimated, with the spread of its
own sigma in place of the sheet's.
"""

from collections.abc import Mapping
from dataclasses import replace
from math import hypot

import numpy as np

from alignment.arrays import Array
from alignment.constant_errors import BY_AXIS
from alignment.information import InstrumentErrors, TriadErrors
from stand.imu.known import Known
from stand.imu.preset import ImuSpec, TriadSpec

# term of `Known`: field of `TriadErrors`, and of `Priors` behind its sensor; of misalignments see
# `_of_axes`
FIELDS: Mapping[str, str] = {
    "bias": "bias",
    "scale": "scale",
    "asymmetry": "asymmetry",
    "k2": "quadratic",
    "k3": "cubic",
    "g_sensitivity": "g_sensitivity",
    "g2_sensitivity": "g2_sensitivity",
}
_NINE = ("g_sensitivity", "g2_sensitivity")
_ACROSS = ("misalignment", "non_orthogonality")
_SPEC = {"quadratic": "second_order"}  # field of a `TriadSpec`, where it has another name


def warmed_by_value(imu: ImuSpec) -> bool:
    """Whether it has constants by value that are told by nothing here: those of temperature."""
    return any(k.term.startswith("temperature") for t in (imu.gyro, imu.accel) for k in t.known)


def values_of(spec: TriadSpec) -> dict[str, Array]:
    """The constants that are known, by field of `TriadErrors`: (3,), or (9,) by force."""
    found: dict[str, Array] = {}
    for one in spec.known:
        name = FIELDS.get(one.term)
        if name is not None:
            values = found.setdefault(name, np.zeros(9 if name in _NINE else 3))
            values[_place(one)] = one.value
    turn, lean = _of_axes({(k.axis, k.toward): k.value for k in _skew(spec)})
    return found | ({"misalignment": turn, "non_orthogonality": lean} if _skew(spec) else {})


def values_in_order(imu: ImuSpec) -> Array:
    """The same of gyros, then of accelerometers, as `information.parameters` has them."""
    parts = []
    for spec in (imu.gyro, imu.accel):
        found = values_of(spec)
        parts += [found.get(name, np.zeros(9 if name in _NINE else 3)) for name in BY_AXIS]
    return np.concatenate(parts)


def known_to_first_order(unit: InstrumentErrors, imu: ImuSpec) -> InstrumentErrors:
    """The unit's errors with the spreads of what is known in place of those of the sheet."""
    gyro, accel = (_spread(t, s) for t, s in ((unit.gyro, imu.gyro), (unit.accel, imu.accel)))
    return replace(unit, gyro=gyro, accel=accel)


def at_most(imu: ImuSpec) -> ImuSpec:
    """The sheet of one whose constants are as large as the largest known of each kind, axis by
    axis: what an estimator is told that knows three sensors by one number."""
    return replace(imu, gyro=_largest(imu.gyro), accel=_largest(imu.accel))


def _place(one: Known) -> int:
    return one.axis if one.toward is None else 3 * one.axis + one.toward


def _skew(spec: TriadSpec) -> list[Known]:
    return [one for one in spec.known if one.term == "misalignment"]


def _of_axes(m: Mapping[tuple[int, int | None], float]) -> tuple[Array, Array]:
    """Rotation of the case and leaning of pairs Y-Z, Z-X, X-Y that make a matrix's elements.

    ``x x a`` has a_3 at (1, 2) and -a_3 at (2, 1); a pair that leans by n has n/2 at both.
    """
    pairs = ((1, 2), (2, 0), (0, 1))
    both = np.array([[m.get((i, j), 0.0), m.get((j, i), 0.0)] for i, j in pairs])
    return (both[:, 0] - both[:, 1]) / 2, both.sum(axis=1)


def _spread(triad: TriadErrors, spec: TriadSpec) -> TriadErrors:
    changed: dict[str, Array] = {}
    for one in spec.known:
        name = FIELDS.get(one.term)
        if name is not None:
            sigmas = changed.setdefault(name, np.array(getattr(triad, name)))
            sigmas[one.axis] = one.sigma
    sigmas = {(k.axis, k.toward): k.sigma for k in _skew(spec)}
    turn, lean = (np.array(getattr(triad, name)) for name in _ACROSS)
    for k, (i, j) in enumerate(((1, 2), (2, 0), (0, 1))):
        if (i, j) in sigmas and (j, i) in sigmas:
            both = hypot(sigmas[i, j], sigmas[j, i])
            turn[k], lean[k] = both / 2, both
    return replace(triad, **changed, misalignment=turn, non_orthogonality=lean)


def _largest(spec: TriadSpec) -> TriadSpec:
    if not spec.known:
        return spec
    cubic = spec.nonlinearity / spec.full_scale**2
    own = {"quadratic": spec.second_order, "cubic": cubic}
    plain = {n: getattr(spec, n) for n in (*FIELDS.values(), *_ACROSS) if n not in own}
    stated = replace(TriadErrors(), **plain, **own)
    left, found = _spread(stated, spec), {}
    for name, values in values_of(spec).items():
        sigmas = np.repeat(getattr(left, name), len(values) // 3)
        found[_SPEC.get(name, name)] = float(np.max(np.hypot(values, sigmas)))
    if "cubic" in found:
        found["nonlinearity"] = found.pop("cubic") * spec.full_scale**2
    return replace(spec, **found)
