"""Metadata records of a recording: written and read by the same words."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf, pi
from typing import TYPE_CHECKING, Annotated, TypeVar

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, Json, RootModel
from scipy.spatial.transform import Rotation

from alignment import DEFAULT_METHOD, Options, Priors, Site
from alignment.angles import SequenceRule
from alignment.readings import EDGE, Fixes
from alignment.units import ARC_SECOND, DEG
from stand import toml_files as catalogue
from stand.errors import StandError
from stand.imu import ImuSpec, imu_from
from stand.table.joints import JOINTS
from stand.toml_files import checked

if TYPE_CHECKING:  # planning takes a while to import, and reading needs none of it
    from stand.motion.plan import PlannedStep, Turning
    from stand.simulation.settings import Settings


Metadata = Mapping[str, Mapping[str, str]]
"""Of a recording: {record: {key: value}}."""
ModelT = TypeVar("ModelT", bound=BaseModel)

_DAMAGED = "metadata of the run is damaged"
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
    "azimuth": "rad",
    "lever_arm": "m",
    "places": "m",
    "lag": "s",
    "clock": "ratio",
    "jitter": "s",
    "gyro_random_walk": "rad_s_rt_s",
    "accel_random_walk": "m_s2_rt_s",
    "gyro_ramp": "rad_s2",
    "accel_ramp": "m_s3",
    "gyro_scale_ramp": "1_s",
    "gyro_misalignment": "rad",
    "accel_misalignment": "rad",
    "gyro_non_orthogonality": "rad",
    "accel_non_orthogonality": "rad",
    "gyro_asymmetry": "ratio",
    "accel_asymmetry": "ratio",
    "gyro_g_sensitivity": "s_m",
    "gyro_g2_sensitivity": "s3_m2",
    "accel_quadratic": "s2_m",
    "accel_cubic": "s4_m2",
    "gyro_cubic": "s2_rad2",
}
FIX_UNITS = {
    "position_sigma": "m",
    "velocity_sigma": "m_s",
    "position_drift": "m",
    "velocity_drift": "m_s",
    "drift_time": "s",
}
SCHEDULE = "schedule"  # the steps as they ran
MODEL_FOLDER = "model/"  # of the attached files of a stand of one's own
SETTLED = "settled"  # from when the dwells of a servo run count; the last such record has all
INTERRUPTED = "interrupted"  # of a recording that was brought back: until when it goes
NEVER = "never"  # of a dwell in the record `settled`: the table did not come to rest


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


def describe_settings(s: "Settings") -> dict[str, dict[str, str]]:
    """The metadata records of what was run: `RUN`, and the texts of procedure, unit and table."""
    return {
        RUN: {
            "procedure": s.procedure.id,
            "imu": s.imu.id,
            "table": s.table.id,
            "seed": str(s.seed),
            "rate_hz": str(s.rate_hz),
            "sampling": s.sampling.value,
            "without": ",".join(s.without),
            "motion": s.motion.value,
        },
        "procedure": {"toml": s.procedure.text},
        "imu": {"toml": s.imu.text},
        "table": {"toml": s.table.text},
    }


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
    """The metadata record of what was to be estimated; axes of triads that are skewed by design."""
    priors = options.priors
    axes = {"gyro_axes": priors.gyro_axes, "accel_axes": priors.accel_axes}
    skewed = {name: json.dumps(rows) for name, rows in axes.items() if rows is not None}
    return (
        skewed
        | {
            "methods": ",".join(methods),
            "offset_window_s": repr(options.offset_window),
            "sequences": options.rule.value,
            "accel_later_s": repr(priors.accel_later),
        }
        | {
            f"prior_{name}_{unit}": repr(getattr(priors, name))
            for name, unit in PRIOR_UNITS.items()
        }
    )


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
class LoggedStretch:
    """A time to estimate from [s]; what it is called, its nominal attitude, what turned it.

    A turn of which no encoder tells has its `rate` [rad/s] and its `angle` [rad] at `t_from`.
    `joints`: angles of the table's axes [rad] in the order of `JOINTS`, where they are known.
    """

    label: str
    t_from: float
    t_to: float
    nominal: tuple[float, ...] | None = None
    joint: str | None = None
    axis_b: tuple[float, ...] | None = None
    rate: float | None = None
    angle: float = 0.0
    joints: tuple[float, ...] = ()


class _Record(BaseModel):
    """Base of the records as they are read: numbers as text or as JSON, finite; more keys pass."""

    model_config = ConfigDict(frozen=True, allow_inf_nan=False, defer_build=True)


# Stamps of ROS end in 2038: no recording lasts longer, and nanoseconds stay within int64.
_LATEST = 2**31
Seconds = Annotated[float, Field(ge=-_LATEST, le=_LATEST)]
# Standard deviations in SI: a thousand of whatever unit is no knowledge any more.
Sigma = Annotated[float, Field(ge=0, le=1e3)]


def _unit(numbers: tuple[float, ...]) -> tuple[float, ...]:
    if abs(sum(x * x for x in numbers) - 1.0) > 1e-6:
        raise ValueError(f"{list(numbers)}: must be of length 1")
    return numbers


_Part = Annotated[float, Field(ge=-2, le=2)]  # of what has length 1, which is checked then
Quaternion = Annotated[tuple[_Part, _Part, _Part, _Part], AfterValidator(_unit)]
UnitVector = Annotated[tuple[_Part, _Part, _Part], AfterValidator(_unit)]
SkewedAxes = tuple[UnitVector, UnitVector, UnitVector]


class RunRecord(_Record):
    """The record `run`, as far as it decides anything."""

    epoch_ns: Annotated[int, Field(ge=0, lt=_LATEST * 10**9)]


class SiteRecord(_Record):
    """What `describe_site` writes; the slack is for rounding from radians and back."""

    latitude_deg: Annotated[float, Field(ge=-90, le=90)] | None = None
    height_m: Annotated[float, Field(ge=-1000, le=20000)] = 0.0
    gravity_m_s2: Annotated[float, Field(gt=9, lt=10.5)] | None = None
    longitude_deg: Annotated[float, Field(ge=-360.1, le=360.1)] = 0.0
    deflection_north_arc_s: Annotated[float, Field(ge=-200.1, le=200.1)] = 0.0
    deflection_east_arc_s: Annotated[float, Field(ge=-200.1, le=200.1)] = 0.0

    def site(self) -> Site:
        """The same in SI."""
        deflection = self.deflection_north_arc_s, self.deflection_east_arc_s
        return Site(
            latitude=None if self.latitude_deg is None else self.latitude_deg * DEG,
            height=self.height_m,
            local_gravity=self.gravity_m_s2,
            longitude=self.longitude_deg * DEG,
            deflection=(deflection[0] * ARC_SECOND, deflection[1] * ARC_SECOND),
        )


# of an axis that turned on through all of the longest procedure
_Angle = Annotated[float, Field(ge=-1e12, le=1e12)]
Angles = Annotated[tuple[_Angle, ...], Field(min_length=len(JOINTS), max_length=len(JOINTS))]


class TurningRecord(_Record):
    """The axis of a step at constant rate."""

    axis: str
    axis_b: UnitVector


class StepRecorded(_Record):
    """A step as it ran, as `describe_schedule` writes it; older recordings know less of it."""

    kind: str
    label: str
    t_from_s: Seconds
    t_to_s: Seconds
    steady_from_s: Seconds | None = None
    steady_to_s: Seconds | None = None
    joints_deg: Angles = ()
    C_nb_xyzw: Quaternion
    turning: TurningRecord | None = None


class ScheduleRecord(_Record):
    """What `describe_schedule` writes."""

    json_: Annotated[Json[tuple[StepRecorded, ...]], Field(alias="json")]


class SettledRecord(RootModel[dict[str, Annotated[float, Field(ge=-_LATEST)]]]):
    """When each dwell had settled; also infinity, for what never did."""


class InterruptedRecord(_Record):
    """Until when a recording goes that was brought back, counted from its epoch."""

    t_s: Seconds


class EstimateRecord(_Record):
    """What `describe_estimate` writes, apart from the priors."""

    methods: str = DEFAULT_METHOD
    offset_window_s: Annotated[float, Field(gt=0, le=_LATEST)] = Options().offset_window
    sequences: SequenceRule = SequenceRule.REGULAR
    accel_later_s: Annotated[float, Field(ge=-1e3, le=1e3)] = 0.0
    gyro_axes: Json[SkewedAxes] | None = None
    accel_axes: Json[SkewedAxes] | None = None


class Sigmas(RootModel[dict[str, Sigma]]):
    """Standard deviations by their keys."""


class DriveRecord(_Record):
    """What `describe_drive` writes, apart from the errors of the fixes."""

    id: str
    start_C_nb_xyzw: Json[Quaternion]
    start_sigma_rad: Annotated[float, Field(gt=0, le=pi)]


def recorded_imu(metadata: Mapping[str, Mapping[str, str]]) -> ImuSpec | None:
    """The preset that a recording of ours carries; None where there is none.

    Raises
    ------
    StandError
        It is not as this version reads it.
    """
    text = metadata.get("imu", {}).get("toml")
    if text is None:
        return None
    name = metadata.get(RUN, {}).get("imu", "imu")
    try:
        return imu_from(catalogue.Source(name, f"{name}.toml", text))
    except StandError as error:
        raise StandError(f"the preset in its metadata: {error}") from error


def epoch_of(metadata: Metadata) -> int:
    """Unix time of a recording's time zero [ns].

    Raises
    ------
    StandError
        As all that read a record here: one line with the record, the key, the value and what is
        allowed.
    """
    return _read(metadata, RUN, RunRecord).epoch_ns


def recorded_steps(metadata: Metadata) -> tuple[StepRecorded, ...]:
    """The schedule's steps; none where there is no schedule."""
    return _read(metadata, SCHEDULE, ScheduleRecord).json_ if SCHEDULE in metadata else ()


