"""Methods for a base that rocks: their answer to errors of each moment, along the planned motion.

The truth of the motion is carried as the method carries readings; no sensor is simulated. Each
method is then a linear functional of the errors of its sensors over time: `Functional`.
"""

from math import sqrt

import numpy as np
from scipy.spatial.transform import Rotation

from alignment import ImuReadings
from alignment.around import by_direction, by_length, by_level_rate
from alignment.arrays import Array
from alignment.constant_errors import BY_AXIS
from alignment.gains import Functional, by_increments
from alignment.information import InstrumentErrors
from alignment.information.circle import NO_RIVAL, Rival
from alignment.information.drift import sum_covariance
from alignment.information.result import DETERMINED
from alignment.methods.inertial import (
    FOLLOWED,
    block_of,
    laid,
    sampling_covariance,
    squared_rate,
    with_clock,
    with_places,
)
from alignment.readings import EDGE, over_steps
from alignment.strapdown import carry
from stand.imu.by_value import values_of
from stand.imu.instrument import lags_of
from stand.motion.plan import PlannedStep
from stand.motion.polynomial import Motion
from stand.physics.truth import Truth
from stand.rehearsal.predictions import BEYOND, Parts, name_of
from stand.rehearsal.scene import Scene
from stand.rehearsal.warmth import above_reference, triad_of
from stand.samples import Sampling
from stand.table.kinematics import C_NW

_LAST = 8  # steps whose instants the last mean is of
RATE_HZ = 20  # of the truth that is carried
CLOCK = "gyro clock"
FOLLOWS = 0.19  # part of a variance: without it the sigma is 10 % smaller


def readings_of(truth: Truth, motion: Motion, begin: float, end: float) -> ImuReadings:
    """What perfect sensors read between two times [s], at the middles of samples.

    The mean over a sample differs by ``(w h)^2 / 24`` of rocking at w: 0.4 % at 1 Hz.
    """
    middle = begin + (np.arange(round((end - begin) * RATE_HZ)) + 0.5) / RATE_HZ
    felt = truth.instants(*motion.joints(middle))
    return ImuReadings(middle + 0.5 / RATE_HZ, felt.w_ib_b, felt.f_b)


# --- what errors over time come to ---------------------------------------------------------------


def steps_as_noise(scene: Scene) -> tuple[float, float]:
    """White noise of gyros and accelerometers [u/sqrt(Hz)] by rounding: a rocking base carries
    readings over many steps, so each sample's is anew."""
    gyro, accel = scene.roundings
    return gyro.step / sqrt(12 * scene.rate_hz), accel.step / sqrt(12 * scene.rate_hz)


