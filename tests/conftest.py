"""What several tests share: the command line in process, and one short recorded run."""

from stand.threads import set_one_thread

set_one_thread()  # before numpy: workers side by side wait for one another's threads else

# ruff: noqa: E402
import json
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path
from typing import NamedTuple

import pytest
from hypothesis import settings

from stand.cli.app import app, guarded

settings.register_profile("stand", deadline=None, derandomize=True)  # same examples every run
settings.load_profile("stand")

SHORT = """
title = "Short test"
[site]
latitude_deg = 48.5
[estimate]
methods = ["six-position", "rk4", "triad"]
offset_window_s = 4.0
[[step]]
kind = "dwell"
label = "Y1 up"
duration_s = 12
[[step]]
kind = "move"
label = "to X1 up"
attitude_deg = { pitch = 90 }
[[step]]
kind = "dwell"
label = "X1 up"
duration_s = 12
"""


class Outcome(NamedTuple):
    """What a command answered."""

    code: int
    out: str
    err: str

    @property
    def json(self):
        return json.loads(self.out)


class Recorded(NamedTuple):
    """A run of `SHORT`: ring-laser unit, seed 3, 20 Hz."""

    folder: Path
    procedure: Path
    printed: dict


Stand = Callable[..., Outcome]


def invoke(*arguments: object) -> Outcome:
    """`stand ARGUMENTS` in this process."""
    out, err = StringIO(), StringIO()
    with redirect_stdout(out), redirect_stderr(err):
        code = guarded(lambda: app([str(a) for a in arguments], standalone_mode=False))
    return Outcome(code, out.getvalue(), err.getvalue())


@pytest.fixture(scope="session")
def stand_command() -> Stand:
    """The `stand` command as a function of its arguments."""
    return invoke


@pytest.fixture
def short(tmp_path: Path) -> Path:
    """The procedure `SHORT` as a user's file."""
    path = tmp_path / "short.toml"
    path.write_text(SHORT, encoding="utf-8")
    return path


@pytest.fixture(scope="session")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    """One recorded run; read it, never change it."""
    root = tmp_path_factory.mktemp("recorded")
    procedure, folder = root / "short.toml", root / "run"
    procedure.write_text(SHORT, encoding="utf-8")
    options = ("--imu", "ring-laser", "--seed", 3, "--rate", 20, "--out", folder, "--json")
    outcome = invoke("run", procedure, *options)
    assert outcome.code == 0, outcome.err
    return Recorded(folder, procedure, outcome.json)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """From the fast to the slow: what takes more than 2 s comes last."""
    items.sort(key=lambda item: item.get_closest_marker("slow") is not None)


@pytest.fixture
def rows(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """How many states each call of the truth's sensors evaluates, as they come."""
    from stand.physics.hinges import Hinges

    found, sensed = [], Hinges.sensed

    def counted(hinges, joints, rates, accelerations):
        found.append(len(joints))
        return sensed(hinges, joints, rates, accelerations)

    monkeypatch.setattr(Hinges, "sensed", counted)
    return found
