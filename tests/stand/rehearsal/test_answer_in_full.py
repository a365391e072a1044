"""Every number of an answer where machines and people read it: all of the JSON, whole sentences.

No two numbers are alike, so that none can stand in another's place.
"""

import json
from dataclasses import replace
from math import inf, nan, pi, radians, sqrt

import numpy as np
import pytest

from stand.procedure.procedure import RequireEntry
from stand.rehearsal import verify
from stand.rehearsal.requirement import judge
from stand.rehearsal.result import (
    Advice,
    Change,
    Contribution,
    Duration,
    Finding,
    Inputs,
    Judgement,
    Margin,
    Observability,
    Prediction,
    Rehearsal,
    Severity,
    StepDuration,
    StepFeasibility,
    Verdict,
)
from stand.rehearsal.result_json import rehearsal_json
from stand.rehearsal.rocking_allowed import AdmissibleRocking
from stand.rehearsal.sums import RunErrors, Sums, run_from_json, run_to_json
from stand.rehearsal.traps import from_margins
from stand.rehearsal.verification import Achieved, Refused, Verification
from stand.rehearsal.verify import with_verification
from stand.simulation.settings import settings

DEG = pi / 180
DEG_H = DEG / 3600
ROCKING = AdmissibleRocking(
    "two-gyro", "rocked", 0.5 * DEG, 2 * DEG, 0.2, 0.03 * DEG, 0.1 * DEG,
    np.array([0.1, 5.0]), np.array([0.25, 0.75]) * DEG,
)  # fmt: skip
PREDICTION = Prediction(
    "triad", "fresh", "first", "gyro bias X1", "deg/h", DEG_H, 4 * DEG_H,
    (Contribution("noise", 4 * DEG_H), Contribution("set", 3 * DEG_H)), bias=-3 * DEG_H,
    noise_only=True,
)  # fmt: skip
NONE = Prediction("triad", "", "second", "roll", "deg", DEG, None, (), "it rocks", beyond=1.0)
JUDGED = Judgement(
    "pitch", "fine", "third", 5 * DEG, 2.0, 0.3 * DEG, 0.15, Verdict.INDETERMINATE, "who knows",
    bias=0.4 * DEG, noise_only=True,
)  # fmt: skip
CONSTANT = Judgement(
    "gyro bias", "calibration", "all", 10 * DEG_H, 3.0, None, 0.1, Verdict.FAIL,
    unit="deg/h", per=DEG_H,
)  # fmt: skip
COMPARED = Achieved(
    "triad", "fresh", "first", "pitch", "deg", DEG, 1.25 * DEG, 40, 1.0 * DEG, 0.8 * DEG,
    1.5625 * DEG, noise_only=True,
)  # fmt: skip


def answered() -> Rehearsal:
    margin = Margin("rate", "outer", 320.0, 300.0, "deg/s", 320 / 300, 7.5, 6.25)
    endless = Margin("angle", "inner", 12.0, inf, "deg", 0.0, None)
    steps = (
        StepFeasibility(3, "move", "go", 6.0, 9.0, (margin, endless), None, {"outer": -2.5}),
        StepFeasibility(4, "dwell", "stay", 9.0, 30.0, (), 1.5, {}),
    )
    times = (
        StepDuration(3, "move", "go", 6.0, 9.0, 2.25, 0.75, 0.0),
        StepDuration(4, "dwell", "stay", 9.0, 30.0, 0.5, 1.5, 19.0),
    )
    inputs = Inputs(
        "p", "P's title", "p = 1", "i", "I's title", "i = 1", "t", "T's title", "t = 1",
        48.5, 120.0, 50, "C", {"procedure": "ab"}, {"numpy_version": "2"},
    )  # fmt: skip
    advice = Advice(
        "pitch", "rest longer", (Change("step 1", "2", "3"),), 0.6 * DEG, 77.0, "t = 2", True
    )
    none = Advice("roll", "nothing helps", (), None, None)
    silent = Refused("fine", 41, "no", predicted=True)
    beside = Verification(
        60, 50, 9, 12.5, (COMPARED,), (silent, Refused("inertial", 4, "why", stretch="second"))
    )
    return Rehearsal(
        inputs, steps, Duration(times), (PREDICTION, NONE),
        (Observability("triad", 5, 9, inf, ("a", "b")),), (JUDGED, CONSTANT), (advice, none),
        (Finding(Severity.WARNING, "pole", "first", "cold"),), beside, (ROCKING,),
    )  # fmt: skip


