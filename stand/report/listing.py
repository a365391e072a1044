"""The catalogues as rows: what `stand list` shows."""

from collections.abc import Callable, Sequence

from alignment import ESTIMATORS
from alignment.sources import legend
from alignment.units import DEG
from stand import toml_files as catalogue
from stand.errors import unknown
from stand.imu import Stated, load_imu
from stand.procedure.procedure import load_procedure
from stand.procedure.steps import MoveStep, ProfileStep, RateStep, Step, SweepStep
from stand.report.tables import TableData
from stand.table.joints import JOINTS
from stand.table.table import Table, load_table

BASE = 3  # the first three joints are the rocking base's
Row = dict[str, str | float | None]


def listing(what: str) -> list[Row]:
    """Entries of one of the catalogues below by its name, one dictionary per row."""
    makers: dict[str, Callable[[], list[Row]]] = {
        "procedures": _procedures,
        "imus": _imus,
        "tables": _tables,
        "trajectories": _trajectories,
        "methods": _methods,
    }
    if what not in makers:
        raise unknown("catalogue", what, makers)
    return makers[what]()


def entries_table(what: str, entries: Sequence[Row]) -> TableData:
    """Entries of a catalogue as a table, with what a reader of it must know."""
    columns = tuple(entries[0])
    rows = tuple(tuple("" if e[c] is None else str(e[c]) for c in columns) for e in entries)
    return TableData(what, columns, rows, notes=notes(what))


def notes(what: str) -> tuple[str, ...]:
    """What the letters stand for: papers of the methods' sources, evidence of a unit's file."""
    if what == "imus":
        return ("evidence: A the maker's document, B part of one, C others' figures",)
    return tuple(legend()) if what == "methods" else ()


def _procedures() -> list[Row]:
    rows: list[Row] = []
    for name in catalogue.ids("procedures"):
        entry = load_procedure(name).entry
        kinds = [step.kind for step in entry.step]
        counted = [f"{kinds.count(kind)} {kind}" for kind in dict.fromkeys(kinds) if kind != "move"]
        rows.append(
            {
                "id": name,
                "title": entry.title,
                "table": entry.table,
                "steps": ", ".join(counted)
                + "".join(f"; {b.kind} behind" for b in entry.background),
                "steady_s": sum(_steady(step) for step in entry.step),
                "estimates": ", ".join(entry.estimate.methods),
            }
        )
    return rows


def _steady(step: Step) -> float:
    """How long a step does what it is for [s]; moves, ramps and profiles need a plan to tell."""
    if isinstance(step, MoveStep | ProfileStep):
        return 0.0
    rates = step.rates_deg_s if isinstance(step, SweepStep) else ()
    if isinstance(step, RateStep):
        rates = (step.rate_deg_s,)
    if not isinstance(step, RateStep | SweepStep):
        return step.duration_s
    ways = 2 if step.directions == "both" else 1
    if step.duration_s is not None:
        return ways * len(rates) * step.duration_s
    assert step.turns is not None
    return ways * sum(360.0 * step.turns / abs(rate) for rate in rates)


def _imus() -> list[Row]:
    def value(stated: Stated | None) -> float | None:
        return None if stated is None else stated.value

    rows: list[Row] = []
    for name in catalogue.ids("imus"):
        entry = load_imu(name).entry
        rows.append(
            {
                "id": name,
                "title": entry.title,
                "grade": entry.grade,
                "evidence": entry.evidence,
                "bias deg/h": value(entry.gyro.turn_on_bias_deg_h),
                "ARW deg/rt-h": value(entry.gyro.angle_random_walk_deg_rt_h),
                "bias mg": value(entry.accel.turn_on_bias_mg),
                "VRW m/s/rt-h": value(entry.accel.velocity_random_walk_m_s_rt_h),
            }
        )
    return rows


def _tables() -> list[Row]:
    return [_table(load_table(name)) for name in catalogue.ids("tables")]


def _table(table: Table) -> Row:
    """A table class: what each gimbal can do and how true the worst is; the base's travel.

    Accuracy figures are standard deviations; without a servo bandwidth the class has no motors.
    """
    there = [name for name in table.there if name in JOINTS[BASE:]] or table.there
    of = [JOINTS.index(name) for name in there]
    gimbals = [table.entry.axis[name] for name in there]
    errors = [axis.errors for axis in gimbals]

    def largest(name: str) -> float:
        return max(getattr(own, name) for own in errors)

    bandwidths = [axis.motor.bandwidth_hz for axis in gimbals if axis.motor is not None]
    low, high = table.low[:BASE], table.high[:BASE]
    fixed = not any(abs(angle) > 0 for angle in (*low, *high))
    return {
        "id": table.id,
        "title": table.title,
        "rate deg/s": float(table.rate[of].min() / DEG),
        "accel deg/s2": float(table.acceleration[of].min() / DEG),
        "base deg": "fixed" if fixed else f"±{max(map(abs, (*low, *high))) / DEG:g}",
        "servo Hz": min(bandwidths) if len(bandwidths) == len(gimbals) else None,
        "place. arc s": largest("placement_arc_s"),
        "orth. arc s": largest("non_orthogonality_arc_s"),
        "wobble arc s": largest("wobble_arc_s"),
    }


def _trajectories() -> list[Row]:
    # their splines take 0.2 s to import
    from stand.vehicle.scenario import FOLDER, DriveEntry

    rows: list[Row] = []
    for name in catalogue.ids(FOLDER):
        entry = catalogue.parse(catalogue.find(FOLDER, "trajectory", name), DriveEntry)
        duration = sum(leg.duration_s for leg in entry.leg)
        speeds = [s for s in (entry.start.speed_m_s, *(leg.speed_m_s for leg in entry.leg)) if s]
        outages = [f"{a:g} to {b:g}" for a, b in entry.satellite.outages_s]
        rows.append(
            {
                "id": name,
                "title": entry.title,
                "duration_s": duration,
                "top m/s": max(speeds, default=0.0),
                "fixes": len(entry.satellite.times(duration)),
                "outages s": ", ".join(outages) or None,
            }
        )
    return rows


def _methods() -> list[Row]:
    return [
        {
            "id": name,
            "title": method.title,
            "needs latitude": "yes" if method.needs_latitude else "no",
            "source": method.source,
        }
        for name, method in ESTIMATORS.items()
    ]
