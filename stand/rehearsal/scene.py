"""What is rehearsed."""

from collections.abc import Callable
from dataclasses import dataclass

from alignment import Options, Site
from stand.imu import ImuSpec, Temperature
from stand.motion.plan import Plan
from stand.physics.truth import Truth
from stand.rehearsal.known_errors import Stated, stated
from stand.table.joints import StandModel
from stand.table.table import Table
from stand.table.table_errors import TableErrorsEntry


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """What is rehearsed: plan, stand, table, unit, site and what the estimators are told.

    `truth` makes the perfect sensors of a motion, for methods on rocking bases. `temperature` of
    the unit over the procedure, None where it stays at the data sheet's. `table_errors` that the
    procedure sets; `ideal`: whether the joints follow the plan.
    """

    plan: Plan
    model: StandModel
    table: Table
    imu: ImuSpec
    site: Site
    options: Options
    rate_hz: int
    truth: Callable[[], Truth]
    temperature: Temperature | None = None
    table_errors: TableErrorsEntry | None = None
    ideal: bool = True

    @property
    def stated(self) -> Stated:
        """What is stated of the table's errors."""
        return stated(self.table, self.table_errors, self.ideal)
