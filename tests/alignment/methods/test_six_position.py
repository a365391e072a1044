"""The six-position test against truths written by hand.

Readings are ``C^T w_n`` and ``C^T f_n`` with matrices written here, plus planted biases, steps
and seeded noise. Gravity is a given number, so nothing here asks the Earth model.
"""

from dataclasses import replace
from math import atan, cos, degrees, pi, radians, sin, tan

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import chi2, norm

from alignment import Dwell, ImuReadings, Options, Priors, Site
from alignment.angles import Sequence, SequenceRule
from alignment.doubts import heading_doubt
from alignment.errors import AlignmentError, NotAtRest, PoleError, TooShort
from alignment.methods import triad as gyrocompass
from alignment.methods.integration import rk4
from alignment.methods.six_position import six_position, six_position_tracks
from alignment.nominal import SIX_POSITIONS, nominal_attitude, nominal_readings, zero_offset

W = 7.292115e-5  # rad/s
G = 9.81  # m/s^2, as if measured on site
DEG_H = pi / 180 / 3600
MILLI_G = 9.80665e-3
N, E, D = np.eye(3)
# X1, Y1 and Z1 in NED, as columns: from the picture of each position
SIX = {
    "X1 up": np.column_stack([-D, -N, E]),
    "X1 down": np.column_stack([D, N, E]),
    "Y1 up": np.column_stack([N, -D, E]),
    "Y1 down": np.column_stack([N, D, -E]),
    "Z1 up": np.column_stack([N, -E, -D]),
    "Z1 down": np.column_stack([N, E, D]),
}
LEVEL = SIX["Y1 up"]


def turn_n(axis, angle):
    """Matrix of a turn about an axis of n, by Rodrigues' formula."""
    x, y, z = axis
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + sin(angle) * K + (1 - cos(angle)) * K @ K


TILTED = turn_n(D, radians(-60)) @ turn_n(E, radians(20)) @ turn_n(N, radians(-35)) @ LEVEL


def vectors_n(latitude):
    lat = radians(latitude)
    return np.array([W * cos(lat), 0, -W * sin(lat)]), np.array([0, 0, -G])


def site(latitude):
    return Site(radians(latitude), local_gravity=G)


def rest(C, latitude, seconds, rate=10.0, noise=None, bias=(0,) * 6, label="p", nominal=True):
    """A dwell at rest from 100 s on; `noise` (generator, gyro sigma, force sigma) per sample."""
    n = round(seconds * rate)
    t = 100.0 + np.arange(1, n + 1) / rate
    w_n, f_n = vectors_n(latitude)
    w = np.tile(C.T @ w_n + bias[:3], (n, 1))
    f = np.tile(C.T @ f_n + bias[3:], (n, 1))
    if noise is not None:
        rng, gyro, force = noise
        w = w + gyro * rng.normal(size=(n, 3))
        f = f + force * rng.normal(size=(n, 3))
    told = Rotation.from_matrix(C) if nominal is True else nominal
    return Dwell(label, 100.0, 100.0 + seconds, ImuReadings(t, w, f), told)


def stepped(dwell, after, dw_b, df_b):
    """The same dwell with a bias step `after` seconds from its start."""
    r = dwell.readings
    late = (r.t > dwell.t_from + after + 1e-6)[:, None]
    readings = ImuReadings(r.t, r.w_ib_b + late * dw_b, r.f_b + late * df_b)
    return Dwell(dwell.label, dwell.t_from, dwell.t_to, readings, dwell.nominal)


def error(estimate, C):
    """Small rotation about n that takes truth to estimate [rad]."""
    return Rotation.from_matrix(estimate.as_matrix() @ C.T).as_rotvec()


def triad(w_n, f_n):
    """Attitude error matrix of an instrument that reads these vectors, by hand."""
    up = f_n / np.linalg.norm(f_n)
    east = np.cross(w_n, up)
    east = east / np.linalg.norm(east)
    return np.array([np.cross(up, east), east, -up])


# --- the pieces -----------------------------------------------------------------------------------


