"""Plans: where they arrive, what they never exceed, and attitudes against matrices by hand."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from alignment.units import DEG
from stand.errors import StandError
from stand.motion.plan import Plan
from stand.motion.planner import plan
from stand.physics.mjcf import describe, load_model
from stand.procedure.procedure import load_procedure, procedure_from
from stand.table.joints import JOINTS
from stand.table.kinematics import attitude
from stand.table.table import Table, load_table
from stand.toml_files import Source

STAND = describe(load_model())
TABLE = load_table("laboratory")
HEAD = 'title = "T"\n[site]\nlatitude_deg = 10\n[estimate]\nmethods = ["triad"]\n'
ATTITUDE = 1e-14  # a dozen products of rotations, each to 1e-16
N_NUE = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]])  # north, up, east to north, east, down


def planned(steps: str, table: Table = TABLE, head: str = HEAD) -> Plan:
    return plan(procedure_from(Source("p", "p.toml", head + steps)), STAND, table)


def refusal(steps: str, table: Table = TABLE, head: str = HEAD) -> str:
    with pytest.raises(StandError) as caught:
        planned(steps, table, head)
    return str(caught.value)


def move(extra: str = "", attitude: dict | None = None, **joints: float) -> str:
    values = joints if attitude is None else attitude
    inner = ", ".join(f"{k} = {v!r}" for k, v in values.items())
    key = "joints_deg" if attitude is None else "attitude_deg"
    return f'[[step]]\nkind = "move"\nlabel = "M"\n{key} = {{ {inner} }}\n{extra}\n'


def dwell(label: str = "A", duration_s: float = 1.0) -> str:
    return f'[[step]]\nkind = "dwell"\nlabel = "{label}"\nduration_s = {duration_s}\n'


def turns(angle_deg: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Right-handed turns about X1 (roll), Y1 (yaw), Z1 (pitch)."""
    c, s = math.cos(angle_deg * DEG), math.sin(angle_deg * DEG)
    x = np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
    y = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    z = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    return x, y, z


def wanted_C_nb(roll: float, yaw: float, pitch: float, sequence: str) -> np.ndarray:
    x, y, z = turns(roll)[0], turns(yaw)[1], turns(pitch)[2]
    return N_NUE @ (y @ z @ x if sequence == "yaw-pitch-roll" else y @ x @ z)


def chain_C_nb(joints_deg: np.ndarray) -> np.ndarray:
    """Base roll, pitch, yaw, then outer (up), middle (pitch axis), inner (roll axis)."""
    roll, pitch, yaw, outer, middle, inner = joints_deg
    base = turns(roll)[0] @ turns(pitch)[2] @ turns(yaw)[1]
    return N_NUE @ base @ turns(outer)[1] @ turns(middle)[2] @ turns(inner)[0]


# --- the six positions


def test_six_positions_by_hand():
    steps = plan(load_procedure("six-position"), STAND, TABLE).steps
    seen = [(s.kind, s.label, s.t_from, s.t_to) for s in steps]
    # 90 deg at 60 deg/s, 60 deg/s^2, 240 deg/s^3: 90/60 + 60/60 + 60/240 = 2.75 s; 180 deg: 4.25 s
    assert seen == [
        ("move", "to X1 up", 0.0, 3.0),
        ("dwell", "X1 up", 3.0, 63.0),
        ("move", "to X1 down", 63.0, 68.0),
        ("dwell", "X1 down", 68.0, 128.0),
        ("move", "to Y1 up", 128.0, 131.0),
        ("dwell", "Y1 up", 131.0, 191.0),
        ("move", "to Y1 down", 191.0, 196.0),
        ("dwell", "Y1 down", 196.0, 256.0),
        ("move", "to Z1 up", 256.0, 259.0),
        ("dwell", "Z1 up", 259.0, 319.0),
        ("move", "to Z1 down", 319.0, 324.0),
        ("dwell", "Z1 down", 324.0, 384.0),
    ]
    gimbals = [np.degrees(s.joints[3:]) for s in steps if s.kind == "dwell"]
    hand = [[0, 90, 0], [0, -90, 0], [0, 0, 0], [0, 0, -180], [0, 0, -90], [0, 0, 90]]
    np.testing.assert_allclose(gimbals, hand, rtol=0, atol=1e-12)  # degrees: rounding of 180
    assert not any(s.joints[:3].any() for s in steps)


