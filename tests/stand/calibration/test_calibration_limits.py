"""Verdicts with guard bands, by hand; files of limits; what a data sheet states."""

import numpy as np
import pytest
from calibrations import ARC_SECOND, DEG_H, a_record

import stand
from stand.calibration.limits import (
    Judgement,
    Limits,
    Verdict,
    judged,
    load_limits,
    overall,
    sheet_limits,
)
from stand.errors import StandError


@pytest.mark.parametrize(
    ("value", "verdict"),
    [(8.0, "PASS"), (-8.0, "PASS"), (8.01, "INDETERMINATE"), (11.9, "INDETERMINATE"),
     (12.1, "FAIL"), (-12.1, "FAIL")],
)  # fmt: skip
def test_a_guard_band_on_both_sides(value, verdict):
    """Limit 10, expanded uncertainty 2."""
    one = Judgement(name="x", unit="u", value=value, expanded=2.0, limit=10.0, source="")
    assert one.verdict.value == verdict


def test_a_file_of_limits(tmp_path):
    path = tmp_path / "limits.toml"
    path.write_text("[gyro]\nbias_deg_h = 10.0\n[accel]\nnon_orthogonality_arcsec = 40.0\n")
    found = judged(a_record(), load_limits(path))
    assert [(j.name, j.verdict.value) for j in found[:3]] == [
        ("gyro bias X1", "PASS"),
        ("gyro bias Y1", "INDETERMINATE"),
        ("gyro bias Z1", "INDETERMINATE"),  # 12 - 2 is 10: not beyond
    ]
    # 15 and 15 lean together by 30, +- 2 sqrt 2
    assert found[3].name == "accel non orthogonality about X1"
    assert found[3].value == pytest.approx(30)
    assert found[3].expanded == pytest.approx(2 * np.sqrt(2))
    assert overall(found) is Verdict.INDETERMINATE
    path.write_text("coverage = 1.0\n[gyro]\nbias_deg_h = 10.0\n")
    assert overall(judged(a_record(), load_limits(path))) is Verdict.FAIL
    assert overall([]) is None


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[gyro]\nbias_ug = 1.0", "gyro: unknown key 'bias_ug': did you mean"),
        ("[gyro]\nbias_deg_h = 0.0", "gyro, bias_deg_h = 0.0: must be greater than 0"),
        ("[accel]\nbias_ug = 'a'", "accel, bias_ug = 'a'"),
        ("coverage = 9.0", "coverage = 9.0: must be less than"),
        ("[gyro]\nbias_deg_h = inf", "bias_deg_h = inf"),
        ("gyro = 3", "gyro = 3: must be a table"),
        ("a =", "not valid TOML"),
    ],
)
def test_files_of_limits_that_are_wrong(tmp_path, text, said):
    path = tmp_path / "limits.toml"
    path.write_text(text)
    with pytest.raises(StandError) as told:
        load_limits(path)
    assert str(told.value).startswith(f"{path}: ")
    assert said in str(told.value)
    with pytest.raises(StandError, match="limits must be a TOML file"):
        load_limits(tmp_path / "limits.json")
    with pytest.raises(StandError, match="cannot read this file of limits"):
        load_limits(tmp_path / "none.toml")


def test_limits_of_a_data_sheet():
    """stim300 states a bias of 4 deg/h, unspecified: 12; 0.2 mrad of non-orthogonality: 123.8''."""
    text = stand.unit("stim300", rate_hz=10).sheet.text
    limits = sheet_limits(a_record(text))
    size, source = limits.largest["gyro", "bias"]
    assert (size / DEG_H, source) == (pytest.approx(12), "3 × sheet's unspecified")
    size, _ = limits.largest["accel", "non_orthogonality"]
    assert size / ARC_SECOND == pytest.approx(3 * 0.2e-3 / ARC_SECOND)
    assert ("gyro", "rotation") in limits.largest
    maximum = text.replace('value = 4.0, kind = "unspecified"', 'value = 4.0, kind = "maximum"')
    size, source = sheet_limits(a_record(maximum)).largest["gyro", "bias"]
    assert (size / DEG_H, source) == (pytest.approx(4), "sheet's maximum")
    assert sheet_limits(a_record()) == Limits(2.0, {})
