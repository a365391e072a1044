"""Whether table and sensors can make every step: margins, settling, durations."""

from collections.abc import Iterator

import numpy as np
from scipy.linalg import expm

from alignment.arrays import Array
from alignment.units import DEG, STANDARD_GRAVITY
from stand.imu.preset import TriadSpec
from stand.motion.limits import QUANTITIES, SLACK, Peak, times_within, uses
from stand.motion.plan import Plan, PlannedStep
from stand.motion.polynomial import Motion
from stand.physics.dynamics import gains_of
from stand.rehearsal.result import Duration, Margin, StepDuration, StepFeasibility
from stand.rehearsal.scene import Scene
from stand.samples import AXES
from stand.simulation.plans import LEAST_SAMPLES
from stand.table.joints import JOINTS
from stand.table.table import Motor

FILTER_SETTLING = 1.13  # times 1 / bandwidth [Hz]: five time constants of the low-pass, to 0.7 %
_TIMES = 2000  # most instants of a step at which the sensors are looked at
_GRID = 4000  # times at which a first violation is sought
_SETTLING_STEP = 1e-3  # s
_SETTLING_TIMES = 20_000


def feasibility(scene: Scene) -> list[StepFeasibility]:
    """Every step's margins, all limits that it breaks, and its settling."""
    settling = settling_times(scene)
    return [
        StepFeasibility(
            number=use.step.number + 1,
            kind=use.step.kind,
            label=use.step.label,
            t_from=use.step.t_from,
            t_to=use.step.t_to,
            margins=(
                *(_margin(scene, use.step, peak) for peak in use.peaks),
                *_sensors(scene, use.step),
                *_lengths(scene, use.step, settled),
            ),
            settling_s=settled,
            turns=_turns(scene.plan.motion, use.step),
            joints=tuple(use.step.joints.tolist()),
        )
        for use, settled in zip(uses(scene.plan, scene.table, scene.torque), settling, strict=True)
    ]


def _margin(scene: Scene, step: PlannedStep, peak: Peak) -> Margin:
    first = None
    if peak.ratio > 1 + SLACK:
        first = _first_violation(scene, step, peak)
    unit = QUANTITIES[peak.quantity]
    return Margin(
        quantity=peak.quantity,
        axis=peak.axis,
        value=peak.value,
        limit=peak.limit,
        unit=unit,
        ratio=peak.ratio,
        t=peak.t,
        first_violation=first,
    )


def _first_violation(scene: Scene, step: PlannedStep, peak: Peak) -> float:
    """When a step first breaks the limit: by a grid, and halving between its points."""
    axis, motion = JOINTS.index(peak.axis), scene.plan.motion

    def used(t: Array) -> Array:
        q, v, a = motion.joints(t)
        if peak.quantity == "torque":
            assert scene.torque is not None
            return np.abs(scene.torque(q, v, a)[:, axis]) / scene.table.torque[axis]
        if peak.quantity == "angle":
            angle = q[:, axis]
            return np.abs(angle) / np.where(
                angle > 0, scene.table.high[axis], -scene.table.low[axis]
            )
        x = {"rate": v, "acceleration": a}.get(peak.quantity)
        if x is None:
            x = motion.derivative().joints(t)[2]
        limit = getattr(scene.table, peak.quantity)[axis]
        return np.abs(x[:, axis]) / limit

    t = np.unique(np.append(np.linspace(step.t_from, step.t_to, _GRID), peak.t))
    beyond = used(t) > 1 + SLACK
    k = int(np.argmax(beyond)) if beyond.any() else int(np.searchsorted(t, peak.t))
    if k == 0:
        return float(t[0])
    low, high = float(t[k - 1]), float(t[k])
    for _ in range(30):
        middle = (low + high) / 2
        low, high = (low, middle) if used(np.array([middle]))[0] > 1 + SLACK else (middle, high)
    return high


# --- sensors -------------------------------------------------------------------------------------


def _sensors(scene: Scene, step: PlannedStep) -> Iterator[Margin]:
    """What the unit feels against its range: rocking, lever arm and Earth rate in it."""
    t = times_within(scene.plan.motion, step, _TIMES)
    felt = scene.truth().instants(*scene.plan.motion.joints(t))
    for name, x, spec, unit, per in (
        ("sensor rate", felt.w_ib_b, scene.imu.gyro, "deg/s", DEG),
        ("sensor force", felt.f_places, scene.imu.accel, "g", STANDARD_GRAVITY),
    ):
        row, axis = np.unravel_index(int(np.argmax(np.abs(x))), x.shape)
        value, ratio = float(x[row, axis]), float(abs(x[row, axis]) / spec.range)
        beyond = np.abs(x).max(axis=1) > spec.range
        first = float(t[int(np.argmax(beyond))]) if beyond.any() else None
        sensor = f"{'gyro' if name == 'sensor rate' else 'accelerometer'} {AXES[axis]}"
        limit = spec.range / per
        yield Margin(
            quantity=name,
            axis=sensor,
            value=value / per,
            limit=limit,
            unit=unit,
            ratio=ratio,
            t=float(t[row]),
            first_violation=first,
        )


