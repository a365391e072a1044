"""No number that cannot stand, in any command: just below the limit and just above it.

A unit that a test makes up has gyros of so many deg/h and next to no noise. On a level rest at
latitude 48.5 deg the horizontal Earth rate is 9.96651 deg/h by hand: 5.218 deg/h of a gyro to the
east are 30 deg of heading, 2.625 deg/h about the pole's axis against 15.041 are 10 deg of latitude.
"""

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import stand
from alignment.angles import C_nb_from_angles, Sequence
from alignment.estimate import AttitudeTrack
from alignment.methods.vectors import Curve
from stand.evaluation.comparison import compare as compare_runs
from stand.evaluation.heading_history import heading_error_over_time, histories
from stand.evaluation.milestones import points
from stand.evaluation.review_curves import curves
from stand.evaluation.statistics import EstimateErrors, Outcome, tally
from stand.report.compare import picture, table
from stand.report.figures import errors
from stand.report.run_page import write_run_page

DEG = np.pi / 180
NO = "not determined"
STATED = 'kind = "assumed", source = "made up"'
REST = """
title = "A rest"
table = "laboratory"
[site]
latitude_deg = 48.5
[estimate]
methods = [METHODS]
[[step]]
kind = "dwell"
label = "rest"
duration_s = 24
"""


@pytest.fixture
def unit(tmp_path):
    """A file of a unit whose gyros are off by so many deg/h, and which states nothing else."""

    def write(bias_deg_h: float) -> str:
        path = tmp_path / f"unit{bias_deg_h}.toml"
        path.write_text(
            f"""title = "Made up"
grade = "test"
evidence = "none"
[gyro]
turn_on_bias_deg_h = {{ value = {bias_deg_h}, {STATED} }}
angle_random_walk_deg_rt_h = {{ value = 0.001, {STATED} }}
[accel]
turn_on_bias_mg = {{ value = 0.01, {STATED} }}
velocity_random_walk_m_s_rt_h = {{ value = 0.001, {STATED} }}
"""
        )
        return str(path)

    return write


@pytest.fixture
def rest(tmp_path):
    def write(*methods: str) -> str:
        path = tmp_path / "rest.toml"
        path.write_text(REST.replace("METHODS", ", ".join(f'"{m}"' for m in methods)))
        return str(path)

    return write


@pytest.fixture
def log(stand_command, tmp_path):
    """A foreign log of 24 s: Earth's rate and gravity, north, up, east, with a little noise."""
    W = 15.041067 / 3600
    mean = [W * np.cos(48.5 * DEG), W * np.sin(48.5 * DEG), 0.0, 0.0, 9.8088, 0.0]
    noise = np.random.default_rng(1).normal(size=(480, 6)) * ([1e-5] * 3 + [1e-4] * 3)
    t = np.arange(1, 481) / 20
    path = tmp_path / "log.csv"
    np.savetxt(path, np.column_stack([t, mean + noise]), delimiter=",", fmt="%.9f")
    options = ("--columns", "t,gx,gy,gz,ax,ay,az", "--gyro-unit", "deg/s", "--accel-unit", "m/s^2")
    outcome = stand_command("import", path, *options, "--out", tmp_path / "log.mcap")
    assert outcome.code == 0, outcome.err
    return tmp_path / "log.mcap"


def aligned(stand_command, log, *more):
    outcome = stand_command("align", log, "--latitude", 48.5, *more, "--json")
    assert outcome.code == 0, outcome.err
    return outcome.json


# --- align


@pytest.mark.parametrize(("bias", "sigma"), [(5.2, 29.89), (5.24, 30.12)])
def test_align_gives_a_heading_up_to_thirty_degrees(stand_command, log, unit, bias, sigma):
    (e,) = aligned(stand_command, log, "--imu", unit(bias))["estimates"]
    # noise of the readings is in the rate that it is divided by: 0.0016 of 9.97 deg/h
    assert e["sigma_heading_deg"] == pytest.approx(sigma, rel=1e-3)
    told = stand_command("align", log, "--latitude", 48.5, "--imu", unit(bias)).out
    result = stand.align(log, latitude_deg=48.5, imu=unit(bias))
    if sigma < 30:
        assert e["heading_deg"] == pytest.approx(0.0, abs=0.1) or e["heading_deg"] > 359.9
        assert "heading" not in e["undetermined"]
        assert "heading, yaw not determined" not in told
        assert result.estimates[0].heading is not None
        return
    assert e["heading_deg"] is None
    assert e["yaw_deg"] is None
    assert e["roll_deg"] == pytest.approx(0.0, abs=0.01)
    assert e["undetermined"]["heading"].startswith("sigma of 30.1")
    assert "heading, yaw not determined: sigma of 30.1" in told
    assert told.count(NO) >= 3  # yaw, heading, the note
    assert result.estimates[0].heading is None
    assert NO in repr(result)
    assert NO in result._repr_html_()


