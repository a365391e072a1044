"""A table that tilts slowly while its unit rests: what of that a window's sigma is to hold.

An hour at 2 Hz, X1 north, white noise of a good ring laser; gyros feel the tilt's rate,
accelerometers gravity's share of its angle, both written by hand.
"""

from math import cos, radians, sin

import numpy as np
import pytest

from alignment import Dwell, ImuReadings, Options, Site
from alignment.doubts import ALIKE_DOUBT
from alignment.methods.fine import fine
from alignment.methods.inertial import base_turns, inertial
from stand.evaluation.windows import BASE_MOVES, HIDDEN, scatters

W, G, LAT = 7.292115e-5, 9.81, radians(48.5)  # rad/s, m/s^2
HERE = Site(LAT, local_gravity=G)
HZ, SPAN, WINDOW = 2, 3600.0, 300.0
ARW, VRW = 6e-7, 5e-5  # rad/sqrt(s): 0.002 deg/rt-h; m/s/sqrt(s)
TILT = radians(100 / 3600)
SHAPES = {  # of the angle over the part of the record that is past
    "line": lambda x: x,
    "wave": lambda x: np.cos(3 * np.pi * x) / 2,
}


def record(shape, seed=0, seen=True):
    """The base turns about east, so that X1 leans; `seen` by gyros too, or accelerometers err."""
    rng, n = np.random.default_rng(seed), round(SPAN * HZ)
    edges = TILT * SHAPES[shape](np.arange(n + 1) / n)
    rate, angle = np.diff(edges) * HZ, (edges[1:] + edges[:-1]) / 2
    w = np.tile([W * cos(LAT), W * sin(LAT), 0.0], (n, 1))
    f = np.tile([0.0, G, 0.0], (n, 1))
    f[:, 0] += G * angle  # X1 raised
    if seen:
        w[:, 2] += rate  # about Z1, east: X1 rises
        w[:, :2] += W * angle[:, None] * [sin(LAT), -cos(LAT)]
    w += ARW * np.sqrt(HZ) * rng.normal(size=w.shape)
    f += VRW * np.sqrt(HZ) * rng.normal(size=f.shape)
    return ImuReadings(np.arange(1, n + 1) / HZ, w, f)


def windows(r, method=inertial):
    dwells = [Dwell("p", a, a + WINDOW, r) for a in np.arange(0.0, SPAN, WINDOW)]
    return [method([dwell], HERE, Options())[0] for dwell in dwells]


def squares(found):
    """Sum of squares of headings about their mean over the sigmas', and its degrees of freedom."""
    yaw = np.array([e.angles[1] for e in found])
    return float(np.sum((yaw - yaw.mean()) ** 2 / np.mean([e.sigmas[1] ** 2 for e in found])))


@pytest.mark.parametrize("method", [inertial, fine])
def test_windows_of_a_table_that_sways_for_an_hour_know_heading_as_well(method):
    """Drifts of accelerometers as large would turn the windows' headings by 0.5 deg rms, and a
    ratio was 0.01: chi-square of 33, of 11 for the filter, within one in 1000 on either side."""
    logs = range(3 if method is inertial else 1)
    found = [squares(windows(record("wave", seed), method)) for seed in logs]
    low, high = {inertial: (12.4, 63.9), fine: (1.8, 31.3)}[method]
    assert low < sum(found) < high


def test_accelerometers_that_wander_by_themselves_turn_heading():
    """The same without the gyros' part: it was stated, and is."""
    r = record("wave", seen=False)
    assert not base_turns(Dwell("p", 0.0, SPAN, r), HERE)
    assert 0.2 * 11 < squares(windows(r)) < 3 * 11


def test_a_straight_tilt_may_be_a_drift_and_is_alike_in_all_windows():
    """``d/(g W T cos lat)`` by hand: 8.3 arc seconds in 300 s feign 0.160 deg in each."""
    by_hand = TILT * WINDOW / SPAN / (W * WINDOW * cos(LAT))
    assert by_hand == pytest.approx(radians(0.1597), rel=0.001)
    r = record("line")
    for e in windows(r)[::4]:
        assert e.covariance is not None
        assert by_hand < np.sqrt(e.covariance[2, 2]) < 1.2 * by_hand
        assert ALIKE_DOUBT in e.flags
    rows, _ = scatters([Dwell("p", 0.0, SPAN, r)], HERE, Options(), ["inertial"], [WINDOW])
    (heading,) = (row for row in rows if row.quantity == "heading")
    assert HIDDEN in heading.remark


def test_what_gyros_see_of_a_tilt_is_the_base_that_moves():
    r = record("wave")
    assert base_turns(Dwell("p", 0.0, SPAN, r), HERE)
    rows, _ = scatters([Dwell("p", 0.0, SPAN, r)], HERE, Options(), ["inertial"], [WINDOW])
    moved = {row.quantity: BASE_MOVES in row.remark for row in rows}
    assert moved == {"heading": False, "roll": True, "pitch": True}
