"""Procedures and units that nobody tuned anything to: `make proof` writes docs/proof-units.md.

Any keys of a sheet at once, any rests, spins and rocking (tests/generated_units.py): what is
predicted beside what runs come to, and what runs claim beside what they are off by. Cases are kept
in recordings/proof-units; a case that has `--runs` or more is not run again, and `--runs 0` writes
the page of what is there. Remove that folder when stand or estimators have changed.
"""

import argparse
import json
import sys
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "tests"))  # cases by number are the tests' own

from generated_units import COUNT, SPREAD, unit_case  # noqa: E402
from normalised import UNDETERMINED, Promise, promises  # noqa: E402

from stand.rehearsal.rehearse import rehearse  # noqa: E402
from stand.rehearsal.verification import AGREES, Achieved, Refused  # noqa: E402
from stand.rehearsal.verify import with_verification  # noqa: E402

KEPT, PAGE = ROOT / "recordings" / "proof-units", ROOT / "docs" / "proof-units.md"
HEAD = """# Any unit on any procedure

Procedures and units drawn at random together (tests/generated_units.py): about half of what a data
sheet can state, each key within a factor of {spread:g} of its grade, navigation to consumer; one to
five rests of 3 to 300 s or spins of 1 to 6 turns at any attitude, on a tilted or rocking base, at
latitudes to 85 deg, 2 to 50 Hz, means or instants. Every method that takes the procedure.

Predicted: numbers of `stand rehearse` over what {runs} runs come to. Stated: squared errors over
the covariances that the runs state, per degree of freedom. Both are judged by intervals that hold
for all numbers of this page at once in 95 of 100 such pages, predictions by whether theirs meet
{low:g} to {high:g}, sigmas by whether they are not too small; wide ones are counted where they are
more than three times too large. Made by `tests/benchmarks/proof_units.py --runs {runs}`.

{summary}

| case | unit's grade | rate | predicted | contradicted | stated | too small | too large | what |
|---|---|---|---|---|---|---|---|---|
"""
LARGE = 1 / 9  # squared error per degree of freedom of a sigma three times too large


@dataclass(frozen=True, slots=True)
class Found:
    """What a case came to."""

    number: int
    grade: str
    rate_hz: int
    runs: int
    achieved: tuple[Achieved, ...]
    silent: tuple[Refused, ...]
    promises: tuple[Promise, ...]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=16)
    parser.add_argument("--only", nargs="*", type=int, default=[], help="NUMBER")
    parser.add_argument("--among", type=int, help="numbers of a page that a case is judged by")
    parser.add_argument("--workers", type=int, help="processes; as many as there are cores")
    asked = parser.parse_args()
    every = []
    for number in asked.only or range(COUNT):
        one = kept_or_made(number, asked.runs, asked.workers)
        every.append(one)
        if asked.runs:
            print(row(one, asked.among or 2000), flush=True)
    compared, stated = numbers(every)
    print(summary(every))
    if not asked.only:
        text = HEAD.format(
            spread=SPREAD,
            runs=min(one.runs for one in every),
            low=AGREES[0],
            high=AGREES[1],
            summary=summary(every),
        )
        rows = "\n".join(row(one, max(compared, stated)) for one in every)
        PAGE.write_text(f"{text}{rows}\n", encoding="utf-8")


def kept_or_made(number: int, runs: int, workers: int | None = None) -> Found:
    """A case as it is kept, or made now."""
    path = KEPT / f"{number}.json"
    if path.exists():
        there = found_from(json.loads(path.read_text(encoding="utf-8")))
        if there.runs >= runs:
            return there
    settings = unit_case(number)
    result = with_verification(rehearse(settings), settings, max(runs, 1), workers=workers)
    made, unit = result.verification, settings.imu
    stated = promises(settings, max(runs, 1), workers=workers) if made is not None else []
    found = Found(
        number=number,
        grade=unit.entry.grade,
        rate_hz=settings.rate_hz,
        runs=max(runs, 1),
        achieved=() if made is None else made.achieved,
        silent=() if made is None else made.silent,
        promises=tuple(stated),
    )
    KEPT.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(asdict(found)), encoding="utf-8")
    return found


def found_from(data: dict[str, Any]) -> Found:
    """A case from its file."""
    own = {
        "achieved": tuple(Achieved(**one) for one in data["achieved"]),
        "silent": tuple(Refused(**one) for one in data["silent"]),
        "promises": tuple(_promise(one) for one in data["promises"]),
    }
    return Found(**data | own)


def _promise(entry: dict[str, Any]) -> Promise:
    return Promise(**entry | {name: tuple(entry[name]) for name in ("values", "freedoms")})


def numbers(every: Sequence[Found]) -> tuple[int, int]:
    """How many predictions are compared, and how many sigmas are stated."""
    compared = sum(a.ratio is not None for one in every for a in one.achieved)
    return compared, sum(bool(p.values) for one in every for p in one.promises)


def contradicted(one: Found, among: int) -> list[Achieved]:
    """Predictions that the runs contradict, by the family of all."""
    return [a for a in one.achieved if replace(a, among=among).agrees is False]


def too_small(one: Found, among: int) -> list[Promise]:
    """Sigmas that errors are beyond, by the family of all."""
    return [p for p in one.promises if p.values and p.mean > p.bounds(among)[1]]


def too_large(one: Found, among: int) -> list[Promise]:
    """Sigmas that are more than three times too large, by the family of all."""
    rows = [p for p in one.promises if p.values]
    return [p for p in rows if p.mean / p.bounds(among)[0] < LARGE]


def what(one: Found, among: int) -> Iterator[str]:
    """What does not stand, in words."""
    for a in contradicted(one, among):
        assert a.ratio is not None
        yield f"{a.method} {a.label}: {a.quantity} predicted {a.ratio[0]:.2g} of achieved"
    for silent in one.silent:
        yield f"{silent.who}: predicted, and no answer"
    for p in too_small(one, among) + too_large(one, among):
        sigma = np.degrees(p.sigma)
        heading = "no heading" if not p.sigma <= UNDETERMINED else f"heading sigma {sigma:.2g} deg"
        yield f"{p.method} {p.label}: {p.mean:.2g} per freedom ({heading})"


def row(one: Found, among: int) -> str:
    """A case in a line."""
    compared, stated = numbers([one])
    small, large = (len(x) for x in (too_small(one, among), too_large(one, among)))
    off = len(contradicted(one, among)) + len(one.silent)
    return (
        f"| {one.number} | {one.grade} | {one.rate_hz} Hz | {compared} | {off or ''} | {stated} "
        f"| {small or ''} | {large or ''} | {'; '.join(what(one, among))} |"
    )


def summary(every: Sequence[Found]) -> str:
    """How many numbers stand."""
    compared, stated = numbers(every)
    among = max(compared, stated)
    off = sum(len(contradicted(one, among)) + len(one.silent) for one in every)
    small, large = (sum(len(x(one, among)) for one in every) for x in (too_small, too_large))
    return (
        f"{len(every)} cases: of {compared} predictions {off} are contradicted; of {stated} stated "
        f"covariances {small} are too small and {large} more than three times too large."
    )


if __name__ == "__main__":
    main()
