"""How answers of methods at rest and in steady turns respond to errors of unit and table."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from scipy.linalg import block_diag
from scipy.spatial.transform import Rotation

from alignment.arrays import Array, IntArray
from alignment.earth import Site
from alignment.gains import Answer
from alignment.information import InstrumentErrors, Setting, Stretch, information
from alignment.information.circle import by_north_rate, curvature
from alignment.information.model import NODES, coefficient_weights, sensor_inputs
from stand.imu.by_value import values_in_order
from stand.imu.instrument import lags_of
from stand.motion.plan import PlannedStep
from stand.rehearsal.following import left_off
from stand.rehearsal.predictions import Parts, name_of, prediction
from stand.rehearsal.result import Prediction
from stand.rehearsal.scene import Scene
from stand.rehearsal.warmth import warmed
from stand.simulation.collector import ticks_of
from stand.table.leanings import leanings

SENSORS = ("gyro", "accelerometer")
_NORTH = Rotation.identity()


class TableTurns:
    """How the table's l errors turn b in the stretches of a plan, whichever answers are of them.

    `sources`, `sigmas` (l,) of those drawn, values (l,) of those `known`; `poses`, of each stretch:
    turns (l, k, 3) at the angles at which its readings are looked at; `judged` (s, 3, l): where
    its attitude is judged, at its end, of a turning one taken back to encoder angle zero.
    """

    def __init__(
        self, steps: Sequence[PlannedStep], stretches: Sequence[Stretch], scene: Scene
    ) -> None:
        counts = [NODES if stretch.rate else 1 for stretch in stretches]
        poses = [_poses(step, count) for step, count in zip(steps, counts, strict=True)]
        ends = np.array([ticks_of(step, scene.rate_hz)[1] for step in steps]) / scene.rate_hz
        last = scene.plan.motion.joints(ends)[0]
        rounds = [_round_axes(step, count) for step, count in zip(steps, counts, strict=True)]
        off = [left_off(scene, step) for step in steps]
        found = leanings(
            scene.stated,
            scene.model,
            np.concatenate([*poses, last]),
            np.concatenate([*rounds, np.full(len(steps), -1)]),
            np.concatenate([np.repeat(off, counts, axis=0), off]),
        )
        edges = np.cumsum([0, *counts])
        turns = np.array([one.turns for one in found])
        turns = turns.reshape(len(found), edges[-1] + len(steps), 3)
        self.sources = tuple(one.source for one in found)
        self.sigmas = np.array([one.sigma for one in found])
        self.known = np.array([one.known for one in found])
        self.poses = [turns[:, a:b] for a, b in pairwise(edges)]
        self.judged = np.array(
            [
                _taken_back(step, stretch.axis_b, joints) @ there.T
                for step, stretch, joints, there in zip(
                    steps, stretches, last, turns[:, edges[-1] :].swapaxes(0, 1), strict=True
                )
            ]
        )


class ReadingErrors:
    """What errors of unit and table do to the coefficients of some stretches.

    `true` has the unit's, and `J` (m, p) what they do. Of the table's l errors: `sources`, `sigmas`
    (l,) of those drawn, values (l,) of those `known`, `readings` (m, l), and the turn (s, 3, l) in
    b that each gives the attitude of every stretch where it is judged: at its end, of a turning one
    taken back to encoder angle zero. `noises` by name: covariances (m, m) of the coefficients.
    `by_value` (p,): what is known of the unit's.
    `gravity` [m/s^2]: how far it may be off what the method takes it for.

    Coefficients are of rounded readings: a coarse step hides what moves the truth within it.
    """

    def __init__(
        self,
        answer: Answer,
        table: "TableTurns",
        scene: Scene,
        unit: InstrumentErrors,
        gravity: float = 0.0,
    ) -> None:
        stretches = answer.stretches
        # what comes late is a noise of its own: accelerometers are not as late as gyros
        self.true = information(
            stretches,
            _NORTH,
            scene.site,
            replace(unit, lag=0.0),
            Setting(attitude=0.0, gravity=gravity),
        )
        seen = [sensor_inputs(s, _NORTH, scene.site) for s in stretches]
        self.sources, self.sigmas, self.known = table.sources, table.sigmas, table.known
        by_value, attitude = values_in_order(scene.imu), 3
        self.by_value = np.zeros(len(self.true.parameters))
        self.by_value[attitude : attitude + len(by_value)] = by_value
        readings = []
        for k, stretch, (w, f, _, project) in zip(answer.planned, stretches, seen, strict=True):
            d = table.poses[k]
            rate = np.cross(w, d) + stretch.rate * _slope(d)
            coefficients = project @ np.concatenate([rate, np.cross(f, d)], axis=2)
            readings.append(coefficients.reshape(len(d), 6 * len(project)))
        self.readings = np.concatenate(readings, axis=1).T
        self.turns = table.judged[list(answer.planned)]
        self.noises = dict(zip(self.true.noise_names, self.true.noises, strict=True))
        perfect = [p @ np.concatenate([w, f], axis=1) for w, f, _, p in seen]
        for sensor, own in zip(SENSORS, warmed(stretches, perfect, scene), strict=True):
            self.noises[f"{sensor} temperature"] = own
        self.noises["lag"] = _late(stretches, seen, scene)
        slopes, rounded = self._rounded(seen, scene)
        self.J, self.readings = slopes @ self.true.J, slopes @ self.readings
        self.noises = {name: slopes @ N @ slopes.T for name, N in self.noises.items()} | rounded

    def _rounded(
        self, seen: Sequence[tuple[Array, ...]], scene: Scene
    ) -> tuple[Array, dict[str, Array]]:
        """What rounded coefficients make of true ones (m, m); covariances of what else it does."""
        doubt = self._doubt()
        slopes = np.eye(len(doubt))
        nodes = np.concatenate([np.concatenate([w, f], axis=1) for w, f, *_ in seen])
        project: Array = np.asarray(block_diag(*(p for *_, p in seen)))
        waves: Array = np.asarray(block_diag(*(_waves(p) for *_, p in seen)))
        spans = zip(self.true.stretches, seen, strict=True)
        fresh: Array = np.asarray(block_diag(*(_fresh(s, len(w), scene) for s, (w, *_) in spans)))
        weights = [coefficient_weights(s) / s.span.length**2 for s in self.true.stretches]
        ends = np.diag(np.concatenate(weights)) * 2
        found = {}
        for k, one in enumerate(scene.roundings):
            total = np.zeros_like(doubt)
            for channel in range(3 * k, 3 * k + 3):
                own = slice(channel, None, 6)
                left = one.left(nodes[:, channel], waves @ doubt[own, own] @ waves.T)
                slopes[own, own] = project @ (left.slope[:, None] * waves)
                total[own, own] = project @ left.moments @ project.T + np.diag(fresh @ left.fresh)
                total[own, own] += ends * one.end**2
            found[f"{SENSORS[k]} rounding"] = total
        return slopes, found

    def _doubt(self) -> Array:
        """Covariance (m, m) of what the coefficients really are, about what is planned."""
        stated = np.where(np.isfinite(self.true.prior), self.true.prior, 0.0)
        roots = np.concatenate([self.true.J * stated, self.readings * self.sigmas], axis=1)
        drifts = [
            self.noises[f"{s} {d}"]
            for s in SENSORS
            for d in ("bias-instability", "random-walk", "temperature")
        ]
        return np.asarray(roots @ roots.T + np.sum(drifts, axis=0) + self.noises["lag"])


class Response:
    """How one answer responds to every error of unit and table."""

    def __init__(self, answer: Answer, errors: ReadingErrors) -> None:
        self.answer, self.true, self.errors = answer, errors.true, errors

    def attitude(self) -> Parts:
        """Covariances of the rotation about n by source."""
        own = self.answer.own
        C = self.answer.stretches[own].C_pb.as_matrix()
        judged = C @ self.errors.turns[own]
        return self._parts(self.answer.gain, self.true.attitude_rows(own), judged)

    def bias(self) -> Array:
        """Rotation (3,) about n of the estimate by what is known of table and unit [rad]."""
        own = self.answer.own
        C = self.answer.stretches[own].C_pb.as_matrix()
        left = self.answer.gain @ self.errors.readings - C @ self.errors.turns[own]
        by_unit = self.answer.gain @ self.errors.J @ self.errors.by_value
        return np.asarray(left @ self.errors.known + by_unit)

    def known_tilt(self) -> Array:
        """Tilt (2,) [rad] of the offset's window by itself, by known errors of table and unit."""
        assert self.answer.window_gain is not None
        readings = self.errors.readings @ self.errors.known + self.errors.J @ self.errors.by_value
        return np.asarray(self.answer.window_gain[:2] @ readings)

    def feigned_tilt(self) -> Array:
        """Tilts (2, p) [rad] of the offset's window by itself, per sigma of the unit's errors."""
        assert self.answer.window_gain is not None
        prior = self.true.prior
        stated = np.where(np.isfinite(prior), prior, 0.0)
        return np.asarray(self.answer.window_gain[:2] @ self.errors.J * stated)

    def share_of_circle(self, label: str, sigma: float, site: Site) -> float:
        """Part (0 to 1) of a bias's variance that first order leaves out of a heading's error.

        A heading off by h, of `sigma` [rad], leaves ``1 - cos h`` of the horizontal Earth rate to
        the north in the readings: a bias to the fit, which knows the size of that rate.
        """
        round_ = float(self.answer.biases[label] @ by_north_rate(self.true, site)) ** 2
        round_ *= curvature(sigma)
        P = self._of_heading_and(label)[1, 1]
        return round_ / (round_ + P) if round_ else 0.0

    def share_of_heading(self, label: str) -> float:
        """Part (0 to 1) of a bias's variance that goes with the error of heading."""
        P = self._of_heading_and(label)
        return float(P[0, 1] ** 2 / (P[0, 0] * P[1, 1])) if P.diagonal().all() else 0.0

    def _of_heading_and(self, label: str) -> Array:
        """Covariance (2, 2) of the errors of heading and of a bias."""
        own, gain = self.answer.own, self.answer.biases[label]
        labels = [p.label for p in self.true.parameters]
        C = self.answer.stretches[own].C_pb.as_matrix()
        judged = C @ self.errors.turns[own]
        parts = self._parts(
            np.stack([self.answer.gain[2], gain]),
            np.stack([self.true.attitude_rows(own)[2], np.eye(len(labels))[labels.index(label)]]),
            np.stack([judged[2], np.zeros_like(judged[2])]),
        )
        return np.asarray(sum(parts.values(), np.zeros((2, 2))))

    def biases(self, method: str) -> Iterator[Prediction]:
        """Sigmas of the biases that are told."""
        parameters = {p.label: p for p in self.true.parameters}
        labels = list(parameters)
        for label, gain in self.answer.biases.items():
            p = parameters[label]
            own = labels.index(label)
            row = np.eye(len(labels))[own][None]
            parts = self._parts(gain[None], row, np.zeros((1, len(self.errors.sigmas))))
            sizes = {name: float(np.sqrt(max(P[0, 0], 0.0))) for name, P in parts.items()}
            by_table = self.errors.readings @ self.errors.known
            by_unit = self.errors.J @ self.errors.by_value
            bias = float(gain @ (by_table + by_unit)) - float(self.errors.by_value[own])
            yield prediction(method, "", "all", label, (p.unit, p.per), sizes, np.inf, str, bias)

    def _parts(self, gain: Array, row: Array, judged: Array) -> Parts:
        """Covariances (k, k) of ``gain coefficients - row errors``, less `judged` (k, l)."""
        parts: Parts = {}

        def add(source: str, P: Array) -> None:
            name = name_of(source)
            parts[name] = parts.get(name, 0.0) + P

        for name, N in self.errors.noises.items():
            add(name, gain @ N @ gain.T)
        prior = self.true.prior
        left = (gain @ self.errors.J - row) * np.where(np.isfinite(prior), prior, 0.0)
        table = (gain @ self.errors.readings - judged) * self.errors.sigmas
        both = np.concatenate([left, table], axis=1)
        columns: dict[str, list[int]] = {}
        sources = (*(p.source for p in self.true.parameters), *self.errors.sources)
        for k in np.flatnonzero(both.any(axis=0)).tolist():
            columns.setdefault(sources[k], []).append(k)
        for source, own in columns.items():
            add(source, both[:, own] @ both[:, own].T)
        return parts


