"""A stand of the user's own: its MJCF checked, and taken wherever the shipped one would be."""

# pyright: reportAttributeAccessIssue=false

import hashlib
import json
from dataclasses import replace
from pathlib import Path

import chain
import numpy as np
import pytest
from mcap.reader import make_reader
from scipy.spatial.transform import Rotation

from alignment import Site
from stand.errors import StandError
from stand.imu import load_imu
from stand.imu.priors import BASE_ARM, GIMBAL_ARM
from stand.motion.moves import joined, move_piece
from stand.motion.polynomial import MotionKind
from stand.physics.mjcf import contents_of, describe, load_model
from stand.physics.picture import pictures
from stand.physics.servo import Servo
from stand.physics.truth import Truth
from stand.procedure.procedure import load_procedure
from stand.recording import attached_model
from stand.rehearsal.rehearse import rehearse
from stand.report import gallery
from stand.simulation.monte_carlo import Trials
from stand.simulation.settings import Settings, assembled
from stand.simulation.simulation import Simulation
from stand.table.joints import JOINTS
from stand.table.kinematics import base_arm, gimbal_arm
from stand.table.table import load_table

# From hinge to hinge and to the instrument: no two axes cross.
OFFSETS = np.array(
    [
        [0.10, -0.20, 0.50],
        [0.02, 0.03, 0.04],
        [-0.01, 0.05, 0.06],
        [0.07, -0.04, 0.90],
        [0.03, 0.02, -0.05],
        [-0.06, 0.01, 0.08],
        [0.09, 0.11, 0.13],
    ]
)
AXES = ("0 1 0", "1 0 0", "0 0 1", "0 0 1", "1 0 0", "0 1 0")
MASSES = (60, 50, 40, 30, 8, 3)
SENSORS = """
  <accelerometer site="imu"/> <gyro site="imu"/> <velocimeter site="imu"/>
  <magnetometer site="imu"/> <framequat objtype="site" objname="imu"/>
"""
# A tetrahedron, named in a folder of its own.
MESH = "v 0 0 0\nv .1 0 0\nv 0 .2 0\nv 0 0 .3\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"
MOTORS = "".join(
    f'<dcmotor name="drive of {name}" joint="{name}" motorconst="1 1" resistance="1" input="pos"/>'
    for name in reversed(JOINTS)  # the order of the motors is the user's
)


def numbers(vector) -> str:
    return " ".join(repr(float(x)) for x in vector)


def mjcf() -> str:
    opened = "".join(
        f'<body name="{name}" pos="{numbers(offset)}"><joint name="{name}" axis="{axis}"/>'
        f'<inertial pos="0 0 0" mass="{mass}" diaginertia="{mass / 20} {mass / 20} {mass / 20}"/>'
        for name, offset, axis, mass in zip(JOINTS, OFFSETS, AXES, MASSES, strict=False)
    )
    return f"""<mujoco>
  <compiler meshdir="shapes"/>
  <option gravity="0 0 -9.81"/>
  <asset><mesh name="wedge" file="wedge.obj"/></asset>
  <worldbody>{opened}
    <geom name="wedge" type="mesh" mesh="wedge" mass="0"/>
    <include file="parts/seat.xml"/>
  {"</body>" * 6}</worldbody>
  <actuator>{MOTORS}</actuator>
  <sensor>{SENSORS}</sensor>
</mujoco>
"""


SEAT = f"""<mujocoinclude>
  <site name="imu" pos="{numbers(OFFSETS[6])}" quat=".5 .5 .5 .5"/>
</mujocoinclude>
"""


def write(folder: Path, text: str) -> Path:
    """The user's files: stand/own.xml, its part and its mesh."""
    for name, content in (
        ("own.xml", text), ("parts/seat.xml", SEAT), ("shapes/wedge.obj", MESH)
    ):  # fmt: skip
        path = folder / "stand" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(content)
    return folder / "stand" / "own.xml"


def write_table(folder: Path, more: str = 'model = "stand/own.xml"') -> Path:
    """The laboratory's table class with a stand of its own."""
    path = folder / "own.toml"
    path.write_text(f"{more}\n{load_table('laboratory').text}")
    return path


