"""Table classes: what each axis can do and how true it is. One TOML file per class in `tables/`."""

from dataclasses import dataclass, replace
from math import inf, pi
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field, model_validator

from alignment.arrays import Array, set_owned
from alignment.units import ARC_SECOND, DEG
from stand import toml_files as catalogue
from stand.bounds import (
    Angle,
    Duration,
    Friction,
    PositiveAcceleration,
    PositiveJerk,
    PositiveRate,
    Stiffness,
    Torque,
)
from stand.errors import unknown
from stand.table.joints import JOINTS

_TURN = 2 * pi
_BREAKAWAY = 10 * ARC_SECOND  # what bristles bend before an axis slips, where nothing is stated
ArcSeconds = Annotated[float, Field(ge=0, le=36000)]
PerTurn = Annotated[int, Field(ge=1, le=10000)]


class MotorEntry(catalogue.Entry):
    """The drive of one axis: a torque motor, its bearing and its servo.

    `bandwidth_hz` is the natural frequency of the closed position loop, `damping` its damping
    ratio, `integral_s` the time constant of its integrator (absent: none). Friction is LuGre's:
    Coulomb and static level, Stribeck rate, and the stiffness of the bristles.
    """

    torque_Nm: Torque
    bandwidth_hz: Annotated[float, Field(gt=0, le=200)]
    damping: Annotated[float, Field(gt=0, le=5)] = 1.0
    integral_s: Duration | None = None
    viscous_Nm_s: Friction = 0.0
    cogging_Nm: Friction = 0.0
    cogging_per_turn: PerTurn = 36
    coulomb_Nm: Friction = 0.0
    static_Nm: Friction | None = None
    stribeck_deg_s: PositiveRate = 0.5
    bristle_Nm_rad: Stiffness | None = None

    @model_validator(mode="after")
    def _friction(self) -> "MotorEntry":
        if self.static_Nm is not None and self.static_Nm < self.coulomb_Nm:
            raise ValueError(
                f"static_Nm = {self.static_Nm:g}: must be coulomb_Nm = {self.coulomb_Nm:g} or more"
            )
        return self


class AxisErrorsEntry(catalogue.Entry):
    """How true one axis is: standard deviations from which a table is drawn.

    `placement` is a constant offset of the true angle from the encoder's, `encoder` an error
    that goes once and twice round per turn, `encoder_step` the step of its reading (a size, not
    drawn); `non_orthogonality` tilts the axis toward the axis that carries it, `wobble` makes it
    nod once per turn; `rate_ripple` is a part of the rate, `ripple_per_turn` times round (of
    ideal motion: a simulated servo has its own).
    """

    placement_arc_s: ArcSeconds = 0.0
    encoder_arc_s: ArcSeconds = 0.0
    encoder_step_arc_s: ArcSeconds = 0.0
    non_orthogonality_arc_s: ArcSeconds = 0.0
    wobble_arc_s: ArcSeconds = 0.0
    rate_ripple_percent: Annotated[float, Field(ge=0, le=50)] = 0.0
    ripple_per_turn: PerTurn = 1


class AxisEntry(catalogue.Entry):
    """Limits of one axis. Without `travel_deg` it turns without end (slip rings)."""

    travel_deg: tuple[Angle, Angle] | None = None
    rate_deg_s: PositiveRate
    acceleration_deg_s2: PositiveAcceleration
    jerk_deg_s3: PositiveJerk
    motor: MotorEntry | None = None
    errors: AxisErrorsEntry = AxisErrorsEntry()

    @model_validator(mode="after")
    def _travel_contains_zero(self) -> "AxisEntry":
        if self.travel_deg is not None and not self.travel_deg[0] <= 0 <= self.travel_deg[1]:
            raise ValueError(f"travel_deg = {list(self.travel_deg)}: must contain 0, low end first")
        return self


NOT_THERE = AxisEntry(
    travel_deg=(0.0, 0.0), rate_deg_s=1.0, acceleration_deg_s2=1.0, jerk_deg_s3=1.0
)


