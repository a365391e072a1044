"""A proposed test, that prints itself."""

from collections.abc import Sequence
from pathlib import Path

from stand.folder import write_file
from stand.proposal.result import Proposal
from stand.report import proposal as proposal_report
from stand.report.notebook import Shown
from stand.report.tables import TableData


class Proposed(Shown, Proposal):
    """The answer of `stand.propose`."""

    __slots__ = ()

    def headline(self) -> str:
        return proposal_report.headline(self)

    def tables(self) -> Sequence[TableData]:
        return proposal_report.tables(self)

    def write(self, path: str | Path) -> Path:
        """The procedure as a TOML file; what is there is replaced."""
        return write_file(Path(path), self.text)
