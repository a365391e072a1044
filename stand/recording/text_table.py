"""Text as loggers, spreadsheets and numerical tools leave it: found out what it is, then read."""

import csv
import re
from array import array
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import TextIO

import numpy as np

from alignment.arrays import Array, IntArray
from stand.errors import StandError
from stand.imu.stated_units import scale_of, spelled
from stand.recording.growing import Growing

COMMENTS = ("#", "%", "//")
SEPARATORS = ("\t", ";", ",", None)  # None: blanks
_HEAD = 1 << 18  # characters in which the table must have begun
_SAMPLE = 40  # lines by whose numbers the separator is told
_BLOCK = 1 << 16  # rows
_DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+(?:[eE][+-]?\d+)?")


@dataclass(frozen=True, slots=True)
class TextLayout:
    """What a text is like.

    Attributes
    ----------
    encoding : str
    separator : str or None
        None: blanks.
    decimal_comma : bool
    names : tuple of str
        Of the columns, as the last line before the numbers has them; none where it does not fit.
    first : int
        The line that the numbers begin on, from 0.
    width, filled : int
        Columns, and these without the last ones that are empty in every line.
    rows : tuple
        The first lines of numbers, as fields.
    """

    encoding: str
    separator: str | None
    decimal_comma: bool
    names: tuple[str, ...]
    first: int
    width: int
    filled: int
    rows: tuple[tuple[str, ...], ...]


@dataclass(frozen=True, slots=True, eq=False)
class TextColumns:
    """Chosen columns: `values` (n, k); the row each is from, `row` (n,) from 0 (rows with an empty
    field are left out, `empty` are their lines); `t_ns` (n,) int64 or None without times."""

    t_ns: IntArray | None
    row: IntArray
    values: Array
    empty: tuple[int, ...]


def is_text(path: Path) -> bool:
    """Whether a file begins as text does: without control characters."""
    with path.open("rb") as file:
        head = file.read(1 << 16)
    if head.startswith((b"\xff\xfe", b"\xfe\xff")):
        return True
    return not any(byte < 9 or (13 < byte < 32 and byte != 26) for byte in head)


def layout_of(path: Path) -> TextLayout:
    """Find out what a text is like.

    Raises
    ------
    StandError
        It has no rows of numbers.
    """
    encoding = _encoding(path)
    with _opened(path, encoding) as file:
        text = file.read(_HEAD)
        lines = text.split("\n")
        if file.read(1):
            lines.pop()  # cut off by the limit
    body = [line for line in lines if line.strip() and not _is_comment(line)][-_SAMPLE:]
    kinds = [(s, c) for s in SEPARATORS for c in (False, True) if (s, c) != (",", True)]
    separator, comma = max(kinds, key=lambda kind: sum(_score(line, *kind) for line in body))
    numbers = [_numbers(line, separator, comma) for line in body]
    usual = float(np.median(numbers)) if numbers else 0.0
    first = _first(lines, separator, comma, usual)
    if first is None:
        raise StandError(f"{path}: no rows of data")
    data = [line for line in lines[first:] if line.strip() and not _is_comment(line)]
    rows = [tuple(fields_of(line, separator)) for line in data[:_SAMPLE]]
    width = Counter(map(len, rows)).most_common(1)[0][0]
    whole = [row for row in rows if len(row) == width]
    filled = max((k + 1 for row in whole for k, x in enumerate(row) if x.strip()), default=0)
    names = _names(lines[:first], separator, (filled, width))
    return TextLayout(
        encoding=encoding,
        separator=separator,
        decimal_comma=comma,
        names=names,
        first=first,
        width=width,
        filled=filled,
        rows=tuple(rows),
    )


