"""Azimuth on a rocking base from two horizontal gyros, as published, and what limits it.

Source: [S1], methods.md section 3; A is rebuilt so that the paper's expansions hold. The paper
leaves the sway's own angular rate out; the covariance here does not.
"""

from collections.abc import Sequence as Ordered
from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from alignment.angles import C_nb_from_angles, Sequence
from alignment.apart import PARTS
from alignment.around import less_turned
from alignment.arrays import Array
from alignment.constant_errors import constant_covariance
from alignment.doubts import apart_doubt, drift_doubt, heading_doubt
from alignment.earth import EARTH_RATE, Site
from alignment.errors import AlignmentError, TooShort
from alignment.estimate import AttitudeEstimate
from alignment.gains import Functional, functional
from alignment.information.drift import in_the_mean
from alignment.levelling import level
from alignment.methods.inertial import LEAST_SPECTRUM, white_levels
from alignment.methods.position_fit import ROUNDING, local_vectors
from alignment.noise import (
    apart_of,
    around_doubt,
    around_variance,
    block_means,
    drift_of,
    faint_doubt,
    gap_doubt,
    integral_variance,
    is_at_rest,
    low_density,
    mean_and_variance,
)
from alignment.options import Options, Priors
from alignment.readings import Dwell, ImuReadings
from alignment.rounding import rounding_variance
from alignment.saturation import saturation_doubt
from alignment.skew import correlated
from alignment.strapdown import carry
from alignment.units import DEG, STANDARD_GRAVITY

METHOD = "two-gyro"

LARGEST_TURN = np.radians(10.0)  # rms about its line: a turn by a between two rests has a/4
LARGEST_TILT = np.radians(10.0)  # mean tilt: near enough to level for two gyros to tell
LARGEST_SWAY = np.radians(5.0)  # rms about the mean
LEAST_SAMPLES = 32
_HALF = 0.5
_FILTERED, _AMONG = 4.0, 8  # times the noise of samples that means of so many are of
_STEP = 1e-4  # of Earth rate, of gravity: differences for slopes
_STILL = 1e-5  # rad rms: a base that rocks by less rests
_BLOCK = 0.5  # s
_DIFFERENCES = 20  # sum of squares of 1, -3, 3, -1: variance of third differences of white noise


def azimuth_as_published(
    f1: ArrayLike, f2: ArrayLike, beta: ArrayLike, gamma: ArrayLike, latitude: float
) -> Array:
    """[S1]'s azimuth of X1 [rad], clockwise from north: ``-atan(f2/f1) + atan(B/A)``.

    Parameters
    ----------
    f1, f2 : array_like
        Rates of the gyros along X1 and Z1, any common unit.
    beta, gamma : array_like
        How far Z1 and X1 are raised [rad]: minus roll, and pitch (yaw-roll-pitch).
    latitude : float
        [rad]

    Notes
    -----
    ``A = cos lat cos gam + sin lat cos bet sin gam``, ``B = sin lat sin bet``: exact for azimuth 0
    only; elsewhere wrong by tan(lat) times the tilts, to first order.
    """
    A, B = _tilt_terms(beta, gamma, latitude)
    return np.asarray(-np.arctan(np.asarray(f2) / np.asarray(f1)) + np.arctan2(B, A))


def _tilt_terms(beta: ArrayLike, gamma: ArrayLike, latitude: float) -> tuple[Array, Array]:
    s, c = np.sin(latitude), np.cos(latitude)
    A = c * np.cos(gamma) + s * np.cos(beta) * np.sin(gamma)
    return np.asarray(A), np.asarray(s * np.sin(beta))


def azimuth(
    f1: ArrayLike, f2: ArrayLike, beta: ArrayLike, gamma: ArrayLike, latitude: float
) -> Array:
    """Azimuth of X1 [rad], clockwise from north, at any azimuth; arguments as published.

    Notes
    -----
    ``-atan2(f2, f1) + tan(lat) (bet cos a + gam sin a)``, to first order in the tilts; `a` on the
    right from the azimuth itself.
    """
    uncorrected = -np.arctan2(f2, f1)
    found = uncorrected
    for _ in range(3):  # the correction is small: each pass adds a factor of it
        tilt = np.asarray(beta) * np.cos(found) + np.asarray(gamma) * np.sin(found)
        found = uncorrected + np.tan(latitude) * tilt
    return np.asarray(found)


