"""Speed of rehearsals and of their verification: rows for `make bench`. Nothing is asserted."""

import os
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

from stand.imu import load_imu
from stand.procedure.procedure import load_procedure, table_of
from stand.rehearsal.rehearse import rehearse
from stand.rehearsal.verify import with_verification
from stand.simulation.monte_carlo import Trials
from stand.simulation.settings import Settings, assembled
from stand.toml_files import ids

Rows = list[tuple[str, str, str]]
VERIFIED = ("two-position", "carousel", "random-sway")
RATE_HZ = 50


def asked_of(name: str, imu: str = "hg9900") -> Settings:
    """A catalogue entry as `stand rehearse` asks for it."""
    procedure = load_procedure(name)
    site = procedure.entry.site.site()
    return assembled(procedure, load_imu(imu), table_of(procedure), site, RATE_HZ)


def rehearsal_rows() -> Rows:
    """Every catalogue entry, ready to go; whole commands; runs of the stand over the cores."""
    rows: Rows = []
    for name in ids("procedures"):
        asked = asked_of(name)
        rehearse(asked)
        took = _median(lambda asked=asked: rehearse(asked))
        trials = Trials(asked)
        trials.readings(0)
        run = _median(lambda trials=trials: trials.readings(1), 1)
        rows.append(
            (f"rehearse {name}", f"{1 / took:.1f} /s", f"{run / took:.1f} runs in its time")
        )
    commands = {name: _median(lambda name=name: _command(name)) for name in ids("procedures")}
    slowest = max(commands, key=lambda name: commands[name])
    median = statistics.median(commands.values())
    rows.append(("stand rehearse, median of the catalogue", f"{median:.2f} s", ""))
    rows.append((f"slowest: {slowest}", f"{commands[slowest]:.2f} s", "goal: below 3 s"))
    for name in VERIFIED:
        rows += _verify_rows(name)
    return rows


def _verify_rows(name: str) -> Rows:
    """Runs/s by one process and by one on every core, their start included."""
    asked, rows, one = asked_of(name), [], 0.0
    result = rehearse(asked)
    cores = os.cpu_count() or 1
    for workers in dict.fromkeys((1, cores)):
        runs = (200 if name == "two-position" else 24) * workers
        begin = time.perf_counter()
        with_verification(result, asked, runs, workers=workers)
        rate = runs / (time.perf_counter() - begin)
        one = one or rate
        what = f"verify {name}, {workers} core{'s' * (workers > 1)}"
        rows.append((what, f"{rate:.1f} runs/s", f"{rate / one:.2f} of one core"))
    return rows


def _median(action: Callable[[], object], repeats: int = 3) -> float:
    times = []
    for _ in range(repeats):
        begin = time.perf_counter()
        action()
        times.append(time.perf_counter() - begin)
    return statistics.median(times)


def _command(name: str) -> None:
    stand = str(Path(sys.executable).with_name("stand"))
    command = [stand, "rehearse", name, "--imu", "hg9900"]
    subprocess.run(command, check=False, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


if __name__ == "__main__":
    for row in rehearsal_rows():
        print("{:42}{:>16}   {}".format(*row))
