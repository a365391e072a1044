"""Gyrocompassing with one gyro: the angle of its axis to the Earth's axis, and the latitude.

Source: [S4] analytic gyrocompassing, methods.md section 2: ``cos psi = (w_x - W sin lat sin th) /
(W cos lat cos th)``, here for a gyro along any axis. Its errors grow as 1/sin(psi).
"""

from collections.abc import Sequence as Ordered

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation
from scipy.special import ndtr

from alignment.around import by_one_gyro, whole_circle
from alignment.arrays import Array
from alignment.constant_errors import constant_covariance
from alignment.doubts import heading_doubt
from alignment.earth import EARTH_RATE, Site
from alignment.errors import AlignmentError
from alignment.estimate import AttitudeEstimate
from alignment.gains import Answer, each_alone, from_b
from alignment.information import Stretch
from alignment.information.drift import in_the_mean
from alignment.levelling import attitude_covariance
from alignment.methods.position_fit import ROUNDING, local_vectors
from alignment.methods.triad import triad_attitude
from alignment.noise import (
    around_doubt,
    check_at_rest,
    dwell_mean_and_variance,
    faint_doubt,
    gap_doubt,
    rest_doubt,
)
from alignment.options import Options
from alignment.readings import Dwell
from alignment.rocked import mean_doubt
from alignment.saturation import saturation_doubt

METHOD = "single-gyro"
GYROS = ("X1", "Y1", "Z1")
_NEVER = 1e-6
_RATE_DOUBT = 0.2  # part of Earth rate by which a mean rate may differ unremarked


def gyro_latitude(w_ib_b: Array, f_b: Array) -> Array:
    """Latitude [rad] (...) from mean rate and specific force (..., 3): ``asin(w . up / W)``.

    Raises
    ------
    AlignmentError
        The vertical rate exceeds Earth rate.
    """
    up = f_b / np.linalg.norm(f_b, axis=-1, keepdims=True)
    ratio = np.einsum("...i,...i->...", w_ib_b, up) / EARTH_RATE
    worst = float(ratio.flat[np.argmax(np.abs(ratio))])
    if abs(worst) > 1:
        raise AlignmentError(f"vertical rate is {worst:.3f} of Earth rate: no latitude, give it")
    return np.asarray(np.arcsin(ratio))


def single_gyro_attitude(
    rate: Array, f_b: Array, gyro_b: Array, latitude: ArrayLike, east: ArrayLike
) -> Array:
    """``C_nb`` (..., 3, 3) from one gyro's mean rate and the specific force.

    Parameters
    ----------
    rate : (...)
        [rad/s]
    f_b : (..., 3)
        Mean specific force; its direction alone counts.
    gyro_b : (3,)
        Unit vector of the gyro's axis, not vertical.
    latitude : (...) or float
        [rad]
    east : (...) or float
        Positive where the axis points east of the meridian, negative where west: one gyro cannot
        tell (the sign of another horizontal gyro does).

    Raises
    ------
    AlignmentError
        No heading gives such a rate.
    """
    up = f_b / np.linalg.norm(f_b, axis=-1, keepdims=True)
    raised = up @ gyro_b
    level = gyro_b - raised[..., None] * up
    size = np.linalg.norm(level, axis=-1)
    horizontal = rate - EARTH_RATE * np.sin(latitude) * raised
    cosine = np.asarray(horizontal / (EARTH_RATE * np.cos(latitude) * size))
    worst = float(cosine.flat[np.argmax(np.abs(cosine))])
    if abs(worst) > 1:
        raise AlignmentError(f"cosine of the gyro's azimuth is {worst:.3f}: no heading")
    azimuth = np.copysign(np.arccos(cosine), east)
    ahead = level / size[..., None]
    north = np.cos(azimuth)[..., None] * ahead + np.sin(azimuth)[..., None] * np.cross(up, ahead)
    return np.stack([north, np.cross(north, up), -up], axis=-2)


