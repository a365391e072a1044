"""The integrating rival: kinematics against matrix exponentials, drift against closed forms."""

from dataclasses import replace
from math import atan2, cos, pi, radians, sin, sqrt

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm
from scipy.spatial.transform import Rotation
from scipy.stats import chi2, norm

from alignment import Dwell, ImuReadings, Options, Priors, Site
from alignment.errors import AlignmentError, NotAtRest, TooShort
from alignment.methods import integration
from alignment.methods.integration import (
    integrate,
    integrated_drift_covariance,
    rk4,
    rk4_steps,
    rk4_tracks,
)
from alignment.methods.two_sample import two_sample, two_sample_tracks
from alignment.quaternions import multiply, normalised, prefix_product

W = 7.292115e-5  # rad/s
G = 9.81
DEG_H = pi / 180 / 3600
ARW = pi / 180 / 60  # rad/sqrt(s) for 1 deg/rt-h
FIXED = settings(derandomize=True, deadline=None, max_examples=40)
N, E, D = np.eye(3)
LEVEL = np.column_stack([N, -D, E])  # X1 north, Y1 up, Z1 east
X1_UP = np.column_stack([-D, -N, E])


def skew(v):
    x, y, z = v
    return np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])


def turned(v):
    """Matrix of the turn by a rotation vector (3,), as an exponential series."""
    return expm(skew(v))


TILTED = turned([0, 0, -1.0]) @ turned([0, 0.3, 0]) @ turned([-0.6, 0, 0]) @ LEVEL


def w_ie(latitude):
    return np.array([W * cos(radians(latitude)), 0, -W * sin(radians(latitude))])


def site(latitude):
    return Site(radians(latitude), local_gravity=G)


def rest(C, latitude, seconds, rate=10.0, noise=None, bias=(0, 0, 0), nominal=True):
    n = round(seconds * rate)
    t = 50.0 + np.arange(1, n + 1) / rate
    w = np.tile(C.T @ w_ie(latitude) + bias, (n, 1))
    if noise is not None:
        rng, sigma = noise
        w = w + sigma * rng.normal(size=(n, 3))
    f = np.tile(C.T @ [0, 0, -G], (n, 1))
    told = Rotation.from_matrix(C) if nominal is True else nominal
    return Dwell("p", 50.0, 50.0 + seconds, ImuReadings(t, w, f), told)


def error(estimate, C):
    """Small rotation about n that takes truth to estimate [rad]."""
    return Rotation.from_matrix(estimate.as_matrix() @ C.T).as_rotvec()


def random_quaternions(seed, n):
    q = np.random.default_rng(seed).normal(size=(n, 4))
    return q / np.linalg.norm(q, axis=1)[:, None]


# --- quaternions -----------------------------------------------------------------------------


def test_hamilton_products_by_hand():
    i, j, k, one = np.eye(4)
    left = np.array([i, j, k, j, k, i, i, one])
    right = np.array([j, k, i, i, j, k, i, k])
    want = np.array([k, i, j, -k, -i, -j, -one, k])
    np.testing.assert_array_equal(multiply(left, right), want)
    # (1 + 2i)(3 + 4j) = 3 + 6i + 4j + 8k, and one row against many
    np.testing.assert_array_equal(multiply(one + 2 * i, 3 * one + 4 * j), [6, 4, 8, 3])
    np.testing.assert_array_equal(multiply(i, right), [multiply(i, row) for row in right])


def test_norm_correction_treats_each_row_by_itself():
    got = normalised(np.array([[0, 3.0, 0, 4.0], [2, 0, 0, 0], [1, 1, 1, 1]]))
    np.testing.assert_allclose(got, [[0, 0.6, 0, 0.8], [1, 0, 0, 0], [0.5] * 4], rtol=1e-15)


@FIXED
@given(st.integers(1, 90), st.integers(0, 2**32 - 1))
def test_prefix_product_is_the_sequential_one(n, seed):
    q = random_quaternions(seed, n)
    found = prefix_product(q)
    assert found.shape == (n, 4)
    total = Rotation.identity()
    for row, step in zip(found, q, strict=True):
        total = total * Rotation.from_quat(step)
        # 90 products round at 1e-16 each; the sign of a quaternion is free.
        assert (total.inv() * Rotation.from_quat(row)).magnitude() < 1e-13
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1, rtol=0, atol=4e-16)


