"""Columns by name, out of whatever a file holds."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from numpy.typing import NDArray


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ArrayTable:
    """Columns of one length.

    Attributes
    ----------
    topic : str
        Which part of the file it is, in words.
    names : tuple of str
        Of the columns; none where they have none.
    rows : int
    width : int
        How many columns.
    column : callable
        A column by its place from 0: numbers, times or texts (rows,).
    notes : tuple of str
        What was found out of the file.
    """

    topic: str
    names: tuple[str, ...]
    rows: int
    width: int
    column: Callable[[int], NDArray[Any]]
    notes: tuple[str, ...] = ()
