"""Pictures of the stand in each position of a procedure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from alignment.arrays import Array, set_owned
from alignment.units import DEG
from stand.physics.picture import NoDriver, pictures, png
from stand.report.page import Photo, photo
from stand.table.joints import JOINTS

CAMERA = "135,-18,2.9"  # from the south-east, a little above: all gimbals and the unit are seen
SIDE = 420  # pixels
MOST = 24  # pictures in a report
_SAME = 0.05 * DEG  # nobody sees less

ZERO = "all at zero"


@dataclass(frozen=True, slots=True, eq=False)
class Position:
    """Where the table stands in a step: joint angles (6,) [rad] in the order of `JOINTS`."""

    label: str
    joints: Array

    def __post_init__(self) -> None:
        set_owned(self, joints=(self.joints, (len(JOINTS),), float))


@dataclass(frozen=True, slots=True)
class Gallery:
    """The pictures, and what is to be said of them: why there are none, or not all."""

    photos: tuple[Photo, ...]
    note: str = ""


def gallery(positions: Sequence[Position], model: Path | None = None) -> Gallery:
    """A picture of each different position; none, and the reason, where nothing can be drawn.

    `model`: the MJCF of a stand that is not the shipped one.
    """
    groups = _different(positions)
    if not groups:
        return Gallery((), "There is no position in which anything is measured.")
    shown = groups[:MOST]
    try:
        joints = np.array([group[0].joints for group in shown])
        images = pictures(joints, CAMERA, SIDE, SIDE, model)
    except NoDriver as error:
        return Gallery((), f"No pictures: {error}.")
    photos = [_photo(group, png(image)) for group, image in zip(shown, images, strict=True)]
    left = len(groups) - len(shown)
    return Gallery(tuple(photos), f"{left} further positions are not shown." if left else "")


def _different(positions: Sequence[Position]) -> list[list[Position]]:
    """Steps in groups that look alike, in order of their first."""
    groups: list[list[Position]] = []
    for position in positions:
        for group in groups:
            apart = np.angle(np.exp(1j * (group[0].joints - position.joints)))
            if np.abs(apart).max() < _SAME:
                group.append(position)
                break
        else:
            groups.append([position])
    return groups


def _photo(group: Sequence[Position], image: bytes) -> Photo:
    labels = ", ".join(dict.fromkeys(position.label for position in group))
    angles = angles_text(group[0].joints)
    return photo(image, f"The stand in position {labels}: {angles}", f"{labels}: {angles}")


def angles_text(joints: Array) -> str:
    """'outer 90°, middle -45°': the joints that are not at zero."""
    told = [
        f"{name} {angle:.4g}°"
        for name, angle in zip(JOINTS, np.round(np.asarray(joints) / DEG, 3), strict=True)
        if angle
    ]
    return ", ".join(told) or ZERO
