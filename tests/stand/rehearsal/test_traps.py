"""Traps and limits of a rehearsal by hand: each with a case that just does not trigger it."""

from dataclasses import replace

import numpy as np
import pytest
from procedures import HALF_TURN
from scipy.spatial.transform import Rotation

from alignment.gains import Functional
from alignment.information import InstrumentErrors, Stretch, TriadErrors
from alignment.units import DEG_PER_HOUR
from stand import toml_files as catalogue
from stand.imu import Temperature, load_imu
from stand.motion.planner import plan
from stand.motion.polynomial import Motion
from stand.physics.mjcf import describe, load_model
from stand.procedure.procedure import procedure_from, table_of
from stand.rehearsal.rehearse import prepared, rehearse
from stand.rehearsal.result import Judgement, Verdict
from stand.rehearsal.rocking import over_time, readings_of, steps_as_noise, turned_by_heading
from stand.rehearsal.traps import averaging_time, procedure_doubts
from stand.rehearsal.warmth import warmed
from stand.simulation.settings import assembled
from stand.table.table import load_table

STAND = describe(load_model())
DWELL = '[[step]]\nkind = "dwell"\nlabel = "{}"\nduration_s = {}\n'
TURNED = '[[step]]\nkind = "move"\nlabel = "to {0}"\njoints_deg = {{ outer = {0} }}\n'
HEAD = 'title = "A case"\ntable = "mid-class"\n[site]\nlatitude_deg = 48.5\n'


def case(methods, *steps):
    text = HEAD + f"[estimate]\nmethods = {list(methods)}\n".replace("'", '"') + "".join(steps)
    return procedure_from(catalogue.Source("case", "case.toml", text))


def scene_of(imu, temperature=None):
    """Only of what a unit does: nothing is planned."""
    procedure = case(["triad"], DWELL.format("rest", 20))
    made = prepared(assembled(procedure, imu, load_table("mid-class"), rate_hz=20))
    return replace(made, temperature=temperature)


# --- biases that nothing cancels


def told(procedure, imu="stim300", judgements=()):
    table = table_of(procedure)
    unit = load_imu(imu) if isinstance(imu, str) else imu
    methods = procedure.entry.estimate.methods
    site = procedure.entry.site.site()
    return list(procedure_doubts(plan(procedure, STAND, table), unit, site, methods, judgements))


def six_reversals(methods):
    steps = [DWELL.format("at 0", 20)]
    for k in range(6):
        steps += [TURNED.format(180 * ((k + 1) % 2)).replace("to ", f"turn {k} to ")]
        steps += [DWELL.format(f"rest {k}", 20)]
    return case(methods, *steps)


def test_it_never_turns_is_said_of_what_never_turns_alone():
    (one,) = told(case(["triad"], DWELL.format("rest", 20)))
    assert one.kind == "bias-limited"
    assert one.text.startswith("it never turns: ")
    (one,) = told(six_reversals(["triad", "single-gyro"]))
    assert one.text.startswith(
        "it turns, but no method of it (triad, single-gyro) sets one heading against another: "
    )
    assert told(six_reversals(["triad", "two-position"])) == []
    assert told(six_reversals(["multi-position"])) == []


def test_a_turn_is_one_from_thirty_degrees_on():
    for angle, trapped in ((29, True), (31, False)):
        steps = DWELL.format("a", 20), TURNED.format(angle), DWELL.format("b", 20)
        assert bool(told(case(["two-position"], *steps))) == trapped, angle
    # apart from one another, though neither is from the first
    steps = [DWELL.format("a", 20), TURNED.format(25), DWELL.format("b", 20)]
    steps += [TURNED.format(-25), DWELL.format("c", 20)]
    assert told(case(["two-position"], *steps)) == []


def test_turning_stretches_count_for_the_carousel_and_rests_for_positions():
    turn = '[[step]]\nkind = "rate"\nlabel = "round"\naxis = "outer"\nrate_deg_s = 20\nturns = 1\n'
    rests = DWELL.format("a", 20), TURNED.format(180), DWELL.format("b", 20)
    assert told(case(["carousel"], turn)) == []
    (one,) = told(case(["triad"], DWELL.format("rest", 20), turn))
    assert one.text.startswith("it turns, but no method of it (triad)")
    assert told(case(["two-position"], *rests, turn)) == []


