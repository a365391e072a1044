"""What the data sheets of unit and table tell an estimator before the readings."""

import numpy as np

from alignment import Priors
from alignment.units import ARC_SECOND, STANDARD_GRAVITY
from stand.imu import ImuSpec
from stand.physics.description import JOINTS
from stand.table import Table

GIMBALS = JOINTS[3:]
BASE_ARM = 0.73  # m: the unit's height above the crossing of the base's axes


def priors_of(imu: ImuSpec, table: Table | None, rocking: bool = False) -> Priors:
    """Standard deviations of a unit's constant errors and of a table's placement.

    The placement of a position: encoder errors of the gimbals, and what bends the turn between
    two positions: the instrument's seat and axes that are not square or wobble. A constant offset
    of an axis turns with it and cancels between positions. Misaligned accelerometers feel a part
    of gravity across them: to a levelling that is one more bias. On a `rocking` base the unit
    moves about the base's axes, `BASE_ARM` away.
    """
    turn = 0.0
    if table is not None:
        errors = [table.entry.axis[joint].errors for joint in GIMBALS]
        worst = [
            max(getattr(e, f"{name}_arc_s") for e in errors)
            for name in ("encoder", "non_orthogonality", "wobble")
        ]
        turn = float(np.linalg.norm([*worst, table.entry.geometry.mounting_arc_s])) * ARC_SECOND
    return Priors(
        gyro_bias=float(np.hypot(imu.gyro.bias, imu.gyro.instability)),
        accel_bias=float(
            np.linalg.norm(
                [imu.accel.bias, imu.accel.instability, imu.accel.misalignment * STANDARD_GRAVITY]
            )
        ),
        gyro_instability=imu.gyro.instability,
        accel_instability=imu.accel.instability,
        gyro_scale=imu.gyro.scale,
        accel_scale=imu.accel.scale,
        gyro_walk=imu.gyro.noise,
        accel_walk=imu.accel.noise,
        turn=turn,
        lever_arm=BASE_ARM if rocking else 0.0,
    )
