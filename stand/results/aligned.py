"""Estimates of `stand.align`, that print themselves."""

from collections.abc import Sequence

from stand.evaluation.aligned import Alignment
from stand.report.document import ANGLE_NOTE, refusal_lines, score_tables
from stand.report.notebook import Shown
from stand.report.tables import TableData
from stand.report.windows import windows_table


class Aligned(Shown, Alignment):
    """Estimates of `stand.align`."""

    __slots__ = ()

    def headline(self) -> str:
        n = len(self.scores)
        told = "1 estimate" if n == 1 else f"{n} estimates"
        return f"{told} from {', '.join(log.path for log in self.logs)}"

    def tables(self) -> Sequence[TableData]:
        more = [windows_table(self.windows)] if self.windows else []
        return [*score_tables(self.scores, self.imu, self.noise_only, self.unstated), *more]

    def remarks(self) -> Sequence[str]:
        return [*refusal_lines(self.refusals), ANGLE_NOTE]
