"""Weights of the five terms from an Allan variance, each with its interval.

Maximum likelihood with non-negative weights. What is compared at each tau is
``3 ((v/mu)^(1/3) - (1 - 2/(9 nu)))``: the cube root of a chi-square variable of nu degrees of
freedom is normal within 1 % (Wilson and Hilferty, 1931), its relative scatter that of v. The
covariance between taus is `covariance`'s for the terms as fitted: the fit is weighted by it.

The interval of a term holds every value at which a fit of the *others* (still non-negative) is
worse than the best by at most `LIMIT`, by likelihood or by residuals alone, whichever is more
lenient, but by no less than half of what the likelihood says: a large walk makes every residual
small beside it. So it is a profile: a term that may be absent starts at zero and a poorly known one
is skewed the right way. LIMIT is 3.84, chi-square's 95 % point: of 6720 intervals of N, of 28
sensors as shipped, it holds 95.7 % (docs/proof-allan.md), where 4.5 held 97.0 %. A walk has
`WALK_LIMIT`, on the way to 5.14, which is right where another term is as likely as not held back by
zero (half chi-square of 1, half of 2: Self and Liang, 1987): few and long taus tell it from terms
that can take its place. Of 750 walks, alone and in sums, it holds 95.2 %, 3.84 held 93.3 %. Too
wide, by what may pose for one another or begin anywhere, are plateaus and ramps: 98 to 100 %.

White noise through a low-pass of any shape, an averaging or a hold has no white increments at lags
within the filter's memory; beyond it the integral's structure function is ``N^2 (u - c)``, with
``c = (1/pi) int (1 - |H|^2)/w^2 dw`` (0.159/bandwidth of first order, 0.113/bandwidth of second
order Butterworth), and that is white noise with a *negative* quantisation, ``Q^2 = -N^2 c/2``, in
variance and covariance alike: ``sigma^2 = N^2/tau (1 - 3c/(2 tau))``. The weight of Q may therefore
be negative in every fit, down to where c is half the shortest averaging time; only a positive one
is quantisation. The fit starts at `MEMORY` / bandwidth where a bandwidth is known, and at
`FORGOTTEN` c, as it is seen, where none is.

A plateau is never flat: sums of Gauss-Markov processes ripple by 2 % of the deviation, so that B^2
is allowed `PLATEAU` at each tau, before its beginning too: nobody knows how it rises. Nor does it
go on to the shortest tau: it is fitted without a beginning and with some (`terms.plateau`);
intervals are those of the likeliest and of the outermost that are nearly as likely. Where the terms
do not describe the curve (p < 0.001), the plateau may begin so late that hardly any of it is seen,
which elsewhere is left to a walk. Where they still do not, up to `MOST_DROPPED` of the shortest
taus are left out, where a filter's memory shows; if that does not help, the least relative model
error common to all taus that explains the misfit is added (Paule and Mandel, 1982).
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import cast

import numpy as np
from scipy.optimize import brentq, nnls
from scipy.special import chdtrc

from alignment.allan.covariance import covariance, pooled
from alignment.allan.deviation import Deviation
from alignment.allan.terms import TERMS, design, index
from alignment.arrays import Array, IntArray

LIMIT = 3.84  # chi-square of a 95 % interval: see above
WALK_LIMIT = 4.5  # the same of a walk
LENIENT = 0.5  # of what the likelihood says, the least that the residuals may say
DESCRIBED = 1e-3  # probability of a misfit below which the terms do not describe the curve
MOST_DROPPED = 8  # octaves
FEWEST_TAUS = 6  # that must remain when some are dropped
PLATEAU = 0.03  # of B^2, at each tau by itself: no real plateau is flat
MOST_EXCESS = 2.0  # relative error of v: a deviation known to a factor of two
LEAST_PLATEAU = 30  # onsets that a plateau must be seen over
LATEST_PLATEAU = 4  # the same, where nothing else describes the curve
LEAST_EIGENVALUE = 1e-3  # of the correlations between taus
SHORTEST = 4  # c is at most half of the shortest averaging time: Q^2 at least -N^2 m/4
MEMORY = 1.1  # periods of the bandwidth after which a low-pass forgets (first order: exp(-7))
FORGOTTEN = 7.0  # c after which it does: first order exp(-7), second 4 % of what it takes
ROUNDING = 1e-6  # least relative error of a variance: a ramp alone would have none
_ROUNDS = 40
_Q, _N, _B, _K = index("Q"), index("N"), index("B"), index("K")
_STARTS = (None, index("R"), index("K"))
_DOUBLINGS = 40
_SETTLED = 1e-3  # of twice the log likelihood


@dataclass(frozen=True, slots=True, eq=False)
class Problem:
    """Variances at some taus (in samples) and what is needed to judge a model of them.

    `T` is `covariance.pooled`'s, `excess` the relative model error of v common to all taus.
    `lowpass` is how far below zero the weight of Q may be, in weights of N: `design`, `T` and
    every weight here are those of (Q + `lowpass` N, N, B, K, R), none of which may be negative.
    """

    design: Array
    variance: Array
    T: Array
    excess: float = 0.0
    lowpass: float = 0.0

    def allowing(self, lowpass: float) -> "Problem":
        """The same with another least weight of Q."""
        mixing = _mixing(self.lowpass - lowpass)
        return replace(self, design=self.design @ mixing, T=_mixed(self.T, mixing), lowpass=lowpass)

    def physical(self, weights: Array) -> Array:
        """The terms' own weights: that of Q may be negative."""
        own = weights.copy()
        own[_Q] -= self.lowpass * own[_N]
        return own

    @property
    def root_slope(self) -> float:
        """Power of mu in the change from v to cube roots; a model error is in cube roots itself."""
        return 0.0 if self.excess > 0 else 1 / 3

    def whiten(self, weights: Array) -> "White":
        """The residuals for `weights` and their derivative, scaled to unit covariance."""
        mu = self.design @ weights
        relative = covariance(self.T, weights)
        relative /= mu[:, None] * mu
        centre = 1 - relative.diagonal() / 9  # 2/(9 nu) with nu = 2 / relative variance
        _on_diagonal(relative)[:] += self.excess**2 + ROUNDING**2
        return White(self, centre, *_whitener(relative))


