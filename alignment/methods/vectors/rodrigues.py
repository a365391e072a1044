"""[S2]'s Rodrigues-Hamilton parameters, formula by formula, beside what they abbreviate.

Parameters are quaternions (..., 4) in the house's order l1, l2, l3, l0 (x, y, z, w); they take body
axes to start axes (north, up, east). Angles [rad]: pitch th about Z1, yaw ps about Y1 (up), roll
ga about X1, turned in the order yaw, pitch, roll. Source: [S2] (1)-(4), methods.md section 4.
"""

import numpy as np
from numpy.typing import ArrayLike
from scipy.integrate import cumulative_simpson
from scipy.spatial.transform import Rotation

from alignment.arrays import Array
from alignment.quaternions import multiply, normalised

_CONJUGATE = np.array([-1.0, -1.0, -1.0, 1.0])


def orientation_matrix(q: ArrayLike) -> Array:
    """[S2] (1): the matrix (..., 3, 3) of Rodrigues-Hamilton parameters of norm one.

    Rows ``l0^2 + l1^2 - l2^2 - l3^2, 2 (l1 l2 - l0 l3), 2 (l1 l3 + l0 l2)`` and so on round. Of
    another norm n it is n^2 times a rotation.
    """
    l1, l2, l3, l0 = np.moveaxis(np.asarray(q, dtype=float), -1, 0)
    rows = [
        [l0**2 + l1**2 - l2**2 - l3**2, 2 * (l1 * l2 - l0 * l3), 2 * (l1 * l3 + l0 * l2)],
        [2 * (l1 * l2 + l0 * l3), l0**2 - l1**2 + l2**2 - l3**2, 2 * (l2 * l3 - l0 * l1)],
        [2 * (l1 * l3 - l0 * l2), 2 * (l2 * l3 + l0 * l1), l0**2 - l1**2 - l2**2 + l3**2],
    ]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


def from_half_angles(roll: ArrayLike, yaw: ArrayLike, pitch: ArrayLike) -> Array:
    """[S2], start: parameters (..., 4) from half angles, of norm one.

    With c and s of half of pitch, yaw and roll in this order: ``l0 = c c c - s s s``,
    ``l1 = c c s + s s c``, ``l2 = c s c + s c s``, ``l3 = s c c - c s s``. The printed signs are
    damaged; these make (1) the product of the three turns.
    """
    ct, cp, cg = (np.cos(np.asarray(a) / 2) for a in (pitch, yaw, roll))
    st, sp, sg = (np.sin(np.asarray(a) / 2) for a in (pitch, yaw, roll))
    parts = [
        ct * cp * sg + st * sp * cg,
        ct * sp * cg + st * cp * sg,
        st * cp * cg - ct * sp * sg,
        ct * cp * cg - st * sp * sg,
    ]
    return np.stack(np.broadcast_arrays(*parts), axis=-1)


def start_error(angles: Array, errors: Array) -> Array:
    """[S2], start: error (..., 4) of the parameters by errors of roll, yaw, pitch (..., 3)."""
    wrong = from_half_angles(*np.moveaxis(angles + errors, -1, 0))
    return wrong - from_half_angles(*np.moveaxis(angles, -1, 0))


def kinematics(q: Array, w_b: Array) -> Array:
    """[S2], ``2 l' = W(w) l``: time derivative (..., 4) under body rates (..., 3) [rad/s]."""
    return 0.5 * multiply(q, np.concatenate([w_b, np.zeros((*w_b.shape[:-1], 1))], axis=-1))


def corrected_norm(q: Array, threshold: float) -> Array:
    """[S2], norm: parameters (..., 4) brought to one where their norm is off by more.

    The paper corrects when the norm "considerably" leaves one; `threshold` 0 corrects always, as
    `alignment.quaternions.normalised` does. What is not corrected scales the matrix by the norm
    squared, and turns nothing.
    """
    off = np.abs(np.linalg.norm(q, axis=-1) - 1) > threshold
    return np.where(off[..., None], normalised(q), q)


def integrated(q0: Array, w_b: Array, step: float, threshold: float) -> tuple[Array, int]:
    """[S2], the channel: parameters (n + 1, 4) under rates (n, 3) held over `step` [s] each.

    Runge-Kutta of the fourth order; how often the norm was corrected comes along.
    """
    q, corrected = np.empty((len(w_b) + 1, 4)), 0
    q[0] = q0
    for k, w in enumerate(w_b):
        k1 = kinematics(q[k], w)
        k2 = kinematics(q[k] + step / 2 * k1, w)
        k3 = kinematics(q[k] + step / 2 * k2, w)
        k4 = kinematics(q[k] + step * k3, w)
        q[k + 1] = q[k] + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        if abs(np.linalg.norm(q[k + 1]) - 1) > threshold:
            q[k + 1], corrected = normalised(q[k + 1]), corrected + 1
    return q, corrected


def error_as_printed(t: Array, q: Array, dw_b: Array, start: Array) -> Array:
    """[S2], ``dl(t) = dl(t0) + 1/2 int W(dw) l dt`` as printed: (n, 4).

    Parameters
    ----------
    t : (n,) s
        Evenly spaced, three or more.
    q : (n, 4)
        The true parameters.
    dw_b : (n, 3) rad/s
        Errors of the rates.
    start : (4,)
        Error at the start.

    Notes
    -----
    The term ``W(w) dl`` of the equation of errors is not in it: an error made before a turn is
    not turned along. Right while the turn since the start is small; see `error_carried`.
    """
    made = kinematics(q, dw_b)
    return start + cumulative_simpson(made, x=t, axis=0, initial=np.zeros((1, 4)))


def error_carried(t: Array, q: Array, dw_b: Array, start: Array) -> Array:
    """The same by the transition matrix: every error goes on with the turn after it, (n, 4).

    ``dl(t) = [dl(t0) l(t0)* + 1/2 int l dw l* ds] l(t)``, products of quaternions; first order in
    the errors.
    """
    made = multiply(kinematics(q, dw_b), q * _CONJUGATE)
    first = multiply(start, q[0] * _CONJUGATE)
    return multiply(first + cumulative_simpson(made, x=t, axis=0, initial=np.zeros((1, 4))), q)


def turn_of(q: Array, dq: Array) -> Array:
    """Small rotation about start axes (..., 3) [rad] of an error of parameters."""
    return 2 * multiply(dq, q * _CONJUGATE)[..., :3]


def rotation_of(q: Array) -> Rotation:
    """The parameters as rotations."""
    return Rotation.from_quat(q)


def variations(dr: Array, v: Array, error_dr: Array, error_v: Array) -> Array:
    """[S2] (2)-(4): isochronous variations of J1 = ``|v|``, J2 = ``|dr|``, J3 = ``|dr x v|``.

    ``dJ1 = v.dv/|v|``, ``dJ2 = dr.d(dr)/|dr|``, ``dJ3 = c.(d(dr) x v + dr x dv)/|c|``;
    all (..., 3), the result by J1, J2, J3. First order: the square of an error across
    its vector is left out.
    """
    c = np.cross(dr, v)
    changes = (error_v, error_dr, np.cross(error_dr, v) + np.cross(dr, error_v))
    parts = [
        np.sum(vector * change, axis=-1) / np.linalg.norm(vector, axis=-1)
        for vector, change in zip((v, dr, c), changes, strict=True)
    ]
    return np.stack(parts, axis=-1)
