"""Presets: what a data sheet says of a unit, as TOML with the unit in each key.

Each value comes with its kind (typical, 1 sigma, maximum; unspecified where the source does not
say) and its source. A key that is absent was not found; its term is zero.
"""

import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from itertools import pairwise
from math import inf, sqrt
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, create_model, model_validator

from alignment.arrays import Array, set_owned
from alignment.errors import AlignmentError
from alignment.skew import Axes, by_planes, unit_axes
from alignment.units import (
    ARC_SECOND,
    DEG,
    DEG_PER_HOUR,
    DEG_PER_RT_HOUR,
    M_S_PER_RT_HOUR,
    MICRO_G,
    MILLI_G,
    MRAD,
    PPM,
    STANDARD_GRAVITY,
)
from stand import toml_files as catalogue
from stand.bounds import Celsius, Offset, StatedLimit, StatedNumber
from stand.errors import StandError
from stand.imu.bands import ACCEL_BANDS, GYRO_BANDS, REFERENCE
from stand.imu.known import Known, KnownEntry
from stand.imu.processes import DEFAULT_CORNERS
from stand.imu.stated_units import conversion

HOUR = 3600.0
RT_HOUR = 60.0  # root seconds in a root hour
G = STANDARD_GRAVITY

Source = Annotated[str, Field(min_length=1)]
Kind = Literal["typical", "1 sigma", "maximum", "unspecified", "assumed"]


Place = tuple[Offset, Offset, Offset]

# names that sheets use, of keys that come without a unit
SHEET_NAMES = {"noise_density": "angle_random_walk|velocity_random_walk"}
# constants of a unit, which are drawn; of the rest (noise, drift, filter) a bound is the value
CONSTANTS = frozenset(
    {
        "bias",
        "scale",
        "asymmetry",
        "nonlinearity",
        "misalignment",
        "non_orthogonality",
        "g_sensitivity",
        "g2_sensitivity",
        "second_order",
        "bias_temperature",
        "scale_temperature",
    }
)


_CHANGING = {"noise": ("noise",), "drift": ("instability", "random_walk", "ramp")}
_AXES = {
    "turn-on bias": ("bias",),
    "scale factor error": ("scale",),
    "misalignment": ("misalignment", "non_orthogonality"),
}
NAMED_WHEN_ABSENT = {
    "gyros": _CHANGING | _AXES | {"g-sensitivity": ("g_sensitivity",)},
    "accelerometers": _CHANGING | _AXES,
}


class Stated(catalogue.Entry):
    """A value as a data sheet states it; `unspecified`: the source does not say which kind."""

    value: StatedNumber
    kind: Kind
    source: Source


class Limit(Stated):
    """A stated value that must be above zero: a range, a bandwidth, a resolution."""

    value: StatedLimit


class Places(catalogue.Entry):
    """Where the X1, Y1 and Z1 accelerometers sit: x, y, z in b, from the IMU's point."""

    value: tuple[Place, Place, Place]
    kind: Kind
    source: Source


class SensitiveAxes(catalogue.Entry):
    """Along what three sensors of a triad feel, in b: skewed by design, any length."""

    value: tuple[Place, Place, Place]
    kind: Kind
    source: Source

    @model_validator(mode="after")
    def _span(self) -> "SensitiveAxes":
        try:
            unit_axes(self.value)
        except AlignmentError as error:
            raise ValueError(str(error)) from error
        return self


class PlaneAngle(catalogue.Entry):
    """Angle theta between the planes of X1's and the third gyro's resonators."""

    value: Annotated[float, Field(ge=5, le=175)]
    kind: Kind
    source: Source


@dataclass(frozen=True, slots=True)
class Key:
    """A key of a preset: the SI field it fills, its unit in SI, and whether zero makes sense."""

    field: str
    unit: float
    limit: bool = False