@dataclass(frozen=True, slots=True, eq=False)
class White:
    """A problem at one covariance: Wilson and Hilferty's mean, what whitens, log determinant."""

    problem: Problem
    centre: Array
    whitener: Array
    log_det: float

    def residuals(self, weights: Array) -> Array:
        """(k,), independent and of unit variance if `weights` are true."""
        ratio = np.cbrt(self.problem.variance / (self.problem.design @ weights))
        return self.whitener @ (3 * (ratio - self.centre))

    def chi2(self, weights: Array) -> float:
        """Sum of squares of the residuals."""
        return float(np.sum(self.residuals(weights) ** 2))

    def cost(self, weights: Array) -> float:
        """Minus twice the log likelihood but for a constant, if this is the weights' covariance."""
        mu = self.problem.design @ weights
        log_slopes = self.problem.root_slope * float(np.sum(np.log(mu)))
        return self.chi2(weights) + self.log_det + 2 * log_slopes

    def scoring_step(self, weights: Array, free: IntArray) -> Array:
        """The step (5,) to the non-negative optimum of the likelihood's quadratic model."""
        gradient, information = self.score(weights, free)
        root = np.linalg.cholesky(information)
        step = np.zeros(len(weights))
        target = root.T @ weights[free] + np.linalg.solve(root, gradient)
        step[free] = _nnls(root.T, target) - weights[free]
        return step

    def score(self, weights: Array, free: IntArray) -> tuple[Array, Array]:
        """Gradient of the log likelihood and its Fisher information, for the free weights."""
        mu = self.problem.design @ weights
        slope = self.problem.design[:, free] / mu[:, None]
        ratio = np.cbrt(self.problem.variance / mu)
        residuals = self.whitener @ (3 * (ratio - self.centre))
        J = self.whitener @ (ratio[:, None] * slope)
        T, squares = self.problem.T, mu[:, None] * mu
        relative = covariance(T, weights) / squares
        rows = (weights @ T.reshape(*T.shape[:2], -1))[free].reshape(-1, *T.shape[2:])
        rows *= 2 / squares
        rows -= relative * (slope.T[:, :, None] + slope.T[:, None, :])
        S = self.whitener @ rows @ self.whitener.T
        gradient = J.T @ residuals - self.problem.root_slope * slope.sum(axis=0)
        gradient += (np.einsum("pij,i,j->p", S, residuals, residuals) - np.einsum("pii->p", S)) / 2
        information = J.T @ J + np.einsum("pij,qij->pq", S, S) / 2
        # A trace keeps terms that the curve cannot tell apart from making it singular.
        _on_diagonal(information)[:] *= 1 + 1e-9
        return gradient, information


