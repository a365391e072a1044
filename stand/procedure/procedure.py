"""Procedures: a turntable test as data. One TOML file each, units in the key names.

A procedure is a site, limits for its moves, what to estimate, steps
(`stand.procedure.steps`), and motions
in the background of several steps.
"""

from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, field_validator, model_validator

from alignment import ESTIMATORS, Options, Site
from alignment.angles import SequenceRule
from alignment.units import ARC_SECOND, DEG
from stand import toml_files as catalogue
from stand.bounds import Duration, Offset, Time
from stand.errors import StandError, unknown
from stand.procedure.requirements import CONSTANTS, PositiveLimit
from stand.procedure.steps import (
    Background,
    DwellStep,
    LimitsEntry,
    RateStep,
    Step,
    SweepStep,
    Text,
    TurningEntry,
)
from stand.table.table import Table, load_table
from stand.table.table_errors import TableErrorsEntry


class SiteEntry(catalogue.Entry):
    """Where the stand is; WGS 84 normal gravity unless `gravity_m_s2` is given.

    The deflection of the vertical: how far the zenith leans north and east of the ellipsoid's.
    """

    latitude_deg: Annotated[float, Field(ge=-90, le=90)]
    longitude_deg: Annotated[float, Field(ge=-180, le=360)] = 0.0
    height_m: Annotated[float, Field(ge=-1000, le=10000)] = 0.0
    gravity_m_s2: Annotated[float, Field(gt=9, lt=10.5)] | None = None
    deflection_north_arc_s: Annotated[float, Field(ge=-200, le=200)] = 0.0
    deflection_east_arc_s: Annotated[float, Field(ge=-200, le=200)] = 0.0

    def site(self) -> Site:
        """The same in SI."""
        deflection = (
            self.deflection_north_arc_s * ARC_SECOND,
            self.deflection_east_arc_s * ARC_SECOND,
        )
        return Site(
            latitude=self.latitude_deg * DEG,
            height=self.height_m,
            local_gravity=self.gravity_m_s2,
            longitude=self.longitude_deg * DEG,
            deflection=deflection,
        )


class EstimateEntry(catalogue.Entry):
    """What to estimate from every dwell, in order of the report."""

    methods: tuple[str, ...]
    offset_window_s: Duration = 10.0
    sequences: Literal["regular", "published"] = "regular"

    @field_validator("methods")
    @classmethod
    def _known(cls, methods: tuple[str, ...]) -> tuple[str, ...]:
        for method in methods:
            if method not in ESTIMATORS:
                raise ValueError(str(unknown("method", method, ESTIMATORS)))
        if len(set(methods)) != len(methods):
            raise ValueError(f"must name some of {', '.join(ESTIMATORS)}, each once")
        return methods

    def options(self) -> Options:
        """The same as the estimators take it."""
        return Options(self.offset_window_s, SequenceRule(self.sequences))


class TemperatureEntry(catalogue.Entry):
    """Temperature of the unit over the run: straight lines between points, constant outside."""

    time_s: tuple[Time, ...]
    temperature_C: tuple[Annotated[float, Field(ge=-100, le=200)], ...]

    @model_validator(mode="after")
    def _a_profile(self) -> "TemperatureEntry":
        if not 1 <= len(self.time_s) == len(self.temperature_C):
            raise ValueError(
                f"time_s has {len(self.time_s)} values, temperature_C {len(self.temperature_C)}: "
                "must be as many, at least one"
            )
        if any(b <= a for a, b in pairwise(self.time_s)):
            raise ValueError(f"time_s = {list(self.time_s)}: must increase")
        return self


class PayloadEntry(catalogue.Entry):
    """What is fixed to the inner plate beside the IMU: off its axes it is an imbalance.

    `offset_m`: from the crossing of the gimbal axes, east, north and up at zero angles.
    """

    mass_kg: Annotated[float, Field(ge=0, le=200)] = 0.0
    offset_m: tuple[Offset, Offset, Offset] = (0.0, 0.0, 0.0)


_REQUIRABLE = ", ".join(
    ["heading_deg", "pitch_deg", "roll_deg", *(constant.key for constant in CONSTANTS.values())]
)
_AngleLimit = Annotated[float, Field(gt=0, le=180)]


class RequiredEntry(catalogue.Entry):
    """What the expanded uncertainty of an attitude angle, or of a unit's constant, may be at most.

    Of constants the worst axis counts.
    """

    heading_deg: _AngleLimit | None = None
    pitch_deg: _AngleLimit | None = None
    roll_deg: _AngleLimit | None = None
    gyro_bias_deg_h: PositiveLimit | None = None
    gyro_scale_ppm: PositiveLimit | None = None
    accel_bias_ug: PositiveLimit | None = None
    accel_scale_ppm: PositiveLimit | None = None
    misalignment_arc_s: PositiveLimit | None = None
    gyro_to_accel_arc_s: PositiveLimit | None = None
    non_orthogonality_arc_s: PositiveLimit | None = None
    g_sensitivity_deg_h_g: PositiveLimit | None = None

    def limits(self) -> dict[str, float]:
        """What is limited, by quantity [SI]."""
        angles = {name: getattr(self, f"{name}_deg") for name in ("heading", "pitch", "roll")}
        found = {name: limit * DEG for name, limit in angles.items() if limit is not None}
        for name, constant in CONSTANTS.items():
            limit = getattr(self, constant.key)
            if limit is not None:
                found[name] = limit * constant.unit[1]
        return found


