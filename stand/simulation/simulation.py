"""A run as it goes: plan, table with its errors, drive, truth and readings, block by block.

What is made of the samples is for others to say: `stand.recorded_run` records them,
`stand.evaluation.comparison`
sets methods side by side on them.
"""

import os
from collections import deque
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from itertools import islice
from queue import SimpleQueue
from typing import NamedTuple

import numpy as np

from alignment import ESTIMATORS
from alignment.arrays import Array
from stand.errors import StandError
from stand.imu import Imu
from stand.motion.limits import Torque, check
from stand.motion.plan import Plan, PlannedStep
from stand.motion.polynomial import Motion, MotionKind
from stand.physics.dynamics import Payload, torque_of
from stand.physics.following import Followed, StepSpan
from stand.physics.geometry import with_errors
from stand.physics.mjcf import describe, load_model
from stand.physics.servo import Servo
from stand.physics.truth import Truth, sample_count
from stand.samples import ImuBlock, Sensed, TruthBlock
from stand.simulation.plans import LEAST_SAMPLES, plan_of
from stand.simulation.settings import (
    Settings,
    methods_of,
    payload_of,
    table_errors_of,
    temperature_of,
)
from stand.simulation.step_record import StepRecord
from stand.table.joints import StandModel
from stand.table.table import Table
from stand.table.table_errors import TableErrors

BLOCK = 16000  # samples, or a second of them if that is more
BLOCK_S = 80.0  # at most, unless it is a sample: what moves is looked at often in a minute
SERVO_BLOCK_S = 20.0  # of a simulated servo, which takes less than a second to step through


class Block(NamedTuple):
    """Some samples: what was true, what the unit felt and reports, and the motion behind them."""

    truth: TruthBlock
    readings: ImuBlock
    motion: Motion
    sensed: Sensed


class _Sensing(NamedTuple):
    truth: TruthBlock
    sensed: Sensed
    motion: Motion


class Simulation:
    """A run made ready: planned, checked against the table, its table and unit drawn.

    Raises
    ------
    StandError
        The plan is impossible on this table, or too short for the sample rate.
    AlignmentError
        A method needs the latitude, at a pole.
    """

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        procedure, table = settings.procedure, settings.table
        model = load_model(table.model)
        self.stand: StandModel = describe(model)
        self.plan: Plan = plan_of(settings, self.stand)
        load = payload_of(procedure)
        self._torque = _torque(model, table, load)
        check(procedure, self.plan, table, self._torque)
        if any(ESTIMATORS[m].needs_latitude for m in methods_of(settings)):
            settings.site.horizontal_rate()  # refuses poles before the work, not after
        _check_samples(settings, self.plan)
        self.errors: TableErrors = table_errors_of(settings)
        self.imu = Imu(
            settings.unit,
            settings.seed,
            settings.rate_hz,
            temperature_of(procedure),
            settings.sampling,
        )
        servo = settings.motion is MotionKind.SERVO
        two = not servo and self._worth_two()
        built = with_errors(model, self.errors)
        self.built: StandModel = describe(built)
        self._truth = Truth(
            built,
            settings.site,
            self.imu.spec.places,
            self.errors,
            threads=1 if two else _threads(),
            both=self.imu.spec.filtered,
        )
        self._by_two = two
        self._drive: Motion | Servo = self.plan.motion
        if servo:
            spans = [StepSpan(s.t_from, s.t_to, s.kind == "dwell") for s in self.plan.steps]
            self._drive = Servo(model, table, self.plan.motion, load, spans=spans)

    def replanned(self, seed: int) -> Plan:
        """The plan with the random motions of another seed, checked against the table as its own.

        Raises
        ------
        StandError
            This seed's motion is beyond the table.
        """
        procedure, table = self.settings.procedure, self.settings.table
        planned = plan_of(self.settings, self.stand, seed)
        check(procedure, planned, table, self._torque)
        return planned

    @property
    def total(self) -> int:
        """Number of samples."""
        return sample_count(self.plan.motion.duration, self.settings.rate_hz)

    @property
    def encoders_of(self) -> StandModel | None:
        """The stand as told, where joints are where their encoders say and not where planned."""
        return None if isinstance(self._drive, Motion) else self.stand

    def blocks(self) -> Iterator[Block]:
        """The samples in order of time, once; the truth is worked out a block ahead, or two."""
        size = self._block(BLOCK_S if isinstance(self._drive, Motion) else SERVO_BLOCK_S)
        free: SimpleQueue[Truth] = SimpleQueue()
        free.put(self._truth)
        if self._by_two:
            free.put(self._truth.beside(self.plan.motion))
        workers = free.qsize()

        def sensing(first: int) -> _Sensing:
            truth = free.get()
            try:
                return self._sensing(truth, first, size)
            finally:
                free.put(truth)

        with ThreadPoolExecutor(workers, thread_name_prefix="truth") as ahead:
            starts = iter(range(0, self.total, size))
            coming = deque(ahead.submit(sensing, first) for first in islice(starts, workers))
            while coming:
                sensed = coming.popleft().result()
                coming.extend(ahead.submit(sensing, first) for first in islice(starts, 1))
                readings = self.imu.report(sensed.sensed)
                yield Block(sensed.truth, readings, sensed.motion, sensed.sensed)

    def _block(self, longest_s: float) -> int:
        """Samples of a block that may take so long [s]."""
        rate_hz = self.settings.rate_hz
        return min(max(BLOCK, rate_hz), round(longest_s * rate_hz))

    def _worth_two(self) -> bool:
        """Whether two threads share the truth of ideal motion: where it moves for more than two
        blocks, none of which waits for the one before as those of a clock that trembles do."""
        if _threads() < 2 or not self.imu.spec.clock.perfect:
            return False
        motion = self.plan.motion
        moving_s = np.diff(motion.knots)[~motion.at_rest].sum()
        return bool(moving_s * self.settings.rate_hz > 2 * self._block(BLOCK_S))

    def _sensing(self, evaluator: Truth, first: int, size: int) -> "_Sensing":
        """Truth, and what the sensors feel, of up to `size` samples after the `first`."""
        settings = self.settings
        last = min(first + size, self.total)
        motion = self._drive.covering(first / settings.rate_hz, last / settings.rate_hz)
        truth, sensed = evaluator.block_and_sensed(
            motion, settings.rate_hz, settings.sampling, first, last
        )
        if not self.imu.spec.clock.perfect:
            sensed = self._at_own_times(truth, first)
        return _Sensing(truth, sensed, motion)

    def _at_own_times(self, truth: TruthBlock, first: int) -> Sensed:
        """What the sensors feel over the intervals of a clock that is wrong."""
        edges = self.imu.clock.edges(first, first + len(truth))
        motion = self._drive.covering(float(edges[0]), float(edges[-1]))
        settings = self.settings
        return self._truth.sensed(motion, edges, truth.t_ns, settings.sampling, settings.rate_hz)

    def following(self, block: Block) -> Array | None:
        """Demanded minus realised joint angles (n, 6) [rad]; None of ideal motion."""
        if self.settings.motion is MotionKind.IDEAL:
            return None
        t = block.truth.t_ns * 1e-9
        return self.plan.motion.joints(t)[0] - block.motion.joints(t)[0]

    def records(self) -> tuple[StepRecord, ...]:
        """What the servo did in each step, after the last block; nothing of ideal motion."""
        if isinstance(self._drive, Motion):
            return ()
        limits = self.settings.table.torque
        return tuple(
            _step_record(step, done, limits)
            for step, done in zip(self.plan.steps, self._drive.followed(), strict=True)
        )

    def records_until(self, t: float, first: int = 0) -> tuple[StepRecord, ...]:
        """The same of the steps from number `first` on that end by `t` [s], a time that the
        blocks have reached.
        """
        if isinstance(self._drive, Motion):
            return ()
        last, steps = first, self.plan.steps
        while last < len(steps) and steps[last].t_to <= t:
            last += 1
        followed = self._drive.followed_so_far(first, last)
        return tuple(
            _step_record(step, done, self.settings.table.torque)
            for step, done in zip(steps[first:last], followed, strict=True)
        )


