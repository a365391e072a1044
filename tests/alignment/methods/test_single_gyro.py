"""One gyro and a latitude: recovery, the 1/sin(psi) law, sensitivities, chi-square."""

from math import acos, cos, degrees, pi, radians, sin, sqrt

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from scipy.stats import chi2, norm

from alignment import Dwell, ImuReadings, Options, Priors, Site
from alignment.angles import Sequence
from alignment.constant_errors import constant_covariance
from alignment.errors import AlignmentError, NotAtRest, PoleError
from alignment.levelling import attitude_covariance, attitude_from_means
from alignment.methods.positions import half_turn_means
from alignment.methods.single_gyro import (
    gyro_latitude,
    latitude_sensitivity,
    single_gyro,
    single_gyro_attitude,
    single_gyro_sensitivity,
)

W = 7.292115e-5  # rad/s
G = 9.8093587  # m/s^2
DEG_H = pi / 180 / 3600
DEG_RT_H = pi / 180 / 60  # rad/sqrt(s)
MINUTE = pi / 180 / 60
MILLI_G = 9.80665e-3
N, E, D = X, Y, Z = np.eye(3)
LEVEL = np.column_stack([N, -D, E])  # X1 north, Y1 up, Z1 east
HERE = Site(radians(48.5))


def headed(heading, pitch=0.0, roll=0.0):
    """X1 that many degrees clockwise of north, then nose up, then Y1 toward Z1."""
    return LEVEL @ Rotation.from_euler("YZX", [-heading, pitch, roll], degrees=True).as_matrix()


def vectors_n(latitude):
    return np.array([W * cos(latitude), 0, -W * sin(latitude)]), np.array([0, 0, -G])


def readings_of(C, latitude):
    w, f = vectors_n(latitude)
    return np.concatenate([C.T @ w, C.T @ f])


def error(found, truth):
    return Rotation.from_matrix(found @ np.swapaxes(truth, -1, -2)).as_rotvec()


def rest(means, seconds=20.0, noise=None, label="p", start=100.0):
    n = round(10 * seconds)
    y = np.tile(means, (n, 1))
    if noise is not None:
        y = y + noise[1] * noise[0].normal(size=(n, 6))
    t = start + np.arange(1, n + 1) / 10
    return Dwell(label, start, start + seconds, ImuReadings(t, y[:, :3], y[:, 3:]))


# --- recovery -------------------------------------------------------------------------------------


@given(
    st.integers(0, 2**32 - 1),
    st.sampled_from([0, 1, 2]),
    st.sampled_from([48.5, -33.0, 0.0, 75.0, -75.0]),
)
def test_any_gyro_recovers_the_attitude(seed, axis, latitude):
    lat = radians(latitude)
    C = Rotation.random(None, np.random.default_rng(seed)).as_matrix()
    y = readings_of(C, lat)
    east = C[1, axis]
    found = single_gyro_attitude(y[axis], y[3:], np.eye(3)[axis], lat, east)
    # Rounding of a cosine near 1 by 4e-16/cos(lat) is magnified by 1/sin(psi)
    assert np.abs(error(found, C)).max() < 2e-14 / max(abs(east), 1e-7)
    assert gyro_latitude(y[:3], y[3:]) == pytest.approx(lat, abs=1e-15 * 8 / cos(lat))


def test_the_formula_by_hand():
    # [S4]: X1 at pitch 10, roll 20, 120 deg west of north (psi = 120): cos psi from w_x.
    th, ph, psi, lat = radians(10), radians(20), radians(120), radians(50)
    w_x = W * (cos(lat) * cos(th) * cos(psi) + sin(lat) * sin(th))
    up = np.array([sin(th), cos(th) * cos(ph), -cos(th) * sin(ph)])
    C = single_gyro_attitude(np.asarray(w_x), G * up, X, lat, -1.0)
    assert degrees(np.arctan2(C[1, 0], C[0, 0])) == pytest.approx(-120, abs=1e-12)
    mirrored = single_gyro_attitude(np.asarray(w_x), G * up, X, lat, 1.0)
    assert degrees(np.arctan2(mirrored[1, 0], mirrored[0, 0])) == pytest.approx(120, abs=1e-12)
    np.testing.assert_allclose(C[2], -up, atol=1e-15)  # rounding


