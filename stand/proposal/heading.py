"""Tests for an attitude: which rests about the vertical, how many reversals, or steady turning.

The noise floor of a heading is ``ARW / (W cos lat sqrt(T))``: positions whose horizontal directions
cancel reach it, and drift wants them to be reversed often.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from math import ceil, cos, inf

import numpy as np

from alignment.earth import EARTH_RATE
from alignment.methods.carousel import METHOD as CAROUSEL
from alignment.methods.positions import MULTI_POSITION, TWO_POSITION
from alignment.methods.triad import METHOD as TRIAD
from alignment.units import DEG
from stand.proposal.candidates import Candidate, Clock, candidates
from stand.proposal.judged import Judged
from stand.proposal.trim import Amounts
from stand.proposal.wanted import Wanted
from stand.simulation.settings import Settings

METHODS = (TRIAD, TWO_POSITION, MULTI_POSITION, CAROUSEL)
REVERSALS = (1, 2, 4, 8, 16)
SPIN_RATES = (1.0, 2.0, 5.0, 10.0, 20.0)  # deg/s, of a carousel
LONGEST = 86400.0  # s
HALVINGS = 7
DEARER = 1.02  # than the best so far: not looked at more closely


@dataclass(frozen=True, slots=True)
class Shape:
    """Rests at outer angles [deg] of equal length, or turning at a rate; and its method."""

    name: str
    method: str
    angles: tuple[float, ...] = ()
    rate: float = 0.0

    def amounts(self, seconds: float, shortest: float) -> Amounts:
        """With so many seconds of data, a little more for readable numbers."""
        if self.rate:
            one = Candidate((0.0, 0.0, 0.0), "outer", self.rate)
            return ((one, max(1, ceil(seconds / one.quantum - 1e-9)) * one.quantum),)
        each = max(shortest, ceil(2 * seconds / len(self.angles) - 1e-9) / 2)
        if each > 10:
            each = float(ceil(each))
        return tuple((Candidate((angle, 0.0, 0.0)), each) for angle in self.angles)


def shapes(wanted: Wanted, like: Settings) -> list[Shape]:
    """All that table and requirement allow."""
    method = wanted.entry.require.method
    return [one for one in _shapes(wanted, like) if method in (None, one.method)]


def _shapes(wanted: Wanted, like: Settings) -> Iterator[Shape]:
    allowed = candidates(wanted, like.imu, like.table)
    outer = {one.position[0] for one in allowed if not one.axis and one.position[1:] == (0.0, 0.0)}
    if 0.0 in outer:
        yield Shape("one rest", TRIAD, (0.0,))
    if {0.0, 180.0} <= outer:
        yield Shape("two rests, half a turn apart", TWO_POSITION, (0.0, 180.0))
        for n in REVERSALS[1:]:
            angles = (0.0, 180.0) * n
            yield Shape(f"{2 * n} rests, reversed each time", MULTI_POSITION, angles)
    if {0.0, 90.0, 180.0, -90.0} <= outer:
        yield Shape(
            "four rests, a quarter of a turn apart", MULTI_POSITION, (0.0, 90.0, 180.0, -90.0)
        )
    free = isinstance(wanted.entry.allowed.positions, str)
    if free and not like.table.outside(np.radians([0, 0, 0, 120.0, 0, 0])):
        thirds = (0.0, 120.0, -120.0)
        yield Shape("three rests, a third of a turn apart", MULTI_POSITION, thirds)
    if any(one.axis == "outer" for one in allowed):
        given = wanted.entry.allowed.turn_rates_deg_s
        limit = float(like.table.rate[3]) / DEG
        for rate in given or SPIN_RATES:
            if rate <= limit:
                yield Shape(f"turning at {rate:g} deg/s", CAROUSEL, rate=rate)


def floor_time(like: Settings, limit: float) -> float:
    """Data [s] below which no test tells a heading to `limit` [rad]: by white noise alone."""
    horizontal = EARTH_RATE * cos(like.site.known_latitude())
    noise = float(np.min(like.unit.gyro.noise))
    with np.errstate(over="ignore"):  # a limit that is next to nothing takes for ever
        return float(np.divide(noise, horizontal * limit) ** 2) if horizontal * limit else inf


@dataclass(frozen=True, slots=True)
class Found:
    """A shape with its length; `total` of the plan [s]."""

    shape: Shape
    amounts: Amounts
    total: float


def shortest_of(
    shapes: Sequence[Shape],
    judges: Callable[[str], Judged],
    clock: Clock,
    least: float,
    dwell: float,
    progress: Callable[[float], None],
    longest: float = LONGEST,
) -> list[Found]:
    """Each shape as short as keeps what is required, the shortest first.

    `judges` by method; `least` [s]: data below which there is no need to look; `longest` [s]: a
    plan that takes more is none.
    """
    found: list[Found] = []
    for number, shape in enumerate(shapes):
        progress(number / len(shapes))
        most = min((DEARER * f.total for f in found), default=longest)
        one = _shortest(shape, judges(shape.method), clock, least, dwell, most)
        if one is not None:
            found.append(one)
    return sorted(found, key=lambda f: f.total)


def _shortest(
    shape: Shape, judge: Judged, clock: Clock, least: float, dwell: float, most: float
) -> Found | None:
    def keeps(seconds: float) -> bool:
        return judge.keeps(shape.amounts(seconds, dwell))

    low, high = 0.0, max(least, 1.0)
    before = inf
    while not keeps(high):
        ratio = max(judge.ratios(shape.amounts(high, dwell)).values())
        if clock.total(shape.amounts(high, dwell)) > most or ratio > 0.999 * before:
            return None  # dearer than another, or no longer test helps
        before = ratio if np.isfinite(ratio) else inf
        low, high = high, 2 * high
    for _ in range(HALVINGS if low else 0):
        middle = (low + high) / 2
        low, high = (low, middle) if keeps(middle) else (middle, high)
    amounts = shape.amounts(high, dwell)
    total = clock.total(amounts)
    return Found(shape, amounts, total) if total <= most else None
