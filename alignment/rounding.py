"""What rounding leaves of the mean of many samples, where noise does not blur the steps.

Source: B. Widrow and I. Kollar, Quantization Noise (2008), ch. 9; methods.md section 7.
"""

from dataclasses import replace
from itertools import pairwise

import numpy as np

from alignment.arrays import Array
from alignment.options import Priors
from alignment.readings import ImuReadings
from alignment.sampling import seldom_change, step_of

WAVES = 200  # harmonics of a staircase: those beyond hold 0.3 % of what rounding does
_BLURRED = 0.6  # steps of noise from which it is seen in the rounded values, and blurs the steps
_FIRST = 64  # samples: where none is like the one before, no channel hardly changes
_BLOCK = 10.0  # s: a unit that rests through most of them is told by those


def waves(step: float, sigma: float) -> tuple[Array, Array]:
    """Wave numbers (n,) per unit of a reading, and mean squares of each wave that is left.

    Notes
    -----
    Rounding of x takes away ``sum_n (-1)^n q/(pi n) sin(2 pi n x / q)``. The mean over normal noise
    of `sigma` multiplies each wave by ``exp(-2 (pi n sigma / q)^2)``: what is left depends on where
    in a step x lies, and no time averages it out. Anywhere in it, its mean square is half of the
    wave's: ``q^2/12`` in all without noise, ``(q/pi)^2/2 exp(-4 (pi sigma/q)^2)`` with much.
    """
    turns = 2 * np.pi * np.arange(1, WAVES + 1) / step
    return turns, 2 / turns**2 * np.exp(-((turns * sigma) ** 2))


def steps_of(readings: ImuReadings) -> Array:
    """Steps (6,) of rates and forces: what `readings` know, else what their numbers show.

    A channel that hardly changes shows none: it has that of its triad, or its own least change.
    """
    if readings.grains is not None:
        return np.repeat([grain.step for grain in readings.grains], 3)
    return np.concatenate([_shown_by(triad) for triad in (readings.w_ib_b, readings.f_b)])


def _shown_by(triad: Array) -> Array:
    """Steps (3,) that the values (n, 3) of a triad show."""
    steps = np.array([step_of(channel) for channel in triad.T])
    if steps.all() or np.all(np.diff(triad[:_FIRST], axis=0)):
        return steps
    changes = np.array([seldom_change(channel) for channel in triad.T])
    hardly = (changes > 0) | (np.ptp(triad, axis=0) == 0)
    usual = np.max(np.where(steps > 0, steps, changes))
    return np.where(hardly, np.maximum(changes, usual), steps)


def rounding_variance(readings: ImuReadings, steps: Array | None = None) -> Array:
    """Variance (6,) of means of rates and forces at rest by the rounding to `steps` (6,).

    The steps are `steps_of` the readings if they are not given; the noise that blurs them what the
    readings know, and what they show where that is above 0.6 steps. Below, rounded values do not
    tell it, and without a data sheet the mean may be anywhere in its step.
    """
    steps = steps_of(readings) if steps is None else steps
    told = zip(steps.tolist(), blur_of(readings, steps).tolist(), strict=True)
    return np.array([waves(*one)[1].sum() if one[0] else 0.0 for one in told])


def end_variance(readings: ImuReadings) -> Array:
    """Variance (6,) of the angle [rad^2] and velocity [m^2/s^2] so far by rounded increments.

    Remainders are carried on, so that only what the last one leaves is missing: anywhere in a
    step q, ``q^2/12``; of a mean over T, which has two ends, ``q^2/(6 T^2)``.
    """
    if readings.grains is None:
        return np.zeros(6)
    return np.repeat([grain.increment**2 / 12 for grain in readings.grains], 3)


def blur_of(readings: ImuReadings, steps: Array) -> Array:
    """Noise (6,) of samples that blurs the `steps` (6,), as `rounding_variance` takes it."""
    noises = [0.0, 0.0] if readings.grains is None else [grain.noise for grain in readings.grains]
    channels = (*readings.w_ib_b.T, *readings.f_b.T)
    told = zip(channels, steps.tolist(), np.repeat(noises, 3).tolist(), strict=True)
    return np.array([_blur(*one, readings.interval) for one in told])


def shared_rounding(step: float, noises: Array, apart: Array, doubts: Array) -> Array:
    """Covariance (n, n) of what rounding to `step` leaves of means that differ by `apart` (n, n).

    That is known to variances `doubts` (n, n); where in a step they lie is not. Two share
    ``cos(k d)`` of each wave k of their means that noise (n,) leaves, and as d is known to s only,
    that times ``exp(-(k s)^2/2)``: all where they are known to be alike, none where they may be a
    step apart.
    """
    turns, _ = waves(step, 0.0)
    k = turns[:, None]
    left = np.sqrt(2) / k * np.exp(-((k * noises) ** 2) / 2)
    together = np.cos(k[..., None] * apart) * np.exp(-(k[..., None] ** 2) * doubts / 2)
    return np.asarray(np.einsum("ki,kij,kj->ij", left, together, left))


def with_rounding(priors: Priors, readings: ImuReadings) -> Priors:
    """The priors of one to whom what rounding leaves of readings at rest is a bias."""
    left = rounding_variance(readings)
    gyro, accel = float(left[:3].max()), float(left[3:].max())
    return replace(
        priors,
        gyro_bias=float(np.sqrt(priors.gyro_bias**2 + gyro)),
        accel_bias=float(np.sqrt(priors.accel_bias**2 + accel)),
    )


def _blur(channel: Array, step: float, noise: float, interval: float) -> float:
    if step == 0.0:
        return noise
    shown = _usual_variance(channel, interval) - step**2 / 12
    return max(noise, float(np.sqrt(shown))) if shown > (_BLURRED * step) ** 2 else noise


def _usual_variance(channel: Array, interval: float) -> float:
    """Median over blocks of the variance within each: turns between rests do not count."""
    blocks = max(1, int(len(channel) * interval / _BLOCK))
    edges = np.arange(blocks + 1) * len(channel) // blocks
    parts = (channel[a:b] for a, b in pairwise(edges.tolist()))
    return float(np.median([part.var() for part in parts]))
