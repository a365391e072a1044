"""What a test may be made of: rests at positions, and whole turns there and back."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from math import ceil, inf

import numpy as np

from alignment.units import DEG
from stand.imu import ImuSpec
from stand.motion.moves import move_piece, ramp_times
from stand.proposal.wanted import AllowedEntry, Wanted
from stand.table.joints import JOINTS
from stand.table.table import Table

FIRST = 3  # of the gimbals among JOINTS
FACES = {
    "Y1 up": (0.0, 0.0),
    "Y1 down": (0.0, 180.0),
    "Z1 down": (0.0, 90.0),  # inner takes Y1 toward Z1
    "Z1 up": (0.0, -90.0),
    "X1 up": (90.0, 0.0),
    "X1 down": (-90.0, 0.0),
}
_EDGES = (45.0, 135.0, -45.0, -135.0)
_CORNER = 35.264
NICE = (1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 300.0, 400.0, 500.0, 1000.0)  # deg/s
KEPT_RATES = 3
RANGE_USED = 0.8  # of what a gyro can measure
EDGE = 1e-9


@dataclass(frozen=True, slots=True)
class Candidate:
    """A rest (`axis` '') at gimbal angles [deg], or turns of an axis from there and back.

    `rate` [deg/s]; `most` [s]: of data in one test (of turns both ways together).
    """

    position: tuple[float, float, float]
    axis: str = ""
    rate: float = 0.0
    most: float = inf

    @property
    def quantum(self) -> float:
        """Seconds of data that it comes in: of turns, one each way."""
        return 2 * 360 / self.rate if self.axis else 0.0

    def label(self) -> str:
        """As a step of it is called."""
        at = _in_words(self.position)
        return f"{self.axis} at {self.rate:g} deg/s from {at}" if self.axis else at


def _in_words(position: Sequence[float]) -> str:
    outer, middle, inner = position
    for name, (m, i) in FACES.items():
        if (m, i) == (middle, inner):
            return name if outer == 0 else f"{name}, {outer:g} deg"
    return f"{outer:g} {middle:g} {inner:g} deg"


def candidates(wanted: Wanted, imu: ImuSpec, table: Table) -> list[Candidate]:
    """All that table and requirement allow; `StandError` where they contradict one another."""
    allowed = wanted.entry.allowed
    for axis in allowed.turning if "turning" in allowed.model_fields_set else ():
        if axis in table.missing:
            raise wanted.fault("allowed, turning", f'"{axis}"', table.without(axis))
    rests = [Candidate(at) for at in _positions(allowed) if _within(at, table)]
    if not rests:
        raise wanted.fault(
            "allowed, positions",
            allowed.positions,
            f"table {table.id} can stand in none of them: must hold one within its travel",
        )
    return rests + list(_turns(wanted, imu, table))


def _positions(allowed: AllowedEntry) -> Iterator[tuple[float, float, float]]:
    if not isinstance(allowed.positions, str):
        yield from allowed.positions
        return
    for (middle, inner), outer in product(FACES.values(), (0.0, 90.0, 180.0, -90.0)):
        yield outer, middle, inner
    if allowed.positions == "faces":
        return
    yield from ((0.0, 0.0, angle) for angle in _EDGES)
    yield from ((0.0, angle, 0.0) for angle in _EDGES)
    yield from ((0.0, middle, inner) for middle, inner in product((45.0, -45.0), (90.0, -90.0)))
    yield from ((0.0, middle, inner) for middle, inner in product((_CORNER, -_CORNER), _EDGES))


def _turns(wanted: Wanted, imu: ImuSpec, table: Table) -> Iterator[Candidate]:
    allowed = wanted.entry.allowed
    free = isinstance(allowed.positions, str)
    own = [(0.0, 0.0, 0.0), (0.0, 0.0, 90.0), (0.0, 90.0, 0.0), (0.0, 0.0, 45.0), (0.0, 45.0, 0.0),
           (0.0, 45.0, 90.0)]  # fmt: skip
    for axis in allowed.turning:
        for at in own if free else _positions(allowed):
            if not _within(at, table) or not _goes_round(axis, table) or _repeats(axis, at, free):
                continue
            for rate in _rates(axis, wanted, imu, table):
                yield Candidate(at, axis, rate, (allowed.most_turns or inf) * 720 / rate)


def _repeats(axis: str, at: Sequence[float], free: bool) -> bool:
    """Whether the axis passes through another of the positions: where it begins is no matter."""
    going = {"middle": at[1], "inner": at[2]}
    return free and bool(going.get(axis, 0.0))


def _within(at: Sequence[float], table: Table) -> bool:
    joints = np.zeros(len(JOINTS))
    joints[FIRST:] = np.radians(at)
    missing = any(angle and JOINTS[FIRST + k] in table.missing for k, angle in enumerate(at))
    return not missing and not table.outside(joints)


def _goes_round(axis: str, table: Table) -> bool:
    k = JOINTS.index(axis)
    return axis not in table.missing and np.isinf(table.low[k]) and np.isinf(table.high[k])


def _rates(axis: str, wanted: Wanted, imu: ImuSpec, table: Table) -> list[float]:
    """Rates [deg/s] that the axis and the unit allow: the quickest."""
    limit = float(table.rate[JOINTS.index(axis)]) / DEG
    measured = RANGE_USED * float(imu.gyro.full_scale) / DEG
    given = wanted.entry.allowed.turn_rates_deg_s
    if given is not None:
        beyond = [rate for rate in given if rate > limit * (1 + EDGE)]
        if beyond:
            text = f"axis {axis} of table {table.id} turns at {limit:g} deg/s at most"
            raise wanted.fault("allowed, turn_rates_deg_s", f"{beyond[0]:g}", text)
        return sorted(rate for rate in given if rate <= measured)
    return [rate for rate in NICE if rate <= min(limit * (1 + EDGE), measured)][-KEPT_RATES:]


# --- how long things take ------------------------------------------------------------------------


class Clock:
    """Times of moves and turns on a table, as its planner makes them: in whole seconds."""

    def __init__(self, table: Table) -> None:
        self._table = table
        self._moves: dict[tuple[float, ...], float] = {}

    def move(self, a: Sequence[float], b: Sequence[float]) -> float:
        """From gimbal angles to others [deg], rest to rest [s]."""
        key = tuple(abs(y - x) for x, y in zip(a, b, strict=True))
        if key not in self._moves:
            start, end = np.zeros(len(JOINTS)), np.zeros(len(JOINTS))
            end[FIRST:] = np.radians(key)
            t = self._table
            piece = move_piece(start, end, t.rate, t.acceleration, t.jerk) if any(key) else None
            self._moves[key] = 0.0 if piece is None else _whole(float(piece.knots[-1]))
        return self._moves[key]

    def ramp(self, one: Candidate) -> float:
        """From rest to the rate of turns [s]."""
        k = JOINTS.index(one.axis)
        t = self._table
        times = ramp_times(one.rate * DEG, float(t.acceleration[k]), float(t.jerk[k]))
        return float(times[-1])

    def length(self, one: Candidate, data: float) -> float:
        """Of a candidate with `data` [s] of readings, ramps included."""
        if not one.axis:
            return data
        ramp = self.ramp(one)
        return 2 * _whole(_whole(ramp) + data / 2 + ramp)

    def timeline(self, amounts: Iterable[tuple[Candidate, float]]) -> Iterator[tuple[float, float]]:
        """When each of candidates with their data begins, and ends, in the plan [s]."""
        now, at = 0.0, (0.0, 0.0, 0.0)
        for one, data in amounts:
            begin = now + self.move(at, one.position)
            now, at = begin + self.length(one, data), one.position
            yield begin, now

    def total(self, amounts: Iterable[tuple[Candidate, float]]) -> float:
        """Of the whole plan [s]."""
        return max((end for _, end in self.timeline(amounts)), default=0.0)


def _whole(t: float) -> float:
    return float(ceil(t - 1e-9))
