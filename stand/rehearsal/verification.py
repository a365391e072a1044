"""What simulated runs came to beside the predictions."""

from dataclasses import dataclass

import numpy as np
from scipy.special import bdtrc, chdtri, ndtri

from stand.evaluation.statistics import TAIL

AGREES = (0.9, 1.1)  # predicted over achieved sigma: what the guard band of 10 % stands for
MOSTLY = 0.5  # part of the units that a method must answer for, if it is predicted
_NOTHING = 5e-5  # of a deg, deg/h or mg


@dataclass(frozen=True, slots=True)
class Achieved:
    """What a quantity came to in many runs of the whole stand, beside what was predicted.

    Attributes
    ----------
    method, window, label, quantity, unit, per
        As of the `Prediction`.
    predicted : float or None
        Root mean square, sigma and known bias in quadrature [SI], without what was assumed of
        constants that no sheet states, for runs have none; None where not determined.
    runs : int
        How many runs gave a number.
    sigma, low, high : float
        Root mean square of the errors against the truth [SI], and the 95 % interval of what it
        estimates.
    among : int
        How many quantities are compared at once. One in twenty intervals misses what it is of;
        to contradict a prediction, its own is widened until all of them hold in 95 %.
    freedom : float or None
        Of the chi-square that the interval is of; None: the logarithm is taken for normal.
    noise_only : bool
        As of the `Prediction`.
    """

    method: str
    window: str
    label: str
    quantity: str
    unit: str
    per: float
    predicted: float | None
    runs: int
    sigma: float
    low: float
    high: float
    among: int = 1
    freedom: float | None = None
    noise_only: bool = False

    @property
    def ratio(self) -> tuple[float, float, float] | None:
        """Predicted over achieved sigma, with the ends of its 95 % interval.

        None where nothing was predicted, or where both are below `_NOTHING`: rounding.
        """
        if self.predicted is None or max(self.predicted, self.sigma) < _NOTHING * self.per:
            return None
        if not self.low > 0:
            return None
        return self.predicted / self.sigma, self.predicted / self.high, self.predicted / self.low

    @property
    def widened(self) -> tuple[float, float] | None:
        """The ends of the ratio's interval, so wide that all of `among` hold at once in 95 %."""
        if self.ratio is None:
            return None
        if self.freedom is not None:
            tail = TAIL / self.among
            low, high = np.sqrt(chdtri(self.freedom, [1 - tail, tail]) / self.freedom)
            return self.ratio[0] * float(low), self.ratio[0] * float(high)
        wider = float(ndtri(TAIL / self.among) / ndtri(TAIL))
        ratio, low, high = self.ratio
        return ratio * (low / ratio) ** wider, ratio * (high / ratio) ** wider

    @property
    def agrees(self) -> bool | None:
        """Whether the widened interval meets `AGREES`; None where there is nothing to compare."""
        return None if self.widened is None else _meets(*self.widened)

    @property
    def agrees_alone(self) -> bool | None:
        """The same by its own plain interval, as if nothing else were compared."""
        return None if self.ratio is None else _meets(*self.ratio[1:])


def _meets(low: float, high: float) -> bool:
    return bool(high >= AGREES[0] and low <= AGREES[1])


@dataclass(frozen=True, slots=True)
class Refused:
    """A method that gave no answer in `runs` of the runs, and the first reason.

    No answer at all, or, with a `stretch`, none of that one while it answered of others.
    `predicted`: whether the rehearsal has a number for it.
    """

    method: str
    runs: int
    reason: str
    predicted: bool = False
    stretch: str = ""

    @property
    def who(self) -> str:
        """What gave no answer, in words."""
        return " at ".join(part for part in (self.method, self.stretch) if part)


@dataclass(frozen=True, slots=True)
class Verification:
    """Many runs of the whole stand: `requested` and `done` before it ended, in `seconds`.

    The runs' seeds are `seed`, `seed` + 1 ...; each has a unit, a table and a sway of its own.
    `stand run --seed` makes any of them again.
    """

    requested: int
    done: int
    seed: int
    seconds: float
    achieved: tuple[Achieved, ...]
    refused: tuple[Refused, ...] = ()

    @property
    def interrupted(self) -> bool:
        """Whether it ended before all the runs that were asked for."""
        return self.done < self.requested

    @property
    def disagreeing(self) -> tuple[Achieved, ...]:
        """Those whose prediction the runs contradict."""
        return tuple(a for a in self.achieved if a.agrees is False)

    @property
    def silent(self) -> tuple[Refused, ...]:
        """Methods that are predicted and mostly gave no answer: more often than chance has it.

        Where a method would refuse `MOSTLY`, the rehearsal is to say so in place of a number.
        """
        return tuple(
            r for r in self.refused if r.predicted and bdtrc(r.runs - 1, self.done, MOSTLY) < TAIL
        )

    @property
    def contradicts(self) -> bool:
        """Whether nothing holds that rests on the predictions."""
        return bool(self.disagreeing or self.silent)

    @property
    def missing_alone(self) -> tuple[Achieved, ...]:
        """Those whose plain 95 % interval misses; by chance that is to be one in twenty."""
        return tuple(a for a in self.achieved if a.agrees_alone is False)