@pytest.mark.parametrize(("bias", "stands"), [(2.6, True), (2.65, False)])
def test_align_gives_a_latitude_up_to_ten_degrees(stand_command, log, unit, bias, stands):
    (e,) = aligned(stand_command, log, "--imu", unit(bias))["estimates"]
    assert e["sigma_latitude_deg"] == pytest.approx(bias / 15.041067 / DEG, rel=1e-3)
    told = stand_command("align", log, "--latitude", 48.5, "--imu", unit(bias)).out
    if stands:
        assert e["latitude_deg"] == pytest.approx(48.5, abs=0.1)
        assert NO not in told
    else:
        assert e["latitude_deg"] is None
        assert e["undetermined"]["latitude"].startswith("sigma of 10.1")
        assert "latitude not determined: sigma of 10.1" in told


def test_sigmas_without_a_data_sheet_say_so_in_their_cell(stand_command, log, unit):
    bare = aligned(stand_command, log)
    assert [e["noise_only"] for e in bare["estimates"]] == [True]
    assert bare["unstated"] == []
    (found,) = stand.align(log).tables()
    (row,) = found.rows
    assert sum(cell.endswith(" noise only") for cell in row) == 4  # roll, yaw, pitch, latitude
    assert " noise only" in stand_command("align", log, "--latitude", 48.5).out
    sheet = aligned(stand_command, log, "--imu", unit(0.1))
    assert [e["noise_only"] for e in sheet["estimates"]] == [False]
    assert " noise only" not in stand_command("align", log, "--imu", unit(0.1)).out
    assert "noise only" in repr(stand.align(log))


def test_one_estimate_is_one(log):
    assert stand.align(log).headline().startswith("1 estimate from ")


# --- run, and its page


@pytest.mark.slow
@pytest.mark.parametrize(("bias", "stands"), [(5.0, True), (5.02, False)])
def test_run_and_its_page(stand_command, rest, unit, tmp_path, bias, stands):
    """Of seed 7 the gyros drawn make 29.96 and 30.08 deg of the rates that are read."""
    options = ("--imu", unit(bias), "--rate", 2, "--seed", 7, "--true-table")
    out = tmp_path / "run"
    outcome = stand_command("run", rest("triad"), *options, "--out", out, "--json")
    assert outcome.code == 0, outcome.err
    (e,) = outcome.json["estimates"]
    assert 29.9 < e["sigma_heading_deg"] < 30.1
    assert (e["sigma_heading_deg"] < 30) is stands
    names = ("heading_deg", "yaw_deg", "error_heading_deg", "error_yaw_deg")
    assert [e.get(name) is not None for name in names] == [stands] * 4
    assert e["error_roll_deg"] is not None
    assert json.loads((out / "result.json").read_text())["estimates"] == [e]
    page = write_run_page(out).read_text()
    told = "heading not determined in 1, yaw not determined in 1, latitude"
    assert (told in page) is not stands
    assert ("heading, yaw not determined: sigma of 30.0" in page) is not stands


@pytest.mark.slow
def test_curves_of_a_run_leave_out_what_is_not_determined(stand_command, rest, unit, tmp_path):
    """30 deg/h: no heading at any time. Levelling has its curves; review and page are written."""
    options = ("--imu", unit(30), "--rate", 20, "--seed", 4, "--true-table")
    out = tmp_path / "run"
    procedure = rest("inertial", "fine")
    outcome = stand_command("run", procedure, *options, "--out", out)
    assert outcome.code == 0, outcome.err
    assert f"yaw {NO}" in write_run_page(out).read_text()
    assert (out / "run.rrd").stat().st_size > 0


@pytest.mark.parametrize(("sigma", "stands"), [(29.9, True), (30.1, False)])
def test_curves_by_hand(sigma, stands):
    true = C_nb_from_angles(Sequence.YAW_PITCH_ROLL, 0.0, 0.0, 0.0)
    found = Rotation.concatenate([C_nb_from_angles(Sequence.YAW_PITCH_ROLL, 0.01, 0.5, 0.0)] * 2)
    covariance = np.array([np.diag([0.1, 0.1, s]) ** 2 * DEG**2 for s in (1.0, sigma)])
    t = np.array([1.0, 2.0])
    track = AttitudeTrack("m", "p", t, found, Sequence.YAW_PITCH_ROLL, covariance)
    shown = curves(track, true)
    np.testing.assert_array_equal(np.isfinite(shown.errors[1]), [True, stands, True])
    np.testing.assert_array_equal(np.isfinite(shown.angles[1]), [True, stands, True])
    assert np.isfinite(shown.error_rotations[1]).all() == stands
    assert np.isfinite(shown.errors[0]).all()
    assert (f"yaw {NO}" in errors("m", 1, [shown], 3.0).alt) is not stands


