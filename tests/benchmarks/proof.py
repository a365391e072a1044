"""Predictions against the stand, at length: `make proof` writes docs/proof.md.

Every case is what `stand rehearse PROCEDURE --imu IMU --rate HZ --latitude DEG --verify RUNS` does:
the catalogue's procedures in both hemispheres, and procedures by number (tests/generated.py) with
tilted, random and unequal positions. The runs of a case are kept in recordings/proof, so that an
interrupted proof goes on where it was; they know nothing of predictions, which are made anew each
time. Remove that folder when stand or estimators have changed.
"""

import argparse
import pickle
import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import Path

from stand.imu import ImuSpec, load_imu
from stand.imu.preset import imu_from
from stand.procedure.procedure import Procedure, load_procedure, table_of
from stand.rehearsal.rehearse import rehearse
from stand.rehearsal.verification import AGREES, Achieved, Verification
from stand.rehearsal.verify import with_verification
from stand.simulation.settings import assembled, site_with
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
HEAD = """# Predicted against achieved

What `stand rehearse` predicts, over what runs of the whole stand come to (root mean square of the
errors against the truth; each run draws its unit, its table and its sway anew). Range over the
stretches of a procedure, with the lowest and the highest end of their plain 95 % intervals (one in
twenty misses). A prediction stands where every interval, widened until all of a case hold at once
in 95 %, meets {low:g} to {high:g}. Made by `{command}`: {runs} runs a case, no two of them with a
draw in common; {rates}. Procedures `generated-N` have two to twelve rests of 5 to 1800 s at random
attitudes on a tilted base (tests/generated.py); unit `all-terms` is the stim300 with rate random
walk, ramps, asymmetry and quadratic terms.

| procedure | latitude | unit | method | quantity | ratio | intervals within | stands | runs |
|---|---|---|---|---|---|---|---|---|
"""
AT_LENGTH = (
    "at 50 Hz where the table rests, at 20 Hz where it turns or rocks and for `generated-N` "
    "(icm42688p at 100 Hz and adis16470 at 200 Hz, whose rounding needs its noise)"
)


@dataclass(frozen=True, slots=True)
class Asked:
    """One case of the proof; `rate` [Hz] is what `--rate` says, if it does."""

    procedure: Procedure
    latitude_deg: float
    imu: str
    rate: int | None

    @property
    def rate_hz(self) -> int:
        """The rate of its runs."""
        own = RATES_HZ.get(self.procedure.id, GENERATED_HZ)
        return self.rate or max(FASTER_HZ.get(self.imu, 0), own)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=2000)
    parser.add_argument("--rate", type=int, help="Hz, of all cases, with rounding off")
    parser.add_argument("--only", nargs="*", default=[], help="PROCEDURE or PROCEDURE/IMU")
    parser.add_argument("--imus", nargs="*", default=list(IMUS), choices=list(IMUS))
    parser.add_argument("--write", action="store_true", help="the page, of `--only` too")
    asked = parser.parse_args()
    KEPT.mkdir(parents=True, exist_ok=True)
    rows: list[str] = []
    for one in cases(asked.rate):
        name = one.procedure.id
        wanted = not asked.only or {name, f"{name}/{one.imu}"} & set(asked.only)
        if wanted and one.imu in asked.imus:
            rows += told(one, case(one, asked.runs))
    rates = f"at {asked.rate} Hz, with rounding off" if asked.rate else AT_LENGTH
    command = " ".join(["tests/benchmarks/proof.py", *sys.argv[1:]])
    head = HEAD.format(low=AGREES[0], high=AGREES[1], runs=asked.runs, rates=rates, command=command)
    print("\n".join(rows))
    if asked.write or not asked.only:
        PAGE.write_text(head + "\n".join(rows) + "\n", encoding="utf-8")


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


def case(asked: Asked, runs: int) -> Verification:
    """One case: runs from an earlier proof if they are there, beside what is predicted now."""
    procedure, imu = asked.procedure, unit(asked.imu)
    site = site_with(procedure.entry.site.site(), asked.latitude_deg, None)
    off = ("quantisation",) if asked.rate else ()
    made_of = assembled(procedure, imu, table_of(procedure), site, asked.rate_hz, without=off)
    result = rehearse(made_of)
    name = f"{procedure.id}_{asked.latitude_deg:g}_{asked.imu}_{asked.rate_hz}_{runs}"
    kept = KEPT / f"{name}.pickle"
    if not any(p.determined for p in result.predictions):  # nothing that runs could contradict
        untold = (
            Achieved(p.method, p.window, p.label, p.quantity, p.unit, p.per, None, 0, 0.0, 0.0, 0.0)
            for p in result.predictions
        )
        return Verification(0, 0, 0, 0.0, tuple(untold))
    if not kept.exists():
        made = with_verification(result, made_of, runs).verification
        if made is None or made.interrupted:
            raise KeyboardInterrupt
        kept.write_bytes(pickle.dumps(made))
    made = pickle.loads(kept.read_bytes())
    predicted = {(p.method, p.window, p.label, p.quantity): p.rms for p in result.predictions}
    achieved = [
        replace(a, predicted=predicted[key])
        for a in made.achieved
        if (key := (a.method, a.window, a.label, a.quantity)) in predicted
    ]
    return replace(made, achieved=tuple(achieved))


def told(asked: Asked, found: Verification) -> Iterator[str]:
    """A row per method and quantity."""
    lead = f"| {asked.procedure.id} | {asked.latitude_deg:.1f} | {asked.imu} ({IMUS[asked.imu]})"
    for (method, quantity), group in groupby(sorted(found.achieved, key=_kind), _kind):
        every = list(group)
        rows = [a for a in every if a.ratio is not None]
        if len(rows) < len(every):
            yield f"{lead} | {method} | {quantity} | not determined | | | |"
        if rows:
            ratios, lows, highs = zip(*(a.ratio for a in rows if a.ratio), strict=True)
            ends = f"{min(lows):.2f} to {max(highs):.2f}"
            ratio = " to ".join(dict.fromkeys((f"{min(ratios):.2f}", f"{max(ratios):.2f}")))
            stands = "yes" if all(a.agrees for a in rows) else "**no**"
            runs = min(a.runs for a in rows)
            yield f"{lead} | {method} | {quantity} | {ratio} | {ends} | {stands} | {runs} |"
    for refused in found.refused:
        why = refused.reason.split(": ", 1)[-1]
        yield f"{lead} | {refused.method} | | no answer in {refused.runs} runs: {why} | | | |"


def _kind(a: Achieved) -> tuple[str, str]:
    """Method and quantity, without the axis of a bias."""
    sensor, bias, _ = a.quantity.partition(" bias ")
    return f"{a.method} {a.window}".strip(), f"{sensor} bias" if bias else a.quantity


if __name__ == "__main__":
    main()
