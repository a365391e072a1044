"""The bandwidth of a sensor: a second-order Butterworth low-pass of continuous signals.

The filter acts on the truth and on the white noise as they are in continuous time; what it puts
out is averaged over each sample interval, or taken at its end. ``w0`` is 2 pi times the frequency
at which the amplitude is 1/sqrt 2, and

``H(s) = w0^2 / (s^2 + sqrt2 w0 s + w0^2) = r / (s - l) + r* / (s - l*)``, ``l = w0 exp(3 pi i/4)``.

Slow signals come late by ``sqrt2 / w0 = 0.2251 / bandwidth`` seconds. Everything below counts time
in sample intervals: ``l`` is `_pole`, a number.
"""

from dataclasses import dataclass
from functools import cache
from math import ceil, factorial, log2, pi, sqrt

import numpy as np

from alignment.arrays import Array
from alignment.fixed_order import exponential, product
from stand.imu.recursion import Recursion
from stand.samples import Sampling

LAG = sqrt(2) / (2 * pi)  # s, times 1 / bandwidth [Hz]: by how much slow signals come late
_G = (-1 + 1j) / 2  # r / l, whatever the bandwidth
_FORGOTTEN = 64.0  # exp(-64) is 1.6e-28
_SERIES = 20  # terms of the phi functions below |l| = 1: 1 / 20! is 4e-19
_ROUNDS = 40  # of the noise's gain: each takes its errors to 0.19 at most (0.4306 squared)


def noise_variance(bandwidth: float, rate_hz: float, sampling: Sampling = Sampling.MEAN) -> float:
    """Variance of one sample of filtered white noise, in units of density squared times the rate.

    Notes
    -----
    ``R(t) = N^2 w0/(2 sqrt2) exp(-a) (cos a + sin a)``, ``a = w0 |t|/sqrt2``, is the covariance of
    the filtered noise of density N. An instant has R(0) of it. A mean over dt has, with a at dt,

    ``N^2/dt (1 - (1 - exp(-a) (cos a - sin a)) / (2 a))``:

    262 Hz at 200 Hz is a = 5.820, so ``1 - (1 - 0.00297 (0.8946 + 0.4468)) / 11.64 = 0.914``.
    """
    if not np.isfinite(bandwidth):
        return 1.0
    pole = _pole(bandwidth, rate_hz)
    if sampling is Sampling.INSTANT:
        return abs(pole) / sqrt(8)
    return float(1 - (np.expm1(pole) / pole).real)


def slow_variance(bandwidth: float, rate_hz: float, sampling: Sampling = Sampling.MEAN) -> float:
    """Density of the samples' noise at low frequency, in units of the density squared: what a mean
    of many samples has, times how long it takes.

    Notes
    -----
    Means that follow one another are the mean over all: one. Instants miss what is between them,
    and what is above half of their rate comes down: ``dt sum_k R(k dt)`` with R of
    `noise_variance`, ``w0 dt/(2 sqrt2) Re((1 - i) coth((1 - i) a/2))``, a at dt. 262 Hz at 20 Hz is
    a = 58.2: 29.1. Without a filter there is nothing but the samples' own noise: one.
    """
    if sampling is Sampling.MEAN or not np.isfinite(bandwidth):
        return 1.0
    pole = _pole(bandwidth, rate_hz)  # a (-1 + i)
    return abs(pole) / sqrt(8) * float(((1 - 1j) / np.tanh(-pole / 2)).real)


def _pole(bandwidth: float, rate_hz: float) -> complex:
    return complex(2 * pi * bandwidth / rate_hz * (-1 + 1j) / sqrt(2))


def remembered(bandwidth: float, rate_hz: float, sampling: Sampling = Sampling.MEAN) -> int:
    """Samples after which nothing is left of what the filter was fed before, to the last bit.

    What it remembers falls by ``exp(-w0 dt/sqrt2)`` from sample to sample: to 1e-28 of what was
    changed, which no sum with a noise above it shows. Before that stand those that it keeps: of
    means whose ends are known the last end, of instants three.
    """
    if not np.isfinite(bandwidth):
        return 0
    kept = 1 if sampling is Sampling.MEAN else 3
    return ceil(-_FORGOTTEN / _pole(bandwidth, rate_hz).real) + kept


