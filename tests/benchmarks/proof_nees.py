"""Whether every sigma is a promise kept: `make proof` writes docs/proof-nees.md.

Every catalogue procedure and thirty procedures by number (tests/generated.py), on five units, with
every method that takes them: mean of the normalised squared errors, per degree of freedom.
"""

import argparse
import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import groupby
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "tests"))  # what the short tests use

from generated import COUNT, IMUS, generated  # noqa: E402
from normalised import LOW_HZ, UNDETERMINED, Promise, promises, settings_of  # noqa: E402

from stand.procedure.procedure import Procedure, load_procedure  # noqa: E402
from stand.simulation.settings import Settings  # noqa: E402
from stand.toml_files import ids  # noqa: E402

PAGE = ROOT / "docs" / "proof-nees.md"
TURNING = {"carousel": 20, "random-sway": 20, "scorsby": 50, "rate-sweep": 200}  # Hz at least
LOW_TURNING = 20  # Hz: a sample is less than 0.2 rad
SLOW = 4  # times as few runs of what takes minutes each
LOW = """
At 5 Hz (20 Hz of what rocks or turns), and without rounding, which needs the noise of the sheets'
rates: noise, drifts and constants come through as at any rate."""
HEAD = """# Every sigma a promise

Squared errors over the covariances stated with them, per degree of freedom: 1 is honest, above it
sigmas are too small, below too large. Range over the stretches of a procedure, and the bounds
within which all numbers of the page lie together in 95 of 100 such pages. "Not determined": heading
with a sigma above 30 deg, of which only the tilt is judged. "Refused": runs in which the method
gave no number, and the first reason. Made by `tests/benchmarks/proof_nees.py {asked}`: {runs} runs
a case, a quarter of them of what rocks or turns.{low}

{summary}

| procedure/unit | method | NEES per freedom | bounds | heading sigma, deg | kept | refused |
|---|---|---|---|---|---|---|
"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=40)
    parser.add_argument("--only", nargs="*", default=[], help="PROCEDURE")
    parser.add_argument("--low", action="store_true", help="5 and 20 Hz, without rounding")
    asked = parser.parse_args()
    found: list[Promise] = []
    for procedure, imu in cases():
        if not asked.only or procedure.id in asked.only:
            runs = max(1, asked.runs // SLOW) if procedure.id in TURNING else asked.runs
            made = case(procedure, imu, asked.low)
            found += promises(made, runs)
            print(*told(found[-1:]), sep="\n", file=sys.stderr, flush=True)
    rows = "\n".join(told(found)) + "\n"
    print(rows)
    if not asked.only:
        made_by = f"--runs {asked.runs}{' --low' * asked.low}"
        low = LOW if asked.low else ""
        head = HEAD.format(runs=asked.runs, asked=made_by, low=low, summary=summary(found))
        PAGE.write_text(head + rows, encoding="utf-8")


def case(procedure: Procedure, imu: str, low: bool) -> Settings:
    """At the rate of the unit's sheet; `low`: at rates that a person can wait for."""
    turning = TURNING.get(procedure.id, 0)
    if not low:
        rate = settings_of(procedure, imu).rate_hz
        return settings_of(procedure, imu, max(rate, turning))
    rate = LOW_TURNING if turning else LOW_HZ
    return replace(settings_of(procedure, imu, rate), without=("quantisation",))


def summary(found: Sequence[Promise]) -> str:
    """How many promises are kept."""
    rows = [p for p in found if p.values]
    kept = sum(p.kept(len(rows)) for p in rows)
    names = sorted({f"{p.method} on {p.case}" for p in rows if not p.kept(len(rows))})
    told = f"Of {len(rows)} stretches and methods with numbers {kept} keep their promise"
    return told + (f"; not: {', '.join(names)}." if names else ".")


def cases() -> Iterator[tuple[Procedure, str]]:
    """Procedures with the units that they are for."""
    for name in ids("procedures"):
        for imu in IMUS:
            yield load_procedure(name), imu
    for number in range(COUNT):
        made = generated(number)
        yield made.procedure, made.imu


def told(found: Sequence[Promise]) -> Iterator[str]:
    """A row per case and method."""
    among = sum(bool(p.values) for p in found)
    for (case, method), group in groupby(found, lambda p: (p.case, p.method)):
        every = list(group)
        rows = [p for p in every if p.values]
        why = every[0].reason.replace("|", "/")
        refused = f"{every[0].refused} runs: {why}" if every[0].refused else ""
        if not rows:
            yield f"| {case} | {method} | | | | refused | {refused} |"
            continue
        means, sigmas = [p.mean for p in rows], [p.sigma for p in rows]
        low, high = np.array([p.bounds(among) for p in rows]).T
        heading = (
            "not determined" if min(sigmas) > UNDETERMINED else _range(np.degrees(sigmas).tolist())
        )
        kept = "yes" if all(p.kept(among) for p in rows) else "**no**"
        bounds = f"{low.min():.2f} to {high.max():.2f}"
        yield f"| {case} | {method} | {_range(means)} | {bounds} | {heading} | {kept} | {refused} |"


def _range(values: Sequence[float]) -> str:
    return " to ".join(dict.fromkeys(f"{v:.3g}" for v in (min(values), max(values))))


if __name__ == "__main__":
    main()
