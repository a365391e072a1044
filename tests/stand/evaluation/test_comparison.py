"""Methods side by side: schema, statistics and floors by hand, runs that are those of the stand."""

from dataclasses import asdict, replace
from itertools import pairwise
from math import inf, nan, pi, radians, sqrt

import numpy as np
import pytest
from procedures import HALF_TURN
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from alignment import ESTIMATORS, AttitudeEstimate, Dwell, ImuReadings, Priors, Site
from alignment.angles import Sequence
from alignment.errors import AlignmentError
from stand.errors import StandError
from stand.evaluation.comparison import (
    against_truth,
    applicable,
    compare,
    floors,
    to_json,
    used_time,
)
from stand.evaluation.heading_history import heading_error_over_time, histories
from stand.evaluation.statistics import (
    EstimateErrors,
    Outcome,
    nees_bounds,
    rms_interval,
    tally,
    worth,
)
from stand.imu import ImuSpec, load_imu
from stand.imu.filter import remembered
from stand.imu.model import TERMS
from stand.motion.polynomial import MotionKind
from stand.procedure.procedure import load_procedure
from stand.report.compare import PNG, picture, table, write_picture
from stand.samples import Sampling
from stand.simulation.monte_carlo import Trials, spans, watch
from stand.simulation.parallel import RunFailed
from stand.simulation.settings import assembled
from stand.simulation.simulation import Simulation

DEG = pi / 180
TURNING = """
title = "A turn each way"
table = "mid-class"
[site]
latitude_deg = 48.5
[estimate]
methods = ["carousel"]
[[step]]
kind = "rate"
label = "slow"
axis = "outer"
rate_deg_s = 20
turns = 1
directions = "both"
[[step]]
kind = "dwell"
label = "after"
duration_s = 4
"""
SHORT_REST = HALF_TURN.replace("duration_s = 24", "duration_s = 3")
ROCKING = """
[[background]]
kind = "sway"
fade_s = 1
[background.axes]
base_roll = { rms_deg = 1, frequency_hz = 0.2 }
"""
SCHEMA = {
    "method",
    "runs",
    "estimates",
    "refused",
    "reason",
    "refused_stretches",
    "beyond_linear_range",
    "undetermined",
    "heading_undetermined",
    "tilt_undetermined",
    *(f"{k}_{a}_deg" for k in ("rms", "sigma", "floor") for a in ("heading", "tilt")),
    *(f"{r}{end}" for r in ("ratio", "ratio_tilt") for end in ("", "_low", "_high")),
    "nees_mean",
    "nees_low",
    "nees_high",
    "seconds",
}
TEXTS = {"method", "reason", "refused_stretches", "heading_undetermined", "tilt_undetermined"}


def procedure_of(tmp_path, text):
    path = tmp_path / "test.toml"
    path.write_text(text, encoding="utf-8")
    return load_procedure(str(path))


def settings_of(procedure, imu: str | ImuSpec = "ring-laser", **changes):
    unit = load_imu(imu) if isinstance(imu, str) else imu
    return assembled(procedure, unit, rate_hz=20, **changes)


@pytest.fixture
def half_turn(tmp_path):
    return settings_of(procedure_of(tmp_path, HALF_TURN))


# --- the command


def test_json_of_the_command(stand_command, tmp_path):
    path = tmp_path / "half-turn.toml"
    path.write_text(HALF_TURN, encoding="utf-8")
    options = ("--imu", "ring-laser", "--runs", 3, "--methods", "triad,two-position,carousel")
    outcome = stand_command("compare", path, *options, "--json")
    assert outcome.code == 0, outcome.err
    found = outcome.json
    assert [row["method"] for row in found["methods"]] == ["triad", "two-position", "carousel"]
    assert all(set(row) == SCHEMA for row in found["methods"])
    first, second, refused = found["methods"]
    assert (first["runs"], first["estimates"], second["estimates"]) == (3, 6, 3)
    for row in (first, second):
        for name in SCHEMA - TEXTS:
            assert isinstance(row[name], (int, float)), name
        # floors by hand: 0.003/60 deg/rt-s over 9.96651 deg/h, in 24 s and in 48 s
        T = 24 if row is first else 48
        floor = 0.003 / 60 / (9.96651 / 3600 * DEG * sqrt(T))
        assert row["floor_heading_deg"] == pytest.approx(floor, rel=1e-5)
        assert row["ratio"] == pytest.approx(row["rms_heading_deg"] / floor, rel=1e-5)
    assert refused["refused"] == 3
    assert "constant rate" in refused["reason"]
    assert refused["ratio"] is None
    assert found["pictures"] == []
    assert not (tmp_path / "recordings").exists()


