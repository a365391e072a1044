"""Products and recursions of one order: what libraries give, to rounding, and one loop's bits."""

from itertools import accumulate

import numpy as np
import pytest
from scipy.linalg import expm

from alignment.fixed_order import exponential, norm, product, recursion

RNG = np.random.default_rng(0)


def test_products_are_those_of_matrices():
    """Nine terms of size 1 round to some 1e-15."""
    A, B, v = RNG.normal(size=(3, 4)), RNG.normal(size=(4, 3)), RNG.normal(size=4)
    np.testing.assert_allclose(product(A, B), A @ B, atol=1e-14)
    np.testing.assert_allclose(product(A, v), A @ v, atol=1e-14)
    np.testing.assert_allclose(product(v, B, A), v @ B @ A, atol=1e-14)
    assert float(product(v, v)) == pytest.approx(v @ v)
    many = RNG.normal(size=(5, 2, 3))
    np.testing.assert_allclose(product(many, A), many @ A, atol=1e-14)


def test_norm_and_exponential():
    assert norm([3.0, 4.0, 12.0]) == 13.0
    A = RNG.normal(size=(6, 6)) / 4
    np.testing.assert_allclose(exponential(A), expm(A), atol=1e-14)
    turn = np.array([[0.0, -np.pi / 2], [np.pi / 2, 0.0]])  # a quarter turn
    np.testing.assert_allclose(exponential(turn), [[0, -1], [1, 0]], atol=1e-15)


@pytest.mark.parametrize("factor", [0.5, -0.99, 0.7 + 0.6j])
def test_a_first_order_recursion_is_a_loop(factor):
    u, last = RNG.normal(size=(3, 50)) + 0 * factor, np.array([1.0, 2.0, -3.0]) + 0 * factor
    found = recursion([factor], u, last[:, None])
    for row, begin, out in zip(u, last, found, strict=True):
        loop = list(accumulate(row.tolist(), lambda y, x: factor * y + x, initial=begin.item()))
        np.testing.assert_array_equal(out, loop[1:])


def test_a_second_order_recursion_is_a_loop():
    u, (a, b) = RNG.normal(size=(2, 50)), (0.43, -0.2)
    found = recursion([a, b], u, np.array([[1.0, 2.0], [-3.0, 0.5]]))
    y = [np.array([2.0, 0.5]), np.array([1.0, -3.0])]
    for x in u.T:
        y.append(x + a * y[-1] + b * y[-2])
    np.testing.assert_allclose(found, np.array(y[2:]).T, rtol=0, atol=1e-14)
    assert recursion([a, b], u[:, :0], np.zeros((2, 2))).shape == (2, 0)