def test_the_bias_that_limits_is_that_of_turn_on_and_drift():
    """sqrt(3^2 + 4^2) deg/h over 9.96651 deg/h are 28.7 deg; 1 deg is remarked, 0.99 is not."""
    unit = load_imu("stim300")

    def with_bias(bias, instability):
        gyro = replace(unit.gyro, bias=bias * DEG_PER_HOUR, instability=instability * DEG_PER_HOUR)
        return told(case(["triad"], DWELL.format("rest", 20)), replace(unit, gyro=gyro))

    (one,) = with_bias(3.0, 4.0)
    assert "the gyros' bias of 5 deg/h is 28.7 deg of heading" in one.text
    horizontal = 9.96651 * np.pi / 180  # deg/h per deg of heading
    assert with_bias(0.6 * 1.01 * horizontal, 0.8 * 1.01 * horizontal)
    assert not with_bias(0.6 * 0.99 * horizontal, 0.8 * 0.99 * horizontal)


def test_a_pole_is_named_where_a_degree_per_hour_is_left():
    """15.041067 cos(latitude) = 1 deg/h at 86.1882 deg."""
    for latitude, named in ((86.18, False), (86.20, True), (-86.20, True)):
        text = HALF_TURN.replace("48.5", f"{latitude}").replace('"triad"', '"two-position"')
        procedure = procedure_from(catalogue.Source("case", "case.toml", text))
        assert ("pole" in [f.kind for f in told(procedure)]) == named


def heading(required, coverage, verdict):
    return Judgement(
        quantity="heading",
        method="triad",
        label="rest",
        required=np.radians(required),
        coverage=coverage,
        sigma=np.radians(1.0),
        guard=0.1,
        verdict=verdict,
        reason="",
    )


def test_the_bias_that_limits_is_held_against_what_is_required():
    """Required 6 deg with coverage 2: a bias may make 3 deg, 0.52185 deg/h; what passes is well."""
    unit = load_imu("stim300")
    procedure = case(["triad"], DWELL.format("rest", 20))
    for factor, trapped in ((1.01, True), (0.99, False)):
        bias = factor * 9.96651 * np.radians(3.0) * DEG_PER_HOUR
        biased = replace(unit, gyro=replace(unit.gyro, bias=bias, instability=0.0))
        for verdict in (Verdict.FAIL, Verdict.INDETERMINATE):
            assert bool(told(procedure, biased, [heading(6, 2, verdict)])) == trapped
        assert told(procedure, biased, [heading(6, 2, Verdict.PASS)]) == []


def test_at_a_pole_what_is_required_is_told():
    text = HALF_TURN.replace("48.5", "-89.0").replace('"triad"', '"two-position"')
    procedure = procedure_from(catalogue.Source("case", "case.toml", text))
    (free,) = told(procedure)
    # 15.041067 cos 89
    assert free.text == (
        "latitude -89 deg: the horizontal Earth rate is 0.263 deg/h, too little to find north by"
    )
    (bound,) = told(procedure, judgements=[heading(0.25, 2, Verdict.FAIL)])
    assert bound.text == free.text + " (heading is required to 0.25 deg)"


# --- records for Allan terms


