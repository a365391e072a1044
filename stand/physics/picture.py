"""Pictures of the stand, drawn offscreen by a process of their own.

MuJoCo picks its OpenGL driver once, while it is imported, and a driver that is broken may take its
process along: so another process draws, and tries the drivers in turn.
"""

# mujoco fills its namespace from C, unseen by pyright.
# pyright: reportAttributeAccessIssue=false

import json
import os
import struct
import subprocess
import sys
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from math import prod
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Timer
from typing import IO, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from alignment.arrays import Array
from stand.bounds import FARTHEST_DEG
from stand.errors import StandError, unknown
from stand.physics import chosen_driver
from stand.table.joints import JOINTS

Image = NDArray[np.uint8]

DRIVERS = ("egl", "osmesa")  # a graphics card or Mesa's software; software alone
LONGEST = 300.0  # s, of one process; software draws about ten pictures a second
LONGEST_EACH = 2.0  # s, more of it for each picture
QUICK_SAMPLES = 4  # of a pixel
SHADOW = 5  # points of the shadow map for each of the picture's
# A software driver's time goes to corners: of a cylinder's length and of a box's faces two are all
# that can be seen (a hundredth of a level of 255 in the mean). What is round both ways needs more.
LENGTHWISE, FACEWISE = 2, 1
TINY = 0.006  # m, the radius of a ball of which nobody sees the corners
_FARTHEST_EYE_M = 1000.0  # from there the stand is less than a pixel
_FAULTS = "faults"  # the file with what the process complains of
_REFUSED = 3  # exit code: the request is wrong, another driver would not help


class NoDriver(StandError):
    """Nothing can be drawn on this machine."""


class Stopped(Exception):
    """A driver that did not draw all; the message says why."""


def pictures(
    joints: ArrayLike,
    camera: str = "review",
    width: int = 1600,
    height: int = 1200,
    model: Path | None = None,
) -> list[Image]:
    """Draw the stand at several joint angles.

    Parameters
    ----------
    joints : (n, 6)
        Angles [rad] in the order of `JOINTS`.
    camera : str
        A camera of the model, or 'azimuth,elevation,distance' in degrees and metres about a
        point at half the table's height.
    width, height : int
        In pixels.
    model : Path or None
        As `stand.physics.mjcf.load_model`.

    Returns
    -------
    n images (height, width, 3), uint8

    Raises
    ------
    NoDriver
        No OpenGL driver: neither that of the variable MUJOCO_GL nor, without it, any of `DRIVERS`.
    StandError
        A camera that the model does not have; a model that is not right.
    """
    return list(drawn(joints, camera, width, height, model))


def drawn(
    joints: ArrayLike,
    camera: str = "review",
    width: int = 1600,
    height: int = 1200,
    model: Path | None = None,
    *,
    quick: bool = False,
) -> Iterator[Image]:
    """The same one after the other, each as soon as it is drawn: for films.

    `quick`: without shadows and reflections, which take most of the time where software draws.
    """
    rest = np.asarray(joints, dtype=float).reshape(-1, len(JOINTS))
    request = {
        "camera": camera,
        "width": width,
        "height": height,
        "model": None if model is None else str(model.absolute()),
        "quick": quick,
    }
    _eye(camera)  # before a process is begun
    chosen = chosen_driver()
    told = []
    for driver in (chosen,) if chosen else DRIVERS:
        done = 0
        try:
            for image in drawn_by(driver, request | {"joints": rest.tolist()}):
                done += 1
                yield image
            return
        except Stopped as fault:
            told.append(f"{driver}: {fault}")
            rest = rest[done:]  # another driver goes on
    raise NoDriver(
        f"no OpenGL driver ({'; '.join(told)}): install libegl1 or libosmesa6 and leave MUJOCO_GL "
        "unset, or set it to egl or osmesa"
    )


def png(image: Image) -> bytes:
    """An 8 bit RGB image (height, width, 3) as a PNG file."""
    height, width, _ = image.shape
    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    rows = np.insert(image.reshape(height, -1), 0, 0, axis=1)  # filter 0 before each row
    chunks = ((b"IHDR", header), (b"IDAT", zlib.compress(rows.tobytes(), 9)), (b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(_chunk(*chunk) for chunk in chunks)


def _chunk(kind: bytes, body: bytes) -> bytes:
    return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))