def test_table_for_people_and_picture(stand_command, tmp_path, monkeypatch):
    monkeypatch.setenv("COLUMNS", "100")
    path = tmp_path / "half-turn.toml"
    path.write_text(HALF_TURN, encoding="utf-8")
    options = ("--imu", "ring-laser", "--runs", 2, "--methods", "triad,carousel", "--out", tmp_path)
    outcome = stand_command("compare", path, *options)
    assert outcome.code == 0, outcome.err
    lines = outcome.out.splitlines()
    assert max(map(len, lines)) <= 100 or str(tmp_path) in max(lines, key=len)
    (triad,) = [line for line in lines if line.strip().startswith("triad ")]
    assert " ms" in triad  # the run time has room
    assert any("no answer always from carousel" in line for line in lines)
    assert (tmp_path / PNG).read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        ((), "name a procedure"),
        (("two-position", "--methods", "triat"), "did you mean triad"),
        (("two-position", "--runs", 0), "runs = 0: must be 1 or more"),
        (("two-positoin",), "two-position"),
        (("two-position", "--without", "noise"), "unknown error term"),
        (("two-position", "--rate", 0), "rate = 0 Hz"),
        (("two-position", "--latitude", 91), "latitude = 91 deg: must be -90 to 90"),
    ],
)
def test_refusals_are_one_line(stand_command, arguments, told):
    outcome = stand_command("compare", *arguments, "--json")
    assert outcome.code == 2
    assert told in outcome.err
    assert outcome.err.count("\n") == 1


def test_nothing_to_estimate_from(tmp_path):
    moves = HALF_TURN[: HALF_TURN.index("[[step]]")].replace('"triad"', "") + (
        '[[step]]\nkind = "move"\nlabel = "there"\njoints_deg = { outer = 10 }\n'
    )
    with pytest.raises(StandError, match="nothing to estimate from"):
        compare(settings_of(procedure_of(tmp_path, moves)), 1)


def test_all_that_apply_are_compared(half_turn, tmp_path):
    names = applicable(Trials(half_turn).plan)
    assert {"triad", "two-position", "six-position"} <= set(names)
    assert "carousel" not in names
    turning = applicable(Trials(settings_of(procedure_of(tmp_path, TURNING))).plan)
    assert {"carousel", "triad"} <= set(turning)
    assert list(turning) == [name for name in ESTIMATORS if name in turning]


# --- runs


def same_but_time(comparison):
    return [replace(t, seconds=0.0) for t in comparison.tallies]


def test_a_method_answers_the_same_whether_it_is_named_or_not(tmp_path):
    """A calibration is told of table and gravity, and follows the moves, in either case."""
    made = settings_of(procedure_of(tmp_path, SHORT_REST), "stim300")
    assert "calibration" not in made.procedure.entry.estimate.methods
    named = settings_of(made.procedure, "stim300", methods=("calibration",))
    (alone,) = compare(named, 1).tallies
    (among,) = [t for t in compare(made, 1).tallies if t.method == "calibration"]
    sizes = [(t.rms_heading, t.sigma_heading, t.rms_tilt, t.sigma_tilt) for t in (alone, among)]
    assert min(sizes[0]) > 0
    assert sizes[0] == sizes[1]