def test_averaging_times_by_hand():
    """Where the Allan deviation of a term meets the largest of those before it."""
    spec = replace(load_imu("stim300").gyro, noise=3.0, instability=2.0, random_walk=0.5, ramp=0.01)
    floor = 0.664 * 2
    assert averaging_time(spec, "B") == pytest.approx((3 / floor) ** 2, rel=1e-3)
    # 1.328 = 0.5 sqrt(t/3): 21.2 s; 3/sqrt(t) = 0.5 sqrt(t/3): 10.4 s
    assert averaging_time(spec, "K") == pytest.approx(3 * (floor / 0.5) ** 2, rel=1e-3)
    short = replace(spec, instability=0.1)
    assert averaging_time(short, "K") == pytest.approx(3**0.5 * 3 / 0.5, rel=1e-6)
    assert averaging_time(replace(spec, instability=0.0), "K") == pytest.approx(10.392, rel=1e-4)
    # 0.5 sqrt(t/3) = 0.01 t/sqrt(2): t = 2/3 (0.5/0.01)^2 = 1667 s; 1.328 meets it at 187.8 s
    assert averaging_time(spec, "R") == pytest.approx(2 / 3 * 50**2, rel=1e-6)
    still = replace(spec, random_walk=0.0)
    assert averaging_time(still, "R") == pytest.approx(2**0.5 * floor / 0.01, rel=1e-3)
    # 3/sqrt(t) = 0.01 t/sqrt(2): t = (3 sqrt(2)/0.01)^(2/3) = 56.46 s
    noisy = replace(still, instability=0.0)
    assert averaging_time(noisy, "R") == pytest.approx(56.462, rel=1e-4)
    assert averaging_time(spec, "N") == averaging_time(spec, "Q") == 0.0
    none = replace(spec, instability=0.0, random_walk=0.0, ramp=0.0)
    assert [averaging_time(none, term) for term in "BKR"] == [np.inf] * 3


# --- lengths and durations


def test_the_accelerometers_low_pass_counts_too():
    """Five time constants of 0.05 Hz, 5 sqrt(2)/(2 pi 0.05) = 22.5 s, whichever sensor has it."""
    unit = load_imu("stim300")
    slow = replace(unit, accel=replace(unit.accel, bandwidth=0.05))
    for seconds, kept in ((22, False), (24, True)):
        procedure = case(["triad"], DWELL.format("rest", seconds))
        site = procedure.entry.site.site()
        result = rehearse(assembled(procedure, slow, table_of(procedure), site, 20))
        (margin,) = [m for m in result.feasibility[0].margins if m.quantity == "filter"]
        assert margin.value == pytest.approx(22.5, rel=5e-3)
        assert margin.kept == kept


def test_a_move_waits_for_its_whole_second():
    """180 deg at 200 deg/s^2 and 1000 deg/s^3: v (v/200 + 0.2) = 180, so v = 170.788 deg/s.

    2 (v/200 + 0.2) = 2.10788 s of motion; the plan goes on at 3 s.
    """
    procedure = procedure_from(catalogue.Source("case", "case.toml", HALF_TURN))
    site = procedure.entry.site.site()
    asked = assembled(procedure, load_imu("ring-laser"), table_of(procedure), site, 20)
    duration = rehearse(asked).duration
    move = duration.steps[1]
    assert (move.motion, move.settling, move.dwell) == pytest.approx(
        (2.10788, 0.89212, 0), abs=1e-4
    )
    assert duration.settling == pytest.approx(0.89212, abs=1e-4)
    assert (duration.dwell, duration.total) == pytest.approx((48.0, 51.0))


# --- what time does to a unit


def test_warmth_of_a_turn_that_starts_at_ninety_degrees():
    """a t over one turn of w: cosine 2 a sin(b)/w, sine -2 a cos(b)/w from angle b; mean a T/2."""
    unit = load_imu("hg9900")
    per_kelvin, a, w = 1e-8, 0.1, 2 * np.pi / 60
    unit = replace(unit, gyro=replace(unit.gyro, bias_temperature=per_kelvin))
    warming = Temperature(np.array([0.0, 1000.0]), 25.0 + np.array([0.0, 100.0]))
    scene = scene_of(unit, warming)
    for angle in (0.0, np.pi / 2, 0.7):
        stretch = Stretch("turn", 0.0, 60.0, Rotation.identity(), w, angle=angle)
        gyro, accel = warmed([stretch], [np.zeros((3, 6))], scene)
        by_hand = per_kelvin * a * np.array([30, 2 * np.sin(angle) / w, -2 * np.cos(angle) / w])
        for channel in range(3):
            own = gyro[channel::6, channel::6]
            # sums of 400 in place of integrals: 1e-5
            assert own == pytest.approx(np.outer(by_hand, by_hand), rel=1e-3, abs=1e-20)
        assert not accel.any()


