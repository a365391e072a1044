"""What sensors feel, as polynomials between a few instants: means and values of any samples.

A panel is a time within which everything is smooth. Of what is seen at its nodes (Lobatto's: both
ends and the extrema of a Legendre polynomial between) there is one polynomial, and the mean of
that over any part of the panel is closed. The mean over a whole one is Lobatto's quadrature:
Simpson's rule of three nodes.

Polynomials are series of Chebyshev's in the place u in a panel, -1 to 1: they round no more than
what they are made of. Products and sums go term by term, without BLAS: a sample is the same number
on every processor and in whatever block it is asked for.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from math import cos, pi

import numpy as np

from alignment.arrays import Array, IntArray
from stand.motion.places import Places

CHUNK = 256  # panels worked out at once: temporary arrays stay in cache
_ROUNDS = 20  # of Newton's iteration from Chebyshev's nodes: 4 of them settle it


class Panels:
    """Panels that meet at the `ends` (p + 1,) [s], with `counts` (p,) nodes each: 3 or more.

    `same` (2, p + 1): where panels begin and end [s] that have the same to show, and where the one
    behind the last begins; None: they themselves.

    Attributes
    ----------
    nodes : (k,) s
        Where to look. Neighbours share what they have in common, the end between them.
    """

    def __init__(self, ends: Array, counts: IntArray, same: Array | None = None) -> None:
        self._ends, self._counts = ends, counts
        self._middle, self._half = (ends[1:] + ends[:-1]) / 2, np.diff(ends) / 2
        self._at = np.concatenate([[0], np.cumsum(counts - 1)])
        self.nodes = np.empty(self._at[-1] + 1)
        begins, stops = (ends, ends[1:]) if same is None else (same[0], same[1, :-1])
        middle, half = (stops + begins[:-1]) / 2, (stops - begins[:-1]) / 2
        self.nodes[self._at] = begins
        for own, rows, places in self._alike():
            self.nodes[rows[:, 1:-1]] = middle[own, None] + half[own, None] * places[1:-1]

    def _alike(self) -> Iterator[tuple[IntArray, IntArray, Array]]:
        """Of m panels with as many nodes: their numbers (m,), nodes (m, n) and places (n,)."""
        for count in np.flatnonzero(np.bincount(self._counts)):
            own = np.flatnonzero(self._counts == count)
            for part in np.array_split(own, -(-len(own) // CHUNK)):
                yield part, self._at[part, None] + np.arange(count), places_of(int(count))

    def curves(self, seen: Array, again: IntArray | None = None) -> "Curves":
        """What is `seen` (c, k) at the nodes, as curves; node i is as that of number `again[i]`.

        What stands still is that number, to the bit.
        """
        series = np.zeros((self._counts.max(), len(seen), len(self._counts)))
        for own, rows, places in self._alike():
            if again is None:
                series[: len(places), :, own] = _series(seen, rows, places)
            else:  # of panels that show the same, which one inner node tells, one is worked out
                rows = again[rows]
                _, first, which = np.unique(rows[:, 1], return_index=True, return_inverse=True)
                series[: len(places), :, own] = _series(seen, rows[first], places)[:, :, which]
        begins = self._at[:-1]
        return Curves(seen[:, begins if again is None else again[begins]], series)

    def cut(self, edges: Array) -> "Cuts":
        """Where samples between the `edges` (n + 1,) [s], within the panels, lie in them."""
        ends = self._ends[(self._ends > edges[0]) & (self._ends < edges[-1])]
        at = np.searchsorted(edges, ends)
        between = edges[at] != ends
        points = np.insert(edges, at[between], ends[between]) if between.any() else edges
        begin = np.searchsorted(points[:-1], self._ends)
        counts = np.diff(begin, prepend=0, append=len(points) - 1)
        panel = np.repeat(np.arange(-1, len(begin)), counts)
        middle, half = self._middle[panel], self._half[panel]
        inside = points[0] != self._ends[panel[0]]
        return Cuts(
            panel,
            _Polynomials(panel[:1], (points[:1] - middle[:1]) / half[:1]) if inside else None,
            _Polynomials(panel, (points[1:] - middle) / half),
            half=half,
            lengths=np.diff(points),
            starts=np.searchsorted(points, edges[:-1]),
        )


@dataclass(frozen=True, slots=True, eq=False)
class Curves:
    """Curves on p panels.

    Attributes
    ----------
    first : (c, p)
        Where they begin.
    series : (n, c, p)
        What they have beyond: coefficients of Chebyshev's polynomials, the lowest first.
    """

    first: Array
    series: Array

    def part(self, which: slice) -> "Curves":
        """Some of them."""
        return Curves(self.first[which], self.series[:, which])


class _Polynomials:
    """Chebyshev's polynomials at places `at` (m,) in the panels of numbers `panel` (m,), which
    never go down.
    """

    def __init__(self, panel: IntArray, at: Array) -> None:
        self._places = Places(panel, at)
        self._count = len(at)
        self._values = np.empty((0, *self._places.table.shape))

    def sums(self, series: Array) -> Array:
        """Values (c, m) of series (n, c, p)."""
        if len(self._values) < len(series):
            self._values = _chebyshev(self._places.table, len(series))
        moving = np.flatnonzero(series.any(axis=(0, 2)))
        terms = self._places.of_pieces(series[:, moving])
        found = _sum(terms, self._values[: len(series)], self._places.rows)
        if len(moving) == series.shape[1]:
            return self._places.flat(found)
        values = np.zeros((series.shape[1], self._count))
        values[moving] = self._places.flat(found)
        return values


def _chebyshev(u: Array, count: int) -> Array:
    """The first so many polynomials (count, *) at places u (*): T_(k+1) = 2 u T_k - T_(k-1)."""
    values = np.empty((count, *u.shape))
    values[0], values[1] = 1.0, u
    twice = 2 * u
    for before, last, following in zip(values, values[1:], values[2:], strict=False):
        np.multiply(twice, last, out=following)
        following -= before
    return values


def _sum(terms: Array, factors: Array, rows: bool) -> Array:
    """Of products of `terms` (n, c, p) and `factors` (n, p, m), or (n, m, p) where not `rows`.

    Notes
    -----
    Along the last axis of the factors, term after term: each product is added to the sum of those
    before it, whatever the sizes. One call, in which other threads go on: half the time of its
    multiplications and additions one by one.
    """
    if not terms.shape[1]:
        return np.empty((0, *factors.shape[1:]))
    return np.einsum("kcp,kpm->cpm" if rows else "kcp,kmp->cmp", terms, factors)


def _series(seen: Array, rows: IntArray, places: Array) -> Array:
    """Of what is `seen` (c, k) at the nodes `rows` (m, n), less the first: (n, c, m)."""
    first, *others = (seen[:, row] for row in rows.T)
    terms = np.zeros((len(places), *first.shape))
    for weights, values in zip(_to_series(len(places))[1:], others, strict=True):
        terms += weights[:, None, None] * (values - first)
    return terms


@dataclass(frozen=True, slots=True, eq=False)
class Cuts:
    """The m parts into which the ends of panels cut n samples.

    Attributes
    ----------
    panel : (m,)
        In which each lies.
    since : (1,) or None
        Where in its panel the first part begins; None: with it.
    high : (m,)
        Where in its panel each part ends.
    half : (m,) s
        Of the panel's length.
    lengths : (m,) s
    starts : (n,)
        The first part of each sample.
    """

    panel: IntArray
    since: _Polynomials | None
    high: _Polynomials
    half: Array
    lengths: Array
    starts: IntArray

    def means(self, curves: Curves) -> Array:
        """Means (c, n) over the samples.

        Notes
        -----
        From the antiderivative of what the curves have beyond their beginnings, which is 0 where
        a panel begins.
        """
        sums = _antiderivative(curves.series)
        until = self.high.sums(sums)
        since = np.zeros_like(until)
        if self.since is not None:
            since[:, :1] = self.since.sums(sums)
        goes_on = self.panel[1:] == self.panel[:-1]
        np.multiply(until[:, :-1], goes_on, out=since[:, 1:])
        until -= since
        number = np.diff(self.starts, append=len(self.panel))
        whole = np.repeat(np.add.reduceat(self.lengths, self.starts), number)
        until *= self.half / whole
        until += np.take(curves.first, self.panel, axis=1) * (self.lengths / whole)
        if len(self.panel) == len(self.starts):
            return until
        return np.add.reduceat(until, self.starts, axis=1)

    def ends(self, curves: Curves) -> Array:
        """Values (c, n) at the samples' ends."""
        found = self.high.sums(curves.series)
        found += np.take(curves.first, self.panel, axis=1)
        if len(self.panel) == len(self.starts):
            return found
        return found[:, np.append(self.starts[1:], len(self.panel)) - 1]


