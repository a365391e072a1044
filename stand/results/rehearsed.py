"""The answer of `stand.rehearse`, that prints itself."""

from collections.abc import Sequence

from stand.rehearsal.result import Rehearsal
from stand.report import rehearsal_tables
from stand.report.notebook import Shown
from stand.report.tables import TableData


class Rehearsed(Shown, Rehearsal):
    """The answer of `stand.rehearse`."""

    __slots__ = ()

    def headline(self) -> str:
        return rehearsal_tables.headline(self)

    def tables(self) -> Sequence[TableData]:
        return rehearsal_tables.tables(self)
