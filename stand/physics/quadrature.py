"""How many instants a motion must be looked at: the law that sets the panels.

Between the knots of a motion everything is smooth, and what is felt there is a polynomial through
a few instants (`stand.physics.panels`) but for an error that its derivatives bound. Where samples
end within a piece, the interpolant itself must be right: n nodes err by ``K_n (h/2)^n/n!`` times
the derivative of order n. Where none does, only the mean over the whole of it: by Lobatto's rule
n nodes err by ``C_n h^(2n-2)`` times the derivative of order 2n - 2. Each piece takes the number
of nodes, and of even panels of so many, that cost fewest evaluations within `FORCE_ERROR` and
`RATE_ERROR`.

The derivatives are bounded from those of the joints, power series against power series (a
majorant): a chain of rotations by angles ``q_j(t)`` has no greater derivatives than
``exp(sum |q_j|(t))``, where each series has the absolute derivatives of its angle. What turns with
the outermost axis that moves does not see it turn: only what stands still, as gravity, does.

A motion that repeats itself, as coning turn by turn, is looked at in its first turn alone.
"""

from collections.abc import Iterable
from functools import cache
from math import comb, factorial, hypot
from threading import Lock

import numpy as np

from alignment.arrays import Array, IntArray
from alignment.earth import EARTH_RATE
from alignment.units import STANDARD_GRAVITY
from stand.motion.polynomial import Motion, moving_joints
from stand.physics.panels import Panels, places_of

FORCE_ERROR = 1e-9  # m/s^2 of the mean over a piece or several
RATE_ERROR = 1e-11  # rad/s
INSTANT_ERROR = 1e-3  # of these, of what is felt at an instant, and of the mean of parts of a piece
REACH = 1.0  # m: nothing that is felt lies farther from an axis
FEWEST, MOST = 3, 12  # nodes of a panel
ORDERS = 12  # the highest derivative that is bounded
_SAME = 4  # units in the last place of a time: a knot nearer to an edge is on it
_HELD = 1e6  # s, before and after a motion
_ROUNDED = 1e-6  # of a panel: edges of samples are
_LEAST = 1e-30  # of a bound: at rest any panel will do
_CHUNK = 2048  # pieces bounded at once, and ahead
_GROUP = 16  # pieces bounded as one, first

Waves = Iterable[tuple[IntArray, IntArray, Array, Array]]


@cache
def interpolation_constant(nodes: int) -> float:
    """Largest size of the polynomial from -1 to 1 that is 0 at the nodes, of leading term 1."""
    x = np.linspace(-1, 1, 4001)
    size = np.ones(len(x))
    for place in places_of(nodes):
        size *= np.abs(x - place)
    return float(size.max())


@cache
def quadrature_constant(nodes: int) -> float:
    """C_n as told above [Abramowitz & Stegun, 25.4.32]."""
    n = nodes
    own = n * (n - 1) ** 3 * factorial(n - 2) ** 4
    return own / ((2 * n - 1) * factorial(2 * n - 2) ** 3)


