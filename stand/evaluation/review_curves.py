"""Tracks and innovations of the methods as curves for the review."""

from collections.abc import Callable, Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from alignment import ESTIMATORS, Dwell, Options, Site
from alignment.against_truth import angle_errors
from alignment.angles import angles_from_C_nb, near_singular
from alignment.arrays import Array
from alignment.estimate import AttitudeTrack, angle_sigmas, determined
from alignment.methods.fine import Innovations
from stand.evaluation.score import of_each
from stand.recording.curves import AngleCurves, InnovationCurves

TrueAt = Callable[[str, Array], Rotation]
"""True attitude in a stretch, by its label, at times [s]: one, or one for each of them."""


def method_curves(
    methods: Sequence[str],
    dwells: Sequence[Dwell],
    attitudes: Sequence[Rotation],
    true_at: TrueAt,
    site: Site,
    options: Options,
) -> list[AngleCurves]:
    """Every track that the methods have; `attitudes` are at the dwells' ends."""
    at_end = {d.label: C for d, C in zip(dwells, attitudes, strict=True)}
    return [
        curves(track, true_at(track.label, track.t))
        for method in methods
        if (make := ESTIMATORS[method].tracks) is not None
        for _, made in of_each(make, method, dwells, site, options)
        for track in made
        if not singular(track, at_end[track.label])
    ]


def method_innovations(
    methods: Sequence[str], dwells: Sequence[Dwell], site: Site, options: Options
) -> list[InnovationCurves]:
    """The innovations of the methods, of each stretch that they do not refuse."""
    return [
        innovation_curves(method, dwell, found)
        for method in methods
        if (make := ESTIMATORS[method].innovations) is not None
        for dwell, found in of_each(make, method, dwells, site, options)
    ]


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
