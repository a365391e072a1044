"""The simulated servos: what the axes really do when a motion is demanded of them.

Every step the servo of each axis compares demand and axis and asks its motor for::

    kp (angle error) + kd (rate error) + ki (its integral) + inertia * acceleration + viscous * rate

and, on the two tilting axes of the base, the weight of the stand above them. The coupling of the
axes, friction, cogging and an unbalanced payload are left to the loop. Demanded rate and
acceleration are differences of the demanded angles, as a digital servo takes them: an axis that
nothing disturbs then follows to rounding.

The realised angles at the steps become a quintic spline, so the truth is evaluated on a smooth
motion. Blocks have fixed places in time, so nothing depends on the spans that are asked for.
"""

# mujoco fills its namespace from C, unseen by pyright.
# pyright: reportAttributeAccessIssue=false

from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from math import ceil, floor
from typing import NamedTuple

import mujoco
import numpy as np
from mujoco.batch import Batch

from alignment.arrays import Array, IntArray
from alignment.units import DEG
from stand.errors import StandError
from stand.motion.polynomial import Motion, SplinePieces, smoothed
from stand.physics.dynamics import (
    INPUTS,
    NO_PAYLOAD,
    Payload,
    gains_of,
    inertias,
    motors_of,
    tilting_moments,
    weights_model,
)
from stand.physics.following import Account, Followed, ServoSteps, StepSpan
from stand.physics.stiffness import check_stiffness
from stand.table.table import Table

STEP = 1e-3  # s
BLOCK = 4000  # steps simulated at once
OVERLAP = 48  # knots: the spline forgets at 0.43 per knot, so one 48 away counts 3e-18
KEPT_S = 15.0  # s of realised motion kept before the last span asked for
SMOOTH = 3e-7  # rad/s^2: what the spline's accelerations round by; 3 ng on an arm of 0.1 m
RUNAWAY = 30 * DEG  # following error of a servo that has lost its axis
BALANCING = 50  # rounds that find where a servo without integrator balances a load


class MotorDrive:
    """The stand's model with its motors, and what their servos are told.

    Parameters
    ----------
    model : MjModel
        The whole stand.
    table : Table
        Its motors; `StandError` where one is missing or too stiff for `step`.
    payload : Payload
        The servos are tuned to its inertia, but know nothing of its imbalance.
    step : float
        Of the simulation [s].
    """

    def __init__(
        self, model: mujoco.MjModel, table: Table, payload: Payload = NO_PAYLOAD, step: float = STEP
    ) -> None:
        motors = motors_of(table)
        self.model = weights_model(model, payload, motors, step)
        self.inertia = inertias(self.model)
        gains = [gains_of(m, i) for m, i in zip(motors, self.inertia, strict=True)]
        check_stiffness(self.model, table, step)
        self.kp, self.kd, self.ki, self.limit = (
            np.array([getattr(g, name) for g in gains]) for name in ("kp", "kd", "ki", "limit")
        )
        self._viscous = np.array([m.viscous for m in motors])
        self._cogging = np.array([m.cogging for m in motors])
        self._poles = np.array([m.cogging_per_turn for m in motors])
        self._gravity = float(-model.opt.gravity[2])
        self._rolling, self._tilting = tilting_moments(weights_model(model))
        self._integrators = np.array(
            [a for a, ki in zip(self.model.actuator_actadr, self.ki, strict=True) if ki], dtype=int
        )

    def controls(self, demand: Array) -> Array:
        """Inputs of the motors (n, 18) for demanded angles (n + 2, 6) [rad] at even steps.

        The first and last row of `demand` lie a step before and after those told.
        """
        step = self.model.opt.timestep
        rates = np.diff(demand, axis=0) / step
        inputs = np.empty((len(demand) - 2, demand.shape[1], INPUTS))
        inputs[:, :, 0], inputs[:, :, 1] = demand[1:-1], rates[:-1]
        feedforward = inputs[:, :, 2]
        np.multiply(np.diff(rates, axis=0), self.inertia / step, out=feedforward)
        feedforward += self._viscous * rates[:-1]
        feedforward[:, :2] += self.weight(demand[1:-1])
        return inputs.reshape(len(inputs), -1)

    def weight(self, angles: Array) -> Array:
        """Torque (n, 2) [N m] that holds the stand on the base's roll and pitch axes.

        Potential energy ``g cos(roll) (m_r + m_p cos(pitch))``, with the moments [kg m] of what
        rolls and of what also pitches; masses beside the yaw axis are neglected.
        """
        roll, pitch = angles[:, 0], angles[:, 1]
        turned = self._rolling + self._tilting * np.cos(pitch)
        return -self._gravity * np.column_stack(
            [np.sin(roll) * turned, np.cos(roll) * np.sin(pitch) * self._tilting]
        )

    def settle(self, batch: Batch, demand: Array) -> None:
        """Put the batch at rest under a demand (6,) [rad], the servos holding what loads them."""
        batch.qvel[:], batch.act[:] = 0.0, 0.0
        integrates = self.ki > 0
        angles = demand
        for _ in range(BALANCING):  # only a servo without integrator gives way
            load = self._load(batch, angles, demand)
            angles = demand - np.where(integrates, 0.0, load / self.kp)
        load = self._load(batch, angles, demand)
        batch.act[0, self._integrators] = load[integrates] / self.ki[integrates]

    def _load(self, batch: Batch, angles: Array, demand: Array) -> Array:
        """Torque (6,) [N m] beyond the feedforward that holds the axes at rest at `angles`."""
        batch.qpos[0] = angles
        bias = batch.bind("qfrc_bias")
        batch.forward(stage=mujoco.mjtStage.mjSTAGE_VEL)
        load = bias[0] - self._cogging * np.sin(self._poles * angles)
        load[:2] -= self.weight(demand[None])[0]
        return load

    def torques(self, inputs: Array, angles: Array, rates: Array, act: Array) -> Array:
        """Torque (n, 6) [N m] of the motors, friction and cogging aside, from their inputs."""
        wanted = inputs.reshape(len(inputs), -1, INPUTS)
        torque = self.kp * (wanted[:, :, 0] - angles)
        torque += self.kd * (wanted[:, :, 1] - rates)
        torque += wanted[:, :, 2]
        torque[:, self.ki > 0] += self.ki[self.ki > 0] * act[:, self._integrators]
        return np.clip(torque, -self.limit, self.limit, out=torque)


