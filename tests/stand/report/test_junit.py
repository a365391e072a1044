"""A rehearsal as JUnit XML: cases, verdicts, and text that XML cannot hold."""

from dataclasses import replace
from xml.etree.ElementTree import fromstring

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rehearsed import answer, infeasible, verified

from stand.rehearsal.result import Finding, Severity, Verdict
from stand.report.junit import junit


def cases(result):
    root = fromstring(junit(result).partition("\n")[2])
    return root, {case.get("name"): case for case in root.iter("testcase")}


def test_a_case_per_requirement_and_per_step():
    root, found = cases(answer(Verdict.PASS))
    assert list(found) == [
        "heading 0.2°",
        "pitch 0.01°",
        "step 1 dwell first",
        "step 2 move half a turn",
        "step 3 dwell second",
    ]
    assert [suite.get("name") for suite in root] == [
        "two-position.requirements",
        "two-position.steps",
    ]
    assert (root.get("tests"), root.get("failures")) == ("5", "0")
    assert root.findall(".//failure") == []
    # two sigma of sqrt(0.0332^2 + 0.0281^2 + 0.0014^2 + 0.0083^2 + 0.0121^2) = 0.0459 deg
    assert "predicted 0.0919°" in found["heading 0.2°"].findtext("system-out")


@pytest.mark.parametrize(
    ("verdict", "name"), [(Verdict.FAIL, "heading 0.05°"), (Verdict.INDETERMINATE, "heading 0.09°")]
)
def test_what_is_not_met_and_what_nobody_can_say_are_failures(verdict, name):
    _, found = cases(answer(verdict))
    failure = found[name].find("failure")
    assert failure.get("type") == verdict.value
    assert failure.get("message").startswith(f"{verdict.value}: heading within")
    assert found["pitch 0.01°"].find("failure") is None
    assert found[name].find("skipped") is None


def test_a_step_beyond_a_limit_fails_with_its_first_moment():
    root, found = cases(infeasible())
    failure = found["step 2 move half a turn"].find("failure")
    assert failure.get("type") == "infeasible"
    # 320/300 = 107 %; only what is broken is in the message
    assert failure.get("message") == (
        "outer rate 320 of 300 deg/s (107 %), first beyond it at 296.750 s"
    )
    assert "outer torque 12.5 of 100 N m" in failure.text
    assert (root.get("tests"), root.get("failures")) == ("5", "1")


def test_a_finding_that_forbids_the_run_is_a_failure():
    trap = Finding(Severity.ERROR, "sensor range", "first", "the gyro ends at 400 deg/s")
    doubt = Finding(Severity.WARNING, "settling", "first", "no settling time is known")
    root, found = cases(replace(answer(Verdict.PASS), findings=(trap, doubt)))
    assert root.get("failures") == "1"
    assert found["1 sensor range first"].find("failure").get("message") == trap.text


def test_the_inputs_are_properties():
    root, _ = cases(answer())
    known = {p.get("name"): p.get("value") for p in root.find("testsuite").iter("property")}
    assert known["imu"] == "stim300"
    assert known["sha256 procedure"] == "ab" * 32


def test_a_case_per_prediction_that_runs_were_set_beside():
    root, found = cases(verified())
    suite = root.findall("testsuite")[-1]
    assert suite.get("name") == "two-position.verification"
    assert [case.get("name") for case in suite.iter("testcase")] == [
        "triad heading first",
        "triad heading second",
        "two-position heading first",
        "two-position pitch first",
        "two-position gyro bias X1 all",
    ]  # of roll nothing is predicted
    assert (suite.get("tests"), suite.get("failures"), suite.get("time")) == ("5", "0", "16.000")
    # with two requirements and three steps
    assert (root.get("tests"), root.get("failures"), root.get("time")) == ("10", "0", "16.000")
    # 0.04593 / 0.96 = 0.04784, over 1.07 and 0.93
    assert found["two-position heading first"].findtext("system-out") == (
        "predicted 0.0459 deg, achieved 0.0478 (0.0447 to 0.0514) deg in 400 runs; "
        "ratio 0.96 (0.89 to 1.03) agrees"
    )
    assert suite.findtext("system-out") == (
        "two-position gave no answer in 3 of 400 runs: not at rest: it turns at 0.2 deg/s"
    )
    known = {p.get("name"): p.get("value") for p in suite.iter("property")}
    assert (known["runs"], known["runs asked"], known["seed"]) == ("400", "400", "7")
    assert known["imu"] == "stim300"


def test_a_prediction_that_runs_contradict_is_a_failure():
    root, found = cases(verified(heading=0.7))
    failure = found["two-position heading first"].find("failure")
    assert failure.get("type") == "contradicted"
    assert "ratio 0.70 (0.65 to 0.75) misses 0.9 to 1.1" in failure.get("message")
    assert root.findall("testsuite")[-1].get("failures") == "1"
    # the verdict is said first, and is a failure beside that of the prediction
    suite, case = root[0], root[0].find("testcase")
    assert (suite.get("name"), case.get("name")) == ("two-position.verdict", "verdict")
    assert case.find("failure").get("type") == "CONTRADICTED"
    assert "contradict 1 of 5 predictions: two-position" in case.find("failure").get("message")
    assert root.get("failures") == "2"


@given(st.text())
def test_any_text_is_xml(text):
    told = replace(answer(Verdict.FAIL).judgements[0], reason=text, label=text)
    root, found = cases(replace(answer(Verdict.FAIL), judgements=(told,)))
    assert root.get("failures") == "2"  # and the broken step
    assert found["heading 0.05°"].find("failure") is not None