def test_nominal_readings_by_hand():
    # Latitude 30, "Z1 up": X1 north, Y1 west, Z1 up.
    got = nominal_readings(Rotation.from_matrix(SIX["Z1 up"]), site(30))
    want = [W * cos(pi / 6), 0, W * 0.5, 0, 0, G]
    np.testing.assert_allclose(got, want, rtol=0, atol=1e-14)  # rounding of G times sines
    got = nominal_readings(Rotation.from_matrix(SIX["X1 down"]), site(-30))
    want = [W * 0.5, W * cos(pi / 6), 0, -G, 0, 0]
    np.testing.assert_allclose(got, want, rtol=0, atol=1e-14)


@pytest.mark.parametrize("position", list(SIX))
def test_published_angles_are_the_positions_of_the_picture(position):
    dwell = rest(SIX[position], 48.5, 20, nominal=None)
    np.testing.assert_allclose(
        nominal_attitude(dwell).as_matrix(), SIX[position], rtol=0, atol=1e-15
    )
    assert list(SIX_POSITIONS) == list(SIX)


def test_zero_offset_recovers_planted_biases_with_their_signs():
    bias = np.array([1e-5, -2e-5, 3e-5, 0.01, -0.02, 0.03])
    dwell = rest(TILTED, -33, 20, bias=bias)
    found = zero_offset(dwell, Rotation.from_matrix(TILTED), site(-33), 10.0, Priors())
    np.testing.assert_allclose(found.values[:3], bias[:3], rtol=0, atol=1e-18)
    np.testing.assert_allclose(found.values[3:], bias[3:], rtol=0, atol=1e-13)  # sums of 100 G
    np.testing.assert_allclose(found.variances, 0, rtol=0, atol=1e-25)  # squares of rounding


def test_zero_offset_uses_the_window_alone():
    dwell = stepped(rest(LEVEL, 45, 20), 10.0, [1e-5, 0, 0], [0, 0, 1.0])
    values = zero_offset(dwell, Rotation.from_matrix(LEVEL), site(45), 10.0, Priors()).values
    np.testing.assert_allclose(values, 0, rtol=0, atol=1e-13)
    values = zero_offset(dwell, Rotation.from_matrix(LEVEL), site(45), 20.0, Priors()).values
    np.testing.assert_allclose(values[[0, 5]], [5e-6, 0.5], rtol=1e-9)


# --- same window ------------------------------------------------------------------------------


@pytest.mark.parametrize("latitude", [0.0, 48.5, -33.0, 80.0])
@pytest.mark.parametrize("rule", list(SequenceRule))
def test_same_window_is_zero_by_construction(latitude, rule):
    rng = np.random.default_rng(11)
    bias = np.array([0.003, -0.02, 0.01, 0.5, -0.4, 0.3])  # 1 deg/s and 50 mg
    dwells = [
        rest(C, latitude, 20, 100.0, (rng, 1e-3, 0.05), bias, name) for name, C in SIX.items()
    ]
    dwells.append(rest(TILTED, latitude, 20, 100.0, (rng, 1e-3, 0.05), -bias, "tilted"))
    found = six_position(dwells, site(latitude), Options(rule=rule))
    same = [e for e in found if e.window == "same"]
    for estimate, dwell in zip(same, dwells, strict=True):
        C = dwell.nominal.as_matrix()
        # What methods.md demands; rounding is 1e-18 rad/s over W cos 80 deg = 1e-13 rad.
        assert degrees(np.linalg.norm(error(estimate.C_nb, C))) < 1e-9
        assert estimate.label == dwell.label
        assert estimate.covariance is None
        assert (estimate.t_from, estimate.t_to) == (100.0, 110.0)
        assert any("zero by construction" in flag for flag in estimate.flags)


