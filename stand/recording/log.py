"""A recording as the estimators take it: dwells, what is known about them, and the site."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from alignment import Dwell, ImuReadings, Options, Site, Turn
from alignment.arrays import Array
from alignment.readings import EDGE
from stand.errors import StandError
from stand.evaluation.score import Truths
from stand.recording.mcap.reader import ImuLog, read_imu, read_joints, read_truth
from stand.table.kinematics import C_NW

if TYPE_CHECKING:  # planning takes a while to import, and reading needs none of it
    pass
from stand.recording.encoders import Encoders, axis_of_turn, unit_vector
from stand.recording.metadata import (
    RUN,
    SCHEDULE,
    LoggedStretch,
    drive_of,
    epoch_of,
    planned_stretches,
    settings_of,
    settled_stretches,
)
from stand.recording.vehicle_log import Vehicle, vehicle_dwell


@dataclass(frozen=True, slots=True, eq=False)
class Log:
    """Dwells with what is known about each, and what the recording says of site and methods."""

    path: str
    topic: str
    simulated: bool
    dwells: tuple[Dwell, ...]
    truths: tuple[Truths, ...]
    site: Site
    options: Options
    methods: tuple[str, ...]


def load_log(
    path: Path,
    topic: str | None,
    t_from: float | None,
    t_to: float | None,
    turn_joint: str | None = None,
    turn_axis: Sequence[float] | None = None,
    vehicle: Vehicle | None = None,
) -> Log:
    """Read a recording and part it into dwells and turns at constant rate.

    A recording of ours brings its stretches, nominal and true attitudes and site; any other log,
    or a stretch chosen by `t_from` and `t_to`, is one dwell. A drive is one, with its fixes. Times
    count from the recording's epoch (ours, and imported logs: the log's own times) or from the
    first sample.

    Parameters
    ----------
    path : Path
    topic : str or None
        Of the IMU; see `read_imu`.
    t_from, t_to : float or None
        A stretch [s]; None for the beginning, the end.
    turn_joint : str, optional
        The joint whose encoder turns the IMU: then all, or the chosen stretch, is one turn.
    turn_axis : (3,), optional
        The axis in b about which b turns as the encoder's angle grows. Without it the vertical
        as the mean specific force says, upward or downward as the gyros say.
    vehicle : Vehicle, optional
        The log is that of a vehicle, with satellite fixes; recordings of drives need no telling.

    Raises
    ------
    StandError
        The file is not right, or holds nothing between `t_from` and `t_to`; no such joint, no
        angles for the stretch, or gyros that contradict the encoder; of a vehicle: no fixes, no
        velocities with them, or no word of their noise.
    """
    if turn_axis is not None and turn_joint is None:
        raise StandError("turn axis: must have a turn joint with it")
    imu = read_imu(path, topic)
    if len(imu) < 2:
        raise StandError(f"{path}: one IMU message on {imu.topic}, at least 2 are needed")
    metadata = imu.metadata if "stand_version" in imu.metadata.get(RUN, {}) else {}
    simulated = SCHEDULE in metadata
    with _told_of(path):
        origin = epoch_of(metadata) if metadata else int(imu.t_ns[0])
        site, options, methods = settings_of(metadata)
        planned = planned_stretches(metadata)
        drive = drive_of(metadata)
        stretches = settled_stretches(planned, metadata)
    vehicle = vehicle or (None if drive is None else Vehicle())
    t = np.asarray((imu.t_ns - origin) * 1e-9, dtype=np.float64)
    t.flags.writeable = False
    readings = ImuReadings(t, imu.w_ib_b, imu.f_b)
    if vehicle is not None:
        stretch = _chosen(path, readings, [], t_from, t_to)
        dwell = vehicle_dwell(path, stretch, readings, origin, drive, vehicle)
        truth = Truths() if drive is None else Truths(_true_attitude(path, origin, dwell.t_to))
        return Log(
            str(path), imu.topic, drive is not None, (dwell,), (truth,), site, options, methods
        )
    if not simulated or (t_from, t_to, turn_joint) != (None, None, None):
        chosen = _chosen(path, readings, planned, t_from, t_to)
        if turn_joint is not None:
            chosen = replace(chosen, joint=turn_joint, axis_b=unit_vector(turn_axis), nominal=None)
        stretches = [chosen]
    turning = any(stretch.joint is not None for stretch in stretches)
    encoders = Encoders(read_joints(path), origin, counted=simulated) if turning else None
    dwells = tuple(_dwell(path, stretch, readings, encoders) for stretch in stretches)
    truths = _truths(path, imu, origin, dwells, site) if simulated else [Truths()] * len(dwells)
    return Log(str(path), imu.topic, simulated, dwells, tuple(truths), site, options, methods)


@contextmanager
def _told_of(path: Path) -> Iterator[None]:
    try:
        yield
    except StandError as error:
        raise StandError(f"{path}: {error}") from error


def _chosen(
    path: Path,
    readings: ImuReadings,
    planned: Sequence[LoggedStretch],
    t_from: float | None,
    t_to: float | None,
) -> LoggedStretch:
    """The chosen stretch; it keeps what is known of the planned one it lies in."""
    begin = float(readings.t[0]) - readings.interval
    end = float(readings.t[-1])
    a = begin if t_from is None else t_from
    b = end if t_to is None else t_to
    if not (np.isfinite(a) and np.isfinite(b) and begin - EDGE <= a < b <= end + EDGE):
        raise StandError(
            f"{path}: from {a:.3f} to {b:.3f} s: must be a stretch within the recording's "
            f"{begin:.3f} to {end:.3f} s"
        )
    inside = [s for s in planned if s.t_from <= a + EDGE and b - EDGE <= s.t_to]
    known = inside[0] if inside else LoggedStretch(path.stem, a, b)
    return replace(known, t_from=a, t_to=b)


def _dwell(
    path: Path, stretch: LoggedStretch, readings: ImuReadings, encoders: "Encoders | None"
) -> Dwell:
    nominal = None if stretch.nominal is None else Rotation.from_quat(stretch.nominal)
    times = stretch.t_from, stretch.t_to
    if stretch.joint is None or encoders is None:
        return Dwell(stretch.label, *times, readings, nominal)
    part = readings.between(*times)
    with _told_of(path):
        angle = encoders.angle(stretch.joint, part.t)
        turn = Turn(axis_of_turn(stretch, part, angle), angle)
    return Dwell(stretch.label, *times, part, nominal, turn)


def _true_attitude(path: Path, origin: int, t: float) -> Rotation:
    """``C_nb`` at a time between samples, turned evenly from one to the next."""
    truth = read_truth(path)
    stamps = (truth.t_ns - origin) * 1e-9
    if len(stamps) < 2 or not stamps[0] - EDGE <= t <= stamps[-1] + EDGE:
        raise _untrue(path, stamps, t)
    k = int(np.clip(np.searchsorted(stamps, t + EDGE) - 1, 0, len(stamps) - 2))
    before, after = (C_NW * Rotation.from_quat(truth.q_wb[i]) for i in (k, k + 1))
    part = (t - stamps[k]) / (stamps[k + 1] - stamps[k])
    return before * Rotation.from_rotvec(part * (before.inv() * after).as_rotvec())


def _truths(
    path: Path, imu: ImuLog, origin: int, dwells: Sequence[Dwell], site: Site
) -> list[Truths]:
    truth = read_truth(path)
    t = (truth.t_ns - origin) * 1e-9
    last = np.searchsorted(t, [dwell.t_to + 1e-6 for dwell in dwells]) - 1
    for k, dwell in zip(last, dwells, strict=True):
        if k < 0:
            raise _untrue(path, t, dwell.t_to)
    return [
        Truths(_told(C_NW * Rotation.from_quat(truth.q_wb[k]), dwell), dwell.nominal, site.latitude)
        for k, dwell in zip(last, dwells, strict=True)
    ]


def _untrue(path: Path, stamps: Array, t: float) -> StandError:
    return StandError(
        f"{path}: the truth runs from {stamps[0]:.3f} to {stamps[-1]:.3f} s, {t:.3f} s must lie "
        "within"
    )


def _told(C_nb: Rotation, dwell: Dwell) -> Rotation:
    """The attitude an estimate speaks of: of a turning stretch that at encoder angle zero."""
    return C_nb if dwell.turn is None else dwell.turn.back(C_nb)
