"""What only the whole record shows: a part that lies apart, windows that scatter by more than their
noise. By hand, and how often chance makes one.
"""

from dataclasses import replace

import numpy as np
import pytest

from alignment import Dwell, ImuReadings
from alignment.apart import PARTS, apart
from alignment.noise import apart_of, around_doubt, around_variance, mean_and_variance, rest_doubt

HZ, SPAN = 10, 160.0
PART = SPAN / PARTS  # 10 s
RATE = 1e-4  # rad/s


def readings(rate, at):
    """White noise of 1e-7 rad/sqrt(s), and one sample of so large a `rate` that ends `at` [s]."""
    rng, n = np.random.default_rng(5), round(SPAN * HZ)
    w = 1e-7 * np.sqrt(HZ) * rng.normal(size=(n, 3))
    w[round(at * HZ) - 1] += rate
    f = np.tile([0.0, 9.81, 0.0], (n, 1)) + 1e-4 * rng.normal(size=(n, 3))
    return ImuReadings(np.arange(1, n + 1) / HZ, w, f)


def test_apart_by_hand():
    """Fifteen means of +-1 and one of 9: 9 off their mean, which is (7 - 8)/15 = -1/15."""
    means = np.where(np.arange(16) % 2, -1.0, 1.0)[:, None] * np.ones(3)
    means[4] = 9.0
    k, off = apart(means)
    assert k == 4
    np.testing.assert_allclose(off, 9 + 1 / 15, rtol=1e-14)
    # s^2 about it is 15 - 1/15; the chance's bound of 0.547 is 15/16 x^2 = 0.728 s^2: x of 3.40
    for size, told in ((3.30 - 1 / 15, False), (3.50 - 1 / 15, True)):
        means[4] = size
        assert apart(means)[1].any() == told


@pytest.mark.parametrize("walk", [False, True])
def test_chance_makes_one_in_a_thousand(walk):
    """Of white noise and of a random walk: 0 to 12 of 5000, but for one case in 1000."""
    rng = np.random.default_rng(1)
    means = rng.normal(size=(5000, PARTS, 3))
    means = np.cumsum(means, axis=1) if walk else means
    assert sum(bool(apart(one)[1].any()) for one in means) <= 12


def test_all_parts_alike_but_one():
    """What is left of the squares is nothing but rounding, of either sign."""
    rng = np.random.default_rng(0)
    for at, size in zip(rng.integers(PARTS, size=300), 10 ** rng.uniform(-8, 2, 300), strict=True):
        means = np.tile(rng.normal(size=3), (PARTS, 1))
        means[at] += size
        k, off = apart(means)
        assert k == at
        np.testing.assert_allclose(off, size, rtol=1e-6)


def test_a_ramp_is_none():
    assert not apart(np.arange(16.0)[:, None] * np.ones(3))[1].any()


def test_a_slam_counts_as_what_it_adds_to_the_mean():
    """One sample of 1600: the mean is off by 1e-4/1600 rad/s."""
    r = readings(RATE, 43.0)
    one = apart_of(r)
    assert (one.t_from, one.t_to) == pytest.approx((40.0, 50.0))
    quiet = mean_and_variance(readings(0.0, 43.0))[1][:3]
    counted = mean_and_variance(r)[1][:3]
    # noise of a part's mean, 3e-8, is 0.05 of what the slam adds there; noise at low frequency
    # holds another share of it: sixteen parts, of which one has it, scatter by as much again
    assert np.all(np.sqrt(counted) > 0.9 * RATE / 1600)
    assert np.all(np.sqrt(counted) < 1.6 * RATE / 1600)
    assert np.all(np.sqrt(quiet) < 0.2 * RATE / 1600)
    (flag,) = rest_doubt(r)
    assert flag.startswith("from 40 to 50 s off the other readings: gyros by 0.2")


def test_windows_have_their_share_of_what_the_record_shows():
    """Of a window of 40 s a quarter lies apart; of one elsewhere nothing does."""
    r = readings(RATE, 43.0)
    off = RATE / 100  # of 100 samples
    for t_from, share in ((40.0, 0.25), (45.0, 0.125), (80.0, 0.0)):
        window = Dwell("p", t_from, t_from + 40.0, r)
        found = np.sqrt(around_variance(window)[:3])
        np.testing.assert_allclose(found, share * off, rtol=0.15)  # three sigmas of 0.05
        assert bool(around_doubt(window)) == bool(share)


def stepped(step, seed=0):
    """Ten windows of 16 s, in turn `step` above and below the mean."""
    rng, n = np.random.default_rng(seed), round(SPAN * HZ)
    w = 1e-6 * rng.normal(size=(n, 3))
    w += np.where(np.arange(n) * 10 // n % 2, -step, step)[:, None]
    f = np.tile([0.0, 9.81, 0.0], (n, 1)) + 1e-4 * rng.normal(size=(n, 3))
    r = ImuReadings(np.arange(1, n + 1) / HZ, w, f)
    return Dwell("p", 32.0, 48.0, r)


def test_windows_that_scatter_by_more_than_their_noise():
    """Noise of a window's mean is 1e-6/sqrt(160) = 8e-8; ten windows at +-1e-6 have a variance of
    10/9 e-12 (n - 1), which is to be stated, and accelerometers nothing."""
    dwell = stepped(1e-6)
    counted = around_variance(dwell)
    np.testing.assert_allclose(counted[:3], 1e-12 * 10 / 9, rtol=0.2)  # 2 sigma: 0.16 x 1.1
    assert not counted[3:].any()
    assert any("scatter by more" in flag for flag in around_doubt(dwell))


def test_a_disturbed_window_hides_no_scatter_of_the_others():
    """One of ten has a slam that moves its mean by ten times as much, and counts by its own: the
    nine at +-1e-6, five of one sign, scatter by 80/81 x 9/8 = 10/9 e-12."""
    dwell = stepped(1e-6)
    r = dwell.readings
    w = r.w_ib_b.copy()
    w[150] += 160 * 1e-5
    counted = around_variance(replace(dwell, readings=ImuReadings(r.t, w, r.f_b)))
    np.testing.assert_allclose(counted[:3], 1e-12 * 10 / 9, rtol=0.2)


def test_windows_of_noise_scatter_by_their_noise():
    found = [around_variance(stepped(0.0, seed)).any() for seed in range(40)]
    assert sum(found) <= 2  # chi-square of 27 beyond 49 is one in 170, of two triads
