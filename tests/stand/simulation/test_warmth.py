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
    """From 5 below to 10 above in 100 s: a ramp of 0.15 K/s from a bias of 5 K, which together are
    11 at the end; what changes a scale factor is no ramp, but 15/sqrt(12) by standard deviation."""
    line = Temperature(np.array([0.0, 100.0]), np.array([20.0, 35.0]))
    told = Priors(gyro_bias=0.75e-7, gyro_ramp=4e-9, accel_scale=2e-5)
    made = warmed(told, UNIT, line, 100.0)
    assert made.gyro_bias == pytest.approx(1.25e-7)
    assert made.gyro_ramp == pytest.approx(5e-9)
    assert made.gyro_instability == pytest.approx(0.0, abs=1e-20)
    assert made.gyro_scale == pytest.approx(3e-5)
    assert made.gyro_scale_ramp == pytest.approx(3e-6 * 0.15)
    assert made.accel_bias == pytest.approx(2e-4)
    assert made.accel_ramp == pytest.approx(6e-6)
    assert made.accel_scale == pytest.approx(np.hypot(2e-5, 5e-5))
    # the scale factor by gravity, 4.9e-5 m/s^2 a kelvin; 400 points have 401/399 of the variance
    by_scale = 5e-6 * 9.80665 * 15 / np.sqrt(12)
    assert made.accel_instability == pytest.approx(by_scale, rel=3e-3)


def test_what_is_off_the_line_is_an_instability():
    """Up by 6 K and back in 100 s: no slope, 6/sqrt(12) K of standard deviation, 6 at most."""
    tent = Temperature(np.array([0.0, 50.0, 100.0]), np.array([25.0, 31.0, 25.0]))
    made = warmed(Priors(), UNIT, tent, 100.0)
    assert made.gyro_ramp == pytest.approx(0.0, abs=1e-15)
    assert made.gyro_instability == pytest.approx(2e-8 * 6 / np.sqrt(12), rel=5e-3)
    assert made.gyro_bias == pytest.approx(2e-8 * 6, rel=5e-3)
    assert made.gyro_scale_ramp == pytest.approx(3e-6 * 6 / 50)


@pytest.mark.parametrize("ends", [(25, 35), (45, 25), (20, 40), (60, 65)])
def test_bias_and_ramp_are_never_less_than_what_the_line_does(ends):
    line = Temperature(np.array([0.0, 100.0]), np.array(ends, float))
    made = warmed(Priors(), UNIT, line, 100.0)
    t = np.linspace(0.0, 100.0, 11)
    sigma = np.hypot(made.gyro_bias, made.gyro_ramp * t)
    assert (sigma >= 2e-8 * np.abs(line.at(t) - 25) * (1 - 1e-9)).all()


def test_steadily_warm_is_a_bias_that_stays():
    warm = Temperature(np.array([0.0]), np.array([35.0]))
    made = warmed(Priors(), UNIT, warm, 100.0)
    assert (made.gyro_instability, made.accel_instability, made.gyro_ramp) == (0.0, 0.0, 0.0)
    assert made.gyro_bias == pytest.approx(2e-7)
    assert made.gyro_scale_ramp == 0.0


def test_how_long_a_procedure_is_observed():
    """Six dwells of a minute."""
    assert observed_for(load_procedure("six-position").entry) == pytest.approx(360.0)
