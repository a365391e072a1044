"""Picture of the stand at given joint angles, drawn offscreen.

    python tools/stand_picture.py stand.png outer=30 middle=20 --camera review

MUJOCO_GL chooses the driver: egl (a graphics card, or Mesa's software renderer) or osmesa;
without it the first that works is taken.
"""

import argparse
import sys
from pathlib import Path

import numpy as np

from stand.errors import StandError, unknown
from stand.folder import write_file
from stand.physics.picture import pictures, png
from stand.table.joints import JOINTS


def picture(
    angles_deg: dict[str, float],
    camera: str = "review",
    width: int = 1600,
    height: int = 1200,
    model: Path | None = None,
) -> bytes:
    """The stand as a PNG; joints [deg] that are not named stay at zero.

    See `stand.physics.picture.pictures`.

    Raises
    ------
    StandError
        A joint or camera the model does not have, or no OpenGL driver.
    """
    for name in angles_deg:
        if name not in JOINTS:
            raise unknown("joint", name, JOINTS)
    joints = np.radians([angles_deg.get(name, 0.0) for name in JOINTS])
    return png(pictures(joints, camera, width, height, model)[0])


def _angle(text: str) -> tuple[str, float]:
    name, _, value = text.partition("=")
    return name, float(value)


def _main() -> None:
    parser = argparse.ArgumentParser(description="Picture of the stand, drawn offscreen")
    parser.add_argument("out", type=Path, help="PNG file")
    parser.add_argument("angles", nargs="*", type=_angle, metavar="JOINT=DEG")
    parser.add_argument("--camera", default="review", help="name, or azimuth,elevation,distance")
    parser.add_argument("--size", type=int, nargs=2, default=(1600, 1200), metavar="PIXELS")
    parser.add_argument("--model", type=Path, help="MJCF of a stand of your own")
    given = parser.parse_args()
    try:
        image = picture(dict(given.angles), given.camera, *given.size, model=given.model)
        write_file(given.out, image)
    except StandError as error:
        sys.exit(f"error: {error}")


if __name__ == "__main__":
    _main()
