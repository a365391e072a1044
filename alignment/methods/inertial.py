"""Alignment in inertial frames: gravity's turn with the Earth against the carried specific force.

The gyros carry attitude in the frame i that b had at the start; there specific force integrates
to a curve of velocity, whatever the rocking. Gravity's reaction, turned by the Earth's known
rotation, gives the same curve in n as it stood at the end. Both curves less their means, matched
by Wahba's problem, are the attitude: the means hold the unknown velocity at the start, and
rocking with a lever arm averages out. Source: methods.md section 3, robust answer; F. L. Markley
and J. L. Crassidis, Fundamentals of Spacecraft Attitude Determination and Control (2014), 5.3.
"""

from collections.abc import Sequence as Ordered
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.polynomial.legendre import legvander
from scipy.spatial.transform import Rotation
from scipy.special import chdtri

from alignment.apart import Apart
from alignment.around import by_direction, less_turned, whole_circle, with_level_rate
from alignment.arrays import Array
from alignment.constant_errors import constant_columns, constant_form
from alignment.cross import cross_matrix
from alignment.doubts import ALIKE_DOUBT, apart_doubt, drift_doubt, heading_doubt
from alignment.earth import EARTH_RATE, Site
from alignment.errors import AlignmentError, NotAtRest, TooShort
from alignment.estimate import AttitudeEstimate, AttitudeTrack
from alignment.gains import by_increments
from alignment.information.drift import flicker, sum_covariance, turn_on
from alignment.noise import (
    apart_around,
    apart_of,
    around_doubt,
    check_rest,
    drift_around,
    drift_of,
    faint_doubt,
    gap_doubt,
    is_at_rest,
    jitter_of,
)
from alignment.options import SENSORS, Options, Priors
from alignment.readings import Dwell, ImuReadings
from alignment.rounding import end_variance, with_rounding
from alignment.saturation import saturation_doubt
from alignment.strapdown import Carried, carry, changes_in_b, matrices, rates_at_edges

METHOD = "inertial"
_ROCKED = 0.01  # rad: what turns by less neither rocks nor turns
FOLLOWED = 1 / 49.5  # s: samples that follow any motion of a table
EVERY = slice(None)
BLOCK = 0.5  # s: the sums of the match run over blocks, the integration over samples
_LEAST_BLOCKS = 16
LEAST_SAMPLES = 2 * _LEAST_BLOCKS
_WELL_RESOLVED, _RESOLVED = 64, 4096  # blocks into which a short, a long record is cut
LEAST_SPECTRUM, _MOST_SPECTRUM = 64, 2**17  # samples from which noise is told
_GRAVITY_DOUBT = 0.01  # part of gravity by which the mean specific force may differ unremarked
_WANDER_ORDERS = slice(3, 6)  # Legendre orders of velocity that neither the fit nor a bias makes
_SMOOTH_ORDER = 8  # velocity beyond it is sway, not drift
_TOLD_ORDERS = slice(3, 9)  # by which noise is told where the spectrum of the readings is motion's
_PARTS = np.geomspace(1e-6, 1.0, 13)  # of a variance
_MORE = np.append(0.0, np.geomspace(1.0, 1e6, 13))  # parts of a variance that are added to it
_NONE = 10.0, 1.0  # times as likely as all plateaus together is none, of gyros, accelerometers
_MORE_FLICKER = np.append(0.0, np.geomspace(1e-2, 1e3, 11))  # of the variance by white noise
_SELDOM = 0.01
_JITTERS = np.geomspace(1e-3, 1.0, 7)  # of the mean square of the velocities that tell
_CERTAIN = 3.0  # of log likelihood: chi-square of two degrees of freedom at one in twenty
_BEYOND = 3.0  # sigmas from which a slow force is no noise
_BENT = 0.5  # of a drift's straight part, the bend of one that settles
_SEEN = 0.01  # of the Earth's level rate: a bias along north that is remarked
_TURNED = 0.5  # of what bends there: the sensors' own part below which the base does
_UNSWUNG = 1e-11  # of the greatest variance of a swing: below, it is rounding
_ARM_ORDERS = 4  # Legendre orders of velocity that attitude errors and biases make
_FASTER = 10 * EARTH_RATE  # rad/s: a table's turn, not the Earth's
_FINEST = 1e-6  # m: displacement that perfect sensors still cannot tell from none
_WANDER_DOUBT = 5.0  # sigmas (root of the mean square of nine) that are remarked
_WANDER_LIMIT = 10.0  # sigmas that are refused, where the instrument also moves by this:
_WANDER_SPEED = 0.1  # m/s
_CHUNK = 8192  # blocks at once
_ALONG = np.array(
    [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]]
)  # (N, E, D) @ it: (E, -N, 0)
_WITH_ALONG = [0, 1, 2, 12]  # of what `covariances` finds: attitude, and the level rate's size
_SIZES, _STEP = 3, 1e-3  # passes that find the level rate's size, and its step of differences
_TRACK_POINTS = 200  # of a track: each is a match of the record so far


@dataclass(frozen=True, slots=True, eq=False)
class Noise:
    """White noise of each axis, (3,): `gyro` [rad/sqrt(s)] and `accel` [m/s/sqrt(s)]; `jitter`:
    of velocity itself [m/sqrt(s)], as a dither or vibration makes it. `ends` (6,): variances of
    angle and velocity at any time [rad^2], [m^2/s^2], as rounded increments leave them. `plateaus`
    (2,): of the Allan deviations of gyros [rad/s] and accelerometers [m/s^2], where no sheet has
    them and the record shows them.
    """

    gyro: Array
    accel: Array
    jitter: float = 0.0
    ends: Array = field(default_factory=lambda: np.zeros(6))
    plateaus: Array = field(default_factory=lambda: np.zeros(2))


class Own(NamedTuple):
    """Parts of what drifts at rest that are the sensors' own: of `gyro`, of `accel`, whatever its
    shape, and of accelerometers as far as they `bent` from a straight line."""

    gyro: float
    accel: float
    bent: float


_ALL = Own(1.0, 1.0, 1.0)


@dataclass(frozen=True, slots=True, eq=False)
class Rest:
    """What a record at rest shows beside white noise, of each axis (3,); zeros where it moves.

    `jitter`: variance of the angle about what noise makes of it [rad^2], which the last sample
    has. `gyro_drift`, `accel_drift`: steady drifts from end to end [rad/s], [m/s^2];
    `drift_around` (6,) [rad/s], [m/s^2]: of the record that this one is `part` of; `straight`:
    whether accelerometers do so there, which turns heading alike in all parts of it. `apart`: what
    lies apart from the rest of this one and of that. `faint`: a drift too faint to count, `biased`:
    what an unstated bias shows of itself, in words.
    """

    jitter: Array
    gyro_drift: Array
    accel_drift: Array
    drift_around: Array
    part: float
    apart: tuple[Apart, ...] = ()
    straight: bool = False
    faint: tuple[str, ...] = ()
    biased: tuple[str, ...] = ()

    def doubts(self, dwell: Dwell) -> tuple[str, ...]:
        """What is counted of drifts and of what lies apart, in words."""
        flags = drift_doubt(self.gyro_drift, self.accel_drift)
        flags += tuple(flag for one in self.apart[:1] for flag in apart_doubt(one))
        around = any(one.off.any() for one in self.apart[1:]) or self.drift_around.any()
        flags += around_doubt(dwell) if around else ()
        return flags + (ALIKE_DOUBT,) * self.straight + self.faint + self.biased


@dataclass(frozen=True, slots=True, eq=False)
class Match:
    """Two curves of velocity laid on each other.

    Attributes
    ----------
    C_ni : Rotation
        From i (b at the start) to n at the end of the record.
    reference : (m, 3) m/s
        What gravity's reaction alone gives, mean over each block, in n at the end, centred.
    residual : (m, 3) m/s
        Mean velocity over each block beyond that, centred: sway and what noise made.
    larger : (m, 3) m/s or None
        What a level rate twice the Earth's would add, where its size is free; `size`: how many
        times that was found, which is not in the residual.
    """

    C_ni: Rotation
    reference: Array
    residual: Array
    larger: Array | None = None
    size: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Arm:
    """The instrument's place from the point that stays, as the velocity curve shows it.

    Attributes
    ----------
    place : (3,) m
        In b; nothing where no prior says that there is an arm.
    swings : (m, 3, 3) m/s per m
        Block means of velocity in n that it makes.
    weights : (m, 3, 3)
        How it follows the block means of velocity error, in n [m per m/s].
    left : (3, 3) m
        Part of each unit cause of the prior that the curve does not show.
    """

    place: Array
    swings: Array
    weights: Array
    left: Array


