"""What a rehearsal takes for a stretch is what the plan's motion does."""

import numpy as np
import pytest

from alignment.units import DEG
from stand.motion.planner import plan
from stand.physics.mjcf import describe, load_model
from stand.procedure.procedure import load_procedure
from stand.rehearsal.planned import planned_stretch
from stand.table.table import load_table

STAND = describe(load_model())


@pytest.mark.parametrize("name", ["carousel", "rate-sweep"])
def test_a_turn_starts_at_the_angle_of_its_motion(name):
    procedure = load_procedure(name)
    made = plan(procedure, STAND, load_table(procedure.entry.table))
    turning = [step for step in made.stretches if step.turning is not None]
    assert len(turning) >= 2
    for step in turning:
        axis, whole = step.turning.axis, step.steady_to - step.steady_from
        times = [step.steady_from, step.steady_to]
        (start, end), (rate, _) = (x[:, axis] for x in made.motion.joints(times)[:2])
        # times of hundreds of seconds are good to 1e-13 s, angles of many turns to 1e-13 rad
        assert step.turning.angle == pytest.approx(start, abs=1e-9)
        assert step.turning.angle + step.turning.rate * whole == pytest.approx(end, abs=1e-9)
        assert step.turning.rate == pytest.approx(rate, rel=1e-9)
        if abs(end - start) > 2 * np.pi:  # a stretch needs a whole turn
            assert planned_stretch(step).angle == step.turning.angle


def test_the_carousel_starts_where_its_ramp_has_brought_it():
    """By hand: from rest at zero a ramp of limited jerk takes half its time at full rate."""
    procedure = load_procedure("carousel")
    made = plan(procedure, STAND, load_table(procedure.entry.table))
    first = next(step for step in made.stretches if step.turning is not None)
    before = np.linspace(first.t_from, first.steady_from, 200_001)
    moving = made.motion.joints(before)[1][:, first.turning.axis] != 0
    ramp = first.steady_from - before[moving][0]
    by_hand = abs(first.turning.rate) * ramp / 2
    assert abs(planned_stretch(first).angle) == pytest.approx(by_hand, abs=0.001 * DEG)
