"""Statistics of many runs: what several estimates of one run are worth together.

Estimates of one run share its unit, and are then not independent. How many independent ones the
pooled values are worth is taken from the scatter between runs, so intervals widen by themselves
where biases dominate.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import nan
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import chdtri

from alignment.arrays import Array, IntArray
from alignment.estimate import ANGLE_LIMIT
from alignment.units import DEG

TAIL = 0.025  # of either end of a 95 % interval
FEW = 30  # runs below which their scatter tells too little: they count as one value each
LINEAR = 8 * DEG  # heading sigma above which errors are no longer proportional to noise
FREEDOM = 3  # of one attitude


class EstimateErrors(NamedTuple):
    """One estimate against the truth, as numbers [rad]; NaN where there is none.

    `north`, `east`: the small rotation about N and E that takes truth to estimate, and its
    sigmas; `heading` likewise; `nees` of the whole rotation; floors of white noise.
    `undetermined` is 1 where the heading is not determined: it has no number then, and no `nees`;
    nor has a tilt that is not, about its own axis.
    """

    heading: float = nan
    north: float = nan
    east: float = nan
    heading_sigma: float = nan
    north_sigma: float = nan
    east_sigma: float = nan
    nees: float = nan
    heading_floor: float = nan
    tilt_floor: float = nan
    undetermined: float = 0.0


class Outcome(NamedTuple):
    """One method in one run: its estimates, the seconds it worked, or why it refused.

    `left_out`: stretches that it refused, with the reason, where it answered of others.
    """

    method: str
    seed: int
    found: tuple[EstimateErrors, ...] = ()
    seconds: float = 0.0
    refusal: str = ""
    left_out: tuple[tuple[str, str], ...] = ()


class LeftOut(NamedTuple):
    """A stretch that a method refused in `runs` runs while it answered of others; why at first."""

    stretch: str
    runs: int
    reason: str


@dataclass(frozen=True, slots=True)
class Tally:
    """What became of one method over all runs: root mean squares, mean sigmas and floors [rad].

    `ratio` is rms over floor with its 95 % interval; `nees` the mean over estimates, with the
    interval that a consistent covariance keeps to in 95 of 100 such comparisons. NaN where there
    is nothing to say. `seconds` is the work per run, `estimates` how many were pooled, of which
    `undetermined` have no heading that can stand, and `untilted` of twice as many no tilt: where
    these are most, nothing is said of heading, or tilt, at all. `refused` runs have no answer
    whatever; of the others `left_out` has the stretches that were refused.
    """

    method: str
    runs: int
    estimates: int
    refused: int
    reason: str
    rms_heading: float
    sigma_heading: float
    floor_heading: float
    ratio: float
    ratio_low: float
    ratio_high: float
    rms_tilt: float
    sigma_tilt: float
    floor_tilt: float
    ratio_tilt: float
    ratio_tilt_low: float
    ratio_tilt_high: float
    nees_mean: float
    nees_low: float
    nees_high: float
    seconds: float
    undetermined: int = 0
    untilted: int = 0
    left_out: tuple[LeftOut, ...] = ()

    @property
    def why_undetermined(self) -> str:
        """Why nothing is said of heading; '' where something is."""
        if not _most(self.undetermined, self.estimates):
            return ""
        return self.undetermined_text

    @property
    def undetermined_text(self) -> str:
        """How many estimates have no heading that can stand; '' where all have one."""
        if not self.undetermined:
            return ""
        limit = f"{ANGLE_LIMIT / DEG:.0f} deg"
        return f"sigma above {limit} in {self.undetermined} of {self.estimates} estimates"

    @property
    def why_untilted(self) -> str:
        """Why nothing is said of tilt; '' where something is."""
        if not _most(self.untilted, 2 * self.estimates):
            return ""
        limit = f"{ANGLE_LIMIT / DEG:.0f} deg"
        return f"sigma above {limit} in {self.untilted} of {2 * self.estimates} tilts"

    @property
    def beyond_linear(self) -> bool:
        """Whether heading is so uncertain that floors and sigmas no longer hold."""
        return not self.why_undetermined and (
            self.sigma_heading > LINEAR or self.floor_heading > LINEAR
        )


def tally(method: str, runs: int, outcomes: Sequence[Outcome]) -> Tally:
    """One method's outcomes, one per run, pooled."""
    refusals = [o.refusal for o in outcomes if o.refusal]
    width = len(EstimateErrors._fields)
    table = np.array([f for o in outcomes for f in o.found], dtype=float).reshape(-1, width)
    run = np.repeat(np.arange(len(outcomes)), [len(o.found) for o in outcomes])
    (heading, north, east, heading_sigma, north_sigma, east_sigma, nees, floor, tilt_floor, no) = (
        table.T
    )
    undetermined = int(no.sum())
    if _most(undetermined, len(table)):  # the few others are no sample of it
        heading = heading_sigma = nees = np.full(len(table), nan)
    rms, low, high = rms_interval(heading, run)
    tilts, tilt_sigmas = np.concatenate([north, east]), np.concatenate([north_sigma, east_sigma])
    untilted = int(np.isnan(tilts).sum())
    if _most(untilted, len(tilts)):
        tilts = tilt_sigmas = np.full(len(tilts), nan)
    rms_tilt, tilt_low, tilt_high = rms_interval(tilts, np.tile(run, 2))
    nees_mean, nees_low, nees_high = nees_bounds(nees, run)
    whole, tilt_whole = _root_mean_square(floor), _root_mean_square(tilt_floor)
    ratio, ratio_low, ratio_high = (_over(x, whole) for x in (rms, low, high))
    over = (_over(x, tilt_whole) for x in (rms_tilt, tilt_low, tilt_high))
    ratio_tilt, ratio_tilt_low, ratio_tilt_high = over
    return Tally(
        method=method,
        runs=runs,
        estimates=len(table),
        refused=len(refusals),
        reason=refusals[0] if refusals else "",
        rms_heading=rms,
        sigma_heading=_mean(heading_sigma),
        floor_heading=whole,
        ratio=ratio,
        ratio_low=ratio_low,
        ratio_high=ratio_high,
        rms_tilt=rms_tilt,
        sigma_tilt=_mean(tilt_sigmas),
        floor_tilt=tilt_whole,
        ratio_tilt=ratio_tilt,
        ratio_tilt_low=ratio_tilt_low,
        ratio_tilt_high=ratio_tilt_high,
        nees_mean=nees_mean,
        nees_low=nees_low,
        nees_high=nees_high,
        seconds=sum(o.seconds for o in outcomes) / runs,
        undetermined=undetermined,
        untilted=untilted,
        left_out=_left_out(outcomes),
    )


