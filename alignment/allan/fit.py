"""Weights of the five terms from an Allan variance, each with its interval.

Generalised least squares with non-negative weights. What is compared at each tau is
``3 ((v/mu)^(1/3) - (1 - 2/(9 nu)))``: the cube root of a chi-square variable of nu degrees of
freedom is normal within 1 % (Wilson and Hilferty, 1931), its relative scatter that of v. The
covariance between taus is `covariance`'s for the terms as fitted, iterated.

The interval of a term holds every value at which a fit of the *others* (still non-negative, weighted
as if that value were true) is worse than the best by no more than chi-square's 95 % point: a
profile, so that a term that may be absent starts at zero and a poorly known one is skewed the right
way. Where the five terms do not describe the curve (p < 0.001), up to `MOST_DROPPED` of the
shortest taus are left out, where a sensor's bandwidth shows; if that does not help, the least
relative model error common to all taus that explains the misfit is added (Paule and Mandel, 1982).
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import brentq, nnls
from scipy.special import chdtrc, chdtri

from alignment.allan.covariance import covariance, table
from alignment.allan.deviation import Deviation
from alignment.allan.terms import TERMS, design
from alignment.arrays import Array

CHI2_95 = float(chdtri(1, 0.05))  # 3.841
DESCRIBED = 1e-3  # probability of a misfit below which the terms do not describe the curve
MOST_DROPPED = 5  # octaves
FEWEST_TAUS = 6  # that must remain when some are dropped
LEAST_EIGENVALUE = 1e-3  # of the correlations between taus
ROUNDING = 1e-6  # least relative error of a variance: a ramp alone would have none
_ROUNDS = 40
_SETTLED = 1e-3  # standard deviations


@dataclass(frozen=True, slots=True, eq=False)
class Problem:
    """Variances at some taus (in samples) and what is needed to judge a model of them.

    `T` is `covariance.table`'s, `excess` the relative model error of v common to all taus.
    """

    design: Array
    variance: Array
    T: Array
    excess: float = 0.0

    def whiten(self, weights: Array) -> "White":
        """The residuals for `weights` and their derivative, scaled to unit covariance."""
        mu = self.design @ weights
        relative = covariance(self.T, weights) / np.outer(mu, mu)
        relative[np.diag_indices_from(relative)] += self.excess**2 + ROUNDING**2
        centre = 1 - np.diag(relative) / 9  # 2/(9 nu) with nu = 2 / relative variance
        return White(self, centre, _whitener(relative))


@dataclass(frozen=True, slots=True, eq=False)
class White:
    """A problem at one covariance: Wilson and Hilferty's mean, and what whitens (k, k)."""

    problem: Problem
    centre: Array
    whitener: Array

    def residuals(self, weights: Array) -> Array:
        """(k,), independent and of unit variance if `weights` are true."""
        ratio = np.cbrt(self.problem.variance / (self.problem.design @ weights))
        return self.whitener @ (3 * (ratio - self.centre))

    def chi2(self, weights: Array) -> float:
        """Sum of squares of the residuals."""
        return float(np.sum(self.residuals(weights) ** 2))

    def jacobian(self, weights: Array) -> Array:
        """Minus the derivative (k, 5) of the residuals."""
        mu = self.problem.design @ weights
        ratio = np.cbrt(self.problem.variance / mu)
        return self.whitener @ ((ratio / mu)[:, None] * self.problem.design)


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """Weights (5,) as in `terms`, the problem they solve, and how well.

    `first` is the first tau used, `chi2` the misfit before any `problem.excess` was allowed and
    `freedom` what it should be.
    """

    weights: Array
    problem: Problem
    first: int
    chi2: float
    freedom: int


def _whitener(relative: Array) -> Array:
    """W (k, k) with ``W C W' = 1``; correlations are kept from being singular.

    Noise alone has eigenvalues above 0.007. Long taus of a ramp share one error, the noise of its
    slope: what they differ by is known less well than the table is exact.
    """
    sigma = np.sqrt(np.diag(relative))
    values, vectors = np.linalg.eigh(relative / np.outer(sigma, sigma))
    return (vectors / np.sqrt(np.maximum(values, LEAST_EIGENVALUE))).T / sigma


def fit(curve: Deviation) -> Fit:
    """The non-negative weights that describe the curve; it must not be silent."""
    whole = _fit(curve, 0)
    if _described(whole):
        return whole
    for first in range(1, min(MOST_DROPPED, len(curve.m) - FEWEST_TAUS) + 1):
        part = _fit(curve, first)
        if _described(part):
            return part
    return _with_excess(whole)


def problem(curve: Deviation, first: int = 0) -> Problem:
    """The problem of a curve from its tau number `first` on."""
    m = tuple(int(k) for k in curve.m)
    T = table(curve.n, m)[:, :, first:, first:]
    return Problem(design(curve.m[first:]), curve.variance[first:], T)


