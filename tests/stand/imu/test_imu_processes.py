"""Random processes: sizes by closed forms and chi-square over ensembles; coning of increments."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import minimize_scalar
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from stand.imu import Imu, TriadSpec, load_imu
from stand.imu.processes import (
    DEFAULT_CORNERS,
    PEAK,
    BiasInstability,
    Drift,
    RandomWalk,
    WhiteNoise,
    gauss_markov_avar,
    plateau,
)
from stand.samples import Sensed

ARC_SECOND = np.pi / 180 / 3600
BOUNDS = [1e-7, 1 - 1e-7]  # of chi-square: 20 such tests err once in 250 000 choices of seeds


def streams(seed: int) -> list[np.random.Generator]:
    return [np.random.default_rng([seed, axis]) for axis in range(3)]


def still(n: int, rate_hz: int) -> Sensed:
    """Nothing to feel."""
    t_ns = np.arange(1, n + 1) * (1_000_000_000 // rate_hz)
    return Sensed(t_ns, np.zeros((n, 3)), np.zeros((n, 3)))


def assert_variance(values: np.ndarray, variance: float) -> None:
    """Independent normal `values` have that variance about zero."""
    low, high = chi2.ppf(BOUNDS, values.size)
    assert low < (values**2).sum() / variance < high


# --- Allan variance of one Gauss-Markov process


@pytest.mark.parametrize("tau", [0.01, 0.7, 1.8926, 20.0, 3000.0])
@pytest.mark.parametrize("corner", [1.0, 40.0])
def test_allan_variance_against_its_integral(tau, corner):
    """Half the mean square of the difference of adjacent means, from the covariance itself.

    ``1/tau^2 int (tau - |s|) (R(s) - R(s + tau)) ds`` over -tau..tau with ``R = exp(-|s|/T)``.
    """

    def covariance(s: float) -> float:
        return np.exp(-abs(s) / corner)

    def integrand(s: float) -> float:
        return (tau - abs(s)) * (covariance(s) - covariance(s + tau))

    near = min(tau, 40 * corner)  # beyond forty correlation times nothing is left: e^-40
    points = sorted({-tau, -tau + near, -near, 0.0, near, tau})
    total = sum(quad(integrand, a, b, epsabs=0, epsrel=1e-11)[0] for a, b in pairwise(points))
    # differences of 1 - tau/T lose the digits of T/tau: 100 at most here
    assert gauss_markov_avar(tau, corner) == pytest.approx(total / tau**2, rel=1e-9)


def test_peak_of_the_allan_deviation():
    """The known 0.617 sigma at 1.8926 T."""
    best = minimize_scalar(lambda x: -gauss_markov_avar(x, 1.0), bounds=(1, 3), method="bounded")
    assert best.x == pytest.approx(1.8926, abs=5e-4)
    assert np.sqrt(-best.fun) == pytest.approx(0.617, abs=5e-4)
    assert pytest.approx(1.8926) == PEAK


def test_allan_variance_far_from_the_peak():
    """tau/3T times 2 for short means, 2 T/tau for long ones; each with its next order."""
    assert gauss_markov_avar(1e-6, 1.0) == pytest.approx(2e-6 / 3 * (1 - 0.75e-6), rel=1e-11)
    assert gauss_markov_avar(1e6, 1.0) == pytest.approx(2e-6 * (1 - 1.5e-6), rel=1e-11)
    # series and closed form meet: 3 eps / x^2 of cancellation, 1e-2 x^5 left out
    below, above = gauss_markov_avar(np.array([0.01 * (1 - 1e-12), 0.01]), 1.0)
    assert below == pytest.approx(above, rel=2e-11)


# --- bias instability: plateau of one, stationary


def test_the_plateau_is_one_within_three_per_cent():
    tau = np.geomspace(DEFAULT_CORNERS[1], PEAK * DEFAULT_CORNERS[-2], 500)
    total = np.sum([gauss_markov_avar(tau, corner) for corner in DEFAULT_CORNERS], axis=0)
    height = np.sqrt(total) / plateau(DEFAULT_CORNERS)
    assert height.min() > 0.97
    assert height.max() < 1.03
    inner = tau > PEAK * DEFAULT_CORNERS[1]
    assert height[inner].min() == pytest.approx(1.0, abs=1e-4)  # 200 points of a flat minimum


@pytest.mark.parametrize("corners", [(5.0,), (1.0, 10.0), (2.0, 20.0, 200.0)])
def test_few_corners_have_a_plateau_too(corners):
    """One process peaks at one; the least of several, between the inner ones, is one."""
    tau = PEAK * (np.array(corners) if len(corners) < 3 else np.array(corners[1:-1]))
    total = np.sum([gauss_markov_avar(tau, corner) for corner in corners], axis=0)
    assert np.sqrt(total.min()) / plateau(corners) == pytest.approx(1.0, abs=1e-3)


@pytest.fixture(scope="module")
def ensemble() -> np.ndarray:
    """1200 bias instabilities, one value per second for 4096 s."""
    runs = [BiasInstability(streams(seed), DEFAULT_CORNERS, 1.0).next(4096) for seed in range(400)]
    return np.concatenate(runs)


@pytest.mark.parametrize("tau", [20, 60, 200, 700, 2048])
def test_ensemble_allan_variance_is_the_closed_form(ensemble, tau):
    """One pair of adjacent means per unit: 1200 independent squares, at five lengths.

    Values a second apart stand for their second: the closed form is met where tau >> 1 s.
    """
    first, second = (ensemble[:, a : a + tau].mean(axis=1) for a in (0, tau))
    closed = np.sum([gauss_markov_avar(tau, corner) for corner in DEFAULT_CORNERS])
    closed = closed / plateau(DEFAULT_CORNERS) ** 2
    # the process of 1 s, sampled at 1 s, is 2 % off at 20 s: far below the 22 % of the bounds
    assert_variance((second - first) / np.sqrt(2), closed)
    assert closed == pytest.approx(1.0, abs=0.05)


def test_ensemble_variance_is_the_sum_of_the_processes(ensemble):
    """Five processes of equal size: 5 / plateau^2, at every time."""
    for k in (0, 1, 600, 4095):
        assert_variance(ensemble[:, k], 5 / plateau(DEFAULT_CORNERS) ** 2)


def test_bias_instability_is_stationary_from_the_first_sample():
    """Ensemble of 2100 channels: variance at t = 0 as at t = 1 h, each as stated, by chi-square."""
    height, n = 2e-3, 3601
    triad = TriadSpec(instability=height)
    spec = replace(load_imu("ideal"), gyro=triad, accel=triad)
    first, last = [], []
    for seed in range(350):
        out = Imu(spec, seed, 1).report(still(n, 1))
        for values in (out.w_ib_b, out.f_b):
            first.append(values[0])
            last.append(values[-1])
    variance = 5 * (height / plateau(DEFAULT_CORNERS)) ** 2
    start, end = np.ravel(first), np.ravel(last)
    assert start.size == 2100
    assert_variance(start, variance)
    assert_variance(end, variance)
    # against each other: an F test of 2100 by 2100, 5 sigma of ln F = 2 / sqrt(2100)
    assert abs(np.log((start**2).sum() / (end**2).sum())) < 5 * 2 / np.sqrt(2100)
    # an hour leaves e^-0.36 of the slowest process and e^-3.6 of the next: 0.145 in all
    hand = (np.exp(-0.36) + np.exp(-3.6)) / 5
    assert np.corrcoef(start, end)[0, 1] == pytest.approx(hand, abs=5 / np.sqrt(2100))


def test_axes_are_independent():
    values = BiasInstability(streams(3), (1.0,), 10.0).next(5000)  # e^-10 apart: as good as white
    across = np.corrcoef(values)[[0, 0, 1], [1, 2, 2]]
    assert (np.abs(across) < 5 / np.sqrt(5000)).all()


@pytest.mark.parametrize("rate_hz", [1, 30, 100, 1000])
def test_the_slow_grid_holds_its_values(rate_hz):
    """A fiftieth of the shortest correlation time: 0.02 s at 1000 Hz is 20 samples."""
    hold = {1: 1, 30: 1, 100: 2, 1000: 20}[rate_hz]
    values = Drift(lambda _: streams(1), 1.0, 0.0, DEFAULT_CORNERS, rate_hz).take(10 * hold)
    parts = values.reshape(3, 10, hold)
    np.testing.assert_array_equal(parts, np.repeat(parts[:, :, :1], hold, axis=2))
    assert (np.diff(parts[:, :, 0], axis=1) != 0).all()


def test_nothing_asked_is_nothing_made():
    assert not Drift(lambda _: streams(1), 0.0, 0.0, DEFAULT_CORNERS, 100)
    assert Drift(lambda _: streams(1), 0.0, 1.0, DEFAULT_CORNERS, 100)


# --- random walks and white noise


@pytest.mark.parametrize("step", [0.02, 1.0, 7.0])
def test_random_walk_grows_with_time(step):
    """Variance at time t is t, from zero at the start; its steps do not remember."""
    ends = np.concatenate([RandomWalk(streams(s), step).next(50) for s in range(300)])
    for k in (1, 10, 50):
        assert_variance(ends[:, k - 1], k * step)
    early, late = ends[:, 24], ends[:, 49] - ends[:, 24]
    assert abs(np.corrcoef(early, late)[0, 1]) < 5 / np.sqrt(900)


def test_rate_random_walk_of_a_unit():
    """K = 3 deg/h/rt-h: after an hour 3 deg/h, 1 sigma."""
    deg_h = 4.8481368e-6
    spec = replace(load_imu("ideal"), gyro=TriadSpec(random_walk=3 * deg_h / 60))
    ends = [Imu(spec, seed, 1).report(still(3600, 1)).w_ib_b[-1] for seed in range(200)]
    assert_variance(np.ravel(ends), (3 * deg_h) ** 2)


@pytest.mark.parametrize(("rate_hz", "bandwidth"), [(2, np.inf), (20, 4.0)])
def test_angle_random_walk_of_a_unit(rate_hz, bandwidth):
    """0.15 deg/rt-h: the angle after a quarter of an hour has 0.075 deg, 1 sigma.

    A filter delays the noise but takes nothing from its integral over many of its time constants.
    """
    spec = replace(
        load_imu("ideal"), gyro=TriadSpec(noise=np.radians(0.15) / 60, bandwidth=bandwidth)
    )
    n = 900 * rate_hz
    block = still(n, rate_hz)
    angles = [Imu(spec, s, rate_hz).report(block).w_ib_b.sum(axis=0) / rate_hz for s in range(150)]
    assert_variance(np.ravel(angles), np.radians(0.075) ** 2)


def test_white_noise_in_pieces_is_the_same():
    whole = WhiteNoise(streams(4)).take(100)
    parts = WhiteNoise(streams(4))
    np.testing.assert_array_equal(np.hstack([parts.take(n) for n in (1, 42, 57)]), whole)


@pytest.mark.parametrize("kind", [BiasInstability, RandomWalk])
def test_slow_processes_in_pieces_are_the_same(kind):
    def made() -> BiasInstability | RandomWalk:
        return RandomWalk(streams(4), 0.1) if kind is RandomWalk else kind(streams(4), (1, 9), 0.1)

    whole, parts = made().next(100), made()
    np.testing.assert_array_equal(np.hstack([parts.next(n) for n in (1, 42, 57)]), whole)


# --- coning: a unit's increments, integrated by another's algorithm


HALF_ANGLE, FREQUENCY, RATE, SECONDS = np.radians(1.0), 5.0, 100, 120


def coned(t: np.ndarray) -> Rotation:
    """Attitude: a turn by the half angle about an axis that goes round in the Y-Z plane."""
    turn = 2 * np.pi * FREQUENCY * t
    axis = np.stack([np.zeros_like(t), np.cos(turn), np.sin(turn)], axis=1)
    return Rotation.from_rotvec(HALF_ANGLE * axis)


def coning_rate(t: np.ndarray) -> np.ndarray:
    """Body rate of `coned`, in closed form."""
    pulse = 2 * np.pi * FREQUENCY
    across = pulse * np.sin(HALF_ANGLE)
    along = np.full_like(t, 2 * pulse * np.sin(HALF_ANGLE / 2) ** 2)
    return np.stack([-along, -across * np.sin(pulse * t), across * np.cos(pulse * t)], axis=1)


def coning_means() -> np.ndarray:
    """Means of the rate over each interval: Gauss's rule with eight nodes, exact to rounding."""
    x, weight = np.polynomial.legendre.leggauss(8)
    middles = (np.arange(SECONDS * RATE) + 0.5) / RATE
    t = middles[:, None] + x / 2 / RATE
    rates = coning_rate(t.ravel()).reshape(len(t), 8, 3)
    return np.einsum("k,nkj->nj", weight / 2, rates)


