"""Estimates set against what was true and what was nominal, and their JSON form."""

from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from math import sqrt
from typing import TypeVar

import numpy as np
from scipy.spatial.transform import Rotation

from alignment import ESTIMATORS, AttitudeEstimate, Dwell, Options, Site
from alignment.against_truth import angle_errors, heading_errors
from alignment.arrays import Array
from alignment.errors import AlignmentError
from alignment.units import DEG, DEG_PER_HOUR, MILLI_G
from stand.calibration.file import CalibrationRecord, record_to_json

STILL = 1e-9  # rad: between the mean attitude of a stretch and that of its end
ANGLES = ("roll", "yaw", "pitch")
T = TypeVar("T")


@dataclass(frozen=True, slots=True, eq=False)
class Truths:
    """What is known about a dwell apart from the readings: None where nobody knows.

    `C_nb` the true attitude at its end, `nominal` what the table was told, `latitude` [rad],
    `mean` the true mean attitude, where that is another.
    """

    C_nb: Rotation | None = None
    nominal: Rotation | None = None
    latitude: float | None = None
    mean: Rotation | None = None

    def of(self, method: str) -> Rotation | None:
        """The true attitude that a method's answer is to be set against."""
        known = ESTIMATORS.get(method)  # a track of a window has its name too: "rk4 same"
        moved = self.mean is not None and not self.still
        return self.mean if moved and known is not None and known.tells_mean else self.C_nb

    @property
    def still(self) -> bool:
        """Whether it stood where it was at the end, but for rounding."""
        if self.mean is None or self.C_nb is None:
            return False
        return float((self.mean.inv() * self.C_nb).magnitude()) < STILL


@dataclass(frozen=True, slots=True, eq=False)
class Score:
    """An estimate with its errors.

    `error`, `error_nominal` (3,): roll, yaw, pitch [rad], estimate minus truth (nominal), read
    by the estimate's own sequence and wrapped, NaN of an angle that is not determined;
    `heading_error`, `latitude_error` [rad]. None where there is nothing to compare.
    """

    estimate: AttitudeEstimate
    error: Array | None
    error_nominal: Array | None
    heading_error: float | None
    latitude_error: float | None


def score(estimate: AttitudeEstimate, truths: Truths) -> Score:
    """Set one estimate against what is known."""
    latitude_error = None
    if estimate.latitude is not None and truths.latitude is not None:
        latitude_error = estimate.latitude - truths.latitude
    return Score(
        estimate,
        angle_error(estimate, truths.of(estimate.method)),
        angle_error(estimate, truths.nominal),
        _heading_error(estimate, truths.of(estimate.method)),
        latitude_error=latitude_error,
    )


def angle_error(estimate: AttitudeEstimate, reference: Rotation | None) -> Array | None:
    """Roll, yaw, pitch [rad] of the estimate minus those of `reference`, wrapped.

    None at the sequence's singularity, where roll, yaw and pitch cannot be told apart.
    """
    if reference is None or estimate.angles is None or estimate.singular:
        return None
    assert estimate.C_nb is not None
    errors = angle_errors(estimate.sequence, estimate.C_nb, reference)
    return np.where(np.isfinite(estimate.angles), errors, np.nan)


def _heading_error(estimate: AttitudeEstimate, truth: Rotation | None) -> float | None:
    if truth is None or estimate.C_nb is None or estimate.heading is None:
        return None
    error = float(heading_errors(estimate.C_nb, truth))
    return None if np.isnan(error) else error


def suited(method: str, dwells: Sequence[Dwell]) -> list[Dwell]:
    """The stretches a method is for; `AlignmentError` where there is none."""
    found = [dwell for dwell in dwells if ESTIMATORS[method].suited(dwell)]
    if not found:
        raise AlignmentError(ESTIMATORS[method].lacking)
    return found


def circular(estimate: AttitudeEstimate) -> bool:
    """Whether its errors are zero by construction, and say nothing of the method."""
    return ESTIMATORS[estimate.method].window(estimate.window).circular


@dataclass(frozen=True, slots=True)
class Refusal:
    """A method that would not answer, of a `stretch` or at all, and why.

    Without a `method`: a stretch that none was asked about.
    """

    method: str
    reason: str
    stretch: str = ""

    @property
    def who(self) -> str:
        """What gives no estimate, in words."""
        return " at ".join(part for part in (self.method, self.stretch) if part)


def refusal_to_json(refusal: Refusal) -> dict[str, str]:
    """One refusal for machines."""
    who = {"method": refusal.method, "stretch": refusal.stretch}
    return {name: text for name, text in who.items() if text} | {"reason": refusal.reason}


