"""What forbids a number, and lengths that do not do: each just above its limit and just below."""

from dataclasses import replace
from math import log, pi, radians, sqrt
from types import SimpleNamespace

import numpy as np
import pytest
from test_traps import DWELL, TURNED, case

from alignment.errors import AlignmentError
from alignment.information import InstrumentErrors, TriadErrors
from alignment.information.circle import Rival
from alignment.units import STANDARD_GRAVITY
from stand.imu import load_imu
from stand.procedure.procedure import load_procedure, table_of
from stand.rehearsal.feasibility import feasibility
from stand.rehearsal.refusals import (
    adrift,
    check_carried,
    check_quiet,
    check_vertical,
    coarse,
    coarse_tilt,
    rivalled,
    unsettled,
    unturned,
)
from stand.rehearsal.rehearse import prepared, rehearse
from stand.rehearsal.traps import allan_lengths, averaging_time, from_margins
from stand.simulation.settings import assembled
from stand.table.table import load_table

SECONDS = 20
G = 9.8093587


def rest(imu="hg9900", rate_hz=20, seconds=SECONDS):
    """A scene of one rest on a table of the middle class."""
    unit = load_imu(imu) if isinstance(imu, str) else imu
    procedure = case(["triad"], DWELL.format("rest", seconds))
    return prepared(assembled(procedure, unit, load_table("mid-class"), rate_hz=rate_hz))


def refused(call, *arguments):
    try:
        call(*arguments)
    except AlignmentError as error:
        return str(error)
    return ""


# --- noise that looks like motion


def noisy(gyro=0.0, accel=0.0):
    return InstrumentErrors(TriadErrors(noise=gyro), TriadErrors(noise=accel))


@pytest.mark.parametrize("turning", [False, True])
def test_noise_is_taken_for_motion_where_it_mostly_would_be(turning):
    """Of 20 means of 1 s one is beyond the limit in half of the records: each in ln 2/20 of them.

    Two axes: exp(-x/2) is that at x = 6.7245, so at a sigma of 0.1 deg/s over 2.5931 and of 0.5 deg
    over 2.5931; three axes at x = 8.6287 (of chi-square with three degrees of freedom).
    """
    scene = rest()
    steps = scene.plan.stretches
    x = -2 * log(log(2) / SECONDS) if turning else 8.6287
    assert -2 * log(log(2) / SECONDS) == pytest.approx(6.7245, abs=1e-4)
    rate = radians(0.1) / sqrt(x)
    tilt = radians(0.5) / sqrt(6.7245)
    for name, size in (("gyro", rate), ("accel", tilt * scene.site.gravity)):
        for factor, expected in ((1.01, True), (0.99, False)):
            found = refused(check_quiet, steps, scene, noisy(**{name: factor * size}), turning)
            assert bool(found) == expected, (name, factor)
    both = noisy(1.01 * rate, tilt * scene.site.gravity)
    assert refused(check_quiet, steps, scene, both, turning).startswith(
        "would take noise for motion: means of 1 s scatter by "
        f"{0.101 / sqrt(x):.2g} deg/s and 0.19 deg of tilt (1 sigma), and 0.1 deg/s and 0.5 deg"
    )


def test_rounding_counts_as_noise_of_the_means():
    """A step of q without noise is q/sqrt(12) anew in each sample: over 20 of them in a mean."""
    still = load_imu("hg9900")
    limit = radians(0.1) / sqrt(8.6287) * sqrt(12 * 20)
    for factor, expected in ((1.02, True), (0.98, False)):
        gyro = replace(still.gyro, resolution=factor * limit, noise=limit)
        scene = rest(replace(still, gyro=gyro))
        found = refused(check_quiet, scene.plan.stretches, scene, noisy(), False)
        assert bool(found) == expected, factor


# --- verticals that look like another position


def leaning(sigma, known=(0.0, 0.0)):
    return SimpleNamespace(
        true=SimpleNamespace(parameters=(None, None)),
        feigned_tilt=lambda: sigma * np.eye(2),
        known_tilt=lambda: np.array(known),
    )


def test_a_vertical_that_most_units_miss_is_refused():
    """Two tilts of sigma leave 5 deg in half of the units at 5 deg/sqrt(2 ln 2); 1000 are drawn,
    which tell a half to 1.6 %: 8 % more or less of sigma makes 5 % of it."""
    median = radians(5) / sqrt(2 * log(2))
    assert refused(check_vertical, [leaning(1.08 * median)]).startswith("would refuse 5")
    assert not refused(check_vertical, [leaning(0.92 * median)])
    assert not refused(check_vertical, [])
    # what is known of the table is the same in all units
    assert refused(check_vertical, [leaning(1e-6, (0.0, radians(5.01)))]).startswith(
        "would refuse 100 % of such units: accelerometers' errors tilt the vertical by 3.5 deg"
    )
    assert not refused(check_vertical, [leaning(1e-6, (radians(4.99), 0.0))])
    # one unit goes through all positions: the worst of them counts
    assert refused(check_vertical, [leaning(1e-6), leaning(1.08 * median)])


