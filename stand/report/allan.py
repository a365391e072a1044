"""An Allan analysis to look at: tables for a terminal, a PNG of the curves, one page of HTML.

matplotlib is imported where it is used: it takes a second to start.
"""

from __future__ import annotations

from collections.abc import Sequence
from io import BytesIO
from math import log10
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from alignment.allan import Channel, FoundTerm, MissingTerm
from stand.evaluation.allan import DEVIATION, ORDER, UNITS, AllanReport, needs_hours
from stand.folder import write_files
from stand.report.judged import Judged
from stand.report.page import INKS, data_uri, render
from stand.report.tables import TableData

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PNG, HTML = "allan.png", "allan.html"
TITLES = {"gyro": "Gyros", "accel": "Accelerometers"}
NAMES = {
    "N": {"gyro": "angle random walk", "accel": "velocity random walk"},
    "B": {"gyro": "bias instability", "accel": "bias instability"},
    "K": {"gyro": "rate random walk", "accel": "acceleration random walk"},
    "Q": {"gyro": "quantisation", "accel": "quantisation"},
    "R": {"gyro": "rate ramp", "accel": "acceleration ramp"},
}
# The variance's factors and slopes: sheet lines are these laws by themselves.
LAWS = {"Q": (3.0, -1.0), "N": (1.0, -0.5), "B": (1.0, 0.0), "K": (1 / 3, 0.5), "R": (0.5, 1.0)}
SLOPES = {-1.0: "−1", -0.5: "−1/2", 0.0: "0", 0.5: "+1/2", 1.0: "+1"}

# Okabe and Ito's colours, told apart by colour-blind eyes; the markers tell them apart in print.
STYLES = {"x": ("#0072B2", "o"), "y": ("#D55E00", "s"), "z": ("#009E73", "^")}
DARK_STYLES = {"x": ("#56B4E9", "o"), "y": ("#E69F00", "s"), "z": ("#2BC69A", "^")}


def write_pictures(report: AllanReport, folder: Path | None = None) -> list[Path]:
    """Write `PNG` and `HTML` into a folder, which is made; both are replaced if there.

    Without a folder into one beside the recording.
    """
    file = Path(report.path)
    folder = folder or file.with_name(f"{file.stem}_allan")
    light = picture(report, "light")
    html = page(report, light, picture(report, "dark"))
    return write_files({folder / PNG: light, folder / HTML: html})


def tables(report: AllanReport) -> list[TableData]:
    """A table per sensor: a row per term, a column per axis, the data sheet beside them."""
    sensors = list(dict.fromkeys(c.sensor for c in report.analysis.channels))
    found = [_table(report, sensor) for sensor in sensors]
    result = report.analysis
    notes = (
        f"{result.samples} samples at {1 / result.interval:.6g} Hz, {_hours(result.duration)}; "
        "± 95 %; '< value, length': the most the record allows, and how long it must be to tell",
        *report.notes,
    )
    last = found[-1]
    return [*found[:-1], TableData(last.title, last.columns, last.rows, last.footers, notes=notes)]


def _table(report: AllanReport, sensor: str) -> TableData:
    channels = [c for c in report.analysis.channels if c.sensor == sensor]
    columns = ["term", *(c.axis for c in channels), "unit"]
    columns += ["data sheet", "verdict"] if report.sheet_title else []
    rows = []
    for term in ORDER:
        cells = [f"{term} {NAMES[term][sensor]}", *(_cell(c, term) for c in channels)]
        cells.append(UNITS[sensor, term].name)
        if report.sheet_title:
            cells += [_sheet_cell(report, sensor, term), verdict(report, sensor, term)]
        rows.append(tuple(cells))
    title = f"{TITLES[sensor]}: Allan analysis of {Path(report.path).name}"
    title += f", against {report.sheet_title}" if report.sheet_title else ""
    return TableData(title, tuple(columns), tuple(rows))


def _outcome(channel: Channel, term: str) -> FoundTerm | MissingTerm:
    return next(o for o in (*channel.found, *channel.missing) if o.term == term)


def _cell(channel: Channel, term: str) -> str:
    outcome = _outcome(channel, term)
    si = UNITS[channel.sensor, term].si
    if isinstance(outcome, FoundTerm):
        return in_percent(outcome.value / si, outcome.low / si, outcome.high / si)
    if channel.constant:
        return "constant"
    if not channel.resolved:
        return f"< {outcome.upper / si:.2g}, below resolution"
    hours = needs_hours(outcome)
    return f"< {outcome.upper / si:.2g}, {'never' if hours is None else _hours(hours * 3600)}"


