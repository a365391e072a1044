"""A sheet that tells of one sensor alone says nothing of the other: each is as without a sheet."""

from dataclasses import replace
from math import cos, pi, radians, sin

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from alignment import ESTIMATORS, Dwell, ImuReadings, Options, Priors, Site
from alignment.misplaced import misplaced
from alignment.noise import faint_doubt
from alignment.nominal import ZeroOffset, nominal_readings
from alignment.options import of_noise_alone

W, G = 7.292115e-5, 9.81
HERE = Site(radians(48.5), local_gravity=G)
LEVEL = Rotation.from_matrix([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
NOISE = Priors(gyro_walk=1e-6, accel_walk=1e-5)
# so small that no sigma holds them: they say that there is a sheet
ACCEL, GYRO = replace(NOISE, accel_bias=1e-12), replace(NOISE, gyro_bias=1e-16)


def rest(shown: float) -> Dwell:
    """Four minutes level to the north, X1, Y1 up, whose gyros show a part of the Earth's rate along
    north, and drift by 0.1 deg/h."""
    n, rng = 2400, np.random.default_rng(3)
    t = np.arange(1, n + 1) / 10
    mean = W * np.array([shown * cos(HERE.latitude or 0), sin(HERE.latitude or 0), 0.0])
    drift = np.outer(t / t[-1] - 0.5, [0.0, 0.0, 0.1 * pi / 180 / 3600])
    noise = np.sqrt(10) * rng.normal(size=(n, 6)) * np.repeat([1e-6, 1e-5], 3)
    readings = ImuReadings(t, mean + drift + noise[:, :3], [0.0, G, 0.0] + noise[:, 3:])
    return Dwell("rest", 0.0, t[-1], readings)


@pytest.mark.parametrize("shown", [1.0, 0.6])
@pytest.mark.parametrize("method", ["triad", "single-gyro", "two-gyro", "inertial"])
def test_heading_by_gyros_of_no_sheet_is_as_surely_known_as_without_any(method, shown):
    dwell = rest(shown)
    bare, partial, known = (
        ESTIMATORS[method].estimate([dwell], HERE, Options(priors=priors))[0]
        for priors in (NOISE, ACCEL, GYRO)
    )
    assert bare.heading_sigma is not None
    assert partial.heading_sigma == pytest.approx(bare.heading_sigma, rel=1e-6)
    if method in ("two-gyro", "inertial") and shown < 1:  # with a sheet the rate is the Earth's
        assert known.heading_sigma is not None
        assert known.heading_sigma < 0.8 * bare.heading_sigma


def test_a_faint_drift_is_told_of_sensors_without_a_sheet():
    n = 400
    for k in range(40):
        rng = np.random.default_rng(k)
        ramp = np.linspace(-0.5, 0.5, n)[:, None] * [0.0, 5 * np.sqrt(12 / n), 0.0]
        w, f = ramp + rng.normal(size=(n, 3)), rng.normal(size=(n, 3))
        readings = ImuReadings(np.arange(1, n + 1) / 10, 1e-5 * w, [0.0, G, 0.0] + 1e-3 * f)
        if faint_doubt(readings, NOISE) and "accel" not in faint_doubt(readings, NOISE)[0]:
            break
    assert faint_doubt(readings, ACCEL) == faint_doubt(readings, NOISE)
    assert faint_doubt(readings, GYRO) == ()


def test_offsets_contradict_the_sheet_of_their_own_sensor():
    """A degree of tilt, and 10 of heading: each is said by the sensor whose sheet there is."""
    w_b, f_b = np.split(nominal_readings(LEVEL, HERE), 2)
    values = np.concatenate([w_b, f_b])
    off = np.zeros(6)
    off[2], off[3] = W * cos(radians(48.5)) * radians(10), G * radians(1)
    offset = ZeroOffset(off, np.full(6, 1e-20) * np.ones_like(values), np.zeros(6))
    for priors, level, heading in ((NOISE, 0, 0), (ACCEL, 1, 0), (GYRO, 0, 1)):
        _, flags = misplaced(offset, LEVEL, HERE, priors)
        assert (sum("the level" in f for f in flags), sum("the heading" in f for f in flags)) == (
            level,
            heading,
        )


def test_which_sensor_tells_what():
    of_gyros = ("heading", "yaw", "latitude", "gyro bias X1", "gyro X1")
    of_accels = ("roll", "pitch", "tilt", "accelerometer bias Z1", "accel X1")
    for name in of_gyros:
        assert of_noise_alone(name, {"gyro"})
        assert not of_noise_alone(name, {"accel"})
    for name in of_accels:
        assert of_noise_alone(name, {"accel"})
        assert not of_noise_alone(name, {"gyro"})
