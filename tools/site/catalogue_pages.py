"""Pages of the catalogues, the commands and the Python face: written by what they describe."""

from __future__ import annotations

import importlib
import inspect
import pkgutil
import re
import tomllib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import typer

import alignment
import stand
import stand.results
from alignment import ESTIMATORS
from alignment.sources import SOURCES
from stand import toml_files
from stand.cli.app import app
from stand.imu import load_imu, unstated
from stand.procedure.procedure import load_procedure
from stand.report.document import markdown
from stand.report.listing import entries_table, listing
from stand.report.tables import TableData
from stand.table.table import load_table

ROOT = Path(__file__).resolve().parents[2]
KINDS = {
    "methods": "Methods",
    "imus": "Units",
    "tables": "Tables",
    "procedures": "Procedures",
    "trajectories": "Trajectories",
}
NO_FORMULA = "*The formula of this method is not written in `docs/site/methods.toml` yet.*"

Pages = dict[str, str]
"""Text by path within the site, without the ending."""


def catalogue_pages() -> Pages:
    """A page for each entry of each catalogue, and one that lists them."""
    pages: Pages = {}
    for what, title in KINDS.items():
        names = list(ESTIMATORS) if what == "methods" else toml_files.ids(what)
        for name in names:
            pages[f"catalogue/{what}/{name}"] = _MAKERS[what](name)
        table = markdown(entries_table(what, listing(what))).partition("\n")[2]
        for name in names:
            table = re.sub(rf"^\| {re.escape(name)} \|", f"| [{name}]({what}/{name}.md) |", table,
                           flags=re.MULTILINE)  # fmt: skip
        # the rows lead to the pages; the list of contents need not show them
        pages[f"catalogue/{what}"] = f"# {title}\n{table}\n" + toctree(
            [f"{what}/{name}" for name in names], hidden=True
        )
    return pages


def toctree(entries: Sequence[str], caption: str = "", *, hidden: bool = False) -> str:
    """A list of contents."""
    options = [f":caption: {caption}"] if caption else []
    options += [":hidden:"] if hidden else []
    lines = [":maxdepth: 1", *options, "", *entries]
    return "\n".join(["```{toctree}", *lines, "```", ""])


# --- methods


def _method(name: str) -> str:
    method = ESTIMATORS[name]
    stated = _stated_methods().get(name, {})
    letter = re.match(r"\[(\w+)\]", method.source)
    paper = SOURCES.get(letter[1], "") if letter else ""
    function = inspect.unwrap(method.estimate)
    module = inspect.getmodule(function)
    assert module is not None
    needs = {
        "takes": f"stretches {'at rest' if method.takes == 'rest' else method.takes}",
        "latitude": "must be known" if method.needs_latitude else "need not be known",
        "zero offset": "from the first seconds of each stretch" if method.needs_offset else "",
        "Y1": "must be near the vertical" if method.needs_upright else "",
        "attitude": "carried from what the table was told" if method.carries_nominal else "",
        "constant biases of gyros": "cancel in the heading" if method.turns_cancel_bias else "",
        "triads skewed by design": "known" if method.knows_skew else "refused",
        "variants": ", ".join(w.words for w in method.windows.values()),
        "predicted before a run": (method.no_prediction and f"no: {method.no_prediction}") or "yes",
    }
    return "\n\n".join(
        [
            f"# {name}",
            f"{method.title}.",
            f"**Source:** {method.source}. {paper}".rstrip(),
            "## Formula",
            f"```{{math}}\n{stated['formula'].strip()}\n```" if "formula" in stated else NO_FORMULA,
            stated.get("words", ""),
            "## What it assumes",
            stated.get("assumes", ""),
            _rows(("of", "is"), [(k, v) for k, v in needs.items() if v]),
            "## Leading errors",
            _notes(function) or f"{method.note}.",
            f"What ± holds: {method.note}.",
            "## The floor",
            stated.get("floor", "White noise alone puts a floor under any method; "
                       "`stand compare` prints it beside each sigma."),
            "## How its predictions stand",
            proof_of(name),
            "## In the code",
            f"`{module.__name__}.{function.__name__}`, tried by `stand align LOG --method {name}`"
            f" or `stand compare PROCEDURE --methods {name}`.",
            f"```{{eval-rst}}\n.. autofunction:: {module.__name__}.{function.__name__}\n"
            "   :no-index:\n```",
        ]
    )  # fmt: skip


