"""Turning at a slow rate: phase against the encoder, biases and scale in the other coefficients."""

from dataclasses import replace
from math import cos, degrees, pi, radians, sin, sqrt, tan

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import chi2, norm

from alignment import Dwell, ImuReadings, Options, Priors, Site, Turn
from alignment.errors import AlignmentError, NotAtRest, PoleError, TooShort
from alignment.methods.carousel import (
    _alike,
    carousel,
    carousel_attitude,
    combined,
    lag_of,
    whole_turns,
)
from alignment.methods.harmonics import (
    Harmonics,
    TurningVector,
    harmonic_fit,
    interval_harmonics,
    turning_vector,
)

W = 7.292115e-5  # rad/s
G = 9.8093587  # m/s^2
DEG_H = pi / 180 / 3600
DEG_RT_H = pi / 180 / 60  # rad/sqrt(s)
MINUTE = pi / 180 / 60
MILLI_G = 9.80665e-3
N, E, D = np.eye(3)
LEVEL = np.column_stack([N, -D, E])  # X1 north, Y1 up, Z1 east
NOSE_60 = Rotation.from_rotvec([0, 0, radians(60)]).as_matrix() @ LEVEL
HERE = Site(radians(48.5))
LAT = radians(48.5)
Y1 = np.array([0.0, 1.0, 0.0])
SIX = radians(6.0)  # rad/s
GAUSS = np.polynomial.legendre.leggauss(8)


def error(found, truth):
    """Small rotations (..., 3) about n that take truth to what was found."""
    E_ = found @ np.swapaxes(truth, -1, -2)
    return Rotation.from_matrix(E_.reshape(-1, 3, 3)).as_rotvec().reshape(E_.shape[:-1])


def turning(
    C,
    rate=SIX,
    turns=2.0,
    latitude=LAT,
    axis=Y1,
    bias=(0,) * 6,
    scale=(0,) * 6,
    lag=0.0,
    ripple=lambda beta: 0.0,
    misaligned=None,
    hz=10,
    instants=False,
    start=100.0,
    label="t",
    noise=None,
    offset=0.0,
):
    """A turning dwell: samples are the means over their intervals, by eight-point quadrature.

    `ripple`: part of the rate, as a function of encoder angle, felt but not followed by beta;
    `instants`: they are the values at their ends. `misaligned` (3, 3): what gyros see of each
    component; `lag` [s] of both triads.
    """
    n = round(abs(turns * 2 * pi / rate) * hz)
    t = np.arange(n + 1) / hz
    nodes, weights = GAUSS if not instants else (np.ones(1), np.array([2.0]))
    fine = t[1:, None] + (nodes[None] - 1) / 2 / hz - lag
    beta = offset + rate * fine
    w_n = np.array([W * cos(latitude), 0, -W * sin(latitude)])
    f_n = np.array([0, 0, -G])
    felt = []
    for v_n in (w_n, f_n):
        v = C.T @ v_n
        along = axis * (axis @ v)
        across = v - along
        # b turns by beta about the axis, so the vector turns by -beta in it
        turned = (
            along
            + np.cos(beta)[..., None] * across
            - np.sin(beta)[..., None] * np.cross(axis, across)
        )
        felt.append(turned)
    felt[0] = felt[0] + (rate * (1 + ripple(beta)) * np.ones_like(beta))[..., None] * axis
    w, f = (np.einsum("knj,n->kj", x, weights / 2) for x in felt)
    if misaligned is not None:
        w = w @ misaligned.T
    y = np.concatenate([w, f], axis=1) * (1 + np.array(scale)) + bias
    if noise is not None:
        y = y + noise[1] * noise[0].normal(size=y.shape)
    readings = ImuReadings(start + t[1:], y[:, :3], y[:, 3:], instants=instants)
    told = Rotation.from_matrix(LEVEL)
    return Dwell(label, start, start + n / hz, readings, told, Turn(axis, offset + rate * t[1:]))


def only(dwells, site=HERE, options=None):
    (found,) = carousel(dwells, site, options or Options())
    return found


# --- exactness ------------------------------------------------------------------------------------

AXES = {
    "Y1": Y1,
    "X1 down": np.array([-1.0, 0, 0]),
    "between": np.array([2.0, 3.0, -6.0]) / 7,
}


@pytest.mark.parametrize("axis", list(AXES))
@pytest.mark.parametrize("latitude", [48.5, -33.0, 0.0])
@pytest.mark.parametrize("rate", [6.0, -20.0])
def test_attitude_is_recovered_with_any_axis_and_tilt(axis, latitude, rate):
    a = AXES[axis]
    # An attitude whose axis leans 5 deg, and the instrument turned about it by 77 deg.
    lean = Rotation.from_euler("ZYX", [40, 3, -4], degrees=True)
    to_axis, _ = Rotation.align_vectors([[0, 0, -1]], [a])
    C = (lean * to_axis * Rotation.from_rotvec(radians(77) * a)).as_matrix()
    dwell = turning(C, radians(rate), 3.0, radians(latitude), a, offset=0.3)
    found = only([dwell], Site(radians(latitude), local_gravity=G))
    # rounding of 6 deg/s against Earth rate: 1e-16 x 1400
    assert np.abs(error(found.C_nb.as_matrix(), C)).max() < 1e-11
    assert (found.method, found.label, found.t_from) == ("carousel", "t", 100.0)


