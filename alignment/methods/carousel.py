"""Dynamic gyrocompassing: the instrument turns slowly, and Earth rate shows as a harmonic of it.

Across the axis of turning each gyro reads ``b + A cos(psi0 + beta)``: its bias is the constant, its
scale error lies in A, and heading is the phase against the encoder angle `beta`. Source: [S4]
dynamic gyrocompassing, methods.md section 2; the tilt of the axis and the lag are ours.
"""

from collections.abc import Sequence as Ordered
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from alignment.angles import Sequence
from alignment.arrays import Array
from alignment.constant_errors import constant_columns
from alignment.doubts import heading_doubt
from alignment.earth import EARTH_RATE, Site
from alignment.errors import AlignmentError, NotAtRest, TooShort
from alignment.estimate import AttitudeEstimate
from alignment.levelling import attitude_from_means
from alignment.methods.harmonics import (
    Harmonics,
    TurningVector,
    across_of,
    block_means,
    counting,
    harmonic_fit,
    harmonics_at,
    interval_harmonics,
    ripple_left,
    turning_vector,
)
from alignment.methods.inertial import with_places
from alignment.methods.position_fit import local_vectors
from alignment.noise import REST_BLOCK, REST_RATE, REST_TILT, gap_doubt
from alignment.options import Options, Priors
from alignment.readings import Dwell, ImuReadings
from alignment.saturation import saturation_doubt
from alignment.units import ARC_SECOND, DEG, DEG_PER_HOUR

METHOD = "carousel"

STEEPEST_AXIS = np.radians(30.0)  # tilt of the axis of turning beyond which this is no carousel
SAME_AXIS = 1e-6  # rad, and parts of rotations: stretches that belong together
PART_OF_TURN = 0.02  # a turn counts as whole from 98 % of it
UNUSED = 0.2  # part of a stretch beyond whole turns that goes unremarked
AMPLITUDE_DOUBT = 0.2  # part of the Earth's horizontal rate
_CLEAR = 10.0  # standard deviations: what goes round has a phase of its own
_POINTS = 16  # of a turn: of what is cubic in a harmonic none folds down to the first
MISALIGNMENT = 1e-3  # rad: what rate ripple is weighed with


def earth_rate_across(across: Array, up_b: Array, axis_b: Array, latitude: float) -> Array:
    """Earth rate (..., 3) in b of which a part `across` the axis is felt.

    What the vertical rate, known, does not make of it is the part across of a horizontal one. That
    is the Earth's in direction, and its size is known too: the rate along the axis (bias, scale
    error times the table's rate) does not matter.

    Notes
    -----
    ``W sin lat u + W cos lat h``, h along the level ``r - (r . u)/(a . u) a`` of ``r = across -
    W sin lat (u - (a . u) a)``. Of an axis that leans by less than the Earth's does the direction
    of `across` tells heading alone; of one that leans by more it is that of two headings.
    """
    d = np.einsum("...i,i->...", up_b, axis_b)[..., None]
    left = across - EARTH_RATE * np.sin(latitude) * (up_b - d * axis_b)
    level = left - np.einsum("...i,...i->...", left, up_b)[..., None] / d * axis_b
    h = level / np.linalg.norm(level, axis=-1, keepdims=True)
    w: Array = EARTH_RATE * (np.sin(latitude) * up_b + np.cos(latitude) * h)
    return w


@dataclass(frozen=True, slots=True, eq=False)
class CarouselFit:
    """Attitude at encoder angle 0; leading dimensions (...) are independent runs.

    `C_nb` (..., 3, 3); `covariance` (..., 3, 3) [rad^2] about n; `amplitude` (...): size of the
    horizontal harmonic over that of the Earth's; `biases` (..., 6) across the axis (of gyros with
    the table's rate times their misalignment).
    """

    C_nb: Array
    covariance: Array
    amplitude: Array
    biases: Array


