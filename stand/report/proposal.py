"""A proposed test to look at: tables for a terminal, a page, and time against accuracy as a PNG."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from stand.folder import Content, refuse_files, write_files
from stand.imu import unstated
from stand.imu.priors import only
from stand.proposal.result import Proposal, proposal_json
from stand.proposal.trade_off import FACTORS, TradeOff
from stand.report.document import UNDETERMINED
from stand.report.judged import Judged
from stand.report.page import HUES, INK, PAPER, SOFT, frame, logarithmic, render, span_text
from stand.report.published_pictures import Picture
from stand.report.tables import TableData

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PAGE, JSON, PROCEDURE, PNG = "proposal.html", "proposal.json", "proposal.toml", "trade-off.png"
MARKS = ("o", "s", "D", "^", "v", "P", "X")


def headline(result: Proposal) -> str:
    """What it comes to, in one line."""
    for_whom = f"{result.settings.imu.title} on {result.settings.table.title}"
    if not result.feasible:
        return f"NOT REACHED: {result.title}; {for_whom}: {result.reason}"
    return (
        f"{result.title}: {span_text(result.total)} for {for_whom}; no test of "
        f"{result.considered} candidates can be below {span_text(result.bound)} "
        "(noise alone, moves for nothing)"
    )


def tables(result: Proposal, curve: TradeOff | None = None) -> list[TableData]:
    """What is reached, what the test is made of, time against accuracy; without the empty ones."""
    every = [_reached(result), _stations(result)]
    if curve is not None:
        every.append(curve_table(curve, any(q.noise_only for q in result.quantities)))
    return [table for table in every if table.rows]


def _verdict(result: Proposal) -> Judged:
    word = span_text(result.total) if result.feasible else "NOT REACHED"
    return Judged("good" if result.feasible else "bad", word, (headline(result),))


def _reached(result: Proposal) -> TableData:
    rows = tuple(
        (
            q.quantity,
            f"{q.required:g}",
            UNDETERMINED if q.predicted is None else f"{q.predicted:.3g}{only(q.noise_only)}",
            f"{100 * q.ratio:.0f} %" if np.isfinite(q.ratio) else "",
            q.unit,
            f"{q.limited_by} ({100 * q.share:.0f} %)" if q.limited_by else "",
            "" if q.true_table is None else f"{q.true_table:.3g}{only(q.noise_only)}",
        )
        for q in result.quantities
    )
    columns = ("quantity", "required", "sigma", "used", "unit", "limited by", "true table")
    notes = (
        "used: coverage times sigma, guard band included, of what is required; true table: sigma "
        "on a table and seat without errors",
        *unstated(result.settings.imu),
    )
    return TableData("What it reaches", columns, rows, notes=notes)


def _stations(result: Proposal) -> TableData:
    rows = tuple((s.label, f"{s.seconds:g}", s.purpose) for s in result.stations)
    return TableData("What it is made of", ("station", "data s", "what for"), rows)


def curve_table(curve: TradeOff, noise_only: bool = False) -> TableData:
    """Time against accuracy."""
    alone = only(noise_only)
    rows = [(p.name, span_text(p.total), f"{p.ratio:.3g}{alone}", "") for p in curve.curve]
    for own in curve.procedures:
        ratio = f"{own.point.ratio:.3g}{alone}" if np.isfinite(own.point.ratio) else UNDETERMINED
        less = "" if own.shortened is None else f"{span_text(own.shortened)} would do in this shape"
        rows.append((own.point.name, span_text(own.point.total), ratio, less))
    columns = ("test", "takes", "uncertainty / required", "shortened")
    return TableData("Time against accuracy", columns, tuple(rows))


def picture(curve: TradeOff, noise_only: bool = False) -> Picture:
    """Best sigma over time, with the procedures one has as points."""

    def draw(figure: Figure) -> None:
        from matplotlib.ticker import FixedLocator, LogLocator

        axes = figure.subplots()
        frame(axes)
        axes.set(xscale="log", yscale="log", xlabel="whole test [s]",
                 ylabel=f"expanded uncertainty{only(noise_only)} / required")  # fmt: skip
        logarithmic(axes.xaxis)
        logarithmic(axes.yaxis)
        axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axes.yaxis.set_major_locator(FixedLocator(list(FACTORS)))
        axes.plot(
            [p.total for p in curve.curve],
            [p.ratio for p in curve.curve],
            color=HUES[0],
            marker="o",
            label="shortest found",
        )
        axes.axhline(1.0, color=SOFT, linestyle="--", linewidth=1)
        axes.annotate("required", (0.995, 1.0), xycoords=("axes fraction", "data"), color=SOFT,
                      ha="right", va="bottom", fontsize=9)  # fmt: skip
        for k, own in enumerate(curve.procedures):
            if not np.isfinite(own.point.ratio):
                continue
            hue, mark = HUES[1 + k % (len(HUES) - 1)], MARKS[(1 + k) % len(MARKS)]
            at = (own.point.total, own.point.ratio)
            axes.plot(*at, color=hue, marker=mark, linestyle="", label=own.point.name)
            if own.shortened is not None:
                axes.annotate("", (own.shortened, 1.0), at,
                              arrowprops={"arrowstyle": "->", "color": hue})  # fmt: skip
                axes.plot([], [], color=hue, label="in the same shape, just as required")
        axes.legend(frameon=False, fontsize=9, labelcolor=INK, facecolor=PAPER)

    return Picture(
        name="trade-off",
        title="Time against accuracy",
        size=(10, 5),
        alt="The shortest test found, and procedures one has, by time and by accuracy.",
        caption="Line: the shortest test found for laxer and stricter requirements. Arrows: the "
        "same procedure shortened until it just keeps the requirement.",
        draw=draw,
    )


def files_of(folder: Path, *, with_curve: bool) -> list[Path]:
    """What a report is made of."""
    names = [PAGE, JSON, PROCEDURE, *([PNG] if with_curve else [])]
    return [folder / name for name in names]


def refuse_report(folder: Path, *, with_curve: bool, force: bool = False) -> None:
    """`StandError` where a report is there already, unless `force`."""
    refuse_files(files_of(folder, with_curve=with_curve), "--report", force=force)


def write_report(
    result: Proposal, folder: Path, curve: TradeOff | None = None, *, force: bool = False
) -> list[Path]:
    """Write the page, its JSON, the procedure, and the picture into a folder.

    Raises
    ------
    StandError
        A report is there (and not `force`), or the folder cannot be written.
    """
    refuse_report(folder, with_curve=curve is not None, force=force)
    machine = json.dumps(to_json(result, curve), indent=1, allow_nan=False) + "\n"
    contents: dict[Path, Content] = {folder / PAGE: page(result, curve), folder / JSON: machine}
    if result.text:
        contents[folder / PROCEDURE] = result.text
    if curve is not None:
        alone = any(q.noise_only for q in result.quantities)
        contents[folder / PNG] = picture(curve, alone).png()
    return write_files(contents)


def to_json(result: Proposal, curve: TradeOff | None = None) -> dict[str, object]:
    """As `--json` prints it."""
    found = proposal_json(result)
    if curve is not None:
        found["trade_off"] = {
            "curve": [{"total_s": p.total, "ratio": p.ratio} for p in curve.curve],
            "procedures": [
                {
                    "title": own.point.name,
                    "method": own.method,
                    "total_s": own.point.total,
                    "ratio": own.point.ratio if np.isfinite(own.point.ratio) else None,
                    "shortened_s": own.shortened,
                }
                for own in curve.procedures
            ],
        }
    return found


def page(result: Proposal, curve: TradeOff | None = None) -> str:
    """The page: HTML that needs nothing else."""
    alone = any(q.noise_only for q in result.quantities)
    shown = None if curve is None else picture(curve, alone).drawing()
    content = {
        "title": result.title,
        "verdict": _verdict(result),
        "tables": tables(result, curve),
        "figure_shown": shown,
        "text": result.text,
    }
    return render("proposal.html.j2", content)
