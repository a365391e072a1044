"""The recursion against SciPy's own filter, and by hand."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import lfilter

from stand.imu.recursion import Recursion

FACTORS = [0.98, -0.4, 0.7 + 0.6j, 1e-4 - 1e-5j]


def inputs(factor, n):
    parts = np.random.default_rng(2).normal(size=(2, 3, n))
    return parts[0] + 1j * parts[1] if isinstance(factor, complex) else parts[0]


def from_rest(factor, u):
    return Recursion(factor, np.zeros(len(u), u.dtype))


def test_halving_by_hand():
    """y_k = u_k + y_(k-1) / 2 from y = 8: 4 + 1, 2.5 + 2, 2.25 + 0; the other row from nothing."""
    recursion = Recursion(0.5, np.array([8.0, 0.0]))
    y = recursion.apply(np.array([[1.0, 2.0, 0.0], [0.0, 0.0, 3.0]]))
    assert y.tolist() == [[5.0, 4.5, 2.25], [0.0, 0.0, 3.0]]
    assert recursion.state.tolist() == [2.25, 3.0]


def test_a_quarter_turn_by_hand():
    """Times i each: 1, i + 1, -1 + i + 2."""
    y = Recursion(1j, np.zeros(1, complex)).apply(np.array([[1.0, 1.0, 2.0]], complex))
    assert y.tolist() == [[1, 1 + 1j, 1 + 1j]]


@pytest.mark.parametrize("factor", FACTORS)
def test_the_same_as_scipy(factor):
    u = inputs(factor, 5000)
    # sums of some 50 remembered values, each rounded to 1e-16 of its size
    assert np.abs(from_rest(factor, u).apply(u) - lfilter([1.0], [1.0, -factor], u)).max() < 1e-13


@pytest.mark.parametrize("factor", FACTORS)
@given(cuts=st.sets(st.integers(1, 399), max_size=60))
def test_the_same_bits_wherever_it_is_cut(factor, cuts):
    u = inputs(factor, 400)
    edges = [0, *sorted(cuts), 400]
    recursion = from_rest(factor, u)
    parts = [recursion.apply(u[:, i:j]) for i, j in pairwise(edges)]
    assert np.array_equal(np.hstack(parts), from_rest(factor, u).apply(u))
