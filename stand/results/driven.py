"""What `stand.drive` left behind, that prints itself."""

from collections.abc import Sequence

from stand.evaluation.drive_result import DriveResult
from stand.report import vectors
from stand.report.notebook import Shown
from stand.report.tables import TableData


class Driven(Shown, DriveResult):
    """What `stand.drive` left behind."""

    __slots__ = ()

    def headline(self) -> str:
        s = self.settings
        return (
            f"{s.drive.title}: {s.imu.title}, seed {s.seed}, {self.samples} samples at "
            f"{s.rate_hz} Hz, {len(self.fixes)} fixes; recorded in {self.out}"
        )

    def tables(self) -> Sequence[TableData]:
        return [vectors.table(self)]
