"""How each method turns readings at rest, or in a steady turn, into attitude: its frozen gain.

A method's `Answer` says which coefficients of which `Piece` of the procedure it uses, and the
first-order gain from their errors to the small rotation about n that takes truth to estimate.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise

import numpy as np
from scipy.spatial.transform import Rotation

from alignment import Options, Site
from alignment.arrays import Array
from alignment.errors import AlignmentError
from alignment.information import Information, Setting, Stretch, assumed, information
from alignment.information.model import felt
from alignment.levelling import attitude_sensitivity
from alignment.methods.carousel import SAME_AXIS, carousel_attitude, combined, lag_of
from alignment.methods.harmonics import Harmonics, TurningVector, turning_vector
from alignment.methods.position_fit import ROUNDING, local_vectors
from alignment.methods.positions import ANOMALY, LEAST_TURN
from alignment.methods.single_gyro import single_gyro_sensitivity
from stand.motion.plan import PlannedStep

_RATE_STEP, _FORCE_STEP = 1e-10, 1e-6  # rad/s, m/s^2: of differences; linear to 1e-5 of a gain
_NORTH = Rotation.identity()


@dataclass(frozen=True, slots=True, eq=False)
class Answer:
    """One estimate that a method will give.

    Attributes
    ----------
    window, label : str
        As the estimate's.
    stretches : tuple of Stretch
        Whose coefficients it uses, with the planned steps they belong to.
    steps : tuple of PlannedStep
    own : int
        Which of them holds the attitude that is told.
    gain : (3, m)
        From errors of the coefficients to the rotation about n.
    biases : dict
        Gain (m,) of each bias that is told, by the label of its parameter.
    known : callable
        Gives what the readings tell when the unit is as the method takes it.
    window_gain : (3, m) or None
        To the attitude that the offset's window would tell by itself, of a method that checks its
        vertical.
    """

    window: str
    label: str
    stretches: tuple[Stretch, ...]
    steps: tuple[PlannedStep, ...]
    own: int
    gain: Array
    biases: dict[str, Array]
    known: Callable[[], Information]
    window_gain: Array | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Case:
    """What every method is told: site, options with priors, and whether the latitude is."""

    site: Site
    options: Options


def stretch_of(step: PlannedStep, begin: float, end: float, moved: Array | None = None) -> Stretch:
    """The readings of a step between two times [s]."""
    disturbance = np.zeros(6) if moved is None else moved
    if step.turning is None:
        return Stretch(step.label, begin, end - begin, step.C_nb, disturbance=disturbance)
    turning = step.turning
    axis = turning.axis_b / np.linalg.norm(turning.axis_b)
    angle = start_angle(step)
    return Stretch(
        step.label, begin, end - begin, step.C_nb, turning.rate, axis, angle, disturbance
    )


def start_angle(step: PlannedStep) -> float:
    """Encoder angle [rad] of a turning step where its steady part begins."""
    assert step.turning is not None
    rate, stop = step.turning.rate, float(step.joints[step.turning.axis])
    # a ramp down of limited jerk takes the same angle as half its time at full rate
    ramp = (step.t_to - step.steady_to) if step.t_to > step.steady_to else 0.0
    return stop - rate * (step.steady_to - step.steady_from) - rate * ramp / 2


# --- what is known when the unit is as the method takes it ------------------------------------


def _known(stretches: Sequence[Stretch], case: Case) -> Information:
    priors = case.options.priors
    unit, setting = assumed(priors)
    anomaly = ANOMALY if case.site.local_gravity is None else 0.0
    setting = Setting(placement=setting.placement, mounting=priors.seat, gravity=anomaly)
    rounded = [
        Stretch(s.label, s.start, s.duration, s.C_pb, s.rate, s.axis_b, s.angle, ROUNDING)
        for s in stretches
    ]
    return information(rounded, _NORTH, case.site, unit, setting)


def known_of(steps: Sequence[PlannedStep], case: Case) -> Information:
    """What readings of some steps tell, seen as rests and turns."""
    return _known([_plain(step) for step in steps], case)


def _plain(step: PlannedStep) -> Stretch:
    return stretch_of(step, step.steady_from, step.steady_to)


# --- methods at rest -----------------------------------------------------------------------------


def _level(case: Case) -> Array:
    case.site.horizontal_rate()  # refuses poles
    w = case.site.w_ie_n
    return attitude_sensitivity(w[0], -w[2], case.site.gravity)


def _in_n(G: Array, C_nb: Rotation) -> Array:
    R = C_nb.as_matrix()
    return np.concatenate([G[:, :3] @ R, G[:, 3:] @ R], axis=1)


def triad(steps: Sequence[PlannedStep], case: Case) -> list[Answer]:
    """Each rest by itself: level, and east from the horizontal rate."""
    G = _level(case)
    return [_single(step, _in_n(G, step.C_nb), case) for step in steps]


def single_gyro(steps: Sequence[PlannedStep], case: Case) -> list[Answer]:
    """Each rest by itself, heading from the gyro nearest to east or west."""
    latitude = case.site.known_latitude()
    case.site.horizontal_rate()
    found = []
    for step in steps:
        C = step.C_nb.as_matrix()
        best = int(np.argmax(np.abs(C[1])))
        G = single_gyro_sensitivity(C[:, best], latitude, case.site.gravity)
        found.append(_single(step, _in_n(G, step.C_nb), case))
    return found


def _single(step: PlannedStep, gain: Array, case: Case) -> Answer:
    stretch = _plain(step)
    known = partial(_known, [stretch], case)
    return Answer("", step.label, (stretch,), (step,), 0, gain, {}, known)


def six_position(steps: Sequence[PlannedStep], case: Case) -> list[Answer]:
    """Later samples less the zero offset of the first ones: what is constant cancels."""
    G = _level(case)

    def gain(C_nb: Rotation, first: Stretch, later: Stretch) -> Array:
        return np.concatenate([-_in_n(G, C_nb), _in_n(G, C_nb)], axis=1)

    return [_offset(step, gain, "fresh", case) for step in steps if _fresh(step, case) > 0]


def rk4(steps: Sequence[PlannedStep], case: Case) -> list[Answer]:
    """Gyros less their offset, integrated by any rule from the attitude the table was told."""

    def gain(C_nb: Rotation, first: Stretch, later: Stretch) -> Array:
        turned = np.zeros((3, 6))
        turned[:, :3] = C_nb.as_matrix() * later.duration
        return np.concatenate([-turned, turned], axis=1)

    return [_offset(step, gain, "", case) for step in steps if _fresh(step, case) > 0]


def _fresh(step: PlannedStep, case: Case) -> float:
    return step.steady_to - step.steady_from - case.options.offset_window


def _offset(
    step: PlannedStep,
    gain: Callable[[Rotation, Stretch, Stretch], Array],
    window: str,
    case: Case,
) -> Answer:
    middle = step.steady_from + case.options.offset_window
    first = stretch_of(step, step.steady_from, middle)
    later = stretch_of(step, middle, step.steady_to)
    known = partial(_known, [_plain(step)], case)
    both, told = (first, later), gain(step.C_nb, first, later)
    alone = np.concatenate([_in_n(_level(case), step.C_nb), np.zeros((3, 6))], axis=1)
    return Answer(window, step.label, both, (step, step), 1, told, {}, known, alone)


# --- several positions ---------------------------------------------------------------------------


def two_position(steps: Sequence[PlannedStep], case: Case) -> list[Answer]:
    """Each rest that is followed by one turned by 30 deg or more."""
    pairs = [pair for pair in pairwise(steps) if _turn(*pair) >= LEAST_TURN]
    if not pairs:
        raise AlignmentError("too little turn: no two successive dwells are 30 deg or more apart")
    return [_fitted(pair, case)[0] for pair in pairs]


def multi_position(steps: Sequence[PlannedStep], case: Case) -> list[Answer]:
    """All rests together."""
    widest = max((_turn(a, b) for a in steps for b in steps), default=0.0)
    if widest < LEAST_TURN:
        raise AlignmentError("too little turn: no two dwells are 30 deg or more apart")
    return _fitted(steps, case)


def _turn(a: PlannedStep, b: PlannedStep) -> float:
    return float((a.C_nb.inv() * b.C_nb).magnitude())


def _fitted(steps: Sequence[PlannedStep], case: Case) -> list[Answer]:
    case.site.horizontal_rate()
    stretches = tuple(_plain(step) for step in steps)
    known = _known(stretches, case)
    labels = [p.label for p in known.parameters if p.source.endswith(" bias")]
    biases = {label: known.gain(label) for label in labels if known.determined(label)}
    return [
        Answer("", step.label, stretches, tuple(steps), k, _best(known, k), biases, lambda: known)
        for k, step in enumerate(steps)
    ]


def _best(known: Information, k: int) -> Array:
    """Gain (3, m) of the best estimate of a position's attitude."""
    return np.asarray(known.attitude_rows(k) @ known.root @ known.weights.T)


