"""The MCAP record against independent readers, and foreign MCAP files against ours."""

import os
import struct
import subprocess
import sys
import tracemalloc
import zlib
from collections import defaultdict
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType, Writer
from rerun.chunk import RrdReader
from rosbags.highlevel import AnyReader
from scipy.spatial.transform import Rotation

from stand.errors import StandError
from stand.recording.entrance import read_imu as read_any
from stand.recording.log_form import LogForm
from stand.recording.mcap import (
    EPOCH_NS,
    DriveWriter,
    ImuLog,
    McapWriter,
    Satellites,
    cdr,
    read_fixes,
    read_imu,
    read_joints,
    read_metadata,
    read_truth,
    read_velocities,
    schemas,
    write_imu_log,
)
from stand.recording.mcap.container import Container, Part, Topic
from stand.recording.mcap.decode import (
    decode_fixes,
    decode_imu,
    decode_joints,
    decode_velocities,
    frame_ids,
)
from stand.samples import ImuBlock, TruthBlock
from stand.table.joints import JOINTS, Body, Joint, StandModel

MS = 1_000_000
S = 1000 * MS
STILL = (0.0, 0.0, 0.0, 1.0)
QUARTER = np.sqrt(0.5)
METADATA = {"run": {"seed": "7", "site": "Zürich"}, "versions": {"numpy": "2"}}
DESCRIPTION = "<robot name='toy'/>"
RATE_NOISE = (1e-8, 2e-8, 3e-8)
FORCE_NOISE = (1e-4, 2e-4, 3e-4)


def body(name, parent, position=(0, 0, 0), rotation=STILL, joint=None):
    nothing = np.zeros(3)
    return Body(name, parent, position, rotation, joint, (), 1.0, nothing, nothing + 1, STILL)


def toy_stand():
    """A table hinged about y on a base 1 m up, and a plate hinged about z on the table."""
    bodies = (
        body("world", "world"),
        body("base", "world", (0, 0, 1)),
        body("table", "base", joint=Joint("base_roll", (0, 1, 0))),
        body("plate", "table", (0, 0.5, 0), (0, 0, QUARTER, QUARTER), Joint("inner", (0, 0, 1))),
    )
    return StandModel(bodies, "plate", (0, 0, 0.1), (QUARTER, 0, 0, QUARTER), "0" * 64)


def blocks(n, dt_ns=MS, seed=1):
    rng = np.random.default_rng(seed)
    t_ns = (np.arange(n) + 1) * dt_ns
    q = Rotation.random(n, rng).as_quat()
    vectors = rng.normal(size=(4, n, 3))
    # true angles and rates, then what the encoders say of them
    truth = TruthBlock(t_ns, vectors[0], vectors[1], q, *rng.normal(size=(4, n, len(JOINTS))))
    return truth, ImuBlock(t_ns, vectors[2], vectors[3])


def cut(truth, imu, size):
    """The same samples in blocks of `size`."""
    for at in range(0, len(truth), size):
        rows = slice(at, at + size)
        yield (
            TruthBlock(*(getattr(truth, name)[rows] for name in TruthBlock.__slots__)),
            ImuBlock(*(getattr(imu, name)[rows] for name in ImuBlock.__slots__)),
        )


def writer(path, **changes):
    options = {
        "model": toy_stand(),
        "robot_description": DESCRIPTION,
        "metadata": METADATA,
        "attachments": {"procedure.toml": ("application/toml", b"steps = []")},
        "rate_noise": RATE_NOISE,
        "force_noise": FORCE_NOISE,
    }
    return McapWriter(path, **(options | changes))


def write_run(path, n=250, size=100, dt_ns=MS):
    truth, imu = blocks(n, dt_ns)
    with writer(path) as file:
        file.log(0, 20, "begin")
        file.log(150 * dt_ns, 30, "half way: µ, σ")
        file.log(50 * dt_ns, 20, "before it")
        file.log((n + 1) * dt_ns, 20, "after the last sample")
        for pair in cut(truth, imu, size):
            file.write(*pair)
        file.close(attachments={"report.html": ("text/html", b"<p>done</p>")})
    return truth, imu


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    path = tmp_path_factory.mktemp("run") / "run.mcap"
    return path, *write_run(path)


def decoded(path):
    """Every message by topic: (log time, message), decoded by rosbags with the file's schemas."""
    found = defaultdict(list)
    with AnyReader([path]) as reader:
        for connection, log_time, data in reader.messages():
            found[connection.topic].append((log_time, reader.deserialize(data, connection.msgtype)))
    return found


def stamp(header):
    return header.stamp.sec * S + header.stamp.nanosec


def xyz(vector):
    return [vector.x, vector.y, vector.z]


def xyzw(q):
    return [q.x, q.y, q.z, q.w]


# --- rosbags: every message of every topic


@pytest.mark.parametrize("topic", ["/imu/data", "/imu/truth"])
def test_imu_topics_bit_exact_in_rosbags(run, topic):
    path, truth, imu = run
    block = imu if topic == "/imu/data" else truth
    messages = decoded(path)[topic]
    np.testing.assert_array_equal([t for t, _ in messages], EPOCH_NS + block.t_ns)
    np.testing.assert_array_equal([stamp(m.header) for _, m in messages], EPOCH_NS + block.t_ns)
    np.testing.assert_array_equal([xyz(m.angular_velocity) for _, m in messages], block.w_ib_b)
    np.testing.assert_array_equal([xyz(m.linear_acceleration) for _, m in messages], block.f_b)
    assert {m.header.frame_id for _, m in messages} == {"imu"}


def test_imu_data_has_no_orientation_and_its_noise(run):
    _, message = decoded(run[0])["/imu/data"][17]
    assert message.orientation_covariance[0] == -1.0
    assert xyzw(message.orientation) == [0, 0, 0, 1]
    np.testing.assert_array_equal(
        message.angular_velocity_covariance, [1e-8, 0, 0, 0, 2e-8, 0, 0, 0, 3e-8]
    )
    np.testing.assert_array_equal(
        message.linear_acceleration_covariance, [1e-4, 0, 0, 0, 2e-4, 0, 0, 0, 3e-4]
    )


def test_truth_has_the_orientation(run):
    path, truth, _ = run
    messages = [message for _, message in decoded(path)["/imu/truth"]]
    np.testing.assert_array_equal([xyzw(m.orientation) for m in messages], truth.q_wb)
    assert {m.orientation_covariance[0] for m in messages} == {0.0}


@pytest.mark.parametrize(
    ("topic", "angles", "rates"),
    [("/joint_states", "encoders", "encoder_rates"), ("/joint_truth", "joints", "joint_rates")],
)
def test_joint_topics_bit_exact_in_rosbags(run, topic, angles, rates):
    path, truth, _ = run
    messages = decoded(path)[topic]
    columns = [0, 5]  # base_roll and inner, of the six
    np.testing.assert_array_equal([stamp(m.header) for _, m in messages], EPOCH_NS + truth.t_ns)
    for field, name in (("position", angles), ("velocity", rates)):
        shown = [getattr(m, field) for _, m in messages]
        np.testing.assert_array_equal(shown, getattr(truth, name)[:, columns])
    assert {(*m.name, len(m.effort)) for _, m in messages} == {("base_roll", "inner", 0)}