def azimuth_of_sway(
    f1: float, f2: float, beta: ArrayLike, gamma: ArrayLike, latitude: float
) -> float:
    """Azimuth of X1 [rad], clockwise from north, of mean rates under any tilts (n,) meanwhile.

    Notes
    -----
    At azimuth a the gyro along b's axis i sees, over ``W cos lat`` and on average,
    ``m_i = cos(a) p_i - sin(a) q_i + tan(lat) u_i``: p, q, u the means of ahead, right and up in
    b. ``f1 m_3 = f2 m_1`` is solved as it stands, so no order of the tilts is left out; only the
    ratio of the rates counts. To first order it is `azimuth`.

    Raises
    ------
    AlignmentError
        Two azimuths give such rates (``tan(lat)`` times the tilt above 1), or none.
    """
    t = float(np.tan(latitude))
    beta, gamma = np.asarray(beta), np.asarray(gamma)
    p1 = np.mean(np.cos(gamma))
    q1, q3 = -np.mean(np.sin(gamma) * np.sin(beta)), np.mean(np.cos(beta))
    u1, u3 = np.mean(np.sin(gamma) * np.cos(beta)), np.mean(np.sin(beta))
    if abs(t) * np.hypot(u1, u3) >= 1:
        raise AlignmentError(
            f"tilted by {np.degrees(np.arcsin(np.hypot(u1, u3))):.1f} deg: two azimuths give such "
            f"rates; below {np.degrees(np.arcsin(1 / abs(t))):.1f} deg one does at this latitude"
        )
    A, B, C = -f2 * p1, f1 * q3 - f2 * q1, t * (f1 * u3 - f2 * u1)
    size = np.hypot(A, B)
    if not abs(C) < size:
        raise AlignmentError("no azimuth gives such rates")
    # As the azimuth goes round, (m_1, m_3) goes round zero once, the way X1 turns: rates along it
    # cross zero downward, at the other root those against it do upward.
    return float(np.arccos(-C / size) - np.arctan2(B, A))


@dataclass(frozen=True, slots=True)
class Sway:
    """Tilts of a rocking base from its samples [rad], and their unbiased variances [rad^2].

    `beta`, `gamma`: mean of how far Z1 and X1 are raised; `variance_beta`, `variance_gamma`,
    `covariance`: of the sway about them.
    """

    beta: float
    gamma: float
    variance_beta: float
    variance_gamma: float
    covariance: float

    @property
    def rms(self) -> float:
        """Of the sway about both axes [rad]."""
        return float(np.sqrt(self.variance_beta + self.variance_gamma))


def sway_of(f_b: Array) -> Sway:
    """Tilts of samples of specific force (n, 3): [S1]'s means and unbiased variances."""
    roll, gamma = level(f_b, Sequence.YAW_ROLL_PITCH)
    D = np.cov(-roll, gamma)
    return Sway(
        float(np.mean(-roll)), float(gamma.mean()), float(D[0, 0]), float(D[1, 1]), float(D[0, 1])
    )


def sway_bound(sway: Sway, latitude: float) -> float:
    """[S1]'s bound of the azimuth error of a sample [rad], one sigma, Earth rate alone.

    Notes
    -----
    ``(|A*| sqrt(D z2) + |B*| sqrt(D z1)) / (A*^2 + B*^2)``, with z1, z2 the first-order sway terms
    of A and B. Near level it is ``tan(lat) sqrt(D xi)``: the sway of Z1 alone counts.
    """
    s, c = np.sin(latitude), np.cos(latitude)
    A, B = _tilt_terms(sway.beta, sway.gamma, latitude)
    by_gamma = -c * np.sin(sway.gamma) + s * np.cos(sway.beta) * np.cos(sway.gamma)
    by_beta = -s * np.sin(sway.beta) * np.sin(sway.gamma)
    D_z1 = (
        by_gamma**2 * sway.variance_gamma
        + by_beta**2 * sway.variance_beta
        + 2 * by_gamma * by_beta * sway.covariance
    )
    D_z2 = (s * np.cos(sway.beta)) ** 2 * sway.variance_beta
    bound = np.abs(A) * np.sqrt(D_z2) + np.abs(B) * np.sqrt(np.maximum(D_z1, 0.0))
    return float(bound / (A**2 + B**2))


