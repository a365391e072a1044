"""The shipped MJCF by itself: opened in MuJoCo, moved by its motors, read by its sensors."""

# pyright: reportAttributeAccessIssue=false

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from stand.motion.planner import plan
from stand.physics.mjcf import MAIN, describe, load_model, models_folder
from stand.procedure.procedure import load_procedure
from stand.table.joints import JOINTS
from stand.table.table import load_table

EAST, NORTH, UP = np.eye(3)
# Where X1, Y1, Z1 point, by hand.
POSITIONS = {
    "X1 up": (UP, -NORTH, EAST),
    "X1 down": (-UP, NORTH, EAST),
    "Y1 up": (NORTH, UP, EAST),
    "Y1 down": (NORTH, -UP, -EAST),
    "Z1 up": (NORTH, -EAST, UP),
    "Z1 down": (NORTH, EAST, -UP),
}
# Gimbals are balanced to half a millimetre (14 kg: 0.07 N m), and the softest servo has 33 N m/rad.
SAG = 2.1e-3  # rad


@pytest.fixture(scope="module")
def model():
    """As anybody opens it, by nothing of ours."""
    return mujoco.MjModel.from_xml_path(str(models_folder() / MAIN))


def stepped(model, data, seconds):
    for _ in range(round(seconds / model.opt.timestep)):
        mujoco.mj_step(model, data)
    assert data.warning.number.sum() == 0


def test_motors_and_sensors_are_named_after_the_axes(model):
    assert tuple(model.actuator(i).name for i in range(model.nu)) == JOINTS
    names = [model.sensor(i).name for i in range(model.nsensor)]
    assert names == [
        "accelerometer", "gyro", "velocimeter", "magnetometer", "attitude",
        *(f"{joint}_angle" for joint in JOINTS), *(f"{joint}_rate" for joint in JOINTS),
    ]  # fmt: skip
    assert [model.key(i).name for i in range(model.nkey)] == list(POSITIONS)


def test_sliders_span_the_travel_or_a_turn_either_way(model):
    table = load_table("laboratory")
    low, high = np.maximum(table.low, -2 * np.pi), np.minimum(table.high, 2 * np.pi)
    # four digits in the file
    np.testing.assert_allclose(model.actuator_ctrlrange, np.column_stack([low, high]), atol=1e-4)
    assert model.actuator_ctrllimited.all()


@pytest.mark.parametrize(
    ("joint", "angle"),
    [
        ("base_roll", 0.2),
        ("base_pitch", -0.25),
        ("base_yaw", 0.3),
        ("outer", 2.0),
        ("middle", -1.5),
        ("inner", 3.0),
    ],
)
def test_each_motor_moves_its_own_axis_to_the_angle(model, joint, angle):
    data = mujoco.MjData(model)
    data.actuator(joint).ctrl[:] = angle
    stepped(model, data, 1.0)
    # set points creep at 5 deg/s on the base and 30 on the table; an axis is behind by
    # 2 / (8 pi rad/s) = 0.08 s of that, less where an integrator takes it up
    creep = np.radians(5.0 if joint.startswith("base") else 30.0)
    assert 0.91 < np.sign(angle) * data.joint(joint).qpos[0] / creep < 1.0
    stepped(model, data, 8.0)
    others = [name for name in JOINTS if name != joint]
    assert data.joint(joint).qpos[0] == pytest.approx(angle, abs=SAG)
    assert max(abs(data.joint(name).qpos[0]) for name in others) < SAG
    assert np.abs(data.qvel).max() < 1e-3
    read = [data.sensor(f"{name}_angle").data[0] for name in JOINTS]
    # sensors are those of the step's begin: 1 ms at less than 1e-3 rad/s
    np.testing.assert_allclose(read, data.qpos, rtol=0, atol=1e-6)


def test_the_servos_hold_the_tilted_stand_within_their_torque(model):
    """15 deg of roll and pitch: a weight of 81.7 kg m times g, sin 15 deg = 0.2588: 207 N m."""
    data = mujoco.MjData(model)
    data.ctrl[:2] = 0.2618
    stepped(model, data, 12.0)
    np.testing.assert_allclose(data.qpos[:2], 0.2618, atol=1e-4)
    # of pitch by cos(roll) = 0.966 less
    assert abs(data.actuator("base_pitch").force[0]) == pytest.approx(207.4 * 0.966, rel=0.01)


@pytest.mark.parametrize("name", POSITIONS)
def test_at_rest_in_each_position_the_sensors_read_gravity(model, name):
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key(name).id)
    start = data.qpos.copy()
    stepped(model, data, 2.0)
    assert np.abs(data.qpos - start).max() < SAG  # the keyframe's servos hold it
    C = np.column_stack(POSITIONS[name])
    axis, sign = "XYZ".index(name[0]), 1 if name.endswith("up") else -1
    force = data.sensor("accelerometer").data
    assert force[axis] == pytest.approx(sign * 9.80665, abs=1e-4)
    assert np.abs(np.delete(force, axis)).max() < 9.81 * SAG
    for still in ("gyro", "velocimeter"):
        assert np.abs(data.sensor(still).data).max() < 1e-5
    w, x, y, z = data.sensor("attitude").data
    off = Rotation.from_matrix(C).inv() * Rotation.from_quat([x, y, z, w])
    assert off.magnitude() < SAG
    field = np.array([0.0, 0.21, -0.43])  # east, north, up
    np.testing.assert_allclose(data.sensor("magnetometer").data, field @ C, atol=0.5 * SAG)


def test_attitude_is_scalar_first(model):
    """Y1 down: half a turn about north after (1, 1, 1, 1)/2: (0, 0, 1, 0) times that, by hand."""
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("Y1 down").id)
    mujoco.mj_forward(model, data)
    attitude = data.sensor("attitude").data
    np.testing.assert_allclose(attitude * np.sign(attitude[0]), [0.5, -0.5, -0.5, 0.5], atol=1e-15)


def test_rate_and_velocity_of_a_turn(model):
    """Outer at 1 rad/s: up is Y1; the point, 0.04 east and 0.06 north of the axis, goes west."""
    data = mujoco.MjData(model)
    data.joint("outer").qvel[:] = 1.0
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose(data.sensor("gyro").data, [0, 1, 0], atol=1e-15)
    np.testing.assert_allclose(data.sensor("velocimeter").data, [0.04, 0, -0.06], atol=1e-15)
    assert data.sensor("outer_rate").data == [1.0]


def test_keyframes_are_the_positions_of_the_six_position_test(model):
    procedure = load_procedure("six-position")
    planned = plan(procedure, describe(load_model()), load_table("laboratory"))
    dwells = [step for step in planned.steps if step.kind == "dwell"]
    assert [step.label for step in dwells] == list(POSITIONS)
    for step in dwells:
        apart = model.key(step.label).qpos - step.joints
        assert np.abs(np.exp(1j * apart) - 1).max() < 1e-12


def test_a_keyframe_commands_where_it_stands(model):
    np.testing.assert_array_equal(model.key_ctrl, model.key_qpos)


def test_what_is_loaded_is_what_anybody_opens(model):
    """Every number of the model, the hash aside."""
    loaded = load_model()
    for name in ("body_pos", "body_inertia", "geom_size", "actuator_gainprm", "sensor_type"):
        np.testing.assert_array_equal(getattr(loaded, name), getattr(model, name))
    assert (loaded.ntext, model.ntext) == (1, 0)
