"""What a unit's errors do to a vehicle's turn, velocity and place: by hand and by differences."""

from dataclasses import replace

import numpy as np
import pytest
from drives import START, driven, squares
from scipy.stats import chi2

from alignment import ImuReadings, Priors
from alignment.constant_errors import constant_columns
from alignment.information.drift import GaussMarkov
from alignment.methods.drifting import Held
from alignment.methods.vectors.effects import (
    Effects,
    blocks_of,
    drift_shapes,
    effects,
    without_drifts,
)
from alignment.methods.vectors.kalman import kalman
from alignment.methods.vectors.method import options_of
from alignment.navigation import integrals
from stand.imu import load_imu
from stand.imu.priors import priors_of

RATE, T = 100, 4.0
NONE = Held(0.0, 0.0, 0.0, ())


def turning(rate, force):
    """Readings of an even turn and an even force in b, for 4 s."""
    n = round(T * RATE)
    return ImuReadings(np.arange(1, n + 1) / RATE, np.tile(rate, (n, 1)), np.tile(force, (n, 1)))


def effects_of(readings, priors, gyro=NONE, accel=NONE) -> Effects:
    return effects(felt_of(readings), priors, gyro, accel)


def felt_of(readings):
    return blocks_of(integrals(readings, np.linspace(0, T, round(T / 0.05) + 1)))


def test_scale_of_a_gyro_is_its_part_of_the_angle():
    """500 ppm of a turn of 2 rad is 206.26''; the other two gyros feel nothing."""
    found = effects_of(turning([0.0, 0.5, 0.0], [0.0, 0.0, 0.0]), Priors(gyro_scale=500e-6))
    arc_seconds = np.degrees(found.turn[-1]) * 3600
    np.testing.assert_allclose(arc_seconds, np.diag([0, 206.265, 0]), atol=1e-3)
    assert not found.velocity.any()


def test_a_gyro_that_leans_feels_the_turn_of_another():
    """1 mrad about Z1 of a turn at w about Y1: ``w m`` along -X1 of b, which turns with it:
    ``m sin(wt)`` and ``m (1 - cos(wt))`` in the axes of the start."""
    found = effects_of(turning([0.0, 0.5, 0.0], [0.0, 0.0, 0.0]), Priors(gyro_misalignment=1e-3))
    about_z = np.abs(found.turn[-1][:, 2])
    np.testing.assert_allclose(about_z, 1e-3 * np.abs([np.sin(2.0), 0, 1 - np.cos(2.0)]), atol=1e-7)


def test_scale_of_an_accelerometer_pushes_by_its_part():
    """200 ppm of 9.8 m/s^2 for 4 s: 7.84 mm/s, 15.68 mm."""
    found = effects_of(turning([0.0, 0.0, 0.0], [0.0, 9.8, 0.0]), Priors(accel_scale=200e-6))
    np.testing.assert_allclose(found.velocity[-1][:, 1], [0, 7.84e-3, 0], atol=1e-12)
    np.testing.assert_allclose(found.place[-1][:, 1], [0, 15.68e-3, 0], atol=1e-12)
    assert not found.turn.any()


def test_g_sensitivity_tilts_what_pushes():
    """A gyro about X1 that drifts by ``k f``: turn k f t; through the force f along Y1 a velocity
    of k f^2 t^2/2 along Z1 and a place of a third of it times t."""
    k, f = 1e-7, 9.8
    found = effects_of(turning([0.0, 0.0, 0.0], [0.0, f, 0.0]), Priors(gyro_g_sensitivity=k))
    own = 1  # X1's gyro by the force along Y1
    assert found.turn[-1][0, own] == pytest.approx(k * f * T, rel=1e-9)
    assert found.velocity[-1][2, own] == pytest.approx(k * f**2 * T**2 / 2, rel=1e-9)
    assert found.place[-1][2, own] == pytest.approx(k * f**2 * T**3 / 6, rel=1e-3)  # 80 blocks


def test_late_readings_leave_the_last_rate():
    """Of a rate that grows evenly to 0.4 rad/s, 2 ms late: 0.8 mrad are not felt yet."""
    n = round(T * RATE)
    t = np.arange(1, n + 1) / RATE
    w = np.zeros((n, 3))
    w[:, 0] = 0.1 * (t - 0.5 / RATE)
    found = effects_of(ImuReadings(t, w, np.zeros((n, 3))), Priors(lag=2e-3))
    np.testing.assert_allclose(found.turn[-1][:, 0], [0.8e-3, 0, 0], rtol=1e-6)


