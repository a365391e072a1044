"""What rounding leaves of a mean: numbers by hand, and rests of coarse units."""

from math import exp, pi, sqrt

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from alignment import Dwell, ImuReadings, Options, Priors, Site
from alignment.methods.inertial import inertial
from alignment.methods.position_fit import rounding_covariance
from alignment.methods.positions import multi_position
from alignment.methods.triad import triad
from alignment.methods.two_gyro import two_gyro
from alignment.noise import mean_and_variance
from alignment.readings import Grain
from alignment.rounding import rounding_variance, shared_rounding, steps_of, waves, with_rounding

W, G = 7.292115e-5, 9.81
STEP = 0.02  # m/s^2: 2 mg
HERE = Site(np.radians(48.5), local_gravity=G)


def rest(f_b, noise=0.0, step=STEP, seed=1, n=600, hz=10):
    """A rest at latitude 48.5, X1 north, Y1 up, of accelerometers that are rounded; gyros fine."""
    rng = np.random.default_rng(seed)
    lat = np.radians(48.5)
    w = np.tile(W * np.array([np.cos(lat), np.sin(lat), 0.0]), (n, 1))
    f = np.asarray(f_b) + noise * rng.normal(size=(n, 3))
    t = np.arange(1, n + 1) / hz
    return ImuReadings(t, w + 1e-8 * rng.normal(size=w.shape), np.round(f / step) * step)


def dwell(readings):
    return Dwell("p", 0.0, float(readings.t[-1]), readings)


def known(readings, noise=0.0):
    return ImuReadings(
        readings.t, readings.w_ib_b, readings.f_b, grains=(Grain(), Grain(STEP, noise))
    )


@pytest.mark.parametrize("part", [0.0, 0.3, 0.5])
def test_waves_by_hand(part):
    """No noise: q^2/12 in all. Much: the first alone, (q/pi)^2/2 exp(-4 (pi part)^2)."""
    turns, squares = waves(STEP, part * STEP)
    assert turns[0] == pytest.approx(2 * pi / STEP)
    want = STEP**2 / 12 if part == 0 else (STEP / pi) ** 2 / 2 * exp(-4 * (pi * part) ** 2)
    # 200 harmonics leave out 0.3 %; the second wave is exp(-12 (pi 0.3)^2) = 2e-5 of the first
    assert squares.sum() == pytest.approx(want, rel=4e-3 if part == 0 else 1e-4)


def test_the_mean_of_a_noiseless_rest_may_be_anywhere_in_its_step():
    """Errors of 200 places, spread evenly over steps: their mean square is what is stated."""
    places = np.linspace(0, 7 * STEP, 200, endpoint=False)
    off = np.round(places / STEP) * STEP - places
    stated = rounding_variance(known(rest([0.0, G, 0.0])))
    np.testing.assert_allclose(stated, [0, 0, 0, *[np.mean(off**2)] * 3], rtol=1e-2)


@pytest.mark.parametrize("part", [0.15, 0.3, 0.45])
def test_noise_that_is_known_blurs_the_steps(part):
    """Means of 40 000 samples at 40 places between steps; half of the wave's square."""
    rng, sigma = np.random.default_rng(3), part * STEP
    places = (np.arange(40) + 0.5) / 40 * STEP
    f = places[:, None] + sigma * rng.normal(size=(40, 40_000))
    left = (np.round(f / STEP) * STEP).mean(axis=1) - places
    stated = rounding_variance(known(rest([0.0, G, 0.0], sigma), sigma))[3]
    # the means' own noise is 0.0015 steps beside 0.0026 to 0.17 steps
    fresh = (STEP**2 / 12 + sigma**2) / 40_000
    assert np.mean(left**2) == pytest.approx(stated + fresh, rel=0.25)


def test_noise_that_shows_in_the_numbers_needs_no_sheet():
    blurred = rest([0.003, G, 0.011], noise=STEP)
    assert rounding_variance(blurred)[3:].max() < 1e-6 * STEP**2
    # vibration blurs what the sheet's own noise would not
    assert rounding_variance(known(blurred, 1e-4 * STEP))[3:].max() < 1e-6 * STEP**2


