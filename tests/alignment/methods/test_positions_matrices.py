"""Several positions with a unit whose axes, scales and g-sensitivity are matrices: nothing of the
project makes the readings here, plain matrices do."""

from dataclasses import replace
from itertools import product
from math import cos, degrees, log, pi, radians, sin, sqrt

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.stats import chi2

from alignment import Priors
from alignment.constant_errors import with_products
from alignment.methods import position_fit
from alignment.methods.position_fit import PositionFit, fit_positions, predicted_covariance

W = 7.292115e-5  # rad/s
G = 9.80  # m/s^2
DEG_H = pi / 180 / 3600
MINUTE = pi / 180 / 60
MILLI_G = 9.80665e-3


# --- readings from plain matrices ----------------------------------------------------------------


def skew(v):
    """(..., 3, 3) with skew(v) u = v x u."""
    x, y, z = np.moveaxis(np.asarray(v, dtype=float), -1, 0)
    o = 0 * x
    rows = [[o, -z, y], [z, o, -x], [-y, x, o]]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


def turn(v):
    """Rotation matrices (..., 3, 3) of vectors (..., 3), by Rodrigues' formula."""
    a = np.linalg.norm(v, axis=-1)[..., None, None]
    K = skew(v)
    small = np.where(a > 1e-9, a, 1.0)
    return (
        np.eye(3)
        + np.where(a > 1e-9, np.sin(a) / small, 1.0) * K
        + (np.where(a > 1e-9, (1 - np.cos(a)) / small**2, 0.5) * (K @ K))
    )


def angle_of(E):
    """Small rotation vectors (..., 3) of matrices, exact up to half a turn."""
    v = np.stack(
        [E[..., 2, 1] - E[..., 1, 2], E[..., 0, 2] - E[..., 2, 0], E[..., 1, 0] - E[..., 0, 1]], -1
    )
    s, c = np.linalg.norm(v, axis=-1) / 2, (np.trace(E, axis1=-2, axis2=-1) - 1) / 2
    a = np.arctan2(s, c)
    return v / 2 * np.where(s > 1e-12, a / np.where(s > 1e-12, s, 1.0), 1.0)[..., None]


N, E, D = np.eye(3)
LEVEL = np.column_stack([N, -D, E])  # X1 north, Y1 up, Z1 east
FACES = [  # X1 up, X1 down, Y1 up, Y1 down, Z1 up, Z1 down: turns of b from Y1 up, X1 north
    turn(pi / 2 * np.array([0, 0, 1.0])),
    turn(-pi / 2 * np.array([0, 0, 1.0])),
    np.eye(3),
    turn(pi * np.array([1.0, 0, 0])),
    turn(-pi / 2 * np.array([1.0, 0, 0])),
    turn(pi / 2 * np.array([1.0, 0, 0])),
]
HALF = [np.eye(3), turn(pi * np.array([0, 1.0, 0]))]
FOUR = [turn(k * pi / 2 * np.array([0, 1.0, 0])) for k in range(4)]


def geometry(name, rng):
    """Attitude of position 0 and told turns (n, 3, 3): a base tilted to 20 deg at any azimuth."""
    lean, azimuth, toward = radians(rng.uniform(0, 20)), rng.uniform(0, 2 * pi, 2), np.zeros(3)
    if name.startswith("tilted"):
        toward = lean * np.array([cos(azimuth[1]), sin(azimuth[1]), 0])
    C = turn(toward) @ turn(azimuth[0] * D) @ LEVEL
    told = {"half": HALF, "four": FOUR, "faces": FACES}.get(name.rpartition(" ")[2])
    if told is None:
        told = np.array([turn(v) for v in rng.normal(size=(12, 3)) * 2])
    told = np.array(told)
    return C @ told[0], told[0].T @ told


