"""Two gyros on a rocking base: the published azimuth and bound, and what they leave out."""

from math import atan, cos, degrees, pi, radians, sin, sqrt, tan

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import norm

from alignment import Dwell, ImuReadings, Options, Priors, Site, Turn
from alignment.errors import AlignmentError, PoleError, TooShort
from alignment.methods.two_gyro import (
    Sway,
    azimuth,
    azimuth_as_published,
    azimuth_of_sway,
    rocking_rate_variance,
    sway_bound,
    sway_of,
    two_gyro,
    two_gyro_functional,
    white_density,
)

W = 7.292115e-5  # rad/s
G = 9.8093587  # m/s^2
DEG_H = pi / 180 / 3600
DEG_RT_H = pi / 180 / 60  # rad/sqrt(s)
MINUTE = pi / 180 / 60
MILLI_G = 9.80665e-3
N, E, D = np.eye(3)
LEVEL = np.column_stack([N, -D, E])  # X1 north, Y1 up, Z1 east
LAT = radians(48.5)
HERE = Site(LAT)


def attitudes(azimuth_, beta, gamma):
    """Yaw, then Z1 raised by beta, then X1 by gamma [rad]; arrays (n,) to (n, 3, 3)."""
    angles = np.stack(np.broadcast_arrays(-azimuth_, -beta, gamma), axis=-1)
    return LEVEL @ Rotation.from_euler("YXZ", angles).as_matrix()


def earth_rates(C, latitude):
    """What the gyros along X1 and Z1 see of Earth rate."""
    w = C.swapaxes(-1, -2) @ np.array([W * cos(latitude), 0, -W * sin(latitude)])
    return w[..., 0], w[..., 2]


# --- the two forms --------------------------------------------------------------------------------


@pytest.mark.parametrize("latitude", [0.0, 48.5, -33.0, 70.0])
def test_published_azimuth_is_exact_at_north(latitude):
    lat = radians(latitude)
    rng = np.random.default_rng(1)
    beta, gamma = rng.uniform(-0.3, 0.3, size=(2, 50))
    f1, f2 = earth_rates(attitudes(0.0, beta, gamma), lat)
    found = azimuth_as_published(f1, f2, beta, gamma, lat)
    np.testing.assert_allclose(found, 0, atol=1e-14)  # rounding


def test_elsewhere_only_the_second_form_holds():
    tilt = 1e-3
    for alpha in (0.5, -1.2, 2.0, pi / 2, -3.0):
        for beta, gamma in ((tilt, 0.0), (0.0, tilt), (tilt, -2 * tilt)):
            f1, f2 = earth_rates(attitudes(alpha, beta, gamma), LAT)
            found = azimuth(f1, f2, beta, gamma, LAT)
            # second order: tan(lat) and its square times 5e-6
            assert (found - alpha + pi) % (2 * pi) - pi == pytest.approx(0, abs=1.5e-5)
    # By hand: nose at 60 deg, X1 raised: tan(lat) sin(60) of the tilt, which [S1] takes for 0.
    f1, f2 = earth_rates(attitudes(pi / 3, 0.0, tilt), LAT)
    published = float(azimuth_as_published(f1, f2, 0.0, tilt, LAT))
    assert published - pi / 3 == pytest.approx(-tan(LAT) * sin(pi / 3) * tilt, rel=5e-3)


def test_azimuth_by_hand():
    # Level: f1 = cos 30, f2 = -sin 30 of anything; clockwise 30 deg.
    assert float(azimuth(sqrt(0.75), -0.5, 0, 0, LAT)) == pytest.approx(radians(30))
    assert float(azimuth_as_published(sqrt(0.75), -0.5, 0, 0, LAT)) == pytest.approx(radians(30))
    # Raised Z1 by 1 mrad looking north: tan(48.5) mrad clockwise less of it.
    assert float(azimuth(1.0, 0.0, 1e-3, 0.0, LAT)) == pytest.approx(1e-3 * tan(LAT), rel=1e-5)
    sigma = atan(sin(LAT) * sin(1e-3) / cos(LAT))
    assert float(azimuth_as_published(1.0, 0.0, 1e-3, 0.0, LAT)) == pytest.approx(sigma)