@pytest.mark.slow
def test_numbers_do_not_depend_on_the_processes(half_turn):
    made = replace(half_turn, seed=5)
    methods = ("triad", "two-position", "rk4")
    one, two, again = (compare(replace(made, methods=methods), 6, workers=k) for k in (1, 2, 1))
    assert repr(same_but_time(one)) == repr(same_but_time(two))
    assert repr(same_but_time(one)) == repr(same_but_time(again))  # the truth kept changes nothing
    other = compare(replace(made, seed=6, methods=methods), 6, workers=1)
    assert other.tallies[0].rms_heading != one.tallies[0].rms_heading


def equal_readings(trials, settings):
    run = watch(settings)
    dwells, attitudes = trials.readings(settings.seed)
    assert [d.label for d in dwells] == [d.label for d in run.dwells]
    for dwell, whole in zip(dwells, run.dwells, strict=True):
        np.testing.assert_array_equal(dwell.readings.t, whole.readings.t)
        np.testing.assert_array_equal(dwell.readings.w_ib_b, whole.readings.w_ib_b)
        np.testing.assert_array_equal(dwell.readings.f_b, whole.readings.f_b)
        assert (dwell.turn is None) == (whole.turn is None)
        if dwell.turn is not None and whole.turn is not None:
            np.testing.assert_array_equal(dwell.turn.angle, whole.turn.angle)
    for C_nb, true in zip(attitudes, run.attitudes, strict=True):
        np.testing.assert_array_equal(C_nb.as_quat(), true.as_quat())


@pytest.mark.parametrize("text", [HALF_TURN, TURNING, SHORT_REST + ROCKING])
@pytest.mark.parametrize("true_table", [False, True])
def test_runs_are_those_of_the_stand(tmp_path, text, true_table):
    """Left-out truth changes no bit of what a method sees, drifts and table errors included."""
    made = settings_of(procedure_of(tmp_path, text), true_table=true_table)
    trials = Trials(made)
    for seed in (3, 4, 3):
        equal_readings(trials, replace(made, seed=seed))


def test_a_sway_drawn_beyond_the_table_is_refused(tmp_path):
    """Each seed's own motion is checked: 3 deg in a second's fade are too much for all but a few.

    What is said, and of which step, is what a run by `Simulation` says.
    """
    made = settings_of(
        procedure_of(tmp_path, SHORT_REST + ROCKING.replace("rms_deg = 1", "rms_deg = 3"))
    )
    trials = Trials(made)
    trials.readings(0)
    for seed, label in ((1, "first"), (6, "second")):
        with pytest.raises(StandError, match=f'"{label}", base_roll: jerk') as refused:
            trials.readings(seed)
        with pytest.raises(StandError) as whole:
            Simulation(replace(made, seed=seed))
        assert str(refused.value) == str(whole.value)


@pytest.mark.parametrize("bandwidth", [1.0, 20.0])
@pytest.mark.parametrize("text", [HALF_TURN, TURNING, SHORT_REST + ROCKING])
def test_a_filter_remembers_the_moves(tmp_path, bandwidth, text):
    """All of them, or the last second: of 20 Hz 16 samples of 20 Hz, exp(-64) of 9.8 m/s^2."""
    unit = load_imu("ring-laser")
    gyro, accel = (replace(t, bandwidth=bandwidth) for t in (unit.gyro, unit.accel))
    made = settings_of(procedure_of(tmp_path, text), replace(unit, gyro=gyro, accel=accel))
    trials = Trials(made)
    for seed in (0, 1):
        equal_readings(trials, replace(made, seed=seed))


def test_what_is_left_out_before_a_stretch_is_forgotten():
    """A filter of 20 Hz at 20 Hz falls by exp(-4.44) in a sample: 15 samples to exp(-64), and the
    end before them; of instants three."""
    assert remembered(20.0, 20) == 16
    assert remembered(20.0, 20, Sampling.INSTANT) == 18
    assert remembered(inf, 20) == 0


@pytest.mark.slow
def test_servo_runs_are_those_of_the_stand(tmp_path):
    text = HALF_TURN.replace("duration_s = 24", "duration_s = 6")
    made = settings_of(
        procedure_of(tmp_path, text), motion=MotionKind.SERVO, true_table=True, seed=2
    )
    trials = Trials(made)
    for seed in (2, 3):  # the second by the truth that was kept
        equal_readings(trials, replace(made, seed=seed))


