"""The fine filter: its sigmas against floors and chance, what turns tell, what it refuses."""

import sys
from dataclasses import replace
from math import cos, pi, radians, sin, sqrt
from typing import NamedTuple

import numpy as np
import pytest
from rocking import Angle, G, Motion, errors
from scipy.spatial.transform import Rotation
from scipy.stats import chi2
from test_inertial import (
    ASTRAY,
    CAROUSEL,
    NO_BIAS,
    QUIET,
    SLOW,
    STILL,
    astray,
    campaign,
    dwell,
    exact,
    nees,
    one,
    site,
)

from alignment import Dwell, ImuReadings, Options, Priors, Site
from alignment.errors import AlignmentError, NotAtRest, PoleError, TooShort
from alignment.information.drift import GaussMarkov
from alignment.methods.fine import (
    METHOD,
    Model,
    _with_lines_of_orders,
    columns_of,
    error_matrices,
    filtered,
    fine,
    fine_tracks,
    innovations,
)
from alignment.methods.inertial import Noise, gravity_velocity, inertial, match
from alignment.methods.updates import ERRORS, Pass, Steps, _inverse, one_by_one
from alignment.readings import Grain
from alignment.strapdown import carry

W = 7.292115e-5  # rad/s
T, RATE = 60.0, 5.0
LAT = radians(48.5)
ARW = radians(2.3) * W * cos(LAT) * sqrt(T)  # white noise whose floor of heading is 2.3 deg
HALF_TURN = Motion(yaw=Angle(0.7, moves=((28.0, 4.0, pi),)), pitch=Angle(0.05), roll=Angle(-0.05))
LEVER = (0.1, 0.05, -0.08)
ROCKING = Motion(
    yaw=Angle(0.7, amplitude=0.04, frequency=0.13),
    pitch=Angle(0.1, amplitude=0.09, phase=1.0),
    roll=Angle(-0.05, amplitude=0.07, frequency=0.17, phase=0.3),
    lever=LEVER,
)
SLOW_CENTRED = replace(SLOW, lever=(0.0, 0.0, 0.0))


def floor(priors, motion, seconds=T):
    return priors.gyro_walk / (W * cos(radians(motion.latitude_deg)) * sqrt(seconds))


def sigma(estimate, axis=2):
    return float(np.sqrt(estimate.covariance[axis, axis]))


# --- exact readings ---------------------------------------------------------------------------


@pytest.mark.parametrize("latitude", [0.0, 48.5, -33.0, 75.0])
@pytest.mark.parametrize("motion", [STILL, CAROUSEL, HALF_TURN], ids=["still", "carousel", "half"])
def test_perfect_sensors_give_the_attitude(motion, latitude):
    motion = replace(motion, latitude_deg=latitude)
    estimate, error = one(motion, T, 20.0, replace(QUIET, gyro_bias=1e-7), method=fine)
    assert estimate.method == METHOD
    assert (estimate.t_from, estimate.t_to) == (100.0, 160.0)
    # Third order in the turn within two samples, (0.3 * 0.1)^3 of it in the fastest: below its
    # sigma by a hundred in the still.
    assert (np.abs(error) < 0.3 * np.sqrt(estimate.covariance.diagonal())).all()
    assert not estimate.flags


@pytest.mark.parametrize("latitude", [48.5, -33.0, 75.0])
def test_rocking_off_the_crossing_with_its_lever_arm_estimated(latitude):
    motion = replace(ROCKING, latitude_deg=latitude)
    stretch, C = exact(motion, 120.0, 100.0)
    run = filtered(stretch, site(motion), Options(priors=replace(QUIET, lever_arm=0.1)))
    error = errors(run.C_nb[-1].as_matrix()[None], C)[0]
    assert not run.flags
    assert (np.abs(error) < 2 * np.sqrt(run.covariance[-1].diagonal())).all()
    assert run.names == ("lever_arm",)
    # Exact readings: what is left is the integration's own order, a part of the sigma.
    assert (np.abs(run.constants[-1, 0] - LEVER) < 2 * run.sigmas[-1, 0]).all()
    assert run.sigmas[-1, 0].max() < 1e-3


def test_updates_are_as_coarse_as_the_gyros_walk_makes_an_arm():
    """``100 r^2 N^2 T`` of an arm known to r: 0.1 m, 1e-5 rad/sqrt(s) in 60 s are 77 um. The record
    begins at 100 s, which is no part of T."""
    stretch, _ = exact(SLOW_CENTRED, 60.0, 20.0)
    priors = Priors(gyro_walk=1e-5, accel_walk=1e-7, lever_arm=0.1)
    run = filtered(stretch, site(SLOW_CENTRED), Options(priors=priors))
    # at the end 600 updates know the displacement far better than one of them does: along the
    # vertical at least, across it the gyros' walk of a second adds g N/sqrt(3) = 57 um
    late = run.innovations.sigmas[-1] / sqrt(100 * 0.1**2 * 1e-5**2 * 60)
    assert late[2] == pytest.approx(1.0, abs=0.03)
    assert 1.0 < late.min() <= late.max() < sqrt(1 + (57 / 77) ** 2)


def test_rocking_with_an_unstated_lever_arm_is_remarked_and_still_right():
    estimate, error = one(ROCKING, 120.0, 100.0, QUIET, method=fine)
    assert any("sway beyond noise and lever arm" in flag for flag in estimate.flags)
    assert (np.abs(error) < 2 * np.sqrt(estimate.covariance.diagonal())).all()


# --- sigmas against closed forms --------------------------------------------------------------


def test_white_noise_at_rest_reaches_the_floor():
    """With perfect accelerometers the ends of the record tell all of the drift: 1.00 of it."""
    priors = Priors(gyro_walk=ARW, accel_walk=1e-6)
    estimate, _ = one(STILL, T, 10.0, priors, method=fine)
    coarse, _ = one(STILL, T, 10.0, priors)
    assert 1 < sigma(estimate) / floor(priors, STILL) < 1.01
    assert sigma(coarse) / sigma(estimate) == pytest.approx(sqrt(10 / 7), rel=0.01)


@pytest.mark.parametrize("latitude", [48.5, -33.0])
def test_constant_biases_at_rest_are_those_of_gyrocompassing(latitude):
    """``b/(W cos lat)`` in heading, ``b/g`` in tilt, and ``tan(lat) b_E/g`` joining them."""
    motion = replace(STILL, latitude_deg=latitude)
    priors = Priors(1e-6, 5e-3, gyro_walk=1e-9, accel_walk=1e-7)
    estimate, _ = one(motion, T, 10.0, priors, method=fine)
    lat = radians(latitude)
    tilt = 5e-3 / G
    heading = 1e-6 / (W * cos(lat))
    P = estimate.covariance
    # The walks are a thousandth of the biases.
    np.testing.assert_allclose(np.sqrt(P.diagonal()[:2]), tilt, rtol=0.005)
    joined = np.tan(lat) * tilt  # eta_N = -f_E/g, eta_D = tan(lat) f_E/g
    assert sqrt(P[2, 2]) == pytest.approx(np.hypot(heading, joined), rel=0.005)
    assert P[0, 2] == pytest.approx(-tilt * joined, rel=0.02)


def test_scale_errors_that_change_in_a_turn_are_in_the_covariance():
    """A unit aslant on a turn of 12 deg/s whose scale errors go by 90 ppm in 90 s, each its own.

    Taken for constants they leave 4.7 per degree of freedom; biases that nobody drew make less
    than one of what is stated.
    """
    motion = Motion(yaw=Angle(0.7, rate=radians(12)), pitch=Angle(0.35), roll=Angle(-0.4))
    t, w, f, C = motion.readings(90.0, 10.0, 100.0)
    told = Priors(1e-7, 1e-4, 90e-6, gyro_walk=1e-6, accel_walk=1e-5, gyro_scale_ramp=1e-6)
    rng = np.random.default_rng(7)
    squares = {0.0: [], 1e-6: []}
    for _ in range(24):
        scale = 1 + 1e-6 * rng.normal(size=3) * (t - t[0])[:, None]
        rates = w * scale + 1e-6 * sqrt(10) * rng.normal(size=w.shape)
        forces = f + 1e-5 * sqrt(10) * rng.normal(size=f.shape)
        for ramp, found in squares.items():
            priors = replace(told, gyro_scale_ramp=ramp)
            (e,) = fine([dwell(t, rates, forces)], site(motion), Options(priors=priors))
            error = errors(e.C_nb.as_matrix()[None], C)[0]
            found.append(error @ np.linalg.solve(e.covariance, error))
    freedom = 3 * 24
    blind, counted = (sum(found) / freedom for found in squares.values())
    assert blind > 3
    assert 0.1 < counted < chi2.ppf(0.999, freedom) / freedom


