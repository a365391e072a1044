"""Commands that record: `stand run`, `stand drive`."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from stand.cli.options import (
    ForceOption,
    HeightOption,
    JsonOption,
    LatitudeOption,
    MotionChoice,
    RuleOption,
    SamplingChoice,
    quick_imports,
    words,
)
from stand.cli.progress import print_json, progress, tell_left_behind

if TYPE_CHECKING:
    from stand.evaluation.drive_result import DriveResult
    from stand.evaluation.run_result import RunResult


def run(
    procedure: Annotated[
        str, typer.Argument(help="Catalogue id (stand list procedures) or a TOML file.")
    ],
    imu: Annotated[
        str, typer.Option(metavar="ID", help="Unit (stand list imus) or a TOML file.")
    ] = "stim300",
    table: Annotated[
        str | None, typer.Option(metavar="ID", help="Table (stand list tables) or a TOML file.")
    ] = None,
    motion: Annotated[
        MotionChoice,
        typer.Option(help="Joints follow the plan exactly, or as simulated motors make them."),
    ] = MotionChoice.ideal,
    true_table: Annotated[
        bool, typer.Option("--true-table", help="A table without errors, whatever its class.")
    ] = False,
    latitude: LatitudeOption = None,
    height: HeightOption = None,
    rate: Annotated[int, typer.Option(metavar="HZ", help="Sample rate, 1 to 10000 Hz.")] = 200,
    sampling: Annotated[
        SamplingChoice,
        typer.Option(help="A sample is the mean over its interval, or the instant at its end."),
    ] = SamplingChoice.mean,
    sequences: RuleOption = None,
    seed: Annotated[int, typer.Option(metavar="N", help="Same seed, same bytes.")] = 0,
    without: Annotated[
        str,
        typer.Option(metavar="TERMS", help="Switch error terms off: white-noise,range ..."),
    ] = "",
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Default: recordings/PROCEDURE_IMU_seedN."),
    ] = None,
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> None:
    """Simulate a procedure on the stand, record it, estimate, and score against the truth.

    Leaves run.mcap (every sample, ROS 2), run.rrd (review: stand view DIR) and result.json.

    Example: stand run six-position --imu ring-laser --latitude 51.08 --seed 3

    As a real table would: stand run carousel --motion servo --table mid-class
    """
    with quick_imports():
        import stand
        from stand.evaluation.run_result import result_json
        from stand.folder import recording_folder
        from stand.recording.reviewing import can_review
        from stand.simulation.settings import run_id

        reviewed = can_review()  # imports rerun here rather than amid the samples

    settings = stand.settings(
        procedure,
        imu,
        table,
        latitude_deg=latitude,
        height_m=height,
        rate_hz=rate,
        sampling=sampling.value,
        seed=seed,
        without=words(without),
        motion=motion.value,
        true_table=true_table,
        sequences=None if sequences is None else sequences.value,
    )
    tell_left_behind(recording_folder(out, run_id(settings)))
    with progress(f"{settings.procedure.id}, {settings.imu.id}", as_json) as report:
        result = stand.run(settings, out, force=force, progress=report)
    if as_json:
        print_json(result_json(result) | {"out": str(result.out)})
    else:
        show_run(result, reviewed)


def show_run(result: RunResult, reviewed: bool) -> None:
    """What a run came to, for a person."""
    from rich.markup import escape

    from stand.recording.reviewing import MISSING
    from stand.report.console import console, show
    from stand.report.document import ANGLE_NOTE, motion_table, refusal_lines, score_tables
    from stand.report.judged import judged

    out = console()
    s = result.settings
    out.print(
        f"[bold]{escape(s.procedure.entry.title)}[/bold]: {escape(s.imu.title)}, seed {s.seed}, "
        f"{result.samples} samples at {s.rate_hz} Hz ({s.sampling.value}), "
        f"{s.motion.value} motion of {escape(s.table.title)}\n"
    )
    verdict = judged(result.scores, result.refusals, s.procedure.entry.require, s.imu, s.revision)
    if result.scores:
        style = {"good": "bold green", "bad": "bold red", "open": "bold yellow"}
        out.print(verdict.word, style=style.get(verdict.grade, "bold"))
        for line in verdict.lines:
            out.print(line, markup=False)
        out.print()
    if result.records:
        show(out, [motion_table(result.records)])
    show(out, score_tables(result.scores, s.imu))
    if result.scores:
        out.print(ANGLE_NOTE, style="dim")
    for line in refusal_lines(result.refusals):
        out.print(line, style="bold yellow", markup=False)
    where = escape(str(result.out))
    files = "run.mcap, run.rrd, result.json" if reviewed else "run.mcap, result.json"
    out.print(f"\nRecorded in [bold]{where}[/bold]: {files}", soft_wrap=True)
    if not reviewed:
        out.print(MISSING, markup=False, soft_wrap=True)
        return
    out.print(f"Review it: stand view {escape(shlex.quote(str(result.out)))}", soft_wrap=True)


def drive(
    scenario: Annotated[
        str, typer.Argument(help="Catalogue id (stand list trajectories) or a TOML file.")
    ],
    imu: Annotated[
        str, typer.Option(metavar="ID", help="Unit (stand list imus) or a TOML file.")
    ] = "stim300",
    rate: Annotated[int, typer.Option(metavar="HZ", help="Sample rate, 20 to 10000 Hz.")] = 200,
    seed: Annotated[int, typer.Option(metavar="N", help="Same seed, same bytes.")] = 0,
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Default: recordings/SCENARIO_IMU_seedN."),
    ] = None,
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> None:
    """Drive a unit with satellite navigation along a path; correct its attitude by vector matching.

    Three solutions on identical data: as printed, the observing form, a Kalman filter. Leaves
    run.mcap (samples and fixes, ROS 2), errors.png (error over time) and result.json.

    Example: stand drive weaving --imu stim300 --seed 3
    """
    with quick_imports():
        import stand
        from stand.evaluation.drive_result import result_json
        from stand.folder import recording_folder

    name = f"{Path(scenario).stem}_{Path(imu).stem}_seed{seed}"
    tell_left_behind(recording_folder(out, name))
    with progress(f"{Path(scenario).stem}, {Path(imu).stem}", as_json) as report:
        result = stand.drive(
            scenario, imu, rate_hz=rate, seed=seed, out=out, force=force, progress=report
        )
    if as_json:
        print_json(result_json(result) | {"out": str(result.out)})
    else:
        _show_drive(result)


def _show_drive(result: DriveResult) -> None:
    from rich.markup import escape

    from alignment.units import DEG
    from stand.report.console import console, show
    from stand.report.vectors import table

    out = console()
    s = result.settings
    out.print(
        f"[bold]{escape(s.drive.title)}[/bold]: {escape(s.imu.title)}, seed {s.seed}, "
        f"{result.samples} samples at {s.rate_hz} Hz, {len(result.fixes)} fixes; the programmed "
        f"start is off by {result.start_error / DEG:.3g} deg\n"
    )
    show(out, [table(result)])
    where = escape(str(result.out))
    out.print(
        f"\nRecorded in [bold]{where}[/bold]: run.mcap, errors.png, result.json", soft_wrap=True
    )
    out.print(f"Align it: stand align {escape(shlex.quote(str(result.out)))}", soft_wrap=True)
