"""A recording as the estimators take it: dwells, what is known about them, and the site."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import ceil, floor, isfinite
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from alignment import Dwell, ImuReadings, Options, Site, Turn
from alignment.arrays import Array
from alignment.parts import PART, in_parts
from alignment.quaternions import turned_evenly
from alignment.readings import EDGE, JointAngles
from alignment.sampling import bursts, evened, repeats
from stand.errors import StandError, located
from stand.evaluation.score import Refusal, Truths
from stand.recording.encoders import Encoders, axis_of_turn, unit_vector
from stand.recording.entrance import OpenLog, Progress, open_log, unseen
from stand.recording.log_form import LogForm
from stand.recording.mcap.reader import ImuLog, TruthLog
from stand.recording.metadata import (
    RUN,
    SCHEDULE,
    LoggedStretch,
    drive_of,
    epoch_of,
    interrupted_at,
    planned_stretches,
    settings_of,
    settled_stretches,
)
from stand.recording.named_stretches import StretchesEntry
from stand.recording.vehicle_log import Vehicle, vehicle_dwell
from stand.room import seconds
from stand.table.joints import JOINTS
from stand.table.kinematics import C_NW
from stand.table.leanings import joints_read

SERVO = "servo"  # motion of a recording whose joints followed the plan as motors do
NAMED = 5  # stretches that were not reached: more are counted


@dataclass(frozen=True, slots=True, eq=False)
class Log:
    """Dwells with what is known about each, and what the recording says of site and methods.

    `imu`: the samples as they lie in the file, with its metadata; `readings`: all of them on the
    log's own clock. `doubts`: what its way into the
    file did to the samples of a foreign log, in words. `lost`: the stretches that are not whole,
    because the recording was interrupted.
    """

    path: str
    topic: str
    simulated: bool
    dwells: tuple[Dwell, ...]
    truths: tuple[Truths, ...]
    site: Site
    options: Options
    methods: tuple[str, ...]
    imu: ImuLog
    readings: ImuReadings
    doubts: tuple[str, ...] = ()
    lost: tuple[Refusal, ...] = ()


def load_log(
    path: Path,
    topic: str | None,
    t_from: float | None,
    t_to: float | None,
    turn_joint: str | None = None,
    turn_axis: Sequence[float] | None = None,
    vehicle: Vehicle | None = None,
    named: StretchesEntry | None = None,
    form: LogForm | None = None,
    progress: Progress = unseen,
) -> Log:
    """Read a recording, or a log of any kind, and part it into dwells and turns at constant rate.

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
    named : StretchesEntry, optional
        The stretches of the log, in place of its own; see `load_stretches`.
    form : LogForm, optional
        What is stated of a log of others; see `open_log`.
    progress : callable
        Told the part read, 0 to 1.

    Raises
    ------
    StandError
        The file is not right, or holds nothing between `t_from` and `t_to`; no such joint, no
        angles for the stretch, or gyros that contradict the encoder; of a vehicle: no fixes, no
        velocities with them, or no word of their noise.
    """
    if turn_axis is not None and turn_joint is None:
        raise StandError("turn axis: must have a turn joint with it")
    if named is not None and (t_from, t_to, turn_joint, vehicle) != (None,) * 4:
        raise StandError("stretches: must not stand beside another choice of a stretch")
    with open_log(path, form, progress) as file:
        return _parted(file, topic, (t_from, t_to), turn_joint, turn_axis, vehicle, named, form)


def _parted(
    file: OpenLog,
    topic: str | None,
    limits: tuple[float | None, float | None],
    turn_joint: str | None,
    turn_axis: Sequence[float] | None,
    vehicle: Vehicle | None,
    named: StretchesEntry | None,
    form: LogForm | None,
) -> Log:
    path, imu = file.path, file.imu(topic)
    if len(imu) < 2:
        raise StandError(f"{path}: one IMU message on {imu.topic}, at least 2 are needed")
    metadata = imu.metadata if "stand_version" in imu.metadata.get(RUN, {}) else {}
    simulated = SCHEDULE in metadata
    with located(path):
        origin = epoch_of(metadata) if metadata else int(imu.t_ns[0])
        site, options, methods = settings_of(metadata)
        planned = planned_stretches(metadata)
        drive = drive_of(metadata)
        end = interrupted_at(metadata)
        stretches, lost = _whole(settled_stretches(planned, metadata), end)
    if named is not None:
        stretches, lost = named.stretches(), ()
        site, options, methods = named.settings(site, options, methods)
    vehicle = vehicle or (None if drive is None else Vehicle())
    t = seconds(imu.t_ns, origin)
    t, doubts = (t, ()) if simulated or drive is not None else _as_sampled(t, imu)
    t.flags.writeable = False
    instants = (form or LogForm()).instants(metadata.get(RUN, {}))
    readings = ImuReadings(t, imu.w_ib_b, imu.f_b, instants=instants)
    truths: list[Truths]
    if vehicle is not None:
        stretch = _chosen(path, readings, [], *limits)
        dwells = [vehicle_dwell(file, stretch, readings, origin, drive, vehicle)]
        truths = [Truths()]
        if drive is not None:
            truths = [Truths(_true_attitude(file.truth(), origin, dwells[0].t_to))]
    else:
        if named is not None:
            for stretch in stretches:
                _check_inside(path, readings, stretch.t_from, stretch.t_to, stretch.label)
        elif not simulated or (*limits, turn_joint) != (None, None, None):
            chosen = _chosen(path, readings, planned, *limits)
            if turn_joint is not None:
                axis = unit_vector(turn_axis)
                chosen = replace(chosen, joint=turn_joint, axis_b=axis, nominal=None)
            stretches, lost = [chosen], ()
        turning = any(stretch.joint is not None for stretch in stretches)
        servo = simulated and metadata[RUN].get("motion") == SERVO
        encoders = None
        if turning or servo:
            encoders = Encoders(file.joints(), origin, counted=simulated)
        dwells = [_dwell(path, stretch, readings, encoders) for stretch in stretches]
        if servo and encoders is not None:  # a plan is not where they stood
            dwells = [replace(dwell, joints=_stood(dwell, encoders)) for dwell in dwells]
        truths = [Truths()] * len(dwells)
        if simulated:
            truths = _truths(file.truth(), origin, dwells, site)
    return Log(
        path=path,
        topic=imu.topic,
        simulated=simulated or drive is not None,
        dwells=tuple(dwells),
        truths=tuple(truths),
        site=site,
        options=options,
        methods=methods,
        imu=imu,
        readings=readings,
        doubts=imu.doubts + doubts,
        lost=lost,
    )


def _whole(
    stretches: Sequence[LoggedStretch], end: float
) -> tuple[list[LoggedStretch], tuple[Refusal, ...]]:
    """The stretches that are over by `end` [s]; the others by name, with what would do."""
    whole = [s for s in stretches if s.t_to <= end + EDGE]
    told = floor(end * 1e3) / 1e3 if isfinite(end) else end  # inward: it lies within the record
    begun = [s for s in stretches if s.t_from < end <= s.t_to - EDGE]
    later = [s for s in stretches if s.t_from >= end]
    lost = [
        Refusal(
            method="",
            reason=f"cut off at {told:.3f} s, planned to {s.t_to:.3f} s: the recording was "
            f"interrupted; --from {ceil(s.t_from * 1e3) / 1e3:.3f} --to {told:.3f} uses what is "
            "there",
            stretch=s.label,
        )
        for s in begun
    ]
    if later:
        more = f" and {len(later) - NAMED} more" if len(later) > NAMED else ""
        names = ", ".join(s.label for s in later[:NAMED]) + more
        reason = f"not reached: the recording was interrupted at {told:.3f} s"
        lost.append(Refusal(method="", reason=reason, stretch=names))
    return whole, tuple(lost)


def _as_sampled(t: Array, imu: ImuLog) -> tuple[Array, tuple[str, ...]]:
    """Stamps (n,) [s] as the unit sampled, where those of arrival came in bursts; what to say."""
    told = []
    burst = bursts(t)
    if burst is not None:
        told.append(
            f"{burst.count} bursts of {burst.size:.3g} samples: the stamps are those of arrival, "
            "even ones by the mean rate are used"
        )
        t = evened(t)
    for sensor, values in (("gyro", imu.w_ib_b), ("accel", imu.f_b)):
        starts = repeats(values)
        if starts is not None:
            times = len(values) / len(starts)
            told.append(f"{sensor}: every value stands {times:.3g} times")
    return t, tuple(told)


def _chosen(
    path: str,
    readings: ImuReadings,
    planned: Sequence[LoggedStretch],
    t_from: float | None,
    t_to: float | None,
) -> LoggedStretch:
    """The chosen stretch; it keeps what is known of the planned one it lies in."""
    a = float(readings.t[0]) - readings.interval if t_from is None else t_from
    b = float(readings.t[-1]) if t_to is None else t_to
    _check_inside(path, readings, a, b)
    inside = [s for s in planned if s.t_from <= a + EDGE and b - EDGE <= s.t_to]
    known = inside[0] if inside else LoggedStretch(label=Path(path).stem, t_from=a, t_to=b)
    return replace(known, t_from=a, t_to=b)


def _check_inside(path: str, readings: ImuReadings, a: float, b: float, label: str = "") -> None:
    begin, end = float(readings.t[0]) - readings.interval, float(readings.t[-1])
    if not (np.isfinite(a) and np.isfinite(b) and begin - EDGE <= a < b <= end + EDGE):
        named = f'"{label}" ' if label else ""
        raise StandError(
            f"{path}: {named}from {a:.3f} to {b:.3f} s: must be a stretch within the recording's "
            f"{begin:.3f} to {end:.3f} s"
        )


def _dwell(
    path: str, stretch: LoggedStretch, readings: ImuReadings, encoders: "Encoders | None"
) -> Dwell:
    nominal = None if stretch.nominal is None else Rotation.from_quat(stretch.nominal)
    times = stretch.t_from, stretch.t_to
    joints = _joints(stretch)
    if stretch.rate is None and (stretch.joint is None or encoders is None):
        return Dwell(stretch.label, *times, readings=readings, nominal=nominal, joints=joints)
    part = readings.between(*times)
    with located(path):
        if len(part) < 2:
            raise StandError(f"{stretch.label}: {len(part)} samples, at least 2 are needed")
        if stretch.rate is not None:
            angle = stretch.angle + stretch.rate * (part.t - stretch.t_from)
        else:
            assert stretch.joint is not None
            assert encoders is not None
            angle = encoders.angle(stretch.joint, part.t)
        turn = Turn(axis_of_turn(stretch, part, angle), angle)
    return Dwell(stretch.label, *times, readings=part, nominal=nominal, turn=turn, joints=joints)


def _joints(stretch: LoggedStretch) -> JointAngles | None:
    """Where the axes stood, the turning one's angle at zero; None where nobody said."""
    if not stretch.joints or stretch.joint not in (None, *JOINTS):  # which its encoder tells
        return None
    angles = np.array(stretch.joints)
    if stretch.joint is None:
        return JointAngles(angles)
    axis = JOINTS.index(stretch.joint)
    angles[axis] = 0.0
    return JointAngles(angles, axis)


