"""What is at rest and what is not: generated, both ways; one rule for every reader of a record."""

import numpy as np
import pytest
from scipy.signal import lfilter

from alignment import ImuReadings
from alignment.allan import analyse
from alignment.errors import NotAtRest
from alignment.noise import check_rest, longest_rest

RATE = 100.0
G = 9.8094
DEG = np.pi / 180


def rest(seconds=120, gyro=0.65, accel=0.15, seed=0, rate=RATE):
    """White noise [deg/rt-h, m/s/rt-h] on Earth rate and gravity, Y1 up."""
    rng = np.random.default_rng(seed)
    n = round(seconds * rate)
    w = np.array([4.8e-5, 5.5e-5, 0.0]) + gyro * DEG / 60 * np.sqrt(rate) * rng.standard_normal(
        (n, 3)
    )
    f = np.array([0.0, G, 0.0]) + accel / 60 * np.sqrt(rate) * rng.standard_normal((n, 3))
    return (1 + np.arange(n)) / rate, w, f


def tilted(f, angle):
    """Forces with a tilt (n,) [rad] about Z1 in them."""
    x, y = f[:, 0], f[:, 1]
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([c * x + s * y, c * y - s * x, f[:, 2]], axis=1)


def turned(t, w, f, angle):
    """Turned about Z1 by angle (n,) [rad] from level."""
    turn = np.zeros_like(w)
    turn[:, 2] = np.gradient(angle, t)
    return t, w + turn, tilted(f, angle)


def smooth(n, seconds, seed):
    """Unit noise that is correlated over some seconds."""
    a = np.exp(-1 / (seconds * RATE))
    white = np.random.default_rng(seed).standard_normal(n + 3000)
    out = np.asarray(lfilter([1 - a], [1, -a], lfilter([1 - a], [1, -a], white)))[3000:]
    return out / out.std()


def coarse(values, step):
    return step * np.rint(values / step)


# At rest -----------------------------------------------------------------------------------------


def noisy():
    return rest(gyro=6.0, accel=1.0)  # three times an ADIS16405: 1 s means of 0.1 deg/s, 1 sigma


def noisy_for_an_hour():
    return rest(3600, gyro=3.0, accel=0.5, rate=20.0)


def one_level():
    t, w, f = rest()
    return t, coarse(w, 0.1), coarse(f, 2.0)


def two_levels():
    """Gyro steps of 0.5 deg/s, the mean at the edge between two: it flips, and wanders as noise."""
    t, w, f = rest(gyro=0.3)
    edge = 0.25 * DEG + 0.02 * DEG * np.sin(2 * np.pi * t / 120)[:, None]
    return t, coarse(w + edge, 0.5 * DEG), f


def steps_of_16_mg():
    """An accelerometer of 8 bits: a hair of drift takes it over the edge of a step."""
    t, w, f = rest(accel=0.1)
    f[:, 0] += 8e-3 * G + 0.002 * (t - 60) / 60
    return t, w, coarse(f, 16e-3 * G)


def dead_gyro():
    t, w, f = rest()
    w[:, 1] = 0.0
    return t, w, f


def transient():
    """Switched on a while ago: 0.5 deg/s, dying away within minutes."""
    t, w, f = rest(1800, rate=20.0)
    return t, w + 0.5 * DEG * np.exp(-t / 300)[:, None] * [1.0, 0.6, -0.8], f


def warming():
    """20 K in an hour, 54 deg/h/K and 200 ug/K: BMI088's sheet."""
    t, w, f = rest(3600, rate=20.0, gyro=0.84, accel=0.11)
    kelvin = 20 * (1 - np.exp(-t / 1200))[:, None]
    return t, w + 54 * DEG / 3600 * kelvin, f + 200e-6 * G * kelvin * [1.0, -1.0, 0.5]


def tap():
    """Somebody knocks on the table: 3 m/s^2 and 2 deg/s, ringing at 25 Hz for 0.2 s."""
    t, w, f = rest()
    ring = np.sin(2 * np.pi * 25 * (t - 60)) * np.exp(-(t - 60) / 0.1) * (t >= 60)
    return t, w + 2 * DEG * ring[:, None], f + 3 * ring[:, None]


def vibration():
    t, w, f = rest()
    wave = np.sin(2 * np.pi * 17.3 * t)[:, None]
    return t, w + 3 * DEG * wave, f + 2.0 * wave


def steady_turn():
    t, w, f = rest()
    return t, w + 5 * DEG * np.eye(3)[1], f  # about the vertical: looks like a gyro bias


