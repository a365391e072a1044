"""Commands on the catalogue: `stand list`, `new`, `check-imu`, `check-table`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from stand.cli.options import Catalogue, ForceOption, JsonOption, Template
from stand.cli.progress import print_json

if TYPE_CHECKING:
    from collections.abc import Sequence

    from stand.imu.lint import PresetFinding


def list_entries(
    what: Annotated[
        Catalogue, typer.Argument(help="procedures, imus, tables, trajectories, methods.")
    ],
    as_json: JsonOption = False,
) -> None:
    """List the catalogue: what can be run, simulated, estimated."""
    from stand.report.listing import entries_table, listing

    entries = listing(what.value)
    if as_json:
        print_json(entries)
        return
    from stand.report.console import console, show

    show(console(), [entries_table(what.value, entries)])


def check_imu(
    unit: Annotated[str, typer.Argument(help="Catalogue id (stand list imus) or a TOML file.")],
    as_json: JsonOption = False,
) -> None:
    """Look over a preset: unit slips, impossible pairs, missing sources.

    Exit code 0 when nothing worse than a warning was found, 1 otherwise.

    Example: stand check-imu my-unit.toml
    """
    from stand import toml_files as catalogue
    from stand.imu.lint import lint

    source = catalogue.find("imus", "imu", unit)
    _tell("imu", source.name, lint(source), as_json)


def check_table(
    table: Annotated[str, typer.Argument(help="Catalogue id (stand list tables) or a TOML file.")],
    as_json: JsonOption = False,
) -> None:
    """Look over a table's file: unit slips, impossible pairs, axes that cannot do what is said.

    Exit code 0 when nothing worse than a warning was found, 1 otherwise.

    Example: stand check-table my-table.toml
    """
    from stand import toml_files as catalogue
    from stand.table.lint import lint

    source = catalogue.find("tables", "table", table)
    _tell("table", source.name, lint(source), as_json)


def _tell(what: str, name: str, findings: Sequence[PresetFinding], as_json: bool) -> None:
    from dataclasses import asdict

    if as_json:
        print_json({what: name, "findings": [asdict(f) for f in findings]})
    elif findings:
        from stand.report.console import console, show
        from stand.report.lint_table import findings_table

        show(console(), [findings_table(findings)])
    else:
        print(f"{name}: nothing to object to")
    if any(f.severity == "error" for f in findings):
        raise typer.Exit(1)


def new(
    what: Annotated[Template, typer.Argument(help="imu, table or procedure.")],
    name: Annotated[str, typer.Argument(help="Of the file to write, NAME.toml, and its title.")],
    force: ForceOption = False,
) -> None:
    """Write a commented file with every key there is, to begin with.

    Example: stand new table my-table
    """
    from pathlib import Path

    from stand.errors import StandError
    from stand.folder import refuse_files, write_file
    from stand.report.templates import template

    path = Path(name if name.endswith(".toml") else f"{name}.toml")
    if path.name.startswith("."):
        raise StandError(f"NAME = {name!r}: must be a name that does not begin with a dot")
    refuse_files([path], "NAME", force=force)
    print(write_file(path, template(what.value, path.stem)))
