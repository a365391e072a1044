"""[S4]'s double gyrocompassing, formula by formula: what half a turn about Y1 leaves of the errors.

``placement`` is the paper's ``D = (sin d0 + sin d180)/2``: mean error of both placements against
the attitudes the table was told. Errors are measured minus true; yaw psi is positive toward west,
roll and pitch by yaw-pitch-roll, all in radians. Source: [S4] (11)-(16), methods.md section 2;
(13) and (15) are rebuilt.
"""

from dataclasses import dataclass
from math import asin, cos, isfinite, sin, tan

import numpy as np

from alignment.arrays import Array
from alignment.earth import EARTH_RATE


@dataclass(frozen=True, slots=True)
class Posture:
    """Where the instrument stands: roll, pitch, yaw, latitude [rad]."""

    roll: float
    pitch: float
    yaw: float
    latitude: float


@dataclass(frozen=True, slots=True)
class TurnedErrors:
    """Errors of an instrument that is turned by half a turn.

    `accel_y` [m/s^2] is Y1's bias, which no turn about Y1 cancels; `scale` (3,) of accelerometers;
    `gyro_scale` of X1's gyro; `placement` [rad].
    """

    accel_y: float = 0.0
    scale: tuple[float, float, float] = (0.0, 0.0, 0.0)
    gyro_scale: float = 0.0
    placement: float = 0.0


def horizontal_readings(
    posture: Posture, gravity: float, first: float, second: float
) -> tuple[Array, Array]:
    """[S4] (11)-(12): what X1 and what Z1 reads in both positions, (2,) each [m/s^2].

    Placed wrong by `first` and `second` [rad].

    ``ax0 = g sin th + g cos th sin ga sin d0``, ``az0 = -g cos th sin ga + g sin th sin d0``; at
    180 deg both change sign, with d180. To first order in d: cos d is taken as 1.
    """
    x = gravity * sin(posture.pitch)
    z = -gravity * cos(posture.pitch) * sin(posture.roll)
    return (
        np.array([x - z * sin(first), -(x - z * sin(second))]),
        np.array([z + x * sin(first), -(z + x * sin(second))]),
    )


def roll_terms_as_printed(posture: Posture, gravity: float, errors: TurnedErrors) -> Array:
    """[S4] (13), roll: bias, scale and placement term (3,) [rad].

    ``-(b_y/(g cos th cos ga)) tan ga``, ``(K_az - K_ay) tan ga``, ``-tan th D/cos ga`` (rebuilt).
    These are errors of tan(roll): each is 1/cos^2(roll) times the roll's own, `roll_terms`.
    """
    return roll_terms(posture, gravity, errors) / cos(posture.roll) ** 2


def roll_terms(posture: Posture, gravity: float, errors: TurnedErrors) -> Array:
    """Roll after a half turn, to first order: bias, scale and placement term (3,) [rad].

    ``-b_y sin ga/(g cos th)``, ``(K_az - K_ay) sin ga cos ga``, ``-tan th cos ga D``.
    """
    s, c, th = sin(posture.roll), cos(posture.roll), posture.pitch
    _, K_y, K_z = errors.scale
    bias = -errors.accel_y * s / (gravity * cos(th))
    return np.array([bias, (K_z - K_y) * s * c, -tan(th) * c * errors.placement])


def pitch_terms(posture: Posture, errors: TurnedErrors) -> Array:
    """[S4] (13), pitch by asin: scale and placement term (2,) [rad].

    ``K_ax tan th``, ``sin ga D``. By atan2 Y1's bias and scale would enter too.
    """
    return np.array([errors.scale[0] * tan(posture.pitch), sin(posture.roll) * errors.placement])


def levelling_limit(bias: float, gravity: float) -> float:
    """[S4] (14): the turn pays for levelling while ``d << asin(b/g)`` [rad].

    The rule drops the tilt: placement acts through it, so at tilt t a turn pays up to 1/tan(t)
    times as much.
    """
    return asin(bias / gravity)


def rate_across(posture: Posture) -> float:
    """Earth rate along Z1 [rad/s]: what a misplaced turn mixes into X1's gyro."""
    s_g, c_g, lat = sin(posture.roll), cos(posture.roll), posture.latitude
    level = cos(lat) * (c_g * sin(posture.yaw) + s_g * sin(posture.pitch) * cos(posture.yaw))
    return EARTH_RATE * (level - s_g * cos(posture.pitch) * sin(lat))


def rate_along(posture: Posture) -> float:
    """Earth rate along X1 [rad/s]: half of what both readings differ by."""
    lat, th = posture.latitude, posture.pitch
    return EARTH_RATE * (cos(lat) * cos(th) * cos(posture.yaw) + sin(lat) * sin(th))


def yaw_terms(posture: Posture, errors: TurnedErrors) -> Array:
    """[S4] (15), yaw by X1's gyro, latitude given: scale and placement term (2,) [rad].

    ``K_wx (w_x180 - w_x0)/(2 W cos lat cos th sin ps)`` and
    ``(cos ga/cos th + cot ps tan th sin ga - tan lat sin ga/sin ps) D``, which is
    ``w_z D/(W cos lat cos th sin ps)`` (rebuilt). What a wrong pitch does is no part of it:
    `yaw_by_pitch`.
    """
    lat, th, ga, ps = posture.latitude, posture.pitch, posture.roll, posture.yaw
    level = EARTH_RATE * cos(lat) * cos(th) * sin(ps)
    turned = cos(ga) / cos(th) + tan(th) * sin(ga) / tan(ps) - tan(lat) * sin(ga) / sin(ps)
    return np.array([-errors.gyro_scale * rate_along(posture) / level, turned * errors.placement])


def yaw_by_pitch(posture: Posture, pitch_error: float) -> float:
    """What an error of pitch [rad] does to yaw by one gyro, to first order [rad].

    ``(tan lat - cos ps tan th) dth/sin ps``: (15) leaves it out, though the placement that turns
    the gyros tilts the levelling by ``sin ga D`` as well.
    """
    ps = posture.yaw
    return (tan(posture.latitude) - cos(ps) * tan(posture.pitch)) / sin(ps) * pitch_error


def heading_turn_error(posture: Posture, placement: float) -> float:
    """[S4] (16), left side: rate error [rad/s] that a misplaced turn makes of the Earth rate.

    ``W (cos ga sin ps cos lat + cos ps sin th sin ga cos lat - sin lat sin ga cos th) D``.
    """
    return rate_across(posture) * placement


def heading_limit(posture: Posture, gyro_bias: float) -> float:
    """[S4] (16): the placement [rad] below which the turn pays for heading; inf: always.

    Where it adds to X1's rate as much as the `gyro_bias` [rad/s] that it takes away.
    """
    across = abs(rate_across(posture))
    return gyro_bias / across if across else float("inf")


def better_turn(posture: Posture, gyro_bias: float, placement: float) -> int:
    """[S4]'s rule: 180 [deg] while the turn adds less than the gyro's bias, else 90."""
    limit = heading_limit(posture, gyro_bias)
    return 180 if not isfinite(limit) or placement < limit else 90
