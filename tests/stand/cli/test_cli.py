"""The `stand` command: what it prints and leaves behind, and that bad input costs one line."""

import json
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import Writer

import stand
from alignment import ESTIMATORS
from alignment.sources import SOURCES
from stand import toml_files as catalogue
from stand.cli import main
from stand.imu import load_imu
from stand.recording.mcap import read_imu, read_metadata, read_truth, write_imu_log

ROOT = Path(__file__).parents[3]
COMMANDS = (
    "run",
    "drive",
    "align",
    "compare",
    "rehearse",
    "export",
    "import",
    "list",
    "allan",
    "report",
    "check-imu",
    "view",
)
FILES = ["result.json", "run.mcap", "run.rrd"]
UNITS = ("--columns", "t,gx,gy,gz,ax,ay,az", "--gyro-unit", "rad/s", "--accel-unit", "m/s^2")
# Earth rate and gravity at 48.5 deg by hand (methods.md section 0), level, X1 north: X1 Y1 Z1
W_LEVEL = np.array([9.96651, 11.26509, 0.0]) * np.pi / 180 / 3600
F_LEVEL = np.array([0.0, 9.8093587, 0.0])


@pytest.fixture
def run(stand_command, tmp_path, monkeypatch):
    """The command in an empty working folder."""
    monkeypatch.chdir(tmp_path)
    return stand_command


@pytest.fixture
def refused(run, tmp_path):
    """The one line of a command that must fail and must leave every file as it is."""

    def call(*arguments: object) -> str:
        before = contents(tmp_path)
        outcome = run(*arguments)
        assert outcome.code == 2
        assert outcome.out == ""
        assert outcome.err.startswith("stand: ")
        assert outcome.err.endswith("\n")
        assert len(outcome.err.splitlines()) == 1
        assert contents(tmp_path) == before
        return outcome.err.removeprefix("stand: ").removesuffix("\n")

    return call


def contents(folder: Path) -> dict[str, bytes | None]:
    """Everything below a folder, hidden files too."""
    return {
        str(p.relative_to(folder)): p.read_bytes() if p.is_file() else None
        for p in folder.rglob("*")
    }


def process(*arguments: object, cwd: Path) -> subprocess.CompletedProcess[str]:
    code = "from stand.cli.app import main; main()"
    command = [sys.executable, "-W", "error", "-c", code, *map(str, arguments)]
    return subprocess.run(command, cwd=cwd, capture_output=True, text=True, timeout=60, check=False)


def level_rows(n: int = 400, rate: float = 10.0) -> np.ndarray:
    """A log of a level unit with X1 north, stamps jittering by 2 ms."""
    rng = np.random.default_rng(5)
    t = np.arange(1, n + 1) / rate + rng.uniform(-2e-3, 2e-3, n)
    return np.column_stack([t, np.tile(W_LEVEL, (n, 1)), np.tile(F_LEVEL, (n, 1))])


def write_csv(path: Path, rows: np.ndarray) -> Path:
    lines = [",".join(map(repr, row)) for row in rows.tolist()]
    path.write_text("t,gx,gy,gz,ax,ay,az\n" + "\n".join(lines) + "\n")
    return path


def write_log(path: Path, rows: np.ndarray) -> Path:
    t_ns = np.round(rows[:, 0] * 1e9).astype(np.int64)
    write_imu_log(path, t_ns=t_ns, w_ib_b=rows[:, 1:4], f_b=rows[:, 4:], metadata={})
    return path


# --- help, version, lists


def test_version(run):
    outcome = run("--version")
    assert (outcome.code, outcome.out, outcome.err) == (0, f"stand {stand.__version__}\n", "")
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert project["version"] == stand.__version__


def test_help_of_everything(run):
    whole = run("--help").out
    assert run().out == whole  # no arguments at all show the help
    assert run("-h").code == run().code == 0
    for command in COMMANDS:
        assert re.search(rf"^  {command} ", whole, re.MULTILINE)
        outcome = run(command, "--help")
        assert outcome.code == 0
        assert outcome.out.startswith(f"Usage: stand {command} ") or "Usage: " in outcome.out
        assert "Example: stand" in outcome.out or command in ("list", "view")