# --- the law --------------------------------------------------------------------------------------


def test_sway_of_samples_by_hand():
    tilts = np.array([[0.01, 0.02], [0.03, -0.02], [0.02, 0.03]])
    f = G * attitudes(0.0, tilts[:, 0], tilts[:, 1]).swapaxes(1, 2) @ -D
    sway = sway_of(f)
    assert (sway.beta, sway.gamma) == pytest.approx((0.02, 0.01), rel=1e-12)
    assert sway.variance_beta == pytest.approx(1e-4, rel=1e-12)  # unbiased: (1 + 1)/2 e-4
    assert sway.variance_gamma == pytest.approx(7e-4, rel=1e-12)  # (1 + 9 + 4)/2 e-4
    assert sway.covariance == pytest.approx(-2e-4, rel=1e-12)  # (-1 - 3 + 0)/2 e-4
    assert sway.rms == pytest.approx(sqrt(8e-4), rel=1e-12)


def per_sample_errors(latitude, beta, gamma, beta0=0.0, gamma0=0.0):
    """[S1]: each sample's gyros with the mean tilts, Earth rate alone, X1 north."""
    f1, f2 = earth_rates(attitudes(0.0, beta, gamma), latitude)
    return azimuth_as_published(f1, f2, beta0, gamma0, latitude)


SAMPLES = 40000
SWAY = radians(0.2)


@pytest.mark.parametrize("latitude", range(20, 76, 5))
def test_tangent_of_latitude(latitude):
    """RMS error tan(lat) sqrt(D xi) by the sway of Z1; that of X1 does nothing."""
    lat = radians(latitude)
    rng = np.random.default_rng(2)
    xi, eta = SWAY * rng.normal(size=(2, SAMPLES))
    both = np.std(per_sample_errors(lat, xi, eta), ddof=1)
    sway = Sway(0.0, 0.0, np.var(xi, ddof=1), np.var(eta, ddof=1), 0.0)
    law = tan(lat) * sqrt(sway.variance_beta)
    assert sway_bound(sway, lat) == pytest.approx(law, rel=1e-12)
    # Drawn variance used, so what is left is second order: tan(lat) xi eta, 1.3 % at 75 deg
    # squared, and Monte Carlo 1/sqrt(2 n) of such cross terms.
    assert both == pytest.approx(law, rel=1e-3)
    alone = np.std(per_sample_errors(lat, np.zeros(SAMPLES), eta), ddof=1)
    assert alone < 1e-12 * both  # X1 stays in the meridian: nothing at all


def test_the_bound_of_a_tilted_base():
    lat = radians(60)
    rng = np.random.default_rng(3)
    L = np.linalg.cholesky([[1.0, 0.6], [0.6, 1.0]])
    xi, eta = SWAY * L @ rng.normal(size=(2, SAMPLES))
    beta0, gamma0 = radians(8), radians(-5)
    errors = per_sample_errors(lat, beta0 + xi, gamma0 + eta, beta0, gamma0)
    C = np.cov(xi, eta)
    sway = Sway(beta0, gamma0, C[0, 0], C[1, 1], C[0, 1])
    found, rms = sway_bound(sway, lat), np.std(errors, ddof=1)
    # A bound adds absolutely what adds with signs
    assert rms <= found * 1.01
    # By differences of the error itself: its linear part is below the bound
    h = 1e-6
    slopes = [
        float(per_sample_errors(lat, beta0 + h * b, gamma0 + h * c, beta0, gamma0)) / h
        for b, c in ((1, 0), (0, 1))
    ]
    assert rms == pytest.approx(sqrt(np.array(slopes) @ C @ slopes), rel=0.01)  # second order
    assert found < 1.6 * rms