def test_spans_cover_every_sample_once(half_turn):
    planned = Trials(half_turn).plan
    total = round(planned.motion.duration * 20)
    found = list(spans(planned.stretches, 20, total))
    assert [found[0][0], found[-1][1]] == [0, total]
    assert all(a[1] == b[0] for a, b in pairwise(found))
    assert sum(b - a for a, b, step in found if step is not None) == 2 * 24 * 20


def test_estimates_that_repeat_their_own_offset_are_not_counted(half_turn):
    """Two rests in eight runs are 16 answers; those of the offset's own window are exact.

    ARW over 9.96651 deg/h, offset of 10 s and 14 s after it: 7.48 mrad; the others would halve its
    square. 16 normal numbers: 99.9 % of chi-square.
    """
    (row,) = compare(replace(half_turn, methods=("six-position",)), 8, workers=1).tallies
    assert row.estimates == 16
    sigma = 0.003 / 60 / (9.96651 / 3600) * sqrt(1 / 10 + 1 / 14)
    low, high = chi2.ppf([0.0005, 0.9995], 16)
    assert low < 16 * (row.rms_heading / sigma) ** 2 < high
    assert row.rms_heading == pytest.approx(0.00862, rel=1e-3)  # with them 0.00610


def test_a_fault_in_a_run_names_its_seed(half_turn, monkeypatch):
    def broken(dwells, site, options):
        raise ZeroDivisionError("no such luck")

    monkeypatch.setitem(ESTIMATORS, "triad", replace(ESTIMATORS["triad"], estimate=broken))
    with pytest.raises(RunFailed, match="run with seed 7: ZeroDivisionError: no such luck"):
        compare(replace(half_turn, seed=7, methods=("triad",)), 2, workers=1)


def test_a_picture_that_cannot_be_written_costs_no_table(stand_command, tmp_path):
    path = tmp_path / "half-turn.toml"
    path.write_text(HALF_TURN, encoding="utf-8")
    options = ("--imu", "ring-laser", "--runs", 2, "--methods", "triad")
    outcome = stand_command("compare", path, *options, "--out", path)  # a file
    assert (outcome.code, outcome.err.count("\n")) == (2, 1)
    assert "half-turn.toml" in outcome.err
    assert "err/floor" in outcome.out


def test_a_refusal_is_counted_and_told(half_turn, monkeypatch):
    estimate = ESTIMATORS["triad"].estimate
    calls = []

    def moody(dwells, site, options):
        calls.append(1)
        if len(calls) == 2:
            raise AlignmentError("not today")
        return estimate(dwells, site, options)

    monkeypatch.setitem(ESTIMATORS, "triad", replace(ESTIMATORS["triad"], estimate=moody))
    told = []
    found = compare(replace(half_turn, methods=("triad",)), 3, told.append, workers=1)
    (row,) = found.tallies
    assert (row.runs, row.refused, row.estimates, row.reason) == (3, 1, 4, "not today")
    assert told == pytest.approx([1 / 3, 2 / 3, 1])
    assert "no answer in 1 of 3 runs from triad: not today" in table(found).notes


def test_a_stretch_that_is_refused_leaves_the_others_of_its_run(half_turn, monkeypatch, tmp_path):
    """Of 3 runs of 2 stretches one stretch is refused once: 5 estimates, and no run without any.

    Before, the run counted as refused: 4 estimates. A second command reads the same of its file.
    """
    estimate, asked = ESTIMATORS["triad"].estimate, []

    def moody(dwells, site, options):
        if len(dwells) == 2:
            asked.append(1)
        if len(asked) == 2 and len(dwells) == 2:
            raise AlignmentError(f"{dwells[1].label}: not at rest: it turns at 0.2 deg/s")
        return estimate(dwells, site, options)

    monkeypatch.setitem(ESTIMATORS, "triad", replace(ESTIMATORS["triad"], estimate=moody))
    settings, kept = replace(half_turn, methods=("triad",)), tmp_path / "runs"
    found = compare(settings, 3, workers=1, keep=kept)
    (row,) = found.tallies
    assert (row.runs, row.refused, row.estimates, row.reason) == (3, 0, 5, "")
    ((stretch, runs, reason),) = row.left_out
    assert (runs, reason) == (1, f"{stretch}: not at rest: it turns at 0.2 deg/s")
    assert f"no answer in 1 of 3 runs from triad at {stretch}: {reason}" in table(found).notes
    (told,) = to_json(found)["methods"]
    assert told["refused_stretches"] == [{"stretch": stretch, "runs": 1, "reason": reason}]
    assert compare(settings, 3, workers=1, keep=kept).tallies == found.tallies


