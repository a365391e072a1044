"""Text and binary as loggers leave it: one table in many dresses must give one log."""

import numpy as np
import pytest

from stand.errors import StandError
from stand.recording.foreign import LogForm, load_foreign
from stand.recording.inspection import inspect
from stand.recording.log_columns import guessed_columns
from stand.recording.text_table import fields_of, is_text

COLUMNS = "t,gx,gy,gz,ax,ay,az"
N = 60
T_NS = 10_000_000 * np.arange(1, N + 1)
VALUES = np.random.default_rng(3).normal(size=(N, 6)).round(9)
TEXT = [[f"{t / 1e9:.2f}", *(f"{x:.9f}" for x in v)] for t, v in zip(T_NS, VALUES, strict=True)]
UNIX = 1_700_000_000_000_000_000


def form(columns=COLUMNS, gyro="rad/s", accel="m/s^2", **more) -> LogForm:
    return LogForm(columns=columns, gyro_unit=gyro, accel_unit=accel, **more)


def written(path, rows=TEXT, separator=",", head="", end="\n", tail="", encoding="utf-8"):
    body = end.join(separator.join(row) + tail for row in rows) + end
    path.write_bytes((head.replace("\n", end) + body).encode(encoding))
    return path


def check(log, t_ns=T_NS, values=VALUES):
    np.testing.assert_array_equal(log.t_ns, t_ns)
    np.testing.assert_array_equal(np.concatenate([log.w_ib_b, log.f_b], axis=1), values)


def refusal(path, form):
    with pytest.raises(StandError) as caught:
        load_foreign(path, form)
    return str(caught.value)


@pytest.mark.parametrize(
    ("byte", "text"),
    [
        *((byte, False) for byte in (0, 8, 14, 25, 27, 31)),
        *((byte, True) for byte in (9, 13, 26, 32, 127, 255)),
    ],
)
def test_what_no_text_holds(tmp_path, byte, text):
    """Control characters, but for tabs, ends of lines and what ends a file of DOS (26)."""
    path = tmp_path / "log"
    path.write_bytes(b"1,2\n" + bytes([byte]))
    assert is_text(path) == text
    path.write_bytes(b"\xff\xfe" + bytes([byte, 0]))  # of two bytes a character
    assert is_text(path)
    path.write_bytes(b"\xfe\xff" + bytes([0, byte]))
    assert is_text(path)


# --- header lines, comments, ends of lines


@pytest.mark.parametrize(
    ("separator", "head"),
    [
        (" ", "# t gx gy gz ax ay az, static log\n"),
        (",", "log of unit 7\nt,gx,gy,gz,ax,ay,az\n"),
        ("\t", "// rate 100 Hz\n// option a, b\nt\tgx\tgy\tgz\tax\tay\taz\n"),
        (" ", ""),
        (";", "% made by hand\n%\n\nserial;12;34\nt;gx;gy;gz;ax;ay;az\n"),
        (",", "60\nseconds,rad/s,rad/s,rad/s,m/s^2,m/s^2,m/s^2\n"),
        ("  ", "unit 7, 2026-01-02, 48.5 N\n" * 30),
        (",", "0,1,2,3,4,5,6\n"),
        (";", "1;2;3;4;5;6;7\n"),
        ("\t", "unit 7\n0\t1\t2\t3\t4\t5\t6\n"),
        (" ", "0 1 2 3 4 5 6\n"),
    ],
)
@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_header_lines_are_no_samples(tmp_path, separator, head, end):
    check(load_foreign(written(tmp_path / "a.log", TEXT, separator, head, end), form()))


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "latin-1"])
def test_encodings(tmp_path, encoding):
    path = written(tmp_path / "a.csv", head="t,gx [°/s],gy,gz,ax,ay,az\n", encoding=encoding)
    check(load_foreign(path, form()))


def test_comments_among_the_rows_and_behind_them(tmp_path):
    rows = [[*row[:-1], row[-1] + (" # touched" if k == 7 else "")] for k, row in enumerate(TEXT)]
    rows.insert(20, ["# restarted", "no"])
    check(load_foreign(written(tmp_path / "a.csv", rows), form()))


