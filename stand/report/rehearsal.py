"""A rehearsal to look at: a page, the same for machines, and JUnit XML for a build server.

`write_report` is the way in.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from stand.folder import refuse_files, write_files
from stand.imu.priors import only
from stand.rehearsal.result import (
    Advice,
    Finding,
    Judgement,
    Prediction,
    Rehearsal,
    Severity,
    StepDuration,
    StepFeasibility,
    Verdict,
)
from stand.rehearsal.result_json import rehearsal_json
from stand.report.document import method_text
from stand.report.figures import Against, Bar, Budget, budget, requirements, timeline
from stand.report.gallery import Position, gallery
from stand.report.junit import junit
from stand.report.page import render, span_text
from stand.report.provenance import provenance
from stand.report.rocking import rocking
from stand.report.tables import TableData
from stand.report.verified import fact, outcome, section
from stand.report.wording import (
    deg_text,
    digits,
    limit_text,
    margin_in_words,
    percent,
    predicted_text,
    sigma_text,
)

PAGE, JSON, JUNIT = "rehearsal.html", "rehearsal.json", "junit.xml"
GRADES = {
    Verdict.CONTRADICTED: "bad",
    Verdict.PASS: "good",
    Verdict.FAIL: "bad",
    Verdict.INDETERMINATE: "open",
}
LEAST_USED = 1e-3  # of a limit: less is told as less
LEAST_SHARE = 1e-3  # of a variance, to be named in the table
CONTRADICTED = "prediction"  # the kind of finding that runs make
MOST_BUDGETS = 24  # rows of the chart; the table has them all


def refuse_report(folder: Path, force: bool = False) -> None:
    """`StandError` where a report is there already, unless `force`."""
    refuse_files(files_of(folder), "--report", force=force)


def files_of(folder: Path) -> list[Path]:
    """What a report is made of."""
    return [folder / name for name in (PAGE, JSON, JUNIT)]


def write_report(result: Rehearsal, folder: Path, *, force: bool = False) -> list[Path]:
    """Write `PAGE`, `JSON` and `JUNIT` into a folder.

    Parameters
    ----------
    result : Rehearsal
        The stand is drawn where its steps have `joints`.
    folder : Path
        Is made where it is not there; what else lies in it stays.
    force : bool
        Replace a report that is there.

    Returns
    -------
    list of Path
        What was written, the page first.

    Raises
    ------
    StandError
        A report is there (and not `force`), or the folder cannot be written.
    """
    refuse_report(folder, force)
    machine = json.dumps(rehearsal_json(result), indent=1, allow_nan=False) + "\n"
    texts = (page(result), machine, junit(result))
    return write_files(dict(zip(files_of(folder), texts, strict=True)))


def page(result: Rehearsal) -> str:
    """The page: HTML that needs nothing else."""
    i = result.inputs
    files = {
        "procedure": (i.procedure, i.procedure_text),
        "imu": (i.imu, i.imu_text),
        "table": (i.table, i.table_text),
    }
    bars = [_bar(s) for s in result.duration.steps]
    content = {
        "inputs": i,
        "site": site_text(i.latitude_deg, i.height_m),
        "verdict": result.verdict.value,
        "grade": GRADES[result.verdict],
        "summary": _summary(result),
        "facts": _facts(result),
        "requirements": _requirements(result.judgements),
        "against": requirements([_against(j) for j in result.judgements]),
        "reasons": [(j.quantity, j.reason) for j in result.judgements if j.reason],
        "findings": [_found(f.severity, f.step, f.text) for f in _before(result)],
        "advice": [_advised(a) for a in result.advice],
        "rocking": next((rocking(r) for r in result.rocking if len(r.curve)), None),
        "duration": _duration(result),
        "timeline": timeline(bars, result.duration.total) if bars else None,
        "broken": list(_broken(result.feasibility)),
        "feasibility": _feasibility(result.feasibility),
        "budget": _budget(result),
        "predictions": _predictions(result.predictions),
        "undetermined": _undetermined(result.predictions),
        "observability": _observability(result),
        "unseen": [(o.method, o.unseen) for o in result.observability if o.unseen],
        "verified": None if result.verification is None else section(result.verification),
        "gallery": gallery(_positions(result), i.model),
        "provenance": provenance(files, i.sha256, i.versions),
    }
    return render("rehearsal.html.j2", content)


def site_text(latitude_deg: float | None, height_m: float) -> str:
    """'latitude 48.5°, height 0 m'."""
    where = "latitude unknown" if latitude_deg is None else f"latitude {latitude_deg:g}°"
    return f"{where}, height {height_m:g} m"


# Verdict -----------------------------------------------------------------------------------------


def _summary(result: Rehearsal) -> str:
    """What the verdict means, in sentences."""
    can = "can run on this table" if result.feasible else "cannot run as it is"
    takes = f"; it takes {span_text(result.duration.total)}" if result.duration.steps else ""
    told = [f"The procedure {can}{takes}."]
    contradicted = result.verdict is Verdict.CONTRADICTED
    if contradicted and result.verification is not None:
        told.insert(0, outcome(result.verification))
    for verdict, words in (
        (Verdict.FAIL, "Will not be met"),
        (Verdict.INDETERMINATE, "Cannot be told"),
        (Verdict.PASS, "Would be met by the prediction" if contradicted else "Will be met"),
    ):
        those = [_asked(j) for j in result.judgements if j.verdict is verdict]
        if those:
            told.append(f"{words}: {', '.join(those)}.")
    if result.duration.steps and not result.judgements:
        told.append("It states no required accuracy.")
    if result.verification is not None and not contradicted:
        told.append(outcome(result.verification))
    return " ".join([*told, *_first_reason(result)])


def _first_reason(result: Rehearsal) -> list[str]:
    """Why it cannot run: the first of what forbids it, and how many more there are."""
    errors = [f.text for f in result.findings if f.severity is Severity.ERROR]
    reasons = errors or list(_broken(result.feasibility))
    more = f" (and {len(reasons) - 1} more)" if len(reasons) > 1 else ""
    return [f"Why it cannot run: {reasons[0]}{more}."] if reasons else []


def _asked(j: Judgement) -> str:
    return f"{j.quantity} within {limit_text(j, j.required)}"


def _facts(result: Rehearsal) -> list[tuple[str, str]]:
    d = result.duration
    if not d.steps:
        return []
    verified = [] if result.verification is None else [fact(result.verification)]
    used = [s.worst.ratio for s in result.feasibility if s.worst is not None]
    return [
        ("takes", span_text(d.total)),
        ("of it measuring", span_text(d.dwell)),
        ("steps", str(len(d.steps))),
        ("limits used to", percent(max(used)) if used else "unknown"),
        ("readings", f"{result.inputs.rate_hz} Hz"),
        *verified,
    ]


def _against(j: Judgement) -> Against:
    ratio = None if j.expanded is None else j.expanded / j.required
    return Against(f"{j.quantity} {limit_text(j, j.required)}", j.verdict.value, ratio, j.guard)


def _requirements(judgements: Sequence[Judgement]) -> TableData | None:
    if not judgements:
        return None
    columns = (
        "quantity", "verdict", "required", "predicted", "of it", "sigma", "judged by", "where",
    )  # fmt: skip
    rows = tuple(
        (
            j.quantity,
            j.verdict.value,
            limit_text(j, j.required),
            "not determined"
            if j.expanded is None
            else limit_text(j, j.expanded) + only(j.noise_only),
            "" if j.expanded is None else percent(j.expanded / j.required),
            _sigma_of(j),
            j.method,
            j.label,
        )
        for j in judgements
    )
    guards = sorted({j.guard for j in judgements})
    notes = (
        "Predicted: sigma (with a known bias in quadrature) times the coverage factor. Where: the "
        "stretch in which it is worst. "
        f"INDETERMINATE: closer to the requirement than the guard band of "
        f"{' or '.join(percent(g) for g in guards)}, or not determined.",
    )
    return TableData("Required accuracy", columns, rows, notes=notes)


def _sigma_of(j: Judgement) -> str:
    """What the coverage factor multiplies: sigma, and a known bias in quadrature with it."""
    if j.sigma is None:
        return ""
    known = "" if not j.bias else f" and bias {limit_text(j, j.bias)}"
    return f"{limit_text(j, j.sigma)}{only(j.noise_only)}{known} × {j.coverage:g}"


def _before(result: Rehearsal) -> list[Finding]:
    """What to know before the run; contradicted predictions stand with those that are verified."""
    return [f for f in result.findings if result.verification is None or f.kind != CONTRADICTED]


def _found(severity: Severity, step: str, text: str) -> dict[str, str]:
    return {"severity": severity.value, "step": step, "text": text}


def _advised(a: Advice) -> dict[str, Any]:
    outcome = []
    if a.sigma is not None:
        outcome.append(f"sigma {deg_text(a.sigma)}{only(a.noise_only)}")
    if a.duration is not None:
        outcome.append(f"takes {span_text(a.duration)}")
    return {
        "quantity": a.quantity,
        "text": a.text,
        "changes": a.changes,
        "outcome": ", ".join(outcome),
        "toml": a.toml.rstrip(),
    }


# Duration ----------------------------------------------------------------------------------------


def _bar(step: StepDuration) -> Bar:
    """Its phases one after the other, motion first."""
    phases, t = [], step.t_from
    for name in ("motion", "settling", "dwell"):
        length = getattr(step, name)
        if length > 0:
            phases.append((name, t, t + length))
            t += length
    return Bar(f"{step.number} {step.label or step.kind}", step.kind, tuple(phases))


def _duration(result: Rehearsal) -> TableData:
    d = result.duration
    rows = tuple(
        (
            str(s.number), s.label, s.kind, _seconds(s.t_from),
            *(_seconds(x, blank=True) for x in (s.motion, s.settling, s.dwell)),
            _seconds(s.t_to - s.t_from),
        )
        for s in d.steps
    )  # fmt: skip
    sums = tuple(_seconds(x) for x in (d.motion, d.settling, d.dwell, d.total))
    columns = ("step", "label", "kind", "begins s", "motion s", "settling s", "dwell s", "all s")
    return TableData("Duration", columns, rows, (("", "all steps", "", "", *sums),))


def _seconds(value: float, blank: bool = False) -> str:
    return "" if blank and value == 0 else f"{round(value, 2):g}"


# Feasibility -------------------------------------------------------------------------------------


def _broken(steps: Iterable[StepFeasibility]) -> Iterator[str]:
    for step in steps:
        for margin in step.margins:
            if not margin.kept:
                yield f'Step {step.number} "{step.label}": {margin_in_words(margin)}'


def _feasibility(steps: Sequence[StepFeasibility]) -> TableData:
    """Per step how much of each limit is used at most, by which axis."""
    quantities = list(dict.fromkeys(m.quantity for s in steps for m in s.margins))
    winds = any(s.turns for s in steps)
    rows = tuple(
        (
            f"{s.number} {s.label}".strip(),
            s.kind, "yes" if s.feasible else "no",
            *(_used(s, quantity) for quantity in quantities),
            "" if s.settling_s is None else f"{s.settling_s:.2f}",
            *([_turns(s)] if winds else []),
        )
        for s in steps
    )  # fmt: skip
    columns = (
        "step",
        "kind",
        "runs",
        *quantities,
        "settles s",
        *(["turns"] if winds else []),
    )
    notes = (
        "Part of each limit that is used at the worst moment of the step, and by which axis; "
        "above 100 % it is broken.",
    )
    return TableData("Feasibility", columns, rows, notes=notes)


def _turns(step: StepFeasibility) -> str:
    """Whole turns wound up on each axis, those that can be seen."""
    return ", ".join(f"{axis} {n:.2f}" for axis, n in step.turns.items() if abs(n) >= 0.005)


def _used(step: StepFeasibility, quantity: str) -> str:
    worst = max(
        (m for m in step.margins if m.quantity == quantity), key=lambda m: m.ratio, default=None
    )
    if worst is None:
        return ""
    used = percent(worst.ratio) if worst.ratio >= LEAST_USED or not worst.ratio else "< 0.1 %"
    axis = worst.axis.replace("accelerometer", "accel")
    return f"{used}\n{axis}".strip() if worst.ratio >= LEAST_USED else used


# Accuracy ----------------------------------------------------------------------------------------


def _name(p: Prediction) -> str:
    return method_text(p.method, p.window)


def _budget(result: Rehearsal) -> Any:
    """The chart of what the worst stretch of each quantity is made of; what is required first."""
    worst: dict[tuple[str, str], Prediction] = {}
    for p in result.predictions:
        key = _name(p), p.quantity
        if p.sigma is not None and p.contributions:
            held = worst.get(key)
            if held is None or (held.rms or 0.0) < (p.rms or 0.0):
                worst[key] = p
    asked = {j.quantity for j in result.judgements}
    order = sorted(worst.values(), key=lambda p: p.quantity not in asked)
    rows = [
        Budget(
            f"{_name(p)}: {p.quantity}",
            sigma_text(p.rms, p.per, p.unit, p.noise_only),
            {c.source: (c.sigma / p.per) ** 2 for c in p.contributions},
        )
        for p in order[:MOST_BUDGETS]
    ]
    return budget(rows) if rows else None


def _predictions(predictions: Sequence[Prediction]) -> TableData | None:
    """A row per method and quantity; stretches that come out alike share one."""
    rows: dict[tuple[str, str, str, str], list[str]] = {}
    for p in predictions:
        if p.determined:
            rows.setdefault((_name(p), p.quantity, predicted_text(p), _made_of(p)), []).append(
                p.label
            )
    columns = ("method", "quantity", "sigma", "stretch", "made of, in the same unit")
    notes = (
        "Parts add up in quadrature: sigma is the root of the sum of their squares, but for that "
        "of what is known, which is a bias: sigma and bias in quadrature are rms. Those below "
        f"{100 * LEAST_SHARE:g} % of the variance are left out here; {JSON} has them all.",
    )
    cells = tuple((*key[:3], ", ".join(labels), key[3]) for key, labels in rows.items())
    return TableData("Predicted standard deviations", columns, cells, notes=notes) if rows else None


def _made_of(p: Prediction) -> str:
    assert p.rms is not None
    shown = [c for c in p.contributions if c.sigma**2 >= LEAST_SHARE * p.rms**2 > 0]
    return ", ".join(f"{c.source} {digits(c.sigma / p.per)}" for c in shown)


def _undetermined(predictions: Sequence[Prediction]) -> list[str]:
    """What has no number, each reason once."""
    reasons: dict[str, dict[str, list[str]]] = {}
    for p in predictions:
        if not p.determined:
            of = reasons.setdefault(p.reason, {})
            of.setdefault(f"{_name(p)}: {p.quantity}", []).append(p.label)
    return [
        "; ".join(f"{name} ({', '.join(labels)})" for name, labels in of.items()) + f": {reason}"
        for reason, of in reasons.items()
    ]


def _observability(result: Rehearsal) -> TableData | None:
    rows = tuple(
        (
            o.method,
            f"{o.rank} of {o.sought}",
            f"{o.condition:.2g}" if np.isfinite(o.condition) else "unlimited",
        )
        for o in result.observability
    )
    columns = ("method", "rank", "condition number")
    return TableData("What can be told apart", columns, rows) if rows else None


def _positions(result: Rehearsal) -> list[Position]:
    """Where the table stands in each step that measures."""
    measuring = {s.number for s in result.duration.steps if s.dwell > 0}
    return [
        Position(s.label or s.kind, np.array(s.joints))
        for s in result.feasibility
        if s.joints and s.number in measuring
    ]
