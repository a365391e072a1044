"""Motion: derivatives are those of the angles, and nothing can be written to.

What is fitted, splined or summed is smooth at its knots and goes where it was told to.
"""

from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stand.motion import polynomial as module
from stand.motion.polynomial import (
    FIT_PER_PERIOD,
    SAME_KNOT,
    Motion,
    SplinePieces,
    b_spline,
    fitted,
    smoothed,
    splined,
    summed,
)
from stand.motion.sway import SEEN

# Two pieces of two joints: a cubic and a parabola, each its own, the second moves first.
KNOTS = [0.0, 2.0, 3.5]
COEFFICIENTS = np.array(
    [
        [[0.25, 0.0], [0.0, 0.0]],
        [[0.5, 0.0], [2.0, 0.0]],
        [[0.0, 1.5], [5.0, 0.0]],
        [[1.0, -3.0], [5.0, 0.0]],
    ]
)


def motion() -> Motion:
    return Motion(np.array(KNOTS), COEFFICIENTS)


def test_angles_rates_and_accelerations_by_hand():
    angle, rate, acceleration = motion().joints([1.0, 2.0, 3.0])
    # t = 1: 0.25 + 0.5 + 1; t = 2 begins the second piece; t = 3: 2 + 5 + 5
    np.testing.assert_array_equal(angle, [[1.75, -1.5], [5.0, 0.0], [12.0, 0.0]])
    np.testing.assert_array_equal(rate, [[1.75, 1.5], [5.0, 0.0], [9.0, 0.0]])
    np.testing.assert_array_equal(acceleration, [[2.5, 0.0], [4.0, 0.0], [4.0, 0.0]])


def test_derivatives_agree_with_differences_inside_pieces():
    h = 1e-4
    t = np.array([0.3, 1.0, 1.9, 2.4, 3.2])
    here, before, after = (motion().joints(t + d) for d in (0.0, -h, h))
    # Central differences: truncation h^2 jerk / 6 = 2.5e-9; rounding 1e-16 * 12 / h = 1e-11
    np.testing.assert_allclose((after[0] - before[0]) / (2 * h), here[1], rtol=0, atol=3e-9)
    np.testing.assert_allclose((after[1] - before[1]) / (2 * h), here[2], rtol=0, atol=3e-9)


def test_rest_is_per_piece():
    still = COEFFICIENTS.copy()
    still[:-1, 1] = 0.0
    assert motion().at_rest.tolist() == [False, False]
    assert Motion(np.array(KNOTS), still).at_rest.tolist() == [False, True]
    steady = still.copy()
    steady[-2, 1] = [0.0, 1e-5]  # one joint turns at a constant rate
    assert Motion(np.array(KNOTS), steady).at_rest.tolist() == [False, False]
    assert motion().duration == 3.5


def test_read_only_and_owned():
    knots, coefficients = np.array(KNOTS), COEFFICIENTS.copy()
    owner = Motion(knots, coefficients)
    knots[1], coefficients[3] = 9.0, 9.0
    assert owner.knots[1] == 2.0
    assert owner.joints([0.0])[0].tolist() == [[1.0, -3.0]]
    with pytest.raises(ValueError, match="read-only"):
        owner.knots[1] = 3.0
    with pytest.raises(ValueError, match="read-only"):
        owner.coefficients[0, 0, 0] = 3.0
    with pytest.raises(AttributeError):
        owner.knots = knots


@pytest.mark.parametrize("knots", [[0.0, 2.0, 2.0], [0.0, 3.0, 2.0], [0.0]])
def test_knots_increase(knots):
    coefficients = np.zeros((4, len(knots) - 1, 2))
    with pytest.raises(ValueError, match="knots: must increase"):
        Motion(np.array(knots), coefficients)


def test_coefficients_fit_the_knots_and_are_finite():
    with pytest.raises(ValueError, match="coefficients: shape"):
        Motion(np.array(KNOTS), np.zeros((4, 3, 2)))
    with pytest.raises(ValueError, match="coefficients: not finite"):
        Motion(np.array(KNOTS), np.full((4, 2, 2), np.nan))


def test_derivative_has_rates_for_angles():
    of_rate = motion().derivative()
    t = np.array([0.3, 1.0, 2.0, 3.2])
    _, rate, acceleration = motion().joints(t)
    np.testing.assert_allclose(of_rate.joints(t)[0], rate, rtol=1e-15)  # rounding
    np.testing.assert_allclose(of_rate.joints(t)[1], acceleration, rtol=1e-15)
    # third derivative by hand: 6 * 0.25 in the first piece, none in the second
    jerk = of_rate.joints(t)[2]
    np.testing.assert_array_equal(jerk, [[1.5, 0.0], [1.5, 0.0], [0.0, 0.0], [0.0, 0.0]])


