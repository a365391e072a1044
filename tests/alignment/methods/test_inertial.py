"""Inertial-frame alignment: against exact rocking, the white-noise floor, and chi-square bounds."""

from dataclasses import replace
from math import cos, pi, radians, sqrt

import numpy as np
import pytest
from rocking import Angle, G, Motion, earth_n, errors, noisy
from scipy.integrate import cumulative_trapezoid
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from alignment import Dwell, ImuReadings, Options, Priors, Site
from alignment.errors import AlignmentError, NotAtRest, PoleError, TooShort
from alignment.methods.inertial import (
    METHOD,
    Noise,
    arm_of,
    covariances,
    functional_covariance,
    gravity_velocity,
    inertial,
    inertial_tracks,
    laid,
    match,
    noise_of,
    white_levels,
)
from alignment.strapdown import carry

W = 7.292115e-5  # rad/s
STILL = Motion(yaw=Angle(0.7), pitch=Angle(0.1), roll=Angle(-0.05))
ROCKING = Motion(
    yaw=Angle(0.7, amplitude=0.04, frequency=0.13),
    pitch=Angle(0.1, amplitude=0.09, phase=1.0),
    roll=Angle(-0.05, amplitude=0.07, frequency=0.17, phase=0.3),
    lever=(0.1, 0.05, -0.08),
)
# The same slowly: for few samples a second.
SLOW = Motion(
    yaw=Angle(-2.0, amplitude=0.04, frequency=0.03),
    pitch=Angle(0.1, amplitude=0.09, frequency=0.05, phase=1.0),
    roll=Angle(-0.05, amplitude=0.07, frequency=0.04, phase=0.3),
    lever=(0.1, 0.05, -0.08),
)
CAROUSEL = Motion(yaw=Angle(0.4, rate=2 * pi / 30), pitch=Angle(0.02), roll=Angle(-0.05))
X1_UP = Motion(yaw=Angle(0.3), pitch=Angle(pi / 2, amplitude=0.05), roll=Angle(amplitude=0.05))
QUIET = Priors(gyro_walk=1e-7, accel_walk=1e-5)
# so a sheet speaks of biases of both sensors, which are none
NO_BIAS = replace(QUIET, gyro_bias=1e-14, accel_bias=1e-14)


def site(motion):
    return Site(radians(motion.latitude_deg), local_gravity=G)


def dwell(t, w, f, label="p"):
    return Dwell(label, float(2 * t[0] - t[1]), float(t[-1]), ImuReadings(t, w, f))


def exact(motion, seconds, rate):
    t, w, f, C = motion.readings(seconds, rate, 100.0)
    return dwell(t, w, f), C


def one(motion, seconds, rate, priors=QUIET, method=inertial):
    stretch, C = exact(motion, seconds, rate)
    estimate = method([stretch], site(motion), Options(priors=priors))[0]
    return estimate, errors(estimate.C_nb.as_matrix()[None], C)[0]


def campaign(seed, motion, seconds, rate, runs, priors, known=None, method=inertial):
    """Errors (runs, 3) and covariances (runs, 3, 3): noise and constants drawn from `priors`;
    the estimator is told `known`, or all of it."""
    rng = np.random.default_rng(seed)
    t, w, f, C = motion.readings(seconds, rate, 100.0)
    sigmas = np.repeat([priors.gyro_bias, priors.accel_bias], 3)
    biases = sigmas * rng.normal(size=(runs, 6))
    scales = 1 + np.repeat([priors.gyro_scale, priors.accel_scale], 3) * rng.normal(size=(runs, 6))
    found, covariances = [], []
    options = Options(priors=priors if known is None else known)
    for first in range(0, runs, 250):  # a few at once: bounds the memory
        part = slice(first, min(first + 250, runs))
        rates, forces = noisy(
            rng,
            w,
            f,
            rate,
            part.stop - part.start,
            priors.gyro_walk,
            priors.accel_walk,
            biases[part],
        )
        rates = rates + (scales[part, None, :3] - 1) * w
        forces = forces + (scales[part, None, 3:] - 1) * f
        dwells = [dwell(t, a, b) for a, b in zip(rates, forces, strict=True)]
        for estimate in method(dwells, site(motion), options):
            found.append(estimate.C_nb.as_matrix())
            covariances.append(estimate.covariance)
    return errors(np.array(found), C), np.array(covariances)


