"""Steps of a plan as an estimator will get them."""

import numpy as np

from alignment.information import Stretch
from stand.motion.plan import PlannedStep


def planned_stretch(step: PlannedStep) -> Stretch:
    """The steady part of a step."""
    length = step.steady_to - step.steady_from
    if step.turning is None:
        return Stretch(step.label, step.steady_from, length, step.C_nb)
    turning = step.turning
    axis = turning.axis_b / np.linalg.norm(turning.axis_b)
    angle = start_angle(step)
    return Stretch(step.label, step.steady_from, length, step.C_nb, turning.rate, axis, angle)


def start_angle(step: PlannedStep) -> float:
    """Encoder angle [rad] of a turning step where its steady part begins."""
    assert step.turning is not None
    rate, stop = step.turning.rate, float(step.joints[step.turning.axis])
    # a ramp down of limited jerk takes the same angle as half its time at full rate
    ramp = (step.t_to - step.steady_to) if step.t_to > step.steady_to else 0.0
    return stop - rate * (step.steady_to - step.steady_from) - rate * ramp / 2
