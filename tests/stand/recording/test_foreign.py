"""Foreign logs: units by hand, every kind of table, stamps to the nanosecond, faults by row."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stand.errors import StandError
from stand.recording.entrance import open_log
from stand.recording.foreign import ForeignLog, LogForm, load_foreign
from stand.recording.mcap import EPOCH_NS, read_imu, write_imu_log

LEAVE = "; leave out rows without a reading"
COLUMNS = "t,gx,gy,gz,ax,ay,az"
ROWS = [
    [0.5, 0.1, -0.2, 0.3, 0.01, 0.02, 9.8],
    [0.51, 0.4, 0.5, -0.6, 0.03, -0.04, 9.7],
    [0.53, 0.7, 0.8, 0.9, 0.05, 0.06, -9.6],
]


def load(path, columns=COLUMNS, gyro="rad/s", accel="m/s^2", **more) -> ForeignLog:
    return load_foreign(path, LogForm(columns=columns, gyro_unit=gyro, accel_unit=accel, **more))


def refusal(path, *arguments, **more) -> str:
    with pytest.raises(StandError) as caught:
        load(path, *arguments, **more)
    assert str(caught.value).isprintable()
    return str(caught.value)


def text(path, rows=ROWS, separator=",", head=""):
    lines = [separator.join(repr(x) for x in row) for row in rows]
    path.write_text(head + "\n".join(lines) + "\n", encoding="utf-8")
    return path


@pytest.fixture
def csv(tmp_path):
    return tmp_path / "log.csv"


# --- layouts


@pytest.mark.parametrize("separator", [",", ";", " ", "\t", ", ", "   "])
@pytest.mark.parametrize("head", ["", "t{0}gx{0}gy{0}gz{0}ax{0}ay{0}az\n", "# seconds{0}rad/s\n"])
def test_text_of_any_layout(csv, separator, head):
    log = load(text(csv, ROWS, separator, head.format(separator)))
    np.testing.assert_array_equal(log.w_ib_b, np.array(ROWS)[:, 1:4])
    np.testing.assert_array_equal(log.f_b, np.array(ROWS)[:, 4:])
    assert log.t_ns.tolist() == [500_000_000, 510_000_000, 530_000_000]
    assert log.epoch_ns == EPOCH_NS


@pytest.mark.parametrize("head", [b"", b"t,gx [\xb0/s],gy,gz,ax,ay,az\n"])
def test_byte_order_mark_and_other_encodings_in_a_header(csv, head):
    rows = "\n".join(",".join(map(repr, row)) for row in ROWS).encode()
    csv.write_bytes(b"\xef\xbb\xbf" + head + rows)
    assert load(csv).t_ns.tolist() == [500_000_000, 510_000_000, 530_000_000]


def test_float64_rows(tmp_path):
    path = tmp_path / "log.ins"
    np.array(ROWS).astype("<f8").tofile(path)
    log = load(path)
    np.testing.assert_array_equal(log.w_ib_b, np.array(ROWS)[:, 1:4])
    np.testing.assert_array_equal(log.f_b, np.array(ROWS)[:, 4:])
    np.testing.assert_array_equal(load(path, file_format="f8le").t_ns, log.t_ns)


def test_columns_in_any_order_and_skipped(csv):
    table = np.array(ROWS)[:, [6, 0, 3, 2, 1, 4, 5]]
    wide = np.column_stack([table[:, :2], [7.0, 8.0, 9.0], table[:, 2:], [1.0, 2.0, 3.0]])
    log = load(text(csv, wide.tolist()), "az, t,-,gz,gy,gx,ax,ay,-")
    np.testing.assert_array_equal(log.w_ib_b, np.array(ROWS)[:, 1:4])
    np.testing.assert_array_equal(log.f_b, np.array(ROWS)[:, 4:])


# --- units by hand


@pytest.mark.parametrize(
    ("gyro", "accel", "w", "f"),
    [
        ("rad/s", "m/s^2", 2.0, 3.0),
        ("deg/s", "g", 0.03490658503988659, 29.41995),  # 2 pi/180, 3 * 9.80665
        ("deg/h", "mg", 9.69627362219072e-06, 0.02941995),
    ],
)
def test_units_by_hand(csv, gyro, accel, w, f):
    log = load(text(csv, [[0, 2, 0, 0, 0, 0, 3], [1, 0, 2, 0, 0, 3, 0]]), COLUMNS, gyro, accel)
    np.testing.assert_allclose(log.w_ib_b, [[w, 0, 0], [0, w, 0]], rtol=1e-15)
    np.testing.assert_allclose(log.f_b, [[0, 0, f], [0, f, 0]], rtol=1e-15)


@pytest.mark.parametrize(
    ("unit", "stamp"), [("s", 1.5), ("ms", 1500.0), ("us", 1.5e6), ("ns", 1.5e9)]
)
def test_time_units(csv, unit, stamp):
    rows = [[0.0, *ROWS[0][1:]], [stamp, *ROWS[1][1:]]]
    assert load(text(csv, rows), time_unit=unit).t_ns.tolist() == [0, 1_500_000_000]


# --- stamps


def test_jittering_stamps_are_kept_to_the_nanosecond(csv):
    rng = np.random.default_rng(2)
    t_ns = np.cumsum(rng.integers(4_500_000, 5_500_000, 500)) + 3_600_000_000_000  # past 1 h
    values = rng.normal(size=(500, 6))
    rows = [[t / 1e9, *v] for t, v in zip(t_ns.tolist(), values.tolist(), strict=True)]
    log = load(text(csv, rows))
    np.testing.assert_array_equal(log.t_ns, t_ns)
    assert len(set(np.diff(log.t_ns).tolist())) > 100


def test_unix_times_keep_their_epoch(csv):
    rows = [[1_700_000_000.25, *ROWS[0][1:]], [1_700_000_000.5, *ROWS[1][1:]]]
    log = load(text(csv, rows))
    assert (log.epoch_ns, log.t_ns.tolist()) == (
        1_700_000_000_000_000_000,
        [250_000_000, 500_000_000],
    )


def test_times_of_neither_kind(csv):
    for start in (-1.0, 3e8, 5e9):
        rows = [[start, *ROWS[0][1:]], [start + 1, *ROWS[1][1:]]]
        if start == 3e8:  # nine years of uptime: odd, but a time
            assert load(text(csv, rows)).t_ns[0] == 300_000_000_000_000_000
        else:
            told = refusal(text(csv, rows))
            assert told.startswith(f"{csv}: column t runs from {start:g}")
            assert told.endswith("Unix time between 1990 and 2038 (is the time unit right?)")


# --- faults, each one line


def test_faults_of_columns(csv):
    text(csv)
    assert refusal(csv, "t,gx,gy,gz,ax,ay,zz") == (
        "unknown column 'zz': did you mean gz or az? known: "
        "-, ax, ay, az, gx, gy, gz, nanosec, sec, t, tow, week"
    )
    assert refusal(csv, "t,gx,gy,gz,ax,ay") == (
        "--columns t,gx,gy,gz,ax,ay: az stands 0 times, must stand once"
    )
    assert "gx stands 2 times, must stand once" in refusal(csv, "t,gx,gx,gy,gz,ax,ay,az")
    told = "7 columns, but --columns names 8 (use - to skip one)"
    assert refusal(csv, COLUMNS + ",-") == f"{csv}: {told}"


def test_faults_of_units(csv):
    text(csv)
    assert refusal(csv, COLUMNS, "dgs/s") == (
        "unknown gyro unit 'dgs/s': did you mean deg/s or rad/s or deg/h? "
        "known: arcsec, deg, deg/h, deg/s, dps, mdps, mrad/s, rad, rad/s"
    )
    assert refusal(csv, accel="m/s^3").startswith("unknown accel unit 'm/s^3': did you mean m/s^2 ")
    assert refusal(csv, time_unit="sec").startswith("unknown time unit 'sec': did you mean ")
    assert refusal(csv, file_format="cvs") == "unknown format 'cvs': did you mean csv? known: " + (
        "<f4, <f8, >f4, >f8, csv, f8le"
    )


@pytest.mark.parametrize(
    ("lines", "line"),
    [
        ("", "no rows of data"),
        ("t,gx,gy,gz,ax,ay,az\n", "no rows of data"),
        ("t,gx,gy,gz,ax,ay,az\n\n\n", "no rows of data"),
        ("0,0,0,0,0,0,1\n", "1 rows of data, at least 2 are needed"),
        (
            "0,0,0,0,0,0,1\n1,0,0,0,0,0\n",
            "line 2: 6 columns, but --columns names 7 (use - to skip one)",
        ),
        (
            "a,b,c,d,e,f,g\n0,0,0,0,0,0,1\n1,0, x1 ,0,0,0,1\n",
            "line 3, column 3 = 'x1': must be a number",
        ),
        ("0,0,0,0,0,0,1\n1,0,,0,0,0,1\n", "1 rows of data, at least 2 are needed"),
        ("0,0,0,0,0,0,1\n1,0,nan,0,0,0,1\n", "row 2, column gy = nan: must be finite" + LEAVE),
        (
            "h,,,,,,\n0,0,0,0,0,0,1\n1,0,0,0,0,inf,1\n",
            "row 2, column ay = inf: must be finite" + LEAVE,
        ),
        ("0,0,0,0,0,0,1\n1,0,0,0,0,0,1e400\n", "row 2, column az = inf: must be finite" + LEAVE),
        (
            "0,0,0,0,0,0,1\n1,0,0,0,0,0,1e308\n",
            "row 2, column az = 1e+308: must be at most 1e+09 m/s^2 (are the unit and the columns "
            "right?)",
        ),
        (
            "1,0,0,0,0,0,1\n2,0,0,0,0,0,1\n2,0,0,0,0,0,3\n",
            "row 3, column t = 2 s: must be above the row before, 2 s, by a nanosecond at least",
        ),
        (
            "1,0,0,0,0,0,1\n0.5,0,0,0,0,0,1\n2,0,0,0,0,0,1\n",
            "row 2, column t = 0.5 s: must be above the row before, 1 s, by a nanosecond at least",
        ),
        (
            "".join(f"{t % 256},0,0,0,0,0,1\n" for t in range(200, 300)),
            "row 57, column t = 0 s: must be above the row before, 255 s, by a nanosecond at least"
            "; a counter that begins anew takes --wrap",
        ),
        (
            "1,0,0,0,0,0,1\n1.0000000001,0,0,0,0,0,3\n",
            "row 2, column t = 1 s: must be above the row before, 1 s, by a nanosecond at least",
        ),
    ],
)
def test_faults_of_text(csv, lines, line):
    csv.write_text(lines, encoding="utf-8")
    assert refusal(csv, accel="g") == f"{csv}: {line}"


def test_faults_of_files(tmp_path):
    path = tmp_path / "log.bin"
    path.write_bytes(bytes(57))
    assert refusal(path) == (
        f"{path}: 57 bytes is not a whole number of rows of 7 float64 (56 bytes): truncated, "
        "another --format, or other --columns"
    )
    path.write_bytes(b"")
    assert refusal(path) == f"{path}: 0 rows of data, at least 2 are needed"
    gone = tmp_path / "gone.csv"
    assert refusal(gone) == f"{gone}: no such file"
    assert refusal(tmp_path, file_format="csv") == f"{tmp_path}: is a folder, must be a file"
    assert refusal(tmp_path, file_format="f8le") == f"{tmp_path}: is a folder, must be a file"


def test_a_folder_of_recordings_names_them(tmp_path):
    with pytest.raises(StandError, match=r"a folder without run\.mcap, holds no recording$"):
        open_log(tmp_path)
    for name in ("b", "a"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "run.mcap").touch()
    with pytest.raises(StandError, match=r"holds no recording; give one of its folders: a, b$"):
        open_log(tmp_path)


def test_a_last_line_that_was_cut_off_is_left_out(csv):
    """Its last field may be part of a number: 0.98 of 0.9801 is not read, whatever is before it."""
    whole = "".join(f"{t},0.1,0.2,0.3,0,0,1\n" for t in range(4))
    for cut in ("4,0.1,0.2,0.3,0,0", "4,0.1,0.", "4"):
        csv.write_text(whole + cut, encoding="utf-8")
        log = load(csv, accel="g")
        assert len(log.t_ns) == 4
        assert "1 row with an empty or cut off field left out, a gap each: line 5" in log.notes
    csv.write_text(whole + "4,0.1,0.2,0.3,0,0,1", encoding="utf-8")  # whole, without its end
    assert len(load(csv, accel="g").t_ns) == 5


def test_random_doubles_are_refused(tmp_path):
    """Doubles of random bits: NaN, huge, or not in order."""
    path = tmp_path / "log.bin"
    for seed in range(20):
        path.write_bytes(np.random.default_rng(seed).bytes(56 * 4))
        assert refusal(path, gyro="deg/s", accel="g").startswith(f"{path}: ")


# --- round trips

FINITE = st.floats(-1e3, 1e3)


@given(
    st.lists(st.tuples(st.integers(1, 10**9), *[FINITE] * 6), min_size=2, max_size=6),
    st.sampled_from([",", ";", " "]),
    st.booleans(),
)
def test_text_and_float64_give_the_same_log(tmp_path_factory, rows, separator, header):
    t_ns = np.cumsum([row[0] for row in rows])
    values = np.array([row[1:] for row in rows])
    table = np.column_stack([t_ns / 1e9, values])
    folder = tmp_path_factory.mktemp("logs")
    head = separator.join(COLUMNS.split(",")) + "\n" if header else ""
    from_text = load(text(folder / "log.csv", table.tolist(), separator, head))
    table.astype("<f8").tofile(folder / "log.bin")
    for log in (from_text, load(folder / "log.bin")):
        np.testing.assert_array_equal(log.t_ns, t_ns)
        np.testing.assert_array_equal(log.w_ib_b, values[:, :3])
        np.testing.assert_array_equal(log.f_b, values[:, 3:])
    out = folder / "log.mcap"
    write_imu_log(
        out,
        t_ns=from_text.t_ns,
        w_ib_b=from_text.w_ib_b,
        f_b=from_text.f_b,
        epoch_ns=from_text.epoch_ns,
        metadata={},
    )
    back = read_imu(out)
    np.testing.assert_array_equal(back.t_ns, t_ns + EPOCH_NS)
    np.testing.assert_array_equal(back.w_ib_b, values[:, :3])
    np.testing.assert_array_equal(back.f_b, values[:, 3:])


@given(st.binary(max_size=200))
def test_any_bytes_as_text_give_one_line(tmp_path_factory, data):
    path = tmp_path_factory.mktemp("any") / "log.csv"
    path.write_bytes(data)
    assert refusal(path).startswith(f"{path}: ")
