"""How far a mean can be trusted: from the data themselves, not from a data sheet.

Real logs are not white (a dithered ring laser's samples look 40 times noisier than its 16 s
means), so the variance of a mean comes from the scatter of block means.
"""

from itertools import pairwise

import numpy as np

from alignment.arrays import Array
from alignment.errors import NotAtRest, TooShort
from alignment.readings import Dwell, ImuReadings
from alignment.sampling import step_of

# least Allan deviation of flicker noise over its bias instability: sqrt(2 ln 2 / pi), with the
# three digits that IEEE Std 952 (annex C) prints
FLICKER_FLOOR = 0.664
BLOCKS = 32  # the variance of a mean from 32 blocks is itself known to 25 % (1 sigma)

GAP = 10.0  # usual steps: a longer one is a gap

REST_BLOCK = 1.0  # s
REST_TILT = np.radians(0.5)  # of a block's specific force from the mean: 8.7 mg across gravity
REST_RATE = np.radians(0.1)  # rad/s, of a block's rate from the mean
REST_SIGMAS = 6.0  # of a block's mean: of three axes in an hour the largest is near 5
STEPS = 1.8  # of coarse numbers: one on each of three axes
FEWEST_BLOCKS = 5  # from which their own scatter tells something
PROVEN = 4.0  # times the tilt allowed that a rate must have been for, to be a drift for certain
ALIKE = 3.0  # gyros of one unit drift alike, within this factor


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
    """Raise `NotAtRest` with the time where a dwell moved: see `check_rest`."""
    check_rest(dwell.window(), dwell.label)


def check_rest(readings: ImuReadings, label: str) -> None:
    """Raise `NotAtRest` with the time where 1 s means leave their common mean too far.

    Notes
    -----
    Bounds: 0.5 deg of tilt, 0.1 deg/s of rate; or `REST_SIGMAS` standard deviations of a 1 s mean,
    where the noise of the unit is larger, or a step of its numbers. The noise is what successive
    samples differ by, to second order (a motion is smooth from sample to sample), and not more
    than what successive 1 s means differ by (a vibration averages out).

    A rate that wanders slowly, without the tilt that such a turn would make, is a drift and no
    motion. About the vertical that cannot be seen: there a drift is believed up to `ALIKE` times
    that of the other gyros. A steady turn about the vertical looks like a gyro bias.
    """
    blocks = _blocks(readings)
    f, w = block_means(readings.f_b, blocks), block_means(readings.w_ib_b, blocks)
    mean_f = f.mean(axis=0)
    size = float(np.linalg.norm(mean_f))
    if not size or not np.linalg.norm(f, axis=1).all():
        raise NotAtRest(f"{label}: specific force is zero: falling, or no accelerometers")
    tilts = np.arctan2(np.linalg.norm(np.cross(f, mean_f), axis=1), f @ mean_f)
    rates = np.linalg.norm(w - w.mean(axis=0), axis=1)
    tilt = max(REST_TILT, _scatter(readings.f_b, f) / size)
    rate = max(REST_RATE, _scatter(readings.w_ib_b, w))
    span = readings.interval * len(readings) / blocks
    if tilts.max() <= tilt and _is_drift(w, mean_f / size, rate, span):
        rates = np.zeros(blocks)
    worst = int(np.argmax(np.maximum(tilts / tilt, rates / rate)))
    if tilts[worst] > tilt or rates[worst] > rate:
        at = float(readings.t[worst * len(readings) // blocks])
        raise NotAtRest(
            f"{label}: not at rest near {at:.1f} s: tilt {np.degrees(tilts[worst]):.2f} deg, "
            f"rate {np.degrees(rates[worst]):.3f} deg/s off their means "
            f"(allowed {np.degrees(tilt):.2g} deg, {np.degrees(rate):.2g} deg/s)"
        )


def longest_rest(readings: ImuReadings, shortest: float = 10.0) -> tuple[float, float] | None:
    """The longest part [s] between jumps of 1 s means that is at rest, None below `shortest`."""
    blocks = _blocks(readings)
    f, w = block_means(readings.f_b, blocks), block_means(readings.w_ib_b, blocks)
    size = np.linalg.norm(f, axis=1)
    tilt = max(REST_TILT * size.mean(), _scatter(readings.f_b, f))
    rate = max(REST_RATE, _scatter(readings.w_ib_b, w))
    jumps = (np.linalg.norm(np.diff(f, axis=0), axis=1) > tilt) | (
        np.linalg.norm(np.diff(w, axis=0), axis=1) > rate
    )
    # the blocks beside a jump are part of the motion
    edges = [0, *(np.flatnonzero(jumps) + 1), blocks]
    found = sorted(((b - a, a + (a > 0), b - (b < blocks)) for a, b in pairwise(edges)))
    _, first, last = found[-1]
    if last - first < 2:
        return None
    begin, end = (k * len(readings) // blocks for k in (first, last))
    part = ImuReadings(readings.t[begin:end], readings.w_ib_b[begin:end], readings.f_b[begin:end])
    try:
        check_rest(part, "")
    except NotAtRest:
        return None
    t_from, t_to = float(part.t[0]), float(part.t[-1])
    return (t_from, t_to) if t_to - t_from >= shortest else None


def _blocks(readings: ImuReadings) -> int:
    span = readings.interval * len(readings)
    return max(2, min(round(span / REST_BLOCK), len(readings)))


def _scatter(values: Array, means: Array) -> float:
    """How far noise and rounding may move the block means (b, 3) of values (n, 3).

    Of two values nothing: there is no second difference, and their step may be motion.
    """
    if len(values) < 3:
        return 0.0
    per_block = len(values) / len(means)
    second = np.abs(np.diff(values, 2, axis=0))
    sigma = 1.4826 / np.sqrt(6 * per_block) * np.median(second, axis=0)
    if len(means) >= FEWEST_BLOCKS:
        jumps = np.abs(np.diff(means, axis=0))
        sigma = np.minimum(sigma, 1.4826 / np.sqrt(2) * np.median(jumps, axis=0))
    coarse = max(step_of(values[:, k]) for k in range(values.shape[1]))
    return max(REST_SIGMAS * float(sigma.max()), STEPS * coarse)


def _is_drift(w: Array, up: Array, rate: float, span: float) -> bool:
    """Whether rates (b, 3), means over `span` [s] of a unit that did not tilt, only drift."""
    if np.linalg.norm(np.diff(w, axis=0), axis=1).max() > rate:
        return False
    off = w - w.mean(axis=0)
    vertical = off @ up
    across = off - np.outer(vertical, up)
    would_tilt = np.linalg.norm(np.ptp(np.cumsum(across, axis=0), axis=0)) * span
    if would_tilt < PROVEN * REST_TILT:
        return False
    return float(np.abs(vertical).max()) <= max(rate, ALIKE * np.linalg.norm(across, axis=1).max())
