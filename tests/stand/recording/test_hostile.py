"""A file is not believed: no bytes lead to a traceback, to waiting or to much memory."""

import json
import struct
import time
from io import BytesIO

import numpy as np
import pytest
import zstandard
from lz4 import frame as lz4
from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Chunk, DataEnd, Footer, Metadata
from scipy.spatial.transform import Rotation
from test_mcap import by_hand, foreign

from alignment import Options, Site
from stand.errors import StandError
from stand.physics.mjcf import describe, load_model
from stand.recording.log import load_log
from stand.recording.mcap.container import MAGIC
from stand.recording.mcap.reader import read_imu, read_truth
from stand.recording.mcap.records import MOST_CHUNK_BYTES, whole_records
from stand.recording.mcap.writer import EPOCH_NS, McapWriter
from stand.recording.metadata import describe_estimate, describe_site
from stand.samples import ImuBlock, TruthBlock
from stand.table.joints import JOINTS

SOON_S = 10.0
C_NB = [0.5, 0.5, 0.5, 0.5]
STEP = {
    "kind": "dwell",
    "label": "A",
    "t_from_s": 0.0,
    "t_to_s": 4.0,
    "steady_from_s": 0.0,
    "steady_to_s": 4.0,
    "joints_deg": [0.0] * 6,
    "C_nb_xyzw": C_NB,
    "turning": None,
}
TURN = STEP | {
    "label": "B",
    "t_from_s": 4.0,
    "t_to_s": 8.0,
    "steady_from_s": 4.0,
    "steady_to_s": 8.0,
    "turning": {"axis": JOINTS[5], "rate_deg_s": 1.0, "axis_b": [0.0, 1.0, 0.0]},
}
METADATA = {
    "run": {"stand_version": "0", "epoch_ns": str(EPOCH_NS)},
    "site": describe_site(Site(0.8)),
    "schedule": {"json": json.dumps([STEP, TURN])},
    "estimate": describe_estimate(Options(), ["triad"]),
}


def recording(path, metadata=None, q=None):
    """A rest and a turn, 10 samples a second."""
    n, rng = 80, np.random.default_rng(0)
    t_ns = np.arange(1, n + 1) * 100_000_000
    w, f = 1e-6 * rng.normal(size=(2, n, 3))
    joints = np.zeros((n, len(JOINTS)))
    joints[40:, 5] = np.arange(1, 41) * 0.1 * np.pi / 180
    w[40:, 1] += np.pi / 180
    q = np.tile([0.0, 0.0, 0.0, 1.0], (n, 1)) if q is None else q
    earth = np.array([0.0, 5e-5, 5e-5])
    f += np.array([0.1, 9.8, 0.1])
    truth = TruthBlock(t_ns, w, f, q, joints, 0 * joints, joints, 0 * joints)
    with McapWriter(
        path,
        model=describe(load_model()),
        robot_description="",
        metadata=METADATA if metadata is None else metadata,
        attachments={},
        rate_noise=np.zeros(3),
        force_noise=np.zeros(3),
    ) as file:
        file.write(truth, ImuBlock(t_ns, w + earth, f))
    return path


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    return recording(tmp_path_factory.mktemp("hostile") / "run.mcap")


def records(data):
    """(opcode, content) of every record."""
    at, found = len(MAGIC), []
    while at < len(data) - len(MAGIC):
        opcode, size = struct.unpack_from("<BQ", data, at)
        found.append((opcode, data[at + 9 : at + 9 + size]))
        at += 9 + size
    return found


def written(*parts):
    """The bytes of records."""
    builder = RecordBuilder()
    for part in parts:
        part.write(builder)
    return builder.end()


def chunk(data, compression="", size=None):
    """A chunk without checksum; `size` is what it says of its length."""
    return written(Chunk(compression, data, 0, 0, 0, len(data) if size is None else size))


def rebuilt(data, replace=None, summary_start=None):
    """The same file without compression or checksums; `replace` stands for its chunks."""
    out, start, done = bytearray(MAGIC), 0, False
    for opcode, content in records(data):
        if opcode == Opcode.CHUNK:
            zipped = Chunk.read(ReadDataStream(BytesIO(content)))
            if replace is None:
                out += chunk(zstandard.decompress(zipped.data))
            elif not done:
                out += replace
            done = True
        elif opcode == Opcode.DATA_END:
            out += written(DataEnd(0))
            start = len(out)
        elif opcode == Opcode.FOOTER:
            out += written(Footer(start if summary_start is None else summary_start, 0, 0))
        elif opcode != Opcode.MESSAGE_INDEX:
            out += struct.pack("<BQ", opcode, len(content)) + content
    return bytes(out) + MAGIC


def test_the_file_without_checksums_is_the_same(whole, tmp_path, stand_command):
    plain = tmp_path / "plain.mcap"
    plain.write_bytes(rebuilt(whole.read_bytes()))
    np.testing.assert_array_equal(read_imu(plain).f_b, read_imu(whole).f_b)
    assert stand_command("align", plain).code == stand_command("align", whole).code == 0


