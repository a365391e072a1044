"""What a unit's data sheet says, as errors to first order."""

import numpy as np

from alignment.information import GaussMarkov, InstrumentErrors, TriadErrors
from stand.imu.filter import LAG
from stand.imu.preset import ImuSpec, TriadSpec
from stand.imu.processes import plateau


def unit_of(imu: ImuSpec) -> InstrumentErrors:
    """The instrument's errors as standard deviations, but for the rounding of its samples."""
    delay = LAG / imu.gyro.bandwidth if np.isfinite(imu.gyro.bandwidth) else 0.0
    return InstrumentErrors(
        _triad(imu.gyro, imu), _triad(imu.accel, imu), float(delay + imu.clock.latency)
    )


def lags_of(imu: ImuSpec) -> tuple[float, float]:
    """By how much slow readings of gyros come late, and those of accelerometers later still [s]."""
    gyro, accel = (LAG / triad.bandwidth for triad in (imu.gyro, imu.accel))
    return float(gyro + imu.clock.latency), float(accel - gyro)


def _triad(spec: TriadSpec, imu: ImuSpec) -> TriadErrors:
    height = spec.instability / plateau(imu.corners)
    return TriadErrors(
        noise=spec.noise,
        bias=spec.bias,
        ramp=spec.ramp,
        scale=spec.scale,
        asymmetry=spec.asymmetry,
        quadratic=spec.second_order,
        cubic=spec.nonlinearity / spec.full_scale**2,
        misalignment=spec.misalignment,
        non_orthogonality=spec.non_orthogonality,
        g_sensitivity=spec.g_sensitivity,
        g2_sensitivity=spec.g2_sensitivity,
        drift=tuple(GaussMarkov(height, corner) for corner in imu.corners) if height else (),
        random_walk=spec.random_walk,
    )
