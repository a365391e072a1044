"""Thousands of runs: `stand campaign`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from stand.cli.command import refuse_given
from stand.cli.options import ForceOption, JsonOption, SchedulerOption, quick_imports
from stand.cli.progress import Stopped, print_json, progress, working
from stand.cli.run import show_run


def campaign(
    context: typer.Context,
    what: Annotated[
        str,
        typer.Argument(
            metavar="SWEEP.toml|DIR|record",
            help="What is run and varied; or a campaign's folder, to read; or `record`, with it.",
        ),
    ],
    folder: Annotated[
        Path | None, typer.Argument(metavar="DIR", help="Of record: the campaign's folder.")
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="For the results; default: recordings/campaign_SWEEP."),
    ] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on with the campaign that is there.")
    ] = False,
    workers: Annotated[
        int | None, typer.Option(metavar="N", help="Processes; else as many as there are cores.")
    ] = None,
    scheduler: SchedulerOption = None,
    plan: Annotated[
        bool, typer.Option("--plan", help="Cases, runs, time and size that are expected; no run.")
    ] = False,
    case: Annotated[
        int | None, typer.Option(metavar="N", help="Of record: which case, from 1.")
    ] = None,
    seed: Annotated[int | None, typer.Option(metavar="N", help="Of record: which run.")] = None,
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> None:
    """Vary anything, run thousands: errors beside predictions, yield, the worst units.

    Runs are kept every second in the folder: whatever ends a campaign, --resume goes on with it.
    Leaves results.parquet, a row per run, method, place and quantity, and campaign.html. Exit
    code 1: runs ended their process, and are named.

    Example: stand campaign dwell.toml --plan

    Read again: stand campaign recordings/campaign_dwell

    One run of it in full: stand campaign record recordings/campaign_dwell --case 3 --seed 7
    """
    from stand.errors import StandError

    running = {"resume", "workers", "scheduler", "plan"}
    if what == "record":
        refuse_given(context, "for one run, which is recorded", running)
        _record(folder, case, seed, out, force, as_json)
        return
    for option, given in (("DIR", folder), ("--case", case), ("--seed", seed)):
        if given is not None:
            raise StandError(f"{option}: of stand campaign record")
    refuse_given(context, "for a campaign: --resume goes on with one", {"force"})
    if Path(what).is_dir():
        refuse_given(context, "for a campaign's folder, which is only read", running | {"out"})
        _read(Path(what), as_json)
    elif plan:
        refuse_given(context, "beside --plan", {"scheduler"})
        _plan(what, out, resume, workers, as_json)
    else:
        _run(what, out, resume, workers, scheduler, as_json)


def _run(
    what: str,
    out: Path | None,
    resume: bool,
    workers: int | None,
    scheduler: str | None,
    as_json: bool,
) -> None:
    with quick_imports():
        import stand

    made = stand.campaign(what, out, resume=resume, workers=workers, scheduler=scheduler)
    title = f"{made.sweep.source.id}, {made.total} runs"
    try:
        with progress(title, as_json) as report:
            made.run(report)
    except KeyboardInterrupt:
        raise Stopped(
            f"interrupted: {made.done} of {made.total} runs are kept in {made.folder}; "
            "--resume goes on"
        ) from None
    _read(made.folder, as_json)
    if made.lost:
        raise typer.Exit(1)


def _read(folder: Path, as_json: bool) -> None:
    """The answer, then the page."""
    with quick_imports():
        from stand.campaigns.summary import summarised, summary_json
        from stand.report.campaign import answer, tables, write_page

    with working("reading", as_json):
        summary = summarised(folder)
    if as_json:
        print_json(summary_json(summary) | {"page": str(write_page(summary))})
        return
    from stand.report.console import console, show

    shown = console()
    shown.print(summary.sweep.entry.title, markup=False, soft_wrap=True)
    for line in answer(summary):
        shown.print(line, markup=False, soft_wrap=True)
    show(shown, tables(summary))
    with working("drawing", as_json):
        page = write_page(summary)
    print(page)


def _plan(what: str, out: Path | None, resume: bool, workers: int | None, as_json: bool) -> None:
    import os

    from stand.campaigns.campaign import size_of
    from stand.campaigns.folder import default_folder, is_campaign, results_of
    from stand.campaigns.sweep import load_sweep
    from stand.report.campaign import size_text

    sweep = load_sweep(what)
    folder = out or default_folder(sweep)
    known = 0
    if resume and is_campaign(folder):
        known = sum(map(len, results_of(folder).known().values()))
    with working("trying some runs", as_json):
        size = size_of(sweep, known)
    cores = workers or os.cpu_count() or 1
    if as_json:
        print_json(size._asdict() | {"seconds": size.seconds / cores, "folder": str(folder)})
    else:
        print(size_text(size, cores))


def _record(
    folder: Path | None,
    case: int | None,
    seed: int | None,
    out: Path | None,
    force: bool,
    as_json: bool,
) -> None:
    with quick_imports():
        import stand
        from stand.campaigns.record import default_recording, settings_of_run
        from stand.recording.reviewing import can_review

        reviewed = can_review()  # imports rerun here rather than amid the samples

    if folder is None or case is None or seed is None:
        raise stand.StandError("stand campaign record: must have DIR, --case and --seed")
    settings = settings_of_run(folder, case, seed)
    target = out or default_recording(folder, case, seed)
    with progress(f"case {case}, seed {seed}", as_json) as report:
        result = stand.run(settings, target, force=force, progress=report)
    if as_json:
        from stand.evaluation.run_result import result_json

        print_json(result_json(result) | {"out": str(result.out)})
        return
    show_run(result, reviewed)
