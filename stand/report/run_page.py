"""A recorded run to look at: one page with its results, errors over time, motion and sources.

The estimates are made anew from the recording, as `stand align` makes them: the page says what
the recording holds, not what was once written beside it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from alignment import ESTIMATORS
from alignment.units import DEG
from stand.arguments import site_with
from stand.errors import StandError, located
from stand.evaluation.aligned import sheet_beside
from stand.evaluation.growth import tracked
from stand.evaluation.score import evaluate_each
from stand.folder import refuse_files, write_file
from stand.imu.preset import ImuEntry
from stand.procedure.procedure import ProcedureEntry, RequireEntry
from stand.recording.attached_model import attached_model
from stand.recording.hashes import sha256_of_file, sha256_of_text
from stand.recording.log import Log, load_log
from stand.recording.metadata import DRIVE, MODEL_FOLDER, RUN, recorded_steps
from stand.report.document import (
    ANGLE_NOTE,
    motion_table,
    refusal_lines,
    score_tables,
)
from stand.report.figures import Bar, channels, errors, timeline
from stand.report.film import write_film
from stand.report.gallery import Gallery, Position, gallery
from stand.report.judged import judged
from stand.report.page import Photo, data_uri, render, span_text
from stand.report.provenance import provenance
from stand.report.tables import TableData
from stand.simulation.step_record import StepRecord, records_from_json
from stand.table.table import TableEntry
from stand.toml_files import Source, parse

PAGE = "report.html"
FILM_S, FILM_SIZE = 15.0, (800, 450)  # of a film in a page
_MOVING = ("move", "profile")
_ENTRIES = {"procedure": ProcedureEntry, "imu": ImuEntry, "table": TableEntry}


def write_run_page(
    run: Path,
    out: Path | None = None,
    *,
    log: Log | None = None,
    latitude_deg: float | None = None,
    film: bool = False,
    force: bool = False,
    progress: Callable[[float], None] = lambda done: None,
) -> Path:
    """Write the page of a recorded run.

    Parameters
    ----------
    run : Path
        Folder of `stand run`, or its `run.mcap`.
    out : Path, optional
        The file to write; without it `PAGE` in the run's folder.
    log : Log, optional
        The recording, where it has been read.
    latitude_deg : float, optional
        Of the site; else as recorded.
    film : bool
        Show the run as a film of `FILM_S` at most on the first screen.
    force : bool
        Replace a page that is there.
    progress : callable
        Told the part of the film that is drawn, 0 to 1.

    Raises
    ------
    StandError
        Not a recorded run; a page is there (and not `force`); the file cannot be written.
    """
    file = run / "run.mcap" if run.is_dir() else run
    target = out or file.with_name(PAGE)
    if target.is_dir():
        raise StandError(f"--out {target}: must be a file")
    refuse_files([target], force=force)
    log = log or load_log(file, None, None, None)
    moving = _film(log, progress) if film else None
    return write_file(target, page(file, latitude_deg, log, moving))


def page(
    file: Path,
    latitude_deg: float | None = None,
    log: Log | None = None,
    moving: Photo | None = None,
) -> str:
    """The page of a recording: HTML that needs nothing else; `moving` is its film."""
    recorded = _read(file, log)
    log, steps, run = recorded.log, recorded.steps, recorded.metadata[RUN]
    site = site_with(log.site, latitude_deg, None)
    scores, refusals = evaluate_each(
        log.dwells, log.truths, site, log.options, [m for m in log.methods if m in ESTIMATORS]
    )
    refusals = [*log.lost, *refusals]
    total = max([s["t_to_s"] for s in steps] or [d.t_to for d in log.dwells], default=0.0)
    texts = {
        key: (run.get(key, key), recorded.metadata[key]["toml"])
        for key in ("procedure", "imu", "table")
        if "toml" in recorded.metadata.get(key, {})
    }
    sheet = sheet_beside(recorded.metadata)
    content = {
        "title": recorded.title,
        "subtitle": recorded.subtitle,
        "facts": [("written", _date(file)), *_facts(run, log, total)],
        "verdict": judged(scores, refusals, recorded.require, sheet, run.get("revision", "")),
        "channels": channels(log.readings, [(d.t_from, d.t_to) for d in log.dwells]),
        "refusals": refusal_lines(refusals),
        "tables": score_tables(scores, sheet, log.options.priors.noise_only),
        "angle_note": ANGLE_NOTE if scores else "",
        "errors": _errors(log, total),
        "servo": motion_table(recorded.records) if recorded.records else None,
        "timeline": timeline([_bar(k, s) for k, s in enumerate(steps, 1)], total)
        if steps
        else None,
        "gallery": _gallery(recorded, file) if steps else None,
        "film": moving,
        "settings": _settings(run, log),
        "provenance": provenance(texts, recorded.sha256, _versions(run)),
        "path": str(file),
    }
    return render("run.html.j2", content)


@dataclass(frozen=True, slots=True, eq=False)
class _Recorded:
    """What lies in a run's folder: the log, the steps as they ran, what its files say."""

    title: str
    subtitle: str
    log: Log
    metadata: Mapping[str, Mapping[str, str]]
    steps: tuple[dict[str, Any], ...]
    records: tuple[StepRecord, ...]
    sha256: Mapping[str, str]
    require: RequireEntry | None


