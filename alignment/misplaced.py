"""Zero offsets that are more than the unit and the table are stated to make: a wrong attitude."""

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.special import chdtri

from alignment.arrays import Array
from alignment.constant_errors import constant_covariance
from alignment.earth import Site
from alignment.gains import compass_gain, from_b
from alignment.nominal import ZeroOffset, nominal_readings, placed_covariance
from alignment.options import Priors

LIKELY = 1e-4  # probability of a larger chi-square by chance
_ROUNDING = 1e-10  # rad/s, m/s^2: no mean is surer than this
_LEVEL, _DOWN = slice(0, 2), slice(2, 3)


def misplaced(
    offset: ZeroOffset, nominal: Rotation, site: Site, priors: Priors
) -> tuple[Array, tuple[str, ...]]:
    """What contradicting offsets add to an attitude's covariance about n (3, 3), and a flag each.

    A method that takes the offsets of its first readings out of the later ones takes the nominal
    attitude for true: what that is wrong by is an offset to it, and comes back as attitude. By
    gravity and the horizontal Earth rate the offsets are an attitude too. Where that is larger than
    noise, constants and table are stated to make it, it may be wrong by as much: one sigma, of
    level axes alike, for a bias turns where it points.

    Of sensors of which nothing but noise is known any offset may be a bias: nothing is added.
    """
    added, flags = np.zeros((3, 3)), []
    G = from_b(compass_gain(site), nominal)
    drifts = np.repeat([priors.gyro_instability, priors.accel_instability], 3) ** 2
    constants = constant_covariance(nominal_readings(nominal, site), priors)
    own_b = np.diag(offset.variances + drifts + _ROUNDING**2) + constants
    likely = G @ own_b @ G.T + placed_covariance(priors)
    seen = G @ offset.values
    for part, where, sensor in ((_LEVEL, "level", "accel"), (_DOWN, "heading", "gyro")):
        if sensor in priors.noise_only:
            continue
        own, off = likely[part, part], seen[part]
        sigma = float(np.sqrt(np.trace(own)))
        if np.linalg.matrix_rank(own) < len(off) or not sigma:
            continue
        if off @ np.linalg.solve(own, off) > chdtri(len(off), LIKELY):
            added[part, part] = np.eye(len(off)) * np.mean(off**2)
            flags.append(
                f"zero offsets are {np.degrees(np.linalg.norm(off)):.3g} deg off the {where} told, "
                f"{np.degrees(sigma):.2g} are stated: counted as one sigma"
            )
    return added, tuple(flags)
