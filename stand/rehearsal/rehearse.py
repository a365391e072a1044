"""The rehearsal itself: plan, feasibility, durations, accuracy, verdict; no sensor is simulated."""

import hashlib
import platform
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from importlib.metadata import version

from alignment import Options, Site
from alignment.units import DEG
from stand import __version__
from stand.errors import StandError
from stand.imu import ImuSpec
from stand.imu.priors import priors_of
from stand.motion.planner import plan
from stand.motion.polynomial import MotionKind
from stand.physics.dynamics import inertias, required_torque, weights_model
from stand.physics.mjcf import describe, load_model
from stand.physics.truth import Truth
from stand.procedure.procedure import Procedure
from stand.rehearsal.accuracy import predict
from stand.rehearsal.feasibility import Bench, durations, feasibility
from stand.rehearsal.requirement import judge
from stand.rehearsal.result import (
    Duration,
    Finding,
    Inputs,
    Observability,
    Prediction,
    Rehearsal,
    Severity,
)
from stand.rehearsal.scene import Scene
from stand.rehearsal.traps import allan_lengths, doubts, from_margins, from_sheet
from stand.simulation.settings import base_arm_of, payload_of, temperature_of
from stand.table.joints import StandModel
from stand.table.table import Table


@dataclass(frozen=True, slots=True, eq=False)
class Request:
    """What is to be rehearsed.

    `revision` of the part, for limits that depend on it; `allan_terms`: those a record is to
    show; `seed` of the sway that is drawn, and of runs (`stand.rehearsal.verify.first_seed`);
    `motion` of the joints in these.
    """

    procedure: Procedure
    imu: ImuSpec
    table: Table
    site: Site
    options: Options
    rate_hz: int = 200
    revision: str = ""
    allan_terms: tuple[str, ...] = ()
    seed: int = 0
    motion: MotionKind = MotionKind.IDEAL


def request(
    procedure: Procedure, imu: ImuSpec, table: Table, site: Site, rate_hz: int = 200
) -> Request:
    """A request with the estimators told what the data sheets say."""
    priors = priors_of(imu, table, procedure.entry.rocks, base_arm_of(table))
    options = replace(procedure.entry.estimate.options(), priors=priors)
    return Request(procedure, imu, table, site, options, rate_hz)


def rehearse(asked: Request) -> Rehearsal:
    """The whole answer but for advice, which `stand.rehearsal.advice` adds.

    A plan that cannot be made at all (an attitude out of reach, a profile with a jump) is an
    error among the findings, and there is nothing else.
    """
    entry, site = asked.procedure.entry, asked.site
    model = load_model(asked.table.model)
    stand = describe(model)
    inputs = _inputs(asked, stand)
    try:
        planned = plan(asked.procedure, stand, asked.table, asked.seed)
    except StandError as error:
        fault = Finding(Severity.ERROR, "plan", "", str(error))
        return Rehearsal(inputs, (), Duration(()), (), (), (), (), (fault,))
    load = payload_of(asked.procedure)
    motors = None not in asked.table.motors
    torque = partial(required_torque, model, asked.table, load) if motors else None
    truth = Truth(model, site, asked.imu.places)
    bench = Bench(
        planned,
        asked.table,
        torque,
        inertias(weights_model(model, load)),
        asked.imu,
        truth,
        asked.rate_hz,
    )
    steps = feasibility(bench)
    scene = Scene(
        planned,
        stand,
        asked.table,
        asked.imu,
        site,
        asked.options,
        asked.rate_hz,
        lambda: truth,
        temperature_of(asked.procedure),
        entry.table_errors,
        asked.motion is MotionKind.IDEAL,
    )
    methods = entry.estimate.methods
    predictions, observed = predict(scene, methods)
    judgements = judge(entry.require, limits_of(asked), methods, predictions)
    findings = [
        *from_margins(steps),
        *from_sheet(asked.imu),
        *allan_lengths(planned, asked.imu, asked.allan_terms),
        *doubts(planned, asked.imu, site, methods, judgements),
    ]
    return Rehearsal(
        inputs,
        tuple(steps),
        durations(planned, steps),
        tuple(predictions),
        tuple(observed),
        tuple(judgements),
        (),
        tuple(sorted(findings, key=lambda f: f.severity is not Severity.ERROR)),
    )


def limits_of(asked: Request) -> dict[str, float]:
    """What is required of this unit [rad], by quantity."""
    require = asked.procedure.entry.require
    if require is None:
        return {}
    return require.limits_for(asked.imu.id, asked.imu.entry.grade, asked.revision)


def _inputs(asked: Request, stand: StandModel) -> Inputs:
    texts = {
        "procedure": asked.procedure.text,
        "imu": asked.imu.text,
        "table": asked.table.text,
    }
    return Inputs(
        asked.procedure.id,
        asked.procedure.entry.title,
        asked.procedure.text,
        asked.imu.id,
        asked.imu.title,
        asked.imu.text,
        asked.table.id,
        asked.table.title,
        asked.table.text,
        asked.site.known_latitude() / DEG,
        asked.site.height,
        asked.rate_hz,
        asked.revision,
        {name: hashlib.sha256(text.encode()).hexdigest() for name, text in texts.items()}
        | {"model": stand.sha256},
        dict(_versions()),
        asked.table.model,
    )


@cache
def _versions() -> tuple[tuple[str, str], ...]:
    """Versions of all that has a say in the numbers."""
    packages: Sequence[str] = ("mujoco", "numpy", "scipy", "ruckig")
    own = (("stand", __version__), ("python", platform.python_version()))
    return (*own, *((package, version(package)) for package in packages))


__all__ = [
    "Observability",
    "Prediction",
    "Request",
    "limits_of",
    "rehearse",
    "request",
]
