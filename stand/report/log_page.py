"""Any log to look at: what can be said of it without a procedure, as one page."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from alignment import DEFAULT_METHOD, AttitudeEstimate, Dwell
from alignment.errors import Fault
from alignment.estimate import ANGLES
from alignment.options import SENSORS
from alignment.units import DEG, DEG_PER_HOUR
from stand.arguments import site_with
from stand.evaluation.aligned import Alignment, align
from stand.evaluation.allan import analyse
from stand.evaluation.score import Refusal, Truths
from stand.folder import refuse_files, write_file
from stand.imu import load_imu
from stand.recording.found_stretches import FoundStretches, stretches_of
from stand.recording.log import Log
from stand.report.allan import picture
from stand.report.allan import tables as allan_tables
from stand.report.document import ANGLE_NOTE, refusal_lines, score_tables
from stand.report.figures import channels
from stand.report.judged import Judged
from stand.report.page import data_uri, render, span_text
from stand.report.stretches import stretches_table

_YEAR_1990 = 631_152_000 * 10**9  # ns: stamps before it are no date


def write_log_page(
    log: Log,
    out: Path | None = None,
    *,
    imu: str | None = None,
    latitude_deg: float | None = None,
    force: bool = False,
) -> Path:
    """Write the page of a log.

    Parameters
    ----------
    log : Log
        Where its stretches were named, those are shown.
    out : Path, optional
        The file to write; without it NAME_report.html beside the log.
    imu : str, optional
        Whose data sheet enters the sigmas, and stands beside the noise.
    latitude_deg : float, optional
    force : bool
        Replace a page that is there.

    Raises
    ------
    StandError
        A page is there (and not `force`); the file cannot be written; no such latitude or unit.
    """
    path = Path(log.path)
    target = out or path.with_name(f"{path.stem}_report.html")
    refuse_files([target], force=force)
    return write_file(target, page(log, imu, latitude_deg))


def page(log: Log, imu: str | None = None, latitude_deg: float | None = None) -> str:
    """The page of a log: HTML that needs nothing else."""
    latitude = site_with(log.site, latitude_deg, None).latitude
    if imu is not None:
        load_imu(imu)  # a name that is none is no matter of the readings
    found = stretches_of(log)
    rests = _rests(log, found)
    answer, refusals = _aligned(rests, imu, latitude_deg)
    flags = {flag for s in answer.scores for flag in s.estimate.flags} if answer else set()
    doubts = tuple(d for d in log.doubts if d not in flags)
    content = {
        "name": Path(log.path).name,
        "path": log.path,
        "subtitle": f"Topic {log.topic}" if log.topic else "Samples of one IMU",
        "facts": _facts(log, latitude),
        "verdict": _verdict(answer, refusals, doubts),
        "channels": channels(log.readings, [(d.t_from, d.t_to) for d in rests.dwells]),
        "stretches": stretches_table(found),
        "refusals": refusal_lines(refusals),
        "tables": score_tables(answer.scores, answer.imu, answer.noise_only) if answer else [],
        "angle_note": ANGLE_NOTE,
        "noise": _noise(log, rests, imu),
    }
    return render("log.html.j2", content)


_ONLY = {
    frozenset(): "",
    frozenset(SENSORS): " (±: of noise only)",
    frozenset({"gyro"}): " (± of heading: of noise only)",
    frozenset({"accel"}): " (± of roll and pitch: of noise only)",
}


def _verdict(
    answer: Alignment | None, refusals: Sequence[Refusal], doubts: Sequence[str]
) -> Judged:
    """What was found in one sentence, or why nothing was; then what speaks against it."""
    scores = answer.scores if answer is not None else []
    answered = [s.estimate for s in scores if _found(s.estimate)]
    if not answered:
        return Judged("bad", "NO ATTITUDE", (*refusal_lines(refusals)[:1], *doubts))
    longest = max(answered, key=lambda e: e.t_to - e.t_from)
    only = frozenset() if answer is None else answer.noise_only
    sentence = f"Of the longest stretch: {_found(longest)}{_ONLY[only]}."
    if doubts:
        return Judged("open", "FOUND, WITH DOUBTS", (sentence, *doubts))
    return Judged("good", "ATTITUDE FOUND", (sentence,))


def _found(e: AttitudeEstimate) -> str:
    """'rest 1, 50 s: heading 22.8° ± 0.3°, by triad'; '' of an estimate without an attitude."""
    if e.C_nb is None or e.angles is None:
        return ""
    over = f"{e.label}, {span_text(e.t_to - e.t_from)}"
    told = [("heading", e.heading, e.heading_sigma)] if e.heading is not None else []
    sigmas = [None] * 3 if e.sigmas is None else e.sigmas.tolist()
    told += [(ANGLES[k], float(e.angles[k]), sigmas[k]) for k in (0, 2)]
    words = [_angle(*one) for one in told if one[1] is not None and np.isfinite(one[1])]
    return f"{over}: {', '.join(words)}, by {e.method}" if words else ""


def _angle(name: str, value: float, sigma: float | None) -> str:
    if sigma is None or not np.isfinite(sigma) or sigma <= 0:
        return f"{name} {value / DEG:.4g}°"
    digits = max(0, 1 - int(np.floor(np.log10(sigma / DEG))))
    return f"{name} {value / DEG:.{digits}f}° ± {sigma / DEG:.{digits}f}°"


def _facts(log: Log, latitude: float | None) -> list[tuple[str, str]]:
    r = log.readings
    first = int(log.imu.t_ns[0])
    date = datetime.fromtimestamp(first / 1e9, UTC).strftime("%Y-%m-%d %H:%M UTC")
    rate = float(np.linalg.norm(r.w_ib_b.mean(axis=0))) / DEG_PER_HOUR
    return [
        *([("begins", date)] if first >= _YEAR_1990 else []),
        ("took", span_text(float(r.t[-1] - r.t[0]) + r.interval)),
        ("readings", f"{len(r)} at {1 / r.interval:.6g} Hz"),
        ("longest step", f"{1e3 * float(np.diff(r.t).max()):.3g} ms"),
        ("mean rate", f"{rate:.4g} deg/h"),
        ("mean specific force", f"{np.linalg.norm(r.f_b.mean(axis=0)):.5g} m/s²"),
        ("latitude", "unknown" if latitude is None else f"{latitude / DEG:g}°"),
    ]


def _rests(log: Log, found: FoundStretches) -> Log:
    """The log with the stretches that it has, or else those that were found at rest."""
    if len(log.dwells) != 1 or any(dwell.nominal is not None for dwell in log.dwells):
        return log
    dwells = tuple(
        Dwell(f"rest {k}", one.t_from, one.t_to, log.readings)
        for k, one in enumerate(found.found, start=1)
        if one.kind == "rest"
    )
    return replace(log, dwells=dwells, truths=(Truths(),) * len(dwells))


def _aligned(
    log: Log, imu: str | None, latitude_deg: float | None
) -> tuple[Alignment | None, list[Refusal]]:
    """What the log's methods make of it, and why others do not."""
    if not log.dwells:
        return None, [Refusal(DEFAULT_METHOD, "nothing is at rest")]
    try:
        found = align([log], imu=imu, latitude_deg=latitude_deg)
    except Fault as error:
        return None, [Refusal(", ".join(log.methods), str(error))]
    return found, list(found.refusals)


def _noise(log: Log, rests: Log, imu: str | None) -> dict[str, Any]:
    """Allan analysis of the longest rest, or why there is none."""
    still = [d for d in rests.dwells if d.turn is None]
    if not still:
        return {"refused": "No Allan analysis: nothing is at rest."}
    longest = max(still, key=lambda d: d.t_to - d.t_from)
    try:
        report = analyse(log.imu, None, longest.t_from, longest.t_to, imu)
    except Fault as error:
        return {"refused": f"No Allan analysis: {error}"}
    lead = f"Allan deviation over “{longest.label}”, {longest.t_from:.2f} to {longest.t_to:.2f} s."
    return {
        "refused": "",
        "lead": lead,
        "light": data_uri(picture(report, "light")),
        "dark": data_uri(picture(report, "dark")),
        "tables": allan_tables(report),
    }
