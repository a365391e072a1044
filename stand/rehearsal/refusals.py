"""What forbids a prediction: methods that would refuse, and what first order does not say."""

from collections.abc import Sequence
from math import hypot, sqrt

import numpy as np
from scipy.special import chdtrc

from alignment.constant_errors import in_one_attitude
from alignment.errors import AlignmentError
from alignment.estimate import ANGLE_LIMIT
from alignment.gains import Answer
from alignment.information import InstrumentErrors
from alignment.information.circle import NO_RIVAL, Rival, rival
from alignment.information.result import DETERMINED
from alignment.methods.position_fit import ROUNDING
from alignment.noise import REST_BLOCK, REST_RATE, REST_TILT
from alignment.nominal import WRONG_POSITION
from alignment.units import DEG, STANDARD_GRAVITY
from stand.motion.plan import PlannedStep
from stand.rehearsal.predictions import Parts
from stand.rehearsal.response import ReadingErrors, Response
from stand.rehearsal.rocking import FOLLOWS
from stand.rehearsal.scene import Scene
from stand.rehearsal.verification import AGREES, MOSTLY

# root mean square scale error by rounding, above which heading is none of first order: fits that
# know the size of Earth rate are 20 % worse at 0.18 (and it goes with the square)
STEEPEST = 0.07
MILLI_G = 1e-3 * STANDARD_GRAVITY
ASTRAY = 0.5  # rad, by which what is known by value turns every run's search astray
FAR_HEADING = 1.0  # rad, by which a match may be off that a filter without a heading settles from
ANY_HEADING = float(np.pi / np.sqrt(3))  # rad: of one that may be any
UNITS = 1000  # of which a method must answer for the half


