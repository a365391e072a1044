"""Fine alignment: a Kalman filter of attitude, velocity and the sensors' constants.

It runs on the errors of a reference that the gyros carry, in n as it stands at the end, held in
inertial space: there attitude errors stand still and gravity's turn is known in closed form, so
the matrices of all intervals come vectorised and only the updates are a loop. The instrument's
place is that of its lever arm about a point that stays: the zero-displacement update.

The reference comes from the inertial-frame match of the same readings, but only as the point of
linearisation: the filter starts with an attitude error of `START` and learns everything from the
updates, so that nothing is used twice. Source: methods.md section 3; P. D. Groves, Principles of
GNSS, Inertial, and Multisensor Integrated Navigation Systems (2013), 14.2, 15.2.
"""

from collections.abc import Callable
from collections.abc import Sequence as Ordered
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from alignment.around import (
    by_direction,
    by_size,
    less_turned,
    whole_circle,
    with_level_rate,
)
from alignment.arrays import Array, set_owned
from alignment.constant_errors import BY_AXIS, in_one_attitude, with_products
from alignment.cross import cross_matrix
from alignment.doubts import heading_doubt
from alignment.earth import Site
from alignment.errors import AlignmentError
from alignment.estimate import AttitudeEstimate, AttitudeTrack
from alignment.information.drift import GaussMarkov, at_the_start
from alignment.methods.drifting import held
from alignment.methods.inertial import (
    Match,
    Noise,
    Rest,
    ahead_by_clock,
    attitude_weights,
    changed_since,
    checked_readings,
    covariances,
    drive,
    functional_covariance,
    gravity_doubt,
    gravity_velocity,
    lag_covariance,
    laid,
    largest_angle,
    left_of_the_turn,
    lever_of,
    rest_covariance,
    rest_of,
    sampling_covariance,
    sensitivity,
    squared_rate,
    sway_covariance,
    told_at,
    turns,
    untold_covariance,
    wander_doubt,
    with_clock,
    with_places,
)
from alignment.methods.updates import (
    BLOCK,
    ERRORS,
    Pass,
    Steps,
    by_blocks,
    careful_updates,
    one_by_one,
)
from alignment.nominal import TRACK_STEP
from alignment.options import Options, Priors
from alignment.readings import Dwell, ImuReadings
from alignment.rounding import with_rounding
from alignment.saturation import saturation_doubt
from alignment.strapdown import Carried, Made, carry, matrices

METHOD = "fine"
UPDATE = 0.1  # s between zero-displacement updates
_MOST_UPDATES = 2**16  # they are further apart in a record beyond 1.8 h: bounds memory and time
STILL = 1e-6  # m: least noise of an update
START = np.repeat([0.3, 10.0, 1.0, 1.0], [2, 1, 3, 3])  # rad N, E; D; m/s; m: as good as unknown
_GRAVITY = 0.01  # part by which gravity's size is free where no accelerometer constant has a prior
_SETTLED = 0.01  # rad: a correction of the reference above it calls for another pass
_PASSES = 16
_COARSE = 5.0  # times as far apart in passes that only look for the reference
_ROUNDS = 3  # of them and the filter itself, after the first
_PARTS = (0.25, 4.0)  # least and most of a correction of heading that is taken
_CAREFUL = 32  # updates by roots of the covariance: the first take a metre to a micrometre
_CHUNK = 2048  # updates whose matrices are held at once
_HUNDREDTH = 100.0  # a noisy regressor is to tell no more than one of this of a prior's variance
_HIDDEN = 0.1  # rad of the match's heading: below, no second heading can fit
_ANY_SIZE = 10.0  # of the Earth's level rate, in parts of it: as good as unknown
_SHOWN = 0.5  # rad: a track begins when heading is known to this

_SUMS = {"gyro": "dtheta", "accel": "dv"}  # what errors of scale and axes multiply
_SIZE, _NORTH, _FOREVER = "size", np.diag([1.0, 0.0, 0.0]), 1e12  # s
_PULLS = "X pulls", "Y pulls", "Z pulls"  # gyros, each by a coefficient of its own
_SLOPE = "slope"  # of scale errors of gyros, about the middle of the record
_OF_SIZE = -3  # of the state: north's, of the last three
_ASTRAY = tuple(f"{s}_{e}" for s in _SUMS for e in ("misalignment", "non_orthogonality"))
CONSTANTS = ("gyro_bias", "accel_bias", "gyro_scale", "accel_scale", *_ASTRAY, "lever_arm")
_ORDERS: dict[str, Callable[[Array], Array]] = {
    "accel_asymmetry": np.abs,
    "accel_quadratic": np.square,
    "accel_cubic": lambda f: f**3,
}
_STEADY = 0.01  # of the whole force: what varies by less is no slope's
_ROUND = 1.0  # rad: what turns by more goes round


@dataclass(frozen=True, slots=True, eq=False)
class Innovations:
    """What each update found beyond what the filter expected.

    `t` (m,) [s]; `values` and `sigmas` (m, 3) [m]: displacement toward N, E, D of the end.
    """

    t: Array
    values: Array
    sigmas: Array

    def __post_init__(self) -> None:
        m = len(self.t)
        set_owned(
            self,
            t=(self.t, (m,), float),
            values=(self.values, (m, 3), float),
            sigmas=(self.sigmas, (m, 3), float),
        )


