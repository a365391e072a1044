"""Predictions against the stand, at length: `make proof` writes docs/proof.md.

Every case is what `stand rehearse PROCEDURE --imu IMU --rate HZ --latitude DEG --verify RUNS` does:
the catalogue's procedures in both hemispheres, and procedures by number (tests/generated.py) with
tilted, random and unequal positions. Sums of the runs of a case are kept in recordings/proof: an
interrupted proof goes on where it was, one of more `--runs` adds what is missing, and `--runs 0`
tells what is there. They know nothing of predictions, which are made anew each time. Remove that
folder when stand or estimators have changed.
"""

import argparse
import json
import sys
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path

from stand.arguments import site_with
from stand.imu import ImuSpec, load_imu
from stand.imu.preset import imu_from
from stand.procedure.procedure import Procedure, load_procedure, table_of
from stand.rehearsal.rehearse import rehearse
from stand.rehearsal.result import Rehearsal
from stand.rehearsal.sums import Sums
from stand.rehearsal.verification import AGREES, Achieved, Verification
from stand.rehearsal.verify import errors_of_runs, first_seed, verification_of
from stand.simulation.cluster import engine_at
from stand.simulation.settings import Settings, assembled
from stand.simulation.work import Engine
from stand.toml_files import Source, find

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "tests"))  # procedures by number are the tests' own

from generated import generated  # noqa: E402

RATES_HZ = {
    "six-position": 50,
    "two-position": 50,
    "four-position": 50,
    "carousel": 20,
    "random-sway": 20,
}
MOVING = ("carousel", "random-sway")
GENERATED, GENERATED_HZ = 10, 20
LATITUDES_DEG = (48.5, -33.0)  # of the catalogue; procedures by number have their own
# noise of a consumer unit must blur its rounding, which low rates do not
FASTER_HZ = {"icm42688p": 100, "adis16470": 200}
ALL_TERMS = "all-terms"
IMUS = {
    "icm42688p": "consumer",
    "adis16470": "industrial",
    "stim300": "tactical",
    "ring-laser": "navigation",
    "hg9900": "navigation",
    ALL_TERMS: "stim300 with drifts, asymmetry and quadratic terms",
}
_ASSUMED = 'kind = "typical", source = "assumed"'
_ADDED = {
    "[gyro]": {
        "rate_random_walk_deg_h_rt_h": 0.3,
        "rate_ramp_deg_h_h": 0.3,
        "scale_asymmetry_ppm": 100,
        "g2_sensitivity_deg_h_g2": 0.2,
    },
    "[accel]": {
        "acceleration_random_walk_ug_rt_h": 20,
        "acceleration_ramp_ug_h": 20,
        "scale_asymmetry_ppm": 50,
        "second_order_ug_g2": 30,
    },
}
KEPT, PAGE = ROOT / "recordings" / "proof", ROOT / "docs" / "proof.md"
EACH = 25  # runs between what is kept
HEAD = """# Predicted against achieved

What `stand rehearse` predicts, over what runs of the whole stand come to (root mean square of the
errors against the truth; each run draws its unit, its table and its sway anew). Each cell has the
range of that ratio over the stretches of a procedure, and in brackets the lowest and the highest
end of their plain 95 % intervals (one in twenty misses). A prediction stands where every interval,
widened until all of a case hold at once in 95 %, meets {low:g} to {high:g}.

Made by `{command}`, no two runs with a draw in common; {rates}. Procedures `generated-N` have two
to twelve rests of 5 to 1800 s at random attitudes on a tilted base (tests/generated.py); unit
`all-terms` is the stim300 with rate random walk, ramps, asymmetry and quadratic terms.

{summary}

| procedure | latitude | unit | method | heading | tilt and yaw | biases | stands | runs |
|---|---|---|---|---|---|---|---|---|
"""
AT_LENGTH = (
    "at 50 Hz where the table rests, at 20 Hz where it turns or rocks and for `generated-N` "
    "(icm42688p at 100 Hz and adis16470 at 200 Hz, whose rounding needs its noise)"
)
COLUMNS = ("heading", "tilt and yaw", "biases")