HUGE = 2**63


@pytest.mark.parametrize(
    ("part", "said"),
    [
        (chunk(b"", "zstd", HUGE), f"a chunk of {HUGE} bytes, must be at most {MOST_CHUNK_BYTES}"),
        (chunk(b"x", "", 9), "a chunk holds other than the 9 bytes that it states"),
        # bombs: what they expand to is known, or found out, before it is made
        (chunk(zstandard.compress(bytes(10**7)), "zstd", 100), "other than the 100 bytes"),
        (chunk(lz4.compress(bytes(10**7)), "lz4", 100), "other than the 100 bytes"),
        (chunk(b"\x05" + struct.pack("<Q", HUGE)), "reaches past the end of its chunk"),
        (chunk(b"\x05" + struct.pack("<Q", 3) + b"abc"), "a message record is too short"),
        (chunk(b"\x05"), "damaged"),
        (struct.pack("<BQ", Opcode.CHUNK, HUGE), "a record reaches past the end"),
        (struct.pack("<BQ", Opcode.CHUNK, 3) + b"abc", "damaged"),
        (written(Chunk("rot13", b"", 0, 0, 0, 0)), "unknown compression 'rot13'"),
    ],
)
def test_lengths_are_held_against_the_file(whole, tmp_path, part, said):
    path = tmp_path / "bad.mcap"
    path.write_bytes(rebuilt(whole.read_bytes(), part))
    with pytest.raises(StandError, match=said):
        read_imu(path)


@pytest.mark.parametrize("start", [1, 10**6, HUGE, 2**64 - 1])
def test_a_summary_that_is_not_there(whole, tmp_path, start):
    path = tmp_path / "bad.mcap"
    path.write_bytes(rebuilt(whole.read_bytes(), None, start))
    with pytest.raises(StandError, match=r"bad\.mcap: damaged"):
        read_imu(path)


def changed(*where, to):
    """The metadata with one value changed; into the JSON of the schedule if there are more keys."""
    record, key, *inside = where
    values = {name: dict(value) for name, value in METADATA.items()}
    if not inside:
        values[record][key] = to
        return values
    content = json.loads(values[record][key])
    here = content
    for step in inside[:-1]:
        here = here[step]
    here[inside[-1]] = to
    values[record][key] = json.dumps(content)
    return values


@pytest.mark.parametrize(
    ("where", "to", "said"),
    [
        (("run", "epoch_ns"), "9" * 24, "epoch_ns = '999999999999999999999999': must be less than"),
        (("run", "epoch_ns"), "-1", "epoch_ns = '-1': must be greater than or equal to 0"),
        (("site", "latitude_deg"), "91", "site: latitude_deg = '91': must be less than or equal"),
        (("site", "height_m"), "nan", "site: height_m = 'nan': must be"),
        (("site", "gravity_m_s2"), "0", "site: gravity_m_s2 = '0': must be greater than 9"),
        (("estimate", "offset_window_s"), "0", "offset_window_s = '0': must be greater than 0"),
        (("estimate", "sequences"), "mine", "sequences = 'mine': must be 'regular' or"),
        (("estimate", "prior_turn_rad"), "-1", "prior_turn_rad = '-1': must be greater than"),
        (("estimate", "prior_turn_rad"), "1e308", "prior_turn_rad = '1e308': must be less than"),
        (("schedule", "json"), "[" * 9999, "schedule: json = "),
        (("schedule", "json"), "{}", "schedule: json = a table: must be"),
        (("schedule", "json", 0), 3, "schedule: json, 0 = 3: must be a table"),
        (("schedule", "json", 0, "t_to_s"), 1e308, "json, 0, t_to_s = 1e\\+308: must be less"),
        (("schedule", "json", 0, "label"), ["A"], "json, 0, label = .*: must be a valid string"),
        (("schedule", "json", 0, "C_nb_xyzw"), [0] * 4, "C_nb_xyzw.*: must be of length 1"),
        (("schedule", "json", 0, "C_nb_xyzw"), [1], "C_nb_xyzw, 1: required, but missing"),
        (("schedule", "json", 1, "turning", "axis_b", 1), [0], "axis_b, 1 = .*: must be a valid"),
        (("schedule", "json", 1, "turning", "axis"), "tail", "unknown .*joint 'tail'"),
    ],
)
def test_metadata_is_checked(tmp_path, where, to, said):
    path = recording(tmp_path / "bad.mcap", changed(*where, to=to))
    with pytest.raises(StandError, match=said) as told:
        load_log(path, None, None, None)
    assert str(told.value).startswith(f"{path}: ")
    assert len(str(told.value)) < 500


