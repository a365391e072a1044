"""How far a mean can be trusted: from the data themselves, not from a data sheet.

Real logs are not white: a dithered ring laser's samples look 40 times noisier than its 16 s means,
and accelerometers settle for minutes. So the variance of a mean comes from what the record shows
in the band that a mean lets through.
"""

from functools import lru_cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from alignment.apart import PARTS, Apart, apart
from alignment.arrays import Array
from alignment.doubts import apart_doubt, drift_doubt, drift_words
from alignment.errors import NotAtRest, TooShort
from alignment.once import once
from alignment.options import SENSORS, Priors
from alignment.parts import PART, excerpts, mean, parts, release, sums_between
from alignment.readings import Dwell, ImuReadings
from alignment.rounding import end_variance, rounding_variance
from alignment.sampling import step_of

# least Allan deviation of flicker noise over its bias instability: sqrt(2 ln 2 / pi), with the
# three digits that IEEE Std 952 (annex C) prints
FLICKER_FLOOR = 0.664
BLOCKS = 32  # the variance of a mean from 32 blocks is itself known to 25 % (1 sigma)
_TELL_NOTHING = 3  # samples: squares of errors over the variance that they show have no mean
_FINE = 4096  # blocks from which waves are summed: fewer would fold jitter down to them
_ORDERS = 20  # periods of a record below which noise counts for its mean
_FAR_LESS = 0.35  # of the whole: chance makes that of the lower half of orders in 2 of 1000
_DRIFT_ORDERS = 8
_WHOLE = 0.98  # part of a record from which a dwell is all of it
_FEWEST_WINDOWS = 5  # from which their scatter tells something: a record has at least as many
DISTURBED = 2.0  # usual sigmas: that of a window which is no measure of the others
_NOTHING = Apart(0.0, 0.0, np.zeros(6))
_DRIFTS = 15.0  # mean F (1, 10 degrees of freedom) of three axes: 1 in 10 000 records of noise

_FAINT = 5.0  # mean F (1, 28) of twenty orders: 1 in 200 records of noise

_STATED = 3.0  # standard deviations of a stated drift: one of 400 is beyond

GAP = 10.0  # usual steps: a longer one is a gap

REST_BLOCK = 1.0  # s
REST_TILT = np.radians(0.5)  # of a block's specific force from the mean: 8.7 mg across gravity
REST_RATE = np.radians(0.1)  # rad/s, of a block's rate from the mean
REST_SIGMAS = 6.0  # of a block's mean: of three axes in an hour the largest is near 5
STEPS = 1.8  # of coarse numbers: one on each of three axes
FEWEST_BLOCKS = 5  # from which their own scatter tells something
_FEW_VALUES = 16  # of which a motion makes as many lines as it leaves free
PROVEN = 4.0  # times the tilt allowed that a rate must have been for, to be a drift for certain
ALIKE = 3.0  # gyros of one unit drift alike, within this factor


def block_means(values: Array, blocks: int) -> Array:
    """Means (blocks, k) of successive stretches of `values` (n, k), n >= blocks."""
    n = len(values)
    if n < blocks:
        raise TooShort(f"{n} samples: at least {blocks} are needed")
    edges = np.arange(blocks + 1) * n // blocks
    return sums_between(values, edges) / np.diff(edges)[:, None]


def mean_variance(values: Array) -> Array:
    """Variance (k,) of the mean of `values` (n, k), from what the record shows at low frequency.

    Notes
    -----
    Rates that begin and end somewhere in a jitter of the angle have a mean that is off by what the
    angle jumps from end to end over T, whatever the rate's own noise. So ``S/T`` of the density S
    at low frequency, and ``2 V/T^2`` of the variance V of the integral about its line; white noise
    makes a V of ``S T/15``, for which the first is lessened. S is the mean of 30 ordinates below
    20 periods of the record by waves that vanish at its ends: jitter does not leak into it. Where
    noise rises within them the lower half counts. White noise tells the variance to 25 % (1 sigma).

    Then the square of a steady drift over the record, where the columns, a triad's, show one
    beyond doubt (see `drift_of`): what came before and after differs by as much; and of what one
    part of the record adds to the mean, where that lies apart from the others (see `apart`).
    Records of 32 samples or fewer give the textbook variance. A constant bias is not in it, nor a
    drift below the noise.
    """
    shown = _shown_by(values)
    _, off = apart(shown.parts)
    drift = _drift(shown.cosines, shown.sines, len(values))
    return shown.variance + drift**2 + (off / PARTS) ** 2


