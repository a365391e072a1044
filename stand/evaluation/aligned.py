"""From recordings to estimates: what `stand align` answers."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from os import PathLike
from typing import Any

from alignment import ESTIMATORS, AttitudeEstimate, Dwell, Options, Site
from alignment.angles import SequenceRule
from alignment.errors import AlignmentError
from alignment.noise import check_at_rest
from alignment.saturation import saturation_doubt
from alignment.stuck import stuck, unchanging
from alignment.units import DEG
from stand.arguments import one_of, site_with
from stand.calibration.corrected import corrected_log, loaded, posterior
from stand.calibration.file import CalibrationRecord
from stand.errors import StandError, unknown
from stand.evaluation.plausible import doubts_of, together
from stand.evaluation.score import (
    Refusal,
    Score,
    evaluate_each,
    refusal_to_json,
    score_to_json,
    spread_to_json,
    spreads,
)
from stand.evaluation.windows import Scatter, scatter_to_json, scatters
from stand.imu import ImuSpec, load_imu, unstated
from stand.imu.grains import known_readings
from stand.imu.priors import priors_of
from stand.recording.log import Log
from stand.recording.metadata import recorded_imu


def of_vehicles(method: str | None) -> bool:
    """Whether a method is for a moving vehicle with satellite fixes."""
    known = None if method is None else ESTIMATORS.get(method)
    return known is not None and known.takes == "fixes"


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Alignment:
    """What methods make of recordings.

    Attributes
    ----------
    logs : tuple of Log
    site : Site
    options : Options
        As the methods were told them.
    scores : tuple of Score
        Every estimate, with its errors where the truth is known.
    refusals : tuple of Refusal
        Methods that would not answer, and why.
    windows : tuple of Scatter
        How estimates scatter from window to window, where that was asked for.
    imu : ImuSpec, optional
        Whose data sheet enters every sigma: as told, or as recorded.
    """

    logs: tuple[Log, ...]
    site: Site
    options: Options
    scores: tuple[Score, ...]
    refusals: tuple[Refusal, ...]
    windows: tuple[Scatter, ...] = ()
    imu: ImuSpec | None = None

    @property
    def noise_only(self) -> frozenset[str]:
        """The sensors ('gyro', 'accel') of which no data sheet tells more than noise.

        Sigmas of what they tell are of noise alone.
        """
        return self.options.priors.noise_only

    @property
    def estimates(self) -> tuple[AttitudeEstimate, ...]:
        """The estimates alone."""
        return tuple(scored.estimate for scored in self.scores)


def align(
    logs: Sequence[Log],
    method: str | None = None,
    *,
    imu: str | ImuSpec | None = None,
    latitude_deg: float | None = None,
    height_m: float | None = None,
    sequences: str | None = None,
    windows_s: Sequence[float] = (),
    calibration: str | PathLike[str] | CalibrationRecord | None = None,
) -> Alignment:
    """Estimate from recordings: several are several dwells of one unit.

    What is not said is as the first recording has it: methods, site, options.

    Parameters
    ----------
    logs : sequence of Log
        One at least.
    method : str, optional
        Of `ESTIMATORS`.
    imu : str or ImuSpec, optional
        The unit, whose data sheet enters every sigma.
    latitude_deg, height_m : float, optional
    sequences : str, optional
        By which order of turns a position is read.
    windows_s : sequence of float, optional
        Lengths of windows into which every stretch is cut too: see `stand.evaluation.windows`.
    calibration : path or CalibrationRecord, optional
        Of the unit: its errors are taken out of the readings, and what is left of them by its
        sigmas enters every sigma in place of the data sheet's.

    Raises
    ------
    StandError
        No method answers; a method that is not known; a latitude that is needed and not known;
        two dwells of one name.
    """
    if method is not None and method not in ESTIMATORS:
        raise unknown("method", method, ESTIMATORS)
    if not logs:
        raise StandError("no recording to align")
    first = logs[0]
    site = site_with(first.site, latitude_deg, height_m)
    imu = load_imu(imu) if isinstance(imu, str) else imu
    options = with_data_sheet(first.options, imu)
    sticking, same = _sticking(logs)
    if calibration is not None:
        record = loaded(calibration)
        logs = [corrected_log(record, log) for log in logs]
        options = replace(options, priors=posterior(record.calibration, options.priors))
    if sequences is not None:
        options = replace(options, rule=one_of("sequences", sequences, SequenceRule))
    methods = (method,) if method else first.methods
    sheet = imu or sheet_beside(first.imu.metadata)
    dwells = [_of_unit(dwell, sheet) for log in logs for dwell in log.dwells]
    still = [dwell for dwell in dwells if dwell.label in sticking and _rests(dwell)]
    truths = [truth for log in logs for truth in log.truths]
    _check_labels([dwell.label for dwell in dwells])
    _check_methods(first.path, methods, site)
    dwells = [dwell for dwell in dwells if dwell not in still]
    dropped = [Refusal("", sticking[dwell.label], dwell.label) for dwell in still]
    if dropped and not dwells:
        raise StandError(f"{first.path}: {dropped[0].stretch}: {dropped[0].reason}")
    doubts = _doubts(logs, methods, site, options)
    scores, refused = evaluate_each(dwells, truths, site, options, methods)
    lost = [one for log in logs for one in log.lost]
    refusals = [*lost, *dropped, *(_with_sticking(one, same | sticking) for one in refused)]
    rows: list[Scatter] = []
    if windows_s:  # what is lost or moves in one of them silences no other
        rows, left_out = scatters(dwells, site, options, methods, windows_s)
        refusals = [*refusals, *left_out]
    if refusals and not scores and not rows:
        named = f"{refusals[0].stretch}: " if refusals[0].stretch else ""
        raise StandError(f"{first.path}: {named}{refusals[0].reason}")
    return Alignment(
        logs=tuple(logs),
        site=site,
        options=options,
        scores=tuple(_with_doubts(s, doubts) for s in scores),
        refusals=tuple(refusals),
        windows=tuple(rows),
        imu=sheet,
    )


def _sticking(logs: Sequence[Log]) -> tuple[dict[str, str], dict[str, str]]:
    """What is stuck, and what never changes, in rests of logs that are nobody's simulation."""
    real = [dwell for log in logs if not log.simulated for dwell in log.dwells]
    rests = {d.label: d.window() for d in real if d.turn is None and d.fixes is None}
    sticking = {label: stuck(window) for label, window in rests.items()}
    same = {label: "; ".join(unchanging(window)) for label, window in rests.items()}
    return {k: v for k, v in sticking.items() if v}, {k: v for k, v in same.items() if v}


