"""Predicted sigma of everything the methods of a procedure estimate, split by its sources."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import sqrt

import numpy as np
from scipy.linalg import block_diag
from scipy.spatial.transform import Rotation
from scipy.special import chdtrc

from alignment import ESTIMATORS, Options, Site
from alignment.angles import Sequence as Order
from alignment.angles import (
    SequenceRule,
    angle_jacobian,
    angles_from_C_nb,
    near_singular,
)
from alignment.arrays import Array
from alignment.errors import AlignmentError
from alignment.information import GaussMarkov, Information, Setting, Unit, information
from alignment.information.model import BY_AXIS, coefficient_weights, felt
from alignment.information.result import DETERMINED
from alignment.noise import REST_BLOCK, REST_RATE, REST_TILT
from alignment.static import WRONG_POSITION
from alignment.units import DEG
from stand.imu import ImuSpec
from stand.imu.recursion import Recursion
from stand.physics.description import StandModel
from stand.physics.truth import Truth
from stand.plan import Plan, PlannedStep
from stand.rehearsal.gains import AT_REST, TURNING, Answer, Case, known_of
from stand.rehearsal.instrument import leanings, roundings_of, unit_of
from stand.rehearsal.requirement import TOLD
from stand.rehearsal.result import Contribution, Observability, Prediction
from stand.rehearsal.rocking import ROCKING, Functional, readings_of
from stand.table import Table

_NORTH = Rotation.identity()
# root mean square scale error by rounding, above which heading is none of first order: fits that
# know the size of Earth rate are 20 % worse at 0.18 (and it goes with the square)
STEEPEST = 0.07
TURNED = 0.2
UNITS, MOSTLY = 1000, 0.5  # of which a method must answer for the other half
SENSORS = ("gyro", "accelerometer")
_ANGLES = ("roll", "yaw", "pitch")
# how sources of `alignment.information` and of this package are told
_NAMES = {
    "bias": "turn-on bias",
    "noise": "white noise",
    "bias-instability": "bias instability",
    "random-walk": "random walk",
    "misalignment": "case misalignment",
}


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """What is rehearsed: plan, stand, table, unit, site and what the estimators are told.

    `truth` makes the perfect sensors of a motion, for methods on rocking bases. `settled` tells
    how long each dwell waits for the servo [s], by label.
    """

    plan: Plan
    model: StandModel
    table: Table
    imu: ImuSpec
    site: Site
    options: Options
    rate_hz: int
    truth: Callable[[], Truth]


Parts = dict[str, Array]  # covariance (3, 3) about n [rad^2] by source


def predict(scene: Scene, methods: Sequence[str]) -> tuple[list[Prediction], list[Observability]]:
    """All methods' predictions, and what their readings can tell."""
    predictions: list[Prediction] = []
    observed: list[Observability] = []
    unit = unit_of(scene.imu)
    case = Case(scene.site, scene.options)
    for method in methods:
        try:
            found, seen = _method(method, scene, unit, case)
        except AlignmentError as error:
            found, seen = [_refused(method, str(error))], []
        predictions += found
        observed += seen
    return predictions, observed


def _refused(method: str, reason: str) -> Prediction:
    return Prediction(method, "", "", "heading", "deg", DEG, None, (), reason)