def test_texts_in_order_of_time(run):
    messages = decoded(run[0])["/rosout"]
    assert [(t - EPOCH_NS, m.level, m.msg) for t, m in messages] == [
        (0, 20, "begin"),
        (50 * MS, 20, "before it"),
        (150 * MS, 30, "half way: µ, σ"),
        (251 * MS, 20, "after the last sample"),
    ]
    assert [m.stamp.nanosec for _, m in messages] == [0, 50 * MS, 150 * MS, 251 * MS]


def test_late_text_keeps_its_stamp_and_is_filed_behind(tmp_path):
    truth, imu = blocks(20)
    first, second = cut(truth, imu, 10)
    with writer(tmp_path / "run.mcap") as file:
        file.write(*first)
        file.log(3 * MS, 20, "late")
        file.write(*second)
    [(log_time, message)] = decoded(tmp_path / "run.mcap")["/rosout"]
    assert log_time == EPOCH_NS + 10 * MS
    assert message.stamp.nanosec == 3 * MS


def test_description_and_transient_local(run):
    [(log_time, message)] = decoded(run[0])["/robot_description"]
    assert (log_time, message.data) == (EPOCH_NS, DESCRIPTION)
    with AnyReader([run[0]]) as reader:
        durability = {
            c.topic: c.ext.offered_qos_profiles[0].durability.name for c in reader.connections
        }
    latched = {topic for topic, name in durability.items() if name == "TRANSIENT_LOCAL"}
    assert latched == {"/tf_static", "/robot_description"}


def test_quality_of_service_is_what_subscribers_expect(run):
    """Reliable; the last ten messages, as ROS's own default; of what is latched the one."""
    with AnyReader([run[0]]) as reader:
        for connection in reader.connections:
            (qos,) = connection.ext.offered_qos_profiles
            latched = connection.topic in ("/tf_static", "/robot_description")
            assert (qos.reliability.name, qos.history.name) == ("RELIABLE", "KEEP_LAST")
            assert qos.depth == (1 if latched else 10)
            assert qos.durability.name == ("TRANSIENT_LOCAL" if latched else "VOLATILE")


def chained(transforms, child):
    """Rotation and place of `child` in world, from {child: TransformStamped}."""
    rotation, place = Rotation.identity(), np.zeros(3)
    while child != "world":
        link = transforms[child]
        turn = Rotation.from_quat(xyzw(link.transform.rotation))
        place = turn.apply(place) + xyz(link.transform.translation)
        rotation = turn * rotation
        child = link.header.frame_id
    return rotation, place


def test_transform_chain_by_hand(tmp_path):
    """Both hinges at +90 deg: X1 up, Y1 east, Z1 north, the point 0.1 m east of the plate.

    The encoders say something else: transforms follow what is.
    """
    angles = np.zeros((2, 6))
    angles[1, [0, 5]] = np.pi / 2
    still, imu = blocks(2, dt_ns=30 * MS)
    motion = (angles, 0 * angles, angles + 0.1, 0 * angles)
    truth = TruthBlock(still.t_ns, still.w_ib_b, still.f_b, still.q_wb, *motion)
    with writer(tmp_path / "run.mcap") as file:
        file.write(truth, imu)
    messages = decoded(tmp_path / "run.mcap")
    links = [*messages["/tf_static"][0][1].transforms, *messages["/tf"][1][1].transforms]
    rotation, place = chained({link.child_frame_id: link for link in links}, "imu")
    x1, y1, z1 = [0, 0, 1], [1, 0, 0], [0, 1, 0]  # east, north, up
    # Three products of quaternions round to a few 1e-16.
    np.testing.assert_allclose(rotation.as_matrix().T, [x1, y1, z1], atol=2e-15)
    np.testing.assert_allclose(place, [0.1, 0.5, 1.0], atol=2e-15)


@pytest.mark.parametrize("size", [1, 7, 250])
def test_transforms_at_50_hz_whatever_the_blocks(tmp_path, size):
    write_run(tmp_path / "run.mcap", size=size)
    times = [t - EPOCH_NS for t, _ in decoded(tmp_path / "run.mcap")["/tf"]]
    assert times == [MS, *range(20 * MS, 251 * MS, 20 * MS)]


def test_slow_samples_all_get_transforms(tmp_path):
    truth, _ = write_run(tmp_path / "run.mcap", n=5, dt_ns=100 * MS)
    messages = decoded(tmp_path / "run.mcap")["/tf"]
    np.testing.assert_array_equal([t for t, _ in messages], EPOCH_NS + truth.t_ns)


# --- the file as a whole


def messages_in(path):
    with open(path, "rb") as file:
        reader = make_reader(file, validate_crcs=True)
        return [
            (channel.topic, message.log_time, message.sequence, message.data)
            for _, channel, message in reader.iter_messages(log_time_order=False)
        ]


def test_block_size_does_not_change_the_messages(tmp_path, run):
    write_run(tmp_path / "run.mcap", size=33)
    assert messages_in(tmp_path / "run.mcap") == messages_in(run[0])


def chunk_spans(path, since=EPOCH_NS):
    """First and last time [ms] of each chunk that has messages."""
    with open(path, "rb") as file:
        summary = make_reader(file).get_summary()
    ends = [(c.message_start_time, c.message_end_time) for c in summary.chunk_indexes]
    return [((a - since) / MS, (b - since) / MS) for a, b in ends if b]


def test_chunks_are_whole_seconds(tmp_path):
    """A second ends with its last sample, and a text about that time is with it."""
    with writer(tmp_path / "run.mcap") as file:
        file.log(S, 20, "at a second")
        file.write(*blocks(2500))
    # what lasts is before all of them
    spans = [(0, 0), (1, 1000), (1001, 2000), (2001, 2500)]
    assert chunk_spans(tmp_path / "run.mcap") == spans


def test_chunks_of_an_imported_log_count_from_its_first_sample(tmp_path):
    path, zero = tmp_path / "log.mcap", np.zeros((2500, 3))
    t_ns = 5300 * MS + np.arange(2500) * MS
    write_imu_log(path, t_ns=t_ns, w_ib_b=zero, f_b=zero, epoch_ns=0, metadata={})
    assert chunk_spans(path, 0) == [(5300, 6299), (6300, 7299), (7300, 7799)]


def test_fixes_lie_in_the_chunk_of_the_samples_up_to_their_time(tmp_path):
    """Those at 1.0 and 2.0 s end a second's chunk; that behind the end has one of its own."""
    write_road(tmp_path / "run.mcap")
    spans = [(0, 1000), (1001, 2000), (2001, 2500), (2600, 2600)]
    assert chunk_spans(tmp_path / "run.mcap") == spans


def test_same_input_same_bytes(tmp_path, run):
    write_run(tmp_path / "run.mcap")
    assert (tmp_path / "run.mcap").read_bytes() == run[0].read_bytes()


def test_messages_lie_in_order_of_time(run):
    times = [log_time for _, log_time, _, _ in messages_in(run[0])]
    assert times == sorted(times)


