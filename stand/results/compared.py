"""Methods side by side, that print themselves."""

from collections.abc import Sequence

from stand.evaluation.comparison import Comparison
from stand.report import compare as compare_report
from stand.report.notebook import Shown
from stand.report.tables import TableData


class Compared(Shown, Comparison):
    """Methods side by side, of `stand.compare`."""

    __slots__ = ()

    def headline(self) -> str:
        s = self.settings
        return f"{s.procedure.entry.title}: {s.imu.title}, {self.runs} runs from seed {s.seed} on"

    def tables(self) -> Sequence[TableData]:
        return [compare_report.table(self)]