def test_accelerometers_that_come_later_and_a_fast_clock():
    """Of a force that grows evenly to 4 m/s^2: 3 ms of 1 m/s^3 for 4 s are 12 mm/s; of a clock 1e-3
    fast ``c a t^2/2``, 8 mm/s."""
    n = round(T * RATE)
    t = np.arange(1, n + 1) / RATE
    f = np.zeros((n, 3))
    f[:, 0] = t - 0.5 / RATE
    found = effects_of(ImuReadings(t, np.zeros((n, 3)), f), Priors(lag=1e-3, accel_later=2e-3))
    np.testing.assert_allclose(found.velocity[-1][:, 0], [12e-3, 0, 0], rtol=1e-6)
    found = effects_of(ImuReadings(t, np.zeros((n, 3)), f), Priors(clock=1e-3))
    np.testing.assert_allclose(found.velocity[-1][:, 0], [8e-3, 0, 0], rtol=1e-6)


def test_times_that_tremble_are_noise_of_what_changes():
    """1 ms at 100 Hz where the force changes by 2 m/s^3: 2 mm/s^2 a sample, 0.2 mm/s/rt-s."""
    n = round(T * RATE)
    t = np.arange(1, n + 1) / RATE
    f = np.zeros((n, 3))
    f[:, 0] = 2 * t
    blocks = felt_of(ImuReadings(t, np.zeros((n, 3)), f))
    simple, _, _ = without_drifts(Priors(jitter=1e-3), blocks, 1 / RATE)
    assert simple.accel_walk == pytest.approx(2e-4, rel=1e-6)
    assert simple.gyro_walk == 0


def test_effects_are_differences_of_the_integrals():
    """Of a wild motion, by readings that have each error by a hundredth of its sigma."""
    rng = np.random.default_rng(3)
    n, t = round(T * RATE), np.arange(1, round(T * RATE) + 1) / RATE
    waves = np.sin(2 * np.pi * np.outer(t, rng.uniform(0.1, 0.6, 6)) + rng.uniform(0, 6, 6))
    w, f = 0.5 * waves[:, :3], 5 * waves[:, 3:] + [0.0, 9.8, 0.0]
    priors = Priors(
        gyro_scale=1e-3,
        gyro_misalignment=1e-3,
        gyro_asymmetry=1e-3,
        gyro_g_sensitivity=1e-5,
        accel_scale=1e-3,
        accel_non_orthogonality=1e-3,
        accel_quadratic=1e-5,
    )
    found = effects_of(ImuReadings(t, w, f), priors)
    columns = constant_columns(w, f, priors)
    times = np.array([0.0, T])
    plain, part = integrals(ImuReadings(t, w, f), times), 0.01
    assert found.count == columns.shape[2]
    for k in range(found.count):
        off = part * columns[:, :, k]
        wrong = integrals(ImuReadings(t, w + off[:, :3], f + off[:, 3:]), times)
        tilt = (wrong.turn[1] @ plain.turn[1].T - plain.turn[1] @ wrong.turn[1].T) / 2
        turn = np.array([tilt[2, 1], tilt[0, 2], tilt[1, 0]]) / part
        for name, differed in (
            ("turn", turn),
            ("velocity", (wrong.velocity[1] - plain.velocity[1]) / part),
            ("place", (wrong.place[1] - plain.place[1]) / part),
        ):
            own = getattr(found, name)
            # blocks of 0.05 s for samples of 0.01 s: (w h)^2/24 and the middle of a bent force
            size = np.abs(own[-1]).max()
            np.testing.assert_allclose(own[-1][:, k], differed, atol=3e-3 * size, err_msg=name)
    assert n == len(t)


