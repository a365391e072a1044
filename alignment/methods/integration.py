"""The rival: attitude by integrating the gyros from a known start with Runge-Kutta.

Rodrigues-Hamilton kinematics ``q' = q o w / 2``. Quaternions here are plain arrays (..., 4) in
the order x, y, z, w: far faster in a long product than rotation objects.
"""

from collections.abc import Callable
from collections.abc import Sequence as Ordered

import numpy as np
from scipy.spatial.transform import Rotation

from alignment.arrays import Array
from alignment.doubts import heading_doubt
from alignment.earth import EARTH_RATE, Site
from alignment.errors import AlignmentError
from alignment.estimate import AttitudeEstimate, AttitudeTrack
from alignment.gains import Answer, after_offset
from alignment.information import Stretch
from alignment.information.drift import in_the_mean
from alignment.misplaced import misplaced
from alignment.noise import BLOCKS, believed, check_at_rest, gap_doubt, mean_variance
from alignment.nominal import (
    nominal_attitude,
    placed_and_rocked,
    sequence_of,
    track_ends,
    zero_offset,
)
from alignment.options import Options, Priors
from alignment.quaternions import multiply, normalised, prefix_product
from alignment.readings import Dwell, ImuReadings
from alignment.rocked import rocked_doubt
from alignment.saturation import saturation_doubt

METHOD = "rk4"
Integrator = Callable[[ImuReadings, Rotation, Array, Array, np.ndarray], Rotation]  # `integrate`
_CHUNK = 16384  # samples integrated at once: bounds the memory of hour-long records


def rk4_steps(w: Array, h: Array) -> Array:
    """Quaternion step (n, 4) of classical Runge-Kutta for rates (n, 3) held over steps (n,).

    Truncation: an angle of ``(|w| h)^5 / 1920`` rad per step.
    """
    half = np.zeros((len(w), 4))
    half[:, :3] = 0.5 * w * h[:, None]
    one = np.array([0.0, 0.0, 0.0, 1.0])
    k1 = half
    k2 = multiply(one + 0.5 * k1, half)
    k3 = multiply(one + 0.5 * k2, half)
    k4 = multiply(one + k3, half)
    return one + (k1 + 2 * k2 + 2 * k3 + k4) / 6


def integrate(
    readings: ImuReadings, start: Rotation, w_ie_n: Array, offset: Array, ends: np.ndarray
) -> Rotation:
    """``C_nb`` (m rotations) after the first `ends` (m,) samples, from ``C_nb`` at their start.

    The rates minus `offset` (3,) are integrated against inertial space; the turn of n with the
    Earth, ``w_ie_n`` (3,) times time, is then taken out exactly (a stand does not travel).
    """
    start_t = readings.t[0] - readings.interval
    q = np.empty((len(ends), 4))
    total = np.array([0.0, 0.0, 0.0, 1.0])
    for first in range(0, len(readings), _CHUNK):
        part = slice(first, min(first + _CHUNK, len(readings)))
        before = start_t if first == 0 else readings.t[first - 1]
        h = np.diff(readings.t[part], prepend=before)
        run = prefix_product(rk4_steps(readings.w_ib_b[part] - offset, h))
        here = (ends > part.start) & (ends <= part.stop)
        q[here] = multiply(total, run[ends[here] - 1 - part.start])
        total = normalised(multiply(total, run[-1]))
    elapsed = readings.t[ends - 1] - start_t
    earth = Rotation.from_rotvec(-elapsed[:, None] * np.asarray(w_ie_n))
    return earth * start * Rotation.from_quat(q)


def integrated_drift_covariance(
    variance_rate: Array, t: Array, window: float, offset: Array | None = None
) -> Array:
    """Variance (m, 3) [rad^2] about b of integrated white rate noise after offset removal.

    Parameters
    ----------
    variance_rate : (3,)
        Angle random walk squared [rad^2/s].
    t : (m,)
        Time since the start [s].
    window : float
        Seconds from the start whose mean gave the offset.
    offset : (3,), optional
        Variance of that mean [rad^2/s^2], where it is known by itself.

    Notes
    -----
    ``N^2 t (1 - t/T0)`` inside the window (a bridge), ``N^2 (t - T0) + N^2 (t - T0)^2/T0`` after;
    N^2/T0 is the variance of the offset: of rates that are no white noise it is another.
    """
    offset = variance_rate / window if offset is None else offset
    late = np.maximum(t - window, 0.0)
    inside = np.minimum(t, window)
    growth = inside * (1 - inside / window) + late
    return growth[:, None] * variance_rate + late[:, None] ** 2 * offset


def enclosed(variance_rate: Array, t: Array) -> Array:
    """Variance (m, 3) [rad^2] of what turns about two axes make about the third after `t` (m,) [s].

    Noise that comes back to where it began, as in the offset's own window, has no first order left,
    but it goes round an area: of bridges of two axes ``N^2 N^2 t^2/12`` (Lévy's), and beside the
    Earth's turn ``W^2 N^2 t^3/12``.
    """
    x, y, z = variance_rate
    both, other = np.array([y * z, z * x, x * y]), np.array([y + z, z + x, x + y])
    square = t[:, None] ** 2 / 12
    return np.asarray(square * both + square * t[:, None] * EARTH_RATE**2 * other)


