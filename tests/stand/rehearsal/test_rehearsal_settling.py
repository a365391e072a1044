"""Settling as it is foretold against simulated servos."""

import re

import pytest

from stand import toml_files as catalogue
from stand.imu import load_imu
from stand.motion.planner import plan
from stand.physics.following import StepSpan
from stand.physics.mjcf import describe, load_model
from stand.physics.servo import Servo
from stand.procedure.procedure import procedure_from, table_of
from stand.rehearsal.rehearse import rehearse
from stand.simulation.settings import assembled

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
