"""What a unit's data sheet says, as errors to first order."""

from math import sqrt

from alignment.information import GaussMarkov, InstrumentErrors, TriadErrors
from stand.imu.filter import LAG, slow_variance
from stand.imu.preset import ImuSpec, TriadSpec
from stand.imu.processes import plateau
from stand.samples import Sampling

# times 1 / bandwidth [Hz]: fourteen time constants of the low-pass, ln(1e6) sqrt 2 / (2 pi). A
# table that comes to rest by 240 deg/s^3 leaves a filter of 1 Hz 6 deg/s behind, of which a part
# in a million is 1 % of Earth rate in the first sample, and soon nothing
FORGOTTEN = 3.11


def slow_noise(imu: ImuSpec, rate_hz: float, sampling: Sampling) -> tuple[float, float]:
    """Density of what many samples of gyros and of accelerometers have of white noise
    [u/sqrt(Hz)]."""
    gyro, accel = (
        t.noise * sqrt(slow_variance(t.bandwidth, rate_hz, sampling)) for t in (imu.gyro, imu.accel)
    )
    return gyro, accel


def late_of(imu: ImuSpec, rate_hz: float) -> float:
    """How long after a motion has ended its last is in the readings still [s]: the latency, and
    what the slower low-pass needs to forget it. To that the motion goes on, as a parabola, to the
    end of the sample that it ends in."""
    settling = FORGOTTEN / min(imu.gyro.bandwidth, imu.accel.bandwidth)
    return float(imu.clock.latency + settling + imu.filtered / rate_hz)


def unit_of(imu: ImuSpec, noise: tuple[float, float] | None = None) -> InstrumentErrors:
    """The instrument's errors as standard deviations, but for the rounding of its samples.

    `noise`: densities as `slow_noise` has them; those of the sheet if not given.
    """
    gyro, accel = (imu.gyro.noise, imu.accel.noise) if noise is None else noise
    lag, _ = lags_of(imu)
    return InstrumentErrors(_triad(imu.gyro, imu, gyro), _triad(imu.accel, imu, accel), lag)


def lags_of(imu: ImuSpec) -> tuple[float, float]:
    """By how much slow readings of gyros come late, and those of accelerometers later still [s]."""
    gyro, accel = (LAG / triad.bandwidth for triad in (imu.gyro, imu.accel))
    return float(gyro + imu.clock.latency), float(accel - gyro)


def _triad(spec: TriadSpec, imu: ImuSpec, noise: float) -> TriadErrors:
    height = spec.instability / plateau(imu.corners)
    return TriadErrors(
        noise=noise,
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
