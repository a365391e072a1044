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
    return Stretch(
        step.label,
        step.steady_from,
        length,
        step.C_nb,
        rate=turning.rate,
        axis_b=axis,
        angle=turning.angle,
    )