def in_percent(value: float, low: float, high: float) -> str:
    """A value with its interval: '0.150 ±1.2 %', '5.0 -9/+12 %' where it is lopsided."""
    below, above = 100 * (1 - low / value), 100 * (high / value - 1)
    digits = int(np.clip(np.ceil(-log10(max(below, above, 1e-9) / 100)) + 1, 2, 6))
    shown = f"{value:#.{digits}g}".rstrip(".")  # with the zeros that are known to be zeros
    if max(below, above) < 1.25 * min(below, above):
        return f"{shown} ±{(below + above) / 2:.2g} %"
    return f"{shown} -{below:.2g}/+{above:.2g} %"


def needs_text(missing: MissingTerm) -> str:
    """'needs 12 h', or that no length would do."""
    hours = needs_hours(missing)
    return "no length shows it" if hours is None else f"needs {_hours(hours * 3600)}"


def _hours(seconds: float) -> str:
    if seconds < 90:
        return f"{seconds:.2g} s"
    if seconds < 2 * 3600:
        return f"{seconds / 60:.0f} min"
    hours = seconds / 3600
    if hours < 72:
        return f"{hours:.2g} h"
    return f"{hours / 24:.0f} d" if hours < 1000 * 24 else f"{hours / 8766:.2g} years"


def with_bounds(value: float, low: float, high: float) -> str:
    """A value with the digits that its interval leaves it: '0.150 (0.148–0.152)'."""
    width = high - low
    if value <= 0 or not np.isfinite(width) or width <= 0:
        return f"{value:.3g}"
    digits = int(np.clip(np.ceil(log10(value / width)) + 2, 2, 6))
    decimals = digits - 1 - int(np.floor(log10(value)))
    if not -3 < decimals < 7:
        return f"{value:.{digits}g} ({low:.{digits}g}–{high:.{digits}g})"
    places = max(0, decimals)
    return f"{value:.{places}f} ({low:.{places}f}–{high:.{places}f})"


def _sheet_cell(report: AllanReport, sensor: str, term: str) -> str:
    stated = report.sheet.get((sensor, term))
    return "" if stated is None else f"{stated / UNITS[sensor, term].si:.3g}"


def verdict(report: AllanReport, sensor: str, term: str) -> str:
    """Measured against the data sheet over all axes: agrees, worse, better, or not shown."""
    stated = report.sheet.get((sensor, term))
    if stated is None:
        return ""
    channels = [c for c in report.analysis.channels if c.sensor == sensor]
    words: dict[str, list[str]] = {}
    for c in channels:
        word = _judged(_outcome(c, term), stated) if c.resolved else "below resolution"
        word = "constant" if c.constant else word
        words.setdefault(word, []).append(c.axis)
    if len(words) == 1:
        return next(iter(words))
    return ", ".join(f"{''.join(axes)} {word}" for word, axes in words.items())


def judged(report: AllanReport) -> Judged:
    """The record against its data sheet in one word, and the terms that say it."""
    told = [
        (f"{NAMES[term][sensor]} of the {TITLES[sensor].lower()}", verdict(report, sensor, term))
        for sensor, term in report.sheet
    ]
    if not told:
        return Judged(
            "plain", "NO DATA SHEET", ("Nothing is known to hold these numbers against.",)
        )
    bad = [f"{name}: {word}" for name, word in told if "worse" in word]
    shown = [word for _, word in told if word in ("agrees", "better")]
    count = f"{len(shown)} of {len(told)} stated terms are as stated or better."
    hidden = [f"{name}: {word}" for name, word in told if word not in ("agrees", "better")]
    rest = (f"{'; '.join(hidden)}.",) if hidden else ()
    if bad:
        return Judged("bad", "WORSE THAN STATED", (count, *rest))
    if not shown:
        return Judged("open", "NOT SHOWN BY THIS RECORD", (count, *rest))
    return Judged("good", "AS STATED", (count, *rest))


def _judged(outcome: FoundTerm | MissingTerm, stated: float) -> str:
    if isinstance(outcome, MissingTerm):
        return "better" if outcome.upper < stated else "not shown"
    if outcome.low <= stated <= outcome.high:
        return "agrees"
    return "better" if outcome.high < stated else "worse"


