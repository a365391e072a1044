"""The search: convex weights and their bound, greedy steps, rounding, pruning, exchange.

Sources: the multiplicative rule of optimal design (Silvey, Titterington, Torsney 1978), with the
weights of several constraints updated by the same rule; exchange after Fedorov (1972).
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from alignment.arrays import Array
from stand.proposal.information import Problem

START = 5.0  # s of each candidate
ROUNDS = 400
FEW_ROUNDS = 150
SHARPER = (2.0, 1.0, 0.5, 0.25)  # s: below which a candidate is made dearer and dearer
NOTHING = 1e-7  # s
GO = 3.5  # s: about what going there costs, before the order is known
SLACK = 1e-9
STEP = 5.0  # s of rest that a greedy step adds
MOST_STEPS = 300
MOST_GROWTH = 64.0
GROWTH = 1.15
LONGER = 1.3  # than the best, before it is pruned
Progress = Callable[[float], None]


@dataclass(frozen=True, slots=True, eq=False)
class Weights:
    """Seconds (n,) of each candidate, and a `bound` [s] below which no test can be."""

    t: Array
    bound: float


def convex(
    problem: Problem, cost: Array | None = None, start: Array | None = None, rounds: int = ROUNDS
) -> Weights:
    """Least ``cost @ t`` that keeps the requirement by white noise alone, moves for nothing.

    Notes
    -----
    For any directions Y (a, k) and weights l, ``e C e >= 2 y e - y (M0 + sum t I) y``: scaled so
    that no candidate is worth more than it costs, the right side bounds the time from below:
    ``(b^2 / n - m) / G`` with b = sum l y e, m = sum l y M0 y, n = sum l, G = max |A y|^2 l / cost.
    """
    E, told = problem.wanted_rows, problem.told
    n, k = len(told), E.shape[1]
    cost = np.ones(n) if cost is None else cost
    t = np.full(n, START) if start is None else start.copy()
    weight, best = np.ones(k), 0.0
    for number in range(rounds):
        B = problem.covariance(t) @ E
        v = np.einsum("ak,ak->k", E, B)
        weight *= np.maximum(v, 1e-12) ** (0.5 if number < rounds // 2 else 0.25)
        worth = np.array([float((np.square(A @ B) @ weight).sum()) for A in told]) / cost
        if number % 10 == 9 or number == rounds - 1:
            b, m, total = float(v @ weight), float(np.square(B).sum(axis=0) @ weight), weight.sum()
            best = max(best, (b**2 / total - m) / worth.max())
        t *= np.sqrt(worth)
        t[t < NOTHING] = 0.0 if number > rounds // 2 else NOTHING
    return Weights(_scaled(problem, t), best)


def _scaled(problem: Problem, t: Array) -> Array:
    """So that the requirement is kept."""
    for _ in range(30):
        v = problem.squares(t).max()
        if v <= 1:
            break
        t = t * max(1.002, v**0.5)
    return t


def kept(problem: Problem, t: Array) -> bool:
    """Whether a test keeps the requirement, with all that makes its readings err."""
    return bool(t.any() and problem.squares(t).max() <= 1 and problem.exact(t).max() <= 1 + SLACK)


def rounded(problem: Problem, t: Array, shortest: float) -> Array:
    """Whole turns, and rests of whole seconds: up."""
    out = np.zeros(len(t))
    for k in np.flatnonzero(t > 0):
        one = problem.candidates[k]
        if one.axis:
            out[k] = min(max(1, np.ceil(t[k] / one.quantum - 0.05)) * one.quantum, one.most)
        else:
            out[k] = min(max(shortest, np.ceil(t[k] - 0.05)), one.most)
    return out


def lengthened(problem: Problem, t: Array, shortest: float) -> Array | None:
    """As much longer as it takes, in whole seconds and turns; None: that does not help."""
    factor = 1.0
    while factor < MOST_GROWTH:
        out = rounded(problem, t * factor, shortest)
        if kept(problem, out):
            return out
        factor *= GROWTH
    return None


def sparse(problem: Problem, weights: Weights, shortest: float) -> Array | None:
    """Few stations from convex weights: those that say little are made dearer; then rounding."""
    t = weights.t
    fixed = GO + problem.overheads
    for eps in SHARPER:
        start = np.maximum(t, 1e-9)
        t = convex(problem, 1 + fixed / (t + eps), start, FEW_ROUNDS).t
    for k in np.argsort(t):
        if 0 < t[k] < 0.5:
            less = t.copy()
            less[k] = 0.0
            if less.any() and problem.squares(rounded(problem, less, shortest)).max() <= 1:
                t = less
    found = lengthened(problem, t, shortest)
    return None if found is None else pruned(problem, found, shortest)


def greedy(problem: Problem, shortest: float) -> Array | None:
    """Always the step that brings the requirement nearest, by its time; None: none helps."""
    n = len(problem.candidates)
    t, here = np.zeros(n), (0.0, 0.0, 0.0)
    steps = np.array([one.quantum or max(STEP, shortest) for one in problem.candidates])
    E = problem.wanted_rows
    for _ in range(MOST_STEPS):
        C = problem.covariance(t)
        V = C @ E
        v = np.einsum("ak,ak->k", E, V)
        off = np.log(np.maximum(v, 1)).sum()
        if off <= SLACK:
            break
        gains = np.zeros(n)
        for k, A in enumerate(problem.told):
            one = problem.candidates[k]
            if t[k] + steps[k] > one.most:
                continue
            seen = A @ V
            inner = np.eye(len(A)) / steps[k] + A @ C @ A.T
            after = v - np.einsum("rk,rk->k", seen, np.linalg.solve(inner, seen))
            more = 0.0 if t[k] else problem.clock.move(here, one.position) + problem.overheads[k]
            gains[k] = (off - np.log(np.maximum(after, 1)).sum()) / (steps[k] + more)
        best = int(np.argmax(gains))
        if gains[best] <= 1e-12:
            return None
        t[best] += steps[best]
        here = problem.candidates[best].position
    found = lengthened(problem, t, shortest)
    return None if found is None else pruned(problem, found, shortest)


def pruned(problem: Problem, t: Array, shortest: float) -> Array:
    """Backward: leave candidates out, then shorten, as long as the requirement is kept."""
    for k in sorted(np.flatnonzero(t > 0), key=lambda k: t[k]):
        less = t.copy()
        less[k] = 0.0
        if kept(problem, less):
            t = less
    for part in (0.5, 0.25, 0.1):
        for k in sorted(np.flatnonzero(t > 0), key=lambda k: -t[k]):
            unit = problem.candidates[k].quantum or 1.0
            least = problem.candidates[k].quantum or shortest
            while True:
                less = t.copy()
                less[k] -= max(1, int(part * t[k] / unit)) * unit
                if less[k] < least - SLACK or not kept(problem, less):
                    break
                t = less
    return t


def exchanged(problem: Problem, t: Array, shortest: float, progress: Progress) -> Array:
    """Each station in turn replaced by another candidate where that makes the test shorter."""
    best = problem.total(t)
    own = np.flatnonzero(t > 0)
    for number, k in enumerate(own):
        progress(number / len(own))
        for i, one in enumerate(problem.candidates):
            if i == k or not t[k]:
                continue
            other = t.copy()
            other[i] += max(t[k], one.quantum or shortest)
            other[k] = 0.0
            other = rounded(problem, other, shortest)
            if problem.total(other) >= LONGER * best or not kept(problem, other):
                continue
            other = pruned(problem, other, shortest)
            if (length := problem.total(other)) < best - 0.1:
                t, best = other, length
    return t
