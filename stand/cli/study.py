"""Commands before a test, and on its outcome: `stand compare`, `rehearse`, `export`."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from stand.cli.command import refuse_given
from stand.cli.log_options import takes_log_form
from stand.cli.options import (
    ForceOption,
    HeightOption,
    JsonOption,
    KeepOption,
    LatitudeOption,
    MotionChoice,
    SchedulerOption,
    quick_imports,
    words,
)
from stand.cli.progress import Stopped, print_json, progress, working

if TYPE_CHECKING:
    from stand.recording.log_form import LogForm


_RUNS = {
    *("table", "runs", "motion", "true_table", "without", "height", "rate", "seed"),
    *("keep", "scheduler", "out"),
}
"""What only runs have that are simulated."""


@takes_log_form
def compare(
    context: typer.Context,
    procedure: Annotated[
        str | None,
        typer.Argument(
            metavar="PROCEDURE|A",
            help="Catalogue id (stand list procedures) or a TOML file; or a recording.",
        ),
    ] = None,
    other: Annotated[
        Path | None, typer.Argument(metavar="B", help="Another recording of that procedure.")
    ] = None,
    *,
    form: LogForm,
    imu: Annotated[
        str | None,
        typer.Option(
            metavar="ID",
            help="Unit (stand list imus) or a TOML file; else stim300, or as recorded.",
        ),
    ] = None,
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
    stretches: Annotated[
        Path | None,
        typer.Option(metavar="X.toml", help="Of recordings that bring no stretches of their own."),
    ] = None,
    latitude: LatitudeOption = None,
    height: HeightOption = None,
    rate: Annotated[int, typer.Option(metavar="HZ", help="Sample rate, 1 to 10000 Hz.")] = 20,
    seed: Annotated[int, typer.Option(metavar="N", help="Of the first run.")] = 0,
    keep: KeepOption = None,
    scheduler: SchedulerOption = None,
    published: Annotated[
        bool,
        typer.Option("--published", help="Print published figures beside ours, with verdicts."),
    ] = False,
    only: Annotated[
        str,
        typer.Option(
            metavar="PLACE", help="Of --published: one paper or place, as 'S4 formula (13)'."
        ),
    ] = "",
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help="For the picture; default: recordings/compare_PROCEDURE_IMU_seedN. With "
            "--published: a page with its pictures.",
        ),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Set methods side by side on identical data: error, sigma, floor, NEES, run time.

    Leaves a picture of heading error over time in the first run; with --json only if --out is
    given. On all cores; the numbers do not depend on how many there are.

    Example: stand compare two-position --imu ring-laser --runs 200 --methods triad,two-position

    What the papers print, beside what comes out here: stand compare --published

    Two recordings of one procedure, simulated or real: estimates, means per stretch, noise.
    stand compare recordings/a recordings/b

    A log of others among them is read by the last options, as stand align does.
    """
    if other is not None:
        refuse_given(context, "beside two recordings", _RUNS | {"published", "only"})
        pair = (str(procedure), other)
        _compare_recordings(pair, form, imu, words(methods), stretches, latitude, as_json)
        return
    _refuse_form(form, "compare")
    if published:
        refuse_given(
            context,
            "beside --published",
            _RUNS - {"out"} | {"imu", "methods", "stretches", "latitude"},
        )
        _compare_published(only, out, as_json)
        return
    with quick_imports():
        import stand
        from stand.evaluation.comparison import to_json

    if only:
        raise stand.StandError("--only: of --published, which is not given")
    if procedure is None:
        raise stand.StandError("compare: name a procedure (stand list procedures), or --published")
    refuse_given(context, "for a procedure, whose steps are known", {"stretches"})
    settings = stand.settings(
        procedure,
        imu or "stim300",
        table,
        latitude_deg=latitude,
        height_m=height,
        rate_hz=rate,
        seed=seed,
        without=words(without),
        motion=motion.value,
        true_table=true_table,
        methods=words(methods) or None,
    )
    with progress(f"{settings.procedure.id}, {settings.imu.id}, {runs} runs", as_json) as report:
        result = stand.compare(settings, runs, progress=report, keep=keep, scheduler=scheduler)
    if not as_json:  # before the picture: a folder that cannot be written costs no runs
        from stand.report.console import console, show

        show(console(), result.tables())
    pictures = []
    if out is not None or not as_json:
        from stand.report.compare import write_first_run

        with working("drawing the first run", as_json):
            pictures = [write_first_run(result, out)]
    if as_json:
        print_json(to_json(result) | {"pictures": [str(path) for path in pictures]})
        return
    for path in pictures:
        print(path)


