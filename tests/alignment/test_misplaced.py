"""Zero offsets as attitudes, by hand: forces over gravity, rates over the horizontal Earth rate."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from alignment import Options, Site
from alignment.misplaced import misplaced
from alignment.nominal import ZeroOffset
from alignment.options import Priors

SITE = Site(latitude=np.radians(60.0), local_gravity=9.8)
LEVEL = Rotation.identity()
SHEET = Priors(gyro_bias=1e-7, accel_bias=1e-3)
NOISE = np.array([1e-18] * 3 + [1e-10] * 3)


def offset(*values):
    return ZeroOffset(np.array(values, dtype=float), NOISE, np.zeros(6))


def test_a_force_beyond_what_is_stated_is_a_lean_of_either_level_axis():
    """0.098 m/s^2 is 0.01 rad, 0.573 deg, where 1e-3 m/s^2 are stated: half its square an axis."""
    added, flags = misplaced(offset(0, 0, 0, 0.098, 0, 0), LEVEL, SITE, SHEET)
    np.testing.assert_allclose(added, np.diag([5e-5, 5e-5, 0.0]), rtol=1e-9, atol=1e-12)
    assert [flag[:45] for flag in flags] == ["zero offsets are 0.573 deg off the level told"]
    turned = Rotation.from_rotvec([0.0, 0.0, 1.0])  # the same of any heading
    same, _ = misplaced(offset(0, 0, 0, 0.098, 0, 0), turned, SITE, SHEET)
    np.testing.assert_allclose(same[:2, :2], added[:2, :2], rtol=1e-9, atol=1e-12)


def test_a_rate_to_the_east_beyond_what_is_stated_is_a_heading():
    """1e-6 rad/s over 7.292115e-5 x cos 60 deg is 0.02743 rad; stated are 1e-7, a tenth."""
    added, flags = misplaced(offset(0, 1e-6, 0, 0, 0, 0), LEVEL, SITE, SHEET)
    assert added[2, 2] == pytest.approx(0.0274269**2, rel=1e-5)
    assert np.count_nonzero(added) == 1
    assert flags[0].startswith("zero offsets are 1.57 deg off the heading told")


def test_what_is_stated_adds_nothing_and_no_sheet_neither():
    """Three of the sigmas that are stated; without a sheet any offset may be a bias."""
    added, flags = misplaced(offset(0, 3e-7, 0, 3e-3, 0, 0), LEVEL, SITE, SHEET)
    assert not added.any()
    assert flags == ()
    added, flags = misplaced(offset(0, 1e-5, 0, 0.5, 0, 0), LEVEL, SITE, Options().priors)
    assert not added.any()
    assert flags == ()
