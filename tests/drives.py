"""Drives of many units: squared errors of each solution over the covariance that it states."""

from collections.abc import Iterable, Iterator
from functools import cache
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from alignment import ImuReadings
from alignment.errors import AlignmentError
from alignment.methods.vectors import SOLUTIONS, Fixes, against
from alignment.methods.vectors.method import options_of
from stand.imu import Imu, load_imu
from stand.imu.priors import priors_of
from stand.samples import Sensed
from stand.vehicle.scenario import (
    fixes_of,
    joined,
    load_drive,
    readings_of,
    sense_blocks,
    started,
)

START = np.radians(0.5)  # of the programmed attitude about each axis


class Square(NamedTuple):
    """Of one solution in one run at one fix: normalised squared error of three degrees of freedom,
    sigma of the whole turn [rad]."""

    solution: str
    fix: int
    square: float
    sigma: float


@cache
def _felt(drive: str, rate_hz: int) -> tuple[Sensed, ...]:
    return tuple(sense_blocks(load_drive(drive).path, rate_hz))


def driven(
    drive: str, imu: str, seed: int, rate_hz: int
) -> tuple[ImuReadings, Fixes, Rotation, Rotation]:
    """Readings, fixes and programmed start of one run, and its true attitude at each fix."""
    made, unit = load_drive(drive), Imu(load_imu(imu), seed, rate_hz)
    readings = readings_of(joined([unit.report(block) for block in _felt(drive, rate_hz)]))
    fixes = fixes_of(made.path, made.satellite, np.random.default_rng([seed, 1]))
    start = started(made, START, np.random.default_rng([seed, 2]))
    return readings, fixes, start, made.path.at(fixes.t).C_nb


def squares(
    drive: str, imu: str, seeds: Iterable[int], rate_hz: int, parts: tuple[float, ...]
) -> Iterator[list[Square]]:
    """Of each run what its solutions say at the fixes after `parts` of them, where they do.

    A run's unit, fixes and start are drawn anew from its seed.
    """
    options = options_of(priors_of(load_imu(imu), None), START)
    for seed in seeds:
        readings, fixes, start, truth = driven(drive, imu, seed, rate_hz)
        found = []
        for name, solve in SOLUTIONS.items():
            try:
                curve = against(solve(readings, fixes, start, options), truth)
            except AlignmentError:
                continue
            for k in (int(part * (len(curve.fixes) - 1)) for part in parts):
                if curve.given[k]:
                    sigma = float(np.sqrt(np.trace(curve.covariance[k])))
                    found.append(Square(name, int(curve.fixes[k]), float(curve.nees[k]), sigma))
        yield found
