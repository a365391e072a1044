"""Where a vehicle comes to whose velocity is known: an integral that hardly depends on itself.

By collocation: in every interval the rates are a polynomial through evenly spaced nodes, whose
integral is the place, and the rates follow the place; some rounds of that and nothing changes any
more (Picard). Every sum has one order, so the place has the same bits on every processor, which a
solver that leaves its sums to BLAS has not.
"""

from collections.abc import Callable
from fractions import Fraction
from functools import cache
from itertools import pairwise

import numpy as np
from scipy.interpolate import PPoly

from alignment.arrays import Array
from alignment.fixed_order import product
from stand.errors import StandError

DEGREE = 8  # of the rates in an interval
LONGEST = 0.5  # s
SHORTEST = 1e-3  # s: no manoeuvre needs less
RESOLVED = 1e-11  # m: what an interval may miss of the way
SETTLED = 1e-10  # m: of a round, whose next one is smaller by more than ten
ROUNDS = 60
TOGETHER = 64  # intervals

Velocity = Callable[[Array], Array]
Rates = Callable[[Array, Array, Array], Array]


def integrated(velocity: Velocity, rates: Rates, knots: Array) -> PPoly:
    """The place from zero on, between the first of the `knots` [s] and the last.

    Parameters
    ----------
    velocity : callable
        Velocity (n, 3) at times (n,) [s], smooth between the knots.
    rates : callable
        From times (n,), places (n, 3) and velocities (n, 3) the rates of the place (n, 3) [m/s];
        it refuses where there is no going on.

    Returns
    -------
    PPoly
        Places (n, 3) [m] at times (n,).

    Raises
    ------
    StandError
        It does not settle.
    """
    edges = np.concatenate([[knots[0]], *(_cut(velocity, a, b) for a, b in pairwise(knots))])
    place, found = np.zeros(3), []
    for first in range(0, len(edges) - 1, TOGETHER):
        own = edges[first : first + TOGETHER + 1]
        found.append(_solved(velocity, rates, own, place))
        h = own[-1] - own[-2]
        place = np.polynomial.polynomial.polyval(h, found[-1][::-1, -1])
    return PPoly(np.concatenate(found, axis=1), edges, extrapolate=True)


def _cut(velocity: Velocity, a: float, b: float) -> Array:
    """Ends of intervals within (a, b] so short that a polynomial says the velocity in each."""
    count = int(np.ceil((b - a) / LONGEST))
    while True:
        h = (b - a) / count
        begins = a + h * np.arange(count)
        at, between = (begins[:, None] + h * u for u in (_nodes(), _nodes()[:-1] + 0.5 / DEGREE))
        told = product(_matrices()[2], _at(velocity, at))
        if h < SHORTEST or np.abs(told - _at(velocity, between)).max() * h < RESOLVED:
            return np.append(begins[1:], b)
        count *= 2


def _at(velocity: Velocity, t: Array) -> Array:
    """Velocities (k, n, 3) at times (k, n)."""
    return velocity(t.ravel()).reshape(*t.shape, 3)


def _solved(velocity: Velocity, rates: Rates, edges: Array, place: Array) -> Array:
    """Coefficients (d + 2, k, 3) of the place in k intervals, highest power first."""
    to_powers, to_integrals, _ = _matrices()
    h = np.diff(edges)
    t = edges[:-1, None] + h[:, None] * _nodes()
    v, shape = _at(velocity, t).reshape(-1, 3), (*t.shape, 3)
    x = np.broadcast_to(place, shape)
    for _ in range(ROUNDS):
        slope = rates(t.ravel(), x.reshape(-1, 3), v).reshape(shape)
        moved = h[:, None, None] * product(to_integrals, slope)
        starts = place + np.cumsum(moved[:, -1], axis=0) - moved[:, -1]
        before, x = x, starts[:, None] + moved
        if np.abs(x - before).max() < SETTLED:
            break
    else:
        raise StandError(f"path: no place found after {edges[0]:.3f} s")
    # powers of what changes alone: they cancel one another, so what they carry should be small
    bent = product(to_powers, slope - slope[:, :1])
    bent[:, 0] += slope[:, 0]
    power = np.arange(1, DEGREE + 2)
    bent *= (h[:, None] / (power * h[:, None] ** power))[..., None]
    return np.concatenate([starts[:, None], bent], axis=1)[:, ::-1].swapaxes(0, 1)


def _nodes() -> Array:
    return np.arange(DEGREE + 1) / DEGREE


@cache
def _matrices() -> tuple[Array, Array, Array]:
    """From values at the nodes to powers of u in [0, 1], lowest first; to the integrals from 0 to
    each node; to the values halfway between them. Exact fractions, rounded once.
    """
    nodes = [Fraction(k, DEGREE) for k in range(DEGREE + 1)]
    powers = [_through(nodes, k) for k in range(DEGREE + 1)]  # of each node's own polynomial
    between = [u + Fraction(1, 2 * DEGREE) for u in nodes[:-1]]
    integrals = [
        [sum(c * u ** (k + 1) / (k + 1) for k, c in enumerate(p)) for p in powers] for u in nodes
    ]
    halfway = [[sum(c * u**k for k, c in enumerate(p)) for p in powers] for u in between]
    columns = [list(row) for row in zip(*powers, strict=True)]
    to_powers, to_integrals, to_halfway = (
        np.array([[float(c) for c in row] for row in rows])
        for rows in (columns, integrals, halfway)
    )
    return to_powers, to_integrals, to_halfway


def _through(nodes: list[Fraction], k: int) -> list[Fraction]:
    """Coefficients, lowest first, of the polynomial that is one at node k and else zero."""
    found = [Fraction(1)]
    for j, u in enumerate(nodes):
        if j != k:
            shifted = [Fraction(0), *found]
            found = [s - u * c for s, c in zip(shifted, [*found, Fraction(0)], strict=True)]
            found = [c / (nodes[k] - u) for c in found]
    return found