def test_help_imports_nothing_heavy():
    heavy = "{'mujoco', 'scipy', 'rerun', 'numpy', 'mcap', 'ruckig', 'alignment'}"
    code = (
        "import sys, contextlib, io\nfrom stand.cli.app import app, guarded\n"
        "with contextlib.redirect_stdout(io.StringIO()):\n"
        "    guarded(lambda: app(['run', '--help'], standalone_mode=False))\n"
        f"print(sorted({heavy} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


@pytest.mark.parametrize("what", ["procedures", "imus", "tables", "methods"])
def test_lists(run, what):
    ids = list(ESTIMATORS) if what == "methods" else catalogue.ids(what)
    rows = run("list", what, "--json").json
    assert [row["id"] for row in rows] == ids
    shown = run("list", what)
    assert shown.code == 0
    lines = [line.split() for line in shown.out.splitlines()]
    for name in ids:
        assert [name] in [line[:1] for line in lines]


def test_the_list_of_methods_explains_its_sources(run):
    shown = " ".join(run("list", "methods").out.split())
    for letter, paper in SOURCES.items():
        assert f"[{letter}] {paper}" in shown
    assert "[S0] Autonomous initial orientation without integration" in shown
    units = run("list", "imus").out
    assert "[S0]" not in units
    assert "evidence: A the maker's document" in units


# --- run


def test_result_has_what_its_readers_expect(recorded):
    assert sorted(p.name for p in recorded.folder.iterdir()) == FILES
    result = json.loads((recorded.folder / "result.json").read_text(encoding="utf-8"))
    assert recorded.printed == result | {"out": str(recorded.folder)}
    assert result["procedure"] == "short"
    assert (result["imu"], result["table"]) == ("ring-laser", "laboratory")
    assert (result["seed"], result["rate_hz"], result["sampling"]) == (3, 20, "mean")
    assert result["latitude_deg"] == pytest.approx(48.5, rel=1e-15)
    assert result["gravity_m_s2"] == pytest.approx(9.8093587, abs=5e-8)
    # 12 s, a slew of 90 deg at up to 200 deg/s that ends on a whole second, 12 s
    assert result["duration_s"] == pytest.approx(26, abs=1e-9)  # a sum of a dozen durations
    assert result["samples"] == 520
    assert {"stand_version", "mujoco_version"} <= set(result["versions"])
    found = [(e["method"], e.get("window"), e["label"]) for e in result["estimates"]]
    assert found == [
        ("six-position", "same", "Y1 up"),
        ("six-position", "fresh", "Y1 up"),
        ("six-position", "same", "X1 up"),
        ("six-position", "fresh", "X1 up"),
        ("rk4", None, "Y1 up"),
        ("rk4", None, "X1 up"),
        ("triad", None, "Y1 up"),
        ("triad", None, "X1 up"),
    ]
    spreads = [(s["method"], s["window"], s["reference"]) for s in result["spreads"]]
    assert ("triad", "", "truth") in spreads
    assert ("six-position", "fresh", "nominal") in spreads


def test_every_estimate_is_complete(recorded):
    for e in recorded.printed["estimates"]:
        vertical = e["label"] == "X1 up"
        assert (0.0, 14.0)[vertical] <= e["t_from_s"] < e["t_to_s"] <= (12.0, 26.0)[vertical]
        assert e["sequence"] == ("yaw-roll-pitch" if vertical else "yaw-pitch-roll")
        assert (e["heading_deg"] is None) is vertical
        assert ("latitude_deg" in e) is (e["method"] == "triad")
        for angle in ("roll", "yaw", "pitch"):
            # the run's truth and what the table was told are one here
            assert abs(e[f"{angle}_deg"] - (90 if vertical and angle == "pitch" else 0)) < 30
            assert e[f"error_{angle}_deg"] == pytest.approx(
                e[f"error_nominal_{angle}_deg"], abs=1e-12
            )
            assert (f"sigma_{angle}_deg" in e) is (e.get("window") != "same")
        if not vertical:
            assert 0 <= e["heading_deg"] < 360
            error = (e["heading_deg"] + 180) % 360 - 180
            assert error == pytest.approx(e["error_heading_deg"], abs=1e-12)
        if e.get("window") == "same":
            assert max(abs(e[f"error_{a}_deg"]) for a in ("roll", "yaw", "pitch")) < 1e-9
            assert "zero by construction" in e["flags"][0]


def test_errors_are_of_the_size_their_sigmas_say(recorded):
    for e in recorded.printed["estimates"]:
        if e["method"] == "triad" or e.get("window") == "same":
            continue  # triad's sigma leaves biases out; same-window is zero
        for angle in ("roll", "yaw", "pitch"):
            assert abs(e[f"error_{angle}_deg"]) < 5 * e[f"sigma_{angle}_deg"]


def test_the_recording_says_how_it_was_made(recorded):
    record = read_metadata(recorded.folder / "run.mcap")
    assert record["run"]["seed"] == "3"
    assert record["procedure"]["toml"] == recorded.procedure.read_text(encoding="utf-8")
    assert record["imu"]["toml"] == load_imu("ring-laser").text
    assert [s["label"] for s in json.loads(record["schedule"]["json"])] == [
        "Y1 up",
        "to X1 up",
        "X1 up",
    ]
    assert len(read_imu(recorded.folder / "run.mcap")) == 520
    assert len(read_truth(recorded.folder / "run.mcap")) == 520


def test_same_seed_same_bytes_and_another_seed_others(run, short, recorded):
    options = ("--imu", "ring-laser", "--rate", 20)
    assert run("run", short, *options, "--seed", 3, "--out", "again").code == 0
    assert run("run", short, *options, "--seed", 4, "--out", "other").code == 0
    first = (recorded.folder / "run.mcap").read_bytes()
    assert Path("again/run.mcap").read_bytes() == first
    assert Path("other/run.mcap").read_bytes() != first
    theirs = json.loads((recorded.folder / "result.json").read_text())
    assert json.loads(Path("again/result.json").read_text()) == theirs


def test_an_ideal_unit_finds_everything(run, short):
    outcome = run("run", short, "--imu", "ideal", "--rate", 20, "--latitude", -33, "--json")
    assert outcome.code == 0
    assert outcome.json["out"] == "recordings/short_ideal_seed0"
    assert sorted(p.name for p in Path(outcome.json["out"]).iterdir()) == FILES
    assert [p.name for p in Path("recordings").iterdir()] == ["short_ideal_seed0"]
    for e in outcome.json["estimates"]:
        # rounding of a sum of 240 samples over Earth rate, 1e-19 / 5e-5 rad; rk4's truncation less
        assert max(abs(e[f"error_{a}_deg"]) for a in ("roll", "yaw", "pitch")) < 1e-9
        assert e.get("latitude_deg", -33) == pytest.approx(-33, abs=1e-9)


def test_what_a_person_sees(run, short):
    outcome = run("run", short, "--rate", 20, "--out", "here")
    assert outcome.code == 0
    assert outcome.err == ""
    assert outcome.out.startswith("Short test: Safran STIM300, 10 g accelerometers, seed 0, 520 ")
    assert "\nReview it: stand view here\n" in outcome.out
    for text in ("six-position, same window", "fresh window", "rk4", "triad"):
        assert text in outcome.out
    assert "published [S0]" not in outcome.out  # it has not the paper's six positions


def test_a_title_may_hold_brackets(run, short):
    text = short.read_text().replace('"Short test"', '"[/bold] 1"').replace('"Y1 up"', '"[red]Y"')
    short.write_text(text)
    outcome = run("run", short, "--rate", 20, "--out", "h[1]")
    assert outcome.code == 0
    assert outcome.out.startswith("[/bold] 1: ")
    assert " [red]Y " in outcome.out
    assert "stand view 'h[1]'\n" in outcome.out


def test_instants_differ_from_means_while_moving(run, short, recorded):
    options = ("--imu", "ideal", "--rate", 20, "--sampling", "instant", "--out", "instant")
    assert run("run", short, *options).code == 0
    assert run("run", short, *options[:4], "--out", "mean").code == 0
    instant, mean = (read_truth(Path(name) / "run.mcap") for name in ("instant", "mean"))
    at_rest = slice(0, 240)
    np.testing.assert_array_equal(instant.w_ib_b[at_rest], mean.w_ib_b[at_rest])
    assert np.abs(instant.w_ib_b - mean.w_ib_b).max() > 1e-2  # 200 deg/s^2 over half of 50 ms
    # a few instants are evaluated one by one, ends of means by curves: rounding of some 1e-16 apart
    np.testing.assert_allclose(instant.q_wb, mean.q_wb, rtol=0, atol=2e-15)


# --- the folder


def test_an_existing_recording_stays(refused, run, short):
    assert run("run", short, "--rate", 20, "--out", "here").code == 0
    told = refused("run", short, "--rate", 20, "--seed", 1, "--out", "here")
    assert told == "--out here: a recording is there; --force replaces it"


def test_force_replaces_a_recording(run, short, tmp_path):
    assert run("run", short, "--rate", 20, "--out", "here").code == 0
    first = Path("here/run.mcap").read_bytes()
    Path("here/note.txt").write_text("of the old run")
    outcome = run("run", short, "--rate", 20, "--seed", 1, "--out", "here", "--force")
    assert outcome.code == 0
    assert sorted(p.name for p in Path("here").iterdir()) == FILES
    assert Path("here/run.mcap").read_bytes() != first
    assert sorted(p.name for p in tmp_path.iterdir()) == ["here", "short.toml"]


def test_an_empty_folder_is_used(run, short):
    Path("here").mkdir()
    assert run("run", short, "--rate", 20, "--out", "here").code == 0
    assert sorted(p.name for p in Path("here").iterdir()) == FILES


def test_force_follows_a_link_to_a_recording(run, short, tmp_path):
    assert run("run", short, "--rate", 20, "--out", "here").code == 0
    Path("link").symlink_to("here")
    assert run("run", short, "--rate", 20, "--seed", 1, "--out", "link", "--force").code == 0
    assert Path("link").is_symlink()
    assert json.loads(Path("here/result.json").read_text())["seed"] == 1
    assert sorted(p.name for p in tmp_path.iterdir()) == ["here", "link", "short.toml"]


@pytest.mark.parametrize("force", [(), ("--force",)])
def test_what_is_no_recording_is_never_deleted(refused, short, force):
    Path("mine").mkdir()
    Path("mine/thesis.txt").write_text("years of work")
    told = refused("run", short, "--rate", 20, "--out", "mine", *force)
    assert told == "--out mine: exists and is not a recording; choose another folder"
    assert "is not a recording" in refused("run", short, "--out", "mine/thesis.txt", *force)


@pytest.mark.parametrize("out", [".", "..", "/"])
def test_a_folder_without_a_name_is_refused(refused, short, out):
    told = refused("run", short, "--rate", 20, "--out", out, "--force")
    assert told == f"--out {out}: must name a folder of its own"


def test_a_folder_below_a_file_is_refused(refused, short):
    told = refused("run", short, "--rate", 20, "--out", "short.toml/here")
    assert told == "--out short.toml/here: cannot write there: short.toml is no folder"


def test_a_failure_on_the_way_leaves_nothing(refused, short, monkeypatch):
    """The disk fills while the result is written: the last thing before the folder is renamed."""
    from stand import recorded_run as session

    def full(*arguments: object) -> str:
        raise OSError(28, "No space left on device", "run.rrd")

    monkeypatch.setattr(session, "report_document", full)
    told = refused("run", short, "--rate", 20, "--out", "here")
    assert told == "run.rrd: No space left on device"


def test_a_failure_on_the_way_keeps_the_old_recording(run, short, monkeypatch, tmp_path):
    from stand import recorded_run as session

    assert run("run", short, "--rate", 20, "--out", "here").code == 0
    before = contents(Path("here"))
    monkeypatch.setattr(session, "result_json", lambda result: 1 / 0)
    with pytest.raises(ZeroDivisionError):  # a fault of ours keeps its traceback
        run("run", short, "--rate", 20, "--seed", 1, "--out", "here", "--force")
    assert contents(Path("here")) == before
    assert sorted(p.name for p in tmp_path.iterdir()) == ["here", "short.toml"]


def test_interrupted(run, short, monkeypatch, tmp_path):
    from stand import recorded_run as session

    def stop(*arguments: object) -> str:
        raise KeyboardInterrupt

    monkeypatch.setattr(session, "report_document", stop)
    outcome = run("run", short, "--rate", 20, "--out", "here")
    assert (outcome.code, outcome.err) == (130, "stand: interrupted: nothing was written\n")
    assert [p.name for p in tmp_path.iterdir()] == ["short.toml"]


# --- bad input to run


@pytest.mark.parametrize(
    ("options", "line"),
    [
        (("--rate", 0), "rate = 0 Hz: must be 1 to 10000"),
        (("--rate", 10001), "rate = 10001 Hz: must be 1 to 10000"),
        (("--rate", -5), "rate = -5 Hz: must be 1 to 10000"),
        (("--seed", -1), "seed = -1: must be 0 or more"),
        (("--latitude", 95), "latitude = 95 deg: must be -90 to 90"),
        (("--latitude", "nan"), "latitude = nan deg: must be -90 to 90"),
        (("--latitude", "-inf"), "latitude = -inf deg: must be -90 to 90"),
        (("--height", "inf"), "height = inf m: must be -1000 to 10000"),
        (("--height", 20000), "height = 20000 m: must be -1000 to 10000"),
        (
            ("--latitude", 90),
            "latitude 90.0000 deg: heading is undefined within 0.06 deg of a pole",
        ),
        (("--table", "laboratry"), "unknown table 'laboratry': did you mean laboratory? known: "),
        (("--imu", "stim30"), "unknown imu 'stim30': did you mean stim300? known: "),
        (("--imu", "none.toml"), "none.toml: cannot read this imu: No such file or directory"),
    ],
)
def test_values_that_are_refused(refused, short, options, line):
    assert refused("run", short, *options).startswith(line)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--rate", "50.5"), ["--rate", "integer"]),
        (("--rate", "fast"), ["--rate", "integer"]),
        (("--seed", "x"), ["--seed", "integer"]),
        (("--latitude", "north"), ["--latitude", "number"]),
        (("--sampling", "median"), ["--sampling", "'median'", "'mean'", "'instant'"]),
        (("--sequences", "odd"), ["--sequences", "'odd'", "'regular'", "'published'"]),
        (("--bogus",), ["No such option", "--bogus"]),
        (("--rat", "5"), ["No such option", "--rat", "--rate"]),
        (("more",), ["unexpected", "more"]),
        (("--out",), ["--out", "requires an argument"]),
    ],
)
def test_options_that_are_refused(refused, short, options, words):
    told = refused("run", short, *options)
    assert [word for word in words if word not in told] == []


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("run",), ["Missing argument", "procedure"]),
        (("rnu",), ["No such command", "rnu", "run"]),
        (("run", "six-postion"), ["unknown procedure 'six-postion'", "did you mean six-position"]),
        (("run", "none.toml"), ["none.toml: cannot read this procedure"]),
        (("run", ""), ["unknown procedure ''"]),
        (("list",), ["Missing argument"]),
        (("list", "gyros"), ["'gyros'", "'imus'"]),
        (("view", "nowhere"), ["nowhere"]),
        (("align",), ["Missing argument"]),
        (("align", "none.mcap"), ["none.mcap"]),
        (("import", "none.csv", *UNITS, "--out", "x.mcap"), ["none.csv: no such file"]),
        (("import", "none.csv", "--out", "x.mcap"), ["none.csv: no such file"]),
        (("import", "none.csv", "--columns", "t"), ["missing --out"]),
    ],
)
def test_commands_that_are_refused(refused, arguments, words):
    told = refused(*arguments)
    assert [word for word in words if word not in told] == []