def test_half_of_the_units_is_not_most():
    """Of the 1000 units' first numbers 500 lie beyond their median: by size, and one unit more."""
    size = np.sort(np.abs(np.random.default_rng(0).standard_normal((1000, 2))[:, 0]))
    one = leaning(1.0)
    for last, expected in ((size[499:501].mean(), ""), (size[498:500].mean(), "would refuse 50 %")):
        one.feigned_tilt = lambda last=last: radians(5) / last * np.diag([1.0, 0.0])
        assert refused(check_vertical, [one]).startswith(expected)
        assert bool(refused(check_vertical, [one])) == bool(expected)


def test_a_heading_elsewhere_forbids_a_number_from_ten_per_cent_on():
    assert rivalled(Rival(1.1, 1.0, 2.0)) == rivalled(Rival(0.9, 1.0, 2.0)) == ""
    assert rivalled(Rival(0.5, 1.0, 2.0)).startswith("by first order it would be 2 times too large")
    assert rivalled(Rival(1.101, radians(75), 2.04)).startswith(
        "a heading 75 deg off fits the readings nearly as well (chi-square 2.0 more)"
    )


@pytest.mark.parametrize(("each_deg", "told"), [(73.4, True), (73.6, False)])
def test_a_search_from_any_heading_has_no_number(each_deg, told):
    """Of a heading that may be any the root mean square is pi/sqrt(3), 103.9 deg: two of 73.5."""
    one = np.diag([0.0, 0.0, radians(each_deg) ** 2])
    found = unsettled({"gyro noise": one, "motion": one}, 0.0)
    assert (found == "") is told
    if not told:
        assert found.startswith("it is looked for from that of inertial, which is off by 104 deg")


@pytest.mark.parametrize(("off_deg", "told"), [(28.6, True), (-28.7, False)])
def test_a_search_that_every_run_begins_elsewhere_has_no_number(off_deg, told):
    """Half a radian is 28.65 deg."""
    sure = {"gyro noise": np.diag([0.0, 0.0, radians(5) ** 2])}
    assert (unsettled(sure, radians(off_deg)) == "") is told


@pytest.mark.parametrize(
    ("heading_deg", "start_deg", "off_deg", "expected"),
    [
        (
            31,
            58,
            0,
            "a filter in a turn must settle, and with a heading of 31 deg, looked for from",
        ),
        (29, 58, 0, ""),
        (31, 57, 9.9, ""),
        (1, 1, -46.4, "what is known by value turns heading by 46 deg by first order"),
    ],
)
def test_tilts_of_a_turn_need_a_heading_that_is_settled(heading_deg, start_deg, off_deg, expected):
    """30 deg, and 57.3 of the match that it starts from; 10 of what is alike in every run."""
    own, match = (
        {"gyro noise": np.diag([0.0, 0.0, radians(a) ** 2])} for a in (heading_deg, start_deg)
    )
    found = unturned(own, match, radians(off_deg))
    assert found.startswith(expected)
    assert bool(found) == bool(expected)


def test_a_filter_that_a_lag_turns_off_its_heading_need_not_settle():
    """57.3 deg, by what is alike in every run."""
    assert adrift(radians(57.2)) == ""
    assert adrift(radians(301)).startswith(
        "what is alike in every run, a lag say, turns heading by"
    )


# --- attitudes carried too far, and rounding that nothing blurs


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_gravity_may_be_carried_off_by_ten_degrees(axis):
    """About north or east; about the vertical it is not gravity that turns."""
    P = np.zeros((3, 3))
    P[axis, axis] = radians(6.0) ** 2
    for rest_of_it, expected in ((8.01, axis < 2), (7.99, False)):
        Q = np.zeros((3, 3))
        Q[axis, axis] = radians(rest_of_it) ** 2  # 6 and 8 make 10
        found = refused(check_carried, "rocks", {"gyro noise": P, "motion": Q})
        assert bool(found) == expected, rest_of_it
        if found:
            assert found.startswith("rocks: such gyros carry the attitude so far off that gravity")
            assert "tilt by 10 deg (1 sigma)" in found


def test_rates_are_coarse_where_noise_does_not_blur_a_step():
    """``2 exp(-(2 pi s)^2)`` is 0.07^2 at noise of s = 0.39022 steps."""
    still = load_imu("hg9900")
    for factor, expected in ((0.99, True), (1.01, False)):
        step = 1e-4
        noise = factor * 0.39022 * step / sqrt(20)  # of one sample at 20 Hz
        gyro = replace(still.gyro, resolution=step, noise=noise, bandwidth=np.inf)
        told = coarse(rest(replace(still, gyro=gyro)))
        assert bool(told) == expected, factor
        if told:
            assert f"rounded to {step * 180 / pi:.3g} deg/s" in told
            assert "0.0022 deg/s at 20 Hz" in told