def test_index_and_statistics_agree_with_the_messages(run):
    path = run[0]
    with open(path, "rb") as file:
        reader = make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        attachments = {a.name: (a.media_type, a.data) for a in reader.iter_attachments()}
        metadata = {m.name: m.metadata for m in reader.iter_metadata()}
        by_index = [(c.topic, m.log_time) for _, c, m in reader.iter_messages()]
    assert summary is not None
    assert summary.statistics is not None
    in_file = messages_in(path)
    assert summary.statistics.message_count == len(in_file) == len(by_index)
    assert len(summary.chunk_indexes) == 5  # lasting messages, three blocks, the last text
    assert summary.statistics.message_start_time == EPOCH_NS
    assert summary.statistics.message_end_time == EPOCH_NS + 251 * MS
    assert metadata == METADATA
    assert attachments == {
        "procedure.toml": ("application/toml", b"steps = []"),
        "report.html": ("text/html", b"<p>done</p>"),
    }


def test_checksums_are_there_and_right(run):
    data = run[0].read_bytes()
    with open(run[0], "rb") as file:
        found = list(StreamReader(file, emit_chunks=True, validate_crcs=True).records)
    kinds = defaultdict(list)
    for record in found:
        kinds[type(record).__name__].append(record)
    assert all(chunk.uncompressed_crc for chunk in kinds["Chunk"])
    assert kinds["DataEnd"][0].data_section_crc
    footer = kinds["Footer"][0]
    # By the specification: from the summary's start up to the checksum itself.
    assert footer.summary_crc == zlib.crc32(data[footer.summary_start : -8 - 4])


def test_every_whole_block_survives_a_kill(tmp_path):
    path = tmp_path / "run.mcap"
    truth, imu = blocks(20)
    file = writer(path)
    for pair in cut(truth, imu, 10):
        file.write(*pair)
    on_disk = path.read_bytes()  # what another process sees before the file is closed
    file.close()
    (tmp_path / "killed.mcap").write_bytes(on_disk)
    with open(tmp_path / "killed.mcap", "rb") as killed:
        sizes = [size for opcode, size in whole_records(killed.read()) if opcode == Opcode.CHUNK]
    assert len(sizes) == 3  # the lasting messages and both blocks


def whole_records(data):
    at = 8
    while at < len(data):
        opcode, size = struct.unpack_from("<BQ", data, at)
        assert at + 9 + size <= len(data)
        yield opcode, size
        at += 9 + size


def test_exception_leaves_no_footer(tmp_path):
    path = tmp_path / "run.mcap"
    with pytest.raises(ZeroDivisionError), writer(path) as file:  # noqa: PT012
        file.write(*blocks(10))
        _ = 1 / 0
    with pytest.raises(StandError, match=r"run.mcap: cut off before its end; stand recover"):
        read_imu(path)


def rerun(home, *arguments):
    """Run rerun's command line; it writes its own files to HOME."""
    command = [Path(sys.executable).with_name("rerun"), "mcap", *arguments]
    environment = os.environ | {"HOME": str(home), "NO_COLOR": "1"}
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=False)


def test_rerun_finds_nothing_wrong(tmp_path, run):
    result = rerun(tmp_path, "check", "--full", run[0])
    assert result.returncode == 0, result.stderr
    status = [line.split()[0] for line in result.stdout.splitlines() if "/" in line][1:]
    assert len(status) >= 7  # one line for each topic, at least
    assert set(status) == {"ok"}


def test_imu_bit_exact_in_rerun(tmp_path, run):
    path, _, imu = run
    result = rerun(tmp_path, "convert", path, "-o", tmp_path / "run.rrd")
    assert result.returncode == 0, result.stderr
    times, values = [], []
    for chunk in RrdReader(tmp_path / "run.rrd").stream():
        batch = chunk.to_record_batch()
        if chunk.entity_path == "/imu/data" and "ros2_timestamp" in batch.schema.names:
            times += batch.column("ros2_timestamp").cast("int64").to_pylist()
            values += batch.column("Scalars:scalars").to_pylist()
    np.testing.assert_array_equal(times, EPOCH_NS + imu.t_ns)
    np.testing.assert_array_equal(values, np.hstack([imu.w_ib_b, imu.f_b]))


# --- our reader


def test_read_imu_bit_exact(run):
    path, _, imu = run
    log = read_imu(path)
    assert (log.path, log.topic, log.frame_id) == (str(path), "/imu/data", "imu")
    assert len(log) == len(imu)
    np.testing.assert_array_equal(log.t_ns, EPOCH_NS + imu.t_ns)
    np.testing.assert_array_equal(log.w_ib_b, imu.w_ib_b)
    np.testing.assert_array_equal(log.f_b, imu.f_b)
    assert log.metadata == METADATA == read_metadata(path)


def test_read_truth_bit_exact(run):
    path, truth, _ = run
    log = read_truth(path)
    for name in ("w_ib_b", "f_b", "q_wb"):
        np.testing.assert_array_equal(getattr(log, name), getattr(truth, name))
    np.testing.assert_array_equal(log.t_ns, EPOCH_NS + truth.t_ns)
    np.testing.assert_array_equal(read_imu(path, "/imu/truth").w_ib_b, truth.w_ib_b)


@pytest.mark.parametrize(
    ("topic", "angles", "rates"),
    [
        (None, "encoders", "encoder_rates"),
        ("/joint_states", "encoders", "encoder_rates"),
        ("/joint_truth", "joints", "joint_rates"),
    ],
)
def test_read_joints_bit_exact(run, topic, angles, rates):
    path, truth, _ = run
    log = read_joints(path, topic)
    assert (log.path, log.topic) == (str(path), topic or "/joint_states")
    assert log.names == ("base_roll", "inner")
    assert len(log) == len(truth)
    np.testing.assert_array_equal(log.t_ns, EPOCH_NS + truth.t_ns)
    np.testing.assert_array_equal(log.angles, getattr(truth, angles)[:, [0, 5]])
    np.testing.assert_array_equal(log.rates, getattr(truth, rates)[:, [0, 5]])


def test_a_late_metadata_record(tmp_path):
    with writer(tmp_path / "run.mcap") as file:
        file.write(*blocks(10))
        file.close(metadata={"settled": {"X1 up": "1.25"}})
    assert read_metadata(tmp_path / "run.mcap") == METADATA | {"settled": {"X1 up": "1.25"}}
    with open(tmp_path / "run.mcap", "rb") as opened:
        names = [m.name for m in make_reader(opened, validate_crcs=True).iter_metadata()]
    assert names == [*METADATA, "settled"]


def test_logs_are_read_only(run):
    joints = read_joints(run[0])
    logs = [(log.t_ns, log.w_ib_b, log.f_b) for log in (read_imu(run[0]), read_truth(run[0]))]
    for arrays in (*logs, (joints.t_ns, joints.angles, joints.rates)):
        for values in arrays:
            with pytest.raises(ValueError, match="read-only"):
                values[0] = 0


def test_logs_copy_what_others_hold():
    t_ns, w = np.array([1, 2]), np.arange(6.0).reshape(2, 3)
    log = ImuLog("", "/imu", "imu", t_ns, w, [[1, 2, 3], [4, 5, 6]], {})  # pyright: ignore
    w[0, 0] = 9.0
    assert log.w_ib_b[0, 0] == 0.0
    np.testing.assert_array_equal(log.f_b, [[1, 2, 3], [4, 5, 6]])
    with pytest.raises(ValueError, match="f_b: shape"):
        ImuLog("", "/imu", "imu", t_ns, w, w.T, {})