def test_prefix_product_corrects_the_norm_and_leaves_its_argument():
    q = random_quaternions(1, 1000) * (1 + 1e-3)
    q.flags.writeable = False
    found = prefix_product(q)
    np.testing.assert_allclose(np.linalg.norm(found[1:], axis=1), 1, rtol=0, atol=4e-16)


def test_products_of_a_long_record():
    # Turns about one axis add: 100 000 steps of 1e-4 rad about (2, -1, 2)/3 make 10 rad.
    axis, n = np.array([2, -1, 2]) / 3, 100_000
    q = np.tile(np.append(axis * sin(0.5e-4), cos(0.5e-4)), (n, 1))
    found = prefix_product(q)[[0, 316, 49_999, n - 1]]
    want = Rotation.from_rotvec(np.outer([1e-4, 317e-4, 5.0, 10.0], axis))
    # A step rounds at 1e-16; a common rounding of all 1e5 steps would add up to 1e-11.
    assert (want.inv() * Rotation.from_quat(found)).magnitude().max() < 2e-11


# --- one step --------------------------------------------------------------------------------


def test_truncation_of_a_step_falls_with_the_fifth_power():
    axis = np.array([0.6, 0.0, -0.8])
    h = np.array([0.4, 0.2, 0.1, 0.05])
    q = rk4_steps(np.tile(axis, (4, 1)), h)
    along = np.outer(q[:, :3] @ axis, axis)
    np.testing.assert_allclose(q[:, :3], along, rtol=0, atol=1e-16)  # rounding
    short = h - [2 * atan2(row[:3] @ axis, row[3]) for row in q]
    # exp to fourth order in half the angle x/2: twice (x/2)^5/120 = x^5/1920 is missing. The next
    # term is of the relative size x^2/10; rounding 1e-16 against 1.6e-10.
    np.testing.assert_allclose(short, h**5 / 1920, rtol=0.02)
    np.testing.assert_allclose(short[:-1] / short[1:], 32, rtol=0.02)


def test_each_step_has_its_own_rate_and_length():
    w = np.array([[0.1, 0, 0], [0, -0.2, 0], [0.05, 0.1, 0.3]])
    h = np.array([0.1, 0.2, 0.05])
    got = Rotation.from_quat(rk4_steps(w, h)).as_matrix()
    want = [turned(a * b) for a, b in zip(w, h, strict=True)]
    # (0.04 rad)^5/1920 = 5e-11
    np.testing.assert_allclose(got, want, rtol=0, atol=6e-11)


# --- integration with the Earth taken out ----------------------------------------------------


@pytest.mark.parametrize("axis", [[1.0, 0, 0], [0, 0.6, 0.8], [-0.48, 0.6, -0.64]])
@pytest.mark.parametrize("latitude", [48.5, -33.0])
def test_constant_rate_against_exponentials(axis, latitude):
    n, h = 1200, 0.05
    w_b = radians(10) * np.array(axis) + TILTED.T @ w_ie(latitude)
    offset = np.array([0.01, 0, -0.02])
    t = 7.0 + np.arange(1, n + 1) * h
    readings = ImuReadings(t, np.tile(w_b + offset, (n, 1)), np.ones((n, 3)))
    ends = np.array([1, 400, 1200])
    start = Rotation.from_matrix(TILTED)
    found = integrate(readings, start, w_ie(latitude), offset, ends)
    for C, t in zip(found.as_matrix(), ends * h, strict=True):
        want = turned(-t * w_ie(latitude)) @ TILTED @ turned(t * w_b)
        # Truncation 1200 (0.0087)^5/1920 = 3e-11, rounding of 1200 products 1e-13.
        np.testing.assert_allclose(C, want, rtol=0, atol=5e-11)


def test_a_unit_at_rest_stays_where_it_is():
    # A day of Earth rotation at one sample per minute: 2 pi in inertial space.
    n = 1436
    readings = ImuReadings(
        60.0 * np.arange(1, n + 1), np.tile(TILTED.T @ w_ie(48.5), (n, 1)), np.ones((n, 3))
    )
    ends = np.array([100, 718, n])
    found = integrate(readings, Rotation.from_matrix(TILTED), w_ie(48.5), np.zeros(3), ends)
    for C in found:
        # Steps of 4.4 mrad: truncation 1436 (4.4e-3)^5/1920 = 1.2e-12; rounding 1436 of 1e-16.
        np.testing.assert_allclose(error(C, TILTED), 0, rtol=0, atol=2e-12)


