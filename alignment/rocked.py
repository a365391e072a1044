"""How far what rests was off its mean attitude while it rocked: a base is seldom quite still."""

import numpy as np

from alignment.arrays import Array
from alignment.noise import ALIKE, block_means, noise_of_blocks, rest_blocks
from alignment.once import once
from alignment.readings import ImuReadings

_ROUNDING = 1e-10  # rad/s and rad: no mean is surer than this


@once
def rocked_covariance(readings: ImuReadings) -> Array:
    """Covariance (3, 3) about b [rad^2] of the attitude at any time about that of the mean.

    Parameters
    ----------
    readings : ImuReadings
        Of a stretch that `check_rest` lets pass.

    Returns
    -------
    Array
        About the vertical by what the gyros turned, about level axes, alike since a heading may be
        off, by how the accelerometers leaned. Zeros where no 1 s mean of rates leaves the common
        one by more than noise, and of level axes where none of the forces does: what only drifts
        did not move, and neither did what turned about the vertical no faster than that drift.

    Notes
    -----
    A table's angles say where its base was on average. A stretch that is shorter than that, or the
    attitude at its end, is off by what the base did meanwhile.
    """
    blocks = rest_blocks(readings)
    w = block_means(readings.w_ib_b, blocks)
    w = w - w.mean(axis=0)
    if np.linalg.norm(w, axis=1).max() <= noise_of_blocks(readings.w_ib_b, w) + _ROUNDING:
        return np.zeros((3, 3))
    f = block_means(readings.f_b, blocks)
    mean = f.mean(axis=0)
    size = float(np.linalg.norm(mean))
    up = mean / size
    level = np.eye(3) - np.outer(up, up)
    found = np.zeros((3, 3))
    leaned = np.cross(up, f / size)
    leans = (
        np.linalg.norm(leaned, axis=1).max() > noise_of_blocks(readings.f_b, f) / size + _ROUNDING
    )
    if leans:
        found += np.sum(leaned**2) / 2 / blocks * level
    # rates about level axes that did not lean are drifts, and gyros of one unit drift alike
    if leans or np.abs(w @ up).max() > ALIKE * np.linalg.norm(w @ level, axis=1).max():
        span = readings.interval * len(readings) / blocks
        found += float(np.var(np.cumsum(w @ up) * span)) * np.outer(up, up)
    return found


def rocked_doubt(readings: ImuReadings, so: str = "counted") -> tuple[str, ...]:
    """A flag where it rocked, and what is made `so` of that."""
    size = float(np.sqrt(np.trace(rocked_covariance(readings))))
    return (f"rocks by {np.degrees(size):.2g} deg (rms): {so}",) if size else ()


def mean_doubt(readings: ImuReadings) -> tuple[str, ...]:
    """A flag where it rocked, of methods that need no table and tell the attitude of the mean."""
    return rocked_doubt(readings, "this is the mean attitude")