@dataclass(frozen=True, slots=True)
class Asked:
    """One case of the proof; `rate` [Hz] is what `--rate` says, if it does."""

    procedure: Procedure
    latitude_deg: float
    imu: str
    rate: int | None

    @property
    def rate_hz(self) -> int:
        """The rate of its runs; where the table moves no lower one than its own."""
        own = RATES_HZ.get(self.procedure.id, GENERATED_HZ)
        if self.rate is None:
            return max(FASTER_HZ.get(self.imu, 0), own)
        return max(self.rate, own) if self.procedure.id in MOVING else self.rate

    def settings(self) -> Settings:
        """What is rehearsed and run."""
        site = site_with(self.procedure.entry.site.site(), self.latitude_deg, None)
        off = ("quantisation",) if self.rate else ()
        table, imu = table_of(self.procedure), unit(self.imu)
        return assembled(self.procedure, imu, table, site, self.rate_hz, without=off)


@dataclass(frozen=True, slots=True)
class Case:
    """One case: what is predicted, and what runs of it came to."""

    asked: Asked
    result: Rehearsal
    found: Verification


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=2000)
    parser.add_argument("--rate", type=int, help="Hz, where the table rests, with rounding off")
    parser.add_argument("--only", nargs="*", default=[], help="PROCEDURE or PROCEDURE/IMU")
    parser.add_argument("--imus", nargs="*", default=list(IMUS), choices=list(IMUS))
    parser.add_argument("--workers", type=int, help="processes; as many as there are cores")
    parser.add_argument("--scheduler", help="of a Dask cluster, or local")
    parser.add_argument("--write", action="store_true", help="the page, of `--only` too")
    asked = parser.parse_args()
    KEPT.mkdir(parents=True, exist_ok=True)
    made: list[Case] = []
    engine = None if asked.scheduler is None else engine_at(asked.scheduler)
    for one in cases(asked.rate):
        name = one.procedure.id
        wanted = not asked.only or {name, f"{name}/{one.imu}"} & set(asked.only)
        if wanted and one.imu in asked.imus:
            made.append(case(one, asked.runs, asked.workers, engine))
            print("\n".join(told(made[-1])), flush=True)
    print(summary(made))
    if asked.write or not asked.only:
        rates = AT_LENGTH
        if asked.rate:
            rates = f"at {asked.rate} Hz (at 20 Hz where the table moves), with rounding off"
        command = " ".join(["tests/benchmarks/proof.py", *sys.argv[1:]])
        told_of = {"rates": rates, "command": command, "summary": summary(made)}
        text = HEAD.format(low=AGREES[0], high=AGREES[1], **told_of)
        rows = [row for one in made for row in told(one)]
        PAGE.write_text(text + "\n".join(rows) + "\n", encoding="utf-8")


def cases(rate: int | None) -> Iterator[Asked]:
    """All of them, procedure by procedure."""
    for name in RATES_HZ:
        for latitude in LATITUDES_DEG:
            for imu in IMUS:
                yield Asked(load_procedure(name), latitude, imu, rate)
    for number in range(GENERATED):
        procedure = generated(number).procedure
        for imu in IMUS:
            yield Asked(procedure, procedure.entry.site.latitude_deg, imu, rate)


def unit(name: str) -> ImuSpec:
    """A preset, or the stim300 with every term that it does not state."""
    if name != ALL_TERMS:
        return load_imu(name)
    text = find("imus", "IMU", "stim300").text
    for head, terms in _ADDED.items():
        lines = [f"{key} = {{ value = {value}, {_ASSUMED} }}" for key, value in terms.items()]
        text = text.replace(f"\n{head}\n", "\n".join(["", head, *lines, ""]))
    return imu_from(Source(ALL_TERMS, ALL_TERMS, text))


