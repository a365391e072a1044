"""What the estimators hand to the review: angles over time, as plain arrays."""

from dataclasses import dataclass

import numpy as np

from alignment.arrays import Array, IntArray, set_owned

ANGLES = ("roll", "yaw", "pitch")


@dataclass(frozen=True, slots=True, eq=False)
class AngleCurves:
    """One method's angles over one dwell.

    Attributes
    ----------
    method : str
        As shown in legends, for example 'six-position' or 'rk4'.
    label : str
        The dwell's label, for example 'X1 up'.
    t_ns : (m,) int64
        Since the start of the run.
    angles, errors, sigmas : (m, 3)
        Roll, yaw, pitch [rad]: estimated, estimated minus true (wrapped), and predicted
        standard deviation (0 where the method gives none).
    error_rotations : (m, 3)
        Rotation vector [rad], in b, that turns the true instrument axes onto the estimated ones.
    """

    method: str
    label: str
    t_ns: IntArray
    angles: Array
    errors: Array
    sigmas: Array
    error_rotations: Array

    def __post_init__(self) -> None:
        m = len(self.t_ns)
        set_owned(
            self,
            t_ns=(self.t_ns, (m,), np.int64),
            angles=(self.angles, (m, 3), float),
            errors=(self.errors, (m, 3), float),
            sigmas=(self.sigmas, (m, 3), float),
            error_rotations=(self.error_rotations, (m, 3), float),
        )


@dataclass(frozen=True, slots=True)
class Phase:
    """A step of the procedure as it ran; `kind` as in the procedure: 'dwell', 'move', 'rate'."""

    t_from_ns: int
    t_to_ns: int
    kind: str
    label: str
