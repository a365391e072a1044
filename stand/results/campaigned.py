"""A campaign, that prints itself."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from stand.campaigns.campaign import Campaign
from stand.campaigns.summary import Summary, summarised
from stand.report import campaign as campaign_report
from stand.report.notebook import Shown
from stand.report.tables import TableData


class Campaigned(Shown, Campaign):
    """A campaign, of `stand.campaign`: iterate over its runs, or `run` all of them."""

    __slots__ = ()

    def run(self, progress: Callable[[float], None] = lambda done: None) -> "Campaigned":
        """Make all runs that are missing; `progress` is told the part done, 0 to 1."""
        for _ in self:
            progress(self.done / self.total)
        return self

    def columns(self) -> dict[str, NDArray[Any]]:
        """The rows there are, in order of case and seed: a column each, SI.

        A row per run, method, place and quantity: ``case``, ``seed``, ``method``, ``window``,
        ``place``, ``quantity``, ``estimate``, ``error``, ``sigma``, ``refusal``.
        """
        return self.results.columns()

    def table(self) -> Any:
        """The same as a table of pyarrow, for pandas, polars and others."""
        return self.results.table()

    def summary(self) -> Summary:
        """Errors with intervals beside predictions, honesty, yield, the worst units."""
        return summarised(self.folder)

    def write_page(self) -> Path:
        """The same to look at: a page in the campaign's folder."""
        return campaign_report.write_page(self.summary())

    def headline(self) -> str:
        return f"{self.sweep.entry.title}: {self.done} of {self.total} runs, in {self.folder}"

    def tables(self) -> Sequence[TableData]:
        return campaign_report.tables(self.summary()) if self.done else ()
