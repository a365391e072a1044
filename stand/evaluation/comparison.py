"""Methods side by side: many runs of one procedure, every method on the same readings.

Each run has its own seed: its unit, its table and its sway are drawn anew. Errors are set against
the sigma each method predicts and against the floor that white noise puts under any method.
"""

import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass
from functools import partial
from math import nan
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from alignment import ESTIMATORS, AttitudeEstimate, Dwell, Site
from alignment.against_truth import heading_errors, rotation_error
from alignment.earth import EARTH_RATE
from alignment.estimate import determined
from alignment.units import DEG
from stand.errors import StandError
from stand.evaluation.runs import truths_by_label
from stand.evaluation.score import Truths, answered, circular
from stand.evaluation.statistics import EstimateErrors, Outcome, Tally, tally
from stand.imu import ImuSpec, unstated
from stand.imu.priors import noise_alone
from stand.motion.plan import Plan
from stand.simulation.journal import Journal
from stand.simulation.monte_carlo import Trials
from stand.simulation.parallel import campaign
from stand.simulation.settings import Settings, options_for
from stand.simulation.work import Engine

Progress = Callable[[float], None]


@dataclass(frozen=True, slots=True)
class Comparison:
    """All methods over all runs, each method's outcomes in the order of the runs' seeds."""

    settings: Settings
    runs: int
    tallies: tuple[Tally, ...]


def applicable(plan: Plan) -> tuple[str, ...]:
    """The methods for which a plan has stretches, in the order of the list of methods.

    A method that is for rest is named on a rocking base too: its refusal is part of the answer.
    """
    turning = [s.turning is not None for s in plan.stretches]
    there = {"any": bool(turning), "turning": any(turning), "rest": not all(turning)}
    there["standing"] = there["rest"]
    return tuple(name for name, method in ESTIMATORS.items() if there.get(method.takes, False))


def compare(
    settings: Settings,
    runs: int,
    progress: Progress = lambda done: None,
    workers: int | None = None,
    engine: Engine | None = None,
    keep: Path | None = None,
) -> Comparison:
    """Simulate `runs` runs from the settings' seed on, and estimate by every method.

    Parameters
    ----------
    settings : Settings
        Of the first run; the others differ in their seed. Without `methods` of its own those
        `applicable` are compared.
    runs : int
    progress : callable
        Told the part done, 0 to 1.
    workers : int, optional
        Processes, which change nothing but the time; if not given, as many as there are cores
        and as pay.
    engine : callable, optional
        Who makes the runs, instead of processes of this machine.
    keep : Path, optional
        File for the runs; those that it holds are not made again.

    Raises
    ------
    StandError
        A setting that is impossible, a run that failed.
    """
    if runs < 1:
        raise StandError(f"runs = {runs}: must be 1 or more")
    bench = _Bench(settings)  # refuses what is impossible, before any process
    outcomes: list[list[Outcome]] = []
    with ExitStack() as stack:
        journal = None
        if keep is not None:
            what = f"compare {', '.join(bench.methods)}"
            journal = stack.enter_context(Journal(keep, what, settings).adding())
            outcomes += [[_from_json(one) for one in run] for run in journal.runs[:runs]]
        ready, last = partial(_ready, settings), settings.seed + runs
        seeds = range(settings.seed + len(outcomes), last)
        made = campaign(ready, seeds, workers, bench.trial, engine)
        for found in stack.enter_context(closing(made)):
            outcomes.append(found)
            if journal is not None:
                journal.add(found)
            progress(len(outcomes) / runs)
    by_method = zip(bench.methods, zip(*outcomes, strict=True), strict=True)
    return Comparison(settings, runs, tuple(tally(m, runs, own) for m, own in by_method))


def _from_json(one: list[Any]) -> Outcome:
    """An outcome as a journal has it: named tuples are lists there."""
    method, seed, found, seconds, refusal, left_out = one
    return Outcome(
        method=method,
        seed=seed,
        found=tuple(EstimateErrors(*numbers) for numbers in found),
        seconds=seconds,
        refusal=refusal,
        left_out=tuple((stretch, reason) for stretch, reason in left_out),
    )


def _ready(settings: Settings) -> Callable[[int], list[Outcome]]:
    return _Bench(settings).trial


class _Bench:
    """Runs of one setting, and what all methods make of each."""

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self.trials = Trials(settings)
        self.methods = settings.methods or applicable(self.trials.plan)
        if not self.trials.plan.stretches or not self.methods:
            raise StandError(f"{settings.procedure.name}: nothing to estimate from: no dwell, rate")
        self._options = options_for(settings, self.methods)
        if any(ESTIMATORS[method].follows_moves for method in self.methods):
            self.trials.keep_moves()
        self._imu = settings.unit

    def trial(self, seed: int) -> list[Outcome]:
        """All methods on the readings of one run."""
        dwells, attitudes = self.trials.readings(seed)
        truths = truths_by_label(dwells, attitudes)
        return [self._outcome(method, seed, dwells, truths) for method in self.methods]

    def _outcome(
        self, method: str, seed: int, dwells: Sequence[Dwell], truths: Mapping[str, Truths]
    ) -> Outcome:
        site = self.settings.site
        begin = time.perf_counter()
        estimates, refused = answered(method, dwells, site, self._options)
        seconds = time.perf_counter() - begin
        if not estimates and refused:
            return Outcome(method=method, seed=seed, seconds=seconds, refusal=refused[0].reason)
        silent = {r.stretch for r in refused}
        own = [d for d in dwells if ESTIMATORS[method].suited(d) and d.label not in silent]
        found = tuple(
            against_truth(e, truth, floors(e, truth, own, site, self._imu))
            for e in estimates
            if e.C_nb is not None and e.label in truths and not circular(e)
            if (truth := truths[e.label].of(method)) is not None
        )
        return Outcome(
            method=method,
            seed=seed,
            found=found,
            seconds=seconds,
            left_out=tuple((r.stretch, r.reason) for r in refused),
        )


