"""How much a base may rock for a required heading: what [S1] leaves open.

`two-gyro` takes means, and what the base turned from start to end is its error: ``sqrt(2 D (1 -
rho))/T`` over the horizontal Earth rate, D the variance of the rocking about one axis and rho its
correlation over the record. Of methods that carry the rocking along, what it adds to their
prediction grows with it: from the rocking that is planned the one that is allowed follows.
"""

from collections.abc import Sequence

import numpy as np

from alignment import ImuReadings
from alignment.arrays import Array
from alignment.errors import AlignmentError
from alignment.methods.two_gyro import METHOD as TWO_GYRO
from alignment.methods.two_gyro import two_gyro_functional
from stand.motion.plan import PlannedStep
from stand.rehearsal.result import Prediction
from stand.rehearsal.rocking import over_time, readings_of
from stand.rehearsal.rocking_allowed import AdmissibleRocking
from stand.rehearsal.scene import Scene
from stand.table.joints import JOINTS

TILTING = [JOINTS.index("base_roll"), JOINTS.index("base_pitch")]
DAMPING = 0.1  # of the chart's rocking: a resonance
LEAST = 1e-5  # rad rms: a base that rocks by less rests
TRUSTED = 10.0  # times the planned rocking: further than that its part is not known to grow alike
_MOTION = "motion"  # what predictions call the rocking's own part
_SAMPLES = 4000  # of a stretch, for its rms and frequency


def admissible(
    scene: Scene, methods: Sequence[str], predictions: Sequence[Prediction], allowed: float
) -> list[AdmissibleRocking]:
    """What each method admits of the base's rocking for a heading sigma `allowed` [rad].

    Of the first stretch behind which the base rocks; nothing of a base that rests.
    """
    for step in scene.plan.stretches:
        planned, frequency = base_rocking(scene, step)
        if planned < LEAST:
            continue
        found = []
        for method in methods:
            if method == TWO_GYRO:
                found.append(_by_means(scene, step, allowed, planned, frequency))
            else:
                found += _by_prediction(method, step, predictions, allowed, planned, frequency)
        return found
    return []


def base_rocking(scene: Scene, step: PlannedStep) -> tuple[float, float]:
    """Rms about the worse horizontal axis [rad], and its frequency [Hz]: rms of rate over angle."""
    t = np.linspace(step.steady_from, step.steady_to, _SAMPLES)
    angles, rates, _ = scene.plan.motion.joints(t)
    sizes = angles[:, TILTING].std(axis=0)
    worse = int(np.argmax(sizes))
    size = float(sizes[worse])
    if size < LEAST:
        return 0.0, 0.0
    return size, float(rates[:, TILTING[worse]].std() / size / (2 * np.pi))


def turned(frequencies: Array, seconds: float) -> Array:
    """Rms of what a resonance of rms 1 turns from start to end of a record, ``sqrt(2 (1 - rho))``.

    ``rho = exp(-d w T) (cos u + d w T sin(u)/u)``, ``u = w T sqrt(1 - d^2)``, d its damping.
    """
    phase = 2 * np.pi * frequencies * seconds
    rung = phase * np.sqrt(1 - DAMPING**2)
    rho = np.exp(-DAMPING * phase) * (np.cos(rung) + DAMPING * phase * np.sinc(rung / np.pi))
    return np.asarray(np.sqrt(2 * (1 - rho)))


def _by_means(
    scene: Scene, step: PlannedStep, allowed: float, planned: float, frequency: float
) -> AdmissibleRocking:
    seconds = step.steady_to - step.steady_from
    sensors = _at_rest(scene, step)
    left = np.sqrt(max(allowed**2 - sensors**2, 0.0))
    most = left * scene.site.horizontal_rate() * seconds
    f = np.geomspace(0.01 / seconds, 5.0, 200)
    return AdmissibleRocking(
        method=TWO_GYRO,
        label=step.label,
        allowed=allowed,
        planned=planned,
        frequency=frequency,
        rms=float(most / turned(np.array([frequency]), seconds)[0]),
        sensors=sensors,
        frequencies=f,
        curve=most / turned(f, seconds),
    )


def _at_rest(scene: Scene, step: PlannedStep) -> float:
    """Sigma of heading [rad] by the sensors, where the base stands as it does on average."""
    rocking = readings_of(scene.truth(), scene.plan.motion, step.steady_from, step.steady_to)
    w, f = (np.tile(x.mean(axis=0), (len(rocking), 1)) for x in (rocking.w_ib_b, rocking.f_b))
    still = ImuReadings(rocking.t, w, f)
    try:
        run = two_gyro_functional(still, scene.site, scene.options)
    except AlignmentError:  # not upright, or at a pole: no rocking helps
        return np.inf
    parts = over_time(run, scene.unit, scene)
    return float(np.sqrt(sum(P[2, 2] for P in parts.values())))


def _by_prediction(
    method: str,
    step: PlannedStep,
    predictions: Sequence[Prediction],
    allowed: float,
    planned: float,
    frequency: float,
) -> list[AdmissibleRocking]:
    """What is allowed of the rocking whose part in a prediction is known; none without one."""
    own = [
        p
        for p in predictions
        if (p.method, p.label, p.quantity) == (method, step.label, "heading") and p.sigma
    ]
    if not own:
        return []
    assert own[0].sigma is not None
    by_motion = sum(c.sigma**2 for c in own[0].contributions if c.source == _MOTION)
    rest = max(own[0].sigma ** 2 - by_motion, 0.0)
    left = max(allowed**2 - rest, 0.0)
    rms = planned * np.sqrt(left / by_motion) if by_motion else (np.inf if left else 0.0)
    if rms > TRUSTED * planned:
        rms = np.inf
    return [
        AdmissibleRocking(
            method=method,
            label=step.label,
            allowed=allowed,
            planned=planned,
            frequency=frequency,
            rms=float(rms),
            sensors=float(np.sqrt(rest)),
            frequencies=np.zeros(0),
            curve=np.zeros(0),
        )
    ]
