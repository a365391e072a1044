"""What a channel at rest has in it that is no noise: knocks, outliers, jumps, lines."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import pairwise

import numpy as np
from scipy.special import chdtri

from alignment.allan.covariance import stride
from alignment.allan.running import PIECE, Grid, pieces, running_sum, second_differences, windows
from alignment.arrays import Array, IntArray
from alignment.parts import in_parts, parts, release
from alignment.readings import ImuReadings
from alignment.sampling import every, some_of

AXES = ("x", "y", "z")
BLOCK = 64  # samples whose scatter is read about their own mean
AT_ONCE = 512  # blocks: a quarter of a MB
SHAKEN = 25.0  # times the median variance in such a block: no chance, but a knock or a vibration
FAR = 8.0  # usual deviations from the mean of both neighbours: no chance in any record
SILENT = 1e-13  # of the signal's size: less is rounding
STUCK = 4  # blocks without any scatter, one after the other
JUMP = 7.0  # usual differences of adjacent means: no chance in any record
NORMAL = 0.6745  # median size of a normal number
MEANS, SHORTEST = 32, 16  # in a record at least, samples of one
CHANCE = 1e-4  # that white noise shows a line in one channel
SLOWEST = 256  # periods of a record: of slower ones the level nearby is not known
NEARBY = 8  # part of a frequency over which the median is what a line stands on
BESIDE = 32  # frequencies to either side of a line that tell the level there at least, ...
WIDE = 4  # ... from this one on: a window makes three neighbours of each line
LINES = 3  # that are named
SEGMENT = 1 << 21  # samples whose spectrum is taken at once: over half an hour at 1 kHz
_FINE = 5  # bits of a segment's length that may differ from 0: few small factors


def scatter(values: Array) -> Array:
    """Variances (b, k) of values (n, k) about the means of successive blocks."""
    if len(values) < BLOCK:
        return values.var(axis=0, ddof=1)[None]
    whole = values[: len(values) // BLOCK * BLOCK]
    return np.concatenate([_scatter(part) for part in in_parts(whole)])


def _scatter(values: Array) -> Array:
    """Variances (b, k) of values (n, k), so many blocks at a time as a processor's cache takes."""
    found = np.empty((len(values) // BLOCK, values.shape[1]))
    for a in range(0, len(found), AT_ONCE):
        for k, column in enumerate(values[a * BLOCK : (a + AT_ONCE) * BLOCK].T):
            blocks = np.ascontiguousarray(column).reshape(-1, BLOCK)
            off = blocks - blocks.mean(axis=1, keepdims=True)
            found[a : a + AT_ONCE, k] = np.einsum("ij,ij->i", off, off) / (BLOCK - 1)
    return found


def peculiar(sensor: str, stretches: Sequence[ImuReadings], interval: float) -> list[str]:
    """One sentence for each thing that is no noise, of the stretches of one triad."""
    notes: list[str] = []
    for part in stretches:
        values = part.w_ib_b if sensor == "gyro" else part.f_b
        spread = scatter(values)
        usual = np.median(spread, axis=0)
        notes += _shaken(sensor, part.t, spread, usual)
        low, high = _ends(values)
        rounds = SILENT * np.maximum(high, -low)
        for k, axis in enumerate(AXES):
            name, own = f"{sensor} {axis}", values[:, k]
            if len(own) < BLOCK or high[k] - low[k] <= rounds[k]:
                continue
            shaken = bool((spread[:, k] > SHAKEN * usual[k]).any())
            told = [*_stuck(name, part.t, own, spread[:, k] <= rounds[k] ** 2)]
            told += _lines(name, own, interval)
            told += [] if shaken else _outliers(name, part.t, own)
            notes += told if told or shaken else _steps(name, part.t, own)
    return notes


def _ends(values: Array) -> tuple[Array, Array]:
    """The lowest and the highest (k,) of values (n, k)."""
    found = [[(column.min(), column.max()) for column in some.T] for some in in_parts(values)]
    low, high = np.moveaxis(np.array(found), 2, 0)
    return low.min(axis=0), high.max(axis=0)


def _shaken(sensor: str, t: Array, spread: Array, usual: Array) -> Iterator[str]:
    beyond = spread > SHAKEN * np.where(usual > 0, usual, np.inf)
    if beyond.any():
        first = int(np.flatnonzero(beyond.any(axis=1))[0])
        share = 100 * np.mean(beyond.any(axis=1))
        yield (
            f"{sensor}: scatter far above the usual near {t[first * BLOCK]:.6g} s, in {share:.2g} "
            "% of the time: a knock or a vibration is in the terms"
        )


def _stuck(name: str, t: Array, values: Array, silent: np.ndarray) -> Iterator[str]:
    """Blocks of one value, of those (b,) whose scatter is rounding."""
    same = np.zeros(len(silent) + 2, bool)
    for rows in parts(len(silent) if silent.any() else 0):
        blocks = values[rows.start * BLOCK : rows.stop * BLOCK].reshape(-1, BLOCK)
        own = np.flatnonzero(silent[rows])
        same[1 + rows.start + own] = np.ptp(blocks[own], axis=1) == 0
        release(values)
    edges = np.flatnonzero(same[1:] != same[:-1]).reshape(-1, 2)
    long = edges[edges[:, 1] - edges[:, 0] >= STUCK]
    if len(long):
        begin, end = long[0]
        yield (
            f"{name}: the same reading from {t[begin * BLOCK]:.6g} to "
            f"{t[end * BLOCK - 1]:.6g} s: it stuck, and the terms are of both"
        )


def _outliers(name: str, t: Array, values: Array) -> Iterator[str]:
    """Single readings far from both their neighbours, where others are not."""
    usual = float(np.median(_some_off(values)))
    if not usual:
        return
    off, far = _farther(values, FAR / NORMAL * usual)
    if 0 < len(far) <= len(values) // BLOCK:
        runs = np.split(np.arange(len(far)), np.flatnonzero(np.diff(far) > 1) + 1)
        highest = [far[run[np.argmax(off[run])]] for run in runs]
        count = "a reading" if len(highest) == 1 else f"{len(highest)} readings"
        yield (
            f"{name}: {count} more than {FAR:g} sigma off the neighbours, first at "
            f"{t[highest[0] + 1]:.6g} s: outliers are in the terms"
        )


def _off(values: Array, step: int = 1) -> Array:
    """How far values (n,) are off the mean of both neighbours: every `step`-th but the ends."""
    off = values[2::step] + values[:-2:step]
    off /= 2
    return np.abs(np.subtract(values[1:-1:step], off, out=off), out=off)


def _some_off(values: Array) -> Array:
    """The same of evenly spaced values, part by part."""
    found, step = [], every(len(values) - 2)
    for rows in parts(len(values) - 2):
        first = rows.start + -rows.start % step
        found.append(_off(values[first : rows.stop + 2], step))
        release(values)
    return np.concatenate(found)


def _farther(values: Array, allowed: float) -> tuple[Array, IntArray]:
    """How far those are off that are off by more than is allowed, and which (k,) they are, from
    the second on."""
    found: list[Array] = [np.empty(0)]
    numbers: list[IntArray] = [np.empty(0, np.int64)]
    for rows in parts(len(values) - 2, PIECE):
        off = _off(values[rows.start : rows.stop + 2])
        far = np.flatnonzero(off > allowed)
        found.append(off[far])
        numbers.append(far + rows.start)
        release(values)
    return np.concatenate(found), np.concatenate(numbers)


@dataclass(slots=True)
class _Apart:
    """By how much adjacent means over `step` times `lag` samples differ, at every `step`-th."""

    step: int
    lag: int
    count: int
    most: float = -1.0
    best: int = 0  # the sample with which the two means of `most` begin
    some: list[Array] = field(default_factory=list)
    _seen: int = 0

    def add(self, differences: Array) -> None:
        """The next of them, but for the division by the number of samples."""
        sizes = np.abs(differences)
        k = int(np.argmax(sizes))
        if sizes[k] > self.most:
            self.most, self.best = float(sizes[k]), (self._seen + k) * self.step
        apart = every(self.count)
        self.some.append(sizes[-self._seen % apart :: apart].copy())
        self._seen += len(sizes)


def _steps(name: str, t: Array, values: Array) -> Iterator[str]:
    """A jump between adjacent means that is none of the other such differences, and that stays.

    Those of any normal noise, slow or not, are normal: so they are held against each other. They
    start at every m/32nd sample, as those of the variances do.
    """
    n, levels = len(values), _levels(len(values))
    grids = [Grid(level.step, level.lag) for level in levels]
    for grid, window, held in windows(running_sum(values, _level(values)), grids):
        for some in second_differences(window, held, levels[grid].lag):
            levels[grid].add(some)
    for level in levels:
        usual = float(np.median(np.concatenate(level.some))) / NORMAL
        m = level.step * level.lag
        at = level.best + m
        wide = min(4 * m, at, n - at)
        if not level.most > JUMP * usual:
            continue
        apart = abs(float(values[at : at + wide].sum() - values[at - wide : at].sum())) / wide
        if apart > level.most / m / 2:
            yield f"{name}: jumps near {t[at]:.6g} s and stays there: a walk or plateau is of that"
            return


def _level(values: Array) -> float:
    """Near enough the mean of values (n,) that their running sum stays small."""
    return sum(float(piece.sum()) for piece in pieces(values)) / len(values)


def _levels(n: int) -> list[_Apart]:
    """The numbers of samples that are averaged of n, the most first."""
    found, m = [], n // MEANS
    while m >= SHORTEST:
        step = stride(m)
        lag = m // step
        found.append(_Apart(step, lag, -(-(n + 1 - 2 * lag * step) // step)))
        m //= 4
    return found


def _lines(name: str, values: Array, interval: float) -> Iterator[str]:
    """Lines of the spectrum above its own level nearby; slower ones are taken for a walk.

    Notes
    -----
    Of a long record the mean spectrum of several segments: its level is chi-square of twice as
    many degrees of freedom. The level falls steeply where a unit's filter cuts: so a line stands
    above the higher of those just below and just above it, too.
    """
    count, n = _segments(len(values))
    power = _spectrum(values, count, n)
    edges = [SLOWEST]
    while edges[-1] < len(power) - SLOWEST // NEARBY:
        edges.append(edges[-1] + edges[-1] // NEARBY)
    edges[-1] = len(power)
    high: list[int] = []
    beyond = 2 * chdtri(2 * count, CHANCE / n) / chdtri(2 * count, 0.5)
    for a, b in pairwise(edges):
        level = float(np.median(some_of(power[a:b])))
        found = a + np.flatnonzero(power[a:b] > beyond * level)
        high += [k for k in found.tolist() if power[k] > beyond * _around(power, k)]
    # a window makes three neighbours of each line: the highest of them counts
    split = np.split(np.array(high), np.flatnonzero(np.diff(high) > 3) + 1) if high else []
    lines = sorted((int(g[np.argmax(power[g])]) for g in split), key=lambda k: -power[k])
    if lines:
        shown = ", ".join(f"{k / (n * interval):.4g}" for k in lines[:LINES])
        more = f" and {len(lines) - LINES} more" if len(lines) > LINES else ""
        what = "a line" if len(lines) == 1 else "lines"
        yield f"{name}: {what} at {shown}{more} Hz: vibration or supply is in the terms"


def _around(power: Array, k: int) -> float:
    """The higher of the median powers of `BESIDE` frequencies or more below k, and above it."""
    reach = max(BESIDE, k // (4 * NEARBY))  # a fan's speed wanders
    below, above = power[max(1, k - WIDE - reach) : k - WIDE], power[k + WIDE :][:reach]
    return max(float(np.median(some)) for some in (below, above) if len(some) > WIDE)


def _segments(n: int) -> tuple[int, int]:
    """How many segments of n samples, and of how many each, so that a transform is quick."""
    count = -(-n // SEGMENT)
    if count == 1:
        return 1, n
    length = n // count
    unit = 1 << (length.bit_length() - _FINE)
    return count, length // unit * unit


def _spectrum(values: Array, count: int, n: int) -> Array:
    """Mean power (n // 2 + 1,) of so many segments of n samples, spread evenly, windowed."""
    window, total = _window(n), np.zeros(n // 2 + 1)
    own, transform = np.empty(n), np.empty(n // 2 + 1, complex)  # new memory takes as long as FFTs
    for first in np.linspace(0, len(values) - n, count).astype(int).tolist():
        own[:] = values[first : first + n]
        own -= own.mean()
        own *= window
        halves = np.fft.rfft(own, out=transform).view(float).reshape(-1, 2)
        halves *= halves
        total += halves[:, 0]
        total += halves[:, 1]
        release(values)
    return total


@lru_cache(maxsize=1)
def _window(n: int) -> Array:
    """Hann's, of all channels of a record."""
    window = np.hanning(n)
    window.flags.writeable = False
    return window
