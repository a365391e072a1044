"""What a run left behind, and its JSON form."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from alignment.units import DEG
from stand.evaluation.score import (
    Refusal,
    Score,
    Spread,
    refusal_to_json,
    score_to_json,
    spread_to_json,
)
from stand.imu import unstated
from stand.motion.plan import Plan
from stand.samples import CHANNELS
from stand.simulation.settings import Settings
from stand.simulation.step_record import StepRecord, record_to_json
from stand.versions import versions


@dataclass(frozen=True, slots=True, eq=False)
class RunResult:
    """What a run left behind."""

    out: Path
    settings: Settings
    plan: Plan
    samples: int
    saturated: tuple[int, ...]
    records: tuple[StepRecord, ...]
    scores: tuple[Score, ...]
    spreads: tuple[Spread, ...]
    refusals: tuple[Refusal, ...]


def result_json(result: RunResult) -> dict[str, Any]:
    """The run's result for machines."""
    s = result.settings
    return {
        "procedure": s.procedure.id,
        "imu": s.imu.id,
        "table": s.table.id,
        "seed": s.seed,
        "rate_hz": s.rate_hz,
        "sampling": s.sampling.value,
        "latitude_deg": None if s.site.latitude is None else s.site.latitude / DEG,
        "height_m": s.site.height,
        "gravity_m_s2": s.site.gravity,
        "duration_s": result.plan.steps[-1].t_to,
        "samples": result.samples,
        "without": list(s.without),
        "motion": s.motion.value,
        "true_table": s.true_table,
        "steps": [record_to_json(record) for record in result.records],
        "saturated_samples": dict(zip(CHANNELS, result.saturated, strict=True)),
        "versions": versions(),
        "estimates": [score_to_json(one, s.options.priors.noise_only) for one in result.scores],
        "spreads": [spread_to_json(spread) for spread in result.spreads],
        "refusals": [refusal_to_json(r) for r in result.refusals],
        "unstated": list(unstated(s.imu)),
    }
