"""The six-position test: attitude at rest without integrating a gyro.

Source: [S0], methods.md section 1. Per position: zero offset = mean over the first seconds minus
what the nominal orientation must give; then level, and read yaw from the horizontal rates.
"""

from collections.abc import Sequence as Ordered
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from alignment.angles import C_nb_from_angles, Sequence, SequenceRule
from alignment.arrays import Array
from alignment.earth import Site
from alignment.errors import AlignmentError, TooShort
from alignment.estimate import AttitudeEstimate, AttitudeTrack
from alignment.levelling import attitude_covariance, attitude_from_means, attitude_sensitivity
from alignment.noise import check_at_rest, gap_doubt, mean_and_variance, mean_variance
from alignment.options import Options, Priors
from alignment.readings import Dwell, ImuReadings
from alignment.saturation import saturation_doubt

METHOD = "six-position"

# [S0], methods.md section 1: roll, yaw, pitch in degrees, by yaw-pitch-roll
SIX_POSITIONS = {
    "X1 up": (0.0, 0.0, 90.0),
    "X1 down": (0.0, 0.0, -90.0),
    "Y1 up": (0.0, 0.0, 0.0),
    "Y1 down": (-180.0, 0.0, 0.0),
    "Z1 up": (-90.0, 0.0, 0.0),
    "Z1 down": (90.0, 0.0, 0.0),
}

WRONG_POSITION = np.radians(5.0)  # table errors are arc minutes, accelerometer biases 87 mg here
TRACK_STEP = 0.5  # s between points of a track
TRACK_LEAD = 1.0  # s of data behind a track's first point


@dataclass(frozen=True, slots=True, eq=False)
class ZeroOffset:
    """Offsets (6,) of rates [rad/s] and forces [m/s^2], and the variances (6,) of their means."""

    values: Array
    variances: Array


def nominal_attitude(dwell: Dwell) -> Rotation:
    """What the table was told, or the nearest of the six positions at heading zero.

    Raises
    ------
    AlignmentError
        Nobody said the nominal attitude and no axis is within 5 deg of the vertical.
    """
    if dwell.nominal is not None:
        return dwell.nominal
    up = dwell.window().f_b.mean(axis=0)
    up = up / np.linalg.norm(up)
    candidates = [
        C_nb_from_angles(Sequence.YAW_PITCH_ROLL, *np.radians(angles))
        for angles in SIX_POSITIONS.values()
    ]
    nearness = [C.inv().apply([0, 0, -1]) @ up for C in candidates]
    best = int(np.argmax(nearness))
    if nearness[best] < np.cos(WRONG_POSITION):
        raise AlignmentError(
            f"{dwell.label}: no instrument axis is within 5 deg of the vertical (up in b = "
            f"{up[0]:+.3f} {up[1]:+.3f} {up[2]:+.3f}): not one of the six positions"
        )
    return candidates[best]


def nominal_readings(nominal: Rotation, site: Site) -> Array:
    """What perfect sensors at rest at that attitude give, (6,): rates and forces."""
    C_bn = nominal.inv()
    return np.concatenate([C_bn.apply(site.w_ie_n), C_bn.apply(site.f_n)])


def zero_offset(dwell: Dwell, nominal: Rotation, site: Site, window: float) -> ZeroOffset:
    """Mean over the first `window` seconds minus the nominal readings ([S0] steps 2, 3)."""
    if dwell.t_to - dwell.t_from < window - 1e-6:
        raise TooShort(
            f"{dwell.label}: {dwell.t_to - dwell.t_from:.1f} s of rest, "
            f"the zero offsets need {window:g} s"
        )
    means, variances = mean_and_variance(dwell.window(0.0, window))
    wanted = nominal_readings(nominal, site)
    _check_vertical(dwell.label, means[3:], wanted[3:])
    return ZeroOffset(means - wanted, variances)


def _check_vertical(label: str, measured: Array, wanted: Array) -> None:
    """Refuse readings of another position: the offset would swallow a whole g unremarked."""
    lean = np.arctan2(np.linalg.norm(np.cross(measured, wanted)), measured @ wanted)
    if lean > WRONG_POSITION:
        raise AlignmentError(
            f"{label}: the measured vertical is {np.degrees(lean):.1f} deg from that of the "
            f"nominal attitude (allowed {np.degrees(WRONG_POSITION):.0f}): another position?"
        )


def sequence_of(nominal: Rotation, rule: SequenceRule) -> Sequence:
    """The order of turns of a position, by its nominal attitude: one for all methods."""
    return rule.sequence_for(nominal.inv().apply([0.0, 0.0, -1.0]))


