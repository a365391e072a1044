"""A recording out again: read by others, and back in without its procedure: the same estimate."""

import csv
import sys

import numpy as np
import pytest
import scipy.io

import stand
from alignment.units import ARC_SECOND
from stand.recording.export import READINGS, WRITERS, export_log, stretches_file
from stand.recording.foreign import LogForm
from stand.recording.importing import import_log

HZ = 5
NAMED = "t=t_s," + ",".join(f"{n[:2]}={n}" for n in READINGS)


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    """One with rests, one that turns, on a table with errors."""
    folder = tmp_path_factory.mktemp("export")
    for name in ("two-position", "carousel"):
        s = stand.settings(name, imu="stim300", table="mid-class", rate_hz=HZ, seed=3)
        stand.run(s, out=folder / name)
    return folder


def read_csv(path):
    with path.open(newline="") as file:
        rows = list(csv.reader(file))
    return {name: np.array(column, float) for name, *column in zip(*rows, strict=True)}


def read_parquet(path):
    parquet = pytest.importorskip("pyarrow.parquet")
    return {k: np.array(v) for k, v in parquet.read_table(path).to_pydict().items()}


def read_mat(path):
    found = scipy.io.loadmat(path)
    return {k: v[:, 0] for k, v in found.items() if not k.startswith("__")}


READERS = {
    "csv": read_csv,
    "npz": lambda path: dict(np.load(path)),
    "mat": read_mat,
    "parquet": read_parquet,
}


@pytest.mark.parametrize("kind", WRITERS)
def test_every_format_is_read_by_others(recordings, tmp_path, kind):
    log = stand.read(recordings / "two-position")
    out = tmp_path / f"x.{kind}"
    assert export_log(log, out, kind) == [out, stretches_file(out)]
    found = READERS[kind](out)
    assert found["t_s"] == pytest.approx(log.readings.t, abs=1e-9)  # stamps are nanoseconds
    w = np.column_stack([found[f"g{a}_rad_s"] for a in "xyz"])
    f = np.column_stack([found[f"a{a}_m_s2"] for a in "xyz"])
    assert np.array_equal(w, log.readings.w_ib_b)
    assert np.array_equal(f, log.readings.f_b)
    # by hand: the outer axis stands at 0 and at half a turn, the truth reads gravity on Y1
    assert found["outer_rad"][[0, -1]] == pytest.approx([0, np.pi], abs=60 * ARC_SECOND)
    assert found["true_ay_m_s2"][0] == pytest.approx(9.8093587, abs=1e-3)
    q = np.column_stack([found[f"q_nb_{a}"] for a in "xyzw"])
    assert np.linalg.norm(q, axis=1) == pytest.approx(1)


@pytest.mark.parametrize("kind", ["npz", "parquet"])
def test_a_long_recording_is_written_in_parts(recordings, tmp_path, monkeypatch, kind):
    """Of 97 rows here, the last one shorter."""
    log = stand.read(recordings / "two-position")
    export_log(log, tmp_path / f"whole.{kind}", kind)
    monkeypatch.setattr("stand.recording.export.PART", 97)
    assert len(log.readings) % 97
    export_log(log, tmp_path / f"parts.{kind}", kind)
    whole, parts = (READERS[kind](tmp_path / f"{name}.{kind}") for name in ("whole", "parts"))
    assert list(whole) == list(parts)
    for name, values in whole.items():
        np.testing.assert_array_equal(parts[name], values)


@pytest.mark.parametrize("name", ["two-position", "carousel"])
@pytest.mark.parametrize("given", [True, False], ids=["exported stretches", "found stretches"])
def test_without_its_procedure_a_run_gives_the_same_estimate(recordings, tmp_path, name, given):
    run = recordings / name
    log = stand.read(run)
    with_procedure = stand.align(log, method=(method := log.methods[-1]))
    export_log(log, tmp_path / "x.csv", "csv")
    import_log(tmp_path / "x.csv", tmp_path / "x.mcap", LogForm(columns=NAMED))
    named = tmp_path / "x_stretches.toml"
    if not given:
        named = tmp_path / "found.toml"
        head = "[site]\nlatitude_deg = 48.5\n"
        text = stand.stretches(tmp_path / "x.mcap").toml()
        named.write_text(f'table = "mid-class"\n{head}{text}')
    alone = stand.align(
        stand.read(tmp_path / "x.mcap", stretches=named), method=method, imu="stim300"
    )
    pairs = list(zip(with_procedure.estimates, alone.estimates, strict=given))
    assert pairs
    for a, b in pairs:
        assert a.covariance is not None
        assert b.covariance is not None
        off = (b.C_nb * a.C_nb.inv()).as_rotvec()
        sigma = np.sqrt(np.diag(a.covariance))
        if given:  # a turn's rate is that of the encoder's line: its ripple of 3'' is not in it
            assert np.abs(off).max() < (1e-9 if name == "two-position" else 3 * ARC_SECOND)
            assert np.diag(b.covariance) == pytest.approx(np.diag(a.covariance), rel=1e-6)
        else:  # half a second less at either end of some minutes of noise; gyros tell the rate
            assert np.all(np.abs(off) < 0.5 * sigma)
            assert np.diag(b.covariance) == pytest.approx(np.diag(a.covariance), rel=0.2)


def test_a_foreign_log_has_readings_alone(recordings, tmp_path):
    log = stand.read(recordings / "two-position")
    export_log(log, tmp_path / "x.csv", "csv")
    import_log(tmp_path / "x.csv", tmp_path / "x.mcap", LogForm(columns=NAMED))
    (out,) = export_log(stand.read(tmp_path / "x.mcap"), tmp_path / "y.npz", "npz")
    assert list(np.load(out)) == ["t_s", *READINGS]


def test_faults_are_one_line(recordings, tmp_path, monkeypatch):
    log = stand.read(recordings / "two-position")
    with pytest.raises(stand.StandError, match="unknown format 'matt': did you mean mat"):
        export_log(log, tmp_path / "x.matt", "matt")
    with pytest.raises(stand.StandError, match="must be a file"):
        export_log(log, tmp_path, "csv")
    (tmp_path / "x_stretches.toml").write_text("mine")
    with pytest.raises(stand.StandError, match=r"x_stretches\.toml: exists"):
        export_log(log, tmp_path / "x.csv", "csv")
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(stand.StandError, match=r"pip install 'imu-test-stand\[logs\]'"):
        export_log(log, tmp_path / "x.parquet", "parquet", force=True)
    assert not (tmp_path / "x.parquet").exists()
