"""Motion: joint angles, rates and accelerations as exact functions of time.

Every motion of the stand, planned or simulated, is one `Motion`: piecewise polynomials. Waves
become polynomials by `fitted`, samples by `splined`, and motions at one time add up by `summed`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum
from functools import cache
from math import comb, cos, factorial, pi

import numpy as np
from numpy.polynomial import chebyshev, polynomial
from numpy.typing import ArrayLike, NDArray

from alignment.arrays import Array, IntArray, owned
from alignment.fixed_order import product, recursion
from stand.motion.places import Places

FIT_DEGREE = 9
FIT_PER_PERIOD = 10  # pieces of a sine: then fitted to 1e-10 of its acceleration
BLOCK = 4096  # pieces worked out at once: temporary arrays stay small
_SETTLED = 48  # rows of the splines' equations until their factors change no more
JOINED, FEWER = 20, 5  # pieces of a spline that may become one
SAME_KNOT = 1e-9  # s: knots of several motions nearer than this are one


class MotionKind(Enum):
    """How the joints follow a plan: exactly, or as a simulated servo makes them."""

    IDEAL = "ideal"
    SERVO = "servo"


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """Piecewise polynomials of the six joint angles.

    Attributes
    ----------
    knots : (k + 1,) s
        Where the pieces meet: jerk switches, starts and ends of steps. Increasing.
    coefficients : (d + 1, k, 6)
        Of each piece and joint, highest power first, in time since the piece's start [rad/s^i].
        Angle, rate and acceleration are continuous.
    whole : bool
        Whether there is no more of it: not a window of a longer one, in which an axis that stands
        still here may move.
    """

    knots: Array
    coefficients: Array
    whole: bool = True

    def __post_init__(self) -> None:
        knots = owned(self.knots, "knots", (None,))
        pieces = (None, len(knots) - 1, None)
        object.__setattr__(self, "knots", knots)
        object.__setattr__(self, "coefficients", owned(self.coefficients, "coefficients", pieces))
        if len(knots) < 2 or (np.diff(knots) <= 0).any():
            raise ValueError("knots: must increase")

    @property
    def start(self) -> float:
        """When the motion begins [s]."""
        return float(self.knots[0])

    @property
    def duration(self) -> float:
        """When the motion ends [s]: its length, as a whole motion begins at 0."""
        return float(self.knots[-1])

    @property
    def at_rest(self) -> NDArray[np.bool_]:
        """Which pieces (k,) stand still."""
        return np.logical_not(np.any(self.coefficients[:-1], axis=(0, 2)))

    def covering(self, t_from: float, t_to: float) -> "Motion":
        """The motion over [t_from, t_to] s: this one; a servo yields it as it goes."""
        return self

    def joints(self, t: ArrayLike) -> tuple[Array, Array, Array]:
        """Angles [rad], rates [rad/s] and accelerations [rad/s^2] at times (n,): (n, 6) each.

        Outside of its time the motion is held as it begins and ends, which is at rest.
        """
        angle, rate, half_acceleration = self._seen(t, 2)
        half_acceleration *= 2
        return angle, rate, half_acceleration

    def angles_and_rates(self, t: ArrayLike) -> tuple[Array, Array]:
        """As `joints`, to the bit, without accelerations: less work."""
        angle, rate = self._seen(t, 1)
        return angle, rate

    def _seen(self, t: ArrayLike, orders: int) -> list[Array]:
        """Angles and so many derivatives, the k-th over k!: (n, joints) each.

        Notes
        -----
        Horner's scheme for all at once, of the joints that move in these pieces. SciPy's PPoly is
        as fast, but takes 0.2 s to import at every start.
        """
        t = np.clip(t, self.knots[0], self.knots[-1])
        piece = np.searchsorted(self.knots[1:-1], t, side="right")
        since = t - self.knots[piece]
        if not len(t):
            return [np.zeros((0, self.coefficients.shape[2])) for _ in range(orders + 1)]
        first, last = int(piece.min()), int(piece.max()) + 1
        if last - first > len(t):  # each piece by itself
            some, piece = np.take(self.coefficients, piece, axis=1), np.arange(len(t))
        else:
            some, piece = self.coefficients[:, first:last], piece - first
        moving = np.flatnonzero(some[:-1].any(axis=(0, 1)) | (some[-1] != some[-1, 0]).any(axis=0))
        seen = [np.zeros((self.coefficients.shape[2], len(t))) for _ in range(orders + 1)]
        seen[0] += some[-1, 0][:, None]
        for own, found in zip(seen, _horner(some[:, :, moving], piece, since, orders), strict=True):
            own[moving] = found
        return [values.T for values in seen]

    def derivative(self) -> "Motion":
        """The motion's rate as a motion: its `joints` are rates, accelerations and jerks."""
        degree = len(self.coefficients) - 1
        powers = np.arange(degree, 0, -1)[:, None, None]
        return Motion(self.knots, self.coefficients[:-1] * powers)


