"""Margins, violations, settling and durations of steps whose numbers are known by hand."""

from dataclasses import replace
from math import floor, radians, sin
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from test_refusals import rest
from test_traps import DWELL, case

from stand.imu import load_imu
from stand.motion.plan import Plan, PlannedStep
from stand.motion.polynomial import Motion
from stand.rehearsal.feasibility import durations, feasibility, settling_of, settling_times
from stand.rehearsal.rehearse import prepared
from stand.simulation.settings import assembled
from stand.table.joints import JOINTS
from stand.table.table import load_table

BEGIN, END = 10.0, 14.0
FIRST = 3.0 * (1 + 1e-6)  # s after the begin: what rides on its limit is allowed a millionth


def moved(axis: str, *powers: float, ends: float = END):
    """A scene of one step of 4 s: axis at ``powers[0] + powers[1] t + ...`` [deg], until `ends`."""
    pieces = 1 if ends == END else 2
    coefficients = np.zeros((5, 1 + pieces, 6))
    for k, power in enumerate(powers):
        coefficients[4 - k, 1, JOINTS.index(axis)] = radians(power)
    motion = Motion(np.unique([0.0, BEGIN, ends, END]), coefficients)
    step = PlannedStep(
        0,
        "sine",
        "moves",
        BEGIN,
        t_to=END,
        steady_from=BEGIN,
        steady_to=END,
        joints=np.zeros(6),
        C_nb=Rotation.identity(),
    )
    return replace(rest(), plan=Plan((step,), motion, np.zeros((1, 6), bool)))


def margin(scene, quantity):
    (step,) = feasibility(scene)
    (found,) = [m for m in step.margins if m.quantity == quantity]
    return found


# --- when a limit is first broken


@pytest.mark.parametrize(
    ("quantity", "powers", "value"),
    [
        # 15 deg, 30 deg/s, 60 deg/s^2 and 300 deg/s^3 are allowed; each is reached after 3 s
        ("angle", (0, 5), 20.0),
        ("angle", (0, -5), -20.0),
        ("rate", (0, 0, -10 / 2), -40.0),
        ("acceleration", (0, 0, 0, 20 / 6), 80.0),
        ("jerk", (0, 0, 0, 0, 100 / 24), 400.0),
    ],
)
def test_what_grows_with_time_breaks_its_limit_after_three_seconds(quantity, powers, value):
    found = margin(moved("base_roll", *powers), quantity)
    assert not found.kept
    # jerk is looked at just inside of a piece's end, a thousandth of its length
    assert found.value == pytest.approx(value, rel=1e-3 if quantity == "jerk" else 1e-12)
    assert found.ratio == pytest.approx(4 / 3, rel=1e-3)
    assert found.margin == pytest.approx(-1 / 3, abs=1.5e-3)
    assert found.t == END
    assert found.first_violation == pytest.approx(BEGIN + FIRST, abs=1e-8)


@pytest.mark.parametrize(("speed", "after"), [(5.0, 3.0), (-5.0, None), (-12.0, 40 / 12)])
def test_travel_may_be_longer_one_way(speed, after):
    """15 deg up and 40 deg down."""
    scene = moved("base_roll", 0, speed)
    axis, table = JOINTS.index("base_roll"), scene.settings.table
    low, high = list(table.low), list(table.high)
    low[axis], high[axis] = radians(-40), radians(15)
    table = replace(table, low=tuple(low), high=tuple(high))
    settings = replace(scene.settings, table=table)
    found = margin(replace(scene, settings=settings), "angle")
    begun = None if after is None else pytest.approx(BEGIN + after * (1 + 1e-6), abs=1e-8)
    assert found.first_violation == begun


def test_a_rehearsal_knows_torques_where_the_class_states_motors():
    scene = moved("outer", 0, 0, 10 / 2)
    with_motors = margin(scene, "torque")
    assert with_motors.axis == "outer"
    # the outer frame's inertia times its acceleration and viscous friction: some per cent of it
    assert 0 < with_motors.ratio < 1
    assert scene.torque is not None
    assert None not in scene.table.motors
    without = replace(scene.settings.table, motors=(None,) * 6)
    bare = prepared(replace(scene.settings, table=without))
    assert bare.torque is None


def test_a_torque_breaks_its_limit_when_it_does():
    scene = moved("outer", 0, 0, 10 / 2)
    allowed = scene.table.torque[JOINTS.index("outer")]
    per_rate = allowed / radians(30)  # N m s: its limit at 30 deg/s
    scene = replace(scene, torque=lambda q, v, a: -per_rate * v)
    found = margin(scene, "torque")
    assert (found.axis, found.unit) == ("outer", "N m")
    assert found.value == pytest.approx(-allowed * 4 / 3)
    assert found.first_violation == pytest.approx(BEGIN + FIRST, abs=1e-8)


def test_what_begins_beyond_its_limit_breaks_it_there():
    assert margin(moved("base_roll", 0, 40), "rate").first_violation == BEGIN
    assert margin(moved("base_roll", 0, 29.9), "rate").first_violation is None


