"""How far a mean can be trusted, against closed forms and chi-square bounds."""

from math import cos, radians, sin

import numpy as np
import pytest
from scipy import signal
from scipy.stats import chi2

from alignment.errors import NotAtRest, TooShort
from alignment.noise import (
    BLOCKS,
    believed,
    block_means,
    check_at_rest,
    drift_of,
    faint_doubt,
    mean_and_unstated,
    mean_and_variance,
    mean_variance,
    rest_doubt,
)
from alignment.options import Priors
from alignment.readings import Dwell, ImuReadings

G = 9.81


def test_block_means_by_hand():
    values = np.array([[1.0, 10], [3, 20], [5, 60], [7, 80], [12, 0]])
    # Five rows in two blocks: two and three.
    np.testing.assert_allclose(block_means(values, 2), [[2, 15], [8, 140 / 3]], rtol=1e-15)
    np.testing.assert_array_equal(block_means(values, 5), values)
    with pytest.raises(TooShort, match="5 samples: at least 6 are needed"):
        block_means(values, 6)


def test_mean_variance_by_hand():
    # Fewer samples than blocks: the textbook variance of the mean, s^2/n.
    values = np.array([[1.0, 2.0], [2.0, 2.0], [6.0, 8.0]])
    np.testing.assert_allclose(mean_variance(values), [7 / 3, 12 / 3], rtol=1e-15)


def test_textbook_variance_of_few_samples():
    columns, sigma, n = 1500, np.where(np.arange(1500) % 2, 3.0, 0.5), BLOCKS
    values = np.random.default_rng(n).normal(size=(n, columns)) * sigma
    total = (n - 1) * np.sum(mean_variance(values) / (sigma**2 / n))
    low, high = chi2.ppf([0.0025, 0.9975], (n - 1) * columns)
    assert low < total < high


def few(n, sigma=1.0, seed=0, hz=2.0):
    """Readings that scatter by `sigma` a sample, and the variances of their means."""
    w, f = sigma * np.random.default_rng([n, seed]).normal(size=(2, n, 3))
    readings = ImuReadings(np.arange(1, n + 1) / hz, w, f)
    return readings, mean_and_variance(readings)[1]


def test_few_samples_are_believed_no_further_than_their_sheet():
    """White noise N at 2 Hz: N^2/(n/2) of the mean, less than that no few samples show."""
    readings, shown = few(5)
    N = np.sqrt(np.array([np.median(shown[:3]), np.median(shown[3:])]) * 5 / 2)
    found = believed(shown, readings, *N)
    halves = shown[:3], shown[3:]
    want = np.concatenate([np.maximum(half, np.median(half)) for half in halves])
    np.testing.assert_allclose(found, want, rtol=1e-14)
    assert (found > shown).sum() == 2  # the least of each triad
    # of accelerometers nobody states any: (5 - 1)/(5 - 3)
    found = believed(shown, readings, N[0], 0.0)
    np.testing.assert_allclose(found, [*want[:3], *(2 * shown[3:])], rtol=1e-14)
    np.testing.assert_allclose(believed(shown[:3], readings, 0.0), 2 * shown[:3], rtol=1e-14)


def test_three_samples_need_a_sheet():
    readings, shown = few(3)
    least = believed(shown, readings, 1e3, 1e3)
    np.testing.assert_allclose(least, 1e6 / 1.5, rtol=1e-14)
    for walks in ((0.0, 0.0), (1e3, 0.0)):
        with pytest.raises(
            TooShort, match=r"3 samples until 1\.500 s .*: at least 4, or a sheet's"
        ):
            believed(shown, readings, *walks)
    # where all are the same, what rounding leaves of a variance is no noise
    still = ImuReadings(readings.t, np.full((3, 3), 0.1), np.full((3, 3), 9.81))
    np.testing.assert_array_equal(believed(np.full(6, 1e-33), still, 0.0, 0.0), np.full(6, 1e-33))


def test_many_samples_are_believed():
    readings, shown = few(BLOCKS)
    assert believed(shown, readings, 1e3, 0.0) is shown


@pytest.mark.parametrize("n", [7, 10, 20])
def test_squares_over_what_few_samples_show_come_to_one(n):
    """F(1, n - 1) has the mean (n - 1)/(n - 3), which is taken out: where nothing is stated."""
    found = []
    for seed in range(700):
        readings, shown = few(n, seed=seed)
        means = np.concatenate([readings.w_ib_b.mean(axis=0), readings.f_b.mean(axis=0)])
        found += (means**2 / believed(shown, readings, 0.0, 0.0)).tolist()
    # variance of F(1, m): 2 m^2 (m - 1)/((m - 2)^2 (m - 4)), of which the square is taken out
    m = n - 1
    spread = np.sqrt(2 * (m - 1) / (m - 4) / len(found))
    assert np.mean(found) == pytest.approx(1.0, abs=4 * spread)


