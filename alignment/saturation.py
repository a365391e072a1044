"""Readings that stand at full scale: what the sensor felt beyond it is lost.

A log says nothing of ranges, but a clipped channel shows: its extreme value is there many times
over, with hardly any beside it, where noise and motion thin out toward their extremes.
"""

import numpy as np

from alignment.arrays import Array
from alignment.errors import Saturated
from alignment.readings import ImuReadings

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

    Raises
    ------
    Saturated
        More than 1 % of a channel's samples stand at full scale.

    Notes
    -----
    A channel that never leaves full scale cannot be told from a perfect sensor at rest.
    """
    flags = []
    for first, triad in ((0, readings.w_ib_b), (3, readings.f_b)):
        ends = np.stack([triad.max(axis=0), triad.min(axis=0)])
        counts = np.stack([np.count_nonzero(triad == end, axis=0) for end in ends])
        for side, axis in np.argwhere((counts >= LEAST) & (counts < len(readings))):
            count = int(counts[side, axis])
            if not _is_clipped(triad[:, axis], float(ends[side, axis]), count):
                continue
            share = count / len(readings)
            told = f"{CHANNELS[first + axis]} at full scale in {100 * share:.2g} % of the samples"
            if share > LARGEST_SHARE:
                raise Saturated(f"{label}: {told}: what it felt there is lost")
            flags.append(told)
    return tuple(flags)


def _is_clipped(channel: Array, end: float, count: int) -> bool:
    """Whether `count` samples of a channel (n,) pile up at its extreme value `end`."""
    inside = channel[channel != end]
    # steps away from the extreme; what differs by less is one value, rounded differently
    away = np.abs(inside - end)
    steps, times = np.unique(np.rint(away / (FINEST * away.max())), return_counts=True)
    if len(steps) < LEAST_VALUES:
        return False
    beside = times[0]
    first, third = (float(np.median(np.abs(np.diff(inside, k)))) for k in (1, 3))
    return count >= PILED * beside and third > JITTER * first
