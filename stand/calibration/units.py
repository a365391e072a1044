"""In which unit a parameter of a calibration is written."""

from collections.abc import Mapping

from alignment.calibration import Key
from alignment.units import ARC_SECOND, DEG_PER_HOUR, PPM
from stand.imu.known import UNITS
from stand.samples import AXES

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
