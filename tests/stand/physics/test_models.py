"""The stand's MJCF: signs and lever arm by hand, clearances, masses, and its plain description."""

import hashlib

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from stand.errors import StandError
from stand.physics import mjcf
from stand.physics.copies import spec_of
from stand.table.joints import JOINTS, StandModel

MODELS = mjcf.models_folder()
S, C = 0.17364817766693033, 0.984807753012208  # sin and cos of 10 deg
ABOUT_UP = [[-S, 0, C], [C, 0, S], [0, 1, 0]]  # X1 north goes west
ABOUT_EAST = [[0, 0, 1], [C, -S, 0], [S, C, 0]]  # X1 north goes up
ABOUT_NORTH = [[0, S, C], [1, 0, 0], [0, C, -S]]  # Y1 up goes east
ROUNDING = 1e-15  # a few products of numbers up to 1.5 in double precision


def _posed(**angles_deg: float) -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = mjcf.load_model()
    data = mujoco.MjData(model)
    for name, angle in angles_deg.items():
        data.joint(name).qpos[:] = np.radians(angle)
    mujoco.mj_fwdPosition(model, data)
    return model, data


def _site(**angles_deg: float) -> tuple[np.ndarray, np.ndarray]:
    _, data = _posed(**angles_deg)
    site = data.site("imu")
    return site.xpos.copy(), site.xmat.reshape(3, 3).copy()


def test_instrument_axes_at_zero_are_north_up_east():
    _, axes = _site()
    np.testing.assert_array_equal(axes, [[0, 0, 1], [1, 0, 0], [0, 1, 0]])


@pytest.mark.parametrize(
    ("joint", "axes"),
    [
        ("base_roll", ABOUT_NORTH),
        ("base_pitch", ABOUT_EAST),
        ("base_yaw", ABOUT_UP),
        ("outer", ABOUT_UP),
        ("middle", ABOUT_EAST),
        ("inner", ABOUT_NORTH),
    ],
)
def test_ten_degrees_of_each_joint(joint, axes):
    np.testing.assert_allclose(_site(**{joint: 10.0})[1], axes, rtol=0, atol=ROUNDING)


@pytest.mark.parametrize(
    ("angles", "point"),
    [
        ({}, (0.04, 0.06, 1.33)),
        ({"outer": 90}, (-0.06, 0.04, 1.33)),
        ({"middle": 90}, (0.04, -0.05, 1.34)),
        ({"inner": 90}, (0.05, 0.06, 1.24)),
        ({"base_roll": 90}, (0.73, 0.06, 0.56)),
        ({"base_pitch": 90}, (0.04, -0.73, 0.66)),
        ({"base_yaw": 90}, (-0.06, 0.04, 1.33)),
    ],
)
def test_lever_arm(angles, point):
    np.testing.assert_allclose(_site(**angles)[0], point, rtol=0, atol=ROUNDING)


@pytest.mark.parametrize(
    ("joints", "height"), [(JOINTS[:3], 0.60), (JOINTS[3:], 1.28)], ids=["base", "table"]
)
def test_axes_cross_in_one_point(joints, height):
    _, data = _posed(outer=25, middle=-40, inner=70)
    for name in joints:
        np.testing.assert_allclose(data.joint(name).xanchor, (0, 0, height), atol=ROUNDING)


def test_order_of_the_joints_from_the_pier_to_the_plate():
    bodies = mjcf.describe(mjcf.load_model()).bodies
    assert tuple(body.name for body in bodies) == ("world", *JOINTS, "imu_unit")
    assert [body.parent for body in bodies] == ["world", "world", *JOINTS]


def _touching(model: mujoco.MjModel, data: mujoco.MjData, gap: float) -> set[tuple[str, str]]:
    """Pairs of solids of different bodies nearer than `gap` [m], bearings of neighbours aside."""
    mujoco.mj_kinematics(model, data)
    mujoco.mj_collision(model, data)
    return {
        pair
        for pair, near in zip(data.contact.geom, data.contact.dist < gap, strict=True)
        if near and not _is_bearing(model, *pair)
        for pair in [(model.geom(pair[0]).name, model.geom(pair[1]).name)]
    }


def _is_bearing(model: mujoco.MjModel, one: int, other: int) -> bool:
    first, second = sorted((model.geom_bodyid[one], model.geom_bodyid[other]))
    named = any(model.geom(geom).name.endswith("_bearing") for geom in (one, other))
    return named and model.body_parentid[second] == first