def test_each_dwell_gives_same_then_fresh():
    dwells = [rest(SIX["X1 up"], 48.5, 20, label="a"), rest(TILTED, 48.5, 30, label="b")]
    found = six_position(dwells, site(48.5), Options())
    assert [(e.label, e.window) for e in found] == [
        ("a", "same"),
        ("a", "fresh"),
        ("b", "same"),
        ("b", "fresh"),
    ]
    assert {e.method for e in found} == {"six-position"}
    assert [(e.t_from, e.t_to) for e in found[1::2]] == [(110.0, 120.0), (110.0, 130.0)]
    assert [e.sequence for e in found[::2]] == [Sequence.YAW_ROLL_PITCH, Sequence.YAW_PITCH_ROLL]
    assert all(e.C_nb.single for e in found)


def test_published_rule_meets_its_singularity():
    dwells = [rest(SIX[p], 48.5, 20) for p in ("X1 up", "Y1 down", "Z1 up")]
    found = six_position(dwells, site(48.5), Options(rule=SequenceRule.PUBLISHED))
    assert [e.singular for e in found[::2]] == [True, False, True]
    found = six_position(dwells, site(48.5), Options(rule=SequenceRule.REGULAR))
    assert not any(e.singular for e in found)


# --- fresh window: signs and closed forms --------------------------------------------------------


def fresh(dwell, latitude, options=None):
    return six_position([dwell], site(latitude), options or Options())[1]


@pytest.mark.parametrize(
    ("dw_b", "df_b", "angle", "want"),
    [
        # Nose north, level: X1 sees north, Y1 up, Z1 east. Rates in deg/h, forces in mg.
        ((0, 0, 1), (0, 0, 0), "yaw", atan(1 / 9.966513)),  # sees north to the right: nose west
        ((0, 5, 0), (0, 0, 0), "yaw", 0.0),
        ((3, 0, 0), (0, 0, 0), "yaw", 0.0),
        ((0, 0, 0), (1, 0, 0), "pitch", atan(1 * MILLI_G / G)),  # nose up
        ((0, 0, 0), (0, 0, 1), "roll", -atan(1 * MILLI_G / G)),  # Z1 up is against Y1 toward Z1
        ((0, 0, 0), (0, 5, 0), "roll", 0.0),
        ((0, 0, 0), (0, 0, 2), "yaw", -radians(7.77 / 60)),  # heading +7.8', tan(lat) b_E/g
    ],
)
def test_signs_of_a_bias_step_between_the_windows(dw_b, df_b, angle, want):
    dwell = stepped(rest(LEVEL, 48.5, 20), 10.0, DEG_H * np.array(dw_b), MILLI_G * np.array(df_b))
    estimate = fresh(dwell, 48.5)
    roll, yaw, pitch = estimate.angles
    # Exact closed forms but for the last: 7.77' to its digits and b/g = 0.2 % of it.
    bound = radians(0.02 / 60) if df_b == (0, 0, 2) else 1e-8
    assert {"roll": roll, "yaw": yaw, "pitch": pitch}[angle] == pytest.approx(want, abs=bound)
    assert np.sin(estimate.heading) == pytest.approx(np.sin(-yaw), abs=1e-14)


@pytest.mark.parametrize("latitude", [0.0, 48.5, -33.0])
@pytest.mark.parametrize("C", [*SIX.values(), TILTED], ids=[*SIX, "tilted"])
def test_fresh_window_error_is_that_of_the_step(latitude, C):
    bias = np.array([0.003, -0.02, 0.01, 0.5, -0.4, 0.3])
    dw_n, df_n = DEG_H * np.array([0.7, -1.1, 0.4]), MILLI_G * np.array([3.0, 2.0, -5.0])
    dwell = stepped(rest(C, latitude, 30, bias=bias), 10.0, C.T @ dw_n, C.T @ df_n)
    w_n, f_n = vectors_n(latitude)
    # Any bias before the step is gone; what is left reads w_n + dw_n and f_n + df_n.
    want = Rotation.from_matrix(triad(w_n + dw_n, f_n + df_n)).as_rotvec()
    found = error(fresh(dwell, latitude).C_nb, C)
    # A bias of 0.02 rad/s in a mean of 200 rounds at 1e-17 of W cos lat: a few 1e-13.
    np.testing.assert_allclose(found, want, rtol=0, atol=1e-11)
    # And the first order of methods.md, section 2; dw/(W cos lat) is 0.11 at most.
    tilt_n, tilt_e = -df_n[1] / G, df_n[0] / G
    first = [tilt_n, tilt_e, -dw_n[1] / w_n[0] - tan(radians(latitude)) * tilt_n]
    np.testing.assert_allclose(found, first, rtol=0, atol=0.11**2)


