"""Table classes: what each axis can do. One TOML file per class in `tables/`."""

from dataclasses import dataclass
from math import inf

import numpy as np
from pydantic import Field, model_validator

from alignment.arrays import Array, set_owned
from alignment.units import DEG
from stand import catalogue
from stand.physics.description import JOINTS


class AxisEntry(catalogue.Entry):
    """Limits of one axis. Without `travel_deg` it turns without end (slip rings)."""

    travel_deg: tuple[float, float] | None = None
    rate_deg_s: float = Field(gt=0)
    acceleration_deg_s2: float = Field(gt=0)
    jerk_deg_s3: float = Field(gt=0)

    @model_validator(mode="after")
    def _travel_contains_zero(self) -> "AxisEntry":
        if self.travel_deg is not None and not self.travel_deg[0] <= 0 <= self.travel_deg[1]:
            raise ValueError(f"travel_deg = {list(self.travel_deg)}: must contain 0, low end first")
        return self


class TableEntry(catalogue.Entry):
    """A table class as its TOML file says it."""

    title: str
    source: str
    axis: dict[str, AxisEntry]

    @model_validator(mode="after")
    def _all_axes(self) -> "TableEntry":
        if set(self.axis) != set(JOINTS):
            raise ValueError(f"axis: has {sorted(self.axis)}, must be {sorted(JOINTS)}")
        return self


@dataclass(frozen=True, slots=True, eq=False)
class Table:
    """Limits of the six axes in SI, in the order of `JOINTS`.

    `low`, `high` (6,) [rad], infinite where an axis turns without end; `rate` [rad/s],
    `acceleration` [rad/s^2], `jerk` [rad/s^3], (6,) each.
    """

    id: str
    title: str
    text: str
    low: tuple[float, ...]
    high: tuple[float, ...]
    rate: Array
    acceleration: Array
    jerk: Array

    def __post_init__(self) -> None:
        six = (len(JOINTS),)
        set_owned(
            self,
            rate=(self.rate, six, float),
            acceleration=(self.acceleration, six, float),
            jerk=(self.jerk, six, float),
        )

    def outside(self, joints: Array) -> list[int]:
        """Indices of the axes whose angle (6,) [rad] is beyond travel."""
        slack = 1e-9 * DEG
        return [
            i
            for i, angle in enumerate(joints)
            if not self.low[i] - slack <= angle <= self.high[i] + slack
        ]


def load_table(name: str) -> Table:
    """A table class by catalogue id or path; `StandError` where it is not right."""
    source = catalogue.find("tables", "table", name)
    entry = catalogue.parse(source, TableEntry)
    axes = [entry.axis[j] for j in JOINTS]
    travels = [a.travel_deg or (-inf, inf) for a in axes]
    return Table(
        source.id,
        entry.title,
        source.text,
        tuple(low * DEG for low, _ in travels),
        tuple(high * DEG for _, high in travels),
        np.array([a.rate_deg_s for a in axes]) * DEG,
        np.array([a.acceleration_deg_s2 for a in axes]) * DEG,
        np.array([a.jerk_deg_s3 for a in axes]) * DEG,
    )
