"""A row of the audit: what a paper prints, what comes out here, and why."""

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from scipy.optimize import root_scalar

COMMAND = "stand compare --published --only"


class Verdict(StrEnum):
    """Of a printed number or claim; CONTEXT is what is quoted beside it and is not ours to try."""

    REPRODUCED = "reproduced"
    NOT_REPRODUCED = "not reproduced"
    CONTEXT = "context"


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """A printed number or claim beside ours.

    Attributes
    ----------
    paper : str
        Its letter: 'S0'.
    place : str
        Table, figure or formula: 'formula (13), roll'.
    quantity : str
        What it is, and the case.
    printed, ours : str
        In words, with units.
    verdict : Verdict
    reason : str
        Under which assumptions ours comes out, or why the printed one does not.
    nearest : str
        Where it does not: the nearest assumption under which it would; '' where none was found.
    command : str
        That repeats it; if not given, the audit of this place alone.
    """

    paper: str
    place: str
    quantity: str
    printed: str
    ours: str
    verdict: Verdict
    reason: str
    nearest: str = ""
    command: str = ""

    def __post_init__(self) -> None:
        if not self.command:
            object.__setattr__(self, "command", f'{COMMAND} "{self.key}"')

    @property
    def key(self) -> str:
        """Paper and place: what ``--only`` takes the beginning of."""
        return f"{self.paper} {self.place}"

    @property
    def reproduced(self) -> bool:
        """Whether it came out."""
        return self.verdict is Verdict.REPRODUCED


def verdict_of(reproduced: bool) -> Verdict:
    """REPRODUCED or NOT_REPRODUCED."""
    return Verdict.REPRODUCED if reproduced else Verdict.NOT_REPRODUCED


def judged(paper: str, place: str, quantity: str, printed: str, ours: str, good: bool,
           reason: str, nearest: str = "", command: str = "") -> Row:  # fmt: skip
    """A row that came out, or did not."""
    return Row(
        paper=paper,
        place=place,
        quantity=quantity,
        printed=printed,
        ours=ours,
        verdict=verdict_of(good),
        reason=reason,
        nearest=nearest,
        command=command,
    )


def row_json(row: Row) -> dict[str, Any]:
    """One row for machines."""
    return {
        "paper": row.paper,
        "place": row.place,
        "quantity": row.quantity,
        "printed": row.printed,
        "ours": row.ours,
        "verdict": row.verdict.value,
        "reason": row.reason,
        "nearest": row.nearest,
        "command": row.command,
    }


def solved(value: Callable[[float], float], target: float, low: float, high: float) -> float | None:
    """Where a value that changes steadily comes to `target`; None where it does not in between."""
    ends = value(low) - target, value(high) - target
    if ends[0] * ends[1] > 0:
        return None
    found = root_scalar(lambda x: value(x) - target, bracket=(low, high), method="brentq")
    return float(found.root)