@pytest.fixture(scope="module")
def own(tmp_path_factory):
    """The table's file; the user works in another folder."""
    folder = tmp_path_factory.mktemp("own")
    write(folder, mjcf())
    return write_table(folder)


@pytest.fixture(scope="module")
def model(own):
    return load_model(load_table(str(own)).model)


PROCEDURE = """
title = "All axes"
[site]
latitude_deg = 48.5
[estimate]
methods = ["triad"]
[[step]]
kind = "move"
label = "over"
joints_deg = {base_roll = 10, base_pitch = -8, base_yaw = 15, outer = 60, middle = -40, inner = 90}
[[step]]
kind = "dwell"
label = "there"
duration_s = 4
[[step]]
kind = "move"
label = "back"
attitude_deg = { pitch = 90 }
[[step]]
kind = "dwell"
label = "X1 up"
duration_s = 4
"""


@pytest.fixture(scope="module")
def settings(own):
    path = own.with_name("all-axes.toml")
    path.write_text(PROCEDURE)
    procedure = load_procedure(str(path))
    entry = procedure.entry
    return Settings(
        procedure=procedure,
        imu=load_imu("ideal"),
        table=load_table(str(own)),
        site=entry.site.site(),
        options=entry.estimate.options(),
        rate_hz=50,
    )


def closed_form(q, v, a, site: Site):
    return chain.offset_sensors(q, v, a, site.latitude, site.gravity, OFFSETS)


# --- its truth -----------------------------------------------------------------------------------


def test_the_oracle_is_the_shipped_stands_chain_where_axes_cross():
    """`offset_sensors` against `sensors`, which shares only the single turn with it."""
    rng = np.random.default_rng(4)
    q, v, a = rng.uniform(-3, 3, (3, 200, 6))
    zero = np.zeros(3)
    crossing = chain.CROSSING - chain.BASE
    offsets = np.array([chain.BASE, zero, zero, crossing, zero, zero, chain.LEVER])
    w, f, C = chain.offset_sensors(q, v, a, 0.8, 9.81, offsets)
    w_known, f_known = chain.sensors(q, v, a, 0.8, 9.81)
    # rounding of values up to 100 m/s^2
    assert np.abs(f - f_known).max() < 1e-12
    assert np.abs(w - w_known).max() < 1e-13
    assert np.abs(C - chain.pose(q)[0]).max() < 1e-14


def test_offsets_by_hand(model):
    """Outer at 2 rad/s: its axis lies 0.06 m west and 0.14 m south of the point.

    0.03 - 0.06 + 0.09 = 0.06 m east, 0.02 + 0.01 + 0.11 = 0.14 m north: rate^2 times that inward.
    """
    v = np.zeros((1, 6))
    v[0, 3] = 2.0
    site = Site(0.0)
    still, turning = (
        Truth(model, site).instants(np.zeros((1, 6)), rate, np.zeros((1, 6))).f_b[0]
        for rate in (np.zeros((1, 6)), v)
    )
    # Coriolis of the Earth: 2 W v = 1.5e-4 * 0.3 m/s, below 5e-5 m/s^2
    np.testing.assert_allclose(turning - still, [-4 * 0.14, 0, -4 * 0.06], atol=5e-5)


def test_instants_are_those_of_its_own_chain(model):
    rng = np.random.default_rng(5)
    q = rng.uniform(-3, 3, (1500, 6))
    v = rng.uniform(-1, 1, (1500, 6)) * np.radians([30, 30, 30, 100, 100, 100])
    a = rng.uniform(-1, 1, (1500, 6)) * np.radians([60, 60, 60, 200, 200, 200])
    site = Site(np.radians(48.5))
    found = Truth(model, site).instants(q, v, a)
    w, f, C = closed_form(q, v, a, site)
    # rounding: some 50 operations on values up to 50 m/s^2
    assert np.abs(found.f_b - f).max() < 1e-12
    assert np.abs(found.w_ib_b - w).max() < 1e-13
    assert np.abs(Rotation.from_quat(found.q_wb).as_matrix() - C).max() < 1e-14


