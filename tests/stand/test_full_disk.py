"""A disk that fills: exit code 2, one line with the file, nothing left, and soon, at every size.

Each command writes to a small file system in memory, whose size is chosen around what the command
needs: nothing, half, a page too little, enough. `STAND_DISK_SWEEP=1` tries a whole run at every
half megabyte from 5 to 40 MB instead of a short one, and the other commands at 16 sizes.
"""

import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from conftest import Outcome, Recorded, Stand

SWEEP = os.environ.get("STAND_DISK_SWEEP", "") not in ("", "0")
PAGE_KB = os.sysconf("SC_PAGE_SIZE") // 1024
ROOM_KB = 100 * 1024
SOON_S = 30.0
QUICK = ("drive", "import", "export")  # tried at more sizes
COMMANDS = ("drive", "import", "export", "report", "rehearse", "compare", "allan")

pytestmark = pytest.mark.slow

Check = Callable[[Outcome, Path], None]


@contextmanager
def disk(place: Path, size_kb: int) -> Iterator[Path]:
    """A file system of its own, or the test is skipped: mounting needs to be permitted."""
    place.mkdir(exist_ok=True)
    command = ["mount", "-t", "tmpfs", "-o", f"size={size_kb}k", "tmpfs", str(place)]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    except FileNotFoundError:
        pytest.skip("no mount here")
    if done.returncode:
        pytest.skip(f"mount is not permitted: {done.stderr.strip()}")
    try:
        yield place
    finally:
        subprocess.run(["umount", "-l", str(place)], check=True)


def own_process(*arguments: object) -> Outcome:
    """`stand ARGUMENTS` in a process of its own: what its threads print or wait for counts."""
    command = [sys.executable, "-c", "from stand.cli.app import main; main()", *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=600)
    return Outcome(done.returncode, done.stdout, done.stderr)


def used_kb(folder: Path) -> int:
    stats = os.statvfs(folder)
    return (stats.f_blocks - stats.f_bfree) * stats.f_frsize // 1024


def sizes(name: str, need: int) -> list[int]:
    """From nothing to a page less than what is needed."""
    tried = np.linspace(0, 1, 16) if SWEEP else (0.0, 0.5, 1.0) if name in QUICK else (0.0, 1.0)
    return sorted({max(int(part * (need - PAGE_KB)), PAGE_KB) for part in tried})


def soon(
    place: Path, size_kb: int, limit: float, command: Callable[[Path], Outcome], check: Check
) -> None:
    """On a disk of that size the command ends within `limit` [s], and `check` holds then.

    On a busy machine it may take longer, though not three times in a row: a command that waits for
    a full disk never ends.
    """
    took = 0.0
    for _ in range(3):
        with disk(place, size_kb) as out:
            begin = time.monotonic()
            outcome = command(out)
            took = time.monotonic() - begin
            check(outcome, out)
        if took < limit:
            return
    raise AssertionError(f"{took:.0f} s with {size_kb} kB")


def check_full(outcome: Outcome, folder: Path, *, told: str) -> None:
    assert outcome.code == 2, outcome.err
    assert outcome.err.count("\n") == 1, outcome.err
    assert told in outcome.err
    assert outcome.err.endswith(": No space left on device\n")
    assert list(folder.iterdir()) == []


@pytest.fixture(scope="module")
def log(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("log") / "log.csv"
    rng = np.random.default_rng(0)
    w, f = rng.normal(size=(2, 4000, 3)) * 1e-3
    rows = np.column_stack([np.arange(4000) / 100, w, f + np.array([9.8, 0, 0])])
    np.savetxt(path, rows, delimiter=",")
    return path


@pytest.mark.parametrize("name", COMMANDS)
def test_a_command_on_a_full_disk(
    stand_command: Stand, recorded: Recorded, log: Path, tmp_path: Path, name: str
):
    told = {  # a file of each; of several any may be the one
        "drive": "run/",
        "import": "log.mcap",
        "export": "two",
        "report": "run.html",
        "rehearse": "report/",
        "compare": "compare/compare.png",
        "allan": "allan/allan",
    }[name]
    columns = ("--columns", "t,gx,gy,gz,ax,ay,az", "--gyro-unit", "deg/s", "--accel-unit", "m/s^2")

    def command(out: Path) -> Outcome:
        return stand_command(
            *{
                "drive": ("drive", "weaving", "--rate", 20, "--out", out / "run"),
                "import": ("import", log, *columns, "--out", out / "log.mcap"),
                "export": ("export", recorded.procedure, "--out", out / "two.csv"),
                "report": ("report", recorded.folder, "--out", out / "run.html"),
                "rehearse": ("rehearse", recorded.procedure, "--report", out / "new/report"),
                "compare": (
                    *("compare", recorded.procedure, "--rate", 5, "--runs", 1),
                    *("--methods", "triad", "--out", out / "new/compare"),
                ),
                "allan": ("allan", recorded.folder, "--to", 12, "--out", out / "new/allan"),
            }[name]
        )

    begin = time.monotonic()
    with disk(tmp_path / "disk", ROOM_KB) as out:
        assert command(out).code in (0, 1)  # a rehearsal may not be feasible
        need = used_kb(out)
    # as much longer where the machine is busy; a command that waits for the disk never ends
    limit = SOON_S + 2 * (time.monotonic() - begin)
    for size in sizes(name, need):
        check = partial(check_full, told=told)
        soon(tmp_path / "disk", size, limit, command, check)
    if SWEEP or name in QUICK:
        with disk(tmp_path / "disk", need) as out:
            assert command(out).code in (0, 1)


def test_a_run_on_a_full_disk(short: Path, tmp_path: Path):
    """Samples, review and result: each file's end is one of the sizes."""
    what = ("six-position", "--rate", 200) if SWEEP else (short, "--rate", 100)

    def command(out: Path) -> Outcome:
        return own_process("run", *what, "--out", out / "run")

    begin = time.monotonic()
    with disk(tmp_path / "disk", ROOM_KB) as out:
        assert command(out).code == 0
        need = used_kb(out)
        paged = {
            path.name: -(-path.stat().st_size // 1024 // PAGE_KB) * PAGE_KB
            for path in (out / "run").iterdir()
        }
    limit = SOON_S + 2 * (time.monotonic() - begin)
    before_review = need - paged["run.rrd"]
    tried = {before_review - 3 * PAGE_KB, before_review, need - 2 * PAGE_KB, need + 4 * PAGE_KB}
    if SWEEP:
        tried |= set(range(5 * 1024, 40 * 1024 + 1, 512))

    def whole(outcome: Outcome, out: Path) -> None:
        assert outcome.code == 0, outcome.err
        assert {p.name for p in (out / "run").iterdir()} == set(paged)

    for size in sorted(tried):
        if size > need:
            soon(tmp_path / "disk", size, limit, command, whole)
        elif size < need - PAGE_KB:  # between: files differ by some bytes from run to run
            soon(tmp_path / "disk", size, limit, command, partial(check_full, told="run/"))