def carousel_attitude(
    gyros: TurningVector,
    accels: TurningVector,
    axis_b: Array,
    latitude: float,
    priors: Priors,
) -> CarouselFit:
    """Attitude at encoder angle 0 from what turns across the axis.

    Raises
    ------
    AlignmentError
        The axis of turning is tilted by more than 30 deg.

    Notes
    -----
    Vertical: the accelerometers' harmonic across the axis, their mean along it. To first order
    the tilt `eta` of the estimate about N, E and its azimuth follow
    ``eta_D = (dp . t - eta_h . q_h) / q_D`` with t = E - (a . E)/(a . D) D in n, q = t x w_ie: for
    a vertical axis ``-dp . E / (W cos lat) + tan(lat) df_E / g``.
    """
    f_axis = accels.constant @ axis_b
    f = f_axis[..., None] * axis_b + accels.across
    gravity = np.linalg.norm(f, axis=-1)
    up = f / gravity[..., None]
    if np.any(np.abs(up @ axis_b) < np.cos(STEEPEST_AXIS)):
        tilt = np.degrees(np.arccos(np.min(np.abs(up @ axis_b))))
        raise AlignmentError(f"axis of turning is {tilt:.0f} deg off the vertical, 30 are allowed")
    w = earth_rate_across(gyros.across, up, axis_b, latitude)
    C = attitude_from_means(w.reshape(-1, 3), f.reshape(-1, 3), Sequence.YAW_PITCH_ROLL)
    C_nb = C.as_matrix().reshape(*w.shape, 3)
    expected = np.linalg.norm(w - (w @ axis_b)[..., None] * axis_b, axis=-1)
    across = np.eye(3) - np.outer(axis_b, axis_b)
    return CarouselFit(
        C_nb,
        _covariance(C_nb, gyros, accels, axis_b, latitude, priors),
        np.linalg.norm(gyros.across, axis=-1) / expected,
        np.concatenate([gyros.constant @ across, accels.constant @ across], axis=-1),
    )


def _covariance(
    C_nb: Array,
    gyros: TurningVector,
    accels: TurningVector,
    axis_b: Array,
    latitude: float,
    priors: Priors,
) -> Array:
    f_axis = accels.constant @ axis_b
    gravity = np.sqrt(f_axis**2 + np.sum(accels.across**2, axis=-1))
    axis_n = C_nb @ axis_b
    # errors of force in n: noise of the harmonic across the axis, bias along it
    along = accels.variance + priors.accel_bias**2
    outer = axis_n[..., :, None] * axis_n[..., None, :]
    F = accels.variance[..., None, None] * (np.eye(3) - outer) + along[..., None, None] * outer
    tilt = np.zeros((*gravity.shape, 3, 3))
    tilt[..., 0, 1], tilt[..., 1, 0] = -1 / gravity, 1 / gravity
    t_n = np.zeros_like(axis_n)
    t_n[..., 1], t_n[..., 2] = 1.0, -axis_n[..., 1] / axis_n[..., 2]
    t_n /= np.linalg.norm(t_n, axis=-1, keepdims=True)
    t_b = np.einsum("...ji,...j->...i", C_nb, t_n)
    w_n = EARTH_RATE * np.array([np.cos(latitude), 0.0, -np.sin(latitude)])
    q = np.cross(t_n, w_n)
    tilt[..., 2, :] = -np.einsum("...i,...ij->...j", q[..., :2], tilt[..., :2, :]) / q[..., 2:]
    P = tilt @ F @ np.swapaxes(tilt, -1, -2)
    P[..., 2, 2] += gyros.variance / q[..., 2] ** 2
    by_w, by_f = _constant_errors(gyros, accels, axis_b, priors)
    off = tilt @ C_nb @ by_f
    off[..., 2, :] += np.einsum("...i,...iq->...q", t_b, by_w) / q[..., 2:]
    # an axis that is elsewhere in b takes vertical and north along: b is turned across it
    seated = priors.seat**2 * (np.eye(3) - outer)
    placed: Array = P + off @ np.swapaxes(off, -1, -2) + seated + priors.turn**2 * np.eye(3)
    return placed


