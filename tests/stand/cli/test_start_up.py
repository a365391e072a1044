"""What a command loads before it answers: of libraries and rooms, those that it uses.

Counted in modules, not in time, which a busy machine stretches. To see the time:
``python -X importtime -m stand align recordings/sample``.
"""

import os
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

from stand.cli.app import app, application, guarded
from stand.unneeded import MODULES

SAMPLE = Path(__file__).resolve().parents[3] / "recordings" / "sample"
TOLD = """
import atexit, sys
atexit.register(lambda: print(*sorted(sys.modules), file=sys.stderr))
from stand.cli import main
main()
"""
ROTATIONS = "import sys, scipy.spatial.transform; print(*sorted(sys.modules), file=sys.stderr)"

# The libraries that this project names, and what takes long; all others come with one of them.
LIBRARIES = {
    *("numpy", "scipy", "mujoco", "rerun", "pyarrow", "ruckig", "mcap", "zstandard", "lz4"),
    *("pydantic", "typer", "rich", "matplotlib", "jinja2", "multiprocessing", "pandas"),
    *("rosbags", "pyulog", "h5py", "allantools", "dask", "glfw"),
}
ROOMS = ("alignment", "stand.physics.truth", "stand.physics.servo", "stand.vehicle.path")
ROOMS = (
    *ROOMS,
    "stand.simulation.settings",
    "stand.recording",
    "stand.rehearsal",
    "stand.report.page",
)
ROOMS = (*ROOMS, "alignment.allan", "stand.evaluation.comparison", "stand.evaluation.published")

# command -> which libraries beside typer it may load, which rooms it may enter
COMMANDS = {
    "--help": (set(), set()),
    "align": (
        # MuJoCo: the stand's model, by which a recording's encoders say where its axes stood
        {"numpy", "scipy", "pydantic", "rich", "mcap", "zstandard", "lz4", "mujoco"},
        {"alignment", "stand.recording"},
    ),
    "rehearse": (
        {"numpy", "scipy", "pydantic", "rich", "mujoco", "ruckig"},
        # the law of quadrature
        {"alignment", "stand.simulation.settings", "stand.rehearsal", "stand.physics.truth"},
    ),
    "run": (
        {"numpy", "scipy", "pydantic", "rich", "mcap", "zstandard", "lz4", "mujoco", "ruckig"}
        | {"rerun", "pyarrow"},  # of the review, which rerun writes by pyarrow
        {"alignment", "stand.simulation.settings", "stand.recording", "stand.physics.truth"}
        | {"stand.physics.servo"},
    ),
}
ARGUMENTS = {
    "--help": [],
    "align": [str(SAMPLE)],
    "rehearse": ["two-position", "--imu", "hg9900", "--table", "precision"],
    "run": ["two-position", "--rate", "1", "--out", "run"],
}


@cache
def loaded(program: str, *arguments: str, cwd: str) -> set[str]:
    """Modules of a child that ran, by name."""
    command = [sys.executable, "-c", program, *arguments]
    found = subprocess.run(command, capture_output=True, text=True, cwd=cwd, check=True)
    return set(found.stderr.splitlines()[-1].split())


def parts_of_scipy(modules: set[str]) -> set[str]:
    return {m.split(".")[1] for m in modules if m.startswith("scipy.")}


@pytest.fixture(params=COMMANDS)
def command(request, tmp_path_factory) -> tuple[str, set[str]]:
    name = request.param
    folder = str(tmp_path_factory.getbasetemp())
    return name, loaded(TOLD, name, *ARGUMENTS[name], cwd=folder)


@pytest.mark.slow
def test_a_command_loads_no_library_that_it_does_not_use(command):
    name, modules = command
    there = {library for library in LIBRARIES if library in modules}
    assert there - {"typer"} - COMMANDS[name][0] == set()


def test_a_command_enters_no_room_that_it_does_not_use(command):
    name, modules = command
    assert {room for room in ROOMS if room in modules} - COMMANDS[name][1] == set()


def test_what_libraries_bring_along_for_nobody_is_not_run(command):
    """Of each the module is there, as libraries import it, and its parts are not."""
    _, modules = command
    parts = {f"{name}." for name in MODULES}
    assert [m for m in modules if any(m.startswith(part) for part in parts)] == []


def test_what_is_put_off_is_there_when_it_is_asked_for():
    code = (
        "import os, sys\nfrom stand.unneeded import put_off_the_unneeded\n"
        "put_off_the_unneeded()\nimport numpy.f2py, numpy.testing\n"
        "print('numpy.f2py.f2py2e' in sys.modules, callable(numpy.f2py.get_include))\n"
        "numpy.testing.assert_array_equal([1], [1])\n"
        "print(os.environ['PYDANTIC_DISABLE_PLUGINS'])"
    )
    own = os.environ | {"PYDANTIC_DISABLE_PLUGINS": "one"}
    for given, told in ((own, "one"), (None, "__all__")):
        done = subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=True, env=given
        )
        assert done.stdout.split() == ["False", "True", told]


@pytest.mark.parametrize("name", ["rehearse", "list"])
def test_a_command_alone_says_what_it_says_among_all(name, capsys):
    told = []
    for made in (application([name]), app):
        for arguments in ([name, "--help"], [name, "--no-such-option"]):
            guarded(lambda made=made, arguments=arguments: made(arguments, standalone_mode=False))
        told.append(capsys.readouterr())
    assert told[0] == told[1]
    assert f" {name} [OPTIONS]" in told[0].out


def test_of_scipy_a_command_loads_what_rotations_bring_along(command, tmp_path):
    """Statistics alone would take half a second, optimisation and integration a fifth each."""
    name, modules = command
    basis = parts_of_scipy(loaded(ROTATIONS, cwd=str(SAMPLE)))
    more = parts_of_scipy(modules) - basis
    assert more == set(), f"{name} loads scipy.{', scipy.'.join(sorted(more))}"