def _colliding(gap: float) -> mujoco.MjModel:
    model = mjcf.load_model()
    disabled = mujoco.mjtDisableBit
    model.opt.disableflags &= ~int(disabled.mjDSBL_CONTACT)
    model.opt.disableflags |= int(disabled.mjDSBL_FILTERPARENT)
    # The boxes of the middle phase are not widened by the margin: near pairs would be lost.
    model.opt.disableflags |= int(disabled.mjDSBL_MIDPHASE)
    model.geom_margin[:] = gap
    return model


def _poses(count: int) -> np.ndarray:
    """Joint angles (count, 6) [rad]: base within 15 deg, table through whole turns."""
    rng = np.random.default_rng(20)
    base, table = np.radians(15.0), np.pi
    limits = np.array([base, base, table, table, table, table])
    return rng.uniform(-limits, limits, (count, 6))


def test_solids_never_meet():
    gap = 0.004  # metres: free space a table of this size needs at least
    model = _colliding(gap)
    data = mujoco.MjData(model)
    met: set[tuple[str, str]] = set()
    corners = np.radians(15.0) * np.array([(i, j) for i in (-1, 1) for j in (-1, 1)])
    poses = _poses(300)
    poses[:4, :2] = corners
    for pose in poses:
        data.qpos[:] = pose
        met |= _touching(model, data, gap)
    assert met == set()


def test_a_solid_that_meets_another_is_found():
    model = _colliding(0.0)
    data = mujoco.MjData(model)
    model.geom("middle_encoder").pos[1] -= 0.06  # reaches the disc below when it points down
    data.joint("middle").qpos[:] = np.pi / 2
    assert ("outer_disc", "middle_encoder") in _touching(model, data, 0.0)


@pytest.mark.parametrize(
    ("body", "least", "most"),
    [
        ("base_roll", 60, 130),
        ("base_pitch", 60, 130),
        ("base_yaw", 60, 130),
        ("outer", 60, 130),
        ("middle", 15, 40),
        ("inner", 8, 20),
        ("imu_unit", 0.06, 0.5),
    ],
)
def test_masses_are_those_of_a_laboratory_table(body, least, most):
    model = mjcf.load_model()
    assert least < model.body(body).mass[0] < most


@pytest.mark.parametrize("body", ["middle", "inner"])
def test_gimbals_are_balanced(body):
    _, data = _posed()
    offset = data.body(body).subtree_com - (0, 0, 1.28)
    assert np.abs(offset).max() < 0.0005  # trimmed to half a millimetre


def test_every_solid_is_named_coloured_and_simple():
    geoms = [geom for body in mjcf.describe(mjcf.load_model()).bodies for geom in body.geoms]
    names = [geom.name for geom in geoms]
    assert all(names)
    assert len(set(names)) == len(names)
    assert {geom.name for geom in geoms if geom.kind == "plane"} == {"floor"}
    assert all(geom.rgba[3] == 1.0 for geom in geoms)
    assert not any(np.allclose(geom.rgba, (0.5, 0.5, 0.5, 1.0)) for geom in geoms)  # the default


