"""README and docs promise what runs: every command, file and line of Python in them does."""

import json
import re
import shlex
import shutil
from pathlib import Path
from runpy import run_path

import numpy as np
import pytest
from turned_by_hand import anyhow, log_of, unit_of

from stand.errors import StandError
from stand.motion.limits import check
from stand.motion.planner import plan
from stand.physics.mjcf import describe, load_model
from stand.procedure.procedure import procedure_from
from stand.recording.mcap.writer import write_imu_log
from stand.table.table import load_table
from stand.toml_files import Source

ROOT = Path(__file__).resolve().parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
EARTH, G = 15.041067, 9.8093587  # deg/h, m/s^2 at 48.5 deg
LATITUDE = np.radians(48.5)
SHORTER = {  # runs that only say more with more of them
    "--verify 500": "--verify 20",
    "--runs 100": "--runs 3",
    "--runs 50": "--runs 2",
    "--trade-off --report": "--report",  # in a test of its own
    "--published": "--published --only S4",  # the last --only counts
}

SMALLER = {  # sweeps likewise: four cases of two runs
    "runs = 100": "runs = 2",
    "count = 10": "count = 2",
    "count = 5": "count = 2",
    "high = 1800": "high = 120",
}


def text_of(page):
    return page.read_text(encoding="utf-8")


EXPLAINED = sorted((ROOT / "docs" / "site").rglob("*.md"))  # their notebooks run in the build
PYTHON = [page for page in [*PAGES, *EXPLAINED] if "```python" in text_of(page)]


def blocks(page):
    """Language, body and the text before, of every fenced block."""
    text = text_of(page)
    return [
        (m[1], m[2], text[: m.start()])
        for m in re.finditer(r"^```(\w*)\n(.*?)^```", text, re.DOTALL | re.MULTILINE)
    ]


def commands(page):
    """Every `stand ...` line of the page's shell blocks and of its table of jobs."""
    lines = [line for kind, body, _ in blocks(page) if kind == "sh" for line in body.splitlines()]
    lines += re.findall(r"^\|[^|]+\| `(stand [^`]+)` \|", text_of(page), re.MULTILINE)
    return [line.strip() for line in lines if line.startswith("stand ")]


def noisy(rng, n, vertical):
    """Rates [deg/s] and forces [m/s^2] (n, 6) of a unit at rest; `vertical` is its up axis."""
    north = (vertical + 1) % 3
    rate = np.zeros(3)
    rate[vertical], rate[north] = EARTH * np.sin(LATITUDE), EARTH * np.cos(LATITUDE)
    force = np.eye(3)[vertical] * G
    w = rate / 3600 + 2e-5 * rng.standard_normal((n, 3))
    return np.concatenate([w, force + 1e-3 * rng.standard_normal((n, 3))], axis=1)


def furnish(folder):
    """The files of a user's own that the pages speak of, and the sample recording."""
    rng = np.random.default_rng(5)
    t = np.arange(1, 40 * 340 + 1)[:, None] / 40
    rows = np.concatenate([t, noisy(rng, len(t), 1)], axis=1)
    np.savetxt(folder / "log.csv", rows, "%.9f", ",", header="t,gx,gy,gz,ax,ay,az", comments="")
    for name, sign in (("up", 1.0), ("down", -1.0)):
        body = noisy(rng, len(t), 0) * np.array([sign, 1, sign, sign, 1, sign])
        np.concatenate([t, body], axis=1).astype("<f8").tofile(folder / f"{name}.ins")
    by_hand, _, _ = log_of(unit_of("stim300", 3, 25), anyhow(14, 3), rest_s=5)
    rows = np.column_stack([by_hand.t, np.degrees(by_hand.w_ib_b), by_hand.f_b])
    head = "t [s],gx [deg/s],gy [deg/s],gz [deg/s],ax [m/s^2],ay [m/s^2],az [m/s^2]"
    np.savetxt(folder / "by-hand.csv", rows, "%.9f", ",", header=head, comments="")
    rest = noisy(rng, 100 * 600, 1)
    write_imu_log(
        folder / "static.mcap",
        t_ns=np.arange(1, len(rest) + 1) * 10_000_000,
        w_ib_b=np.radians(rest[:, :3]),
        f_b=rest[:, 3:],
        epoch_ns=0,
        metadata={},
    )
    if (ROOT / "recordings" / "sample").is_dir():
        shutil.copytree(ROOT / "recordings" / "sample", folder / "recordings" / "sample")


def save_files(folder):
    """Every TOML block of every page, under the name that the text before gives it."""
    for page in PAGES:
        for kind, body, before in blocks(page):
            if kind == "toml":
                names = re.findall(r"`([\w-]+\.toml)`", before)
                assert names, f"{page.name}: a TOML block without a name before it"
                if "[[vary]]" in body:
                    for long, short in SMALLER.items():
                        body = body.replace(long, short)
                (folder / names[-1]).write_text(body, encoding="utf-8")


def answer_of_jq(path, text):
    """What `jq PATH` picks, for paths of keys and numbers."""
    value = json.loads(text)
    for key, index in re.findall(r"\.(\w+)|\[(\d+)\]", path):
        value = value[key] if key else value[int(index)]
    return value


