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
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from alignment.arrays import Array
from stand.errors import StandError, unknown
from stand.physics import ASIDE
from stand.table.joints import JOINTS

Image = NDArray[np.uint8]

DRIVERS = ("egl", "osmesa")  # a graphics card or Mesa's software; software alone
LONGEST = 300.0  # s, for all pictures; software draws about ten a second
SHADOW = 5  # points of the shadow map for each of the picture's
_REFUSED = 3  # exit code: the request is wrong, another driver would not help


class NoDriver(StandError):
    """Nothing can be drawn on this machine."""


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
    angles = np.asarray(joints, dtype=float).reshape(-1, len(JOINTS))
    request = {
        "joints": angles.tolist(),
        "camera": camera,
        "width": width,
        "height": height,
        "model": None if model is None else str(model.absolute()),
    }
    chosen = os.environ.get(ASIDE) or os.environ.get("MUJOCO_GL")
    told = []
    for driver in (chosen,) if chosen else DRIVERS:
        drawn, fault = _drawn_by(driver, request)
        if drawn is not None:
            return list(drawn)
        told.append(f"{driver}: {fault}")
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


def _drawn_by(driver: str, request: dict[str, Any]) -> tuple[Image | None, str]:
    """The images (n, height, width, 3) by one driver, or None and why not."""
    environment = os.environ | {"MUJOCO_GL": driver, "PYTHONPATH": _import_path()}
    with TemporaryDirectory() as folder:  # MuJoCo writes its log into the working folder
        try:
            answer = subprocess.run(
                [sys.executable, "-P", "-m", __name__],
                input=json.dumps(request).encode(),
                capture_output=True,
                cwd=folder,
                env=environment,
                timeout=LONGEST,
                check=False,
            )
        except (OSError, subprocess.TimeoutExpired) as error:
            return None, " ".join(str(error).split())
    if answer.returncode == _REFUSED:
        raise StandError(answer.stderr.decode(errors="replace").strip())
    shape = (len(request["joints"]), request["height"], request["width"], 3)
    if answer.returncode or len(answer.stdout) != np.prod(shape):
        last = answer.stderr.decode(errors="replace").strip().rpartition("\n")[2]
        return None, last[:120] or f"ended with {answer.returncode}"
    return np.frombuffer(answer.stdout, np.uint8).reshape(shape), ""


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
    joints: Sequence[Array], camera: str, width: int, height: int, model: str | None
) -> Sequence[Image]:
    import mujoco

    from stand.physics.mjcf import load_model

    stand = load_model(None if model is None else Path(model))
    data = mujoco.MjData(stand)
    view = _camera(stand, camera)
    stand.vis.global_.offwidth, stand.vis.global_.offheight = width, height
    # sharper shadows than the picture can show are half of a small one's time
    quality = stand.vis.quality
    quality.shadowsize = min(quality.shadowsize, SHADOW * max(width, height))
    images = []
    with mujoco.Renderer(stand, height, width) as renderer:
        for angles in joints:
            data.qpos[:] = angles
            mujoco.mj_forward(stand, data)
            renderer.update_scene(data, view)
            images.append(renderer.render().copy())
    return images


def _camera(model: Any, name: str) -> Any:
    import mujoco

    names = [model.camera(i).name for i in range(model.ncam)]
    if name in names:
        return name
    try:
        azimuth, elevation, distance = (float(part) for part in name.split(","))
    except ValueError:
        raise unknown("camera", name, [*names, "azimuth,elevation,distance"]) from None
    camera = mujoco.MjvCamera()
    camera.lookat[:] = model.stat.center
    camera.azimuth, camera.elevation, camera.distance = azimuth, elevation, distance
    return camera


if __name__ == "__main__":
    sys.exit(_main())
