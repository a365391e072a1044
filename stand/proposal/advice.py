"""A proposal as an advice: where it beats the procedure, and what else would help."""

from collections.abc import Callable
from dataclasses import replace

from stand.proposal.preparation import request_of
from stand.proposal.propose import propose
from stand.rehearsal.result import Advice, Rehearsal, Verdict
from stand.simulation.settings import Settings


def with_proposal(
    answer: Rehearsal, made: Settings, progress: Callable[[float], None] = lambda done: None
) -> Rehearsal:
    """The same with the shortest test found, where it is shorter than all that keep it so far.

    Those are the procedure itself, if it passes, and the changes of it that were advised.
    """
    wanted = request_of(made)
    if wanted is None or not answer.judgements:
        return answer
    found = propose(wanted, made, progress)
    if not found.feasible:
        return answer
    known = [a.duration for a in answer.advice if a.helps and a.duration is not None]
    if answer.verdict is Verdict.PASS:
        known.append(answer.duration.total)
    shortest = min(known, default=float("inf"))
    if found.total >= shortest:
        return answer
    instead = "" if shortest == float("inf") else f" instead of {shortest:.0f} s"
    labels = "; ".join(f"{s.label} {s.seconds:g} s" for s in found.stations)
    first = next(iter(found.rehearsal.judgements)) if found.rehearsal else None
    advice = Advice(
        quantity=answer.judgements[0].quantity,
        text=f"another test keeps all of it in {found.total:.0f} s{instead} by "
        f"{', '.join(found.methods)}: {labels} (stand propose)",
        changes=(),
        sigma=None if first is None else first.sigma,
        noise_only=first is not None and first.noise_only,
        duration=found.total,
        toml=found.text,
    )
    return replace(answer, advice=(*answer.advice, advice))
