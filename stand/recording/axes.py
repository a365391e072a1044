"""Which of a log's axes are X1 forward, Y1 up, Z1 right."""

import re
from dataclasses import dataclass

import numpy as np

from alignment.arrays import Array
from stand.errors import StandError, unknown

CONVENTIONS = {
    "FRD": "x,-z,y",  # x forward, y right, z down: aircraft, PX4
    "FLU": "x,z,-y",  # x forward, y left, z up: ROS, cars
    "RFU": "y,z,x",  # x right, y forward, z up
    "ENU-body": "y,z,x",  # the same: level and heading north its axes are east, north, up
    "FUR": "x,y,z",  # x forward, y up, z right: this stand's own
}


@dataclass(frozen=True, slots=True)
class Axes:
    """X1, Y1, Z1 are the log's axes of these numbers, times these signs."""

    order: tuple[int, int, int]
    signs: tuple[int, int, int]

    def of(self, values: Array) -> Array:
        """Components (n, 3) along X1, Y1, Z1 of those along the log's axes."""
        return values[:, list(self.order)] * np.array(self.signs, float)


def axes_of(text: str) -> Axes:
    """Take ``x,-z,y`` or the name of a convention.

    Raises
    ------
    StandError
        Not known, not three different axes, or left-handed.
    """
    known = {name.lower(): axes for name, axes in CONVENTIONS.items()}
    parts = known.get(text.strip().lower(), text).replace(" ", "").lower().split(",")
    found = [re.fullmatch(r"([+-]?)([xyz])", part) for part in parts]
    if len(found) != 3 or not all(found):
        raise unknown("--axes", text, (*CONVENTIONS, "x,-z,y (what X1, Y1, Z1 are)"))
    order = tuple("xyz".index(m[2]) for m in found if m)
    signs = tuple(-1 if m[1] == "-" else 1 for m in found if m)
    if sorted(order) != [0, 1, 2]:
        raise StandError(f"--axes {text}: must have x, y and z once each")
    turn = np.zeros((3, 3))
    turn[range(3), order] = signs
    if np.linalg.det(turn) < 0:
        parts[1] = parts[1].lstrip("+-") if signs[1] < 0 else "-" + parts[1]
        raise StandError(
            f"--axes {text}: is left-handed, one sign must be the other: {','.join(parts)}?"
        )
    return Axes((order[0], order[1], order[2]), (signs[0], signs[1], signs[2]))
