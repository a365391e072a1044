"""A recording to look at: the moving stand beside its readings and its estimate, as they grow."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from alignment.arrays import Array
from alignment.readings import EDGE
from stand.errors import StandError
from stand.folder import file_beside, refuse_files, write_file
from stand.physics.picture import drawn, pictures, png
from stand.recording.log import Log
from stand.report.encoding import Kind, encode, kind_of, require_encoder
from stand.report.film_canvas import Canvas
from stand.report.film_scene import Scene, scene_of, stretch_of

Image = NDArray[np.uint8]
Progress = Callable[[float], None]

CAMERA = "review"
SIZE = (1280, 720)
SMALLEST, LARGEST = (160, 90), (3840, 2160)
USUAL_S = 60.0  # of a film whose speed is not chosen: at most
LONGEST_S = 3600.0
_STILL = np.radians(0.02)  # of a joint: nobody sees less


@dataclass(frozen=True, slots=True, kw_only=True)
class Film:
    """What was written: `pictures` of which each shows `speed` / `rate` s of `t_from` to `t_to`."""

    path: Path
    t_from: float
    t_to: float
    speed: float
    rate: float
    pictures: int
    width: int
    height: int

    @property
    def duration(self) -> float:
        """How long it takes to see [s]."""
        return self.pictures / self.rate

    def __str__(self) -> str:
        return (
            f"{self.path}: {self.t_from:.2f} to {self.t_to:.2f} s at {self.speed:.4g} times their "
            f"speed, {self.duration:.2f} s, {self.pictures} pictures of "
            f"{self.width} x {self.height}"
        )


def write_film(
    log: Log,
    out: Path,
    *,
    t_from: float | None = None,
    t_to: float | None = None,
    speed: float | None = None,
    longest_s: float = USUAL_S,
    camera: str = CAMERA,
    size: tuple[int, int] = SIZE,
    method: str | None = None,
    joints: str = "",
    force: bool = False,
    progress: Progress = lambda done: None,
) -> Film:
    """Write a film of a recording.

    Parameters
    ----------
    log : Log
        A recording of ours, or of anybody's table with joint angles.
    out : Path
        Its ending chooses the kind: .mp4, .gif or .webp.
    t_from, t_to : float, optional
        What is shown [s]; else all.
    speed : float, optional
        So many times faster than it was; else as it was, or so that it takes `longest_s`.
    longest_s : float
        Of a film whose speed is not chosen [s].
    camera : str
        Of the model, or 'azimuth,elevation,distance'; see `stand.physics.picture.pictures`.
    size : (2,)
        Width and height in pixels, even.
    method : str, optional
        Whose estimate is shown; see `stand.evaluation.growth.growing`.
    joints : str
        Which joint is which axis, of a foreign table; see `stand.report.film_scene.scene_of`.
    force : bool
        Replace a file that is there.
    progress : callable
        Told the part done, 0 to 1.

    Raises
    ------
    StandError
        No joints; a kind of file, stretch, speed, size, camera or method that cannot be; a file
        that is there or cannot be written; nothing that draws (`NoDriver`) or encodes.
    """
    kind = kind_of(out)
    check_size(size)
    refuse_files([out], force=force)
    require_encoder()
    with scene_of(log, method, joints) as scene:
        a, b = stretch_of(scene, t_from, t_to)
        speed = _speed(speed, b - a, longest_s)
        times = frame_times(a, b, speed, float(kind.rate))
        frames = _frames(scene, (a, b), times, camera, size)
        with file_beside(out) as beside:
            count = _encoded(beside, frames, kind, len(times), progress)
    return Film(
        path=out, t_from=a, t_to=b, speed=speed, rate=float(kind.rate), pictures=count,
        width=size[0], height=size[1],
    )  # fmt: skip


def write_picture(
    log: Log,
    at: float,
    out: Path,
    *,
    camera: str = CAMERA,
    size: tuple[int, int] = SIZE,
    method: str | None = None,
    joints: str = "",
    force: bool = False,
) -> Path:
    """Write one moment [s] of a recording as a PNG; all else as `write_film`."""
    if out.suffix.lower() != ".png":
        raise StandError(f"--out {out}: must end in .png")
    check_size(size)
    refuse_files([out], force=force)
    with scene_of(log, method, joints) as scene:
        a, b = stretch_of(scene, None, None)
        if not a - EDGE <= at <= b + EDGE:
            raise StandError(f"--at {at:g}: must lie within the recording's {a:.3f} to {b:.3f} s")
        canvas = Canvas(scene, a, b, *size)
        angles = scene.joints(np.array([at]))
        box = canvas.layout.stand
        (stand,) = pictures(angles, camera, box.width, box.height, scene.model)
        return write_file(out, png(canvas.frame(at, stand, angles[0])))


def check_size(size: tuple[int, int]) -> None:
    """`StandError` where nothing can be drawn or encoded at that size."""
    for value, name, least, most in zip(size, ("width", "height"), SMALLEST, LARGEST, strict=True):
        if not least <= value <= most or value % 2:
            raise StandError(
                f"--size {size[0]}x{size[1]}: {name} must be even, {least} to {most} pixels"
            )


def frame_times(t_from: float, t_to: float, speed: float, rate: float) -> Array:
    """When each picture is of [s]: the last at `t_to`, before it one each `speed` / `rate` s."""
    count = max(1, round((t_to - t_from) / speed * rate))
    return t_from + (t_to - t_from) * np.arange(1, count + 1) / count


def _speed(speed: float | None, span: float, longest: float) -> float:
    if speed is None:
        return max(1.0, span / longest)
    if not span / LONGEST_S <= speed <= 1e4:  # also of what is no number
        raise StandError(f"--speed {speed:g}: must be {span / LONGEST_S:.3g} to 10000 times")
    return speed


def _frames(
    scene: Scene, span: tuple[float, float], times: Array, camera: str, size: tuple[int, int]
) -> Iterator[Image]:
    """The pictures of a film; the stand is drawn anew only where it has moved."""
    canvas = Canvas(scene, *span, *size)
    angles = scene.joints(times)
    anew = moved(angles)
    box = canvas.layout.stand
    drawing = drawn(angles[anew], camera, box.width, box.height, scene.model, quick=True)
    stand = np.empty(0, np.uint8)  # the first is drawn
    with ahead(drawing) as images:
        for t, joints, new in zip(times, angles, anew, strict=True):
            stand = next(images) if new else stand
            yield canvas.frame(float(t), stand, joints)


def moved(angles: Array) -> NDArray[np.bool_]:
    """Which rows (n, 6) [rad] look different from the last one that did; the first does."""
    anew = np.zeros(len(angles), dtype=bool)
    last = np.full(angles.shape[1], np.inf)
    for k, row in enumerate(angles):
        if np.abs(row - last).max() > _STILL:
            anew[k], last = True, row
    return anew


@contextmanager
def ahead(items: Iterator[Image]) -> Iterator[Iterator[Image]]:
    """The same images, each made by another thread while the one before is used."""
    with ThreadPoolExecutor(1) as pool:

        def taken() -> Iterator[Image]:
            waiting = pool.submit(next, items, None)
            while (image := waiting.result()) is not None:
                waiting = pool.submit(next, items, None)
                yield image

        try:
            yield taken()
        finally:
            pool.shutdown(cancel_futures=True)
            close_all(items)


def close_all(*generators: Iterator[Image]) -> None:
    """End generators now: what draws must not outlive its film."""
    for generator in generators:
        if isinstance(generator, Generator):
            generator.close()


def _encoded(
    path: Path, frames: Iterator[Image], kind: Kind, count: int, progress: Progress
) -> int:
    def seen() -> Iterator[Image]:
        for k, image in enumerate(frames, 1):
            yield image
            progress(k / count)

    try:
        return encode(path, seen(), kind, kind.rate)
    finally:
        close_all(frames)
