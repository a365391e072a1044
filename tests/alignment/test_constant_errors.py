"""Constant errors of a triad in one attitude: by hand."""

from dataclasses import replace

import numpy as np
import pytest

from alignment import Priors
from alignment.constant_errors import (
    BY_AXIS,
    ERRORS_OF,
    constant_columns,
    constant_covariance,
    constant_form,
    in_one_attitude,
    with_products,
)
from alignment.skew import unit_axes

MEANS = np.array([1.0, 2, 3, 10, 20, 30])
EARTH_RATE = 7.292115e-5  # rad/s


def test_biases_and_scale_errors_by_hand():
    found = constant_covariance(MEANS, Priors(0.1, 0.2, 0.01, 0.02))
    want = [0.01 + 1e-4, 0.01 + 4e-4, 0.01 + 9e-4, 0.04 + 0.04, 0.04 + 0.16, 0.04 + 0.36]
    np.testing.assert_allclose(found, np.diag(want), rtol=1e-14)


def test_a_case_that_is_turned_feels_nothing_along_what_it_feels():
    """``x x m``: variances sigma^2 (|x|^2 - x_i^2), and m_ij against m_ji: -sigma^2 x_i x_j."""
    P = constant_covariance(MEANS, Priors(accel_misalignment=0.1))
    f = MEANS[3:]
    np.testing.assert_allclose(P[3:, 3:], 0.01 * (1400 * np.eye(3) - np.outer(f, f)), rtol=1e-14)
    assert not P[:3].any()
    # tilt is the same in every attitude: 0.1 rad about any axis across gravity
    across = np.array([3.0, 0.0, -1.0]) / np.sqrt(10)
    assert across @ P[3:, 3:] @ across == pytest.approx(0.01 * 1400, rel=1e-14)


def test_axes_that_lean_together_read_half_of_it_each():
    """m_ij and m_ji alike: X and Y read n/2 of each other's value, of one draw."""
    P = constant_covariance(np.array([3.0, 4, 0, 0, 0, 0]), Priors(gyro_non_orthogonality=0.2))
    # X: n_xy 4/2; Y: n_xy 3/2; Z: n_zx 3/2 and n_yz 4/2
    want = 0.04 * np.array([[4.0, 3.0, 0.0], [3.0, 2.25, 0.0], [0.0, 0.0, 6.25]])
    np.testing.assert_allclose(P[:3, :3], want, rtol=1e-14)


def test_gravity_pulls_every_gyro_by_each_component():
    P = constant_covariance(MEANS, Priors(gyro_g_sensitivity=0.1, gyro_g2_sensitivity=0.01))
    want = 0.01 * 1400 + 1e-4 * (1e4 + 16e4 + 81e4)
    np.testing.assert_allclose(P[:3, :3], want * np.eye(3), rtol=1e-14)


def test_signs_and_orders_of_accelerometers():
    f = np.array([-10.0, 20, 0])
    A = constant_columns(
        np.zeros(3), f, Priors(accel_asymmetry=2.0, accel_quadratic=0.5, accel_cubic=0.1)
    )
    assert A.shape == (6, 9)
    np.testing.assert_allclose(A[3:, :3], np.diag([20.0, 40, 0]))
    np.testing.assert_allclose(A[3:, 3:6], np.diag([50.0, 200, 0]))
    np.testing.assert_allclose(A[3:, 6:], np.diag([-100.0, 800, 0]))


def test_what_one_attitude_takes_for_bias_and_scale():
    told = Priors(
        3e-5,
        0.3,
        accel_misalignment=0.03,
        accel_non_orthogonality=0.08,
        gyro_g_sensitivity=4e-6,
        gyro_misalignment=0.5,
        gyro_scale=3.0,
        gyro_asymmetry=4.0,
        accel_quadratic=0.1,
    )
    found = in_one_attitude(told, 10.0)
    assert found.accel_bias == pytest.approx(np.hypot(0.3, 0.5), rel=1e-12)  # 0.05 rad of 10
    drawn = [3e-5, 4e-5, 0.5 * EARTH_RATE]
    assert found.gyro_bias == pytest.approx(np.linalg.norm(drawn), rel=1e-12)
    assert (found.gyro_scale, found.accel_scale) == pytest.approx((5.0, 1.0), rel=1e-12)
    assert in_one_attitude(found, 10.0) == found  # counted once


def test_products_of_scale_and_axes_lean_axes_together():
    """(1 + S)(1 + M) of scales 3 %, -1 % and a turn of 20 mrad about Z1, multiplied out by hand.

    S M has 0.03 (-0.02) above the diagonal and -0.01 (0.02) below: -4e-4 together on either side,
    which is a lean of X1 and Y1 by -8e-4 = (0.03 + 0.01) (-0.02); the rest, -2e-4 and 2e-4, turns.
    """
    S, M = np.diag([0.03, -0.01, 0.0]), np.array([[0, -0.02, 0], [0.02, 0, 0], [0, 0, 0.0]])
    left = (np.eye(3) + S) @ (np.eye(3) + M) - np.eye(3) - S - M
    np.testing.assert_allclose(left[:2, :2], [[0, -6e-4], [-2e-4, 0]], atol=1e-15)
    priors = Priors(accel_scale=0.03, accel_misalignment=0.02, gyro_scale=0.01)
    found = with_products(priors)
    assert found.accel_non_orthogonality == pytest.approx(np.sqrt(2) * 6e-4)
    assert found.gyro_non_orthogonality == 0.0
    stated = with_products(replace(priors, accel_non_orthogonality=2e-3))
    assert stated.accel_non_orthogonality == pytest.approx(np.hypot(2e-3, np.sqrt(2) * 6e-4))
    # columns of leaning take a lean by halves: of X1-Y1, the third
    lean = BY_AXIS["non_orthogonality"](np.array([1.0, 0, 0]), np.zeros(3))
    np.testing.assert_allclose(lean[:, 2], [0, 0.5, 0])


def test_how_readings_change_with_what_is_there():
    """Against differences of the columns: exact but for rounding, the cubic's h^2 apart."""
    skewed = tuple(map(tuple, unit_axes([[1.0, 0.1, 0], [0, 1, 0.2], [0.3, 0, 1]]).tolist()))
    names = [f"{sensor}_{name}" for sensor in ERRORS_OF for name in ERRORS_OF[sensor]]
    terms = {name: 0.1 + 0.01 * k for k, name in enumerate(names)}
    form = constant_form(replace(Priors(accel_axes=skewed), **terms))
    rng = np.random.default_rng(4)
    x, u, h = rng.normal(size=(2, 3, 6)), rng.normal(size=(2, form.count)), 1e-4
    found = form.slopes(x, u)
    for k, aside in enumerate(h * np.eye(6)):
        apart = form.columns(x + aside) - form.columns(x - aside)
        want = np.einsum("rniq,rq->rni", apart, u) / (2 * h)
        np.testing.assert_allclose(found[..., k], want, rtol=1e-6, atol=1e-7)
