"""Whether a plan keeps the table's limits, told before anything moves.

Angle, rate, acceleration and jerk are looked over at nine points of every polynomial piece, unless
the sizes of its coefficients tell that they keep their limits; the torque the plan needs comes from
the stand's inverse dynamics.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from math import inf, sqrt

import numpy as np

from alignment.arrays import Array
from alignment.units import DEG
from stand.errors import StandError
from stand.motion.plan import Plan, PlannedStep
from stand.motion.polynomial import FIT_DEGREE, Motion
from stand.procedure.procedure import Procedure
from stand.table.joints import JOINTS
from stand.table.table import Table

POINTS = 8  # parts of a piece: a wave of eight pieces or more per period is seen to 0.1 %
CHUNK = 4000  # pieces looked over at once
GROUP = 16  # pieces bounded as one
TORQUE_TIMES = 2000  # most instants of a step at which the torque is worked out
SLACK = 1e-6  # moves ride on their limits, to rounding

Torque = Callable[[Array, Array, Array], Array]


@dataclass(frozen=True, slots=True)
class Peak:
    """The greatest use of one limit by one axis in a step.

    `quantity` as in `QUANTITIES`; `value` and `limit` in degrees (torque: N m); `ratio` of the
    two, above 1 where the limit is broken; `t` [s]. `slower`: how many times slower the step
    would be at the limit, infinite where that is no help.
    """

    quantity: str
    axis: str
    t: float
    value: float
    limit: float
    ratio: float
    slower: float


@dataclass(frozen=True, slots=True)
class StepUse:
    """What a step asks of the table: per quantity the peak that is nearest to its limit."""

    step: PlannedStep
    peaks: tuple[Peak, ...]

    def worst(self) -> Peak | None:
        """The peak nearest to its limit, or farthest beyond it; None of a step without a time."""
        return max(self.peaks, key=lambda peak: peak.ratio, default=None)


_ORDER = {"angle": 0, "rate": 1, "acceleration": 2, "jerk": 3}  # power of time in each
QUANTITIES = {
    "angle": "deg",
    "rate": "deg/s",
    "acceleration": "deg/s^2",
    "jerk": "deg/s^3",
    "torque": "N m",
}


def uses(planned: Plan, table: Table, torque: Torque | None = None) -> list[StepUse]:
    """How near every step comes to each limit of the table.

    Parameters
    ----------
    planned : Plan
    table : Table
    torque : callable, optional
        From angles, rates and accelerations (n, 6) to torques (n, 6) [N m].
    """
    return [
        StepUse(step, tuple(_peaks(planned.motion, step, table, torque))) for step in planned.steps
    ]


def check(procedure: Procedure, planned: Plan, table: Table, torque: Torque | None = None) -> None:
    """Refuse the first step beyond a limit; arguments as of `uses`.

    Raises
    ------
    StandError
        File, step, axis, quantity, value, time, limit, and the least change that would do.
    """
    for step in planned.steps:
        kept = _surely_kept(planned.motion, step, table)
        peaks = _torque_peaks if kept else _peaks
        use = StepUse(step, tuple(peaks(planned.motion, step, table, torque)))
        worst = use.worst()
        if worst is not None and worst.ratio > 1 + SLACK:
            raise StandError(_message(procedure, table, use, worst))


def _surely_kept(motion: Motion, step: PlannedStep, table: Table) -> bool:
    """Whether angle, rate, acceleration and jerk are bounded within their limits.

    By the sum of the sizes of a polynomial's terms at its end, of `GROUP` pieces with the greatest
    coefficients and length of all.
    """
    travel = np.minimum(np.abs(table.low), np.abs(table.high))
    limits = (travel, table.rate, table.acceleration, table.jerk)
    first, last = _pieces(motion, step.t_from, step.t_to)
    for begin in range(first, last, CHUNK):
        end = min(begin + CHUNK, last)
        starts = np.arange(0, end - begin, GROUP)
        length = np.maximum.reduceat(np.diff(motion.knots[begin : end + 1]), starts)[:, None]
        sizes = np.maximum.reduceat(np.abs(motion.coefficients[:, begin:end]), starts, axis=1)
        for limit in limits:
            bound = np.zeros_like(sizes[-1])
            for size in sizes:  # Horner's scheme
                bound = bound * length + size
            if (bound > limit).any():
                return False
            powers = np.arange(len(sizes) - 1, 0, -1)[:, None, None]
            sizes = np.zeros_like(sizes) if len(sizes) == 1 else sizes[:-1] * powers
    return True


def _peaks(
    motion: Motion, step: PlannedStep, table: Table, torque: Torque | None
) -> Iterator[Peak]:
    best: dict[str, Peak] = {}
    for t, values in _samples(motion, step.t_from, step.t_to):
        for quantity, peak in _kinematic(t, values, table):
            if quantity not in best or peak.ratio > best[quantity].ratio:
                best[quantity] = peak
    yield from best.values()
    yield from _torque_peaks(motion, step, table, torque)


def _torque_peaks(
    motion: Motion, step: PlannedStep, table: Table, torque: Torque | None
) -> Iterator[Peak]:
    if torque is not None and np.isfinite(table.torque).any():
        yield _torque_peak(motion, step, table, torque)


def _pieces(motion: Motion, t_from: float, t_to: float) -> tuple[int, int]:
    """The first piece within these times and the one behind the last."""
    first = max(int(np.searchsorted(motion.knots, t_from + 1e-9, side="right")) - 1, 0)
    return first, int(np.searchsorted(motion.knots, t_to - 1e-9, side="left"))


def _samples(motion: Motion, t_from: float, t_to: float) -> Iterator[tuple[Array, list[Array]]]:
    """Times and angles, rates, accelerations, jerks at the points of a step's pieces."""
    first, last = _pieces(motion, t_from, t_to)
    points = POINTS * _fineness(motion)
    u = np.arange(points + 1) / points
    for begin in range(first, last, CHUNK):
        end = min(begin + CHUNK, last)
        part = Motion(motion.knots[begin : end + 1], motion.coefficients[:, begin:end])
        t = (part.knots[:-1, None] + np.diff(part.knots)[:, None] * u).ravel()
        q, v, a = part.joints(np.clip(t, t_from, t_to))
        # A jerk switch belongs to the piece before it and to the one after it: look inside both.
        inside = (
            part.knots[:-1, None] + np.diff(part.knots)[:, None] * (0.998 * u + 0.001)
        ).ravel()
        _, _, jerk = part.derivative().joints(np.clip(inside, t_from, t_to))
        yield t, [q, v, a, jerk]


