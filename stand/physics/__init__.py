"""MuJoCo's only door."""

import os

ASIDE = "STAND_GL"  # the environment's variable for the OpenGL driver, where it is set aside


def set_driver_aside() -> None:
    """Keep the choice of an OpenGL driver for pictures, and from this process.

    MuJoCo loads the driver that MUJOCO_GL names while it is imported, and cannot be imported
    where that is broken. Only pictures need one, and another process draws them. For programs:
    a library leaves the environment as it is.
    """
    chosen = os.environ.pop("MUJOCO_GL", None)
    if chosen is not None:
        os.environ[ASIDE] = chosen
