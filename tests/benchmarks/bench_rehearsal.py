"""Speed of rehearsals and of their verification: rows for `make bench`. Nothing is asserted."""

import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from stand.imu import load_imu
from stand.procedure.procedure import load_procedure, table_of
from stand.rehearsal.advice import with_advice
from stand.rehearsal.rehearse import rehearse
from stand.rehearsal.verify import with_verification
from stand.simulation.monte_carlo import Trials
from stand.simulation.settings import Settings, assembled, settings
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
    with tempfile.TemporaryDirectory() as folder:
        environment = keeping_bytecode(Path(folder))
        _command("random-sway", environment)
        commands = {
            name: _median(lambda name=name: _command(name, environment))
            for name in ids("procedures")
        }
    slowest = max(commands, key=lambda name: commands[name])
    median = statistics.median(commands.values())
    rows.append(("stand rehearse, median of the catalogue", f"{median:.2f} s", "goal: 0.6 s"))
    rows.append(advice_row())
    rows.append((f"slowest: {slowest}", f"{commands[slowest]:.2f} s", "goal: below 3 s"))
    for name in VERIFIED:
        rows += _verify_rows(name)
    return rows


def twelve_positions(folder: Path) -> Settings:
    """Twelve positions, written in `folder`, that miss what is required by five methods."""
    methods = '"multi-position", "two-position", "triad", "single-gyro", "six-position"'
    text = (
        'title = "Twelve positions"\n[site]\nlatitude_deg = 48.5\n[require]\nheading_deg = 0.01\n'
        f"[estimate]\nmethods = [{methods}]\n"
    )
    for k in range(12):
        joints = f"{{ outer = {30 * k}, middle = {45 * (k % 3)} }}"
        text += f'[[step]]\nkind = "move"\nlabel = "to {k}"\njoints_deg = {joints}\n'
        text += f'[[step]]\nkind = "dwell"\nlabel = "{k}"\nduration_s = 60\n'
    path = folder / "twelve.toml"
    path.write_text(text)
    return settings(path, "hg9900", "precision")


def advice_row() -> tuple[str, str, str]:
    """What would help them."""
    with tempfile.TemporaryDirectory() as folder:
        asked = twelve_positions(Path(folder))
    begin, cpu = time.perf_counter(), time.process_time()
    answer = with_advice(asked)
    took, cpu = time.perf_counter() - begin, time.process_time() - cpu
    return (
        "advice for twelve positions",
        f"{took:.1f} s",
        (f"{len(answer.advice)} pieces, {cpu:.1f} s of computing; goal: below 5 s"),
    )


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


def _command(name: str, environment: dict[str, str]) -> None:
    stand = str(Path(sys.executable).with_name("stand"))
    command, silent = [stand, "rehearse", name, "--imu", "hg9900"], subprocess.DEVNULL
    subprocess.run(command, check=False, stdout=silent, stderr=silent, env=environment)


def keeping_bytecode(folder: Path) -> dict[str, str]:
    """The environment for commands as an installed program has it: compiled once, in `folder`.

    Where nothing may be kept, a start compiles all modules anew, which takes longer than the rest.
    """
    kept = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
    return kept | {"PYTHONPYCACHEPREFIX": str(folder / "bytecode")}


if __name__ == "__main__":
    for row in rehearsal_rows():
        print("{:42}{:>16}   {}".format(*row))
