"""The bandwidth of a sensor: a second-order Butterworth low-pass, exact between samples."""

import numpy as np
from scipy.linalg import expm

from alignment.arrays import Array
from stand.imu.recursion import Recursion


class LowPass:
    """Continuous filter on an input that is constant over each sample; gives interval means.

    Parameters
    ----------
    bandwidth : float
        Frequency at which the amplitude is 1/sqrt 2 [Hz].
    rate_hz : float

    Notes
    -----
    ``H(s) = w0^2 / (s^2 + sqrt2 w0 s + w0^2)``. Slow signals come late by
    ``sqrt2 / w0 = 0.2251 / bandwidth`` seconds. The state equations are integrated exactly over
    each sample, so a bandwidth above the sample rate is no trouble. The filter starts settled on
    its first input.
    """

    def __init__(self, bandwidth: float, rate_hz: float) -> None:
        w0, dt = 2 * np.pi * bandwidth, 1 / rate_hz
        # state: output, its derivative over w0, and the running integral of the output
        flow = np.array(
            [[0.0, w0, 0.0, 0.0], [-w0, -np.sqrt(2) * w0, 0.0, w0], [1 / dt, 0, 0, 0], [0, 0, 0, 0]]
        )
        step = expm(flow * dt)
        denominator, numerator = _transfer(step[:2, :2], step[:2, 3], step[2, :2], step[2, 3])
        self._recursion = Recursion(numerator, denominator)
        self._begun = False

    def apply(self, u: Array) -> Array:
        """The next samples (3, n), filtered."""
        if not self._begun:
            self._begun = True
            self._recursion.settle(u[:, 0], u[:, 0])
        return self._recursion.apply(u)


def _transfer(A: Array, B: Array, C: Array, D: float) -> tuple[Array, Array]:
    """Denominator and numerator (3,) of ``x' = A x + B u, y = C x + D u`` with two states."""
    trace, det = A[0, 0] + A[1, 1], A[0, 0] * A[1, 1] - A[0, 1] * A[1, 0]
    denominator = np.array([1.0, -trace, det])
    # y/u = D + C adj(zI - A) B / det(zI - A)
    first = C @ B
    adjoint = np.array([[A[1, 1], -A[0, 1]], [-A[1, 0], A[0, 0]]])
    second = -(C @ adjoint @ B)
    return denominator, D * denominator + np.array([0.0, first, second])
