"""A proposed test as a procedure's TOML text, with a comment per step of what it is for."""

from collections.abc import Mapping, Sequence
from typing import Any

from stand.procedure.procedure import RequireEntry
from stand.proposal.candidates import Candidate
from stand.proposal.wanted import GIMBALS, Wanted
from stand.rehearsal.wording import toml_of

Amounts = Sequence[tuple[Candidate, float]]


def procedure_of(
    wanted: Wanted,
    amounts: Amounts,
    methods: Sequence[str],
    require: RequireEntry | None = None,
    *,
    remarks: Sequence[str] = (),
    what_for: Mapping[int, str] | None = None,
    table: str = "laboratory",
) -> str:
    """TOML text of candidates in their order, each with its seconds of data.

    `remarks`: lines on top of it; `what_for`: of a candidate by its number.
    """
    entry = wanted.entry
    data: dict[str, Any] = {"title": entry.title, "table": table}
    data["site"] = entry.site.model_dump(exclude_unset=True)
    data["estimate"] = {"methods": list(methods)}
    if require is not None:
        data["require"] = require.model_dump(exclude_unset=True, exclude_none=True)
    text = "".join(f"# {line}\n" for line in remarks) + toml_of(data)
    labels = labels_of([one for one, _ in amounts])
    at = (0.0, 0.0, 0.0)
    for k, ((one, seconds), label) in enumerate(zip(amounts, labels, strict=True)):
        why = (what_for or {}).get(k, "")
        lines = f"\n# {label}: {why}" if why else ""
        steps = []
        if one.position != at or k == 0:
            where = {name: _plain(a) for name, a in zip(GIMBALS, one.position, strict=True)}
            steps.append({"kind": "move", "label": f"to {label}", "joints_deg": where})
            at = one.position
        steps.append(_step(one, seconds, label))
        text += lines + "\n" + toml_of({"step": steps})
    return text


def _step(one: Candidate, seconds: float, label: str) -> dict[str, Any]:
    if not one.axis:
        return {"kind": "dwell", "label": label, "duration_s": _plain(round(seconds, 3))}
    turns = round(seconds / one.quantum)
    return {
        "kind": "rate",
        "label": label,
        "axis": one.axis,
        "rate_deg_s": _plain(one.rate),
        "turns": turns,
        "directions": "both",
    }


def _plain(value: float) -> float:
    """As a person writes it."""
    return int(value) if value == int(value) else value


def labels_of(those: Sequence[Candidate]) -> list[str]:
    """Their own, numbered where one comes twice."""
    found: list[str] = []
    for one in those:
        label, n = one.label(), 2
        while label in found:
            label, n = f"{one.label()}, {n}", n + 1
        found.append(label)
    return found