def test_the_bound_by_slopes_of_a_and_b():
    """``(|A| sqrt(D z2) + |B| sqrt(D z1))/(A^2 + B^2)``, sway of both tilts told together."""
    lat, beta0, gamma0 = radians(60), radians(20), radians(-15)
    C = 1e-4 * np.array([[1.0, 0.8], [0.8, 2.0]])  # of beta and gamma
    s, c = sin(lat), cos(lat)

    def A(b, g):
        return c * cos(g) + s * cos(b) * sin(g)

    def B(b, g):
        return s * sin(b)

    h = 1e-6
    slopes = [
        np.array(
            [
                (F(beta0 + h * b, gamma0 + h * g) - F(beta0 - h * b, gamma0 - h * g)) / (2 * h)
                for b, g in ((1, 0), (0, 1))
            ]
        )
        for F in (A, B)
    ]
    D_z1, D_z2 = (d @ C @ d for d in slopes)
    a, b = A(beta0, gamma0), B(beta0, gamma0)
    want = (abs(a) * sqrt(D_z2) + abs(b) * sqrt(D_z1)) / (a * a + b * b)
    assert sway_bound(Sway(beta0, gamma0, C[0, 0], C[1, 1], C[0, 1]), lat) == pytest.approx(
        want, rel=1e-8
    )


def test_real_gyros_feel_the_sways_own_rate():
    """22 500 times the tilt at 0.2 Hz and latitude 50, along the axis that the law calls deaf."""
    lat, f, size = radians(50), 0.2, radians(0.5)
    assert 2 * pi * f / (W * sin(lat)) == pytest.approx(22500, rel=0.002)
    dt = 0.01
    t = np.arange(0, 20 + dt / 2, dt)
    wave = size * np.sin(2 * pi * f * t)
    shares = {}
    for axis, (beta, gamma) in {"Z1": (wave, 0 * wave), "X1": (0 * wave, wave)}.items():
        C = attitudes(0.0, beta, gamma)
        own = Rotation.from_matrix(C[:-1].swapaxes(1, 2) @ C[1:]).as_rotvec() / dt
        tilt = np.std(earth_rates(C, lat)[1])
        shares[axis] = (np.std(own[:, 2]), np.std(own[:, 0]), tilt)
    # raising X1 is a rate about Z1, the gyro across the meridian: azimuth is all sway
    assert shares["X1"][0] == pytest.approx(2 * pi * f * size / sqrt(2), rel=1e-3)
    assert shares["X1"][2] < 1e-12 * W  # and no tilt effect
    # raising Z1 is a rate about X1, which at azimuth 0 scales and does not turn
    assert shares["Z1"][0] < 1e-3 * shares["Z1"][1]
    assert shares["X1"][0] / shares["Z1"][2] == pytest.approx(22500, rel=0.01)


# --- the estimator --------------------------------------------------------------------------------


def rocking(
    alpha=1.0,
    beta0=0.0,
    gamma0=0.0,
    size=0.0,
    latitude=LAT,
    seconds=120.0,
    hz=10,
    rng=None,
    errors=None,
    label="r",
):
    """A rocking dwell and its mean attitude; `size` rms [rad] of each axis, 0.1 to 0.4 Hz.

    `errors`: bias (6,), scale (6,), sigmas of samples (6,).
    """
    n = round(seconds * hz)
    t = np.arange(n + 1) / hz
    tilts = []
    for mean in (beta0, gamma0):
        wave = np.zeros(n + 1)
        if size:
            for f in rng.uniform(0.1, 0.4, 6):
                wave += size / sqrt(3) * np.sin(2 * pi * f * t + rng.uniform(0, 2 * pi))
        tilts.append(mean + wave)
    C = attitudes(alpha, *tilts)
    own = Rotation.from_matrix(C[:-1].swapaxes(1, 2) @ C[1:]).as_rotvec() * hz
    C_mid = attitudes(alpha, *((x[1:] + x[:-1]) / 2 for x in tilts))
    C_bn = C_mid.swapaxes(1, 2)
    w = own + C_bn @ np.array([W * cos(latitude), 0, -W * sin(latitude)])
    y = np.concatenate([w, C_bn @ np.array([0, 0, -G])], axis=1)
    if errors is not None:
        bias, scale, sigmas = errors
        y = y * (1 + scale) + bias + sigmas * rng.normal(size=y.shape)
    readings = ImuReadings(100.0 + t[1:], y[:, :3], y[:, 3:])
    means = [np.mean((x[1:] + x[:-1]) / 2) for x in tilts]
    told = Rotation.from_matrix(LEVEL)
    return Dwell(label, 100.0, 100.0 + seconds, readings, told), attitudes(alpha, *means)


