"""Tracks and innovations of the methods as curves for the review."""

import numpy as np
from scipy.spatial.transform import Rotation

from alignment import Dwell
from alignment.against_truth import angle_errors
from alignment.angles import angles_from_C_nb, near_singular
from alignment.estimate import AttitudeTrack, angle_sigmas, determined
from alignment.methods.fine import Innovations
from stand.recording.curves import AngleCurves, InnovationCurves


def innovation_curves(method: str, dwell: Dwell, found: Innovations) -> InnovationCurves:
    t_ns = np.round(found.t * 1e9).astype(np.int64)
    return InnovationCurves(
        method=method, label=dwell.label, t_ns=t_ns, values=found.values, sigmas=found.sigmas
    )


def singular(track: AttitudeTrack, C_nb: Rotation) -> bool:
    """Whether the track's angles cannot be told apart where the unit stands."""
    return bool(near_singular(track.sequence, angles_from_C_nb(track.sequence, C_nb)))


def curves(track: AttitudeTrack, C_nb: Rotation) -> AngleCurves:
    """A track with its errors against the true attitude, for the review."""
    angles = angles_from_C_nb(track.sequence, track.C_nb)
    sigmas = angle_sigmas(track.sequence, angles, track.covariance)
    stands = determined(sigmas)
    turned = (C_nb.inv() * track.C_nb).as_rotvec()
    return AngleCurves(
        method=track.method,
        label=track.label,
        t_ns=np.round(track.t * 1e9).astype(np.int64),
        angles=np.where(stands, angles, np.nan),
        errors=np.where(stands, angle_errors(track.sequence, track.C_nb, C_nb), np.nan),
        sigmas=np.where(stands, np.nan_to_num(sigmas), np.nan),
        error_rotations=np.where(stands.all(axis=1, keepdims=True), turned, np.nan),
    )
