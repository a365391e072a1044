"""Before and after, side by side: ``python tests/benchmarks/bench_ab.py OTHER_CHECKOUT``.

The same jobs by this checkout and by another in turn, A B A B, by the same interpreter and
libraries. In-process jobs in processes that are warm by then, commands in one of their own each.
Ratios are medians over the pairs, of wall time and of processor time: above 1 this one is faster.
Nothing is asserted. A part of a job's name limits it to such jobs: ``... OTHER_CHECKOUT align``.
"""

import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from functools import cache
from pathlib import Path

HERE = Path(__file__).resolve().parents[2]
TURNS = 5
Costs = tuple[float, float]  # wall, processor [s]

COMMANDS = {
    "stand --help": ["--help"],
    "stand list imus": ["list", "imus"],
    "stand align sample": ["align", str(HERE / "recordings/sample")],
    "stand rehearse two-position": ["rehearse", "two-position", "--imu", "hg9900"],
    "stand run six-position": ["run", "six-position", "--out", "run", "--force"],
}


@cache
def made(procedure: str, rate_hz: int, imu: str):
    import stand

    settings = stand.settings(procedure, imu=imu, rate_hz=rate_hz)
    return settings, stand.simulate(settings)


def simulating(procedure: str, rate_hz: int) -> Callable[[], object]:
    import stand

    settings = stand.settings(procedure, imu="stim300", rate_hz=rate_hz)
    return lambda: stand.simulate(settings)


def aligning(procedure: str, rate_hz: int, method: str) -> Callable[[], object]:
    import stand

    _, run = made(procedure, rate_hz, "ring-laser")
    return lambda: stand.align(run, method=method)


def analysing() -> Callable[[], object]:
    import numpy as np

    from alignment import ImuReadings
    from alignment.allan import analyse

    n, rng = 1_000_000, np.random.default_rng(0)
    w, f = rng.standard_normal((2, n, 3)) * 1e-3 + [[[0, 5e-5, 5e-5]], [[0, 9.81, 0]]]
    readings = ImuReadings(np.arange(1, n + 1) / 200, w, f)
    return lambda: analyse(readings)


def rehearsing(procedure: str) -> Callable[[], object]:
    import stand

    settings = stand.settings(procedure, imu="hg9900")
    return lambda: stand.rehearse(settings)


JOBS: dict[str, Callable[[], Callable[[], object]]] = {
    "simulate two-position at 200 Hz": lambda: simulating("two-position", 200),
    "simulate six-position at 200 Hz": lambda: simulating("six-position", 200),
    "simulate random-sway at 200 Hz": lambda: simulating("random-sway", 200),
    "simulate random-sway at 1 kHz": lambda: simulating("random-sway", 1000),
    "align by triad": lambda: aligning("two-position", 200, "triad"),
    "align by two-position": lambda: aligning("two-position", 200, "two-position"),
    "align by inertial": lambda: aligning("random-sway", 200, "inertial"),
    "align by fine": lambda: aligning("random-sway", 200, "fine"),
    "allan of 1 000 000 samples": analysing,
    "rehearse two-position": lambda: rehearsing("two-position"),
    "rehearse carousel": lambda: rehearsing("carousel"),
    "rehearse six-position": lambda: rehearsing("six-position"),
}


def work() -> None:
    """A side: names of jobs from standard input, what each costs to standard output."""
    ready = {}
    for line in sys.stdin:
        name = json.loads(line)
        if name not in ready:
            ready[name] = JOBS[name]()
            ready[name]()
        wall, cpu = time.perf_counter(), time.process_time()
        ready[name]()
        print(json.dumps([time.perf_counter() - wall, time.process_time() - cpu]), flush=True)


def environment(checkout: Path) -> dict[str, str]:
    """With the modules of that checkout before any that are installed."""
    own = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
    return own | {"PYTHONPATH": str(checkout)}


class Side:
    """One checkout."""

    def __init__(self, checkout: Path) -> None:
        self._environment = environment(checkout)
        self._process = subprocess.Popen(
            [sys.executable, __file__, "--work"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env=self._environment,
        )

    def job(self, name: str) -> Costs:
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(json.dumps(name) + "\n")
        self._process.stdin.flush()
        wall, cpu = json.loads(self._process.stdout.readline())
        return wall, cpu

    def command(self, arguments: list[str], folder: str) -> Costs:
        begin, used = time.perf_counter(), _processor()
        subprocess.run(
            [sys.executable, "-m", "stand", *arguments],
            stdout=subprocess.DEVNULL,
            cwd=folder,
            env=self._environment,
            check=False,
        )
        return time.perf_counter() - begin, _processor() - used

    def close(self) -> None:
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._process.wait()


def _processor() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def told(name: str, a: Callable[[], Costs], b: Callable[[], Costs]) -> str:
    """A line of what both cost, pair by pair, after one that is for warmth."""
    pairs = [(a(), b()) for _ in range(TURNS + 1)][1:]
    here, there = (statistics.median(side[k][0] for side in pairs) for k in (0, 1))
    wall, cpu = (statistics.median(y[k] / x[k] for x, y in pairs) for k in (0, 1))
    ratios = sorted(y[0] / x[0] for x, y in pairs)
    return (
        f"{name:34}{1e3 * here:10.1f} ms{1e3 * there:10.1f} ms{wall:8.2f}"
        f"   ({ratios[0]:.2f} to {ratios[-1]:.2f}){cpu:8.2f}"
    )


def main() -> None:
    if sys.argv[1:2] == ["--work"]:
        work()
        return
    if len(sys.argv) < 2 or not (Path(sys.argv[1]) / "stand").is_dir():
        raise SystemExit("usage: bench_ab.py OTHER_CHECKOUT [part of a job's name]")
    wanted = sys.argv[2] if len(sys.argv) > 2 else ""
    sides = Side(HERE), Side(Path(sys.argv[1]).resolve())
    print(f"{'':34}{'here':>13}{'there':>13}{'times':>8}   (lowest to highest){'in CPU':>8}")
    with tempfile.TemporaryDirectory() as folder:
        for name, arguments in COMMANDS.items():
            if wanted in name:
                runs = [lambda s=s, a=arguments: s.command(a, folder) for s in sides]
                print(told(name, *runs), flush=True)
    for name in JOBS:
        if wanted in name:
            print(told(name, *(lambda s=s, n=name: s.job(n) for s in sides)), flush=True)
    for side in sides:
        side.close()


if __name__ == "__main__":
    main()
