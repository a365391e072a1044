"""The solution as printed in [S2]: three linear systems by Cramer's rule, and dJ/sqrt(3).

At a fix both channels form the increment dr of the radius vector, the velocity v, and c = dr x v,
in the axes of the start (north, east, down there, turning with the Earth), and the invariants
J1 = ``|v|``, J2 = ``|dr|``, J3 = ``|c|``. Where these differ, the inertial channel's vectors are
corrected by dJ/sqrt(3) on every axis, turned into body axes as unit vectors, and the rows of the
matrix solved from them and the satellites' unit vectors.

What it does: v and dr hold the start velocity and gravity, which did not pass through the matrix,
so that the matrix found turns one track into the other but is not the attitude. It stands here as
printed, with a covariance that says so.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from alignment.arrays import Array
from alignment.cross import cross_matrix
from alignment.methods.vectors import channel
from alignment.methods.vectors.channel import POS, POS_DRIFT, PSI, VEL, VEL_DRIFT, State
from alignment.methods.vectors.fixes import Matching, VectorOptions, check, joined
from alignment.navigation import W_IE_X, C_en, C_ie, geodetic
from alignment.readings import Fixes, ImuReadings

METHOD = "vectors printed"
WARNING = "velocities hold more than passed through the matrix: not its attitude"
_DEFECT = 0.1  # of the matrix's singular values from one: the channels' triads differ by some 6 deg
_PER_AXIS = np.ones(3) / np.sqrt(3.0)
_TILT, _SPEED, _LENGTH = 1e-6, 1e-4, 1e-2  # rad, m/s, m: steps of the correction's derivatives


@dataclass(frozen=True, slots=True, eq=False)
class Start:
    """The axes of the start, (3, 3) `C_es` from them to e, and the first fix `r_e` (3,)."""

    C_es: Array
    r_e: Array


def invariants(dr: Array, v: Array) -> Array:
    """J1 = ``|v|``, J2 = ``|dr|``, J3 = ``|dr x v|`` (..., 3)."""
    return np.stack([np.linalg.norm(a, axis=-1) for a in (v, dr, np.cross(dr, v))], axis=-1)


def sigma_about_velocity(dr: Array, v: Array, sigma_dr: float) -> float:
    """Predicted error [rad] about v of a matrix from dr and v: ``sigma / (|dr| sin(angle))``.

    Infinite where dr and v are collinear: only what lies across v fixes the turn about it.
    """
    across = float(np.linalg.norm(np.cross(dr, v)) / max(np.linalg.norm(v), 1e-300))
    return sigma_dr / across if across > 0 else float("inf")


def cramer(body: Array, start: Array) -> Array:
    """The matrix (..., 3, 3) whose rows solve ``body @ row = start[:, i]``, by Cramer's rule.

    `body`, `start` (..., 3, 3): the three unit vectors as rows, in body and in start axes. The
    result need not be a rotation.
    """
    shape = np.broadcast_shapes(body.shape, start.shape)
    matrix = np.empty(shape)
    for row in range(3):
        for column in range(3):
            replaced = np.broadcast_to(body, shape).copy()
            replaced[..., column] = start[..., row]
            matrix[..., row, column] = np.linalg.det(replaced)
    return matrix / np.linalg.det(body)[..., None, None]


def corrected_vectors(dr: Array, v: Array, differences: Array) -> tuple[Array, Array, Array]:
    """dr, v and c (..., 3) with dJ/sqrt(3) added to each axis, as printed.

    A vector along (1, 1, 1) is added: it changes the modulus by dJ cos(eps), with eps the angle to
    that diagonal, and turns the vector by dJ sin(eps) over its modulus.
    """
    dJ1, dJ2, dJ3 = np.moveaxis(differences[..., None], -2, 0)
    return dr + dJ2 * _PER_AXIS, v + dJ1 * _PER_AXIS, np.cross(dr, v) + dJ3 * _PER_AXIS


def printed(
    readings: ImuReadings, fixes: Fixes, C_nb0: Rotation, options: VectorOptions | None = None
) -> Matching:
    """Attitude and place by the published correction, wherever the invariants call for it.

    Parameters and errors as for `alignment.methods.vectors.kalman.kalman`.

    Notes
    -----
    Corrects where an invariant differs by ``options.correct_at`` sigma of its noise, and refuses
    where the predicted sigma about v, across it, or of the corrected attitude is above
    ``options.largest_sigma``, or where the matrix is no rotation by a tenth. The
    covariance is that of the correction as it is: its derivatives by every input, carried through
    all corrections. Second-order effects are beyond it. Source: [S2], methods.md section 4.
    """
    options = options or VectorOptions()
    check(fixes)
    latitude, longitude, _ = geodetic(fixes.position[0])
    start = Start(C_en(latitude, longitude), fixes.position[0])
    record = joined(readings, fixes, C_nb0, start.C_es, options)
    strides = channel.steps(record)
    state, count = channel.begun(record, fixes, options), 1
    states, notes = [state], channel.Notes()
    for k in range(len(record.t) - 1):
        elapsed = float(record.t[k] - record.t[0])
        state = channel.carried(state, strides, k, elapsed, fixes, record.priors)
        dJ, called, doubt = np.zeros(3), False, ""
        if record.at_fix[k + 1]:
            now = float(record.t[k + 1] - record.t[0])
            z = np.concatenate([record.r_i[count], record.v_i[count]])
            count += 1
            dJ, doubt = _judged(state, z, now, start, fixes, options)
            if not doubt:
                state, called, doubt = _applied(state, z, now, start, fixes, options)
        states.append(state)
        notes.add(called, dJ, doubt)
    return channel.shown(METHOD, record, states, notes, options)


def _vectors(r: Array, v: Array, elapsed: float, start: Start) -> tuple[Array, Array]:
    """dr and the velocity relative to the Earth (..., 3), in start axes, from those in i."""
    turn = C_ie(elapsed)
    r_e = r @ turn
    return (r_e - start.r_e) @ start.C_es, (v @ turn - r_e @ W_IE_X.T) @ start.C_es


def _judged(
    state: State, z: Array, now: float, start: Start, fixes: Fixes, options: VectorOptions
) -> tuple[Array, str]:
    """The invariants' differences, and why not to correct by them; '' to correct."""
    dr, v = _vectors(z[:3], z[3:], now, start)
    difference = invariants(dr, v) - invariants(*_vectors(state.r, state.v, now, start))
    speed, length = float(np.linalg.norm(v)), float(np.linalg.norm(dr))
    r_sigma = float(np.hypot(fixes.position_sigma, fixes.position_drift))
    v_sigma = float(np.hypot(fixes.velocity_sigma, fixes.velocity_drift))
    noise = np.array([v_sigma, r_sigma, np.hypot(speed * r_sigma, length * v_sigma)])
    if (np.abs(difference) <= options.correct_at * noise).all() and options.correct_at > 0:
        return difference, "invariants agree within their noise: nothing to correct"
    # both ends of dr are noisy
    about = sigma_about_velocity(dr, v, np.sqrt(2) * r_sigma)
    across = v_sigma / speed if speed > 0 else float("inf")
    if max(about, across) > options.largest_sigma:
        return difference, (
            f"refused: predicted sigma {np.degrees(about):.3g} deg about the velocity, "
            f"{np.degrees(across):.3g} deg across it"
        )
    return difference, ""