def product(steps: np.ndarray) -> np.ndarray:
    """Matrix of all small turns in order."""
    total = Rotation.from_rotvec(steps).as_matrix()
    while len(total) > 1:
        odd = total[-1:] if len(total) % 2 else total[:0]
        total = np.concatenate([total[: len(total) // 2 * 2 : 2] @ total[1::2], odd])
    return total[0]


@pytest.fixture(scope="module")
def increments() -> np.ndarray:
    """delta-theta of an ideal unit that reports increments."""
    w = coning_means()
    n = len(w)
    spec = replace(load_imu("ideal"), increments=True)
    t_ns = np.arange(1, n + 1) * (1_000_000_000 // RATE)
    out = Imu(spec, 0, RATE).report(Sensed(t_ns, w, np.zeros((n, 3))))
    return out.increments(RATE)[0]


def test_the_closed_coning_rate_turns_the_closed_attitude():
    """The oracle's own check: central differences of the attitude over 2 us."""
    t, h = np.linspace(0, 0.4, 41), 1e-6
    turned = (coned(t - h).inv() * coned(t + h)).as_rotvec() / (2 * h)
    # differences: rounding 1e-16/h of the quaternions; h^2 terms are 1e-10
    np.testing.assert_allclose(turned, coning_rate(t), rtol=0, atol=1e-9)


def left_over(increments: np.ndarray, algorithm: str) -> float:
    """Attitude error after two minutes [arc second]."""
    p, d, n = increments[:-2], increments[1:-1], increments[2:]
    steps = {
        "none": d,
        "one": d + np.cross(p, d) / 12,
        "three": d + 7 / 120 * (np.cross(p, d) + np.cross(d, n)) - np.cross(p, n) / 60,
    }[algorithm]
    start, end = coned(np.array([1 / RATE, SECONDS - 1 / RATE]))
    found = start * Rotation.from_matrix(product(steps))
    return (found.inv() * end).magnitude() / ARC_SECOND


def test_coning_stays_within_an_arc_second(increments):
    """1 deg at 5 Hz, 100 Hz increments, 120 s; the order of the algorithms is part of it.

    With x = 2 pi 5/100 a bare sum loses (a^2 pulse / 2)(1 - sin x / x) a second: 1940'' in all.
    """
    x, pulse = 2 * np.pi * FREQUENCY / RATE, 2 * np.pi * FREQUENCY
    bare = HALF_ANGLE**2 * pulse / 2 * (1 - np.sin(x) / x) * SECONDS / ARC_SECOND
    assert bare == pytest.approx(1940, rel=0.01)
    assert left_over(increments, "none") == pytest.approx(bare, rel=2e-3)  # a^4 and the two ends
    assert left_over(increments, "one") == pytest.approx(38, abs=1)
    assert left_over(increments, "three") == pytest.approx(0.8, abs=0.1)
    assert left_over(increments, "three") < 1.0


def test_rounded_increments_still_follow_the_cone():
    """LN-200S steps of 0.39'': the accumulated rounding does not grow.

    What is left: half a step at either end, the algorithm's 0.8'', and the rounding times the
    wobble: it repeats with the cone, so 12 000 times 0.29 lsb x 5e-3 rad / 2 at worst, 3.4''.
    """
    w = coning_means()
    n, lsb = len(w), 2.0**-19
    spec = replace(load_imu("ideal"), gyro=TriadSpec(increment_lsb=lsb), increments=True)
    t_ns = np.arange(1, n + 1) * (1_000_000_000 // RATE)
    steps = Imu(spec, 0, RATE).report(Sensed(t_ns, w, np.zeros((n, 3)))).increments(RATE)[0]
    assert np.abs(steps.sum(axis=0) - w.sum(axis=0) / RATE).max() <= 0.5 * lsb * (1 + 1e-6)
    assert left_over(steps, "three") < 5
    # each rounded alone: X1 moves 25.07 steps a sample, and the 0.07 is lost 12 000 times
    assert left_over(lsb * np.rint(w / RATE / lsb), "three") > 200