def _compare_recordings(
    paths: tuple[str, Path],
    form: LogForm,
    imu: str | None,
    methods: list[str],
    stretches: Path | None,
    latitude: float | None,
    as_json: bool,
) -> None:
    from stand import api
    from stand.evaluation.side_by_side import side_by_side_json
    from stand.recording.entrance import forms_of

    with working("reading", as_json):
        a, b = (
            log
            if log.simulated or stretches is None
            else api.read(path, stretches=stretches, form=own)
            for path, own in zip(paths, forms_of(paths, form), strict=True)
            for log in (api.read(path, form=own),)
        )
    with working("estimating", as_json):
        found = api.side_by_side(a, b, methods, imu=imu, latitude_deg=latitude)
    if as_json:
        print_json(side_by_side_json(found))
        return
    from stand.report.console import console, show

    out = console()
    out.print(found.headline(), markup=False, soft_wrap=True)
    show(out, found.tables())
    for line in found.remarks():
        out.print(line, markup=False)


def _compare_published(only: str, out: Path | None, as_json: bool) -> None:
    with quick_imports():
        from stand.evaluation.published import audit, row_json

    with progress("what the papers print, and ours", as_json) as report:
        rows = audit(only, report)
    if as_json:
        print_json({"published": [row_json(row) for row in rows]})
    else:
        from stand.report.console import console
        from stand.report.published import audit_text

        print(audit_text(rows, console().width))
    if out is not None:  # after the answer: a folder that cannot be written costs no runs
        from stand.report.published import write_audit

        with working("drawing the pictures", as_json):
            written = write_audit(rows, out)
        if not as_json:
            for path in written:
                print(path)


