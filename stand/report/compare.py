"""Methods side by side to look at: a table for a terminal, a PNG of heading error over time.

matplotlib is imported where it is used: it takes a second to start.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from io import BytesIO
from math import ceil, isfinite
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from alignment.options import of_noise_alone
from alignment.units import ARC_SECOND, DEG
from stand.evaluation.comparison import Comparison
from stand.evaluation.heading_history import History, histories
from stand.evaluation.statistics import Tally
from stand.folder import RECORDINGS, write_file
from stand.imu import unstated
from stand.imu.priors import noise_alone, only
from stand.report.document import UNDETERMINED, number, sigma_text
from stand.report.tables import TableData
from stand.simulation.settings import run_id

if TYPE_CHECKING:
    from matplotlib.axes import Axes

PNG = "compare.png"
INK = {"paper": "#ffffff", "ink": "#1b1f24", "grid": "#d9dde3", "floor": "#4a4f57"}
# Okabe and Ito's blue, told from the orange of what lies outside by colour-blind eyes
LINE, OUTSIDE = "#0072B2", "#D55E00"
COLUMNS = (
    "method",
    "heading",
    "sigma",
    "floor",
    "err/floor (95 %)",
    "tilt",
    "tilt sigma",
    "tilt floor",
    "NEES (bounds)",
    "time",
)
NOTES = (
    "heading, tilt: root mean square of the errors; sigma: what the method claims, on average; "
    "tilt about one axis",
    "floor: what white noise alone allows in the time that was used, ARW/(W cos lat sqrt T) and "
    "VRW/(g sqrt T)",
    "NEES: 3 where the covariance is honest; bounds of 95 %",
    "time: work per run",
)
BEYOND = "* beyond the linear range: heading sigma or floor above 8 deg, where neither holds"


def table(comparison: Comparison) -> TableData:
    """A row per method."""
    s = comparison.settings
    title = f"{s.procedure.entry.title}: {s.imu.title}, {comparison.runs} runs at {s.rate_hz} Hz"
    title += f" from seed {s.seed}; heading in deg, tilt in arc seconds"
    notes: list[str] = list(NOTES)
    if any(t.beyond_linear for t in comparison.tallies):
        notes.append(BEYOND)
    notes += [
        f"heading {UNDETERMINED} by {t.method}: {t.undetermined_text}"
        + ("" if t.why_undetermined else ": the numbers are of the others")
        for t in comparison.tallies
        if t.undetermined
    ]
    notes += [
        f"tilt {UNDETERMINED} by {t.method}: {t.why_untilted}"
        for t in comparison.tallies
        if t.why_untilted
    ]
    notes += refusals(comparison.tallies)
    notes += unstated(s.imu)
    return TableData(
        title,
        COLUMNS,
        tuple(_row(t, noise_alone(s.unit)) for t in comparison.tallies),
        notes=tuple(notes),
        optional=("tilt floor", "tilt sigma", "floor", "time"),
    )


def refusals(tallies: Sequence[Tally]) -> list[str]:
    """Why methods gave no answer, or not in every run, or not of every stretch; those with one
    reason together."""
    found: dict[tuple[str, str], list[str]] = {}
    for t in tallies:
        told = [(t.method, t.refused, t.reason)] if t.refused else []
        told += [(f"{t.method} at {one.stretch}", one.runs, one.reason) for one in t.left_out]
        for who, runs, reason in told:
            often = "always" if runs == t.runs else f"in {runs} of {t.runs} runs"
            found.setdefault((often, reason), []).append(who)
    return [
        f"no answer {often} from {', '.join(methods)}: {reason}"
        for (often, reason), methods in found.items()
    ]


def _row(t: Tally, noise_only: Collection[str]) -> tuple[str, ...]:
    if t.refused == t.runs:
        return (t.method, "refuses", *[""] * (len(COLUMNS) - 2))
    return (
        t.method,
        UNDETERMINED
        if t.why_undetermined
        else _short(t.rms_heading / DEG) + ("*" if t.beyond_linear else ""),
        _sigma(t.sigma_heading / DEG, of_noise_alone("heading", noise_only)),
        _short(t.floor_heading / DEG),
        _between(t.ratio, t.ratio_low, t.ratio_high),
        UNDETERMINED if t.why_untilted else _short(t.rms_tilt / ARC_SECOND),
        _sigma(t.sigma_tilt / ARC_SECOND, of_noise_alone("tilt", noise_only)),
        _short(t.floor_tilt / ARC_SECOND),
        _between(t.nees_mean, t.nees_low, t.nees_high),
        f"{t.seconds * 1e3:.3g} ms",
    )


def _short(value: float) -> str:
    """Three digits, or all of those before the point; nothing for NaN."""
    if not isfinite(value):
        return ""
    return f"{value:.3g}" if abs(value) < 100 else f"{value:.0f}"


def _sigma(value: float, noise_only: bool) -> str:
    return _short(value) + only(noise_only and isfinite(value))


def _between(value: float, low: float, high: float) -> str:
    if not isfinite(value):
        return ""
    shown = f"{value:.2f}" if value < 10 else _short(value)
    places = 2 if high < 10 else 0
    return f"{shown} ({low:.{places}f}-{high:.{places}f})"


# --- the picture ---------------------------------------------------------------------------------


def write_first_run(comparison: Comparison, folder: Path | None = None) -> Path:
    """Write the picture of the comparison's first run, without a folder among the recordings."""
    s = comparison.settings
    found = histories(s, [t.method for t in comparison.tallies])
    return write_picture(comparison, found, folder or RECORDINGS / f"compare_{run_id(s)}")


