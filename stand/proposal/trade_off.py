"""Time against accuracy: the shortest test for laxer and stricter requirements, and tests one has.

The curve is of the search alone (drifts counted, moves for what they cost, not for what they
tell), so that its points are a little longer than a whole proposal.
"""

from collections.abc import Callable, Sequence
from copy import deepcopy
from dataclasses import dataclass
from math import inf

import numpy as np

from alignment.methods.calibration import CALIBRATION
from alignment.methods.positions import TWO_POSITION
from stand.procedure.procedure import Procedure, load_procedure
from stand.procedure.requirements import CONSTANTS
from stand.proposal import search
from stand.proposal.candidates import Clock, candidates
from stand.proposal.heading import floor_time, shapes, shortest_of
from stand.proposal.information import EVER, Problem, settings_of
from stand.proposal.judged import Judged
from stand.proposal.wanted import Wanted
from stand.rehearsal.rehearse import rehearse
from stand.rehearsal.result import Rehearsal
from stand.rehearsal.wording import toml_of
from stand.simulation.settings import Settings

FACTORS = (0.5, 0.7, 1.0, 1.4, 2.0, 2.8, 4.0)  # of what is required
# procedures of the catalogue; that for a heading is called as its method
CLASSICAL = {True: "calibration-full", False: TWO_POSITION}
HALVINGS = 7
SHORTEST = 1 / 64  # of a test of one's own
Progress = Callable[[float], None]


@dataclass(frozen=True, slots=True)
class Point:
    """A test: `total` [s], and its expanded uncertainty over what is required, the worst."""

    name: str
    total: float
    ratio: float


@dataclass(frozen=True, slots=True)
class Own:
    """A procedure that one has; `shortened`: the same shape as short as it may be [s]; None: never.

    `method` that it was judged by.
    """

    point: Point
    method: str
    shortened: float | None


@dataclass(frozen=True, slots=True)
class TradeOff:
    """`curve`: the shortest test found by what part of the requirement it keeps, the laxest first.

    `procedures`: the classical one and one's own.
    """

    curve: tuple[Point, ...]
    procedures: tuple[Own, ...]


def trade_off(
    wanted: Wanted,
    like: Settings,
    procedures: Sequence[str] = (),
    progress: Progress = lambda done: None,
) -> TradeOff:
    """The curve, and where the classical procedure and `procedures` (ids or files) lie.

    Raises
    ------
    StandError
        As `propose`; a procedure is not right.
    """
    limits = wanted.entry.require.limits_for(like.imu.id, like.imu.entry.grade, like.revision)
    constants = {q: limit for q, limit in limits.items() if q in CONSTANTS}
    every = [CLASSICAL[bool(constants)], *procedures]
    steps = len(FACTORS) + len(every)
    points = []
    those = candidates(wanted, like.imu, like.table)
    problem = Problem(wanted, those, like, constants) if constants else None
    angles = {q: limit for q, limit in limits.items() if q not in CONSTANTS}
    for number, factor in enumerate(FACTORS[::-1]):
        total = 0.0 if problem is None else _constants(problem.scaled(factor), wanted)
        if angles:
            total += _attitude(wanted, like, angles, factor)
        if np.isfinite(total):
            points.append(Point("proposed", total, factor))
        progress((number + 1) / steps)
    own = []
    for number, name in enumerate(every):
        own.append(_own(load_procedure(name), wanted, like, bool(constants), bool(angles)))
        progress((len(FACTORS) + number + 1) / steps)
    # of tests that take equally long the one that keeps most
    best = [a for a, b in zip(points, [*points[1:], None], strict=True) if not _as_long(a, b)]
    return TradeOff(tuple(best), tuple(own))


def _as_long(one: Point, stricter: Point | None) -> bool:
    return stricter is not None and stricter.total <= one.total


def _constants(problem: Problem, wanted: Wanted) -> float:
    """The shortest that the search finds [s]."""
    dwell = wanted.entry.allowed.shortest_dwell_s
    if problem.squares(np.zeros(len(problem.candidates))).max() <= 1:
        return dwell
    if problem.squares(np.full(len(problem.candidates), EVER)).max() > 1:
        return inf
    found = search.greedy(problem, dwell)
    return inf if found is None else problem.total(found)


def _attitude(wanted: Wanted, like: Settings, angles: dict[str, float], factor: float) -> float:
    limits = {name: factor * limit for name, limit in angles.items()}
    require, least = wanted.entry.require, 1.0
    if "heading" in limits:
        least = floor_time(like, limits["heading"] / (require.coverage * (1 + require.guard)))
    found = shortest_of(
        shapes(wanted, like),
        lambda method: Judged(wanted, like, limits, (method,), None),
        Clock(like.table),
        least,
        wanted.entry.allowed.shortest_dwell_s,
        lambda done: None,
    )
    return found[0].total if found else inf


# --- procedures that one has ---------------------------------------------------------------------


def _own(
    procedure: Procedure, wanted: Wanted, like: Settings, constants: bool, angles: bool
) -> Own:
    data = procedure.entry.model_dump(exclude_unset=True, exclude_none=True, mode="json")
    data["require"] = wanted.entry.require.model_dump(exclude_unset=True, exclude_none=True)
    data["table"] = like.table.id
    data["require"].pop("method", None)  # the best of its own methods counts
    if constants:
        own = data["estimate"]["methods"] if angles else []
        data["estimate"]["methods"] = list(dict.fromkeys([CALIBRATION, *own]))
    answer = _rehearsed(data, like)
    point = Point(procedure.entry.title, answer.duration.total, _ratio(answer))
    methods = ", ".join(dict.fromkeys(j.method for j in answer.judgements if j.method))
    shorter = _shortened(data, like, point.total) if point.ratio <= 1 else None
    return Own(point, methods, shorter)


def _rehearsed(data: dict, like: Settings) -> Rehearsal:
    return rehearse(settings_of(toml_of(data), like))


def _ratio(answer: Rehearsal) -> float:
    """Expanded uncertainty over what is required, guard band included: the worst."""
    found = [
        inf if j.expanded is None else j.expanded * (1 + j.guard) / j.required
        for j in answer.judgements
    ]
    return max(found, default=inf)


def _shortened(data: dict, like: Settings, total: float) -> float:
    """The same shape, every rest and turning shorter by one factor, as short as it may be [s]."""
    low, high, best = SHORTEST, 1.0, total
    for _ in range(HALVINGS):
        middle = float(np.sqrt(low * high))
        answer = _rehearsed(shortened(data, middle), like)
        if _ratio(answer) <= 1:
            high, best = middle, answer.duration.total
        else:
            low = middle
    return best


def shortened(data: dict, factor: float) -> dict:
    """A procedure's data with every rest and turning shorter: at least a second, or one turn."""
    less = deepcopy(data)
    for step in less["step"]:
        if "duration_s" in step:
            step["duration_s"] = max(1.0, float(np.ceil(step["duration_s"] * factor)))
        if "turns" in step:
            step["turns"] = max(1.0, float(np.ceil(step["turns"] * factor)))
    if "offset_window_s" in less["estimate"]:
        less["estimate"]["offset_window_s"] *= factor
    return less
