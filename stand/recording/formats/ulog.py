"""PX4's .ulg, by pyulog."""

from pathlib import Path
from typing import Any

import numpy as np

from stand.errors import StandError, unknown
from stand.recording.formats.extras import damaged, missing
from stand.recording.formats.table import ArrayTable

_COMBINED, _IMU = "sensor_combined", "vehicle_imu"
_AXES = "axes as PX4 has them, forward, right, down: --axes FRD gives roll and heading of a vehicle"


def read_ulog(path: Path, topic: str | None) -> ArrayTable:
    """sensor_combined, or vehicle_imu: rates and forces, of the latter from its increments.

    Of several units the number stands behind: vehicle_imu_1.
    """
    try:
        from pyulog import ULog
    except ImportError:
        raise missing(path, "PX4's log", "pyulog") from None
    try:
        with path.open("rb") as file:
            log = ULog(file, [_COMBINED, _IMU], disable_str_exceptions=True)
        found = {_name(data): data.data for data in log.data_list}
    except Exception as error:  # whatever the library says to bytes that make no sense
        raise damaged(path, "PX4 log", error) from error
    if not found:
        raise StandError(f"{path}: neither {_COMBINED} nor {_IMU} was logged")
    if topic is not None and topic not in found:
        raise unknown("--topic", topic, found)
    chosen = topic or (_COMBINED if _COMBINED in found else _only(path, found))
    try:
        columns = (_combined if chosen == _COMBINED else _increments)(found[chosen])
    except KeyError as error:
        raise StandError(f"{path}: {chosen} without {error}") from None
    names = list(columns)
    return ArrayTable(
        topic=chosen,
        names=tuple(names),
        rows=len(columns[names[0]]),
        width=len(names),
        column=lambda k: columns[names[k]],
        notes=(_AXES,),
    )


def _name(data: Any) -> str:
    alone = data.name == _COMBINED and data.multi_id == 0
    return data.name if alone else f"{data.name}_{data.multi_id}"


def _only(path: Path, found: dict[str, Any]) -> str:
    if len(found) > 1:
        raise StandError(f"{path}: several IMU topics, choose one with --topic: {', '.join(found)}")
    return next(iter(found))


def _combined(data: dict[str, Any]) -> dict[str, Any]:
    gyro = {f"gyro_{a} [rad/s]": data[f"gyro_rad[{k}]"] for k, a in enumerate("xyz")}
    accel = {f"accel_{a} [m/s^2]": data[f"accelerometer_m_s2[{k}]"] for k, a in enumerate("xyz")}
    return {"timestamp [us]": data["timestamp"], **gyro, **accel}


def _increments(data: dict[str, Any]) -> dict[str, Any]:
    found = {"timestamp [us]": data["timestamp_sample"]}
    for name, unit, source in (
        ("gyro", "rad/s", "delta_angle"),
        ("accel", "m/s^2", "delta_velocity"),
    ):
        step = np.asarray(data[f"{source}_dt"], float) * 1e-6
        with np.errstate(all="ignore"):  # a step of zero is refused as not finite
            found |= {
                f"{name}_{a} [{unit}]": np.asarray(data[f"{source}[{k}]"], float) / step
                for k, a in enumerate("xyz")
            }
    return found