def test_slew_reaches_its_rate_and_lasts_as_long_as_by_hand():
    motion = plan(load_procedure("six-position"), STAND, TABLE).motion
    middle = JOINTS.index("middle")
    _, rate, acceleration = motion.joints(np.linspace(0, 2.75, 23))
    assert rate[:, middle].max() == pytest.approx(60 * DEG, rel=1e-12)
    assert acceleration[:, middle].max() == pytest.approx(60 * DEG, rel=1e-12)
    assert motion.knots[7] == pytest.approx(2.75, abs=1e-12)  # the seventh jerk phase ends
    assert motion.joints([2.75])[0][0, middle] == pytest.approx(90 * DEG, rel=1e-15)
    assert motion.joints([2.74])[1][0, middle] > 0


# --- any reachable joint angles

ANGLES = {
    "base_roll": st.floats(-15, 15),
    "base_pitch": st.floats(-15, 15),
    "base_yaw": st.floats(-20, 20),
    "outer": st.floats(-720, 720),
    "middle": st.floats(-720, 720) | st.sampled_from([0.0, 1e-9, 90.0, -90.0]),
    "inner": st.floats(-720, 720),
}
TARGETS = st.lists(st.fixed_dictionaries({}, optional=ANGLES).filter(len), min_size=1, max_size=4)
LIMITS = ("rate_deg_s", "acceleration_deg_s2", "jerk_deg_s3")


def check_whole(p: Plan, rate: np.ndarray, acceleration: np.ndarray, jerk: np.ndarray) -> None:
    """Continuity at knots and limits (6,) [SI] everywhere, from the polynomials themselves."""
    motion = p.motion
    h = np.diff(motion.knots)[:, None]
    j6, a2, v, q = motion.coefficients
    ends = (
        j6 * h**3 + a2 * h**2 + v * h + q,
        3 * j6 * h**2 + 2 * a2 * h + v,
        6 * j6 * h + 2 * a2,
    )
    # rounding: switching times to 1e-15 * 20 s, times rate 7 rad/s, acceleration 7, jerk 35
    for end, start, slack in zip(ends, (q, v, 2 * a2), (1e-11, 1e-10, 1e-9), strict=True):
        np.testing.assert_allclose(end[:-1], start[1:], rtol=0, atol=slack)
    assert (np.abs(6 * j6) <= jerk * (1 + 1e-9)).all()
    for values in (2 * a2, ends[2]):
        assert (np.abs(values) <= acceleration * (1 + 1e-9) + 1e-10).all()
    # the rate is a parabola: it peaks at knots, or where the acceleration crosses zero
    with np.errstate(divide="ignore", invalid="ignore"):
        peak = np.where(j6 != 0, -a2 / (3 * j6), 0.0)
    peak = np.clip(np.nan_to_num(peak), 0.0, h)
    for values in (v, ends[1], 3 * j6 * peak**2 + 2 * a2 * peak + v):
        assert (np.abs(values) <= rate * (1 + 1e-9) + 1e-10).all()


@settings(max_examples=60)
@given(TARGETS, st.sampled_from(["", "rate_deg_s = 7.5\njerk_deg_s3 = 40.0"]))
def test_any_reachable_joint_angles(targets, extra):
    steps = "".join(move(extra, **t) + dwell(f"D{i}") for i, t in enumerate(targets))
    p = planned(steps)
    limits = [TABLE.rate, TABLE.acceleration, TABLE.jerk]
    if extra:
        limits = [np.minimum(limits[0], 7.5 * DEG), limits[1], np.minimum(limits[2], 40 * DEG)]
    check_whole(p, *limits)
    wanted = np.zeros(6)
    for target, moved, rest in zip(targets, p.steps[::2], p.steps[1::2], strict=True):
        for name, angle in target.items():
            wanted[JOINTS.index(name)] = angle * DEG
        assert moved.joints.tolist() == rest.joints.tolist() == wanted.tolist()
        assert moved.t_to == rest.t_from == round(rest.t_from)
        assert rest.t_to == rest.t_from + 1.0
        angle, rate, acceleration = p.motion.joints(rest.t_from + np.linspace(1e-6, 1 - 1e-6, 7))
        assert (angle == wanted).all()
        assert not rate.any()
        assert not acceleration.any()
    assert p.motion.duration == pytest.approx(p.steps[-1].t_to, abs=1e-9)  # sums of durations


