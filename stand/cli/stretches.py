"""A log that brings no procedure: `stand stretches`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from stand.cli.log_options import takes_log_form
from stand.cli.options import ForceOption, JsonOption, quick_imports
from stand.cli.progress import print_json, working

if TYPE_CHECKING:
    from stand.recording.log_form import LogForm


@takes_log_form
def stretches(
    recording: Annotated[Path, typer.Argument(help="Any log, as stand align takes it.")],
    *,
    form: LogForm,
    shortest: Annotated[
        float, typer.Option(metavar="S", help="What is shorter is no stretch.")
    ] = 3.0,
    topic: Annotated[
        str | None, typer.Option(help="Which IMU topic, where there are several.")
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(metavar="X.toml", help="Write them there, to be named and mended."),
    ] = None,
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> None:
    """Find where a log stands still, or turns evenly about the vertical: times, attitude, noise.

    With --out it leaves a file that stand align --stretches takes: name the attitudes that the
    table was told there.

    Example: stand stretches recordings/sample --out stretches.toml
    """
    with quick_imports():
        from stand import api
        from stand.folder import refuse_files, write_file
        from stand.report.stretches import stretches_json

    if out is not None:
        refuse_files([out], force=force)
    with working("reading", as_json):
        found = api.stretches(api.read(recording, topic=topic, form=form), shortest_s=shortest)
    if out is not None:
        write_file(out, found.toml())
    if as_json:
        print_json(stretches_json(found))
        return
    from stand.report.console import console, show

    show(console(), found.tables())
    if out is not None:
        print(out)
