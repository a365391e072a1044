"""What estimators are told of unit and table before the readings, by hand."""

from dataclasses import replace
from math import hypot, sqrt

import numpy as np
import pytest

from stand.imu import TriadSpec, load_imu
from stand.imu.priors import placement, priors_of
from stand.table.table import table_from
from stand.toml_files import Source

ARC_SECOND = 4.84813681109536e-06
JOINTS = ("base_roll", "base_pitch", "base_yaw", "outer", "middle", "inner")
TABLE = """
title = "Mine"
source = "data sheet rev. 3, p. 7"
[geometry]
base_tilt_arc_s = 12.0
base_azimuth_arc_s = 15.0
mounting_arc_s = 24.0
"""
LIMITS = "rate_deg_s = 100.0\nacceleration_deg_s2 = 100.0\njerk_deg_s3 = 500.0\n"
ERRORS = {  # arc seconds
    "base_roll": {"placement": 4.0},
    "base_pitch": {"placement": 5.0},
    "base_yaw": {"placement": 8.0},
    "outer": {"placement": 3.0, "encoder": 2.0, "non_orthogonality": 6.0, "wobble": 1.0},
    "middle": {"placement": 4.0, "encoder": 1.0, "non_orthogonality": 5.0, "wobble": 3.0},
    "inner": {"placement": 12.0, "encoder": 1.0, "non_orthogonality": 0.0, "wobble": 2.0},
}


def table():
    text = TABLE
    for name in JOINTS:
        text += f"[axis.{name}]\ntravel_deg = [-20.0, 20.0]\n{LIMITS}[axis.{name}.errors]\n"
        text += "".join(f"{key}_arc_s = {x}\n" for key, x in ERRORS[name].items())
    return table_from(Source("mine", "mine.toml", text))


def test_placement_by_hand():
    """The worst axis: 2, 6 and 3 make 7; zeros of 3, 4 and 12 are 13/sqrt 3 of one axis."""
    turn, seat, nominal, azimuth = (x / ARC_SECOND for x in placement(table()))
    assert turn == pytest.approx(7.0)
    assert seat == pytest.approx(hypot(24, 13 / sqrt(3)))
    assert nominal == pytest.approx(13.0)  # 12 of the base and 5 of its worse level axis
    assert azimuth == pytest.approx(17.0)  # 15 and 8
    told = priors_of(load_imu("ideal"), table(), 0.3)
    sizes = (told.turn, told.seat, told.nominal, told.azimuth)
    assert sizes == pytest.approx(placement(table()))
    assert told.lever_arm == 0.3
    without = priors_of(load_imu("ideal"), None)
    assert (without.turn, without.seat, without.nominal, without.azimuth) == (0, 0, 0, 0)
    assert told.lag == 0.0  # no bandwidth, no latency


def test_readings_come_as_late_as_their_filters_and_the_bus_make_them():
    """``sqrt2/(2 pi f)`` of 400 and 100 Hz is 0.5627 and 2.2508 ms, and 3 ms on the way."""
    ideal = load_imu("ideal")
    gyro, accel = TriadSpec(bandwidth=400.0), TriadSpec(bandwidth=100.0)
    slow = replace(ideal, gyro=gyro, accel=accel, clock=replace(ideal.clock, latency=3e-3))
    told = priors_of(slow, None)
    assert told.lag == pytest.approx(3.5627e-3, rel=1e-4)  # of the gyros
    assert told.accel_later == pytest.approx(2.2508e-3 - 0.5627e-3, rel=1e-4)


@pytest.mark.parametrize(("corners", "slow"), [((1.0,), 0.0), ((1e6,), 1 / 0.6174)])
def test_a_bias_is_all_that_outlasts_a_dwell(corners, slow):
    """One process of Allan deviation 1 at its peak has a deviation of 1/0.6174."""
    gyro, accel = TriadSpec(bias=3e-6, instability=4e-6), TriadSpec(bias=5e-3, instability=1e-3)
    made = priors_of(replace(load_imu("ideal"), gyro=gyro, accel=accel, corners=corners), None)
    assert made.gyro_bias == pytest.approx(hypot(3e-6, slow * 4e-6), rel=1e-4)
    assert made.accel_bias == pytest.approx(hypot(5e-3, slow * 1e-3), rel=1e-4)


def test_each_error_goes_by_its_own_name():
    names = ("instability", "random_walk", "ramp", "scale", "asymmetry", "misalignment",
             "non_orthogonality")  # fmt: skip
    gyro = TriadSpec(**{n: k * 1e-6 for k, n in enumerate(names, 1)}, noise=2e-5)
    accel = TriadSpec(**{n: k * 1e-4 for k, n in enumerate(names, 1)}, noise=3e-4)
    gyro = replace(gyro, g_sensitivity=1e-7, g2_sensitivity=2e-8)
    gyro = replace(gyro, nonlinearity=3e-3, full_scale=10.0)
    accel = replace(accel, second_order=4e-5, nonlinearity=2e-3, full_scale=50.0)
    made = priors_of(replace(load_imu("ideal"), gyro=gyro, accel=accel), None)
    for sensor, size in (("gyro", 1e-6), ("accel", 1e-4)):
        found = [getattr(made, f"{sensor}_{n}") for n in names]
        assert found == pytest.approx([k * size for k in range(1, 8)])
    assert (made.gyro_walk, made.accel_walk) == (2e-5, 3e-4)
    assert (made.gyro_g_sensitivity, made.gyro_g2_sensitivity) == (1e-7, 2e-8)
    assert made.accel_quadratic == 4e-5
    assert made.accel_cubic == pytest.approx(8e-7)
    assert made.gyro_cubic == pytest.approx(3e-5)


def test_how_far_accelerometers_lie_apart():
    """Root mean square of the nine: 3 and 4 mm of nine are 5/3."""
    ideal, places = load_imu("ideal"), np.zeros((3, 3))
    places[0, 0], places[1, 2] = 3e-3, -4e-3
    assert priors_of(replace(ideal, places=places), None).places == pytest.approx(5e-3 / 3)
    assert priors_of(ideal, None).places == 0.0
