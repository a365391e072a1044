"""Two recordings beside each other, that print themselves."""

from collections.abc import Sequence

from stand.evaluation.side_by_side import SideBySide
from stand.report import side_by_side as beside_report
from stand.report.notebook import Shown
from stand.report.tables import TableData


class Beside(Shown, SideBySide):
    """Two recordings beside each other, of `stand.side_by_side`."""

    __slots__ = ()

    def headline(self) -> str:
        return beside_report.headline(self)

    def tables(self) -> Sequence[TableData]:
        return beside_report.tables(self)

    def remarks(self) -> Sequence[str]:
        return beside_report.remarks(self)
