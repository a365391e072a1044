"""Readings that stick: a channel that stands still where its own noise says that it would not.

Noise of a step or more leaves no two dozen readings alike; a channel that repeats one value for
long has died, or its link has, and what it repeats is a constant with no noise, from which a sigma
would come out too small. Noise below a step repeats too, and a perfect unit at rest does nothing
else: so a channel is held against what it shows at other times, or against its own triad.
"""

from collections.abc import Iterator

import numpy as np

from alignment.arrays import Array
from alignment.once import once
from alignment.readings import ImuReadings
from alignment.saturation import CHANNELS

LONG = 96  # samples: with as little noise as `ALIKE` allows, by chance once in 10^38 places
LOOK = 32  # one sample of so many is looked at first: two alike in turn are in a run of `LONG`
ALIKE = 0.4  # of steps may be zero in what counts as noise: its sigma is 0.7 steps
FEWEST = 5  # values that noise must take: among fewer, a drift through steps of its own rounds
ENOUGH = 4096  # samples that show what is noise
ROUGH = 0.3  # of third differences over first ones: noise has 3.2, a smooth motion next to nothing
LEAST = (1e-11, 1e-9)  # rad/s, m/s^2: below lies the rounding of a perfect unit's numbers


def stuck(readings: ImuReadings) -> str:
    """Which channel stands still for part of readings, or while its triad is noisy; '' : none.

    Parameters
    ----------
    readings : ImuReadings
        Of a real unit at rest, or moving steadily: at a rest between motions a unit too coarse
        for its noise would be taken for stuck.

    Notes
    -----
    A whole triad that never changes is another matter: it may be perfect, or too coarse
    (`unchanging`).
    """
    for channel, first, last in _runs(readings):
        t = readings.t
        return (
            f"{channel} repeats one reading from {t[first]:.6g} to {t[last]:.6g} s, "
            f"{last - first + 1} samples: it is stuck; leave that out (--from, --to, --stretches)"
        )
    return ""


def unchanging(readings: ImuReadings) -> tuple[str, ...]:
    """A flag for each triad that gives one and the same reading throughout."""
    triads = (("gyros", readings.w_ib_b), ("accelerometers", readings.f_b))
    return tuple(
        f"{name}: every reading is the same: dead, or their noise below a step, and no sigma has it"
        for name, triad in triads
        if len(triad) >= LONG and not np.ptp(triad[:LONG], axis=0).any()
        if not np.ptp(triad, axis=0).any()
    )


def dead(readings: ImuReadings) -> str:
    """Which channel never changes; '' : none. Of a unit that is turned about."""
    for name, column in zip(CHANNELS, (*readings.w_ib_b.T, *readings.f_b.T), strict=True):
        if not np.ptp(column[:LONG]) and not np.ptp(column):
            return f"{name}: every reading is the same: dead"
    return ""


@once
def _runs(readings: ImuReadings) -> tuple[tuple[str, int, int], ...]:
    """Channels that stick, with the first and the last of their like samples."""
    triads = zip((readings.w_ib_b, readings.f_b), LEAST, strict=True)
    found = [run for triad, least in triads for run in _of_triad(triad, least)]
    return tuple((CHANNELS[k], *run) for k, run in enumerate(found) if run is not None)


def _of_triad(triad: Array, least: float) -> Iterator[tuple[int, int] | None]:
    runs = [_longest(channel) for channel in triad.T]
    whole = [run == (0, len(triad) - 1) for run in runs]
    lively = any(not still and _is_noise(triad[:ENOUGH, k], least) for k, still in enumerate(whole))
    for k, run in enumerate(runs):
        if run is None or (whole[k] and not lively):
            yield None
        elif whole[k] or _is_noise(_outside(triad[:, k], *run), least):
            yield run
        else:
            yield None


def _longest(channel: Array) -> tuple[int, int] | None:
    """The first and the last of the longest run of like samples; None: shorter than `LONG`."""
    seen = channel[::LOOK]
    if len(channel) < LONG or not (seen[1:] == seen[:-1]).any():
        return None
    edges = np.concatenate([[-1], np.flatnonzero(channel[1:] != channel[:-1]), [len(channel) - 1]])
    lengths = np.diff(edges)
    k = int(np.argmax(lengths))
    return (int(edges[k]) + 1, int(edges[k + 1])) if lengths[k] >= LONG else None


def _outside(channel: Array, first: int, last: int) -> Array:
    """What lies before or after a run, the longer of both, next to it."""
    before, after = channel[:first], channel[last + 1 :]
    return before[-ENOUGH:] if len(before) >= len(after) else after[:ENOUGH]


def _is_noise(values: Array, least: float) -> bool:
    """Whether values (n,) are noise that no step hides, long enough to tell."""
    if len(values) < LONG or len(np.unique(values)) < FEWEST:
        return False
    steps = np.diff(values)
    first, third = (float(np.median(np.abs(s))) for s in (steps, np.diff(values, 3)))
    return float(np.mean(steps == 0)) <= ALIKE and first > least and third > ROUGH * first