class RequiredForEntry(RequiredEntry):
    """The same for some units only: by preset id, grade, or revision, all that are given."""

    part: Text | None = None
    grade: Text | None = None
    revision: Text | None = None

    @property
    def keys(self) -> dict[str, str]:
        """What a unit must be to be meant."""
        given = {"part": self.part, "grade": self.grade, "revision": self.revision}
        return {name: value for name, value in given.items() if value is not None}

    @model_validator(mode="after")
    def _for_some(self) -> "RequiredForEntry":
        if not self.keys:
            raise ValueError("part, grade, revision: has none, must have one or more")
        if not self.limits():
            raise ValueError(f"{_REQUIRABLE}: has none, must have one or more")
        return self


class RequireEntry(RequiredEntry):
    """The accuracy that is required, for a rehearsal to judge.

    `coverage` times sigma must be within the limit. `guard` is the part of it within which no
    verdict is given: by so much a prediction may be off. `method`: which one it is judged by
    (the best if absent). `limit`: other limits for some units; the one that says most holds.
    """

    coverage: Annotated[float, Field(ge=0.1, le=10)] = 2.0
    guard: Annotated[float, Field(ge=0, le=0.5)] = 0.1
    method: str | None = None
    limit: tuple[RequiredForEntry, ...] = ()

    @model_validator(mode="after")
    def _something(self) -> "RequireEntry":
        if not self.limits() and not self.limit:
            raise ValueError(f"{_REQUIRABLE}: has none, must have one or more")
        return self

    def limits_for(self, part: str, grade: str, revision: str) -> dict[str, float]:
        """Limits [rad] by quantity for a unit: the general ones, and instead those for it."""
        unit = {"part": part, "grade": grade, "revision": revision}
        found = self.limits()
        for entry in sorted(self.limit, key=lambda entry: len(entry.keys)):
            if all(unit[name] == value for name, value in entry.keys.items()):
                found |= entry.limits()
        return found


class ProcedureEntry(catalogue.Entry):
    """A procedure as its TOML file says it."""

    title: Text
    description: str = ""
    table: str = "laboratory"
    site: SiteEntry
    estimate: EstimateEntry
    move_limits: LimitsEntry = LimitsEntry()
    temperature: TemperatureEntry | None = None
    payload: PayloadEntry = PayloadEntry()
    table_errors: TableErrorsEntry | None = None
    require: RequireEntry | None = None
    step: tuple[Step, ...]
    background: tuple[Background, ...] = ()

    @model_validator(mode="after")
    def _labels(self) -> "ProcedureEntry":
        seen: dict[str, int] = {}
        for number, step in enumerate(self.step, start=1):
            if not isinstance(step, DwellStep | RateStep | SweepStep):
                continue
            if step.label in seen:
                raise ValueError(
                    f'step {number} "{step.label}", label: step {seen[step.label]} has it too, '
                    "each stretch to estimate from must have its own"
                )
            seen[step.label] = number
        if self.estimate.methods and not seen:
            raise ValueError(
                "step: no dwell, rate or sweep to estimate from, must have at least one "
                "(or estimate, methods = [])"
            )
        return self

    @model_validator(mode="after")
    def _backgrounds(self) -> "ProcedureEntry":
        labels = [step.label for step in self.step]
        for number, behind in enumerate(self.background, start=1):
            for key, label in (("first", behind.first), ("last", behind.last)):
                if label is not None and labels.count(label) != 1:
                    fault = f'background {number}, {key} = "{label}"'
                    count = labels.count(label) or "no"
                    raise ValueError(f"{fault}: {count} steps have this label, must be one")
        return self

    @model_validator(mode="after")
    def _judged_by_a_method(self) -> "ProcedureEntry":
        method = None if self.require is None else self.require.method
        if method is not None and method not in self.estimate.methods:
            raise ValueError(f"require: {unknown('method', method, self.estimate.methods)}")
        return self

    @property
    def rocks(self) -> bool:
        """Whether the base moves behind steps."""
        return bool(self.background)

    @property
    def turns(self) -> bool:
        """Whether it estimates from steady turns of an axis."""
        return any(isinstance(step, TurningEntry) for step in self.step)

    @model_validator(mode="after")
    def _long_enough(self) -> "ProcedureEntry":
        window = self.estimate.offset_window_s
        needed = any(ESTIMATORS[m].needs_offset for m in self.estimate.methods)
        for index, step in enumerate(self.step if needed else ()):
            if isinstance(step, DwellStep) and step.duration_s < window:
                raise ValueError(
                    f'step {index + 1} "{step.label}", duration_s = {step.duration_s:g}: '
                    f"must be at least offset_window_s = {window:g}"
                )
        return self


@dataclass(frozen=True, slots=True)
class Procedure:
    """A checked procedure with its id and source text; `folder` is where its files lie."""

    id: str
    name: str
    text: str
    entry: ProcedureEntry
    folder: Path

    def fault(self, step: int, key: str, value: object, allowed: str) -> StandError:
        """An error about one step: file, step, key, value, what is allowed."""
        label = self.entry.step[step].label
        return StandError(f'{self.name}: step {step + 1} "{label}", {key} = {value}: {allowed}')


def load_procedure(name: str) -> Procedure:
    """A procedure by catalogue id or path; `StandError` where it is not right."""
    return procedure_from(catalogue.find("procedures", "procedure", name))


def table_of(procedure: Procedure) -> Table:
    """The table the procedure asks for; `StandError` naming the procedure where there is none."""
    try:
        return load_table(procedure.entry.table)
    except StandError as error:
        raise StandError(f"{procedure.name}: table: {error}") from error


def procedure_from(source: catalogue.Source) -> Procedure:
    """Check a procedure's text."""
    entry = catalogue.parse(source, ProcedureEntry)
    return Procedure(
        id=source.id,
        name=source.name,
        text=source.text,
        entry=entry,
        folder=Path(source.name).parent,
    )
