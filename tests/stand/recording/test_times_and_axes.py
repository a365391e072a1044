"""Times of every kind, and axes of every convention, each against numbers by hand."""

import numpy as np
import pytest
from written_logs import EARTH, G, at_rest

import stand
from stand.errors import StandError
from stand.recording.axes import axes_of
from stand.recording.entrance import read_imu
from stand.recording.log_form import LogForm

W, F = at_rest(300)
N = len(W)
COLUMNS = "gx,gy,gz,ax,ay,az"
UNITS = {"gyro_unit": "rad/s", "accel_unit": "m/s^2"}


def text(path, stamps, form="%s", header=""):
    """Rows with the given columns of stamps, as texts, before the readings."""
    rows = [
        ",".join([*(form % x for x in row), *(f"{x:.17g}" for x in values)])
        for row, values in zip(stamps, np.c_[W, F], strict=True)
    ]
    path.write_text("\n".join([header, *rows] if header else rows) + "\n")
    return path


def arrays(path, stamps):
    columns = [np.array([row[k] for row in stamps]) for k in range(len(stamps[0]))]
    named = {f"c{k}": column for k, column in enumerate(columns)}
    np.savez(path, **named, gyro=W, acc=F)
    return path


def by_number(path, names):
    """Columns by their place, whatever the kind of file."""
    if path.suffix == ".npz":
        names = ",".join(f"{n}=c{k}" for k, n in enumerate(names.split(",")))
        axes = [f"{s}{a}={'gyro' if s == 'g' else 'acc'}_{a}" for s in "ga" for a in "xyz"]
        return f"{names},{','.join(axes)}"
    return f"{names},{COLUMNS}"


KINDS = pytest.mark.parametrize("kind", ["csv", "npz"])


def written(tmp_path, kind, stamps):
    path = tmp_path / f"a.{kind}"
    return text(path, stamps) if kind == "csv" else arrays(path, stamps)


