"""From a procedure to a motion: when each step runs and how the joints get there."""

from dataclasses import dataclass
from math import ceil

import numpy as np
import ruckig
from scipy.spatial.transform import Rotation

from alignment.angles import C_nb_from_angles
from alignment.arrays import Array, set_owned
from alignment.units import DEG
from stand.motion import Motion
from stand.physics.description import JOINTS, StandModel
from stand.physics.kinematics import attitude, gimbal_angles
from stand.procedure import Dwell, LimitsEntry, Move, Procedure
from stand.table import Table

BASE = 3  # the first three joints are the rocking base's
LONGEST_MOVE = 7000.0  # s; the planner's own profiles end at 7600 s
_TURN = 2 * np.pi


@dataclass(frozen=True, slots=True, eq=False)
class PlannedStep:
    """A step with its times [s], the joint angles (6,) [rad] at its end and ``C_nb`` there."""

    kind: str
    label: str
    t_from: float
    t_to: float
    joints: Array
    C_nb: Rotation

    def __post_init__(self) -> None:
        set_owned(self, joints=(self.joints, (len(JOINTS),), float))


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """The steps with their times, and the motion through them."""

    steps: tuple[PlannedStep, ...]
    motion: Motion

    @property
    def dwells(self) -> list[PlannedStep]:
        """The steps that stand still."""
        return [step for step in self.steps if step.kind == "dwell"]


@dataclass(frozen=True, slots=True, eq=False)
class Piece:
    """Motion over some time: knots (k + 1,) from 0 and coefficients (4, k, 6)."""

    knots: Array
    coefficients: Array


def plan(procedure: Procedure, model: StandModel, table: Table) -> Plan:
    """Plan every step, from all joints at zero.

    A move is as fast as its limits allow; the rest that follows it lasts to the next whole
    second, so that dwells begin at times a person can read.

    Raises
    ------
    StandError
        A target outside the table's travel, or a move limit above the table's.
    """
    joints = np.zeros(len(JOINTS))
    steps, pieces, t = [], [], 0.0
    for index, step in enumerate(procedure.entry.step):
        if isinstance(step, Dwell):
            duration, target = step.duration_s, joints
        else:
            target = _target(procedure, index, step, joints, model, table)
            limits = _limits(procedure, index, step, joints != target, table)
            _check_duration(procedure, index, joints, target, limits[0])
            try:
                move = move_piece(joints, target, *limits)
            except (ArithmeticError, ruckig.RuckigError, ValueError) as error:
                allowed = f"no profile within these limits ({' '.join(str(error).split())[:80]})"
                raise procedure.fault(index, "limits", "too extreme", allowed) from error
            pieces.append(move)
            duration = _whole_second(t + move.knots[-1]) - t
            duration, rest = max(duration, move.knots[-1]), duration - move.knots[-1]
            pieces.append(rest_piece(target, rest))
        if isinstance(step, Dwell):
            pieces.append(rest_piece(target, duration))
        C_nb = attitude(model, target)
        steps.append(PlannedStep(step.kind, step.label, t, t + duration, target, C_nb))
        joints, t = target, t + duration
    return Plan(tuple(steps), joined(pieces))


def _whole_second(t: float) -> float:
    return float(ceil(t - 1e-9))


def _target(
    procedure: Procedure, index: int, step: Move, joints: Array, model: StandModel, table: Table
) -> Array:
    if step.joints_deg is not None:
        target = np.array(joints)
        for name, angle in step.joints_deg.items():
            target[JOINTS.index(name)] = angle * DEG
        outside = table.outside(target)
        if outside:
            i = outside[0]
            raise procedure.fault(
                index, f"joints_deg, {JOINTS[i]}", step.joints_deg.get(JOINTS[i]), _travel(table, i)
            )
        return target
    assert step.attitude_deg is not None
    wanted = step.attitude_deg
    angles = np.array([wanted.roll, wanted.yaw, wanted.pitch]) * DEG
    C_nb = C_nb_from_angles(wanted.sequence, *angles)
    candidates = [
        np.concatenate([joints[:BASE], _nearest_turn(gimbals, joints[BASE:], table)])
        for gimbals in gimbal_angles(model, joints[:BASE], C_nb)
    ]
    reachable = [c for c in candidates if not table.outside(c)]
    if not reachable:
        i = table.outside(candidates[0])[0]
        value = f"{np.degrees(candidates[0][i]):.3f} deg on axis {JOINTS[i]}"
        raise procedure.fault(index, "attitude_deg", value, _travel(table, i))
    return min(reachable, key=lambda c: float(np.abs(c - joints).max()))


def _nearest_turn(gimbals: Array, present: Array, table: Table) -> Array:
    """The equivalents of `gimbals` (3,) nearest to `present`, inside travel where there are any."""
    low, high = np.array(table.low[BASE:]), np.array(table.high[BASE:])
    nearest = gimbals + _TURN * np.round((present - gimbals) / _TURN)
    nearest = np.where(nearest > high + 1e-9, nearest - _TURN, nearest)
    return np.where(nearest < low - 1e-9, nearest + _TURN, nearest)


def _travel(table: Table, i: int) -> str:
    low, high = table.low[i] / DEG, table.high[i] / DEG
    return f"table {table.id} allows {low:g} to {high:g} deg on {JOINTS[i]}"


