"""What a log's way into its file did to the samples: bursts, lost ones, repeats, rounding.

A unit samples evenly, every sample is new, and its noise is far finer or coarser than a step of
its numbers. Drivers and adapters leave something else, and whatever reads noise from the log must
know it: all of it can be seen in the log itself.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from alignment.arrays import Array, IntArray
from alignment.parts import excerpts, parts, release

SHORT = 0.5  # of the mean step: less between two stamps is a burst
BURSTS = 0.05  # of all steps that must be so short, and as many that make up for it
ALIKE = 0.98  # of the runs of repeated rows that must be of one length, or of two that follow
OFTEN = 1.3  # rows that must stand so many times on average
FEWEST_RUNS = 32  # below which repeats may be chance
FINEST = 1e-6  # of the span of values: finer is no step, or one that matters to nobody
CHANGES = 8  # of a value, below which there is no telling what it is rounded to
ENOUGH = 1 << 18  # values that show a step, or their median, as well as those of a longer record
UNEVEN = 0.02  # of a step that differences of values may be off its multiples


@dataclass(frozen=True, slots=True)
class Bursts:
    """Stamps of arrival: `size` samples at a time on average, `count` times in the log.

    `late` [s] is how far the stamps are off even ones at most.
    """

    count: int
    size: float
    late: float


def bursts(t: Array) -> Bursts | None:
    """Whether stamps t (n,) [s] are those of samples that were handed over several at a time.

    So if many steps are far below the mean one, and yet no stamp is further off the straight line
    through them all than the longest usual step: then none was lost.
    """
    n = len(t) - 1
    if n < FEWEST_RUNS:
        return None
    mean = float(t[-1] - t[0]) / n
    if sum(int(np.count_nonzero(some < SHORT * mean)) for _, some in steps_of(t)) < BURSTS * n:
        return None
    steps = np.diff(t)
    long = steps > mean
    if not long.any():
        return None
    late = float(np.ptp(t - evened(t)))
    if late > 2 * float(np.quantile(steps[long], 0.99)):
        return None
    count = int(np.count_nonzero(long)) + 1
    return Bursts(count, len(t) / count, late)


def steps_of(t: Array) -> Iterator[tuple[int, Array]]:
    """Successive steps between stamps t (n,), part by part, each with the number of its first."""
    for rows in parts(len(t) - 1):
        yield rows.start, np.diff(t[rows.start : rows.stop + 1])
        release(t)


def evened(t: Array) -> Array:
    """Even stamps (n,) that are right for bursts: the line nearest to t, strictly increasing."""
    k = np.arange(len(t))
    slope, offset = np.polyfit(k - k.mean(), t - t[0], 1)
    return t[0] + offset + slope * (k - k.mean())


def repeats(values: Array) -> IntArray | None:
    """Where new rows begin if rows of values (n, k) stand several times each; None if not so.

    A driver that is asked more often than its unit samples gives each sample twice, or so: the
    runs of like rows are then of one length, or of two that follow one another, which runs of
    coarsely rounded values are not.
    """
    first = 0
    for rows in parts(len(values) - 1):
        part = values[rows.start : rows.stop + 1, 0]
        first += int(np.count_nonzero(part[1:] != part[:-1]))
        release(values)
    if first > 1 and len(values) < OFTEN * (first - 1):  # rows change at least as often
        return None
    changed = np.any(values[1:] != values[:-1], axis=1)
    starts = np.concatenate([[0], np.flatnonzero(changed) + 1])
    runs = np.diff(starts)[1:]
    if len(runs) < FEWEST_RUNS or runs.mean() < OFTEN:
        return None
    usual = int(np.floor(np.median(runs)))
    share = max(np.mean((runs == k) | (runs == k + 1)) for k in (usual - 1, usual))
    return starts if share >= ALIKE else None


def some_of(values: Array) -> Array:
    """Values (n,), or evenly spaced ones of more than `ENOUGH`."""
    return values[:: every(len(values))]


def every(n: int) -> int:
    """Which of n values are enough: one of so many. Odd, so that what alternates is seen."""
    return (n // ENOUGH) | 1


def step_of(values: Array) -> float:
    """The step of rounded values (n,), which are multiples of it but for an offset; 0: none.

    Values that hardly change show none: one change may be anything. Of more than `ENOUGH` values
    evenly spaced ones are looked at (of more than `parts.MOST`, of excerpts): a step that they do
    not show is finer than 1e-5 of the spread.
    """
    values = _looked_at(values)
    levels = np.unique(values)
    if len(levels) > len(values) / 2 or np.count_nonzero(np.diff(values)) < CHANGES:
        return 0.0
    gaps = np.diff(levels)
    gaps = gaps[gaps > FINEST * (levels[-1] - levels[0])]
    step = float(gaps.min())
    step = float(gaps[gaps < 1.5 * step].mean())
    multiples = gaps / step
    return step if np.all(np.abs(multiples - np.rint(multiples)) <= UNEVEN * multiples) else 0.0


def seldom_change(values: Array) -> float:
    """The least change of values (n,) that change too seldom for `step_of`; 0 of all others.

    Noise that were not far below a step would change them more often.
    """
    values = _looked_at(values)
    changes = np.abs(np.diff(values))
    changes = changes[changes > 0]
    return float(changes.min()) if 0 < len(changes) < CHANGES else 0.0


def _looked_at(values: Array) -> Array:
    pieces = excerpts(values)
    return some_of(pieces[0] if len(pieces) == 1 else np.concatenate(pieces))


def sigma_below(step: float, variance: float) -> tuple[float, float]:
    """What the noise was before it was rounded: its variance, and how far that can be off.

    Parameters
    ----------
    step : float
        Of the rounding [u].
    variance : float
        Of the rounded values [u^2].

    Notes
    -----
    Rounding adds step^2/12, and to the first harmonic of the step's period at most
    ``(step^2/pi^2 + 4 sigma^2) exp(-2 pi^2 sigma^2/step^2)``, by where within a step the mean is
    (Widrow, Kollar and Liu, IEEE Trans. Instrum. Meas. 45 (1996) 353). Below a sigma of half a
    step little is left of the noise.
    """
    left = max(variance - step**2 / 12, 0.0)
    if step == 0.0:
        return left, 0.0
    doubt = (step**2 / np.pi**2 + 4 * left) * np.exp(-2 * np.pi**2 * left / step**2)
    return left, float(doubt)