def evaluate_each(
    dwells: Sequence[Dwell],
    truths: Sequence[Truths],
    site: Site,
    options: Options,
    methods: Sequence[str],
) -> tuple[list[Score], list[Refusal]]:
    """Run the methods over the dwells and score every estimate.

    A method gets the stretches it is for; no refusal silences other methods, or what other
    stretches tell. An estimate belongs to the dwell of its label; one from several dwells has no
    true attitude.
    """
    scores: list[Score] = []
    refusals = []
    known = _by_label(dwells, truths)
    for method in methods:
        estimates, refused = answered(method, dwells, site, options)
        scores += [score(e, known(e.label)) for e in estimates]
        refusals += refused
    return scores, refusals


def _by_label(dwells: Sequence[Dwell], truths: Sequence[Truths]) -> Callable[[str], Truths]:
    """The truths of an estimate by its label; of several dwells only the latitude is known."""
    known = {dwell.label: truth for dwell, truth in zip(dwells, truths, strict=True)}
    several = Truths(latitude=truths[0].latitude if truths else None)
    return lambda label: known.get(label, several)


def answered(
    method: str, dwells: Sequence[Dwell], site: Site, options: Options
) -> tuple[list[AttitudeEstimate], list[Refusal]]:
    """What a method makes of the stretches, and why it refuses some of them, or all.

    A method that answers each stretch by itself is asked so. Of another one a refusal that names a
    stretch ("X1 up: ...") is of that stretch: it is asked again without it. Where that leaves no
    answer, the first reason is that of the method.
    """
    if ESTIMATORS[method].alone:
        return _one_by_one(method, dwells, site, options)
    refused: list[Refusal] = []
    left = list(dwells)
    while True:
        try:
            own = suited(method, left)
            return ESTIMATORS[method].estimate(own, site, options), refused
        except AlignmentError as error:
            reason = str(error)
            named = [d for d in left if reason.startswith(f"{d.label}: ")]
            refused.append(Refusal(method, reason, named[0].label if named else ""))
            left = [d for d in left if d not in named[:1]]
            if not (named and left):
                return [], [Refusal(method, refused[0].reason)]


def _one_by_one(
    method: str, dwells: Sequence[Dwell], site: Site, options: Options
) -> tuple[list[AttitudeEstimate], list[Refusal]]:
    try:
        own = suited(method, dwells)
    except AlignmentError as error:
        return [], [Refusal(method, str(error))]
    estimates: list[AttitudeEstimate] = []
    refused: list[Refusal] = []
    for dwell in own:
        try:
            estimates += ESTIMATORS[method].estimate([dwell], site, options)
        except AlignmentError as error:
            refused.append(Refusal(method, str(error), dwell.label))
    return estimates, refused if estimates else [Refusal(method, refused[0].reason)]


def of_each(
    make: Callable[[Dwell, Site, Options], T],
    method: str,
    dwells: Sequence[Dwell],
    site: Site,
    options: Options,
) -> list[tuple[Dwell, T]]:
    """What `make` has of each stretch that the method is for and does not refuse."""
    found = []
    for dwell in filter(ESTIMATORS[method].suited, dwells):
        with suppress(AlignmentError):
            found.append((dwell, make(dwell, site, options)))
    return found


Answered = tuple[list[AttitudeEstimate], list[Refusal]]


def answered_of_runs(
    method: str, runs: Sequence[Sequence[Dwell]], sites: Sequence[Site], options: Options
) -> list[Answered]:
    """As `answered`, of many runs of one procedure, whose sites differ in their gravity alone.

    A method that takes them at once has the same numbers; a run that it refuses is asked alone.
    """
    at_once = _estimates_of_runs(method, runs, sites, options)
    return [
        answered(method, dwells, site, options) if found is None else (found, [])
        for found, dwells, site in zip(at_once, runs, sites, strict=True)
    ]


def _estimates_of_runs(
    method: str, runs: Sequence[Sequence[Dwell]], sites: Sequence[Site], options: Options
) -> list[list[AttitudeEstimate] | None]:
    """Of each run, None where it is to be asked alone."""
    none: list[list[AttitudeEstimate] | None] = [None] * len(runs)
    estimate = ESTIMATORS[method].estimate_of_runs
    if estimate is None or len(runs) == 1 or len({len(dwells) for dwells in runs}) > 1:
        return none
    try:
        found = estimate([suited(method, dwells) for dwells in runs], sites, options)
    except AlignmentError:
        return none
    return [None if isinstance(own, AlignmentError) else own for own in found]


@dataclass(frozen=True, slots=True, eq=False)
class Spread:
    """Errors of one method over its positions: `sigma` about their mean (n - 1), `rms` about 0.

    Both (3,): roll, yaw, pitch [rad], NaN of an angle that is not determined in every position;
    `count` positions; `reference` 'truth' or 'nominal'.
    """

    method: str
    window: str
    reference: str
    count: int
    sigma: Array
    rms: Array


