"""What a table at a nominal attitude must read, and the zero offset of what it does read."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from alignment.angles import C_nb_from_angles, Sequence, SequenceRule
from alignment.arrays import Array
from alignment.earth import Site
from alignment.errors import AlignmentError, TooShort
from alignment.noise import believed, mean_and_variance, wander_around
from alignment.options import Priors
from alignment.readings import Dwell, ImuReadings
from alignment.rocked import rocked_covariance

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
    """Offsets (6,) of rates [rad/s] and forces [m/s^2], and the variances (6,) of their means.

    `wander` (6,): what of these the window does not show, but others as long in its dwell do.
    """

    values: Array
    variances: Array
    wander: Array


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


def zero_offset(
    dwell: Dwell, nominal: Rotation, site: Site, window: float, priors: Priors
) -> ZeroOffset:
    """Mean over the first `window` seconds minus the nominal readings ([S0] steps 2, 3).

    Of few samples the variances are as the noise of `priors` makes them, see `believed`.
    """
    if dwell.t_to - dwell.t_from < window - 1e-6:
        raise TooShort(
            f"{dwell.label}: {dwell.t_to - dwell.t_from:.1f} s of rest, "
            f"the zero offsets need {window:g} s"
        )
    first = dwell.window(0.0, window)
    means, variances = mean_and_variance(first)
    variances = believed(variances, first, priors.gyro_walk, priors.accel_walk)
    wanted = nominal_readings(nominal, site)
    _check_vertical(dwell.label, means[3:], wanted[3:])
    part = replace(dwell, t_to=dwell.t_from + window, readings=dwell.window())
    wander = wander_around(part)
    return ZeroOffset(means - wanted, variances + wander, wander)


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
    return rule.sequence_at(nominal)


def placed_covariance(priors: Priors) -> Array:
    """Covariance (3, 3) about n [rad^2] of the true attitude from the nominal one: the table's."""
    base = np.diag([priors.nominal, priors.nominal, priors.azimuth]) ** 2
    return np.asarray((priors.turn**2 + priors.seat**2) * np.eye(3) + base)


def placed_and_rocked(dwell: Dwell, nominal: Rotation, priors: Priors) -> Array:
    """`placed_covariance`, and what the dwell itself shows its base to have rocked by (3, 3)."""
    C = nominal.as_matrix()
    return placed_covariance(priors) + C @ rocked_covariance(dwell.window()) @ C.T


def track_ends(readings: ImuReadings) -> np.ndarray:
    """Numbers of samples (m,) behind each point of a track, the last one all of them."""
    n, dt = len(readings), readings.interval
    step = max(1, round(TRACK_STEP / dt))
    lead = min(n, max(2, round(TRACK_LEAD / dt)))
    return np.unique(np.append(np.arange(lead, n, step), n))
