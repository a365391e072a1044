"""Attitude angles: views of ``C_nb`` by two sequences of turns, and their inverses.

The papers turn from NUE (north, up, east): yaw about up (positive from north to WEST), pitch
about Z1 (positive nose up), roll about X1 (positive takes Y1 toward Z1). Heading, clockwise
from true north, is minus yaw.

Source: methods.md section 0. Estimators work on ``C_nb``; angles are only a view of it.
"""

from enum import Enum

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from alignment.arrays import Array

# Columns are north, up, east in NED: takes NUE components to NED components.
C_N_NUE = Rotation.from_matrix([[1, 0, 0], [0, 0, 1], [0, -1, 0]])
_C_NUE_N = C_N_NUE.inv()

SINGULAR = np.radians(0.5)  # nearer than this to +-90 deg the first and third turn merge
X1_VERTICAL = np.cos(np.radians(45.0))  # |up . X1| above this counts as "X1 vertical"


class Sequence(Enum):
    """The order of turns from NUE to b.

    YAW_PITCH_ROLL is singular at pitch = +-90 deg (X1 vertical), YAW_ROLL_PITCH at roll = +-90
    deg (Z1 vertical).
    """

    YAW_PITCH_ROLL = "yaw-pitch-roll"
    YAW_ROLL_PITCH = "yaw-roll-pitch"


class SequenceRule(Enum):
    """Which sequence a position is read by.

    REGULAR takes yaw-roll-pitch when X1 is vertical and yaw-pitch-roll otherwise; it is never
    singular in the six positions. PUBLISHED is the assignment as printed in [S0]: yaw-pitch-roll
    when X1 is vertical, yaw-roll-pitch otherwise (singular for X1 and for Z1).
    """

    REGULAR = "regular"
    PUBLISHED = "published"

    def sequence_for(self, up_b: ArrayLike) -> Sequence:
        """The sequence for an attitude whose vertical is `up_b` (3,), any length."""
        up = np.asarray(up_b, dtype=float)
        x1_vertical = abs(up[0]) > X1_VERTICAL * np.linalg.norm(up)
        regular = self is SequenceRule.REGULAR
        return Sequence.YAW_ROLL_PITCH if x1_vertical == regular else Sequence.YAW_PITCH_ROLL

    def sequence_at(self, C_nb: Rotation) -> Sequence:
        """The sequence for an attitude."""
        return self.sequence_for(C_nb.inv().apply([0.0, 0.0, -1.0]))


def C_nb_from_angles(sequence: Sequence, roll: float, yaw: float, pitch: float) -> Rotation:
    """Attitude from angles [rad] by the given order of turns."""
    if sequence is Sequence.YAW_PITCH_ROLL:
        C_nue_b = Rotation.from_euler("YZX", [yaw, pitch, roll])
    else:
        C_nue_b = Rotation.from_euler("YXZ", [yaw, roll, pitch])
    return C_N_NUE * C_nue_b


def angles_from_C_nb(sequence: Sequence, C_nb: Rotation) -> Array:
    """Roll, yaw, pitch [rad] of one attitude (3,) or of many (n, 3).

    Yaw and the last turn lie in [-pi, pi], the middle turn in [-pi/2, pi/2]. At the sequence's
    singularity only the sum or difference of the outer turns means anything (`near_singular`).
    """
    R = (_C_NUE_N * C_nb).as_matrix()
    if sequence is Sequence.YAW_PITCH_ROLL:
        pitch = np.arctan2(R[..., 1, 0], np.hypot(R[..., 1, 1], R[..., 1, 2]))
        roll = np.arctan2(-R[..., 1, 2], R[..., 1, 1])
        yaw = np.arctan2(-R[..., 2, 0], R[..., 0, 0])
    else:
        roll = np.arctan2(-R[..., 1, 2], np.hypot(R[..., 1, 0], R[..., 1, 1]))
        pitch = np.arctan2(R[..., 1, 0], R[..., 1, 1])
        yaw = np.arctan2(R[..., 0, 2], R[..., 2, 2])
    return np.stack([roll, yaw, pitch], axis=-1)


def near_singular(sequence: Sequence, angles: Array) -> NDArray[np.bool_]:
    """Whether the middle turn of roll, yaw, pitch (..., 3) [rad] is within 0.5 deg of +-90 deg."""
    middle = angles[..., 2] if sequence is Sequence.YAW_PITCH_ROLL else angles[..., 0]
    return np.asarray(np.abs(middle) > np.pi / 2 - SINGULAR)


def heading_from_C_nb(C_nb: Rotation) -> float | None:
    """Direction of X1 projected on the horizon [rad], clockwise from true north, 0 to 2 pi.

    None when X1 is within 0.5 deg of vertical: such an X1 points nowhere.
    """
    heading = float(headings(C_nb))
    return None if np.isnan(heading) else heading


def headings(C_nb: Rotation) -> Array:
    """The same of any number of attitudes (...), NaN where X1 is vertical."""
    north, east = np.moveaxis(C_nb.apply([1.0, 0.0, 0.0]), -1, 0)[:2]
    heading = np.arctan2(east, north) % (2 * np.pi)
    heading = np.where(heading == 2 * np.pi, 0.0, heading)  # a tiny negative angle rounds up
    return np.where(np.hypot(north, east) < np.sin(SINGULAR), np.nan, heading)


def heading_row(C_nb: Rotation) -> Array:
    """What heading (..., 3) is of a small rotation about n: zeros where X1 is vertical.

    ``d heading = eta_D - x_D (x_N eta_N + x_E eta_E) / (x_N^2 + x_E^2)`` with x = X1 in n: a
    tilted X1 turns sideways when the attitude rolls about its horizontal projection.
    """
    north, east, down = np.moveaxis(C_nb.apply([1.0, 0.0, 0.0]), -1, 0)
    level2 = np.asarray(north**2 + east**2)
    row = np.stack([-north * down, -east * down, level2], axis=-1)
    return np.divide(row, level2[..., None], out=np.zeros_like(row), where=level2[..., None] > 0)


def wrapped(angle: ArrayLike) -> Array:
    """Angles brought into [-pi, pi]: how errors are stated."""
    return (np.asarray(angle, dtype=float) + np.pi) % (2 * np.pi) - np.pi


def angle_jacobian(sequence: Sequence, roll: ArrayLike, yaw: ArrayLike, pitch: ArrayLike) -> Array:
    """Jacobian (..., 3, 3) from a small rotation about n [rad] to (roll, yaw, pitch) [rad].

    ``d(roll, yaw, pitch) = J eta``, where the estimate is ``exp(eta x) C_nb``. The columns of
    its inverse are the axes of the three turns in NED: up for yaw, the second turn's axis after
    yaw, the third's after both. Singular where the sequence is.
    """
    roll, yaw, pitch = np.broadcast_arrays(roll, yaw, pitch)
    s, c, zero = np.sin(yaw), np.cos(yaw), np.zeros(np.shape(yaw))
    if sequence is Sequence.YAW_PITCH_ROLL:
        pitch_axis = [s, c, zero]
        roll_axis = [c * np.cos(pitch), -s * np.cos(pitch), -np.sin(pitch)]
    else:
        roll_axis = [c, -s, zero]
        pitch_axis = [s * np.cos(roll), c * np.cos(roll), np.sin(roll)]
    columns = np.array([roll_axis, [zero, zero, zero - 1], pitch_axis])
    jacobian: Array = np.asarray(np.linalg.inv(np.moveaxis(columns, (0, 1), (-1, -2))), float)
    return jacobian