def unit_readings(C, latitude, priors, rng):
    """Readings (r, n, 6) at true attitudes (r, n, 3, 3) of r units drawn by priors; the biases."""
    runs, w, f = (
        len(C),
        *(
            np.swapaxes(C, -1, -2) @ v
            for v in (W * np.array([cos(latitude), 0, -sin(latitude)]), np.array([0, 0, -G]))
        ),
    )
    parts, biases = [], []
    for sensor, x in (("gyro", w), ("accel", f)):
        drawn = {
            name: getattr(priors, f"{sensor}_{name}") * rng.normal(size=(runs, 3))
            for name in ("bias", "scale", "asymmetry", "misalignment", "non_orthogonality")
        }
        lean = np.zeros((runs, 3, 3))
        for pair, (i, j) in enumerate(((1, 2), (2, 0), (0, 1))):
            lean[:, i, j] = lean[:, j, i] = drawn["non_orthogonality"][:, pair] / 2
        M = np.eye(3) - skew(drawn["misalignment"]) + lean
        y = np.einsum("rij,rnj->rni", (1 + drawn["scale"])[..., None] * M, x)
        y = y + drawn["asymmetry"][:, None] * np.abs(x) + drawn["bias"][:, None]
        if sensor == "gyro":
            pulls = priors.gyro_g_sensitivity * rng.normal(size=(runs, 3, 3))
            y = y + np.einsum("rij,rnj->rni", pulls, f)
        else:
            y = y + priors.accel_quadratic * rng.normal(size=(runs, 1, 3)) * x**2
            y = y + priors.accel_cubic * rng.normal(size=(runs, 1, 3)) * x**3
        parts.append(y)
        biases.append(drawn["bias"])
    return np.concatenate(parts, axis=-1), np.concatenate(biases, axis=-1)


# --- chi-square ----------------------------------------------------------------------------------

SMALL = {"gyro_bias": 10 * DEG_H, "accel_bias": MILLI_G}
REGIMES = {  # priors beside heading's noise [deg], which scales with the horizontal Earth rate
    "noise": (Priors(**SMALL), 2.0),
    "bias": (Priors(gyro_bias=100 * DEG_H, accel_bias=10 * MILLI_G), 0.02),
    "misalignment": (
        Priors(
            **SMALL,
            gyro_misalignment=1e-3,
            accel_misalignment=2e-3,
            gyro_non_orthogonality=5e-4,
            accel_non_orthogonality=1e-3,
        ),
        0.02,
    ),
    "scale": (
        Priors(
            **SMALL,
            gyro_scale=2e-3,
            accel_scale=1e-3,
            gyro_asymmetry=5e-4,
            accel_asymmetry=3e-4,
            accel_quadratic=1e-5,
            accel_cubic=1e-6,
        ),
        0.02,
    ),
    "g-sensitivity": (Priors(**SMALL, gyro_g_sensitivity=0.02 * DEG_H / G), 0.02),
    "placement": (Priors(**SMALL, turn=3 * MINUTE, seat=2 * MINUTE), 0.02),
    "everything": (
        Priors(
            **SMALL,
            gyro_scale=1e-3,
            accel_scale=1e-3,
            gyro_misalignment=1e-3,
            accel_misalignment=1e-3,
            gyro_non_orthogonality=2e-4,
            accel_non_orthogonality=2e-4,
            gyro_g_sensitivity=0.01 * DEG_H / G,
            turn=MINUTE,
            seat=MINUTE,
        ),
        0.3,
    ),
}
GEOMETRIES = ("half", "tilted half", "tilted four", "faces", "tilted faces", "random")
CASES = [(r, g) for r in REGIMES for g in GEOMETRIES]
RUNS = 200
# family-wise 95 %, two-sided: the first and the last position of every case
TAIL = 0.05 / (2 * 2 * len(CASES))


