"""Prediction against the stand itself: many runs with all their errors, beside what was predicted.

Nothing is shared with the predictions: each run draws its unit, its table and its sway, makes
readings, and the estimators are set against the truth of that run.
"""

import hashlib
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np
from scipy.special import chdtri

from alignment import ESTIMATORS, AttitudeEstimate
from alignment.angles import SequenceRule
from alignment.arrays import Array
from alignment.errors import AlignmentError
from alignment.units import DEG
from stand.errors import StandError
from stand.evaluation.score import ANGLES, Truths, score, suited
from stand.evaluation.statistics import FEW, TAIL
from stand.rehearsal.result import QUANTITIES, Finding, Rehearsal, Severity
from stand.rehearsal.verification import Achieved, Refused, Verification
from stand.samples import AXES
from stand.simulation.monte_carlo import Trials
from stand.simulation.parallel import campaign
from stand.simulation.settings import Settings

Progress = Callable[[float], None]
_RUNS_BITS = 20
BIASES = tuple(f"{sensor} bias {axis}" for sensor in ("gyro", "accelerometer") for axis in AXES)
Key = tuple[str, str, str, str]  # method, window, label, quantity


class RunErrors(NamedTuple):
    """One run: errors [SI] by what they are of, and why methods refused."""

    errors: dict[Key, float]
    refusals: dict[str, str]


def with_verification(
    result: Rehearsal,
    settings: Settings,
    runs: int,
    progress: Progress = lambda done: None,
    workers: int | None = None,
) -> Rehearsal:
    """The rehearsal with `runs` runs of the stand beside its predictions.

    Parameters
    ----------
    result : Rehearsal
        Of `settings`.
    settings : Settings
        The runs' seeds begin with the `first_seed` of it.
    runs : int
    progress : callable
        Told the part done, 0 to 1.
    workers : int, optional
        Processes; if not given, as many as there are cores and as pay.

    Returns
    -------
    Rehearsal
        A procedure that cannot run is not verified. An interruption ends the runs, and what they
        came to is told. Predictions that the runs contradict are warned of.

    Raises
    ------
    StandError
        Fewer than one run; a run that failed.
    """
    if runs < 1:
        raise StandError(f"verify = {runs}: must be 1 or more")
    if not result.feasible:
        return _warned(result, "verify", "not verified: it cannot run as it is")
    if not result.predictions:
        return _warned(result, "verify", "not verified: no method is named in [estimate]")
    verification = _verified(result, settings, runs, progress, workers)
    result = replace(result, verification=verification)
    for a in verification.disagreeing:
        result = _warned(result, "prediction", _contradicted(a), a.label)
    return result


def first_seed(settings: Settings) -> int:
    """The seed of the first run; those after it follow one by one.

    From the settings' own seed and all that makes the case, so that no two cases share a draw:
    20 bits of a million runs are left free below 32 of a hash. Of ten thousand cases two meet with
    a chance of one in a hundred.
    """
    site, made = settings.site, settings
    case = (
        made.procedure.text,
        made.imu.text,
        made.table.text,
        repr((site.latitude, site.height, site.local_gravity)),
        repr((made.rate_hz, made.motion.value, made.sampling.value, made.seed)),
        repr((made.without, made.true_table)),
    )
    digest = hashlib.sha256("\0".join(case).encode()).digest()
    return int.from_bytes(digest[:4], "big") << _RUNS_BITS


def _warned(result: Rehearsal, kind: str, text: str, step: str = "") -> Rehearsal:
    finding = Finding(Severity.WARNING, kind, step, text)
    return replace(result, findings=(*result.findings, finding))


def _contradicted(a: Achieved) -> str:
    assert a.ratio is not None
    ratio, low, high = a.ratio
    where = f"{a.method} {a.window}".strip()
    return (
        f"{where} at {a.label}: {a.quantity} was predicted {ratio:.2f} ({low:.2f} to {high:.2f}) "
        f"of what {a.runs} runs came to"
    )


def _verified(
    result: Rehearsal, settings: Settings, runs: int, progress: Progress, workers: int | None
) -> Verification:
    methods = tuple(dict.fromkeys(p.method for p in result.predictions))
    options = replace(settings.options, rule=SequenceRule.REGULAR)  # as predictions read angles
    first = first_seed(settings)
    settings = replace(settings, options=options, seed=first)
    sums = Sums()
    begin = time.perf_counter()
    seeds = range(first, first + runs)
    with closing(campaign(partial(_ready, settings, methods), seeds, workers)) as trials:
        try:
            for found in trials:
                sums.add(found)
                progress(sums.runs / runs)
        except KeyboardInterrupt:
            if not sums.runs:
                raise
    seconds = time.perf_counter() - begin
    achieved = list(_achieved(result, sums))
    among = sum(a.ratio is not None for a in achieved)
    together = tuple(replace(a, among=max(1, among)) for a in achieved)
    return Verification(
        requested=runs,
        done=sums.runs,
        seed=settings.seed,
        seconds=seconds,
        achieved=together,
        refused=sums.refused(),
    )


