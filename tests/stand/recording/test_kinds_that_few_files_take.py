"""What few files have: branches of formats, and both sides of every limit of what is stated."""

import gzip
import zipfile
from math import inf, nan, pi, radians

import h5py
import numpy as np
import pytest
from written_logs import at_rest, mcap, ros1_bag, stamps

import stand
from stand.errors import StandError
from stand.recording.content import kind_of
from stand.recording.entrance import read_imu
from stand.recording.formats.hdf5 import read_hdf5
from stand.recording.formats.numpy_files import read_npy, read_npz
from stand.recording.formats.table import table_of
from stand.recording.found_stretches import stretches_of
from stand.recording.inspection import inspect
from stand.recording.log_form import LogForm
from stand.recording.named_stretches import StretchesEntry, load_stretches
from stand.recording.time_stamps import array_ns, gps_ns

COLUMNS = "t,gx,gy,gz,ax,ay,az"
HEAD = "t [s],gx [rad/s],gy [rad/s],gz [rad/s],ax [m/s^2],ay [m/s^2],az [m/s^2]\n"
ROWS = "".join(f"{k / 10},0.{k},0,0,0,9.8,0\n" for k in range(1, 6))


# --- what is stated of a log


@pytest.mark.parametrize(
    ("field", "within", "without", "words"),
    [
        ("rate_hz", (1e-3, 1e6), (0.99e-3, 1.01e6, nan), "must be 0.001 to 1e6 Hz"),
        ("wrap", (1e-9, 1e12), (0.0, -1.0, inf, nan), "must be above 0"),
        ("skip_bytes", (0, 10**9), (-1,), "must be 0 or more"),
        ("gyro_scale", (1e-12, 1e12), (0.0, -1.0, inf, nan), "must be above 0"),
        ("accel_scale", (1e-12, 1e12), (0.0, -1.0, inf, nan), "must be above 0"),
    ],
)
def test_a_form_keeps_its_limits(field, within, without, words):
    option = {"rate_hz": "--rate"}.get(field, "--" + field.replace("_", "-"))
    for value in within:
        assert getattr(LogForm(**{field: value}), field) == value
    for value in without:
        with pytest.raises(StandError) as told:
            LogForm(**{field: value})
        assert str(told.value) == f"{option} {value:g}: {words}"


def test_a_form_knows_two_kinds_of_stamps():
    with pytest.raises(StandError, match="unknown --stamps 'soon'"):
        LogForm(stamps="soon")
    assert [LogForm(stamps=s).stamps for s in ("header", "log")] == ["header", "log"]


def test_a_form_says_what_samples_are_unless_the_recording_does():
    with pytest.raises(StandError, match="unknown --sampling 'means'"):
        LogForm(sampling="means")
    own, of_instants = {"sampling": "mean"}, {"sampling": "instant"}
    assert [LogForm().instants(run) for run in ({}, own, of_instants)] == [False, False, True]
    told = LogForm(sampling="instant")
    assert [told.instants(run) for run in ({}, of_instants)] == [True, True]
    with pytest.raises(StandError, match="--sampling instant: the recording says mean"):
        told.instants(own)
    assert (told.metadata({}), LogForm().metadata({})) == (of_instants, {})


def test_what_says_nothing_of_such_a_log_is_refused_by_the_option_s_name():
    form = LogForm(rate_hz=5.0, file_format="csv", gyro_scale=2.0)
    names = {"rate_hz": "--rate", "file_format": "--format", "gyro_scale": "--gyro-scale"}
    for field, option in names.items():
        with pytest.raises(StandError, match=f"^x: {option}: no such thing$"):
            form.refuse("x", (field,), "no such thing")
    form.refuse("x", ("accel_scale", "wrap"), "was not stated")
    left = form.without(("rate_hz", "gyro_scale"))
    assert left == LogForm(file_format="csv")


# --- arrays that stand together, and those that do not


