"""Gyrocompassing from means: TRIAD, and the latitude that a pair of positions gives.

Source: methods.md section 2, full-vector form.
"""

from collections.abc import Sequence as Ordered

import numpy as np
from scipy.spatial.transform import Rotation

from alignment.arrays import Array
from alignment.constant_errors import constant_columns, constant_covariance
from alignment.doubts import heading_doubt
from alignment.earth import EARTH_RATE, Site
from alignment.errors import AlignmentError, PoleError
from alignment.estimate import AttitudeEstimate
from alignment.gains import Answer, compass_gain, each_alone, from_b
from alignment.information import Stretch
from alignment.information.drift import Span, in_the_mean, walked
from alignment.levelling import attitude_covariance, attitude_sensitivity
from alignment.noise import (
    around_doubt,
    check_rest,
    dwell_mean_and_variance,
    faint_doubt,
    gap_doubt,
    rest_doubt,
)
from alignment.options import Options, Priors
from alignment.readings import Dwell, ImuReadings
from alignment.rocked import mean_doubt
from alignment.saturation import saturation_doubt

METHOD = "triad"
_COLLINEAR = 1e-3  # sine of the least angle between rate and vertical
_RATE_DOUBT = 0.2  # part of Earth rate by which a mean rate may differ unremarked
_OPPOSITE = np.cos(np.radians(175.0))  # two verticals this opposed form a pair


def triad_attitude(w_ib_b: Array, f_b: Array) -> Rotation:
    """``C_nb`` from mean rate (3,) and mean specific force (3,) at rest.

    Up is along f, east along ``w x up``, north along ``up x east``.

    Raises
    ------
    AlignmentError
        No specific force.
    PoleError
        The rate is within 0.06 deg of the vertical: a pole, or no Earth rate in it.
    """
    norm = float(np.linalg.norm(f_b))
    if norm == 0.0:
        raise AlignmentError("specific force is zero: no vertical")
    up = f_b / norm
    east = np.cross(w_ib_b, up)
    if np.linalg.norm(east) <= _COLLINEAR * np.linalg.norm(w_ib_b):
        raise PoleError("mean rate and vertical are collinear: heading is undefined")
    east = east / np.linalg.norm(east)
    north = np.cross(up, east)
    return Rotation.from_matrix(np.stack([north, east, -up]))


def triad_latitude(w_ib_b: Array, f_b: Array) -> float:
    """Latitude [rad] from the angle between mean rate and vertical: no Earth rate in it."""
    up = f_b / np.linalg.norm(f_b)
    return float(np.arctan2(w_ib_b @ up, np.linalg.norm(np.cross(w_ib_b, up))))


def pair_latitude(w_first: Array, f_first: Array, w_second: Array, f_second: Array) -> float:
    """Latitude [rad] from two positions with one axis up, then down.

    The mean of the two vertical rates is free of that axis's bias; its size against Earth rate
    (known) is the sine of the latitude. What does not cancel: the other axes' gyro biases times
    the tilt that accelerometer biases feign (16 mg times 720 deg/h is 11.5 deg/h).

    Raises
    ------
    AlignmentError
        The mean vertical rate exceeds Earth rate.
    """
    vertical = [w @ f / np.linalg.norm(f) for w, f in ((w_first, f_first), (w_second, f_second))]
    ratio = float(np.mean(vertical)) / EARTH_RATE
    if abs(ratio) > 1:
        raise AlignmentError(f"mean vertical rate is {ratio:.3f} of Earth rate: no latitude")
    return float(np.arcsin(ratio))


def triad(dwells: Ordered[Dwell], site: Site, options: Options) -> list[AttitudeEstimate]:
    """Attitude and latitude of each dwell, and the latitude of each opposed pair of dwells.

    Parameters
    ----------
    dwells : sequence of Dwell
        At rest.
    site : Site
        Latitude not needed. A known deflection of the vertical is taken out of attitude and
        latitude (astronomical less its northern part).
    options : Options
        `rule`; `priors`: biases and all other constant errors, which enter the covariance.

    Returns
    -------
    list of AttitudeEstimate
        Per dwell ``C_nb``, covariance from the scatter of block means and the priors, latitude.
        Then, per pair of successive dwells with opposite verticals, a latitude alone.

    Raises
    ------
    NotAtRest, TooShort, PoleError

    Notes
    -----
    Leading errors: heading ``-dw_E/(W cos lat) + tan(lat) b_E/g``; latitude
    ``(dw_U cos lat - dw_N sin lat)/W + b_N/g``.
    """
    windows, summaries = [], []
    for dwell in dwells:
        window = dwell.window()
        check_rest(window, dwell.label)
        windows.append(window)
        summaries.append(dwell_mean_and_variance(dwell, window))
    singles = [
        _single(dwell, window, summary, site, options)
        for dwell, window, summary in zip(dwells, windows, summaries, strict=True)
    ]
    pairs = []
    for k in range(len(dwells) - 1):
        (first, var_first), (second, var_second) = summaries[k : k + 2]
        if _opposed(first[3:], second[3:]):
            pair = dwells[k : k + 2]
            variances = var_first, var_second
            pairs.append(_pair(pair, (first, second), variances, site, options.priors))
    return singles + pairs


def triad_gains(stretches: Ordered[Stretch], site: Site, options: Options) -> list[Answer]:
    """Each rest by itself: level, and east from the horizontal rate."""
    G = site.plumb.as_matrix() @ compass_gain(site)
    return each_alone(stretches, lambda C_nb: from_b(G, C_nb))


