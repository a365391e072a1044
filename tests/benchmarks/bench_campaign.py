"""What campaigns cost: runs a second beside another revision, engines side by side, memory.

    tests/benchmarks/bench_campaign.py speed --against REV
    tests/benchmarks/bench_campaign.py engines --seconds 60
    tests/benchmarks/bench_campaign.py memory --runs 10000

Processor time stands beside wall time: a machine that is shared tells more by the first.
"""

import argparse
import hashlib
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(name, "1")

ROOT = Path(__file__).parents[2]
ROUNDS = 3  # of each revision, one after the other: a machine that is busy for a while is seen
# what `rehearse --verify` makes of a run, with its methods; the same text for every revision
TRIAL = """
import sys, time
from dataclasses import replace
import stand
from alignment.angles import SequenceRule
from stand.rehearsal.verify import _ready, first_seed
name, runs = sys.argv[1], int(sys.argv[2])
made = stand.settings(name, imu="hg9900", rate_hz=50)
methods = made.procedure.entry.estimate.methods
options = replace(made.options, rule=SequenceRule.REGULAR)
if hasattr(options, "verdicts"):
    options = replace(options, verdicts=False)
made = replace(made, options=options, seed=first_seed(made))
trial = _ready(made, methods)
trial(made.seed)
begin = time.process_time()
seeds = range(made.seed + 1, made.seed + 1 + runs)
if hasattr(trial, "several"):  # as a campaign has them made
    for k in range(0, runs, trial.at_once):
        trial.several(seeds[k : k + trial.at_once])
else:
    for seed in seeds:
        trial(seed)
print(runs / (time.process_time() - begin))
"""
CASES = {"two-position": 40, "carousel": 10, "random-sway": 4}
SWEEP = """
title = "Bench"
procedure = "two-position"
imu = "hg9900"
rate_hz = {rate}
methods = ["two-position"]
runs = {runs}
[[vary]]
key = ["step.first.duration_s", "step.second.duration_s"]
values = {rests}
"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=("speed", "engines", "memory"))
    parser.add_argument("--against", metavar="REV", help="another revision, beside this one")
    parser.add_argument("--seconds", type=float, default=60.0, help="of each engine")
    parser.add_argument("--runs", type=int, default=10_000)
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    asked = parser.parse_args()
    if asked.what == "speed":
        speed(asked.against)
    elif asked.what == "engines":
        engines(asked.seconds, asked.workers)
    else:
        memory(asked.runs, asked.workers)


# --- runs a second


def speed(against: str | None) -> None:
    """Runs per second of one core, each revision in processes of its own, in turns."""
    with other(against) as folder:
        places = {"here": ROOT} | ({} if folder is None else {str(against): folder})
        for name, runs in CASES.items():
            found: dict[str, list[float]] = {place: [] for place in places}
            for _ in range(ROUNDS):
                for place, root in places.items():
                    found[place].append(_measured(root, name, runs))
            best = {place: max(values) for place, values in found.items()}
            words = ", ".join(f"{place} {value:.2f}" for place, value in best.items())
            ratio = f"; ratio {best['here'] / best[str(against)]:.2f}" if folder else ""
            print(f"{name}: {words} runs/s of a core{ratio}", flush=True)


def _measured(root: Path, name: str, runs: int) -> float:
    command = [sys.executable, "-c", TRIAL, name, str(runs)]
    own = {**os.environ, "PYTHONPATH": str(root)}
    done = subprocess.run(command, cwd=root, env=own, capture_output=True, text=True, check=True)
    return float(done.stdout)


@contextmanager
def other(revision: str | None) -> Iterator[Path | None]:
    """Another revision's files."""
    if revision is None:
        yield None
        return
    with tempfile.TemporaryDirectory() as folder:
        archive = subprocess.run(
            ["git", "archive", revision], cwd=ROOT, capture_output=True, check=True
        )
        subprocess.run(["tar", "-x", "-C", folder], input=archive.stdout, check=True)
        yield Path(folder)


# --- engines


def engines(seconds: float, workers: int) -> None:
    """The same campaign by processes of this machine and by Dask: runs, time, hash."""
    from stand.campaigns.campaign import size_of
    from stand.campaigns.sweep import load_sweep
    from stand.simulation.cluster import cluster, of_this_machine
    from stand.simulation.parallel import pool

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "bench.toml"
        path.write_text(SWEEP.format(rate=10, runs=20, rests=[60, 120, 240]))
        cost = size_of(load_sweep(path)).seconds / 60
        runs = max(20, int(seconds * workers / cost / 3))
        path.write_text(SWEEP.format(rate=10, runs=runs, rests=[60, 120, 240]))
        hashes = set()
        hashes.add(_timed("processes", path, folder, lambda supply: pool(supply, workers)))
        begin = time.perf_counter()
        with of_this_machine(workers) as address:
            print(f"Dask is there after {time.perf_counter() - begin:.1f} s")
            hashes.add(_timed("Dask", path, folder, lambda supply: cluster(supply, address)))
        print("the same bytes" if len(hashes) == 1 else "NOT the same bytes")


def _timed(name: str, path: Path, folder: str, engine: Callable) -> str:
    """A campaign by an engine; throughput from its first run to its last, start-up apart."""
    from stand.campaigns.campaign import Campaign
    from stand.campaigns.sweep import load_sweep

    made = Campaign(load_sweep(path), Path(folder) / name, engine=engine)
    before, begin = _spent(), time.perf_counter()
    runs = iter(made)
    next(runs)
    started, first = _spent(), time.perf_counter()
    rest = sum(1 for _ in runs)
    seconds, spent = time.perf_counter() - first, _spent() - started
    print(
        f"{name}: {made.done} runs, start-up {first - begin:.1f} s ({started - before:.1f} s of a "
        f"processor), then {rest / seconds:.1f} runs/s ({1e3 * spent / rest:.2f} ms of a "
        "processor a run)",
        flush=True,
    )
    return hashlib.sha256((made.folder / "results.parquet").read_bytes()).hexdigest()


def _processes() -> list:
    import psutil

    me = psutil.Process()
    return [me, *me.children(recursive=True)]


def _spent() -> float:
    """Processor time of this process and its children, ended ones included."""
    times = os.times()
    alive = sum(sum(p.cpu_times()[:2]) for p in _processes()[1:])
    return sum(times[:4]) + alive


# --- memory


def memory(runs: int, workers: int) -> None:
    """Resident memory of client and workers every tenth of a campaign."""
    from stand.campaigns.campaign import Campaign
    from stand.campaigns.sweep import load_sweep
    from stand.simulation.parallel import pool

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "bench.toml"
        path.write_text(SWEEP.format(rate=2, runs=runs // 2, rests=[20, 30]))
        made = Campaign(
            load_sweep(path), Path(folder) / "out", engine=lambda supply: pool(supply, workers)
        )
        for k, _ in enumerate(made, start=1):
            if k % max(1, runs // 10) == 0 or k == 200:
                sizes = [p.memory_info().rss / 1e6 for p in _processes()]
                print(f"{k} runs: " + ", ".join(f"{size:.0f}" for size in sizes) + " MB")


if __name__ == "__main__":
    main()
