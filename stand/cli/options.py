"""Options that several commands share, and what they make of the settings."""

from __future__ import annotations

import gc
from contextlib import contextmanager
from enum import StrEnum
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from stand.errors import StandError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from alignment import Options, Site
    from stand.procedure.procedure import SiteEntry


ALLAN_TERMS = ("N", "B", "K", "Q", "R")


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


JsonOption = Annotated[bool, typer.Option("--json", help="Print JSON for machines, no tables.")]
LatitudeOption = Annotated[
    float | None, typer.Option(metavar="DEG", help="Geodetic latitude; else the file's own.")
]
HeightOption = Annotated[
    float | None, typer.Option(metavar="M", help="Height above the ellipsoid; else the file's own.")
]
ForceOption = Annotated[bool, typer.Option("--force", help="Replace what is there.")]
RuleOption = Annotated[
    RuleChoice | None,
    typer.Option(
        help="Which order of turns each position is read by: 'regular' is never singular in the "
        "six positions, 'published' is as printed in the source."
    ),
]


def file_in(path: Path, name: str) -> Path:
    return path / name if path.is_dir() else path


@contextmanager
def quick_imports() -> Iterator[None]:
    """Import without garbage collection: modules live to the end, looking them over costs 0.5 s."""
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        gc.enable()


def site_of(entry: SiteEntry, latitude: float | None, height: float | None) -> Site:
    return site_with(entry.site(), latitude, height)


def site_with(site: Site, latitude: float | None, height: float | None) -> Site:
    """The site with what the command line says instead."""
    from dataclasses import replace

    from alignment.units import DEG

    if latitude is not None:
        if not abs(latitude) <= 90:
            raise StandError(f"--latitude {latitude:g}: must be -90 to 90 deg")
        site = replace(site, latitude=latitude * DEG)
    if height is not None:
        if not (isfinite(height) and -1000 <= height <= 10000):
            raise StandError(f"--height {height:g}: must be -1000 to 10000 m")
        site = replace(site, height=height)
    return site


def options_with(options: Options, sequences: RuleChoice | None) -> Options:
    from dataclasses import replace

    from alignment.angles import SequenceRule

    return options if sequences is None else replace(options, rule=SequenceRule(sequences.value))


def with_data_sheet(options: Options, imu: str | None) -> Options:
    """The options with what a unit's data sheet says; of the table what the recording says."""
    if imu is None:
        return options
    from dataclasses import replace

    from stand.imu import load_imu
    from stand.imu.priors import priors_of

    known = options.priors
    priors = replace(
        priors_of(load_imu(imu), None),
        turn=known.turn,
        seat=known.seat,
        nominal=known.nominal,
        lever_arm=known.lever_arm,
    )
    return replace(options, priors=priors)