def test_a_limit_that_is_broken_between_two_looks():
    """Jerk grows to 1.0011 of its limit until 1.04 s and is none then: beyond it for 1.1 ms.

    Of 4000 looks over 400 s none falls there, and at the knot there is none any more.
    """
    high, length = 1.0011, 1.04
    scene = moved("base_roll", 0, 0, 0, 0, high * 300 / length / 24, ends=BEGIN + length)
    (step,) = scene.plan.steps
    scene = replace(
        scene,
        plan=replace(
            scene.plan,
            steps=(replace(step, t_to=BEGIN + 400),),
            motion=replace(scene.plan.motion, knots=np.array([0.0, BEGIN, BEGIN + length, 500.0])),
        ),
    )
    found = margin(scene, "jerk")
    assert found.ratio == pytest.approx(0.999 * high, abs=1e-9)
    assert found.t == BEGIN + length
    assert found.first_violation == pytest.approx(BEGIN + length * (1 + 1e-6) / high, abs=1e-8)


# --- sensors


def test_a_rate_between_two_knots_is_felt():
    """``100 - 25 (t - 2)^2`` deg/s about the vertical: 100 at 2 s; Earth adds 11.265 deg/h."""
    found = margin(moved("outer", 0, 0, 100 / 2, -25 / 3), "sensor rate")
    earth = 15.0411 / 3600 * sin(radians(48.5))
    assert found.axis == "gyro Y1"
    assert (found.value, found.unit) == (pytest.approx(100 + earth, abs=1e-6), "deg/s")
    assert found.t == BEGIN + 2


def test_the_first_look_beyond_the_range_is_told():
    """50 deg/s after 2 s and 100 after 4 s; the range lies between, and then below both."""
    still = load_imu("hg9900")
    scene = moved("outer", 0, 0, 25 / 2)
    for limit, first in ((80, END), (30, BEGIN + 2), (101, None)):
        gyro = replace(still.gyro, range=radians(limit))
        unit = replace(scene.settings, imu=replace(still, gyro=gyro))
        found = margin(replace(scene, settings=unit), "sensor rate")
        assert found.limit == pytest.approx(limit)
        assert found.first_violation == first
        assert found.t == END


def test_a_range_that_is_just_used_is_kept():
    scene = rest()
    q = scene.plan.motion.joints([0.0])
    most = float(np.abs(scene.truth().instants(*q).f_places).max())
    unit = replace(scene.imu, accel=replace(scene.imu.accel, range=most))
    found = margin(replace(scene, settings=replace(scene.settings, imu=unit)), "sensor force")
    assert (found.ratio, found.kept) == (1.0, True)


# --- turns


def planned(*steps):
    return prepared(
        assembled(case([], *steps), load_imu("hg9900"), load_table("mid-class"), rate_hz=20)
    )


def turn(label, rate, turns):
    return (
        f'[[step]]\nkind = "rate"\nlabel = "{label}"\naxis = "outer"\nrate_deg_s = {rate}\n'
        f"turns = {turns}\n"
    )


def to(label, **joints):
    inner = ", ".join(f"{axis} = {angle}" for axis, angle in joints.items())
    return f'[[step]]\nkind = "move"\nlabel = "{label}"\njoints_deg = {{ {inner} }}\n'


def test_whole_turns_are_counted_where_a_step_ends():
    """90 deg/s: ramps of 0.2 + 0.25 + 0.2 s at 200 deg/s^2 and 1000 deg/s^3 turn by 0.1625."""
    scene = planned(turn("on", 90, 2), turn("back", -90, 2), to("one", outer=360, inner=359))
    turns = [step.turns for step in feasibility(scene)]
    assert turns[0] == {"outer": pytest.approx(2.1625)}
    assert turns[1] == {"outer": pytest.approx(0.0, abs=1e-9)}  # it has made some before
    assert turns[2] == {"outer": pytest.approx(1.0)}


@pytest.mark.parametrize(("short_deg", "counted"), [(3.4e-7, True), (3.8e-7, False)])
def test_a_turn_that_rounding_leaves_short_is_whole(short_deg, counted):
    """A billionth of a turn is 3.6e-7 deg; either way round."""
    for one in (360, -360):
        scene = planned(to("one", outer=one * (1 - short_deg / 360)))
        assert ("outer" in feasibility(scene)[0].turns) == counted


def test_stretches_are_set_against_what_they_must_outlast():
    """Three samples at 20 Hz are 0.15 s; two turns at 90 deg/s are steady for 8 s, from 1 s on."""
    rocks = '[[step]]\nkind = "sine"\nlabel = "s"\nduration_s = 4\nfade_s = 4\n'
    rocks += "axes = { inner = { amplitude_deg = 1, frequency_hz = 0.5 } }\n"
    steps = feasibility(planned(turn("r", 90, 2), rocks, DWELL.format("rest", 5)))
    found = [{m.quantity: m for m in step.margins} for step in steps]
    assert ["sampling" in one for one in found] == [True, False, True]
    assert ["settling" in one for one in found] == [False, False, True]
    for one, length, begin in ((found[0], 8.0, 1.0), (found[2], 5.0, steps[2].t_from)):
        sampling = one["sampling"]
        assert (sampling.value, sampling.limit) == pytest.approx((0.15, length))
        assert (sampling.ratio, sampling.t) == pytest.approx((0.15 / length, begin))
        assert sampling.kept
    # what settles is to stay so for the 0.5 s of the table's class
    assert steps[2].settling_s is not None
    assert found[2]["settling"].value == steps[2].settling_s + 0.5


