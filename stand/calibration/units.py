"""In which unit a parameter of a calibration is written."""

from collections.abc import Mapping

from alignment.calibration import Key
from alignment.units import (
    ARC_SECOND,
    DEG,
    DEG_PER_HOUR,
    MICRO_G,
    PPM,
    STANDARD_GRAVITY,
)

G = STANDARD_GRAVITY
AXES = ("X1", "Y1", "Z1")

# term: (unit, what it is in SI), of both sensors or of each
_SHARED: Mapping[str, tuple[str, float]] = {
    "scale": ("ppm", PPM),
    "misalignment": ("arcsec", ARC_SECOND),
    "asymmetry": ("ppm", PPM),
    "lag": ("us", 1e-6),
    "temperature_scale": ("ppm/K", PPM),
}
UNITS: Mapping[str, Mapping[str, tuple[str, float]]] = {
    "gyro": _SHARED
    | {
        "bias": ("deg/h", DEG_PER_HOUR),
        "k2": ("ppm/(deg/s)", PPM / DEG),
        "k3": ("ppm/(deg/s)^2", PPM / DEG**2),
        "g_sensitivity": ("deg/h/g", DEG_PER_HOUR / G),
        "g2_sensitivity": ("deg/h/g^2", DEG_PER_HOUR / G**2),
        "temperature_bias": ("deg/h/K", DEG_PER_HOUR),
    },
    "accel": _SHARED
    | {
        "bias": ("ug", MICRO_G),
        "k2": ("ug/g^2", MICRO_G / G**2),
        "k3": ("ug/g^3", MICRO_G / G**3),
        "lever_arm": ("mm", 1e-3),
        "temperature_bias": ("ug/K", MICRO_G),
    },
}
# of nuisances, by their SI unit
OF_NUISANCE: Mapping[str, tuple[str, float]] = {
    "rad": ("arcsec", ARC_SECOND),
    "m/s^2": ("mGal", 1e-5),
    "rad/s": ("deg/h", DEG_PER_HOUR),
    "1": ("ppm", PPM),
    "s": ("us", 1e-6),
    "m": ("mm", 1e-3),
}


def unit_of(key: Key) -> tuple[str, float]:
    """The unit that a parameter is written in, and what it is in SI."""
    return UNITS[key.sensor][key.term]


def name_of(key: Key) -> str:
    """A parameter in words: 'gyro misalignment X1 toward Y1'."""
    toward = "" if key.toward is None else f" toward {AXES[key.toward]}"
    return f"{key.sensor} {key.term.replace('_', ' ')} {AXES[key.axis]}{toward}"