class _Shown(NamedTuple):
    """What columns (n, k) show: the variances (k,) of their means but for drifts, `_waves`, and
    means of sixteen parts less that of all (16, k)."""

    variance: Array
    cosines: Array
    sines: Array
    parts: Array


def _shown_by(values: Array) -> _Shown:
    n = len(values)
    if n <= BLOCKS:
        none = np.zeros((_ORDERS, values.shape[1]))
        return _Shown(values.var(axis=0, ddof=1) / n, none, none, np.zeros((PARTS, none.shape[1])))
    sums, edges = _sums(values)
    level, cosines, sines = _level(sums, edges)
    variance = 13 / 15 * level + 2 * _integral_variance(sums, edges) / n**2
    return _Shown(variance, cosines, sines, _part_means(sums, edges))


def _part_means(sums: Array, edges: np.ndarray) -> Array:
    """Means (16, k) of parts, by sums over blocks between edges [samples]."""
    first = np.arange(PARTS + 1) * len(sums) // PARTS
    total = np.add.reduceat(sums, first[:-1], axis=0)
    return np.asarray(total / np.diff(edges[first])[:, None])


@once
def _means_and_shown(readings: ImuReadings) -> tuple[Array, Array, Array, Apart, Array]:
    """Means (6,), their variances but for drifts, drifts (6,), what lies apart, and drifts (6,) of
    triads that may have one, too faint to count.

    Of all channels together, which is faster, where they are not many.
    """
    n, both = len(readings), (readings.w_ib_b, readings.f_b)
    columns = (np.hstack(both),) if n <= PART else both
    means = np.concatenate([mean(values) for values in columns])
    shown = [_shown_by(values) for values in columns]
    variances = np.concatenate([one.variance for one in shown])
    # a channel that stays on one count shows nothing of what its ends leave
    variances = np.maximum(variances, 2 * end_variance(readings) / (n * readings.interval) ** 2)
    cosines, sines, sixteen = (np.hstack([one[k] for one in shown]) for k in (1, 2, 3))
    triads = slice(3), slice(3, 6)
    drifts = [_drift(cosines[:, own], sines[:, own], n) for own in triads]
    faint = [
        _faint(cosines[:, own], sines[:, own], n) * (not drift.any())
        for own, drift in zip(triads, drifts, strict=True)
    ]
    one = _apart(readings, sixteen)
    return means, variances, np.concatenate(drifts), one, np.concatenate(faint)


def _apart(readings: ImuReadings, means: Array) -> Apart:
    """When readings lie apart, by means (16, 6): the part that gyros name, else accelerometers."""
    (k, gyro), (other, accel) = apart(means[:, :3]), apart(means[:, 3:])
    if not gyro.any():
        k = other
    elif other != k:
        accel = np.zeros(3)  # another part's, which is left in the noise
    span = readings.interval * len(readings) / PARTS
    start = float(readings.t[0] - readings.interval + k * span)
    return Apart(start, start + span, np.concatenate([gyro, accel]))


def apart_of(readings: ImuReadings) -> Apart:
    """What lies apart from the rest of a record at rest; zeros where nothing does."""
    return _means_and_shown(readings)[3]