def _horner(coefficients: Array, piece: IntArray, since: Array, orders: int) -> list[Array]:
    """Polynomials and so many derivatives, the k-th over k!, (joints, n) each.

    `coefficients` (d + 1, k, joints) as of `Motion`; `piece` (n,), in time `since` (n,) its start.
    """
    c = np.ascontiguousarray(coefficients.swapaxes(1, 2))
    places = Places(piece, since) if (piece[1:] >= piece[:-1]).all() else None
    tau = since if places is None else places.table
    terms = c[:, :, piece] if places is None else places.beside(c)
    angle = np.empty((c.shape[1], *tau.shape))
    angle[:] = terms[0]
    seen = [angle, *(np.zeros_like(angle) for _ in range(orders))]
    for term in terms[1:]:
        for low, high in zip(seen[-2::-1], seen[:0:-1], strict=True):
            high *= tau
            high += low
        angle *= tau
        angle += term
    return [values if places is None else places.flat(values) for values in seen]


def fitted(angles: Callable[[Array], Array], knots: Array) -> Motion:
    """A smooth function of time as polynomials of degree 9, one between each two knots.

    Parameters
    ----------
    angles : callable
        Takes times (n,) [s], gives joint angles (n, 6) [rad].
    knots : (k + 1,) s
        `FIT_PER_PERIOD` for the fastest wave.

    Notes
    -----
    Interpolates at ten Chebyshev points of each piece, its ends among them.
    """
    coefficients: Array | None = None
    for first in range(0, len(knots) - 1, BLOCK):
        part = _fitted(angles, knots[first : first + BLOCK + 1])
        if coefficients is None:
            coefficients = np.empty((FIT_DEGREE + 1, len(knots) - 1, part.shape[2]))
        coefficients[:, first : first + BLOCK] = part
    assert coefficients is not None
    coefficients.flags.writeable = False
    return Motion(knots, coefficients)


