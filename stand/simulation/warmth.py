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

    Of where it is farthest from the sheet's a bias and a scale error, of its standard deviation an
    instability of the bias. A scale factor that changes is an accelerometer's bias that drifts
    otherwise in each attitude, by gravity: positions would contradict one another by it. That
    states too much where what changes is along the vertical, or steady.
    """
    imu = at_most(imu)
    t = np.linspace(0.0, max(seconds, 1.0), _TIMES)
    above = temperature.at(t) - imu.reference_temperature
    most = float(np.max(np.abs(above)))
    changed = float(np.std(above)) if np.ptp(above) > _FELT else 0.0
    found: dict[str, float] = {}
    for sensor, pull in zip(SENSORS, (0.0, STANDARD_GRAVITY), strict=True):
        spec = getattr(imu, sensor)
        sizes = {
            "bias": spec.bias_temperature * most,
            "instability": hypot(spec.bias_temperature, pull * spec.scale_temperature) * changed,
            "scale": spec.scale_temperature * most,
        }
        for name, size in sizes.items():
            found[f"{sensor}_{name}"] = hypot(getattr(priors, f"{sensor}_{name}"), size)
    return replace(priors, **found)
