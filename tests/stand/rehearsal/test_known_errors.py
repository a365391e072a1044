"""Errors of the table that a procedure sets: biases of the estimate, by hand and against runs."""

from dataclasses import replace

import numpy as np
import pytest
from procedures import document

from alignment import ESTIMATORS
from alignment.units import ARC_SECOND, DEG, DEG_PER_HOUR
from stand import toml_files as catalogue
from stand.imu import load_imu, without
from stand.imu.model import TERMS
from stand.motion.polynomial import MotionKind
from stand.procedure.procedure import procedure_from, table_of
from stand.rehearsal.rehearse import rehearse
from stand.rehearsal.result import Verdict
from stand.rehearsal.result_json import rehearsal_json
from stand.rehearsal.verify import errors_of, with_verification
from stand.report.rehearsal_tables import headline, tables
from stand.simulation.monte_carlo import Trials
from stand.simulation.settings import assembled
from stand.table.known_errors import KNOWN, Size, stated
from stand.table.table import load_table
from stand.table.table_errors import TableErrorsEntry

LAT = 48.5 * DEG
HALF_TURN = """
title = "Half a turn"
table = "precision"
[site]
latitude_deg = 48.5
[estimate]
methods = ["triad", "two-position"]
[require]
heading_deg = 0.1
{}
[[step]]
kind = "dwell"
label = "first"
duration_s = 296
[[step]]
kind = "move"
label = "half a turn"
joints_deg = {{ outer = 180 }}
[[step]]
kind = "dwell"
label = "second"
duration_s = 296
"""
ENCODER = "[table_errors]\ndrawn = {}\n[table_errors.axis.outer]\nencoder_once_arc_s = [300, 0]"


def asked(errors="", imu="hg9900", rate=20):
    source = catalogue.Source("case", "case.toml", HALF_TURN.format(errors))
    procedure = procedure_from(source)
    site = procedure.entry.site.site()
    return assembled(procedure, load_imu(imu), table_of(procedure), site, rate)


def predicted(errors=""):
    return {(p.method, p.label, p.quantity): p for p in rehearse(asked(errors)).predictions}


def parts(p):
    return {c.source: c.sigma for c in p.contributions}


@pytest.mark.parametrize("drawn", ["true", "false"])
def test_an_encoder_error_set_by_hand_is_a_bias(drawn):
    """300'' at 0 and -300'' at 180 deg: half of 600'' in heading, as [S4] has placements.

    The turn is 600'' short, of which two positions take half: (d180 - d0) / 2.
    """
    plain, wrong = predicted(), predicted(ENCODER.format(drawn))
    p = wrong["two-position", "first", "heading"]
    # a placement that is not quite known has a part of a per cent in the weights
    assert abs(p.bias) == pytest.approx(300 * ARC_SECOND, rel=5e-3)
    assert parts(p)[KNOWN] == abs(p.bias)
    assert p.rms == pytest.approx(np.hypot(p.sigma, p.bias), rel=1e-12)
    # what is drawn beside it is as it was, without the encoder of that axis (1'' of the class)
    before = plain["two-position", "first", "heading"]
    assert before.bias == 0.0
    assert p.sigma == pytest.approx(before.sigma, rel=2e-3)
    for label in ("first", "second"):  # one position by itself needs no table
        assert wrong["triad", label, "heading"].bias == pytest.approx(0.0, abs=1e-12)
    # half a turn that is 600'' short looks like a bias of Z1 of 300'' of the north rate, 0.0145
    # deg/h; the fit believes so much of it as its prior leaves beside the noise of both rests
    north = 15.041067 * DEG_PER_HOUR * np.cos(LAT)
    prior, noise = 0.0035, 0.002 / np.sqrt(592 / 3600)  # deg/h
    believed = prior**2 / (prior**2 + noise**2)
    bias = wrong["two-position", "all", "gyro bias Z1"].bias
    assert abs(bias) == pytest.approx(believed * 300 * ARC_SECOND * north, rel=0.02)


def test_runs_come_to_the_bias():
    """0.0880 deg: 300'' and 0.028 deg of noise; 24 runs know that to 0.028/0.088/sqrt(24)."""
    case = asked(ENCODER.format("true"))
    result = with_verification(rehearse(case), case, 24, workers=1)
    assert result.verification is not None
    key = ("two-position", "first", "heading")
    (one,) = [a for a in result.verification.achieved if (a.method, a.label, a.quantity) == key]
    assert one.predicted == pytest.approx(0.0880 * DEG, rel=5e-3)
    assert one.sigma == pytest.approx(one.predicted, rel=4 * 0.028 / 0.088 / np.sqrt(24))
    assert one.agrees
    assert result.verification.disagreeing == ()