@dataclass(frozen=True, slots=True, eq=False)
class Filtered:
    """The filter's answers after each update.

    Attributes
    ----------
    t : (m,) s
    C_nb : m rotations
    covariance : (m, 3, 3) rad^2
        About n.
    names : tuple of str
        Which of `CONSTANTS` were estimated: those with a prior.
    constants, sigmas : (m, k, 3)
        Their values in b and standard deviations, SI.
    innovations : Innovations
    lever : (2,)
        Tilts N, E at the end by which heading is held off, in parts of that.
    flags : tuple of str
    """

    t: Array
    C_nb: Rotation
    covariance: Array
    names: tuple[str, ...]
    constants: Array
    sigmas: Array
    innovations: Innovations
    lever: Array
    flags: tuple[str, ...]

    def __post_init__(self) -> None:
        m, k = len(self.t), len(self.names)
        set_owned(
            self,
            t=(self.t, (m,), float),
            covariance=(self.covariance, (m, 3, 3), float),
            constants=(self.constants, (m, k, 3), float),
            sigmas=(self.sigmas, (m, k, 3), float),
            lever=(self.lever, (2,), float),
        )


@dataclass(frozen=True, slots=True, eq=False)
class Model:
    """What does not change from pass to pass.

    `names`: the constants that are states, whose walks are `walks` (k,) [per root second];
    `drifts`: the processes that are, after them, each of a sensor, along three axes; `_PULLS` are
    what a force along one axis adds to gyros, `_SLOPE` what changes in their scale, and `_SIZE`,
    the last, is what the Earth's level rate is found to be larger by. `whole`: what every update
    found is told, else of the last alone.
    """

    readings: ImuReadings
    site: Site
    noise: Noise
    priors: Priors
    names: tuple[str, ...]
    walks: tuple[float, ...]
    drifts: tuple[tuple[str, GaussMarkov], ...]
    whole: bool = True

    @property
    def update(self) -> float:
        """Seconds between updates."""
        return update_of(self.readings)

    @property
    def size(self) -> int:
        """Of the state."""
        return ERRORS + 3 * (len(self.names) + len(self.drifts))

    def kept(self, span: float) -> Array:
        """What `span` seconds leave of each constant and drift (c,)."""
        fading = [np.exp(-span / process.time) for _, process in self.drifts]
        return np.repeat([*np.ones(len(self.names)), *fading], 3)

    def added(self, spans: Array) -> Array:
        """Variances (k, c) that each constant and drift gains in `spans` (k, 1) [s]."""
        walked = spans * np.square(self.walks)
        drifted = [-np.expm1(-2 * spans / p.time) * p.sigma**2 for _, p in self.drifts]
        return np.repeat(np.concatenate([walked, *drifted], axis=1), 3, axis=1)

    @property
    def start(self) -> Array:
        """Variances before the first update (s,)."""
        told = self.priors.accel_bias > 0 or self.priors.accel_scale > 0
        sigmas = [getattr(self.priors, name) for name in self.names]
        sigmas += [process.sigma for _, process in self.drifts]
        gravity = [0.0 if told else _GRAVITY]
        return np.concatenate([START, gravity, np.repeat(sigmas, 3)]) ** 2


@dataclass(frozen=True, slots=True, eq=False)
class _Reference:
    """What the filter runs on the errors of: sensors rid of the constants `found` (k, 3), those of
    the model, but for a lever arm, carried; and where i stands.

    Of quick turns errors of scale and axes make angles whose squares, times gravity, are felt, and
    one error of the axes times another passes for knowledge of both.
    """

    carried: Carried
    C_ni: Rotation
    found: Array


def fine(dwells: Ordered[Dwell], site: Site, options: Options) -> list[AttitudeEstimate]:
    """Attitude at the end of each stretch, on a base that rocks, turns or rests.

    Parameters
    ----------
    dwells : sequence of Dwell
        Any motion about a point that stays; the attitude is that at the last sample. Turns
        (two-position, carousel) tell biases from Earth rate; no encoder is needed.
    site : Site
        ``latitude`` needed, not at a pole.
    options : Options
        `priors`: ``gyro_walk`` and ``accel_walk`` (0: from the readings); biases, scale factor
        errors and ``lever_arm`` become states where their prior is above 0, of a stretch that turns
        or rocks misalignment and non-orthogonality too. Where neither
        accelerometer constant has one, gravity's size is free within 1 %: an unstated bias along
        the vertical would else pass for sway. Where gyro biases have none, the size of the Earth's
        level rate is free: one along north would else tilt the answer, and turn it where the gyros'
        noises differ.

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
        A gap; a turn too fast for the sampling rate; a linearisation that does not settle.
    TooShort, PoleError

    Notes
    -----
    Leading errors: heading ``ARW/(W cos lat sqrt T)``, and ``b_E/(W cos lat)`` until a turn tells
    the bias; tilt b/g; lag, an accelerometer's drift and what samples leave out of a motion as for
    `inertial`; of accelerometers later than gyros as the filter has it. First order about the
    reference, which is corrected while the correction exceeds 0.01 rad, by passes of five updates
    in one. A heading whose sigma is above 30 deg need not settle: tilt does about any; but where a
    table turns, errors of scale turn with it, and it must. Updates are 0.1 s apart, in a record
    beyond 1.8 h as far as makes 65 536 of them. Where the innovations contradict their sigmas the
    noise of the updates is raised to all of the displacement that is not drift, and that is
    flagged.
    """
    return [_fine(dwell, site, options) for dwell in dwells]


def fine_tracks(dwell: Dwell, site: Site, options: Options) -> list[AttitudeTrack]:
    """The filter's attitude every half second, from when heading is known to half a radian."""
    run = filtered(dwell, site, options)
    steps = np.floor((run.t - run.t[0]) / TRACK_STEP + 1e-9)
    shown = np.append(False, steps[1:] > steps[:-1])  # the first update of each step
    shown &= run.covariance[:, 2, 2] < _SHOWN**2
    shown[-1] = True
    C_nb = Rotation.from_quat(run.C_nb.as_quat()[shown])
    sequence = options.rule.sequence_at(C_nb[-1])
    return [AttitudeTrack(METHOD, dwell.label, run.t[shown], C_nb, sequence, run.covariance[shown])]