def test_the_tables_own_errors_enter_one_to_one():
    # Told LEVEL, standing 1 mrad further clockwise and 2 mrad nose-up: the method cannot know.
    truth = turn_n(D, 1e-3) @ turn_n(E, 2e-3) @ LEVEL
    dwell = rest(truth, 48.5, 30, nominal=Rotation.from_matrix(LEVEL))
    for estimate in six_position([dwell], site(48.5), Options()):
        np.testing.assert_allclose(error(estimate.C_nb, LEVEL), 0, rtol=0, atol=1e-12)
        missed = error(estimate.C_nb, truth)
        # First order; the two turns commute but for 2e-6.
        np.testing.assert_allclose(missed, [0, -2e-3, -1e-3], rtol=0, atol=2e-6)


# --- nobody said the nominal attitude ---------------------------------------------------------


@pytest.mark.parametrize("position", list(SIX))
def test_the_nearest_position_is_assumed_and_flagged(position):
    # Leant by 4 deg and turned by 70: still that position, at heading zero.
    truth = turn_n(D, radians(70)) @ turn_n(E, radians(4)) @ SIX[position]
    dwell = rest(truth, 48.5, 20, nominal=None)
    for estimate in six_position([dwell], site(48.5), Options()):
        np.testing.assert_allclose(error(estimate.C_nb, SIX[position]), 0, rtol=0, atol=1e-12)
        assert "nominal attitude assumed: nearest position, heading 0" in estimate.flags
    told = rest(truth, 48.5, 20)
    for estimate in six_position([told], site(48.5), Options()):
        assert not any("assumed" in flag for flag in estimate.flags)


def test_an_attitude_between_the_positions_is_refused():
    near = rest(turn_n(E, radians(4.9)) @ LEVEL, 48.5, 20, nominal=None)
    np.testing.assert_allclose(nominal_attitude(near).as_matrix(), LEVEL, rtol=0, atol=1e-15)
    far = rest(turn_n(E, radians(5.1)) @ LEVEL, 48.5, 20, label="no. 7", nominal=None)
    with pytest.raises(AlignmentError) as caught:
        six_position([far], site(48.5), Options())
    # 5.1 deg nose up: sin and cos
    assert str(caught.value).startswith(
        "no. 7: no instrument axis is within 5 deg of the vertical (up in b = +0.089 +0.996 "
    )
    assert str(caught.value).endswith("): not one of the six positions")


def test_another_position_than_told_is_refused():
    # X1 up while the table said Y1 up: the offset would swallow a whole g, and show no error.
    dwell = rest(SIX["X1 up"], 48.5, 20, label="told Y1", nominal=Rotation.from_matrix(LEVEL))
    with pytest.raises(AlignmentError, match=r"told Y1: .* 90\.0 deg from .* \(allowed 5\)"):
        six_position([dwell], site(48.5), Options())
    near = rest(turn_n(E, radians(4.9)) @ LEVEL, 48.5, 20, nominal=Rotation.from_matrix(LEVEL))
    assert len(six_position([near], site(48.5), Options())) == 2


# --- refusals -----------------------------------------------------------------------------------


def test_a_dwell_shorter_than_the_offset_window_is_refused():
    dwell = rest(LEVEL, 48.5, 9.9, label="Y1 up")
    with pytest.raises(TooShort) as caught:
        six_position([dwell], site(48.5), Options())
    assert str(caught.value) == "Y1 up: 9.9 s of rest, the zero offsets need 10 s"
    assert len(six_position([dwell], site(48.5), Options(offset_window=5.0))) == 2


def test_no_fresh_window_without_two_samples():
    for seconds, count in ((10.0, 1), (10.1, 1), (10.2, 2), (11.1, 2)):  # at 10 Hz
        assert len(six_position([rest(LEVEL, 48.5, seconds)], site(48.5), Options())) == count


