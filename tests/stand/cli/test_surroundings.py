"""What surrounds the command: pipes, links, names, terminals, folders. One line, no waiting."""

import json
import os
import subprocess
import sys

import numpy as np
import pytest

from alignment.errors import AlignmentError
from stand.cli.app import guarded
from stand.columns import cell
from stand.recording.curves import InnovationCurves, innovations_csv
from stand.report.console import console, render
from stand.report.tables import TableData
from stand.threads import VARIABLES, set_one_thread

UNITS = ("--columns", "t,gx,gy,gz,ax,ay,az", "--gyro-unit", "deg/s", "--accel-unit", "m/s^2")


def own_process(*arguments, before="", **options):
    """`stand ARGUMENTS`, after some Python in the same process."""
    code = f"{before}\nfrom stand.cli.app import main; main()"
    command = [sys.executable, "-c", code, *map(str, arguments)]
    options = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE} | options
    return subprocess.run(command, check=False, timeout=120, **options)


@pytest.mark.parametrize("name", ["align", "run", "import", "profile"])
def test_a_pipe_is_no_input(stand_command, tmp_path, name):
    """Opening one that nobody writes to would wait for ever."""
    pipe = tmp_path / "pipe.toml"
    os.mkfifo(pipe)
    step = f'[[step]]\nkind = "profile"\nlabel = "p"\nfile = "{pipe.name}"\n'
    head = 'title = "t"\n[site]\nlatitude_deg = 48.5\n[estimate]\nmethods = []\n'
    (tmp_path / "profile.toml").write_text(head + step)
    arguments = {
        "align": ("align", pipe),
        "run": ("run", pipe),
        "import": ("import", pipe, *UNITS, "--out", tmp_path / "o.mcap"),
        "profile": ("export", tmp_path / "profile.toml", "--out", tmp_path / "o.csv"),
    }[name]
    outcome = stand_command(*arguments)
    assert outcome.code == 2
    assert "pipe.toml: is not a file" in outcome.err
    assert outcome.err.count("\n") == 1


@pytest.mark.parametrize(
    "arguments",
    [
        ("align", "round"),
        ("run", "./round.toml"),
        ("run", "six-position", "--rate", 1, "--out", "round"),
        ("export", "two-position", "--out", "round"),
        ("report", "round"),
        ("import", "log.csv", *UNITS, "--out", "round", "--force"),
    ],
)
def test_links_in_a_circle(stand_command, tmp_path, monkeypatch, arguments):
    monkeypatch.chdir(tmp_path)
    for name in ("round", "round.toml"):
        (tmp_path / name).symlink_to(name)
    (tmp_path / "log.csv").write_text("0,1,2,3,4,5,7\n1,1,2,3,4,5,6\n")
    outcome = stand_command(*arguments)
    assert outcome.code == 2
    assert "round" in outcome.err
    assert outcome.err.count("\n") == 1


@pytest.mark.slow
def test_names_that_are_no_text(stand_command, tmp_path):
    """A folder and a log whose names are not UTF-8: imported, read, refused as any other."""
    folder = tmp_path / os.fsdecode(b"m\xfc\xfc")
    folder.mkdir()
    log = folder / os.fsdecode(b"l\xf6g.csv")
    still = np.tile([2.8e-3, 3.1e-3, 0, 0, 9.8, 0], (50, 1))  # the Earth's rate north and up
    still += 1e-6 * np.random.default_rng(0).normal(size=(50, 6))
    np.savetxt(log, np.column_stack([np.arange(50) / 10, still]), delimiter=",")
    done = own_process("import", log, *UNITS, "--out", folder / "a.mcap")
    assert done.returncode == 0, done.stderr
    assert stand_command("align", folder / "a.mcap", "--latitude", 48.5, "--json").code == 0
    done = own_process("align", folder / "b.mcap")
    assert done.returncode == 2
    assert done.stderr.count(b"\n") == 1


@pytest.mark.slow
def test_a_terminal_of_few_letters(tmp_path):
    ascii_only = os.environ | {"PYTHONIOENCODING": "ascii", "LC_ALL": "C", "PYTHONUTF8": "0"}
    done = own_process("list", "procedures", env=ascii_only)
    assert done.returncode == 0, done.stderr
    assert done.stdout.isascii()
    assert b"six-position" in done.stdout
    done = own_process("align", "σ°.mcap", env=ascii_only)
    assert done.returncode == 2
    assert done.stderr.endswith(b".mcap: no such file\n")


@pytest.mark.parametrize("number", [1, 2])
def test_a_closed_stream(number):
    done = own_process("align", "nowhere.mcap", preexec_fn=lambda: os.close(number))
    assert done.returncode == 2
    assert b"Traceback" not in done.stdout + done.stderr


