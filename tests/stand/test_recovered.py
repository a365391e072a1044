"""What a writer that was killed had written comes back: whole chunks, and what is true of them.

`STAND_KILLS=50` kills as many real runs, drives and imports at random moments instead of two.
"""

import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from conftest import Recorded
from mcap.reader import make_reader
from rerun.chunk import RrdReader

import stand
from stand.errors import StandError
from stand.folder import file_beside, folder_beside, left_behind
from stand.recording.log import load_log
from stand.recording.mcap.reader import read_fixes, read_imu, read_metadata, read_truth
from stand.recording.mcap.rebuild import examine
from stand.recording.mcap.replay import replayed
from stand.recording.mcap.writer import EPOCH_NS
from stand.recovered import recover

KILLS = int(os.environ.get("STAND_KILLS", "2"))
SECOND_NS = 1_000_000_000


def interrupted(recorded, root, part, name="r"):
    """What a writer leaves that was killed when so much of its file was there."""
    left = root / f".{name}.0123abcd.partial"
    left.mkdir()
    data = (recorded.folder / "run.mcap").read_bytes()
    (left / "run.mcap").write_bytes(data[: int(part * len(data))])
    (left / "run.rrd").write_bytes(b"")
    return left


def following(path):
    """The following error that a review shows [arc s]."""
    batches = (
        chunk.to_record_batch()
        for chunk in RrdReader(path).stream()
        if chunk.entity_path == "/stand/following" and not chunk.is_static
    )
    return np.array([row for b in batches for row in b.column("Scalars:scalars").to_pylist()])


def chunks(path):
    with open(path, "rb") as file:
        return make_reader(file).get_summary().chunk_indexes


def test_chunks_hold_a_second_of_the_run_at_most(recorded):
    """Samples of (k, k + 1] s, each an interval that ends at its stamp; with the texts up to it."""
    found = chunks(recorded.folder / "run.mcap")
    spans = [chunk.message_end_time - chunk.message_start_time for chunk in found]
    assert max(spans) <= SECOND_NS
    assert len(found) > len(read_imu(recorded.folder / "run.mcap")) / 20  # 20 Hz


def test_every_whole_chunk_of_a_cut_file_is_found(recorded, tmp_path):
    """Wherever it is cut: what ends before the cut is there, in the same bytes."""
    data = (recorded.folder / "run.mcap").read_bytes()
    ends = [c.chunk_start_offset + c.chunk_length for c in chunks(recorded.folder / "run.mcap")]
    path, rng = tmp_path / "cut.mcap", random.Random(1)
    for at in [*rng.sample(range(100, len(data)), 40), *(ends[5] + k for k in (-1, 0, 1))]:
        path.write_bytes(data[:at])
        assert examine(path).chunks == sum(end <= at for end in ends), at
    # what a power cut leaves: a file as long as it was to be, its last blocks never written
    path.write_bytes(data[: ends[7] - 5] + bytes(4096))
    assert examine(path).chunks == 7


@pytest.mark.slow
def test_what_comes_back_is_what_the_whole_run_has(recorded, tmp_path, stand_command):
    """Cut in its second dwell: the first is answered as in the whole run, the second by name."""
    left = interrupted(recorded, tmp_path, part=0.8)
    target = tmp_path / "r"
    done = stand_command("recover", tmp_path)
    assert done.code == 0, done.err
    assert not left.exists()
    assert sorted(p.name for p in target.iterdir()) == ["result.json", "run.mcap", "run.rrd"]
    whole, found = (read_imu(f / "run.mcap") for f in (recorded.folder, target))
    n = len(found)
    assert 0 < n < len(whole)
    np.testing.assert_array_equal(found.w_ib_b, whole.w_ib_b[:n])
    np.testing.assert_array_equal(found.f_b, whole.f_b[:n])
    truths = (read_truth(f / "run.mcap") for f in (recorded.folder, target))
    np.testing.assert_array_equal(*(t.q_wb[:n] for t in truths))
    until = (found.t_ns[-1] - EPOCH_NS) * 1e-9
    assert float(read_metadata(target / "run.mcap")["interrupted"]["t_s"]) == until
    assert f"{target} until {until:.3f} s" in done.out

    told, all_of_it = (
        json.loads((f / "result.json").read_text()) for f in (target, recorded.folder)
    )
    assert told["interrupted_at_s"] == until
    assert told["samples"] == n
    first = [e for e in all_of_it["estimates"] if e["label"] == "Y1 up"]
    assert [e for e in told["estimates"] if e["label"] == "Y1 up"] == first
    assert {e["label"] for e in told["estimates"]} == {"Y1 up"}
    (lost,) = (r for r in told["refusals"] if "stretch" in r)
    assert lost["stretch"] == "X1 up"
    assert lost["reason"].startswith(f"cut off at {until:.3f} s, planned to ")

    answer = stand_command("align", target)
    assert answer.code == 0, answer.err
    assert "X1 up gives no estimate: cut off at" in answer.out
    begin, end = lost["reason"].split("--from ")[1].split(" uses")[0].split(" --to ")
    assert stand_command("align", target, "--from", begin, "--to", end).code == 0
    noise = stand_command("allan", target, "--json").json
    assert noise["to_s"] == pytest.approx(until, abs=0.05)  # the rest that is cut counts too
    assert f"the recording was interrupted at {until:.3f} s" in noise["notes"]
    assert stand_command("report", target).code == 0
    assert "X1 up: no estimate" in (target / "report.html").read_text()


