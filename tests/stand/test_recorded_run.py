"""Whole runs: what the recording holds, and what a six-position test must show."""

import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import chain
import numpy as np
import pytest
from rerun.chunk import RrdReader
from rosbags.highlevel import AnyReader
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from alignment.earth import Site
from alignment.quaternions import prefix_product
from stand.errors import StandError
from stand.evaluation.run_result import RunResult
from stand.evaluation.score import evaluate_each
from stand.imu import Imu, load_imu
from stand.physics.mjcf import load_model
from stand.physics.truth import Sampling, Truth
from stand.procedure.procedure import load_procedure
from stand.recorded_run import run
from stand.recording.log import load_log
from stand.recording.mcap import EPOCH_NS, read_metadata, read_truth
from stand.simulation.settings import assembled

ROOT = Path(__file__).resolve().parents[2]
ARC_SECOND = np.pi / 180 / 3600

TUMBLE = """
title = "Slews of all six axes at once"
[site]
latitude_deg = -33.0
height_m = 250.0
[estimate]
methods = ["triad"]
[move_limits]
rate_deg_s = 60.0
"""
MOVES = (
    "base_roll = 10, base_pitch = -12, base_yaw = 15, outer = 130, middle = 40, inner = -170",
    "base_roll = -10, base_pitch = 5, base_yaw = -15, outer = -50, middle = -70, inner = 60",
    "base_roll = 0, base_pitch = 0, base_yaw = 0, outer = 200, middle = 100, inner = 10",
)


def settings(name, imu="stim300", rate_hz=20, seed=0, **changes):
    return assembled(
        load_procedure(str(name)), load_imu(imu), rate_hz=rate_hz, seed=seed, **changes
    )


def record(made, out) -> RunResult:
    return run(made, out, False, lambda done: None)


@pytest.fixture(scope="module")
def tumble(tmp_path_factory):
    """An ideal unit at 200 Hz through slews of all six axes up to 60 deg/s."""
    folder = tmp_path_factory.mktemp("tumble")
    steps = "".join(
        f'[[step]]\nkind = "move"\nlabel = "m{k}"\njoints_deg = {{ {move} }}\n'
        f'[[step]]\nkind = "dwell"\nlabel = "d{k}"\nduration_s = 2\n'
        for k, move in enumerate(MOVES)
    )
    (folder / "tumble.toml").write_text(TUMBLE + steps)
    return record(settings(folder / "tumble.toml", "ideal", 200), folder / "run")


def test_recorded_mean_rates_integrate_back_to_the_recorded_attitude(tumble):
    """Within 0.001 arc second over the whole run, by the three-sample coning formula."""
    log = read_truth(tumble.out / "run.mcap")
    angle = log.w_ib_b / 200
    p, d, n = angle[:-2], angle[1:-1], angle[2:]
    steps = d + 7 / 120 * (np.cross(p, d) + np.cross(d, n)) - np.cross(p, n) / 60
    run_up = prefix_product(Rotation.from_rotvec(steps).as_quat())
    t = (log.t_ns[1:-1] - log.t_ns[0]) * 1e-9
    latitude = np.radians(-33.0)
    earth = chain.EARTH_RATE * np.array([0.0, np.cos(latitude), np.sin(latitude)])
    back = Rotation.from_rotvec(-t[:, None] * earth)
    integrated = back * Rotation.from_quat(log.q_wb[0]) * Rotation.from_quat(run_up)
    error = (integrated.inv() * Rotation.from_quat(log.q_wb[1:-1])).magnitude() / ARC_SECOND
    assert np.degrees(np.abs(log.w_ib_b).max()) > 60  # it did slew
    assert error.max() < 1e-3


def test_recorded_attitude_is_that_of_the_joint_states(tumble):
    """/imu/truth against plain rotation matrices at the recorded /joint_states."""
    log = read_truth(tumble.out / "run.mcap")
    with AnyReader([tumble.out / "run.mcap"]) as reader:
        connections = [c for c in reader.connections if c.topic == "/joint_states"]
        joints = [
            reader.deserialize(raw, c.msgtype).position
            for c, _, raw in reader.messages(connections)
        ]
    C, _ = chain.pose(np.array(joints))
    assert np.abs(Rotation.from_quat(log.q_wb).as_matrix() - C).max() < 1e-14


def test_ideal_unit_reports_the_truth_bit_for_bit(tumble):
    with AnyReader([tumble.out / "run.mcap"]) as reader:
        rows = {"/imu/data": [], "/imu/truth": []}
        for c, _, raw in reader.messages([c for c in reader.connections if c.topic in rows]):
            m = reader.deserialize(raw, c.msgtype)
            w, a = m.angular_velocity, m.linear_acceleration
            rows[c.topic].append((w.x, w.y, w.z, a.x, a.y, a.z))
    assert len(rows["/imu/data"]) == tumble.samples
    assert np.array_equal(rows["/imu/data"], rows["/imu/truth"])


