"""The shortest test for a required accuracy: `stand propose`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from stand.cli.options import (
    ForceOption,
    HeightOption,
    JsonOption,
    LatitudeOption,
    quick_imports,
)
from stand.cli.progress import print_json, progress


def propose(
    requirement: Annotated[
        str | None,
        typer.Argument(
            metavar="REQUIREMENT.toml",
            help="[require] as a procedure has it, and in [allowed] what the test may do.",
        ),
    ] = None,
    heading: Annotated[
        float | None,
        typer.Option(metavar="DEG", help="Instead of a file: the heading, by twice its sigma."),
    ] = None,
    imu: Annotated[
        str | None,
        typer.Option(metavar="ID", help="Unit or a TOML file; else the requirement's, or stim300."),
    ] = None,
    table: Annotated[
        str | None,
        typer.Option(
            metavar="ID", help="Table or a TOML file; else the requirement's, or precision."
        ),
    ] = None,
    latitude: LatitudeOption = None,
    height: HeightOption = None,
    rate: Annotated[int, typer.Option(metavar="HZ", help="Sample rate, 1 to 10000 Hz.")] = 200,
    max_time: Annotated[
        float | None, typer.Option(metavar="S", help="The whole test may take so long.")
    ] = None,
    trade_off: Annotated[
        bool,
        typer.Option("--trade-off", help="Also the shortest test for laxer and stricter limits."),
    ] = False,
    procedure: Annotated[
        list[str] | None,
        typer.Option(metavar="ID", help="Of --trade-off: a procedure of your own beside it."),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(metavar="P.toml", help="Write the procedure there.")
    ] = None,
    report: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Write a page, JSON and the procedure there.")
    ] = None,
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> None:
    """The shortest test that reaches a required accuracy, as a procedure to run.

    Rests and turnings, their positions, rates, times and order, for a unit on a table; its own
    rehearsal passes, and no rest of it could be left out or a fifth shorter. Exit code 0: there is
    one; 1: there is none, and why.

    A heading to 0.5 deg: stand propose --heading 0.5 --imu hg9900 --out north.toml

    What a file may ask for: stand new requirement calibration.toml

    Time against accuracy: stand propose calibration.toml --trade-off --report best
    """
    with quick_imports():
        import stand
        from stand.folder import refuse_files
        from stand.report import proposal as pages

    if procedure and not trade_off:
        raise stand.StandError("--procedure: of --trade-off, which is not given")
    if out is not None:
        refuse_files([out], force=force)
    if report is not None:
        pages.refuse_report(report, with_curve=trade_off, force=force)
    given = {
        "imu": imu,
        "table": table,
        "heading_deg": heading,
        "max_time_s": max_time,
        "latitude_deg": latitude,
        "height_m": height,
        "rate_hz": rate,
    }
    with progress("looking for the shortest test", as_json) as done:
        result = stand.propose(requirement, **given, progress=done)  # pyright: ignore[reportArgumentType]
    curve = None
    if trade_off:
        from stand.proposal.preparation import request
        from stand.proposal.trade_off import trade_off as curve_of

        with progress("time against accuracy", as_json) as done:
            curve = curve_of(*request(requirement, **given), procedure or (), done)  # pyright: ignore[reportArgumentType]
    if as_json:
        print_json(pages.to_json(result, curve))
    else:
        from stand.report.console import console, show

        to = console()
        to.print(pages.headline(result), markup=False, soft_wrap=True)
        show(to, pages.tables(result, curve))
    written = []
    if out is not None and result.text:
        written.append(result.write(out))
    if report is not None:
        written += pages.write_report(result, report, curve, force=force)
    if not as_json:
        for path in written:
            print(path)
    if not result.feasible:
        raise typer.Exit(1)
