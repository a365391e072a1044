"""Headings whose errors are not small: closed forms of the circle."""

from math import pi, radians, sqrt

import numpy as np
import pytest

from alignment.around import (
    by_direction,
    by_length,
    by_level_rate,
    by_one_gyro,
    by_size,
    less_turned,
    whole_circle,
    with_level_rate,
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


LEVER = 2e-3  # rad of tilt E per rad of heading
MIDDLE = 1e-6  # rad^2: of the tilt in the middle of a record


def by_accelerometers(sigma):
    """Tilts N, E, heading and size of the level rate: the tilt to the end goes with heading."""
    J = np.array([[0, 0], [LEVER, 0], [1, 0], [0, 1]]) * sigma
    return J @ J.T + MIDDLE * np.diag([1.0, 1, 0, 0])


def by_gyros(sigma):
    """What gyros make of the level rate they did carry: what it is larger by tilts about north."""
    J = np.array([[0, -LEVER], [0, 0], [1, 0], [0, 1]]) * sigma
    return J @ J.T + MIDDLE * np.diag([1.0, 1, 0, 0])


def test_tilts_beside_a_heading_that_is_known_are_first_order():
    P = by_accelerometers(0.05)
    assert np.array_equal(with_level_rate(P[:3, :3], P, np.array([0.0, LEVER])), P[:3, :3])


@pytest.mark.parametrize("found", [True, False])
def test_tilts_all_round_the_circle(found):
    """Mean squares of ``1 - cos h`` and ``sin h``, 3/2 and 1/2 of any h, and the middle's."""
    P = by_accelerometers(30.0)
    if found:
        own = with_level_rate(P[:3, :3], P, np.array([0.0, LEVER]))
        squares = own.diagonal()
        correlations = own / np.sqrt(np.outer(squares, squares))
        # odd in the heading: tilt N's 1 - cos h goes with none, E's sin h with it: sqrt(6)/pi of it
        assert correlations[0, 1:] == pytest.approx([0, 0], abs=0.08)  # the grid, as below
        share = np.sqrt(0.5) * LEVER / np.sqrt(MIDDLE + 0.5 * LEVER**2)
        assert correlations[1, 2] == pytest.approx(share * np.sqrt(6) / pi, abs=0.05)
    else:
        less, more = by_level_rate(P[:3, :3], P, np.array([0.0, LEVER]))
        squares = (less @ P[:3, :3] @ less.T + more).diagonal()
    # rows of the grid along both axes hold 5 % of the weight each
    assert squares[0] == pytest.approx(MIDDLE + 1.5 * LEVER**2, rel=0.08)
    assert squares[1] == pytest.approx(MIDDLE + 0.5 * LEVER**2, rel=0.08)
    assert squares[2] == pytest.approx(P[2, 2], rel=1e-12)


@pytest.mark.parametrize("sigma", [0.2, 1.0, 5.0])
def test_tilts_by_gyros_lie_along_the_north_that_is_found(sigma):
    """What is left of the length of the level rate, none of it across."""
    P = by_gyros(sigma)
    own = with_level_rate(P[:3, :3], P, np.array([0.0, LEVER]))
    length = by_length(sigma) * sigma**2
    assert own[0, 0] == pytest.approx(MIDDLE + length * LEVER**2, rel=1e-6)
    assert own[1, 1] == pytest.approx(MIDDLE, rel=1e-6)


def test_tilts_that_go_together_still_do_all_round_the_circle():
    """A scale error of gyros many times as large as the level rate, 40 deg off across: it tilts
    along one line, of which the turn takes little: half a million draws."""
    way = 8.0 * np.exp(1j * radians(50))
    J = np.array([-LEVER * way.real, 0.0, way.imag, way.real])
    P = np.outer(J, J) + MIDDLE * np.diag([1.0, 1, 0, 0])
    less, more = by_level_rate(P[:3, :3], P, np.array([0.0, LEVER]))
    g = way * np.random.default_rng(5).standard_normal(500_000)
    left = -LEVER * (1 + g - (1 + g) / abs(1 + g))
    tilts = np.stack([left.real, left.imag])
    want = tilts @ tilts.T / g.size + MIDDLE * np.eye(2)
    got = (less @ P[:3, :3] @ less.T + more)[:2, :2]
    np.testing.assert_allclose(got, want, atol=0.03 * np.trace(want))


def test_tilts_by_both_are_those_of_draws():
    """Gyros and accelerometers alike, about the true north: half a million draws."""
    s = 0.7
    P = by_gyros(s) + by_accelerometers(s)
    less, more = by_level_rate(P[:3, :3], P, np.array([0.0, LEVER]))
    gyro, accel = np.random.default_rng(4).standard_normal((2, 500_000, 2)) @ [1, 1j] * s
    found = 1 + gyro + accel
    left = (1 + gyro - found / abs(found)) * LEVER
    squares = (less @ P[:3, :3] @ less.T + more).diagonal()
    # two middles; draws are known to 0.3 %
    assert squares[0] == pytest.approx(2 * MIDDLE + np.mean(left.real**2), rel=0.01)
    assert squares[1] == pytest.approx(2 * MIDDLE + np.mean(left.imag**2), rel=0.01)


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