def picture(report: AllanReport, theme: str = "light") -> bytes:
    """The curves as a PNG: gyros left, accelerometers right."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    ink = INKS[theme]
    figure = Figure(figsize=(14, 6.6), dpi=120, facecolor=ink["paper"], layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(1, 2)
    for panel, sensor in zip(axes, TITLES, strict=True):
        _panel(panel, report, sensor, theme)
    _caption(figure, report, ink)
    buffer = BytesIO()
    figure.savefig(buffer, format="png", facecolor=ink["paper"], metadata={"Software": None})
    return buffer.getvalue()


def _caption(figure: Figure, report: AllanReport, ink: dict[str, str]) -> None:
    result = report.analysis
    text = f"{Path(report.path).name}: {_hours(result.duration)} at {1 / result.interval:.6g} Hz"
    text += f"; dashed: {report.sheet_title}" if report.sheet_title else ""
    figure.suptitle(text, color=ink["ink"], fontsize=13)


def _panel(axes: Axes, report: AllanReport, sensor: str, theme: str) -> None:
    ink, styles = INKS[theme], STYLES if theme == "light" else DARK_STYLES
    unit = DEVIATION[sensor]
    channels = [c for c in report.analysis.channels if c.sensor == sensor]
    _frame(axes, f"{TITLES[sensor]}: Allan deviation [{unit.name}]", ink)
    seen = [c for c in channels if c.deviation.any()]
    if not seen:
        axes.set_xlim(channels[0].tau[0], channels[0].tau[-1])
        axes.text(
            0.5, 0.5, "constant: no noise to see", transform=axes.transAxes, ha="center",
            color=ink["ink"],
        )  # fmt: skip
        return
    for channel in seen:
        _draw(axes, channel, unit.si, *styles[channel.axis])
    tau = seen[0].tau
    axes.set_xlim(tau[0] / 1.6, tau[-1] * 1.6)
    axes.set_ylim(*_span(seen, report, sensor, unit.si))
    _sheet_lines(axes, report, sensor, tau, ink)
    _slope_key(axes, ink)
    legend = axes.legend(
        loc="upper right", frameon=False, fontsize=10, title="axis: 95 % band, fit"
    )
    for text in (*legend.get_texts(), legend.get_title()):
        text.set_color(ink["ink"])


def _frame(axes: Axes, title: str, ink: dict[str, str]) -> None:
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_facecolor(ink["paper"])
    axes.set_title(title, loc="left", fontsize=12, color=ink["ink"])
    axes.set_xlabel("averaging time τ [s]", color=ink["ink"])
    axes.grid(True, which="major", color=ink["grid"], linewidth=0.8)
    axes.tick_params(which="both", colors=ink["ink"])
    for spine in axes.spines.values():
        spine.set_color(ink["grid"])


def _draw(axes: Axes, channel: Channel, si: float, colour: str, marker: str) -> None:
    tau = channel.tau
    axes.fill_between(
        tau, channel.low / si, channel.high / si, color=colour, alpha=0.22, linewidth=0
    )
    axes.plot(
        tau, channel.deviation / si, linestyle="", color=colour, marker=marker, markersize=5,
        label=f"{channel.axis.upper()}1",
    )  # fmt: skip
    fine = np.geomspace(channel.first_tau, tau[-1], 200)
    axes.plot(fine, channel.fitted(fine) / si, color=colour, linewidth=1.4)


def _law(term: str, value: float, tau: np.ndarray) -> np.ndarray:
    factor, slope = LAWS[term]
    return np.sqrt(factor) * value * tau**slope


def _span(
    channels: Sequence[Channel], report: AllanReport, sensor: str, si: float
) -> tuple[float, float]:
    """Room for the bands and a decade below for sheet lines that are no further."""
    low = min(float(c.low.min()) for c in channels) / si
    high = max(float(c.high.max()) for c in channels) / si
    tau = channels[0].tau[[0, -1]]
    lines = [
        float(_law(term, report.sheet[sensor, term], tau).min()) / si
        for term in ("N", "B", "K")
        if (sensor, term) in report.sheet
    ]
    low = min([low, *(max(line, low / 10) for line in lines)])
    return low / 2, high * 2


def _sheet_lines(
    axes: Axes, report: AllanReport, sensor: str, tau: np.ndarray, ink: dict[str, str]
) -> None:
    """The data sheet's laws, dashed, each named where it runs clear of the others."""
    si = DEVIATION[sensor].si
    ends = np.array([tau[0], tau[-1]])
    bottom, top = axes.get_ylim()
    for term, (_, slope) in LAWS.items():
        stated = report.sheet.get((sensor, term))
        if stated is None:
            continue
        line = _law(term, stated, ends) / si
        axes.plot(ends, line, color=ink["sheet"], linewidth=1.3, linestyle=(0, (5, 3)), zorder=1)
        fine = np.geomspace(tau[0], tau[-1], 400)
        visible = fine[(bottom * 1.3 < (y := _law(term, stated, fine) / si)) & (y < top / 1.3)]
        if not len(visible):
            continue
        unit = UNITS[sensor, term]
        # Measured curves run above their asymptotes: names go left of where a line falls or
        # climbs, and below a level one, right of the key of slopes.
        place = visible[int(len(visible) * {-1: 0.62, 0: 0.26, 1: 0.3}[int(np.sign(slope))])]
        axes.annotate(
            f"{term} {stated / unit.si:.3g} {unit.name}, slope {SLOPES[slope]}",
            (place, float(_law(term, stated, np.array([place]))[0]) / si),
            xytext=(4 if slope == 0 else -5, 2 if slope > 0 else -3), textcoords="offset points",
            fontsize=9, color=ink["sheet"], ha="left" if slope == 0 else "right",
            va="bottom" if slope > 0 else "top",
        )  # fmt: skip