@given(st.floats(1e-7, 1000), st.floats(0.5, 200), st.floats(1, 200), st.floats(1, 1000))
@settings(max_examples=60)
def test_any_limits_of_a_single_slew(angle, rate, acceleration, jerk):
    extra = f"rate_deg_s = {rate!r}\nacceleration_deg_s2 = {acceleration!r}\njerk_deg_s3 = {jerk!r}"
    p = planned(move(extra, outer=angle) + dwell())
    check_whole(p, *(np.full(6, x * DEG) for x in (rate, acceleration, jerk)))
    assert p.stretches[0].joints[3] == angle * DEG
    assert p.motion.joints([p.stretches[0].t_from + 0.5])[0][0, 3] == angle * DEG


def test_moves_one_after_another_and_a_move_to_where_it_stands():
    p = planned(move(outer=30.0) + move(outer=30.0) + move(inner=-45.0) + dwell())
    # 30 deg: four phases of (30/(2 1000))^(1/3) = 0.247 s make 0.99 s; 45 deg likewise on inner
    assert [s.t_to for s in p.steps] == [1.0, 1.0, 2.0, 3.0]
    assert np.degrees(p.stretches[0].joints) == pytest.approx([0, 0, 0, 30, 0, -45])


def test_dwells_of_odd_length_let_the_next_move_end_on_a_whole_second():
    p = planned(
        dwell("A", 0.3) + move(outer=10.0) + dwell("B", 2.25) + move(outer=0.0) + dwell("C")
    )
    assert [s.t_from for s in p.stretches] == [0.0, 1.0, 4.0]
    assert [s.t_to for s in p.stretches] == [0.3, 3.25, 5.0]


# --- attitudes

SEQUENCES = st.sampled_from(["yaw-pitch-roll", "yaw-roll-pitch"])
TURN = st.floats(-200, 200) | st.sampled_from([0.0, 90.0, -90.0, 180.0, -180.0])
BASE = st.tuples(st.floats(-15, 15), st.floats(-15, 15), st.floats(-20, 20))


@settings(max_examples=100)
@given(TURN, TURN, TURN, SEQUENCES, st.just((0.0, 0.0, 0.0)) | BASE)
def test_any_attitude_on_any_base(roll, yaw, pitch, sequence, base):
    names = dict(zip(JOINTS[:3], base, strict=True))
    wanted = {"roll": roll, "yaw": yaw, "pitch": pitch, "sequence": sequence}
    p = planned(move(**names) + move(attitude=wanted) + dwell())
    joints = p.stretches[0].joints
    hand = wanted_C_nb(roll, yaw, pitch, sequence)
    # gimbal lock: the gimbals' middle turn is found from a cosine that vanishes, sqrt(1e-16) off
    slack = ATTITUDE if abs(np.cos(joints[4])) > 1e-3 else 3e-8
    np.testing.assert_allclose(attitude(STAND, joints).as_matrix(), hand, rtol=0, atol=slack)
    np.testing.assert_allclose(p.stretches[0].C_nb.as_matrix(), hand, rtol=0, atol=slack)
    np.testing.assert_allclose(chain_C_nb(np.degrees(joints)), hand, rtol=0, atol=slack)
    assert np.degrees(joints[:3]) == pytest.approx(base, abs=1e-12)
    assert (np.abs(joints[3:] - p.steps[0].joints[3:]) <= 1.5 * np.pi + 1e-9).all()


@pytest.mark.parametrize("pitch", [90.0, -90.0])
def test_gimbal_lock_leaves_the_inner_axis_at_zero(pitch):
    wanted = {"roll": 0.0, "yaw": 20.0, "pitch": pitch}
    p = planned(move(attitude=wanted) + dwell())
    assert np.degrees(p.stretches[0].joints) == pytest.approx([0, 0, 0, 20, pitch, 0], abs=1e-9)
    hand = wanted_C_nb(0.0, 20.0, pitch, "yaw-pitch-roll")
    np.testing.assert_allclose(p.stretches[0].C_nb.as_matrix(), hand, rtol=0, atol=ATTITUDE)


