"""What goes wrong with a procedure, named before the run: traps and doubts."""

from collections.abc import Iterable, Iterator, Sequence
from math import cos, hypot

import numpy as np
from scipy.spatial.transform import Rotation

from alignment import ESTIMATORS
from alignment.earth import EARTH_RATE, Site
from alignment.methods.positions import LEAST_TURN
from alignment.noise import FLICKER_FLOOR
from alignment.units import DEG, DEG_PER_HOUR
from stand.imu import ImuSpec
from stand.imu.preset import TriadSpec, unstated
from stand.motion.plan import Plan
from stand.rehearsal.following import never_settling
from stand.rehearsal.result import (
    FROM_SHEET,
    Finding,
    Judgement,
    Margin,
    Severity,
    StepFeasibility,
    Verdict,
)
from stand.rehearsal.scene import Scene

NEAR_POLE = 1 * DEG_PER_HOUR  # horizontal Earth rate below which heading is not to be had
BIAS_DOUBT = 1 * DEG  # heading error by the turn-on bias that is remarked where nothing is required
ALLAN_LENGTHS = 10.0  # times the averaging time of a term: then it is told to 24 %
_NORTH = Rotation.identity()


def from_margins(steps: Sequence[StepFeasibility]) -> Iterator[Finding]:
    """Every limit that is broken."""
    for step in steps:
        for margin in step.margins:
            if margin.first_violation is not None:
                where = f'step {step.number} "{step.label}"'
                text = f"{where}: {_margin_text(margin)}"
                yield Finding(Severity.ERROR, margin.quantity, step.label, text)


def from_sheet(imu: ImuSpec) -> Iterator[Finding]:
    """What the unit's data sheet leaves out, so that no prediction holds it."""
    for sentence in unstated(imu):
        yield Finding(Severity.WARNING, FROM_SHEET, "", sentence)


def from_servos(scene: Scene) -> Iterator[Finding]:
    """Axes that never settle."""
    for sentence in never_settling(scene, scene.plan.stretches):
        yield Finding(Severity.WARNING, "servo", "", sentence)


def _margin_text(m: Margin) -> str:
    value, limit = f"{abs(m.value):.4g} {m.unit}", f"{m.limit:.4g} {m.unit}"
    if m.quantity in ("sensor rate", "sensor force"):
        return f"{m.axis} would feel {value}, its range is {limit} (from {m.first_violation:.3f} s)"
    what = {
        "filter": "is over before the unit's low-pass has settled",
        "settling": "is over before the table has settled",
        "sampling": "is too short for its sample rate",
    }
    if m.quantity in what:
        return f"lasts {limit}, needs {value}: {what[m.quantity]}"
    return (
        f"{m.axis}: {m.quantity} {value}, the table allows {limit} (from {m.first_violation:.3f} s)"
    )


def procedure_doubts(
    plan: Plan,
    imu: ImuSpec,
    site: Site,
    methods: Sequence[str],
    judgements: Sequence[Judgement],
) -> Iterator[Finding]:
    """Poles, and biases that nothing cancels."""
    horizontal = EARTH_RATE * cos(site.known_latitude())
    heading = next((j for j in judgements if j.quantity == "heading"), None)
    if horizontal < NEAR_POLE:
        asked = (
            "" if heading is None else f" (heading is required to {heading.required / DEG:g} deg)"
        )
        yield Finding(
            Severity.WARNING,
            "pole",
            "",
            f"latitude {site.known_latitude() / DEG:g} deg: the horizontal Earth rate is "
            f"{horizontal / DEG_PER_HOUR:.3g} deg/h, too little to find north by{asked}",
        )
    elif why := _uncancelled(plan, methods):
        bias = hypot(imu.gyro.bias, imu.gyro.instability)
        error = bias / horizontal
        allowed = BIAS_DOUBT if heading is None else heading.required / heading.coverage
        open_still = heading is None or heading.verdict is not Verdict.PASS
        if error > allowed and open_still:
            yield Finding(
                Severity.WARNING,
                "bias-limited",
                "",
                f"{why}: the gyros' bias of {bias / DEG_PER_HOUR:.3g} deg/h is "
                f"{error / DEG:.3g} deg of heading, and no dwell shortens that; turn the unit "
                f"between positions, and estimate by {' or '.join(_cancelling(ESTIMATORS))}",
            )


def _uncancelled(plan: Plan, methods: Sequence[str]) -> str:
    """Why no method sees the unit at two headings; '' where one does."""
    poses = Rotation.concatenate([s.C_nb for s in plan.stretches if s.turning is None] or [_NORTH])
    rests = any((pose.inv() * poses).magnitude().max() > LEAST_TURN for pose in poses)
    turns = any(s.turning is not None for s in plan.stretches)
    seen = {"turning": turns, "rest": rests}
    if any(seen.get(ESTIMATORS[m].takes, turns or rests) for m in _cancelling(methods)):
        return ""
    if not (rests or turns):
        return "it never turns"
    named = ", ".join(methods) or "none"
    return f"it turns, but no method of it ({named}) sets one heading against another"


def _cancelling(methods: Iterable[str]) -> list[str]:
    """Those that take constant biases out where the unit turns."""
    return [m for m in methods if ESTIMATORS[m].turns_cancel_bias]


def allan_lengths(plan: Plan, imu: ImuSpec, terms: Sequence[str]) -> Iterator[Finding]:
    """Whether the longest rest is long enough for the Allan terms asked for."""
    rests = [s for s in plan.stretches if s.turning is None]
    longest = max((s.steady_to - s.steady_from for s in rests), default=0.0)
    label = max(rests, key=lambda s: s.steady_to - s.steady_from).label if rests else ""
    for sensor, spec in (("gyro", imu.gyro), ("accelerometer", imu.accel)):
        for term in terms:
            needed = ALLAN_LENGTHS * averaging_time(spec, term)
            if needed > longest and np.isfinite(needed):
                yield Finding(
                    Severity.ERROR,
                    "record length",
                    label,
                    f"Allan term {term} of the {sensor}s shows from {needed:.4g} s of rest on, "
                    f"the longest lasts {longest:.4g} s",
                )


def averaging_time(spec: TriadSpec, term: str) -> float:
    """Where a term has the Allan deviation for itself [s]; 0: at once; infinite: there is none.

    Where its slope has met all of those before it: ``N / sqrt(tau)``, ``0.664 B``,
    ``K sqrt(tau / 3)``, ``R tau / sqrt(2)`` (IEEE Std 952, annex C).
    """
    N, B, K, R = spec.noise, FLICKER_FLOOR * spec.instability, spec.random_walk, spec.ramp
    if term in ("N", "Q"):
        return 0.0
    if term == "B":
        return (N / B) ** 2 if B else np.inf
    if term == "K":
        return max(3 * (B / K) ** 2, 3**0.5 * N / K) if K else np.inf
    before = (2**0.5 * B, 2 * K**2 / (3 * R), (2 * N**2 * R) ** (1 / 3)) if R else ()
    return max(before) / R if R else np.inf
