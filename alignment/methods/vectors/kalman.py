"""The rival: a Kalman filter of the inertial channel's errors, corrected by every fix."""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.special import chdtrc

from alignment.arrays import Array
from alignment.errors import AlignmentError
from alignment.methods.vectors import channel
from alignment.methods.vectors.channel import (
    ACCEL,
    GYRO,
    MORE,
    POS,
    POS_DRIFT,
    PSI,
    VEL,
    VEL_DRIFT,
    Notes,
    Path,
    State,
    Strides,
)
from alignment.methods.vectors.fixes import Matching, Record, VectorOptions, check, joined
from alignment.navigation import C_en, geodetic
from alignment.readings import Fixes, ImuReadings
from alignment.units import DEG

METHOD = "vectors kalman"
DISAGREE = "fixes and readings disagree beyond their noise"
LINEAR = 5.5 * DEG  # of attitude: from 6 on, errors over sigmas squared are 3 to 70 per freedom
UNLIKELY = 1e-6  # a disagreement of less chance than this is flagged


def kalman(
    readings: ImuReadings, fixes: Fixes, C_nb0: Rotation, options: VectorOptions | None = None
) -> Matching:
    """Attitude, place and biases by an extended Kalman filter on positions and velocities.

    Parameters
    ----------
    readings : ImuReadings
        Without gaps, from the first fix to the last.
    fixes : Fixes
        Two or more.
    C_nb0 : Rotation
        Programmed attitude at the first fix; wrong by ``options.attitude_sigma`` about each axis.
    options : VectorOptions

    Raises
    ------
    AlignmentError
        The attitude's sigma was ever beyond `LINEAR`.
    TooShort, PoleError

    Notes
    -----
    21 states: attitude, velocity, place, gyro and accelerometer bias, correlated satellite errors
    (none of the last where ``fixes`` states none); and one for every other error of the unit that
    the priors state: scale, axes that are off, g-sensitivity, the shapes of drifts in time. It runs
    twice: covariances that follow changing estimates learn what no fix tells, so the second run
    carries them along the one path that the first ends with; later fixes enter earlier answers by
    that alone, in second order. Leading error: accelerometer bias b/g in tilt until turns separate
    them; heading only by horizontal acceleration; a gyro's scale error times the angle turned.
    Source: methods.md section 4, the tuned filter.
    """
    options = options or VectorOptions()
    record, states, notes = filtered(readings, fixes, C_nb0, options)
    sigmas = np.sqrt(np.linalg.eigvalsh([s.P[PSI, PSI] for s in states])[:, -1])
    if sigmas.max() > LINEAR:
        raise AlignmentError(
            f"refused: a sigma of {np.degrees(sigmas.max()):.2g} deg about one axis, by start and "
            f"gyro biases before the fixes tell more: a linear filter takes {LINEAR / DEG:g}"
        )
    return channel.shown(METHOD, record, states, notes, options)


def filtered(
    readings: ImuReadings, fixes: Fixes, C_nb0: Rotation, options: VectorOptions
) -> tuple[Record, list[State], Notes]:
    """The filter's states at all points, biases and covariances among them; as `kalman`."""
    check(fixes)
    latitude, longitude, _ = geodetic(fixes.position[0])
    record = joined(readings, fixes, C_nb0, C_en(latitude, longitude), options)
    strides = channel.steps(record)
    states, _ = _run(record, strides, None, fixes, options)
    path = channel.path_to(strides, states[-1])
    return record, *_run(record, strides, path, fixes, options)


def _run(
    record: Record, strides: Strides, path: Path | None, fixes: Fixes, options: VectorOptions
) -> tuple[list[State], Notes]:
    """The filter's states at all points, covariances along the path or along themselves."""
    state, seen = channel.begun(record, fixes, options), 1
    R = np.repeat(np.square([fixes.position_sigma, fixes.velocity_sigma]), 3)
    states, notes, misfit = [state], channel.Notes(), 0.0
    for k in range(len(record.t) - 1):
        elapsed = float(record.t[k] - record.t[0])
        state = channel.carried(state, strides, k, elapsed, fixes, record.priors, path)
        doubt, at_fix = "", bool(record.at_fix[k + 1])
        if at_fix:
            z = np.concatenate([record.r_i[seen], record.v_i[seen]])
            state, distance = updated(state, z, R)
            seen, misfit = seen + 1, misfit + distance
            doubt = _doubt(state, misfit, 6 * (seen - 1), options)
        states.append(state)
        notes.add(at_fix, np.zeros(3), doubt)
    return states, notes


def updated(state: State, z: Array, R: Array) -> tuple[State, float]:
    """After a fix `z` (6,), place and velocity in i, of variance `R` (6,); Mahalanobis distance."""
    H = np.zeros((6, len(state.P)))
    H[:3, POS] = H[3:, VEL] = H[:3, POS_DRIFT] = H[3:, VEL_DRIFT] = np.eye(3)
    innovation = z - np.concatenate([state.r + state.r_drift, state.v + state.v_drift])
    S = H @ state.P @ H.T + np.diag(R)
    K = np.linalg.solve(S, H @ state.P).T
    x = K @ innovation
    keep = np.eye(len(state.P)) - K @ H
    P = keep @ state.P @ keep.T + (K * R) @ K.T
    corrected = replace(
        state,
        C=Rotation.from_rotvec(x[PSI]).as_matrix() @ state.C,
        v=state.v + x[VEL],
        r=state.r + x[POS],
        gyro=state.gyro + x[GYRO],
        accel=state.accel + x[ACCEL],
        r_drift=state.r_drift + x[POS_DRIFT],
        v_drift=state.v_drift + x[VEL_DRIFT],
        more=state.more + x[MORE],
        P=P,
    )
    return corrected, float(innovation @ np.linalg.solve(S, innovation))


def _doubt(state: State, misfit: float, count: int, options: VectorOptions) -> str:
    sigma = float(np.sqrt(np.linalg.eigvalsh(state.P[PSI, PSI])[-1]))
    if sigma > options.largest_sigma:
        return f"sigma of {np.degrees(sigma):.2f} deg about one axis"
    if sigma > 0.9 * options.attitude_sigma:
        return "about one axis no surer than the programmed attitude: too little acceleration"
    return DISAGREE if chdtrc(count, misfit) < UNLIKELY else ""
