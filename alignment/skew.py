"""Triads whose sensors do not lie along X1, Y1, Z1: skewed by design, not by fault.

``axes`` (3, 3): unit vectors of the sensitive axes in b as rows, so that a triad reads
``axes @ x`` and ``x = axes^-1 @ readings``. Source: [S2] accelerometers in a skewed frame; [S1] (1)
planes of resonators an angle theta apart.
"""

import numpy as np
from numpy.typing import ArrayLike

from alignment.arrays import Array
from alignment.errors import AlignmentError

Axes = tuple[tuple[float, float, float], ...]
"""Three rows, as options and priors hold them."""

LEAST_VOLUME = 0.05  # of the three axes: below it they lie nearly in one plane


def unit_axes(axes: ArrayLike) -> Array:
    """The axes (3, 3) as unit vectors.

    Raises
    ------
    AlignmentError
        Not three rows of three numbers, or axes nearly in one plane.
    """
    rows = np.asarray(axes, dtype=float)
    if rows.shape != (3, 3) or not np.isfinite(rows).all():
        raise AlignmentError(f"axes: shape {rows.shape}, must be three axes of three components")
    sizes = np.linalg.norm(rows, axis=1)
    if not sizes.all():
        raise AlignmentError("axes: one of them is zero, must have a direction")
    rows = rows / sizes[:, None]
    volume = abs(float(np.linalg.det(rows)))
    if volume < LEAST_VOLUME:
        raise AlignmentError(
            f"axes: nearly in one plane: they span {volume:.2g}, must be {LEAST_VOLUME:g} to 1"
        )
    return rows


def components(readings: Array, axes: ArrayLike) -> Array:
    """Components in b (..., 3) of what sensors along `axes` read (..., 3)."""
    return np.asarray(readings @ np.linalg.inv(unit_axes(axes)).T)


def spread(axes: ArrayLike) -> Array:
    """Covariance (3, 3) in b of equal, independent errors of variance 1 along the axes."""
    back = np.linalg.inv(unit_axes(axes))
    return np.asarray(back @ back.T)


def back_from(axes: ArrayLike | None) -> Array:
    """Matrix (3, 3) that takes readings along `axes` to components in b; None: along b."""
    return np.eye(3) if axes is None else np.linalg.inv(unit_axes(axes))


def correlated(variances: Array, axes: ArrayLike | None) -> Array:
    """Covariance (3, 3) of components in b whose variances (3,) come of like, independent sensors.

    Diagonal for a triad along b.
    """
    if axes is None:
        return np.diag(variances)
    own = spread(axes)
    sizes = np.sqrt(np.asarray(variances) / own.diagonal())
    return np.asarray(own * sizes[:, None] * sizes)


def by_planes(theta: float) -> Axes:
    """[S1] (1): X1, Y1, and a third axis `theta` [rad] from X1 toward Z1."""
    return (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (float(np.cos(theta)), 0.0, float(np.sin(theta)))


def cone(half_angle: float) -> Array:
    """Three axes evenly about Y1, `half_angle` [rad] off it: square at 54.7 deg."""
    turn = 2 * np.pi / 3 * np.arange(3)
    across, along = np.sin(half_angle), np.cos(half_angle)
    return np.stack([across * np.cos(turn), np.full(3, along), across * np.sin(turn)], axis=1)