@pytest.mark.parametrize(("regime", "shape"), CASES)
def test_covariances_of_units_with_matrices(regime, shape):
    """NEES of first and last position; latitude -85 to 85, 5 to 1800 s and base tilt drawn."""
    priors, heading_noise = REGIMES[regime]
    rng = np.random.default_rng([71, CASES.index((regime, shape))])
    latitude = radians(rng.uniform(-85, 85))
    C_0, told = geometry(shape, rng)
    n = len(told)
    seconds = np.exp(rng.uniform(log(5), log(1800), n))
    density = radians(heading_noise) * W * cos(latitude) * sqrt(seconds.sum())
    force = 1e-5 * G * sqrt(seconds.sum())
    sigma = np.repeat([density, force], 3) / np.sqrt(seconds)[:, None]
    seat = turn(priors.seat * rng.normal(size=(RUNS, 1, 3)))
    placed = turn(priors.turn * rng.normal(size=(RUNS, n, 3)))
    C = C_0 @ np.swapaxes(seat, -1, -2) @ told @ seat @ placed
    y, biases = unit_readings(C, latitude, priors, rng)
    y = y + sigma * rng.normal(size=y.shape)
    fit = fit_positions(y, np.tile(sigma**2, (RUNS, 1, 1)), told, latitude, G, priors)
    low, high = chi2.ppf([TAIL, 1 - TAIL], 3 * RUNS) / RUNS
    for k in (0, n - 1):
        eta, P = angle_of(fit.C_nb[:, k] @ np.swapaxes(C[:, k], -1, -2)), fit.covariance[:, k]
        assert np.degrees(np.sqrt(np.median(P[:, 2, 2]))) < 8
        nees = np.einsum("ri,ri->r", eta, np.linalg.solve(P, eta[..., None])[..., 0])
        assert low < nees.mean() < high, (k, nees.mean(), degrees(latitude))
    # a bias that the turns show is known by the noise; one that they do not, by its prior
    z = (fit.biases - biases) / np.sqrt(np.einsum("rii->ri", fit.bias_covariance))
    bounds = chi2.ppf([TAIL / 6, 1 - TAIL / 6], RUNS) / RUNS
    assert np.all(np.mean(z**2, axis=0) < bounds[1])
    assert np.all(np.mean(z**2, axis=0) > bounds[0])
    # chi-square says no more than once in a thousand that they contradict one another
    assert fit.contradicted.mean() < 0.03


# --- by hand -------------------------------------------------------------------------------------

STATED = Priors(gyro_bias=1e-9, accel_bias=1e-3, accel_misalignment=1e-3)
NOISE = np.repeat([1e-6, 1e-6], 3)  # rad/s: gyros too coarse to tell a tilt


def perfect(C):
    """Readings (n, 6) of a perfect unit at latitude 45 deg."""
    return unit_readings(C[None], pi / 4, Priors(), np.random.default_rng(0))[0][0]


def turned_case(y, m, part):
    """Readings of a triad whose case is turned by m: ``x x m`` more."""
    y = y.copy()
    y[..., part] += np.cross(y[..., part], m)
    return y


ACCEL, GYRO = slice(3, 6), slice(0, 3)


def test_accelerometers_off_by_a_milliradian_where_the_turn_takes_gravity_along():
    """X1 up, then X1 down about Z1: m g sideways changes its sign with gravity, as a tilt does."""
    told = np.array([np.eye(3), turn(pi * np.array([0, 0, 1.0]))])
    C = np.array([np.column_stack([-D, N, -E])]) @ told  # X1 up, Y1 north, Z1 west
    m = np.array([0, 0, 1e-3])
    y = turned_case(perfect(C), m, ACCEL)
    assert y[0, 4] == pytest.approx(-1e-3 * G)
    assert y[1, 4] == pytest.approx(1e-3 * G)
    fit = fit_positions(y, np.tile(NOISE**2, (2, 1)), told, radians(45), G, STATED)
    off = angle_of(fit.C_nb[0] @ C[0].T)
    # Y1, north, is taken to dip by a milliradian: about west, -E. Gyros whose mean is good to
    # 0.7e-6 rad/s know the tilt to 0.01 rad by Earth rate's 7.3e-5: 1 % of the prior's weight
    assert off[1] == pytest.approx(-1e-3, rel=0.02)
    assert sqrt(fit.covariance[0, 1, 1]) == pytest.approx(1e-3, rel=0.02)
    # Z1 reads nothing of it, and a bias there is the same up and down: about north it is known
    assert abs(off[0]) < 1e-6


def test_accelerometers_off_by_a_milliradian_where_the_turn_leaves_gravity():
    """Y1 up, half a turn about it: m g sideways is the same in both, and cancels as a bias does."""
    C = LEVEL @ np.array(HALF)
    y = turned_case(perfect(C), np.array([1e-3, 0, -1e-3]), ACCEL)
    assert y[0, 3] == pytest.approx(y[1, 3])
    fit = fit_positions(y, np.tile(NOISE**2, (2, 1)), np.array(HALF), radians(45), G, STATED)
    assert np.abs(angle_of(fit.C_nb[0] @ C[0].T)[:2]).max() < 1e-6  # second order
    assert np.sqrt(np.diag(fit.covariance[0])[:2]).max() < 1e-6


