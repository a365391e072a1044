"""Picture of the stand at given joint angles, drawn offscreen.

    python tools/stand_picture.py stand.png outer=30 middle=20 --camera review

MUJOCO_GL chooses the driver: egl (a graphics card, or Mesa's software renderer) or osmesa.
"""

# mujoco fills its namespace from C, unseen by pyright.
# pyright: reportAttributeAccessIssue=false

import argparse
import os
import struct
import sys
import zlib
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

# mujoco picks its driver while it is imported.
os.environ.setdefault("MUJOCO_GL", "egl")

from stand.errors import StandError, unknown
from stand.physics.description import JOINTS

Image = NDArray[np.uint8]


def picture(
    angles_deg: dict[str, float], camera: str = "review", width: int = 1600, height: int = 1200
) -> Image:
    """Draw the stand.

    Parameters
    ----------
    angles_deg : dict
        Joint name to angle [deg]; joints not named stay at zero.
    camera : str
        A camera of the model, or 'azimuth,elevation,distance' in degrees and metres about a
        point at half the table's height.
    width, height : int
        In pixels.

    Returns
    -------
    (height, width, 3), uint8

    Raises
    ------
    StandError
        A joint or camera the model does not have, or no OpenGL driver.
    """
    import mujoco

    from stand.physics.mjcf import load_model

    model = load_model()
    data = mujoco.MjData(model)
    for name, angle in angles_deg.items():
        if name not in JOINTS:
            raise unknown("joint", name, JOINTS)
        data.joint(name).qpos[:] = np.radians(angle)
    mujoco.mj_forward(model, data)
    model.vis.global_.offwidth, model.vis.global_.offheight = width, height
    with _renderer(model, width, height) as renderer:
        renderer.update_scene(data, _camera(model, camera))
        return renderer.render()


def write_png(path: Path, image: Image) -> None:
    """Write an 8 bit RGB image (height, width, 3)."""
    height, width, _ = image.shape
    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    rows = np.insert(image.reshape(height, -1), 0, 0, axis=1)  # filter 0 before each row
    chunks = ((b"IHDR", header), (b"IDAT", zlib.compress(rows.tobytes(), 9)), (b"IEND", b""))
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + b"".join(_chunk(*chunk) for chunk in chunks))


def _chunk(kind: bytes, body: bytes) -> bytes:
    return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))


def _renderer(model, width: int, height: int):
    import mujoco

    driver = os.environ["MUJOCO_GL"]
    try:
        return mujoco.Renderer(model, height, width)
    except Exception as error:
        # Each driver has its own exception; all mean that nothing can be drawn here.
        raise StandError(
            f"no OpenGL driver for MUJOCO_GL={driver} ({error}); "
            "install libegl1 or libosmesa6 and set MUJOCO_GL to egl or osmesa"
        ) from error


def _camera(model, name: str):
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


def _angle(text: str) -> tuple[str, float]:
    name, _, value = text.partition("=")
    return name, float(value)


def _main() -> None:
    parser = argparse.ArgumentParser(description="Picture of the stand, drawn offscreen")
    parser.add_argument("out", type=Path, help="PNG file")
    parser.add_argument("angles", nargs="*", type=_angle, metavar="JOINT=DEG")
    parser.add_argument("--camera", default="review", help="name, or azimuth,elevation,distance")
    parser.add_argument("--size", type=int, nargs=2, default=(1600, 1200), metavar="PIXELS")
    given = parser.parse_args()
    try:
        write_png(given.out, picture(dict(given.angles), given.camera, *given.size))
    except StandError as error:
        sys.exit(f"error: {error}")


if __name__ == "__main__":
    _main()