@pytest.mark.parametrize(
    ("outer", "yaw", "expected"),
    [(350.0, 5.0, 365.0), (-350.0, -5.0, -365.0), (700.0, 0.0, 720.0), (190.0, 0.0, 360.0)],
)
def test_the_nearest_turn_is_taken(outer, yaw, expected):
    p = planned(move(outer=outer) + move(attitude={"yaw": yaw}) + dwell())
    gimbals = np.degrees(p.stretches[0].joints[3:])
    assert gimbals == pytest.approx([expected, 0, 0], abs=1e-9)  # the flipped one is 180 deg away


def test_yaw_is_positive_to_the_west():
    p = planned(move(attitude={"yaw": 90.0}) + dwell())
    np.testing.assert_allclose(p.stretches[0].C_nb.apply([1, 0, 0]), [0, -1, 0], atol=ATTITUDE)


# --- refusals


def test_unreachable_joint_angle():
    assert refusal(dwell("B") + move(base_pitch=40.0) + dwell()) == (
        'p.toml: step 2 "M", joints_deg, base_pitch = 40.0: '
        "table laboratory allows -15 to 15 deg on base_pitch"
    )


def test_the_ends_of_the_travel_are_reachable():
    p = planned(move(base_pitch=15.0, base_yaw=-20.0) + dwell())
    assert np.degrees(p.stretches[0].joints[1:3]) == pytest.approx([15, -20])
    assert "base_yaw = -20.001" in refusal(move(base_yaw=-20.001) + dwell())


@pytest.mark.parametrize(
    ("extra", "line"),
    [
        ("rate_deg_s = 250.0", "rate_deg_s = 250.0: table laboratory allows up to 200 on outer"),
        (
            "acceleration_deg_s2 = 201",
            "acceleration_deg_s2 = 201.0: table laboratory allows up to 200 on outer",
        ),
        (
            "jerk_deg_s3 = 1001.0",
            "jerk_deg_s3 = 1001.0: table laboratory allows up to 1000 on outer",
        ),
    ],
)
def test_limits_beyond_the_tables(extra, line):
    told = refusal(move(extra, outer=10.0, inner=10.0) + dwell())
    assert told == f'p.toml: step 1 "M", {line}'


def test_only_axes_that_move_limit_a_move():
    p = planned(move("rate_deg_s = 400.0", inner=3000.0) + dwell())
    _, rate, _ = p.motion.joints([4.0])
    assert np.degrees(rate[0]) == pytest.approx([0, 0, 0, 0, 0, 400.0])


def test_general_limits_never_exceed_the_tables():
    head = HEAD + "[move_limits]\nrate_deg_s = 250.0\n"
    p = planned(move(outer=3000.0, inner=3000.0) + dwell(), head=head)
    _, rate, _ = p.motion.joints(np.linspace(0, 20, 401))
    assert np.degrees(rate[:, 3]).max() == pytest.approx(200.0)


OWN_TABLE = 'title = "Narrow"\nsource = "made up"\n' + "".join(
    f"[axis.{name}]\nrate_deg_s = 30\nacceleration_deg_s2 = 30\njerk_deg_s3 = 90\n{travel}\n"
    for name, travel in [
        ("base_roll", ""),
        ("base_pitch", ""),
        ("base_yaw", ""),
        ("outer", "travel_deg = [-10, 300]"),
        ("middle", "travel_deg = [-80, 80]"),
        ("inner", ""),
    ]
)


@pytest.fixture
def narrow(tmp_path):
    path = tmp_path / "narrow.toml"
    path.write_text(OWN_TABLE, encoding="utf-8")
    return load_table(str(path))


def test_the_turn_that_travel_allows(narrow):
    p = planned(move(attitude={"yaw": -70.0}) + dwell(), narrow)
    assert "allows -10 to 300" in refusal(move(outer=-70.0) + dwell(), narrow)
    assert np.degrees(p.stretches[0].joints) == pytest.approx([0, 0, 0, 290, 0, 0])
    hand = wanted_C_nb(0, -70.0, 0, "yaw-pitch-roll")
    np.testing.assert_allclose(p.stretches[0].C_nb.as_matrix(), hand, rtol=0, atol=ATTITUDE)


