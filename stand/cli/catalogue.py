"""Commands on the catalogue: `stand list`, `stand check-imu`."""

from __future__ import annotations

from typing import Annotated

import typer

from stand.cli.options import Catalogue, JsonOption
from stand.cli.progress import print_json


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
    from dataclasses import asdict

    from stand import toml_files as catalogue
    from stand.imu.lint import lint
    from stand.report.lint_table import findings_table

    source = catalogue.find("imus", "imu", unit)
    findings = lint(source)
    if as_json:
        print_json({"imu": source.name, "findings": [asdict(f) for f in findings]})
    elif findings:
        from stand.report.console import console, show

        show(console(), [findings_table(findings)])
    else:
        print(f"{source.name}: nothing to object to")
    if any(f.severity == "error" for f in findings):
        raise typer.Exit(1)
