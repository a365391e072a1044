"""Errors of many runs over the covariances that were stated with them: what a sigma promises.

One attitude has three degrees of freedom. Where heading is not determined only the tilt is
stated, which has two.
"""

from collections.abc import Callable, Iterable, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass, replace
from functools import partial
from math import radians
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from alignment import AttitudeEstimate
from alignment.against_truth import rotation_error
from stand.errors import StandError
from stand.evaluation.comparison import applicable
from stand.evaluation.runs import made_by
from stand.evaluation.score import answered, circular
from stand.imu import load_imu
from stand.procedure.procedure import Procedure, table_of
from stand.rehearsal.verify import first_seed
from stand.simulation.journal import Journal
from stand.simulation.monte_carlo import Trials
from stand.simulation.parallel import campaign
from stand.simulation.settings import Settings, assembled
from stand.simulation.work import Engine

UNDETERMINED = radians(30.0)  # sigma above which a heading is no number
ROUNDING = 1e-7  # rad, 0.02 arc seconds: below it an error is of no first order
# A mean of 32 blocks knows its variance with 31 degrees of freedom, a mean over F(3, 31) is
# 31/29; of five seconds at 5 Hz there are 24.
FEW_BLOCKS = 24 / 22

# Hz: noise of a coarse unit must blur its steps, and its sheet's rate does
RATES_HZ = {"adis16470": 200, "icm42688p": 100}
LOW_HZ = 5


@dataclass(frozen=True, slots=True)
class Promise:
    """One method's estimates of one stretch over all runs.

    `values` (m,), `freedoms` (m,): normalised squared errors and their degrees of freedom, one a
    run that gave a number; `sigma` [rad] their median heading sigma; `refused`: how many runs gave
    none, and the first `reason`. Without a `label`: of refusals of all stretches.
    """

    case: str
    method: str
    label: str
    values: tuple[float, ...]
    freedoms: tuple[int, ...]
    sigma: float
    refused: int = 0
    reason: str = ""

    @property
    def mean(self) -> float:
        """Of the normalised squared errors per degree of freedom: one is honest."""
        return sum(self.values) / sum(self.freedoms)

    def bounds(self, among: int) -> tuple[float, float]:
        """Within which `among` such means lie together in 95 of 100 sets, if all are honest."""
        tail, freedom = 0.025 / among, sum(self.freedoms)
        low, high = chi2.ppf([tail, 1 - tail], freedom) / freedom
        return float(low), float(high) * FEW_BLOCKS

    def kept(self, among: int) -> bool:
        """Whether it is, or there is no number at all."""
        if not self.values:
            return True
        low, high = self.bounds(among)
        return low <= self.mean <= high


def settings_of(procedure: Procedure, imu: str, rate_hz: int | None = None) -> Settings:
    """A case as `stand compare` makes it, at the lowest rate that is fair to the unit."""
    rate = RATES_HZ.get(imu, LOW_HZ) if rate_hz is None else rate_hz
    site = procedure.entry.site.site()
    return assembled(procedure, load_imu(imu), table_of(procedure), site, rate)


class Run(NamedTuple):
    """What one run came to, in plain values: method, label, reason of refusals; method, label,
    normalised squared error, its degrees of freedom and heading sigma [rad] of estimates."""

    refused: list[list[Any]]
    found: list[list[Any]]


def promises(
    settings: Settings,
    runs: int,
    methods: Sequence[str] | None = None,
    *,
    workers: int | None = 1,
    engine: Engine | None = None,
    keep: Path | None = None,
) -> list[Promise]:
    """What all `methods` (those that take the procedure) come to; refusals are promises kept.

    `workers`, `engine`: who makes the runs, as `stand.simulation.parallel.campaign` takes them;
    `keep`: a file for them, of which none is made again.
    """
    first = first_seed(settings)
    made = replace(settings, seed=first, options=replace(settings.options, verdicts=False))
    found = _Found(f"{settings.procedure.id}/{settings.imu.id}")
    with ExitStack() as stack:
        journal = None
        if keep is not None:
            journal = stack.enter_context(Journal(keep, "squared errors", settings).adding())
        there = [] if journal is None else journal.runs[:runs]
        for run in there:
            found.add(Run(*run))
        seeds = range(first + len(there), first + runs)
        ready = partial(_ready, made, methods)
        for run in stack.enter_context(closing(campaign(ready, seeds, workers, engine=engine))):
            found.add(run)
            if journal is not None:
                journal.add(run)
    return found.all()