ANSWER = {
    "verdict": "CONTRADICTED",
    "feasible": False,
    "accurate": False,
    "inputs": {
        "procedure": {"id": "p", "title": "P's title"},
        "imu": {"id": "i", "title": "I's title"},
        "table": {"id": "t", "title": "T's title"},
        "latitude_deg": 48.5,
        "height_m": 120.0,
        "rate_hz": 50,
        "revision": "C",
        "sha256": {"procedure": "ab"},
        "versions": {"numpy_version": "2"},
    },
    "judgements": [
        {
            "quantity": "pitch",
            "verdict": "INDETERMINATE",
            "method": "fine",
            "label": "third",
            "required_deg": 5.0,
            "sigma_deg": 0.3,
            "bias_deg": 0.4,
            "rms_deg": 0.5,
            "expanded_deg": 1.0,
            "noise_only": True,
            "coverage": 2.0,
            "guard": 0.15,
            "reason": "who knows",
        },
        {
            "quantity": "gyro bias",
            "verdict": "FAIL",
            "method": "calibration",
            "label": "all",
            "unit": "deg/h",
            "required": 10.0,
            "sigma": None,
            "bias": 0.0,
            "rms": None,
            "expanded": None,
            "noise_only": False,
            "coverage": 3.0,
            "guard": 0.1,
            "reason": "",
        },
    ],
    "admissible_rocking": [
        {
            "method": "two-gyro",
            "stretch": "rocked",
            "heading_sigma_deg": 0.5,
            "planned_rms_deg": 2.0,
            "frequency_hz": 0.2,
            "admissible_rms_deg": 0.03,
            "sensors_alone_deg": 0.1,
            "chart": {"frequency_hz": [0.1, 5.0], "admissible_rms_deg": [0.25, 0.75]},
        }
    ],
    "findings": [{"severity": "warning", "kind": "pole", "step": "first", "text": "cold"}],
    "feasibility": [
        {
            "step": 3,
            "kind": "move",
            "label": "go",
            "t_from_s": 6.0,
            "t_to_s": 9.0,
            "feasible": False,
            "settling_s": None,
            "turns": {"outer": -2.5},
            "margins": [
                {
                    "quantity": "rate",
                    "axis": "outer",
                    "value": 320.0,
                    "limit": 300.0,
                    "unit": "deg/s",
                    "used": 320 / 300,
                    "t_s": 7.5,
                    "first_violation_s": 6.25,
                },
                {
                    "quantity": "angle",
                    "axis": "inner",
                    "value": 12.0,
                    "limit": None,
                    "unit": "deg",
                    "used": 0.0,
                    "t_s": None,
                    "first_violation_s": None,
                },
            ],
        },
        {
            "step": 4,
            "kind": "dwell",
            "label": "stay",
            "t_from_s": 9.0,
            "t_to_s": 30.0,
            "feasible": True,
            "settling_s": 1.5,
            "turns": {},
            "margins": [],
        },
    ],
    "duration": {
        "motion_s": 2.75,
        "settling_s": 2.25,
        "dwell_s": 19.0,
        "total_s": 30.0,
        "steps": [
            {
                "step": 3,
                "kind": "move",
                "label": "go",
                "t_from_s": 6.0,
                "t_to_s": 9.0,
                "motion_s": 2.25,
                "settling_s": 0.75,
                "dwell_s": 0.0,
            },
            {
                "step": 4,
                "kind": "dwell",
                "label": "stay",
                "t_from_s": 9.0,
                "t_to_s": 30.0,
                "motion_s": 0.5,
                "settling_s": 1.5,
                "dwell_s": 19.0,
            },
        ],
    },
    "predictions": [
        {
            "method": "triad",
            "window": "fresh",
            "label": "first",
            "quantity": "gyro bias X1",
            "unit": "deg/h",
            "sigma": 4.0,
            "bias": -3.0,
            "rms": 5.0,
            "noise_only": True,
            "contributions": {"noise": 4.0, "set": 3.0},
            "reason": "",
        },
        {
            "method": "triad",
            "window": "",
            "label": "second",
            "quantity": "roll",
            "unit": "deg",
            "sigma": None,
            "bias": None,
            "rms": None,
            "noise_only": False,
            "contributions": {},
            "reason": "it rocks",
        },
    ],
    "observability": [
        {"method": "triad", "rank": 5, "sought": 9, "condition": None, "unseen": ["a", "b"]}
    ],
    "advice": [
        {
            "quantity": "pitch",
            "helps": True,
            "text": "rest longer",
            "changes": [{"where": "step 1", "before": "2", "after": "3"}],
            "sigma_deg": 0.6,
            "noise_only": True,
            "duration_s": 77.0,
            "procedure_toml": "t = 2",
        },
        {
            "quantity": "roll",
            "helps": False,
            "text": "nothing helps",
            "changes": [],
            "sigma_deg": None,
            "noise_only": False,
            "duration_s": None,
            "procedure_toml": "",
        },
    ],
    "verification": {
        "runs_asked": 60,
        "runs": 50,
        "contradicted": 0,
        "missed_by_plain_intervals": 0,
        "seed": 9,
        "seconds": 12.5,
        "achieved": [
            {
                "method": "triad",
                "window": "fresh",
                "label": "first",
                "quantity": "pitch",
                "unit": "deg",
                "runs": 40,
                "predicted": 1.25,
                "noise_only": True,
                "sigma": 1.0,
                "low": 0.8,
                "high": 1.5625,
                "ratio": 1.25,
                "ratio_low": 0.8,
                "ratio_high": 1.5625,
                "ratio_low_of_all": 0.8,
                "ratio_high_of_all": 1.5625,
                "agrees": True,
                "agrees_alone": True,
            }
        ],
        "refused": [
            {"method": "fine", "stretch": "", "runs": 41, "reason": "no", "contradicts": True},
            {
                "method": "inertial",
                "stretch": "second",
                "runs": 4,
                "reason": "why",
                "contradicts": False,
            },
        ],
    },
}


