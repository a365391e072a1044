"""The audit of the papers: every printed number and claim beside what comes out here.

A module per paper: [S0] by runs of the stand, [S1] by exact rotations of the Earth rate, [S2] by
drives with satellite fixes, [S4] by its error budget and the catalogue's units. `audit` makes the
rows, all of them anew each time.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from stand.errors import StandError
from stand.evaluation.published import fixes, gyrocompassing, rocking, six_position
from stand.evaluation.published.row import Row, Verdict, row_json, verdict_of

__all__ = ["Row", "Verdict", "audit", "row_json", "verdict_of"]

Progress = Callable[[float], None]


@dataclass(frozen=True, slots=True)
class Paper:
    """A paper of the audit: its letter, how its rows are made, and its part of the time."""

    letter: str
    rows: Callable[[Progress], Sequence[Row]]
    share: float


PAPERS = (
    Paper("S0", six_position.rows, 0.5),
    Paper("S1", rocking.rows, 0.1),
    Paper("S2", fixes.rows, 0.35),
    Paper("S4", gyrocompassing.rows, 0.05),
)


def audit(only: str = "", progress: Progress = lambda done: None) -> tuple[Row, ...]:
    """Every row, in the order of the papers, or those whose paper and place begin with `only`.

    Parameters
    ----------
    only : str
        'S4', 'S4 formula (13)'; '' for all.
    progress : callable
        Told the part done, 0 to 1.

    Raises
    ------
    StandError
        No row has that paper and place.
    """
    wanted = only.strip().lower()
    papers = [p for p in PAPERS if p.letter.lower().startswith(wanted[:2])]
    total, done, found = sum(p.share for p in papers), 0.0, []
    for paper in papers:
        before, share = done, paper.share

        def told(part: float, before: float = before, share: float = share) -> None:
            progress((before + share * part) / total)

        found += [row for row in paper.rows(told) if row.key.lower().startswith(wanted)]
        done += share
        progress(done / total)
    if not found:
        raise StandError(
            f"--only {only!r}: no row of the audit has this place; papers: "
            f"{', '.join(p.letter for p in PAPERS)}, places as --published prints them"
        )
    return tuple(found)