def test_the_mean_over_an_interval_is_no_lag():
    """At 2 Hz and 20 deg/s a sample spans 10 deg: paired with its stamp it would be 5 deg late."""
    found = only([turning(NOSE_60, radians(20), hz=2, turns=4)])
    assert np.abs(error(found.C_nb.as_matrix(), NOSE_60)).max() < 1e-11


@pytest.mark.parametrize("rate", [6.0, -20.0])
def test_instants_belong_to_the_angle_at_their_stamps(rate):
    """Taken for means, they are half a sample late: 0.3 deg of heading at 6 deg/s and 10 Hz."""
    dwell = turning(NOSE_60, radians(rate), instants=True)
    assert np.abs(error(only([dwell]).C_nb.as_matrix(), NOSE_60)).max() < 1e-11
    late = replace(dwell, readings=replace(dwell.readings, instants=False))
    assert heading_error([late]) == pytest.approx(-radians(rate) * 0.05, rel=1e-6)


def test_interval_harmonics_by_hand():
    X = interval_harmonics(np.array([0.0, pi / 2, pi]))
    # mean of cos over a quarter is 2/pi, over the next -2/pi; of sin 2/pi both times
    np.testing.assert_allclose(X, [[1, 2 / pi, 2 / pi], [1, -2 / pi, 2 / pi]], rtol=1e-15)


def test_harmonics_and_their_noise():
    angle = np.linspace(0, 4 * pi, 641)
    X = interval_harmonics(angle)
    rng = np.random.default_rng(1)
    truth = np.array([[1.0, 20], [3, -4], [0.5, 7]])
    sigma = np.array([0.1, 2.0])
    y = X @ truth + sigma * rng.normal(size=(500, 640, 2))
    h = harmonic_fit(X, y)
    for found, want in ((h.constant, truth[0]), (h.cosine, truth[1]), (h.sine, truth[2])):
        # 500 runs of 640 samples: sigma sqrt(2/640/500), five times
        assert (np.abs(np.mean(found, axis=0) - want) < 5 * 0.0025 * sigma).all()
    # variances of some 27 degrees of freedom each: 27 % over sqrt(500), four times
    variances = np.diagonal(h.scatter, axis1=1, axis2=2)
    np.testing.assert_allclose(np.mean(variances, axis=0), sigma**2, rtol=0.05)
    # and the coefficients scatter as they say
    scatter = h.sine.var(axis=0) / (h.normal[2, 2] * sigma**2)
    np.testing.assert_allclose(scatter, 1, rtol=0, atol=4 * sqrt(2 / 500))
    with pytest.raises(TooShort, match="31 samples: at least 32"):
        harmonic_fit(X[:31], y[0, :31])


@pytest.mark.parametrize("sensors", [(True, False, False), (False, False, True)])
def test_one_gyro_alone_tells_the_direction(sensors):
    """By hand: u sees u.p with the cosine and p.(a x u) with the sine; a = Y1: X1 x -> -Z1."""
    p = np.array([3.0, 0, 4.0])
    cosine, sine = p * 1.05, np.array([-4.0, 0, 3.0]) * 1.05  # -(Y1 x p) = (-4, 0, 3)
    h = harmonic_fit(interval_harmonics(np.linspace(0, 2 * pi, 101)), np.zeros((100, 3)))
    h = type(h)(np.ones(3), cosine, sine, np.eye(3), h.normal)
    found = turning_vector(h, Y1, sensors)
    np.testing.assert_allclose(found.across, 1.05 * p, rtol=1e-14)
    both = turning_vector(h, Y1)
    assert both.variance == pytest.approx(found.variance / 2, rel=1e-14)
    with pytest.raises(AlignmentError, match="no sensor looks across"):
        turning_vector(h, Y1, (False, True, False))


