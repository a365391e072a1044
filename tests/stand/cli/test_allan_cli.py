"""`stand allan` from recording to JSON, table, picture and page; and what it refuses."""

import re
from pathlib import Path

import numpy as np
import pytest
from conftest import Recorded

from stand.recording.mcap import write_imu_log

SHARED = Path(__file__).resolve().parents[4] / "shared" / "data" / "real" / "ln100"
N_GYRO, N_ACCEL = np.radians(0.15) / 60, 0.024 / 60  # per root second


def noisy(path, seconds=600, rate_hz=50, seed=1, gap_at=None):
    """A log of white noise alone, written by plain numpy; a minute's gap on demand."""
    rng = np.random.default_rng(seed)
    n = seconds * rate_hz
    t_ns = (np.arange(n) + 1) * (10**9 // rate_hz)
    if gap_at is not None:
        t_ns[gap_at * rate_hz :] += 60 * 10**9
    w = N_GYRO * np.sqrt(rate_hz) * rng.normal(size=(n, 3))
    f = N_ACCEL * np.sqrt(rate_hz) * rng.normal(size=(n, 3)) + [0, 9.8, 0]
    write_imu_log(path, t_ns=t_ns, w_ib_b=w, f_b=f, metadata={})
    return path


def test_white_noise_comes_back_as_json(stand_command, tmp_path):
    done = stand_command("allan", noisy(tmp_path / "noise.mcap"), "--json")
    assert done.code == 0, done.err
    terms = {(t["sensor"], t["axis"], t["term"]): t for t in done.json["terms"]}
    for axis in "xyz":
        gyro, accel = terms["gyro", axis, "N"], terms["accel", axis, "N"]
        assert (gyro["unit"], accel["unit"]) == ("deg/rt-h", "m/s/rt-h")
        assert gyro["low"] < gyro["value"] < gyro["high"]
        # 30 000 samples: sigma of N is 0.5 %; four of them, for six values
        assert gyro["value"] == pytest.approx(0.15, rel=0.02)
        assert accel["value"] == pytest.approx(0.024, rel=0.02)
    assert {t["term"] for t in done.json["terms"]} == {"N"}
    missing = {(m["sensor"], m["axis"], m["term"]) for m in done.json["not_identifiable"]}
    assert ("gyro", "x", "B") in missing
    assert len(missing) + len(terms) == 30  # every term of every axis is in one list
    assert done.json["gaps"] == []
    assert list(tmp_path.iterdir()) == [tmp_path / "noise.mcap"]  # no pictures unless asked


def test_a_gap_is_told_and_both_stretches_used(stand_command, tmp_path):
    done = stand_command("allan", noisy(tmp_path / "gap.mcap", gap_at=200), "--json")
    assert done.code == 0, done.err
    (gap,) = done.json["gaps"]
    assert any(np.isclose(value, 60.02, atol=0.03) for value in gap.values() if value != "gap")
    assert done.json["duration_s"] == pytest.approx(600, abs=0.1)  # 200 s and 400 s


def test_the_picture_and_a_page_without_network(stand_command, tmp_path):
    out = tmp_path / "pictures"
    done = stand_command("allan", noisy(tmp_path / "a.mcap"), "--imu", "stim300", "--out", out)
    assert done.code == 0, done.err
    assert "angle random walk" in done.out
    assert "agrees" in done.out
    assert (out / "allan.png").read_bytes().startswith(b"\x89PNG")
    page = (out / "allan.html").read_text(encoding="utf-8")
    assert "STIM300" in page
    assert "<title>" in page
    assert not re.findall(r"""(?:src|href)\s*=\s*["'](?!data:|#)""", page)  # nothing is fetched
    assert "http://" not in page.replace("http://www.w3.org", "")


def test_a_term_that_is_not_shown_is_refused_with_the_length_needed(stand_command, tmp_path):
    log = noisy(tmp_path / "short.mcap", seconds=60)
    done = stand_command("allan", log, "--imu", "stim300", "--terms", "B")
    assert done.code == 2
    assert re.search(r"B is not identifiable in 0\.0167 h: needs [\d.]+ h", done.err), done.err
    assert done.err.count("\n") == 1


def test_moving_and_tiny_records_are_refused(stand_command, tmp_path, recorded: Recorded):
    done = stand_command("allan", recorded.folder, "--from", 0, "--to", 26, "--json")
    assert done.code == 2
    assert "not at rest near 1" in done.err
    tiny = noisy(tmp_path / "tiny.mcap", seconds=1)
    done = stand_command("allan", tiny, "--json")
    assert done.code == 2
    assert str(tiny) in done.err
    done = stand_command("allan", tiny, "--terms", "X")
    assert done.code == 2
    assert "unknown term 'X'" in done.err


def test_a_dithered_ring_laser_is_not_as_noisy_as_its_samples(stand_command, tmp_path):
    """Deviations of samples look like 0.33 deg/rt-h, means over 16 s like 0.008 (methods.md).

    Successive samples of a dithered laser swing against each other, so the Allan deviation of one
    sample is above its standard deviation: sqrt(1 - r) with r = -0.7 gives 0.43.
    """
    log = SHARED / "x_LN100_up.ins"
    if not log.exists():
        pytest.skip("the ring-laser logs are not part of the project")
    made = tmp_path / "up.mcap"
    columns = "t,gx,gy,gz,ax,ay,az"
    stand_command(
        *("import", log, "--format", "f8le", "--columns", columns, "--gyro-unit", "deg/s"),
        *("--accel-unit", "m/s^2", "--out", made),
    )
    done = stand_command("allan", made, "--json")
    assert done.code == 0, done.err
    curve = next(c for c in done.json["curves"] if (c["sensor"], c["axis"]) == ("gyro", "x"))
    tau = np.array(curve.get("tau_s", curve.get("tau")))
    key = next(k for k in curve if k.startswith("deviation"))
    walk = np.array(curve[key]) * np.sqrt(tau / 3600)  # deg/h to deg/rt-h
    x = np.fromfile(log, "<f8").reshape(-1, 7)[:, 1] * 3600
    assert x.std() * np.sqrt(tau[0] / 3600) == pytest.approx(0.33, abs=0.005)
    assert walk[0] == pytest.approx(np.sqrt(np.mean(np.diff(x) ** 2) * tau[0] / 7200), rel=1e-6)
    near = int(np.argmin(np.abs(tau - 16)))
    assert walk[near] == pytest.approx(0.008, rel=0.3)