class Law:
    """How many nodes, in how many panels, each piece of one motion takes.

    A piece is judged from itself alone: the choice does not depend on what else is asked for, nor
    on who asks: several threads may.
    """

    def __init__(self, motion: Motion, waves: Waves) -> None:
        self._motion, self._waves = motion, list(waves)
        # nodes, panels where a sample ends within the piece; nodes, panels where none does
        self._known = np.zeros((len(motion.knots) - 1, 4), np.int64)
        self._judging = Lock()
        self._first = first_alike(motion)
        self.repeats = bool((self._first < np.arange(len(self._first))).any())

    @property
    def motion(self) -> Motion:
        """Whose law it is."""
        return self._motion

    @property
    def distinct(self) -> int:
        """How many pieces move, each another way."""
        own = self._first == np.arange(len(self._first))
        return int(np.count_nonzero(own & ~self._motion.at_rest))

    @property
    def moving(self) -> IntArray:
        """Numbers of the axes that ever move."""
        return moving_joints(self._motion.coefficients)

    def choose(self, first: int, whole: np.ndarray) -> tuple[IntArray, IntArray]:
        """Nodes of a panel (n,) and numbers of even panels (n,) of the pieces from `first` on.

        `whole` (n,): whether no sample ends within the piece.
        """
        pieces = first + np.arange(len(whole))
        nodes, panels = np.full((2, len(whole)), [[FEWEST], [1]])
        easy = self._one_parabola(pieces) if np.count_nonzero(whole) >= _GROUP else False
        open_yet = np.flatnonzero(~(whole & easy))
        asked = self._first[pieces[open_yet]]
        self._learn(asked)
        known = np.where(whole[open_yet, None], self._known[asked, 2:], self._known[asked, :2])
        nodes[open_yet], panels[open_yet] = known.T
        return nodes, panels

    def panels(self, edges: Array) -> tuple[Panels, Array]:
        """Panels that cover the `edges` (n + 1,) [s] of samples, and these: one that misses a knot
        by rounding is there."""
        motion = self._motion
        bounds, first = _pieces(motion, edges)
        edges = _snapped(edges, bounds)
        low = int(np.searchsorted(bounds, edges[0], side="right")) - 1
        high = int(np.searchsorted(bounds, edges[-1]))
        bounds, first = bounds[low : high + 1], first + low
        within = np.searchsorted(edges, bounds[1:]) > np.searchsorted(edges, bounds[:-1], "right")
        nodes, parts = np.full((2, len(within)), [[FEWEST], [1]])
        moving = slice(max(-first, 0), len(motion.knots) - 1 - first)  # where it is not held
        if len(within[moving]):
            nodes[moving], parts[moving] = self.choose(max(first, 0), ~within[moving])
        ends, piece, number = _parted(bounds, parts, edges)
        same = None
        if self.repeats:
            same = self._same(ends, first + piece, number, np.append(parts, 1)[piece])
        return Panels(ends, nodes[piece[:-1]], same), edges

    def _same(self, ends: Array, piece: IntArray, number: IntArray, parts: IntArray) -> Array:
        """As of `Panels`: of panels of these numbers in so many parts of a piece, (p + 1,) each."""
        knots, at = self._motion.knots, np.clip(piece, 0, len(self._first) - 1)
        first = np.where(at == piece, self._first[at], piece)
        again = first < piece  # what is held before and after the motion is itself
        own, lengths = first[again], np.diff(knots)[first[again]]
        same = np.stack([ends, np.append(ends[1:], np.nan)])
        for row, beyond in zip(same, (0, 1), strict=True):
            share = number[again] + beyond
            times = knots[own] + lengths * share / parts[again]
            row[again] = np.where(share == parts[again], knots[own + 1], times)
        return same

    def fewer_than_panels(self, t: Array, rate_hz: float) -> np.ndarray:
        """Of which times (n,) [s], so many a second, each one costs less than panels would.

        By the piece that each is in: its panels' nodes against its number of times. Where the
        motion is held there is nothing to gain.
        """
        if not rate_hz:
            return np.ones(len(t), bool)
        knots = self._motion.knots
        pieces = np.clip(np.searchsorted(knots, t) - 1, 0, len(knots) - 2)
        distinct, own = np.unique(self._first[pieces], return_inverse=True)
        self._learn(distinct)
        nodes, panels = self._known[distinct, :2].T
        return (np.diff(knots)[distinct] * rate_hz < panels * (nodes - 1))[own]

    def _one_parabola(self, pieces: IntArray) -> np.ndarray:
        """Of which pieces (n,) one panel of three nodes has the mean, as told by groups of them.

        A group is bounded as one piece with the greatest coefficients and length of all: bounds
        only grow with these. Of a servo's thousand pieces a second few remain to be asked.
        """
        first, last = pieces[0], pieces[-1] + 1
        starts = np.arange(0, last - first, _GROUP)
        size = np.abs(self._motion.coefficients[:, first:last])
        size = np.maximum.reduceat(size, starts, axis=1)
        length = np.maximum.reduceat(np.diff(self._motion.knots[first : last + 1]), starts)
        group = Motion(np.append(0.0, np.cumsum(length)), size)
        bounds = derivatives(group, np.arange(len(starts)), self._waves, order=4)
        return np.repeat(length <= longest_whole(FEWEST, bounds), _GROUP)[: len(pieces)]

    def _learn(self, pieces: IntArray) -> None:
        """Judge these, those that are not yet; of few the next as well, which will be asked for."""
        with self._judging:
            new = pieces[self._known[pieces, 0] == 0]
            if not len(new):
                return
            ahead = np.arange(new[-1] + 1, min(new[0] + _CHUNK, len(self._known)))
            new = np.unique(np.concatenate([new, self._first[ahead]]))
            for first in range(0, len(new), _CHUNK):
                part = new[first : first + _CHUNK]
                self._known[part] = self._judged(part)

    def _judged(self, pieces: IntArray) -> IntArray:
        lengths = np.diff(self._motion.knots)[pieces]
        bounds = derivatives(self._motion, pieces, self._waves)
        within = [longest_panels(n, bounds) for n in range(FEWEST, MOST + 1)]
        of_all = [longest_whole(n, bounds) for n in range(FEWEST, ORDERS // 2 + 2)]
        return np.hstack([_cheapest(lengths, within), _cheapest(lengths, of_all)])


def _pieces(motion: Motion, edges: Array) -> tuple[Array, int]:
    """Where the pieces about the `edges` meet, those where it is held included; the first's number.

    A number below 0 is that of the hold before the motion.
    """
    knots = motion.knots
    first = int(np.searchsorted(knots, edges[0])) - 2
    last = int(np.searchsorted(knots, edges[-1], side="right")) + 2
    bounds = knots[max(first, 0) : last]
    before = [knots[0] - _HELD] if first < 0 else []
    after = [knots[-1] + _HELD] if last > len(knots) else []
    return np.concatenate([before, bounds, after]), max(first, -1)


def _snapped(edges: Array, bounds: Array) -> Array:
    """The edges; those that are at one of the bounds but for rounding are there to the bit."""
    after = np.clip(np.searchsorted(edges, bounds), 1, len(edges) - 1)
    nearest = after - (bounds - edges[after - 1] < edges[after] - bounds)
    same = np.abs(edges[nearest] - bounds) <= _SAME * np.spacing(np.abs(bounds))
    out = edges.copy()
    out[nearest[same]] = bounds[same]
    return out


def _parted(bounds: Array, parts: IntArray, edges: Array) -> tuple[Array, IntArray, IntArray]:
    """Where p panels begin and the last ends (p + 1,) [s], so many even ones of each piece, of
    those that the edges meet: of a piece of many hours few. The piece of each, and of the one
    that would follow, and its number there (p + 1,).
    """
    lengths = np.diff(bounds)
    begin, end = np.zeros(len(parts), np.int64), parts.copy()
    begin[0] = max(int((edges[0] - bounds[0]) / lengths[0] * parts[0]) - 1, 0)
    end[-1] = min(int((edges[-1] - bounds[-2]) / lengths[-1] * parts[-1]) + 2, parts[-1])
    count = end - begin
    piece = np.repeat(np.arange(len(parts)), count)
    number = np.arange(len(piece)) - (np.cumsum(count) - count)[piece] + begin[piece]
    starts = bounds[piece] + lengths[piece] * number / parts[piece]
    whole = end[-1] == parts[-1]
    stop = bounds[-1] if whole else bounds[-2] + lengths[-1] * end[-1] / parts[-1]
    ends = np.append(starts, stop)
    piece = np.append(piece, len(parts) if whole else len(parts) - 1)
    number = np.append(number, 0 if whole else end[-1])
    met = slice(
        int(np.searchsorted(ends, edges[0], side="right")) - 1,
        int(np.searchsorted(ends, edges[-1])) + 1,
    )
    return ends[met], piece[met], number[met]


def first_alike(motion: Motion) -> IntArray:
    """Of each piece (k,) the first that does the same to the bit, and so does the next to it.

    Coning repeats itself turn by turn, to the rounding of the knots' times.
    """
    k, numbers = len(motion.knots) - 1, np.arange(len(motion.knots) - 1)
    rng = np.random.default_rng(0)
    odd = rng.integers(1 << 62, size=motion.coefficients.shape[::2], dtype=np.uint64) | np.uint64(1)
    keys = np.zeros(k, np.uint64)
    for a in range(0, k, _CHUNK):
        part = np.ascontiguousarray(motion.coefficients[:, a : a + _CHUNK]).view(np.uint64)
        keys[a : a + _CHUNK] = (part * odd[:, None]).sum(axis=(0, 2), dtype=np.uint64)
    both = keys * np.uint64(3) + np.append(keys[1:], np.uint64(0))
    _, index, inverse = np.unique(both, return_index=True, return_inverse=True)
    first = index[inverse]
    again = np.flatnonzero(first < numbers)
    if not len(again):
        return numbers
    same = np.ones(len(again), bool)
    lengths, rounded = np.diff(motion.knots), _SAME * np.spacing(motion.knots[1:])
    for a in range(0, len(again), _CHUNK):
        own = again[a : a + _CHUNK]
        for one, other in ((own, first[own]), (own + 1, first[own] + 1)):
            one, other = np.minimum(one, k - 1), np.minimum(other, k - 1)
            equal = (motion.coefficients[:, one] == motion.coefficients[:, other]).all(axis=(0, 2))
            same[a : a + _CHUNK] &= equal & (np.abs(lengths[one] - lengths[other]) <= rounded[one])
    first[again[~same]] = again[~same]
    return first


def _cheapest(lengths: Array, longest: list[Array]) -> IntArray:
    """Nodes and panels (n, 2) that cost fewest evaluations; of equals the fewest nodes."""
    panels = np.ceil(lengths / np.array(longest) - _ROUNDED)
    panels = np.maximum(1, panels)
    nodes = np.arange(FEWEST, FEWEST + len(panels))
    best = np.argmin(panels * (nodes - 1)[:, None], axis=0)
    return np.column_stack([nodes[best], panels[best, np.arange(len(lengths))]]).astype(np.int64)


def longest_panels(nodes: int, bounds: tuple[Array, Array]) -> Array:
    """Panels (n,) [s] of so many nodes whose interpolant errs by no more than is allowed.

    `bounds`: as `derivatives`.
    """
    return 2 * _longest(nodes, interpolation_constant(nodes) / INSTANT_ERROR, bounds)


def longest_whole(nodes: int, bounds: tuple[Array, Array]) -> Array:
    """Panels (n,) [s] of so many nodes whose mean errs by no more than is allowed."""
    order = 2 * nodes - 2
    return _longest(order, quadrature_constant(nodes) * factorial(order), bounds)


def _longest(order: int, constant: float, bounds: tuple[Array, Array]) -> Array:
    allowed = zip(bounds, (FORCE_ERROR, RATE_ERROR), strict=True)
    steps = [(e / constant / np.maximum(b[order], _LEAST)) ** (1 / order) for b, e in allowed]
    return np.minimum(*steps)


def derivatives(
    motion: Motion, pieces: IntArray, waves: Waves, order: int = ORDERS
) -> tuple[Array, Array]:
    """Bounds (order + 1, n) of the k-th derivatives, over k!, of force and rate on some pieces.

    Parameters
    ----------
    motion : Motion
    pieces : (n,)
        Numbers of its pieces.
    waves : of (axes, times round, cosine, sine amplitudes [rad])
        What the axes do beyond the motion, as `stand.table.table_errors.TableErrors.waves`.
    order : int
        The highest.
    """
    half = np.diff(motion.knots)[pieces] / 2
    moving = np.flatnonzero(motion.coefficients[:-1, pieces].any(axis=(0, 1)))
    moving = moving if len(moving) else np.array([0])
    size = _sizes(motion, pieces, half)[:, :, moving]
    angle = _series(size.sum(axis=2), half, order + 3)
    for number, axis in enumerate(moving.tolist()):
        own = _series(size[:, :, number], half, order + 3)
        for times, height in _heights(waves, axis).items():
            angle[1:] += height * _exponential(times * own)[1:]
    turned = _exponential(angle[: order + 1])
    outermost = np.argmax(size[1:].any(axis=0), axis=1)
    own = np.take_along_axis(size, outermost[None, :, None], axis=2)[:, :, 0]
    behind = _exponential((angle - _series(own, half, order + 3))[: order + 2])
    spun = _product(_slope(angle), behind)
    # of an arm on a link: its spin sees the axes before it, its way to b those behind
    moved = _slope(spun) + _product(spun, spun)[: order + 1]
    return STANDARD_GRAVITY * turned + REACH * moved, spun[: order + 1] + EARTH_RATE * turned


def _heights(waves: Waves, axis: int) -> dict[int, float]:
    """How high the waves of an axis are [rad], by how often they go round."""
    found: dict[int, float] = {}
    for axes, times, cosine, sine in waves:
        for k in np.flatnonzero(axes == axis):
            own = hypot(cosine[k], sine[k])
            found[int(times[k])] = found.get(int(times[k]), 0.0) + own
    return found


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