def test_imported_log_comes_back(tmp_path):
    path = tmp_path / "log.mcap"
    _, imu = blocks(2500)
    gap = imu.t_ns + np.where(imu.t_ns > 1200 * MS, 5 * S, 0)
    write_imu_log(
        path,
        t_ns=gap,
        w_ib_b=imu.w_ib_b,
        f_b=imu.f_b,
        epoch_ns=0,
        frame_id="lab_imu_7",
        metadata=METADATA,
    )
    log = read_imu(path)
    assert log.frame_id == "lab_imu_7"
    assert log.metadata == METADATA
    np.testing.assert_array_equal(log.t_ns, gap)
    np.testing.assert_array_equal(log.w_ib_b, imu.w_ib_b)
    np.testing.assert_array_equal(log.f_b, imu.f_b)
    with open(path, "rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    # Seconds since the first sample: 0, 1 up to the gap, then 6 and 7.
    assert len(summary.chunk_indexes) == 4


# --- CDR by hand, from the specification


def by_hand(t_ns, w, f, frame="imu", order="<", q=STILL):
    """A sensor_msgs/msg/Imu, field by field."""
    text = frame.encode() + b"\0"
    body = struct.pack(f"{order}iI", *divmod(t_ns, S)) + struct.pack(f"{order}I", len(text)) + text
    body += bytes(-len(body) % 8)
    body += struct.pack(f"{order}4d9d", *q, -1, *[0] * 8)
    body += struct.pack(f"{order}3d9d", *w, 1, 0, 0, 0, 2, 0, 0, 0, 3)
    body += struct.pack(f"{order}3d9d", *f, 4, 0, 0, 0, 5, 0, 0, 0, 6)
    return bytes([0, 1 if order == "<" else 0, 0, 0]) + body


@pytest.mark.parametrize("frame", ["imu", "imu_link", ""])
def test_imu_bytes_by_hand(frame):
    t_ns = np.array([EPOCH_NS + 5, EPOCH_NS + 3 * S + 7])
    w = np.array([[0.1, 0.2, 0.3], [0.4, 0.5, 0.6]])
    f = np.array([[1.0, 2.0, 9.8], [3.0, 4.0, -9.8]])
    rows = cdr.imu_messages(t_ns, w, f, frame_id=frame, rate_noise=(1, 2, 3), force_noise=(4, 5, 6))
    for row, *values in zip(rows, t_ns.tolist(), w, f, strict=True):
        assert row.tobytes() == by_hand(*values, frame=frame)


def test_imu_bytes_literally():
    """One message written out: 0.5 is 3FE0..., 2.0 is 4000..., -1.0 is BFF0..."""
    row = cdr.imu_messages(
        np.array([S + 2]), np.array([[0.5, 0, 0]]), np.array([[0, 2.0, 0]]), frame_id="imu"
    )[0].tobytes()
    assert row[:20].hex(" ") == "00 01 00 00 01 00 00 00 02 00 00 00 04 00 00 00 69 6d 75 00"
    numbers = row[20:].hex()
    half, two, one, minus = ("000000000000" + tail for tail in ("e03f", "0040", "f03f", "f0bf"))
    zero = "0" * 16
    q, no_q = zero * 3 + one, minus + zero * 8
    assert numbers == q + no_q + half + zero * 2 + zero * 9 + zero + two + zero + zero * 9


@pytest.mark.parametrize(
    "name",
    [
        schemas.IMU,
        schemas.JOINT_STATE,
        schemas.TF_MESSAGE,
        schemas.STRING,
        schemas.LOG,
        schemas.NAV_SAT_FIX,
        schemas.TWIST_STAMPED,
        schemas.TWIST_WITH_COVARIANCE_STAMPED,
    ],
)
def test_definitions_are_those_of_humble(name):
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    humble = get_typestore(Stores.ROS2_HUMBLE)
    ours = get_typestore(Stores.EMPTY)
    ours.register(get_types_from_msg(schemas.definition(name), name))
    assert ours.hash_rihs01(name) == humble.hash_rihs01(name)


messages = st.tuples(
    st.integers(0, 2**31 - 1),
    st.integers(0, S - 1),
    st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0"), max_size=12),
    st.sampled_from("<>"),
    st.lists(st.floats(allow_nan=False), min_size=10, max_size=10),
    st.binary(max_size=5),
)


@settings(max_examples=60, deadline=None)
@given(st.lists(messages, min_size=1, max_size=6))
def test_any_mixture_of_messages_is_decoded(drawn):
    data, starts, sizes = b"", [], []
    for sec, nanosec, frame, order, x, before in drawn:
        data += before
        starts.append(len(data))
        data += by_hand(sec * S + nanosec, x[:3], x[3:6], frame, order, x[6:])
        sizes.append(len(data) - starts[-1])
    raw = np.frombuffer(data, np.uint8)
    batch = decode_imu(raw, np.array(starts), np.array(sizes))
    np.testing.assert_array_equal(batch.t_ns, [m[0] * S + m[1] for m in drawn])
    np.testing.assert_array_equal(batch.w_ib_b, [m[4][:3] for m in drawn])
    np.testing.assert_array_equal(batch.f_b, [m[4][3:6] for m in drawn])
    np.testing.assert_array_equal(batch.q, [m[4][6:] for m in drawn])
    found, which = frame_ids(raw, np.array(starts))
    assert [found[k] for k in which] == [m[2] for m in drawn]


# --- JointState by an independent writer: rosbags, and big endian by hand


def joint_state(t_ns, names, angles, rates=(), frame="", order="<", efforts=()):
    """A sensor_msgs/msg/JointState, field by field; an empty sequence has no padding."""
    text = frame.encode() + b"\0"
    body = struct.pack(f"{order}iI", *divmod(t_ns, S)) + struct.pack(f"{order}I", len(text)) + text
    body += bytes(-len(body) % 4) + struct.pack(f"{order}I", len(names))
    for name in names:
        text = name.encode() + b"\0"
        body += bytes(-len(body) % 4) + struct.pack(f"{order}I", len(text)) + text
    for values in (angles, rates, efforts):
        body += bytes(-len(body) % 4) + struct.pack(f"{order}I", len(values))
        if len(values):
            body += bytes(-len(body) % 8) + struct.pack(f"{order}{len(values)}d", *values)
    return bytes([0, 1 if order == "<" else 0, 0, 0]) + body


def test_joint_bytes_by_hand_are_those_of_rosbags_and_ours():
    from rosbags.typesys import Stores, get_typestore

    names, angles, rates = ("outer", "inner_long"), [[0.5, -2.0], [3.0, 4.0]], [[1.0, 7.0]] * 2
    store = get_typestore(Stores.ROS2_HUMBLE)
    time, header, state = (
        store.types[name]
        for name in ("builtin_interfaces/msg/Time", "std_msgs/msg/Header", schemas.JOINT_STATE)
    )
    stamps = np.array([5, 3 * S + 7])
    ours = cdr.joint_states(stamps, names, np.array(angles), np.array(rates))
    for row, t_ns, q, w in zip(ours, stamps.tolist(), angles, rates, strict=True):
        message = state(
            header(time(*divmod(t_ns, S)), ""), list(names), np.array(q), np.array(w), np.empty(0)
        )
        hand = joint_state(t_ns, names, q, w)
        assert row.tobytes() == hand
        assert bytes(store.serialize_cdr(message, schemas.JOINT_STATE)) == hand


NAMES = ("outer", "arm/middle", "\u00fc")
joint_messages = st.tuples(
    st.integers(0, 2**31 - 1),
    st.permutations(range(3)),
    st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0"), max_size=9),
    st.sampled_from("<>"),
    st.lists(st.floats(allow_nan=False), min_size=6, max_size=6),
    st.booleans(),
    st.booleans(),
    st.binary(max_size=5),
)


@settings(max_examples=60, deadline=None)
@given(st.lists(joint_messages, min_size=1, max_size=6))
def test_any_mixture_of_joint_states_is_decoded(drawn):
    data, starts, sizes = b"", [], []
    for sec, places, frame, order, x, with_rates, with_efforts, before in drawn:
        data += before
        starts.append(len(data))
        q, w = [x[k] for k in places], [x[3 + k] for k in places]
        data += joint_state(
            sec * S + 3,
            [NAMES[k] for k in places],
            q,
            w if with_rates else (),
            frame,
            order,
            q if with_efforts else (),
        )
        sizes.append(len(data) - starts[-1])
    raw = np.frombuffer(data, np.uint8)
    batch = decode_joints(raw, np.array(starts), np.array(sizes), names=NAMES)
    assert batch.names == NAMES
    np.testing.assert_array_equal(batch.t_ns, [m[0] * S + 3 for m in drawn])
    np.testing.assert_array_equal(batch.angles, [m[4][:3] for m in drawn])
    rates = [m[4][3:] if m[5] else [np.nan] * 3 for m in drawn]
    np.testing.assert_array_equal(batch.rates, rates)


@settings(max_examples=200, deadline=None)
@given(st.integers(0, 200), st.integers(0, 255), st.integers(0, 60))
def test_damaged_joint_states_never_lead_to_another_exception(at, value, cut_off):
    message = bytearray(joint_state(5, NAMES, [1.0, 2.0, 3.0], [4.0, 5.0, 6.0]))
    message[at % len(message)] = value
    raw = np.frombuffer(bytes(message), np.uint8)
    try:
        decode_joints(raw, np.array([0]), np.array([len(message) - cut_off]))
    except StandError as error:
        if not str(error).startswith("message 0: "):
            raise


# --- foreign files


def foreign(path, topics, encoding="cdr", type_name=schemas.IMU, **options):
    """A file by the mcap package's own writer: {topic: [message bytes]}."""
    with open(path, "wb") as file:
        out = Writer(file, **({"compression": CompressionType.LZ4} | options))
        out.start(profile="ros2", library="another")
        schema = out.register_schema(type_name, "ros2msg", b"")
        for topic, payloads in topics.items():
            channel = out.register_channel(topic, encoding, schema)
            for k, payload in enumerate(payloads):
                out.add_message(channel, log_time=k, publish_time=k, data=payload)
        out.finish()
    return path


def numbered(n, **options):
    return [by_hand(k * MS + 1, (k, 1, 2), (3, 4, k), **options) for k in range(n)]


@pytest.mark.parametrize(
    "options",
    [
        {"compression": CompressionType.LZ4, "chunk_size": 4000},
        {"compression": CompressionType.NONE},
        {"compression": CompressionType.ZSTD},
        {"use_chunking": False},
        {"use_summary_offsets": False, "use_statistics": False, "repeat_channels": False},
    ],
)
def test_foreign_files_of_every_kind(tmp_path, options):
    frames = ["a", "front/imu", "imu_link", "", "\u00fc" * 9]
    payloads = [
        by_hand(k * MS + 1, (k, 1, 2), (3, 4, k), frames[k % 5], "<>"[k % 2]) for k in range(5000)
    ]
    path = foreign(tmp_path / "log.mcap", {"/a/imu": payloads}, **options)
    with pytest.raises(StandError, match=r"/a/imu: messages of a, front/imu, .*: choose one"):
        read_imu(path)
    for first, frame in enumerate(frames):  # several on a topic are several units
        log = read_any(path, form=LogForm(frame=frame))
        k = np.arange(first, 5000, 5)
        assert (log.topic, log.frame_id, log.metadata) == ("/a/imu", frame, {})
        np.testing.assert_array_equal(log.t_ns, k * MS + 1)
        np.testing.assert_array_equal(log.w_ib_b, np.stack([k, 0 * k + 1, 0 * k + 2], axis=1))
        np.testing.assert_array_equal(log.f_b, np.stack([0 * k + 3, 0 * k + 4, k], axis=1))


def test_choice_among_topics(tmp_path):
    many = foreign(tmp_path / "many.mcap", {"/b/imu": numbered(3), "/a/imu": numbered(2)})
    assert len(read_imu(many, "/b/imu")) == 3
    assert len(read_imu(many, "/a/imu")) == 2
    ours = foreign(tmp_path / "ours.mcap", {"/b/imu": numbered(3), "/imu/data": numbered(2)})
    assert read_imu(ours).topic == "/imu/data"


def with_nan():
    payloads = numbered(4)
    payloads[2] = by_hand(2 * MS + 1, (2, 1, 2), (3, float("nan"), 2))
    return payloads


def xcdr2():
    first, second = numbered(2)
    return [first, b"\x00\x07" + second[2:]]


@pytest.mark.parametrize(
    ("topics", "options", "match"),
    [
        (
            {"/b": numbered(1), "/a": numbered(1)},
            {},
            r"several IMU topics, choose one with --topic: /a, /b$",
        ),
        (
            {"/scan": [b""], "/pose": [b""]},
            {"type_name": "geometry_msgs/msg/Pose"},
            r"no topic with sensor_msgs/msg/Imu; it has: "
            r"/pose \(geometry_msgs/msg/Pose\), /scan \(geometry_msgs/msg/Pose\)$",
        ),
        ({}, {}, r"no topic with sensor_msgs/msg/Imu; it has: no topics$"),
        ({"/imu": []}, {}, r"/imu: has no messages$"),
        (
            {"/imu": numbered(1)},
            {"encoding": "protobuf"},
            r"/imu: message encoding 'protobuf', must be 'cdr' or 'ros1'$",
        ),
        (
            {"/imu": xcdr2()},
            {},
            r"/imu: message 1: encapsulation 0x0007, must be plain CDR: 0x0000 \(big endian\)",
        ),
        (
            {"/imu": [*numbered(3), *numbered(1)]},
            {},
            r"/imu: message 3: header stamp 1 ns is not later than 2000001 ns before it",
        ),
        (
            {"/imu": with_nan()},
            {},
            r"/imu: message 2: linear_acceleration \[3.0, nan, 2.0\] is not finite$",
        ),
        (
            {"/imu": [*numbered(1), numbered(2)[1][:-1]]},
            {},
            r"/imu: message 1: 315 bytes, sensor_msgs/msg/Imu needs 316$",
        ),
        ({"/imu": [b"\x00\x01"]}, {}, r"/imu: message 0: 2 bytes, sensor_msgs/msg/Imu needs 16$"),
    ],
)
def test_faults_of_the_content(tmp_path, topics, options, match):
    path = foreign(tmp_path / "log.mcap", topics, **options)
    with pytest.raises(StandError, match=match) as caught:
        read_imu(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


def test_unknown_topic_is_told_with_near_ones(run):
    with pytest.raises(
        StandError, match=r"'/imu/dta': did you mean /imu/data or .*known: /imu/data"
    ):
        read_imu(run[0], "/imu/dta")


def test_truth_of_a_log_without(tmp_path):
    path = foreign(tmp_path / "log.mcap", {"/imu": numbered(2)})
    with pytest.raises(StandError, match=r"log.mcap: unknown .*'/imu/truth': .*known: /imu$"):
        read_truth(path)


def test_faults_of_the_file(tmp_path, run):
    whole = run[0].read_bytes()
    (tmp_path / "text.csv").write_text("t,wx,wy,wz\n")
    (tmp_path / "empty.mcap").write_bytes(b"")
    (tmp_path / "cut.mcap").write_bytes(whole[: len(whole) // 2])
    (tmp_path / "magic.mcap").write_bytes(whole[:8])
    cases = {
        "none.mcap": "no such file",
        ".": "is a folder, must be an MCAP file",
        "text.csv": "not an MCAP file",
        "empty.mcap": "not an MCAP file",
        "cut.mcap": "cut off before its end; stand recover saves what is whole",
        "magic.mcap": "cut off before its end; stand recover saves what is whole",
    }
    for name, text in cases.items():
        for read in (read_imu, read_metadata, read_truth):
            with pytest.raises(StandError) as caught:
                read(tmp_path / name)
            assert str(caught.value) == f"{tmp_path / name}: {text}"


def damaged(path, data, at):
    changed = bytearray(data)
    changed[at] ^= 0x10
    path.write_bytes(changed)
    return path


def test_checksums_are_compared(tmp_path, run):
    path = tmp_path / "bad.mcap"
    whole = run[0].read_bytes()
    with pytest.raises(StandError, match=r"bad.mcap: damaged: checksum of the data is 0x"):
        read_imu(damaged(path, whole, whole.index(b"steps = []")))
    with pytest.raises(StandError, match=r"bad.mcap: damaged: checksum of the summary is 0x"):
        read_imu(damaged(path, whole, whole.rindex(b"/rosout")))
    plain = foreign(tmp_path / "plain.mcap", {"/imu": numbered(9)}, use_chunking=True,
                    compression=CompressionType.NONE).read_bytes()  # fmt: skip
    with pytest.raises(StandError, match=r"bad.mcap: damaged: checksum of a chunk is 0x"):
        read_imu(damaged(path, plain, plain.index(b"imu\0") + 40))


def test_any_damaged_byte_is_a_stand_error(tmp_path, run):
    """No byte of the file, when wrong, leads to another exception or to wrong numbers."""
    path, _, imu = run
    whole = path.read_bytes()
    rng = np.random.default_rng(3)
    for at in rng.integers(0, len(whole), 80).tolist():
        bad = damaged(tmp_path / "bad.mcap", whole, at)
        try:
            log = read_imu(bad)
        except StandError:
            continue
        np.testing.assert_array_equal(log.f_b, imu.f_b)


# --- faults of the writer's input


def test_blocks_must_fit_together(tmp_path):
    truth, imu = blocks(10)
    file = writer(tmp_path / "run.mcap")
    file.write(truth, imu)
    with pytest.raises(ValueError, match="must increase"):
        file.write(truth, imu)
    with pytest.raises(ValueError, match="truth and imu differ"):
        file.write(truth, blocks(10, dt_ns=2 * MS)[1])
    few = TruthBlock(truth.t_ns + S, truth.w_ib_b, truth.f_b, truth.q_wb, truth.f_b, truth.f_b)
    with pytest.raises(ValueError, match="joints: 3 columns, must be 6"):
        file.write(few, ImuBlock(few.t_ns, imu.w_ib_b, imu.f_b))
    file.close()
    file.close()  # does nothing
    assert len(read_imu(tmp_path / "run.mcap")) == 10


def test_unwritable_path_and_unknown_hinge(tmp_path):
    with pytest.raises(StandError, match="cannot be written: No such file or directory"):
        writer(tmp_path / "no" / "run.mcap")
    odd = StandModel(
        (body("world", "world"), body("arm", "world", joint=Joint("elbow", (1, 0, 0)))),
        "arm", (0, 0, 0), STILL, "",
    )  # fmt: skip
    with pytest.raises(StandError, match=r"unknown joint 'elbow'.* known: base_pitch"):
        writer(tmp_path / "run.mcap", model=odd)


@pytest.mark.parametrize(
    ("times", "match"),
    [
        ([3, 2, 1], r"log.mcap: times must increase$"),
        ([1, 2, 2], r"log.mcap: times must increase$"),
        ([-1, 2, 3], r"log.mcap: times must lie between 1970 and 2038"),
        ([1, 2, 2**31 * S], r"log.mcap: times must lie between 1970 and 2038"),
    ],
)
def test_times_of_an_imported_log(tmp_path, times, match):
    path, zero = tmp_path / "log.mcap", np.zeros((3, 3))
    with pytest.raises(StandError, match=match):
        write_imu_log(path, t_ns=np.array(times), w_ib_b=zero, f_b=zero, epoch_ns=0, metadata={})
    assert not path.exists()


def test_the_first_and_the_last_time_of_an_imported_log(tmp_path):
    path, zero, times = tmp_path / "log.mcap", np.zeros((2, 3)), np.array([0, 2**31 * S - 1])
    write_imu_log(path, t_ns=times, w_ib_b=zero, f_b=zero, epoch_ns=0, metadata={})
    np.testing.assert_array_equal(read_imu(path).t_ns, times)


# --- foreign logs of joints


def turning(n, **options):
    return [joint_state(k * MS + 1, ("table",), [k], [2.0 * k], **options) for k in range(n)]


def joint_file(path, topics):
    return foreign(path, topics, type_name=schemas.JOINT_STATE, chunk_size=4000)


def test_joints_of_a_foreign_file(tmp_path):
    """Names in another order from message to message, two byte orders, over many chunks."""
    messages = []
    for k in range(3000):
        names, values = ("a", "b"), [k, -k]
        if k % 3 == 1:
            names, values = names[::-1], values[::-1]
        rates = [values[0] + 0.5, values[1] + 0.5]
        messages.append(joint_state(k * MS + 1, names, values, rates, "f" * (k % 4), "<>"[k % 2]))
    log = read_joints(joint_file(tmp_path / "log.mcap", {"/table/joints": messages}))
    assert (log.topic, log.names) == ("/table/joints", ("a", "b"))
    k = np.arange(3000)
    np.testing.assert_array_equal(log.t_ns, k * MS + 1)
    np.testing.assert_array_equal(log.angles, np.stack([k, -k], axis=1))
    np.testing.assert_array_equal(log.rates, np.stack([k, -k], axis=1) + 0.5)


@pytest.mark.parametrize("rates", [(), (float("nan"),)])
def test_joints_without_rates(tmp_path, rates):
    messages = [*turning(2), joint_state(S, ("table",), [9.0], rates)]
    log = read_joints(joint_file(tmp_path / "log.mcap", {"/joint_states": messages}))
    assert log.rates is None
    np.testing.assert_array_equal(log.angles[:, 0], [0.0, 1.0, 9.0])


@pytest.mark.parametrize(
    ("topics", "match"),
    [
        ({}, r"no topic with sensor_msgs/msg/JointState; it has: no topics$"),
        ({"/j": []}, r"/j: has no messages$"),
        (
            {"/b": turning(1), "/a": turning(1)},
            r"several topics with sensor_msgs/msg/JointState and none is /joint_states: /a, /b$",
        ),
        ({"/j": [*turning(2), turning(1)[0]]}, r"/j: message 2: header stamp 1 ns is not later"),
        (
            {"/j": [*turning(1), joint_state(S, ("table", "x"), [1, 2])]},
            r"/j: message 1: joints table, x, must be table as before$",
        ),
        (
            {"/j": [joint_state(1, ("a", "a"), [1, 2])]},
            r"/j: message 0: joints a, a: must be one or more, each once$",
        ),
        (
            {"/j": [joint_state(1, ("a", "b"), [1])]},
            r"/j: message 0: 1 angles, must be 2, one for each joint$",
        ),
        (
            {"/j": [joint_state(1, ("a", "b"), [1, 2], [1])]},
            r"/j: message 0: 1 rates, must be 2, one for each joint, or none$",
        ),
        (
            {"/j": [*turning(1), joint_state(S, ("table",), [float("inf")])]},
            r"/j: message 1: position \[inf\] is not finite$",
        ),
        (
            {"/j": [*turning(1), turning(2)[1][:40]]},
            r"/j: message 1: 40 bytes, sensor_msgs/msg/JointState needs \d+ or more$",
        ),
    ],
)
def test_faults_of_joints(tmp_path, topics, match):
    path = joint_file(tmp_path / "log.mcap", topics)
    with pytest.raises(StandError, match=match) as caught:
        read_joints(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


# --- satellites


def nav_sat_fix(t_ns, place, frame="gps", order="<", status=0, variance=25.0, kind=2):
    """A sensor_msgs/msg/NavSatFix, field by field; degrees."""
    text = frame.encode() + b"\0"
    body = struct.pack(f"{order}iI", *divmod(t_ns, S)) + struct.pack(f"{order}I", len(text)) + text
    body += struct.pack("b", status)
    body += bytes(-len(body) % 2) + struct.pack(f"{order}H", 1)
    body += bytes(-len(body) % 8) + struct.pack(f"{order}3d", *place)
    body += struct.pack(f"{order}9d", *np.diag([variance] * 3).ravel())
    body += struct.pack("B", kind)
    return bytes([0, 1 if order == "<" else 0, 0, 0]) + body


def twist(t_ns, v, frame="enu", order="<", variance=None):
    """A TwistStamped, or with a variance a TwistWithCovarianceStamped, field by field."""
    text = frame.encode() + b"\0"
    body = struct.pack(f"{order}iI", *divmod(t_ns, S)) + struct.pack(f"{order}I", len(text)) + text
    body += bytes(-len(body) % 8) + struct.pack(f"{order}6d", *v, 0, 0, 0)
    if variance is not None:
        covariance = np.diag([variance] * 3 + [-1.0] * 3)
        body += struct.pack(f"{order}36d", *covariance.ravel())
    return bytes([0, 1 if order == "<" else 0, 0, 0]) + body


PLACES = [[48.5, 9.25, 300.0], [-33.0, -151.5, -12.0]]  # deg, deg, m
SPEEDS = [[1.0, -2.0, 3.0], [20.0, 0.5, -0.25]]


@pytest.mark.parametrize("frame", ["imu", "gp", "a", ""])
def test_satellite_bytes_by_hand_are_those_of_rosbags_and_ours(frame):
    from rosbags.typesys import Stores, get_typestore

    store, stamps = get_typestore(Stores.ROS2_HUMBLE), np.array([5, 3 * S + 7])
    degrees = np.array(PLACES) * [np.pi / 180, np.pi / 180, 1]
    fixes = cdr.fix_messages(stamps, degrees, frame_id=frame, variance=25.0)
    twists = cdr.velocity_messages(stamps, np.array(SPEEDS), frame_id=frame, variance=0.01)
    for k, t_ns in enumerate(stamps.tolist()):
        fix = store.deserialize_cdr(fixes[k].tobytes(), schemas.NAV_SAT_FIX)
        assert (stamp(fix.header), fix.header.frame_id) == (t_ns, frame)
        # degrees and back: two roundings
        place = [fix.latitude, fix.longitude, fix.altitude]
        np.testing.assert_allclose(place, PLACES[k], rtol=5e-16)
        hand = nav_sat_fix(t_ns, place, frame)
        assert fixes[k].tobytes() == hand == bytes(store.serialize_cdr(fix, schemas.NAV_SAT_FIX))
        velocity = store.deserialize_cdr(twists[k].tobytes(), schemas.TWIST_WITH_COVARIANCE_STAMPED)
        assert xyz(velocity.twist.twist.linear) == SPEEDS[k]
        assert twists[k].tobytes() == twist(t_ns, SPEEDS[k], frame, variance=0.01)


@settings(max_examples=40, deadline=None)
@given(st.lists(messages, min_size=1, max_size=6))
def test_any_mixture_of_satellite_messages_is_decoded(drawn):
    for make, decode, value in (
        (nav_sat_fix, decode_fixes, lambda batch: batch.place / [np.pi / 180, np.pi / 180, 1]),
        (twist, lambda *a: decode_velocities(*a, covariance=False), lambda batch: batch.v),
    ):
        data, starts, sizes = b"", [], []
        for sec, nanosec, frame, order, x, before in drawn:
            data += before
            starts.append(len(data))
            data += make(sec * S + nanosec, np.clip(x[:3], -1e9, 1e9), frame, order)
            sizes.append(len(data) - starts[-1])
        batch = decode(np.frombuffer(data, np.uint8), np.array(starts), np.array(sizes))
        np.testing.assert_array_equal(batch.t_ns, [m[0] * S + m[1] for m in drawn])
        # degrees and back: two roundings, of the smallest numbers too
        wanted = np.clip([m[4][:3] for m in drawn], -1e9, 1e9)
        np.testing.assert_allclose(value(batch), wanted, rtol=5e-16, atol=1e-320)


def write_road(path, n=2500):
    """A drive of 2.5 s with a fix before the first sample, one a second, and one behind the end."""
    truth, imu = blocks(n)
    t_ns = np.array([0, 1000, 2000, 2600]) * MS
    place = np.array([[0.5, -3.0, 10.0], [0.6, 3.0, 20.0], [-0.7, 0.1, 30.0], [0.8, 0.2, 40.0]])
    satellites = Satellites(t_ns, place, np.arange(12.0).reshape(4, 3), 25.0, 0.0025)
    with DriveWriter(
        path,
        satellites=satellites,
        metadata=METADATA,
        attachments={"drive.toml": ("application/toml", b"leg = []")},
        rate_noise=RATE_NOISE,
        force_noise=FORCE_NOISE,
    ) as file:
        file.write(truth, imu)
    return truth, imu, satellites


def test_a_drive_in_rosbags(tmp_path):
    truth, imu, satellites = write_road(tmp_path / "run.mcap")
    found = decoded(tmp_path / "run.mcap")
    assert set(found) == {"/imu/data", "/imu/truth", "/gnss/fix", "/gnss/velocity"}
    for topic, block in (("/imu/data", imu), ("/imu/truth", truth)):
        rates = [xyz(m.angular_velocity) for _, m in found[topic]]
        np.testing.assert_array_equal(rates, block.w_ib_b)
    np.testing.assert_array_equal([xyzw(m.orientation) for _, m in found["/imu/truth"]], truth.q_wb)
    fixes, velocities = found["/gnss/fix"], found["/gnss/velocity"]
    for messages in (fixes, velocities):
        assert [t - EPOCH_NS for t, _ in messages] == satellites.t_ns.tolist()
        assert [stamp(m.header) - EPOCH_NS for _, m in messages] == satellites.t_ns.tolist()
    np.testing.assert_allclose([m.latitude for _, m in fixes], np.degrees(satellites.place[:, 0]))
    np.testing.assert_allclose([m.longitude for _, m in fixes], np.degrees(satellites.place[:, 1]))
    np.testing.assert_array_equal([m.altitude for _, m in fixes], satellites.place[:, 2])
    np.testing.assert_array_equal([xyz(m.twist.twist.linear) for _, m in velocities], satellites.v)
    _, fix = fixes[0]
    assert (fix.status.status, fix.position_covariance_type) == (0, 2)
    np.testing.assert_array_equal(fix.position_covariance, np.diag([25.0] * 3).ravel())
    _, velocity = velocities[0]
    assert velocity.header.frame_id == "enu"
    np.testing.assert_array_equal(
        np.diag(velocity.twist.covariance.reshape(6, 6))[:3], [0.0025] * 3
    )


def test_a_drive_in_our_reader(tmp_path):
    path = tmp_path / "run.mcap"
    truth, imu, satellites = write_road(path)
    fixes, velocities = read_fixes(path), read_velocities(path)
    assert (fixes.topic, velocities.topic) == ("/gnss/fix", "/gnss/velocity")
    assert len(fixes) == len(velocities) == 4
    for log in (fixes, velocities):
        np.testing.assert_array_equal(log.t_ns, EPOCH_NS + satellites.t_ns)
    # degrees and back: two roundings, 1e-9 m
    np.testing.assert_allclose(fixes.place, satellites.place, rtol=5e-16)
    np.testing.assert_array_equal(velocities.v, satellites.v)
    np.testing.assert_array_equal(fixes.variance, [25.0] * 4)
    np.testing.assert_array_equal(velocities.variance, [0.0025] * 4)
    np.testing.assert_array_equal(read_imu(path).w_ib_b, imu.w_ib_b)
    np.testing.assert_array_equal(read_truth(path).q_wb, truth.q_wb)
    with open(path, "rb") as file:
        times = [m.log_time for _, _, m in make_reader(file, validate_crcs=True).iter_messages()]
    assert times == sorted(times)


def test_rerun_finds_nothing_wrong_with_a_drive(tmp_path):
    write_road(tmp_path / "run.mcap")
    result = rerun(tmp_path, "check", "--full", tmp_path / "run.mcap")
    assert result.returncode == 0, result.stderr


def test_fixes_of_a_foreign_file(tmp_path):
    """Other topics, messages without a fix or a covariance, both byte orders."""
    path = tmp_path / "fix.mcap"
    made = [
        nav_sat_fix(
            k + 1, PLACES[k % 2], "f" * k, "<>"[k % 2], (0, -1, 2, 0)[k], 9.0, (0, 2, 3, 1)[k]
        )
        for k in range(4)
    ]
    log = read_fixes(foreign(path, {"/ublox/fix": made}, type_name=schemas.NAV_SAT_FIX))
    np.testing.assert_array_equal(log.t_ns, [1, 3, 4])
    np.testing.assert_array_equal(log.variance, [np.nan, 9.0, 9.0])
    np.testing.assert_allclose(log.place[2, :2], np.radians([-33.0, -151.5]))
    with pytest.raises(StandError, match="no topic with geometry_msgs/msg/TwistWithCov"):
        read_velocities(path)
    path = tmp_path / "lost.mcap"
    lost = {"/fix": [nav_sat_fix(1, [np.nan] * 3, status=-1)]}
    with pytest.raises(StandError, match=r"/fix: no message has a fix: their status is below 0$"):
        read_fixes(foreign(path, lost, type_name=schemas.NAV_SAT_FIX))


@pytest.mark.parametrize("variance", [None, 0.04, 0.0])
def test_velocities_of_a_foreign_file(tmp_path, variance):
    kind = schemas.TWIST_STAMPED if variance is None else schemas.TWIST_WITH_COVARIANCE_STAMPED
    made = [twist(k + 1, SPEEDS[k], "f" * k, "<>"[k], variance) for k in range(2)]
    log = read_velocities(foreign(tmp_path / "v.mcap", {"/vel": made}, type_name=kind))
    np.testing.assert_array_equal(log.v, SPEEDS)
    np.testing.assert_array_equal(log.variance, [variance or np.nan] * 2)


@pytest.mark.parametrize(
    ("made", "match"),
    [
        ([nav_sat_fix(1, PLACES[0])[:60]], r"/fix: message 0: 60 bytes, sensor_msgs/msg/NavSatFix"),
        ([nav_sat_fix(1, [np.nan, 0, 0])], r"/fix: message 0: latitude.* is not finite$"),
        ([nav_sat_fix(2, PLACES[0])] * 2, r"/fix: message 1: header stamp 2 ns is not later"),
    ],
)
def test_faults_of_fixes(tmp_path, made, match):
    path = foreign(tmp_path / "log.mcap", {"/fix": made}, type_name=schemas.NAV_SAT_FIX)
    with pytest.raises(StandError, match=match) as caught:
        read_fixes(path)
    assert str(caught.value).startswith(f"{path}: ")


def test_the_index_of_a_chunk_takes_few_bytes(tmp_path):
    """A day is 86 400 chunks: as objects, of 2 kB each, their index was 200 MB."""
    one, payload = np.array([0]), np.zeros((1, 8), np.uint8)
    with Container(
        tmp_path / "a.mcap", [Topic("/a", "std_msgs/msg/Int8", "int8 data", "")]
    ) as file:
        file.chunk([Part(0, one, payload)])
        tracemalloc.start()
        before, _ = tracemalloc.get_traced_memory()
        for k in range(1, 501):
            file.chunk([Part(0, one + k, payload)])
        after, _ = tracemalloc.get_traced_memory()
        tracemalloc.stop()
    assert (after - before) / 500 < 400  # bytes: 110 in the file, room to grow, and what is once
    with open(tmp_path / "a.mcap", "rb") as file:
        found = make_reader(file).get_summary()
    assert [c.message_start_time for c in found.chunk_indexes] == list(range(501))
    assert (found.statistics.chunk_count, found.statistics.message_end_time) == (501, 500)