def white_density(values: Array, interval: float) -> Array:
    """Density (k,) of white noise in samples (n, k), from third differences.

    Motion that is smooth over four samples does not show in it.
    """
    return np.asarray(np.mean(np.diff(values, 3, axis=0) ** 2, axis=0) / _DIFFERENCES * interval)


def rocking_rate_variance(w_ib_b: Array, interval: float) -> Array:
    """Variance (k,) of mean rates (n, k) about the Earth's: white noise, and sway that ends askew.

    Notes
    -----
    The mean of the sway's own rate is what it turned from start to end, over T: variance
    ``2 D/T^2`` for a sway of variance D. The integral of the rate, less its straight line, has the
    variance ``V = D + N^2 T/15``; so ``N^2/T + 2 D/T^2 = 2 V/T^2 + (13/15) N^2/T``. Drift slower
    than the record adds to V likewise.
    """
    T = interval * len(w_ib_b)
    wander = integral_variance(w_ib_b) * interval**2
    return np.asarray(2 * wander / T**2 + 13 / 15 * quiet_density(w_ib_b, interval) / T)


def quiet_density(values: Array, interval: float) -> Array:
    """Density (k,) of white noise in the quietest of three bands: motion fills one or two.

    Third differences see what is faster than a sway, the spectrum's octaves what lies between it
    and a dither, the lowest twenty periods of the record what lies below. The first counts unless
    another has less than half of it: chance alone does not make that.
    """
    density = white_density(values, interval)
    other = low_density(values) * interval
    if len(values) >= LEAST_SPECTRUM:
        other = np.minimum(other, white_levels(values, interval) ** 2)
    return np.where(other < _HALF * density, other, density)


def two_gyro(dwells: Ordered[Dwell], site: Site, options: Options) -> list[AttitudeEstimate]:
    """Mean attitude of each dwell on a rocking base, from the gyros along X1 and Z1.

    Parameters
    ----------
    dwells : sequence of Dwell
        Y1 within 10 deg of up on average; the base may rock by up to 5 deg rms.
    site : Site
        Latitude known.
    options : Options
        `rule`; `priors`: biases and all other constant errors, which enter the covariance.

    Returns
    -------
    list of AttitudeEstimate
        ``C_nb`` of the mean attitude. Its covariance holds the sway's own rate; a flag gives the
        published bound, which does not. `sway`: [S1] (16), the fields of `Sway` and that bound.

    Raises
    ------
    AlignmentError
        Y1 not up, sway too large, or a turning stretch.
    TooShort, PoleError

    Notes
    -----
    Leading errors: the sway's own rate, ``sqrt(2 D)/T`` over ``W cos lat`` (0.5 deg over 300 s:
    some 44 deg); ``-dw_E/(W cos lat) + tan(lat) b_E/g``. The tilts are in it to all orders, as
    `azimuth_of_sway` has them: [S1]'s first order would be wrong by degrees at 8 deg and latitude
    67. The covariance is by the estimate's own slopes there.
    """
    site.horizontal_rate()
    latitude, _ = local_vectors(site)
    assert latitude is not None
    for dwell in dwells:
        if dwell.turn is not None:
            raise AlignmentError(f"{dwell.label}: turns at a constant rate: no mean attitude")
    return [_single(dwell, latitude, site, options) for dwell in dwells]


