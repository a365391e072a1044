"""Predictions against the stand, at length: `make proof` writes docs/proof.md.

Every case is what `stand rehearse PROCEDURE --imu IMU --rate HZ --verify 2000` does. The runs of a
case are kept in recordings/proof, so that an interrupted proof goes on where it was; they know
nothing of predictions, which are made anew each time. Remove that folder when stand or estimators
have changed.
"""

import argparse
import pickle
from collections.abc import Iterator
from dataclasses import replace
from itertools import groupby
from pathlib import Path

from stand.imu import load_imu
from stand.procedure.procedure import load_procedure, table_of
from stand.rehearsal.rehearse import rehearse
from stand.rehearsal.verification import AGREES, Achieved, Verification
from stand.rehearsal.verify import with_verification
from stand.simulation.settings import assembled

RATES_HZ = {
    "six-position": 50,
    "two-position": 50,
    "four-position": 50,
    "carousel": 20,
    "random-sway": 20,
}
# below some 73 Hz its noise does not blur its rounding, and heading is not determined
FASTER_HZ = {("two-position", "icm42688p"): 100, ("four-position", "icm42688p"): 100}
IMUS = {"icm42688p": "consumer", "stim300": "tactical", "hg9900": "navigation"}
ROOT = Path(__file__).parents[2]
KEPT, PAGE = ROOT / "recordings" / "proof", ROOT / "docs" / "proof.md"
HEAD = """# Predicted against achieved

What `stand rehearse` predicts, over what runs of the whole stand come to (root mean square of the
errors against the truth; each run draws its unit, its table and its sway anew). Range over the
stretches of a procedure, with the lowest and the highest end of their 95 % intervals. A prediction
stands where every interval meets {low:g} to {high:g}. Made by `make proof`: {runs} runs a case,
seeds from 0, at 50 Hz where the table rests (100 Hz for two and four positions of icm42688p, whose
rounding needs its noise) and at 20 Hz where it turns or rocks.

| procedure | unit | method | quantity | ratio | intervals within | stands | runs |
|---|---|---|---|---|---|---|---|
"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=2000)
    parser.add_argument("--only", nargs="*", default=[], help="PROCEDURE or PROCEDURE/IMU")
    asked = parser.parse_args()
    KEPT.mkdir(parents=True, exist_ok=True)
    rows: list[str] = []
    for procedure in RATES_HZ:
        for imu in IMUS:
            if not asked.only or {procedure, f"{procedure}/{imu}"} & set(asked.only):
                rows += told(procedure, imu, case(procedure, imu, asked.runs))
    head = HEAD.format(low=AGREES[0], high=AGREES[1], runs=asked.runs)
    print("\n".join(rows))
    if not asked.only:
        PAGE.write_text(head + "\n".join(rows) + "\n", encoding="utf-8")


def case(procedure: str, imu: str, runs: int) -> Verification:
    """One case: runs from an earlier proof if they are there, beside what is predicted now."""
    rate = FASTER_HZ.get((procedure, imu), RATES_HZ[procedure])
    loaded = load_procedure(procedure)
    site = loaded.entry.site.site()
    asked = assembled(loaded, load_imu(imu), table_of(loaded), site, rate)
    result = rehearse(asked)
    kept = KEPT / f"{procedure}_{imu}_{runs}.pickle"
    if not any(p.determined for p in result.predictions):  # nothing that runs could contradict
        untold = (
            Achieved(p.method, p.window, p.label, p.quantity, p.unit, p.per, None, 0, 0.0, 0.0, 0.0)
            for p in result.predictions
        )
        return Verification(0, 0, 0, 0.0, tuple(untold))
    if not kept.exists():
        made = with_verification(result, asked, runs).verification
        if made is None or made.interrupted:
            raise KeyboardInterrupt
        kept.write_bytes(pickle.dumps(made))
    made = pickle.loads(kept.read_bytes())
    predicted = {(p.method, p.window, p.label, p.quantity): p.rms for p in result.predictions}
    achieved = [
        replace(a, predicted=predicted[key], among=1)
        for a in made.achieved
        if (key := (a.method, a.window, a.label, a.quantity)) in predicted
    ]
    return replace(made, achieved=tuple(achieved))


def told(procedure: str, imu: str, found: Verification) -> Iterator[str]:
    """A row per method and quantity."""
    lead = f"| {procedure} | {imu} ({IMUS[imu]})"
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
