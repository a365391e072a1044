"""Truth: what perfect sensors at the instrument's point feel, evaluated by MuJoCo.

Exact to rounding: the motion is prescribed, not simulated (`stand.physics.hinges`).

Earth: ``w_ib_b = w_nb_b + C_bn w_ie_n`` and ``f_b = a + 2 w_ie x v - g``; gravity includes the
centrifugal term and is uniform over the stand (its gradient is 3e-7 g per metre). Earth rate
enters as the model's magnetic field, so that a magnetometer reads ``C_bn w_ie_n``.

Motions are of the encoders. The axes of a real table turn by the curves of its errors, exactly by
the chain rule, and an axis that wobbles has two small hinges across it, prescribed as well.
"""

# mujoco fills its namespace from C, unseen by pyright.
# pyright: reportAttributeAccessIssue=false

import copy
from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from itertools import pairwise
from typing import Any

import mujoco
import numpy as np
from mujoco.batch import Batch

from alignment.arrays import Array, IntArray
from alignment.cross import cross
from alignment.earth import Site
from stand.motion.polynomial import Motion
from stand.physics.hinges import Chain, Common, Hinges, JointState, chain_of
from stand.physics.panels import Curves, Panels
from stand.physics.quadrature import Law
from stand.samples import Sampling, Sensed, TruthBlock
from stand.table.joints import JOINTS
from stand.table.table_errors import PERFECT, TableErrors

NANOSECOND = 1_000_000_000
MANY = 200  # pieces, from which on fewer hinges are worth a model of their own, which takes 1.5 ms
_REST, _MOVING, _ALONE = range(3)  # kinds of samples: once for all, by panels, each for itself


@dataclass(frozen=True, slots=True, eq=False)
class Instants:
    """Sensors at n times: `w_ib_b`, `f_b` (n, 3), `q_wb` (n, 4; x, y, z, w).

    `f_places` (n, 3): each component of specific force where its own accelerometer sits.
    `joints`, `joint_rates` (n, 6): where the axes are and how fast, in radians.
    """

    w_ib_b: Array
    f_b: Array
    q_wb: Array
    f_places: Array
    joints: Array
    joint_rates: Array


@dataclass(frozen=True, slots=True, eq=False)
class Samples(Instants):
    """Means or instants over n intervals, `q_wb` at their ends.

    The axes too are where they are at the ends. `w_other`, `f_other` (n, 3), where they were asked
    for: rates and forces at the places, of means at their ends, of instants the means over the
    intervals. `encoders`, `encoder_rates` (n, 6): what the drives have at the ends.
    """

    encoders: Array
    encoder_rates: Array
    w_other: Array | None = None
    f_other: Array | None = None

    def given(self) -> dict[str, Array]:
        """The arrays there are, by their names."""
        named = ((field.name, getattr(self, field.name)) for field in fields(self))
        return {name: values for name, values in named if values is not None}

    def locked(self) -> "Samples":
        """Itself, given away, so that nobody copies it."""
        for values in self.given().values():
            base: Any = values
            while isinstance(base, np.ndarray):
                base.flags.writeable, base = False, base.base
        return self

    def sensed(self, t_ns: IntArray) -> Sensed:
        """What the sensors feel, with these stamps."""
        return Sensed(t_ns, self.w_ib_b, self.f_places, self.w_other, f_other=self.f_other)


