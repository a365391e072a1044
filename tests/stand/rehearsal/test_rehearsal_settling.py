"""Settling as it is foretold against simulated servos."""

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from alignment.units import ARC_SECOND
from stand import toml_files as catalogue
from stand.imu import load_imu
from stand.motion.planner import plan
from stand.motion.polynomial import Motion, MotionKind
from stand.physics.following import StepSpan
from stand.physics.mjcf import describe, load_model
from stand.physics.servo import Servo
from stand.procedure.procedure import load_procedure, procedure_from, table_of
from stand.rehearsal.following import left_off, never_settling
from stand.rehearsal.rehearse import prepared, rehearse
from stand.simulation.settings import assembled
from stand.table.joints import JOINTS
from stand.table.table import load_table

MODEL = load_model()
STAND = describe(MODEL)


@pytest.mark.parametrize(
    ("name", "long", "short"), [("scorsby", "= 496", "= 26"), ("two-position", "= 296", "= 12")]
)
def test_settling_is_foretold_as_a_servo_does_it(name, long, short):
    """After rocking on the rocking platform half a second; after a move nothing.

    Within 0.1 s: the Coulomb step of the estimate is a little more than what really lets go.
    """
    source = catalogue.find("procedures", "procedure", name)
    procedure = procedure_from(
        catalogue.Source(source.id, source.name, re.sub(long, short, source.text))
    )
    table = table_of(procedure)
    foretold = rehearse(assembled(procedure, load_imu("stim300"), table))
    planned = plan(procedure, STAND, table)
    last = planned.steps[-1]
    servo = Servo(MODEL, table, planned.motion, spans=[StepSpan(last.t_from, last.t_to, True)])
    (done,) = servo.followed()
    assert done.settled
    slowest = max(t for t in done.settling_s if t is not None)
    assert foretold.feasibility[-1].settling_s == pytest.approx(slowest, abs=0.1)
    assert (slowest > 0.3) == (name == "scorsby")


SHORT = """
title = "There and back"
table = "{}"
[site]
latitude_deg = 48.5
[estimate]
methods = ["two-position", "triad"]
[[step]]
kind = "dwell"
label = "first"
duration_s = 4
[[step]]
kind = "move"
label = "there"
joints_deg = {{ outer = 90 }}
[[step]]
kind = "dwell"
label = "second"
duration_s = 4
[[step]]
kind = "move"
label = "half way back"
joints_deg = {{ outer = 37.3 }}
[[step]]
kind = "dwell"
label = "third"
duration_s = 4
"""


def servo_case(tmp_path, integrator: bool, within: float = 100.0):
    """On a table whose outer axis has much friction, with or without an integrator."""
    text = catalogue.find("tables", "table", "mid-class").text
    text = text.replace("within_arc_s = 10.0", f"within_arc_s = {within}")
    before, head, rest = text.partition("[axis.outer.motor]")
    for a, b in (
        ("coulomb_Nm = 0.4", "coulomb_Nm = 14.0"),
        ("static_Nm = 0.44", "static_Nm = 14.0"),
        ("integral_s = 0.1\n", "integral_s = 0.1\n" if integrator else ""),
    ):
        assert a in rest
        rest = rest.replace(a, b, 1)
    (tmp_path / "own.toml").write_text(before + head + rest, encoding="utf-8")
    (tmp_path / "case.toml").write_text(SHORT.format(tmp_path / "own.toml"), encoding="utf-8")
    procedure = load_procedure(str(tmp_path / "case.toml"))
    made = assembled(procedure, load_imu("hg9900"), table_of(procedure), None, 20)
    return replace(made, motion=MotionKind.SERVO)