@pytest.mark.parametrize(
    ("old", "new", "line"),
    [
        ('kind = "move"', 'kind = "spin"', "step 2 \"to X1 up\", kind = 'spin': must be one of "),
        (
            "duration_s = 12",
            "duration_s = -12",
            'step 1 "Y1 up", duration_s = -12: must be greater',
        ),
        ("duration_s = 12", "duration_s = nan", 'step 1 "Y1 up", duration_s = nan: must be a fin'),
        (
            "attitude_deg = { pitch = 90 }",
            "joints_deg = { base_pitch = 40 }",
            'step 2 "to X1 up", joints_deg, base_pitch = 40.0: '
            "table laboratory allows -15 to 15 deg on base_pitch",
        ),
        (
            "attitude_deg = { pitch = 90 }",
            "joints_deg = { outer = 40 }\nrate_deg_s = 1000",
            'step 2 "to X1 up", rate_deg_s = 1000.0: table laboratory allows up to 200 on outer',
        ),
        (
            "[site]",
            'table = "labratory"\n[site]',
            "table: unknown table 'labratory': did you mean ",
        ),
        ("[site]", "[site", "not valid TOML: "),
        ('"triad"]', '"traid"]', "estimate, methods: unknown method 'traid': did you mean triad? "),
    ],
)
def test_procedures_that_are_refused(refused, short, old, new, line):
    short.write_text(short.read_text().replace(old, new))
    assert refused("run", short, "--out", "here").startswith(f"{short}: {line}")