# Keys both sensors have, by the sensor's own units.
GYRO_KEYS: Mapping[str, Key] = {
    "turn_on_bias_deg_h": Key("bias", DEG_PER_HOUR),
    "bias_instability_deg_h": Key("instability", DEG_PER_HOUR),
    "angle_random_walk_deg_rt_h": Key("noise", DEG_PER_RT_HOUR),
    "rate_random_walk_deg_h_rt_h": Key("random_walk", DEG_PER_HOUR / RT_HOUR),
    "rate_ramp_deg_h_h": Key("ramp", DEG_PER_HOUR / HOUR),
    "scale_factor_ppm": Key("scale", PPM),
    "scale_asymmetry_ppm": Key("asymmetry", PPM),
    "scale_nonlinearity_ppm": Key("nonlinearity", PPM),
    "misalignment_mrad": Key("misalignment", MRAD),
    "non_orthogonality_mrad": Key("non_orthogonality", MRAD),
    "g_sensitivity_deg_h_g": Key("g_sensitivity", DEG_PER_HOUR / G),
    "g2_sensitivity_deg_h_g2": Key("g2_sensitivity", DEG_PER_HOUR / G**2),
    "bias_temperature_deg_h_K": Key("bias_temperature", DEG_PER_HOUR),
    "scale_temperature_ppm_K": Key("scale_temperature", PPM),
    "bandwidth_hz": Key("bandwidth", 1.0, limit=True),
    "range_deg_s": Key("range", DEG, limit=True),
    "resolution_deg_s": Key("resolution", DEG, limit=True),
    "increment_lsb_arc_s": Key("increment_lsb", ARC_SECOND, limit=True),
}
ACCEL_KEYS: Mapping[str, Key] = {
    "turn_on_bias_mg": Key("bias", MILLI_G),
    "bias_instability_ug": Key("instability", MICRO_G),
    "velocity_random_walk_m_s_rt_h": Key("noise", M_S_PER_RT_HOUR),
    "acceleration_random_walk_ug_rt_h": Key("random_walk", MICRO_G / RT_HOUR),
    "acceleration_ramp_ug_h": Key("ramp", MICRO_G / HOUR),
    "scale_factor_ppm": Key("scale", PPM),
    "scale_asymmetry_ppm": Key("asymmetry", PPM),
    "scale_nonlinearity_ppm": Key("nonlinearity", PPM),
    "misalignment_mrad": Key("misalignment", MRAD),
    "non_orthogonality_mrad": Key("non_orthogonality", MRAD),
    "second_order_ug_g2": Key("second_order", MICRO_G / G**2),
    "bias_temperature_ug_K": Key("bias_temperature", MICRO_G),
    "scale_temperature_ppm_K": Key("scale_temperature", PPM),
    "bandwidth_hz": Key("bandwidth", 1.0, limit=True),
    "range_g": Key("range", G, limit=True),
    "resolution_mg": Key("resolution", MILLI_G, limit=True),
    "increment_lsb_m_s": Key("increment_lsb", 1.0, limit=True),
}


def _in_own_unit(key: str, value: object, fields: list[str]) -> tuple[str, object]:
    """The key with its unit, and the value in it, of a value that brings a unit of its own."""
    if key in fields or not isinstance(value, dict) or "unit" not in value:
        return key, value
    base = SHEET_NAMES.get(key, key)
    names = [field for field in fields if re.fullmatch(rf"(?:{base})_[A-Za-z_0-9]+", field)]
    number, unit = value.get("value"), value["unit"]
    if len(names) != 1 or isinstance(number, bool) or not isinstance(number, int | float):
        return key, value  # said as any wrong key or value is
    own = (GYRO_BANDS.get(names[0]) or ACCEL_BANDS[names[0]]).unit
    try:
        scale = conversion(str(unit), own)
    except StandError as error:
        raise ValueError(f"{key}, {error}") from error
    rest = {name: part for name, part in value.items() if name != "unit"}
    return names[0], rest | {"value": number * scale}