def _rests(dwell: Dwell) -> bool:
    """Whether nothing else is wrong with a rest, which a method would tell."""
    try:
        check_at_rest(dwell)
        saturation_doubt(dwell.label, dwell.window())
    except AlignmentError:
        return False
    return True


def _with_sticking(one: Refusal, sticking: Mapping[str, str]) -> Refusal:
    """A refusal for what a stuck channel makes of readings says that, too."""
    for label, words in sticking.items():
        if one.stretch == label or one.reason.startswith(f"{label}: "):
            return replace(one, reason=f"{one.reason}; {words}")
    return one


def _of_unit(dwell: Dwell, imu: ImuSpec | None) -> Dwell:
    """The dwell, its readings with the unit's full scale and rounding."""
    if imu is None:
        return dwell
    rate = 1 / dwell.readings.interval
    return replace(dwell, readings=known_readings(dwell.readings, imu, rate))


def _doubts(
    logs: Sequence[Log], methods: Sequence[str], site: Site, options: Options
) -> dict[str, tuple[str, ...]]:
    """What each dwell of a log that is nobody's simulation says of itself, by its label.

    Raises
    ------
    StandError
        It contradicts what a method takes it for.
    """
    told: dict[str, tuple[str, ...]] = {}
    for log in logs:
        if log.simulated:
            continue
        found = [doubts_of(dwell, site, options) for dwell in log.dwells]
        wrong = together(found)
        if wrong and any(ESTIMATORS[name].needs_latitude for name in methods):
            raise StandError(f"{log.path}: {wrong[0]}")
        told |= {
            dwell.label: log.doubts + unchanging(dwell.window()) + doubt.doubtful + doubt.wrong
            for dwell, doubt in zip(log.dwells, found, strict=True)
        }
    return told


def _with_doubts(scored: Score, doubts: dict[str, tuple[str, ...]]) -> Score:
    more = doubts.get(scored.estimate.label, ())
    if not more:
        return scored
    flags = scored.estimate.flags + more
    return replace(scored, estimate=replace(scored.estimate, flags=flags))


def sheet_beside(metadata: Mapping[str, Mapping[str, str]]) -> ImuSpec | None:
    """The data sheet that a recording carries; None where it is for another version to read."""
    try:
        return recorded_imu(metadata)
    except StandError:
        return None


def with_data_sheet(options: Options, imu: str | ImuSpec | None) -> Options:
    """The options with what a unit's data sheet says; of the table what the recording says."""
    if imu is None:
        return options
    known = options.priors
    priors = replace(
        priors_of(imu if isinstance(imu, ImuSpec) else load_imu(imu), None),
        turn=known.turn,
        seat=known.seat,
        nominal=known.nominal,
        azimuth=known.azimuth,
        lever_arm=known.lever_arm,
    )
    return replace(options, priors=priors)


def _check_labels(labels: Sequence[str]) -> None:
    for label in labels:
        if labels.count(label) > 1:
            raise StandError(f"two dwells are called {label!r}: give each recording its own name")


def _check_methods(path: str, methods: Sequence[str], site: Site) -> None:
    for name in methods:
        if name not in ESTIMATORS:  # a recording made by a newer version
            raise StandError(f"{path}: {unknown('method', name, ESTIMATORS)}")
        if ESTIMATORS[name].needs_latitude and site.latitude is None:
            raise StandError(f"{path}: method {name} needs the latitude: give --latitude DEG")


def alignment_json(found: Alignment) -> dict[str, Any]:
    """For machines."""
    latitude = found.site.latitude
    asked = {"windows": [scatter_to_json(row) for row in found.windows]} if found.windows else {}
    return asked | {
        "recordings": [log.path for log in found.logs],
        "topic": found.logs[0].topic,
        "read": [
            {
                "recording": log.path,
                "topic": log.topic,
                "samples": len(log.imu),
                "notes": list(log.imu.notes),
            }
            for log in found.logs
        ],
        "latitude_deg": None if latitude is None else latitude / DEG,
        "estimates": [score_to_json(s, found.noise_only) for s in found.scores],
        "spreads": [spread_to_json(s) for s in spreads(found.scores)],
        "refusals": [refusal_to_json(r) for r in found.refusals],
        "unstated": [] if found.imu is None else list(unstated(found.imu)),
    }
