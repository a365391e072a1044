"""Options that several commands share, and what they make of the settings."""

from __future__ import annotations

import gc
from contextlib import contextmanager
from enum import StrEnum
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from collections.abc import Iterator


class SamplingChoice(StrEnum):
    """See `stand.physics.truth.Sampling`."""

    mean = "mean"
    instant = "instant"


class MotionChoice(StrEnum):
    """See `stand.motion.polynomial.MotionKind`."""

    ideal = "ideal"
    servo = "servo"


class RuleChoice(StrEnum):
    """See `alignment.angles.SequenceRule`."""

    regular = "regular"
    published = "published"


class Catalogue(StrEnum):
    """What `stand list` can list."""

    procedures = "procedures"
    imus = "imus"
    tables = "tables"
    trajectories = "trajectories"
    methods = "methods"


class Template(StrEnum):
    """What `stand new` can write."""

    imu = "imu"
    table = "table"
    procedure = "procedure"
    requirement = "requirement"


JsonOption = Annotated[bool, typer.Option("--json", help="Print JSON for machines, no tables.")]
LatitudeOption = Annotated[
    float | None, typer.Option(metavar="DEG", help="Geodetic latitude; else the file's own.")
]
HeightOption = Annotated[
    float | None, typer.Option(metavar="M", help="Height above the ellipsoid; else the file's own.")
]
ForceOption = Annotated[bool, typer.Option("--force", help="Replace what is there.")]
SchedulerOption = Annotated[
    str | None,
    typer.Option(
        metavar="ADDRESS",
        help="Of a Dask cluster, as tcp://127.0.0.1:8786; local: one that is started here.",
    ),
]
KeepOption = Annotated[
    Path | None,
    typer.Option(metavar="FILE", help="For the runs: those that it holds are not made again."),
]
RuleOption = Annotated[
    RuleChoice | None,
    typer.Option(
        help="Which order of turns each position is read by: 'regular' is never singular in the "
        "six positions, 'published' is as printed in the source."
    ),
]


@contextmanager
def quick_imports() -> Iterator[None]:
    """Import without garbage collection: modules live to the end, looking them over costs 0.5 s."""
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        gc.enable()


def words(text: str) -> list[str]:
    """What stands between commas."""
    return [word.strip() for word in text.split(",") if word.strip()]


def numbers(option: str, text: str | None, count: int | None = None) -> tuple[float, ...] | None:
    """So many numbers (or any) with commas between; nothing where nothing was said."""
    if text is None:
        return None
    try:
        values = tuple(float(part) for part in text.split(","))
    except ValueError:
        values = ()
    if len(values) != (count or len(values) or 1) or not all(map(isfinite, values)):
        from stand.errors import StandError

        so_many = f"{count} numbers" if count else "numbers"
        raise StandError(f"{option} {text}: must be {so_many} with commas between")
    return values