def test_a_dwell_shorter_than_a_sample(refused, short):
    text = short.read_text().replace('"six-position", "rk4", ', "")
    short.write_text(text.replace("duration_s = 12", "duration_s = 0.01", 1))
    told = refused("run", short, "--rate", 20, "--out", "here")
    assert "Y1 up" in told


def test_a_move_slower_than_ruckig_can(refused, short):
    slow = "attitude_deg = { pitch = 90 }\nrate_deg_s = 0.01"
    short.write_text(short.read_text().replace("attitude_deg = { pitch = 90 }", slow))
    told = refused("run", short, "--rate", 1, "--out", "here")
    assert told.startswith(f'{short}: step 2 "to X1 up"')


# --- align


def comparable(estimates: list[dict]) -> list[dict]:
    return sorted(estimates, key=lambda e: (e["method"], e["label"], e.get("window", "")))


def test_align_gives_what_the_run_gave(run, recorded):
    """The recording is bit-exact, but metadata and stamps pass through decimal text and ns."""
    printed = run("align", recorded.folder, "--json").json
    assert printed["topic"] == "/imu/data"
    assert printed["latitude_deg"] == pytest.approx(48.5, rel=1e-15)
    pairs = zip(
        comparable(printed["estimates"]), comparable(recorded.printed["estimates"]), strict=True
    )
    for theirs, ours in pairs:
        assert set(theirs) == set(ours)
        for key, value in ours.items():
            near = pytest.approx(value, abs=1e-9) if isinstance(value, float) else value
            assert theirs[key] == near, key
    assert len(printed["spreads"]) == len(recorded.printed["spreads"])


