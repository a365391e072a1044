"""Methods for a base that rocks: their answer to errors of each moment, along the planned motion.

The truth of the motion is carried as the method carries readings; no sensor is simulated. Each
method is then a linear functional of the errors of its sensors over time: `Functional`.
"""

from dataclasses import dataclass
from math import sqrt

import numpy as np
from scipy.spatial.transform import Rotation

from alignment import ImuReadings, Options, Site
from alignment.arrays import Array
from alignment.information import GaussMarkov, Unit
from alignment.information.model import BY_AXIS
from alignment.methods.fine import _START, CONSTANTS, STILL, UPDATE, _matrices, _Model, _Reference
from alignment.methods.inertial import (
    EVERY,
    block_of,
    drive,
    fit_matrix,
    gravity_velocity,
    match,
    noise_of,
    sensitivity,
    skew,
    sway_covariance,
)
from alignment.strapdown import Carried, carry
from stand.imu.recursion import Recursion
from stand.motion.polynomial import Motion
from stand.physics.truth import Truth
from stand.rehearsal.instrument import roundings_of
from stand.rehearsal.scene import Scene
from stand.rehearsal.telling import Parts, name_of
from stand.rehearsal.warmth import above_reference, triad_of

RATE_HZ = 20  # of the truth that is carried
STEP = 0.5  # s between the updates of the frozen filter: its gains vary slowly


@dataclass(frozen=True, slots=True, eq=False)
class Functional:
    """Rotation about n at the end of a stretch, by errors of m blocks.

    Attributes
    ----------
    t : (m + 1,) s
    gyro, accel : (m, 3, 3)
        Per mean error of rate, force [rad/s], [m/s^2] in b over the block.
    rate, force : (m, 3)
        True means over the blocks.
    motion : (3, 3) rad^2
        What the sway itself leaves.
    C_nb : Rotation
        At the end.
    """

    t: Array
    gyro: Array
    accel: Array
    rate: Array
    force: Array
    motion: Array
    C_nb: Rotation


def readings_of(truth: Truth, motion: Motion, begin: float, end: float) -> ImuReadings:
    """What perfect sensors read between two times [s], at the middles of samples.

    The mean over a sample differs by ``(w h)^2 / 24`` of rocking at w: 0.4 % at 1 Hz.
    """
    middle = begin + (np.arange(round((end - begin) * RATE_HZ)) + 0.5) / RATE_HZ
    felt = truth.instants(*motion.joints(middle))
    return ImuReadings(middle + 0.5 / RATE_HZ, felt.w_ib_b, felt.f_b)


def inertial(readings: ImuReadings, site: Site, options: Options) -> Functional:
    """Wahba's match of velocity curves: its own sensitivity to each block's errors."""
    site.horizontal_rate()
    carried = carry(readings, block_of(readings))
    matched = match(carried, site)
    C_ni = matched.C_ni.as_matrix()
    fit = fit_matrix(carried.spans, matched.reference)
    gyro, accel = sensitivity(
        -fit @ skew(matched.reference * carried.spans[:, None]), C_ni, carried
    )
    gyro = gyro + np.eye(3)  # the attitude carried to the end has all of the gyros' error
    turned = drive(carried, C_ni, EVERY)
    sway = sway_covariance(carried, matched)
    ends = [fit @ skew(matched.reference[[k]])[0] for k in (0, -1)]
    motion = sum((e @ sway @ e.T for e in ends), np.zeros((3, 3)))
    C_nb = matched.C_ni * Rotation.from_quat(carried.q[-1])
    return _functional(carried, gyro @ turned, accel @ turned, np.asarray(motion), C_nb)


