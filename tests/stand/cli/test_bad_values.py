"""Every option and argument of every command with values that are none: found by itself.

Each is refused in one line that names the value or the option, exit code 2, and nothing is left
in the folder. What is a value after all stands in `TAKEN`, with its reason.
"""

import json
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest
import typer
from calibrations import a_record
from procedures import resting

from stand.calibration.file import record_to_json
from stand.cli.app import app, guarded

GROUP: Any = typer.main.get_command(app)
COMMANDS = GROUP.commands
NUMBERS = ("x", "", "-1", "0", "nan", "inf", "-inf", "1e300", "9" * 30)
FILES = ("", "none/none.toml", "folder", "circle", "rubbish.bin", "rest.toml/x")
TARGETS = ("", "rest.toml/x", "circle")
WORDS = ("", "@", "1e300", "nan,nan,nan", "0,0")
WRITTEN = {"--out", "--report", "--keep"}
UNITS = ("--columns", "t,gx,gy,gz,ax,ay,az", "--gyro-unit", "rad/s", "--accel-unit", "m/s^2")

# a line of each command that is taken as it stands, and cheap
LINES = {
    "run": ("run", "rest.toml", "--rate", "5", "--out", "new"),
    "drive": ("drive", "weaving", "--rate", "20", "--out", "new"),
    "align": ("align", "log.csv", *UNITS, "--json"),
    "calibrate": ("calibrate", "log.csv", *UNITS, "--hand-held", "--json"),
    "apply": ("apply", "calibration.json", "log.csv", *UNITS, "--out", "new.mcap"),
    "compare": ("compare", "rest.toml", "--runs", "1", "--rate", "5", "--json"),
    "rehearse": ("rehearse", "rest.toml", "--rate", "5", "--verify", "1"),
    "propose": ("propose", "--heading", "20", "--rate", "5"),
    "campaign": ("campaign", "sweep.toml", "--out", "new"),
    "export": ("export", "log.csv", *UNITS, "--out", "new.csv"),
    "import": ("import", "log.csv", *UNITS, "--out", "new.mcap"),
    "list": ("list", "imus"),
    "allan": ("allan", "log.csv", *UNITS, "--json"),
    "stretches": ("stretches", "log.csv", *UNITS),
    "report": ("report", "log.csv", *UNITS, "--out", "new.html"),
    "film": ("film", "run", "--out", "new.gif"),
    "picture": ("picture", "run", "--at", "1", "--out", "new.png"),
    "recover": ("recover", "folder"),
    "check-imu": ("check-imu", "stim300"),
    "check-table": ("check-table", "precision"),
    "new": ("new", "imu", "new"),
    "view": ("view", "log.csv", *UNITS, "--out", "new.rrd"),
}
OTHER_LINES = {
    ("compare", "other"): ("compare", "log.csv", "log.csv", *UNITS),
    ("campaign", "folder"): ("campaign", "record", "folder", "--case", "1", "--seed", "0"),
}
"""Where an argument stands in a line of another kind."""
REST = resting(6)
SWEEP = 'title = "Some"\nprocedure = "rest.toml"\nimu = "hg9900"\nruns = 1\nrate_hz = 5\n'


def invoke(*line):
    out, err = StringIO(), StringIO()
    with redirect_stdout(out), redirect_stderr(err):
        code = guarded(lambda: GROUP(list(line), standalone_mode=False))
    return code, err.getvalue()


def kinds(param):
    told = param.type_descriptor.annotation
    return {told, *get_args(told)}


def values_of(param):
    found = kinds(param)
    if found & {int, float}:
        return NUMBERS
    if param.opts[0] in WRITTEN:
        return TARGETS
    return FILES if Path in found else WORDS


def line_with(command, param, value):
    """The command's line with this value of that option, or in that argument's place."""
    option = param.opts[0]
    line = list(OTHER_LINES.get((command, option), LINES[command]))
    if not option.startswith("--"):
        at = 1 + [p.opts[0] for p in COMMANDS[command].params].index(option)
        plain = at < len(line) and not line[at].startswith("--")
        line[at : at + plain] = [value]
        return line
    if option in line:
        at = line.index(option)
        del line[at : at + 2]
    return [*line, f"{option}={value}"]