# --- settling


@pytest.mark.parametrize("axis", ["base_roll", "outer"])
@pytest.mark.parametrize("within", [1e-6, 1e-5, 1.0])
def test_settling_by_its_closed_form(axis, within):
    """``x = (M/I) sum exp(r t) / prod(r - others)`` over the roots r of the closed loop."""
    motor, inertia = load_table("mid-class").motors[JOINTS.index(axis)], 0.7
    assert motor is not None
    assert motor.integral is not None
    w = motor.bandwidth
    loop = [1, 2 * motor.damping * w + motor.viscous / inertia, w**2, w**2 / motor.integral]
    roots = np.roots(loop)
    t = np.arange(0, 4, 1e-4)
    x = sum(
        np.exp(r * t) / np.prod([r - other for other in np.delete(roots, i)])
        for i, r in enumerate(roots)
    )
    beyond = np.flatnonzero(np.abs(motor.coulomb / inertia * x) > within)
    last = t[beyond[-1]] if len(beyond) else 0.0
    # whole milliseconds of it
    found = settling_of(motor, inertia, within)
    assert found == pytest.approx(floor(last * 1e3 + 1e-6) * 1e-3, abs=1e-9)
    assert (found > 0.1) == (within < 1)
    assert settling_of(replace(motor, integral=None), inertia, within) == 0.0


def test_only_rests_after_rocking_wait_for_the_servo():
    """A move and a turn leave an axis as friction held it; rocking does not, on its own axes."""
    sine = '[[step]]\nkind = "sine"\nlabel = "{}"\nduration_s = 4\nfade_s = 4\naxes = {{ '
    sine += "{} = {{ amplitude_deg = 1, frequency_hz = 0.5 }} }}\n"
    scene = planned(
        DWELL.format("a", 5), sine.format("s", "base_roll"), DWELL.format("b", 5),
        DWELL.format("c", 5), sine.format("t", "base_roll"), to("m", outer=10),
        DWELL.format("d", 5), sine.format("u", "base_roll"), turn("r", 90, 1),
        DWELL.format("e", 5), sine.format("v", "outer"), DWELL.format("f", 5),
    )  # fmt: skip
    table = SimpleNamespace(motors=scene.table.motors, settle_within=1e-7)
    made = SimpleNamespace(plan=scene.plan, table=table, inertias=scene.inertias)
    roll, outer = (
        settling_of(table.motors[k], float(scene.inertias[k]), 1e-7)
        for k in map(JOINTS.index, ("base_roll", "outer"))
    )
    assert roll > 0.1
    assert roll != outer > 0.1
    waits = [0.0, None, roll, 0.0, None, None, 0.0, None, None, 0.0, None, outer]
    assert settling_times(made) == waits
    # a class without a motor: nothing is told of its rests
    table.motors = (*table.motors[:-1], None)
    assert settling_times(made) == [None] * 12


# --- durations


def test_durations_by_hand():
    steps = [  # kind, from, to, steady from, steady to, settling: motion, settling, dwell
        ("dwell", 2.0, 22.0, 2.0, 22.0, 0.5, (0.0, 0.5, 19.5)),
        ("dwell", 22.0, 23.0, 22.0, 23.0, 3.0, (0.0, 1.0, 0.0)),  # it never settles
        ("dwell", 23.0, 33.0, 23.0, 33.0, None, (0.0, 0.0, 10.0)),
        ("move", 33.0, 37.0, 36.25, 37.0, None, (3.25, 0.75, 0.0)),
        ("rate", 37.0, 60.0, 39.0, 58.5, None, (3.5, 0.0, 19.5)),
    ]
    told = [SimpleNamespace(t_from=a, t_to=b, kind=kind, steady_from=c, steady_to=d)
            for kind, a, b, c, d, _, _ in steps]  # fmt: skip
    rows = [SimpleNamespace(number=k, kind=kind, label="", t_from=a, t_to=b, settling_s=settling)
            for k, (kind, a, b, _, _, settling, _) in enumerate(steps, 1)]  # fmt: skip
    found = durations(SimpleNamespace(steps=told), rows)
    assert [(s.motion, s.settling, s.dwell) for s in found.steps] == [s[-1] for s in steps]
    assert (found.motion, found.settling, found.dwell, found.total) == (6.75, 2.25, 49.0, 60.0)
    assert [(s.number, s.t_from, s.t_to) for s in found.steps][3] == (4, 33.0, 37.0)
    assert durations(SimpleNamespace(steps=[]), []).total == 0.0
