"""One run of a case: what every method makes of it, beside the truth, as rows."""

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import replace
from functools import partial
from math import nan
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from alignment import AttitudeEstimate
from alignment.against_truth import angle_errors, heading_errors, rotation_error
from alignment.arrays import Array
from alignment.errors import AlignmentError
from alignment.options import of_noise_alone
from stand.errors import StandError
from stand.evaluation.runs import Answers, Made, answers_to, made_by
from stand.evaluation.score import ANGLES, circular
from stand.imu.priors import noise_alone
from stand.rehearsal.rehearse import rehearse
from stand.rehearsal.result import Prediction
from stand.rehearsal.verify import BIASES
from stand.simulation.monte_carlo import Trials
from stand.simulation.settings import Settings, methods_of
from stand.simulation.work import Together

NEES = "NEES"  # of a whole attitude: 3 where its covariance is honest
ALL = "all"  # the place of what is of no stretch: a unit's biases
ENDED = "ended the process that made it"


class Row(NamedTuple):
    """What one method found of one quantity at one place, SI; NaN where there is no number.

    `refusal`: why there is no answer, or none that can stand: only its sigma is there then.
    Without a quantity it is of a method's stretch, its place, or of the method altogether.
    `noise_only`: no sheet states more than noise of the sensors that tell it; the sigma is of that.
    """

    method: str = ""
    window: str = ""
    place: str = ""
    quantity: str = ""
    estimate: float = nan
    error: float = nan
    sigma: float = nan
    refusal: str = ""
    noise_only: bool = False


class Run(NamedTuple):
    """A run of a campaign."""

    case: int
    seed: int
    rows: tuple[Row, ...]


def ready(settings: Settings) -> Callable[[int], tuple[Row, ...]]:
    """What makes a run of a case by its seed; a case that cannot run has its reason as answer."""
    settings = replace(settings, options=replace(settings.options, verdicts=False))
    try:
        trials = Trials(settings)
    except (StandError, AlignmentError) as error:
        return partial(_refused, str(error))
    return Together(partial(_trials, trials, methods_of(settings)), trials.at_once)


def predicted(settings: Settings) -> Callable[[int], tuple[Prediction, ...]]:
    """What makes the predictions for a case, whatever the seed."""
    return partial(_predicted, settings)


def _predicted(settings: Settings, seed: int) -> tuple[Prediction, ...]:
    try:
        return rehearse(settings).predictions
    except (StandError, AlignmentError):  # told by its runs
        return ()


def _refused(reason: str, seed: int) -> tuple[Row, ...]:
    return (Row(refusal=reason),)


def _trials(trials: Trials, methods: Sequence[str], seeds: Sequence[int]) -> list[tuple[Row, ...]]:
    settings = trials.settings
    made = [made_by(trials, seed) for seed in seeds]
    there = [one for one in made if isinstance(one, Made)]
    alone = noise_alone(settings.unit)
    answers = iter(answers_to(there, methods, lambda *_: settings.site, settings.options))
    return [
        _trial(one, next(answers), settings.site.latitude, alone)
        if isinstance(one, Made)
        else (Row(refusal=str(one)),)
        for one in made
    ]


def _trial(
    one: Made, answers: Answers, latitude: float | None, alone: Collection[str]
) -> tuple[Row, ...]:
    rows: dict[tuple[str, ...], Row] = {}
    for method, estimates, refused in answers:
        for r in refused:
            rows[method, r.stretch] = Row(method, place=r.stretch, refusal=r.reason)
        for e in estimates:
            truth = one.truths[e.label].of(method) if e.label in one.truths else None
            for row in _rows(e, truth, one.biases, latitude):
                told = bool(np.isfinite(row.sigma)) and of_noise_alone(row.quantity, alone)
                row = row._replace(noise_only=told)
                rows.setdefault(tuple(row[:4]), row)  # biases by the first of several fits
    return tuple(rows.values()) or (Row(refusal="no method is named"),)


def _rows(
    e: AttitudeEstimate, truth: Rotation | None, biases: Array, latitude: float | None
) -> Iterator[Row]:
    """All that an estimate says."""
    of = partial(Row, e.method, e.window)
    if truth is not None and e.C_nb is not None:
        for name, numbers in _attitude(e, truth).items():
            why = e.undetermined.get(name, "")
            estimate, error, sigma = numbers
            if why:
                estimate = error = nan
            yield of(e.label, name, estimate=estimate, error=error, sigma=sigma, refusal=why)
        nees = _nees(e, truth)
        if np.isfinite(nees):
            yield of(e.label, NEES, estimate=nees)
    if e.latitude_sigma is not None and latitude is not None:
        found = nan if e.latitude is None else e.latitude
        why = e.undetermined.get("latitude", "")
        yield of(
            e.label,
            "latitude",
            estimate=found,
            error=found - latitude,
            sigma=e.latitude_sigma,
            refusal=why,
        )
    if e.biases is not None:
        sigmas = np.full(len(BIASES), nan) if e.bias_sigmas is None else e.bias_sigmas
        for name, found, true, sigma in zip(BIASES, e.biases, biases, sigmas, strict=True):
            numbers = (float(found), float(found - true), float(sigma))
            yield of(ALL, name, estimate=numbers[0], error=numbers[1], sigma=numbers[2])


def _attitude(e: AttitudeEstimate, truth: Rotation) -> dict[str, tuple[float, float, float]]:
    """Estimate, error and sigma [rad] of heading, roll, yaw and pitch; of what has a number."""
    assert e.C_nb is not None
    found = {}
    off = float(heading_errors(e.C_nb, truth))
    if np.isfinite(off):  # X1 is not vertical
        sigma = nan if e.heading_sigma is None else e.heading_sigma
        found["heading"] = (nan if e.heading is None else e.heading, off, sigma)
    if not e.singular and e.angles is not None:
        errors = angle_errors(e.sequence, e.C_nb, truth)
        sigmas = np.full(3, nan) if e.sigmas is None else e.sigmas
        for name, *numbers in zip(ANGLES, e.angles, errors, sigmas, strict=True):
            angle, error, sigma = map(float, numbers)
            found[name] = (angle, error, sigma)
    return found


def _nees(e: AttitudeEstimate, truth: Rotation) -> float:
    """Squared error of the whole attitude, normalised by its covariance; NaN where it has none."""
    assert e.C_nb is not None
    if e.covariance is None or circular(e) or not {"heading", "yaw"}.isdisjoint(e.undetermined):
        return nan
    error = rotation_error(e.C_nb, truth)
    if np.linalg.matrix_rank(e.covariance, hermitian=True) < len(error):
        return nan
    return float(error @ np.linalg.solve(e.covariance, error))
