"""What interrupted recordings still hold, brought back: whole chunks, result, review."""

import json
import shutil
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from math import inf
from os import PathLike
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from alignment import ESTIMATORS
from alignment.arrays import Array
from alignment.errors import Fault
from alignment.quaternions import turned_evenly
from alignment.readings import EDGE
from alignment.units import DEG
from stand.errors import StandError, located
from stand.evaluation.aligned import sheet_beside
from stand.evaluation.drive_result import DriveSettings
from stand.evaluation.drive_result import result_json as drive_json
from stand.evaluation.review_curves import method_curves, method_innovations
from stand.evaluation.score import (
    Refusal,
    Score,
    evaluate_each,
    refusal_to_json,
    score_to_json,
    spread_to_json,
    spreads,
)
from stand.folder import (
    RECORDINGS,
    file_beside,
    folder_beside,
    left_behind,
    left_of,
    write_file,
)
from stand.imu import unstated
from stand.imu.priors import noise_alone
from stand.motion.planner import plan
from stand.motion.polynomial import Motion, MotionKind
from stand.physics.mjcf import describe, load_model
from stand.procedure.procedure import procedure_from
from stand.recorded_drive import PICTURE, DriveSamples, drawn, solved
from stand.recording.attached_model import attached_model
from stand.recording.content import MCAP, kind_of
from stand.recording.curves import Phase
from stand.recording.log import Log, load_log
from stand.recording.mcap.reader import read_truth
from stand.recording.mcap.rebuild import Rebuilt, examine, rebuild
from stand.recording.mcap.records import opened
from stand.recording.mcap.replay import replayed
from stand.recording.metadata import (
    DRIVE,
    INTERRUPTED,
    MODEL_FOLDER,
    NEVER,
    RUN,
    SETTLED,
    Metadata,
    epoch_of,
    interrupted_at,
    planned_stretches,
    recorded_steps,
)
from stand.recording.reviewing import MISSING, open_review
from stand.report.document import files_document, score_tables, verdict_document
from stand.samples import CHANNELS, TruthBlock
from stand.simulation.step_record import followed_steps, record_to_json
from stand.table.joints import StandModel
from stand.table.kinematics import C_NW
from stand.table.table import table_from
from stand.toml_files import Source
from stand.vehicle.scenario import drive_from

RECORD, REVIEW, RESULT = "run.mcap", "run.rrd", "result.json"
NOTHING = "holds no whole second of samples"
DELETE = f"{NOTHING}: delete it"  # said of what a run left, never of a file of somebody's own


@dataclass(frozen=True, slots=True)
class Recovered:
    """What became of something that an interrupted writer left.

    Attributes
    ----------
    found : Path
    out : Path or None
        Where it is now; None: it stays where it was found, for the `reason`.
    until : float or None
        Its last sample [s], counted as its recording does; None where there are no samples.
    files : tuple of str
        What `out` holds.
    lost : tuple of str
        Stretches that are not whole, and why, a line each.
    reason : str
        Why it stays, or what there is to say of it.
    """

    found: Path
    out: Path | None
    until: float | None = None
    files: tuple[str, ...] = ()
    lost: tuple[str, ...] = ()
    reason: str = ""

    def lines(self) -> list[str]:
        """The same for a person."""
        if self.out is None:
            return [f"{self.found}: {self.reason}"]
        until = "" if self.until is None else f" until {self.until:.3f} s"
        files = f": {', '.join(self.files)}" if self.files else ""
        return [f"{self.out}{until}{files} {self.reason}".rstrip(), *self.lost]


def recover(place: str | PathLike[str] | None = None) -> list[Recovered]:
    """Bring back what interrupted recordings hold.

    Parameters
    ----------
    place : path, optional
        A folder in which they lie (without it that of the recordings), the target of one, what
        was left of one, or an MCAP file that is cut off. Who is still at work is left alone.

    Returns
    -------
    list of Recovered
        One for each, in order of their names. What is brought back lies where it was to be, or
        under the next free name; what it was made of is gone then.

    Raises
    ------
    StandError
        `place` is not there, or is no recording that was interrupted.
    """
    path = RECORDINGS if place is None else Path(place)
    if path.is_file() and not path.name.endswith(".partial"):
        return [_of_file(path)]
    found = left_behind(path) if path.is_dir() else []
    if not found:
        beside = left_behind(path.parent)
        found = [left for left in beside if left.path.name == path.name] or left_of(path)
    if not found and place is not None and not path.is_dir():
        raise StandError(f"{path}: no such folder, and nothing of an interrupted run of this name")
    answers = []
    for left in found:
        try:
            if left.replaced:
                out = _free(left.target)
                left.path.rename(out)
                answers.append(Recovered(left.path, out, reason="(what was to be replaced)"))
            elif left.path.is_dir():
                answers.append(_of_folder(left.path, left.target))
            else:
                answers.append(_of_file(left.path, left.target))
        except Fault as error:
            answers.append(Recovered(left.path, None, reason=str(error)))
    return answers