def innovations(dwell: Dwell, site: Site, options: Options) -> Innovations:
    """What each update of the filter found beyond expectation."""
    return filtered(dwell, site, options).innovations


def filtered(dwell: Dwell, site: Site, options: Options, whole: bool = True) -> Filtered:
    """The filter over one stretch, `whole` or its end; parameters and errors as for `fine`."""
    site.horizontal_rate()
    readings = checked_readings(dwell)
    carried = carry(readings, update_of(readings))
    priors = states_of(with_rounding(options.priors, readings), carried, site)
    matched, noise, arm = laid(readings, carried, site, priors)
    coarse, wander = covariances(carried, matched, noise, priors, arm, site)
    rest = rest_of(dwell, readings, priors, (carried, matched, noise), site)
    flags = saturation_doubt(dwell.label, readings) + gravity_doubt(carried, site)
    flags += rest.doubts(dwell)
    flags += wander_doubt(dwell.label, carried, matched, wander)
    found = at_the_start(priors, dwell.t_from, readings.interval * len(readings))
    model = replace(model_of(readings, site, noise, found), whole=False)
    reference = _Reference(carried, matched.C_ni, np.zeros((len(model.names), 3)))
    # as much information a second, however far apart the updates are
    variance = _update_variance(carried, noise, priors) * (UPDATE / model.update)
    far = float(np.trace(coarse)) > (_SETTLED / 2) ** 2
    reference, run = _settle(model, reference, variance, far)
    if run.inconsistent:
        variance += float(np.trace(sway_covariance(carried, matched))) / 3
        reference, run = _settle(model, reference, variance, far=False)
        flags += (f"sway beyond noise and lever arm: updates taken at {variance**0.5:.2g} m",)
    if not np.all(run.expected > 0):
        raise AlignmentError(
            f"{dwell.label}: rounding leaves no covariance: priors and noise are too far apart for "
            "this filter in so long a stretch"
        )
    astray = dwell.turn is not None and abs(run.x[-1, 2]) >= _SETTLED
    if astray or not _is_settled(model, reference, run):
        raise AlignmentError(
            f"{dwell.label}: the linearisation did not settle: heading is not determined, and a "
            "filter about a wrong one knows no tilt either"
        )
    if whole:
        run = _filter(replace(model, whole=True), reference, variance).ending(run)
    if turns(carried) and coarse[2, 2] > _HIDDEN**2:
        run = _round(run, _by_size(model, reference, run, variance))
    added = rest_covariance(carried, matched, rest) + _in_the_mean(rest, carried, matched, site)
    added = added + _beside_white(noise, carried, matched)
    as_found = replace(matched, C_ni=reference.C_ni)  # whose axes it turns about
    at_end = as_found.C_ni * Rotation.from_quat(carried.q[-1])
    added = added + untold_covariance(readings, at_end)
    added = added + sampling_covariance(readings, (carried, matched, noise), priors, site)
    felt = _felt_later(model, reference, run, variance) if priors.accel_later else np.zeros(3)
    late = lag_covariance(carried, as_found, priors, site, felt)
    if options.priors.clock:
        ahead = ahead_by_clock(reference.carried, as_found, options.priors, site)
        heading = float(np.sqrt(run.attitude[-1, 2, 2]))
        late += with_clock(ahead, _clocked(model, run, options.priors.clock), heading)
    more = added, left_of_the_turn(carried, matched, priors), late
    lever = _held_off(carried, as_found, run.attitude[-1], site)
    return _answer(model, reference, run, more, lever, flags)


def _felt_later(model: Model, reference: _Reference, run: Pass, variance: float) -> Array:
    """Turn (3,) about n by accelerometers that come later than gyros: the filter's answer to
    forces as they are less that to those that are felt, the `run`'s."""
    as_it_is = replace(reference, carried=_later_by(reference.carried, model.priors, 1.0))
    return np.asarray(run.x[-1, :3] - _filter(model, as_it_is, variance).x[-1, :3])


def _later_by(carried: Carried, priors: Priors, part: float) -> Carried:
    """The record of forces a `part` of accelerometers' lag behind gyros later; -1: as they come."""
    changed = part * changed_since(carried, priors)
    dv = (carried.turned @ changed[:, :, None])[:, :, 0]
    p = (np.cumsum(dv, axis=0) - dv / 2) * carried.spans[:, None]
    return replace(carried, p=carried.p + p)


def sway_by_lag(model: Model, carried: Carried, variance: float) -> float:
    """What the filter adds to the noise of its updates [m^2] where forces that come later than the
    rates, of a record that is `carried` by perfect sensors, pass for sway."""
    if not model.priors.accel_later:
        return 0.0
    late = _later_by(carried, model.priors, -1.0)
    matched, _, _ = laid(model.readings, late, model.site, model.priors)
    reference = _Reference(late, matched.C_ni, np.zeros((len(model.names), 3)))
    run = _filter(replace(model, whole=False), reference, variance)
    if not replace(run, misfit=run.misfit + 3).inconsistent:  # with noise, which makes 3 of it
        return 0.0
    return float(np.trace(sway_covariance(late, matched))) / 3


def _held_off(carried: Carried, matched: Match, attitude: Array, site: Site) -> Array:
    """Tilts N, E (2,) per radian by which heading is held off.

    As of a match: what leans the plumb line goes round with heading, and the horizontal Earth rate
    does over half of the record. But here a bias of the gyros may stand for that, the more the
    less tilt E follows heading in the `attitude` (3, 3) of the filter.
    """
    leans = site.f_n[:2] / site.f_n[2]
    level = lever_of(carried.spans, matched) - leans
    shown = attitude[1, 2] / attitude[2, 2] - leans[1]
    return np.asarray(leans + np.clip(shown / level[1], 0.0, 1.0) * level)