def test_columns_of_arrays_by_their_shape():
    """Rows of three with a unit are axes; the longer axis is time, whichever it is."""
    n = 5
    arrays = {
        "t [s]": np.arange(1.0, n + 1)[:, None],
        "gyro [rad/s]": np.arange(3.0 * n).reshape(3, n),
        "accel [m/s^2]": np.arange(3.0 * n).reshape(n, 3) + 100,
        "temperature": np.arange(2.0),
        "name": np.zeros((1, 1, 1)),
    }
    table = table_of(arrays)
    assert table.names == (
        "t [s]", "gyro_x [rad/s]", "gyro_y [rad/s]", "gyro_z [rad/s]",
        "accel_x [m/s^2]", "accel_y [m/s^2]", "accel_z [m/s^2]",
    )  # fmt: skip
    assert (table.rows, table.width, table.topic) == (n, 7, "")
    assert table.column(2).tolist() == [5, 6, 7, 8, 9]
    assert table.column(5).tolist() == [101, 104, 107, 110, 113]
    assert table.notes == (
        "left aside, of another length: temperature",
        "arrays lie with time along their second axis",
    )
    four = table_of({"a": np.zeros((9, 4)), "b": np.zeros(9)})
    assert four.names == ("a_1", "a_2", "a_3", "a_4", "b")
    assert four.notes == ()


def test_a_group_of_a_file_and_what_is_no_group():
    arrays = {"a.t": np.zeros(4), "a.gx": np.zeros(4), "ab.t": np.zeros(9), "one": np.zeros(1)}
    chosen = table_of(arrays, "a")
    assert (chosen.topic, chosen.names, chosen.rows) == ("a", ("t", "gx"), 4)
    with pytest.raises(StandError, match="unknown --topic 'c'"):
        table_of(arrays, "c")
    for left, words in (({"one": np.zeros(1)}, "one"), ({}, "nothing")):
        with pytest.raises(StandError, match=f"^no columns of 2 or more rows: it has {words}$"):
            table_of(left)
    # 64 columns are columns, 65 are none
    assert table_of({"a": np.zeros((65, 64))}).width == 64
    with pytest.raises(StandError, match="no columns"):
        table_of({"a": np.zeros((66, 65))})


def test_zip_files_that_hold_no_log(tmp_path):
    path = tmp_path / "a.npz"
    for name, words in (
        ("xl/workbook.xml", "is an Excel workbook: save it as CSV"),
        ("a.txt", "a zip file without arrays of NumPy"),
    ):
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr(name, "x")
        with pytest.raises(StandError, match=f"^{path}: {words}$"):
            read_npz(path, None)
    big = b"\0" * 2_000_000  # deflate makes a thousandth of it; a claim of more is a lie
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("a.npy", big)
    packed = path.read_bytes()
    claimed = packed.replace((2_000_000).to_bytes(4, "little"), (4_000_000).to_bytes(4, "little"))
    assert claimed != packed
    path.write_bytes(claimed)
    with pytest.raises(StandError, match=r"damaged: a\.npy cannot be of 4000000 bytes"):
        read_npz(path, None)


def test_fields_of_an_array_are_columns(tmp_path):
    rows = np.zeros(6, [("t", float), ("gx", float), ("pair", [("a", float)])])
    rows["gx"] = np.arange(6)
    np.save(tmp_path / "a.npy", rows)
    table = read_npy(tmp_path / "a.npy", None)
    assert table.names == ("t", "gx")  # a field of fields is none
    assert table.column(1).tolist() == [0, 1, 2, 3, 4, 5]
    np.savez(tmp_path / "a.npz", log=rows, other=np.zeros(3))
    table = read_npz(tmp_path / "a.npz", None)
    assert table.names == ("log.t", "log.gx")
    assert table.notes == ("left aside, of another length: other",)


def test_fields_of_a_dataset_are_columns(tmp_path):
    path = tmp_path / "a.h5"
    rows = np.zeros(6, [("t", float), ("gx", float)])
    rows["gx"] = np.arange(6)
    with h5py.File(path, "w") as file:
        file.create_group("run")["log"] = rows
    table = read_hdf5(path, None)
    assert table.names == ("run.log.t", "run.log.gx")
    assert table.column(1).tolist() == [0, 1, 2, 3, 4, 5]
    with pytest.raises(StandError, match="--topic"):
        read_hdf5(path, "other")


def arrays_of(tmp_path, array, columns: str | None = COLUMNS):
    path = tmp_path / "a.npy"
    np.save(path, array)
    return read_imu(path, form=LogForm(columns=columns, gyro_unit="rad/s", accel_unit="m/s^2"))