def _fit(curve: Deviation, first: int) -> Fit:
    posed = problem(curve, first)
    weights = solve(posed)
    freedom = len(posed.variance) - int(np.count_nonzero(weights))
    return Fit(weights, posed, first, posed.whiten(weights).chi2(weights), freedom)


def _described(found: Fit) -> bool:
    return found.freedom <= 0 or chdtrc(found.freedom, found.chi2) >= DESCRIBED


def _with_excess(found: Fit) -> Fit:
    """The same with the model error that makes chi-square what it should be."""

    def solved(log_excess: float) -> tuple[Problem, Array]:
        posed = replace(found.problem, excess=float(np.exp(log_excess)))
        return posed, solve(posed)

    def over(log_excess: float) -> float:
        posed, weights = solved(log_excess)
        return np.log(posed.whiten(weights).chi2(weights) / found.freedom)

    low, high = np.log(1e-5), np.log(10.0)
    at = low if over(low) <= 0 else high if over(high) >= 0 else brentq(over, low, high, rtol=1e-3)
    posed, weights = solved(float(at))
    return replace(found, problem=posed, weights=weights)


def solve(posed: Problem, fixed: int | None = None, at: float = 0.0) -> Array:
    """Non-negative weights (5,), the covariance iterated with them; one may be held `at` a value."""
    free = np.array([k for k in range(len(TERMS)) if k != fixed])
    weights = _start(posed, free, fixed, at)
    for _ in range(_ROUNDS):
        white = posed.whiten(weights)
        J = white.jacobian(weights)
        moved = _step(white, weights, free, J)
        step = float(np.linalg.norm(J @ (moved - weights)))
        weights = moved
        if step < _SETTLED:
            break
    return weights


def _start(posed: Problem, free: Array, fixed: int | None, at: float) -> Array:
    """Relative least squares: every tau counts alike."""
    weights = np.zeros(len(TERMS))
    rest = np.ones(len(posed.variance))
    if fixed is not None:
        weights[fixed] = at
        rest = rest - at * posed.design[:, fixed] / posed.variance
    weights[free] = _nnls(posed.design[:, free] / posed.variance[:, None], rest)
    return _positive(posed, weights, free)


def _positive(posed: Problem, weights: Array, free: Array) -> Array:
    """Never all zero: some free term is given a trace, far below the variance there is."""
    if np.any(weights > 0):
        return weights
    weights = weights.copy()
    weights[free] = 1e-6 * np.min(posed.variance[:, None] / posed.design[:, free], axis=0)
    return weights


def _step(white: White, weights: Array, free: Array, jacobian: Array) -> Array:
    """One Gauss-Newton step on the free weights, no mean variance changing more than fivefold."""
    J = jacobian[:, free]
    moved = weights.copy()
    moved[free] = _nnls(J, white.residuals(weights) + J @ weights[free])
    moved = _positive(white.problem, moved, free)
    ratio = (white.problem.design @ moved) / (white.problem.design @ weights)
    part = min(1.0, 4.0 / max(ratio.max() - 1, 1e-300), 0.8 / max(1 - ratio.min(), 1e-300))
    return weights + part * (moved - weights)


def _nnls(matrix: Array, rest: Array) -> Array:
    scale = np.linalg.norm(matrix, axis=0)
    return nnls(matrix / scale, rest)[0] / scale


def evidence(posed: Problem, best: Array, term: int, at: float) -> float:
    """How much worse the fit is with a term held `at` a weight: chi-square of 1 if that is true."""
    held = solve(posed, term, at)
    white = posed.whiten(held)
    return max(0.0, white.chi2(held) - white.chi2(best))


def interval(posed: Problem, best: Array, term: int) -> tuple[float, float]:
    """The 95 % interval of a term's weight; the lower end is 0 where it may be absent."""
    peak = float(best[term])

    def excess(cube_root: float) -> float:
        return np.sqrt(evidence(posed, best, term, cube_root**3)) - np.sqrt(CHI2_95)

    scale = float(np.min(posed.variance / posed.design[:, term]))
    start = np.cbrt(peak if peak > 0 else 1e-3 * scale)
    high = start
    while excess(high := 1.3 * high) < 0:
        if high**3 > 1e6 * max(scale, peak):
            return 0.0, float("inf")
    upper = _crossing(excess, start if peak > 0 else 0.0, high) ** 3
    lower = _crossing(excess, 0.0, start) ** 3 if peak > 0 and excess(0.0) > 0 else 0.0
    return lower, upper


def _crossing(function: Callable[[float], float], a: float, b: float) -> float:
    if function(a) * function(b) > 0:
        return b
    return float(brentq(function, a, b, rtol=2e-4, xtol=1e-12 * b))
