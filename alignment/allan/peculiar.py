"""What a channel at rest has in it that is no noise: knocks, outliers, jumps, lines."""

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np

from alignment.allan.covariance import stride
from alignment.allan.deviation import largest
from alignment.arrays import Array
from alignment.readings import ImuReadings
from alignment.sampling import some_of

AXES = ("x", "y", "z")
BLOCK = 64  # samples whose scatter is read about their own mean
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
LINES = 3  # that are named


def scatter(values: Array) -> Array:
    """Variances (b, k) of values (n, k) about the means of successive blocks."""
    if len(values) < BLOCK:
        return values.var(axis=0, ddof=1)[None]
    return np.stack([_scatter(np.ascontiguousarray(column)) for column in values.T], axis=1)


def _scatter(values: Array) -> Array:
    """Variances (b,) of values (n,), so many blocks at a time as a processor's cache takes."""
    blocks = values[: len(values) // BLOCK * BLOCK].reshape(-1, BLOCK)
    found = np.empty(len(blocks))
    for a in range(0, len(blocks), BLOCK):
        off = blocks[a : a + BLOCK] - blocks[a : a + BLOCK].mean(axis=1, keepdims=True)
        found[a : a + BLOCK] = np.einsum("ij,ij->i", off, off) / (BLOCK - 1)
    return found


def peculiar(sensor: str, parts: Sequence[ImuReadings], interval: float) -> list[str]:
    """One sentence for each thing that is no noise, of the stretches of one triad."""
    notes: list[str] = []
    for part in parts:
        values = part.w_ib_b if sensor == "gyro" else part.f_b
        spread = scatter(values)
        usual = np.median(spread, axis=0)
        notes += _shaken(sensor, part.t, spread, usual)
        window = np.hanning(len(values))
        for k, axis in enumerate(AXES):
            name, own = f"{sensor} {axis}", np.ascontiguousarray(values[:, k])
            if len(own) < BLOCK or np.ptp(own) <= SILENT * largest(own):
                continue
            shaken = bool((spread[:, k] > SHAKEN * usual[k]).any())
            told = [*_stuck(name, part.t, own, spread[:, k]), *_lines(name, own, window, interval)]
            told += [] if shaken else _outliers(name, part.t, own)
            notes += told if told or shaken else _steps(name, part.t, own)
    return notes


def _shaken(sensor: str, t: Array, spread: Array, usual: Array) -> Iterator[str]:
    beyond = spread > SHAKEN * np.where(usual > 0, usual, np.inf)
    if beyond.any():
        first = int(np.flatnonzero(beyond.any(axis=1))[0])
        share = 100 * np.mean(beyond.any(axis=1))
        yield (
            f"{sensor}: scatter far above the usual near {t[first * BLOCK]:.6g} s, in {share:.2g} "
            "% of the time: a knock or a vibration is in the terms"
        )


def _stuck(name: str, t: Array, values: Array, spread: Array) -> Iterator[str]:
    """Blocks of one value, looked for where the scatter (b,) is rounding."""
    blocks = values[: len(values) // BLOCK * BLOCK].reshape(-1, BLOCK)
    still = np.flatnonzero(spread <= (SILENT * largest(values)) ** 2)
    same = np.zeros(len(blocks) + 2, bool)
    same[1 + still] = np.ptp(blocks[still], axis=1) == 0
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
    off = values[2:] + values[:-2]
    off /= 2
    np.abs(np.subtract(values[1:-1], off, out=off), out=off)
    usual = float(np.median(some_of(off)))
    far = np.flatnonzero(off > FAR / NORMAL * usual) if usual > 0 else []
    if 0 < len(far) <= len(values) // BLOCK:
        highest = [
            g[np.argmax(off[g])] for g in np.split(far, np.flatnonzero(np.diff(far) > 1) + 1)
        ]
        count = "a reading" if len(highest) == 1 else f"{len(highest)} readings"
        yield (
            f"{name}: {count} more than {FAR:g} sigma off the neighbours, first at "
            f"{t[highest[0] + 1]:.6g} s: outliers are in the terms"
        )


def _steps(name: str, t: Array, values: Array) -> Iterator[str]:
    """A jump between adjacent means that is none of the other such differences, and that stays.

    Those of any normal noise, slow or not, are normal: so they are held against each other. They
    start at every m/32nd sample, as those of the variances do.
    """
    total = np.zeros(len(values) + 1)
    np.cumsum(values - values.mean(), out=total[1:])
    m = len(values) // MEANS
    while m >= SHORTEST:
        step = stride(m)
        apart = _apart(total, m, step)
        best = int(np.argmax(apart))
        k = best * step
        usual = float(np.median(some_of(apart))) / NORMAL
        at, wide = k + m, min(4 * m, k + m, len(values) - k - m)
        after, before = total[at + wide] - total[at], total[at] - total[at - wide]
        if apart[best] > JUMP * usual and abs(after - before) / wide > apart[best] / 2:
            yield f"{name}: jumps near {t[at]:.6g} s and stays there: a walk or plateau is of that"
            return
        m //= 4


def _apart(total: Array, m: int, step: int) -> Array:
    """By how much adjacent means over m samples differ, at every `step`-th sample."""
    count = len(total) - 2 * m
    found, at_once = np.empty(-(-count // step)), step * BLOCK**2
    for a in range(0, count, at_once):
        b = min(a + at_once, count)
        bend = total[a + 2 * m : b + 2 * m : step] - 2 * total[a + m : b + m : step]
        bend += total[a:b:step]
        np.abs(bend, out=found[a // step : a // step + len(bend)])
    found /= m
    return found


def _lines(name: str, values: Array, window: Array, interval: float) -> Iterator[str]:
    """Lines of the spectrum above its own level nearby; slower ones are taken for a walk."""
    n = len(values)
    windowed = values - values.mean()
    windowed *= window
    parts = np.fft.rfft(windowed).view(float).reshape(-1, 2)
    parts *= parts
    power = parts[:, 0] + parts[:, 1]
    edges = [SLOWEST]
    while edges[-1] < len(power) - SLOWEST // NEARBY:
        edges.append(edges[-1] + edges[-1] // NEARBY)
    edges[-1] = len(power)
    high: list[int] = []
    for a, b in pairwise(edges):
        level = float(np.median(some_of(power[a:b]))) / np.log(2)
        high += (a + np.flatnonzero(power[a:b] > 2 * level * np.log(n / CHANCE))).tolist()
    # a window makes three neighbours of each line: the highest of them counts
    split = np.split(np.array(high), np.flatnonzero(np.diff(high) > 3) + 1) if high else []
    lines = sorted((int(g[np.argmax(power[g])]) for g in split), key=lambda k: -power[k])
    if lines:
        shown = ", ".join(f"{k / (n * interval):.4g}" for k in lines[:LINES])
        more = f" and {len(lines) - LINES} more" if len(lines) > LINES else ""
        what = "a line" if len(lines) == 1 else "lines"
        yield f"{name}: {what} at {shown}{more} Hz: vibration or supply is in the terms"
