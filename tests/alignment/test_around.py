"""Headings whose errors are not small: closed forms of the circle."""

from math import pi, radians, sqrt

import numpy as np
import pytest

from alignment.around import (
    by_direction,
    by_length,
    by_one_gyro,
    by_size,
    less_turned,
    whole_circle,
)


def test_small_errors_are_first_order():
    assert by_direction(np.array([[1e-4, 0.0], [0.0, 4e-4]])) == pytest.approx(0.02)
    assert by_one_gyro(radians(30), np.diag([1e-6, 1e-6])) == pytest.approx(1e-3 / 0.5)


@pytest.mark.parametrize(("degrees", "ratio"), [(8, 1.010), (20, 1.102), (25.4, 1.179)])
def test_direction_of_two_errors_that_are_alike(degrees, ratio):
    """Draws: of half a million, whose root mean square is known to a thousandth."""
    s = radians(degrees)
    a, b = np.random.default_rng(1).standard_normal((2, 500_000)) * s
    drawn = sqrt(np.mean(np.arctan2(b, 1 + a) ** 2))
    assert by_direction(s**2 * np.eye(2)) == pytest.approx(drawn, rel=5e-3)
    assert drawn / s == pytest.approx(ratio, rel=5e-3)


def test_direction_that_turns_round_half_the_time():
    """An error along the rate of ten times itself: 46 of 100 are reversed, Q(0.1) of a normal."""
    assert by_direction(np.diag([100.0, 1e-6])) == pytest.approx(sqrt(0.4602) * pi, rel=0.03)


def test_length_of_an_error_that_is_all():
    """``E (|s z| - 1)^2 / s^2`` of two normals: ``2 - 2 sqrt(pi/2)/s + 1/s^2`` where s is large."""
    assert by_length(0.05) == 1.0
    s = 50.0
    assert by_length(s) == pytest.approx(2 - 2 * sqrt(pi / 2) / s + 1 / s**2, rel=0.005)


@pytest.mark.parametrize("azimuth", [90.0, -60.0])
def test_one_gyros_azimuth_and_its_side(azimuth):
    """Draws of cosine and side, those beyond one left out."""
    s, az = 0.4, radians(azimuth)
    a, b = np.random.default_rng(2).standard_normal((2, 500_000)) * s
    cosine = np.cos(az) + a
    told = np.abs(cosine) <= 1
    found = np.copysign(np.arccos(cosine[told]), np.sin(az) + b[told])
    off = (found - az + pi) % (2 * pi) - pi
    got = by_one_gyro(az, s**2 * np.eye(2))
    # the cells of a grid that the edge of what is refused cuts
    assert got == pytest.approx(sqrt(np.mean(off**2)), rel=0.03)


def test_a_covariance_grows_with_its_correlations_and_never_shrinks():
    P = np.array([[4.0, 0.0, 1.0], [0.0, 9.0, 0.0], [1.0, 0.0, 1.0]]) * 1e-2
    grown = whole_circle(P, 0.2)  # twice its tenth
    np.testing.assert_allclose(grown, P * np.outer([1, 1, 2], [1, 1, 2]))
    np.testing.assert_allclose(whole_circle(P, 0.05), P)


def test_a_part_that_is_hidden_leaves_two_directions():
    """Across 0 +- 0.01, along hidden: 0 or 180 deg alike, a mean 0.008 off. Both known: 0.01."""
    assert by_size(np.array([1.0, 0.0]), np.diag([100.0**2, 0.01**2]), 0.0) == pytest.approx(
        (np.pi - 0.008) / np.sqrt(2), rel=1e-3
    )
    known = by_size(np.array([1.0, 0.0]), np.diag([0.3**2, 0.01**2]), 0.0)
    assert known == pytest.approx(0.01, rel=1e-2)


def test_nothing_of_the_earths_rate_leaves_the_whole_circle():
    """pi/sqrt 3 is the deviation of what may point anywhere; of half, twice the sigma."""
    P = np.diag([1.0, 1.0, 1e-6])
    assert sqrt((P * less_turned(P, 0.0))[2, 2]) == pytest.approx(pi / sqrt(3), rel=1e-12)
    assert sqrt((P * less_turned(P, 0.5))[2, 2]) == pytest.approx(2e-3, rel=1e-5)