class LowPass:
    """The filter of three channels at work; (3, n) arrays.

    Parameters
    ----------
    bandwidth : float
        Frequency at which the amplitude is 1/sqrt 2 [Hz].
    rate_hz : float
    sampling : Sampling
    sigma : float
        Of the white noise, as a mean over a sample would have it without a filter: density times
        the root of the rate.
    start : (3, 2) or None
        Standard normal numbers: where the filtered noise begins. None: at nothing.

    Attributes
    ----------
    state : (3, 6)
        All that is remembered, to be kept and set: two numbers of the filter, the input at the
        last sample's end, and the last three samples; the last four NaN before the first sample.

    Notes
    -----
    Over each sample the input is the parabola through its mean and its values at both ends: of a
    sine it is wrong by (w dt)^4/500 at most. What is not given is worked out of samples before: the
    end ``(11 u_k - 7 u_(k-1) + 2 u_(k-2)) / 6`` of means, the mean of instants by Adams' and
    Moulton's rule of order four. The filter's answer to a parabola is closed; at rest it is the
    input itself, to the bit. It starts as if the first input had been for ever.

    The filtered noise is told by its innovations (`innovations`): one number per sample, which
    without a filter would have been its noise, makes the same process as continuous noise does.
    One complex state has both, signal and noise.
    """

    def __init__(
        self,
        bandwidth: float,
        rate_hz: float,
        sampling: Sampling = Sampling.MEAN,
        sigma: float = 0.0,
        start: Array | None = None,
    ) -> None:
        self._means = sampling is Sampling.MEAN
        pole = _pole(bandwidth, rate_hz)
        phi = _phi(pole)
        # a parabola with slope (2t - 1) and bend (6t^2 - 6t + 1), t from 0 to 1: what the filter
        # lags behind it at the end, and on the mean
        at_end = _G * np.array([2 * phi[1], 12 * phi[2] - 6 * phi[1]])
        as_mean = _G * np.array([2 * phi[2], 12 * phi[3] - 6 * phi[2]])
        self._lagging = 2 * (as_mean if self._means else at_end).real
        seen = 2 * (phi[1] if self._means else phi[0])  # of what was before
        self._into = seen * at_end
        unit = noise_innovations(abs(pole), sampling)
        self._direct, self._kick = sigma * unit.direct, sigma * unit.kick
        before = np.zeros(3, complex)
        if start is not None:
            before = sigma * np.ascontiguousarray(product(start, unit.start)).view(complex)[:, 0]
        self._memory = Recursion(complex(phi[0]), before)
        self._last = np.full((3, 4), np.nan)

    @property
    def state(self) -> Array:
        """As told above."""
        parts = self._memory.state
        return np.column_stack([parts.real, parts.imag, self._last])

    @state.setter
    def state(self, state: Array) -> None:
        self._memory.state = state[:, 0] + 1j * state[:, 1]
        self._last = np.array(state[:, 2:])

    def apply(self, u: Array, other: Array | None = None, normals: Array | None = None) -> Array:
        """The next samples (3, n), filtered.

        Parameters
        ----------
        u : (3, n)
            Samples of the input.
        other : (3, n) or None
            Where it is known: of samples that are means the input at their ends; of instants its
            means up to them.
        normals : (3, n) or None
            Standard normal numbers for the noise.
        """
        means, b = self._completed(u, other)
        a = np.hstack([self._last[:, :1], b[:, :-1]])
        self._last[:, 0] = b[:, -1]
        slope, bend = (b - a) / 2, (a + b) / 2 - means
        parts: list[tuple[Array, float, complex]] = []
        parts += zip((slope, bend), self._lagging, self._into, strict=True)
        if normals is not None:
            parts.append((normals, self._direct, self._kick))
        y, drive = u.copy(), np.zeros((*u.shape, 2))
        for part, now, later in parts:
            y += now * part
            drive[..., 0] += later.real * part
            drive[..., 1] += later.imag * part
        y[:, 0] += self._memory.state.real
        y[:, 1:] += self._memory.apply(drive.view(complex)[..., 0])[:, :-1].real
        return y

    def _completed(self, u: Array, other: Array | None) -> tuple[Array, Array]:
        """Means over the intervals and values at their ends, (3, n) each."""
        if np.isnan(self._last[0, 0]):
            begin = u[:, 0]
            if other is not None:
                begin = 2 * begin - other[:, 0] if self._means else 2 * other[:, 0] - begin
            self._last[:] = np.column_stack([begin, u[:, 0], u[:, 0], u[:, 0]])
        past = np.hstack([self._last[:, 1:], u])
        self._last[:, 1:] = past[:, -3:]
        steps = np.diff(past)  # what rests is exact
        if other is not None:
            return (u, other) if self._means else (other, u)
        if not self._means:
            return u + (4 * steps[:, 1:-1] - 15 * steps[:, 2:] - steps[:, :-2]) / 24, u
        return u, u + (5 * steps[:, 2:] - 2 * steps[:, 1:-1]) / 6


