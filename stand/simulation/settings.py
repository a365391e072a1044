"""All that decides a run."""

from dataclasses import dataclass

import numpy as np

from alignment import Options, Site
from stand.errors import StandError
from stand.imu import ImuSpec, Temperature
from stand.imu.priors import BASE_ARM
from stand.motion.polynomial import MotionKind
from stand.physics.dynamics import Payload
from stand.physics.mjcf import describe, load_model
from stand.physics.truth import Sampling
from stand.procedure.procedure import Procedure
from stand.table.kinematics import base_arm
from stand.table.table import Table
from stand.table.table_errors import TableErrors, TableErrorsEntry, draw

HIGHEST_RATE_HZ = 10_000


@dataclass(frozen=True, slots=True, eq=False)
class Settings:
    """All that decides a run: same settings, same bytes of `run.mcap`.

    `imu` as it is to be simulated; `without` names the error terms that were switched off in it.
    `motion`: whether the joints follow the plan or are moved by a simulated servo; `true_table`:
    whether the table is without errors.
    """

    procedure: Procedure
    imu: ImuSpec
    table: Table
    site: Site
    options: Options
    rate_hz: int = 200
    sampling: Sampling = Sampling.MEAN
    seed: int = 0
    without: tuple[str, ...] = ()
    motion: MotionKind = MotionKind.IDEAL
    true_table: bool = False

    def __post_init__(self) -> None:
        if not 1 <= self.rate_hz <= HIGHEST_RATE_HZ:
            raise StandError(f"rate = {self.rate_hz} Hz: must be 1 to {HIGHEST_RATE_HZ}")
        if self.seed < 0:
            raise StandError(f"seed = {self.seed}: must be 0 or more")


def base_arm_of(table: Table) -> float:
    """Height of the unit above the base's axes [m], where `priors_of` has its lever arm from."""
    return BASE_ARM if table.model is None else base_arm(describe(load_model(table.model)))


def methods_of(settings: Settings) -> tuple[str, ...]:
    """What the procedure wants estimated."""
    return settings.procedure.entry.estimate.methods


def payload_of(procedure: Procedure) -> Payload:
    """What the procedure fixes to the plate beside the unit."""
    entry = procedure.entry.payload
    return Payload(entry.mass_kg, np.array(entry.offset_m))


def table_errors_of(settings: Settings) -> TableErrors:
    """What is wrong with the table in this run."""
    entry, ideal = settings.procedure.entry.table_errors, settings.motion is MotionKind.IDEAL
    if settings.true_table:
        entry = TableErrorsEntry(drawn=False)
    return draw(settings.table, settings.seed, entry, ideal)


def temperature_of(procedure: Procedure) -> Temperature | None:
    """The temperature over a run, where the procedure states one."""
    profile = procedure.entry.temperature
    if profile is None:
        return None
    return Temperature(np.array(profile.time_s), np.array(profile.temperature_C))
