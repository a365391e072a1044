"""Predicted sigmas of a unit's constants, by a method that finds those and no attitude."""

from dataclasses import replace
from itertools import pairwise

import numpy as np

from alignment import Method, Options
from alignment.arrays import Array, IntArray
from alignment.calibration import terms
from alignment.calibration.bench import SENSORS, USUAL, Bench, Leanings, freed
from alignment.calibration.design import Design, term_source
from alignment.calibration.model import Model
from alignment.calibration.observe import LARGEST_STEP, MARGIN, PART
from alignment.calibration.session import Move, Session, Station
from alignment.calibration.terms import TRIAD_AXES
from alignment.calibration.words import UNSEEN, untold
from alignment.errors import AlignmentError
from alignment.information import InstrumentErrors, TriadErrors
from alignment.readings import BoolArray, ImuReadings
from alignment.units import ARC_SECOND
from stand.calibration.units import AXES, name_of, unit_of
from stand.imu.instrument import unit_of as unit_errors
from stand.motion.plan import PlannedStep
from stand.rehearsal.planned import planned_stretch
from stand.rehearsal.predictions import prediction
from stand.rehearsal.result import Observability, Prediction
from stand.rehearsal.scene import Scene
from stand.samples import Sampling
from stand.table.leanings import leanings

PAIRS = ("Y1-Z1", "Z1-X1", "X1-Y1")
ALL = "all"  # stretches together
ASSUMED = ("lag", "lever_arm")  # terms that a calibration allows for and no sheet draws
MOVE_RATE_HZ = 50.0  # of the truth that a move is carried by
QUIET = 1e-2  # of a sheet's noise: what is left is of table, seat and gravity
GUESSED = 0.5  # part of a variance: with more by assumed sizes there is no number
# rad/rt-s; with less the quadrature of the moves would tell the seat from the triads' own axes
LEAST_NOISE = 3e-7


def constants_by(name: str, method: Method, scene: Scene) -> tuple[list[Prediction], Observability]:
    """Sigmas of every constant with what they are made of, and what cannot be told."""
    assert method.design is not None
    steps = scene.plan.stretches
    if not steps:
        raise AlignmentError(method.lacking)
    moved = [s.label for s in steps if not _steady(scene, s)]
    if moved:
        raise AlignmentError(f"{moved[0]}: the base moves behind it, which this method refuses")
    session = planned_session(scene)
    design = method.design(session, scene.site, scene.options)
    found = _predictions(name, design, scene)
    return found, _observed(name, session, scene)


def _steady(scene: Scene, step: PlannedStep) -> bool:
    """Whether nothing moves behind a stretch but its own axis."""
    k = next(i for i, s in enumerate(scene.plan.steps) if s is step)
    rests = scene.plan.rests[k].copy()
    if step.turning is not None:
        rests[step.turning.axis] = True
    return bool(rests.all())


# --- what is planned -----------------------------------------------------------------------------


def planned_session(scene: Scene) -> Session:
    """Stations and moves as the method will get them, with perfect readings of the moves.

    Moves that are too quick for gyros or samples are left out, as the method does.
    """
    steps = sorted(scene.plan.stretches, key=lambda step: step.steady_from)
    stations = planned_stations(scene)
    moves = [
        _planned_move(k, one, other, scene)
        for k, (one, other) in enumerate(pairwise(steps))
        if one.turning is None or other.turning is None
    ]
    fastest = min(scene.imu.gyro.range, LARGEST_STEP * scene.rate_hz)
    within = tuple(m for m in moves if np.abs(m.readings.w_ib_b).max() <= fastest)
    return Session(stations, within, 1 / scene.rate_hz)


def planned_stations(scene: Scene) -> tuple[Station, ...]:
    """Rests and steady turns as the method will get them, in time."""
    steps = sorted(scene.plan.stretches, key=lambda step: step.steady_from)
    return tuple(_station(step, scene) for step in steps)


