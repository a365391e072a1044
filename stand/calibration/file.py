"""`calibration.json`: what a calibration found, written and read here."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from math import inf, isfinite
from os import PathLike
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

from alignment.calibration import (
    Calibration,
    Contribution,
    Derived,
    Gravity,
    Key,
    LeftOut,
    Nuisance,
    Parameter,
    Residual,
)
from alignment.calibration.result import BASES, QUANTITIES, SENSORS, TERMS
from alignment.units import ARC_SECOND
from stand.bounds import Celsius
from stand.calibration.units import AXES, OF_NUISANCE, UNITS, unit_of
from stand.errors import StandError
from stand.folder import refuse_no_file
from stand.imu.known import check_unit
from stand.toml_files import checked

FORMAT = 1
MOST_BYTES = 50_000_000  # of a file: a covariance of 100 parameters has some 200 000
SYMMETRIC = 1e-6  # of a covariance's entries, relative to the sigmas
_AxisName = Literal["X1", "Y1", "Z1"]
_Text = Annotated[str, Field(max_length=2000)]
# values in the units of `stand.calibration.units`: beyond these no sensor is one
_Value = Annotated[float, Field(ge=-1e12, le=1e12)]
_Sigma = Annotated[float, Field(ge=0, le=1e12)]
_Entry = Annotated[float, Field(ge=-1e24, le=1e24)]
_Count = Annotated[int, Field(ge=0, le=10**9)]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class CalibrationRecord:
    """A calibration with where it comes from.

    Attributes
    ----------
    calibration : Calibration
    unit : mapping
        'id', 'title', 'serial' of the unit, as far as they are known; `toml` of its data sheet.
    source : mapping
        How it was made: 'method', 'procedure', 'table' and so on, and the recordings' names.
    axes : str
        What X1, Y1, Z1 are of the log's axes, where it was read with ``--axes``.
    hashes, versions : mapping
        SHA-256 of each recording; versions by package.
    errors : sequence of float or None
        Value less truth of each parameter, SI, where the truth is known.
    noise_only : set of str
        The sensors ('gyro', 'accel') of which no data sheet told more than noise: sigmas of theirs
        hold no drift.
    """

    calibration: Calibration
    unit: Mapping[str, str] = field(default_factory=dict)
    source: Mapping[str, str] = field(default_factory=dict)
    axes: str = ""
    hashes: Mapping[str, str] = field(default_factory=dict)
    versions: Mapping[str, str] = field(default_factory=dict)
    errors: Sequence[float] | None = None
    noise_only: frozenset[str] = frozenset(SENSORS)


# --- written -------------------------------------------------------------------------------------


def record_to_json(record: CalibrationRecord) -> dict[str, Any]:
    """For machines: every value beside its unit; an infinite prior is null."""
    c = record.calibration
    sizes = _sizes(c.keys)
    return {
        "format": FORMAT,
        "unit": dict(record.unit),
        "parameters": [
            _parameter(p, None if record.errors is None else record.errors[n])
            for n, p in enumerate(c.parameters)
        ],
        "derived": [_derived(d) for d in c.derived],
        "noise_only": sorted(record.noise_only),
        "chi_square": c.chi_square,
        "dof": c.dof,
        "enlarged": c.enlarged,
        "gravity": {"value_m_s2": c.gravity.value, "sigma_m_s2": c.gravity.sigma},
        "reference_temperature_C": c.reference_temperature,
        "notes": list(c.notes),
        "null_space": list(c.null_space),
        "left_out": [{"stretch": one.stretch, "reason": one.reason} for one in c.left_out],
        "budget": [
            {"source": one.name, "sigma": (one.sigmas / sizes).tolist()} for one in c.budget
        ],
        "nuisance": [_nuisance(n) for n in c.nuisance],
        "residuals": [
            {"stretch": one.stretch, "of": one.of, "sigmas": list(one.sigmas)}
            for one in c.residuals
        ],
        "axes": record.axes,
        "source": dict(record.source),
        "versions": dict(record.versions),
        "hashes": dict(record.hashes),
        "covariance": (c.covariance / np.outer(sizes, sizes)).tolist(),
    }


def calibration_text(record: CalibrationRecord) -> str:
    """The text of `calibration.json`."""
    return json.dumps(record_to_json(record), indent=1, allow_nan=False) + "\n"


def _sizes(keys: Sequence[Key]) -> np.ndarray:
    return np.array([unit_of(key)[1] for key in keys])


def _finite(value: float) -> float | None:
    return value if isfinite(value) else None


def _parameter(p: Parameter, error: float | None) -> dict[str, Any]:
    key = p.key
    unit, size = unit_of(key)
    told: dict[str, Any] = {"sensor": key.sensor, "term": key.term, "axis": AXES[key.axis]}
    if key.toward is not None:
        told["toward"] = AXES[key.toward]
    told |= {
        "value": p.value / size,
        "unit": unit,
        "sigma": p.sigma / size,
        "prior_sigma": _finite(p.prior_sigma / size),
        "told_by": p.basis,
        "share": p.share,
    }
    return told if error is None else told | {"error": error / size}


def _derived(d: Derived) -> dict[str, Any]:
    return {
        "quantity": d.quantity,
        "sensor": d.sensor,
        "axis": AXES[d.axis],
        "value_arc_s": d.value / ARC_SECOND,
        "sigma_arc_s": d.sigma / ARC_SECOND,
    }


def _nuisance(n: Nuisance) -> dict[str, Any]:
    unit, size = OF_NUISANCE[n.unit]
    return {
        "name": n.name,
        "value": n.value / size,
        "unit": unit,
        "sigma": n.sigma / size,
        "prior_sigma": _finite(n.prior_sigma / size),
        "told_by": n.basis,
        "share": n.share,
    }


# --- read ----------------------------------------------------------------------------------------


class _Read(BaseModel):
    """Base of what is read back: finite numbers, none of them as text; more keys pass."""

    model_config = ConfigDict(frozen=True, allow_inf_nan=False, strict=True, defer_build=True)


_Share = Annotated[float, Field(ge=0, le=1)]


class ParameterEntry(_Read):
    """One parameter, in its unit."""

    sensor: Literal[SENSORS]  # pyright: ignore[reportInvalidTypeForm]
    term: Literal[TERMS]  # pyright: ignore[reportInvalidTypeForm]
    axis: _AxisName
    toward: _AxisName | None = None
    value: _Value
    unit: _Text
    sigma: _Sigma
    prior_sigma: _Sigma | None = None
    basis: Annotated[Literal[BASES], Field(alias="told_by")]  # pyright: ignore
    share: _Share = 0.0
    error: _Value | None = None

    @model_validator(mode="after")
    def _its_unit(self) -> Self:
        check_unit(self.sensor, self.term, self.unit)
        self.key()  # its fault is told here
        return self

    def key(self) -> Key:
        """Which parameter it is."""
        toward = None if self.toward is None else AXES.index(self.toward)
        return Key(self.sensor, self.term, AXES.index(self.axis), toward)

    def parameter(self) -> Parameter:
        """The same in SI."""
        size = UNITS[self.sensor][self.term][1]
        return Parameter(
            key=self.key(),
            value=self.value * size,
            sigma=self.sigma * size,
            prior_sigma=inf if self.prior_sigma is None else self.prior_sigma * size,
            basis=self.basis,
            share=self.share,
        )


class NuisanceEntry(_Read):
    """What was estimated beside the unit, in its unit."""

    name: _Text
    value: _Value
    unit: Literal["arcsec", "mGal", "deg/h", "ppm", "us", "mm"]
    sigma: _Sigma
    prior_sigma: _Sigma | None = None
    basis: Annotated[Literal[BASES], Field(alias="told_by")]  # pyright: ignore
    share: _Share = 0.0

    def nuisance(self) -> Nuisance:
        """The same in SI."""
        si, size = next((si, size) for si, (u, size) in OF_NUISANCE.items() if u == self.unit)
        return Nuisance(
            name=self.name,
            value=self.value * size,
            sigma=self.sigma * size,
            prior_sigma=inf if self.prior_sigma is None else self.prior_sigma * size,
            basis=self.basis,
            share=self.share,
            unit=si,
        )


class DerivedEntry(_Read):
    """An angle that the misalignments come to."""

    quantity: Literal[QUANTITIES]  # pyright: ignore[reportInvalidTypeForm]
    sensor: Literal[SENSORS]  # pyright: ignore[reportInvalidTypeForm]
    axis: _AxisName
    value_arc_s: _Value
    sigma_arc_s: _Sigma

    def derived(self) -> Derived:
        """The same in SI."""
        return Derived(
            quantity=self.quantity,
            sensor=self.sensor,
            axis=AXES.index(self.axis),
            value=self.value_arc_s * ARC_SECOND,
            sigma=self.sigma_arc_s * ARC_SECOND,
        )


class GravityEntry(_Read):
    """Gravity, as anywhere on Earth."""

    value_m_s2: Annotated[float, Field(gt=9, lt=10.5)]
    sigma_m_s2: Annotated[float, Field(ge=0, le=1)] = 0.0


class LeftOutEntry(_Read):
    """A stretch that was not used."""

    stretch: _Text
    reason: _Text


class ContributionEntry(_Read):
    """What one source gives to each parameter's sigma, in its unit."""

    source: _Text
    sigma: tuple[_Sigma, ...]