def read_columns(
    path: Path,
    layout: TextLayout,
    *,
    width: int | None,
    values: Sequence[int],
    times: Sequence[int],
    to_ns: Callable[[Sequence[str]], int],
    progress: Callable[[float], None] = lambda done: None,
) -> TextColumns:
    """Read the columns `values` as numbers and `times` by `to_ns`; a row without one is left out.

    Parameters
    ----------
    width : int or None
        Columns that every line must have, empty ones at its end apart; None: as many as it takes.

    Raises
    ------
    StandError
        The first line that does not fit: line, column, value, what is allowed.
    """
    found = _Rows(len(values))
    for row, (line, fields) in enumerate(_rows(path, layout, progress)):
        _check_width(path, layout, line, fields, width, max([*values, *times]))
        try:
            stamp = to_ns([fields[k].strip() for k in times]) if times else 0
            numbers = [number_of(fields[k], layout.decimal_comma) for k in values]
            found.add(row, stamp, numbers)
        except (ValueError, OverflowError):
            if not all(fields[k].strip() for k in [*values, *times]):
                found.empty.append(line)
                continue
            raise _no_number(path, layout, line, fields, values, times) from None
    return found.whole(timed=bool(times))


class _Rows:
    """Rows that are collected block by block, so that a long log is never held twice."""

    def __init__(self, width: int) -> None:
        self._numbers, self._stamps, self._places = array("d"), array("q"), array("q")
        self._grown = (
            Growing(np.empty((0, width))),
            Growing(np.empty(0, np.int64)),
            Growing(np.empty(0, np.int64)),
        )
        self._width = width
        self.empty: list[int] = []

    def add(self, place: int, stamp: int, numbers: Sequence[float]) -> None:
        self._stamps.append(stamp)
        self._places.append(place)
        self._numbers.extend(numbers)
        if len(self._places) >= _BLOCK:
            self._flush()

    def whole(self, *, timed: bool) -> TextColumns:
        self._flush()
        values, stamps, places = (part.whole() for part in self._grown)
        return TextColumns(stamps if timed else None, places, values, tuple(self.empty))

    def _flush(self) -> None:
        values = np.array(self._numbers, float).reshape(-1, self._width)
        for grown, part in zip(
            self._grown, (values, np.array(self._stamps), np.array(self._places)), strict=True
        ):
            grown.extend(part)
        self._numbers, self._stamps, self._places = array("d"), array("q"), array("q")


def fields_of(line: str, separator: str | None) -> list[str]:
    """The fields of a line; quotes hold one together, and a comment behind them is dropped."""
    if '"' in line:
        text = line.replace("\t", " ") if separator is None else line
        with suppress(csv.Error):
            rows = csv.reader([text.strip(" ")], delimiter=separator or " ", skipinitialspace=True)
            return next(rows)
    return (line.split("#", 1)[0].rstrip(" ") if "#" in line else line).split(separator)


def _encoding(path: Path) -> str:
    with path.open("rb") as file:
        return "utf-16" if file.read(2) in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig"


def _opened(path: Path, encoding: str) -> TextIO:
    """Any line end; a byte order mark is dropped, bytes of other encodings may be in the words."""
    return path.open(encoding=encoding, errors="replace", newline=None)


def _is_comment(line: str) -> bool:
    return line.lstrip().startswith(COMMENTS)


def number_of(field: str, decimal_comma: bool = False) -> float:
    """A field as a number; `ValueError` if it is none."""
    if "_" in field:  # Python's own 1_000 is nobody's number in a log
        raise ValueError(field)
    return float(field.replace(",", ".") if decimal_comma else field)


def _is_number(field: str, decimal_comma: bool) -> bool:
    try:
        number_of(field, decimal_comma)
    except ValueError:
        return False
    return True


def _numbers(line: str, separator: str | None, decimal_comma: bool) -> int:
    return sum(_is_number(x, decimal_comma) for x in fields_of(line, separator))


def _score(line: str, separator: str | None, decimal_comma: bool) -> float:
    """Fields that are numbers less those that are not."""
    fields = [x for x in fields_of(line, separator) if x.strip()]
    found = sum(_is_number(x, decimal_comma) for x in fields)
    return 2 * found - len(fields)


