"""Commands to see a recording without any viewer: `stand film`, `stand picture`."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from stand.cli.options import ForceOption, JsonOption, quick_imports
from stand.cli.progress import print_json, progress, working

if TYPE_CHECKING:
    from stand.recording.log import Log

RecordingArgument = Annotated[
    Path, typer.Argument(help="Folder of stand run, or a log with sensor_msgs/msg/JointState.")
]
CameraOption = Annotated[
    str,
    typer.Option(
        metavar="NAME|A,E,D",
        help="review, side or top; or azimuth and elevation [deg] and distance [m].",
    ),
]
SizeOption = Annotated[
    str, typer.Option(metavar="WxH", help="In pixels, even; upright where it is higher than wide.")
]
MethodOption = Annotated[
    str | None,
    typer.Option(metavar="ID", help="Whose estimate grows; else the recording's first."),
]
JointsOption = Annotated[
    str,
    typer.Option(
        metavar="NAME=AXIS,...",
        help="Of a foreign table: which joint is which axis, yaw=outer,pitch=-middle; a minus "
        "where it turns the other way.",
    ),
]
TopicOption = Annotated[str | None, typer.Option(help="Which IMU topic, where there are several.")]


def film(
    recording: RecordingArgument,
    out: Annotated[
        Path, typer.Option(metavar="FILE", help="The film: .mp4, or .gif or .webp for pages.")
    ],
    t_from: Annotated[
        float | None, typer.Option("--from", metavar="S", help="Show it from here ...")
    ] = None,
    t_to: Annotated[float | None, typer.Option("--to", metavar="S", help="... to here.")] = None,
    speed: Annotated[
        float | None,
        typer.Option(metavar="X", help="So many times faster; else so that it takes 60 s."),
    ] = None,
    camera: CameraOption = "review",
    size: SizeOption = "1280x720",
    method: MethodOption = None,
    joints: JointsOption = "",
    topic: TopicOption = None,
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> None:
    """The moving stand beside its readings and its estimate, as a film that needs no viewer.

    Curves grow as the test goes on; the estimate has its band of one predicted sigma, about its
    error where the truth is known, else about what it came to. Drawn offscreen, with or without a
    graphics card. Needs the extra: pip install 'imu-test-stand[film]'.

    Example: stand film recordings/sample --from 60 --to 70 --out turn.mp4

    For a page: stand film recordings/sample --speed 20 --size 640x360 --out run.webp
    """
    with quick_imports():
        from dataclasses import asdict

        from stand.report.film import write_film

    chosen: dict[str, Any] = {
        "t_from": t_from,
        "t_to": t_to,
        "speed": speed,
        "camera": camera,
        "size": _size(size),
        "method": method,
        "joints": joints,
        "force": force,
    }
    log = _read(recording, topic, as_json)
    with progress("filming", as_json) as done:
        made = write_film(log, out, progress=done, **chosen)
    if as_json:
        print_json(asdict(made) | {"path": str(made.path), "duration": made.duration})
        return
    print(made)


def picture(
    recording: RecordingArgument,
    at: Annotated[float, typer.Option(metavar="S", help="Which moment.")],
    out: Annotated[Path, typer.Option(metavar="X.png", help="The picture.")],
    camera: CameraOption = "review",
    size: SizeOption = "1280x720",
    method: MethodOption = None,
    joints: JointsOption = "",
    topic: TopicOption = None,
    force: ForceOption = False,
) -> None:
    """One moment of a recording: the stand, its angles, and readings and estimate so far.

    Example: stand picture recordings/sample --at 75 --out moment.png
    """
    with quick_imports():
        from stand.report.film import write_picture

    chosen: dict[str, Any] = {
        "camera": camera,
        "size": _size(size),
        "method": method,
        "joints": joints,
        "force": force,
    }
    log = _read(recording, topic, False)
    with working("drawing", False):
        print(write_picture(log, at, out, **chosen))


def _read(recording: Path, topic: str | None, quiet: bool) -> Log:
    from stand import api
    from stand.report.film_scene import refuse_tables

    refuse_tables(recording)
    with working("reading", quiet):
        return api.read(recording, topic=topic)


def _size(text: str) -> tuple[int, int]:
    match = re.fullmatch(r"(\d{1,5})x(\d{1,5})", text)
    if match is None:
        from stand.errors import StandError

        raise StandError(f"--size {text}: must be WIDTHxHEIGHT in pixels, as 1280x720")
    return int(match[1]), int(match[2])
