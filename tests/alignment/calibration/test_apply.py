"""Readings without a unit's errors: numbers by hand, the inverse to rounding, sigmas, lags."""

import numpy as np
import pytest

from alignment import ImuReadings
from alignment.calibration import (
    Calibration,
    Gravity,
    Key,
    constants_of,
    correct,
    corrected_covariance,
    derived_of,
    parameters_of,
    reported,
)
from alignment.errors import AlignmentError

G = 9.80665


def calibration(values, sigma=0.0, correlated=None):
    """Of `values` by key, each with a standard deviation of `sigma` of itself."""
    keys = tuple(values)
    x = np.array([values[k] for k in keys])
    P = np.diag((sigma * x) ** 2) if correlated is None else np.asarray(correlated)
    return Calibration(
        parameters=parameters_of(keys, x, P, np.full(len(keys), np.inf)),
        covariance=P,
        chi_square=0.0,
        dof=0,
        gravity=Gravity(value=G),
    )


def by_term(sensor, term, values):
    return {Key(sensor, term, n): v for n, v in enumerate(values)}


def by_pair(sensor, term, matrix):
    own = term == "misalignment"
    return {
        Key(sensor, term, i, j): matrix[i][j]
        for i in range(3)
        for j in range(3)
        if not (own and i == j)
    }


def a_unit():
    """Errors of every kind, of the size of a consumer unit's."""
    rng = np.random.default_rng(5)
    found = {}
    for sensor, one, k2, k3 in (("gyro", 0.02, 1e-4, 1e-4), ("accel", 0.3, 1e-5, 1e-6)):
        found |= by_term(sensor, "bias", rng.normal(0, one, 3))
        found |= by_term(sensor, "scale", rng.normal(0, 0.02, 3))
        found |= by_term(sensor, "asymmetry", rng.normal(0, 1e-3, 3))
        found |= by_term(sensor, "k2", rng.normal(0, k2, 3))
        found |= by_term(sensor, "k3", rng.normal(0, k3, 3))
        found |= by_term(sensor, "temperature_bias", rng.normal(0, one / 50, 3))
        found |= by_term(sensor, "temperature_scale", rng.normal(0, 1e-4, 3))
        found |= by_pair(sensor, "misalignment", rng.normal(0, 0.02, (3, 3)))
    found |= by_pair("gyro", "g_sensitivity", rng.normal(0, 1e-4, (3, 3)))
    return found | by_pair("gyro", "g2_sensitivity", rng.normal(0, 1e-5, (3, 3)))


def test_one_term_at_a_time_by_hand():
    """x = (1, 2, 3) and what X1 adds to it."""
    x, f = np.array([[1.0, 2.0, 3.0]]), np.array([[0.0, 10.0, 0.0]])
    for key, value, more in [
        (Key("gyro", "bias", 0), 0.1, 0.1),
        (Key("gyro", "scale", 1), 0.1, 0.2),
        (Key("gyro", "misalignment", 0, 2), 0.01, 0.03),  # a part of Z1
        (Key("gyro", "asymmetry", 2), -0.01, -0.03),
        (Key("gyro", "k2", 2), 0.01, 0.09),
        (Key("gyro", "k3", 2), 0.01, 0.27),
        (Key("gyro", "g_sensitivity", 0, 1), 0.01, 0.1),
        (Key("gyro", "g2_sensitivity", 0, 1), 0.01, 1.0),
        (Key("gyro", "temperature_bias", 0), 0.01, 0.05),  # 5 K
        (Key("gyro", "temperature_scale", 1), 0.01, 0.1),
    ]:
        y = reported(constants_of([key], [value], "gyro"), x, f, 5.0)
        wanted = x.copy()
        wanted[0, key.axis] += more
        np.testing.assert_allclose(y, wanted, rtol=1e-14)
        # and the other triad knows nothing of it
        np.testing.assert_array_equal(reported(constants_of([key], [value], "accel"), x, f, 5), x)


def test_the_inverse_of_all_terms_at_once_is_exact():
    unit = a_unit()
    rng = np.random.default_rng(3)
    w, f = rng.normal(0, 2, (500, 3)), rng.normal(0, G, (500, 3))
    warmth = rng.uniform(-20, 20, 500)
    reads = [reported(constants_of(unit, unit.values(), s), x, f, warmth)
             for s, x in (("gyro", w), ("accel", f))]  # fmt: skip
    assert np.abs(reads[0] - w).max() > 0.1
    found = correct(calibration(unit), ImuReadings(np.arange(500) / 100, *reads), warmth)
    # rounding of values up to 40, over an inverse whose condition is near 1
    np.testing.assert_allclose(found.f_b, f, atol=1e-12)
    np.testing.assert_allclose(found.w_ib_b, w, atol=1e-12)


def test_corrected_readings_get_the_calibrations_own_uncertainty():
    """Bias 1 +- 0.2, scale 0.1 +- 0.02 at 5: the corrected value (y - b)/(1 + s) by hand."""
    unit = {Key("gyro", "bias", 1): 1.0, Key("gyro", "scale", 1): 0.1}
    P = corrected_covariance(calibration(unit, 0.2), np.array([0, 5.0, 0]), np.zeros(3))
    wanted = np.zeros((6, 6))
    wanted[1, 1] = (0.2**2 + (0.02 * 5) ** 2) / 1.1**2
    np.testing.assert_allclose(P, wanted, rtol=1e-9)  # central differences of what is linear
    # correlated so that they cancel at 10: 0.2 - 0.02 * 10
    both = np.array([[0.04, -0.004], [-0.004, 0.0004]])
    P = corrected_covariance(
        calibration(unit, correlated=both), np.array([0, 10.0, 0]), np.zeros(3)
    )
    assert abs(P[1, 1]) < 1e-12


