"""Constant, cosine and sine of readings against the encoder of a turning table."""

from dataclasses import dataclass

import numpy as np

from alignment.arrays import Array
from alignment.errors import AlignmentError, TooShort
from alignment.methods.position_fit import ROUNDING
from alignment.noise import BLOCKS

LEAST_ACROSS = 0.1  # part of a sensor that must lie across the axis for it to count
NOISIER = 25.0  # times the variance of the quietest sensor: one noisier than that is left out


@dataclass(frozen=True, slots=True, eq=False)
class Harmonics:
    """``constant + cosine cos(beta) + sine sin(beta)`` of k channels; (...) are independent runs.

    Attributes
    ----------
    constant, cosine, sine : (..., k)
    variance : (..., k)
        Of one sample, as the scatter of block means of the residuals has it.
    normal : (3, 3)
        Times `variance`: covariance of the three coefficients of a channel.
    """

    constant: Array
    cosine: Array
    sine: Array
    variance: Array
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
    left = np.sum((block_means(values, BLOCKS)[0] - X_mean @ coefficients) ** 2, axis=-2)
    # expectation for unit white noise: trace of B (1 - X normal X^T) B^T, B the block means
    expected = np.sum(1 / lengths) - np.sum((X_mean @ normal) * X_mean)
    constant, cosine, sine = np.moveaxis(coefficients, -2, 0)
    return Harmonics(constant, cosine, sine, left / expected, normal=normal)


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
    share : (...)
        Variance of the scale error of `across`, over that of one sensor.
    """

    across: Array
    variance: Array
    constant: Array
    share: Array


def turning_vector(
    h: Harmonics, axis_b: Array, sensors: tuple[bool, bool, bool] = (True, True, True)
) -> TurningVector:
    """What the sensors of a triad find together.

    Notes
    -----
    A sensor along u sees ``u . p`` with cos(beta) and ``p . (a x u)`` with sin(beta): each sensor
    alone gives all of p, times its scale factor, so its direction is free of scale errors. They
    count by how much of them lies across the axis, and not by their noise unless that is five
    times the quietest one's: an axis that nods once per turn (5'' at 4 deg/s is 1.7 deg/h, degrees
    of heading) has opposite signs in two gyros and cancels in their plain mean alone.
    """
    spread = float(h.normal[1, 1] + h.normal[2, 2]) / 2
    across = np.eye(3) - np.outer(axis_b, axis_b)
    length2 = np.diag(across)
    looks = np.array(sensors) & (length2 >= LEAST_ACROSS**2)
    if not looks.any():
        raise AlignmentError("no sensor looks across the axis of turning")
    across, length2 = across[looks], length2[looks]
    noise = spread * h.variance[..., looks] / length2 + ROUNDING[0] ** 2
    quiet = noise <= NOISIER * noise.min(axis=-1, keepdims=True)
    weights = quiet * length2
    weights = weights / weights.sum(axis=-1, keepdims=True)
    found = h.cosine[..., looks, None] * across
    found = found + h.sine[..., looks, None] * np.cross(axis_b, across)
    return TurningVector(
        np.einsum("...s,...si->...i", weights / length2, found),
        np.sum(weights**2 * noise, axis=-1),
        h.constant,
        np.sum(weights**2, axis=-1),
    )