def test_many_at_once():
    headings = np.array([30.0, 100.0, -50.0])
    y = np.array([readings_of(headed(h, 5, -3), HERE.latitude) for h in headings])
    found = single_gyro_attitude(y[:, 0], y[:, 3:], X, HERE.latitude, np.sign(headings))
    for C, h in zip(found, headings, strict=True):
        assert np.abs(error(C, headed(h, 5, -3))).max() < 1e-14
    with pytest.raises(AlignmentError, match=r"cosine of the gyro's azimuth is -1\.689"):
        single_gyro_attitude(y[:, 0] - [0, W, 0], y[:, 3:], X, HERE.latitude, 1.0)
    with pytest.raises(AlignmentError, match=r"vertical rate is 1\.749 of Earth rate"):
        gyro_latitude(y[:, :3] + W * y[:, 3:] / G, y[:, 3:])


# --- first order ----------------------------------------------------------------------------------


@pytest.mark.parametrize("heading", [20.0, 45.0, 90.0, -70.0, 150.0])
@pytest.mark.parametrize(("pitch", "roll"), [(0, 0), (5, 5), (-20, 10)])
@pytest.mark.parametrize("latitude", [48.5, -33.0])
@pytest.mark.parametrize("estimated", [False, True])
def test_sensitivity_by_differences(heading, pitch, roll, latitude, estimated):
    C, lat = headed(heading, pitch, roll), radians(latitude)
    y = readings_of(C, lat)
    scale = np.repeat([W, G], 3) * 1e-6

    def solve(means):
        used = float(gyro_latitude(means[:3], means[3:])) if estimated else lat
        found = single_gyro_attitude(means[0], means[3:], X, used, C[1, 0])
        return np.append(error(found, C), used)

    G6 = single_gyro_sensitivity(C[:, 0], lat, G, estimated)
    rows = np.vstack([G6, latitude_sensitivity(lat, G) * estimated])
    to_n = np.kron(np.eye(2), C)
    for i in range(6):
        h = scale[i] * np.eye(6)[i]
        difference = (solve(y + h) - solve(y - h)) / 2
        # second order 1e-6/sin(psi)^3 of it; rounding 1e-16 of a turn
        want = rows @ to_n @ h
        np.testing.assert_allclose(difference, want, rtol=1e-7, atol=2e-12)


@pytest.mark.parametrize("psi", [15, 30, 60, 90, -45])
def test_one_over_sine(psi):
    """Heading errors of X1's rate, pitch and latitude, level gyro by hand: dpsi = ... / sin psi."""
    lat = HERE.latitude
    C = headed(psi)
    y = readings_of(C, lat)
    dw = 1e-4 * W
    bumped = single_gyro_attitude(y[0] + dw, y[3:], X, lat, psi)
    by_hand = acos(cos(radians(psi)) + 1e-4 / cos(lat)) * np.sign(psi)
    assert error(bumped, C)[2] == pytest.approx(by_hand - radians(psi), rel=1e-9)
    first_order = -dw / (W * cos(lat) * sin(radians(psi)))
    # second order: cot(psi)/2 of it squared, 1.1e-3 at 15 deg
    assert error(bumped, C)[2] == pytest.approx(first_order, rel=1.2e-3)


def test_the_law_over_noise():
    """RMS of heading grows as 1/sin(psi), relative to the floor of one gyro looking east."""
    runs, lat = 2000, HERE.latitude
    floor = radians(1.0)
    rng = np.random.default_rng(81)
    for psi in (30.0, 60.0, 90.0):
        C = headed(psi)
        y = readings_of(C, lat)
        rates = y[0] + floor * W * cos(lat) * rng.normal(size=runs)
        found = single_gyro_attitude(rates, np.tile(y[3:], (runs, 1)), X, lat, 1.0)
        ratio2 = np.mean(error(found, C)[:, 2] ** 2) / floor**2 * sin(radians(psi)) ** 2
        low, high = chi2.ppf([0.005, 0.995], runs) / runs
        assert low < ratio2 < high * 1.005  # second order at 30 deg: (cot/2)^2 3 sigma^2


