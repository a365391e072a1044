"""What methods make of several runs at once, beside what is true of each."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from alignment import AttitudeEstimate, Dwell, Options, Site
from alignment.arrays import Array
from stand.errors import StandError
from stand.evaluation.score import Refusal, Truths, answered_of_runs
from stand.simulation.collector import TrueAttitudes
from stand.simulation.monte_carlo import Trials

Answers = list[tuple[str, list[AttitudeEstimate], list[Refusal]]]  # of each method


@dataclass(frozen=True, slots=True, eq=False)
class Made:
    """The stretches of a run, what is true of each by its label, and the unit's `biases` (6,)."""

    seed: int
    dwells: list[Dwell]
    truths: Mapping[str, Truths]
    biases: Array


def made_by(trials: Trials, seed: int) -> Made | StandError:
    """A run, or why there is none: a sway drawn anew may be beyond the table."""
    try:
        dwells, attitudes = trials.readings(seed)
    except StandError as error:
        return error
    return Made(seed, dwells, truths_by_label(dwells, attitudes), trials.biases(seed))


def truths_by_label(dwells: Sequence[Dwell], attitudes: TrueAttitudes) -> dict[str, Truths]:
    """Of each stretch where it stood at its end, and in the mean."""
    return {
        d.label: Truths(C, mean=mean)
        for d, C, mean in zip(dwells, attitudes, attitudes.means, strict=True)
    }


def answers_to(
    runs: Sequence[Made],
    methods: Sequence[str],
    site_of: Callable[[str, int], Site],
    options: Options,
) -> list[Answers]:
    """Of each run what every method makes of it; `site_of` a method and a seed."""
    every: list[Answers] = [[] for _ in runs]
    dwells = [run.dwells for run in runs]
    for method in methods if runs else ():
        sites = [site_of(method, run.seed) for run in runs]
        found = answered_of_runs(method, dwells, sites, options)
        for own, answer in zip(every, found, strict=True):
            own.append((method, *answer))
    return every