@pytest.mark.parametrize("relative", [HALF, FOUR])
def test_gyros_off_by_a_milliradian_turn_the_heading(relative):
    """About the vertical, 1:1, whatever the turns: 3.4'."""
    C = LEVEL @ np.array(relative)
    y = turned_case(perfect(C), np.array([0, 1e-3, 0]), GYRO)
    priors = Priors(gyro_bias=DEG_H, accel_bias=1e-3, gyro_misalignment=1e-3)
    variances = np.tile(np.repeat([1e-11, 1e-6], 3) ** 2, (len(C), 1))
    fit = fit_positions(y, variances, np.array(relative), radians(45), G, priors)
    heading = -angle_of(fit.C_nb[0] @ C[0].T)[2]
    assert abs(heading) == pytest.approx(1e-3, rel=2e-3)
    assert sqrt(fit.covariance[0, 2, 2]) == pytest.approx(1e-3, rel=2e-3)


def test_g_sensitivity_does_not_cancel_in_a_tilted_turn():
    """1 deg/h/g at 5 deg of tilt: sin 5 deg of a deg/h, over 10.64 deg/h at 45 deg: 28.2'."""
    latitude, tilt = radians(45), radians(5)
    C = turn(tilt * N) @ LEVEL
    priors = Priors(gyro_bias=1000 * DEG_H, accel_bias=1e-6, gyro_g_sensitivity=DEG_H / G)
    variances = np.tile(np.repeat([1e-12, 1e-7], 3) ** 2, (2, 1))
    P = predicted_covariance(C, variances, np.array(HALF), latitude, G, priors)
    horizontal = W * cos(latitude)
    # the east gyro, leaning, has cos 5 deg of it; gravity's part along the turn's axis is a bias
    # that the turn leaves: it is told from 1000 deg/h by the latitude
    assert sqrt(P[0, 2, 2]) == pytest.approx(DEG_H * sin(tilt) / horizontal, rel=0.02)
    assert sqrt(P[0, 2, 2]) / MINUTE == pytest.approx(28.2, abs=0.5)


def fit_of(chi_square, freedom):
    one = np.zeros((1, 3, 3))
    return PositionFit(
        one, one, np.zeros(6), np.eye(6), np.zeros((1, 3, 6)), np.ones(6), np.ones(6), None, None,
        np.array(chi_square), np.array(freedom), np.array(np.inf),
    )  # fmt: skip


def test_a_contradiction_makes_all_variances_grow():
    """27.88 for 9 degrees of freedom is once in a thousand; Student's factor is chi2/(f - 2)."""
    assert float(fit_of(27.8, 9.0).growth) == 1.0
    assert float(fit_of(28.0, 9.0).growth) == pytest.approx(4.0)
    assert float(fit_of(700.0, 9.0).growth) == pytest.approx(100.0)
    assert float(fit_of(20.0, 2.0).growth) == np.inf
    assert float(fit_of(1.0, 2.0).growth) == 1.0


@pytest.mark.parametrize("wrong", ["all", "placement"])
def test_a_sigma_that_grew_covers_what_nobody_stated(wrong):
    """All errors ten times as large as stated: the factor is exact. Only one of them: no less."""
    runs, latitude, stated = 300, radians(-40), radians(20 / 3600)
    rng = np.random.default_rng(72)
    told = np.array(FACES[0].T @ np.array(FACES))
    times = 10 if wrong == "all" else 1
    C = LEVEL @ FACES[0] @ told @ turn(10 * stated * rng.normal(size=(runs, 6, 3)))
    drawn = Priors(gyro_bias=times * DEG_H, accel_bias=times * MILLI_G)
    y, _ = unit_readings(C, latitude, drawn, rng)
    sigma = np.repeat([0.02 * DEG_H, 1e-5], 3)
    y = y + times * sigma * rng.normal(size=y.shape)
    priors = Priors(gyro_bias=DEG_H, accel_bias=MILLI_G, turn=stated)
    fit = fit_positions(y, np.tile(sigma**2, (runs, 6, 1)), told, latitude, G, priors)
    assert fit.contradicted.all()
    eta = angle_of(fit.C_nb[:, 0] @ np.swapaxes(C[:, 0], -1, -2))
    P = fit.covariance[:, 0]
    nees = np.einsum("ri,ri->r", eta, np.linalg.solve(P, eta[..., None])[..., 0])
    grown = np.mean(nees / fit.growth)
    # the mean of chi2_3 (f - 2)/chi2_f is 3 whatever f; four sigma of 300 runs
    assert grown < 3 + 4 * sqrt(6 / runs)
    if wrong == "all":
        assert nees.mean() > 200  # 300 of what was stated
        assert grown > 3 - 4 * sqrt(6 / runs)