def test_a_walk_of_gyros_tells_no_tilt_from_an_accelerometers_bias():
    """At rest tilt is known to b/g for however long: 0.0186/9.809 = 1.9 mrad, or 0.109 deg.

    The reference walks by 4.36e-5 sqrt(3600) = 2.6 mrad off the level and passed for a turn that
    tells b: 0.07 and 0.05 deg were stated, and the walk's own ``g d^2/2`` was taken for b.
    """
    rng = np.random.default_rng(1)
    t, w, f, C = STILL.readings(3600.0, 1.0, 100.0)
    priors = Priors(1.967e-5, 0.0186, gyro_walk=4.36e-5, accel_walk=4e-4)
    w = w + priors.gyro_walk * rng.normal(size=w.shape)
    (estimate,) = fine([dwell(t, w, f)], site(STILL), Options(priors=priors))
    assert estimate.covariance is not None
    # a hundredth of the prior's information is left to each axis: half of it in the sigma
    np.testing.assert_allclose(np.degrees([sigma(estimate, k) for k in (0, 1)]), 0.109, rtol=0.01)
    off = errors(estimate.C_nb.as_matrix()[None], C)[0]
    assert np.abs(off[:2]).max() < radians(0.109) / 10  # these accelerometers have no bias


def test_half_turn_tells_bias_from_earth_rate():
    """Before it heading is known to b/(W cos lat), after it to noise alone."""
    priors = Priors(gyro_bias=2e-5, gyro_walk=1e-6, accel_walk=1e-5)
    level = replace(HALF_TURN, pitch=Angle(), roll=Angle())  # Y1 has no part in the others
    stretch, _ = exact(level, T, 10.0)
    run = filtered(stretch, site(level), Options(priors=priors))
    heading = np.sqrt(run.covariance[:, 2, 2])
    before, after = np.searchsorted(run.t, [127.9, 159.99])
    limit = 2e-5 / (W * cos(LAT))
    # Noise of 28 s adds 1.3 % in quadrature of little; the linearised bias is 0.4 rad of heading.
    noise = floor(priors, HALF_TURN, 28.0)
    assert heading[before] == pytest.approx(np.hypot(limit, noise), rel=0.01)
    # Two rests of 28 s, differenced, and the turn's 4 s between them.
    assert floor(priors, HALF_TURN) < heading[after] < 1.2 * floor(priors, HALF_TURN, 56.0)
    bias = run.sigmas[:, run.names.index("gyro_bias")]
    bias = bias[:, [0, 2]]  # X1 and Z1
    # Half the sum of two rests' means: ARW/sqrt(56 s), of 2e-5.
    assert bias[before].min() > 0.6 * 2e-5
    np.testing.assert_allclose(bias[after], 1e-6 / sqrt(56.0), rtol=0.1)


def test_turning_tells_bias_on_the_way():
    """The carousel's heading sigma falls to the floor while at rest it stays at the bias."""
    priors = Priors(gyro_bias=2e-6, gyro_walk=1e-7, accel_walk=1e-6)
    turning, _ = one(CAROUSEL, T, 10.0, priors, method=fine)
    resting, _ = one(STILL, T, 10.0, priors, method=fine)
    assert sigma(resting) == pytest.approx(2e-6 / (W * cos(LAT)), rel=0.02)
    assert 1 < sigma(turning) / floor(priors, CAROUSEL) < 1.25


def test_a_heading_that_may_turn_round_is_known_as_the_circle_says():
    """Bias of 0.414 of the horizontal rate, along as across: 20 million directions by NumPy's
    normal numbers have a root mean square of 0.4783 rad."""
    resting, _ = one(STILL, T, 10.0, Priors(gyro_bias=2e-5, gyro_walk=1e-6), method=fine)
    assert sigma(resting) == pytest.approx(0.4783, rel=0.01)


def test_scale_factor_error_of_a_turn_is_in_the_covariance():
    """0.1 % of the half turn alone is 3 mrad about the vertical, which Earth rate must find."""
    priors = Priors(gyro_bias=1e-6, gyro_scale=1e-3, gyro_walk=1e-6, accel_walk=1e-5)
    options = Options(priors=priors)
    t, w, f, C = HALF_TURN.readings(T, 10.0, 100.0)
    run = filtered(dwell(t, w * (1 + 1e-3), f), site(HALF_TURN), options)
    error = errors(run.C_nb[-1].as_matrix()[None], C)[0]
    assert run.names == ("gyro_bias", "gyro_scale")
    assert (np.abs(error) < 2 * np.sqrt(run.covariance[-1].diagonal())).all()


@pytest.mark.parametrize("method", [fine, inertial])
def test_readings_that_come_late_tell_where_a_turn_stood(method):
    """20 deg/s times a millisecond, about north: 3.491e-4 rad, by which a spin is found wrong."""
    late, turning = 1e-3, Motion(roll=Angle(0.3, rate=radians(20.0)))
    before = replace(turning, roll=Angle(0.3 - 3.491e-4, rate=radians(20.0)))
    t, w, f, _ = before.readings(T, 10.0)
    _, _, _, C = turning.readings(T, 10.0)
    knows, not_told = (
        method([dwell(t, w, f)], site(turning), Options(priors=replace(QUIET, lag=lag)))[0]
        for lag in (late, 0.0)
    )
    error = errors(knows.C_nb.as_matrix()[None], C)[0]
    assert error[0] == pytest.approx(-3.491e-4, rel=0.01)
    more = knows.covariance[0, 0] - not_told.covariance[0, 0]
    assert more == pytest.approx(3.491e-4**2, rel=1e-3)
    # about the axis that turns, and no other
    np.testing.assert_allclose(sigma(knows, 1), sigma(not_told, 1), rtol=1e-3)
    resting, _ = one(STILL, T, 10.0, replace(QUIET, lag=late), method=method)
    same, _ = one(STILL, T, 10.0, QUIET, method=method)
    np.testing.assert_allclose(resting.covariance, same.covariance, rtol=1e-9)


@pytest.mark.parametrize("method", [fine, inertial])
@pytest.mark.parametrize("of", ["gyros", "accelerometers"])
def test_of_a_spin_about_a_level_axis_only_accelerometers_that_come_late_tell(method, of):
    """Gyros of a steady rate read the same later on; gravity was 20 deg/s times 1 ms elsewhere."""
    late, turning = 1e-3, Motion(roll=Angle(0.3, rate=radians(20.0)))
    before = replace(turning, roll=Angle(0.3 - 3.491e-4, rate=radians(20.0)))
    t, w, f, C = turning.readings(T, 10.0)
    _, _, then, _ = before.readings(T, 10.0)
    gyros = of == "gyros"
    told = {"lag": late, "accel_later": -late} if gyros else {"accel_later": late}
    knows, not_told = (
        method([dwell(t, w, f if gyros else then)], site(turning), Options(priors=priors))[0]
        for priors in (replace(QUIET, **told), QUIET)
    )
    expected = 0.0 if gyros else 3.491e-4
    error = errors(knows.C_nb.as_matrix()[None], C)[0]
    assert error[0] == pytest.approx(-expected, abs=4e-6)
    more = knows.covariance[0, 0] - not_told.covariance[0, 0]
    # blocks of half a second turn by ten degrees: a thousandth of the whole is left
    assert np.sqrt(max(more, 0.0)) == pytest.approx(expected, abs=4e-6)


@pytest.mark.parametrize("method", [fine, inertial])
def test_of_a_spin_aslant_late_accelerometers_turn_heading_as_the_method_has_it(method):
    """37.4 deg/s about an axis 30 deg off level, 14 ms late: each tells its own error, which is the
    filter's where it knows axes to arc seconds, and takes gravity's 0.5 deg for other constants."""
    late = 14e-3
    turning = Motion(yaw=Angle(0.4), pitch=Angle(radians(30.0)), roll=Angle(0.3, rate=0.653))
    before = replace(turning, roll=Angle(0.3 - 0.653 * late, rate=0.653))
    t, w, _, C = turning.readings(T, 20.0)
    _, _, then, _ = before.readings(T, 20.0)
    own = {"accel_misalignment": 1.4e-5, "gyro_scale": 5e-6} if method is fine else {}
    priors = replace(NO_BIAS, accel_later=late, **own)
    knows = method([dwell(t, w, then)], site(turning), Options(priors=priors))[0]
    error = errors(knows.C_nb.as_matrix()[None], C)[0]
    assert np.degrees(np.linalg.norm(error[:2])) > 0.4
    np.testing.assert_allclose(np.abs(error), np.sqrt(knows.covariance.diagonal()), rtol=0.03)
    # one cause: across it heading turns the tilt of 0.45 deg, by half of what it is off; all else
    # that is stated is less than half of that
    across = np.array([-error[1], error[0], 0.0])
    across /= np.linalg.norm(across)
    second = abs(error[2]) / 2 * np.linalg.norm(error[:2])
    assert second**2 < across @ knows.covariance @ across < 1.5 * second**2