def _limits(
    procedure: Procedure, index: int, step: Move, moving: np.ndarray, table: Table
) -> tuple[Array, Array, Array]:
    """Rate, acceleration and jerk limits (6,) of a move: its own, the procedure's, the table's."""
    general = procedure.entry.move_limits

    def limit(key: str, own: Array) -> Array:
        for source, entry in ((step, step), (general, general)):
            value = getattr(entry, key)
            if value is None:
                continue
            too_much = np.flatnonzero(moving & (value * DEG > own * (1 + 1e-12)))
            if len(too_much) and isinstance(source, Move):
                i = int(too_much[0])
                allowed = f"table {table.id} allows up to {own[i] / DEG:g} on {JOINTS[i]}"
                raise procedure.fault(index, key, value, allowed)
            return np.minimum(own, value * DEG)
        return own

    keys = tuple(LimitsEntry.model_fields)
    limits = (table.rate, table.acceleration, table.jerk)
    rate, acceleration, jerk = (limit(k, v) for k, v in zip(keys, limits, strict=True))
    return rate, acceleration, jerk


def _check_duration(
    procedure: Procedure, index: int, joints: Array, target: Array, rate: Array
) -> None:
    needed = np.abs(target - joints) / rate
    if needed.max() > LONGEST_MOVE:
        i = int(np.argmax(needed))
        value = f"{rate[i] / DEG:g} on {JOINTS[i]}"
        allowed = f"the move would take {needed[i]:.0f} s, allowed {LONGEST_MOVE:.0f}"
        raise procedure.fault(index, "rate_deg_s", value, allowed)


def rest_piece(joints: Array, duration: float) -> Piece:
    """Standing still; nothing at all when `duration` is zero or rounding."""
    coefficients = np.zeros((4, 1, len(joints)))
    coefficients[3, 0] = joints
    return Piece(np.array([0.0, duration]), coefficients)


def move_piece(start: Array, target: Array, rate: Array, acceleration: Array, jerk: Array) -> Piece:
    """Jerk-limited move from rest to rest, all axes arriving together.

    Parameters
    ----------
    start, target : (6,) rad
    rate, acceleration, jerk : (6,)
        Limits [rad/s, rad/s^2, rad/s^3].

    Notes
    -----
    Ruckig gives time-optimal profiles of seven constant-jerk phases per axis; they are rebuilt
    here as exact cubics on the union of the axes' jerk switches.
    """
    if np.array_equal(start, target):
        return rest_piece(np.asarray(target), 0.0)
    problem = ruckig.InputParameter(len(start))
    problem.current_position, problem.target_position = list(start), list(target)
    problem.max_velocity = list(rate)
    problem.max_acceleration = list(acceleration)
    problem.max_jerk = list(jerk)
    trajectory = ruckig.Trajectory(len(start))
    result = ruckig.Ruckig(len(start)).calculate(problem, trajectory)
    if result not in (ruckig.Result.Working, ruckig.Result.Finished):
        raise ArithmeticError(f"no profile from {start} to {target}: {result}")
    profiles = trajectory.profiles[0]
    switches = [np.concatenate([[0.0], np.cumsum(p.t)]) for p in profiles]
    knots = _distinct(np.concatenate([*switches, [trajectory.duration]]))
    coefficients = np.zeros((4, len(knots) - 1, len(start)))
    for axis, (profile, times) in enumerate(zip(profiles, switches, strict=True)):
        if start[axis] == target[axis]:
            coefficients[3, :, axis] = target[axis]
        else:
            coefficients[:, :, axis] = _cubics(profile, times, knots[:-1])
    return Piece(knots, coefficients)


def _distinct(times: Array) -> Array:
    """Sorted times without those within 1 ns of the one before."""
    times = np.unique(times)
    keep = np.concatenate([[True], np.diff(times) > 1e-9])
    return times[keep]


def _cubics(profile: ruckig.Profile, switches: Array, starts: Array) -> Array:
    """Coefficients (4, k) of one axis on pieces that begin at `starts` (k,)."""
    phase = np.clip(np.searchsorted(switches, starts + 1e-9, side="right") - 1, 0, 7)
    tau = starts - switches[phase]
    jerk = np.append(profile.j, 0.0)[phase]
    p, v, a = (np.asarray(x)[phase] for x in (profile.p, profile.v, profile.a))
    after = phase == 7
    v, a = np.where(after, 0.0, v), np.where(after, 0.0, a)
    return np.stack(
        [
            jerk / 6,
            (a + jerk * tau) / 2,
            v + a * tau + jerk * tau**2 / 2,
            p + v * tau + a * tau**2 / 2 + jerk * tau**3 / 6,
        ]
    )


def joined(pieces: list[Piece]) -> Motion:
    """One motion from successive pieces; rests that touch become one."""
    knots, coefficients = [0.0], []
    for piece in pieces:
        for k in range(len(piece.knots) - 1):
            length = piece.knots[k + 1] - piece.knots[k]
            if length <= 1e-9:
                continue
            c = piece.coefficients[:, k]
            if coefficients and not c[:-1].any() and np.array_equal(c, coefficients[-1]):
                knots[-1] += length
            else:
                coefficients.append(c)
                knots.append(knots[-1] + length)
    return Motion(np.array(knots), np.stack(coefficients, axis=1))
