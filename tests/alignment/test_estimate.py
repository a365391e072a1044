"""A number whose sigma says that it is none is not given: 30 deg of an angle, 10 of a latitude."""

import numpy as np
import pytest

from alignment import AttitudeEstimate
from alignment.angles import C_nb_from_angles, Sequence
from alignment.arrays import owned
from alignment.estimate import LATITUDE_LIMIT, determined, why_undetermined

DEG = np.pi / 180
YPR, YRP = Sequence.YAW_PITCH_ROLL, Sequence.YAW_ROLL_PITCH
ROUNDING = 1e-14  # rad: an attitude made of angles and read again


def estimate(sequence, angles_deg, azimuth_deg, tilt_deg=0.01, **more):
    covariance = np.diag([tilt_deg, tilt_deg, azimuth_deg]) ** 2 * DEG**2
    C_nb = C_nb_from_angles(sequence, *(a * DEG for a in angles_deg))
    return AttitudeEstimate("m", "p", 0, 1, C_nb, sequence, covariance=covariance, **more)


def test_just_below_thirty_degrees_a_heading_stands():
    e = estimate(YPR, (1, -40, 0), 29.99)
    assert e.heading == pytest.approx(40 * DEG, abs=ROUNDING)
    np.testing.assert_allclose(e.angles, np.array([1, -40, 0]) * DEG, atol=ROUNDING)
    assert e.undetermined == {}


def test_just_above_it_is_not_determined_and_level_stays():
    """Yaw is the heading turned about: it goes with it. Roll and pitch feel no azimuth."""
    e = estimate(YPR, (1, -40, 0), 30.01)
    assert e.heading is None
    assert np.isnan(e.angles[1])
    np.testing.assert_allclose(e.angles[[0, 2]], [1 * DEG, 0], atol=ROUNDING)
    why = "sigma of 30.01 deg is above 30 deg"
    assert e.undetermined == {"heading": why, "yaw": why}
    assert e.C_nb is not None  # for those who ask
    assert e.heading_sigma == pytest.approx(30.01 * DEG)
    np.testing.assert_allclose(e.sigmas[[0, 2]], 0.01 * DEG, rtol=1e-9)


def test_a_steep_x1_has_no_heading_while_its_yaw_stands():
    """X1 one degree from the vertical: 0.6 deg of tilt turn its projection by 0.6/tan 1 = 34."""
    e = estimate(YRP, (0, 20, 89), 1.0, tilt_deg=0.6)
    assert e.heading is None
    assert list(e.undetermined) == ["heading"]
    assert e.angles[1] == pytest.approx(20 * DEG, abs=ROUNDING)
    assert estimate(YRP, (0, 20, 89), 1.0, tilt_deg=0.5).heading is not None  # 28.6 deg


def test_a_vertical_x1_has_no_heading_and_a_yaw_of_its_own():
    assert estimate(YRP, (0, 20, 90), 29.9).undetermined == {}
    e = estimate(YRP, (0, 20, 90), 31.0)
    assert e.undetermined == {"yaw": "sigma of 31 deg is above 30 deg"}
    assert e.heading is None
    assert e.heading_sigma is None


def test_where_the_outer_turns_merge_both_go_with_the_azimuth():
    e = estimate(YPR, (0, 20, 90), 31.0)
    assert e.singular
    assert list(e.undetermined) == ["roll", "yaw"]
    assert np.isnan(e.angles[:2]).all()
    assert e.angles[2] == pytest.approx(90 * DEG, abs=1e-7)  # a square root of rounding
    assert estimate(YPR, (0, 20, 90), 29.0).undetermined == {}


@pytest.mark.parametrize(("sigma", "stands"), [(9.99, True), (10.01, False)])
def test_a_latitude_stands_to_ten_degrees(sigma, stands):
    e = AttitudeEstimate("m", "a + b", 0, 1, None, YPR, latitude=0.8, latitude_sigma=sigma * DEG)
    assert e.latitude == (0.8 if stands else None)
    assert ("latitude" in e.undetermined) is not stands
    assert e.latitude_sigma == sigma * DEG


def test_a_number_without_a_sigma_is_not_doubted():
    C_nb = C_nb_from_angles(YPR, 0.1, 0.2, 0.3)
    e = AttitudeEstimate("m", "p", 0, 1, C_nb, YPR, latitude=0.8)
    assert e.undetermined == {}
    np.testing.assert_allclose(e.angles, [0.1, 0.2, 0.3], atol=ROUNDING)
    assert e.latitude == 0.8


def test_one_rule_for_numbers_and_arrays():
    np.testing.assert_array_equal(determined(np.array([0.1, 0.6, np.nan])), [True, False, True])
    assert why_undetermined(10 * DEG, LATITUDE_LIMIT) == ""
    assert why_undetermined(200 * DEG) == "sigma is above 180 deg"
    assert why_undetermined(np.inf) == "sigma is above 180 deg"


def test_nan_stands_for_no_number_only_where_that_is_allowed():
    values = [1.0, np.nan]
    np.testing.assert_array_equal(owned(values, "x", (2,), nan=True), values)
    with pytest.raises(ValueError, match=r"x: not finite at index \(1,\)"):
        owned(values, "x", (2,))
    with pytest.raises(ValueError, match=r"x: not finite at index \(0,\)"):
        owned([np.inf, np.nan], "x", (2,), nan=True)