@once
def mean_and_variance(readings: ImuReadings) -> tuple[Array, Array]:
    """Means (6,) of rates and forces, and the variances (6,) of those means, as `mean_variance`."""
    means, variances, drifts, one, _ = _means_and_shown(readings)
    variances = variances + drifts**2 + (one.off / PARTS) ** 2
    means.flags.writeable = variances.flags.writeable = False  # there is one for all who ask
    return means, variances


def mean_and_unstated(readings: ImuReadings, stated: Array) -> tuple[Array, Array]:
    """As `mean_and_variance`, for one who counts drifts by their sheet: no drift twice.

    Drifts from end to end within three standard deviations of what the sheet states of them,
    variances `stated` (6,), are left out of the variances; one beyond that nobody stated.
    """
    means, variances = mean_and_variance(readings)
    squares = _means_and_shown(readings)[2] ** 2
    return means, variances - np.where(squares <= _STATED**2 * stated, squares, 0.0)


def believed(variances: Array, readings: ImuReadings, *walks: float) -> Array:
    """Variances of means as few `readings` show them of themselves: no less than the sheet's noise.

    Parameters
    ----------
    variances : (3 k,)
        Of means of all `readings`: of gyros, or of accelerometers after them.
    walks : k floats
        White noise that the sheets state of them [u/sqrt(Hz)]; 0 where none does.

    Returns
    -------
    Array
        The same of `BLOCKS` readings or more.

    Raises
    ------
    TooShort
        Of three readings or fewer that scatter, where no sheet states noise.

    Notes
    -----
    The variance of a mean by n normal readings has n - 1 degrees of freedom, and the mean of
    ``1/chi2`` of m is ``1/(m - 2)``: squares of errors over it come to (n - 1)/(n - 3), by which
    it is more where nothing else is known, and of three they have no mean.
    """
    n, stated = len(readings), np.repeat(walks, 3)
    if n >= BLOCKS:
        return variances
    scatter = np.ptp(np.hstack([readings.w_ib_b, readings.f_b])[:, : len(stated)], axis=0)
    alone = (stated == 0) & (scatter > 0)
    if n <= _TELL_NOTHING and alone.any():
        at = f"{n} samples until {readings.t[-1]:.3f} s"
        raise TooShort(f"{at} do not tell their noise: at least {_TELL_NOTHING + 1}, or a sheet's")
    few = (n - 1) / max(n - _TELL_NOTHING, 1)
    least = np.maximum(variances, stated**2 / (n * readings.interval))
    return np.asarray(np.where(alone, few * variances, least))


def dwell_mean_and_variance(dwell: Dwell, window: ImuReadings) -> tuple[Array, Array]:
    """Means (6,) of a dwell's `window` and their variances: noise, rounding, drift around it."""
    means, variances = mean_and_variance(window)
    return means, variances + around_variance(dwell) + rounding_variance(window)


def around_variance(dwell: Dwell) -> Array:
    """Variance (6,) of a dwell's means by what only the record it is cut from shows.

    Notes
    -----
    Of a record at rest that drifts steadily by D from end to end, windows that are a part p of it
    have means that are spread evenly over ``(1 - p) D``: variance ``((1 - p) D)^2/12``. Of what
    lies apart a window has the share that falls into it. Where means of as long windows scatter by
    more than all that, as flicker noise makes them, what is more counts. Zeros where the record
    moves, or is the dwell.
    """
    return _told_around(dwell) + wander_around(dwell)


def _told_around(dwell: Dwell) -> Array:
    drift, part = drift_around(dwell)
    one = apart_around(dwell)
    share = one.share(dwell.t_from, dwell.t_to)
    return np.asarray(((1 - part) * drift) ** 2 / 12 + (share * one.off) ** 2)


def wander_around(dwell: Dwell) -> Array:
    """By how much means of windows like the dwell vary (6,) beyond their noise, drift and share.

    Zeros where there are fewer than five, or the record moves.
    """
    count = round(len(dwell.readings) / len(dwell.window()))
    return np.zeros(6) if count < _FEWEST_WINDOWS else _wander_at_rest(dwell.readings, count)


