"""Whether stamps are equidistant: gaps, changes of rate, and the stretches between them."""

from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np

from alignment.arrays import Array, IntArray
from alignment.parts import excerpts, parts, release
from alignment.sampling import steps_of

GAP = 1.5  # median steps
RATE = 0.01  # relative change of the mean step
WINDOW = 1000  # steps whose mean is compared with that of as many before
LATE = 3.0  # steps that single stamps may be off by: no change of rate, in a short window
_AROUND = 8  # steps to either side that may make up for a late stamp


@dataclass(frozen=True, slots=True)
class Interruption:
    """Where stamps stop being equidistant.

    `sample` is the first one after it, at time `t` [s]. A gap misses `missing` [s]; at a change of
    rate the mean step goes from `before` to `after` [s].
    """

    kind: Literal["gap", "rate"]
    sample: int
    t: float
    missing: float = 0.0
    before: float = 0.0
    after: float = 0.0


def interruptions(t: Array) -> list[Interruption]:
    """Gaps and changes of rate of stamps t (n,) [s], strictly increasing, in order of time.

    A step is a gap if it is longer than `GAP` medians and the `_AROUND` steps to either side do not
    make up for it: a stamp that was only late is jitter. The rate changes where the mean of
    `WINDOW` steps (a tenth of a shorter stretch's) differs by `RATE` from that of as many before,
    or by `LATE` steps in a window of fewer than 300.
    """
    if len(t) < 3:
        return []
    ends = [(float(some.min()), float(some.max())) for _, some in steps_of(t)]
    found = _gaps(t) if max(b for _, b in ends) > GAP * min(a for a, _ in ends) else []
    edges = [0, *(gap.sample for gap in found), len(t)]
    for start, stop in pairwise(edges):
        found += _changes(t, start, stop)
    return sorted(found, key=lambda event: event.sample)


def between(t: Array, events: list[Interruption]) -> list[slice]:
    """The samples of the stretches without interruption, in order of time."""
    edges = [0, *(event.sample for event in events), len(t)]
    return [slice(a, b) for a, b in pairwise(edges) if b > a]


def _gaps(t: Array) -> list[Interruption]:
    usual = float(np.median(np.concatenate([np.diff(some) for some in excerpts(t)])))
    late = [first + np.flatnonzero(some > GAP * usual) for first, some in steps_of(t)]
    return [_gap(t, int(k), usual) for k in np.concatenate(late) if _is_gap(t, int(k), usual)]


def _is_gap(t: Array, k: int, usual: float) -> bool:
    around = np.diff(t[max(0, k - _AROUND) : k + _AROUND + 2])
    step = t[k + 1] - t[k]
    # Other gaps nearby count as one step each.
    others = np.where(around > GAP * usual, usual, around).sum() - usual
    return others + step > (len(around) + GAP - 1) * usual


def _gap(t: Array, k: int, usual: float) -> Interruption:
    return Interruption("gap", k + 1, float(t[k + 1]), missing=float(t[k + 1] - t[k]) - usual)


def _changes(t: Array, start: int, stop: int) -> list[Interruption]:
    """Changes of rate within samples start..stop: where the two windows differ the most."""
    window = min(WINDOW, (stop - start) // 10)
    if window < 20:
        return []
    at, before, after = _changing(t[start:stop], window, np.exp(max(RATE, LATE / window)))
    ratio = after / before
    found = []
    for run in np.split(np.arange(len(at)), np.flatnonzero(np.diff(at) > 1) + 1):
        if len(run):
            k = int(run[np.argmax(np.abs(np.log(ratio[run])))])
            sample = start + int(at[k]) + window + 1
            found.append(
                Interruption(
                    "rate",
                    sample,
                    float(t[sample]),
                    before=float(before[k]),
                    after=float(after[k]),
                )
            )
    return found


def _changing(t: Array, window: int, most: float) -> tuple[IntArray, Array, Array]:
    """Where the mean step (m,) of a window is not that of the one before, and both means (m,)."""
    found = []
    for rows in parts(len(t) - 2 * window):
        here = t[rows.start : rows.stop + 2 * window]
        mean = (here[window:] - here[:-window]) / window
        ratio = mean[window:] / mean[:-window]
        at = np.flatnonzero((ratio > most) | (ratio < 1 / most))
        found.append((rows.start + at, mean[at], mean[at + window]))
        release(t)
    at, before, after = (np.concatenate(columns) for columns in zip(*found, strict=True))
    return at, before, after
