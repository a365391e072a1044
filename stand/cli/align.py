"""Commands on readings: `stand align`, `stand import`, `stand allan`."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from stand.cli.log_options import takes_log_form
from stand.cli.options import (
    ForceOption,
    HeightOption,
    JsonOption,
    LatitudeOption,
    RuleOption,
    numbers,
    quick_imports,
    words,
)
from stand.cli.progress import print_json, progress, tell_left_behind, working

if TYPE_CHECKING:
    from stand.recording.log_form import LogForm
    from stand.recording.mcap.reader import ImuLog

LOGS = "Logs of any kind (docs/own-logs.md), or folders of stand run."


@takes_log_form
def align(
    recordings: Annotated[
        list[Path],
        typer.Argument(help=LOGS),
    ],
    *,
    form: LogForm,
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
    stretches: Annotated[
        Path | None,
        typer.Option(
            metavar="X.toml",
            help="What the log's stretches are, with attitudes and turns: see stand stretches.",
        ),
    ] = None,
    windows: Annotated[
        str | None,
        typer.Option(
            metavar="S,S",
            help="Cut each stretch into windows of these lengths too: scatter beside sigma.",
        ),
    ] = None,
    calibration: Annotated[
        Path | None,
        typer.Option(
            metavar="X.json",
            help="Of stand calibrate: the unit's errors leave the readings, its sigmas enter.",
        ),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Estimate the attitude from recordings: ours, or any log of an IMU at rest.

    Several recordings are several dwells of one unit: positions with opposite verticals also
    give a latitude free of that axis's bias. A moving vehicle's needs satellite fixes
    (sensor_msgs/msg/NavSatFix, geometry_msgs/msg/TwistWithCovarianceStamped) and --method vectors.

    Example: stand align up.mcap down.mcap --method triad

    Readings alone tell noise; a data sheet tells the rest: stand align log.mcap --imu stim300

    Is a sigma right? stand align log.mcap --windows 60,300

    Positions of a log: stand align log.mcap --stretches stretches.toml --method multi-position

    A turning table's log: stand align log.mcap --method carousel --turn-joint yaw --latitude 48.5
    """
    with quick_imports():
        from stand import api
        from stand.evaluation.aligned import alignment_json, of_vehicles

    record = None
    if calibration is not None:
        from stand.calibration.corrected import check_axes, loaded

        record = loaded(calibration)
        for path in recordings:
            check_axes(record, form, str(path))
    axis = numbers("--turn-axis", turn_axis, 3)
    attitude = numbers("--start-attitude", start_attitude, 3)
    noise = numbers("--fix-sigma", fix_sigma, 2)
    lengths = numbers("--windows", windows) or ()
    with progress("reading", as_json) as done:
        logs = [
            api.read(
                path,
                form=form,
                progress=done,
                topic=topic,
                t_from_s=t_from,
                t_to_s=t_to,
                turn_joint=turn_joint,
                turn_axis=axis,
                moving=of_vehicles(method),
                start_attitude_deg=attitude,
                start_sigma_deg=start_sigma,
                fix_sigma=noise,
                stretches=stretches,
            )
            for path in recordings
        ]
    with working("estimating", as_json):
        found = api.align(
            logs,
            method,
            imu=imu,
            latitude_deg=latitude,
            height_m=height,
            sequences=None if sequences is None else sequences.value,
            windows_s=lengths,
            calibration=record,
        )
    if as_json:
        print_json(alignment_json(found))
        return
    from stand.report.console import console, show
    from stand.report.document import ANGLE_NOTE, refusal_lines

    out = console()
    show(out, found.tables())
    for line in refusal_lines(found.refusals):
        out.print(line, style="bold yellow", markup=False)
    out.print(ANGLE_NOTE, style="dim")
    for log in (log for log in logs if not log.simulated):
        told = "; ".join([f"{log.topic}, {len(log.imu)} samples", *log.imu.notes])
        out.print(f"{log.path}: read {told}", style="dim", markup=False)