def same(found, expected, where="") -> None:
    """Numbers to rounding, all else as it is; and JSON has it all."""
    if isinstance(expected, dict):
        assert set(found) == set(expected), where
        for key, value in expected.items():
            same(found[key], value, f"{where}.{key}")
    elif isinstance(expected, list):
        assert len(found) == len(expected), where
        for k, value in enumerate(expected):
            same(found[k], value, f"{where}[{k}]")
    elif isinstance(expected, float):
        assert found == pytest.approx(expected, rel=1e-12), where
    else:
        assert found == expected, where


def test_all_of_an_answer_for_machines():
    found = rehearsal_json(answered())
    same(found, ANSWER)
    same(json.loads(json.dumps(found, allow_nan=False)), ANSWER)


def test_what_there_is_none_of_is_null():
    made = replace(ROCKING, rms=inf, sensors=inf)
    found = rehearsal_json(replace(answered(), verification=None, rocking=(made,)))
    (rocking,) = found["admissible_rocking"]
    assert (rocking["admissible_rms_deg"], rocking["sensors_alone_deg"]) == (None, None)
    assert (found["verification"], found["verdict"]) == (None, "FAIL")


# --- sentences


@pytest.mark.parametrize(
    ("rms", "sentence"),
    [
        (0.03, "rocking of up to 0.03 deg rms at 0.2 Hz for a heading sigma of 0.5 deg; planned "
               "are 2 deg"),
        (0.0, "no rocking for a heading sigma of 0.5 deg: the sensors alone leave 0.1 deg"),
        (inf, "ten times the planned 2 deg rms for a heading sigma of 0.5 deg"),
    ],
)  # fmt: skip
def test_what_rocking_is_admitted(rms, sentence):
    assert replace(ROCKING, rms=rms * DEG).text == f"two-gyro: {sentence}"


@pytest.mark.parametrize(
    ("quantity", "axis", "value", "unit", "sentence"),
    [
        ("rate", "outer", -320.0, "deg/s",
         "outer: rate 320 deg/s, the table allows 300 deg/s (from 6.250 s)"),
        ("sensor rate", "gyro Y1", -320.0, "deg/s",
         "gyro Y1 would feel 320 deg/s, its range is 300 deg/s (from 6.250 s)"),
        ("sensor force", "accelerometer Z1", 320.0, "g",
         "accelerometer Z1 would feel 320 g, its range is 300 g (from 6.250 s)"),
        ("filter", "", 320.0, "s",
         "lasts 300 s, needs 320 s: is over before the unit's low-pass has settled"),
        ("settling", "", 320.0, "s",
         "lasts 300 s, needs 320 s: is over before the table has settled"),
        ("sampling", "", 320.0, "s",
         "lasts 300 s, needs 320 s: is too short for its sample rate"),
    ],
)  # fmt: skip
def test_limits_that_are_broken(quantity, axis, value, unit, sentence):
    broken = Margin(quantity, axis, value, 300.0, unit, 320 / 300, 7.5, 6.25)
    kept = replace(broken, first_violation=None)
    step = StepFeasibility(3, "move", "go", 6.0, 9.0, (kept, broken), None, {})
    (found,) = from_margins([step])
    assert found == Finding(Severity.ERROR, quantity, "go", f'step 3 "go": {sentence}')


