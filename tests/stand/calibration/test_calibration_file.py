"""`calibration.json`: there and back to the last bit, units by hand, and files that lie."""

import json

import numpy as np
import pytest

from alignment.calibration import (
    Calibration,
    Contribution,
    Gravity,
    Key,
    LeftOut,
    Nuisance,
    Residual,
    derived_of,
    parameters_of,
)
from stand.calibration.file import (
    CalibrationRecord,
    calibration_text,
    load_calibration,
    record_to_json,
)
from stand.calibration.units import name_of
from stand.errors import StandError

DEG_H = np.pi / 180 / 3600

KEYS = (
    Key("gyro", "bias", 0),
    Key("gyro", "g_sensitivity", 1, 2),
    Key("accel", "bias", 2),
    Key("accel", "scale", 2),
    *(Key("accel", "misalignment", i, j) for i in range(3) for j in range(3) if i != j),
)
VALUES = np.array([2 * DEG_H, 3 * DEG_H / 9.80665, 9.80665e-6, 5e-6, *np.linspace(-1e-3, 1e-3, 6)])


def a_record():
    rng = np.random.default_rng(1)
    L = rng.normal(0, 1, (10, 10)) * np.abs(VALUES)[:, None] * 0.1
    prior = np.full(10, np.inf)
    prior[3] = 1e-3
    calibration = Calibration(
        parameters=parameters_of(KEYS, VALUES, L @ L.T, prior),
        covariance=L @ L.T,
        chi_square=12.5,
        dof=11,
        gravity=Gravity(value=9.81, sigma=3e-4),
        nuisance=(
            Nuisance(
                name="seat", value=1e-5, sigma=2e-5, prior_sigma=3e-5, basis="both", share=0.44
            ),
        ),
        null_space=("what cannot be told",),
        left_out=(LeftOut("rest 3", "bumped"),),
        derived=derived_of(KEYS, VALUES, L @ L.T),
        residuals=(Residual("rest 1", "rate at rest", (0.5, -1.5, 2.0)),),
        budget=(Contribution("noise", np.sqrt((L @ L.T).diagonal())),),
    )
    return CalibrationRecord(
        calibration=calibration,
        unit={"title": "a unit", "serial": "7"},
        source={"method": "hand-held"},
        hashes={"a.mcap": "00" * 32},
        versions={"stand_version": "0"},
    )


def test_there_and_back(tmp_path):
    record = a_record()
    path = tmp_path / "calibration.json"
    path.write_text(calibration_text(record))
    back = load_calibration(tmp_path)  # the folder as well
    one, other = record.calibration, back.calibration
    assert one.keys == other.keys
    # a value is divided by its unit and multiplied again: two roundings
    np.testing.assert_allclose(other.values, one.values, rtol=4e-16)
    np.testing.assert_allclose(other.covariance, one.covariance, rtol=1e-15, atol=0)
    assert [p.basis for p in one.parameters] == [p.basis for p in other.parameters]
    assert one.parameters[0].prior_sigma == other.parameters[0].prior_sigma == np.inf
    assert (other.null_space, other.left_out) == (one.null_space, one.left_out)
    assert other.nuisance[0].value == pytest.approx(1e-5, rel=1e-15)
    assert len(other.derived) == 6
    assert other.residuals == one.residuals
    assert other.budget[0].name == "noise"
    np.testing.assert_allclose(other.budget[0].sigmas, one.sigmas, rtol=4e-16)
    assert (back.unit, back.hashes) == (record.unit, record.hashes)
    assert back.errors is None


