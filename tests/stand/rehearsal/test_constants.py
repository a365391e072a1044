"""Rehearsal of calibrations: what is predicted, required, refused, and what cannot be told."""

import re
from dataclasses import replace

import numpy as np
import pytest

import stand
from alignment import Site
from alignment.calibration.bench import USUAL, Bench, freed
from alignment.calibration.design import Design
from alignment.calibration.model import Model
from alignment.calibration.words import untold
from alignment.units import DEG
from stand.procedure.procedure import procedure_from
from stand.rehearsal.constants import planned_session
from stand.rehearsal.rehearse import prepared, rehearse
from stand.rehearsal.result import Verdict
from stand.simulation.settings import assembled, with_procedure
from stand.toml_files import Source

RATE = 50


def made(name, imu="stim300", table=None):
    return stand.settings(name, imu=imu, table=table, rate_hz=RATE)


def with_text(settings, old, new):
    text = settings.procedure.text
    assert old in text
    return with_procedure(
        settings, procedure_from(Source("mine", "mine.toml", text.replace(old, new)))
    )


def sigmas(settings):
    found = stand.rehearse(settings).predictions
    return {p.quantity: p.sigma / p.per for p in found if p.determined}


def test_a_full_calibration_reaches_what_the_methods_say():
    """methods.md section 7: stim300 on a mid-class table, hg9900 on a precision one."""
    found = sigmas(made("calibration-full", "stim300", "mid-class"))
    assert found["gyro bias X1"] == pytest.approx(0.5, abs=0.05)  # deg/h
    assert found["gyro scale X1"] < 2.5  # ppm
    assert found["accel bias X1"] < 8.7  # ug
    assert found["accel scale X1"] < 3.5  # ppm
    assert found["gyro misalignment X1 toward Y1"] == pytest.approx(30, abs=1)  # the seat's
    assert max(v for k, v in found.items() if k.startswith("gyro to accel")) < 0.65
    found = sigmas(made("calibration-full", "hg9900"))
    assert found["gyro bias X1"] < 0.0021
    assert found["gyro scale X1"] < 0.028
    assert found["accel bias X1"] < 1.5
    assert found["accel scale X1"] < 2.3


def unseen(name):
    (observed,) = stand.rehearse(made(name)).observability
    return observed.unseen


def test_faces_do_not_tell_cubic_from_scale_nor_quadratic_from_asymmetry():
    for name in ("tumble-6", "tumble-24"):
        told = " / ".join(unseen(name))
        assert (
            "accelerometer cubic term (X1, Y1, Z1): cannot be told from accelerometer scale" in told
        )
        assert (
            "accelerometer quadratic term (X1, Y1, Z1): cannot be told from accelerometer asym"
            in told
        )


def test_turns_about_the_vertical_show_no_lag_of_accelerometers_and_spins_do():
    assert any(line.startswith("accelerometer lag: no reading") for line in unseen("rate-steps"))
    assert not any(line.startswith("accelerometer lag") for line in unseen("spins"))


@pytest.mark.slow
def test_whole_turns_see_three_of_nine_lever_arms():
    for name in ("rate-steps", "spins", "calibration-full"):
        (line,) = [line for line in unseen(name) if line.startswith("accelerometer lever arms")]
        assert line.count(" along ") == 6
        assert "X1 along X1" not in line


def test_rests_alone_show_no_gyro_scale_and_moves_do():
    settings = made("tumble-24")
    bench = settings.options.bench
    assert isinstance(bench, Bench)
    session = planned_session(prepared(settings))
    designs = [
        Design(Model([one], freed(bench, list(USUAL)), settings.site))
        for one in (session, replace(session, moves=()))
    ]
    whole, alone = (" / ".join(untold(design)) for design in designs)
    for term in ("gyro scale factor", "gyro misalignment", "gyro non-orthogonality"):
        assert f"{term}: no reading" in alone
        assert term + ":" not in whole


