"""The six-position test: attitude at rest without integrating a gyro.

Source: [S0], methods.md section 1. Per position: zero offset = mean over the first seconds minus
what the nominal orientation must give; then level, and read yaw from the horizontal rates.
"""

from collections.abc import Sequence as Ordered

import numpy as np
from scipy.spatial.transform import Rotation

from alignment.angles import Sequence
from alignment.around import by_direction
from alignment.arrays import Array
from alignment.doubts import heading_doubt
from alignment.earth import Site
from alignment.estimate import AttitudeEstimate, AttitudeTrack
from alignment.gains import Answer, after_offset, compass_gain, from_b
from alignment.information import Stretch
from alignment.information.drift import in_the_mean
from alignment.levelling import attitude_covariance, attitude_from_means
from alignment.misplaced import misplaced
from alignment.noise import (
    believed,
    check_at_rest,
    faint_doubt,
    gap_doubt,
    mean_and_variance,
    mean_variance,
    rest_doubt,
)
from alignment.nominal import (
    TRACK_LEAD,
    ZeroOffset,
    nominal_attitude,
    placed_and_rocked,
    sequence_of,
    track_ends,
    zero_offset,
)
from alignment.options import Options, Priors
from alignment.readings import Dwell, ImuReadings
from alignment.rocked import rocked_doubt
from alignment.saturation import saturation_doubt

METHOD = "six-position"


def _corrected_attitude(
    readings: ImuReadings, offset: ZeroOffset, sequence: Sequence, site: Site
) -> Rotation:
    w = readings.w_ib_b.mean(axis=0) - offset.values[:3]
    f = readings.f_b.mean(axis=0) - offset.values[3:]
    return site.plumb * attitude_from_means(w, f, sequence)


def _drift_variances(priors: Priors, window: float, later: float) -> Array:
    """By how much (6,) biases of a `later` window [s] differ from those of the offset's `window`.

    Twice the squared Allan deviation, which is the definition of that; turn-on biases and scale
    errors act alike in both windows and cancel.
    """
    p = priors
    plateau = np.repeat([p.gyro_instability, p.accel_instability], 3)
    walk = np.repeat([p.gyro_random_walk, p.accel_random_walk], 3)
    ramp = np.repeat([p.gyro_ramp, p.accel_ramp], 3)
    both = window + later
    return np.asarray(2 * plateau**2 + both / 3 * walk**2 + (both / 2 * ramp) ** 2)


def six_position(dwells: Ordered[Dwell], site: Site, options: Options) -> list[AttitudeEstimate]:
    """Same-window and fresh-window attitudes of each dwell.

    Parameters
    ----------
    dwells : sequence of Dwell
        At rest, each longer than the offset window. A dwell without a nominal attitude is taken
        for the nearest of the six positions at heading zero, and flagged.
    site : Site
        ``latitude`` needed, not at a pole.
    options : Options
        `offset_window`, `rule`; `priors`: placement of the table and the biases' instability enter
        the covariance; turn-on biases and scale errors go with the offsets.

    Returns
    -------
    list of AttitudeEstimate
        Per dwell: window 'same' (from the identical samples that gave the offset: zero error by
        construction, no covariance), then 'fresh' (all later samples), where there are any.

    Raises
    ------
    AlignmentError, NotAtRest, TooShort, PoleError

    Notes
    -----
    Leading errors, fresh: yaw ``ARW sqrt(1/T0 + 1/T1)/(W cos lat)``; tilt likewise with VRW/g;
    drift of the biases since the offset window, ``sqrt(2) ADEV/(W cos lat)``; the table's own
    azimuth and tilt errors enter 1:1. Source: [S0], methods.md section 1.
    """
    return [estimate for dwell in dwells for estimate in _one_position(dwell, site, options)]


def _one_position(dwell: Dwell, site: Site, options: Options) -> list[AttitudeEstimate]:
    check_at_rest(dwell)
    nominal = nominal_attitude(dwell)
    assumed = ("nominal attitude assumed: nearest position, heading 0",)
    flags = gap_doubt(dwell.window()) + saturation_doubt(dwell.label, dwell.window())
    flags += () if dwell.nominal is not None else assumed
    sequence = sequence_of(nominal, options.rule)
    offset = zero_offset(dwell, nominal, site, options.offset_window, options.priors)
    G = compass_gain(site)
    t_offset = dwell.t_from + options.offset_window

    same = dwell.window(0.0, options.offset_window)
    C_nb = _corrected_attitude(same, offset, sequence, site)
    zero = ("same samples gave the offset: zero by construction",)
    estimates = [
        AttitudeEstimate(
            METHOD, dwell.label, dwell.t_from, t_offset, C_nb, sequence, "same", flags=flags + zero
        )
    ]
    if len(dwell.readings.between(t_offset, dwell.t_to)) < 2:
        return estimates
    fresh = dwell.window(options.offset_window)
    C_nb = _corrected_attitude(fresh, offset, sequence, site)
    _, variances = mean_and_variance(fresh)
    variances = believed(variances, fresh, options.priors.gyro_walk, options.priors.accel_walk)
    later = dwell.t_to - t_offset
    drifts = _drift_variances(options.priors, options.offset_window, later)
    variances = variances + offset.variances + drifts
    G = G * [[1.0], [1.0], [_weaker(fresh, offset, C_nb, site)]]
    covariance = _on_the_circle(nominal, variances, G, site)
    covariance = covariance + placed_and_rocked(dwell, nominal, options.priors)
    begun = in_the_mean(options.priors, dwell.t_from, options.offset_window)
    beyond, told = misplaced(offset, nominal, site, begun)
    covariance = covariance + beyond
    estimates.append(
        AttitudeEstimate(
            METHOD,
            dwell.label,
            t_offset,
            dwell.t_to,
            C_nb=C_nb,
            sequence=sequence,
            window="fresh",
            covariance=site.about_n(covariance),
            flags=flags
            + told
            + heading_doubt(covariance)
            + rest_doubt(fresh)
            + rocked_doubt(dwell.window())
            + faint_doubt(fresh, options.priors),
        )
    )
    return estimates


