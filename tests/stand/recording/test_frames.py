"""Frames and flags of a recorded run: /tf ends where /imu/truth says, saturation is per sample."""

from collections import defaultdict

import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from scipy.spatial.transform import Rotation

from stand.recording.mcap import EPOCH_NS
from stand.recording.mcap.frames import tf_rows

ROCKING = """
title = "Rocking, with every error of the table"
table = "mid-class"
[site]
latitude_deg = 48.5
[estimate]
methods = ["inertial"]
[[step]]
kind = "move"
label = "go"
joints_deg = { outer = 70, middle = -40, inner = 25, base_roll = 3, base_yaw = -5 }
[[step]]
kind = "dwell"
label = "there"
duration_s = 5
[[step]]
kind = "rate"
label = "turn"
axis = "inner"
rate_deg_s = 60
turns = 1
"""
LARGE = """
[table_errors]
base_tilt_arc_s = [300, -200]
base_azimuth_arc_s = 250
mounting_arc_s = [100, 500, -250]
[table_errors.axis.outer]
wobble_arc_s = 200
non_orthogonality_arc_s = 300
placement_arc_s = -400
encoder_once_arc_s = [300, -150]
encoder_twice_arc_s = [-100, 80]
[table_errors.axis.base_yaw]
non_orthogonality_arc_s = 90
wobble_arc_s = -60
[table_errors.axis.inner]
wobble_arc_s = 150
wobble_phase_deg = 30
non_orthogonality_arc_s = -120
rate_ripple_percent = 0.3
ripple_per_turn = 3
ripple_phase_deg = 50
"""
FAST = """
title = "Beyond the range"
table = "mid-class"
[site]
latitude_deg = 48.5
[estimate]
methods = []
[[step]]
kind = "rate"
label = "spin"
axis = "outer"
rate_deg_s = 290
turns = 4
"""


def recorded(tmp_path, stand_command, text, *options):
    path = tmp_path / "p.toml"
    path.write_text(text)
    done = stand_command("run", path, "--out", tmp_path / "run", *options, "--json")
    assert done.code == 0, done.err
    found = defaultdict(list)
    with AnyReader([tmp_path / "run" / "run.mcap"]) as reader:
        for connection, t, raw in reader.messages():
            message = reader.deserialize(raw, connection.msgtype)
            found[connection.topic].append((t, message))
    return found, done.json


def quaternion(q):
    return Rotation.from_quat([q.x, q.y, q.z, q.w])


def chained(links, child):
    """The orientation of a frame, multiplied up the chain of its parents."""
    rotation = Rotation.identity()
    while child in links:
        link = links[child]
        rotation = quaternion(link.transform.rotation) * rotation
        child = link.header.frame_id
    return rotation


@pytest.mark.parametrize("errors", ["", LARGE], ids=["drawn", "large and set"])
def test_the_frames_end_where_the_truth_is(tmp_path, stand_command, errors):
    options = ("--imu", "ideal", "--rate", 20, "--seed", 4, "--sampling", "instant")
    messages, _ = recorded(tmp_path, stand_command, ROCKING + errors, *options)
    truth = {t: quaternion(m.orientation) for t, m in messages["/imu/truth"]}
    fixed = {link.child_frame_id: link for link in messages["/tf_static"][0][1].transforms}
    off = []
    for t, message in messages["/tf"]:
        links = fixed | {link.child_frame_id: link for link in message.transforms}
        off.append((truth[t].inv() * chained(links, "imu")).magnitude())
    assert len(off) > 200
    # the nods' phase is that of the encoders, which round to 1.7e-6 rad: 1e-3 rad of it
    assert max(off) < 5e-9
    nominal = messages["/joint_states"][0][1]
    assert len(nominal.name) == 6


def test_saturation_is_marked_at_each_sample(tmp_path, stand_command):
    unit = tmp_path / "narrow.toml"
    says = 'kind = "assumed", source = "made up for this test"'
    unit.write_text(
        'title = "N"\ngrade = "reference"\nevidence = "none"\n'
        f"[gyro]\nrange_deg_s = {{ value = 250, {says} }}\n"
        f"[accel]\nrange_g = {{ value = 10, {says} }}\n"
    )
    messages, told = recorded(tmp_path, stand_command, FAST, "--imu", unit, "--rate", 100)
    true = np.array([m.angular_velocity.y for _, m in messages["/imu/truth"]])
    stamps = np.array([t for t, _ in messages["/imu/truth"]])
    beyond = np.abs(true) > np.radians(250)  # Y1 turns about the outer axis
    assert beyond.sum() > 300
    marked = messages["/imu/saturated"]
    np.testing.assert_array_equal([t for t, _ in marked], stamps[beyond])
    assert {m.data for _, m in marked} == {0b000010}  # the second channel alone
    assert told["saturated_samples"]["gyro Y1"] == beyond.sum()
    assert stamps[0] > EPOCH_NS


def test_transforms_are_of_the_first_sample_in_each_period():
    """Every 20 ms; the first of all has them, whatever its time."""
    t_ns = np.array([15, 19, 20, 39, 45, 61]) * 1_000_000
    assert tf_rows(t_ns, None).tolist() == [0, 2, 4, 5]
    assert tf_rows(t_ns, 14_000_000).tolist() == [2, 4, 5]
    assert tf_rows(t_ns[1:], 15_000_000).tolist() == [1, 3, 4]
    assert tf_rows(np.array([15_000_000, 25_000_000]), None).tolist() == [0, 1]
    assert tf_rows(np.array([70_000_000]), None).tolist() == [0]
