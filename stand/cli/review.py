"""Commands on a recording: `stand report`, `stand view`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from stand.cli.options import ForceOption
from stand.cli.progress import working


def report(
    recording: Annotated[Path, typer.Argument(help="Folder of stand run, or its run.mcap.")],
    out: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="The page to write; default: report.html in the folder."),
    ] = None,
    force: ForceOption = False,
) -> None:
    """One page of a recorded run: results, errors over time, motion, sources. Needs no network.

    Example: stand report recordings/six-position_stim300_seed0 --out report.html
    """
    from stand.report.run_page import write_run_page

    with working("drawing", False):
        page = write_run_page(recording, out, force=force)
    print(page)


def view(
    recording: Annotated[Path, typer.Argument(help="Folder of stand run, an .rrd or an .mcap.")],
) -> None:
    """Open a recording in the rerun viewer: the review of a run's folder, else its run.mcap."""
    from stand.recording.viewer import view as open_viewer

    review, alone = recording / "run.rrd", recording / "run.mcap"
    if recording.is_dir():
        recording = alone if alone.is_file() and not review.is_file() else review
    open_viewer(recording)