def _single(dwell: Dwell, latitude: float, site: Site, options: Options) -> AttitudeEstimate:
    readings = dwell.window()
    if len(readings) < LEAST_SAMPLES:
        raise TooShort(
            f"{dwell.label}: {len(readings)} samples, at least {LEAST_SAMPLES} are needed"
        )
    sway = sway_of(readings.f_b)
    _check_sway(dwell.label, readings, sway)
    beta, gamma = _tilts(readings)
    w = readings.w_ib_b.mean(axis=0)
    try:
        found = azimuth_of_sway(w[0], w[2], beta, gamma, latitude)
    except AlignmentError as error:
        raise AlignmentError(f"{dwell.label}: {error}") from error
    means = float(np.mean(beta)), float(np.mean(gamma))
    C_nb = C_nb_from_angles(Sequence.YAW_ROLL_PITCH, -means[0], -found, means[1])
    slopes = _slopes(C_nb, latitude)
    readings_covariance = _reading_covariance(readings, options) + np.diag(around_variance(dwell))
    covariance = slopes @ readings_covariance @ slopes.T
    left = _left_of_the_turn(w, readings, site, options.priors)
    covariance = covariance * less_turned(covariance, left)
    return AttitudeEstimate(
        METHOD,
        dwell.label,
        dwell.t_from,
        dwell.t_to,
        site.plumb * C_nb,
        options.rule.sequence_for(readings.f_b.mean(axis=0))
        if dwell.nominal is None
        else options.rule.sequence_at(dwell.nominal),
        covariance=site.about_n(covariance),
        flags=gap_doubt(readings)
        + saturation_doubt(dwell.label, readings)
        + heading_doubt(covariance)
        + around_doubt(dwell)
        + faint_doubt(readings, options.priors)
        + _doubts(readings, sway, latitude),
        sway=asdict(sway) | {"bound": sway_bound(sway, latitude)},
    )


def _tilts(readings: ImuReadings) -> tuple[Array, Array]:
    """How far Z1 and X1 are raised in each sample; of a rest, by the mean force, in all of it.

    There the samples differ by vibration, whose mean square would pass for a tilt.
    """
    f = readings.f_b.mean(axis=0) if is_at_rest(readings) else readings.f_b
    roll, gamma = level(f, Sequence.YAW_ROLL_PITCH)
    return -roll, gamma


def _attitude(w: Array, f: Array, latitude: float) -> Rotation:
    """``C_nb`` of a rest with mean rate and force (3,)."""
    roll, gamma = level(f, Sequence.YAW_ROLL_PITCH)
    found = azimuth_of_sway(w[0], w[2], -roll, gamma, latitude)
    return C_nb_from_angles(Sequence.YAW_ROLL_PITCH, float(roll), -found, float(gamma))


def _slopes(C_nb: Rotation, latitude: float) -> Array:
    """Small rotation about n (3, 6) per error of mean rates and forces in b, by differences.

    Of what perfect sensors give at ``C_nb``: by readings that are far off slopes would be too.
    """
    w = C_nb.inv().apply(EARTH_RATE * np.array([np.cos(latitude), 0.0, -np.sin(latitude)]))
    f = C_nb.inv().apply([0.0, 0.0, -STANDARD_GRAVITY])
    found = np.empty((3, 6))
    for k, step in enumerate(_STEP * np.repeat([EARTH_RATE, STANDARD_GRAVITY], 3)):
        moved = np.zeros(6)
        moved[k] = step
        above, below = (
            _attitude(w + sign * moved[:3], f + sign * moved[3:], latitude) for sign in (1, -1)
        )
        found[:, k] = (above * below.inv()).as_rotvec() / (2 * step)
    return found


def two_gyro_functional(readings: ImuReadings, site: Site, options: Options) -> Functional:
    """Means of two gyros and of levelling, by the slopes of the estimate; of a base at rest.

    Raises
    ------
    AlignmentError
        The base rocks: what it turns from start to end is the error, and no sensor's.
    """
    site.horizontal_rate()
    latitude, _ = local_vectors(site)
    assert latitude is not None
    sway = sway_of(readings.f_b)
    _check_sway("base", readings, sway)
    carried = carry(readings, _BLOCK)
    T = float(carried.t[-1] - carried.t[0])
    if sway.rms > _STILL:
        wander = np.sqrt(2 * integral_variance(readings.w_ib_b)[[0, 2]].max()) * readings.interval
        leaves = np.degrees(wander / T / site.horizontal_rate())
        raise AlignmentError(
            f"no prediction is made: the base rocks by {np.degrees(sway.rms):.2g} deg rms, and "
            f"what it turns from start to end is some {leaves:.2g} deg of heading (1 sigma), "
            "whatever the sensors; see --verify"
        )
    C_nb = _attitude(readings.w_ib_b.mean(axis=0), readings.f_b.mean(axis=0), latitude)
    slopes = site.plumb.as_matrix() @ _slopes(C_nb, latitude)
    parts = (carried.spans / T)[:, None, None]
    C_ni = C_nb * Rotation.from_quat(carried.q[-1]).inv()
    return functional(carried, C_ni, parts * slopes[:, :3], parts * slopes[:, 3:], np.zeros((3, 3)))


