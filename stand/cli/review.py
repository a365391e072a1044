"""Commands on a recording: `stand report`, `stand recover`, `stand view`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from stand.cli.command import refuse_given
from stand.cli.log_options import takes_log_form
from stand.cli.options import ForceOption, JsonOption, LatitudeOption, quick_imports
from stand.cli.progress import print_json, progress, working

if TYPE_CHECKING:
    from stand.recording.log import Log
    from stand.recording.log_form import LogForm


@takes_log_form
def report(
    context: typer.Context,
    recording: Annotated[
        Path, typer.Argument(help="Folder of stand run, its run.mcap, or any log.")
    ],
    *,
    form: LogForm,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="The page to write; default: report.html beside the run."
        ),
    ] = None,
    latitude: LatitudeOption = None,
    imu: Annotated[
        str | None,
        typer.Option(metavar="ID", help="Of a log: its unit (stand list imus) or a TOML file."),
    ] = None,
    topic: Annotated[
        str | None, typer.Option(help="Of a log: which IMU topic, where there are several.")
    ] = None,
    stretches: Annotated[
        Path | None,
        typer.Option(metavar="X.toml", help="Of a log: its stretches, see stand stretches."),
    ] = None,
    film: Annotated[
        bool,
        typer.Option(
            "--film", help="Of a run: a film of 15 s on the first screen; see stand film."
        ),
    ] = False,
    force: ForceOption = False,
) -> None:
    """One page of a recorded run, or of any log. Needs no network.

    A run: results, channels, errors over time, motion, sources. A log: channels, rests, attitude,
    noise. Example: stand report recordings/six-position_stim300_seed0 --out report.html

    Of a log of one's own: stand report own.mcap --latitude 48.5 --imu stim300
    """
    with quick_imports():
        from stand import api
        from stand.errors import StandError
        from stand.report.log_page import write_log_page
        from stand.report.run_page import write_run_page

    options: dict[str, Any] = {"latitude_deg": latitude, "force": force}
    with working("reading", False):
        log = api.read(recording, topic=topic, stretches=stretches, form=form)
    of_run = log.simulated and stretches is None
    if of_run:
        refuse_given(context, "for a recorded run, which says its unit", {"imu"})
    if film and not of_run:
        raise StandError("--film: of a recorded run; stand film shows a log with joints")
    if film:
        with progress("filming", False) as done:
            page = write_run_page(recording, out, log=log, film=True, progress=done, **options)
    else:
        with working("drawing", False):
            page = (
                write_run_page(recording, out, log=log, **options)
                if of_run
                else write_log_page(log, out, imu=imu, **options)
            )
    print(page)


def recover(
    place: Annotated[
        Path | None,
        typer.Argument(
            help="Where they lie, the target of one, or an MCAP that is cut off; else recordings."
        ),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Bring back what interrupted recordings hold: run, drive, import; killed, or without power.

    A recording is written in chunks of a second of simulated time at most, and each is in the
    file within a second of its making. After a kill at most the second that was being made is
    lost, after a power cut also what the disk had not taken: a second more. The rest comes back
    with index, review and result.json; a stretch that is cut is refused by name.

    Example: stand recover recordings/six-position_stim300_seed0
    """
    with quick_imports():
        import stand

    with working("looking", as_json):
        found = stand.recover(place)
    if as_json:
        from dataclasses import asdict

        texts = [asdict(one) for one in found]
        print_json([t | {k: t[k] and str(t[k]) for k in ("found", "out")} for t in texts])
    elif not found:
        print(f"nothing of an interrupted run in {place or 'recordings'}")
    else:
        from stand.errors import printable

        print("\n".join(printable(line) for one in found for line in one.lines()))
    if any(one.out is None for one in found):
        raise typer.Exit(1)


@takes_log_form
def view(
    recording: Annotated[
        Path, typer.Argument(help="Folder of stand run, an .rrd or .mcap, or any log.")
    ],
    *,
    form: LogForm,
    t_from: Annotated[
        float | None, typer.Option("--from", metavar="S", help="At full rate from here ...")
    ] = None,
    t_to: Annotated[float | None, typer.Option("--to", metavar="S", help="... to here.")] = None,
    topic: Annotated[
        str | None, typer.Option(help="Which IMU topic, where there are several.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(metavar="X.rrd", help="Write the review there, open nothing.")
    ] = None,
    browser: Annotated[
        bool, typer.Option("--browser", help="In the web browser, for want of a window.")
    ] = False,
    force: ForceOption = False,
) -> None:
    """Open a recording in the rerun viewer: the review of a run's folder, else its samples.

    The review of a long run shows two rows for many samples; a stretch is shown with all of them.

    Example: stand view recordings/six-position_stim300_seed0 --from 60 --to 70
    """
    from stand.recording.viewer import KINDS
    from stand.recording.viewer import view as open_viewer

    whole = t_from is None and t_to is None and out is None and topic is None
    if whole and recording.is_dir() and (recording / "run.rrd").is_file():
        open_viewer(recording / "run.rrd", browser=browser)
    elif whole and recording.suffix in KINDS:
        open_viewer(recording, browser=browser)
    else:
        from stand import api
        from stand.folder import refuse_files

        if out is not None:
            refuse_files([out], force=force)
        with working("reading", False):
            log = api.read(recording, topic=topic, form=form)
        _view_samples(log, recording.stem, (t_from, t_to), out, browser=browser)


def _view_samples(
    log: Log,
    name: str,
    limits: tuple[float | None, float | None],
    out: Path | None,
    *,
    browser: bool,
) -> None:
    from tempfile import TemporaryDirectory

    from stand.recording.samples_review import write_review
    from stand.recording.viewer import view as open_viewer

    with TemporaryDirectory() as folder:
        target = out or Path(folder) / f"{name}.rrd"
        with working("reading", False):
            told = write_review(log, target, *limits)
        print(told)
        if out is None:
            open_viewer(target, browser=browser)