def test_poles_and_unknown_latitude_are_refused():
    dwell = rest(LEVEL, 48.5, 20)
    with pytest.raises(PoleError, match=r"latitude 90\.0000 deg: heading is undefined"):
        six_position([dwell], site(90), Options())
    with pytest.raises(AlignmentError, match="latitude: not known"):
        six_position([dwell], Site(None, local_gravity=G), Options())


def test_movement_is_refused():
    dwell = stepped(rest(LEVEL, 48.5, 20), 15.0, [0, 0, 0], [0.4, 0, 0])  # 2.3 deg of tilt
    with pytest.raises(NotAtRest, match=r"^p: not at rest near 11\d\.\d s"):
        six_position([dwell], site(48.5), Options())


def test_rates_off_by_as_much_as_the_earths_along_north_turn_heading_round():
    """Along north one Earth rate of error (1 sigma), across it none: the wrong way round in 15.87 %
    of cases by the normal law, which is 180 deg times its root, 71.70 deg. Taken in steps of an
    eighth of a sigma, up to half a step more of it: 17.42 %, 75.1 deg."""
    dwell = rest(LEVEL, 48.5, 40.0, rate=1.0)
    w = np.array(dwell.readings.w_ib_b)
    # 30 samples that alternate by s have a mean good to s/sqrt(29)
    w[10:, 0] += np.sqrt(29) * W * cos(radians(48.5)) * (-1.0) ** np.arange(30)
    readings = ImuReadings(dwell.readings.t, w, dwell.readings.f_b)
    moved = replace(dwell, readings=readings)
    _, late = six_position([moved], site(48.5), Options())
    assert late.sigmas is not None
    assert 71.6 < degrees(late.sigmas[1]) < 75.2
    assert "heading" in late.undetermined
    *_, track = six_position_tracks(moved, site(48.5), Options())
    assert degrees(np.sqrt(track.covariance[:, 2, 2].min())) > 68


def test_heading_is_doubted_above_eight_degrees():
    sigma = radians(8.0)
    assert heading_doubt(np.diag([1.0, 1.0, (1.001 * sigma) ** 2]))
    assert not heading_doubt(np.diag([1.0, 1.0, (0.999 * sigma) ** 2]))
    rng = np.random.default_rng(12)
    # 0.15 deg/rt-h over twice 10 s: sigma = 0.15 * sqrt(2/(10/3600))/9.97 rad = 23 deg.
    arw = 0.15 * pi / 180 / 60
    noisy = rest(LEVEL, 48.5, 20, noise=(rng, arw * sqrt_rate(10), 1e-4))
    assert any("8 deg" in flag for flag in fresh(noisy, 48.5).flags)
    # A laser's 0.003 deg/rt-h: 0.46 deg.
    laser = rest(LEVEL, 48.5, 20, noise=(rng, arw / 50 * sqrt_rate(10), 1e-4))
    assert fresh(laser, 48.5).flags == ()


# --- covariance: chi-square ---------------------------------------------------------------------


def sqrt_rate(rate):
    """Per-sample sigma over white density, 1/sqrt(dt)."""
    return np.sqrt(rate)


ARW = pi / 180 / 60  # rad/sqrt(s) for 1 deg/rt-h
RUNS = 400
REGIMES = {  # gyro [deg/rt-h], accelerometer [g/rt-Hz]
    "gyros dominate": (0.003, 10e-6),  # heading 0.4 deg, tilt 3e-4 deg
    "accelerometers dominate": (1e-4, 1e-3),  # tilt and tan(lat) of it in heading, 0.02 deg
}
# Two-sided, family-wise 95 % over four regimes, the unequal windows and the track.
K = norm.ppf(1 - 0.025 / 6)


UNEQUAL = np.array([0.4, 2.0, 1.0])  # noise of the three axes: only so do transposes show