def filter_settling(spec: TriadSpec) -> float:
    """Seconds until a low-pass has forgotten what was before; 0 without one."""
    return FILTER_SETTLING / spec.bandwidth


def _lengths(scene: Scene, step: PlannedStep, settled: float | None) -> Iterator[Margin]:
    """A stretch against samples, filter and servo: it must outlast each of them."""
    if step.kind != "dwell" and step.turning is None:
        return
    length = step.steady_to - step.steady_from
    filtered = max(filter_settling(scene.imu.gyro), filter_settling(scene.imu.accel))
    needs = [("sampling", LEAST_SAMPLES / scene.rate_hz), ("filter", filtered)]
    if settled is not None:
        needs.append(("settling", settled + scene.table.settle_hold))
    for name, needed in needs:
        if needed > 0:
            first = step.steady_from if needed > length else None
            yield Margin(
                quantity=name,
                axis="",
                value=needed,
                limit=length,
                unit="s",
                ratio=needed / length,
                t=step.steady_from,
                first_violation=first,
            )


def _turns(motion: Motion, step: PlannedStep) -> dict[str, float]:
    """Whole turns from zero where a step ends, of the axes that have made one."""
    q = motion.joints([step.t_from, step.t_to])[0] / (2 * np.pi)
    far = np.abs(q).max(axis=0)
    return {JOINTS[i]: float(q[-1, i]) for i in np.flatnonzero(far >= 1 - 1e-9)}


# --- settling ------------------------------------------------------------------------------------


def settling_times(scene: Scene) -> list[float | None]:
    """How long each rest waits for the servo [s], from when the demand stands still.

    Notes
    -----
    The feedforward knows inertia and viscous friction, and an axis that comes to rest the way it
    turned is held by its bristles as friction held it: a move or a turn leaves nothing to settle.
    After rocking to and fro friction may let go as a whole: a step of Coulomb torque on the
    closed loop ``s^3 + 2 d w s^2 + w^2 s + w^2 / T``, settled when its response stays within the
    table's window. Nothing is told of a class without motors.
    """
    found: list[float | None] = []
    rocked = np.zeros(len(JOINTS), bool)
    for step, rests in zip(scene.plan.steps, scene.plan.rests, strict=True):
        if step.kind != "dwell":
            found.append(None)
            held = step.kind == "move" or step.turning is not None
            rocked = np.zeros(len(JOINTS), bool) if held else ~rests
            continue
        axes = zip(scene.table.motors, scene.inertias, rocked, strict=True)
        times = [
            settling_of(motor, float(inertia), scene.table.settle_within)
            for motor, inertia, moved in axes
            if moved and motor is not None
        ]
        found.append(None if None in scene.table.motors else max(times, default=0.0))
        rocked = np.zeros(len(JOINTS), bool)
    return found


def settling_of(motor: Motor, inertia: float, within: float) -> float:
    """Seconds until an axis whose friction lets go stays within an error [rad]."""
    gains = gains_of(motor, inertia)
    own = np.array([gains.kp, gains.kd + motor.viscous, gains.ki]) / inertia
    A = np.array([[0, 1, 0], -own, [1, 0, 0]])
    if motor.integral is None:
        return 0.0
    # angle error, rate, integral that balances what was held a moment ago
    x = np.array([0.0, 0.0, motor.coulomb / gains.ki])
    step = expm(A * _SETTLING_STEP)
    outside = 0
    for k in range(1, _SETTLING_TIMES):
        x = step @ x
        if abs(x[0]) > within:
            outside = k
        elif k > 4 * outside + 1000:
            break
    return outside * _SETTLING_STEP


# --- durations -----------------------------------------------------------------------------------


def durations(plan: Plan, steps: list[StepFeasibility]) -> Duration:
    """How long each step moves, waits and measures."""
    rows = []
    for planned, step in zip(plan.steps, steps, strict=True):
        whole = planned.t_to - planned.t_from
        settling = dwell = 0.0
        if planned.kind == "dwell":
            settling = max(step.settling_s or 0.0, planned.steady_from - planned.t_from)
            settling = min(settling, whole)
            dwell = whole - settling
        elif planned.kind == "move":
            settling = planned.t_to - planned.steady_from
        else:
            dwell = planned.steady_to - planned.steady_from
        motion = whole - settling - dwell
        rows.append(
            StepDuration(
                number=step.number,
                kind=step.kind,
                label=step.label,
                t_from=step.t_from,
                t_to=step.t_to,
                motion=motion,
                settling=settling,
                dwell=dwell,
            )
        )
    return Duration(tuple(rows))
