"""A campaign to look at: a page, and tables for a terminal."""

from __future__ import annotations

import shlex
from math import isfinite
from pathlib import Path

from stand.campaigns.campaign import Size
from stand.campaigns.summary import Refused, Series, Summary, Worst, Yield
from stand.campaigns.sweep import shown
from stand.folder import write_file
from stand.imu.priors import only
from stand.recording.hashes import sha256_of_text
from stand.report.campaign_figures import (
    curves,
    distribution,
    finite,
    heat_map,
    honesty,
    named,
    tornado,
    unit_of,
    yields,
)
from stand.report.document import UNDETERMINED, method_text
from stand.report.page import render, span_text
from stand.report.tables import TableData
from stand.report.wording import deg_text, digits
from stand.versions import versions

PAGE = "campaign.html"
MOST_FIGURES = 6  # methods that have curves of their own
_MOST_ROWS = 60  # of a table in a terminal


def write_page(summary: Summary) -> Path:
    """Write `PAGE` into the campaign's folder, in place of an older one."""
    return write_file(summary.folder / PAGE, page(summary))


def page(summary: Summary) -> str:
    """The page: HTML that needs nothing else."""
    sweep = summary.sweep
    ways = summary.shown[:MOST_FIGURES]
    first = summary.shown[0] if summary.shown else None
    charts = [curves(summary, series, n) for n, series in enumerate(ways)]
    maps = [heat_map(summary, series, n) for n, series in enumerate(ways)]
    content = {
        "title": sweep.entry.title,
        "lead": _lead(summary),
        "answer": answer(summary),
        "facts": _facts(summary),
        "curves": [one for one in charts if one is not None],
        "maps": [one for one in maps if one is not None],
        "tornado": None if first is None else tornado(summary, first),
        "distribution": None if first is None else distribution(summary, first),
        "honesty": honesty(summary.honesty),
        "yield_chart": yields(summary.yields),
        "yields": yield_table(summary),
        "worst": worst_table(summary),
        "refused": refused_table(summary),
        "cases": case_table(summary),
        "hashes": _hashes(summary),
        "versions": TableData("Versions", ("package", "version"), tuple(_versions().items())),
        "files": _files(summary),
    }
    return render("campaign.html.j2", content)


def _versions() -> dict[str, str]:
    return {name.removesuffix("_version"): v for name, v in versions().items()}


def _lead(summary: Summary) -> str:
    entry = summary.sweep.entry
    cases = len(summary.sweep.values)
    return (
        f"{entry.procedure}, {entry.imu}, {entry.rate_hz} Hz, {entry.motion} motion; {cases} "
        f"{'case' if cases == 1 else 'cases'} of {entry.runs} runs each, seeds {entry.seed} to "
        f"{entry.seed + entry.runs - 1}, the same in every case."
    )


def answer(summary: Summary) -> list[str]:
    """What came of it, in sentences."""
    told = []
    whole = [y for y in summary.yields if not y.case]
    told += [yield_text(y) for y in whole]
    for series in summary.shown[:MOST_FIGURES]:
        cells = summary.told(series)
        if not cells:
            told.append(f"{named(series)}: {UNDETERMINED} in any case.")
            continue
        unit, per = unit_of(series, max(c.rms for c in cells))
        low, high = min(c.rms for c in cells), max(c.rms for c in cells)
        span = digits(low / per) if low == high else f"{digits(low / per)} to {digits(high / per)}"
        met = [c for c in cells if c.predicted]
        agree = sum(c.low <= (c.predicted or 0.0) <= c.high for c in met)
        beside = f"; {agree} of {len(met)} intervals hold the prediction" if met else ""
        none = len(summary.of(series)) - len(cells)
        rest = f"; {UNDETERMINED} in {none} {'case' if none == 1 else 'cases'}" if none else ""
        told.append(f"{named(series)}: rms error {span} {unit}{beside}{rest}.")
    if summary.done < summary.total:
        told.append(f"{summary.done} of {summary.total} runs are there; --resume makes the rest.")
    if summary.refused:
        runs = sum(r.runs for r in summary.refused)
        told.append(f"{runs} answers were refused or cannot stand.")
    return told


