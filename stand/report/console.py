"""Tables for a terminal."""

import os
from collections.abc import Sequence
from typing import TextIO

from rich.box import SIMPLE_HEAD
from rich.console import Console, Group, RenderableType
from rich.measure import Measurement
from rich.table import Table
from rich.text import Text

from stand.errors import printable
from stand.report.tables import TableData

WIDTH = 132  # where no terminal says its own
LEFT = (
    "turns",
    "title",
    "source",
    "place",
    "finding",
    "kind",
    "steps",
    "axis",
    "contributions",
    "estimates",
    "position",
    "stretch",
    "channel",
    "sensor",
)


def console(stderr: bool = False) -> Console:
    """A console as wide as its terminal, or wide enough for the tables when piped."""
    plain = Console(stderr=stderr, highlight=False, soft_wrap=False)
    if plain.is_terminal or "COLUMNS" in os.environ:
        return plain
    return Console(stderr=stderr, highlight=False, width=WIDTH)


def wide(file: TextIO) -> Console:
    """A console that writes plain text, wide enough for the tables."""
    return Console(file=file, highlight=False, width=WIDTH, color_system=None)


def render(table: TableData) -> RenderableType:
    """A table with its title above and its notes below."""
    notes = [Text(printable(f"  {note}"), style="dim") for note in table.notes]
    return Group(Text(printable(table.title), style="bold cyan"), _grid(table), *notes)


def _grid(table: TableData) -> Table:
    grid = Table(box=SIMPLE_HEAD, pad_edge=False, header_style="bold")
    for k, name in enumerate(table.columns):
        left = k == 0 or name in LEFT
        # words may wrap, numbers may not: their heading stands on as many lines as it has words
        single = not any(" " in row[k] for row in (*table.rows, *table.footers))
        numbers = bool(table.optional) or k == 0 or (single and not left)
        heading = name if table.optional or not numbers else name.replace(" ", "\n")
        justify = "left" if left else "right"
        grid.add_column(_text(heading), justify=justify, no_wrap=numbers, overflow="fold")
    for k, row in enumerate(table.rows):
        grid.add_row(*map(_text, row), end_section=k == len(table.rows) - 1)
    for row in table.footers:
        grid.add_row(*map(_text, row), style="dim")
    return grid


def _text(cell: str) -> Text:
    """A cell that may hold text of a file: whatever would steer the terminal is blank."""
    return Text("\n".join(map(printable, cell.split("\n"))))


def fitted(out: Console, table: TableData) -> TableData:
    """The table with as many of its optional columns as there is room for."""
    boundless = out.options.update(width=10_000)
    while (narrower := table.narrower()) is not None:
        if Measurement.get(out, boundless, _grid(table)).maximum <= out.width:
            break
        table = narrower
    return table


def show(out: Console, tables: Sequence[TableData]) -> None:
    """Print tables one below the other."""
    for table in tables:
        out.print(render(fitted(out, table)))
