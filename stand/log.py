"""A recording as the estimators take it: dwells, what is known about them, and the site."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from alignment import Dwell, ImuReadings, Options, Priors, Site, Turn
from alignment.angles import SequenceRule
from alignment.arrays import Array
from alignment.navigation import C_en, ecef
from alignment.readings import EDGE
from alignment.units import ARC_SECOND, DEG
from alignment.vectors.fixes import Fixes
from stand.errors import StandError, unknown
from stand.physics.description import JOINTS
from stand.physics.kinematics import C_NW
from stand.recording.interchange.reader import (
    FixLog,
    ImuLog,
    JointLog,
    VelocityLog,
    read_fixes,
    read_imu,
    read_joints,
    read_truth,
    read_velocities,
)
from stand.score import Truths

if TYPE_CHECKING:  # planning takes a while to import, and reading needs none of it
    from stand.plan import PlannedStep, Turning

RUN = "run"  # the metadata record that marks a recording of ours
DRIVE = "drive"  # that of a vehicle's: its programmed start, the satellites' errors
PRIOR_UNITS = {
    "gyro_bias": "rad_s",
    "accel_bias": "m_s2",
    "gyro_scale": "ratio",
    "accel_scale": "ratio",
    "gyro_instability": "rad_s",
    "accel_instability": "m_s2",
    "gyro_walk": "rad_rt_s",
    "accel_walk": "m_s_rt_s",
    "turn": "rad",
    "seat": "rad",
    "nominal": "rad",
    "lever_arm": "m",
}
FIX_UNITS = {
    "position_sigma": "m",
    "velocity_sigma": "m_s",
    "position_drift": "m",
    "velocity_drift": "m_s",
    "drift_time": "s",
}
SAME_TIME = 1e-3  # s: a velocity and a fix this near to each other are of one time
NEVER = "never"  # of a dwell in the record `settled`: the table did not come to rest
LONGEST_STEP = 90 * DEG  # of an encoder between readings, so that turns can be counted
GROSS = 0.5  # part of a rate: scale errors of gyros are smaller, mistakes larger
LARGEST_BIAS = 1 * DEG  # rad/s, of a gyro


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


def describe_site(site: Site) -> dict[str, str]:
    """The metadata record of a site; numbers as exact decimal text."""
    record = {
        "height_m": repr(site.height),
        "longitude_deg": repr(site.longitude / DEG),
        "deflection_north_arc_s": repr(site.deflection[0] / ARC_SECOND),
        "deflection_east_arc_s": repr(site.deflection[1] / ARC_SECOND),
    }
    if site.latitude is not None:
        record["latitude_deg"] = repr(site.latitude / DEG)
    if site.local_gravity is not None:
        record["gravity_m_s2"] = repr(site.local_gravity)
    return record


def describe_schedule(steps: "Sequence[PlannedStep]") -> dict[str, str]:
    """The metadata record of the steps as they ran.

    `C_nb_xyzw` is the nominal attitude, of a `turning` step where its axis reads zero;
    `axis_b` is that axis in b.
    """
    entries = [
        {
            "kind": step.kind,
            "label": step.label,
            "t_from_s": step.t_from,
            "t_to_s": step.t_to,
            "steady_from_s": step.steady_from,
            "steady_to_s": step.steady_to,
            "joints_deg": [float(a) for a in step.joints / DEG],
            "C_nb_xyzw": [float(a) for a in step.C_nb.as_quat()],
            "turning": _described(step.turning),
        }
        for step in steps
    ]
    return {"json": json.dumps(entries)}


def _described(turning: "Turning | None") -> dict | None:
    if turning is None:
        return None
    return {
        "axis": JOINTS[turning.axis],
        "rate_deg_s": turning.rate / DEG,
        "axis_b": [float(a) for a in turning.axis_b],
    }


def describe_estimate(options: Options, methods: Sequence[str]) -> dict[str, str]:
    """The metadata record of what was to be estimated."""
    return {
        "methods": ",".join(methods),
        "offset_window_s": repr(options.offset_window),
        "sequences": options.rule.value,
    } | {
        f"prior_{name}_{unit}": repr(getattr(options.priors, name))
        for name, unit in PRIOR_UNITS.items()
    }


def describe_drive(
    name: str, text: str, fixes: Fixes, start: Rotation, start_sigma: float
) -> dict[str, str]:
    """The metadata record of a drive: its id and TOML text, how its fixes err, its start.

    `start` is ``C_nb`` as programmed at the first fix, wrong by `start_sigma` [rad] about each
    axis.
    """
    return {
        "id": name,
        "toml": text,
        "start_C_nb_xyzw": json.dumps([float(a) for a in start.as_quat()]),
        "start_sigma_rad": repr(start_sigma),
    } | {f"{key}_{unit}": repr(getattr(fixes, key)) for key, unit in FIX_UNITS.items()}


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


@dataclass(frozen=True, slots=True)
class _Stretch:
    """A time to estimate from [s]; what it is called, its nominal attitude, what turned it."""

    label: str
    t_from: float
    t_to: float
    nominal: tuple[float, ...] | None = None
    joint: str | None = None
    axis_b: tuple[float, ...] | None = None


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
    drive = metadata.get(DRIVE)
    vehicle = vehicle or (None if drive is None else Vehicle())
    simulated = "schedule" in metadata
    try:
        origin = int(metadata[RUN]["epoch_ns"]) if metadata else int(imu.t_ns[0])
        site, options, methods = _settings(metadata)
        planned = _planned(metadata) if simulated else []
        told = None if drive is None else _told_of_drive(drive)
        stretches = _settled(planned, metadata.get("settled", {}))
    except (KeyError, ValueError, TypeError) as error:
        raise StandError(f"{path}: metadata of the run is damaged: {error}") from error
    t = np.asarray((imu.t_ns - origin) * 1e-9, dtype=np.float64)
    t.flags.writeable = False
    readings = ImuReadings(t, imu.w_ib_b, imu.f_b)
    if vehicle is not None:
        stretch = _chosen(path, readings, [], t_from, t_to)
        dwell = _on_the_road(path, stretch, readings, origin, told, vehicle)
        truth = Truths() if drive is None else Truths(_true_attitude(path, origin, dwell.t_to))
        return Log(
            str(path), imu.topic, drive is not None, (dwell,), (truth,), site, options, methods
        )
    if not simulated or (t_from, t_to, turn_joint) != (None, None, None):
        chosen = _chosen(path, readings, planned, t_from, t_to)
        if turn_joint is not None:
            chosen = replace(chosen, joint=turn_joint, axis_b=_unit(turn_axis), nominal=None)
        stretches = [chosen]
    turning = any(stretch.joint is not None for stretch in stretches)
    encoders = Encoders(read_joints(path), origin, counted=simulated) if turning else None
    dwells = tuple(_dwell(path, stretch, readings, encoders) for stretch in stretches)
    truths = _truths(path, imu, origin, dwells, site) if simulated else [Truths()] * len(dwells)
    return Log(str(path), imu.topic, simulated, dwells, tuple(truths), site, options, methods)


def _planned(metadata: Mapping[str, Mapping[str, str]]) -> list[_Stretch]:
    """The stretches of the schedule; older recordings know of dwells alone."""
    found = []
    for step in json.loads(metadata["schedule"]["json"]):
        turning = step.get("turning")
        if step["kind"] == "dwell" or turning is not None:
            found.append(
                _Stretch(
                    step["label"],
                    float(step.get("steady_from_s", step["t_from_s"])),
                    float(step.get("steady_to_s", step["t_to_s"])),
                    tuple(step["C_nb_xyzw"]),
                    None if turning is None else turning["axis"],
                    None if turning is None else tuple(turning["axis_b"]),
                )
            )
    return found


def _settled(planned: Sequence[_Stretch], begins: Mapping[str, str]) -> list[_Stretch]:
    """The stretches from when the table had settled; what never did is left out."""
    settled = [
        replace(s, t_from=max(s.t_from, float(begins.get(s.label, s.t_from))))
        for s in planned
        if begins.get(s.label) != NEVER
    ]
    return [s for s in settled if s.t_from < s.t_to - EDGE]


def _chosen(
    path: Path,
    readings: ImuReadings,
    planned: Sequence[_Stretch],
    t_from: float | None,
    t_to: float | None,
) -> _Stretch:
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
    known = inside[0] if inside else _Stretch(path.stem, a, b)
    return replace(known, t_from=a, t_to=b)


def _dwell(
    path: Path, stretch: _Stretch, readings: ImuReadings, encoders: "Encoders | None"
) -> Dwell:
    nominal = None if stretch.nominal is None else Rotation.from_quat(stretch.nominal)
    times = stretch.t_from, stretch.t_to
    if stretch.joint is None or encoders is None:
        return Dwell(stretch.label, *times, readings, nominal)
    part = readings.between(*times)
    try:
        angle = encoders.angle(stretch.joint, part.t)
        turn = Turn(_axis_of_turn(stretch, part, angle), angle)
    except StandError as error:
        raise StandError(f"{path}: {error}") from error
    return Dwell(stretch.label, *times, part, nominal, turn)


@dataclass(frozen=True, slots=True)
class _Drive:
    """What the recording of a drive says: its id, start and `Fixes`' own standard deviations."""

    label: str
    start: tuple[float, ...]
    start_sigma: float
    errors: dict[str, float]


