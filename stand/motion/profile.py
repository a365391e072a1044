"""Profiles: joint angles over time from a CSV file, made a motion.

Columns `time_s`, then of any axes `AXIS_deg`, and if wanted both `AXIS_deg_s` and `AXIS_deg_s2`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from alignment.arrays import Array
from alignment.units import DEG
from stand.bounds import LONGEST_S
from stand.columns import Columns, read_columns
from stand.errors import StandError, unknown
from stand.motion.polynomial import Motion, hermite
from stand.table.joints import JOINTS

TIME = "time_s"
FEWEST_ROWS = 12
MOST_ROWS = 600_000  # 170 MB of polynomials
SHORTEST_STEP = 1e-4  # s
LARGEST_DEG = (36e3, 1e5, 1e8)  # of an angle, a rate, an acceleration
SAME_ANGLE = 1e-6  # deg: a profile begins there
REST_RATE, REST_ACCELERATION = 1e-3, 0.1  # deg/s, deg/s^2 that pass for rest
REST_SHARE = 0.2  # of the rates near an end, and
REST_PART = 1e-3  # of the fastest: a rate at the end below their sum passes for rest
ROUNDING = 1e-5  # deg, of angles in a file
JUMP = 0.01  # deg
JUMP_RATIO = 10.0  # between the rate in a jump and the rates beside it
SUFFIXES = ("_deg", "_deg_s", "_deg_s2")
COLUMNS = (TIME, *(f"{joint}{suffix}" for joint in JOINTS for suffix in SUFFIXES))


def profile(path: Path, start: Array, name: str) -> Motion:
    """The motion of a file; axes it does not name stay.

    Parameters
    ----------
    path : Path
    start : (6,) rad
        Where the joints stand.
    name : str
        What messages call the file.

    Returns
    -------
    Motion
        Joint angles from time 0, when the first row holds, whatever its time. From rest to rest.

    Raises
    ------
    StandError
        One line with file, line, column, value and what is allowed.

    Notes
    -----
    Where the file has rates and accelerations each piece is the quintic through both ends' values
    (Hermite); where it has angles alone, they are those of the quintic spline through the angles
    that is at rest at both ends. What a motion loses in a file with even steps h is
    ``h^6 / 46080`` of its sixth derivative.
    """
    columns = read_columns(path, name, MOST_ROWS)
    axes = _axes(columns)
    t = _times(columns)
    states = np.zeros((3, len(t), len(JOINTS)))
    states[0] = start
    for axis, places in axes.items():
        states[:, :, axis] = _state(columns, t, axis, places, start[axis])
    return Motion(t, hermite(t, *states))


def _axes(columns: Columns) -> dict[int, list[int]]:
    """Where the columns of each axis are: angle, or angle, rate and acceleration."""
    names = columns.names
    if names is None or TIME not in names:
        first = "" if names is None else f", has {', '.join(names)[:60]}"
        raise StandError(f"{columns.file}: no column {TIME} in a header line{first}")
    for column in names:
        if column not in COLUMNS:
            raise StandError(f"{columns.file}: {unknown('column', column, COLUMNS)}")
        if names.count(column) > 1:
            raise StandError(f"{columns.file}: column {column}: is there twice")
    axes = {}
    for i, joint in enumerate(JOINTS):
        have = [f"{joint}{suffix}" in names for suffix in SUFFIXES]
        if any(have):
            if have not in ([True, False, False], [True, True, True]):
                missing = SUFFIXES[have.index(False)]
                raise StandError(
                    f"{columns.file}: no column {joint}{missing}: an axis has {joint}_deg, "
                    f"or all of {', '.join(joint + suffix for suffix in SUFFIXES)}"
                )
            axes[i] = [names.index(f"{joint}{s}") for s in SUFFIXES if f"{joint}{s}" in names]
    if not axes:
        raise StandError(f"{columns.file}: no column of an axis, such as {JOINTS[3]}_deg")
    return axes


def _times(columns: Columns) -> Array:
    """Times of the rows from 0 on [s]."""
    assert columns.names is not None
    given = columns.values[:, columns.names.index(TIME)]
    if len(given) < FEWEST_ROWS:
        raise StandError(f"{columns.file}: has {len(given)} rows, must have {FEWEST_ROWS} or more")
    late = np.append(False, np.diff(given) < SHORTEST_STEP * (1 - 1e-6))
    if late.any():
        row = int(np.argmax(late))
        allowed = f"must be {SHORTEST_STEP:g} s or more after the line before, {given[row - 1]:.9g}"
        raise columns.fault(row, TIME, f"{given[row]:.9g}", allowed)
    t = given - given[0]
    if t[-1] > LONGEST_S:
        allowed = f"must be within {LONGEST_S:g} s of the first"
        raise columns.fault(len(t) - 1, TIME, f"{given[-1]:.9g}", allowed)
    return t


@dataclass(frozen=True, slots=True, eq=False)
class _Axis:
    """One axis in a file, in degrees: its name, its rows of angle, rate, acceleration (q, n)."""

    columns: Columns
    t: Array
    joint: str
    given: Array

    def fault(self, row: int, order: int, allowed: str) -> StandError:
        column = self.joint + SUFFIXES[order]
        return self.columns.fault(row, column, f"{self.given[order, row]:.9g}", allowed)


def _state(columns: Columns, t: Array, axis: int, places: Sequence[int], start: float) -> Array:
    """Angle, rate and acceleration (3, n) [rad] of one axis at the rows' times."""
    one = _Axis(columns, t, JOINTS[axis], columns.values[:, places].T)
    _check_size(one)
    _check_start(one, start / DEG)
    if len(one.given) == 3:
        _check_rest(one)
        _check_rates(one)
        state = one.given * DEG
        state[1:, [0, -1]] = 0.0
    else:
        _check_slow_ends(one)
        _check_jumps(one)
        state = _splined(t, one.given[0] * DEG)
    state[0, 0] = start
    return state