def spreads(scores: Sequence[Score]) -> list[Spread]:
    """Per method and window, over two positions or more, against truth and against nominal."""
    found = []
    for (method, window), members in by_method(scores):
        for reference, key in (("truth", "error"), ("nominal", "error_nominal")):
            errors = [e for s in members if (e := getattr(s, key)) is not None]
            if len(errors) >= 2:
                found.append(_spread(method, window, reference, np.array(errors)))
    return found


def _spread(method: str, window: str, reference: str, errors: Array) -> Spread:
    sigma = errors.std(axis=0, ddof=1)
    rms = np.sqrt((errors**2).mean(axis=0))
    return Spread(method, window, reference, len(errors), sigma=sigma, rms=rms)


def by_method(scores: Sequence[Score]) -> list[tuple[tuple[str, str], list[Score]]]:
    """The scores of each (method, window), in order of first appearance."""
    groups: dict[tuple[str, str], list[Score]] = {}
    for s in scores:
        groups.setdefault((s.estimate.method, s.estimate.window), []).append(s)
    return list(groups.items())


def score_to_json(scored: Score, noise_only: Collection[str] = ()) -> dict[str, object]:
    """One estimate for machines: degrees, absent where there is no value.

    null where a value is not determined: `undetermined` says why. `noise_only`: the sensors
    that no data sheet tells more of, and whether there are any: standard deviations are of noise.
    """
    e = scored.estimate
    entry: dict[str, object] = {"method": e.method, "label": e.label}
    if e.window:
        entry["window"] = e.window
    entry |= {"t_from_s": e.t_from, "t_to_s": e.t_to, "sequence": e.sequence.value}
    entry["heading_deg"] = None if e.heading is None else e.heading / DEG
    entry |= _named("", e.angles)
    entry["singular"] = e.singular
    if e.latitude is not None or "latitude" in e.undetermined:
        entry["latitude_deg"] = None if e.latitude is None else e.latitude / DEG
    entry |= _named("sigma_", e.sigmas)
    if e.heading_sigma is not None:
        entry["sigma_heading_deg"] = e.heading_sigma / DEG
    if e.latitude_sigma is not None:
        entry["sigma_latitude_deg"] = e.latitude_sigma / DEG
    entry |= _named("error_", scored.error)
    if scored.heading_error is not None:
        entry["error_heading_deg"] = scored.heading_error / DEG
    if scored.latitude_error is not None:
        entry["error_latitude_deg"] = scored.latitude_error / DEG
    entry |= _named("error_nominal_", scored.error_nominal)
    entry |= _biases("bias", e.biases) | _biases("sigma_bias", e.bias_sigmas)
    if e.calibration is not None:
        told = record_to_json(CalibrationRecord(calibration=e.calibration))
        entry["constants"] = told["parameters"]
    if e.sway is not None:
        entry["sway"] = _sway_json(e.sway)
    entry |= {"undetermined": e.undetermined, "noise_only": bool(noise_only)}
    entry["flags"] = list(e.flags)
    return entry


def _sway_json(sway: Mapping[str, float]) -> dict[str, float]:
    """Mean tilts, rms of the sway about both axes, its covariance, the published bound."""
    return {
        "mean_beta_deg": sway["beta"] / DEG,
        "mean_gamma_deg": sway["gamma"] / DEG,
        "rms_beta_deg": sqrt(sway["variance_beta"]) / DEG,
        "rms_gamma_deg": sqrt(sway["variance_gamma"]) / DEG,
        "covariance_deg2": sway["covariance"] / DEG**2,
        "published_bound_deg": sway["bound"] / DEG,
    }


def _named(prefix: str, angles: Array | None) -> dict[str, object]:
    if angles is None:
        return {}
    return {
        f"{prefix}{n}_deg": None if np.isnan(a) else float(a) / DEG
        for n, a in zip(ANGLES, angles, strict=True)
    }


def _biases(name: str, values: Array | None) -> dict[str, object]:
    if values is None:
        return {}
    gyro, accel = values[:3] / DEG_PER_HOUR, values[3:] / MILLI_G
    return {f"gyro_{name}_deg_h": gyro.tolist(), f"accel_{name}_mg": accel.tolist()}


def spread_to_json(spread: Spread) -> dict[str, object]:
    """One row of deviations for machines, in degrees."""
    entry: dict[str, object] = {
        "method": spread.method,
        "window": spread.window,
        "reference": spread.reference,
        "positions": spread.count,
    }
    return entry | _named("sigma_", spread.sigma) | _named("rms_", spread.rms)