def single_gyro_sensitivity(
    gyro_n: Array, latitude: float, gravity: float, estimated: bool = False
) -> Array:
    """Matrix (3, 6): small rotation about n [rad] per (rate error, force error) in n.

    Parameters
    ----------
    gyro_n : (3,)
        The gyro's axis in n, not in the meridian.
    latitude, gravity : float
        [rad], [m/s^2]
    estimated : bool
        Whether the latitude comes from the same gyros (`gyro_latitude`).

    Notes
    -----
    The estimate turns the axis `a` so that ``a . w_ie`` is what the gyro reads: with
    ``q = a x w_ie``, ``eta . q = a . dw - (a . dw_ie/dlat) dlat``; ``q_D = -a_E W cos lat``.
    """
    w_n = EARTH_RATE * np.array([np.cos(latitude), 0.0, -np.sin(latitude)])
    q = np.cross(gyro_n, w_n)
    G = np.zeros((3, 6))
    G[0, 4], G[1, 3] = -1 / gravity, 1 / gravity
    row = -q[0] * G[0] - q[1] * G[1]
    row[:3] += gyro_n
    if estimated:
        by_latitude = EARTH_RATE * np.array([-np.sin(latitude), 0.0, -np.cos(latitude)])
        row -= (gyro_n @ by_latitude) * latitude_sensitivity(latitude, gravity)
    G[2] = row / q[2]
    return G


def latitude_sensitivity(latitude: float, gravity: float) -> Array:
    """Row (6,): error of `gyro_latitude` per (rate error, force error) in n."""
    up_rate = 1 / (EARTH_RATE * np.cos(latitude))
    return np.array([0.0, 0.0, -up_rate, 1 / gravity, 0.0, 0.0])


def single_gyro(dwells: Ordered[Dwell], site: Site, options: Options) -> list[AttitudeEstimate]:
    """Attitude of each dwell from the one gyro that lies nearest to east or west.

    Parameters
    ----------
    dwells : sequence of Dwell
        At rest.
    site : Site
        With a latitude, one gyro tells the heading (another only its side, east or west);
        without it the three of them tell the latitude too.
    options : Options
        `rule`; `priors`: biases and all other constant errors, which enter the covariance.

    Returns
    -------
    list of AttitudeEstimate
        Per dwell ``C_nb``, covariance from the scatter of block means and the priors; the
        latitude where it was not given.

    Raises
    ------
    AlignmentError
        No heading or no latitude gives such rates.
    NotAtRest, TooShort, PoleError

    Notes
    -----
    Leading errors: heading ``dw/(W cos lat cos th sin psi)`` and
    ``dth (tan lat - cos psi tan th)/sin psi``, psi the gyro's azimuth, th its elevation; levelling
    b/g. Immune to the bias of the vertical gyro when the latitude is given.
    """
    for dwell in dwells:
        check_at_rest(dwell)
    return [_single(dwell, site, options) for dwell in dwells]


def single_gyro_gains(stretches: Ordered[Stretch], site: Site, options: Options) -> list[Answer]:
    """Each rest by itself, heading from the gyro nearest to east or west."""
    latitude = site.known_latitude()
    site.horizontal_rate()

    def gain(C_nb: Rotation) -> Array:
        C = C_nb.as_matrix()
        best = int(np.argmax(np.abs(C[1])))
        G = site.plumb.as_matrix() @ single_gyro_sensitivity(C[:, best], latitude, site.gravity)
        return from_b(G, C_nb)

    return each_alone(stretches, gain)


def _single(dwell: Dwell, site: Site, options: Options) -> AttitudeEstimate:
    means, variances = dwell_mean_and_variance(dwell, dwell.window())
    try:
        C_nb, G, latitude, latitude_row, best = _solved(means, site)
    except AlignmentError as error:
        raise type(error)(f"{dwell.label}: {error}") from error
    priors = in_the_mean(options.priors, dwell.t_from, dwell.t_to - dwell.t_from)
    whole = np.diag(variances + ROUNDING**2) + constant_covariance(means, priors)
    covariance = attitude_covariance(C_nb, whole, G)
    if site.latitude is not None:
        covariance = whole_circle(
            covariance, _around(C_nb, C_nb.as_matrix()[:, best], whole, G, site)
        )
    if "gyro" in options.priors.noise_only:
        covariance[2, 2] += _by_choice(means, variances, C_nb, latitude, best)
    sigma = None
    if latitude_row is not None:
        variance = attitude_covariance(C_nb, whole, latitude_row[None])[0, 0]
        sigma = float(np.sqrt(max(variance, 0.0)))
    return AttitudeEstimate(
        METHOD,
        dwell.label,
        dwell.t_from,
        dwell.t_to,
        C_nb=site.plumb * C_nb,
        sequence=options.rule.sequence_for(means[3:])
        if dwell.nominal is None
        else options.rule.sequence_at(dwell.nominal),
        covariance=site.about_n(covariance),
        latitude=None if latitude_row is None else latitude - site.deflection[0],
        latitude_sigma=sigma,
        flags=gap_doubt(dwell.window())
        + saturation_doubt(dwell.label, dwell.window())
        + heading_doubt(covariance)
        + rest_doubt(dwell.window())
        + faint_doubt(dwell.window(), options.priors)
        + around_doubt(dwell)
        + mean_doubt(dwell.window())
        + _rate_doubt(means[:3]),
    )