@dataclass(frozen=True, slots=True, eq=False)
class Rival:
    """Another beginning of the plateau, nearly as likely: `worse` is twice the log ratio.

    One that is `late` has a say in N alone.
    """

    problem: Problem
    weights: Array
    worse: float
    late: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """Weights (5,) as in `terms`, the problem they solve, and how well.

    `solution` is in the problem's own weights, `weights` in the terms': below zero, that of Q is
    what a low-pass took. `first` is the first tau used, `onset` where the plateau begins [samples;
    0: nowhere], `chi2` the misfit before any `problem.excess` was allowed and `freedom` what it
    should be.
    """

    solution: Array
    problem: Problem
    first: int
    onset: float
    chi2: float
    freedom: int
    rivals: tuple[Rival, ...] = ()

    @property
    def weights(self) -> Array:
        """In the order of `terms.KEYS`."""
        return self.problem.physical(self.solution)


def _on_diagonal(matrix: Array) -> Array:
    """The diagonal, to be changed in place: of matrices this small looking for it takes longest."""
    return matrix.reshape(-1)[:: len(matrix) + 1]


def _whitener(relative: Array) -> tuple[Array, float]:
    """W (k, k) with ``W C W' = 1`` and log det C; correlations are kept from being singular.

    Noise alone has eigenvalues above 0.007. Long taus of a ramp share one error, the noise of its
    slope: what they differ by is known less well than the table is exact.
    """
    sigma = np.sqrt(relative.diagonal())
    values, vectors = np.linalg.eigh(relative / (sigma[:, None] * sigma))
    values = np.maximum(values, LEAST_EIGENVALUE)
    log_det = float(np.sum(np.log(values)) + 2 * np.sum(np.log(sigma)))
    return (vectors / np.sqrt(values)).T / sigma, log_det


def fit(curve: Deviation, bandwidth: float = math.inf) -> Fit:
    """The weights that describe the curve, which must not be silent; `bandwidth` [Hz] if known."""
    most = max(0, len(curve.m) - FEWEST_TAUS)
    start = min(most, int(np.searchsorted(curve.tau, MEMORY / bandwidth)))
    whole = _fit(curve, start)
    # selection by the curve itself costs certainty: only where nobody knows
    while bandwidth == math.inf and start < most and FORGOTTEN * _smoothing(whole) > curve.m[start]:
        start += 1
        whole = _fit(curve, start)
    if _described(whole):
        return whole
    late = _fit(curve, start, LATEST_PLATEAU)
    if _described(late):
        return late
    for first in range(start + 1, min(start + MOST_DROPPED, most) + 1):
        for onset in {0.0, whole.onset}:
            if _described(_fit_with(curve, first, onset)):
                return _fit(curve, first)
    return _with_excess(whole)


def _smoothing(found: Fit) -> float:
    """c of a low-pass [samples], from what it takes."""
    return 2 * max(0.0, -found.weights[_Q]) / max(found.weights[_N], 1e-300)