# --- statistics


def test_interval_of_a_root_mean_square_by_hand():
    # rms of 1, 1, 2, 2 is sqrt(2.5); 4 degrees of freedom: chi-square at 2.5 % is 0.4844, at
    # 97.5 % 11.1433 (tables)
    rms, low, high = rms_interval([1, -1, 2, -2, nan], [0, 1, 2, 3, 4])
    assert rms == pytest.approx(sqrt(2.5))
    assert low == pytest.approx(sqrt(2.5 * 4 / 11.1433), rel=1e-4)
    assert high == pytest.approx(sqrt(2.5 * 4 / 0.4844), rel=1e-4)
    assert np.isnan(rms_interval([nan], [0])).all()


def test_bounds_of_nees_by_hand():
    # 3 runs of one estimate: chi-square of 9 is 2.7004 to 19.0228 (tables), over 3
    mean, low, high = nees_bounds([1.0, 2.0, 6.0], [4, 5, 6])
    assert (mean, low, high) == pytest.approx((3.0, 2.7004 / 3, 19.0228 / 3), rel=1e-4)
    # few runs of several estimates each count as one a run
    assert nees_bounds([1.0, 2.0, 6.0] * 2, [4, 5, 6] * 2)[1:] == pytest.approx((low, high))


@pytest.mark.parametrize(("runs", "expected"), [(3, 3.0), (29, 29.0), (30, 58.0)])
def test_worth_of_few_runs_by_hand(runs, expected):
    """Two equal squares a run, 0 or 2 in turn. Below 30 runs each counts as one.

    30 runs: the mean is 1, the sums are off by 2 each; V = 30 4 / 60^2 times 30/29 = 1/29.
    """
    squares = np.repeat(np.arange(runs) % 2 * 2.0, 2)
    run = np.repeat(np.arange(runs), 2)
    assert worth(squares, run) == pytest.approx(expected, rel=1e-12)
    assert worth(squares[::2], run[::2]) == runs  # one each: a degree of freedom each


def test_worth_is_never_more_than_the_values():
    """Squares of 1 and 1.1 in turn scatter less than chi-square does: 60 of 60, and 180 of 60."""
    squares, run = np.tile([1.0, 1.1, 1.1, 1.0], 15), np.repeat(np.arange(30), 2)
    assert worth(squares, run) == 60.0
    assert worth(squares, run, 3) == 180.0


def test_heavy_tails_leave_a_nees_its_runs():
    """One run of 30 has it all: worth next to nothing, and still 3 x 30 degrees of freedom.

    Chi-square of 90 is 65.647 to 118.136 (tables).
    """
    values = np.zeros(60)
    values[:2] = 100.0
    mean, low, high = nees_bounds(values, np.repeat(np.arange(30), 2))
    assert worth(values, np.repeat(np.arange(30), 2), 3) < 3
    expected = (200 / 60, 3 * 65.647 / 90, 3 * 118.136 / 90)
    assert (mean, low, high) == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize("shared", [0.0, 1.0])
def test_estimates_of_one_run_count_for_what_they_are_worth(shared):
    """Four estimates a run: four times as many when independent, as many as runs when equal."""
    rng, runs, each = np.random.default_rng(0), 4000, 4
    own = rng.normal(size=(runs, each))
    common = rng.normal(size=(runs, 1)) * np.ones(each)
    values = (common if shared else own).ravel()
    run = np.repeat(np.arange(runs), each)
    freedom = worth(values**2, run)
    # a variance of 4000 squares of kurtosis 15 (of sums: 6) scatters by 6 %; three of those
    assert freedom == pytest.approx(runs * (1 if shared else each), rel=0.18)
    assert freedom <= runs * each


