"""A vehicle's stretch of a log: its fixes, velocities and programmed start."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite

import numpy as np
from scipy.spatial.transform import Rotation

from alignment import Dwell, ImuReadings
from alignment.angles import C_nb_from_angles
from alignment.angles import Sequence as SequenceOfTurns
from alignment.arrays import Array
from alignment.navigation import C_en, ecef
from alignment.readings import EDGE, Fixes
from alignment.units import DEG
from stand.errors import StandError, located
from stand.recording.entrance import OpenLog
from stand.recording.mcap.reader import FixLog, VelocityLog
from stand.recording.metadata import LoggedDrive, LoggedStretch
from stand.table.kinematics import C_NW

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


def vehicle_of(
    moving: bool,
    start_attitude_deg: Sequence[float] | None,
    start_sigma_deg: float | None,
    fix_sigma: Sequence[float] | None,
) -> Vehicle | None:
    """What was said of a moving vehicle; None for nothing, and not `moving`.

    Raises
    ------
    StandError
        Too many or too few numbers; a sigma that is not above 0.
    """
    if (start_attitude_deg, start_sigma_deg, fix_sigma) == (None, None, None):
        return Vehicle() if moving else None
    start, noise = None, (None, None)
    if start_attitude_deg is not None:
        roll, yaw, pitch = (a * DEG for a in _numbers("start_attitude_deg", start_attitude_deg, 3))
        start = C_nb_from_angles(SequenceOfTurns.YAW_PITCH_ROLL, roll, yaw, pitch)
    if start_sigma_deg is not None and not 0 < start_sigma_deg <= 180:
        raise StandError(f"--start-sigma {start_sigma_deg:g}: must be above 0, at most 180 deg")
    if fix_sigma is not None:
        noise = _numbers("fix_sigma", fix_sigma, 2)
        if min(noise) <= 0:
            said = ",".join(f"{x:g}" for x in fix_sigma)
            raise StandError(f"--fix-sigma {said}: both must be above 0")
    return Vehicle(start, None if start_sigma_deg is None else start_sigma_deg * DEG, *noise)


def _numbers(option: str, values: Sequence[float], count: int) -> tuple[float, ...]:
    if len(values) != count or not all(map(isfinite, values)):
        raise StandError(f"{option} = {list(values)}: must be {count} numbers")
    return tuple(values)


def vehicle_dwell(
    file: OpenLog,
    stretch: LoggedStretch,
    readings: ImuReadings,
    origin: int,
    drive: LoggedDrive | None,
    vehicle: Vehicle,
) -> Dwell:
    """A vehicle's stretch from its first fix to its last."""
    places, velocities = file.fixes(), file.velocities()
    with located(file.path):
        errors = {} if drive is None else drive.errors
        fixes = _fixes(places, velocities, origin, stretch, errors, vehicle)
    first = float(fixes.t[0])
    start, sigma = vehicle.start, vehicle.start_sigma
    label = stretch.label if drive is None else drive.label
    if drive is not None and start is None and first <= (places.t_ns[0] - origin) * 1e-9 + EDGE:
        start = Rotation.from_quat(drive.start)
        sigma = drive.start_sigma if sigma is None else sigma
    return Dwell(
        label=label,
        t_from=first,
        t_to=float(fixes.t[-1]),
        readings=readings,
        nominal=start,
        fixes=fixes,
        nominal_sigma=sigma,
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
    for name, given, log, row in (
        ("position_sigma", vehicle.position_sigma, places, inside),
        ("velocity_sigma", vehicle.velocity_sigma, velocities, k),
    ):
        if given is not None:
            known[name] = given
        elif name not in known:
            known[name] = _stated_sigma(log, log.variance[row])
    return Fixes(
        t=t[inside],
        position=ecef(*place.T),
        velocity=np.einsum("mij,mj->mi", C_en(place[:, 0], place[:, 1]), v_n),
        **known,
    )


def _stated_sigma(log: FixLog | VelocityLog, variance: Array) -> float:
    """The usual standard deviation that messages state with their values."""
    stated = variance[np.isfinite(variance)]
    if not len(stated):
        raise StandError(f"{log.topic}: states no covariance: the noise of the fixes must be given")
    return float(np.sqrt(np.median(stated)))