def test_squares_over_the_sheets_noise_and_three_samples():
    """x, their variance in units of the sheet's, is of the density exp(-x): of 1/max(1, x) the
    mean is 1 - 1/e + E1(1) = 0.6321 + 0.2194."""
    found = []
    for seed in range(700):
        readings, shown = few(3, seed=seed)
        means = np.concatenate([readings.w_ib_b.mean(axis=0), readings.f_b.mean(axis=0)])
        found += (means**2 / believed(shown, readings, *[np.sqrt(0.5)] * 2)).tolist()
    spread = np.std(found) / np.sqrt(len(found))  # 0.018
    assert np.mean(found) == pytest.approx(0.8515, abs=4 * spread)


@pytest.mark.parametrize("n", [33, 48, 63, 100, 128, 960, 3001])
def test_variance_of_the_mean_of_white_noise(n):
    """Right on average whatever the length; to 25 %, as 30 ordinates tell it, each by itself."""
    columns, sigma = 1500, np.where(np.arange(1500) % 2, 3.0, 0.5)
    values = np.random.default_rng(n).normal(size=(n, columns)) * sigma
    ratio = mean_variance(values) / (sigma**2 / n)
    # Scatter: (13/15) sqrt(2/30) = 0.22 and 2/15 of a V that scatters by 0.8; fewer below n = 41.
    assert ratio.std() == pytest.approx(0.265 if n > 41 else 0.296, rel=0.1)
    assert ratio.mean() == pytest.approx(1, abs=4 * 0.28 / np.sqrt(columns))


def test_correlated_noise_is_seen():
    n, columns, a = 3200, 400, 0.9
    rng = np.random.default_rng(2)
    driven = signal.lfilter([1.0], [1.0, -a], rng.normal(size=(n + 200, columns)), axis=0)
    values = np.asarray(driven)[200:]
    estimate = float(np.mean(mean_variance(values)))
    white = float(np.mean(values.var(axis=0, ddof=1))) / n
    # Closed form for a first-order process; the factor over the white formula is (1+a)/(1-a) = 19.
    lags = np.arange(1, n)
    true = (1 + 2 * np.sum((1 - lags / n) * a**lags)) / (1 - a**2) / n
    assert true / white == pytest.approx(19.0, rel=0.02)  # scatter of 400 variances: 0.6 %
    # At order 20 the density is 1/(1 + (40 pi/3200 / 0.105)^2) = 0.88 of that at zero, and the
    # mean over 30 ordinates below it 0.95; its scatter is 0.27/sqrt(400) = 1.3 %, four times that.
    assert estimate / true == pytest.approx(0.96, abs=0.055)
    assert estimate > 10 * white


def test_jitter_of_the_angle_counts_once():
    """Rates of an angle that jitters by s: the mean is off by ``2 s^2/T^2``, as the ends stand.

    Block means would say 32 times as much: each is off by its own two ends.
    """
    n, columns, s = 6400, 400, 3.0
    rng = np.random.default_rng(12)
    rates = np.diff(s * rng.normal(size=(n + 1, columns)), axis=0)
    # V is s^2; the level is that of (2 pi j)^2 s^2/m at orders j, m = 4096 blocks: of the lower
    # ten sines and five pairs 0.37, of all 1.39, of which 13/15; the lower half counts in most.
    lower, whole = (
        13 / 15 * (2 * np.pi) ** 2 * np.mean(np.arange(1, k + 1) ** 2) / 4096 for k in (10, 20)
    )
    found = np.mean(mean_variance(rates)) / (s**2 / n**2)
    assert 2 + lower < found < 2 + 0.5 * lower + 0.5 * whole
    assert np.mean(rates.mean(axis=0) ** 2) == pytest.approx(2 * s**2 / n**2, rel=4 * 0.071)
    blocks = block_means(rates, BLOCKS).var(axis=0, ddof=1).mean() / BLOCKS
    assert blocks == pytest.approx(32 * 2 * s**2 / n**2, rel=0.1)


