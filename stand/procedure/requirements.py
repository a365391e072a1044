"""What may be required of a unit's constants: keys of [require], and what they limit."""

from collections.abc import Iterable, Mapping
from typing import Annotated, NamedTuple

from pydantic import Field

from alignment.units import ARC_SECOND, DEG_PER_HOUR, MICRO_G, PPM, STANDARD_GRAVITY


class ConstantLimit(NamedTuple):
    """A key of [require]: which `rows` of a prediction it limits (they begin so), its unit.

    `term`: of a calibration; where a sheet states none it is looked for all the same.
    """

    key: str
    rows: tuple[str, ...]
    unit: tuple[str, float]
    term: str


_G = DEG_PER_HOUR / STANDARD_GRAVITY
CONSTANTS: Mapping[str, ConstantLimit] = {
    "gyro bias": ConstantLimit("gyro_bias_deg_h", ("gyro bias ",), ("deg/h", DEG_PER_HOUR), "bias"),
    "gyro scale": ConstantLimit("gyro_scale_ppm", ("gyro scale ",), ("ppm", PPM), "scale"),
    "accel bias": ConstantLimit(
        "accel_bias_ug", ("accel bias ", "accelerometer bias "), ("ug", MICRO_G), "bias"
    ),
    "accel scale": ConstantLimit("accel_scale_ppm", ("accel scale ",), ("ppm", PPM), "scale"),
    "misalignment": ConstantLimit(
        "misalignment_arc_s",
        ("gyro misalignment ", "accel misalignment "),
        ("arcsec", ARC_SECOND),
        "misalignment",
    ),
    "gyro to accel": ConstantLimit(
        "gyro_to_accel_arc_s", ("gyro to accel ",), ("arcsec", ARC_SECOND), "misalignment"
    ),
    "non-orthogonality": ConstantLimit(
        "non_orthogonality_arc_s",
        ("gyro non-orthogonality ", "accel non-orthogonality "),
        ("arcsec", ARC_SECOND),
        "non_orthogonality",
    ),
    "g-sensitivity": ConstantLimit(
        "g_sensitivity_deg_h_g", ("gyro g sensitivity ",), ("deg/h/g", _G), "g_sensitivity"
    ),
}


def terms_of(quantities: Iterable[str]) -> tuple[str, ...]:
    """Terms of a calibration that must be looked for, whatever the sheet states."""
    return tuple(dict.fromkeys(CONSTANTS[q].term for q in quantities if q in CONSTANTS))


PositiveLimit = Annotated[float, Field(gt=0, le=1e6)]
