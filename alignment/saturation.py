"""Readings that stand at full scale: what the sensor felt beyond it is lost.

A range that is stated is known. Else a clipped channel shows: its extreme value is there many times
over, with hardly any beside it, where noise and motion thin out toward their extremes; and it is
left and reached in full strides, by noise or by motion, where a channel that rests there and then
moves starts from standstill, in steps of its numbers.
"""

import numpy as np
from numpy.typing import NDArray

from alignment.arrays import Array
from alignment.cores import over_cores
from alignment.errors import Saturated
from alignment.once import once
from alignment.parts import PART, excerpts, in_parts, parts, release
from alignment.readings import ImuReadings
from alignment.sampling import step_of

CHANNELS = (
    "X1 gyro",
    "Y1 gyro",
    "Z1 gyro",
    "X1 accelerometer",
    "Y1 accelerometer",
    "Z1 accelerometer",
)
LEAST = 8  # samples at the extreme, below which it may be chance
PILED = 4.0  # times the samples at the next value: a rounded sinusoid has 1 + sqrt 2 at most
LEAST_VALUES = 16  # different ones, below which rounding alone piles up so
FINEST = 1e-6  # of the span of values: finer than 19 bits
JITTER = 0.03  # of third differences over first ones: below it a smooth motion may have a plateau
STRIDE = 0.25  # of the median step between samples: less to or from the extreme is no clipping
ROUNDED = 1.5  # steps of the numbers that third differences must exceed: rounding makes one, ...
TWICE = 3.0  # ... rounding twice two, which matters where a plateau is there a few times only
FEW = 4
NEAR_RANGE = 0.01  # relative, within which a value may be rounded from full scale
AT_RANGE = 1e-6  # relative, that a value at full scale may be off the stated range
# One-sided clipping of 1 % of white noise shifts a mean by 0.003 of the noise's sigma, as much as
# the noise itself leaves of it in 90 000 samples.
LARGEST_SHARE = 0.01


def saturation_doubt(label: str, readings: ImuReadings) -> tuple[str, ...]:
    """A flag for each channel that is clipped now and then.

    Parameters
    ----------
    label : str
        What to call the stretch in a refusal.
    readings : ImuReadings
        With the full scale that the data sheet states, if it does.

    Raises
    ------
    Saturated
        More than 1 % of a channel's samples stand at full scale.

    Notes
    -----
    A channel that never leaves full scale cannot be told from a perfect sensor at rest.
    """
    flags = []
    for channel, count in zip(CHANNELS, _clipped_counts(readings), strict=True):
        if not count:
            continue
        share = count / len(readings)
        percent = f"{100 * share:.2g}" if share < 0.1 else f"{100 * share:.0f}"
        told = f"{channel} at full scale in {percent} % of the samples"
        if share > LARGEST_SHARE:
            raise Saturated(f"{label}: {told}: what it felt there is lost")
        flags.append(told)
    return tuple(flags)


@once
def _clipped_counts(readings: ImuReadings) -> tuple[int, ...]:
    """How many samples of each channel are clipped."""
    triads = zip((readings.w_ib_b, readings.f_b), readings.ranges, strict=True)
    channels = [(channel, stated) for triad, stated in triads for channel in triad.T]
    each = over_cores if len(readings) > PART else map
    return tuple(each(lambda one: _at_full_scale(*one), channels))


def clipped(readings: ImuReadings) -> NDArray[np.bool_]:
    """Which samples (n, 6) of gyros and accelerometers stand at full scale."""
    found = np.zeros((len(readings), len(CHANNELS)), bool)
    triads = (readings.w_ib_b, readings.f_b)
    for first, triad, stated in zip((0, 3), triads, readings.ranges, strict=True):
        for axis in range(triad.shape[1]):
            channel = triad[:, axis]
            if not _at_full_scale(channel, stated):
                continue
            for end in (channel.max(), channel.min()):
                near = AT_RANGE * abs(end) + step_of(channel) / 2 if np.isfinite(stated) else 0.0
                at_end = np.abs(channel - end) <= near
                known = np.isfinite(stated) and abs(end) >= (1 - NEAR_RANGE) * stated
                if known or np.count_nonzero(at_end) >= LEAST:
                    found[:, first + axis] |= at_end
    return found


def _at_full_scale(channel: Array, stated: float) -> int:
    """How many samples of a channel (n,) are clipped."""
    ends = [(part.max(), part.min()) for part in in_parts(channel)]
    highest, lowest = float(max(high for high, _ in ends)), float(min(low for _, low in ends))
    if np.isfinite(stated):
        if max(highest, -lowest) < (1 - NEAR_RANGE) * stated:
            return 0
        # what is clipped and then rounded may be half a step short of it
        least = (1 - AT_RANGE) * stated - step_of(channel) / 2
        return sum(int(np.count_nonzero(np.abs(part) >= least)) for part in in_parts(channel))
    total = 0
    for end, away in ((highest, 1.0), (lowest, -1.0)):
        if away * end <= 0:  # full scale lies away from zero
            continue
        count = sum(int(np.count_nonzero(part == end)) for part in in_parts(channel))
        if LEAST <= count < len(channel) and _is_clipped(channel, end, count):
            total += count
    return total


def _is_clipped(channel: Array, end: float, count: int) -> bool:
    """Whether the `count` samples of a channel (n,) that are at its extreme `end` pile up there."""
    farthest = max(float(np.abs(part - end).max()) for part in in_parts(channel))
    values, next_to_it = _nearest(channel, end, FINEST * farthest)
    if values < LEAST_VALUES or count < PILED * next_to_it:
        return False
    strides = _strides(channel, end)
    rounding = (TWICE if len(strides) < 2 * FEW else ROUNDED) * step_of(channel)
    inside = [some[some != end] for some in excerpts(channel)]
    first, third = (
        float(np.median(np.abs(np.concatenate([np.diff(some, k) for some in inside]))))
        for k in (1, 3)
    )
    return third > max(JITTER * first, rounding) and float(np.mean(strides)) >= STRIDE * first


def _nearest(channel: Array, end: float, step: float) -> tuple[int, int]:
    """Of values off `end`, in steps: how many there are (up to `LEAST_VALUES`), and how many times
    the nearest stands. What differs by less than a step is one value, rounded differently.
    """
    times: dict[float, int] = {}
    for part in in_parts(channel):
        off = np.rint(np.abs(part[part != end] - end) / step)
        for value, count in zip(*np.unique(off, return_counts=True), strict=True):
            if len(times) >= LEAST_VALUES and value > max(times):
                break
            times[float(value)] = times.get(float(value), 0) + int(count)
    return len(times), times[min(times)]


def _strides(channel: Array, end: float) -> Array:
    """How far samples lie from the extreme that they leave, then those from which it is reached."""
    left, reached = [], []
    for rows in parts(len(channel)):
        part = channel[rows.start : rows.stop + 1]
        at_end = part == end
        left.append(part[1:][~at_end[1:] & at_end[:-1]])
        reached.append(part[:-1][~at_end[:-1] & at_end[1:]])
        release(channel)
    return np.abs(np.concatenate([*left, *reached]) - end)