def test_align_by_one_method_and_for_a_person(run, recorded):
    printed = run("align", recorded.folder / "run.mcap", "--method", "triad", "--json").json
    assert {e["method"] for e in printed["estimates"]} == {"triad"}
    outcome = run("align", recorded.folder, "--method", "triad")
    assert outcome.code == 0
    assert outcome.out.startswith("triad [deg]: ")
    assert "six-position" not in outcome.out


def test_align_a_stretch(run, recorded):
    options = ("--method", "triad", "--from", 2, "--to", 9.5, "--json")
    (estimate,) = run("align", recorded.folder, *options).json["estimates"]
    assert (estimate["t_from_s"], estimate["t_to_s"]) == (2.0, 9.5)
    assert estimate["label"] == "Y1 up"
    imu = read_imu(recorded.folder / "run.mcap")
    rows = slice(40, 190)  # samples that end in (2, 9.5] s at 20 Hz
    w, f = imu.w_ib_b[rows].mean(axis=0), imu.f_b[rows].mean(axis=0)
    north = np.cross(f, np.cross(w, f))
    heading = (
        np.degrees(
            np.arctan2(
                np.cross(w, f)[0] / np.linalg.norm(np.cross(w, f)), north[0] / np.linalg.norm(north)
            )
        )
        % 360
    )
    assert estimate["heading_deg"] == pytest.approx(heading, abs=1e-9)
    assert "error_yaw_deg" in estimate


