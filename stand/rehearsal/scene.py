"""A rehearsal made ready: what follows from its settings, worked out once."""

from collections.abc import Callable
from dataclasses import dataclass

from alignment import Options, Site
from alignment.arrays import Array
from alignment.information import InstrumentErrors
from stand.imu import ImuSpec, Temperature
from stand.imu.by_value import known_to_first_order
from stand.imu.instrument import slow_noise, unit_of
from stand.motion.limits import Torque
from stand.motion.plan import Plan
from stand.motion.polynomial import MotionKind
from stand.physics.truth import Truth
from stand.rehearsal.rounding import Rounding, roundings_of
from stand.simulation.settings import Settings
from stand.table.joints import StandModel
from stand.table.known_errors import StatedErrors, stated
from stand.table.table import Table
from stand.table.table_errors import TableErrorsEntry


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Scene:
    """What is rehearsed, planned on the stand.

    `torque` that a motion needs, None where the table's motors are not known, and `inertias` (6,)
    [kg m^2] about its axes. `truth` makes the perfect sensors of a motion. `temperature` of the
    unit over the procedure, None where it stays at the data sheet's.
    """

    settings: Settings
    plan: Plan
    model: StandModel
    torque: Torque | None
    inertias: Array
    truth: Callable[[], Truth]
    temperature: Temperature | None = None

    @property
    def imu(self) -> ImuSpec:
        """The unit, less the terms that are switched off."""
        return self.settings.unit

    @property
    def unit(self) -> InstrumentErrors:
        """The unit's errors, its noise as the samples have it."""
        s = self.settings
        stated = unit_of(self.imu, slow_noise(self.imu, s.rate_hz, s.sampling))
        return known_to_first_order(stated, self.imu)

    @property
    def roundings(self) -> tuple[Rounding, Rounding]:
        """Of gyros and accelerometers."""
        return roundings_of(self.imu, self.rate_hz, self.settings.sampling)

    @property
    def table(self) -> Table:
        """The table with the errors that are stated of it."""
        return self.settings.stated_table

    @property
    def site(self) -> Site:
        """Where the stand is."""
        return self.settings.site

    @property
    def options(self) -> Options:
        """What the estimators are told."""
        return self.settings.options

    @property
    def rate_hz(self) -> int:
        """Samples per second."""
        return self.settings.rate_hz

    @property
    def stated(self) -> StatedErrors:
        """What is stated of the table's errors, and what the procedure sets of them."""
        made = self.settings
        entry = made.procedure.entry.table_errors
        if made.true_table:
            entry = TableErrorsEntry(drawn=False)
        return stated(self.table, entry, made.motion is MotionKind.IDEAL)
