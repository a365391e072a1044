"""What a procedure's temperature does to a unit: biases and scale factors that follow it."""

from collections.abc import Sequence

import numpy as np

from alignment.arrays import Array
from alignment.information import Stretch
from stand.imu import Temperature
from stand.imu.preset import ImuSpec, TriadSpec
from stand.rehearsal.scene import Scene

_TIMES = 400  # of a stretch at which the temperature is looked at


def warmed(
    stretches: Sequence[Stretch], coefficients: Sequence[Array], scene: Scene
) -> tuple[Array, Array]:
    """Covariances (m, m) of the coefficients by gyros and by accelerometers that warm up.

    `coefficients` (h, 6): constant, cosine and sine of what perfect sensors read in a stretch.
    """
    edges = np.cumsum([0, *(c.size for c in coefficients)])
    found = np.zeros((2, edges[-1], edges[-1]))
    if scene.temperature is None:
        return found[0], found[1]
    columns = []
    for stretch, c in zip(stretches, coefficients, strict=True):
        t = stretch.start + stretch.span.length * (np.arange(_TIMES) + 0.5) / _TIMES
        beta = stretch.angle + stretch.rate * (t - stretch.start)
        waves = np.stack([np.ones(_TIMES), np.cos(beta), np.sin(beta)])[: len(c)]
        weights = waves * np.array([1.0, 2.0, 2.0])[: len(c), None] / _TIMES
        warmth = above_reference(scene.temperature, scene.imu, t)
        columns.append((weights @ warmth, weights @ (warmth[:, None] * (waves.T @ c))))
    bias = np.concatenate([b for b, _ in columns])
    scale = np.concatenate([s for _, s in columns])
    for channel in range(6):
        spec, own = triad_of(scene.imu, channel // 3), slice(channel, None, 6)
        for v in (spec.bias_temperature * bias, spec.scale_temperature * scale[:, channel]):
            found[channel // 3][own, own] += np.outer(v, v)
    return found[0], found[1]


def above_reference(temperature: Temperature, imu: ImuSpec, t: Array) -> Array:
    """Kelvin above the temperature at which the data sheet's values hold."""
    return temperature.at(t) - imu.reference_temperature


def triad_of(imu: ImuSpec, number: int) -> TriadSpec:
    """Gyros, then accelerometers."""
    return (imu.gyro, imu.accel)[number]