def test_what_runs_contradict_is_told(monkeypatch):
    """4 and a known 3 make 5, and 40 runs come to 1: chi-square of 40 at 2.5 and 97.5 % is 24.433
    and 59.342 (tables), so 5 sqrt(24.433/40) to 5 sqrt(59.342/40)."""
    result = replace(answered(), feasibility=(), verification=None, findings=())
    key = ("triad", "fresh", "first", "gyro bias X1")

    def runs(*_, **__):
        yield from (RunErrors({key: sign * DEG_H}, {}) for sign in (1.0, -1.0) * 20)

    monkeypatch.setattr(verify, "errors_of_runs", runs)
    found = with_verification(result, settings("static", "hg9900"), 40)
    assert [f.text for f in found.findings] == [
        "triad fresh at first: gyro bias X1 was predicted 5.00 (3.91 to 6.09) of what 40 runs "
        "came to"
    ]
    assert [f.step for f in found.findings] == ["first"]


def test_a_constant_that_no_unit_could_keep():
    """Twice a floor of 6 deg/h is 12, against 10; of the axes the worst counts."""
    rows = [replace(PREDICTION, method="calibration", bias=0.0, sigma=20 * DEG_H)]
    floors = {"calibration": lambda: {"gyro bias X1": 4 * DEG_H, "gyro bias Y1": 6 * DEG_H}}
    require = RequireEntry(gyro_bias_deg_h=10.0)
    limits = {"gyro bias": 10 * DEG_H}
    (found,) = judge(require, limits, ["calibration"], rows, floors)
    assert (found.unit, found.per, found.refused) == ("deg/h", pytest.approx(DEG_H), True)
    assert found.reason == (
        "seat, table and gravity alone leave 12 deg/h (k = 2): no unit and no longer test on this "
        "table keeps 10"
    )
    (open_one,) = judge(require, limits, ["triad"], [NONE])
    assert (open_one.unit, open_one.per) == ("deg/h", pytest.approx(DEG_H))
    assert (open_one.required, open_one.coverage, open_one.guard) == (10 * DEG_H, 2.0, 0.1)
    (angle,) = judge(require, {"roll": radians(2)}, ["triad"], [NONE])
    assert (angle.unit, angle.per, angle.beyond, angle.reason) == ("deg", DEG, 1.0, "it rocks")


# --- runs as they are kept


def test_runs_and_their_sums_as_they_are_kept():
    """Of two and three: 5, 13 and 97; the second is told no number, and one that is none is out."""
    key, other = ("triad", "", "a", "heading"), ("fine", "w", "b", "roll")
    first = RunErrors({key: 2.0, other: nan}, {("two-gyro", "b"): "no", ("rk4", ""): "not"})
    second = RunErrors({key: 3.0}, {("two-gyro", "b"): "never"}, frozenset({key}))
    assert run_to_json(second) == {
        "errors": [["triad", "", "a", "heading", 3.0]],
        "refusals": [["two-gyro", "b", "never"]],
        "untold": [["triad", "", "a", "heading"]],
    }
    assert run_from_json(json.loads(json.dumps(run_to_json(second)))) == second
    sums = Sums()
    for run in (first, second):
        sums.add(run)
    kept = {
        "runs": 2,
        "of": [["triad", "", "a", "heading", 2.0, 5.0, 13.0, 97.0, 1.0]],
        "refused": [["two-gyro", "b", 2, "no"], ["rk4", "", 1, "not"]],
    }
    assert sums.to_json() == kept
    again = Sums.from_json(json.loads(json.dumps(kept)))
    assert again.to_json() == kept
    for one in (sums, again):
        assert (list(one), key in one, other in one) == ([key], True, False)
        refused = Refused("two-gyro", 2, "no", stretch="b"), Refused("rk4", 1, "not")
        assert one.refused() == refused
        n, (sigma, *_) = one.sigma(key)
        assert (n, sigma, one.freedom(key)) == (2, pytest.approx(sqrt(6.5)), 2.0)
    # what no run tells a number of is none of those that are compared
    alone = Sums()
    alone.add(second)
    assert (list(alone), key in alone) == ([], False)