def test_align_with_another_latitude(run, recorded):
    options = ("--method", "six-position", "--json", "--latitude", 30)
    printed = run("align", recorded.folder, *options).json
    assert printed["latitude_deg"] == pytest.approx(30, rel=1e-15)
    fresh = [e for e in printed["estimates"] if e["window"] == "fresh"]
    ours = [e for e in recorded.printed["estimates"] if e.get("window") == "fresh"]
    assert all(abs(a["yaw_deg"] - b["yaw_deg"]) > 1e-6 for a, b in zip(fresh, ours, strict=True))


@pytest.mark.parametrize(
    ("options", "line"),
    [
        (("--method", "traid"), "unknown method 'traid': did you mean triad? known: "),
        (("--latitude", 95), "latitude = 95 deg: must be -90 to 90"),
        (("--latitude", "nan"), "latitude = nan deg: must be -90 to 90"),
        (
            ("--from", 50),
            "{}: from 50.000 to 26.000 s: must be a stretch within the recording's 0.000",
        ),
        (("--from", "nan"), "{}: from nan to 26.000 s: must be a stretch"),
        (("--from", 9, "--to", 3), "{}: from 9.000 to 3.000 s: must be a stretch"),
        (("--from", 0, "--to", 27), "{}: from 0.000 to 27.000 s: must be a stretch"),
        (("--topic", "/imu/dat"), "{}: unknown sensor_msgs/msg/Imu topic '/imu/dat': did you mea"),
        (
            ("--from", 1, "--to", 3, "--method", "rk4"),
            "{}: Y1 up: 2.0 s of rest, the zero offsets need",
        ),
        (("--from", 10, "--to", 20, "--method", "triad"), "{}: run: not at rest near 1"),
    ],
)
def test_align_refuses(refused, recorded, options, line):
    told = refused("align", recorded.folder, *options)
    assert told.startswith(line.format(recorded.folder / "run.mcap"))