def _late(stretches: Sequence[Stretch], seen: Sequence[tuple[Array, ...]], scene: Scene) -> Array:
    """Covariance (m, m) of the coefficients of readings that come late, by a lag and by a clock
    that runs fast: as if each turn had begun by so much later."""
    lag, later = lags_of(scene.imu)
    slow, fast = [], []
    for stretch, (w, f, _, project) in zip(stretches, seen, strict=True):
        of_gyros, of_accels = (stretch.rate * np.cross(stretch.axis_b, x) for x in (w, f))
        middle = stretch.start + stretch.span.length / 2
        slow.append(project @ np.concatenate([lag * of_gyros, (lag + later) * of_accels], axis=1))
        fast.append(middle * (project @ np.concatenate([of_gyros, of_accels], axis=1)))
    found = [np.concatenate([c.ravel() for c in one]) for one in (slow, fast)]
    found[1] *= scene.imu.clock.offset
    return np.asarray(sum(np.outer(v, v) for v in found))


def _waves(project: Array) -> Array:
    """Values (k, h) of 1, cosine and sine at the k angles that `project` (h, k) looks at."""
    h, k = project.shape
    return project.T * k / np.array([1.0, 2.0, 2.0])[:h]


def _fresh(stretch: Stretch, nodes: int, scene: Scene) -> Array:
    """Variances of the coefficients (h, k) by those of one sample at each of k nodes."""
    samples = stretch.span.length * scene.rate_hz
    return np.repeat(coefficient_weights(stretch)[:, None] / (nodes * samples), nodes, axis=1)