class SensorEntry(catalogue.Entry):
    """What both triads share: a range wherever non-linearity is stated against it.

    A key without its unit takes the unit beside the value, as the data sheet writes it:
    ``angle_random_walk = { value = 3.8, unit = "mdps/rt-Hz", ... }``.
    """

    @model_validator(mode="before")
    @classmethod
    def _units_of_sheets(cls, data: object) -> object:
        if not isinstance(data, dict):
            return data
        converted: dict[str, object] = {}
        for key, value in data.items():
            name, own = _in_own_unit(key, value, list(cls.model_fields))
            if name in converted or (name != key and name in data):
                raise ValueError(f"{key}: is stated twice, as {name} too")
            converted[name] = own
        return converted

    @model_validator(mode="after")
    def _nonlinearity_needs_range(self) -> "SensorEntry":
        has_range = any(k.startswith("range_") and v is not None for k, v in self)
        if getattr(self, "scale_nonlinearity_ppm", None) is not None and not has_range:
            raise ValueError("scale_nonlinearity_ppm: is a part of the range, which is missing")
        return self

    @model_validator(mode="after")
    def _one_way_to_be_skewed(self) -> "SensorEntry":
        axes = getattr(self, "axes", None)
        for other in ("plane_angle_deg", "places_mm"):
            if axes is not None and getattr(self, other, None) is not None:
                raise ValueError(f"axes and {other}: not both")
        return self

    def sensitive_axes(self) -> Axes | None:
        """Unit vectors along which the triad feels, in b; None of a square one along b."""
        angle, axes = getattr(self, "plane_angle_deg", None), getattr(self, "axes", None)
        if angle is not None:
            return by_planes(angle.value * DEG)
        if axes is None:
            return None
        x, y, z = unit_axes(axes.value).tolist()
        return tuple(x), tuple(y), tuple(z)

    def stated(self) -> dict[str, Stated]:
        """The values that are stated, by key."""
        return {key: value for key, value in self if isinstance(value, Stated)}


def _entry(name: str, doc: str, keys: Mapping[str, Key], **more: Any) -> type[SensorEntry]:
    fields: dict[str, Any] = {
        key: ((Limit if k.limit else Stated) | None, None) for key, k in keys.items()
    }
    return create_model(name, __base__=SensorEntry, __doc__=doc, **fields, **more)


GyroEntry = _entry(
    "GyroEntry",
    "Gyro triad.",
    GYRO_KEYS,
    axes=(SensitiveAxes | None, None),
    plane_angle_deg=(PlaneAngle | None, None),
)
AccelEntry = _entry(
    "AccelEntry",
    "Accelerometer triad.",
    ACCEL_KEYS,
    axes=(SensitiveAxes | None, None),
    places_mm=(Places | None, None),
)


class SamplingEntry(catalogue.Entry):
    """How the unit samples; its clock's own errors.

    `output` 'rate' gives means over the interval, rounded to the resolution; 'increment' gives
    integrals over it, whose rounding errors do not add up. `output_rate_hz` is for the reader.
    """

    output: Literal["rate", "increment"] = "rate"
    output_rate_hz: Limit | None = None
    clock_offset_ppm: Stated | None = None
    jitter_us: Stated | None = None
    latency_ms: Stated | None = None