def nees(error, covariance):
    return np.einsum("ki,ki->k", error, np.linalg.solve(covariance, error[..., None])[..., 0])


# --- the reference ----------------------------------------------------------------------------


@pytest.mark.parametrize("latitude", [48.5, -33.0, 89.0])
def test_gravity_turns_with_the_earth(latitude):
    """Against fine quadrature of ``-g`` turned about the Earth's axis, seen from the end."""
    t = np.linspace(50.0, 50.0 + 7200.0, 7201)
    where = Site(radians(latitude), local_gravity=G, deflection=(3e-4, -2e-4))
    v, p = gravity_velocity(t, where)
    back = Rotation.from_rotvec((t - t[-1])[:, None] * earth_n(latitude))
    f = back.apply(where.f_n)
    want = cumulative_trapezoid(f, t, axis=0, initial=0)
    # Trapezoids of 1 s: (W * 1 s)^2/12 of 70 km/s; of the second integral likewise.
    np.testing.assert_allclose(v, want, rtol=0, atol=5e-5)
    np.testing.assert_allclose(p, cumulative_trapezoid(want, t, axis=0, initial=0), atol=0.2)
    # By hand: the first second points up, and horizontally where n has turned from: the Earth
    # carried the vertical toward east, so an earlier one lies west by W cos lat T of gravity.
    early = v[1] / 1.0
    assert early[2] == pytest.approx(-G, rel=0.2)
    assert early[1] == pytest.approx(-G * cos(radians(latitude)) * np.sin(W * 7200), abs=0.01)


# --- exact readings ---------------------------------------------------------------------------


@pytest.mark.parametrize("latitude", [0.0, 48.5, -33.0, 75.0, -75.0])
@pytest.mark.parametrize("motion", [STILL, CAROUSEL, X1_UP], ids=["still", "carousel", "X1 up"])
def test_perfect_sensors_give_the_attitude(motion, latitude):
    motion = replace(motion, latitude_deg=latitude)
    estimate, error = one(motion, 60.0, 20.0)
    assert estimate.method == METHOD
    assert (estimate.t_from, estimate.t_to) == (100.0, 160.0)
    # The steps' third order in |w| 0.1 s: under 1e-9 of g in tilt, over W cos lat T in heading.
    np.testing.assert_allclose(error[:2], 0, rtol=0, atol=2e-8)
    assert abs(error[2]) < 1e-4
    assert not estimate.flags


@pytest.mark.parametrize("latitude", [48.5, -33.0, 75.0])
def test_sway_with_a_lever_arm_leaves_less_than_its_sigma(latitude):
    """Five degrees at 0.2 Hz, 14 cm off the crossing: the analytic method would see 6 deg/s."""
    motion = replace(ROCKING, latitude_deg=latitude)
    estimate, error = one(motion, 120.0, 100.0)
    sigma = np.sqrt(estimate.covariance.diagonal())
    assert (np.abs(error) < 2 * sigma).all()
    # 60 r/(g T^2 W T cos lat) with r = 1.5 cm, and what its sigma must not exceed.
    assert abs(error[2]) < 60 * 0.015 / (G * 120**3 * W * cos(radians(latitude)))
    assert abs(error[2]) < radians(0.1)


def test_answer_does_not_depend_on_the_start_of_the_clock_or_the_label():
    first, _ = one(ROCKING, 60.0, 50.0)
    stretch, _ = exact(ROCKING, 60.0, 50.0)
    r = stretch.readings
    later = Dwell("q", 1e5, 1e5 + 60.0, ImuReadings(r.t - 100.0 + 1e5, r.w_ib_b, r.f_b))
    second = inertial([later], site(ROCKING), Options(priors=QUIET))[0]
    # Stamps of 1e5 s round to 1e-11 s: 1e-10 of each increment, times W T's lever of 300.
    np.testing.assert_allclose(second.C_nb.as_matrix(), first.C_nb.as_matrix(), atol=1e-7)


