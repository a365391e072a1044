"""Units and usual sizes of what a procedure can tell, and what turns are worth, by hand."""

from math import pi, radians

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from alignment import Priors, Site
from alignment.information import InstrumentErrors, Setting, Stretch, TriadErrors
from alignment.information.model import parameters
from alignment.information.turns import double_sigma, turn_pays
from alignment.information.words import _situation

MADE = InstrumentErrors(TriadErrors(), TriadErrors())
REST = Stretch("rest", 0.0, 60.0, Rotation.identity())
DEG_H = 4.84813681109536e-6  # rad/s
G0 = 9.80665
# unit, SI of one of it, and the usual size in it
UNITS = {
    "gyro bias": ("deg/h", DEG_H, 10),
    "gyro ramp": ("deg/h/h", DEG_H / 3600, 1),
    "gyro scale": ("ppm", 1e-6, 1000),
    "gyro asymmetry": ("ppm", 1e-6, 100),
    "gyro quadratic": ("1/(deg/s)", 57.29577951308232, 1e-6),
    "gyro cubic": ("1/(deg/s)^2", 3282.806350011744, 1e-9),
    "gyro misalignment": ("mrad", 1e-3, 1),
    "gyro non-orthogonality": ("mrad", 1e-3, 1),
    "gyro g-sensitivity": ("deg/h/g", DEG_H / G0, 1),
    "gyro g^2-sensitivity": ("deg/h/g^2", DEG_H / G0**2, 1),
    "accelerometer bias": ("mg", 9.80665e-3, 1),
    "accelerometer ramp": ("mg/h", 9.80665e-3 / 3600, 1),
    "accelerometer scale": ("ppm", 1e-6, 1000),
    "accelerometer asymmetry": ("ppm", 1e-6, 100),
    "accelerometer quadratic": ("mg/g^2", 1.0197162e-4, 0.1),
    "accelerometer cubic": ("mg/g^3", 1.0398212e-5, 0.1),
    "accelerometer misalignment": ("mrad", 1e-3, 1),
    "accelerometer non-orthogonality": ("mrad", 1e-3, 1),
    "accelerometer g-sensitivity": ("mg/g", 1e-3, 1),
    "accelerometer g^2-sensitivity": ("mg/g^2", 1.0197162e-4, 0.1),
    "table attitude": ("deg", pi / 180, 1),
    "lag": ("ms", 1e-3, 1),
    "latitude": ("deg", pi / 180, 1),
    "gravity": ("mg", 9.80665e-3, 1),
    "mounting": ("mrad", 1e-3, 1),
    "placement": ("mrad", 1e-3, 1),
}


def test_every_parameter_has_its_unit_and_usual_size():
    found = parameters([REST], MADE, Setting())
    assert {p.source for p in found} == set(UNITS)
    for p in found:
        unit, per, usual = UNITS[p.source]
        assert p.unit == unit, p.label
        assert p.per == pytest.approx(per, rel=1e-7), p.label
        assert p.usual == pytest.approx(usual * per, rel=1e-7), p.label


def test_a_parameter_is_weighed_by_its_prior_or_its_usual_size():
    known, unknown, none = (
        parameters([REST], InstrumentErrors(TriadErrors(bias=size), TriadErrors()), Setting())
        for size in (2e-6, np.inf, 0.0)
    )
    of = [next(p for p in found if p.source == "gyro bias") for found in (known, unknown, none)]
    assert [p.size for p in of] == pytest.approx([2e-6, 10 * DEG_H, 10 * DEG_H])
    told = parameters([REST], MADE, Setting(attitude=0.5))
    about = [p for p in told if p.source == "table attitude"]
    assert [(p.prior, p.size) for p in about] == [(0.5, pytest.approx(pi / 180))] * 3


def test_a_stretch_begins_at_encoder_zero_about_y1():
    turning = Stretch("turn", 0.0, 60.0, Rotation.identity(), rate=0.5)
    assert (turning.angle, turning.span.angle) == (0.0, 0.0)
    np.testing.assert_array_equal(turning.axis_b, [0.0, 1.0, 0.0])
    # 60 s at 0.5 rad/s are 4.77 turns: four whole ones of 4 pi s
    assert turning.span.length == pytest.approx(16 * pi)
    assert (REST.rate, REST.span.rate, REST.span.length) == (0.0, 0.0, 60.0)


# --- turns


PRIORS = Priors(gyro_bias=1e-6, gyro_walk=1e-6, accel_walk=1e-4, turn=1e-4)
LEVEL = Rotation.from_matrix([[1, 0, 0], [0, 0, 1], [0, -1, 0]])  # X1 north, Y1 up, Z1 east


def test_the_length_of_a_turns_axis_does_not_matter():
    site = Site(radians(48.5))
    one = turn_pays(LEVEL, site, PRIORS, 600.0)
    other = turn_pays(LEVEL, site, PRIORS, 600.0, axis_b=(0.0, 3.0, 0.0))
    for name in ("one_position", "half_turn", "quarter_turn"):
        assert getattr(other, name) == pytest.approx(getattr(one, name), rel=1e-9)


def test_two_gyros_and_an_allan_deviation_by_hand():
    """1e-8 rad/s at 60 deg: over sqrt(2) 7.292115e-5 / 2."""
    assert double_sigma(1e-8, radians(60)) == pytest.approx(1.9393736e-4, rel=1e-6)


@pytest.mark.parametrize(
    ("rates", "said"),
    [
        ((0.5,), "turning one way"),
        ((-0.5, -0.2), "turning one way"),
        ((0.5, -0.5), "turning both ways"),
        ((0.0, 0.0, 0.5, -0.2), "at rest in 2 positions and turning both ways"),
        ((0.0,), "at rest in 1 position"),
    ],
)
def test_where_readings_tell_nothing_is_said(rates, said):
    angles = np.radians([0.0, 90.0, 0.0, 0.0])[: len(rates), None]
    poses = Rotation.from_rotvec(angles * np.eye(3)[0])
    stretches = [
        Stretch("s", 0.0, 60.0, pose, rate=rate) for pose, rate in zip(poses, rates, strict=True)
    ]
    assert _situation(stretches, poses, one_place=False) == said
