"""Vector matching to look at: position and attitude error over time, and when each corrected.

matplotlib is imported where it is used: it takes a second to start.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from io import BytesIO
from typing import TYPE_CHECKING

import numpy as np

from alignment.against_truth import rotation_error
from alignment.arrays import Array
from alignment.estimate import determined
from alignment.methods.vectors import Fixes, Matching
from alignment.units import DEG
from stand.evaluation.milestones import LIMITS, Doubt, Point, doubts, needed, points
from stand.imu import unstated
from stand.imu.priors import noise_alone, only
from stand.report.document import UNDETERMINED
from stand.report.page import INKS
from stand.report.tables import TableData
from stand.vehicle.path import Path

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from stand.evaluation.drive_result import DriveResult

# Okabe and Ito's colours, told apart by colour-blind eyes.
COLOURS = {
    "light": {"printed": "#D55E00", "observing": "#0072B2", "kalman": "#009E73"},
    "dark": {"printed": "#E69F00", "observing": "#56B4E9", "kalman": "#2BC69A"},
}
NAMES = {
    "printed": "as printed (Cramer, dJ/√3)",
    "observing": "observing form (SVD)",
    "kalman": "Kalman filter",
}
_OUTAGE = 1.5  # usual intervals between fixes: a longer one is an outage


@dataclass(frozen=True, slots=True, eq=False)
class Errors:
    """One solution against the true path, (k,): place [m], attitude and its sigma [rad].

    NaN of an attitude that is not determined.
    """

    t: Array
    place: Array
    attitude: Array
    sigma: Array


def errors(matching: Matching, path: Path) -> Errors:
    """Distance from the true place, whole turn from the true attitude, and its predicted sigma."""
    motion = path.at(matching.t)
    sigma = np.sqrt(np.trace(matching.covariance, axis1=1, axis2=2))
    attitude = np.linalg.norm(rotation_error(matching.C_nb, motion.C_nb), axis=1)
    return Errors(
        matching.t,
        np.linalg.norm(matching.position - motion.r_e, axis=1),
        np.where(determined(sigma), attitude, np.nan),
        sigma,
    )


def picture(
    title: str,
    matchings: Mapping[str, Matching],
    fixes: Fixes,
    path: Path,
    theme: str = "light",
    *,
    noise_only: bool = False,
) -> bytes:
    """The errors of each solution over time as a PNG.

    Parameters
    ----------
    title : str
    matchings : mapping
        By the solutions' names, as `alignment.methods.vectors.SOLUTIONS` has them.
    fixes : Fixes
        What they were given: their errors stand behind the place's, their gaps are shaded.
    path : Path
        The truth.
    theme : 'light' or 'dark'
    noise_only : bool
        Whether no sheet states more than noise of a sensor.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    ink = INKS[theme]
    figure = Figure(figsize=(12, 9), dpi=120, facecolor=ink["paper"], layout="constrained")
    FigureCanvasAgg(figure)
    place, attitude, moments = figure.subplots(
        3, 1, sharex=True, gridspec_kw={"height_ratios": [4, 5, 1.6]}
    )
    fix_errors = np.linalg.norm(fixes.position - path.at(fixes.t).r_e, axis=1)
    place.plot(
        fixes.t, fix_errors, linestyle="", marker=".", markersize=4, color=ink["sheet"], alpha=0.6,
        label="satellite fixes",
    )  # fmt: skip
    found = {name: errors(m, path) for name, m in matchings.items()}
    for name, error in found.items():
        colour = COLOURS[theme][name]
        place.plot(error.t, error.place, color=colour, linewidth=1.6, label=NAMES[name])
        attitude.plot(error.t, error.attitude / DEG, color=colour, linewidth=1.6)
        attitude.plot(error.t, error.sigma / DEG, color=colour, linewidth=1, linestyle=(0, (4, 3)))
    _log(place, "position error [m]", [*(e.place for e in found.values()), fix_errors], ink)
    shown = [x / DEG for e in found.values() for x in (e.attitude, e.sigma)]
    told = f"attitude error [deg]; dashed: predicted sigma{only(noise_only)}"
    _log(attitude, told, shown, ink)
    _moments(moments, matchings, theme)
    for axes in (place, attitude, moments):
        _outages(axes, fixes.t, ink)
    moments.set_xlim(matchings[next(iter(matchings))].t[[0, -1]])
    moments.set_xlabel("time [s]", color=ink["ink"])
    _legend(figure, place, ink)
    figure.suptitle(title, color=ink["ink"], fontsize=13)
    buffer = BytesIO()
    figure.savefig(buffer, format="png", facecolor=ink["paper"], metadata={"Software": None})
    return buffer.getvalue()