def jumps(m: Motion, orders: int) -> list[float]:
    """By how much the motion and its derivatives jump at its inner knots, over their size."""
    found = []
    for _ in range(orders):
        lengths = np.diff(m.knots)[:, None]
        end, size = np.zeros(m.coefficients.shape[1:]), np.abs(m.coefficients[-1]).max()
        for row in m.coefficients:
            end = end * lengths + row
        found.append(float(np.abs(end[:-1] - m.coefficients[-1, 1:]).max() / size))
        m = m.derivative()
    return found


def two_sines(t):
    return np.stack([np.sin(3 * t + 0.4), 0.5 * np.cos(2 * t)], axis=1)


def test_a_fit_is_a_sine_to_a_billionth_of_its_acceleration():
    period = 2 * np.pi / 3
    knots = np.linspace(0, 5 * period, 5 * FIT_PER_PERIOD + 1)
    fit = fitted(two_sines, knots)
    t = np.linspace(0, knots[-1], 4001)
    angle, rate, acceleration = fit.joints(t)
    # interpolation error of degree 9 over pieces of 0.63 rad of phase: with x = 0.31 either side
    # of the middle x^10 / (2^9 10!) = 5e-15 of the angle, in each derivative a factor of
    # 81 / x = 260 and (80 / 3) / x = 85 more: 1.3e-12 of the rate's size, 1.1e-10 of acceleration
    np.testing.assert_allclose(angle, two_sines(t), rtol=0, atol=3e-14)
    assert np.abs(rate[:, 0] - 3 * np.cos(3 * t + 0.4)).max() < 2e-12 * 3
    assert np.abs(acceleration[:, 0] + 9 * np.sin(3 * t + 0.4)).max() < 2e-10 * 9
    assert np.abs(acceleration[:, 1] + 2 * np.cos(2 * t)).max() < 2e-10 * 2
    assert all(np.array(jumps(fit, 3)) < [1e-14, 4e-12, 4e-10])


def test_a_fit_is_exact_for_polynomials_of_its_degree_on_uneven_knots():
    rng = np.random.default_rng(5)
    powers = rng.normal(size=(10, 2))  # highest first
    knots = np.array([0.0, 0.3, 0.35, 1.0])
    fit = fitted(lambda t: np.stack([np.polyval(c, t) for c in powers.T], axis=1), knots)
    t = np.linspace(0, 1, 101)
    for i, c in enumerate(powers.T):
        # rounding 1e-16 of what a cubic leaves, times the matrix to powers (1e6 per row)
        angle, rate, _ = fit.joints(t)
        np.testing.assert_allclose(angle[:, i], np.polyval(c, t), rtol=0, atol=1e-10)
        np.testing.assert_allclose(rate[:, i], np.polyval(np.polyder(c), t), rtol=0, atol=1e-8)


def test_fits_splines_and_sums_do_not_depend_on_their_blocks(monkeypatch):
    knots = np.linspace(0, 7, 24)
    weights = np.random.default_rng(2).normal(size=(28, 2))

    def made():
        both = fitted(two_sines, knots), b_spline(weights, 0.3, 1.0)
        return *both, summed(both)

    whole = made()
    monkeypatch.setattr(module, "BLOCK", 5)
    parts = made()
    for one, other in zip(whole, parts, strict=True):
        np.testing.assert_array_equal(one.knots, other.knots)
        # the same sums, perhaps in another order: rounding of the largest
        np.testing.assert_allclose(
            one.coefficients,
            other.coefficients,
            rtol=0,
            atol=1e-14 * np.abs(one.coefficients).max(),
        )


def test_b_splines_add_up_to_one_and_to_straight_lines():
    step, k = 0.25, 9
    weights = np.ones((k + 5, 2))
    weights[:, 1] = 4 * step * np.arange(-2, k + 3)
    line = b_spline(weights, step, start=3.0, level=[0.0, 7.0])
    t = np.linspace(3.0, 3.0 + k * step, 57)
    angle, rate, acceleration = line.joints(t)
    # rounding of six terms of up to 66/120, divided by the step once and twice
    np.testing.assert_allclose(angle, np.stack([np.ones(57), 7 + 4 * (t - 3)], 1), atol=1e-14 * 10)
    np.testing.assert_allclose(rate, np.tile([0.0, 4.0], (57, 1)), atol=1e-13)
    np.testing.assert_allclose(acceleration, 0, atol=1e-11)


