"""What a proposal is asked for: accuracy, and what the test may do. A TOML file, or options."""

from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field, model_validator

from stand import toml_files as catalogue
from stand.bounds import Angle, Duration, PositiveRate
from stand.errors import StandError, unknown
from stand.procedure.procedure import RequireEntry, SiteEntry
from stand.procedure.steps import Text

GIMBALS = ("outer", "middle", "inner")
SITE = SiteEntry(latitude_deg=48.5, gravity_m_s2=9.80936)
Turns = Annotated[float, Field(ge=1, le=100000)]
Position = tuple[Angle, Angle, Angle]


class AllowedEntry(catalogue.Entry):
    """What the test may do.

    `max_time_s`: the whole plan. `positions`: where it may stand, outer, middle and inner angle of
    each; or 'faces' (an axis of the unit up or down), or 'all' (edges and corners up as well).
    `turning`: axes that may turn; `turn_rates_deg_s`: at which rates, else some of the table's.
    `most_turns`: of one axis in one direction (cables). `shortest_dwell_s`: of a rest that counts.
    """

    max_time_s: Duration | None = None
    positions: Literal["faces", "all"] | Annotated[tuple[Position, ...], Field(min_length=1)] = (
        "all"
    )
    turning: tuple[Literal["outer", "middle", "inner"], ...] = GIMBALS
    turn_rates_deg_s: Annotated[tuple[PositiveRate, ...], Field(min_length=1)] | None = None
    most_turns: Turns | None = None
    shortest_dwell_s: Annotated[float, Field(ge=1, le=3600)] = 2.0

    @model_validator(mode="after")
    def _each_once(self) -> "AllowedEntry":
        if len(set(self.turning)) != len(self.turning):
            raise ValueError(f"turning = {list(self.turning)}: must name each axis once")
        longest = self.max_time_s
        if longest is not None and longest < self.shortest_dwell_s:
            raise ValueError(
                f"max_time_s = {longest:g}: must be shortest_dwell_s = "
                f"{self.shortest_dwell_s:g} or more"
            )
        return self


class WantedEntry(catalogue.Entry):
    """A requirement as its TOML file says it: `[require]` as a procedure has it."""

    title: Text = "Proposed test"
    imu: Text | None = None
    table: Text | None = None
    site: SiteEntry = SITE
    require: RequireEntry
    allowed: AllowedEntry = AllowedEntry()


@dataclass(frozen=True, slots=True)
class Wanted:
    """A checked requirement and the file it is from ('' : none)."""

    name: str
    entry: WantedEntry

    def fault(self, key: str, value: object, allowed: str) -> StandError:
        """One line: file, key, value, what is allowed."""
        where = f"{self.name}: " if self.name else ""
        return StandError(f"{where}{key} = {value}: {allowed}")


def load_wanted(name: str) -> Wanted:
    """A requirement by its path."""
    source = catalogue.find("requirements", "requirement", name) if _is_path(name) else None
    if source is None:
        raise unknown("requirement", name, ["a TOML file with [require]"])
    return Wanted(source.name, catalogue.parse(source, WantedEntry))


def _is_path(name: str) -> bool:
    return name.endswith(".toml") or "/" in name or "\\" in name


def wanted_of(require: dict[str, object], allowed: dict[str, object]) -> Wanted:
    """The same from plain values, as a command line has them."""
    data = {"require": require, "allowed": allowed}
    return Wanted("", catalogue.checked("requirement", data, WantedEntry))