def test_a_run_on_it_has_the_means_of_its_own_chain(settings):
    simulation = Simulation(settings)
    motion, rate = simulation.plan.motion, settings.rate_hz
    blocks = [block.truth for block in simulation.blocks()]
    edges = np.arange(simulation.total + 1) / rate
    x, weight = np.polynomial.legendre.leggauss(8)
    inside = (motion.knots > edges[0]) & (motion.knots < edges[-1])
    ends = np.unique(np.concatenate([edges, motion.knots[inside]]))
    h = np.diff(ends)
    t = (ends[:-1, None] + h[:, None] * (x + 1) / 2).ravel()
    values = np.hstack(closed_form(*motion.joints(t), settings.site)[:2])
    parts = np.einsum("k,nkj->nj", weight / 2, values.reshape(-1, 8, 6)) * h[:, None]
    starts = np.searchsorted(ends, edges[:-1])
    means = np.add.reduceat(parts, starts) / np.add.reduceat(h, starts)[:, None]
    # what the quadrature promises
    assert np.abs(np.vstack([b.f_b for b in blocks]) - means[:, 3:]).max() < 1e-9
    assert np.abs(np.vstack([b.w_ib_b for b in blocks]) - means[:, :3]).max() < 1e-11
    # and its attitude is the one that was asked for: X1 up
    np.testing.assert_allclose(blocks[-1].f_b[-1], [settings.site.gravity, 0, 0], atol=1e-9)


# --- wherever a model is taken -------------------------------------------------------------------


def test_its_servos_are_its_own_motors_with_the_tables_values(model, own):
    table = load_table(str(own))
    motion = rolled(table)
    servo = Servo(model, table, motion)
    lean = servo.drive.model
    assert [lean.actuator(i).name for i in range(6)] == [f"drive of {name}" for name in JOINTS]
    assert [lean.joint(lean.actuator_trnid[i, 0]).name for i in range(6)] == list(JOINTS)
    np.testing.assert_array_equal(lean.actuator_forcerange[:, 1], table.torque)
    # the inner axis carries 3 kg with 0.15 kg m^2, and the seat nothing
    assert servo.drive.inertia[5] == pytest.approx(0.15)
    realised = servo.covering(0.0, motion.duration)
    t = np.linspace(0, motion.duration, 50)
    # an axis that is lost is off by degrees; friction and cogging leave seconds of arc
    assert np.abs(realised.joints(t)[0] - motion.joints(t)[0]).max() < np.radians(0.05)


def rolled(table):
    """Half a radian of inner, from rest to rest."""
    target = np.array([0, 0, 0, 0, 0, 0.5])
    piece = move_piece(np.zeros(6), target, table.rate, table.acceleration, table.jerk)
    return joined([piece])


def test_armature_of_a_joint_counts(tmp_path):
    text = mjcf().replace('<joint name="inner"', '<joint name="inner" armature="0.4"')
    loaded, table = load_model(write(tmp_path, text)), load_table("laboratory")
    servo = Servo(loaded, table, rolled(table))
    assert servo.drive.inertia[5] == pytest.approx(0.15 + 0.4)


def test_hash_covers_the_file_its_parts_and_its_meshes(own, model):
    folder = own.parent / "stand"
    names = ("own.xml", "parts/seat.xml", "shapes/wedge.obj")
    content = b"".join((folder / name).read_bytes() for name in names)
    assert describe(model).sha256 == hashlib.sha256(content).hexdigest()
    contents = contents_of(folder / "own.xml")
    assert contents == {name: (folder / name).read_bytes() for name in names}
    assert next(iter(contents)) == "own.xml"  # the one to open


def test_a_file_that_changes_is_loaded_anew(tmp_path):
    path = write(tmp_path, mjcf())
    before = load_model(path)
    write(tmp_path, mjcf().replace("0.9", "0.8"))
    assert load_model(path).body("outer").pos[2] == before.body("outer").pos[2] - 0.1


