"""Readings: owned, ordered, and never a sample that mixes in what lay outside."""

import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from alignment.errors import TooShort
from alignment.readings import Dwell, ImuReadings, over_steps

FIXED = settings(derandomize=True, deadline=None, max_examples=200, phases=[Phase.generate])
EDGE = 1.01e-6  # s: stamps are rounded to 1 ns, a stamp within 1 us of an edge is on it


def numbered(t):
    """Readings whose rows tell which sample they are."""
    n = len(t)
    w = np.arange(3.0 * n).reshape(n, 3)
    return ImuReadings(np.asarray(t, dtype=float), w, -w[:, ::-1])


def test_readings_own_their_arrays():
    t, w, f = np.array([0.0, 1.0]), np.array([[1.0, 2, 3], [4, 5, 6]]), np.ones((2, 3))
    readings = ImuReadings(t, w, f)
    t[:], w[:], f[:] = 9, 9, 9
    np.testing.assert_array_equal(readings.t, [0, 1])
    np.testing.assert_array_equal(readings.w_ib_b, [[1, 2, 3], [4, 5, 6]])
    np.testing.assert_array_equal(readings.f_b, np.ones((2, 3)))
    for array in (readings.t, readings.w_ib_b, readings.f_b):
        assert not array.flags.writeable


@pytest.mark.parametrize(
    ("t", "rows", "message"),
    [
        ([0.0, 1.0, 1.0], 3, "t: sample 2 at 1.000000000 s does not come after 1.000000000 s"),
        ([0.0, 2.0, 1.0], 3, "t: sample 2 at 1.000000000 s does not come after 2.000000000 s"),
        ([0.0, 1.0, np.nan], 3, "t: not finite at index (2,)"),
        ([0.0, 1.0, 2.0], 2, "w_ib_b: shape (2, 3), must be (3, 3)"),
    ],
)
def test_bad_readings_are_refused(t, rows, message):
    values = np.arange(3.0 * rows).reshape(rows, 3)
    with pytest.raises(ValueError) as caught:
        ImuReadings(np.array(t), values, values)
    assert str(caught.value) == message


def test_interval_is_the_mean_of_the_stamps_differences():
    assert numbered([0.0, 0.4, 1.0, 1.9, 2.0]).interval == 0.5
    with pytest.raises(TooShort, match="1 samples: at least 2 are needed"):
        _ = numbered([3.0]).interval


def test_what_instants_leave_of_the_last_step_by_hand():
    """Of ``t^3`` the third difference is 6: the mean over the last step misses a quarter, for what
    stands beyond the end is a parabola; 11/720 of 6 are for what is no cubic."""
    t = np.arange(1.0, 8.0)
    x = np.stack([t**3, t**2, np.full(7, 3.0)], axis=1)
    of_instants = ImuReadings(t, x, x, instants=True)
    np.testing.assert_allclose(of_instants.untold(), [0.25 + 66 / 720, 0, 0], atol=1e-12)
    missed = of_instants.means(slice(6, 7))[0][0, 0] - (7.0**4 - 6.0**4) / 4
    assert missed == pytest.approx(0.25)
    assert not ImuReadings(t, x, x).untold().any()
    assert not of_instants.between(4.0, 7.0).untold().any()  # three: no third difference


def test_means_of_instants_by_hand():
    """Of ``t^2`` at 1, 2, 3, ... ``t^2 - t + 1/3``; one alone is in four, by -1, 13, 13, -1 of 24;
    two samples, and means, are left as they are."""
    t = np.arange(1.0, 8.0)
    x = np.stack([t**2, np.full(7, 3.0), t == 4], axis=1)
    means = over_steps(x, slice(0, 7))
    np.testing.assert_allclose(means[:, 0], t**2 - t + 1 / 3, rtol=0, atol=1e-13)
    np.testing.assert_array_equal(means[:, 1], 3.0)
    np.testing.assert_allclose(means[:, 2] * 24, [0, 0, -1, 13, 13, -1, 0], rtol=0, atol=1e-14)
    for a in range(7):
        for b in range(a + 1, 8):
            np.testing.assert_array_equal(over_steps(x, slice(a, b)), means[a:b])
    np.testing.assert_array_equal(over_steps(x[:2], slice(0, 2))[:, 0], [1.0, 4.0])
    plain = ImuReadings(t, x, x)
    assert all((part == x[2:5]).all() for part in plain.means(slice(2, 5)))
    of_instants = ImuReadings(t, x, 2 * x, instants=True).between(2.0, 6.0).means(slice(0, 4))
    assert all(len(part) == 4 for part in of_instants)
    np.testing.assert_array_equal(of_instants[1], 2 * of_instants[0])


