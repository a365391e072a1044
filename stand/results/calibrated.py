"""A unit's constant errors, of `stand.calibrate`, that print themselves."""

from collections.abc import Sequence
from os import PathLike
from pathlib import Path

from stand.calibration.file import CalibrationRecord, calibration_text
from stand.folder import refuse_files, write_file
from stand.report import calibration as calibration_report
from stand.report.notebook import Shown
from stand.report.tables import TableData


class Calibrated(Shown, CalibrationRecord):
    """A unit's constant errors, of `stand.calibrate`; `save` writes `calibration.json`."""

    __slots__ = ()

    def headline(self) -> str:
        return calibration_report.headline(self)

    def tables(self) -> Sequence[TableData]:
        return calibration_report.tables(self)

    def remarks(self) -> Sequence[str]:
        return calibration_report.remarks(self)

    def save(self, path: str | PathLike[str], *, force: bool = False) -> Path:
        """Write it as JSON; `StandError` where something is there and not `force`."""
        refuse_files([Path(path)], force=force)
        return write_file(Path(path), calibration_text(self))