def test_an_attitude_no_gimbal_angles_reach(narrow):
    told = refusal(move(attitude={"pitch": 90.0}) + dwell(), narrow)
    assert told == (
        'p.toml: step 1 "M", attitude_deg = 90.000 deg on axis middle: '
        "table narrow allows -80 to 80 deg on middle"
    )


# --- constant rates


def rate(extra: str = "duration_s = 30", value: float = 10.0, axis: str = "outer") -> str:
    return f'[[step]]\nkind = "rate"\nlabel = "R"\naxis = "{axis}"\nrate_deg_s = {value}\n{extra}\n'


SOFT = "acceleration_deg_s2 = 20\njerk_deg_s3 = 80\n"


def test_a_constant_rate_by_hand():
    p = planned(rate("duration_s = 30\n" + SOFT) + dwell())
    step = p.steps[0]
    # jerk 80 up to 20 deg/s^2 takes 0.25 s; 10 deg/s: 10/20 + 0.25 = 0.75 s, so steady from 1 s on
    assert (step.t_from, step.steady_from, step.steady_to, step.t_to) == (0.0, 1.0, 31.0, 32.0)
    q, v, a = (x[:, 3] / DEG for x in p.motion.joints([0.25, 1.0, 16.0, 31.0, 31.75]))
    assert v[1:4].tolist() == pytest.approx([10, 10, 10], rel=1e-15)
    assert not a[1:4].any()
    # both ramps are symmetric: half of the rate for 0.75 s each
    assert q == pytest.approx([0, 3.75, 153.75, 303.75, 307.5], abs=1e-11)
    assert p.steps[1].joints[3] / DEG == pytest.approx(307.5, abs=1e-11)
    assert step.turning.axis == JOINTS.index("outer")
    assert step.turning.rate == pytest.approx(10 * DEG, rel=1e-15)
    assert step.turning.angle == pytest.approx(3.75 * DEG, abs=1e-11)  # where the ramp ends
    assert step.turning.axis_b == pytest.approx([0, 1, 0], abs=1e-14)  # up is Y1
    assert (step.C_nb.inv() * attitude(STAND, np.zeros(6))).magnitude() < ATTITUDE


def test_a_ramp_that_never_reaches_its_acceleration():
    # 10 deg/s at jerk 80: up and down again in 2 sqrt(10/80) = 0.7071 s, peak 28.28 deg/s^2
    p = planned(rate("duration_s = 2\nacceleration_deg_s2 = 100\njerk_deg_s3 = 80\n"))
    begin = 1 - 2 * math.sqrt(10 / 80)
    _, v, a = p.motion.joints([begin, begin + math.sqrt(10 / 80), 1.0])
    assert v[:, 3] / DEG == pytest.approx([0, 5, 10], abs=1e-9)
    assert a[1, 3] / DEG == pytest.approx(math.sqrt(800), rel=1e-9)


def test_whole_turns_both_ways():
    p = planned(rate('turns = 2\ndirections = "both"\n' + SOFT, value=-30.0) + dwell())
    there, back, rest = p.steps
    assert (there.label, back.label) == ("R +", "R -")
    for step, sign in ((there, -1), (back, 1)):
        assert step.steady_to - step.steady_from == pytest.approx(24.0, abs=1e-12)
        ends, v, _ = p.motion.joints([step.steady_from, step.steady_to])
        assert np.diff(ends[:, 3] / DEG) == pytest.approx(sign * 720, abs=1e-9)
        assert v[:, 3] / DEG == pytest.approx([sign * 30] * 2, rel=1e-12)
    assert rest.joints[3] == pytest.approx(0, abs=1e-12)
    assert [s.number for s in p.steps] == [0, 0, 1]