def test_another_attitude_that_fits_is_in_the_covariance():
    """Half a turn about X1, level: the rate along it is told from its bias by the prior alone.

    Some runs end on the wrong side; the mean square of all errors is what the sigmas say.
    """
    runs, latitude = 1000, radians(48.5)
    rng = np.random.default_rng(73)
    told = np.array([np.eye(3), turn(pi * np.array([1.0, 0, 0]))])
    C = np.tile(turn(radians(20) * D) @ LEVEL @ told, (runs, 1, 1, 1))
    priors = Priors(gyro_bias=7 * DEG_H, accel_bias=MILLI_G)
    y, _ = unit_readings(C, latitude, priors, rng)
    sigma = np.repeat([0.2 * DEG_H, 1e-4], 3)
    y = y + sigma * rng.normal(size=y.shape)
    fit = fit_positions(y, np.tile(sigma**2, (runs, 2, 1)), told, latitude, G, priors)
    off = angle_of(fit.C_nb[:, 0] @ np.swapaxes(C[:, 0], -1, -2))[:, 2]
    wrong = np.abs(off) > radians(60)
    assert 0.01 < wrong.mean() < 0.2
    ratio = np.mean(off**2) / np.mean(fit.covariance[:, 0, 2, 2])
    # it is the number of wrong ones that counts: four sigma of it
    assert abs(ratio - 1) < 4 / sqrt(wrong.sum())


# --- coarse units --------------------------------------------------------------------------------

COARSE = Priors(
    gyro_bias=8.7e-3,
    accel_bias=0.2,
    gyro_scale=5e-3,
    accel_scale=5e-3,
    gyro_misalignment=12.5e-3,
    accel_misalignment=10e-3,
)
COARSE_NOISE = np.repeat([2.8e-6, 4e-5], 3)  # of 300 s


def lowest(y, told, latitude, heading, C_0):
    """Chi-square and heading where plain least squares over all 21 unknowns ends, started from the
    truth turned by `heading` and a unit without errors."""
    sizes = np.repeat(
        [
            COARSE.gyro_bias,
            COARSE.accel_bias,
            COARSE.gyro_scale,
            COARSE.accel_scale,
            COARSE.gyro_misalignment,
            COARSE.accel_misalignment,
        ],
        3,
    )
    w, f = W * np.array([cos(latitude), 0, -sin(latitude)]), np.array([0, 0, -G])
    C_start = turn(heading * D) @ C_0

    def residuals(z):
        b, b_a, s, s_a, m, m_a = (sizes * z[3:]).reshape(6, 3)
        C = turn(z[:3]) @ C_start @ told
        rate, force = w @ C, f @ C
        read = np.hstack(
            [
                rate + s * rate + np.cross(rate, m) + b,
                force + s_a * force + np.cross(force, m_a) + b_a,
            ]
        )
        return np.concatenate([((y - read) / COARSE_NOISE).ravel(), z[3:]])

    end = least_squares(residuals, np.zeros(21), method="lm", xtol=1e-12, ftol=1e-12)
    return 2 * end.cost, turn(end.x[:3]) @ C_start


