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
EVEN = 5e-3  # relative: a rate so near to one of two digits was meant to be that


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
    rest: tuple[Sequence, Array] | None = None
    for k, (one, seen) in enumerate(zip(found, angles, strict=True), start=1):
        if one.kind == "rest":
            rest = seen
            lines += ["", *_entry("dwell", k, one, *seen)]
        else:
            zero = rest or seen
            lines += ["", *_entry("turn", k, one, *zero), *_turn(one, zero[1], seen[1])]
    return "\n".join(lines) + "\n"


def _entry(kind: str, number: int, one: Found, sequence: Sequence, angles: Array) -> list[str]:
    named = list(zip(("roll", "yaw", "pitch"), angles.tolist(), strict=True))
    parts = [f"{name} = {meant(a)}" for name, a in named]
    if sequence is not Sequence.YAW_PITCH_ROLL:
        parts.append(f'sequence = "{sequence.value}"')
    seen = ", ".join(f"{name} {a:.2f}" for name, a in named)
    return [
        "[[stretch]]",
        f'kind = "{kind}"',
        f'label = "{kind} {number}"',
        f"from_s = {one.t_from:.4f}",
        f"to_s = {one.t_to:.4f}",
        f"attitude_deg = {{ {', '.join(parts)} }}   # seen: {seen}",
    ]


def _turn(one: Found, zero: Array, begin: Array) -> list[str]:
    """Axis, rate and angle of a turn whose angle reads zero at angles `zero` (3,) [deg]."""
    near = np.rint(one.up_b)
    upright = float(near @ one.up_b) > np.cos(np.radians(NEAR))
    axis = near if upright else np.round(one.up_b, 6)
    rate = one.rate / DEG
    even = float(f"{rate:.2g}")
    said = even if abs(rate / even - 1) < EVEN else float(f"{rate:.6g}")
    begun = (begin[1] - zero[1] + 180) % 360 - 180
    return [
        f"axis = {[float(x) + 0.0 for x in axis]}   # in b, upward",
        f"rate_deg_s = {said}   # seen: {rate:.5g}",
        f"angle_deg = {begun:.4f}   # at from_s, by the gyros: 0 at the attitude above",
    ]


def meant(angle: float) -> float:
    """The angle [deg] that was meant by one that is seen."""
    near = MEANT * round(angle / MEANT)
    return (near if abs(angle - near) <= NEAR else round(float(angle), 1)) + 0.0
