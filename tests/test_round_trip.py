"""The data sheet comes back out of the data: presets simulated at rest and analysed.

A unit is taken at 1 Hz (means over a second, as averaging its fast output gives), for long: what
shapes single fast samples (rounding, bandwidth) is switched off, what accumulates stays on. The
analysis knows nothing of the model but the readings.
"""

from collections import Counter
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.stats import binom, chi2

from alignment.allan import channel
from stand import toml_files as catalogue
from stand.imu import Imu, TriadSpec, load_imu, without
from stand.samples import Sensed

HOUR = 3600.0
FAST = ("quantisation", "bandwidth", "range", "clock-offset", "jitter", "latency")
PRESETS = [name for name in catalogue.ids("imus") if name != "ideal"]
FIELDS = {"N": "noise", "B": "instability", "K": "random_walk"}


def at_rest(spec, hours, rate_hz, seed):
    """Rates and forces (n, 3) of a unit that lies still at 45 deg of latitude."""
    imu = Imu(spec, seed, rate_hz)
    n = round(hours * HOUR * rate_hz)
    w = np.array([0.7, 0.7, 0.1]) * 7.292115e-5
    f = np.array([0.1, 9.8, 0.1])
    reported = []
    for first in range(0, n, 8192):
        ticks = np.arange(first + 1, min(first + 8192, n) + 1)
        ones = np.ones((len(ticks), 1))
        reported.append(imu.report(Sensed(ticks * (10**9 // rate_hz), ones * w, ones * f)))
    return {
        "gyro": np.vstack([b.w_ib_b for b in reported]),
        "accel": np.vstack([b.f_b for b in reported]),
    }


@cache
def analysed(name, hours, seed):
    """(sensor, axis) -> analysis of a preset at 1 Hz, told what the sheet states."""
    spec = without(load_imu(name), FAST)
    sheet = {
        (sensor, term): getattr(getattr(spec, sensor), field)
        for sensor in ("gyro", "accel")
        for term, field in FIELDS.items()
    }
    data = at_rest(spec, hours, 1, seed)
    return {
        (sensor, axis): channel(sensor, axis, np.ascontiguousarray(data[sensor][:, k]), 1.0, sheet)
        for sensor in ("gyro", "accel")
        for k, axis in enumerate("xyz")
    }


@pytest.mark.slow
def test_every_preset_comes_back():
    """Per term over all presets, sensors, axes: as many intervals hold the truth as 95 % allows.

    A stated term is either shown, with its interval, or said to need a longer record; a term that
    nobody stated is not found (p = 0.001 each).
    """
    hits, shown, needs, invented = Counter(), Counter(), Counter(), Counter()
    for k, name in enumerate(PRESETS):
        spec = load_imu(name)
        seed = 1000 + k  # alike seeds are alike noise: one miss would count 15 times
        for (sensor, _), found in analysed(name, 12.0, seed).items():
            stated: TriadSpec = getattr(spec, sensor)
            for term in found.found:
                truth = getattr(stated, FIELDS.get(term.term, "ramp"))
                if truth:
                    shown[term.term] += 1
                    hits[term.term] += term.low <= truth <= term.high
                else:
                    invented[term.term] += 1
            for term in found.missing:
                if term.term in FIELDS and getattr(stated, FIELDS[term.term]):
                    needs[term.term] += 1
                    assert term.needed is None or term.needed > 12 * HOUR
    assert shown["N"] >= 80  # nearly every preset states it, three axes of two sensors
    assert shown["B"] >= 15
    for term, count in shown.items():
        # 95 % intervals: no fewer hits than one in a thousand such tests would see, with the
        # coverage of 90 % that the analysis promises at worst
        assert hits[term] >= binom.ppf(0.001, count, 0.90), (term, hits[term], count)
    assert sum(invented.values()) <= 6, invented  # of some 200 tests at p = 0.001 to 0.01


def normalised(term, truth):
    """Square of the error over the sigma that a 95 % interval is of."""
    return ((term.value - truth) / ((term.high - term.low) / (2 * 1.96))) ** 2


def check_width(squares):
    """Neither too narrow nor too wide: chi-square, once in a thousand on either side."""
    low, high = chi2.ppf([0.0005, 0.9995], len(squares))
    assert low < sum(squares) < high


def synthetic(**terms):
    """A gyro with given terms and nothing else."""
    spec = load_imu("ideal")
    return replace(spec, gyro=replace(spec.gyro, **terms))


def test_rate_random_walk_comes_back():
    """K = 10 deg/h/rt-h beside N = 0.05 deg/rt-h: they cross at sqrt3 N/K = 31 s."""
    K, N = np.radians(10.0) / HOUR / 60, np.radians(0.05) / 60
    hits, squares = 0, []
    for seed in range(4):
        data = at_rest(synthetic(noise=N, random_walk=K), 4.0, 1, seed)["gyro"]
        for k, axis in enumerate("xyz"):
            found = channel("gyro", axis, np.ascontiguousarray(data[:, k]), 1.0).found
            (walk,) = [term for term in found if term.term == "K"]
            hits += walk.low <= K <= walk.high
            squares.append(normalised(walk, K))
    assert hits >= binom.ppf(0.001, 12, 0.90)
    check_width(squares)


def test_quantisation_of_increments_comes_back():
    """Increments rounded to 0.05 arc seconds: Q = lsb / sqrt 12, beside N = 0.005 deg/rt-h.

    The noise shakes the angle by 0.6 steps a sample, so that the rounding errors of successive
    samples are independent (correlation exp(-2 pi^2 0.36) = 0.001), which Q means.
    """
    lsb, N = np.radians(0.05) / 3600, np.radians(0.005) / 60
    spec = replace(synthetic(noise=N, increment_lsb=lsb), increments=True)
    hits, squares = 0, []
    for seed in range(3):
        data = at_rest(spec, 0.1, 100, seed)["gyro"]
        for k, axis in enumerate("xyz"):
            found = channel("gyro", axis, np.ascontiguousarray(data[:, k]), 0.01).found
            (rounding,) = [term for term in found if term.term == "Q"]
            hits += rounding.low <= lsb / np.sqrt(12) <= rounding.high
            squares.append(normalised(rounding, lsb / np.sqrt(12)))
    assert hits >= binom.ppf(0.001, 9, 0.90)
    check_width(squares)


def test_a_short_record_says_how_long_it_must_be():
    """stim300: N = 0.15 deg/rt-h hides B = 0.3 deg/h for (N/B)^2 = 0.25 h and some times more."""
    spec = load_imu("stim300")
    data = at_rest(without(spec, FAST), 0.5, 1, 3)["gyro"]
    sheet = {("gyro", "B"): spec.gyro.instability}
    found = channel("gyro", "x", np.ascontiguousarray(data[:, 0]), 1.0, sheet)
    (missing,) = [term for term in found.missing if term.term == "B"]
    assert missing.needed is not None
    assert 1.0 * HOUR < missing.needed < 100 * HOUR
