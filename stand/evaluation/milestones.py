"""What a solution of a drive reached after how many fixes, and what it said on the way."""

import re
from dataclasses import dataclass

import numpy as np

from alignment.arrays import Array
from alignment.estimate import why_undetermined
from alignment.methods.vectors import Curve, Matching
from alignment.units import DEG

MILESTONES = (5, 10, 30, 50)  # fixes after which errors are shown, besides the last
LIMITS = (0.5 * DEG, 0.1 * DEG)  # for which the fixes needed are counted


@dataclass(frozen=True, slots=True)
class Point:
    """A solution after some fixes: whole attitude error and its predicted sigma [rad].

    `state`: 'corrected' at this fix, 'carried' by the gyros since an earlier one, or still the
    'start' as programmed.
    """

    fixes: int
    error: float
    sigma: float
    state: str

    @property
    def undetermined(self) -> str:
        """Why the attitude cannot stand; '' where it can."""
        return why_undetermined(self.sigma)


def points(curve: Curve) -> list[Point]:
    """After the milestones that were reached, and after the last fix."""
    wanted = [k for k, n in enumerate(curve.fixes) if n in MILESTONES or k == len(curve.fixes) - 1]
    error, sigma = _sizes(curve)
    return [
        Point(int(curve.fixes[k]), float(error[k]), float(sigma[k]), _state(curve, k))
        for k in wanted
    ]


def _sizes(curve: Curve) -> tuple[Array, Array]:
    sigma = np.sqrt(np.trace(curve.covariance, axis1=1, axis2=2))
    return np.linalg.norm(curve.error, axis=1), sigma


def _state(curve: Curve, k: int) -> str:
    if curve.given[k]:
        return "corrected"
    return "carried" if curve.given[:k].any() else "start"


def needed(curve: Curve, limit: float) -> tuple[int | None, int | None]:
    """Fixes after which the error, and the predicted sigma, came and stayed below a limit [rad].

    None: never. What was not yet corrected does not count.
    """
    corrected = np.maximum.accumulate(curve.given)

    def first(values: Array) -> int | None:
        above = np.flatnonzero(~((values < limit) & corrected))
        k = above[-1] + 1 if len(above) else 0
        return int(curve.fixes[k]) if k < len(curve.fixes) else None

    error, sigma = _sizes(curve)
    return first(error), first(sigma)


@dataclass(frozen=True, slots=True)
class Doubt:
    """What a solution said at some fixes, numbers aside: their count, first and last; the last
    wording, and whether it corrected there."""

    count: int
    first: int
    last: int
    text: str
    corrected: bool


def doubts(matching: Matching) -> list[Doubt]:
    """What a solution said, each kind once, in order of first appearance."""
    found: dict[tuple[str, bool], Doubt] = {}
    for k in np.flatnonzero(matching.at_fix):
        text, n, corrected = matching.doubts[k], int(matching.fixes[k]), bool(matching.corrected[k])
        if text:
            kind = re.sub(r"[-+\d.e]*\d[-+\d.e]*", "#", text), corrected
            old = found.get(kind, Doubt(count=0, first=n, last=n, text=text, corrected=corrected))
            found[kind] = Doubt(
                count=old.count + 1, first=old.first, last=n, text=text, corrected=corrected
            )
    return list(found.values())