# --- what biases do -------------------------------------------------------------------------------


def test_immune_to_the_vertical_gyro_after_a_half_turn():
    """10 deg/h on Y1 at tilts of 5 deg and latitude 50: TRIAD 283', this one nothing."""
    lat = radians(50)
    C = headed(90, 5, 5)
    turned = C @ np.diag([-1.0, 1, -1])
    bias = np.array([10, 10, 10, 0, 0, 0]) * DEG_H
    m = half_turn_means(readings_of(C, lat) + bias, readings_of(turned, lat) + bias)
    found = single_gyro_attitude(m[0], m[3:], X, lat, 1.0)
    assert np.abs(error(found, C)).max() < 1e-14  # rounding


# --- the estimator --------------------------------------------------------------------------------


@pytest.mark.parametrize("site", [HERE, Site(None)], ids=["given", "estimated"])
@pytest.mark.parametrize("heading", [0.0, 45.0, 90.0, 200.0])
def test_the_gyro_nearest_east_or_west_is_taken(site, heading):
    C = headed(heading, 7, -4)
    (found,) = single_gyro([rest(readings_of(C, HERE.latitude))], site, Options())
    assert (found.method, found.label, found.t_from, found.t_to) == (
        "single-gyro",
        "p",
        100.0,
        120.0,
    )
    assert np.abs(error(found.C_nb.as_matrix(), C)).max() < 1e-13
    assert (found.latitude is None) == (site is HERE)
    if found.latitude is not None:
        assert found.latitude == pytest.approx(HERE.latitude, abs=1e-13)
    # Z1 is nearest where X1 looks north: bias of X1 does not matter there, of Z1 it does
    if heading == 0.0:
        y = readings_of(C, HERE.latitude) + 0.1 * DEG_H * np.eye(6)[0]
        (biased,) = single_gyro([rest(y)], HERE, Options())
        assert abs(error(biased.C_nb.as_matrix(), C)[2]) < 1e-13


def test_refusals():
    y = readings_of(headed(30), HERE.latitude)
    moved = rest(y).readings.f_b + (np.arange(200) >= 100)[:, None] * np.array([0.4, 0, 0])
    r = rest(y).readings
    with pytest.raises(NotAtRest, match=r"^p: not at rest"):
        single_gyro([Dwell("p", 100.0, 120.0, ImuReadings(r.t, r.w_ib_b, moved))], HERE, Options())
    at_pole = rest(readings_of(headed(30), pi / 2))
    for site in (Site(pi / 2), Site(None)):
        with pytest.raises(PoleError):
            single_gyro([at_pole], site, Options())
    # Nose east, X1 reads 12 deg/h, more than the horizontal Earth rate, and Z1 yet more.
    east = readings_of(headed(90), HERE.latitude)
    with pytest.raises(AlignmentError, match=r"^p: X1 gyro: cosine of the gyro's azimuth is 1\.2"):
        single_gyro([rest(east + np.array([12, 0, 40, 0, 0, 0]) * DEG_H)], HERE, Options())
    with pytest.raises(AlignmentError, match=r"^p: vertical rate is 2\.079 of Earth rate"):
        single_gyro([rest(y + np.array([0, 20, 0, 0, 0, 0]) * DEG_H)], Site(None), Options())


@pytest.mark.parametrize("north", [10.0, -4.0])
def test_a_known_deflection_is_taken_out_of_the_latitude(north):
    """Seen from the plumb line 48.5 deg are the geodetic latitude and its northern part."""
    second = pi / 180 / 3600
    site = Site(None, deflection=(north * second, 0.0))
    (found,) = single_gyro([rest(readings_of(headed(75), radians(48.5)))], site, Options())
    assert found.latitude is not None
    assert (radians(48.5) - found.latitude) / second == pytest.approx(north, abs=1e-6)