def _stated_methods() -> dict[str, dict[str, str]]:
    text = (ROOT / "docs" / "site" / "methods.toml").read_text(encoding="utf-8")
    return tomllib.loads(text)


def _notes(function: Any) -> str:
    """The notes of a docstring, which hold the leading errors, as markdown."""
    text = inspect.getdoc(function) or ""
    found = re.search(r"^Notes\n-----\n(.*?)(?:\n\n[A-Z]\w+\n-{3,}|\Z)", text, re.M | re.S)
    return re.sub(r"``([^`]+)``", r"`\1`", found[1].strip()) if found else ""


def proof_of(method: str) -> str:
    """Every row on a method that the pages docs/proof*.md have: predicted over achieved, NEES."""
    parts = []
    for page in sorted((ROOT / "docs").glob("proof*.md")):
        for heading, columns, rows in tables_of(page.read_text(encoding="utf-8")):
            if "method" not in columns:
                continue
            at = columns.index("method")
            own = [row for row in rows if row[at] == method or row[at].startswith(f"{method} ")]
            own = [row for row in own if any(row[at + 1 :])]
            if own:
                parts.append(
                    f"From [{heading}](../../{page.name}), {len(own)} rows:\n\n"
                    f"{_rows(columns, own)}\n"
                )
    return "\n\n".join(parts) or (
        "No page of the proof names it yet. Try it: `stand rehearse PROCEDURE --verify 200`."
    )


def tables_of(text: str) -> Iterator[tuple[str, list[str], list[list[str]]]]:
    """The tables of a page of markdown: the page's title, columns, rows."""
    title = text.partition("\n")[0].lstrip("# ")
    for block in re.findall(r"(?:^\|.*\n)+", text, re.M):
        lines = [[cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]]
                 for line in block.splitlines()]  # fmt: skip
        if len(lines) > 2:
            yield title, lines[0], lines[2:]


