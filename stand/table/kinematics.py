"""Where the instrument points at given joint angles, and the gimbal angles for an attitude."""

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from alignment.angles import C_N_NUE, Sequence, angles_from_C_nb
from alignment.arrays import Array
from stand.table.joints import JOINTS, StandModel

# The one constant that joins MuJoCo's world (ENU) and n (NED): takes ENU to NED components.
C_NW = Rotation.from_matrix([[0, 1, 0], [1, 0, 0], [0, 0, -1]])


def attitude(model: StandModel, joints: ArrayLike) -> Rotation:
    """``C_nb`` of the instrument at joint angles (6,) [rad]."""
    angles = dict(zip(JOINTS, np.asarray(joints, dtype=float), strict=True))
    bodies = {body.name: body for body in model.bodies}
    C = Rotation.from_quat(model.imu_rotation)
    name = model.imu_body
    while name != "world":
        body = bodies[name]
        if body.joint is not None:
            C = Rotation.from_rotvec(angles[body.joint.name] * body.joint.axis) * C
        C = Rotation.from_quat(body.rotation) * C
        name = body.parent
    return C_NW * C


def gimbal_angles(model: StandModel, base: ArrayLike, C_nb: Rotation) -> list[Array]:
    """Both sets of outer, middle, inner angles [rad] that give ``C_nb`` on a base (3,) [rad].

    The gimbals turn in the order yaw, pitch, roll, so from base and zero gimbals the remaining
    turn is read by that sequence. Where outer and inner axes are parallel, inner is taken 0.
    """
    zero = attitude(model, np.concatenate([np.asarray(base, dtype=float), np.zeros(3)]))
    remaining = C_N_NUE * (zero.inv() * C_nb)
    roll, yaw, pitch = angles_from_C_nb(Sequence.YAW_PITCH_ROLL, remaining)
    if abs(np.cos(pitch)) < 1e-9:
        R = (C_N_NUE.inv() * remaining).as_matrix()
        roll, yaw = 0.0, float(np.arctan2(R[0, 2], R[2, 2]))
    return [
        np.array([yaw, pitch, roll]),
        np.array([yaw + np.pi, np.pi - pitch, roll + np.pi]),
    ]


def gimbal_arm(model: StandModel) -> float:
    """How far [m] the instrument's point is, across one axis, from the gimbal axis farthest from
    it: of its distance, at zero angles, the part along each of two lines across that axis."""
    bodies = {body.name: body for body in model.bodies}
    place, body = model.imu_position.copy(), bodies[model.imu_body]
    arms = []
    while body.name != "world":
        if body.joint is not None and body.joint.name in JOINTS[3:]:
            arms.append(float(np.linalg.norm(np.cross(body.joint.axis, place))))
        place = body.position + Rotation.from_quat(body.rotation).apply(place)
        body = bodies[body.parent]
    return max(arms) / np.sqrt(2)


def base_arm(model: StandModel) -> float:
    """Height [m] of the instrument's point above the base's first axis, at zero angles."""
    bodies = {body.name: body for body in model.bodies}
    first = next(body.name for body in model.bodies if body.joint is not None)
    place, body = model.imu_position.copy(), bodies[model.imu_body]
    while body.name != first:
        place = body.position + Rotation.from_quat(body.rotation).apply(place)
        body = bodies[body.parent]
    return float(Rotation.from_quat(body.rotation).apply(place)[2])