def test_a_lag_is_of_the_rate_where_a_record_ends():
    """At 5 Hz blocks are 0.4 s, in the last of which a swing of 1.65 deg at 0.136 Hz turns back:
    13 ms of its rate at the end, 0.240 deg/s by hand, are 11.2 arc seconds, of the mean of the
    block none. The parabola through three blocks is off by a tenth of that."""
    w = 2 * np.pi * 0.136
    swing = Angle(amplitude=radians(1.65), frequency=0.136, phase=-np.pi / 2 - w * 36.8)
    rocking = Motion(roll=swing)
    t, w, f, _ = rocking.readings(37.0, 5.0)
    knows, not_told = (
        inertial([dwell(t, w, f)], site(rocking), Options(priors=replace(QUIET, lag=lag)))[0]
        for lag in (13e-3, 0.0)
    )
    more = np.sqrt(knows.covariance[0, 0] - not_told.covariance[0, 0])
    assert np.degrees(more) * 3600 == pytest.approx(11.2, rel=0.1)


@pytest.mark.parametrize("method", [fine, inertial])
def test_samples_too_far_apart_for_a_swing_are_in_sigma(method):
    """Six samples a swing of 1.3 deg, about a point 0.7 m below: by perfect sensors heading is off
    by half a degree, of 0.001 that noise makes, and sigma is that within a factor of two and a
    half. At 20 Hz, a ten thousandth of it, nothing shows."""
    swings = {"yaw": (3.8, 0.134, 1.5), "pitch": (1.3, 0.33, 2.5)}
    angles = {
        axis: Angle(0.2, amplitude=radians(size), frequency=hz, phase=phase)
        for axis, (size, hz, phase) in swings.items()
    }
    rocking = Motion(**angles, lever=(0.0, 0.7, 0.0), latitude_deg=60.0)
    quiet = replace(NO_BIAS, gyro_walk=1e-9, accel_walk=1e-7, lever_arm=0.7)
    off, told = [], []
    for rate in (2.0, 20.0):
        t, w, f, C = rocking.readings(17.0, rate)
        found = method([dwell(t, w, f)], site(rocking), Options(priors=quiet))[0]
        off.append(np.degrees(errors(found.C_nb.as_matrix()[None], C)[0, 2]))
        told.append(np.degrees(sigma(found)))
    assert abs(off[0]) > 0.5
    assert 0.4 * told[0] < abs(off[0]) < 2.5 * told[0]
    assert abs(off[1]) < 1e-4
    assert told[1] < 0.003


@pytest.mark.parametrize("instants", [False, True])
def test_samples_twice_as_often_by_hand(instants):
    """Of a rate ``t^4`` that is sampled each second: means over halves are those of ``t^5/5``."""
    t = np.arange(1.0, 13.0)
    edges = np.arange(0.0, 12.5, 0.5)
    rate = t**4 if instants else np.diff(np.arange(13.0) ** 5) / 5
    w = np.stack([rate, np.zeros(12), -rate], axis=1)
    found = ImuReadings(t, w, np.zeros((12, 3)), instants=instants).twice_as_often()
    np.testing.assert_allclose(found.t, edges[1:])
    want = np.diff(edges**5) / 5 / 0.5
    # at the ends means go on as cubics; instants are made means by them, a fourth power's 11/720
    inner, room = slice(4, -4), 1.0 if instants else 1e-8
    np.testing.assert_allclose(found.w_ib_b[inner, 0], want[inner], atol=room)
    np.testing.assert_array_equal(found.w_ib_b[:, 2], -found.w_ib_b[:, 0])
    assert not found.instants


def test_a_clock_that_runs_fast_turns_gravity_at_another_rate():
    """By difference: of a spin that is a part c faster, but for the rate itself, which stays. The
    gyros' bias is stated: the Earth's rate, of any size else, would take it, and turn it by T."""
    size, turning = 1e-6, Motion(roll=Angle(0.3, rate=radians(20.0)))
    faster = replace(turning, roll=Angle(0.3, rate=radians(20.0) * (1 + size)))
    t, w, f, _ = turning.readings(T, 10.0)
    _, rates, forces, _ = faster.readings(T, 10.0)
    rates = rates - np.array([radians(20.0) * size, 0.0, 0.0])
    base, moved, knows = (
        inertial([dwell(t, *read)], site(turning), Options(priors=priors))[0]
        for read, priors in (
            ((w, f), NO_BIAS), ((rates, forces), NO_BIAS), ((w, f), replace(NO_BIAS, clock=size)),
        )
    )  # fmt: skip
    J = (moved.C_nb * base.C_nb.inv()).as_rotvec()
    assert J[0] == pytest.approx(radians(20.0) * size * T / 2, rel=0.01)  # of the middle
    got, root = knows.covariance - base.covariance, abs(J[0])
    np.testing.assert_allclose(got / root**2, np.outer(J, J) / root**2, atol=0.02)


@pytest.mark.parametrize("method", [inertial, fine])
def test_a_fast_clock_is_in_sigma_as_much_as_it_turns_the_answer(method):
    """Of 3.3 turns, by its very error: of 2 ppm about a level axis tilts are off by sigma, of
    20 about the vertical heading is. The match tells it of the middle, which is off by half."""
    size, rate = 2e-5, radians(20.0)
    level = spun(method, replace(NO_BIAS, clock=size / 10), "roll", rate, size / 10)
    np.testing.assert_allclose(np.abs(level.error[:2]), np.sqrt(level.P.diagonal()[:2]), rtol=0.01)
    quiet = replace(NO_BIAS, gyro_walk=1e-9, accel_walk=1e-7, clock=size)
    vertical = spun(method, quiet, "yaw", rate, size)
    assert vertical.error[2] == pytest.approx(np.sqrt(vertical.P[2, 2]), rel=0.01)
    if method is inertial:
        assert vertical.error[2] == pytest.approx(size * rate * T / 2, rel=0.01)


class Spun(NamedTuple):
    """Error (3,) and covariance of an answer."""

    error: np.ndarray
    P: np.ndarray


def spun(method, priors, axis, rate, size):
    """Of a spin that is told by a clock that runs fast by `size`."""
    turning, faster = (
        replace(STILL, **{axis: Angle(0.3, rate=rate * part)}) for part in (1.0, 1 + size)
    )
    t, _, _, C = turning.readings(T, 10.0)
    _, w, f, _ = faster.readings(T, 10.0)
    e = method([dwell(t, w / (1 + size), f)], site(turning), Options(priors=priors))[0]
    return Spun(errors(e.C_nb.as_matrix()[None], C)[0], e.covariance)


@pytest.mark.parametrize("method", [inertial, fine])
def test_the_last_of_rounded_increments_is_missing_from_the_tilt(method):
    """A count q of angle: anywhere in it at the end, q^2/12 about north, of which nothing else
    tells; what the Earth's rate tells, about down, is more by the match's blocks."""
    stretch, _ = exact(STILL, T, 10.0)
    q, r = 1e-5, stretch.readings
    coarse = replace(stretch, readings=replace(r, grains=(Grain(increment=q), Grain())))
    known, missing = (
        method([one], site(STILL), Options(priors=NO_BIAS))[0].covariance
        for one in (stretch, coarse)
    )
    more = (missing - known) / (q**2 / 12)
    assert more[0, 0] == pytest.approx(1.0, rel=0.02)
    assert more[2, 2] > 1e4  # of an angle, over what the Earth turns by in a minute and less


def test_stamps_that_tremble_are_noise_of_what_turns():
    """``j |f'|`` of each sample: 20 deg/s of gravity across the axis, along none of it."""
    jitter, turning = 1e-4, Motion(roll=Angle(0.3, rate=radians(20.0)))
    t, w, f, _ = turning.readings(T, 10.0)
    trembling, noisy = (
        inertial([dwell(t, w, f)], site(turning), Options(priors=priors))[0].covariance
        for priors in (
            replace(QUIET, jitter=jitter),
            # of gravity on two axes in turn: the root of a half of it on each
            replace(QUIET, accel_walk=1e-4 * radians(20.0) * 9.81 / np.sqrt(2) / np.sqrt(10.0)),
        )
    )
    # about the axis both of them are what the two across it make; elsewhere one of them is still
    assert trembling[0, 0] == pytest.approx(noisy[0, 0], rel=0.02)