def test_units_by_hand():
    told = record_to_json(a_record())["parameters"]
    said = [(p["sensor"], p["term"], p["axis"], p.get("toward"), p["unit"]) for p in told]
    assert said[0] == ("gyro", "bias", "X1", None, "deg/h")
    assert said[1] == ("gyro", "g_sensitivity", "Y1", "Z1", "deg/h/g")
    assert said[4] == ("accel", "misalignment", "X1", "Y1", "arcsec")
    values = [p["value"] for p in told[:5]]
    # 2 deg/h, 3 deg/h/g, 1 ug, 5 ppm, -1 mrad
    np.testing.assert_allclose(values, [2, 3, 1, 5, -206.264806], rtol=1e-8)
    assert told[0]["prior_sigma"] is None
    assert told[3]["prior_sigma"] == pytest.approx(1000)
    assert name_of(KEYS[1]) == "gyro g sensitivity Y1 toward Z1"


def edited(**changes):
    told = record_to_json(a_record())
    for place, value in changes.items():
        *way, last = [int(part) if part.isdigit() else part for part in place.split("__")]
        here = told
        for part in way:
            here = here[part]
        if value is None:
            del here[last]
        else:
            here[last] = value
    return json.dumps(told)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "not valid JSON"),
        ("[]", "must be an object"),
        ("[" * 100_000, "not valid JSON"),
        ('{"a": NaN}', "NaN is no number"),
        ('{"format": 1}', "parameters: required, but missing"),
        (edited(format=2), "format = 2: must be 1"),
        (edited(parameters__0__value="2"), "parameters 1, value = '2': must be a valid number"),
        (edited(parameters__0__value=1e300), "value = 1e+300: must be less than"),
        (edited(parameters__0__sigma=-1.0), "sigma = -1.0: must be greater than or equal to 0"),
        (edited(parameters__0__unit="rad/s"), "unit = 'rad/s': must be 'deg/h' of gyro bias"),
        (edited(parameters__0__axis="x"), "axis = 'x': must be 'X1', 'Y1' or 'Z1'"),
        (edited(parameters__0__sensor="accel"), "unit = 'deg/h': must be 'ug'"),
        (edited(parameters__0__term="drift"), "term = 'drift': must be"),
        (edited(parameters__0__toward="Y1"), "toward"),
        (edited(parameters__4__toward=None), "toward"),
        (edited(parameters__4__toward="X1"), "another axis"),
        (edited(parameters__5__toward="Y1"), "parameters: one of them is there twice"),
        (edited(parameters__0__sigma=1e3), "covariance: entry 1 of the diagonal"),
        (edited(covariance__0__1=1e9), "covariance: must be symmetric"),
        (edited(covariance=[[1.0]]), "covariance: must have 10 rows of 10"),
        (edited(budget__0__sigma=[1.0]), "budget, noise: must have 10 sigmas"),
        (edited(gravity__value_m_s2=1.62), "gravity, value_m_s2 = 1.62: must be greater than 9"),
        (edited(dof=-1), "dof = -1"),
        (edited(chi_square=None), "chi_square: required, but missing"),
    ],
)
def test_files_that_lie(tmp_path, text, said):
    path = tmp_path / "c.json"
    path.write_text(text)
    with pytest.raises(StandError) as told:
        load_calibration(path)
    line = str(told.value)
    assert line.startswith(f"{path}: ")
    assert said in line
    assert "\n" not in line
    assert len(line) < 500


def test_a_negative_variance_in_some_direction_is_seen(tmp_path):
    told = record_to_json(a_record())
    sigma = [p["sigma"] for p in told["parameters"]]
    told["covariance"][0][1] = told["covariance"][1][0] = 1.5 * sigma[0] * sigma[1]
    path = tmp_path / "c.json"
    path.write_text(json.dumps(told))
    with pytest.raises(StandError, match="negative variance"):
        load_calibration(path)


def test_no_file_and_no_text(tmp_path):
    with pytest.raises(StandError, match="cannot read this calibration: No such file"):
        load_calibration(tmp_path / "none.json")
    (tmp_path / "b.json").write_bytes(b"\xff\xfe{}")
    with pytest.raises(StandError, match="not UTF-8 text"):
        load_calibration(tmp_path / "b.json")
