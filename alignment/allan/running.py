"""Running sums of signals that may be longer than memory, and what these bend by over a lag.

A signal goes by in pieces that a processor's cache takes; of the sum only what a later piece needs
is kept.
"""

from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from alignment.arrays import Array
from alignment.parts import in_parts

PIECE = 1 << 16  # values at a time
BLOCK = 1 << 14  # differences at a time


def pieces(signal: Array) -> Iterator[Array]:
    """A signal (n,) in pieces, each contiguous."""
    for part in in_parts(signal):
        for first in range(0, len(part), PIECE):
            yield np.ascontiguousarray(part[first : first + PIECE])


def running_sum(signal: Array, *levels: float) -> Iterator[Array]:
    """Pieces of the n + 1 sums of a signal (n,) less these levels, one after the other: a zero
    first. They have the bits of a sum in one go."""
    total = np.zeros(1)
    yield total
    for piece in pieces(signal):
        own = np.empty(len(piece) + 1)
        own[0] = total[-1]
        np.subtract(piece, levels[0] if levels else 0.0, out=own[1:])
        for level in levels[1:]:
            own[1:] -= level
        total = np.cumsum(own, out=own)[1:]
        yield total


class Grid:
    """Every `step`-th value of a stream, with as many of those before as `lag` bends back to."""

    def __init__(self, step: int, lag: int) -> None:
        self._step, self._most = step, 2 * lag
        self._held, self._next = np.empty(0), 0
        self._new: list[Array] = []
        self._count = 0

    def add(self, piece: Array) -> bool:
        """Take the stream's next piece; whether there are so many new values that they are worth
        a look."""
        own = piece[self._next :: self._step]
        self._new.append(own if self._step == 1 else own.copy())  # a view would hold all of it
        self._next = (self._next - len(piece)) % self._step
        self._count += len(own)
        return self._count >= BLOCK

    def window(self) -> tuple[Array, int]:
        """Values at the grid up to the end of what was taken, and how many of them were in the
        window before."""
        held = len(self._held)
        window = np.concatenate([self._held, *self._new])
        self._new, self._count = [], 0
        self._held = window[max(0, len(window) - self._most) :].copy()
        return window, held


def windows(stream: Iterable[Array], grids: Sequence[Grid]) -> Iterator[tuple[int, Array, int]]:
    """Windows of a stream on several grids, each with the number of its grid."""
    for piece in stream:
        for k, grid in enumerate(grids):
            if grid.add(piece):
                yield k, *grid.window()
    for k, grid in enumerate(grids):
        yield k, *grid.window()


def second_differences(window: Array, held: int, lag: int) -> Iterator[Array]:
    """Over `lag`, those that end behind the first `held` values of a window, block by block."""
    first, stop = max(0, held - 2 * lag), len(window) - 2 * lag
    for a in range(first, stop, BLOCK):
        b = min(a + BLOCK, stop)
        steps = window[a + lag : b + 2 * lag] - window[a : b + lag]
        yield steps[lag:] - steps[: b - a]