@lru_cache(maxsize=1)  # the windows of one record ask one after the other
def _wander_at_rest(readings: ImuReadings, count: int) -> Array:
    """As `wander_around`, of so many windows but those that drift or are disturbed: they excuse no
    other. Zeros of a triad whose ratios of found to expected are, on average, within three
    standard errors of one."""
    try:
        check_rest(readings, "")
    except NotAtRest:
        return np.zeros(6)
    t_from, span = readings.t[0] - readings.interval, readings.interval * len(readings) / count
    starts = (t_from + span * np.arange(count)).tolist()
    windows = [Dwell("", start, start + span, readings) for start in starts]
    shown = [mean_and_variance(window.window()) for window in windows]
    told = np.array([own + _told_around(w) for w, (_, own) in zip(windows, shown, strict=True)])
    calm = told <= DISTURBED**2 * np.median(told, axis=0)
    found = np.var([means for means, _ in shown], axis=0, ddof=1, where=calm)
    expected = np.mean(told, axis=0, where=calm)
    ratios = np.divide(found, expected, out=np.zeros(6), where=expected > 0).reshape(2, 3)
    beyond = ratios.mean(axis=1) > 1 + 3 * np.sqrt(2 / (3 * (count - 1)))
    return np.repeat(beyond, 3) * np.maximum(found - expected, 0.0)


def apart_around(dwell: Dwell) -> Apart:
    """What lies apart in the record that a dwell is cut from; zeros where that moves, or is the
    dwell."""
    part = len(dwell.window()) / len(dwell.readings)
    return _NOTHING if part > _WHOLE else _shown_at_rest(dwell.readings)[1]


def drift_around(dwell: Dwell) -> tuple[Array, float]:
    """How far the record that a dwell is cut from drifts (6,) at rest, and the dwell's part of it.

    Zeros where the record moves, or is the dwell.
    """
    part = len(dwell.window()) / len(dwell.readings)
    return (np.zeros(6) if part > _WHOLE else _shown_at_rest(dwell.readings)[0]), part


def around_doubt(dwell: Dwell) -> tuple[str, ...]:
    """Flags where a dwell's record drifts, or what lies apart there falls into it."""
    drift, _ = drift_around(dwell)
    flags: tuple[str, ...] = ()
    if drift.any():
        flags = (f"the record around it drifts, {drift_words(drift[:3], drift[3:])}: counted",)
    if wander_around(dwell).any():
        flags += ("windows as long as this scatter by more than its noise and drift: counted",)
    one = apart_around(dwell)
    return flags + apart_doubt(one) * bool(one.share(dwell.t_from, dwell.t_to))


@once  # for all windows of one record
def _shown_at_rest(readings: ImuReadings) -> tuple[Array, Apart]:
    """Drifts (6,) from end to end and what lies apart; zeros of a record that moves."""
    try:
        check_rest(readings, "")
    except NotAtRest:
        return np.zeros(6), _NOTHING
    drift = np.concatenate([drift_of(readings.w_ib_b), drift_of(readings.f_b)])
    return drift, apart_of(readings)


def integral_variance(values: Array) -> Array:
    """Variance (k,) of the sum of `values` (n, k) so far about its line, in samples squared."""
    return _integral_variance(*_sums(values))


def low_density(values: Array) -> Array:
    """Density (k,) of `values` (n, k), per sample, below twenty periods of the record."""
    level, _, _ = _level(*_sums(values))
    return level * len(values)


def jitter_of(values: Array) -> Array:
    """Variance (k,) of that sum by what is no white noise of the `values`, in samples squared."""
    n = len(values)
    sums, edges = _sums(values)
    level, _, _ = _level(sums, edges)
    return np.asarray(np.maximum(_integral_variance(sums, edges) - n**2 * level / 15, 0.0))