def _antiderivative(series: Array) -> Array:
    """Of series (n, c, p), 0 at -1.

    Notes
    -----
    ``T_k`` is the slope of ``T_(k+1)/(2k+2) - T_(k-1)/(2k-2)``; of the first alone for k = 1, and
    ``T_0`` that of ``T_1``.
    """
    n = len(series)
    sums = np.zeros((n + 1, *series.shape[1:]))
    for k, term in enumerate(series):
        sums[k + 1] += term / (2 * k + 2 if k else 1)
        if k > 1:
            sums[k - 1] -= term / (2 * k - 2)
    for k in range(1, n + 1):
        sums[0] += sums[k] if k % 2 else -sums[k]
    return sums


@cache
def places_of(count: int) -> Array:
    """Lobatto's nodes (count,) from -1 to 1, by Newton's iteration.

    Notes
    -----
    Where ``(1 - x^2) P'`` of the Legendre polynomial P of degree n = count - 1 is 0: that is
    ``n (P_(n-1) - x P_n)``, and its slope ``-n (n + 1) P_n``.
    """
    n = count - 1
    x = np.array([-cos(pi * i / n) for i in range(count)])
    for _ in range(_ROUNDS):
        before, value = np.ones(count), x
        for k in range(2, n + 1):
            before, value = value, ((2 * k - 1) * x * value - (k - 1) * before) / k
        x = x - (x * value - before) / (count * value)
    return (x - x[::-1]) / 2  # even, to the bit


@cache
def _to_series(count: int) -> Array:
    """Row i: coefficients (count,) of Chebyshev's polynomials of what is 1 at node i, 0 at others.

    By the cosine sums over their own nodes, which are exact for polynomials of such a degree.
    """
    places = places_of(count)
    turned = [pi * (j + 0.5) / count for j in range(count)]
    rows = np.zeros((count, count))
    for angle in turned:
        cosines = np.array([cos(k * angle) for k in range(count)])
        apart = cos(angle) - places
        for i, place in enumerate(places):
            others = np.delete(places, i)
            rows[i] += cosines * (np.prod(np.delete(apart, i) / (place - others)) * 2 / count)
    rows[:, 0] /= 2
    return rows
