"""Earth rate and WGS 84 normal gravity.

Numbers to check by hand: at the pole the down component of Earth rate is -7.292115e-5 rad/s;
normal gravity on the ellipsoid is 9.7803253 m/s^2 at the equator and 9.8321849 at the poles.
"""

from dataclasses import dataclass
from math import cos, isfinite, pi, sin, sqrt

import numpy as np
from scipy.spatial.transform import Rotation

from alignment.arrays import Array
from alignment.cross import cross_matrix
from alignment.errors import AlignmentError, PoleError
from alignment.fixed_order import norm

EARTH_RATE = 7.292115e-5  # rad/s, WGS 84

# WGS 84 (NIMA TR8350.2, table 3.1-3.4)
_SEMI_MAJOR = 6378137.0  # m
_FLATTENING = 1 / 298.257223563
_ECCENTRICITY_2 = _FLATTENING * (2 - _FLATTENING)
_GM = 3.986004418e14  # m^3/s^2
_GRAVITY_EQUATOR = 9.7803253359  # m/s^2
_SOMIGLIANA_K = 0.00193185265241
_LARGEST_DEFLECTION = 0.01  # rad; the largest on Earth are some 100 arc seconds, 5e-4


def normal_gravity(latitude: float, height: float = 0.0) -> float:
    """WGS 84 normal gravity [m/s^2], the centrifugal term included.

    Parameters
    ----------
    latitude : float
        Geodetic [rad].
    height : float
        Above the ellipsoid [m].

    Notes
    -----
    Somigliana's closed form on the ellipsoid, continued upward to second order in height:
    NIMA TR8350.2 (2000), equations 4-1 and 4-3. The truncation is below 5e-7 m/s^2 for heights
    below 5 km and 1e-7 below 1 km.
    """
    s2 = sin(latitude) ** 2
    on_ellipsoid = _GRAVITY_EQUATOR * (1 + _SOMIGLIANA_K * s2) / sqrt(1 - _ECCENTRICITY_2 * s2)
    semi_minor = _SEMI_MAJOR * (1 - _FLATTENING)
    m = EARTH_RATE**2 * _SEMI_MAJOR**2 * semi_minor / _GM
    linear = 2 * (1 + _FLATTENING + m - 2 * _FLATTENING * s2) * height / _SEMI_MAJOR
    return on_ellipsoid * (1 - linear + 3 * (height / _SEMI_MAJOR) ** 2)


def earth_rate_n(latitude: float) -> Array:
    """Earth rate in NED [rad/s], shape (3,): ``W (cos lat, 0, -sin lat)``."""
    return EARTH_RATE * np.array([cos(latitude), 0.0, -sin(latitude)])


@dataclass(frozen=True, slots=True)
class Site:
    """Where the stand (or the unit that made a log) is.

    Attributes
    ----------
    latitude : float or None
        Geodetic [rad]; None where it is not known, which some methods do not mind.
    height : float
        Above the ellipsoid [m].
    local_gravity : float or None
        Measured gravity [m/s^2]; None for WGS 84 normal gravity.
    longitude : float
        Geodetic [rad], east positive; for the record, no estimate depends on it.
    deflection : (float, float)
        Of the vertical [rad]: how far the plumb line's zenith leans north (xi) and east (eta) of
        the ellipsoid's normal. Astronomical latitude is ``latitude + xi``.
    """

    latitude: float | None
    height: float = 0.0
    local_gravity: float | None = None
    longitude: float = 0.0
    deflection: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        if self.latitude is not None and not abs(self.latitude) <= pi / 2:
            raise ValueError(f"latitude: {self.latitude} rad, must be within -pi/2 to pi/2")
        if not isfinite(self.height):
            raise ValueError(f"height: {self.height} m, must be finite")
        if self.local_gravity is not None and not 9.0 < self.local_gravity < 10.5:
            raise ValueError(
                f"local_gravity: {self.local_gravity} m/s^2, must be between 9 and 10.5"
            )

        if not all(abs(angle) <= _LARGEST_DEFLECTION for angle in self.deflection):
            raise ValueError(f"deflection: {self.deflection} rad, must be below 0.01 each")

    def known_latitude(self) -> float:
        """The latitude [rad]; `AlignmentError` where nobody gave it."""
        if self.latitude is None:
            raise AlignmentError("latitude: not known, but this method needs it")
        return self.latitude

    @property
    def gravity(self) -> float:
        """Magnitude of gravity [m/s^2]."""
        if self.local_gravity is not None:
            return self.local_gravity
        return normal_gravity(self.known_latitude(), self.height)

    @property
    def w_ie_n(self) -> Array:
        """Earth rate in NED [rad/s], (3,)."""
        return earth_rate_n(self.known_latitude())

    @property
    def f_n(self) -> Array:
        """Specific force at rest in NED [m/s^2], (3,): gravity's reaction, along the plumb line."""
        up = np.array([*self.deflection, -1.0])
        return self.gravity * up / norm(up)

    @property
    def plumb(self) -> Rotation:
        """Takes the frame of the plumb line and the Earth's axis to n: none without deflection.

        Levelling finds the plumb line's vertical and gyros the north seen from it (astronomical);
        n is that of the ellipsoid.
        """
        if self.latitude is None or not any(self.deflection):
            return Rotation.identity()
        up = self.f_n / norm(self.f_n)
        east = np.cross(self.w_ie_n, up)
        east /= norm(east)
        return Rotation.from_matrix(np.stack([np.cross(up, east), east, -up], axis=1))

    def about_n(self, covariance: Array) -> Array:
        """Covariances (..., 3, 3) about n of attitudes that have them about the plumb line's frame.

        See `leaning` for what a heading that is not sure does to tilt.
        """
        if not any(self.deflection):
            return covariance
        less, beyond = self.leaning(covariance[..., 2, 2])
        C = less @ self.plumb.as_matrix()
        return np.asarray(C @ covariance @ np.swapaxes(C, -1, -2) + beyond)

    def leaning(self, variance: Array) -> tuple[Array, Array]:
        """What headings of a `variance` (...) [rad^2] do to covariances about n of first order:
        a turn of these and an addition to them, (..., 3, 3).

        Where heading is not sure, it is not known which way the plumb line leans by d: an error h
        of heading tilts by ``d sin h`` across that way, of a mean square of
        ``(1 - exp(-2 s^2)) / 2`` if h is normal where first order has s^2, and by
        ``d (1 - cos h)`` along it, of ``3/2 - 2 exp(-s^2/2) + exp(-2 s^2)/2``.
        """
        s2 = np.asarray(variance)
        d = self.plumb.as_rotvec() * [1.0, 1.0, 0.0]
        across = np.sqrt(-np.expm1(-2 * s2) / np.maximum(2 * s2, 1e-30))
        across = np.where(s2 > 0, across, 1.0)
        along = 1.5 - 2 * np.exp(-s2 / 2) + np.exp(-2 * s2) / 2
        less = np.eye(3) + (across[..., None, None] - 1) * cross_matrix(d)
        return less, np.asarray(along[..., None, None] * np.outer(d, d))

    def horizontal_rate(self) -> float:
        """Horizontal Earth rate [rad/s]; `PoleError` where it is too small to show north."""
        rate = EARTH_RATE * cos(self.known_latitude())
        if rate < 1e-3 * EARTH_RATE:
            raise PoleError(
                f"latitude {np.degrees(self.known_latitude()):.4f} deg: heading is undefined "
                "within 0.06 deg of a pole"
            )
        return rate