# --- decimal commas


@pytest.mark.parametrize("separator", [";", "\t", " ", "; "])
@pytest.mark.parametrize("head", ["", "t{0}gx{0}gy{0}gz{0}ax{0}ay{0}az\n", "Messung 1, Halle 2\n"])
def test_decimal_commas(tmp_path, separator, head):
    rows = [[x.replace(".", ",") for x in row] for row in TEXT]
    path = written(tmp_path / "a.csv", rows, separator, head.format(separator))
    check(load_foreign(path, form()))


# --- columns of text, trailing separators, names


def test_any_column_is_skipped_whatever_is_in_it(tmp_path):
    rows = [[x, "imu_link", '"a, b"', "", *row] for x, *row in TEXT]
    path = written(tmp_path / "a.csv", rows, head="t,frame,note,none,gx,gy,gz,ax,ay,az\n")
    check(load_foreign(path, form("t,-,-,-,gx,gy,gz,ax,ay,az")))


@pytest.mark.parametrize("separator", [",", ";", "\t"])
@pytest.mark.parametrize("columns", [COLUMNS, COLUMNS + ",-"])
def test_trailing_separators(tmp_path, separator, columns):
    path = written(tmp_path / "a.csv", TEXT, separator, tail=separator)
    check(load_foreign(path, form(columns)))