# --- covariance -------------------------------------------------------------------------------


@pytest.mark.parametrize("motion", [SLOW, CAROUSEL, STILL], ids=["rocking", "carousel", "still"])
@pytest.mark.parametrize(
    "constant",
    [
        "gyro_bias",
        "accel_bias",
        "gyro_scale",
        "accel_scale",
        "gyro_misalignment",
        "gyro_non_orthogonality",
        "accel_misalignment",
        "accel_non_orthogonality",
    ],
)
def test_sensitivity_to_constants_by_differencing_the_estimator(motion, constant):
    """What a prior adds to the covariance is the outer product of the estimator's own slopes."""
    size = {"gyro_bias": 1e-9, "gyro_misalignment": 1e-6, "gyro_non_orthogonality": 1e-6}.get(
        constant, 1e-5
    )
    t, w, f, _ = motion.readings(60.0, 10.0, 100.0)
    options = Options(priors=NO_BIAS)
    base = inertial([dwell(t, w, f)], site(motion), options)[0]
    slopes = []
    for axis in np.eye(3):
        rates, forces = w, f
        if constant == "gyro_bias":
            rates = w + size * axis
        elif constant == "gyro_scale":
            rates = w * (1 + size * axis)
        elif constant == "accel_bias":
            forces = f + size * axis
        elif constant == "accel_scale":
            forces = f * (1 + size * axis)
        else:
            x, y, z = size * axis
            turn_ = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])  # what is felt, times the axis
            lean = np.array([[0, z, y], [z, 0, x], [y, x, 0]]) / 2
            by = (lean if "ortho" in constant else -turn_).T
            rates, forces = (w + w @ by, f) if "gyro" in constant else (w, f + f @ by)
        moved = inertial([dwell(t, rates, forces)], site(motion), options)[0]
        slopes.append(errors(moved.C_nb.as_matrix()[None], base.C_nb.as_matrix())[0])
    with_prior = replace(NO_BIAS, **{constant: size})
    wider = inertial([dwell(t, w, f)], site(motion), Options(priors=with_prior))[0]
    want = np.array(slopes).T @ np.array(slopes)
    got = wider.covariance - base.covariance
    root = np.sqrt(want.diagonal())
    root = np.maximum(root, 1e-4 * root.max())  # a tilt of 0.1 % of the heading is none
    # Sums over blocks against samples, and the slopes' own second order.
    np.testing.assert_allclose(got / np.outer(root, root), want / np.outer(root, root), atol=0.03)


def test_white_noise_of_unlike_axes_is_told_apart():
    """A gyro noisy about the vertical alone leaves heading; about the horizontal it does not."""
    motion = Motion(yaw=Angle(pi / 2))  # X1 east, Y1 up
    stretch, _ = exact(motion, 60.0, 10.0)
    carried = carry(stretch.readings, 1.0)
    m = len(carried.spans)
    gyro = np.tile(np.eye(3), (m, 1, 1))  # the sum of all rotations, in n
    C_ni = motion.state(np.zeros(1))[0][0]
    noise = Noise(np.array([1e-5, 2e-5, 3e-5]), np.zeros(3))
    P = functional_covariance(gyro, 0 * gyro, C_ni, carried, noise, Priors())
    # X1 points east, Y1 up, Z1 south: walks of 60 s, on the diagonal to the Earth's turn of 0.004.
    want = 60 * np.array([3e-5, 1e-5, 2e-5]) ** 2
    np.testing.assert_allclose(P, np.diag(want), atol=0.005 * want.max())