def test_arrays_and_columns_that_do_not_fit(tmp_path):
    rows = np.zeros((9, 7))
    rows[:, 0] = np.arange(9)
    assert len(arrays_of(tmp_path, rows)) == 9
    for columns, words in (
        ("t=8,gx=2,gy=3,gz=4,ax=5,ay=6,az=7", "unknown column of the log '8': known: 1 to 7"),
        (COLUMNS + ",-", r"7 columns, but --columns names 8 \(use - to skip one\)"),
        (COLUMNS.removesuffix(",az") + ",-,az", "7 columns, column 8 is asked for"),
    ):
        with pytest.raises(StandError, match=words):
            arrays_of(tmp_path, rows, columns)
    texts = np.zeros(3, [(name, "U3" if name == "gy" else float) for name in COLUMNS.split(",")])
    with pytest.raises(StandError, match="column gy: <U3, must be numbers"):
        arrays_of(tmp_path, texts, None)


# --- what stands in the way of a log


def test_what_is_refused_before_it_is_read(tmp_path):
    text = tmp_path / "a.csv"
    text.write_text(HEAD + ROWS, encoding="utf-8")
    twice = tmp_path / "twice.csv.gz"
    twice.write_bytes(gzip.compress(gzip.compress(text.read_bytes())))
    array = tmp_path / "a.npy"
    np.save(array, np.arange(63.0).reshape(9, 7))
    messages = mcap(tmp_path / "a.mcap", stamps(4), *at_rest(4))
    binary = tmp_path / "a.bin"
    binary.write_bytes(b"\0\1\2\3" * 70)
    iso = tmp_path / "iso.csv"
    iso.write_text(HEAD + ROWS.replace("0.", "2024-01-01T00:00:0", 5), encoding="utf-8")
    for path, form, topic, words in (
        (text, LogForm(), "imu", "--topic: is for logs with topics, this is a table"),
        (twice, LogForm(), None, "is compressed twice"),
        (array, LogForm(columns=COLUMNS, skip_bytes=1), None,
         "--skip-bytes: is for binary rows, this is an array of NumPy"),
        (messages, LogForm(columns=COLUMNS), None, "--columns"),
        (binary, LogForm(), None, "rows of binary numbers need --columns"),
        (binary, LogForm(columns="t=1,gx=2,gy=3,gz=4,ax=5,ay=6,az=7"), None,
         "binary rows need every column in order"),
    ):  # fmt: skip
        with pytest.raises(StandError, match=words):
            read_imu(path, topic, form)


