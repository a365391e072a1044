"""Whether half a turn pays, and how long a test must be."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from alignment.arrays import Array
from alignment.earth import EARTH_RATE, Site
from alignment.errors import AlignmentError
from alignment.information.drift import switched_on
from alignment.methods.position_fit import (
    drift_covariance,
    equal_spans,
    local_vectors,
    predicted_covariance,
)
from alignment.methods.positions import pays
from alignment.options import Priors


@dataclass(frozen=True, slots=True)
class TurnPays:
    """Predicted sigma of heading [rad] in one position, or turned half-way, by a half or quarter.

    The same total time each. `verdict` in words.
    """

    one_position: float
    half_turn: float
    quarter_turn: float

    @property
    def pays(self) -> bool:
        """Whether any turn is better than none."""
        return min(self.half_turn, self.quarter_turn) < self.one_position

    @property
    def verdict(self) -> str:
        """For a person."""
        best = min(self.half_turn, self.quarter_turn)
        angle = "180" if self.half_turn <= self.quarter_turn else "90"
        return f"{pays(best, self.one_position)}; {angle} deg is the better turn"


def turn_pays(
    C_nb: Rotation,
    site: Site,
    priors: Priors,
    seconds: float,
    axis_b: ArrayLike = (0.0, 1.0, 0.0),
    gyros: ArrayLike = (True, True, True),
) -> TurnPays:
    """Turn error against bias: sigma of heading with and without a turn about `axis_b`.

    Parameters
    ----------
    C_nb : Rotation
        Attitude before the turn.
    site : Site
        Latitude known.
    priors : Priors
        Of the unit (`gyro_bias` stated; `gyro_walk` and `accel_walk` give the noise) and the
        table (`turn`).
    seconds : float
        Of rest, all positions together.
    axis_b : (3,)
        In b.
    gyros : (3,) bool
        Which gyros there are; the others are left out.

    Raises
    ------
    AlignmentError
        The bias is not stated, or the latitude.
    PoleError

    Notes
    -----
    With one gyro, known latitude and its axis east or west, a quarter turn is free of the turn
    error to first order (it looks along the meridian, where azimuth does not show) but scale
    error enters 1:1; a half turn carries half of the difference of both placements.
    """
    if not priors.gyro_bias > 0:
        raise AlignmentError("gyro_bias: not stated, so nothing tells whether a turn pays")
    site.horizontal_rate()
    latitude, gravity = local_vectors(site)
    assert latitude is not None
    assert gravity is not None
    axis = np.asarray(axis_b, dtype=float)
    axis = axis / np.linalg.norm(axis)
    priors = switched_on(priors)
    density = np.repeat([priors.gyro_walk, priors.accel_walk], 3) ** 2
    density[:3] = np.where(np.asarray(gyros, dtype=bool), density[:3], _ABSENT * seconds)

    def heading(*angles: float) -> float:
        relative = Rotation.from_rotvec(np.outer(angles, axis)).as_matrix()
        variances = np.tile(density * len(angles) / seconds, (len(angles), 1))
        drift = drift_covariance(priors, equal_spans(len(angles), seconds))
        P = predicted_covariance(
            C_nb.as_matrix(), variances, relative, latitude, gravity, priors, drift=drift
        )
        return float(np.sqrt(P[0, 2, 2]))

    return TurnPays(heading(0.0), heading(0.0, np.pi), heading(0.0, np.pi / 2))


_ABSENT = 1.0  # (rad/s)^2: variance of a gyro that is not there


def double_sigma(adev: ArrayLike, latitude: float) -> Array:
    """Heading sigma [rad] of a half turn with two gyros: ``ADEV(T/2) / (sqrt 2 W cos lat)``.

    `adev` [rad/s] is the Allan deviation at half the time: it covers all drift terms at once.
    """
    return np.asarray(adev) / (np.sqrt(2) * EARTH_RATE * np.cos(latitude))


def time_needed(
    target: float, latitude: float, walk: float, instability: float = 0.0, rate_walk: float = 0.0
) -> float | None:
    """Seconds until `double_sigma` falls to `target` [rad]; None: never.

    Parameters
    ----------
    target : float
        Heading sigma wanted [rad].
    latitude : float
        [rad]
    walk : float
        Angle random walk N [rad/sqrt(s)].
    instability : float
        Floor of the Allan deviation [rad/s] (0.664 times the bias instability B).
    rate_walk : float
        Rate random walk K [rad/s/sqrt(s)].

    Notes
    -----
    ``ADEV(tau)^2 = N^2/tau + floor^2 + K^2 tau/3`` with tau = T/2, solved for the first tau.
    White noise alone: ``T = (N / (W cos lat target))^2``.
    """
    allowed = 2 * (EARTH_RATE * np.cos(latitude) * target) ** 2 - instability**2
    if allowed <= 0:
        return None
    # K^2/3 tau^2 - allowed tau + N^2 = 0, in the form that does not cancel for small K
    root = allowed**2 - 4 * walk**2 * rate_walk**2 / 3
    if root < 0:
        return None
    return float(2 * 2 * walk**2 / (allowed + np.sqrt(root)))
