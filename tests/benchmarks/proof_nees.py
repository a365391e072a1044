"""Whether every sigma is a promise kept: `make proof` writes docs/proof-nees.md.

Every catalogue procedure and thirty procedures by number (tests/generated.py), on five units, with
every method that takes them: mean of the normalised squared errors, per degree of freedom. Runs,
and what a case came to, are kept in recordings/proof-nees: an interrupted proof goes on with the
run where it was, a case that has `--runs` or more is not run again, and `--runs 0` writes the page
of what is there. Remove that folder when stand or estimators have changed.
"""

import argparse
import json
import sys
from collections.abc import Iterator, Sequence
from dataclasses import asdict, replace
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "tests"))  # what the short tests use

from generated import COUNT, IMUS, generated  # noqa: E402
from normalised import LOW_HZ, UNDETERMINED, Promise, promises, settings_of  # noqa: E402

from stand.procedure.procedure import Procedure, load_procedure  # noqa: E402
from stand.simulation.cluster import engine_at  # noqa: E402
from stand.simulation.settings import Settings  # noqa: E402
from stand.simulation.work import Engine  # noqa: E402
from stand.toml_files import ids  # noqa: E402

KEPT, PAGE = ROOT / "recordings" / "proof-nees", ROOT / "docs" / "proof-nees.md"
TURNING = {"carousel": 20, "random-sway": 20, "scorsby": 50, "rate-sweep": 200}  # Hz at least
TURNING |= dict.fromkeys(("rate-steps", "spins", "calibration-full"), 20)
LOW_TURNING = 20  # Hz: a sample is less than 0.2 rad
SLOW = 4  # times as few runs of what takes minutes each
LOW = """
At 5 Hz (20 Hz of what rocks or turns), and without rounding, which needs the noise of the sheets'
rates: noise, drifts and constants come through as at any rate."""
HEAD = """# Every sigma a promise

Squared errors over the covariances stated with them, per degree of freedom: 1 is honest, above it
sigmas are too small, below too large. Range over the stretches of a procedure, and the bounds
within which all numbers of the page lie together in 95 of 100 such pages. "Not determined": heading
with a sigma above 30 deg, of which only the tilt is judged. "Refused": how often a stretch got no
number, and the first reason. Made by `tests/benchmarks/proof_nees.py{asked}`.{low}

{summary}

| procedure/unit | method | NEES per freedom | bounds | heading sigma, deg | kept | runs | refused |
|---|---|---|---|---|---|---|---|
"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=40, help="a quarter of what rocks or turns")
    parser.add_argument("--only", nargs="*", default=[], help="PROCEDURE")
    parser.add_argument("--low", action="store_true", help="5 and 20 Hz, without rounding")
    parser.add_argument("--workers", type=int, help="processes; as many as there are cores")
    parser.add_argument("--scheduler", help="of a Dask cluster, or local")
    asked = parser.parse_args()
    engine = None if asked.scheduler is None else engine_at(asked.scheduler)
    found: list[tuple[int, list[Promise]]] = []
    for procedure, imu in cases():
        if not asked.only or procedure.id in asked.only:
            runs = -(-asked.runs // SLOW) if procedure.id in TURNING else asked.runs
            at = asked.low, runs, asked.workers, engine
            found.append(kept_or_made(procedure, imu, *at))
    rows = "\n".join(told(found)) + "\n"
    print(rows)
    if not asked.only:
        low = LOW if asked.low else ""
        head = HEAD.format(asked=" --low" * asked.low, low=low, summary=summary(found))
        PAGE.write_text(head + rows, encoding="utf-8")


def kept_or_made(
    procedure: Procedure,
    imu: str,
    low: bool,
    runs: int,
    workers: int | None = None,
    engine: Engine | None = None,
) -> tuple[int, list[Promise]]:
    """How many runs a case has, and what they came to: as kept, if those are enough."""
    path = KEPT / f"{procedure.id}-{imu}{'-low' * low}.json"
    there: dict[str, Any] = {"runs": 0, "promises": []}
    if path.exists():
        there = json.loads(path.read_text(encoding="utf-8"))
    if there["runs"] < runs:
        case_runs = path.with_suffix(".jsonl")  # of a case that is not whole yet
        made = promises(
            case(procedure, imu, low), runs, workers=workers, engine=engine, keep=case_runs
        )
        there = {"runs": runs, "promises": [asdict(p) for p in made]}
        KEPT.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(there), encoding="utf-8")
        case_runs.unlink()
        print(path.stem, runs, file=sys.stderr, flush=True)
    return there["runs"], [_promise(entry) for entry in there["promises"]]


def _promise(entry: dict[str, Any]) -> Promise:
    entry |= {name: tuple(entry[name]) for name in ("values", "freedoms")}
    return Promise(**entry)


def case(procedure: Procedure, imu: str, low: bool) -> Settings:
    """At the rate of the unit's sheet; `low`: at rates that a person can wait for."""
    turning = TURNING.get(procedure.id, 0)
    if not low:
        rate = settings_of(procedure, imu).rate_hz
        return settings_of(procedure, imu, max(rate, turning))
    rate = LOW_TURNING if turning else LOW_HZ
    return replace(settings_of(procedure, imu, rate), without=("quantisation",))