def _read(file: Path, log: Log | None) -> _Recorded:
    log = log or load_log(file, None, None, None)
    metadata = log.imu.metadata
    if "stand_version" not in metadata.get(RUN, {}):
        raise StandError(f"{file}: not a recording of stand run: it has no record {RUN!r}")
    beside = {name: file.with_name(name) for name in ("run.rrd", "result.json")}
    there = {file.name: file} | {name: path for name, path in beside.items() if path.is_file()}
    hashes = {name: sha256_of_file(path) for name, path in there.items()}
    for key in ("procedure", "imu", "table"):
        if "toml" in metadata.get(key, {}):
            hashes[key] = sha256_of_text(metadata[key]["toml"])
    if "model_sha256" in metadata[RUN]:
        hashes["model"] = metadata[RUN]["model_sha256"]
    return _Recorded(
        title=_title("procedure", metadata) or metadata.get(DRIVE, {}).get("id", file.stem),
        subtitle=", on ".join(filter(None, (_title(key, metadata) for key in ("imu", "table")))),
        log=log,
        metadata=metadata,
        steps=tuple(step.model_dump() for step in recorded_steps(metadata)),
        records=_records(beside["result.json"]),
        sha256=hashes,
        require=_require(metadata),
    )


def _require(metadata: Mapping[str, Mapping[str, str]]) -> RequireEntry | None:
    """What the recorded procedure requires; nothing where another version wrote it."""
    text = metadata.get("procedure", {}).get("toml", "")
    try:
        return parse(Source("procedure", "procedure", text), ProcedureEntry).require
    except StandError:
        return None


def _title(key: str, metadata: Mapping[str, Mapping[str, str]]) -> str:
    """What the recorded TOML file calls itself; else its id."""
    name, text = metadata[RUN].get(key, ""), metadata.get(key, {}).get("toml", "")
    try:
        return parse(Source(name, name, text), _ENTRIES[key]).title if text else name
    except StandError:  # recorded by another version
        return name


def _records(path: Path) -> tuple[StepRecord, ...]:
    """What the servo did, as `result.json` has it; nothing where that is not there."""
    if not path.is_file():
        return ()
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise StandError(f"{path}: cannot be read: {error}") from error
    return records_from_json(str(path), text)


# What is shown -----------------------------------------------------------------------------------