def test_a_rate_that_is_not_the_earths_is_flagged():
    y = readings_of(headed(90), HERE.latitude)
    (fine,) = single_gyro([rest(y + 2 * DEG_H * np.eye(6)[1])], HERE, Options())
    assert fine.flags == ()
    (found,) = single_gyro([rest(y + 10 * DEG_H * np.eye(6)[1])], HERE, Options())
    # |(9.967, 21.265)| = 23.485 of 15.041
    assert found.flags == ("mean rate is 1.56 of Earth rate: gyro bias, or not at rest",)


def test_sigma_holds_noise_and_priors():
    rng = np.random.default_rng(82)
    walk = 0.003 * DEG_RT_H
    sigmas = np.repeat([walk, 1e-4], 3) * sqrt(10)
    y = readings_of(headed(90), HERE.latitude)  # X1 east, Z1 south
    horizontal = W * cos(HERE.latitude)

    def variance(priors):
        dwells = [rest(y, noise=(rng, sigmas)) for _ in range(40)]
        found = single_gyro(dwells, HERE, Options(priors=priors))
        return np.mean([e.covariance for e in found], axis=0)

    noise = walk**2 / 20 / horizontal**2
    # 40 variances of 31 degrees of freedom: 4 %, four times
    assert variance(Priors())[2, 2] == pytest.approx(noise, rel=0.16)
    bias = variance(Priors(gyro_bias=0.05 * DEG_H, accel_bias=MILLI_G))
    tilt = (MILLI_G / G) ** 2
    by_hand = (0.05 * DEG_H / horizontal) ** 2 + np.tan(HERE.latitude) ** 2 * tilt
    assert bias[2, 2] == pytest.approx(by_hand + noise, rel=0.02)
    assert bias[0, 0] == pytest.approx(tilt, rel=0.01)
    assert bias[0, 2] == pytest.approx(-np.tan(HERE.latitude) * tilt, rel=0.01)


# --- chi-square -----------------------------------------------------------------------------------

RUNS = 400
REGIMES = {  # priors, gyro [deg/rt-h], accelerometer [ug/rt-Hz]; 600 s
    "noise": (Priors(), 0.1, 50),
    "gyro bias": (Priors(gyro_bias=0.2 * DEG_H), 0.003, 50),
    "accelerometer bias": (Priors(gyro_bias=1e-3 * DEG_H, accel_bias=5 * MILLI_G), 1e-3, 50),
    "scale": (Priors(gyro_scale=5e-3, accel_scale=2e-3), 1e-3, 50),
}
# A latitude by the sine of the vertical rate is first order up to 60 deg with such gyros.
LATITUDES = {False: (48.5, -33.0, 75.0, -75.0), True: (48.5, -33.0, 60.0, -60.0)}
CASES = [(r, lat, e) for r in REGIMES for e in (False, True) for lat in LATITUDES[e]]
K = norm.ppf(1 - 0.025 / len(CASES))


@pytest.mark.parametrize(("regime", "latitude", "estimated"), CASES)
def test_covariance(regime, latitude, estimated):
    priors, arw, vrw = REGIMES[regime]
    lat = radians(latitude)
    rng = np.random.default_rng([83, CASES.index((regime, latitude, estimated))])
    C = headed(70, 4, -6)
    true = readings_of(C, lat)
    sigma = np.repeat([arw * DEG_RT_H, vrw * 9.80665e-6], 3) / sqrt(600.0)
    bias = np.repeat([priors.gyro_bias, priors.accel_bias], 3)
    scale = np.repeat([priors.gyro_scale, priors.accel_scale], 3)
    nees, sigmas = [], []
    for _ in range(RUNS):
        y = true * (1 + scale * rng.normal(size=6))
        y = y + bias * rng.normal(size=6) + sigma * rng.normal(size=6)
        variances = sigma**2 * rng.chisquare(31, size=6) / 31
        used = float(gyro_latitude(y[:3], y[3:])) if estimated else lat
        found = single_gyro_attitude(y[0], y[3:], X, used, 1.0)
        S = single_gyro_sensitivity(found[:, 0], used, float(np.linalg.norm(y[3:])), estimated)
        P = attitude_covariance(
            Rotation.from_matrix(found), np.diag(variances) + constant_covariance(y, priors), S
        )
        eta = error(found, C)
        nees.append(eta @ np.linalg.solve(P, eta))
        sigmas.append(sqrt(P[2, 2]))
    assert degrees(np.mean(sigmas)) < 8
    # F(1, 31) at the worst: mean 31/29
    spread = K * sqrt(2 * 3 / RUNS) * 31 / 27
    assert 3 - spread < np.mean(nees) < 3 * 31 / 29 + spread


