"""The samples of any log as a review: all of it, or a stretch at full rate."""

from math import isfinite
from pathlib import Path

import numpy as np

from alignment import ImuReadings
from alignment.errors import Fault
from alignment.readings import EDGE
from alignment.rests import Found, find_stretches
from stand.errors import StandError
from stand.folder import file_beside
from stand.recording.curves import Phase
from stand.recording.log import Log
from stand.recording.metadata import recorded_steps


def write_review(log: Log, out: Path, t_from: float | None, t_to: float | None) -> str:
    """Write the samples of a log from `t_from` to `t_to` [s] (ends: None) as an .rrd.

    Returns
    -------
    str
        What was written, in one line.

    Raises
    ------
    StandError
        No sample lies there; the file cannot be written or does not end in .rrd.
    """
    from stand.recording.review.excerpt import write_excerpt  # rerun takes its time to import

    if out.suffix != ".rrd":
        raise StandError(f"--out {out}: must end in .rrd")
    readings = _between(log, t_from, t_to)
    name = f"{log.path}, {readings.t[0]:.3f} to {readings.t[-1]:.3f} s"
    with file_beside(out) as beside:
        m = write_excerpt(beside, name, readings, _phases(log, readings))
    rate = "every sample" if m == 1 else f"two rows of {m} samples: a shorter stretch shows all"
    return f"{name}: {len(readings)} samples, {rate}"


def _between(log: Log, t_from: float | None, t_to: float | None) -> ImuReadings:
    for name, value in (("from", t_from), ("to", t_to)):
        if value is not None and not isfinite(value):
            raise StandError(f"--{name} {value}: must be a number of seconds")
    r = log.readings
    a = float(r.t[0]) if t_from is None else t_from
    b = float(r.t[-1]) if t_to is None else t_to
    first, last = np.searchsorted(r.t, a - EDGE), np.searchsorted(r.t, b + EDGE, "right")
    inside = slice(int(first), int(last))
    if last <= first:
        raise StandError(
            f"{log.path}: from {a:g} to {b:g} s: must hold samples of the recording's "
            f"{r.t[0]:.3f} to {r.t[-1]:.3f} s"
        )
    return ImuReadings(r.t[inside], r.w_ib_b[inside], r.f_b[inside])


def _phases(log: Log, shown: ImuReadings) -> list[Phase]:
    """The steps of a recording of ours, or the rests of another, that lie in what is shown."""
    steps = [
        (s.t_from_s, s.t_to_s, s.kind, s.label or s.kind) for s in recorded_steps(log.imu.metadata)
    ]
    if not steps:
        steps = [(s.t_from, s.t_to, *_named(s.kind, k)) for k, s in enumerate(_found(log), 1)]
    begin, end = float(shown.t[0]), float(shown.t[-1])
    inside = [(max(a, begin), min(b, end), *rest) for a, b, *rest in steps if a < end and b > begin]
    return [Phase(round(a * 1e9), round(b * 1e9), *words) for a, b, *words in inside]


def _named(kind: str, number: int) -> tuple[str, str]:
    return ("dwell", f"rest {number}") if kind == "rest" else ("rate", f"turn {number}")


def _found(log: Log) -> list[Found]:
    try:
        return find_stretches(log.readings)
    except Fault:
        return []