@takes_log_form
def import_log(
    file: Annotated[Path, typer.Argument(help="A log of any kind (docs/own-logs.md).")],
    *,
    form: LogForm,
    out: Annotated[
        Path | None, typer.Option(metavar="X.mcap", help="The recording to write.")
    ] = None,
    topic: Annotated[
        str | None, typer.Option(help="Which IMU topic, where there are several.")
    ] = None,
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> None:
    """Bring a log into an MCAP that every ROS 2 tool reads.

    Example: stand import log.csv --columns t,gx,gy,gz,ax,ay,az --gyro-unit deg/s
    --accel-unit m/s^2 --out log.mcap

    Without --out it shows the log's columns and first rows, and the command to type.
    """
    from stand.errors import StandError

    if out is None:
        if form.columns is not None:
            raise StandError("missing --out X.mcap: the recording to write")
        _show_inspection(file, topic, as_json)
        return
    tell_left_behind(out)
    with quick_imports():
        from stand.recording.importing import import_log as imported

    with progress("importing", as_json) as done:
        log = imported(file, out, form, topic=topic, force=force, progress=done)
    _show_import(out, log, as_json)


def _show_inspection(file: Path, topic: str | None, as_json: bool) -> None:
    from dataclasses import asdict

    from stand.recording.inspection import inspect

    found = inspect(file, topic)
    if as_json:
        print_json(asdict(found))
        return
    print("\n".join(found.lines()))


def _show_import(out: Path, log: ImuLog, as_json: bool) -> None:
    import numpy as np

    from alignment.units import DEG_PER_HOUR
    from stand.recording.entrance import origin_of

    t = (log.t_ns - origin_of(log)) * 1e-9
    steps = np.diff(t)
    rate = np.linalg.norm(log.w_ib_b.mean(axis=0)) / DEG_PER_HOUR
    force = np.linalg.norm(log.f_b.mean(axis=0))
    facts: dict[str, Any] = {
        "out": str(out),
        "topic": log.topic,
        "samples": len(log.t_ns),
        "t_from_s": float(t[0]),
        "t_to_s": float(t[-1]),
        "rate_hz": float(1 / steps.mean()),
        "longest_gap_s": float(steps.max()),
        "mean_rate_deg_h": float(rate),
        "mean_force_m_s2": float(force),
        "notes": [*log.notes, *log.doubts],
    }
    if as_json:
        print_json(facts)
        return
    print(
        f"{out}: {facts['samples']} samples from {facts['t_from_s']:.3f} to "
        f"{facts['t_to_s']:.3f} s, {facts['rate_hz']:.4g} Hz (longest step "
        f"{facts['longest_gap_s'] * 1e3:.3g} ms)\n"
        f"mean rate {rate:.4g} deg/h (Earth: 15.04), mean specific force {force:.5f} m/s^2\n"
        + "".join(f"{note}\n" for note in (f"read: {log.topic}", *log.notes, *log.doubts))
        + f"Align it: stand align {shlex.quote(str(out))}"
    )


@takes_log_form
def allan(
    recording: Annotated[
        Path,
        typer.Argument(help="A log of any kind (docs/own-logs.md) at rest, or a folder of run."),
    ],
    *,
    form: LogForm,
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
    with quick_imports():
        from stand import api
        from stand.evaluation.allan import to_json

    with progress("analysing", as_json) as done:
        found = api.allan(
            recording,
            form=form,
            progress=done,
            imu=imu,
            terms=words(terms),
            topic=topic,
            t_from_s=t_from,
            t_to_s=t_to,
        )
    pictures = []
    if out is not None or not as_json:
        from stand.report.allan import write_pictures

        with working("drawing", as_json):
            pictures = write_pictures(found, out)
    if as_json:
        print_json(to_json(found) | {"pictures": [str(path) for path in pictures]})
        return
    from stand.report.console import console, show

    show(console(), found.tables())
    for path in pictures:
        print(path)
