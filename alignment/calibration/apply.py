"""Readings without a unit's constant errors: the calibration, the other way round."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from alignment.arrays import Array
from alignment.calibration.constants import TriadConstants, columns, constants_of, reported, slope
from alignment.calibration.result import SENSORS, Calibration
from alignment.errors import AlignmentError
from alignment.noise import GAP
from alignment.readings import ImuReadings

STEPS = 50  # of a fixed point; each gains a factor of about the size of the errors
SETTLED = 1e-14  # relative: rounding
TREMBLING = 1e-11  # where the last bits go on moving
ASTRAY = 10.0  # where no step leads back
FEWEST_IN_TIME = 4  # samples: those of a cubic
LARGEST_ERROR = 0.5  # of scale and axes: beyond it no fixed point is near, and no unit is so wrong


@dataclass(frozen=True, slots=True, eq=False)
class Correction:
    """A unit's constants, `gyro` and `accel`, ready to be taken out of readings."""

    gyro: TriadConstants
    accel: TriadConstants

    @classmethod
    def of(cls, calibration: Calibration, values: Array | None = None) -> "Correction":
        """From a calibration; `values` (n,) in place of its own.

        Raises
        ------
        AlignmentError
            Scale and axes so wrong that they cannot be those of this unit.
        """
        values = calibration.values if values is None else values
        gyro = constants_of(calibration.keys, values, "gyro")
        accel = constants_of(calibration.keys, values, "accel")
        for name, triad in (("gyro", gyro), ("accel", accel)):
            off = float(np.abs(triad.scale_and_axes - np.eye(3)).max())
            if off > LARGEST_ERROR:
                raise AlignmentError(
                    f"{name}: scale factor or misalignment of {off:.3g}, must be at most "
                    f"{LARGEST_ERROR:g}: other units, or other axes"
                )
        return cls(gyro, accel)


def correct(
    calibration: Calibration, readings: ImuReadings, warmth: Array | float = 0.0
) -> ImuReadings:
    """What the unit felt, as far as the calibration knows.

    Parameters
    ----------
    calibration : Calibration
    readings : ImuReadings
        Of this unit.
    warmth : (n,) or float
        Above the reference temperature [K]; where the calibration has terms of temperature.

    Returns
    -------
    ImuReadings
        The same stamps; forces at the unit's own point. Lags are taken out by the integral of the
        readings, read later: the last samples, whose future is not there, keep theirs.

    Raises
    ------
    AlignmentError
        Not a unit that this calibration can be of.

    Notes
    -----
    A fixed point ``x + L^-1 (y - reported(x))``, L scale and axes, to rounding. Gyros need the
    force first (g-sensitivity), accelerometers at places of their own then the rate's change.
    """
    correction = Correction.of(calibration)
    w = _in_time(readings.t, readings.w_ib_b, correction.gyro.lag)
    f = _in_time(readings.t, readings.f_b, correction.accel.lag)
    w, f = _both(correction, readings.t, w, f, warmth)
    return ImuReadings(readings.t, w, f, readings.ranges, instants=readings.instants)


def _both(
    correction: Correction, t: Array, w: Array, f: Array, warmth: Array | float
) -> tuple[Array, Array]:
    """True rates and forces (n, 3) of what is reported (n, 3)."""
    force = inverse(correction.accel, f, np.zeros_like(f), warmth)
    rate = inverse(correction.gyro, w, force, warmth)
    if correction.accel.places.any() and len(t) > 1:
        force = force - size_effect(t, rate, correction.accel.places)
    return rate, force


def inverse(constants: TriadConstants, y: Array, f: Array, warmth: Array | float = 0.0) -> Array:
    """True input (n, 3) of what one triad reports (n, 3), with the force `f` (n, 3) on it.

    Raises
    ------
    AlignmentError
        There is none: orders so high that the readings cannot come of such a unit.
    """
    back = np.linalg.inv(constants.scale_and_axes)
    largest = max(1.0, float(np.abs(y).max(initial=0.0)))
    x, off = y @ back.T, np.inf
    for _ in range(STEPS):
        more = y - reported(constants, x, f, warmth)
        off = float(np.abs(more).max(initial=0.0))
        if off <= SETTLED * largest or off > ASTRAY * largest:
            break
        x = x + more @ back.T
    if off > TREMBLING * largest:
        raise AlignmentError(
            "calibration: its higher orders are so large that these readings cannot be this unit's"
        )
    return x


def size_effect(t: Array, w: Array, places: Array) -> Array:
    """What turning adds (n, 3) to the components of force at places (3, 3) [m] of their own.

    Component i of ``dw x r_i + w x (w x r_i)``, dw by central differences.
    """
    change = np.gradient(w, t, axis=0)
    extra = np.empty_like(w)
    for i, r in enumerate(places):
        extra[:, i] = (np.cross(change, r) + np.cross(w, np.cross(w, r)))[:, i]
    return extra


def _in_time(t: Array, values: Array, lag: Array) -> Array:
    """Means (n, 3) over the intervals that they are to be of, of such that come late by `lag`.

    By a cubic spline through their integral: exact of what is smooth over some samples.
    """
    if not lag.any() or len(t) < FEWEST_IN_TIME:
        return values
    step = float(np.median(np.diff(t)))
    gaps = np.flatnonzero(np.diff(t) > GAP * step) + 1
    out = np.array(values)
    for a, b in pairwise([0, *gaps.tolist(), len(t)]):
        if b - a >= FEWEST_IN_TIME:
            edges = np.concatenate([[t[a] - step], t[a:b]])
            for axis in np.flatnonzero(lag):
                out[a:b, axis] = _later(edges, values[a:b, axis], float(lag[axis]))
    return out


def _later(edges: Array, means: Array, lag: float) -> Array:
    """Means (n,) a `lag` after those between `edges` (n + 1,); the last as they are."""
    from scipy.interpolate import CubicSpline  # takes its time to import

    width = np.diff(edges)
    integral = CubicSpline(edges, np.concatenate([[0.0], np.cumsum(means * width)]))
    later = edges + lag
    inside = (later[1:] <= edges[-1]) & (later[:-1] >= edges[0])
    return np.where(inside, np.diff(integral(later)) / width, means)


def corrected_covariance(
    calibration: Calibration, w_ib_b: Array, f_b: Array, warmth: float = 0.0
) -> Array:
    """Covariance (6, 6) of corrected readings that the calibration's own sigmas make.

    Parameters
    ----------
    calibration : Calibration
    w_ib_b, f_b : (3,)
        True rate [rad/s] and force [m/s^2] in one attitude.
    warmth : float
        [K]

    Notes
    -----
    ``dx = -(dy/dx)^-1 dy/dp`` of each parameter p; what the accelerometers' take from the force
    moves the gyros by their g-sensitivity. Lags and lever arms act on what changes: no share here.
    """
    w, f = np.atleast_2d(w_ib_b), np.atleast_2d(f_b)
    gyro, accel = (constants_of(calibration.keys, calibration.values, s) for s in SENSORS)
    its_own = np.array([k.sensor == "gyro" for k in calibration.keys])
    of_gyros = columns(calibration.keys, gyro, w, f, warmth)[0] * its_own
    of_accels = columns(calibration.keys, accel, f, f, warmth)[0] * ~its_own
    force = np.linalg.solve(slope(accel, f)[0], of_accels)
    by_force = gyro.g_sensitivity + 2 * gyro.g2_sensitivity * f
    rate = np.linalg.solve(slope(gyro, w)[0], of_gyros - by_force @ force)
    J = np.vstack([rate, force])
    return np.asarray(J @ calibration.covariance @ J.T)