def _fitted(angles: Callable[[Array], Array], knots: Array) -> Array:
    """Coefficients (d + 1, k, joints) of the pieces between `knots` (k + 1,)."""
    nodes, to_powers = _chebyshev(FIT_DEGREE)
    lengths = np.diff(knots)
    t = knots[:-1, None] + lengths[:, None] * nodes
    t[:, -1] = knots[1:]  # both neighbours see the same angle where they meet
    values = angles(t.ravel()).reshape(len(lengths), FIT_DEGREE + 1, -1)
    # Cubics through every third point apart: powers of u cancel one another, so what they carry
    # should be small.
    bent = values - values[:, :1]
    _, to_cubic = _chebyshev(FIT_DEGREE // 3)
    cubic = np.einsum("pn,knj->pkj", to_cubic, bent[:, ::3])
    bent -= np.einsum("np,pkj->knj", np.vander(nodes, len(cubic), increasing=True), cubic)
    scaled = np.einsum("pn,knj->pkj", to_powers, bent)
    scaled[: len(cubic)] += cubic
    scaled[0] = values[:, 0]
    powers = np.arange(FIT_DEGREE + 1)[:, None]
    return (scaled / (lengths**powers)[:, :, None])[::-1]


@cache
def _chebyshev(degree: int) -> tuple[Array, Array]:
    """Points of [0, 1] with both ends, and the matrix from values there to powers of u."""
    x = np.array([-cos(pi * i / degree) for i in range(degree + 1)])
    # of T_k at these points the inverse is a cosine transform's, ends and first and last counted
    # by half
    k, ends = np.arange(degree + 1), np.where(np.arange(degree + 1) % degree, 1.0, 2.0)
    cosines = np.array([[cos(pi * i * j / degree) for j in k] for i in k])
    series = (2 / degree) * (-1.0) ** k[:, None] * cosines / np.outer(ends, ends)
    in_x = np.stack(
        [np.pad(chebyshev.cheb2poly(c), (0, degree + 1))[: degree + 1] for c in series.T]
    )
    in_u = [polynomial.polyfromroots([])]
    for _ in range(degree):  # powers of x = 2 u - 1
        in_u.append(polynomial.polymul(in_u[-1], [-1.0, 2.0]))
    powers = np.stack([np.pad(p, (0, degree + 1 - len(p))) for p in in_u])
    return (x + 1) / 2, product(in_x, powers).T


def splined(samples: Array, step: float, start: float = 0.0) -> Motion:
    """The quintic spline through samples (n, 6) [rad] at even steps [s], n >= 12.

    Its ends are at rest if the samples are: the spline is continued by their first and last
    value, so hold those for six samples or more.

    Notes
    -----
    Cardinal B-splines: coefficients from the banded collocation matrix (1, 26, 66, 26, 1)/120,
    which forgets at 0.43 per step: a knot 48 steps away counts 3e-18.
    """
    # beyond the ends the B-spline coefficients are the end samples: exact where those rest
    right = np.array(samples, dtype=float)
    right -= samples[0]
    last = right[-1].copy()
    right[-1] -= last * 27 / 120
    right[-2] -= last / 120
    c = _collocated(right)
    ends = np.zeros((2, c.shape[1])), np.repeat(last[None], 2, axis=0)
    return b_spline(np.concatenate([ends[0], c, ends[1]]), step, start, samples[0])


def _collocated(right: Array) -> Array:
    """Solution (n, joints) of the banded equations with right sides (n, joints), n >= 2.

    By factors ``L D L^T``, whose rows no longer change after some: from there on a recursion.
    """
    one, two, pivots = _factors()
    size = min(len(right), len(pivots))
    y = np.array(right[:size])
    for k in range(1, size):
        y[k] -= one[k] * y[k - 1] + (two[k] * y[k - 2] if k > 1 else 0.0)
    feedback = -one[-1], -two[-1]
    last = np.stack([y[-1], y[-2]], axis=1)
    y = np.concatenate([y, recursion(feedback, right[size:].T, last).T])
    y[:size] /= pivots[:size, None]
    y[size:] /= pivots[-1]
    none = np.zeros((y.shape[1], 2))
    after = recursion(feedback, y[: size - 1 : -1].T, none).T[::-1] if size < len(y) else y[size:]
    c = np.concatenate([y[:size], after, np.zeros((2, y.shape[1]))])
    for k in range(size - 1, -1, -1):
        c[k] -= one[min(k + 1, len(one) - 1)] * c[k + 1] + two[min(k + 2, len(two) - 1)] * c[k + 2]
    return c[:-2]


@cache
def _factors() -> tuple[Array, Array, Array]:
    """Of (1, 26, 66, 26, 1)/120: below the diagonal of L, once and twice, and the pivots D.

    Row k differs from the rows far down by 0.43^(2 k): 48 rows are all that do.
    """
    outer, inner, middle = 1 / 120, 26 / 120, 66 / 120
    one, two, pivots = np.zeros((3, _SETTLED))
    for k in range(_SETTLED):
        if k > 1:
            two[k] = outer / pivots[k - 2]
        if k > 0:
            mixed = two[k] * pivots[k - 2] * one[k - 1] if k > 1 else 0.0
            one[k] = (inner - mixed) / pivots[k - 1]
        pivots[k] = middle
        pivots[k] -= one[k] ** 2 * pivots[k - 1] if k > 0 else 0.0
        pivots[k] -= two[k] ** 2 * pivots[k - 2] if k > 1 else 0.0
    return one, two, pivots


def b_spline(
    weights: Array, step: float, start: float = 0.0, level: ArrayLike = 0.0, degree: int = 5
) -> Motion:
    """The sum of B-splines at even steps [s], `degree` - 1 times smooth; all weights 0: rest.

    Parameters
    ----------
    weights : (k + degree, joints) rad
        Of the B-splines about ``start + step (-h, ... k + h)``, ``h = (degree - 1)/2``; the k
        pieces begin at `start`.
    step, start : float
    level : (joints,) or number
        Added to the angles [rad]: what all weights have in common only rounds the derivatives.
    degree : int
        Odd.
    """
    k = len(weights) - degree
    to_powers = _cardinal(degree) / np.array([[step**power] for power in range(degree, -1, -1)])
    coefficients = np.empty((degree + 1, k, weights.shape[1]))
    for first in range(0, k, BLOCK):
        block = weights[first : first + BLOCK + degree]
        windows = np.stack([block[i : len(block) - degree + i] for i in range(degree + 1)])
        coefficients[:, first : first + BLOCK] = np.einsum("pi,ikj->pkj", to_powers, windows)
    coefficients[-1] += level
    coefficients.flags.writeable = False
    return Motion(start + step * np.arange(k + 1), coefficients)


@cache
def _cardinal(degree: int) -> Array:
    """From B-spline coefficients (degree + 1,) to powers of u in [0, 1], highest first."""
    n = degree + 1
    rows = np.zeros((n, n))
    for i in range(n):  # B-spline i lies degree - i steps into its support over [0, 1]
        for j in range(n - i):  # sum over truncated powers (u + degree - i - j)^degree
            shifted = polynomial.polypow([float(degree - i - j), 1.0], degree)
            rows[:, i] += (-1) ** j * comb(n, j) * shifted[::-1]
    return rows / factorial(degree)


def hermite(t: Array, angle: Array, rate: Array, acceleration: Array) -> Array:
    """Quintics (6, n - 1, joints) through angle, rate and acceleration (n, joints) at both ends.

    `t` (n,) [s]; their coefficients are as those of `Motion`.
    """
    h = np.diff(t)[:, None]
    p, v, a = angle[:-1], rate[:-1], acceleration[:-1]
    # what angle, rate (h) and acceleration (h^2) at the end have beyond the parabola's
    d = angle[1:] - p - h * v - h**2 * a / 2
    e = h * (rate[1:] - v - h * a)
    f = h**2 * (acceleration[1:] - a)
    coefficients = np.stack(
        [
            (6 * d - 3 * e + f / 2) / h**5,
            (-15 * d + 7 * e - f) / h**4,
            (10 * d - 4 * e + f / 2) / h**3,
            a / 2,
            v,
            p,
        ]
    )
    coefficients.flags.writeable = False
    return coefficients


def smoothed(coefficients: Array, step: float, tolerance: float) -> tuple[Array, IntArray]:
    """Pieces of a quintic spline at even steps [s], joined where one says the same as several.

    Parameters
    ----------
    coefficients : (6, n + 1, joints)
        Of the pieces, n a whole number of `JOINED` pieces; the last only tells where they end.
    step : float
    tolerance : float
        Of the acceleration at the steps [rad/s^2].

    Returns
    -------
    coefficients : (6, m, joints)
    numbers : (m,)
        Of the steps with which they begin.

    Notes
    -----
    `JOINED` or `FEWER` pieces become the quintic through angle, rate and acceleration at both
    ends: the motion is as smooth as it was. Which become one is told by their own place alone.
    """
    made, begins = coefficients[:, :-1].copy(), np.ones(coefficients.shape[1] - 1, bool)
    states = coefficients[[5, 4, 3]] * np.array([1, 1, 2])[:, None, None]
    for size in (FEWER, JOINED):
        times = step * np.arange(0, len(begins) + 1, size)
        whole = hermite(times, *states[:, ::size])
        seen = states[2, :-1].reshape(-1, size, states.shape[2])
        inside = (step * np.arange(1, size))[:, None, None]
        c = whole[:4] * np.array([20, 12, 6, 2])[:, None, None]
        said = ((c[0] * inside + c[1]) * inside + c[2]) * inside + c[3]
        off = np.abs(said - seen[:, 1:].swapaxes(0, 1)).max(axis=(0, 2))
        same = off <= tolerance
        made[:, ::size][:, same] = whole[:, same]
        begins.reshape(-1, size)[same, 1:] = False
    numbers = np.flatnonzero(begins)
    return made[:, numbers], numbers


def summed(motions: Sequence[Motion]) -> Motion:
    """The motion whose angles are the sums of several, each held outside of its own time."""
    if len(motions) == 1:
        return motions[0]
    every = np.unique(np.concatenate([m.knots for m in motions]))
    knots = every[np.concatenate([[True], np.diff(every) > SAME_KNOT])]
    degree = max(len(m.coefficients) for m in motions) - 1
    total = np.zeros((degree + 1, len(knots) - 1, motions[0].coefficients.shape[2]))
    for first in range(0, len(knots) - 1, BLOCK):
        part = slice(first, min(first + BLOCK, len(knots) - 1))
        for motion in motions:
            moved = _moved(motion, knots[part])
            total[degree + 1 - len(moved) :, part] += moved
    total.flags.writeable = False
    return Motion(knots, total)


def _moved(motion: Motion, starts: Array) -> Array:
    """Coefficients of the motion's polynomials in time since `starts` (k,)."""
    middle = starts + SAME_KNOT
    piece = np.searchsorted(motion.knots, middle, side="right") - 1
    piece = np.clip(piece, 0, len(motion.knots) - 2)
    outside = (middle < motion.knots[0]) | (middle > motion.knots[-1])
    held = np.clip(starts, motion.knots[0], motion.knots[-1])
    tau = (held - motion.knots[piece])[:, None]
    c = motion.coefficients[:, piece]
    if tau.any():  # Taylor shift by repeated synthetic division
        for stop in range(len(c), 1, -1):
            for i in range(1, stop):
                c[i] += c[i - 1] * tau
    c[:-1, outside] = 0.0
    return c