def _by_size(model: Model, reference: _Reference, run: Pass, variance: float) -> float:
    """Heading's root mean square error [rad] on the whole circle, of a stretch that turns.

    The filter knows heading by the Earth's level rate near one direction. A scale factor error of
    a steady turn, or a bias along its axis, may be as large as that rate and hide its part along a
    level axis: the part across is the same of a heading on the axis' other side. So one more coarse
    pass takes the rate's size for unknown, and both parts are laid on the circle that it is on.
    """
    rate = model.site.horizontal_rate()
    apart = _COARSE * model.update
    coarse = _about(model, _at_end(reference), reference, apart)
    free = _filter(of_any_size(model), coarse, variance * model.update / apart)
    x = free.x[-1]
    errors = of_the_rate(free.heading, free.variances[-1], model.site)
    return by_size(np.array([1 + x[_OF_SIZE] / rate, x[2]]), errors, float(run.x[-1, 2]))


def of_any_size(model: Model) -> Model:
    """The model with the size of the Earth's level rate unknown."""
    if any(sensor == _SIZE for sensor, _ in model.drifts):
        return model
    return replace(model, drifts=(*model.drifts, _any_size(model.site)))


def of_the_rate(heading: Array, variances: Array, site: Site) -> Array:
    """Covariance (2, 2) of the Earth's level rate along and across itself, in parts of it.

    By a filter of `of_any_size`: covariances (s,) of heading's error with all, variances (s,).
    """
    rate = site.horizontal_rate()
    both = heading[_OF_SIZE] / rate
    return np.array([[variances[_OF_SIZE] / rate**2, both], [both, heading[2]]])


def _round(run: Pass, heading: float) -> Pass:
    """The pass with heading's sigma grown to `heading` [rad], if it is less, and what goes with
    it: of tilt as much as the filter holds to turn with heading."""
    own = run.attitude[:, :, 2]
    part = own / own[:, 2:]
    more = np.maximum(heading**2 - own[:, 2], 0.0)[:, None, None]
    return replace(run, attitude=run.attitude + more * part[:, :, None] * part[:, None, :])


def _in_the_mean(rest: Rest, carried: Carried, matched: Match, site: Site) -> Array:
    """Heading's variance (3, 3) by what lies apart in a record at rest, of which a filter whose
    gyros' noise limits it holds what the mean does: the match knows little of either end."""
    _, east, _ = matched.C_ni.as_matrix() @ matrices(carried.q[-1:])[0]
    t_from, t_to = float(carried.t[0]), float(carried.t[-1])
    rates = [one.share(t_from, t_to) * one.off[:3] * east for one in rest.apart]
    return np.diag([0.0, 0.0, float(np.sum(np.square(rates))) / site.horizontal_rate() ** 2])


def _beside_white(noise: Noise, carried: Carried, matched: Match) -> Array:
    """Covariance (3, 3) by what is no white noise of sensors whose sheets do not tell it, as the
    match has it: rounded increments, and flicker. Of gyros' flicker it is heading's alone: they
    carry tilt through the match, but the filter has it from the accelerometers."""
    covariance, none, C_ni = np.zeros((3, 3)), np.zeros(3), matched.C_ni.as_matrix()
    if not (noise.ends.any() or noise.plateaus.any()):
        return covariance
    gyro, accel = sensitivity(attitude_weights(carried, matched), C_ni, carried)
    gyro = gyro + np.eye(3)
    slow = noise.plateaus * [0.0, 1.0]
    for part, own in (
        (np.ones(3), Noise(none, none, ends=noise.ends, plateaus=slow)),
        (np.array([0.0, 0.0, 1.0]), Noise(none, none, plateaus=noise.plateaus - slow)),
    ):
        P = functional_covariance(gyro, accel, C_ni, carried, own, Priors())
        covariance += P * np.outer(part, part)
    return covariance


def model_of(readings: ImuReadings, site: Site, noise: Noise, priors: Priors) -> Model:
    """What the filter holds of these noises and priors."""
    span = readings.interval * len(readings)
    gyro, accel = (
        held(priors, sensor, float(np.sqrt(np.mean(level**2))), span)
        for sensor, level in (("gyro", noise.gyro), ("accel", noise.accel))
    )
    names = tuple(name for name in CONSTANTS if getattr(priors, name) > 0)
    pulled = GaussMarkov(priors.gyro_g_sensitivity, _FOREVER)
    pulls = tuple((axis, pulled) for axis in _PULLS) * (pulled.sigma > 0)
    free = (_any_size(site),) * (priors.gyro_bias == 0)
    slope = GaussMarkov(priors.gyro_scale_ramp, _FOREVER)
    slopes = ((_SLOPE, slope),) * (slope.sigma > 0)
    walks = {"gyro_bias": gyro.walk, "accel_bias": accel.walk}
    return Model(
        readings=readings,
        site=site,
        noise=replace(
            noise,
            gyro=np.hypot(noise.gyro, gyro.white),
            accel=np.hypot(noise.accel, accel.white),
        ),
        priors=replace(priors, gyro_bias=gyro.bias, accel_bias=accel.bias),
        names=names,
        walks=tuple(walks.get(name, 0.0) for name in names),
        drifts=(
            *(("gyro", p) for p in gyro.states),
            *(("accel", p) for p in accel.states),
            *pulls,
            *slopes,
            *free,
        ),
    )


def _any_size(site: Site) -> tuple[str, GaussMarkov]:
    """As good as no knowledge of how large the Earth's level rate is."""
    return _SIZE, GaussMarkov(_ANY_SIZE * site.horizontal_rate(), _FOREVER)


