"""Estimators of attitude and calibration from inertial readings, of a stand or of a real log.

Notation: n is north-east-down, b the instrument axes (X1 forward, Y1 up, Z1 right at zero table
angles); ``w_ib_b`` [rad/s] is what gyros sense and ``f_b`` [m/s^2] what accelerometers sense,
both in b; ``C_nb`` takes b components to n components. SI units and radians throughout. Nothing
here knows the stand: an estimator cannot see the truth.

`ESTIMATORS` is the one list of methods; a new one is a module and an entry in
`alignment.estimators`.
"""

from alignment.earth import Site
from alignment.estimate import AttitudeEstimate, AttitudeTrack
from alignment.estimators import DEFAULT_METHOD, ESTIMATORS
from alignment.method import Method, Window
from alignment.options import Options, Priors
from alignment.readings import Dwell, ImuReadings, Turn

__all__ = [
    "DEFAULT_METHOD",
    "ESTIMATORS",
    "AttitudeEstimate",
    "AttitudeTrack",
    "Dwell",
    "ImuReadings",
    "Method",
    "Options",
    "Priors",
    "Site",
    "Turn",
    "Window",
]
