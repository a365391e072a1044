"""What a stated bias instability adds: closed forms and slopes of the estimators, by hand."""

from dataclasses import replace
from math import cos, radians, sqrt, tan

import numpy as np
import pytest
from rocking import G, Motion
from scipy.spatial.transform import Rotation
from test_inertial import NO_BIAS, SLOW, STILL, dwell, errors, site

from alignment import ESTIMATORS, Dwell, ImuReadings, Options, Priors, Site
from alignment.information.drift import Span, flicker, gauss_markov
from alignment.methods.drifting import Held, held
from alignment.methods.fine import filtered
from alignment.methods.inertial import inertial
from alignment.methods.six_position import six_position

W = 7.292115e-5  # rad/s
LEVEL = Motion()  # X1 north, Y1 up, Z1 east


@pytest.mark.parametrize("latitude", [48.5, -33.0])
def test_later_samples_differ_from_the_offset_by_twice_the_plateau_squared(latitude):
    """Adjacent means differ by sqrt(2) of their Allan deviation: that is its definition."""
    lat = radians(latitude)
    motion = replace(LEVEL, latitude_deg=latitude)
    t, w, f, C = motion.readings(60.0, 10)
    stretch = Dwell("p", 0.0, 60.0, ImuReadings(t, w, f), Rotation.from_matrix(C))
    where = Site(lat, local_gravity=G)
    told = Options(priors=Priors(gyro_instability=3e-8, accel_instability=2e-4))
    P = six_position([stretch], where, told)[1].covariance
    assert P is not None
    tilt = sqrt(2) * 2e-4 / G
    heading = sqrt(2) * 3e-8 / (W * cos(lat))
    np.testing.assert_allclose(np.sqrt(P.diagonal()[:2]), tilt, rtol=1e-3)
    assert sqrt(P[2, 2]) == pytest.approx(np.hypot(heading, tan(lat) * tilt), rel=1e-3)
    assert P[0, 2] == pytest.approx(-tan(lat) * tilt**2, rel=1e-3)


@pytest.mark.parametrize("motion", [SLOW, STILL], ids=["rocking", "still"])
@pytest.mark.parametrize("sensor", ["gyro", "accel"])
def test_inertial_takes_a_plateau_for_what_the_data_sheet_means(motion, sensor):
    """By differencing: errors of each three seconds, and how a flicker's means of them covary."""
    size, parts = (1e-9 if sensor == "gyro" else 1e-5), 20
    t, w, f, _ = motion.readings(60.0, 10.0, 100.0)
    base = inertial([dwell(t, w, f)], site(motion), Options(priors=NO_BIAS))[0]
    slopes = []
    for axis in np.eye(3):
        for own in np.split(np.arange(len(t)), parts):
            more = np.zeros((len(t), 3))
            more[own] = size * axis
            rates, forces = (w + more, f) if sensor == "gyro" else (w, f + more)
            moved = inertial([dwell(t, rates, forces)], site(motion), Options(priors=NO_BIAS))[0]
            slopes.append(errors(moved.C_nb.as_matrix()[None], base.C_nb.as_matrix())[0])
    J = np.array(slopes).reshape(3, parts, 3)
    spans = [Span(3.0 * k, 3.0) for k in range(parts)]
    means = sum(one.sigma**2 * gauss_markov(spans, one.time) for one in flicker(1.0))
    want = np.einsum("amk,mn,anl->kl", J, means, J)
    told = Options(priors=replace(NO_BIAS, **{f"{sensor}_instability": size}))
    got = inertial([dwell(t, w, f)], site(motion), told)[0].covariance - base.covariance
    root = np.sqrt(want.diagonal())
    # the gain's own change in three seconds, and the slopes' second order
    np.testing.assert_allclose(got / np.outer(root, root), want / np.outer(root, root), atol=0.03)


def test_a_walk_and_a_ramp_of_biases_are_stated_by_inertial():
    """Level at rest, of the accelerometers: the tilt about north, by hand."""
    t, w, f, _ = LEVEL.readings(60.0, 10)
    where = Site(radians(48.5), local_gravity=G)

    def tilt(**told):
        options = Options(priors=replace(NO_BIAS, **told))
        P = inertial([dwell(t, w, f)], where, options)[0].covariance
        return P[0, 0]

    quiet = tilt()
    # the velocity's best line weighs forces by the parabola 6 s (1 - s): of a walk, whose step at s
    # goes on to the end, the integral of (1 - 3 s^2 + 2 s^3)^2 is left, of a ramp the half
    walked = (tilt(accel_random_walk=1e-6) - quiet) * G**2
    assert walked / (1e-12 * 60) == pytest.approx(13 / 35, rel=1e-3)
    ramped = (tilt(accel_ramp=1e-7) - quiet) * G**2
    assert ramped / (1e-7 * 60 / 2) ** 2 == pytest.approx(1, rel=1e-3)