@KINDS
@pytest.mark.parametrize(
    ("step", "period", "unit", "step_ns"),
    [
        (10, 256, "ms", 10_000_000),  # a byte of milliseconds
        (1, 128, "10ms", 10_000_000),  # a counter of samples
        (100, 65536, "100us", 10_000_000),  # Xsens: ticks of 0.1 ms
    ],
)
def test_a_counter_that_begins_anew(tmp_path, kind, step, period, unit, step_ns):
    counts = [(int(k * step % period),) for k in range(N)]
    path = written(tmp_path, kind, counts)
    form = LogForm(columns=by_number(path, "t"), time_unit=unit, wrap=period, **UNITS)
    log = read_imu(path, form=form)
    np.testing.assert_array_equal(log.t_ns - log.t_ns[0], step_ns * np.arange(N))
    with pytest.raises(StandError, match=r"row \d+, column t = .* must be within 0 and --wrap"):
        read_imu(path, form=LogForm(**kept(form) | {"wrap": period // 4}))
    if period * step_ns // step < N * step_ns:
        with pytest.raises(StandError, match=r"must be above the row before"):
            read_imu(path, form=LogForm(**kept(form) | {"wrap": None}))


def kept(form):
    return {name: getattr(form, name) for name in form.__slots__}


@KINDS
@pytest.mark.parametrize("late", [0, 3])
def test_samples_handed_over_together_have_stamps_of_their_own(tmp_path, kind, late):
    """100 Hz in packets of six, all with the last one's stamp in ms, and `late` s lost in one
    place: the unit's own stamps come back, and the gap stays."""
    own = 10 * (1 + np.arange(N)) + 1000 * late * (np.arange(N) >= 150)
    path = written(tmp_path, kind, [(int(own[k // 6 * 6 + 5]),) for k in range(N)])
    log = read_imu(path, form=LogForm(columns=by_number(path, "t"), time_unit="ms", **UNITS))
    np.testing.assert_array_equal(np.diff(log.t_ns), np.diff(own) * 1_000_000)
    assert "a stamp stands 6 times: taken for samples that were handed over together" in log.notes


@KINDS
def test_stamps_that_are_rounded_are_told_apart(tmp_path, kind):
    """Of 150 Hz to 20 ms, three each: the last, cut off, follow; the first do not lie below 0."""
    path = written(tmp_path, kind, [(k // 3 * 20,) for k in range(N)])
    log = read_imu(path, form=LogForm(columns=by_number(path, "t"), time_unit="ms", **UNITS))
    np.testing.assert_allclose(np.diff(log.t_ns), 20e6 / 3, atol=1)


def test_two_units_of_one_log_are_no_packets(tmp_path):
    other = W + 0.01
    path = tmp_path / "a.csv"
    rows = [(k // 2 * 10, *(W if k % 2 else other)[k], *F[k]) for k in range(N)]
    path.write_text("\n".join(",".join(f"{x:.17g}" for x in row) for row in rows) + "\n")
    with pytest.raises(StandError, match=r"each stamp stands 2 times, .* those of 2 units"):
        read_imu(path, form=LogForm(columns=by_number(path, "t"), time_unit="ms", **UNITS))


def test_a_lost_sample_of_a_counter_is_a_gap(tmp_path):
    there = [k for k in range(N) if k not in (50, 51, 130)]
    path = tmp_path / "a.csv"
    rows = np.c_[np.array(there) % 128, np.c_[W, F][there]]
    np.savetxt(path, rows, "%.17g", ",")
    form = LogForm(columns=f"t,{COLUMNS}", time_unit="10ms", wrap=128, **UNITS)
    log = read_imu(path, form=form)
    np.testing.assert_array_equal(log.t_ns - log.t_ns[0], 10_000_000 * np.array(there))


@KINDS
@pytest.mark.parametrize(("week", "unit"), [(2300, "s"), (2300, "ms"), (252, "s")])
def test_gps_weeks(tmp_path, kind, week, unit):
    """Week 2300 begins on Sunday, 4 February 2024: 1707004800; 252 is the same in ten bits.

    The samples run over the end of that week.
    """
    seconds = 604800 - 1.5 + np.arange(N) / 100
    late = seconds >= 604800
    tow = (seconds - 604800 * late) * (1000 if unit == "ms" else 1)
    stamps = [(int(week + x), round(float(s), 6)) for x, s in zip(late, tow, strict=True)]
    path = written(tmp_path, kind, stamps)
    form = LogForm(columns=by_number(path, "week,tow"), time_unit=unit, **UNITS)
    log = read_imu(path, form=form)
    begin = (1707004800 + 604800) * 10**9 - 1_500_000_000
    np.testing.assert_allclose(log.t_ns - begin, 10_000_000 * np.arange(N), atol=1)


def test_gps_weeks_by_header_and_seconds_of_a_week_alone(tmp_path):
    seconds = (604800 - 1.5 + np.arange(N) / 100) % 604800
    header = "GPSWeek,GPSSecondsOfWeek,gx_rad_s,gy_rad_s,gz_rad_s,ax_m_s2,ay_m_s2,az_m_s2"
    weeks = [2300 + (s < 1000) for s in seconds]
    path = text(tmp_path / "a.csv", [(w, f"{s:.2f}") for w, s in zip(weeks, seconds, strict=True)],
                header=header.replace("GPSSecondsOfWeek", "TOW"))  # fmt: skip
    log = read_imu(path)
    assert "columns by their headers: week=GPSWeek, tow=TOW" in log.notes[0]
    assert log.t_ns[0] == (1707004800 + 604800) * 10**9 - 1_500_000_000
    path = text(tmp_path / "b.csv", [(f"{s:.2f}",) for s in seconds])
    form = LogForm(columns=f"t,{COLUMNS}", wrap=604800, **UNITS)
    steps = np.diff(read_imu(path, form=form).t_ns)
    np.testing.assert_array_equal(steps, 10_000_000)


@KINDS
def test_two_columns_of_time(tmp_path, kind):
    t_ns = 1_700_000_000 * 10**9 + 990_000_000 + 10_000_000 * np.arange(N)
    stamps = [(int(t // 10**9), int(t % 10**9)) for t in t_ns]
    path = written(tmp_path, kind, stamps)
    form = LogForm(columns=by_number(path, "sec,nanosec"), **UNITS)
    np.testing.assert_array_equal(read_imu(path, form=form).t_ns, t_ns)


@pytest.mark.parametrize("bad", ["x", "0s", "1.5ns", "", "min", "-1s", "100", "1e3us", ".s"])
def test_units_of_time_that_are_none(bad):
    with pytest.raises(StandError, match=r"unknown time unit"):
        LogForm(time_unit=bad)


# Axes --------------------------------------------------------------------------------------------

# Along forward, right, down of a level unit whose nose points to 30 deg, by hand: Earth rate is
# (north cos 30, -north sin 30, -up), specific force points up.
NORTH, UP = EARTH * np.cos(np.radians(48.5)), EARTH * np.sin(np.radians(48.5))
RATE = {"forward": NORTH * np.cos(np.pi / 6), "right": -NORTH / 2, "up": UP}
FORCE = {"forward": 0.0, "right": 0.0, "up": G}
MEANING = {
    "FRD": ("forward", "right", "-up"),
    "FLU": ("forward", "-right", "up"),
    "RFU": ("right", "forward", "up"),
    "ENU-body": ("right", "forward", "up"),
    "FUR": ("forward", "up", "right"),
    "z,-y,x": ("right", "-up", "forward"),
}


def along(values, axes):
    return np.array([values[a.lstrip("-")] * (-1 if a[0] == "-" else 1) for a in axes])


@pytest.mark.parametrize("name", MEANING)
def test_conventions(tmp_path, name, stand_command):
    rng = np.random.default_rng(2)
    w = along(RATE, MEANING[name]) + 1e-7 * rng.standard_normal((N, 3))
    f = along(FORCE, MEANING[name]) + 1e-4 * rng.standard_normal((N, 3))
    path = tmp_path / "a.csv"
    head = "t,gx_rad_s,gy_rad_s,gz_rad_s,ax_m_s2,ay_m_s2,az_m_s2"
    np.savetxt(path, np.c_[np.arange(N) / 100, w, f], "%.17g", ",", header=head, comments="")
    (found,) = stand.align(stand.read(path, form=LogForm(axes=name))).estimates
    # 1e-7/sqrt(300) rad/s of 4.8e-5: 0.007 deg; three sigma
    assert np.degrees(found.heading) == pytest.approx(30.0, abs=0.02)
    assert np.degrees(found.latitude) == pytest.approx(48.5, abs=0.02)
    told = stand_command("import", path, "--axes", name, "--out", tmp_path / "a.mcap", "--json")
    assert told.code == 0, told.err
    (after,) = stand.align(stand.read(tmp_path / "a.mcap")).estimates
    assert after.heading == found.heading


def test_without_axes_x1_is_the_logs_x(tmp_path):
    """FRD as it is: Y1 right is taken for up: the unit lies on its side, roll is 90 deg."""
    rate, force = (along(v, MEANING["FRD"]) for v in (RATE, FORCE))
    path = tmp_path / "a.csv"
    head = "t,gx_rad_s,gy_rad_s,gz_rad_s,ax_m_s2,ay_m_s2,az_m_s2"
    noise = np.random.default_rng(3).standard_normal((N, 6)) * np.repeat([1e-8, 1e-5], 3)
    rows = np.c_[np.arange(N) / 100, np.r_[rate, force] + noise]
    np.savetxt(path, rows, "%.17g", ",", header=head, comments="")
    (found,) = stand.align(path).estimates
    assert np.degrees(found.heading) == pytest.approx(30.0, abs=0.02)
    roll = np.degrees(found.angles[0])
    assert abs(roll) == pytest.approx(90.0, abs=0.01)


@pytest.mark.parametrize(
    ("axes", "told"),
    [
        ("x,y", "unknown --axes 'x,y'"),
        ("x,x,z", "must have x, y and z once each"),
        ("x,-y,z", r"is left-handed, one sign must be the other: x,y,z\?"),
        ("FLD", "unknown --axes 'FLD': did you mean "),
    ],
)
def test_axes_that_are_none(axes, told):
    with pytest.raises(StandError, match=told):
        LogForm(axes=axes)


def test_every_named_convention_is_right_handed():
    for name in MEANING:
        turn = axes_of(name).of(np.eye(3)).T
        assert np.linalg.det(turn) == pytest.approx(1.0)
