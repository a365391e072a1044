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


# Quiet and coarse records that are not clipped ---------------------------------------------------


def smooth_start(step):
    """A channel without noise, at rest but for the smooth start of a turn in the last 0.8 s."""
    t, w, f = readings(0.0, 0.0)
    w[:, 1] = -1.2952104e-6
    w[-80:, 1] += 1.4e-10 * np.exp((np.arange(80) - 79) / 12)
    w[:, 1] = step(w[:, 1])
    return t, w, f


@pytest.mark.parametrize(
    "step",
    [
        lambda x: x,
        lambda x: x.astype("f4").astype(float),
        lambda x: (x.astype("f4") * np.float32(0.01)).astype(float) / 0.01,  # rounded twice
        lambda x: 1e-12 * np.rint(x / 1e-12),
    ],
)
@pytest.mark.parametrize("sign", [1, -1])
def test_a_quiet_channel_that_starts_to_move_is_not_clipped(step, sign):
    t, w, f = smooth_start(step)
    assert doubt(t, sign * w, f) == ()


def test_a_coarse_gyro_that_is_turned_by_hand_is_not_clipped():
    """Zero for 50 s, then 10 s in one direction, with all the roughness of a hand."""
    for seed in range(5):
        t, w, f = readings()
        rough = np.abs(np.convolve(np.random.default_rng(seed).normal(size=N), np.ones(5), "same"))
        turn = np.where(t > 100, np.sin(np.pi * (t - 100) / 20), 0.0)
        w[:, 0] = 1e-3 * np.rint(0.1 * turn * (1 + 0.1 * rough) / 1e-3)
        assert doubt(t, w, f) == ()


@pytest.mark.parametrize("share", [0.02, 0.2])
def test_a_channel_whose_readings_lie_below_its_extreme_by_chance_of_rounding(share):
    """Rounded so coarsely that hardly any value is off one: two or three levels are no range."""
    t, w, f = readings()
    w[:, 0] = 1e-3 * (np.random.default_rng(1).uniform(size=N) < share)
    f[:, 1] = F_B[1] + 0.1 * np.rint(f[:, 2] / 0.03)
    assert doubt(t, w, f) == ()


def test_dead_channels_are_not_clipped():
    t, w, f = readings()
    w[:, 1], f[:, 0] = 0.0, 1.5
    assert doubt(t, w, f) == ()


def test_a_minimum_above_zero_is_no_full_scale():
    """Gravity's axis: full scale lies away from zero, not where it reads least."""
    t, w, f = readings()
    f[:, 1] = np.maximum(f[:, 1], F_B[1] - 2.6e-2)
    assert doubt(t, w, f) == ()


# Clipped all the same ----------------------------------------------------------------------------


@pytest.mark.parametrize("lsb", [0.0, 1e-3, 5e-3])
def test_a_clipped_turn_is_seen(lsb):
    """A hand's turns of up to 1 rad/s on a gyro that ends at 0.5, fine and coarse."""
    for seed in range(3):
        t, w, f = readings()
        rng = np.random.default_rng(seed)
        w[:, 0] = np.convolve(rng.normal(size=N), np.ones(25), "same") * 0.08
        w[:, 0] += 0.01 * rng.normal(size=N)
        w[:, 0] = np.clip(w[:, 0], -0.5, 0.5)
        w[:, 0] = lsb * np.rint(w[:, 0] / lsb) if lsb else w[:, 0]
        with pytest.raises(Saturated, match="X1 gyro at full scale"):
            doubt(t, w, f)


def test_a_stated_range_is_known():
    t, w, f = readings()
    ends = np.abs(w[:, 0])
    limit = float(np.quantile(ends, 0.995))
    found = saturation_doubt("p", ImuReadings(t, np.clip(w, -limit, limit), f, (limit, 100.0)))
    assert "X1 gyro at full scale in 0.5 % of the samples" in found
    # a range that nobody reached, whatever the readings look like
    t, w, f = smooth_start(lambda x: x)
    assert saturation_doubt("p", ImuReadings(t, w, f, (1.0, 100.0))) == ()
    with pytest.raises(Saturated, match="Y1 accelerometer at full scale in 100 %"):
        saturation_doubt("p", ImuReadings(t, w, f, (1.0, 9.8093587)))
