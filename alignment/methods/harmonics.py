"""Constant, cosine and sine of readings against the encoder of a turning table."""

from dataclasses import dataclass
from itertools import product

import numpy as np

from alignment.arrays import Array, BoolArray
from alignment.errors import AlignmentError, TooShort
from alignment.methods.position_fit import ROUNDING
from alignment.noise import BLOCKS

LEAST_ACROSS = 0.1  # part of a sensor that must lie across the axis for it to count
LESSENED = 6.5  # times the variance: what leaving out one of two sensors gains if it is 5 x noisier


@dataclass(frozen=True, slots=True, eq=False)
class Harmonics:
    """``constant + cosine cos(beta) + sine sin(beta)`` of k channels; (...) are independent runs.

    Attributes
    ----------
    constant, cosine, sine : (..., k)
    scatter : (..., k, k)
        Covariance of one sample, as block means of the residuals have it.
    normal : (3, 3)
        Times a variance of `scatter`: covariance of the three coefficients of a channel.
    """

    constant: Array
    cosine: Array
    sine: Array
    scatter: Array
    normal: Array


def interval_harmonics(angle: Array) -> Array:
    """Means (m, 3) of 1, cos, sin over the intervals between angles (m + 1,) [rad].

    At constant rate within an interval these are exact: the middle of it, times the sinc of half
    of it. A sample pairs with its interval so, not with the angle at its stamp.
    """
    middle, half = (angle[1:] + angle[:-1]) / 2, np.diff(angle) / 2
    # sine of half the interval over it; an interval without turning has its middle's value
    part = np.divide(np.sin(half), half, out=np.ones_like(half), where=half != 0)
    return np.stack([np.ones_like(middle), part * np.cos(middle), part * np.sin(middle)], axis=1)


def harmonics_at(angle: Array) -> Array:
    """1, cos, sin (m, 3) at angles (m,) [rad]: what instants pair with."""
    return np.stack([np.ones_like(angle), np.cos(angle), np.sin(angle)], axis=1)


def harmonic_fit(X: Array, values: Array) -> Harmonics:
    """Least squares of samples (..., m, k) on their `interval_harmonics` or `harmonics_at` (m, 3).

    Notes
    -----
    The noise of a sample is taken from 32 block means of the residuals, less what the three
    coefficients took of them; noise slower than a turn is thereby overstated.
    """
    m = len(X)
    if m < BLOCKS:
        raise TooShort(f"{m} samples: at least {BLOCKS} are needed")
    normal = np.linalg.inv(X.T @ X)
    coefficients = normal @ (X.T @ values)
    X_mean, lengths = block_means(X, BLOCKS)
    left = block_means(values, BLOCKS)[0] - X_mean @ coefficients
    scatter = np.swapaxes(left, -1, -2) @ left
    # expectation for unit white noise: trace of B (1 - X normal X^T) B^T, B the block means
    expected = np.sum(1 / lengths) - np.sum((X_mean @ normal) * X_mean)
    constant, cosine, sine = np.moveaxis(coefficients, -2, 0)
    return Harmonics(constant, cosine, sine, scatter / expected, normal=normal)


def block_means(values: Array, blocks: int) -> tuple[Array, Array]:
    """Means (..., blocks, k) of stretches of (..., m, k), and their lengths (blocks,)."""
    m = values.shape[-2]
    edges = np.arange(blocks + 1) * m // blocks
    lengths = np.diff(edges)
    return np.add.reduceat(values, edges[:-1], axis=-2) / lengths[:, None], lengths


@dataclass(frozen=True, slots=True, eq=False)
class TurningVector:
    """A vector fixed to the Earth as a turning triad sees it, in b at encoder angle 0.

    Attributes
    ----------
    across : (..., 3)
        Its part across the axis of turning: no bias in it.
    variance : (...)
        Of each of the two components of `across`.
    constant : (..., 3)
        What does not turn: its part along the axis, biases, and the table's rate (of gyros).
    parts : (..., 3)
        Of each sensor's harmonic along its part across the axis, what goes into `across`.
    """

    across: Array
    variance: Array
    constant: Array
    parts: Array