def _slope_key(axes: Axes, ink: dict[str, str]) -> None:
    """A fan of the five slopes with the terms they stand for, to lay an eye on a curve by."""
    key = axes.inset_axes((0.015, 0.02, 0.2, 0.24))
    key.set_facecolor(ink["paper"])
    key.patch.set_alpha(0.8)
    key.set_xlim(0, 1.75)
    key.set_ylim(-1.25, 1.25)
    key.set_xticks([])
    key.set_yticks([])
    for spine in key.spines.values():
        spine.set_visible(False)
    for term, (_, slope) in LAWS.items():
        key.plot([0.05, 1], [0.05 * slope, slope], color=ink["ink"], linewidth=1)
        key.text(1.06, slope, f"{term}  {SLOPES[slope]}", color=ink["ink"], fontsize=8, va="center")


def page(report: AllanReport, light: bytes, dark: bytes) -> str:
    """One HTML page that needs nothing else: tables, curves, how the numbers were got."""
    return render("allan.html.j2", _content(report, light, dark))


def _content(report: AllanReport, light: bytes, dark: bytes) -> dict[str, Any]:
    result = report.analysis
    return {
        "name": Path(report.path).name,
        "path": report.path,
        "topic": report.topic,
        "sheet_title": report.sheet_title,
        "judged": judged(report),
        "duration": _hours(result.duration),
        "rate": f"{1 / result.interval:.6g}",
        "samples": f"{result.samples:,}".replace(",", "\u202f"),
        "span": f"{result.t_from:.6g} to {result.t_to:.6g} s",
        "longest": _hours(float(result.channels[0].tau[-1])),
        "notes": report.notes,
        "sensors": [_sensor(report, sensor) for sensor in TITLES],
        "light": data_uri(light),
        "dark": data_uri(dark),
    }


def _sensor(report: AllanReport, sensor: str) -> dict[str, Any]:
    channels = [c for c in report.analysis.channels if c.sensor == sensor]
    rows = [
        {
            "term": term,
            "name": NAMES[term][sensor],
            "unit": UNITS[sensor, term].name,
            "cells": [_page_cell(c, term) for c in channels],
            "sheet": _sheet_cell(report, sensor, term),
            "verdict": verdict(report, sensor, term),
        }
        for term in ORDER
    ]
    return {"title": TITLES[sensor], "axes": [c.axis.upper() + "1" for c in channels], "rows": rows}


def _page_cell(channel: Channel, term: str) -> dict[str, str]:
    outcome, si = _outcome(channel, term), UNITS[channel.sensor, term].si
    if isinstance(outcome, FoundTerm):
        value, _, bounds = with_bounds(
            outcome.value / si, outcome.low / si, outcome.high / si
        ).partition(" ")
        return {"kind": "found", "main": value, "more": bounds.strip("()")}
    if channel.constant:
        return {"kind": "missing", "main": "constant", "more": ""}
    upper = outcome.upper / si
    more = needs_text(outcome) if channel.resolved else "below resolution"
    return {"kind": "missing", "main": f"< {upper:.2g}", "more": more}
