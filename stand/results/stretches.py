"""What `stand.stretches` found, that prints itself."""

from collections.abc import Sequence

from stand.recording.found_stretches import FoundStretches
from stand.report.notebook import Shown
from stand.report.stretches import stretches_table
from stand.report.tables import TableData


class Stretches(Shown, FoundStretches):
    """What stands still or turns evenly, of `stand.stretches`."""

    __slots__ = ()

    def headline(self) -> str:
        n = len(self.found)
        told = "1 stretch" if n == 1 else f"{n} stretches"
        return f"{self.path} {self.topic}".rstrip() + f": {told}"

    def tables(self) -> Sequence[TableData]:
        return [stretches_table(self)]
