"""A proposed test as its own rehearsal sees it: moves, drifts, table and all."""

from collections.abc import Mapping, Sequence

import numpy as np

from alignment.calibration import terms
from alignment.calibration.bench import Bench
from alignment.calibration.design import Design
from alignment.calibration.model import Model
from alignment.errors import AlignmentError
from alignment.methods.calibration import CALIBRATION
from stand.errors import StandError
from stand.procedure.requirements import CONSTANTS
from stand.proposal.information import Goal, settings_of
from stand.proposal.text import procedure_of
from stand.proposal.trim import Amounts
from stand.proposal.wanted import Wanted
from stand.rehearsal.accuracy import predict
from stand.rehearsal.constants import planned_session
from stand.rehearsal.rehearse import prepared, rehearse
from stand.rehearsal.requirement import judge
from stand.rehearsal.result import Rehearsal
from stand.rehearsal.scene import Scene
from stand.simulation.settings import Settings

KEEPS = 1.0 - 1e-6  # of what may be: a verdict's own sums may round the other way


class Judged:
    """How far tests of one kind keep what is required.

    Parameters
    ----------
    wanted : Wanted
    like : Settings
        Unit, table, site and rate.
    limits : mapping
        What is required [SI], by quantity.
    methods : sequence of str
        That find it.
    goal : Goal or None
        The constants among it.
    """

    def __init__(
        self,
        wanted: Wanted,
        like: Settings,
        limits: Mapping[str, float],
        methods: Sequence[str],
        goal: Goal | None,
    ) -> None:
        self._wanted, self._like, self.methods = wanted, like, tuple(methods)
        self._angles = {q: limit for q, limit in limits.items() if q not in CONSTANTS}
        self._goal = goal
        self._known: dict[Amounts, dict[str, float]] = {}

    @property
    def count(self) -> int:
        """How many tests were judged."""
        return len(self._known)

    def text(self, amounts: Amounts, **more: object) -> str:
        """The procedure."""
        return procedure_of(
            self._wanted,
            amounts,
            self.methods,
            self._wanted.entry.require,
            table=self._like.table.id,
            **more,  # pyright: ignore[reportArgumentType]
        )

    def rehearsal(self, amounts: Amounts) -> Rehearsal:
        """The whole answer."""
        return rehearse(settings_of(self.text(amounts), self._like))

    def keeps(self, amounts: Amounts) -> bool:
        """Whether all that is required is kept."""
        return max(self.ratios(amounts).values()) <= KEEPS

    def ratios(self, amounts: Amounts) -> dict[str, float]:
        """Expanded uncertainty, guard band included, over what is required; by quantity."""
        if amounts not in self._known:
            self._known[amounts] = self._ratios(amounts)
        return self._known[amounts]

    def _ratios(self, amounts: Amounts) -> dict[str, float]:
        try:
            scene = prepared(settings_of(self.text(amounts), self._like))
        except StandError:
            return dict.fromkeys(("plan",), np.inf)
        found = {} if self._goal is None else self._constants(scene, self._goal)
        return found | self._attitude(scene)

    def _constants(self, scene: Scene, goal: Goal) -> dict[str, float]:
        bench = scene.options.bench
        assert isinstance(bench, Bench)
        design = Design(Model([planned_session(scene)], bench, scene.site))
        rows = np.zeros((len(goal.names), design.model.count))
        rows[:, : terms.COUNT] = goal.rows
        rows = rows[:, design.active] / goal.limits[:, None]
        return goal.by_quantity(np.sqrt(np.einsum("ka,ab,kb->k", rows, design.covariance, rows)))

    def _attitude(self, scene: Scene) -> dict[str, float]:
        if not self._angles:
            return {}
        require = self._wanted.entry.require
        methods = [m for m in self.methods if m != CALIBRATION]
        try:
            predictions, _ = predict(scene, methods)
        except AlignmentError:
            return dict.fromkeys(self._angles, np.inf)
        found = {}
        for j in judge(require, dict(self._angles), methods, predictions):
            expanded = np.inf if j.expanded is None else j.expanded
            found[j.quantity] = float(expanded * (1 + require.guard) / j.required)
        return found
