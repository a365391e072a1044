"""`stand propose`: from a requirement to the shortest procedure that keeps it."""

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from alignment import ESTIMATORS
from alignment.methods.calibration import CALIBRATION
from stand.imu import unstated
from stand.imu.priors import only
from stand.procedure.requirements import CONSTANTS
from stand.proposal import search
from stand.proposal.candidates import Clock, candidates
from stand.proposal.heading import LONGEST, METHODS, Found, floor_time, shapes, shortest_of
from stand.proposal.information import EVER, Problem, settings_of
from stand.proposal.judged import Judged
from stand.proposal.result import Proposal, Reached, Station
from stand.proposal.text import labels_of
from stand.proposal.trim import Amounts, longer, trimmed
from stand.proposal.wanted import Wanted
from stand.rehearsal.constants import floors
from stand.rehearsal.rehearse import rehearse
from stand.rehearsal.requirement import floor_of, floor_text, rows_of
from stand.rehearsal.result import Judgement, Rehearsal, Verdict
from stand.simulation.settings import Settings

GROWTH = 1.1
MOST_GROWTH = 20.0
SHARES = {"search": 0.6, "trim": 0.95}  # of the progress
Progress = Callable[[float], None]


def propose(wanted: Wanted, like: Settings, progress: Progress = lambda done: None) -> Proposal:
    """The shortest test found for a unit on a table.

    `like`: unit, table, site and rate; its procedure is of no matter.

    Raises
    ------
    StandError
        The requirement contradicts the table, or asks for what the unit has not.
    """
    require = wanted.entry.require
    limits = require.limits_for(like.imu.id, like.imu.entry.grade, like.revision)
    if not limits:
        raise wanted.fault("require", "nothing of this unit", f"no limit is for {like.imu.id}")
    those = candidates(wanted, like.imu, like.table)
    plain = Proposal(title=wanted.entry.title, settings=like, feasible=False, considered=len(those))
    constants = {q: limit for q, limit in limits.items() if q in CONSTANTS}
    angles = {q: limit for q, limit in limits.items() if q not in CONSTANTS}
    _check_method(wanted, constants, angles)
    problem = Problem(wanted, those, like, constants) if constants else None
    refused = "" if problem is None else _beyond(problem, constants, require.coverage)
    if refused:
        return replace(plain, reason=refused)
    dwell = wanted.entry.allowed.shortest_dwell_s

    def share(part: float) -> None:
        progress(SHARES["search"] * part)

    amounts, bound, methods = (), 0.0, ()
    if problem is not None:
        found, bound = _of_constants(problem, dwell, share)
        if found is None:
            return replace(plain, bound=bound, reason=_drifting(problem, constants))
        amounts, methods = found, (CALIBRATION,)
    clock = Clock(like.table)
    if angles:
        best, least = _of_attitude(wanted, like, angles, clock, dwell, share)
        bound = max(bound, least)
        if best is None:
            return replace(plain, bound=bound, reason=_no_attitude(wanted, like, angles, least))
        amounts, methods = (*amounts, *best.amounts), (*methods, best.shape.method)
    judge = Judged(wanted, like, limits, methods, None if problem is None else problem.goal)
    amounts = _kept(amounts, judge)
    if amounts is None:
        why = "its own rehearsal does not keep it, and no longer test does"
        return replace(plain, bound=bound, reason=why)
    amounts = trimmed(amounts, judge.keeps, dwell)
    if problem is not None:
        amounts = _in_order(amounts, problem)
    progress(SHARES["trim"])
    done = _told(replace(plain, bound=bound, methods=methods), amounts, judge, clock)
    longest = wanted.entry.allowed.max_time_s
    if done.feasible and longest is not None and done.total > longest:
        why = f"the shortest test found takes {done.total:.0f} s, max_time_s = {longest:g}"
        done = replace(done, feasible=False, reason=why)
    progress(1.0)
    return done


# --- constants of the unit -----------------------------------------------------------------------