def test_unstated_vertical_bias_is_not_taken_for_sway():
    """Half a milli-g along the vertical, and no word of it: gravity's size is free."""
    stretch, C = exact(STILL, T, 10.0)
    r = stretch.readings
    up = C.T @ [0.0, 0.0, -1.0]
    moved = dwell(r.t, r.w_ib_b, r.f_b + 5e-3 * up)
    estimate = fine([moved], site(STILL), Options(priors=QUIET))[0]
    error = errors(estimate.C_nb.as_matrix()[None], C)[0]
    assert not estimate.flags
    assert (np.abs(error) < 0.1 * np.sqrt(estimate.covariance.diagonal())).all()


# --- nothing is used twice --------------------------------------------------------------------


def test_the_reference_is_only_a_point_of_linearisation(monkeypatch):
    """Started 6 deg beside the inertial match the filter ends at the same answer and sigma."""
    rng = np.random.default_rng(3)
    priors = Priors(gyro_bias=1e-6, accel_bias=1e-3, gyro_walk=ARW / 5, accel_walk=1e-4)
    t, w, f, _ = STILL.readings(T, RATE, 100.0)
    w = w + priors.gyro_walk * sqrt(RATE) * rng.normal(size=w.shape)
    stretch, options = dwell(t, w, f), Options(priors=priors)
    plain = fine([stretch], site(STILL), options)[0]
    module = sys.modules["alignment.methods.fine"]  # the package has the function under that name
    laid = module.laid

    def beside(*given):
        found, *rest = laid(*given)
        moved = replace(found, C_ni=Rotation.from_rotvec([0.01, -0.01, 0.1]) * found.C_ni)
        return moved, *rest

    monkeypatch.setattr(module, "laid", beside)
    moved = fine([stretch], site(STILL), options)[0]
    between = (moved.C_nb * plain.C_nb.inv()).as_rotvec()
    sigmas = np.sqrt(plain.covariance.diagonal())
    # Linearised within 0.01 rad: the second order of that, and of a prior of 10 rad (1e-4).
    assert (np.abs(between) < 0.02 * sigmas).all()
    np.testing.assert_allclose(moved.covariance, plain.covariance, rtol=0.02, atol=1e-12)


def test_a_reference_far_off_is_found_by_passes_of_fewer_updates(monkeypatch):
    """Five updates in one while the correction exceeds 0.01 rad; then all of them once; and five
    in one for the Earth's rate of any size, as it turns and the match is no surer than 0.1 rad."""
    module = sys.modules["alignment.methods.fine"]
    original, counts = module._filter, []

    def counted(model, reference, variance):
        counts.append(len(reference.carried.t))
        return original(model, reference, variance)

    monkeypatch.setattr(module, "_filter", counted)
    rng = np.random.default_rng(5)
    t, w, f, _ = SLOW_CENTRED.readings(T, 20.0, 100.0)
    rate, force = 2e-5, 1e-4  # 24 deg of heading by the bias alone, until it is told
    w = w + rate + 1e-6 * rng.normal(size=w.shape)
    priors = Priors(gyro_bias=rate, gyro_walk=1e-6 / sqrt(20), accel_walk=force)
    filtered(dwell(t, w, f), site(SLOW_CENTRED), Options(priors=priors), whole=False)
    assert counts.count(601) == 1  # 60 s of 0.1 s
    assert set(counts) == {121, 601}
    assert counts[-2:] == [601, 121]
    counts.clear()
    exactly = replace(priors, gyro_bias=0.0, gyro_walk=1e-9)
    t, w, f, _ = STILL.readings(T, 20.0, 100.0)
    exactly = Options(priors=replace(exactly, accel_walk=1e-6))
    filtered(dwell(t, w, f), site(STILL), exactly, whole=False)
    assert counts == [601]
    filtered(dwell(t, w, f), site(STILL), exactly)  # and once more to tell each update
    assert counts == [601] * 3


# --- the recursion ----------------------------------------------------------------------------


def test_inverse_of_a_covariance_by_hand():
    """(4 2 0; 2 5 2; 0 2 2): determinant 4 (10 - 4) - 2 (4 - 0) = 16, cofactors by hand."""
    expected = np.array([[6, -4, 4], [-4, 8, -8], [4, -8, 16]]) / 16
    found = _inverse(np.array([[4.0, 2, 0], [2, 5, 2], [0, 2, 2]]))
    np.testing.assert_allclose(found, expected, rtol=1e-14, atol=1e-15)


@pytest.mark.parametrize("drifting", [False, True])
def test_updates_are_those_of_the_textbook(drifting):
    """Against the filter as it is printed (Groves 3.2.2), on random matrices.

    Constants stay, or walk and fade.

    Rounding of matrices of size 10, over 40 updates: 1e-10.
    """
    rng = np.random.default_rng(8)
    m, size, free = 40, ERRORS + 6, ERRORS
    rows = np.eye(free, size) + 0.1 * rng.normal(size=(m - 1, free, size))
    root = rng.normal(size=(m - 1, free, free))
    walks = 0.01 * root @ root.transpose(0, 2, 1)
    kept, added = np.ones(6), np.zeros((m - 1, 6))
    if drifting:
        kept[3:], added = [0.9, 0.8, 0.95], rng.uniform(0.01, 0.1, (m - 1, 6))
    F, Q = np.tile(np.eye(size), (m - 1, 1, 1)), np.zeros((m - 1, size, size))
    F[:, :free], Q[:, :free, :free] = rows, walks
    for k in range(6):
        F[:, free + k, free + k], Q[:, free + k, free + k] = kept[k], added[:, k]
    H, z = rng.normal(size=(m, 3, size)), rng.normal(size=(m, 3))
    root = rng.normal(size=(size, size))
    x, P = rng.normal(size=size), root @ root.T
    state = np.column_stack([P, x])
    shapes = (m, size), (m, size), (m, 3, 3), (m, 3), (m, 3), (m,)
    own = slice(free, free + 3)
    out = Pass(*(np.empty(shape) for shape in shapes), scaled=np.empty((m, 3)), scale=own)
    for part in (slice(0, 25), slice(25, m)):  # as chunks: each but the last propagates to the next
        steps = slice(part.start, min(part.stop, m - 1))
        given = Steps(rows[steps], kept, walks[steps], added[steps])
        np.testing.assert_array_equal(given.F, F[steps])
        np.testing.assert_array_equal(given.Q, Q[steps])
        one_by_one(state, (given, H[part], z[part], 0.2), part, out)
    for k in range(m):
        S = H[k] @ P @ H[k].T + 0.2 * np.eye(3)
        K, innovation = P @ H[k].T @ np.linalg.inv(S), z[k] - H[k] @ x
        x, P = x + K @ innovation, (np.eye(size) - K @ H[k]) @ P
        np.testing.assert_allclose(out.x[k], x, atol=1e-10)
        np.testing.assert_allclose(out.variances[k], P.diagonal(), atol=1e-10)
        np.testing.assert_allclose(out.attitude[k], P[:3, :3], atol=1e-10)
        np.testing.assert_allclose(out.scaled[k], P[:3, own].sum(axis=1), atol=1e-10)
        np.testing.assert_allclose(out.values[k], innovation, atol=1e-10)
        np.testing.assert_allclose(out.expected[k], S.diagonal(), atol=1e-10)
        misfit = innovation @ np.linalg.solve(S, innovation)
        assert out.misfit[k] == pytest.approx(misfit, abs=1e-10)
        if k < m - 1:
            x, P = F[k] @ x, F[k] @ P @ F[k].T + Q[k]


