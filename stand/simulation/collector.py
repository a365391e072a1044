"""Readings sorted by stretch (dwells, turns at constant rate) as a run streams."""

from collections.abc import Collection, Mapping, Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from alignment import Dwell, ImuReadings, Turn
from alignment.arrays import Array
from alignment.quaternions import turned_evenly
from alignment.readings import EDGE
from stand.imu import ImuSpec
from stand.imu.grains import known_readings
from stand.motion.plan import PlannedStep
from stand.samples import ImuBlock, TruthBlock
from stand.table.kinematics import C_NW

NS = 1e-9  # s


class TrueAttitudes(list[Rotation]):
    """True ``C_nb`` of stretches at their ends; `means`: over each, in the same order.

    A mean attitude is the one from which the squares of all half turns' sines are least: the
    eigenvector of the mean of quaternions' squares.
    """

    def __init__(self, ends: Sequence[Rotation], means: Sequence[Rotation]) -> None:
        super().__init__(ends)
        self.means = list(means)


class DwellCollector:
    """Keeps the samples that lie wholly within a stretch, and the true attitude at its end.

    Of the stretches labelled in `moving` the true attitude is kept for every sample. The readings
    know what the sheet of the unit `imu` states of them.
    """

    def __init__(
        self,
        stretches: Sequence[PlannedStep],
        rate_hz: int,
        moving: Collection[str] = (),
        imu: ImuSpec | None = None,
    ) -> None:
        self._steps, self._rate, self._imu = stretches, rate_hz, imu
        self._ranges = [ticks_of(step, rate_hz) for step in stretches]
        self._t = [np.empty(b - a) for a, b in self._ranges]
        self._w = [np.empty((b - a, 3)) for a, b in self._ranges]
        self._f = [np.empty((b - a, 3)) for a, b in self._ranges]
        self._angle = [
            np.empty(0 if step.turning is None else b - a)
            for step, (a, b) in zip(stretches, self._ranges, strict=True)
        ]
        self._q_wb: list[Array | None] = [None] * len(stretches)
        self._squares = np.zeros((len(stretches), 4, 4))
        self._all_q_wb = {
            step.label: np.empty((b - a, 4))
            for step, (a, b) in zip(stretches, self._ranges, strict=True)
            if step.label in moving
        }
        self._tick = 0  # samples seen so far

    def add(self, truth: TruthBlock, imu: ImuBlock) -> None:
        """Take the next block."""
        start, stop = self._tick, self._tick + len(truth)
        for k, (first, last) in enumerate(self._ranges):
            a, b = max(first, start), min(last, stop)
            if a >= b:
                continue
            there, here = slice(a - first, b - first), slice(a - start, b - start)
            self._t[k][there] = imu.t_ns[here] * NS
            self._w[k][there] = imu.w_ib_b[here]
            self._f[k][there] = imu.f_b[here]
            turning = self._steps[k].turning
            if turning is not None:
                self._angle[k][there] = truth.encoders[here, turning.axis]
            label = self._steps[k].label
            if label in self._all_q_wb:
                self._all_q_wb[label][there] = truth.q_wb[here]
            q = truth.q_wb[here]
            self._squares[k] += q.T @ q
            if b == last:
                self._q_wb[k] = truth.q_wb[b - 1 - start]
        self._tick = stop

    def true_at(self, label: str, t: Array) -> Rotation | None:
        """``C_nb`` at times (m,) [s] of a moving stretch; None at rest."""
        if label not in self._all_q_wb:
            return None
        step = next(step for step in self._steps if step.label == label)
        first, _ = ticks_of(step, self._rate)
        q_wb = self._all_q_wb[label]
        times = (first + 1 + np.arange(len(q_wb))) / self._rate
        return C_NW * turned_evenly(times, q_wb, t)

    def finish(
        self, begins: Mapping[str, float | None] | None = None
    ) -> tuple[list[Dwell], TrueAttitudes]:
        """The stretches and their true ``C_nb``; the collector is empty afterwards.

        The attitude is that at the end, of a turning stretch that at encoder angle zero. Of one
        that turns, or counts from later on, no mean is told apart from it.

        `begins`: by label, where a stretch counts from a later time [s] than was planned, because
        the table had not settled; None: it never settled, and is left out.
        """
        dwells, attitudes, means = [], [], []
        for step, q_wb, squares in zip(self._steps, self._q_wb, self._squares, strict=True):
            columns = [c.pop(0) for c in (self._t, self._w, self._f, self._angle)]
            first, last = self._ranges.pop(0)
            t_from = (begins or {}).get(step.label, step.steady_from)
            cut = last if t_from is None else int(np.ceil((t_from - EDGE) * self._rate)) - first
            if t_from is None or cut >= last - first - 1:
                continue
            t, w, f, angle = (c[cut:].copy() if cut else c for c in columns)
            for array in (t, w, f, angle):
                array.flags.writeable = False  # so that the readings need no copies
            turn = None if step.turning is None else Turn(step.turning.axis_b, angle)
            readings = ImuReadings(t, w, f)
            if self._imu is not None:
                readings = known_readings(readings, self._imu, self._rate)
            dwells.append(
                Dwell(
                    label=step.label,
                    t_from=t_from,
                    t_to=step.steady_to,
                    readings=readings,
                    nominal=step.C_nb,
                    turn=turn,
                )
            )
            C_nb = C_NW * Rotation.from_quat(q_wb)
            attitudes.append(C_nb if turn is None else turn.back(C_nb))
            plain = turn is not None or cut > 0
            means.append(attitudes[-1] if plain else C_NW * _mean(squares))
        return dwells, TrueAttitudes(attitudes, means)


def _mean(squares: Array) -> Rotation:
    """Of attitudes whose quaternions' squares have this sum (4, 4)."""
    _, vectors = np.linalg.eigh(squares)
    return Rotation.from_quat(vectors[:, -1])


def ticks_of(step: PlannedStep, rate_hz: int) -> tuple[int, int]:
    """Samples [first, last) whose interval lies within the stretch; sample 0 ends at 1 / rate."""
    first = int(np.ceil((step.steady_from - EDGE) * rate_hz))
    last = int(np.floor((step.steady_to + EDGE) * rate_hz))
    return first, max(first, last)
