"""An attitude against the true one, in each of the ways in which errors are told."""

import numpy as np
from scipy.spatial.transform import Rotation

from alignment.angles import Sequence, angles_from_C_nb, headings, wrapped
from alignment.arrays import Array


def rotation_error(C_nb: Rotation, true: Rotation) -> Array:
    """The rotation vector (..., 3) about n [rad] that takes truth to estimate: N, E, D."""
    return np.asarray((C_nb * true.inv()).as_rotvec())


def angle_errors(sequence: Sequence, C_nb: Rotation, true: Rotation) -> Array:
    """Roll, yaw, pitch (..., 3) [rad] of the estimate minus those of the truth, wrapped."""
    return wrapped(angles_from_C_nb(sequence, C_nb) - angles_from_C_nb(sequence, true))


def heading_errors(C_nb: Rotation, true: Rotation) -> Array:
    """Heading (...) [rad] of the estimate minus that of the truth, wrapped.

    NaN where X1 of either is within 0.5 deg of the vertical.
    """
    return wrapped(headings(C_nb) - headings(true))