@pytest.mark.parametrize("motion", [STILL, SLOW_CENTRED], ids=["still", "rocking"])
def test_a_long_interval_is_its_short_ones(motion):
    """Transition and noise of 0.1 s against ten of 10 ms, composed: ``F2 F1``, ``F2 Q1 F2' + Q2``.

    All cross terms of attitude, velocity, place, biases, scale and misalignment are in them. In
    one interval rates, f and C stay: to (0.05 s w)^2 of rocking, and Q to (1 ms/10 ms)^2.
    """
    t, w, f, _ = motion.readings(1.0, 1000.0, 100.0)
    names = ("gyro_bias", "accel_bias", "gyro_scale", "accel_scale", "gyro_misalignment")
    priors = Priors(1e-6, 1e-3, 1e-4, 1e-4, gyro_walk=2e-5, accel_walk=3e-4, gyro_misalignment=1e-3)
    readings = ImuReadings(t, w, f)
    noise = Noise(np.array([1.0, 2.0, 3.0]) * 1e-5, np.array([3.0, 1.0, 2.0]) * 1e-4, 2e-5)
    drifts = (("gyro", GaussMarkov(2e-7, 10.0)), ("accel", GaussMarkov(3e-5, 20.0)))
    walks = (4e-7, 5e-5, 0.0, 0.0, 0.0)
    model = Model(
        readings=readings,
        site=site(motion),
        noise=noise,
        priors=priors,
        names=names,
        walks=walks,
        drifts=drifts,
    )
    C_ni = motion.state(np.zeros(1))[0][0]
    found = []
    for span in (0.1, 0.01):
        carried = carry(readings, span)
        push = np.diff(gravity_velocity(carried.t, site(motion))[0], axis=0)
        steps, _ = error_matrices(model, carried, C_ni, push, slice(0, len(carried.t)))
        found.append((steps.F, steps.Q))
    (F, Q), (short_F, short_Q) = found
    whole_F, whole_Q = np.eye(F.shape[1]), np.zeros(F.shape[1:])
    for a, q in zip(short_F[:10], short_Q[:10], strict=True):
        whole_F, whole_Q = a @ whole_F, a @ whole_Q @ a.T + q
    size = np.sqrt(np.diag(whole_Q))
    free = size > 0
    scale = np.outer(size[free], size[free])
    # drifts of biases count from the next interval on: a part 1/10 of what they make of the rest
    own = np.ix_(free, free)
    errors_ = np.arange(ERRORS - 1)
    block = np.ix_(errors_, errors_)
    np.testing.assert_allclose(
        Q[0][block] / np.outer(size[:9], size[:9]),
        whole_Q[block] / np.outer(size[:9], size[:9]),
        atol=0.02,
    )
    assert np.abs((Q[0][own] - whole_Q[own]) / scale).max() < 0.1
    kept = np.exp(-0.1 / np.repeat([10.0, 20.0], 3))
    np.testing.assert_allclose(np.diag(F[0])[columns_of(5).start :], kept)
    np.testing.assert_allclose(np.diag(whole_F)[columns_of(5).start :], kept)
    added = np.repeat([2e-7, 3e-5], 3) ** 2 * (1 - kept**2)
    np.testing.assert_allclose(np.diag(whole_Q)[columns_of(5).start :], added)
    # what each error makes of each other in 0.1 s, by the largest of its kind
    for rows in (slice(0, 3), slice(3, 6), slice(6, 9)):
        for columns in (slice(0, 3), slice(3, 6), *(columns_of(k) for k in range(7))):
            part, want = F[0][rows, columns], whole_F[rows, columns]
            np.testing.assert_allclose(part, want, rtol=0, atol=0.02 * np.abs(want).max())


# --- Monte Carlo ------------------------------------------------------------------------------

SMALL = ARW / 5
NOISE = Priors(gyro_walk=ARW, accel_walk=1e-4)
BIASED = Priors(1e-6, 1e-3, gyro_walk=SMALL, accel_walk=1e-4)
REGIMES = {
    "noise": (STILL, NOISE),
    "noise, rocking": (SLOW_CENTRED, NOISE),
    "accelerometer noise": (STILL, Priors(gyro_walk=ARW / 15, accel_walk=1e-3)),
    "biases, rocking, north": (replace(SLOW_CENTRED, latitude_deg=75.0), BIASED),
    "biases, south": (replace(STILL, latitude_deg=-33.0), BIASED),
    "biases, half turn": (HALF_TURN, replace(BIASED, gyro_bias=1e-5)),
    "biases, scale, carousel": (
        CAROUSEL,
        Priors(1e-5, 1e-3, 1e-5, 1e-4, gyro_walk=SMALL, accel_walk=1e-4),
    ),
}
RUNS = 60


@pytest.mark.slow
def test_normalised_errors_are_chi_square_in_every_regime():
    tail = 0.025 / len(REGIMES)
    low, high = chi2.ppf([tail, 1 - tail], 3 * RUNS) / RUNS  # family-wise 95 %
    found = {}
    for k, (name, (motion, priors)) in enumerate(REGIMES.items()):
        rate = RATE if motion.yaw.moves == () else 2 * RATE  # half a turn in 4 s is fast
        error, covariance = campaign(200 + k, motion, T, rate, RUNS, priors, method=fine)
        assert np.sqrt(covariance[:, 2, 2]).max() < radians(8)
        found[name] = nees(error, covariance).mean()
    assert all(low < value < high for value in found.values()), (low, high, found)


@pytest.mark.slow
@pytest.mark.parametrize("motion", [CAROUSEL, HALF_TURN], ids=["carousel", "half turn"])
def test_gyros_that_are_astray_are_told_by_what_turns(motion):
    """States of their own: the NEES was 17 to 24 where a turning unit's axes passed for biases."""
    error, covariance = astray(52, motion, 10.0, 40, ASTRAY, ASTRAY, method=fine)
    low, high = chi2.ppf([0.0125, 0.9875], 120) / 40
    assert low < nees(error, covariance).mean() < high


@pytest.mark.slow
def test_lever_arm_state_does_not_make_it_too_sure():
    """The updates are coarse on purpose there: sigmas of tilt are wide by a fifth, not narrow."""
    priors = replace(NOISE, lever_arm=0.1)
    error, covariance = campaign(41, SLOW, T, 10.0, 60, priors, method=fine)
    value = nees(error, covariance).mean()
    low, high = chi2.ppf([0.025, 0.975], 180) / 60
    assert 0.7 * low < value < high
    heading = error[:, 2] / np.sqrt(covariance[:, 2, 2])
    low, high = chi2.ppf([0.005, 0.995], 60) / 60
    assert low < np.mean(heading**2) < high
    # No pull of the arm toward zero, and of tilt with it: means within 3.3 standard errors.
    normalised = error / np.sqrt(np.einsum("kii->ki", covariance))
    assert np.abs(normalised.mean(axis=0)).max() < 3.3 / sqrt(60)


# --- innovations and tracks -------------------------------------------------------------------


def test_innovations_are_white_and_of_their_sigma():
    rng = np.random.default_rng(8)
    t, w, f, _ = SLOW_CENTRED.readings(120.0, 100.0, 100.0)
    priors = Priors(gyro_walk=1e-6, accel_walk=1e-3)
    w = w + priors.gyro_walk * sqrt(100) * rng.normal(size=w.shape)
    f = f + priors.accel_walk * sqrt(100) * rng.normal(size=f.shape)
    found = innovations(dwell(t, w, f), site(SLOW_CENTRED), Options(priors=priors))
    assert found.values.shape == found.sigmas.shape == (1201, 3)
    np.testing.assert_allclose(np.diff(found.t), 0.1, rtol=0, atol=1e-9)
    normal = (found.values / found.sigmas)[20:]  # the first ones tell what nobody knew
    n = normal.size
    low, high = chi2.ppf([0.001, 0.999], n) / n
    assert low < np.mean(normal**2) < high
    # Correlation of neighbours: 1/sqrt(n), 1.7 %, four sigmas.
    assert abs(np.mean(normal[1:] * normal[:-1])) < 0.07
    with pytest.raises(ValueError, match="read-only"):
        found.values[0, 0] = 1.0


def test_track_ends_at_the_estimate_and_stays_within_its_sigmas():
    rng = np.random.default_rng(9)
    motion = SLOW_CENTRED
    t, w, f, _ = motion.readings(T, 20.0, 100.0)
    priors = Priors(gyro_walk=2e-6, accel_walk=1e-4)
    w = w + priors.gyro_walk * sqrt(20) * rng.normal(size=w.shape)
    f = f + priors.accel_walk * sqrt(20) * rng.normal(size=f.shape)
    stretch, options = dwell(t, w, f), Options(priors=priors)
    (track,) = fine_tracks(stretch, site(motion), options)
    estimate = fine([stretch], site(motion), options)[0]
    np.testing.assert_allclose(
        track.C_nb[-1].as_matrix(), estimate.C_nb.as_matrix(), rtol=0, atol=2e-15
    )
    np.testing.assert_array_equal(track.covariance[-1], estimate.covariance)
    assert np.diff(track.t).min() == pytest.approx(0.5, abs=1e-6)
    truth, _, _ = motion.state(track.t - 100.0)
    turned = (track.C_nb * Rotation.from_matrix(truth).inv()).as_rotvec()
    sigmas = np.sqrt(np.einsum("kii->ki", track.covariance))
    assert sigmas[0, 2] < 0.5
    assert sigmas[-1, 2] < sigmas[0, 2] / 3
    assert (np.abs(turned) < 4.5 * sigmas).all()  # 300 values, correlated: 1 in 500
    mean = np.mean((turned / sigmas) ** 2)
    assert 0.05 < mean < 4  # one path of few independent errors