# --- turning -------------------------------------------------------------------------------------


def carousel(steps: Sequence[PlannedStep], case: Case) -> list[Answer]:
    """Stretches about one axis from one attitude together; differences of the method itself."""
    case.site.horizontal_rate()
    groups: list[list[PlannedStep]] = []
    for step in steps:
        for group in groups:
            if _belongs(group[0], step):
                group.append(step)
                break
        else:
            groups.append([step])
    return [_turned(group, case) for group in groups]


def _belongs(a: PlannedStep, b: PlannedStep) -> bool:
    assert a.turning is not None
    assert b.turning is not None
    apart = np.abs(a.turning.axis_b - b.turning.axis_b).max()
    return bool(apart <= SAME_AXIS) and _turn(a, b) < SAME_AXIS


def _turned(group: Sequence[PlannedStep], case: Case) -> Answer:
    stretches = tuple(_plain(step) for step in group)
    known = partial(_known, stretches, case)
    nominal = np.array([_coefficients(s, case.site) for s in stretches])
    lengths = np.array([s.span.length for s in stretches])
    rates = [s.rate for s in stretches]
    axis = stretches[0].axis_b
    latitude, _ = local_vectors(case.site)
    assert latitude is not None
    priors = case.options.priors

    def attitude(y: Array) -> Array:
        parts = [
            (_vector(c[:, :3], axis, priors.gyro_walk, T), _vector(c[:, 3:], axis, 1.0, T))
            for c, T in zip(y, lengths, strict=True)
        ]
        lag, _ = lag_of([g for g, _ in parts], rates, axis)
        gyros = combined([g for g, _ in parts], rates, axis, lag)
        accels = combined([f for _, f in parts], rates, axis, lag)
        return carousel_attitude(gyros, accels, axis, latitude, priors).C_nb

    gain = np.empty((3, nominal.size))
    for i in range(nominal.size):
        step = _RATE_STEP if i % 6 < 3 else _FORCE_STEP
        y = nominal.copy()
        y.flat[i] += step
        ahead = attitude(y)
        y.flat[i] -= 2 * step
        gain[:, i] = Rotation.from_matrix(ahead @ attitude(y).T).as_rotvec() / (2 * step)
    return Answer("", group[0].label, stretches, tuple(group), 0, gain, {}, known)


def _vector(c: Array, axis: Array, walk: float, length: float) -> TurningVector:
    variance = np.full(3, max(walk, 1e-12) ** 2)
    h = Harmonics(c[0], c[1], c[2], variance, np.diag([1.0, 2.0, 2.0]) / length)
    return turning_vector(h, axis)


def _coefficients(stretch: Stretch, site: Site) -> Array:
    """Constant, cosine and sine (3, 6) of what perfect sensors read."""
    w, f, _, project = felt(stretch, _NORTH, site)
    return np.asarray(project @ np.concatenate([w, f], axis=1))


AT_REST = {
    "six-position": six_position,
    "rk4": rk4,
    "two-sample": rk4,
    "triad": triad,
    "single-gyro": single_gyro,
    "two-position": two_position,
    "multi-position": multi_position,
}
TURNING = {"carousel": carousel}