def test_a_known_error_decides_the_verdict():
    """2 x 0.0880 deg where 0.1 is allowed, and 2 x 0.0284 without it (TRIAD is at 0.045 deg)."""
    text = HALF_TURN.replace('["triad", "two-position"]', '["two-position"]')
    source = catalogue.Source("case", "case.toml", text.format(ENCODER.format("true")))
    procedure = procedure_from(source)
    site = procedure.entry.site.site()
    result = rehearse(assembled(procedure, load_imu("hg9900"), table_of(procedure), site, 20))
    assert result.verdict is Verdict.FAIL
    (judged,) = result.judgements
    assert judged.expanded == pytest.approx(2 * 0.0880 * DEG, rel=5e-3)
    assert abs(judged.bias) == pytest.approx(300 * ARC_SECOND, rel=5e-3)
    made = rehearsal_json(result)
    row = next(p for p in made["predictions"] if p["quantity"] == "heading")
    assert abs(row["bias"]) == pytest.approx(300 / 3600, rel=5e-3)
    assert row["rms"] == pytest.approx(np.hypot(row["sigma"], row["bias"]))
    assert row["contributions"][KNOWN] == pytest.approx(abs(row["bias"]))
    assert made["judgements"][0]["rms_deg"] == pytest.approx(0.0880, rel=5e-3)
    text = "\n".join(" ".join(r) for t in tables(result) for r in t.rows)
    assert "0.0284 deg, bias -0.08" in text or "0.0284 deg, bias 0.08" in text
    assert headline(result).startswith("FAIL: ")


def test_what_is_set_and_what_is_drawn_as_sizes():
    """Every key by hand: a value of its own, or the class's sigma, or nothing."""
    table = load_table("mid-class")
    errors = table.entry.axis["outer"].errors
    geometry = table.entry.geometry
    i = 3  # outer
    left = stated(table, None)
    assert left.base()[0] == Size(sigma=geometry.base_tilt_arc_s * ARC_SECOND)
    assert left.base()[2] == Size(sigma=geometry.base_azimuth_arc_s * ARC_SECOND)
    assert left.placement(i) == Size(sigma=errors.placement_arc_s * ARC_SECOND)
    each = errors.encoder_arc_s * ARC_SECOND / np.sqrt(2)
    for size in (*left.encoder(i, 1), *left.encoder(i, 2)):
        assert size.sigma == pytest.approx(each, rel=1e-12)
        assert size.known == 0.0
    n, waves = left.ripple(i)
    assert n == errors.ripple_per_turn
    for wave in waves:  # r/n, shared by cosine and sine
        r = errors.rate_ripple_percent / 100
        assert wave.size.sigma == pytest.approx(r / n / np.sqrt(2), rel=1e-12)
    nothing = stated(table, TableErrorsEntry(drawn=False))
    assert nothing.base() == (Size(), Size(), Size())
    assert nothing.mounting() == (Size(), Size(), Size())
    assert nothing.placement(i) == nothing.non_orthogonality(i) == Size()
    assert nothing.encoder(i, 1) == nothing.encoder(i, 2) == (Size(), Size())
    assert [w.size for w in (*nothing.wobble(i), *nothing.ripple(i)[1])] == [Size(), Size()]
    own = {
        "placement_arc_s": 10.0,
        "encoder_twice_arc_s": (20.0, -30.0),
        "non_orthogonality_arc_s": 40.0,
        "wobble_arc_s": 50.0,
        "rate_ripple_percent": 6.0,
        "ripple_per_turn": 3,
    }
    set_values = TableErrorsEntry(
        base_tilt_arc_s=(1.0, 2.0),
        base_azimuth_arc_s=3.0,
        mounting_arc_s=(4.0, 5.0, 6.0),
        axis={"outer": own},
    )
    given = stated(table, set_values)
    assert [s.known / ARC_SECOND for s in given.base()] == pytest.approx([1, 2, 3])
    assert [s.known / ARC_SECOND for s in given.mounting()] == pytest.approx([4, 5, 6])
    assert given.placement(i).known == pytest.approx(10 * ARC_SECOND)
    assert given.encoder(i, 1) == left.encoder(i, 1)
    assert [s.known / ARC_SECOND for s in given.encoder(i, 2)] == pytest.approx([20, -30])
    assert given.non_orthogonality(i).known == pytest.approx(40 * ARC_SECOND)
    assert given.placement(4) == left.placement(4)  # of another axis
    # a size of which only the phase is drawn is nobody's bias: 50'' / sqrt 2 each way
    assert [w.size.sigma for w in given.wobble(i)] == pytest.approx([50 * ARC_SECOND / 2**0.5] * 2)
    assert [w.size.sigma for w in given.ripple(i)[1]] == pytest.approx([0.02 / 2**0.5] * 2)
    own |= {"wobble_phase_deg": 90.0, "ripple_phase_deg": 0.0}
    phased = stated(table, TableErrorsEntry(axis={"outer": own}))
    ((nod, c, s),) = phased.wobble(i)
    assert (nod.known, c, s) == pytest.approx((50 * ARC_SECOND, 0.0, 1.0), abs=1e-15)
    ((wave, c, s),) = phased.ripple(i)[1]
    assert (wave.known, c, s) == pytest.approx((-0.02, 1.0, 0.0))  # -(r/n) cos n q
    assert replace(phased, ideal=False).ripple(i) == (3, [])  # a servo has its own