class ImuEntry(catalogue.Entry):
    """A preset as its TOML file says it; `evidence` grades the sources.

    A: manufacturer's document. B: part of a manufacturer's page. C: third party. none: assumed.
    `bias_corners_s`: correlation times of the processes that make up the bias instability.
    `known`: constants of this one unit by value, as a calibration found them.
    """

    title: str
    grade: str
    evidence: Literal["A", "B", "C", "none"]
    bias_corners_s: Annotated[tuple[StatedLimit, ...], Field(min_length=1)] = DEFAULT_CORNERS
    reference_temperature_C: Celsius = 25.0
    known: Annotated[tuple[KnownEntry, ...], Field(max_length=200)] = ()
    gyro: GyroEntry  # pyright: ignore[reportInvalidTypeForm]
    accel: AccelEntry  # pyright: ignore[reportInvalidTypeForm]
    sampling: SamplingEntry = SamplingEntry()

    @model_validator(mode="after")
    def _known_fit(self) -> "ImuEntry":
        names = [(k.sensor, k.term, k.axis, k.toward) for k in self.known]
        for name, one in zip(names, self.known, strict=True):
            triad = self.gyro if one.sensor == "gyro" else self.accel
            if names.count(name) > 1:
                raise ValueError(f"known: {one.sensor} {one.term} {one.axis} is there twice")
            if triad.sensitive_axes() is not None:
                raise ValueError(f"known: {one.sensor} has axes of its own, must be along b")
            if one.term == "k3" and not any(k.startswith("range_") for k in triad.stated()):
                raise ValueError(f"known: {one.sensor} k3: must have a range in [{one.sensor}]")
        return self

    @model_validator(mode="after")
    def _corners_increase(self) -> "ImuEntry":
        corners = self.bias_corners_s
        if any(b <= a for a, b in pairwise(corners)):
            raise ValueError(f"bias_corners_s = {list(corners)}: must increase")
        return self


