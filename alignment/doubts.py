"""Doubts about an estimate that a reader must see."""

import numpy as np

from alignment.apart import Apart
from alignment.arrays import Array
from alignment.units import DEG_PER_HOUR, STANDARD_GRAVITY

ALIKE_DOUBT = (
    "accelerometers drift straight along the record around it: heading is off alike in all of it"
)


def heading_doubt(covariance: Array) -> tuple[str, ...]:
    """A flag when heading is too unsure for first-order theory (sigma above 8 deg)."""
    sigma = float(np.degrees(np.sqrt(covariance[2, 2])))
    return ("heading sigma above 8 deg: beyond first order",) if sigma > 8.0 else ()


def drift_words(gyro: Array, accel: Array) -> str:
    """What drifts by how much (3,): gyros [rad/s], accelerometers [m/s^2]; '' for nothing."""
    told = []
    if gyro.any():
        told.append(f"gyros by {_short(gyro.max() / DEG_PER_HOUR)} deg/h")
    if accel.any():
        told.append(f"accelerometers by {_short(accel.max() / STANDARD_GRAVITY * 1e6)} ug")
    return " and ".join(told)


def _short(value: float) -> str:
    """Two digits, of hundreds too: no 1e+02."""
    return f"{float(f'{value:.2g}'):g}"


def drift_doubt(gyro: Array, accel: Array) -> tuple[str, ...]:
    """A flag where readings at rest drift beyond noise, by so much (3,) from end to end."""
    told = drift_words(gyro, accel)
    if not told:
        return ()
    return (
        f"drift from end to end beyond noise: {told}: counted as one sigma; a "
        "slower one is not known without a data sheet",
    )


def apart_doubt(one: Apart) -> tuple[str, ...]:
    """A flag where a part of the readings lies apart from all others."""
    told = drift_words(np.abs(one.off[:3]), np.abs(one.off[3:]))
    if not told:
        return ()
    return (
        f"from {one.t_from:.4g} to {one.t_to:.4g} s off the other readings: {told}: counted as "
        "one sigma; left out (--from, --to) it harms nothing",
    )