@pytest.mark.parametrize("integrator", [False, True])
def test_friction_holds_an_axis_off_as_a_servo_without_integrator_has_it(tmp_path, integrator):
    """14 N m over ``kp = I w^2``: 20 arc s short, whichever way it came; 5 % are its bristles'.

    With an integrator less than 0.01 arc s is left, and nothing is predicted.
    """
    case = servo_case(tmp_path, integrator)
    scene = prepared(case)
    steps = scene.plan.stretches
    spans = [StepSpan(s.t_to - 0.5, s.t_to - 0.1, True) for s in steps]
    servo = Servo(MODEL, case.table, scene.plan.motion, spans=spans)
    done = servo.followed()
    outer = JOINTS.index("outer")
    greatest = [float(d.greatest_error[outer]) / ARC_SECOND for d in done]
    foretold = [float(left_off(scene, s)[outer]) / ARC_SECOND for s in steps]
    if integrator:
        assert max(greatest) < 0.01
        assert foretold == [0, 0, 0]
        return
    assert np.sign(foretold).tolist() == [0, -1, 1]
    assert np.abs(foretold).tolist() == pytest.approx(greatest, rel=0.05, abs=1e-3)
    # of an attitude at the first position half of what the turn is short: (d90 - d0)/2 of it is
    # east and half north, where first is what is told
    found = {(p.method, p.label, p.quantity): p for p in rehearse(case).predictions}
    ideal = {
        (p.method, p.label, p.quantity): p
        for p in rehearse(replace(case, motion=MotionKind.IDEAL)).predictions
    }
    bias = abs(found["two-position", "first", "heading"].bias) / ARC_SECOND
    assert bias == pytest.approx(abs(foretold[1]) / 2, rel=0.05)
    assert ideal["two-position", "first", "heading"].bias == 0.0
    # an attitude that asks no encoder is off by nothing
    assert found["triad", "second", "heading"].bias == pytest.approx(0.0, abs=1e-12)


def test_an_axis_that_friction_holds_beyond_what_counts_as_settled_is_named(tmp_path):
    found = rehearse(servo_case(tmp_path, integrator=False, within=10.0)).findings
    (told,) = [f.text for f in found if f.kind == "servo"]
    assert told.startswith("outer: friction holds its servo, without integrator, 20 arc s off")
    assert "within 10 arc s" in told
    kept = rehearse(servo_case(tmp_path, integrator=False)).findings
    assert not [f for f in kept if f.kind == "servo"]


def test_an_axis_is_short_of_where_it_last_went():
    """2 N m over ``I w^2`` of 4 kg m^2 and 10 rad/s are 5 mrad, against the last way of all."""
    rates = np.zeros((2, 4, len(JOINTS)))  # of pieces of 1 s; the last is after the rest
    outer, middle, inner = map(JOINTS.index, ("outer", "middle", "inner"))
    rates[0, :, outer] = 1, -1, 0, 1
    rates[0, :, middle] = -1, 1, 0, -1
    rates[0, :, inner] = 1, 0, 0, -1
    usual = load_table("mid-class").motors[outer]
    assert usual is not None
    motor = replace(usual, coulomb=2.0, bandwidth=10.0, integral=None)
    within = 3e-3
    scene = SimpleNamespace(
        settings=SimpleNamespace(motion=MotionKind.SERVO),
        plan=SimpleNamespace(motion=Motion(np.arange(5.0), rates)),
        table=SimpleNamespace(motors=[motor] * 6, settle_within=within),
        inertias=np.full(6, 4.0),
    )
    step = SimpleNamespace(steady_from=2.5, turning=None)
    expected = np.zeros(6)
    expected[[outer, middle, inner]] = 5e-3, -5e-3, -5e-3
    assert left_off(scene, step) == pytest.approx(expected, abs=1e-15)
    turning = SimpleNamespace(steady_from=2.5, turning=SimpleNamespace(axis=outer))
    assert left_off(scene, turning)[outer] == 0.0
    assert not left_off(scene, SimpleNamespace(steady_from=0.0, turning=None)).any()
    told = never_settling(scene, [turning, step])
    assert [one.partition(":")[0] for one in told] == ["outer", "middle", "inner"]
    assert "1.03e+03 arc s off, and within 619 arc s" in told[0]
    assert len(never_settling(scene, [turning])) == 2
    assert never_settling(scene, []) == []
    # one with an integrator, or as planned, is where it should be
    scene.table.motors = [replace(motor, integral=0.1)] * 6
    assert not left_off(scene, step).any()
    scene.table.motors, scene.settings.motion = [motor] * 6, MotionKind.IDEAL
    assert not left_off(scene, step).any()