def test_jittering_stamps_are_the_steps():
    rng = np.random.default_rng(3)
    steps = rng.uniform(0.002, 0.018, size=2000)
    t = 5.0 + np.cumsum(steps)
    w = np.array([0.02, -0.05, 0.03])
    readings = ImuReadings(t, np.tile(w, (2000, 1)), np.ones((2000, 3)))
    found = integrate(readings, Rotation.identity(), np.zeros(3), np.zeros(3), np.array([2000]))
    # The first step's length is not in the stamps: the mean interval stands for it.
    elapsed = t[-1] - t[0] + readings.interval
    np.testing.assert_allclose(found[0].as_matrix(), turned(w * elapsed), rtol=0, atol=1e-12)


@pytest.mark.parametrize("chunk", [1, 7, 128, 999, 1000])
def test_chunks_do_not_change_the_result(monkeypatch, chunk):
    rng = np.random.default_rng(4)
    t = np.cumsum(rng.uniform(0.01, 0.02, size=1000))
    readings = ImuReadings(t, rng.normal(size=(1000, 3)), np.ones((1000, 3)))
    args = (Rotation.from_matrix(TILTED), w_ie(48.5), np.array([0.1, 0, 0]))
    ends = np.array([1, 2, 7, 8, 14, 500, 999, 1000])
    whole = integrate(readings, *args, ends)
    monkeypatch.setattr(integration, "_CHUNK", chunk)
    parts = integrate(readings, *args, ends)
    # Only the order of products differs: 1000 roundings of 1e-16.
    assert (whole.inv() * parts).magnitude().max() < 1e-13


# --- drift after offset removal --------------------------------------------------------------


def step_after(dwell, after, dw_b):
    r = dwell.readings
    late = (r.t > dwell.t_from + after + 1e-6)[:, None]
    readings = ImuReadings(r.t, r.w_ib_b + late * dw_b, r.f_b)
    return Dwell(dwell.label, dwell.t_from, dwell.t_to, readings, dwell.nominal)


@pytest.mark.parametrize("C", [LEVEL, X1_UP, TILTED], ids=["level", "X1 up", "tilted"])
@pytest.mark.parametrize("latitude", [0.0, 48.5, -33.0])
def test_constant_bias_is_removed(C, latitude):
    dwell = rest(C, latitude, 60, bias=np.array([0.01, -0.02, 0.005]))
    (estimate,) = rk4([dwell], site(latitude), Options())
    # A bias of 0.02 rad/s in a mean of 100 rounds at 1e-17 or so, times 60 s.
    np.testing.assert_allclose(error(estimate.C_nb, C), 0, rtol=0, atol=1e-13)
    assert estimate.C_nb.single
    assert (estimate.method, estimate.t_from, estimate.t_to) == ("rk4", 50.0, 110.0)


@pytest.mark.parametrize("C", [LEVEL, X1_UP, TILTED], ids=["level", "X1 up", "tilted"])
def test_a_step_of_bias_after_the_offset_drifts_with_time(C):
    b = DEG_H * np.array([30.0, -50.0, 20.0])
    dwell = step_after(rest(C, 48.5, 70), 10.0, b)
    (estimate,) = rk4([dwell], site(48.5), Options())
    w_b = C.T @ w_ie(48.5)
    want = turned(-70 * w_ie(48.5)) @ C @ turned(10 * w_b) @ turned(60 * (w_b + b))
    np.testing.assert_allclose(estimate.C_nb.as_matrix(), want, rtol=0, atol=1e-13)
    # To first order bias times time: 1 deg/h for 60 s is 1'. The Earth turns by 5 mrad meanwhile.
    np.testing.assert_allclose(error(estimate.C_nb, C), C @ b * 60, rtol=0.01, atol=60 * DEG_H)


def test_signs_of_a_drift_by_hand():
    # Level, nose north: 60 deg/h for 60 s are 1 deg.
    for axis, name in enumerate(("roll", "yaw", "pitch")):
        b = np.zeros(3)
        b[axis] = 60 * DEG_H
        (estimate,) = rk4([step_after(rest(LEVEL, 48.5, 70), 10.0, b)], site(48.5), Options())
        angles = dict(zip(("roll", "yaw", "pitch"), np.degrees(estimate.angles), strict=True))
        for other, value in angles.items():
            # The Earth's turn meanwhile, 5 mrad, and 1 deg itself mix axes: below 0.02 deg.
            assert value == pytest.approx(1.0 if other == name else 0.0, abs=0.02)