def _free(target: Path) -> Path:
    """The target, or where something is there already the next free name beside it."""
    names = [target.stem, f"{target.stem}-recovered"]
    number = 0
    while True:
        name = names[number] if number < 2 else f"{names[1]}-{number}"
        path = target.with_name(name + target.suffix)
        if not path.exists() and not path.is_symlink():
            return path
        number += 1


def _of_file(path: Path, target: Path | None = None) -> Recovered:
    """A recording that is one file: an import, or any MCAP that is cut off, which stays."""
    if target is None and kind_of(path) != MCAP:
        raise StandError(f"{path}: not an MCAP file: only those can be brought back")
    if target is None and _is_whole(path):
        raise StandError(f"{path}: is whole: nothing to recover")
    found = _examined(path)
    if found is None:
        return Recovered(path, None, reason=NOTHING if target is None else DELETE)
    out = _free(target or path)
    with file_beside(out) as beside:
        rebuild(path, beside, _marks(found))
    if target is not None:
        path.unlink()
    return Recovered(path, out, until=_until(found))


def _is_whole(path: Path) -> bool:
    with suppress(StandError):
        opened(path).close()
        return True
    return False


def _examined(path: Path) -> Rebuilt | None:
    """What is whole of a file; None where that is nothing worth a recording."""
    try:
        found = examine(path)
    except StandError:
        return None
    until = _until(found)
    return found if found.messages and (until is None or until > 0) else None


def _until(found: Rebuilt) -> float | None:
    """The last message, counted from the epoch that the recording states [s]."""
    if "epoch_ns" not in found.metadata.get(RUN, {}):
        return None
    return (found.last_ns - epoch_of(found.metadata)) * 1e-9


def _marks(found: Rebuilt) -> dict[str, dict[str, str]]:
    """The metadata records that say of a recording what is missing."""
    until = _until(found)
    if found.finished or until is None:
        return {}
    marks = {INTERRUPTED: {"t_s": repr(until)}}
    if found.metadata.get(RUN, {}).get("motion") == MotionKind.SERVO.value:
        known = found.metadata.get(SETTLED, {})
        ends = {s.label: s.t_to for s in planned_stretches(found.metadata)}
        unknown = {k: NEVER for k, end in ends.items() if end > until + EDGE and k not in known}
        marks[SETTLED] = {**unknown, **known}
    return marks


def _of_folder(path: Path, target: Path) -> Recovered:
    """A run or a drive."""
    found = _examined(path / RECORD)
    if found is None:
        return Recovered(path, None, reason=DELETE)
    out = _free(target)
    with folder_beside(out) as beside:
        with located(path):
            rebuild(path / RECORD, beside / RECORD, _marks(found))
            log = load_log(beside / RECORD, None, None, None)
            reason = _add_result(log, beside)
        files = tuple(sorted(file.name for file in beside.iterdir()))
    shutil.rmtree(path, ignore_errors=True)
    lost = tuple(f"{r.stretch}: {r.reason}" for r in log.lost)
    return Recovered(path, out, until=_until(found), files=files, lost=lost, reason=reason)