def test_a_mesh_is_described_by_the_box_around_it(model):
    (solid,) = [g for body in describe(model).bodies for g in body.geoms]
    assert (solid.name, solid.kind) == ("wedge", "box")
    corners = Rotation.from_quat(solid.rotation).apply(
        [[x, y, z] * solid.size for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
    )
    # MuJoCo turns a mesh into its principal axes: a box around it there holds its corners
    for corner in ((0, 0, 0), (0.1, 0, 0), (0, 0.2, 0), (0, 0, 0.3)):
        inside = Rotation.from_quat(solid.rotation).inv().apply(corner - solid.position)
        assert (np.abs(inside) <= solid.size + 1e-7).all()  # meshes are of single precision
    assert np.linalg.norm(np.ptp(corners, axis=0)) < 0.7


def test_the_lever_arm_of_its_base(model):
    """Heights above the roll axis: 0.04 + 0.06 + 0.90 - 0.05 + 0.08 + 0.13 = 1.16 m."""
    assert base_arm(describe(model)) == pytest.approx(1.16, abs=1e-12)
    assert base_arm(describe(load_model())) == pytest.approx(BASE_ARM, abs=1e-12)


def test_the_lever_arm_of_its_gimbals(model):
    """Across the middle axis, which points east: 0.01 + 0.11 = 0.12 m and 0.08 + 0.13 = 0.21 m."""
    by_hand = np.sqrt((0.12**2 + 0.21**2) / 2)
    assert gimbal_arm(describe(model)) == pytest.approx(by_hand, abs=1e-12)
    shipped = np.sqrt((0.06**2 + 0.05**2) / 2)  # docs: (0.04, 0.06, 0.05) m from the crossing
    assert gimbal_arm(describe(load_model())) == pytest.approx(shipped, abs=1e-12)
    assert pytest.approx(shipped, abs=1e-6) == GIMBAL_ARM


def test_a_rocking_base_tells_estimators_of_its_lever_arm(own, settings):
    swaying = load_procedure("random-sway")
    unit = load_imu("ring-laser")
    for table, arm in ((load_table(str(own)), 1.16), (load_table("rocking-platform"), BASE_ARM)):
        asked = assembled(swaying, unit, table, settings.site)
        assert asked.options.priors.lever_arm == pytest.approx(arm, abs=1e-12)
    still = assembled(settings.procedure, unit, load_table(str(own)), settings.site)
    assert still.options.priors.lever_arm == 0.0


@pytest.fixture(scope="module")
def recorded(own, settings, stand_command):
    out = own.with_name("run")
    done = stand_command(
        "run", settings.procedure.name, "--table", own, "--imu", "ring-laser", "--rate", 20,
        "--out", out,
    )  # fmt: skip
    assert done.code == 0, done.err
    return out


def test_a_recording_holds_its_stand(own, recorded, model):
    with open(recorded / "run.mcap", "rb") as file:
        reader = make_reader(file)
        attached = {a.name: a.data for a in reader.iter_attachments()}
        run = {m.name: m.metadata for m in reader.iter_metadata()}["run"]
        (urdf,) = [
            m.data.decode(errors="ignore")
            for _, c, m in reader.iter_messages(topics=["/robot_description"])
        ]
    assert (run["model"], run["model_sha256"]) == ("own.xml", describe(model).sha256)
    files = {n: d for n, d in attached.items() if n.startswith("model/")}
    assert files == {f"model/{n}": d for n, d in contents_of(own.parent / "stand/own.xml").items()}
    assert 'xyz="0.07 -0.04 0.9"' in urdf  # of the outer axis on the base's yaw


def test_the_shipped_stand_is_not_attached(stand_command, settings, tmp_path):
    path = tmp_path / "run"
    assert stand_command("run", settings.procedure.name, "--rate", 2, "--out", path).code == 0
    with open(path / "run.mcap", "rb") as file:
        reader = make_reader(file)
        assert not [a for a in reader.iter_attachments() if a.name.startswith("model")]
        run = {m.name: m.metadata for m in reader.iter_metadata()}["run"]
    assert "model" not in run
    assert run["model_sha256"] == describe(load_model()).sha256


@pytest.fixture
def drawn(monkeypatch):
    """The models of which pictures were asked for, as they were loaded."""
    found = []

    def fake(joints, camera, width, height, model=None):
        found.append(load_model(model).body("outer").pos.tolist())
        return [np.full((4, 4, 3), 7, np.uint8) for _ in joints]

    monkeypatch.setattr(gallery, "pictures", fake)
    return found


def test_the_page_of_a_recording_draws_its_stand(stand_command, recorded, tmp_path, drawn):
    copy = tmp_path / "elsewhere.mcap"
    copy.write_bytes((recorded / "run.mcap").read_bytes())
    assert stand_command("report", copy, "--out", tmp_path / "page.html").code == 0
    assert drawn == [[0.07, -0.04, 0.9]]


def test_it_is_rehearsed_with_its_hash_and_drawn(own, settings, stand_command, tmp_path, drawn):
    report = tmp_path / "rehearsal"
    done = stand_command(
        "rehearse", settings.procedure.name, "--table", own, "--imu", "ring-laser", "--report",
        report, "--json",
    )  # fmt: skip
    assert done.code in (0, 1), done.err
    stated = json.loads((report / "rehearsal.json").read_text())
    assert stated["inputs"]["sha256"]["model"] == describe(load_table_model(own)).sha256
    assert drawn == [[0.07, -0.04, 0.9]]


def load_table_model(own):
    return load_model(load_table(str(own)).model)


def test_its_torque_is_judged(own, settings):
    """Twice the mass everywhere takes twice the torque, friction aside."""

    def greatest(table):
        asked = assembled(settings.procedure, settings.imu, table, settings.site)
        margins = [m for step in rehearse(asked).feasibility for m in step.margins]
        return max((m for m in margins if m.quantity == "torque"), key=lambda m: m.ratio)

    heavy = mjcf()
    for mass in MASSES:
        old = f'mass="{mass}" diaginertia="{mass / 20} {mass / 20} {mass / 20}"'
        new = f'mass="{mass * 2}" diaginertia="{mass / 10} {mass / 10} {mass / 10}"'
        heavy = heavy.replace(old, new)
    table = load_table(str(own))
    light = greatest(table)
    twice = greatest(replace(table, model=write(own.parent / "heavy", heavy)))
    assert light.axis == twice.axis
    axis = JOINTS.index(light.axis)
    friction = table.motors[axis].coulomb + table.motors[axis].viscous * table.rate[axis]
    assert twice.value == pytest.approx(2 * light.value, abs=friction)
    assert abs(light.value) > 10 * friction


@pytest.mark.parametrize("command", ["run", "rehearse", "compare", "export"])
def test_every_command_looks_for_the_model_of_the_table(command, tmp_path, stand_command):
    table = write_table(tmp_path, 'model = "none.xml"')
    where = {"run": ["--out", tmp_path / "out"], "export": ["--out", tmp_path / "out.csv"]}
    done = stand_command(command, "two-position", "--table", table, *where.get(command, []))
    assert (done.code, done.out) == (2, "")
    missing = "cannot read this model: No such file or directory"
    assert done.err.strip() == f"stand: {tmp_path / 'none.xml'}: {missing}"
    assert [path.name for path in tmp_path.iterdir()] == ["own.toml"]


def test_runs_of_a_comparison_are_on_it(settings):
    dwells, _ = Trials(settings).readings(1)
    whole = Simulation(settings)
    block = next(iter(whole.blocks())).truth
    first = dwells[0].window()
    there = block.f_b[round(first.t[0] * settings.rate_hz) - 1]
    np.testing.assert_allclose(first.f_b[0], there, rtol=0, atol=1e-12)


def test_a_servo_run_on_it_stays_near_the_plan(settings):
    simulation = Simulation(replace(settings, motion=MotionKind.SERVO))
    lag = np.vstack([simulation.following(block) for block in simulation.blocks()])
    assert 0 < np.abs(lag).max() < np.radians(0.1)
    assert all(record.settled is not None for record in simulation.records() if record.rests)


@pytest.mark.slow
def test_it_is_drawn(own, monkeypatch):
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    path = load_table(str(own)).model
    mine, shipped = (
        pictures([np.zeros(6)], "135,-18,2.9", 80, 60, model)[0] for model in (path, None)
    )
    assert mine.std() > 1
    assert (mine != shipped).mean() > 0.3


# --- what is wrong with a file -------------------------------------------------------------------


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('joint name="outer"', 'joint name="azimuth"', "no joint 'outer'; must be base_roll, "),
        ('joint name="outer"', 'joint name="outer" type="slide"', "'outer' must be a hinge"),
        ('joint name="outer"', 'joint name="outer" pos="0 0 .1"', "'outer' must lie at its body"),
        (
            'joint name="outer" axis="0 0 1"',
            'joint name="outer" axis="0 1 0"',
            "joint 'outer' turns about 0 1 0 at zero angles, must about 0 0 1",
        ),
        (
            '<include file="parts/seat.xml"/>',
            "",
            "no site 'imu'",
        ),
        (
            '<include file="parts/seat.xml"/>',
            '<site name="imu"/>',
            "site 'imu' must have x north, y up, z east",
        ),
        (
            '<include file="parts/seat.xml"/>',
            "</body><body><include file='parts/seat.xml'/>",
            "site 'imu' must be fixed to the body of 'inner'",
        ),
        ('<dcmotor name="drive of outer"', '<motor name="drive of outer"', "Schema violation"),
        (MOTORS, "", "joint 'base_roll' has no actuators, must have one: <dcmotor"),
        (
            MOTORS,
            MOTORS + '<motor joint="middle"/>',
            "joint 'middle' has 2 actuators, must have one",
        ),
        (MOTORS, MOTORS.replace('input="pos"', 'input="ff"'), "with 'pos' in its input"),
        (
            '<dcmotor name="drive of outer"',
            '<dcmotor gear="50" name="drive of outer"',
            "'drive of outer' must turn its joint directly, with gear 1",
        ),
        ('<gyro site="imu"/>', "", 'no sensor <gyro site="imu"/>'),
        (
            '<framequat objtype="site" objname="imu"/>',
            "",
            'no sensor <framequat objtype="site" objname="imu"/>',
        ),
        ("wedge.obj", "none.obj", "none.obj"),
        ("</mujoco>", "", "not XML: no element found: line"),
    ],
)
def test_each_fault_is_one_line_with_file_and_what_is_missing(
    tmp_path, stand_command, old, new, said
):
    assert old in mjcf()
    path = write(tmp_path, mjcf().replace(old, new, 1))
    with pytest.raises(StandError) as caught:
        load_model(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)
    done = stand_command("run", "static", "--table", write_table(tmp_path), "--out", tmp_path / "r")
    assert (done.code, done.out) == (2, "")
    assert done.err.strip() == f"stand: {caught.value}"
    assert not (tmp_path / "r").exists()


