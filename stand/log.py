"""A recording as the estimators take it: dwells, what is known about them, and the site."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from alignment import Dwell, ImuReadings, Options, Site
from alignment.angles import SequenceRule
from alignment.units import ARC_SECOND, DEG
from stand.errors import StandError
from stand.physics.kinematics import C_NW
from stand.recording.interchange.reader import ImuLog, read_imu, read_truth
from stand.score import Truths

if TYPE_CHECKING:  # planning takes a while to import, and reading needs none of it
    from stand.plan import PlannedStep

RUN = "run"  # the metadata record that marks a recording of ours


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
    """The metadata record of the steps as they ran; `C_nb_xyzw` is the nominal attitude."""
    entries = [
        {
            "kind": step.kind,
            "label": step.label,
            "t_from_s": step.t_from,
            "t_to_s": step.t_to,
            "joints_deg": [float(a) for a in step.joints / DEG],
            "C_nb_xyzw": [float(a) for a in step.C_nb.as_quat()],
        }
        for step in steps
    ]
    return {"json": json.dumps(entries)}


def describe_estimate(options: Options, methods: Sequence[str]) -> dict[str, str]:
    """The metadata record of what was to be estimated."""
    return {
        "methods": ",".join(methods),
        "offset_window_s": repr(options.offset_window),
        "sequences": options.rule.value,
    }


def load_log(path: Path, topic: str | None, t_from: float | None, t_to: float | None) -> Log:
    """Read a recording and part it into dwells.

    A recording of ours brings its dwells, nominal and true attitudes and site; any other log,
    or a stretch chosen by `t_from` and `t_to`, is one dwell. Times count from the recording's
    epoch (ours, and imported logs: the log's own times) or from the first sample.

    Raises
    ------
    StandError
        The file is not right, or holds nothing between `t_from` and `t_to`.
    """
    imu = read_imu(path, topic)
    if len(imu) < 2:
        raise StandError(f"{path}: one IMU message on {imu.topic}, at least 2 are needed")
    metadata = imu.metadata if "stand_version" in imu.metadata.get(RUN, {}) else {}
    simulated = "schedule" in metadata
    try:
        origin = int(metadata[RUN]["epoch_ns"]) if metadata else int(imu.t_ns[0])
        site, options, methods = _settings(metadata)
        schedule = _schedule(metadata) if simulated else []
    except (KeyError, ValueError, TypeError) as error:
        raise StandError(f"{path}: metadata of the run is damaged: {error}") from error
    t = np.asarray((imu.t_ns - origin) * 1e-9, dtype=np.float64)
    t.flags.writeable = False
    readings = ImuReadings(t, imu.w_ib_b, imu.f_b)
    if t_from is not None or t_to is not None or not simulated:
        schedule = [_stretch(path, readings, schedule, t_from, t_to)]
    dwells = tuple(_dwell(entry, readings) for entry in schedule)
    truths = _truths(path, imu, origin, dwells, site) if simulated else [Truths()] * len(dwells)
    return Log(str(path), imu.topic, simulated, dwells, tuple(truths), site, options, methods)


def _schedule(metadata: Mapping[str, Mapping[str, str]]) -> list[dict]:
    steps = json.loads(metadata["schedule"]["json"])
    return [step for step in steps if step["kind"] == "dwell"]


def _stretch(
    path: Path,
    readings: ImuReadings,
    schedule: Sequence[dict],
    t_from: float | None,
    t_to: float | None,
) -> dict:
    """The chosen stretch as a dwell; it keeps label and attitude of the dwell it lies in."""
    begin = float(readings.t[0]) - readings.interval
    end = float(readings.t[-1])
    a = begin if t_from is None else t_from
    b = end if t_to is None else t_to
    if not (np.isfinite(a) and np.isfinite(b) and begin - 1e-6 <= a < b <= end + 1e-6):
        raise StandError(
            f"{path}: from {a:.3f} to {b:.3f} s: must be a stretch within the recording's "
            f"{begin:.3f} to {end:.3f} s"
        )
    inside = [s for s in schedule if s["t_from_s"] <= a + 1e-6 and b - 1e-6 <= s["t_to_s"]]
    known = inside[0] if inside else {"label": path.stem, "C_nb_xyzw": None}
    return known | {"t_from_s": a, "t_to_s": b}


def _dwell(entry: Mapping, readings: ImuReadings) -> Dwell:
    nominal = entry["C_nb_xyzw"]
    return Dwell(
        entry["label"],
        entry["t_from_s"],
        entry["t_to_s"],
        readings,
        None if nominal is None else Rotation.from_quat(nominal),
    )


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
        ),
        tuple(estimate["methods"].split(",")) if "methods" in estimate else ("triad",),
    )


def _truths(
    path: Path, imu: ImuLog, origin: int, dwells: Sequence[Dwell], site: Site
) -> list[Truths]:
    truth = read_truth(path)
    t = (truth.t_ns - origin) * 1e-9
    last = np.searchsorted(t, [dwell.t_to + 1e-6 for dwell in dwells]) - 1
    return [
        Truths(C_NW * Rotation.from_quat(truth.q_wb[k]), dwell.nominal, site.latitude)
        for k, dwell in zip(last, dwells, strict=True)
    ]
