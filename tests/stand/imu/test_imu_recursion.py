"""The recursion against SciPy's own filter, and by hand."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import lfilter

from stand.imu.recursion import Recursion

FILTERS = [([1.0], [1.0, -0.98]), ([0.2, 0.3, 0.1], [1.0, -0.9, 0.3]), ([0.5, 0.0], [1.0, 0.4])]


def from_rest(b, a, rows):
    recursion = Recursion(b, a)
    recursion.settle(np.zeros(rows), np.zeros(rows))
    return recursion


def test_halving_by_hand():
    """y_k = u_k + y_(k-1) / 2 from y = 8: 4 + 1, 2.5 + 2, 2.25 + 0; the other row from nothing."""
    recursion = Recursion([1.0], [1.0, -0.5])
    recursion.settle(np.zeros(2), np.array([8.0, 0.0]))
    y = recursion.apply(np.array([[1.0, 2.0, 0.0], [0.0, 0.0, 3.0]]))
    assert y.tolist() == [[5.0, 4.5, 2.25], [0.0, 0.0, 3.0]]


@pytest.mark.parametrize(("b", "a"), FILTERS)
def test_the_same_as_scipy(b, a):
    u = np.random.default_rng(2).normal(size=(3, 5000))
    # sums of some 50 remembered values, each rounded to 1e-16 of its size
    assert np.abs(from_rest(b, a, 3).apply(u) - lfilter(b, a, u, axis=-1)).max() < 1e-13


@pytest.mark.parametrize(("b", "a"), FILTERS)
@given(cuts=st.sets(st.integers(1, 399), max_size=60))
def test_the_same_bits_wherever_it_is_cut(b, a, cuts):
    u = np.random.default_rng(3).normal(size=(3, 400))
    edges = [0, *sorted(cuts), 400]
    recursion = from_rest(b, a, 3)
    parts = [recursion.apply(u[:, i:j]) for i, j in pairwise(edges)]
    assert np.array_equal(np.hstack(parts), from_rest(b, a, 3).apply(u))


def test_a_settled_filter_passes_a_constant_unchanged():
    recursion = Recursion([0.25, 0.25], [1.0, -0.5])  # gain one
    u = np.array([[3.0] * 50, [-7.0] * 50])
    recursion.settle(u[:, 0], u[:, 0])
    assert np.abs(recursion.apply(u) - u).max() < 1e-14  # rounding
