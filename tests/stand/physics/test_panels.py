"""Polynomials through few instants: powers whose means are written by hand."""

import numpy as np
import pytest
from scipy.special import roots_jacobi

from stand.physics.panels import Panels, places_of

ENDS = np.array([0.0, 0.3, 1.1, 2.0])
SIZES = np.array([1.0, -2.0, 3.0])


def curves_of(panels, power):
    return panels.curves(SIZES[:, None] * panels.nodes**power)


@pytest.mark.parametrize("count", range(3, 13))
def test_nodes_are_those_of_lobatto(count):
    """Between the ends, the zeros of Jacobi's polynomial (1, 1): another library's."""
    places = places_of(count)
    assert list(places[[0, -1]]) == [-1.0, 1.0]
    assert np.abs(places[1:-1] - roots_jacobi(count - 2, 1, 1)[0]).max() < 1e-15
    np.testing.assert_array_equal(places, -places[::-1])


@pytest.mark.parametrize("counts", [[3, 3, 3], [4, 4, 4], [5, 3, 12]])
@pytest.mark.parametrize("power", range(6))
def test_means_of_powers_by_hand(counts, power):
    """Mean of t^p over [0, 2]: 2^p/(p + 1), exact up to p = 2 n - 3; over parts up to n - 1."""
    panels = Panels(ENDS, np.array(counts))
    curves, least = curves_of(panels, power), min(counts)
    whole = panels.cut(ENDS[[0, -1]]).means(curves)[:, 0]
    exact = np.abs(whole - SIZES * 2.0**power / (power + 1)).max() < 1e-14  # rounding of 32/6
    assert exact == (power <= 2 * least - 3)
    edges = np.array([0.1, 0.25, 0.3, 0.3, 1.0, 1.95])[[0, 1, 2, 4, 5]]
    means = panels.cut(edges).means(curves)
    wanted = np.diff(edges ** (power + 1)) / (power + 1) / np.diff(edges)
    exact = np.abs(means - SIZES[:, None] * wanted).max() < 1e-14
    assert exact == (power <= least - 1)


@pytest.mark.parametrize("count", [3, 7, 12])
def test_values_at_ends_of_samples_by_hand(count):
    panels = Panels(ENDS, np.full(3, count))
    edges = np.array([0.05, 0.3, 0.7, 1.9999, 2.0])
    found = panels.cut(edges).ends(curves_of(panels, 2))
    assert np.abs(found - SIZES[:, None] * edges[1:] ** 2).max() < 1e-14


def test_errors_of_means_by_hand():
    """h^4/2880 of 24, the fourth derivative of t^4; h^6/1512000 of 720, the sixth of t^6."""
    h = 1.5
    for count, power, error in ((3, 4, h**4 * 24 / 2880), (4, 6, h**6 * 720 / 1512000)):
        panels = Panels(np.array([0.0, h]), np.array([count]))
        mean = panels.cut(np.array([0.0, h])).means(curves_of(panels, power))[0, 0]
        assert mean - h**power / (power + 1) == pytest.approx(error, rel=1e-11)


def test_neighbours_share_the_end_between_them():
    panels = Panels(ENDS, np.array([3, 5, 4]))
    assert len(panels.nodes) == 2 + 4 + 3 + 1
    assert (np.diff(panels.nodes) > 0).all()
    assert np.isin(ENDS, panels.nodes).all()


def test_what_stands_still_is_that_number():
    rng = np.random.default_rng(3)
    panels = Panels(np.array([0.0, 0.7, 3.0]), np.array([5, 3]))
    level = rng.normal(size=4)
    curves = panels.curves(np.repeat(level[:, None], len(panels.nodes), axis=1))
    cuts = panels.cut(np.array([0.1, 0.2, 0.65, 0.7, 2.0, 3.0]))
    for found in (cuts.means(curves), cuts.ends(curves)):
        np.testing.assert_array_equal(found, np.repeat(level[:, None], 5, axis=1))


def test_a_thin_slice_costs_no_digits():
    """1e-9 of a panel: the mean of 5 + t^3 is its value in the middle."""
    panels = Panels(np.array([0.0, 1.0]), np.array([4]))
    curves = panels.curves(5 + panels.nodes[None] ** 3)
    edges = 0.8 + np.array([0.0, 1e-9])
    mean = panels.cut(edges).means(curves)[0, 0]
    # the antiderivative of what goes beyond 5, at most 0.5, rounds by 1e-16: over 1e-9 by 1e-7
    assert mean == pytest.approx(5.512, abs=2e-7)


def test_samples_are_the_same_in_any_company():
    """To the bit, wherever the samples are cut into blocks."""
    rng = np.random.default_rng(2)
    ends = np.append(0.0, np.cumsum(rng.uniform(0.1, 2.0, 40)))
    panels = Panels(ends, rng.integers(3, 13, 40))
    curves = panels.curves(rng.normal(size=(5, len(panels.nodes))))
    edges = np.sort(np.concatenate([rng.uniform(0, ends[-1], 200), ends[3:30:4]]))
    cuts = panels.cut(edges)
    means, values = cuts.means(curves), cuts.ends(curves)
    for first, last in ((0, 1), (1, 40), (40, 41), (41, 206), (100, 101)):
        some = panels.cut(edges[first : last + 1])
        np.testing.assert_array_equal(some.means(curves), means[:, first:last])
        np.testing.assert_array_equal(some.ends(curves), values[:, first:last])
