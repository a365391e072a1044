"""`stand check-table`: every rule just broken and just kept, in one axis of a clean table."""

import pytest

from stand import toml_files as catalogue
from stand.table.lint import lint
from stand.toml_files import Source, ids

HEAD = """
title = "Mine"
source = "{source}"
[geometry]
base_tilt_arc_s = {tilt}
[settling]
within_arc_s = {within}
hold_s = 0.5
[axis.{name}]
rate_deg_s = {rate}
acceleration_deg_s2 = {acceleration}
jerk_deg_s3 = {jerk}
[axis.{name}.motor]
torque_Nm = {torque}
bandwidth_hz = {bandwidth}
damping = {damping}
integral_s = 0.08
viscous_Nm_s = 0.2
cogging_Nm = {cogging}
cogging_per_turn = 96
coulomb_Nm = {coulomb}
static_Nm = 40.0
[axis.{name}.errors]
encoder_arc_s = {encoder}
encoder_step_arc_s = {step}
rate_ripple_percent = {ripple}
ripple_per_turn = 96
"""
CLEAN = {
    "source": "Acceptance report 12 of the table, page 3",
    "name": "outer", "tilt": 1.0, "within": 1.0, "rate": 200.0, "acceleration": 100.0,
    "jerk": 400.0, "torque": 60.0, "bandwidth": 22.0, "damping": 0.7, "cogging": 0.01,
    "coulomb": 0.02, "encoder": 0.5, "step": 0.01, "ripple": 0.0005,
}  # fmt: skip


def findings(**changes):
    text = HEAD.format(**(CLEAN | changes))
    return [(f.severity, f.place) for f in lint(Source("mine", "mine.toml", text))]


# by hand: friction at 200 deg/s is 0.2 * 200 pi/180 = 0.698 N m and what coulomb adds
BROKEN_AND_KEPT = [
    ("source", "todo", "see report 12, p. 3", "warning", "source"),
    ("tilt", 1801.0, 1800.0, "error", "geometry, base_tilt_arc_s"),
    ("tilt", 0.049, 0.05, "error", "geometry, base_tilt_arc_s"),
    ("encoder", 0.049, 0.05, "error", "axis, outer, errors, encoder_arc_s"),
    ("step", 1.01, 1.0, "error", "settling, within_arc_s = 1"),
    ("ripple", 1.01, 1.0, "warning", "axis, outer, errors, rate_ripple_percent"),
    ("rate", 3001.0, 3000.0, "warning", "axis, outer, rate_deg_s"),
    ("acceleration", 3.3, 3.4, "warning", "axis, outer, acceleration_deg_s2"),  # 200/60 = 3.33
    ("jerk", 1.6, 1.7, "warning", "axis, outer, jerk_deg_s3"),  # 100/60 = 1.67
    ("bandwidth", 101.0, 100.0, "warning", "axis, outer, motor, bandwidth_hz"),
    ("damping", 0.29, 0.3, "warning", "axis, outer, motor, damping"),
    ("cogging", 18.1, 18.0, "warning", "axis, outer, motor, cogging_Nm"),  # 0.3 * 60
    ("coulomb", 18.1, 18.0, "warning", "axis, outer, motor, coulomb_Nm"),
]


def test_a_clean_table_has_no_findings():
    assert findings() == []


@pytest.mark.parametrize("table", ids("tables"))
def test_the_tables_of_the_catalogue_are_clean(table):
    assert [
        f for f in lint(catalogue.find("tables", "table", table)) if f.severity == "error"
    ] == []


@pytest.mark.parametrize(("key", "broken", "kept", "severity", "place"), BROKEN_AND_KEPT)
def test_a_rule_is_broken_just_beyond_its_limit(key, broken, kept, severity, place):
    assert (severity, place) in findings(**{key: broken})
    assert (severity, place) not in findings(**{key: kept})


def test_friction_that_a_motor_cannot_overcome():
    place = ("error", "axis, outer, motor, torque_Nm")
    assert place in findings(torque=0.71)  # 0.698 + 0.02 = 0.718
    assert place not in findings(torque=0.73)


def test_a_base_that_turns_without_end():
    assert ("warning", "axis, base_yaw, travel_deg") in findings(name="base_yaw")


def test_a_file_that_does_not_load_has_its_faults_alone():
    assert findings(name="sideways") != []
    assert {severity for severity, _ in findings(rate="'fast'")} == {"error"}
