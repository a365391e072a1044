"""What a run came to, in a word and some sentences: for its page and for a terminal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from alignment import ESTIMATORS
from alignment.estimate import ANGLES
from alignment.units import DEG
from stand.evaluation.score import Refusal, Score
from stand.imu import ImuSpec
from stand.procedure.procedure import RequireEntry
from stand.report.document import UNDETERMINED

USUAL = 3.0  # sigmas: an error in 370 lies beyond
CONTRADICTED = 4.0  # one in 16000


@dataclass(frozen=True, slots=True)
class Judged:
    """`grade` is 'good', 'bad', 'open' or 'plain'; `word` the verdict; `lines` why."""

    grade: str
    word: str
    lines: tuple[str, ...]


def judged(
    scores: Sequence[Score],
    refusals: Sequence[Refusal],
    require: RequireEntry | None = None,
    imu: ImuSpec | None = None,
    revision: str = "",
) -> Judged:
    """The verdict on a run.

    Where the procedure requires an accuracy, the errors made are held against it; else against
    what was predicted of them: none is to lie beyond `CONTRADICTED` sigma.
    """
    lines = (*summary_lines(scores, refusals),)
    open_ = tuple(s for s in scores if not _circular(s))
    limits = {}
    if require is not None and imu is not None:
        limits = require.limits_for(imu.id, imu.entry.grade, revision)
    if limits and require is not None:
        told = [_required(name, limit, open_, require.method) for name, limit in limits.items()]
        grade = "bad" if any(g == "bad" for g, _ in told) else "good"
        grade = "open" if grade == "good" and any(g == "open" for g, _ in told) else grade
        word = {"good": "PASS", "bad": "FAIL", "open": "INDETERMINATE"}[grade]
        return Judged(grade, word, (*(line for _, line in told), *lines))
    ratios = [r for s in open_ for r in _ratios(s)]
    if not ratios:
        why = "nobody knows the truth of it" if scores else "nothing was estimated"
        return Judged("plain", "NOT JUDGED", (f"{why.capitalize()}.", *lines))
    within = sum(r <= USUAL for r in ratios)
    told = f"{within} of {len(ratios)} angles are within {USUAL:g} of their predicted sigmas"
    worst = max(ratios)
    if worst <= CONTRADICTED:
        return Judged("good", "ERRORS AS PREDICTED", (f"{told}.", *lines))
    told += f"; the farthest is off by {worst:.3g} of them"
    return Judged("bad", "ERRORS BEYOND PREDICTION", (f"{told}.", *lines))


def _circular(s: Score) -> bool:
    known = ESTIMATORS.get(s.estimate.method)
    return known is not None and known.window(s.estimate.window).circular


def _ratios(s: Score) -> list[float]:
    """Errors of the angles over their sigmas, where both are known."""
    if s.error is None or s.estimate.sigmas is None:
        return []
    pairs = zip(s.error, s.estimate.sigmas, strict=True)
    return [abs(float(e / g)) for e, g in pairs if np.isfinite(e) and np.isfinite(g) and g > 0]


def _required(
    name: str, limit: float, scores: Sequence[Score], method: str | None
) -> tuple[str, str]:
    """Grade and sentence of one required quantity: by the method named, or the best that finds it.

    One that carries the nominal attitude finds none.
    """
    greatest: dict[str, float] = {}
    for s in scores:
        own = s.estimate.method
        known = ESTIMATORS.get(own)
        if method not in (None, own) or (known is not None and known.carries_nominal):
            continue
        error = s.heading_error
        if name != "heading":
            error = None if s.error is None else float(s.error[ANGLES.index(name)])
        if error is None or np.isnan(error):
            continue
        greatest[own] = max(greatest.get(own, 0.0), abs(float(error)))
    asked = f"{name} within {limit / DEG:.4g}° is required"
    if not greatest:
        return "open", f"{asked}: {UNDETERMINED}."
    best = min(greatest, key=lambda m: greatest[m])
    grade = "good" if greatest[best] <= limit else "bad"
    return grade, f"{asked}: off by {greatest[best] / DEG:.3g}° at most ({best})."


def summary_lines(scores: Sequence[Score], refusals: Sequence[Refusal]) -> list[str]:
    """A sentence per method: its greatest error, what is not determined, or that it gives none.

    What is zero by construction is no error.
    """
    lines = []
    for method in dict.fromkeys(s.estimate.method for s in scores):
        own = [s for s in scores if s.estimate.method == method and not _circular(s)]
        told = [text for text in (_greatest(own), _undetermined(own)) if text]
        if told:
            lines.append(f"{method}: {'; '.join(told)}")
    return lines + [f"{r.who}: no estimate" for r in refusals]


def _greatest(scores: Sequence[Score]) -> str:
    sizes = [
        (abs(float(error)), angle, s.estimate.label)
        for s in scores
        if s.error is not None
        for angle, error in zip(ANGLES, s.error, strict=True)
        if np.isfinite(error)
    ]
    if not sizes:
        return ""
    size, angle, label = max(sizes)
    return f"greatest error {size / DEG:.3g}°, of {angle} in “{label}”"


def _undetermined(scores: Sequence[Score]) -> str:
    counts: Mapping[str, int] = {
        name: sum(name in s.estimate.undetermined for s in scores)
        for name in dict.fromkeys(n for s in scores for n in s.estimate.undetermined)
    }
    told = ", ".join(f"{name} {UNDETERMINED} in {n}" for name, n in counts.items())
    return f"{told} of {len(scores)} estimates" if told else ""
