"""The last word of a proposal: its own rehearsal, and that no neighbour of it would do."""

from collections.abc import Callable, Sequence

import numpy as np

from stand.proposal.candidates import Candidate

Amounts = tuple[tuple[Candidate, float], ...]
Keeps = Callable[[Amounts], bool]
# of a rest [s]: below `up to` by so much; each step less than a fifth of it
GRID = ((2.0, 0.2), (10.0, 0.5), (60.0, 1.0), (600.0, 5.0), (np.inf, 10.0))
MOST_ROUNDS = 6


def trimmed(amounts: Amounts, keeps: Keeps, shortest: float) -> Amounts:
    """The same with nothing left that could be left out or be shorter: `keeps` is asked.

    Until leaving any one out breaks it, and so does making any rest or turning shorter by a step.
    """
    for _ in range(MOST_ROUNDS):
        before = amounts
        amounts = _without(amounts, keeps)
        for k in sorted(range(len(amounts)), key=lambda k: -amounts[k][1]):
            amounts = _shorter(amounts, k, keeps, shortest)
        if amounts == before:
            break
    return amounts


def _without(amounts: Amounts, keeps: Keeps) -> Amounts:
    for one in sorted(amounts, key=lambda item: -item[1]):
        left = tuple(item for item in amounts if item is not one)
        if left and keeps(left):
            amounts = left
    return amounts


def _shorter(amounts: Amounts, k: int, keeps: Keeps, shortest: float) -> Amounts:
    """The k-th as short as is kept, by halving over the lengths that may stand in a procedure."""
    steps = _lengths(amounts[k], shortest)
    low, high = -1, len(steps) - 1  # `high` is kept, `low` is not known to be
    if high > 0 and not keeps(_with(amounts, k, steps[high - 1])):
        return amounts
    while high - low > 1:
        middle = (low + high) // 2
        if keeps(_with(amounts, k, steps[middle])):
            high = middle
        else:
            low = middle
    return _with(amounts, k, steps[high])


def _with(amounts: Amounts, k: int, seconds: float) -> Amounts:
    return (*amounts[:k], (amounts[k][0], seconds), *amounts[k + 1 :])


def _lengths(item: tuple[Candidate, float], shortest: float) -> list[float]:
    """Lengths [s] up to its own that may stand in a procedure."""
    one, seconds = item
    if one.axis:
        turns = round(seconds / one.quantum)
        return [n * one.quantum for n in range(1, turns + 1)]
    return [*(t for t in dwells(shortest, seconds) if t < seconds - 1e-9), seconds]


def dwells(shortest: float, longest: float) -> list[float]:
    """Readable lengths of a rest [s], from `shortest` to `longest`."""
    found, t = [], shortest
    while t <= longest + 1e-9:
        found.append(round(t, 3))
        step = next(step for up_to, step in GRID if t < up_to - 1e-9)
        t = step * (np.floor(t / step + 1e-6) + 1)
    return found


def longer(amounts: Sequence[tuple[Candidate, float]], factor: float) -> Amounts:
    """All of it longer: whole turns, and rests of whole seconds."""
    found = []
    for one, seconds in amounts:
        if one.axis:
            more = np.ceil(factor * seconds / one.quantum - 1e-9) * one.quantum
        else:
            more = np.ceil(factor * seconds - 1e-9)
        found.append((one, float(min(more, one.most))))
    return tuple(found)
