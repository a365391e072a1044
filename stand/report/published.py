"""The audit of the papers to look at: as text, and as a page with its pictures.

`write_audit` is the way in.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from textwrap import wrap

from alignment.sources import SOURCES
from stand.evaluation.published import Row, Verdict, row_json
from stand.folder import Content, write_files
from stand.report.page import Drawing, render

PAGE, JSON = "published.html", "published.json"
GRADES = {Verdict.REPRODUCED: "good", Verdict.NOT_REPRODUCED: "bad", Verdict.CONTEXT: "open"}


def audit_text(rows: Sequence[Row], width: int) -> str:
    """The rows in lines of so many characters, and how many were reproduced."""
    blocks = []
    for row in rows:
        lines = wrap(f"[{row.paper}] {row.place}: {row.quantity}", width)
        lines += _wrapped("  printed  ", row.printed, width)
        lines += _wrapped("  ours     ", row.ours, width)
        lines += _wrapped("  ", f"{row.verdict.value}: {row.reason}", width)
        if row.nearest:
            lines += _wrapped("  nearest  ", row.nearest, width)
        lines += _wrapped("  again    ", row.command, width)
        blocks.append("\n".join(lines))
    return "\n\n".join([*blocks, summary(rows)])


def _wrapped(lead: str, text: str, width: int) -> list[str]:
    return wrap(text, width, initial_indent=lead, subsequent_indent=" " * len(lead))


def summary(rows: Sequence[Row]) -> str:
    """'41 of 70 reproduced, 3 of context'."""
    count = Counter(row.verdict for row in rows)
    tried = len(rows) - count[Verdict.CONTEXT]
    context = f", {count[Verdict.CONTEXT]} of context" if count[Verdict.CONTEXT] else ""
    return f"{count[Verdict.REPRODUCED]} of {tried} reproduced{context}"


@dataclass(frozen=True, slots=True)
class _Paper:
    """A part of the page."""

    letter: str
    title: str
    summary: str
    rows: tuple[Row, ...]
    pictures: tuple[Drawing, ...]


def write_audit(rows: Sequence[Row], folder: Path) -> list[Path]:
    """Write `PAGE`, `JSON` and the pictures as PNG into a folder; what is there is replaced.

    Pictures are of the papers that have rows. The page comes first in what is returned.
    """
    from stand.report.published_pictures import pictures

    letters = list(dict.fromkeys(row.paper for row in rows))
    shown = pictures(set(letters))
    papers = []
    for letter in letters:
        own = tuple(row for row in rows if row.paper == letter)
        drawings = tuple(p.drawing() for p in shown if p.name.startswith(letter.lower()))
        papers.append(_Paper(letter, SOURCES[letter], summary(own), own, pictures=drawings))
    content = {
        "papers": papers,
        "facts": [("rows", str(len(rows))), ("verdict", summary(rows))],
        "grade": lambda row: GRADES[row.verdict],
    }
    machine = json.dumps({"published": [row_json(row) for row in rows]}, indent=1, allow_nan=False)
    texts: dict[Path, Content] = {
        folder / PAGE: render("published.html.j2", content),
        folder / JSON: machine + "\n",
    }
    return write_files(texts | {folder / f"{p.name}.png": p.png() for p in shown})
