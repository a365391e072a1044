"""Rows of binary numbers, one behind the other, which say nothing of themselves."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stand.errors import StandError, unknown

FORMATS = ("csv", "f8le")  # and any numpy dtype
_USUAL_TYPES = ("<f8", ">f8", "<f4", ">f4")
_NO_READING = 1e9  # no sensor reads so much in any unit


def number_type(text: str) -> np.dtype[Any]:
    """A numpy type of numbers; f8le is <f8.

    Raises
    ------
    StandError
        It is none.
    """
    try:
        kind = np.dtype("<f8" if text == "f8le" else text)
    except (TypeError, ValueError, SyntaxError):
        raise unknown("format", text, (*FORMATS, *_USUAL_TYPES)) from None
    if kind.kind not in "fiu":
        raise unknown("format", text, (*FORMATS, *_USUAL_TYPES))
    return kind


def binary_rows(
    path: Path,
    kind: np.dtype[Any],
    width: int,
    *,
    skip: int,
    values: Sequence[int],
    times: Sequence[int],
) -> NDArray[Any]:
    """The rows (n, width), as they lie in the file.

    Parameters
    ----------
    path : Path
    kind : dtype
        Of a number.
    width : int
        Numbers in a row.
    skip : int
        Bytes before the first row.
    values, times : sequence of int
        Which columns are readings, and which stamps.

    Raises
    ------
    StandError
        Not a whole number of rows; or it makes no sense as `kind`, but does as another type.
    """
    rows = _rows(path, kind, width, skip)
    if rows is None:
        size = path.stat().st_size - skip
        if size < 0:
            raise StandError(f"{path}: --skip-bytes {skip}: has {size + skip}")
        name = "float64" if kind == np.float64 else kind.str
        raise StandError(
            f"{path}: {size} bytes is not a whole number of rows of {width} {name} "
            f"({kind.itemsize * width} bytes): truncated, another --format, or other --columns"
        )
    if not _reads(rows, values, times):
        others = [np.dtype(text) for text in _USUAL_TYPES if np.dtype(text) != kind]
        for other in others:
            raw = _rows(path, other, width, skip)
            if raw is not None and len(raw) > 1 and _reads(raw, values, times):
                big = "big endian" if other.str.startswith(">") else "little endian"
                raise StandError(
                    f"{path}: makes no sense as {kind.str}, but does as {other.str} ({big}): "
                    f"--format '{other.str}'"
                )
    return rows


def _rows(path: Path, kind: np.dtype[Any], width: int, skip: int) -> NDArray[Any] | None:
    size = path.stat().st_size - skip
    if size < 0 or size % (kind.itemsize * width):
        return None
    return np.fromfile(path, dtype=kind, offset=skip).reshape(-1, width)


def _reads(rows: NDArray[Any], values: Sequence[int], times: Sequence[int]) -> bool:
    """Whether binary rows are readings of a sensor, as far as that can be seen."""
    with np.errstate(all="ignore"):
        numbers = np.abs(rows[:, list(values)].astype(float))
        sound = bool(np.all(numbers < _NO_READING)) and bool(np.any(numbers > 1 / _NO_READING))
        stamps = rows[:, list(times)].astype(float)
        rising = bool((np.diff(stamps[:, 0]) >= 0).all()) if len(times) else True
    return sound and rising and bool(np.isfinite(stamps).all())
