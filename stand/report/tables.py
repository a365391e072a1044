"""A table as data: title, columns, rows."""

from __future__ import annotations

from dataclasses import dataclass, replace


@dataclass(frozen=True, slots=True)
class TableData:
    """A table of text: `rows` of one cell per column, then `footers` set apart from them.

    `optional` columns may be left out, in that order, where there is no room.
    """

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    footers: tuple[tuple[str, ...], ...] = ()
    notes: tuple[str, ...] = ()
    optional: tuple[str, ...] = ()

    def narrower(self) -> TableData | None:
        """The table without its next optional column, told in a note; None if there is none."""
        if not self.optional:
            return None
        name, *rest = self.optional
        k = self.columns.index(name)

        def cut(rows: tuple[tuple[str, ...], ...]) -> tuple[tuple[str, ...], ...]:
            return tuple(row[:k] + row[k + 1 :] for row in rows)

        (columns,) = cut((self.columns,))
        return replace(
            self,
            columns=columns,
            rows=cut(self.rows),
            footers=cut(self.footers),
            optional=tuple(rest),
        )
