"""Logs without a unit's errors: what `stand apply` writes, and what `stand align` takes."""

import json
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path

import numpy as np

from alignment import ImuReadings, Priors
from alignment.calibration import Calibration, correct
from stand.bounds import COLDEST_C, HOTTEST_C
from stand.calibration.file import CalibrationRecord, load_calibration, record_to_json
from stand.errors import StandError, located
from stand.folder import file_beside, refuse_files
from stand.imu.by_value import FIELDS
from stand.recording.entrance import Progress, log_file, origin_of, read_imu, unseen
from stand.recording.hashes import sha256_of_file, sha256_of_text
from stand.recording.log import Log
from stand.recording.log_form import LogForm
from stand.recording.mcap.reader import ImuLog
from stand.recording.mcap.writer import write_imu_log
from stand.recording.metadata import RUN
from stand.versions import VERSION

APPLIED = "correction"  # the record of what was taken out
_KEPT = ("site", "imu", "unit")  # records of a recording of ours that stay true


@dataclass(frozen=True, slots=True, eq=False)
class CorrectedLog:
    """A log whose readings were corrected: where it lies, and what was done."""

    out: Path
    log: ImuLog
    calibration: Calibration


def applied(
    calibration: str | PathLike[str] | CalibrationRecord,
    path: str | PathLike[str],
    out: str | PathLike[str],
    form: LogForm | None = None,
    *,
    topic: str | None = None,
    temperature_C: float | None = None,
    force: bool = False,
    progress: Progress = unseen,
) -> CorrectedLog:
    """Write a log of any kind as an MCAP of corrected readings.

    Parameters
    ----------
    calibration : path or CalibrationRecord
    path : path
        As `open_log` takes it.
    out : path
        The MCAP to write.
    form : LogForm, optional
    topic : str, optional
    temperature_C : float, optional
        Of the unit during the log, where the calibration has terms of temperature.
    force : bool
        Replace what is there.
    progress : callable

    Raises
    ------
    StandError
        `out` is there (and not `force`) or is the log itself; the log was corrected already; the
        calibration is of other axes.
    AlignmentError
        Not a unit that this calibration can be of.
    """
    record, file, target = loaded(calibration), log_file(path), Path(out)
    refuse_files([target], force=force)
    if target.is_dir() or (target.exists() and file.exists() and target.samefile(file)):
        raise StandError(f"--out {target}: must be a new file")
    log = read_imu(path, topic, form, progress)
    check_axes(record, form or LogForm(), str(path))
    t = (log.t_ns - origin_of(log)) * 1e-9
    with located(path):
        if APPLIED in log.metadata:
            raise StandError("was corrected already, by the calibration in its metadata")
        if len(log) < 2:
            raise StandError(f"one IMU message on {log.topic}, at least 2 are needed")
        sampling = (form or LogForm()).metadata(log.metadata.get(RUN, {}))
        read = ImuReadings(t, log.w_ib_b, log.f_b, instants=bool(sampling))
        readings = corrected(record, read, temperature_C)
    text = json.dumps(record_to_json(record), sort_keys=True)
    metadata = {
        RUN: {
            "source": file.name,
            "topic": log.topic,
            "epoch_ns": str(origin_of(log)),
            "stand_version": VERSION,
        }
        | sampling,
        APPLIED: {
            "json": text,
            "sha256": sha256_of_text(text),
            "source_sha256": sha256_of_file(file),
        },
    } | {name: dict(log.metadata[name]) for name in _KEPT if name in log.metadata}
    with file_beside(target) as beside:
        write_imu_log(
            beside,
            t_ns=log.t_ns,
            w_ib_b=readings.w_ib_b,
            f_b=readings.f_b,
            epoch_ns=0,
            metadata=metadata,
        )
    return CorrectedLog(
        target, replace(log, w_ib_b=readings.w_ib_b, f_b=readings.f_b), record.calibration
    )


def loaded(calibration: str | PathLike[str] | CalibrationRecord) -> CalibrationRecord:
    """A calibration as it is, or read from its file."""
    if isinstance(calibration, CalibrationRecord):
        return calibration
    if not isinstance(calibration, str | PathLike):
        raise StandError(f"calibration = {calibration!r}: must be a path or of stand.calibrate")
    return load_calibration(calibration)


def check_axes(record: CalibrationRecord, form: LogForm, path: str) -> None:
    """`StandError` where a log is read by other axes than the calibration's was."""
    theirs = form.axes or ""
    if record.axes != theirs:
        said, must = (f"--axes {a}" if a else "no --axes" for a in (theirs, record.axes))
        raise StandError(f"{path}: read with {said}, the calibration was made with {must}")


def corrected(
    record: CalibrationRecord, readings: ImuReadings, temperature_C: float | None = None
) -> ImuReadings:
    """The readings without the unit's errors.

    Raises
    ------
    StandError
        Terms of temperature, and nobody says it.
    AlignmentError
        Not a unit that this calibration can be of.
    """
    calibration = record.calibration
    by_warmth = any(k.term.startswith("temperature") for k in calibration.keys)
    if by_warmth and temperature_C is None:
        raise StandError(
            "the calibration has terms of temperature: give --temperature C of the unit"
        )
    if temperature_C is not None and not COLDEST_C <= temperature_C <= HOTTEST_C:
        raise StandError(
            f"temperature = {temperature_C:g} C: must be {COLDEST_C:g} to {HOTTEST_C:g}"
        )
    warmth = 0.0 if temperature_C is None else temperature_C - calibration.reference_temperature
    return correct(calibration, readings, warmth)


def corrected_log(record: CalibrationRecord, log: Log) -> Log:
    """A log as estimators take it, its readings corrected.

    Raises
    ------
    StandError
        The log was corrected already.
    """
    with located(log.path):
        if APPLIED in log.imu.metadata:
            raise StandError("was corrected already, by the calibration in its metadata")
        dwells = tuple(replace(d, readings=corrected(record, d.readings)) for d in log.dwells)
        readings = corrected(record, log.readings)
    return replace(log, dwells=dwells, readings=readings)


def posterior(calibration: Calibration, priors: Priors) -> Priors:
    """What is known of a unit after its calibration, of noise and table as before.

    A sigma of a term is the root mean square of those of its parameters. What drifts (instability)
    stays; a term that the calibration does not hold stays as it was.
    """
    found: dict[str, float] = {}
    for sensor in ("gyro", "accel"):
        for term, name in FIELDS.items():
            own = [
                p.sigma
                for p in calibration.parameters
                if (p.key.sensor, p.key.term) == (sensor, term)
            ]
            if own and hasattr(priors, f"{sensor}_{name}"):
                found[f"{sensor}_{name}"] = float(np.sqrt(np.mean(np.square(own))))
        for quantity, name in _ANGLES.items():
            own = [
                d.sigma for d in calibration.derived if (d.sensor, d.quantity) == (sensor, quantity)
            ]
            if own:
                found[f"{sensor}_{name}"] = float(np.sqrt(np.mean(np.square(own))))
    return replace(priors, **found)


_ANGLES = {"rotation": "misalignment", "non_orthogonality": "non_orthogonality"}