def _ready(settings: Settings, methods: Sequence[str] | None) -> Callable[[int], Run]:
    trials = Trials(settings)
    return partial(_trial, trials, methods or applicable(trials.plan))


def _trial(trials: Trials, methods: Sequence[str], seed: int) -> Run:
    made, run = trials.settings, Run([], [])
    there = made_by(trials, seed)
    if isinstance(there, StandError):
        run.refused.append(["", "", str(there)])
        return run
    for method in methods:
        estimates, refused = answered(method, there.dwells, made.site, made.options)
        run.refused.extend([method, one.stretch, one.reason] for one in refused)
        for e in estimates:
            if e.C_nb is None or e.label not in there.truths or circular(e):
                continue
            truth = there.truths[e.label].of(method)
            assert truth is not None
            row = _normalised(e, error_of(e.C_nb, truth))
            if row is not None:
                run.found.append([e.method, e.label, *row])
    return run


def _normalised(e: AttitudeEstimate, error: np.ndarray) -> tuple[float, int, float] | None:
    if e.covariance is None:
        return None
    P, size = e.covariance, 3
    sigma = float(np.sqrt(P[2, 2]))
    if not sigma <= UNDETERMINED:
        P, error, size = P[:2, :2], error[:2], 2
    if np.linalg.eigvalsh(P)[0] <= 0 or np.abs(error).max() < ROUNDING:
        return None
    return float(error @ np.linalg.solve(P, error)), size, sigma


def error_of(C_nb: Rotation, truth: Rotation) -> np.ndarray:
    """Tilt about N and E, then rotation about D [rad], (3,).

    The tilt is of the true vertical as the estimate sees it: to first order the rotation vector,
    and whatever heading is wrong by it stays a tilt.
    """
    down = (C_nb * truth.inv()).apply([0.0, 0.0, 1.0])
    return np.array([-down[1], down[0], rotation_error(C_nb, truth)[2]])


class _Found:
    def __init__(self, case: str) -> None:
        self.case = case
        self._of: dict[tuple[str, str], list[tuple[float, int, float]]] = {}
        self._refused: dict[tuple[str, str], list[str]] = {}

    def add(self, run: Run) -> None:
        for method, label, reason in run.refused:
            self._refused.setdefault((method, label), []).append(reason)
        for method, label, *row in run.found:
            self._of.setdefault((method, label), []).append((row[0], row[1], row[2]))

    def all(self) -> list[Promise]:
        made = []
        for (method, label), rows in self._of.items():
            values, freedoms, sigmas = zip(*rows, strict=True)
            why = self._refused.get((method, label), [])
            made.append(
                Promise(
                    case=self.case,
                    method=method,
                    label=label,
                    values=values,
                    freedoms=freedoms,
                    sigma=float(np.median(sigmas)),
                    refused=len(why),
                    reason=why[0] if why else "",
                )
            )
        for method, label in sorted(set(self._refused) - set(self._of)):
            why = self._refused[method, label]
            made.append(Promise(self.case, method, label, (), (), np.nan, len(why), why[0]))
        return made


def broken(all_of: Iterable[Promise]) -> list[str]:
    """The promises that are not kept, in words; by the family of all of them."""
    rows = [p for p in all_of if p.values]
    return [
        f"{p.case} {p.method} {p.label!r}: {p.mean:.3g} not in {low:.2f} to {high:.2f} "
        f"(heading sigma {np.degrees(p.sigma):.3g} deg, {len(p.values)} runs)"
        for p in rows
        for low, high in [p.bounds(len(rows))]
        if not p.kept(len(rows))
    ]
