"""What a calibration should find: the constants that a simulated unit was given."""

import json
from collections.abc import Mapping, Sequence

import numpy as np
from pydantic import Json, TypeAdapter

from alignment.arrays import Array
from alignment.calibration import Key
from stand.errors import StandError
from stand.imu.filter import LAG
from stand.imu.model import UnitErrors
from stand.imu.preset import ImuSpec
from stand.recording.metadata import recorded_imu


def true_value(key: Key, gyro: UnitErrors, accel: UnitErrors, spec: ImuSpec) -> float:
    """One parameter of a simulated unit, SI; lags and lever arms as its sheet says them."""
    errors = gyro if key.sensor == "gyro" else accel
    triad = spec.gyro if key.sensor == "gyro" else spec.accel
    i, j = key.axis, 0 if key.toward is None else key.toward
    A = (
        errors.matrix
        if triad.axes is None
        else np.linalg.solve(np.array(triad.axes), errors.matrix)
    )
    by_term = {
        "bias": lambda: errors.bias[i],
        "scale": lambda: A[i, i] - 1,
        "misalignment": lambda: A[i, j] / A[i, i],
        "asymmetry": lambda: errors.asymmetry[i],
        "k2": lambda: errors.second_order[i],
        "k3": lambda: errors.nonlinearity[i] / triad.full_scale**2,
        "g_sensitivity": lambda: errors.g_sensitivity[i, j],
        "g2_sensitivity": lambda: errors.g2_sensitivity[i, j],
        "lever_arm": lambda: spec.places[i, j],
        "lag": lambda: LAG / triad.bandwidth,
        "temperature_bias": lambda: errors.bias_temperature[i],
        "temperature_scale": lambda: errors.scale_temperature[i],
    }
    return float(by_term[key.term]())


def true_values(keys: Sequence[Key], gyro: UnitErrors, accel: UnitErrors, spec: ImuSpec) -> Array:
    """Parameters (n,) of a simulated unit of this sheet, SI."""
    return np.array([true_value(key, gyro, accel, spec) for key in keys])


_Numbers = TypeAdapter(Json[list[float] | list[list[float]]])


def unit_record(gyro: UnitErrors, accel: UnitErrors) -> dict[str, str]:
    """The constants a unit was given, in SI, as the record `unit` of a recording has them."""
    return {
        f"{sensor}_{name}": json.dumps(getattr(errors, name).tolist())
        for sensor, errors in (("gyro", gyro), ("accel", accel))
        for name in errors.__slots__
    }


def errors_of(
    keys: Sequence[Key], values: Array, metadata: Mapping[str, Mapping[str, str]]
) -> list[float] | None:
    """Values less truth (n,), SI, where a recording of ours says the truth; else None.

    Raises
    ------
    StandError
        The recording's record of its unit is not right.
    """
    drawn, sheet = metadata.get("unit"), recorded_imu(metadata)
    if drawn is None or sheet is None:
        return None
    gyro, accel = (_errors(drawn, sensor) for sensor in ("gyro", "accel"))
    return (np.asarray(values) - true_values(keys, gyro, accel, sheet)).tolist()


def _errors(drawn: Mapping[str, str], sensor: str) -> UnitErrors:
    try:
        return UnitErrors(**{
            name: np.array(_Numbers.validate_python(drawn[f"{sensor}_{name}"]))
            for name in UnitErrors.__slots__
        })  # fmt: skip
    except (KeyError, ValueError) as error:
        raise StandError(f"record unit: not what a unit was given: {error!r}") from error