class ResidualEntry(_Read):
    """What the fit leaves of one stretch, in sigmas."""

    stretch: _Text
    of: _Text
    sigmas: tuple[Annotated[float, Field(ge=-1e9, le=1e9)], ...]


class CalibrationEntry(_Read):
    """What `record_to_json` writes."""

    format: Literal[1]
    unit: dict[str, str] = {}
    parameters: Annotated[tuple[ParameterEntry, ...], Field(min_length=1, max_length=1000)]
    derived: tuple[DerivedEntry, ...] = ()
    noise_only: Annotated[tuple[Literal["gyro", "accel"], ...], Field(max_length=2)] | None = None
    chi_square: Annotated[float, Field(ge=0, le=1e18)]
    dof: _Count
    enlarged: Annotated[float, Field(ge=1, le=1e6)] = 1.0
    gravity: GravityEntry
    reference_temperature_C: Celsius = 25.0
    notes: tuple[_Text, ...] = ()
    null_space: tuple[_Text, ...] = ()
    left_out: tuple[LeftOutEntry, ...] = ()
    nuisance: tuple[NuisanceEntry, ...] = ()
    budget: tuple[ContributionEntry, ...] = ()
    residuals: tuple[ResidualEntry, ...] = ()
    axes: _Text = ""
    source: dict[str, str] = {}
    versions: dict[str, str] = {}
    hashes: dict[str, str] = {}
    covariance: tuple[tuple[_Entry, ...], ...]

    @model_validator(mode="after")
    def _fits(self) -> Self:
        keys = [p.key() for p in self.parameters]
        if len(set(keys)) < len(keys):
            raise ValueError("parameters: one of them is there twice")
        n = len(keys)
        if len(self.covariance) != n or any(len(row) != n for row in self.covariance):
            raise ValueError(f"covariance: must have {n} rows of {n}, as there are parameters")
        for one in self.budget:
            if len(one.sigma) != n:
                raise ValueError(f"budget, {one.source}: must have {n} sigmas")
        _check_covariance(np.array(self.covariance), np.array([p.sigma for p in self.parameters]))
        return self

    def _noise_only(self) -> frozenset[str]:
        """As written; files of older versions have but the sheet."""
        if self.noise_only is not None:
            return frozenset(self.noise_only)
        return frozenset(() if self.unit.get("toml") else SENSORS)

    def record(self) -> CalibrationRecord:
        """The same in SI."""
        parameters = tuple(p.parameter() for p in self.parameters)
        sizes = _sizes([p.key for p in parameters])
        errors = [p.error for p in self.parameters]
        calibration = Calibration(
            parameters=parameters,
            covariance=np.array(self.covariance) * np.outer(sizes, sizes),
            chi_square=self.chi_square,
            dof=self.dof,
            enlarged=self.enlarged,
            gravity=Gravity(value=self.gravity.value_m_s2, sigma=self.gravity.sigma_m_s2),
            reference_temperature=self.reference_temperature_C,
            notes=self.notes,
            null_space=self.null_space,
            left_out=tuple(LeftOut(one.stretch, one.reason) for one in self.left_out),
            nuisance=tuple(n.nuisance() for n in self.nuisance),
            derived=tuple(d.derived() for d in self.derived),
            residuals=tuple(Residual(r.stretch, r.of, r.sigmas) for r in self.residuals),
            budget=tuple(Contribution(b.source, np.array(b.sigma) * sizes) for b in self.budget),
        )
        known = [e * size for e, size in zip(errors, sizes, strict=True) if e is not None]
        return CalibrationRecord(
            calibration=calibration,
            unit=self.unit,
            source=self.source,
            axes=self.axes,
            hashes=self.hashes,
            versions=self.versions,
            errors=known if len(known) == len(errors) else None,
            noise_only=self._noise_only(),
        )