def _achieved(result: Rehearsal, sums: "Sums") -> Iterator[Achieved]:
    """What was predicted; then attitudes by methods of which nothing is predicted."""
    for p in result.predictions:
        key = (p.method, p.window, p.label, p.quantity)
        if key in sums:
            yield _came_to(sums, key, p.unit, p.per, p.rms)
    untold = {p.method for p in result.predictions if not p.label}
    for key in sums:
        if key[0] in untold and key[3] in QUANTITIES:
            yield _came_to(sums, key, "deg", DEG, None)


def _came_to(sums: "Sums", key: Key, unit: str, per: float, predicted: float | None) -> Achieved:
    n, (sigma, low, high) = sums.sigma(key)
    method, window, label, quantity = key
    return Achieved(
        method=method,
        window=window,
        label=label,
        quantity=quantity,
        unit=unit,
        per=per,
        predicted=predicted,
        runs=n,
        sigma=sigma,
        low=low,
        high=high,
    )


# --- one run -------------------------------------------------------------------------------------


def _ready(settings: Settings, methods: Sequence[str]) -> Callable[[int], RunErrors]:
    return partial(_trial, Trials(settings), methods)


def _trial(trials: Trials, methods: Sequence[str], seed: int) -> RunErrors:
    settings = trials.settings
    try:
        dwells, attitudes = trials.readings(seed)
    except StandError as error:  # a sway drawn anew may be beyond the table
        return RunErrors({}, dict.fromkeys(methods, f"seed {seed}: {error}"))
    truths = {d.label: Truths(C) for d, C in zip(dwells, attitudes, strict=True)}
    biases = trials.biases(seed)
    found = RunErrors({}, {})
    for method in methods:
        try:
            own = suited(method, dwells)
            estimates = ESTIMATORS[method].estimate(own, settings.site, settings.options)
        except AlignmentError as error:
            found.refusals[method] = str(error)
            continue
        for e in estimates:
            if e.label in truths:
                for key, error in errors_of(e, truths[e.label], biases).items():
                    found.errors.setdefault(key, error)  # biases by the first of several fits
    return found


def errors_of(e: AttitudeEstimate, truth: Truths, biases: Array) -> dict[Key, float]:
    """Errors [SI] of an estimate by what they are of; those of `biases` (6,) for all stretches."""
    scored = score(e, truth)
    errors: dict[str, float] = {}
    if scored.heading_error is not None:
        errors["heading"] = scored.heading_error
    if scored.error is not None:
        errors |= dict(zip(ANGLES, scored.error.tolist(), strict=True))
    found = {(e.method, e.window, e.label, name): x for name, x in errors.items()}
    if e.biases is not None:
        off = zip(BIASES, (e.biases - biases).tolist(), strict=True)
        found |= {(e.method, e.window, "all", name): x for name, x in off}
    return found


# --- all of them ---------------------------------------------------------------------------------


class Sums:
    """What is kept of all runs: numbers, and sums of the first, second and fourth powers of each
    error."""

    def __init__(self) -> None:
        self.runs = 0
        self._of: dict[Key, Array] = {}
        self._refused: dict[str, tuple[int, str]] = {}

    def __contains__(self, key: Key) -> bool:
        return key in self._of

    def __iter__(self) -> Iterator[Key]:
        return iter(self._of)

    def add(self, found: RunErrors) -> None:
        """One run."""
        self.runs += 1
        for key, error in found.errors.items():
            if np.isfinite(error):
                self._of.setdefault(key, np.zeros(4))[:] += (1.0, error, error**2, error**4)
        for method, reason in found.refusals.items():
            often, first = self._refused.get(method, (0, reason))
            self._refused[method] = often + 1, first

    def refused(self) -> tuple[Refused, ...]:
        """Methods that refused, with how often."""
        return tuple(Refused(m, n, reason) for m, (n, reason) in self._refused.items())

    def sigma(self, key: Key) -> tuple[int, tuple[float, float, float]]:
        """How many runs gave a number; root mean square of the errors with its 95 % interval.

        Chi-square. Normal errors of mean m and variance v have as many degrees of freedom as there
        are runs, times ``(m^2 + v)^2 / (v^2 + 2 m^2 v)``: the same bias in every run is soon known.
        Where there are `FEW` runs or more, no more than their fourth moment says.
        """
        n, total, squares, fourths = self._of[key]
        mean = squares / n
        of_normal = mean**2 - (total / n) ** 4  # v^2 + 2 m^2 v
        freedom = n * mean**2 / of_normal if n >= FEW and of_normal > 0 else n
        spread = fourths / n - mean**2
        if n >= FEW and spread > 0:
            freedom = min(freedom, 2 * n * mean**2 / spread)
        sigma, (low, high) = np.sqrt(mean), np.sqrt(freedom / chdtri(freedom, [TAIL, 1 - TAIL]))
        return int(n), (float(sigma), float(sigma * low), float(sigma * high))
