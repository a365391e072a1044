"""Many runs that differ in their seed, made as cheaply as is honest.

What is the same in every run (plan, checks, truth of a table without errors) is worked out once.
Of ideal motion the truth is evaluated only where a method will look: between the stretches the
unit goes on reporting, so that its noise, drifts and roundings take their course, but it is fed
zeros there. With a low-pass filter, which remembers what it was fed, nothing is left out, nor where
a method follows the moves; nor with a clock that is wrong or a simulated servo, whose runs are
those of `stand.simulation.simulation`.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from alignment import Dwell
from alignment.arrays import Array
from alignment.quaternions import turned_evenly
from stand.imu import Imu
from stand.imu.model import UnitErrors, draw
from stand.motion.plan import Plan, PlannedStep
from stand.motion.polynomial import MotionKind
from stand.physics.geometry import data_of, with_errors
from stand.physics.mjcf import load_model
from stand.physics.truth import Truth, sample_count, stamps_ns
from stand.procedure.steps import SwayBehind, SwayStep, VibrationBehind, VibrationStep
from stand.samples import Sensed, TruthBlock
from stand.simulation.collector import NS, DwellCollector, TrueAttitudes, ticks_of
from stand.simulation.settings import Settings, follows_moves, table_errors_of, temperature_of
from stand.simulation.simulation import Block, Simulation, begins_of
from stand.table.joints import StandModel
from stand.table.kinematics import C_NW

RANDOM = (SwayStep, SwayBehind, VibrationStep, VibrationBehind)
CHUNK = 20_000  # samples: bounds the memory of a run, and costs no speed
KEPT = 400_000  # samples of truth that are kept for the next run, 300 bytes each

Readings = tuple[list[Dwell], TrueAttitudes]


class _Sensing(NamedTuple):
    """Some samples before the unit has made anything of them."""

    truth: TruthBlock
    sensed: Sensed


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
        self._filtered = bool(
            np.isfinite([self._spec.gyro.bandwidth, self._spec.accel.bandwidth]).any()
        )
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

    def keep_moves(self) -> None:
        """From now on the moves between the stretches too: a method is asked that follows them."""
        self._moves = True

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
        return DwellCollector(plan.stretches, rate, moves=moves, imu=self._spec, stand=stand)

    def _made(self, settings: Settings) -> Readings:
        planned = self._first.replanned(settings.seed) if self._drawn else self.plan
        imu = self._imu(settings)
        collector = self._collector(planned)
        for felt in self._of(settings, planned):
            collector.add(felt.truth, imu.report(felt.sensed))
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
        truth = self._truth_of(settings)
        for first, last, step in spans(planned.stretches, settings.rate_hz, total):
            if step is None and not (self._filtered or self._moves):
                yield _nothing(first, last, settings.rate_hz)
            elif step is None or step.turning is None:
                yield self._at_rest(truth, planned, settings, first, last)
            else:
                yield _Sensing(
                    *truth.block_and_sensed(
                        planned.motion, settings.rate_hz, settings.sampling, first, last
                    )
                )

    def _truth_of(self, settings: Settings) -> Truth:
        if self._truth is None or not self._same:
            errors = table_errors_of(settings)
            turned = self._built = with_errors(self._model, errors, self._data, self._built)
            if self._truth is None:
                self._truth = Truth(
                    turned, settings.site, self._spec.places, errors, data=self._data
                )
            else:
                self._truth.change(turned, errors)
        return self._truth

    def _at_rest(
        self, truth: Truth, planned: Plan, settings: Settings, first: int, last: int
    ) -> _Sensing:
        """Without the joints, which only a turn is asked for."""
        ticks = np.arange(first, last + 1)
        rate_hz = settings.rate_hz
        over = truth.over(planned.motion, ticks / rate_hz, settings.sampling, rate_hz)
        stamps, six = stamps_ns(ticks[1:], settings.rate_hz), _zeros(last - first, 6)
        block = TruthBlock(
            t_ns=stamps,
            w_ib_b=over.w_ib_b,
            f_b=over.f_b,
            q_wb=over.q_wb,
            joints=six,
            joint_rates=six,
        )
        return _Sensing(block, over.sensed(stamps, settings.sampling))


def _nothing(first: int, last: int, rate_hz: int) -> _Sensing:
    """Samples that no method uses."""
    n = last - first
    stamps = stamps_ns(np.arange(first + 1, last + 1), rate_hz)
    three, six = _zeros(n, 3), _zeros(n, 6)
    truth = TruthBlock(
        t_ns=stamps, w_ib_b=three, f_b=three, q_wb=_zeros(n, 4), joints=six, joint_rates=six
    )
    return _Sensing(truth, Sensed(stamps, three, three))


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
    collector = DwellCollector(simulation.plan.stretches, settings.rate_hz, imu=settings.unit)
    t, q = [], []
    for block in simulation.blocks():
        collector.add(block.truth, block.readings)
        t.append(block.truth.t_ns * NS)
        q.append(block.truth.q_wb)
    dwells, attitudes = collector.finish(begins_of(simulation.records()))
    q_nb = (C_NW * Rotation.from_quat(np.concatenate(q))).as_quat()
    return Watched(dwells, attitudes, np.concatenate(t), q_nb)