def _stood(dwell: Dwell, encoders: Encoders) -> JointAngles | None:
    """Where the axes stood by their encoders, on the mean."""
    if dwell.joints is None:
        return None
    t = dwell.window().t
    angles = np.array([encoders.angle(joint, t).mean() for joint in JOINTS])
    from stand.physics.mjcf import describe, load_model  # MuJoCo: most logs need none

    return joints_read(describe(load_model()), angles, dwell.joints.going_round)


def _true_attitude(truth: TruthLog, origin: int, t: float) -> Rotation:
    """``C_nb`` at a time between samples, turned evenly from one to the next."""
    stamps = (truth.t_ns - origin) * 1e-9
    if len(stamps) < 2 or not stamps[0] - EDGE <= t <= stamps[-1] + EDGE:
        raise _untrue(truth, stamps, t)
    return C_NW * turned_evenly(stamps, truth.q_wb, np.array([t]))[0]


def _truths(truth: TruthLog, origin: int, dwells: Sequence[Dwell], site: Site) -> list[Truths]:
    t = seconds(truth.t_ns, origin)
    last = np.searchsorted(t, [dwell.t_to + 1e-6 for dwell in dwells]) - 1
    for k, dwell in zip(last, dwells, strict=True):
        if k < 0:
            raise _untrue(truth, t, dwell.t_to)
    return [
        Truths(
            _judged_attitude(C_NW * Rotation.from_quat(truth.q_wb[k]), dwell),
            dwell.nominal,
            site.latitude,
            mean_attitude(t, truth.q_wb, dwell),
        )
        for k, dwell in zip(last, dwells, strict=True)
    ]


def mean_attitude(t: Array, q_wb: Array, dwell: Dwell) -> Rotation | None:
    """True mean ``C_nb`` of a dwell from samples (n,), (n, 4); None of one that turns."""
    first, last = np.searchsorted(t, [dwell.t_from + EDGE, dwell.t_to + EDGE], "right")
    if dwell.turn is not None or last <= first:
        return None
    own = q_wb[first:last]
    if len(own) <= PART:
        return C_NW * Rotation.from_quat(own).mean()
    _, vectors = np.linalg.eigh(np.sum([q.T @ q for q in in_parts(own)], axis=0))
    return C_NW * Rotation.from_quat(vectors[:, -1])  # as it is found of all at once


def _untrue(truth: TruthLog, stamps: Array, t: float) -> StandError:
    return StandError(
        f"{truth.path}: the truth runs from {stamps[0]:.3f} to {stamps[-1]:.3f} s, "
        f"{t:.3f} s must lie within"
    )


def _judged_attitude(C_nb: Rotation, dwell: Dwell) -> Rotation:
    """The attitude an estimate speaks of: of a turning stretch that at encoder angle zero."""
    return C_nb if dwell.turn is None else dwell.turn.back(C_nb)