def case(asked: Asked, runs: int, workers: int | None, engine: Engine | None = None) -> Case:
    """One case: the runs there are and those that are missing, beside what is predicted now."""
    made = asked.settings()
    result, first = rehearse(made), first_seed(made)
    if not any(p.determined for p in result.predictions):  # nothing that runs could contradict
        runs = 0
    # named by its first seed, which comes of all that makes the case
    kept = KEPT / f"{asked.procedure.id}_{asked.imu}_{first}.json"
    data = json.loads(kept.read_text()) if kept.exists() else {"seconds": 0.0}
    sums = Sums.from_json(data["sums"]) if "sums" in data else Sums()
    before, begin = data["seconds"], time.perf_counter()
    numbers = range(sums.runs, runs)
    with closing(errors_of_runs(result, made, numbers, workers, engine)) as trials:
        for found in trials:
            sums.add(found)
            if sums.runs % EACH == 0 or sums.runs == runs:
                seconds = before + time.perf_counter() - begin
                part = kept.with_suffix(".part")
                part.write_text(json.dumps({"seconds": seconds, "sums": sums.to_json()}))
                part.replace(kept)
    seconds = before + time.perf_counter() - begin
    return Case(asked, result, verification_of(result, sums, sums.runs, first, seconds))


def told(one: Case) -> Iterator[str]:
    """A row per method."""
    asked, found = one.asked, one.found
    lead = f"| {asked.procedure.id} | {asked.latitude_deg:.1f} | {asked.imu}"
    for (method, window), group in groupby(one.result.predictions, lambda p: (p.method, p.window)):
        predicted = list(group)
        own = [a for a in found.achieved if (a.method, a.window) == (method, window)]
        cells = []
        for column in COLUMNS:
            rows = [a for a in own if _column(a.quantity) == column and a.ratio is not None]
            untold = [p for p in predicted if _column(p.quantity) == column and not p.determined]
            cells.append(_cell(rows, len(untold)))
        off = any(a.agrees is False for a in own)
        compared = any(a.ratio is not None for a in own)
        stands = "**no**" if off else "yes" if compared else ""
        cells += [stands, str(min((a.runs for a in own), default=0) or "")]
        yield f"{lead} | {f'{method} {window}'.strip()} | {' | '.join(cells)} |"
    for refused in found.refused:
        why = refused.reason.split(": ", 1)[-1]
        yield f"{lead} | {refused.who} | no answer in {refused.runs} runs: {why} | | | | |"


def _column(quantity: str) -> str:
    """Which of `COLUMNS` a quantity belongs to."""
    return "heading" if quantity == "heading" else "biases" if "bias" in quantity else COLUMNS[1]


def _cell(rows: Sequence[Achieved], untold: int) -> str:
    """Ratios of some quantities, and of how many no number is predicted."""
    parts = []
    if rows:
        ratios, lows, highs = zip(*(a.ratio for a in rows if a.ratio), strict=True)
        ends = dict.fromkeys((f"{min(ratios):.2f}", f"{max(ratios):.2f}"))
        parts.append(f"{' to '.join(ends)} ({min(lows):.2f} to {max(highs):.2f})")
    if untold:
        parts.append(f"{untold} not determined" if rows else "not determined")
    return "; ".join(parts)


def summary(made: Iterable[Case]) -> str:
    """How many numbers were compared, which are off, and how long it all takes."""
    every = [(one, a) for one in made for a in one.found.achieved if a.ratio is not None]
    empty = sum(
        not one.found.done and any(p.determined for p in one.result.predictions) for one in made
    )
    off = [(one, a) for one, a in every if a.agrees is False]
    alone = sum(a.agrees_alone is False for _, a in every)
    missed = sum(not a.ratio[1] <= 1 <= a.ratio[2] for _, a in every if a.ratio)
    lines = [
        f"{len(every)} numbers compared. The plain intervals of {missed} ({_part(missed, every)}) "
        f"do not hold 1; of {alone} ({_part(alone, every)}) they do not meet {AGREES[0]:g} to "
        f"{AGREES[1]:g}; {len(off)} are contradicted.",
    ]
    lines += [
        f"- contradicted: {one.asked.procedure.id}, {one.asked.imu}, {a.method} at {a.label}: "
        f"{a.quantity} {a.ratio[0]:.2f} ({a.ratio[1]:.2f} to {a.ratio[2]:.2f})"
        for one, a in off
        if a.ratio
    ]
    spent = sum(one.found.seconds for one in made)
    runs = sum(one.found.done for one in made)
    lines.append(
        f"\n{len(made)} cases, {empty} of them without runs yet; {runs} runs, {spent / 3600:.2g} h."
    )
    return "\n".join(lines)


def _part(some: int, every: Sequence[object]) -> str:
    return f"{100 * some / max(len(every), 1):.1f} %"


if __name__ == "__main__":
    main()