STILL = (
    noisy, noisy_for_an_hour, one_level, two_levels, steps_of_16_mg, dead_gyro, transient, warming,
    tap, vibration, steady_turn,
)  # fmt: skip


@pytest.mark.parametrize("case", STILL)
def test_at_rest(case):
    check_rest(ImuReadings(*case()), "p")


# Not at rest -------------------------------------------------------------------------------------


def hand_turned():
    """Turned about Y1 as somebody turns a box in his hands, up to some 100 deg."""
    t, w, f = rest(600, seed=3)
    kernel = np.ones(150) / 150
    rate = np.convolve(np.random.default_rng(3).standard_normal(len(t)), kernel, "same") * 60 * DEG
    return turned(t, w, f, np.cumsum(rate) / RATE)


def hand_held():
    """As still as one can: 1 deg over seconds, a tremor of 9 Hz."""
    t, w, f = rest(60)
    angle = DEG * smooth(len(t), 2.0, 5) + 0.05 * DEG * np.sin(2 * np.pi * 9 * t)
    f = f + 0.2 * np.sin(2 * np.pi * 9 * t)[:, None]
    return turned(t, w, f, angle)


def walking():
    """1.9 steps a second, 2 m/s^2 up and down, 5 deg of sway, and the course changes."""
    t, w, f = rest(60)
    f[:, 1] += 2 * np.sin(2 * np.pi * 1.9 * t)
    w[:, 1] += 20 * DEG * smooth(len(t), 1.5, 6)
    return turned(t, w, f, 5 * DEG * np.sin(2 * np.pi * 0.95 * t) + 2 * DEG * smooth(len(t), 2, 7))


def put_down_late():
    t, w, f = rest()
    return turned(t, w, f, 20 * DEG * np.clip((8 - t) / 2, 0, 1))


def pushed():
    """By 2 deg, and it stays so: each half is 1 deg off the mean, twice what is allowed."""
    t, w, f = rest()
    return turned(t, w, f, 2 * DEG * np.clip((t - 60) / 0.5, 0, 1))


def leaning():
    t, w, f = rest(600)
    return turned(t, w, f, 2 * DEG * t / 600)


def rocking_ship():
    t, w, f = rest(300)
    return turned(t, w, f, 3 * DEG * np.sin(2 * np.pi * t / 8))


def spinning_up():
    """A table about the vertical, slowly faster: no tilt; only one gyro says so."""
    t, w, f = rest(gyro=0.01)
    return t, w + np.outer(0.5 * DEG * t / 120, [0.0, 1.0, 0.0]), f


def turned_about_the_vertical():
    t, w, f = rest()
    return t, w + np.outer(30 * DEG * ((t > 60) & (t < 63)), [0.0, 1.0, 0.0]), f


def noisy_and_moved():
    t, w, f = noisy()
    return turned(t, w, f, 15 * DEG * np.clip((t - 60) / 3, 0, 1))


def coarse_and_moved():
    t, w, f = rest()
    t, w, f = turned(t, w, f, 15 * DEG * np.clip((t - 60) / 3, 0, 1))
    return t, coarse(w, 0.5 * DEG), coarse(f, 16e-3 * G)


MOVED = (
    hand_turned, hand_held, walking, put_down_late, pushed, leaning, rocking_ship, spinning_up,
    turned_about_the_vertical, noisy_and_moved, coarse_and_moved,
)  # fmt: skip


@pytest.mark.parametrize("case", MOVED)
def test_not_at_rest(case):
    with pytest.raises(NotAtRest, match="p: not at rest near"):
        check_rest(ImuReadings(*case()), "p")


@pytest.mark.parametrize("case", [hand_turned, walking])
def test_an_allan_analysis_refuses_alike(case):
    with pytest.raises(NotAtRest, match="record: not at rest near"):
        analyse(ImuReadings(*case()))


def test_a_fall_has_no_direction():
    t, w, f = rest()
    with pytest.raises(NotAtRest, match="specific force is zero"):
        check_rest(ImuReadings(t, w, np.zeros_like(f)), "p")


# What would do -----------------------------------------------------------------------------------


def test_the_longest_rest_is_named():
    begin, end = longest_rest(ImuReadings(*put_down_late()))
    assert 8.0 <= begin <= 10.0  # a block of 1 s beside the motion belongs to it
    assert 118.0 <= end <= 120.0
    assert longest_rest(ImuReadings(*hand_turned())) is None
    assert longest_rest(ImuReadings(*walking())) is None
