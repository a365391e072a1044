"""Whether a calibrated unit keeps its limits: with guard bands, so that no verdict is by chance.

PASS where the value and its expanded uncertainty are within the limit, FAIL where both are beyond,
INDETERMINATE between: ISO 14253-1, guard bands of the expanded uncertainty on both sides.
"""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from enum import Enum
from os import PathLike, fspath
from typing import Annotated, Any

from pydantic import Field, create_model

from alignment.units import ARC_SECOND
from stand import toml_files as catalogue
from stand.bounds import LARGEST_STATED
from stand.calibration.file import CalibrationRecord
from stand.calibration.units import AXES, UNITS, unit_of
from stand.errors import StandError
from stand.imu.preset import ACCEL_KEYS, GYRO_KEYS, SensorEntry, imu_from
from stand.toml_files import Source

COVERAGE = 2.0  # 95 % of normal errors
SIGMAS = 3.0  # of what a sheet states as no maximum: a limit that 1 unit of 370 misses
ANGLES = ("rotation", "non_orthogonality")
Largest = Annotated[float, Field(gt=0, le=LARGEST_STATED)]

# term or angle: the sheet's key without its unit
_SHEETS: Mapping[str, str] = {
    "bias": "turn_on_bias",
    "scale": "scale_factor",
    "asymmetry": "scale_asymmetry",
    "k2": "second_order",
    "g_sensitivity": "g_sensitivity",
    "g2_sensitivity": "g2_sensitivity",
    "temperature_bias": "bias_temperature",
    "temperature_scale": "scale_temperature",
    "rotation": "misalignment",
    "non_orthogonality": "non_orthogonality",
}


class Verdict(Enum):
    """Of one value against its limit."""

    PASS = "PASS"
    FAIL = "FAIL"
    INDETERMINATE = "INDETERMINATE"


@dataclass(frozen=True, slots=True, kw_only=True)
class Judgement:
    """One value against its limit, in `unit`; `source` of the limit."""

    name: str
    unit: str
    value: float
    expanded: float
    limit: float
    source: str
    noise_only: bool = False

    @property
    def verdict(self) -> Verdict:
        """By the guard band."""
        size = abs(self.value)
        if size + self.expanded <= self.limit:
            return Verdict.PASS
        return Verdict.FAIL if size - self.expanded > self.limit else Verdict.INDETERMINATE


def key_of(term: str, unit: str) -> str:
    """How a limit is called in a file: 'bias_deg_h', 'k2_ug_g2'."""
    return f"{term}_{re.sub(r'[^A-Za-z0-9]+', '_', unit.replace('^', '')).strip('_')}"


def _keys(sensor: str) -> dict[str, tuple[str, float]]:
    """Keys of a sensor: what is limited, and its unit in SI."""
    found = {key_of(term, unit): (term, size) for term, (unit, size) in UNITS[sensor].items()}
    return found | {key_of(angle, "arcsec"): (angle, ARC_SECOND) for angle in ANGLES}


def _model(sensor: str) -> type[catalogue.Entry]:
    fields: dict[str, Any] = dict.fromkeys(_keys(sensor), (Largest | None, None))
    doc = f"Largest size of each constant of the {sensor}s, any axis."
    name = f"{sensor.title()}Limits"
    return create_model(name, __base__=catalogue.Entry, __doc__=doc, **fields)


GyroLimits, AccelLimits = _model("gyro"), _model("accel")


class LimitsEntry(catalogue.Entry):
    """Limits as a file says them; `coverage` times sigma is the expanded uncertainty."""

    coverage: Annotated[float, Field(ge=1, le=5)] = COVERAGE
    gyro: GyroLimits = GyroLimits()  # pyright: ignore[reportInvalidTypeForm]
    accel: AccelLimits = AccelLimits()  # pyright: ignore[reportInvalidTypeForm]


@dataclass(frozen=True, slots=True)
class Limits:
    """Largest sizes in SI by (sensor, term or angle), with where each is from."""

    coverage: float
    largest: Mapping[tuple[str, str], tuple[float, str]]


def load_limits(path: str | PathLike[str]) -> Limits:
    """Read a file of limits.

    Raises
    ------
    StandError
        One line: the file, the key, the value, what is allowed.
    """
    name = fspath(path)
    if not name.endswith(".toml"):
        raise StandError(f"{name}: limits must be a TOML file")
    entry = catalogue.parse(catalogue.find("limits", "file of limits", name), LimitsEntry)
    found: dict[tuple[str, str], tuple[float, str]] = {}
    for sensor in ("gyro", "accel"):
        keys = _keys(sensor)
        for key, value in getattr(entry, sensor):
            if value is not None:
                term, size = keys[key]
                found[sensor, term] = (value * size, name)
    return Limits(entry.coverage, found)


def sheet_limits(record: CalibrationRecord) -> Limits:
    """What the unit's data sheet states: a maximum as it is, anything else `SIGMAS` times."""
    text = record.unit.get("toml")
    if not text:
        return Limits(COVERAGE, {})
    name = record.unit.get("id", "sheet")
    entry = imu_from(Source(name, f"{name}.toml", text)).entry
    found = dict(_stated("gyro", entry.gyro)) | dict(_stated("accel", entry.accel))
    return Limits(COVERAGE, found)


def _stated(sensor: str, entry: SensorEntry) -> Iterator[tuple[tuple[str, str], tuple[float, str]]]:
    keys = GYRO_KEYS if sensor == "gyro" else ACCEL_KEYS
    stated = entry.stated()
    for term, base in _SHEETS.items():
        for key, value in stated.items():
            if value.value > 0 and re.fullmatch(rf"{base}_(?!temperature)[A-Za-z0-9_]+", key):
                is_maximum = value.kind == "maximum"
                size = value.value * keys[key].unit * (1.0 if is_maximum else SIGMAS)
                source = "sheet's maximum" if is_maximum else f"{SIGMAS:g} × sheet's {value.kind}"
                yield (sensor, term), (size, source)


def judged(record: CalibrationRecord, limits: Limits) -> list[Judgement]:
    """Every value that has a limit."""
    found = []
    for p in record.calibration.parameters:
        key, (unit, size) = p.key, unit_of(p.key)
        if (key.sensor, key.term) in limits.largest:
            toward = "" if key.toward is None else f" toward {AXES[key.toward]}"
            name = f"{key.sensor} {key.term.replace('_', ' ')} {AXES[key.axis]}{toward}"
            found.append((name, unit, size, p.value, p.sigma, key.sensor, key.term))
    for d in record.calibration.derived:
        if (d.sensor, d.quantity) in limits.largest:
            name = f"{d.sensor} {d.quantity.replace('_', ' ')} about {AXES[d.axis]}"
            found.append((name, "arcsec", ARC_SECOND, d.value, d.sigma, d.sensor, d.quantity))
    return [
        Judgement(
            name=name,
            unit=unit,
            value=value / size,
            expanded=limits.coverage * sigma / size,
            limit=limits.largest[sensor, term][0] / size,
            source=limits.largest[sensor, term][1],
            noise_only=sensor in record.noise_only,
        )
        for name, unit, size, value, sigma, sensor, term in found
    ]


def overall(judgements: list[Judgement]) -> Verdict | None:
    """The worst of them; None where nothing has a limit."""
    verdicts = {j.verdict for j in judgements}
    for worst in (Verdict.FAIL, Verdict.INDETERMINATE, Verdict.PASS):
        if worst in verdicts:
            return worst
    return None