class Truth:
    """Evaluates perfect sensors at prescribed joint motions.

    One instance per thread: it reuses one batch of states, and another of those hinges
    alone that a motion moves, which take half the work where three axes of six sway.

    Parameters
    ----------
    model : MjModel
        As `stand.physics.hinges.chain_of`.
    site : Site
        ``latitude`` needed.
    places : (3, 3) or None
        Where the X1, Y1, Z1 accelerometers sit, in b [m]; None (or zeros) for the point itself.
    errors : TableErrors or None
        Curves and wobble of the axes. What is wrong with the geometry is in `model` already, by
        `stand.physics.geometry.with_errors`.
    threads : int
        Of MuJoCo; the results are the same bits.
    data : MjData or None
        As of `chain_of`.
    both : bool
        Whether samples tell what is felt on the mean and at their ends: a unit without a low-pass
        does not ask.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        site: Site,
        places: Array | None = None,
        errors: TableErrors | None = None,
        threads: int = 1,
        data: mujoco.MjData | None = None,
        both: bool = True,
    ) -> None:
        self._both = both
        self._places = places if places is not None and places.any() else None
        self._common, self._data = Common(site, self._places, threads), data
        self._take(model, PERFECT if errors is None else errors)
        self._all = Hinges(self._chain, np.arange(len(JOINTS)), self._common)
        self._some: Hinges | None = None

    def _take(self, model: mujoco.MjModel, errors: TableErrors) -> None:
        self._errors, self._perfect = errors, errors.perfect
        self._chain = chain_of(model, errors, self._data)
        self._law: Law | None = None  # of the motion met last
        self._moving: Hinges | None = None  # that it moves

    def beside(self, motion: Motion) -> "Truth":
        """Another one for another thread, which shares what is known of a motion."""
        self._law_of(motion)
        other = copy.copy(self)
        other._all = Hinges(self._chain, self._all.axes, self._common)
        other._some = other._moving = None
        return other

    @property
    def batch(self) -> Batch:
        """Of all hinges."""
        return self._all.batch

    def change(self, model: mujoco.MjModel, errors: TableErrors) -> None:
        """Be that of another table from now on, with the bits of a new one and less work.

        `model` and `errors` as at first.
        """
        self._take(model, errors)
        self._all = self._made(self._all, self._chain, self._all.axes)

    def _made(self, before: Hinges | None, chain: Chain, axes: IntArray) -> Hinges:
        if before is None or before.names != chain.names:
            return Hinges(chain, axes, self._common)
        before.take(chain)
        return before

    def _moving_in(self, motion: Motion) -> Hinges:
        """The hinges that a motion moves; all, of one of few pieces, and of a window of a motion,
        which has other windows."""
        law = self._law_of(motion)
        if self._moving is None:
            axes = law.moving
            few = motion.whole and 0 < len(axes) < len(JOINTS) and law.distinct > MANY
            self._moving = self._moved_alone(motion, axes) if few else self._all
        return self._moving

    def _moved_alone(self, motion: Motion, axes: IntArray) -> Hinges:
        """Hinges of these axes, the others where the motion begins."""
        q = motion.joints(motion.knots[:1])[0]
        encoders = q, np.zeros_like(q), np.zeros_like(q)
        angles, _, _ = self._all.states(self._errors, self._errors.realised(*encoders), encoders)
        chain = self._chain.of(axes, angles[0])
        self._some = self._made(self._some, chain, axes)
        return self._some

    def instants(self, joints: Array, rates: Array, accelerations: Array) -> Instants:
        """Sensors at the encoders' angles, rates and accelerations, (n, 6) each, in radians.

        Raises
        ------
        ValueError
            A value that is not finite (MuJoCo itself would not say so).
        """
        return self._instants((joints, rates, accelerations), self._all)

    def _instants(self, encoders: JointState, hinges: Hinges) -> Instants:
        """As `instants`, where only these hinges move."""
        if not np.isfinite(sum(values.sum() for values in encoders)):
            raise _not_finite(*encoders)
        true = self._errors.realised(*encoders)
        raw = hinges.sensed(*hinges.states(self._errors, true, encoders))
        earth, velocity = raw[:, 9:12], raw[:, 6:9]
        f_b = raw[:, 0:3] + 2 * cross(earth, velocity)
        f_places = f_b if self._places is None else self._at_places(raw)
        return Instants(
            raw[:, 3:6] + earth,
            f_b,
            raw[:, [13, 14, 15, 12]],
            f_places,
            joints=true[0],
            joint_rates=true[1],
        )

    def _at_places(self, raw: Array) -> Array:
        """Component i of the force at place i, its own Coriolis term included."""
        assert self._places is not None
        rate, velocity, earth = raw[:, 3:6], raw[:, 6:9], raw[:, 9:12]
        force = np.empty((len(raw), 3))
        for i, place in enumerate(self._places):
            there = velocity + cross(rate, np.broadcast_to(place, rate.shape))
            force[:, i] = raw[:, 16 + 4 * i] + 2 * cross(earth, there)[:, i]
        return force

    def blocks(
        self, motion: Motion, rate_hz: int, sampling: Sampling, block_s: float = 1.0
    ) -> Iterator[TruthBlock]:
        """Samples 1, 2, ... of a motion, sample k at time k / `rate_hz`, in blocks.

        Sample times come from integers, so the result does not depend on the block's length.
        Stretches at rest are evaluated once.
        """
        total = sample_count(motion.duration, rate_hz)
        step = max(1, round(block_s * rate_hz))
        for first in range(0, total, step):
            yield self.block(motion, rate_hz, sampling, first, min(first + step, total))

    def block(
        self, motion: Motion, rate_hz: int, sampling: Sampling, first: int, last: int
    ) -> TruthBlock:
        """Samples `first` + 1 to `last` (that is, those that end in (first, last] / rate)."""
        return self.block_and_sensed(motion, rate_hz, sampling, first, last)[0]

    def block_and_sensed(
        self, motion: Motion, rate_hz: int, sampling: Sampling, first: int, last: int
    ) -> tuple[TruthBlock, Sensed]:
        """As `block`, and what sensors at their places feel if their clock is right."""
        ticks = np.arange(first, last + 1)
        over = self.over(motion, ticks / rate_hz, sampling, rate_hz)
        stamps = stamps_ns(ticks[1:], rate_hz)
        sensed = over.sensed(stamps)
        if self._perfect:
            return TruthBlock(
                stamps,
                over.w_ib_b,
                over.f_b,
                over.q_wb,
                joints=over.joints,
                joint_rates=over.joint_rates,
            ), sensed
        true = TruthBlock(
            stamps,
            over.w_ib_b,
            over.f_b,
            over.q_wb,
            joints=over.joints,
            joint_rates=over.joint_rates,
            encoders=self._errors.readings(over.encoders),
            encoder_rates=over.encoder_rates,
        )
        return true, sensed

    def sensed(
        self,
        motion: Motion,
        edges: Array,
        t_ns: IntArray,
        sampling: Sampling,
        rate_hz: float = 0.0,
    ) -> Sensed:
        """What the sensors feel, each at its place, over intervals of any lengths.

        `edges` (n + 1,) [s] bound the intervals; `t_ns` (n,) are the stamps they will carry;
        `rate_hz` as of `over`.
        """
        return self.over(motion, edges, sampling, rate_hz).sensed(t_ns)

    def over(
        self, motion: Motion, edges: Array, sampling: Sampling, rate_hz: float = 0.0
    ) -> Samples:
        """Samples over the n intervals between `edges` (n + 1,) [s].

        Before its start and after its end the motion is held: a window of a longer motion must
        cover the intervals. `rate_hz`: how many there are a second, of instants, which are looked
        at one by one where they are few (0: everywhere).
        """
        kinds = np.where(rest_of(motion, edges), _REST, _MOVING)
        if sampling is Sampling.INSTANT:
            few = self._law_of(motion).fewer_than_panels(edges[1:], rate_hz)
            kinds[(kinds == _MOVING) & few] = _ALONE
        parts = [
            self._part(motion, edges[start : stop + 1], kind, sampling)
            for start, stop, kind in runs(kinds)
        ]
        found = parts[0]
        if len(parts) > 1:
            every = [part.given() for part in parts]
            found = Samples(**{n: np.concatenate([one[n] for one in every]) for n in every[0]})
        return found.locked()

    def _part(self, motion: Motion, edges: Array, kind: int, sampling: Sampling) -> Samples:
        """Samples of one kind."""
        if kind == _REST:
            one, n = self.held(motion, edges[-1:]), len(edges) - 1
            return Samples(**{name: _repeated(row, n) for name, row in one.given().items()})
        if kind == _ALONE:
            return self._alone(motion, edges)
        if sampling is Sampling.INSTANT:
            return self._instants_between(motion, edges)
        return self.means(motion, edges)

    def held(self, motion: Motion, t: Array) -> Samples:
        """Samples, a row for each of the times (n,) [s], at which the motion stands still."""
        q = motion.joints(t)[0]
        still = np.zeros_like(q)
        return self._sampled((q, still, still), self._all)

    def _alone(self, motion: Motion, edges: Array) -> Samples:
        """Instants at `edges` but the first, evaluated there."""
        at = self._sampled(motion.joints(edges[1:]), self._moving_in(motion))
        if not self._both:
            return at
        means = self.means(motion, edges)
        return replace(at, w_other=means.w_ib_b, f_other=means.f_places)

    def _sampled(self, encoders: JointState, hinges: Hinges) -> Samples:
        at = self._instants(encoders, hinges)
        return Samples(
            at.w_ib_b,
            at.f_b,
            at.q_wb,
            at.f_places,
            joints=at.joints,
            joint_rates=at.joint_rates,
            encoders=encoders[0],
            encoder_rates=encoders[1],
            w_other=at.w_ib_b if self._both else None,
            f_other=at.f_places if self._both else None,
        )

    def means(self, motion: Motion, edges: Array) -> Samples:
        """Means over the n intervals between `edges` (n + 1,) [s].

        Notes
        -----
        What is felt between two knots of the motion are polynomials through few instants, as many
        as `stand.physics.quadrature` says: within `FORCE_ERROR` and `RATE_ERROR`, whatever the
        motion and the rate of the samples. Each piece is for itself, so that its neighbours leave
        no trace; a sample that straddles a knot is the sum of its parts.
        """
        panels, edges = self._law_of(motion).panels(edges)
        curves = self._curves(motion, panels)
        cuts = panels.cut(edges)
        felt = cuts.means(curves.part(slice(self._felt)))
        ends = cuts.ends(curves if self._both else curves.part(slice(self._felt, None)))
        at_ends, beyond = (ends[: self._felt], ends[self._felt :]) if self._both else (None, ends)
        return self._samples(motion, edges, felt, beyond, at_ends)

    def _instants_between(self, motion: Motion, edges: Array) -> Samples:
        """Instants at `edges` but the first."""
        panels, at = self._law_of(motion).panels(edges)
        cuts, curves = panels.cut(at), self._curves(motion, panels)
        ends = cuts.ends(curves)
        means = cuts.means(curves.part(slice(self._felt))) if self._both else None
        return self._samples(motion, edges, ends[: self._felt], ends[self._felt :], means)

    @property
    def _felt(self) -> int:
        """How many curves are felt: w, f at the point, and f at the places if they are others."""
        return 6 if self._places is None else 9

    def _curves(self, motion: Motion, panels: Panels) -> Curves:
        """Curves of what is felt, of the attitude, and of what true angles and rates of the axes
        that move have beyond the encoders'."""
        nodes, again = panels.nodes, None
        if self._law_of(motion).repeats:  # what was seen once is not looked at again
            nodes, again = np.unique(nodes, return_inverse=True)
        q, v, a = motion.joints(nodes)
        at = self._instants((q, v, a), self._moving_in(motion))
        seen = [at.w_ib_b, at.f_b, *((at.f_places,) if self._felt > 6 else ()), at.q_wb]
        if not self._perfect:
            axes = self._law_of(motion).moving
            seen += [(at.joints - q)[:, axes], (at.joint_rates - v)[:, axes]]
        columns = np.ascontiguousarray(np.hstack(seen).T)
        return panels.curves(columns, again)

    def _samples(
        self, motion: Motion, edges: Array, felt: Array, beyond: Array, other: Array | None
    ) -> Samples:
        """From curves' values (c, n) as felt; of attitude and axes at the ends; and of what is felt
        there, or of instants on the mean."""
        q, v = motion.angles_and_rates(edges[1:])
        places = slice(self._felt - 3, None)
        turned = beyond[:4]
        joints, joint_rates = self._true_axes(motion, q, v, beyond[4:])
        return Samples(
            felt[:3].T,
            felt[3:6].T,
            (turned / np.sqrt((turned * turned).sum(axis=0))).T,
            felt[places].T,
            joints=joints,
            joint_rates=joint_rates,
            encoders=q,
            encoder_rates=v,
            w_other=None if other is None else other[:3].T,
            f_other=None if other is None else other[places].T,
        )

    def _true_axes(self, motion: Motion, q: Array, v: Array, beyond: Array) -> tuple[Array, Array]:
        """True angles and rates (n, 6) from the encoders' and what those that move have beyond."""
        if self._perfect:
            return q, v
        axes = self._law_of(motion).moving
        still = np.zeros((1, len(JOINTS)))
        one = q[:1] + (self._errors.realised(q[:1], still, still)[0] - q[:1])
        joints, rates = np.repeat(one.T, len(q), axis=1), v.T.copy()
        joints[axes] = q.T[axes] + beyond[: len(axes)]
        rates[axes] += beyond[len(axes) :]
        return joints.T, rates.T

    def _law_of(self, motion: Motion) -> Law:
        if self._law is None or self._law.motion is not motion:
            self._law, self._moving = Law(motion, self._errors.waves), None
        return self._law


