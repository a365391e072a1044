"""The place out of the velocity: against what can be integrated by hand."""

import numpy as np
import pytest

from stand.errors import StandError
from stand.vehicle.place import integrated


def only_velocity(t, x, v):
    return v


def test_a_polynomial_and_a_swing():
    """t^7/1e3, 8 sin(4 t) and a rest, over an hour of knots that are nowhere near even: to the
    rounding of a millionth of a million metres."""
    knots = np.array([0.0, 0.3, 1.7, 2.0, 9.9])

    def velocity(t):
        return np.stack([t**7 / 1e6, 8 * np.sin(4 * t), 0 * t], axis=1)

    place = integrated(velocity, only_velocity, knots)
    t = np.linspace(0, 9.9, 1234)
    expected = np.stack([t**8 / 8e6, 2 * (1 - np.cos(4 * t)), 0 * t], axis=1)
    # a node's way is rounded to 1e-16 of it, and cut where a piece misses 1e-11
    np.testing.assert_allclose(place(t), expected, rtol=1e-14, atol=2e-10)


def test_rates_that_follow_the_place():
    """x' = 1 - x/20 and y' = x: x = 20 (1 - exp(-t/20)), y = 20 t - 20 x."""

    def rates(t, x, v):
        return np.stack([v[:, 0] - x[:, 0] / 20, x[:, 0], 0 * t], axis=1)

    def velocity(t):
        return np.stack([1 + 0 * t, 0 * t, 0 * t], axis=1)

    t = np.linspace(0, 300, 4001)
    x, y, _ = integrated(velocity, rates, np.array([0.0, 111.0, 300.0]))(t).T
    np.testing.assert_allclose(x, -20 * np.expm1(-t / 20), atol=1e-10)
    # rounds end at 1e-10 m, the next would be smaller by ten: of 600 s some 20 groups
    np.testing.assert_allclose(y, 20 * t + 400 * np.expm1(-t / 20), atol=1e-8)


def test_what_does_not_settle_is_refused():
    def runaway(t, x, v):
        return v + np.tan(50 * x)

    with pytest.raises(StandError, match=r"path: no place found after 0\.000 s"):
        integrated(lambda t: np.ones((len(t), 3)), runaway, np.array([0.0, 30.0]))