def states_of(priors: Priors, carried: Carried, site: Site) -> Priors:
    """The priors, with what passes for a bias taken for one.

    Of a stretch that turns or rocks, axes that are off are no bias, and remain errors of their own.
    Rocking tells how the triads lie to one another, and how gravity's share changes in b; but not a
    case that is turned as a whole, which is tilted in full. Of second order, by `with_products`,
    axes lean together: of coarse sensors' errors the record would else tell by their products. An
    asymmetry makes a constant of what goes to and fro, ``a (mean |x| - |mean x|)``; of what goes
    round it is a scale error, as a cubic term of gyros is of both. What gravity adds to g-sensitive
    gyros is a bias but where gravity goes round in b: there a part of it stands still in n, as the
    Earth's rate does; of its square ``2 F`` times what goes round beside a steady F. Accelerometers
    at places of their own are pulled outward, each by as much as long as the turn goes on.
    """
    if not turns(carried):
        return in_one_attitude(replace(priors, gyro_scale_ramp=0.0), site.gravity)
    priors = with_places(priors, squared_rate(carried))
    astray = with_products(priors)
    own = {name: getattr(astray, name) for name in _ASTRAY}
    for sensor in _SUMS:  # and a turn has its square
        lean, turned = f"{sensor}_non_orthogonality", own[f"{sensor}_misalignment"]
        own[lean] = float(np.hypot(own[lean], turned**2))
    rocks, spans = largest_angle(carried) < _ROUND, carried.spans[:, None]
    if not rocks:
        steady = float(np.abs(carried.dv.sum(axis=0)).max() / spans.sum())
        own["gyro_g_sensitivity"] = float(
            np.hypot(priors.gyro_g_sensitivity, 2 * steady * priors.gyro_g2_sensitivity)
        )
        priors = _with_lines_of_orders(priors, carried.dv / spans)
    folded = in_one_attitude(replace(priors, **dict.fromkeys(own, 0.0)), site.gravity)
    if priors.gyro_cubic:
        own["gyro_scale"] = float(np.hypot(folded.gyro_scale, _scale_of_cubic(priors, carried)))
    for sensor, sums in _SUMS.items() if rocks else ():
        size = getattr(priors, f"{sensor}_asymmetry")
        if not size:
            continue
        means = getattr(carried, sums) / spans
        rectified = size * float(np.max(np.abs(means).mean(axis=0) - np.abs(means.mean(axis=0))))
        bias = float(np.hypot(getattr(folded, f"{sensor}_bias"), rectified))
        own[f"{sensor}_bias"] = bias
    if priors.clock:  # of one scale for all axes: what it is at the end, `filtered` adds
        own["gyro_scale"] = float(np.hypot(own.get("gyro_scale", folded.gyro_scale), priors.clock))
    return replace(folded, **own, clock=0.0)


def _with_lines_of_orders(priors: Priors, f: Array) -> Priors:
    """The priors, with accelerometers' asymmetry and higher orders taken for the bias and the scale
    error that they are most like where forces (m, 3) change, of the axis that has most of each.

    Least squares of ``f^2`` by ``a + s f``, and of the others: of a force that goes round by r
    beside a steady F it is ``s = 2 F`` and ``a = r^2/2 - F^2``, no part of which is the scale's.
    What is steady but for noise is a bias alone.
    """
    off = f - f.mean(axis=0)
    varied = np.sum(off**2, axis=0)
    varied[varied < _STEADY**2 * np.sum(f**2)] = np.inf
    found = np.array([priors.accel_bias, priors.accel_scale])
    for name, power in _ORDERS.items():
        if not (size := getattr(priors, name)):
            continue
        y = power(f)
        slope = np.sum(off * y, axis=0) / varied
        line = y.mean(axis=0) - slope * f.mean(axis=0), slope
        found = np.hypot(found, size * np.abs(line).max(axis=1))
    bias, scale = map(float, found)
    return replace(priors, **dict.fromkeys(_ORDERS, 0.0), accel_bias=bias, accel_scale=scale)


def _scale_of_cubic(priors: Priors, carried: Carried) -> float:
    """The scale error that a cubic term of gyros is most like, of the axis that feels most.

    Least squares of ``c x^3`` by ``s x``: ``c (sum x^4)/(sum x^2)``, of a steady turn ``c x^2``.
    """
    squares = (carried.dtheta / carried.spans[:, None]) ** 2
    most = np.argmax(squares.sum(axis=0))
    return float(priors.gyro_cubic * np.sum(squares[:, most] ** 2) / np.sum(squares[:, most]))


def update_of(readings: ImuReadings) -> float:
    """Seconds between updates: a tenth, and more in a record beyond 1.8 h."""
    return max(UPDATE, readings.interval * len(readings) / _MOST_UPDATES)


def _fine(dwell: Dwell, site: Site, options: Options) -> AttitudeEstimate:
    run = filtered(dwell, site, options, whole=False)
    C_nb, covariance = told_at(dwell, run.C_nb[-1]), run.covariance[-1]
    # what is across the horizontal Earth rate, heading, is along it too: as much of it
    both = np.zeros((4, 4))
    both[:3, :3], both[3, 3] = covariance, covariance[2, 2]
    heading = by_direction(covariance[2, 2] * np.eye(2))
    covariance = with_level_rate(covariance, both, run.lever)
    covariance = whole_circle(covariance, heading)
    return AttitudeEstimate(
        METHOD,
        dwell.label,
        dwell.t_from,
        float(run.t[-1]),
        C_nb,
        options.rule.sequence_at(C_nb),
        covariance=covariance,
        flags=run.flags + heading_doubt(covariance),
    )