def _rate_doubt(w_ib_b: Array) -> tuple[str, ...]:
    """The one gyro may fit the latitude while the others say that something is wrong."""
    ratio = float(np.linalg.norm(w_ib_b)) / EARTH_RATE
    if abs(ratio - 1) <= _RATE_DOUBT:
        return ()
    return (f"mean rate is {ratio:.2f} of Earth rate: gyro bias, or not at rest",)


def _around(C_nb: Rotation, gyro_n: Array, errors: Array, G: Array, site: Site) -> float:
    """Heading's root mean square on the whole circle [rad], by errors (6, 6) of means in b.

    The gyro reads its azimuth's cosine; its side is that of the rate across it.
    """
    azimuth = float(np.arctan2(gyro_n[1], gyro_n[0]))
    sine, cosine = np.sin(azimuth), np.cos(azimuth)
    across = np.array([sine, -cosine, 0.0, 0.0, 0.0, 0.0]) / site.horizontal_rate()
    rows = np.stack([-sine * G[2], across])
    return by_one_gyro(azimuth, attitude_covariance(C_nb, errors, rows))


def _by_choice(means: Array, variances: Array, C_nb: Rotation, latitude: float, best: int) -> float:
    """Variance of heading [rad^2] by which of two gyros noise makes the nearest to east or west.

    Biases that no sheet states make them contradict one another, by d. Another record chooses the
    other gyro with the chance p: a mean square of ``p d^2`` by which the two differ. (At a margin
    of none and of one sigma that is 1.2 and 1.8 times the variance of a record's choice.) None
    where the other has no answer.
    """
    w, f = means[:3], means[3:]
    coarse = triad_attitude(w, f).as_matrix()
    east = np.abs(coarse[1])
    other = int(np.argsort(east)[-2])
    level = float(np.linalg.norm(np.cross(w, f)) / np.linalg.norm(f))
    margin = np.arctan2(east[best], east[other]) - np.pi / 4
    both = float(np.sqrt(variances[best] + variances[other])) / level  # of two records' margins
    chance = float(ndtr(-margin / both)) if both else 0.0
    if chance < _NEVER:
        return 0.0
    try:
        C = single_gyro_attitude(w[other], f, np.eye(3)[other], latitude, coarse[1, other])
    except AlignmentError:
        return 0.0
    d = (Rotation.from_matrix(C) * C_nb.inv()).as_rotvec()[2]
    return float(chance * d**2)


def _solved(means: Array, site: Site) -> tuple[Rotation, Array, float, Array | None, int]:
    """Attitude, its sensitivity (3, 6), latitude, its row (6,) if estimated, the gyro."""
    w, f = means[:3], means[3:]
    coarse = triad_attitude(w, f).as_matrix()  # refuses where rate and vertical are one line
    given, _ = local_vectors(site)
    if given is not None:
        site.horizontal_rate()  # refuses at a pole
    latitude = float(gyro_latitude(w, f)) if given is None else given
    best = int(np.argmax(np.abs(coarse[1])))
    gyro_b = np.eye(3)[best]
    try:
        C = single_gyro_attitude(w[best], f, gyro_b, latitude, coarse[1, best])
    except AlignmentError as error:
        raise AlignmentError(f"{GYROS[best]} gyro: {error}") from error
    gravity = float(np.linalg.norm(f))
    G = single_gyro_sensitivity(C[:, best], latitude, gravity, given is None)
    row = latitude_sensitivity(latitude, gravity) if given is None else None
    return Rotation.from_matrix(C), G, latitude, row, best