def rehearse(
    context: typer.Context,
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
    keep: KeepOption = None,
    scheduler: SchedulerOption = None,
    propose: Annotated[
        bool,
        typer.Option("--propose", help="Look for another, shorter test that keeps [require], too."),
    ] = False,
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
        import stand
        from stand.rehearsal.result import Verdict
        from stand.rehearsal.result_json import rehearsal_json

    if verify is None:
        refuse_given(context, "without --verify N", {"motion", "keep", "scheduler"})
    settings = stand.settings(
        procedure,
        imu,
        table,
        latitude_deg=latitude,
        height_m=height,
        rate_hz=rate,
        seed=seed,
        motion=motion.value,
        revision=revision,
        allan_terms=words(terms),
    )
    if report is not None:
        from stand.report.rehearsal import refuse_report

        refuse_report(report, force)
    runs_told = "what would help" if verify is None else f"{verify} runs"
    with progress(f"{settings.procedure.id}, {settings.imu.id}, {runs_told}", as_json) as done:
        result = stand.rehearse(
            settings, verify=verify, keep=keep, scheduler=scheduler, propose=propose, progress=done
        )
    runs = result.verification
    if as_json:
        print_json(rehearsal_json(result))
    else:
        from stand.report.console import console, show

        out = console()
        out.print(result.headline(), markup=False, soft_wrap=True)
        show(out, result.tables())
    if report is not None:  # after the answer: a folder that cannot be written costs no runs
        from stand.report.rehearsal import write_report

        with working("writing the report", as_json):
            written = write_report(result, report, force=force)
        if not as_json:
            for path in written:
                print(path)
    if runs is not None and runs.interrupted:
        raise Stopped(f"interrupted: {runs.done} of {runs.requested} runs were made")
    if result.verdict is not Verdict.PASS:
        raise typer.Exit(1)


@takes_log_form
def export(
    context: typer.Context,
    what: Annotated[
        str,
        typer.Argument(
            metavar="PROCEDURE|RECORDING|X.json",
            help="Catalogue id (stand list procedures) or a TOML file; any recording or log; or "
            "calibration.json.",
        ),
    ],
    *,
    form: LogForm,
    out: Annotated[Path, typer.Option(metavar="X.csv", help="The file to write.")],
    table: Annotated[
        str | None, typer.Option(metavar="ID", help="Table (stand list tables) or a TOML file.")
    ] = None,
    out_format: Annotated[
        str | None,
        typer.Option(
            "--format",
            help="csv; of a recording also npz, mat, parquet; of a calibration toml, imu_tk, "
            "kalibr, python, c; else by --out.",
        ),
    ] = None,
    seed: Annotated[int, typer.Option(metavar="N", help="Of a sway that is drawn.")] = 0,
    topic: Annotated[
        str | None, typer.Option(help="Of a recording: which IMU topic, where there are several.")
    ] = None,
    force: ForceOption = False,
) -> None:
    """A procedure for a real controller, or the samples of a recording for other programs.

    A procedure: demanded angle, rate and acceleration of every axis each 10 ms; the steps and
    their times go into X_steps.csv. A profile step reads X.csv back.

    Example: stand export two-position --table mid-class --out two-position.csv

    A recording: time, readings, and of one of ours truth and encoder angles, a column each, with
    the unit in its name; its stretches go into X_stretches.toml, which stand align takes.

    Example: stand export recordings/sample --out sample.npz

    A calibration: the unit as a preset that stand run replays, imu_tk's matrices (.calib), Kalibr's
    YAML, or its correction as a few lines of Python or C; each file says its direction.

    Example: stand export calibration.json --out unit.toml
    """
    if what.endswith(".json"):
        _refuse_form(form, what)
        refuse_given(context, "for a calibration", {"table", "seed", "topic"})
        from stand.calibration.exports import exported as calibration_exported
        from stand.calibration.file import load_calibration

        for path in calibration_exported(load_calibration(what), out, out_format, force=force):
            print(path)
        return
    kind = out_format or out.suffix.lower().lstrip(".") or "csv"
    if _is_recording(what):
        refuse_given(context, "for a recording", {"table", "seed"})
        from stand import api
        from stand.recording.export import WRITERS, export_log

        log = api.read(what, topic=topic, form=form)
        if out_format is None:
            _check_ending(out, WRITERS)
        for path in export_log(log, out, kind, force=force):
            print(path)
        return
    _refuse_form(form, what)
    refuse_given(context, "for a procedure", {"topic"})
    with quick_imports():
        import stand
        from stand.errors import unknown
        from stand.rehearsal.export import exported, steps_file

    if out_format not in (None, "csv"):
        raise unknown("format", out_format, ("csv",))
    if out_format is None:
        _check_ending(out, ("csv",))
    rows = exported(stand.settings(what, table=table, seed=seed), out, force)
    print(f"{out}: {rows} rows\n{steps_file(out)}")


def _refuse_form(form: LogForm, what: str) -> None:
    """How a log is to be read, stated of what is none."""
    if form != type(form)():
        from stand.errors import StandError

        raise StandError(f"{what}: is no recording, but it is stated how to read a log")


def _check_ending(out: Path, kinds: Iterable[str]) -> None:
    """A file is what its name says; without an ending it is text."""
    from stand.errors import StandError

    allowed = [f".{kind}" for kind in kinds]
    if out.suffix and out.suffix.lower() not in allowed:
        raise StandError(f"--out {out}: must end in {', '.join(allowed)}, or give --format")


def _is_recording(what: str) -> bool:
    """Whether it is a path of something else than a procedure."""
    from stand.toml_files import ids

    path = Path(what)
    return path.suffix != ".toml" and what not in ids("procedures") and path.exists()