def test_a_jitter_of_velocity_by_differencing_the_match():
    """White noise j of velocity leaves block means of T an error of j/sqrt(T) each."""
    stretch, _ = exact(STILL, 20.0, 50.0)
    carried, where = carry(stretch.readings, 1.0), site(STILL)
    matched = match(carried, where)
    none = Noise(np.zeros(3), np.zeros(3))
    arm = arm_of(carried, matched, none, Priors(), where)
    found, wander = covariances(carried, matched, replace(none, jitter=1e-6), Priors(), arm, where)
    base, still = covariances(carried, matched, none, Priors(), arm, where)
    slopes = []
    for m, span in enumerate(carried.spans):
        for axis in np.eye(3):
            p = carried.p.copy()
            p[m] += 1e-6 * np.sqrt(span) * axis
            moved = match(replace(carried, p=p), where)
            slopes.append((moved.C_ni * matched.C_ni.inv()).as_rotvec())
    want = np.array(slopes).T @ np.array(slopes)
    scale = np.sqrt(np.outer(want.diagonal(), want.diagonal()))
    np.testing.assert_allclose((found - base) / scale, want / scale, atol=1e-3)
    # of displacement of order 3 over 20 s: j^2 T/7, the polynomial's mean square, by blocks of 1 s
    assert (wander - still)[0, 0] == pytest.approx(1e-12 * 20 / 7, rel=0.05)


# --- Monte Carlo ------------------------------------------------------------------------------

T, RATE = 60.0, 5.0
FLOOR = radians(2.3)  # of heading: below 8 deg also where it is 3.5 times as large
ARW = FLOOR * W * cos(radians(48.5)) * sqrt(T)


@pytest.mark.slow
def test_heading_reaches_the_published_part_of_the_floor():
    """1.1 to 1.3 of ``ARW/(W cos lat sqrt T)``; centred velocity curves promise sqrt(10/7)."""
    runs = 2000
    priors = Priors(1e-14, gyro_walk=ARW, accel_walk=1e-5)  # a sheet: no drift is looked for
    error, covariance = campaign(12, SLOW, T, RATE, runs, priors)
    ratio = np.sqrt(np.mean(error[:, 2] ** 2)) / FLOOR
    low, high = np.sqrt(runs / chi2.ppf([0.975, 0.025], runs)) * ratio
    assert low < 1.3
    assert high > 1.1
    assert low < sqrt(10 / 7) < high
    assert np.sqrt(covariance[:, 2, 2].mean()) / FLOOR == pytest.approx(sqrt(10 / 7), rel=0.01)
    assert ratio > 1  # nothing lies below the floor


NOISE = Priors(gyro_walk=ARW, accel_walk=1e-4)
SMALL = ARW / 5
REGIMES = {
    "noise": (STILL, NOISE),
    "noise, rocking": (SLOW, NOISE),
    "accelerometer noise": (STILL, Priors(gyro_walk=ARW / 15, accel_walk=1e-3)),
    "biases": (STILL, Priors(1e-6, 1e-3, gyro_walk=SMALL, accel_walk=1e-4)),
    "biases, rocking, north": (
        replace(SLOW, latitude_deg=75.0),
        Priors(1e-6, 1e-3, gyro_walk=SMALL, accel_walk=1e-4),
    ),
    "biases, rocking, south": (
        replace(SLOW, latitude_deg=-33.0),
        Priors(2e-6, 3e-3, gyro_walk=SMALL, accel_walk=1e-4),
    ),
    "carousel": (CAROUSEL, Priors(4e-6, 1e-3, 1e-6, 1e-4, gyro_walk=SMALL, accel_walk=1e-4)),
}
RUNS = 200


@pytest.mark.slow
def test_normalised_errors_are_chi_square_in_every_regime():
    tail = 0.025 / len(REGIMES)
    low, high = chi2.ppf([tail, 1 - tail], 3 * RUNS) / RUNS  # family-wise 95 %
    found = {}
    for k, (name, (motion, priors)) in enumerate(REGIMES.items()):
        error, covariance = campaign(100 + k, motion, T, RATE, RUNS, priors)
        assert np.sqrt(covariance[:, 2, 2]).max() < radians(8)
        found[name] = nees(error, covariance).mean()
    assert all(low < value < high for value in found.values()), (low, high, found)