@pytest.mark.parametrize("times", [[0.0], [0.3, 2.9], np.linspace(-1, 4, 101)])
def test_joints_that_stand_still_are_told_to_the_bit(times):
    """Of the middle one the angle differs by rounding from piece to piece: it is not at rest."""
    c = np.zeros((4, 3, 3))
    c[:, :, 0] = np.random.default_rng(1).normal(size=(4, 3))
    c[-1, :, 1] = 0.1, np.nextafter(0.1, 1), 0.1
    c[-1, :, 2] = -0.7
    m = Motion(np.array([0.0, 1.0, 2.0, 3.0]), c)
    rows = []
    for t in np.clip(times, 0, 3):
        piece = min(int(t), 2)
        angle, rate, half = c[0, piece], np.zeros(3), np.zeros(3)
        for term in c[1:, piece]:
            half = half * (t - piece) + rate
            rate = rate * (t - piece) + angle
            angle = angle * (t - piece) + term
        rows.append([angle, rate, 2 * half])
    by_hand = np.array(rows).swapaxes(0, 1)
    np.testing.assert_array_equal(m.joints(times), by_hand)
    np.testing.assert_array_equal(m.angles_and_rates(times), by_hand[:2])


def test_one_b_spline_has_its_known_values():
    weights = np.zeros((15, 1))
    weights[7] = 1.0  # the one about 5 steps from the start
    angle, rate, _ = b_spline(weights, 0.5).joints([0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 4.5])
    # the quintic B-spline at whole steps from its middle: 66, 26, 1, 0 of 120 [de Boor 1978]
    expected = np.array([0, 0, 1, 26, 66, 26, 0, 0]) / 120
    np.testing.assert_allclose(angle[:, 0], expected, atol=1e-15)
    # its slope there, per step: 0, -1/2 + 1/12 = -50/120, -5/120, 0
    np.testing.assert_allclose(rate[:, 0], np.array([0, 0, 5, 50, 0, -50, 0, 0]) / 60, atol=1e-14)


def test_one_b_spline_of_degree_seven_has_its_known_values():
    weights = np.zeros((17, 1))
    weights[8] = 1.0  # the one about 5 steps from the start
    motion = b_spline(weights, 0.5, degree=7)
    angle, rate, bend = motion.joints([0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 4.5])
    # at whole steps from its middle: 2416, 1191, 120, 1, 0 of 5040 [de Boor 1978]
    expected = np.array([0, 1, 120, 1191, 2416, 1191, 1, 0]) / 5040
    np.testing.assert_allclose(angle[:, 0], expected, atol=1e-15)
    # its bend per step are second differences of the quintic's 66, 26, 1: 26 - 2 66 + 26 = -80,
    # 66 - 2 26 + 1 = 15, 26 - 2 = 24, 1 of 120
    bends = np.array([0, 1, 24, 15, -80, 15, 1, 0]) / 120
    np.testing.assert_allclose(bend[:, 0], 4 * bends, atol=1e-12)
    assert max(jumps(motion, 7)) < 1e-11
    assert rate[4, 0] == pytest.approx(0.0, abs=1e-14)


def test_one_b_spline_of_degree_eleven_has_its_known_values():
    weights = np.zeros((23, 1))
    weights[11] = 1.0  # the one about 6 steps from the start
    motion = b_spline(weights, 0.5, degree=11)
    angle, rate, _ = motion.joints(np.arange(13) / 2)
    # at whole steps from its middle Euler's numbers over 11!:
    # A(n, k) = (k + 1) A(n - 1, k) + (n - k) A(n - 1, k - 1)
    euler = [1]
    for n in range(2, 12):
        euler = [
            (k + 1) * (euler[k] if k < n - 1 else 0) + (n - k) * (euler[k - 1] if k else 0)
            for k in range(n)
        ]
    expected = np.array([0, *euler, 0]) / 39_916_800
    assert euler[:6] == list(reversed(SEEN))
    np.testing.assert_allclose(angle[:, 0], expected, rtol=0, atol=1e-15)
    assert rate[6, 0] == pytest.approx(0.0, abs=1e-14)
    assert max(jumps(motion, 11)) < 1e-10


def bump(n: int, seed: int = 1) -> np.ndarray:
    """Samples (n, 2) that rest for eight rows at both ends, at different angles."""
    samples = np.random.default_rng(seed).normal(size=(n, 2))
    samples[:8], samples[-8:] = samples[0], samples[-1]
    return samples


