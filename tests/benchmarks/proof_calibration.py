"""Calibrations against what each unit was given: `make proof` writes docs/proof-calibration.md.

Fifty units of each of four presets on two classes of table, calibrated by `calibration-full`; once
as the stand does it, once as if table and seat were perfect. What a case came to is kept in
recordings/proof-calibration: an interrupted proof goes on where it was. Remove that folder when
stand or estimator have changed.
"""

import argparse
import json
import sys
from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import asdict
from pathlib import Path

import numpy as np
from scipy.stats import chi2

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "tests"))  # what the short tests use

from calibrated import BETWEEN, GROUPS, Outcome, case, outcomes, rms  # noqa: E402

from stand.simulation.cluster import engine_at  # noqa: E402
from stand.simulation.work import Engine  # noqa: E402

KEPT, PAGE = ROOT / "recordings" / "proof-calibration", ROOT / "docs" / "proof-calibration.md"
UNITS, TABLES = ("stim300", "hg9900", "ring-laser", "adis16470"), ("precision", "mid-class")
CASES = [(imu, table) for imu in UNITS for table in TABLES]
RATES = {"adis16470": 100}  # Hz: below, its noise does not blur the steps of its readings
RATE = 25
ROUND = 5  # runs of each case in turn
FIRST, APART = (
    5000,
    1000,
)  # seed of the first case, and from one case to the next: none shares a seat
HEAD = """# Calibrations against what each unit was given

{runs} units of each preset, drawn with a table and a seat of their own, calibrated by
`calibration-full` (24 positions, rate steps and spins, the moves between them). NEES: squared
errors of the constants that the sheet states, over their covariance, with the interval in which
its mean lies in 95 of 100 such proofs. Made by `tests/benchmarks/proof_calibration.py`.

{nees}

Root mean square over axes and units: predicted sigma, achieved error, their ratio. On the right the
same readings calibrated as if table and seat were perfect, as many programs do: the sigma claimed,
and the error. Biases and gyro scale factors hardly suffer; misalignments are claimed to tenths of
an arc second and are wrong by the seat.

| unit | table | what | predicted | achieved | ratio | trusting: claimed | achieved |
|---|---|---|---|---|---|---|---|
{rows}
"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=50)
    parser.add_argument("--only", nargs="*", default=[], help="UNIT-TABLE: no page is written")
    parser.add_argument("--workers", type=int, help="processes; as many as there are cores")
    parser.add_argument("--scheduler", help="of a Dask cluster, or local")
    asked = parser.parse_args()
    by = asked.workers, None if asked.scheduler is None else engine_at(asked.scheduler)
    if asked.only:
        for imu, table in CASES:
            if f"{imu}-{table}" in asked.only:
                kept(imu, table, asked.runs, *by)
        return
    found = {}
    for runs in [*range(ROUND, asked.runs, ROUND), asked.runs]:
        found = {one: kept(*one, runs, *by) for one in CASES}
    nees = [line for key, pair in found.items() for line in promises(*key, *pair)]
    rows = [row for key, pair in found.items() for row in groups(*key, *pair)]
    head = "| unit | table | freedom | NEES | 95 % | chi-square | NEES, trusting |\n" + "|---" * 7
    text = HEAD.format(runs=asked.runs, nees="\n".join([head + "|", *nees]), rows="\n".join(rows))
    PAGE.write_text(text, encoding="utf-8")
    print(text)


def kept(
    imu: str,
    table: str,
    runs: int,
    workers: int | None = None,
    engine: Engine | None = None,
) -> tuple[list[Outcome], list[Outcome]]:
    """The outcomes of a case, as kept, and those that are missing: plain, and trusting."""
    path = KEPT / f"{imu}-{table}.json"
    there: list[tuple[Outcome, Outcome]] = []
    if path.exists():
        told = json.loads(path.read_text(encoding="utf-8"))
        there = [(Outcome(**one), Outcome(**other)) for one, other in told]
    first = FIRST + APART * CASES.index((imu, table))
    missing = range(first + len(there), first + runs)
    made = case("calibration-full", imu, table, RATES.get(imu, RATE))
    with closing(outcomes(made, missing, workers, engine)) as pairs:
        for pair in pairs:
            there.append(pair)
            KEPT.mkdir(parents=True, exist_ok=True)
            kept_so_far = [[asdict(one), asdict(other)] for one, other in there]
            path.write_text(json.dumps(kept_so_far), encoding="utf-8")
    print(path.stem, len(there), file=sys.stderr, flush=True)
    plain, trusting = zip(*there[:runs], strict=True)
    return list(plain), list(trusting)


def promises(
    imu: str, table: str, plain: Sequence[Outcome], trusting: Sequence[Outcome]
) -> Iterator[str]:
    """A row of NEES."""
    n, freedom = len(plain), plain[0].freedom
    low, high = chi2.ppf([0.025, 0.975], n * freedom) / n
    mean, chi = np.mean([o.nees for o in plain]), np.mean([o.chi_square for o in plain])
    wrong = np.mean([o.nees for o in trusting])
    yield (
        f"| {imu} | {table} | {freedom} | {mean:.1f} | {low:.1f} to {high:.1f} | {chi:.2f} | "
        f"{wrong:.3g} |"
    )


def groups(
    imu: str, table: str, plain: Sequence[Outcome], trusting: Sequence[Outcome]
) -> Iterator[str]:
    """A row per kind of constant."""
    for name in plain[0].errors:
        unit = GROUPS[name][0] if name != BETWEEN else "arcsec"
        cells = []
        for every in (plain, trusting):
            cells.append(
                (rms([o.sigmas[name] for o in every]), rms([o.errors[name] for o in every]))
            )
        (sigma, error), (claimed, wrong) = cells
        yield (
            f"| {imu} | {table} | {name}, {unit} | {sigma:.3g} | {error:.3g} | "
            f"{sigma / error:.2f} | {claimed:.3g} | {wrong:.3g} |"
        )


if __name__ == "__main__":
    main()