def test_align_of_two_recordings(run, refused, tmp_path):
    up = write_log(tmp_path / "up.mcap", level_rows())
    turned = level_rows()
    turned[:, [2, 3, 5, 6]] *= -1  # half a turn about X1: Y1 down
    down = write_log(tmp_path / "down.mcap", turned)
    printed = run("align", up, down, "--method", "triad", "--json").json
    assert [e["label"] for e in printed["estimates"]] == ["up", "down", "up + down"]
    pair = printed["estimates"][2]
    # the latitude whose sine is 11.26509 / 15.041067
    assert pair["latitude_deg"] == pytest.approx(48.5, abs=1e-4)
    assert refused("align", up, up) == (
        "two dwells are called 'up': give each recording its own name"
    )


# --- import


def test_import_and_align_of_a_log_without_latitude(run, refused, tmp_path):
    rows = level_rows()
    log = write_csv(tmp_path / "log.csv", rows)
    facts = run("import", log, *UNITS, "--out", "log.mcap", "--json").json
    assert (facts["out"], facts["samples"]) == ("log.mcap", 400)
    assert facts["rate_hz"] == pytest.approx(10, abs=1e-3)  # stamps jitter by 2 ms in 40 s
    assert facts["mean_rate_deg_h"] == pytest.approx(15.04107, abs=1e-4)
    assert facts["mean_force_m_s2"] == pytest.approx(9.8093587, abs=1e-12)
    imu = read_imu(tmp_path / "log.mcap")
    np.testing.assert_array_equal(imu.w_ib_b, rows[:, 1:4])
    printed = run("align", "log.mcap", "--json").json
    (estimate,) = printed["estimates"]
    assert (printed["latitude_deg"], estimate["method"], estimate["label"]) == (
        None,
        "triad",
        "log",
    )
    assert (estimate["heading_deg"] + 180) % 360 - 180 == pytest.approx(0, abs=1e-6)
    assert estimate["latitude_deg"] == pytest.approx(48.5, abs=1e-4)
    assert not [key for key in estimate if key.startswith("error")]
    for method in ("six-position", "rk4"):
        told = refused("align", "log.mcap", "--method", method)
        assert told == f"log.mcap: method {method} needs the latitude: give --latitude DEG"
        options = ("--method", method, "--latitude", 48.5, "--json")
        estimates = run("align", "log.mcap", *options).json["estimates"]
        assert all(abs(e["yaw_deg"]) < 1e-6 for e in estimates)
        assert all("heading 0" in e["flags"][0] for e in estimates)


def test_import_tells_a_person_what_it_found(run, tmp_path):
    log = write_csv(tmp_path / "log.csv", level_rows())
    outcome = run("import", log, *UNITS, "--out", "log.mcap")
    assert outcome.code == 0
    assert outcome.out.startswith("log.mcap: 400 samples from 0.")
    assert "15.04 deg/h (Earth: 15.04), mean specific force 9.80936 m/s^2" in outcome.out
    assert outcome.out.endswith("Align it: stand align log.mcap\n")


def test_import_replaces_only_when_told(run, refused, tmp_path):
    log = write_csv(tmp_path / "log.csv", level_rows())
    assert run("import", log, *UNITS, "--out", "x.mcap").code == 0
    assert refused("import", log, *UNITS, "--out", "x.mcap") == (
        "--out x.mcap: exists; --force replaces it"
    )
    shutil.copy("x.mcap", "old.mcap")
    write_csv(log, level_rows(300))
    assert run("import", log, *UNITS, "--out", "x.mcap", "--force").code == 0
    assert Path("x.mcap").read_bytes() != Path("old.mcap").read_bytes()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["log.csv", "old.mcap", "x.mcap"]


def test_import_never_writes_over_its_source(refused, tmp_path):
    log = write_csv(tmp_path / "log.csv", level_rows())
    assert refused("import", log, *UNITS, "--out", "log.csv", "--force") == (
        "--out log.csv: must be a new file"
    )
    assert refused("import", log, *UNITS, "--out", "none/x.mcap") == (
        "--out none/x.mcap: no folder none"
    )


