"""Error budget of analytic gyrocompassing, to first order, and the published figures beside ours.

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
from alignment.information.turns import time_needed
from alignment.levelling import attitude_sensitivity
from alignment.methods.positions import half_turn_means
from alignment.methods.single_gyro import latitude_sensitivity, single_gyro_attitude
from alignment.methods.single_gyro import single_gyro_sensitivity as sensitivity
from alignment.units import ARC_MINUTE, ARC_SECOND, DEG, DEG_PER_HOUR, DEG_PER_RT_HOUR

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


# --- the published figures ------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class PublishedFigure:
    """A figure of the papers beside what its stated assumptions give.

    `published` and `ours` in words with units; `because` says under which assumptions ours comes
    out, or why the published one does not.
    """

    figure: str
    published: str
    ours: str
    reproduced: bool
    because: str

    @property
    def verdict(self) -> str:
        """'reproduced' or 'not reproduced', and why."""
        return f"{'' if self.reproduced else 'not '}reproduced, because {self.because}"


_TILT = 5 * DEG
_SCALE = 0.002
_GRAVITY = 9.81  # m/s^2
_NOISE = 0.01 / np.sqrt(60 * 200)  # m/s^2: mean of 60 s at 200 Hz


def levelling_worst(bias: float, equal_scale: bool, noise_sigmas: float) -> Array:
    """[S4]'s worst case of roll, pitch by asin, pitch by atan2 (3,) [rad], tilts of 5 deg.

    `bias` [m/s^2] of every accelerometer at its worst sign, K = 0.2 % of equal or of worst signs,
    noise of a 60 s mean at `noise_sigmas` standard deviations per axis.
    """
    C_nb = C_nb_from_angles(Sequence.YAW_PITCH_ROLL, _TILT, 0.0, _TILT)  # any yaw
    sources = ErrorSources(
        accel_bias=np.full(3, bias),
        accel_scale=np.full(3, _SCALE),
        accel_noise=np.full(3, noise_sigmas * _NOISE),
    )
    rows = budget(C_nb, 45 * DEG, _GRAVITY, sources)
    scale = np.array(["scale" in name for name in rows.sources])
    parts = rows.contributions[:, :3]
    constant = np.sum(np.abs(parts[~scale]), axis=0)
    together = np.abs(np.sum(parts[scale], axis=0))
    apart = np.sum(np.abs(parts[scale]), axis=0)
    return np.asarray(constant + (together if equal_scale else apart))


def double_worst(latitude: float, accel_scale: float = 0.0) -> float:
    """[S4]'s double gyrocompassing at its worst signs: heading error [rad], evaluated exactly.

    Gyros of 10 deg/h and 0.2 %, accelerometers of `accel_scale` alone, both positions placed
    within 1', tilts 5 deg, X1 to the west, latitude given, X1 gyro alone; against the actual
    first attitude.
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
    for turned, placement in ((0.0, signs[:, 0]), (np.pi, signs[:, 1])):
        angle = turned + ARC_MINUTE * placement
        C_nb = first * Rotation.from_rotvec(angle[:, None] * np.array([0.0, 1.0, 0.0]))
        true = np.concatenate([C_nb.inv().apply(v) for v in vectors], axis=1)
        readings.append((1 + scale) * true + bias)
    means = half_turn_means(*readings)
    X1 = np.eye(3)[0]
    found = single_gyro_attitude(means[:, 0], means[:, 3:], X1, latitude, -1.0)
    actual = first * Rotation.from_rotvec(ARC_MINUTE * signs[:, :1] * np.array([0.0, 1.0, 0.0]))
    ahead, true_ahead = found[:, :, 0], actual.as_matrix()[:, :, 0]
    off = np.arctan2(
        ahead[:, 1] * true_ahead[:, 0] - ahead[:, 0] * true_ahead[:, 1],
        ahead[:, 0] * true_ahead[:, 0] + ahead[:, 1] * true_ahead[:, 1],
    )
    return float(np.max(np.abs(off)))


def published_figures() -> tuple[PublishedFigure, ...]:
    """[S4]'s figures beside ours, each with its verdict."""
    return (*_levelling_figures(), *_double_figures())


