"""Predicted sigma of everything the methods of a procedure estimate, split by its sources."""

from collections.abc import Callable, Sequence
from functools import partial
from math import hypot, sqrt

import numpy as np

from alignment import ESTIMATORS, Method
from alignment.earth import Site
from alignment.errors import AlignmentError
from alignment.gains import Answer, Gains
from alignment.information import Information, InstrumentErrors, Stretch
from alignment.information.circle import Rival, rival
from alignment.information.result import DETERMINED
from alignment.methods.position_gains import known_to
from alignment.strapdown import check_steps
from alignment.units import DEG
from stand.imu.by_value import warmed_by_value
from stand.motion.plan import Plan, PlannedStep
from stand.rehearsal.constants import constants_by
from stand.rehearsal.planned import planned_stretch
from stand.rehearsal.predictions import (
    Parts,
    angles,
    by_gyros,
    rounder,
    unbent,
    uncrossed,
    unmistaken,
    withheld,
)
from stand.rehearsal.refusals import (
    adrift,
    axes_off,
    check_carried,
    check_quiet,
    check_vertical,
    coarse,
    coarse_tilt,
    rival_of,
    rivalled,
    second_order,
    size_of_force,
    unsettled,
    unturned,
)
from stand.rehearsal.response import ReadingErrors, Response, TableTurns
from stand.rehearsal.result import Observability, Prediction
from stand.rehearsal.rocking import (
    CLOCK,
    FOLLOWS,
    at_zero,
    by_clock,
    known,
    late,
    of_instants,
    of_sampling,
    of_the_level_rate,
    over_time,
    readings_of,
    tilt_doubt,
    turned_by_heading,
    turning_round,
    with_ahead,
    with_level_rate_found,
)
from stand.rehearsal.scene import Scene

Predicted = tuple[list[Prediction], list[Observability]]
ROUNDED = 1e-6  # of a sample: a stretch that ends on one has it


def predict(scene: Scene, methods: Sequence[str], observe: bool = True) -> Predicted:
    """All methods' predictions, and, to `observe`, what their readings can tell."""
    predictions: list[Prediction] = []
    observed: list[Observability] = []
    unit = scene.unit
    for method in methods:
        try:
            _check_square(scene)
            if ESTIMATORS[method].design is None:
                _check_cold(scene)
            found, seen = _method(method, scene, unit, observe)
        except AlignmentError as error:
            found, seen = [_refused(method, str(error))], []
        predictions += found
        observed += seen
    return predictions, observed


def _check_square(scene: Scene) -> None:
    """Predictions take like errors of a triad's components for independent: not so if skewed."""
    for name, triad in (("gyros", scene.imu.gyro), ("accelerometers", scene.imu.accel)):
        if triad.axes is not None:
            raise AlignmentError(
                f"no prediction is made: the {name} of {scene.imu.id} are skewed by design; "
                "see --verify"
            )


def _refused(method: str, reason: str, label: str = "") -> Prediction:
    named = {"unit": "deg", "per": DEG, "sigma": None, "contributions": (), "reason": reason}
    return Prediction(method, "", label, "heading", **named)


def _method(name: str, scene: Scene, unit: InstrumentErrors, observe: bool) -> Predicted:
    method = ESTIMATORS[name]
    if method.gains is not None:
        return _by_gains(name, method.gains, scene, unit, observe)
    if method.functional is not None:
        return _over_time(name, method, scene, unit, observe)
    if method.design is not None:
        found, seen = constants_by(name, method, scene)
        return found, [seen]
    raise AlignmentError(f"no prediction is made: {method.no_prediction}; see --verify")


def _check_cold(scene: Scene) -> None:
    """What warmth does by constants that are known by value is in no prediction."""
    if scene.temperature is not None and warmed_by_value(scene.imu):
        raise AlignmentError(
            f"no prediction is made: {scene.imu.id} has temperature terms by value; see --verify"
        )


