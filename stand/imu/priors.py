"""What the data sheets of unit and table tell an estimator before the readings."""

from collections.abc import Sequence
from math import hypot, sqrt

import numpy as np

from alignment import Priors
from alignment.fixed_order import norm
from alignment.information.drift import LASTING
from alignment.units import ARC_SECOND
from stand.imu import ImuSpec
from stand.imu.by_value import at_most
from stand.imu.instrument import lags_of
from stand.imu.processes import plateau
from stand.table.joints import JOINTS
from stand.table.table import Table

BASE, GIMBALS = JOINTS[:3], JOINTS[3:]
ALIKE = (
    "instability",
    "random_walk",
    "ramp",
    "scale",
    "asymmetry",
    "misalignment",
    "non_orthogonality",
)
NOISE_ONLY = "noise only"  # beside a sigma for which no sheet states more
BASE_ARM = 0.73  # m: the unit's height above the crossing of the shipped base's axes
GIMBAL_ARM = 0.055227  # m: the unit's place on two lines across the shipped pitch axis, each


def priors_of(
    imu: ImuSpec,
    table: Table | None,
    arm: float = 0.0,
    noise: tuple[float, float] | None = None,
) -> Priors:
    """Standard deviations of a unit's constant errors and of a table's placement.

    A dwell of minutes cannot tell a bias from what of its instability changes more slowly than
    that. What misaligned accelerometers and g-sensitive gyros make of gravity is no bias: it
    changes with the attitude, and is told by its own name. Where a base rocks or a table turns the
    unit moves about axes that are some `arm` [m] away. `noise`: densities as `slow_noise` has them;
    those of the sheet if not given.
    """
    imu = at_most(imu)
    turn, seat, nominal, azimuth = (0.0, 0.0, 0.0, 0.0) if table is None else placement(table)
    slow = _slow_part(imu.corners)
    lag, accel_later = lags_of(imu)
    gyro, accel = (imu.gyro.noise, imu.accel.noise) if noise is None else noise
    return Priors(
        gyro_bias=float(np.hypot(imu.gyro.bias, slow * imu.gyro.instability)),
        accel_bias=float(np.hypot(imu.accel.bias, slow * imu.accel.instability)),
        gyro_walk=gyro,
        accel_walk=accel,
        **_alike(imu),
        gyro_g_sensitivity=imu.gyro.g_sensitivity,
        gyro_g2_sensitivity=imu.gyro.g2_sensitivity,
        accel_quadratic=imu.accel.second_order,
        accel_cubic=imu.accel.nonlinearity / imu.accel.full_scale**2,
        gyro_cubic=imu.gyro.nonlinearity / imu.gyro.full_scale**2,
        turn=turn,
        seat=seat,
        nominal=nominal,
        azimuth=azimuth,
        lever_arm=arm,
        places=float(np.sqrt(np.mean(imu.places**2))),
        lag=lag,
        accel_later=accel_later,
        clock=imu.clock.offset,
        jitter=imu.clock.jitter,
        gyro_axes=imu.gyro.axes,
        accel_axes=imu.accel.axes,
    )


def noise_alone(imu: ImuSpec | None) -> frozenset[str]:
    """The sensors of which nothing but noise is known: there is no sheet, or it states no more."""
    return Priors().noise_only if imu is None else priors_of(imu, None).noise_only


def only(noise_only: bool) -> str:
    """What stands behind a sigma of noise alone."""
    return f" {NOISE_ONLY}" if noise_only else ""


def _alike(imu: ImuSpec) -> dict[str, float]:
    """What priors call after the sensor and after the field of its sheet."""
    return {
        f"{sensor}_{name}": getattr(getattr(imu, sensor), name)
        for sensor in ("gyro", "accel")
        for name in ALIKE
    }


def _slow_part(corners: Sequence[float]) -> float:
    """Standard deviation of the part of a bias instability of plateau 1 that outlasts a dwell."""
    lasting = sum(corner > LASTING for corner in corners)
    return float(np.sqrt(lasting)) / plateau(corners)


def placement(table: Table) -> tuple[float, float, float, float]:
    """`turn`, `seat`, `nominal` and `azimuth` of a table [rad], each of one axis.

    A position is off by its encoders and by what bends the turn to it: axes that are not square
    or wobble. The seat is the instrument's mounting on gimbals whose zeros are off. Base and
    zeros move all attitudes alike: about level axes by the base's tilt, about down by its azimuth.
    """
    errors = [table.entry.axis[joint].errors for joint in GIMBALS]
    geometry = table.entry.geometry
    bent = [
        max(getattr(e, f"{name}_arc_s") for e in errors)
        for name in ("encoder", "non_orthogonality", "wobble")
    ]
    zeros = norm([e.placement_arc_s for e in errors]) / sqrt(3)
    roll, pitch, yaw = (table.entry.axis[joint].errors.placement_arc_s for joint in BASE)
    sizes = (
        norm(bent),
        hypot(geometry.mounting_arc_s, zeros),
        hypot(geometry.base_tilt_arc_s, max(roll, pitch)),
        hypot(geometry.base_azimuth_arc_s, yaw),
    )
    turn, seat, nominal, azimuth = (float(size) * ARC_SECOND for size in sizes)
    return turn, seat, nominal, azimuth
