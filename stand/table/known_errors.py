"""What a procedure sets of its table's errors, and what it leaves to be drawn.

An error that is set has one value in every run: it makes a bias of the estimate, not a part of its
sigma. What is not set is drawn from the class, or is nothing with ``drawn = false``.
"""

from dataclasses import dataclass
from math import cos, sin, sqrt
from typing import NamedTuple

from alignment.units import ARC_SECOND, DEG
from stand.table.joints import JOINTS
from stand.table.table import Table
from stand.table.table_errors import PERCENT, AxisSetEntry, TableErrorsEntry

KNOWN = "known errors"  # the row of a prediction that tells the bias of table and unit
_ROOT_HALF = 1 / sqrt(2)
_NOTHING_SET = AxisSetEntry()


@dataclass(frozen=True, slots=True)
class Size:
    """One error of a table: the standard deviation of its draws, or its value; SI."""

    sigma: float = 0.0
    known: float = 0.0


class Wave(NamedTuple):
    """``size (cosine cos x - sine sin x)``: cosine and sine of a phase."""

    size: Size
    cosine: float
    sine: float


@dataclass(frozen=True, slots=True)
class StatedErrors:
    """What is stated of one table: its class, and what a procedure sets instead.

    `ideal`: joints follow the plan. A simulated servo has its own ripple in place of the stated.
    """

    table: Table
    entry: TableErrorsEntry
    ideal: bool = True

    def _left(self, arc_s: float) -> float:
        """What is left to be drawn of a class's figure [rad]."""
        return arc_s * ARC_SECOND if self.entry.drawn else 0.0

    def _one(self, given: float | None, arc_s: float) -> Size:
        return Size(sigma=self._left(arc_s)) if given is None else Size(known=given * ARC_SECOND)

    def base(self) -> tuple[Size, Size, Size]:
        """Turns of all above the pier about east, north and up."""
        tilt = self.entry.base_tilt_arc_s or (None, None)
        geometry = self.table.entry.geometry
        return (
            self._one(tilt[0], geometry.base_tilt_arc_s),
            self._one(tilt[1], geometry.base_tilt_arc_s),
            self._one(self.entry.base_azimuth_arc_s, geometry.base_azimuth_arc_s),
        )

    def mounting(self) -> tuple[Size, ...]:
        """Turns of the unit on its plate about X1, Y1, Z1."""
        given = self.entry.mounting_arc_s or (None, None, None)
        arc_s = self.table.entry.geometry.mounting_arc_s
        return tuple(self._one(value, arc_s) for value in given)

    def _axis(self, i: int) -> AxisSetEntry:
        return self.entry.axis.get(JOINTS[i], _NOTHING_SET)

    def placement(self, i: int) -> Size:
        """Constant offset of an axis's angle."""
        arc_s = self.table.entry.axis[JOINTS[i]].errors.placement_arc_s
        return self._one(self._axis(i).placement_arc_s, arc_s)

    def non_orthogonality(self, i: int) -> Size:
        """How far an axis leans."""
        arc_s = self.table.entry.axis[JOINTS[i]].errors.non_orthogonality_arc_s
        return self._one(self._axis(i).non_orthogonality_arc_s, arc_s)

    def encoder(self, i: int, order: int) -> tuple[Size, Size]:
        """Cosine and sine amplitudes of what goes `order` (1, 2) times round."""
        own = self._axis(i)
        given = (own.encoder_once_arc_s, own.encoder_twice_arc_s)[order - 1] or (None, None)
        # four amplitudes of sigma / sqrt 2: `stand.table.table_errors`
        arc_s = self.table.entry.axis[JOINTS[i]].errors.encoder_arc_s * _ROOT_HALF
        return self._one(given[0], arc_s), self._one(given[1], arc_s)

    def wobble(self, i: int) -> list[Wave]:
        """An axis's nods."""
        own = self._axis(i)
        arc_s = self.table.entry.axis[JOINTS[i]].errors.wobble_arc_s
        return self._waves(self._one(own.wobble_arc_s, arc_s), own.wobble_phase_deg)

    def ripple(self, i: int) -> tuple[int, list[Wave]]:
        """How often an axis's rate ripples per turn, and the waves that the angle makes of it."""
        own, drawn = self._axis(i), self.table.entry.axis[JOINTS[i]].errors
        n = own.ripple_per_turn or drawn.ripple_per_turn
        if not self.ideal:
            return n, []
        if own.rate_ripple_percent is None:
            size = Size(sigma=drawn.rate_ripple_percent * PERCENT / n if self.entry.drawn else 0.0)
        else:
            size = Size(known=-own.rate_ripple_percent * PERCENT / n)  # -(r/n) cos(n q + phase)
        return n, self._waves(size, own.ripple_phase_deg)

    def _waves(self, size: Size, phase_deg: float | None) -> list[Wave]:
        """``size cos(x + phase)``; a phase that is drawn is anywhere in a turn."""
        if phase_deg is None and self.entry.drawn:
            each = Size(sigma=_ROOT_HALF * (size.sigma + abs(size.known)))
            return [Wave(each, 1.0, 0.0), Wave(each, 0.0, 1.0)]
        phase = (phase_deg or 0.0) * DEG
        return [Wave(size, cos(phase), sin(phase))]


def stated(table: Table, entry: TableErrorsEntry | None, ideal: bool = True) -> StatedErrors:
    """Of a table class and a procedure's [table_errors], None where it has none."""
    return StatedErrors(table, TableErrorsEntry() if entry is None else entry, ideal)