def test_of_a_servo_run_the_steps_and_the_following_error_come_back(short, tmp_path, stand_command):
    """The steps that were over, as the whole run told them; the demand is planned again."""
    command = ("run", short, "--rate", 5, "--motion", "servo", "--out", tmp_path / "w")
    assert stand_command(*command).code == 0
    interrupted(Recorded(tmp_path / "w", short, {}), tmp_path, part=0.8)
    (found,) = recover(tmp_path)
    told, whole = (json.loads((tmp_path / n / "result.json").read_text()) for n in "rw")
    over = [step for step in whole["steps"] if step["t_to_s"] <= found.until]
    assert 0 < len(over) < len(whole["steps"])
    assert told["steps"] == over
    assert told["missing"] == []
    errors = [following(tmp_path / n / "run.rrd") for n in "rw"]
    # arc seconds; planned anew and read from the recording: to rounding of the angles
    np.testing.assert_allclose(errors[0], errors[1][: len(errors[0])], atol=1e-9)
    assert np.abs(errors[0]).max() > 0.01


def test_of_a_run_that_cannot_be_planned_again_it_is_said(short, tmp_path, stand_command):
    """Its motion came from a file, which is not in the recording."""
    rows = ["time_s,inner_deg", *(f"{k / 10},0" for k in range(31))]
    (tmp_path / "p.csv").write_text("\n".join(rows))
    step = '[[step]]\nkind = "profile"\nlabel = "p"\nfile = "p.csv"\n'
    short.write_text(short.read_text().replace("duration_s = 12", "duration_s = 4") + step)
    command = ("run", short, "--rate", 5, "--motion", "servo", "--out", tmp_path / "w")
    assert stand_command(*command).code == 0
    interrupted(Recorded(tmp_path / "w", short, {}), tmp_path, part=0.9)
    (found,) = recover(tmp_path)
    told = json.loads((tmp_path / "r" / "result.json").read_text())
    assert told["missing"] == [
        'no following error: the motion cannot be planned again: step 4 "p": p.csv: cannot read '
        "this file: No such file or directory"
    ]
    assert found.reason == f"({told['missing'][0]})"


@pytest.mark.slow
def test_of_a_drive_its_solutions_and_its_picture_come_back(tmp_path, stand_command):
    """A file that was closed: all that the whole drive says; of one that is cut: of its fixes."""
    command = ("drive", "weaving", "--rate", 20, "--out", tmp_path / "w")
    assert stand_command(*command).code == 0
    recorded = Recorded(tmp_path / "w", tmp_path, {})
    interrupted(recorded, tmp_path, part=1.0, name="all")
    interrupted(recorded, tmp_path, part=0.6, name="cut")
    recover(tmp_path)
    whole, every, some = (
        json.loads((tmp_path / n / "result.json").read_text()) for n in ("w", "all", "cut")
    )
    names = ["solution", "corrections", "first_correction_s"]
    assert [[s[n] for n in names] for s in every["solutions"]] == [
        [s[n] for n in names] for s in whole["solutions"]
    ]
    assert {n: every[n] for n in ("fixes", "samples")} == {
        n: whole[n] for n in ("fixes", "samples")
    }
    # positions pass through latitude and longitude: to rounding of the Earth's radius
    assert every["start_error_deg"] == pytest.approx(whole["start_error_deg"], rel=1e-9)
    assert every["missing"] == some["missing"] == []
    assert 10 < some["fixes"] < whole["fixes"]
    assert some["interrupted_at_s"] < whole["duration_s"]
    for name in ("all", "cut"):
        assert (tmp_path / name / "errors.png").read_bytes().startswith(b"\x89PNG")