def _read(metadata: Metadata, name: str, model: type[ModelT]) -> ModelT:
    return checked(f"{_DAMAGED}: {name}", dict(metadata.get(name, {})), model)


def planned_stretches(metadata: Metadata) -> list[LoggedStretch]:
    """The stretches of the schedule; older recordings know of dwells alone."""
    return [
        LoggedStretch(
            label=step.label,
            t_from=step.t_from_s if step.steady_from_s is None else step.steady_from_s,
            t_to=step.t_to_s if step.steady_to_s is None else step.steady_to_s,
            nominal=step.C_nb_xyzw,
            joint=None if step.turning is None else step.turning.axis,
            axis_b=None if step.turning is None else step.turning.axis_b,
            joints=tuple(angle * DEG for angle in step.joints_deg),
        )
        for step in recorded_steps(metadata)
        if step.kind == "dwell" or step.turning is not None
    ]


def interrupted_at(metadata: Metadata) -> float:
    """When a recording was interrupted [s]; infinity: it is whole."""
    if INTERRUPTED not in metadata:
        return inf
    return _read(metadata, INTERRUPTED, InterruptedRecord).t_s


def settled_stretches(planned: Sequence[LoggedStretch], metadata: Metadata) -> list[LoggedStretch]:
    """The stretches from when the table had settled; what never did is left out."""
    record = metadata.get(SETTLED, {})
    times = {label: text for label, text in record.items() if text != NEVER}
    begins = checked(f"{_DAMAGED}: {SETTLED}", times, SettledRecord).root
    settled = [
        replace(s, t_from=max(s.t_from, begins.get(s.label, s.t_from)))
        for s in planned
        if record.get(s.label) != NEVER
    ]
    return [s for s in settled if s.t_from < s.t_to - EDGE]


