"""The verdict of a run as tables: plain data first, then markdown; a terminal has its own view."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from alignment import ESTIMATORS, AttitudeEstimate
from alignment.arrays import Array
from alignment.estimate import ANGLES
from alignment.nominal import SIX_POSITIONS
from alignment.options import of_noise_alone
from alignment.units import ARC_SECOND, DEG, DEG_PER_HOUR, MILLI_G
from stand.evaluation.score import Refusal, Score, Spread, by_method, spreads
from stand.imu import ImuSpec, unstated
from stand.imu.priors import noise_alone, only
from stand.samples import CHANNELS
from stand.simulation.step_record import StepRecord
from stand.table.joints import JOINTS

if TYPE_CHECKING:
    from stand.evaluation.run_result import RunResult
from stand.report.tables import TableData

UNDETERMINED = "not determined"
_BIAS_UNITS = np.repeat([DEG_PER_HOUR, MILLI_G], 3)
ANGLE_NOTE = (
    "Yaw is positive from north to west. Where X1 is within 45 deg of the vertical, angles are "
    "turns by yaw-roll-pitch (y-r-p), elsewhere by yaw-pitch-roll (y-p-r), where heading = -yaw. "
    "sigma (n-1): about the mean of the positions, as published; RMS: about zero, against the "
    "truth and against the table's nominal angles."
)


def method_text(method: str, window: str) -> str:
    """A method and which of its forms: 'six-position, fresh window'."""
    known = ESTIMATORS.get(method)  # a newer version's recording may name others
    words = window if known is None else known.window(window).words
    return f"{method}, {words}" if words else method


def number(value: float) -> str:
    """A signed number of degrees: four decimals, or its power of ten where those show nothing.

    'not determined' of NaN, here and in `angle`.
    """
    if np.isnan(value):
        return UNDETERMINED
    if value == 0:
        return "0"
    if abs(value) < 5e-4:
        return f"{value:+.1e}"
    return f"{value:+.4f}" if abs(value) < 10 else f"{value:+.2f}"


def sigma_text(value: float, noise_only: bool = False) -> str:
    """A standard deviation with one significant digit, tens written out; what it holds."""
    if value > 180:
        told = "± >180"
    elif value < 1e-12:
        told = "± 0"
    else:
        told = f"± {value:.0f}" if value >= 9.5 else f"± {value:.1g}"
    return told + only(noise_only)


def with_sigma(value: float, sigma: float | None, noise_only: bool = False) -> str:
    """A signed number with its standard deviation, to one digit more than that has.

    Where there is no sigma, or so small a one that digits would tell of rounding: as `number`.
    """
    if np.isnan(value):
        return UNDETERMINED
    if sigma is None or not 1e-9 < sigma < 1e9:
        return f"{number(value)} {'' if sigma is None else sigma_text(sigma, noise_only)}".rstrip()
    digit = int(np.floor(np.log10(sigma * (1 + 0.5 / 9.5))))  # of the one that is shown
    return f"{value:+.{max(0, 1 - digit)}f} {sigma_text(sigma, noise_only)}"


def angle(value: float) -> str:
    """An angle with four decimals and no negative zero."""
    if np.isnan(value):
        return UNDETERMINED
    return f"{round(value, 4) + 0.0:.4f}"


def score_tables(
    scores: Sequence[Score],
    imu: ImuSpec | None = None,
    noise_only: Collection[str] | None = None,
    lacking: Sequence[str] | None = None,
) -> list[TableData]:
    """One table per method and window: angles, errors with predicted sigma, deviations.

    The last one's notes say what the data sheet of `imu` leaves out of every sigma. `noise_only`:
    the sensors of which nothing else is known, and sigmas of what they tell say so; None: where
    there is a sheet, as it says. `lacking`: those notes, where they are not the sheet's alone.
    """
    if noise_only is None:
        noise_only = () if imu is None else noise_alone(imu)
    rows = spreads(scores)
    tables = []
    groups = by_method(scores)
    order = list(dict.fromkeys(method for (method, _), _ in groups))
    # what is zero by construction says nothing: last of its method
    groups.sort(key=lambda group: (order.index(group[0][0]), _circular(*group[0])))
    for (method, window), members in groups:
        own = [s for s in rows if (s.method, s.window) == (method, window)]
        if not ESTIMATORS[method].window(window).attitude:
            tables.append(_pair_table(members, noise_only))
        elif all(s.estimate.C_nb is None for s in members):
            tables.append(_refused_table(members))
        else:
            tables.append(_table(members, own, noise_only))
        if any(s.estimate.biases is not None for s in members):
            tables.append(_bias_table(members, noise_only))
    if lacking is None:
        lacking = () if imu is None else unstated(imu)
    if tables and lacking:
        tables[-1] = replace(tables[-1], notes=(*tables[-1].notes, *lacking))
    return tables


def _circular(method: str, window: str) -> bool:
    known = ESTIMATORS.get(method)
    return known is not None and known.window(window).circular


def _table(
    scores: Sequence[Score], deviations: Sequence[Spread], noise_only: Collection[str]
) -> TableData:
    first = scores[0].estimate
    scored = any(s.error is not None for s in scores)
    latitude = any(_latitude(s, noise_only) for s in scores)
    columns = ["position", "turns", "roll", "yaw", "pitch"] + ([] if scored else ["heading"])
    columns += [f"{'error' if scored else 'sigma'} {a}" for a in ("roll", "yaw", "pitch")]
    columns += ["latitude"] if latitude else []
    title = f"{method_text(first.method, first.window)} [deg]: {ESTIMATORS[first.method].title}"
    return TableData(
        title,
        tuple(columns),
        tuple(_row(s, scored, latitude, noise_only) for s in scores if s.estimate.C_nb is not None),
        tuple(_footers(first.method, deviations, len(columns), {s.estimate.label for s in scores})),
        tuple(_notes(scores)),
        ("turns", "roll", "yaw", "pitch")
        if scored
        else ("turns", "sigma roll", "sigma pitch", "sigma yaw"),
    )


def _row(
    scored: Score, with_error: bool, latitude: bool, noise_only: Collection[str]
) -> tuple[str, ...]:
    e = scored.estimate
    assert e.angles is not None
    turns = "singular" if e.singular else "-".join(word[0] for word in e.sequence.value.split("-"))
    cells = [e.label, turns, *(angle(a / DEG) for a in e.angles)]
    if not with_error:
        cells.append(_heading(e))
    for i in range(3):
        sigma = None if e.sigmas is None else e.sigmas[i] / DEG
        alone = of_noise_alone(ANGLES[i], noise_only)
        if with_error and scored.error is not None:
            cells.append(with_sigma(scored.error[i] / DEG, sigma, alone))
        else:
            cells.append("" if sigma is None else sigma_text(sigma, alone))
    return (*cells, _latitude(scored, noise_only)) if latitude else tuple(cells)


def _heading(e: AttitudeEstimate) -> str:
    if "heading" in e.undetermined:
        return UNDETERMINED
    return "none" if e.heading is None else angle(e.heading / DEG)


def _latitude(scored: Score, noise_only: Collection[str]) -> str:
    e = scored.estimate
    if "latitude" in e.undetermined:
        return UNDETERMINED
    if e.latitude is None:
        return ""
    alone = of_noise_alone("latitude", noise_only)
    sigma = "" if e.latitude_sigma is None else sigma_text(e.latitude_sigma / DEG, alone)
    return f"{e.latitude / DEG:.3f} {sigma}".rstrip()


def _refused_table(scores: Sequence[Score]) -> TableData:
    """One form of a method that gives no attitude, and why."""
    first = scores[0].estimate
    rows = tuple((s.estimate.label, "; ".join(s.estimate.flags)) for s in scores)
    title = f"{method_text(first.method, first.window)}: no attitude"
    return TableData(title, ("position", "finding"), rows)


def _pair_table(scores: Sequence[Score], noise_only: Collection[str]) -> TableData:
    first = scores[0].estimate
    rows = tuple((s.estimate.label, _latitude(s, noise_only)) for s in scores)
    title = f"{method_text(first.method, first.window)} [deg]"
    return TableData(title, ("positions", "latitude"), rows, notes=tuple(_notes(scores)))


def _bias_table(scores: Sequence[Score], noise_only: Collection[str]) -> TableData:
    """Biases that a method found: of each fit a row per channel."""
    fits: dict[bytes, tuple[list[str], AttitudeEstimate]] = {}
    for s in scores:
        e = s.estimate
        if e.biases is not None and e.bias_sigmas is not None:
            fits.setdefault(e.biases.tobytes(), ([], e))[0].append(e.label)
    rows = []
    for labels, e in fits.values():
        assert e.biases is not None
        assert e.bias_sigmas is not None
        for k, channel in enumerate(CHANNELS):
            value, sigma = e.biases[k] / _BIAS_UNITS[k], e.bias_sigmas[k] / _BIAS_UNITS[k]
            unit = ("deg/h", "mg")[k // 3]
            bias = with_sigma(value, sigma, of_noise_alone(channel, noise_only))
            # of no spread and no value: nobody looked for it
            cells = (channel, bias if sigma or value else "taken for none", unit)
            rows.append((", ".join(labels) if not k else "", *cells))
    first = scores[0].estimate
    return TableData(
        f"{method_text(first.method, first.window)}: biases",
        ("position", "channel", "bias", "unit"),
        tuple(rows),
        notes=("± with the priors that were stated: one near its own prior was not seen",),
    )


def _footers(
    method: str, deviations: Sequence[Spread], width: int, labels: set[str]
) -> list[tuple[str, ...]]:
    """Deviations; what the paper prints of them beside its own six positions alone."""

    def footer(name: str, values: Array) -> tuple[str, ...]:
        cells = (name, "", "", "", "", *(_deviation(v) for v in values))
        return cells + ("",) * (width - len(cells))

    rows = []
    truth = next((d for d in deviations if d.reference == "truth"), None)
    nominal = next((d for d in deviations if d.reference == "nominal"), None)
    if truth is not None:
        rows.append(footer("sigma (n-1)", truth.sigma / DEG))
        rows.append(footer("RMS", truth.rms / DEG))
    if nominal is not None:
        rows.append(footer("RMS nominal", nominal.rms / DEG))
    published = ESTIMATORS[method].published_deg
    if rows and published is not None and labels == set(SIX_POSITIONS):
        letter = ESTIMATORS[method].source.split()[0]
        rows.append(footer(f"published {letter}", np.array(published)))
    return rows


def _deviation(value: float) -> str:
    return UNDETERMINED if np.isnan(value) else f"{value:.3g}"


def undetermined_texts(e: AttitudeEstimate) -> list[str]:
    """What is not determined and why: a sentence for all that have one reason."""
    names: dict[str, list[str]] = {}
    for name, reason in e.undetermined.items():
        names.setdefault(reason, []).append(name)
    return [f"{', '.join(own)} {UNDETERMINED}: {reason}" for reason, own in names.items()]


def _notes(scores: Sequence[Score]) -> list[str]:
    """The method's own note, then each flag once with the positions it stands for."""
    found: dict[str, list[str]] = {}
    for s in scores:
        for flag in (*undetermined_texts(s.estimate), *s.estimate.flags):
            found.setdefault(flag, []).append(s.estimate.label)
    note = ESTIMATORS[scores[0].estimate.method].note
    return [note] + [
        flag if len(labels) == len(scores) else f"{', '.join(labels)}: {flag}"
        for flag, labels in found.items()
    ]