def test_a_nodding_axis_cancels_between_two_gyros():
    """Rates (sin, cos)(beta) of a nod once per turn look like Earth rate to one gyro alone."""
    angle = np.linspace(0, 6 * pi, 961)
    X = interval_harmonics(angle)
    v = np.array([W * cos(LAT), W * sin(LAT), 0.0])  # nose north
    true = X @ np.stack([Y1 * v[1], v * [1, 0, 0], -np.cross(Y1, v)])
    nod = 1.7 * DEG_H
    nodding = true + nod * X[:, [2, 0, 1]] * [1.0, 0.0, 1.0]  # sine in X1, cosine in Z1
    rng = np.random.default_rng(2)
    noisy = nodding + 0.1 * DEG_H * rng.normal(size=nodding.shape) * [1.0, 1.0, 1.5]
    headings = {}
    for gyros in ((True, True, True), (True, False, False), (False, False, True)):
        p = turning_vector(harmonic_fit(X, noisy), Y1, gyros).across
        headings[gyros] = np.arctan2(p[2], p[0])
    single = nod / (W * cos(LAT))  # 9.8 deg
    assert abs(headings[True, False, False]) == pytest.approx(single, rel=0.05)
    assert headings[True, False, False] * headings[False, False, True] < 0
    # noise: 0.13 deg/h over sqrt(480) of 10 deg/h, 0.03 deg
    assert abs(headings[True, True, True]) < radians(0.15)


def test_a_much_noisier_gyro_is_left_out():
    h = harmonic_fit(TURNING, np.zeros((SAMPLES, 3)))
    for ratio, counted in ((24.0, 2), (26.0, 1)):
        noisy = type(h)(h.constant, Y1 * 0 + 1, h.sine, np.diag([ratio, 1.0, 1.0]), h.normal)
        assert turning_vector(noisy, Y1).parts.max() == pytest.approx(1 / counted)


def test_a_rippling_speed_cancels_in_oblique_gyros():
    """Axis (12, 15, 16)/25, oblique to all gyros: 2 deg/h once and twice per turn, far above
    their noise, are neither in heading nor in its sigma. Without Z1 once per turn leaves
    ``-a_z c_z`` over ``|c_x|^2 + |c_y|^2 = 1 + a_z^2`` of it."""
    axis = np.array([12.0, 15.0, 16.0]) / 25
    size = 2 * DEG_H / SIX
    C, u = Rotation.align_vectors([[0.0, 0, -1]], [axis])[0].as_matrix(), axis[2]

    def found(size, gyros=3):
        noise = np.random.default_rng(5), np.repeat([0.01 * DEG_H, 1e-4], 3)
        dwell = turning(
            C, axis=axis, noise=noise, ripple=lambda beta: size * (np.cos(beta) + np.cos(2 * beta))
        )
        kept = replace(dwell.readings, w_ib_b=dwell.readings.w_ib_b * (np.arange(3) < gyros))
        return only([replace(dwell, readings=kept)])

    still, rippling = found(0.0), found(size)
    np.testing.assert_allclose((rippling.C_nb * still.C_nb.inv()).as_rotvec(), 0, atol=1e-7)
    np.testing.assert_allclose(rippling.covariance, still.covariance, rtol=1e-6)
    assert not any("not all gyros" in flag for flag in rippling.flags)

    two = found(0.0, 2)
    off = error(found(size, 2).C_nb.as_matrix(), two.C_nb.as_matrix())[2]
    c_z = C @ ([0, 0, 1] - u * axis)
    left = 2 * DEG_H * u / (1 + u**2) * c_z
    assert off == pytest.approx(np.arctan2(left[1], W * cos(LAT) - left[0]), rel=2e-3)
    assert any("not all gyros count" in flag for flag in two.flags)


# --- what it is immune to, and what not -----------------------------------------------------------


def heading_error(dwells, C=NOSE_60):
    return error(only(dwells).C_nb.as_matrix(), C)[2]


def test_bias_and_scale_leave_heading_alone():
    bias = np.array([100, -100, 70, 0, 0, 0]) * DEG_H + np.array([0, 0, 0, 5, -3, 4]) * MILLI_G
    dwell = turning(NOSE_60, bias=bias, scale=(0.05, -0.05, -0.03, 0, 0, 0))
    found = only([dwell])
    # 100 deg/h is 7 times Earth rate: rounding only
    assert np.abs(error(found.C_nb.as_matrix(), NOSE_60)).max() < 1e-11
    # tilted by 3 deg, the vertical rate is felt across the axis: 5 % of that is felt beyond it
    C = Rotation.from_rotvec([radians(2), radians(-3), 0]).as_matrix() @ NOSE_60
    found = only([turning(C, bias=bias, scale=(0.05, -0.05, 0.05, 0, 0, 0))])
    off = error(found.C_nb.as_matrix(), C)
    # accelerometer bias of 3 mg along the axis: 0.003 of a tilt of 3.6 deg
    by_bias = radians(3.6) * 0.0032 * 1.6
    assert np.abs(off[:2]).max() < by_bias
    assert off[2] == pytest.approx(0.05 * np.tan(LAT) * np.sin(radians(2)), abs=by_bias)


