"""Means of what sensors feel between two times: rules, and the law that sets their steps.

Closed rules on steps between the edges of samples and the knots of the motion, where everything
is smooth: Simpson's, and Lobatto's of four points. Their errors are ``h^4/2880`` times the fourth
and ``h^6/1512000`` times the sixth derivative. Both are bounded on each polynomial piece of the
motion, and each interval takes the rule and the number of even steps that cost fewest evaluations
within `FORCE_ERROR` and `RATE_ERROR`: one step of Simpson's where the motion is slow beside the
samples, Lobatto's where it is not.

The derivatives are bounded from those of the joints, power series against power series (a
majorant): a chain of rotations by angles ``q_j(t)`` has no greater derivatives than
``exp(sum |q_j|(t))``, where each series has the absolute derivatives of its angle. What turns with
the outermost axis that moves does not see it turn: only what stands still, as gravity, does.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from math import comb, factorial, sqrt

import numpy as np

from alignment.arrays import Array, IntArray
from alignment.earth import EARTH_RATE
from alignment.fixed_order import product
from alignment.units import STANDARD_GRAVITY
from stand.motion.polynomial import Motion

FORCE_ERROR = 1e-9  # m/s^2 of a mean
RATE_ERROR = 1e-11  # rad/s
REACH = 1.0  # m: nothing that is felt lies farther from an axis
_INNER = np.array([1 - 1 / sqrt(5), 1 + 1 / sqrt(5)]) / 2  # where Lobatto's rule looks inside
_ROUNDED = 1e-6  # of a step: edges of samples are
_LEAST = 1e-30  # of a bound: at rest any step will do
_CHUNK = 4096  # pieces bounded at once: their series stay in cache
_GROUP = 16  # pieces bounded as one, first

Waves = Iterable[tuple[IntArray, IntArray, Array, Array]]


@dataclass(frozen=True, slots=True)
class Rule:
    """Error of the mean over h: ``h^order / divisor`` times the derivative of that order.

    `cost`: evaluations a step, as neighbours share their ends.
    """

    order: int
    divisor: float
    cost: int


SIMPSON = Rule(4, 2880.0, 2)
LOBATTO = Rule(6, 1_512_000.0, 3)


class Steps:
    """The steps between `ends` (k + 1,) [s], by Lobatto's rule where `long` (k,): where to look,
    and the means of what is seen there."""

    def __init__(self, ends: Array, long: np.ndarray) -> None:
        self.ends, self._long, self._lengths = ends, long, np.diff(ends)
        inner = np.where(long, 2, 1)
        self._at = np.arange(len(ends)) + np.concatenate([[0], np.cumsum(inner)])
        first = self._at[:-1]
        self.nodes = np.empty(self._at[-1] + 1)
        self.nodes[self._at] = ends
        self.nodes[first + 1] = (ends[:-1] + ends[1:]) / 2
        for k, place in enumerate(_INNER, start=1):
            self.nodes[first[long] + k] = ends[:-1][long] + place * self._lengths[long]

    def ends_at(self, numbers: IntArray) -> IntArray:
        """Which of the `nodes` are the ends of these numbers."""
        return self._at[numbers]

    def means(self, values: Array, starts: IntArray) -> Array:
        """Means (n, 3) between the ends numbered `starts` (n + 1,), of values at the nodes."""
        first = self._at[:-1]
        a, b, c = (values[first + k] for k in range(3))
        parts = (self._lengths / 6)[:, None] * (a + 4 * b + c)
        rows = first[self._long]
        if len(rows):
            inside, weight = 5 * (b[self._long] + c[self._long]), self._lengths[self._long] / 12
            parts[self._long] = weight[:, None] * (a[self._long] + inside + values[rows + 3])
        sums = np.add.reduceat(parts, starts[:-1], axis=0)
        lengths = np.add.reduceat(self._lengths, starts[:-1])
        return sums / lengths[:, None]


class Law:
    """Which rule, in how many steps, on any part of the pieces of one motion.

    A piece's bounds are worked out when first it is asked for, from itself alone: the choice does
    not depend on what else is asked for.
    """

    def __init__(self, motion: Motion, waves: Waves) -> None:
        self._motion, self._waves = motion, list(waves)
        self._known = {rule: np.full(len(motion.knots) - 1, np.nan) for rule in (SIMPSON, LOBATTO)}

    @property
    def motion(self) -> Motion:
        """Whose law it is."""
        return self._motion

    def choose(self, pieces: IntArray, lengths: Array) -> tuple[IntArray, np.ndarray]:
        """Numbers of even steps (n,), and whether they are Lobatto's (n,).

        Parameters
        ----------
        pieces : (n,)
            Of the motion, in order: where each interval lies.
        lengths : (n,) s
            Of the intervals.
        """
        parts, long = np.ones(len(pieces), dtype=np.int64), np.zeros(len(pieces), dtype=bool)
        open_yet = np.flatnonzero(lengths > self._together(pieces))
        if len(open_yet):
            parts[open_yet] = self._parts(SIMPSON, pieces[open_yet], lengths[open_yet])
        several = np.flatnonzero(parts > 1)
        if len(several):
            fewer = self._parts(LOBATTO, pieces[several], lengths[several])
            better = LOBATTO.cost * fewer <= SIMPSON.cost * parts[several]
            parts[several[better]] = fewer[better]
            long[several[better]] = True
        return parts, long

    def _together(self, pieces: IntArray) -> Array:
        """Steps (n,) [s] of Simpson's rule that each piece of a group of them allows.

        The group is bounded as one piece with the greatest coefficients and length of all: bounds
        only grow with these. Of a servo's thousand pieces a second few remain to be asked.
        """
        first, last = pieces[0], pieces[-1] + 1
        if last - first < _GROUP:
            return np.zeros(len(pieces))
        starts = np.arange(0, last - first, _GROUP)
        size = np.abs(self._motion.coefficients[:, first:last])
        size = np.maximum.reduceat(size, starts, axis=1)
        length = np.maximum.reduceat(np.diff(self._motion.knots[first : last + 1]), starts)
        group = Motion(np.append(0.0, np.cumsum(length)), size)
        steps = longest_steps(SIMPSON, group, np.arange(len(starts)), self._waves)
        return steps[(pieces - first) // _GROUP]

    def _parts(self, rule: Rule, pieces: IntArray, lengths: Array) -> IntArray:
        known = self._known[rule]
        own = pieces[np.append(True, np.diff(pieces) > 0)]
        new = own[np.isnan(known[own])]
        for first in range(0, len(new), _CHUNK):
            chunk = new[first : first + _CHUNK]
            known[chunk] = longest_steps(rule, self._motion, chunk, self._waves)
        parts = np.ceil(lengths / known[pieces] - _ROUNDED).astype(np.int64)
        return np.maximum(1, parts)


def longest_steps(rule: Rule, motion: Motion, pieces: IntArray, waves: Waves) -> Array:
    """Steps (n,) [s] of a rule that keep `FORCE_ERROR` and `RATE_ERROR`.

    Parameters
    ----------
    rule : Rule
    motion : Motion
    pieces : (n,)
        Numbers of its pieces.
    waves : of (axes, times round, cosine, sine amplitudes [rad])
        What the axes do beyond the motion, as `stand.imperfection.TableErrors.waves`.
    """
    n = rule.order
    half = np.diff(motion.knots)[pieces] / 2
    size = _sizes(motion, pieces, half)
    angle = _series(size.sum(axis=2), half, n + 3)
    angle += _waving(size, half, n + 3, waves)
    turned = _exponential(angle[: n + 1])
    outermost = np.argmax(size[1:].any(axis=0), axis=1)
    own = np.take_along_axis(size, outermost[None, :, None], axis=2)[:, :, 0]
    behind = _exponential((angle - _series(own, half, n + 3))[: n + 2])
    spun = _product(_slope(angle), behind)
    # of an arm on a link: its spin sees the axes before it, its way to b those behind
    moved = _slope(spun)[n] + _term(spun, spun, n)
    force = STANDARD_GRAVITY * turned[n] + REACH * moved
    bounds = (force, FORCE_ERROR), (spun[n] + EARTH_RATE * turned[n], RATE_ERROR)
    scale = rule.divisor / factorial(n)
    steps = [(scale * e / np.maximum(bound, _LEAST)) ** (1 / n) for bound, e in bounds]
    return np.minimum(*steps)


def _sizes(motion: Motion, pieces: IntArray, half: Array) -> Array:
    """Absolute coefficients (powers, n, joints) in time since the middle of each piece: there an
    axis that slows down has not the rate of its start."""
    c = np.take(motion.coefficients, pieces, axis=1)[::-1]
    for start in range(len(c) - 1):  # Taylor shift by repeated synthetic division
        for i in range(len(c) - 2, start - 1, -1):
            c[i] += c[i + 1] * half[:, None]
    return np.abs(c, out=c)


def _series(sizes: Array, half: Array, orders: int) -> Array:
    """Bounds (orders, ...) of q^(k)/k! up to `half` from the middle; of the angle itself 0."""
    series = np.zeros((orders, *sizes.shape[1:]))
    for k in range(1, min(orders, len(sizes))):
        for i in range(len(sizes) - 1, k - 1, -1):  # Horner's scheme
            series[k] = series[k] * half + comb(i, k) * sizes[i]
    return series


def _waving(sizes: Array, half: Array, orders: int, waves: Waves) -> Array:
    """Bounds (orders, n) of the waves' angles together, likewise."""
    total = np.zeros((orders, len(half)))
    moving = np.any(sizes[1:], axis=(0, 1))
    for axes, order, cosine, sine in waves:
        own = axes[moving[axes]]
        height = np.hypot(cosine, sine)[moving[axes]]
        turned = _series(sizes[:, :, own], half[:, None], orders) * order[moving[axes]]
        total[1:] += product(_exponential(turned), height)[1:]
    return total


def _exponential(series: Array) -> Array:
    """Of a power series (orders, ...) that begins with 0."""
    slope = _slope(series)
    out = np.zeros_like(series)
    out[0] = 1.0
    for n in range(1, len(out)):
        out[n] = _term(slope, out, n - 1) / n
    return out


def _product(a: Array, b: Array) -> Array:
    """As many terms as the shorter has."""
    return np.array([_term(a, b, n) for n in range(min(len(a), len(b)))])


def _term(a: Array, b: Array, n: int) -> Array:
    """Number n of a product of power series."""
    return np.einsum("k...,k...->...", a[: n + 1], b[n::-1])


def _slope(series: Array) -> Array:
    """The derivative."""
    return series[1:] * np.arange(1, len(series)).reshape(-1, *[1] * (series.ndim - 1))