def _frame(axes: Axes, title: str, ink: dict[str, str]) -> None:
    axes.set_facecolor(ink["paper"])
    axes.set_title(title, loc="left", fontsize=11, color=ink["ink"])
    axes.grid(True, which="major", color=ink["grid"], linewidth=0.8)
    axes.tick_params(which="both", colors=ink["ink"])
    for spine in axes.spines.values():
        spine.set_color(ink["grid"])


def _log(axes: Axes, title: str, curves: list[Array], ink: dict[str, str]) -> None:
    """A logarithmic panel whose span is not set by the moments at which an error crosses zero."""
    _frame(axes, title, ink)
    axes.set_yscale("log")
    axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
    values = np.concatenate(curves)
    values = values[values > 0]
    if len(values):
        low, high = np.quantile(values, [0.01, 1.0])
        axes.set_ylim(low / 1.5, high * 1.5)


def _moments(axes: Axes, matchings: Mapping[str, Matching], theme: str) -> None:
    """A row of marks per solution: full where a fix corrected the attitude, a dot where not."""
    ink, colours = INKS[theme], COLOURS[theme]
    _frame(axes, "moments of correction (dots: a fix that did not correct)", ink)
    for row, (name, matching) in enumerate(matchings.items()):
        given = matching.corrected
        idle = matching.at_fix & ~given
        level = np.full(len(given), -float(row))
        axes.plot(
            matching.t[given], level[given], "|", color=colours[name], markersize=11,
            markeredgewidth=1.6,
        )  # fmt: skip
        axes.plot(matching.t[idle], level[idle], ".", color=ink["sheet"], markersize=2.5)
    axes.set_yticks([-row for row in range(len(matchings))], list(matchings))
    axes.set_ylim(-len(matchings) + 0.4, 0.6)
    axes.grid(False, axis="y")


def _outages(axes: Axes, t: Array, ink: dict[str, str]) -> None:
    usual = float(np.median(np.diff(t)))
    for k in np.flatnonzero(np.diff(t) > _OUTAGE * usual):
        axes.axvspan(t[k], t[k + 1], color=ink["grid"], alpha=0.5, linewidth=0, zorder=0)


def _legend(figure: Figure, axes: Axes, ink: dict[str, str]) -> None:
    handles, labels = axes.get_legend_handles_labels()
    legend = figure.legend(
        handles, labels, loc="outside lower center", ncols=len(labels), frameon=False, fontsize=10
    )
    for text in legend.get_texts():
        text.set_color(ink["ink"])


def table(result: DriveResult) -> TableData:
    """Error and sigma of every solution by the number of fixes, and how many each needed."""
    rows, reached, alone = [], [], bool(noise_alone(result.settings.imu))
    for name, curve in result.curves.items():
        shown = points(curve)
        reached = [f"{p.fixes} fixes" for p in shown]
        place = errors(result.matchings[name], result.settings.drive.path).place[-1]
        counts = (needed(curve, limit) for limit in LIMITS)
        rows.append(
            (
                name,
                *(_cell(one, alone) for one in shown),
                *(" / ".join("never" if n is None else str(n) for n in both) for both in counts),
                f"{place:.3g}",
            )
        )
    limits = [f"below {limit / DEG:g} deg" for limit in LIMITS]
    columns = ("solution", *reached, *limits, "place m")
    return TableData(
        "attitude error ± predicted sigma [deg], the whole turn, after so many fixes",
        columns,
        tuple(rows),
        notes=(
            "start: still the programmed attitude; ~: carried by the gyros since the last fix that "
            "corrected.",
            "below: fixes needed to come and stay there, by the error of this run / by sigma; "
            "place: error at the last fix.",
            "sigma holds noise, the start, and all errors of the unit that its sheet states.",
            *(line for name in result.matchings for line in _lines(name, result)),
            *unstated(result.settings.imu),
            *(f"{name}: {reason}" for name, reason in result.refusals.items()),
        ),
        optional=tuple(c for c in ("10 fixes", "30 fixes", "place m", *limits) if c in columns),
    )


def _cell(point: Point, noise_only: bool) -> str:
    if point.undetermined:
        return UNDETERMINED
    if point.state == "start":
        return f"{point.error / DEG:.3g} start"
    carried = " ~" if point.state == "carried" else ""
    return f"{point.error / DEG:.3g} ± {point.sigma / DEG:.2g}{only(noise_only)}{carried}"


def _lines(name: str, result: DriveResult) -> list[str]:
    open_ones = [
        f"{name}: attitude {UNDETERMINED} after {p.fixes} fixes: {p.undetermined}"
        for p in points(result.curves[name])
        if p.undetermined
    ]
    return [*open_ones, *(f"{name}: {_line(d)}" for d in doubts(result.matchings[name]))]


def _line(d: Doubt) -> str:
    if d.count == 1:
        return f"fix {d.first}: {d.text}"
    return f"{d.count} fixes from {d.first} to {d.last}, at the last: {d.text}"
