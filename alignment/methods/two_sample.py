"""The other rival: attitude by integrating the gyros with two samples a step, coning corrected.

Where the base trembles, rates held over each sample miss the cone that its axes describe; the
cross product of two successive increments has it.
"""

from collections.abc import Sequence as Ordered

from alignment.earth import Site
from alignment.estimate import AttitudeEstimate, AttitudeTrack
from alignment.methods.integration import integrated, integrated_tracks
from alignment.options import Options
from alignment.readings import Dwell
from alignment.strapdown import integrate

METHOD = "two-sample"


def two_sample(dwells: Ordered[Dwell], site: Site, options: Options) -> list[AttitudeEstimate]:
    """Attitude at the end of each dwell, integrated from its nominal attitude as by `rk4`.

    Notes
    -----
    Leading errors: those of `rk4`; but coning of half angle c at frequency w, sampled every h,
    drifts by ``c^2 w (w h)^4 / 60`` and not by ``c^2 w (w h)^2 / 12``. Source: R. B. Miller
    (1983); P. G. Savage, Strapdown Inertial Navigation Integration Algorithm Design Part 1 (1998).
    """
    return integrated(METHOD, integrate, dwells, site, options)


def two_sample_tracks(dwell: Dwell, site: Site, options: Options) -> list[AttitudeTrack]:
    """The integrated attitude over the dwell."""
    return integrated_tracks(METHOD, integrate, dwell, site, options)