def noisy_dwells(regime, C, latitude, seconds, seed, runs=RUNS, axes=UNEQUAL):
    gyro, force = np.outer(REGIMES[regime], axes)
    rng = np.random.default_rng(seed)
    noise = (rng, gyro * ARW * sqrt_rate(10), force * G * sqrt_rate(10))
    bias = np.array([3e-6, -2e-6, 1e-6, 0.02, -0.01, 0.03])
    return [rest(C, latitude, seconds, noise=noise, bias=bias) for _ in range(runs)]


def nees(estimates, C):
    eta = np.array([error(e.C_nb, C) for e in estimates])
    P = np.array([e.covariance for e in estimates])
    return np.einsum("ni,ni->n", eta, np.linalg.solve(P, eta[..., None])[..., 0])


@pytest.mark.parametrize(
    ("regime", "latitude", "C"),
    [
        pytest.param("gyros dominate", 48.5, LEVEL, id="gyros, north, level"),
        pytest.param("gyros dominate", -70.0, TILTED, id="gyros, south, tilted"),
        pytest.param("accelerometers dominate", 48.5, TILTED, id="accelerometers, north, tilted"),
        pytest.param("accelerometers dominate", -70.0, LEVEL, id="accelerometers, south, level"),
    ],
)
def test_fresh_window_covariance(regime, C, latitude):
    """NEES of 3 degrees of freedom, its covariance itself estimated.

    Each window has 32 equal blocks of 4 samples; the variances of two equally long windows add
    up to 62 degrees of freedom, and are independent of the means. Per component the ratio is
    F(1, 62): mean 62/60, variance 2 62^2 61/(60^2 58) = 2.246. Where rows mix components,
    ``E P^-1`` lies between the true inverse (Jensen, the inverse being convex) and 62/60 of it
    (the same for its operator form): 3 <= E NEES <= 3.1, and the variance is at most 3 x 2.246.
    """
    # NEES is blind to any invertible map, so one noise would test all regimes with one number.
    seed = [21, list(REGIMES).index(regime), C is TILTED, latitude > 0]
    dwells = noisy_dwells(regime, C, latitude, 25.6, seed)
    found = six_position(dwells, site(latitude), Options(offset_window=12.8))[1::2]
    mean = np.mean(nees(found, C))
    spread = K * np.sqrt(3 * 2.246 / RUNS)
    assert 3.0 - spread < mean < 3.1 + spread


def test_few_samples_keep_their_promise():
    """Four samples in either window, at 2 Hz: their variances have three degrees of freedom each
    and both together six, so that squares over them alone would come to 6/4 per freedom.

    Neither counts for less than the sheet's. Where there is none, the factor (4 - 1)/(4 - 3) is
    made for one variance alone: 6/4 / 3.
    """
    gyro, force, runs = 0.003 * ARW, 10e-6 * G, 200
    noise = (np.random.default_rng(32), gyro * 2**0.5 * np.ones(3), force * 2**0.5 * np.ones(3))
    dwells = [rest(LEVEL, 48.5, 4.0, rate=2.0, noise=noise) for _ in range(runs)]
    chance = chi2.ppf((np.arange(1000) + 0.5) / 1000, 3) / 3
    least = np.maximum(chance, 1.0)
    for priors, want in (
        (Priors(gyro_walk=gyro, accel_walk=force), np.mean(2 / (least[:, None] + least))),
        (Priors(), 0.5),
    ):
        told = Options(offset_window=2.0, priors=priors)
        found = six_position(dwells, site(48.5), told)[1::2]
        # variance of a square 2 (want)^2 and somewhat more, three of a run: four times
        assert np.mean(nees(found, LEVEL)) / 3 == pytest.approx(want, abs=4 * want * 0.07)


def test_three_samples_of_unknown_noise_are_refused():
    rng = np.random.default_rng(3)
    noise = (rng, 1e-6 * np.ones(3), 1e-4 * np.ones(3))
    dwell = rest(LEVEL, 48.5, 4.0, rate=2.0, noise=noise)
    for method in (six_position, rk4):
        with pytest.raises(TooShort, match=r"3 samples until 101\.500 s do not tell their noise"):
            method([dwell], site(48.5), Options(offset_window=1.5))
    known = Options(offset_window=1.5, priors=Priors(gyro_walk=1e-6, accel_walk=1e-4))
    assert len(six_position([dwell], site(48.5), known)) == 2


