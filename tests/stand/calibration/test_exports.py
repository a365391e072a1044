"""A calibration in the forms of others: each run, and set beside the correction to rounding."""

import runpy
import shutil
import subprocess
from dataclasses import replace

import numpy as np
import pytest

import stand
from alignment import ImuReadings
from alignment.calibration import (
    Calibration,
    Gravity,
    Key,
    constants_of,
    correct,
    parameters_of,
    reported,
)
from stand.calibration.exports import exported
from stand.calibration.file import CalibrationRecord, calibration_text
from stand.errors import StandError

# rounding of values up to 40 m/s^2 through an inverse, sums in another order
ROUNDING = 1e-12


def a_record(linear=False, unit=None):
    """A consumer unit's errors of every kind that forms can say."""
    rng = np.random.default_rng(4)
    found = {}
    for sensor, bias, k2, k3 in (("gyro", 0.02, 1e-4, 1e-4), ("accel", 0.3, 1e-5, 1e-6)):
        sizes = {"bias": bias, "scale": 0.02}
        if not linear:
            sizes |= {"asymmetry": 1e-3, "k2": k2, "k3": k3}
            sizes |= {"temperature_bias": bias / 50, "temperature_scale": 1e-4}
        for term, size in sizes.items():
            found |= {Key(sensor, term, n): x for n, x in enumerate(rng.normal(0, size, 3))}
        found |= {
            Key(sensor, "misalignment", i, j): rng.normal(0, 0.02)
            for i in range(3)
            for j in range(3)
            if i != j
        }
    if not linear:
        found |= {
            Key("gyro", term, i, j): rng.normal(0, size)
            for term, size in (("g_sensitivity", 1e-4), ("g2_sensitivity", 1e-5))
            for i in range(3)
            for j in range(3)
        }
    values = np.array(list(found.values()))
    P = np.diag((1e-3 * values) ** 2)
    calibration = Calibration(
        parameters=parameters_of(tuple(found), values, P, np.full(len(found), np.inf)),
        covariance=P,
        chi_square=0.0,
        dof=0,
        gravity=Gravity(value=9.81),
    )
    return CalibrationRecord(calibration=calibration, unit=unit or {"title": "a unit"})


def readings(record, warmth=0.0):
    """Truth (20, 3) twice, and what the unit reports of it."""
    rng = np.random.default_rng(9)
    w, f = rng.normal(0, 2, (20, 3)), rng.normal(0, 12, (20, 3))
    c = record.calibration
    gyro, accel = (constants_of(c.keys, c.values, s) for s in ("gyro", "accel"))
    return w, f, reported(gyro, w, f, warmth), reported(accel, f, f, warmth)


def applied(record, gyro, accel, warmth=0.0):
    log = ImuReadings(np.arange(1, 21) / 10, gyro, accel)
    found = correct(record.calibration, log, warmth)
    return found.w_ib_b, found.f_b


def test_imu_tks_matrices(tmp_path):
    """T K (X - b), 21 numbers read one after the other as its own loader does."""
    record = a_record(linear=True)
    paths = exported(record, tmp_path / "unit.calib")
    assert [p.name for p in paths] == ["unit_acc.calib", "unit_gyro.calib"]
    w, f, gyro, accel = readings(record)
    for path, read, true in ((paths[0], accel, f), (paths[1], gyro, w)):
        text = path.read_text()
        numbers, _, direction = text.partition("#")
        values = np.array(numbers.split(), float)
        assert len(values) == 21
        T, K, b = values[:9].reshape(3, 3), values[9:18].reshape(3, 3), values[18:]
        np.testing.assert_array_equal(T.diagonal(), 1)
        np.testing.assert_allclose((read - b) @ (T @ K).T, true, atol=ROUNDING)
        assert "x = T K (X - b)" in direction
    assert "not in this form" not in paths[1].read_text()
    more = exported(a_record(), tmp_path / "all.calib")
    assert "not in this form: gyro asymmetry, k2, k3" in more[1].read_text()
    assert "g_sensitivity" in more[1].read_text()


def test_kalibrs_yaml(tmp_path):
    """Its own model forward, in its frame i, is what the unit reports."""
    yaml = pytest.importorskip("ruamel.yaml")
    record = a_record(linear=True)
    G = np.random.default_rng(1).normal(0, 1e-4, (3, 3))
    c = record.calibration
    keys = (*c.keys, *(Key("gyro", "g_sensitivity", i, j) for i in range(3) for j in range(3)))
    values = np.r_[c.values, G.ravel()]
    P = np.zeros((len(keys),) * 2)
    c = replace(
        c, parameters=parameters_of(keys, values, P, np.full(len(keys), np.inf)), covariance=P
    )
    record = replace(record, calibration=c)
    (path,) = exported(record, tmp_path / "unit.yaml")
    assert "what the unit does to the truth" in path.read_text()
    assert "not in this form" not in path.read_text()
    imu = yaml.YAML(typ="safe").load(path.read_text())["imu0"]
    w, f, gyro, accel = readings(record)
    C = np.array(imu["T_i_b"])[:3, :3]
    np.testing.assert_allclose(C @ C.T, np.eye(3), atol=1e-14)
    w_i, f_i = w @ C.T, f @ C.T
    a, g = imu["accelerometers"], imu["gyroscopes"]
    for one in (a, g):
        assert np.array_equal(np.triu(one["M"], 1), np.zeros((3, 3)))
    np.testing.assert_allclose(f_i @ np.array(a["M"]).T + a["b"], accel, atol=ROUNDING)
    told = w_i @ (np.array(g["M"]) @ g["C_gyro_i"]).T + f_i @ np.array(g["A"]).T + g["b"]
    np.testing.assert_allclose(told, gyro, atol=ROUNDING)


