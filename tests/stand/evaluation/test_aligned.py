"""What `stand align` takes from a unit's sheet beside its priors."""

import numpy as np
import pytest

import stand
from alignment.errors import Saturated
from stand.recording.mcap.writer import write_imu_log

SHEET = """title = "One g at most"
grade = "tactical MEMS"
evidence = "none"
[gyro]
angle_random_walk_deg_rt_h = { value = 0.01, kind = "assumed", source = "for a test" }
[accel]
velocity_random_walk_m_s_rt_h = { value = 0.01, kind = "assumed", source = "for a test" }
range_g = { value = 1.0, kind = "assumed", source = "for a test" }
"""


def test_full_scale_is_what_the_sheet_states(tmp_path):
    """9.81 m/s^2 on a unit that ends at 9.80665: one value throughout, beside two axes of noise.

    The record says that it is stuck; that it is clipped says the sheet.
    """
    n = 3000
    rng = np.random.default_rng(1)
    north, up = 7.292115e-5 * np.cos(0.85), 7.292115e-5 * np.sin(0.85)
    w = [north, up, 0.0] + 1e-6 * rng.standard_normal((n, 3))
    f = [0.0, 9.81, 0.0] + 1e-4 * rng.standard_normal((n, 3))
    path = tmp_path / "log.mcap"
    write_imu_log(
        path,
        t_ns=np.arange(1, n + 1) * 10_000_000,
        w_ib_b=w,
        f_b=np.minimum(f, 9.80665),
        epoch_ns=0,
        metadata={},
    )
    (tmp_path / "unit.toml").write_text(SHEET, encoding="utf-8")
    with pytest.raises(stand.StandError, match="Y1 accelerometer repeats one reading"):
        stand.align(stand.read(path))
    with pytest.raises(stand.StandError, match="Y1 accelerometer at full scale in 100 %"):
        stand.align(stand.read(path), imu=str(tmp_path / "unit.toml"))
    with pytest.raises(Saturated, match="Y1 accelerometer at full scale in 100 %"):
        stand.allan(stand.read(path), imu=str(tmp_path / "unit.toml"))


@pytest.mark.parametrize(
    ("stuck", "code", "words"),
    [
        ([0], 2, "log: X1 gyro repeats one reading from 0.1 to 40 s"),
        ([4], 2, "log: Y1 accelerometer repeats one reading from 0.1 to 40 s"),
        ([0, 1, 2], 0, "gyros: every reading is the same: dead, or their noise below a step"),
        (range(6), 0, "accelerometers: every reading is the same: dead, or their noise"),
    ],
)
def test_readings_that_stick_are_told(stuck, code, words, tmp_path, stand_command):
    """One axis beside two of noise is refused, a whole triad may be too coarse: it is said."""
    n = 400
    rows = np.random.default_rng(2).normal(size=(n, 6)) * ([1e-5] * 3 + [1e-3] * 3)
    rows += [5e-5, 5e-5, 0, 0, 9.81, 0]
    rows[:, stuck] = rows[0, stuck]
    log = tmp_path / "log.csv"
    np.savetxt(log, np.column_stack([np.arange(1, n + 1) / 10, rows]), delimiter=",")
    form = ("--columns", "t,gx,gy,gz,ax,ay,az", "--gyro-unit", "rad/s", "--accel-unit", "m/s^2")
    told = stand_command("align", log, *form, "--method", "triad", "--latitude", 48.5, "--json")
    assert told.code == code
    if code:
        assert told.err.count("\n") == 1
        assert words in told.err
    else:
        assert any(words in flag for flag in told.json["estimates"][0]["flags"])
    told = stand_command("calibrate", log, *form, "--hand-held", "--latitude", 48.5, "--json")
    assert told.code == 2
    assert "every reading is the same: dead" in told.err
