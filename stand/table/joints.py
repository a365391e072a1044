"""The stand as plain data, read from its MJCF: for URDF, pictures and forward kinematics."""

from dataclasses import dataclass

import numpy as np

from alignment.arrays import Array, set_owned
from alignment.fixed_order import norm, product

JOINTS: tuple[str, ...] = ("base_roll", "base_pitch", "base_yaw", "outer", "middle", "inner")


@dataclass(frozen=True, slots=True, eq=False)
class Geom:
    """One solid of a body, in the body's frame.

    `kind` is 'box' (size = half lengths), 'cylinder' or 'capsule' (size = radius, half
    length, unused; along z), 'sphere' (radius, unused, unused) or 'plane' (half lengths; 0 =
    unbounded). `rotation` is a quaternion (x, y, z, w); metres; colours 0 to 1.
    """

    name: str
    kind: str
    size: Array
    position: Array
    rotation: Array
    rgba: Array

    def __post_init__(self) -> None:
        set_owned(
            self,
            size=(self.size, (3,), float),
            position=(self.position, (3,), float),
            rotation=(self.rotation, (4,), float),
            rgba=(self.rgba, (4,), float),
        )


@dataclass(frozen=True, slots=True, eq=False)
class Joint:
    """A hinge about `axis` (unit, in the body's frame) through the body's origin."""

    name: str
    axis: Array

    def __post_init__(self) -> None:
        set_owned(self, axis=(self.axis, (3,), float))


@dataclass(frozen=True, slots=True, eq=False)
class Body:
    """A link: where it sits in its parent at zero joint angle, its hinge and its solids.

    `rotation` is a quaternion (x, y, z, w); `mass` [kg]; `inertia` (3,) [kg m^2] are the
    principal moments about `center` (3,) [m], along axes turned by `inertia_rotation`.
    """

    name: str
    parent: str
    position: Array
    rotation: Array
    joint: Joint | None
    geoms: tuple[Geom, ...]
    mass: float
    center: Array
    inertia: Array
    inertia_rotation: Array

    def __post_init__(self) -> None:
        set_owned(
            self,
            position=(self.position, (3,), float),
            rotation=(self.rotation, (4,), float),
            center=(self.center, (3,), float),
            inertia=(self.inertia, (3,), float),
            inertia_rotation=(self.inertia_rotation, (4,), float),
        )


@dataclass(frozen=True, slots=True, eq=False)
class StandModel:
    """The whole stand.

    Attributes
    ----------
    bodies : tuple of Body
        Parents before children; the first is 'world' (its own parent), ENU.
    imu_body : str
        The body that carries the instrument.
    imu_position, imu_rotation : (3,), (4,)
        The site `imu` in that body: its point [m] and axes X1 Y1 Z1 (x, y, z, w).
    sha256 : str
        Of the MJCF files, in order of their names.
    """

    bodies: tuple[Body, ...]
    imu_body: str
    imu_position: Array
    imu_rotation: Array
    sha256: str

    def __post_init__(self) -> None:
        set_owned(
            self,
            imu_position=(self.imu_position, (3,), float),
            imu_rotation=(self.imu_rotation, (4,), float),
        )


def across(axis: Array) -> Array:
    """The first line (3,) about which a wobbling axis nods, across it; the second is at its right.

    After east comes north, then up, then east again.
    """
    line = np.eye(3)[(np.abs(axis).argmax() + 1) % 3]
    line = line - product(line, axis) * axis
    return line / norm(line)
