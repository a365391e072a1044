"""Encoder angles of a recording, at the stamps of its readings."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from alignment import ImuReadings
from alignment.arrays import Array
from alignment.readings import EDGE
from alignment.units import DEG
from stand.errors import StandError, unknown
from stand.recording.mcap.reader import JointLog
from stand.recording.metadata import LoggedStretch

LONGEST_STEP = 90 * DEG  # of an encoder between readings, so that turns can be counted
GROSS = 0.5  # part of a rate: scale errors of gyros are smaller, mistakes larger
LARGEST_BIAS = 1 * DEG  # rad/s, of a gyro


@dataclass(frozen=True, slots=True, eq=False)
class Encoders:
    """Encoder readings of a log whose time zero is `origin` [ns since the Unix epoch].

    `counted`: whether the angles grow over turns, as ours do; a real encoder may begin anew.
    """

    log: JointLog
    origin: int
    counted: bool

    def angle(self, joint: str, t: Array) -> Array:
        """Its angle (n,) [rad] at times `t` (n,) [s], straight between readings, turns counted.

        Raises
        ------
        StandError
            No such joint; times that the readings do not span; readings too far apart.
        """
        log = self.log
        if joint not in log.names:
            raise unknown(f"{log.topic}: joint", joint, log.names)
        stamps = (log.t_ns - self.origin) * 1e-9
        if len(t) < 2 or t[0] < stamps[0] - EDGE or t[-1] > stamps[-1] + EDGE:
            raise StandError(
                f"{log.topic}: from {stamps[0]:.3f} to {stamps[-1]:.3f} s, must hold all of the "
                "IMU's stretch (two samples or more)"
            )
        first = max(int(np.searchsorted(stamps, t[0], "right")) - 1, 0)
        last = int(np.searchsorted(stamps, t[-1])) + 1
        angle = log.angles[first:last, log.names.index(joint)]
        return np.interp(t, stamps[first:last], angle if self.counted else self._counted(angle))

    def _counted(self, angle: Array) -> Array:
        whole = np.unwrap(angle)
        step = float(np.abs(np.diff(whole)).max(initial=0.0))
        if step > LONGEST_STEP:
            raise StandError(
                f"{self.log.topic}: steps of {step / DEG:.1f} deg between readings: must be at "
                f"most {LONGEST_STEP / DEG:.0f}, or turns cannot be counted"
            )
        return whole


def axis_of_turn(stretch: LoggedStretch, readings: ImuReadings, angle: Array) -> Array:
    """The axis in b: of the schedule, the told one, or the vertical.

    What no encoder or schedule of ours says is compared with the gyros: the rate is fitted to
    theirs by least squares. A bias may be as large as a slow table's rate, so that a told axis
    stands then.
    """
    if stretch.nominal is not None and stretch.rate is None:
        return np.array(stretch.axis_b)
    known = stretch.axis_b is not None
    axis = np.array(stretch.axis_b if known else unit_vector(readings.f_b.mean(axis=0)))
    rate = np.diff(angle) / np.diff(readings.t)
    power = float(rate @ rate)
    if power == 0.0:
        raise StandError(f"{stretch.label}: {stretch.joint} does not turn")
    # interval k ends at stamp k, as its mean rate does
    share = float((readings.w_ib_b[1:] @ axis) @ rate) / power
    if not known and share < 0:
        axis, share = -axis, -share
    off = abs(share - 1.0)
    if off > GROSS and (not known or off * np.sqrt(power / len(rate)) > LARGEST_BIAS):
        about = ", ".join(f"{a:.3f}" for a in axis)
        told = "the stretch says" if stretch.joint is None else f"{stretch.joint} does"
        raise StandError(
            f"{stretch.label}: the gyros turn {share:.3f} times as fast about ({about}) as "
            f"{told}, must be {1 - GROSS:g} to {1 + GROSS:g}: another axis or "
            f"{'rate' if stretch.joint is None else 'joint'}"
        )
    return axis


def unit_vector(vector: ArrayLike | None) -> tuple[float, ...] | None:
    if vector is None:
        return None
    v = np.asarray(vector, float)
    length = float(np.linalg.norm(v))
    if v.shape != (3,) or not np.isfinite(length) or length == 0.0:
        raise StandError(f"turn axis {v.tolist()}: must be three numbers, not all zero")
    return tuple((v / length).tolist())
