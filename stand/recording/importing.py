"""A log of any kind made an MCAP that others read too."""

from pathlib import Path

from stand.errors import StandError
from stand.folder import file_beside, refuse_files
from stand.recording.entrance import Progress, origin_of, read_imu, unseen
from stand.recording.log_form import LogForm
from stand.recording.mcap.reader import ImuLog
from stand.recording.mcap.writer import write_imu_log
from stand.recording.metadata import RUN
from stand.versions import VERSION


def import_log(
    file: Path,
    out: Path,
    form: LogForm,
    *,
    topic: str | None = None,
    force: bool = False,
    progress: Progress = unseen,
) -> ImuLog:
    """Read a log of any kind as `read_imu` does, and write it as an MCAP.

    Raises
    ------
    StandError
        As `open_log`; `out` is there (and not `force`), is the log itself, or has no folder.
    """
    refuse_files([out], force=force)
    itself = out.exists() and file.exists() and out.samefile(file)
    if out.is_dir() or itself:
        raise StandError(f"--out {out}: must be a new file")
    if not out.parent.is_dir():
        raise StandError(f"--out {out}: no folder {out.parent}")
    log = read_imu(file, topic, form, progress)
    record = {
        "source": file.name,
        "topic": log.topic,
        "columns": form.columns or "",
        "gyro_unit": form.gyro_unit or "",
        "accel_unit": form.accel_unit or "",
        "time_unit": form.time_unit or "",
        "axes": form.axes or "",
        "epoch_ns": str(origin_of(log)),
        "stand_version": VERSION,
    } | form.metadata(log.metadata.get(RUN, {}))
    with file_beside(out) as beside:
        write_imu_log(
            beside,
            t_ns=log.t_ns,
            w_ib_b=log.w_ib_b,
            f_b=log.f_b,
            epoch_ns=0,
            metadata={RUN: record},
        )
    return log