class GeometryEntry(catalogue.Entry):
    """How the whole stands: standard deviations of its tilt and azimuth, and of the IMU's seat."""

    base_tilt_arc_s: ArcSeconds = 0.0
    base_azimuth_arc_s: ArcSeconds = 0.0
    mounting_arc_s: ArcSeconds = 0.0


class SettlingEntry(catalogue.Entry):
    """When a rest begins: following error within `within_arc_s` for `hold_s`, on every axis."""

    within_arc_s: Annotated[float, Field(gt=0, le=36000)] = 5.0
    hold_s: Annotated[float, Field(gt=0, le=60)] = 0.5


class CertificateEntry(catalogue.Entry):
    """What a report needs of a real table: all optional, a report leaves a line to fill in."""

    serial_number: str = ""
    number: str = ""
    laboratory: str = ""
    calibrated_on: str = ""
    valid_until: str = ""


# What holds an axis that is not there, in a simulated servo: the laboratory class's bandwidths.
_HELD_HZ = dict(zip(JOINTS, (12.0, 12.0, 18.0, 20.0, 30.0, 50.0), strict=True))
_HELD_NM = 1e6


class TableEntry(catalogue.Entry):
    """A table class as its TOML file says it.

    `axis`: what each of its axes can do; one that is left out is not there. `model`: an MJCF of a
    stand of one's own, by its path from the folder of this file; the shipped one if absent.
    """

    title: str
    source: str
    model: Annotated[str, Field(min_length=1)] | None = None
    certificate: CertificateEntry = CertificateEntry()
    geometry: GeometryEntry = GeometryEntry()
    settling: SettlingEntry = SettlingEntry()
    axis: dict[str, AxisEntry]

    @model_validator(mode="after")
    def _all_axes(self) -> "TableEntry":
        for name in self.axis:
            if name not in JOINTS:
                raise ValueError(f"axis: {unknown('axis', name, JOINTS)}")
        if not self.axis:
            raise ValueError(f"axis: has none, must have one or more of {', '.join(JOINTS)}")
        first = self.axis.get(JOINTS[0])
        if first is not None and first.errors.non_orthogonality_arc_s:
            raise ValueError(
                f"axis, {JOINTS[0]}, errors, non_orthogonality_arc_s: must be 0: no axis carries it"
            )
        return self

    def whole(self) -> "TableEntry":
        """The same with every axis of the stand: those that are not there stand still, true."""
        there = {name: self.axis.get(name, NOT_THERE) for name in JOINTS}
        return self.model_copy(update={"axis": there})


@dataclass(frozen=True, slots=True)
class Motor:
    """A drive in SI, as `MotorEntry`: [N m], [rad/s], [s], [N m s], [N m / rad].

    `bandwidth` [rad/s]; `integral` None for no integrator; `static` not below `coulomb`.
    """

    torque: float
    bandwidth: float
    damping: float
    integral: float | None
    viscous: float
    cogging: float
    cogging_per_turn: int
    coulomb: float
    static: float
    stribeck: float
    bristle: float