@pytest.mark.parametrize("latitude_deg", [84.0, -84.0])
def test_an_axis_that_leans_by_more_than_the_earths_has_one_heading(latitude_deg):
    """10 deg off the vertical, the Earth's axis 6: what is felt across points the same way at two
    headings, and how large it is tells which."""
    site = Site(radians(latitude_deg))
    for azimuth in range(0, 360, 15):
        lean = radians(10) * np.array([np.cos(radians(azimuth)), np.sin(radians(azimuth)), 0])
        C = Rotation.from_rotvec(lean).as_matrix() @ NOSE_60
        (found,) = carousel([turning(C, latitude=site.latitude)], site, Options())
        assert np.abs(error(found.C_nb.as_matrix(), C)).max() < 1e-9, azimuth


def test_amplitude_that_is_not_the_earths_is_flagged():
    assert not [f for f in only([turning(NOSE_60)]).flags if "harmonic is" in f]
    (flag,) = [
        f for f in only([turning(NOSE_60, scale=(-0.3,) * 3 + (0,) * 3)]).flags if "harmonic" in f
    ]
    assert flag == "horizontal harmonic is 0.70 of the Earth's"


def test_lag_shifts_heading_by_rate_times_lag_and_both_ways_remove_it():
    rate, tau = radians(6), 0.005
    forth = turning(NOSE_60, rate, lag=tau)
    back = turning(NOSE_60, -rate, lag=tau, start=400.0, label="u")
    # Found late: b at angle 0 was rate x tau further back about Y1 (up), heading clockwise.
    assert heading_error([forth]) == pytest.approx(rate * tau, rel=1e-9)  # 1.8'
    assert heading_error([back]) == pytest.approx(-rate * tau, rel=1e-9)
    (flag,) = only([forth]).flags
    assert flag == "one direction only: a lag of 1 ms would shift heading by 0.006 deg"
    found = only([forth, back])
    assert np.abs(error(found.C_nb.as_matrix(), NOSE_60)).max() < 1e-11
    assert found.flags == ("lag of 5 ms beyond the interval's mean removed",)
    assert (found.t_from, found.t_to, found.label) == (100.0, 520.0, "t")


def test_unequal_rates_both_ways_tell_the_lag_too():
    forth = turning(NOSE_60, radians(6), lag=0.02)
    back = turning(NOSE_60, radians(-2), lag=0.02, start=400.0)
    assert abs(heading_error([forth, back])) < 1e-11


def test_what_telling_the_lag_costs_by_hand():
    """+6 and -2 deg/s, phases alike in noise: mean rate 2, squares about it 16 + 16 of weight w.

    So the phase without lag is (2 phi_1 + 6 phi_2)/8, its variance 40/64 of one, where the mean of
    both has 1/2: the lag adds 1/8 of one.
    """
    axis, sigma = np.array([0.0, 1.0, 0.0]), 1e-8
    across = np.array([3e-5, 0.0, 0.0])
    shifts = (6e-3, -2e-3)  # a lag of 1 ms per rad/s
    vectors = [
        TurningVector(
            Rotation.from_rotvec(shift * axis).apply(across),
            np.asarray(sigma**2),
            np.zeros(3),
            np.ones(3),
        )
        for shift in shifts
    ]
    lag, added = lag_of(vectors, [6.0, -2.0], axis)
    one = (sigma / 3e-5) ** 2
    assert lag == pytest.approx(1e-3, rel=1e-6)
    assert added == pytest.approx(one / 8, rel=1e-6)
    together = combined(vectors, [6.0, -2.0], axis, lag)
    np.testing.assert_allclose(together.across, across, rtol=0, atol=1e-12)
    assert together.variance / 3e-5**2 + added == pytest.approx(one * 40 / 64, rel=1e-6)


def test_noise_of_stretches_is_pooled_by_their_samples():
    """One and three: variances of 1 and 5 are 4 together."""

    def told(samples, variance):
        normal = np.diag([1.0, 2.0, 2.0]) / samples
        return Harmonics(np.zeros(3), np.zeros(3), np.zeros(3), np.eye(3) * variance, normal)

    pooled = _alike([told(100, 1.0), told(300, 5.0)])
    for harmonics in pooled:
        np.testing.assert_allclose(harmonics.scatter, 4.0 * np.eye(3), rtol=1e-12)