@given(st.integers(17, 60), st.integers(0, 1000), st.floats(1e-3, 10), st.floats(-5, 5))
def test_a_spline_goes_through_its_samples_four_times_smooth(n, seed, step, start):
    samples = bump(n, seed)
    spline = splined(samples, step, start)
    assert spline.start == start
    # rounding of the banded solution, condition 7.5
    np.testing.assert_allclose(spline.joints(spline.knots)[0], samples, rtol=0, atol=1e-13)
    # rounding 1e-16 of coefficients that B-splines' fifth differences make 1e3 as large
    assert max(jumps(spline, 5)) < 1e-11


def test_a_spline_of_samples_at_rest_rests():
    samples = bump(200)
    samples[:60], samples[-60:] = samples[0], samples[-1]
    _, rate, acceleration = splined(samples, 0.1, 2.0).joints([2.0, 2.0 + 0.1 * 199])
    # what moves is 60 steps away: 0.43^60 = 1e-22; the end's angle of 1 rounds by 1e-16, which
    # the fifth differences of B-splines and division by 0.1 and 0.01 make 1e-14 and 1e-12
    assert np.abs(rate).max() < 1e-13
    assert np.abs(acceleration).max() < 1e-11


def test_a_spline_is_sixth_order():
    def error(n):
        t = np.linspace(0, 1, n)
        x = 0.5 * (1 - np.cos(2 * np.pi * t)) * (np.abs(t - 0.5) < 0.5)
        x = x**4  # at rest at both ends
        fine = np.linspace(0, 1, 1001)
        exact = (0.5 * (1 - np.cos(2 * np.pi * fine))) ** 4
        got = splined(np.stack([x, x], axis=1), t[1]).joints(fine)[0][:, 0]
        return np.abs(got - exact).max()

    # halving the step leaves 2^-6 of the error
    assert 5.5 < np.log2(error(41) / error(81)) < 6.5


def test_splines_forget_beyond_48_samples():
    samples = bump(150)
    other = samples.copy()
    other[:60] += np.random.default_rng(9).normal(size=(60, 2))
    a, b = (splined(x, 0.01).coefficients[:, 110:] for x in (samples, other))
    # what differs is 50 samples away: 0.43^50 = 5e-19, below rounding
    np.testing.assert_allclose(a, b, rtol=0, atol=1e-13 * np.abs(a).max())


@st.composite
def motions(draw):
    """One to four motions of two joints, of different degrees, times and smoothness."""
    found = []
    for _ in range(draw(st.integers(1, 4))):
        degree, k = draw(st.integers(1, 6)), draw(st.integers(1, 5))
        lengths = draw(st.lists(st.floats(0.01, 3.0), min_size=k, max_size=k))
        start = draw(st.floats(-3, 3))
        rng = np.random.default_rng(draw(st.integers(0, 10**6)))
        found.append(_continuous(start + np.cumsum([0.0, *lengths]), degree, rng))
    return found


def _continuous(knots, degree, rng) -> Motion:
    """Random polynomials, joined without jumps of the angle."""
    c = rng.normal(size=(degree + 1, len(knots) - 1, 2))
    for k in range(len(knots) - 2):
        h = knots[k + 1] - knots[k]
        c[-1, k + 1] = sum(c[degree - p, k] * h**p for p in range(degree + 1))
    return Motion(knots, c)


@given(motions(), st.integers(0, 1000))
def test_a_sum_is_the_sum_at_all_times(several, seed):
    total = summed(several)
    begin = min(m.start for m in several)
    end = max(m.duration for m in several)
    t = np.random.default_rng(seed).uniform(begin - 1, end + 1, size=200)
    every = np.concatenate([m.knots for m in several])
    t = t[np.abs(t[:, None] - every).min(axis=1) > 10 * SAME_KNOT]
    expected = sum(m.joints(t)[0] for m in several)
    size = 1 + sum(np.abs(m.joints(m.knots)[0]).max() for m in several)
    # rounding; a knot moved by 1e-9 s moves the joint by that times a rate
    np.testing.assert_allclose(total.joints(t)[0], expected, rtol=0, atol=1e-6 * size)
    inside = t[(t > begin) & (t < end)]
    held = [
        np.where(((inside > m.start) & (inside < m.duration))[:, None], m.joints(inside)[1], 0)
        for m in several
    ]
    scale = 1 + sum(np.abs(h).max(initial=0) for h in held)
    np.testing.assert_allclose(total.joints(inside)[1], sum(held), rtol=0, atol=1e-6 * scale)


