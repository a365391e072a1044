"""Pictures of the audit of the papers, each drawn once for the page and as a PNG of its own.

matplotlib is imported where it is used: it takes a second to start.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from io import BytesIO
from typing import TYPE_CHECKING, Literal

import numpy as np

from alignment.information.half_turn import Posture, heading_limit
from alignment.units import ARC_MINUTE, DEG, DEG_PER_HOUR
from stand.evaluation.published import fixes, gyrocompassing, rocking, six_position
from stand.report.page import HUES, INK, LINE, PAPER, SOFT, Drawing, drawing, frame

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

AXES = ("X1", "Y1", "Z1")
ANGLES = ("roll", "yaw", "pitch")
MOST_POINTS = 1500  # of a curve: more cannot be told apart on a page
DPI = 120


@dataclass(frozen=True, slots=True)
class Picture:
    """A picture: its name (of the PNG too), title, what it shows in words, and how it is drawn."""

    name: str
    title: str
    size: tuple[float, float]
    alt: str
    caption: str
    draw: Callable[[Figure], None]

    def drawing(self) -> Drawing:
        """For the page."""
        return drawing(self.name.replace("-", ""), self.size, self.alt, self.draw, self.caption)

    def png(self) -> bytes:
        """As a file."""
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        figure = Figure(figsize=self.size, dpi=DPI, facecolor=PAPER, layout="constrained")
        FigureCanvasAgg(figure)
        figure.suptitle(self.title, color=INK, fontsize=12)
        self.draw(figure)
        buffer = BytesIO()
        figure.savefig(buffer, format="png", facecolor=PAPER, metadata={"Software": None})
        return buffer.getvalue()


def pictures(papers: set[str]) -> list[Picture]:
    """Those of some papers, in their order."""
    made: list[Picture] = []
    if "S0" in papers:
        signals, tracks = six_position.figures()
        made += [_signals(signals), _tracks(tracks)]
    if "S1" in papers:
        made.append(_rocking())
    if "S2" in papers:
        made.append(_flight(fixes.flight()))
    if "S4" in papers:
        made.append(_heading())
    return made


def _legend(axes: Axes, where: Literal["upper left", "upper right", "lower right"]) -> None:
    for text in axes.legend(frameon=False, fontsize=9, loc=where).get_texts():
        text.set_color(INK)


# --- [S0] ----------------------------------------------------------------------------------------


def _signals(found: six_position.Signals) -> Picture:
    step = max(1, len(found.t) // MOST_POINTS)

    def draw(figure: Figure) -> None:
        panels = figure.subplots(3, 2, sharex=True)
        for k, axis in enumerate(AXES):
            for column, values, unit in (
                (0, found.f_b[:, k], "m/s²"),
                (1, found.w_ib_b[:, k] / DEG_PER_HOUR, "deg/h"),
            ):
                axes = panels[k, column]
                axes.plot(found.t[::step], values[::step], color=HUES[0], linewidth=0.5)
                axes.axhline(values.mean(), color=HUES[1], linewidth=1.2)
                frame(axes, f"{axis} [{unit}]: mean {values.mean():.4g}")
        for axes in panels[-1]:
            axes.set_xlabel("time [s]")

    means = ", ".join(f"{a} {v:.3f}" for a, v in zip(AXES, found.f_b.mean(axis=0), strict=True))
    return Picture(
        "s0-signals",
        "[S0] figures 1-6: accelerations and rates, X1 along gravity",
        (10.0, 6.0),
        f"Accelerations and rates of three axes over 300 s, X1 down: mean accelerations {means} "
        "metres per second squared",
        caption=(
            "[S0] figures 1-6: what the six channels read at rest, X1 along gravity; "
            "orange: the mean."
        ),
        draw=draw,
    )


def _tracks(found: list[six_position.AngleTrack]) -> Picture:
    names = dict(zip(six_position.POSITIONS.values(), six_position.POSITIONS, strict=True))
    labels = list(dict.fromkeys(track.label for track in found))

    def draw(figure: Figure) -> None:
        panels = figure.subplots(len(labels), 3, sharex=True, sharey=True)
        for track in found:
            ours = track.method == six_position.SIX_POSITION
            row, step = labels.index(track.label), max(1, len(track.t) // MOST_POINTS)
            for k in range(3):
                panels[row, k].plot(
                    track.t[::step], track.errors[::step, k], color=HUES[0 if ours else 1],
                    linewidth=1.3, linestyle="-" if ours else (0, (4, 2)),
                    label="method" if ours else "Runge-Kutta",
                )  # fmt: skip
        for row, label in enumerate(labels):
            for k, angle in enumerate(ANGLES):
                axes = panels[row, k]
                axes.set_yscale("symlog", linthresh=0.01)
                axes.set_ylim(-90, 90)
                axes.set_yticks([-10, -0.1, 0, 0.1, 10], ["−10", "−0.1", "0", "0.1", "10"])
                axes.set_yticks([], minor=True)
                axes.axvline(10, color=SOFT, linewidth=0.8, linestyle=":")
                frame(axes, f"{names[label]}: {angle} [deg]")
        for axes in panels[-1]:
            axes.set_xlabel("time [s]")
        handles, words = panels[0, 0].get_legend_handles_labels()
        legend = figure.legend(
            handles, words, loc="outside lower center", ncols=2, frameon=False, fontsize=9
        )
        for text in legend.get_texts():
            text.set_color(INK)

    ends = {
        m: max(np.abs(t.errors[-1]).max() for t in found if t.method == m)
        for m in (six_position.SIX_POSITION, six_position.RK4)
    }
    method, runge = ends[six_position.SIX_POSITION], ends[six_position.RK4]
    return Picture(
        "s0-angles",
        "[S0] figures 7-24: errors of roll, yaw, pitch, one run",
        (10.0, 11.0),
        f"Errors of roll, yaw and pitch in six positions over 300 s: the method's end within "
        f"{method:.2g} degrees, Runge-Kutta's within {runge:.2g}",
        caption=(
            "[S0] figures 7-24: line, the method; broken, Runge-Kutta; errors against nominal, "
            "linear below 0.01 deg. Before the dotted line the method's angles are of the samples "
            "that give its offset, and run into zero; after it they are from fresh ones."
        ),
        draw=draw,
    )


# --- [S1] ----------------------------------------------------------------------------------------

RECORDS = (60.0, 300.0, 3600.0)  # s


def _rocking() -> Picture:
    f = np.geomspace(1e-4, 5.0, 400)
    law = rocking.REQUIRED / np.tan(rocking.LATITUDE) / DEG
    curves = {T: rocking.admissible(f, T) / DEG for T in RECORDS}

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        axes.axhline(law, color=INK, linewidth=1.4, linestyle=(0, (5, 3)), label="the law, (15)")
        for (T, curve), hue, dash in zip(
            curves.items(), HUES, ("-", (0, (6, 2)), (0, (2, 1.5))), strict=False
        ):
            axes.plot(
                f, curve, color=hue, linewidth=1.6, linestyle=dash, label=f"real gyros, {T:g} s"
            )
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.set_ylim(1e-4, 1)
        axes.set_xlim(f[0], f[-1])
        frame(axes)
        axes.set_xlabel("frequency of rocking [Hz]")
        axes.set_ylabel("admissible rocking [deg rms]")
        _legend(axes, "upper right")

    return Picture(
        "s1-rocking",
        f"[S1] admissible rocking for {rocking.REQUIRED / DEG:g} deg of azimuth, latitude 48.5 deg",
        (10.0, 4.6),
        f"Admissible rocking against its frequency for 0.1 degrees: the law allows {law:.3f} "
        "degrees at any; real gyros 0.001 over 300 seconds above a thirtieth of a hertz",
        caption=(
            "[S1] leaves it open: what rocking (damping 0.1) 0.1 deg of azimuth admits by "
            "two gyros. Broken: the paper's law, which leaves the rocking's own rate out. Lines: "
            "real gyros, whose mean keeps what the base turned from start to end."
        ),
        draw=draw,
    )


# --- [S2] ----------------------------------------------------------------------------------------

_CURVES = {
    fixes.RESET: ("place and velocity corrected alone", HUES[0], "-"),
    "printed": ("matrix corrected as printed", HUES[1], (0, (6, 2))),
    "observing": ("observing form", HUES[6], (0, (2, 1.5))),
    "kalman": ("Kalman filter", HUES[2], (0, (6, 2, 1, 2))),
}


def _flight(found: fixes.Flight) -> Picture:
    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        axes.plot(found.t, found.closed, color=INK, linewidth=2.4, alpha=0.35, label="closed form")
        for name, (words, hue, dash) in _CURVES.items():
            axes.plot(found.t, found.by[name], color=hue, linewidth=1.5, linestyle=dash,
                      label=words)  # fmt: skip
        for k, time in enumerate(found.corrected, start=1):
            axes.axvline(time, color=SOFT, linewidth=0.8, linestyle=":")
            axes.text(
                time, 0.98, f" t{k}", transform=axes.get_xaxis_transform(), va="top", color=SOFT
            )
        axes.set_yscale("log")
        axes.set_xlim(found.t[0], found.t[-1] * 1.03)
        axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
        frame(axes)
        axes.set_xlabel("time [s]")
        axes.set_ylabel("position error per axis [m]")
        _legend(axes, "upper left")

    at = np.searchsorted(found.t, found.corrected) - 1
    told = ", ".join(f"{v:.0f}" for v in found.by[fixes.RESET][at])
    wrong = ", ".join(f"{v:.0f}" for v in found.by["printed"][at])
    return Picture(
        "s2-position",
        "[S2] figure 1: position error with corrections at t1..t3, high dynamics",
        (10.0, 4.6),
        f"Position error over time: before the three corrections {told} metres where place and "
        f"velocity are corrected, {wrong} where the matrix is, as printed",
        caption=(
            "[S2] figure 1 on a generic path of high dynamics: a = 0.01 m/s², r0 = 5 m, "
            f"v0 = 0.05 m/s; root mean square of {fixes.FLIGHTS} flights, attitude right at "
            "the start."
        ),
        draw=draw,
    )


# --- [S4] ----------------------------------------------------------------------------------------


def _heading() -> Picture:
    placements = np.geomspace(0.1, 300, 61) * ARC_MINUTE
    drifts = np.geomspace(1e-4, 20, 81) * DEG_PER_HOUR
    alone, turned = gyrocompassing.worst_heading(drifts, placements)
    best = np.fmin(alone[:, None], turned[None, :]) / ARC_MINUTE
    tilt = gyrocompassing.TILT
    posture = Posture(tilt, tilt, 90 * DEG, gyrocompassing.LATITUDE)
    predicted = np.array([heading_limit(posture, d) for d in drifts])
    x, y = placements / ARC_MINUTE, drifts / DEG_PER_HOUR
    known = np.isfinite(alone)
    crossing = np.exp(np.interp(np.log(turned), np.log(alone[known]), np.log(y[known])))

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        axes.fill_between(x, y[0], crossing, color=HUES[4], alpha=0.25, linewidth=0)
        axes.fill_between(x, crossing, y[-1], color=HUES[5], alpha=0.25, linewidth=0)
        lines = axes.contour(
            x, y, best, levels=[0.1, 0.3, 1, 3, 10, 30, 100, 300], colors=[SOFT], linewidths=0.9
        )
        axes.clabel(lines, fmt=lambda v: f"{v:g}'", fontsize=8, colors=[INK])
        axes.plot(predicted / ARC_MINUTE, y, color=INK, linewidth=1.6, linestyle=(0, (5, 3)),
                  label="crossing by (16)")  # fmt: skip
        axes.plot(x, crossing, color=HUES[0], linewidth=1.6, label="crossing, exact")
        axes.text(0.16, 0.75, "half a turn pays", transform=axes.transAxes, color=INK)
        axes.text(0.72, 0.27, "no turn is better", transform=axes.transAxes, color=INK)
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.set_xlim(x[0], x[-1])
        axes.set_ylim(y[0], y[-1])
        frame(axes)
        axes.grid(True, color=LINE, linewidth=0.5)
        axes.set_xlabel("placement error of both positions [arc minutes]")
        axes.set_ylabel("bias of X1's gyro [deg/h]")
        _legend(axes, "lower right")

    at = float(np.interp(1.0, y, predicted / ARC_MINUTE))
    return Picture(
        "s4-heading",
        "[S4] worst-case heading by one gyro, with and without half a turn; tilts 5 deg",
        (10.0, 5.6),
        "Worst-case heading against placement error and gyro bias: half a turn pays above a line "
        f"that passes {at:.0f} arc minutes at 1 degree per hour",
        caption=(
            "[S4] lines: worst-case heading of the better of both, X1 west, tilts 5 deg, latitude "
            "50 deg, gyro K = 0.2 %. Blue: half a turn pays. Broken: where (16) puts the crossing; "
            "it leaves out the scale error (no turn for less than some 0.002 deg/h) and what the "
            "placement does to the levelling."
        ),
        draw=draw,
    )
