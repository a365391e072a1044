"""`stand calibrate --hand-held`, `stand apply`, `stand align --calibration`, as users type them."""

import json
from pathlib import Path

import numpy as np
import pytest
from turned_by_hand import G, anyhow, log_of, unit_of

import stand
from alignment.calibration import (
    Calibration,
    Gravity,
    Key,
    corrected_covariance,
    derived_of,
    parameters_of,
)
from stand.calibration.corrected import posterior
from stand.calibration.file import CalibrationRecord, calibration_text, load_calibration
from stand.calibration.truth import true_values
from stand.imu.priors import priors_of
from stand.recording.entrance import read_imu
from stand.recording.hashes import sha256_of_file
from stand.recording.mcap import write_imu_log

LOG = ("--gyro-unit", "rad/s", "--accel-unit", "m/s^2")
HERE = ("--latitude", 48.5, "--gravity", G, "--gravity-sigma", 3e-5)


def written(path, log):
    """A log as a table with a header."""
    rows = np.column_stack([log.t, log.w_ib_b, log.f_b])
    head = "t,gx,gy,gz,ax,ay,az"
    np.savetxt(path, rows, delimiter=",", header=head, comments="", fmt="%.12g")


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A log by hand of a unit, another of it at rest, and what it truly is."""
    folder = tmp_path_factory.mktemp("by_hand")
    unit = unit_of("stim300", 11, 25)
    log, _, _ = log_of(unit, anyhow(16, 11), rest_s=5, move_s=3)
    written(folder / "log.csv", log)
    other, w, f = log_of(unit_of("stim300", 11, 25), anyhow(3, 5), rest_s=20, move_s=4)
    written(folder / "other.csv", other)
    return folder, unit, (w, f)


@pytest.fixture
def here(stand_command, made, monkeypatch):
    folder, _, _ = made
    monkeypatch.chdir(folder)

    def call(*arguments, code=0):
        outcome = stand_command(*arguments)
        assert outcome.code == code, outcome.err
        return outcome

    return call


def test_calibrated_and_applied(here, made):
    folder, unit, (w, f) = made
    sheet = ("--imu", "stim300", "--shortest", 2, "--topic", "log.csv", "--height", 100)
    Path("c.json").write_text("mine", encoding="utf-8")  # which --force replaces
    told = here("calibrate", "log.csv", "--hand-held", *LOG, *HERE, *sheet[:4], "--serial", "S7",
                "--out", "c.json", "--force").out  # fmt: skip
    assert "16 rests: rank 9 of 9" in told
    assert told.index("rank 9 of 9") < told.index("scale X1")  # before the numbers
    here("calibrate", "log.csv", "--hand-held", *LOG, "--out", "c.json", code=2)
    record = load_calibration("c.json")
    assert record.unit["serial"] == "S7"
    assert record.hashes == {"log.csv": sha256_of_file(folder / "log.csv")}
    c = record.calibration
    truth = true_values(c.keys, unit.gyro_errors, unit.accel_errors, unit.sheet)
    z = (c.values - truth) / c.sigmas
    assert np.sqrt(np.mean(z**2)) < 1.5
    # the same by --json, and nothing is written
    printed = here("calibrate", "log.csv", "--hand-held", *LOG, *HERE, *sheet[:4], "--json").json
    assert printed["parameters"] == json.loads(Path("c.json").read_text())["parameters"]
    assert not Path("calibration.json").exists()

    here("apply", "c.json", "other.csv", *LOG, "--out", "corrected.mcap")
    log, raw = read_imu("corrected.mcap"), read_imu("other.csv", form=stand.LogForm(
        gyro_unit="rad/s", accel_unit="m/s^2"))  # fmt: skip
    applied = log.metadata["correction"]
    assert applied["source_sha256"] == sha256_of_file(folder / "other.csv")
    assert json.loads(applied["json"])["unit"]["serial"] == "S7"
    # the first rest, 20 s: what is left is what the sigmas say
    rest = slice(0, 500)
    true = np.r_[w[rest].mean(axis=0), f[rest].mean(axis=0)]
    left = np.r_[log.w_ib_b[rest].mean(axis=0), log.f_b[rest].mean(axis=0)] - true
    P = corrected_covariance(c, true[:3], true[3:])
    noise = np.hstack([raw.w_ib_b, raw.f_b])[rest].var(axis=0) / 500
    z = left / np.sqrt(P.diagonal() + noise)
    assert np.abs(z).max() < 4
    # b is known to 1 mrad only, the norms do not care: far below what they were
    for k, seen, before in ((0, log.w_ib_b, raw.w_ib_b), (3, log.f_b, raw.f_b)):
        norm = np.linalg.norm(true[k : k + 3])
        was, now = (abs(np.linalg.norm(v[rest].mean(axis=0)) - norm) for v in (before, seen))
        assert now < 0.3 * was
    here("apply", "c.json", "other.csv", *LOG, "--out", "corrected.mcap", code=2)
    here("apply", "c.json", "other.csv", *LOG, "--out", "corrected.mcap", "--force", "--json")
    assert "corrected already" in here(
        "apply", "c.json", "corrected.mcap", "--out", "x.mcap", code=2
    ).err  # fmt: skip
    assert not Path("x.mcap").exists()
    for wrong in (("--topic", "/imu/dat"), ("--axes", "FRD")):
        here("apply", "c.json", "other.csv", *LOG, *wrong, "--out", "x.mcap", code=2)


def test_a_certificate(here):
    Path("limits.toml").write_text("[gyro]\nbias_deg_h = 1e-3\n")
    said = ("calibrate", "log.csv", "--hand-held", *LOG, *HERE)
    told = here(*said, "--report", "page", "--limits", "limits.toml").out
    assert "page/certificate.html" in told
    assert not Path("calibration.json").exists()
    assert "✗ FAIL" in Path("page/certificate.html").read_text(encoding="utf-8")
    here(*said, "--report", "page", code=2)
    here(*said, "--limits", "limits.toml", code=2)
    here(*said, "--report", "other", "--limits", "none.toml", code=2)
    assert not Path("other").exists()


def test_aligned_by_a_calibration(here):
    """Of tilt 1.9 mg of bias go, and 1 mrad of the triad's rotation, which no hand tells, stays."""
    here("calibrate", "log.csv", "--hand-held", *LOG, *HERE, "--imu", "stim300", "--out",
         "d.json", "--force")  # fmt: skip
    said = ("align", "other.csv", *LOG, "--latitude", 48.5, "--to", 19, "--method", "triad")
    plain = here(*said, "--imu", "stim300", "--json").json["estimates"][0]
    said = (*said, "--imu", "stim300")
    better = here(*said, "--calibration", "d.json", "--json").json["estimates"][0]
    # 1.9 mg and 1 mrad by hand, then 1 mrad; with 0.2 mrad of non-orthogonality and instability
    assert plain["sigma_roll_deg"] == pytest.approx(np.degrees(np.hypot(1.9e-3, 1e-3)), rel=0.3)
    assert better["sigma_roll_deg"] == pytest.approx(np.degrees(1e-3), rel=0.3)
    bare = here(*said[:-2], "--calibration", "d.json", "--json").json
    assert bare["unstated"] == ["no data sheet states a drift: none is in a sigma"]
    assert "no data sheet states a drift" in here(*said[:-2], "--calibration", "d.json").out
    assert "read with --axes FRD" in here(
        *said, "--axes", "FRD", "--calibration", "d.json", code=2
    ).err  # fmt: skip
    assert "cannot read" in here(*said, "--calibration", "none.json", code=2).err