def error(found, truth):
    return Rotation.from_matrix(found @ truth.T).as_rotvec()


@pytest.mark.parametrize("alpha", [0.0, 1.0, -2.5, pi / 2])
@pytest.mark.parametrize("latitude", [48.5, -33.0])
def test_attitude_at_rest(alpha, latitude):
    lat = radians(latitude)
    dwell, C = rocking(alpha, 2e-3, -1e-3, latitude=lat)
    (found,) = two_gyro([dwell], Site(lat, local_gravity=G), Options())
    eta = error(found.C_nb.as_matrix(), C)
    np.testing.assert_allclose(eta[:2], 0, atol=1e-13)  # rounding
    assert abs(eta[2]) < 1e-12  # rounding of rates of 1e-5 rad/s
    assert (found.method, found.label, found.t_from, found.t_to) == ("two-gyro", "r", 100, 220)


def test_rocking_fails_visibly_and_says_so():
    rng = np.random.default_rng(4)
    errors = []
    for _ in range(40):
        dwell, C = rocking(0.3, size=radians(0.5), seconds=300.0, hz=5, rng=rng)
        (found,) = two_gyro([dwell], HERE, Options())
        errors.append(error(found.C_nb.as_matrix(), C)[2])
        assert "heading sigma above 8 deg: beyond first order" in found.flags
        # sqrt(2) 0.5 deg/300 s over 9.97 deg/h: 49 deg; the draw's size varies
        assert 25 < degrees(sqrt(found.covariance[2, 2])) < 90
        (bound,) = [flag for flag in found.flags if flag.startswith("published bound")]
    assert bound.endswith(" deg")
    # methods.md section 3: some 44 deg (of the arc tangent of such rates)
    assert 25 < degrees(np.std(errors)) < 65


# --- tilts ----------------------------------------------------------------------------------------

TILTED = (radians(8), radians(-5), radians(-67))  # beta, gamma, latitude: 4.1 deg by first order


def test_what_first_order_leaves_goes_with_the_square_of_the_tilt():
    """5 deg at 8/-5 deg and latitude -67; halving the tilts quarters it."""
    beta, gamma, lat = TILTED
    for alpha, whole in ((0.2, -4.48), (1.8, 5.31)):
        left = []
        for part in (1.0, 0.5, 0.25, 0.125):
            f1, f2 = earth_rates(attitudes(alpha, part * beta, part * gamma), lat)
            left.append(float(azimuth(f1, f2, part * beta, part * gamma, lat)) - alpha)
        assert degrees(left[0]) == pytest.approx(whole, abs=0.01)
        # the cube of 0.16 rad over its square: what is left of it at an eighth of the tilt
        assert np.array(left[:-1]) / left[1:] == pytest.approx(4, rel=0.02)


@pytest.mark.parametrize("alpha", [0.0, 1.0, -2.5, pi / 2, 3.1])
@pytest.mark.parametrize("latitude", [0.0, 48.5, -67.0, 78.0])
def test_no_order_of_steady_tilts_is_left_out(alpha, latitude):
    lat = radians(latitude)
    for beta, gamma in ((8, -5), (-6, 7), (0.0, -9.9)):
        dwell, C = rocking(alpha, radians(beta), radians(gamma), latitude=lat)
        (found,) = two_gyro([dwell], Site(lat, local_gravity=G), Options())
        # rounding of rates of 1e-5 rad/s in samples of up to 1e-4, over cos(lat)
        np.testing.assert_allclose(error(found.C_nb.as_matrix(), C), 0, rtol=0, atol=1e-11)


