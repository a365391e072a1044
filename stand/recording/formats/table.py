"""Columns by name, out of whatever a file holds."""

from collections import defaultdict
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from stand.errors import StandError, unknown
from stand.recording.log_columns import CHANNELS, guessed_columns, named_unit

MOST_COLUMNS = 64  # of one array: more are no columns
_UNITS = [(1, 0, -1, 0), (1, 0, 0, 0), (0, 1, -2, 0), (0, 1, -1, 0), (0, 0, 1, 0)]


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


class Values(Protocol):
    """An array, or what is one when it is read."""

    @property
    def shape(self) -> tuple[int, ...]: ...
    def __getitem__(self, key: Any, /) -> Any: ...


@dataclass(frozen=True, slots=True)
class _Column:
    name: str
    array: str
    part: int | None  # of the shorter axis; None: the array has one axis
    lying: bool  # the longer axis is the second

    def of(self, arrays: Mapping[str, Values]) -> NDArray[Any]:
        values = arrays[self.array]
        if self.part is None:
            return np.asarray(values[...]).reshape(-1)
        return np.asarray(values[self.part, :] if self.lying else values[:, self.part])


def table_of(arrays: Mapping[str, Values], topic: str | None = None) -> ArrayTable:
    """The columns of named arrays that are the likeliest to be a log.

    Arrays of one axis are a column, of two axes one for each place of the shorter. Columns belong
    together that are of one length; of several such groups the one counts that looks most like
    an IMU, then the one of most columns.

    Parameters
    ----------
    arrays : mapping of str to array
        Of numbers, times or texts.
    topic : str, optional
        Only arrays whose name begins so: a group of the file.

    Raises
    ------
    StandError
        There is no column of two or more rows, or no such group.
    """
    if topic is not None:
        chosen = {n: a for n, a in arrays.items() if n == topic or n.startswith(topic + ".")}
        if not chosen:
            raise unknown("--topic", topic, {n.rpartition(".")[0] or n for n in arrays})
        arrays = {n.removeprefix(topic + "."): a for n, a in chosen.items()}
    groups: dict[int, list[_Column]] = defaultdict(list)
    for name, array in arrays.items():
        for rows, column in _columns(name, array.shape):
            groups[rows].append(column)
    if not groups:
        raise StandError(f"no columns of 2 or more rows: it has {', '.join(arrays) or 'nothing'}")
    rows = max(groups, key=lambda n: (_likeness(groups[n]), len(groups[n]), n))
    used = groups[rows]
    owners = list(dict.fromkeys(column.array for column in used))
    aside = [n for n in arrays if n not in owners and len(arrays[n].shape) in (1, 2)]
    notes = [f"left aside, of another length: {', '.join(aside[:6])}"] if aside else []
    if any(column.lying for column in used):
        notes.append("arrays lie with time along their second axis")
    alone = len(owners) == 1 and len(used) > 1
    return ArrayTable(
        topic=topic or (owners[0] if alone else ""),
        names=() if alone else tuple(column.name for column in used),
        rows=rows,
        width=len(used),
        column=lambda k: used[k].of(arrays),
        notes=tuple(notes),
    )


def _columns(name: str, shape: tuple[int, ...]) -> list[tuple[int, _Column]]:
    """The columns of an array, each with its length."""
    long = [n for n in shape if n != 1]
    if len(long) == 1 and long[0] >= 2:
        return [(long[0], _Column(name, name, None, False))]
    if len(shape) != 2 or min(shape) < 2 or min(shape) > MOST_COLUMNS:
        return []
    lying = shape[1] > shape[0]
    return [
        (max(shape), _Column(_part_name(name, k, min(shape)), name, k, lying))
        for k in range(min(shape))
    ]


def _part_name(name: str, k: int, count: int) -> str:
    """Of column k of an array: axes where there are three, with the unit behind them."""
    bare, unit = named_unit(name, _UNITS)
    part = f"{bare}_{'xyz'[k]}" if count == 3 else f"{bare}_{k + 1}"
    return f"{part} [{unit}]" if unit else part


def _likeness(columns: list[_Column]) -> int:
    guesses = guessed_columns([column.name for column in columns], len(columns))
    return len(set(guesses) & {*CHANNELS, "t"})
