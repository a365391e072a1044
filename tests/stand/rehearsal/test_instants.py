"""Samples that are instants: runs come to what is predicted of them, turning and at rest."""

from dataclasses import replace

import numpy as np
import pytest

from stand.imu import load_imu
from stand.procedure.procedure import load_procedure, table_of
from stand.rehearsal.rehearse import rehearse
from stand.rehearsal.verify import with_verification
from stand.samples import Sampling
from stand.simulation.monte_carlo import Trials
from stand.simulation.settings import assembled

RUNS = 6
STEPS = """
title = "Turns one way, and a rest"
table = "laboratory"

[site]
latitude_deg = 40.0
height_m = 0.0

[estimate]
methods = ["triad"]
offset_window_s = 2.0

[move_limits]
rate_deg_s = 20.0
acceleration_deg_s2 = 20.0
jerk_deg_s3 = 80.0

[[step]]
kind = "move"
label = "round"
joints_deg = { outer = 130.0, inner = 40.0 }

[[step]]
kind = "dwell"
label = "rest"
duration_s = 40.0

[[step]]
kind = "sweep"
label = "sweep"
axis = "outer"
rates_deg_s = [6.0, -20.0]
turns = 1.0
"""


def asked(folder, methods, rate_hz, bandwidth=np.inf):
    path = folder / "steps.toml"
    path.write_text(STEPS, encoding="utf-8")
    procedure, unit = load_procedure(str(path)), load_imu("ring-laser")
    gyro, accel = (replace(triad, bandwidth=bandwidth) for triad in (unit.gyro, unit.accel))
    unit = replace(unit, gyro=gyro, accel=accel)
    site, table = procedure.entry.site.site(), table_of(procedure)
    made = assembled(procedure, unit, table, site, rate_hz, sampling=Sampling.INSTANT)
    return replace(made, methods=methods)


@pytest.mark.parametrize(
    ("methods", "rate_hz", "bandwidth", "numbers"),
    [
        # 20 deg/s times half a sample is 0.5 deg of heading, of 0.1 deg predicted
        (("carousel", "inertial", "fine"), 20, np.inf, 21),
        # guessed means between instants left 0.05 deg/s of the move in the rest's first sample
        (("rk4", "two-sample", "triad"), 4, 8.0, 3),
    ],
)
def test_what_is_predicted_of_instants_is_what_runs_come_to(
    tmp_path, methods, rate_hz, bandwidth, numbers
):
    made = asked(tmp_path, methods, rate_hz, bandwidth)
    found = with_verification(rehearse(made), made, RUNS, workers=1).verification
    assert found is not None
    compared = [a for a in found.achieved if a.ratio is not None]
    assert len(compared) >= numbers
    assert [(a.method, a.label, a.quantity, a.ratio) for a in compared if a.agrees is False] == []
    assert not found.silent


def test_a_rest_after_a_move_reads_what_one_without_a_move_does(tmp_path):
    """A filter of 8 Hz has forgotten by exp(-8.9) in a first sample of 0.25 s, of 1 s exp(-35)."""
    unit = load_imu("ring-laser")
    made = asked(tmp_path, ("rk4",), 4, 8.0)
    (dwell, *_), _ = Trials(made).readings(3)
    w = dwell.window().w_ib_b
    white = unit.gyro.noise * np.sqrt(8.0 * 2 * np.pi / np.sqrt(8))  # R(0) of the filtered noise
    assert np.abs(w[:4] - w[4:].mean(axis=0)).max() < 5 * white
    assert dwell.readings.instants
