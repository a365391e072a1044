"""The inertial channel: strapdown navigation in i with the covariance of its errors.

Errors are estimate minus truth: attitude ``psi`` about i (estimate = exp(psi x) truth), velocity,
place, gyro bias, accelerometer bias, the correlated errors of the satellites' position and
velocity (21 in all), and behind them all other errors of the unit, of a variance of one each.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from alignment.arrays import Array
from alignment.cross import cross_matrix
from alignment.methods.vectors.effects import Effects
from alignment.methods.vectors.fixes import Matching, Record, VectorOptions
from alignment.navigation import C_ie, Integrals, attitude_in_n, gravitation
from alignment.options import Priors
from alignment.readings import Fixes
from alignment.skew import Axes, spread

PSI, VEL, POS = slice(0, 3), slice(3, 6), slice(6, 9)
GYRO, ACCEL = slice(9, 12), slice(12, 15)
POS_DRIFT, VEL_DRIFT = slice(15, 18), slice(18, 21)
STATES, MORE = 21, slice(21, None)
_I3 = np.eye(3)


@dataclass(frozen=True, slots=True, eq=False)
class State:
    """`C` (3, 3) = ``C_ib``; `v`, `r` (3,) in i; biases, satellite drifts, and `more` (q,) errors
    of the unit; covariance `P` (21 + q, 21 + q)."""

    C: Array
    v: Array
    r: Array
    gyro: Array
    accel: Array
    r_drift: Array
    v_drift: Array
    more: Array
    P: Array


class Strides(NamedTuple):
    """From each point to the next: what was felt, and what errors of the unit add to it."""

    sensed: Integrals
    effects: Effects


class Path(NamedTuple):
    """Where errors are looked at: ``C_ib`` (k, 3, 3) before each stretch, and what velocity and
    place (k, 3) in i gain in it by force."""

    C: Array
    velocity: Array
    place: Array


@dataclass(frozen=True, slots=True)
class Notes:
    """What happened at each point: whether it corrected, the invariants' differences, doubts."""

    corrected: list[bool] = field(default_factory=lambda: [False])
    differences: list[Array] = field(default_factory=lambda: [np.zeros(3)])
    doubts: list[str] = field(default_factory=lambda: [""])

    def add(self, corrected: bool, differences: Array, doubt: str) -> None:
        """Note the next point."""
        self.corrected.append(corrected)
        self.differences.append(differences)
        self.doubts.append(doubt)


def begun(record: Record, fixes: Fixes, options: VectorOptions) -> State:
    """At the first fix: its place and velocity, the programmed attitude, no biases."""
    priors, zero, more = record.priors, np.zeros(3), np.zeros(record.effects.count)
    sigmas = [
        options.attitude_sigma,
        np.hypot(fixes.velocity_sigma, fixes.velocity_drift),
        np.hypot(fixes.position_sigma, fixes.position_drift),
        priors.gyro_bias,
        priors.accel_bias,
        fixes.position_drift,
        fixes.velocity_drift,
    ]
    P = np.diag(np.append(np.repeat(np.square(sigmas), 3), 1.0 + more))
    for block, axes in ((GYRO, priors.gyro_axes), (ACCEL, priors.accel_axes)):
        P[block, block] = P[block, block] @ _in_i(_I3, axes)
    # the place errs by the first fix's drift, and the drift's estimate (0) by minus that
    for state, drift, sigma in (
        (POS, POS_DRIFT, fixes.position_drift),
        (VEL, VEL_DRIFT, fixes.velocity_drift),
    ):
        P[state, drift] = P[drift, state] = -(sigma**2) * _I3
    return State(
        record.C_ib,
        record.v_i[0],
        record.r_i[0],
        zero,
        accel=zero,
        r_drift=zero,
        v_drift=zero,
        more=more,
        P=P,
    )


def steps(record: Record) -> Strides:
    """From each point to the next, in b at the former."""
    k = np.arange(len(record.t) - 1)
    return Strides(record.sensed.since(k, k + 1), record.effects.between(record.sensed))


def path_to(strides: Strides, last: State) -> Path:
    """The path that ends with the attitude of `last`, of a unit with the errors of it."""
    C, found = last.C, []
    for k in reversed(range(len(strides.sensed.duration))):
        turned, dv, dr = _felt(strides, k, last)
        C = C @ turned.T
        found.append((C, C @ dv, C @ dr))
    return Path(*(np.array(part) for part in zip(*reversed(found), strict=True)))


def _felt(strides: Strides, k: int, state: State) -> tuple[Array, Array, Array]:
    """Turn (3, 3), gains of velocity and place (3,) in b before it, less the unit's errors."""
    (step, other), own = strides, state.more
    wrong = step.turn_time[k] @ state.gyro + other.turn[k] @ own
    turned = Rotation.from_rotvec(-wrong).as_matrix() @ step.turn[k]
    dv = step.velocity[k] - step.velocity_gyro[k] @ state.gyro - step.turn_time[k] @ state.accel
    dr = step.place[k] - step.place_gyro[k] @ state.gyro - step.turn_time2[k] @ state.accel
    return turned, dv - other.velocity[k] @ own, dr - other.place[k] @ own