def test_forces_are_coarse_likewise():
    """0.39022 steps of noise again; a difference of later samples then has no sigma."""
    still = load_imu("hg9900")
    for factor, expected in ((0.99, True), (1.01, False)):
        step = 2e-3 * STANDARD_GRAVITY
        noise = factor * 0.39022 * step / sqrt(20)
        accel = replace(still.accel, resolution=step, noise=noise, bandwidth=np.inf)
        told = coarse_tilt(rest(replace(still, accel=accel)))
        assert bool(told) == expected, factor
        assert not expected or "rounded to 2 mg" in told
        assert not expected or "0.77 mg at 20 Hz" in told


def test_a_tilt_by_later_samples_of_a_coarse_unit_has_no_number():
    procedure = load_procedure("six-position")
    still = load_imu("hg9900")
    unit = replace(still, accel=replace(still.accel, resolution=2e-3 * STANDARD_GRAVITY))
    asked = assembled(procedure, unit, table_of(procedure), procedure.entry.site.site(), 20)
    told = rehearse(replace(asked, methods=("six-position", "triad"))).predictions
    tilts = [p for p in told if p.quantity in ("pitch", "roll")]
    later = [p for p in tilts if p.window == "fresh"]
    assert {p.determined for p in later} == {False}
    assert "forces are rounded to 2 mg" in later[0].reason
    assert {p.determined for p in tilts if p.method == "triad"} == {True}


# --- lengths


def margins(scene, quantity):
    (step,) = feasibility(scene)
    return [m for m in step.margins if m.quantity == quantity]


def test_a_stretch_has_three_samples():
    """1 s at 3 Hz has three; at 2 Hz it would take 1.5 s."""
    (kept,) = margins(rest(rate_hz=3, seconds=1), "sampling")
    assert (kept.value, kept.limit, kept.ratio, kept.kept) == (1.0, 1.0, 1.0, True)
    scene = rest(rate_hz=2, seconds=1)
    (short,) = margins(scene, "sampling")
    assert (short.value, short.ratio, short.kept) == (1.5, 1.5, False)
    texts = [f.text for f in from_margins(feasibility(scene))]
    assert 'step 1 "rest": lasts 1 s, needs 1.5 s: is too short for its sample rate' in texts


@pytest.mark.parametrize("sensor", ["gyro", "accel"])
def test_a_rest_outlasts_a_low_pass(sensor):
    """1.13 over the bandwidth: 20 s at 0.0565 Hz."""
    still = load_imu("hg9900")
    for bandwidth, kept in ((0.0566, True), (0.0564, False)):
        slow = replace(getattr(still, sensor), bandwidth=bandwidth)
        (found,) = margins(rest(replace(still, **{sensor: slow})), "filter")
        assert found.kept == kept
        assert found.value == pytest.approx(1.13 / bandwidth)


def test_a_sensor_has_its_range():
    """Level at 48.5 deg: 9.80936 m/s^2 are 1.000276 g, and Earth turns by 11.26509 deg/h."""
    still = load_imu("hg9900")
    g0, hour = 9.80665, radians(1 / 3600)
    for sensor, quantity, size, per in (
        ("accel", "sensor force", 1.000276, g0),
        ("gyro", "sensor rate", 11.26509, hour),
    ):
        for factor, kept in ((1.00001, True), (0.99999, False)):
            narrow = replace(getattr(still, sensor), range=factor * size * per)
            scene = rest(replace(still, **{sensor: narrow}))
            (found,) = margins(scene, quantity)
            assert found.kept == kept, (sensor, factor)
            assert found.axis.endswith("Y1")
            assert (found.first_violation is None) == kept
            texts = [f.text for f in from_margins(feasibility(scene))]
            assert any("Y1 would feel" in text for text in texts) != kept


def test_a_record_is_ten_times_as_long_as_a_term_needs():
    """White noise of N meets 0.664 B at (N/0.664 B)^2 = 2 s."""
    scene = rest()
    for factor, told in ((1.001, True), (0.999, False)):
        gyro = replace(scene.imu.gyro, noise=0.664 * sqrt(2) * factor, instability=1.0)
        accel = replace(scene.imu.accel, instability=0.0)
        unit = replace(scene.imu, gyro=gyro, accel=accel)
        assert averaging_time(gyro, "B") == pytest.approx(2 * factor**2, rel=1e-3)
        found = list(allan_lengths(scene.plan, unit, ["N", "B", "Q"]))
        assert [f.kind for f in found] == ["record length"] * told
        if told:
            assert found[0].step == "rest"
            assert found[0].text.startswith("Allan term B of the gyros shows from 20")
            assert found[0].text.endswith("of rest on, the longest lasts 20 s")


