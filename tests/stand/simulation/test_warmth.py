"""What warmth adds to a unit's priors, by hand."""

from dataclasses import replace

import numpy as np
import pytest

from alignment import Priors
from stand.imu import Temperature, load_imu
from stand.imu.preset import TriadSpec
from stand.procedure.procedure import load_procedure
from stand.simulation.warmth import observed_for, warmed

UNIT = replace(
    load_imu("ideal"),
    gyro=TriadSpec(bias_temperature=2e-8, scale_temperature=3e-6),
    accel=TriadSpec(bias_temperature=4e-5, scale_temperature=5e-6),
    reference_temperature=25.0,
)


def test_ten_kelvin_in_a_straight_line():
    """From 5 below to 10 above in 100 s: 10 at most, 15/sqrt(12) by standard deviation."""
    line = Temperature(np.array([0.0, 100.0]), np.array([20.0, 35.0]))
    told = Priors(gyro_bias=1.5e-7, accel_scale=2e-5)
    made = warmed(told, UNIT, line, 100.0)
    changed = 15 / np.sqrt(12)
    # 400 points have 401/399 of the variance
    assert made.gyro_bias == pytest.approx(2.5e-7)
    assert made.gyro_scale == pytest.approx(3e-5)
    assert made.gyro_instability == pytest.approx(2e-8 * changed, rel=3e-3)
    assert made.accel_bias == pytest.approx(4e-4)
    assert made.accel_scale == pytest.approx(np.hypot(2e-5, 5e-5))
    # the scale factor by gravity, 4.9e-5 m/s^2 a kelvin, is as much as the bias
    both = np.hypot(4e-5, 5e-6 * 9.80665)
    assert made.accel_instability == pytest.approx(both * changed, rel=3e-3)


def test_steadily_warm_is_a_bias_that_stays():
    warm = Temperature(np.array([0.0]), np.array([35.0]))
    made = warmed(Priors(), UNIT, warm, 100.0)
    assert (made.gyro_instability, made.accel_instability) == (0.0, 0.0)
    assert made.gyro_bias == pytest.approx(2e-7)


def test_how_long_a_procedure_is_observed():
    """Six dwells of a minute."""
    assert observed_for(load_procedure("six-position").entry) == pytest.approx(360.0)