@pytest.mark.parametrize("correlation", [0.0, 0.7, 1.0])
def test_intervals_cover(correlation):
    """95 of 100 intervals hold the truth, however much the estimates of a run share."""
    rng, hits, nees_hits, trials = np.random.default_rng(1), 0, 0, 400
    run = np.repeat(np.arange(60), 3)
    a, b = sqrt(correlation), sqrt(1 - correlation)
    for _ in range(trials):
        x = a * rng.normal(size=(60, 1, 3)) + b * rng.normal(size=(60, 3, 3))
        _, low, high = rms_interval(x[..., 0].ravel(), run)
        hits += low < 1 < high
        mean, low, high = nees_bounds((x**2).sum(axis=2).ravel(), run)
        nees_hits += low < mean < high
    # of 400 at 95 % four sigma are 17; the worth itself is uncertain: 2 % more. Too wide is wrong
    # too: all 400 would be a coverage of 99 % or more
    assert min(hits, nees_hits) > 0.95 * trials - 17 - 0.02 * trials
    assert max(hits, nees_hits) < 0.95 * trials + 17


def test_tally_by_hand():
    one = EstimateErrors(0.01, 3e-5, 0.0, 0.02, 1e-5, 3e-5, 3.0, 0.005, 1e-5)
    two = EstimateErrors(-0.01, 0.0, -4e-5, 0.04, 2e-5, 2e-5, 5.0, 0.005, 1e-5)
    outcomes = [Outcome("m", 0, (one,), 0.5), Outcome("m", 1, (two,), 0.3)]
    t = tally("m", 3, [*outcomes, Outcome("m", 2, (), 0.1, "why")])
    assert (t.runs, t.estimates, t.refused, t.reason) == (3, 2, 1, "why")
    assert (t.rms_heading, t.sigma_heading, t.floor_heading) == pytest.approx((0.01, 0.03, 0.005))
    assert (t.ratio, t.ratio_tilt) == pytest.approx((2.0, 2.5))
    assert t.ratio_low < 2 < t.ratio_high
    assert (t.rms_tilt, t.sigma_tilt, t.nees_mean) == pytest.approx((2.5e-5, 2e-5, 4.0))
    assert t.seconds == pytest.approx(0.3)
    assert not t.beyond_linear
    assert replace(t, sigma_heading=8.1 * DEG).beyond_linear
    assert asdict(tally("m", 1, [Outcome("m", 0, (), 0.0, "no")]))["estimates"] == 0


# --- one estimate against the truth

LEVEL = Rotation.from_matrix([[1, 0, 0], [0, 0, 1], [0, -1, 0]])  # X1 north, Y1 up, Z1 east


def estimate_of(C_nb, method="triad", t_from=0.0, t_to=100.0, covariance=None):
    P = np.diag([1e-8, 4e-8, 1e-6]) if covariance is None else covariance
    return AttitudeEstimate(method, "d", t_from, t_to, C_nb, Sequence.YAW_PITCH_ROLL, covariance=P)


def dwell_of(label, t_from, t_to):
    t = np.array([t_from + 1, t_to])
    return Dwell(label, t_from, t_to, ImuReadings(t, np.zeros((2, 3)), np.zeros((2, 3))))


def test_errors_of_an_estimate_by_hand():
    small = np.array([2e-4, -2e-4, 3e-3])
    C_nb = Rotation.from_rotvec(small) * LEVEL
    found = against_truth(estimate_of(C_nb), LEVEL, (0.1, 0.2))
    assert (found.north, found.east) == pytest.approx((2e-4, -2e-4), rel=1e-9)
    assert found.heading == pytest.approx(3e-3, rel=1e-3)
    sigmas = (found.north_sigma, found.east_sigma, found.heading_sigma)
    assert sigmas == pytest.approx((1e-4, 2e-4, 1e-3), rel=1e-3)
    assert found.nees == pytest.approx(4 + 1 + 9)
    assert (found.heading_floor, found.tilt_floor) == (0.1, 0.2)
    vertical = Rotation.from_rotvec([0, pi / 2, 0])
    assert np.isnan(against_truth(estimate_of(vertical), vertical, (nan, nan)).heading)
    flat = against_truth(estimate_of(C_nb, covariance=np.zeros((3, 3))), LEVEL, (nan, nan))
    assert np.isnan(flat.nees)


