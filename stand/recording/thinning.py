"""Fewer rows for the eye: bins that keep their extremes, and rows only where something moved."""

from collections.abc import Iterator

import numpy as np

from alignment.arrays import Array, IntArray
from alignment.parts import PART, release

Rows = tuple[IntArray, Array]


def bin_length(n: int, budget: int) -> int:
    """Samples per bin so that `n` samples become at most `budget` rows; 1 keeps every sample."""
    return 1 if n <= budget else -(-2 * n // budget)


def min_max_bins(t_ns: IntArray, values: Array, m: int) -> Rows:
    """Two rows per bin of `m` samples: each column's minimum and maximum.

    Parameters
    ----------
    t_ns : (n,) int64
    values : (n, k)
        Each column on its own takes the extreme that came first as its first row, so a
        monotone column keeps its exact end points and a spike its sign and size.
    m : int
        Samples per bin; what is left over makes a shorter bin. 1 or 2 keep every sample.

    Returns
    -------
    t_ns : (r,) int64
        First and last time of each bin: an extreme is shown at most one bin too early or late.
    values : (r, k)
    """
    if m <= 2:
        return t_ns, values
    whole = len(t_ns) // m * m
    times, rows = _whole_bins(t_ns[:whole], values[:whole], m)
    rest = len(t_ns) - whole
    if rest == 0:
        return times, rows
    last = _whole_bins(t_ns[whole:], values[whole:], rest) if rest > 2 else None
    tail_t, tail = last or (t_ns[whole:], values[whole:])
    return np.concatenate([times, tail_t]), np.concatenate([rows, tail])


def extremes_in(t: Array, values: Array, unit: float, m: int) -> Rows:
    """Of readings (n, k) at t (n,) [s], in a unit: the rows of `min_max_bins`, part by part."""
    many = max(1, PART // m) * m
    found = []
    for first in range(0, len(t), many):
        own = slice(first, first + many)
        t_ns = np.round(t[own] * 1e9).astype(np.int64)
        found.append(min_max_bins(t_ns, np.ascontiguousarray(values[own] / unit), m))
        release(t, values)
    stamps, extremes = zip(*found, strict=True)
    return np.concatenate(stamps), np.concatenate(extremes)


def _whole_bins(t_ns: IntArray, values: Array, m: int) -> Rows:
    """`min_max_bins` of a whole number of bins."""
    width = values.shape[1]
    # One bin's column lies contiguous, so that the searches below run at memory speed.
    bins = np.ascontiguousarray(values.reshape(-1, m, width).transpose(0, 2, 1))
    low_at, high_at = bins.argmin(axis=2), bins.argmax(axis=2)
    first = np.minimum(low_at, high_at)
    second = np.maximum(low_at, high_at)
    rows = np.stack([_pick(bins, first), _pick(bins, second)], axis=1).reshape(-1, width)
    times = t_ns.reshape(-1, m)[:, [0, -1]].reshape(-1)
    return times, rows


def _pick(bins: Array, at: IntArray) -> Array:
    return np.take_along_axis(bins, at[..., None], axis=2)[..., 0]


class Regrouped:
    """Rows that arrive in blocks of any length, handed on in blocks of one length.

    What is handed on is a view into the buffer: use it before asking for the next.
    """

    def __init__(self, size: int, width: int) -> None:
        self._t_ns = np.empty(size, dtype=np.int64)
        self._values = np.empty((size, width))
        self._used = 0

    def add(self, t_ns: IntArray, values: Array) -> Iterator[Rows]:
        """Take rows (n,), (n, width) in; yield every block that became full."""
        done = 0
        while done < len(t_ns):
            take = min(len(t_ns) - done, len(self._t_ns) - self._used)
            self._t_ns[self._used : self._used + take] = t_ns[done : done + take]
            self._values[self._used : self._used + take] = values[done : done + take]
            self._used += take
            done += take
            if self._used == len(self._t_ns):
                yield from self.rest()

    def rest(self) -> Iterator[Rows]:
        """Yield what is buffered, if anything, and start anew."""
        used, self._used = self._used, 0
        if used:
            yield self._t_ns[:used], self._values[:used]


class Thinned:
    """A stream of samples as rows: all of them, or min-max bins, in large blocks.

    Parameters
    ----------
    width : int
        Columns.
    bin_length : int
        See `min_max_bins`.
    size : int
        Rows per block handed on; the buffers hold about twice as many.
    """

    def __init__(self, width: int, bin_length: int, size: int) -> None:
        self._bin = bin_length
        # Whole bins per block: where bins begin does not depend on how the samples arrive.
        self._samples = Regrouped(bin_length * max(1, size // bin_length), width)
        self._rows = Regrouped(size, width)

    def add(self, t_ns: IntArray, values: Array) -> Iterator[Rows]:
        """Take samples (n,), (n, width) in; yield blocks of rows."""
        for block in self._samples.add(t_ns, values):
            yield from self._thin(block)

    def rest(self) -> Iterator[Rows]:
        """Yield what is left at the end."""
        for block in self._samples.rest():
            yield from self._thin(block)
        yield from self._rows.rest()

    def _thin(self, block: Rows) -> Iterator[Rows]:
        if self._bin == 1:
            yield block
        else:
            yield from self._rows.add(*min_max_bins(*block, self._bin))


class Moved:
    """Every `step`-th row of a stream, and of these only where a column left its quantum.

    Comparing rounded values, not neighbours, lets no slow drift pass unseen.

    Parameters
    ----------
    step : int
    quanta : (width,)
        What counts as a change of each column.
    """

    def __init__(self, step: int, quanta: Array) -> None:
        self._step = step
        self._quanta = quanta
        self._seen = 0
        self._last = np.full((1, len(quanta)), np.nan)

    def add(self, t_ns: IntArray, values: Array) -> Rows:
        """The rows of this block that show something new."""
        ticks = slice(-self._seen % self._step, None, self._step)
        self._seen += len(t_ns)
        rounded = np.rint(values[ticks] / self._quanta)
        changed = (np.diff(rounded, axis=0, prepend=self._last) != 0.0).any(axis=1)
        self._last = rounded[-1:] if len(rounded) else self._last
        return t_ns[ticks][changed], values[ticks][changed]