def carried(
    state: State,
    strides: Strides,
    k: int,
    elapsed: float,
    fixes: Fixes,
    priors: Priors,
    path: Path | None = None,
) -> State:
    """The state after stretch `k` of `steps`, which began `elapsed` seconds after the first fix.

    Its covariance is carried along the `path`, or along the state itself.
    """
    C, T = state.C, float(strides.sensed.duration[k])
    turned, *gains = _felt(strides, k, state)
    dv, dr = (C @ gain for gain in gains)
    along = (C, dv, dr) if path is None else (path.C[k], path.velocity[k], path.place[k])
    g = gravitation(state.r, elapsed)
    ahead = state.r + state.v * T + dr + 0.5 * g * T**2
    slope = gravitation(ahead, elapsed + T) - g
    fading = np.exp(-T / fixes.drift_time)
    F = _transition(strides, k, *along, fading)
    P = F @ state.P @ F.T
    P[:STATES, :STATES] += _noise(T, *along, fading, fixes, priors)
    return State(
        C @ turned,
        state.v + dv + (g + 0.5 * slope) * T,
        ahead + slope * T**2 / 6,
        state.gyro,
        accel=state.accel,
        r_drift=state.r_drift * fading,
        v_drift=state.v_drift * fading,
        more=state.more,
        P=P,
    )


def _transition(strides: Strides, k: int, C: Array, dv: Array, dr: Array, fading: float) -> Array:
    """Errors after a stretch per error before it.

    The gradient of gravity (3e-6/s^2) is left out.
    """
    step, other = strides
    F = np.eye(STATES + other.count)
    F[PSI, GYRO] = -C @ step.turn_time[k]
    F[VEL, PSI], F[POS, PSI] = -cross_matrix(dv), -cross_matrix(dr)
    F[VEL, GYRO], F[POS, GYRO] = -C @ step.velocity_gyro[k], -C @ step.place_gyro[k]
    F[VEL, ACCEL], F[POS, ACCEL] = -C @ step.turn_time[k], -C @ step.turn_time2[k]
    F[PSI, MORE], F[VEL, MORE] = -C @ other.turn[k], -C @ other.velocity[k]
    F[POS, MORE] = -C @ other.place[k]
    F[POS, VEL] = step.duration[k] * _I3
    F[POS_DRIFT, POS_DRIFT] = F[VEL_DRIFT, VEL_DRIFT] = fading * _I3
    return F


def _noise(
    T: float, C: Array, dv: Array, dr: Array, fading: float, fixes: Fixes, priors: Priors
) -> Array:
    """White rate and force noise over a stretch of even force; fresh satellite drift."""
    Q = np.zeros((STATES, STATES))
    N2 = priors.gyro_walk**2 * _in_i(C, priors.gyro_axes)
    A2 = priors.accel_walk**2 * _in_i(C, priors.accel_axes)
    V, D = -cross_matrix(dv), -cross_matrix(dr)
    Q[PSI, PSI] = T * N2
    Q[VEL, PSI], Q[POS, PSI] = T / 2 * V @ N2, T / 3 * D @ N2
    Q[VEL, VEL] = T / 3 * V @ N2 @ V.T + T * A2
    Q[POS, VEL] = T / 4 * D @ N2 @ V.T + T**2 / 2 * A2
    Q[POS, POS] = T / 5 * D @ N2 @ D.T + T**3 / 3 * A2
    Q[PSI, VEL], Q[PSI, POS], Q[VEL, POS] = Q[VEL, PSI].T, Q[POS, PSI].T, Q[POS, VEL].T
    fresh = 1 - fading**2
    Q[POS_DRIFT, POS_DRIFT] = fixes.position_drift**2 * fresh * _I3
    Q[VEL_DRIFT, VEL_DRIFT] = fixes.velocity_drift**2 * fresh * _I3
    return Q


def _in_i(C: Array, axes: Axes | None) -> Array:
    """Covariance (3, 3) in i of noise of variance 1 of each sensor."""
    return _I3 if axes is None else C @ spread(axes) @ C.T


def shown(
    method: str, record: Record, states: Sequence[State], notes: Notes, options: VectorOptions
) -> Matching:
    """The states at all points as an answer."""
    elapsed = record.t - record.t[0]
    r_i = np.array([s.r for s in states])
    C_nb, C_ni = attitude_in_n(np.array([s.C for s in states]), r_i, elapsed)
    about_i = np.array([s.P[PSI, PSI] for s in states])
    return Matching(
        method,
        record.t,
        np.cumsum(record.at_fix, dtype=np.int64),
        record.at_fix,
        corrected=np.array(notes.corrected),
        C_nb=Rotation.from_matrix(C_nb),
        covariance=C_ni @ about_i @ np.swapaxes(C_ni, 1, 2),
        position=np.einsum("kji,kj->ki", C_ie(elapsed), r_i),
        differences=np.array(notes.differences),
        doubts=tuple(notes.doubts),
        rule=options.rule,
    )