def _method(
    method: str, scene: Scene, unit: Unit, case: Case
) -> tuple[list[Prediction], list[Observability]]:
    turning = ESTIMATORS[method].takes == "turning"
    if method in ROCKING:
        return _rocking(method, scene, unit)
    answers_of = (AT_REST | TURNING).get(method)
    if answers_of is None:
        raise AlignmentError("no prediction is made for this method: see --verify")
    steps = [s for s in scene.plan.stretches if (s.turning is not None) == turning]
    if not steps:
        raise AlignmentError(f"no stretch {'at constant rate' if turning else 'at rest'}")
    rocked = [s.label for s in steps if not _still(scene.plan, s)]
    if rocked:
        raise AlignmentError(f"{rocked[0]}: the base rocks behind it, which this method refuses")
    _check_quiet(steps, scene, unit, turning)
    answers = answers_of(steps, case)
    if not answers:
        raise AlignmentError("every dwell ends with its offset window: nothing is left to estimate")
    found: list[Prediction] = []
    known: dict[int, _Errors] = {}  # answers of one fit share their stretches
    for answer in answers:
        if id(answer.stretches) not in known:
            known[id(answer.stretches)] = _Errors(answer, scene, unit)
    responses = [_Response(answer, known[id(answer.stretches)]) for answer in answers]
    _check_vertical([r for r in responses if r.answer.window_gain is not None])
    for number, (answer, response) in enumerate(zip(answers, responses, strict=True)):
        C_nb = answer.stretches[answer.own].C_pb
        why = partial(_why, answer)
        angles = _angles(method, answer.window, answer.label, C_nb, response.attitude(), why)
        found += _withheld(angles, ("heading", "yaw"), "" if method in TOLD else _coarse(scene))
        if number == 0:
            found += response.biases(method)
    return found, [_observed(method, answers[0].known())]


def _check_quiet(steps: Sequence[PlannedStep], scene: Scene, unit: Unit, turning: bool) -> None:
    """Raise where a method that checks for rest would mostly take the unit's noise for motion.

    It looks at means of `REST_BLOCK`: at rates of three axes (two across a turn's axis), and at
    the tilt of the force. Of m normal numbers of variance one the sum of squares is above x in
    ``chdtrc(m, x)`` of the cases; drifts within a stretch are left out.
    """
    blocks = sum(step.steady_to - step.steady_from for step in steps) / REST_BLOCK
    gyro, accel = (
        np.hypot(np.max(triad.noise), one.noise / sqrt(scene.rate_hz)) / sqrt(REST_BLOCK)
        for triad, one in zip(
            (unit.gyro, unit.accel), roundings_of(scene.imu, scene.rate_hz), strict=True
        )
    )
    moved = 0.0
    for sigma, limit, axes in (
        (gyro, REST_RATE, 2 if turning else 3),
        (accel / scene.site.gravity, REST_TILT, 2),
    ):
        if sigma > 0:
            moved += blocks * float(chdtrc(axes, (limit / sigma) ** 2))
    if -np.expm1(-moved) > MOSTLY:
        raise AlignmentError(
            f"would take noise for motion: means of {REST_BLOCK:g} s scatter by "
            f"{gyro / DEG:.2g} deg/s and {accel / scene.site.gravity / DEG:.2g} deg of tilt (1 "
            f"sigma), and {REST_RATE / DEG:g} deg/s and {REST_TILT / DEG:g} deg are allowed"
        )


def _check_vertical(responses: Sequence["_Response"]) -> None:
    """Raise where a method that checks the vertical of each position would refuse most units.

    One unit goes through all positions: `UNITS` of them are drawn, always the same ones.
    """
    if not responses:
        return
    drawn = np.random.default_rng(0).standard_normal((UNITS, len(responses[0].true.parameters)))
    tilts = np.array([np.linalg.norm(drawn @ r.feigned_tilt().T, axis=1) for r in responses])
    refused = np.mean(np.max(tilts, axis=0) > WRONG_POSITION)
    if refused > MOSTLY:
        raise AlignmentError(
            f"would refuse {100 * refused:.0f} % of such units: accelerometers' errors tilt the "
            f"vertical by {np.sqrt(np.mean(tilts**2) / 2) / DEG:.2g} deg (1 sigma), and "
            f"{WRONG_POSITION / DEG:.0f} deg are taken for another position"
        )


def _why(answer: Answer) -> str:
    """What the readings of an answer cannot tell apart."""
    return "; ".join(c.text for c in answer.known().unseen)


def _still(plan: Plan, step: PlannedStep) -> bool:
    """Whether nothing moves behind a stretch but its own axis."""
    k = next(i for i, s in enumerate(plan.steps) if s is step)
    rests = plan.rests[k].copy()
    if step.turning is not None:
        rests[step.turning.axis] = True
    return bool(rests.all())


