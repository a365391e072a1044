"""Figures of a campaign: curves, heat maps, what matters most, distributions, honesty, yield."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite, log10
from typing import TYPE_CHECKING, Any

import numpy as np

from alignment.units import ARC_SECOND, DEG
from stand.campaigns.summary import (
    PARTS,
    Cell,
    Honesty,
    Series,
    Summary,
    Yield,
    sensitivities,
)
from stand.campaigns.sweep import VaryEntry, shown
from stand.report.document import UNDETERMINED, method_text
from stand.report.page import HUES, INK, PAPER, SOFT, Drawing, drawing, frame, logarithmic
from stand.report.wording import digits

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WIDTH = 10.0  # inches: the page's
MOST_LINES = len(HUES)  # curves of a figure: a colour each
MOST_CELLS = 400  # of a heat map, with their numbers
MOST_ROWS = 40  # of a distribution
MARKERS = "osD^vP*X"
MOST_NEES = 30.0  # that is drawn as it is
WIDE = 10.0  # of a span: from here on logarithmic
_SMALL = 0.01 * DEG


@dataclass(frozen=True, slots=True)
class Axis:
    """One parameter as an axis: a place for every value, numbers where they are numbers."""

    label: str
    values: tuple[Any, ...]
    numeric: bool
    log: bool

    def at(self, value: Any) -> float:
        """Where a value stands."""
        return float(value) if self.numeric else float(self.values.index(value))


def axis_of(summary: Summary, k: int) -> Axis:
    """The axis of the k-th parameter."""
    one: VaryEntry = summary.sweep.entry.vary[k]
    column: list[Any] = [values[k] for values in summary.sweep.values]
    numeric = all(isinstance(v, int | float) and not isinstance(v, bool) for v in column)
    values = tuple(sorted(set(column)) if numeric else dict.fromkeys(column))
    wide = numeric and values[0] > 0 and values[-1] > WIDE * values[0]
    stated = one.range is not None and one.range.scale == "log"
    return Axis(one.label, values, numeric, log=numeric and values[0] > 0 and (stated or wide))


def named(series: Series) -> str:
    """'two-position: heading at first'."""
    return f"{method_text(series.method, series.window)}: {series.quantity} at {series.place}"


def unit_of(series: Series, greatest: float) -> tuple[str, float]:
    """In what a series is drawn: small angles in arc seconds."""
    unit, per = series.unit
    return ("arc s", ARC_SECOND) if unit == "deg" and greatest < _SMALL else (unit, per)


def curves(summary: Summary, series: Series, number: int) -> Drawing | None:
    """Achieved errors with their intervals over the prediction; a line per second parameter."""
    cells = summary.told(series)
    count = len(summary.sweep.labels)
    if not cells or count == 0:
        return None
    unit, per = unit_of(series, max(c.rms for c in cells))
    axes_of = [axis_of(summary, k) for k in range(count)]
    together = summary.sweep.entry.combine == "product" and count == 2
    limit = set(summary.limits.values())
    none = [c for c in summary.of(series) if not c.determined]

    def draw(figure: Figure) -> None:
        columns = 1 if together or count == 1 else min(count, 3)
        panels = np.atleast_1d(figure.subplots(1, columns, sharey=True))
        for k, axes in enumerate(panels):
            if together:
                _lines(axes, summary, cells, axes_of, per)
            else:
                _line(axes, summary, cells, k, axes_of[k], per, joined=count == 1)
            _crosses(axes, [axes_of[k].at(summary.sweep.values[c.case - 1][k]) for c in none])
            _x_axis(axes, axes_of[k])
            _y_axis(axes, [c.low for c in cells], [c.high for c in cells], per)
            if len(limit) == 1:
                axes.axhline(next(iter(limit)) / per, color=HUES[1], linestyle=(0, (4, 2)))
            frame(axes)
        panels[0].set_ylabel(f"rms error [{unit}]")
        if together:
            legend = panels[0].legend(
                title=axes_of[1].label, frameon=False, fontsize=8.5, labelcolor=INK,
                title_fontsize=8.5, loc="center left", bbox_to_anchor=(1.0, 0.5),
            )  # fmt: skip
            legend.get_title().set_color(INK)

    words = "; ".join(
        f"case {c.case}: {digits(c.rms / per)} ({digits(c.low / per)} to {digits(c.high / per)})"
        for c in cells[:60]
    )
    caption = (
        f"{named(series)}. Marks and bars: root mean square of the errors of all runs, and its "
        f"95 % interval; lines: what a rehearsal of the same case predicts{_alone(cells)}."
    )
    caption += _left_out(summary, series, " (crosses at the foot)")
    if len(limit) == 1:
        caption += " Broken line: what is required of one unit."
    alt = f"Errors of {named(series)} in {unit}. {words}"
    return drawing(f"curves{number}", (WIDTH, 4.2), alt, draw, caption)


def _alone(cells: Sequence[Cell]) -> str:
    """What a prediction of noise alone is called in a caption."""
    alone = [c.noise_only for c in cells]
    return ", of noise only" if all(alone) else ", in some of noise only" if any(alone) else ""


def _left_out(summary: Summary, series: Series, where: str = "") -> str:
    """Which cases have no number, in a sentence."""
    none = [str(c.case) for c in summary.of(series) if not c.determined]
    if not none:
        return ""
    which = f"case {', '.join(none)}" if len(none) <= MOST_LINES else f"{len(none)} cases"
    return f" {UNDETERMINED.capitalize()}{where}: {which}."


def _crosses(axes: Axes, at: Sequence[float]) -> None:
    """Where on the horizontal axis there is no number."""
    if at:
        foot = axes.get_xaxis_transform()
        axes.plot(at, [0.03] * len(at), "x", color=SOFT, markersize=6, transform=foot)


def _lines(
    axes: Axes, summary: Summary, cells: Sequence[Cell], axes_of: Sequence[Axis], per: float
) -> None:
    """A line per value of the second parameter, of many some evenly among them."""
    x, second = axes_of
    picked = _some(second.values, MOST_LINES)
    for n, value in enumerate(picked):
        own = [c for c in cells if summary.sweep.values[c.case - 1][1] == value]
        at = [x.at(summary.sweep.values[c.case - 1][0]) for c in own]
        order = np.argsort(at)
        own, at = [own[i] for i in order], [at[i] for i in order]
        _marks(axes, at, own, per, (HUES[n], MARKERS[n]), shown(value))
        _predicted(axes, at, own, per, HUES[n])


def _line(
    axes: Axes,
    summary: Summary,
    cells: Sequence[Cell],
    k: int,
    x: Axis,
    per: float,
    joined: bool,
) -> None:
    """Every case over one parameter; joined where nothing else is varied."""
    order = sorted(cells, key=lambda c: x.at(summary.sweep.values[c.case - 1][k]))
    at = [x.at(summary.sweep.values[c.case - 1][k]) for c in order]
    _marks(axes, at, order, per, (HUES[0], "o"), "achieved")
    if joined:
        _predicted(axes, at, order, per, HUES[0])
    else:
        there = [(a, c.predicted / per) for a, c in zip(at, order, strict=True) if c.predicted]
        axes.plot(*zip(*there, strict=True) if there else ([], []), "_", color=INK, markersize=9)


def _marks(
    axes: Axes,
    at: Sequence[float],
    cells: Sequence[Cell],
    per: float,
    style: tuple[str, str],
    label: str,
) -> None:
    rms = np.array([c.rms for c in cells]) / per
    below = rms - np.array([c.low for c in cells]) / per
    above = np.array([c.high for c in cells]) / per - rms
    axes.errorbar(
        at, rms, yerr=np.stack([below, above]), fmt=style[1], color=style[0], markersize=4.5,
        linewidth=1.3, capsize=2.5, label=label,
    )  # fmt: skip


def _predicted(
    axes: Axes, at: Sequence[float], cells: Sequence[Cell], per: float, colour: str
) -> None:
    line = [np.nan if c.predicted is None else c.predicted / per for c in cells]
    axes.plot(at, line, color=colour, linewidth=1.2, alpha=0.75)


def _some(values: Sequence[Any], most: int) -> list[Any]:
    """All values, or as many evenly among them."""
    if len(values) <= most:
        return list(values)
    return [values[round(i)] for i in np.linspace(0, len(values) - 1, most)]


def _x_axis(axes: Axes, x: Axis) -> None:
    axes.set_xlabel(x.label)
    if not x.numeric:
        axes.set_xticks(range(len(x.values)), [shown(v) for v in x.values])
        axes.set_xlim(-0.5, len(x.values) - 0.5)
    elif x.log:
        axes.set_xscale("log")
        _ticks(axes.xaxis, x.values[0], x.values[-1])


def _y_axis(axes: Axes, low: Sequence[float], high: Sequence[float], per: float) -> None:
    least, most = min(low) / per, max(high) / per
    if least > 0 and most > WIDE * least:
        axes.set_yscale("log")
        _ticks(axes.yaxis, least, most)
    else:
        axes.set_ylim(0, None)


def _ticks(axis: Any, least: float, most: float) -> None:
    """Of a logarithmic axis: 1, 2 and 5 of a few decades, plain numbers."""
    logarithmic(axis)
    parts = (1, 2, 5) if most / least < 300 else (1,)
    decades = range(int(np.floor(log10(least))), int(np.ceil(log10(most))) + 1)
    ticks = [p * 10.0**d for d in decades for p in parts]
    axis.set_ticks([t for t in ticks if 0.7 * least <= t <= 1.4 * most])


def heat_map(summary: Summary, series: Series, number: int) -> Drawing | None:
    """Achieved errors over two parameters."""
    cells = summary.told(series)
    if summary.sweep.entry.combine != "product" or len(summary.sweep.labels) != 2 or not cells:
        return None
    x, y = axis_of(summary, 0), axis_of(summary, 1)
    if min(len(x.values), len(y.values)) < 2 or len(x.values) * len(y.values) > MOST_CELLS:
        return None
    unit, per = unit_of(series, max(c.rms for c in cells))
    sizes = [c.rms for c in cells]
    low, high = min(sizes), max(sizes)

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        for cell in cells:
            a, b = summary.sweep.values[cell.case - 1]
            i, j = x.values.index(a), y.values.index(b)
            part = _part(cell.rms, low, high)
            axes.fill(
                [i, i + 1, i + 1, i], [j, j, j + 1, j + 1], color=HUES[0], alpha=0.06 + 0.6 * part,
                linewidth=0,
            )  # fmt: skip
            axes.text(
                i + 0.5, j + 0.5, digits(cell.rms / per), ha="center", va="center", color=INK,
                fontsize=8.5 if len(x.values) <= 12 else 7,
            )  # fmt: skip
        axes.set_xticks(np.arange(len(x.values)) + 0.5, [f"{shown(v)}" for v in x.values])
        axes.set_yticks(np.arange(len(y.values)) + 0.5, [f"{shown(v)}" for v in y.values])
        axes.set_xlim(0, len(x.values))
        axes.set_ylim(0, len(y.values))
        axes.set_xlabel(x.label)
        frame(axes)
        axes.grid(False)

    alt = f"Heat map of {named(series)}: {digits(low / per)} to {digits(high / per)} {unit}"
    # the upright one's name stands here: beside few rows it would be cut
    caption = (
        f"{named(series)}: root mean square of the errors [{unit}]; across {x.label}, up {y.label}."
    )
    caption += _left_out(summary, series)
    return drawing(f"heat{number}", (WIDTH, 1.0 + 0.42 * len(y.values)), alt, draw, caption)


def _part(value: float, low: float, high: float) -> float:
    """Of the way from the least to the greatest, by factors."""
    if not 0 < low < high:
        return 0.0
    return log10(value / low) / log10(high / low)


def _of_others(summary: Summary) -> str:
    drawn = summary.sweep.entry.combine == "latin-hypercube"
    return "the others in their middle, by a fit" if drawn else "over all values of the others"


def tornado(summary: Summary, series: Series) -> Drawing | None:
    """From the least to the greatest error, parameter by parameter."""
    found = sensitivities(summary, series)
    if len(found) < 2:
        return None
    unit, per = unit_of(series, max(s.span[1] for s in found))

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        for row, s in enumerate(found):
            low, high = (x / per for x in s.span)
            axes.barh(row, high - low, left=low, height=0.55, color=HUES[0], linewidth=0)
            for end, edge, side in ((low, s.span[0], "right"), (high, s.span[1], "left")):
                axes.annotate(
                    s.values[s.rms.index(edge)], (end, row), ha=side, va="center", fontsize=8.5,
                    xytext=(4 if side == "left" else -4, 0), textcoords="offset points", color=SOFT,
                )  # fmt: skip
        axes.set_yticks(range(len(found)), [s.label for s in found])
        axes.set_ylim(len(found) - 0.5, -0.5)
        least, most = min(s.span[0] for s in found) / per, max(s.span[1] for s in found) / per
        room = (0.02 + 0.014 * max(len(v) for s in found for v in s.values)) * (most - least)
        axes.set_xlim(least - room, most + room)
        axes.set_xticks([t for t in axes.get_xticks() if 0 <= t <= most + room])
        axes.set_xlabel(f"rms error [{unit}], {_of_others(summary)}")
        frame(axes, grid="x")
        axes.tick_params(axis="y", colors=INK)

    words = "; ".join(
        f"{s.label}: {digits(s.span[0] / per)} to {digits(s.span[1] / per)}" for s in found
    )
    caption = f"{named(series)}: what each parameter does, from the value at one end to the other."
    return drawing("tornado", (WIDTH, 0.9 + 0.45 * len(found)), f"Tornado. {words}", draw, caption)


def distribution(summary: Summary, series: Series) -> Drawing | None:
    """The errors of every case: half of them, 95 % of them, their median."""
    told = summary.told(series)
    cells = _some(told, MOST_ROWS)
    if not cells:
        return None
    unit, per = unit_of(series, max(c.rms for c in cells))
    wide = max(abs(x) for c in cells for x in c.parts) > 30 * min(c.rms for c in cells) > 0

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        for row, cell in enumerate(cells):
            parts = [x / (cell.rms if wide else per) for x in cell.parts]
            axes.plot([parts[0], parts[-1]], [row] * 2, color=HUES[5], linewidth=2)
            axes.plot([parts[1], parts[3]], [row] * 2, color=HUES[0], linewidth=5)
            axes.plot([parts[2]], [row], "o", color=PAPER, markersize=4, markeredgecolor=INK)
        axes.axvline(0, color=SOFT, linewidth=0.8)
        axes.set_yticks(range(len(cells)), [_case_text(summary, c.case) for c in cells])
        axes.set_ylim(len(cells) - 0.5, -0.5)
        axes.set_xlabel("error over rms of its case" if wide else f"error [{unit}]")
        frame(axes, grid="x")
        axes.tick_params(axis="y", colors=INK, labelsize=8)

    named_parts = ", ".join(f"{100 * p:g} %" for p in PARTS)
    alt = f"Distribution of errors of {named(series)} by case: {named_parts} of them"
    caption = f"{named(series)}: dot: median; thick: half of all runs; thin: 95 % of them."
    if len(cells) < len(told):
        caption += f" {len(cells)} of {len(told)} cases, evenly among them."
    caption += _left_out(summary, series)
    return drawing("distribution", (WIDTH, 0.9 + 0.21 * len(cells)), alt, draw, caption)


def _case_text(summary: Summary, case: int) -> str:
    values = ", ".join(shown(v) for v in summary.sweep.values[case - 1])
    return f"{case}: {values}" if values else str(case)


def honesty(found: Sequence[Honesty]) -> Drawing | None:
    """Mean NEES of every case, and where it is to lie."""
    if not found:
        return None
    ways = list(dict.fromkeys((h.method, h.window) for h in found))[: len(HUES)]
    cases = max(h.case for h in found)
    top = max(min(h.mean, MOST_NEES) for h in found)
    wide = max(1.5, min(9.0, 300 / (cases * len(ways))))

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        for n, way in enumerate(ways):
            own = sorted((h for h in found if (h.method, h.window) == way), key=lambda h: h.case)
            at = [h.case + (n - (len(ways) - 1) / 2) * min(0.5 / len(ways), 0.12) for h in own]
            low, high = [h.low for h in own], [min(h.high, 2 * MOST_NEES) for h in own]
            axes.vlines(at, low, high, color=HUES[2], alpha=0.3, linewidth=wide)
            axes.plot(
                at, [min(h.mean, MOST_NEES) for h in own], MARKERS[n], color=HUES[n],
                markersize=4.5, label=method_text(*way),
            )  # fmt: skip
        axes.axhline(3, color=INK, linewidth=0.8)
        axes.set_ylim(0, max(6.0, 1.1 * top))
        _case_axis(axes, cases)
        axes.set_ylabel("mean NEES")
        frame(axes)
        if len(ways) > 1:
            axes.legend(frameon=False, fontsize=8.5, labelcolor=INK)

    words = "; ".join(f"{h.method} case {h.case}: {h.mean:.2f}" for h in found[:60])
    caption = (
        "Normalised squared error of the attitude, 3 where the covariance is honest; green: where "
        "its mean is to lie in 95 of 100 cases."
    )
    return drawing("nees", (WIDTH, 3.2), f"Mean NEES by case. {words}", draw, caption)


def _case_axis(axes: Axes, cases: int) -> None:
    axes.set_xlabel("case")
    axes.set_xlim(0.5, cases + 0.5)
    axes.set_xticks(sorted({round(x) for x in np.linspace(1, cases, min(cases, 11))}))


def yields(found: Sequence[Yield]) -> Drawing | None:
    """The share of units that pass, case by case."""
    own = [y for y in found if y.case]
    if len({y.case for y in own}) < 2:
        return None
    ways: Mapping[tuple[str, str], int] = {
        way: n for n, way in enumerate(dict.fromkeys((y.method, y.window) for y in own))
    }

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        for (method, window), n in list(ways.items())[: len(HUES)]:
            these = [y for y in own if (y.method, y.window) == (method, window)]
            share = np.array([y.share for y in these])
            spread = np.stack([share - [y.low for y in these], [y.high for y in these] - share])
            axes.errorbar(
                [y.case + 0.1 * n for y in these], 100 * share, yerr=100 * np.maximum(spread, 0),
                fmt=MARKERS[n], color=HUES[n], markersize=4.5, linewidth=1.3, capsize=2.5,
                label=method_text(method, window),
            )  # fmt: skip
        axes.set_ylim(-3, 103)
        _case_axis(axes, max(y.case for y in own))
        axes.set_ylabel("units that pass [%]")
        frame(axes)
        if len(ways) > 1:
            axes.legend(frameon=False, fontsize=8.5, labelcolor=INK)

    words = "; ".join(f"case {y.case} {y.method}: {100 * y.share:.3g} %" for y in own[:60])
    caption = "Share of units that meet what is required, with the 95 % interval (Clopper-Pearson)."
    return drawing("yield", (WIDTH, 3.2), f"Yield by case. {words}", draw, caption)


def finite(value: float, per: float) -> str:
    """A number, or nothing."""
    return digits(value / per) if isfinite(value) else ""
