"""The stand as a machine: servo runs from procedure to recording, and what they leave behind."""

import csv
import json

import numpy as np
import pytest
from rerun.chunk import RrdReader
from rosbags.highlevel import AnyReader
from scipy.spatial.transform import Rotation

from alignment import Site
from alignment.quaternions import prefix_product
from stand.imu import load_imu
from stand.motion.polynomial import MotionKind, fitted
from stand.physics.mjcf import load_model
from stand.physics.servo import Servo
from stand.physics.truth import Sampling, Truth
from stand.procedure.procedure import procedure_from
from stand.recorded_run import run
from stand.recording.log import load_log
from stand.recording.mcap import read_metadata, read_truth
from stand.simulation.settings import assembled
from stand.simulation.simulation import Simulation
from stand.table.table import load_table
from stand.toml_files import Source

ARC_SECOND = np.pi / 180 / 3600
LATITUDE = np.radians(48.5)
EARTH = 7.292115e-5 * np.array([0.0, np.cos(LATITUDE), np.sin(LATITUDE)])  # ENU
HEAD = """
title = "T"
table = "mid-class"
[site]
latitude_deg = 48.5
[estimate]
methods = ["triad"]
"""
STEPS = """
[[step]]
kind = "dwell"
label = "before"
duration_s = 4
[[step]]
kind = "move"
label = "over"
joints_deg = { outer = 60, middle = -40, inner = 170 }
[[step]]
kind = "dwell"
label = "after"
duration_s = 5
"""


def made(text: str, table: str | None = None, imu: str = "ideal", rate_hz: int = 50, **changes):
    procedure = procedure_from(Source("p", "p.toml", text))
    chosen = load_table(table) if table else None
    return assembled(procedure, load_imu(imu), chosen, rate_hz=rate_hz, **{"seed": 3} | changes)


def recorded(settings, out):
    return run(settings, out, False, lambda done: None)


# --- truth of a servo run


def rocking(seconds: float):
    """All six axes at once, 0.1 to 0.23 Hz, from rest to rest."""
    amplitude = np.radians([10, 8, 6, 20, 15, 25])
    w = 2 * np.pi * np.array([0.15, 0.2, 0.1, 0.12, 0.17, 0.23])

    def fade(t):
        x = np.clip(t / 5, 0, 1)
        return x**5 * (126 - 420 * x + 540 * x**2 - 315 * x**3 + 70 * x**4)

    def angles(t):
        size = fade(t) * fade(seconds - t)
        return size[:, None] * amplitude * np.sin(w * t[:, None] + 0.7 * np.arange(6))

    return fitted(angles, np.linspace(0, seconds, round(10 * seconds) + 1))


@pytest.mark.slow
@pytest.mark.parametrize("table", ["laboratory", "rocking-platform"])
@pytest.mark.parametrize(("rate_hz", "bound"), [(200, 0.005), (1000, 0.0001)])
def test_rates_of_a_servo_run_integrate_back_to_its_attitude(table, rate_hz, bound):
    """Within `bound` arc seconds after 120 s, by the three-sample coning formula.

    Measured: 5e-5 at 200 Hz, 7e-6 at 1 kHz; what is left is the formula's own error on the
    ripple of cogging and friction.
    """
    model = load_model()
    servo, truth = Servo(model, load_table(table), rocking(130.0)), Truth(model, Site(LATITUDE))
    blocks = [
        truth.block(
            servo.covering(k, k + 5), rate_hz, Sampling.MEAN, k * rate_hz, (k + 5) * rate_hz
        )
        for k in range(0, 125, 5)
    ]
    w = np.vstack([b.w_ib_b for b in blocks]) / rate_hz
    q_wb = Rotation.from_quat(np.vstack([b.q_wb for b in blocks]))
    p, d, n = w[:-2], w[1:-1], w[2:]
    steps = d + 7 / 120 * (np.cross(p, d) + np.cross(d, n)) - np.cross(p, n) / 60
    turned = Rotation.from_quat(prefix_product(Rotation.from_rotvec(steps).as_quat()))
    t = np.arange(1, len(w)) / rate_hz  # end of sample k at (k + 1) / rate
    inertial = Rotation.from_rotvec(np.outer(t, EARTH)) * q_wb[:-1]
    error = ((inertial[0] * turned).inv() * inertial[1:]).magnitude() / ARC_SECOND
    moved = np.degrees(np.abs(np.vstack([b.joints for b in blocks])).max(axis=0))
    assert (moved > 5).all()  # it did rock about all six axes
    assert error[120 * rate_hz] < bound
    assert error.max() < bound


# --- runs


