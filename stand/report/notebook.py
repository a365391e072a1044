"""Results as a notebook or a prompt shows them: a line, tables, notes; as text and as HTML."""

from collections.abc import Sequence
from dataclasses import fields
from html import escape
from io import StringIO
from typing import Any, TypeVar

from stand.report.console import show, wide
from stand.report.tables import TableData

Result = TypeVar("Result")


class Shown:
    """A result that prints itself as its tables."""

    __slots__ = ()

    def headline(self) -> str:
        """What it is, in one line."""
        raise NotImplementedError

    def tables(self) -> Sequence[TableData]:
        """What it found."""
        return ()

    def remarks(self) -> Sequence[str]:
        """What must be said of it."""
        return ()

    def __repr__(self) -> str:
        out = StringIO()
        show(wide(out), self.tables())
        lines = [line.rstrip() for line in out.getvalue().splitlines()]
        return "\n".join([self.headline(), *lines, *self.remarks()])

    def _repr_html_(self) -> str:
        parts = [f"<p><b>{escape(self.headline())}</b></p>", *map(_table, self.tables())]
        return "\n".join([*parts, *(f"<p>{escape(line)}</p>" for line in self.remarks())])


def shown(kind: type[Result], result: Any) -> Result:
    """A result as the type that prints itself."""
    return kind(**{field.name: getattr(result, field.name) for field in fields(result)})


def _table(table: TableData) -> str:
    rows = [_row("th", table.columns), *(_row("td", row) for row in (*table.rows, *table.footers))]
    notes = "".join(f"<p><small>{escape(note)}</small></p>" for note in table.notes)
    caption = f"<caption>{escape(table.title)}</caption>"
    return f"<table>{caption}\n" + "\n".join(rows) + f"\n</table>{notes}"


def _row(kind: str, cells: Sequence[str]) -> str:
    return "<tr>" + "".join(f"<{kind}>{escape(cell)}</{kind}>" for cell in cells) + "</tr>"
