"""Metadata records of a recording: written and read by the same words."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from scipy.spatial.transform import Rotation

from alignment import DEFAULT_METHOD, Options, Priors, Site
from alignment.angles import SequenceRule
from alignment.readings import EDGE, Fixes
from alignment.units import ARC_SECOND, DEG
from stand.table.joints import JOINTS

if TYPE_CHECKING:  # planning takes a while to import, and reading needs none of it
    from stand.motion.plan import PlannedStep, Turning


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
MODEL_FOLDER = "model/"  # of the attached files of a stand of one's own
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
class LoggedStretch:
    """A time to estimate from [s]; what it is called, its nominal attitude, what turned it."""

    label: str
    t_from: float
    t_to: float
    nominal: tuple[float, ...] | None = None
    joint: str | None = None
    axis_b: tuple[float, ...] | None = None


def planned_stretches(metadata: Mapping[str, Mapping[str, str]]) -> list[LoggedStretch]:
    """The stretches of the schedule; older recordings know of dwells alone."""
    found = []
    for step in json.loads(metadata["schedule"]["json"]):
        turning = step.get("turning")
        if step["kind"] == "dwell" or turning is not None:
            found.append(
                LoggedStretch(
                    label=step["label"],
                    t_from=float(step.get("steady_from_s", step["t_from_s"])),
                    t_to=float(step.get("steady_to_s", step["t_to_s"])),
                    nominal=tuple(step["C_nb_xyzw"]),
                    joint=None if turning is None else turning["axis"],
                    axis_b=None if turning is None else tuple(turning["axis_b"]),
                )
            )
    return found


def settled_stretches(
    planned: Sequence[LoggedStretch], begins: Mapping[str, str]
) -> list[LoggedStretch]:
    """The stretches from when the table had settled; what never did is left out."""
    settled = [
        replace(s, t_from=max(s.t_from, float(begins.get(s.label, s.t_from))))
        for s in planned
        if begins.get(s.label) != NEVER
    ]
    return [s for s in settled if s.t_from < s.t_to - EDGE]


@dataclass(frozen=True, slots=True)
class LoggedDrive:
    """What the recording of a drive says: its id, start and `Fixes`' own standard deviations."""

    label: str
    start: tuple[float, ...]
    start_sigma: float
    errors: dict[str, float]


def drive_of(record: Mapping[str, str]) -> LoggedDrive:
    return LoggedDrive(
        record["id"],
        tuple(json.loads(record["start_C_nb_xyzw"])),
        float(record["start_sigma_rad"]),
        {key: float(record[f"{key}_{unit}"]) for key, unit in FIX_UNITS.items()},
    )


def settings_of(
    metadata: Mapping[str, Mapping[str, str]],
) -> tuple[Site, Options, tuple[str, ...]]:
    site, estimate = metadata.get("site", {}), metadata.get("estimate", {})

    def number(key: str, unit: float) -> float:
        return float(site.get(key, "0")) * unit

    return (
        Site(
            latitude=number("latitude_deg", DEG) if "latitude_deg" in site else None,
            height=number("height_m", 1.0),
            local_gravity=number("gravity_m_s2", 1.0) if "gravity_m_s2" in site else None,
            longitude=number("longitude_deg", DEG),
            deflection=(
                number("deflection_north_arc_s", ARC_SECOND),
                number("deflection_east_arc_s", ARC_SECOND),
            ),
        ),
        Options(
            float(estimate.get("offset_window_s", Options().offset_window)),
            SequenceRule(estimate.get("sequences", SequenceRule.REGULAR.value)),
            _priors(estimate),
        ),
        tuple(estimate["methods"].split(",")) if "methods" in estimate else (DEFAULT_METHOD,),
    )


def _priors(estimate: Mapping[str, str]) -> Priors:
    """The recorded priors; older recordings have none."""
    keys = {name: f"prior_{name}_{unit}" for name, unit in PRIOR_UNITS.items()}
    return Priors(**{name: float(estimate.get(key, "0")) for name, key in keys.items()})
