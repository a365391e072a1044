"""The robot description, read back with XML and rotations only."""

import xml.etree.ElementTree as ET
from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from stand.errors import StandError
from stand.recording.urdf import urdf
from stand.table.joints import Body, Geom, Joint, StandModel

STILL = (0.0, 0.0, 0.0, 1.0)
TURNED = (0.1, 0.7, -0.3, np.sqrt(1 - 0.01 - 0.49 - 0.09))
QUARTER_Y = (0.0, np.sqrt(0.5), 0.0, np.sqrt(0.5))  # pitch of 90 deg: roll and yaw coincide


def geom(name, kind, size, rotation=STILL):
    return Geom(name, kind, size, (0.1, 0.2, -0.3), rotation, (0.2, 0.4, 0.6, 1.0))


def toy_stand(plate="plate"):
    arm = Body(
        "arm", "world", (0, 0, 1.5), TURNED, Joint("outer", (0, -1, 0)),
        (geom("beam", "box", (0.1, 0.2, 0.3), TURNED), geom("ball", "sphere", (0.4, 0, 0))),
        3.0, (0.01, 0.02, 0.03), (4, 5, 6), QUARTER_Y,
    )  # fmt: skip
    top = Body(
        plate, "arm", (0.5, 0, 0), QUARTER_Y, None,
        (geom("disc", "cylinder", (0.4, 0.05, 0)), geom("rod", "capsule", (0.02, 0.3, 0))),
        2.0, (0, 0, 0), (1, 1, 2), STILL,
    )  # fmt: skip
    floor = (geom("floor", "plane", (0, 0, 1)),)
    world = Body("world", "world", (0, 0, 0), STILL, None, floor, 0.0, (0,) * 3, (0,) * 3, STILL)
    return StandModel((world, arm, top), plate, (0, 0.1, 0), (0.5, 0.5, 0.5, 0.5), "")


@pytest.fixture(scope="module")
def robot():
    return ET.fromstring(urdf(toy_stand()))


def find(root, path):
    found = root.find(path)
    assert found is not None, path
    return found


def numbers(text):
    return [float(word) for word in text.split()]


def origin_rotation(element):
    return Rotation.from_euler("xyz", numbers(find(element, "origin").get("rpy")))


def same(rotation, q):
    # Angles of order one round at 1e-16; a right angle's cosine rounds at 1e-16 too.
    return (rotation.inv() * Rotation.from_quat(q)).magnitude() < 1e-14


def test_links_and_joints(robot):
    assert [link.get("name") for link in robot.findall("link")] == ["world", "arm", "plate", "imu"]
    joints = {
        joint.get("name"): (
            joint.get("type"),
            find(joint, "parent").get("link"),
            find(joint, "child").get("link"),
        )
        for joint in robot.findall("joint")
    }
    assert joints == {
        "outer": ("continuous", "world", "arm"),
        "plate_mount": ("fixed", "arm", "plate"),
        "imu_mount": ("fixed", "plate", "imu"),
    }
    assert numbers(find(robot, "joint/axis").get("xyz")) == [0, -1, 0]


@pytest.mark.parametrize(
    ("joint", "place", "q"),
    [
        ("outer", [0, 0, 1.5], TURNED),
        ("plate_mount", [0.5, 0, 0], QUARTER_Y),
        ("imu_mount", [0, 0.1, 0], (0.5, 0.5, 0.5, 0.5)),
    ],
)
def test_places_of_the_joints(robot, joint, place, q):
    element = find(robot, f"joint[@name='{joint}']")
    assert numbers(find(element, "origin").get("xyz")) == place
    assert same(origin_rotation(element), q)


def test_roll_pitch_yaw_by_hand(robot):
    """X1 = y, Y1 = z, Z1 = x of the plate: Rz(90) Ry(0) Rx(90)."""
    element = find(robot, "joint[@name='imu_mount']/origin")
    np.testing.assert_allclose(numbers(element.get("rpy")), [np.pi / 2, 0, np.pi / 2], atol=1e-15)


def test_shapes(robot):
    shapes = {
        visual.get("name"): next(iter(find(visual, "geometry"))) for visual in robot.iter("visual")
    }
    read = {
        name: (shape.tag, {key: numbers(value) for key, value in shape.attrib.items()})
        for name, shape in shapes.items()
    }
    assert read == {  # no floor: URDF has no planes
        "beam": ("box", {"size": [0.2, 0.4, 0.6]}),
        "ball": ("sphere", {"radius": [0.4]}),
        "disc": ("cylinder", {"radius": [0.4], "length": [0.1]}),
        "rod": ("cylinder", {"radius": [0.02], "length": [0.6]}),
    }
    beam = find(robot, "link/visual[@name='beam']")
    assert numbers(find(beam, "origin").get("xyz")) == [0.1, 0.2, -0.3]
    assert same(origin_rotation(beam), TURNED)
    assert numbers(find(beam, "material/color").get("rgba")) == [0.2, 0.4, 0.6, 1.0]


def test_inertia(robot):
    inertial = find(robot, "link[@name='arm']/inertial")
    assert numbers(find(inertial, "origin").get("xyz")) == [0.01, 0.02, 0.03]
    assert same(origin_rotation(inertial), QUARTER_Y)
    assert numbers(find(inertial, "mass").get("value")) == [3]
    inertia = find(inertial, "inertia").attrib
    names = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    assert [float(inertia[name]) for name in names] == [4, 0, 0, 5, 0, 6]
    assert robot.find("link[@name='world']/inertial") is None


def test_parents_come_before_children(robot):
    order = [link.get("name") for link in robot.findall("link")]
    for joint in robot.findall("joint"):
        places = [order.index(find(joint, end).get("link")) for end in ("parent", "child")]
        assert all(a < b for a, b in pairwise(places))


def test_same_model_same_text():
    assert urdf(toy_stand()) == urdf(toy_stand())


def test_faults():
    with pytest.raises(StandError, match="body 'imu': the name is taken"):
        urdf(toy_stand(plate="imu"))
    model = toy_stand()
    odd = model.bodies[0]
    mesh = Body(
        odd.name, odd.parent, odd.position, odd.rotation, None,
        (geom("part", "mesh", (1, 1, 1)),), 0.0, odd.center, odd.inertia, odd.inertia_rotation,
    )  # fmt: skip
    with pytest.raises(StandError, match="geom 'part': kind 'mesh' has no shape in URDF"):
        urdf(StandModel((mesh,), "world", (0, 0, 0), STILL, ""))