def _update_variance(carried: Carried, noise: Noise, priors: Priors) -> float:
    """Of a zero-displacement update [m^2].

    The lever arm multiplies the attitude that noisy gyros carried. That noise is no motion: it
    would pull the arm to zero, as errors of a regressor do (by four sigmas, and tilt with it, in
    a test at 20 Hz). So the updates are taken coarse enough for all of that walk to say a
    hundred times less of the arm than its prior, which costs heading nothing.
    """
    walk = float(np.mean(noise.gyro**2)) * float(carried.t[-1] - carried.t[0])
    return STILL**2 + _HUNDREDTH * priors.lever_arm**2 * walk


def _heave_density(carried: Carried, noise: Noise, priors: Priors, gravity: float) -> float:
    """Of white noise along the vertical [m^2/s^3]: what the gyros' own walk makes of gravity there.

    A reference that walked off by d is level no more: of an accelerometer's bias b it carries
    ``d b`` into the vertical, of gravity ``g d^2/2``. The first passes for a turn that would tell
    b from a tilt, for no noise of first order covers it there; the second, which a first order
    does not have, is then taken for b. After a time T d has a variance of
    ``s^2 = ARW^2 T + B^2 T^2`` and before it less, ``T s^2/2`` in all: this noise leaves b a
    hundredth of its prior's information, and is no smaller than ``g d^2/2`` (``E d^4 = 8 s^4`` of
    two axes). Heading and tilt stand in the horizontal; of the bias along the vertical all but
    7 s parts are still found. None is needed where the base leans by ten times s: there the walk
    is a hundredth of the turn that does tell the bias.
    """
    span = float(carried.t[-1] - carried.t[0])
    walked = float(np.mean(noise.gyro**2)) * span + (priors.gyro_instability * span) ** 2
    force = carried.dv / carried.spans[:, None]
    leaned = float(force.var(axis=0).sum()) / 2 / gravity**2
    if leaned > _HUNDREDTH * walked:
        return 0.0
    bias = priors.accel_bias**2 + (gravity * priors.accel_scale) ** 2
    return span * walked * (_HUNDREDTH / 2 * bias + 2 / 3 * gravity**2 * walked)


def _settle(
    model: Model, reference: _Reference, variance: float, far: bool
) -> tuple[_Reference, Pass]:
    """Filter, and again about a corrected reference until the correction is small.

    Where it is not, or is not likely to be (`far`), coarse passes correct the reference first:
    that only moves the point of linearisation. Once is enough: they settle about an answer of
    their own, which may be as far from the filter's as a correction may be.
    """
    found, looked = True, far
    if far:
        reference, found = _found(model, reference, variance)
    run, aim = _filter(model, reference, variance), _Aim()
    for _ in range(_ROUNDS):
        if not found or _is_settled(model, reference, run):
            break
        reference = _corrected(model, reference, run, model.update, aim)
        if not looked:
            reference, found = _found(model, reference, variance)
            looked = True
        run = _filter(model, reference, variance)
    return reference, run


def _found(model: Model, reference: _Reference, variance: float) -> tuple[_Reference, bool]:
    """The reference that passes of fewer updates settle about, and whether they do."""
    apart = _COARSE * model.update
    coarse, aim = _about(model, _at_end(reference), reference, apart), _Aim()
    for _ in range(_PASSES):
        run = _filter(model, coarse, variance * model.update / apart)
        if _is_settled(model, coarse, run):
            return _corrected(model, coarse, run, model.update, aim), True
        coarse = _corrected(model, coarse, run, apart, aim)
    return _about(model, _at_end(coarse), coarse, model.update), False


def _is_settled(model: Model, reference: _Reference, run: Pass) -> bool:
    """Whether what is left to correct is small."""
    span = reference.carried.t[-1] - reference.carried.t[0]
    turned = span * np.linalg.norm(_constant(model, run.left, "gyro_bias"))
    return float(max(np.linalg.norm(run.left[:3]), turned)) < _SETTLED


def _constant(model: Model, x: Array, name: str) -> Array:
    """The part of a state (s,) that holds the constant; zeros where it has no prior."""
    if name not in model.names:
        return np.zeros(3)
    return x[columns_of(model.names.index(name))]


def _states_of_scale(model: Model) -> slice:
    """Where the gyros' scale errors stand in the state; nowhere if they are none of it."""
    if "gyro_scale" not in model.names:
        return slice(0)
    return columns_of(model.names.index("gyro_scale"))


def _clocked(model: Model, run: Pass, clock: float) -> Array:
    """Of the attitude's errors (m, 3) what one sigma of a clock that runs fast makes of them.

    It is a scale error, one for all gyros, and as much of what the states of scale errors make as
    it is of their prior.
    """
    if not clock or "gyro_scale" not in model.names:
        return np.zeros(3)
    return np.asarray(-clock / model.priors.gyro_scale**2 * run.scaled)


def columns_of(k: int) -> slice:
    """Where the k-th constant stands in the state."""
    return slice(ERRORS + 3 * k, ERRORS + 3 * k + 3)


class _Aim:
    """How much of heading's corrections is taken, by what the last one left.

    Tilt and biases are right after a pass. Heading, where the record hardly tells it, goes on by a
    part r of each correction, for the readings that were used turn with it; so far as -0.7 or 0.7
    of it, there and back. What is taken then is what it comes to in the end, ``1/(1 - r)`` of it:
    the secant's step (A. C. Aitken, Proc. R. Soc. Edinburgh 46 (1926) 289).
    """

    def __init__(self) -> None:
        self._part, self._before = 1.0, 0.0

    def part(self, heading: float) -> float:
        """Of a correction of heading [rad] that a pass found."""
        if self._before:
            slope = (1 - heading / self._before) / self._part
            self._part = float(np.clip(1 / slope, *_PARTS)) if slope > 0 else 1.0
        self._before = heading
        return self._part


