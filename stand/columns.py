"""Columns of numbers from a CSV file: the door for profiles and spectra."""

import csv
from collections.abc import Iterator
from dataclasses import dataclass
from math import isfinite
from pathlib import Path

import numpy as np

from alignment.arrays import Array, IntArray, set_owned
from stand.errors import StandError
from stand.folder import refuse_no_file

LONGEST_SHOWN = 40  # characters of a wrong value
COMMENT = "#"


@dataclass(frozen=True, slots=True, eq=False)
class Columns:
    """Rows of finite numbers `values` (n, m), their line numbers (n,), what the columns are called.

    `file` is how messages name it; `names` is None where the file has no header line.
    """

    file: str
    names: tuple[str, ...] | None
    values: Array
    lines: IntArray

    def __post_init__(self) -> None:
        set_owned(self, values=(self.values, (None, None), float), lines=(self.lines, (None,), int))

    def fault(self, row: int, column: str, value: object, allowed: str) -> StandError:
        """One line about a value: file, line, column, value and what is allowed."""
        return StandError(f"{self.file}: line {self.lines[row]}, {column} = {value}: {allowed}")


def read_columns(path: Path, file: str, most_rows: int) -> Columns:
    """Read comma-separated numbers; one header line first if wanted, comments after #.

    Raises
    ------
    StandError
        Not readable, not UTF-8, not CSV, a value that is no finite number, a row longer or
        shorter than the first, no row, or more than `most_rows`.
    """
    try:
        refuse_no_file(path)
        with path.open(encoding="utf-8-sig", newline="") as stream:
            return _columns(_rows(stream, file), file, most_rows)
    except OSError as error:
        raise StandError(f"{file}: cannot read this file: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise StandError(f"{file}: not UTF-8 text (byte {error.start})") from error


def _rows(stream: Iterator[str], file: str) -> Iterator[tuple[int, list[str]]]:
    """Line number and cells of every line that is neither empty nor a comment."""
    reader = csv.reader(stream)
    try:
        for cells in reader:
            stripped = [cell.strip() for cell in cells]
            if any(stripped) and not stripped[0].startswith(COMMENT):
                yield reader.line_num, stripped
    except csv.Error as error:
        raise StandError(f"{file}: line {reader.line_num}: not CSV: {error}") from error


def _columns(rows: Iterator[tuple[int, list[str]]], file: str, most_rows: int) -> Columns:
    names: tuple[str, ...] | None = None
    width, lines, values = 0, [], []
    for line, cells in rows:
        if not width:
            width = len(cells)
            if width == 1 and (";" in cells[0] or "\t" in cells[0]):
                raise StandError(f"{file}: line {line}: values must be separated by commas")
            if _number(cells[0]) is None:
                names = tuple(cells)
                continue
        if len(cells) != width:
            raise StandError(f"{file}: line {line}: has {len(cells)} values, must have {width}")
        if len(lines) == most_rows:
            raise StandError(f"{file}: line {line}: too long, allowed are {most_rows} rows")
        lines.append(line)
        values.append(_numbers(cells, names, f"{file}: line {line}"))
    if not lines:
        raise StandError(f"{file}: has no row of numbers")
    return Columns(file, names, np.array(values), np.array(lines))


def _numbers(cells: list[str], names: tuple[str, ...] | None, where: str) -> list[float]:
    numbers = [_number(cell) for cell in cells]
    good = [x for x in numbers if x is not None and isfinite(x)]
    if len(good) < len(cells):
        i = next(i for i, x in enumerate(numbers) if x is None or not isfinite(x))
        column = names[i] if names is not None else f"column {i + 1}"
        raise StandError(f"{where}, {column} = {shown(cells[i])}: must be a finite number")
    return good


def _number(cell: str) -> float | None:
    try:
        return float(cell)
    except ValueError:
        return None


def cell(text: str) -> str:
    """Text as a cell that no spreadsheet takes for a formula."""
    return f"'{text}" if text.lstrip()[:1] in ("=", "+", "-", "@") and text else text


def shown(text: str) -> str:
    """A value as messages show it, cut where it is long."""
    return repr(text if len(text) <= LONGEST_SHOWN else f"{text[:LONGEST_SHOWN]}...")