def drifted_apart(late: Array, window: float, priors: Priors) -> Array:
    """Variance (m,) [rad^2] of what a walk and a ramp of the bias turn `late` (m,) [s] after the
    offset's `window` [s]: ``K^2 (late^3 + window late^2)/3``, ``(R late (window + late)/2)^2``."""
    walked = priors.gyro_random_walk**2 * late**2 * (late + window) / 3
    return np.asarray(walked + (priors.gyro_ramp * late * (window + late) / 2) ** 2)


def _track(
    method: str,
    integrator: Integrator,
    dwell: Dwell,
    site: Site,
    options: Options,
    last_only: bool,
) -> tuple[AttitudeTrack, tuple[str, ...]]:
    priors = options.priors
    nominal = nominal_attitude(dwell)
    offset = zero_offset(dwell, nominal, site, options.offset_window, priors)
    readings = dwell.window()
    ends = np.array([len(readings)]) if last_only else track_ends(readings)
    C_nb = integrator(readings, nominal, site.w_ie_n, offset.values[:3], ends)
    t = readings.t[ends - 1]
    variance = believed(mean_variance(readings.w_ib_b), readings, priors.gyro_walk)
    variance_rate = variance * readings.interval * len(readings)
    elapsed = t - (readings.t[0] - readings.interval)
    samples = len(dwell.window(0.0, options.offset_window))
    window = samples * readings.interval  # of which the offset is the mean
    own = offset.variances[:3]
    if samples <= BLOCKS:  # which tell less than the record
        own = variance_rate / window + offset.wander[:3]
    about_b = integrated_drift_covariance(variance_rate, elapsed, window, own)
    about_b += enclosed(variance_rate, elapsed)
    # bias of later readings against that of the window: the two differ by the Allan deviation
    late = np.maximum(elapsed - window, 0.0)
    about_b += 2 * (priors.gyro_instability * late[:, None]) ** 2
    about_b += drifted_apart(late, window, priors)[:, None]
    R = nominal.as_matrix()
    begun = in_the_mean(priors, dwell.t_from, options.offset_window)
    beyond, told = misplaced(offset, nominal, site, begun)
    placed = placed_and_rocked(dwell, nominal, priors) + beyond
    covariance = np.einsum("ij,mj,kj->mik", R, about_b, R) + placed
    sequence = sequence_of(nominal, options.rule)
    track = AttitudeTrack(method, dwell.label, t, C_nb, sequence=sequence, covariance=covariance)
    return track, told


def integrated(
    method: str, integrator: Integrator, dwells: Ordered[Dwell], site: Site, options: Options
) -> list[AttitudeEstimate]:
    """Attitude at the end of each dwell by a way of integrating; see `rk4`."""
    estimates = []
    for dwell in dwells:
        check_at_rest(dwell)
        for gap in gap_doubt(dwell.window()):
            raise AlignmentError(f"{dwell.label}: {gap}: what the gyros felt there is lost")
        flags = saturation_doubt(dwell.label, dwell.window()) + rocked_doubt(dwell.window())
        track, told = _track(method, integrator, dwell, site, options, last_only=True)
        flags += told
        flags += () if dwell.nominal is not None else ("start attitude assumed: heading 0",)
        estimates.append(
            AttitudeEstimate(
                method,
                dwell.label,
                dwell.t_from,
                dwell.t_to,
                C_nb=track.C_nb[0],
                sequence=track.sequence,
                covariance=track.covariance[0],
                flags=flags + heading_doubt(track.covariance[0]),
            )
        )
    return estimates


def integrated_tracks(
    method: str, integrator: Integrator, dwell: Dwell, site: Site, options: Options
) -> list[AttitudeTrack]:
    """The integrated attitude over the dwell."""
    return [_track(method, integrator, dwell, site, options, last_only=False)[0]]


def rk4(dwells: Ordered[Dwell], site: Site, options: Options) -> list[AttitudeEstimate]:
    """Attitude at the end of each dwell, integrated from its nominal attitude.

    Parameters, flags and errors as for `six_position`: the same zero offsets are removed. Of the
    `priors` the placement of the table and the gyros' instability count: constant biases and
    scale errors go with the offsets.

    Notes
    -----
    Leading errors: the offset's own noise times time, ``ARW (t - T0)/sqrt(T0)``, and the walk
    ``ARW sqrt(t - T0)``; drift of the bias, ``sqrt(2) ADEV (t - T0)``; the start attitude's error
    1:1. Source: [S0], methods.md section 1.
    """
    return integrated(METHOD, integrate, dwells, site, options)


def rk4_tracks(dwell: Dwell, site: Site, options: Options) -> list[AttitudeTrack]:
    """The integrated attitude over the dwell."""
    return integrated_tracks(METHOD, integrate, dwell, site, options)


def integration_gains(stretches: Ordered[Stretch], site: Site, options: Options) -> list[Answer]:
    """Gyros less their offset, integrated by any rule from the attitude the table was told."""

    def gain(later: Stretch) -> Array:
        turned = np.zeros((3, 6))
        turned[:, :3] = later.C_pb.as_matrix() * later.duration
        return turned

    return after_offset(stretches, site, options, gain)