def test_tilts_of_a_sway_are_averaged_as_they_are():
    """Sway of 3 deg that is alike about both axes: its covariance times tan(lat) turns heading."""
    beta, gamma, lat = TILTED
    rng = np.random.default_rng(15)
    xi = radians(3) * rng.normal(size=2000)
    eta = xi + radians(1) * rng.normal(size=2000)
    for alpha in (0.3, -2.0):
        f1, f2 = earth_rates(attitudes(alpha, beta + xi, gamma + eta), lat)
        found = azimuth_of_sway(f1.mean(), f2.mean(), beta + xi, gamma + eta, lat)
        assert (found - alpha + pi) % (2 * pi) - pi == pytest.approx(0, abs=1e-13)
        mean = azimuth_of_sway(f1.mean(), f2.mean(), np.mean(beta + xi), np.mean(gamma + eta), lat)
        off = abs((mean - alpha + pi) % (2 * pi) - pi)
        assert off > 0.1 * radians(3) ** 2  # what their means alone would leave


@pytest.mark.parametrize(
    ("f1", "f2", "azimuth"),
    [
        # X1 raised by 8 deg at 80 deg: cos 8 cos a + tan 80 sin 8, and -sin a, over W cos lat
        (-0.185934, -0.173648, 170.0),
        (1.284424, -0.866025, 60.0),
        (0.789290, 1.0, -90.0),
        (-0.108198, 0.422618, -155.0),
    ],
)
def test_azimuth_far_north_by_hand(f1, f2, azimuth):
    found = azimuth_of_sway(f1, f2, 0.0, radians(8), radians(80))
    off = (found - radians(azimuth) + pi) % (2 * pi) - pi
    assert off == pytest.approx(0, abs=4e-6)  # six digits, of rates of a fifth


def test_sigma_of_a_tilted_base_by_differencing_the_estimator():
    beta, gamma, lat = TILTED
    site = Site(lat, local_gravity=G)
    dwell, _ = rocking(1.0, beta, gamma, latitude=lat)
    r = dwell.readings
    base = two_gyro([dwell], site, Options())[0]
    steps = {"gyro_bias": 1e-9, "accel_bias": 1e-5}
    for name, step in steps.items():
        slopes = []
        for axis in np.eye(3):
            w, f = (
                (r.w_ib_b + step * axis, r.f_b)
                if "gyro" in name
                else (
                    r.w_ib_b,
                    r.f_b + step * axis,
                )
            )
            moved = Dwell("r", 100.0, 220.0, ImuReadings(r.t, w, f), dwell.nominal)
            found = two_gyro([moved], site, Options())[0]
            slopes.append((found.C_nb * base.C_nb.inv()).as_rotvec())
        wider = two_gyro([dwell], site, Options(priors=Priors(**{name: step})))[0]
        want = np.array(slopes).T @ np.array(slopes)
        got = wider.covariance - base.covariance
        # the slopes' own second order, 1e-4 of heading
        np.testing.assert_allclose(got, want, rtol=0, atol=1e-3 * want.max())
    # By the tilts, of 0.16 rad and tan(lat) 2.36: a level base has tan(lat)/g along one axis.
    level = tan(lat) * 1e-5 / G
    assert sqrt(want[2, 2]) == pytest.approx(abs(level), rel=0.1)


def test_two_azimuths_are_one_too_many():
    """At latitude 82 tan(lat) is 7.12: asin(1/7.12) is 8.08 deg."""
    lat = radians(82)
    dwell, _ = rocking(1.0, radians(8.5), 0.0, latitude=lat)
    with pytest.raises(AlignmentError, match=r"r: tilted by 8\.5 deg: two .* below 8\.1 deg"):
        two_gyro([dwell], Site(lat, local_gravity=G), Options())