def test_floors_by_hand():
    """0.003 deg/rt-h over 9.96651 deg/h and 100 s; one gyro at 45 deg to the east sqrt 2 times."""
    site, unit = Site(radians(48.5)), load_imu("ring-laser")
    dwells = [dwell_of("d", 0.0, 100.0), dwell_of("later", 200.0, 300.0)]
    expected = 0.003 / 60 / (9.96651 / 3600) / 10
    found = floors(estimate_of(LEVEL), LEVEL, dwells, site, unit)
    # 0.0353 m/s/rt-h over 9.8093587 m/s^2
    assert found == pytest.approx((expected, 0.0353 / 60 / 9.8093587 / 10), rel=1e-5)
    both = floors(estimate_of(LEVEL, t_to=300.0), LEVEL, dwells, site, unit)
    assert both[0] == pytest.approx(expected / sqrt(2), rel=1e-5)
    askew = Rotation.from_rotvec([0, 0, pi / 4]) * LEVEL
    one = estimate_of(askew, "single-gyro")
    assert floors(one, askew, dwells, site, unit)[0] == pytest.approx(sqrt(2) * expected, rel=1e-5)
    east = estimate_of(LEVEL, "single-gyro")
    assert floors(east, LEVEL, dwells, site, unit)[0] == pytest.approx(expected, rel=1e-5)
    assert np.isnan(floors(estimate_of(LEVEL, "rk4"), LEVEL, dwells, site, unit)).all()
    assert np.isnan(floors(estimate_of(LEVEL), LEVEL, dwells, Site(None), unit)).all()


def test_time_that_was_used():
    dwells = [dwell_of("a", 0, 10), dwell_of("b", 20, 30), dwell_of("c", 50, 60)]
    assert used_time(estimate_of(LEVEL, t_from=5.0, t_to=28.0), dwells) == pytest.approx(13)


def test_noise_that_is_off_leaves_no_floor(half_turn):
    made = replace(half_turn, without=("white-noise",))
    (row,) = to_json(compare(replace(made, methods=("triad",)), 1))["methods"]
    assert row["floor_heading_deg"] == 0
    assert row["ratio"] is None


# --- over time


def test_histories_end_in_the_estimates(half_turn):
    run = watch(half_turn)
    found = {(h.method, h.label): h for h in histories(half_turn, ["triad", "two-position", "rk4"])}
    for dwell, true in zip(run.dwells, run.attitudes, strict=True):
        (e,) = [
            e
            for e in ESTIMATORS["triad"].estimate([dwell], half_turn.site, half_turn.options)
            if e.C_nb is not None
        ]
        h = found["triad", dwell.label]
        off = against_truth(e, true, (nan, nan))
        assert h.grown
        assert h.t[-1] == dwell.t_to
        # the attitude halfway between two samples at rest: rounding of a rotation, over 1e-9
        assert h.error[-1] == pytest.approx(off.heading, abs=1e-9)
        assert h.sigma[-1] == pytest.approx(off.heading_sigma, rel=1e-9)
    assert ("two-position", "second") in found  # while the second rest goes on
    assert ("two-position", "first") not in found
    assert not found["rk4", "first"].grown
    assert len(found["rk4", "first"].t) > 2


def test_heading_errors_by_hand():
    P = np.diag([1e-8, 4e-8, 1e-6])
    nose_up = Rotation.from_rotvec([0, 0.3, 0])  # about east: X1 north and raised
    found = Rotation.from_rotvec([[0, 0, 1e-3]]) * nose_up
    error, sigma = heading_error_over_time(
        found, Rotation.from_quat(nose_up.as_quat()[None]), P[None]
    )
    assert error == pytest.approx([1e-3])
    e = estimate_of(found[0], covariance=P)
    assert sigma == pytest.approx([e.heading_sigma], rel=1e-12)
    steep = Rotation.from_rotvec([[0, 1.0, 0]])
    assert np.isnan(heading_error_over_time(steep, steep, P[None])[0]).all()