@pytest.mark.slow
@pytest.mark.parametrize("page", [p for p in PAGES if commands(p)], ids=lambda p: p.name)
def test_every_command_runs_as_shown(page, tmp_path, monkeypatch, stand_command):
    furnish(tmp_path)
    save_files(tmp_path)
    monkeypatch.chdir(tmp_path)
    for line in commands(page):
        for long, short in SHORTER.items():
            line = line.replace(long, short)
        shown, _, comment = line.partition("#")
        command, _, pipe = shown.partition("|")
        told = stand_command(*shlex.split(command)[1:])
        said = re.search(r"exit code (\d)", comment)
        assert told.code == int(said[1] if said else 0), f"{line}\n{told.err}"
        if pipe:
            assert answer_of_jq(shlex.split(pipe)[1], told.out)


@pytest.mark.parametrize("page", PYTHON, ids=lambda p: p.name)
def test_every_line_of_python_runs_as_shown(page, tmp_path, monkeypatch):
    furnish(tmp_path)
    save_files(tmp_path)
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    for kind, body, _ in blocks(page):
        if kind == "python":
            exec(compile(body, page.name, "exec"), names)


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_every_option_and_file_exists(page, stand_command):
    for line in commands(page):
        wanted = shlex.split(line.partition("#")[0].partition("|")[0])
        help_text = stand_command(wanted[1], "--help").out
        for option in (w for w in wanted if w.startswith("--")):
            assert option in help_text, line
    for name in re.findall(r"\]\(([^)#:]+)\)", text_of(page)):
        assert (page.parent / name).exists(), f"{page.name}: {name}"
    for name in re.findall(r"`((?:stand|alignment|tools|models|tests)/[\w/.-]*)`", text_of(page)):
        assert (ROOT / name).exists(), f"{page.name}: {name}"


def test_every_picture_is_shown_and_made_by_a_command():
    """`python tools/pictures.py NAME` makes it anew, or the page of its target says it does."""
    pictures = {p.name for kind in ("png", "webp") for p in (ROOT / "docs").glob(f"*.{kind}")}
    shown = {name for page in PAGES for name in re.findall(r"!\[[^]]*\]\((?:docs/)?([^)]+)\)",
                                                           text_of(page))}  # fmt: skip
    assert shown == pictures
    listed = run_path(str(ROOT / "tools" / "pictures.py"))["COMMANDS"]
    assert set(listed) == pictures
    targets = set(re.findall(r"^(\w+):", text_of(ROOT / "Makefile"), re.MULTILINE))
    for lines in listed.values():
        for line in lines:
            program, *words = shlex.split(line)
            assert program in ("stand", "python", "make", "screenshot", "cp"), line
            if program == "python":
                assert (ROOT / words[0]).is_file(), line
            if program == "make":
                assert words[0] in targets, line


def test_the_readme_is_a_tour():
    assert len(text_of(PAGES[0]).splitlines()) <= 150
    linked = set(re.findall(r"\]\(docs/([\w-]+\.md)\)", text_of(PAGES[0])))
    assert linked == {page.name for page in PAGES[1:]}


def test_the_rehearsal_of_the_docs_fails_and_its_advice_passes(tmp_path, stand_command):
    save_files(tmp_path)
    path, text = tmp_path / "north.toml", (tmp_path / "north.toml").read_text()
    for seconds, code in (("120", 1), ("270", 0)):
        path.write_text(text.replace("duration_s = 120", f"duration_s = {seconds}"))
        told = stand_command("rehearse", path, "--imu", "ring-laser")
        assert told.code == code, told.err
        if code:
            assert "0.134" in told.out
            found = stand_command("rehearse", path, "--imu", "ring-laser", "--json").json
            heading = found["predictions"][0]
            assert heading["sigma"] == pytest.approx(0.0670, abs=5e-5)
            assert heading["contributions"]["gyro white noise"] == pytest.approx(0.0668, abs=5e-5)
            assert "270 instead of 120" in told.out


def test_the_procedure_of_the_docs_stands_as_it_asks(tmp_path, stand_command):
    save_files(tmp_path)
    done = stand_command(
        "run", tmp_path / "two.toml", "--rate", 10, "--out", tmp_path / "run", "--json"
    )
    assert done.code == 0, done.err
    same = [e for e in done.json["estimates"] if e.get("window") == "same"]
    second = next(e for e in same if e["label"] == "second")
    # the instrument's attitude is what the step asks for, whatever the tilted base
    assert abs(second["roll_deg"]) == pytest.approx(180.0, abs=1e-6)
    assert second["yaw_deg"] == pytest.approx(90.0, abs=1e-6)


def test_the_refusal_of_the_docs_is_what_is_said():
    sine = (
        'title = "T"\n[site]\nlatitude_deg = 48.5\n[estimate]\nmethods = []\n'
        '[[step]]\nkind = "move"\nlabel = "lean"\njoints_deg = { outer = 10 }\n'
        '[[step]]\nkind = "sine"\nlabel = "rock"\nduration_s = 20\n'
        "axes = { base_roll = { amplitude_deg = 10, frequency_hz = 0.6 } }\n"
    )
    procedure, table = procedure_from(Source("p", "p.toml", sine)), load_table("laboratory")
    with pytest.raises(StandError) as caught:
        check(procedure, plan(procedure, describe(load_model()), table), table)
    assert f"stand: {caught.value}" in text_of(ROOT / "docs" / "running.md").replace(";\n", "; ")
