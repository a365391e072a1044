"""Allan analysis of a recording: its rest, its data sheet, the result in a data sheet's units."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from math import ceil, floor, inf, isfinite, sqrt
from pathlib import Path
from typing import Any

import numpy as np

from alignment import ImuReadings
from alignment.allan import Analysis, Channel, MissingTerm
from alignment.allan import analyse as analyse_readings
from alignment.allan.deviation import FEWEST
from alignment.allan.fit import MEMORY
from alignment.allan.terms import KEYS
from alignment.errors import AlignmentError, NotAtRest
from alignment.noise import check_rest, longest_rest
from alignment.units import (
    ARC_SECOND,
    DEG,
    DEG_PER_HOUR,
    DEG_PER_RT_HOUR,
    M_S_PER_RT_HOUR,
    MICRO_G,
    MILLI_G,
)
from stand.errors import StandError, located
from stand.evaluation.plausible import force_slip, rate_slip
from stand.imu import ImuSpec, TriadSpec, load_imu
from stand.recording.entrance import read_imu
from stand.recording.mcap.reader import ImuLog
from stand.recording.metadata import (
    RUN,
    epoch_of,
    interrupted_at,
    planned_stretches,
    recorded_imu,
    settled_stretches,
)

HOUR = 3600.0
RT_HOUR = 60.0  # root seconds in a root hour


@dataclass(frozen=True, slots=True)
class TermUnit:
    """How a term is written: multiply by `si` to come in, divide to go out."""

    name: str
    si: float


UNITS: Mapping[tuple[str, str], TermUnit] = {
    ("gyro", "N"): TermUnit("deg/rt-h", DEG_PER_RT_HOUR),
    ("gyro", "B"): TermUnit("deg/h", DEG_PER_HOUR),
    ("gyro", "K"): TermUnit("deg/h/rt-h", DEG_PER_HOUR / RT_HOUR),
    ("gyro", "Q"): TermUnit("arc second", ARC_SECOND),
    ("gyro", "R"): TermUnit("deg/h/h", DEG_PER_HOUR / HOUR),
    ("accel", "N"): TermUnit("m/s/rt-h", M_S_PER_RT_HOUR),
    ("accel", "B"): TermUnit("ug", MICRO_G),
    ("accel", "K"): TermUnit("ug/rt-h", MICRO_G / RT_HOUR),
    ("accel", "Q"): TermUnit("m/s", 1.0),
    ("accel", "R"): TermUnit("ug/h", MICRO_G / HOUR),
}
ORDER = ("N", "B", "K", "Q", "R")
STEPS = {"gyro": TermUnit("deg/s", DEG), "accel": TermUnit("mg", MILLI_G)}
ROUNDING_SHOWN = 0.1  # of N: less white noise of the rounding is not worth a word
DEVIATION = {"gyro": TermUnit("deg/h", DEG_PER_HOUR), "accel": TermUnit("ug", MICRO_G)}


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
    path: Path | ImuLog,
    topic: str | None = None,
    t_from: float | None = None,
    t_to: float | None = None,
    imu: str | None = None,
    terms: Iterable[str] = (),
) -> AllanReport:
    """Allan analysis of a recording at rest, ours or any log with sensor_msgs/msg/Imu.

    Parameters
    ----------
    path : Path or ImuLog
        A file, or what was read from it.
    topic : str or None
        See `LogFile.imu`.
    t_from, t_to : float or None
        The stretch to use [s], counted as `load_log` does; without either, all rests of a
        recording of ours together, all of any other.
    imu : str or None
        A preset whose values are put beside the measured ones; else the one in the recording.
    terms : iterable of str
        Terms to insist on.

    Raises
    ------
    StandError
        The file, stretch or preset is not right.
    AlignmentError
        Not at rest, at full scale, or too short for an analysis or for a term of `terms`.
    """
    log = path if isinstance(path, ImuLog) else read_imu(path, topic)
    path = Path(log.path)
    spec = load_imu(imu) if imu else _recorded_imu(path, log)
    sheet = sheet_of(spec) if spec else {}
    known = {"gyro": spec.gyro.bandwidth, "accel": spec.accel.bandwidth} if spec else {}
    rests, notes = _rests(path, log, t_from, t_to, spec.ranges if spec else (inf, inf))
    try:
        result = analyse_readings(rests, sheet, terms, known)
    except NotAtRest as error:
        raise NotAtRest(f"{path}: {error}; {_advice(rests)}") from error
    except AlignmentError as error:
        raise type(error)(f"{path}: {error}") from error
    title = f"{spec.title} ({spec.id})" if spec else None
    notes += [*_interrupted(log), *_notes(result, known)]
    return AllanReport(str(path), log.topic, result, sheet, sheet_title=title, notes=tuple(notes))


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
    with located(path):
        return recorded_imu(log.metadata)


def _rests(
    path: Path,
    log: ImuLog,
    t_from: float | None,
    t_to: float | None,
    ranges: tuple[float, float],
) -> tuple[list[ImuReadings], list[str]]:
    """The samples to use, rest by rest, and what to say of the choice."""
    with located(path):
        ours = "epoch_ns" in log.metadata.get(RUN, {})
        origin = epoch_of(log.metadata) if ours else int(log.t_ns[0])
    t = (log.t_ns - origin) * 1e-9
    t.flags.writeable = False
    readings = ImuReadings(t, log.w_ib_b, log.f_b, ranges)
    if t_from is None and t_to is None:
        dwells = _dwells(path, log)
        if dwells:
            return _still(path, readings, dwells)
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
    return [chosen], []


Rest = tuple[str, float, float]  # its label, from when to when [s]


def _dwells(path: Path, log: ImuLog) -> list[Rest]:
    """The dwells of a recording of ours, from when the table had settled."""
    with located(path):
        stretches = settled_stretches(planned_stretches(log.metadata), log.metadata)
        end = interrupted_at(log.metadata)
    return [
        (s.label, s.t_from, min(s.t_to, end))
        for s in stretches
        if s.joint is None and s.t_from < end
    ]


def _interrupted(log: ImuLog) -> list[str]:
    end = interrupted_at(log.metadata)
    return [f"the recording was interrupted at {end:.3f} s"] if isfinite(end) else []


def _still(
    path: Path, readings: ImuReadings, dwells: list[Rest]
) -> tuple[list[ImuReadings], list[str]]:
    """The rests that are long enough and did not move; if all moved, the longest: it refuses."""
    parts = [(label, readings.between(a, b)) for label, a, b in dwells]
    enough = [part for part in parts if len(part[1]) >= FEWEST]
    if not enough:
        return [max((part for _, part in parts), key=len)], []
    moved = [label for label, part in enough if _moves(part)]
    used = [(label, part) for label, part in enough if label not in moved]
    if not used:
        return [max((part for _, part in enough), key=len)], []
    notes = [f"left out, not at rest: {', '.join(moved)}"] if moved else []
    if len(used) == 1 and len(dwells) == 1:
        return [used[0][1]], notes
    spans = ", ".join(f"{label} ({len(p) * p.interval:.4g} s)" for label, p in used)
    together = f"{len(used)} rests together: " if len(used) > 1 else "one rest: "
    return [part for _, part in used], [f"used {together}{spans}", *notes]


def _moves(part: ImuReadings) -> bool:
    try:
        check_rest(part, "")
    except NotAtRest:
        return True
    return False


def _advice(rests: list[ImuReadings]) -> str:
    """What would do: the longest rest there is."""
    found = longest_rest(max(rests, key=len))
    if found is None:
        return "choose a rest with --from and --to"
    # rounded inward, so that what is printed lies within the rest
    begin, end = ceil(found[0] * 10) / 10, floor(found[1] * 10) / 10
    return f"choose a rest with --from and --to: --from {begin:g} --to {end:g} is one"


def _notes(result: Analysis, known: Mapping[str, float]) -> list[str]:
    """What was read on average, interruptions and misfits, in words."""
    notes = [_means(result), *result.notes]
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
        spans = [f"{s.t_from:.6g} to {s.t_to:.6g} s" for s in result.stretches]
        more = f" and {len(spans) - 3} more" if len(spans) > 3 else ""
        notes.append(f"used together, without what lies between: {', '.join(spans[:3])}{more}")
    return notes + [note for c in result.channels for note in _misfits(c, known)]


def _means(result: Analysis) -> str:
    """Mean rate and specific force: whether the numbers can be those of a unit at rest on Earth."""
    rates = [float(np.linalg.norm(s.w_ib_b)) for s in result.stretches]
    forces = [float(np.linalg.norm(s.f_b)) for s in result.stretches]
    slips = (rate_slip(max(rates)), force_slip(max(forces)))
    slip = "".join(f", {told}" for told in slips if told is not None)
    return (
        f"mean rate {_span(rates, DEG_PER_HOUR, 4)} deg/h (Earth: 15.04), "
        f"mean specific force {_span(forces, 1.0, 6)} m/s^2{slip}"
    )


def _span(values: list[float], unit: float, digits: int) -> str:
    ends = (f"{min(values) / unit:.{digits}g}", f"{max(values) / unit:.{digits}g}")
    return " to ".join(dict.fromkeys(ends))


def _misfits(channel: Channel, known: Mapping[str, float]) -> list[str]:
    name = f"{channel.sensor} {channel.axis}"
    step = channel.step / STEPS[channel.sensor].si
    size = f"{step:.3g} {STEPS[channel.sensor].name}"
    if channel.constant:
        return [f"{name}: every reading is the same: dead, or its noise below a step"]
    if not channel.resolved:
        return [f"{name}: below resolution: its noise is lost in steps of {size}, N cannot be told"]
    notes = []
    if channel.rounding > ROUNDING_SHOWN * channel.values[KEYS.index("N")]:
        unit = UNITS[channel.sensor, "N"]
        notes.append(
            f"{name}: rounded to {size}: of that, N {channel.rounding / unit.si:.2g} {unit.name} "
            "is taken out"
        )
    if channel.model_error > 0:
        error = 100 * channel.model_error
        notes.append(
            f"{name}: the five terms describe the curve to {error:.2g} % only; intervals allow that"
        )
    elif channel.first_tau > channel.tau[0]:
        first = f"{name}: fitted from {channel.first_tau:.3g} s on, "
        limit = known.get(channel.sensor, inf)
        told = isfinite(limit) and channel.first_tau < 2.5 * MEMORY / limit
        notes.append(first + ("beyond its bandwidth" if told else "the start has another shape"))
    return notes


def to_json(report: AllanReport) -> dict[str, Any]:
    """The report for machines, in the units of `UNITS`; times in s, `needs_h` in hours.

    `needs_h` is None where no length would do at this rate; `upper` is the largest value that the
    record allows (95 %), None of a channel whose readings are all the same.
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
        "rests": [
            {
                "from_s": s.t_from,
                "to_s": s.t_to,
                "samples": s.samples,
                "mean_rate_deg_h": (s.w_ib_b / DEG_PER_HOUR).tolist(),
                "mean_force_m_s2": s.f_b.tolist(),
            }
            for s in result.stretches
        ],
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
            "upper": None if channel.constant else missing.upper / unit.si,
            "unit": unit.name,
            "below_resolution": not channel.resolved,
        }
        stated = report.sheet.get((channel.sensor, missing.term))
        entries.append(entry if stated is None else entry | {"datasheet": stated / unit.si})
    return entries


def needs_hours(missing: MissingTerm) -> float | None:
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
        "smoothing_s": channel.smoothing,
        "step": channel.step / unit.si,
    } | {name: np.asarray(values / unit.si).tolist() for name, values in columns.items()}
