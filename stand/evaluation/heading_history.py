"""One run as it goes: heading error of each method over time, beside the sigma it claims.

Methods with tracks tell their attitude over time themselves. Of the others it is the estimate
that they would have given had the readings ended there.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from alignment import ESTIMATORS, AttitudeEstimate, Dwell, against_truth
from alignment.arrays import Array, set_owned
from alignment.estimate import AttitudeTrack, determined, heading_sigmas
from stand.evaluation.score import answered, circular, of_each
from stand.simulation.monte_carlo import Watched, watch
from stand.simulation.settings import Settings

POINTS = 48  # of a method that has no tracks of its own
STEEP = np.cos(np.radians(45.0))  # level part of X1 below which its heading means little


@dataclass(frozen=True, slots=True, eq=False)
class History:
    """Heading error and its sigma (m,) [rad] at times (m,) [s] of one stretch.

    Only where the heading is determined.

    `grown`: whether each point is an estimate from all readings up to then.
    """

    method: str
    label: str
    grown: bool
    t: Array
    error: Array
    sigma: Array

    def __post_init__(self) -> None:
        m = len(self.t)
        set_owned(self, **{n: (getattr(self, n), (m,), float) for n in ("t", "error", "sigma")})


def histories(settings: Settings, methods: Sequence[str]) -> list[History]:
    """Of the run with the settings' seed; a method that refuses has none."""
    run = watch(settings)
    return [found for method in methods for found in _of(method, run, settings)]


def _of(method: str, run: Watched, settings: Settings) -> list[History]:
    make = ESTIMATORS[method].tracks
    if make is None:
        dwells = list(filter(ESTIMATORS[method].suited, run.dwells))
        return list(_grown(method, dwells, run, settings))
    told = of_each(make, method, run.dwells, settings.site, settings.options)
    every = [_tracked(method, track, run) for _, tracks in told for track in tracks]
    return [history for history in every if len(history.t)]


def _tracked(method: str, track: AttitudeTrack, run: Watched) -> History:
    error, sigma = heading_error_over_time(track.C_nb, run.C_nb(track.t), track.covariance)
    good = np.isfinite(error)
    return History(
        method=method,
        label=track.label,
        grown=False,
        t=track.t[good],
        error=error[good],
        sigma=sigma[good],
    )


def _grown(
    method: str, dwells: Sequence[Dwell], run: Watched, settings: Settings
) -> Iterator[History]:
    """One history per stretch in which the readings end."""
    truth = {d.label: C for d, C in zip(run.dwells, run.attitudes, strict=True)}
    for k, dwell in enumerate(dwells):
        points = []
        for t in np.linspace(dwell.t_from, dwell.t_to, POINTS + 1)[1:]:
            so_far = [*dwells[:k], replace(dwell, t_to=float(t))]
            found, _ = answered(method, so_far, settings.site, settings.options)
            e = _latest(found, dwell.label)
            if e is not None:
                assert e.C_nb is not None
                C = e.C_nb.as_matrix()[None]
                true = _true(e, so_far, truth, run)
                error, sigma = heading_error_over_time(
                    Rotation.from_matrix(C), true, np.asarray(e.covariance)[None]
                )
                points.append((float(t), float(error[0]), float(sigma[0])))
        rows = np.array([p for p in points if np.isfinite(p[1])]).reshape(-1, 3)
        if len(rows):
            t, error, sigma = rows.T
            yield History(
                method=method, label=dwell.label, grown=True, t=t, error=error, sigma=sigma
            )


def _latest(found: Sequence[AttitudeEstimate], label: str) -> AttitudeEstimate | None:
    """The estimate of the stretch under way, else the last there is."""
    whole = [
        e for e in found if e.C_nb is not None and e.covariance is not None and not circular(e)
    ]
    own = [e for e in whole if e.label == label]
    return (own or whole or [None])[-1]


def _true(
    e: AttitudeEstimate, so_far: Sequence[Dwell], truth: dict[str, Rotation], run: Watched
) -> Rotation:
    """True attitude (1,) that an estimate is of: of a turn at encoder angle 0, else at its end."""
    dwell = next(d for d in so_far if d.label == e.label)
    if dwell.turn is not None:
        return Rotation.from_quat(truth[e.label].as_quat()[None])
    return run.C_nb(np.array([min(e.t_to, dwell.t_to)]))


def heading_error_over_time(
    C_nb: Rotation, true: Rotation, covariance: Array
) -> tuple[Array, Array]:
    """Heading errors (m,) of m attitudes and their sigmas [rad] by covariances (m, 3, 3).

    NaN where X1 is steeper than 45 deg, and where the heading is not determined.
    """
    level = np.hypot(*C_nb.apply([1.0, 0.0, 0.0]).T[:2])
    steep = level < STEEP
    error, sigma = against_truth.heading_errors(C_nb, true), heading_sigmas(C_nb, covariance)
    none = steep | ~determined(sigma)
    return np.where(none, np.nan, error), np.where(none, np.nan, sigma)
