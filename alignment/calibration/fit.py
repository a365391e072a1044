"""The unknowns that explain readings best, and the stretches that nothing explains.

Maximum a posteriori: Gauss and Newton with one Jacobian. A stretch is set against all others by
what it leaves when it is not used itself, all priors in that: one that no chance explains is
named and left out, the worst first.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtrc

from alignment.arrays import Array, set_owned
from alignment.calibration.bench import Bench
from alignment.calibration.design import Design
from alignment.calibration.model import Model
from alignment.calibration.observe import WRONG_MOVE, Observed
from alignment.calibration.result import LeftOut
from alignment.earth import Site
from alignment.errors import AlignmentError
from alignment.units import DEG

STEPS = 20
SETTLED = 1e-3  # of a posterior sigma
CHANCE = 1e-6  # that a good test loses any stretch
MOST = 0.15  # of all stretches, which may be left out: more are no mishaps
CONTRADICTED = 1e-3  # probability of chi-square above which sigmas are enlarged
REFUSED = 5.0  # times that sigmas may be enlarged


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """Unknowns `x` (p,) and the design they are of.

    `off` (m,): what the readings differ by from what was expected of them; `left_out`: stretches
    that were not used, and why.
    """

    design: Design
    x: Array
    off: Array
    left_out: tuple[LeftOut, ...] = ()

    def __post_init__(self) -> None:
        set_owned(self, x=(self.x, (None,), float), off=(self.off, (None,), float))

    @property
    def chi_square(self) -> float:
        """Of the readings about what is expected of them, priors in their covariance."""
        return float(self.off @ self.design.weight @ self.off)

    @property
    def dof(self) -> int:
        """How many readings: what is unknown has priors, and takes none away."""
        return len(self.off)

    @property
    def contradicted(self) -> bool:
        """Whether no chance makes such a chi-square."""
        return bool(chdtrc(self.dof, self.chi_square) < CONTRADICTED)

    @property
    def growth(self) -> float:
        """By how much sigmas are enlarged."""
        return float(np.sqrt(self.chi_square / self.dof)) if self.contradicted else 1.0


def solved(design: Design, y: Array) -> tuple[Array, Array]:
    """Unknowns (p,), and what the readings (m,) differ by from what was expected of them.

    Raises
    ------
    AlignmentError
        The steps do not settle: readings that this model cannot be of.
    """
    unknowns, model = design.model.unknowns, design.model
    x = np.array(unknowns.expected)
    active, sigmas = design.active, np.sqrt(design.covariance.diagonal())
    for number in range(STEPS):
        left = model.left(y, x)
        if number == 0:
            _check_moves(model, left)
        off = left + design.J @ (x - unknowns.expected)
        step = design.step(left, x[active] - unknowns.expected[active])
        x[active] += step
        if np.all(np.abs(step) <= SETTLED * sigmas):
            return x, off
    raise AlignmentError("the readings cannot be those of such a unit: the fit does not settle")


def fitted(
    seen: Sequence[Observed],
    bench: Bench,
    site: Site,
    design: Design | None = None,
    *,
    all_of_them: bool = False,
) -> Fit:
    """The fit without the stretches that contradict all others.

    Parameters
    ----------
    seen : sequence of Observed
        Of one unit on one table.
    bench : Bench
    site : Site
    design : Design, optional
        Of these stretches in another run, where it is known already.
    all_of_them : bool
        Leave none out, whatever it contradicts.

    Raises
    ------
    AlignmentError
        The stretches contradict one another, or the table and unit they are said to be of.
    """
    left_out = [one for session in seen for one in session.left_out]
    current = list(seen)
    most = max(1, int(MOST * sum(len(s.session.stations) for s in seen)))
    model = Model([s.session for s in seen], bench, site)
    worked = Design(model) if design is None else design.of_readings(model)
    dropped = 0
    while True:
        y = np.concatenate([s.y for s in current])
        x, off = solved(worked, y)
        found = Fit(worked, x, off, tuple(left_out))
        worst = None if all_of_them else _worst(worked, off)
        if worst is None:
            break
        k, n, gone = worst
        if dropped == most:
            raise AlignmentError(
                f"more than {most} stretches contradict the others, {gone.stretch} after "
                f"{', '.join(one.stretch for one in left_out[-most:])}: another unit, table or "
                "order of positions than told"
            )
        if n == 0 and len(current[k].session.stations) == 1:
            raise AlignmentError(
                f"{gone.stretch} contradicts what the table and the unit are said to be, and no "
                "other stretch is left: another unit, table or position than told"
            )
        left_out.append(gone)
        current[k] = _without(current[k], n)
        dropped += 1
        worked = Design(Model([s.session for s in current], bench, site))
    if found.growth > REFUSED:
        raise AlignmentError(
            f"the readings contradict what they are said to be of: chi-square "
            f"{found.chi_square:.0f} for {found.dof} readings: another table, unit or order of "
            "positions than told, or errors that nobody stated"
        )
    return found


def _check_moves(model: Model, left: Array) -> None:
    """Refuse moves in which the gyros turn quite otherwise than the encoders."""
    for k, rows in enumerate(model.rows()):
        session = model.sessions[k]
        for move, own in zip(session.moves, rows[len(session.stations) :], strict=True):
            off = float(np.linalg.norm(left[own]))
            if off > WRONG_MOVE:
                raise AlignmentError(
                    f"{move.label}: the gyros turn {off / DEG:.0f} deg or more otherwise than the "
                    "table was told: mirrored axes, another unit of rate or other attitudes"
                )


def _worst(design: Design, off: Array) -> tuple[int, int, LeftOut] | None:
    """Session and number of the stretch or move that the others contradict most; None: none.

    Notes
    -----
    With V the readings' covariance about what is expected, the rows s left out are off by
    ``(V^-1_ss)^-1 (V^-1 off)_s``, of covariance ``(V^-1_ss)^-1``.
    """
    weight = design.weight
    pulled = weight @ off
    rows = design.model.rows()
    trials = sum(len(own) for own in rows)
    worst, found = CHANCE / trials, None
    for k, session in enumerate(design.model.sessions):
        labels = [s.stretch.label for s in session.stations] + [m.label for m in session.moves]
        for n, (label, own) in enumerate(zip(labels, rows[k], strict=True)):
            chi_square = float(pulled[own] @ np.linalg.solve(weight[np.ix_(own, own)], pulled[own]))
            chance = float(chdtrc(len(own), chi_square))
            if chance < worst or (chance == worst == 0.0 and found and chi_square > found[2]):
                reason = (
                    f"contradicts all others: chi-square {chi_square:.0f} for {len(own)} readings "
                    "(bumped, drifting, or another position than told)"
                )
                worst, found = chance, (k, n, chi_square, LeftOut(label, reason))
    return None if found is None else (found[0], found[1], found[3])


def _without(seen: Observed, number: int) -> Observed:
    """A session less one of its stations, with the moves beside it, or one of its moves."""
    session = seen.session
    s = len(session.stations)
    keep = [k for k in range(s) if k != number]
    moves = [
        k
        for k, m in enumerate(session.moves)
        if s + k != number and number not in (m.first, m.last)
    ]
    at = {old: new for new, old in enumerate(keep)}
    sizes = [3 if one.stretch.rate else 1 for one in session.stations]
    edges = 3 * np.cumsum([0, *sizes])
    rows = [np.arange(edges[k], edges[k + 1]) for k in keep]
    second = edges[-1] + 3 * len(session.moves)
    gyro, accel = np.concatenate(rows), np.concatenate(rows) + second
    y = np.concatenate([seen.y[gyro], np.zeros(3 * len(moves)), seen.y[accel]])
    fewer = replace(
        session,
        stations=tuple(session.stations[k] for k in keep),
        moves=tuple(
            replace(m, first=at[m.first], last=at[m.last])
            for k, m in enumerate(session.moves)
            if k in moves
        ),
    )
    return Observed(fewer, y, seen.left_out)