@pytest.mark.parametrize("seed", [1, 6, 15, 29, 33])
def test_a_coarse_unit_has_the_rivals_that_a_scan_over_heading_finds(seed):
    """Y1 up and Y1 down about X1: a heading and the one half a turn on are about as likely.

    The squares of such a unit's errors exceed its noise: steps that left them out stopped at
    costs of 8 to 270 more, and one attitude was stated to 2.4 deg without a word of the other.
    """
    rng = np.random.default_rng([90, seed])
    latitude, C_0 = radians(48.5), LEVEL
    told = np.array([np.eye(3), turn(pi * np.array([1.0, 0, 0]))])
    y = unit_readings((C_0 @ told)[None], latitude, COARSE, rng)[0][0]
    y = y + COARSE_NOISE * rng.normal(size=y.shape)
    fit = fit_positions(y, np.tile(COARSE_NOISE**2, (2, 1)), told, latitude, G, COARSE)
    ends = [lowest(y, told, latitude, k * pi / 4, C_0) for k in range(8)]
    costs = np.array([cost for cost, _ in ends])
    first = ends[int(np.argmin(costs))][1]
    away = np.array([np.linalg.norm(angle_of(C @ first.T)) for _, C in ends])
    # steps of the first order end where the squares still have a gradient: a tenth
    assert float(fit.chi2) == pytest.approx(costs.min(), abs=0.1)
    assert float(fit.margin) == pytest.approx(costs[away > pi / 2].min() - costs.min(), abs=0.1)
    if fit.margin < 4:  # odds of 1 : e^2, 12 %, of half a turn: 62 deg
        assert np.degrees(np.sqrt(fit.covariance[0, 2, 2])) > 60


SHAPES = ("tilted half", "tilted four", "faces", "random")


def rounds(monkeypatch, priors, noise, seeds):
    """How many linearisations each descent of some fits takes, and whether with all of the
    Jacobian; what multiplies is stated, as the method states it."""
    linearised, walked = position_fit._linearised, position_fit._walked
    count, found = [0], []

    def counted(*args):
        count[0] += 1
        return linearised(*args)

    def watched(state, problem, whole=False):
        before = count[0]
        ends = walked(state, problem, whole)
        found.append((count[0] - before - 1, whole))
        return ends

    monkeypatch.setattr(position_fit, "_linearised", counted)
    monkeypatch.setattr(position_fit, "_walked", watched)
    for shape, seed in product(SHAPES, range(seeds)):
        rng = np.random.default_rng([90, seed])
        C_0, told = geometry(shape, rng)
        y = unit_readings((C_0 @ told)[None], 0.8, priors, rng)[0]
        y = y + noise * rng.normal(size=y.shape)
        variances = np.tile(noise**2, (1, len(told), 1))
        fit_positions(y, variances, told[None], 0.8, G, with_products(priors))
    return found


def test_a_stated_unit_is_fitted_in_five_steps(monkeypatch):
    """Gauss-Newton from linear least squares: each step squares what is left."""
    found = rounds(monkeypatch, STATED, NOISE, 2)
    assert max(steps for steps, _ in found) <= 5
    assert not any(whole for _, whole in found)


def test_a_coarse_unit_is_fitted_in_ten_steps(monkeypatch):
    """Nearly always: of 25 descents one goes round until it is stopped at 60, and then with all of
    the Jacobian, at a cost that is the least within 0.001. Without the secant of what first order
    leaves out four do."""
    found = rounds(monkeypatch, replace(COARSE, turn=8e-6, seat=2.5e-5), COARSE_NOISE, 4)
    steps = np.array([one for one, _ in found])
    assert np.quantile(steps, 0.8) <= 10
    assert np.sum(steps >= 60) <= 3
    assert sum(whole for _, whole in found) <= 3


# --- what a tilt tells of a bias -----------------------------------------------------------------