def check_quiet(
    steps: Sequence[PlannedStep], scene: Scene, unit: InstrumentErrors, turning: bool
) -> None:
    """Raise where a method that checks for rest would mostly take the unit's noise for motion.

    It looks at means of `REST_BLOCK`: at rates of three axes (two across a turn's axis), and at
    the tilt of the force. Of m normal numbers of variance one the sum of squares is above x in
    ``chdtrc(m, x)`` of the cases; drifts within a stretch are left out.
    """
    blocks = sum(step.steady_to - step.steady_from for step in steps) / REST_BLOCK
    gyro, accel = (
        np.hypot(np.max(triad.noise), one.noise / sqrt(scene.rate_hz)) / sqrt(REST_BLOCK)
        for triad, one in zip((unit.gyro, unit.accel), scene.roundings, strict=True)
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


def check_vertical(responses: Sequence[Response]) -> None:
    """Raise where a method that checks the vertical of each position would refuse most units.

    One unit goes through all positions: `UNITS` of them are drawn, always the same ones.
    """
    if not responses:
        return
    drawn = np.random.default_rng(0).standard_normal((UNITS, len(responses[0].true.parameters)))
    tilts = np.array(
        [np.linalg.norm(drawn @ r.feigned_tilt().T + r.known_tilt(), axis=1) for r in responses]
    )
    refused = np.mean(np.max(tilts, axis=0) > WRONG_POSITION)
    if refused > MOSTLY:
        raise AlignmentError(
            f"would refuse {100 * refused:.0f} % of such units: accelerometers' errors tilt the "
            f"vertical by {np.sqrt(np.mean(tilts**2) / 2) / DEG:.2g} deg (1 sigma), and "
            f"{WRONG_POSITION / DEG:.0f} deg are taken for another position"
        )


def check_carried(label: str, match: Parts) -> None:
    """Raise where gravity's curve, carried by such gyros, would be taken for travel.

    `match`: covariances about n of its match by source, by which the velocity's wander is checked.
    """
    total = sum(match.values(), np.zeros((3, 3)))
    tilt = sqrt(max(total[0, 0], total[1, 1]))
    if tilt > DETERMINED:
        raise AlignmentError(
            f"{label}: such gyros carry the attitude so far off that gravity seems to tilt by "
            f"{tilt / DEG:.2g} deg (1 sigma): the velocity wanders as if the instrument travelled"
        )


def unsettled(match: Parts, off: float) -> str:
    """Why a heading that is looked for from a match's has no number; '' where it has.

    `match`: covariances about n of the match by source; `off` [rad]: its heading's error by what is
    known by value, in every run alike. Where its heading may be any, the search ends at another one
    now and then, however sure it is of either.
    """
    heading = hypot(off, _heading(match))
    if abs(off) < ASTRAY and heading < ANY_HEADING:
        return ""
    return (
        f"it is looked for from that of inertial, which is off by {heading / DEG:.0f} deg by first "
        "order: the search may end at another; see --verify"
    )


def unturned(parts: Parts, match: Parts, off: float) -> str:
    """Why no tilt of an axis that turns is predicted; '' where it is.

    `parts`, `match`: covariances about n by source, of a filter and of the match that it starts
    from; `off` [rad]: the filter's heading error by what is known by value. Errors of scale and
    axes turn with heading: the filter must settle about one, or has no answer.
    """
    heading, start = _heading(parts), _heading(match)
    if heading > ANGLE_LIMIT and start > FAR_HEADING:
        return (
            f"a filter in a turn must settle, and with a heading of {heading / DEG:.0f} deg, "
            f"looked for from one that is off by {start / DEG:.0f} deg, most runs refuse"
        )
    if abs(off) < DETERMINED:
        return ""
    return (
        f"what is known by value turns heading by {abs(off) / DEG:.0f} deg by first order, and "
        "tilt with it: see --verify"
    )


def adrift(steady: float) -> str:
    """Why no tilt of a filter is predicted whose heading what is alike in every run turns by
    `steady` [rad]: it need not settle; '' where it is."""
    if steady < FAR_HEADING:
        return ""
    return (
        f"what is alike in every run, a lag say, turns heading by {steady / DEG:.0f} deg by first "
        "order: the filter need not settle, and runs refuse then"
    )


def _heading(parts: Parts) -> float:
    return sqrt(float(sum(P[2, 2] for P in parts.values())))


def coarse(scene: Scene) -> str:
    """Why rounding forbids a number for a heading from Earth rate; '' where it does not."""
    gyro, _ = scene.roundings
    if gyro.steepness <= STEEPEST:
        return ""
    return (
        f"rates are rounded to {gyro.step / DEG:.3g} deg/s, which the noise of a sample, "
        f"{gyro.dither / DEG:.2g} deg/s at {scene.rate_hz} Hz, does not blur: how much of Earth "
        "rate is read depends on where in a step the bias lies"
    )


def coarse_tilt(scene: Scene) -> str:
    """Why rounding forbids a number for a tilt by later samples less the first ones; else ''.

    Such a difference is nothing in the middle of a step and that of coin tosses at its edges: far
    off in a few runs and nothing in the others, which no sigma says.
    """
    _, accel = scene.roundings
    if accel.steepness <= STEEPEST:
        return ""
    return (
        f"forces are rounded to {accel.step / MILLI_G:.3g} mg, which the noise of a sample, "
        f"{accel.dither / MILLI_G:.2g} mg at {scene.rate_hz} Hz, does not blur: what later samples "
        "differ by depends on where in a step the bias lies"
    )


def rival_of(answer: Answer) -> Rival:
    """What first order leaves out of an answer's heading."""
    return NO_RIVAL if answer.circle is None else rival(answer.circle)


def rivalled(other: Rival) -> str:
    """Why another heading forbids a number for this one; '' where it does not.

    Where it would change the sigma by more than is promised of predictions: such errors are mostly
    small and now and then wide, which no sigma says. Nor is one where heading is told by how the
    circle bends more than by its tangent.
    """
    if other.ratio < AGREES[0]:
        return (
            f"by first order it would be {1 / other.ratio:.2g} times too large: what the turns "
            "show of Earth rate hardly changes with heading; see --verify"
        )
    if other.ratio <= AGREES[1]:
        return ""
    return (
        f"a heading {other.apart / DEG:.0f} deg off fits the readings nearly as well (chi-square "
        f"{other.chi2:.1f} more): a turn about a second axis would tell"
    )


def _mean_force(answer: Answer, errors: ReadingErrors) -> float:
    """Standard deviation [m/s^2] of the mean force of all positions, by noise and drift."""
    n = len(answer.stretches)
    about = np.eye(n) - 1 / n
    by_accel = [N for name, N in errors.noises.items() if name.startswith("accelerometer")]
    noise = np.sum(by_accel, axis=0)
    apart = [float(np.trace(about @ noise[k::6, k::6] @ about)) for k in (3, 4, 5)]
    return sqrt(float(np.mean(apart)) / (n - 1) / n + ROUNDING[3] ** 2 / n)


def size_of_force(answer: Answer, errors: ReadingErrors, anomaly: float, scene: Scene) -> float:
    """How well [m/s^2] a fit of positions knows the force's size; infinite of other methods.

    `anomaly` [m/s^2]: how far gravity may be off.
    """
    if not answer.biases or len(answer.stretches) < 2:
        return np.inf
    scale = in_one_attitude(scene.options.priors, scene.site.gravity).accel_scale
    return float(np.linalg.norm([_mean_force(answer, errors), anomaly, scale * scene.site.gravity]))


def axes_off(scene: Scene) -> float:
    """How much force [m/s^2] accelerometers feel across it of one that tilts by a radian."""
    told = scene.options.priors
    return scene.site.gravity * float(
        np.hypot(told.accel_misalignment, told.accel_non_orthogonality)
    )


def second_order(answer: Answer, errors: ReadingErrors, scene: Scene) -> str:
    """Why a fit of positions has no predicted tilts and accelerometer biases; '' where it has.

    A fit knows the attitudes as they were, a prediction as they are planned. A table that leans by
    t beside its plan makes of an accelerometer's error b across the vertical ``t b`` along it: in
    one position more force, half a turn on less. So n positions over which b goes round tell it by
    ``(t b / s)^2`` times what was known of it, t (of a level axis) and b standard deviations, s
    the noise of the mean of all: of a first order that holds b to be hidden in the tilt,
    ``1/sqrt(1 + (t b / s)^2)`` is left. No number stands where that is less than 0.9. The errors b
    are biases, axes that are off, and scale errors by as much of the force as goes round in b,
    on a base that is planned to lean.
    """
    told, g, n = scene.options.priors, scene.site.gravity, len(answer.stretches)
    if not answer.biases or n < 2:
        return ""
    t = float(np.linalg.norm([told.nominal, told.turn, told.seat]))
    forces = np.array([s.C_pb.inv().apply(scene.site.f_n) for s in answer.stretches])
    round_ = sqrt(float(forces.var(axis=0).sum()) / 2)
    one = in_one_attitude(told, g)
    b = float(np.hypot(one.accel_bias, one.accel_scale * round_))
    s2 = _mean_force(answer, errors) ** 2
    gain = (t * b) ** 2 / s2
    if gain <= FOLLOWS * (1 + gain):
        return ""
    return (
        f"the mean force is known to {sqrt(s2):.2g} m/s^2, and {t / DEG:.2g} deg by which the "
        f"table may lean make {t * b:.2g} m/s^2 of the accelerometers' errors: more than first "
        "order matters; see --verify"
    )