def _corrected(
    model: Model, reference: _Reference, run: Pass, span: float, aim: _Aim
) -> _Reference:
    """The reference with the attitude, gyro bias and scale that the filter found."""
    left = run.left
    turn = left[:3] * np.array([1.0, 1.0, aim.part(float(left[2]))])
    C_nb = Rotation.from_rotvec(-turn) * _at_end(reference)
    of_sensors = np.array([name != "lever_arm" for name in model.names])[:, None]
    found = _found_by(model, reference, left) * of_sensors
    return _about(model, C_nb, replace(reference, found=found), span)


def _found_by(model: Model, reference: _Reference, x: Array) -> Array:
    """The constants (..., k, 3) that states (..., s) of a reference's errors come to."""
    told = slice(ERRORS, ERRORS + 3 * len(model.names))
    return np.asarray(reference.found + x[..., told].reshape(*x.shape[:-1], -1, 3))


def _at_end(reference: _Reference) -> Rotation:
    """``C_nb`` at the end."""
    return reference.C_ni * Rotation.from_quat(reference.carried.q[-1])


def _about(model: Model, C_nb: Rotation, less: _Reference, span: float) -> _Reference:
    """The reference rid of what `less` is, by blocks of `span` seconds; at the end ``C_nb``."""
    carried = carry(model.readings, span, *(_made(model, less.found, sensor) for sensor in _SUMS))
    return replace(less, carried=carried, C_ni=C_nb * Rotation.from_quat(carried.q[-1]).inv())


def _made(model: Model, found: Array, sensor: str) -> Made:
    """What a sensor of these constants (k, 3) makes of what is true."""
    unit, gain, offset = np.eye(3), np.eye(3), np.zeros(3)
    for name, own in zip(model.names, found, strict=True):
        its, _, kind = name.partition("_")
        if its == sensor and kind == "bias":
            offset = own
        elif its == sensor:
            gain = gain + (BY_AXIS[kind](unit, unit) @ own).T
    return Made(offset, gain)


def _filter(model: Model, reference: _Reference, variance: float) -> Pass:
    """One run over all updates; of a model that is not `whole` the last is told."""
    carried, C_ni = reference.carried, reference.C_ni.as_matrix()
    m, size = len(carried.t), model.size
    v, p = gravity_velocity(carried.t, model.site)
    z = np.concatenate([np.zeros((1, 3)), np.cumsum(carried.p, axis=0)]) @ C_ni.T - p
    state = np.zeros((size, size + 1))
    state[:, :-1] = np.diag(model.start)
    for k, own in enumerate(reference.found):  # taken out already
        state[columns_of(k), -1] = -own
    shapes = (m, size), (m, size), (m, 3, 3), (m, 3), (m, 3), (m,)
    out = Pass(*map(np.empty, shapes), scaled=np.empty((m, 3)), scale=_states_of_scale(model))
    careful = min(_CAREFUL, m)
    # an update or more after whole blocks; as fast one by one where more than errors move
    drifting = any(sensor in _SUMS for sensor, _ in model.drifts)
    singly = model.whole or any(model.walks) or drifting
    blocks = careful
    if m > careful and not singly:
        blocks += (m - careful - 1) // BLOCK * BLOCK
    edges = [0, *range(careful, blocks, _CHUNK), *range(blocks, m, _CHUNK), m]
    for part in map(slice, edges[:-1], edges[1:]):
        push = np.diff(v[part.start : part.stop + 1], axis=0)
        given = (
            *error_matrices(model, carried, C_ni, push, part, reference.found),
            z[part],
            variance,
        )
        updates = by_blocks if careful <= part.start < blocks else one_by_one
        (updates if part.start else careful_updates)(state, given, part, out)
    out = replace(out, heading=state[:, 2].copy())
    return out if model.whole else out.last