def test_a_sum_by_hand():
    first = Motion([0.0, 2.0], np.array([[[1.0, 0.0]], [[0.0, 5.0]]]))  # t, 5; then 2, 5
    second = Motion([1.0, 3.0], np.array([[[0.5, 0.0]], [[2.0, 0.0]], [[0.0, 1.0]]]))
    total = summed([first, second])
    assert total.knots.tolist() == [0.0, 1.0, 2.0, 3.0]
    angle, rate, acceleration = total.joints([0.5, 1.5, 2.5])
    # second: 0.5 s^2 + 2 s, s = t - 1, and 1: s = 0.5 -> 1.125; s = 1.5 -> 4.125
    np.testing.assert_allclose(angle, [[0.5, 6.0], [1.5 + 1.125, 6.0], [2 + 4.125, 6.0]])
    np.testing.assert_allclose(rate, [[1.0, 0.0], [1 + 2.5, 0.0], [3.5, 0.0]])
    np.testing.assert_allclose(acceleration, [[0.0, 0.0], [1.0, 0.0], [1.0, 0.0]])
    assert summed([first]) is first


def test_knots_that_only_rounding_parts_are_one():
    tail = np.array([[[0.0, 0.0], [0.0, 0.0]], [[1.0, 2.0], [1.0, 2.0]]])
    first = Motion([0.0, 1.0, 2.0], tail)
    second = Motion([0.0, 1.0 + 3e-16 * 2, 2.0 + 1e-12], tail)
    total = summed([first, second])
    assert len(total.knots) == 3
    np.testing.assert_array_equal(total.joints([0.5, 1.5])[0], [[2.0, 4.0], [2.0, 4.0]])


@dataclass
class Given:
    """Pieces whose coefficients (6, n + 1, joints) are known, the last tells where they end."""

    every: np.ndarray

    @property
    def count(self) -> int:
        return self.every.shape[1] - 1

    def coefficients(self, numbers, first=0):
        return self.every[first:, numbers]

    def accelerations(self):
        return 2 * self.every[3]


@pytest.mark.parametrize("margin", [12, 48])
def test_pieces_of_a_spline_are_those_of_the_whole(margin):
    """To 0.43^margin: its ends are where equations whose factors have not settled yet tell apart.

    A power p of time is known to that part, or to rounding, of angle/step^p.
    """
    samples = np.random.default_rng(5).normal(size=(60 + 1 + 2 * margin, 3)).cumsum(axis=0)
    whole = splined(samples, 1e-3).coefficients[:, margin : margin + 61]
    pieces = SplinePieces(samples, 1e-3, margin)
    assert pieces.count == 60
    known = np.abs(samples).max() * max(0.43**margin, 1e-15) * 1e3 ** np.arange(5, -1, -1)
    tolerance = 10 * known[:, None, None]
    assert np.all(np.abs(pieces.coefficients(np.arange(61)) - whole) <= tolerance)
    assert np.all(np.abs(pieces.accelerations() - 2 * whole[3]) <= 2 * tolerance[3])
    some = np.array([0, 41, 60])
    np.testing.assert_array_equal(
        pieces.coefficients(some, 3), pieces.coefficients(np.arange(61))[3:, some]
    )


def test_pieces_of_one_quintic_are_joined():
    """Sixty of t^5/120, each about its own beginning, are three of twenty."""
    h = 0.01
    t = h * np.arange(61)
    powers = [t**0 / 120, t / 24, t**2 / 12, t**3 / 12, t**4 / 24, t**5 / 120]
    made, begins = smoothed(Given(np.array(powers)[:, :, None]), h, 1e-9)
    np.testing.assert_array_equal(begins, [0, 20, 40])
    # angles below 1e-3 round by 1e-19, over 0.2 s to the fifth by 1e-15
    for power, row in zip(powers, made[:, :, 0], strict=True):
        np.testing.assert_allclose(row, power[[0, 20, 40]], rtol=1e-12, atol=1e-14)


def test_a_kick_stays_where_it_was():
    """An acceleration that is 1e-3 rad/s^2 off at one step keeps its five pieces apart, those about
    it in twenty are joined by five, and all others by twenty."""
    h = 1e-3
    spline = np.zeros((6, 81, 1))
    spline[4] = 0.1  # a turn at constant rate
    spline[5, :, 0] = 0.1 * h * np.arange(81)
    spline[3, 47] = 1e-3 / 2
    made, begins = smoothed(Given(spline), h, 1e-7)
    assert list(begins) == [0, 20, 40, 45, 46, 47, 48, 49, 50, 55, 60]
    np.testing.assert_array_equal(made[:, 3:8], spline[:, 45:50])
    _, all_joined = smoothed(Given(spline), h, 2e-3)
    assert list(all_joined) == [0, 20, 40, 60]