def _add_result(log: Log, folder: Path) -> str:
    """Estimates of the stretches that are whole, of a run its review and of a drive its picture;
    what is missing, and why.
    """
    metadata = log.imu.metadata
    methods = [name for name in log.methods if name in ESTIMATORS]
    scores, refused = evaluate_each(log.dwells, log.truths, log.site, log.options, methods)
    refusals = [*log.lost, *refused]
    saturated, missing, own = np.zeros(len(CHANNELS), int), [], {}
    if DRIVE in metadata:
        own, missing = _add_drive(log, folder)
    elif "procedure" in metadata[RUN]:
        saturated, missing = _add_review(log, scores, refusals, folder / REVIEW)
        until = interrupted_at(metadata) + EDGE
        steps = followed_steps(log.path, metadata)
        own["steps"] = [record_to_json(step) for step in steps if step.t_to <= until]
    told = _result_json(log, scores, refusals, saturated.tolist())
    answer = told | own | {"interrupted_at_s": told["interrupted_at_s"], "missing": missing}
    answer["versions"] = told["versions"]  # who recorded it, not who brings it back
    write_file(folder / RESULT, json.dumps(answer, indent=1, allow_nan=False) + "\n")
    return f"({'; '.join(missing)})" if missing else ""


def _add_drive(log: Log, folder: Path) -> tuple[dict[str, Any], list[str]]:
    """What `stand drive` says of a drive, of the fixes that are left, and its picture."""
    run, dwell = log.imu.metadata[RUN], log.dwells[0]
    try:
        text = log.imu.metadata[DRIVE].get("toml", "")
        drive = drive_from(Source(run.get("drive", ""), log.path, text))
        imu = sheet_beside(log.imu.metadata)
        if imu is None or dwell.fixes is None or dwell.nominal is None:
            raise StandError("its unit, fixes or start are not in the recording")
        settings = DriveSettings(drive, imu, int(run["rate_hz"]), int(run["seed"]))
        result = solved(settings, DriveSamples(log.readings, dwell.fixes, dwell.nominal), folder)
        until = interrupted_at(log.imu.metadata)
        note = f", interrupted at {until:.0f} s" if until < inf else ""
        write_file(folder / PICTURE, drawn(result, note))
    except (Fault, KeyError, ValueError) as error:
        reason = str(error).removeprefix(f"{log.path}: ")
        return {}, [f"no solutions and no {PICTURE}: {reason}"]
    return drive_json(result), []


def _result_json(
    log: Log, scores: Sequence[Score], refusals: Sequence[Refusal], saturated: Sequence[int]
) -> dict[str, Any]:
    """As `stand.evaluation.run_result.result_json`, of what the recording says."""
    metadata = log.imu.metadata
    run, imu, until = metadata[RUN], sheet_beside(metadata), interrupted_at(metadata)
    names = ("procedure", "drive", "imu", "table", "sampling", "motion")
    site = log.site
    steps = recorded_steps(metadata)
    return {
        **{name: run[name] for name in names if name in run},
        **{name: int(run[name]) for name in ("seed", "rate_hz") if run.get(name, "").isdigit()},
        "latitude_deg": None if site.latitude is None else site.latitude / DEG,
        "height_m": site.height,
        "gravity_m_s2": site.gravity,
        "duration_s": max((step.t_to_s for step in steps), default=None),
        "interrupted_at_s": None if until == inf else until,
        "samples": len(log.imu),
        "without": [term for term in run.get("without", "").split(",") if term],
        "saturated_samples": dict(zip(CHANNELS, saturated, strict=True)),
        "versions": {name: text for name, text in run.items() if name.endswith("_version")},
        "estimates": [score_to_json(scored, noise_alone(imu)) for scored in scores],
        "spreads": [spread_to_json(spread) for spread in spreads(scores)],
        "refusals": [refusal_to_json(r) for r in refusals],
        "unstated": [] if imu is None else list(unstated(imu)),
    }


# The review --------------------------------------------------------------------------------------


def _add_review(
    log: Log, scores: Sequence[Score], refusals: Sequence[Refusal], path: Path
) -> tuple[Array, list[str]]:
    """Write the review; how many samples of each channel were beyond their range, what it lacks."""
    metadata, file = log.imu.metadata, path.with_name(RECORD)
    model = _model(log, file)
    planned, missing = _planned(log, model)
    review = _opened_review(log, path, model, following=planned is not None)
    saturated = np.zeros(len(CHANNELS), int)
    with review as rrd:
        for truth, imu in replayed(file, epoch_of(metadata)):
            assert imu.saturated is not None
            saturated += imu.saturated.sum(axis=0)
            rrd.write(truth, imu, _following(planned, truth))
        end = interrupted_at(metadata)
        if end < inf:
            rrd.event(round(end * 1e9), "WARN", "the recording was interrupted here")
        refused = [r.method for r in refusals]
        answered = [m for m in log.methods if m in ESTIMATORS and m not in refused]
        rrd.angles(_curves(log, answered, file))
        rrd.innovations(method_innovations(answered, log.dwells, log.site, log.options))
        rrd.documents(_verdict(log, scores, refusals), files_document(_parts(metadata)))
    return saturated, missing if path.exists() else [MISSING, *missing]