def test_refusals():
    with pytest.raises(AlignmentError, match=r"r: Y1 is 11\.0 deg off up"):
        two_gyro([rocking(beta0=radians(11))[0]], HERE, Options())
    swaying = rocking(size=radians(5), rng=np.random.default_rng(5))[0]
    with pytest.raises(AlignmentError, match=r"r: sway too large: \d\.\d deg rms, 5 are"):
        two_gyro([swaying], HERE, Options())
    with pytest.raises(TooShort, match="r: 31 samples, at least 32"):
        two_gyro([rocking(seconds=3.1)[0]], HERE, Options())
    with pytest.raises(PoleError):
        two_gyro([rocking()[0]], Site(pi / 2), Options())
    with pytest.raises(AlignmentError, match="latitude: not known"):
        two_gyro([rocking()[0]], Site(None), Options())


# --- variances ------------------------------------------------------------------------------------


def test_white_density_and_what_rocking_hides():
    rng = np.random.default_rng(6)
    n, runs, dt = 3000, 400, 0.1
    walk = 1e-5
    white = walk / sqrt(dt) * rng.normal(size=(n, runs))
    found = white_density(white, dt)
    # each from some n/2 independent values: 2/sqrt(n), and over 400 runs
    assert np.mean(found) == pytest.approx(walk**2, rel=4 * 2 / sqrt(n * runs))
    t = np.arange(n + 1) * dt
    sway = np.zeros((n + 1, runs))
    for _ in range(8):
        f, phase = rng.uniform(0.1, 0.4, runs), rng.uniform(0, 2 * pi, runs)
        sway += 0.01 * sqrt(2 / 8) * np.sin(2 * pi * f * t[:, None] + phase)
    own = np.diff(sway, axis=0) / dt
    # third differences of 0.4 Hz at 10 Hz: (0.25)^3 of the rate, yet far above 1e-5: it says more
    T = n * dt
    for rates, want, slack in ((white, walk**2 / T, 0.0), (own, 2 * 0.01**2 / T**2, 0.02)):
        predicted = rocking_rate_variance(rates, dt)
        # runs scatter by 10 %: over 400, four times; line fit of a sway takes some percent
        assert np.mean(predicted) == pytest.approx(want, rel=0.02 + slack)
        # and the means scatter as predicted: chi-square of 400, four sigma
        ratio = np.mean(rates.mean(axis=0) ** 2 / predicted)
        assert ratio == pytest.approx(1, abs=4 * sqrt(2 / runs) + 0.02)


def test_vibration_at_rest_is_no_tilt():
    """0.5 m/s^2 at 20 Hz along north: samples' tilts of 3 deg, whose mean square made 2' of one."""
    t = np.arange(1, 6001) / 100
    rng = np.random.default_rng(6)
    C = attitudes(0.7, 0.05, -0.03)
    w = np.tile(C.T @ np.array([W * cos(LAT), 0, -W * sin(LAT)]), (6000, 1))
    f = np.tile(C.T @ np.array([0.0, 0, -G]), (6000, 1))
    f += np.outer(0.5 * np.sin(2 * pi * 20.3 * t), C.T @ N) + 1e-4 * rng.normal(size=f.shape)
    readings = ImuReadings(t, w + 1e-7 * rng.normal(size=w.shape), f)
    (found,) = two_gyro([Dwell("p", 0.0, 60.0, readings)], HERE, Options())
    assert found.C_nb is not None
    assert found.covariance is not None
    eta = error(found.C_nb.as_matrix(), C)
    # 60 s are 1218 periods of it: the mean of that is below 0.5/(2 pi 20 60) m/s^2
    assert np.all(np.abs(eta[:2]) < 3 * np.sqrt(np.diag(found.covariance)[:2]) + 7e-6)


RUNS = 150
REGIMES = {  # priors, gyro [deg/rt-h], accelerometer [ug/rt-Hz], sway [deg]
    "noise": (Priors(), 0.03, 50, 0.0),
    "bias": (Priors(gyro_bias=0.1 * DEG_H, accel_bias=2 * MILLI_G), 1e-3, 100, 0.0),
    "accelerometer bias": (Priors(accel_bias=3 * MILLI_G, accel_scale=1e-4), 3e-3, 100, 0.0),
    "sway": (Priors(), 1e-3, 500, 0.01),
}
LATITUDES = (48.5, -33.0, 70.0, -70.0)
CASES = [(r, lat) for r in REGIMES for lat in LATITUDES]
K = norm.ppf(1 - 0.025 / len(CASES))