def _observed(method: str, known: Information) -> Observability:
    return Observability(
        method, known.rank, known.sought, known.condition, tuple(c.text for c in known.unseen)
    )


# --- from covariances about n to angles ----------------------------------------------------------


def _angles(
    method: str, window: str, label: str, C_nb: Rotation, parts: Parts, why: Callable[[], str]
) -> Iterator[Prediction]:
    """Heading (or the yaw of a vertical X1), pitch and roll."""
    for quantity, j in _rows(C_nb).items():
        sizes = {name: float(np.sqrt(max(j @ P @ j, 0.0))) for name, P in parts.items()}
        yield _told(method, window, label, quantity, ("deg", DEG), sizes, DETERMINED, why)


def _rows(C_nb: Rotation) -> dict[str, Array]:
    """What each angle (3,) is of a small rotation about n."""
    order = SequenceRule.REGULAR.sequence_for(C_nb.inv().apply([0.0, 0.0, -1.0]))
    rows: dict[str, Array] = dict(
        zip(_ANGLES, angle_jacobian(order, *angles_from_C_nb(order, C_nb)), strict=True)
    )
    level = angles_from_C_nb(Order.YAW_PITCH_ROLL, C_nb)
    if not near_singular(Order.YAW_PITCH_ROLL, level):
        rows["heading"] = -angle_jacobian(Order.YAW_PITCH_ROLL, *level)[1]
        del rows["yaw"]
    return {name: rows[name] for name in ("heading", "yaw", "pitch", "roll") if name in rows}


def _told(
    method: str,
    window: str,
    label: str,
    quantity: str,
    unit: tuple[str, float],
    sizes: dict[str, float],
    limit: float,
    why: Callable[[], str],
) -> Prediction:
    total = float(np.linalg.norm(list(sizes.values())))
    if not total < limit:
        reason = f"sigma of {total / unit[1]:.3g} {unit[0]} is beyond first order"
        reason = "; ".join(part for part in (f"not determined: {reason}", why()) if part)
        return Prediction(method, window, label, quantity, *unit, None, (), reason)
    named = sorted(sizes.items(), key=lambda item: -item[1])
    contributions = tuple(Contribution(name, s) for name, s in named if s > 1e-6 * total)
    return Prediction(method, window, label, quantity, *unit, total, contributions)


def _withheld(
    found: Iterable[Prediction], quantities: Sequence[str], reason: str
) -> Iterator[Prediction]:
    """The predictions, without a number for these quantities if there is a reason."""
    for p in found:
        if reason and p.determined and p.quantity in quantities:
            p = replace(p, sigma=None, contributions=(), reason=f"not determined: {reason}")
        yield p


def _name(source: str) -> str:
    sensor, _, rest = source.partition(" ")
    return f"{sensor} {_NAMES.get(rest, rest)}" if rest else source


# --- methods at rest and in steady turns ---------------------------------------------------------


