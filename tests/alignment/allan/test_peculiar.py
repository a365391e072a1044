"""What is no noise is named, where it is and nowhere else."""

import numpy as np
import pytest
from scipy.signal import butter, lfilter, sosfilt

from alignment import ImuReadings, parts
from alignment.allan import peculiar as rules
from alignment.allan import running
from alignment.allan.peculiar import peculiar

N, DT, SIGMA = 12_000, 0.01, 4e-4


def told(x):
    """Of gyro x; the other axes are white."""
    w = SIGMA * np.random.default_rng(1).standard_normal((N, 3))
    w[:, 0] = x
    t = DT * np.arange(1, N + 1)
    return peculiar("gyro", [ImuReadings(t, w, np.ones((N, 3)))], DT)


def white(seed=0):
    return SIGMA * np.random.default_rng(seed).standard_normal(N)


def test_outliers():
    x = white()
    x[997::997] += 30 * SIGMA  # 12 of them
    assert told(x) == [
        "gyro x: 12 readings more than 8 sigma off the neighbours, first at 9.98 s: outliers are "
        "in the terms"
    ]


def test_a_channel_that_sticks():
    x = white()
    x[6000:9000] = x[6000]
    (note,) = told(x)
    # whole blocks of 64: from 6016 to 8959
    assert note.startswith("gyro x: the same reading from 60.17 to 89.6 s: it stuck")


@pytest.mark.parametrize("frequency", [7.3, 20.0, 49.99])
def test_a_line_at_half_of_the_noise(frequency):
    x = white() + SIGMA / 2 * np.sin(2 * np.pi * frequency * DT * np.arange(N) + 0.3)
    (note,) = told(x)
    assert note.startswith(f"gyro x: a line at {frequency:.4g} Hz")


def test_lines_are_counted():
    k = DT * np.arange(N)
    lines = zip((5.0, 11.0, 17.0, 23.0, 31.0), (5, 4, 3, 2, 1), strict=True)
    (note,) = told(white() + SIGMA * np.sum([a * np.sin(2 * np.pi * f * k) for f, a in lines], 0))
    assert note.startswith("gyro x: lines at 5, 11, 17 and 2 more Hz")


def test_a_jump_that_stays():
    (note,) = told(white() + 2.5 * SIGMA * (np.arange(N) >= 7000))
    assert note.startswith("gyro x: jumps near 70")
    assert "stays there" in note


def check_no_false_alarms(seeds):
    """White, a walk, quantised, one Gauss-Markov process, noise of a third of a step: 5 of 100 each
    would be 25 false alarms of a rule at 5 %; these are set for less than one in a thousand."""
    for seed in range(seeds):
        g = np.random.default_rng([seed, 3]).standard_normal((4, N + 1))
        kinds = (
            g[0, 1:],
            np.cumsum(g[1, 1:]),
            np.diff(g[2]),
            lfilter([1], [1, -0.999], g[3, 1:]),
            np.rint(0.33 * g[0, 1:]),
            np.full(N, 1.1),
        )
        assert [note for x in kinds for note in told(x)] == []


def test_noise_of_any_colour_is_none_of_it():
    check_no_false_alarms(seeds=20)


@pytest.fixture
def short_parts(monkeypatch):
    """Records go by in parts of 1280 samples and pieces of 500, spectra are of 2048 at once."""
    monkeypatch.setattr(parts, "PART", 1280)
    monkeypatch.setattr(running, "PIECE", 500)
    monkeypatch.setattr(rules, "SEGMENT", 2048)


def test_what_goes_by_in_parts_is_what_it_is_in_one(short_parts):
    """At the seams too: readings 1279 and 2560; the jump at 7000 is at none."""
    x = white()
    x[[1279, 2560, 5000]] += 30 * SIGMA
    assert told(x) == [
        "gyro x: 3 readings more than 8 sigma off the neighbours, first at 12.8 s: outliers are "
        "in the terms"
    ]
    x = white()
    x[6000:9000] = x[6000]
    assert told(x)[0].startswith("gyro x: the same reading from 60.17 to 89.6 s: it stuck")
    (note,) = told(white() + 2.5 * SIGMA * (np.arange(N) >= 7000))
    assert note.startswith("gyro x: jumps near 70")


@pytest.mark.parametrize("frequency", [20.0, 49.99])
def test_a_line_in_the_mean_of_several_spectra(short_parts, frequency):
    x = white() + SIGMA / 2 * np.sin(2 * np.pi * frequency * DT * np.arange(N) + 0.3)
    (note,) = told(x)
    # to a bin of a sixth of the record, 0.05 Hz
    assert abs(float(note.split()[5]) - frequency) < 0.05


def test_noise_of_any_colour_is_none_of_it_in_parts(short_parts):
    check_no_false_alarms(seeds=3)


def test_the_slope_of_a_filter_is_no_line():
    """Of fourth order at 8 of 100 Hz, as a unit has it: near 50 Hz the level falls to nothing, and
    dozens of lines were named there. A line beside it still is."""
    t, sections = DT * np.arange(1, N + 1), butter(4, 8, fs=1 / DT, output="sos")
    for seed in range(4):
        x = np.asarray(sosfilt(sections, white(seed)))
        assert told(x) == []
        (note,) = told(x + 1e-2 * SIGMA * np.sin(2 * np.pi * 31.3 * t))
        assert note.startswith("gyro x: a line at 31.3 Hz")
