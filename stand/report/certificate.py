"""The certificate of a calibration: one page that loads nothing, for the screen and for paper."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from stand.calibration.file import CalibrationRecord, calibration_text
from stand.calibration.limits import (
    COVERAGE,
    Judgement,
    Limits,
    Verdict,
    judged,
    overall,
    sheet_limits,
)
from stand.calibration.units import AXES, unit_of
from stand.folder import refuse_files, write_files
from stand.imu.priors import only
from stand.recording.hashes import sha256_of_text
from stand.report.calibration import (
    BASES,
    budget_table,
    derived_table,
    headline,
    name_of,
    named,
    nuisance_table,
    number,
    prior,
    size,
)
from stand.report.page import HUES, INK, SOFT, Drawing, drawing, frame, logarithmic, picture, render
from stand.report.provenance import provenance
from stand.report.tables import TableData

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PAGE, FILE, PICTURE = "certificate.html", "calibration.json", "before-after.png"
WIDTH = 10.0  # inches: the page's
MOST_PARTS = 8  # of one drawing
_Row = tuple[str, float, float, str]  # label, value, sigma, full name
_Group = tuple[str, str, list[_Row]]  # title, unit, rows
_GRADES = {Verdict.PASS: "good", Verdict.FAIL: "bad", Verdict.INDETERMINATE: "open"}
_NO_DRIFT = ("", " Of noise only where no sheet states more: no drift is in it.")
_SENSORS = (("gyro", "Gyros"), ("accel", "Accelerometers"))


def write_certificate(
    record: CalibrationRecord,
    folder: Path,
    limits: Limits | None = None,
    *,
    force: bool = False,
) -> list[Path]:
    """Write the page, its picture and `calibration.json` into a folder, all or none.

    Parameters
    ----------
    record : CalibrationRecord
    folder : Path
    limits : Limits, optional
        Else what the unit's data sheet states, where the record has one.
    force : bool
        Replace what is there.

    Raises
    ------
    StandError
        One of them is there (and not `force`), or cannot be written.
    """
    contents: dict[Path, bytes | str] = {
        folder / PAGE: page(record, limits),
        folder / FILE: calibration_text(record),
    }
    groups, limits = _groups(record), limits or sheet_limits(record)
    if groups:
        draw = partial(_before, groups, judged(record, limits), limits.coverage)
        contents[folder / PICTURE] = picture(_size(groups), draw)
    refuse_files(contents, "--report", force=force)
    return write_files(contents)


def page(record: CalibrationRecord, limits: Limits | None = None) -> str:
    """The certificate: HTML that needs nothing else."""
    limits = limits or sheet_limits(record)
    judgements = judged(record, limits)
    c = record.calibration
    content = {
        "name": name_of(record),
        "subtitle": headline(record),
        "facts": _facts(record, limits.coverage),
        "verdict": _verdict(judgements),
        "notes": c.notes,
        "null_space": c.null_space,
        "left_out": [f"{one.stretch}: {one.reason}" for one in c.left_out],
        "results": [
            table
            for sensor, title in _SENSORS
            if (table := result_table(record, sensor, title, limits.coverage)).rows
        ],
        "derived": derived_table(record),
        "limits": limits_table(judgements),
        "before_after": before_and_after(record, judgements, limits.coverage),
        "budget": budget_table(record),
        "nuisance": nuisance_table(record),
        "residuals": residual_figure(record),
        "coverage": f"{limits.coverage:g}",
        "enlarged": f"{c.enlarged:.3g}" if c.enlarged > 1 else "",
        "provenance": _provenance(record),
    }
    return render("certificate.html.j2", content)


def _facts(record: CalibrationRecord, coverage: float) -> list[tuple[str, str]]:
    c, source = record.calibration, record.source
    known = [
        ("unit", record.unit.get("title") or record.unit.get("id", "")),
        ("serial number", record.unit.get("serial", "")),
        ("method", source.get("method", "")),
        ("procedure", source.get("procedure", "")),
        ("table", source.get("table", "none" if "hand-held" in source.get("method", "") else "")),
        ("recording", source.get("recording", "")),
        ("axes", record.axes),
    ]
    gravity = f"{number(c.gravity.value, max(c.gravity.sigma, 1e-6))} m/s²"
    return [
        *((name, value) for name, value in known if value),
        ("gravity", f"{gravity} ± {c.gravity.sigma * coverage * 1e5:.2g} mGal"),
        ("chi-square", f"{c.chi_square:.0f} of {c.dof}"),
        *([("temperature of reference", f"{c.reference_temperature:g} °C")] if _warm(c) else []),
    ]


def _warm(c: Any) -> bool:
    return any(key.term.startswith("temperature") for key in c.keys)


def _verdict(judgements: list[Judgement]) -> dict[str, Any] | None:
    worst = overall(judgements)
    if worst is None:
        return None
    wrong = [j for j in judgements if j.verdict is not Verdict.PASS]
    lines = [f"{len(judgements) - len(wrong)} of {len(judgements)} values are within their limits."]
    lines += [
        f"{j.verdict.value}: {j.name} is {number(j.value, j.expanded)} ± {size(j.expanded)} "
        f"{j.unit}{only(j.noise_only)}, limit {j.limit:g}."
        for j in wrong[:MOST_PARTS]
    ]
    if len(wrong) > MOST_PARTS:
        lines.append(f"And {len(wrong) - MOST_PARTS} more.")
    return {"grade": _GRADES[worst], "word": worst.value, "lines": lines}


def result_table(
    record: CalibrationRecord, sensor: str, title: str, coverage: float = COVERAGE
) -> TableData:
    """Values with expanded uncertainty of a triad."""
    rows = []
    for n, p in enumerate(record.calibration.parameters):
        if p.key.sensor != sensor:
            continue
        unit, si = unit_of(p.key)
        expanded = coverage * p.sigma / si
        row = (
            named(p),
            number(p.value / si, p.sigma / si),
            size(expanded) + only(p.key.sensor in record.noise_only),
            unit,
            prior(p.prior_sigma / si),
            BASES[p.basis],
            f"{100 * p.share:.0f} %",
        )
        if record.errors is not None:
            row = (*row, number(record.errors[n] / si, p.sigma / si))
        rows.append(row)
    columns = ("parameter", "value", "expanded", "unit", "sigma before", "told by", "prior's share")
    if record.errors is not None:
        columns = (*columns, "error")
    return TableData(title, columns, tuple(rows))


def limits_table(judgements: Sequence[Judgement]) -> TableData:
    """Every value that has a limit, with its verdict."""
    rows = tuple(
        (
            j.name,
            j.verdict.value,
            number(j.value, j.expanded),
            size(j.expanded) + only(j.noise_only),
            f"{j.limit:g}",
            j.unit,
            j.source,
        )
        for j in judgements
    )
    notes = (
        "PASS: the value and its expanded uncertainty are within the limit; FAIL: both are beyond; "
        "INDETERMINATE: between (ISO 14253-1).",
    )
    columns = ("value", "verdict", "found", "expanded", "limit", "unit", "limit from")
    return TableData("Limits", columns, rows, notes=notes)


# --- pictures ------------------------------------------------------------------------------------


def before_and_after(
    record: CalibrationRecord, judgements: Sequence[Judgement], coverage: float
) -> Drawing | None:
    """What the unit does without correction, and what is left of it with, term by term; None where
    nothing has a sigma."""
    groups = _groups(record)
    if not groups:
        return None
    words = "; ".join(
        f"{row[0]}: {abs(row[1]) + coverage * row[2]:.3g} before, {coverage * row[2]:.2g} after, "
        f"{unit}"
        for _, unit, group in groups
        for row in group
    )
    return drawing(
        "before",
        _size(groups),
        f"Errors before and after correction. {words}",
        partial(_before, groups, judgements, coverage),
        "Before: what uncorrected readings may be off, the size of the value and its expanded "
        "uncertainty. After: the uncertainty alone, which is what corrected ones may be off."
        + _NO_DRIFT[bool(record.noise_only)],
    )


def _size(groups: Sequence[_Group]) -> tuple[float, float]:
    rows = sum(len(rows) for _, _, rows in groups)
    return WIDTH, 0.6 + 0.22 * rows + 0.75 * len(groups)


def _before(
    groups: Sequence[_Group], judgements: Sequence[Judgement], coverage: float, figure: Figure
) -> None:
    limits = {j.name: j.limit for j in judgements}
    heights = [len(rows) + 1.2 for _, _, rows in groups]
    all_axes = figure.subplots(len(groups), 1, height_ratios=heights, squeeze=False)[:, 0]
    for axes, (title, unit, rows) in zip(all_axes, groups, strict=True):
        _dumbbells(axes, rows, coverage, limits)
        frame(axes, f"{title} [{unit}]", grid="x")
    all_axes[0].legend(
        loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3, frameon=False, fontsize=9,
        labelcolor=INK,
    )  # fmt: skip


def _groups(record: CalibrationRecord) -> list[_Group]:
    """Parameters of one triad and term."""
    found: dict[tuple[str, str], _Group] = {}
    for p in record.calibration.parameters:
        key, (unit, si) = p.key, unit_of(p.key)
        title = f"{dict(_SENSORS)[key.sensor]}: {key.term.replace('_', ' ')}"
        group = found.setdefault((key.sensor, key.term), (title, unit, []))
        toward = "" if key.toward is None else f" → {AXES[key.toward]}"
        full = f"{key.sensor} {named(p)}"
        group[2].append((f"{AXES[key.axis]}{toward}", p.value / si, p.sigma / si, full))
    return [group for group in found.values() if any(s > 0 for _, _, s, _ in group[2])]


def _dumbbells(axes: Axes, rows: list[_Row], coverage: float, limits: dict[str, float]) -> None:
    from matplotlib.ticker import LogLocator

    at = np.arange(len(rows))
    # what has no sigma has no place on a logarithmic axis
    after = np.array([max(coverage * s, 1e-12) for _, _, s, _ in rows])
    before = np.array([abs(v) for _, v, _, _ in rows]) + after
    axes.hlines(at, after, before, color=SOFT, linewidth=1.2)
    axes.plot(before, at, "o", color=HUES[1], label="before: value and uncertainty")
    axes.plot(after, at, "s", color=HUES[0], label="after: expanded uncertainty")
    least, most = after.min(), before.max()
    own = [(limits[full], k) for k, (_, _, _, full) in enumerate(rows) if full in limits]
    if own:
        limit, where = zip(*own, strict=True)
        axes.plot(limit, where, "|", color=INK, markersize=13, markeredgewidth=2, label="limit")
        most = max(most, *limit)
    axes.set_xscale("log")
    axes.set_xlim(0.85 * least, 1.15 * max(most, 10 * least))  # no small gain looks a great one
    axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    logarithmic(axes.xaxis)
    axes.set_yticks(at, [label for label, *_ in rows])
    axes.set_ylim(len(rows) - 0.4, -0.6)


def residual_figure(record: CalibrationRecord) -> Drawing | None:
    """What the fit leaves, stretch by stretch, in sigmas; None where nobody kept it."""
    kinds: dict[str, list[tuple[str, tuple[float, ...]]]] = {}
    for one in record.calibration.residuals:
        kinds.setdefault(one.of, []).append((one.stretch, one.sigmas))
    if not kinds:
        return None

    def draw(figure: Figure) -> None:
        all_axes = figure.subplots(len(kinds), 1, squeeze=False)[:, 0]
        for axes, (title, rows) in zip(all_axes, kinds.items(), strict=True):
            _residuals(axes, [values for _, values in rows])
            frame(axes, f"{title} [sigma]", grid="y")

    values = np.concatenate([one.sigmas for one in record.calibration.residuals])
    largest = max(record.calibration.residuals, key=lambda one: float(np.abs(one.sigmas).max()))
    return drawing(
        "residuals",
        (WIDTH, 0.3 + 1.7 * len(kinds)),
        f"Residuals in sigmas: rms {np.sqrt(np.mean(values**2)):.2f}, largest "
        f"{np.abs(values).max():.2f} in {largest.stretch}",
        draw,
        "Each value in its own sigma, by stretch in order of time: 95 of 100 lie within the band.",
    )


def _residuals(axes: Axes, rows: list[tuple[float, ...]]) -> None:
    axes.axhspan(-2, 2, color=HUES[0], alpha=0.12, linewidth=0)
    axes.axhline(0, color=SOFT, linewidth=0.8)
    width = max(map(len, rows))
    for k in range(min(width, len(AXES))):
        own = [(n + 1, row[k]) for n, row in enumerate(rows) if len(row) > k]
        x, y = zip(*own, strict=True)
        axes.plot(x, y, ".", color=HUES[k % 3], markersize=7, label=AXES[k])
    if width == len(AXES):
        axes.legend(
            loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3, frameon=False, fontsize=9,
            labelcolor=INK, borderaxespad=0.2,
        )  # fmt: skip
    reach = max(3.0, 1.1 * max(abs(v) for row in rows for v in row))
    axes.set_ylim(-reach, reach)
    axes.set_xlim(0.3, len(rows) + 0.7)


def _provenance(record: CalibrationRecord) -> Any:
    files = {}
    if record.unit.get("toml"):
        files["imu"] = (record.unit.get("id", "unit"), record.unit["toml"])
    if record.source.get("table_toml"):
        files["table"] = (record.source.get("table", "table"), record.source["table_toml"])
    hashes = dict(record.hashes) | {FILE: sha256_of_text(calibration_text(record))}
    made = provenance(files, hashes, record.versions)
    serial = record.unit.get("serial", "")
    filled = tuple((n, serial if n == "IMU, serial number" else v) for n, v in made.record)
    surroundings = (("Temperature", ""), ("Pressure, humidity", ""))
    return type(made)((*filled[:-2], *surroundings, *filled[-2:]), made.hashes, made.versions,
                      made.files)  # fmt: skip