class _Errors:
    """What errors of unit and table do to the coefficients of some stretches.

    `true` has the unit's. Of the table's l errors: `sources`, `sigmas` (l,), `readings` (m, l),
    and the turn (s, 3, l) in b that each gives the attitude of every stretch where it is judged:
    at its end, of a turning one taken back to encoder angle zero. `noises` by name: covariances
    (m, m) of the coefficients.
    """

    def __init__(self, answer: Answer, scene: Scene, unit: Unit) -> None:
        stretches, steps = answer.stretches, answer.steps
        self.true = information(stretches, _NORTH, scene.site, unit, Setting(attitude=0.0))
        seen = [felt(s, _NORTH, scene.site) for s in stretches]
        poses = [_poses(step, len(w)) for step, (w, *_) in zip(steps, seen, strict=True)]
        poses.append(np.array([step.joints for step in steps]))
        found = leanings(scene.table, scene.model, np.concatenate(poses))
        edges = np.cumsum([0, *(len(p) for p in poses)])
        self.sources = tuple(one.source for one in found)
        self.sigmas = np.array([one.sigma for one in found])
        turns = np.array([one.turns for one in found]).reshape(len(found), edges[-1], 3)
        readings = []
        for k, (stretch, (w, f, _, project)) in enumerate(zip(stretches, seen, strict=True)):
            d = turns[:, edges[k] : edges[k + 1]]
            rate = np.cross(w, d) + stretch.rate * _slope(d)
            coefficients = project @ np.concatenate([rate, np.cross(f, d)], axis=2)
            readings.append(coefficients.reshape(len(found), 6 * len(project)))
        self.readings = np.concatenate(readings, axis=1).T
        self.turns = np.array(
            [
                _taken_back(step, stretch.axis_b) @ turns[:, edges[-2] + k].T
                for k, (step, stretch) in enumerate(zip(steps, stretches, strict=True))
            ]
        )
        self.noises = dict(zip(self.true.noise_names, self.true.noises, strict=True))
        self.noises |= self._rounded(seen, scene)

    def _rounded(self, seen: Sequence[tuple[Array, ...]], scene: Scene) -> dict[str, Array]:
        """Covariances (m, m) of the coefficients by rounding of each triad's samples."""
        doubt = self._doubt()
        nodes = np.concatenate([np.concatenate([w, f], axis=1) for w, f, *_ in seen])
        project: Array = np.asarray(block_diag(*(p for *_, p in seen)))
        told: Array = np.asarray(block_diag(*(_waves(p) for *_, p in seen)))
        anew = np.concatenate(
            [coefficient_weights(s) / (s.span.length * scene.rate_hz) for s in self.true.stretches]
        )
        found = {}
        for k, one in enumerate(roundings_of(scene.imu, scene.rate_hz)):
            total = np.zeros_like(doubt)
            for channel in range(3 * k, 3 * k + 3):
                x, own = nodes[:, channel], slice(channel, None, 6)
                known = told @ doubt[own, own] @ told.T
                size = known.diagonal()
                s2 = np.maximum(size[:, None] + size - 2 * known, 0.0)
                left = one.shared(x[:, None] - x, np.sqrt(s2))
                total[own, own] = project @ left @ project.T + np.diag(anew) * one.noise**2
            found[f"{SENSORS[k]} rounding"] = total
        return found

    def _doubt(self) -> Array:
        """Covariance (m, m) of what the coefficients really are, about what is planned."""
        stated = np.where(np.isfinite(self.true.prior), self.true.prior, 0.0)
        roots = np.concatenate([self.true.J * stated, self.readings * self.sigmas], axis=1)
        drifts = [
            self.noises[f"{s} {d}"] for s in SENSORS for d in ("bias-instability", "random-walk")
        ]
        return np.asarray(roots @ roots.T + np.sum(drifts, axis=0))


def _waves(project: Array) -> Array:
    """Values (k, h) of 1, cosine and sine at the k angles that `project` (h, k) looks at."""
    h, k = project.shape
    return project.T * k / np.array([1.0, 2.0, 2.0])[:h]


def _coarse(scene: Scene) -> str:
    """Why rounding forbids a number for a heading from Earth rate; '' where it does not."""
    gyro, _ = roundings_of(scene.imu, scene.rate_hz)
    if gyro.steepness <= STEEPEST:
        return ""
    return (
        f"rates are rounded to {gyro.step / DEG:.3g} deg/s, which the noise of a sample, "
        f"{gyro.dither / DEG:.2g} deg/s at {scene.rate_hz} Hz, does not blur: how much of Earth "
        "rate is read depends on where in a step the bias lies"
    )


