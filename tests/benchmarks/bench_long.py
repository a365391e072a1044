"""Long runs: the most memory they hold, which does not grow with their length; time per step."""

import os
import subprocess
import sys
from pathlib import Path

HOURS = (1 / 6, 1.0, 3.0)
STEPS = (300, 1000, 3000)
HEAD = """title = "Long"
table = "rocking-platform"
[site]
latitude_deg = 48.5
[estimate]
methods = [{methods}]
"""
DWELL = '[[step]]\nkind = "dwell"\nlabel = "{label}"\nduration_s = {seconds:g}\n'
MOVE = '[[step]]\nkind = "move"\nlabel = "m{k}"\njoints_deg = {{ inner = {angle} }}\n'
SWAY = """[[background]]
kind = "sway"
[background.axes]
base_roll = { rms_deg = 2.0, frequency_hz = 0.15 }
base_yaw = { rms_deg = 1.0, frequency_hz = 0.1 }
"""

Row = tuple[str, str, str]


def command(folder: Path, *arguments: str) -> tuple[float, float]:
    """`stand ARGUMENTS` in a process of its own: its most memory [MB], processor time [s]."""
    stand = str(Path(sys.executable).with_name("stand"))
    child = subprocess.Popen([stand, *arguments], cwd=folder, stdout=subprocess.DEVNULL)
    _, status, used = os.wait4(child.pid, 0)
    child.returncode = os.waitstatus_to_exitcode(status)
    if child.returncode:
        raise RuntimeError(f"{' '.join(arguments)}: exit code {child.returncode}")
    return used.ru_maxrss / 1024, used.ru_utime + used.ru_stime


def long_rows(folder: Path) -> list[Row]:
    """At 1 kHz at rest and on a base that sways, recorded, with every method of that."""
    rows = []
    for name, methods, motion, hours in (
        ("at rest", '"triad"', "", HOURS),
        ("swaying", '"inertial", "fine"', SWAY, HOURS[:2]),
    ):
        shortest = 0.0
        for length in hours:
            dwell = DWELL.format(label="a", seconds=3600 * length)
            (folder / "long.toml").write_text(HEAD.format(methods=methods) + dwell + motion)
            given = ("run", "long.toml", "--imu", "hg9900", "--rate", "1000", "--out", "long")
            most, _ = command(folder, *given, "--force")
            shortest = shortest or most
            what = f"{length:.3g} h at 1 kHz {name}"
            rows.append((what, f"{most:.0f} MB", f"{most / shortest:.2f}"))
    most, _ = command(folder, "align", "long")
    rows.append(("align of the last", f"{most:.0f} MB", ""))
    return rows


def step_rows(folder: Path) -> list[Row]:
    """Moves and dwells by the hundred: processor time per step, beyond that of the fewest."""
    spent = []
    for count in STEPS:
        steps = (
            MOVE.format(k=k, angle=10 * (-1) ** k) + DWELL.format(label=f"d{k}", seconds=2)
            for k in range(count // 2)
        )
        (folder / "steps.toml").write_text(HEAD.format(methods='"triad"') + "".join(steps))
        given = ("run", "steps.toml", "--rate", "10", "--out", "steps", "--force")
        _, seconds = command(folder, *given)
        spent.append(seconds)
    first = (spent[1] - spent[0]) / (STEPS[1] - STEPS[0])
    then = (spent[2] - spent[1]) / (STEPS[2] - STEPS[1])
    return [
        (f"a step of {STEPS[1]}, recorded", f"{1e3 * first:.1f} ms", "1"),
        (f"a step of {STEPS[2]}, recorded", f"{1e3 * then:.1f} ms", f"{then / first:.2f}"),
    ]
