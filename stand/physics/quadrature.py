"""Means of what sensors feel between two times: rules, and the law that sets their steps.

Closed rules on steps between the edges of samples and the knots of the motion. Up to `SHORT`:
Simpson's, as for every sample at 200 Hz and every piece of a servo's motion. Longer steps take
Lobatto's rule of four points, exact to the fifth power: its error is ``h^6/1512000`` times the
sixth derivative, so that 0.2 rad of turning cost no more than 0.02 rad do with Simpson's.

The sixth derivatives are bounded from those of the joints, power series against power series (a
majorant): a chain of rotations by angles ``q_j(t)`` has no greater derivatives than
``exp(sum |q_j|(t))``, where each series has the absolute derivatives of its angle.
"""

from collections.abc import Iterable
from math import comb, factorial, sqrt

import numpy as np

from alignment.arrays import Array, IntArray
from alignment.units import STANDARD_GRAVITY
from stand.motion import Motion

SHORT = 5e-3  # s: steps of Simpson's rule
FORCE_ERROR = 1e-9  # m/s^2 of a mean by Lobatto's rule
RATE_ERROR = 1e-11  # rad/s
REACH = 1.0  # m: nothing that is felt lies farther from an axis
_LOBATTO = 1_512_000.0  # error of the mean over h: h^6 over this, times the sixth derivative
_ORDER = 6  # of that derivative
_INNER = np.array([1 - 1 / sqrt(5), 1 + 1 / sqrt(5)]) / 2  # where Lobatto's rule looks inside
_SHORT = SHORT * (1 + 1e-6)  # edges of samples are rounded
_LEAST = 1e-30  # of a bound: at rest any step will do

Waves = Iterable[tuple[IntArray, IntArray, Array, Array]]


def is_long(lengths: Array) -> np.ndarray:
    """Which intervals (n,) [s], parted or not, take Lobatto's rule."""
    return lengths > _SHORT


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


def longest_steps(motion: Motion, pieces: IntArray, waves: Waves) -> Array:
    """Steps (n,) [s] of Lobatto's rule that keep `FORCE_ERROR` and `RATE_ERROR`.

    Parameters
    ----------
    motion : Motion
    pieces : (n,)
        Numbers of its pieces.
    waves : of (axes, times round, cosine, sine amplitudes [rad])
        What the axes do beyond the motion, as `stand.imperfection.TableErrors.waves`.
    """
    angle = _chain(_joint_series(motion, pieces), waves)
    rate = _slope(angle)
    turned = _exponential(angle)
    spun = _product(rate, turned)
    moved = _slope(spun) + _product(spun, spun)[:-1]
    force = STANDARD_GRAVITY * turned[_ORDER] + REACH * _product(turned, moved)[_ORDER]
    bounds = (force, FORCE_ERROR), (spun[_ORDER], RATE_ERROR)
    scale = _LOBATTO / factorial(_ORDER)
    steps = [(scale * e / np.maximum(bound, _LEAST)) ** (1 / _ORDER) for bound, e in bounds]
    return np.minimum(*steps)


def _joint_series(motion: Motion, pieces: IntArray) -> Array:
    """Bounds (orders, n, joints) of q_j^(k)/k! anywhere in each piece; of the angle itself 0."""
    c = np.abs(motion.coefficients[::-1, pieces])
    length = np.diff(motion.knots)[pieces, None]
    series = np.zeros((_ORDER + 3, *c.shape[1:]))
    for k in range(1, min(len(series), len(c))):
        for i in range(len(c) - 1, k - 1, -1):  # Horner's scheme
            series[k] = series[k] * length + comb(i, k) * c[i]
    return series


def _chain(joints: Array, waves: Waves) -> Array:
    total = joints.sum(axis=2)
    moving = np.any(joints, axis=(0, 1))
    for axes, order, cosine, sine in waves:
        own = moving[axes]
        size = np.hypot(cosine, sine)[own]
        wave = _exponential(joints[:, :, axes[own]] * order[own]) * size
        total[1:] += wave[1:].sum(axis=2)
    return total


def _exponential(series: Array) -> Array:
    """Of a power series (orders, ...) that begins with 0."""
    out = np.zeros_like(series)
    out[0] = 1.0
    for n in range(1, len(out)):
        out[n] = sum(k * series[k] * out[n - k] for k in range(1, n + 1)) / n
    return out


def _product(a: Array, b: Array) -> Array:
    """As many terms as the shorter has."""
    return np.array(
        [sum(a[k] * b[n - k] for k in range(n + 1)) for n in range(min(len(a), len(b)))]
    )


def _slope(series: Array) -> Array:
    """The derivative."""
    return series[1:] * np.arange(1, len(series)).reshape(-1, *[1] * (series.ndim - 1))