def test_a_sweep_is_one_stretch_per_rate():
    text = (
        '[[step]]\nkind = "sweep"\nlabel = "S"\naxis = "inner"\nrates_deg_s = [1, -5.5, 100]\n'
        "duration_s = 10\n"
    )
    p = planned(text)
    assert [s.label for s in p.stretches] == ["S 1 deg/s", "S -5.5 deg/s", "S 100 deg/s"]
    for step, value in zip(p.steps, (1, -5.5, 100), strict=True):
        t = np.linspace(step.steady_from, step.steady_to, 7)
        assert p.motion.joints(t)[1][:, 5] / DEG == pytest.approx([value] * 7, rel=1e-12)
        assert step.turning.axis_b == pytest.approx([1, 0, 0], abs=1e-14)  # north is X1
        assert step.steady_from == round(step.steady_from)


def test_the_axis_in_b_follows_the_gimbals():
    p = planned(move(middle=90.0) + rate(SOFT + "turns = 1"))
    # pitched by 90 deg, X1 points up: the outer axis is X1
    assert p.steps[1].turning.axis_b == pytest.approx([1, 0, 0], abs=1e-14)


@settings(max_examples=40)
@given(
    value=st.floats(0.01, 180) | st.floats(-180, -0.01),
    acceleration=st.floats(1, 200),
    jerk=st.floats(1, 1000),
    time=st.floats(0.01, 100),
)
def test_any_constant_rate_is_smooth_and_keeps_its_limits(value, acceleration, jerk, time):
    limits = f"acceleration_deg_s2 = {acceleration!r}\njerk_deg_s3 = {jerk!r}\n"
    p = planned(rate(limits + f"duration_s = {time!r}", value=value))
    step, knots = p.steps[0], p.motion.knots
    assert step.steady_to - step.steady_from == pytest.approx(time, abs=1e-9)
    before, after = (np.array(p.motion.joints(knots + e)) / DEG for e in (-1e-9, 1e-9))
    # between the two times lie 2 ns of at most 180 deg/s, 200 deg/s^2, 1000 deg/s^3
    assert np.abs(after - before).max() < 2.1e-6
    t = np.linspace(0, p.motion.duration, 2001)
    _, v, a = p.motion.joints(t)
    assert np.abs(v).max() <= abs(value) * DEG * (1 + 1e-9)
    assert np.abs(a).max() <= acceleration * DEG * (1 + 1e-9)


def test_rates_say_what_is_wrong():
    assert refusal(rate("duration_s = 5\nturns = 1")) == (
        'p.toml: step 1 "R": duration_s, turns: has both, must have one of them'
    )
    assert refusal(rate(value=0.0)).endswith("rate_deg_s = 0: must not be 0; a dwell stands still")
    assert refusal(rate("duration_s = 5\nacceleration_deg_s2 = 201")).endswith(
        "acceleration_deg_s2 = 201.0: table laboratory allows up to 200 on outer"
    )
    assert "axis" in refusal(rate(axis="outter"))
    assert "outer" in refusal(rate(axis="outter"))


# --- several motions at one time

SINE = "axes = { base_roll = { amplitude_deg = 2, frequency_hz = 0.5 } }\nfade_s = 4\n"


def behind(extra: str = "", first: str | None = None, last: str | None = None) -> str:
    ends = "".join(f'{k} = "{v}"\n' for k, v in (("first", first), ("last", last)) if v)
    return f'[[background]]\nkind = "sine"\n{SINE}{ends}{extra}'


def test_a_background_adds_up_with_the_steps():
    steps = dwell("A", 10.0) + move(base_roll=5.0) + dwell("B", 20.0)
    alone, rocking = planned(steps), planned(steps + behind())
    assert [s.t_to for s in rocking.steps] == [s.t_to for s in alone.steps]
    t = np.linspace(4, rocking.motion.duration - 4, 500)
    added = rocking.motion.joints(t)[0] - alone.motion.joints(t)[0]
    # at full size from 4 s on: 2 deg sin(2 pi 0.5 (t - 4)), to the 1e-12 of its polynomials
    assert added[:, 0] / DEG == pytest.approx(2 * np.sin(np.pi * (t - 4)), abs=1e-9)
    assert not added[:, 1:].any()
    assert rocking.rests[:, 0].tolist() == [False, False, False]
    assert rocking.rests[:, 3].tolist() == [True, True, True]