def _station(step: PlannedStep, scene: Scene) -> Station:
    joints, axis = np.array(step.joints), -1
    if step.turning is not None:
        axis = step.turning.axis
        joints[axis] = 0.0
    warmth = float(np.mean(_warmth(scene, np.linspace(step.steady_from, step.steady_to, 50))))
    return Station(planned_stretch(step), joints, axis, warmth)


def _planned_move(k: int, one: PlannedStep, other: PlannedStep, scene: Scene) -> Move:
    t_from, t_to = one.steady_to - _reach(one), other.steady_from + _reach(other)
    rate = min(MOVE_RATE_HZ, scene.rate_hz)
    edges = np.linspace(t_from, t_to, max(5, round((t_to - t_from) * rate) + 1))
    sampling = scene.settings.sampling
    instants = sampling is Sampling.INSTANT
    true = scene.truth().over(scene.plan.motion, edges, sampling)
    joints, *_ = scene.plan.motion.joints(np.array([t_from, t_to]))
    return Move(
        label=f"{one.label} to {other.label}",
        first=k,
        last=k + 1,
        readings=ImuReadings(edges[1:], true.w_ib_b, true.f_b, instants=instants),
        angle_from=0.0 if one.turning is None else float(joints[0, one.turning.axis]),
        angle_to=0.0 if other.turning is None else float(joints[1, other.turning.axis]),
        warmth=_warmth(scene, edges[1:]),
    )


def _warmth(scene: Scene, t: Array) -> Array:
    """Above the reference temperature (n,) [K] at times (n,) [s]."""
    if scene.temperature is None:
        return np.zeros(len(t))
    return np.asarray(scene.temperature.at(t) - scene.imu.reference_temperature)


def _reach(step: PlannedStep) -> float:
    return min(MARGIN, PART * (step.steady_to - step.steady_from))


# --- what is predicted ---------------------------------------------------------------------------


def _predictions(name: str, design: Design, scene: Scene) -> list[Prediction]:
    present = np.isin(np.arange(terms.COUNT), design.active)
    outside = terms.outside(present)
    derived, angles = derived_rows(present)
    rows = np.zeros((len(outside.keys) + len(derived), design.model.count))
    rows[:, : terms.COUNT] = np.concatenate([outside.matrix, angles])
    rows = rows[:, design.active]
    parts = design.contributions(rows)
    biases = rows @ design.gain @ _by_known_errors(design, scene)
    guessed = assumed_sources(scene)
    of_guesses = [parts[name] for name in guessed & parts.keys()]
    assumed = np.linalg.norm([np.zeros(len(rows)), *of_guesses], axis=0)
    found = []
    told = [(name_of(key), unit_of(key)) for key in outside.keys]
    told += [(one, ("arcsec", ARC_SECOND)) for one in derived]
    for k, (quantity, unit) in enumerate(told):
        sizes = {source: float(sigma[k]) for source, sigma in parts.items()}
        one = _one(name, quantity, unit, sizes, float(biases[k]))
        one = replace(one, assumed=float(assumed[k]))
        own = {design.source(int(at)) for at in design.active[rows[k] != 0]}
        found.append(_untold(one) if own & guessed else one)
    return found


def assumed_sources(scene: Scene) -> set[str]:
    """Terms, as a budget names them, whose sizes nobody states: looked for all the same."""
    bench, sheet = scene.options.bench, Bench(unit=unit_errors(scene.imu))
    assert isinstance(bench, Bench)
    by_value = {(key.sensor, key.term) for key, *_ in bench.known}
    found = {
        term_source(sensor, term)
        for term in USUAL
        for sensor in SENSORS
        if np.any((bench.sheet(sensor, term) > 0) & (sheet.sheet(sensor, term) == 0))
        and (sensor, TRIAD_AXES[0] if term in TRIAD_AXES else term) not in by_value
    }
    return found | {term_source(t.sensor, t.name) for t in terms.UNIT if t.name in ASSUMED}


def _untold(p: Prediction) -> Prediction:
    """The same, without a number where more of it is of an assumed size than of the readings."""
    assert p.sigma is not None
    if p.assumed**2 <= GUESSED * p.sigma**2:
        return p
    reason = (
        "not determined: no sheet states its size, and the readings hardly tell it (of "
        f"{p.sigma / p.per:.3g} {p.unit}, {p.assumed / p.per:.3g} are by the size assumed)"
    )
    return replace(
        p, sigma=None, bias=0.0, contributions=(), reason=reason, beyond=p.sigma, assumed=0.0
    )