def yield_text(y: Yield) -> str:
    """'99.3 % (99.1-99.5) of 10 000 units pass by two-position.'"""
    share, low, high = (f"{100 * x:.{_places(y)}f}" for x in (y.share, y.low, y.high))
    count = f"{y.runs:,}".replace(",", " ")
    return f"{share} % ({low}-{high}) of {count} units pass by {method_text(y.method, y.window)}."


def _places(y: Yield) -> int:
    """Digits that an interval of this width bears."""
    width = 100 * (y.high - y.low)
    return 1 if width > 0.2 else 2


def _facts(summary: Summary) -> list[tuple[str, str]]:
    entry = summary.sweep.entry
    return [
        ("cases", str(len(summary.sweep.values))),
        ("runs", f"{summary.done} of {summary.total}"),
        ("readings", f"{entry.rate_hz} Hz"),
        ("varied", str(len(entry.vary))),
        *([("required", _required(summary))] if summary.limits else []),
    ]


def _required(summary: Summary) -> str:
    limits = sorted(set(summary.limits.values()))
    quantity = summary.shown[0].quantity if summary.shown else ""
    ends = limits if len(limits) < 3 else [limits[0], limits[-1]]
    return f"{quantity} {' to '.join(deg_text(limit) for limit in ends)}"


def case_table(summary: Summary) -> TableData:
    """A row per case and method: what was achieved, predicted and stated."""
    rows = []
    for series in summary.shown:
        unit, per = unit_of(series, max((c.rms for c in summary.told(series)), default=0.0))
        for c in summary.of(series):
            values = [shown(v) for v in summary.sweep.values[c.case - 1]]
            predicted = "" if c.predicted is None else digits(c.predicted / per)
            predicted += only(c.noise_only and bool(predicted))
            stated = finite(c.stated, per)
            stated += only(c.noise_only and bool(stated))
            ratio = "" if not c.predicted or not c.rms > 0 else f"{c.predicted / c.rms:.2f}"
            rms = UNDETERMINED
            if c.determined:
                ends = f"({digits(c.low / per)} to {digits(c.high / per)})"
                rms = f"{digits(c.rms / per)} {ends} {unit}"
            rows.append(
                (
                    str(c.case), *values, method_text(series.method, series.window), str(c.runs),
                    rms, predicted, ratio, stated, finite(c.mean, per),
                )
            )  # fmt: skip
    columns = (
        "case", *summary.sweep.labels, "method", "runs", "rms error (95 %)", "predicted", "ratio",
        "stated sigma", "mean error",
    )  # fmt: skip
    quantity = f"{summary.shown[0].quantity} at the place where it is worst" if rows else ""
    notes = ("ratio: predicted over achieved.", *summary.unstated) if rows else ()
    return TableData(
        f"Cases: {quantity}", columns, tuple(rows), notes=notes,
        optional=("mean error", "stated sigma", "ratio"),
    )  # fmt: skip


def yield_table(summary: Summary) -> TableData | None:
    """Units that pass, case by case."""
    own = [y for y in summary.yields if y.case]
    if not own:
        return None
    rows = tuple(
        (
            str(y.case), *(shown(v) for v in summary.sweep.values[y.case - 1]),
            method_text(y.method, y.window), f"{y.passed} of {y.runs}",
            f"{100 * y.share:.{_places(y)}f} % ({100 * y.low:.{_places(y)}f}-"
            f"{100 * y.high:.{_places(y)}f})",
        )
        for y in own
    )  # fmt: skip
    columns = ("case", *summary.sweep.labels, "method", "pass", "share (95 %)")
    notes = (
        "A unit passes where every angle that [require] limits is within its limit at every place, "
        "and has a number. Interval: Clopper and Pearson.",
    )
    return TableData("Yield", columns, rows, notes=notes)


