"""How the methods for a base that rocks follow their readings, along a motion that is known.

`readings` of perfect sensors are carried as the method carries real ones; each method is then a
linear functional of the errors of its sensors over time.
"""

from dataclasses import replace

import numpy as np

from alignment.arrays import Array
from alignment.cross import cross_matrix
from alignment.earth import Site
from alignment.gains import Functional, functional
from alignment.information.drift import at_the_start
from alignment.methods.fine import (
    STILL,
    UPDATE,
    Model,
    columns_of,
    error_matrices,
    model_of,
    of_any_size,
    of_the_rate,
    states_of,
    sway_by_lag,
)
from alignment.methods.inertial import (
    EVERY,
    along,
    attitude_weights,
    block_of,
    drive,
    gravity_velocity,
    laid,
    less_arm,
    lever_of,
    noise_of,
    sensitivity,
    squared_rate,
    sway_covariance,
    turns,
    with_places,
)
from alignment.methods.updates import Steps
from alignment.options import Options
from alignment.readings import ImuReadings
from alignment.strapdown import Carried, carry

STEP = 0.5  # s between the updates of the frozen filter: its gains vary slowly


def inertial_functional(readings: ImuReadings, site: Site, options: Options) -> Functional:
    """Wahba's match of velocity curves: its own sensitivity to each block's errors."""
    site.horizontal_rate()
    carried = carry(readings, block_of(readings))
    priors = with_places(options.priors, squared_rate(carried))
    matched, _, arm = laid(readings, carried, site, priors)
    C_ni = matched.C_ni.as_matrix()
    weights = attitude_weights(carried, matched)
    weights = np.concatenate([weights, along(weights[:, 2:])], axis=1)
    ends = [weights[k, :3] / carried.spans[k] for k in (0, -1)]
    weights, left = less_arm(weights, arm)
    gyro, accel = sensitivity(weights, C_ni, carried)
    gyro[:, :3] += np.eye(3)  # the attitude carried to the end has all of the gyros' error
    turned = drive(carried, C_ni, EVERY)
    gyro, accel = gyro @ turned, accel @ turned
    sway, left = sway_covariance(carried, matched), left[:3]
    motion = np.asarray(sum((e @ sway @ e.T for e in ends), left @ left.T))
    direction = functional(carried, matched.C_ni, gyro, accel, np.zeros((4, 4)))
    run = functional(carried, matched.C_ni, gyro[:, :3], accel[:, :3], motion)
    lever = lever_of(carried.spans, matched) if matched.larger is None else None
    return replace(run, direction=direction, lever=lever)


def fine_functional(readings: ImuReadings, site: Site, options: Options) -> Functional:
    """The Kalman filter with its gains frozen, run backward from its last attitude."""
    checked_by = inertial_functional(readings, site, options)
    carried = carry(readings, STEP)
    placed = with_places(options.priors, squared_rate(carried))
    matched, _, _ = laid(readings, carried, site, placed)
    priors = states_of(options.priors, carried, site)
    noise = noise_of(readings, priors)
    span = readings.interval * len(readings)
    found = at_the_start(priors, float(readings.t[-1]) - span, span)
    model = model_of(readings, site, noise, found)
    C_ni = matched.C_ni.as_matrix()
    push = np.diff(gravity_velocity(carried.t, site)[0], axis=0)
    steps, H = error_matrices(model, carried, C_ni, push, slice(0, len(carried.t)))
    walk = float(np.mean(noise.gyro**2)) * float(carried.t[-1] - carried.t[0])
    variance = (STILL**2 + 100 * priors.lever_arm**2 * walk) * UPDATE / STEP
    variance += sway_by_lag(model, carried, variance) * UPDATE / STEP
    gains, _ = _kalman_gains(model, steps, H, variance)
    rows = _rows(steps.F, H, gains)
    gyro, accel = _by_sensor(rows[1:], carried, C_ni, push)
    arm = np.zeros((3, 3))
    if "lever_arm" in model.names:
        part = rows[0][:, columns_of(model.names.index("lever_arm"))] * priors.lever_arm
        arm = part @ part.T
    circle = None
    if turns(carried):
        free = of_any_size(model)
        steps, H = error_matrices(free, carried, C_ni, push, slice(0, len(carried.t)))
        _, P = _kalman_gains(free, steps, H, variance)
        circle = np.linalg.inv(of_the_rate(P[2], P.diagonal(), site))
    run = functional(carried, matched.C_ni, gyro, accel, arm, checked_by)
    return replace(run, circle=circle)


def _kalman_gains(model: Model, steps: Steps, H: Array, variance: float) -> tuple[Array, Array]:
    """Gains (n + 1, s, 3) of updates that observe ``H x`` with noise of `variance`, and what is
    left of the covariance (s, s) after the last."""
    F, Q, P, kept = steps.F, steps.Q, np.diag(model.start), []
    for k in range(len(H)):
        PH = P @ H[k].T
        K = PH @ np.linalg.inv(H[k] @ PH + variance * np.eye(3))
        P = P - K @ PH.T
        kept.append(K)
        if k < len(F):
            P = F[k] @ P @ F[k].T + Q[k]
            P = 0.5 * (P + P.T)
    return np.array(kept), P


def _rows(F: Array, H: Array, gains: Array) -> Array:
    """How the last attitude error follows the state (n + 1, 3, s): first before all updates, then
    at the end of each interval, before the update there."""
    row = np.eye(3, H.shape[-1])
    rows = np.empty((len(H), *row.shape))
    for k in range(len(F), -1, -1):
        row = row - (row @ gains[k]) @ H[k]
        rows[k] = row
        if k:
            row = row @ F[k - 1]
    return rows


def _by_sensor(rows: Array, carried: Carried, C_ni: Array, push: Array) -> tuple[Array, Array]:
    """The rows at the ends of intervals, per constant error of gyros and accelerometers in it."""
    turned, spans = drive(carried, C_ni, EVERY), carried.spans[:, None, None]
    pushed = -cross_matrix(push) @ turned
    phi, u, rho = rows[..., :3], rows[..., 3:6], rows[..., 6:9]
    gyro = phi @ turned + u @ pushed / 2 + rho @ pushed * spans / 6
    return gyro, u @ turned + rho @ turned * spans / 2