def test_a_background_runs_behind_the_steps_it_names():
    steps = dwell("A", 10.0) + dwell("B", 20.0) + dwell("C", 10.0)
    p = planned(steps + behind(first="B", last="B"))
    t = np.array([5.0, 10.0, 15.5, 30.0, 35.0])
    q = p.motion.joints(t)[0][:, 0] / DEG
    assert q == pytest.approx([0, 0, 2 * math.sin(math.pi * 1.5), 0, 0], abs=1e-9)
    assert p.rests[:, 0].tolist() == [True, False, True]


def test_backgrounds_say_what_is_wrong():
    steps = dwell("A", 10.0) + dwell("B", 20.0)
    assert refusal(steps + behind(first="Z")).endswith(
        'background 1, first = "Z": no steps have this label, must be one'
    )
    assert refusal(steps + behind(first="B", last="A")).endswith(
        'background 1, last = "A": must not come before first = "B"'
    )
    assert refusal(steps + behind("", first="A", last="A").replace("fade_s = 4", "fade_s = 5")) == (
        "p.toml: background 1, fade_s = 5: must be below half of the 10 s it runs"
    )


def test_sway_depends_on_the_seed_and_on_its_place_alone():
    text = dwell("A", 60.0) + (
        '[[background]]\nkind = "sway"\n'
        "axes = { base_roll = { rms_deg = 1, frequency_hz = 0.2 } }\n"
    )
    source = Source("p", "p.toml", HEAD + text)
    motions = [plan(procedure_from(source), STAND, TABLE, seed).motion for seed in (0, 0, 1)]
    t = np.linspace(0, 60, 100)
    same, again, other = (m.joints(t)[0][:, 0] for m in motions)
    assert same.tolist() == again.tolist()
    assert np.abs(same - other).max() > 0.1 * DEG


def test_times_of_a_wave_by_hand():
    """Fades of 3 s about 20.5 s make 26.5 s, which last to 27 s; it begins with the step."""
    wave = '[[step]]\nkind = "sine"\nlabel = "rocks"\nduration_s = 20.5\nfade_s = 3\n'
    wave += "axes = { base_pitch = { amplitude_deg = 2, frequency_hz = 0.5 } }\n"
    made = planned(dwell(duration_s=2.5) + wave + dwell("B"))
    step = made.steps[1]
    times = (step.t_from, step.steady_from, step.steady_to, step.t_to, made.steps[2].t_to)
    assert times == (2.5, 5.5, 26.0, 29.5, 30.5)
    pitch = JOINTS.index("base_pitch")
    assert made.rests.tolist() == [[True] * 6, [i != pitch for i in range(6)], [True] * 6]
    angles = made.motion.joints([2.5, 6.0, 8.0, 29.0])[0][:, pitch] / DEG
    # sin(pi (t - 5.5)) from the steady part on: a quarter of a wave, and two and a half pi
    assert angles == pytest.approx([0, 2, 2 * math.sin(math.pi * 2.5), 0], abs=1e-9)


def test_a_move_of_more_than_seven_thousand_seconds_is_refused():
    """170 deg at 0.02 deg/s last 8500 s, at 0.025 deg/s 6800 s and little more."""
    line = refusal(move("rate_deg_s = 0.02", outer=170.0, inner=90.0) + dwell())
    assert line.endswith("rate_deg_s = 0.02 on outer: the move would take 8500 s, allowed 7000")
    assert planned(move("rate_deg_s = 0.025", outer=170.0) + dwell()).steps[
        0
    ].t_to == pytest.approx(6801)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_an_attitude_across_half_a_turn_is_reached_the_short_way(sign):
    """From a yaw of 170 deg to -170 deg, and on to -160: 20 deg and 10, not 340 back."""
    head = {"roll": 0.0, "pitch": 0.0}
    yaws = (sign * 170.0, -sign * 170.0, -sign * 160.0)
    steps = "".join(move(attitude=head | {"yaw": yaw}).replace('"M"', f'"{yaw}"') for yaw in yaws)
    joints = np.array([step.joints for step in planned(steps + dwell()).steps[:3]]) / DEG
    outer = joints[:, JOINTS.index("outer")]
    assert np.abs(outer) == pytest.approx([170.0, 190.0, 200.0])
    assert np.sign(outer) == pytest.approx(np.sign(outer[0]))
    assert np.delete(joints, JOINTS.index("outer"), axis=1) == pytest.approx(0.0, abs=1e-9)
