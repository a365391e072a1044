"""Entries of a catalogue, that print themselves."""

from collections.abc import Sequence
from typing import Any

from stand.report.listing import entries_table
from stand.report.notebook import Shown
from stand.report.tables import TableData


class Entries(Shown, tuple[dict[str, Any], ...]):
    """Entries of a catalogue: a tuple of dictionaries."""

    __slots__ = ()

    def headline(self) -> str:
        return "1 entry" if len(self) == 1 else f"{len(self)} entries"

    def tables(self) -> Sequence[TableData]:
        return [entries_table("", self)]
