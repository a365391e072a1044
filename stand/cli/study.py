"""Commands before a test: `stand compare`, `stand rehearse`, `stand export`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from stand.cli.options import (
    ALLAN_TERMS,
    ForceOption,
    HeightOption,
    JsonOption,
    LatitudeOption,
    MotionChoice,
    quick_imports,
    site_of,
)
from stand.cli.progress import Stopped, print_json, progress, working
from stand.errors import StandError, unknown


def compare(
    procedure: Annotated[
        str | None, typer.Argument(help="Catalogue id (stand list procedures) or a TOML file.")
    ] = None,
    imu: Annotated[
        str, typer.Option(metavar="ID", help="Unit (stand list imus) or a TOML file.")
    ] = "stim300",
    table: Annotated[
        str | None, typer.Option(metavar="ID", help="Table (stand list tables) or a TOML file.")
    ] = None,
    runs: Annotated[
        int, typer.Option(metavar="N", help="Runs, each with a unit and table of its own.")
    ] = 100,
    methods: Annotated[
        str, typer.Option(metavar="a,b", help="stand list methods; else all that apply.")
    ] = "",
    motion: Annotated[
        MotionChoice,
        typer.Option(help="Joints follow the plan exactly, or as simulated motors make them."),
    ] = MotionChoice.ideal,
    true_table: Annotated[
        bool, typer.Option("--true-table", help="A table without errors, whatever its class.")
    ] = False,
    without: Annotated[
        str,
        typer.Option(metavar="TERMS", help="Switch error terms off: turn-on-bias,range ..."),
    ] = "",
    latitude: LatitudeOption = None,
    height: HeightOption = None,
    rate: Annotated[int, typer.Option(metavar="HZ", help="Sample rate, 1 to 10000 Hz.")] = 20,
    seed: Annotated[int, typer.Option(metavar="N", help="Of the first run.")] = 0,
    published: Annotated[
        bool,
        typer.Option("--published", help="Print published figures beside ours, with verdicts."),
    ] = False,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR", help="For the picture; default: recordings/compare_PROCEDURE_IMU_seedN."
        ),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Set methods side by side on identical data: error, sigma, floor, NEES, run time.

    Leaves a picture of heading error over time in the first run; with --json only if --out is
    given. On all cores; the numbers do not depend on how many there are.

    Example: stand compare two-position --imu ring-laser --runs 200 --methods triad,two-position

    What the papers print, beside what comes out here: stand compare --published
    """
    if published:
        _compare_published(as_json)
        return
    if procedure is None:
        raise StandError("compare: name a procedure (stand list procedures), or --published")
    with quick_imports():
        from dataclasses import replace

        from stand.evaluation.comparison import compare as compare_methods
        from stand.evaluation.comparison import to_json
        from stand.imu import load_imu
        from stand.imu import without as switched_off
        from stand.imu.priors import priors_of
        from stand.motion.polynomial import MotionKind
        from stand.procedure.procedure import load_procedure, table_of
        from stand.recorded_run import run_id
        from stand.simulation.settings import Settings
        from stand.table.table import load_table

    loaded, unit = load_procedure(procedure), load_imu(imu)
    terms = tuple(term.strip() for term in without.split(",") if term.strip())
    chosen = load_table(table) if table else table_of(loaded)
    priors = priors_of(switched_off(unit, terms), None if true_table else chosen)
    settings = Settings(
        loaded,
        unit,
        chosen,
        site_of(loaded.entry.site, latitude, height),
        replace(loaded.entry.estimate.options(), priors=priors),
        rate,
        seed=seed,
        without=terms,
        motion=MotionKind(motion.value),
        true_table=true_table,
    )
    folder = out or (None if as_json else Path("recordings") / f"compare_{run_id(settings)}")
    asked = [name.strip() for name in methods.split(",") if name.strip()]
    with progress(f"{loaded.id}, {unit.id}, {runs} runs", as_json) as report:
        result = compare_methods(settings, runs, asked, report)
    if not as_json:  # before the picture: a folder that cannot be written costs no runs
        from stand.report.compare import table as comparison_table
        from stand.report.console import console, show

        show(console(), [comparison_table(result)])
    pictures = []
    if folder is not None:
        from stand.evaluation.heading_history import histories
        from stand.report.compare import write_picture

        with working("drawing the first run", as_json):
            found = histories(settings, [t.method for t in result.tallies])
            pictures = [write_picture(result, found, folder)]
    if as_json:
        print_json(to_json(result) | {"pictures": [str(path) for path in pictures]})
        return
    for path in pictures:
        print(path)


def _compare_published(as_json: bool) -> None:
    from stand.evaluation.published import all_figures, to_json

    with working("working out what the papers print", as_json):
        figures = all_figures()
    if as_json:
        print_json({"published": [to_json(figure) for figure in figures]})
        return
    from stand.report.compare import published_text
    from stand.report.console import console

    print(published_text(figures, console().width))


