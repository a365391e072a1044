"""Error budget of analytic gyrocompassing, to first order, and the worst cases of the paper.

Source: [S4], methods.md section 2 (measured = true (1 + K) + b + noise). Signs and sizes are
checked by differencing the estimators themselves.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from alignment.angles import C_nb_from_angles, Sequence, angles_from_C_nb
from alignment.arrays import Array, set_owned
from alignment.earth import EARTH_RATE, normal_gravity
from alignment.levelling import attitude_sensitivity
from alignment.methods.positions import half_turn_means
from alignment.methods.single_gyro import latitude_sensitivity, single_gyro_attitude
from alignment.methods.single_gyro import single_gyro_sensitivity as sensitivity
from alignment.units import ARC_MINUTE, DEG, DEG_PER_HOUR

OUTPUTS = (
    "roll",
    "pitch by asin",
    "pitch by atan2",
    "heading, full vector",
    "heading, X1 gyro",
    "latitude, full vector",
    "latitude, vertical rate",
)
_AXES = ("X1", "Y1", "Z1")
_NONE = (0.0, 0.0, 0.0)
_MERIDIAN = 1e-6  # east component of X1 below which it lies in the meridian


@dataclass(frozen=True, slots=True, eq=False)
class ErrorSources:
    """Errors of an instrument, each (3,) for X1, Y1, Z1; signed where that means something.

    Attributes
    ----------
    gyro_bias, accel_bias : rad/s, m/s^2
    gyro_scale, accel_scale : a part of the value
    gyro_noise, accel_noise : rad/s, m/s^2
        Standard deviation of the mean.
    gyro_g : rad/s per m/s^2
        Sensitivity of each gyro to specific force along itself.
    misalignment : rad
        Small rotation about b of the gyros' case from that of the accelerometers.
    """

    gyro_bias: ArrayLike = field(default=_NONE)
    gyro_scale: ArrayLike = field(default=_NONE)
    gyro_noise: ArrayLike = field(default=_NONE)
    gyro_g: ArrayLike = field(default=_NONE)
    misalignment: ArrayLike = field(default=_NONE)
    accel_bias: ArrayLike = field(default=_NONE)
    accel_scale: ArrayLike = field(default=_NONE)
    accel_noise: ArrayLike = field(default=_NONE)

    def __post_init__(self) -> None:
        set_owned(self, **{name: (getattr(self, name), (3,), float) for name in self.__slots__})


@dataclass(frozen=True, slots=True, eq=False)
class Budget:
    """What each source contributes to each output.

    Attributes
    ----------
    sources : tuple of str
        'X1 gyro bias' and so on: 24 rows.
    contributions : (24, 7) rad
        Signed, to `OUTPUTS`; of noise the standard deviation.
    """

    sources: tuple[str, ...]
    contributions: Array

    @property
    def worst(self) -> Array:
        """All contributions at their worst signs, (7,) [rad]."""
        return np.asarray(np.sum(np.abs(self.contributions), axis=0))

    def of(self, output: str) -> dict[str, float]:
        """Contributions [rad] to one of `OUTPUTS` by source."""
        column = self.contributions[:, OUTPUTS.index(output)]
        return dict(zip(self.sources, column.tolist(), strict=True))


def sensitivities(C_nb: Rotation, latitude: float, gravity: float) -> Array:
    """Matrix (7, 6): errors of `OUTPUTS` [rad] per error of rates and forces in b.

    Notes
    -----
    With th pitch, ph roll (yaw-pitch-roll): roll ``-(b_z cos ph + b_y sin ph)/(g cos th)``; pitch
    by asin ``b_x/(g cos th)``, by atan2 ``[b_x cos th - sin th (b_y cos ph - b_z sin ph)]/g``;
    heading is that of X1 on the horizon, clockwise; its X1-gyro form has the latitude given, and
    is NaN where X1 lies in the meridian: there one gyro shows no azimuth to first order.
    """
    roll, _, pitch = angles_from_C_nb(Sequence.YAW_PITCH_ROLL, C_nb)
    s_r, c_r, s_p, c_p = np.sin(roll), np.cos(roll), np.sin(pitch), np.cos(pitch)
    R = C_nb.as_matrix()
    to_n = np.zeros((6, 6))
    to_n[:3, :3] = to_n[3:, 3:] = R
    full = attitude_sensitivity(
        EARTH_RATE * np.cos(latitude), EARTH_RATE * np.sin(latitude), gravity
    )
    north, east, down = R[:, 0]
    level2 = north**2 + east**2
    to_heading = np.array([-north * down, -east * down, level2]) / level2
    vector_latitude = np.zeros(6)
    vector_latitude[:3] = -np.array([np.sin(latitude), 0.0, np.cos(latitude)]) / EARTH_RATE
    vector_latitude[3] = 1 / gravity
    S = np.zeros((7, 6))
    S[0, 3:] = np.array([0.0, -s_r, -c_r]) / (gravity * c_p)
    S[1, 3] = 1 / (gravity * c_p)
    S[2, 3:] = np.array([c_p, -s_p * c_r, s_p * s_r]) / gravity
    S[3] = to_heading @ full @ to_n
    S[4] = np.nan
    if abs(east) > _MERIDIAN:
        S[4] = to_heading @ sensitivity(R[:, 0], latitude, gravity) @ to_n
    S[5] = vector_latitude @ to_n
    S[6] = latitude_sensitivity(latitude, gravity) @ to_n
    return S


def budget(C_nb: Rotation, latitude: float, gravity: float, sources: ErrorSources) -> Budget:
    """First-order error budget of roll, pitch, heading and latitude at rest.

    Parameters
    ----------
    C_nb : Rotation
        Attitude; X1 not vertical.
    latitude, gravity : float
        [rad], [m/s^2]
    sources : ErrorSources

    Notes
    -----
    Leading errors left out: second order (10 deg/h of gyro bias is a radian of heading, and no
    first-order figure holds then).
    """
    S = sensitivities(C_nb, latitude, gravity)
    R = C_nb.as_matrix()
    w = R.T @ (EARTH_RATE * np.array([np.cos(latitude), 0.0, -np.sin(latitude)]))
    f = R.T @ np.array([0.0, 0.0, -gravity])
    names, rows = [], []
    for title, values, errors in (
        ("gyro bias", sources.gyro_bias, np.eye(6)[:3]),
        ("gyro scale", sources.gyro_scale, np.eye(6)[:3] * w[:, None]),
        ("gyro noise", sources.gyro_noise, np.eye(6)[:3]),
        ("gyro g-sensitivity", sources.gyro_g, np.eye(6)[:3] * f[:, None]),
        ("gyro misalignment", sources.misalignment, _turned_case(w)),
        ("accelerometer bias", sources.accel_bias, np.eye(6)[3:]),
        ("accelerometer scale", sources.accel_scale, np.eye(6)[3:] * f[:, None]),
        ("accelerometer noise", sources.accel_noise, np.eye(6)[3:]),
    ):
        names += [f"{axis} {title}" for axis in _AXES]
        rows.append(np.asarray(values)[:, None] * (errors @ S.T))
    return Budget(tuple(names), np.concatenate(rows))


def _turned_case(w: Array) -> Array:
    """Rows (3, 6): what gyros read too much when their case is turned by 1 rad about each axis."""
    rows = np.zeros((3, 6))
    rows[:, :3] = np.cross(w, np.eye(3))
    return rows


# --- the paper's worst cases ----------------------------------------------------------------------

_TILT = 5 * DEG
_SCALE = 0.002
_GRAVITY = 9.81  # m/s^2
_NOISE = 0.01 / np.sqrt(60 * 200)  # m/s^2: mean of 60 s at 200 Hz


def levelling_worst(
    bias: float,
    equal_scale: bool,
    noise_sigmas: float,
    scale: float = _SCALE,
    tilt: float = _TILT,
) -> Array:
    """[S4]'s worst case of roll, pitch by asin, pitch by atan2 (3,) [rad].

    `bias` [m/s^2] of every accelerometer at its worst sign, errors of `scale` of equal or of worst
    signs, noise of a 60 s mean at `noise_sigmas` standard deviations per axis; roll and pitch of
    `tilt` [rad]. As printed: K = 0.2 %, 5 deg.
    """
    C_nb = C_nb_from_angles(Sequence.YAW_PITCH_ROLL, tilt, 0.0, tilt)  # any yaw
    sources = ErrorSources(
        accel_bias=np.full(3, bias),
        accel_scale=np.full(3, scale),
        accel_noise=np.full(3, noise_sigmas * _NOISE),
    )
    rows = budget(C_nb, 45 * DEG, _GRAVITY, sources)
    scaled = np.array(["scale" in name for name in rows.sources])
    parts = rows.contributions[:, :3]
    constant = np.sum(np.abs(parts[~scaled]), axis=0)
    together = np.abs(np.sum(parts[scaled], axis=0))
    apart = np.sum(np.abs(parts[scaled]), axis=0)
    return np.asarray(constant + (together if equal_scale else apart))


def double_worst(latitude: float, accel_scale: float = 0.0, placement: float = ARC_MINUTE) -> float:
    """[S4]'s double gyrocompassing at its worst signs: heading error [rad], evaluated exactly.

    Gyros of 10 deg/h and 0.2 %, accelerometers of `accel_scale` alone, both positions placed within
    `placement` [rad], tilts 5 deg, X1 to the west, latitude given, X1 gyro alone; against the
    actual first attitude.
    """
    signs = np.array(np.meshgrid(*[[-1.0, 1.0]] * 8)).reshape(8, -1).T
    first = C_nb_from_angles(Sequence.YAW_PITCH_ROLL, _TILT, 90 * DEG, _TILT)
    gravity = normal_gravity(latitude)
    vectors = (
        EARTH_RATE * np.array([np.cos(latitude), 0.0, -np.sin(latitude)]),
        np.array([0.0, 0.0, -gravity]),
    )
    scale = np.concatenate([_SCALE * signs[:, 2:5], accel_scale * signs[:, 5:8]], axis=1)
    bias = np.repeat([10 * DEG_PER_HOUR, 0.0], 3)
    readings = []
    for turned, sign in ((0.0, signs[:, 0]), (np.pi, signs[:, 1])):
        angle = turned + placement * sign
        C_nb = first * Rotation.from_rotvec(angle[:, None] * np.array([0.0, 1.0, 0.0]))
        true = np.concatenate([C_nb.inv().apply(v) for v in vectors], axis=1)
        readings.append((1 + scale) * true + bias)
    means = half_turn_means(*readings)
    X1 = np.eye(3)[0]
    found = single_gyro_attitude(means[:, 0], means[:, 3:], X1, latitude, -1.0)
    actual = first * Rotation.from_rotvec(placement * signs[:, :1] * np.array([0.0, 1.0, 0.0]))
    ahead, true_ahead = found[:, :, 0], actual.as_matrix()[:, :, 0]
    off = np.arctan2(
        ahead[:, 1] * true_ahead[:, 0] - ahead[:, 0] * true_ahead[:, 1],
        ahead[:, 0] * true_ahead[:, 0] + ahead[:, 1] * true_ahead[:, 1],
    )
    return float(np.max(np.abs(off)))