def test_noise_is_told_from_the_readings_where_no_prior_gives_it():
    rng = np.random.default_rng(10)
    t, w, f, C = SLOW_CENTRED.readings(T, 50.0, 100.0)
    w = w + ARW * sqrt(50) * rng.normal(size=w.shape)
    f = f + 1e-4 * sqrt(50) * rng.normal(size=f.shape)
    told = fine([dwell(t, w, f)], site(STILL), Options())[0]
    given = fine([dwell(t, w, f)], site(STILL), Options(priors=NOISE))[0]
    # 240 independent lines of the octave: 5 % in variance of each axis, 3 sigma of the sigma.
    assert sigma(told) == pytest.approx(sigma(given), rel=0.08)
    error = errors(told.C_nb.as_matrix()[None], C)[0]
    assert (np.abs(error) < 3.5 * np.sqrt(told.covariance.diagonal())).all()


@pytest.mark.parametrize("method", [inertial, fine])
def test_an_arm_that_nobody_states_is_not_taken_for_noise(method):
    """Six turns about the vertical, 5 cm beside the axis, no data sheet: what swings was taken for
    noise, and sigma was six times that on the axis."""
    found = []
    for lever in ((0.0, 0.0, 0.0), (0.04, 0.0, 0.03)):
        spin = replace(STILL, yaw=Angle(0.3, rate=radians(10.0)), lever=lever)
        rng = np.random.default_rng(3)
        t, w, f, _ = spin.readings(216.0, 10.0)
        w = w + 6e-7 * sqrt(10) * rng.normal(size=w.shape)
        f = f + 6e-4 * sqrt(10) * rng.normal(size=f.shape)
        found.append(sigma(method([dwell(t, w, f)], site(spin), Options())[0]))
    assert found[1] == pytest.approx(found[0], rel=0.3)


# --- refusals ---------------------------------------------------------------------------------


def test_refusals_are_those_of_the_coarse_method():
    stretch, _ = exact(STILL, 20.0, 10.0)
    with pytest.raises(PoleError):
        fine([stretch], Site(radians(-89.99)), Options())
    r = stretch.readings
    keep = np.r_[0:50, 75:200]
    holed = Dwell("p", 100.0, 120.0, ImuReadings(r.t[keep], r.w_ib_b[keep], r.f_b[keep]))
    with pytest.raises(AlignmentError, match=r"p: gap of 2\.6 s"):
        fine([holed], site(STILL), Options())
    short, _ = exact(STILL, 3.0, 10.0)
    with pytest.raises(TooShort):
        fine([short], site(STILL), Options(priors=QUIET))
    moving = replace(STILL, sway=(Angle(amplitude=16.0, frequency=0.02), Angle(), Angle()))
    with pytest.raises(NotAtRest, match="the instrument travels"):
        one(moving, 120.0, 10.0, method=fine)


def test_a_tilt_is_known_where_a_heading_is_not():
    """Gyros of 720 deg/h, 70 times Earth rate: tilt is b/g, 4 mrad, about any heading.

    Before, it was refused: a heading that nothing tells had to settle too. The match of velocity
    curves alone is off by half of the gyros' turn in a minute, 0.1 rad.
    """
    rng, runs, told = np.random.default_rng(44), 12, []
    priors = Priors(radians(0.2), 0.04, gyro_walk=1e-4, accel_walk=6e-4)
    t, w, f, C = STILL.readings(T, RATE, 100.0)
    for b in np.repeat([priors.gyro_bias, priors.accel_bias], 3) * rng.normal(size=(runs, 6)):
        rates = w + b[:3] + priors.gyro_walk * sqrt(RATE) * rng.normal(size=w.shape)
        forces = f + b[3:] + priors.accel_walk * sqrt(RATE) * rng.normal(size=f.shape)
        try:
            (e,) = fine([dwell(t, rates, forces)], site(STILL), Options(priors=priors))
        except AlignmentError:
            continue
        assert "heading" in e.undetermined
        np.testing.assert_allclose(np.sqrt(e.covariance.diagonal()[:2]), 0.04 / G, rtol=0.15)
        down = e.C_nb.as_matrix() @ C.T @ [0, 0, 1]
        told.append(down[:2] / (0.04 / G))
    assert len(told) >= runs - 2
    low, high = chi2.ppf([0.001, 0.999], 2 * len(told)) / (2 * len(told))
    assert low < np.mean(np.square(told)) < high


def test_what_a_spin_tells_of_its_axis():
    """Gyros and accelerometers show the axis of a spin in b, each off by its own errors of axes and
    biases; which of the two is, nothing but the priors says.

    By hand: axes by gyros are off by ``s_g^2 = m_g^2 + (b_g/w)^2``, by accelerometers ``s_a^2 =
    m_a^2 + (b_a/g)^2``: tilt has ``1/s^2 = 1/s_g^2 + 1/s_a^2``, and of gyros that are off by m
    alone it is ``m s_a^2/(s_g^2 + s_a^2)``. Where the misalignment that was found stayed in the
    reference its square passed for knowledge: 0.41 deg stated where 0.7 is right.
    """
    rate = radians(50.0)
    priors = Priors(radians(0.5), 0.02 * G, 5e-3, 5e-3, gyro_walk=5e-5, accel_walk=7e-4)
    priors = replace(priors, gyro_misalignment=0.0125, accel_misalignment=0.01)
    by_gyro = np.hypot(priors.gyro_misalignment, priors.gyro_bias / rate)
    by_accel = np.hypot(priors.accel_misalignment, priors.accel_bias / G)
    rng, off = np.random.default_rng(11), np.array([0.02, 0.0, -0.015])
    t, w, f, C = Motion(yaw=Angle(0.7, rate=rate)).readings(36.0, 20.0, 100.0)
    w = w + np.cross(w, off) + priors.gyro_walk * sqrt(20) * rng.normal(size=w.shape)
    f = f + priors.accel_walk * sqrt(20) * rng.normal(size=f.shape)
    (e,) = fine([dwell(t, w, f)], site(STILL), Options(priors=priors))
    told = by_gyro * by_accel / np.hypot(by_gyro, by_accel)
    # what else the record tells of it, the Earth's rate across, takes a part of 0.004 of variance
    np.testing.assert_allclose(np.sqrt(e.covariance.diagonal()[:2]), told, rtol=0.01)
    level = np.linalg.norm((e.C_nb.as_matrix() @ C.T @ [0, 0, 1])[:2])
    want = np.linalg.norm(off) * by_accel**2 / (by_gyro**2 + by_accel**2)
    # and its noise moves the answer by the root of that, 0.06 of a sigma: three times as much
    assert level == pytest.approx(want, abs=0.2 * told)


def test_errors_times_errors_tell_no_tilt_on_a_level_spin():
    """A consumer unit, ten turns at 100 deg/s: products of errors of 0.01 push by 1 mm/s^2, two
    sigmas of an update. By first order alone they told which turn was whose: off by 23 mrad at 5.5
    stated where accelerometers turned about the axis by 10 allow no less, or no end of passes."""
    priors = Priors(radians(0.5), 0.02 * G, 5e-3, 5e-3, gyro_walk=5e-5, accel_walk=7e-4)
    priors = replace(priors, gyro_misalignment=0.0125, accel_misalignment=0.01, lever_arm=0.055)
    rng = np.random.default_rng(8)
    t, w, f, C = Motion(yaw=Angle(0.7), pitch=Angle(rate=radians(100))).readings(36.0, 20.0, 100.0)
    turned, bias, f_turned, f_bias, scale, f_scale = rng.normal(size=(6, 3))
    w = w * (1 + 5e-3 * scale) + np.cross(w, 0.0125 * turned) + priors.gyro_bias * bias
    f = f * (1 + 5e-3 * f_scale) + np.cross(f, 0.01 * f_turned) + priors.accel_bias * f_bias
    w = w + priors.gyro_walk * sqrt(20) * rng.normal(size=w.shape)
    f = f + priors.accel_walk * sqrt(20) * rng.normal(size=f.shape)
    (e,) = fine([dwell(t, w, f)], site(STILL), Options(priors=priors))
    down = e.C_nb.as_matrix() @ C.T @ [0, 0, 1]
    tilt, P = np.array([-down[1], down[0]]), e.covariance[:2, :2]
    assert tilt @ np.linalg.solve(P, tilt) < chi2.ppf(0.99, 2)
    axis = e.C_nb.as_matrix()[:2, 2] / np.linalg.norm(e.C_nb.as_matrix()[:2, 2])  # Z1, level
    # the lever arm adds a little, products of errors at the edge of their priors tell a little
    assert sqrt(axis @ P @ axis) == pytest.approx(priors.accel_misalignment, rel=0.1)


