"""The answer of an estimator: an attitude, how sure it is, and what was found on the way."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from alignment.angles import (
    Sequence,
    angle_jacobian,
    angles_from_C_nb,
    heading_from_C_nb,
    heading_row,
    near_singular,
)
from alignment.arrays import Array, owned, set_owned


def angle_sigmas(sequence: Sequence, angles: Array, covariance: Array) -> Array:
    """Standard deviations (..., 3) of roll, yaw, pitch [rad] (..., 3) from covariances about n.

    `covariance` is (..., 3, 3) [rad^2]. NaN at the sequence's singularity, where the angles
    cannot be told apart.
    """
    singular = near_singular(sequence, angles)
    regular = np.where(singular[..., None], 0.0, angles)
    J = angle_jacobian(sequence, *np.moveaxis(regular, -1, 0))
    variances = np.einsum("...ij,...jk,...ik->...i", J, covariance, J)
    sigmas: Array = np.where(singular[..., None], np.nan, np.sqrt(np.maximum(variances, 0.0)))
    return sigmas


def heading_sigmas(C_nb: Rotation, covariance: Array) -> Array:
    """Standard deviations (...) of heading [rad] from covariances (..., 3, 3) about n [rad^2]."""
    j = heading_row(C_nb)
    variances = (j[..., None, :] @ covariance @ j[..., :, None])[..., 0, 0]
    return np.asarray(np.sqrt(np.maximum(variances, 0.0)))


@dataclass(frozen=True, slots=True, eq=False)
class AttitudeEstimate:
    """One attitude from one stretch of readings.

    Attributes
    ----------
    method, label : str
        The estimator's id and the position's name.
    t_from, t_to : float
        The readings used [s].
    C_nb : Rotation or None
        None where the method gives no attitude (a latitude from a pair of positions).
    sequence : Sequence
        The order of turns its angles are read by.
    window : str
        '' or the variant of the method: 'same' or 'fresh' (six-position).
    covariance : (3, 3) or None
        Of the small rotation about n [rad^2] that takes truth to estimate (N, E, D), with its
        cross terms; None where the method gives none.
    latitude, latitude_sigma : float or None
        Where estimated [rad].
    flags : tuple of str
        Doubts a reader must see.
    biases, bias_sigmas : (6,) or None
        Of gyros [rad/s], then accelerometers [m/s^2], on X1, Y1, Z1, where the method finds
        them, with their standard deviations.
    """

    method: str
    label: str
    t_from: float
    t_to: float
    C_nb: Rotation | None
    sequence: Sequence
    window: str = ""
    covariance: Array | None = None
    latitude: float | None = None
    latitude_sigma: float | None = None
    flags: tuple[str, ...] = ()
    biases: Array | None = None
    bias_sigmas: Array | None = None

    def __post_init__(self) -> None:
        shapes = {"covariance": (3, 3), "biases": (6,), "bias_sigmas": (6,)}
        there = {name: value for name in shapes if (value := getattr(self, name)) is not None}
        set_owned(self, **{name: (value, shapes[name], float) for name, value in there.items()})

    @property
    def angles(self) -> Array | None:
        """Roll, yaw, pitch [rad] by `sequence`, (3,); None without an attitude."""
        return None if self.C_nb is None else angles_from_C_nb(self.sequence, self.C_nb)

    @property
    def heading(self) -> float | None:
        """Of X1 on the horizon [rad], clockwise from north; None for a vertical X1."""
        return None if self.C_nb is None else heading_from_C_nb(self.C_nb)

    @property
    def heading_sigma(self) -> float | None:
        """Standard deviation of `heading` [rad]; None where there is none."""
        if self.C_nb is None or self.covariance is None or self.heading is None:
            return None
        return float(heading_sigmas(self.C_nb, self.covariance))

    @property
    def singular(self) -> bool:
        """Whether roll, yaw and pitch cannot be told apart by this sequence here."""
        angles = self.angles
        return angles is not None and bool(near_singular(self.sequence, angles))

    @property
    def sigmas(self) -> Array | None:
        """Standard deviations of roll, yaw, pitch [rad], (3,); None where there are none."""
        angles = self.angles
        if angles is None or self.covariance is None or self.singular:
            return None
        return angle_sigmas(self.sequence, angles, self.covariance)


@dataclass(frozen=True, slots=True, eq=False)
class AttitudeTrack:
    """One method's attitude over the time of a dwell: for curves.

    `t` (m,) [s]; `C_nb` m rotations; `covariance` (m, 3, 3) about n [rad^2].
    """

    method: str
    label: str
    t: Array
    C_nb: Rotation
    sequence: Sequence
    covariance: Array

    def __post_init__(self) -> None:
        m = len(self.t)
        object.__setattr__(self, "t", owned(self.t, "t", (m,)))
        object.__setattr__(self, "covariance", owned(self.covariance, "covariance", (m, 3, 3)))