def _check_size(one: _Axis) -> None:
    for order, (values, largest) in enumerate(zip(one.given, LARGEST_DEG, strict=False)):
        row = int(np.argmax(np.abs(values)))
        if abs(values[row]) > largest:
            raise one.fault(row, order, f"must be within +-{largest:g}")


def _check_start(one: _Axis, start_deg: float) -> None:
    if abs(one.given[0, 0] - start_deg) > SAME_ANGLE:
        raise one.fault(0, 0, f"must begin where {one.joint} stands, {start_deg:.9g}")


def _check_rest(one: _Axis) -> None:
    for row, does in ((0, "begin"), (len(one.t) - 1, "end")):
        for order, rest in ((1, REST_RATE), (2, REST_ACCELERATION)):
            if abs(one.given[order, row]) > rest:
                raise one.fault(row, order, f"must {does} at rest, within +-{rest:g}")


def _check_rates(one: _Axis) -> None:
    """Angles must grow as the rates and accelerations say (Hermite quadrature, order h^5)."""
    angle, rate, acceleration = one.given
    h = np.diff(one.t)
    grown = h * (rate[:-1] + rate[1:]) / 2 + h**2 * (acceleration[:-1] - acceleration[1:]) / 12
    allowed = JUMP + 0.5 * h * np.maximum(np.abs(rate[:-1]), np.abs(rate[1:]))
    wrong = np.abs(np.diff(angle) - grown) > allowed
    if wrong.any():
        row = int(np.argmax(wrong)) + 1
        expected = angle[row - 1] + grown[row - 1]
        raise one.fault(row, 0, f"must be near {expected:.6g}, as its rates and accelerations say")


def _check_slow_ends(one: _Axis) -> None:
    """The rate at either end, by the polynomial through five rows, must be small there."""
    fastest = np.abs(np.diff(one.given[0]) / np.diff(one.t)).max()
    for row, does, part in ((0, "begin", slice(None, 5)), (-1, "end", slice(None, -6, -1))):
        t, angle = one.t[part] - one.t[row], one.given[0, part] - one.given[0, row]
        rates = np.diff(angle) / np.diff(t)
        powers = np.vander(t / t[-1], increasing=True)
        slope = np.linalg.solve(powers, angle)[1] / t[-1]
        rest = REST_SHARE * np.abs(rates).max() + ROUNDING / np.abs(np.diff(t)).min()
        if abs(slope) > rest + REST_PART * fastest:
            at = len(one.t) - 1 if row else 0
            raise one.fault(at, 0, f"must {does} at rest, but moves at {slope:.3g} deg/s")


def _check_jumps(one: _Axis) -> None:
    """A step or a spike: a rate far above the middle of the four about it."""
    moved = np.abs(np.diff(one.given[0]))
    rates = moved / np.diff(one.t)
    around = np.pad(rates, 2)
    n = len(rates)
    beside = np.median([around[i : i + n] for i in (0, 1, 3, 4)], axis=0)
    jumps = (moved > JUMP) & (rates > JUMP_RATIO * beside)
    if jumps.any():
        row = int(np.argmax(jumps)) + 1
        before = one.given[0, row - 1]
        raise one.fault(row, 0, f"must not jump; the line before has {before:.9g}")


def _splined(t: Array, angles: Array) -> Array:
    """Angle, rate and acceleration (3, n) of the quintic spline through them, at rest at its ends.

    The third and fourth derivatives of its pieces (Hermite) agree where they meet: two symmetric
    equations per row of rate and acceleration there and at both neighbours, positive definite as
    the integral of the squared third derivative is. Eliminated in a fixed order: LAPACK's banded
    solver gives other bits on other processors.
    """
    h, d = np.diff(t), np.diff(angles)
    # of both pieces at a row
    vv, aa, f = (term[1:] + term[:-1] for term in (192 / h**3, 9 / h, 360 * d / h**4))
    va, g = np.diff(36 / h**2), np.diff(60 * d / h**3)
    state = np.zeros((3, len(t)))
    state[0] = angles
    state[1:, 1:-1] = _by_pairs((vv, va, aa, f, g, 168 / h[1:] ** 3, 24 / h[1:] ** 2, 3 / h[1:]))
    return state


def _by_pairs(columns: Sequence[Array]) -> Array:
    """Pairs (2, n) that solve rows ``[[a, b], [b, c]] x + N x_next + N_before' x_before = [f, g]``.

    Columns a, b, c, f, g and p, q, r (n,) of each row, with ``N = [[p, -q], [q, -r]]``.
    """
    ahead = []
    P = Q = R = y = z = 0.0  # what the rows before take from this one
    for a, b, c, f, g, p, q, r in zip(*(column.tolist() for column in columns), strict=True):
        a, b, c, f, g = a - P, b - Q, c - R, f - y, g - z
        det = a * c - b * b
        g00, g01 = (c * p - b * q) / det, (b * r - c * q) / det
        g10, g11 = (a * q - b * p) / det, (b * q - a * r) / det
        v, w = (c * f - b * g) / det, (a * g - b * f) / det
        P, Q, R = p * g00 + q * g10, p * g01 + q * g11, -q * g01 - r * g11
        y, z = p * v + q * w, -q * v - r * w
        ahead.append((v, w, g00, g01, g10, g11))
    solved, v, w = [], 0.0, 0.0
    for v0, w0, g00, g01, g10, g11 in reversed(ahead):
        v, w = v0 - g00 * v - g01 * w, w0 - g10 * v - g11 * w
        solved.append((v, w))
    return np.array(solved[::-1]).T