def _following(planned: Motion | None, truth: TruthBlock) -> Array | None:
    """Demanded minus realised joint angles (n, 6) [rad]."""
    return None if planned is None else planned.joints(truth.t_ns * 1e-9)[0] - truth.joints


def _model(log: Log, file: Path) -> StandModel:
    own = log.imu.metadata[RUN].get("model")
    with TemporaryDirectory() as folder:
        model = None if own is None else attached_model(file, MODEL_FOLDER + own, Path(folder))
        return describe(load_model(model))


def _planned(log: Log, model: StandModel) -> tuple[Motion | None, list[str]]:
    """What the joints of a servo were told to do, which is not recorded but planned anew; or why
    it cannot be.
    """
    metadata = log.imu.metadata
    run = metadata[RUN]
    if run.get("motion") != MotionKind.SERVO.value:
        return None, []
    try:
        # without a folder in which files of its own would be found
        procedure = procedure_from(
            Source(run["procedure"], log.path, metadata["procedure"]["toml"])
        )
        table = table_from(Source(run["table"], log.path, metadata["table"]["toml"]))
        planned = plan(procedure, model, table, int(run["seed"]))
    except (StandError, KeyError, ValueError) as error:
        reason = str(error).removeprefix(f"{log.path}: ")  # which is to have another name
        return None, [f"no following error: the motion cannot be planned again: {reason}"]
    told = [(step.t_from_s, step.t_to_s) for step in recorded_steps(metadata)]
    if told != [(step.t_from, step.t_to) for step in planned.steps]:
        return None, ["no following error: this version plans the motion otherwise"]
    return planned.motion, []


def _opened_review(log: Log, path: Path, model: StandModel, *, following: bool) -> Any:
    metadata = log.imu.metadata
    run, until = metadata[RUN], float(log.imu.t_ns[-1] - epoch_of(metadata)) * 1e-9
    return open_review(
        path,
        model=model,
        run_id=f"{path.parent.name}_{log.imu.t_ns[-1]}",
        title=_title(metadata),
        duration_s=until,
        rate_hz=int(run["rate_hz"]),
        phases=_phases(metadata, until),
        w_ie_enu=C_NW.inv().apply(log.site.w_ie_n),
        properties=run,
        following=following,
        noise_only=noise_alone(sheet_beside(metadata)),
    )


def _title(metadata: Metadata) -> str:
    run = metadata[RUN]
    return f"{run['procedure']}: {run.get('imu', '')}, seed {run.get('seed', '')}, interrupted"


def _phases(metadata: Metadata, until: float) -> list[Phase]:
    """The steps as far as they went."""
    return [
        Phase(round(s.t_from_s * 1e9), round(min(s.t_to_s, until) * 1e9), s.kind, s.label)
        for s in recorded_steps(metadata)
        if s.t_from_s < until
    ]


def _curves(log: Log, answered: Sequence[str], file: Path) -> Any:
    truth = read_truth(file)
    t = (truth.t_ns - epoch_of(log.imu.metadata)) * 1e-9

    def true_at(label: str, at: Array) -> Rotation:
        return C_NW * turned_evenly(t, truth.q_wb, at)

    attitudes = [known.C_nb or Rotation.identity() for known in log.truths]
    return method_curves(answered, log.dwells, attitudes, true_at, log.site, log.options)


def _verdict(log: Log, scores: Sequence[Score], refusals: Sequence[Refusal]) -> str:
    metadata = log.imu.metadata
    head = [f"# {_title(metadata)}", "", f"{len(log.imu)} samples were whole.", ""]
    sheet = sheet_beside(metadata)
    return verdict_document(head, score_tables(scores, sheet, noise_alone(sheet)), refusals)


def _parts(metadata: Metadata) -> list[tuple[str, str, str]]:
    names = (("Procedure", "procedure"), ("IMU", "imu"), ("Table", "table"))
    return [(name, metadata[RUN].get(key, ""), metadata[key]["toml"]) for name, key in names]