MOTION_COLUMNS = (
    "step",
    "kind",
    "error max arc s",
    "rms arc s",
    "settled after s",
    "saturated s",
    "torque % of limit",
)
MOTION_NOTES = (
    "error: demanded minus realised joint angle over the step, of the axis where it "
    "was greatest; rms: of the same axis.",
    "saturated, torque: over the whole step, of the axis where they were greatest; a rest counts "
    "once it has settled.",
)


def motion_table(records: Sequence[StepRecord]) -> TableData:
    """How the servo followed, a row per step."""
    rows = tuple(_motion_row(record) for record in records)
    title = "servo: following error, settling, saturation, torque"
    return TableData(title, MOTION_COLUMNS, rows, (), MOTION_NOTES, ("rms arc s", "kind"))


def _motion_row(record: StepRecord) -> tuple[str, ...]:
    worst = int(np.argmax(record.following_max))
    settled = "never" if record.settled is None else f"{record.settled:.2f}"
    return (
        record.label,
        record.kind,
        _of_axis(record.following_max / ARC_SECOND),
        _short(record.following_rms[worst] / ARC_SECOND),
        settled if record.rests else "",
        _of_axis(record.saturated),
        _of_axis(100.0 * record.torque_ratio),
    )


def _of_axis(values: Array) -> str:
    """The greatest value and its axis; plain 0 where all are."""
    worst = int(np.argmax(values))
    return f"{_short(values[worst])} {JOINTS[worst]}" if values[worst] else "0"