def test_the_longest_rest_counts_for_allan_terms_and_no_turn_does():
    unit = rest().imu
    gyro = replace(unit.gyro, noise=0.664 * sqrt(2), instability=1.0)  # 20 s, as above
    unit = replace(unit, gyro=gyro, accel=replace(unit.accel, instability=0.0))

    def told(*stretches):
        made = [
            SimpleNamespace(label=label, steady_from=5.0, steady_to=5 + seconds, turning=turns)
            for label, seconds, turns in stretches
        ]
        found = list(allan_lengths(SimpleNamespace(stretches=made), unit, ["B"]))
        return [(f.step, f.text.rpartition("lasts ")[2]) for f in found]

    a, b, turn = ("a", 15.0, None), ("b", 19.0, None), ("t", 100.0, "outer")
    assert told(a, b, a, turn) == [("b", "19 s")]
    assert told(turn) == told() == [("", "0 s")]
    assert told(a, ("c", 20.1, None)) == []


def test_a_limit_is_first_broken_when_it_is():
    """15.05 sin(2 pi 0.05 (t - 10)) deg is beyond 15 from 10 + 1.489237/0.314159 = 14.7404 s on."""
    text = '[[step]]\nkind = "sine"\nlabel = "rocks"\nduration_s = 40\nfade_s = 10\n'
    text += "axes = {{ base_roll = {{ amplitude_deg = {}, frequency_hz = 0.05 }} }}\n"
    for amplitude, first in ((15.05, 14.7404), (14.99, None)):
        made = assembled(
            case([], text.format(amplitude)),
            load_imu("hg9900"),
            load_table("mid-class"),
            rate_hz=20,
        )
        (angle,) = margins(prepared(made), "angle")
        assert (angle.axis, angle.kept) == ("base_roll", first is None)
        assert abs(angle.value) == pytest.approx(amplitude, abs=1e-3)
        if first is None:
            assert angle.first_violation is None
        else:
            assert angle.first_violation == pytest.approx(first, abs=2e-3)


# --- forces so sure that the table's lean tells biases

LEANING = '[[step]]\nkind = "move"\nlabel = "lean"\njoints_deg = { base_roll = 14 }\n'
HALF_TURN = (DWELL.format("first", 60), TURNED.format(180), DWELL.format("second", 60))


def half_turn(lean=False, **accel):
    """Predictions and seconds of rest of half a turn; accelerometers with these errors alone."""
    unit = load_imu("hg9900")
    unit = replace(unit, accel=replace(unit.accel, **{"bias": 0.0, "scale": 0.0} | accel))
    procedure = case(["two-position"], *(LEANING,) * lean, *HALF_TURN)
    settings = assembled(procedure, unit, load_table("mid-class"), rate_hz=20)
    steps = prepared(settings).plan.stretches
    seconds = sum(step.steady_to - step.steady_from for step in steps)
    return {p.quantity: p for p in rehearse(settings).predictions}, seconds


@pytest.mark.parametrize(("lean", "field"), [(False, "bias"), (True, "scale")])
def test_a_lean_tells_accelerometer_errors_where_forces_are_surer_than_both(lean, field):
    """The table leans by sqrt(2 10^2 + 3^2 + 10^2 + 3^2 + 30^2 + 5^2) = 35.3'' = 0.171 mrad.

    With b = 1 mm/s^2 that is 1.71e-7 m/s^2. Noise s of the mean leaves 1/sqrt(1 + (t b/s)^2), 0.9
    at t b/s = 0.4843. Of a base at 14 deg the force across, 2.373 m/s^2, goes round, 1.678 of it
    rms along an axis; 595.9 ppm of that are 1 mm/s^2.
    """
    t, b = radians(35.256 / 3600), 1e-3
    assert t * b == pytest.approx(1.709e-7, rel=1e-3)
    size = {"bias": b, "scale": b / (G * np.sin(radians(14)) / sqrt(2))}[field]
    assert size == pytest.approx({"bias": 1e-3, "scale": 595.9e-6}[field], rel=1e-3)
    _, seconds = half_turn(lean, noise=1e-3)
    limit = t * b / 0.4843 * sqrt(seconds)
    for factor, determined in ((1.03, True), (0.97, False)):
        found, _ = half_turn(lean, noise=factor * limit, **{field: size})
        assert found["heading"].determined
        for quantity in ("roll", "pitch", "accelerometer bias X1", "accelerometer bias Z1"):
            p = found[quantity]
            assert p.determined == determined, (factor, quantity)
            if not determined:
                assert "0.0098 deg by which the table may lean make 1.7e-07 m/s^2" in p.reason