def _minutes(*angles: float, digits: int = 1) -> str:
    return " or ".join(f"{angle / ARC_MINUTE:.{digits}f}'" for angle in angles)


def _levelling_figures() -> tuple[PublishedFigure, ...]:
    apart = levelling_worst(0.1, equal_scale=False, noise_sigmas=0)
    equal = levelling_worst(0.1, equal_scale=True, noise_sigmas=0)
    fine = levelling_worst(0.001, equal_scale=True, noise_sigmas=3)
    case = "roll = pitch = 5 deg, K = 0.2 %"
    return (
        PublishedFigure(
            f"roll, {case}, b = 0.1 m/s^2",
            "39'",
            _minutes(float(apart[0]), float(equal[0])),
            True,
            because="it comes out with scale errors of opposite sign (the second with equal ones)",
        ),
        PublishedFigure(
            f"pitch, {case}, b = 0.1 m/s^2",
            "41'",
            _minutes(float(equal[1]), float(equal[2])),
            False,
            because="asin gives the first, atan2 with equal K the second (with the worst signs of "
            f"K {_minutes(float(apart[2]))}): no assumption stated gives 41'",
        ),
        PublishedFigure(
            f"roll, {case}, b = 0.001 m/s^2",
            "0.46'",
            _minutes(float(fine[0]), digits=3),
            False,
            because="bias, equal K and three sigma of noise per axis give more; bias alone gives "
            f"{_minutes(float(levelling_worst(0.001, True, 0)[0]), digits=3)}",
        ),
        PublishedFigure(
            f"pitch, {case}, b = 0.001 m/s^2",
            "0.5'",
            _minutes(float(fine[2]), digits=3),
            True,
            because="it comes out, rounded, by atan2 with equal K and three sigma of noise per "
            "axis",
        ),
    )


def _double_figures() -> tuple[PublishedFigure, ...]:
    latitudes = 45 * DEG, 60 * DEG
    plain = [double_worst(latitude) for latitude in latitudes]
    scaled = [double_worst(latitude, _SCALE) for latitude in latitudes]
    target = 1.3 * ARC_MINUTE
    days = [
        (time_needed(target, latitudes[0], walk * DEG_PER_RT_HOUR) or np.inf) / 86400
        for walk in (0.15, 0.6)
    ]
    needed = np.tan(30 * ARC_MINUTE) * EARTH_RATE * np.cos(latitudes[0]) / DEG_PER_HOUR
    return (
        PublishedFigure(
            "heading after a half turn, gyros of 10 deg/h, placement 1'",
            "1.3'",
            f"{_minutes(plain[0])} (latitude 45 deg) to {_minutes(plain[1])} (60 deg)",
            False,
            because="1' of placement and K tan(lat) tan(pitch) of scale error add up to more; with "
            f"0.2 % of the accelerometers too it is {_minutes(scaled[0])} to {_minutes(scaled[1])}",
        ),
        PublishedFigure(
            "the same with the white noise of such gyros, 0.15 to 0.6 deg/rt-h",
            "not stated",
            f"{days[0]:.0f} to {days[1]:.0f} days at latitude 45 deg",
            False,
            because="white noise alone needs that long for 1.3', and bias instability ends it "
            "before",
        ),
        PublishedFigure(
            "heading without a turn, gyros of 10 deg/h",
            "tens of arc minutes",
            f"no heading: 10 deg/h is {10 / (15.041067 * np.cos(latitudes[0])):.2f} of the "
            "horizontal Earth rate",
            False,
            because=f"30' needs gyros of {needed:.2f} deg/h",
        ),
        PublishedFigure(
            "placement below which a turn pays, accelerometers of 5e-5 and 5e-3 m/s^2",
            "1'' and 1.7'",
            f"{5e-5 / _GRAVITY / ARC_SECOND:.2f}'' and {_minutes(5e-3 / _GRAVITY, digits=2)}",
            True,
            because="it is b/g; but placement acts through the tilt, so at 5 deg a turn pays up to "
            f"{1 / np.tan(_TILT):.0f} times that",
        ),
    )