@dataclass(frozen=True, slots=True, eq=False)
class TriadSpec:
    """Three like sensors in SI: what the data sheet says of each axis.

    With u for rad/s or m/s^2: `bias`, `instability` [u], `noise` [u/rt-Hz], `random_walk`
    [u/rt-s], `ramp` [u/s]; `scale`, `asymmetry`, `nonlinearity` (at `full_scale`) [1];
    `misalignment`, `non_orthogonality` [rad]; `g_sensitivity` [u/(m/s^2)], `g2_sensitivity`,
    `second_order` [u/(m/s^2)^2]; `bias_temperature` [u/K], `scale_temperature` [1/K];
    `bandwidth` [Hz], `range` [u], infinite where not stated; `resolution` [u], `increment_lsb`
    [u s], zero where not stated. `full_scale` [u] is the stated range, even with saturation off.
    Constants are standard deviations. Those named in `bounded` were stated as a maximum: they are
    drawn evenly within that bound, and their standard deviation is 1/sqrt(3) of it (GUM 4.3.7).
    `axes`: unit vectors along which the sensors feel, in b, where they are skewed by design.
    `known`: constants by value, drawn about it in place of the stated spread.
    """

    bias: float = 0.0
    instability: float = 0.0
    noise: float = 0.0
    random_walk: float = 0.0
    ramp: float = 0.0
    scale: float = 0.0
    asymmetry: float = 0.0
    nonlinearity: float = 0.0
    misalignment: float = 0.0
    non_orthogonality: float = 0.0
    g_sensitivity: float = 0.0
    g2_sensitivity: float = 0.0
    second_order: float = 0.0
    bias_temperature: float = 0.0
    scale_temperature: float = 0.0
    bandwidth: float = inf
    range: float = inf
    resolution: float = 0.0
    increment_lsb: float = 0.0
    full_scale: float = inf
    bounded: frozenset[str] = frozenset()
    axes: Axes | None = None
    known: tuple[Known, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class ClockSpec:
    """`offset` [1], `jitter` [s] of each sample's time, `latency` [s]."""

    offset: float = 0.0
    jitter: float = 0.0
    latency: float = 0.0

    @property
    def perfect(self) -> bool:
        """Whether samples are taken when their stamps say so."""
        return not (self.offset or self.jitter or self.latency)


@dataclass(frozen=True, slots=True, eq=False)
class ImuSpec:
    """A checked preset in SI, with its id and source text.

    `places` (3, 3) [m]: row i is where accelerometer i sits, in b, from the IMU's point.
    """

    id: str
    title: str
    text: str
    entry: ImuEntry
    gyro: TriadSpec
    accel: TriadSpec
    clock: ClockSpec
    places: Array
    corners: tuple[float, ...]
    increments: bool
    reference_temperature: float

    def __post_init__(self) -> None:
        set_owned(self, places=(self.places, (3, 3), float))

    @property
    def ranges(self) -> tuple[float, float]:
        """Where gyros [rad/s] and accelerometers [m/s^2] saturate; infinite where not stated."""
        return self.gyro.range, self.accel.range

    @property
    def filtered(self) -> bool:
        """Whether gyros or accelerometers have a low-pass."""
        return bool(np.isfinite(min(self.gyro.bandwidth, self.accel.bandwidth)))


def load_imu(name: str) -> ImuSpec:
    """A preset by catalogue id or path; `StandError` where it is not right."""
    return imu_from(catalogue.find("imus", "imu", name))


def imu_from(source: catalogue.Source) -> ImuSpec:
    """Check a preset's text."""
    entry = catalogue.parse(source, ImuEntry)
    sampling = entry.sampling
    places = entry.accel.places_mm  # pyright: ignore[reportAttributeAccessIssue]
    return ImuSpec(
        id=source.id,
        title=entry.title,
        text=source.text,
        entry=entry,
        gyro=_triad(entry.gyro, GYRO_KEYS, _known(entry, "gyro")),
        accel=_triad(entry.accel, ACCEL_KEYS, _known(entry, "accel")),
        clock=ClockSpec(
            _si(sampling.clock_offset_ppm, PPM),
            _si(sampling.jitter_us, 1e-6),
            _si(sampling.latency_ms, 1e-3),
        ),
        places=np.zeros((3, 3)) if places is None else np.array(places.value) * 1e-3,
        corners=entry.bias_corners_s,
        increments=sampling.output == "increment",
        reference_temperature=entry.reference_temperature_C,
    )


def _known(entry: ImuEntry, sensor: str) -> tuple[Known, ...]:
    return tuple(one.known() for one in entry.known if one.sensor == sensor)


def _triad(entry: SensorEntry, keys: Mapping[str, Key], known: tuple[Known, ...] = ()) -> TriadSpec:
    stated = {keys[key].field: (s, s.value * keys[key].unit) for key, s in entry.stated().items()}
    bounded = {f for f, (s, _) in stated.items() if s.kind == "maximum" and f in CONSTANTS}
    values = {f: v / sqrt(3) if f in bounded else v for f, (_, v) in stated.items()}
    return TriadSpec(
        **values,
        full_scale=values.get("range", inf),
        bounded=frozenset(bounded),
        axes=entry.sensitive_axes(),
        known=known,
    )


_NOT_HELD = ("none is simulated or predicted", "simulated as known by value, not predicted")


def unstated(spec: ImuSpec, found: Collection[tuple[str, str]] = ()) -> tuple[str, ...]:
    """What the data sheet does not say and no prediction holds, one sentence each.

    But for what readings told nevertheless: `found` by sensor ('gyro', 'accel') and field.
    """
    entry = spec.entry
    if REFERENCE in entry.grade.lower():
        return ()
    by_value = {(s, k.field) for s in ("gyro", "accel") for k in getattr(spec, s).known}
    return tuple(
        f"the sheet of {spec.id} states no {what} of the {sensors}: "
        + _NOT_HELD[any((sensor, field) in by_value for field in fields)]
        for sensor, sensors in (("gyro", "gyros"), ("accel", "accelerometers"))
        for what, fields in NAMED_WHEN_ABSENT[sensors].items()
        if not any(getattr(getattr(spec, sensor), field) for field in fields)
        if not any((sensor, field) in found for field in fields)
    )


def _si(stated: Stated | None, unit: float) -> float:
    return 0.0 if stated is None else stated.value * unit
