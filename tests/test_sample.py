"""The sample recording: small, what its README says, and made again by the command it names."""

import json
import re
import shlex
import shutil
import subprocess

import numpy as np
import pytest
from mcap.reader import make_reader
from test_layers import ROOT

from stand.evaluation.run_result import versions
from stand.physics.picture import NoDriver
from stand.recording.log import load_log
from stand.recording.mcap import read_imu, read_metadata
from stand.report import gallery

FOLDER = ROOT / "recordings"
SAMPLE = FOLDER / "sample"
ANGLES = re.compile(r"(error_|sigma_)?(roll|yaw|pitch|heading)_deg")


@pytest.fixture(scope="module")
def made_again(stand_command, tmp_path_factory):
    """The run of the command in the README, into another folder."""
    text = (FOLDER / "README.md").read_text(encoding="utf-8")
    (line,) = re.findall(r"^stand (run .*)$", text, re.MULTILINE)
    words = shlex.split(line)
    at = words.index("--out") + 1
    assert words[at] == "recordings/sample"
    words[at] = str(tmp_path_factory.mktemp("sample") / "again")
    done = stand_command(*words)
    assert done.code == 0, done.err
    return tmp_path_factory.getbasetemp() / words[at]


def messages(path):
    with open(path, "rb") as file:
        return [
            (channel.topic, message.log_time, message.data)
            for _, channel, message in make_reader(file).iter_messages()
        ]


def test_the_same_versions_make_the_same_bytes(made_again):
    old, new = SAMPLE / "run.mcap", made_again / "run.mcap"
    stated = read_metadata(old)["run"]
    if {name: stated[name] for name in versions()} == versions():
        assert old.read_bytes() == new.read_bytes()
    else:
        # a last digit of sine or cosine, times g: 1e-12 is a thousand of them
        for name in ("w_ib_b", "f_b", "t_ns"):
            theirs, ours = (getattr(read_imu(path), name) for path in (old, new))
            np.testing.assert_allclose(theirs, ours, rtol=0, atol=1e-12)
    assert [m[:2] for m in messages(old)] == [m[:2] for m in messages(new)]


def test_it_aligns_with_the_numbers_that_its_result_states(stand_command):
    told = json.loads((SAMPLE / "result.json").read_text(encoding="utf-8"))["estimates"]
    found = stand_command("align", SAMPLE, "--json").json["estimates"]
    # six-position twice, rk4, triad: six positions each; latitudes of three opposed pairs
    assert len(found) == len(told) == 27
    for ours, theirs in zip(found, told, strict=True):
        assert (ours["method"], ours["label"]) == (theirs["method"], theirs["label"])
        for key in filter(ANGLES.fullmatch, theirs):
            # readings pass through the file as doubles: the same numbers, but for the truth,
            # which is a mean over the stretch in one and its end in the other
            assert ours[key] == pytest.approx(theirs[key], abs=1e-9), (theirs["label"], key)


def test_numbers_by_hand():
    """1 g along each axis in turn; the horizontal Earth rate is W cos 48.5 deg = 9.96651 deg/h."""
    log = load_log(SAMPLE / "run.mcap", None, None, None)
    assert [d.label for d in log.dwells] == [
        f"{axis}1 {way}" for axis in "XYZ" for way in ("up", "down")
    ]
    for number, dwell in enumerate(log.dwells):
        axis, sign = divmod(number, 2)
        readings = dwell.window()
        force = readings.f_b.mean(axis=0)
        # scale factors of 100 ppm: 1e-3 m/s^2 of g, five times that
        assert force[axis] == pytest.approx((-1) ** sign * 9.80936, abs=5e-3)
        # biases of 25 ug and noise of 0.035 m/s/sqrt(h) over 60 s: 2.6e-4 m/s^2, five times that
        assert np.abs(np.delete(force, axis)).max() < 1.3e-3
        rate = np.degrees(readings.w_ib_b.mean(axis=0)) * 3600
        # noise of 0.002 deg/sqrt(h) over 60 s: 0.0155 deg/h, biases 0.0035: 0.016, six times that
        assert np.linalg.norm(np.delete(rate, axis)) == pytest.approx(9.96651, abs=0.1)


def test_a_report_is_made_of_it(stand_command, tmp_path, monkeypatch):
    def undrawn(*_):
        raise NoDriver("not today")  # six pictures take a software renderer 10 s

    monkeypatch.setattr(gallery, "pictures", undrawn)
    page = tmp_path / "page.html"
    assert stand_command("report", SAMPLE, "--out", page).code == 0
    assert "Six-position test" in page.read_text(encoding="utf-8")


def test_the_viewer_opens_the_review_or_what_there_is(stand_command, tmp_path, monkeypatch):
    opened = []
    monkeypatch.setattr(
        "stand.recording.viewer.view", lambda path, browser: opened.append((path, browser))
    )
    shutil.copy(SAMPLE / "run.mcap", tmp_path)
    assert stand_command("view", tmp_path).code == 0  # no review is there: its samples make one
    assert list(tmp_path.iterdir()) == [tmp_path / "run.mcap"]
    (tmp_path / "run.rrd").touch()
    assert stand_command("view", tmp_path).code == 0
    assert stand_command("view", tmp_path, "--browser").code == 0
    assert [(path.name, browser) for path, browser in opened] == [
        (f"{tmp_path.name}.rrd", False), ("run.rrd", False), ("run.rrd", True),
    ]  # fmt: skip


def test_it_is_small_and_all_else_is_ignored():
    if not (ROOT / ".git").exists():
        pytest.skip("not a checkout")
    done = subprocess.run(
        ["git", "ls-files", "recordings"], cwd=ROOT, capture_output=True, text=True, check=True
    )
    tracked = done.stdout.split()
    assert tracked == [
        "recordings/README.md", "recordings/sample/result.json", "recordings/sample/run.mcap"
    ]  # fmt: skip
    # at 5 Hz half of it is the index: a chunk holds a second, that a kill costs no more
    assert sum((ROOT / name).stat().st_size for name in tracked) < 700_000
    names = ("sample/run.rrd", "sample/report.html", "another/run.mcap")
    ignored = [f"recordings/{name}" for name in names]
    asked = ["git", "check-ignore", *ignored]
    done = subprocess.run(asked, cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.split() == ignored