def test_a_drift_beyond_doubt_counts_as_itself():
    """A ramp of 8, 0 and 2 from end to end of noise whose mean is good to 0.05."""
    n = 400
    rng = np.random.default_rng(13)
    ramp = np.linspace(-0.5, 0.5, n)[:, None] * [8.0, 0.0, -2.0]
    found = drift_of(ramp + rng.normal(size=(n, 3)))
    # By 1/order weights the ramp is known to pi sqrt(2 / 1.527 / n) = 0.18: four times that.
    np.testing.assert_allclose(found, [8, 0, 2], rtol=0, atol=0.72)
    variance = mean_variance(ramp + rng.normal(size=(n, 3)))
    assert variance[0] == pytest.approx(64, rel=0.2)
    # Exact: a ramp without noise, in samples that are means of its parts.
    np.testing.assert_allclose(drift_of(ramp), [8, 0, 2], rtol=0.003)


def test_a_stated_drift_is_not_counted_twice():
    """8 from end to end: within three times 2.7, beyond three times 2.6; each axis by its own."""
    t, w, f = np.arange(1, 401) / 10, np.zeros((400, 3)), np.zeros((400, 3))
    f += np.linspace(-0.5, 0.5, 400)[:, None] * [8.0, -8.0, 0.0]
    readings = ImuReadings(t, w, f)
    stated = np.array([0.0, 0.0, 0.0, 2.7**2, 2.6**2, 2.7**2])
    (means, all_), (same, left) = mean_and_variance(readings), mean_and_unstated(readings, stated)
    np.testing.assert_array_equal(same, means)
    np.testing.assert_allclose(all_ - left, [0, 0, 0, 64, 0, 0], rtol=0.006, atol=1e-12)


def test_noise_is_seldom_taken_for_a_drift():
    """One record of 10 000 by the distribution of the mean of three F(1, 10): here of 5000."""
    rng = np.random.default_rng(14)
    taken = sum(bool(drift_of(rng.normal(size=(64, 3))).any()) for _ in range(5000))
    assert taken <= 3


def test_a_constant_bias_is_not_in_the_variance():
    rng = np.random.default_rng(3)
    values = rng.normal(size=(320, 3))
    # 1e6 costs six of sixteen digits of a scatter of order one: 1e-10, squared and summed 1e-9.
    np.testing.assert_allclose(
        mean_variance(values + np.array([0, 5, 1e6])), mean_variance(values), rtol=1e-8
    )


def at_rest(n=1020, rate=100.0, seed=4):
    """Rates of a few deg/h and forces of 1 g, noise far below the bounds of rest.

    10.2 s, so ten blocks whichever way the stamps round.
    """
    rng = np.random.default_rng(seed)
    t = 100.0 + np.arange(1, n + 1) / rate
    w = [1e-5, 5e-5, -3e-5] + 1e-5 * rng.normal(size=(n, 3))
    f = [0.0, G, 0.0] + 1e-3 * rng.normal(size=(n, 3))
    return t, w, f


def dwell_of(t, w, f):
    return Dwell("Y1 up", t[0] - (t[1] - t[0]), t[-1], ImuReadings(t, w, f))


def test_mean_and_variance_put_rates_first():
    t, w, f = at_rest()
    means, variances = mean_and_variance(ImuReadings(t, w, f))
    # sigma/sqrt(1020), four times; variances scatter by 25 %, three times.
    np.testing.assert_allclose(means[:3], [1e-5, 5e-5, -3e-5], rtol=0, atol=1.3e-6)
    np.testing.assert_allclose(means[3:], [0, G, 0], rtol=0, atol=1.3e-4)
    np.testing.assert_allclose(variances, [1e-13] * 3 + [1e-9] * 3, rtol=0.75)


def test_blocks_of_unequal_length_have_their_weight():
    rng = np.random.default_rng(5)
    t = np.arange(1.0, 51.0)
    w, f = rng.normal(size=(2, 50, 3))  # 18 blocks of two samples, 14 of one
    means, _ = mean_and_variance(ImuReadings(t, w, f))
    # rounding of 50 sums of order one
    np.testing.assert_allclose(means, [sum(c) / 50 for c in (*w.T, *f.T)], rtol=0, atol=1e-15)


