"""Paths of a vehicle over the rotating ellipsoidal Earth, and what perfect sensors feel on them.

Speed, heading, climb and roll are smooth functions of time: each change is a polynomial of ninth
degree whose first four derivatives vanish at both ends (C4). The vehicle goes where its X1 axis
points (pitch = climb); velocity is relative to the Earth. Everything else follows exactly; only the
place comes out of a differential equation, to 1e-8 m.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import cos

import numpy as np
from scipy.interpolate import PPoly
from scipy.spatial.transform import Rotation

from alignment.angles import C_nb_from_angles
from alignment.angles import Sequence as Turns
from alignment.arrays import Array
from alignment.earth import EARTH_RATE
from alignment.navigation import C_en, ecef, gravity, radii
from stand.errors import StandError
from stand.vehicle.place import integrated

# 1 - (1 - x)^5 (1 + 5 x + 15 x^2 + 35 x^3 + 70 x^4): 0 to 1, highest power first
_STEP = np.array([70.0, -315.0, 540.0, -420.0, 126.0, 0, 0, 0, 0, 0])
# of three-point Gauss quadrature
_NODES, _WEIGHTS = np.array([-1.0, 0.0, 1.0]) * np.sqrt(3 / 5), np.array([5.0, 8.0, 5.0]) / 9
_CHUNK = 20000  # samples whose quadrature nodes are held at once
_LOWEST, _HIGHEST = -12_000.0, 120_000.0  # m: from the sea's floor to where air ends
_NEAR_POLE = 1e-3  # cosine of latitude: beyond, north and longitude turn too fast


@dataclass(frozen=True, slots=True)
class Start:
    """Where and how a path begins: geodetic latitude, longitude [rad], height [m]; heading, climb,
    roll [rad], speed [m/s]."""

    latitude: float
    longitude: float = 0.0
    height: float = 0.0
    heading: float = 0.0
    speed: float = 0.0
    climb: float = 0.0
    roll: float = 0.0


@dataclass(frozen=True, slots=True)
class Change:
    """What one value does next: it goes smoothly to `value` within `duration` [s]."""

    duration: float
    value: float


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """A vehicle at some times.

    Attributes
    ----------
    latitude, longitude, height : (n,)
        Geodetic [rad], [m].
    v_n : (n, 3)
        Velocity relative to the Earth, in n [m/s].
    C_nb : n rotations
    w_ib_b, f_b : (n, 3)
        What perfect sensors feel at these instants [rad/s], [m/s^2].
    """

    latitude: Array
    longitude: Array
    height: Array
    v_n: Array
    C_nb: Rotation
    w_ib_b: Array
    f_b: Array

    @property
    def r_e(self) -> Array:
        """Place in e (n, 3) [m]."""
        return ecef(self.latitude, self.longitude, self.height)

    @property
    def v_e(self) -> Array:
        """Velocity relative to the Earth, in e (n, 3) [m/s]."""
        return np.einsum("nij,nj->ni", C_en(self.latitude, self.longitude), self.v_n)


def smooth(start: float, changes: Sequence[Change]) -> PPoly:
    """A C4 function of time from 0 on that goes from value to value."""
    durations = np.array([c.duration for c in changes])
    values = np.array([start, *(c.value for c in changes)])
    powers = np.arange(9, -1, -1)
    coefficients = _STEP[:, None] * np.diff(values) / durations ** powers[:, None]
    coefficients[-1] = values[:-1]
    return PPoly(coefficients, np.concatenate([[0.0], np.cumsum(durations)]), extrapolate=True)


class Path:
    """A path from `start` on, by the smooth functions of its speed, heading, climb and roll.

    Parameters
    ----------
    start : Start
    speed, heading, climb, roll : sequence of Change
        Of equal total duration; may be cut at different times.

    Raises
    ------
    StandError
        Durations differ, or the path comes within 6 km of a pole.
    """

    def __init__(
        self,
        start: Start,
        speed: Sequence[Change],
        heading: Sequence[Change],
        climb: Sequence[Change],
        roll: Sequence[Change],
    ) -> None:
        self.start = start
        self._speed = smooth(start.speed, speed)
        self._heading = smooth(start.heading, heading)
        self._climb = smooth(start.climb, climb)
        self._roll = smooth(start.roll, roll)
        curves = (self._speed, self._heading, self._climb, self._roll)
        self._rates = [curve.derivative() for curve in curves]
        ends = np.array([curve.x[-1] for curve in curves])
        if np.ptp(ends) > 1e-9 * ends[0]:
            raise StandError(f"path: its values' durations differ: {ends.tolist()} s")
        self.duration = float(ends[0])
        knots = np.unique(np.concatenate([curve.x for curve in curves]))
        self.knots = knots[np.append(True, np.diff(knots) > 1e-9)]
        self._place = self._integrated()

    def _integrated(self) -> PPoly:
        """Metres north, east, up of the start, scaled by the radii there: errors read in metres."""
        scale = self._scale()

        def rates(t: Array, x: Array, v_n: Array) -> Array:
            latitude, longitude, height = _placed(self.start, x, scale)
            if (np.cos(latitude) < _NEAR_POLE).any():
                raise StandError("path: comes within 6 km of a pole")
            beyond = np.flatnonzero(~((height >= _LOWEST) & (height <= _HIGHEST)))
            if len(beyond):
                k = int(beyond[0])
                raise StandError(
                    f"path: {height[k]:.0f} m high after {t[k]:.0f} s, must be from {_LOWEST:.0f} "
                    f"to {_HIGHEST:.0f} m"
                )
            return _place_rates(latitude, longitude, height, v_n) * scale

        return integrated(self._v_n, rates, self.knots)

    def _scale(self) -> Array:
        meridian, prime = radii(self.start.latitude)
        return np.array([meridian, prime * cos(self.start.latitude), 1.0])

    def _v_n(self, t: Array) -> Array:
        return self._speed(t)[:, None] * _forward(self._heading(t), self._climb(t))

    def at(self, t: Array) -> Motion:
        """The vehicle at times `t` (n,) [s], 0 to `duration`."""
        speed, heading, climb, roll = (
            curve(t) for curve in (self._speed, self._heading, self._climb, self._roll)
        )
        d_speed, d_heading, d_climb, d_roll = (rate(t) for rate in self._rates)
        x = self._place(t)
        latitude, longitude, height = _placed(self.start, x, self._scale())
        forward, right = _forward(heading, climb), _right(heading)
        up_turn = _forward(heading, climb + np.pi / 2)  # where X1 goes as it pitches up
        v_n = speed[:, None] * forward
        along = np.stack([-np.sin(heading), np.cos(heading), np.zeros_like(heading)], axis=1)
        turning = d_climb[:, None] * up_turn + (d_heading * np.cos(climb))[:, None] * along
        a_n = d_speed[:, None] * forward + speed[:, None] * turning
        w_ie_n, w_en_n = _earth_rates(latitude, height, v_n)
        f_n = a_n + np.cross(2 * w_ie_n + w_en_n, v_n)
        f_n[:, 2] -= gravity(latitude, height)
        w_n = w_ie_n + w_en_n + d_roll[:, None] * forward + d_climb[:, None] * right
        w_n[:, 2] += d_heading
        C_nb = _attitude(heading, climb, roll)
        return Motion(
            latitude,
            longitude,
            height,
            v_n,
            C_nb=C_nb,
            w_ib_b=C_nb.apply(w_n, True),
            f_b=C_nb.apply(f_n, True),
        )

    def means(self, edges: Array) -> tuple[Array, Array]:
        """Means of ``w_ib_b`` and ``f_b`` (n, 3) between successive `edges` (n + 1,) [s].

        Three-point Gauss quadrature, cut at the knots: for samples of 20 ms or less below
        1e-11 of the value where a manoeuvre takes seconds.
        """
        parts = [self._means(edges[k : k + _CHUNK + 1]) for k in range(0, len(edges) - 1, _CHUNK)]
        w, f = zip(*parts, strict=True)
        return np.concatenate(w), np.concatenate(f)

    def _means(self, edges: Array) -> tuple[Array, Array]:
        inner = self.knots[(self.knots > edges[0]) & (self.knots < edges[-1])]
        grid = np.union1d(edges, inner)
        half = np.diff(grid) / 2
        nodes = (grid[:-1] + half)[:, None] + half[:, None] * _NODES
        motion = self.at(nodes.ravel())
        first = np.searchsorted(grid, edges[:-1])
        weights = (half[:, None] * _WEIGHTS)[..., None]
        w, f = (
            np.add.reduceat((weights * x.reshape(-1, 3, 3)).sum(axis=1), first)
            / np.diff(edges)[:, None]
            for x in (motion.w_ib_b, motion.f_b)
        )
        return w, f


def _forward(heading: Array, climb: Array) -> Array:
    level = np.cos(climb)
    return np.stack([level * np.cos(heading), level * np.sin(heading), -np.sin(climb)], axis=-1)


def _right(heading: Array) -> Array:
    return np.stack([-np.sin(heading), np.cos(heading), np.zeros_like(heading)], axis=-1)


def _attitude(heading: Array, climb: Array, roll: Array) -> Rotation:
    """``C_nb`` by yaw-pitch-roll of methods.md section 0; heading is minus yaw."""
    angles = np.stack([-heading, climb, roll], axis=-1)
    zero = C_nb_from_angles(Turns.YAW_PITCH_ROLL, 0.0, 0.0, 0.0)
    return zero * Rotation.from_euler("YZX", angles)


def _placed(start: Start, x: Array, scale: Array) -> tuple[Array, Array, Array]:
    """Latitude, longitude, height from scaled metres (..., 3)."""
    turned = x / scale
    return (
        start.latitude + turned[..., 0],
        start.longitude + turned[..., 1],
        start.height + turned[..., 2],
    )


def _place_rates(latitude: Array, longitude: Array, height: Array, v_n: Array) -> Array:
    meridian, prime = radii(latitude)
    east = (prime + height) * np.cos(latitude)
    return np.stack([v_n[:, 0] / (meridian + height), v_n[:, 1] / east, -v_n[:, 2]], axis=1)


def _earth_rates(latitude: Array, height: Array, v_n: Array) -> tuple[Array, Array]:
    """``w_ie_n`` and the transport rate ``w_en_n`` (n, 3) [rad/s]."""
    meridian, prime = radii(latitude)
    s, c, zero = np.sin(latitude), np.cos(latitude), np.zeros_like(latitude)
    w_ie = EARTH_RATE * np.stack([c, zero, -s], axis=1)
    east = v_n[:, 1] / (prime + height)
    w_en = np.stack([east, -v_n[:, 0] / (meridian + height), -east * s / c], axis=1)
    return w_ie, w_en
