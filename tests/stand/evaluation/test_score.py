"""Scores: errors to truth and to nominal, spreads by hand, and the JSON that others read."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from alignment import ESTIMATORS, AttitudeEstimate, ImuReadings
from alignment.angles import C_nb_from_angles, Sequence
from alignment.units import DEG
from stand.evaluation.score import (
    Score,
    Truths,
    by_method,
    evaluate_each,
    score,
    score_to_json,
    spread_to_json,
    spreads,
)
from stand.report.document import score_tables
from stand.simulation.monte_carlo import Trials
from stand.simulation.settings import settings

YPR, YRP = Sequence.YAW_PITCH_ROLL, Sequence.YAW_ROLL_PITCH
ROUNDING = 1e-13  # deg: a few rotations multiplied and read


def C(roll: float, yaw: float, pitch: float, sequence: Sequence = YPR) -> Rotation:
    return C_nb_from_angles(sequence, roll * DEG, yaw * DEG, pitch * DEG)


def estimate(C_nb: Rotation | None, sequence: Sequence = YPR, **more) -> AttitudeEstimate:
    return AttitudeEstimate("rk4", more.pop("label", "P"), 1.0, 3.0, C_nb, sequence, **more)


def degrees(values) -> list[float]:
    return [float(v) / DEG for v in values]


def with_errors(*errors_deg, method="rk4", window="", nominal=None):
    found = []
    for k, error in enumerate(errors_deg):
        e = AttitudeEstimate(method, f"P{k}", 0, 1, C(0, 0, 0), YPR, window)
        error = None if error is None else np.array(error) * DEG
        to_nominal = error if nominal is None else np.array(nominal[k]) * DEG
        found.append(Score(e, error, to_nominal, None, None))
    return found


@pytest.fixture(scope="module")
def one_shaken():
    """Four rests a quarter turn apart; in the second somebody turns the unit by hand."""
    made = settings("four-position", imu="hg9900", rate_hz=5)
    dwells, _ = Trials(made).readings(0)
    shaken = dwells[1].readings
    hand = 0.2 * np.sin(0.5 * shaken.t)[:, None] * [0.0, 0.0, 1.0]
    moved = ImuReadings(shaken.t, shaken.w_ib_b + hand, shaken.f_b)
    return made, [replace(d, readings=moved) if d is dwells[1] else d for d in dwells]


@pytest.mark.parametrize(
    "method",
    ["six-position", "rk4", "triad", "single-gyro", "two-position", "multi-position"],
)
def test_a_stretch_that_is_refused_is_named_and_silences_no_other(one_shaken, method):
    made, dwells = one_shaken
    found, refused = evaluate_each(
        dwells, [Truths()] * len(dwells), made.site, made.options, [method]
    )
    (one,) = refused
    assert (one.method, one.stretch) == (method, "90")
    assert one.reason.startswith("90: ")
    labels = {s.estimate.label for s in found}
    assert labels >= {"0", "180"}
    assert "90" not in labels


def test_a_method_that_answers_for_no_stretch_gives_its_first_reason(one_shaken):
    made, dwells = one_shaken
    found, refused = evaluate_each(
        dwells[1:2], [Truths()], made.site, made.options, ["triad", "multi-position"]
    )
    assert found == []
    assert [r.who for r in refused] == ["triad", "multi-position"]
    assert refused[0].reason.startswith("90: ")
    assert refused[1].reason.startswith("too little turn")


def test_errors_to_truth_and_to_nominal_differ_by_what_the_table_did_wrong():
    """The table stood 0.3 deg off in yaw and 0.1 in pitch from what it was told."""
    told, stood, found = C(10, 20, 30), C(10, 20.3, 30.1), C(10.05, 20.5, 30.0)
    scored = score(estimate(found), Truths(stood, told))
    assert scored.error is not None
    assert scored.error_nominal is not None
    assert degrees(scored.error) == pytest.approx([0.05, 0.2, -0.1], abs=ROUNDING)
    assert degrees(scored.error_nominal) == pytest.approx([0.05, 0.5, 0.0], abs=ROUNDING)
    difference = degrees(scored.error_nominal - scored.error)
    assert difference == pytest.approx([0.0, 0.3, 0.1], abs=ROUNDING)


def test_errors_wrap_at_half_a_turn():
    scored = score(estimate(C(179.9, -179.8, 5)), Truths(C(-179.8, 179.9, 5)))
    assert scored.error is not None
    assert degrees(scored.error) == pytest.approx([-0.3, 0.3, 0.0], abs=1e-12)
    assert scored.heading_error == pytest.approx(-0.3 * DEG, abs=1e-14)


def test_heading_error_crosses_north():
    scored = score(estimate(C(0, 0.2, 0)), Truths(C(0, -0.1, 0)))  # headings 359.8 and 0.1
    assert scored.heading_error == pytest.approx(-0.3 * DEG, abs=1e-14)


def test_errors_are_read_by_the_estimates_own_sequence():
    """X1 up: by yaw-roll-pitch a turn about up is yaw alone, whatever the other sequence says."""
    scored = score(estimate(C(0, 2, 90, YRP), YRP), Truths(C(0, 0, 90, YRP)))
    assert scored.error is not None
    assert degrees(scored.error) == pytest.approx([0, 2, 0], abs=1e-12)
    assert scored.heading_error is None  # X1 points nowhere


def test_nothing_to_compare_gives_nothing():
    scored = score(estimate(C(1, 2, 3)), Truths())
    assert (scored.error, scored.error_nominal, scored.heading_error) == (None, None, None)
    pair = score(estimate(None, latitude=48.0 * DEG), Truths(C(0, 0, 0), None, 48.5 * DEG))
    assert pair.error is None
    assert pair.latitude_error == pytest.approx(-0.5 * DEG, rel=1e-12)


def test_spreads_by_hand():
    """Errors 1, 2, 6 deg: mean 3; n-1 deviation sqrt((4 + 1 + 9)/2), RMS sqrt((1 + 4 + 36)/3)."""
    (to_truth, to_nominal) = spreads(with_errors((1, 0, -1), (2, 0, -1), (6, 0, -1)))
    assert (to_truth.reference, to_nominal.reference) == ("truth", "nominal")
    assert degrees(to_truth.sigma) == pytest.approx([2.6457513110645907, 0, 0], abs=ROUNDING)
    assert degrees(to_truth.rms) == pytest.approx([3.6968455021364721, 0, 1], abs=ROUNDING)
    assert to_truth.count == 3


def test_spreads_keep_truth_and_nominal_apart():
    rows = spreads(with_errors((1, 0, 0), (3, 0, 0), nominal=[(2, 0, 0), (8, 0, 0)]))
    by_reference = {row.reference: row for row in rows}
    assert degrees(by_reference["truth"].rms)[0] == pytest.approx(5**0.5)
    assert degrees(by_reference["nominal"].rms)[0] == pytest.approx(34**0.5)


def test_spreads_are_per_method_and_window_and_need_two():
    scores = (
        with_errors((1, 0, 0), (2, 0, 0), method="six-position", window="same")
        + with_errors((5, 0, 0), method="six-position", window="fresh")
        + with_errors(None, None)
    )
    assert [key for key, _ in by_method(scores)] == [
        ("six-position", "same"),
        ("six-position", "fresh"),
        ("rk4", ""),
    ]
    found = [(s.method, s.window, s.reference) for s in spreads(scores)]
    assert found == [("six-position", "same", "truth"), ("six-position", "same", "nominal")]


def test_published_sigmas_are_as_printed():
    assert ESTIMATORS["six-position"].published_deg == (0.009105, 0.006733, 0.017117)
    assert ESTIMATORS["rk4"].published_deg == (0.213968, 0.222806, 0.385168)


def test_json_of_an_estimate():
    covariance = np.diag([1.0, 4.0, 9.0]) * DEG**2
    e = estimate(
        C(0, -30, 0),
        covariance=covariance,
        latitude=48.0 * DEG,
        latitude_sigma=0.25 * DEG,
        flags=("doubt",),
    )
    entry = score_to_json(score(e, Truths(C(0, -31, 0), C(0, -32, 0), 48.5 * DEG)))
    assert json.loads(json.dumps(entry, allow_nan=False)) == entry
    near = {
        "method": "rk4",
        "label": "P",
        "t_from_s": 1.0,
        "t_to_s": 3.0,
        "sequence": "yaw-pitch-roll",
        "heading_deg": pytest.approx(30.0),
        "roll_deg": pytest.approx(0.0, abs=ROUNDING),
        "yaw_deg": pytest.approx(-30.0),
        "pitch_deg": pytest.approx(0.0, abs=ROUNDING),
        "singular": False,
        "latitude_deg": pytest.approx(48.0),
        # level, 30 deg of heading: roll about X1 = c N + s E, pitch about Z1 = -s N + c E
        "sigma_roll_deg": pytest.approx((0.75 * 1 + 0.25 * 4) ** 0.5),
        "sigma_yaw_deg": pytest.approx(3.0),
        "sigma_pitch_deg": pytest.approx((0.25 * 1 + 0.75 * 4) ** 0.5),
        "sigma_heading_deg": pytest.approx(3.0),
        "sigma_latitude_deg": pytest.approx(0.25),
        "error_roll_deg": pytest.approx(0.0, abs=ROUNDING),
        "error_yaw_deg": pytest.approx(1.0),
        "error_pitch_deg": pytest.approx(0.0, abs=ROUNDING),
        "error_heading_deg": pytest.approx(-1.0),
        "error_latitude_deg": pytest.approx(-0.5),
        "error_nominal_roll_deg": pytest.approx(0.0, abs=ROUNDING),
        "error_nominal_yaw_deg": pytest.approx(2.0),
        "error_nominal_pitch_deg": pytest.approx(0.0, abs=ROUNDING),
        "undetermined": {},
        "noise_only": False,
        "flags": ["doubt"],
    }
    assert entry == near


def test_json_leaves_out_what_is_not_there():
    vertical = score_to_json(score(estimate(C(0, 5, 90, YRP), YRP, window="same"), Truths()))
    assert vertical["window"] == "same"
    assert vertical["heading_deg"] is None
    assert vertical["yaw_deg"] == pytest.approx(5.0)
    pair = score_to_json(score(estimate(None, latitude=0.5), Truths()))
    assert set(pair) == {
        "method",
        "label",
        "t_from_s",
        "t_to_s",
        "sequence",
        "heading_deg",
        "singular",
        "latitude_deg",
        "undetermined",
        "noise_only",
        "flags",
    }


def test_json_of_a_spread():
    row = spread_to_json(spreads(with_errors((1, 0, 0), (3, 2, 0)))[0])
    assert row == {
        "method": "rk4",
        "window": "",
        "reference": "truth",
        "positions": 2,
        "sigma_roll_deg": pytest.approx(2**0.5),
        "sigma_yaw_deg": pytest.approx(2**0.5),
        "sigma_pitch_deg": 0.0,
        "rms_roll_deg": pytest.approx(5**0.5),
        "rms_yaw_deg": pytest.approx(2**0.5),
        "rms_pitch_deg": 0.0,
    }


def test_biases_are_told_in_the_units_of_data_sheets():
    rad_s, m_s2 = DEG / 3600, 9.80665e-3  # 1 deg/h, 1 mg
    biases = np.array([1.0, -2.0, 3.0, 0.0, 0.0, 0.0]) * rad_s
    biases[3:] = np.array([4.0, 5.0, -6.0]) * m_s2
    told = score_to_json(
        score(estimate(C(0, 0, 0), biases=biases, bias_sigmas=np.abs(biases) / 2), Truths())
    )
    assert told["gyro_bias_deg_h"] == pytest.approx([1, -2, 3])
    assert told["accel_bias_mg"] == pytest.approx([4, 5, -6])
    assert told["gyro_sigma_bias_deg_h"] == pytest.approx([0.5, 1, 1.5])
    assert told["accel_sigma_bias_mg"] == pytest.approx([2, 2.5, 3])
    assert "gyro_bias_deg_h" not in score_to_json(score(estimate(C(0, 0, 0)), Truths()))
    # one fit of two positions has one row of biases
    several = [
        score(estimate(C(0, 0, 0), label=k, biases=biases, bias_sigmas=abs(biases) / 4), Truths())
        for k in ("A", "B")
    ]
    table = score_tables(several)[1]
    assert table.rows[0] == ("A, B", "gyro X1", "+1.00 ± 0.2", "deg/h")
    assert table.rows[5] == ("", "accel Z1", "-6.0 ± 2", "mg")
    assert len(table.rows) == 6