def _repeated(row: Array, n: int) -> Array:
    """A row (1, k) that stands for n, and takes the memory of one."""
    own = row.copy()
    own.flags.writeable = False
    return np.broadcast_to(own, (n, row.shape[1]))


def _not_finite(joints: Array, rates: Array, accelerations: Array) -> ValueError:
    for name, values in (("q", joints), ("q'", rates), ("q''", accelerations)):
        if not np.isfinite(values).all():
            row, axis = np.argwhere(~np.isfinite(values))[0]
            return ValueError(f"{name} of joint {JOINTS[axis]}: not finite at row {row}")
    return ValueError("joint motion: too large")


def rest_of(motion: Motion, edges: Array) -> np.ndarray:
    """Whether the motion stands still over each of the n intervals of `edges` (n + 1,)."""
    last = len(motion.knots) - 2
    first, end = np.clip(np.searchsorted(motion.knots, edges[[0, -2]], side="right") - 1, 0, last)
    moving = np.any(motion.coefficients[:-1, first : end + 1], axis=0).any(axis=1)
    if moving.all():
        return np.zeros(len(edges) - 1, bool)
    piece = np.clip(np.searchsorted(motion.knots, edges[:-1], side="right") - 1, 0, last)
    resting = np.logical_not(moving)[piece - first]
    return resting & (edges[1:] <= motion.knots[piece + 1])


def runs(flags: np.ndarray) -> list[tuple[int, int, int]]:
    """Stretches (start, stop, flag) of equal flags."""
    cuts = np.flatnonzero(np.diff(flags)) + 1
    bounds = [0, *(int(c) for c in cuts), len(flags)]
    return [(a, b, int(flags[a])) for a, b in pairwise(bounds) if b > a]


def sample_count(duration: float, rate_hz: int) -> int:
    """Number of whole sample intervals in `duration` seconds."""
    return int(np.floor(duration * rate_hz + 1e-6))


def stamps_ns(ticks: np.ndarray, rate_hz: int) -> IntArray:
    """Times of samples in whole nanoseconds, from their numbers: no error builds up."""
    return (ticks.astype(np.int64) * NANOSECOND + rate_hz // 2) // rate_hz
