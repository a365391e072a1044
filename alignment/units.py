"""Units at the doors: multiply to come in (SI, radians), divide to go out.

>>> 15.041067 * DEG_PER_HOUR  # Earth rate in rad/s
7.292115...e-05
"""

from math import pi, sqrt

DEG = pi / 180.0
ARC_MINUTE = DEG / 60.0
ARC_SECOND = DEG / 3600.0
MRAD = 1e-3
PPM = 1e-6

DEG_PER_HOUR = DEG / 3600.0
DEG_PER_RT_HOUR = DEG / sqrt(3600.0)  # rad/s/rt-Hz per deg/rt-h
M_S_PER_RT_HOUR = 1.0 / sqrt(3600.0)  # m/s^2/rt-Hz per m/s/rt-h

STANDARD_GRAVITY = 9.80665  # m/s^2: what the "g" in mg and ug means, exactly (CGPM 1901)
MILLI_G = 1e-3 * STANDARD_GRAVITY
MICRO_G = 1e-6 * STANDARD_GRAVITY
