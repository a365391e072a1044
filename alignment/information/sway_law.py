"""[S1]'s law of the azimuth error of two gyros on a rocking base, formula by formula.

Gyro 1 lies along X1, gyro 2 in the platform's plane, `theta` clockwise of it (90 deg: along Z1).
Both feel the Earth rate alone: the sway's own rate, which the paper leaves out, is no part of the
law (see `stand compare --published`). Angles in radians; `beta` and `gamma` are how far Z1 and X1
are raised. Source: [S1], methods.md section 3.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from alignment.arrays import Array
from alignment.errors import AlignmentError
from alignment.methods.two_gyro import Sway, azimuth_as_published

LEAST_ANGLE = np.radians(5.0)  # between the planes: nearer to parallel they show one component


def across(f1: ArrayLike, f2: ArrayLike, theta: float) -> Array:
    """Rate across gyro 1, ``(f2 - f1 cos theta) / sin theta``: what a gyro along Z1 would read.

    Raises
    ------
    AlignmentError
        The planes are within 5 deg of parallel.
    """
    if abs(np.sin(theta)) < np.sin(LEAST_ANGLE):
        raise AlignmentError(
            f"angle between the gyros' planes: {np.degrees(theta):.4g} deg, must be "
            f"{np.degrees(LEAST_ANGLE):.0f} to {180 - np.degrees(LEAST_ANGLE):.0f}"
        )
    return np.asarray((np.asarray(f2) - np.asarray(f1) * np.cos(theta)) / np.sin(theta))


def azimuth_between_planes(
    f1: ArrayLike, f2: ArrayLike, beta: ArrayLike, gamma: ArrayLike, latitude: float, theta: float
) -> Array:
    """[S1] (1): ``alpha = -atan((f2/f1 - cos theta)/sin theta) + atan(B/A)``, clockwise.

    Rebuilt from ``f1 = k cos alpha, f2 = k cos(alpha + theta)``. With theta = 90 deg it is (2),
    `azimuth_as_published`. Exact where X1 points north, whatever the tilts; elsewhere off by
    tan(lat) times the tilts.
    """
    return azimuth_as_published(f1, across(f1, f2, theta), beta, gamma, latitude)


def noise_gain(alpha: ArrayLike, theta: float) -> Array:
    """Azimuth error per relative rate error ``dw/(W cos lat)`` of either gyro, root of squares.

    ``sqrt(cos^2 alpha + cos^2(alpha + theta)) / sin theta``: 1 at any azimuth for 90 deg.
    """
    both = np.cos(alpha) ** 2 + np.cos(np.asarray(alpha) + theta) ** 2
    return np.asarray(np.sqrt(both) / abs(np.sin(theta)))


def plane_error_gain(alpha: ArrayLike, theta: float) -> Array:
    """Azimuth error per error of theta: ``-cos alpha sin(alpha + theta)/sin theta``."""
    return np.asarray(-np.cos(alpha) * np.sin(np.asarray(alpha) + theta) / np.sin(theta))


def tilts_of_second(beta: ArrayLike, gamma: ArrayLike) -> tuple[Array, Array]:
    """[S1] (3): the tilt of one gyro about its own axis is the other's out of the horizon.

    ``bet2 = gam1, gam2 = bet1``: rolling about X1 raises Z1, and the other way round.
    """
    return np.asarray(gamma), np.asarray(beta)


# --- the expansion about the mean tilts -----------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Expansion:
    """[S1] (5)-(11): A and B at the mean tilts, and their slopes there.

    ``A = sin lat cos bet sin gam + cos lat cos gam``, ``B = sin lat sin bet``; with
    ``bet = bet0 + xi``, ``gam = gam0 + eta`` (4): ``A = A* + z1``, ``B = B* + z2``,
    ``z1 = A_beta xi + A_gamma eta``, ``z2 = B_beta xi`` to first order.
    """

    A: float
    B: float
    A_beta: float
    A_gamma: float
    B_beta: float

    @property
    def slopes(self) -> Array:
        """Of ``atan(B/A)`` by beta and gamma (2,): ``(A* dB - B* dA) / (A*^2 + B*^2)``."""
        across = np.array([self.A * self.B_beta - self.B * self.A_beta, -self.B * self.A_gamma])
        return across / (self.A**2 + self.B**2)


def expansion(beta: float, gamma: float, latitude: float) -> Expansion:
    """[S1] (5)-(8) at mean tilts."""
    s, c = np.sin(latitude), np.cos(latitude)
    return Expansion(
        A=float(s * np.cos(beta) * np.sin(gamma) + c * np.cos(gamma)),
        B=float(s * np.sin(beta)),
        A_beta=float(-s * np.sin(beta) * np.sin(gamma)),
        A_gamma=float(s * np.cos(beta) * np.cos(gamma) - c * np.sin(gamma)),
        B_beta=float(s * np.cos(beta)),
    )


def azimuth_error(
    beta: float, gamma: float, xi: ArrayLike, eta: ArrayLike, latitude: float
) -> Array:
    """[S1] (9)-(11): azimuth error [rad] of a sample read with the mean tilts, to first order."""
    by_beta, by_gamma = expansion(beta, gamma, latitude).slopes
    return np.asarray(by_beta * np.asarray(xi) + by_gamma * np.asarray(eta))


def rms_error(sway: Sway, latitude: float) -> float:
    """[S1] (12)-(13): ``delta = sqrt(E |alpha - alpha*|^2)`` [rad], to first order.

    ``(A*^2 D z2 + B*^2 D z1 - 2 A* B* cov(z1, z2)) / (A*^2 + B*^2)^2`` under the root. (14),
    `alignment.methods.two_gyro.sway_bound`, is its bound by Cauchy and Bunyakovsky.
    """
    slopes = expansion(sway.beta, sway.gamma, latitude).slopes
    D = np.array([[sway.variance_beta, sway.covariance], [sway.covariance, sway.variance_gamma]])
    return float(np.sqrt(slopes @ D @ slopes))


def level_bound(latitude: float, variance_beta: float) -> float:
    """[S1] (15), near level: ``delta <= tan lat sqrt(D xi)`` [rad]."""
    return float(abs(np.tan(latitude)) * np.sqrt(variance_beta))


# --- a known distribution -------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class Distribution:
    """A sway's distribution about zero: `variance`, and quadrature that is exact for it.

    `nodes` (n,) and `weights` (n,), in sum 1: an expectation is the weighted sum.
    """

    name: str
    variance: float
    nodes: Array
    weights: Array


_NODES = 24  # exact for polynomials to degree 47


def normal(sigma: float) -> Distribution:
    """Gaussian sway of standard deviation `sigma`."""
    x, w = np.polynomial.hermite_e.hermegauss(_NODES)
    return Distribution("normal", sigma**2, sigma * x, w / w.sum())


def uniform(half: float) -> Distribution:
    """Even between ``-half`` and ``half``: variance ``half^2/3``."""
    x, w = np.polynomial.legendre.leggauss(_NODES)
    return Distribution("uniform", half**2 / 3, half * x, w / 2)


def sine(amplitude: float) -> Distribution:
    """A sine seen at any phase: variance ``amplitude^2/2``."""
    x, w = np.polynomial.chebyshev.chebgauss(_NODES)
    return Distribution("sine", amplitude**2 / 2, amplitude * x, w / np.pi)


DISTRIBUTIONS: dict[str, Callable[[float], Distribution]] = {
    "normal": normal,
    "uniform": uniform,
    "sine": sine,
}


def known_sway(beta: float, gamma: float, xi: Distribution, eta: Distribution) -> Sway:
    """[S1], known distribution: what (16) estimates from samples, in closed form."""
    return Sway(
        beta=beta,
        gamma=gamma,
        variance_beta=xi.variance,
        variance_gamma=eta.variance,
        covariance=0.0,
    )


def exact_rms(
    beta: float, gamma: float, xi: Distribution, eta: Distribution, latitude: float
) -> float:
    """``sqrt(E |alpha - alpha*|^2)`` [rad] of independent sways, no order left out.

    By quadrature of ``atan(B/A) - atan(B*/A*)``; (13) is its first order, the remainder is of the
    second order of the sway, relatively.
    """
    X, Y = np.meshgrid(xi.nodes, eta.nodes, indexing="ij")
    s, c = np.sin(latitude), np.cos(latitude)

    def sigma(b: ArrayLike, g: ArrayLike) -> Array:
        return np.arctan2(s * np.sin(b), s * np.cos(b) * np.sin(g) + c * np.cos(g))

    off = sigma(beta + X, gamma + Y) - sigma(beta, gamma)
    return float(np.sqrt(xi.weights @ off**2 @ eta.weights))