def _on_the_circle(nominal: Rotation, variances: Array, G: Array, site: Site) -> Array:
    """Covariance about n (3, 3) by `variances` (6,) of means in b, however far they turn it."""
    covariance = attitude_covariance(nominal, variances, G)
    more = max(_around(nominal, variances, site) ** 2 - covariance[2, 2], 0.0)
    return covariance + np.diag([0.0, 0.0, more])


def _around(nominal: Rotation, variances: Array, site: Site) -> float:
    """Heading's root mean square [rad] on the whole circle, by `variances` (6,) of means in b.

    Rates that are off by as much as the Earth's along north turn it round, with none across.
    """
    C = (site.plumb.inv() * nominal).as_matrix()[:2]
    return by_direction(C * variances[:3] @ C.T / site.horizontal_rate() ** 2)


def _weaker(fresh: ImuReadings, offset: ZeroOffset, C_nb: Rotation, site: Site) -> float:
    """How much less surely a rate shows north that noise has made smaller than the Earth's."""
    w_n = (site.plumb.inv() * C_nb).apply(fresh.w_ib_b.mean(axis=0) - offset.values[:3])
    return max(1.0, site.horizontal_rate() / max(float(np.hypot(w_n[0], w_n[1])), 1e-12))


def six_position_tracks(dwell: Dwell, site: Site, options: Options) -> list[AttitudeTrack]:
    """The method's attitude as the data come in: the window so far, same and then fresh.

    Each point uses all samples of its window up to that time, so 'same' runs into zero at the
    end of the offset window and 'fresh' starts anew there.
    """
    nominal = nominal_attitude(dwell)
    offset = zero_offset(dwell, nominal, site, options.offset_window, options.priors)
    G = compass_gain(site)
    sequence = sequence_of(nominal, options.rule)
    same = dwell.window(0.0, options.offset_window)
    parts: list[tuple[str, ImuReadings, Array]] = [("same", same, np.zeros(6))]
    later = dwell.t_to - dwell.t_from - options.offset_window
    if later >= 2 * TRACK_LEAD:
        extra = offset.variances + _drift_variances(options.priors, options.offset_window, later)
        parts.append(("fresh", dwell.window(options.offset_window), extra))
    begun = in_the_mean(options.priors, dwell.t_from, options.offset_window)
    beyond, _ = misplaced(offset, nominal, site, begun)
    tracks = []
    for window, readings, extra in parts:
        ends = track_ends(readings)
        w = _means_up_to(readings.w_ib_b, ends) - offset.values[:3]
        f = _means_up_to(readings.f_b, ends) - offset.values[3:]
        whole = np.concatenate([mean_variance(readings.w_ib_b), mean_variance(readings.f_b)])
        whole = believed(whole, readings, options.priors.gyro_walk, options.priors.accel_walk)
        part = ends / len(readings)
        growth = 1 / part - 1 if window == "same" else 1 / part  # "same" ends at its own offset
        placed = placed_and_rocked(dwell, nominal, options.priors) + beyond
        covariance = [_on_the_circle(nominal, whole * g + extra, G, site) + placed for g in growth]
        tracks.append(
            AttitudeTrack(
                f"{METHOD} {window}",
                dwell.label,
                readings.t[ends - 1],
                site.plumb * attitude_from_means(w, f, sequence),
                sequence,
                site.about_n(np.array(covariance)),
            )
        )
    return tracks


def _means_up_to(values: Array, ends: np.ndarray) -> Array:
    """Means (m, k) of the first `ends` (m,) rows of `values` (n, k)."""
    starts = np.concatenate([[0], ends[:-1]])
    return np.cumsum(np.add.reduceat(values[: ends[-1]], starts, axis=0), axis=0) / ends[:, None]


def six_position_gains(stretches: Ordered[Stretch], site: Site, options: Options) -> list[Answer]:
    """Later samples less the zero offset of the first ones: what is constant cancels."""
    G = site.plumb.as_matrix() @ compass_gain(site)
    return after_offset(stretches, site, options, lambda later: from_b(G, later.C_pb), "fresh")
