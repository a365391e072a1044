"""What a data sheet tells of the numbers themselves: full scale, steps, and what blurs them."""

from dataclasses import replace
from math import sqrt

from alignment.readings import Grain, ImuReadings
from stand.imu.filter import noise_variance
from stand.imu.preset import ImuSpec, TriadSpec
from stand.samples import Sampling


def known_readings(readings: ImuReadings, imu: ImuSpec, rate_hz: float) -> ImuReadings:
    """The readings with what the unit's sheet states of them."""
    ranges, grains = stated_of(imu, rate_hz)
    return replace(readings, ranges=ranges, grains=grains)


def stated_of(
    imu: ImuSpec, rate_hz: float, sampling: Sampling = Sampling.MEAN
) -> tuple[tuple[float, float], tuple[Grain, Grain]]:
    """Full scale and rounding, as fields of `ImuReadings`."""
    return imu.ranges, grains_of(imu, rate_hz, sampling)


def grains_of(
    imu: ImuSpec, rate_hz: float, sampling: Sampling = Sampling.MEAN
) -> tuple[Grain, Grain]:
    """Of gyros and of accelerometers; increments carry their remainders on."""
    gyro, accel = (
        Grain(
            step=0.0 if imu.increments else spec.resolution,
            noise=_sample_noise(spec, rate_hz, sampling),
            increment=spec.increment_lsb if imu.increments else 0.0,
        )
        for spec in (imu.gyro, imu.accel)
    )
    return gyro, accel


def _sample_noise(spec: TriadSpec, rate_hz: float, sampling: Sampling) -> float:
    """Standard deviation of one sample's white noise behind the low-pass."""
    return spec.noise * sqrt(rate_hz * noise_variance(spec.bandwidth, rate_hz, sampling))