def test_import_of_a_bad_row_writes_nothing(refused, tmp_path):
    rows = level_rows()
    rows[7, 3] = np.nan
    log = write_csv(tmp_path / "log.csv", rows)
    assert refused("import", log, *UNITS, "--out", "x.mcap") == (
        f"{log}: row 8, column gz = nan: must be finite; leave out rows without a reading"
    )


# --- other people's MCAP


def test_mcap_without_imu_messages(refused, tmp_path):
    with (tmp_path / "talk.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema("std_msgs/msg/String", "ros2msg", b"string data\n")
        channel = writer.register_channel("/chatter", "cdr", schema)
        writer.add_message(channel, 0, b"\0\1\0\0\1\0\0\0\0", 0)
        writer.finish()
    told = refused("align", "talk.mcap")
    assert told.startswith("talk.mcap: no topic with sensor_msgs/msg/Imu")
    assert "/chatter (std_msgs/msg/String)" in told


@pytest.mark.parametrize("keep", [0, 5, 100, 3000, -20, -1])
def test_truncated_mcap(refused, recorded, tmp_path, keep):
    whole = (recorded.folder / "run.mcap").read_bytes()
    (tmp_path / "cut.mcap").write_bytes(whole[:keep])
    assert refused("align", "cut.mcap").startswith("cut.mcap: ")


def test_mcap_whose_stamps_go_back(refused, tmp_path):
    """Two samples whose header stamps are exchanged, in a file that is whole otherwise."""
    log = write_log(tmp_path / "log.mcap", level_rows())
    t_ns = read_imu(log).t_ns.tolist()
    first, second = (stamp_bytes(t) for t in t_ns[100:102])
    with_stamps(log, tmp_path / "back.mcap", {first: second, second: first})
    assert refused("align", "back.mcap") == (
        f"back.mcap: /imu/data: message 101: header stamp {t_ns[100]} ns is not later than "
        f"{t_ns[101]} ns before it; stamps must increase (or try --stamps log)"
    )
    with_stamps(log, tmp_path / "whole.mcap", {})
    assert read_imu(tmp_path / "whole.mcap").t_ns.tolist() == t_ns


def stamp_bytes(t_ns: int) -> bytes:
    """A builtin_interfaces/Time in little-endian CDR."""
    return (t_ns // 10**9).to_bytes(4, "little") + (t_ns % 10**9).to_bytes(4, "little")


def with_stamps(source: Path, out: Path, exchange: dict[bytes, bytes]) -> None:
    """The messages of `source` in a new file, header stamps exchanged."""
    with source.open("rb") as read, out.open("wb") as written:
        reader, writer = make_reader(read), Writer(written)
        writer.start()
        ids: dict[str, int] = {}
        for schema, channel, message in reader.iter_messages():
            assert schema is not None
            if channel.topic not in ids:
                kind = writer.register_schema(schema.name, schema.encoding, schema.data)
                ids[channel.topic] = writer.register_channel(channel.topic, "cdr", kind)
            stamp = message.data[4:12]  # behind the encapsulation
            data = message.data[:4] + exchange.get(stamp, stamp) + message.data[12:]
            writer.add_message(ids[channel.topic], message.log_time, data, message.publish_time)
        writer.finish()


# --- true processes


def test_a_true_process_refuses_in_one_line(tmp_path):
    done = process("run", "six-position", "--imu", "stim30", cwd=tmp_path)
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr.startswith("stand: unknown imu 'stim30': did you mean stim300? known: ")
    assert done.stderr.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_a_true_process_runs_and_aligns(tmp_path, short, recorded):
    options = ("--imu", "ring-laser", "--seed", 3, "--rate", 20, "--out", "here", "--json")
    done = process("run", short, *options, cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert json.loads(done.stdout)["estimates"] == recorded.printed["estimates"]
    assert (tmp_path / "here/run.mcap").read_bytes() == (recorded.folder / "run.mcap").read_bytes()
    done = process("align", "here", "--method", "triad", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith("triad [deg]: ")


def test_the_console_script_is_the_same_command(tmp_path):
    script = Path(sys.executable).with_name("stand")
    done = subprocess.run([script, "--version"], cwd=tmp_path, capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (0, f"stand {stand.__version__}\n")
    assert main.__doc__
