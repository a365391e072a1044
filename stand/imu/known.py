"""Constant errors of one unit that are known by value, from its calibration.

A preset's ``known = [{ sensor = "gyro", term = "bias", axis = "X1", value = 3.1, unit = "deg/h",
sigma = 0.4 }]``: that constant is drawn about its value with its sigma, all others as stated.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from alignment.units import ARC_SECOND, DEG, DEG_PER_HOUR, MICRO_G, PPM, STANDARD_GRAVITY
from stand import toml_files as catalogue
from stand.bounds import LARGEST_STATED
from stand.samples import AXES

G = STANDARD_GRAVITY
_AxisName = Literal["X1", "Y1", "Z1"]
Value = Annotated[float, Field(ge=-LARGEST_STATED, le=LARGEST_STATED)]
Spread = Annotated[float, Field(ge=0, le=LARGEST_STATED)]

# term of a calibration: (unit it is written in, what that is in SI), of both sensors or of each
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
# term: field of `UnitErrors`, of which the sheet's field of the same name is the spread
FIELDS: Mapping[str, str] = {
    "bias": "bias",
    "scale": "scale",
    "misalignment": "misalignment",
    "asymmetry": "asymmetry",
    "k2": "second_order",
    "k3": "nonlinearity",
    "g_sensitivity": "g_sensitivity",
    "g2_sensitivity": "g2_sensitivity",
    "temperature_bias": "bias_temperature",
    "temperature_scale": "scale_temperature",
}
_TOWARD = ("misalignment", "g_sensitivity", "g2_sensitivity")


@dataclass(frozen=True, slots=True, kw_only=True)
class Known:
    """A constant of a triad in SI: `term` and `axis`, `toward` of terms of two axes."""

    term: str
    axis: int
    toward: int | None
    value: float
    sigma: float

    @property
    def field(self) -> str:
        """Of the sheet, whose spread it takes the place of."""
        return FIELDS[self.term]


def check_unit(sensor: str, term: str, unit: str) -> None:
    """`ValueError` where a sensor has no such term, or the term another unit."""
    known = UNITS[sensor]
    if term not in known:
        raise ValueError(f"term = {term!r}: no {sensor} has it")
    must = known[term][0]
    if unit != must:
        raise ValueError(f"unit = {unit!r}: must be {must!r} of {sensor} {term}")


class KnownEntry(catalogue.Entry):
    """A constant error that is known by value, in the unit of its term."""

    sensor: Literal["gyro", "accel"]
    term: Literal[tuple(FIELDS)]  # pyright: ignore[reportInvalidTypeForm]
    axis: _AxisName
    toward: _AxisName | None = None
    value: Value
    unit: Annotated[str, Field(max_length=20)]
    sigma: Spread = 0.0

    @model_validator(mode="after")
    def _means_something(self) -> Self:
        check_unit(self.sensor, self.term, self.unit)
        if (self.toward is None) is (self.term in _TOWARD):
            raise ValueError(f"toward: must be there of {', '.join(_TOWARD)}, and of no other term")
        if self.term == "misalignment" and self.toward == self.axis:
            raise ValueError(f"toward = {self.toward!r}: must be another axis than its own")
        return self

    def known(self) -> Known:
        """The same in SI."""
        size = UNITS[self.sensor][self.term][1]
        return Known(
            term=self.term,
            axis=AXES.index(self.axis),
            toward=None if self.toward is None else AXES.index(self.toward),
            value=self.value * size,
            sigma=self.sigma * size,
        )