def _single(
    dwell: Dwell,
    window: ImuReadings,
    summary: tuple[Array, Array],
    site: Site,
    options: Options,
) -> AttitudeEstimate:
    means, variances = summary
    w, f = means[:3], means[3:]
    try:
        C_nb = triad_attitude(w, f)
    except AlignmentError as error:
        raise type(error)(f"{dwell.label}: {error}") from error
    latitude = triad_latitude(w, f)
    rate, gravity = float(np.linalg.norm(w)), float(np.linalg.norm(f))
    G = attitude_sensitivity(
        min(rate * np.cos(latitude), _most_horizontal(site)), rate * np.sin(latitude), gravity
    )
    priors = in_the_mean(options.priors, dwell.t_from, dwell.t_to - dwell.t_from)
    whole = np.diag(variances) + constant_covariance(means, priors)
    covariance = attitude_covariance(C_nb, whole, G)
    to_latitude = _latitude_sensitivity(latitude, min(rate, EARTH_RATE), gravity)
    variance = attitude_covariance(C_nb, whole, to_latitude)[0, 0]
    flags = gap_doubt(window) + saturation_doubt(dwell.label, window)
    flags += heading_doubt(covariance) + rest_doubt(window) + around_doubt(dwell)
    flags += faint_doubt(window, options.priors) + mean_doubt(window)
    if abs(rate / EARTH_RATE - 1) > _RATE_DOUBT:
        flags += ("mean rate is not Earth's 15.04 deg/h within 20 %: gyro bias, or not at rest",)
    return AttitudeEstimate(
        METHOD,
        dwell.label,
        dwell.t_from,
        dwell.t_to,
        C_nb=site.plumb * C_nb,
        sequence=options.rule.sequence_for(f)
        if dwell.nominal is None
        else options.rule.sequence_at(dwell.nominal),
        covariance=site.about_n(covariance),
        latitude=latitude - site.deflection[0],
        latitude_sigma=_root(variance),
        flags=flags,
    )


def _most_horizontal(site: Site) -> float:
    """The horizontal rate [rad/s] that the Earth can have there.

    What is measured beyond it is bias: it says nothing of north, and makes heading no surer.
    """
    return EARTH_RATE if site.latitude is None else site.horizontal_rate()


def _root(variance: float) -> float:
    """Square root of a variance that rounding may have put below zero."""
    return float(np.sqrt(max(variance, 0.0)))


def _latitude_sensitivity(latitude: float, rate: float, gravity: float) -> Array:
    """Row (1, 6): latitude error per (rate error, force error) in n."""
    north, down = -np.sin(latitude) / rate, -np.cos(latitude) / rate
    return np.array([[north, 0.0, down, 1 / gravity, 0.0, 0.0]])


def _opposed(f_first: Array, f_second: Array) -> bool:
    size = np.linalg.norm(f_first) * np.linalg.norm(f_second)
    return bool(f_first @ f_second < _OPPOSITE * size)


def _pair(
    dwells: Ordered[Dwell],
    means: tuple[Array, Array],
    variances: tuple[Array, Array],
    site: Site,
    priors: Priors,
) -> AttitudeEstimate:
    first, second = means
    a, b = dwells
    up = first[3:] / np.linalg.norm(first[3:])
    latitude = sigma = None
    flag = "latitude from the mean vertical rate against Earth rate: axis bias cancels"
    try:
        latitude = pair_latitude(first[:3], first[3:], second[:3], second[3:])
        walks = walked(priors, [Span(d.t_from, d.t_to - d.t_from) for d in dwells])
        sigma = _pair_sigma(means, variances, latitude, priors, walks)
    except AlignmentError as error:
        flag = str(error)
    return AttitudeEstimate(
        METHOD,
        f"{a.label} + {b.label}",
        a.t_from,
        b.t_to,
        C_nb=None,
        sequence=Options().rule.sequence_for(up),
        window="pair",
        latitude=None if latitude is None else latitude - site.deflection[0],
        latitude_sigma=sigma,
        flags=(flag,),
    )


def _pair_sigma(
    means: tuple[Array, Array],
    variances: tuple[Array, Array],
    latitude: float,
    priors: Priors,
    walks: Array,
) -> float:
    """Half of each dwell's vertical rate error, and of its tilt toward the horizontal rate.

    Noise differs from dwell to dwell, drift too; the constant errors are one unit's. `walks`
    (2, 2, 2): what biases of gyros and accelerometers have walked to by both.
    """
    gravity = float(np.linalg.norm(means[0][3:]))
    half = np.array([0, 0, -1 / (EARTH_RATE * np.cos(latitude)), 1 / gravity, 0, 0]) / 2
    rows = []
    for m in means:
        R = triad_attitude(m[:3], m[3:]).as_matrix()
        rows.append(np.concatenate([half[:3] @ R, half[3:] @ R]))
    bias = np.repeat([priors.gyro_bias, priors.accel_bias], 3)
    drift = np.repeat([priors.gyro_instability, priors.accel_instability], 3)
    own = sum(row**2 @ (v + drift**2) for row, v in zip(rows, variances, strict=True))
    shared = (rows[0] + rows[1]) * bias
    constant = np.sum(
        [row @ constant_columns(m[:3], m[3:], priors) for row, m in zip(rows, means, strict=True)],
        axis=0,
    )
    by_sensor = np.array(rows).reshape(2, 2, 3)  # dwell, sensor, axis
    walked_off = np.einsum("isa,sij,jsa->", by_sensor, walks, by_sensor)
    return _root(float(own + walked_off + shared @ shared + constant @ constant))