def _facts(run: Mapping[str, str], log: Log, total: float) -> list[tuple[str, str]]:
    latitude = log.site.latitude
    return [
        ("took", span_text(total)),
        ("readings", f"{run.get('rate_hz', '?')} Hz"),
        ("motion", run.get("motion", "of a vehicle")),
        ("seed", run.get("seed", "none")),
        ("latitude", "unknown" if latitude is None else f"{latitude / DEG:g}°"),
        ("height", f"{log.site.height:g} m"),
    ]


def _errors(log: Log, total: float) -> list[Any]:
    """A figure per method that has tracks, where the truth is known."""
    tracks = tracked(log, [m for m in log.methods if m in ESTIMATORS]) if log.simulated else []
    names = dict.fromkeys(track.method for track in tracks)
    groups = [[t for t in tracks if t.method == name and len(t.t_ns)] for name in names]
    alone = log.options.priors.noise_only
    return [
        errors(own[0].method, k, own, total, alone) for k, own in enumerate(filter(None, groups))
    ]


def _bar(number: int, step: Mapping[str, Any]) -> Bar:
    """A step as recorded: steady between, moving before and after."""
    t = [step["t_from_s"], step.get("steady_from_s"), step.get("steady_to_s"), step["t_to_s"]]
    if step["kind"] in _MOVING or None in t:
        name = "dwell" if step["kind"] == "dwell" else "motion"
        arrival = t[1] if step["kind"] == "move" and t[1] is not None else t[3]
        phases = [(name, t[0], arrival)]
    else:
        phases = [("motion", t[0], t[1]), ("dwell", t[1], t[2]), ("motion", t[2], t[3])]
    label = f"{number} {step['label'] or step['kind']}"
    return Bar(label, step["kind"], tuple(p for p in phases if p[2] > p[1]))


def _positions(steps: Sequence[Mapping[str, Any]]) -> list[Position]:
    return [
        Position(step["label"], np.radians(step["joints_deg"]))
        for step in steps
        if step["joints_deg"] and (step["kind"] == "dwell" or step["turning"])
    ]


def _gallery(recorded: _Recorded, file: Path) -> Gallery:
    """Pictures of the stand that was recorded: a stand of one's own is attached."""
    positions, main = _positions(recorded.steps), recorded.metadata[RUN].get("model")
    if main is None:
        return gallery(positions)
    with TemporaryDirectory() as folder, located(file):
        return gallery(positions, attached_model(file, MODEL_FOLDER + main, Path(folder)))


def _film(log: Log, progress: Callable[[float], None]) -> Photo:
    """The run as a moving picture that a page holds."""
    with TemporaryDirectory() as folder:
        made = write_film(
            log, Path(folder) / "run.webp", longest_s=FILM_S, size=FILM_SIZE, progress=progress
        )
        image = made.path.read_bytes()
    alt = f"The stand from {made.t_from:.1f} to {made.t_to:.1f} s, beside readings and estimate"
    return Photo(data_uri(image, "webp"), alt, f"{alt}; {made.speed:.3g} times its speed.")


def _date(file: Path) -> str:
    """When the file was written: a recording itself holds no date, same seed, same bytes."""
    return datetime.fromtimestamp(file.stat().st_mtime, UTC).strftime("%Y-%m-%d %H:%M UTC")


def _settings(run: Mapping[str, str], log: Log) -> TableData:
    shown = {
        "procedure": run.get("procedure"),
        "IMU": run.get("imu"),
        "table": run.get("table"),
        "samples": f"{run.get('sampling', '')} at {run.get('rate_hz', '?')} Hz",
        "error terms off": run.get("without") or "none",
        "gravity": f"{log.site.gravity:.7f} m/s²",
        "frame n": run.get("frame_n"),
        "frame b": run.get("frame_b"),
        "IMU topic": log.topic,
    }
    rows = tuple((name, str(value)) for name, value in shown.items() if value)
    return TableData(title="Settings", columns=("setting", "value"), rows=rows)


def _versions(run: Mapping[str, str]) -> dict[str, str]:
    return {key: value for key, value in run.items() if key.endswith("_version")}