@dataclass(frozen=True, slots=True)
class LoggedDrive:
    """What the recording of a drive says: its id, start and `Fixes`' own standard deviations."""

    label: str
    start: tuple[float, ...]
    start_sigma: float
    errors: dict[str, float]


def drive_of(metadata: Metadata) -> LoggedDrive | None:
    """What the recording says of a drive; None where it is none."""
    if DRIVE not in metadata:
        return None
    record = _read(metadata, DRIVE, DriveRecord)
    errors = _sigmas(metadata[DRIVE], DRIVE, {k: f"{k}_{unit}" for k, unit in FIX_UNITS.items()})
    return LoggedDrive(record.id, record.start_C_nb_xyzw, record.start_sigma_rad, errors)


def settings_of(metadata: Metadata) -> tuple[Site, Options, tuple[str, ...]]:
    """Site, options with priors (older recordings have none), and methods."""
    site = _read(metadata, "site", SiteRecord).site()
    estimate = _read(metadata, "estimate", EstimateRecord)
    keys = {name: f"prior_{name}_{unit}" for name, unit in PRIOR_UNITS.items()}
    there = metadata.get("estimate", {})
    # before the base's azimuth had a number of its own, one was told of all three axes
    missing = dict.fromkeys(keys.values(), "0")
    missing[keys["azimuth"]] = there.get(keys["nominal"], "0")
    sigmas = _sigmas(missing | dict(there), "estimate", keys)
    priors = replace(
        Priors(),
        **sigmas,
        accel_later=estimate.accel_later_s,
        gyro_axes=estimate.gyro_axes,
        accel_axes=estimate.accel_axes,
    )
    options = Options(estimate.offset_window_s, estimate.sequences, priors)
    return site, options, tuple(estimate.methods.split(","))


def _sigmas(record: Mapping[str, str], name: str, keys: Mapping[str, str]) -> dict[str, float]:
    """The standard deviations {name: of its key}, all of which must be there."""
    there = {key: record.get(key) for key in keys.values()}
    found = checked(f"{_DAMAGED}: {name}", there, Sigmas).root
    return {own: found[key] for own, key in keys.items()}
