"""Whether every sigma is a promise kept: `make proof` writes docs/proof-nees.md.

Every catalogue procedure and thirty procedures by number (tests/generated.py), on five units, with
every method that takes them: mean of the normalised squared errors, per degree of freedom.
"""

import argparse
import sys
from collections.abc import Iterator, Sequence
from itertools import groupby
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "tests"))  # what the short tests use

from generated import COUNT, IMUS, generated  # noqa: E402
from normalised import UNDETERMINED, Promise, promises, settings_of  # noqa: E402

from stand.procedure.procedure import Procedure, load_procedure  # noqa: E402
from stand.toml_files import ids  # noqa: E402

PAGE = ROOT / "docs" / "proof-nees.md"
TURNING = {"carousel": 20, "random-sway": 20, "scorsby": 50, "rate-sweep": 200}  # Hz at least
HEAD = """# Every sigma a promise

Squared errors over the covariances stated with them, per degree of freedom: 1 is honest, above it
sigmas are too small, below too large. Range over the stretches of a procedure, and the bounds
within which all numbers of the page lie together in 95 of 100 such pages. "Not determined": heading
with a sigma above 30 deg, of which only the tilt is judged. Made by
`tests/benchmarks/proof_nees.py --runs {runs}`: {runs} runs a case.

| procedure/unit | method | NEES per freedom | bounds | heading sigma, deg | kept | refused |
|---|---|---|---|---|---|---|
"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=2000)
    parser.add_argument("--only", nargs="*", default=[], help="PROCEDURE")
    asked = parser.parse_args()
    found: list[Promise] = []
    for procedure, imu in cases():
        if not asked.only or procedure.id in asked.only:
            rate = settings_of(procedure, imu).rate_hz
            made = settings_of(procedure, imu, max(rate, TURNING.get(procedure.id, 0)))
            found += promises(made, asked.runs)
    rows = "\n".join(told(found)) + "\n"
    print(rows)
    if not asked.only:
        PAGE.write_text(HEAD.format(runs=asked.runs) + rows, encoding="utf-8")


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