def _constant_errors(
    gyros: TurningVector, accels: TurningVector, axis_b: Array, priors: Priors
) -> tuple[Array, Array]:
    """What a unit's constants but biases add to the rate across the axis, and to the force
    (..., 3, q each), per standard deviation.

    Notes
    -----
    About an axis that leans all that is felt goes round: forces by sensors that are g-sensitive,
    turned or out of scale are harmonics of the encoder, as the Earth's rate is.
    """
    beta = 2 * np.pi * np.arange(_POINTS) / _POINTS
    back = Rotation.from_rotvec(-beta[:, None] * axis_b).as_matrix()
    felt = [
        np.einsum("mij,...j->...mi", back, v.across)
        + (v.constant @ axis_b)[..., None, None] * axis_b
        for v in (gyros, accels)
    ]
    w, f = felt
    columns = np.moveaxis(constant_columns(w, f, priors), -1, -3)  # (..., q, m, 6)
    mean, cosine, sine = (
        np.einsum("m,...qmk->...qk", wave / _POINTS, columns)
        for wave in (np.ones(_POINTS), 2 * np.cos(beta), 2 * np.sin(beta))
    )
    by_w, by_f = (
        across_of(cosine[..., part], sine[..., part], v.parts[..., None, :], axis_b)
        for v, part in ((gyros, slice(0, 3)), (accels, slice(3, 6)))
    )
    by_f = by_f + (mean[..., 3:] @ axis_b)[..., None] * axis_b
    return np.swapaxes(by_w, -1, -2), np.swapaxes(by_f, -1, -2)


# --- stretches of turning ------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class _Stretch:
    """One dwell's whole turns: rate [rad/s], what its triads found, which gyros, and doubts."""

    dwell: Dwell
    t_from: float
    t_to: float
    rate: float
    gyros: Harmonics
    accels: Harmonics
    present: tuple[bool, bool, bool]
    ripple: float
    flags: tuple[str, ...]


def whole_turns(dwell: Dwell) -> tuple[ImuReadings, Array]:
    """Readings of whole turns (m), and encoder angles (m + 1,) [rad] at their intervals' ends.

    Raises
    ------
    AlignmentError
        Nobody recorded the turning, it goes back and forth, or it is less than one turn.
    """
    if dwell.turn is None:
        raise AlignmentError(f"{dwell.label}: no encoder angles: not a turning stretch")
    if len(dwell.turn.angle) != len(dwell.readings):
        raise AlignmentError(
            f"{dwell.label}: {len(dwell.turn.angle)} encoder angles for "
            f"{len(dwell.readings)} samples"
        )
    part = dwell.window()
    first = int(np.searchsorted(dwell.readings.t, part.t[0]))
    inside = dwell.turn.angle[first : first + len(part)]
    before = dwell.turn.angle[first - 1] if first else 2 * inside[0] - inside[1]
    angle = np.concatenate([[before], inside])
    second = max(1, round(REST_BLOCK / part.interval))  # an encoder's own noise may step back
    steps = angle[second:] - angle[:-second]
    if not (np.all(steps > 0) or np.all(steps < 0)):
        raise AlignmentError(f"{dwell.label}: the table does not turn one way all the time")
    turned = np.abs(angle - angle[0])
    turns = np.floor(turned[-1] / (2 * np.pi) + PART_OF_TURN)
    if turns < 1:
        raise TooShort(
            f"{dwell.label}: too little turn: {np.degrees(turned[-1]):.0f} deg, a whole turn is "
            "needed"
        )
    last = int(np.argmin(np.abs(turned - 2 * np.pi * turns)))
    cut = replace(part, t=part.t[:last], w_ib_b=part.w_ib_b[:last], f_b=part.f_b[:last])
    return cut, angle[: last + 1]


def _stretch(dwell: Dwell) -> _Stretch:
    readings, angle = whole_turns(dwell)
    assert dwell.turn is not None
    axis = dwell.turn.axis_b / np.linalg.norm(dwell.turn.axis_b)
    X = interval_harmonics(angle) if not readings.instants else harmonics_at(angle[1:])
    h_w, h_f = harmonic_fit(X, readings.w_ib_b), harmonic_fit(X, readings.f_b)
    _check_turning(dwell.label, readings, X, axis, h_w, h_f)
    steps = np.diff(readings.t, prepend=readings.t[0] - readings.interval)
    speed = harmonic_fit(X, (np.diff(angle) / steps)[:, None])
    flags = gap_doubt(readings) + saturation_doubt(dwell.label, readings)
    used = (readings.t[-1] - readings.t[0]) / (dwell.t_to - dwell.t_from)
    if used < 1 - UNUSED:
        flags += (f"{100 * (1 - used):.0f} % of the stretch is beyond whole turns and left out",)
    return _Stretch(
        dwell,
        float(readings.t[0] - steps[0]),
        float(readings.t[-1]),
        float((angle[-1] - angle[0]) / np.sum(steps)),
        gyros=h_w,
        accels=h_f,
        present=_present(readings.w_ib_b),
        ripple=float(np.hypot(speed.cosine[0], speed.sine[0])),
        flags=flags,
    )