def _correction(
    C: Array, r: Array, v: Array, z: Array, now: float, start: Start
) -> tuple[Array, Array, Array, Array]:
    """The published correction by fixes `z` (..., 6), for one or many states.

    Returns ``C_ib`` made orthonormal, place and velocity in i, and the three singular values
    (..., 3) of the matrix that was made so.
    """
    dr, w = _vectors(r, v, now, start)
    dr_sat, v_sat = _vectors(z[..., :3], z[..., 3:], now, start)
    difference = invariants(dr_sat, v_sat) - invariants(dr, w)
    turn = C_ie(now)
    C_is = turn @ start.C_es
    dr, w, c = corrected_vectors(dr, w, difference)
    body = _units(dr, w, c) @ (C_is.T @ C)
    matrix = cramer(body, _units(dr_sat, v_sat, np.cross(dr_sat, v_sat)))
    U, sizes, Vt = np.linalg.svd(matrix)
    U[..., 2] *= np.linalg.det(U @ Vt)[..., None]
    r_e = start.r_e + dr @ start.C_es.T
    velocity = (w @ start.C_es.T + r_e @ W_IE_X.T) @ turn.T
    return C_is @ U @ Vt, r_e @ turn.T, velocity, sizes


def _units(*vectors: Array) -> Array:
    """Unit vectors (..., 3, 3) as rows."""
    rows = np.stack(vectors, axis=-2)
    return rows / np.linalg.norm(rows, axis=-1)[..., None]


def _applied(
    state: State, z: Array, now: float, start: Start, fixes: Fixes, options: VectorOptions
) -> tuple[State, bool, str]:
    """The corrected state with its covariance, by central differences of the correction.

    Or the state as it was, and why: the three systems give nothing like a rotation, or one that
    would be less sure than allowed.
    """
    C, r, v, sizes = _correction(state.C, state.r, state.v, z, now, start)
    if not np.abs(sizes - 1).max() < _DEFECT:
        return state, False, (
            f"refused: the three systems give no rotation (singular values {sizes[2]:.2g} to "
            f"{sizes[0]:.2g}): the inertial channel's dr and v do not fit the satellites'"
        )  # fmt: skip
    steps = np.repeat([_TILT, _SPEED, _LENGTH, _LENGTH, _SPEED], 3)
    x = np.concatenate([np.diag(steps), -np.diag(steps)])
    tilted = state.C + cross_matrix(x[:, PSI]) @ state.C
    after = _correction(tilted, state.r + x[:, POS], state.v + x[:, VEL], z + x[:, 9:], now, start)
    tilt = after[0] @ C.T
    psi = np.stack([tilt[:, i, j] - tilt[:, j, i] for i, j in ((2, 1), (0, 2), (1, 0))], axis=1) / 2
    outcome = np.concatenate([psi, after[2], after[1]], axis=1)
    J = ((outcome[:15] - outcome[15:]) / (2 * steps[:, None])).T
    A = np.eye(len(state.P))
    A[:9, :9] = J[:, :9]
    A[:9, POS_DRIFT], A[:9, VEL_DRIFT] = -J[:, 9:12], -J[:, 12:]  # a fix errs by minus their errors
    R = np.repeat(np.square([fixes.position_sigma, fixes.velocity_sigma]), 3)
    P = A @ state.P @ A.T
    P[:9, :9] += (J[:, 9:] * R) @ J[:, 9:].T
    sigma = float(np.sqrt(np.linalg.eigvalsh(P[PSI, PSI])[-1]))
    if sigma > options.largest_sigma:
        doubt = f"refused: the correction would leave a sigma of {np.degrees(sigma):.3g} deg"
        return state, False, doubt
    return replace(state, C=C, r=r, v=v, P=P), True, WARNING