def test_what_noise_hides_is_noise_and_what_outlasts_the_record_walks():
    """Processes of ``B / 0.76475`` each, at 1, 10, ... 10000 s; ``2 s^2 T`` against a tenth of N^2.

    B = 1 and N = 7: of 3.42 and 34.2 the first is hidden by 4.9; 1000 s and 10000 s outlast 600 s.
    """
    square = 1 / 0.76475**2
    priors = Priors(gyro_bias=2.0, gyro_instability=1.0, gyro_random_walk=0.02, gyro_ramp=1e-3)
    found = held(priors, "gyro", 7.0, 600.0)
    assert [one.time for one in found.states] == [10.0, 100.0]
    assert [one.sigma for one in found.states] == pytest.approx([1 / 0.76475] * 2)
    assert found.white == pytest.approx(sqrt(2 * square))
    walk = 0.02**2 + 1e-6 * 600 + 2 * square * (1e-3 + 1e-4)
    assert found.walk == pytest.approx(sqrt(walk))
    assert found.bias == pytest.approx(sqrt(4 - square))  # 100 s outlasts a minute
    unknown = held(replace(priors, gyro_bias=0.0), "gyro", 7.0, 600.0)
    assert [one.time for one in unknown.states] == [10.0, 100.0, 1000.0, 10000.0]
    assert held(Priors(accel_bias=3.0), "accel", 1.0, 60.0) == Held(3.0, 0.0, 0.0, ())


@pytest.mark.parametrize("noise", [1e-4, 1e-3], ids=["drift", "noise"])
def test_a_filter_at_rest_knows_what_the_best_weights_leave(noise):
    """By Gauss and Markov: ``1/(1^T C^-1 1)`` of a constant, and of a line its slope.

    Level, with gyros that are perfect: the tilt about north is the mean force to east over g; a
    heading that is off turns the Earth's rate to east, which tilts by ``W cos lat`` times it.
    """
    t, w, f, _ = LEVEL.readings(60.0, 10)
    # a bias along north that nobody knows would make the tilt about it a line, not a constant
    priors = Priors(gyro_bias=1e-15, gyro_walk=1e-10, accel_walk=noise, accel_instability=1e-4)
    P = filtered(
        dwell(t, w, f), Site(radians(48.5), local_gravity=G), Options(priors=priors)
    ).covariance[-1]
    apart = np.abs(t[:, None] - t)
    C = noise**2 / 0.1 * np.eye(len(t))
    for time in (1.0, 10.0, 100.0, 1000.0, 10000.0):
        C += (1e-4 / 0.76475) ** 2 * np.exp(-apart / time)
    A = np.stack([np.ones(len(t)), t - t.mean()], axis=1)
    one, line = (
        np.linalg.inv(A[:, :1].T @ np.linalg.solve(C, A[:, :1])),
        np.linalg.inv(A.T @ np.linalg.solve(C, A)),
    )
    # processes that the noise hides are taken for white: up to a twentieth of each sigma
    assert sqrt(P[0, 0]) == pytest.approx(sqrt(one[0, 0]) / G, rel=0.05)
    assert sqrt(P[2, 2]) == pytest.approx(sqrt(line[1, 1]) / (G * W * cos(radians(48.5))), rel=0.05)


@pytest.mark.parametrize("method", ["triad", "single-gyro", "two-gyro"])
def test_biases_have_walked_since_they_were_switched_on(method):
    """A mean over T that begins at t: ``K^2 (t + T/3)`` of a walk, ``R (t + T/2)`` of a ramp.

    Both are of gyros, which a level X1 north makes heading of, by ``1/(W cos lat)``.
    """
    t, w, f, C = LEVEL.readings(60.0, 10, start=90.0)
    stretch = Dwell("p", 90.0, 150.0, ImuReadings(t, w, f), Rotation.from_matrix(C))
    where = Site(radians(48.5), local_gravity=G)

    def heading(**told):
        (e, *_) = ESTIMATORS[method].estimate([stretch], where, Options(priors=Priors(**told)))
        return e.covariance[2, 2] * (W * cos(radians(48.5))) ** 2

    quiet = heading(gyro_walk=1e-9)
    walked = heading(gyro_walk=1e-9, gyro_random_walk=1e-9) - quiet
    assert walked == pytest.approx(1e-18 * (90 + 60 / 3), rel=1e-3)
    ramped = heading(gyro_walk=1e-9, gyro_ramp=1e-10) - quiet
    assert ramped == pytest.approx((1e-10 * 120) ** 2, rel=1e-3)


def test_offsets_and_later_readings_walk_apart():
    """Means of the first ten seconds and of the fifty behind them: ``K^2 (10 + 50)/3``, ``30 R``.

    Integrated over those fifty: ``K^2 50^2 (10 + 50)/3`` and ``R 50 (10 + 50)/2``.
    """
    t, w, f, C = LEVEL.readings(60.0, 10, start=90.0)
    stretch = Dwell("p", 90.0, 150.0, ImuReadings(t, w, f), Rotation.from_matrix(C))
    where = Site(radians(48.5), local_gravity=G)
    for method, scale in (("six-position", W * cos(radians(48.5))), ("rk4", 1 / 50)):
        quiet, walked, ramped = (
            ESTIMATORS[method].estimate([stretch], where, Options(priors=told))[-1].covariance
            for told in (Priors(), Priors(gyro_random_walk=1e-9), Priors(gyro_ramp=1e-10))
        )
        assert (walked - quiet)[2, 2] * scale**2 == pytest.approx(1e-18 * 20, rel=1e-6), method
        assert (ramped - quiet)[2, 2] * scale**2 == pytest.approx((30e-10) ** 2, rel=1e-6), method
