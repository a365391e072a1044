"""Stretches found in a log, as a table and for machines."""

from typing import Any

from alignment.units import DEG, MILLI_G
from stand.recording.found_stretches import FoundStretches
from stand.report.document import angle
from stand.report.tables import TableData

NOTES = (
    "roll and pitch: by gravity, yaw: by the gyros from the first stretch on; noise: of single "
    "samples, the worst axis",
)
_ORDER = {"yaw-pitch-roll": "y-p-r", "yaw-roll-pitch": "y-r-p"}


def stretches_table(found: FoundStretches) -> TableData:
    """One row per stretch."""
    rows = []
    for k, (one, (sequence, angles)) in enumerate(
        zip(found.found, found.angles, strict=True), start=1
    ):
        noise = one.noise.reshape(2, 3).max(axis=1) / (DEG, MILLI_G)
        rows.append(
            (
                str(k),
                "rests" if one.kind == "rest" else "turns",
                f"{one.t_from:.2f}",
                f"{one.t_to:.2f}",
                *(angle(a) for a in angles),
                _ORDER[sequence.value],
                "" if one.kind == "rest" else f"{one.rate / DEG:+.4f}",
                f"{noise[0]:.3g}",
                f"{noise[1]:.3g}",
            )
        )
    columns = ("stretch", "kind", "from s", "to s", "roll deg", "yaw deg", "pitch deg", "turns")
    noises = ("about up deg/s", "gyro noise deg/s", "accel noise mg")
    title = "what stands still or turns evenly about the vertical"
    return TableData(title, (*columns, *noises), tuple(rows), notes=NOTES)


def stretches_json(found: FoundStretches) -> dict[str, Any]:
    """For machines."""
    return {
        "recording": found.path,
        "topic": found.topic,
        "stretches": [
            {
                "kind": "dwell" if one.kind == "rest" else "turn",
                "from_s": one.t_from,
                "to_s": one.t_to,
                "roll_deg": float(angles[0]),
                "yaw_deg": float(angles[1]),
                "pitch_deg": float(angles[2]),
                "sequence": sequence.value,
                "rate_deg_s": one.rate / DEG,
                "mean_w_ib_b_rad_s": one.w_ib_b.tolist(),
                "mean_f_b_m_s2": one.f_b.tolist(),
                "noise_w_rad_s": one.noise[:3].tolist(),
                "noise_f_m_s2": one.noise[3:].tolist(),
            }
            for one, (sequence, angles) in zip(found.found, found.angles, strict=True)
        ],
    }
