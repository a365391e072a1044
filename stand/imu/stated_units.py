"""Units as data sheets write them: 'mdps/rt-Hz', '°/√h', 'ug/√Hz', '%', 'dps/g'."""

import re
from math import prod

from alignment.units import ARC_MINUTE, ARC_SECOND, DEG, STANDARD_GRAVITY
from stand.errors import StandError

# dimension: powers of angle, length, time, temperature
Dimension = tuple[float, float, float, float]
_NONE: Dimension = (0, 0, 0, 0)
_ANGLE, _LENGTH, _TIME, _KELVIN = (1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1)
_FORCE, _PER_TIME, _ROOT_TIME = (0, 1, -2, 0), (0, 0, -1, 0), (0, 0, 0.5, 0)
_PER_ROOT_TIME = (0, 0, -0.5, 0)

_ATOMS: dict[str, tuple[float, Dimension]] = {
    "deg": (DEG, _ANGLE),
    "mdeg": (1e-3 * DEG, _ANGLE),
    "rad": (1.0, _ANGLE),
    "mrad": (1e-3, _ANGLE),
    "urad": (1e-6, _ANGLE),
    "arcmin": (ARC_MINUTE, _ANGLE),
    "arcsec": (ARC_SECOND, _ANGLE),
    "m": (1.0, _LENGTH),
    "mm": (1e-3, _LENGTH),
    "ft": (0.3048, _LENGTH),
    "g": (STANDARD_GRAVITY, _FORCE),
    "mg": (1e-3 * STANDARD_GRAVITY, _FORCE),
    "ug": (1e-6 * STANDARD_GRAVITY, _FORCE),
    "s": (1.0, _TIME),
    "ms": (1e-3, _TIME),
    "us": (1e-6, _TIME),
    "h": (3600.0, _TIME),
    "Hz": (1.0, _PER_TIME),
    "kHz": (1e3, _PER_TIME),
    "rt-h": (60.0, _ROOT_TIME),
    "rt-s": (1.0, _ROOT_TIME),
    "rt-Hz": (1.0, _PER_ROOT_TIME),
    "K": (1.0, _KELVIN),
    "ppm": (1e-6, _NONE),
    "%": (1e-2, _NONE),
    "1": (1.0, _NONE),
}
_SPELLINGS = (
    (r"\s+", ""),
    ("°C", "K"),
    ("°", "deg"),
    ("[µμ]", "u"),
    (r"(?:√|sqrt\(?|rt-?)\(?(Hz|hz|h|s)r?\)?", r"rt-\1"),
    (r"rt-hz", "rt-Hz"),
    (r"\bhz\b", "Hz"),
    (r"\bhr\b", "h"),
    (r"\bmdps\b", "mdeg/s"),
    (r"\bdps\b", "deg/s"),
    (r"\barcseconds?\b|\barc-?s\b", "arcsec"),
    (r"\barcminutes?\b", "arcmin"),
)


def scale_of(unit: str) -> tuple[float, Dimension]:
    """What one `unit` is in SI, and its dimension.

    Raises
    ------
    StandError
        A part of it is not known.
    """
    text = unit
    for spelling, ours in _SPELLINGS:
        text = re.sub(spelling, ours, text)
    factors, dimension = [], [0.0] * 4
    for k, part in enumerate(text.split("/")):
        name, _, power = part.partition("^")
        if name not in _ATOMS or (power and power not in ("1", "2", "3")):
            raise StandError(f"unit {unit!r}: {part!r} is not known; known: {', '.join(_ATOMS)}")
        factor, own = _ATOMS[name]
        exponent = int(power or 1) * (1 if k == 0 else -1)
        factors.append(factor**exponent)
        dimension = [d + exponent * o for d, o in zip(dimension, own, strict=True)]
    return prod(factors), (dimension[0], dimension[1], dimension[2], dimension[3])


def spelled(unit: str) -> str:
    """As `scale_of` takes it: m/s2, m/s/s, m/s² are m/s^2, sec is s."""
    text = unit.strip().replace("²", "^2").replace("m/s/s", "m/s^2")
    text = re.sub(r"\bsec(onds?)?\b", "s", text)
    return re.sub(r"(?<=/s)2$", "^2", text)


def conversion(unit: str, wanted: str) -> float:
    """How many `wanted` one `unit` is; a ratio may be told as an angle (2 % = 20 mrad).

    Raises
    ------
    StandError
        An unknown unit, or one of another kind.
    """
    factor, dimension = scale_of(unit)
    own, needed = scale_of(wanted)
    if dimension != needed and (dimension, needed) != (_NONE, _ANGLE):
        raise StandError(f"unit {unit!r}: is of another kind than {wanted!r}")
    return factor / own
