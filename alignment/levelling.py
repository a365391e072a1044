"""Roll and pitch of an instrument at rest, from where its accelerometers see "up"."""

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from alignment.angles import C_N_NUE, Sequence
from alignment.arrays import Array


def level(f_b: ArrayLike, sequence: Sequence) -> tuple[Array, Array]:
    """Roll and pitch [rad] from specific force at rest.

    Parameters
    ----------
    f_b : (..., 3)
        Specific force, any unit.
    sequence : Sequence
        Order of turns the angles belong to.

    Notes
    -----
    yaw-pitch-roll: ``up_b = (sin th, cos th cos ph, -cos th sin ph)``; yaw-roll-pitch:
    ``up_b = (sin th cos ph, cos th cos ph, -sin ph)`` (methods.md section 0).
    Leading errors: accelerometer bias across gravity over g, b/g.
    """
    fx, fy, fz = np.moveaxis(np.asarray(f_b, dtype=float), -1, 0)
    if sequence is Sequence.YAW_PITCH_ROLL:
        return np.arctan2(-fz, fy), np.arctan2(fx, np.hypot(fy, fz))
    return np.arctan2(-fz, np.hypot(fx, fy)), np.arctan2(fx, fy)


def levelled(sequence: Sequence, roll: ArrayLike, pitch: ArrayLike) -> Rotation:
    """Rotation from b to the levelled frame: NUE turned by yaw alone."""
    if sequence is Sequence.YAW_PITCH_ROLL:
        return Rotation.from_euler("ZX", np.stack([pitch, roll], axis=-1))
    return Rotation.from_euler("XZ", np.stack([roll, pitch], axis=-1))


def attitude_from_means(w_ib_b: ArrayLike, f_b: ArrayLike, sequence: Sequence) -> Rotation:
    """``C_nb`` from mean rate and mean specific force (..., 3) at rest, without integration.

    Levels by `level`, turns the rates into the horizontal plane and reads
    ``psi = atan2(w_Z, w_X)`` there ([S0] step 6). Any common factor of either vector cancels.
    """
    roll, pitch = level(f_b, sequence)
    to_levelled = levelled(sequence, roll, pitch)
    w_levelled = to_levelled.apply(np.array(w_ib_b, dtype=float))
    yaw = np.arctan2(w_levelled[..., 2], w_levelled[..., 0])
    return C_N_NUE * Rotation.from_euler("Y", yaw[..., None]) * to_levelled


def attitude_sensitivity(w_horizontal: float, w_up: float, gravity: float) -> Array:
    """Matrix (3, 6): small rotation about n [rad] per (rate error, force error) in n.

    Parameters
    ----------
    w_horizontal, w_up : float
        Horizontal and upward Earth rate [rad/s].
    gravity : float
        [m/s^2].

    Notes
    -----
    ``eta_N = -df_E/g``, ``eta_E = df_N/g``, ``eta_D = -dw_E/(W cos lat) + tan(lat) df_E/g``:
    methods.md section 2, full-vector form; first order.
    """
    G = np.zeros((3, 6))
    G[0, 4] = -1 / gravity
    G[1, 3] = 1 / gravity
    G[2, 1] = -1 / w_horizontal
    G[2, 4] = w_up / w_horizontal / gravity
    return G


def attitude_covariance(C_nb: Rotation, errors_b: Array, G: Array) -> Array:
    """Covariance (3, 3) about n from variances (6,) of mean rates and forces in b, or from their
    covariance (6, 6)."""
    R = C_nb.as_matrix()
    in_b = np.diag(errors_b) if errors_b.ndim == 1 else errors_b
    to_n = np.concatenate([G[:, :3] @ R, G[:, 3:] @ R], axis=1)
    return to_n @ in_b @ to_n.T