def test_the_covariance_is_that_of_many_calibrations():
    """Four hundred calibrations around one: how their corrected readings scatter."""
    unit = a_unit()
    one = calibration(unit, 0.05)
    rng = np.random.default_rng(8)
    w, f = np.array([[0.5, -0.3, 0.2]]), np.array([[3.0, -5.0, 8.0]])
    reads = [reported(constants_of(unit, unit.values(), s), x, f)
             for s, x in (("gyro", w), ("accel", f))]  # fmt: skip
    log = ImuReadings(np.array([1.0]), *reads)
    seen = []
    for _ in range(400):
        x = one.values * (1 + 0.05 * rng.standard_normal(len(unit)))
        off = correct(calibration(dict(zip(unit, x, strict=True))), log)
        seen.append(np.r_[off.w_ib_b[0] - w[0], off.f_b[0] - f[0]])
    P = corrected_covariance(one, w[0], f[0])
    scatter = np.cov(np.array(seen).T)
    # variances of 400 are known to 7 %: 4 sigma; second order of 5 % of 0.02 is far below
    np.testing.assert_allclose(scatter.diagonal() / P.diagonal(), 1, atol=0.28)
    corr = P / np.sqrt(np.outer(P.diagonal(), P.diagonal()))
    seen_corr = scatter / np.sqrt(np.outer(scatter.diagonal(), scatter.diagonal()))
    np.testing.assert_allclose(seen_corr, corr, atol=4 / np.sqrt(400))


def test_angles_from_misalignments_by_hand():
    """A case turned by r reads x - r x x; axes that lean by n share it by halves."""
    r, n = np.array([1e-3, -2e-3, 3e-3]), np.array([4e-4, 5e-4, -6e-4])
    M = np.array([[0, r[2], -r[1]], [-r[2], 0, r[0]], [r[1], -r[0], 0]])
    M += np.array([[0, n[2], n[1]], [n[2], 0, n[0]], [n[1], n[0], 0]]) / 2
    keys = [*by_pair("gyro", "misalignment", M), *by_pair("accel", "misalignment", 2 * M)]
    values = [*by_pair("gyro", "misalignment", M).values()]
    values += [*by_pair("accel", "misalignment", 2 * M).values()]
    told = derived_of(keys, np.array(values), np.eye(12) * 1e-8)
    by_name = {(d.quantity, d.sensor, d.axis): d for d in told}
    assert len(told) == 15
    for axis in range(3):
        assert by_name["rotation", "gyro", axis].value == pytest.approx(r[axis])
        assert by_name["non_orthogonality", "gyro", axis].value == pytest.approx(n[axis])
        assert by_name["rotation", "accel", axis].value == pytest.approx(2 * r[axis])
        assert by_name["gyro_to_accel", "gyro", axis].value == pytest.approx(-r[axis])
        # of two independent 1e-4: half their root sum, their root sum, and two rotations
        assert by_name["rotation", "gyro", axis].sigma == pytest.approx(1e-4 / np.sqrt(2))
        assert by_name["non_orthogonality", "accel", axis].sigma == pytest.approx(1e-4 * np.sqrt(2))
        assert by_name["gyro_to_accel", "gyro", axis].sigma == pytest.approx(1e-4)


def test_a_lag_is_taken_out_of_what_is_smooth():
    """Means of a sine that come 7 ms late at 100 Hz; the last ones have no future to read."""
    t = np.arange(1, 401) / 100
    means = lambda at: -np.diff(np.cos(np.r_[at[0] - 0.01, at])) / 0.01  # noqa: E731
    true, late = means(t), means(t - 0.007)
    log = ImuReadings(t, np.stack([late, true, true], 1), np.zeros((400, 3)))
    found = correct(calibration({Key("gyro", "lag", 0): 0.007}), log).w_ib_b
    assert np.abs(late - true).max() > 6e-3
    # a cubic over 10 ms of a sine of 1 rad/s: fourth order, 1e-10; ends of the spline are worse
    np.testing.assert_allclose(found[3:-4, 0], true[3:-4], atol=1e-8)
    np.testing.assert_array_equal(found[:, 1], true)
    assert found[-1, 0] == late[-1]


def test_sizes_of_a_unit_are_taken_out():
    """X1's accelerometer 0.1 m along X1: turning at 2 rad/s about Z1 adds -0.4 to it."""
    t = np.arange(1, 11) / 10
    w, f = np.tile([0, 0, 2.0], (10, 1)), np.tile([-0.4, 0, 9.8], (10, 1))
    found = correct(calibration({Key("accel", "lever_arm", 0, 0): 0.1}), ImuReadings(t, w, f))
    np.testing.assert_allclose(found.f_b, np.tile([0, 0, 9.8], (10, 1)), atol=1e-12)


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        (Key("gyro", "scale", 0), 57.3, "gyro: scale factor or misalignment of 57.3"),
        (Key("accel", "misalignment", 0, 1), -1.0, "other axes"),
        (Key("accel", "k3", 2), 1.0, "higher orders are so large"),
    ],
)
def test_a_calibration_of_something_else_is_refused(key, value, said):
    log = ImuReadings(np.arange(1, 4) / 10, np.ones((3, 3)), np.full((3, 3), 9.0))
    with pytest.raises(AlignmentError, match=said):
        correct(calibration({key: value}), log)


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (("gyro", "bias", 0, 1), "toward"),
        (("gyro", "misalignment", 0), "toward"),
        (("gyro", "misalignment", 1, 1), "another axis"),
        (("gyro", "bias", 3), "axis = 3"),
        (("accel", "g_sensitivity", 0, 0), "of the gyro alone"),
    ],
)
def test_keys_that_mean_nothing(wrong, said):
    with pytest.raises(ValueError, match=said):
        Key(*wrong)