def test_track_and_estimate_agree():
    rng = np.random.default_rng(5)
    dwell = rest(TILTED, -33, 40, noise=(rng, 1e-5))
    (track,) = rk4_tracks(dwell, site(-33), Options())
    (estimate,) = rk4([dwell], site(-33), Options())
    assert track.t[-1] == pytest.approx(90.0, abs=1e-9)
    assert len(track.t) == len(track.C_nb) == len(track.covariance)
    np.testing.assert_allclose(
        track.C_nb[-1].as_matrix(), estimate.C_nb.as_matrix(), rtol=0, atol=1e-14
    )
    np.testing.assert_allclose(track.covariance[-1], estimate.covariance, rtol=1e-12)
    # At the end of the offset window the drift is nothing, by construction, but for the area
    # between noise of N^2 = 1e-11 rad^2/s and the Earth's turn: (7.29e-5)^2 2e-11 10^3/12.
    k = int(np.argmin(np.abs(track.t - 60.0)))
    assert track.t[k] == pytest.approx(60.0, abs=1e-9)
    # First order: the means cancel but for the products of 1e-5 rad steps.
    np.testing.assert_allclose(error(track.C_nb[k], TILTED), 0, rtol=0, atol=1e-7)
    assert np.diag(track.covariance[k]) == pytest.approx(8.86e-18, rel=0.3)
    assert np.abs(track.covariance[k]).max() < 1e-8 * np.abs(track.covariance[-1]).max()


# --- drift covariance ------------------------------------------------------------------------


def test_drift_covariance_by_hand():
    got = integrated_drift_covariance(
        np.array([1.0, 4.0, 9.0]), np.array([0, 5, 10, 15, 60.0]), 10.0
    )
    # 5 (1 - 5/10); 0; 5 + 25/10; 50 + 2500/10
    want = np.outer([0, 2.5, 0, 7.5, 300.0], [1, 4, 9])
    np.testing.assert_allclose(got, want, rtol=1e-14, atol=1e-14)


def test_drift_covariance_of_simulated_noise():
    """White noise, summed by hand: its variance is chi-square about the prediction."""
    runs, n, rate, T0 = 4000, 300, 10.0, 10.0
    rng = np.random.default_rng(6)
    w = 2e-3 * sqrt(rate) * rng.normal(size=(runs, n))
    drift = np.cumsum(w - w[:, :100].mean(axis=1, keepdims=True), axis=1) / rate
    t = np.arange(1, n + 1) / rate
    at = np.array([9, 49, 89, 119, 199, 299])
    predicted = integrated_drift_covariance(np.array([4e-6, 1.0, 2.0]), t[at], T0)[:, 0]
    ratio = np.sum(drift[:, at] ** 2, axis=0) / predicted
    low, high = chi2.ppf([0.025 / 6, 1 - 0.025 / 6], runs)  # six times, family-wise 95 %
    assert np.all((low < ratio) & (ratio < high))


RUNS = 200
K = norm.ppf(1 - 0.025 / 4)  # two-sided, family-wise 95 % over the four cases below


@pytest.mark.parametrize(
    ("C", "arw"),
    [(LEVEL, 0.003), (X1_UP, 0.15), (TILTED, 0.003), (TILTED, 0.15)],
    ids=["level, laser", "X1 up, fibre", "tilted, laser", "tilted, fibre"],
)
def test_estimated_covariance(C, arw):
    """NEES of rk4 at the end of 25.6 s with an offset window of a quarter of it.

    The drift is one direction among the 31 whose scatter (of 32 equal blocks) gave the variance:
    per gyro the ratio is 31 Beta(1/2, 15), of mean exactly 1 and variance
    31^2 7.5/(15.5^2 16.5) = 1.818. The covariance is ``R diag R^T``, so this holds at any attitude.
    """
    rng = np.random.default_rng([7, round(1000 * arw), round(1000 * abs(C[0, 0]))])
    sigma = arw * ARW * sqrt(10.0) * np.array([0.4, 2.0, 1.0])  # unequal: transposes show
    bias = np.array([3e-5, -2e-5, 1e-5])
    dwells = [rest(C, 48.5, 25.6, noise=(rng, sigma), bias=bias) for _ in range(RUNS)]
    estimates = rk4(dwells, site(48.5), Options(offset_window=6.4))
    values = []
    for estimate in estimates:
        eta = error(estimate.C_nb, C)
        values.append(eta @ np.linalg.solve(estimate.covariance, eta))
    assert abs(np.mean(values) - 3.0) < K * sqrt(3 * 1.818 / RUNS)