def _of_constants(
    problem: Problem, dwell: float, progress: Progress
) -> tuple[Amounts | None, float]:
    """The best test that the search finds, and the bound."""
    nothing = np.zeros(len(problem.candidates))
    if problem.squares(nothing).max() <= 1:  # the data sheet keeps it: one look at it
        return ((problem.candidates[0], dwell),), 0.0
    weights = search.convex(problem)
    progress(0.2)
    found = [search.greedy(problem, dwell)]
    progress(0.4)
    found.append(search.sparse(problem, weights, dwell))
    progress(0.6)
    own = [t for t in found if t is not None]
    if not own:
        return None, weights.bound
    best = min(own, key=problem.total)
    best = search.exchanged(problem, best, dwell, lambda part: progress(0.6 + 0.4 * part))
    return problem.amounts(best), weights.bound


def _in_order(amounts: Amounts, problem: Problem) -> Amounts:
    """The same; what was left out may have made another order shorter."""
    at = {one: k for k, one in enumerate(problem.candidates)}
    if len({one for one, _ in amounts}) < len(amounts) or any(o not in at for o, _ in amounts):
        return amounts  # with rests for an attitude behind it
    t = np.zeros(len(problem.candidates))
    for one, seconds in amounts:
        t[at[one]] = seconds
    return problem.amounts(t)


def _check_method(
    wanted: Wanted, constants: Mapping[str, float], angles: Mapping[str, float]
) -> None:
    """A method that is asked for finds all that is required."""
    method = wanted.entry.require.method
    if method is None:
        return
    if constants and (angles or method != CALIBRATION):
        quantity = next(iter(constants if method != CALIBRATION else angles))
        raise wanted.fault("require, method", f'"{method}"', f"does not find {quantity}")
    if angles and method not in METHODS:
        raise wanted.fault(
            "require, method", f'"{method}"', f"of an attitude must be one of {', '.join(METHODS)}"
        )


def _beyond(problem: Problem, constants: Mapping[str, float], coverage: float) -> str:
    """Why no test at all keeps it: what seat, table and gravity leave."""
    left = problem.goal.by_quantity(
        np.sqrt(problem.squares(np.full(len(problem.candidates), EVER)))
    )
    over = [quantity for quantity, ratio in left.items() if ratio > 1]
    if not over:
        return ""
    least = floors(ESTIMATORS[CALIBRATION], problem.scene)
    told = []
    for quantity in over:
        left_by = floor_text(quantity, floor_of(quantity, least), coverage)
        limit = constants[quantity] / CONSTANTS[quantity].unit[1]
        told.append(f"{quantity}: {left_by}, required {limit:g}")
    return "; ".join(told)


def _drifting(problem: Problem, constants: Mapping[str, float]) -> str:
    """Why a longer test does not help: what wanders meanwhile."""
    t = np.full(len(problem.candidates), 600.0)
    t = search.rounded(problem, t, 600.0)
    left = problem.goal.by_quantity(np.sqrt(problem.exact(t)))
    over = {quantity: ratio for quantity, ratio in left.items() if ratio > 1} or left
    worst = max(over, key=lambda quantity: over[quantity])
    constant = CONSTANTS[worst]
    reached = over[worst] * constants[worst] / constant.unit[1]
    return (
        f"{worst}: no longer test helps, what wanders meanwhile (bias instability) leaves "
        f"{reached:.3g} {constant.unit[0]} in {problem.total(t):.0f} s, required "
        f"{constants[worst] / constant.unit[1]:g}"
    )


# --- an attitude ---------------------------------------------------------------------------------


def _of_attitude(
    wanted: Wanted,
    like: Settings,
    angles: Mapping[str, float],
    clock: Clock,
    dwell: float,
    progress: Progress,
) -> tuple[Found | None, float]:
    """The best shape, and the bound."""
    require = wanted.entry.require
    least = 0.0
    if "heading" in angles:
        least = floor_time(like, angles["heading"] / (require.coverage * (1 + require.guard)))
    every = shapes(wanted, like)
    judges: dict[str, Judged] = {}

    def judge_of(method: str) -> Judged:
        if method not in judges:
            judges[method] = Judged(wanted, like, angles, (method,), None)
        return judges[method]

    longest = wanted.entry.allowed.max_time_s or LONGEST
    start = min(least, longest)
    found = shortest_of(every, judge_of, clock, start, dwell, progress, longest)
    return (found[0] if found else None), least


def _no_attitude(wanted: Wanted, like: Settings, angles: Mapping[str, float], least: float) -> str:
    told = ", ".join(f"{name} to {np.degrees(limit):g} deg" for name, limit in angles.items())
    many = len(shapes(wanted, like))
    longest = wanted.entry.allowed.max_time_s
    within = "a day" if longest is None else f"max_time_s = {longest:g}"
    text = f"{told}: none of {many} shapes (rests about the vertical, turning) keeps it in {within}"
    floor = f"; white noise alone takes {least:.0f} s" if least else ""
    return text + floor


