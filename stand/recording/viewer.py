"""The rerun viewer as a program: found, kept quiet and bound to this machine."""

import importlib.util
import os
import shutil
import subprocess
from pathlib import Path

from stand.errors import StandError

LOOPBACK = "127.0.0.1"
KINDS = (".rrd", ".mcap")


def view(path: str | os.PathLike[str], *, browser: bool = False) -> None:
    """Open a recording in the rerun viewer and wait until the viewer is closed.

    Parameters
    ----------
    path : path
        An .rrd or .mcap.
    browser : bool
        In the web browser instead of a window.

    Raises
    ------
    StandError
        No such file, not a recording, no viewer installed, or the viewer failed.
    """
    recording = checked_recording(path)
    options = ["--web-viewer", "--web-viewer-port", "0"] if browser else []
    # A new viewer: an old one on the usual port may be of another version or bound elsewhere.
    command = [viewer_binary(), "--bind", LOOPBACK, "--port", "auto", *options, str(recording)]
    # In a browser its messages are for the person: they hold the address.
    heard = None if browser else subprocess.PIPE
    done = subprocess.run(command, env=quiet_environment(), stderr=heard, text=True, check=False)
    if done.returncode > 0:
        raise StandError(f"{recording}: the rerun viewer failed: {_reason(done.stderr or '')}")


def checked_recording(path: str | os.PathLike[str]) -> Path:
    """The path, if a recording lies there; else a StandError."""
    recording = Path(path)
    if not recording.is_file():
        raise StandError(f"{recording}: no such file")
    if recording.suffix not in KINDS:
        raise StandError(f"{recording}: not a recording, must end in {' or '.join(KINDS)}")
    return recording


def viewer_binary() -> str:
    """The viewer itself: the one that came with the package, or the first on the path.

    Not the launcher script of the same name, which would leave the viewer running when ended.
    """
    package = importlib.util.find_spec("rerun_cli")
    folders = list(package.submodule_search_locations or []) if package else []
    found = shutil.which("rerun", path=os.pathsep.join(folders)) or shutil.which("rerun")
    if found is None:
        raise StandError("no rerun viewer found: pip install 'rerun-sdk>=0.41,<0.42'")
    return found


def quiet_environment() -> dict[str, str]:
    """This environment, with which rerun sends no analytics and writes none to the home folder.

    There is no switch of its own for that (only a lasting one, in a file of the home folder):
    `CI` is what rerun looks at, and `RERUN_APP_ONLY` spares the question about it.
    """
    return os.environ | {"CI": "true", "RERUN_APP_ONLY": "true"}


def _reason(stderr: str) -> str:
    """The line that says what went wrong: the last with 'error', else the last."""
    if "WAYLAND_DISPLAY" in stderr:
        return "no screen here: give --browser, or copy it to a machine with a screen"
    lines = [line.strip() for line in stderr.splitlines() if line.strip()]
    telling = [line for line in lines if "error" in line.lower()] or lines
    return telling[-1] if telling else "no message"
