"""Allan analysis of a recording: its rest, its data sheet, the result in a data sheet's units."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from math import isfinite, sqrt
from pathlib import Path
from typing import Any

import numpy as np

from alignment import ImuReadings
from alignment.allan import Analysis, Channel, Missing
from alignment.allan import analyse as analyse_readings
from alignment.errors import AlignmentError, NotAtRest
from alignment.units import ARC_SECOND, DEG_PER_HOUR, DEG_PER_RT_HOUR, M_S_PER_RT_HOUR, MICRO_G
from stand import toml_files as catalogue
from stand.errors import StandError
from stand.imu import ImuSpec, TriadSpec, imu_from, load_imu
from stand.recording.mcap.reader import ImuLog, read_imu
from stand.recording.metadata import RUN, epoch_of, recorded_steps

HOUR = 3600.0
RT_HOUR = 60.0  # root seconds in a root hour


@dataclass(frozen=True, slots=True)
class Unit:
    """How a term is written: multiply by `si` to come in, divide to go out."""

    name: str
    si: float


UNITS: Mapping[tuple[str, str], Unit] = {
    ("gyro", "N"): Unit("deg/rt-h", DEG_PER_RT_HOUR),
    ("gyro", "B"): Unit("deg/h", DEG_PER_HOUR),
    ("gyro", "K"): Unit("deg/h/rt-h", DEG_PER_HOUR / RT_HOUR),
    ("gyro", "Q"): Unit("arc second", ARC_SECOND),
    ("gyro", "R"): Unit("deg/h/h", DEG_PER_HOUR / HOUR),
    ("accel", "N"): Unit("m/s/rt-h", M_S_PER_RT_HOUR),
    ("accel", "B"): Unit("ug", MICRO_G),
    ("accel", "K"): Unit("ug/rt-h", MICRO_G / RT_HOUR),
    ("accel", "Q"): Unit("m/s", 1.0),
    ("accel", "R"): Unit("ug/h", MICRO_G / HOUR),
}
ORDER = ("N", "B", "K", "Q", "R")
DEVIATION = {"gyro": Unit("deg/h", DEG_PER_HOUR), "accel": Unit("ug", MICRO_G)}


@dataclass(frozen=True, slots=True, eq=False)
class AllanReport:
    """What a recording says of its unit's noise.

    `sheet` is the data sheet's SI value by (sensor, term), `sheet_title` whose it is (None: there
    is none); `notes` say what of the recording was used.
    """

    path: str
    topic: str
    analysis: Analysis
    sheet: Mapping[tuple[str, str], float]
    sheet_title: str | None
    notes: tuple[str, ...]


def analyse(
    path: Path,
    topic: str | None = None,
    t_from: float | None = None,
    t_to: float | None = None,
    imu: str | None = None,
    terms: Iterable[str] = (),
) -> AllanReport:
    """Allan analysis of a recording at rest, ours or any log with sensor_msgs/msg/Imu.

    Parameters
    ----------
    path : Path
    topic : str or None
        See `read_imu`.
    t_from, t_to : float or None
        The stretch to use [s], counted as `load_log` does; without either, the longest
        dwell of a recording of ours, all of any other.
    imu : str or None
        A preset whose values are put beside the measured ones; else the one in the recording.
    terms : iterable of str
        Terms to insist on.

    Raises
    ------
    StandError
        The file, stretch or preset is not right.
    AlignmentError
        Not at rest, or too short for an analysis or for a term of `terms`.
    """
    log = read_imu(path, topic)
    spec = load_imu(imu) if imu else _recorded_imu(path, log)
    sheet = sheet_of(spec) if spec else {}
    readings, notes = _stretch(path, log, t_from, t_to)
    try:
        result = analyse_readings(readings, sheet, terms)
    except NotAtRest as error:
        raise NotAtRest(f"{path}: {error}; choose a rest with --from and --to") from error
    except AlignmentError as error:
        raise type(error)(f"{path}: {error}") from error
    title = f"{spec.title} ({spec.id})" if spec else None
    notes += _told(result)
    return AllanReport(str(path), log.topic, result, sheet, title, tuple(notes))


def sheet_of(spec: ImuSpec) -> dict[tuple[str, str], float]:
    """Noise terms that a preset states, in SI; increments rounded to an LSB have Q = LSB/rt-12."""
    found = {}
    for sensor, triad in (("gyro", spec.gyro), ("accel", spec.accel)):
        values = _noise_of(triad, spec.increments)
        found |= {(sensor, term): value for term, value in values.items() if value > 0}
    return found


def _noise_of(triad: TriadSpec, increments: bool) -> dict[str, float]:
    return {
        "N": triad.noise,
        "B": triad.instability,
        "K": triad.random_walk,
        "Q": triad.increment_lsb / sqrt(12) if increments else 0.0,
        "R": triad.ramp,
    }


def _recorded_imu(path: Path, log: ImuLog) -> ImuSpec | None:
    """The preset a recording of ours carries."""
    text = log.metadata.get("imu", {}).get("toml")
    if text is None:
        return None
    name = log.metadata.get("run", {}).get("imu", "imu")
    try:
        return imu_from(catalogue.Source(name, f"{name}.toml", text))
    except StandError as error:
        raise StandError(f"{path}: the preset in its metadata: {error}") from error


def _stretch(
    path: Path, log: ImuLog, t_from: float | None, t_to: float | None
) -> tuple[ImuReadings, list[str]]:
    """The samples to use, and what to say of the choice."""
    try:
        ours = "epoch_ns" in log.metadata.get(RUN, {})
        origin = epoch_of(log.metadata) if ours else int(log.t_ns[0])
    except StandError as error:
        raise StandError(f"{path}: {error}") from error
    t = (log.t_ns - origin) * 1e-9
    t.flags.writeable = False
    readings = ImuReadings(t, log.w_ib_b, log.f_b)
    notes = []
    if t_from is None and t_to is None:
        dwell = _longest_dwell(path, log)
        if dwell is None:
            return readings, notes
        t_from, t_to = float(dwell["t_from_s"]), float(dwell["t_to_s"])
        if t_from > t[0] or t_to < t[-1]:
            notes.append(f"longest dwell: {dwell['label']}, {t_from:.6g} to {t_to:.6g} s")
    begin, end = float(t[0]) - readings.interval if len(t) > 1 else float(t[0]), float(t[-1])
    a, b = (begin if t_from is None else t_from), (end if t_to is None else t_to)
    if not (isfinite(a) and isfinite(b) and begin - 1e-6 <= a < b <= end + 1e-6):
        raise StandError(
            f"{path}: --from {a:g} --to {b:g}: must be a stretch within the recording's "
            f"{begin:.3f} to {end:.3f} s"
        )
    whole = a <= begin + 1e-6 and b >= end - 1e-6
    chosen = readings if whole else readings.between(a, b)
    if len(chosen) == 0:
        raise StandError(f"{path}: no samples between {a:g} and {b:g} s")
    return chosen, notes


def _longest_dwell(path: Path, log: ImuLog) -> dict[str, Any] | None:
    if "schedule" not in log.metadata:
        return None
    try:
        steps = recorded_steps(log.metadata)
    except StandError as error:
        raise StandError(f"{path}: {error}") from error
    dwells = [step.model_dump() for step in steps if step.kind == "dwell"]
    return max(dwells, key=lambda d: d["t_to_s"] - d["t_from_s"], default=None)


def _told(result: Analysis) -> list[str]:
    """Interruptions and misfits, in words; many interruptions as their number."""
    notes = []
    gaps = [event for event in result.interruptions if event.kind == "gap"]
    rates = [event for event in result.interruptions if event.kind == "rate"]
    if gaps:
        first = ", ".join(f"{e.missing:.3g} s before {e.t:.6g} s" for e in gaps[:3])
        more = f" and {len(gaps) - 3} more" if len(gaps) > 3 else ""
        notes.append(f"gaps: {first}{more}")
    for event in rates[:3]:
        notes.append(
            f"rate changes at {event.t:.6g} s from {1 / event.before:.6g} "
            f"to {1 / event.after:.6g} Hz"
        )
    if result.interruptions:
        notes.append(
            f"used: the longest stretch without interruption, {result.t_from:.6g} to "
            f"{result.t_to:.6g} s"
        )
    return notes + [note for c in result.channels for note in _misfits(c)]


def _misfits(channel: Channel) -> list[str]:
    name = f"{channel.sensor} {channel.axis}"
    if channel.model_error > 0:
        error = 100 * channel.model_error
        return [
            f"{name}: the five terms describe the curve to {error:.2g} % only; intervals allow that"
        ]
    if channel.first_tau > channel.tau[0]:
        return [f"{name}: fitted from {channel.first_tau:.3g} s on, the start has another shape"]
    return []


def to_json(report: AllanReport) -> dict[str, Any]:
    """The report for machines, in the units of `UNITS`; times in s, `needs_h` in hours.

    `needs_h` is None where no length would do at this rate; `upper` is the largest value that the
    record allows (95 %).
    """
    result = report.analysis
    events = result.interruptions
    return {
        "recording": report.path,
        "topic": report.topic,
        "datasheet": report.sheet_title,
        "rate_hz": 1 / result.interval,
        "duration_s": result.duration,
        "from_s": result.t_from,
        "to_s": result.t_to,
        "gaps": [{"at_s": e.t, "missing_s": e.missing} for e in events if e.kind == "gap"],
        "rate_changes": [
            {"at_s": e.t, "before_hz": 1 / e.before, "after_hz": 1 / e.after}
            for e in events
            if e.kind == "rate"
        ],
        "notes": list(report.notes),
        "terms": [entry for c in result.channels for entry in _terms(report, c)],
        "not_identifiable": [entry for c in result.channels for entry in _missing(report, c)],
        "curves": [_curve(c) for c in result.channels],
    }


def _terms(report: AllanReport, channel: Channel) -> list[dict[str, Any]]:
    entries = []
    for found in sorted(channel.found, key=lambda f: ORDER.index(f.term)):
        unit = UNITS[channel.sensor, found.term]
        entry = {
            "sensor": channel.sensor,
            "axis": channel.axis,
            "term": found.term,
            "value": found.value / unit.si,
            "unit": unit.name,
            "low": found.low / unit.si,
            "high": found.high / unit.si,
        }
        stated = report.sheet.get((channel.sensor, found.term))
        entries.append(entry if stated is None else entry | {"datasheet": stated / unit.si})
    return entries


def _missing(report: AllanReport, channel: Channel) -> list[dict[str, Any]]:
    entries = []
    for missing in sorted(channel.missing, key=lambda m: ORDER.index(m.term)):
        unit = UNITS[channel.sensor, missing.term]
        entry = {
            "sensor": channel.sensor,
            "axis": channel.axis,
            "term": missing.term,
            "needs_h": needs_hours(missing),
            "upper": missing.upper / unit.si,
            "unit": unit.name,
        }
        stated = report.sheet.get((channel.sensor, missing.term))
        entries.append(entry if stated is None else entry | {"datasheet": stated / unit.si})
    return entries


def needs_hours(missing: Missing) -> float | None:
    """How long the record must be [h]; None if no length would do."""
    return None if missing.needed is None else missing.needed / HOUR


def _curve(channel: Channel) -> dict[str, Any]:
    unit = DEVIATION[channel.sensor]
    columns = {
        "deviation": channel.deviation,
        "low": channel.low,
        "high": channel.high,
        "fit": channel.fitted(channel.tau),
    }
    return {
        "sensor": channel.sensor,
        "axis": channel.axis,
        "unit": unit.name,
        "tau_s": channel.tau.tolist(),
        "first_tau_s": channel.first_tau,
        "onset_s": channel.onset,
        "model_error": channel.model_error,
    } | {name: np.asarray(values / unit.si).tolist() for name, values in columns.items()}