def over_time(run: Functional, unit: InstrumentErrors, scene: Scene) -> Parts:
    """Covariances about n at the end of a stretch, by source."""
    rounding = steps_as_noise(scene)
    spans = np.diff(run.t)
    middle = run.middle
    trembling = scene.imu.clock.jitter / sqrt(scene.rate_hz) * run.changing
    parts: Parts = {}
    force = run.force
    for k, (name, triad, gain, x, step) in enumerate(
        (
            ("gyro", unit.gyro, run.gyro, run.rate, rounding[0]),
            ("accelerometer", unit.accel, run.accel, force, rounding[1]),
        )
    ):
        each = gain / np.sqrt(spans)[:, None, None]
        for source, size in (("white noise", triad.noise), ("rounding", step)):
            white = each * np.asarray(size)
            parts[f"{name} {source}"] = np.einsum("mij,mkj->ik", white, white)
        if end := scene.roundings[k].end:
            ends, moved = np.full(3, end**2), x * spans[:, None]
            parts[f"{name} rounding"] += by_increments(gain, spans, moved, ends)
        if scene.imu.clock.jitter:
            white = each * trembling[:, None, 3 * k : 3 * k + 3]
            parts[f"{name} jitter"] = np.einsum("mij,mkj->ik", white, white)
        parts[f"{name} bias instability"] = sum_covariance(gain, float(spans[-1]), triad.drift)
        if triad.random_walk:
            parts[f"{name} random walk"] = _walked(gain, middle, triad.random_walk)
        if scene.temperature is not None:
            warmth = above_reference(scene.temperature, scene.imu, middle)
            spec = triad_of(scene.imu, k)
            bias = np.einsum("mij,m->ij", gain, warmth) * spec.bias_temperature
            scale = np.einsum("mij,mj,m->ij", gain, x, warmth) * spec.scale_temperature
            parts[f"{name} temperature"] = bias @ bias.T + scale @ scale.T
        for field, columns_of in BY_AXIS.items():
            sigma = np.asarray(getattr(triad, field))
            if not sigma.any():
                continue
            by_time = middle[:, None, None] * np.eye(3)
            columns = by_time if field == "ramp" else columns_of(x, force)
            J = np.einsum("mij,mjk->ik", gain, columns) * np.repeat(sigma, columns.shape[-1] // 3)
            parts[name_of(f"{name} {field.replace('_', '-').replace('g2', 'g^2')}")] = J @ J.T
    parts["motion"] = run.motion
    return parts


def at_zero(run: Functional, step: PlannedStep, scene: Scene) -> Rotation:
    """The attitude of an axis that turns as it is told, where it reads zero, about the n of `run`:
    an arm that no prior has may turn that off north, and all that is stated is about it."""
    at_end = scene.truth().instants(*scene.plan.motion.joints(run.t[-1:]))
    return run.C_nb * (C_NW * Rotation.from_quat(at_end.q_wb[0])).inv() * step.C_nb


def known(run: Functional, scene: Scene) -> Array:
    """Rotation about n (3,) by constants of the unit that are known by value, its accelerometers'
    places among them: ``(w x (w x r))_i`` of each, w as it stays in a turn."""
    off = np.zeros((len(run.rate), 6))
    for own, spec, x in (
        (slice(3), scene.imu.gyro, run.rate),
        (slice(3, 6), scene.imu.accel, run.force),
    ):
        for field, values in values_of(spec).items():
            off[:, own] += BY_AXIS[field](x, run.force) @ values
    if scene.imu.places.any():
        w = run.rate[:, None]
        off[:, 3:] += np.cross(w, np.cross(w, scene.imu.places)).diagonal(axis1=1, axis2=2)
    return run.answer(off)


def late(run: Functional, scene: Scene) -> Parts:
    """Covariance about n by a lag: the attitude is that of as long before the end, and by what
    accelerometers that come later than gyros feel."""
    lag, later = lags_of(scene.imu)
    felt = run.changing * np.repeat([0.0, 1.0], 3)
    late = lag * _turning(run, scene) + later * run.answer(felt)
    return {"lag": np.outer(late, late)}


def with_ahead(parts: Parts, clocked: Array, run: Functional, scene: Scene) -> Parts:
    """The same with what a clock that runs fast is ahead by at the end; `clocked` (3,) `by_clock`.

    That is about the axis of the turn in b, whatever the heading; what the clock makes of an
    answer as an error of scale goes round with heading, and both add as far as that is sure: see
    `alignment.methods.inertial.with_clock`.
    """
    if not scene.imu.clock.offset:
        return parts
    plumb = scene.site.plumb
    ahead = plumb.apply(scene.imu.clock.offset * run.t[-1] * _turning(run, scene))
    scaled = plumb.apply(clocked)
    variance = float(sum(parts.values(), np.zeros((3, 3)))[2, 2])
    by_scale = parts.get(CLOCK, np.zeros((3, 3)))
    return parts | {CLOCK: by_scale + with_clock(ahead[None], scaled, sqrt(variance))[0]}


def _turning(run: Functional, scene: Scene) -> Array:
    """Rate about n (3,) at the end, against the Earth."""
    at_end = run.rate[-1] + run.changing[-1, :3] * (run.t[-1] - run.t[-2]) / 2
    return np.asarray(run.C_nb.as_matrix() @ at_end - scene.site.w_ie_n)


def of_instants(run: Functional, step: PlannedStep, scene: Scene) -> Parts:
    """Covariance about n by what instants leave untold of the angle of a stretch's last step."""
    if scene.settings.sampling is not Sampling.INSTANT:
        return {}
    last = int((step.steady_to + EDGE) * scene.rate_hz)
    least = int(step.steady_from * scene.rate_hz)
    edges = np.arange(max(least, last - _LAST), last + 1) / scene.rate_hz
    truth, motion = scene.truth(), scene.plan.motion
    instants = truth.over(motion, edges, Sampling.INSTANT).w_ib_b
    told = over_steps(instants, slice(len(instants) - 1, len(instants)))[0]
    true = truth.over(motion, edges, Sampling.MEAN).w_ib_b[-1]
    left = run.C_nb.as_matrix() @ (told - true) / scene.rate_hz
    return {"instants": np.outer(left, left)}


def of_sampling(step: PlannedStep, scene: Scene) -> Parts:
    """Covariance about n by samples too far apart for a stretch's motion, by those that there will
    be."""
    if 1 / scene.rate_hz <= FOLLOWED:
        return {}
    first, last = (int((t + EDGE) * scene.rate_hz) for t in (step.steady_from, step.steady_to))
    edges, sampling = np.arange(first, last + 1) / scene.rate_hz, scene.settings.sampling
    felt = scene.truth().over(scene.plan.motion, edges, sampling)
    instants = sampling is Sampling.INSTANT
    readings = ImuReadings(edges[1:], felt.w_ib_b, felt.f_b, instants=instants)
    carried = carry(readings, block_of(readings))
    priors = with_places(scene.options.priors, squared_rate(carried))
    matched, noise, _ = laid(readings, carried, scene.site, priors)
    found = carried, matched, noise
    return {"sampling": sampling_covariance(readings, found, priors, scene.site)}


def by_clock(run: Functional, scene: Scene) -> Array:
    """What a clock that runs fast makes of an answer (3,): a scale error, one for all gyros."""
    slower = np.concatenate([run.rate, np.zeros_like(run.rate)], axis=1)
    return -scene.imu.clock.offset * run.answer(slower)


def of_the_level_rate(match: Functional, unit: InstrumentErrors, scene: Scene) -> Array | None:
    """Covariance (4, 4) of tilts and heading by a match of curves, and of how much larger the
    Earth's level rate is found, in parts of it; None of a method that finds no such rate."""
    if match.direction is None:
        return None
    clock = by_clock(match.direction, scene)
    parts = over_time(match.direction, unit, scene)
    return np.asarray(sum(parts.values(), np.outer(clock, clock)))


def turning_round(errors: Array | None) -> Rival:
    """What `errors` (4, 4) of the Earth's level rate along itself make of the heading of a match.

    Heading is the direction of what is found: an error as large as the rate turns it round. Nothing
    of one that first order does not determine.
    """
    if errors is None:
        return NO_RIVAL
    across = float(np.sqrt(errors[2, 2]))
    if not 0 < across < DETERMINED:
        return NO_RIVAL
    of_rate = errors[np.ix_([3, 2], [3, 2])]
    return Rival(by_direction(of_rate) / across, np.pi, float(1 / errors[3, 3]))


def with_level_rate_found(parts: Parts, errors: Array | None, lever: Array | None) -> Parts:
    """The same, whose tilts are as they are where the level rate turns by much: see
    `alignment.around.with_level_rate`. Nothing of a method without `errors` or `lever`."""
    if errors is None or lever is None:
        return parts
    total = np.asarray(sum(parts.values(), np.zeros((3, 3))))
    less, more = by_level_rate(total, errors, lever)
    kept: Parts = {name: less @ P @ less.T for name, P in parts.items()}
    return kept | {BEYOND: more} if more.any() else kept


def turned_by_heading(parts: Parts) -> Parts:
    """The same, where an error of heading is not small: it turns the tilt that the gyros make.

    To first order the gyros' errors tilt the carried attitude by t about n. Found together with an
    error h of heading, that tilt is one about axes turned by h: ``cos(h) t + sin(h) (0,0,1) x t``.
    What accelerometers make of tilt stays in b, whatever the heading. Of a normal h that is not
    correlated with t the squares of cosine and sine are ``(1 +- exp(-2 h^2)) / 2`` on average, and
    their product is nothing.
    """
    variance = float(sum(parts.values(), np.zeros((3, 3)))[2, 2])
    half = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    kept, turned = (1 + np.exp(-2 * variance)) / 2, -np.expm1(-2 * variance) / 2

    def about_north(P: Array) -> Array:
        both: Array = kept * P + turned * half @ P @ half.T
        both[:2, 2] = both[2, :2] = np.exp(-variance / 2) * P[:2, 2]
        return both

    return {n: about_north(P) if n.startswith("gyro") else P for n, P in parts.items()}


def tilt_doubt(parts: Parts) -> str:
    """Why no tilt is predicted, if more than first order matters to it; '' if it does not.

    Gyros tilt by what of their horizontal error is taken for no heading. To first order that is
    one component, along north; a heading that follows the error leaves its whole length.
    """
    total = float(sum(np.trace(P[:2, :2]) for P in parts.values()))
    more = sum(
        (by_length(float(np.sqrt(P[2, 2]))) - 1) * float(np.trace(P[:2, :2]))
        for name, P in parts.items()
        if name.startswith("gyro")
    )
    if more <= FOLLOWS * total:
        return ""
    return "heading follows the gyros' errors, which tilt by both components then: see --verify"


def _walked(gain: Array, t: Array, size: float) -> Array:
    after = np.cumsum(gain[::-1], axis=0)[::-1]
    steps = np.diff(t, prepend=0.0)
    return size**2 * np.einsum("m,mij,mkj->ik", steps, after, after)