def _left_of_the_turn(w: Array, readings: ImuReadings, site: Site, priors: Priors) -> float:
    """Part of the Earth's level rate that gyros of unknown bias show; 1 where a sheet tells it."""
    if "gyro" not in priors.noise_only:
        return 1.0
    up = readings.f_b.mean(axis=0)
    level_rate = float(np.linalg.norm(np.cross(w, up / np.linalg.norm(up))))
    return level_rate / site.horizontal_rate()


def _reading_covariance(readings: ImuReadings, options: Options) -> Array:
    """Of the mean rates and forces, (6, 6)."""
    T = readings.interval * len(readings)
    means = np.concatenate([readings.w_ib_b.mean(axis=0), readings.f_b.mean(axis=0)])
    variances = _rocking(readings)
    if is_at_rest(readings):
        _, shown = mean_and_variance(readings)
        own = slice(None) if _filtered(readings.f_b) else slice(3, 6)
        variances[own] = shown[own]
    noise = np.diag(variances + ROUNDING**2 + rounding_variance(readings))
    noise += _between_axes(readings, options.priors) / T
    priors = in_the_mean(options.priors, float(readings.t[-1]) - T, T)
    return noise + constant_covariance(means, priors)


def _rocking(readings: ImuReadings) -> Array:
    """Variances (6,) of the means of a base that rocks: what does so is no noise of its tilt."""
    w, f, interval = readings.w_ib_b, readings.f_b, readings.interval
    both = rocking_rate_variance(w, interval), quiet_density(f, interval) / (interval * len(f))
    drifts = np.concatenate([drift_of(w), drift_of(f)])
    return np.concatenate(both) + drifts**2 + (apart_of(readings).off / PARTS) ** 2


def _filtered(f_b: Array) -> bool:
    """Whether a rest's samples (n, 3) are less rough than noise makes them: by a filter, or held.

    The accelerometers tell it for the gyros, which a base that rocks by little smooths as well.
    """
    if len(f_b) < 4 * _AMONG:
        return False
    rough = white_density(f_b, 1.0)
    among = white_density(block_means(f_b, len(f_b) // _AMONG), _AMONG)
    return bool(np.median(among > _FILTERED * rough))


def _between_axes(readings: ImuReadings, priors: Priors) -> Array:
    """What white noise (6, 6) [u^2/Hz] of triads skewed by design shares between components."""
    shared = np.zeros((6, 6))
    triads = ((readings.w_ib_b, priors.gyro_axes), (readings.f_b, priors.accel_axes))
    for k, (values, axes) in enumerate(triads):
        if axes is not None:
            density = quiet_density(values, readings.interval)
            own = slice(3 * k, 3 * k + 3)
            shared[own, own] = correlated(density, axes) - np.diag(density)
    return shared


def _check_sway(label: str, readings: ImuReadings, sway: Sway) -> None:
    up = readings.f_b.mean(axis=0)
    tilt = float(np.arctan2(np.hypot(up[0], up[2]), up[1]))
    if tilt > LARGEST_TILT:
        raise AlignmentError(
            f"{label}: Y1 is {np.degrees(tilt):.1f} deg off up on average, "
            f"{np.degrees(LARGEST_TILT):.0f} are allowed"
        )
    if sway.rms > LARGEST_SWAY:
        raise AlignmentError(
            f"{label}: sway too large: {np.degrees(sway.rms):.1f} deg rms, "
            f"{np.degrees(LARGEST_SWAY):.0f} are allowed"
        )
    about = integral_variance(readings.w_ib_b @ up[:, None] / np.linalg.norm(up))
    turned = float(np.sqrt(about[0])) * readings.interval
    if turned > LARGEST_TURN:
        raise AlignmentError(
            f"{label}: heading turns by {np.degrees(turned):.1f} deg rms, "
            f"{np.degrees(LARGEST_TURN):.0f} are allowed: no mean attitude"
        )


def _doubts(readings: ImuReadings, sway: Sway, latitude: float) -> tuple[str, ...]:
    bound = sway_bound(sway, latitude)
    flags = (f"published bound of a sample, sway's own rate left out: {bound / DEG:.2g} deg",)
    return (
        flags
        + drift_doubt(drift_of(readings.w_ib_b), drift_of(readings.f_b))
        + apart_doubt(apart_of(readings))
    )
