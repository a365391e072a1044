"""Motion: derivatives are those of the angles, and nothing can be written to."""

import numpy as np
import pytest

from stand.motion import Motion

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


@pytest.mark.parametrize("knots", [[0.0, 2.0, 2.0], [0.0, 3.0, 2.0], [1.0, 2.0, 3.0], [0.0]])
def test_knots_increase_from_zero(knots):
    coefficients = np.zeros((4, len(knots) - 1, 2))
    with pytest.raises(ValueError, match="knots: must increase from 0"):
        Motion(np.array(knots), coefficients)


def test_coefficients_fit_the_knots_and_are_finite():
    with pytest.raises(ValueError, match="coefficients: shape"):
        Motion(np.array(KNOTS), np.zeros((4, 3, 2)))
    with pytest.raises(ValueError, match="coefficients: not finite"):
        Motion(np.array(KNOTS), np.full((4, 2, 2), np.nan))