def write_picture(comparison: Comparison, found: Sequence[History], folder: Path) -> Path:
    """Write `PNG` into a folder, which is made; one that is there is replaced."""
    return write_file(folder / PNG, picture(comparison, found))


def picture(comparison: Comparison, found: Sequence[History]) -> bytes:
    """Heading error over time inside three sigma, a panel per method, as a PNG."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    undetermined = {t.method for t in comparison.tallies if t.why_undetermined}
    alone = of_noise_alone("heading", noise_alone(comparison.settings.unit))
    there = {h.method for h in found} | undetermined
    methods = [t.method for t in comparison.tallies if t.method in there]
    wide = min(3, max(1, len(methods)))
    high = max(1, ceil(len(methods) / wide))
    size = (max(5.2 * wide, 9.0), 2.9 * high + 1.2)
    figure = Figure(figsize=size, dpi=120, facecolor=INK["paper"], layout="constrained")
    FigureCanvasAgg(figure)
    grid = figure.subplots(high, wide, squeeze=False, sharex=True)
    for axes in grid.flat[len(methods) :]:
        axes.set_visible(False)
    last = max((float(h.t[-1]) for h in found), default=1.0)
    for place, (axes, method) in enumerate(zip(grid.flat, methods, strict=False)):
        own = [h for h in found if h.method == method]
        end = UNDETERMINED if method in undetermined else _at_end(own[-1], alone)
        axes.set_title(f"{method}: {end}", loc="left", fontsize=10, color=INK["ink"])
        _panel(axes, own, _floor_of(comparison, method), last)
        if place + wide >= len(methods):
            axes.set_xlabel("time [s]", color=INK["ink"])
            axes.tick_params(labelbottom=True)
    s = comparison.settings
    figure.suptitle(
        f"{s.procedure.entry.title}: {s.imu.title}, seed {s.seed}\n"
        f"heading error [deg], orange outside the band of 3 sigma{' of noise only' * alone}; "
        "dashed: white-noise floor",
        color=INK["ink"],
        fontsize=12,
    )
    buffer = BytesIO()
    figure.savefig(buffer, format="png", facecolor=INK["paper"], metadata={"Software": None})
    return buffer.getvalue()


def _floor_of(comparison: Comparison, method: str) -> float:
    found = [t.floor_heading for t in comparison.tallies if t.method == method]
    return found[0] / DEG if found else float("nan")


def _at_end(h: History, noise_only: bool) -> str:
    return f"{number(h.error[-1] / DEG)} {sigma_text(h.sigma[-1] / DEG, noise_only)} at the end"


def _panel(axes: Axes, own: Sequence[History], floor: float, last: float) -> None:
    axes.set_facecolor(INK["paper"])
    axes.grid(True, color=INK["grid"], linewidth=0.8)
    axes.tick_params(colors=INK["ink"], labelsize=8)
    for spine in axes.spines.values():
        spine.set_color(INK["grid"])
    axes.axhline(0.0, color=INK["ink"], linewidth=0.6)
    for h in own:
        band = 3 * h.sigma / DEG
        axes.fill_between(h.t, -band, band, color=LINE, alpha=0.18, linewidth=0)
        axes.plot(h.t, h.error / DEG, color=LINE, linewidth=1.3)
        out = np.abs(h.error) > 3 * h.sigma
        axes.plot(h.t[out], h.error[out] / DEG, ".", color=OUTSIDE, markersize=3)
    if isfinite(floor):
        for sign in (-1, 1):
            axes.axhline(sign * floor, color=INK["floor"], linewidth=0.9, linestyle=(0, (5, 3)))
    axes.set_xlim(0.0, last)
    half = _half_height(own)
    axes.set_ylim(-half, half)


def _half_height(own: Sequence[History]) -> float:
    """Room for the bands and errors once the first part of each stretch is over, 180 at most."""
    worst = [
        np.maximum(3 * h.sigma, np.abs(h.error))[len(h.t) // 4 :].max() for h in own if len(h.t)
    ]
    return min(1.15 * float(np.max(worst)) / DEG + 1e-12, 180.0) if worst else 180.0
