"""What is stated of a table, as errors to first order: small rotations of b at each attitude.

Worked out from the stand's own axes: what a class states of one axis turns and leans it the same
way in every position, so much of it cancels and some of it does not.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from alignment.arrays import Array, IntArray, set_owned
from alignment.information.model import NODES
from alignment.readings import JointAngles
from stand.table.joints import JOINTS, StandModel
from stand.table.kinematics import attitude
from stand.table.known_errors import Size, StatedErrors

PARTS = ("cosine", "sine")
# the axis toward which each one leans, as `stand.physics.geometry` builds it
_TOWARD = {"base_pitch": 0, "base_yaw": 1, "outer": 1, "middle": 3, "inner": 4}


@dataclass(frozen=True, slots=True, eq=False)
class Leaning:
    """An error of the table, and the `turns` (k, 3) of b at k poses per unit of it.

    `sigma` of its draws, or the value that is `known` of it; `detail`: which of its source.
    """

    source: str
    sigma: float
    turns: Array
    known: float = 0.0
    detail: str = ""

    @property
    def name(self) -> str:
        """Of this one alone."""
        return f"{self.source} {self.detail}".strip()

    def __post_init__(self) -> None:
        set_owned(self, turns=(self.turns, (None, 3), float))


def leanings(
    stated: StatedErrors,
    model: StandModel,
    joints: Array,
    round_axis: IntArray | None = None,
    off: Array | None = None,
) -> list[Leaning]:
    """Every error that is stated, and how it turns b at joint angles (k, 6) [rad].

    ``C_true = C_nominal exp(turns)``. `round_axis` (k,): the axis that goes round evenly through a
    pose and others (-1: none does): a ripple too quick for `NODES` of them leaves nothing in a
    whole turn. `off` (k, 6): by how much axes stand beyond what they are told at each pose.
    """
    frames, axes, across, before = _chain(model, joints)
    rounds = np.full(len(joints), -1) if round_axis is None else round_axis
    found: list[Leaning] = []

    def add(source: str, size: Size, in_w: Array, detail: str = "") -> None:
        if size.sigma or size.known:
            turns = np.einsum("kji,kj->ki", frames, in_w)
            found.append(Leaning(source, size.sigma, turns, size.known, detail=detail))

    for axis, (line, base, seat) in enumerate(
        zip(np.eye(3), stated.base(), stated.mounting(), strict=True)
    ):
        told = "table tilt" if axis < 2 else "table azimuth"
        add(told, base, np.tile(line, (len(joints), 1)), ("about east", "about north", "")[axis])
        add("mounting", seat, frames[:, :, axis], f"about {('X1', 'Y1', 'Z1')[axis]}")
    for i, name in enumerate(JOINTS):
        q = joints[:, i : i + 1]
        add("placement", stated.placement(i), axes[:, i], f"of {name}")
        for order in (1, 2):
            waves = np.cos(order * q), np.sin(order * q)
            for size, wave, part in zip(stated.encoder(i, order), waves, PARTS, strict=True):
                add("encoder", size, axes[:, i] * wave, f"of {name}, {part} {order}")
        if name in _TOWARD:
            toward = np.einsum("kij,j->ki", before[:, i], _built(model)[_TOWARD[name]])
            turned = np.cross(axes[:, i], toward)
            after = Rotation.from_rotvec(q * axes[:, i]).apply(turned)
            add("non-orthogonality", stated.non_orthogonality(i), turned - after, f"of {name}")
        for (size, cosine, sine), part in zip(stated.wobble(i), PARTS, strict=False):
            c, s = cosine * np.cos(q) - sine * np.sin(q), cosine * np.sin(q) + sine * np.cos(q)
            nod = across[:, i, 0] * c + across[:, i, 1] * s
            add("wobble", size, nod, f"of {name}, {part}")
        n, waves = stated.ripple(i)
        slow = 1.0 if n < NODES / 2 else (rounds != i)[:, None]
        for (size, cosine, sine), part in zip(waves, PARTS, strict=False):
            wave = cosine * np.cos(n * q) - sine * np.sin(n * q)
            add("rate ripple", size, axes[:, i] * wave * slow, f"of {name}, {part}")
    if off is not None and off.any():
        add("servo", Size(known=1.0), np.einsum("ki,kij->kj", off, axes))
    return found


def joint_axes(model: StandModel, joints: Array) -> Array:
    """Axes (k, 6, 3) in b about which each joint turns it, at joint angles (k, 6) [rad]."""
    frames, axes, *_ = _chain(model, joints)
    return np.einsum("kji,kaj->kai", frames, axes)


def joints_read(model: StandModel, angles: Array, going_round: int) -> JointAngles:
    """Where the encoders say that the axes (6,) stood, the turning one's angle left out."""
    own = np.array(angles)
    if going_round >= 0:
        own[going_round] = 0.0
    axis_b = joint_axes(model, own[None])[0, going_round] if going_round >= 0 else None
    return JointAngles(own, going_round, attitude(model, own), axis_b)


def _built(model: StandModel) -> Array:
    """The hinges' axes (6, 3) in w at zero angles; every body is built parallel to w."""
    hinges = {b.joint.name: b.joint.axis for b in model.bodies if b.joint is not None}
    return np.array([hinges[name] for name in JOINTS])


def _chain(model: StandModel, joints: Array) -> tuple[Array, Array, Array, Array]:
    """At poses (k, 6): ``C_wb`` (k, 3, 3), axes (k, 6, 3) in w, two lines across each that turn
    with it (k, 6, 2, 3), and the turn (k, 6, 3, 3) of what carries each axis."""
    built, k = _built(model), len(joints)
    C = np.tile(np.eye(3), (k, 1, 1))
    axes, across, before = np.empty((k, 6, 3)), np.empty((k, 6, 2, 3)), np.empty((k, 6, 3, 3))
    for i, axis in enumerate(built):
        before[:, i], axes[:, i] = C, C @ axis
        C = C @ Rotation.from_rotvec(joints[:, i : i + 1] * axis).as_matrix()
        first = np.eye(3)[(int(np.abs(axis).argmax()) + 1) % 3]
        across[:, i, 0], across[:, i, 1] = C @ first, C @ np.cross(axis, first)
    return C @ Rotation.from_quat(model.imu_rotation).as_matrix(), axes, across, before