def test_a_folder_that_is_gone(tmp_path):
    """The shell still stands in it."""
    gone = f"import os; os.mkdir({str(tmp_path / 'gone')!r}); os.chdir({str(tmp_path / 'gone')!r})"
    gone += f"; os.rmdir({str(tmp_path / 'gone')!r})"
    done = own_process("run", "six-position", "--rate", 1, before=gone)
    assert done.returncode == 2
    assert done.stderr.count(b"\n") == 1
    assert done.stderr.endswith(b"No such file or directory\n")


ESCAPE = "\x1b[2J\x07\x9b1m"


def test_no_text_of_a_file_steers_the_terminal(capsys):
    def refuses():
        raise AlignmentError(f"{ESCAPE} is no label")

    assert guarded(refuses) == 2
    assert capsys.readouterr().err == "stand:  [2J  1m is no label\n".replace("  ", " ")
    out = console()
    with out.capture() as shown:
        out.print(render(TableData(ESCAPE, (ESCAPE, "b"), ((ESCAPE, "1"),), notes=(ESCAPE,))))
    assert not set("\x1b\x07\x9b") & set(shown.get())


@pytest.mark.parametrize("label", ["=1+1", "+1", "-1", "@a", " =1", "\t=1"])
def test_no_cell_is_a_formula(label):
    assert cell(label) == f"'{label}"
    assert cell("X1 up") == "X1 up"
    assert cell("") == ""
    one = np.zeros((1, 3))
    text = innovations_csv([InnovationCurves("fine", label, np.array([0]), one, one)])
    assert f'fine,"\'{label}"' in text


def test_labels_of_exported_steps_are_no_formulas(stand_command, short, tmp_path):
    short.write_text(short.read_text().replace("Y1 up", "=1+1"))
    outcome = stand_command("export", short, "--out", tmp_path / "m.csv")
    assert outcome.code == 0, outcome.err
    assert ",'=1+1," in (tmp_path / "m_steps.csv").read_text()
    assert "=1+1" in json.dumps(stand_command("rehearse", short, "--json").json)  # as it is


@pytest.mark.parametrize("what", ["recording", "procedure"])
def test_a_file_is_what_its_name_says(stand_command, recorded, tmp_path, what):
    """Not text under the name of something else, unasked."""
    given = recorded.folder if what == "recording" else "two-position"
    outcome = stand_command("export", given, "--out", tmp_path / "x.foo")
    assert outcome.code == 2
    assert "x.foo: must end in .csv" in outcome.err
    assert outcome.err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []
    assert stand_command("export", given, "--out", tmp_path / "x.foo", "--format", "csv").code == 0


@pytest.mark.parametrize("limit", ["few descriptors", "little memory"])
def test_what_the_system_does_not_give(tmp_path, limit):
    """No traceback and nothing half done, whatever is left to the command."""
    resource = pytest.importorskip("resource")
    log = tmp_path / "log.csv"
    rng = np.random.default_rng(0)
    rows = np.column_stack([np.arange(50) / 10, 1e-3 * rng.normal(size=(50, 6))])
    np.savetxt(log, rows, delimiter=",")
    which, most = {
        "few descriptors": ("RLIMIT_NOFILE", 20),
        "little memory": ("RLIMIT_AS", 2**29),
    }[limit]

    def limited():
        resource.setrlimit(getattr(resource, which), (most, most))

    out = tmp_path / "o.mcap"
    done = own_process("import", log, *UNITS, "--out", out, preexec_fn=limited)
    assert b"Traceback" not in done.stderr, done.stderr
    assert done.returncode in (0, 2)
    assert out.exists() == (done.returncode == 0)
    assert done.returncode == 0 or done.stderr.count(b"\n") == 1


@pytest.mark.parametrize(
    ("asked", "has"),
    [({}, "1"), ({"OMP_NUM_THREADS": "3"}, None), ({"MKL_NUM_THREADS": "2"}, None)],
)
def test_linear_algebra_has_one_thread_where_nobody_asked_for_more(monkeypatch, asked, has):
    monkeypatch.setattr(os, "environ", dict(asked))
    set_one_thread()
    assert os.environ.get("OPENBLAS_NUM_THREADS") == has
    assert os.environ.get("OMP_NUM_THREADS") == asked.get("OMP_NUM_THREADS")  # our own threads'


def test_a_command_has_one_thread_of_linear_algebra():
    before = (
        "import atexit, os, sys\n"
        "seen = lambda: print(os.environ.get('OPENBLAS_NUM_THREADS'), file=sys.stderr)\n"
        "atexit.register(seen)"
    )
    own = {name: value for name, value in os.environ.items() if name not in VARIABLES}
    assert own_process("--version", before=before, env=own).stderr.split() == [b"1"]