def test_a_servo_has_no_stated_ripple():
    """The first is that of two cosines and sines: 10 % once round are 5.7 deg of angle."""
    lines = "[table_errors]\ndrawn = false\n[table_errors.axis.outer]\nrate_ripple_percent = 0.1\n"
    case = asked(lines + "ripple_per_turn = 1\n")
    with_it, servo = (
        {(p.method, p.label, p.quantity): p.bias for p in rehearse(one).predictions}
        for one in (case, replace(case, motion=MotionKind.SERVO))
    )
    key = ("two-position", "first", "heading")
    # -r at 0, r at 180 deg: the turn is off by 2 r, and half of it shows
    assert abs(with_it[key]) == pytest.approx(1e-3, rel=5e-3)
    assert servo[key] == 0.0


# --- against one run without noise

ALONE = {
    "base_tilt_arc_s": [200.0, -150.0],
    "base_azimuth_arc_s": 300.0,
    "mounting_arc_s": [100.0, -150.0, 200.0],
}
OF_AXIS = {
    "placement_arc_s": 120.0,
    "encoder_once_arc_s": [150.0, -100.0],
    "encoder_twice_arc_s": [80.0, 60.0],
    "non_orthogonality_arc_s": 90.0,
    "wobble_arc_s": 70.0,
    "rate_ripple_percent": 0.05,
}
PHASES = {"wobble_phase_deg": 30.0, "ripple_phase_deg": 40.0, "ripple_per_turn": 1}
TURNS = """
[[step]]
kind = "rate"
label = "round"
axis = "outer"
rate_deg_s = 20
turns = 1
directions = "both"
"""
STEPS = {
    "carousel": TURNS,
    "six-position": HALF_TURN[HALF_TURN.index("[[step]]") :].replace("296", "24").format(),
}


@pytest.mark.parametrize("method", STEPS)
@pytest.mark.parametrize("key", [*ALONE, *OF_AXIS])
def test_one_run_without_noise_comes_to_the_bias(method, key):
    """Of first order: 200'' squared are 0.2''; a hundred-thousandth of the noise is below 0.02''.

    The unit's lag is none, and its interval means take 0.1'' of a turn at 20 deg/s.
    """
    unit = load_imu("hg9900")
    unit = without(unit, [term for term in TERMS if term != "white-noise"])
    quiet = (replace(triad, noise=1e-5 * triad.noise) for triad in (unit.gyro, unit.accel))
    unit = replace(unit, **dict(zip(("gyro", "accel"), quiet, strict=True)))
    errors = (
        {key: ALONE[key]} if key in ALONE else {"axis": {"outer": {key: OF_AXIS[key]} | PHASES}}
    )
    data = {
        "title": "One error",
        "table": "precision",
        "site": {"latitude_deg": 48.5},
        "estimate": {"methods": [method]},
        "table_errors": {"drawn": False} | errors,
    }
    text = document(data) + STEPS[method]
    procedure = procedure_from(catalogue.Source("case", "case.toml", text))
    table, site = table_of(procedure), procedure.entry.site.site()
    case = assembled(procedure, unit, table, site, 20)
    dwells, attitudes = Trials(case).readings(0)
    truths = {d.label: C for d, C in zip(dwells, attitudes, strict=True)}
    estimates = ESTIMATORS[method].estimate(dwells, site, case.options)
    came_to = {
        k: error
        for e in estimates
        for k, error in errors_of(e, truths[e.label], np.zeros(6)).items()
    }
    predictions = [p for p in rehearse(case).predictions if p.unit == "deg" and p.determined]
    assert predictions
    for p in predictions:
        error = came_to[p.method, p.window, p.label, p.quantity]
        assert p.bias / ARC_SECOND == pytest.approx(error / ARC_SECOND, abs=0.4), p
    biased = max(abs(p.bias) for p in predictions) > 10 * ARC_SECOND
    # a carousel finds where it is by itself: what moves the whole stand moves its truth as well
    assert biased == (method != "carousel" or key not in (*list(ALONE)[:2], "placement_arc_s"))