def test_attitude_between_samples(half_turn):
    run = watch(half_turn)
    k = int(np.searchsorted(run.t, 25.5))  # amid the move
    assert (run.C_nb(run.t[k : k + 1]) * Rotation.from_quat(run.q_nb[k]).inv()).magnitude() < 1e-9
    middle = (run.t[k] + run.t[k + 1]) / 2
    ends = Rotation.from_quat(run.q_nb[[k, k + 1]])
    halves = (run.C_nb(np.array([middle])) * ends.inv()).magnitude()
    assert halves[0] == pytest.approx(halves[1], rel=1e-6)
    assert halves[0] > 1e-3


def test_picture_of_nothing_and_of_many(half_turn, tmp_path):
    found = compare(replace(half_turn, methods=("triad",)), 1)
    assert picture(found, []).startswith(b"\x89PNG")
    own = histories(half_turn, ["triad", "two-position"])
    path = write_picture(found, own, tmp_path / "new")
    assert path.read_bytes() == picture(found, own)


# --- what it must show

ROCKED = """
title = "Rocking"
table = "mid-class"
[site]
latitude_deg = 48.5
[estimate]
methods = ["inertial"]
[[step]]
kind = "dwell"
label = "rocking"
duration_s = 108
[[background]]
kind = "sine"
fade_s = 4
[background.axes]
base_roll = { amplitude_deg = 2, frequency_hz = 0.2 }
base_pitch = { amplitude_deg = 1.5, frequency_hz = 0.13 }
"""


@pytest.mark.slow
def test_rocking_the_robust_methods_hold_and_the_analytic_one_says_no(tmp_path):
    runs = 20
    made = settings_of(procedure_of(tmp_path, ROCKED), true_table=True, seed=1000)
    triad, inertial, fine = compare(
        replace(made, methods=("triad", "inertial", "fine")), runs
    ).tallies
    assert triad.refused == runs
    assert "not at rest" in triad.reason
    for t in (inertial, fine):
        print(f"{t.method}: rms {t.rms_heading / DEG:.3f}, sigma {t.sigma_heading / DEG:.3f} deg")
        assert t.refused == 0
        # 99.9 % of chi-square: of 20 errors each, and of 60 for the whole attitude
        low, high = chi2.ppf([0.0005, 0.9995], runs)
        assert low < runs * (t.rms_heading / t.sigma_heading) ** 2 < high
        low, high = chi2.ppf([0.0005, 0.9995], 3 * runs)
        assert low < runs * t.nees_mean < high
        assert t.ratio_high > 1.0  # nothing lies below the floor


WHITE = tuple(term for term in TERMS if term != "white-noise")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("procedure", "methods"),
    [
        ("two-position", ("triad", "two-position")),
        ("four-position", ("multi-position",)),
        ("carousel", ("carousel",)),
    ],
)
def test_white_noise_reaches_the_floor(procedure, methods):
    """500 runs at 2 Hz, white noise alone: error over floor is 1.00 to 1.10, within 3.3 sigma."""
    made = load_procedure(procedure)
    options = replace(made.entry.estimate.options(), priors=Priors())
    settings = replace(
        settings_of(made, true_table=True), options=options, rate_hz=2, without=WHITE
    )
    for t in compare(replace(settings, methods=methods), 500).tallies:
        print(f"{t.method}: {t.ratio:.3f} ({t.ratio_low:.3f} to {t.ratio_high:.3f})")
        assert t.floor_heading < 8 * DEG
        assert t.refused == 0
        assert t.ratio_high > 0.96  # 3.3 sigma of 500 runs rather than 1.96
        assert t.ratio_low < 1.1 / 0.96
        # 500 degrees of freedom or more: 1.96 / sqrt(2 x 500) is 6.2 % either way, no wider
        assert 1.0 < t.ratio_high / t.ratio_low < 1.14