@pytest.fixture(scope="module")
def servo_run(tmp_path_factory):
    """A mid-class table with its errors, its servos and a noisy unit."""
    settings = made(HEAD + STEPS, imu="ring-laser", motion=MotionKind.SERVO)
    return recorded(settings, tmp_path_factory.mktemp("machine") / "run")


def joints(path, topic):
    with AnyReader([path / "run.mcap"]) as reader:
        connections = [c for c in reader.connections if c.topic == topic]
        return np.array(
            [
                reader.deserialize(raw, c.msgtype).position
                for c, _, raw in reader.messages(connections)
            ]
        )


def test_a_servo_run_tells_how_each_step_went(servo_run):
    before, over, after = servo_run.records
    assert (before.rests, over.rests, after.rests) == (True, False, True)
    # starting settled, an axis does not move: 1e-9 rad is 0.2 milli arc seconds
    assert before.following_max.max() < 1e-9
    assert before.settled == 0.0
    # a mid-class move at its limits: seconds to a minute of arc, without saturation
    assert 0.1 * ARC_SECOND < over.following_max[3:].max() < 60 * ARC_SECOND
    assert over.saturated.max() == 0
    assert 0.02 < over.torque_ratio[3:].max() < 1
    assert after.settled is not None
    told = json.loads((servo_run.out / "result.json").read_text())
    assert told["motion"] == "servo"
    assert [s["label"] for s in told["steps"]] == ["before", "over", "after"]
    assert set(told["steps"][1]["following_max_arc_s"]) == {
        "base_roll", "base_pitch", "base_yaw", "outer", "middle", "inner"
    }  # fmt: skip


def test_encoders_and_truth_differ_by_the_tables_errors(servo_run):
    """In the rests: truth minus reading is what was drawn, to the encoder's step."""
    errors = read_metadata(servo_run.out / "run.mcap")["table_errors"]
    assert json.loads(errors["axes"])[3] == "outer"
    placement = np.array(json.loads(errors["placement_arc_s"])) * ARC_SECOND
    step = np.array(json.loads(errors["encoder_step_arc_s"])) * ARC_SECOND
    cos, sin = (np.array(json.loads(errors["encoder_once_arc_s"])).T) * ARC_SECOND
    cos2, sin2 = (np.array(json.loads(errors["encoder_twice_arc_s"])).T) * ARC_SECOND
    said, true = (joints(servo_run.out, topic)[-1] for topic in ("/joint_states", "/joint_truth"))
    q = said
    curve = cos * np.cos(q) + sin * np.sin(q) + cos2 * np.cos(2 * q) + sin2 * np.sin(2 * q)
    # half a step of rounding; the curve's slope times that is nothing beside it
    assert (np.abs(true - said - placement - curve) <= 0.5001 * step + 1e-12).all()
    assert np.abs(true - said).max() > ARC_SECOND
    # within the following error and half a step of the angles that were demanded
    wanted = np.radians([0, 0, 0, 60, -40, 170])
    assert (np.abs(said - wanted) <= 0.5001 * step + 10 * ARC_SECOND).all()


def test_the_recorded_truth_is_that_of_the_faulty_table(servo_run):
    """The recorded attitude is off the nominal one by arc seconds, and not by arc minutes."""
    log = read_truth(servo_run.out / "run.mcap")
    n_b = Rotation.from_matrix([[0, 1, 0], [1, 0, 0], [0, 0, -1]]) * Rotation.from_quat(
        log.q_wb[-1]
    )
    off = (servo_run.plan.steps[-1].C_nb.inv() * n_b).magnitude() / ARC_SECOND
    assert 3 < off < 300  # class figures of 3 to 30 arc seconds, some ten of them


def test_estimates_from_the_recording_equal_those_of_the_run(servo_run):
    log = load_log(servo_run.out / "run.mcap", None, None, None)
    assert [d.label for d in log.dwells] == ["before", "after"]
    begins = [d.t_from for d in log.dwells]
    settled = [r.t_from + r.settled for r in servo_run.records if r.rests]
    assert begins == pytest.approx(settled, abs=1e-9)


def test_the_same_seed_gives_the_same_bytes(servo_run, tmp_path):
    again = recorded(servo_run.settings, tmp_path / "again")
    first, second = ((r.out / "run.mcap").read_bytes() for r in (servo_run, again))
    assert first == second