def _present(values: Array) -> tuple[bool, bool, bool]:
    """Which of three channels are more than zeros: an instrument may have one gyro or two."""
    x, y, z = (bool(channel.any()) for channel in values.T)
    return x, y, z


def _check_turning(
    label: str, readings: ImuReadings, X: Array, axis: Array, h_w: Harmonics, h_f: Harmonics
) -> None:
    """Raise `NotAtRest` where 1 s means leave the harmonics by more than a dwell may its mean."""
    blocks = max(2, min(round(readings.interval * len(X) / REST_BLOCK), len(X)))
    X_mean, _ = block_means(X, blocks)
    for values, h, allowed, what in (
        (readings.w_ib_b, h_w, REST_RATE, "rate"),
        (readings.f_b, h_f, REST_TILT * np.linalg.norm(h_f.constant), "force"),
    ):
        coefficients = np.stack([h.constant, h.cosine, h.sine])
        left = block_means(values, blocks)[0] - X_mean @ coefficients
        size = np.linalg.norm(left - (left @ axis)[:, None] * axis, axis=1)
        worst = int(np.argmax(size))
        if size[worst] > allowed:
            at = float(readings.t[worst * len(X) // blocks])
            raise NotAtRest(
                f"{label}: not a steady turn near {at:.1f} s: {what} leaves "
                f"its harmonic by {size[worst] / allowed:.1f} times what is allowed"
            )


# --- the estimator -------------------------------------------------------------------------------


def carousel(dwells: Ordered[Dwell], site: Site, options: Options) -> list[AttitudeEstimate]:
    """Attitude at encoder angle 0 from whole turns at constant rate, one way or both.

    Parameters
    ----------
    dwells : sequence of Dwell
        Turning, with encoder angles. Those about one axis and with one nominal attitude belong
        together.
    site : Site
        Latitude known.
    options : Options
        `rule`; `priors`: `turn` is the placement at encoder angle 0, `seat` how far the axis is
        off in b, accelerometer biases act along it, other constants by what goes round; `lag`,
        `accel_later` and `clock` shift the phase; gyro biases do not matter.

    Returns
    -------
    list of AttitudeEstimate
        One per group of dwells, under the label of the first in time.

    Raises
    ------
    AlignmentError
        Not turning, less than a whole turn, axis more than 30 deg off the vertical.
    NotAtRest, TooShort, PoleError

    Notes
    -----
    Leading errors: lag beyond the interval's mean, ``rate tau`` (cancelled by turning both ways);
    once-per-turn rate ripple times misalignment over ``W cos lat``; white noise
    ``ARW/(W cos lat sqrt(T))`` with two gyros, sqrt(2) times that with one; an axis of turning
    that is not where `axis_b` says, 1:1 in tilt. Axes that nod and speeds that ripple once per turn
    cancel over three gyros alone (see `turning_vector`); with fewer they are in no sigma.
    """
    site.horizontal_rate()
    latitude, _ = local_vectors(site)
    assert latitude is not None
    stretches = [_stretch(dwell) for dwell in sorted(dwells, key=lambda dwell: dwell.t_from)]
    return [_together(group, latitude, site, options) for group in _groups(stretches)]


def _groups(stretches: Ordered[_Stretch]) -> list[list[_Stretch]]:
    """Stretches about one axis from one nominal attitude, in order of their first."""
    groups: list[list[_Stretch]] = []
    for stretch in stretches:
        for group in groups:
            if _same(group[0].dwell, stretch.dwell):
                group.append(stretch)
                break
        else:
            groups.append([stretch])
    return groups


def _same(a: Dwell, b: Dwell) -> bool:
    assert a.turn is not None
    assert b.turn is not None
    if np.abs(a.turn.axis_b - b.turn.axis_b).max() > SAME_AXIS:
        return False
    if a.nominal is None or b.nominal is None:
        return a.nominal is b.nominal
    return float((a.nominal.inv() * b.nominal).magnitude()) < SAME_AXIS


def _alike(found: Ordered[Harmonics]) -> list[Harmonics]:
    """The same with one noise each channel: it is the instrument's, whichever way it turns.

    By the scatter of each stretch alone, a drift within one would decide how much each direction
    counts, and what cancels between the directions would not.
    """
    samples = [1 / float(h.normal[0, 0]) for h in found]
    scatter = np.average([h.scatter for h in found], axis=0, weights=samples)
    return [replace(h, scatter=scatter) for h in found]


def combined(
    vectors: Ordered[TurningVector], rates: Ordered[float], axis_b: Array, lag: float
) -> TurningVector:
    """Weighted mean of several stretches, each turned back by its rate times `lag` [s]."""
    weights = np.array([1 / v.variance for v in vectors])
    across = [
        Rotation.from_rotvec(-rate * lag * axis_b).apply(v.across)
        for v, rate in zip(vectors, rates, strict=True)
    ]
    total = float(np.sum(weights))
    constant = np.average([v.constant for v in vectors], axis=0, weights=weights)
    parts = np.average([v.parts for v in vectors], axis=0, weights=weights)
    return TurningVector(
        np.asarray(weights @ np.array(across)) / total, np.asarray(1 / total), constant, parts
    )


def lag_of(vectors: Ordered[TurningVector], rates: Ordered[float], axis_b: Array) -> Array:
    """Lag [s] and the variance that its estimation adds to the phase [rad^2], (2,).

    Least squares of ``phase_i = phase + rate_i lag``; zeros where all turn one way.
    """
    r = np.asarray(rates)
    if not _both_ways(rates):
        return np.zeros(2)
    weights = np.array([v.across @ v.across / v.variance for v in vectors])
    first = vectors[0].across
    phases = np.array(
        [np.arctan2(np.cross(first, v.across) @ axis_b, first @ v.across) for v in vectors]
    )
    mean_rate = float(np.average(r, weights=weights))
    slope_weight = float(np.sum(weights * (r - mean_rate) ** 2))
    lag = float(np.sum(weights * (r - mean_rate) * phases)) / slope_weight
    return np.array([lag, mean_rate**2 / slope_weight])


def without_lag(
    turns: Ordered[TurningVector],
    forces: Ordered[TurningVector],
    rates: Ordered[float],
    axis_b: Array,
) -> tuple[TurningVector, TurningVector]:
    """`combined` vectors of gyros and of accelerometers, less a lag whose variance is in theirs.

    Each triad by the lag that it shows itself; accelerometers to which the axis hardly leans, so
    that nothing goes round but noise, by that of the gyros.
    """
    by_gyros = lag_of(turns, rates, axis_b)
    leans = all(v.across @ v.across > _CLEAR**2 * v.variance for v in forces)
    found = []
    for vectors, (lag, added) in (
        (turns, by_gyros),
        (forces, lag_of(forces, rates, axis_b) if leans else by_gyros),
    ):
        both = combined(vectors, rates, axis_b, lag)
        more = added * float(both.across @ both.across)
        found.append(replace(both, variance=both.variance + more))
    return found[0], found[1]


def _both_ways(rates: Ordered[float]) -> bool:
    return min(rates) < 0 < max(rates)


def _together(
    group: Ordered[_Stretch], latitude: float, site: Site, options: Options
) -> AttitudeEstimate:
    first = group[0].dwell
    assert first.turn is not None
    axis = first.turn.axis_b / np.linalg.norm(first.turn.axis_b)
    rates = [s.rate for s in group]
    alike = list(zip(_alike([s.gyros for s in group]), group, strict=True))
    seen = [turning_vector(h, axis, s.present) for h, s in alike]
    left = max(ripple_left(axis, counting(h, axis, s.present)) for h, s in alike)
    felt = [turning_vector(h, axis) for h in _alike([s.accels for s in group])]
    lag, _ = lag_of(seen, rates, axis)
    priors = _with_places(options.priors, axis, max(abs(rate) for rate in rates))

    def found(seen: Ordered[TurningVector], felt: Ordered[TurningVector]) -> CarouselFit:
        gyros, accels = without_lag(seen, felt, rates, axis)
        return carousel_attitude(gyros, accels, axis, latitude, priors)

    try:
        fit = found(seen, felt)
    except AlignmentError as error:
        raise type(error)(f"{first.label}: {error}") from error
    for by_gyros, by_accels in _late(group, priors):
        turned = found(_turned(seen, by_gyros, axis), _turned(felt, by_accels, axis))
        off = Rotation.from_matrix(turned.C_nb @ fit.C_nb.T).as_rotvec()
        fit = replace(fit, covariance=fit.covariance + np.outer(off, off))
    C_nb = Rotation.from_matrix(fit.C_nb)
    return AttitudeEstimate(
        METHOD,
        first.label,
        min(s.t_from for s in group),
        max(s.t_to for s in group),
        C_nb=site.plumb * C_nb,
        sequence=options.rule.sequence_at(C_nb if first.nominal is None else first.nominal),
        covariance=site.about_n(fit.covariance),
        flags=tuple(dict.fromkeys(flag for s in group for flag in s.flags))
        + heading_doubt(fit.covariance)
        + _doubts(fit, group, lag, left, site.horizontal_rate()),
    )


def _with_places(priors: Priors, axis_b: Array, rate: float) -> Priors:
    """The priors, with what a turn at `rate` [rad/s] makes of accelerometers' places along its
    axis a for a bias: of each ``w^2 r`` by ``a_i^2 (1 - a_i^2)`` of the square, none of the triad's
    own axes."""
    part = np.sqrt(np.sum(axis_b**2 * (1 - axis_b**2)))
    return with_places(replace(priors, places=float(part) * priors.places), rate**2)


def _late(group: Ordered[_Stretch], priors: Priors) -> Ordered[tuple[Array, Array]]:
    """Angles (s,) by which the table turns on before gyros, and before accelerometers, tell of it:
    by what comes late, and by a clock that runs fast."""
    rates = np.array([s.rate for s in group])
    fast = rates * [priors.clock * (s.t_from + s.t_to) / 2 for s in group]
    late = priors.lag * rates, (priors.lag + priors.accel_later) * rates
    return [both for both in (late, (fast, fast)) if np.any(both)]


def _turned(
    vectors: Ordered[TurningVector], angles: Array, axis_b: Array
) -> Ordered[TurningVector]:
    """The vectors as they are told by encoders that are ahead by some angles (s,)."""
    return [
        replace(v, across=Rotation.from_rotvec(angle * axis_b).apply(v.across))
        for v, angle in zip(vectors, angles, strict=True)
    ]


def _doubts(
    fit: CarouselFit, group: Ordered[_Stretch], lag: float, left: float, horizontal: float
) -> tuple[str, ...]:
    rate = max(abs(s.rate) for s in group)
    if not _both_ways([s.rate for s in group]):
        flags = (
            f"one direction only: a lag of 1 ms would shift heading by {rate * 1e-3 / DEG:.2g} deg",
        )
    else:
        flags = (f"lag of {1e3 * lag:.3g} ms beyond the interval's mean removed",)
    if abs(fit.amplitude - 1) > AMPLITUDE_DOUBT:
        flags += (f"horizontal harmonic is {float(fit.amplitude):.2f} of the Earth's",)
    ripple = max(s.ripple for s in group)
    shift = MISALIGNMENT * ripple / horizontal
    if shift > np.sqrt(fit.covariance[2, 2]):
        flags += (
            f"rate ripple of {ripple / DEG_PER_HOUR:.3g} deg/h once per turn: heading "
            f"{shift / DEG:.2g} deg per mrad of misalignment",
        )
    nods = left * rate * ARC_SECOND / horizontal
    if nods > np.sqrt(fit.covariance[2, 2]):
        flags += (
            "not all gyros count: an axis or encoder that errs once per turn does not cancel, "
            f"heading {nods / DEG:.2g} deg per arc second of it",
        )
    return flags
