"""Tables for a terminal."""

from collections.abc import Sequence

from rich.box import SIMPLE_HEAD
from rich.console import Console, Group, RenderableType
from rich.table import Table
from rich.text import Text

from stand.report.document import TableData

WIDTH = 128  # where no terminal says its own


def console(stderr: bool = False) -> Console:
    """A console as wide as its terminal, or wide enough for the tables when piped."""
    plain = Console(stderr=stderr, highlight=False, soft_wrap=False)
    return plain if plain.is_terminal else Console(stderr=stderr, highlight=False, width=WIDTH)


def render(table: TableData) -> RenderableType:
    """A table with its title above and its notes below."""
    grid = Table(box=SIMPLE_HEAD, pad_edge=False, header_style="bold")
    for k, name in enumerate(table.columns):
        left = k == 0 or name in ("turns", "title", "source")
        grid.add_column(name, justify="left" if left else "right", no_wrap=k == 0)
    for k, row in enumerate(table.rows):
        grid.add_row(*map(Text, row), end_section=k == len(table.rows) - 1)
    for row in table.footers:
        grid.add_row(*map(Text, row), style="dim")
    notes = [Text(f"  {note}", style="dim") for note in table.notes]
    return Group(Text(table.title, style="bold cyan"), grid, *notes)


def show(out: Console, tables: Sequence[TableData]) -> None:
    """Print tables one below the other."""
    for table in tables:
        out.print(render(table))
