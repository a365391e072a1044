"""Samples that a log holds twice: left out and said; the same time with other readings: refused."""

import numpy as np
import pytest
from written_logs import at_rest, mcap, stamps

import stand
from stand.recording.log_form import LogForm
from stand.recording.mcap import read_imu
from stand.recording.repeated import Repeated

N = 40
FORM = LogForm(columns="t,gx,gy,gz,ax,ay,az", gyro_unit="rad/s", accel_unit="m/s^2")
ROWS = [*range(5), 4, *range(5, N), N - 1, N - 1]  # rows 6, 42, 43 from one; 5 comes twice


def written(kind, folder, *, other=0.0):
    """A log whose rows are those of `ROWS`; `other`: by how much the repeated ones differ."""
    w, f = at_rest(N)
    t_ns, w, f = stamps(N)[ROWS], w[ROWS], f[ROWS]
    f[5, 2] += other
    path = folder / f"log.{kind}"
    if kind == "csv":
        np.savetxt(path, np.column_stack([t_ns * 1e-9 - t_ns[0] * 1e-9 + 1, w, f]), delimiter=",")
    else:
        mcap(path, t_ns, w, f)
    return path


@pytest.mark.parametrize("kind", ["csv", "mcap"])
def test_what_is_there_twice_counts_once(tmp_path, kind):
    log = stand.read(written(kind, tmp_path), form=FORM if kind == "csv" else None).imu
    _, f = at_rest(N)
    np.testing.assert_allclose(log.f_b, f, rtol=1e-12)
    word = "row" if kind == "csv" else "message"
    told = f"3 {word}s with the time and the readings of the one before left out: {word} 6, 42, 43"
    assert told in log.notes


@pytest.mark.parametrize("kind", ["csv", "mcap"])
def test_two_readings_of_one_time_are_refused(tmp_path, kind):
    told = "row 6, column t" if kind == "csv" else "message 5: header stamp"
    with pytest.raises(stand.StandError, match=told):
        stand.read(written(kind, tmp_path, other=1e-3), form=FORM if kind == "csv" else None)


def test_whatever_the_blocks_are():
    """The last row of a block counts in the next; counted all, three by number."""
    t = np.repeat(np.arange(10), 2)
    values = np.repeat(np.arange(30.0).reshape(10, 3), 2, axis=0)
    for size in (1, 3, 7, 20):
        seen, kept = Repeated(), []
        for first in range(0, 20, size):
            part = slice(first, first + size)
            kept += t[part][seen.once(t[part], values[part])].tolist()
        assert kept == list(range(10))
        assert seen.notes() == (
            "10 messages with the time and the readings of the one before left out: message 2, 4, "
            "6 ...",
        )


def test_our_own_recordings_have_none(recorded):
    assert read_imu(recorded.folder / "run.mcap").notes == ()