def drawn_by(driver: str, request: dict[str, Any]) -> Iterator[Image]:
    """Images by one driver; `Stopped` where it does not draw all."""
    shape = (request["height"], request["width"], 3)
    with TemporaryDirectory() as folder:  # MuJoCo writes its log into the working folder
        limit = LONGEST + LONGEST_EACH * len(request["joints"])
        with _drawing(driver, Path(folder), limit) as (process, stdin, stdout):
            with suppress(OSError), stdin:  # a process that died is known by its answer
                stdin.write(json.dumps(request).encode())
            for _ in request["joints"]:
                pixels = stdout.read(prod(shape))
                if len(pixels) < prod(shape):
                    break
                yield np.frombuffer(pixels, np.uint8).reshape(shape)
            else:
                return
            code = process.wait()
        fault = (Path(folder) / _FAULTS).read_text(encoding="utf-8", errors="replace").strip()
    if code == _REFUSED:
        raise StandError(fault)
    raise Stopped(fault.rpartition("\n")[2][:120] or f"ended with {code}")


@contextmanager
def _drawing(
    driver: str, folder: Path, limit: float
) -> Iterator[tuple[subprocess.Popen[bytes], IO[bytes], IO[bytes]]]:
    """The process that draws, with its pipes, for `limit` seconds at most."""
    environment = os.environ | {"MUJOCO_GL": driver, "PYTHONPATH": _import_path()}
    try:
        with (folder / _FAULTS).open("wb") as faults:
            process = subprocess.Popen(
                [sys.executable, "-P", "-m", __name__],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=faults,
                cwd=folder,
                env=environment,
            )
    except OSError as error:
        raise Stopped(" ".join(str(error).split())) from error
    assert process.stdin is not None
    assert process.stdout is not None
    watchdog = Timer(limit, process.kill)
    watchdog.start()
    try:
        yield process, process.stdin, process.stdout
    finally:
        watchdog.cancel()
        process.kill()
        process.wait()
        process.stdout.close()


def _import_path() -> str:
    """Where this process finds its modules, so that the other finds the same."""
    return os.pathsep.join(os.path.abspath(entry or ".") for entry in sys.path)


def _main() -> int:
    """Read a request, draw, write the pixels: in the process that may fail."""
    request = json.load(sys.stdin.buffer)
    try:
        for image in _draw(**request):
            sys.stdout.buffer.write(image.tobytes())
    except StandError as error:
        print(error, file=sys.stderr)
        return _REFUSED
    return 0


def _draw(
    joints: Sequence[Array], camera: str, width: int, height: int, model: str | None, quick: bool
) -> Iterator[Image]:
    import mujoco

    from stand.physics.mjcf import load_model

    stand = load_model(None if model is None else Path(model))
    data = mujoco.MjData(stand)
    view = _camera(stand, camera)
    stand.vis.global_.offwidth, stand.vis.global_.offheight = width, height
    # sharper shadows than the picture can show are half of a small one's time
    quality = stand.vis.quality
    quality.shadowsize = min(quality.shadowsize, SHADOW * max(width, height))
    quality.numquads = min(quality.numquads, FACEWISE)
    if not _has_balls(stand):
        quality.numstacks = min(quality.numstacks, LENGTHWISE)
    if quick:
        quality.offsamples = min(quality.offsamples, QUICK_SAMPLES)
    with mujoco.Renderer(stand, height, width) as renderer:
        for angles in joints:
            data.qpos[:] = angles
            mujoco.mj_forward(stand, data)
            renderer.update_scene(data, view)
            if quick:
                for flag in (mujoco.mjtRndFlag.mjRND_SHADOW, mujoco.mjtRndFlag.mjRND_REFLECTION):
                    renderer.scene.flags[flag] = 0
            yield renderer.render()


def _has_balls(model: Any) -> bool:
    """Whether anything that can be seen is round both ways: a sphere, a capsule's ends."""
    import mujoco

    kinds = mujoco.mjtGeom
    both = (kinds.mjGEOM_SPHERE, kinds.mjGEOM_CAPSULE, kinds.mjGEOM_ELLIPSOID)
    return bool((np.isin(model.geom_type, both) & (model.geom_size[:, 0] > TINY)).any())


def _camera(model: Any, name: str) -> Any:
    import mujoco

    names = [model.camera(i).name for i in range(model.ncam)]
    if name in names:
        return name
    eye = _eye(name)
    if eye is None:
        raise unknown("camera", name, [*names, "azimuth,elevation,distance"])
    camera = mujoco.MjvCamera()
    camera.lookat[:] = model.stat.center
    camera.azimuth, camera.elevation, camera.distance = eye
    return camera


def _eye(name: str) -> tuple[float, float, float] | None:
    """Azimuth, elevation [deg] and distance [m] from where to look; None: a camera's name."""
    try:
        azimuth, elevation, distance = (float(part) for part in name.split(","))
    except ValueError:
        return None
    if not (max(abs(azimuth), abs(elevation)) <= FARTHEST_DEG and 0 < distance <= _FARTHEST_EYE_M):
        raise StandError(
            f"camera {name}: must be angles to {FARTHEST_DEG:g} deg, and a distance above 0 to "
            f"{_FARTHEST_EYE_M:g} m"
        )
    return azimuth, elevation, distance


if __name__ == "__main__":
    sys.exit(_main())