def problem(curve: Deviation, first: int = 0, onset: float = 0.0) -> Problem:
    """The problem of a curve from its tau number `first` on; `onset` [samples] of its plateau."""
    m = tuple(int(k) for k in curve.m)
    lowpass = m[first] / SHORTEST
    columns, mixing = design(curve.m[first:], onset), _mixing(-lowpass)
    T = _risen(pooled(curve.lengths, m)[:, :, first:, first:], columns[:, _B])
    _on_diagonal(T[_B, _B])[:] += PLATEAU**2
    return Problem(columns @ mixing, curve.variance[first:], _mixed(T, mixing), lowpass=lowpass)


def _risen(T: Array, heights: Array) -> Array:
    """Covariances of a plateau that is so high (k,) at each tau: its signal by the root of that."""
    both = np.sqrt(heights[:, None] * heights)
    T = T.copy()
    T[_B] *= both
    T[:, _B] *= both
    return T


def _mixing(lowpass: float) -> Array:
    """From weights (5,) to those whose Q may be less by so many of N."""
    mixing = np.eye(len(TERMS))
    mixing[_Q, _N] = lowpass
    return mixing


def _mixed(T: Array, mixing: Array) -> Array:
    return np.einsum("pa,qb,pqij->abij", mixing, mixing, T)


def _fit(curve: Deviation, first: int, least: int = LEAST_PLATEAU) -> Fit:
    """The likeliest of the fits with the plateau beginning somewhere or nowhere."""
    flat = _fit_with(curve, first, 0.0)
    onsets = _onsets(curve, least)
    found = [flat, *(_fit_with(curve, first, onset, flat.solution) for onset in onsets)]
    best = min(found, key=_cost)
    if not best.solution[_B] > 0:
        return best
    for part in (1, 0.5, 0.25) if best.onset > 0 else ():
        beside = (best.onset * 2**k for k in (-part, part))
        found += [_fit_with(curve, first, onset, best.solution) for onset in beside]
        best = min(found, key=_cost)
    found.sort(key=lambda one: one.onset)
    worse = [_cost(one) - _cost(best) for one in found]
    near = [k for k, one in enumerate(found) if worse[k] < WALK_LIMIT and one is not best]
    outer = sorted({near[0], near[-1]}) if near else []
    rivals = [Rival(found[k].problem, found[k].solution, worse[k]) for k in outer]
    return replace(best, rivals=(*rivals, *_late(curve, first, least, best)))


def _fit_with(curve: Deviation, first: int, onset: float, near: Array | None = None) -> Fit:
    posed = problem(curve, first, onset)
    weights = solve(posed, near=near)
    freedom = len(posed.variance) - int(np.count_nonzero(weights)) - (onset > 0)
    return Fit(
        weights, posed, first, onset, chi2=posed.whiten(weights).chi2(weights), freedom=freedom
    )


def _cost(found: Fit) -> float:
    return found.problem.whiten(found.solution).cost(found.solution)


def _onsets(curve: Deviation, least: int) -> list[float]:
    """Beginnings of a plateau [samples] to try first, two octaves apart, that leave some of it."""
    return [float(m) for m in curve.m[::2] if least * m <= curve.m[-1]]


def _late(curve: Deviation, first: int, least: int, best: Fit) -> list[Rival]:
    """Fits nearly as likely whose plateau begins so late that hardly any of it is seen.

    Only N is asked of them, and where white noise is most of the shortest tau: a plateau that must
    begin early takes a part of it, 0.3 % of N in six minutes of a unit whose plateau begins at 9 s.
    """
    white = best.weights[_N] / float(curve.m[best.first])
    if white < 0.5 * best.problem.variance[0]:
        return []
    latest = float(curve.m[-1]) / LATEST_PLATEAU
    onsets = [onset for onset in (latest / 8, latest / 2) if least * onset > curve.m[-1]]
    found = [_fit_with(curve, first, onset, best.solution) for onset in onsets]
    worse = [max(0.0, _cost(one) - _cost(best)) for one in found]
    return [
        Rival(one.problem, one.solution, by, late=True)
        for one, by in zip(found, worse, strict=True)
        if by < LIMIT
    ]