def leaning(angle, n=1020):
    """Half of the time leant one way, half of it the other, by `angle` [rad] off the mean."""
    t, w, f = at_rest(n)
    lean = np.where(np.arange(n) < n // 2, 1.0, -1.0)[:, None]
    f = np.hstack([G * sin(angle) * lean, np.full((n, 1), G * cos(angle)), f[:, 2:]])
    return dwell_of(t, w, f)


def test_tilt_of_half_a_degree_is_the_bound():
    # Noise tilts a 1 s mean by 1e-3/9.81/sqrt(100) rad = 0.0006 deg.
    check_at_rest(leaning(radians(0.495)))
    with pytest.raises(NotAtRest, match=r"tilt 0\.51 deg.*allowed 0\.5 deg, 0\.1 deg/s"):
        check_at_rest(leaning(radians(0.505)))


def test_of_two_samples_no_noise_is_known():
    check_at_rest(leaning(radians(0.49), n=2))  # noise tilts by 1e-3/9.81 rad = 0.006 deg
    with pytest.raises(NotAtRest, match=r"tilt 0\.5[12] deg.*allowed 0\.5 deg, 0\.1 deg/s"):
        check_at_rest(leaning(radians(0.515), n=2))


def swinging(rate, axis, n=1020):
    t, w, f = at_rest(n)
    w[:, axis] += np.where(np.arange(n) < n // 2, rate, -rate)
    return dwell_of(t, w, f)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_rate_of_a_tenth_of_a_degree_per_second_is_the_bound(axis):
    # Noise moves a 1 s mean by 1e-5/sqrt(100) rad/s = 6e-5 deg/s.
    check_at_rest(swinging(radians(0.0995), axis))
    with pytest.raises(NotAtRest, match=r"rate 0\.10[01] deg/s off their means"):
        check_at_rest(swinging(radians(0.1005), axis))


def test_the_message_tells_when_and_where():
    t, w, f = at_rest()
    w[714:816, 1] += radians(1.0)  # the eighth block, from 107.15 s
    with pytest.raises(NotAtRest, match=r"^Y1 up: not at rest near 107\.[12] s: tilt 0\.00 deg"):
        check_at_rest(dwell_of(t, w, f))


def test_only_the_dwell_itself_must_be_at_rest():
    t, w, f = at_rest()
    w[:200, 2] += 0.5
    f[900:] = [G, 0.0, 0.0]
    check_at_rest(Dwell("Y1 up", 102.0, 109.0, ImuReadings(t, w, f)))


def test_biases_and_a_steady_turn_look_like_rest():
    t, w, f = at_rest()
    w_bias, f_bias = np.array([0.01, -0.02, radians(5.0)]), np.array([0.3, 0.2, -0.1])
    check_at_rest(dwell_of(t, w + w_bias, f + f_bias))


def test_noise_faster_than_a_second_is_averaged_out():
    t, w, f = at_rest()
    # An unfinished period leaves at most 1/(pi 20 Hz 1.02 s) = 1.6 %: 0.05 deg/s, 0.05 deg.
    wave = np.sin(2 * np.pi * 20.0 * t)[:, None]
    check_at_rest(dwell_of(t, w + radians(3.0) / np.sqrt(3) * wave, f + 0.5 * wave))


def test_no_specific_force_is_not_rest():
    t, w, f = at_rest()
    with pytest.raises(NotAtRest, match="specific force is zero"):
        check_at_rest(dwell_of(t, w, np.zeros_like(f)))


def test_short_dwells_are_still_split_in_two():
    t, w, f = at_rest(50)  # half a second
    check_at_rest(dwell_of(t, w, f))
    f[25:] = [G * sin(radians(2)), G * cos(radians(2)), 0.0]
    with pytest.raises(NotAtRest, match=r"tilt 1\.0"):
        check_at_rest(dwell_of(t, w, f))


def drifting(sigmas, seed):
    """Noise of 1, of a mean good to 0.05, with ramps of so many (3,) of their sigmas, 0.173."""
    n, rng = 400, np.random.default_rng(seed)
    ramp = np.linspace(-0.5, 0.5, n)[:, None] * np.asarray(sigmas) * np.sqrt(12 / n)
    w, f = ramp + rng.normal(size=(n, 3)), rng.normal(size=(n, 3))
    return ImuReadings(np.arange(1, n + 1) / 10, 1e-5 * w, [0.0, G, 0.0] + 1e-3 * f)


def test_a_drift_too_faint_to_count_is_said():
    """Of one axis 5 of its sigmas, 8.7 of the mean at either end: counted in a quarter at most of
    records, else said in most. Of noise one in a hundred is: of 400 more than 12 are 1 in 1000."""
    seen = [
        (rest_doubt(r), faint_doubt(r, Priors()))
        for r in (drifting([0, 5, 0], k) for k in range(40))
    ]
    assert not any(counted and said for counted, said in seen)
    assert sum(bool(counted) for counted, _ in seen) < 16
    assert sum(bool(counted or said) for counted, said in seen) > 30
    assert sum(bool(faint_doubt(drifting([0, 0, 0], k), Priors())) for k in range(400)) <= 12
    flag = next(said for _, (said, *_) in filter(lambda pair: pair[1], seen))
    assert flag.startswith("may drift from end to end, gyros by ")