def _short(value: float) -> str:
    """Three digits, or all of those before the point."""
    return f"{value:.3g}" if abs(value) < 100 else f"{value:.0f}"


def markdown(table: TableData) -> str:
    """The table as GitHub markdown."""
    lines = [f"### {table.title}", "", _line(table.columns)]
    lines.append("|---" + "|---:" * (len(table.columns) - 1) + "|")
    lines += [_line(row) for row in table.rows]
    lines += [_line(tuple(f"*{c}*" if c else "" for c in row)) for row in table.footers]
    return "\n".join([*lines, "", *(f"- {note}" for note in table.notes), ""])


def _line(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def refusal_lines(refusals: Sequence[Refusal]) -> list[str]:
    """One line for each method that would not answer, and each stretch that is not whole."""
    return [f"{r.who} gives no estimate: {r.reason}" for r in refusals]


def report_document(result: RunResult) -> str:
    """The report shown beside a recording."""
    s = result.settings
    head = [
        f"# {s.procedure.entry.title}",
        "",
        f"{s.imu.title}, seed {s.seed}; {result.plan.motion.duration:g} s at {s.rate_hz} Hz "
        f"({s.sampling.value} samples), latitude {(s.site.latitude or 0.0) / DEG:g} deg, "
        f"g = {s.site.gravity:.7f} m/s2."
        + (f" Joints by the simulated servo: {s.table.title}." if result.records else ""),
        "",
    ]
    tables = score_tables(result.scores, s.imu, s.options.priors.noise_only)
    if result.records:
        tables.append(motion_table(result.records))
    return verdict_document(head, tables, result.refusals)


def verdict_document(
    head: Sequence[str], tables: Sequence[TableData], refusals: Sequence[Refusal]
) -> str:
    """Some lines, the tables of the estimates, and what gave none."""
    body = [markdown(table) for table in tables]
    refused = [f"{line}\n" for line in refusal_lines(refusals)]
    note = [ANGLE_NOTE, ""] if tables else []
    return "\n".join([*head, *body, *refused, *note])


def config_document(result: RunResult) -> str:
    """The files that made the run."""
    s = result.settings
    parts = (("Procedure", s.procedure), ("IMU", s.imu), ("Table", s.table))
    return files_document([(name, part.id, part.text) for name, part in parts])


def files_document(parts: Sequence[tuple[str, str, str]]) -> str:
    """Files in closed fences: what each is, its id and its text."""
    return "\n".join(
        f"## {name}: {id_}\n\n```toml\n{text.rstrip()}\n```\n" for name, id_, text in parts
    )
