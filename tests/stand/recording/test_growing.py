"""Columns that grow: in memory or in a file, the same array."""

import numpy as np
import pytest

from stand import room
from stand.recording.entrance import read_imu
from stand.recording.growing import Growing
from stand.recording.log import load_log
from stand.recording.log_form import LogForm


@pytest.mark.parametrize("shape", [(), (3,)])
@pytest.mark.parametrize("kind", [np.float64, np.int64])
def test_what_goes_on_in_a_file_is_the_same(monkeypatch, shape, kind):
    parts = [
        np.arange(n * max(1, *shape, 1)).reshape(n, *shape).astype(kind) for n in (5, 0, 70, 3)
    ]

    def whole():
        grown = Growing(parts[0])
        for part in parts:
            grown.extend(part)
        return grown.whole()

    kept = whole()
    monkeypatch.setattr(room, "IN_MEMORY", 0)
    in_file = whole()
    np.testing.assert_array_equal(in_file, np.concatenate(parts))
    assert (in_file.dtype, in_file.shape) == (kept.dtype, kept.shape)
    assert not in_file.flags.writeable


def test_a_recording_read_through_files_is_the_same(monkeypatch, recorded):
    def readings():
        log = load_log(recorded.folder / "run.mcap", None, None, None)
        r = log.readings
        ends = [t.C_nb.as_quat() for t in log.truths]
        return [a.tobytes() for a in (r.t, r.w_ib_b, r.f_b, *ends)]

    whole = readings()
    monkeypatch.setattr(room, "IN_MEMORY", 0)
    assert readings() == whole


def test_a_log_beyond_the_room_in_memory_reads_the_same(tmp_path, monkeypatch):
    """Its columns are mapped from a file then, which nothing may write into."""
    path = tmp_path / "log.csv"
    rows = [f"{0.01 * k:.2f},{1e-4 * k},0,0,0,{k},9.81" for k in range(400)]
    path.write_text("time_s,gx,gy,gz,ax,ay,az\n" + "\n".join(rows) + "\n", encoding="utf-8")
    form = LogForm(gyro_unit="deg/s", accel_unit="g")
    whole = read_imu(str(path), form=form)
    monkeypatch.setattr(room, "IN_MEMORY", 1000)
    mapped = read_imu(str(path), form=form)
    np.testing.assert_array_equal(mapped.w_ib_b, whole.w_ib_b)
    np.testing.assert_array_equal(mapped.f_b, whole.f_b)
    assert mapped.w_ib_b[100, 0] == np.radians(1e-2)