def test_stretches_join_to_the_whole():
    """Errors of each stretch from its own start, carried on by hand, are those of the whole."""
    readings = turning([0.1, 0.5, -0.2], [1.0, 9.8, 3.0])
    priors = Priors(gyro_scale=1e-3, accel_misalignment=1e-3, gyro_g_sensitivity=1e-6)
    often = integrals(readings, np.linspace(0, T, 81))
    every = effects(blocks_of(often), priors, NONE, NONE)
    at = np.array([0, 20, 50, 80])
    whole, sensed = every.at(at), often.at(at)
    parts = whole.between(sensed)
    turn, velocity, place = (np.zeros((3, whole.count)) for _ in range(3))
    for k in range(3):
        C, h = sensed.turn[k], sensed.duration[k + 1] - sensed.duration[k]
        dv = sensed.velocity[k + 1] - sensed.velocity[k]
        dr = sensed.place[k + 1] - sensed.place[k] - sensed.velocity[k] * h
        place = place + velocity * h + np.cross(turn, dr, axis=0) + C @ parts.place[k]
        velocity = velocity + np.cross(turn, dv, axis=0) + C @ parts.velocity[k]
        turn = turn + C @ parts.turn[k]
    np.testing.assert_allclose(turn, whole.turn[-1], atol=1e-15)
    np.testing.assert_allclose(velocity, whole.velocity[-1], atol=1e-14)
    np.testing.assert_allclose(place, whole.place[-1], atol=1e-14)


@pytest.mark.parametrize(
    ("drift", "variance"),
    [
        (Held(0.0, 2.0, 0.0, ()), lambda t: 4 * t),  # a walk of 2 per root second
        (Held(0.0, 0.0, 0.0, (GaussMarkov(3.0, 50.0),)), lambda t: 9 + 0 * t),
    ],
)
def test_shapes_of_a_drift_keep_its_variance(drift, variance):
    t = np.linspace(10, 90, 9)
    shapes = drift_shapes(drift, t, 100.0)
    assert shapes.shape[1] <= 16
    # 1 to 3 % of all is left out, of a walk's little at the start more than of the rest
    np.testing.assert_allclose((shapes**2).sum(axis=1), variance(t), rtol=0.1)
    assert (shapes**2).sum() == pytest.approx(variance(t).sum(), rel=0.03)


def test_a_constant_has_no_shapes():
    assert drift_shapes(NONE, np.arange(5.0), 5.0).shape == (5, 0)


def test_what_noise_hides_is_noise_and_what_lasts_walks():
    """An instability below a tenth of the noise's density needs no shape of its own."""
    priors = Priors(gyro_bias=1e-5, gyro_walk=1e-3, gyro_instability=1e-9, accel_walk=1e-3)
    blocks = felt_of(turning([0.0, 0.5, 0.0], [0.0, 9.8, 0.0]))
    simple, gyro, accel = without_drifts(priors, blocks, 1 / RATE)
    assert not accel.states
    assert not accel.walk
    assert simple.gyro_walk > priors.gyro_walk
    assert drift_shapes(gyro, np.arange(1.0), 100.0).shape[1] <= 16
    assert replace(simple, gyro_walk=priors.gyro_walk).accel_walk == priors.accel_walk


def test_a_filter_learns_nothing_from_its_own_changes():
    """What readings tell of an attitude is, to first order, what perfect ones do. A consumer unit's
    axes are off by 12 mrad: along changing estimates its heading came to 0.28 deg for 0.33."""
    options = options_of(priors_of(load_imu("icm42688p"), None), START)

    def sigmas(imu, seed):
        readings, fixes, start, _ = driven("aircraft-outage", imu, seed, 20)
        return np.sqrt(kalman(readings, fixes, start, options).covariance[-1].diagonal())

    perfect = sigmas("ideal", 0)
    for seed in (0, 5):
        np.testing.assert_allclose(sigmas("icm42688p", seed), perfect, rtol=0.1)


@pytest.mark.slow
def test_sigmas_of_a_full_circle_hold():
    """Before scale and axes were counted: 12 per freedom by the filter."""
    runs, found = 6, {}
    for run in squares("turning", "stim300", range(700, 700 + runs), 20, (0.5, 1.0)):
        for one in run:
            found.setdefault((one.solution, one.fix), []).append(one.square)
    judged = {key: values for key, values in found.items() if key[0] != "printed"}
    assert {solution for solution, _ in judged} == {"observing", "kalman"}
    for key, values in judged.items():
        assert len(values) == runs, key
        # 95 % of all four together, two-sided
        low, high = chi2.ppf([0.025 / 4, 1 - 0.025 / 4], 3 * runs)
        assert low < sum(values) < high, key
