"""The stand's bodies as ROS transforms: which frames there are and how each is turned."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from alignment.arrays import Array, IntArray
from alignment.quaternions import multiply
from stand.errors import unknown
from stand.recording.urdf import IMU_FRAME
from stand.table.joints import JOINTS, Body, StandModel, across

TF_PERIOD_NS = 20_000_000


@dataclass(frozen=True, slots=True)
class Frames:
    """Some transforms of one message: `pairs` of (parent, child)."""

    pairs: tuple[tuple[str, str], ...]
    translations: Array
    rotations: Array


def hinged(model: StandModel) -> tuple[Body, ...]:
    """The bodies with a hinge, in the order of `JOINTS`.

    Raises
    ------
    StandError
        A hinge whose name is not in `JOINTS`.
    """
    bodies = {body.joint.name: body for body in model.bodies if body.joint is not None}
    for name in bodies:
        if name not in JOINTS:
            raise unknown("joint", name, JOINTS)
    return tuple(bodies[name] for name in JOINTS if name in bodies)


def columns(bodies: tuple[Body, ...]) -> list[int]:
    """Where the bodies' hinges stand in `JOINTS`."""
    return [JOINTS.index(body.joint.name) for body in bodies if body.joint is not None]


def fixed_frames(model: StandModel) -> Frames:
    """Bodies without a hinge, and the instrument's axes in its body: one transform each."""
    bodies = [body for body in model.bodies[1:] if body.joint is None]
    return Frames(
        (*((body.parent, body.name) for body in bodies), (model.imu_body, IMU_FRAME)),
        np.stack([*(body.position for body in bodies), model.imu_position]),
        np.stack([*(body.rotation for body in bodies), model.imu_rotation]),
    )


def moving_frames(
    bodies: tuple[Body, ...], angles: Array, nods: Mapping[int, Array] | None = None
) -> Frames:
    """Bodies on their hinges at `angles` (n, bodies): n transforms each.

    A child's place is its position in the parent, then its rotation at zero angle, then the
    hinge's turn about its own axis; then, where the axis wobbles, its nods about two lines across
    it. `nods`: by number of the body, their two angles (n, 2) [rad].
    """
    n = len(angles)
    translations = np.broadcast_to(np.stack([b.position for b in bodies]), (n, len(bodies), 3))
    turned = [_turned(body, angles[:, i]) for i, body in enumerate(bodies)]
    for i, nod in (nods or {}).items():
        turned[i] = _nodded(turned[i], bodies[i], nod)
    rotations = np.stack(turned, axis=1)
    return Frames(tuple((b.parent, b.name) for b in bodies), translations, rotations)


def _turned(body: Body, angle: Array) -> Array:
    """Quaternions (n, 4) of the body at hinge angles (n,), straight from the half angles."""
    assert body.joint is not None
    return multiply(body.rotation, _about(body.joint.axis, angle))


def _nodded(q: Array, body: Body, nod: Array) -> Array:
    assert body.joint is not None
    first, second = _lines_across(tuple(body.joint.axis.tolist()))
    return multiply(multiply(q, _about(first, nod[:, 0])), _about(second, nod[:, 1]))


@lru_cache(maxsize=32)
def _lines_across(axis: tuple[float, ...]) -> tuple[Array, Array]:
    """The two lines about which an axis nods; the same for every chunk."""
    first = across(np.array(axis))
    return first, np.cross(axis, first)


def _about(axis: Array, angle: Array) -> Array:
    """Quaternions (n, 4) of turns by `angle` (n,) about one axis."""
    half = angle[:, None] / 2
    return np.hstack([np.sin(half) * axis, np.cos(half)])


def tf_rows(t_ns: IntArray, previous_ns: int | None) -> IntArray:
    """Which samples get transforms: the first in each period, whatever the blocks.

    Parameters
    ----------
    t_ns : (n,) int64, n >= 1
    previous_ns : int or None
        Time of the sample before these; None at the beginning, which gets transforms.
    """
    periods = t_ns // TF_PERIOD_NS
    before = periods[0] - 1 if previous_ns is None else previous_ns // TF_PERIOD_NS
    return np.flatnonzero(np.diff(periods, prepend=before))