def test_fresh_window_covariance_with_unequal_windows():
    # Offset window a quarter of the fresh one: between 31 and 62 degrees of freedom.
    dwells = noisy_dwells("gyros dominate", TILTED, 48.5, 32.0, seed=22)
    found = six_position(dwells, site(48.5), Options(offset_window=6.4))[1::2]
    mean = np.mean(nees(found, TILTED))
    spread = K * np.sqrt(3 * 2.539 / RUNS)  # variance of F(1, 31), the larger
    assert 3.0 - spread < mean < 3 * 31 / 29 + spread


def test_predicted_heading_sigma_is_that_of_the_closed_form():
    # methods.md: ARW sqrt(1/T0 + 1/T1)/(W cos lat), to the 18 % of one estimate over 40.
    dwells = noisy_dwells("gyros dominate", LEVEL, 48.5, 25.6, seed=23, runs=40, axes=np.ones(3))
    found = six_position(dwells, site(48.5), Options(offset_window=12.8))[1::2]
    variance = np.mean([e.covariance[2, 2] for e in found])
    sigma = 0.003 * ARW * np.sqrt(2 / 12.8) / (W * cos(radians(48.5)))
    # Relative scatter of a variance sqrt(2/62/40) = 2.8 %; four times.
    assert variance == pytest.approx(sigma**2, rel=0.12)
    tilt = 10e-6 * np.sqrt(2 / 12.8)
    assert np.mean([e.covariance[0, 0] for e in found]) == pytest.approx(tilt**2, rel=0.12)


# --- tracks -------------------------------------------------------------------------------------


def test_tracks_end_where_the_estimates_are():
    rng = np.random.default_rng(31)
    dwell = rest(TILTED, 48.5, 25, 10.0, (rng, 1e-6, 1e-3), [1e-5] * 3 + [0.1] * 3)
    same, later = six_position_tracks(dwell, site(48.5), Options())
    estimate_same, estimate_fresh = six_position([dwell], site(48.5), Options())
    assert (same.method, later.method) == ("six-position same", "six-position fresh")
    assert same.t[-1] == pytest.approx(110.0, abs=1e-9)
    assert later.t[0] >= 111.0 - 1e-9  # with a second of data behind it
    assert later.t[-1] == pytest.approx(125.0, abs=1e-9)
    for track, estimate in ((same, estimate_same), (later, estimate_fresh)):
        assert len(track.C_nb) == len(track.t) == len(track.covariance)
        assert np.all(np.diff(track.t) > 0)
        # Another order of summation: rounding of means of 10 m/s^2 and 1e-5 rad/s.
        np.testing.assert_allclose(
            track.C_nb[-1].as_matrix(), estimate.C_nb.as_matrix(), rtol=0, atol=1e-12
        )
    np.testing.assert_allclose(same.covariance[-1], 0, rtol=0, atol=1e-20)
    np.testing.assert_allclose(later.covariance[-1], estimate_fresh.covariance, rtol=1e-12)
    # More data, more sure: the heading's variance falls along each.
    for track in (same, later):
        assert np.all(np.diff(track.covariance[:, 2, 2]) < 0)


def test_no_fresh_track_without_two_seconds():
    assert len(six_position_tracks(rest(LEVEL, 48.5, 11.5), site(48.5), Options())) == 1
    assert len(six_position_tracks(rest(LEVEL, 48.5, 12.5), site(48.5), Options())) == 2


