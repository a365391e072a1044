"""A rehearsal's result for machines."""

from math import isfinite
from typing import Any

from alignment.units import DEG
from stand.rehearsal.result import (
    Advice,
    Judgement,
    Prediction,
    Rehearsal,
    StepDuration,
    StepFeasibility,
)
from stand.rehearsal.rocking_allowed import admissible_json
from stand.rehearsal.verification import Achieved, Verification


def rehearsal_json(result: Rehearsal) -> dict[str, Any]:
    """The whole answer for machines: degrees and the units named; null where there is no value."""
    d, i, v = result.duration, result.inputs, result.verification
    return {
        "verdict": result.verdict.value,
        "feasible": result.feasible,
        "accurate": result.accurate,
        "inputs": {
            "procedure": {"id": i.procedure, "title": i.procedure_title},
            "imu": {"id": i.imu, "title": i.imu_title},
            "table": {"id": i.table, "title": i.table_title},
            "latitude_deg": i.latitude_deg,
            "height_m": i.height_m,
            "rate_hz": i.rate_hz,
            "revision": i.revision,
            "sha256": dict(i.sha256),
            "versions": dict(i.versions),
        },
        "judgements": [_judgement(j) for j in result.judgements],
        "admissible_rocking": [admissible_json(r) for r in result.rocking],
        "findings": [
            {"severity": f.severity.value, "kind": f.kind, "step": f.step, "text": f.text}
            for f in result.findings
        ],
        "feasibility": [_feasibility(s) for s in result.feasibility],
        "duration": {
            "motion_s": d.motion,
            "settling_s": d.settling,
            "dwell_s": d.dwell,
            "total_s": d.total,
            "steps": [_duration(s) for s in d.steps],
        },
        "predictions": [_prediction(p) for p in result.predictions],
        "observability": [
            {
                "method": o.method,
                "rank": o.rank,
                "sought": o.sought,
                "condition": _finite(o.condition),
                "unseen": list(o.unseen),
            }
            for o in result.observability
        ],
        "advice": [_advice(a) for a in result.advice],
        "verification": None if v is None else _verification(v),
    }


def _finite(value: float | None) -> float | None:
    return value if value is not None and isfinite(value) else None


def _degrees(angle: float | None) -> float | None:
    return None if angle is None else _finite(angle / DEG)


def _judgement(j: Judgement) -> dict[str, Any]:
    """Angles in degrees; of a unit's constants in `unit`, the keys without one."""
    of_angle = j.unit == "deg"
    sizes = {"required": j.required, "sigma": j.sigma, "bias": j.bias, "rms": j.rms}
    sizes["expanded"] = j.expanded
    told = {
        f"{name}_deg" if of_angle else name: None if x is None else _finite(x / j.per)
        for name, x in sizes.items()
    }
    return {
        "quantity": j.quantity,
        "verdict": j.verdict.value,
        "method": j.method,
        "label": j.label,
        **({} if of_angle else {"unit": j.unit}),
        **told,
        "noise_only": j.noise_only,
        "coverage": j.coverage,
        "guard": j.guard,
        "reason": j.reason,
    }


def _feasibility(s: StepFeasibility) -> dict[str, Any]:
    return {
        "step": s.number,
        "kind": s.kind,
        "label": s.label,
        "t_from_s": s.t_from,
        "t_to_s": s.t_to,
        "feasible": s.feasible,
        "settling_s": s.settling_s,
        "turns": dict(s.turns),
        "margins": [
            {
                "quantity": m.quantity,
                "axis": m.axis,
                "value": _finite(m.value),
                "limit": _finite(m.limit),
                "unit": m.unit,
                "used": _finite(m.ratio),
                "t_s": m.t,
                "first_violation_s": m.first_violation,
            }
            for m in s.margins
        ],
    }


def _duration(s: StepDuration) -> dict[str, Any]:
    return {
        "step": s.number,
        "kind": s.kind,
        "label": s.label,
        "t_from_s": s.t_from,
        "t_to_s": s.t_to,
        "motion_s": s.motion,
        "settling_s": s.settling,
        "dwell_s": s.dwell,
    }


def _prediction(p: Prediction) -> dict[str, Any]:
    return {
        "method": p.method,
        "window": p.window,
        "label": p.label,
        "quantity": p.quantity,
        "unit": p.unit,
        "sigma": None if p.sigma is None else p.sigma / p.per,
        "bias": None if p.sigma is None else p.bias / p.per,
        "rms": None if p.rms is None else p.rms / p.per,
        "noise_only": p.noise_only,
        "contributions": {c.source: c.sigma / p.per for c in p.contributions},
        "reason": p.reason,
    }


def _verification(v: Verification) -> dict[str, Any]:
    return {
        "runs_asked": v.requested,
        "runs": v.done,
        "contradicted": len(v.disagreeing),
        "missed_by_plain_intervals": len(v.missing_alone),
        "seed": v.seed,
        "seconds": v.seconds,
        "achieved": [_achieved(a) for a in v.achieved],
        "refused": [
            {
                "method": r.method,
                "stretch": r.stretch,
                "runs": r.runs,
                "reason": r.reason,
                "contradicts": r in v.silent,
            }
            for r in v.refused
        ],
    }


def _achieved(a: Achieved) -> dict[str, Any]:
    """Sizes in `unit`; ratio is predicted over achieved, with its plain 95 % interval, and with
    that in which all hold at once, by which it `agrees`."""
    sizes = {"sigma": a.sigma, "low": a.low, "high": a.high}
    ratio, low, high = a.ratio or (None, None, None)
    all_low, all_high = a.widened or (None, None)
    return {
        "method": a.method,
        "window": a.window,
        "label": a.label,
        "quantity": a.quantity,
        "unit": a.unit,
        "runs": a.runs,
        "predicted": None if a.predicted is None else a.predicted / a.per,
        "noise_only": a.noise_only,
        **{name: size / a.per for name, size in sizes.items()},
        "ratio": ratio,
        "ratio_low": low,
        "ratio_high": high,
        "ratio_low_of_all": all_low,
        "ratio_high_of_all": all_high,
        "agrees": a.agrees,
        "agrees_alone": a.agrees_alone,
    }


def _advice(a: Advice) -> dict[str, Any]:
    return {
        "quantity": a.quantity,
        "helps": a.helps,
        "text": a.text,
        "changes": [{"where": c.where, "before": c.before, "after": c.after} for c in a.changes],
        "sigma_deg": _degrees(a.sigma),
        "noise_only": a.noise_only,
        "duration_s": a.duration,
        "procedure_toml": a.toml,
    }