def _rows(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    table = TableData("", tuple(columns), tuple(tuple(map(str, row)) for row in rows))
    return markdown(table).partition("\n")[2].strip().replace("|---:", "|---")


# --- units, tables, procedures, trajectories


def _unit(name: str) -> str:
    unit = load_imu(name)
    parts = [
        f"# {name}",
        f"{unit.title}. Grade: {unit.entry.grade}; evidence {unit.entry.evidence}.",
        _comments(unit.text),
    ]
    for sensor in ("gyro", "accel", "sampling"):
        rows = _stated(getattr(unit.entry, sensor))
        if rows:
            columns = ("key", "value", "is", "source")
            parts += [f"## `[{sensor}]`", _rows(columns, rows)]
    left = unstated(unit)
    parts += ["## What the sheet leaves out", "\n".join(f"- {line}" for line in left) or "Nothing."]
    parts += [
        f"Used by `stand run six-position --imu {name}`; checked by `stand check-imu {name}`."
    ]
    return "\n\n".join([*parts, _file(unit.text)])


def _stated(entry: Any) -> list[tuple[str, str, str, str]]:
    rows = []
    for key in type(entry).model_fields:
        value = getattr(entry, key)
        if value is None or (not hasattr(value, "source") and key not in entry.model_fields_set):
            continue
        if hasattr(value, "source"):
            rows.append((f"`{key}`", _number(value.value), value.kind, value.source))
        else:
            rows.append((f"`{key}`", _number(value), "", ""))
    return rows


def _number(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


def _table(name: str) -> str:
    table = load_table(name)
    rows = []
    for axis, entry in table.entry.axis.items():
        e = entry.errors
        travel = (
            "unlimited" if entry.travel_deg is None else "{:g} to {:g}".format(*entry.travel_deg)
        )
        rows.append(
            (axis, travel, f"{entry.rate_deg_s:g}", f"{entry.acceleration_deg_s2:g}",
             f"{entry.jerk_deg_s3:g}", f"{e.placement_arc_s:g}", f"{e.encoder_arc_s:g}",
             f"{e.non_orthogonality_arc_s:g}", f"{e.wobble_arc_s:g}",
             "" if entry.motor is None else f"{entry.motor.torque_Nm:g}")
        )  # fmt: skip
    columns = ("axis", "travel deg", "deg/s", "deg/s²", "deg/s³", "placement ″", "encoder ″",
               "non-orthogonality ″", "wobble ″", "torque Nm")  # fmt: skip
    geometry = table.entry.geometry
    of_whole = [(f.replace("_arc_s", ""), f"{getattr(geometry, f):g} ″")
                for f in type(geometry).model_fields]  # fmt: skip
    settling = table.entry.settling
    of_whole += [("settled", f"within {settling.within_arc_s:g} ″ for {settling.hold_s:g} s")]
    if table.missing:
        of_whole += [("axes that are not there", ", ".join(table.missing))]
    return "\n\n".join(
        [
            f"# {name}",
            f"{table.title}. Source: {table.entry.source.strip().rstrip('.')}.",
            _comments(table.text),
            "## Axes",
            _rows(columns, rows),
            "Errors are standard deviations: each run draws its own table from them by its seed.",
            "## The whole",
            _rows(("of", "is"), of_whole),
            f"Used by `stand run six-position --table {name}`; checked by "
            f"`stand check-table {name}`.",
            _file(table.text),
        ]
    )


def _procedure(name: str) -> str:
    procedure = load_procedure(name)
    entry = procedure.entry
    return "\n\n".join(
        [
            f"# {name}",
            f"{entry.title}. {entry.description}",
            f"Table {entry.table}; estimates: {', '.join(entry.estimate.methods) or 'none'}.",
            f"```{{image}} {name}-timeline.svg\n:alt: Timeline of {name}\n:width: 100%\n```",
            "## Positions",
            f"```{{image}} {name}-positions.png\n:alt: The stand in each position of {name}\n```",
            "## Before the table is booked",
            f"```sh\nstand rehearse {name}\nstand run {name}\nstand export {name} --out {name}.csv"
            "\n```",
            _file(procedure.text),
        ]
    )


def _trajectory(name: str) -> str:
    row = next(r for r in listing("trajectories") if r["id"] == name)
    text = toml_files.find("trajectories", "trajectory", name).text
    facts = _rows(("of", "is"), [(k, str(v)) for k, v in row.items() if k not in ("id", "title")])
    return "\n\n".join([f"# {name}", f"{row['title']}.", facts, f"`stand drive {name}`",
                        _file(text)])  # fmt: skip


def _comments(text: str) -> str:
    """The comment at the head of a file."""
    lines = []
    for line in text.splitlines():
        if not line.startswith("#"):
            break
        lines.append(line.lstrip("# "))
    return " ".join(lines)


def _file(text: str) -> str:
    return f"## The file\n\n```toml\n{text.strip()}\n```\n"


_MAKERS = {
    "methods": _method,
    "imus": _unit,
    "tables": _table,
    "procedures": _procedure,
    "trajectories": _trajectory,
}


# --- commands


def command_pages() -> Pages:
    """A page for each command, as the command line itself tells it."""
    group: Any = typer.main.get_command(app)
    pages: Pages = {}
    lines = []
    with group.make_context("stand", ["list"], resilient_parsing=True) as context:
        for name, command in group.commands.items():
            pages[f"commands/{name}"] = _command(name, command, context)
            first = " ".join(command.help.split("\n\n")[0].split())
            lines.append((f"[stand {name}](commands/{name}.md)", first))
    listed = _rows(("command", "does"), lines)
    pages["commands"] = (
        f"# Commands\n\n{listed}\n\nA fault of the input is one line on stderr and exit code 2; "
        "`--json` is for machines; an existing file or recording stays unless `--force` is "
        "given.\n\n" + toctree([f"commands/{name}" for name in group.commands], hidden=True)
    )
    return pages


def _command(name: str, command: Any, parent: Any) -> str:
    context = typer.Context(command, info_name=name, parent=parent)
    usage = " ".join(command.collect_usage_pieces(context))
    records = []
    for param in command.params:
        record = param.get_help_record(context)
        if record is not None:
            records.append((f"`{record[0]}`", record[1].replace("|", "\\|")))
    return "\n\n".join(
        [
            f"# stand {name}",
            f"```sh\nstand {name} {usage}\n```",
            _help(command.help),
            "## Options",
            _rows(("option", "means"), records),
        ]
    )


def _help(text: str) -> str:
    """The help as markdown: an example is a line to copy."""
    parts = []
    for paragraph in text.split("\n\n"):
        line = " ".join(paragraph.split())
        before, found, example = line.partition("stand ") if ": stand " in line or line.startswith(
            ("Example: stand", "stand ")) else (line, "", "")  # fmt: skip
        parts.append(_escaped(before.strip()))
        if found:
            parts.append(f"```sh\nstand {example}\n```")
    return "\n\n".join(part for part in parts if part)


def _escaped(text: str) -> str:
    return re.sub(r"([*_<\[])", r"\\\1", text)


# --- Python


def python_pages() -> Pages:
    """The public face of `stand` and every module of `alignment`."""
    names = [n for n in stand.__all__ if n != "__version__"]
    functions = [n for n in names if inspect.isroutine(getattr(stand, n))]
    classes = [n for n in names if n not in functions]
    results = result_classes()
    directives = [f".. autofunction:: stand.{n}" for n in functions]
    directives += [f".. autoclass:: stand.{n}" for n in classes]
    answers = [f".. autoclass:: {name}\n   :members:" for name in results]
    pages = {
        "reference/stand": f"# The Python face: `stand`\n\n{_rst(directives)}",
        "reference/results": f"# What the functions answer\n\n{_rst(answers)}",
    }
    for module in alignment_modules():
        name = module.removeprefix("alignment").lstrip(".") or "alignment"
        # what a package offers is described where it is
        members = "" if _is_package(module) else "\n   :members:"
        body = _rst([f".. automodule:: {module}{members}"])
        pages[f"reference/alignment/{name}"] = f"# `{module}`\n\n{body}"
    inner = [page.removeprefix("reference/") for page in pages if "/alignment/" in page]
    pages["reference/alignment"] = (
        "# The estimators: `alignment`\n\nNumPy and SciPy, nothing of the stand: they work on any "
        "log.\n\n" + toctree(inner)
    )
    return pages


def result_classes() -> list[str]:
    """Every class that the functions answer with: `stand.results` has a module for each."""
    found = []
    for module in pkgutil.iter_modules(stand.results.__path__, "stand.results."):
        loaded = importlib.import_module(module.name)
        found += [
            f"{module.name}.{name}"
            for name, kind in vars(loaded).items()
            if inspect.isclass(kind) and kind.__module__ == module.name and name[0] != "_"
        ]
    return found  # fmt: skip


def _is_package(module: str) -> bool:
    return (Path(alignment.__file__).parents[1] / module.replace(".", "/")).is_dir()


def alignment_modules() -> list[str]:
    """Names of the package's modules, the package first."""
    root = Path(alignment.__file__).parent
    files = sorted(root.rglob("*.py"))
    parts = [file.relative_to(root.parent).with_suffix("").parts for file in files]
    names = {".".join(p[:-1] if p[-1] == "__init__" else p) for p in parts}
    return sorted(names)


def _rst(directives: Sequence[str]) -> str:
    return "```{eval-rst}\n" + "\n\n".join(directives) + "\n```\n"
