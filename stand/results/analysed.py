"""Noise terms of `stand.allan`, that print themselves."""

from collections.abc import Sequence

from stand.evaluation.allan import AllanReport
from stand.report import allan as allan_report
from stand.report.notebook import Shown
from stand.report.tables import TableData


class Analysed(Shown, AllanReport):
    """Noise terms, of `stand.allan`."""

    __slots__ = ()

    def headline(self) -> str:
        return f"Allan analysis of {self.path} {self.topic}".rstrip()

    def tables(self) -> Sequence[TableData]:
        return allan_report.tables(self)