@pytest.mark.parametrize(
    ("seconds", "arw", "published"),
    [(60, 0.15, 0.04), (60, 0.3, 0.09), (300, 0.15, 0.23), (300, 0.3, 0.47)],
)
def test_drift_has_the_published_size(seconds, arw, published):
    """methods.md section 1: 0.04-0.09 deg at 60 s, 0.23-0.47 deg at 300 s for 0.15-0.3 deg/rt-h."""
    late = seconds - 10.0
    closed = arw / 60 * sqrt(late + late**2 / 10.0)  # deg
    assert closed == pytest.approx(published, abs=0.005)  # rounding of the published figure
    rng = np.random.default_rng(8)
    sigma = arw * ARW * 1.0  # one sample per second
    dwells = [rest(LEVEL, 48.5, seconds, 1.0, (rng, sigma)) for _ in range(100)]
    eta = np.degrees([error(e.C_nb, LEVEL) for e in rk4(dwells, site(48.5), Options())])
    low, high = chi2.ppf([0.00625, 0.99375], 300)  # 100 runs, three axes; four cases, 95 %
    assert low < np.sum(eta**2) / closed**2 < high


# --- the two-sample rival, and priors ----------------------------------------------------------


def coning(latitude, half_angle, frequency, seconds, rate):
    """Level at rest but for a cone of that half angle about up; exact means over the samples.

    Rate in b of ``C exp(half_angle (cos, 0, sin)(W t))``, to second order in the angle.
    """
    h = 1 / rate
    t = 50.0 + np.arange(1, round(seconds * rate) + 1) * h
    W_c = 2 * pi * frequency
    # mean of cos and sin of the cone's phase over (t - h, t]
    phase, part = W_c * (t - 50.0 - h / 2), sin(W_c * h / 2) / (W_c * h / 2)
    w = np.tile(LEVEL.T @ w_ie(latitude), (len(t), 1))
    w[:, 0] += -half_angle * W_c * part * np.sin(phase)
    w[:, 2] += half_angle * W_c * part * np.cos(phase)
    f = np.tile(LEVEL.T @ [0, 0, -G], (len(t), 1))
    return Dwell("p", 50.0, 50.0 + seconds, ImuReadings(t, w, f), Rotation.from_matrix(LEVEL))


def test_two_samples_carry_the_cone_that_single_rates_miss():
    """At 5 Hz sampled with 50 Hz the rivals part by ``c^2 W (W h)^2/12``, but for the remainder.

    Savage (1998): the two-sample algorithm leaves ``c^2 W (W h)^4/60``.
    """
    c, W_c, h, T = radians(0.1), 2 * pi * 5, 0.02, 60.0
    dwell = coning(48.5, c, 5.0, T, 1 / h)
    first, second = (m([dwell], site(48.5), Options())[0] for m in (rk4, two_sample))
    between = Rotation.from_matrix(LEVEL).inv().apply((second.C_nb * first.C_nb.inv()).as_rotvec())
    want = c**2 * W_c * ((W_c * h) ** 2 / 12 - (W_c * h) ** 4 / 60) * T
    # next order of the coning series, (W h)^4 of it: 4 %
    assert abs(between[1]) == pytest.approx(want, rel=0.05)
    assert first.method == "rk4"
    assert second.method == "two-sample"


def test_rivals_agree_at_rest():
    rng = np.random.default_rng(12)
    dwell = rest(TILTED, -33, 40.3, noise=(rng, 1e-5))  # an odd number of samples
    (plain,), (paired,) = (m([dwell], site(-33), Options()) for m in (rk4, two_sample))
    # products of steps of 1e-5 rad, 400 of them
    np.testing.assert_allclose(paired.C_nb.as_matrix(), plain.C_nb.as_matrix(), atol=1e-7)
    np.testing.assert_array_equal(paired.covariance, plain.covariance)
    (track,) = two_sample_tracks(dwell, site(-33), Options())
    assert track.method == "two-sample"
    # an odd stretch before a track's point has one step of a single sample
    np.testing.assert_allclose(track.C_nb[-1].as_matrix(), paired.C_nb.as_matrix(), atol=1e-8)