# --- compare


def outcomes(undetermined, runs=4):
    good = EstimateErrors(0.1, 1e-3, 1e-3, 0.1, 1e-3, 1e-3, 3.0, 0.01, 1e-3)
    bad = EstimateErrors(
        north=1e-3, east=1e-3, north_sigma=1e-3, east_sigma=1e-3, heading_floor=0.01,
        tilt_floor=1e-3, undetermined=1.0,
    )  # fmt: skip
    kinds = [bad] * undetermined + [good] * (runs - undetermined)
    return [Outcome("triad", k, (kind,)) for k, kind in enumerate(kinds)]


def test_most_headings_decide_what_compare_says():
    half, most = tally("triad", 4, outcomes(2)), tally("triad", 4, outcomes(3))
    assert half.why_undetermined == ""
    assert half.rms_heading == pytest.approx(0.1)
    assert half.undetermined == 2
    assert most.why_undetermined == "sigma above 30 deg in 3 of 4 estimates"
    assert np.isnan([most.rms_heading, most.sigma_heading, most.ratio, most.nees_mean]).all()
    assert most.rms_tilt == pytest.approx(1e-3)
    assert not most.beyond_linear


def test_compare_says_not_determined_instead_of_a_number(rest, unit):
    poor = stand.settings(rest("triad"), unit(40), rate_hz=2, true_table=True, methods=["triad"])
    fair = stand.settings(rest("triad"), unit(0.5), rate_hz=2, true_table=True, methods=["triad"])
    (row,) = table(compare_runs(poor, 4, workers=1)).rows
    assert row[1:3] == (NO, "")
    assert row[5] != ""  # tilt stands
    (row,) = table(compare_runs(fair, 4, workers=1)).rows
    assert NO not in row


def test_compare_for_machines_and_its_picture(stand_command, rest, unit, tmp_path):
    options = ("--imu", unit(40), "--rate", 2, "--true-table", "--runs", 4, "--methods", "triad")
    outcome = stand_command("compare", rest("triad"), *options, "--out", tmp_path, "--json")
    assert outcome.code == 0, outcome.err
    (row,) = outcome.json["methods"]
    assert row["rms_heading_deg"] is None
    assert row["sigma_heading_deg"] is None
    assert row["nees_mean"] is None
    assert row["heading_undetermined"].startswith("sigma above 30 deg in ")
    assert row["rms_tilt_deg"] > 0
    assert (tmp_path / "compare.png").stat().st_size > 0


def test_a_history_ends_where_the_heading_is_not_determined(rest, unit):
    C = Rotation.identity(2)
    covariance = np.array([np.diag([0.0, 0.0, s * DEG]) ** 2 for s in (29.9, 30.1)])
    error, sigma = heading_error_over_time(C, C, covariance)
    np.testing.assert_array_equal(np.isfinite(error), [True, False])
    np.testing.assert_array_equal(np.isfinite(sigma), [True, False])
    settings = stand.settings(rest("two-gyro"), unit(400), rate_hz=2, true_table=True)
    found = histories(settings, ["triad"])
    comparison = compare_runs(settings, 2, workers=1)
    assert picture(comparison, found).startswith(b"\x89PNG")


# --- rehearse, drive


@pytest.mark.parametrize(("bias", "stands"), [(1.7, True), (1.8, False)])
def test_rehearse_gives_no_heading_beyond_first_order(stand_command, rest, unit, bias, stands):
    """A prediction is of first order: it ends at 10 deg already, 1.739 deg/h of 9.96651."""
    options = ("--imu", unit(bias), "--rate", 20, "--table", "laboratory")
    found = stand_command("rehearse", rest("triad"), *options, "--json").json
    heading = next(p for p in found["predictions"] if p["quantity"] == "heading")
    assert (heading["sigma"] is not None) is stands
    assert heading["reason"].startswith("" if stands else f"{NO}: sigma of 10.")
    told = stand_command("rehearse", rest("triad"), *options).out
    assert (f"{NO}: sigma" in " ".join(told.split())) is not stands


@pytest.mark.parametrize(("sigma", "stands"), [(29.9, True), (30.1, False)])
def test_points_of_a_drive(sigma, stands):
    covariance = np.diag([0.0, 0.0, sigma * DEG]) ** 2
    curve = Curve("m", np.array([5]), np.zeros((1, 3)), covariance[None], np.array([True]))
    (point,) = points(curve)
    assert (point.undetermined == "") is stands