def test_published_method_and_python(made):
    folder, _, _ = made
    form = stand.LogForm(gyro_unit="rad/s", accel_unit="m/s^2")
    log = stand.read(folder / "log.csv", form=form)
    ours = stand.calibrate(log, hand_held=True, gravity_m_s2=G)
    theirs = stand.calibrate(log, hand_held=True, gravity_m_s2=G, as_published=True)
    assert {k.term for k in ours.calibration.keys} > {k.term for k in theirs.calibration.keys}
    assert theirs.source["method"] == "hand-held, as published"
    ours.save(folder / "p.json")
    with pytest.raises(stand.StandError, match="exists"):
        ours.save(folder / "p.json")
    assert "16 rests: rank 9" in repr(ours)
    back = stand.apply(folder / "p.json", folder / "other.csv", folder / "p.mcap", form=form)
    assert len(back.readings) == len(stand.read(folder / "other.csv", form=form).readings)
    with pytest.raises(stand.StandError, match="calibration = 3: must be a path"):
        stand.align(log, latitude_deg=48.5, calibration=3)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--hand-held", "--table", "precision"), "--table: not with --hand-held"),
        (("--as-published",), "--as-published: needs --hand-held"),
        (("--hand-held", "--gravity", 1.62), "gravity = 1.62 m/s^2: must be 9 to 10.5"),
        (("--hand-held", "--gravity-sigma", -1), "gravity sigma = -1"),
        (("--hand-held", "--shortest", 0), "shortest = 0 s"),
        (("--hand-held", "--imu", "stim30"), "did you mean stim300"),
        (("--hand-held", "--latitude", 91), "latitude"),
        (("--hand-held", "--height", "nan", "--latitude", 1), "height"),
        (("--hand-held", "--topic", "/imu"), "topic"),
        (("--hand-held", "--as-published", "--accel-unit", "g"), "must be near"),
    ],
)
def test_calibrate_says_what_is_wrong(here, options, said):
    units = LOG[:2] if "--accel-unit" in options else LOG
    told = here("calibrate", "log.csv", *units, "--json", *options, code=2)
    assert said in told.err
    assert told.err.count("\n") == 1
    assert told.out == ""


