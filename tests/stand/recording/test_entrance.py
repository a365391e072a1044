"""One way in for logs of every kind: the same numbers by every door."""

import numpy as np
import pytest

import stand
from stand.errors import StandError
from stand.evaluation.allan import to_json
from stand.recording.entrance import open_log, read_imu
from stand.recording.log_form import LogForm

EARTH, G = np.radians(15.041067 / 3600), 9.81
N = 300


def readings():
    """A level unit at 45 deg, X1 north, Y1 up, with a little noise (N, 6) [rad/s, m/s^2]."""
    rng = np.random.default_rng(1)
    half = EARTH * np.sqrt(0.5)
    rest = np.array([half, half, 0, 0, G, 0])
    return rest + rng.normal(size=(N, 6)) * np.repeat([1e-7, 1e-4], 3)


def csv(path, values, header="t,gx [rad/s],gy [rad/s],gz [rad/s],ax [m/s^2],ay [m/s^2],az [m/s^2]"):
    rows = np.c_[np.arange(1, len(values) + 1) / 100, values]
    np.savetxt(path, rows, "%.17g", ",", header=header, comments="")
    return path


def test_aligned_as_it_is_and_after_import(tmp_path, stand_command):
    path = csv(tmp_path / "log.csv", readings())
    told = stand_command("import", path, "--out", tmp_path / "log.mcap", "--json")
    assert told.code == 0, told.err
    assert told.json["notes"][0].startswith("columns by their headers: t=t, gx=gx [rad/s]")
    answers = []
    for log in (path, tmp_path / "log.mcap"):
        told = stand_command("align", log, "--json")
        assert told.code == 0, told.err
        answers.append(told.json["estimates"])
    assert answers[0] == answers[1]
    assert answers[0][0]["latitude_deg"] == pytest.approx(45.0, abs=0.1)
    noise = [to_json(stand.allan(log)) for log in (path, tmp_path / "log.mcap")]
    for found in noise:
        del found["recording"], found["topic"]
    assert noise[0] == noise[1]


def test_what_is_not_clear_is_not_guessed(tmp_path):
    values = readings()
    path = csv(tmp_path / "a.csv", values, "t,w1,w2,w3,ax,ay,az")
    with pytest.raises(StandError, match=r"no header is clearly gx, gy, gz: give --columns t,gx"):
        read_imu(path)
    path = csv(tmp_path / "b.csv", values[:, :5], "t,gx,gy,gz,ax,ay")
    with pytest.raises(StandError, match=r"no header is clearly az: "):
        read_imu(path)
    both = np.c_[values, values[:, :3]]
    path = csv(tmp_path / "c.csv", both, "t,gx,gy,gz,ax,ay,az,raw_gyro.x,raw_gyro.y,raw_gyro.z")
    with pytest.raises(StandError, match=r"gx may be any of gx, raw_gyro.x: give --columns"):
        read_imu(path)
    path = csv(tmp_path / "d.csv", values, "")
    with pytest.raises(StandError, match=r"no header: give --columns"):
        read_imu(path)


def test_what_says_nothing_of_such_a_log_is_refused(tmp_path):
    path = csv(tmp_path / "a.csv", readings())
    out = tmp_path / "a.mcap"
    stand.read(path)
    with pytest.raises(StandError, match=r"a\.csv: --stamps: is for messages"):
        read_imu(path, form=LogForm(stamps="log"))
    with pytest.raises(StandError, match=r"a\.csv: --topic: is for logs with topics"):
        read_imu(path, "/imu")
    from stand.recording.importing import import_log

    import_log(path, out, LogForm())
    with pytest.raises(StandError, match=r"a\.mcap: --rate: is for tables"):
        read_imu(out, form=LogForm(rate_hz=10))
    with open_log(path) as log, pytest.raises(StandError, match=r"a table of readings, it has no"):
        log.joints()