def turning_vector(
    h: Harmonics, axis_b: Array, sensors: tuple[bool, bool, bool] = (True, True, True)
) -> TurningVector:
    """What the sensors of a triad find together.

    Notes
    -----
    A sensor along u sees ``u . p`` with cos(beta) and ``p . (a x u)`` with sin(beta): each sensor
    alone gives all of p, times its scale factor, so its direction is free of scale errors. They
    count by how much of them lies across the axis. In their plain mean alone cancels an axis that
    nods once per turn (24'' at 4 deg/s is 1.7 deg/h, degrees of heading), which has opposite signs
    in two gyros, and a table whose speed ripples, which all gyros feel that are not square to the
    axis. So none is left out unless the noise of what they find together, in which the ripple
    cancels too, is lessened 6.5 times: by one of two gyros of five times the other's noise.
    """
    across = np.eye(3) - np.outer(axis_b, axis_b)
    counted = counting(h, axis_b, sensors)
    parts = counted / (counted @ np.diag(across))[..., None]
    vector = across_of(h.cosine, h.sine, parts, axis_b)
    return TurningVector(vector, _noise(h, across, counted), h.constant, parts)


def across_of(cosine: Array, sine: Array, parts: Array, axis_b: Array) -> Array:
    """The vector (..., 3) across the axis that harmonics (..., 3) of three sensors show."""
    across = np.eye(3) - np.outer(axis_b, axis_b)
    found = cosine[..., None] * across + sine[..., None] * np.cross(axis_b, across)
    return np.einsum("...s,...si->...i", parts, found)


def counting(
    h: Harmonics, axis_b: Array, sensors: tuple[bool, bool, bool] = (True, True, True)
) -> BoolArray:
    """Which sensors (..., 3) of a triad count for its `turning_vector`.

    Raises
    ------
    AlignmentError
        None of `sensors` looks across the axis.
    """
    across = np.eye(3) - np.outer(axis_b, axis_b)
    looks = np.array(sensors) & (np.diag(across) >= LEAST_ACROSS**2)
    if not looks.any():
        raise AlignmentError("no sensor looks across the axis of turning")
    sets = np.array([s for s in product((True, False), repeat=3) if any(s) and np.all(looks >= s)])
    noise = np.stack([_noise(h, across, one) for one in sets], axis=-1)  # of all of them first
    least = np.argmin(noise, axis=-1)
    return sets[np.where(noise[..., 0] > LESSENED * np.min(noise, axis=-1), least, 0)]


def _noise(h: Harmonics, across: Array, counted: BoolArray) -> Array:
    """Variance (...) of the two components that the `counted` sensors (..., 3) find together."""
    spread = float(h.normal[1, 1] + h.normal[2, 2]) / 2
    found = np.einsum("...i,...ij,ij,...j->...", counted, h.scatter, across, counted)
    return np.asarray(spread * found / (counted @ np.diag(across)) ** 2 + ROUNDING[0] ** 2)


def ripple_left(axis_b: Array, counted: BoolArray) -> float:
    """How much of what errs once per turn the `counted` sensors (3,) make an error of, 0 to 1.

    Of a rate along the axis, and of one that goes round against what turns: none if all count.

    Notes
    -----
    ``sum a_i c_i`` and ``sum c_i c_i^T - (a x c_i) (a x c_i)^T`` of sensors' parts c_i across
    the axis, over the sum of their squares: both vanish over three square ones.
    """
    across = (np.eye(3) - np.outer(axis_b, axis_b))[counted]
    round_ = np.cross(axis_b, across)
    along = axis_b[counted] @ across
    against = across.T @ across - round_.T @ round_
    errs = np.hypot(np.linalg.norm(along), np.linalg.norm(against, 2))
    return float(errs / np.sum(across**2))
