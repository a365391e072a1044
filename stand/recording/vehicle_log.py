"""A vehicle's stretch of a log: its fixes, velocities and programmed start."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from alignment import Dwell, ImuReadings
from alignment.arrays import Array
from alignment.navigation import C_en, ecef
from alignment.readings import EDGE, Fixes
from stand.errors import StandError
from stand.recording.mcap.reader import FixLog, VelocityLog, read_fixes, read_velocities
from stand.recording.metadata import LoggedDrive, LoggedStretch
from stand.table.kinematics import C_NW

if TYPE_CHECKING:  # planning takes a while to import, and reading needs none of it
    pass

SAME_TIME = 1e-3  # s: a velocity and a fix this near to each other are of one time


@dataclass(frozen=True, slots=True)
class Vehicle:
    """What a person says of a moving vehicle beside its log; None: what the log says.

    `start` is ``C_nb`` as programmed at the first fix, `start_sigma` [rad] how wrong it is about
    each axis; `position_sigma` [m], `velocity_sigma` [m/s] white noise of the fixes.
    """

    start: Rotation | None = None
    start_sigma: float | None = None
    position_sigma: float | None = None
    velocity_sigma: float | None = None


def vehicle_dwell(
    path: Path,
    stretch: LoggedStretch,
    readings: ImuReadings,
    origin: int,
    told: LoggedDrive | None,
    vehicle: Vehicle,
) -> Dwell:
    """A vehicle's stretch from its first fix to its last."""
    places, velocities = read_fixes(path), read_velocities(path)
    try:
        errors = {} if told is None else told.errors
        fixes = _fixes(places, velocities, origin, stretch, errors, vehicle)
    except StandError as error:
        raise StandError(f"{path}: {error}") from error
    first = float(fixes.t[0])
    start, sigma = vehicle.start, vehicle.start_sigma
    label = stretch.label if told is None else told.label
    if told is not None and start is None and first <= (places.t_ns[0] - origin) * 1e-9 + EDGE:
        start = Rotation.from_quat(told.start)
        sigma = told.start_sigma if sigma is None else sigma
    return Dwell(
        label, first, float(fixes.t[-1]), readings, start, fixes=fixes, nominal_sigma=sigma
    )


def _fixes(
    places: FixLog,
    velocities: VelocityLog,
    origin: int,
    stretch: LoggedStretch,
    errors: Mapping[str, float],
    vehicle: Vehicle,
) -> Fixes:
    """The fixes within a stretch that have a velocity of the same time.

    `errors`: what the recording says of them, as the fields of `Fixes`.
    """
    t, v_t = (places.t_ns - origin) * 1e-9, (velocities.t_ns - origin) * 1e-9
    middles = (v_t[1:] + v_t[:-1]) / 2
    nearest = np.searchsorted(middles, t)
    apart = np.abs(v_t[nearest] - t)
    if apart.min() > SAME_TIME:
        raise StandError(
            f"{velocities.topic}: no velocity within {SAME_TIME * 1e3:g} ms of any fix of "
            f"{places.topic}: the nearest is {apart.min():.3g} s away"
        )
    inside = (t >= stretch.t_from - EDGE) & (t <= stretch.t_to + EDGE) & (apart <= SAME_TIME)
    if inside.sum() < 2:
        raise StandError(
            f"{places.topic}: {inside.sum()} fixes with a velocity from {stretch.t_from:z.3f} to "
            f"{stretch.t_to:.3f} s, at least 2 are needed"
        )
    place, k = places.place[inside], nearest[inside]
    v_n = C_NW.apply(velocities.v[k])
    known = dict(errors)
    for name, told, log, row in (
        ("position_sigma", vehicle.position_sigma, places, inside),
        ("velocity_sigma", vehicle.velocity_sigma, velocities, k),
    ):
        if told is not None:
            known[name] = told
        elif name not in known:
            known[name] = _said_sigma(log, log.variance[row])
    return Fixes(
        t[inside],
        ecef(*place.T),
        np.einsum("mij,mj->mi", C_en(place[:, 0], place[:, 1]), v_n),
        **known,
    )


def _said_sigma(log: FixLog | VelocityLog, variance: Array) -> float:
    """The usual standard deviation that messages state with their values."""
    stated = variance[np.isfinite(variance)]
    if not len(stated):
        raise StandError(f"{log.topic}: states no covariance: the noise of the fixes must be given")
    return float(np.sqrt(np.median(stated)))
