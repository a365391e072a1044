"""Motion: joint angles, rates and accelerations as exact functions of time.

Every motion of the stand, planned or simulated, is one `Motion`: piecewise polynomials. Waves
become polynomials by `fitted`, samples by `splined`, and motions at one time add up by `summed`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum
from functools import cache
from math import comb, cos, factorial, pi
from typing import Protocol

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

    def angles(self, t: ArrayLike) -> Array:
        """As `joints`, to the bit, without rates and accelerations: less work."""
        (angle,) = self._seen(t, 0)
        return angle

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
        moving = moving_joints(some)
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


def moving_joints(coefficients: Array) -> IntArray:
    """Numbers of the joints that ever move, by coefficients (d + 1, k, joints) as of `Motion`."""
    turns = coefficients[:-1].any(axis=(0, 1))
    return np.flatnonzero(turns | (coefficients[-1] != coefficients[-1, 0]).any(axis=0))


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
    return b_spline(_weights(samples, _collocated), step, start, samples[0])


def _weights(samples: Array, solved: Callable[[Array], Array]) -> Array:
    """Of the B-splines (n + 4, joints) that add up to samples (n, joints) less the first.

    `solved` is `_collocated`, or `_settled` where nobody asks for the ends.
    """
    # beyond the ends the B-spline coefficients are the end samples: exact where those rest
    right = np.array(samples.T, dtype=float, order="C")
    right -= samples[0][:, None]
    last = right[:, -1].copy()
    right[:, -1] -= last * 27 / 120
    right[:, -2] -= last / 120
    return np.concatenate([np.zeros((2, len(last))), solved(right).T, [last, last]])


def _collocated(right: Array) -> Array:
    """Solution (joints, n) of the banded equations with right sides (joints, n), n >= 2.

    By factors ``L D L^T``, whose rows no longer change after some: from there on a recursion.
    """
    one, two, pivots = _factors()
    size = min(right.shape[1], len(pivots))
    nothing, feedback = np.zeros((len(right), 2)), (-one[-1], -two[-1])
    found = np.empty_like(right)
    begin, after = found[:, :size], found[:, size:]
    begin[:] = _eliminated(right[:, :size], one[:size], two[:size], nothing)
    after[:] = recursion(feedback, right[:, size:], begin[:, :-3:-1])
    begin /= pivots[:size]
    after /= pivots[-1]
    after[:] = recursion(feedback, after[:, ::-1], nothing)[:, ::-1]
    above, twice = (f[np.minimum(np.arange(size) + k, len(f) - 1)] for k, f in ((1, one), (2, two)))
    reached = np.concatenate([after[:, :2], nothing], axis=1)[:, :2]
    begin[:] = _eliminated(begin[:, ::-1], above[::-1], twice[::-1], reached)[:, ::-1]
    return found


def _settled(right: Array) -> Array:
    """As `_collocated` by the recursion alone, as if the factors had settled before the first row:
    off by 0.43^k of the right sides in the k-th from either end.
    """
    one, two, pivots = _factors()
    nothing, feedback = np.zeros((len(right), 2)), (-one[-1], -two[-1])
    down = recursion(feedback, right, nothing)
    down /= pivots[-1]
    return recursion(feedback, down[:, ::-1], nothing)[:, ::-1]


def _eliminated(rows: Array, one: Array, two: Array, before: Array) -> Array:
    """Each value of `rows` (joints, k) less `one` (k,) of that before and `two` of that before it.

    `before` (joints, 2): what the first finds, the nearer one first. Numbers one by one: for so
    few joints that takes half as long as arrays do.
    """
    factors, found = list(zip(one.tolist(), two.tolist(), strict=True)), []
    for own, (last, second) in zip(rows.tolist(), before.tolist(), strict=True):
        row = []
        for value, (a, b) in zip(own, factors, strict=True):
            last, second = value - (a * last + b * second), last
            row.append(last)
        found.append(row)
    return np.array(found)


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
    to_powers = _to_powers(degree, step)
    coefficients = np.empty((degree + 1, k, weights.shape[1]))
    for first in range(0, k, BLOCK):
        block = weights[first : first + BLOCK + degree]
        windows = np.stack([block[i : len(block) - degree + i] for i in range(degree + 1)])
        coefficients[:, first : first + BLOCK] = np.einsum("pi,ikj->pkj", to_powers, windows)
    coefficients[-1] += level
    coefficients.flags.writeable = False
    return Motion(start + step * np.arange(k + 1), coefficients)


def _to_powers(degree: int, step: float) -> Array:
    """As `_cardinal` to powers of time since the piece's start [1/s^i]."""
    return _cardinal(degree) / np.array([[step**power] for power in range(degree, -1, -1)])


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
    begin, end = ((angle[k], rate[k], acceleration[k]) for k in (np.s_[:-1], np.s_[1:]))
    coefficients = _quintics(np.diff(t)[:, None], begin, end)
    coefficients.flags.writeable = False
    return coefficients


