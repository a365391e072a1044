"""Whether servos are stable at the simulation's step: eigenvalues of one step."""

# mujoco fills its namespace from C, unseen by pyright.
# pyright: reportAttributeAccessIssue=false

from collections.abc import Sequence
from dataclasses import replace
from itertools import product
from math import pi

import mujoco
import numpy as np

from alignment.arrays import Array
from stand.errors import StandError
from stand.physics.dynamics import bristle_damping, gains_of, inertias, mass_matrices, motors_of
from stand.table.joints import JOINTS
from stand.table.table import Motor, Table

RESERVE = 1.25  # loops must be stable at steps so much longer than they run at
_TURN = 2 * pi
_STABLE = 1 + 1e-9  # an integrator that is not used keeps its sum: 1, and rounding
_ROUNDS = 20  # of the bisection for what is allowed


def check_stiffness(model: mujoco.MjModel, table: Table, step: float) -> None:
    """Refuse servos too stiff for the step [s].

    Raises
    ------
    StandError
        One line: table, axis, what it is and what is allowed.
    """
    motors = motors_of(table)
    masses, own = _masses(model), inertias(model)
    radius, axis = _radius(masses, own, motors, step)
    if radius <= _STABLE:
        return
    motor, name = motors[axis], JOINTS[axis]
    allowed = _allowed(masses, own, motors, axis, step)
    if allowed > 0:
        raise StandError(
            f"table {table.id}: axis {name}, bandwidth_hz = {motor.bandwidth / _TURN:g}: "
            f"must be {allowed / _TURN:.3g} or less at steps of {step * 1e3:g} ms"
        )
    raise StandError(
        f"table {table.id}: axis {name}, bristle_Nm_rad = {motor.bristle:g}: "
        f"too stiff for steps of {step * 1e3:g} ms"
    )


def _masses(model: mujoco.MjModel) -> Array:
    """Mass matrices with each gimbal along and across the one that carries it."""
    poses = np.zeros((8, model.nv))
    poses[:, -3:] = list(product([0.0, pi / 2], repeat=3))
    return mass_matrices(model, poses)


def _allowed(masses: Array, own: Array, motors: Sequence[Motor], axis: int, step: float) -> float:
    """Greatest bandwidth [rad/s] of an axis at which all is stable; 0 if none is."""
    low, high = 0.0, motors[axis].bandwidth
    for _ in range(_ROUNDS):
        middle = (low + high) / 2
        tried = list(motors)
        tried[axis] = replace(motors[axis], bandwidth=middle)
        if _radius(masses, own, tried, step)[0] <= _STABLE:
            low = middle
        else:
            high = middle
    return low


def _radius(masses: Array, own: Array, motors: Sequence[Motor], step: float) -> tuple[float, int]:
    """Greatest growth per step of any small motion, and the axis that has most of it.

    Axes slipping or sticking: then the bristles are springs in parallel to the servos.
    """
    sticking = np.array(
        [[m.bristle, bristle_damping(m, i)] for m, i in zip(motors, own, strict=True)]
    )
    worst = (0.0, 0)
    for bristles in (np.zeros_like(sticking), sticking):
        values, vectors = np.linalg.eig(_update(masses, own, motors, bristles, step * RESERVE))
        pose, mode = np.unravel_index(np.argmax(np.abs(values)), values.shape)
        energy = own * np.abs(vectors[pose, len(own) : 2 * len(own), mode]) ** 2
        worst = max(worst, (float(np.abs(values[pose, mode])), int(np.argmax(energy))))
    return worst


def _update(
    masses: Array, own: Array, motors: Sequence[Motor], bristles: Array, step: float
) -> Array:
    """What one step makes of small (angles, rates, integrals): matrices (poses, 3 n, 3 n)."""
    gains = [gains_of(m, i) for m, i in zip(motors, own, strict=True)]
    n = len(own)
    stiffness = np.diag([g.kp for g in gains] + bristles[:, 0])
    damping = np.diag(
        [g.kd + m.viscous for g, m in zip(gains, motors, strict=True)] + bristles[:, 1]
    )
    integral = np.diag([g.ki for g in gains])
    one = np.eye(n)
    inverse = np.linalg.inv(masses)
    update = np.zeros((len(masses), 3 * n, 3 * n))
    angle, rate, sums = (slice(i * n, (i + 1) * n) for i in range(3))
    update[:, rate, angle] = -step * inverse @ stiffness
    update[:, rate, rate] = one - step * inverse @ damping
    update[:, rate, sums] = step * inverse @ integral
    update[:, angle] = step * update[:, rate]
    update[:, angle, angle] += one
    update[:, sums, angle] = -step * one
    update[:, sums, sums] = one
    return update