def test_the_review_is_of_what_was_recorded(recorded):
    """Read again block by block: the samples, the joints and the flags, as they were written."""
    blocks = list(replayed(recorded.folder / "run.mcap", EPOCH_NS))
    imu, truth = (read(recorded.folder / "run.mcap") for read in (read_imu, read_truth))
    np.testing.assert_array_equal(np.concatenate([i.w_ib_b for _, i in blocks]), imu.w_ib_b)
    np.testing.assert_array_equal(np.concatenate([t.q_wb for t, _ in blocks]), truth.q_wb)
    joints = np.concatenate([t.joints for t, _ in blocks])
    assert joints.shape == (len(imu), 6)
    assert np.ptp(joints) == pytest.approx(np.pi / 2, rel=1e-3)  # from Y1 up to X1 up


def test_a_file_that_was_closed_lacks_nothing(recorded, tmp_path):
    """Killed while the review was written: no word of an interruption, the same estimates."""
    interrupted(recorded, tmp_path, part=1.0)
    (found,) = recover(tmp_path)
    assert found.lost == ()
    assert "interrupted" not in read_metadata(tmp_path / "r" / "run.mcap")
    told, whole = (
        json.loads((f / "result.json").read_text()) for f in (tmp_path / "r", recorded.folder)
    )
    assert told["estimates"] == whole["estimates"]
    assert told["interrupted_at_s"] is None


def test_no_samples_are_nothing_to_bring_back(recorded, tmp_path, stand_command):
    left = interrupted(recorded, tmp_path, part=0.01)
    done = stand_command("recover", tmp_path)
    assert done.code == 1
    assert done.out == f"{left}: holds no whole second of samples: delete it\n"
    assert left.is_dir()


def test_what_is_there_stays(recorded, tmp_path):
    """The target's name is taken: the next free one; what was to be replaced is not lost."""
    interrupted(recorded, tmp_path, part=0.5)
    (tmp_path / "r").mkdir()
    (tmp_path / "r" / "mine").write_text("")
    old = tmp_path / ".q.0123abcd.old"
    old.mkdir()
    (old / "run.mcap").write_bytes(b"")
    found = recover(tmp_path)
    assert [one.out for one in found] == [tmp_path / "q", tmp_path / "r-recovered"]
    assert (tmp_path / "r" / "mine").exists()


def test_who_is_at_work_is_left_alone(tmp_path):
    with folder_beside(tmp_path / "a"), file_beside(tmp_path / "b.mcap"):
        assert len(list(tmp_path.iterdir())) == 2
        assert left_behind(tmp_path) == []
        assert recover(tmp_path) == []
    with pytest.raises(StandError, match="nowhere: no such folder, and nothing of an"):
        recover(tmp_path / "nowhere")


def test_the_next_run_says_what_lies_there(recorded, tmp_path, stand_command, short):
    left = interrupted(recorded, tmp_path, part=0.5)
    done = stand_command("run", short, "--rate", 5, "--out", tmp_path / "r", "--json")
    assert done.code == 0
    assert done.err == (
        f"stand: {left}: of an interrupted run; stand recover {tmp_path / 'r'} brings back what "
        "is whole\n"
    )


def test_any_file_that_is_cut_off(recorded, tmp_path, stand_command):
    """Not of an interrupted run: the file stays, what is whole of it lies beside."""
    path = tmp_path / "log.mcap"
    path.write_bytes((recorded.folder / "run.mcap").read_bytes()[:-500])
    done = stand_command("align", path)
    assert done.err.endswith(
        "log.mcap: cut off before its end; stand recover saves what is whole\n"
    )
    assert stand_command("recover", path).code == 0
    assert path.exists()
    assert len(read_imu(tmp_path / "log-recovered.mcap")) == len(
        read_imu(recorded.folder / "run.mcap")
    )
    assert stand_command("recover", recorded.folder / "run.mcap").err.endswith(
        "run.mcap: is whole: nothing to recover\n"
    )


@pytest.mark.parametrize("content", [b"", b"a diary\n", bytes(range(256)) * 40])
def test_a_file_of_somebodys_own_is_not_to_be_deleted(tmp_path, stand_command, content):
    path = tmp_path / "mine"
    path.write_bytes(content)
    done = stand_command("recover", path)
    assert (done.code, done.out) == (2, "")
    assert done.err.endswith("mine: not an MCAP file: only those can be brought back\n")
    assert path.read_bytes() == content


def test_an_mcap_that_holds_nothing_is_not_to_be_deleted_either(tmp_path, stand_command):
    path = tmp_path / "mine.mcap"
    path.write_bytes(b"\x89MCAP0\r\n")
    done = stand_command("recover", path)
    assert done.out == f"{path}: holds no whole second of samples\n"
    assert path.exists()


# --- real ones