def _taken_back(step: PlannedStep, axis_b: Array, joints: Array) -> Array:
    """What a turn (3,) of b at joint angles (6,) is of b at encoder angle zero: (3, 3)."""
    if step.turning is None:
        return np.eye(3)
    return Rotation.from_rotvec(joints[step.turning.axis] * axis_b).as_matrix()


def _poses(step: PlannedStep, count: int) -> Array:
    """Joint angles (count, 6) at which a stretch is looked at: encoder 0 on, evenly round."""
    joints = np.tile(step.joints, (count, 1))
    if step.turning is not None:
        joints[:, step.turning.axis] = 2 * np.pi * np.arange(count) / count
    return joints


def _round_axes(step: PlannedStep, count: int) -> IntArray:
    """The axis (count,) that goes round in a stretch, -1 at rest."""
    return np.full(count, -1 if step.turning is None else step.turning.axis)


def _slope(d: Array) -> Array:
    """Derivative (l, k, 3) by the angle of what goes round with it, by Fourier."""
    k = d.shape[1]
    if k == 1:
        return np.zeros_like(d)
    orders = np.fft.rfftfreq(k, 1 / k)
    orders[-1] = 0.0  # the highest has no sign
    return np.fft.irfft(1j * orders[:, None] * np.fft.rfft(d, axis=1), k, axis=1)