def test_two_logs_are_one_too_many(here):
    told = here("calibrate", "log.csv", "other.csv", *LOG, "--hand-held", "--json", code=2).err
    assert "2 logs, must be one" in told


def test_an_empty_log(here):
    Path("empty.csv").write_text("")
    here("calibrate", "empty.csv", *LOG, "--hand-held", "--json", code=2)
    here("apply", "p.json", "empty.csv", *LOG, "--out", "x.mcap", code=2)


# --- posterior sigmas in place of a sheet's -------------------------------------------------------


def known(keys, sigmas, values=None):
    P = np.diag(np.square(sigmas))
    x = np.zeros(len(keys)) if values is None else np.asarray(values)
    return CalibrationRecord(
        calibration=Calibration(
            parameters=parameters_of(keys, x, P, np.full(len(keys), np.inf)),
            covariance=P,
            chi_square=0.0,
            dof=0,
            gravity=Gravity(value=9.81),
            derived=derived_of(keys, x, P),
        )
    )


def test_a_sheets_sigmas_give_way():
    keys = [Key("gyro", "bias", n) for n in range(3)]
    keys += [Key("accel", "misalignment", i, j) for i in range(3) for j in range(3) if i != j]
    priors = priors_of(unit_of("stim300", 0).sheet, None)
    found = posterior(known(keys, [1e-6, 2e-6, 2e-6, *[1e-4] * 6]).calibration, priors)
    assert found.gyro_bias == pytest.approx(np.sqrt(3) * 1e-6)  # rms of 1, 2, 2
    # half the difference, and the sum, of two independent ones
    assert found.accel_misalignment == pytest.approx(1e-4 / np.sqrt(2))
    assert found.accel_non_orthogonality == pytest.approx(1e-4 * np.sqrt(2))
    assert found.gyro_scale == priors.gyro_scale
    assert found.gyro_instability == priors.gyro_instability


def test_alignment_of_a_calibrated_unit():
    """A run in memory, the unit's truth as its calibration: errors fall to what it leaves."""
    s = stand.settings("two-position", imu="stim300", rate_hz=20, seed=4, true_table=True)
    run = stand.simulate(s)
    unit = unit_of("stim300", 4)
    keys = [Key(t, "bias", n) for t in ("gyro", "accel") for n in range(3)]
    keys += [Key("accel", "misalignment", i, j) for i in range(3) for j in range(3) if i != j]
    keys += [Key("gyro", "g_sensitivity", i, j) for i in range(3) for j in range(3)]
    truth = true_values(keys, unit.gyro_errors, unit.accel_errors, unit.sheet)
    record = known(keys, np.abs(truth) * 1e-3 + 1e-12, truth)
    raw = stand.align(run, "triad")
    found = stand.align(run, "triad", calibration=record)
    for before, after in zip(raw.scores, found.scores, strict=True):
        # roll and pitch: bias and axes gone; heading: gyro bias of some deg/h gone
        assert np.abs(after.error).max() < 0.2 * np.abs(before.error).max()
        sigma = np.sqrt(after.estimate.covariance.diagonal())
        assert np.abs(after.error[[1, 0, 2]] / sigma[[2, 0, 1]]).max() < 4
        assert np.trace(after.estimate.covariance) < 0.1 * np.trace(before.estimate.covariance)


def test_terms_of_temperature_need_one(tmp_path):
    record = known([Key("gyro", "temperature_bias", 0)], [1e-7], [1e-5])
    path = tmp_path / "t.json"
    path.write_text(calibration_text(record))
    t_ns = np.arange(1, 11) * 100_000_000
    log = tmp_path / "a.mcap"
    write_imu_log(log, t_ns=t_ns, w_ib_b=np.zeros((10, 3)), f_b=np.full((10, 3), 5.0), metadata={})
    with pytest.raises(stand.StandError, match="give --temperature"):
        stand.apply(path, log, tmp_path / "b.mcap")
    back = stand.apply(path, log, tmp_path / "b.mcap", temperature_C=35.0)
    np.testing.assert_allclose(back.readings.w_ib_b[:, 0], -1e-4)  # 10 K above 25


def test_temperature_of_the_command(stand_command, tmp_path):
    path = tmp_path / "t.json"
    path.write_text(calibration_text(known([Key("gyro", "temperature_bias", 0)], [1e-7], [1e-5])))
    t_ns = np.arange(1, 11) * 100_000_000
    log = tmp_path / "a.mcap"
    write_imu_log(log, t_ns=t_ns, w_ib_b=np.zeros((10, 3)), f_b=np.full((10, 3), 5.0), metadata={})
    said = ("apply", path, log, "--out", tmp_path / "b.mcap")
    assert stand_command(*said).code == 2
    assert stand_command(*said, "--temperature", 35).code == 0
