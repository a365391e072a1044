"""Runs one after another in one process: each has a table of its own."""

from dataclasses import replace

import numpy as np
import pytest
from procedures import HALF_TURN

from stand import toml_files as catalogue
from stand.imu import load_imu
from stand.motion.polynomial import MotionKind
from stand.procedure.procedure import procedure_from, table_of
from stand.simulation.monte_carlo import Trials
from stand.simulation.settings import assembled

SHORT = HALF_TURN.replace("duration_s = 24", "duration_s = 3").replace("180", "20")


def settings_of(motion, latency):
    procedure = procedure_from(catalogue.Source("case", "case.toml", SHORT))
    unit = load_imu("ring-laser")
    unit = replace(unit, clock=replace(unit.clock, latency=latency))
    table = table_of(procedure)
    return assembled(procedure, unit, table, rate_hz=20, motion=motion)


@pytest.mark.parametrize(
    ("motion", "latency"),
    [
        (MotionKind.IDEAL, 0.0),
        (MotionKind.IDEAL, 2e-3),  # a late clock: whole simulations
        pytest.param(MotionKind.SERVO, 0.0, marks=pytest.mark.slow),
    ],
)
def test_a_second_run_has_a_table_of_its_own(motion, latency):
    """Not the first one's truth: tables of this class lean by some 10 arc seconds, 5e-5 rad."""
    made = settings_of(motion, latency)
    trials = Trials(made)
    _, first = trials.readings(0)
    after, attitudes = trials.readings(1)
    fresh, true = Trials(made).readings(1)
    for C_nb, other in zip(attitudes, true, strict=True):
        np.testing.assert_array_equal(C_nb.as_quat(), other.as_quat())
    for dwell, other in zip(after, fresh, strict=True):
        np.testing.assert_array_equal(dwell.readings.w_ib_b, other.readings.w_ib_b)
        np.testing.assert_array_equal(dwell.readings.f_b, other.readings.f_b)
    apart = [(a.inv() * b).magnitude() for a, b in zip(first, attitudes, strict=True)]
    assert min(apart) > 5e-6  # an arc second


def test_biases_of_a_run_are_those_its_unit_was_drawn_with():
    """Before its readings, after them, and after those of another run."""
    trials = Trials(settings_of(MotionKind.IDEAL, 0.0))
    before = trials.biases(3)
    for seed in (3, 4):
        trials.readings(seed)
        np.testing.assert_array_equal(trials.biases(3), before)
    assert (trials.biases(4) != before).all()
