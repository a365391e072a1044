"""Many runs that differ in their seed, made as cheaply as is honest.

What is the same in every run (plan, checks, truth of a table without errors) is worked out once.
Of ideal motion the truth is evaluated only where a method will look: between the stretches the
unit goes on reporting, so that its noise, drifts and roundings take their course, but it is fed
zeros there, but for so long before a stretch as a low-pass filter remembers. All rests are
evaluated at once, and the unit reports several stretches at once where they are short: of a rest
of minutes most of the time was that of calls. Nothing is left out where a method follows the moves;
nor with a clock that is wrong or a simulated servo, whose runs are those of
`stand.simulation.simulation`.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import fields, replace
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from alignment import Dwell
from alignment.arrays import Array, IntArray
from alignment.quaternions import turned_evenly
from stand.imu import Imu
from stand.imu.filter import remembered
from stand.imu.model import UnitErrors, draw
from stand.motion.plan import Plan, PlannedStep
from stand.motion.polynomial import MotionKind
from stand.physics.geometry import data_of, with_errors
from stand.physics.mjcf import load_model
from stand.physics.truth import Samples, Truth, rest_of, sample_count, stamps_ns
from stand.procedure.steps import SwayBehind, SwayStep, VibrationBehind, VibrationStep
from stand.samples import ImuBlock, Sensed, TruthBlock
from stand.simulation.collector import NS, DwellCollector, TrueAttitudes, ticks_of
from stand.simulation.settings import Settings, follows_moves, table_errors_of, temperature_of
from stand.simulation.simulation import Block, Simulation, begins_of
from stand.table.joints import StandModel
from stand.table.kinematics import C_NW

RANDOM = (SwayStep, SwayBehind, VibrationStep, VibrationBehind)
CHUNK = 20_000  # samples: bounds the memory of a run, and costs no speed
KEPT = 400_000  # samples of truth that are kept for the next run, 300 bytes each
HELD = 400_000  # samples of several runs that are estimated from at once, 56 bytes each
MOST_AT_ONCE = 32  # runs: more gain little
AT_ONCE = 4096  # samples that the unit reports in one call: beyond it copies cost more than calls

Readings = tuple[list[Dwell], TrueAttitudes]


class _Sensing(NamedTuple):
    """Some samples before the unit has made anything of them."""

    truth: TruthBlock
    sensed: Sensed


class _Span(NamedTuple):
    """Samples [first, last), and whether the table stands still over all of them."""

    first: int
    last: int
    step: PlannedStep | None
    still: bool
    fed: bool  # with zeros


class Trials:
    """Runs of one setting by their seed.

    Raises
    ------
    StandError, AlignmentError
        As `Simulation`: the setting is impossible.
    """

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self._first = first = Simulation(settings)
        entry = settings.procedure.entry
        self.plan: Plan = first.plan
        self._drawn = any(isinstance(part, RANDOM) for part in (*entry.step, *entry.background))
        self._whole = settings.motion is MotionKind.SERVO or not first.imu.spec.clock.perfect
        self._spec = settings.unit
        bandwidth = min(self._spec.gyro.bandwidth, self._spec.accel.bandwidth)
        self._memory = remembered(bandwidth, settings.rate_hz, settings.sampling)
        self._spans: list[_Span] = []  # of `plan`, once they were asked for
        self._moves = follows_moves(settings)
        self._model = load_model(settings.table.model)
        self._data = data_of(self._model)  # to work out each run's table in
        self._same = not self._drawn and first.errors.perfect and first.imu.spec.clock.perfect
        self._felt: list[_Sensing] = []
        self._blocks: list[Block] = []
        self._begins: dict[str, float | None] = {}
        self._truth: Truth | None = None
        self._built: Any = None  # the model of the last run's table
        self._last: tuple[int, Imu] | None = None  # the unit of the last run

    @property
    def at_once(self) -> int:
        """Of how many runs there is room for the readings."""
        total = sample_count(self.plan.motion.duration, self.settings.rate_hz)
        return max(1, min(MOST_AT_ONCE, HELD // max(total, 1)))

    def keep_moves(self) -> None:
        """From now on the moves between the stretches too: a method is asked that follows them."""
        self._moves, self._spans = True, []

    def readings(self, seed: int) -> Readings:
        """The stretches of a run, and the true ``C_nb`` of each: at its end (encoder angle 0)."""
        settings = replace(self.settings, seed=seed)
        return self._simulated(settings) if self._whole else self._made(settings)

    def biases(self, seed: int) -> Array:
        """The turn-on biases (6,) that the unit of a run was given: [rad/s], then [m/s^2]."""
        if self._last is not None and self._last[0] == seed:
            imu = self._last[1]
            return np.concatenate([imu.gyro_errors.bias, imu.accel_errors.bias])
        sensors = (("gyro", self._spec.gyro), ("accel", self._spec.accel))
        return np.concatenate([draw(spec, seed, sensor).bias for sensor, spec in sensors])

    def units(self, seed: int) -> tuple[UnitErrors, UnitErrors]:
        """The constants that the gyros and the accelerometers of a run were given."""
        return draw(self._spec.gyro, seed, "gyro"), draw(self._spec.accel, seed, "accel")

    # --- whole simulations

    def _simulated(self, settings: Settings) -> Readings:
        if self._blocks:
            imu = self._imu(settings)
            collector = self._collector(self.plan, self._first.encoders_of)
            for block in self._blocks:
                collector.add(block.truth, imu.report(block.sensed))
            return collector.finish(self._begins)
        simulation = Simulation(settings)
        collector = self._collector(simulation.plan, simulation.encoders_of)
        keep = self._same and simulation.total <= KEPT
        for block in simulation.blocks():
            collector.add(block.truth, block.readings)
            if keep:
                self._blocks.append(block)
        self._begins = begins_of(simulation.records())
        return collector.finish(self._begins)

    # --- ideal motion

    def _collector(self, plan: Plan, stand: StandModel | None = None) -> DwellCollector:
        rate, moves = self.settings.rate_hz, self._moves
        told = {"imu": self._spec, "sampling": self.settings.sampling}
        return DwellCollector(plan.stretches, rate, moves=moves, stand=stand, **told)

    def _made(self, settings: Settings) -> Readings:
        planned = self._first.replanned(settings.seed) if self._drawn else self.plan
        imu = self._imu(settings)
        collector = self._collector(planned)
        for truth, readings in _reported(imu, self._of(settings, planned)):
            collector.add(truth, readings)
        return collector.finish()

    def _imu(self, settings: Settings) -> Imu:
        temperature = temperature_of(settings.procedure)
        imu = Imu(
            self._spec, settings.seed, settings.rate_hz, temperature, sampling=settings.sampling
        )
        self._last = settings.seed, imu
        return imu

    def _of(self, settings: Settings, planned: Plan) -> Iterator[_Sensing]:
        total = sample_count(planned.motion.duration, settings.rate_hz)
        if not self._same or total > KEPT:
            yield from self._evaluated(settings, planned, total)
            return
        if not self._felt:
            self._felt = list(self._evaluated(settings, planned, total))
        yield from self._felt

    def _evaluated(self, settings: Settings, planned: Plan, total: int) -> Iterator[_Sensing]:
        truth, rate_hz = self._truth_of(settings), settings.rate_hz
        every = self._spans_of(planned, rate_hz, total)
        rests = iter(_held(truth, planned, [span for span in every if span.still], rate_hz))
        for span in every:
            if span.fed:
                yield self._nothing(span)
            elif span.still:
                yield self._at_rest(span, next(rests))
            elif span.step is None or span.step.turning is None:
                yield self._at_rest(span, self._moved(truth, planned, span))
            else:
                yield _Sensing(
                    *truth.block_and_sensed(
                        planned.motion, rate_hz, settings.sampling, span.first, span.last
                    )
                )

    def _spans_of(self, planned: Plan, rate_hz: int, total: int) -> list[_Span]:
        """Of the plan that all runs have they are found once."""
        if self._spans and planned is self.plan:
            return self._spans
        found = []
        for first, last, step in spans(planned.stretches, rate_hz, total):
            begin = first
            if step is None and not self._followed:
                begin = last if last == total else max(first, last - self._memory)
                if first < begin:
                    found.append(_Span(first, begin, None, still=False, fed=True))
            if begin < last:
                turning = step is not None and step.turning is not None
                edges = np.arange(begin, last + 1) / rate_hz
                still = not turning and bool(rest_of(planned.motion, edges).all())
                found.append(_Span(begin, last, step, still=still, fed=False))
        if planned is self.plan:
            self._spans = found
        return found

    @property
    def _followed(self) -> bool:
        """Whether moves are asked for, or a filtered unit sums up roundings of all it was fed."""
        return self._moves or (self._memory > 0 and self._spec.increments)

    def _moved(self, truth: Truth, planned: Plan, span: _Span) -> Samples:
        rate_hz = self.settings.rate_hz
        edges = np.arange(span.first, span.last + 1) / rate_hz
        return truth.over(planned.motion, edges, self.settings.sampling, rate_hz)

    def _truth_of(self, settings: Settings) -> Truth:
        if self._truth is None or not self._same:
            errors = table_errors_of(settings)
            turned = self._built = with_errors(self._model, errors, self._data, self._built)
            if self._truth is None:
                self._truth = Truth(
                    turned,
                    settings.site,
                    self._spec.places,
                    errors,
                    data=self._data,
                    both=self._spec.filtered,
                )
            else:
                self._truth.change(turned, errors)
        return self._truth

    def _at_rest(self, span: _Span, over: Samples) -> _Sensing:
        """Without the joints, which only a turn is asked for."""
        stamps, six = self._stamps(span), _zeros(span.last - span.first, 6)
        block = TruthBlock(
            t_ns=stamps,
            w_ib_b=over.w_ib_b,
            f_b=over.f_b,
            q_wb=over.q_wb,
            joints=six,
            joint_rates=six,
        )
        return _Sensing(block, over.sensed(stamps))

    def _nothing(self, span: _Span) -> _Sensing:
        """Samples that no method uses."""
        n, stamps = span.last - span.first, self._stamps(span)
        three, six = _zeros(n, 3), _zeros(n, 6)
        truth = TruthBlock(
            t_ns=stamps, w_ib_b=three, f_b=three, q_wb=_zeros(n, 4), joints=six, joint_rates=six
        )
        other = three if self._spec.filtered else None
        return _Sensing(truth, Sensed(stamps, three, three, w_other=other, f_other=other))

    def _stamps(self, span: _Span) -> IntArray:
        return stamps_ns(np.arange(span.first + 1, span.last + 1), self.settings.rate_hz)


def _held(truth: Truth, planned: Plan, spans: Sequence[_Span], rate_hz: int) -> Iterator[Samples]:
    """The samples of rests, all evaluated at once."""
    if not spans:
        return
    every = truth.held(planned.motion, np.array([span.last for span in spans]) / rate_hz)
    named = every.locked().given()  # one row stands for many, without copies
    for k, span in enumerate(spans):
        n = span.last - span.first
        rows = {
            name: np.broadcast_to(values[k], (n, values.shape[1])) for name, values in named.items()
        }
        yield Samples(**rows)


def _reported(imu: Imu, every: Iterable[_Sensing]) -> Iterator[tuple[TruthBlock, ImuBlock]]:
    """What the unit makes of it, several blocks at once where they are short."""
    waiting: list[_Sensing] = []
    for one in every:
        if sum(len(w.truth) for w in waiting) + len(one.truth) > AT_ONCE:
            yield from _together(imu, waiting)
            waiting = []
        waiting.append(one)
    yield from _together(imu, waiting)


def _together(imu: Imu, waiting: Sequence[_Sensing]) -> Iterator[tuple[TruthBlock, ImuBlock]]:
    if len(waiting) == 1:
        yield waiting[0].truth, imu.report(waiting[0].sensed)
    elif waiting:
        parts = [one.sensed for one in waiting]
        readings = imu.report(_joined(parts))
        begin = 0
        for one in waiting:
            end = begin + len(one.truth)
            yield one.truth, readings.part(slice(begin, end))
            begin = end


def _joined(parts: Sequence[Sensed]) -> Sensed:
    names = [field.name for field in fields(Sensed) if getattr(parts[0], field.name) is not None]
    return Sensed(**{n: np.concatenate([getattr(part, n) for part in parts]) for n in names})


def _zeros(n: int, k: int) -> Array:
    """(n, k), which take no memory."""
    one = np.zeros((1, k))
    one.flags.writeable = False
    return np.broadcast_to(one, (n, k))


def spans(
    stretches: Sequence[PlannedStep], rate_hz: int, total: int
) -> Iterator[tuple[int, int, PlannedStep | None]]:
    """Samples [first, last) in order with the stretch they belong to, `CHUNK` of them at most.

    None: they lie, wholly or in part, outside all stretches.
    """
    at = 0
    bounds: list[tuple[int, int, PlannedStep | None]] = []
    for step in sorted(stretches, key=lambda step: step.steady_from):
        first, last = ticks_of(step, rate_hz)
        bounds += [(at, first, None), (first, last, step)]
        at = last
    bounds.append((at, total, None))
    for first, last, step in bounds:
        for start in range(first, last, CHUNK):
            yield start, min(start + CHUNK, last), step


class Watched(NamedTuple):
    """One run whose true attitude is known at every sample of its stretches."""

    dwells: list[Dwell]
    attitudes: list[Rotation]
    t: Array
    q_nb: Array

    def C_nb(self, t: Array) -> Rotation:
        """True attitude at times [s] between samples of one stretch."""
        return turned_evenly(self.t, self.q_nb, t)


def watch(settings: Settings) -> Watched:
    """One run by `stand.simulation.simulation`, for curves over time."""
    simulation = Simulation(settings)
    told = {"imu": settings.unit, "sampling": settings.sampling}
    collector = DwellCollector(simulation.plan.stretches, settings.rate_hz, **told)
    t, q = [], []
    for block in simulation.blocks():
        collector.add(block.truth, block.readings)
        t.append(block.truth.t_ns * NS)
        q.append(block.truth.q_wb)
    dwells, attitudes = collector.finish(begins_of(simulation.records()))
    q_nb = (C_NW * Rotation.from_quat(np.concatenate(q))).as_quat()
    return Watched(dwells, attitudes, np.concatenate(t), q_nb)