def leaning_spin(lean_deg, rate_deg_s, seconds, rate_hz):
    """Turns about an axis that leans north: of down turned about east, then about itself."""
    east, down, north = np.eye(3)[1], np.eye(3)[2], np.eye(3)[0]
    motion = Motion(
        yaw=Angle(radians(lean_deg)),
        pitch=Angle(0.7, rate=radians(rate_deg_s)),
        axes=(east, down, north),
    )
    return motion.readings(seconds, rate_hz, 100.0)


@pytest.mark.parametrize("power", [1, 2])
def test_g_sensitive_gyros_beside_gravity_that_goes_round(power):
    """Gravity's part across a leaning axis goes round in b, and what each gyro makes of each of its
    components goes round with it: ``G f`` has a part that stands in n beside the Earth's rate, of
    variance ``(s g sin(lean))^2 / 2`` across the axis. Heading: 0.5 deg/h/g by 20 deg of lean over
    10.0 deg/h of Earth rate, 0.69 deg; taken for a bias it was 0.02. Forty such units come to it.
    Of squares of forces it is ``2 F`` of that, F the steady part of each: ``g cos(lean)/sqrt 3``
    where the axis is oblique in b.
    """
    size, lean = radians(0.5) / 3600 / G, 20.0
    t, w, f, C = leaning_spin(lean, 10.0, 216.0, 10.0)
    oblique = Rotation.align_vectors([np.ones(3) / sqrt(3)], [[0.0, 1.0, 0.0]])[0].as_matrix()
    w, f, C = w @ oblique.T, f @ oblique.T, C @ oblique.T
    own = size if power == 1 else size / (2 * G * cos(radians(lean)) / sqrt(3))
    told = {"gyro_g_sensitivity" if power == 1 else "gyro_g2_sensitivity": own}
    priors = Priors(1e-7, 1e-4, gyro_walk=3e-7, accel_walk=1e-5, **told)
    hand = size * G * sin(radians(lean)) / sqrt(2) / (W * cos(LAT))
    rng, off = np.random.default_rng(20), []
    for _ in range(40):
        rates = w + f**power @ (own * rng.normal(size=(3, 3))).T
        rates = rates + priors.gyro_walk * sqrt(10) * rng.normal(size=w.shape)
        forces = f + priors.accel_walk * sqrt(10) * rng.normal(size=f.shape)
        (e,) = fine([dwell(t, rates, forces)], site(STILL), Options(priors=priors))
        assert sigma(e) == pytest.approx(hand, rel=0.03)  # noise is 0.04 of it
        off.append(errors(e.C_nb.as_matrix()[None], C)[0][2] / sigma(e))
    low, high = chi2.ppf([0.001, 0.999], len(off)) / len(off)
    assert low < np.mean(np.square(off)) < high


def test_lines_that_orders_of_forces_are_like_by_hand():
    """``F + r cos``, F 2 and r 3: squares are ``0.5 + 4 f``, cubes ``-2.5 + 18.75 f`` and
    waves; of one that goes round about nothing the size is ``r 2/pi`` and no scale. Of a steady
    one squares are ``F^2`` and no scale, whatever its noise."""

    def lines(f, **orders):
        told = _with_lines_of_orders(Priors(**orders), f)
        assert not any(getattr(told, name) for name in orders)
        return [told.accel_bias, told.accel_scale]

    phase = 2 * pi * (np.arange(720) + 0.5) / 720
    f = np.stack([2 + 3 * np.cos(phase), np.full(720, 1e-9), np.full(720, 1e-9)], axis=1)
    squares = lines(f, accel_quadratic=0.1)
    np.testing.assert_allclose(squares, [0.05, 0.4], rtol=1e-9)
    # F^3 + 3/2 F r^2 = 35 at the mean of 2, slope 3 F^2 + 3/4 r^2 = 18.75
    cubes = lines(f, accel_cubic=0.1)
    np.testing.assert_allclose(cubes, [0.25, 1.875], rtol=1e-9)
    level = lines(f - [2.0, 0.0, 0.0], accel_asymmetry=0.1)
    np.testing.assert_allclose(level, [0.1 * 3 * 2 / pi, 0.0], rtol=1e-4, atol=1e-12)
    steady = np.array([3.0, 1.0, 9.0]) + 3e-3 * np.random.default_rng(6).normal(size=(720, 3))
    np.testing.assert_allclose(lines(steady, accel_quadratic=0.1), [8.1, 0.0], rtol=1e-4)


@pytest.mark.parametrize("method", [inertial, fine])
def test_accelerometers_at_places_of_their_own_in_a_turn(method):
    """``f_i = (w x (w x r_i))_i`` stays in b as long as the turn goes on: about an axis that all
    three sensors feel alike a part of it lies along the axis, of variance ``2/3 (w^2 r)^2``. It is
    taken for a bias of w^2 r: 5 mm and 30 deg/s are 140 ug, 29 arc seconds of tilt where a bias of
    10 uG allowed 2.
    """
    arm, rate = 0.005, radians(30.0)
    priors = Priors(1e-7, 1e-4, gyro_walk=1e-7, accel_walk=1e-4, places=arm)
    oblique = Rotation.align_vectors([np.ones(3) / sqrt(3)], [[0.0, 0.0, 1.0]])[0].as_matrix()
    t, w, f, C = Motion(yaw=Angle(0.7), pitch=Angle(rate=rate)).readings(120.0, 20.0, 100.0)
    w, f, C = w @ oblique.T, f @ oblique.T, C @ oblique.T
    spin = rate * np.ones(3) / sqrt(3)
    rng, off = np.random.default_rng(21), []
    for _ in range(20):
        places = arm * rng.normal(size=(3, 3))
        outward = np.cross(spin, np.cross(spin, places)).diagonal()
        rates = w + priors.gyro_walk * sqrt(20) * rng.normal(size=w.shape)
        forces = f + outward + priors.accel_walk * sqrt(20) * rng.normal(size=f.shape)
        (e,) = method([dwell(t, rates, forces)], site(STILL), Options(priors=priors))
        axis = (e.C_nb.as_matrix() @ np.ones(3) / sqrt(3))[:2]
        across = np.array([-axis[1], axis[0]]) / np.linalg.norm(axis)  # what tilts the axis
        told = sqrt(across @ e.covariance[:2, :2] @ across)
        assert told == pytest.approx(rate**2 * arm / G, rel=0.05)
        down = e.C_nb.as_matrix() @ C.T @ [0, 0, 1]
        off.append(across @ [-down[1], down[0]] / (told * sqrt(2 / 3)))
    low, high = chi2.ppf([0.001, 0.999], len(off)) / len(off)
    assert low < np.mean(np.square(off)) < high


@pytest.mark.parametrize("method", [inertial, fine])
def test_accelerometers_places_are_no_bias_at_rest(method):
    """The Earth pulls 5 mm by 3e-11 m/s^2. Taken for a stated bias it hid that no sheet states one,
    and with it what is doubtful of accelerometers without a sheet."""
    t, w, f, _ = STILL.readings(200.0, 5.0, 100.0)  # the Earth turns by more than 0.01 rad
    f = f + 6e-4 * sqrt(5) * np.random.default_rng(7).normal(size=f.shape)
    f[:, 0] += 1e-5 * (t - 100.0)  # a drift
    priors = Priors(gyro_bias=1e-7, gyro_walk=1e-6)
    found = [
        method([dwell(t, w, f)], site(STILL), Options(priors=replace(priors, places=places)))[0]
        for places in (0.0, 5e-3)
    ]
    np.testing.assert_array_equal(found[0].covariance, found[1].covariance)
    assert found[0].flags == found[1].flags


def test_coarse_and_fine_agree_on_the_same_readings():
    rng = np.random.default_rng(12)
    t, w, f, _ = STILL.readings(T, 10.0, 100.0)
    w = w + SMALL * sqrt(10) * rng.normal(size=w.shape)
    stretch = dwell(t, w, f)
    options = Options(priors=replace(BIASED, gyro_bias=0.0, accel_bias=0.0))
    (first,), (second,) = (m([stretch], site(STILL), options) for m in (inertial, fine))
    between = (first.C_nb * second.C_nb.inv()).as_rotvec()
    # Both see the same noise; the coarse one weighs it worse by sqrt(10/7 - 1) of a sigma.
    assert abs(between[2]) < 3 * sigma(second) * sqrt(3 / 7)


