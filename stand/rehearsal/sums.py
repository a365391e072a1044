"""Errors of many runs, summed as they come: what is kept of each is in its sums."""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from scipy.special import chdtri

from alignment.arrays import Array
from stand.evaluation.statistics import FEW, TAIL
from stand.rehearsal.verification import Refused

Key = tuple[str, str, str, str]  # method, window, label, quantity


class RunErrors(NamedTuple):
    """One run: errors [SI] by what they are of, and why methods refused a stretch, or all ('').

    `untold`: of which of them the run tells no number, for a sigma that cannot stand. They count
    all the same: a prediction is of all runs, and those of small sigmas alone are a choice.
    """

    errors: dict[Key, float]
    refusals: dict[tuple[str, str], str]
    untold: frozenset[Key] = frozenset()


def run_to_json(run: RunErrors) -> dict[str, Any]:
    """A run for a file, for `run_from_json`."""
    errors = [[*key, error] for key, error in run.errors.items()]
    untold = sorted(map(list, run.untold))
    refusals = [[*who, reason] for who, reason in run.refusals.items()]
    return {"errors": errors, "refusals": refusals, "untold": untold}


def run_from_json(data: dict[str, Any]) -> RunErrors:
    """What `run_to_json` made."""
    errors: dict[Key, float] = {(m, w, label, q): error for m, w, label, q, error in data["errors"]}
    untold: frozenset[Key] = frozenset((m, w, label, q) for m, w, label, q in data["untold"])
    refusals = {(method, stretch): reason for method, stretch, reason in data["refusals"]}
    return RunErrors(errors, refusals, untold)


class Sums:
    """What is kept of all runs: of each error how many, the sums of its first, second and fourth
    powers, and how many runs told that number."""

    def __init__(self) -> None:
        self.runs = 0
        self._of: dict[Key, Array] = {}
        self._refused: dict[tuple[str, str], tuple[int, str]] = {}

    def __contains__(self, key: Key) -> bool:
        return key in self._of and self._of[key][-1] > 0

    def mostly_told(self, key: Key) -> bool:
        """Whether more runs told that number than had none that can stand."""
        return key in self and 2 * self._of[key][-1] > self._of[key][0]

    def __iter__(self) -> Iterator[Key]:
        return (key for key in self._of if key in self)

    def add(self, found: RunErrors) -> None:
        """One run."""
        self.runs += 1
        for key, error in found.errors.items():
            if np.isfinite(error):
                told = key not in found.untold
                powers = 1.0, error, error**2, error**4, told
                self._of.setdefault(key, np.zeros(len(powers)))[:] += powers
        for who, reason in found.refusals.items():
            often, first = self._refused.get(who, (0, reason))
            self._refused[who] = often + 1, first

    def to_json(self) -> dict[str, Any]:
        """All of it, for `from_json`: more runs go on where these ended."""
        of = [[*key, *values.tolist()] for key, values in self._of.items()]
        refused = [[*who, *rest] for who, rest in self._refused.items()]
        return {"runs": self.runs, "of": of, "refused": refused}

    @classmethod
    def from_json(cls, data: dict[str, Any]) -> "Sums":
        """What `to_json` wrote."""
        made = cls()
        made.runs = data["runs"]
        made._of = {tuple(row[:4]): np.array(row[4:]) for row in data["of"]}
        made._refused = {(m, stretch): (n, first) for m, stretch, n, first in data["refused"]}
        return made

    def refused(self) -> tuple[Refused, ...]:
        """Methods that refused, stretch by stretch or altogether, with how often."""
        return tuple(
            Refused(method, n, reason, stretch=stretch)
            for (method, stretch), (n, reason) in self._refused.items()
        )

    def sigma(self, key: Key) -> tuple[int, tuple[float, float, float]]:
        """How many runs gave a number; root mean square of the errors with its 95 % interval.

        Chi-square, of `freedom`.
        """
        n, _, squares, *_ = self._of[key]
        freedom, sigma = self.freedom(key), float(np.sqrt(squares / n))
        low, high = np.sqrt(freedom / chdtri(freedom, [TAIL, 1 - TAIL]))
        return int(n), (sigma, float(sigma * low), float(sigma * high))

    def freedom(self, key: Key) -> float:
        """Degrees of freedom of the sum of squares.

        Normal errors of mean m and variance v have as many as there are runs, times
        ``(m^2 + v)^2 / (v^2 + 2 m^2 v)``: the same bias in every run is soon known. Where there are
        `FEW` runs or more, no more than their fourth moment says.
        """
        n, total, squares, fourths, _ = self._of[key]
        mean = squares / n
        of_normal = mean**2 - (total / n) ** 4  # v^2 + 2 m^2 v
        freedom = n * mean**2 / of_normal if n >= FEW and of_normal > 0 else n
        spread = fourths / n - mean**2
        if n >= FEW and spread > 0:
            freedom = min(freedom, 2 * n * mean**2 / spread)
        return float(freedom)
