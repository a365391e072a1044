"""Readings sorted by dwell: from a run as it streams, or from a recording."""

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from alignment import Dwell, ImuReadings
from alignment.arrays import Array
from alignment.readings import EDGE
from stand.physics.kinematics import C_NW
from stand.plan import PlannedStep
from stand.samples import ImuBlock, TruthBlock

NS = 1e-9  # s


class DwellCollector:
    """Keeps the samples that lie wholly within a dwell, and the true attitude at its end."""

    def __init__(self, dwells: Sequence[PlannedStep], rate_hz: int) -> None:
        self._steps = dwells
        self._ranges = [_ticks(step, rate_hz) for step in dwells]
        self._t = [np.empty(b - a) for a, b in self._ranges]
        self._w = [np.empty((b - a, 3)) for a, b in self._ranges]
        self._f = [np.empty((b - a, 3)) for a, b in self._ranges]
        self._q_wb: list[Array | None] = [None] * len(dwells)
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
            if b == last:
                self._q_wb[k] = truth.q_wb[b - 1 - start]
        self._tick = stop

    def finish(self) -> tuple[list[Dwell], list[Rotation]]:
        """The dwells and their true ``C_nb``; the collector is empty afterwards."""
        dwells, attitudes = [], []
        for step, q_wb in zip(self._steps, self._q_wb, strict=True):
            t, w, f = self._t.pop(0), self._w.pop(0), self._f.pop(0)
            for array in (t, w, f):
                array.flags.writeable = False  # so that the readings need no copies
            readings = ImuReadings(t, w, f)
            dwells.append(Dwell(step.label, step.t_from, step.t_to, readings, step.C_nb))
            attitudes.append(C_NW * Rotation.from_quat(q_wb))
        return dwells, attitudes


def _ticks(step: PlannedStep, rate_hz: int) -> tuple[int, int]:
    """Samples [first, last) whose interval lies within the dwell; sample 0 ends at 1 / rate."""
    first = int(np.ceil((step.t_from - EDGE) * rate_hz))
    last = int(np.floor((step.t_to + EDGE) * rate_hz))
    return first, max(first, last)
