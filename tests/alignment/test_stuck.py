"""Channels that repeat one reading, and those that may: coarse, perfect, drifting, smooth."""

import numpy as np
import pytest

from alignment import ImuReadings
from alignment.stuck import LONG, dead, stuck, unchanging

N, HZ = 4000, 50


def readings(change=lambda w, f: None, step=0.0):
    """White noise of 1e-5 rad/s and 1e-3 m/s^2 at rest, rounded to `step` of its sigma."""
    rng = np.random.default_rng(4)
    noise = [rng.normal(size=(N, 3)) for _ in range(2)]
    if step:
        noise = [np.round(values / step) * step for values in noise]
    w, f = 1e-5 * noise[0] + 5e-5, 1e-3 * noise[1] + [0, 9.81, 0]
    change(w, f)
    return ImuReadings(np.arange(1, N + 1) / HZ, w, f)


def sticks(channel, first=0, last=N):
    def change(w, f):
        values = (*w.T, *f.T)[channel]
        values[first:last] = values[first]

    return change


@pytest.mark.parametrize("step", [0.0, 0.1, 1.0])
@pytest.mark.parametrize(
    ("channel", "name"), [(0, "X1 gyro"), (2, "Z1 gyro"), (4, "Y1 accelerometer")]
)
def test_a_channel_that_stands_still_is_named_with_its_times(channel, name, step):
    """At 50 Hz: rows 2000 to the end are from 40.02 s; all of them from 0.02 s.

    Where readings are rounded, the one before may be alike by chance.
    """
    told = stuck(readings(sticks(channel), step))
    assert told.startswith(f"{name} repeats one reading from 0.02 to 80 s, 4000 samples")
    told = stuck(readings(sticks(channel, 2000), step))
    assert told.startswith(f"{name} repeats one reading from 40")
    told = stuck(readings(sticks(channel, 1000, 3000), step))
    assert told.startswith(f"{name} repeats one reading from 20")


def test_so_are_triads_and_all_of_them_from_then_on():
    def half(w, f):
        w[2000:] = w[2000]
        f[2000:] = f[2000]

    assert "from 40.02 to 80 s" in stuck(readings(half))


@pytest.mark.parametrize("step", [0.0, 1.0, 4.0, 20.0])
def test_noise_is_not_stuck_however_coarse(step):
    assert stuck(readings(step=step)) == ""


def test_a_coarse_channel_that_drifts_through_a_step_is_not():
    """Noise of a tenth of a step: it toggles where it crosses, and stands for long elsewhere."""

    def drift(w, f):
        w[:, 0] = np.round(w[:, 0] / 1e-4 + np.linspace(0, 3, N)) * 1e-4

    assert stuck(readings(drift)) == ""


def test_a_few_that_are_alike_are_not():
    assert stuck(readings(sticks(0, 100, 100 + LONG - 1))) == ""
    assert stuck(readings(sticks(0, 100, 100 + LONG))) != ""


def test_a_perfect_unit_is_not():
    def perfect(w, f):
        w[:], f[:] = [4e-5, 5e-5, 0], [0, 9.81, 0]

    def rocking(w, f):
        perfect(w, f)
        w[:, 2] = 1e-2 * np.sin(np.arange(N) / HZ)

    def rounding(w, f):
        perfect(w, f)
        w[:, 1] += 1e-17 * np.random.default_rng(0).normal(size=N)

    for change in (perfect, rocking, rounding):
        assert stuck(readings(change)) == ""


def test_a_triad_that_never_changes_is_flagged_and_a_dead_axis_found():
    def gyros(w, f):
        w[:] = w[0]

    (told,) = unchanging(readings(gyros))
    assert told.startswith("gyros: every reading is the same")
    assert unchanging(readings(sticks(0))) == ()
    assert dead(readings(sticks(5))).startswith("Z1 accelerometer: every reading is the same")
    assert dead(readings(sticks(5, 1))) == ""
