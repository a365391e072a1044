"""The plan of a run: what the table does, and from when on the unit's readings show its rests."""

from stand.imu.instrument import late_of
from stand.motion.plan import Plan
from stand.motion.planner import plan
from stand.simulation.settings import Settings
from stand.table.joints import StandModel

LEAST_SAMPLES = 3  # of a stretch: two whole ones, wherever it begins


def plan_of(settings: Settings, model: StandModel, seed: int | None = None) -> Plan:
    """The settings' procedure as it runs, by their own seed or another.

    Raises
    ------
    StandError
        As `stand.motion.planner.plan`; a rest that is over before the unit has forgotten the move
        before it.
    """
    procedure = settings.procedure
    planned = plan(procedure, model, settings.table, settings.seed if seed is None else seed)
    late = late_of(settings.unit, settings.rate_hz)
    least = LEAST_SAMPLES / settings.rate_hz
    found = planned.read_late(late, settings.rate_hz)
    for step in found.steps:
        waits = step.steady_from - step.t_from
        if step.kind == "dwell" and waits > 0 and step.steady_to - step.steady_from < least:
            allowed = (
                f"must be {waits + least:.4g} or more at {settings.rate_hz} Hz: latency and "
                f"low-pass show the move before it for {late:.4g} s"
            )
            lasts = round(step.t_to - step.t_from, 9)
            raise procedure.fault(step.number, "duration_s", lasts, allowed)
    return found