def test_what_no_sheet_states_is_told_by_the_readings_and_not_by_a_guess():
    """Six faces of 60 s: half a difference of 0.07 deg/rt-h, 4.2/sqrt(60)/sqrt(2) = 0.383 deg/h/g.

    Looked for within 1 deg/h/g: sigma 1/sqrt(1/0.383^2 + 1) = 0.358; of a unit that has none the
    fit errs by 0.383/(1 + 0.383^2) = 0.334. Moves, which say a little too, take 2 % of either.
    """
    asked = REQUIRE.format("g_sensitivity_deg_h_g = 2")
    answer = rehearse(with_text(made("tumble-6", "ln200s"), "[estimate]\n", asked))
    (judged,) = answer.judgements
    assert judged.verdict is Verdict.PASS
    found = [p for p in answer.predictions if "g sensitivity" in p.quantity]
    assert len(found) == 9
    for p in found:
        assert p.sigma / p.per == pytest.approx(0.358, rel=0.03)
        assert p.drawn / p.per == pytest.approx(0.334, rel=0.03)
    # 0.6 deg/rt-h: 3.3 deg/h/g by the readings, nearly all of 1 deg/h/g is left of the guess
    answer = rehearse(with_text(made("tumble-6", "mpu9250"), "[estimate]\n", asked))
    (judged,) = answer.judgements
    assert judged.verdict is Verdict.FAIL
    assert judged.sigma is None
    told = re.fullmatch(
        r"not determined: no sheet states its size, and the readings hardly tell it \(of ([\d.]+) "
        r"deg/h/g, ([\d.]+) are by the size assumed\)",
        judged.reason,
    )
    assert told
    # 1/sqrt(1/3.3^2 + 1) = 0.957, of which the guess leaves 3.3^2/(1 + 3.3^2) = 0.916
    assert (float(told[1]), float(told[2])) == pytest.approx((0.957, 0.916), rel=0.03)
    assert {p.sigma for p in answer.predictions if "g sensitivity" in p.quantity} == {None}


def test_runs_do_not_contradict_what_no_sheet_states():
    asked = REQUIRE.format("g_sensitivity_deg_h_g = 2")
    settings = replace(made("tumble-6", "ln200s"), rate_hz=10)
    answer = stand.rehearse(with_text(settings, "[estimate]\n", asked), verify=10)
    assert answer.verification is not None
    assert answer.verification.disagreeing == ()
    told = [a.ratio[0] for a in answer.verification.achieved if "g sensitivity" in a.quantity]
    # nine of ten runs each: one sigma of their mean square is 2/sqrt(180) = 15 %, 7 % of the root
    assert np.sqrt(np.mean(np.square(told) ** -1.0)) == pytest.approx(1, abs=0.2)


REQUIRE = "[require]\n{0}\n\n[estimate]\n"


def required(text):
    return stand.rehearse(with_text(made("tumble-6"), "[estimate]\n", REQUIRE.format(text)))


def test_a_requirement_of_a_constant_counts_its_worst_axis():
    result = required("gyro_bias_deg_h = 2\naccel_scale_ppm = 15")
    assert [j.verdict for j in result.judgements] == [Verdict.PASS, Verdict.PASS]
    bias = result.judgements[0]
    worst = max(p.sigma for p in result.predictions if p.quantity.startswith("gyro bias "))
    assert bias.sigma == worst
    assert bias.unit == "deg/h"


@pytest.mark.slow
def test_what_would_do_is_said():
    result = required("accel_bias_ug = 20\ncoverage = 2")
    (judged,) = result.judgements
    assert judged.verdict is Verdict.FAIL
    assert any("accel bias" in a.text for a in result.advice)


def test_a_requirement_below_the_floor_of_seat_and_table_is_refused():
    result = required("misalignment_arc_s = 8")
    (judged,) = result.judgements
    assert judged.verdict is Verdict.FAIL
    assert judged.refused
    # the seat of 5'' alone, k = 2
    assert "seat, table and gravity alone leave 10" in judged.reason
    assert result.advice == ()


def test_an_error_that_the_procedure_sets_is_a_bias():
    errors = "[table_errors]\ndrawn = false\nmounting_arc_s = [0, 0, 20]\n\n[estimate]\n"
    settings = with_text(made("tumble-6"), "[estimate]\n", errors)
    found = {p.quantity: p for p in stand.rehearse(settings).predictions}
    told = found["accel misalignment X1 toward Y1"]
    # a seat turned by 20'' about Z1: X1 feels Y1 by it, and nobody can tell
    assert abs(told.bias) / told.per == pytest.approx(20, abs=0.5)


def test_gravity_that_nobody_measured_is_a_row_of_the_budget():
    settings = made("tumble-6")
    settings = assembled(settings.procedure, settings.imu, site=Site(48.5 * DEG), rate_hz=RATE)
    found = {p.quantity: p for p in stand.rehearse(settings).predictions}
    rows = {c.source: c.sigma / 1e-6 for c in found["accel scale X1"].contributions}
    assert rows["gravity"] == pytest.approx(3e-4 / 9.809 * 1e6, rel=0.1)  # 30 mGal: 30.6 ppm


@pytest.mark.slow
def test_runs_agree_with_what_is_predicted():
    answer = stand.rehearse(made("tumble-6", "stim300", "mid-class"), verify=24)
    assert answer.verification is not None
    assert answer.verification.disagreeing == ()
    assert answer.verification.refused == ()
    ratios = [a.ratio[0] for a in answer.verification.achieved if a.ratio]
    assert len(ratios) > 35
    assert np.median(ratios) == pytest.approx(1, abs=0.15)