def summary(found: Sequence[tuple[int, Sequence[Promise]]]) -> str:
    """How many promises are kept."""
    rows = [p for _, every in found for p in every if p.values]
    kept = sum(p.kept(len(rows)) for p in rows)
    names = sorted({f"{p.method} on {p.case}" for p in rows if not p.kept(len(rows))})
    told = f"Of {len(rows)} stretches and methods with numbers {kept} keep their promise"
    told += f"; not: {', '.join(names)}." if names else "."
    waiting = sum(not runs for runs, _ in found)
    return told + f" {len(found)} cases, {waiting} of them without runs yet." * bool(waiting)


def cases() -> Iterator[tuple[Procedure, str]]:
    """Procedures with the units that they are for."""
    for name in ids("procedures"):
        for imu in IMUS:
            yield load_procedure(name), imu
    for number in range(COUNT):
        made = generated(number)
        yield made.procedure, made.imu


def told(found: Sequence[tuple[int, Sequence[Promise]]]) -> Iterator[str]:
    """A row per case and method."""
    among = sum(bool(p.values) for _, every in found for p in every)
    for runs, every in found:
        for _, group in groupby(sorted(every, key=lambda p: p.method), lambda p: p.method):
            yield _row(list(group), runs, among)


def _row(every: Sequence[Promise], runs: int, among: int) -> str:
    """One method's stretches in one case."""
    first, rows = every[0], [p for p in every if p.values]
    refusals = [p for p in every if p.refused]
    count = sum(p.refused for p in refusals)
    refused = f"{count} times: {refusals[0].reason.replace('|', '/')}" if refusals else ""
    if not rows:
        return f"| {first.case} | {first.method} | | | | refused | {runs} | {refused} |"
    means, sigmas = [p.mean for p in rows], [p.sigma for p in rows]
    low, high = np.array([p.bounds(among) for p in rows]).T
    heading = (
        "not determined" if min(sigmas) > UNDETERMINED else _range(np.degrees(sigmas).tolist())
    )
    kept = "yes" if all(p.kept(among) for p in rows) else "**no**"
    bounds = f"{low.min():.2f} to {high.max():.2f}"
    nees = _range(means)
    return (
        f"| {first.case} | {first.method} | {nees} | {bounds} | {heading} | {kept} | {runs} "
        f"| {refused} |"
    )


def _range(values: Sequence[float]) -> str:
    return " to ".join(dict.fromkeys(f"{v:.3g}" for v in (min(values), max(values))))


if __name__ == "__main__":
    main()