CHILD = """
import os, sys
import stand
kind, source, out, told = sys.argv[1:]
file = os.open(told, os.O_WRONLY | os.O_CREAT)
def progress(done):
    os.pwrite(file, f"{done:.9f}".encode(), 0)
progress(0.0)
if kind in ("ideal", "servo"):
    settings = stand.settings(source, imu="ring-laser", rate_hz=500, motion=kind, seed=2)
    stand.run(settings, out, progress=progress)
elif kind == "drive":
    stand.drive(source, rate_hz=200, out=out, progress=progress)
else:
    from pathlib import Path
    from stand.recording.importing import import_log
    from stand.recording.log_form import LogForm
    columns = "t,gx,gy,gz,ax,ay,az"
    form = LogForm(columns=columns, gyro_unit="deg/s", accel_unit="m/s^2")
    import_log(Path(source), Path(out), form)
progress(1.0)
"""


def child(kind, source, out, told):
    """The writer in a process of its own."""
    command = [sys.executable, "-c", CHILD, kind, *map(str, (source, out, told))]
    return subprocess.Popen(command, stderr=subprocess.PIPE)


def reached(told):
    text = told.read_text() if told.exists() else ""
    return float(text) if len(text) == 11 else -1.0


def killed(process, told, when):
    """Kill it when it says that it is so far, or a moment later; how far it says it was."""
    while reached(told) < min(when, 0.999) and process.poll() is None:
        time.sleep(0.005)
    if when > 1:
        time.sleep(2 * (when - 1))
    said = reached(told)  # before the kill: this much at least must be there
    process.send_signal(signal.SIGKILL)
    process.communicate()
    return said


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Of each kind the source, and the recording that nobody interrupted."""
    root = tmp_path_factory.mktemp("whole")
    procedure, log = root / "short.toml", root / "log.csv"
    from conftest import SHORT

    procedure.write_text(SHORT)
    rng = np.random.default_rng(0)
    six = 1e-3 * rng.normal(size=(30_000, 6)) + [0, 0, 0, 9.8, 0, 0]
    np.savetxt(log, np.column_stack([np.arange(30_000) / 100, six]), delimiter=",")
    sources = {"ideal": procedure, "servo": procedure, "drive": "weaving", "import": log}
    made = {}

    def of(kind):
        if kind not in made:
            out = root / (f"{kind}.mcap" if kind == "import" else kind)
            done = child(kind, sources[kind], out, root / f"{kind}.told")
            _, said = done.communicate()
            assert done.returncode == 0, said
            made[kind] = sources[kind], out if kind == "import" else out / "run.mcap"
        return made[kind]

    return of


@pytest.mark.slow
@pytest.mark.parametrize("number", range(KILLS))
def test_killed_at_any_moment(whole, tmp_path, number):
    """All that was said to be done is there again, in the bits of the whole recording."""
    rng = random.Random(number)
    kind = ("servo", "import", "ideal", "drive")[number % 4]
    source, reference = whole(kind)
    out = tmp_path / ("r.mcap" if kind == "import" else "r")
    process = child(kind, source, out, tmp_path / "told")
    said = killed(process, tmp_path / "told", rng.uniform(0, 1.2))
    if out.exists():  # it was through
        return
    found = recover(tmp_path)
    complete = read_imu(reference)
    span = (complete.t_ns[-1] - EPOCH_NS) * 1e-9
    # of a drive half of the progress is that of its samples; an import says nothing
    part = {"drive": min(2 * said, 1.0), "import": 0.0}.get(kind, said)
    if not found or found[0].out is None:
        assert part <= 0
        return
    (one,) = found
    file = one.out if kind == "import" else one.out / "run.mcap"
    log = read_imu(file)
    n = len(log)
    np.testing.assert_array_equal(log.t_ns, complete.t_ns[:n])
    np.testing.assert_array_equal(log.w_ib_b, complete.w_ib_b[:n])
    np.testing.assert_array_equal(log.f_b, complete.f_b[:n])
    assert one.until >= part * span - 1e-6
    if kind == "drive":
        assert len(read_fixes(file)) >= int(one.until)
    elif kind != "import":
        (log,) = (load_log(file, None, None, None),)
        ends = {d.label: d.t_to for d in load_log(reference, None, None, None).dwells}
        expected = {label for label, end in ends.items() if end <= one.until + 1e-6}
        assert {d.label for d in log.dwells} == expected
        begins = {d.label: d.t_from for d in load_log(reference, None, None, None).dwells}
        assert all(d.t_from == begins[d.label] for d in log.dwells)  # settled as in the whole run
    assert not list(tmp_path.glob(".*"))
    shutil.rmtree(tmp_path, ignore_errors=True)
    assert stand.__version__