@pytest.mark.parametrize("value", [0.0, 1e300])
def test_an_orientation_that_is_none(tmp_path, value):
    q = Rotation.identity(80).as_quat()
    q[7] = value
    path = recording(tmp_path / "bad.mcap", q=q)
    with pytest.raises(StandError, match=r"message 7: orientation \[.*: must be of length 1"):
        read_truth(path)


def test_readings_beyond_any_unit_are_refused(tmp_path):
    path = foreign(tmp_path / "huge.mcap", {"/imu": [by_hand(5, (1e200, 0, 0), (0, 0, 1))]})
    with pytest.raises(StandError, match=r"message 0: angular_velocity .*must be at most 1e\+06"):
        read_imu(path)


EXTREMES = [b"\0", b"\xff", b"\x7f", b"\x80", b"\xff" * 4, b"\xff" * 8, b"\0" * 7 + b"\x80"]


@pytest.mark.slow
def test_no_flipped_bytes_lead_to_a_traceback(whole, tmp_path, stand_command):
    """Bytes anywhere in a file without checksums, half of them with a value at an edge."""
    data, rng = rebuilt(whole.read_bytes()), np.random.default_rng(4)
    # schemas and the model are most of a small file's bytes, and text that nobody reads
    text = {content for opcode, content in records(data) if opcode == Opcode.SCHEMA}
    dull = np.zeros(len(data), bool)
    for content in text:
        at = data.find(content)
        while at >= 0:
            dull[at + 40 : at + len(content)] = True
            at = data.find(content, at + 1)
    places, codes = np.flatnonzero(~dull), set()
    for case in range(300):
        bad, at = bytearray(data), int(rng.choice(places))
        new = EXTREMES[rng.integers(len(EXTREMES))] if case % 2 else bytes([rng.integers(256)])
        bad[at : at + len(new)] = new
        path = tmp_path / "bad.mcap"
        path.write_bytes(bad[: len(data)])
        begin = time.monotonic()
        outcome = stand_command("align", path)  # what is no known fault is raised here
        assert outcome.code in (0, 2), (case, at)
        assert outcome.err.count("\n") == (outcome.code == 2)
        assert time.monotonic() - begin < SOON_S, (case, at)
        codes.add(outcome.code)
    assert codes == {0, 2}


@pytest.mark.slow
def test_no_value_in_the_metadata_leads_to_a_traceback(tmp_path, stand_command):
    hostile = [
        None,
        True,
        -1,
        0,
        2**63,
        1e308,
        -1e308,
        "",
        "x",
        "1",
        [],
        [[]],
        {},
        [0] * 4,
        "9" * 5000,
    ]
    inside = [(n, key) for n in (0, 1) for key in STEP]
    inside += [(1, "turning", key) for key in TURN["turning"]]
    inside += [(1, "turning", "axis_b", 0), (0, "C_nb_xyzw", 3), (0, "joints_deg", 2)]
    flat = [(r, key) for r in METADATA for key in METADATA[r] if (r, key) != ("schedule", "json")]
    rng = np.random.default_rng(5)
    cases = [(place, value) for place in (*flat, *inside) for value in hostile]
    for k in rng.choice(len(cases), 150, replace=False):
        place, value = cases[k]
        where = place if place in flat else ("schedule", "json", *place)
        value = str(value) if place in flat else value
        path = recording(tmp_path / "bad.mcap", changed(*where, to=value))
        outcome = stand_command("align", path)
        assert outcome.code in (0, 2), (where, value)
        assert outcome.err.count("\n") == (outcome.code == 2), (where, value)


def test_metadata_records_are_the_last_of_a_name(whole, tmp_path):
    """A second record of one name stands, as in every reader of the format."""
    data = whole.read_bytes()
    at = data.index(written(DataEnd(0))[:9])
    late = written(Metadata("run", METADATA["run"] | {"epoch_ns": "x"}))
    path = tmp_path / "late.mcap"
    path.write_bytes(rebuilt(data[:at] + late + data[at:]))
    with pytest.raises(StandError, match="epoch_ns = 'x': must be a valid integer"):
        load_log(path, None, None, None)


def test_records_of_a_file_that_ends_anywhere():
    """By hand: whole ones count, up to zeros of a power cut, to one that is cut off, or DataEnd."""

    def record(opcode, content):
        return struct.pack("<BQ", opcode, len(content)) + content

    def found(*parts):
        return list(whole_records(BytesIO(b"\x89MCAP0\r\n" + b"".join(parts))))

    header, chunk, end = record(1, b"ab"), record(6, b"abcd"), record(15, b"1234")
    two = [(1, b"ab"), (6, b"abcd")]
    assert found(header, chunk) == two
    assert found(header, chunk, bytes(30), chunk) == two
    assert found(header, chunk, chunk[:-1]) == found(header, chunk, chunk[:5]) == two
    assert found(header, chunk, end, chunk) == [*two, (15, b"1234")]
    assert found() == []