def _by_gains(
    name: str, gains: Gains, scene: Scene, unit: InstrumentErrors, observe: bool
) -> Predicted:
    """Of a method for rests or steady turns."""
    method = ESTIMATORS[name]
    steps = [s for s in scene.plan.stretches if method.for_motion(turning=s.turning is not None)]
    if not steps:
        raise AlignmentError(method.lacking)
    rocked = [s.label for s in steps if not _still(scene.plan, s)]
    if rocked:
        raise AlignmentError(f"{rocked[0]}: the base rocks behind it, which this method refuses")
    check_quiet(steps, scene, unit, method.takes == "turning")
    stretches = [planned_stretch(step) for step in steps]
    for s in stretches:
        _check_count(s.label, s.span.length, method, scene)
    answers = gains(stretches, scene.site, scene.options)
    if not answers:
        raise AlignmentError("every dwell ends with its offset window: nothing is left to estimate")
    table = TableTurns(steps, stretches, scene)
    errors: dict[int, ReadingErrors] = {}  # answers of one fit share their stretches
    rivals: dict[int, Rival] = {}
    leans: dict[int, str] = {}
    sizes: dict[int, float] = {}
    anomaly = method.anomaly if scene.site.local_gravity is None else 0.0
    for answer in answers:
        if id(answer.stretches) not in errors:
            errors[id(answer.stretches)] = ReadingErrors(answer, table, scene, unit, anomaly)
            rivals[id(answer.stretches)] = rival_of(answer)
            own = errors[id(answer.stretches)]
            leans[id(answer.stretches)] = second_order(answer, own, scene)
            sizes[id(answer.stretches)] = size_of_force(answer, own, anomaly, scene)
    responses = [Response(answer, errors[id(answer.stretches)]) for answer in answers]
    check_vertical([r for r in responses if r.answer.window_gain is not None])
    told_by = partial(_known, stretches=stretches, scene=scene)
    doubt = "" if method.carries_nominal else coarse(scene)
    found: list[Prediction] = []
    for answer, response in zip(answers, responses, strict=True):
        C_nb = answer.stretches[answer.own].C_pb
        why = partial(_why, answer, told_by)
        other, lean = rivals[id(answer.stretches)], leans[id(answer.stretches)]
        why_not, parts = rivalled(other), response.attitude()
        parts = parts if why_not else rounder(parts, other, scene.site)
        told = angles(name, answer.window, answer.label, C_nb, parts, why, response.bias())
        for quantity, unseen in answer.unseen.items():
            told = withheld(told, (quantity,), unseen)
        told = withheld(told, ("heading", "yaw"), doubt or why_not)
        as_heading = by_gyros(parts, C_nb, scene.site) if why_not else ()
        told = withheld(told, as_heading, f"as heading: {why_not}")
        later = answer.window == "fresh" and not method.carries_nominal
        told = withheld(told, ("pitch", "roll"), coarse_tilt(scene) if later else lean)
        told = unbent(told, sizes[id(answer.stretches)], scene.site.gravity)
        found += unmistaken(told, answer.mirrors, C_nb)
        if answer is answers[0]:
            of_heading = withheld(
                response.biases(name), *_with_heading(response, parts, why_not, scene.site)
            )
            by_accel = [b for b in answer.biases if b.startswith("accel")]
            told = withheld(of_heading, by_accel, lean)
            told = unbent(told, sizes[id(answer.stretches)], scene.site.gravity)
            told = unmistaken(told, answer.mirrors, C_nb)
            found += uncrossed(told, parts, answer.mirrors, axes_off(scene))
    return found, [_observed(name, told_by(answers[0]))] if observe else []


def _with_heading(response: Response, parts: Parts, why: str, site: Site) -> tuple[list[str], str]:
    """The biases that go with a heading of which there is no number, and why there is none."""
    sigma = float(np.sqrt(sum(parts.values(), np.zeros((3, 3)))[2, 2]))
    if not why and sigma >= DETERMINED:
        why = f"it goes with heading, whose sigma of {sigma / DEG:.3g} deg is beyond first order"
    biases = response.answer.biases if why else ()
    follows = [
        name
        for name in biases
        if response.share_of_heading(name) > FOLLOWS
        or response.share_of_circle(name, sigma, site) > FOLLOWS
    ]
    return follows, why


def _known(answer: Answer, stretches: Sequence[Stretch], scene: Scene) -> Information:
    """What the whole stretches of an answer tell."""
    used = [stretches[k] for k in dict.fromkeys(answer.planned)]
    return known_to(used, scene.site, scene.options)


def _why(answer: Answer, known: Callable[[Answer], Information]) -> str:
    """What the readings of an answer cannot tell apart."""
    return "; ".join(c.text for c in known(answer).unseen)


