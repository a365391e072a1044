"""Where simulated servos leave the axes beside their demand, in what is estimated from.

An integrator takes a resting axis to its demand: what is left of a move a second later is below
0.01 arc s, and nothing is predicted of it. Without one, friction holds the axis off: it comes to
rest the way it turned, short by the angle whose proportional torque balances Coulomb friction. The
sign is known from the plan, so that is a known error of the table. What an axis lags while it turns
is in its encoder's reading, and the motors' cogging goes round too often for a whole turn to show.
Unbalanced payloads are left out.
"""

from collections.abc import Sequence

import numpy as np

from alignment.arrays import Array
from alignment.units import ARC_SECOND
from stand.motion.plan import Plan, PlannedStep
from stand.motion.polynomial import MotionKind
from stand.physics.dynamics import gains_of
from stand.rehearsal.scene import Scene
from stand.table.joints import JOINTS

_STANDS = 1e-9  # rad/s: an axis that turns slower than this does not


def friction_angles(scene: Scene) -> Array:
    """By how much (6,) [rad] friction holds each axis off; 0 with an integrator, or as planned."""
    if scene.settings.motion is not MotionKind.SERVO:
        return np.zeros(len(JOINTS))
    return np.array(
        [
            0.0
            if motor is None or motor.integral is not None
            else motor.coulomb / gains_of(motor, float(inertia)).kp
            for motor, inertia in zip(scene.table.motors, scene.inertias, strict=True)
        ]
    )


def left_off(scene: Scene, step: PlannedStep) -> Array:
    """Angles (6,) [rad] by which the axes stand beyond their demand through a stretch."""
    off = -np.sign(_last_rates(scene.plan, step.steady_from)) * friction_angles(scene)
    if step.turning is not None:
        off[step.turning.axis] = 0.0
    return np.asarray(off)


def _last_rates(plan: Plan, until: float) -> Array:
    """The last rate (6,) [rad/s] of each axis before a time, by the middles of its pieces."""
    knots = plan.motion.knots
    if until <= knots[0]:
        return np.zeros(len(JOINTS))
    knots = np.append(knots[knots < until], until)
    rates = plan.motion.joints((knots[1:] + knots[:-1]) / 2)[1]
    moved = np.abs(rates) > _STANDS
    last = len(rates) - 1 - np.argmax(moved[::-1], axis=0)
    return np.where(moved.any(axis=0), rates[last, np.arange(len(JOINTS))], 0.0)


def never_settling(scene: Scene, steps: Sequence[PlannedStep]) -> list[str]:
    """Axes that friction holds farther off than the class calls settled, in words."""
    angles, within = friction_angles(scene), scene.table.settle_within
    moved = np.any([left_off(scene, step) != 0 for step in steps], axis=0) if steps else []
    return [
        f"{name}: friction holds its servo, without integrator, {angle / ARC_SECOND:.3g} arc s "
        f"off, and within {within / ARC_SECOND:.3g} arc s it counts as settled: its rests are "
        "left out of a run"
        for name, angle, moves in zip(JOINTS, angles, moved, strict=False)
        if moves and angle > within
    ]