def _left_out(outcomes: Sequence[Outcome]) -> tuple[LeftOut, ...]:
    """By stretch, in the order of their first refusal."""
    reasons: dict[str, list[str]] = {}
    for outcome in outcomes:
        for stretch, reason in outcome.left_out:
            reasons.setdefault(stretch, []).append(reason)
    return tuple(LeftOut(name, len(own), own[0]) for name, own in reasons.items())


def _most(part: int, whole: int) -> bool:
    return 2 * part > whole


def rms_interval(values: ArrayLike, run: ArrayLike) -> tuple[float, float, float]:
    """Root mean square of `values` (m,), and the 95 % interval of what it estimates.

    `run` (m,) numbers the runs that the values come from; values that are NaN do not count.
    """
    values, run = _counted(values, run)
    if not len(values):
        return nan, nan, nan
    rms = float(np.sqrt(np.mean(values**2)))
    freedom = worth(values**2, run)
    low, high = (rms * float(np.sqrt(freedom / chdtri(freedom, p))) for p in (TAIL, 1 - TAIL))
    return rms, low, high


def nees_bounds(values: ArrayLike, run: ArrayLike) -> tuple[float, float, float]:
    """Mean of normalised squared errors (m,), and the bounds it keeps with 95 % if consistent."""
    values, run = _counted(values, run)
    if not len(values):
        return nan, nan, nan
    freedom = max(worth(values, run, FREEDOM), float(FREEDOM * len(np.unique(run))))
    low, high = (FREEDOM * chdtri(freedom, p) / freedom for p in (1 - TAIL, TAIL))
    return float(np.mean(values)), float(low), float(high)


def worth(squares: Array, run: IntArray, each: int = 1) -> float:
    """Degrees of freedom of the mean of `squares` (m,) that come from runs `run` (m,).

    Each is chi-square with `each` degrees of freedom, times a constant; those of different runs
    are independent. Of a mean M with variance V there are ``2 M^2 / V``; V from the scatter of
    the runs' sums, where there are `FEW` runs or more, each with several values.
    """
    _, run = np.unique(run, return_inverse=True)
    counts = np.bincount(run)
    runs, total = len(counts), len(squares)
    if runs == total or runs < FEW:
        return float(each * runs)
    mean = float(squares.mean())
    apart = np.bincount(run, squares) - mean * counts
    variance = float(apart @ apart) / total**2 * runs / (runs - 1)
    most = float(each * total)
    return most if variance == 0 else min(2 * mean**2 / variance, most)


def _counted(values: ArrayLike, run: ArrayLike) -> tuple[Array, IntArray]:
    values, run = np.asarray(values, dtype=float), np.asarray(run, dtype=np.int64)
    finite = np.isfinite(values)
    return values[finite], run[finite]


def _mean(values: Array) -> float:
    values = values[np.isfinite(values)]
    return float(values.mean()) if len(values) else nan


def _root_mean_square(values: Array) -> float:
    return float(np.sqrt(_mean(values**2)))


def _over(value: float, floor: float) -> float:
    return value / floor if floor > 0 else nan
