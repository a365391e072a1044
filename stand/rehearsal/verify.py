"""Prediction against the stand itself: many runs with all their errors, beside what was predicted.

Nothing is shared with the predictions: each run draws its unit, its table and its sway, makes
readings, and the estimators are set against the truth of that run.
"""

import time
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import ExitStack, closing
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from alignment import ESTIMATORS, AttitudeEstimate, Site
from alignment.against_truth import angle_errors, heading_errors
from alignment.angles import SequenceRule
from alignment.arrays import Array
from alignment.calibration import Calibration
from alignment.calibration import Key as ConstantKey
from alignment.calibration.bench import Bench
from alignment.units import DEG
from stand.calibration.truth import true_values
from stand.calibration.units import name_of
from stand.errors import StandError
from stand.evaluation.runs import Answers, Made, answers_to, made_by
from stand.evaluation.score import ANGLES
from stand.rehearsal.constants import ASSUMED
from stand.rehearsal.result import QUANTITIES, Finding, Rehearsal, Severity
from stand.rehearsal.sums import Key, RunErrors, Sums, run_from_json, run_to_json
from stand.rehearsal.verification import Achieved, Verification
from stand.samples import AXES
from stand.simulation.journal import Journal, case_digest
from stand.simulation.monte_carlo import Trials
from stand.simulation.parallel import campaign
from stand.simulation.settings import Settings
from stand.simulation.work import Engine, Together

Progress = Callable[[float], None]
_RUNS_BITS = 20
FREE_AIR = 3.086e-6  # 1/s^2: by which gravity falls with height
_GRAVITY = 4  # of the random streams; a table has 3, sensors 0 to 2
BIASES = tuple(f"{sensor} bias {axis}" for sensor in ("gyro", "accelerometer") for axis in AXES)


def with_verification(
    result: Rehearsal,
    settings: Settings,
    runs: int,
    progress: Progress = lambda done: None,
    workers: int | None = None,
    engine: Engine | None = None,
    keep: Path | None = None,
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
    engine : callable, optional
        Who makes the runs, instead of processes of this machine.
    keep : Path, optional
        File for the runs; those that it holds are not made again.

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
    made = partial(errors_of_runs, result, settings, workers=workers, engine=engine)
    verification = _verified(result, settings, runs, progress, made, keep)
    result = replace(result, verification=verification)
    for a in verification.disagreeing:
        result = _warned(result, "prediction", _contradicted(a), a.label)
    for r in verification.silent:
        often = f"{r.runs} of {verification.done} runs"
        text = f"{r.who} was predicted, and gave no answer in {often}"
        result = _warned(result, "prediction", text)
    return result


def first_seed(settings: Settings) -> int:
    """The seed of the first run; those after it follow one by one.

    From the settings' own seed and all that makes the case, so that no two cases share a draw:
    20 bits of a million runs are left free below 32 of a hash. Of ten thousand cases two meet with
    a chance of one in a hundred.
    """
    digest = case_digest(settings)
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
    result: Rehearsal,
    settings: Settings,
    runs: int,
    progress: Progress,
    made: Callable[[range], Generator[RunErrors]],
    keep: Path | None,
) -> Verification:
    sums = Sums()
    begin = time.perf_counter()
    with ExitStack() as stack:
        journal = None
        if keep is not None:
            methods = ", ".join(_methods(result))
            journal = stack.enter_context(Journal(keep, f"verify {methods}", settings).adding())
            for run in journal.runs[:runs]:
                sums.add(run_from_json(run))
        trials = stack.enter_context(closing(made(range(sums.runs, runs))))
        try:
            for found in trials:
                sums.add(found)
                if journal is not None:
                    journal.add(run_to_json(found))
                progress(sums.runs / runs)
        except KeyboardInterrupt:
            if not sums.runs:
                raise
    seconds = time.perf_counter() - begin
    return verification_of(result, sums, runs, first_seed(settings), seconds)


def _methods(result: Rehearsal) -> tuple[str, ...]:
    return tuple(dict.fromkeys(p.method for p in result.predictions))


def errors_of_runs(
    result: Rehearsal,
    settings: Settings,
    numbers: range,
    workers: int | None = None,
    engine: Engine | None = None,
) -> Generator[RunErrors]:
    """The runs of these `numbers`, counted from `first_seed`; close it to end early."""
    methods = _methods(result)
    # angles as predictions read them; nobody reads verdicts
    options = replace(settings.options, rule=SequenceRule.REGULAR, verdicts=False)
    first = first_seed(settings)
    made = replace(settings, options=options, seed=first)
    seeds = range(first + numbers.start, first + numbers.stop)
    return campaign(partial(_ready, made, methods), seeds, workers, engine=engine)


def verification_of(
    result: Rehearsal, sums: Sums, requested: int, seed: int, seconds: float
) -> Verification:
    """What the summed runs, from `seed` on, come to beside a rehearsal's predictions."""
    achieved = list(_achieved(result, sums))
    among = sum(a.ratio is not None for a in achieved)
    told = {(p.method, p.label) for p in result.predictions if p.determined}
    told |= {(method, "") for method, _ in told}
    together = tuple(replace(a, among=max(1, among)) for a in achieved)
    return Verification(
        requested=requested,
        done=sums.runs,
        seed=seed,
        seconds=seconds,
        achieved=together,
        refused=tuple(replace(r, predicted=(r.method, r.stretch) in told) for r in sums.refused()),
    )