@pytest.mark.slow
@pytest.mark.parametrize(("regime", "latitude"), CASES)
def test_covariance(regime, latitude):
    priors, arw, vrw, sway = REGIMES[regime]
    lat = radians(latitude)
    site = Site(lat, local_gravity=G)
    rng = np.random.default_rng([91, CASES.index((regime, latitude))])
    sigmas = np.repeat([arw * DEG_RT_H, vrw * 9.80665e-6], 3) * sqrt(5)
    stated_bias = np.repeat([priors.gyro_bias, priors.accel_bias], 3)
    stated_scale = np.repeat([priors.gyro_scale, priors.accel_scale], 3)
    nees, heading = [], []
    for _ in range(RUNS):
        errors = stated_bias * rng.normal(size=6), stated_scale * rng.normal(size=6), sigmas
        alpha = rng.uniform(-pi, pi)
        dwell, C = rocking(alpha, 3e-4, -4e-4, radians(sway), lat, 90.0, 5, rng=rng, errors=errors)
        (found,) = two_gyro([dwell], site, Options(priors=priors))
        eta = error(found.C_nb.as_matrix(), C)
        nees.append(eta @ np.linalg.solve(found.covariance, eta))
        heading.append(sqrt(found.covariance[2, 2]))
    assert degrees(np.mean(heading)) < 8
    # Variances scatter by 10 %: 1 % more; second order of tilts of 0.4 mrad at 70 deg: 1e-6 rad.
    spread = K * sqrt(2 * 3 / RUNS)
    assert 3 - spread < np.mean(nees) < 3 * 1.03 + spread


@pytest.mark.slow
@pytest.mark.parametrize("regime", ["noise", "bias", "accelerometer bias"])
def test_covariance_of_a_tilted_base(regime):
    """Where first order was 4.1 deg wrong at a sigma of 0.15: both sides, all azimuths."""
    priors, arw, vrw, _ = REGIMES[regime]
    rng = np.random.default_rng([92, list(REGIMES).index(regime)])
    sigmas = np.repeat([arw * DEG_RT_H, vrw * 9.80665e-6], 3) * sqrt(5)
    bias = np.repeat([priors.gyro_bias, priors.accel_bias], 3)
    scale = np.repeat([priors.gyro_scale, priors.accel_scale], 3)
    nees = []
    for _ in range(RUNS):
        lat = rng.choice([-1, 1]) * rng.uniform(0.5, 1.2)
        beta, gamma = rng.uniform(-0.11, 0.11, size=2)
        errors = bias * rng.normal(size=6), scale * rng.normal(size=6), sigmas
        dwell, C = rocking(rng.uniform(-pi, pi), beta, gamma, 0, lat, 90.0, 5, rng, errors)
        (found,) = two_gyro([dwell], Site(lat, local_gravity=G), Options(priors=priors))
        eta = error(found.C_nb.as_matrix(), C)
        nees.append(eta @ np.linalg.solve(found.covariance, eta))
    # variances scatter by 20 %: 4 % more; second order of heading of up to 8 deg, 2 %
    spread = norm.ppf(1 - 0.025 / 3) * sqrt(2 * 3 / RUNS)
    assert 3 - spread < np.mean(nees) < 3 * 1.06 + spread