@pytest.mark.parametrize("noise", [1e-9, 1e-8])
def test_a_tilt_tells_the_bias_along_it_as_surely_as_the_vertical_is_read(noise):
    """Half a turn of a base that leans by t about north: the vertical reads ``t b`` more, or less.

    Placements of 33'' hide b = 25 ug in the tilt to first order (160 urad against 25). To second
    order, of the level parts h of both readings, ``f_y1 - f_y2 = -(h_1^2 - h_2^2)/(2 g) +
    (h_1 - h_2) b/g``: b along ``h_1 - h_2`` to ``sqrt(2) s g / |h_1 - h_2|``, which 1 mrad and
    1e-9 m/s^2 make 7e-7 m/s^2, 0.07 ug. With 1e-7 m/s^2 of noise, too little for a real unit's
    force and about the square of such tilts, it would be 7 ug.
    """
    rng, runs, lean, sigma = np.random.default_rng(5), 60, 1e-3, 2.45e-4
    place = 33 / 3600 * pi / 180
    b = sigma * rng.normal(size=(runs, 3))
    d = place * rng.normal(size=(runs, 2, 3))
    C = turn(lean * N) @ LEVEL @ np.array(HALF) @ turn(d)
    f_n, w_n = np.array([0, 0, -G]), W * np.array([cos(0.8), 0, -sin(0.8)])
    f = np.swapaxes(C, -1, -2) @ f_n + b[:, None]
    w = np.swapaxes(C, -1, -2) @ w_n
    means = np.concatenate([w, f], axis=-1)
    means[..., :3] += 1e-9 * rng.normal(size=w.shape)
    means[..., 3:] += noise * rng.normal(size=f.shape)
    variances = np.repeat([1e-18, noise**2], 3)
    fit = fit_positions(
        means,
        np.tile(variances, (2, 1)),
        np.array(HALF),
        0.8,
        G,
        Priors(gyro_bias=1e-9, accel_bias=sigma, turn=place),
    )
    level = np.array([1.0, 0, 1.0]) * (f[:, 0] - f[:, 1])
    size = np.linalg.norm(level, axis=1)
    along = level / size[:, None]
    P = fit.bias_covariance[:, 3:, 3:]
    stated = np.sqrt(np.einsum("ri,rij,rj->r", along, P, along))
    # the floor of 1e-10 adds 0.5 %, third orders of tilts of a mrad less
    np.testing.assert_allclose(stated, sqrt(2) * noise * G / size, rtol=0.01)
    low, high = chi2.ppf([0.0005, 0.9995], runs) / runs
    error = np.einsum("ri,ri->r", along, fit.biases[:, 3:] - b[:])
    assert low < np.mean((error / stated) ** 2) < high
    tilt = angle_of(fit.C_nb[:, 0] @ np.swapaxes(C[:, 0], -1, -2))[:, 0]
    assert low < np.mean(tilt**2 / fit.covariance[:, 0, 0, 0]) < high


@pytest.mark.parametrize("priors", [COARSE, STATED], ids=["coarse", "stated"])
def test_sets_fitted_together_are_what_each_is_alone(priors):
    """Turns about X1, Y1 and Z1, with drifts of their own: as near as steps end, 1e-9 of a sigma.

    One turn hides the rate along its axis from a coarse unit, so that it has rivals; a fine one is
    soon there: steps of one set know nothing of another's.
    """
    rng = np.random.default_rng(17)
    sets = np.array([[np.eye(3), turn(angle * np.eye(3)[k])] for k, angle in enumerate((3, 2, 1))])
    y = np.concatenate([unit_readings((LEVEL @ told)[None], 0.8, priors, rng)[0] for told in sets])
    y = y + NOISE * rng.normal(size=y.shape)
    variances, drift = np.tile(NOISE**2, (3, 2, 1)), np.zeros((3, 2, 2, 2))
    drift[:, :, 1, 1] = np.array([0.5, 1.0, 2.0])[:, None] * NOISE[0] ** 2
    given = 0.8, G, priors, 0.0
    together = fit_positions(y, variances, sets, *given, drift).each()
    for k, one in enumerate(together):
        alone = fit_positions(y[k], variances[k], sets[k], *given, drift[k])
        for name in ("C_nb", "covariance", "biases", "bias_covariance", "cross", "chi2"):
            found, want = getattr(one, name), getattr(alone, name)
            np.testing.assert_allclose(found, want, rtol=1e-7, atol=1e-9 * np.max(np.abs(want)))
        assert float(one.margin) == pytest.approx(float(alone.margin), rel=1e-7)


def test_noiseless_readings_of_a_unit_with_large_errors():
    """Scale of 1 % is 1e9 times 1e-10 m/s^2: of squares of that double numbers tell nothing."""
    rng = np.random.default_rng(2)
    turns = turn(rng.normal(size=(12, 3)))
    priors = Priors(gyro_bias=1e-4, accel_bias=0.05, accel_scale=0.01, gyro_scale=0.01, turn=1e-3)
    y = unit_readings((LEVEL @ turns)[None], 0.8, priors, rng)[0]
    relative = np.swapaxes(turns[:1], -1, -2) @ turns
    fit = fit_positions(y, np.zeros((12, 6)), relative, 0.8, G, priors)
    assert np.all(np.isfinite(fit.covariance))
    assert np.all(np.linalg.eigvalsh(fit.covariance[0]) > 0)
