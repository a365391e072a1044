"""What the data sheets of unit and table say, as errors to first order.

The unit's become a `Unit` of `alignment.information`. The table's are small rotations of b at each
attitude, worked out from the stand's own axes: what a class states of one axis turns and leans it
the same way in every position, so much of it cancels and some of it does not.
"""

from dataclasses import dataclass
from math import sqrt

import numpy as np
from scipy.spatial.transform import Rotation

from alignment.arrays import Array, set_owned
from alignment.information import GaussMarkov, Triad, Unit
from alignment.units import ARC_SECOND
from stand.imu import ImuSpec
from stand.imu.preset import TriadSpec
from stand.imu.processes import plateau
from stand.physics.description import JOINTS, StandModel
from stand.table import Table

FILTER_LAG = sqrt(2) / (2 * np.pi)  # of a Butterworth low-pass of second order, times bandwidth
_DITHERED = 0.3  # of a step: less noise than this does not take rounding's constant part away
# the axis toward which each one leans, as `stand.physics.geometry` builds it
_TOWARD = {"base_pitch": 0, "base_yaw": 1, "outer": 1, "middle": 3, "inner": 4}


def unit_of(imu: ImuSpec, rate_hz: int) -> Unit:
    """The instrument's errors as standard deviations; rounding counts as noise, or as bias.

    A sample's rounding is noise of a step over sqrt(12) where white noise dithers it; where it
    does not, it stays as it is and is one more bias.
    """
    delay = FILTER_LAG / imu.gyro.bandwidth if np.isfinite(imu.gyro.bandwidth) else 0.0
    return Unit(
        _triad(imu.gyro, imu, rate_hz),
        _triad(imu.accel, imu, rate_hz),
        float(delay + imu.clock.latency),
    )


def _triad(spec: TriadSpec, imu: ImuSpec, rate_hz: int) -> Triad:
    height = spec.instability / plateau(imu.corners)
    rounding = 0.0 if imu.increments else spec.resolution / sqrt(12)
    dithered = spec.noise * sqrt(rate_hz) > _DITHERED * spec.resolution
    return Triad(
        noise=np.hypot(spec.noise, rounding / sqrt(rate_hz) if dithered else 0.0),
        bias=np.hypot(spec.bias, 0.0 if dithered else rounding),
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
    """An error of the table: `sigma`, and the `turns` (k, 3) of b at k poses per unit of it."""

    source: str
    sigma: float
    turns: Array

    def __post_init__(self) -> None:
        set_owned(self, turns=(self.turns, (None, 3), float))


def leanings(table: Table, model: StandModel, joints: Array) -> list[Leaning]:
    """Every error a table class states, and how it turns b at joint angles (k, 6) [rad].

    ``C_true = C_nominal exp(turns)``. Rate ripple is left out: as an angle it is its part of a
    turn over its number of times round, below an arc second.
    """
    frames, axes, across, before = _chain(model, joints)
    geometry = table.entry.geometry
    found: list[Leaning] = []

    def add(source: str, arc_s: float, in_w: Array) -> None:
        if arc_s > 0:
            turns = np.einsum("kji,kj->ki", frames, in_w)
            found.append(Leaning(source, arc_s * ARC_SECOND, turns))

    for axis, line in enumerate(np.eye(3)):
        every = np.tile(line, (len(joints), 1))
        tilts = axis < 2
        size = geometry.base_tilt_arc_s if tilts else geometry.base_azimuth_arc_s
        add("table tilt" if tilts else "table azimuth", size, every)
        add("mounting", geometry.mounting_arc_s, frames[:, :, axis])
    for i, name in enumerate(JOINTS):
        errors, q = table.entry.axis[name].errors, joints[:, i : i + 1]
        add("placement", errors.placement_arc_s, axes[:, i])
        for order in (1, 2):
            for wave in (np.cos(order * q), np.sin(order * q)):
                add("encoder", errors.encoder_arc_s / 2**0.5, axes[:, i] * wave)
        if name in _TOWARD:
            toward = np.einsum("kij,j->ki", before[:, i], _built(model)[_TOWARD[name]])
            turned = np.cross(axes[:, i], toward)
            after = Rotation.from_rotvec(q * axes[:, i]).apply(turned)
            add("non-orthogonality", errors.non_orthogonality_arc_s, turned - after)
        for c, s in ((np.cos(q), np.sin(q)), (-np.sin(q), np.cos(q))):
            nod = across[:, i, 0] * c + across[:, i, 1] * s
            add("wobble", errors.wobble_arc_s / 2**0.5, nod)
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