def test_a_drift_both_ways_cancels_whichever_gyros_count():
    """1.5 deg/h per minute on X1 is a sine of 0.48 deg/h, half of which counts beside Z1. A nose
    at 60 deg has half of that across Earth rate: 0.7 deg one way, minus that back, none in their
    mean.

    Third harmonics of 2 deg/h are no Earth rate in whole turns; X1's of 20 deg/h back makes it too
    noisy to count there. It then counts no way, or both: else 0.35 deg would be left.
    """

    def drifting(rate, start, third):
        dwell = turning(NOSE_60, rate, start=start, label=f"{rate}")
        w = dwell.readings.w_ib_b.copy()
        w[:, 0] += 1.5 * DEG_H / 60 * (dwell.readings.t - start - 60)
        w[:, [0, 2]] += np.cos(3 * dwell.turn.angle)[:, None] * third
        return replace(dwell, readings=ImuReadings(dwell.readings.t, w, dwell.readings.f_b))

    forth = drifting(SIX, 100.0, np.array([2, 2]) * DEG_H)
    alike = drifting(-SIX, 400.0, np.array([2, 2]) * DEG_H)
    noisy = drifting(-SIX, 400.0, np.array([20, 2]) * DEG_H)
    assert degrees(abs(heading_error([forth]))) == pytest.approx(0.7, rel=0.05)
    for back in (alike, noisy):
        # squares of a phase of 1 deg
        assert abs(heading_error([forth, back])) < radians(1) ** 2


def test_known_filter_delay_in_the_encoder_is_all_it_takes():
    """Angles recorded late by the same time as the readings cancel the lag."""
    dwell = turning(NOSE_60, radians(6), lag=0.02)
    turn = Turn(Y1, dwell.turn.angle - radians(6) * 0.02)
    late = Dwell("l", dwell.t_from, dwell.t_to, dwell.readings, dwell.nominal, turn)
    assert abs(heading_error([late])) < 1e-11


def test_ripple_once_per_turn_times_misalignment_mimics_earth_rate():
    """X1 sees 1 mrad of the axial rate 6 (1 + 1e-3 cos(beta)) deg/s: 6e-6 deg/s = 0.0216 deg/h."""
    part, mrad, rate = 1e-3, 1e-3, radians(6)
    seen = np.eye(3)
    seen[0, 1] = mrad
    # Nose east: X1 should read -W cos lat sin(beta); cos(beta) is all error. Both gyros count
    # evenly, so half of it, over the horizontal rate.
    C = Rotation.from_rotvec([0, 0, pi / 2]).as_matrix() @ LEVEL
    dwell = turning(C, rate, ripple=lambda beta: part * np.cos(beta), misaligned=seen)
    want = part * mrad * rate / (W * cos(LAT))  # rad: 7.4' with one gyro
    assert abs(heading_error([dwell], C)) == pytest.approx(want / 2, rel=1e-3)
    # without misalignment it does nothing
    assert abs(heading_error([turning(C, rate, ripple=lambda b: part * np.cos(b))], C)) < 1e-11


def test_ripple_that_the_encoder_sees_is_flagged():
    dwell = turning(NOSE_60)
    beta = dwell.turn.angle
    told = Turn(Y1, beta + 1e-2 * np.sin(beta))
    rippled = Dwell("r", dwell.t_from, dwell.t_to, dwell.readings, dwell.nominal, told)
    flags = only([rippled]).flags
    assert any("rate ripple of 216 deg/h once per turn" in flag for flag in flags)


@pytest.mark.parametrize("latitude", [48.5, -60.0])
def test_axis_tilt_toward_north_enters_by_tan_lat_unless_levelled(latitude):
    lat = radians(latitude)
    tilt = 3 * MINUTE
    # the instrument leans east: its up axis turned about north
    C = Rotation.from_rotvec([tilt, 0, 0]).as_matrix() @ LEVEL
    found = only([turning(C, latitude=lat)], Site(lat))
    assert np.abs(error(found.C_nb.as_matrix(), C)).max() < 1e-11
    # Without the accelerometers' harmonic the axis counts as vertical: eta_N = -tilt brings
    # tan(lat) of it into heading.
    readings, angle = whole_turns(turning(C, latitude=lat))
    gyros = turning_vector(harmonic_fit(interval_harmonics(angle), readings.w_ib_b), Y1)
    blind = TurningVector(np.zeros(3), np.asarray(1e-12), np.array([0, G, 0]), np.full(3, 0.5))
    fit = carousel_attitude(gyros, blind, Y1, lat, Priors())
    assert error(fit.C_nb, C)[2] == pytest.approx(tilt * tan(lat), rel=2e-3)


# --- checks ---------------------------------------------------------------------------------------


def test_whole_turns_are_used():
    readings, angle = whole_turns(turning(NOSE_60, turns=2.7))
    assert len(readings) == 1200
    assert degrees(angle[-1] - angle[0]) == pytest.approx(720, abs=1e-9)
    flags = only([turning(NOSE_60, turns=2.7)]).flags
    assert any("26 % of the stretch is beyond whole turns" in flag for flag in flags)
    assert len(whole_turns(turning(NOSE_60, turns=0.99))[0]) == 594  # 98 % count as whole


