"""Motion: joint angles, rates and accelerations as exact functions of time."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from alignment.arrays import Array, owned


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """Piecewise polynomials of the six joint angles.

    Attributes
    ----------
    knots : (k + 1,) s
        Where the pieces meet: jerk switches, starts and ends of steps. Increasing from 0.
    coefficients : (d + 1, k, 6)
        Of each piece and joint, highest power first, in time since the piece's start [rad/s^i].
        Angle, rate and acceleration are continuous.
    """

    knots: Array
    coefficients: Array

    def __post_init__(self) -> None:
        knots = owned(self.knots, "knots", (None,))
        pieces = (None, len(knots) - 1, None)
        object.__setattr__(self, "knots", knots)
        object.__setattr__(self, "coefficients", owned(self.coefficients, "coefficients", pieces))
        if len(knots) < 2 or knots[0] != 0 or (np.diff(knots) <= 0).any():
            raise ValueError("knots: must increase from 0")

    @property
    def duration(self) -> float:
        """Length of the motion [s]."""
        return float(self.knots[-1])

    @property
    def at_rest(self) -> NDArray[np.bool_]:
        """Which pieces (k,) stand still."""
        return np.logical_not(np.any(self.coefficients[:-1], axis=(0, 2)))

    def joints(self, t: ArrayLike) -> tuple[Array, Array, Array]:
        """Angles [rad], rates [rad/s] and accelerations [rad/s^2] at times (n,): (n, 6) each.

        Outside of its time the motion is held as it begins and ends, which is at rest.
        """
        t = np.clip(t, 0.0, self.duration)
        piece = np.searchsorted(self.knots[1:-1], t, side="right")
        tau = np.repeat((t - self.knots[piece])[:, None], self.coefficients.shape[2], axis=1)
        # Horner's scheme for a polynomial and its first two derivatives at once. SciPy's PPoly is
        # as fast, but takes 0.2 s to import at every start.
        angle, *terms = np.take(self.coefficients, piece, axis=1, mode="clip")
        rate, half_acceleration = np.zeros_like(angle), np.zeros_like(angle)
        for term in terms:
            half_acceleration *= tau
            half_acceleration += rate
            rate *= tau
            rate += angle
            angle *= tau
            angle += term
        half_acceleration *= 2
        return angle, rate, half_acceleration