def test_warmth_of_scales_by_hand():
    """s a t x(t). At rest it is s a (T/2) x. Of x = cos(w t) over a turn the mean of t cos(w t) is
    nothing, twice that of t cos^2 is T/2, and twice that of t cos sin is -1/(2 w)."""
    unit = load_imu("hg9900")
    per_kelvin, a, w = 1e-5, 0.1, 2 * np.pi / 60
    unit = replace(unit, accel=replace(unit.accel, scale_temperature=per_kelvin))
    warming = Temperature(np.array([0.0, 1000.0]), 25.0 + np.array([0.0, 100.0]))
    rest = Stretch("rest", 0.0, 60.0, Rotation.identity())
    turn = Stretch("turn", 0.0, 60.0, Rotation.identity(), w)
    wave = np.zeros((3, 6))
    wave[1, 3:] = 1.0, 2.0, 3.0
    gyro, accel = warmed([rest, turn], [np.full((1, 6), 9.0), wave], scene_of(unit, warming))
    assert not gyro.any()
    for k in range(3):
        by_hand = per_kelvin * a * np.array([9 * 30, 0, (k + 1) * 30, -(k + 1) / (2 * w)])
        own = accel[k + 3 :: 6, k + 3 :: 6]
        assert own == pytest.approx(np.outer(by_hand, by_hand), rel=1e-3, abs=1e-12)
    assert not any(part.any() for part in warmed([rest], [np.ones((1, 6))], scene_of(unit)))


def test_a_walk_has_begun_before_the_stretch():
    """K sqrt(t) of a bias from the recording's start on: 105 s at the middle of 100 to 110 s."""
    one = np.ones((1, 3, 3)) * np.eye(3)
    nothing = np.zeros((1, 3))
    made = Functional(
        t=np.array([100.0, 110.0]),
        gyro=2 * one,
        accel=0 * one,
        rate=nothing,
        force=nothing,
        motion=np.zeros((3, 3)),
        C_nb=Rotation.identity(),
    )
    unit = InstrumentErrors(TriadErrors(random_walk=3e-9), TriadErrors(random_walk=0.0))
    walked = over_time(made, unit, scene_of(load_imu("ideal")))["gyro random walk"]
    assert walked / 9e-18 == pytest.approx(4 * 105 * np.eye(3), rel=1e-9)
    # two blocks share what came before them: K^2 (105 (2 + 3)^2 + 10 3^2)
    two = np.concatenate([2 * one, 3 * one])
    both = replace(
        made,
        t=np.array([100.0, 110.0, 120.0]),
        gyro=two,
        accel=0 * two,
        rate=np.zeros((2, 3)),
        force=np.zeros((2, 3)),
    )
    walked = over_time(both, unit, scene_of(load_imu("ideal")))["gyro random walk"]
    assert walked / 9e-18 == pytest.approx((105 * 25 + 10 * 9) * np.eye(3), rel=1e-9)


NONE = TriadErrors()


def one_block(**changes):
    """Answers of 2 to gyros and 3 to accelerometers, over 4 s from 10 s on."""
    made = Functional(
        t=np.array([10.0, 14.0]),
        gyro=2 * np.eye(3)[None],
        accel=3 * np.eye(3)[None],
        rate=np.zeros((1, 3)),
        force=np.zeros((1, 3)),
        motion=5e-9 * np.eye(3),
        C_nb=Rotation.identity(),
    )
    return replace(made, **changes)


def test_noise_and_steps_of_a_rocking_base_by_hand():
    """A mean of 4 s has N^2/4 of white noise, and of steps q^2/12/20 Hz/4, of 80 samples."""
    still = load_imu("ideal")
    unit = replace(
        still,
        gyro=replace(still.gyro, resolution=1e-5),
        accel=replace(still.accel, resolution=1e-3),
    )
    scene = scene_of(unit)
    assert steps_as_noise(scene) == pytest.approx((1e-5 / np.sqrt(240), 1e-3 / np.sqrt(240)))
    errors = InstrumentErrors(TriadErrors(noise=3e-7), TriadErrors(noise=1e-4))
    found = over_time(one_block(), errors, scene)
    for name, variance in (
        ("gyro white noise", 4 * 9e-14 / 4),
        ("gyro rounding", 4 * 1e-10 / 12 / 80),
        ("accelerometer white noise", 9 * 1e-8 / 4),
        ("accelerometer rounding", 9 * 1e-6 / 12 / 80),
        ("motion", 5e-9),
    ):
        assert found[name] == pytest.approx(variance * np.eye(3), rel=1e-12), name