def test_a_dwell_counts_only_once_settled(tmp_path):
    """Within 1e-6 arc seconds takes a second or two: of a rest of 1 s nothing counts."""
    text = load_table("mid-class").text
    head, tail = text.split("within_arc_s = ")
    path = tmp_path / "strict.toml"
    path.write_text(head + "within_arc_s = 1e-6\n" + tail.split("\n", 1)[1])
    for seconds, name in (("5", "slow"), ("1", "never")):
        steps = STEPS.replace("duration_s = 5", f"duration_s = {seconds}")
        settings = made(HEAD + steps, table=str(path), motion=MotionKind.SERVO)
        result = recorded(settings, tmp_path / name)
        after = result.records[-1]
        settled = read_metadata(result.out / "run.mcap").get("settled", {})
        labels = {s.estimate.label for s in result.scores}
        if name == "slow":
            assert after.settled is not None
            assert 0.0 < after.settled < 4.5
            begin = after.t_from + after.settled
            (estimate,) = [s.estimate for s in result.scores if s.estimate.label == "after"]
            assert estimate.t_from == pytest.approx(begin, abs=1e-9)
            assert float(settled["after"]) == pytest.approx(begin, abs=1e-9)
        else:
            assert after.settled is None
            assert settled["after"] == "never"
            assert "after" not in labels
            log = load_log(result.out / "run.mcap", None, None, None)
            assert "after" not in [d.label for d in log.dwells]


def test_ideal_motion_of_a_true_table_is_the_plan(tmp_path):
    simulation = Simulation(made(HEAD + STEPS, true_table=True))
    assert simulation.errors.perfect
    for block in simulation.blocks():
        planned = simulation.plan.motion.joints(block.truth.t_ns * 1e-9)[0]
        # stamps in nanoseconds are the sample times to 1e-15 s, at rates of a few rad/s
        assert np.abs(block.truth.joints - planned).max() < 1e-13
        assert np.array_equal(block.truth.encoders, block.truth.joints)
    assert simulation.records() == ()


def test_a_plan_beyond_the_limits_leaves_nothing_behind(stand_command, tmp_path):
    path = tmp_path / "fast.toml"
    path.write_text(
        HEAD + '[[step]]\nkind = "rate"\nlabel = "spin"\naxis = "outer"\nrate_deg_s = 5000\n'
        "duration_s = 3\n"
    )
    out = tmp_path / "run"
    told = stand_command("run", path, "--out", out)
    assert told.code == 2
    assert told.out == ""
    assert 'step 1 "spin", outer: rate 5000 deg/s at ' in told.err
    assert "or less would do" in told.err
    assert not out.exists()
    assert list(tmp_path.iterdir()) == [path]


def test_a_servo_needs_motors(stand_command, tmp_path):
    table = tmp_path / "bare.toml"
    text = load_table("mid-class").text
    begin = text.index("[axis.middle.motor]")
    table.write_text(text[:begin] + text[text.index("[", begin + 1) :])
    out = tmp_path / "run"
    options = ("--table", table, "--out", out)
    told = stand_command("run", "two-position", "--motion", "servo", *options)
    assert told.code == 2
    assert told.err.strip() == (
        "stand: table bare: axis middle, motor: required for --motion servo"
    )
    assert not out.exists()


SWAYING = """
title = "Sway"
table = "rocking-platform"
[site]
latitude_deg = 48.5
[estimate]
methods = ["fine"]
[[step]]
kind = "dwell"
label = "swaying"
duration_s = 120
[[background]]
kind = "sway"
axes = { base_roll = { rms_deg = 2, frequency_hz = 0.2 } }
"""


def test_a_filters_innovations_are_recorded_and_its_errors_are_those_of_the_time(tmp_path):
    result = recorded(made(SWAYING, imu="ring-laser"), tmp_path / "run")
    text = (result.out / "innovations.csv").read_text(encoding="utf-8")
    rows = list(csv.DictReader(text.splitlines()))
    assert {r["label"] for r in rows} == {"swaying"}
    assert len(rows) >= 1200  # ten updates a second or more
    late = [r for r in rows if float(r["time_s"]) > 60]
    ratio = [float(r[f"innovation_{a}_m"]) / float(r[f"sigma_{a}_m"]) for r in late for a in "NED"]
    # not larger than the filter expects; smaller, for an arm of 0.73 m has updates taken coarse
    assert 0.1 < np.mean(np.square(ratio)) < 1.5
    # the error over time is against the attitude of that time: the base sways by degrees
    errors = roll_errors(result.out / "run.rrd")
    late = errors[np.isfinite(errors)][-20:]
    assert len(late) == 20
    assert np.abs(late).max() < 0.05


def roll_errors(path):
    """Roll error of `fine` over time [deg], from the review."""
    values = []
    for chunk in RrdReader(str(path)).stream():
        if str(chunk.entity_path) == "/angles/roll/0_fine":
            batch = chunk.to_record_batch()
            if "Scalars:scalars" in batch.schema.names:
                values += [row[0] for row in batch.column("Scalars:scalars").to_pylist() if row]
    return np.array(values, dtype=float)