def test_refusals():
    with pytest.raises(TooShort, match="t: too little turn: 324 deg"):
        carousel([turning(NOSE_60, turns=0.9)], HERE, Options())
    dwell = turning(NOSE_60)
    r = dwell.readings

    def as_dwell(readings, turn, told=None):
        return Dwell("d", dwell.t_from, dwell.t_to, readings, told, turn)

    with pytest.raises(AlignmentError, match="d: no encoder angles"):
        carousel([as_dwell(r, None)], HERE, Options())
    with pytest.raises(AlignmentError, match="d: 5 encoder angles for 1200 samples"):
        carousel([as_dwell(r, Turn(Y1, np.arange(5.0)))], HERE, Options())
    back = np.concatenate([dwell.turn.angle[:600], dwell.turn.angle[600:0:-1]])
    with pytest.raises(AlignmentError, match="does not turn one way"):
        carousel([as_dwell(r, Turn(Y1, back))], HERE, Options())
    knocked = r.f_b.copy()
    knocked[500:520] += [0.2, 0, 0]
    with pytest.raises(NotAtRest, match=r"d: not a steady turn near 15[01]\.\d s: force"):
        carousel([as_dwell(ImuReadings(r.t, r.w_ib_b, knocked), dwell.turn)], HERE, Options())
    shaken = r.w_ib_b.copy()
    shaken[700:720] += [0, 0, radians(0.2)]
    with pytest.raises(NotAtRest, match=r"near 17[01]\.\d s: rate"):
        carousel([as_dwell(ImuReadings(r.t, shaken, r.f_b), dwell.turn)], HERE, Options())
    steep = Rotation.from_rotvec([radians(31), 0, 0]).as_matrix() @ LEVEL
    with pytest.raises(AlignmentError, match="t: axis of turning is 31 deg off the vertical"):
        carousel([turning(steep)], HERE, Options())
    with pytest.raises(PoleError):
        carousel([dwell], Site(pi / 2), Options())
    with pytest.raises(AlignmentError, match="latitude: not known"):
        carousel([dwell], Site(None), Options())


def test_encoder_noise_may_step_back():
    dwell = turning(NOSE_60, radians(1), turns=1, hz=50)
    noisy = dwell.turn.angle + np.where(np.arange(18000) % 2, 1e-3, -1e-3)
    rough = Dwell("r", dwell.t_from, dwell.t_to, dwell.readings, dwell.nominal, Turn(Y1, noisy))
    # half of the intervals are 1e-3 too long, half too short: what is left is second order
    assert abs(heading_error([rough])) < 1e-5


def test_groups_are_kept_apart():
    other = turning(LEVEL, label="o", start=900.0)
    elsewhere = Dwell(
        "o", other.t_from, other.t_to, other.readings, Rotation.from_matrix(NOSE_60), other.turn
    )
    found = carousel([turning(NOSE_60), elsewhere], HERE, Options())
    assert [e.label for e in found] == ["t", "o"]
    for estimate, C in zip(found, (NOSE_60, LEVEL), strict=True):
        assert np.abs(error(estimate.C_nb.as_matrix(), C)).max() < 1e-11


# --- chi-square -----------------------------------------------------------------------------------

RUNS = 500
SAMPLES, TURNS, SECONDS = 480, 3, 600.0
ANGLES = np.linspace(0, 2 * pi * TURNS, SAMPLES + 1)
TURNING = interval_harmonics(ANGLES)
REGIMES = {  # priors, gyro [deg/rt-h], accelerometer [ug/rt-Hz], lean of the axis [deg]
    "noise": (Priors(10 * DEG_H, MILLI_G), 0.05, 50, 0.0),
    # 1 mg along an axis that leans by 4 deg: 14'' of tilt beside 1.6'' of noise, first order still
    "bias": (Priors(100 * DEG_H, MILLI_G, 0.05, 1e-3), 3e-4, 200, 4.0),
    "placement": (Priors(DEG_H, MILLI_G, 1e-3, 1e-4, turn=5 * MINUTE), 1e-3, 10, 1.0),
    "accelerometers": (Priors(DEG_H, MILLI_G), 1e-3, 2000, 2.0),
}
LATITUDES = (48.5, -33.0, 75.0, -75.0)
CASES = [(r, lat, one) for r in REGIMES for lat in LATITUDES for one in (False, True)]
K = norm.ppf(1 - 0.025 / len(CASES))
# Variances from 32 blocks less 3: some 29 degrees of freedom, F(1, 29) at the worst.
FREEDOM = 29