@pytest.fixture(scope="module")
def laser(tmp_path_factory):
    """Six positions with the ring-laser unit at 20 Hz."""
    return record(
        settings("six-position", "ring-laser", seed=5), tmp_path_factory.mktemp("laser") / "run"
    )


def test_rosbags_reads_every_message_bit_exactly(laser):
    """Every value against the simulation made again, block by block of another length."""
    made = laser.settings
    truth = Truth(load_model(), made.site)
    unit = Imu(made.imu, made.seed, made.rate_hz)
    blocks = list(truth.blocks(laser.plan.motion, made.rate_hz, Sampling.MEAN, block_s=3.3))
    reported = [unit.report(block) for block in blocks]
    wanted = {
        "/imu/data": np.vstack([np.hstack([b.w_ib_b, b.f_b]) for b in reported]),
        "/imu/truth": np.vstack([np.hstack([b.w_ib_b, b.f_b, b.q_wb]) for b in blocks]),
        "/joint_states": np.vstack([np.hstack([b.encoders, b.encoder_rates]) for b in blocks]),
        "/joint_truth": np.vstack([np.hstack([b.joints, b.joint_rates]) for b in blocks]),
    }
    stamps = EPOCH_NS + np.concatenate([b.t_ns for b in blocks])
    found = {topic: [] for topic in wanted}
    counted = dict.fromkeys(("/tf", "/tf_static", "/robot_description", "/rosout"), 0)
    with AnyReader([laser.out / "run.mcap"]) as reader:
        for c, _, raw in reader.messages():
            m = reader.deserialize(raw, c.msgtype)
            if c.topic in counted:
                counted[c.topic] += 1
                continue
            stamp = m.header.stamp.sec * 10**9 + m.header.stamp.nanosec
            found[c.topic].append((stamp, *_values(c.topic, m)))
    for topic, rows in found.items():
        assert [row[0] for row in rows] == list(stamps), topic
        assert np.array_equal([row[1:] for row in rows], wanted[topic]), topic
    # 384 s at 20 Hz is below the 50 Hz limit of transforms; 12 steps are told
    assert counted == {"/tf": 7680, "/tf_static": 1, "/robot_description": 1, "/rosout": 12}


def _values(topic, m):
    if topic.startswith("/joint"):
        return (*m.position, *m.velocity)
    w, a, q = m.angular_velocity, m.linear_acceleration, m.orientation
    attitude = (q.x, q.y, q.z, q.w) if topic == "/imu/truth" else ()
    return (w.x, w.y, w.z, a.x, a.y, a.z, *attitude)


@pytest.mark.parametrize("command", [["mcap", "check", "--full"], ["rrd", "verify"]])
def test_rerun_accepts_both_files(laser, command, tmp_path):
    name = "run.mcap" if command[0] == "mcap" else "run.rrd"
    rerun = str(Path(sys.executable).with_name("rerun"))
    quiet = os.environ | {"HOME": str(tmp_path), "CI": "true"}
    done = subprocess.run(
        [rerun, *command, str(laser.out / name)], capture_output=True, text=True, env=quiet
    )
    assert done.returncode == 0, done.stdout + done.stderr


def test_metadata_says_what_made_the_run(laser):
    found = read_metadata(laser.out / "run.mcap")
    assert found["run"]["seed"] == "5"
    assert found["run"]["mujoco_version"].startswith("4.")
    assert len(found["run"]["model_sha256"]) == 64
    assert found["site"]["latitude_deg"] == "48.5"
    assert 'label = "Z1 down"' in found["procedure"]["toml"]
    assert "angle_random_walk_deg_rt_h" in found["imu"]["toml"]
    schedule = json.loads(found["schedule"]["json"])
    assert [s["label"] for s in schedule if s["kind"] == "dwell"][::5] == ["X1 up", "Z1 down"]


def test_the_review_holds_the_curves_of_both_methods(laser):
    entities = {str(chunk.entity_path) for chunk in RrdReader(str(laser.out / "run.rrd")).stream()}
    text = " ".join(sorted(entities))
    for part in ("six-position", "rk4", "phase"):
        assert part in text, text


def test_align_gives_what_the_run_gave(laser):
    log = load_log(laser.out / "run.mcap", None, None, None)
    again, refused = evaluate_each(log.dwells, log.truths, log.site, log.options, log.methods)
    assert refused == []
    assert len(again) == len(laser.scores) == 6 * 2 + 6 + 6 + 3
    for a, b in zip(again, laser.scores, strict=True):
        assert a.estimate.label == b.estimate.label
        if b.error is not None:
            # the recorded stamps and values are the same bits
            assert np.array_equal(a.error, b.error)


def test_same_window_is_zero_and_fresh_window_is_not(laser):
    for s in laser.scores:
        if s.estimate.window == "same":
            assert np.degrees(np.abs(s.error)).max() < 1e-9  # identical samples: rounding alone
            assert "zero by construction" in s.estimate.flags[0]
        if s.estimate.window == "fresh":
            assert np.degrees(np.abs(s.error)).max() > 1e-5