def _phi(pole: complex) -> Array:
    """``phi_k = int_0^1 exp(l (1 - t)) t^(k-1)/(k-1)! dt`` for k = 1 to 3, phi_0 = exp(l)."""
    if abs(pole) < 1:
        powers = pole ** np.arange(_SERIES)
        return np.array([sum(p / factorial(j + k) for j, p in enumerate(powers)) for k in range(4)])
    phi = [np.exp(pole)]
    for k in range(3):
        phi.append((phi[k] - 1 / factorial(k)) / pole)
    return np.array(phi)


@dataclass(frozen=True, slots=True, eq=False)
class NoiseInnovations:
    """Filtered white noise of unit strength, of one number e_k per sample.

    ``y_k = Re x_(k-1) + direct e_k``, ``x_k = exp(l) x_(k-1) + kick e_k``; `start` (2, 2) takes two
    normal numbers to the parts of a stationary x_0.
    """

    direct: float
    kick: complex
    start: Array


@cache
def noise_innovations(w0: float, sampling: Sampling) -> NoiseInnovations:
    """The stationary Kalman filter of the samples: their innovations make the process anew.

    Notes
    -----
    State (y, y') and the integral of y over an interval come from Van Loan's exponential (IEEE
    Trans. Automat. Contr. 23, 1978) for a step of which w0 is a half at most, doubled as often as
    makes an interval: ``Q_2 = Q + F Q F^T``. In units of the step all numbers are of one size,
    however low or high the bandwidth. What is seen of the state is the mean or the instant, its
    noise correlated with the state's; the gain is that of the settled Riccati recursion.
    """
    doublings = max(0, ceil(log2(2 * w0)))
    step = w0 / 2**doublings
    F, Q = _over_a_step(step)
    for _ in range(doublings):
        Q = Q + product(F, Q, F.T)
        F = product(F, F)
    row = 2 if sampling is Sampling.MEAN else 0
    A, h = F[:2, :2], F[row, :2]
    P, size, gain = Q[:2, :2], 0.0, np.zeros(2)
    for _ in range(_ROUNDS):
        size = float(product(h, P, h) + Q[row, row])
        gain = (product(A, P, h) + Q[:2, row]) / size
        P = product(A, P, A.T) + Q[:2, :2] - size * np.outer(gain, gain)
    pole = step * (-1 + 1j) / sqrt(2)
    own = (gain[1] - pole.conjugate() * gain[0]) / (2j * pole.imag)
    # from units of the step: of noise, of the filter's output, of a mean over several steps
    unit = step**2 * 2 ** (doublings / 2) * np.sqrt(size)
    whole = pole * 2**doublings
    phi = _phi(whole)
    kick = complex(2 * (phi[1] if row else phi[0]) * own * unit)
    direct = unit / 2**doublings if row else unit
    return NoiseInnovations(float(direct), kick, _stationary(kick, whole))


def _over_a_step(w0: float) -> tuple[Array, Array]:
    """Transition and noise (3, 3) of (y, y', integral of y) over w0^2, in a time of one."""
    flow = np.array([[0, 1, 0], [-(w0**2), -sqrt(2) * w0, 0], [1, 0, 0]])
    drive = np.zeros((3, 3))
    drive[1, 1] = 1.0
    both = exponential(np.block([[-flow, drive], [np.zeros((3, 3)), flow.T]]))
    F = both[3:, 3:].T
    Q = product(F, both[:3, 3:])
    return F, (Q + Q.T) / 2


def _stationary(kick: complex, pole: complex) -> Array:
    """Takes two normal numbers (rows) to real and imaginary part of the settled state."""
    size = abs(kick) ** 2 / -np.expm1(2 * pole.real)
    turned = kick**2 / -np.expm1(2 * pole)
    real, both, imag = (size + turned.real) / 2, turned.imag / 2, (size - turned.real) / 2
    root = np.zeros((2, 2))
    if real > 0:
        root[0] = np.array([real, both]) / np.sqrt(real)
        root[1, 1] = np.sqrt(max(imag - both**2 / real, 0.0))
    return root
