"""Gravity where a unit is calibrated, and how sure it is: it is the accelerometers' yardstick."""

from alignment.calibration.result import Gravity
from alignment.earth import Site
from alignment.errors import AlignmentError

# m/s^2, 1 sigma. Gravity anomalies of the land: rms some 30 mGal against normal gravity.
NORMAL_SIGMA = 3e-4
# Anywhere: normal gravity at sea level is 9.780 to 9.832, evenly by latitude more or less
ANYWHERE, ANYWHERE_SIGMA = 9.80665, 0.015
LEAST, MOST = 9.0, 10.5


def gravity_of(site: Site, value: float | None = None, sigma: float | None = None) -> Gravity:
    """Gravity [m/s^2] as it was measured, else as the site has it, else as it may be anywhere.

    Parameters
    ----------
    site : Site
    value, sigma : float or None
        As measured. A value without a sigma is taken as it is.

    Raises
    ------
    AlignmentError
        Not a gravity of this planet, or a sigma that is none.
    """
    if sigma is not None and not 0 <= sigma <= 1:
        raise AlignmentError(f"gravity sigma = {sigma:g} m/s^2: must be 0 to 1")
    if value is not None:
        if not LEAST < value < MOST:
            raise AlignmentError(f"gravity = {value:g} m/s^2: must be {LEAST:g} to {MOST:g}")
        return Gravity(value=value, sigma=sigma or 0.0)
    if site.local_gravity is not None:
        return Gravity(value=site.local_gravity, sigma=sigma or 0.0)
    if site.latitude is None:
        return Gravity(value=ANYWHERE, sigma=ANYWHERE_SIGMA if sigma is None else sigma)
    return Gravity(value=site.gravity, sigma=NORMAL_SIGMA if sigma is None else sigma)
