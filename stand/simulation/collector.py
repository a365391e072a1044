"""Readings sorted by stretch (dwells, turns at constant rate) as a run streams."""

from collections.abc import Collection, Mapping, Sequence
from math import inf
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from alignment import Dwell, ImuReadings, Turn
from alignment.arrays import Array
from alignment.parts import taken
from alignment.quaternions import turned_evenly
from alignment.readings import EDGE, JointAngles
from stand.imu import ImuSpec
from stand.imu.grains import stated_of
from stand.motion.plan import PlannedStep
from stand.room import Room
from stand.samples import ImuBlock, Sampling, TruthBlock
from stand.table.joints import JOINTS, StandModel
from stand.table.kinematics import C_NW
from stand.table.leanings import joints_read

NS = 1e-9  # s
INTO = 0.5  # s: how far the readings of a move reach into the stretches beside it


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

    Of the stretches labelled in `moving` the true attitude is kept for every sample. What is too
    much for memory lies in a file in `folder`, see `Room`. `moves`: whether stretches at rest keep
    the readings of the moves beside them too. The readings know what the sheet of the unit `imu`
    states of samples by `sampling`. `stand`: where joints do not follow the plan, which makes of
    their encoders' means where they stood.
    """

    def __init__(
        self,
        stretches: Sequence[PlannedStep],
        rate_hz: int,
        moving: Collection[str] = (),
        folder: Path | None = None,
        moves: bool = False,
        imu: ImuSpec | None = None,
        stand: StandModel | None = None,
        sampling: Sampling = Sampling.MEAN,
    ) -> None:
        self._sampling = sampling
        self._steps, self._rate, self._imu, self._stand = stretches, rate_hz, imu, stand
        self._encoders = np.zeros((len(stretches), len(JOINTS)))
        self._ranges = [ticks_of(step, rate_hz) for step in stretches]
        self._held = self._with_moves() if moves else self._ranges
        moving = set(moving)
        lengths = [b - a for a, b in self._ranges]
        angles = [
            0 if step.turning is None else n for step, n in zip(stretches, lengths, strict=True)
        ]
        attitudes = {
            step.label: n
            for step, n in zip(stretches, lengths, strict=True)
            if step.label in moving
        }
        held = [b - a for a, b in self._held]
        room = 7 * sum(held) + sum(angles) + 4 * sum(attitudes.values())
        self._room = Room(room * np.float64().nbytes, folder)
        self._t = [self._room.array((n,)) for n in held]
        self._w = [self._room.array((n, 3)) for n in held]
        self._f = [self._room.array((n, 3)) for n in held]
        self._angle = [self._room.array((n,)) for n in angles]
        self._q_wb: list[Array | None] = [None] * len(stretches)
        self._squares = np.zeros((len(stretches), 4, 4))
        self._all_q_wb = {label: self._room.array((n, 4)) for label, n in attitudes.items()}
        self._begins = {step.label: a for step, (a, _) in zip(stretches, self._ranges, strict=True)}
        self._tick = 0  # samples seen so far
        self._first = 0  # stretches that were over then

    def _with_moves(self) -> list[tuple[int, int]]:
        """Samples of each rest up to, and a little into, the stretches beside it."""
        into = round(INTO * self._rate)
        ends = [0, *(b - into for _, b in self._ranges)]
        starts = [*(a + into for a, _ in self._ranges[1:]), 0]
        return [
            (max(0, min(low, own[0])), max(high, own[1])) if step.turning is None else own
            for step, own, low, high in zip(self._steps, self._ranges, ends, starts, strict=False)
        ]

    def add(self, truth: TruthBlock, imu: ImuBlock) -> None:
        """Take the next block."""
        start, stop = self._tick, self._tick + len(truth)
        while self._first < len(self._held) and self._held[self._first][1] <= start:
            self._first += 1
        for k in range(self._first, len(self._held)):
            first, last = self._held[k]
            if first >= stop:
                break  # stretches follow one another
            a, b = max(first, start), min(last, stop)
            if a >= b:
                continue
            there, here = slice(a - first, b - first), slice(a - start, b - start)
            self._t[k][there] = imu.t_ns[here] * NS
            self._w[k][there] = imu.w_ib_b[here]
            self._f[k][there] = imu.f_b[here]
            first, last = self._ranges[k]
            a, b = max(first, start), min(last, stop)
            if a >= b:
                continue
            there, here = slice(a - first, b - first), slice(a - start, b - start)
            turning = self._steps[k].turning
            if turning is not None:
                self._angle[k][there] = truth.encoders[here, turning.axis]
            label = self._steps[k].label
            if label in self._all_q_wb:
                self._all_q_wb[label][there] = truth.q_wb[here]
            q = truth.q_wb[here]
            self._squares[k] += q.T @ q
            if self._stand is not None:  # of its second half: it may have to settle
                half = max(a, (first + last) // 2)
                own = (
                    truth.encoders[slice(half - start, b - start)] if half < b else np.zeros((0, 6))
                )
                self._encoders[k] += own.sum(axis=0) / (last - (first + last) // 2)
            if b == last:
                self._q_wb[k] = truth.q_wb[b - 1 - start]
        self._tick = stop
        self._room.written()

    def _joints(self, step: PlannedStep, encoders: Array) -> JointAngles:
        """Where the plan has the axes, or the encoders' means (6,) of a servo."""
        axis = -1 if step.turning is None else step.turning.axis
        if self._stand is not None:
            return joints_read(self._stand, encoders, axis)
        angles = step.joints.copy()
        if axis >= 0:
            angles[axis] = 0.0
        return JointAngles(angles, axis)

    def true_at(self, label: str, t: Array) -> Rotation | None:
        """``C_nb`` at times (m,) [s] of a moving stretch; None at rest."""
        if label not in self._all_q_wb:
            return None
        q_wb, first = self._all_q_wb[label], self._begins[label]

        def times(rows: Array) -> Array:
            return (first + 1 + rows) / self._rate

        after = np.ceil(t * self._rate).astype(int) - (first + 1)
        after -= times(after - 1) >= t  # where the product was rounded
        after += times(after) < t
        after = np.clip(after, 1, len(q_wb) - 1)
        rows = np.unique(np.concatenate([after - 1, after]))  # of hours few are asked for
        return C_NW * turned_evenly(times(rows), taken(q_wb, rows), t)

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
        ranges, grains = (inf, inf), None
        instants = self._sampling is Sampling.INSTANT
        if self._imu is not None:
            ranges, grains = stated_of(self._imu, self._rate, self._sampling)
        kept = zip(self._t, self._w, self._f, self._angle, strict=True)
        self._t = self._w = self._f = self._angle = []
        ends = zip(self._steps, self._ranges, self._held, self._q_wb, self._squares, strict=True)
        every = zip(ends, kept, self._encoders, strict=True)
        for (step, (first, last), held, q_wb, squares), columns, encoders in every:
            for array in columns:
                array.flags.writeable = False  # so that the readings need no copies
            t_from = (begins or {}).get(step.label, step.steady_from)
            t_from = None if t_from is None else max(t_from, step.steady_from)
            cut = last if t_from is None else int(np.ceil((t_from - EDGE) * self._rate)) - first
            if t_from is None or cut >= last - first - 1:
                continue
            late = cut > 0
            cut *= held == (first, last)  # what comes with its moves is whole
            t, w, f, angle = (column[cut:] if cut else column for column in columns)
            turn = None if step.turning is None else Turn(step.turning.axis_b, angle)
            told = {"ranges": ranges, "grains": grains, "instants": instants}
            readings = ImuReadings(t, w, f, **told)
            dwells.append(
                Dwell(
                    label=step.label,
                    t_from=t_from,
                    t_to=step.steady_to,
                    readings=readings,
                    nominal=step.C_nb,
                    turn=turn,
                    joints=self._joints(step, encoders),
                )
            )
            C_nb = C_NW * Rotation.from_quat(q_wb)
            attitudes.append(C_nb if turn is None else turn.back(C_nb))
            plain = turn is not None or late
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