def begins_of(records: tuple[StepRecord, ...]) -> dict[str, float | None]:
    """From when each dwell of a servo run counts [s], where it had to settle; None: never."""
    return {
        r.label: None if r.settled is None else r.t_from + r.settled
        for r in records
        if r.rests and r.settled != 0.0
    }


def _threads() -> int:
    """Of the truth, which change nothing but the time: two, where nobody asked for fewer.

    A process that others work beside has been told so (`stand.simulation.parallel`).
    """
    told = os.environ.get("OMP_NUM_THREADS", "")
    return max(1, min(2, os.cpu_count() or 1, int(told) if told.isdigit() else 2))


def _torque(model: object, table: Table, payload: Payload) -> Torque | None:
    """What torque a motion needs, where the table's motors are known."""
    if None in table.motors:
        return None
    return torque_of(model, table, payload)


def _check_samples(settings: Settings, planned: Plan) -> None:
    """Every stretch and its offset window hold two whole samples at least."""
    least = LEAST_SAMPLES / settings.rate_hz
    window = settings.options.offset_window
    if window < least and any(ESTIMATORS[m].needs_offset for m in methods_of(settings)):
        raise StandError(
            f"{settings.procedure.name}: estimate, offset_window_s = {window:g}: must be "
            f"{least:g} or more at {settings.rate_hz} Hz"
        )
    for step in planned.stretches:
        duration = step.steady_to - step.steady_from
        if duration < least:
            allowed = f"must be {least:g} or more at {settings.rate_hz} Hz"
            raise settings.procedure.fault(step.number, "duration_s", duration, allowed)


def _step_record(step: PlannedStep, done: Followed, limits: Array) -> StepRecord:
    waits = [t for t, rests in zip(done.settling_s, done.rests, strict=True) if rests]
    never = any(t is None for t in waits)
    return StepRecord(
        label=step.label,
        kind=step.kind,
        t_from=step.t_from,
        t_to=step.t_to,
        following_max=done.greatest_error,
        following_rms=done.rms_error,
        saturated=done.saturated_s,
        torque_ratio=done.peak_torque / limits,
        rests=bool(waits),
        settled=None if never else max((t for t in waits if t is not None), default=None),
    )
