"""The stand as URDF, for viewers that draw robots."""

import math
from functools import cache
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

from scipy.spatial.transform import Rotation

from alignment.arrays import Array
from stand.errors import StandError
from stand.table.joints import Body, Geom, StandModel

IMU_FRAME = "imu"
"""Name of the link and frame of the instrument's axes X1 Y1 Z1."""


def urdf(model: StandModel) -> str:
    """The robot description: one link per body and one for the instrument's axes.

    Hinges become continuous joints, all else fixed ones; links are named as the bodies and so
    as the frames of /tf. Planes are left out (URDF has none); capsules become cylinders.

    Raises
    ------
    StandError
        A body has the name of the instrument's frame.
    """
    robot = Element("robot", name="imu_test_stand")
    for body in model.bodies:
        if body.name == IMU_FRAME:
            raise StandError(f"body {body.name!r}: the name is taken by the instrument's frame")
        _add_link(robot, body)
    SubElement(robot, "link", name=IMU_FRAME)
    for body in model.bodies[1:]:
        _add_joint(robot, body)
    joint = _joint(robot, f"{IMU_FRAME}_mount", "fixed", model.imu_body, IMU_FRAME)
    _add_origin(joint, model.imu_position, model.imu_rotation)
    ElementTree.indent(robot)
    return ElementTree.tostring(robot, encoding="unicode", xml_declaration=True) + "\n"


def _add_link(robot: Element, body: Body) -> None:
    link = SubElement(robot, "link", name=body.name)
    if body.mass > 0.0:
        _add_inertial(link, body)
    for geom in body.geoms:
        if geom.kind != "plane":
            _add_visual(link, geom)


def _add_inertial(link: Element, body: Body) -> None:
    inertial = SubElement(link, "inertial")
    _add_origin(inertial, body.center, body.inertia_rotation)
    SubElement(inertial, "mass", value=_number(body.mass))
    ixx, iyy, izz = (_number(moment) for moment in body.inertia)
    SubElement(inertial, "inertia", ixx=ixx, ixy="0", ixz="0", iyy=iyy, iyz="0", izz=izz)


def _add_visual(link: Element, geom: Geom) -> None:
    visual = SubElement(link, "visual", name=geom.name)
    _add_origin(visual, geom.position, geom.rotation)
    _add_shape(SubElement(visual, "geometry"), geom)
    material = SubElement(visual, "material", name=f"{geom.name}_color")
    SubElement(material, "color", rgba=_numbers(geom.rgba))


def _add_shape(geometry: Element, geom: Geom) -> None:
    radius, half_length, _ = geom.size
    if geom.kind == "box":
        SubElement(geometry, "box", size=_numbers(2.0 * geom.size))
    elif geom.kind == "sphere":
        SubElement(geometry, "sphere", radius=_number(radius))
    elif geom.kind in ("cylinder", "capsule"):
        SubElement(geometry, "cylinder", radius=_number(radius), length=_number(2.0 * half_length))
    else:
        raise StandError(f"geom {geom.name!r}: kind {geom.kind!r} has no shape in URDF")


def _add_joint(robot: Element, body: Body) -> None:
    hinge = body.joint
    name = f"{body.name}_mount" if hinge is None else hinge.name
    kind = "fixed" if hinge is None else "continuous"
    joint = _joint(robot, name, kind, body.parent, body.name)
    _add_origin(joint, body.position, body.rotation)
    if hinge is not None:
        SubElement(joint, "axis", xyz=_numbers(hinge.axis))


def _joint(robot: Element, name: str, kind: str, parent: str, child: str) -> Element:
    joint = SubElement(robot, "joint", name=name, type=kind)
    SubElement(joint, "parent", link=parent)
    SubElement(joint, "child", link=child)
    return joint


def _add_origin(element: Element, position: Array, rotation: Array) -> None:
    SubElement(element, "origin", xyz=_numbers(position), rpy=_numbers(_angles(*rotation)))


@cache  # hundreds of solids share a few rotations
def _angles(x: float, y: float, z: float, w: float) -> tuple[float, float, float]:
    return _roll_pitch_yaw(Rotation.from_quat([x, y, z, w]).as_matrix())


def _roll_pitch_yaw(C: Array) -> tuple[float, float, float]:
    """Angles of C = Rz(yaw) Ry(pitch) Rx(roll), URDF's order; yaw = 0 where pitch is +-90 deg."""
    cos_pitch = math.hypot(C[0, 0], C[1, 0])
    pitch = math.atan2(-C[2, 0], cos_pitch)
    if cos_pitch < 1e-9:  # both remaining angles turn about one axis
        return math.atan2(-C[1, 2], C[1, 1]), pitch, 0.0
    return math.atan2(C[2, 1], C[2, 2]), pitch, math.atan2(C[1, 0], C[0, 0])


def _numbers(values: Array | tuple[float, ...]) -> str:
    return " ".join(_number(value) for value in values)


def _number(value: float) -> str:
    """The shortest text that reads back as the same number; never a negative zero."""
    return repr(float(value) + 0.0)