def astray(seed, motion, rate, runs, priors, known, method=inertial):
    """As `campaign`, of gyros whose axes are off by `priors`' misalignment and leaning."""
    rng = np.random.default_rng(seed)
    t, w, f, C = motion.readings(T, rate, 100.0)
    found, covariances = [], []
    for _ in range(runs):
        x, y, z = priors.gyro_misalignment * rng.normal(size=3)
        a, b, c = priors.gyro_non_orthogonality * rng.normal(size=3) / 2
        M = np.array([[0, z + c, b - y], [c - z, 0, x + a], [y + b, a - x, 0]])
        rates = w @ (np.eye(3) + M).T + priors.gyro_bias * rng.normal(size=3)
        rates += priors.gyro_walk * sqrt(rate) * rng.normal(size=w.shape)
        forces = f + priors.accel_walk * sqrt(rate) * rng.normal(size=f.shape)
        (estimate,) = method([dwell(t, rates, forces)], site(motion), Options(priors=known))
        found.append(estimate.C_nb.as_matrix())
        covariances.append(estimate.covariance)
    return errors(np.array(found), C), np.array(covariances)


ASTRAY = Priors(
    1e-6, gyro_walk=SMALL, accel_walk=1e-4, gyro_misalignment=3e-4, gyro_non_orthogonality=2e-4
)


@pytest.mark.slow
@pytest.mark.parametrize("motion", [CAROUSEL, SLOW], ids=["carousel", "rocking"])
def test_gyros_that_are_astray_are_in_the_covariance_of_what_turns(motion):
    """12 deg/s times 0.3 mrad is 13 deg/h across the vertical, as large as the Earth's rate."""
    error, covariance = astray(51, motion, 5.0, 60, ASTRAY, ASTRAY)
    low, high = chi2.ppf([0.0125, 0.9875], 180) / 60
    assert low < nees(error, covariance).mean() < high
    if motion is CAROUSEL:  # and without it they are not
        blind = replace(ASTRAY, gyro_misalignment=0.0, gyro_non_orthogonality=0.0)
        error, covariance = astray(51, motion, 5.0, 20, ASTRAY, blind)
        assert nees(error, covariance).mean() > 2 * high


@pytest.mark.slow
def test_noise_told_from_rocking_readings_serves_as_well():
    """At 20 Hz 60 s give the levels to 7 %: what that adds to the NEES is below its bounds. Sigmas
    hold a flicker that the record may hide, of which there is none: at most twice the variance."""
    error, covariance = campaign(31, SLOW, T, 20.0, 200, NOISE, known=Priors())
    low, high = chi2.ppf([0.025, 0.975], 600) / 200
    assert low / 2 < nees(error, covariance).mean() < high * 1.02


def test_shortest_record_has_a_track_of_one_point():
    stretch, _ = exact(STILL, 3.2, 10.0)
    (track,) = inertial_tracks(stretch, site(STILL), Options(priors=QUIET))
    assert len(track.t) == 1


@pytest.mark.slow
def test_a_sway_counts_where_it_begins_and_where_it_ends():
    """Perfect sensors on a base whose place sways by 3 cm: both ends are in the sigma, each alike.

    Phases are drawn, so squares of errors over the stated variances are 1 on average; 2 if one end
    alone counted.
    """
    rng = np.random.default_rng(61)
    ratios = []
    for _ in range(80):
        sway = tuple(
            Angle(amplitude=0.03, frequency=rng.uniform(0.15, 0.3), phase=rng.uniform(0, 2 * pi))
            for _ in range(3)
        )
        estimate, error = one(replace(STILL, sway=sway), 60.0, 10.0)
        ratios.append(error**2 / estimate.covariance.diagonal())
    # a square of a sum of two waves' ends: variance 1.5 to 2, so 0.15 of the mean of 80; three
    north, east, down = np.mean(ratios, axis=0)
    assert 0.55 < down < 1.45
    assert 0.4 < (north + east) / 2 < 1.6


