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
    """9.81 m/s^2 on a unit that ends at 9.80665: one value throughout, as of a perfect sensor.

    Nothing in the record says that it is clipped; the sheet does.
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
    assert len(stand.align(stand.read(path)).estimates) == 1
    with pytest.raises(stand.StandError, match="Y1 accelerometer at full scale in 100 %"):
        stand.align(stand.read(path), imu=str(tmp_path / "unit.toml"))
    with pytest.raises(Saturated, match="Y1 accelerometer at full scale in 100 %"):
        stand.allan(stand.read(path), imu=str(tmp_path / "unit.toml"))