def _kinematic(t: Array, values: list[Array], table: Table) -> Iterator[tuple[str, Peak]]:
    q, *rest = values
    low, high = np.array(table.low), np.array(table.high)
    travel = np.where(q > 0, high, -low)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratios = np.where(np.isfinite(travel), np.abs(q) / travel, 0.0)
    ratios = np.nan_to_num(ratios, nan=0.0, posinf=np.inf)  # 0 deg of travel, 0 used
    limits = (travel, table.rate, table.acceleration, table.jerk)
    tables = [ratios, *(np.abs(x) / limit for x, limit in zip(rest, limits[1:], strict=True))]
    for quantity, x, limit, ratio in zip(QUANTITIES, values, limits, tables, strict=False):
        row, axis = np.unravel_index(int(np.argmax(ratio)), ratio.shape)
        bound, used = np.broadcast_to(limit, x.shape)[row, axis], float(ratio[row, axis])
        order = _ORDER[quantity]
        slower = used ** (1 / order) if order else (1.0 if used <= 1 else inf)
        value, bound = float(x[row, axis] / DEG), float(bound / DEG)
        yield (
            quantity,
            Peak(
                quantity, JOINTS[axis], float(t[row]), value, limit=bound, ratio=used, slower=slower
            ),
        )


def _torque_peak(motion: Motion, step: PlannedStep, table: Table, torque: Torque) -> Peak:
    t = times_within(motion, step, TORQUE_TIMES)
    q, v, a = motion.joints(t)
    needed = torque(q, v, a)
    ratio = np.abs(needed) / table.torque
    row, axis = np.unravel_index(int(np.argmax(ratio)), ratio.shape)
    still = np.zeros((1, len(JOINTS)))
    held = float(torque(q[row : row + 1], still, still)[0, axis])
    value, limit = float(needed[row, axis]), float(table.torque[axis])
    return Peak(
        "torque",
        JOINTS[axis],
        float(t[row]),
        value,
        limit=limit,
        ratio=float(ratio[row, axis]),
        slower=_torque_slower(value, held, limit),
    )


def times_within(motion: Motion, step: PlannedStep, most: int) -> Array:
    """Times (n,) [s] to look at a step: its ends, `most` knots at most, and halfway between.

    Of long pieces half as many knots, and quarters between.
    """
    fineness = _fineness(motion)
    inside = motion.knots[(motion.knots > step.t_from) & (motion.knots < step.t_to)]
    if len(inside) * fineness > most:
        inside = inside[:: -(-len(inside) * fineness // most)]
    t = np.unique(np.concatenate([[step.t_from], inside, [step.t_to]]))
    for _ in range(fineness):
        t = np.unique(np.concatenate([t, (t[1:] + t[:-1]) / 2]))
    return t


def _fineness(motion: Motion) -> int:
    """How many times as long as of a fitted wave pieces may be: random motions have four a
    period, of a higher degree."""
    return 1 if len(motion.coefficients) <= FIT_DEGREE + 1 else 2


def _torque_slower(value: float, held: float, limit: float) -> float:
    """How many times slower keeps the torque: what moves it goes with 1/time^2, not the holding."""
    room = limit - abs(held)
    if abs(value) <= limit:
        return 1.0
    return sqrt(abs(value - held) / room) if room > 0 else inf


def _message(procedure: Procedure, table: Table, use: StepUse, worst: Peak) -> str:
    unit = QUANTITIES[worst.quantity]
    return (
        f'{procedure.name}: step {use.step.number + 1} "{use.step.label}", {worst.axis}: '
        f"{worst.quantity} {worst.value:.4g} {unit} at {worst.t:.3f} s, table {table.id} allows "
        f"{worst.limit:.4g}; {_remedy(use, worst)}"
    )


def _remedy(use: StepUse, worst: Peak) -> str:
    """The least change that keeps every limit the step breaks."""
    if use.step.turning is not None and worst.quantity == "rate":
        return f"a rate of {worst.limit:.4g} deg/s or less would do"
    smaller = f"{_floor(1 / max(peak.ratio for peak in use.peaks))} of the angle"
    slower = max(peak.slower for peak in use.peaks)
    if slower == inf:
        return f"{smaller} would do"
    return f"{_ceil(slower)} times slower, or {smaller}, would do"


def _ceil(x: float) -> str:
    """Three digits, rounded up so that the advice holds."""
    return f"{np.ceil(x * 1000) / 1000:.3f}"


def _floor(x: float) -> str:
    return f"{np.floor(x * 1000) / 1000:.3f}"