def _described(found: Fit) -> bool:
    return found.freedom <= 0 or chdtrc(found.freedom, found.chi2) >= DESCRIBED


def _with_excess(found: Fit) -> Fit:
    """The same with the model error that makes chi-square what it should be."""

    def solved(log_excess: float) -> tuple[Problem, Array]:
        posed = replace(found.problem, excess=math.exp(log_excess))
        return posed, solve(posed)

    def over(log_excess: float) -> float:
        posed, weights = solved(log_excess)
        return math.log(posed.whiten(weights).chi2(weights) / found.freedom)

    low, high = math.log(1e-4), math.log(MOST_EXCESS)
    at = low if over(low) <= 0 else high if over(high) >= 0 else _crossing(over, low, high, 1e-2)
    posed, weights = solved(at)
    return replace(found, problem=posed, solution=weights)


def solve(
    posed: Problem, fixed: int | None = None, at: float = 0.0, near: Array | None = None
) -> Array:
    """The likeliest non-negative weights (5,); one may be held `at` a value.

    A walk and a ramp look alike at the few longest taus, so there can be several optima: with and
    without either is tried, or a solution `near`, and the likeliest is taken.
    """
    return _solved(posed, fixed, at, near)[0]


Solved = tuple[Array, "White", float]  # weights, the problem at their covariance, their cost there


def _solved(
    posed: Problem, fixed: int | None = None, at: float = 0.0, near: Array | None = None
) -> Solved:
    """As `solve`."""
    free = np.array([k for k in range(len(TERMS)) if k != fixed])
    ways = _STARTS if near is None else (None,)
    starts = [_start(posed, free, without, fixed, at) for without in ways]
    if near is not None:
        held = near.copy()
        if fixed is not None:
            held[fixed] = at
        starts.append(_positive(posed, held, free))
    found: list[Array] = []
    for start in starts:
        if all(np.any(np.abs(start - other) > 1e-3 * other) for other in found):
            found.append(start)
    return min((_iterated(posed, w, free) for w in found), key=lambda one: one[2])


def _start(
    posed: Problem, free: IntArray, without: int | None, fixed: int | None, at: float
) -> Array:
    """Relative least squares: every tau counts alike."""
    weights = np.zeros(len(TERMS))
    rest = np.ones(len(posed.variance))
    if fixed is not None:
        weights[fixed] = at
        rest = rest - at * posed.design[:, fixed] / posed.variance
    tried = free[free != without]
    weights[tried] = _nnls(posed.design[:, tried] / posed.variance[:, None], rest)
    return _positive(posed, weights, free)


def _positive(posed: Problem, weights: Array, free: IntArray) -> Array:
    """Never all zero: the free terms are given a trace, far below the variance there is."""
    if np.any(weights > 0):
        return weights
    weights = weights.copy()
    weights[free] = 1e-6 * np.min(posed.variance[:, None] / posed.design[:, free], axis=0)
    return weights


def _iterated(posed: Problem, weights: Array, free: IntArray) -> Solved:
    """Fisher scoring on the likelihood, no weight below zero, every step an improvement."""
    white = posed.whiten(weights)
    cost = white.cost(weights)
    for _ in range(_ROUNDS):
        step = white.scoring_step(weights, free)
        part, moved = 1.0, weights
        while part > 1e-3:
            moved = _positive(posed, weights + part * step, free)
            white_there = posed.whiten(moved)
            cost_there = white_there.cost(moved)
            if cost_there <= cost:
                break
            part /= 3
        else:
            break
        gained = cost - cost_there
        weights, white, cost = moved, white_there, cost_there
        if gained < _SETTLED:
            break
    return weights, white, cost


def against(fitted: Fit, term: int, at: float) -> float:
    """How much worse the curve is described with a term `at` a weight: chi-square of 1 if true."""
    near = (r for r in fitted.rivals if term == _N or not r.late)
    rivals = (r.worse + worse_with(r.problem, r.weights, term, at) for r in near)
    return min(worse_with(fitted.problem, fitted.solution, term, at), *rivals, np.inf)


