"""What many runs of the whole stand say about a rehearsal's predictions: its part of the page."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import inf, log

from alignment import ESTIMATORS
from stand.rehearsal.verification import AGREES, Achieved, Verification
from stand.report.document import method_text
from stand.report.figures import RatioRow, ratios
from stand.report.page import Drawing, span_text
from stand.report.tables import TableData
from stand.report.wording import (
    achieved_text,
    chance_text,
    digits,
    percent,
    ratio_text,
    refused_in_words,
    runs_text,
    sigma_text,
)

MOST_ROWS = 30  # of the chart; the table has them all
EVERYWHERE = "all"  # the label of what holds in every stretch, as biases do
MOST_NAMED = 3  # quantities that the summary names
WITHIN = f"{AGREES[0]:g} to {AGREES[1]:g}"


@dataclass(frozen=True, slots=True)
class Section:
    """The part of the page: its title, sentences, figure, table, and who gave no answer."""

    title: str
    sentences: tuple[str, ...]
    chart: Drawing | None
    chart_note: str
    table: TableData | None
    refused: tuple[str, ...]
    agrees: bool


def section(v: Verification) -> Section:
    """All that the page shows of it."""
    rows = _rows(v.achieved)
    shown = _farthest(rows)
    left_out = len(rows) - len(shown)
    note = f"The {len(shown)} of {len(rows)} quantities that are farthest off." if left_out else ""
    return Section(
        f"Verified by {runs_text(v.done)}",
        (_agreement(v), _contradicted(v), _chance(v), _how(v)),
        ratios(shown, AGREES) if shown else None,
        note,
        table=_table(v.achieved),
        refused=tuple(refused_in_words(r, v.done) for r in v.refused),
        agrees=not v.contradicts,
    )


def outcome(v: Verification) -> str:
    """One sentence: whether the runs agree with the predictions, or with which they do not."""
    compared = _compared(v)
    runs = runs_text(v.done)
    if v.contradicts:
        off = [_of(len(v.disagreeing), len(compared)) + f": {_named(v.disagreeing, MOST_NAMED)}"]
        told = [*(off if v.disagreeing else []), *_silent(v)]
        return f"{runs} of the whole stand {_verb(v.done, 'contradict')} {'; and '.join(told)}."
    if not compared:
        leave = _verb(v.done, "leave")
        return f"{runs} of the whole stand {leave} nothing to compare with a prediction."
    count = "the one prediction" if len(compared) == 1 else f"all {len(compared)} predictions"
    agree = _verb(v.done, "agree")
    return f"{runs} of the whole stand {agree} with {count} within {_band()}{_unsure(compared)}."


def _silent(v: Verification) -> list[str]:
    """Methods that were predicted and mostly gave no answer."""
    return [f"that {r.who} answers: it gave none in {r.runs} of them" for r in v.silent]


def fact(v: Verification) -> tuple[str, str]:
    """How many agree, in a few words and their name."""
    compared = _compared(v)
    agree = f"{len(compared) - len(v.disagreeing)} of {len(compared)}"
    return f"agree with {runs_text(v.done)}", agree if compared else "nothing to compare"


def _unsure(compared: Sequence[Achieved]) -> str:
    """What few runs leave open: their intervals are wider than the band they are to meet."""
    width = max(_half_width(a) for a in compared)
    if width <= max(1 - AGREES[0], AGREES[1] - 1):
        return ""
    return f", as far as so few can tell: ratios are known to ± {percent(width)}"


def _half_width(a: Achieved) -> float:
    """Of the interval of a ratio, as a part of it."""
    assert a.ratio is not None
    ratio, low, high = a.ratio
    return (high - low) / (2 * ratio)


def _band() -> str:
    return percent(AGREES[1] - 1)


def _verb(n: int, verb: str) -> str:
    return verb + "s" if n == 1 else verb


def _of(some: int, every: int) -> str:
    return f"{some} of {every} predictions" if every > 1 else "the one prediction"


def _compared(v: Verification) -> list[Achieved]:
    return [a for a in v.achieved if a.ratio is not None]


def _named(achieved: Iterable[Achieved], most: int | None = None) -> str:
    """'two-position: heading (first, second), gyro bias X1', at most so many quantities."""
    places: dict[tuple[str, str], list[str]] = {}
    for a in achieved:
        key = method_text(a.method, a.window), a.quantity
        places.setdefault(key, []).append(a.label)
    by_method: dict[str, list[str]] = {}
    for (method, quantity), labels in list(places.items())[:most]:
        where = "" if labels == [EVERYWHERE] else f" ({', '.join(labels)})"
        by_method.setdefault(method, []).append(quantity + where)
    told = "; ".join(f"{method}: {', '.join(those)}" for method, those in by_method.items())
    more = len(places) - (most or len(places))
    return f"{told} and {more} more" if more > 0 else told


def _quantity(a: Achieved) -> str:
    return f"{method_text(a.method, a.window)}: {a.quantity}"


# Sentences ---------------------------------------------------------------------------------------


def _agreement(v: Verification) -> str:
    compared = _compared(v)
    if not compared:
        return "No prediction could be compared with the runs."
    agree = len(compared) - len(v.disagreeing)
    count = f"{agree} of {len(compared)} prediction{'s' if len(compared) > 1 else ''}"
    return (
        f"{count} {_verb(len(compared), 'agree')} with the runs: the interval of predicted over "
        f"achieved sigma, wide enough for all of them at once, meets {WITHIN}."
    )


def _contradicted(v: Verification) -> str:
    told = [_named(v.disagreeing)] if v.disagreeing else []
    told += _silent(v)
    return f"Contradicted: {'; '.join(told)}." if told else ""


def _chance(v: Verification) -> str:
    return f"{chance_text(v)}." if _compared(v) else ""


def _how(v: Verification) -> str:
    """How many runs, which, and how fast."""
    seeds = f"seed {v.seed}" if v.done == 1 else f"seeds {v.seed} to {v.seed + v.done - 1}"
    told = f"interrupted: {v.done} of {v.requested} runs" if v.interrupted else runs_text(v.done)
    pace = f", {digits(v.done / v.seconds)} runs/s" if v.seconds > 0 else ""
    return (
        f"{told[0].upper()}{told[1:]}, {seeds}, in {span_text(v.seconds)}{pace}; each with a unit, "
        "a table and a sway of its own, set against its own truth."
    )


# Figure ------------------------------------------------------------------------------------------


def _rows(achieved: Sequence[Achieved]) -> list[RatioRow]:
    """A row per method and quantity: the stretch that is farthest off, and the ratios of others."""
    groups: dict[str, list[Achieved]] = {}
    for a in achieved:
        if a.ratio is not None:
            groups.setdefault(_quantity(a), []).append(a)
    return [_row(name, those) for name, those in groups.items()]


def _row(name: str, those: Sequence[Achieved]) -> RatioRow:
    worst = max(those, key=lambda a: (a.agrees is False, _off(a)))
    others = tuple(
        (a.ratio[0], a.agrees is not False) for a in those if a is not worst and a.ratio is not None
    )
    assert worst.ratio is not None
    off = sum(a.agrees is False for a in those)
    text = ratio_text(worst.ratio)
    if off:
        text += " contradicted" + (f" ({off} of {len(those)})" if len(those) > 1 else "")
    return RatioRow(name, text, worst.ratio, not off, others=others)


def _off(a: Achieved) -> float:
    return _distance(a.ratio[0]) if a.ratio is not None else 0.0


def _distance(ratio: float) -> float:
    """From 1, as a factor either way."""
    return abs(log(ratio)) if ratio > 0 else inf


def _farthest(rows: Sequence[RatioRow]) -> list[RatioRow]:
    """At most `MOST_ROWS` in their order: those contradicted and farthest from 1."""
    order = sorted(rows, key=lambda row: (row.agrees, -_distance(row.ratio[0])))
    kept = {row.label for row in order[:MOST_ROWS]}
    return [row for row in rows if row.label in kept]


# Table -------------------------------------------------------------------------------------------


def _table(achieved: Sequence[Achieved]) -> TableData | None:
    """A row per method and quantity; stretches that come out alike share one."""
    quantities = list(dict.fromkeys(_quantity(a) for a in achieved))
    rows: dict[tuple[str, ...], list[str]] = {}
    for a in sorted(achieved, key=lambda a: quantities.index(_quantity(a))):
        rows.setdefault(_cells(a), []).append(a.label)
    columns = (
        "method", "quantity", "stretch", "predicted", "achieved (95 %)", "ratio (95 %)",
        "all at once", "runs", "agrees",
    )  # fmt: skip
    cells = tuple((*key[:2], ", ".join(labels), *key[2:]) for key, labels in rows.items())
    notes = (
        "Achieved: root mean square of the errors against the truth, with its 95 % interval. "
        "Ratio: predicted over achieved, with its own 95 % interval. It agrees where the interval "
        f"of all at once meets {WITHIN}: widened so that chance alone makes one of all these miss "
        "in 5 % of such verifications.",
    )
    if any(a.method in ESTIMATORS and ESTIMATORS[a.method].design for a in achieved):
        notes += (
            "Of constants that no sheet states a size is assumed, and no run has any: predicted is "
            "here what the readings make of them, without that size.",
        )
    return TableData("Predicted and achieved", columns, cells, notes=notes) if rows else None


def _cells(a: Achieved) -> tuple[str, ...]:
    """Of a row, without its stretch."""
    return (
        method_text(a.method, a.window),
        a.quantity,
        sigma_text(a.predicted, a.per, a.unit, a.noise_only),
        achieved_text(a),
        "" if a.ratio is None else ratio_text(a.ratio),
        "" if a.widened is None else "{:.2f} to {:.2f}".format(*a.widened),
        str(a.runs),
        {True: "yes", False: "no", None: ""}[a.agrees],
    )