def _check_covariance(covariance: np.ndarray, sigmas: np.ndarray) -> None:
    """`ValueError` where it is none of these sigmas: edited, or of something else."""
    outer = np.outer(sigmas, sigmas)
    floor = SYMMETRIC * np.maximum(outer, 1e-30)
    if (np.abs(covariance - covariance.T) > floor).any():
        raise ValueError("covariance: must be symmetric")
    off = np.abs(covariance.diagonal() - sigmas**2) > 1e-6 * np.maximum(sigmas**2, 1e-30)
    if off.any():
        k = int(np.flatnonzero(off)[0])
        raise ValueError(
            f"covariance: entry {k + 1} of the diagonal is {covariance[k, k]:.6g}, must be the "
            f"square of the parameter's sigma, {sigmas[k] ** 2:.6g}"
        )
    there = sigmas > 0
    scaled = covariance[np.ix_(there, there)] / outer[np.ix_(there, there)]
    if len(scaled) and float(np.linalg.eigvalsh(scaled)[0]) < -SYMMETRIC:
        raise ValueError("covariance: has a negative variance in some direction")


def load_calibration(path: str | PathLike[str]) -> CalibrationRecord:
    """Read a `calibration.json`, or that of a folder.

    Raises
    ------
    StandError
        One line: the file, the field, the value, what is allowed.
    """
    file = Path(path)
    file = file / "calibration.json" if file.is_dir() else file
    try:
        refuse_no_file(file)
        if file.stat().st_size > MOST_BYTES:
            raise StandError(f"{file}: {file.stat().st_size} bytes, must be at most {MOST_BYTES}")
        data = json.loads(
            file.read_text(encoding="utf-8"), parse_constant=partial(_no_constant, file)
        )
    except OSError as error:
        raise StandError(f"{file}: cannot read this calibration: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise StandError(f"{file}: not UTF-8 text (byte {error.start})") from error
    except (ValueError, RecursionError) as error:  # syntax; thousands of digits or brackets
        raise StandError(f"{file}: not valid JSON: {error}") from error
    if not isinstance(data, dict):
        raise StandError(f"{file}: must be an object of a calibration, as stand calibrate writes")
    return checked(str(file), data, CalibrationEntry, _tuples(data)).record()


def _no_constant(file: Path, name: str) -> float:
    raise StandError(f"{file}: {name} is no number, every value must be finite")


def _tuples(value: Any) -> Any:
    """The same with tuples for arrays, and floats for the whole numbers that JSON lets pass."""
    if isinstance(value, dict):
        return {key: _tuples(one) for key, one in value.items()}
    return tuple(_tuples(one) for one in value) if isinstance(value, list) else value