@dataclass(frozen=True, slots=True, eq=False)
class Table:
    """Limits of the six axes in SI, in the order of `JOINTS`.

    `low`, `high` (6,) [rad], infinite where an axis turns without end; `rate` [rad/s],
    `acceleration` [rad/s^2], `jerk` [rad/s^3], (6,) each; `torque` (6,) [N m], infinite where
    unknown. `motors` (6,): None where the class has none. `entry` holds the accuracy figures.
    `settle_within` [rad], `settle_hold` [s]. `model`: its MJCF, None for the shipped one.
    `missing`: axes that it has not; they stand at zero.
    """

    id: str
    name: str
    title: str
    text: str
    entry: TableEntry
    low: tuple[float, ...]
    high: tuple[float, ...]
    rate: Array
    acceleration: Array
    jerk: Array
    motors: tuple[Motor | None, ...]
    model: Path | None = None
    missing: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        six = (len(JOINTS),)
        set_owned(
            self,
            rate=(self.rate, six, float),
            acceleration=(self.acceleration, six, float),
            jerk=(self.jerk, six, float),
        )

    @property
    def torque(self) -> Array:
        """Torque limits (6,) [N m], infinite where the class has no motor."""
        return np.array([inf if m is None else m.torque for m in self.motors])

    @property
    def settle_within(self) -> float:
        """Following error of a settled axis [rad]."""
        return self.entry.settling.within_arc_s * ARC_SECOND

    @property
    def settle_hold(self) -> float:
        """For how long [s]."""
        return self.entry.settling.hold_s

    @property
    def there(self) -> tuple[str, ...]:
        """The axes that it has."""
        return tuple(name for name in JOINTS if name not in self.missing)

    def without(self, name: str) -> str:
        """In words that this axis is not there, and which are."""
        return f"table {self.id} has no axis {name}, it has {', '.join(self.there)}"

    def outside(self, joints: Array) -> list[int]:
        """Indices of the axes whose angle (6,) [rad] is beyond travel."""
        slack = 1e-9 * DEG
        return [
            i
            for i, angle in enumerate(joints)
            if not self.low[i] - slack <= angle <= self.high[i] + slack
        ]


def without_errors(table: Table) -> Table:
    """The same table as true as its limits allow: what a class states of its errors is nothing."""
    axes = {
        name: axis.model_copy(update={"errors": AxisErrorsEntry()})
        for name, axis in table.entry.axis.items()
    }
    true = table.entry.model_copy(update={"geometry": GeometryEntry(), "axis": axes})
    return replace(table, entry=true)


def load_table(name: str) -> Table:
    """A table class by catalogue id or path; `StandError` where it is not right."""
    return table_from(catalogue.find("tables", "table", name))


def table_from(source: catalogue.Source) -> Table:
    """Check a table's text."""
    told = catalogue.parse(source, TableEntry)
    missing = tuple(name for name in JOINTS if name not in told.axis)
    driven = any(axis.motor is not None for axis in told.axis.values())
    entry = told.whole()
    axes = [entry.axis[j] for j in JOINTS]
    travels = [a.travel_deg or (-inf, inf) for a in axes]
    return Table(
        id=source.id,
        name=source.name,
        title=entry.title,
        text=source.text,
        entry=entry,
        low=tuple(low * DEG for low, _ in travels),
        high=tuple(high * DEG for _, high in travels),
        rate=np.array([a.rate_deg_s for a in axes]) * DEG,
        acceleration=np.array([a.acceleration_deg_s2 for a in axes]) * DEG,
        jerk=np.array([a.jerk_deg_s3 for a in axes]) * DEG,
        motors=tuple(
            _motor(_held(name) if driven and name in missing else axis.motor)
            for name, axis in zip(JOINTS, axes, strict=True)
        ),
        model=None if entry.model is None else Path(source.name).parent / entry.model,
        missing=missing,
    )


def _held(name: str) -> MotorEntry:
    """A drive that holds an axis which is not there."""
    return MotorEntry(torque_Nm=_HELD_NM, bandwidth_hz=_HELD_HZ[name], damping=0.8, integral_s=0.1)


def _motor(entry: MotorEntry | None) -> Motor | None:
    if entry is None:
        return None
    static = entry.coulomb_Nm if entry.static_Nm is None else entry.static_Nm
    bristle = entry.bristle_Nm_rad
    if bristle is None:
        bristle = entry.coulomb_Nm / _BREAKAWAY
    return Motor(
        torque=entry.torque_Nm,
        bandwidth=entry.bandwidth_hz * _TURN,
        damping=entry.damping,
        integral=entry.integral_s,
        viscous=entry.viscous_Nm_s,
        cogging=entry.cogging_Nm,
        cogging_per_turn=entry.cogging_per_turn,
        coulomb=entry.coulomb_Nm,
        static=static,
        stribeck=entry.stribeck_deg_s * DEG,
        bristle=bristle,
    )