def fine(readings: ImuReadings, site: Site, options: Options) -> Functional:
    """The Kalman filter with its gains frozen, run backward from its last attitude."""
    site.horizontal_rate()
    priors = options.priors
    carried = carry(readings, STEP)
    matched = match(carried, site)
    noise = noise_of(readings, priors)
    names = tuple(name for name in CONSTANTS if getattr(priors, name) > 0)
    model = _Model(readings, site, noise, priors, names)
    reference = _Reference(carried, matched.C_ni, np.zeros(3))
    C_ni = matched.C_ni.as_matrix()
    v, _ = gravity_velocity(carried.t, site)
    push = np.diff(v, axis=0)
    F, Q, H = _matrices(model, reference.carried, C_ni, push, slice(0, len(carried.t)))
    walk = float(np.mean(noise.gyro**2)) * float(carried.t[-1] - carried.t[0])
    variance = (STILL**2 + 100 * priors.lever_arm**2 * walk) * UPDATE / STEP
    sigmas = [np.repeat(getattr(priors, name), 3) for name in names]
    P = np.diag(np.concatenate([_START, [0.0], *sigmas]) ** 2)
    kept = []
    for k in range(len(H)):
        PH = P @ H[k].T
        K = PH @ np.linalg.inv(H[k] @ PH + variance * np.eye(3))
        P = P - K @ PH.T
        kept.append(K)
        if k < len(F):
            P = F[k] @ P @ F[k].T + Q[k]
            P = 0.5 * (P + P.T)
    turned, spans = drive(carried, C_ni, EVERY), carried.spans[:, None, None]
    pushed = -skew(push) @ turned
    gyro, accel = np.empty((len(F), 3, 3)), np.empty((len(F), 3, 3))
    row = np.eye(3, len(P))
    for k in range(len(F) - 1, -1, -1):
        row = row - (row @ kept[k + 1]) @ H[k + 1]
        phi, u, rho = row[:, :3], row[:, 3:6], row[:, 6:9]
        gyro[k] = phi @ turned[k] + u @ pushed[k] / 2 + rho @ pushed[k] * spans[k] / 6
        accel[k] = u @ turned[k] + rho @ turned[k] * spans[k] / 2
        row = row @ F[k]
    arm = np.zeros((3, 3))
    if "lever_arm" in names:
        row = row - (row @ kept[0]) @ H[0]
        at = len(_START) + 1 + 3 * names.index("lever_arm")
        part = row[:, at : at + 3] * priors.lever_arm
        arm = part @ part.T
    C_nb = matched.C_ni * Rotation.from_quat(carried.q[-1])
    return _functional(carried, gyro, accel, arm, C_nb)


def _functional(
    carried: Carried, gyro: Array, accel: Array, motion: Array, C_nb: Rotation
) -> Functional:
    spans = carried.spans[:, None]
    return Functional(
        carried.t, gyro, accel, carried.dtheta / spans, carried.dv / spans, motion, C_nb
    )


ROCKING = {"inertial": inertial, "fine": fine}


# --- what errors over time come to ---------------------------------------------------------------


def steps_as_noise(scene: Scene) -> tuple[float, float]:
    """White noise of gyros and accelerometers [u/sqrt(Hz)] by rounding: a rocking base carries
    readings over many steps, so each sample's is anew."""
    gyro, accel = roundings_of(scene.imu, scene.rate_hz)
    return gyro.step / sqrt(12 * scene.rate_hz), accel.step / sqrt(12 * scene.rate_hz)


def over_time(run: Functional, unit: Unit, scene: Scene) -> Parts:
    """Covariances about n at the end of a stretch, by source."""
    rounding = steps_as_noise(scene)
    spans = np.diff(run.t)
    middle = (run.t[1:] + run.t[:-1]) / 2
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
        parts[f"{name} bias instability"] = _drifted(gain, middle, triad.drift)
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


def _drifted(gain: Array, t: Array, processes: tuple[GaussMarkov, ...]) -> Array:
    """Covariance (3, 3) by stationary drifts at even times (m,), alike and apart on each axis."""
    P: Array = np.einsum("mij,mkj->ik", gain, gain) * sum(p.sigma**2 for p in processes)
    for process in processes:
        keep = np.exp(-np.median(np.diff(t)) / process.time)
        memory = Recursion(keep, np.zeros(9))
        # what the process's memory carries into each block from those before it
        carried = memory.apply(gain.reshape(-1, 9).T).T.reshape(gain.shape) - gain
        both = np.einsum("mij,mkj->ik", carried, gain)
        P = P + process.sigma**2 * (both + both.T)
    return P


def _walked(gain: Array, t: Array, size: float) -> Array:
    after = np.cumsum(gain[::-1], axis=0)[::-1]
    steps = np.diff(t, prepend=0.0)
    return size**2 * np.einsum("m,mij,mkj->ik", steps, after, after)