def test_without_a_sheet_the_numbers_show_their_step():
    """Toggling between two levels, 0.2 steps of noise near an edge: anywhere in the step."""
    coarse = rest([0.5 * STEP, (490 + 0.5) * STEP, 0.4 * STEP], noise=0.2 * STEP)
    stated = rounding_variance(coarse)
    np.testing.assert_allclose(stated[3:], STEP**2 / 12, rtol=4e-3)
    assert not stated[:3].any()


def test_a_turn_between_rests_does_not_blur():
    first, second = rest([0.0, G, 0.0]), rest([G, 0.0, 0.0])
    both = ImuReadings(
        np.arange(1, 1201) / 10,
        np.concatenate([first.w_ib_b, second.w_ib_b]),
        np.concatenate([first.f_b, second.f_b]),
        grains=(Grain(), Grain(STEP, 0.0)),
    )
    np.testing.assert_allclose(rounding_variance(both)[3:], STEP**2 / 12, rtol=4e-3)


@pytest.mark.parametrize("method", [triad, two_gyro, inertial])
def test_tilt_of_a_coarse_unit(method):
    """2 mg: q/sqrt(12)/g = 0.59 mrad of tilt; of a sheet that knows 0.5 steps of noise 1 urad."""
    options = Options(priors=Priors(gyro_walk=1e-7, accel_walk=1e-5))
    readings = rest([0.0, G, 0.0], noise=1e-5)
    tilts = []
    for noise in (0.0, 0.5 * STEP):
        (estimate,) = method([dwell(known(readings, noise))], HERE, options)
        tilts.append(np.sqrt(estimate.covariance.diagonal()[:2]))
    np.testing.assert_allclose(tilts[0], STEP / sqrt(12) / G, rtol=0.01)
    assert tilts[1].max() < 0.05 * tilts[0].min()


def test_gyros_that_stick_tell_no_heading():
    """0.1 deg/s: q/sqrt(12) is 104 deg/h, of a horizontal rate of 9.97: 10.4 rad."""
    r = rest([0.0, G, 0.0], noise=1e-5, step=1e-6)
    coarse = ImuReadings(r.t, r.w_ib_b, r.f_b, grains=(Grain(np.radians(0.1), 1e-6), Grain()))
    priors = Priors(gyro_walk=1e-7, accel_walk=1e-5)
    assert with_rounding(priors, coarse).gyro_bias == pytest.approx(
        np.radians(0.1) / sqrt(12), rel=4e-3
    )
    (estimate,) = triad([dwell(coarse)], HERE, Options(priors=priors))
    want = np.radians(0.1) / sqrt(12) / (W * np.cos(np.radians(48.5)))
    assert np.sqrt(estimate.covariance[2, 2]) == pytest.approx(want, rel=0.01)
    assert estimate.undetermined


def test_positions_that_read_alike_share_what_is_left_or_not():
    """Two alike, one 0.5 steps off: exp(-(2 pi 0.5)^2/2) = 0.0072 of it."""
    left = np.tile([0.0, 0, 0, 4.0, 4.0, 4.0], (3, 1))
    means = np.zeros((3, 6))
    means[2, 3], means[:, 4] = 0.5 * STEP, [0.0, 1.0, 2.0]
    found = rounding_covariance(left, means, np.array([0.0, 0, 0, STEP, STEP, STEP]))
    far = 4 * exp(-((2 * pi * 0.5) ** 2) / 2)
    np.testing.assert_allclose(
        found[3], [[8, 4, far], [4, 8, far], [far, far, 4 + far]], rtol=1e-12
    )
    np.testing.assert_allclose(found[4], 4 * np.eye(3), atol=1e-12)
    assert not found[:3].any()
    assert np.linalg.eigvalsh(found).min() > -1e-12


@pytest.mark.parametrize(("apart", "doubt"), [(0.0, 0.0), (0.3, 0.0), (0.2, 0.15), (0.0, 1.0)])
def test_two_means_share_what_is_known_of_how_they_differ(apart, doubt):
    """Rounded at 20 000 places anywhere in a step, a second mean so far on, give or take."""
    rng = np.random.default_rng(6)
    one = rng.uniform(0, STEP, 20_000)
    two = one + STEP * (apart + doubt * rng.normal(size=one.shape))
    off = np.array([np.round(x / STEP) * STEP - x for x in (one, two)])
    ones = np.ones((2, 2)) - np.eye(2)
    found = shared_rounding(STEP, np.zeros(2), apart * STEP * ones, (doubt * STEP) ** 2 * ones)
    # products of two such numbers: 1/sqrt(20 000) of q^2/12, four times; waves left out 0.3 %
    np.testing.assert_allclose(found, np.cov(off, bias=True), atol=0.03 * STEP**2 / 12)
    if apart == doubt == 0:
        np.testing.assert_allclose(found, STEP**2 / 12, rtol=4e-3)


