"""A rehearsal as tables of text: the verdict first."""

from collections.abc import Iterator

from stand.imu.priors import only
from stand.rehearsal.result import Prediction, Rehearsal, Verdict
from stand.rehearsal.verification import AGREES, Achieved, Verification
from stand.report.tables import TableData
from stand.report.wording import chance_text, predicted_text, sigma_text

_NAMED = 4  # contributions of a prediction that are told


def headline(result: Rehearsal) -> str:
    """The verdict in one line."""
    i = result.inputs
    can = "feasible" if result.feasible else "NOT feasible"
    asked = "" if result.judgements else " (nothing is required: no [require] in the procedure)"
    verdict = result.verdict.value
    if result.verification is not None and result.verdict is Verdict.CONTRADICTED:
        from stand.report.verified import outcome  # draws figures too, and takes its time to import

        verdict += f": {outcome(result.verification)[:-1]}"
    return (
        f"{verdict}: {i.procedure_title}; {i.imu_title}; {i.table_title}; {can}, "
        f"{result.duration.total:.0f} s{asked}"
    )


def tables(result: Rehearsal) -> list[TableData]:
    """Requirements, findings, advice, steps, accuracy, observability; without the empty ones."""
    every = [
        _required(result),
        *_lines(result),
        _steps(result),
        _accuracy(result),
        _verified(result.verification),
        _observed(result),
    ]
    return [table for table in every if table.rows]


def _required(result: Rehearsal) -> TableData:
    rows = tuple(
        (
            j.quantity,
            j.verdict.value,
            f"{j.required / j.per:g}",
            "not determined"
            if j.expanded is None
            else f"{j.expanded / j.per:.3g}{only(j.noise_only)}",
            j.unit,
            j.method,
            j.label,
            j.reason if j.verdict is not Verdict.PASS else "",
        )
        for j in result.judgements
    )
    columns = ("required", "verdict", "limit", "expanded", "unit", "method", "place", "finding")
    return TableData("Requirement", columns, rows)


def _lines(result: Rehearsal) -> Iterator[TableData]:
    found = tuple((f.severity.value, f.text) for f in result.findings)
    yield TableData("Findings", ("severity", "finding"), found)
    advised = tuple((a.quantity, a.text) for a in result.advice)
    yield TableData("Advice", ("for", "finding"), advised)


def _steps(result: Rehearsal) -> TableData:
    rows = []
    for step, took in zip(result.feasibility, result.duration.steps, strict=True):
        worst = step.worst
        used = "" if worst is None else f"{worst.quantity} {worst.axis}".strip()
        rows.append(
            (
                f"{step.number}",
                step.kind,
                step.label,
                f"{step.t_from:.1f}",
                f"{took.motion:.1f}",
                f"{took.settling:.2f}",
                f"{took.dwell:.1f}",
                "" if worst is None else f"{100 * worst.ratio:.0f} %",
                used,
            )
        )
    d = result.duration
    sums = ("", "", "total", "", f"{d.motion:.1f}", f"{d.settling:.2f}", f"{d.dwell:.1f}", "", "")
    columns = ("step", "kind", "place", "from s", "motion s", "settling s", "dwell s", "most used")
    return TableData("Steps", (*columns, "axis"), tuple(rows), (sums,))


def _accuracy(result: Rehearsal) -> TableData:
    rows = tuple(
        (
            f"{p.method} {p.window}".strip(),
            p.label,
            p.quantity,
            predicted_text(p),
            p.reason if p.sigma is None else _made_of(p),
        )
        for p in result.predictions
    )
    return TableData("Predicted sigma", ("method", "place", "kind", "sigma", "contributions"), rows)


def _made_of(p: Prediction) -> str:
    parts = [f"{c.source} {c.sigma / p.per:.2g}" for c in p.contributions[:_NAMED]]
    more = len(p.contributions) - _NAMED
    return ", ".join(parts) + (f" and {more} more" if more > 0 else "")


def _verified(v: Verification | None) -> TableData:
    ratio = "ratio (95 %; all at once)"
    columns = ("method", "place", "kind", "predicted", "achieved (95 %)", ratio, "finding")
    if v is None:
        return TableData("", columns, ())
    rows = tuple(
        (
            f"{a.method} {a.window}".strip(),
            a.label,
            a.quantity,
            sigma_text(a.predicted, a.per, a.unit, a.noise_only),
            _with_ends(a.sigma / a.per, a.low / a.per, a.high / a.per, a.unit),
            _ratio(a),
            "contradicted" if a.agrees is False else "",
        )
        for a in v.achieved
    )
    notes = [
        "ratio: predicted over achieved, with its own interval; contradicted where the interval of "
        f"all at once misses {AGREES[0]:g} to {AGREES[1]:g}",
        chance_text(v),
        *(f"no answer in {r.runs} of {v.done} runs from {r.who}: {r.reason}" for r in v.refused),
    ]
    title = f"Verified by {v.done} runs from seed {v.seed} in {v.seconds:.0f} s"
    if v.interrupted:
        title += f" (interrupted: {v.requested} were asked for)"
    return TableData(title, columns, rows, notes=tuple(notes))


def _ratio(a: Achieved) -> str:
    if a.ratio is None or a.widened is None:
        return ""
    return "{:.2f} ({:.2f}-{:.2f}; {:.2f}-{:.2f})".format(*a.ratio, *a.widened)


def _with_ends(value: float, low: float, high: float, unit: str) -> str:
    return f"{value:.3g} ({low:.3g}-{high:.3g}) {unit}"


def _observed(result: Rehearsal) -> TableData:
    rows = tuple(
        (o.method, f"{o.rank} of {o.sought}", f"{o.condition:.1e}", "; ".join(o.unseen))
        for o in result.observability
    )
    return TableData("Observability", ("method", "rank", "condition", "finding"), rows)