def worst_table(summary: Summary) -> TableData | None:
    """The units that are farthest off, and how to look at them."""
    if not summary.worst:
        return None
    series: Series = summary.worst[0].series
    unit, per = unit_of(series, max(abs(w.error) for w in summary.worst))
    beyond = "times the limit" if summary.limits else "times the case's rms"
    rows = tuple(
        (
            str(w.case), str(w.seed), f"{digits(w.error / per)} {unit}",
            finite(w.sigma, per) + only(w.noise_only and isfinite(w.sigma)),
            digits(w.times), record_command(summary, w),
        )
        for w in summary.worst
    )  # fmt: skip
    columns = ("case", "seed", "error", "stated sigma", beyond, "the whole run")
    return TableData(f"Worst units: {named(series)}", columns, rows, optional=("stated sigma",))


def record_command(summary: Summary, of: Worst | Refused) -> str:
    """What makes a run of the campaign a full recording."""
    folder = shlex.quote(str(summary.folder))
    return f"stand campaign record {folder} --case {of.case} --seed {of.seed}"


def refused_table(summary: Summary) -> TableData | None:
    """Who gave no answer, how often and why."""
    if not summary.refused:
        return None
    rows = tuple(
        (r.method or "all methods", str(r.runs), str(r.cases), r.reason, record_command(summary, r))
        for r in summary.refused
    )
    columns = ("method", "runs", "cases", "reason", "one of them")
    return TableData("No answer", columns, rows, optional=("one of them",))


def tables(summary: Summary) -> list[TableData]:
    """For a terminal: the cases, the yield, the worst units, the refusals."""
    cases = case_table(summary)
    if len(cases.rows) > _MOST_ROWS:
        left = f"{len(cases.rows) - _MOST_ROWS} more rows: on the page"
        cases = TableData(
            cases.title, cases.columns, cases.rows[:_MOST_ROWS], notes=(*cases.notes, left),
            optional=cases.optional,
        )  # fmt: skip
    worst = worst_table(summary)
    brief = None
    if worst is not None:
        rows = tuple(row[:-1] for row in worst.rows[:3])
        how = record_command(summary, summary.worst[0])
        brief = TableData(worst.title, worst.columns[:-1], rows, notes=(how,))
    found = (cases, yield_table(summary), brief, refused_table(summary))
    return [one for one in found if one is not None]


def _hashes(summary: Summary) -> TableData:
    sources = summary.sweep.inputs.items()
    rows = [("sweep", sha256_of_text(summary.sweep.source.text))]
    rows += [(f"{kind} {name}", sha256_of_text(source.text)) for (kind, name), source in sources]
    return TableData("SHA-256", ("of", "hash"), tuple(rows))


def _files(summary: Summary) -> list[tuple[str, str]]:
    sources = summary.sweep.inputs.items()
    told = [("Sweep", summary.sweep.source.text.rstrip())]
    return told + [(f"{kind}: {name}", source.text.rstrip()) for (kind, name), source in sources]


def size_text(size: Size, cores: int) -> str:
    """What a campaign would come to."""
    left = size.runs - size.known
    there = f", {size.known} of them are there" if size.known else ""
    time = f"{span_text(size.seconds / cores)} on {cores} {'core' if cores == 1 else 'cores'}"
    cases = f"{size.cases} {'case' if size.cases == 1 else 'cases'}"
    return (
        f"{cases}, {size.runs} runs{there}; about {time} for {left} runs, "
        f"{_bytes(size.size)} of results"
    )


def _bytes(n: int) -> str:
    return f"{n / 1e6:.3g} MB" if n >= 1e5 else f"{max(n, 1000) / 1e3:.3g} kB"
