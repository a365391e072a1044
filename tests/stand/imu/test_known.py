"""Constants of one unit that a preset states by value."""

from dataclasses import replace

import numpy as np
import pytest

from stand.errors import StandError
from stand.imu import imu_from, load_imu, without
from stand.imu.model import Imu, draw
from stand.samples import Sensed
from stand.toml_files import Source

DEG_H = np.pi / 180 / 3600
KNOWN = """known = [
  { sensor = "gyro", term = "bias", axis = "X1", value = 36.0, unit = "deg/h", sigma = 0.0 },
  { sensor = "gyro", term = "scale", axis = "Y1", value = 1000.0, unit = "ppm" },
  { sensor = "accel", term = "misalignment", axis = "Z1", toward = "X1", value = 20.6264806, unit = "arcsec" },
  { sensor = "gyro", term = "g_sensitivity", axis = "Z1", toward = "Y1", value = 3.6, unit = "deg/h/g" },
  { sensor = "accel", term = "k2", axis = "X1", value = 98.0665, unit = "ug/g^2" },
]
"""  # noqa: E501


def spec(known=KNOWN, sheet="ideal"):
    text = load_imu(sheet).text
    return imu_from(Source("own", "own.toml", known + text))


def test_an_ideal_unit_with_some_errors_by_hand():
    """36 deg/h is 1.745e-4 rad/s; 1e-4 rad of X1 on Z1; 3.6 deg/h a g; 98 ug a g squared."""
    imu = Imu(spec(), 5, 10)
    w, f = np.array([[1.0, 2.0, 3.0]]), np.array([[9.80665, 9.80665, 0.0]])
    told = imu.report(Sensed(np.array([100_000_000]), w, f))
    added = [36 * DEG_H, 2e-3, 3.6 * DEG_H]
    np.testing.assert_allclose(told.w_ib_b[0] - w[0], added, rtol=1e-7)
    np.testing.assert_allclose(told.f_b[0] - f[0], [98.0665e-6 * 9.80665, 0, 9.80665e-4], rtol=1e-7)


def test_what_is_known_takes_the_place_of_what_is_drawn_and_nothing_else():
    plain, known = load_imu("stim300"), spec(sheet="stim300")
    a, b = draw(plain.gyro, 3, "gyro"), draw(known.gyro, 3, "gyro")
    np.testing.assert_array_equal(b.bias[1:], a.bias[1:])
    assert b.bias[0] == pytest.approx(36 * DEG_H)
    assert b.matrix[1, 1] == pytest.approx(1.001)
    # its axes stay: the row is scaled as a whole
    np.testing.assert_allclose(b.matrix[1] / b.matrix[1, 1], a.matrix[1] / a.matrix[1, 1])
    np.testing.assert_allclose(b.matrix[[0, 2]], a.matrix[[0, 2]], rtol=1e-15)


def test_a_sigma_draws_about_the_value():
    text = (
        '{ sensor = "gyro", term = "bias", axis = "Z1", value = 9.0, unit = "deg/h", sigma = 2.0 }'
    )
    own = spec(f"known = [{text}]\n").gyro
    drawn = np.array([draw(own, seed, "gyro").bias for seed in range(400)]) / DEG_H
    # a mean of 400 is off by 2/20, their spread by 2/sqrt(800): 4 sigma
    assert drawn[:, 2].mean() == pytest.approx(9, abs=0.4)
    assert drawn[:, 2].std() == pytest.approx(2, abs=0.29)
    assert not drawn[:, :2].any()


def test_terms_that_are_off_are_not_known_either():
    off = without(spec(), ["turn-on-bias", "g-sensitivity"])
    assert [one.term for one in off.gyro.known] == ["scale"]
    assert len(off.accel.known) == 2
    assert not draw(off.gyro, 1, "gyro").bias.any()


def test_a_cubic_needs_a_range():
    text = '{ sensor = "accel", term = "k3", axis = "X1", value = 7.0, unit = "ug/g^3" }'
    own = spec(f"known = [{text}]\n", "stim300")
    errors = draw(own.accel, 1, "accel")
    # over full scale squared it is the coefficient again: 7e-6 of a g per g cubed
    assert errors.nonlinearity[0] / own.accel.full_scale**2 == pytest.approx(7e-6 / 9.80665**2)
    with pytest.raises(StandError, match="accel k3: must have a range"):
        spec(f"known = [{text}]\n", "ideal")


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (('"deg/h", sigma = 0.0', '"rad/s"'), "unit = 'rad/s': must be 'deg/h' of gyro bias"),
        (("sigma = 0.0", "sigma = -1.0"), "sigma = -1.0: must be greater"),
        (("value = 36.0", "value = 1e300"), "value = 1e+300"),
        (("value = 36.0", "value = nan"), "value = nan"),
        (('axis = "X1", value', 'axis = "x", value'), "axis = 'x'"),
        (('"scale"', '"lag"'), "term = 'lag'"),
        (('toward = "X1"', 'toward = "Z1"'), "must be another axis"),
        ((', toward = "X1"', ""), "toward: must be there of misalignment"),
        (('"bias", axis = "X1"', '"bias", axis = "X1", toward = "Y1"'), "toward: must be there"),
        (('term = "g_sensitivity"', 'term = "g2_sens"'), "term = 'g2_sens'"),
        (('"accel", term = "k2"', '"accel", term = "g_sensitivity"'), "no accel has it"),
        (('"gyro", term = "scale", axis = "Y1"', '"gyro", term = "bias", axis = "X1"'), "unit"),
        (("1000.0", '"1000"'), "must be a valid number"),
    ],
)
def test_what_is_known_wrongly(change, said):
    assert change[0] in KNOWN
    with pytest.raises(StandError) as told:
        spec(KNOWN.replace(*change))
    assert str(told.value).startswith("own.toml: ")
    assert said in str(told.value)


def test_no_value_twice_and_none_of_a_skewed_triad():
    twice = KNOWN.replace("]\n", KNOWN.splitlines()[1] + "\n]\n")
    with pytest.raises(StandError, match="known: gyro bias X1 is there twice"):
        spec(twice)
    skewed = replace(spec(), text="")
    text = load_imu("psins-inertial").text
    text = text.replace(
        "[gyro]", '[gyro]\nplane_angle_deg = { value = 60.0, kind = "assumed", source = "x" }'
    )
    with pytest.raises(StandError, match="gyro has axes of its own"):
        imu_from(Source("own", "own.toml", KNOWN + text))
    assert skewed.gyro.known
