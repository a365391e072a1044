"""Covariance of means and harmonics of slow processes, within a stretch and between stretches.

A stretch of time T is told by integrals of the process times ``exp(i k (r t + angle))``, k = 0 at
rest, k = 0 and 1 where it turns by whole turns at rate r; `coefficients` makes constant, cosine and
sine of them. Closed forms: nothing is sampled.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from math import sqrt

import numpy as np

from alignment.arrays import Array
from alignment.options import Priors

DECADES = (1.0, 10.0, 100.0, 1000.0, 10000.0)  # s: correlation times that make up an instability
LASTING = 60.0  # s: correlation beyond it makes a bias of a dwell, and priors of biases hold it
LEVEL = 0.76475  # least Allan deviation, between 10 and 1000 s, of a unit process on each of them

LEAST = 0.01  # part of a bias that is left to switching on: none at all is for what nobody states

_BEGINNING = 0.01  # of a stretch: a bias that walks has walked so long before, or it were none

_TO_REAL = np.array([[1, 0, 0], [0, 1, 1], [0, -1j, 1j]])  # of integrals with k = 0, 1, -1


@dataclass(frozen=True, slots=True)
class GaussMarkov:
    """A stationary process with covariance ``sigma^2 exp(-|t|/time)``; `time` in s.

    Bias instability is a sum of them, a decade of time apart each.
    """

    sigma: float
    time: float

    def __post_init__(self) -> None:
        if not self.sigma >= 0 or not self.time > 0:
            raise ValueError(f"sigma {self.sigma}, time {self.time}: must be >= 0 and > 0")


def flicker(plateau: float) -> tuple[GaussMarkov, ...]:
    """The processes whose Allan deviation stays about `plateau` from seconds to an hour."""
    return tuple(GaussMarkov(plateau / LEVEL, time) for time in DECADES) if plateau else ()


def turn_on(bias: float, plateau: float) -> float:
    """What of a bias's prior is constant: without what of its instability outlasts a minute."""
    slow = sum(one.sigma**2 for one in flicker(plateau) if one.time > LASTING)
    return sqrt(max(bias**2 - slow, 0.0))


def switched_on(priors: Priors) -> Priors:
    """The priors of one who counts drifts from time 0 on: of biases as they were then."""
    p = priors
    return replace(
        p,
        gyro_bias=max(turn_on(p.gyro_bias, p.gyro_instability), LEAST * p.gyro_bias),
        accel_bias=max(turn_on(p.accel_bias, p.accel_instability), LEAST * p.accel_bias),
    )


def at_the_start(priors: Priors, start: float, length: float) -> Priors:
    """The priors of biases as a stretch may find them that begins `start` [s] after they were
    switched on: walks and ramps have gone on.

    What a ramp comes to by its `length` [s] is not apart from what it was before: with
    ``start (start + length)`` its mean has the right variance beside that of the rise alone, but
    for a twelfth of ``length^2``.
    """
    before = max(start, _BEGINNING * length)
    return _grown(priors, before, before * (before + length))


def in_the_mean(priors: Priors, start: float, length: float) -> Priors:
    """The priors of biases as the mean over a stretch has them: ``start + length/3`` of a walk."""
    middle = max(start, 0.0) + length / 2
    return _grown(priors, max(start, 0.0) + length / 3, middle**2)


def _grown(priors: Priors, walked: float, ramped: float) -> Priors:
    """The same with variances of unit walks [s] and ramps [s^2] added to the biases'."""
    p = priors
    if not _walks(p):
        return p
    gyro = p.gyro_bias**2 + walked * p.gyro_random_walk**2 + ramped * p.gyro_ramp**2
    accel = p.accel_bias**2 + walked * p.accel_random_walk**2 + ramped * p.accel_ramp**2
    return replace(p, gyro_bias=sqrt(gyro), accel_bias=sqrt(accel))


def _walks(priors: Priors) -> bool:
    p = priors
    return any((p.gyro_random_walk, p.gyro_ramp, p.accel_random_walk, p.accel_ramp))


def sum_covariance(gain: Array, span: float, processes: Sequence[GaussMarkov]) -> Array:
    """Covariance (k, k) of sums of what processes do in even blocks, alike and apart on each axis.

    Parameters
    ----------
    gain : (m, k, 3)
        Per mean of the process over each block, along three axes.
    span : float
        Of a block [s].

    Notes
    -----
    With a = span/time the mean over a block has ``2 (a - 1 + exp(-a))/a^2`` of the variance, and
    two that are n apart covary by ``((1 - exp(-a))/a)^2 exp(-(n - 1) a)``. The double sum over
    blocks is a product of spectra, of rows with as many zeros behind them.
    """
    m, k, _ = gain.shape
    size = 2 << (m - 1).bit_length()  # a power of two, 2 m at least
    covariances = np.zeros(size)
    for one in processes:
        a = span / one.time
        decayed = -np.expm1(-a)
        far = one.sigma**2 * (decayed / a) ** 2 * np.exp(-a * np.arange(m - 1))
        covariances[0] += one.sigma**2 * 2 * (a - decayed) / a**2
        covariances[1:m] += far
        covariances[size - m + 1 :] += far[::-1]
    density = np.fft.rfft(covariances).real
    density[1:-1] *= 2  # of both signs of frequency
    rows = np.fft.rfft(np.ascontiguousarray(gain.transpose(1, 2, 0)), size)
    weighed = rows * density
    # real and imaginary parts side by side: the real part of a product with the conjugate
    return weighed.reshape(k, -1).view(float) @ rows.reshape(k, -1).view(float).T / size


