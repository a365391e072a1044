"""Passes over records that may be longer than memory: a part at a time, and what that part used
is given back.

A long record lies in a file that is mapped (see `release`); to everybody it is an array like any
other. What is summed in parts has the bits of the sum in one go. Where all values are needed at
once, as for a median, a record of more than `MOST` rows is told by excerpts.
"""

import mmap
from collections.abc import Iterator, Sequence
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

PART = 2**20  # rows at once
MOST = 2**22  # rows that are held at once: over an hour at 1 kHz
_AT_ONCE = 2**13  # rows that a processor's cache takes
_EXCERPT = 4096  # rows of one excerpt
_FEW = 1024  # rows apart: 64 KiB of the file come with each

Values = NDArray[Any]


def parts(n: int, size: int = PART) -> Iterator[slice]:
    """Successive rows of `n`, so many at most."""
    return (slice(first, min(first + size, n)) for first in range(0, n, size))


def in_parts(values: Values) -> Iterator[Values]:
    """Successive rows of `values` (n, ...), given back behind whoever takes them."""
    for rows in parts(len(values)):
        yield values[rows]
        release(values)


def release(*values: Values) -> None:
    """Give back the memory in which pages of a mapped file lie; nothing of other arrays.

    The file keeps them: they come again when they are asked for.
    """
    for base in map(_origin, values):
        if isinstance(base, mmap.mmap) and hasattr(mmap, "MADV_DONTNEED"):
            base.madvise(mmap.MADV_DONTNEED)


def _origin(values: Values) -> Any:
    """What the memory of an array belongs to, behind all views."""
    base: Any = values
    while isinstance(base, np.ndarray):
        base = base.base
    return base


def equal(one: Values, other: Values) -> bool:
    """``np.array_equal`` of rows, given back behind it."""
    if one.shape != other.shape:
        return False
    for rows in parts(len(one)):
        if not np.array_equal(one[rows], other[rows]):
            return False
        release(one, other)
    return True


def taken(values: Values, rows: Values) -> Values:
    """`values[rows]`, of few rows at a time: each brings what lies around it in the file along."""
    found = np.empty((len(rows), *values.shape[1:]), values.dtype)
    for first in range(0, len(rows), _FEW):
        part = slice(first, first + _FEW)
        found[part] = values[rows[part]]
        release(values)
    return found


def excerpts(values: Values) -> list[Values]:
    """All rows of `values` (n, ...) as one, or of more than `MOST` as many, spread evenly."""
    n = len(values)
    if n <= MOST:
        return [values]
    count = MOST // _EXCERPT
    starts = np.arange(count) * (n - _EXCERPT) // (count - 1)
    found = []
    for start in starts:
        found.append(values[start : start + _EXCERPT].copy())
        release(values)
    return found


def mean(values: Values) -> Values:
    """Mean (k,) of `values` (n, k) over the rows, with the bits of ``values.mean(axis=0)``."""
    if len(values) <= PART:
        return np.asarray(values.mean(axis=0))
    # as numpy does, row by row; einsum of few columns in a fourth of the time
    added = np.add.reduce if values.shape[1] == 1 else partial(np.einsum, "ij->j")
    rows = np.zeros((1 + _AT_ONCE, values.shape[1]))
    for part in in_parts(values):
        for first in range(0, len(part), _AT_ONCE):
            some = part[first : first + _AT_ONCE]
            rows[1 : 1 + len(some)] = some
            rows[0] = added(rows[: 1 + len(some)])
    return rows[0] / len(values)


def sums_between(values: Values, edges: Values) -> Values:
    """Sums (m, k) of the rows of `values` (n, k) between successive `edges` (m + 1,) of rows."""
    sums = np.empty((len(edges) - 1, *values.shape[1:]))
    for first, last in pairwise(_groups(edges)):
        own = values[edges[first] : edges[last]]
        sums[first:last] = np.add.reduceat(own, edges[first:last] - edges[first], axis=0)
        release(values)
    return sums


def _groups(edges: Values) -> Sequence[int]:
    """Numbers of edges between which lie `PART` rows at most, or one block."""
    found = [0]
    while found[-1] < len(edges) - 1:
        reach = int(np.searchsorted(edges, edges[found[-1]] + PART, "right")) - 1
        found.append(max(found[-1] + 1, reach))
    return found
