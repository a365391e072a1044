"""How a recording's estimate grows: what a method would have found had the readings ended there."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache

import numpy as np
from scipy.spatial.transform import Rotation

from alignment import DEFAULT_METHOD, ESTIMATORS, AttitudeEstimate, Dwell
from alignment.arrays import Array
from alignment.errors import AlignmentError
from alignment.estimate import AttitudeTrack
from alignment.quaternions import turned_evenly
from stand.errors import unknown
from stand.evaluation.review_curves import curves, singular
from stand.evaluation.score import Truths, answered, circular, of_each, suited
from stand.recording.curves import AngleCurves
from stand.recording.entrance import open_log
from stand.recording.log import Log
from stand.recording.metadata import epoch_of
from stand.table.kinematics import C_NW

POINTS = 90  # over all stretches, of a method that has no tracks of its own
LEAST_POINTS = 6  # of each of them

Reference = Callable[[AttitudeTrack], Rotation]


def growing(log: Log, method: str | None = None) -> list[AngleCurves]:
    """The angles of one method over time, a curve per stretch.

    Parameters
    ----------
    log : Log
    method : str, optional
        Else the first of the recording's own that answers, or triad.

    Returns
    -------
    list of AngleCurves
        `errors` against the truth; where nobody knows it, against what the stretch came to in the
        end. Empty where no method answers.

    Raises
    ------
    StandError
        There is no such method.
    AlignmentError
        `method` does not answer.
    """
    if method is not None:
        if method not in ESTIMATORS:
            raise unknown("method", method, ESTIMATORS)
        return _curves(log, _tracks(method, log))
    for name in (*log.methods, DEFAULT_METHOD):
        try:
            tracks = _tracks(name, log) if name in ESTIMATORS else []
        except AlignmentError:
            continue
        if tracks:
            return _curves(log, tracks)
    return []


def tracked(log: Log, methods: Sequence[str]) -> list[AngleCurves]:
    """Every track of the methods against the truth of a recorded run.

    The truth is that of each time: a base that rocks is not where it will be in the end.
    """
    at_end = {d.label: truth.C_nb for d, truth in zip(log.dwells, log.truths, strict=True)}
    tracks = [
        track
        for method in methods
        if (make := ESTIMATORS[method].tracks) is not None
        for _, made in of_each(make, method, log.dwells, log.site, log.options)
        for track in made
    ]
    return _curves(
        log,
        [t for t in tracks if (C := at_end[t.label]) is not None and not singular(t, C)],
    )


def _curves(log: Log, tracks: Sequence[AttitudeTrack]) -> list[AngleCurves]:
    reference = _reference(log)
    return [curves(track, reference(track)) for track in tracks if len(track.t)]


def _tracks(method: str, log: Log) -> list[AttitudeTrack]:
    dwells = suited(method, log.dwells)
    make = ESTIMATORS[method].tracks
    if make is None:
        points = max(LEAST_POINTS, POINTS // len(dwells))
        found = [_grown(method, dwells[: k + 1], log, points) for k in range(len(dwells))]
        return [track for track in found if track is not None]
    made = of_each(make, method, dwells, log.site, log.options)
    made = made or [(dwells[0], make(dwells[0], log.site, log.options))]  # which says why not
    tracks = [track for _, own in made for track in own]
    windows = ESTIMATORS[method].windows
    zero = {f"{method} {name}" for name, window in windows.items() if window.circular}
    return [track for track in tracks if track.method not in zero]


def _grown(method: str, dwells: Sequence[Dwell], log: Log, points: int) -> AttitudeTrack | None:
    """Estimates of the last stretch, which ends sooner and later."""
    last = dwells[-1]
    found: list[tuple[float, AttitudeEstimate]] = []
    for t in np.linspace(last.t_from, last.t_to, points + 1)[1:]:
        so_far = [*dwells[:-1], replace(last, t_to=float(t))]
        estimates, _ = answered(method, so_far, log.site, log.options)
        own = [e for e in estimates if e.label == last.label and _whole(e)]
        found += [(float(t), e) for e in own[-1:]]
    if not found:
        return None
    return AttitudeTrack(
        method=method,
        label=last.label,
        t=np.array([t for t, _ in found]),
        C_nb=Rotation.concatenate([e.C_nb for _, e in found if e.C_nb is not None]),
        sequence=found[-1][1].sequence,
        covariance=np.array([e.covariance for _, e in found]),
    )


def _whole(e: AttitudeEstimate) -> bool:
    return e.C_nb is not None and e.covariance is not None and not circular(e)


def _reference(log: Log) -> Reference:
    """What the attitudes of a track are set against."""
    truths = {d.label: (d, truth) for d, truth in zip(log.dwells, log.truths, strict=True)}
    true_at = cache(lambda: _true_at(log)) if log.simulated else None  # read where it is needed

    def reference(track: AttitudeTrack) -> Rotation:
        dwell, truth = truths.get(track.label, (None, Truths()))
        own = truth.of(track.method)
        turning = dwell is not None and dwell.turn is not None  # told at encoder angle zero
        if own is not None and (own is truth.mean or turning or truth.still):
            return own
        return track.C_nb[-1] if true_at is None else true_at()(track.t)

    return reference


def _true_at(log: Log) -> Callable[[Array], Rotation]:
    with open_log(log.path) as file:
        truth, origin = file.truth(), epoch_of(file.metadata)
    stamps = (truth.t_ns - origin) * 1e-9
    return lambda t: C_NW * turned_evenly(stamps, truth.q_wb, t)