def _told_of_drive(record: Mapping[str, str]) -> _Drive:
    return _Drive(
        record["id"],
        tuple(json.loads(record["start_C_nb_xyzw"])),
        float(record["start_sigma_rad"]),
        {key: float(record[f"{key}_{unit}"]) for key, unit in FIX_UNITS.items()},
    )


def _on_the_road(
    path: Path,
    stretch: _Stretch,
    readings: ImuReadings,
    origin: int,
    told: _Drive | None,
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
    stretch: _Stretch,
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


def _true_attitude(path: Path, origin: int, t: float) -> Rotation:
    """``C_nb`` at a time between samples, turned evenly from one to the next."""
    truth = read_truth(path)
    stamps = (truth.t_ns - origin) * 1e-9
    k = int(np.clip(np.searchsorted(stamps, t + EDGE) - 1, 0, len(stamps) - 2))
    before, after = (C_NW * Rotation.from_quat(truth.q_wb[i]) for i in (k, k + 1))
    part = (t - stamps[k]) / (stamps[k + 1] - stamps[k])
    return before * Rotation.from_rotvec(part * (before.inv() * after).as_rotvec())


@dataclass(frozen=True, slots=True, eq=False)
class Encoders:
    """Encoder readings of a log whose time zero is `origin` [ns since the Unix epoch].

    `counted`: whether the angles grow over turns, as ours do; a real encoder may begin anew.
    """

    log: JointLog
    origin: int
    counted: bool

    def angle(self, joint: str, t: Array) -> Array:
        """Its angle (n,) [rad] at times `t` (n,) [s], straight between readings, turns counted.

        Raises
        ------
        StandError
            No such joint; times that the readings do not span; readings too far apart.
        """
        log = self.log
        if joint not in log.names:
            raise unknown(f"{log.topic}: joint", joint, log.names)
        stamps = (log.t_ns - self.origin) * 1e-9
        if len(t) < 2 or t[0] < stamps[0] - EDGE or t[-1] > stamps[-1] + EDGE:
            raise StandError(
                f"{log.topic}: from {stamps[0]:.3f} to {stamps[-1]:.3f} s, must hold all of the "
                "IMU's stretch (two samples or more)"
            )
        first = max(int(np.searchsorted(stamps, t[0], "right")) - 1, 0)
        last = int(np.searchsorted(stamps, t[-1])) + 1
        angle = log.angles[first:last, log.names.index(joint)]
        return np.interp(t, stamps[first:last], angle if self.counted else self._counted(angle))

    def _counted(self, angle: Array) -> Array:
        whole = np.unwrap(angle)
        step = float(np.abs(np.diff(whole)).max(initial=0.0))
        if step > LONGEST_STEP:
            raise StandError(
                f"{self.log.topic}: steps of {step / DEG:.1f} deg between readings: must be at "
                f"most {LONGEST_STEP / DEG:.0f}, or turns cannot be counted"
            )
        return whole


def _axis_of_turn(stretch: _Stretch, readings: ImuReadings, angle: Array) -> Array:
    """The axis in b: of the schedule, the told one, or the vertical.

    The latter two are compared with the gyros: the encoder's rate is fitted to theirs by least
    squares. A bias may be as large as a slow table's rate, so that a told axis stands then.
    """
    if stretch.nominal is not None:
        return np.array(stretch.axis_b)
    known = stretch.axis_b is not None
    axis = np.array(stretch.axis_b if known else _unit(readings.f_b.mean(axis=0)))
    rate = np.diff(angle) / np.diff(readings.t)
    power = float(rate @ rate)
    if power == 0.0:
        raise StandError(f"{stretch.label}: {stretch.joint} does not turn")
    # interval k ends at stamp k, as its mean rate does
    share = float((readings.w_ib_b[1:] @ axis) @ rate) / power
    if not known and share < 0:
        axis, share = -axis, -share
    off = abs(share - 1.0)
    if off > GROSS and (not known or off * np.sqrt(power / len(rate)) > LARGEST_BIAS):
        about = ", ".join(f"{a:.3f}" for a in axis)
        raise StandError(
            f"{stretch.label}: the gyros turn {share:.3f} times as fast about ({about}) as "
            f"{stretch.joint} does, must be {1 - GROSS:g} to {1 + GROSS:g}: another axis or joint"
        )
    return axis


def _unit(vector: ArrayLike | None) -> tuple[float, ...] | None:
    if vector is None:
        return None
    v = np.asarray(vector, float)
    length = float(np.linalg.norm(v))
    if v.shape != (3,) or not np.isfinite(length) or length == 0.0:
        raise StandError(f"turn axis {v.tolist()}: must be three numbers, not all zero")
    return tuple((v / length).tolist())


def _settings(
    metadata: Mapping[str, Mapping[str, str]],
) -> tuple[Site, Options, tuple[str, ...]]:
    site, estimate = metadata.get("site", {}), metadata.get("estimate", {})

    def number(key: str, unit: float) -> float:
        return float(site.get(key, "0")) * unit

    return (
        Site(
            number("latitude_deg", DEG) if "latitude_deg" in site else None,
            number("height_m", 1.0),
            number("gravity_m_s2", 1.0) if "gravity_m_s2" in site else None,
            number("longitude_deg", DEG),
            (
                number("deflection_north_arc_s", ARC_SECOND),
                number("deflection_east_arc_s", ARC_SECOND),
            ),
        ),
        Options(
            float(estimate.get("offset_window_s", Options().offset_window)),
            SequenceRule(estimate.get("sequences", SequenceRule.REGULAR.value)),
            _priors(estimate),
        ),
        tuple(estimate["methods"].split(",")) if "methods" in estimate else ("triad",),
    )


def _priors(estimate: Mapping[str, str]) -> Priors:
    """The recorded priors; older recordings have none."""
    keys = {name: f"prior_{name}_{unit}" for name, unit in PRIOR_UNITS.items()}
    return Priors(**{name: float(estimate.get(key, "0")) for name, key in keys.items()})


def _truths(
    path: Path, imu: ImuLog, origin: int, dwells: Sequence[Dwell], site: Site
) -> list[Truths]:
    truth = read_truth(path)
    t = (truth.t_ns - origin) * 1e-9
    last = np.searchsorted(t, [dwell.t_to + 1e-6 for dwell in dwells]) - 1
    return [
        Truths(_told(C_NW * Rotation.from_quat(truth.q_wb[k]), dwell), dwell.nominal, site.latitude)
        for k, dwell in zip(last, dwells, strict=True)
    ]


def _told(C_nb: Rotation, dwell: Dwell) -> Rotation:
    """The attitude an estimate speaks of: of a turning stretch that at encoder angle zero."""
    return C_nb if dwell.turn is None else dwell.turn.back(C_nb)
