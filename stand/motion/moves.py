"""Jerk-limited moves, ramps and rests as exact polynomial pieces."""

from dataclasses import dataclass
from math import sqrt

import numpy as np
import ruckig

from alignment.arrays import Array
from stand.motion.polynomial import Motion
from stand.table.joints import JOINTS


@dataclass(frozen=True, slots=True, eq=False)
class Piece:
    """Motion over some time: knots (k + 1,) from 0 and coefficients (d + 1, k, 6)."""

    knots: Array
    coefficients: Array


def shifted(motion: Motion, t: float) -> Motion:
    return Motion(motion.knots + t, motion.coefficients)


def ramp_times(rate: float, acceleration: float, jerk: float) -> Array:
    """Switching times (4,) [s] of the shortest ramp of limited jerk from rest to `rate`."""
    rise = min(acceleration / jerk, sqrt(rate / jerk))
    level = max(rate / (jerk * rise) - rise, 0.0)
    return np.array([0.0, rise, rise + level, 2 * rise + level])


def turning_piece(
    joints: Array, axis: int, rate: float, ramp: Array, time: float
) -> tuple[Piece, Array]:
    """A ramp up to `rate`, `time` seconds of it, the same ramp down; and the joints after it."""
    up = np.diff(ramp)
    jerk = rate / (up[0] * (up[0] + up[1]))
    lengths = np.concatenate([up, [time], up])
    jerks = np.array([jerk, 0, -jerk, 0, -jerk, 0, jerk])
    coefficients = np.zeros((4, len(lengths), len(joints)))
    coefficients[3] = joints
    p, v, a = joints[axis], 0.0, 0.0
    for k, (h, j) in enumerate(zip(lengths, jerks, strict=True)):
        if k == len(up):
            v, a = rate, 0.0  # exactly the rate that was asked for
        coefficients[:, k, axis] = (j / 6, a / 2, v, p)
        p, v, a = p + v * h + a * h**2 / 2 + j * h**3 / 6, v + a * h + j * h**2 / 2, a + j * h
    after = joints.copy()
    after[axis] = p
    return Piece(np.concatenate([[0.0], np.cumsum(lengths)]), coefficients), after


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

    Raises
    ------
    ArithmeticError
        There is no such profile.
    """
    if np.array_equal(start, target):
        return rest_piece(np.asarray(target), 0.0)
    problem = ruckig.InputParameter(len(start))
    problem.current_position, problem.target_position = list(start), list(target)
    problem.max_velocity = list(rate)
    problem.max_acceleration = list(acceleration)
    problem.max_jerk = list(jerk)
    trajectory = ruckig.Trajectory(len(start))
    try:
        result = ruckig.Ruckig(len(start)).calculate(problem, trajectory)
    except (ruckig.RuckigError, ValueError) as error:
        raise ArithmeticError(f"no profile from {start} to {target}: {error}") from error
    if result not in (ruckig.Result.Working, ruckig.Result.Finished):
        raise ArithmeticError(f"no profile from {start} to {target}: {result}")
    profiles = trajectory.profiles[0]
    switches = [np.concatenate([[0.0], np.cumsum(p.t)]) for p in profiles]
    knots = _distinct(np.concatenate([*switches, [trajectory.duration]]))
    coefficients = np.zeros((4, len(knots) - 1, len(start)))
    for axis, (phases, times) in enumerate(zip(profiles, switches, strict=True)):
        if start[axis] == target[axis]:
            coefficients[3, :, axis] = target[axis]
        else:
            coefficients[:, :, axis] = _cubics(phases, times, knots[:-1])
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
    degree = max(len(piece.coefficients) for piece in pieces)
    for piece in pieces:
        padding = np.zeros((degree - len(piece.coefficients), len(JOINTS)))
        for k in range(len(piece.knots) - 1):
            length = piece.knots[k + 1] - piece.knots[k]
            if length <= 1e-9:
                continue
            c = np.concatenate([padding, piece.coefficients[:, k]])
            if coefficients and not c[:-1].any() and np.array_equal(c, coefficients[-1]):
                knots[-1] += length
            else:
                coefficients.append(c)
                knots.append(knots[-1] + length)
    return Motion(np.array(knots), np.stack(coefficients, axis=1))
