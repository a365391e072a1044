"""Rests and steady turns found in a log that brings no procedure, and the file that names them."""

from collections.abc import Sequence as Ordered
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from alignment import ImuReadings
from alignment.angles import Sequence, SequenceRule, angles_from_C_nb
from alignment.arrays import Array
from alignment.rests import SHORTEST, Found, attitudes, find_stretches
from alignment.units import DEG
from stand.errors import StandError
from stand.recording.log import Log

MEANT = 15.0  # deg: the step of angles that tables are sent to
NEAR = 3.0  # deg from one that was meant: scale errors of a consumer unit over half a turn


@dataclass(frozen=True, slots=True, eq=False)
class FoundStretches:
    """What was found in a log: `found`, and the angles (3,) [deg] of each with their order."""

    path: str
    topic: str
    found: tuple[Found, ...]
    angles: tuple[tuple[Sequence, Array], ...]

    def toml(self) -> str:
        """As a file of named stretches, for a person to mend."""
        return stretches_text(Path(self.path).name, self.found, self.angles)


def stretches_of(log: Log, shortest: float = SHORTEST) -> FoundStretches:
    """Rests and steady turns of a log; see `find_stretches`.

    Raises
    ------
    StandError
        `shortest` is not above zero.
    """
    if not (np.isfinite(shortest) and shortest > 0):
        raise StandError(f"shortest = {shortest:g} s: must be above 0")
    found = find_stretches(log.readings, shortest)
    return FoundStretches(log.path, log.topic, tuple(found), _angles_of(found, log.readings))


def _angles_of(found: Ordered[Found], readings: ImuReadings) -> tuple[tuple[Sequence, Array], ...]:
    """Roll, yaw, pitch (3,) [deg] of each stretch, with the order of turns; yaw from the first."""
    told = []
    for one, C_nb in zip(found, attitudes(readings, found), strict=True):
        sequence = SequenceRule.REGULAR.sequence_for(one.up_b)
        told.append((sequence, angles_from_C_nb(sequence, C_nb) / DEG))
    return tuple(told)


def stretches_text(
    name: str, found: Ordered[Found], angles: Ordered[tuple[Sequence, Array]]
) -> str:
    """The TOML of what was found in a log of this name.

    Angles within 3 deg of a multiple of 15 are taken for it: a table is sent to such.
    """
    lines = [
        f"# What stands still or turns evenly in {name}. Mend what is not right: labels,",
        "# attitudes the table was told to take, and which stretches count.",
        "# Yaw is 0 at the first and found by the gyros from there: where the table was told",
        "# another heading add it everywhere.",
        '# table = "mid-class"     # whose placement enters every sigma (stand list tables)',
        "",
        "# [site]",
        "# latitude_deg = 48.5",
        "",
        "# [estimate]",
        '# methods = ["multi-position"]',
    ]
    for k, (one, seen) in enumerate(zip(found, angles, strict=True), start=1):
        lines += ["", *_entry(k, one, *seen)]
    return "\n".join(lines) + "\n"


def _entry(number: int, one: Found, sequence: Sequence, angles: Array) -> list[str]:
    kind = "dwell" if one.kind == "rest" else "turn"
    seen = ", ".join(f"{n} {a:.2f}" for n, a in zip(("roll", "yaw", "pitch"), angles, strict=True))
    parts = [f"{n} = {meant(a)}" for n, a in zip(("roll", "yaw", "pitch"), angles, strict=True)]
    if sequence is not Sequence.YAW_PITCH_ROLL:
        parts.append(f'sequence = "{sequence.value}"')
    lines = [
        "[[stretch]]",
        f'kind = "{kind}"',
        f'label = "{kind} {number}"',
        f"from_s = {one.t_from:.4f}",
        f"to_s = {one.t_to:.4f}",
        f"attitude_deg = {{ {', '.join(parts)} }}   # seen: {seen}",
    ]
    if kind == "turn":
        up = [round(float(x), 6) + 0.0 for x in one.up_b]
        lines += [f"axis = {up}   # in b, up", f"rate_deg_s = {one.rate / DEG:.5g}   # as seen"]
    return lines


def meant(angle: float) -> float:
    """The angle [deg] that was meant by one that is seen."""
    near = MEANT * round(angle / MEANT)
    return (near if abs(angle - near) <= NEAR else round(float(angle), 1)) + 0.0