# --- the last word -------------------------------------------------------------------------------


def _kept(amounts: Amounts, judge: Judged) -> Amounts | None:
    """As much longer as its own rehearsal asks for."""
    factor = 1.0
    while factor < MOST_GROWTH:
        now = amounts if factor == 1.0 else longer(amounts, factor)
        if judge.keeps(now):
            return now
        factor *= GROWTH
    return None


def _told(plain: Proposal, amounts: Amounts, judge: Judged, clock: Clock) -> Proposal:
    """The proposal with its words and its own rehearsal."""
    purposes = _purposes(amounts, judge)
    own = judge.rehearsal(amounts)
    labels = labels_of([one for one, _ in amounts])
    stations = tuple(
        Station(label, seconds, purposes[k])
        for k, (label, (_, seconds)) in enumerate(zip(labels, amounts, strict=True))
    )
    true = _on_a_true_table(amounts, judge, plain.settings)
    quantities = tuple(_reached(j, own, judge.ratios(amounts), true) for j in own.judgements)
    errors = [f.text for f in own.findings if f.severity.value == "error"]
    passes = own.verdict is Verdict.PASS
    total = own.duration.total
    remarks = (
        f"Proposed: {total:.4g} s for {plain.settings.imu.id} on {plain.settings.table.id}; "
        f"no test of these candidates can be below {plain.bound:.4g} s (noise alone, no moves).",
        *(f"{q.quantity}: {_in_words(q)}" for q in quantities),
        *unstated(plain.settings.imu),
    )
    return replace(
        plain,
        feasible=passes,
        reason="" if passes else "; ".join(errors) or f"its own rehearsal says {own.verdict.value}",
        text=judge.text(amounts, remarks=remarks, what_for=dict(enumerate(purposes))),
        total=total,
        stations=stations,
        quantities=quantities,
        rehearsal=own,
        judged=judge.count,
    )


def _in_words(q: Reached) -> str:
    sigma = "not determined"
    if q.predicted is not None:
        sigma = f"sigma {q.predicted:.3g} {q.unit}{only(q.noise_only)}"
    return f"{sigma}, required {q.required:g}; limited by {q.limited_by} ({100 * q.share:.0f} %)"


def _purposes(amounts: Amounts, judge: Judged) -> list[str]:
    """What each station is for: the quantity that is farthest from what is allowed without it."""
    found = []
    for k in range(len(amounts)):
        left = (*amounts[:k], *amounts[k + 1 :])
        if not left:
            found.append("all of it")
            continue
        after = judge.ratios(left)
        worst = max(after, key=lambda q: after[q])
        if worst == "plan" or not np.isfinite(after[worst]):
            found.append(f"{worst} is not determined without it")
        else:
            found.append(f"without it {worst} is {after[worst]:.3g} times what is allowed")
    return found


def _on_a_true_table(amounts: Amounts, judge: Judged, like: Settings) -> dict[str, float | None]:
    """Sigma [SI] of each quantity on a table and seat without errors: what a better one gains."""
    made = settings_of(judge.text(amounts), replace(like, true_table=True))
    return {j.quantity: j.sigma for j in rehearse(made).judgements}


def _reached(
    j: Judgement,
    own: Rehearsal,
    ratios: Mapping[str, float],
    true: Mapping[str, float | None],
) -> Reached:
    rows = rows_of(j.quantity, (p for p in own.predictions if p.method == j.method))
    worst = max(rows, key=lambda p: p.rank) if rows else None
    limited, part = "", 0.0
    if worst is not None and worst.contributions and worst.rms:
        first = worst.contributions[0]
        limited, part = first.source, float((first.sigma / worst.rms) ** 2)
    table = true.get(j.quantity)
    return Reached(
        quantity=j.quantity,
        unit=j.unit,
        required=j.required / j.per,
        predicted=None if j.sigma is None else j.sigma / j.per,
        ratio=float(ratios.get(j.quantity, np.inf)),
        limited_by=limited,
        share=part,
        true_table=None if table is None else table / j.per,
        noise_only=j.noise_only,
    )