def test_drive_gives_no_attitude_that_the_gyros_have_lost(stand_command, unit, tmp_path):
    """20000 deg/h turn the programmed start away before anything corrects it."""
    options = ("--imu", unit(20000), "--rate", 20, "--out", tmp_path / "drive")
    outcome = stand_command("drive", "accelerating", *options)
    assert outcome.code == 0, outcome.err
    assert f"printed: attitude {NO} after 5 fixes: sigma of 37" in " ".join(outcome.out.split())
    found = json.loads((tmp_path / "drive" / "result.json").read_text())
    printed, _ = found["solutions"]
    assert printed["after"][-1]["error_deg"] is None
    assert printed["after"][-1]["undetermined"] == "sigma is above 180 deg"
    (refused,) = found["refusals"]
    assert refused["window"] == "kalman"
    assert refused["reason"].endswith("a linear filter takes 5.5")


# --- what a data sheet leaves out


SENTENCE = "states no drift of the gyros: none is simulated or predicted"


@pytest.mark.slow
def test_every_command_tells_what_the_sheet_leaves_out(stand_command, rest, log, tmp_path):
    """The sheet of bmi088 states no drift, that of stim300 leaves nothing out."""
    for name, told in (("bmi088", True), ("stim300", False)):
        imu = ("--imu", name)
        out = tmp_path / name
        run = ("run", rest("triad"), *imu, "--rate", 20, "--out", out, "--force")
        for words in (
            run,
            ("align", log, "--latitude", 48.5, *imu),
            ("align", out),
            ("compare", rest("triad"), *imu, "--rate", 2, "--runs", 1, "--out", tmp_path),
            ("drive", "straight", *imu, "--rate", 20, "--out", tmp_path / f"d{name}", "--force"),
        ):
            shown = " ".join(stand_command(*words).out.split())
            assert (SENTENCE in shown) is told, words
            found = stand_command(*words, "--json").json["unstated"]
            assert any(SENTENCE in sentence for sentence in found) is told, words
        assert (SENTENCE in write_run_page(out).read_text()) is told
        assert (SENTENCE in repr(stand.align(out))) is told


# --- noise only, and what is not determined, where two logs stand side by side


def test_windows_and_logs_side_by_side_say_it_in_the_cells(
    stand_command, log, unit, tmp_path, monkeypatch
):
    monkeypatch.setenv("COLUMNS", "160")  # a narrow terminal breaks cells into lines
    stretches = tmp_path / "s.toml"
    stretches.write_text(
        '[site]\nlatitude_deg = 48.5\n[[stretch]]\nkind = "dwell"\nlabel = "a"\n'
        "from_s = 0\nto_s = 24\n"
    )
    pair = ("compare", log, log, "--stretches", stretches, "--methods", "triad")
    rows = aligned(stand_command, log, "--windows", "4")["windows"]
    assert all(row["noise_only"] for row in rows)
    for cell in stand.align(log, latitude_deg=48.5, windows_s=[4.0]).tables()[-1].rows:
        assert cell[6].endswith(" noise only")
    (bare,) = stand_command(*pair, "--json").json["estimates"]
    assert bare["noise_only"] is True
    assert " noise only" in stand_command(*pair).out
    (poor,) = stand_command(*pair, "--imu", unit(30), "--json").json["estimates"]
    assert poor["noise_only"] is False
    assert poor["off_ned_deg"] == [pytest.approx(0, abs=1e-9), pytest.approx(0, abs=1e-9), None]
    told = stand_command(*pair, "--imu", unit(30)).out
    assert " noise only" not in told
    assert NO in told


def test_the_page_of_a_log_says_noise_only_in_its_first_sentence(stand_command, log, unit):
    page = log.with_suffix(".html")
    said = ("report", log, "--latitude", 48.5, "--out", page, "--force")
    stand_command(*said)
    assert "by triad (±: of noise only)." in page.read_text("utf-8")
    stand_command(*said, "--imu", unit(0.1))
    assert "noise only" not in page.read_text("utf-8")


def test_a_sheet_that_states_noise_alone_is_told_by_run_as_by_align(
    stand_command, rest, tmp_path, unit
):
    sheet = tmp_path / "noise.toml"
    lines = (tmp_path / unit(0)).read_text().splitlines()
    sheet.write_text("\n".join(line for line in lines if "turn_on" not in line))
    out = tmp_path / "run"
    said = ("run", rest("triad"), "--imu", sheet, "--rate", 2, "--true-table", "--out", out)
    told = stand_command(*said).out
    assert " noise only" in told
    kept = json.loads((out / "result.json").read_text())["estimates"]
    assert [e["noise_only"] for e in kept] == [True]
    assert [e["noise_only"] for e in aligned(stand_command, out)["estimates"]] == [True]
    assert "noise only" in write_run_page(out).read_text()