def test_stamps_that_tremble_are_noise_of_what_changes_by_hand():
    """1 ms at 20 Hz of 0.1 rad/s^2 and 2 m/s^3: ``(g j x')^2 / (20 Hz 4 s)``, axis by axis."""
    still = load_imu("ideal")
    unit = replace(still, clock=replace(still.clock, jitter=1e-3))
    changes = np.array([[0.1, 0.0, 0.3, 2.0, 1.0, 0.0]])
    found = over_time(one_block(changes=changes), InstrumentErrors(NONE, NONE), scene_of(unit))
    squares = changes[0] ** 2 * 1e-6 / 80
    assert found["gyro jitter"] == pytest.approx(4 * np.diag(squares[:3]), rel=1e-12)
    assert found["accelerometer jitter"] == pytest.approx(9 * np.diag(squares[3:]), rel=1e-12)


def test_warmth_and_constants_of_a_rocking_base_by_hand():
    """12 s are the middle: 1.2 K above, and a ramp of 12 s; turning at 0.1, 0.2 and 0.3 rad/s."""
    rate = np.array([[0.1, 0.2, 0.3]])
    per_kelvin, scale, ramp, biased = 1e-8, 1e-6, 1e-9, 4e-8
    still = load_imu("ideal")
    gyro = replace(still.gyro, bias_temperature=per_kelvin, scale_temperature=scale)
    warming = Temperature(np.array([0.0, 1000.0]), 25.0 + np.array([0.0, 100.0]))
    scene = scene_of(replace(still, gyro=gyro), warming)
    unit = InstrumentErrors(TriadErrors(bias=biased, ramp=ramp), TriadErrors())
    found = over_time(one_block(rate=rate), unit, scene)
    bias, scaled = 2 * 1.2 * per_kelvin * np.eye(3), 2 * 1.2 * scale * rate[0]
    assert found["gyro temperature"] == pytest.approx(bias**2 + np.outer(scaled, scaled))
    assert found["gyro ramp"] == pytest.approx((2 * 12 * ramp) ** 2 * np.eye(3))
    assert found["gyro turn-on bias"] == pytest.approx((2 * biased) ** 2 * np.eye(3))
    assert "accelerometer ramp" not in found
    assert not found["accelerometer temperature"].any()


def test_a_heading_that_is_not_small_turns_the_tilt_of_the_gyros():
    """(1 +- exp(-2 h^2))/2 of either axis, their product exp(-h^2/2); h^2 = 0.25 + 0.24."""
    P = np.array([[4.0, 1.0, 0.2], [1.0, 1.0, 0.1], [0.2, 0.1, 0.25]])
    other = np.diag([1.0, 1.0, 0.24])
    found = turned_by_heading({"gyro bias": P, "accelerometer bias": other})
    kept, turned = (1 + np.exp(-0.98)) / 2, (1 - np.exp(-0.98)) / 2
    level = [[kept * 4 + turned, kept - turned], [kept - turned, kept + 4 * turned]]
    assert found["gyro bias"][:2, :2] == pytest.approx(np.array(level))
    assert found["gyro bias"][2] == pytest.approx(
        [0.2 * np.exp(-0.245), 0.1 * np.exp(-0.245), 0.25]
    )
    assert found["gyro bias"][:, 2] == pytest.approx(found["gyro bias"][2])
    assert found["accelerometer bias"] is other


def test_perfect_readings_are_of_the_middles_of_samples():
    """Outer at t^2 deg, so at 2 t deg/s: 20 samples a second from 2 s on, stamped at their ends."""
    coefficients = np.zeros((3, 1, 6))
    coefficients[0, 0, 3] = np.radians(1.0)
    motion = Motion(np.array([0.0, 10.0]), coefficients)
    readings = readings_of(scene_of(load_imu("ideal")).truth(), motion, 2.0, 5.0)
    assert readings.t == pytest.approx(2.05 + 0.05 * np.arange(60))
    earth = 15.0411 / 3600 * np.sin(np.radians(48.5))
    up = np.degrees(readings.w_ib_b[:, 1])
    assert up == pytest.approx(2 * (2.025 + 0.05 * np.arange(60)) + earth, abs=1e-6)