def against_truth(
    e: AttitudeEstimate, truth: Rotation, floor: tuple[float, float]
) -> EstimateErrors:
    """An estimate's errors beside its own sigmas and the floors of heading and tilt [rad]."""
    assert e.C_nb is not None
    error, off = rotation_error(e.C_nb, truth), float(heading_errors(e.C_nb, truth))
    undetermined = not {"heading", "yaw"}.isdisjoint(e.undetermined)
    tilts, sigmas, nees = error[:2], np.full(2, nan), nan
    if e.covariance is not None:
        sigmas = np.sqrt(e.covariance.diagonal()[:2])
        tilts, sigmas = (np.where(determined(sigmas), x, nan) for x in (tilts, sigmas))
        whole = np.linalg.matrix_rank(e.covariance, hermitian=True) == len(error)
        if whole and not undetermined:
            nees = float(error @ np.linalg.solve(e.covariance, error))
    sigma = nan if e.heading_sigma is None else e.heading_sigma
    if undetermined:
        off = sigma = nan
    return EstimateErrors(
        heading=off,
        north=float(tilts[0]),
        east=float(tilts[1]),
        heading_sigma=sigma,
        north_sigma=float(sigmas[0]),
        east_sigma=float(sigmas[1]),
        nees=nees,
        heading_floor=floor[0],
        tilt_floor=floor[1],
        undetermined=float(undetermined),
    )


def floors(
    e: AttitudeEstimate, truth: Rotation, dwells: Sequence[Dwell], site: Site, imu: ImuSpec
) -> tuple[float, float]:
    """White-noise floors of heading and of tilt about one axis [rad] for an estimate.

    ``ARW/(W cos lat sqrt T)`` with two horizontal gyros and ``VRW/(g sqrt T)``, T the time of the
    stretches that the estimate used. The one gyro nearest to east or west sees only its eastern
    part of an azimuth error, so it divides by that. NaN for a method that was told the attitude.
    """
    seconds = used_time(e, dwells)
    if site.latitude is None or seconds <= 0 or ESTIMATORS[e.method].carries_nominal:
        return nan, nan
    gyros = 1.0
    if ESTIMATORS[e.method].gyros == 1:
        gyros = 1 / float(np.abs(truth.as_matrix()[1]).max())
    north = EARTH_RATE * np.cos(site.latitude)
    heading = gyros * imu.gyro.noise / (north * np.sqrt(seconds))
    return float(heading), float(imu.accel.noise / (site.gravity * np.sqrt(seconds)))


def used_time(e: AttitudeEstimate, dwells: Sequence[Dwell]) -> float:
    """Seconds of stretches within the time of an estimate: what its noise averages over."""
    spans = [min(d.t_to, e.t_to) - max(d.t_from, e.t_from) for d in dwells]
    return float(sum(span for span in spans if span > 0))


def to_json(comparison: Comparison) -> dict[str, Any]:
    """For machines: degrees, null where there is no number."""
    s = comparison.settings
    return {
        "procedure": s.procedure.id,
        "imu": s.imu.id,
        "table": s.table.id,
        "true_table": s.true_table,
        "without": list(s.without),
        "motion": s.motion.value,
        "latitude_deg": None if s.site.latitude is None else s.site.latitude / DEG,
        "seed": s.seed,
        "rate_hz": s.rate_hz,
        "runs": comparison.runs,
        "methods": [_row(t) for t in comparison.tallies],
        "noise_only": bool(noise_alone(s.unit)),
        "unstated": list(unstated(s.imu)),
    }


_ANGLES = ("rms_heading", "sigma_heading", "floor_heading", "rms_tilt", "sigma_tilt", "floor_tilt")
_RATIOS = ("ratio", "ratio_low", "ratio_high", "ratio_tilt", "ratio_tilt_low", "ratio_tilt_high")
_NEES = ("nees_mean", "nees_low", "nees_high")


def _row(t: Tally) -> dict[str, Any]:
    row: dict[str, Any] = {"method": t.method, "runs": t.runs, "estimates": t.estimates}
    row |= {"refused": t.refused, "reason": t.reason, "beyond_linear_range": t.beyond_linear}
    row["refused_stretches"] = [one._asdict() for one in t.left_out]
    row |= {"undetermined": t.undetermined, "heading_undetermined": t.why_undetermined}
    row |= {"tilt_undetermined": t.why_untilted}
    row |= {f"{name}_deg": _number(getattr(t, name) / DEG) for name in _ANGLES}
    row |= {name: _number(getattr(t, name)) for name in (*_RATIOS, *_NEES)}
    return row | {"seconds": t.seconds}


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
