"""Exact readings of an instrument that rocks, sways and turns at a site: an independent oracle.

Attitude is a chain of turns about n's and then b's axes whose angles are sums of closed forms;
rates and accelerations follow by the product rule, and each sample is the mean over its interval
by Gauss-Legendre quadrature of five points (truncation below 1e-12 for what is used here).
"""

from dataclasses import dataclass, field

import numpy as np

W = 7.292115e-5  # rad/s
G = 9.81
LEVEL = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])  # columns X1 north, Y1 up, Z1 east


@dataclass(frozen=True)
class Angle:
    """``start + rate t + amplitude sin(2 pi f t + phase)`` and smooth moves (at, over, by)."""

    start: float = 0.0
    rate: float = 0.0
    amplitude: float = 0.0
    frequency: float = 0.2
    phase: float = 0.0
    moves: tuple[tuple[float, float, float], ...] = ()

    def __call__(self, t):
        """Value, first and second derivative at times (n,)."""
        w = 2 * np.pi * self.frequency
        s, c = np.sin(w * t + self.phase), np.cos(w * t + self.phase)
        value = self.start + self.rate * t + self.amplitude * s
        first = self.rate + self.amplitude * w * c
        second = -self.amplitude * w * w * s
        for at, over, by in self.moves:  # the quintic with zero rate and acceleration at its ends
            x = np.clip((t - at) / over, 0, 1)
            value = value + by * x**3 * (10 - 15 * x + 6 * x * x)
            first = first + by / over * 30 * x**2 * (1 - x) ** 2
            second = second + by / over**2 * 60 * x * (1 - x) * (1 - 2 * x)
        return value, first, second


STILL = Angle()


@dataclass(frozen=True)
class Motion:
    """``C_nb = turn_D(yaw) turn_E(pitch) turn_N(roll) LEVEL``; `lever` (3,) in b [m] from the
    point about which it turns; `sway` (N, E, D) of that point [m]."""

    yaw: Angle = STILL
    pitch: Angle = STILL
    roll: Angle = STILL
    lever: tuple[float, float, float] = (0.0, 0.0, 0.0)
    sway: tuple[Angle, Angle, Angle] = (STILL, STILL, STILL)
    latitude_deg: float = 48.5
    axes: tuple = field(default=(np.eye(3)[2], np.eye(3)[1], np.eye(3)[0]), repr=False)

    def state(self, t):
        """``C_nb`` (n, 3, 3), ``w_ib_b`` and ``f_b`` (n, 3) at times (n,)."""
        n = len(t)
        C = np.broadcast_to(np.eye(3), (n, 3, 3))
        w, dw = np.zeros((n, 3)), np.zeros((n, 3))
        for axis, angle in zip(self.axes, (self.yaw, self.pitch, self.roll), strict=True):
            a, da, dda = angle(t)
            along = C @ axis
            dw = dw + dda[:, None] * along + da[:, None] * np.cross(w, along)
            w = w + da[:, None] * along
            C = C @ turn(axis, a)
        C = C @ LEVEL
        r = C @ np.array(self.lever)
        sway = np.array([angle(t) for angle in self.sway])  # (axis, derivative, n)
        velocity = np.cross(w, r) + sway[:, 1].T
        acceleration = np.cross(dw, r) + np.cross(w, np.cross(w, r)) + sway[:, 2].T
        earth = earth_n(self.latitude_deg)
        force = acceleration + 2 * np.cross(earth, velocity) - [0, 0, G]
        return C, np.einsum("nji,nj->ni", C, w + earth), np.einsum("nji,nj->ni", C, force)

    def readings(self, seconds, rate, start=0.0):
        """Stamps (n,), mean rates and specific forces (n, 3), and ``C_nb`` at the end."""
        n = round(seconds * rate)
        t = start + np.arange(1, n + 1) / rate
        nodes, weights = np.polynomial.legendre.leggauss(5)
        w, f = np.zeros((n, 3)), np.zeros((n, 3))
        for x, g in zip(nodes, weights, strict=True):
            _, rates, forces = self.state(t - (1 - x) / 2 / rate - start)
            w += g / 2 * rates
            f += g / 2 * forces
        C, _, _ = self.state(np.array([n / rate]))
        return t, w, f, C[0]


def earth_n(latitude_deg):
    lat = np.radians(latitude_deg)
    return W * np.array([np.cos(lat), 0.0, -np.sin(lat)])


def turn(axis, angle):
    """Rodrigues' formula; `angle` (n,) gives (n, 3, 3)."""
    x, y, z = axis
    K = np.array([[0.0, -z, y], [z, 0, -x], [-y, x, 0]])
    s, c = np.sin(angle)[:, None, None], np.cos(angle)[:, None, None]
    return np.eye(3) + s * K + (1 - c) * (K @ K)


def noisy(rng, w, f, rate, runs, gyro=0.0, accel=0.0, biases=None):
    """Rates and forces (runs, n, 3) with white noise per root hertz and `biases` (runs, 6)."""
    biases = np.zeros((runs, 6)) if biases is None else biases
    shape = (runs, *w.shape)
    return (
        w + biases[:, None, :3] + gyro * np.sqrt(rate) * rng.normal(size=shape),
        f + biases[:, None, 3:] + accel * np.sqrt(rate) * rng.normal(size=shape),
    )


def errors(estimated, C):
    """Small rotations about n (k, 3) [rad] that take truth (3, 3) to estimates (k, 3, 3)."""
    D = estimated @ C.T
    return 0.5 * np.stack(
        [D[:, 2, 1] - D[:, 1, 2], D[:, 0, 2] - D[:, 2, 0], D[:, 1, 0] - D[:, 0, 1]], axis=1
    )