def simulated(priors, arw, vrw, lean, latitude, rng, runs):
    """Gyro and accelerometer samples (runs, m, 3) each, and true attitudes at angle 0."""
    C = Rotation.from_rotvec(radians(lean) * np.array([0.6, -0.8, 0])).as_matrix() @ NOSE_60
    placed = Rotation.from_rotvec(priors.turn * rng.normal(size=(runs, 3))).as_matrix()
    y = []
    density = SAMPLES / SECONDS
    for v_n, walk, bias, scale in (
        (
            np.array([W * cos(latitude), 0, -W * sin(latitude)]),
            arw * DEG_RT_H * np.array([0.5, 1, 1.5]),
            priors.gyro_bias,
            priors.gyro_scale,
        ),
        (
            np.array([0, 0, -G]),
            vrw * 9.80665e-6 * np.array([1.5, 1, 0.5]),
            priors.accel_bias,
            priors.accel_scale,
        ),
    ):
        v = C.T @ v_n
        across = v - Y1 * v[1]
        true = TURNING @ np.stack([Y1 * v[1], across, -np.cross(Y1, across)])
        K_ = scale * rng.normal(size=(runs, 1, 3))
        b = bias * rng.normal(size=(runs, 1, 3))
        noise = walk * sqrt(density) * rng.normal(size=(runs, SAMPLES, 3))
        y.append((1 + K_) * true + b + noise)
    # the table's mean attitude is C; at encoder angle 0 the instrument was placed a little off
    return *y, C @ placed


def fitted(w, f, latitude, priors, one):
    gyros = turning_vector(harmonic_fit(TURNING, w), Y1, (True, True, not one))
    accels = turning_vector(harmonic_fit(TURNING, f), Y1)
    return carousel_attitude(gyros, accels, Y1, latitude, priors)


@pytest.mark.parametrize(("regime", "latitude", "one"), CASES)
def test_covariance(regime, latitude, one):
    priors, arw, vrw, lean = REGIMES[regime]
    rng = np.random.default_rng([71, CASES.index((regime, latitude, one))])
    lat = radians(latitude)
    w, f, C = simulated(priors, arw, vrw, lean, lat, rng, RUNS)
    fit = fitted(w, f, lat, priors, one)
    eta, P = error(fit.C_nb, C), fit.covariance
    assert np.degrees(np.sqrt(P[:, 2, 2].mean())) < 8
    nees = np.mean(np.einsum("ni,ni->n", eta, np.linalg.solve(P, eta[..., None])[..., 0]))
    spread = K * sqrt(2 * 3 / RUNS) * FREEDOM / (FREEDOM - 4)
    assert 3 - spread < nees < 3 * FREEDOM / (FREEDOM - 2) + spread


def test_places_of_accelerometers_pull_along_an_axis_between_theirs_by_hand():
    """At 20 deg/s 7 mm are pulled by ``w^2 r = 8.53e-4 m/s^2``; along the axis (2, 3, -6)/7 each by
    ``a_i^2 (1 - a_i^2)`` of the square, 0.6479 of it in all. Leaning by 20 deg the axis takes a
    pull e along it for a tilt of ``e sin 20 deg/g``: 4.0 arc seconds; along a triad's axis none."""
    axis, tilts = np.array([2.0, 3.0, -6.0]) / 7, []
    for a, told in ((axis, 7e-3), (axis, 0.0), (Y1, 7e-3), (Y1, 0.0)):
        to_up = Rotation.align_vectors([[0, 0, -1]], [a])[0]
        C = (Rotation.from_rotvec([0, radians(20), 0]) * to_up).as_matrix()
        dwell = turning(C, radians(20.0), 5.0, axis=a)
        found = only([dwell], options=Options(priors=Priors(places=told, accel_bias=1e-9)))
        tilts.append(found.covariance[:2, :2].trace())
    pulled, none = tilts[0] - tilts[1], tilts[2] - tilts[3]
    expected = 0.6479 * radians(20.0) ** 2 * 7e-3 * sin(radians(20)) / G
    assert np.sqrt(pulled) == pytest.approx(expected, rel=0.01)
    assert none == pytest.approx(0.0, abs=1e-6 * pulled)


@pytest.mark.parametrize("lean", [0.0, 8.0, -20.0])
def test_constants_of_what_goes_round_about_a_leaning_axis_by_hand(lean):
    """At the equator, the axis leaning east by L: gravity's g sin L goes round with the Earth's.

    Accelerometers turned by m about the axis turn that: tilt about east m sin L. Of four
    g-sensitivities across the axis each reads G g sin L, two sensors share, and half of all lies
    across north: heading ``G g sin L / (sqrt(2) W cos L)``. Gyros turned by m turn the heading.
    """
    a = radians(lean)
    # the instrument turned about north by -L: its up axis leans east
    C = Rotation.from_rotvec([-a, 0, 0]).as_matrix() @ LEVEL
    w_b, f_b = C.T @ (W * N), C.T @ (-G * D)

    def covariance(**told):
        y = [TURNING @ np.stack([v * Y1, v - v * Y1, -np.cross(Y1, v)]) for v in (w_b, f_b)]
        both = [fitted(*y, 0.0, priors, False) for priors in (Priors(**told), Priors())]
        return both[0].covariance - both[1].covariance

    m, pull = 1e-3, 1e-9
    turned = covariance(accel_misalignment=m)
    assert np.sqrt(max(turned[0, 0], 0)) == pytest.approx(0, abs=1e-12)
    assert np.sqrt(max(turned[1, 1], 0)) == pytest.approx(m * abs(sin(a)), rel=1e-6, abs=1e-12)
    pulled = covariance(gyro_g_sensitivity=pull)
    heading = pull * G * abs(sin(a)) / (sqrt(2) * W * cos(a))
    assert np.sqrt(max(pulled[2, 2], 0)) == pytest.approx(heading, rel=1e-6, abs=1e-12)
    astray = covariance(gyro_misalignment=m)
    assert np.sqrt(astray[2, 2]) == pytest.approx(m / cos(a), rel=1e-6)


