"""A proposal as data, and its JSON form."""

from collections.abc import Mapping
from dataclasses import dataclass

from stand.imu import unstated
from stand.rehearsal.result import Rehearsal
from stand.simulation.settings import Settings


@dataclass(frozen=True, slots=True)
class Reached:
    """One quantity: `required` and `predicted` (one sigma) in `unit`; None: not determined.

    `ratio`: expanded uncertainty over what is required, guard band included; `limited_by`: the
    largest part of sigma, and its share of the variance. `noise_only`: no sheet states more than
    noise of the sensors that tell it.
    """

    quantity: str
    unit: str
    required: float
    predicted: float | None
    ratio: float
    limited_by: str = ""
    share: float = 0.0
    true_table: float | None = None
    noise_only: bool = False


@dataclass(frozen=True, slots=True)
class Station:
    """A rest or a turning: seconds of data in it, and what it is for."""

    label: str
    seconds: float
    purpose: str


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Proposal:
    """The shortest test found, or why there is none.

    Attributes
    ----------
    title : str
    settings : Settings
        Unit, table, site and rate that it is for.
    feasible : bool
    reason : str
        Why there is none; '' where there is.
    text : str
        The procedure, TOML; '' where there is none.
    total, bound : float
        Of the plan, and below which no test of these candidates can be [s]: white noise alone,
        moves for nothing. NaN where there is none.
    methods : tuple of str
    stations : tuple of Station
    quantities : tuple of Reached
    rehearsal : Rehearsal or None
        Its own.
    considered : int
        Candidates.
    judged : int
        Tests that were rehearsed on the way.
    """

    title: str
    settings: Settings
    feasible: bool
    reason: str = ""
    text: str = ""
    total: float = float("nan")
    bound: float = float("nan")
    methods: tuple[str, ...] = ()
    stations: tuple[Station, ...] = ()
    quantities: tuple[Reached, ...] = ()
    rehearsal: Rehearsal | None = None
    considered: int = 0
    judged: int = 0


def proposal_json(result: Proposal) -> dict[str, object]:
    """As `--json` prints it: null where there is no number."""
    made = result.settings
    return {
        "title": result.title,
        "imu": made.imu.id,
        "table": made.table.id,
        "rate_hz": made.rate_hz,
        "feasible": result.feasible,
        "reason": result.reason,
        "total_s": _number(result.total),
        "bound_s": _number(result.bound),
        "methods": list(result.methods),
        "candidates": result.considered,
        "quantities": [_reached(one) for one in result.quantities],
        "stations": [
            {"label": s.label, "seconds": s.seconds, "purpose": s.purpose} for s in result.stations
        ],
        "toml": result.text,
        "unstated": list(unstated(made.imu)),
    }


def _reached(one: Reached) -> Mapping[str, object]:
    return {
        "quantity": one.quantity,
        "unit": one.unit,
        "required": one.required,
        "predicted": one.predicted,
        "noise_only": one.noise_only,
        "ratio": _number(one.ratio),
        "limited_by": one.limited_by,
        "share": one.share,
        "predicted_on_a_true_table": one.true_table,
    }


def _number(x: float) -> float | None:
    return float(x) if abs(x) < float("inf") else None
