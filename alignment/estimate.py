"""The answer of an estimator: an attitude, how sure it is, and what was found on the way."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray
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
from alignment.calibration.result import Calibration

ANGLES = ("roll", "yaw", "pitch")
ANGLE_LIMIT = np.radians(30.0)  # sigma of a heading, or of an angle, that is still a number
LATITUDE_LIMIT = np.radians(10.0)  # of a latitude: beyond it a hemisphere is no news


def determined(sigma: ArrayLike, limit: float = ANGLE_LIMIT) -> NDArray[np.bool_]:
    """Whether a number with this standard deviation [rad] can stand; one without any does.

    The one rule of all commands: a heading whose sigma is 30 deg misses by more than a right angle
    once in 370 times, one of 60 deg is nearly drawn from the whole circle.
    """
    return np.asarray(~(np.asarray(sigma) > limit))


def why_undetermined(sigma: float, limit: float = ANGLE_LIMIT) -> str:
    """Why a number with this standard deviation [rad] cannot stand; '' where it can."""
    if determined(sigma, limit):
        return ""
    size = np.degrees(sigma)
    told = f"sigma of {size:.4g} deg" if size <= 180 else "sigma"
    return f"{told} is above {np.degrees(limit if size <= 180 else np.pi):.4g} deg"


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

    Numbers that cannot stand (`determined`) are not given: `undetermined` says why. `C_nb` and
    `covariance` stay as they are: levelling holds while the heading does not.

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
        Where estimated [rad]; of a latitude that is not determined only the sigma.
    flags : tuple of str
        Doubts a reader must see.
    biases, bias_sigmas : (6,) or None
        Of gyros [rad/s], then accelerometers [m/s^2], on X1, Y1, Z1, as they were switched on,
        where the method finds them, with their standard deviations.
    sway : mapping or None
        What a method found of the base's rocking, by name, SI.
    calibration : Calibration or None
        A unit's constants, where the method finds them: of the first of its estimates.
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
    sway: Mapping[str, float] | None = None
    calibration: Calibration | None = None
    # read off once: reports ask for them dozens of times
    _turns: Array | None = field(init=False, repr=False, default=None)
    _sigmas: Array | None = field(init=False, repr=False, default=None)
    _heading: float | None = field(init=False, repr=False, default=None)
    _heading_sigma: float | None = field(init=False, repr=False, default=None)

    def __post_init__(self) -> None:
        shapes = {"covariance": (3, 3), "biases": (6,), "bias_sigmas": (6,)}
        there = {name: value for name in shapes if (value := getattr(self, name)) is not None}
        set_owned(self, **{name: (value, shapes[name], float) for name, value in there.items()})
        if self.C_nb is not None:
            turns = angles_from_C_nb(self.sequence, self.C_nb)
            set_owned(self, _turns=(turns, (3,), float))
            if self.covariance is not None and not self.singular:
                sigmas = angle_sigmas(self.sequence, turns, self.covariance)
                set_owned(self, _sigmas=(sigmas, (3,), float))
            self._read_heading(self.C_nb)
        if "latitude" in self.undetermined:
            object.__setattr__(self, "latitude", None)

    def _read_heading(self, C_nb: Rotation) -> None:
        heading = heading_from_C_nb(C_nb)
        object.__setattr__(self, "_heading", heading)
        if heading is not None and self.covariance is not None:
            sigma = float(heading_sigmas(C_nb, self.covariance))
            object.__setattr__(self, "_heading_sigma", sigma)

    @property
    def angles(self) -> Array | None:
        """Roll, yaw, pitch [rad] by `sequence`, (3,), NaN of what is not determined.

        None without an attitude.
        """
        if self._turns is None:
            return None
        return np.where(determined(self._angle_sigmas()), self._turns, np.nan)

    @property
    def heading(self) -> float | None:
        """Of X1 on the horizon [rad], clockwise from north.

        None for a vertical X1, and where it is not determined.
        """
        sigma = self._heading_sigma
        return self._heading if sigma is None or determined(sigma) else None

    @property
    def heading_sigma(self) -> float | None:
        """Standard deviation of `heading` [rad]; None where there is none, as of a vertical X1."""
        return self._heading_sigma

    @property
    def singular(self) -> bool:
        """Whether roll, yaw and pitch cannot be told apart by this sequence here."""
        return self._turns is not None and bool(near_singular(self.sequence, self._turns))

    @property
    def sigmas(self) -> Array | None:
        """Standard deviations of roll, yaw, pitch [rad], (3,); None where there are none."""
        return self._sigmas

    @property
    def undetermined(self) -> dict[str, str]:
        """Why 'heading', 'roll', 'yaw', 'pitch', 'latitude' are not given: those that are not."""
        sigmas = {"heading": self.heading_sigma or 0.0}
        if self.C_nb is not None:
            sigmas |= dict(zip(ANGLES, self._angle_sigmas().tolist(), strict=True))
        why = {name: why_undetermined(sigma) for name, sigma in sigmas.items()}
        why["latitude"] = why_undetermined(self.latitude_sigma or 0.0, LATITUDE_LIMIT)
        return {name: reason for name, reason in why.items() if reason}

    def _angle_sigmas(self) -> Array:
        """As `sigmas`; where the outer turns merge both have the azimuth's, 0 without any."""
        if self._sigmas is not None:
            return self._sigmas
        if self.covariance is None or not self.singular:
            return np.zeros(3)
        middle = "pitch" if self.sequence is Sequence.YAW_PITCH_ROLL else "roll"
        outer = np.array([name != middle for name in ANGLES])
        return np.where(outer, np.sqrt(max(self.covariance[2, 2], 0.0)), 0.0)


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
