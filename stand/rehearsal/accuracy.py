"""Predicted sigma of everything the methods of a procedure estimate, split by its sources."""

from collections.abc import Sequence
from functools import partial

from alignment import ESTIMATORS
from alignment.errors import AlignmentError
from alignment.information import Information, Unit
from alignment.units import DEG
from stand.evaluation.score import TOLD
from stand.motion.plan import Plan, PlannedStep
from stand.rehearsal.gains import AT_REST, TURNING, Answer, Case, known_of
from stand.rehearsal.instrument import unit_of
from stand.rehearsal.refusals import check_carried, check_quiet, check_vertical, coarse
from stand.rehearsal.response import Errors, Response
from stand.rehearsal.result import Observability, Prediction
from stand.rehearsal.rocking import ROCKING, over_time, readings_of, turned_by_heading
from stand.rehearsal.scene import Scene
from stand.rehearsal.telling import angles, withheld


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
    check_quiet(steps, scene, unit, turning)
    answers = answers_of(steps, case)
    if not answers:
        raise AlignmentError("every dwell ends with its offset window: nothing is left to estimate")
    found: list[Prediction] = []
    known: dict[int, Errors] = {}  # answers of one fit share their stretches
    for answer in answers:
        if id(answer.stretches) not in known:
            known[id(answer.stretches)] = Errors(answer, scene, unit)
    responses = [Response(answer, known[id(answer.stretches)]) for answer in answers]
    check_vertical([r for r in responses if r.answer.window_gain is not None])
    for number, (answer, response) in enumerate(zip(answers, responses, strict=True)):
        C_nb = answer.stretches[answer.own].C_pb
        why = partial(_why, answer)
        told = angles(
            method, answer.window, answer.label, C_nb, response.attitude(), why, response.bias()
        )
        found += withheld(told, ("heading", "yaw"), "" if method in TOLD else coarse(scene))
        if number == 0:
            found += response.biases(method)
    return found, [_observed(method, answers[0].known())]


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


def _rocking(method: str, scene: Scene, unit: Unit) -> tuple[list[Prediction], list[Observability]]:
    truth = scene.truth()
    found: list[Prediction] = []
    steps = scene.plan.stretches
    if not steps:
        raise AlignmentError("no stretch to estimate from")
    for step in steps:
        readings = readings_of(truth, scene.plan.motion, step.steady_from, step.steady_to)
        match = ROCKING["inertial"](readings, scene.site, scene.options)
        check_carried(step.label, over_time(match, unit, scene))
        carried = ROCKING[method]
        run = match if method == "inertial" else carried(readings, scene.site, scene.options)
        parts = turned_by_heading(over_time(run, unit, scene))
        found += angles(method, "", step.label, run.C_nb, parts, str)
    return found, [_observed(method, known_of(steps[:1], Case(scene.site, scene.options)))]