def _achieved(result: Rehearsal, sums: Sums) -> Iterator[Achieved]:
    """What was predicted; then attitudes by methods of which nothing is predicted."""
    for p in result.predictions:
        key = (p.method, p.window, p.label, p.quantity)
        if sums.mostly_told(key) or (p.determined and key in sums):
            came_to = _came_to(sums, key, p.unit, p.per, p.drawn)
            yield replace(came_to, noise_only=p.noise_only)
    untold = {p.method for p in result.predictions if not p.label}
    for key in sums:
        if key[0] in untold and key[3] in QUANTITIES and sums.mostly_told(key):
            yield _came_to(sums, key, "deg", DEG, None)


def _came_to(sums: Sums, key: Key, unit: str, per: float, predicted: float | None) -> Achieved:
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
        freedom=sums.freedom(key),
    )


# --- one run -------------------------------------------------------------------------------------


def _ready(settings: Settings, methods: Sequence[str]) -> Callable[[int], RunErrors]:
    trials = Trials(settings)
    return Together(partial(_runs, trials, methods), trials.at_once)


def _runs(trials: Trials, methods: Sequence[str], seeds: Sequence[int]) -> list[RunErrors]:
    settings = trials.settings
    made = [made_by(trials, seed) for seed in seeds]
    there = [one for one in made if isinstance(one, Made)]
    answers = iter(answers_to(there, methods, partial(_site_told, settings), settings.options))
    return [
        _run(trials, one, next(answers))
        if isinstance(one, Made)
        else RunErrors({}, dict.fromkeys([(m, "") for m in methods], f"seed {seed}: {one}"))
        for seed, one in zip(seeds, made, strict=True)
    ]


def _run(trials: Trials, one: Made, answers: Answers) -> RunErrors:
    """What the methods' answers to a run are off by."""
    truth_of_unit = partial(_true_constants, trials, one.seed)
    found, untold, refusals = {}, set(), {}
    for method, estimates, refused in answers:
        refusals |= {(method, r.stretch): r.reason for r in refused}
        for e in estimates:
            if e.label in one.truths:
                untold |= {(e.method, e.window, e.label, name) for name in e.undetermined}
                truth = one.truths[e.label].of(method)
                assert truth is not None  # it is a run of ours
                for key, error in errors_of(e, truth, one.biases).items():
                    found.setdefault(key, error)  # biases by the first of several fits
                if e.calibration is not None:
                    found |= _errors_of_constants(e.method, e.calibration, truth_of_unit)
    return RunErrors(found, refusals, frozenset(untold))


def _site_told(settings: Settings, method: str, seed: int) -> Site:
    """The site with gravity as wrong as it is said to be, for a method that is told how wrong."""
    site, bench, own = settings.site, settings.options.bench, ESTIMATORS[method]
    sequence = np.random.SeedSequence(seed, spawn_key=(_GRAVITY,))
    normal = float(np.random.default_rng(sequence).standard_normal())
    if own.design is not None and isinstance(bench, Bench):
        return replace(site, local_gravity=site.gravity + bench.gravity_sigma * normal)
    if site.local_gravity is None and own.anomaly:  # off its normal value, by a wrong height
        return replace(site, height=site.height - own.anomaly * normal / FREE_AIR)
    return site


def _true_constants(trials: Trials, seed: int, keys: Sequence[ConstantKey]) -> Array:
    return true_values(keys, *trials.units(seed), trials.settings.unit)


def _errors_of_constants(
    method: str, found: Calibration, truth: Callable[[Sequence[ConstantKey]], Array]
) -> dict[Key, float]:
    """Errors [SI] of a unit's constants, but of those whose priors no sheet states."""
    errors = found.values - truth(found.keys)
    return {
        (method, "", "all", name_of(key)): error
        for key, error in zip(found.keys, errors.tolist(), strict=True)
        if key.term not in ASSUMED
    }


def errors_of(e: AttitudeEstimate, truth: Rotation, biases: Array) -> dict[Key, float]:
    """Errors [SI] of an estimate by what they are of; those of `biases` (6,) for all stretches.

    Of an angle that is not determined too. A heading of a vertical X1 is NaN.
    """
    errors: dict[str, float] = {}
    if e.C_nb is not None:
        errors["heading"] = float(heading_errors(e.C_nb, truth))
        if not e.singular:
            angles = angle_errors(e.sequence, e.C_nb, truth)
            errors |= dict(zip(ANGLES, angles.tolist(), strict=True))
    found = {(e.method, e.window, e.label, name): x for name, x in errors.items()}
    if e.biases is not None:
        off = zip(BIASES, (e.biases - biases).tolist(), strict=True)
        found |= {(e.method, e.window, "all", name): x for name, x in off}
    return found