def _corrected_attitude(
    readings: ImuReadings, offset: ZeroOffset, sequence: Sequence, site: Site
) -> Rotation:
    w = readings.w_ib_b.mean(axis=0) - offset.values[:3]
    f = readings.f_b.mean(axis=0) - offset.values[3:]
    return site.plumb * attitude_from_means(w, f, sequence)


def placed_covariance(priors: Priors) -> Array:
    """Covariance (3, 3) [rad^2] of the true attitude about the nominal one: the table's errors."""
    return (priors.turn**2 + priors.seat**2 + priors.nominal**2) * np.eye(3)


def _drift_variances(priors: Priors) -> Array:
    """By how much (6,) biases of a later window differ from those of the offset's window.

    Twice the squared Allan deviation, which is the definition of that; turn-on biases and scale
    errors act alike in both windows and cancel.
    """
    plateau = np.repeat([priors.gyro_instability, priors.accel_instability], 3)
    return np.asarray(2 * plateau**2)


def _sensitivity(site: Site) -> Array:
    site.horizontal_rate()  # refuses poles
    w_n = site.w_ie_n
    return attitude_sensitivity(w_n[0], -w_n[2], site.gravity)


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
    offset = zero_offset(dwell, nominal, site, options.offset_window)
    G = _sensitivity(site)
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
    variances += offset.variances + _drift_variances(options.priors)
    covariance = attitude_covariance(nominal, variances, G) + placed_covariance(options.priors)
    estimates.append(
        AttitudeEstimate(
            METHOD,
            dwell.label,
            t_offset,
            dwell.t_to,
            C_nb,
            sequence,
            "fresh",
            covariance,
            flags=flags + heading_doubt(covariance),
        )
    )
    return estimates


def heading_doubt(covariance: Array) -> tuple[str, ...]:
    """A flag when heading is too unsure for first-order theory (sigma above 8 deg)."""
    sigma = float(np.degrees(np.sqrt(covariance[2, 2])))
    return ("heading sigma above 8 deg: beyond first order",) if sigma > 8.0 else ()


def six_position_tracks(dwell: Dwell, site: Site, options: Options) -> list[AttitudeTrack]:
    """The method's attitude as the data come in: the window so far, same and then fresh.

    Each point uses all samples of its window up to that time, so 'same' runs into zero at the
    end of the offset window and 'fresh' starts anew there.
    """
    nominal = nominal_attitude(dwell)
    offset = zero_offset(dwell, nominal, site, options.offset_window)
    G = _sensitivity(site)
    sequence = sequence_of(nominal, options.rule)
    same = dwell.window(0.0, options.offset_window)
    parts: list[tuple[str, ImuReadings, Array]] = [("same", same, np.zeros(6))]
    if dwell.t_to - dwell.t_from - options.offset_window >= 2 * TRACK_LEAD:
        extra = offset.variances + _drift_variances(options.priors)
        parts.append(("fresh", dwell.window(options.offset_window), extra))
    tracks = []
    for window, readings, extra in parts:
        ends = track_ends(readings)
        w = _means_up_to(readings.w_ib_b, ends) - offset.values[:3]
        f = _means_up_to(readings.f_b, ends) - offset.values[3:]
        whole = np.concatenate([mean_variance(readings.w_ib_b), mean_variance(readings.f_b)])
        part = ends / len(readings)
        growth = 1 / part - 1 if window == "same" else 1 / part  # "same" ends at its own offset
        placed = placed_covariance(options.priors)
        covariance = [attitude_covariance(nominal, whole * g + extra, G) + placed for g in growth]
        tracks.append(
            AttitudeTrack(
                f"{METHOD} {window}",
                dwell.label,
                readings.t[ends - 1],
                site.plumb * attitude_from_means(w, f, sequence),
                sequence,
                np.array(covariance),
            )
        )
    return tracks


def track_ends(readings: ImuReadings) -> np.ndarray:
    """Numbers of samples (m,) behind each point of a track, the last one all of them."""
    n, dt = len(readings), readings.interval
    step = max(1, round(TRACK_STEP / dt))
    lead = min(n, max(2, round(TRACK_LEAD / dt)))
    return np.unique(np.append(np.arange(lead, n, step), n))


def _means_up_to(values: Array, ends: np.ndarray) -> Array:
    """Means (m, k) of the first `ends` (m,) rows of `values` (n, k)."""
    starts = np.concatenate([[0], ends[:-1]])
    return np.cumsum(np.add.reduceat(values[: ends[-1]], starts, axis=0), axis=0) / ends[:, None]
