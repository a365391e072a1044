"""A moving vehicle over the WGS 84 ellipsoid: places, gravity, and strapdown integrals.

Frames: e is the Earth's (ECEF, z along the axis, x through Greenwich); i does not turn and
coincides with e at a stated time; n is north-east-down where the vehicle is.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from alignment.arrays import Array, set_owned
from alignment.cross import cross_matrix
from alignment.earth import _ECCENTRICITY_2, _FLATTENING, _SEMI_MAJOR, EARTH_RATE, normal_gravity
from alignment.errors import AlignmentError
from alignment.noise import gap_doubt
from alignment.quaternions import multiply, normalised, prefix_product
from alignment.readings import EDGE, ImuReadings

W_IE_X = EARTH_RATE * np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 0]])  # w_ie x, in e and in i
_LEVEL = np.array([1.0, 1.0, 0.0])  # what lies across the Earth's axis
_gravity = np.vectorize(normal_gravity, otypes=[float])


def radii(latitude: ArrayLike) -> tuple[Array, Array]:
    """Radii of curvature [m] of the meridian and of the prime vertical at a latitude [rad]."""
    root = np.sqrt(1 - _ECCENTRICITY_2 * np.sin(latitude) ** 2)
    return _SEMI_MAJOR * (1 - _ECCENTRICITY_2) / root**3, _SEMI_MAJOR / root


def ecef(latitude: Array | float, longitude: Array | float, height: Array | float) -> Array:
    """Place (..., 3) in e [m] from geodetic latitude, longitude [rad] and height [m]."""
    _, prime = radii(latitude)
    level = (prime + height) * np.cos(latitude)
    z = (prime * (1 - _ECCENTRICITY_2) + height) * np.sin(latitude)
    return np.stack(
        np.broadcast_arrays(level * np.cos(longitude), level * np.sin(longitude), z), axis=-1
    )


def geodetic(r_e: ArrayLike) -> tuple[Array, Array, Array]:
    """Latitude, longitude [rad] and height [m] of places (..., 3) in e [m].

    Notes
    -----
    Bowring's formula (Survey Review 23, 1976) applied twice: below 1e-12 rad within 100 km of the
    ellipsoid. The height comes from the projection on the normal, regular at the poles too.
    """
    x, y, z = np.moveaxis(np.asarray(r_e, dtype=float), -1, 0)
    level = np.hypot(x, y)
    semi_minor = _SEMI_MAJOR * (1 - _FLATTENING)
    latitude = np.arctan2(z, level * (1 - _ECCENTRICITY_2))
    for _ in range(2):
        reduced = np.arctan2((1 - _FLATTENING) * np.sin(latitude), np.cos(latitude))
        latitude = np.arctan2(
            z + _ECCENTRICITY_2 / (1 - _ECCENTRICITY_2) * semi_minor * np.sin(reduced) ** 3,
            level - _ECCENTRICITY_2 * _SEMI_MAJOR * np.cos(reduced) ** 3,
        )
    s, c = np.sin(latitude), np.cos(latitude)
    height = level * c + z * s - _SEMI_MAJOR * np.sqrt(1 - _ECCENTRICITY_2 * s**2)
    return latitude, np.arctan2(y, x), height


def C_en(latitude: ArrayLike, longitude: ArrayLike) -> Array:
    """Matrices (..., 3, 3) that take n components to e: columns north, east, down."""
    s, c = np.sin(latitude), np.cos(latitude)
    sl, cl = np.sin(longitude), np.cos(longitude)
    matrix = np.empty((*np.shape(s), 3, 3))
    matrix[..., 0, 0], matrix[..., 0, 1], matrix[..., 0, 2] = -s * cl, -sl, -c * cl
    matrix[..., 1, 0], matrix[..., 1, 1], matrix[..., 1, 2] = -s * sl, cl, -c * sl
    matrix[..., 2, 0], matrix[..., 2, 1], matrix[..., 2, 2] = c, 0.0, -s
    return matrix


def gravity(latitude: ArrayLike, height: ArrayLike) -> Array:
    """WGS 84 normal gravity [m/s^2], as `alignment.earth.normal_gravity`, for arrays."""
    return _gravity(latitude, height)


def C_ie(elapsed: ArrayLike) -> Array:
    """Matrices (..., 3, 3) that take e to i, `elapsed` seconds after they coincided."""
    angle = EARTH_RATE * np.asarray(elapsed, dtype=float)
    matrix = np.zeros((*angle.shape, 3, 3))
    matrix[..., 0, 0] = matrix[..., 1, 1] = np.cos(angle)
    matrix[..., 1, 0] = np.sin(angle)
    matrix[..., 0, 1] = -matrix[..., 1, 0]
    matrix[..., 2, 2] = 1.0
    return matrix


def gravitation(r_i: Array, elapsed: ArrayLike) -> Array:
    """Gravitation (..., 3) [m/s^2] in i at places (..., 3) in i: gravity less the centrifugal part.

    Gravity points along the ellipsoid's inner normal; above it the plumb line of normal gravity
    bends by 8e-9 m/s^2 per metre of height, left out.
    """
    turn = C_ie(elapsed)
    r_e = np.einsum("...ji,...j->...i", turn, r_i)
    latitude, longitude, height = geodetic(r_e)
    down = C_en(latitude, longitude)[..., 2]
    g_e = down * gravity(latitude, height)[..., None] - EARTH_RATE**2 * r_e * _LEVEL
    return np.einsum("...ij,...j->...i", turn, g_e)


def attitude_in_n(C_ib: Array, r_i: Array, elapsed: ArrayLike) -> tuple[Array, Array]:
    """``C_nb`` and ``C_ni`` (..., 3, 3) of attitudes and places that are given in i."""
    turn = C_ie(elapsed)
    latitude, longitude, _ = geodetic(np.einsum("...ji,...j->...i", turn, r_i))
    C_ni = np.swapaxes(turn @ C_en(latitude, longitude), -1, -2)
    return C_ni @ C_ib, C_ni


@dataclass(frozen=True, slots=True, eq=False)
class Integrals:
    """What gyros and accelerometers integrate to, in the body axes b0 of a start.

    Over each stretch from its start to its end:

    Attributes
    ----------
    duration : (m,) s
    turn : (m, 3, 3)
        ``C_b0b``: takes body components at the end to b0.
    velocity, place : (m, 3)
        ``int C_b0b f dt`` [m/s] and its integral [m].
    turn_time, turn_time2 : (m, 3, 3)
        ``int C_b0b dt`` [s] and its integral [s^2]: how constant gyro errors add to the turn, and
        constant accelerometer errors to velocity and place.
    velocity_gyro, place_gyro : (m, 3, 3)
        Velocity [m] and place [m s] per constant gyro error [rad/s].
    """

    duration: Array
    turn: Array
    velocity: Array
    place: Array
    turn_time: Array
    turn_time2: Array
    velocity_gyro: Array
    place_gyro: Array

    def __post_init__(self) -> None:
        m = len(self.duration)
        shapes: dict[str, tuple[int, ...]] = dict.fromkeys(self.__slots__, (m, 3, 3))
        shapes |= {"duration": (m,), "velocity": (m, 3), "place": (m, 3)}
        set_owned(self, **{name: (getattr(self, name), s, float) for name, s in shapes.items()})

    def __len__(self) -> int:
        return len(self.duration)

    def at(self, k: np.ndarray) -> "Integrals":
        """Of some of the stretches."""
        return Integrals(**{name: getattr(self, name)[k] for name in self.__slots__})

    def since(self, first: np.ndarray, last: np.ndarray) -> "Integrals":
        """From the ends of stretches `first` to those of `last`, in b at the former."""
        T = self.duration[last] - self.duration[first]
        back = np.swapaxes(self.turn[first], 1, 2)
        start, dT = self.turn_time[first], T[:, None, None]
        velocity = self.velocity[last] - self.velocity[first]
        place = self.place[last] - self.place[first] - self.velocity[first] * T[:, None]
        velocity_gyro = self.velocity_gyro[last] - self.velocity_gyro[first]
        place_gyro = self.place_gyro[last] - self.place_gyro[first] - self.velocity_gyro[first] * dT
        return Integrals(
            T,
            back @ self.turn[last],
            np.einsum("mij,mj->mi", back, velocity),
            np.einsum("mij,mj->mi", back, place),
            turn_time=back @ (self.turn_time[last] - start),
            turn_time2=back @ (self.turn_time2[last] - self.turn_time2[first] - start * dT),
            velocity_gyro=back @ (velocity_gyro + cross_matrix(velocity) @ start),
            place_gyro=back @ (place_gyro + cross_matrix(place) @ start),
        )


def integrals(readings: ImuReadings, t: Array) -> Integrals:
    """Strapdown integrals from the first of the times `t` (m,) to each of them.

    Parameters
    ----------
    readings : ImuReadings
        Without gaps.
    t : (m,)
        Increasing [s], within the readings; a time within a sample takes its part of it.

    Raises
    ------
    AlignmentError
        Times outside the readings, or a gap in them.

    Notes
    -----
    Rate and force are constant in body axes within a sample. Leading error per sample of length
    h: coning ``(w x w') h^3 / 12`` and half the turn times force, ``|w h|^2 f h / 24``.
    """
    for gap in gap_doubt(readings):
        raise AlignmentError(f"{gap} in the readings: what the sensors felt there is lost")
    began = float(readings.t[0]) - readings.interval
    if t[0] < began - EDGE or t[-1] > readings.t[-1] + EDGE:
        raise AlignmentError(
            f"readings cover {began:.3f} to {readings.t[-1]:.3f} s, "
            f"but {t[0]:.3f} to {t[-1]:.3f} s is asked for"
        )
    edges = np.append(began, readings.t)
    w, f = readings.means(slice(0, len(readings)))
    whole = _stepped(edges, w, f)
    k = np.clip(np.searchsorted(edges, t - EDGE) - 1, 0, len(readings) - 1)
    part = np.clip(t - edges[k], 0.0, None)
    ends = _finished([a[k] for a in whole], w[k], f[k], part)
    absolute = Integrals(edges[k] + part - began, *ends)
    return absolute.since(np.zeros(len(t), int), np.arange(len(t)))


def _half_turns(w: Array, h: Array) -> tuple[Array, Array]:
    """Quaternions (n, 4) of half a sample's turn and of the whole."""
    half = Rotation.from_rotvec(0.5 * w * h[:, None]).as_quat()
    return half, normalised(multiply(half, half))


def _matrices(q: Array) -> Array:
    return Rotation.from_quat(q).as_matrix()


def _stepped(edges: Array, w: Array, f: Array) -> list[Array]:
    """The integrals, but for the duration, from the first to every edge (n + 1)."""
    h = np.diff(edges)
    half, step = _half_turns(w, h)
    after = prefix_product(step)
    before = np.vstack([[0.0, 0.0, 0.0, 1.0], after[:-1]])
    middle = _matrices(multiply(before, half))
    force = np.einsum("nij,nj->ni", middle, f)
    turn = np.concatenate([np.eye(3)[None], _matrices(after)])
    velocity, place = twice(force, h)
    turn_time, turn_time2 = twice(middle, h)
    at_middle = turn_time[:-1] + 0.5 * h[:, None, None] * middle
    velocity_gyro, place_gyro = twice(-cross_matrix(force) @ at_middle, h)
    return [turn, velocity, place, turn_time, turn_time2, velocity_gyro, place_gyro]


def twice(values: Array, h: Array) -> tuple[Array, Array]:
    """First and second integral at every edge of `values` (n, ...) held over steps (n,)."""
    step = h.reshape(-1, *[1] * (values.ndim - 1))
    zero = np.zeros((1, *values.shape[1:]))
    once = np.concatenate([zero, np.cumsum(values * step, axis=0)])
    again = np.cumsum(once[:-1] * step + 0.5 * values * step**2, axis=0)
    return once, np.concatenate([zero, again])


def _finished(before: list[Array], w: Array, f: Array, h: Array) -> list[Array]:
    """The integrals `h` (m,) seconds into a sample, from those at its start."""
    turn, velocity, place, turn_time, turn_time2, velocity_gyro, place_gyro = before
    half, step = _half_turns(w, h)
    middle = turn @ _matrices(half)
    force = np.einsum("nij,nj->ni", middle, f)
    h1, h3 = h[:, None], h[:, None, None]
    tilt = -cross_matrix(force) @ (turn_time + 0.5 * h3 * middle)
    return [
        turn @ _matrices(step),
        velocity + force * h1,
        place + velocity * h1 + 0.5 * force * h1**2,
        turn_time + middle * h3,
        turn_time2 + turn_time * h3 + 0.5 * middle * h3**2,
        velocity_gyro + tilt * h3,
        place_gyro + velocity_gyro * h3 + 0.5 * tilt * h3**2,
    ]
