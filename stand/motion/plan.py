"""A plan: the steps as they will run, and the motion that joins them."""

from dataclasses import dataclass, replace
from math import ceil

import numpy as np
from scipy.spatial.transform import Rotation

from alignment.arrays import Array, set_owned
from alignment.readings import EDGE
from stand.motion.polynomial import SAME_KNOT, Motion
from stand.table.joints import JOINTS


@dataclass(frozen=True, slots=True, eq=False)
class Turning:
    """A constant rate [rad/s] of one axis (its place in `JOINTS`); `axis_b` (3,) unit, in b.

    `angle` of the axis [rad] where the rate is reached, whole turns included.
    """

    axis: int
    rate: float
    axis_b: Array
    angle: float = 0.0

    def __post_init__(self) -> None:
        set_owned(self, axis_b=(self.axis_b, (3,), float))


@dataclass(frozen=True, slots=True, eq=False)
class PlannedStep:
    """A step with its times [s], the joint angles (6,) [rad] at its end and ``C_nb`` there.

    `number` is its place in the procedure, from 0. Between `steady_from` and `steady_to` it does
    what it is for: stands still, turns at constant rate, rocks at full size. Of a `turning` one,
    ``C_nb`` is the attitude where its axis reads zero.
    """

    number: int
    kind: str
    label: str
    t_from: float
    t_to: float
    steady_from: float
    steady_to: float
    joints: Array
    C_nb: Rotation
    turning: Turning | None = None

    def __post_init__(self) -> None:
        set_owned(self, joints=(self.joints, (len(JOINTS),), float))


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """The steps with their times, and the motion through them.

    `rests` (s, 6): which axes each step lets stand still while it is steady.
    """

    steps: tuple[PlannedStep, ...]
    motion: Motion
    rests: np.ndarray

    def read_late(self, late: float, rate_hz: float) -> "Plan":
        """The same with rests that are steady no sooner than `late` [s] after what moved before
        them, as long as a unit's readings show it: from the next sample on. Turns keep their whole
        revolutions."""
        if not late:
            return self
        moving = np.any(self.motion.coefficients[:-1], axis=0)
        steps = []
        for step, rests in zip(self.steps, self.rests, strict=True):
            if step.kind == "dwell":
                before = self.motion.knots[:-1] < step.steady_from - SAME_KNOT
                moved = np.flatnonzero(before & moving[:, rests].any(axis=1))
                if len(moved):
                    over = float(self.motion.knots[moved[-1] + 1]) + late
                    if over > step.steady_from:
                        begin = ceil((over - EDGE) * rate_hz) / rate_hz
                        step = replace(step, steady_from=min(begin, step.steady_to))
            steps.append(step)
        return replace(self, steps=tuple(steps))

    @property
    def stretches(self) -> list[PlannedStep]:
        """The steps to estimate from: those that stand still, and those at constant rate."""
        return [s for s in self.steps if s.kind == "dwell" or s.turning is not None]
