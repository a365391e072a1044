"""The stretches of a log that brings no procedure, named in a small TOML.

The words of the file are a procedure's own: a site, what to estimate, an attitude by its angles.
"""

from functools import cache
from os import PathLike, fspath
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from alignment import Options, Priors, Site
from alignment.angles import C_nb_from_angles
from alignment.units import DEG
from stand import toml_files as catalogue
from stand.bounds import Angle
from stand.errors import StandError, unknown
from stand.imu.priors import placement
from stand.physics.mjcf import describe, load_model
from stand.procedure.procedure import EstimateEntry, SiteEntry
from stand.procedure.steps import AttitudeEntry, Text
from stand.recording.encoders import unit_vector
from stand.recording.metadata import LoggedStretch, Seconds
from stand.table.joints import JOINTS, StandModel
from stand.table.kinematics import attitude
from stand.table.table import load_table

AXES_OF_B = {"X1": (1.0, 0.0, 0.0), "Y1": (0.0, 1.0, 0.0), "Z1": (0.0, 0.0, 1.0)}


class StretchEntry(catalogue.Entry):
    """What every stretch has: a name of its own and its times, on the log's clock.

    `joints_deg`: where the encoders of the table's axes stood, of a turn but the turning one. The
    attitude is then that of the shipped stand at these angles, if no `attitude_deg` says another.
    """

    label: Text
    from_s: Seconds
    to_s: Seconds
    attitude_deg: AttitudeEntry | None = None
    joints_deg: dict[str, Angle] | None = None

    @model_validator(mode="after")
    def _axes_of_the_table(self) -> "StretchEntry":
        for name in self.joints_deg or {}:
            if name not in JOINTS:
                raise ValueError(f"joints_deg: {unknown('joint', name, JOINTS)}")
        return self

    @property
    def joints(self) -> tuple[float, ...]:
        """Angles of the table's axes [rad], those not named at zero; () where none is known."""
        told = self.joints_deg
        return () if told is None else tuple(told.get(name, 0.0) * DEG for name in JOINTS)

    @model_validator(mode="after")
    def _forward(self) -> "StretchEntry":
        if self.from_s >= self.to_s:
            raise ValueError(f"to_s = {self.to_s:g}: must be after from_s = {self.from_s:g}")
        return self

    @property
    def nominal(self) -> tuple[float, ...] | None:
        """``C_nb`` as a quaternion (x, y, z, w)."""
        told = self.attitude_deg
        if told is None and self.joints:
            return tuple(attitude(_stand(), self.joints).as_quat().tolist())
        if told is None:
            return None
        angles = np.radians([told.roll, told.yaw, told.pitch])
        C_nb = C_nb_from_angles(told.sequence, *angles.tolist())
        return tuple(C_nb.as_quat().tolist())


class DwellNamed(StretchEntry):
    """A rest. `attitude_deg`: the attitude that the table was told to take."""

    kind: Literal["dwell"]

    def stretch(self) -> LoggedStretch:
        """The same as the schedule of a recording has it."""
        return LoggedStretch(
            label=self.label,
            t_from=self.from_s,
            t_to=self.to_s,
            nominal=self.nominal,
            joints=self.joints,
        )


class TurnNamed(StretchEntry):
    """A turn at constant rate. `attitude_deg`: where the table's angle reads zero.

    `axis` in b: one of X1, Y1, Z1 or three numbers; b turns about it as the angle grows. The angle
    is that of the log's `joint`, or grows by `rate_deg_s` from `angle_deg` at `from_s`.
    """

    kind: Literal["turn"]
    axis: Literal["X1", "Y1", "Z1"] | tuple[float, float, float]
    rate_deg_s: Angle | None = None
    angle_deg: Angle = 0.0
    joint: Text | None = None

    @model_validator(mode="after")
    def _one_angle(self) -> "TurnNamed":
        if (self.rate_deg_s is None) == (self.joint is None):
            has = "neither" if self.joint is None else "both"
            raise ValueError(f"rate_deg_s, joint: has {has}, must have one of them")
        if self.joints_deg is not None and self.joint not in JOINTS:
            raise ValueError(f"joints_deg: needs the turning joint, one of {', '.join(JOINTS)}")
        if self.rate_deg_s == 0:
            raise ValueError("rate_deg_s = 0: must not be 0; a dwell stands still")
        if self.axis == (0.0, 0.0, 0.0):
            raise ValueError(f"axis = {list(self.axis)}: must not be all zero")
        return self

    def stretch(self) -> LoggedStretch:
        """The same as the schedule of a recording has it."""
        axis = AXES_OF_B[self.axis] if isinstance(self.axis, str) else unit_vector(self.axis)
        return LoggedStretch(
            label=self.label,
            t_from=self.from_s,
            t_to=self.to_s,
            nominal=self.nominal,
            joint=self.joint,
            axis_b=axis,
            rate=None if self.rate_deg_s is None else self.rate_deg_s * DEG,
            angle=self.angle_deg * DEG,
            joints=self.joints if self.joint in JOINTS else (),
        )


NamedStretch = Annotated[DwellNamed | TurnNamed, Field(discriminator="kind")]


class StretchesEntry(catalogue.Entry):
    """The file: a log's stretches, and what is known of its site, table and purpose.

    `table`: the class whose placement enters every sigma (a catalogue id or a TOML file).
    """

    table: Text | None = None
    site: SiteEntry | None = None
    estimate: EstimateEntry | None = None
    stretch: Annotated[tuple[NamedStretch, ...], Field(min_length=1)]

    @model_validator(mode="after")
    def _labels(self) -> "StretchesEntry":
        seen: dict[str, int] = {}
        for number, one in enumerate(self.stretch, start=1):
            if one.label in seen:
                raise ValueError(
                    f'stretch {number} "{one.label}", label: stretch {seen[one.label]} has it too'
                )
            seen[one.label] = number
        return self

    def stretches(self) -> list[LoggedStretch]:
        """All of them, as a recording has them."""
        return [one.stretch() for one in self.stretch]

    def settings(
        self, site: Site, options: Options, methods: tuple[str, ...]
    ) -> tuple[Site, Options, tuple[str, ...]]:
        """What the log says, and instead what is said here."""
        if self.estimate is not None:
            options, methods = self.estimate.options(), self.estimate.methods
        if self.table is not None:
            turn, seat, nominal, azimuth = placement(load_table(self.table))
            priors = Priors(turn=turn, seat=seat, nominal=nominal, azimuth=azimuth)
            options = Options(options.offset_window, options.rule, priors)
        return (site if self.site is None else self.site.site()), options, methods


@cache
def _stand() -> StandModel:
    return describe(load_model())


def load_stretches(path: str | PathLike[str]) -> StretchesEntry:
    """Read such a file; `StandError` where it is not right."""
    name = fspath(path)
    if not name.endswith(".toml"):
        raise StandError(f"{name}: must be a TOML file of stretches")
    return catalogue.parse(catalogue.find("", "file of stretches", name), StretchesEntry)