@pytest.mark.parametrize("latitude", [48.5, -33.0])
@pytest.mark.parametrize("gyros", ["two", "one, east"])
def test_white_noise_floor_of_one_position(latitude, gyros):
    """RMS over ``ARW/(W cos lat sqrt T)``: 95 % interval meets [1.00, 1.10]."""
    runs, lat = 2000, radians(latitude)
    floor = radians(4.0)
    rng = np.random.default_rng(84)
    C = headed(90)
    y = np.tile(readings_of(C, lat), (runs, 1))
    y[:, :3] += floor * W * cos(lat) * rng.normal(size=(runs, 3))
    if gyros == "two":
        found = attitude_from_means(y[:, :3], y[:, 3:], Sequence.YAW_PITCH_ROLL).as_matrix()
    else:
        found = single_gyro_attitude(y[:, 0], y[:, 3:], X, lat, 1.0)
    ratio = sqrt(np.mean(error(found, C)[:, 2] ** 2)) / floor
    low, high = sqrt(runs) / np.sqrt(chi2.ppf([0.975, 0.025], runs))
    assert ratio * high > 1.00
    assert ratio * low < 1.10


# --- which gyro -----------------------------------------------------------------------------------


def chosen(hidden, sheet=False, noise=None):
    """Heading of a unit with X1 44 deg east of north, biases hiding a part of the level rate."""
    C = headed(44.0)
    means = readings_of(C, radians(48.5))
    level = W * cos(radians(48.5)) * np.array([cos(radians(44)), 0.0, sin(radians(44))])
    means[:3] -= hidden * level * np.sign(means[:3] * level)
    noise = np.random.default_rng(1) if noise is None else noise
    dwell = rest(means, 60.0, (noise, np.repeat([3e-5, 1e-4], 3)))
    (found,) = single_gyro([dwell], HERE, Options(priors=Priors(gyro_bias=1e-9 * sheet)))
    assert found.C_nb is not None
    assert found.covariance is not None
    north, east, _ = found.C_nb.as_matrix()[:, 0]  # angles are silent where sigma is above 30 deg
    return np.arctan2(east, north), np.sqrt(found.covariance[2, 2])


def test_two_gyros_that_contradict_each_other_are_as_likely_to_be_chosen():
    """Half of the level rate is hidden: one gyro's azimuth is acos(0.36) or 69 deg, the other's
    acos(0.35) from east: 48 deg apart, 24 to either side for whom noise chooses. A unit with no
    biases has what noise makes: 3e-5 sqrt(1/600) over W cos lat sin 44: 2.1 deg."""
    _, whole = chosen(0.0)
    assert 1.4 < degrees(whole) < 3.2
    _, stated = chosen(0.5, sheet=True)
    assert degrees(stated) < 6  # a sheet tells the biases
    rng = np.random.default_rng(2)
    found, sigmas = np.array([chosen(0.5, noise=rng) for _ in range(20)]).T
    assert 20 < degrees(np.sqrt(np.mean(sigmas**2))) < 34
    ratio = found.var(ddof=1) / np.mean(sigmas**2)
    assert 0.4 < ratio < 1.7  # chi-square of 19 degrees of freedom, 95 %