class _Response:
    """How one answer responds to every error of unit and table."""

    def __init__(self, answer: Answer, errors: _Errors) -> None:
        self.answer, self.true, self.errors = answer, errors.true, errors

    def attitude(self) -> Parts:
        """Covariances of the rotation about n by source."""
        own = self.answer.own
        C = self.answer.stretches[own].C_pb.as_matrix()
        judged = C @ self.errors.turns[own]
        return self._parts(self.answer.gain, self.true.attitude_rows(own), judged)

    def feigned_tilt(self) -> Array:
        """Tilts (2, p) [rad] of the offset's window by itself, per sigma of the unit's errors."""
        assert self.answer.window_gain is not None
        prior = self.true.prior
        stated = np.where(np.isfinite(prior), prior, 0.0)
        return np.asarray(self.answer.window_gain[:2] @ self.true.J * stated)

    def biases(self, method: str) -> Iterator[Prediction]:
        """Sigmas of the biases that are told."""
        parameters = {p.label: p for p in self.true.parameters}
        labels = list(parameters)
        for label, gain in self.answer.biases.items():
            p = parameters[label]
            row = np.eye(len(labels))[labels.index(label)][None]
            parts = self._parts(gain[None], row, np.zeros((1, len(self.errors.sigmas))))
            sizes = {name: float(np.sqrt(max(P[0, 0], 0.0))) for name, P in parts.items()}
            yield _told(method, "", "all", label, (p.unit, p.per), sizes, np.inf, str)

    def _parts(self, gain: Array, row: Array, judged: Array) -> Parts:
        """Covariances (k, k) of ``gain coefficients - row errors``, less `judged` (k, l)."""
        parts: Parts = {}

        def add(source: str, P: Array) -> None:
            name = _name(source)
            parts[name] = parts.get(name, 0.0) + P

        for name, N in self.errors.noises.items():
            add(name, gain @ N @ gain.T)
        prior = self.true.prior
        left = (gain @ self.true.J - row) * np.where(np.isfinite(prior), prior, 0.0)
        table = (gain @ self.errors.readings - judged) * self.errors.sigmas
        sources = (*(p.source for p in self.true.parameters), *self.errors.sources)
        for source, v in zip(sources, np.concatenate([left, table], axis=1).T, strict=True):
            if v.any():
                add(source, np.outer(v, v))
        return parts


def _taken_back(step: PlannedStep, axis_b: Array) -> Array:
    """What a turn (3,) of b at a step's end is of b at encoder angle zero: (3, 3)."""
    if step.turning is None:
        return np.eye(3)
    return Rotation.from_rotvec(step.joints[step.turning.axis] * axis_b).as_matrix()


def _poses(step: PlannedStep, count: int) -> Array:
    """Joint angles (count, 6) at which a stretch is looked at: encoder 0 on, evenly round."""
    joints = np.tile(step.joints, (count, 1))
    if step.turning is not None:
        joints[:, step.turning.axis] = 2 * np.pi * np.arange(count) / count
    return joints


def _slope(d: Array) -> Array:
    """Derivative (l, k, 3) by the angle of what goes round with it, by Fourier."""
    k = d.shape[1]
    if k == 1:
        return np.zeros_like(d)
    orders = np.fft.rfftfreq(k, 1 / k)
    orders[-1] = 0.0  # the highest has no sign
    return np.fft.irfft(1j * orders[:, None] * np.fft.rfft(d, axis=1), k, axis=1)


# --- rocking bases -------------------------------------------------------------------------------


def _rocking(method: str, scene: Scene, unit: Unit) -> tuple[list[Prediction], list[Observability]]:
    truth = scene.truth()
    found: list[Prediction] = []
    steps = scene.plan.stretches
    if not steps:
        raise AlignmentError("no stretch to estimate from")
    for step in steps:
        readings = readings_of(truth, scene.plan.motion, step.steady_from, step.steady_to)
        run = ROCKING[method](readings, scene.site, scene.options)
        parts = _over_time(run, unit, _steps(scene))
        angles = list(_angles(method, "", step.label, run.C_nb, parts, str))
        turned, reason = _turned_along(run.C_nb, parts)
        found += _withheld(angles, turned, reason)
    return found, [_observed(method, known_of(steps[:1], Case(scene.site, scene.options)))]