class _Pieces(NamedTuple):
    """Pieces of a block: coefficients (6, m, 6), and the steps (m,) with which they begin."""

    coefficients: Array
    begins: IntArray


class _Controls(NamedTuple):
    """Demanded angles (BLOCK + 2, 6), a step before and after included; inputs of the motors."""

    demand: Array
    inputs: Array


class _Stepped(NamedTuple):
    """Angles, rates and activations (BLOCK, ...) before each step; angles `after` each.

    MuJoCo's `warnings` (kinds, 2) so far, and the time `until` which it came [s].
    """

    controls: _Controls
    angles: Array
    rates: Array
    act: Array
    after: Array
    warnings: IntArray
    until: float


class Servo:
    """The axes under their servos, simulated as far as asked for, one block ahead in a thread.

    Parameters
    ----------
    model, table, payload, step
        As `MotorDrive`.
    demand : Motion
        What the axes are to do; held before its start and after its end.
    spans : sequence of Span
        To be accounted for by `followed`: in order of time, not overlapping.

    Raises
    ------
    StandError
        As `MotorDrive`; and from `covering` and `followed`, with time and axis, when the simulation
        diverges or an axis runs away from its demand.

    Notes
    -----
    It starts settled: at rest where the demand starts, bristles relaxed, and the integrators at
    what balances payload and cogging there (without an integrator: the axis so far off that the
    servo does). The spline's error is of sixth order in the step; that of the simulation of
    first.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        table: Table,
        demand: Motion,
        payload: Payload = NO_PAYLOAD,
        step: float = STEP,
        spans: Sequence[StepSpan] = (),
    ) -> None:
        self.drive, self.step = MotorDrive(model, table, payload, step), step
        self._table, self._demand, self._start = table, demand, demand.start
        self._names = [self.drive.model.joint(i).name for i in range(self.drive.model.njnt)]
        self._batch = Batch(self.drive.model, 1, nthread=1)
        self.drive.settle(self._batch, demand.joints([demand.start])[0][0])
        self._tail = np.repeat(self._batch.qpos, 2 * OVERLAP + 1, axis=0)
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="servo")
        self._ahead: Future[_Stepped] | None = None
        self._first = 0  # step with which the next block to take begins
        self._pieces: deque[_Pieces] = deque()  # of the blocks taken last
        self._spans = spans
        self._account = Account(table, self._start, step, spans, len(self._names))

    def covering(self, t_from: float, t_to: float) -> Motion:
        """The realised motion over [t_from, t_to] s or more; its knots are at steps.

        Raises
        ------
        ValueError
            `t_from` is more than 15 s before the last span asked for.
        """
        low = floor((t_from - self._start) / self.step)
        high = ceil((t_to - self._start) / self.step)
        while self._first - OVERLAP < high:
            self._take()
        earliest = self._first - OVERLAP - BLOCK * len(self._pieces)
        if low < earliest and earliest > 0:
            raise ValueError(f"t_from = {t_from:g}: kept from {self._time(earliest):g} s on only")
        while earliest + BLOCK < low - KEPT_S / self.step:
            self._pieces.popleft()
            earliest += BLOCK
        # a step more at either end: rounding of a time must not fall beside
        return self._motion(max(low - 1, earliest), min(high + 1, self._first - OVERLAP))

    def _motion(self, low: int, high: int) -> Motion:
        """The kept pieces from step `low` to step `high`, or somewhat beyond."""
        begins = np.concatenate([pieces.begins for pieces in self._pieces])
        cut = slice(
            int(np.searchsorted(begins, low, side="right")) - 1, int(np.searchsorted(begins, high))
        )
        before, within = 0, []  # of each block what lies inside: so nothing is copied twice
        for pieces in self._pieces:
            within.append(
                pieces.coefficients[:, max(0, cut.start - before) : max(0, cut.stop - before)]
            )
            before += len(pieces.begins)
        coefficients = np.concatenate(within, axis=1)
        ends = np.append(begins, self._first - OVERLAP)[cut.start : cut.stop + 1]
        knots = self._start + self.step * ends
        knots.flags.writeable = coefficients.flags.writeable = False
        return Motion(knots, coefficients, whole=False)

    def followed(self) -> list[Followed]:
        """How the axes followed through each span, simulated to the end of the last."""
        while self._spans and self._time(self._first) < self._spans[-1].t_to:
            self._take()
        return self._account.followed()

    def followed_so_far(self, first: int, last: int) -> list[Followed]:
        """The same of spans `first` to `last` - 1, those that `covering` has passed."""
        return self._account.followed(first, last)

    def _time(self, number: int) -> float:
        return self._start + self.step * number

    def _take(self) -> None:
        """The next block; the one after it is simulated meanwhile, unless the demand is over."""
        if self._ahead is None:
            self._ahead = self._thread.submit(self._stepped, self._controls(self._first))
        following = self._first + BLOCK
        more = self._time(following) < self._demand.duration
        coming = self._controls(following) if more else None
        done = self._ahead
        stepped = done.result()
        self._ahead = None if coming is None else self._thread.submit(self._stepped, coming)
        error = stepped.controls.demand[1:-1] - stepped.angles
        try:
            self._check(self._first, stepped, error)
        except StandError:
            self._ahead = done  # a run that failed fails again
            raise
        if self._spans:
            self._account.add(self._first, self._rows(stepped, error))
        samples = np.concatenate([self._tail, stepped.after])
        self._tail = samples[BLOCK:]
        self._pieces.append(self._splined(samples))
        self._first = following

    def _controls(self, first: int) -> _Controls:
        """What the servos are told over `BLOCK` steps from step `first` on."""
        t = self._start + self.step * np.arange(first - 1, first + BLOCK + 1)
        demand = self._demand.covering(float(t[0]), float(t[-1])).angles(t)
        return _Controls(demand, self.drive.controls(demand))

    def _stepped(self, controls: _Controls) -> _Stepped:
        """The steps of a block; the batch is where the last one ended."""
        before = [self._batch.bind(name).copy() for name in ("qpos", "qvel", "act")]
        with _quiet():
            out = self._batch.rollout(BLOCK, controls.inputs[None], record=("qpos", "qvel", "act"))
        angles, rates, act = (
            np.concatenate([b, out[name][0, :-1]])
            for b, name in zip(before, ("qpos", "qvel", "act"), strict=True)
        )
        return _Stepped(
            controls,
            angles,
            rates,
            act,
            after=out["qpos"][0],
            warnings=self._batch.warning[0].copy(),
            until=float(self._batch.time[0]),
        )

    def _rows(self, stepped: _Stepped, error: Array) -> ServoSteps:
        inputs, limit = stepped.controls.inputs, self.drive.limit
        torque = self.drive.torques(inputs, stepped.angles, stepped.rates, stepped.act)
        return ServoSteps(stepped.controls.demand[1:-1], error, torque, limit)

    def _splined(self, samples: Array) -> _Pieces:
        """A block's pieces; the samples reach `OVERLAP` knots farther on either side."""
        spline = SplinePieces(samples, self.step, OVERLAP)
        joined, begins = smoothed(spline, self.step, SMOOTH)
        return _Pieces(joined, begins + self._first - OVERLAP)

    def _check(self, first: int, stepped: _Stepped, error: Array) -> None:
        """Raise what went wrong first in a block: an axis lost, or MuJoCo at a loss."""
        number, count = stepped.warnings.T
        stopped = self._start + stepped.until
        lost = np.logical_not(np.abs(error) <= RUNAWAY)  # not a number is lost as well
        row, axis = np.argwhere(lost)[0] if lost.any() else (len(error), 0)
        if count.any() and self._time(first + int(row)) > stopped - 2 * self.step:
            kind = int(np.argmax(count > 0))
            raise StandError(
                f"table {self._table.id}: the servo simulation diverged at {stopped:.3f} s, axis "
                f"{self._names[number[kind]]}: {mujoco.mju_warningText(kind, int(number[kind]))}"
            )
        if lost.any():
            raise StandError(
                f"table {self._table.id}: axis {self._names[axis]} ran away from its demand at "
                f"{self._time(first + int(row)):.3f} s: by more than {RUNAWAY / DEG:.0f} deg"
            )


@contextmanager
def _quiet() -> Iterator[None]:
    """MuJoCo would write its warnings to a file in the working folder; they are raised here."""
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(lambda _: None)
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(before)
