"""What the data sheets of unit and table say, as errors to first order.

The unit's become `InstrumentErrors` of `alignment.information`. The table's are small rotations of
b at each attitude, worked out from the stand's own axes: what a class states of one axis turns and
leans it the same way in every position, so much of it cancels and some of it does not.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from alignment.arrays import Array, IntArray, set_owned
from alignment.information import GaussMarkov, InstrumentErrors, TriadErrors
from alignment.information.model import NODES
from stand.imu import ImuSpec
from stand.imu.filter import LAG
from stand.imu.preset import TriadSpec
from stand.imu.processes import plateau
from stand.rehearsal.known_errors import Size, StatedErrors
from stand.table.joints import JOINTS, StandModel

# the axis toward which each one leans, as `stand.physics.geometry` builds it
_TOWARD = {"base_pitch": 0, "base_yaw": 1, "outer": 1, "middle": 3, "inner": 4}


def unit_of(imu: ImuSpec) -> InstrumentErrors:
    """The instrument's errors as standard deviations, but for the rounding of its samples."""
    delay = LAG / imu.gyro.bandwidth if np.isfinite(imu.gyro.bandwidth) else 0.0
    return InstrumentErrors(
        _triad(imu.gyro, imu), _triad(imu.accel, imu), float(delay + imu.clock.latency)
    )


def _triad(spec: TriadSpec, imu: ImuSpec) -> TriadErrors:
    height = spec.instability / plateau(imu.corners)
    return TriadErrors(
        noise=spec.noise,
        bias=spec.bias,
        ramp=spec.ramp,
        scale=spec.scale,
        asymmetry=spec.asymmetry,
        quadratic=spec.second_order,
        cubic=spec.nonlinearity / spec.full_scale**2,
        misalignment=spec.misalignment,
        non_orthogonality=spec.non_orthogonality,
        g_sensitivity=spec.g_sensitivity,
        g2_sensitivity=spec.g2_sensitivity,
        drift=tuple(GaussMarkov(height, corner) for corner in imu.corners) if height else (),
        random_walk=spec.random_walk,
    )


@dataclass(frozen=True, slots=True, eq=False)
class Leaning:
    """An error of the table, and the `turns` (k, 3) of b at k poses per unit of it.

    `sigma` of its draws, or the value that is `known` of it.
    """

    source: str
    sigma: float
    turns: Array
    known: float = 0.0

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

    def add(source: str, size: Size, in_w: Array) -> None:
        if size.sigma or size.known:
            turns = np.einsum("kji,kj->ki", frames, in_w)
            found.append(Leaning(source, size.sigma, turns, size.known))

    for axis, (line, base, seat) in enumerate(
        zip(np.eye(3), stated.base(), stated.mounting(), strict=True)
    ):
        add("table tilt" if axis < 2 else "table azimuth", base, np.tile(line, (len(joints), 1)))
        add("mounting", seat, frames[:, :, axis])
    for i, name in enumerate(JOINTS):
        q = joints[:, i : i + 1]
        add("placement", stated.placement(i), axes[:, i])
        for order in (1, 2):
            waves = np.cos(order * q), np.sin(order * q)
            for size, wave in zip(stated.encoder(i, order), waves, strict=True):
                add("encoder", size, axes[:, i] * wave)
        if name in _TOWARD:
            toward = np.einsum("kij,j->ki", before[:, i], _built(model)[_TOWARD[name]])
            turned = np.cross(axes[:, i], toward)
            after = Rotation.from_rotvec(q * axes[:, i]).apply(turned)
            add("non-orthogonality", stated.non_orthogonality(i), turned - after)
        for size, cosine, sine in stated.wobble(i):
            c, s = cosine * np.cos(q) - sine * np.sin(q), cosine * np.sin(q) + sine * np.cos(q)
            add("wobble", size, across[:, i, 0] * c + across[:, i, 1] * s)
        n, waves = stated.ripple(i)
        slow = 1.0 if n < NODES / 2 else (rounds != i)[:, None]
        for size, cosine, sine in waves:
            wave = cosine * np.cos(n * q) - sine * np.sin(n * q)
            add("rate ripple", size, axes[:, i] * wave * slow)
    if off is not None and off.any():
        add("servo", Size(known=1.0), np.einsum("ki,kij->kj", off, axes))
    return found


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
