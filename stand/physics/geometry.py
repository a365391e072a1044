"""The stand as it was built: its model with the table's constant errors in its geometry.

What depends on the angles (curves of the axes, wobble) is the truth's: `stand.physics.truth`.
"""

# mujoco fills its namespace from C, unseen by pyright.
# pyright: reportAttributeAccessIssue=false

import copy
from typing import Any

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from alignment.arrays import Array
from alignment.fixed_order import product
from stand.physics.mjcf import SITE
from stand.table.joints import JOINTS
from stand.table.table_errors import TableErrors

# the axis toward which each one leans: the one that carries it; outer is parallel to its own
# carrier, base_yaw, and so leans where that leans
_TOWARD = {
    "base_pitch": "base_roll",
    "base_yaw": "base_pitch",
    "outer": "base_pitch",
    "middle": "outer",
    "inner": "middle",
}


def with_errors(
    model: mujoco.MjModel,
    errors: TableErrors,
    data: mujoco.MjData | None = None,
    into: Any = None,
) -> mujoco.MjModel:
    """A copy of the whole stand with tilt and azimuth of its base, leaning axes and the IMU's seat.

    The base is turned about the crossing of its axes, by one rotation vector in w; the IMU by one
    in b: ``C_true = C_nominal exp(mounting)``. Each axis leans from its nominal direction in its
    nominal plane, so that what one leans changes no other. `data`, of this model or of a copy like
    this one's, is worked in where many are made; `into`, what an earlier call of this model gave,
    is made anew and given.
    """
    built: Any = copy.copy(model) if into is None else into
    at_zero: Any = mujoco.MjData(model) if data is None else data
    mujoco.mj_kinematics(model, at_zero)
    for name, toward in _TOWARD.items():
        joint, carrier = model.joint(name).id, model.joint(toward).id
        lean = errors.non_orthogonality[JOINTS.index(name)]
        axis = np.cos(lean) * at_zero.xaxis[joint] + np.sin(lean) * at_zero.xaxis[carrier]
        body = model.jnt_bodyid[joint]
        built.jnt_axis[joint] = product(at_zero.xmat[body].reshape(3, 3).T, axis)
    base = model.jnt_bodyid[model.joint(JOINTS[0]).id]
    tilt = Rotation.from_rotvec([*errors.base_tilt, errors.base_azimuth])
    built.body_quat[base] = _wxyz(tilt * _rotation(model.body_quat[base]))
    site = model.site(SITE).id
    seat = Rotation.from_rotvec(errors.mounting.copy())  # scipy takes no locked array
    built.site_quat[site] = _wxyz(_rotation(model.site_quat[site]) * seat)
    # MuJoCo takes a site whose frame is its body's from there
    built.site_sameframe[site] = mujoco.mjtSameFrame.mjSAMEFRAME_NONE
    return built


def data_of(model: mujoco.MjModel) -> mujoco.MjData:
    """Room for the kinematics of a model and of its copies."""
    return mujoco.MjData(model)


def _rotation(wxyz: Array) -> Rotation:
    return Rotation.from_quat(wxyz, scalar_first=True)


def _wxyz(rotation: Rotation) -> Array:
    return rotation.as_quat(scalar_first=True)
