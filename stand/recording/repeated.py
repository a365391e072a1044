"""Samples that a log holds twice: the same time and the same readings, one after the other."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from alignment.arrays import IntArray

NAMED = 3  # of which more are counted


def repeats(stamps: IntArray, *values: NDArray[Any]) -> IntArray:
    """Numbers of the rows (n,), (n, k) that are the row before again."""
    again = np.flatnonzero(stamps[1:] == stamps[:-1]) + 1
    for v in values:
        again = again[(v[again] == v[again - 1]).all(axis=1)]
    return again


class Repeated:
    """Rows that repeat the row before, met block by block."""

    def __init__(self) -> None:
        self._last: list[NDArray[Any]] = []
        self._seen, self._count = 0, 0
        self._first: list[int] = []

    def once(self, stamps: IntArray, *values: NDArray[Any]) -> NDArray[np.bool_] | slice:
        """Which of the next rows (n,), (n, k) are not the row before again."""
        own = [stamps, *values]
        last = self._last or [column[:0] for column in own]
        joined = [np.concatenate(pair) for pair in zip(last, own, strict=True)]
        more = len(joined[0]) - len(stamps)
        again = repeats(*joined) - more
        self._first += (self._seen + 1 + again[: NAMED - len(self._first)]).tolist()
        self._seen, self._count = self._seen + len(stamps), self._count + len(again)
        self._last = [column[-1:].copy() for column in joined]
        if not len(again):
            return slice(None)
        once = np.ones(len(stamps), bool)
        once[again] = False
        return once

    def notes(self) -> tuple[str, ...]:
        """What there is to say."""
        return (twice_text("message", self._first, self._count),) if self._count else ()


def twice_text(kind: str, numbers: Sequence[int] | IntArray, count: int = 0) -> str:
    """What was left out, in words; `count` where not all are numbered."""
    count = count or len(numbers)
    named = ", ".join(str(k) for k in numbers[:NAMED]) + (" ..." if count > NAMED else "")
    plural = "s" if count > 1 else ""
    return (
        f"{count} {kind}{plural} with the time and the readings of the one before left out: "
        f"{kind} {named}"
    )
