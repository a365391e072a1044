"""Profiles: a motion comes back from its file, and every fault of a file is one line."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stand.bounds import LONGEST_S
from stand.errors import StandError
from stand.motion.polynomial import Motion, summed
from stand.motion.profile import profile
from stand.motion.sway import sway
from stand.motion.waves import sines
from stand.procedure.steps import SineMotion, SwayMotion
from stand.table.joints import JOINTS

DEG = np.pi / 180
START = np.array([1.0, -2.0, 3.0, 40.0, -50.0, 60.0]) * DEG


def rocking() -> Motion:
    """Sines and sway on four axes over 30 s, from rest to rest."""
    waves = SineMotion.model_validate(
        {
            "axes": {
                "outer": {"amplitude_deg": 30.0, "frequency_hz": 0.2},
                "inner": {"amplitude_deg": 5.0, "frequency_hz": 1.0, "phase_deg": 30.0},
                "base_roll": {"amplitude_deg": 8.0, "frequency_hz": 0.15},
            }
        }
    )
    random = SwayMotion.model_validate(
        {"axes": {"base_pitch": {"rms_deg": 1.0, "frequency_hz": 0.2}}}
    )
    rng = np.random.default_rng(3)
    return summed([sines(waves, 20.0, 5.0), sway(random, 20.0, 5.0, lambda _: rng, Path())])


MOVING = ("base_roll", "base_pitch", "outer", "inner")


def exported(motion: Motion, t, orders: int, start=START) -> str:
    """A file of the motion at times (n,): angles, and rates and accelerations for `orders` 3."""
    states = [x / DEG for x in motion.joints(t)]
    states[0] = states[0] + start / DEG
    suffixes = ("_deg", "_deg_s", "_deg_s2")[:orders]
    header = ["time_s", *(f"{joint}{s}" for joint in MOVING for s in suffixes)]
    table = [t, *(states[i][:, JOINTS.index(j)] for j in MOVING for i in range(orders))]
    rows = [",".join(repr(float(x)) for x in row) for row in zip(*table, strict=True)]
    return "\n".join([",".join(header), *rows]) + "\n"


def read(folder: Path, text: str | bytes, start=START) -> Motion:
    path = folder / "motion.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return profile(path, np.asarray(start), "motion.csv")


def assert_smooth(motion: Motion) -> None:
    """Angle, rate and acceleration go on at every knot, and rest at both ends."""
    lengths = np.diff(motion.knots)[:, None]
    m = motion
    for tolerance in (1e-13, 1e-10, 1e-7):  # rounding of 1 rad, by 1 / 0.01 s each more
        end = np.zeros(m.coefficients.shape[1:])
        for row in m.coefficients:
            end = end * lengths + row
        assert np.abs(end[:-1] - m.coefficients[-1, 1:]).max() < tolerance
        m = m.derivative()
    _, rate, acceleration = motion.joints([0.0, motion.duration])
    assert not rate[0].any()
    assert not acceleration[0].any()
    assert np.abs(rate[1]).max() < 1e-10
    assert np.abs(acceleration[1]).max() < 1e-7


def errors(tmp_path, t, orders, start=START):
    motion = rocking()
    back = read(tmp_path, exported(motion, t, orders, start), start)
    assert_smooth(back)
    fine = np.linspace(0, 30, 30001)
    have, want = back.joints(fine), motion.joints(fine)
    fixed = [0, 1, 3, 5]
    still = np.delete(have[0] - start, fixed, axis=1)
    assert not still.any()
    return [
        float(np.abs(h - w - (start if i == 0 else 0))[:, fixed].max())
        for i, (h, w) in enumerate(zip(have, want, strict=True))
    ]


def test_a_motion_comes_back_from_its_angles_rates_and_accelerations(tmp_path):
    angle, rate, acceleration = errors(tmp_path, np.arange(3001) * 0.01, 3)
    # Hermite: h^6 / 46080 of the sixth derivative, for 5 deg at 1 Hz 1.2e-13 rad (measured
    # 1.3e-13); in the derivatives 1 / h each more and a factor of some ten
    assert angle < 2e-13
    assert rate < 1e-10
    assert acceleration < 1e-7


def test_a_motion_comes_back_from_its_angles(tmp_path):
    angle, rate, acceleration = errors(tmp_path, np.arange(3001) * 0.01, 1)
    # three times what rates and accelerations would leave: measured 4e-13, 1.2e-10, 8e-8
    assert angle < 1e-12
    assert rate < 3e-10
    assert acceleration < 3e-7


def test_a_motion_comes_back_from_uneven_times(tmp_path):
    rng = np.random.default_rng(4)
    t = np.sort(
        np.concatenate([[0.0, 30.0], np.arange(1, 3000) * 0.01 + rng.uniform(-3e-3, 3e-3, 2999)])
    )
    # steps of up to 1.6 times 10 ms: 1.6^6 = 17 times what even ones leave; the spline more
    assert errors(tmp_path, t, 3)[0] < 17 * 2e-13
    assert errors(tmp_path, t, 1)[0] < 100 * 1e-12


def test_sixth_order(tmp_path):
    one, two = (errors(tmp_path, np.linspace(0, 30, n), 3)[0] for n in (301, 601))
    assert 5.5 < np.log2(one / two) < 6.5
    one, two = (errors(tmp_path, np.linspace(0, 30, n), 1)[0] for n in (301, 601))
    assert 5.0 < np.log2(one / two) < 7.5  # a spline's error hangs on where its steps fall


# (time, angle) of a move by 6 deg in 2 s that rests at both ends, by hand: t^3 (10 - 15 t + 6 t^2)
def move(rows=21, suffix="", scale=1.0, start=40.0, first=0.0):
    t = np.linspace(0, 1, rows)
    angle = start + scale * 6 * t**3 * (10 - 15 * t + 6 * t * t)
    lines = [f"{first + 2 * x!r},{y!r}" for x, y in zip(t.tolist(), angle.tolist(), strict=True)]
    return "\n".join([f"time_s,outer_deg{suffix}", *lines]) + "\n"


def test_a_move_by_hand(tmp_path):
    motion = read(tmp_path, move(first=100.0))
    assert motion.start == 0.0
    assert motion.duration == 2.0
    angle, rate, acceleration = (x / DEG for x in motion.joints([0.0, 1.0, 2.0]))
    # half way: 3 deg on, at 1.875 * 6 / 2 s, without acceleration. A quintic spline at rest at
    # both ends is a quintic that rests there
    np.testing.assert_allclose(angle[:, 3], [40, 43, 46], atol=1e-12)
    np.testing.assert_allclose(rate[:, 3], [0, 5.625, 0], atol=1e-9)
    np.testing.assert_allclose(acceleration[:, 3], [0, 0, 0], atol=1e-6)
    np.testing.assert_array_equal(
        motion.joints([1.3])[0][0, [0, 1, 2, 4, 5]], START[[0, 1, 2, 4, 5]]
    )


def test_spaces_comments_and_byte_order_marks_do_not_matter(tmp_path):
    plain = read(tmp_path, move())
    text = move().replace(",", " , ").replace("time_s", '"time_s"').replace("\n", "\r\n")
    other = read(tmp_path, b"\xef\xbb\xbf# a table's log\r\n\r\n" + text.encode())
    np.testing.assert_array_equal(plain.coefficients, other.coefficients)


def test_angles_of_a_millionth_of_a_degree_are_good_enough(tmp_path):
    rows = [line.split(",") for line in move(rows=2001).splitlines()[1:]]
    text = "time_s,outer_deg\n" + "".join(f"{t},{float(y):.6f}\n" for t, y in rows)
    assert abs(read(tmp_path, text).joints([1.0])[0][0, 3] / DEG - 43) < 1e-6


def test_a_file_that_stands_still(tmp_path):
    motion = read(tmp_path, "time_s,outer_deg\n" + "".join(f"{i},40\n" for i in range(12)))
    assert motion.at_rest.all()
    np.testing.assert_array_equal(motion.joints([5.0])[0][0], START)


def resting(times, deg=40.0) -> str:
    return "time_s,outer_deg\n" + "".join(f"{t!r},{deg!r}\n" for t in times)


def test_the_ends_of_what_is_allowed(tmp_path):
    """Rows every 0.1 ms, over a whole day of the longest run, at the farthest angle there is."""
    assert read(tmp_path, resting(k / 1e4 for k in range(12))).duration == 11e-4
    with pytest.raises(StandError, match=r"line 13, time_s = 0\.00109: must be 0\.0001 s or more"):
        read(tmp_path, resting([*(k / 1e4 for k in range(11)), 0.00109]))
    far = [k * LONGEST_S / 11 for k in range(11)]
    assert read(tmp_path, resting([*far, LONGEST_S])).duration == LONGEST_S
    with pytest.raises(StandError, match="must be within"):
        read(tmp_path, resting([*far, LONGEST_S + 1]))
    most = START * [1, 1, 1, 0, 1, 1] + [0, 0, 0, 36e3 * DEG, 0, 0]
    assert read(tmp_path, resting(range(12), 36e3), most).at_rest.all()
    # a millionth of a degree is rounding of what a file writes
    near = resting(range(12), 40.0000009)
    assert read(tmp_path, near).joints([0.0])[0][0, 3] == START[3]


def test_rates_at_the_ends_may_be_those_of_rest(tmp_path):
    """0.001 deg/s and 0.1 deg/s^2 pass for none, and become none."""
    rows = RATES.splitlines()
    rows[1] = rows[1].split(",")
    rows[1][2:4] = "0.001", "-0.1"
    rows[1] = ",".join(rows[1])
    _, rate, acceleration = read(tmp_path, "\n".join(rows)).joints([0.0])
    assert not rate.any()
    assert not acceleration.any()


@pytest.mark.parametrize(("off", "allowed"), [(0.0599, True), (0.0601, False), (-0.0601, False)])
def test_angles_must_grow_as_their_rates_say(tmp_path, off, allowed):
    """From 0 to 1 deg/s in 0.1 s are 0.05 deg: 0.01 deg and half of 0.1 s at 1 deg/s may be off."""
    t = np.arange(20) * 0.1
    rate = np.where((t > 0) & (t < 1.85), 1.0, 0.0)
    angle = 40 + np.concatenate([[0], np.cumsum(0.1 * (rate[1:] + rate[:-1]) / 2)])
    angle[1:] += off
    table = np.stack([t, angle, rate, 0 * t], axis=1).tolist()
    rows = [",".join(map(repr, row)) + "\n" for row in table]
    text = "time_s,outer_deg,outer_deg_s,outer_deg_s2\n" + "".join(rows)
    if allowed:
        read(tmp_path, text)
    else:
        with pytest.raises(StandError, match=r"line 3, outer_deg = .* near 40\.05, as its rates"):
            read(tmp_path, text)


def of_angles(angles) -> str:
    """Rows 0.1 s apart, from 40 deg on."""
    rows = [f"{k / 10!r},{40 + x!r}\n" for k, x in enumerate(angles)]
    return "time_s,outer_deg\n" + "".join(rows)


@pytest.mark.parametrize(("rate", "allowed"), [(0.17771, True), (0.17773, False)])
def test_how_fast_a_file_of_angles_may_begin(tmp_path, rate, allowed):
    """``s t + t^2`` up to 1 s, and the same back: a fifth of ``s + 0.7`` of the fourth rate, 1e-5
    deg of a row in 0.1 s and a thousandth of the fastest ``s + 1.9``: s = 0.1420/0.799."""
    t = np.arange(11) / 10
    there = rate * t + t**2
    text = of_angles(np.concatenate([there, 2 * there[-1] - there[-2::-1]]).tolist())
    if allowed:
        read(tmp_path, text)
    else:
        with pytest.raises(StandError, match=r"line 2, .* begin at rest, but moves at 0\.178 deg"):
            read(tmp_path, text)


@pytest.mark.parametrize(("rate", "allowed"), [(9.9, True), (10.1, False)])
def test_a_jump_is_ten_times_as_fast_as_what_is_about_it(tmp_path, rate, allowed):
    up = [0, 0, 0, 0, 0, 0.2, 0.4, 0.6, 0.8, 1, 1, 1]
    angles = np.cumsum([0, *up, rate, *up[::-1]]) * 0.1
    if allowed:
        read(tmp_path, of_angles(angles.tolist()))
    else:
        with pytest.raises(StandError, match=r"line 15, .* must not jump; .* before has 40\.5$"):
            read(tmp_path, of_angles(angles.tolist()))


def swapped(text: str, line: int, new: str) -> str:
    lines = text.splitlines()
    lines[line - 1] = new
    return "\n".join(lines)


GOOD = move()
RATES = exported(rocking(), np.arange(3001) * 0.01, 3)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "has no row of numbers"),
        (GOOD.split("\n", 1)[1], "no column time_s in a header line"),
        (GOOD.replace("time_s", "t"), "no column time_s in a header line, has t, outer_deg"),
        (GOOD.replace(",", ";"), "line 1: values must be separated by commas"),
        (
            GOOD.replace("outer_deg", "outr_deg"),
            "unknown column 'outr_deg': did you mean outer_deg",
        ),
        (GOOD.replace("outer_deg", "time_s"), "column time_s: is there twice"),
        (
            GOOD.replace("outer_deg", "outer_deg_s"),
            "no column outer_deg: an axis has outer_deg, or",
        ),
        (
            "time_s\n" + "".join(f"{i}\n" for i in range(20)),
            "no column of an axis, such as outer_deg",
        ),
        (move(rows=11), "has 11 rows, must have 12 or more"),
        (swapped(GOOD, 5, "0.3"), "line 5: has 1 values, must have 2"),
        (swapped(GOOD, 5, "0.3,abc"), "line 5, outer_deg = 'abc': must be a finite number"),
        (swapped(GOOD, 5, "0.3,inf"), "line 5, outer_deg = 'inf': must be a finite number"),
        (swapped(GOOD, 5, "0.3,"), "line 5, outer_deg = '': must be a finite number"),
        (swapped(GOOD, 5, "0.2,40.2"), "line 5, time_s = 0.2: must be 0.0001 s or more after"),
        (swapped(GOOD, 22, "1e9,46"), "line 22, time_s = 1e+09: must be within"),
        (swapped(GOOD, 5, "0.3,1e6"), "line 5, outer_deg = 1000000: must be within +-36000"),
        (move(start=41.0), "line 2, outer_deg = 41: must begin where outer stands, 40"),
        (move(start=40.00001), "line 2, outer_deg = 40.00001: must begin where outer stands, 40"),
        (
            swapped(GOOD, 12, "1.0,63"),
            "line 12, outer_deg = 63: must not jump; the line before has",
        ),
        (
            "time_s,outer_deg\n" + "".join(f"{i / 10},{40 + i}\n" for i in range(20)),
            "line 2, outer_deg = 40: must begin at rest, but moves at 10 deg/s",
        ),
        (
            GOOD + "".join(f"{2 + i / 10},{46 + i * i}\n" for i in range(1, 9)),
            "line 30, outer_deg = 110: must end at rest, but moves at 1",
        ),
        (
            "time_s,outer_deg\n" + "".join(f"{i / 10},{40 if i < 9 else 45}\n" for i in range(20)),
            "line 11, outer_deg = 45: must not jump; the line before has 40",
        ),
        (RATES.replace("outer_deg_s2", "outer_deg_s3"), "unknown column 'outer_deg_s3'"),
    ],
)
def test_files_that_are_not_right(tmp_path, text, message):
    with pytest.raises(StandError) as caught:
        read(tmp_path, text)
    assert str(caught.value).startswith(f"motion.csv: {message}")


def rated(row: int, column: int, value: float) -> str:
    """The exported file with one value changed; row 0 is the first of numbers."""
    lines = RATES.splitlines()
    cells = lines[row + 1].split(",")
    cells[column] = repr(value)
    lines[row + 1] = ",".join(cells)
    return "\n".join(lines)


@pytest.mark.parametrize(
    ("row", "column", "value", "message"),
    [
        (0, 2, 0.5, "line 2, base_roll_deg_s = 0.5: must begin at rest, within +-0.001"),
        (3000, 2, -0.5, "line 3002, base_roll_deg_s = -0.5: must end at rest, within +-0.001"),
        (0, 3, 1.0, "line 2, base_roll_deg_s2 = 1: must begin at rest, within +-0.1"),
        (1000, 1, 20.0, "line 1002, base_roll_deg = 20: must be near "),
        (1000, 2, 2e5, "line 1002, base_roll_deg_s = 200000: must be within +-100000"),
        (1000, 3, -1e9, "line 1002, base_roll_deg_s2 = -1e+09: must be within +-1e+08"),
    ],
)
def test_rates_that_are_not_right(tmp_path, row, column, value, message):
    with pytest.raises(StandError) as caught:
        read(tmp_path, rated(row, column, value))
    assert str(caught.value).startswith(f"motion.csv: {message}")


def test_angles_in_radians_beside_rates_in_degrees_are_found(tmp_path):
    motion, t = rocking(), np.arange(3001) * 0.01
    _, rate, acceleration = motion.joints(t)
    angle = motion.joints(t)[0][:, 3] + 40.0
    rows = zip(t, angle, rate[:, 3] / DEG, acceleration[:, 3] / DEG, strict=True)
    lines = [",".join(repr(float(x)) for x in row) for row in rows]
    text = "\n".join(["time_s,outer_deg,outer_deg_s,outer_deg_s2", *lines])
    with pytest.raises(StandError, match=r"line \d+, outer_deg = .*: must be near .* as its rates"):
        read(tmp_path, text)


def test_files_that_cannot_be_read(tmp_path):
    with pytest.raises(StandError, match=r"^no\.csv: cannot read this file: No such file"):
        profile(tmp_path / "no.csv", START, "no.csv")
    with pytest.raises(StandError, match=r"^x: cannot read this file: Is a directory"):
        profile(tmp_path, START, "x")
    with pytest.raises(StandError, match=r"^motion\.csv: not UTF-8 text \(byte 0\)"):
        read(tmp_path, b"\xff" + GOOD.encode())
    with pytest.raises(
        StandError, match=r"^motion\.csv: line 1: not CSV: .*larger than field limit"
    ):
        read(tmp_path, "1" * 200_000)


def test_too_many_rows(tmp_path, monkeypatch):
    monkeypatch.setattr("stand.motion.profile.MOST_ROWS", 20)
    with pytest.raises(StandError, match=r"^motion\.csv: line 22: too long, allowed are 20 rows"):
        read(tmp_path, GOOD)


CELLS = st.one_of(
    st.floats(-50, 50).map(repr),
    st.sampled_from(["0", "40", "40.0", "1e308", "-1e-300", "nan", "", "x", '"', "1_0", "#", "٣"]),
)
NAMES = st.sampled_from(
    ["time_s", "outer_deg", "outer_deg_s", "outer_deg_s2", "inner_deg", "oter_deg", "", "time_s "]
)


@settings(max_examples=300)
@given(
    st.lists(NAMES, min_size=1, max_size=4),
    st.lists(st.lists(CELLS, min_size=1, max_size=4), max_size=14),
)
def test_any_table_is_a_motion_or_one_line(tmp_path_factory, names, rows):
    folder = tmp_path_factory.getbasetemp()
    text = "\n".join(",".join(cells) for cells in [names, *rows])
    try:
        motion = read(folder, text)
    except StandError as error:
        assert "\n" not in str(error)  # noqa: PT017
        assert str(error).startswith("motion.csv: ")  # noqa: PT017
    else:
        assert motion.start == 0.0


@settings(max_examples=200)
@given(st.binary(max_size=200))
def test_any_bytes_are_one_line(tmp_path_factory, data):
    with pytest.raises(StandError, match=r"^motion\.csv: "):
        read(tmp_path_factory.getbasetemp(), data)


@settings(max_examples=200)
@given(
    st.lists(st.floats(1e-3, 2.0), min_size=11, max_size=40),
    st.integers(0, 10**6),
    st.sampled_from([1e-4, 1.0, 100.0]),
)
def test_any_rest_to_rest_table_of_rates_is_smooth(tmp_path_factory, steps, seed, size):
    t = np.cumsum([0.0, *steps])
    rng = np.random.default_rng(seed)
    rate, acceleration = size * rng.normal(size=(2, len(t)))
    rate[[0, -1]] = acceleration[[0, -1]] = 0.0
    h = np.diff(t)
    grown = h * (rate[:-1] + rate[1:]) / 2 + h**2 * (acceleration[:-1] - acceleration[1:]) / 12
    angle = 40.0 + np.concatenate([[0.0], np.cumsum(grown)])
    table = np.stack([t, angle, rate, acceleration], axis=1)
    text = "time_s,outer_deg,outer_deg_s,outer_deg_s2\n" + "".join(
        ",".join(repr(float(x)) for x in row) + "\n" for row in table
    )
    motion = read(tmp_path_factory.getbasetemp(), text)
    have = motion.joints(t)
    # at the rows it is what the rows say; rounding of up to 1e4 deg and of 1 / h^2
    np.testing.assert_allclose(have[0][:, 3] / DEG, angle, rtol=1e-12)
    np.testing.assert_allclose(have[1][:, 3] / DEG, rate, rtol=0, atol=1e-8 * size + 1e-9)
    np.testing.assert_allclose(have[2][:, 3] / DEG, acceleration, rtol=0, atol=1e-5 * size + 1e-6)