def rehearse(
    procedure: Annotated[
        str, typer.Argument(help="Catalogue id (stand list procedures) or a TOML file.")
    ],
    imu: Annotated[
        str, typer.Option(metavar="ID", help="Unit (stand list imus) or a TOML file.")
    ] = "stim300",
    table: Annotated[
        str | None, typer.Option(metavar="ID", help="Table (stand list tables) or a TOML file.")
    ] = None,
    latitude: LatitudeOption = None,
    height: HeightOption = None,
    rate: Annotated[int, typer.Option(metavar="HZ", help="Sample rate, 1 to 10000 Hz.")] = 200,
    revision: Annotated[
        str, typer.Option(metavar="NAME", help="Of the unit, where limits depend on it.")
    ] = "",
    terms: Annotated[
        str, typer.Option(metavar="N,B,K,Q,R", help="Allan terms that the rests are to show.")
    ] = "",
    verify: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            help="Simulate N runs, each with a unit, table and sway of its own, and set what they "
            "come to beside the predictions. Ctrl-C ends it with the runs made so far.",
        ),
    ] = None,
    seed: Annotated[
        int, typer.Option(metavar="N", help="Of a sway that is drawn, and of all runs.")
    ] = 0,
    motion: Annotated[
        MotionChoice,
        typer.Option(help="Of --verify: joints as planned, or as simulated motors make them."),
    ] = MotionChoice.ideal,
    report: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Write a page, JSON and JUnit XML there.")
    ] = None,
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> None:
    """Before the table is booked: can it run, how long, how accurate, why, and what would help.

    No sensor is simulated but for --verify. Exit code 0: feasible, and what [require] asks is
    predicted; 1: not, nobody can say, or the runs contradict a prediction.

    Example: stand rehearse two-position --imu hg9900 --table precision --latitude 60

    On all cores, prediction beside simulation: stand rehearse two-position --verify 200 --rate 50
    """
    with quick_imports():
        from dataclasses import replace

        from stand.imu import load_imu
        from stand.motion.polynomial import MotionKind
        from stand.procedure.procedure import load_procedure, table_of
        from stand.rehearsal.advice import with_advice
        from stand.rehearsal.rehearse import request
        from stand.rehearsal.result import Verdict
        from stand.rehearsal.result_json import rehearsal_json
        from stand.simulation.settings import HIGHEST_RATE_HZ
        from stand.table.table import load_table

    asked_terms = tuple(term.strip().upper() for term in terms.split(",") if term.strip())
    for term in asked_terms:
        if term not in ALLAN_TERMS:
            raise unknown("term", term, ALLAN_TERMS)
    if not 1 <= rate <= HIGHEST_RATE_HZ:
        raise StandError(f"--rate {rate}: must be 1 to {HIGHEST_RATE_HZ} Hz")
    loaded, unit = load_procedure(procedure), load_imu(imu)
    chosen = load_table(table) if table else table_of(loaded)
    asked = request(loaded, unit, chosen, site_of(loaded.entry.site, latitude, height), rate)
    if seed < 0:
        raise StandError(f"--seed {seed}: must be 0 or more")
    asked = replace(
        asked,
        revision=revision,
        allan_terms=asked_terms,
        seed=seed,
        motion=MotionKind(motion.value),
    )
    if verify is not None and verify < 1:
        raise StandError(f"--verify {verify}: must be 1 or more")
    if report is not None and not force:
        from stand.report.page import refuse_existing
        from stand.report.rehearsal import JSON, JUNIT, PAGE

        refuse_existing([report / name for name in (PAGE, JSON, JUNIT)], "--report")
    with working("rehearsing", as_json):
        result = with_advice(asked)
    if verify is not None:
        from stand.rehearsal.verify import with_verification

        with progress(f"{loaded.id}, {unit.id}, {verify} runs", as_json) as done:
            result = with_verification(result, asked, verify, done)
    runs = result.verification
    if as_json:
        print_json(rehearsal_json(result))
    else:
        from stand.report.console import console, show
        from stand.report.rehearsal_tables import headline, tables

        out = console()
        out.print(headline(result), markup=False, soft_wrap=True)
        show(out, tables(result))
    if report is not None:  # after the answer: a folder that cannot be written costs no runs
        from stand.report.rehearsal import write_report

        with working("writing the report", as_json):
            written = write_report(result, report, force=force)
        if not as_json:
            for path in written:
                print(path)
    if runs is not None and runs.interrupted:
        raise Stopped(f"interrupted: {runs.done} of {runs.asked} runs were made")
    if result.verdict is not Verdict.PASS:
        raise typer.Exit(1)


def export(
    procedure: Annotated[
        str, typer.Argument(help="Catalogue id (stand list procedures) or a TOML file.")
    ],
    out: Annotated[Path, typer.Option(metavar="X.csv", help="The file to write.")],
    table: Annotated[
        str | None, typer.Option(metavar="ID", help="Table (stand list tables) or a TOML file.")
    ] = None,
    file_format: Annotated[str, typer.Option("--format", help="csv.")] = "csv",
    seed: Annotated[int, typer.Option(metavar="N", help="Of a sway that is drawn.")] = 0,
    force: ForceOption = False,
) -> None:
    """Demanded angle, rate and acceleration of every axis each 10 ms, for a real controller.

    The steps and their times go into X_steps.csv. A profile step reads X.csv back.

    Example: stand export two-position --table mid-class --out two-position.csv
    """
    if file_format != "csv":
        raise unknown("format", file_format, ("csv",))
    with quick_imports():
        from stand.motion.planner import plan
        from stand.physics.mjcf import describe, load_model
        from stand.procedure.procedure import load_procedure, table_of
        from stand.rehearsal.export import export as write_motion
        from stand.rehearsal.export import steps_file
        from stand.table.table import load_table

    loaded = load_procedure(procedure)
    chosen = load_table(table) if table else table_of(loaded)
    if out.name in ("", "..") or out.is_dir():
        raise StandError(f"--out {out}: must be a file")
    for path in (out, steps_file(out)):
        if path.exists() and not force:
            raise StandError(f"--out {path}: exists; --force replaces it")
    if not out.parent.is_dir():
        raise StandError(f"--out {out}: no folder {out.parent}")
    stand = describe(load_model(chosen.model))
    rows = write_motion(plan(loaded, stand, chosen, seed), out)
    print(f"{out}: {rows} rows\n{steps_file(out)}")