# --- what is a value after all

SIGNED = {"-1", "0"}
LARGE = {"0", "9" * 30}
TAKEN = {
    "--latitude": SIGNED,  # [deg] and [m]: zero and the south, the sea and below
    "--height": SIGNED,
    "--temperature": SIGNED,
    "--gravity-sigma": {"0"},  # as good as known
    "--at": {"0"},  # the first moment
    "--seed": LARGE,  # any whole number
    "--from": SIGNED,  # of a log's times
    "--to": {"1e300", "9" * 30},  # to where it ends
    "--shortest": {"1e300", "9" * 30},  # no stretch is as long
    "--revision": set(WORDS),  # whatever the maker calls it
    "--serial": set(WORDS),
    "--skip-bytes": {"0"},
    "--camera": {"@", "1e300", "0,0"},  # a model's cameras are known where it is drawn
    "name": set(WORDS),
    "place": {"folder"},  # with nothing to recover
}
EMPTY = {"--without", "--methods", "--only", "--terms", "--joints"}
"""Whose default is empty."""
ONE_OF_MANY = "import"
"""How a log is read has the same options everywhere, `test_options` sees that they arrive."""


def cases():
    """Commands and what they take; that which all logs share only where they are imported."""
    shared = {(p.opts[0], p.help) for p in COMMANDS[ONE_OF_MANY].params}
    for command, made in COMMANDS.items():
        for param in made.params:
            own = command == ONE_OF_MANY or (param.opts[0], param.help) not in shared
            if own and not getattr(param, "is_flag", False):
                yield command, param


def taken(param, value):
    option = param.opts[0]
    return value in TAKEN.get(option, ()) or (value == "" and option in EMPTY)


@pytest.fixture(scope="module")
def folder(tmp_path_factory, recorded):
    place = tmp_path_factory.mktemp("bad")
    (place / "run").symlink_to(recorded.folder)
    (place / "rest.toml").write_text(REST, encoding="utf-8")
    (place / "sweep.toml").write_text(SWEEP, encoding="utf-8")
    (place / "rubbish.bin").write_bytes(bytes(range(256)) * 8)
    (place / "folder").mkdir()
    (place / "circle").symlink_to("circle")  # that nobody can read, root neither
    noise = 1e-3 * np.random.default_rng(0).normal(size=(120, 6)) + [0, 0, 0, 0, 9.81, 0]
    (place / "calibration.json").write_text(json.dumps(record_to_json(a_record())), "utf-8")
    np.savetxt(place / "log.csv", np.column_stack([np.arange(1, 121) / 20, noise]), delimiter=",")
    return place


@pytest.mark.parametrize("command", COMMANDS)
def test_values_that_are_none_are_refused_in_one_line(command, folder, monkeypatch):
    monkeypatch.chdir(folder)
    there, wrong = set(folder.rglob("*")), []
    for name, param in cases():
        if name != command:
            continue
        for value in (v for v in values_of(param) if not taken(param, v)):
            line = line_with(command, param, value)
            code, told = invoke(*line)
            wrong += [f"{line}: {why}" for why in amiss(param, value, code, told)]
            wrong += [f"{line}: left {path}" for path in set(folder.rglob("*")) - there]
    assert wrong == []


def amiss(param, value, code, told):
    """What is wrong with how a value was refused."""
    if code != 2:
        yield f"exit code {code}"
    if not (told.startswith("stand: ") and told.endswith("\n") and told.count("\n") == 1):
        yield f"not one line: {told!r}"
    plain = told.lower().replace("-", " ").replace("_", " ")
    parts = {part.strip("-") for part in value.split(",")} - {""} or {"''"}
    words = {word for word in param.opts[0].strip("-").split("-") if len(word) > 3}
    if not any(word in plain for word in parts | words | {param.opts[0], short(value)}):
        yield f"does not name it: {told!r}"


def short(value):
    """The number as messages have it."""
    try:
        return f"{float(value):g}".strip("-")
    except ValueError:
        return value or "empty"


def test_each_command_has_a_line_here():
    assert set(LINES) == set(COMMANDS)
