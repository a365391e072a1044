"""What a simulated unit and its table really had, as a calibration tells it."""

import numpy as np

from alignment.arrays import Array
from alignment.calibration import terms
from alignment.calibration.result import Key
from stand.imu.filter import LAG
from stand.imu.model import draw
from stand.imu.preset import ImuSpec


def true_parameters(imu: ImuSpec, seed: int) -> dict[Key, float]:
    """Every parameter [SI] of a unit as it was drawn; lever arms from the unit's own point."""
    values = terms.ALL.matrix @ _unknowns(imu, seed)
    found = dict(zip(terms.ALL.keys, values.tolist(), strict=True))
    for sensor, spec in (("gyro", imu.gyro), ("accel", imu.accel)):
        unit = draw(spec, seed, sensor)
        scale = np.diag(unit.matrix) - 1
        axes = unit.matrix / (1 + scale)[:, None]
        for i in range(3):
            found[Key(sensor, "scale", i)] = float(scale[i])  # pyright: ignore[reportArgumentType]
            for j in range(3):
                if i != j:
                    key = Key(sensor, "misalignment", i, j)  # pyright: ignore[reportArgumentType]
                    found[key] = float(axes[i, j])
    return found


def _unknowns(imu: ImuSpec, seed: int) -> Array:
    """All but scale factors and axes, which the drawn matrix holds."""
    x = np.zeros(terms.COUNT)
    for sensor, spec in (("gyro", imu.gyro), ("accel", imu.accel)):
        unit = draw(spec, seed, sensor)
        cubic = unit.nonlinearity / spec.full_scale**2 if spec.nonlinearity else np.zeros(3)
        lag = LAG / spec.bandwidth if np.isfinite(spec.bandwidth) else 0.0
        own = {
            "bias": unit.bias,
            "asymmetry": unit.asymmetry,
            "k2": unit.second_order,
            "k3": cubic,
            "lag": np.full(3, lag + imu.clock.latency),
            "temperature_bias": unit.bias_temperature,
            "temperature_scale": unit.scale_temperature,
        }
        if sensor == "gyro":
            own |= {
                "g_sensitivity": unit.g_sensitivity.ravel(),
                "g2_sensitivity": unit.g2_sensitivity.ravel(),
            }
        else:
            own["lever_arm"] = imu.places.ravel()
        for name, values in own.items():
            x[terms.columns_of(sensor, name)] = values
    return x
