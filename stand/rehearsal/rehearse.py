"""The rehearsal itself: plan, feasibility, durations, accuracy, verdict; no sensor is simulated."""

import hashlib
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

from alignment import ESTIMATORS
from alignment.options import of_noise_alone
from alignment.units import DEG
from stand.errors import StandError
from stand.imu.priors import noise_alone
from stand.physics.dynamics import inertias, torque_of, weights_model
from stand.physics.mjcf import describe, load_model
from stand.physics.truth import Truth
from stand.rehearsal.accuracy import predict
from stand.rehearsal.admissible import admissible
from stand.rehearsal.constants import floors as floors_of
from stand.rehearsal.feasibility import durations, feasibility
from stand.rehearsal.requirement import judge
from stand.rehearsal.result import Duration, Finding, Inputs, Judgement, Rehearsal, Severity
from stand.rehearsal.scene import Scene
from stand.rehearsal.traps import (
    allan_lengths,
    from_margins,
    from_servos,
    from_sheet,
    procedure_doubts,
)
from stand.simulation.plans import plan_of
from stand.simulation.settings import Settings, methods_of, payload_of, temperature_of
from stand.versions import versions


def rehearse(settings: Settings, judged_only: bool = False) -> Rehearsal:
    """The whole answer but for advice, which `stand.rehearsal.advice` adds.

    With `judged_only` what a change is judged by alone: feasibility, duration, predictions,
    judgements and whatever forbids the run.

    A plan that cannot be made at all (an attitude out of reach, a profile with a jump) is an
    error among the findings, and there is nothing else.
    """
    try:
        scene = prepared(settings)
    except StandError as error:
        fault = Finding(Severity.ERROR, "plan", "", str(error))
        return Rehearsal(
            inputs=_inputs(settings, describe(load_model(settings.table.model)).sha256),
            feasibility=(),
            duration=Duration(()),
            predictions=(),
            observability=(),
            judgements=(),
            advice=(),
            findings=(fault,),
        )
    steps = feasibility(scene)
    methods = methods_of(settings)
    predictions, observed = predict(scene, methods, observe=not judged_only)
    alone = noise_alone(settings.unit)
    predictions = [replace(p, noise_only=of_noise_alone(p.quantity, alone)) for p in predictions]
    required = settings.procedure.entry.require
    floors = {m: partial(floors_of, ESTIMATORS[m], scene) for m in methods}
    judgements = judge(required, limits_of(settings), methods, predictions, floors)
    heading = limits_of(settings).get("heading")
    rocking = []
    if required is not None and heading is not None and not judged_only:
        rocking = admissible(scene, methods, predictions, heading / required.coverage)
    findings = [
        *(Finding(Severity.WARNING, "rocking", r.label, r.text) for r in rocking),
        *from_margins(steps),
        *allan_lengths(scene.plan, scene.imu, settings.allan_terms),
    ]
    if not judged_only:
        findings += [
            *from_sheet(settings.unit),
            *from_servos(scene),
            *_heading_doubts(scene, methods, judgements),
        ]
    return Rehearsal(
        inputs=_inputs(settings, scene.model.sha256),
        feasibility=tuple(steps),
        duration=durations(scene.plan, steps),
        predictions=tuple(predictions),
        observability=tuple(observed),
        judgements=tuple(judgements),
        advice=(),
        findings=tuple(sorted(findings, key=lambda f: f.severity is not Severity.ERROR)),
        rocking=tuple(rocking),
    )


def _heading_doubts(
    scene: Scene, methods: Sequence[str], judgements: Sequence[Judgement]
) -> list[Finding]:
    """Of methods that find attitudes; a calibration needs no north."""
    if all(ESTIMATORS[method].design is not None for method in methods):
        return []
    return list(procedure_doubts(scene.plan, scene.imu, scene.site, methods, judgements))


def prepared(settings: Settings) -> Scene:
    """The scene of a rehearsal; `StandError` where there can be no plan."""
    procedure, table = settings.procedure, settings.table
    model = load_model(table.model)
    stand, load = describe(model), payload_of(procedure)
    planned = plan_of(settings, stand)
    motors = None not in table.motors
    truth = Truth(model, settings.site, settings.unit.places)
    return Scene(
        settings=settings,
        plan=planned,
        model=stand,
        torque=torque_of(model, table, load) if motors else None,
        inertias=inertias(weights_model(model, load)),
        truth=lambda: truth,
        temperature=temperature_of(procedure),
    )


def limits_of(settings: Settings) -> dict[str, float]:
    """What is required of this unit [rad], by quantity."""
    require = settings.procedure.entry.require
    if require is None:
        return {}
    return require.limits_for(settings.imu.id, settings.imu.entry.grade, settings.revision)


def _inputs(settings: Settings, model_sha256: str) -> Inputs:
    procedure, imu, table = settings.procedure, settings.imu, settings.table
    texts = {"procedure": procedure.text, "imu": imu.text, "table": table.text}
    hashes = {name: hashlib.sha256(text.encode()).hexdigest() for name, text in texts.items()}
    return Inputs(
        procedure=procedure.id,
        procedure_title=procedure.entry.title,
        procedure_text=procedure.text,
        imu=imu.id,
        imu_title=imu.title,
        imu_text=imu.text,
        table=table.id,
        table_title=table.title,
        table_text=table.text,
        latitude_deg=settings.site.known_latitude() / DEG,
        height_m=settings.site.height,
        rate_hz=settings.rate_hz,
        revision=settings.revision,
        sha256=hashes | {"model": model_sha256},
        versions=versions(),
        model=table.model,
    )
