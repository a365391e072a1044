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
    options_with,
    quick_imports,
    site_of,
)
from stand.cli.progress import print_json, progress
from stand.errors import StandError

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
        from dataclasses import replace

        from stand.evaluation.run_result import result_json
        from stand.imu import load_imu
        from stand.imu import without as switched_off
        from stand.imu.priors import priors_of
        from stand.motion.polynomial import MotionKind
        from stand.physics.truth import Sampling
        from stand.procedure.procedure import load_procedure, table_of
        from stand.recorded_run import Settings, refuse_existing, run_id
        from stand.recorded_run import run as run_session
        from stand.recording import review  # noqa: F401  here rather than amid the samples
        from stand.table.table import load_table

    loaded, unit = load_procedure(procedure), load_imu(imu)
    terms = tuple(term.strip() for term in without.split(",") if term.strip())
    chosen = load_table(table) if table else table_of(loaded)
    priors = priors_of(switched_off(unit, terms), chosen, loaded.entry.rocks)
    settings = Settings(
        loaded,
        unit,
        chosen,
        site_of(loaded.entry.site, latitude, height),
        replace(options_with(loaded.entry.estimate.options(), sequences), priors=priors),
        rate,
        Sampling(sampling.value),
        seed,
        terms,
        MotionKind(motion.value),
        true_table,
    )
    folder = _folder(out) if out else Path("recordings") / run_id(settings)
    refuse_existing(folder, force)
    with progress(f"{settings.procedure.id}, {settings.imu.id}", as_json) as report:
        result = run_session(settings, folder, force, report)
    if as_json:
        print_json(result_json(result) | {"out": str(folder)})
    else:
        _show_run(result)


def _folder(out: Path) -> Path:
    """Where to record; a link is followed, so that --force replaces what it leads to."""
    if out.name in ("", ".."):
        raise StandError(f"--out {out}: must name a folder of its own")
    try:
        return out.resolve() if out.is_symlink() else out
    except (OSError, RuntimeError) as error:
        raise StandError(f"--out {out}: links that lead in a circle") from error


def _show_run(result: RunResult) -> None:
    from rich.markup import escape

    from stand.report.console import console, show
    from stand.report.document import ANGLE_NOTE, motion_table, refusal_lines, score_tables

    out = console()
    s = result.settings
    out.print(
        f"[bold]{escape(s.procedure.entry.title)}[/bold]: {escape(s.imu.title)}, seed {s.seed}, "
        f"{result.samples} samples at {s.rate_hz} Hz ({s.sampling.value}), "
        f"{s.motion.value} motion of {escape(s.table.title)}\n"
    )
    if result.records:
        show(out, [motion_table(result.records)])
    show(out, score_tables(result.scores))
    if result.scores:
        out.print(ANGLE_NOTE, style="dim")
    for line in refusal_lines(result.refusals):
        out.print(line, style="bold yellow", markup=False)
    where = escape(str(result.out))
    out.print(f"\nRecorded in [bold]{where}[/bold]: run.mcap, run.rrd, result.json", soft_wrap=True)
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
        from stand.evaluation.drive_result import DriveSettings, result_json
        from stand.folder import refuse_existing
        from stand.imu import load_imu
        from stand.recorded_drive import run_drive, run_id
        from stand.vehicle.scenario import load_drive

    settings = DriveSettings(load_drive(scenario), load_imu(imu), rate, seed)
    folder = _folder(out) if out else Path("recordings") / run_id(settings)
    refuse_existing(folder, force)
    with progress(f"{settings.drive.id}, {settings.imu.id}", as_json) as report:
        result = run_drive(settings, folder, force, report)
    if as_json:
        print_json(result_json(result) | {"out": str(folder)})
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
