"""The `stand` command: the only module that talks to a person.

Heavy imports (MuJoCo, SciPy, rerun) wait inside the commands, so that `--help` answers at once.
"""

from __future__ import annotations

import gc
import json
import shlex
import signal
import sys
from contextlib import AbstractContextManager, contextmanager, nullcontext
from enum import StrEnum
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from stand import __version__
from stand.errors import StandError, unknown
from stand.physics import set_driver_aside

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from alignment import Options, Site
    from stand.driven import DriveResult
    from stand.log import Vehicle
    from stand.procedure import SiteEntry
    from stand.score import Refusal, Score
    from stand.session import RunResult

INTERRUPTED = 130  # 128 + SIGINT, as shells have it

app = typer.Typer(
    name="stand",
    help="Virtual IMU test stand: rehearse a turntable test, record it, align from readings.\n\n"
    "Start with: stand run six-position",
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


ALLAN_TERMS = ("N", "B", "K", "Q", "R")


class SamplingChoice(StrEnum):
    """See `stand.physics.truth.Sampling`."""

    mean = "mean"
    instant = "instant"


class MotionChoice(StrEnum):
    """See `stand.motion.MotionKind`."""

    ideal = "ideal"
    servo = "servo"


class RuleChoice(StrEnum):
    """See `alignment.angles.SequenceRule`."""

    regular = "regular"
    published = "published"


class Catalogue(StrEnum):
    """What `stand list` can list."""

    procedures = "procedures"
    imus = "imus"
    tables = "tables"
    trajectories = "trajectories"
    methods = "methods"


JsonOption = Annotated[bool, typer.Option("--json", help="Print JSON for machines, no tables.")]
LatitudeOption = Annotated[
    float | None, typer.Option(metavar="DEG", help="Geodetic latitude; else the file's own.")
]
HeightOption = Annotated[
    float | None, typer.Option(metavar="M", help="Height above the ellipsoid; else the file's own.")
]
ForceOption = Annotated[bool, typer.Option("--force", help="Replace what is there.")]
RuleOption = Annotated[
    RuleChoice | None,
    typer.Option(
        help="Which order of turns each position is read by: 'regular' is never singular in the "
        "six positions, 'published' is as printed in the source."
    ),
]


class _Stopped(Exception):
    """Ctrl-C ended the work early, and what was done is told."""


def main() -> None:
    """Entry point: known faults become one line and exit code 2."""
    set_driver_aside()
    signal.signal(signal.SIGTERM, _interrupt)
    sys.exit(guarded(lambda: app(standalone_mode=False)))


def _interrupt(signum: int, frame: object) -> None:
    raise KeyboardInterrupt


def guarded(command: Callable[[], Any]) -> int:
    """Run a command; exit code 0, 2 for bad input, 130 when interrupted."""
    try:
        code = command()
    except typer.TyperException as error:
        return _complain(error.format_message())
    except (typer.Abort, KeyboardInterrupt):
        code = INTERRUPTED
    except typer.Exit as stop:
        return stop.exit_code
    except _Stopped as stopped:
        return _complain(str(stopped), INTERRUPTED)
    except StandError as error:
        return _complain(str(error))
    except OSError as error:  # a full disk, a folder without permission
        named = f"{error.filename}: " if error.filename else ""
        return _complain(f"{named}{error.strerror or error}")
    except MemoryError as error:
        return _complain(f"not enough memory: {error}")
    except Exception as error:
        if type(error).__module__ != "alignment.errors":  # imported only where it was raised
            raise
        return _complain(str(error))
    if code == INTERRUPTED:  # typer turns Ctrl-C inside a command into this code
        return _complain("interrupted: nothing was written", INTERRUPTED)
    return code if isinstance(code, int) else 0


def _complain(message: str, code: int = 2) -> int:
    print(f"stand: {' '.join(message.split())}", file=sys.stderr)
    return code


def _version(wanted: bool) -> None:
    if wanted:
        print(f"stand {__version__}")
        raise typer.Exit


@app.callback(invoke_without_command=True)
def _root(
    context: typer.Context,
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    if context.invoked_subcommand is None:
        print(context.get_help())


@app.command()
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
    with _quick_imports():
        from dataclasses import replace

        from stand.imu import load_imu
        from stand.imu import without as switched_off
        from stand.motion import MotionKind
        from stand.physics.truth import Sampling
        from stand.priors import priors_of
        from stand.procedure import load_procedure, table_of
        from stand.recording import review  # noqa: F401  here rather than amid the samples
        from stand.session import Settings, refuse_existing, result_json, run_id
        from stand.session import run as run_session
        from stand.table import load_table

    loaded, unit = load_procedure(procedure), load_imu(imu)
    terms = tuple(term.strip() for term in without.split(",") if term.strip())
    chosen = load_table(table) if table else table_of(loaded)
    priors = priors_of(switched_off(unit, terms), chosen, loaded.entry.rocks)
    settings = Settings(
        loaded,
        unit,
        chosen,
        _site(loaded.entry.site, latitude, height),
        replace(_options(loaded.entry.estimate.options(), sequences), priors=priors),
        rate,
        Sampling(sampling.value),
        seed,
        terms,
        MotionKind(motion.value),
        true_table,
    )
    folder = _folder(out) if out else Path("recordings") / run_id(settings)
    refuse_existing(folder, force)
    with _progress(f"{settings.procedure.id}, {settings.imu.id}", as_json) as report:
        result = run_session(settings, folder, force, report)
    if as_json:
        _print_json(result_json(result) | {"out": str(folder)})
    else:
        _show_run(result)


def _folder(out: Path) -> Path:
    """Where to record; a link is followed, so that --force replaces what it leads to."""
    if out.name in ("", ".."):
        raise StandError(f"--out {out}: must name a folder of its own")
    return out.resolve() if out.is_symlink() else out


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


@app.command()
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
    with _quick_imports():
        from stand.drive import load_drive
        from stand.driven import DriveSettings, result_json, run_drive, run_id
        from stand.folder import refuse_existing
        from stand.imu import load_imu

    settings = DriveSettings(load_drive(scenario), load_imu(imu), rate, seed)
    folder = _folder(out) if out else Path("recordings") / run_id(settings)
    refuse_existing(folder, force)
    with _progress(f"{settings.drive.id}, {settings.imu.id}", as_json) as report:
        result = run_drive(settings, folder, force, report)
    if as_json:
        _print_json(result_json(result) | {"out": str(folder)})
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


@app.command()
def align(
    recordings: Annotated[
        list[Path],
        typer.Argument(help="MCAP files with sensor_msgs/msg/Imu, or folders of stand run."),
    ],
    method: Annotated[
        str | None,
        typer.Option(metavar="ID", help="stand list methods; else the recording's own, or triad."),
    ] = None,
    latitude: LatitudeOption = None,
    height: HeightOption = None,
    t_from: Annotated[
        float | None, typer.Option("--from", metavar="S", help="Use readings from here ...")
    ] = None,
    t_to: Annotated[float | None, typer.Option("--to", metavar="S", help="... to here.")] = None,
    topic: Annotated[
        str | None, typer.Option(help="Which IMU topic, where there are several.")
    ] = None,
    sequences: RuleOption = None,
    imu: Annotated[
        str | None,
        typer.Option(
            metavar="ID",
            help="Unit (stand list imus) or a TOML file: its data sheet's biases and scale errors "
            "enter every sigma.",
        ),
    ] = None,
    turn_joint: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="The table turns: the joint of sensor_msgs/msg/JointState whose encoder counts.",
        ),
    ] = None,
    turn_axis: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y,Z", help="Axis of that turn in the IMU's axes; else the vertical."
        ),
    ] = None,
    start_attitude: Annotated[
        str | None,
        typer.Option(
            metavar="ROLL,YAW,PITCH", help="vectors: as programmed at the first fix [deg]."
        ),
    ] = None,
    start_sigma: Annotated[
        float | None,
        typer.Option(metavar="DEG", help="vectors: how wrong that is about each axis; else 0.5."),
    ] = None,
    fix_sigma: Annotated[
        str | None,
        typer.Option(metavar="M,M/S", help="vectors: noise of the fixes; else what they state."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Estimate the attitude from recordings: ours, or any MCAP with an IMU at rest.

    Several recordings are several dwells of one unit: positions with opposite verticals also
    give a latitude free of that axis's bias. A moving vehicle's needs satellite fixes
    (sensor_msgs/msg/NavSatFix, geometry_msgs/msg/TwistWithCovarianceStamped) and --method vectors.

    Example: stand align up.mcap down.mcap --method triad

    Readings alone tell noise; a data sheet tells the rest: stand align log.mcap --imu stim300

    A turning table's log: stand align log.mcap --method carousel --turn-joint yaw --latitude 48.5
    """
    from alignment import ESTIMATORS
    from alignment.units import DEG
    from stand.log import load_log
    from stand.score import evaluate_each, score_to_json, spread_to_json, spreads

    if method is not None and method not in ESTIMATORS:
        raise unknown("method", method, ESTIMATORS)
    vehicle = _vehicle(method == "vectors", start_attitude, start_sigma, fix_sigma)
    axis = None if turn_axis is None else _numbers("--turn-axis", turn_axis, 3)
    with _working("reading", as_json):
        logs = [
            load_log(_file_in(p, "run.mcap"), topic, t_from, t_to, turn_joint, axis, vehicle)
            for p in recordings
        ]
    first = logs[0]
    methods = [method] if method else first.methods
    site = _with(first.site, latitude, height)
    options = _stated(_options(first.options, sequences), imu)
    dwells = [d for log in logs for d in log.dwells]
    truths = [t for log in logs for t in log.truths]
    _check_labels([d.label for d in dwells])
    for name in methods:
        if name not in ESTIMATORS:  # a recording made by a newer version
            raise StandError(f"{first.path}: {unknown('method', name, ESTIMATORS)}")
        if ESTIMATORS[name].needs_latitude and site.latitude is None:
            raise StandError(
                f"{recordings[0]}: method {name} needs the latitude: give --latitude DEG"
            )
    with _working("estimating", as_json):
        scores, refusals = evaluate_each(dwells, truths, site, options, methods)
    if refusals and not scores:
        raise StandError(f"{first.path}: {refusals[0].reason}")
    if not as_json:
        _show_scores(scores, refusals)
        return
    _print_json(
        {
            "recordings": [log.path for log in logs],
            "topic": first.topic,
            "latitude_deg": None if site.latitude is None else site.latitude / DEG,
            "estimates": [score_to_json(s) for s in scores],
            "spreads": [spread_to_json(s) for s in spreads(scores)],
            "refusals": [{"method": r.method, "reason": r.reason} for r in refusals],
        }
    )


def _vehicle(
    asked: bool, start: str | None, start_sigma: float | None, fix_sigma: str | None
) -> Vehicle | None:
    """What the command line says of a moving vehicle; None for nothing, and not `asked` for."""
    from alignment.angles import C_nb_from_angles
    from alignment.angles import Sequence as Turns
    from alignment.units import DEG
    from stand.log import Vehicle

    if (start, start_sigma, fix_sigma) == (None, None, None):
        return Vehicle() if asked else None
    C_nb, noise = None, (None, None)
    if start is not None:
        roll, yaw, pitch = (a * DEG for a in _numbers("--start-attitude", start, 3))
        C_nb = C_nb_from_angles(Turns.YAW_PITCH_ROLL, roll, yaw, pitch)
    if start_sigma is not None and not 0 < start_sigma <= 180:
        raise StandError(f"--start-sigma {start_sigma:g}: must be above 0, at most 180 deg")
    if fix_sigma is not None:
        noise = _numbers("--fix-sigma", fix_sigma, 2)
        if min(noise) <= 0:
            raise StandError(f"--fix-sigma {fix_sigma}: both must be above 0")
    return Vehicle(C_nb, None if start_sigma is None else start_sigma * DEG, *noise)


def _numbers(option: str, text: str, count: int) -> tuple[float, ...]:
    try:
        values = tuple(float(part) for part in text.split(","))
    except ValueError:
        values = ()
    if len(values) != count or not all(map(isfinite, values)):
        raise StandError(f"{option} {text}: must be {count} numbers with commas between")
    return values


def _show_scores(scores: Sequence[Score], refusals: Sequence[Refusal]) -> None:
    from stand.report.console import console, show
    from stand.report.document import ANGLE_NOTE, refusal_lines, score_tables

    out = console()
    show(out, score_tables(scores))
    for line in refusal_lines(refusals):
        out.print(line, style="bold yellow", markup=False)
    out.print(ANGLE_NOTE, style="dim")


def _check_labels(labels: Sequence[str]) -> None:
    for label in labels:
        if labels.count(label) > 1:
            raise StandError(f"two dwells are called {label!r}: give each recording its own name")


@app.command()
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
    with _quick_imports():
        from dataclasses import replace

        from stand.compare import compare as compare_methods
        from stand.compare import to_json
        from stand.imu import load_imu
        from stand.imu import without as switched_off
        from stand.motion import MotionKind
        from stand.priors import priors_of
        from stand.procedure import load_procedure, table_of
        from stand.session import run_id
        from stand.simulation import Settings
        from stand.table import load_table

    loaded, unit = load_procedure(procedure), load_imu(imu)
    terms = tuple(term.strip() for term in without.split(",") if term.strip())
    chosen = load_table(table) if table else table_of(loaded)
    priors = priors_of(switched_off(unit, terms), None if true_table else chosen)
    settings = Settings(
        loaded,
        unit,
        chosen,
        _site(loaded.entry.site, latitude, height),
        replace(loaded.entry.estimate.options(), priors=priors),
        rate,
        seed=seed,
        without=terms,
        motion=MotionKind(motion.value),
        true_table=true_table,
    )
    folder = out or (None if as_json else Path("recordings") / f"compare_{run_id(settings)}")
    asked = [name.strip() for name in methods.split(",") if name.strip()]
    with _progress(f"{loaded.id}, {unit.id}, {runs} runs", as_json) as report:
        result = compare_methods(settings, runs, asked, report)
    if not as_json:  # before the picture: a folder that cannot be written costs no runs
        from stand.report.compare import table as comparison_table
        from stand.report.console import console, show

        show(console(), [comparison_table(result)])
    pictures = []
    if folder is not None:
        from stand.history import histories
        from stand.report.compare import write_picture

        with _working("drawing the first run", as_json):
            found = histories(settings, [t.method for t in result.tallies])
            pictures = [write_picture(result, found, folder)]
    if as_json:
        _print_json(to_json(result) | {"pictures": [str(path) for path in pictures]})
        return
    for path in pictures:
        print(path)


def _compare_published(as_json: bool) -> None:
    from stand.published import all_figures, to_json

    with _working("working out what the papers print", as_json):
        figures = all_figures()
    if as_json:
        _print_json({"published": [to_json(figure) for figure in figures]})
        return
    from stand.report.compare import published_text
    from stand.report.console import console

    print(published_text(figures, console().width))


@app.command()
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
    report: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Write a page, JSON and JUnit XML there.")
    ] = None,
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> None:
    """Before the table is booked: can it run, how long, how accurate, why, and what would help.

    No sensor is simulated but for --verify. Exit code 0: feasible, and what [require] asks is
    predicted; 1: not.

    Example: stand rehearse two-position --imu hg9900 --table precision --latitude 60

    On all cores, prediction beside simulation: stand rehearse two-position --verify 200 --rate 50
    """
    with _quick_imports():
        from dataclasses import replace

        from stand.imu import load_imu
        from stand.procedure import load_procedure, table_of
        from stand.rehearsal.advice import with_advice
        from stand.rehearsal.rehearse import request
        from stand.rehearsal.result import Verdict, rehearsal_json
        from stand.simulation import HIGHEST_RATE_HZ
        from stand.table import load_table

    asked_terms = tuple(term.strip().upper() for term in terms.split(",") if term.strip())
    for term in asked_terms:
        if term not in ALLAN_TERMS:
            raise unknown("term", term, ALLAN_TERMS)
    if not 1 <= rate <= HIGHEST_RATE_HZ:
        raise StandError(f"--rate {rate}: must be 1 to {HIGHEST_RATE_HZ} Hz")
    loaded, unit = load_procedure(procedure), load_imu(imu)
    chosen = load_table(table) if table else table_of(loaded)
    asked = request(loaded, unit, chosen, _site(loaded.entry.site, latitude, height), rate)
    asked = replace(asked, revision=revision, allan_terms=asked_terms)
    if verify is not None and verify < 1:
        raise StandError(f"--verify {verify}: must be 1 or more")
    if report is not None and not force:
        from stand.report.page import refuse_existing
        from stand.report.rehearsal import JSON, JUNIT, PAGE

        refuse_existing([report / name for name in (PAGE, JSON, JUNIT)], "--report")
    with _working("rehearsing", as_json):
        result = with_advice(asked)
    if verify is not None:
        from stand.rehearsal.verify import with_verification

        with _progress(f"{loaded.id}, {unit.id}, {verify} runs", as_json) as done:
            result = with_verification(result, asked, verify, done)
    runs = result.verification
    if as_json:
        _print_json(rehearsal_json(result))
    else:
        from stand.rehearsal.listing import headline, tables
        from stand.report.console import console, show

        out = console()
        out.print(headline(result), markup=False, soft_wrap=True)
        show(out, tables(result))
    if report is not None:  # after the answer: a folder that cannot be written costs no runs
        from stand.report.rehearsal import write_report

        with _working("writing the report", as_json):
            written = write_report(result, report, force=force)
        if not as_json:
            for path in written:
                print(path)
    if runs is not None and runs.interrupted:
        raise _Stopped(f"interrupted: {runs.done} of {runs.asked} runs were made")
    if result.verdict is not Verdict.PASS:
        raise typer.Exit(1)


@app.command()
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
    with _quick_imports():
        from stand.physics.mjcf import describe, load_model
        from stand.plan import plan
        from stand.procedure import load_procedure, table_of
        from stand.rehearsal.export import export as write_motion
        from stand.rehearsal.export import steps_file
        from stand.table import load_table

    loaded = load_procedure(procedure)
    chosen = load_table(table) if table else table_of(loaded)
    if out.name in ("", "..") or out.is_dir():
        raise StandError(f"--out {out}: must be a file")
    for path in (out, steps_file(out)):
        if path.exists() and not force:
            raise StandError(f"--out {path}: exists; --force replaces it")
    if not out.parent.is_dir():
        raise StandError(f"--out {out}: no folder {out.parent}")
    rows = write_motion(plan(loaded, describe(load_model()), chosen, seed), out)
    print(f"{out}: {rows} rows\n{steps_file(out)}")


@app.command("import")
def import_log(
    file: Annotated[Path, typer.Argument(help="A foreign log.")],
    columns: Annotated[
        str,
        typer.Option(help="The file's columns in order, out of t,gx,gy,gz,ax,ay,az; - skips one."),
    ],
    gyro_unit: Annotated[str, typer.Option(help="deg/s, rad/s or deg/h.")],
    accel_unit: Annotated[str, typer.Option(help="m/s^2, g or mg.")],
    out: Annotated[Path, typer.Option(metavar="X.mcap", help="The recording to write.")],
    time_unit: Annotated[str, typer.Option(help="s, ms, us or ns.")] = "s",
    file_format: Annotated[
        str | None,
        typer.Option(
            "--format", help="csv, or f8le (rows of little-endian float64); else by ending."
        ),
    ] = None,
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> None:
    """Bring a foreign log into an MCAP that stand align and every ROS 2 tool reads.

    Example: stand import log.csv --columns t,gx,gy,gz,ax,ay,az --gyro-unit deg/s
    --accel-unit m/s^2 --out log.mcap
    """
    from stand.log import RUN
    from stand.recording.foreign import load_foreign
    from stand.recording.interchange.writer import write_imu_log

    if out.exists() and not force:
        raise StandError(f"--out {out}: exists; --force replaces it")
    if out.is_dir() or out.resolve() == file.resolve():
        raise StandError(f"--out {out}: must be a new file")
    if not out.parent.is_dir():
        raise StandError(f"--out {out}: no folder {out.parent}")
    with _working("importing", as_json):
        log = load_foreign(file, columns, gyro_unit, accel_unit, time_unit, file_format)
        record = {
            "source": file.name,
            "columns": columns,
            "gyro_unit": gyro_unit,
            "accel_unit": accel_unit,
            "time_unit": time_unit,
            "epoch_ns": str(log.epoch_ns),
            "stand_version": __version__,
        }
        beside = out.with_name(f".{out.name}.partial")
        try:
            write_imu_log(
                beside,
                t_ns=log.t_ns,
                w_ib_b=log.w_ib_b,
                f_b=log.f_b,
                epoch_ns=log.epoch_ns,
                metadata={RUN: record},
            )
            beside.replace(out)
        finally:
            beside.unlink(missing_ok=True)
    _show_import(out, log, as_json)


def _show_import(out: Path, log: Any, as_json: bool) -> None:
    import numpy as np

    from alignment.units import DEG_PER_HOUR

    steps = np.diff(log.t_ns) * 1e-9
    rate = np.linalg.norm(log.w_ib_b.mean(axis=0)) / DEG_PER_HOUR
    force = np.linalg.norm(log.f_b.mean(axis=0))
    facts: dict[str, Any] = {
        "out": str(out),
        "samples": len(log.t_ns),
        "t_from_s": float(log.t_ns[0] * 1e-9),
        "t_to_s": float(log.t_ns[-1] * 1e-9),
        "rate_hz": float(1 / steps.mean()),
        "longest_gap_s": float(steps.max()),
        "mean_rate_deg_h": float(rate),
        "mean_force_m_s2": float(force),
    }
    if as_json:
        _print_json(facts)
        return
    print(
        f"{out}: {facts['samples']} samples from {facts['t_from_s']:.3f} to "
        f"{facts['t_to_s']:.3f} s, {facts['rate_hz']:.4g} Hz (longest step "
        f"{facts['longest_gap_s'] * 1e3:.3g} ms)\n"
        f"mean rate {rate:.4g} deg/h (Earth: 15.04), mean specific force {force:.5f} m/s^2\n"
        f"Align it: stand align {shlex.quote(str(out))}"
    )


@app.command("list")
def list_entries(
    what: Annotated[
        Catalogue, typer.Argument(help="procedures, imus, tables, trajectories, methods.")
    ],
    as_json: JsonOption = False,
) -> None:
    """List the catalogue: what can be run, simulated, estimated."""
    from stand.report.listing import listing

    entries = listing(what.value)
    if as_json:
        _print_json(entries)
        return
    from stand.report.console import console, show
    from stand.report.document import TableData

    columns = tuple(entries[0])
    rows = tuple(tuple("" if e[c] is None else str(e[c]) for c in columns) for e in entries)
    show(console(), [TableData(f"{what.value}", columns, rows)])


@app.command()
def allan(
    recording: Annotated[
        Path, typer.Argument(help="An MCAP with sensor_msgs/msg/Imu at rest, or a folder of run.")
    ],
    imu: Annotated[
        str | None,
        typer.Option(metavar="ID", help="Data sheet to compare with; else the recording's own."),
    ] = None,
    terms: Annotated[
        str, typer.Option(metavar="N,B,K,Q,R", help="Refuse unless the record shows these.")
    ] = "",
    topic: Annotated[
        str | None, typer.Option(help="Which IMU topic, where there are several.")
    ] = None,
    t_from: Annotated[
        float | None, typer.Option("--from", metavar="S", help="Use readings from here ...")
    ] = None,
    t_to: Annotated[float | None, typer.Option("--to", metavar="S", help="... to here.")] = None,
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="For the PNG and the page; default: beside the file."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Allan analysis of a unit at rest: noise terms with intervals, against its data sheet.

    Prints a table and leaves a picture and a page; with --json only if --out is given. A term
    that the record does not show is named with the length that would show it.

    Example: stand allan static.mcap --imu stim300
    """
    from stand.allan import analyse, to_json

    file = _file_in(recording, "run.mcap")
    asked = [term.strip().upper() for term in terms.split(",") if term.strip()]
    for term in asked:
        if term not in ALLAN_TERMS:
            raise unknown("term", term, ALLAN_TERMS)
    with _working("analysing", as_json):
        report = analyse(file, topic, t_from, t_to, imu, asked)
    pictures = []
    if out is not None or not as_json:
        from stand.report.allan import write_pictures

        folder = out or file.with_name(f"{file.stem}_allan")
        with _working("drawing", as_json):
            pictures = write_pictures(report, folder)
    if as_json:
        _print_json(to_json(report) | {"pictures": [str(path) for path in pictures]})
        return
    from stand.report.allan import tables
    from stand.report.console import console, show

    show(console(), tables(report))
    for path in pictures:
        print(path)


@app.command()
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

    with _working("drawing", False):
        page = write_run_page(recording, out, force=force)
    print(page)


@app.command("check-imu")
def check_imu(
    unit: Annotated[str, typer.Argument(help="Catalogue id (stand list imus) or a TOML file.")],
    as_json: JsonOption = False,
) -> None:
    """Look over a preset: unit slips, impossible pairs, missing sources.

    Exit code 0 when nothing worse than a warning was found, 1 otherwise.

    Example: stand check-imu my-unit.toml
    """
    from dataclasses import asdict

    from stand import catalogue
    from stand.imu.lint import findings_table, lint

    source = catalogue.find("imus", "imu", unit)
    findings = lint(source)
    if as_json:
        _print_json({"imu": source.name, "findings": [asdict(f) for f in findings]})
    elif findings:
        from stand.report.console import console, show

        show(console(), [findings_table(findings)])
    else:
        print(f"{source.name}: nothing to object to")
    if any(f.severity == "error" for f in findings):
        raise typer.Exit(1)


@app.command()
def view(
    recording: Annotated[Path, typer.Argument(help="Folder of stand run, an .rrd or an .mcap.")],
) -> None:
    """Open a recording in the rerun viewer."""
    from stand.recording.viewer import view as open_viewer

    open_viewer(_file_in(recording, "run.rrd"))


def _file_in(path: Path, name: str) -> Path:
    return path / name if path.is_dir() else path


@contextmanager
def _quick_imports() -> Iterator[None]:
    """Import without garbage collection: modules live to the end, looking them over costs 0.5 s."""
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        gc.enable()


def _site(entry: SiteEntry, latitude: float | None, height: float | None) -> Site:
    return _with(entry.site(), latitude, height)


def _with(site: Site, latitude: float | None, height: float | None) -> Site:
    """The site with what the command line says instead."""
    from dataclasses import replace

    from alignment.units import DEG

    if latitude is not None:
        if not abs(latitude) <= 90:
            raise StandError(f"--latitude {latitude:g}: must be -90 to 90 deg")
        site = replace(site, latitude=latitude * DEG)
    if height is not None:
        if not (isfinite(height) and -1000 <= height <= 10000):
            raise StandError(f"--height {height:g}: must be -1000 to 10000 m")
        site = replace(site, height=height)
    return site


def _options(options: Options, sequences: RuleChoice | None) -> Options:
    from dataclasses import replace

    from alignment.angles import SequenceRule

    return options if sequences is None else replace(options, rule=SequenceRule(sequences.value))


def _stated(options: Options, imu: str | None) -> Options:
    """The options with what a unit's data sheet says; of the table what the recording says."""
    if imu is None:
        return options
    from dataclasses import replace

    from stand.imu import load_imu
    from stand.priors import priors_of

    known = options.priors
    priors = replace(
        priors_of(load_imu(imu), None),
        turn=known.turn,
        seat=known.seat,
        nominal=known.nominal,
        lever_arm=known.lever_arm,
    )
    return replace(options, priors=priors)


def _print_json(value: Any) -> None:
    print(json.dumps(value, indent=1, allow_nan=False))


class _Bar:
    """A progress bar on stderr, drawn only for a person."""

    def __init__(self, title: str) -> None:
        from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

        from stand.report.console import console

        self._progress = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            TextColumn("{task.percentage:3.0f} %"),
            TimeRemainingColumn(),
            console=console(stderr=True),
            transient=True,
        )
        self._task = self._progress.add_task(title, total=1.0)

    def __enter__(self) -> Callable[[float], None]:
        self._progress.start()
        return lambda done: self._progress.update(self._task, completed=done)

    def __exit__(self, *exc: object) -> None:
        self._progress.stop()


def _progress(title: str, quiet: bool) -> AbstractContextManager[Callable[[float], None]]:
    if quiet or not sys.stderr.isatty():
        return nullcontext(lambda done: None)
    return _Bar(title)


def _working(what: str, quiet: bool) -> AbstractContextManager[Any]:
    if quiet or not sys.stderr.isatty():
        return nullcontext()
    from stand.report.console import console

    return console(stderr=True).status(what)