def test_axes_in_another_order_of_the_tree(tmp_path):
    """Outer on the world, beside the base: its joints are in order, its hinges are no chain."""
    text = mjcf().replace('<body name="outer"', '</body></body></body><body name="outer"')
    text = text.replace("</body></body></body></body></body></body>", "</body></body></body>")
    with pytest.raises(StandError, match="joint 'outer' must be carried by 'base_yaw'"):
        load_model(write(tmp_path, text))


@pytest.mark.parametrize(
    ("attached", "said"),
    [
        ("model/../../seat.xml", "attached file 'model/../../seat.xml' would leave its folder"),
        ("model/a\0b", "attached file 'model/a\\x00b' would leave its folder"),
        ("model/" + "a" * 300, "cannot write there"),
        (None, "run: model: 'model/own.xml' is not attached"),
    ],
)
def test_an_attached_file_does_not_leave_its_folder(
    stand_command, recorded, tmp_path, monkeypatch, attached, said
):
    files = {} if attached is None else {"model/own.xml": b"", attached: b""}
    monkeypatch.setattr(attached_model, "read_attachments", lambda path: files)
    done = stand_command("report", recorded, "--out", tmp_path / "page.html")
    assert done.code == 2
    assert said in done.err
    assert done.err.count("\n") == 1
    assert not (tmp_path / "page.html").exists()