def _first(
    lines: Sequence[str], separator: str | None, decimal_comma: bool, usual: float
) -> int | None:
    """The first line with about as many numbers as usual, which do not just count columns."""
    for k, line in enumerate(lines):
        if _is_comment(line) or not line.strip():
            continue
        enough = _numbers(line, separator, decimal_comma) >= max(1.0, usual / 2)
        if enough and not _counts_columns(fields_of(line, separator)):
            return k
    return None


def _counts_columns(fields: Sequence[str]) -> bool:
    """0,1,2 ... or 1,2,3 ...: a header that a table without names was given."""
    told = [x.strip() for x in fields if x.strip()]
    counted = [[str(k + start) for k in range(len(told))] for start in (0, 1)]
    return len(told) > 2 and told in counted


def _names(head: Sequence[str], separator: str | None, widths: Sequence[int]) -> tuple[str, ...]:
    """Of the columns; where a line of units stands below them, each with its unit in brackets."""
    found = []
    for line in reversed(head):
        bare = line.strip(" \r").lstrip("#%/").strip(" ")
        names = [name.strip() for name in fields_of(bare.replace("#", ""), separator)]
        if len(names) in widths and not _counts_columns(names):
            found.append(names)
    if len(found) > 1 and len(found[0]) == len(found[1]) and all(map(_is_unit, found[0])):
        return tuple(
            name if not unit or name.endswith(("]", ")")) else f"{name} [{unit.strip('[]()')}]"
            for unit, name in zip(*found[:2], strict=True)
        )
    return tuple(found[0]) if found else ()


def _is_unit(text: str) -> bool:
    """Whether it is no word, or a unit as data sheets write it."""
    try:
        scale_of(spelled(text.strip("[]()")))
    except StandError:
        return text in ("", "-", "[]", "[-]")
    return True


def _rows(
    path: Path, layout: TextLayout, progress: Callable[[float], None]
) -> Iterator[tuple[int, list[str]]]:
    """Line number, from 1, and fields of every line of numbers.

    A last line that is short and has no end was cut off by a logger that lost its power: its last
    field may be part of a number, and is empty as those that are not there.
    """
    separator, size = layout.separator, path.stat().st_size
    with _opened(path, layout.encoding) as file:
        for number, line in enumerate(islice(file, layout.first, None), layout.first + 1):
            if number % _BLOCK == 0:
                progress(file.buffer.tell() / size)
            if not line.strip() or _is_comment(line):
                continue
            fields = fields_of(line.rstrip(" \n"), separator)
            if not line.endswith("\n") and len(fields) < layout.filled:
                fields = fields[:-1] + [""] * (layout.width - len(fields) + 1)
            yield number, fields


def _check_width(
    path: Path,
    layout: TextLayout,
    line: int,
    fields: Sequence[str],
    width: int | None,
    last: int,
) -> None:
    if width is None:
        if len(fields) <= last:
            raise StandError(
                f"{path}: line {line}: {len(fields)} columns, column {last + 1} is asked for"
            )
    elif len(fields) != width and (len(fields) < width or any(x.strip() for x in fields[width:])):
        alike = all(len(row) == layout.width for row in layout.rows)
        where = "" if alike and len(fields) == layout.width else f"line {line}: "
        raise StandError(
            f"{path}: {where}{len(fields)} columns, but --columns names {width} (use - to skip one)"
        )


def _no_number(
    path: Path,
    layout: TextLayout,
    line: int,
    fields: Sequence[str],
    values: Sequence[int],
    times: Sequence[int],
) -> StandError:
    for k in sorted([*values, *times]):
        if not _is_number(fields[k], layout.decimal_comma):
            told = f"column {k + 1} = {fields[k].strip()!r}"
            must = "must be a number" if k in values else "must be a time in the time unit"
            return StandError(f"{path}: line {line}, {told}: {must}")
    k = times[0]
    told = f"column {k + 1} = {fields[k].strip()!r}"
    return StandError(f"{path}: line {line}, {told}: is no time (is the time unit right?)")
