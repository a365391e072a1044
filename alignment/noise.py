"""How far a mean can be trusted: from the data themselves, not from a data sheet.

Real logs are not white (a dithered ring laser's samples look 40 times noisier than its 16 s
means), so the variance of a mean comes from the scatter of block means.
"""

import numpy as np

from alignment.arrays import Array
from alignment.errors import NotAtRest, TooShort
from alignment.readings import Dwell, ImuReadings

# least Allan deviation of flicker noise over its bias instability: sqrt(2 ln 2 / pi), with the
# three digits that IEEE Std 952 (annex C) prints
FLICKER_FLOOR = 0.664
BLOCKS = 32  # the variance of a mean from 32 blocks is itself known to 25 % (1 sigma)

GAP = 10.0  # usual steps: a longer one is a gap

REST_BLOCK = 1.0  # s
REST_TILT = np.radians(0.5)  # of a block's specific force from the mean: 8.7 mg across gravity
REST_RATE = np.radians(0.1)  # rad/s, of a block's rate from the mean


def block_means(values: Array, blocks: int) -> Array:
    """Means (blocks, k) of successive stretches of `values` (n, k), n >= blocks."""
    n = len(values)
    if n < blocks:
        raise TooShort(f"{n} samples: at least {blocks} are needed")
    edges = np.arange(blocks + 1) * n // blocks
    sums = np.add.reduceat(values, edges[:-1], axis=0)
    return sums / np.diff(edges)[:, None]


def mean_variance(values: Array) -> Array:
    """Variance (k,) of the mean of `values` (n, k), from the scatter of its block means.

    Notes
    -----
    Holds while errors of different blocks are independent: noise with correlation longer than a
    32nd of the record, and any constant bias, are not in it. Blocks of n samples differ by one
    where 32 does not divide n, which overstates the variance (by 12 % at n = 48, 1 % at 500).
    """
    return _mean_and_variance(values)[1]


def mean_and_variance(readings: ImuReadings) -> tuple[Array, Array]:
    """Means (6,) of rates and forces, and the variances (6,) of those means, as `mean_variance`."""
    w, w_variance = _mean_and_variance(readings.w_ib_b)
    f, f_variance = _mean_and_variance(readings.f_b)
    return np.concatenate([w, f]), np.concatenate([w_variance, f_variance])


def _mean_and_variance(values: Array) -> tuple[Array, Array]:
    """In one pass over the values: the mean is that of the block means, by their lengths."""
    n, blocks = len(values), min(BLOCKS, len(values))
    means = block_means(values, blocks)
    lengths = np.diff(np.arange(blocks + 1) * n // blocks)
    return lengths @ means / n, means.var(axis=0, ddof=1) / blocks


def gap_doubt(readings: ImuReadings) -> tuple[str, ...]:
    """A flag where a step between stamps is above ten times the usual one."""
    steps = np.diff(readings.t)
    longest = int(np.argmax(steps))
    gap = float(steps[longest])
    if gap <= GAP * np.median(steps, overwrite_input=True):  # an hour's steps need no copy
        return ()
    return (f"gap of {gap:.3g} s after {readings.t[longest]:.3f} s",)


def check_at_rest(dwell: Dwell) -> None:
    """Raise `NotAtRest` with the time when 1 s means leave their common mean too far.

    Bounds: 0.5 deg of tilt, 0.1 deg/s of rate. A steady turn about the vertical looks like a
    gyro bias and cannot be seen here.
    """
    readings = dwell.window()
    span = readings.interval * len(readings)
    blocks = max(2, min(round(span / REST_BLOCK), len(readings)))
    f = block_means(readings.f_b, blocks)
    w = block_means(readings.w_ib_b, blocks)
    mean_f = f.mean(axis=0)
    norms = np.linalg.norm(f, axis=1) * np.linalg.norm(mean_f)
    tilt = np.arctan2(np.linalg.norm(np.cross(f, mean_f), axis=1), f @ mean_f)
    rate = np.linalg.norm(w - w.mean(axis=0), axis=1)
    if not norms.all():
        raise NotAtRest(f"{dwell.label}: specific force is zero: falling, or no accelerometers")
    worst = int(np.argmax(np.maximum(tilt / REST_TILT, rate / REST_RATE)))
    if tilt[worst] > REST_TILT or rate[worst] > REST_RATE:
        at = float(readings.t[worst * len(readings) // blocks])
        raise NotAtRest(
            f"{dwell.label}: not at rest near {at:.1f} s: tilt {np.degrees(tilt[worst]):.2f} deg, "
            f"rate {np.degrees(rate[worst]):.3f} deg/s off their means "
            f"(allowed {np.degrees(REST_TILT):.1f} deg, {np.degrees(REST_RATE):.1f} deg/s)"
        )