def test_covariance_on_the_way_through_the_offset_window():
    """NEES of the same-window track after 6 of 12.8 s, nose north and level.

    The error is the mean of the first 15 blocks against that of all 32: one direction among the
    31 whose scatter gave the variance. So each ratio is 31 Beta(1/2, 15): mean exactly 1,
    variance 31^2 7.5/(15.5^2 16.5) = 1.818.
    """
    dwells = noisy_dwells("gyros dominate", LEVEL, 48.5, 12.8, seed=32, runs=200)
    values = []
    for dwell in dwells:
        (track,) = six_position_tracks(dwell, site(48.5), Options(offset_window=12.8))
        k = int(np.argmin(np.abs(track.t - 106.0)))
        assert track.t[k] == pytest.approx(106.0, abs=1e-9)
        eta = error(track.C_nb[k], LEVEL)
        values.append(eta @ np.linalg.solve(track.covariance[k], eta))
    assert abs(np.mean(values) - 3.0) < K * np.sqrt(3 * 1.818 / 200)


# --- deflection of the vertical ------------------------------------------------------------------


def test_a_known_deflection_is_taken_out_and_an_unknown_one_is_not():
    # Zenith leaning 20" north and 30" east: the plumb line's f, felt by a level instrument.
    xi, eta = np.array([20.0, 30.0]) / 206264.806
    truth, latitude = LEVEL, radians(48.5)
    f_n = G * np.array([xi, eta, -1.0]) / np.sqrt(1 + xi**2 + eta**2)
    w_n = 7.292115e-5 * np.array([np.cos(latitude), 0.0, -np.sin(latitude)])
    readings = rest(truth, 48.5, 20).readings
    ones = np.ones((len(readings), 1))
    felt = ImuReadings(readings.t, ones * (truth.T @ w_n), ones * (truth.T @ f_n))
    dwell = Dwell("p", 100.0, 120.0, felt, Rotation.from_matrix(truth))
    known = Site(latitude, local_gravity=G, deflection=(xi, eta))
    for method in (six_position, gyrocompass.triad):
        for estimate in method([dwell], known, Options()):
            # rounding alone: 1e-16 of the rate's direction
            np.testing.assert_allclose(error(estimate.C_nb, truth), 0, rtol=0, atol=1e-12)
    (told,) = gyrocompass.triad([dwell], known, Options())
    assert told.latitude == pytest.approx(latitude, abs=2e-8)  # second order: eta^2 tan(lat) / 2
    (blind,) = gyrocompass.triad([dwell], Site(latitude, local_gravity=G), Options())
    # tilt by the deflection; azimuth by eta tan lat (Laplace); latitude astronomical: + xi
    eta_n = error(blind.C_nb, truth)
    np.testing.assert_allclose(np.abs(eta_n[:2]), [eta, xi], rtol=0, atol=1e-7)
    assert abs(eta_n[2]) == pytest.approx(eta * np.tan(latitude), abs=1e-7)
    assert blind.latitude - latitude == pytest.approx(xi, abs=1e-7)


def test_a_gap_is_flagged():
    whole = rest(LEVEL, 48.5, 40)
    keep = np.r_[0:150, 290:400]  # 14 s missing at 10 Hz
    part = whole.readings
    readings = ImuReadings(part.t[keep], part.w_ib_b[keep], part.f_b[keep])
    dwell = Dwell("p", whole.t_from, whole.t_to, readings, whole.nominal)
    for method in (six_position, gyrocompass.triad):
        for estimate in method([dwell], site(48.5), Options()):
            assert any(flag.startswith("gap of 14.1 s after 115") for flag in estimate.flags)
        for estimate in method([whole], site(48.5), Options()):
            assert not any("gap" in flag for flag in estimate.flags)
    with pytest.raises(AlignmentError, match=r"p: gap of 14\.1 s after 115.*lost"):
        rk4([dwell], site(48.5), Options())


def test_the_sequence_is_the_nominal_attitudes_for_all_methods():
    """Noise near 45 deg of pitch must not give the methods angles of different turns."""
    truth = turn_n(E, radians(45.0)) @ LEVEL  # nose up
    for lean in (-1e-4, 1e-4):
        dwell = rest(turn_n(E, lean) @ truth, 48.5, 20, nominal=Rotation.from_matrix(truth))
        found = {
            e.sequence
            for method in (six_position, gyrocompass.triad, rk4)
            for e in method([dwell], site(48.5), Options())
        }
        assert len(found) == 1