def drift_of(values: Array) -> Array:
    """How far a triad's `values` (n, 3) drift steadily from end to end (3,); 0 where none may.

    Notes
    -----
    A ramp has sines that fall as 1/order and no cosines. The three count where the mean of their
    ratios F, of the fit to orders 1 to 8 and of what that leaves, is above 15: in white noise one
    of ten thousand records. Axes count together, since what warms or settles does so in all three.
    """
    if len(values) <= BLOCKS:
        return np.zeros(values.shape[1])
    cosines, sines = _waves(*_sums(values), _DRIFT_ORDERS)
    return _drift(cosines, sines, len(values))


def _sums(values: Array) -> tuple[Array, np.ndarray]:
    """Sums (m, k) of values less their mean over blocks between edges (m + 1,) [samples]."""
    n, m = len(values), min(len(values), _FINE)
    edges = np.arange(m + 1) * n // m
    total = sums_between(values, edges)
    lengths = np.diff(edges)[:, None]
    return total - lengths * (total.sum(axis=0) / n), edges


def _waves(sums: Array, edges: np.ndarray, orders: int) -> tuple[Array, Array]:
    """Cosines and sines (orders, k) of whole periods over the record; sines vanish at its ends."""
    cosines, sines = _basis(int(edges[-1]), len(sums), orders)
    return cosines @ sums, sines @ sums


@lru_cache(maxsize=16)  # of the rests of a run, which the next run has again: 1.3 MB each at most
def _basis(n: int, blocks: int, orders: int) -> tuple[Array, Array]:
    edges = np.arange(blocks + 1) * n // blocks
    angle = 2 * np.pi * np.outer(np.arange(1, orders + 1), (edges[1:] + edges[:-1]) / (2 * n))
    return np.cos(angle), np.sin(angle)


