"""Figures of a report: when each step runs, what an uncertainty is made of, errors over time."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from math import ceil
from typing import TYPE_CHECKING

import numpy as np

from alignment import ImuReadings
from alignment.options import of_noise_alone
from alignment.units import ARC_SECOND, DEG
from stand.recording.curves import ANGLES, AngleCurves
from stand.recording.thinning import bin_length, extremes_in
from stand.report.page import HUES, INK, ON_HUE, PAPER, SOFT, Drawing, drawing, frame, span_text
from stand.samples import AXES

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WIDTH = 10.0  # inches: the page's
PHASES = {"motion": (HUES[1], ""), "settling": (HUES[4], "////"), "dwell": (HUES[0], "")}
NAMES = {"motion": "motion", "settling": "settling", "dwell": "dwell or steady turning"}
LONGEST_LABEL = 46  # letters beside a row
MOST_ROWS = 45  # of a timeline; more share rows of their kind
MOST_POINTS = 1500  # of a curve: more cannot be told apart on a page
LEAST_SOURCE = 0.005  # of a variance, anywhere, so that a source has a colour of its own
OTHERS = "others"
LEAST_SHARE = 0.09  # of a variance, so that its name fits inside
# Colours alone do not tell parts apart in print: those that share one differ by their hatching.
HATCHES = ("", "////", "....", "xxxx")


@dataclass(frozen=True, slots=True)
class Bar:
    """A step on the timeline: its phases as (phase of `PHASES`, from [s], to [s]).

    Steps of one `label` share a row.
    """

    label: str
    kind: str
    phases: tuple[tuple[str, float, float], ...]


@dataclass(frozen=True, slots=True)
class Budget:
    """What one uncertainty is made of: `total` as it is to be read; variances by source."""

    label: str
    total: str
    variances: Mapping[str, float]


def timeline(bars: Sequence[Bar], total: float) -> Drawing:
    """When each step runs, a row per step; of very many a row per kind."""
    rows = _rows(bars)
    names = list(rows)
    height = 1.1 + 0.27 * len(names)

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        for row, name in enumerate(names):
            for phase, t_from, t_to in (p for bar in rows[name] for p in bar.phases):
                colour, hatch = PHASES[phase]
                axes.barh(
                    row, t_to - t_from, left=t_from, height=0.72, color=colour, hatch=hatch,
                    edgecolor=PAPER if hatch else colour, linewidth=0 if hatch else 0.8,
                )  # fmt: skip
        _time_axis(axes, total)
        _row_labels(axes, names)
        used = {phase for bar in bars for phase, _, _ in bar.phases}
        _legend(figure, {NAMES[p]: PHASES[p] for p in PHASES if p in used})

    sums = {
        phase: sum(b - a for bar in bars for p, a, b in bar.phases if p == phase)
        for phase in PHASES
    }
    told = ", ".join(f"{NAMES[p]} {span_text(t)}" for p, t in sums.items() if t > 0)
    alt = f"Timeline of {len(bars)} steps over {span_text(total)}: {told}"
    return drawing("timeline", (WIDTH, height), alt, draw)


def _rows(bars: Sequence[Bar]) -> dict[str, list[Bar]]:
    """Rows by their name, in order: a step each, or a kind each where they are too many."""
    rows: dict[str, list[Bar]] = {}
    many = len(bars) > MOST_ROWS
    for bar in bars:
        rows.setdefault(bar.kind if many else _short(bar.label), []).append(bar)
    return rows


def _short(text: str) -> str:
    return text if len(text) <= LONGEST_LABEL else text[: LONGEST_LABEL - 1] + "…"


def _time_axis(axes: Axes, total: float, begin: float = 0.0) -> None:
    span = total - begin
    per, unit = (60.0, "min") if span >= 300 else (1.0, "s")
    per, unit = (3600.0, "h") if span >= 3 * 3600 else (per, unit)
    axes.set_xlim(begin, total if span > 0 else begin + 1.0)
    step = _tick(span / per) * per
    ticks = np.arange(np.ceil(begin / step) * step, total + 1e-9 * span, step)
    axes.set_xticks(ticks, [f"{tick / per:g}" for tick in ticks])
    frame(axes, grid="x")
    axes.set_xlabel(f"time [{unit}]")


def _tick(span: float) -> float:
    """A round step that parts a span in five to ten."""
    power = 10.0 ** np.floor(np.log10(max(span, 1e-9) / 5))
    return float(power * next(m for m in (1, 2, 5, 10) if span / (m * power) <= 10))


def _row_labels(axes: Axes, names: Sequence[str]) -> None:
    axes.set_yticks(range(len(names)), names, color=INK)
    axes.set_ylim(len(names) - 0.4, -0.6)
    axes.tick_params(axis="y", length=0, labelcolor=INK, labelsize=9)
    axes.spines["left"].set_visible(False)


def _legend(figure: Figure, styles: Mapping[str, tuple[str, str]], columns: int = 4) -> None:
    from matplotlib.patches import Patch

    handles = [
        Patch(facecolor=colour, hatch=hatch, edgecolor=PAPER if hatch else colour, label=name)
        for name, (colour, hatch) in styles.items()
    ]
    figure.legend(
        handles=handles, loc="outside upper left", ncols=min(columns, len(handles)), frameon=False,
        fontsize=9, labelcolor=INK, handlelength=1.4, columnspacing=1.6,
    )  # fmt: skip


@dataclass(frozen=True, slots=True)
class Against:
    """A prediction against what is required: `ratio` of the two, `guard` the part in doubt."""

    label: str
    verdict: str
    ratio: float | None
    guard: float


_VERDICT_HUES = {"PASS": HUES[2], "FAIL": HUES[1], "INDETERMINATE": HUES[4]}
MOST_RATIO = 2.5  # where bars end, so that the requirement stays in sight


def requirements(items: Sequence[Against]) -> Drawing:
    """How much of each requirement the prediction takes."""

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        for row, item in enumerate(items):
            axes.barh(
                row, 200 * item.guard, left=100 * (1 - item.guard), height=0.9, color=HUES[4],
                alpha=0.25, linewidth=0,
            )  # fmt: skip
            if item.ratio is not None:
                length, colour = 100 * min(item.ratio, MOST_RATIO), _VERDICT_HUES[item.verdict]
                axes.barh(row, length, height=0.5, color=colour, linewidth=0)
            axes.text(
                1.01, row, _against_text(item), transform=axes.get_yaxis_transform(), ha="left",
                va="center", fontsize=9, color=INK,
            )  # fmt: skip
        axes.axvline(100, color=INK, linewidth=1.4)
        frame(axes, grid="x")
        widest = max((item.ratio or 0.0 for item in items), default=0.0)
        axes.set_xlim(0, 100 * max(1.3, min(widest, MOST_RATIO)))
        axes.set_xlabel("predicted, in % of the requirement; shaded: guard band")
        _row_labels(axes, [_short(item.label) for item in items])

    words = "; ".join(f"{item.label}: {_against_text(item)}" for item in items)
    size = (WIDTH, 0.65 + 0.34 * len(items))
    return drawing("requirements", size, f"Predictions against requirements. {words}", draw)


def _against_text(item: Against) -> str:
    if item.ratio is None:
        return f"{item.verdict}, not determined"
    if item.ratio > MOST_RATIO:
        return f"{item.verdict}, {item.ratio:.3g} times"
    return f"{item.verdict}, {100 * item.ratio:.3g} %"


def budget(budgets: Sequence[Budget]) -> Drawing:
    """Shares of the variance, a row per uncertainty: they add up, as parts do in quadrature.

    Sources that have less than `LEAST_SOURCE` of every one share a colour.
    """
    budgets = _gathered(budgets)
    sources = _by_weight(budgets)
    styles = {source: _style(k) for k, source in enumerate(sources)}
    legend_rows = ceil(len(sources) / 4)

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        for row, item in enumerate(budgets):
            _share_row(axes, row, item, styles)
        frame(axes, grid="x")
        axes.set_xlim(0, 100)
        axes.set_xlabel("share of the variance [%]")
        _row_labels(axes, [_short(item.label) for item in budgets])
        _legend(figure, styles)

    words = "; ".join(f"{b.label} {b.total}: {_in_words(b)}" for b in budgets)
    size = (WIDTH, 1.0 + 0.2 * legend_rows + 0.34 * len(budgets))
    return drawing("budget", size, f"What each uncertainty is made of. {words}", draw)


def _style(k: int) -> tuple[str, str]:
    """Colour and hatching of the k-th source."""
    return HUES[k % len(HUES)], HATCHES[k // len(HUES) % len(HATCHES)]


def _weights(budgets: Sequence[Budget]) -> dict[str, float]:
    """The greatest share that each source has of any."""
    weight: dict[str, float] = {}
    for item in budgets:
        whole = sum(item.variances.values()) or 1.0
        for source, variance in item.variances.items():
            weight[source] = max(weight.get(source, 0.0), variance / whole)
    return weight


def _gathered(budgets: Sequence[Budget]) -> list[Budget]:
    """The same with sources that are small everywhere as one, `OTHERS`."""
    small = {source for source, weight in _weights(budgets).items() if weight < LEAST_SOURCE}
    gathered = []
    for item in budgets:
        kept = {s: v for s, v in item.variances.items() if s not in small}
        rest = sum(v for s, v in item.variances.items() if s in small)
        gathered.append(replace(item, variances=kept | ({OTHERS: rest} if rest else {})))
    return gathered


def _by_weight(budgets: Sequence[Budget]) -> list[str]:
    """All sources, those with the greatest share anywhere first."""
    weight = _weights(budgets)
    return sorted((s for s, w in weight.items() if w > 0), key=lambda s: -weight[s])


def _share_row(axes: Axes, row: int, item: Budget, styles: Mapping[str, tuple[str, str]]) -> None:
    whole = sum(item.variances.values())
    left = 0.0
    for source in styles:
        share = item.variances.get(source, 0.0) / whole if whole else 0.0
        if share <= 0:
            continue
        colour, hatch = styles[source]
        axes.barh(
            row, 100 * share, left=left, height=0.74, color=colour, hatch=hatch, edgecolor=PAPER,
            linewidth=0.6,
        )  # fmt: skip
        if not hatch and share >= max(LEAST_SHARE, 0.0115 * len(source)):
            axes.text(
                left + 50 * share, row, source, ha="center", va="center", fontsize=8.5,
                color=ON_HUE[HUES.index(colour)], weight="bold",
            )  # fmt: skip
        left += 100 * share
    axes.text(101, row, item.total, ha="left", va="center", fontsize=9, color=INK)


def _in_words(item: Budget) -> str:
    whole = sum(item.variances.values()) or 1.0
    parts = sorted(item.variances.items(), key=lambda part: -part[1])
    return ", ".join(f"{s} {100 * v / whole:.0f} %" for s, v in parts if v / whole >= 0.005)


@dataclass(frozen=True, slots=True)
class RatioRow:
    """Predicted over achieved sigma of a quantity.

    `ratio` is (value, low, high) of the stretch that is farthest off, `text` the same as it is to
    be read, `agrees` whether the runs bear it out; `others` are (value, agrees) of other stretches.
    """

    label: str
    text: str
    ratio: tuple[float, float, float]
    agrees: bool
    others: tuple[tuple[float, bool], ...] = ()


LEAST_REACH, MOST_REACH = 1.35, 10.0  # of the axis, as a factor either way: beyond, at its edge
EDGE = 1.04  # room for marks there
_FINE_TICKS = (0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1, 1.1, 1.2, 1.4, 1.6, 1.8, 2, 2.5)
_COARSE_TICKS = (0.1, 0.2, 0.5, 1, 2, 5, 10)
_COARSE_BEYOND = 2.6  # of a reach: fine ticks would touch


def ratios(rows: Sequence[RatioRow], band: tuple[float, float]) -> Drawing:
    """Predicted over achieved, a row per quantity, with the `band` in which they agree.

    Equal factors either way are equally far from 1.
    """
    every = [x for row in rows for x in (*row.ratio, *(x for x, _ in row.others))]
    least = max(min(every), 1 / MOST_REACH)
    reach = min(max(LEAST_REACH, max(every), 1 / least), MOST_REACH)

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        axes.axvspan(*band, color=HUES[2], alpha=0.2, linewidth=0)
        axes.axvline(1, color=INK, linewidth=1.0)
        for number, row in enumerate(rows):
            _ratio_row(axes, number, row, reach)
        _ratio_axis(axes, reach)
        axes.set_xlabel("predicted over achieved standard deviation")
        _row_labels(axes, [_short(row.label) for row in rows])

    words = "; ".join(f"{row.label}: {row.text}" for row in rows)
    size = (WIDTH, 0.65 + 0.3 * len(rows))
    alt = f"Predicted over achieved standard deviation. {words}"
    return drawing("ratios", size, alt, draw, _ratio_caption(rows, band))


def _ratio_caption(rows: Sequence[RatioRow], band: tuple[float, float]) -> str:
    """What is drawn, without what is not."""
    parts = ["Dot and bar: the ratio and its 95 % interval"]
    if any(row.others for row in rows):
        parts[0] += ", of the stretch that is farthest off; rings: the other stretches"
    if not all(row.agrees for row in rows):
        parts.append("crosses and broken bars: contradicted, the interval misses the shaded band")
    parts.append(f"shaded: {band[0]:g} to {band[1]:g}")
    if any(_within(row.ratio[0], MOST_REACH) != row.ratio[0] for row in rows):
        parts.append("arrow: beyond the edge")
    return "; ".join(parts) + "."


def _ratio_axis(axes: Axes, reach: float) -> None:
    axes.set_xscale("log")
    axes.set_xlim(1 / (reach * EDGE), reach * EDGE)
    every = _FINE_TICKS if reach < _COARSE_BEYOND else _COARSE_TICKS
    ticks = [tick for tick in every if 1 / reach <= tick <= reach]
    axes.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    axes.set_xticks([], minor=True)
    frame(axes, grid="x")


def _ratio_row(axes: Axes, number: int, row: RatioRow, reach: float) -> None:
    value, low, high = row.ratio
    axes.plot(
        [_within(low, reach), _within(high, reach)], [number] * 2, color=_ratio_hue(row.agrees),
        linewidth=2.4, linestyle="-" if row.agrees else (0, (2.2, 1.1)), zorder=2,
    )  # fmt: skip
    for other, agrees in row.others:
        axes.plot(
            [_within(other, reach)], [number], marker="o" if agrees else "x",
            markersize=5 if agrees else 6, markerfacecolor=PAPER,
            markeredgecolor=_ratio_hue(agrees), markeredgewidth=1.2, zorder=3,
        )  # fmt: skip
    axes.plot(
        [_within(value, reach)], [number], marker=_ratio_marker(row, reach),
        markersize=7 if row.agrees else 10, color=_ratio_hue(row.agrees), markeredgecolor=PAPER,
        markeredgewidth=0.8, zorder=4,
    )  # fmt: skip
    axes.text(
        1.015, number, row.text, transform=axes.get_yaxis_transform(), ha="left", va="center",
        fontsize=9, color=INK, weight="normal" if row.agrees else "bold",
    )  # fmt: skip


def _within(ratio: float, reach: float) -> float:
    return min(max(ratio, 1 / reach), reach)


def _ratio_hue(agrees: bool) -> str:
    return HUES[0] if agrees else HUES[1]


def _ratio_marker(row: RatioRow, reach: float) -> str:
    """A dot, a cross where contradicted, an arrow at the edge for what lies beyond it."""
    if _within(row.ratio[0], reach) != row.ratio[0]:
        return ">" if row.ratio[0] > 1 else "<"
    return "o" if row.agrees else "X"


CHANNEL_ROWS = 1200  # of each curve


def channels(readings: ImuReadings, shaded: Sequence[tuple[float, float]] = ()) -> Drawing:
    """Rates and specific forces over time, extremes kept; `shaded`: stretches [s]."""
    m = bin_length(len(readings), CHANNEL_ROWS)
    panels = (("rate [deg/s]", readings.w_ib_b, DEG), ("specific force [m/s²]", readings.f_b, 1.0))
    rows = [(name, extremes_in(readings.t, values, unit, m)) for name, values, unit in panels]
    t_from, t_to = float(readings.t[0]), float(readings.t[-1])

    def draw(figure: Figure) -> None:
        for axes, (name, (stamps, values)) in zip(
            figure.subplots(2, 1, sharex=True), rows, strict=True
        ):
            for a, b in shaded:
                axes.axvspan(a, b, color=HUES[5], alpha=0.18, linewidth=0)
            for k, axis in enumerate(AXES):
                axes.plot(stamps * 1e-9, values[:, k], color=HUES[k], linewidth=1, label=axis)
            _time_axis(axes, t_to, t_from)
            frame(axes, name)
        figure.get_axes()[0].set_xlabel("")
        handles, names = figure.get_axes()[0].get_legend_handles_labels()
        figure.legend(
            handles, names, loc="outside upper right", ncols=3, frameon=False, fontsize=9,
            labelcolor=INK,
        )  # fmt: skip

    spans = "; ".join(
        f"{name} {axis} {low:.4g} to {high:.4g}"
        for name, (_, values) in rows
        for axis, low, high in zip(AXES, values.min(axis=0), values.max(axis=0), strict=True)
    )
    told = "what is estimated from is shaded; " if shaded else ""
    thinned = "every sample is drawn" if m == 1 else f"the extremes of every {m} samples are drawn"
    alt = f"Gyros and accelerometers over time. {spans}"
    return drawing("channels", (WIDTH, 4.4), alt, draw, f"{told}{thinned}.".capitalize())


def errors(
    method: str,
    number: int,
    tracks: Sequence[AngleCurves],
    total: float,
    noise_only: Collection[str] = (),
) -> Drawing:
    """Errors of a method's angles over the run, with one predicted sigma about zero.

    `noise_only`: the sensors of which no sheet states more.
    """
    alone = [a for a in ANGLES if of_noise_alone(a, noise_only)]
    of_noise = f", of noise only in {', '.join(alone)}" if alone else ""
    greatest = max((_greatest(c.errors) for c in tracks), default=0.0)
    unit, per = ("arc s", ARC_SECOND) if greatest < 0.05 * DEG else ("deg", DEG)

    def draw(figure: Figure) -> None:
        panels = figure.subplots(3, 1, sharex=True)
        for k, (axes, angle) in enumerate(zip(panels, ANGLES, strict=True)):
            for track in tracks:
                _error_curve(axes, track, k, per)
            axes.axhline(0, color=SOFT, linewidth=0.8)
            _error_span(axes, [c.errors[:, k] / per for c in tracks])
            if not any(np.isfinite(c.errors[:, k]).any() for c in tracks):
                axes.text(0.5, 0.2, "not determined", transform=axes.transAxes, ha="center")
            _time_axis(axes, total)
            frame(axes, f"{angle} [{unit}]")
            axes.set_xlabel("" if k < 2 else axes.get_xlabel())
        _stretch_names(panels[0], tracks)

    last = "; ".join(
        f"{c.label}: "
        + ", ".join(
            f"{a} not determined" if np.isnan(e) else f"{a} {e / per:+.3g}"
            for a, e in zip(ANGLES, c.errors[-1], strict=True)
        )
        for c in tracks
        if len(c.t_ns)
    )
    return drawing(
        f"errors{number}",
        (WIDTH, 5.4),
        f"Errors of {method} over time in {unit}; at the end of each stretch: {last}",
        draw,
        f"{method}: estimate minus truth [{unit}]; shaded: one predicted standard deviation"
        f"{of_noise}.",
    )


def _greatest(values: np.ndarray) -> float:
    """The greatest size there is; 0 of nothing but NaN."""
    return float(np.abs(values[np.isfinite(values)]).max(initial=0.0))


def _error_curve(axes: Axes, track: AngleCurves, k: int, per: float) -> None:
    step = max(1, len(track.t_ns) // MOST_POINTS)
    t = track.t_ns[::step] * 1e-9
    error, sigma = track.errors[::step, k] / per, track.sigmas[::step, k] / per
    if np.nan_to_num(sigma).any():
        axes.fill_between(t, -sigma, sigma, color=HUES[5], alpha=0.3, linewidth=0)
    axes.plot(t, error, color=HUES[0], linewidth=1.2)


def _error_span(axes: Axes, errors_of: Sequence[np.ndarray]) -> None:
    """What the curves span once they have begun: the first moments of a track may be anything."""
    settled = np.concatenate([e[len(e) // 20 :] for e in errors_of] or [np.zeros(1)])
    size = _greatest(settled) or 1.0
    axes.set_ylim(-1.25 * size, 1.25 * size)


def _stretch_names(axes: Axes, tracks: Sequence[AngleCurves]) -> None:
    for label, t in {c.label: c.t_ns for c in tracks}.items():
        axes.text(
            float(t.mean()) * 1e-9, 0.97, _short(label), transform=axes.get_xaxis_transform(),
            ha="center", va="top", fontsize=8.5, color=SOFT, clip_on=True,
        )  # fmt: skip