def _quintics(h: Array, begin: Sequence[Array], end: Sequence[Array]) -> Array:
    """Those (6, m, joints) through angle, rate and acceleration (m, joints) `h` (m, 1) apart."""
    p, v, a = begin
    angle, rate, acceleration = end
    # what angle, rate (h) and acceleration (h^2) at the end have beyond the parabola's
    d = angle - p - h * v - h**2 * a / 2
    e = h * (rate - v - h * a)
    f = h**2 * (acceleration - a)
    return np.stack(
        [
            (6 * d - 3 * e + f / 2) / h**5,
            (-15 * d + 7 * e - f) / h**4,
            (10 * d - 4 * e + f / 2) / h**3,
            a / 2,
            v,
            p,
        ]
    )


class SplinePieces:
    """Of the spline that `splined` makes, those pieces that are asked for.

    Parameters
    ----------
    samples : (n + 1 + 2 margin, joints) rad
    step : float
        Between them [s].
    margin : int
        Steps at either end that are not told: step 0 is that after so many. What is told differs
        from `splined` by 0.43^margin of the angles, from 43 on by rounding alone.
    """

    def __init__(self, samples: Array, step: float, margin: int) -> None:
        self.count = len(samples) - 1 - 2 * margin
        self._to_powers, self._level = _to_powers(5, step), samples[0]
        self._weights = _weights(samples, _settled)[
            margin : margin + self.count + len(self._to_powers)
        ]

    def coefficients(self, numbers: IntArray, first: int = 0) -> Array:
        """Of the pieces that begin with steps (m,), from power number `first` on: (..., m, joints).

        That of step n tells where the others end.
        """
        windows = self._weights[numbers + np.arange(len(self._to_powers))[:, None]]
        found = np.einsum("pi,ikj->pkj", self._to_powers[first:], windows)
        found[-1] += self._level
        return found

    def accelerations(self) -> Array:
        """At steps 0 to n (n + 1, joints) [rad/s^2]."""
        factors = 2 * self._to_powers[3]
        total = factors[0] * self._weights[: self.count + 1]
        for i in range(1, len(factors) - 1):  # the last has none
            total += factors[i] * self._weights[i : i + self.count + 1]
        return total


class AnyPieces(Protocol):
    """As `SplinePieces`."""

    count: int

    def coefficients(self, numbers: IntArray, first: int = 0) -> Array: ...
    def accelerations(self) -> Array: ...


def smoothed(spline: AnyPieces, step: float, tolerance: float) -> tuple[Array, IntArray]:
    """Pieces of a quintic spline at even steps [s], joined where one says the same as several.

    Parameters
    ----------
    spline : SplinePieces
        Of a whole number of `JOINED` pieces.
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
    seen, told = spline.accelerations(), []
    left = np.arange(0, spline.count, JOINED)  # steps from which on nobody has told
    for size in (JOINED, FEWER):
        left = (left[:, None] + np.arange(0, JOINED, size)).ravel()
        inside = np.arange(1, size)[:, None]
        whole = _whole(spline, left, left + size, step)
        c = whole[:4] * np.array([20, 12, 6, 2])[:, None, None]
        at = (step * inside)[:, :, None]
        off = c[0] * at + c[1]
        for lower in c[2:]:
            off *= at
            off += lower
        off -= seen[inside + left]
        same = np.abs(off, out=off).max(axis=0).max(axis=1) <= tolerance
        told.append((left[same], whole[:, same]))
        left = left[~same]
    left = (left[:, None] + np.arange(FEWER)).ravel()
    told.append((left, spline.coefficients(left)))
    numbers = np.concatenate([steps for steps, _ in told])
    order = np.argsort(numbers)
    made = np.concatenate([pieces for _, pieces in told], axis=1)
    return made[:, order], numbers[order]


def _whole(spline: AnyPieces, begins: IntArray, ends: IntArray, step: float) -> Array:
    """Quintics (6, m, joints) from steps `begins` (m,) to `ends`."""
    states = []
    for at in (begins, ends):
        half_acceleration, rate, angle = spline.coefficients(at, 3)
        states.append((angle, rate, 2 * half_acceleration))
    return _quintics((step * ends - step * begins)[:, None], *states)


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
