"""What a unit's warmth adds to what its estimators may know of it."""

from dataclasses import replace
from math import hypot

import numpy as np

from alignment.options import SENSORS, Priors
from alignment.units import STANDARD_GRAVITY
from stand.imu import ImuSpec, Temperature
from stand.imu.by_value import at_most
from stand.procedure.procedure import ProcedureEntry

_TIMES = 400  # at which the temperature is looked at
_FELT = 1e-6  # K: a smaller change is rounding


def observed_for(entry: ProcedureEntry) -> float:
    """Seconds that a procedure's steps take, but for moves and ramps between them."""
    total = 0.0
    for step in entry.step:
        seconds, turns = getattr(step, "duration_s", None), getattr(step, "turns", None)
        rates = getattr(step, "rates_deg_s", (getattr(step, "rate_deg_s", 0.0),))
        ways = 2 if getattr(step, "directions", "one") == "both" else 1
        for rate in rates:
            total += ways * (seconds or (360 * turns / abs(rate) if turns else 0.0))
    return total


def warmed(priors: Priors, imu: ImuSpec, temperature: Temperature, seconds: float) -> Priors:
    """The priors of a unit whose biases and scale factors follow a temperature.

    Biases have a ramp of the temperature's mean slope over those seconds, and an instability of
    what it is off that line, by its standard deviation; what else a bias and a scale error come to
    where the temperature is farthest from the sheet's is constant. A scale factor that changes is
    an accelerometer's bias that drifts otherwise in each attitude, by gravity: no ramp, for
    positions would contradict one another by it, but an instability by all that it changes. That
    states too much where what changes is along the vertical, or steady. Of gyros, which feel what a
    table turns, it has a ramp of the steepest slope.
    """
    imu = at_most(imu)
    t = np.linspace(0.0, max(seconds, 1.0), _TIMES)
    above = temperature.at(t) - imu.reference_temperature
    most = float(np.max(np.abs(above)))
    slope, changed, off = 0.0, 0.0, 0.0
    if np.ptp(above) > _FELT:
        slope, level = np.polyfit(t, above, 1).tolist()
        changed, off = float(np.std(above)), float(np.std(above - level - slope * t))
    beside = float(np.sqrt(max(np.max(above**2 - (slope * t) ** 2), 0.0)))
    found: dict[str, float] = {}
    for sensor, pull in zip(SENSORS, (0.0, STANDARD_GRAVITY), strict=True):
        spec = getattr(imu, sensor)
        by_scale = pull * spec.scale_temperature * changed
        sizes = {
            "bias": spec.bias_temperature * beside,
            "ramp": spec.bias_temperature * abs(slope),
            "instability": hypot(spec.bias_temperature * off, by_scale),
            "scale": spec.scale_temperature * most,
        }
        for name, size in sizes.items():
            found[f"{sensor}_{name}"] = hypot(getattr(priors, f"{sensor}_{name}"), size)
    steepest = float(np.max(np.abs(np.diff(above)))) * (_TIMES - 1) / max(seconds, 1.0)
    found["gyro_scale_ramp"] = imu.gyro.scale_temperature * steepest
    return replace(priors, **found)