def plain_kalman(model, reference, variance, count):
    """Covariances (count, s, s) after each update by the textbook's difference, in 64 digits
    of two: `P - P H^T (H P H^T + R)^-1 H P`, then `F P F^T + Q`. Shares the matrices alone."""
    module = sys.modules["alignment.methods.fine"]
    carried, C_ni = reference.carried, reference.C_ni.as_matrix()
    push = np.diff(gravity_velocity(carried.t, model.site)[0][: count + 1], axis=0)
    steps, H = module.error_matrices(model, carried, C_ni, push, slice(0, count))
    F, Q, H = (np.asarray(x, np.longdouble) for x in (steps.F, steps.Q, H))
    sigmas = [np.repeat(getattr(model.priors, name), 3) for name in model.names]
    sigmas += [np.repeat(process.sigma, 3) for _, process in model.drifts]
    P = np.diag(np.concatenate([module.START, [0.0], *sigmas]).astype(np.longdouble) ** 2)
    found = []
    for k in range(count):
        for row in H[k]:  # one component after another: no matrix is inverted
            HP = row @ P
            P = P - np.outer(HP, HP) / (HP @ row + variance)
        found.append(P)
        P = F[k] @ P @ F[k].T + Q[k]
        P = (P + P.T) / 2
    return np.array(found, float)


@pytest.mark.parametrize(("drifts", "size"), [((0.0, 0.0), 16), ((6e-8, 1e-4), 22)])
def test_no_digit_is_lost_from_a_metre_to_a_micrometre(drifts, size):
    """A metre squared less itself leaves 1e-16 of it, a ten thousandth of a square micrometre."""
    module = sys.modules["alignment.methods.fine"]
    t, w, f, _ = STILL.readings(60.0, 5.0, 100.0)
    priors = Priors(1.7e-8, 2.4e-4, 0.0, 0.0, *drifts, gyro_walk=5.8e-7, accel_walk=5.9e-4)
    readings = ImuReadings(t, w, f)
    carried = carry(readings, module.UPDATE)
    noise = Noise(np.full(3, priors.gyro_walk), np.full(3, priors.accel_walk))
    model = module.model_of(readings, site(STILL), noise, priors)
    assert model.size == size  # noise hides 1 s; 100 s and more outlast the minute
    reference = module._Reference(
        carried, module.laid(readings, carried, site(STILL), priors)[0].C_ni, np.zeros((2, 3))
    )
    run = module._filter(model, reference, module.STILL**2)
    want = plain_kalman(model, reference, module.STILL**2, 100)
    assert np.linalg.eigvalsh(want[3, 6:9, 6:9])[-1] < 1.001 * module.STILL**2
    variances = np.diagonal(want, axis1=1, axis2=2)
    # careful updates, then plain ones: 64 binary digits less 40 leave 1e-6 of the oracle itself
    np.testing.assert_allclose(run.variances[:100], variances, rtol=1e-4, atol=1e-30)
    size = np.sqrt(np.einsum("ki,kj->kij", variances[:, :3], variances[:, :3]))
    assert (np.abs(run.attitude[:100] - want[:, :3, :3]) < 1e-4 * size).all()


SLOW_TURN = Motion(yaw=Angle(rate=radians(10.0)), lever=(0.04, 0.06, 0.05))


@pytest.mark.parametrize("lost", [False, True])
def test_blocks_of_updates_are_the_updates_one_by_one(monkeypatch, lost):
    """601 updates: 32 careful ones, eight blocks of 64, 57 more. The same posterior, and the same
    likelihood: a block's misfit is the sum of its updates'. Rounding, of updates one by one too:
    1e-8 of a sigma (found: 5e-10). Where it leaves a block no covariance, one by one."""
    module = sys.modules["alignment.methods.fine"]
    rng = np.random.default_rng(21)
    t, w, f, _ = SLOW_TURN.readings(60.0, 20.0, 100.0)
    priors = Priors(1.7e-8, 2.4e-4, 1e-5, 1e-4, gyro_walk=5.8e-7, accel_walk=5.9e-4, lever_arm=0.05)
    w = w + priors.gyro_walk * sqrt(20) * rng.normal(size=w.shape)
    f = f + priors.accel_walk * sqrt(20) * rng.normal(size=f.shape)
    readings, place = ImuReadings(t, w, f), site(SLOW_TURN)
    carried = carry(readings, module.UPDATE)
    matched, noise, _ = module.laid(readings, carried, place, priors)
    model = module.model_of(readings, place, noise, priors)
    found = np.outer([1.0, 0, 0, 0, 0], np.full(3, 1e-8))  # of the gyros' bias
    reference = module._Reference(carried, matched.C_ni, found)
    if lost:

        def none(*_):
            raise np.linalg.LinAlgError

        monkeypatch.setattr("alignment.methods.updates._seen", none)
    each = module._filter(model, reference, 1e-10)
    run = module._filter(replace(model, whole=False), reference, 1e-10)
    assert len(each.x) == len(each.misfit) == len(run.misfit) == 601
    assert run.x.shape == (1, 25)
    if lost:
        for name in ("x", "variances", "attitude", "values"):
            np.testing.assert_array_equal(getattr(run, name)[-1], getattr(each, name)[-1])
        np.testing.assert_array_equal(run.expected, each.expected)
        return
    sigmas = np.sqrt(each.variances[-1])
    assert (np.abs(run.x[-1] - each.x[-1]) <= 1e-8 * sigmas).all()
    np.testing.assert_allclose(run.variances[-1], each.variances[-1], rtol=1e-8)
    size = np.outer(sigmas[:3], sigmas[:3])
    assert (np.abs(run.attitude[-1] - each.attitude[-1]) < 1e-8 * size).all()
    blocks = slice(32, 32 + 8 * 64)
    sums = each.misfit[blocks].reshape(8, 64).sum(axis=1)
    np.testing.assert_allclose(run.misfit[blocks].reshape(8, 64).sum(axis=1), sums, rtol=1e-8)


@pytest.mark.parametrize("updates", [16, 31, 32, 33, 96, 97, 98])
def test_ends_of_few_updates_and_of_whole_blocks(updates):
    """About 32 careful updates, and one block of 64 more: the end is that of one by one."""
    module = sys.modules["alignment.methods.fine"]
    t, w, f, _ = SLOW_TURN.readings((updates - 1) / 10, 20.0, 100.0)
    priors = Priors(1.7e-8, 2.4e-4, gyro_walk=5.8e-7, accel_walk=5.9e-4)
    readings, place = ImuReadings(t, w, f), site(SLOW_TURN)
    carried = carry(readings, module.UPDATE)
    noise = Noise(np.full(3, priors.gyro_walk), np.full(3, priors.accel_walk))
    model = module.model_of(readings, place, noise, priors)
    reference = module._Reference(carried, match(carried, place).C_ni, np.zeros((2, 3)))
    each = module._filter(model, reference, 1e-10)
    run = module._filter(replace(model, whole=False), reference, 1e-10)
    assert len(each.x) == len(run.misfit) == updates
    assert (np.abs(run.x[-1] - each.x[-1]) <= 1e-8 * np.sqrt(each.variances[-1])).all()
    np.testing.assert_allclose(run.variances[-1], each.variances[-1], rtol=1e-8)


def test_coarse_passes_that_settle_elsewhere_do_not_keep_it_from_settling():
    """10 deg/s for 32 s of a navigation unit: five updates in one see another heading by 0.8 deg,
    of a sigma of 1.8, and a correction of 0.57 deg is no news."""
    t, w, f, C = SLOW_TURN.readings(32.0, 20.0, 100.0)
    priors = Priors(1.7e-8, 2.4e-4, gyro_walk=5.8e-7, accel_walk=5.9e-4, lever_arm=0.055)
    rng = np.random.default_rng(12)
    for _ in range(4):
        rates = w + priors.gyro_walk * sqrt(20) * rng.normal(size=w.shape)
        forces = f + priors.accel_walk * sqrt(20) * rng.normal(size=f.shape)
        (found,) = fine([dwell(t, rates, forces)], site(SLOW_TURN), Options(priors=priors))
        off = errors(found.C_nb.as_matrix()[None], C)[0]
        # three freedoms: chance has 21.1 once in ten thousand
        assert off @ np.linalg.solve(found.covariance, off) < 21.1