def test_the_law_of_a_sway():
    """``60 r/(g T^2)`` of tilt over ``W T cos lat``, one end at its extreme and one at rest."""
    r, seconds = 0.03, 60.0
    # toward east: (0, r cos) at the start at its extreme, at the end a quarter later at zero
    east = Angle(amplitude=r, frequency=12.25 / seconds, phase=pi / 2)
    estimate, error = one(replace(STILL, sway=(Angle(), east, Angle())), seconds, 20.0, NO_BIAS)
    north = Angle(amplitude=r, frequency=12.25 / seconds, phase=pi / 2)
    other, off = one(replace(STILL, sway=(north, Angle(), Angle())), seconds, 20.0, NO_BIAS)
    law = 60 * r / (G * seconds**2) / (W * seconds * cos(radians(48.5)))
    # sway toward north is the one that feigns a turn of gravity
    assert max(abs(error[2]), abs(off[2])) == pytest.approx(law, rel=0.15)
    # r/sqrt 2 at each of both ends make the law again; orders up to 8 take 2 % of the wave's square
    assert sqrt(other.covariance[2, 2]) == pytest.approx(0.98 * law, rel=0.01)
    assert sqrt(estimate.covariance[2, 2]) < 0.03 * law


# --- noise from the readings ------------------------------------------------------------------


def test_white_levels_under_sway():
    rng = np.random.default_rng(5)
    t, w, f, _ = ROCKING.readings(300.0, 50.0)
    levels = np.array([1e-6, 1e-4])
    rates = w + levels[0] * sqrt(50) * rng.normal(size=w.shape)
    forces = f + levels[1] * sqrt(50) * rng.normal(size=f.shape)
    noise = noise_of(ImuReadings(t, rates, forces), Priors())
    # The octave from 6 to 12 Hz holds 1900 lines, half of them independent: 1.6 %, of six 4 sigma.
    np.testing.assert_allclose(noise.gyro, levels[0], rtol=0.065)
    np.testing.assert_allclose(noise.accel, levels[1], rtol=0.065)


def test_dither_is_not_taken_for_noise():
    """White 1e-7 rad/rt-s, and angle noise that makes single samples 40 times noisier."""
    rng = np.random.default_rng(6)
    n, dt = 60_000, 0.005
    angle = 40 * 1e-7 * sqrt(dt) * rng.normal(size=(n + 1, 2)) / sqrt(2)
    rates = 1e-7 / sqrt(dt) * rng.normal(size=(n, 2)) + np.diff(angle, axis=0) / dt
    # Sixteen lines of the lowest octave: 1 sigma 20 %.
    np.testing.assert_allclose(white_levels(rates, dt), 1e-7, rtol=0.6)


def test_priors_come_before_the_readings():
    stretch, _ = exact(STILL, 20.0, 10.0)
    noise = noise_of(stretch.readings, Priors(gyro_walk=3.0, accel_walk=4.0))
    np.testing.assert_array_equal(noise.gyro, [3.0] * 3)
    np.testing.assert_array_equal(noise.accel, [4.0] * 3)


# --- tracks -----------------------------------------------------------------------------------


