"""Azimuth on a rocking base from two horizontal gyros, as published, and what limits it.

Source: [S1], methods.md section 3; A is rebuilt so that the paper's expansions hold. The paper
leaves the sway's own angular rate out; the covariance here does not.
"""

from collections.abc import Sequence as Ordered
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from alignment.angles import C_nb_from_angles, Sequence
from alignment.arrays import Array
from alignment.constant_errors import constant_covariance
from alignment.doubts import heading_doubt
from alignment.earth import EARTH_RATE, Site
from alignment.errors import AlignmentError, TooShort
from alignment.estimate import AttitudeEstimate
from alignment.levelling import attitude_covariance, attitude_sensitivity, level
from alignment.methods.position_fit import ROUNDING, local_vectors
from alignment.noise import gap_doubt
from alignment.options import Options
from alignment.readings import Dwell, ImuReadings
from alignment.saturation import saturation_doubt
from alignment.units import ARC_MINUTE

METHOD = "two-gyro"

LARGEST_TILT = np.radians(10.0)  # mean tilt: second order is then 1.7 % of the first
LARGEST_SWAY = np.radians(5.0)  # rms about the mean
LEAST_SAMPLES = 32
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
    n = len(w_ib_b)
    T = interval * n
    turned = np.cumsum(w_ib_b - w_ib_b.mean(axis=0), axis=0) * interval
    turned -= turned.mean(axis=0)
    line = np.arange(n) - (n - 1) / 2
    wander = np.maximum(turned.var(axis=0) - (line @ turned) ** 2 / (line @ line) / n, 0.0)
    return np.asarray(2 * wander / T**2 + 13 / 15 * white_density(w_ib_b, interval) / T)


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
        published bound, which does not.

    Raises
    ------
    AlignmentError
        Y1 not up, sway too large, or a turning stretch.
    TooShort, PoleError

    Notes
    -----
    Leading errors: the sway's own rate, ``sqrt(2 D)/T`` over ``W cos lat`` (0.5 deg over 300 s:
    some 44 deg); ``-dw_E/(W cos lat) + tan(lat) b_E/g``; second order in the mean tilts.
    """
    site.horizontal_rate()
    latitude, gravity = local_vectors(site)
    assert latitude is not None
    assert gravity is not None
    for dwell in dwells:
        if dwell.turn is not None:
            raise AlignmentError(f"{dwell.label}: turns at a constant rate: no mean attitude")
    return [_single(dwell, latitude, gravity, site, options) for dwell in dwells]


def _single(
    dwell: Dwell, latitude: float, gravity: float, site: Site, options: Options
) -> AttitudeEstimate:
    readings = dwell.window()
    if len(readings) < LEAST_SAMPLES:
        raise TooShort(
            f"{dwell.label}: {len(readings)} samples, at least {LEAST_SAMPLES} are needed"
        )
    sway = sway_of(readings.f_b)
    _check_sway(dwell.label, readings, sway)
    w = readings.w_ib_b.mean(axis=0)
    found = float(azimuth(w[0], w[2], sway.beta, sway.gamma, latitude))
    C_nb = C_nb_from_angles(Sequence.YAW_ROLL_PITCH, -sway.beta, -found, sway.gamma)
    G = attitude_sensitivity(EARTH_RATE * np.cos(latitude), EARTH_RATE * np.sin(latitude), gravity)
    covariance = attitude_covariance(C_nb, _reading_covariance(readings, options), G)
    up = readings.f_b.mean(axis=0)
    if dwell.nominal is not None:
        up = dwell.nominal.inv().apply([0.0, 0.0, -1.0])
    return AttitudeEstimate(
        METHOD,
        dwell.label,
        dwell.t_from,
        dwell.t_to,
        site.plumb * C_nb,
        options.rule.sequence_for(up),
        covariance=covariance,
        flags=gap_doubt(readings)
        + saturation_doubt(dwell.label, readings)
        + heading_doubt(covariance)
        + _doubts(sway, latitude, covariance),
    )


def _reading_covariance(readings: ImuReadings, options: Options) -> Array:
    """Of the mean rates and forces, (6, 6); the vertical gyro is not used."""
    T = readings.interval * len(readings)
    means = np.concatenate([readings.w_ib_b.mean(axis=0), readings.f_b.mean(axis=0)])
    variances = np.concatenate(
        [
            rocking_rate_variance(readings.w_ib_b, readings.interval),
            white_density(readings.f_b, readings.interval) / T,
        ]
    )
    whole = np.diag(variances + ROUNDING**2) + constant_covariance(means, options.priors)
    whole[1], whole[:, 1] = 0.0, 0.0
    return whole


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


def _doubts(sway: Sway, latitude: float, covariance: Array) -> tuple[str, ...]:
    sigma = float(np.sqrt(covariance[2, 2]))
    bound = sway_bound(sway, latitude)
    flags = (f"published bound of a sample, sway's own rate left out: {bound / ARC_MINUTE:.2g}'",)
    second = abs(np.tan(latitude)) * (sway.beta**2 + sway.gamma**2) / 2
    if second > sigma:
        flags += (
            f"second order of the mean tilts, left out, may reach {second / ARC_MINUTE:.2g}'",
        )
    return flags