def test_fresh_window_errors_match_the_random_walk(tmp_path):
    """Yaw, 18 independent errors: sigma = ARW sqrt(1/T0 + 1/T1) / (W cos lat), chi-square."""
    arw = np.radians(0.003) / 60
    squares = []
    for seed in range(3):
        result = record(settings("six-position", "ring-laser", 20, seed), tmp_path / f"run{seed}")
        fresh = [s for s in result.scores if s.estimate.window == "fresh"]
        squares += [s.error[1] ** 2 for s in fresh]
    sigma = arw * np.sqrt(1 / 10 + 1 / 50) / (7.292115e-5 * np.cos(np.radians(48.5)))
    assert np.degrees(sigma) == pytest.approx(0.3584, abs=1e-4)  # within methods.md's 0.2 to 0.7
    low, high = chi2.ppf([0.0005, 0.9995], 18)
    assert low < sum(squares) / sigma**2 < high


@pytest.mark.slow
def test_published_drifts_come_out_at_300_s(tmp_path):
    """RK4 over 300 s with the tactical unit: 0.233 deg predicted, 0.21 to 0.39 published."""
    result = record(settings("six-position-published", "stim300", 20, 1), tmp_path / "run")
    errors = np.array([s.error for s in result.scores if s.estimate.method == "rk4"])
    predicted = 0.15 / 60 * np.sqrt(290 + 290**2 / 10)  # deg: N sqrt(t - T0 + (t - T0)^2/T0)
    assert predicted == pytest.approx(0.2332, abs=1e-4)
    low, high = chi2.ppf([0.0005, 0.9995], 18)  # six positions, three axes, independent
    assert low < np.sum(np.degrees(errors) ** 2) / predicted**2 < high


def test_same_seed_same_bytes_and_another_seed_another(tmp_path):
    made = settings("six-position", "stim300", 2)
    files = [
        (record(replace(made, seed=seed), tmp_path / str(k)).out / "run.mcap").read_bytes()
        for k, seed in enumerate((7, 7, 8))
    ]
    assert files[0] == files[1]
    assert files[0] != files[2]


def test_instants_are_recorded_as_such(tmp_path):
    made = settings("six-position", "ideal", 20, sampling=Sampling.INSTANT)
    result = record(made, tmp_path / "run")
    assert read_metadata(result.out / "run.mcap")["run"]["sampling"] == "instant"
    truth = read_truth(result.out / "run.mcap")
    t = (truth.t_ns - EPOCH_NS) * 1e-9
    w, f = chain.sensors(*result.plan.motion.joints(t), np.radians(48.5), made.site.gravity)
    assert np.abs(truth.w_ib_b - w).max() < 1e-13
    assert np.abs(truth.f_b - f).max() < 1e-12


def test_a_failure_leaves_nothing_behind(tmp_path, monkeypatch):
    monkeypatch.setattr("stand.recorded_run.evaluate_each", lambda *a: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        record(settings("six-position", rate_hz=2), tmp_path / "deep" / "run")
    assert list(tmp_path.iterdir()) == []  # not even the folder above


def test_force_replaces_a_recording_and_nothing_else(tmp_path):
    made = settings("six-position", rate_hz=2)
    out = tmp_path / "run"
    record(made, out)
    before = (out / "run.mcap").read_bytes()
    with pytest.raises(StandError, match="--force replaces it"):
        record(replace(made, seed=9), out)
    assert (out / "run.mcap").read_bytes() == before
    run(replace(made, seed=9), out, True, lambda done: None)
    assert (out / "run.mcap").read_bytes() != before
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.txt").write_text("years of work")
    with pytest.raises(StandError, match="not a recording"):
        run(made, tmp_path / "mine", True, lambda done: None)
    assert (tmp_path / "mine" / "thesis.txt").read_text() == "years of work"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["mine", "run"]


def test_gravity_and_latitude_of_the_site_reach_the_readings(tmp_path):
    made = settings("six-position", "ideal", 2, site=Site(np.radians(60.0), 0.0, 9.7))
    truth = read_truth(record(made, tmp_path / "run").out / "run.mcap")
    # first dwell from 3 s: X1 up at 60 deg: W sin 60 = 6.315157e-5 rad/s
    assert truth.f_b[20] == pytest.approx([9.7, 0, 0], abs=1e-9)
    assert truth.w_ib_b[20, 0] == pytest.approx(7.292115e-5 * np.sqrt(3) / 2, abs=1e-18)


@pytest.mark.slow
def test_the_review_opens_at_a_dwell_without_a_complaint(laser, tmp_path):
    sys.path.insert(0, str(ROOT / "tools"))
    try:
        from review_picture import pictures
    finally:
        sys.path.pop(0)
    try:
        paths, state = pictures(laser.out / "run.rrd", tmp_path / "review.png", [30.0])
    except StandError as error:
        if "Vulkan" not in str(error):
            raise
        pytest.skip(str(error))
    assert [report for view in state.views for report in view.reports] == []
    assert all(path.stat().st_size > 50_000 for path in paths)