def test_prediction_of_a_rest_is_the_sigma_of_the_estimate():
    """Slopes of means: ``ARW/(W cos lat sqrt T)``; what the functional's white noise comes to."""
    beta, gamma, lat = TILTED
    site, walk = Site(lat, local_gravity=G), 0.01 * DEG_RT_H
    dwell, _ = rocking(1.0, beta, gamma, latitude=lat, seconds=90.0)
    run = two_gyro_functional(dwell.readings, site, Options())
    spans = np.diff(run.t)
    each = run.gyro / np.sqrt(spans)[:, None, None] * walk
    P = np.einsum("mij,mkj->ik", each, each)
    # two gyros across the vertical, each along its own: nothing of the tilts but their directions
    assert sqrt(P[2, 2]) == pytest.approx(walk / (W * cos(lat) * sqrt(90)), rel=0.02)
    assert not run.motion.any()
    rng = np.random.default_rng(16)
    told = []
    for _ in range(20):
        noisy = ImuReadings(
            dwell.readings.t,
            dwell.readings.w_ib_b + walk * sqrt(10) * rng.normal(size=(900, 3)),
            dwell.readings.f_b,
        )
        (found,) = two_gyro([Dwell("r", 100.0, 190.0, noisy, dwell.nominal)], site, Options())
        told.append(found.covariance[2, 2])
    # each knows its noise to 10 %
    assert np.sqrt(np.mean(told)) == pytest.approx(sqrt(P[2, 2]), rel=0.05)


def test_of_a_base_that_rocks_no_prediction_is_made_and_why():
    swaying, _ = rocking(size=radians(0.5), rng=np.random.default_rng(5), seconds=300.0)
    with pytest.raises(AlignmentError, match=r"rocks by 0\.\d+ deg rms, .* some \d+ deg of h"):
        two_gyro_functional(swaying.readings, HERE, Options())


def test_a_turning_stretch_has_no_mean_attitude():
    n = 200
    t = np.arange(1, n + 1) / 10
    w, f = np.tile([1e-5, 0.1, 0.0], (n, 1)), np.tile([0, G, 0.0], (n, 1))
    turn = Turn(np.array([0.0, 1, 0]), 0.1 * t)
    turning = Dwell("T", 0.0, 20.0, ImuReadings(t, w, f), None, turn)
    with pytest.raises(AlignmentError, match="T: turns at a constant rate"):
        two_gyro([turning], HERE, Options())


def test_the_sway_comes_as_numbers():
    """[S1] (16): mean tilts, variances, and the bound, of the estimate as of its samples."""
    rng = np.random.default_rng(8)
    n, T = 4000, 200.0
    beta, gamma = radians(2) + 1e-3 * rng.normal(size=n), radians(-1) + 2e-3 * rng.normal(size=n)
    C = attitudes(0.3, beta, gamma)
    w = np.einsum("nji,j->ni", C, W * np.array([cos(LAT), 0, -sin(LAT)]))
    f = np.einsum("nji,j->ni", C, [0, 0, -G])
    t = (np.arange(n) + 1) * T / n
    (found,) = two_gyro([Dwell("d", 0.0, T, ImuReadings(t, w, f))], HERE, Options())
    sway = sway_of(f)
    assert found.sway["beta"] == pytest.approx(np.mean(beta), rel=1e-12)
    assert found.sway["variance_gamma"] == pytest.approx(np.var(gamma, ddof=1), rel=1e-9)
    assert found.sway["bound"] == sway_bound(sway, LAT)


def test_a_ramp_that_the_record_shows_is_counted():
    """0.1 deg/h from end to end of ten minutes at rest, no data sheet: over ``W cos lat`` of
    9.967 deg/h at 48.5 deg it is 0.01003 rad; the fit of the ramp is good to 2 %."""
    rng, n, hour = np.random.default_rng(4), 6000, np.pi / 180 / 3600
    t, lat = np.arange(1, n + 1) / 10, np.radians(48.5)
    w = 7.292115e-5 * np.array([np.cos(lat), np.sin(lat), 0.0])  # X1 north, Y1 up
    noise = 2e-4 * np.pi / 180 / 60 * np.sqrt(10) * rng.normal(size=(n, 3))
    rates = w + noise + 0.1 * hour * t[:, None] / 600
    forces = [0.0, 9.81, 0.0] + 1e-4 * rng.normal(size=(n, 3))
    dwell = Dwell("rest", 0.0, 600.0, ImuReadings(t, rates, forces))
    (found,) = two_gyro([dwell], Site(lat), Options())
    assert np.sqrt(found.covariance[2, 2]) == pytest.approx(0.01003, rel=0.1)
    assert any("gyros by 0.1 deg/h" in flag for flag in found.flags)