@pytest.mark.parametrize("heading", [0.0, 30.0])
def test_positions_that_read_alike_tell_no_heading_whatever_was_told(heading):
    """Four rests a quarter turn apart, gyros that stick to steps of 0.06 deg/s: nothing differs.

    Opposite ones are known to differ by W cos lat sqrt(2) = s, so rounding hides about
    ``q s sqrt(2/pi)`` of that variance: of two gyros sqrt(q s sqrt(2/pi)/8) is 8.6e-5 rad/s beside
    a horizontal rate of 4.83e-5. What is told of the heading was found again to 1 deg, or turned
    round.
    """
    step, lat = np.radians(0.06), np.radians(48.5)
    dwells = []
    for k in range(4):
        readings = rest([0.0, G, 0.0], noise=1e-3, seed=k, step=1e-9)
        t = readings.t + 100.0 * k
        w = np.tile([7 * step, -5 * step, -8 * step], (len(t), 1))
        w[0, k % 3] += step  # one sample: 1.7e-6 rad/s of the mean
        r = ImuReadings(t, w, readings.f_b, grains=(Grain(step, 1e-9), Grain()))
        told = Rotation.from_euler("y", 90 * k - heading, degrees=True)
        up = Rotation.from_matrix(np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]))
        dwells.append(Dwell(f"p{k}", 100.0 * k, 100.0 * k + 60, r, nominal=up * told))
    priors = Priors(gyro_bias=0.01, accel_bias=0.1, gyro_walk=1e-7, nominal=1e-5, azimuth=1e-5)
    found = multi_position(dwells, HERE, Options(priors=priors))[0]
    q, s = step, W * np.cos(lat) * sqrt(2)
    assert np.sqrt(found.covariance[2, 2]) * s / sqrt(2) == pytest.approx(
        sqrt(q * s * sqrt(2 / pi) / 8), rel=0.3
    )
    assert found.undetermined


def test_steps_of_channels_that_hardly_change():
    """One that stands has the step of its triad; of three that seldom change each has its least
    change, and where nothing changes nobody knows."""
    rng, n = np.random.default_rng(3), 400
    lively = 0.5 * rng.integers(-3, 4, size=n)
    still, once = np.full(n, 7.0), np.where(np.arange(n) == 200, 0.75, 0.25)
    w = np.column_stack([lively, still, lively[::-1]])
    f = np.column_stack([still, once, still])
    readings = ImuReadings(np.arange(1.0, n + 1), w, f)
    np.testing.assert_allclose(steps_of(readings), [0.5] * 6)
    np.testing.assert_allclose(rounding_variance(readings)[1], 0.5**2 / 12, rtol=0.01)
    none = ImuReadings(readings.t, np.full((n, 3), 1.0), np.full((n, 3), 2.0))
    np.testing.assert_array_equal(steps_of(none), np.zeros(6))


def test_a_channel_that_stays_on_one_count_is_known_to_its_ends():
    """Increments of 0.1 mrad, of which 60 s of Earth rate make 29 or 33 along two axes and none
    along the third: of that the mean is known to q/(sqrt(6) T), and those show more."""
    q, n, hz = 1e-4, 1200, 20
    t = np.arange(1, n + 1) / hz
    lat = np.radians(48.5)
    angle = np.outer(t, W * np.array([np.cos(lat), np.sin(lat), 0.0]))
    counts = np.diff(np.round(angle / q), axis=0, prepend=0.0)
    f = np.tile([0.0, G, 0.0], (n, 1))
    grains = (Grain(increment=q), Grain())
    means, variances = mean_and_variance(ImuReadings(t, counts * q * hz, f, grains=grains))
    assert means[2] == 0
    assert np.sqrt(variances[2]) == pytest.approx(q / np.sqrt(6) / 60, rel=1e-9)
    assert np.all(variances[:2] >= variances[2])
    assert not mean_and_variance(ImuReadings(t, counts * q * hz, f))[1][2]