def _chain(description: StandModel, angles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Instrument's point and axes by composing the description, joint by joint."""
    turns = dict(zip(JOINTS, angles, strict=True))
    place = {"world": (np.zeros(3), np.eye(3))}
    for body in description.bodies[1:]:
        origin, axes = place[body.parent]
        origin, axes = origin + axes @ body.position, axes @ _matrix(body.rotation)
        if body.joint is not None:
            turn = Rotation.from_rotvec(turns[body.joint.name] * body.joint.axis)
            axes = axes @ turn.as_matrix()
        place[body.name] = origin, axes
    origin, axes = place[description.imu_body]
    return origin + axes @ description.imu_position, axes @ _matrix(description.imu_rotation)


def _matrix(xyzw: np.ndarray) -> np.ndarray:
    return Rotation.from_quat(xyzw).as_matrix()


def test_description_carries_the_whole_kinematics():
    model = mjcf.load_model()
    data = mujoco.MjData(model)
    description = mjcf.describe(model)
    for pose in np.random.default_rng(7).uniform(-np.pi, np.pi, (50, 6)):
        data.qpos[:] = pose
        mujoco.mj_kinematics(model, data)
        point, axes = _chain(description, pose)
        # rounding of eight products of rotations
        np.testing.assert_allclose(point, data.site("imu").xpos, rtol=0, atol=1e-12)
        np.testing.assert_allclose(axes.ravel(), data.site("imu").xmat, rtol=0, atol=1e-12)


def _tiny(joints: tuple[str, ...] = JOINTS, inside: str = "", first: str = "") -> mujoco.MjModel:
    """One body per joint, the first turned by +90 deg about z; `inside` goes into the last."""
    turned = ['quat="1 0 0 1"', *[""] * 5]
    special = [first, *[""] * 5]
    opened = "".join(
        f'<body name="{name}" {quat}><joint name="{name}" axis="0 0 1" {more}/>'
        '<geom size=".1" rgba="1 0 0 1"/>'
        for name, quat, more in zip(joints, turned, special, strict=False)
    )
    closed = "</body>" * len(joints)
    return mujoco.MjModel.from_xml_string(
        f"<mujoco><worldbody>{opened}{inside}{closed}</worldbody></mujoco>"
    )


def test_quaternions_end_with_their_scalar():
    half = np.sqrt(0.5)
    model = _tiny(inside='<site name="imu" quat="0 1 0 0"/>')
    description = mjcf.describe(model)
    np.testing.assert_allclose(description.bodies[1].rotation, (0, 0, half, half), atol=ROUNDING)
    np.testing.assert_allclose(description.bodies[2].rotation, (0, 0, 0, 1), atol=ROUNDING)
    np.testing.assert_allclose(description.imu_rotation, (1, 0, 0, 0), atol=ROUNDING)


SITE = '<site name="imu"/>'


@pytest.mark.parametrize(
    ("model", "message"),
    [
        (lambda: _tiny(), "no site 'imu'"),
        (lambda: _tiny(JOINTS[::-1], SITE), "must be base_roll, base_pitch"),
        (lambda: _tiny(JOINTS[:5], SITE), "must be base_roll, base_pitch"),
        (lambda: _tiny(inside=f'{SITE}<joint name="more"/>'), "'inner' has several joints"),
        (lambda: _tiny(inside=SITE, first='type="slide"'), "'base_roll' must be a hinge"),
        (lambda: _tiny(inside=SITE, first='pos="0 .1 0"'), "'base_roll' must lie at its body"),
        (lambda: _tiny(inside=SITE, first='ref="10"'), "'base_roll' must lie at its body"),
        (
            lambda: _tiny(inside=f'{SITE}<geom name="egg" type="ellipsoid" size=".1 .1 .2"/>'),
            "'egg' must be one of",
        ),
    ],
)
def test_other_models_are_refused(model, message):
    with pytest.raises(StandError, match=message):
        mjcf.describe(model())


def test_loads_from_any_folder_and_leaves_nothing_there(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    mjcf._compiled.cache_clear()
    assert mjcf.load_model().njnt == 6
    assert list(tmp_path.iterdir()) == []


def test_its_copies_written_out_are_those_that_mujoco_makes():
    """The same model to the byte; what this reading does not know is left to MuJoCo."""
    assert _bytes_of(spec_of("turntable.xml", mjcf.contents_of(MODELS / "turntable.xml"))) == (
        _bytes_of(mujoco.MjSpec.from_file(str(MODELS / "turntable.xml")))
    )
    others = (
        '<replicate count="3" euler="0 0 9" offset="0 1 0"><geom name="a" size="1"/></replicate>'
        '<replicate count="11" euler="7 0 9" ><site name="b"/></replicate>'
        '<replicate count="2" euler="0 0 9"><body><geom size="1" pos="1 0 0"/></body></replicate>'
        '<replicate count="2" euler="0 8 0"><replicate count="10" euler="1 2 3">'
        '<geom name="c" size="1" pos="1 2 0"/></replicate></replicate>'
    )
    text = f"<mujoco><worldbody>{others}</worldbody></mujoco>"
    ours = spec_of("other.xml", {"other.xml": text.encode()})
    assert _bytes_of(ours) == _bytes_of(mujoco.MjSpec.from_string(text))


def _bytes_of(spec: mujoco.MjSpec) -> bytes:
    model = spec.compile()
    buffer = np.empty(mujoco.mj_sizeModel(model), np.uint8)
    mujoco.mj_saveModel(model, None, buffer)
    return buffer.tobytes()


def test_the_loaded_model_is_the_callers_own():
    mine = mjcf.load_model()
    mine.dof_armature[:] = 1e15
    assert mjcf.load_model().dof_armature.max() < 1.0


def test_hash_covers_every_mjcf_file_in_order_of_names():
    paths = sorted(MODELS.rglob("*.xml"), key=lambda path: path.relative_to(MODELS).as_posix())
    assert [path.name for path in paths] == ["imu.xml", "turntable.xml"]
    content = b"".join(path.read_bytes() for path in paths)
    assert mjcf.describe(mjcf.load_model()).sha256 == hashlib.sha256(content).hexdigest()


def test_gravity_is_standard_and_solids_do_not_push():
    model = mjcf.load_model()
    np.testing.assert_array_equal(model.opt.gravity, (0, 0, -9.80665))
    assert model.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