@pytest.mark.parametrize("step", [0.05, 0.2])
def test_means_of_instants_of_a_wave(step):
    """``sin(u)/u exp(-i u)`` of it, u half the step: within 11 u'^4/720, u' the whole; the first
    mean within 3 u'^3/8."""
    k = np.arange(200)
    wave = np.exp(1j * step * k)
    x = np.stack([wave.real, wave.imag, wave.real], axis=1)
    means = over_steps(x, slice(0, 200))
    u = step / 2
    gain = (means[:, 0] + 1j * means[:, 1]) / (wave * np.exp(-1j * u) * np.sin(u) / u) - 1
    # a tenth more for the next order
    assert 0.9 < np.abs(gain[2:-1]).max() / (11 * step**4 / 720) < 1.1
    assert 0.7 < abs(gain[0]) / (3 * step**3 / 8) < 1.1


def test_between_by_hand():
    readings = numbered(np.arange(1, 11) / 10)  # intervals (0, 0.1], (0.1, 0.2], ...
    part = readings.between(0.2, 0.5)
    np.testing.assert_allclose(part.t, [0.3, 0.4, 0.5], rtol=0, atol=1e-16)
    np.testing.assert_array_equal(part.w_ib_b, np.arange(6.0, 15.0).reshape(3, 3))
    np.testing.assert_array_equal(part.f_b, -np.arange(6.0, 15.0).reshape(3, 3)[:, ::-1])
    np.testing.assert_allclose(readings.between(0.21, 0.49).t, [0.4], rtol=0, atol=1e-16)
    assert len(readings.between(0.21, 0.35)) == 0
    assert len(readings.between(0.0, 1.0)) == 10
    assert len(readings.between(-5.0, 5.0)) == 10
    assert len(readings.between(0.5, 0.2)) == 0


rates = st.sampled_from([10.0, 64.0, 100.0, 200.0, 1000.0])


@FIXED
@given(rates, st.integers(2, 400), st.floats(0, 1e5), st.floats(-1, 3), st.floats(-1, 3))
def test_no_sample_of_an_even_log_sticks_out(rate, n, start, t_from, t_to):
    t = start + np.arange(n) / rate
    part = numbered(t).between(start + t_from, start + t_to)
    # Stamps near 1e5 s round at 1.5e-11 s.
    assert np.all(part.t - 1 / rate >= start + t_from - EDGE - 1e-10)
    assert np.all(part.t <= start + t_to + EDGE)
    inside = (t - 1 / rate >= start + t_from + EDGE) & (t <= start + t_to - EDGE)
    assert len(part) >= inside.sum()  # and none that fits is left out


def test_between_adjoining_windows_neither_lose_nor_share_a_sample():
    readings = numbered(np.round(np.arange(1, 4001) / 200, 9))
    a, b = readings.between(0.0, 10.0), readings.between(10.0, 20.0)
    np.testing.assert_array_equal(np.concatenate([a.t, b.t]), readings.t)
    np.testing.assert_array_equal(np.concatenate([a.w_ib_b, b.w_ib_b]), readings.w_ib_b)


def test_a_sample_after_a_gap_is_left_out():
    # The sample at 5 s is the mean from 2 s on, so it does not belong to [3, 7].
    np.testing.assert_array_equal(numbered([0, 1, 2, 5, 6, 7]).between(3, 7).t, [6, 7])


@FIXED
@given(st.integers(0, 2**32 - 1), st.floats(0.1, 1.5), st.floats(1.5, 3))
def test_no_sample_of_a_jittering_log_sticks_out(seed, t_from, t_to):
    steps = np.random.default_rng(seed).uniform(0.5e-2, 1.5e-2, size=320)
    t = np.cumsum(steps)
    part = numbered(t).between(t_from, t_to)
    begins = t[np.searchsorted(t, part.t) - 1]
    assert np.all(begins >= t_from - EDGE)
    assert np.all(part.t <= t_to + EDGE)


def test_a_dwells_window_counts_from_its_start():
    readings = numbered(np.arange(1, 101) / 10)
    dwell = Dwell("Y1 up", 2.0, 8.0, readings)
    np.testing.assert_allclose(dwell.window().t[[0, -1]], [2.1, 8.0], rtol=0, atol=1e-15)
    np.testing.assert_allclose(dwell.window(1.0, 3.0).t[[0, -1]], [3.1, 5.0], rtol=0, atol=1e-15)
    np.testing.assert_allclose(dwell.window(1.0, 99.0).t[-1], 8.0, rtol=0, atol=1e-15)
    assert len(dwell.window(0.0, 2.0)) == 20


def test_a_window_with_fewer_than_two_samples_is_refused():
    dwell = Dwell("Z1 down", 2.0, 8.0, numbered(np.arange(1, 101) / 10))
    message = "Z1 down: 1 samples between 7.900 and 8.000 s, at least 2 are needed"
    with pytest.raises(TooShort) as caught:
        dwell.window(5.9)
    assert str(caught.value) == message
    with pytest.raises(TooShort, match="0 samples"):
        dwell.window(7.0)
