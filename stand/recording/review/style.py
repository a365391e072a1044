"""What the review looks like: its plots of samples, colours and lines."""

from collections.abc import Sequence
from typing import NamedTuple

import rerun as rr
from rerun.components import AggregationPolicy

from stand.recording.curves import Phase
from stand.samples import AXES
from stand.table.joints import JOINTS

TIMELINE = "sim_time"

# Okabe and Ito's palette, its dark blues lightened for a dark background: distinct to
# colour-blind eyes too.
Color = tuple[int, int, int]
ORANGE, SKY, GREEN = (230, 159, 0), (86, 180, 233), (0, 178, 130)
YELLOW, RED, PINK = (240, 228, 66), (230, 95, 30), (214, 134, 178)
GREY, WHITE = (140, 140, 140), (235, 235, 235)
XYZ = (RED, GREEN, SKY)
XYZ_PALE = ((255, 178, 140), (140, 230, 200), (190, 228, 255))
METHOD_COLORS = (SKY, ORANGE, PINK, YELLOW, GREEN)
# One per kind of step, darker ones for what fills most of a run.
KIND_COLORS = {
    "dwell": (38, 110, 170),
    "move": (190, 120, 30),
    "rate": (17, 119, 51),
    "sweep": (68, 170, 153),
    "sine": (180, 80, 220),
    "scorsby": (221, 204, 119),
    "coning": (136, 204, 238),
    "sway": (204, 102, 119),
    "vibration": (136, 34, 85),
    "profile": (221, 221, 221),
}


class Channel(NamedTuple):
    """One plot of streamed samples: its entity, its columns with their colours, its title."""

    entity: str
    names: tuple[str, ...]
    colors: tuple[Color, ...]
    title: str


CHANNELS = (
    Channel("stand/base", JOINTS[:3], (SKY, ORANGE, GREEN), "Base angles [deg]"),
    Channel("stand/table", JOINTS[3:], (SKY, ORANGE, GREEN), "Table angles [deg]"),
    Channel("imu/accel", AXES, XYZ, "Specific force of the IMU [m/s²]"),
    Channel("imu/gyro", AXES, XYZ, "Angular rate of the IMU [deg/s]"),
    Channel("residual/accel", AXES, XYZ, "Accelerometers minus truth [mg]"),
    Channel("residual/gyro", AXES, XYZ, "Gyros minus truth [deg/h]"),
)
FOLLOWING = Channel(
    "stand/following",
    JOINTS,
    (YELLOW, PINK, RED, SKY, ORANGE, GREEN),
    "Following error [arc s]",
)
"""Of a servo run: demanded minus realised angle of every axis."""


def shaded(kinds: Sequence[str]) -> list[Color]:
    """Colours of successive phases; of neighbours of one kind every other one is darker."""
    colors: list[Color] = []
    darker = False
    for before, kind in zip(["", *kinds], kinds, strict=False):
        darker = kind == before and not darker
        red, green, blue = KIND_COLORS.get(kind, GREY)
        part = 0.75 if darker else 1.0
        colors.append((round(part * red), round(part * green), round(part * blue)))
    return colors


def state_name(phase: Phase) -> str:
    """A state's name: with its kind, since a dwell and a move may bear one label."""
    return f"{phase.kind} {phase.label}"


def states_of(phases: Sequence[Phase]) -> tuple[tuple[int, ...], tuple[str, ...]]:
    """Times [ns] and names of states, with an empty one after what nothing follows at once."""
    states = [(phase.t_from_ns, state_name(phase)) for phase in phases]
    followed = {phase.t_from_ns for phase in phases}
    states += [(phase.t_to_ns, "") for phase in phases if phase.t_to_ns not in followed]
    times, values = zip(*sorted(states), strict=True)
    return times, values


def state_style(phases: Sequence[Phase]) -> rr.StateConfiguration:
    """Labels and colours of the states."""
    named = {state_name(phase): phase for phase in phases}
    return rr.StateConfiguration(
        values=list(named),
        labels=[phase.label for phase in named.values()],
        colors=shaded([phase.kind for phase in named.values()]),
    )


def entity_part(name: str) -> str:
    return rr.escape_entity_path_part(name)


def line_style(names: Sequence[str], colors: Sequence[Color], width: float) -> rr.SeriesLines:
    """Style of a plot's series; the default aggregation would average spikes away."""
    return rr.SeriesLines(
        names=list(names),
        colors=list(colors),
        widths=[width] * len(names),
        aggregation_policy=AggregationPolicy.MinMax,
    )