def evidence(fitted: Fit, term: int) -> float:
    """How much worse the curve is described without a term: chi-square of 1 if there is none."""
    return against(fitted, term, 0.0)


def interval(fitted: Fit, term: int) -> tuple[float, float]:
    """The 95 % interval of a term's weight; the lower end is 0 where it may be absent."""
    limit = WALK_LIMIT if term == _K else LIMIT
    ends = [_interval(fitted.problem, fitted.solution, term, limit)]
    near = (r for r in fitted.rivals if r.worse < limit and (term == _N or not r.late))
    ends += [_interval(r.problem, r.weights, term, limit - r.worse) for r in near]
    return min(low for low, _ in ends), max(high for _, high in ends)


def holding(posed: Problem, best: Array, term: int) -> tuple[Problem, Array]:
    """The problem whose weight of a term is the term's own, and `best` in its weights.

    Only Q has another weight, where a low-pass is allowed; there `best` may have a negative one.
    """
    if term != _Q:
        return posed, best
    return posed.allowing(0.0), posed.physical(best)


def worse_with(posed: Problem, best: Array, term: int, at: float) -> float:
    """How much worse a fit is with a term held `at` a weight: chi-square of 1 if that is true."""
    return _worse(*holding(posed, best, term), term)(at)


def _worse(asked: Problem, own: Array, term: int) -> Callable[[float], float]:
    """The same as a function of the weight, of what `holding` says."""
    near, least = np.maximum(own, 0.0), asked.whiten(own).cost(own)

    def worse(at: float) -> float:
        held, white, cost = _solved(asked, term, at, near)
        likelihood = cost - least
        residuals = white.chi2(held) - white.chi2(own)
        return min(likelihood, max(residuals, LENIENT * likelihood))

    return worse


def _interval(posed: Problem, best: Array, term: int, limit: float) -> tuple[float, float]:
    asked, own = holding(posed, best, term)
    peak = float(np.cbrt(max(own[term], 0.0)))
    worse = _worse(asked, own, term)

    def beyond(cube_root: float) -> float:
        return math.sqrt(max(worse(cube_root**3), 0.0)) - math.sqrt(limit)

    if peak == 0.0 and beyond(0.0) > 0:  # a low-pass for certain, no quantisation
        return 0.0, 0.0
    width = _guess(asked, own, term)
    high = _edge(beyond, peak, width)
    return _edge(beyond, peak, -width) ** 3 if peak > 0 else 0.0, high**3


def _guess(posed: Problem, best: Array, term: int) -> float:
    """About how far the interval's ends are from the best weight, as cube roots."""
    _, information = posed.whiten(best).score(best, np.arange(len(best)))
    scale = 1 / np.sqrt(np.diag(information))
    unit = information * np.outer(scale, scale) + 1e-6 * np.eye(len(best))
    sigma = scale[term] * np.sqrt(np.linalg.inv(unit)[term, term])
    least = max(best[term], 0.0)
    return float(np.cbrt(least + np.sqrt(LIMIT) * sigma) - np.cbrt(least))


def _edge(beyond: Callable[[float], float], peak: float, width: float) -> float:
    """Where `beyond` turns positive on the way from `peak`; not below zero."""
    inner, outer = peak, max(0.0, peak + width)
    for _ in range(_DOUBLINGS):
        if beyond(outer) > 0:
            # A hundredth of the way is a hundredth of the interval's half width.
            return _crossing(beyond, inner, outer, 0.01 * abs(outer - inner))
        if outer == 0.0:
            return 0.0
        inner, width = outer, 2 * width
        outer = max(0.0, outer + width)
    return float("inf")


def _crossing(function: Callable[[float], float], a: float, b: float, within: float) -> float:
    return float(cast(float, brentq(function, a, b, xtol=within)))


def _nnls(matrix: Array, rest: Array) -> Array:
    scale = np.linalg.norm(matrix, axis=0)
    return nnls(matrix / scale, rest)[0] / scale
