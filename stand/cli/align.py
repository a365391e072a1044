"""Commands on readings: `stand align`, `stand import`, `stand allan`."""

from __future__ import annotations

import shlex
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from stand import __version__
from stand.cli.options import (
    ALLAN_TERMS,
    ForceOption,
    HeightOption,
    JsonOption,
    LatitudeOption,
    RuleOption,
    file_in,
    options_with,
    site_with,
    with_data_sheet,
)
from stand.cli.progress import print_json, working
from stand.errors import StandError, unknown

if TYPE_CHECKING:
    from collections.abc import Sequence

    from stand.evaluation.score import Refusal, Score
    from stand.recording.vehicle_log import Vehicle


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
    from stand.evaluation.score import evaluate_each, score_to_json, spread_to_json, spreads
    from stand.recording.log import load_log

    if method is not None and method not in ESTIMATORS:
        raise unknown("method", method, ESTIMATORS)
    vehicle = _vehicle(method == "vectors", start_attitude, start_sigma, fix_sigma)
    axis = None if turn_axis is None else _numbers("--turn-axis", turn_axis, 3)
    with working("reading", as_json):
        logs = [
            load_log(file_in(p, "run.mcap"), topic, t_from, t_to, turn_joint, axis, vehicle)
            for p in recordings
        ]
    first = logs[0]
    methods = [method] if method else first.methods
    site = site_with(first.site, latitude, height)
    options = with_data_sheet(options_with(first.options, sequences), imu)
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
    with working("estimating", as_json):
        scores, refusals = evaluate_each(dwells, truths, site, options, methods)
    if refusals and not scores:
        raise StandError(f"{first.path}: {refusals[0].reason}")
    if not as_json:
        _show_scores(scores, refusals)
        return
    print_json(
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
    from stand.recording.vehicle_log import Vehicle

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
    from stand.folder import file_beside
    from stand.recording.foreign import load_foreign
    from stand.recording.mcap.writer import write_imu_log
    from stand.recording.metadata import RUN

    if out.exists() and not force:
        raise StandError(f"--out {out}: exists; --force replaces it")
    if out.is_dir() or out.resolve() == file.resolve():
        raise StandError(f"--out {out}: must be a new file")
    if not out.parent.is_dir():
        raise StandError(f"--out {out}: no folder {out.parent}")
    with working("importing", as_json):
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
        with file_beside(out) as beside:
            write_imu_log(
                beside,
                t_ns=log.t_ns,
                w_ib_b=log.w_ib_b,
                f_b=log.f_b,
                epoch_ns=log.epoch_ns,
                metadata={RUN: record},
            )
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
        print_json(facts)
        return
    print(
        f"{out}: {facts['samples']} samples from {facts['t_from_s']:.3f} to "
        f"{facts['t_to_s']:.3f} s, {facts['rate_hz']:.4g} Hz (longest step "
        f"{facts['longest_gap_s'] * 1e3:.3g} ms)\n"
        f"mean rate {rate:.4g} deg/h (Earth: 15.04), mean specific force {force:.5f} m/s^2\n"
        f"Align it: stand align {shlex.quote(str(out))}"
    )


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
    from stand.evaluation.allan import analyse, to_json

    file = file_in(recording, "run.mcap")
    asked = [term.strip().upper() for term in terms.split(",") if term.strip()]
    for term in asked:
        if term not in ALLAN_TERMS:
            raise unknown("term", term, ALLAN_TERMS)
    with working("analysing", as_json):
        report = analyse(file, topic, t_from, t_to, imu, asked)
    pictures = []
    if out is not None or not as_json:
        from stand.report.allan import write_pictures

        folder = out or file.with_name(f"{file.stem}_allan")
        with working("drawing", as_json):
            pictures = write_pictures(report, folder)
    if as_json:
        print_json(to_json(report) | {"pictures": [str(path) for path in pictures]})
        return
    from stand.report.allan import tables
    from stand.report.console import console, show

    show(console(), tables(report))
    for path in pictures:
        print(path)
