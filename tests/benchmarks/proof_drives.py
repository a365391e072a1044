"""Whether sigmas of vector matching are promises kept: `make proof` writes docs/proof-drives.md.

Every drive of the catalogue by five units, each solution at a third, two thirds and the end of its
fixes. What a case came to is kept in recordings/proof-drives: an interrupted proof goes on where it
was. Remove that folder when stand or estimators have changed.
"""

import argparse
import json
import sys
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from itertools import groupby
from pathlib import Path

import numpy as np
from scipy.stats import chi2

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "tests"))  # what the short tests use

from drives import Square, squares  # noqa: E402

from stand.toml_files import ids  # noqa: E402

KEPT, PAGE = ROOT / "recordings" / "proof-drives", ROOT / "docs" / "proof-drives.md"
UNITS = ("stim300", "hg9900", "ring-laser", "adis16470", "icm42688p")
CASES = [(drive, imu) for drive in ids("trajectories") for imu in UNITS]
RATE, PARTS, APART = 200, (1 / 3, 2 / 3, 1.0), 10_000
HEAD = """# Attitudes of drives: every sigma a promise

Squared errors of attitude over the covariances stated with them, per degree of freedom: 1 is
honest, above it sigmas are too small. {runs} runs of each drive and unit at {rate} Hz, each with a
unit, fixes and a programmed start drawn anew; at a third, two thirds and the end of the fixes,
where the solution gave a number ("given", of so many). Bounds: all numbers of the page lie within
theirs together in 95 of 100 such pages. Made by `tests/benchmarks/proof_drives.py`.

{summary}

| drive | unit | solution | fixes | per freedom | bounds | sigma, deg | given |
|---|---|---|---|---|---|---|---|
"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=40)
    parser.add_argument("--workers", type=int, help="processes; as many as there are cores")
    asked = parser.parse_args()
    with ProcessPoolExecutor(asked.workers) as pool:
        every = list(pool.map(kept, CASES, [asked.runs] * len(CASES)))
    rows = [row for case, runs in zip(CASES, every, strict=True) for row in told(case, runs)]
    lines = [line(row, asked.runs, len(rows)) for row in rows]
    off = [text for text, kept_it in lines if not kept_it]
    summary = f"Of {len(rows)} numbers {len(rows) - len(off)} are inside their bounds."
    head = HEAD.format(runs=asked.runs, rate=RATE, summary=summary)
    PAGE.write_text(head + "".join(text for text, _ in lines), encoding="utf-8")
    print(summary, *off, sep="\n")


def kept(case: tuple[str, str], runs: int) -> list[list[Square]]:
    """The runs of a case, as kept, and those that are missing."""
    drive, imu = case
    path = KEPT / f"{drive}-{imu}.json"
    there: list[list[Square]] = []
    if path.exists():
        kept_so_far = json.loads(path.read_text(encoding="utf-8"))
        there = [[Square(*one) for one in run] for run in kept_so_far]
    first = APART * CASES.index(case)
    there += squares(drive, imu, range(first + len(there), first + runs), RATE, PARTS)
    KEPT.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(there), encoding="utf-8")
    print(path.stem, len(there), file=sys.stderr, flush=True)
    return there[:runs]


def told(case: tuple[str, str], runs: list[list[Square]]) -> Iterator[tuple[str, list[Square]]]:
    """What is said of each solution at each of its fixes: the row's beginning and its numbers."""
    every = sorted(one for run in runs for one in run)
    for (solution, fix), some in groupby(every, key=lambda one: one[:2]):
        yield f"| {case[0]} | {case[1]} | {solution} | {fix} |", list(some)


def line(row: tuple[str, list[Square]], runs: int, among: int) -> tuple[str, bool]:
    """A row, and whether its number lies in its bounds."""
    begins, found = row
    freedom, tail = 3 * len(found), 0.025 / among
    low, high = chi2.ppf([tail, 1 - tail], freedom) / freedom
    mean = sum(one.square for one in found) / freedom
    sigma = np.degrees(np.median([one.sigma for one in found]))
    text = f"{begins} {mean:.2f} | {low:.2f} to {high:.2f} | {sigma:.3g} | {len(found)} of {runs} |"
    return text + "\n", bool(low <= mean <= high)


if __name__ == "__main__":
    main()
