"""How well the axes follow: errors, torque and settling of each planned step, in bounded memory."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import ceil

import numpy as np
from numpy.typing import NDArray

from alignment.arrays import Array, set_owned
from stand.table.table import Table

SAME_STEP = 1e-6  # of a step: times nearer than this are one
STANDS = 1e-9  # rad: a demand that changes by less stands still


@dataclass(frozen=True, slots=True)
class StepSpan:
    """A planned step [s]; `rest` if it is one in which axes should stand still."""

    t_from: float
    t_to: float
    rest: bool


@dataclass(frozen=True, slots=True, eq=False)
class Followed:
    """How the n axes followed through one span.

    Attributes
    ----------
    span : Span
    greatest_error, rms_error : (n,)
        Of demand minus realised angle [rad].
    saturated_s : (n,)
        Time at the torque limit [s].
    peak_torque : (n,)
        Greatest size of the motor's torque [N m].
    rests : (n,) bool
        Which axes had to stand still: in a span of rest, those whose demand did not change.
    settling_s : tuple of n
        Of those: from the span's begin until the error stays within the table's
        `settle_within` to the span's end [s], which must be `settle_hold` later (or the whole
        span, where that is shorter). None: never, or not to stand still.
    """

    span: StepSpan
    greatest_error: Array
    rms_error: Array
    saturated_s: Array
    peak_torque: Array
    rests: NDArray[np.bool_]
    settling_s: tuple[float | None, ...]

    def __post_init__(self) -> None:
        axes = (len(self.settling_s),)
        set_owned(
            self,
            greatest_error=(self.greatest_error, axes, float),
            rms_error=(self.rms_error, axes, float),
            saturated_s=(self.saturated_s, axes, float),
            peak_torque=(self.peak_torque, axes, float),
            rests=(self.rests, axes, bool),
        )

    @property
    def settled(self) -> bool:
        """Whether every axis that had to stand still did settle."""
        return all(s is not None or not r for s, r in zip(self.settling_s, self.rests, strict=True))


@dataclass(slots=True, eq=False)
class _Tally:
    """What is known of a span so far; steps `first` to `last` - 1 are its own."""

    span: StepSpan
    first: int
    last: int
    axes: int
    greatest: Array = field(init=False)
    squares: Array = field(init=False)
    saturated: Array = field(init=False)
    peak: Array = field(init=False)
    lowest: Array = field(init=False)
    highest: Array = field(init=False)
    settled: NDArray[np.int64] = field(init=False)

    def __post_init__(self) -> None:
        for name in ("greatest", "squares", "saturated", "peak"):
            setattr(self, name, np.zeros(self.axes))
        self.lowest, self.highest = np.full(self.axes, np.inf), np.full(self.axes, -np.inf)
        self.settled = np.full(self.axes, self.first, dtype=np.int64)

    def add(self, first: int, rows: "ServoSteps", within: float) -> None:
        """Count rows of a block; `first` is the number of their first step."""
        error, torque = np.abs(rows.error), np.abs(rows.torque)
        self.greatest = np.maximum(self.greatest, error.max(axis=0))
        self.squares = self.squares + np.einsum("ij,ij->j", error, error)
        self.saturated = self.saturated + (torque >= rows.limit).sum(axis=0)
        self.peak = np.maximum(self.peak, torque.max(axis=0))
        self.lowest = np.minimum(self.lowest, rows.demand.min(axis=0))
        self.highest = np.maximum(self.highest, rows.demand.max(axis=0))
        outside = error > within
        after = first + len(error) - np.argmax(outside[::-1], axis=0)
        self.settled = np.where(outside.any(axis=0), after, self.settled)


@dataclass(frozen=True, slots=True, eq=False)
class ServoSteps:
    """Of n steps, each at its start: `demand`, `error` [rad] and motor `torque` [N m].

    `error` is demand minus realised angle; `limit` (axes,) is that of the torque.
    """

    demand: Array
    error: Array
    torque: Array
    limit: Array

    def part(self, first: int, last: int) -> "ServoSteps":
        """Rows `first` to `last` - 1."""
        cut = slice(first, last)
        return ServoSteps(self.demand[cut], self.error[cut], self.torque[cut], self.limit)


class Account:
    """Counts a run block by block.

    Parameters
    ----------
    table : Table
        For its settling window.
    start, step : float
        When step 0 begins, and how long a step is [s].
    spans : sequence of Span
        In order of time, not overlapping.
    """

    def __init__(
        self, table: Table, start: float, step: float, spans: Sequence[StepSpan], axes: int
    ) -> None:
        self._within, self._hold, self._step = table.settle_within, table.settle_hold, step
        self._done = 0  # spans before this one are over
        self._tallies = [self._tally(span, start, axes) for span in spans]

    def _tally(self, span: StepSpan, start: float, axes: int) -> _Tally:
        first, last = (ceil((t - start) / self._step - SAME_STEP) for t in (span.t_from, span.t_to))
        return _Tally(span, max(first, 0), max(last, first + 1, 1), axes)

    def add(self, first: int, rows: ServoSteps) -> None:
        """Count the next block, whose first step has the number `first`."""
        end = first + len(rows.error)
        for tally in self._tallies[self._done :]:
            if tally.first >= end:
                return
            low, high = max(tally.first, first), min(tally.last, end)
            tally.add(low, rows.part(low - first, high - first), self._within)
            self._done += tally.last <= end

    def followed(self, first: int = 0, last: int | None = None) -> list[Followed]:
        """One record per span that is over, of spans `first` to `last` - 1."""
        over = self._done if last is None else min(self._done, last)
        return [self._record(tally) for tally in self._tallies[first:over]]

    def _record(self, tally: _Tally) -> Followed:
        steps = tally.last - tally.first
        rests = (tally.highest - tally.lowest <= STANDS) & tally.span.rest
        hold = min(self._hold, steps * self._step * (1 - SAME_STEP))
        left = (tally.last - tally.settled) * self._step
        times = (tally.settled - tally.first) * self._step
        return Followed(
            tally.span,
            tally.greatest,
            np.sqrt(tally.squares / steps),
            tally.saturated * self._step,
            peak_torque=tally.peak,
            rests=rests,
            settling_s=tuple(
                float(t) if r and rest >= hold else None
                for t, r, rest in zip(times, rests, left, strict=True)
            ),
        )
