"""Each error term comes back from its own textbook test, against formulas written out by hand.

Units are drawn: what a test must find is the unit's own constant (`UnitErrors`), whose spread
over units is tested in test_imu.py and here against the stated value.
"""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import chi2

from alignment import Site
from stand.imu import TERMS, Imu, ImuSpec, Temperature, TriadSpec, UnitErrors, load_imu, without
from stand.imu.model import Clock, streams
from stand.imu.preset import ClockSpec
from stand.motion.polynomial import Motion
from stand.physics.mjcf import load_model
from stand.physics.truth import Sampling, Truth
from stand.samples import ImuBlock, Sensed

G = 9.80665
DEG_H = 4.8481368e-6  # rad/s
EPS = np.finfo(float).eps
SIX = np.vstack([np.eye(3), -np.eye(3)]) * G  # specific force of the six positions


def spec_of(
    gyro: TriadSpec | None = None, accel: TriadSpec | None = None, **more: object
) -> ImuSpec:
    """The ideal unit with some terms."""
    ideal = load_imu("ideal")
    return replace(ideal, gyro=gyro or ideal.gyro, accel=accel or ideal.accel, **more)


def sensed(w: object, f: object, rate_hz: int, first: int = 0) -> Sensed:
    """Samples `first` + 1, ... with rates and forces (n, 3), or (3,) for all of n."""
    w, f = np.atleast_2d(w), np.atleast_2d(f)
    n = max(len(w), len(f))
    t_ns = (first + np.arange(1, n + 1)) * (1_000_000_000 // rate_hz)
    return Sensed(t_ns, np.broadcast_to(w, (n, 3)), np.broadcast_to(f, (n, 3)))


def rows(block: Sensed, a: int, b: int) -> Sensed:
    return Sensed(block.t_ns[a:b], block.w_ib_b[a:b], block.f_b[a:b])


def both(name: str, value: float, **more: float) -> ImuSpec:
    """One term, alike for gyros and accelerometers."""
    triad = TriadSpec(**{name: value}, **more)
    return spec_of(triad, triad)


# --- scale factor and its faults: rate steps


STEPS = np.linspace(-1.0, 1.0, 21)  # of the full range
RANGE = 7.0  # rad/s, about 400 deg/s


def rate_steps(spec: ImuSpec, seed: int, samples: int, rate_hz: int) -> tuple[np.ndarray, Imu]:
    """Means (21, 3) of the gyros over the steps, all axes turned at once."""
    imu = Imu(spec, seed, rate_hz)
    w = np.repeat(STEPS * RANGE, samples)[:, None] * np.ones(3)
    reported = imu.report(sensed(w, np.zeros(3), rate_hz)).w_ib_b
    return reported.reshape(len(STEPS), samples, 3).mean(axis=1), imu


def fitted(columns: list[np.ndarray], y: np.ndarray, sigma: float) -> tuple[np.ndarray, np.ndarray]:
    """Least squares by hand: coefficients (k, 3), and their standard deviations (k,)."""
    A = np.stack(columns, axis=1)
    cofactor = np.linalg.inv(A.T @ A)
    return cofactor @ A.T @ y, sigma * np.sqrt(np.diag(cofactor))


@pytest.mark.parametrize("seed", range(4))
def test_rate_steps_give_scale_factor(seed):
    noise, samples, rate = 4e-5, 500, 100
    spec = spec_of(TriadSpec(scale=500e-6, noise=noise))
    means, imu = rate_steps(spec, seed, samples, rate)
    sigma = noise * np.sqrt(rate / samples)  # of a mean: N / sqrt T
    (slope, offset), spread = fitted([STEPS * RANGE, np.ones(21)], means, sigma)
    given_scale = np.diag(imu.gyro_errors.matrix)
    assert np.abs(given_scale - 1).max() < 5 * 500e-6  # drawn with the stated deviation
    # 5 sigma over 12 values each: wrong once in 70 000
    assert (np.abs(slope - given_scale) < 5 * spread[0]).all()
    assert (np.abs(offset) < 5 * spread[1]).all()
    assert spread[0] < 2e-6  # the test sees the term: 500 ppm


def test_rate_steps_give_asymmetry():
    """Slope up 1 + a, slope down 1 - a."""
    noise, samples, rate = 4e-5, 500, 100
    spec = spec_of(TriadSpec(asymmetry=300e-6, noise=noise))
    means, imu = rate_steps(spec, 5, samples, rate)
    sigma = noise * np.sqrt(rate / samples)
    up, down = STEPS > 0, STEPS < 0
    (rising,), s = fitted([STEPS[up] * RANGE], means[up], sigma)
    (falling,), _ = fitted([STEPS[down] * RANGE], means[down], sigma)
    found = (rising - falling) / 2
    assert (np.abs(found - imu.gyro_errors.asymmetry) < 5 * s / np.sqrt(2)).all()
    assert (np.abs((rising + falling) / 2 - 1) < 5 * s / np.sqrt(2)).all()
    assert (np.abs(imu.gyro_errors.asymmetry) > 10 * s).any()  # the test can see it


def test_rate_steps_give_cubic_nonlinearity():
    noise, samples, rate = 4e-5, 500, 100
    spec = spec_of(TriadSpec(nonlinearity=200e-6, full_scale=RANGE, noise=noise))
    means, imu = rate_steps(spec, 6, samples, rate)
    sigma = noise * np.sqrt(rate / samples)
    w = STEPS * RANGE
    (slope, cubic), spread = fitted([w, w**3], means, sigma)
    given_part = imu.gyro_errors.nonlinearity
    # at the end of the range the error is that part of the range: n R = c R^3
    assert (np.abs(cubic * RANGE**2 - given_part) < 5 * spread[1] * RANGE**2).all()
    assert (np.abs(slope - 1) < 5 * spread[0]).all()
    assert (np.abs(given_part) > 10 * spread[1] * RANGE**2).any()


def test_nonlinearity_against_the_best_line_is_two_fifths():
    """x^3 - (3/5) x is 2/5 at the end: the best line through a cubic by hand."""
    spec = spec_of(TriadSpec(nonlinearity=200e-6, full_scale=RANGE))
    imu = Imu(spec, 1, 100)
    x = np.linspace(-1, 1, 20001)
    y = imu.report(sensed(x[:, None] * RANGE * np.ones(3), np.zeros(3), 100)).w_ib_b
    line = (x @ y) / (x @ x)
    end = (y - x[:, None] * line)[-1] / RANGE
    # the sums over 20001 points differ from the integrals by 1e-4
    np.testing.assert_allclose(end, 0.4 * imu.gyro_errors.nonlinearity, rtol=3e-4)


def test_saturation_off_leaves_the_nonlinearity():
    spec = without(load_imu("stim300"), ["range", "quantisation", "bandwidth", "white-noise"])
    spec = without(spec, ["bias-instability"])
    top = np.radians(400.0)
    imu = Imu(spec, 3, 100)
    line = Imu(without(spec, ["non-linearity"]), 3, 100)
    w = np.full((1, 3), 2 * top)
    bent = imu.report(sensed(w, np.zeros(3), 100))
    straight = line.report(sensed(w, np.zeros(3), 100))
    # n (2 R)^3 / R^2 = 8 n R, up to scale factor and axes of 1e-3
    np.testing.assert_allclose(
        bent.w_ib_b - straight.w_ib_b, [8 * top * imu.gyro_errors.nonlinearity], rtol=2e-2
    )
    assert not bent.saturated.any()


# --- axes


def axes_of(spec: ImuSpec, seed: int) -> np.ndarray:
    """Sensing axes in b: row i is what gyro i says of unit rates about X1, Y1, Z1."""
    imu = Imu(spec, seed, 100)
    return imu.report(sensed(np.eye(3), np.zeros(3), 100)).w_ib_b.T


def test_misalignment_turns_the_case_and_keeps_right_angles():
    tilt = 1e-3
    axes = axes_of(spec_of(TriadSpec(misalignment=tilt)), 8)
    lengths = np.linalg.norm(axes, axis=1)
    second_order = 10 * tilt**2
    assert np.abs(lengths - 1).max() < second_order
    for i, k in ((0, 1), (1, 2), (2, 0)):
        between = np.arccos(axes[i] @ axes[k] / lengths[i] / lengths[k])
        assert abs(between - np.pi / 2) < second_order
    # one rotation vector explains all three axes: x' = x + turn x x for each axis of the case
    turn = np.array([axes[1, 2], axes[2, 0], axes[0, 1]])
    np.testing.assert_allclose(np.cross(turn, np.eye(3)), axes - np.eye(3), atol=second_order)
    # as drawn, right-handed: turned about Z1, the X1 gyro feels some of Y1
    drawn = tilt * np.array([s.standard_normal() for s in streams(8, "gyro", "misalignment")])
    np.testing.assert_allclose(turn, drawn, rtol=0, atol=4 * EPS)


def test_non_orthogonality_is_the_angle_between_two_axes():
    """Each pair stands at 90 deg less its drawn angle; the three angles spread as stated."""
    lean, found = 2e-4, []
    for seed in range(200):
        a = axes_of(spec_of(TriadSpec(non_orthogonality=lean)), seed)
        unit = a / np.linalg.norm(a, axis=1)[:, None]
        found.append(
            [np.pi / 2 - np.arccos(unit[i] @ unit[k]) for i, k in ((1, 2), (2, 0), (0, 1))]
        )
        # no turn of the triad as a whole: the lean is shared by both axes of a pair
        assert np.abs(a - a.T).max() < 4 * EPS
    sums = (np.array(found) ** 2).sum(axis=0) / lean**2
    low, high = chi2.ppf([1e-6, 1 - 1e-6], 200)  # 2e-6 per axis
    assert ((low < sums) & (sums < high)).all()


# --- tumble: what gravity does


def tumble(spec: ImuSpec, seed: int, samples: int = 1, rate_hz: int = 100) -> tuple[ImuBlock, Imu]:
    imu = Imu(spec, seed, rate_hz)
    return imu.report(sensed(np.zeros(3), np.repeat(SIX, samples, axis=0), rate_hz)), imu


def test_tumble_gives_g_sensitivity():
    """Half the difference of opposite positions: column j of the matrix, per axis of force."""
    noise, samples, rate = 1e-5, 2000, 100
    spec = spec_of(TriadSpec(g_sensitivity=54 * DEG_H / G, g2_sensitivity=1.8 * DEG_H / G**2,
                             noise=noise, bias=3e-3))  # fmt: skip
    reported, imu = tumble(spec, 2, samples, rate)
    up, down = reported.w_ib_b.reshape(2, 3, samples, 3).mean(axis=2)
    sigma = noise * np.sqrt(rate / samples) / np.sqrt(2) / G
    linear = ((up - down) / 2 / G).T  # [gyro, axis of force]
    assert (np.abs(linear - imu.gyro_errors.g_sensitivity) < 5 * sigma).all()
    square = (((up + down) / 2 - imu.gyro_errors.bias) / G**2).T
    assert (np.abs(square - imu.gyro_errors.g2_sensitivity) < 5 * sigma / G).all()
    # nine numbers, all different, as large as stated: 54 deg/h at 1 g
    size = np.abs(linear * G / DEG_H)
    assert len(set(linear.ravel())) == 9
    assert 10 < np.sqrt((size**2).mean()) < 120  # 9 draws: a fifth to twice the 54


def test_g2_sensitivity_by_hand():
    """1.8 deg/h/g^2 at 2 g is four times that at 1 g, whatever the sign of the force."""
    spec = spec_of(TriadSpec(g2_sensitivity=1.8 * DEG_H / G**2))
    imu = Imu(spec, 4, 100)
    f = np.array([[0, G, 0], [0, -G, 0], [0, 2 * G, 0]])
    w = imu.report(sensed(np.zeros(3), f, 100)).w_ib_b
    np.testing.assert_allclose(w[1], w[0], rtol=4 * EPS)
    np.testing.assert_allclose(w[2], 4 * w[0], rtol=4 * EPS)
    assert (np.abs(w[0]) < 5 * 1.8 * DEG_H).all()


def test_tumble_gives_the_second_order_term_of_accelerometers():
    """(f_up + f_down) / 2 = bias + K2 g^2; at 45 deg half of the K2 part."""
    noise, samples, rate = 1e-5, 1000, 100
    accel = TriadSpec(second_order=10e-6 / G, noise=noise, bias=1e-2)
    reported, imu = tumble(spec_of(accel=accel), 9, samples, rate)
    means = reported.f_b.reshape(2, 3, samples, 3).mean(axis=2)
    own = np.arange(3)
    middle = (means[0, own, own] + means[1, own, own]) / 2  # each axis up and down
    sigma = noise * np.sqrt(rate / samples) / np.sqrt(2)
    k2 = (middle - imu.accel_errors.bias) / G**2
    assert (np.abs(k2 - imu.accel_errors.second_order) < 5 * sigma / G**2).all()
    assert (np.abs(imu.accel_errors.second_order) > 10 * sigma / G**2).any()  # the test can see it
    quiet = Imu(spec_of(accel=TriadSpec(second_order=10e-6 / G)), 9, 100)
    f = quiet.report(sensed(np.zeros(3), np.full(3, G / np.sqrt(2)), 100)).f_b[0]
    half = quiet.accel_errors.second_order * G**2 / 2
    np.testing.assert_allclose(f - G / np.sqrt(2), half, rtol=0, atol=4 * EPS * G)
    assert (np.abs(half) < 5 * 10e-6 * G / 2).all()  # 10 ug at 1 g, drawn


def test_tumble_gives_bias_scale_and_axes_of_accelerometers():
    """The classic six positions: half sums are bias, half differences the matrix."""
    accel = TriadSpec(bias=1.9e-3 * G, scale=200e-6, misalignment=1e-3, non_orthogonality=2e-4)
    reported, imu = tumble(spec_of(accel=accel), 12)
    up, down = reported.f_b[:3], reported.f_b[3:]
    for row in (up + down) / 2:
        np.testing.assert_allclose(row, imu.accel_errors.bias, rtol=0, atol=8 * EPS * G)
    np.testing.assert_allclose((up - down).T / 2 / G, imu.accel_errors.matrix, atol=8 * EPS)


# --- bandwidth: sine


def response(bandwidth: float, frequency: float, rate_hz: int) -> complex:
    """Complex gain of the reported samples over the true instantaneous sine at their stamps."""
    imu = Imu(spec_of(TriadSpec(bandwidth=bandwidth)), 0, rate_hz)
    settle = int(rate_hz * 20 / bandwidth)  # e^-89 of the start is left
    cycles = max(1, round(frequency * rate_hz / frequency / rate_hz * 4))
    n = settle + round(cycles * rate_hz / frequency)
    edges = np.arange(n + 1) / rate_hz
    # the mean of sin over each interval in closed form
    turn = 2 * np.pi * frequency
    means = -np.diff(np.cos(turn * edges)) * rate_hz / turn
    y = imu.report(sensed(means[:, None] * np.ones(3), np.zeros(3), rate_hz)).w_ib_b[settle:, 1]
    t = edges[1:][settle:]
    A = np.stack([np.cos(turn * t), np.sin(turn * t)], axis=1)
    (a, b), *_ = np.linalg.lstsq(A, y, rcond=None)
    return complex(b, a)  # sin(wt + phi) = cos phi sin + sin phi cos


def test_amplitude_at_the_bandwidth_and_lag_below_it():
    """1/sqrt 2 at 20 Hz; slow sines late by 0.2251/bandwidth, and dt/2 of the mean itself."""
    rate, bandwidth = 4000, 20.0
    assert abs(response(bandwidth, bandwidth, rate)) == pytest.approx(0.70711, abs=1e-4)
    slow = 0.25  # Hz: the phase's next term is (f / bandwidth)^2 of the lag, 2e-4
    late = -np.angle(response(bandwidth, slow, rate)) / (2 * np.pi * slow)
    assert late == pytest.approx(0.2251 / bandwidth + 0.5 / rate, rel=3e-4)


def test_a_ramp_comes_late_by_the_stated_lag():
    """sqrt 2 / w0 = 0.2251 / 10 Hz = 22.5 ms: at 1 rad/s^2 the rate reads 22.5 mrad/s low."""
    imu = Imu(spec_of(TriadSpec(bandwidth=10.0)), 0, 1000)
    mean_time = (np.arange(4000) + 0.5) / 1000
    w = imu.report(sensed(mean_time[:, None] * np.ones(3), np.zeros(3), 1000)).w_ib_b
    # 3 s after the start e^-133 of it is left; 0.2251 has four digits
    assert (mean_time[-1] - w[-1]) == pytest.approx(0.02251, abs=1e-5)


def test_the_filter_starts_settled():
    imu = Imu(spec_of(accel=TriadSpec(bandwidth=5.0)), 0, 100)
    f = imu.report(sensed(np.zeros(3), np.tile([1.0, -G, 3.0], (200, 1)), 100)).f_b
    np.testing.assert_allclose(f, np.tile([1.0, -G, 3.0], (200, 1)), rtol=1e-12)  # 200 recursions


# --- temperature and ramp


@pytest.mark.parametrize("sensor", ["gyro", "accel"])
def test_temperature_ramp_gives_bias_and_scale_per_kelvin(sensor):
    """20 K in 100 s: bias at rest, and scale factor at an input of 2 above it."""
    profile = Temperature([10.0, 110.0], [25.0, 45.0])
    triad = TriadSpec(bias_temperature=18 * DEG_H, scale_temperature=50e-6)
    spec = spec_of(**{sensor: triad})
    n, channel = 130, {"gyro": "w_ib_b", "accel": "f_b"}[sensor]
    t = np.arange(1, n + 1)
    # 0.2 K/s from 10 s to 110 s, by hand
    warm = np.where(t <= 10, 0.0, np.where(t >= 110, 20.0, (t - 10) * 0.2))[:, None]
    still, turning = (Imu(spec, 7, 1, profile) for _ in range(2))
    errors = getattr(still, f"{sensor}_errors")
    rest = getattr(still.report(sensed(np.zeros((n, 3)), np.zeros(3), 1)), channel)
    moved = getattr(turning.report(sensed(np.full((n, 3), 2.0), np.full(3, 2.0), 1)), channel)
    np.testing.assert_allclose(rest, warm * errors.bias_temperature, rtol=0, atol=1e-17)
    by_scale = moved - rest - 2.0
    np.testing.assert_allclose(
        by_scale, 2.0 * warm * errors.scale_temperature, rtol=0, atol=8 * EPS
    )
    assert 0 < np.abs(errors.bias_temperature).max() < 5 * 18 * DEG_H
    assert 0 < np.abs(errors.scale_temperature).max() < 5 * 50e-6


def test_at_reference_temperature_nothing_changes():
    spec = both("bias_temperature", 1.0)
    at = replace(spec, reference_temperature=40.0)
    block = sensed(np.ones((3, 3)), np.ones(3), 1)
    np.testing.assert_array_equal(Imu(spec, 0, 1).report(block).w_ib_b, 1.0)
    warm = Imu(at, 0, 1, Temperature([0.0], [40.0])).report(block)
    np.testing.assert_array_equal(warm.w_ib_b, 1.0)
    np.testing.assert_array_equal(warm.f_b, 1.0)


def test_ramp_keeps_its_size_and_draws_its_sign():
    """1 deg/h/h: after an hour each axis has moved by 1 deg/h, up or down."""
    signs = []
    for seed in range(20):
        imu = Imu(spec_of(TriadSpec(ramp=DEG_H / 3600)), seed, 1)
        w = imu.report(sensed(np.zeros((1, 3)), np.zeros(3), 1, first=3599)).w_ib_b[0]
        np.testing.assert_allclose(np.abs(w), DEG_H, rtol=4 * EPS)
        signs.append(np.sign(w))
    assert 15 < (np.array(signs) > 0).sum() < 45  # of 60 coins: 5 sigma is 19


# --- saturation


def test_saturation_clips_and_flags_each_sample_and_channel():
    top = np.radians(400.0)
    spec = spec_of(TriadSpec(range=top), TriadSpec(range=10 * G))
    w = np.array([[0, 0, 0], [1.01 * top, 0, -1.5 * top], [top, -top, 0.5]])
    f = np.array([[0, 11 * G, 0], [0, 0, 0], [-10.5 * G, 1.0, 10 * G]])
    out = Imu(spec, 0, 100).report(sensed(w, f, 100))
    np.testing.assert_array_equal(out.w_ib_b, [[0, 0, 0], [top, 0, -top], [top, -top, 0.5]])
    np.testing.assert_array_equal(out.f_b, [[0, 10 * G, 0], [0, 0, 0], [-10 * G, 1.0, 10 * G]])
    hand = np.zeros((3, 6), bool)
    hand[1, 0] = hand[1, 2] = hand[0, 4] = hand[2, 3] = True  # at the range itself: not beyond
    np.testing.assert_array_equal(out.saturated, hand)


def test_noise_saturates_too():
    """At 0.999 of the range with a noise of 0.001: 15.9 % of the samples are beyond."""
    spec = spec_of(TriadSpec(range=1.0, noise=1e-4))
    n = 20_000
    out = Imu(spec, 5, 100).report(sensed(np.full((n, 3), 0.999), np.zeros(3), 100))
    part = out.saturated[:, :3].mean(axis=0)
    assert (np.abs(part - 0.158655) < 5 * np.sqrt(0.1587 * 0.8413 / n)).all()
    assert out.w_ib_b.max() == 1.0
    assert not out.saturated[:, 3:].any()


# --- quantisation


def test_resolution_rounds_each_sample():
    """Error uniform over one step: greatest half a step, variance lsb^2 / 12."""
    lsb, n = 6.11e-5 * np.pi / 180, 30_000
    rng = np.random.default_rng(3)
    w = rng.normal(0, 1000 * lsb, (n, 3))
    out = Imu(spec_of(TriadSpec(resolution=lsb)), 0, 200).report(sensed(w, np.zeros(3), 200))
    steps = out.w_ib_b / lsb
    # multiples of a step: 5000 steps of rounding each
    assert np.abs(steps - np.rint(steps)).max() < 5000 * 4 * EPS
    error = (out.w_ib_b - w) / lsb
    assert np.abs(error).max() <= 0.5 + 1e-9
    # x^2 of a uniform error has variance 1/180: 5 sigma of its mean
    assert (np.abs((error**2).mean(axis=0) - 1 / 12) < 5 * np.sqrt(1 / 180 / n)).all()
    quarters = np.array([np.histogram(e, 4, (-0.5, 0.5))[0] for e in error.T])
    uneven = ((quarters - n / 4) ** 2 / (n / 4)).sum(axis=1)
    assert (uneven < chi2.ppf(1 - 1e-6, 3)).all()


def test_increments_do_not_add_up_their_rounding():
    """After 1e5 samples the sum of increments is still within one step of the integral."""
    lsb, rate, n = 0.39342 * np.pi / 180 / 3600, 200, 100_000
    rng = np.random.default_rng(4)
    w = rng.normal(0.3, 0.2, (n, 3)) * lsb * rate  # a fraction of a step per sample
    imu = Imu(spec_of(TriadSpec(increment_lsb=lsb), increments=True), 0, rate)
    steps = np.concatenate(
        [imu.report(rows(sensed(w, np.zeros(3), rate), a, a + 5000)).increments(rate)[0]
         for a in range(0, n, 5000)]
    )  # fmt: skip
    whole = steps / lsb
    assert np.abs(whole - np.rint(whole)).max() < 1e-9  # whole steps, up to rounding
    behind = np.cumsum(whole, axis=0) - np.cumsum(w / rate / lsb, axis=0)
    assert np.abs(behind).max() <= 0.5 + 1e-6  # 1e5 sums of rounding, 3e4 steps long
    # rounding each sample instead would have lost far more
    alone = np.cumsum(np.rint(w / rate / lsb) - w / rate / lsb, axis=0)
    assert (np.abs(alone[-1]) > 20).all()


def test_output_decides_which_rounding_holds():
    both_given = TriadSpec(resolution=0.5, increment_lsb=1e-3)
    block = sensed(np.full((1, 3), 0.7004), np.zeros(3), 100)
    rate = Imu(spec_of(both_given), 0, 100).report(block).w_ib_b
    np.testing.assert_allclose(rate, 0.5, rtol=4 * EPS)
    increments = Imu(spec_of(both_given, increments=True), 0, 100).report(block)
    np.testing.assert_allclose(increments.increments(100)[0], 7e-3, rtol=4 * EPS)


# --- size effect: each accelerometer at its own place, on the spinning stand


OUTER = 3  # joint: turns about up; at zero X1 is north, Y1 up, Z1 east
ARM_NORTH, ARM_EAST = 0.06, 0.04  # of the instrument's point, read off the drawing
W_EARTH = 7.292115e-5


@pytest.fixture(scope="module")
def model():
    return load_model()


def spin(rate: float, acceleration: float, duration: float) -> Motion:
    """The outer axis alone: angle w t + a t^2 / 2 from zero."""
    coefficients = np.zeros((3, 1, 6))
    coefficients[:, 0, OUTER] = acceleration / 2, rate, 0.0
    return Motion(np.array([0.0, duration]), coefficients)


def at_places(model, places, motion, edges, sampling=Sampling.INSTANT, latitude=90.0) -> Sensed:
    truth = Truth(model, Site(np.radians(latitude)), np.asarray(places, dtype=float))
    stamps = np.round(edges[1:] * 1e9).astype(np.int64)
    return truth.sensed(motion, edges, stamps, sampling)


@pytest.mark.parametrize("sampling", list(Sampling))
def test_spin_pulls_each_accelerometer_by_its_own_radius(model, sampling):
    """-w^2 r on X1 and Z1 with their own r; at the pole Earth's rotation adds 2 W w r inward."""
    w = 3.0
    places = [[0.03, 0.01, 0.02], [0.05, 0.07, -0.06], [-0.02, 0.04, 0.05]]
    felt = at_places(model, places, spin(w, 0, 10), np.array([1.0, 1.01, 1.02]), sampling)
    reported = Imu(load_imu("ideal"), 0, 100).report(felt).f_b
    inward = w**2 + 2 * W_EARTH * w
    # X1 sits 0.03 further north, Z1 0.05 further east; up feels gravity wherever it sits
    hand = [-inward * (ARM_NORTH + 0.03), 9.8321849, -inward * (ARM_EAST + 0.05)]
    np.testing.assert_allclose(reported, [hand, hand], rtol=0, atol=5e-8)  # g has 7 decimals


def test_angular_acceleration_is_felt_across_the_arm(model):
    """about up, east goes to north: X1 feels +a east, Z1 feels -a north; from rest no w^2."""
    a = 2.0
    places = [[0, 0, 0.1], [0, 0, 0.1], [0.1, 0, 0]]
    edges = np.array([0.0, 1e-9])  # an instant after the start: w^2 r is 4e-18
    felt = at_places(model, places, spin(0, a, 10), edges, latitude=90.0).f_b[0]
    hand = [a * (ARM_EAST + 0.1), 9.8321849, -a * (ARM_NORTH + 0.1)]
    # the Earth's Coriolis term at 2e-9 rad/s is far below g's seven decimals
    np.testing.assert_allclose(felt, hand, rtol=0, atol=5e-8)


def test_without_size_effect_all_sit_at_the_point(model):
    spec = spec_of(places=np.diag([0.03, 0.04, 0.05]))
    assert not without(spec, ["size-effect"]).places.any()
    edges = np.array([1.0, 1.01])
    point = Truth(model, Site(0.8)).sensed(spin(3, 0, 10), edges, [1010000000], Sampling.MEAN)
    none = Truth(model, Site(0.8), without(spec, ["size-effect"]).places)
    np.testing.assert_array_equal(
        none.sensed(spin(3, 0, 10), edges, [1010000000], Sampling.MEAN).f_b, point.f_b
    )


# --- clock: latency, offset, jitter, on a motion of constant acceleration


RATE = 100
ALPHA = 0.5  # rad/s^2


def rates_through(model, clock: ClockSpec, n: int, sampling: Sampling, seed: int = 0):
    """Reported rates about Y1 less the true ones at the stamps, and the clock's edges."""
    imu = Imu(spec_of(clock=clock), seed, RATE)
    edges = imu.clock.edges(0, n)
    stamps = np.arange(1, n + 1) * (1_000_000_000 // RATE)
    motion = spin(1.0, ALPHA, (n + 1) / RATE)  # no longer: the fastest turn sets the quadrature
    truth = Truth(model, Site(0.0))  # at the equator Earth's rotation has nothing about up
    w = imu.report(truth.sensed(motion, edges, stamps, sampling)).w_ib_b[:, 1]
    return w - (1.0 + ALPHA * np.arange(1, n + 1) / RATE), edges


@pytest.mark.parametrize(("sampling", "own"), [(Sampling.INSTANT, 0.0), (Sampling.MEAN, 0.005)])
def test_latency_times_acceleration(model, sampling, own):
    """4 ms late: the rate reads 0.5 rad/s^2 x 4 ms low, and half an interval more as a mean."""
    late, _ = rates_through(model, ClockSpec(latency=4e-3), 200, sampling)
    # the first sample's interval begins before the motion: held at its start
    np.testing.assert_allclose(late[1:], -ALPHA * (4e-3 + own), rtol=0, atol=1e-12)


def test_clock_offset_grows_with_time(model):
    """A clock that is 50 ppm fast in samples reaches t (1 + 50e-6): rate error a t 50e-6."""
    clock = ClockSpec(offset=50e-6)
    error, edges = rates_through(model, clock, 2000, Sampling.INSTANT, seed=3)
    offset = Imu(spec_of(clock=clock), 3, RATE).clock.offset
    assert 0 < abs(offset) < 5 * 50e-6
    np.testing.assert_allclose(error, ALPHA * np.arange(1, 2001) / RATE * offset, atol=1e-12)
    np.testing.assert_allclose(edges, np.arange(2001) / RATE * (1 + offset), rtol=4 * EPS)


def test_clock_offsets_spread_as_stated():
    offsets = [Clock(ClockSpec(offset=50e-6), s, 1).offset for s in range(300)]
    low, high = chi2.ppf([1e-6, 1 - 1e-6], 300)
    assert low < (np.array(offsets) ** 2).sum() / 50e-6**2 < high


def test_jitter_times_acceleration(model):
    """Variance of the rate error: (a x jitter)^2 for instants, by chi-square."""
    jitter, n = 2e-4, 2000
    error, edges = rates_through(model, ClockSpec(jitter=jitter), n, Sampling.INSTANT)
    low, high = chi2.ppf([1e-6, 1 - 1e-6], n)
    assert low < (error**2).sum() / (ALPHA * jitter) ** 2 < high
    tremble = edges[1:] - np.arange(1, n + 1) / RATE
    np.testing.assert_allclose(error, ALPHA * tremble, rtol=0, atol=1e-12)
    # a mean takes the middle of both its edges
    n = 300
    mean, edges = rates_through(model, ClockSpec(jitter=jitter), n, Sampling.MEAN)
    half = (edges[1:] - np.arange(1, n + 1) / RATE + edges[:-1] - np.arange(n) / RATE) / 2
    np.testing.assert_allclose(mean[1:], ALPHA * (half[1:] - 0.005), rtol=0, atol=1e-12)


def test_wild_jitter_never_turns_time_around():
    clock = Imu(spec_of(clock=ClockSpec(jitter=1.0)), 0, RATE).clock
    steps = np.diff(clock.edges(0, 5000))
    assert steps.min() >= 0.2 / RATE - 1e-12  # two clips of 0.4 toward each other
    assert steps.max() <= 1.8 / RATE + 1e-12


@given(st.lists(st.integers(1, 299), max_size=6))
def test_clock_edges_do_not_depend_on_the_blocks(cuts):
    spec = ClockSpec(offset=1e-4, jitter=1e-4, latency=1e-3)
    whole = Clock(spec, 1, RATE).edges(0, 300)
    clock = Clock(spec, 1, RATE)
    parts = [clock.edges(a, b) for a, b in pairwise(sorted({0, 300, *cuts}))]
    assert all(p[-1] == q[0] for p, q in pairwise(parts))
    joined = np.concatenate([parts[0][:1], *(p[1:] for p in parts)])
    assert joined.tobytes() == whole.tobytes()


@settings(max_examples=15)
@given(st.lists(st.integers(1, 399), max_size=5))
def test_truth_at_a_trembling_clock_does_not_depend_on_the_blocks(cuts):
    """Intervals of unequal lengths: each is parted for itself, so that blocks leave no trace."""
    places = np.diag([0.03, 0.04, 0.05])
    truth, motion = Truth(load_model(), Site(0.5), places), spin(1.0, ALPHA, 1.5)
    edges = Imu(spec_of(clock=ClockSpec(jitter=1e-4)), 1, 200).clock.edges(0, 400)
    stamps = np.arange(1, 401) * 5_000_000

    def felt(a: int, b: int) -> bytes:
        out = truth.sensed(motion, edges[a : b + 1], stamps[a:b], Sampling.MEAN)
        return np.hstack([out.w_ib_b, out.f_b]).tobytes()

    whole = felt(0, 400)
    assert b"".join(felt(a, b) for a, b in pairwise(sorted({0, 400, *cuts}))) == whole
    assert b"".join(felt(a, a + 1) for a in range(100)) == whole[: len(whole) // 4]


# --- every term, all at once


FULL = TriadSpec(
    bias=1e-2, instability=1e-3, noise=1e-3, random_walk=1e-4, ramp=1e-5, scale=1e-3,
    asymmetry=1e-3, nonlinearity=1e-3, misalignment=1e-3, non_orthogonality=1e-3,
    g_sensitivity=1e-4, g2_sensitivity=1e-5, second_order=1e-4, bias_temperature=1e-4,
    scale_temperature=1e-4, bandwidth=30.0, range=4.0, full_scale=4.0, resolution=1e-3,
    increment_lsb=1e-5,
)  # fmt: skip
EVERYTHING = spec_of(
    FULL,
    replace(FULL, range=30.0, full_scale=30.0),
    clock=ClockSpec(1e-4, 1e-4, 1e-3),
    places=np.diag([0.03, 0.04, 0.05]),
)
WARM = Temperature([0.0, 5.0], [20.0, 40.0])
MATRIX = {"scale", "misalignment", "non_orthogonality"}


def errors_of(spec: ImuSpec) -> list[UnitErrors]:
    imu = Imu(spec, 11, RATE, WARM)
    return [imu.gyro_errors, imu.accel_errors]


def test_the_full_unit_has_every_term():
    cleared = without(EVERYTHING, TERMS)
    plain = load_imu("ideal")
    for part in ("gyro", "accel", "clock"):
        own = getattr(cleared, part)
        others = ("full_scale", "bounded", "axes", "known")
        names = [n for n in type(own).__slots__ if n not in others]
        assert all(getattr(own, n) == getattr(getattr(plain, part), n) for n in names)
        assert all(getattr(getattr(EVERYTHING, part), n) != getattr(own, n) for n in names)
    assert not cleared.places.any()


@pytest.mark.parametrize("term", TERMS)
def test_switching_a_term_off_leaves_all_other_constants(term):
    switched = set(TERMS[term])
    for full, less in zip(
        errors_of(EVERYTHING), errors_of(without(EVERYTHING, [term])), strict=True
    ):
        for name in UnitErrors.__slots__:
            a, b = getattr(full, name), getattr(less, name)
            if name in switched:
                assert not b.any()
                assert a.all()
            elif name != "matrix" or not switched & MATRIX:
                assert a.tobytes() == b.tobytes()
        scale = np.diag(full.matrix)
        if "scale" in switched:
            np.testing.assert_array_equal(np.diag(less.matrix), 1.0)
            np.testing.assert_allclose(less.matrix, full.matrix / scale[:, None], atol=EPS)
        elif switched & MATRIX:
            np.testing.assert_array_equal(np.diag(less.matrix), scale)


@pytest.mark.parametrize("term", ["white-noise", "bias-instability", "random-walk"])
def test_switching_a_process_off_takes_away_that_process_alone(term):
    """On a unit without filter, clip and rounding the reports differ by the process itself."""
    names = ["white-noise", "bias-instability", "random-walk"]
    linear = without(EVERYTHING, ["bandwidth", "range", "quantisation"])
    block = sensed(np.random.default_rng(1).normal(size=(500, 3)), np.ones(3), RATE)
    full = Imu(linear, 2, RATE).report(block)
    less = Imu(without(linear, [term]), 2, RATE).report(block)
    only = without(linear, [t for t in TERMS if t != term])
    alone = Imu(only, 2, RATE).report(sensed(np.zeros((500, 3)), np.zeros(3), RATE))
    assert term in names
    for name in ("w_ib_b", "f_b"):
        difference = getattr(full, name) - getattr(less, name)
        assert np.abs(getattr(alone, name)).min() > 0
        # two roundings of values of a few units
        np.testing.assert_allclose(difference, getattr(alone, name), rtol=0, atol=1e-14)


@pytest.mark.parametrize("term", ["clock-offset", "jitter", "latency"])
def test_clock_terms_are_switched_one_by_one(term):
    full, less = (Imu(s, 2, RATE).clock for s in (EVERYTHING, without(EVERYTHING, [term])))
    a, b = full.edges(0, 50), less.edges(0, 50)
    if term == "clock-offset":
        np.testing.assert_allclose(a - b, np.arange(51) / RATE * full.offset, atol=4 * EPS)
    elif term == "latency":
        np.testing.assert_allclose(a - b, -1e-3, rtol=0, atol=4 * EPS)
    else:
        assert less.offset == full.offset
        np.testing.assert_allclose(b, np.arange(51) / RATE * (1 + full.offset) - 1e-3, atol=EPS)


@pytest.mark.parametrize("increments", [False, True])
@settings(max_examples=15)
@given(cuts=st.lists(st.integers(1, 3999), max_size=6))
def test_the_full_model_gives_the_same_bytes_whatever_the_blocks(increments, cuts):
    spec = replace(EVERYTHING, increments=increments)
    rng = np.random.default_rng(2)
    block = sensed(rng.normal(0, 2, (4000, 3)), rng.normal(0, 12, (4000, 3)), RATE)

    def joined(edges: list[int]) -> bytes:
        imu = Imu(spec, 6, RATE, WARM)
        parts = [imu.report(rows(block, a, b)) for a, b in pairwise(edges)]
        return b"".join(
            np.concatenate([getattr(p, name) for p in parts]).tobytes()
            for name in ("t_ns", "w_ib_b", "f_b", "saturated")
        )

    # 4000 samples: two refills of the slow grid of 1024 values, two samples apart
    assert joined(sorted({0, 4000, *cuts})) == joined([0, 4000])


def test_two_units_in_one_process_do_not_influence_each_other():
    names = ("stim300", "ln200s", "mpu9250")
    block = sensed(np.random.default_rng(5).normal(size=(300, 3)), np.full(3, G), RATE)

    def report(imu: Imu, a: int) -> bytes:
        out = imu.report(rows(block, a, a + 50))
        return out.w_ib_b.tobytes() + out.f_b.tobytes()

    alone = {}
    for name in names:
        imu = Imu(load_imu(name), 1, RATE)
        alone[name] = [report(imu, a) for a in range(0, 300, 50)]
    units = {name: Imu(load_imu(name), 1, RATE) for name in reversed(names)}
    mixed = {name: [] for name in names}
    for a in range(0, 300, 50):
        for name, imu in units.items():
            mixed[name].append(report(imu, a))
    assert mixed == alone
