"""Long runs: the most memory they hold, which hardly grows with their length; time per step.

python tests/benchmarks/bench_long.py [HOURS ...]: at 1 kHz at rest and swaying, recorded, and what
is read of it again; 24 takes 13 GB of the disk for each, and goes as they do.
"""

import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

HOURS = (1 / 6, 1.0, 3.0)
STEPS = (300, 1000, 3000, 10_000)
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


def long_rows(
    folder: Path, still: Sequence[float] = HOURS, swaying: Sequence[float] = HOURS[:2]
) -> list[Row]:
    """At 1 kHz at rest and on a base that sways, recorded with all methods of that, read again."""
    rows = []
    for name, methods, motion, hours in (
        ("at rest", '"triad"', "", still),
        ("swaying", '"inertial", "fine"', SWAY, swaying),
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
        if name == "at rest":
            most, _ = command(folder, "allan", "long")
            rows.append((f"allan of {still[-1]:.3g} h at rest", f"{most:.0f} MB", ""))
    for name, *given in (("align",), ("export", "--out", "long.npz")):
        most, _ = command(folder, name, "long", *given)
        rows.append((f"{name} of the last", f"{most:.0f} MB", ""))
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
    each = [
        (b - a) / (n - m) for m, n, a, b in zip(STEPS, STEPS[1:], spent, spent[1:], strict=False)
    ]
    return [
        (f"a step of {count}, recorded", f"{1e3 * one:.1f} ms", f"{one / each[0]:.2f}")
        for count, one in zip(STEPS[1:], each, strict=True)
    ]


def main() -> None:
    hours = [float(text) for text in sys.argv[1:]] or list(HOURS)
    with TemporaryDirectory() as folder:
        for what, most, ratio in long_rows(Path(folder), hours, hours):
            print(f"{what:40} {most:>10} {ratio:>6}")


if __name__ == "__main__":
    main()