def derived_rows(present: BoolArray) -> tuple[list[str], Array]:
    """Names and rows (k, COUNT) of the angles that the misalignments come to."""
    names, rows = [], []
    for sensor in SENSORS:
        lean = terms.columns_of(sensor, "non_orthogonality")
        if present[lean].any():
            names += [f"{sensor} non-orthogonality {pair}" for pair in PAIRS]
            rows.append(np.eye(terms.COUNT)[lean])
    gyro, accel = (terms.columns_of(sensor, "misalignment") for sensor in SENSORS)
    if present[gyro].any() and present[accel].any():
        names += [f"gyro to accel {axis}" for axis in AXES]
        rows.append(np.eye(terms.COUNT)[gyro] - np.eye(terms.COUNT)[accel])
    return names, np.concatenate([np.zeros((0, terms.COUNT)), *rows])


def _one(
    name: str, quantity: str, unit: tuple[str, float], sizes: dict[str, float], bias: float
) -> Prediction:
    return prediction(name, "", ALL, quantity, unit, sizes, np.inf, str, bias)


def _by_known_errors(design: Design, scene: Scene) -> Array:
    """What the table's errors that the procedure sets add to the readings (m,)."""
    stated = scene.stated
    pose = np.zeros((1, len(scene.inertias)))
    if not any(one.known for one in leanings(stated, scene.model, pose)):
        return np.zeros(len(design.J))

    def known(joints: Array, going_round: IntArray) -> Leanings:
        own = [one for one in leanings(stated, scene.model, joints, going_round) if one.known]
        turns = np.array([one.turns * one.known for one in own])
        names = tuple(one.name for one in own)
        nothing = np.zeros((len(joints), 3, 0))
        return Leanings(names, np.ones(len(own)), np.moveaxis(turns, 0, 2), nothing)

    model = design.model
    told = Model(model.sessions, replace(model.bench, table=known), model.site)
    columns = told.columns_of_table(0)
    return told.jacobian()[:, columns].sum(axis=1)


# --- what cannot be told -------------------------------------------------------------------------


def _observed(name: str, session: Session, scene: Scene) -> Observability:
    """Of all terms that there are, those too that the sheet does not state."""
    bench = scene.options.bench
    assert isinstance(bench, Bench)
    design = Design(Model([session], freed(bench, list(USUAL)), scene.site))
    own = np.flatnonzero(design.active < terms.COUNT)
    scale = design.sigmas[own]
    left = np.linalg.eigvalsh(design.covariance[np.ix_(own, own)] / np.outer(scale, scale))
    seen = left[left < 1 - UNSEEN]
    condition = float((1 / seen[0] - 1) / (1 / seen[-1] - 1)) if len(seen) else np.inf
    return Observability(name, len(seen), len(own), condition, unseen=untold(design))


def floors(method: Method, scene: Scene) -> dict[str, float]:
    """Sigmas [SI] of the constants by a unit without noise or drift: of table, seat and gravity."""
    assert method.design is not None
    bench = scene.options.bench
    assert isinstance(bench, Bench)
    unit = InstrumentErrors(_quiet(bench.unit.gyro), _quiet(bench.unit.accel), bench.unit.lag)
    quiet = replace(bench, unit=unit, steps=np.zeros(2), joint_noise=np.zeros(0))
    options: Options = replace(scene.options, bench=quiet)
    found = _predictions("", method.design(planned_session(scene), scene.site, options), scene)
    return {p.quantity: p.sigma for p in found if p.sigma is not None}


def _quiet(triad: TriadErrors) -> TriadErrors:
    stated = np.asarray(triad.noise)
    noise = np.minimum(stated, np.maximum(QUIET * stated, LEAST_NOISE))
    return replace(triad, noise=noise, drift=(), random_walk=0.0, ramp=0.0)  # pyright: ignore