@dataclass(frozen=True, slots=True)
class Span:
    """A stretch's time: `start`, `length` [s]; `rate` [rad/s] and `angle` [rad] at its start.

    `rate` 0 is rest; else `length` is whole turns.
    """

    start: float
    length: float
    rate: float = 0.0
    angle: float = 0.0

    @property
    def orders(self) -> Array:
        """Of the harmonics that tell it."""
        return np.array([0.0, 1.0, -1.0]) if self.rate else np.zeros(1)

    @property
    def to_coefficients(self) -> np.ndarray:
        """Takes integrals by order to constant, cosine and sine; (3, 3) or (1, 1)."""
        n = len(self.orders)
        return _TO_REAL[:n, :n] * np.exp(1j * self.orders * self.angle) / self.length


def ramp_coefficients(span: Span) -> Array:
    """Constant, cosine and sine (1,) or (3,) [s] of time itself."""
    moments = [_moment(span, k) + span.start * span.length * (k == 0) for k in span.orders]
    return np.real(span.to_coefficients @ np.array(moments))


def gauss_markov(spans: Sequence[Span], time: float) -> Array:
    """Covariance (h, h) of all coefficients, of a Gauss-Markov process of variance one."""
    a = 1 / time

    def within(span: Span) -> np.ndarray:
        k = 1j * span.orders[:, None] * span.rate
        m = k.T
        decayed = -np.expm1(-a * span.length)
        same = (k == m) * 2 * a * span.length / (a**2 - m**2)
        return same - decayed * (1 / ((a - m) * (a - k)) + 1 / ((a + m) * (a + k)))

    ends = [-np.expm1(-a * s.length) / (a + 1j * s.orders * s.rate) for s in spans]
    begins = [-np.expm1(-a * s.length) / (a - 1j * s.orders * s.rate) for s in spans]
    starts = _by_order(spans, [s.start for s in spans])
    stops = _by_order(spans, [s.start + s.length for s in spans])
    gaps = np.where(starts[:, None] < starts[None, :], starts[None, :] - stops[:, None], np.inf)
    pairs = np.concatenate(ends)[:, None] * np.concatenate(begins)[None, :] * np.exp(-a * gaps)
    return _assembled(spans, within, pairs)


def random_walk(spans: Sequence[Span]) -> Array:
    """Covariance (h, h) of a walk that starts from zero at time 0, one per root second."""

    def within(span: Span) -> np.ndarray:
        T, k = span.length, span.orders
        level = T * (k == 0)
        result = span.start * level[:, None] * level[None, :] + 0j
        # the walk from the start on: each step dB(u) counts by g(u), the integral from u to T
        result[0, 0] += T**3 / 3
        if span.rate:
            r = span.rate
            cross = (T**2 / 2 - 1j * T / r) / (1j * r)
            result[0, 1:] += np.conj([cross, np.conj(cross)])
            result[1:, 0] += [cross, np.conj(cross)]
            result[1:, 1:] += np.array([[2.0, -1.0], [-1.0, 2.0]]) * T / r**2
        return result

    early = [_moment(s, k) + s.start * s.length * (k == 0) for s in spans for k in s.orders]
    late = np.concatenate([s.length * (s.orders == 0) for s in spans])
    starts = _by_order(spans, [s.start for s in spans])
    before = starts[:, None] < starts[None, :]
    return _assembled(spans, within, before * np.array(early)[:, None] * late[None, :])


def walked(priors: Priors, spans: Sequence[Span]) -> Array:
    """Covariance (2, n, n) of means of gyro and accelerometer biases over rests, by walks and
    ramps since time 0 of the spans."""
    p, n = priors, len(spans)
    if not _walks(p):
        return np.zeros((2, n, n))
    times = np.concatenate([ramp_coefficients(span) for span in spans])
    sizes = np.array([(p.gyro_random_walk, p.gyro_ramp), (p.accel_random_walk, p.accel_ramp)])
    return np.einsum("sp,pij->sij", sizes**2, [random_walk(spans), np.outer(times, times)])


def _moment(span: Span, order: float) -> complex:
    """Integral of ``t exp(i order r t)`` over the stretch, t from its start."""
    return span.length**2 / 2 if order == 0 else span.length / (1j * order * span.rate)


def _by_order(spans: Sequence[Span], values: Sequence[float]) -> Array:
    """Values of the spans, once for each of their harmonics."""
    return np.repeat(np.asarray(values, dtype=float), [len(s.orders) for s in spans])


def _assembled(
    spans: Sequence[Span], within: Callable[[Span], np.ndarray], pairs: np.ndarray
) -> Array:
    """Covariances as real coefficients, of what `within` and `pairs` say of integrals x.

    `within(span)` holds E[x_k conj(x_m)] of one, `pairs` (h, h) E[x_k x_m] of an earlier one's and
    a later one's, 0 elsewhere.
    """
    edges = np.concatenate([[0], np.cumsum([len(s.orders) for s in spans])])
    slices = [slice(a, b) for a, b in pairwise(edges.tolist())]
    matrices = [span.to_coefficients for span in spans]
    left = np.concatenate([M @ pairs[own] for M, own in zip(matrices, slices, strict=True)])
    upper = [left[:, own] @ M.T for M, own in zip(matrices, slices, strict=True)]
    C: Array = np.real(np.concatenate(upper, axis=1))
    C = C + C.T
    for span, M, own in zip(spans, matrices, slices, strict=True):
        C[own, own] = np.real(M @ within(span) @ M.conj().T)
    return C
