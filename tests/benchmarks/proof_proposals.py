"""Proposals for generated requirements, tables and units: each passes its own rehearsal, and no
neighbour of it does.

    python tests/benchmarks/proof_proposals.py --requirements 30

A neighbour is the test with a station left out, or with a rest a fifth shorter (not one that is at
its shortest). Requirements are drawn: some constants of the unit at 1.2 to 6 times what the full
calibration of the catalogue reaches, or a heading at 1.2 to 5 times what two rests reach in 600 s.
"""

import argparse
import sys
from pathlib import Path

import numpy as np

from stand.errors import StandError
from stand.procedure.procedure import procedure_from
from stand.procedure.requirements import CONSTANTS
from stand.proposal.information import settings_of
from stand.proposal.propose import propose
from stand.proposal.wanted import wanted_of
from stand.rehearsal.rehearse import rehearse
from stand.rehearsal.requirement import rows_of
from stand.rehearsal.result import Verdict
from stand.rehearsal.wording import toml_of
from stand.simulation.settings import Settings, settings
from stand.toml_files import Source

UNITS = ("stim300", "hg9900", "adis16470", "ring-laser")
TABLES = ("precision", "mid-class", "laboratory", "rocking-platform")
RATE_HZ = 50
LONGEST_S = 6 * 3600.0


def reached(unit: str, table: str) -> dict[str, float]:
    """What classical tests reach, by key of [require]."""
    found = {}
    full = rehearse(settings("calibration-full", unit, table, rate_hz=RATE_HZ))
    for quantity, constant in CONSTANTS.items():
        rows = [p.sigma for p in rows_of(quantity, full.predictions) if p.sigma]
        if rows:
            found[constant.key] = max(rows) / constant.unit[1]
    rests = rehearse(settings("two-position", unit, table, rate_hz=RATE_HZ))
    headings = [p.sigma for p in rows_of("heading", rests.predictions) if p.sigma]
    if headings:
        found["heading_deg"] = float(np.degrees(min(headings)))
    return found


def drawn(known: dict[str, float], rng: np.random.Generator) -> dict[str, object]:
    """A requirement."""
    heading = "heading_deg" in known and rng.random() < 0.3
    if heading:
        return {"heading_deg": min(20.0, float(2 * known["heading_deg"] * rng.uniform(1.2, 5)))}
    keys = [key for key in known if key != "heading_deg"]
    some = rng.choice(keys, size=rng.integers(1, len(keys) + 1), replace=False)
    limits: dict[str, object] = {
        str(k): float(known[str(k)] * np.exp(rng.uniform(np.log(1.2), np.log(6)))) for k in some
    }
    return limits | {"coverage": 1.0, "guard": float(rng.choice([0.0, 0.1]))}


def passing_neighbours(text: str, made: Settings) -> list[str]:
    """Neighbours that keep the requirement as well."""
    entry = procedure_from(Source("proposal", "proposal", text)).entry
    found = []
    for k, step in enumerate(entry.step):
        if step.kind == "move":
            continue
        others = [(f"without {step.label}", (*entry.step[:k], *entry.step[k + 1 :]))]
        if step.kind == "dwell" and step.duration_s > 2.0 * 1.01:
            less = step.model_copy(update={"duration_s": 0.8 * step.duration_s})
            others.append((f"{step.label} shorter", (*entry.step[:k], less, *entry.step[k + 1 :])))
        for name, steps in others:
            changed = entry.model_copy(update={"step": steps})
            data = changed.model_dump(exclude_unset=True, exclude_none=True, mode="json")
            try:
                answer = rehearse(settings_of(toml_of(data), made))
            except StandError:
                continue
            if answer.verdict is Verdict.PASS:
                found.append(name)
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--requirements", type=int, default=30, help="of each unit on each table")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, help="also write the lines there")
    arguments = parser.parse_args()
    lines, faults, none, count = [], 0, 0, 0
    for unit in UNITS:
        for table in TABLES:
            known = reached(unit, table)
            for n in range(arguments.requirements):
                rng = np.random.default_rng([arguments.seed, n, len(lines)])
                require = drawn(known, rng)
                made = settings("calibration-full", unit, table, rate_hz=RATE_HZ)
                found = propose(wanted_of(require, {"max_time_s": LONGEST_S}), made)
                count += 1
                told = ", ".join(f"{k} {v:.3g}" for k, v in require.items())
                if not found.feasible:
                    none += 1
                    lines.append(f"{unit} {table}: {told}: none: {found.reason}")
                else:
                    passes = rehearse(settings_of(found.text, made)).verdict is Verdict.PASS
                    others = passing_neighbours(found.text, made)
                    faults += not passes or bool(others)
                    lines.append(
                        f"{unit} {table}: {told}: {found.total:.0f} s (bound {found.bound:.0f}), "
                        f"{len(found.stations)} stations"
                        + ("" if passes else ": ITS OWN REHEARSAL FAILS")
                        + (f": {'; '.join(others)} WOULD DO" if others else "")
                    )
                print(lines[-1], flush=True)
    lines.append(f"{count} requirements, {none} without a test, {faults} faults")
    print(lines[-1])
    if arguments.out is not None:
        arguments.out.write_text("\n".join(lines) + "\n")
    sys.exit(bool(faults))


if __name__ == "__main__":
    main()