@pytest.mark.parametrize("one", [False, True])
@pytest.mark.parametrize("latitude", [48.5, -33.0])
def test_white_noise_floor(latitude, one):
    """RMS over ``ARW/(W cos lat sqrt T)``, sqrt(2) times that with one gyro: 95 % in 1 to 1.1."""
    runs, lat = 2000, radians(latitude)
    floor = radians(4.0)
    arw = floor * W * cos(lat) * sqrt(SECONDS) / DEG_RT_H / (sqrt(2) if one else 1)
    rng = np.random.default_rng(72)
    squares = 0.0
    v = LEVEL.T @ np.array([W * cos(lat), 0, -W * sin(lat)])
    true = TURNING @ np.stack([v * Y1, v - v * Y1, -np.cross(Y1, v)])
    f = np.tile(np.array([0, G, 0]), (SAMPLES, 1))
    for _ in range(4):
        sigma = arw * DEG_RT_H * sqrt(SAMPLES / SECONDS)
        w = true + sigma * rng.normal(size=(runs // 4, SAMPLES, 3))
        fit = fitted(w, np.broadcast_to(f, w.shape), lat, Priors(), one)
        squares += float(np.sum(error(fit.C_nb, LEVEL)[:, 2] ** 2))
    ratio = sqrt(squares / runs) / floor
    low, high = sqrt(runs) / np.sqrt(chi2.ppf([0.975, 0.025], runs))
    assert ratio * high > 1.00
    assert ratio * low < 1.10


def test_sigma_of_the_estimator_with_both_directions():
    """End to end, both ways: the floor of the whole time, rates balanced by their times."""
    walk = 0.003 * DEG_RT_H
    sigmas = np.array([walk] * 3 + [1e-4] * 3) * sqrt(10)
    floor = (walk / (W * cos(LAT))) ** 2 / 240.0
    for second, factor in ((-6.0, 1.0), (-3.0, 240 / 360)):
        found = []
        for seed in range(30):
            rng = np.random.default_rng([73, seed])
            forth = turning(NOSE_60, radians(6), noise=(rng, sigmas))
            back = turning(NOSE_60, radians(second), 2.0, noise=(rng, sigmas), start=500.0)
            found.append(only([forth, back]).covariance[2, 2])
        # accelerometers add tan(lat)^2 (1e-4/9.81)^2/240
        tilt = tan(LAT) ** 2 * (1e-4 / G) ** 2 / 240.0
        # weights 1:2, rates 2:-1: mean rate 0, so the lag costs nothing and T is 360 s
        want = (floor + tilt) * factor
        # 30 variances of some 58 degrees of freedom scatter by 3.4 %: four times
        assert np.mean(found) == pytest.approx(want, rel=0.14)


def test_lag_in_the_chi_square():
    """Unequal rates over equal times: the mean rate is not zero and the lag costs something."""
    walk = 0.003 * DEG_RT_H
    sigmas = np.array([walk] * 3 + [1e-4] * 3) * sqrt(10)
    rng = np.random.default_rng(74)
    z = []
    runs = 60
    for _ in range(runs):
        forth = turning(NOSE_60, radians(12), 4.0, noise=(rng, sigmas), lag=0.01)
        back = turning(NOSE_60, radians(-6), 2.0, noise=(rng, sigmas), start=500.0, lag=0.01)
        found = only([forth, back])
        z.append(error(found.C_nb.as_matrix(), NOSE_60)[2] / sqrt(found.covariance[2, 2]))
    low, high = chi2.ppf([0.005, 0.995], runs)
    assert low < np.sum(np.square(z)) < high * 58 / 56


def test_sequence_and_deflection():
    tilted = Site(LAT, deflection=(1e-4, -2e-4))
    found = only([turning(NOSE_60)], tilted, Options())
    # Noiseless data of an undeflected site: the answer moves by the plumb line's turn alone, and
    # heading by the latitude's (second order).
    plain = only([turning(NOSE_60)])
    moved = error(found.C_nb.as_matrix(), (tilted.plumb * plain.C_nb).as_matrix())
    assert np.abs(moved).max() < 1e-6
    assert found.sequence == plain.sequence
    assert sin(LAT) > 0