def _level(sums: Array, edges: np.ndarray) -> tuple[Array, Array, Array]:
    """Variance (k,) of the mean by the density at low frequency; cosines and sines.

    By all orders, or by the lower half of them where that is far less than the whole.
    """
    n = int(edges[-1])
    cosines, sines = _waves(sums, edges, min(_ORDERS, (n - 1) // 2))
    half = len(sines) // 2
    whole, lower = _power(cosines, sines), _power(cosines[:half], sines[:half])
    power = np.where(lower < _FAR_LESS * whole, lower, whole)
    return 2 * power / n**2, cosines, sines


def _power(cosines: Array, sines: Array) -> Array:
    """Mean square (k,) of sines and of pairs of cosines."""
    pairs = _pairs(cosines)
    total = np.sum(sines**2, axis=0) + np.sum(pairs**2, axis=0)
    return np.asarray(total / (len(sines) + len(pairs)))


def _pairs(cosines: Array) -> Array:
    """Differences of each two successive cosines, which vanish at the ends of the record."""
    even = len(cosines) // 2 * 2
    return np.asarray((cosines[0:even:2] - cosines[1:even:2]) / np.sqrt(2))


def _integral_variance(sums: Array, edges: np.ndarray) -> Array:
    integral = np.zeros((sums.shape[1], len(sums) + 1))  # by columns: sums go along memory
    np.cumsum(sums.T, axis=1, out=integral[:, 1:])
    integral -= integral.mean(axis=1, keepdims=True)
    line = edges - edges.mean()
    integral -= np.outer(integral @ line / (line @ line), line)
    return np.asarray(np.mean(integral**2, axis=1))


def _drift(cosines: Array, sines: Array, n: int) -> Array:
    drift, ratio = _ramp(cosines[:_DRIFT_ORDERS], sines[:_DRIFT_ORDERS], n)
    return drift if ratio > _DRIFTS else np.zeros_like(drift)


def _faint(cosines: Array, sines: Array, n: int) -> Array:
    drift, ratio = _ramp(cosines, sines, n)
    return drift if ratio > _FAINT and len(sines) == _ORDERS else np.zeros_like(drift)


def _ramp(cosines: Array, sines: Array, n: int) -> tuple[Array, float]:
    """The ramp from end to end (k,) that these orders hold, and the mean over columns of its square
    over the variance that what it leaves of them makes of it."""
    pairs = _pairs(cosines[2:])
    ramp = 1 / np.arange(1, len(sines) + 1)
    fit = ramp @ sines / (ramp @ ramp)
    left = np.sum((sines - np.outer(ramp, fit)) ** 2, axis=0) + np.sum(pairs**2, axis=0)
    left /= len(sines) - 1 + len(pairs)
    there = np.any(sines, axis=0)
    ratios = np.divide(fit**2 * (ramp @ ramp), left, out=np.zeros_like(left), where=there)
    return np.asarray(2 * np.pi / n * np.abs(fit)), float(ratios.mean())


def rest_doubt(readings: ImuReadings) -> tuple[str, ...]:
    """Flags where readings at rest drift, as `drift_of` has it, or a part of them lies apart."""
    _, _, drifts, one, _ = _means_and_shown(readings)
    return drift_doubt(drifts[:3], drifts[3:]) + apart_doubt(one)


def faint_doubt(readings: ImuReadings, priors: Priors) -> tuple[str, ...]:
    """A flag where readings at rest may drift: as much shows in one record of noise in a hundred.

    Of sensors whose drifts no data sheet tells.

    Notes
    -----
    Noise that makes a mean good to s makes ramps of ``sqrt(12) s`` from end to end, and a ramp D
    takes the mean D/2 away from what either end has. `drift_of` is certain of three ramps from 4 of
    their sigmas, of one axis alone from 8: what it leaves out may be six sigmas of the mean. Of
    ramps that this leaves unsaid one in ten is above 3 and 5.
    """
    means, _, _, _, faint = _means_and_shown(readings)
    if np.linalg.norm(means[:3]) > REST_RATE:  # a steady turn, of which the Earth's rate is a wave
        return ()
    gyro, accel = (
        own * (sensor in priors.noise_only)
        for sensor, own in zip(SENSORS, (faint[:3], faint[3:]), strict=True)
    )
    told = drift_words(gyro, accel)
    return (f"may drift from end to end, {told}: too faint to count in sigma",) if told else ()


@once
def gap_doubt(readings: ImuReadings) -> tuple[str, ...]:
    """A flag where a step between stamps is above ten times the usual one."""
    t, gap, before, shortest = readings.t, 0.0, 0.0, np.inf
    for rows in parts(len(t)):
        steps = np.diff(t[rows.start : rows.stop + 1])
        longest = int(np.argmax(steps)) if len(steps) else -1
        if longest >= 0 and steps[longest] > gap:
            gap, before = float(steps[longest]), float(t[rows.start + longest])
        shortest = min(shortest, float(steps.min(initial=np.inf)))
        release(t)
    if gap <= GAP * shortest:  # and so of the median, which takes its time
        return ()
    some = np.concatenate([np.diff(excerpt) for excerpt in excerpts(t)])
    if gap <= GAP * np.median(some, overwrite_input=True):  # an hour's steps need no copy
        return ()
    return (f"gap of {gap:.3g} s after {before:.3f} s",)


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
    moved = _motion(readings)
    if moved:
        raise NotAtRest(f"{label}: {moved}")


def is_at_rest(readings: ImuReadings) -> bool:
    """Whether `check_rest` lets readings pass."""
    return not _motion(readings)


@once
def _motion(readings: ImuReadings) -> str:
    """Why readings are not at rest, in words; '' where they are."""
    blocks = rest_blocks(readings)
    f, w = block_means(readings.f_b, blocks), block_means(readings.w_ib_b, blocks)
    mean_f = f.mean(axis=0)
    size = float(np.linalg.norm(mean_f))
    if not size or not np.linalg.norm(f, axis=1).all():
        return "specific force is zero: falling, or no accelerometers"
    tilts = np.arctan2(np.linalg.norm(np.cross(f, mean_f), axis=1), f @ mean_f)
    rates = np.linalg.norm(w - w.mean(axis=0), axis=1)
    if tilts.max() <= REST_TILT and rates.max() <= REST_RATE:  # whatever the noise would excuse
        return ""
    tilt = max(REST_TILT, _excused(readings.f_b, f) / size)
    rate = max(REST_RATE, _excused(readings.w_ib_b, w))
    span = readings.interval * len(readings) / blocks
    if tilts.max() <= tilt and _is_drift(w, mean_f / size, rate, span):
        rates = np.zeros(blocks)
    worst = int(np.argmax(np.maximum(tilts / tilt, rates / rate)))
    if not (tilts[worst] > tilt or rates[worst] > rate):
        return ""
    at = float(readings.t[worst * len(readings) // blocks])
    return (
        f"not at rest near {at:.1f} s: tilt {np.degrees(tilts[worst]):.2f} deg, "
        f"rate {np.degrees(rates[worst]):.3f} deg/s off their means "
        f"(allowed {np.degrees(tilt):.2g} deg, {np.degrees(rate):.2g} deg/s)"
    )


def longest_rest(readings: ImuReadings, shortest: float = 10.0) -> tuple[float, float] | None:
    """The longest part [s] between jumps of 1 s means that is at rest, None below `shortest`."""
    blocks = rest_blocks(readings)
    f, w = block_means(readings.f_b, blocks), block_means(readings.w_ib_b, blocks)
    size = np.linalg.norm(f, axis=1)
    tilt = max(REST_TILT * size.mean(), noise_of_blocks(readings.f_b, f))
    rate = max(REST_RATE, noise_of_blocks(readings.w_ib_b, w))
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


def rest_blocks(readings: ImuReadings) -> int:
    """How many 1 s means a stretch has: two at least, a sample each at most."""
    span = readings.interval * len(readings)
    return max(2, min(round(span / REST_BLOCK), len(readings)))


def noise_of_blocks(values: Array, means: Array) -> float:
    """How far noise and rounding may move the block means (b, 3) of values (n, 3).

    Of two values nothing: there is no second difference, and their step may be motion.
    """
    if len(values) < 3:
        return 0.0
    per_block = len(values) / len(means)
    second = np.concatenate([np.diff(some, 2, axis=0) for some in excerpts(values)])
    np.abs(second, out=second)
    sigma = 1.4826 / np.sqrt(6 * per_block) * np.median(second, axis=0, overwrite_input=True)
    if len(means) >= FEWEST_BLOCKS:
        jumps = np.abs(np.diff(means, axis=0))
        sigma = np.minimum(sigma, 1.4826 / np.sqrt(2) * np.median(jumps, axis=0))
        sigma = np.minimum(sigma, _beside_lines(values, len(means)))
    return max(REST_SIGMAS * float(sigma.max()), _by_steps(values))


def _by_steps(values: Array) -> float:
    """How far rounding alone may move means of values (n, k)."""
    return STEPS * max(step_of(values[:, k]) for k in range(values.shape[1]))


def _excused(values: Array, means: Array) -> float:
    """How far noise and rounding may move means of what rests.

    Of a few values rounding alone: noise looks like a motion of a period or two.
    """
    return _by_steps(values) if len(values) < _FEW_VALUES else noise_of_blocks(values, means)


def _beside_lines(values: Array, blocks: int) -> Array:
    """Sigma (k,) of 1 s means by the median density of `values` (n, k), to 2 Hz where they reach.

    A motion of some period is a few lines of it, however few samples it has a period; of those that
    look like noise from sample to sample this alone knows.
    """
    parts = min(len(values), 4 * blocks)
    means = block_means(values, parts)
    window = np.hanning(parts + 1)[:-1, None]
    lines = np.abs(np.fft.rfft(window * (means - means.mean(axis=0)), axis=0)[1:]) ** 2
    variance = np.median(lines, axis=0) / np.log(2) / np.sum(window**2)
    return np.asarray(np.sqrt(variance * blocks / parts))


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