def test_columns_by_name_and_by_number(tmp_path):
    head = "frame,Acc Z,Acc Y,Acc X,Gyro Z (deg/s),Gyro Y (deg/s),Gyro X (deg/s),time_us\n"
    rows = [["imu", *row[:0:-1], str(t // 1000)] for row, t in zip(TEXT, T_NS, strict=True)]
    path = written(tmp_path / "a.csv", rows, head=head)
    columns = "t=time_us,gx=Gyro X (deg/s),gy=gyro y (deg/s),gz=5,ax=Acc X,ay=Acc Y,az=2"
    log = load_foreign(path, form(columns, gyro=None))
    np.testing.assert_array_equal(log.t_ns, T_NS)
    np.testing.assert_allclose(log.w_ib_b, np.radians(VALUES[:, :3]), rtol=1e-15)
    np.testing.assert_array_equal(log.f_b, VALUES[:, 3:])
    assert log.notes == ("time unit us: from the header", "gyro unit deg/s: from the header")
    assert refusal(path, form(columns.replace("Acc X", "Acc W"))).startswith(
        "unknown column of the log 'Acc W': did you mean Acc "
    )
    assert refusal(path, form(columns, accel=None)).startswith(
        "--accel-unit: must be given, no header names one (known: "
    )


def test_a_header_that_contradicts_is_told(tmp_path):
    path = written(tmp_path / "a.csv", head="t,gx_dps,gy_dps,gz_dps,ax_g,ay_g,az_g\n")
    log = load_foreign(path, form())
    assert log.notes == (
        "the header says deg/s, --gyro-unit says rad/s: rad/s is used",
        "the header says g, --accel-unit says m/s^2: m/s^2 is used",
    )
    taken = load_foreign(path, form(gyro=None, accel=None))
    np.testing.assert_allclose(taken.f_b, 9.80665 * VALUES[:, 3:], rtol=1e-15)


@pytest.mark.parametrize(
    "units", ["s,deg/s,deg/s,deg/s,g,g,g", "[s],[dps],[dps],[dps],[g],[g],[g]"]
)
def test_a_line_of_units_below_the_names(tmp_path, units):
    path = written(tmp_path / "a.csv", head=f"unit 7\nZeit,gx,gy,gz,ax,ay,az\n{units}\n")
    log = load_foreign(path, form("t=Zeit [s],gx=2,gy=3,gz=4,ax=5,ay=6,az=7", None, None))
    np.testing.assert_allclose(log.w_ib_b, np.radians(VALUES[:, :3]), rtol=1e-15)
    np.testing.assert_allclose(log.f_b, 9.80665 * VALUES[:, 3:], rtol=1e-15)
    assert inspect(path).guesses == tuple(COLUMNS.split(","))


# --- gaps and faults


@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_an_empty_field_is_a_gap_that_is_told(tmp_path, separator):
    rows = [list(row) for row in TEXT]
    rows[20][3] = rows[21][0] = ""
    log = load_foreign(written(tmp_path / "a.csv", rows, separator, "words\n"), form())
    kept = [k for k in range(N) if k not in (20, 21)]
    check(log, T_NS[kept], VALUES[kept])
    assert log.notes == ("2 rows with an empty or cut off field left out, a gap each: line 22, 23",)


def test_a_row_that_is_no_row_is_named(tmp_path):
    rows = [*TEXT[:30], TEXT[30][:4], *TEXT[31:]]
    path = written(tmp_path / "a.csv", rows, head="one\ntwo\n")
    assert refusal(path, form()) == (
        f"{path}: line 33: 4 columns, but --columns names 7 (use - to skip one)"
    )
    rows[30] = [*TEXT[30][:3], "1_0", *TEXT[30][4:]]
    written(path, rows)
    assert refusal(path, form()) == f"{path}: line 31, column 4 = '1_0': must be a number"


def test_a_name_that_two_columns_have_tells_none(tmp_path):
    """As it is written it may tell them apart; a number always does."""
    columns = "t=t,gx={},gy=3,gz=4,ax=5,ay=6,az=7"
    path = written(tmp_path / "a.csv", head="t,x,y,z,X,y,z\n")
    for name in ("y", "Y"):
        assert refusal(path, form(columns.format(name))) == (
            f"column {name!r}: 2 have this name: give its number"
        )
    for one in ("x", "2"):
        check(load_foreign(path, form(columns.format(one))))


def test_a_row_of_columns_by_name_may_be_longer_and_not_shorter(tmp_path):
    """By name nobody says how many there are: those that are asked for must be there."""
    columns = "t=1,gx=2,gy=3,gz=4,ax=5,ay=6,az=7"
    long = [*TEXT[:30], [*TEXT[30], "more"], *TEXT[31:]]
    check(load_foreign(written(tmp_path / "a.csv", long), form(columns)))
    short = [*TEXT[:30], TEXT[30][:6], *TEXT[31:]]
    path = written(tmp_path / "b.csv", short)
    assert refusal(path, form(columns)) == f"{path}: line 31: 6 columns, column 7 is asked for"


# --- times


@pytest.mark.parametrize(
    ("unit", "text"),
    [
        ("ns", lambda ns: str(ns)),
        ("us", lambda ns: f"{ns // 1000}.{ns % 1000:03d}"),
        ("s", lambda ns: f"{ns // 10**9}.{ns % 10**9:09d}"),
        ("iso", lambda ns: f"2023-11-14T22:13:{20 + (ns - UNIX) // 10**9}.{ns % 10**9:09d}Z"),
    ],
)
@pytest.mark.parametrize("told", [True, False])
def test_times_since_1970_to_the_nanosecond(tmp_path, unit, text, told):
    """1 700 000 000 s is 2023-11-14T22:13:20Z; a double has steps of 256 ns there."""
    t_ns = UNIX + 10_000_001 * np.arange(1, N + 1)
    rows = [[text(int(t)), *row[1:]] for t, row in zip(t_ns, TEXT, strict=True)]
    log = load_foreign(
        written(tmp_path / "a.csv", rows, head="words\n"), form(time_unit=unit if told else None)
    )
    check(log, t_ns - UNIX)
    assert log.epoch_ns == UNIX
    found = () if told or unit == "s" else (f"time unit {unit}: from the first stamp",)
    assert log.notes == found


def test_seconds_and_nanoseconds(tmp_path):
    stamps = [[str(t // 10**9), str(t % 10**9)] for t in UNIX + T_NS]
    rows = [[*s, "imu_link", *row[1:]] for s, row in zip(stamps, TEXT, strict=True)]
    path = written(tmp_path / "a.csv", rows)
    log = load_foreign(path, form("sec,nanosec,-,gx,gy,gz,ax,ay,az"))
    check(log)
    assert log.epoch_ns == UNIX
    told = refusal(path, form("t,-,-,gx,gy,gz,ax,ay,az"))
    assert told.endswith("are nanoseconds in another column (sec,nanosec)?")


def test_no_time_at_all(tmp_path):
    rows = [row[1:] for row in TEXT]
    rows[7][2] = ""
    log = load_foreign(written(tmp_path / "a.csv", rows), form("gx,gy,gz,ax,ay,az", rate_hz=100))
    kept = [k for k in range(N) if k != 7]  # the row that is left out has had its time
    check(log, T_NS[kept], VALUES[kept])
    assert refusal(tmp_path / "a.csv", form("gx,gy,gz,ax,ay,az")) == (
        "--columns gx,gy,gz,ax,ay,az: t stands 0 times, must stand once"
    )


# --- units


@pytest.mark.parametrize(
    ("more", "w", "f"),
    [
        ({"gyro": "dps", "accel": "ug"}, 0.017453292519943295, 9.80665e-6),
        ({"gyro": "mdps", "accel": "mg"}, 1.7453292519943295e-5, 9.80665e-3),
        ({"gyro": "deg/h", "accel": "m/s2"}, 4.84813681109536e-6, 1.0),
        # counts of 131 LSB per deg/s and 16384 LSB per g
        (
            {"gyro": "dps", "gyro_scale": 1 / 131, "accel": "g", "accel_scale": 1 / 16384},
            1.3323124061025417e-4,
            5.985504150390625e-4,
        ),
        # increments over 10 ms
        ({"gyro": "deg", "accel": "m/s"}, 1.7453292519943295, 100.0),
        ({"gyro": "rad", "accel": "mm/s"}, 100.0, 0.1),
    ],
)
def test_units_of_data_sheets_by_hand(tmp_path, more, w, f):
    log = load_foreign(written(tmp_path / "a.csv"), form(**more))
    np.testing.assert_allclose(log.w_ib_b, w * VALUES[:, :3], rtol=1e-12)
    np.testing.assert_allclose(log.f_b, f * VALUES[:, 3:], rtol=1e-12)


def test_increments_beside_a_gap_are_of_one_sample(tmp_path):
    rows = [*TEXT[:20], *TEXT[30:]]
    log = load_foreign(written(tmp_path / "a.csv", rows), form(gyro="rad"))
    np.testing.assert_allclose(log.w_ib_b[20], 100 * VALUES[30, :3], rtol=1e-12)
    assert log.notes == ("gyro: increments, taken over 0.01 s each",)


def test_counts_need_their_size(tmp_path):
    assert refusal(written(tmp_path / "a.csv"), form(gyro="LSB")).endswith(
        "--gyro-unit deg/s --gyro-scale 0.01"
    )


# --- binary


@pytest.mark.parametrize("kind", ["<f8", ">f8", "<f4", ">f4"])
@pytest.mark.parametrize("skip", [0, 17])
def test_binary_of_any_kind(tmp_path, kind, skip):
    table = np.column_stack([T_NS / 1e9, VALUES])[:, [4, 0, 1, 2, 3, 5, 6]].astype(kind)
    path = tmp_path / "a.ins"
    path.write_bytes(bytes(skip) + table.tobytes())
    told = form("ax,t,gx,gy,gz,ay,az")
    log = load_foreign(path, form(told.columns, file_format=kind, skip_bytes=skip))
    rounding = 2e-7 if kind.endswith("4") else 1e-15  # of float32 and float64
    np.testing.assert_allclose(log.f_b, VALUES[:, 3:], rtol=rounding)
    np.testing.assert_allclose(log.t_ns, T_NS, rtol=rounding)
    if kind != "<f8" and not skip:
        assert f"--format '{kind}'" in refusal(path, told)


def test_binary_counts(tmp_path):
    table = np.column_stack([T_NS // 1000, np.round(1000 * VALUES)]).astype("<i4")
    table.tofile(tmp_path / "a.bin")
    more = {"gyro_scale": 1e-3, "accel_scale": 1e-3, "time_unit": "us", "file_format": "<i4"}
    log = load_foreign(tmp_path / "a.bin", form(**more))
    np.testing.assert_array_equal(log.t_ns, T_NS)
    np.testing.assert_allclose(log.f_b, VALUES[:, 3:].round(3), rtol=1e-12)


@pytest.mark.parametrize("kind", ["nonsense", "O", "U4", "f4,f8", "c8"])
def test_types_that_are_no_numbers(tmp_path, kind):
    assert refusal(written(tmp_path / "a.csv"), form(file_format=kind)).startswith(
        f"unknown format '{kind}': "
    )


# --- a look first


def test_a_look_says_what_to_type(tmp_path):
    rows = [[*row[:4], *(f"{x / 9.80665:.6f}" for x in (0.0, -9.80665, 0.0))] for row in TEXT]
    head = "unit 7\nTime [us],gyro_x_dps,gyro_y_dps,gyro_z_dps,acc.x,acc.y,acc.z\n"
    found = inspect(written(tmp_path / "a.csv", rows, head=head))
    assert found.form == "7 columns between commas, 2 lines of header"
    assert found.guesses == tuple(COLUMNS.split(","))
    assert found.command == (
        f"stand import {tmp_path / 'a.csv'} --columns {COLUMNS} --accel-unit g --out a.mcap"
    )
    assert found.lines()[1].startswith("   1  t       Time [us]: 0.01, 0.02, 0.03 ...")


@pytest.mark.parametrize(
    ("head", "guesses"),
    [
        (
            "%time,field.header.seq,field.header.frame_id,field.angular_velocity.x,"
            "field.angular_velocity.y,field.linear_acceleration.x,field.linear_acceleration.z",
            "t,-,-,gx,gy,ax,az",
        ),
        ("sec,nanosec,wx,wy,wz,fx,fy", "sec,nanosec,gx,gy,gz,ax,ay"),
        ("GyroX (deg/s),Gyr_Y,Gyro Z,Accel_X,AccY,accelerometer z,temp", "gx,gy,gz,ax,ay,az,-"),
    ],
)
def test_names_that_are_known(tmp_path, head, guesses):
    found = inspect(written(tmp_path / "a.csv", head=head + "\n"))
    assert ",".join(found.guesses) == guesses


@pytest.mark.parametrize(
    ("names", "guesses"),
    [
        ("time sec nanosec week tow gx", "t - - - - gx"),  # one time is enough
        ("week tow sec nanosec", "week tow - -"),
        ("sec nanosec week", "sec nanosec week"),
        ("gx gyro_x temp", "gx - -"),  # the first counts
    ],
)
def test_of_several_times_one_is_taken(names, guesses):
    assert guessed_columns(names.split(), 6) == guesses.split()


def test_a_look_at_any_numbers(tmp_path):
    """1e200 squared is beyond a double: no warning, and no unit."""
    rows = [[*row[:4], "1e200", "1e200", "1e200"] for row in TEXT]
    path = written(tmp_path / "a.csv", rows, head="t,gx,gy,gz,ax,ay,az\n")
    assert "--accel-unit UNIT" in inspect(path).command


@pytest.mark.parametrize(
    ("width", "guess"), [(6, "-,-,-,-,-,-"), (7, "t,gx,gy,gz,ax,ay,az"), (8, "-,-,-,-,-,-,-,-")]
)
def test_seven_columns_without_names_are_a_time_and_six_channels(tmp_path, width, guess):
    rows = [",".join(f"{0.01 * k + 0.1 * c:.3f}" for c in range(width)) for k in range(20)]
    path = tmp_path / "log.csv"
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")
    assert f" --columns {guess} " in inspect(path).lines()[-1]


@pytest.mark.parametrize(
    ("line", "separator", "fields"),
    [
        ('"a b"\t1\t2', "\t", ["a b", "1", "2"]),
        ('"a\tb"\t1', "\t", ["a\tb", "1"]),
        ('"a b"\t1 2', None, ["a b", "1", "2"]),
        ('"a, b", 2,3', ",", ["a, b", "2", "3"]),
        ("1;2 # so", ";", ["1", "2"]),
    ],
)
def test_quotes_hold_a_field_together(line, separator, fields):
    assert fields_of(line, separator) == fields