def test_noise_that_comes_back_goes_round_an_area():
    """Lévy's of a bridge: ``N^2 t/sqrt(12)`` about each axis, 0.01 rad/sqrt(s) for 4 s 0.115 mrad,
    for what is integrated over the window that its own offset is of."""
    rng, walk, n, h = np.random.default_rng(8), 0.01, 200, 0.02
    t = np.arange(1, n + 1) * h
    ends = []
    for _ in range(400):
        w = walk / sqrt(h) * rng.normal(size=(n, 3))
        readings = ImuReadings(t, w, np.zeros((n, 3)))
        mean, start = w.mean(axis=0), Rotation.identity()
        found = integration.integrate(readings, start, np.zeros(3), mean, np.array([n]))
        ends.append(found.as_rotvec()[0])
    want = integration.enclosed(np.full(3, walk**2), np.array([n * h]))[0]
    assert np.sqrt(want) == pytest.approx(walk**2 * 4 / sqrt(12), rel=1e-3)  # and the Earth's
    # 400 squares with the kurtosis of an area, 21/5 of a normal's 3: 4 sigma are 0.36
    np.testing.assert_allclose(np.mean(np.square(ends), axis=0), want, rtol=0.36)


def test_drift_and_placement_by_stated_priors():
    """By hand: ``2 (0.01 deg/h 50 s)^2`` about each axis, and 30'' with 40''."""
    dwell = rest(TILTED, 48.5, 60)
    second = pi / 180 / 3600
    priors = Priors(1.0, 1.0, 1.0, 1.0, gyro_instability=0.01 * DEG_H, turn=30 * second)
    options = Options(priors=replace(priors, nominal=40 * second, azimuth=40 * second))
    (estimate,) = rk4([dwell], site(48.5), options)
    want = 2 * (0.01 * DEG_H * 50) ** 2 + (50 * second) ** 2
    np.testing.assert_allclose(estimate.covariance, want * np.eye(3), rtol=1e-9, atol=1e-20)


# --- refusals and flags ----------------------------------------------------------------------


def test_an_assumed_start_is_flagged():
    dwell = rest(X1_UP, 48.5, 20, nominal=None)
    (estimate,) = rk4([dwell], site(48.5), Options())
    assert "start attitude assumed: heading 0" in estimate.flags
    np.testing.assert_allclose(error(estimate.C_nb, X1_UP), 0, rtol=0, atol=1e-13)
    (estimate,) = rk4([rest(X1_UP, 48.5, 20)], site(48.5), Options())
    assert estimate.flags == ()


def test_too_much_drift_is_flagged():
    rng = np.random.default_rng(9)
    # 1 deg/rt-h over 600 s: sqrt(590 + 590^2/10)/60 = 3.1 deg after an offset window of 10 s, but
    # sqrt(599 + 599^2)/60 = 10 deg after one of 1 s. One sigma of a sigma from 32 blocks: 12.5 %.
    dwell = rest(LEVEL, 48.5, 600, 10.0, (rng, ARW * sqrt(10.0)))
    for window, sigma, flagged in ((10.0, 3.1, False), (1.0, 10.0, True)):
        (estimate,) = rk4([dwell], site(48.5), Options(offset_window=window))
        assert np.degrees(sqrt(estimate.covariance[2, 2])) == pytest.approx(sigma, rel=0.38)
        assert any("8 deg" in flag for flag in estimate.flags) == flagged


def test_refusals():
    with pytest.raises(TooShort, match=r"p: 8\.0 s of rest, the zero offsets need 10 s"):
        rk4([rest(LEVEL, 48.5, 8)], site(48.5), Options())
    with pytest.raises(AlignmentError, match="latitude: not known"):
        rk4([rest(LEVEL, 48.5, 20)], Site(None, local_gravity=G), Options())
    moved = step_after(rest(LEVEL, 48.5, 20), 15.0, np.array([0, radians(1), 0]))
    with pytest.raises(NotAtRest, match=r"rate 0\.7\d* deg/s off their means"):
        rk4([moved], site(48.5), Options())
    between = rest(turned([0, 0.6, 0]) @ LEVEL, 48.5, 20, nominal=None)
    with pytest.raises(AlignmentError, match="not one of the six positions"):
        rk4([between], site(48.5), Options())
