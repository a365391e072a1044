"""A unit's constant errors: `stand calibrate`, `stand apply`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from stand.cli.log_options import takes_log_form
from stand.cli.options import (
    ForceOption,
    HeightOption,
    JsonOption,
    LatitudeOption,
    quick_imports,
)
from stand.cli.progress import print_json, progress, tell_left_behind, working

if TYPE_CHECKING:
    from stand.recording.log_form import LogForm


@takes_log_form
def calibrate(
    recordings: Annotated[
        list[Path], typer.Argument(help="Logs of any kind, or folders of stand run.")
    ],
    *,
    form: LogForm,
    by_hand: Annotated[
        bool,
        typer.Option(
            "--hand-held", help="No table: the unit was turned by hand from rest to rest."
        ),
    ] = False,
    imu: Annotated[
        str | None,
        typer.Option(metavar="ID", help="Unit or TOML file: what its data sheet says beforehand."),
    ] = None,
    table: Annotated[
        str | None,
        typer.Option(metavar="ID", help="Table class or TOML file; else as recorded."),
    ] = None,
    trust_table: Annotated[
        bool, typer.Option(help="Take the table and the unit's seat on it for perfect.")
    ] = False,
    free: Annotated[
        str | None,
        typer.Option(
            metavar="TERMS",
            help="Find these too though the sheet states none: asymmetry, k2, k3, misalignment ...",
        ),
    ] = None,
    stretches: Annotated[
        Path | None,
        typer.Option(
            metavar="X.toml", help="What the stretches of a log of one's own are: see align."
        ),
    ] = None,
    gravity: Annotated[
        float | None, typer.Option(metavar="M/S^2", help="As measured; else normal gravity.")
    ] = None,
    gravity_sigma: Annotated[
        float | None,
        typer.Option(metavar="M/S^2", help="Of it; normal gravity has 3e-4 without being told."),
    ] = None,
    latitude: LatitudeOption = None,
    height: HeightOption = None,
    shortest: Annotated[float, typer.Option(metavar="S", help="Of a rest.")] = 1.0,
    published: Annotated[
        bool,
        typer.Option(
            "--as-published", help="--hand-held to the letter: no weights, no g-sensitivity."
        ),
    ] = False,
    topic: Annotated[
        str | None, typer.Option(help="Which IMU topic, where there are several.")
    ] = None,
    serial: Annotated[str, typer.Option(help="Of the unit, for the record.")] = "",
    out: Annotated[
        Path | None,
        typer.Option(metavar="X.json", help="The calibration; else calibration.json here."),
    ] = None,
    report: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="The certificate, a page, with calibration.json there."),
    ] = None,
    limits: Annotated[
        Path | None,
        typer.Option(metavar="X.toml", help="Of the page's verdicts; else the data sheet's."),
    ] = None,
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> None:
    """Find a unit's biases, scale factors and axes, with a sigma of each and its share.

    On a table: from rests, turns at constant rate and the moves between them, of one recording or
    several of one unit; the table's own errors, the seat and gravity are estimated beside it.

    Example: stand calibrate recordings/full --gravity 9.80936 --gravity-sigma 1e-6

    Without a table: rest the unit some seconds with each face up and on some edges, turn it by hand
    between; rests are found, and what they cannot tell is said before any number.

    Example: stand calibrate log.csv --hand-held --latitude 48.5 --out calibration.json

    A certificate for the file: --report certificate --limits limits.toml

    With --json it prints the calibration, and writes it only if --out or --report is given.
    """
    with quick_imports():
        from stand import api
        from stand.calibration.file import record_to_json
        from stand.calibration.limits import load_limits
        from stand.errors import StandError
        from stand.folder import refuse_files
        from stand.report.certificate import FILE, PAGE, PICTURE, write_certificate

    on_table = {"--table": table, "--trust-table": trust_table, "--stretches": stretches}
    used = [name for name, value in (on_table | {"--free": free}).items() if value]
    if by_hand and used:
        raise StandError(f"{used[0]}: not with --hand-held, which has no table")
    if published and not by_hand:
        raise StandError("--as-published: needs --hand-held, it is the published method's form")
    if limits is not None and report is None:
        raise StandError("--limits: must have --report DIR with it, the page that judges by them")
    bounds = None if limits is None else load_limits(limits)
    target = out or (None if as_json or report is not None else Path("calibration.json"))
    pages = [] if report is None else [report / name for name in (PAGE, FILE, PICTURE)]
    refuse_files(pages, "--report", force=force)
    refuse_files([] if target is None else [target], force=force)
    with progress("reading", as_json) as done:
        logs = [
            api.read(path, form=form, topic=topic, stretches=stretches, progress=done)
            for path in recordings
        ]
    with working("estimating", as_json):
        found = api.calibrate(
            logs,
            hand_held=by_hand,
            imu=imu,
            table=table,
            trust_table=trust_table,
            free=[term.strip() for term in free.split(",")] if free else [],
            gravity_m_s2=gravity,
            gravity_sigma_m_s2=gravity_sigma,
            latitude_deg=latitude,
            height_m=height,
            shortest_s=shortest,
            as_published=published,
            axes=form.axes or "",
            serial=serial,
        )
    if report is not None:
        with working("drawing", as_json):
            pages = write_certificate(found, report, bounds, force=force)
    if target is not None:
        found.save(target, force=force)
    if as_json:
        print_json(record_to_json(found))
        return
    from stand.report.console import console, show

    console().print(found.headline(), markup=False)
    for line in found.remarks():
        console().print(line, style="dim", markup=False)
    show(console(), found.tables())
    for path in (*pages, *([] if target is None else [target])):
        print(path)


@takes_log_form
def apply(
    calibration: Annotated[Path, typer.Argument(help="calibration.json of stand calibrate.")],
    recording: Annotated[Path, typer.Argument(help="A log of this unit, of any kind.")],
    *,
    form: LogForm,
    out: Annotated[Path, typer.Option(metavar="X.mcap", help="The corrected log to write.")],
    topic: Annotated[
        str | None, typer.Option(help="Which IMU topic, where there are several.")
    ] = None,
    temperature: Annotated[
        float | None,
        typer.Option(metavar="C", help="Of the unit, where the calibration has such terms."),
    ] = None,
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> None:
    """Take a unit's errors out of a log; the calibration and both hashes go into its metadata.

    Example: stand apply calibration.json log.mcap --out corrected.mcap
    """
    tell_left_behind(out)
    with quick_imports():
        from stand.calibration.corrected import applied

    with progress("correcting", as_json) as done:
        found = applied(
            calibration,
            recording,
            out,
            form,
            topic=topic,
            temperature_C=temperature,
            force=force,
            progress=done,
        )
    facts = {"out": str(out), "topic": found.log.topic, "samples": len(found.log)}
    if as_json:
        print_json(facts)
        return
    print(f"{out}: {facts['samples']} samples of {recording}, corrected")