@pytest.mark.parametrize("warmth", [0.0, 12.0])
def test_a_few_lines_of_python(tmp_path, warmth):
    record = a_record()
    (path,) = exported(record, tmp_path / "correct.py")
    _, _, gyro, accel = readings(record, warmth)
    names = runpy.run_path(str(path))
    w, f = names["correct"](gyro, accel, warmth)
    ours = applied(record, gyro, accel, warmth)
    np.testing.assert_allclose(w, ours[0], atol=ROUNDING)
    np.testing.assert_allclose(f, ours[1], atol=ROUNDING)
    assert "out of what the unit reports, the truth" in names["__doc__"]


MAIN = """
#include <stdio.h>
#include "correct.c"
int main(void) {
    double g[3], a[3], w[3], f[3];
    while (scanf("%lf %lf %lf %lf %lf %lf", g, g + 1, g + 2, a, a + 1, a + 2) == 6) {
        imu_correct(g, a, 12.0, w, f);
        printf("%.17g %.17g %.17g %.17g %.17g %.17g\\n", w[0], w[1], w[2], f[0], f[1], f[2]);
    }
    return 0;
}
"""


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler here")
def test_a_few_lines_of_c(tmp_path):
    record = a_record(unit={"title": "ends here */ \n and \\"})
    exported(record, tmp_path / "correct.c")
    (tmp_path / "main.c").write_text(MAIN)
    flags = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic"]
    subprocess.run(["cc", *flags, "main.c", "-o", "main", "-lm"], cwd=tmp_path, check=True)
    _, _, gyro, accel = readings(record, 12.0)
    rows = "\n".join(" ".join(f"{x:.17g}" for x in row) for row in np.hstack([gyro, accel]))
    told = subprocess.run(
        [tmp_path / "main"], input=rows, text=True, capture_output=True, check=True
    ).stdout
    found = np.array(told.split(), float).reshape(-1, 6)
    ours = np.hstack(applied(record, gyro, accel, 12.0))
    np.testing.assert_allclose(found, ours, atol=ROUNDING)


def test_a_preset_that_replays_the_unit(tmp_path):
    """Without noise in its sheet and with sigmas of zero it reports what the model says."""
    record = a_record()
    c = record.calibration
    keys = [k for k in c.keys if not k.term.startswith("temperature")]
    values = np.array([dict(zip(c.keys, c.values, strict=True))[k] for k in keys])
    P = np.zeros((len(keys),) * 2)
    c = replace(
        c, parameters=parameters_of(keys, values, P, np.full(len(keys), np.inf)), covariance=P
    )
    text = stand.unit("ideal", rate_hz=10).sheet.text
    for sensor, key in (("gyro", "range_deg_s"), ("accel", "range_g")):
        said = f'{key} = {{ value = 1e4, kind = "assumed", source = "x" }}'
        text = text.replace(f"[{sensor}]", f"[{sensor}]\n{said}")
    own = replace(record, calibration=c, unit={"title": "a unit", "toml": text})
    (path,) = exported(own, tmp_path / "unit.toml")
    unit = stand.unit(str(path), rate_hz=10, seed=3)
    w, f, gyro, accel = readings(own)
    told = unit.report(np.arange(1, 21) / 10, w, f)
    np.testing.assert_allclose(told.w_ib_b, gyro, atol=ROUNDING)
    np.testing.assert_allclose(told.f_b, accel, atol=ROUNDING)
    # without a sheet one is made of what was found, and what needs a range is named
    (path,) = exported(record, tmp_path / "plain.toml")
    assert "# not replayed: gyro k3 X1" in path.read_text()
    assert stand.unit(str(path), rate_hz=10).gyro_errors.bias.any()


def test_a_preset_of_a_preset(tmp_path):
    """A replayed unit that was calibrated anew: the new constants take the old ones' place."""
    (first,) = exported(a_record(linear=True), tmp_path / "first.toml")
    again = a_record(linear=True, unit={"title": "again", "toml": first.read_text()})
    (second,) = exported(again, tmp_path / "second.toml")
    assert second.read_text().count("known = [") == 1
    by_hand = first.read_text().replace("known = [\n", "known = [ # mine\n")
    with pytest.raises(StandError, match="known: must not be there"):
        exported(a_record(unit={"toml": by_hand}), tmp_path / "third.toml")


def test_forms_at_the_command_line(stand_command, tmp_path):
    (tmp_path / "c.json").write_text(calibration_text(a_record()))
    for name, wanted in (("u.toml", ["u.toml"]), ("u.calib", ["u_acc.calib", "u_gyro.calib"])):
        told = stand_command("export", tmp_path / "c.json", "--out", tmp_path / name)
        assert told.code == 0, told.err
        assert [line.rpartition("/")[2] for line in told.out.split()] == wanted
    said = ("export", tmp_path / "c.json", "--out", tmp_path / "u.toml")
    assert stand_command(*said).code == 2
    assert stand_command(*said, "--force").code == 0
    assert stand_command(*said[:3], tmp_path / "x", "--format", "python").code == 0
    told = stand_command(*said[:3], tmp_path / "x.csv")
    assert "unknown format '.csv'" in told.err
    assert stand_command("export", tmp_path / "none.json", "--out", tmp_path / "y.py").code == 2
    ran = stand_command("run", "two-position", "--imu", tmp_path / "u.toml", "--rate", 2, "--out",
                        tmp_path / "run", "--json")  # fmt: skip
    assert ran.code == 0, ran.err


def test_a_sheet_that_is_wrong_is_told_before_anything_is_written(tmp_path):
    record = a_record(unit={"toml": "title = 3"})
    with pytest.raises(StandError, match="data sheet of the calibration"):
        exported(record, tmp_path / "u.toml")
    assert list(tmp_path.iterdir()) == []