def white_levels(values: Array, interval: float) -> Array:
    """White noise level (k,) of `values` (n, k), per root hertz, under smooth motion.

    Notes
    -----
    Two-sided periodogram (so that the level of rates is the angle random walk) with a ``sin^4``
    window, averaged over octaves from a quarter of the sampling rate down to eight cycles per
    record. The highest octave counts, unless a lower one is less by three standard errors: so
    neither sway (a band of its own) nor dither (near the sampling rate) is taken for noise. It
    reads low where a filter of the unit cuts below an eighth of the rate, high where motion
    fills all octaves. Of long records the middle 2^17 samples serve.
    """
    if len(values) < LEAST_SPECTRUM:
        raise TooShort(f"{len(values)} samples: noise needs {LEAST_SPECTRUM}, or give its prior")
    middle = max(0, len(values) - _MOST_SPECTRUM) // 2
    values = values[middle : middle + _MOST_SPECTRUM]
    n = len(values)
    window = np.sin(np.pi * (np.arange(n) + 0.5) / n) ** 4
    size = 1 << (n - 1).bit_length()  # transforms of a large prime length are slow
    power = np.empty((size // 2 + 1, values.shape[1]))
    for k, column in enumerate(values.T):
        power[:, k] = np.abs(np.fft.rfft((column - column.mean()) * window, size)) ** 2
    power *= interval / np.sum(window**2)
    independent = n / size * np.sum(window**2) ** 2 / (n * np.sum(window**4))
    top = size // 4
    level = power[top // 2 : top].mean(axis=0)
    while top > 16:
        top //= 2
        lower = power[top // 2 : top].mean(axis=0)
        error = 1 / np.sqrt(independent * (top - top // 2))
        level = np.where(lower < level * (1 - 3 * error), lower, level)
    return np.sqrt(level)


def noise_of(readings: ImuReadings, priors: Priors) -> Noise:
    """White noise by the priors, or from the readings where those are silent."""
    gyro, accel = (
        np.full(3, prior) if prior > 0 else white_levels(values, readings.interval)
        for prior, values in (
            (priors.gyro_walk, readings.w_ib_b),
            (priors.accel_walk, readings.f_b),
        )
    )
    return Noise(gyro, accel, ends=end_variance(readings))


def rest_of(
    dwell: Dwell,
    readings: ImuReadings,
    priors: Priors,
    seen: tuple[Carried, Match, Noise],
    site: Site,
) -> Rest:
    """What the readings show beside white noise, where they are at rest and no sheet tells it of
    their sensors.

    Drifts are those that are the sensors' own, by what is `seen` of the base in these readings and
    in the record around them: see `own_parts`. That tells of how the windows' drifts differ whether
    the base turned; of what is straight from end to end of it, it does not.
    """
    nothing = Rest(*np.zeros((3, 3)), drift_around=np.zeros(6), part=1.0)
    unknown = np.array([sensor in priors.noise_only for sensor in SENSORS], float)
    if not unknown.any() or len(readings) < LEAST_SPECTRUM or not is_at_rest(readings):
        return nothing
    w = readings.w_ib_b
    jitter = unknown[0] * jitter_of(w) * readings.interval**2
    steady = np.concatenate([drift_of(w), drift_of(readings.f_b)])
    own = np.maximum(steady, np.concatenate([np.zeros(3), _slow_force(*seen)]))
    own = own * np.repeat(unknown, 3)
    wide, part = drift_around(dwell)
    wide = wide * np.repeat(unknown, 3)
    one, other = apart_of(readings).of(*unknown), apart_around(dwell).of(*unknown)
    straight = np.zeros(3)
    if own.any() or wide.any() or one.off.any() or other.off.any():
        parts = own_parts(*seen, own[:3])
        around = own_parts_around(dwell, site)
        straight = np.minimum(own[3:], part * wide[3:])
        bent = around.bent * (own[3:] - straight)
        straight = around.accel * straight
        own = own * np.repeat([min(parts.gyro, around.gyro), parts.accel], 3)
        own[3:] = np.minimum(own[3:], np.hypot(straight, bent))
        one = one.of(parts.gyro, min(parts.accel, around.accel))
        wide = wide * np.repeat([around.gyro, around.accel], 3)
        other = other.of(around.gyro, around.accel)
    return Rest(
        jitter=jitter,
        gyro_drift=own[:3],
        accel_drift=own[3:],
        drift_around=wide,
        part=part,
        apart=(one, other),
        straight=bool(straight.any()),
        faint=faint_doubt(readings, priors),
        biased=_bias_doubt(*seen, priors),
    )


def _bias_doubt(carried: Carried, matched: Match, noise: Noise, priors: Priors) -> tuple[str, ...]:
    """A flag where the Earth's level rate seems of another size, by more than noise and 1 %.

    That is a bias along north; one along east, of which nothing shows, passes for heading.
    """
    left, C_ni = left_of_the_turn(carried, matched, priors), matched.C_ni.as_matrix()
    weights = along(attitude_weights(carried, matched)[:, 2:])
    felt = sensitivity(weights, C_ni, carried)
    variance = float(functional_covariance(*felt, C_ni, carried, noise, priors)[0, 0])
    variance += noise.jitter**2 * float(np.sum(weights**2 / carried.spans[:, None, None]))
    if abs(left - 1) <= max(_BEYOND * np.sqrt(variance), _SEEN):
        return ()
    return (
        f"the Earth's level rate seems {left:.2f} of what it is: a gyro bias along north; as much "
        f"along east, which nothing shows, turns heading by {np.degrees(abs(left - 1)):.2g} deg",
    )


def own_parts(carried: Carried, matched: Match, noise: Noise, gyro_drift: Array) -> Own:
    """Which part of the drifts that gyros and accelerometers show at rest is their own.

    Notes
    -----
    A base that turns shows in both, and their sum, the velocity curve r in inertial space, knows
    nothing of it. With x what the accelerometers alone would make of that curve, had the base
    stood, and ``y = r - x`` what the gyros alone would: least squares of r by x and by y, weighed
    by the noise of r, in the horizontal, in orders 3 to 8; a part s of variance v counts as
    ``sqrt(s^2 + v)``, at most all. So what r is too noisy to tell stays the sensors'. Order 2
    of x, a straight drift of accelerometers, heading takes up and r never shows: it is judged by
    the bend of x as far as there is one, all of it where the bend is half of it, as of what
    settles; what is straight is the sensors'. A drift of gyros (3,) [rad/s] hides in nothing: no
    more of it is theirs than r has of order 3.
    """
    # of axes alike: none counts for more by what it did not do
    values, by_gyro, by_accel = _told_of_the_base(_alike(noise), carried, matched)
    straight, alone = _made_by_force(carried, matched)
    inverse = np.linalg.inv(by_gyro + by_accel + noise.jitter**2 * np.eye(len(values)))
    parts = []
    for x in (values - alone, alone):
        told = float(x @ inverse @ x)
        part = float(x @ inverse @ values) / told if told > 0 else 1.0
        parts.append(min(1.0, float(np.sqrt(part**2 + 1 / told))) if told > 0 else 1.0)
    bent = min(1.0, float(alone @ alone / (_BENT**2 * straight @ straight)))
    of_gyro = min(parts[0], _seen_of(gyro_drift, values[:2], carried, matched))
    return Own(of_gyro, float(np.sqrt(1 - bent * (1 - parts[1] ** 2))), parts[1])


def _seen_of(drift: Array, values: Array, carried: Carried, matched: Match) -> float:
    """Part of a gyro drift (3,) that velocities (2,) of order 3 in N and E have room for."""
    basis = _smooth(carried)[:, _TOLD_ORDERS.start] * np.sqrt(carried.spans)
    C_ni = matched.C_ni.as_matrix()
    gyro, _ = sensitivity(basis[:, None, None] * np.eye(3)[:2], C_ni, carried)
    made = (_line(carried) * (gyro @ drive(carried, C_ni))).sum(axis=0) * drift
    expected, seen = np.linalg.norm(made), np.linalg.norm(values)
    return float(seen / expected) if expected > seen else 1.0


def _slow_force(carried: Carried, matched: Match, noise: Noise) -> Array:
    """Drift (3,) [m/s^2] from end to end of level accelerometers, of whatever shape.

    That of a ramp whose velocity has as much of order 2, which is what heading takes up; 0 within
    three sigmas of white noise. What settles early is no ramp (`drift_of`), and feigns as much.
    """
    straight, _ = _made_by_force(carried, matched)
    root, line = np.sqrt(carried.spans), _line(carried)[:, 0, 0]
    basis = _smooth(carried)[:, 2] * root
    ramp = basis @ (np.cumsum(line * carried.spans) - line * carried.spans / 2)
    white = float(np.sum(_after(basis) ** 2 * carried.spans) * np.mean(noise.accel**2))
    if straight @ straight < 2 * _BEYOND**2 * white:
        return np.zeros(3)
    C_nb = matched.C_ni.as_matrix() @ matrices(carried.q[-1:])[0]
    return np.asarray(np.abs(straight / ramp @ C_nb[:2]))


def own_parts_around(dwell: Dwell, site: Site) -> Own:
    """As `own_parts`, of the whole record that a dwell is cut from; all is the sensors' where that
    is the dwell, moves or lost readings."""
    whole = len(dwell.window()) == len(dwell.readings)
    return _ALL if whole else _own_parts_at_rest(dwell.readings, site)


@lru_cache(maxsize=1)  # the windows of one record ask one after the other
def _own_parts_at_rest(readings: ImuReadings, site: Site) -> Own:
    if gap_doubt(readings):
        return _ALL
    try:
        check_rest(readings, "")
        carried = carry(readings, block_of(readings))
        matched, noise, _ = laid(readings, carried, site, Priors())
    except AlignmentError:  # it moves, or is too short to tell
        return _ALL
    return own_parts(carried, matched, noise, drift_of(readings.w_ib_b))


def base_turns(dwell: Dwell, site: Site) -> bool:
    """Whether gyros see the base turn by what accelerometers see it tilt in a record at rest."""
    return _own_parts_at_rest(dwell.readings, site).bent < _TURNED


def _told_of_the_base(noise: Noise, carried: Carried, matched: Match) -> tuple[Array, Array, Array]:
    """As `_told_by_the_curve`, of N and E alone: (12,) and (12, 12)."""
    values, by_gyro, by_accel = _told_by_the_curve(noise, carried, matched)
    level = _level_ones(len(values))
    return values[level], by_gyro[np.ix_(level, level)], by_accel[np.ix_(level, level)]


def _level_ones(count: int) -> np.ndarray:
    """Which of so many in N, E, D by turns are level: a gyro bias bends D to second order."""
    return np.arange(count) % 3 < 2


def _made_by_force(carried: Carried, matched: Match) -> tuple[Array, Array]:
    """What the accelerometers alone make of the velocity curve in N and E had the base stood: its
    order 2, (2,), and those of `_told_of_the_base` (12,)."""
    C_nb = matched.C_ni.as_matrix() @ matrices(carried.q[-1:])[0]
    moved = (np.cumsum(carried.dv, axis=0) - carried.dv / 2) @ C_nb[:2].T
    orders = _smooth(carried).T @ (moved * np.sqrt(carried.spans)[:, None])
    return orders[2], orders[_TOLD_ORDERS].ravel()


def _smooth(carried: Carried) -> Array:
    """Orders 0 to 8 (m, 9), orthonormal over blocks that count by the root of their spans."""
    basis, _ = np.linalg.qr(_legendre(carried) * np.sqrt(carried.spans)[:, None])
    return np.asarray(basis)


def quieter(noise: Noise, carried: Carried, matched: Match) -> Noise:
    """The noise as the velocity curve shows it, where that is far less than the spectrum's.

    Notes
    -----
    Of a base that moves, or of gyros that jitter, the spectrum of the readings is all motion's. In
    inertial space rotation drops out, and of sway little is left at a few periods per record:
    there the noise that matters shows, in the 18 velocities of orders 3 to 8 (of polynomials)
    that neither the fit nor a bias makes. Their likelihood by parts a, b <= 1 of the variances of
    gyros and accelerometers and by a jitter of velocity up to all of them, which is alike in all
    orders: over parts that are equally likely by their logarithm the mean parts count. Only where
    without jitter the best is beyond the whole by what one record of twenty has: a sway that fills
    those orders would pass for jitter, and hides the noise, which stays too large. Nor is it the
    noise by which a motion's spectrum differs from axis to axis: where it is not, all axes of a
    triad are alike. Else a level gyro's bias, which is no noise of any axis, turns heading.
    """
    alike = _alike(noise)
    values, by_gyro, by_accel = _told_by_the_curve(alike, carried, matched)
    white, V = np.linalg.eigh(
        _PARTS[:, None, None, None] * by_gyro + _PARTS[:, None, None] * by_accel
    )
    jitters = np.append(0.0, _JITTERS) * np.mean(values**2)
    variances = white + jitters[:, None, None, None]
    squares = np.einsum("abij,i->abj", V, values) ** 2
    likelihood = -0.5 * np.sum(np.log(variances) + squares / variances, axis=-1)
    if likelihood[0].max() - likelihood[0, -1, -1] < _CERTAIN:
        return noise
    weight = np.exp(likelihood - likelihood.max())
    weight /= weight.sum()
    a, b = weight.sum(axis=(0, 2)) @ _PARTS, weight.sum(axis=(0, 1)) @ _PARTS
    c = weight.sum(axis=(1, 2)) @ jitters
    return Noise(alike.gyro * np.sqrt(a), alike.accel * np.sqrt(b), float(np.sqrt(c)))


def louder(
    noise: Noise, readings: ImuReadings, carried: Carried, matched: Match, site: Site
) -> Noise:
    """The noise as the velocity curve of a record at rest shows it, where that is more.

    Notes
    -----
    A filter, or a sample that is held for several, leaves less in the spectrum's fast octaves than
    noise has below them; steps and flicker have more below. Where the velocities of `quieter` are
    beyond the noise, and what is counted of drifts and of what lies apart, by what one record of a
    hundred has, the variances of gyros and accelerometers grow by parts that are equally likely by
    their logarithm, each by the mean of what fits. What an instrument beside a turn's axis swings
    is none of it.
    """
    values, by_gyro, by_accel = _told_of_the_base(noise, carried, matched)
    whole = by_gyro + by_accel + noise.jitter**2 * np.eye(len(values))
    whole += _by_any_arm(carried, matched, site)
    if _within(values, whole):
        return noise
    weights = _weights_of_orders(carried)[:, _level_ones(3 * len(values) // 2)]
    drifts = np.concatenate([drift_of(readings.w_ib_b), drift_of(readings.f_b)])
    slow = Rest(np.zeros(3), drifts[:3], drifts[3:], np.zeros(6), 1.0, (apart_of(readings),))
    whole += _slow_covariance(weights, np.zeros((len(values), 3)), carried, matched, slow)
    if _within(values, whole):
        return noise
    white, V = np.linalg.eigh(
        whole + _MORE[:, None, None, None] * by_gyro + _MORE[:, None, None] * by_accel
    )
    squares = np.einsum("abij,i->abj", V, values) ** 2
    likelihood = -0.5 * np.sum(np.log(white) + squares / white, axis=-1)
    weight = np.exp(likelihood - likelihood.max())
    weight /= weight.sum()
    a, b = 1 + weight.sum(axis=1) @ _MORE, 1 + weight.sum(axis=0) @ _MORE
    return replace(noise, gyro=noise.gyro * np.sqrt(a), accel=noise.accel * np.sqrt(b))


def plateaus_of(noise: Noise, carried: Carried, matched: Match, site: Site) -> Array:
    """Plateaus (2,) of the Allan deviations of gyros and accelerometers, as the velocity curve of a
    record shows them beside white noise.

    Notes
    -----
    Flicker is more the slower it is: what the fit takes up, and what differs from record to record,
    has more of it than velocities of order 3 to 8 show. So their likelihood is by plateaus of both,
    and by a jitter of velocity, as a sway makes it, that are equally likely by their logarithm, or
    none: as likely as all of them, of gyros, whose heading is the costlier, ten times so. The mean
    squares count. What both may have made counts for both: that of accelerometers is as if gyros
    had none.
    """
    alike = _alike(noise)
    values, by_gyro, by_accel = _told_of_the_base(alike, carried, matched)
    white = by_gyro + by_accel + noise.jitter**2 * np.eye(len(values))
    arm = _by_any_arm(carried, matched, site)
    C_ni, level = matched.C_ni.as_matrix(), _level_ones(3 * len(values) // 2)
    felt = sensitivity(_weights_of_orders(carried)[:, level], C_ni, carried)
    units = [
        functional_covariance(
            *felt, C_ni, carried, Noise(np.zeros(3), np.zeros(3), plateaus=unit), Priors()
        )
        for unit in np.eye(2)
    ]
    squares = [_MORE_FLICKER * np.trace(white) / np.trace(unit) for unit in units]
    jitters = np.append(0.0, _JITTERS) * np.mean(values**2)
    P = (
        white
        + arm
        + squares[0][:, None, None, None, None] * units[0]
        + squares[1][:, None, None, None] * units[1]
        + jitters[:, None, None] * np.eye(len(values))
    )
    misfit = np.sum(values * np.linalg.solve(P, values[:, None])[..., 0], axis=-1)
    likelihood = -0.5 * (np.linalg.slogdet(P)[1] + misfit)
    some = len(_MORE_FLICKER) - 1
    gyro, accel = (np.where(_MORE_FLICKER > 0, 1.0, some * odds) for odds in _NONE)
    weight = np.exp(likelihood - likelihood.max()) * gyro[:, None, None] * accel[:, None]
    weight /= weight.sum()
    by_accel = weight[0].sum(axis=1) / weight[0].sum()  # had the gyros none
    return np.sqrt([weight.sum(axis=(1, 2)) @ squares[0], by_accel @ squares[1]])


def _by_any_arm(carried: Carried, matched: Match, site: Site) -> Array:
    """Covariance (12, 12) of the velocities of `_told_of_the_base` by a lever arm that nobody
    states, a metre along each axis."""
    felt = swings(carried, matched.C_ni.as_matrix(), site)
    weights = _weights_of_orders(carried)
    N = np.tensordot(weights, felt, ([0, 2], [0, 1]))[_level_ones(weights.shape[1])]
    return np.asarray(N @ N.T)


def _within(values: Array, covariance: Array) -> bool:
    """Whether all but one record of a hundred has values (k,) as large."""
    return bool(values @ np.linalg.solve(covariance, values) < chdtri(len(values), _SELDOM))


def _alike(noise: Noise) -> Noise:
    """The same noise in the mean, of each triad's axes alike."""
    gyro, accel = (np.full(3, np.sqrt(np.mean(own**2))) for own in (noise.gyro, noise.accel))
    return replace(noise, gyro=gyro, accel=accel)


def _told_by_the_curve(
    noise: Noise, carried: Carried, matched: Match
) -> tuple[Array, Array, Array]:
    """Velocities (18,) [m/sqrt(s)] of orders 3 to 8 in N, E, D, and their covariances (18, 18) by
    gyros and by accelerometers; a jitter of velocity makes the unit matrix of them."""
    C_ni = matched.C_ni.as_matrix()
    weights = _weights_of_orders(carried)
    gyro, accel = sensitivity(weights, C_ni, carried)
    none = Noise(np.zeros(3), np.zeros(3))
    by_gyro, by_accel = (
        functional_covariance(gyro, accel, C_ni, carried, part, Priors())
        for part in (replace(none, gyro=noise.gyro), replace(none, accel=noise.accel))
    )
    values = np.tensordot(weights, matched.residual, ([0, 2], [0, 1]))
    return values, by_gyro, by_accel + _FINEST**2 * np.eye(len(by_accel))


def _weights_of_orders(carried: Carried) -> Array:
    """Functionals (m, 18, 3) of the velocity curve: its orders 3 to 8 in N, E, D."""
    basis = _smooth(carried)[:, _TOLD_ORDERS] * np.sqrt(carried.spans)[:, None]
    m, size = basis.shape  # a vertical bias is in the lower orders
    return np.einsum("mo,ij->moij", basis, np.eye(3)).reshape(m, 3 * size, 3)


def gravity_velocity(t: Array, site: Site, size: float = 1.0) -> tuple[Array, Array]:
    """Integral of gravity's reaction (k, 3) [m/s] from ``t[0]``, and the integral of that [m].

    In n as it stood at ``t[-1]``, held in inertial space; `t` (k,) [s]. The components along and
    across the Earth's axis are integrated in closed form. `size`: times as large a level rate.
    """
    w_n, f_n = site.w_ie_n * [size, size, 1.0], site.f_n
    rate = float(np.linalg.norm(w_n))
    axis = w_n / rate
    along, across = (f_n @ axis) * axis, np.cross(axis, f_n)
    level = f_n - along
    s = (t - t[0])[:, None]
    a = rate * s
    sin1, cos1 = np.sin(a), 2 * np.sin(a / 2) ** 2  # 1 - cos, without cancellation
    sin2 = np.where(a < 0.01, a**3 / 6 * (1 - a**2 / 20), a - sin1)  # a - sin a likewise
    v = along * s + (level * sin1 + across * cos1) / rate
    p = along * s**2 / 2 + (level * cos1 + across * sin2) / rate**2
    back = Rotation.from_rotvec(-(t[-1] - t[0]) * w_n)
    return back.apply(v), back.apply(p)


def match(carried: Carried, site: Site, place: Array | None = None, unbiased: bool = True) -> Match:
    """Wahba's problem for the centred velocity curves, by singular values.

    `place` (3,) [m]: the instrument's, from the point that stays; None where that is not known.
    `unbiased`: whether gyros show the Earth's level rate as large as it is, but for what is stated.
    """
    spans = carried.spans
    moved = carried.p
    if place is not None:
        moved = moved - np.diff(matrices(carried.q) @ place, axis=0)
    measured = _centred(moved / spans[:, None], spans)
    found = _laid_on(_reference(carried, site), measured, spans)
    return found if unbiased else _of_any_size(found, measured, carried, site)


def _reference(carried: Carried, site: Site, size: float = 0.0) -> Array:
    """What gravity's reaction gives (m, 3), centred; of a level rate larger by `size` of it."""
    _, p = gravity_velocity(carried.t, site, 1 + size)
    return _centred(np.diff(p, axis=0) / carried.spans[:, None], carried.spans)


def _laid_on(reference: Array, measured: Array, spans: Array) -> Match:
    U, _, Vt = np.linalg.svd((spans[:, None] * reference).T @ measured)
    proper = np.diag([1.0, 1.0, np.linalg.det(U) * np.linalg.det(Vt)])
    C = U @ proper @ Vt
    return Match(Rotation.from_matrix(C), reference, measured @ C.T - reference)


def _of_any_size(found: Match, measured: Array, carried: Carried, site: Site) -> Match:
    """The match with the size of the Earth's level rate free: a bias b along north adds to it, and
    would tilt the answer by ``b T/2``."""
    size, spans, earth = 0.0, carried.spans, found.reference
    larger = np.zeros_like(earth)
    for _ in range(_SIZES):
        larger = (_reference(carried, site, size + _STEP) - found.reference) / _STEP
        weights = _weights(spans, replace(found, larger=larger))[:, 3]
        size += float(np.tensordot(weights, found.residual, ([0, 1], [0, 1])))
        found = _laid_on(_reference(carried, site, size), measured, spans)
    return replace(found, reference=earth, larger=larger, size=size)


def sensitivity(weights: Array, C_ni: Array, carried: Carried) -> tuple[Array, Array]:
    """How linear functionals of the velocity curve feel the sensors: gyros, accelerometers.

    Parameters
    ----------
    weights : (m, k, 3)
        Functional ``sum_m weights_m dv_m`` of the block means of velocity error, in n.
    C_ni : (3, 3)
    carried : Carried

    Returns
    -------
    gyro, accel : (m, k, 3)
        Per rotation error [rad] and velocity error [m/s] that arise in the block, in n.

    Notes
    -----
    The adjoint of ``phi' = C w``, ``v' = phi x f + C f``, run backward: O(m). Errors that arise
    in a block count half there.
    """
    S = _after(weights)
    push = np.diff(carried.v, axis=0) @ C_ni.T
    return _after(-S @ cross_matrix(push)), S


def drive(carried: Carried, C_ni: Array, blocks: slice = EVERY) -> Array:
    """What unit biases of b do in n over some blocks (k, 3, 3): integrals, a column per axis."""
    return np.asarray(C_ni @ carried.turned[blocks])


def functional_covariance(
    gyro: Array, accel: Array, C_ni: Array, carried: Carried, noise: Noise, priors: Priors
) -> Array:
    """Covariance (k, k) of functionals with sensitivities (m, k, 3): noise and constants."""
    turned, root = drive(carried, C_ni), np.sqrt(carried.spans)[:, None, None]
    gains = gyro @ turned, accel @ turned  # per constant error of b in each block
    covariance = np.zeros((gyro.shape[1],) * 2)
    levels, both_ends = (noise.gyro, noise.accel), np.split(noise.ends, 2)
    told = zip(gains, levels, both_ends, noise.plateaus.tolist(), SENSORS, strict=True)
    for gain, level, ends, plateau, sensor in told:
        white = gain * (level / root)
        covariance += np.tensordot(white, white, ([0, 2], [0, 2]))
        if plateau:
            covariance += sum_covariance(gain, float(carried.spans[-1]), flicker(plateau))
        if ends.any():
            moved = carried.dtheta if sensor == "gyro" else carried.dv
            covariance += by_increments(gain, carried.spans, moved, ends)
        covariance += _by_biases(gain, carried, priors, sensor)
    J = _per_constant(*gains, carried, priors)
    if J.shape[-1]:
        covariance = covariance + J @ J.T
    J = by_clock(gains[0], carried, priors)
    return np.asarray(covariance + np.outer(J, J))


def by_clock(gain: Array, carried: Carried, priors: Priors) -> Array:
    """Functionals (k,) of gains (m, k, 3) to each block's mean rate, by the clock's one sigma.

    By stamps of a clock that runs fast all turns by that part faster than the gyros say: an error
    of scale that is one for all of them.
    """
    rates = carried.dtheta / carried.spans[:, None]
    return np.asarray(-priors.clock * np.tensordot(gain, rates, ([0, 2], [0, 1])))


def _by_biases(gain: Array, carried: Carried, priors: Priors, sensor: str) -> Array:
    """Covariance (k, k) by biases and their drifts, of gains (m, k, 3) to each block's mean.

    Walks and ramps since time 0 of the stamps, as biases are those that were switched on.
    """
    bias, instability, walk, ramp = (
        float(getattr(priors, f"{sensor}_{name}"))
        for name in ("bias", "instability", "random_walk", "ramp")
    )
    covariance = np.zeros((gain.shape[1],) * 2)
    middle = np.maximum((carried.t[1:] + carried.t[:-1]) / 2, 0.0)
    if sigma := turn_on(bias, instability):
        J = sigma * gain.sum(axis=0)
        covariance += J @ J.T
    if instability:
        covariance += sum_covariance(gain, float(carried.spans[-1]), flicker(instability))
    if walk:
        after = (
            np.cumsum(gain[::-1], axis=0)[::-1]
            * np.sqrt(np.diff(middle, prepend=0.0))[:, None, None]
        )
        covariance += walk**2 * np.einsum("mij,mkj->ik", after, after)
    if ramp:
        J = ramp * np.tensordot(middle, gain, axes=1)
        covariance += J @ J.T
    return covariance


def _per_constant(gyro: Array, accel: Array, carried: Carried, priors: Priors) -> Array:
    """Functionals (k, c) per constant error of one sigma, other than biases, of gains (m, k, 3)."""
    spans = carried.spans[:, None]
    total = np.zeros((gyro.shape[1], constant_form(priors).count))
    for first in range(0, len(spans), _CHUNK):  # a column is as long as the record
        own = slice(first, first + _CHUNK)
        columns = constant_columns(
            carried.dtheta[own] / spans[own], carried.dv[own] / spans[own], priors
        )
        for gain, rows in ((gyro, slice(3)), (accel, slice(3, 6))):
            total += np.tensordot(gain[own], columns[:, rows], ([0, 2], [0, 1]))
    return total


def _line(carried: Carried) -> Array:
    """From -1/2 to 1/2 over the record (m, 1, 1), at the middles of the blocks."""
    middle = np.cumsum(carried.spans) - carried.spans / 2
    return np.asarray((middle / carried.spans.sum() - 0.5)[:, None, None])


def swings(carried: Carried, C_ni: Array, site: Site) -> Array:
    """Mean velocity of each block in n (m, 3, 3), per metre of lever arm along each axis of b.

    A place r in b moves by ``C(t2) r - C(t1) r`` in a block, whatever turned it meanwhile; what
    it moves with the Earth is in gravity already.
    """
    spans = carried.spans[:, None, None]
    moved = C_ni @ np.diff(matrices(carried.q), axis=0)
    with_earth = cross_matrix(site.w_ie_n) @ drive(carried, C_ni)
    return np.asarray((moved - with_earth) / spans)


def arm_of(carried: Carried, matched: Match, noise: Noise, priors: Priors, site: Site) -> Arm:
    """The lever arm by its prior and by how the velocity curve follows the attitude.

    Notes
    -----
    Least squares of the residual by `swings`, both beyond cubic polynomials, which errors of
    attitude and biases of accelerometers make; then by noise, constants and prior weighed as
    Bayes has it: with ``y = N r + noise`` of covariance P and a prior of variance s^2,
    ``r = s^2 N^T (s^2 N N^T + P)^-1 y``. What does not turn shows no arm, and needs none.
    """
    m, sigma = len(carried.spans), priors.lever_arm
    if not sigma > 0:
        none = np.zeros((m, 3, 3))
        return Arm(np.zeros(3), none, none, np.zeros((3, 3)))
    C_ni, root = matched.C_ni.as_matrix(), np.sqrt(carried.spans)[:, None]
    felt = swings(carried, C_ni, site)
    smooth, _ = np.linalg.qr(_legendre(carried)[:, :_ARM_ORDERS] * root)
    beyond = felt.reshape(m, 9) * root
    beyond = (beyond - smooth @ (smooth.T @ beyond)) * root
    weights = beyond.reshape(m, 3, 3).transpose(0, 2, 1)
    gyro, accel = sensitivity(weights, C_ni, carried)
    P = functional_covariance(gyro, accel, C_ni, carried, noise, priors)
    N = np.tensordot(weights, felt, ([0, 2], [0, 1]))
    S = sigma**2 * N @ N.T + P
    # along a steady axis nothing swings: what rounding leaves there is no arm
    gain = sigma**2 * N.T @ np.linalg.pinv(S, rcond=_UNSWUNG, hermitian=True)
    weights = gain @ weights
    place = np.tensordot(weights, matched.residual, ([0, 2], [0, 1]))
    return Arm(place, felt, weights, sigma * (np.eye(3) - gain @ N))


def laid(
    readings: ImuReadings, carried: Carried, site: Site, priors: Priors
) -> tuple[Match, Noise, Arm]:
    """The match of the curves, the noise and the arm that it is by."""
    known = "gyro" not in priors.noise_only
    matched = match(carried, site, unbiased=known)
    noise = stated_noise(readings, carried, matched, priors, site)
    matched, arm = _with_arm(carried, noise, priors, site, matched)
    return matched, noise, arm


def _with_arm(
    carried: Carried, noise: Noise, priors: Priors, site: Site, without: Match | None = None
) -> tuple[Match, Arm]:
    """The match of the curves rid of the swing of the arm that it shows, and that arm; `without`:
    the match before, where there is one."""
    known = "gyro" not in priors.noise_only
    matched = match(carried, site, unbiased=known) if without is None else without
    arm = arm_of(carried, matched, noise, priors, site)
    if priors.lever_arm > 0:
        matched = match(carried, site, arm.place, known)
    return matched, arm


def attitude_weights(carried: Carried, matched: Match) -> Array:
    """How the matched rotation follows the block means of velocity error (m, 3, 3), in n."""
    return -_weights(carried.spans, matched)[:, :3]


def _weights(spans: Array, matched: Match) -> Array:
    """Least squares (m, 3 or 4, 3) of a small rotation, and of the level rate's size if it is free,
    by the block means of velocity."""
    curves = cross_matrix(matched.reference)  # of a turn by phi: phi x r, rows by phi's components
    if matched.larger is not None:
        curves = np.concatenate([curves, matched.larger[:, None]], axis=1)
    weighted = spans[:, None, None] * curves
    normal = np.tensordot(weighted, curves, ([0, 2], [0, 2]))
    return np.asarray(np.linalg.inv(normal) @ weighted)


def lever_of(spans: Array, matched: Match) -> Array:
    """Tilts N, E (2,) per radian by which heading is held off the match: W cos lat over half of the
    record, and what leans the plumb line."""
    curves = cross_matrix(matched.reference)
    normal = np.tensordot(spans[:, None, None] * curves, curves, ([0, 2], [0, 2]))
    return np.asarray(-np.linalg.solve(normal[:2, :2], normal[:2, 2]))


def along(across: Array) -> Array:
    """How the level rate is found larger, in parts of it, by weights (..., 3) that find heading."""
    return np.asarray(across @ _ALONG)


def less_arm(weights: Array, arm: Arm) -> tuple[Array, Array]:
    """Functionals (m, k, 3) of a curve that the arm's swing is taken from; what is left of it
    (k, 3), per unit cause."""
    J = np.tensordot(weights, arm.swings, ([0, 2], [0, 1]))
    return weights - J @ arm.weights, J @ arm.left


def inertial(dwells: Ordered[Dwell], site: Site, options: Options) -> list[AttitudeEstimate]:
    """Attitude at the end of each stretch, on a base that rocks, sways, turns or rests.

    Parameters
    ----------
    dwells : sequence of Dwell
        Any motion about a point that stays; the attitude is that at the last sample.
    site : Site
        ``latitude`` needed, not at a pole.
    options : Options
        `priors`: ``gyro_walk`` and ``accel_walk`` (both 0: see `white_levels` and `quieter`, of a
        base that moves `plateaus_of`);
        biases and scale factor errors enter the covariance by theirs. Of a unit of which nothing
        but noise is known, the size of the Earth's level rate is free: a gyro's bias along north
        would else tilt the answer.

    Returns
    -------
    list of AttitudeEstimate
        ``C_nb`` at ``t_to``, the last sample's stamp (of a turning stretch: as it would be at
        encoder angle zero), and its covariance, cross terms included.

    Raises
    ------
    NotAtRest
        The velocity wanders beyond noise and 0.1 m/s: the instrument travels.
    AlignmentError
        A gap; a turn too fast for the sampling rate.
    TooShort, PoleError

    Notes
    -----
    Leading errors: heading ``1.195 ARW/(W cos lat sqrt T)`` (velocity curves with their start
    unknown: sqrt(10/7) of the floor) and ``b_E/(W cos lat)``; tilt b/g. A drift d of
    accelerometers toward north over the record feigns a turn, ``d/(g W T cos lat)`` of heading
    (10 ug in 600 s: 1.2'), by the prior of its instability. A lag leaves that times the last rate,
    sway of displacement r some ``60 r/(g T^2)`` over ``W T cos lat``. Below 50 Hz, of what turns,
    what samples leave out of a motion is counted (`sampling_covariance`). The residuals are sums of
    noise, so the covariance is not taken from their size but from the estimate's own
    sensitivity to each block's noise. Valid while the heading's sigma is below 8 deg.
    """
    site.horizontal_rate()
    return [_align(dwell, site, options) for dwell in dwells]


def inertial_tracks(dwell: Dwell, site: Site, options: Options) -> list[AttitudeTrack]:
    """The attitude at the end of the record so far, as it grows: the last of them `inertial`'s."""
    site.horizontal_rate()
    readings = checked_readings(dwell)
    priors = with_rounding(options.priors, readings)
    carried = carry(readings, block_of(readings))
    priors = with_places(priors, squared_rate(carried))
    whole, noise, _ = laid(readings, carried, site, priors)
    rest = rest_of(dwell, readings, priors, (carried, whole, noise), site)
    sampled = sampling_covariance(readings, (carried, whole, noise), priors, site)
    m = len(carried.spans)
    ends = np.arange(m, _LEAST_BLOCKS - 1, -max(1, m // _TRACK_POINTS))[::-1]
    found = []
    for end in ends:
        part = carried.until(int(end))
        matched, arm = _with_arm(part, noise, priors, site)
        C_nb = matched.C_ni * Rotation.from_quat(part.q[-1])
        P, _ = covariances(part, matched, noise, priors, arm, site)
        P = P + rest_covariance(part, matched, rest)
        P *= less_turned(P, left_of_the_turn(part, matched, priors))
        found.append((C_nb, P + lag_covariance(part, matched, priors, site)[-1] + sampled))
    sequence = options.rule.sequence_at(found[-1][0])
    return [
        AttitudeTrack(
            METHOD,
            dwell.label,
            carried.t[ends],
            Rotation.concatenate([C for C, _ in found]),
            sequence,
            np.array([P for _, P in found]),
        )
    ]


def checked_readings(dwell: Dwell) -> ImuReadings:
    """The stretch's readings; refused when a gap lost rotation or they are too few."""
    readings = dwell.window()
    if len(readings) < LEAST_SAMPLES:
        raise TooShort(f"{dwell.label}: {len(readings)} samples, at least {LEAST_SAMPLES}")
    for gap in gap_doubt(readings):
        raise AlignmentError(f"{dwell.label}: {gap}: what the gyros felt there is lost")
    return readings


def squared_rate(carried: Carried) -> float:
    """Mean square of the rate over the blocks [rad^2/s^2]."""
    means = carried.dtheta / carried.spans[:, None]
    return float(np.mean(np.sum(means**2, axis=1)))


def with_places(priors: Priors, square: float) -> Priors:
    """The priors, with what a turn makes of the accelerometers' places for a bias: ``w^2 r``.

    `square`: of its rate [rad^2/s^2]. What the Earth turns by is none: nothing is known of a bias
    then, where no sheet states one.
    """
    if not priors.places or square < _FASTER**2:
        return priors
    return replace(priors, accel_bias=float(np.hypot(priors.accel_bias, priors.places * square)))


def block_of(readings: ImuReadings) -> float:
    """Seconds of a block: half a second, less in a short record and more in one beyond 34 min."""
    span = readings.interval * len(readings)
    return max(min(BLOCK, span / _WELL_RESOLVED), span / _RESOLVED)


def _align(dwell: Dwell, site: Site, options: Options) -> AttitudeEstimate:
    readings = checked_readings(dwell)
    priors = with_rounding(options.priors, readings)
    carried = carry(readings, block_of(readings))
    priors = with_places(priors, squared_rate(carried))
    matched, noise, arm = laid(readings, carried, site, priors)
    covariance, wander = covariances(carried, matched, noise, priors, arm, site)
    rest = rest_of(dwell, readings, priors, (carried, matched, noise), site)
    covariance = covariance + rest_covariance(carried, matched, rest)
    covariance *= less_turned(covariance, left_of_the_turn(carried, matched, priors))
    covariance += lag_covariance(carried, matched, priors, site)[-1]
    covariance += untold_covariance(readings, matched.C_ni * Rotation.from_quat(carried.q[-1]))
    covariance += sampling_covariance(readings, (carried, matched, noise), priors, site)
    flags = saturation_doubt(dwell.label, readings) + gravity_doubt(carried, site)
    flags += rest.doubts(dwell)
    flags += wander_doubt(dwell.label, carried, matched, wander)
    C_nb = told_at(dwell, matched.C_ni * Rotation.from_quat(carried.q[-1]))
    return AttitudeEstimate(
        METHOD,
        dwell.label,
        dwell.t_from,
        float(readings.t[-1]),
        C_nb,
        options.rule.sequence_at(C_nb),
        covariance=covariance,
        flags=flags + heading_doubt(covariance),
    )


def turns(carried: Carried) -> bool:
    """Whether the stretch turns or rocks."""
    return largest_angle(carried) >= _ROCKED


def largest_angle(carried: Carried) -> float:
    """By how much it ever stands otherwise than at the start [rad]."""
    _, _, _, w = carried.q.T
    return float(2 * np.arccos(np.clip(np.abs(w).min(), 0.0, 1.0)))


def by_sampling(
    readings: ImuReadings, found: Rotation, noise: Noise, priors: Priors, site: Site
) -> Array:
    """Turn (3,) about n that samples too far apart for their motion leave of what is `found` at
    the end: what those half as far apart, with polynomials between, turn it by.

    Steps of two samples leave out what is of their fourth power, of which these have a sixteenth.
    """
    carried = carry(readings.twice_as_often(), block_of(readings))
    matched, _ = _with_arm(carried, noise, priors, site)
    at_end = matched.C_ni * Rotation.from_quat(carried.q[-1])
    return np.asarray((at_end * found.inv()).as_rotvec())


def sampling_covariance(
    readings: ImuReadings, whole: tuple[Carried, Match, Noise], priors: Priors, site: Site
) -> Array:
    """Covariance (3, 3) about n by samples too far apart for their motion, of what turns.

    None at 50 Hz and above: what turns a table is slower, and what shakes it turns it little.
    """
    carried, matched, noise = whole
    if not turns(carried) or readings.interval <= FOLLOWED:
        return np.zeros((3, 3))
    found = matched.C_ni * Rotation.from_quat(carried.q[-1])
    off = by_sampling(readings, found, noise, priors, site)
    return np.outer(off, off)


def told_at(dwell: Dwell, C_nb: Rotation) -> Rotation:
    """The attitude at the last sample; of a turning stretch that at encoder angle zero."""
    return C_nb if dwell.turn is None else dwell.turn.back(C_nb)


def covariances(
    carried: Carried, matched: Match, noise: Noise, priors: Priors, arm: Arm, site: Site
) -> tuple[Array, Array]:
    """Of the attitude about n (3, 3) [rad^2], and of `wander_values` (9, 9) by noise and priors.

    Where an axis wanders beyond doubt, the attitude's holds a sway as large as that. The horizontal
    Earth rate is found across itself, which is heading, as it is along itself, by the same weights
    turned by a right angle: what both make of heading on the whole circle is stated.
    """
    C_ni = matched.C_ni.as_matrix()
    spans = carried.spans
    basis = _legendre(carried)[:, _WANDER_ORDERS] * spans[:, None]
    m = len(spans)
    weights = np.empty((m, 13, 3))
    weights[:, :3] = attitude_weights(carried, matched)
    weights[:, 12] = along(weights[:, 2])
    weights[:, 3:12] = np.einsum("mo,ij->moij", basis, np.eye(3)).reshape(m, 9, 3)
    ends = [weights[k, :3] / spans[k] for k in (0, -1)]
    weights, left = less_arm(weights, arm)
    gyro, accel = sensitivity(weights, C_ni, carried)
    gyro[:, :3] += np.eye(3)  # the attitude carried to the end has all of the gyros' error
    P = functional_covariance(gyro, accel, C_ni, carried, noise, priors) + left @ left.T
    if noise.jitter:
        jitter = noise.jitter * weights / np.sqrt(spans)[:, None, None]
        P += np.tensordot(jitter, jitter, ([0, 2], [0, 2]))
    sway = sway_covariance(carried, matched)
    # Each order is one at both ends of the record, where the sway happens to stand.
    wander = P[3:12, 3:12] + np.kron(np.eye(3), 2 * sway + _FINEST**2 * np.eye(3))
    sway = sway + _slow_sway(wander_values(carried, matched), wander)
    attitude = P[:3, :3] + sum(e @ sway @ e.T for e in ends)
    both = np.ix_([12, 2], [12, 2])
    heading = by_direction(P[both])
    if matched.larger is None:
        tilted = P[np.ix_(_WITH_ALONG, _WITH_ALONG)]
        attitude = with_level_rate(attitude, tilted, lever_of(spans, matched))
    if priors.clock:
        J = by_clock(gyro[:, :3] @ drive(carried, C_ni), carried, priors)
        ahead = ahead_by_clock(carried, matched, priors, site)[-1:]
        attitude = attitude + with_clock(ahead, J, heading)[0]
    return whole_circle(attitude, heading), wander


def stated_noise(
    readings: ImuReadings, carried: Carried, matched: Match, priors: Priors, site: Site
) -> Noise:
    """White noise by the priors, or as the readings show it in the band that matters."""
    noise = noise_of(readings, priors)
    if not (priors.gyro_walk > 0 or priors.accel_walk > 0):
        noise = quieter(noise, carried, matched)
        if is_at_rest(readings):  # else what is beyond noise there is motion, or flicker
            noise = louder(noise, readings, carried, matched, site)
        else:
            unknown = np.array([sensor in priors.noise_only for sensor in SENSORS], float)
            plateaus = unknown * plateaus_of(noise, carried, matched, site)
            noise = replace(noise, plateaus=plateaus)
    if not priors.jitter:
        return noise
    change = np.sqrt(np.mean(changes_in_b(carried) ** 2, axis=0))
    by_stamps = priors.jitter * np.sqrt(readings.interval) * change
    gyro, accel = np.hypot(noise.gyro, by_stamps[:3]), np.hypot(noise.accel, by_stamps[3:])
    return replace(noise, gyro=gyro, accel=accel)


def left_of_the_turn(carried: Carried, matched: Match, priors: Priors) -> float:
    """Part of the Earth's level rate that gyros of unknown bias show, as order 2 of the level
    velocity tells; 1 where a data sheet tells it."""
    if "gyro" not in priors.noise_only:
        return 1.0
    basis = _smooth(carried)[:, 2] * np.sqrt(carried.spans)
    expected = basis @ matched.reference[:, :2]
    shown = matched.residual
    if matched.larger is not None:
        shown = shown + matched.size * matched.larger
    found = expected + basis @ shown[:, :2]
    return float(np.linalg.norm(found) / np.linalg.norm(expected))


def untold_covariance(readings: ImuReadings, C_nb: Rotation) -> Array:
    """Covariance (3, 3) about n at the end by what instants leave of the last step."""
    left = C_nb.as_matrix() * readings.untold()
    return np.asarray(left @ left.T)


def rest_covariance(carried: Carried, matched: Match, rest: Rest) -> Array:
    """What jitter and drifts of a record at rest add to the attitude's covariance (3, 3).

    A drift of d from end to end is a ramp, and as much of a constant: of another record it would
    be another one. Of a longer record's D a part p has a ramp of ``p D``, and a constant anywhere
    in ``(1 - p) D``: ``1/sqrt(12)`` of that.
    """
    C_ni = matched.C_ni.as_matrix()
    C_nb = C_ni @ matrices(carried.q[-1:])[0]
    covariance: Array = (C_nb * rest.jitter) @ C_nb.T
    return covariance + _slow_covariance(
        attitude_weights(carried, matched), np.eye(3), carried, matched, rest
    )


def _slow_covariance(
    weights: Array, turned_whole: Array, carried: Carried, matched: Match, rest: Rest
) -> Array:
    """What drifts and what lies apart make of functionals (m, k, 3) of the velocity curve, which
    have `turned_whole` (k, 3) of all that gyros turn in the record."""
    own, wide = np.concatenate([rest.gyro_drift, rest.accel_drift]), rest.drift_around
    ramp = np.maximum(own, rest.part * wide)
    constant = np.maximum(own, (1 - rest.part) * wide / np.sqrt(12))
    apart = [one for one in rest.apart if one.off.any()]
    covariance = np.zeros((weights.shape[1],) * 2)
    if not (ramp.any() or constant.any() or apart):
        return covariance
    C_ni = matched.C_ni.as_matrix()
    gyro, accel = sensitivity(weights, C_ni, carried)
    turned = drive(carried, C_ni)
    line = _line(carried)
    shares = [_share(one, carried) for one in apart]
    for part, axes in ((gyro + turned_whole, slice(3)), (accel, slice(3, 6))):
        for J, size in (
            ((part @ turned).sum(axis=0), constant),
            ((line * (part @ turned)).sum(axis=0), ramp),
        ):
            covariance = covariance + (J * size[axes]) @ (J * size[axes]).T
        for one, share in zip(apart, shares, strict=True):
            J = (share * (part @ turned)).sum(axis=0) * one.off[axes]
            covariance = covariance + J @ J.T
    return covariance


def lag_covariance(
    carried: Carried, matched: Match, priors: Priors, site: Site, turned: Array | None = None
) -> Array:
    """What readings that come late leave of the attitude's covariance at the edges (m + 1, 3, 3).

    The same motion a time `lag` before is as good a record: all is as then, turned on by the rate.
    Of accelerometers that come later than gyros a force is felt that changed meanwhile, which is
    taken for one of another attitude: of a steady spin about a level axis that undoes what late
    gyros do. `turned` (3,): by how much [rad], if it is not the match that takes it so.
    """
    if not (priors.lag or priors.accel_later):
        return np.zeros((len(carried.t), 3, 3))
    late = priors.lag * _turning(carried, matched, site)
    late = late + (_felt_later(carried, matched, priors) if turned is None else turned)
    # turned by both, a tilt lies across by half of what heading turns it, this way or that
    across = late[:, 2:] / 2 * late[:, [1, 0, 2]] * [-1.0, 1.0, 0.0]
    return np.asarray(late[:, :, None] * late[:, None] + across[:, :, None] * across[:, None])


def _felt_later(carried: Carried, matched: Match, priors: Priors) -> Array:
    """Turn (3,) about n of the match by accelerometers that come later than gyros."""
    C_ni = matched.C_ni.as_matrix()
    _, accel = sensitivity(attitude_weights(carried, matched), C_ni, carried)
    changed = (accel @ drive(carried, C_ni)) @ changed_since(carried, priors)[:, :, None]
    return np.asarray(changed.sum(axis=0)[:, 0])


def changed_since(carried: Carried, priors: Priors) -> Array:
    """What forces in b (m, 3) change by within the time that accelerometers come later than gyros.

    By their slope: what goes round is turned, and an attitude turned by as much undoes it, in full.
    """
    return np.asarray(priors.accel_later * changes_in_b(carried)[:, 3:])


def ahead_by_clock(carried: Carried, matched: Match, priors: Priors, site: Site) -> Array:
    """By how much readings tell a later attitude (m + 1, 3) about n at the edges, the later they
    are, of one sigma of a clock that runs fast.

    Where a turn has stopped within three sigmas, by its rate before.
    """
    turning, t = _turning(carried, matched, site), carried.t
    before = np.searchsorted(t, t - _BEYOND * priors.clock * np.abs(t)).clip(0, len(t) - 1)
    then = turning[before]
    faster = np.linalg.norm(then, axis=1) > np.linalg.norm(turning, axis=1)
    return np.asarray(priors.clock * t[:, None] * np.where(faster[:, None], then, turning))


def with_clock(ahead: Array, clocked: Array, heading: float) -> Array:
    """Covariances (k, 3, 3) about n by what is `ahead` (k, 3), whose own clock the attitude holds
    for an error `clocked` (k, 3) or (3,) of scale.

    Both turn with `heading`'s error h, of this sigma: ``E cos h`` of them goes together.
    """
    both = np.exp(-(heading**2) / 2) * ahead[:, :, None] * np.atleast_2d(clocked)[:, None]
    return np.asarray(ahead[:, :, None] * ahead[:, None] + both + both.transpose(0, 2, 1))


def _turning(carried: Carried, matched: Match, site: Site) -> Array:
    """Rates about n (m + 1, 3) at the edges."""
    C_nb = matched.C_ni.as_matrix() @ matrices(carried.q)
    return np.asarray((C_nb @ rates_at_edges(carried)[:, :, None])[:, :, 0] - site.w_ie_n)


def _share(one: Apart, carried: Carried) -> Array:
    """The part of each block (m, 1, 1) that lies apart."""
    common = np.minimum(carried.t[1:], one.t_to) - np.maximum(carried.t[:-1], one.t_from)
    return np.asarray((np.maximum(common, 0.0) / carried.spans)[:, None, None])


def _slow_sway(values: Array, covariance: Array) -> Array:
    """Variances (3, 3) [m^2] of sway too slow for `sway_covariance`, where an axis shows it."""
    variances = np.zeros(3)
    for axis in range(3):
        own = slice(axis, None, 3)
        if _sigmas(values[own], covariance[own, own]) > _WANDER_DOUBT:
            variances[axis] = values[own] @ values[own]
    return np.diag(variances)


def _sigmas(values: Array, covariance: Array) -> float:
    """Root of the mean square of normalised values (k,)."""
    return float(np.sqrt(values @ np.linalg.solve(covariance, values) / len(values)))


def wander_values(carried: Carried, matched: Match) -> Array:
    """Displacements (9,) [m] of Legendre orders 3 to 5 in N, E, D that the residual holds."""
    weighted = _legendre(carried)[:, _WANDER_ORDERS] * carried.spans[:, None]
    values: Array = (weighted.T @ matched.residual).ravel()
    return values


def wander_doubt(
    label: str, carried: Carried, matched: Match, covariance: Array
) -> tuple[str, ...]:
    """Refuse or remark slow velocity that neither noise, priors nor sway explain."""
    values = wander_values(carried, matched)
    sigmas = _sigmas(values, covariance)
    speed = float(np.linalg.norm(values)) / float(carried.t[-1] - carried.t[0])
    if sigmas <= _WANDER_DOUBT:
        return ()
    found = f"velocity wanders by {speed:.3g} m/s, {sigmas:.0f} times what noise makes"
    if sigmas > _WANDER_LIMIT and speed > _WANDER_SPEED:
        raise NotAtRest(f"{label}: {found}: the instrument travels, or its biases do")
    return (f"{found}: slow motion or drifting biases",)


def gravity_doubt(carried: Carried, site: Site) -> tuple[str, ...]:
    """A flag where the mean specific force is not gravity."""
    mean = float(np.linalg.norm(carried.v[-1])) / float(carried.t[-1] - carried.t[0])
    if abs(mean / site.gravity - 1) <= _GRAVITY_DOUBT:
        return ()
    return (f"mean specific force {mean:.3f} m/s^2 is not gravity, {site.gravity:.3f}, within 1 %",)


def _centred(curve: Array, spans: Array) -> Array:
    return curve - spans @ curve / spans.sum()


def _after(rows: Array) -> Array:
    """Sum of all later rows and half of this one."""
    total = np.cumsum(rows[::-1], axis=0)[::-1]
    total -= 0.5 * rows
    return np.asarray(total)


def _legendre(carried: Carried) -> Array:
    """Legendre polynomials (m, 9) of time, orders 0 to 8, at the middles of the blocks."""
    t = 0.5 * (carried.t[1:] + carried.t[:-1])
    x = 2 * (t - carried.t[0]) / (carried.t[-1] - carried.t[0]) - 1
    return legvander(x, _SMOOTH_ORDER)


def sway_covariance(carried: Carried, matched: Match) -> Array:
    """Covariance (3, 3) [m^2] of the displacement that sways, in n.

    The residual velocity beyond order 8, summed up: what noise makes is smoother than that.
    """
    root = np.sqrt(carried.spans)[:, None]
    basis, _ = np.linalg.qr(_legendre(carried) * root)
    weighted = matched.residual * root
    moved = np.cumsum((weighted - basis @ (basis.T @ weighted)) * root, axis=0)
    moved -= moved.mean(axis=0)
    return np.asarray(moved.T @ moved / len(moved))