def _turned_along(C_nb: Rotation, parts: Parts) -> tuple[list[str], str]:
    """Quantities that an error of heading makes other than first order says, and why.

    To first order the gyros' errors tilt the carried attitude by t about n. Found together with an
    error h of heading, that tilt is one about axes turned by h: ``cos(h) t + sin(h) (0, 0, 1) x t``
    (what accelerometers make of tilt stays in b, whatever the heading). An angle of variance s^2,
    of which gyros make G^2, becomes ``s^2 - <h^2> (G^2 - A^2)`` with their A^2 in the tilt across
    it: less than 2 % of s off where h G and h A are below `TURNED` of it.
    """
    gyros = sum((P for name, P in parts.items() if name.startswith("gyro")), np.zeros((3, 3)))
    total = sum(parts.values(), np.zeros((3, 3)))
    h = sqrt(total[2, 2])
    found = []
    for quantity, j in _rows(C_nb).items():
        across = np.cross(j, [0.0, 0.0, 1.0])
        most = max(across @ gyros @ across, j @ gyros @ j if quantity in ("pitch", "roll") else 0.0)
        if h * sqrt(most) > TURNED * sqrt(j @ total @ j):
            found.append(quantity)
    return found, (
        f"an error of heading, whose sigma is {h / DEG:.3g} deg, turns the tilt that the gyros "
        "make: beyond first order"
    )


def _steps(scene: Scene) -> tuple[float, float]:
    """White noise of gyros and accelerometers [u/sqrt(Hz)] by rounding: a rocking base carries
    readings over many steps, so each sample's is anew."""
    gyro, accel = roundings_of(scene.imu, scene.rate_hz)
    return gyro.step / sqrt(12 * scene.rate_hz), accel.step / sqrt(12 * scene.rate_hz)


def _over_time(run: Functional, unit: Unit, rounding: tuple[float, float]) -> Parts:
    spans = np.diff(run.t)
    middle = (run.t[1:] + run.t[:-1]) / 2
    parts: Parts = {}
    force = run.force
    for name, triad, gain, x, step in (
        ("gyro", unit.gyro, run.gyro, run.rate, rounding[0]),
        ("accelerometer", unit.accel, run.accel, force, rounding[1]),
    ):
        each = gain / np.sqrt(spans)[:, None, None]
        for source, size in (("white noise", triad.noise), ("rounding", step)):
            white = each * np.asarray(size)
            parts[f"{name} {source}"] = np.einsum("mij,mkj->ik", white, white)
        parts[f"{name} bias instability"] = _drifted(gain, middle, triad.drift)
        if triad.random_walk:
            parts[f"{name} random walk"] = _walked(gain, middle, triad.random_walk)
        for field, columns_of in BY_AXIS.items():
            sigma = np.asarray(getattr(triad, field))
            if not sigma.any():
                continue
            by_time = middle[:, None, None] * np.eye(3)
            columns = by_time if field == "ramp" else columns_of(x, force)
            J = np.einsum("mij,mjk->ik", gain, columns) * np.repeat(sigma, columns.shape[-1] // 3)
            parts[_name(f"{name} {field.replace('_', '-').replace('g2', 'g^2')}")] = J @ J.T
    parts["motion"] = run.motion
    return parts


def _drifted(gain: Array, t: Array, processes: tuple[GaussMarkov, ...]) -> Array:
    """Covariance (3, 3) by stationary drifts at even times (m,), alike and apart on each axis."""
    P: Array = np.einsum("mij,mkj->ik", gain, gain) * sum(p.sigma**2 for p in processes)
    for process in processes:
        keep = np.exp(-np.median(np.diff(t)) / process.time)
        memory = Recursion([1.0], [1.0, -keep])
        memory.settle(np.zeros(9), np.zeros(9))
        # what the process's memory carries into each block from those before it
        carried = memory.apply(gain.reshape(-1, 9).T).T.reshape(gain.shape) - gain
        both = np.einsum("mij,mkj->ik", carried, gain)
        P = P + process.sigma**2 * (both + both.T)
    return P


def _walked(gain: Array, t: Array, size: float) -> Array:
    after = np.cumsum(gain[::-1], axis=0)[::-1]
    steps = np.diff(t, prepend=0.0)
    return size**2 * np.einsum("m,mij,mkj->ik", steps, after, after)
