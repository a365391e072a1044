"""Bursts, lost samples, repeats and rounding: seen where they are, and nowhere else."""

import numpy as np
import pytest

from alignment.sampling import bursts, evened, repeats, sigma_below, step_of


def normal(n, seed=0, columns=3):
    return np.random.default_rng(seed).standard_normal((n, columns))


# Stamps ------------------------------------------------------------------------------------------


def handed_over(size, n=6000, dt=0.01, within=1e-4):
    """`size` samples at once, stamped when they arrive: with the last of them, 0.1 ms apart."""
    t = dt * np.arange(1, n + 1)
    return np.repeat(t[size - 1 :: size], size) + np.tile(within * np.arange(size), n // size)


@pytest.mark.parametrize("size", [2, 4, 10])
def test_bursts_are_counted_and_evened(size):
    t = handed_over(size)
    found = bursts(t)
    assert found is not None
    assert (found.count, found.size) == (6000 // size, pytest.approx(size))
    steps = np.diff(evened(t))
    np.testing.assert_allclose(steps, 0.01, rtol=1e-4)  # one burst's length over the record's


def test_bursts_of_changing_size():
    """A bus polled every 37 ms: three or four samples each time."""
    t = 0.01 * np.arange(1, 6001)
    polled = 0.037 * np.ceil(t / 0.037)
    arrival = polled + 1e-5 * (t - polled + 0.037) / 0.01
    found = bursts(arrival)
    assert found is not None
    assert found.size == pytest.approx(3.7, rel=0.01)
    assert np.diff(evened(arrival)).mean() == pytest.approx(0.01, rel=1e-4)


@pytest.mark.parametrize("case", ["even", "jitter", "lost", "gap", "rate", "pause"])
def test_other_stamps_are_no_bursts(case):
    t = 0.01 * np.arange(1, 6001)
    if case == "jitter":
        t = t + np.random.default_rng(1).uniform(-0.002, 0.002, len(t))
    if case == "lost":
        t = t[np.arange(len(t)) % 8 != 0]
    if case == "gap":
        t = t + 5.0 * (np.arange(len(t)) > 3000)
    if case == "rate":
        t = np.concatenate([t[:3000], t[2999] + 0.02 * np.arange(1, 3001)])
    if case == "pause":  # bursts, but samples were lost between them: even stamps would be wrong
        t = handed_over(4) + 3.0 * (np.arange(6000) > 3000)
    assert bursts(t) is None


# Repeats -----------------------------------------------------------------------------------------


def test_each_value_twice():
    values = np.repeat(normal(500), 2, axis=0)
    starts = repeats(values)
    assert starts is not None
    np.testing.assert_array_equal(values[starts], normal(500))


def test_two_or_three_times_by_turns():
    """Asked at 200 Hz, a unit of 80 Hz."""
    fresh = np.floor(np.arange(1000) * 80 / 200 + 1e-9).astype(int)
    starts = repeats(normal(400)[fresh])
    assert starts is not None
    assert len(starts) == 400


@pytest.mark.parametrize("sigma", [0.05, 0.2, 0.4, 1.0, 10.0])
def test_coarse_values_are_no_repeats(sigma):
    for seed in range(10):
        assert repeats(np.rint([0.3, -0.4, 0.1] + sigma * normal(5000, seed))) is None


def test_runs_that_follow_no_beat_are_no_repeats():
    """Rows of coarse values stand once or twice by chance, by a driver's rate every third twice."""
    by_chance = 1 + (np.random.default_rng(1).random(600) < 1 / 3)
    assert repeats(np.repeat(normal(600), by_chance, axis=0)) is None
    by_turns = 1 + (np.arange(600) % 3 == 0)
    assert repeats(np.repeat(normal(600), by_turns, axis=0)) is not None


def test_dead_and_new_values_are_no_repeats():
    assert repeats(np.zeros((1000, 3))) is None
    assert repeats(normal(1000)) is None
    one_alive = np.hstack([np.zeros((1000, 2)), normal(1000, columns=1)])
    assert repeats(one_alive) is None


# Rounding ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("sigma", [0.1, 0.5, 3.0])
@pytest.mark.parametrize("offset", [0.0, 9.81])
def test_the_step_of_rounded_values(sigma, offset):
    values = offset + 0.0625 * np.rint(sigma * normal(5000)[:, 0] - 0.4)
    assert step_of(values) == pytest.approx(0.0625, rel=1e-9)


def test_the_step_of_a_long_record_by_evenly_spaced_values():
    """Three times as many as are looked at, of which every second is negative."""
    sign = np.where(np.arange(800_000) % 2, -1.0, 1.0)
    values = 0.0625 * np.rint(sign * (8 + np.abs(normal(800_000)[:, 0])))
    assert step_of(values) == pytest.approx(0.0625, rel=1e-9)


def test_no_step_where_there_is_none():
    assert step_of(normal(5000)[:, 0]) == 0.0
    assert step_of(np.full(5000, 9.81)) == 0.0
    moved = np.where(np.arange(5000) < 2500, 0.1, 0.3)  # one change may be anything
    assert step_of(moved) == 0.0
    uneven = np.repeat([0.0, 1.0, 2.7, 3.1, 5.9], 1000)
    np.random.default_rng(0).shuffle(uneven)
    assert step_of(uneven) == 0.0


def test_numbers_of_32_bits_have_a_step_that_hardly_matters():
    values = (9.81 + 1e-3 * normal(5000)[:, 0]).astype("f4").astype(float)
    assert step_of(values) <= 2**-20  # of numbers from 8 to 16 with 24 bits


@pytest.mark.parametrize("sigma", [0.45, 0.5, 0.6, 0.8, 2.0])
def test_the_noise_before_rounding(sigma):
    """Wherever the mean is within a step: half a million samples, four standard errors."""
    n = 500_000
    noise = sigma * np.random.default_rng(3).standard_normal(n)
    for mean in (0.0, 0.25, 0.5, 0.8):
        variance = float(np.var(np.rint(mean + noise)))
        left, doubt = sigma_below(1.0, variance)
        chance = 4 * np.sqrt(2 / n) * variance
        # the bound is for the true sigma, and it is read at the one found
        assert left == pytest.approx(sigma**2, abs=1.2 * doubt + chance)


def test_rounding_leaves_nothing_below():
    left, doubt = sigma_below(1.0, 0.2)  # of a mean between two steps, whatever the noise
    assert doubt > 0.1 * left
    left, doubt = sigma_below(1.0, float(np.var(np.rint(0.5 + 0.05 * normal(1000)[:, 0]))))
    assert doubt > 0.1 * left
    assert sigma_below(0.0, 4.0) == (4.0, 0.0)