def test_stretches_of_a_log_are_longer_than_nothing(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text(HEAD + ROWS, encoding="utf-8")
    log = stand.read(path)
    for shortest in (0.0, -1.0, inf, nan):
        with pytest.raises(StandError, match=f"shortest = {shortest:g} s: must be above 0"):
            stretches_of(log, shortest)
    assert stretches_of(log, 1e-9).topic == log.topic


# --- a look at a file


def test_a_look_at_messages(tmp_path):
    one = mcap(tmp_path / "a.mcap", stamps(4), *at_rest(4))
    assert kind_of(one) == "mcap"
    seen = inspect(one)
    assert (seen.form, seen.names) == ("messages of 1 topic", ("/imu/raw",))
    assert seen.guesses == ("sensor_msgs/msg/Imu",)
    assert seen.command == f"stand align {one}"
    assert seen.rows == ()
    assert seen.lines() == [
        f"{one}: messages of 1 topic",
        "      /imu/raw: sensor_msgs/msg/Imu",
        f"If that is right: stand align {one}",
    ]


def test_a_look_at_several_topics(recorded):
    """The first of them is named, in the file's order; what the truth says is one too."""
    seen = inspect(recorded.folder / "run.mcap")
    assert seen.form.startswith("messages of ")
    assert seen.form.endswith(" topics")
    imus = [n for n, kind in zip(seen.names, seen.guesses, strict=True) if kind.endswith("/Imu")]
    assert imus == ["/imu/data", "/imu/truth"]
    assert seen.command == f"stand align {recorded.folder / 'run.mcap'} --topic /imu/data"


def test_axes_of_messages(tmp_path):
    """X1 is the log's x, Y1 its -z, Z1 its y."""
    path = mcap(tmp_path / "a.mcap", stamps(4), *at_rest(4))
    plain, turned = read_imu(path), read_imu(path, form=LogForm(axes="x,-z,y"))
    for one, other in ((plain.w_ib_b, turned.w_ib_b), (plain.f_b, turned.f_b)):
        np.testing.assert_array_equal(other, one[:, [0, 2, 1]] * [1, -1, 1])
    np.testing.assert_array_equal(turned.t_ns, plain.t_ns)


def test_a_look_into_what_is_compressed(tmp_path):
    text = tmp_path / "a log.csv"
    text.write_text(HEAD + ROWS, encoding="utf-8")
    plain = inspect(text)
    packed = tmp_path / "a log.csv.gz"
    packed.write_bytes(gzip.compress(text.read_bytes()))
    seen = inspect(packed)
    assert seen.form == f"gzip, {plain.form}"
    assert plain.form == "7 columns between commas, 1 line of header"
    assert seen.path == str(packed)
    assert seen.command == plain.command.replace("a log.csv'", "a log.csv.gz'")
    assert seen.rows == plain.rows
    twice = tmp_path / "b.gz"
    twice.write_bytes(gzip.compress(packed.read_bytes()))
    with pytest.raises(StandError, match="is compressed twice"):
        inspect(twice)


def test_a_look_at_arrays(tmp_path):
    path = tmp_path / "a.npz"
    values = np.arange(54.0).reshape(9, 6)
    np.savez(path, t=np.arange(9.0), gyro=values[:, :3], accel=values[:, 3:], more=np.zeros(4))
    seen = inspect(path)
    assert seen.form == "arrays of NumPy: 7 columns of 9 rows"
    assert seen.guesses == tuple(COLUMNS.split(","))
    assert seen.rows[1][:3] == ("1.0", "6.0", "7.0")
    assert seen.lines()[2].startswith("   2  gx      gyro_x: 0.0, 6.0, 12.0")
    with pytest.raises(StandError, match="unknown --topic 'b'"):
        inspect(path, "b")
    (tmp_path / "a.bin").write_bytes(b"\0\1\2\3" * 70)
    with pytest.raises(StandError, match="--format '<f8' or another numpy type"):
        inspect(tmp_path / "a.bin")


# --- stretches that a file names


def named(**entries):
    stretch = {"kind": "dwell", "label": "a", "from_s": 1.0, "to_s": 2.0} | entries
    return StretchesEntry.model_validate({"stretch": (stretch,)})


def turned(**entries):
    return named(**({"kind": "turn", "axis": "Y1", "rate_deg_s": 3.0} | entries))


@pytest.mark.parametrize(
    ("made", "entries", "words"),
    [
        (named, {"to_s": 1.0}, "to_s = 1: must be after from_s = 1"),
        (named, {"joints_deg": {"oute": 1.0}}, "unknown joint 'oute'"),
        (turned, {"rate_deg_s": None}, "has neither, must have one of them"),
        (turned, {"joint": "outer"}, "has both, must have one of them"),
        (turned, {"joints_deg": {"outer": 1.0}}, "joints_deg: needs the turning joint, one of"),
        (turned, {"rate_deg_s": 0.0}, "rate_deg_s = 0: must not be 0; a dwell stands still"),
        (turned, {"axis": (0.0, 0.0, 0.0)}, "must not be all zero"),
    ],
)
def test_a_named_stretch_that_cannot_be(made, entries, words):
    with pytest.raises(ValueError, match=words):
        made(**entries)


def test_named_stretches_by_hand():
    (dwell,) = named(to_s=1.000001).stretches()
    assert (dwell.t_from, dwell.t_to, dwell.nominal, dwell.joints) == (1.0, 1.000001, None, ())
    (turn,) = turned(axis=(0.0, 3.0, 4.0), angle_deg=90.0).stretches()
    assert turn.axis_b == pytest.approx((0.0, 0.6, 0.8))
    assert (turn.rate, turn.angle) == pytest.approx((radians(3), pi / 2))
    assert (turn.joint, turn.joints) == (None, ())
    (turn,) = turned(rate_deg_s=None, joint="outer", joints_deg={"inner": 30.0}).stretches()
    assert (turn.rate, turn.joint, len(turn.joints)) == (None, "outer", 6)
    assert sorted(turn.joints)[-1] == pytest.approx(radians(30))
    assert sorted(turn.joints)[:-1] == [0.0] * 5
    # roll 10, yaw 20, pitch 30 deg of their own order; joints do not say otherwise
    told = {"roll": 0.0, "yaw": 90.0, "pitch": 0.0}
    (both,) = named(attitude_deg=told, joints_deg={"outer": 7.0}).stretches()
    (alone,) = named(attitude_deg=told).stretches()
    assert both.nominal == alone.nominal
    two = {"kind": "dwell", "label": "a", "from_s": 3.0, "to_s": 4.0}
    with pytest.raises(ValueError, match='stretch 2 "a", label: stretch 1 has it too'):
        StretchesEntry.model_validate({"stretch": (two | {"from_s": 1.0}, two)})
    with pytest.raises(StandError, match=r"^a\.json: must be a TOML file of stretches$"):
        load_stretches("a.json")


# --- times


def test_weeks_of_gps_by_hand():
    """Week 0 began on 6 January 1980; ten bits began anew with week 2048, on 7 April 2019."""
    begin, week = 315_964_800, 604_800
    assert gps_ns(2347.0) == (begin + 2347 * week) * 10**9
    assert gps_ns(299.0) == gps_ns(2347.0)
    assert gps_ns(0.0) == (begin + 2048 * week) * 10**9
    assert gps_ns(1024.0) == (begin + 1024 * week) * 10**9
    assert gps_ns(1023.0) == (begin + 3071 * week) * 10**9
    assert gps_ns(9999.0) == (begin + 9999 * week) * 10**9
    for wrong in (-1.0, 10_000.0, 3.5):
        with pytest.raises(ValueError, match=str(wrong)):
            gps_ns(wrong)
    parts = [np.array([2347, 2348, 2347]), np.array([1.5, 0.0, 2.0])]
    told = array_ns("x", parts, ("week", "tow"), "s")
    assert ((told - gps_ns(2347.0)) / 1e9).tolist() == [1.5, week, 2.0]
    with pytest.raises(StandError, match=r"^x: column week = 3\.5: must be a week of GPS$"):
        array_ns("x", [np.array([3.5]), np.array([0.0])], ("week", "tow"), "s")
    told = array_ns("x", [np.array([7, 8]), np.array([5, 6])], ("sec", "nanosec"), "s")
    assert told.tolist() == [7_000_000_005, 8_000_000_006]
    texts = np.array(["1.5", "x"])
    assert array_ns("x", [texts[:1]], ("t",), "ms").tolist() == [1_500_000]
    with pytest.raises(StandError, match=r"^x: row 2, column t = .*'x'.*: is no time$"):
        array_ns("x", [texts], ("t",), "ms")
    days = np.array(["1970-01-02"], "datetime64[D]")
    assert array_ns("x", [days], ("t",), "s").tolist() == [86_400 * 10**9]


# --- rates that were meant, progress, and one topic of two encodings


@pytest.mark.parametrize(
    ("seen", "said"), [(9.951, 10.0), (10.049, 10.0), (9.9496, 9.9496), (10.051, 10.051)]
)
def test_a_rate_within_half_a_percent_of_two_digits_was_meant(tmp_path, seen, said):
    """Ten seconds of rest, twenty of a turn about Y1."""
    t = np.arange(1, 601) / 20
    w = np.zeros((600, 3))
    w[200:, 1] = radians(seen)
    f = np.tile([0.0, 9.80665, 0.0], (600, 1))
    path = tmp_path / "a.csv"
    rows = "".join(",".join(f"{x:.12g}" for x in row) + "\n" for row in np.c_[t, w, f])
    path.write_text(HEAD + rows, encoding="utf-8")
    text = stretches_of(stand.read(path)).toml()
    assert f"rate_deg_s = {said}   # seen: {seen:.5g}" in text


def test_progress_of_a_bag_is_a_part_of_it(tmp_path):
    told: list[float] = []
    path = ros1_bag(tmp_path / "a.bag", stamps(), *at_rest())
    read_imu(path, progress=told.append)
    assert told
    assert told == sorted(told)
    assert 0 < told[-1] <= 1


def test_one_topic_is_of_one_encoding(tmp_path):
    from mcap.writer import Writer

    path = tmp_path / "a.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="ros2", library="test")
        for name, encoding, kind in (
            ("sensor_msgs/Imu", "ros1", "ros1msg"),
            ("sensor_msgs/msg/Imu", "cdr", "ros2msg"),
        ):
            schema = writer.register_schema(name, kind, b"")
            writer.register_channel("/imu/raw", encoding, schema)
        writer.finish()
    with pytest.raises(StandError, match="messages in 'cdr' and in 'ros1': must be of one enc"):
        read_imu(path)


def test_a_file_of_a_footer_alone_has_no_topics(tmp_path):
    """Magic, footer of 29 bytes, magic: whole, and one byte less is cut off."""
    footer = b"\x02" + (20).to_bytes(8, "little") + bytes(20)
    magic = b"\x89MCAP0\r\n"
    path = tmp_path / "a.mcap"
    path.write_bytes(magic + footer + magic)
    with pytest.raises(StandError, match="it has: no topics"):
        read_imu(path)
    path.write_bytes(magic + footer[:-1] + magic)
    with pytest.raises(StandError, match="cut off before its end"):
        read_imu(path)
