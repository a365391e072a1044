"""Readings at full scale: told from rounding, motion and chance; flagged, refused, or neither."""

import numpy as np
import pytest

from alignment import ESTIMATORS, Dwell, ImuReadings, Options, Site
from alignment.errors import Saturated
from alignment.saturation import saturation_doubt

RATE, N = 50.0, 6000
W_B = np.array([9.96651, 11.26509, 0.0]) * np.pi / 180 / 3600  # level at 48.5 deg, nose north
F_B = np.array([0.0, 9.8093587, 0.0])


def readings(noise=1e-4, force=1e-2, seed=0):
    rng = np.random.default_rng(seed)
    t = np.arange(1, N + 1) / RATE
    return t, W_B + noise * rng.normal(size=(N, 3)), F_B + force * rng.normal(size=(N, 3))


def doubt(t, w, f):
    return saturation_doubt("p", ImuReadings(t, w, f))


def test_clipped_channels_are_named_by_axis_and_sensor():
    t, w, f = readings()
    w[:, 2] = np.minimum(w[:, 2], 2.6e-4)  # 2.6 sigma: 0.47 % of a Gaussian lie beyond
    f[:, 0] = np.maximum(f[:, 0], -2.6e-2)
    flags = doubt(t, w, f)
    assert [flag.split(" at full scale in ")[0] for flag in flags] == [
        "Z1 gyro",
        "X1 accelerometer",
    ]
    for flag in flags:
        share = float(flag.split(" in ")[1].split(" %")[0])
        # 28 samples of 6000, to four standard deviations of a count
        assert share == pytest.approx(0.466, abs=4 * np.sqrt(28) / 60)


def test_more_than_a_hundredth_is_refused_with_its_channel():
    t, w, f = readings()
    f[:, 1] = np.minimum(f[:, 1], F_B[1] + 1e-2)  # one sigma: 15.9 %
    with pytest.raises(Saturated, match=r"p: Y1 accelerometer at full scale in 1\d % of the"):
        doubt(t, w, f)


@pytest.mark.parametrize("lsb", [0.1, 0.5, 2.0, 10.0])
def test_rounding_is_no_saturation(lsb):
    for seed in range(5):
        t, w, f = readings(seed=seed)
        assert (
            doubt(t, lsb * 1e-4 * np.rint(w / lsb / 1e-4), lsb * 1e-2 * np.rint(f / lsb / 1e-2))
            == ()
        )


@pytest.mark.parametrize("lsb", [0.0, 1e-4, 1e-3])
def test_a_rounded_sway_and_a_noise_free_plateau_are_no_saturation(lsb):
    t, w, f = readings(noise=0.0 if lsb else 1e-6)
    w[:, 0] += 0.02 * np.sin(2 * np.pi * 0.2 * t)
    w[:, 1] += 0.1 * np.clip((t - 30) / 5, 0, 1) * np.clip((90 - t) / 5, 0, 1) * (lsb > 0)
    assert doubt(t, lsb * np.rint(w / lsb) if lsb else w, f) == ()


def test_a_vibration_in_step_with_the_samples_is_no_saturation():
    t, w, f = readings(0.0, 0.0)
    w[:, 0] += 0.05 * np.sin(2 * np.pi * 5 * t + 0.1 * np.pi)  # ten samples a cycle, two at a peak
    assert doubt(t, w, f) == ()


def test_perfect_readings_are_no_saturation():
    t, w, f = readings(0.0, 0.0)
    assert doubt(t, w, f) == ()


def clipped(share):
    t, w, f = readings(noise=1e-6)
    limit = np.quantile(w[:, 0], 1 - share)
    w[:, 0] = np.minimum(w[:, 0], limit)
    return Dwell("p", 0.0, N / RATE, ImuReadings(t, w, f))


@pytest.mark.parametrize(
    "name",
    ["triad", "single-gyro", "six-position", "rk4", "two-sample", "two-gyro", "inertial", "fine"],
)
def test_every_method_at_rest_tells(name):
    site, options = Site(np.radians(48.5)), Options()
    found = ESTIMATORS[name].estimate([clipped(0.005)], site, options)
    assert all(any("X1 gyro at full scale in 0.5 %" in flag for flag in e.flags) for e in found)
    with pytest.raises(Saturated, match="X1 gyro at full scale in 5 % of the samples"):
        ESTIMATORS[name].estimate([clipped(0.05)], site, options)