def error_matrices(
    model: Model,
    carried: Carried,
    C_ni: Array,
    gravity: Array,
    part: slice,
    found: Array | None = None,
) -> tuple[Steps, Array]:
    """The intervals after the edges of `part`, and what updates observe of the state (., 3, s).

    Errors of the reference: ``phi' = C (w errors)``, ``u' = phi x f + C (f errors)``,
    ``rho' = u``, where f is the reaction to gravity whose increments (k, 3) are `gravity`: were
    it the measured force, its noise times the unknown heading would pass for information, and
    times a scale error, which goes with the noise of the updates, for the scale error itself. Of
    sensors whose constants `found` (k, 3) are taken out, errors are those of what is true. The
    reference's place is ``rho + C r`` with lever arm r; its C holds phi, so the sway's own force
    is not in f. Within an interval of 0.1 s rates, f and C stay.
    """
    C_nb = C_ni @ matrices(carried.q[part])
    steps = slice(part.start, min(part.stop, len(carried.dv)))
    F = np.zeros((steps.stop - steps.start, ERRORS, model.size))
    F[:, np.arange(ERRORS), np.arange(ERRORS)] = 1.0
    H = np.zeros((len(C_nb), 3, model.size))
    H[:, :, 6:9] = np.eye(3)
    spans, push = carried.spans[steps, None, None], cross_matrix(gravity)
    turned = drive(carried, C_ni, steps)
    half = Rotation.from_rotvec(-carried.dtheta[steps] / 2)  # as it is amid each interval
    reaction = half.apply(np.einsum("kij,ki->kj", C_nb[: len(gravity)], gravity))
    errors = np.zeros((len(model.names), 3)) if found is None else found
    by = {s: turned @ np.linalg.inv(_made(model, errors, s).gain) for s in _SUMS}
    F[:, 3:6, :3] = -push
    F[:, 6:9, :3] = -spans / 2 * push
    F[:, 6:9, 3:6] = spans * np.eye(3)
    F[:, 3:6, 9] = gravity
    F[:, 6:9, 9] = spans[:, 0] / 2 * gravity
    for k, name in enumerate(model.names):
        column = columns_of(k)
        if name == "lever_arm":
            H[:, :, column] = C_nb
            continue
        sensor, _, kind = name.partition("_")
        driven = by[sensor]
        if kind != "bias":
            felt = carried.dtheta[steps] if sensor == "gyro" else reaction
            felt = felt / spans[:, 0]
            driven = driven @ BY_AXIS[kind](felt, felt)
        _drive(F[:, :9, column], sensor, driven, push, spans)
    for k, (sensor, _) in enumerate(model.drifts, start=len(model.names)):
        if sensor == _SIZE:
            ago = (carried.t[-1] - carried.t[steps])[:, None] - spans[:, 0] / 2
            north = Rotation.from_rotvec(-ago * model.site.w_ie_n).as_matrix() @ _NORTH
            _drive(F[:, :9, columns_of(k)], "gyro", spans * north, push, spans)
            continue
        if sensor == _SLOPE:
            rate, ends = carried.dtheta[steps] / spans[:, 0], carried.t[[0, -1]]
            since = carried.t[steps, None, None] + spans / 2 - ends.mean()
            by_time = by["gyro"] @ BY_AXIS["scale"](rate, rate) * since
            _drive(F[:, :9, columns_of(k)], "gyro", by_time, push, spans)
            continue
        if sensor in _PULLS:
            force = reaction[:, _PULLS.index(sensor), None, None] / spans
            _drive(F[:, :9, columns_of(k)], "gyro", by["gyro"] * force, push, spans)
            continue
        _drive(F[:, :9, columns_of(k)], sensor, by[sensor], push, spans)
    Q = _walks(model, turned, push, spans)
    up = gravity / np.linalg.norm(gravity, axis=1, keepdims=True)
    heave = _heave_density(carried, model.noise, model.priors, model.site.gravity)
    added = heave * spans * up[:, :, None] * up[:, None, :]
    Q[:, 3:6, 3:6] += added
    Q[:, 6:9, 3:6] += spans / 2 * added
    Q[:, 3:6, 6:9] += spans / 2 * added
    Q[:, 6:9, 6:9] += spans**2 / 3 * added
    return Steps(F, model.kept(float(carried.spans[-1])), Q, model.added(spans[:, :, 0])), H


def _drive(F: Array, sensor: str, driven: Array, push: Array, spans: Array) -> None:
    """What an error of a sensor that turns, or pushes, by `driven` (k, 3, 3) does to attitude,
    velocity and displacement, `F` (k, 9, 3)."""
    if sensor == "gyro":
        pushed = push @ driven
        F[:, :3] = driven
        F[:, 3:6] = -pushed / 2
        F[:, 6:9] = -spans / 6 * pushed
    else:
        F[:, 3:6] = driven
        F[:, 6:9] = spans / 2 * driven


def _walks(model: Model, turned: Array, push: Array, spans: Array) -> Array:
    """Covariances (k, e, e) of what white noise adds to the errors in each interval.

    Angle walk and its integrals over gravity's push D, ``(1, D/2, D/6)``, have the moments
    1, 1/2, 1/6; 1/3, 1/8; 1/20, velocity walk and its integral 1, 1/2; 1/3. Two of them are
    those of this integration, in steps of two samples with the rates held.
    """
    Q = np.zeros((len(spans), ERRORS, ERRORS))
    levels = model.noise.gyro, model.noise.accel
    walk, kick = (turned * level**2 / spans @ turned.transpose(0, 2, 1) for level in levels)
    once = -push @ walk
    twice = once @ push
    part = (model.readings.interval / spans) ** 2
    Q[:, :3, :3] = walk
    Q[:, 3:6, :3] = once / 2
    Q[:, 6:9, :3] = once * spans / 6
    Q[:, 3:6, 3:6] = twice * (1 + part / 3) / 3 + kick
    Q[:, 6:9, 3:6] = spans * (twice / 8 + kick / 2)
    Q[:, 6:9, 6:9] = spans**2 * (twice / 20 + kick * (1 + part / 3) / 3)
    Q[:, 6:9, 6:9] += spans * model.noise.jitter**2 * np.eye(3)
    for row, column in ((3, 0), (6, 0), (6, 3)):
        block = Q[:, row : row + 3, column : column + 3]
        Q[:, column : column + 3, row : row + 3] = block.transpose(0, 2, 1)
    return Q


def _answer(
    model: Model,
    reference: _Reference,
    run: Pass,
    more: tuple[Array, float, Array],
    lever: Array,
    flags: tuple[str, ...],
) -> Filtered:
    """Attitudes and constants from the reference and its errors; `more` (3, 3): what the filter
    does not know of, what a bias leaves of the Earth's level rate, and (m, 3, 3) what comes late.
    """
    carried, told_from = reference.carried, -len(run.x)
    t = carried.t[told_from:]
    left = (t[-1] - t)[:, None] * model.site.w_ie_n  # n turns back to then
    to_n = Rotation.from_rotvec(left)
    at_end = Rotation.from_rotvec(-run.x[:, :3]) * reference.C_ni
    R = to_n.as_matrix()
    m, count = len(t), len(model.names)
    told = slice(ERRORS, ERRORS + 3 * count)
    covariance = R @ run.attitude @ R.transpose(0, 2, 1) + more[0]
    covariance += more[2][told_from:]
    return Filtered(
        t,
        to_n * at_end * Rotation.from_quat(carried.q[told_from:]),
        covariance * less_turned(covariance[-1], more[1]),
        model.names,
        _found_by(model, reference, run.x),
        np.sqrt(run.variances[:, told]).reshape(m, count, 3),
        Innovations(t, run.values, np.sqrt(run.expected[told_from:])),
        lever,
        flags,
    )