def test_track_ends_at_the_estimate_and_its_sigma_falls():
    stretch, _ = exact(SLOW, 90.0, 10.0)
    options = Options(priors=Priors(gyro_walk=1e-6, accel_walk=1e-4))
    (track,) = inertial_tracks(stretch, site(SLOW), options)
    (estimate,) = inertial([stretch], site(SLOW), options)
    assert track.t[-1] == estimate.t_to
    np.testing.assert_allclose(track.C_nb[-1].as_matrix(), estimate.C_nb.as_matrix(), atol=1e-12)
    np.testing.assert_allclose(track.covariance[-1], estimate.covariance, rtol=1e-9)
    sigma = np.sqrt(track.covariance[:, 2, 2])
    assert sigma[len(sigma) // 3] > 1.5 * sigma[-1]
    # Each point is the attitude then: exact readings stay within its sigma.
    now, _, _ = SLOW.state(track.t - 100.0)
    late = track.t > 130.0
    turned = (track.C_nb * Rotation.from_matrix(now).inv()).as_rotvec()
    assert (np.abs(turned[late, 2]) < 2 * sigma[late]).all()


def test_an_accelerometers_drift_feigns_a_turn():
    """``d/(g W T cos lat)`` of heading, as the notes say: north, as gravity turns east."""
    t, w, f, C = STILL.readings(T, 10.0, 100.0)
    north = C.T @ [1.0, 0.0, 0.0]
    drifting = dwell(t, w, f + 1e-5 * ((t - 100.0) / T)[:, None] * north)
    estimate = inertial([drifting], site(STILL), Options(priors=QUIET))[0]
    error = errors(estimate.C_nb.as_matrix()[None], C)[0]
    assert abs(error[2]) == pytest.approx(1e-5 / (G * W * T * cos(radians(48.5))), rel=0.01)


def test_perfect_sensors_without_priors_are_answered_in_silence():
    """No noise at all in the readings: the covariance is of sway alone, and nothing is NaN."""
    estimate, _ = one(ROCKING, 120.0, 50.0, Priors())
    assert not estimate.flags
    assert np.isfinite(estimate.covariance).all()


# --- refusals ---------------------------------------------------------------------------------


def test_pole_and_unknown_latitude_are_refused():
    stretch, _ = exact(STILL, 20.0, 10.0)
    with pytest.raises(PoleError):
        inertial([stretch], Site(radians(89.99)), Options())
    with pytest.raises(AlignmentError, match="latitude"):
        inertial([stretch], Site(None), Options())


def test_a_gap_is_refused():
    stretch, _ = exact(STILL, 20.0, 10.0)
    r = stretch.readings
    keep = np.r_[0:50, 75:200]
    holed = Dwell("p", 100.0, 120.0, ImuReadings(r.t[keep], r.w_ib_b[keep], r.f_b[keep]))
    with pytest.raises(AlignmentError, match=r"p: gap of 2\.6 s"):
        inertial([holed], site(STILL), Options())


def test_too_few_samples_are_refused():
    stretch, _ = exact(STILL, 3.0, 10.0)
    with pytest.raises(TooShort, match="30 samples, at least 32"):
        inertial([stretch], site(STILL), Options(priors=QUIET))
    stretch, _ = exact(STILL, 5.0, 10.0)
    with pytest.raises(TooShort, match="noise needs 64"):
        inertial([stretch], site(STILL), Options())


def test_a_vehicle_that_speeds_up_and_brakes_is_refused():
    """2 m/s back and forth in 50 s: a displacement of 16 m, far beyond any stand."""
    moving = replace(STILL, sway=(Angle(amplitude=16.0, frequency=0.02), Angle(), Angle()))
    with pytest.raises(NotAtRest, match="the instrument travels"):
        one(moving, 120.0, 10.0)


def test_slow_motion_below_the_limit_is_remarked():
    moving = replace(STILL, sway=(Angle(amplitude=0.05, frequency=0.02), Angle(), Angle()))
    estimate, _ = one(moving, 120.0, 10.0)
    assert any("velocity wanders" in flag for flag in estimate.flags)


def test_wrong_gravity_and_unsure_heading_are_remarked():
    stretch, _ = exact(STILL, 20.0, 10.0)
    elsewhere = Site(radians(48.5), local_gravity=9.6)
    estimate = inertial([stretch], elsewhere, Options(priors=QUIET))[0]
    assert any("is not gravity" in flag for flag in estimate.flags)
    estimate, _ = one(STILL, 20.0, 10.0, replace(QUIET, gyro_walk=1e-3))
    assert any("above 8 deg" in flag for flag in estimate.flags)


# --- a lever arm ----------------------------------------------------------------------------------


def test_tilt_holds_where_heading_is_anywhere():
    """Accelerometers of 3 m/s/rt h hide the turn of 40 s: heading is off by 70 deg, and tilt at the
    end by how that turns the Earth's rate: about north 1.6 times what first order has."""
    random, at, hz = np.random.default_rng(3), Site(radians(30)), 4
    priors = Priors(gyro_walk=1e-12, accel_walk=0.05, gyro_bias=1e-9)
    t, seen = np.arange(1, 161) / hz, []
    for _ in range(300):
        true = Rotation.from_euler("Z", random.uniform(0, 2 * pi))
        w = np.tile(true.inv().apply(at.w_ie_n), (len(t), 1))
        f = true.inv().apply(at.f_n) + 0.05 * sqrt(hz) * random.standard_normal((len(t), 3))
        (e,) = inertial([dwell(t, w, f)], at, Options(priors=priors))
        down = (e.C_nb * true.inv()).apply([0, 0, 1])
        seen.append(np.array([-down[1], down[0]]) / np.sqrt(e.covariance.diagonal()[:2]))
    # 4 / sqrt(2 * 300)
    assert np.sqrt(np.mean(np.square(seen), axis=0)) == pytest.approx(1.0, abs=0.16)


def turning(rate_deg_s):
    return Motion(yaw=Angle(rate=radians(rate_deg_s)), lever=(0.04, 0.06, 0.05))


@pytest.mark.parametrize("rate", [30.0, -60.0])
def test_a_table_that_turns_shows_the_arm(rate):
    """Perfect sensors 64 mm beside the axis: without the arm wrong by degrees, with it not.

    The arm along the axis does not move, and is not found. By hand: at 30 deg/s (0.5236 rad/s)
    0.0640 m are 33.5 mm/s across, on a curve that tells heading by W cos lat g T^2/8 = 0.061 m/s.
    """
    motion = turning(rate)
    stretch, C = exact(motion, 32.0, 20.0)
    blind = Priors(gyro_walk=SMALL, accel_walk=1e-4)
    (wrong,) = inertial([stretch], site(motion), Options(priors=blind))
    (told,) = inertial([stretch], site(motion), Options(priors=replace(blind, lever_arm=0.055)))
    off = [abs(errors(e.C_nb.as_matrix()[None], C)[0, 2]) for e in (wrong, told)]
    assert off[0] > radians(1.0)
    assert off[1] < 0.01 * off[0]
    carried = carry(stretch.readings, 0.5)
    _, _, arm = laid(stretch.readings, carried, site(motion), replace(blind, lever_arm=0.055))
    # Y1 is up, so X1 and Z1 swing; their noise is 1e-4 m/s/rt-s: a tenth of a millimetre
    assert arm.place[[0, 2]] == pytest.approx([0.04, 0.05], abs=5e-4)
    assert abs(arm.place[1]) < 1e-3
    assert arm.left[1, 1] == pytest.approx(0.055, rel=1e-3)


def test_an_arm_that_does_not_show_is_in_the_sigma():
    """1 deg/s (0.01745 rad/s): centripetal ``w^2 r`` of 0.055 m is 1.68e-5 m/s^2, of g 1.71e-6."""
    motion = turning(1.0)
    stretch, _ = exact(motion, 4.0, 20.0)
    blind = Priors(gyro_walk=1e-10, accel_walk=1e-7)
    P = []
    for arm in (0.0, 0.055):
        (found,) = inertial(
            [stretch], site(motion), Options(priors=replace(blind, lever_arm=arm, accel_bias=1e-3))
        )
        P.append(found.covariance)
    added = np.sqrt(np.diag(P[1] - P[0])[:2])
    # two components of the arm lean north and east alike, each w^2 r/g, less what 4 deg turn
    assert added == pytest.approx(1.71e-6, rel=0.02)


def test_what_rests_needs_no_arm():
    stretch, _ = exact(STILL, 60.0, 10.0)
    plain, armed = (
        inertial([stretch], site(STILL), Options(priors=replace(QUIET, lever_arm=arm)))[0]
        for arm in (0.0, 0.7)
    )
    # it moves with the Earth, which gravity holds: W^2 r/g is 4e-10 rad
    assert np.abs((armed.C_nb * plain.C_nb.inv()).as_rotvec()).max() < 1e-9
    np.testing.assert_allclose(armed.covariance, plain.covariance, rtol=1e-6, atol=1e-20)