def _still(plan: Plan, step: PlannedStep) -> bool:
    """Whether nothing moves behind a stretch but its own axis."""
    k = next(i for i, s in enumerate(plan.steps) if s is step)
    rests = plan.rests[k].copy()
    if step.turning is not None:
        rests[step.turning.axis] = True
    return bool(rests.all())


def _observed(method: str, known: Information) -> Observability:
    return Observability(
        method,
        known.rank,
        known.sought,
        known.condition,
        unseen=tuple(c.text for c in known.unseen),
    )


def _over_time(
    name: str, method: Method, scene: Scene, unit: InstrumentErrors, observe: bool
) -> Predicted:
    """Of a method for any motion, which answers each stretch by itself."""
    found: list[Prediction] = []
    refused: list[AlignmentError] = []
    steps = [s for s in scene.plan.stretches if method.for_motion(turning=s.turning is not None)]
    if not steps:
        raise AlignmentError(method.lacking)
    for step in steps:
        try:
            found += _of_stretch(name, method, scene, unit, step)
        except AlignmentError as error:
            refused.append(error)
            found.append(_refused(name, str(error), step.label))
    if len(refused) == len(steps):
        raise refused[0]
    if not observe:
        return found, []
    told = known_to([planned_stretch(steps[0])], scene.site, scene.options)
    return found, [_observed(name, told)]


def _check_count(label: str, length: float, method: Method, scene: Scene) -> None:
    """Raise where what is used of a stretch, so many seconds, has too few samples."""
    samples, least = int(length * scene.rate_hz + ROUNDED), method.least_samples
    if samples < least:
        raise AlignmentError(f"{label}: {samples} samples, at least {least} are needed")


def _of_stretch(
    name: str, method: Method, scene: Scene, unit: InstrumentErrors, step: PlannedStep
) -> list[Prediction]:
    """Of one stretch, whatever moves in it."""
    assert method.functional is not None
    _check_count(step.label, step.steady_to - step.steady_from, method, scene)
    readings = readings_of(scene.truth(), scene.plan.motion, step.steady_from, step.steady_to)
    try:
        check_steps(float(np.abs(readings.w_ib_b).max()), 1 / scene.rate_hz)
    except AlignmentError as error:
        raise AlignmentError(f"{step.label}: {error}") from None
    run = method.functional(readings, scene.site, scene.options)
    matched = over_time(run.checked_by or run, unit, scene)
    check_carried(step.label, matched)
    errors = of_the_level_rate(run, unit, scene)
    own = over_time(run, unit, scene)
    clocked = by_clock(run, scene)
    if clocked.any():
        own |= {CLOCK: np.outer(clocked, clocked)}
    parts = with_level_rate_found(own, errors, run.lever)
    if not method.tells_mean:
        parts |= late(run, scene) | of_instants(run, step, scene) | of_sampling(step, scene)
    other = turning_round(errors) if run.circle is None else rival(run.circle)
    plumb = scene.site.plumb.as_matrix()  # which all of it is about
    parts = {source: plumb @ P @ plumb.T for source, P in parts.items()}
    parts = rounder(parts, other, scene.site)
    off = known(run, scene)
    C_nb = run.C_nb if step.turning is None else at_zero(run, step, scene)
    first = run.lever is None
    turned = turned_by_heading(parts) if first else parts
    if not method.tells_mean:
        turned = with_ahead(turned, clocked, run, scene)
    told = angles(name, "", step.label, C_nb, turned, str, off)
    why_not = rivalled(other)
    match = run.checked_by
    astray = "" if match is None else unsettled(matched, float(known(match, scene)[2]))
    told = withheld(told, ("heading", "yaw"), why_not or astray)
    if step.turning is not None:
        begun = {} if match is None else matched
        told = withheld(told, ("pitch", "roll"), unturned(turned, begun, float(off[2])))
    elif match is not None:
        steady = hypot(float(off[2]), sqrt(parts["lag"][2, 2]))
        told = withheld(told, ("pitch", "roll"), adrift(steady))
    told = withheld(
        told, by_gyros(parts, C_nb, scene.site) if why_not else (), f"as heading: {why_not}"
    )
    return list(withheld(told, ("pitch", "roll"), tilt_doubt(parts) if first else ""))
