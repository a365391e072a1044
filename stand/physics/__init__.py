"""MuJoCo's only door."""

import os

ASIDE = "STAND_GL"  # the environment's variable for the OpenGL driver, where it is set aside


NONE = "disable"  # the driver that MuJoCo is told of instead


def set_driver_aside() -> None:
    """Keep the choice of an OpenGL driver for pictures, and drivers from this process.

    MuJoCo loads the driver that MUJOCO_GL names while it is imported, or looks for one in a
    process of its own, and cannot be imported where that is broken. Only pictures need one, and
    another process draws them. For programs: a library leaves the environment as it is.
    """
    chosen = os.environ.get("MUJOCO_GL")
    if chosen and chosen != NONE:
        os.environ[ASIDE] = chosen
    os.environ["MUJOCO_GL"] = NONE


def chosen_driver() -> str | None:
    """The OpenGL driver that somebody chose for pictures."""
    told = os.environ.get(ASIDE) or os.environ.get("MUJOCO_GL")
    return None if told == NONE else told
