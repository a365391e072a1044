"""What is probably wrong with a table's file: unit mix-ups, impossible pairs, missing sources.

A fault that keeps it from loading, a mix-up of units and what no table can do are errors; what is
merely unusual is a warning.
"""

from collections.abc import Iterator

from alignment.units import DEG
from stand import toml_files as catalogue
from stand.imu.lint import PLACEHOLDERS, SHORTEST_SOURCE, PresetFinding
from stand.table.joints import JOINTS
from stand.table.table import AxisEntry, MotorEntry, TableEntry

GREATEST = 1800.0  # arc s: half a degree, which no table is off by
FINEST = 0.05  # arc s: beyond what is sold; a value in degrees or radians looks so
FASTEST = 3000.0  # deg/s
SLOWEST = 0.5  # deg/s of an axis: less looks like turns or rad per second
LONGEST_RAMP = 60.0  # s to the full rate, or to the full acceleration
SHORTEST_RAMP = 1e-3
STIFFEST = 100.0  # Hz
LEAST_DAMPING = 0.3
ROUGHEST = 0.3  # of the torque: friction or cogging
_ERRORS = ("placement", "encoder", "non_orthogonality", "wobble")
_GEOMETRY = ("base_tilt_arc_s", "base_azimuth_arc_s", "mounting_arc_s")


def lint(source: catalogue.Source) -> list[PresetFinding]:
    """What is wrong with a table's text, errors first; never raises for what is in it.

    A table that cannot be loaded gets its faults alone: the rules need values.
    """
    faults = catalogue.faults(source, TableEntry)
    if faults:
        return [PresetFinding("error", place or source.name, message) for place, message in faults]
    entry = catalogue.parse(source, TableEntry)
    return sorted(_all(entry), key=lambda f: f.severity != "error")


def _all(entry: TableEntry) -> Iterator[PresetFinding]:
    words = entry.source.strip()
    if words.lower() in PLACEHOLDERS or len(words) < SHORTEST_SOURCE:
        yield PresetFinding("warning", "source", f"{words!r} names no document and page")
    for key in _GEOMETRY:
        yield from _size(f"geometry, {key}", getattr(entry.geometry, key))
    for name, axis in entry.axis.items():
        yield from _axis(name, axis)
        step, within = axis.errors.encoder_step_arc_s, entry.settling.within_arc_s
        if step > within:
            yield PresetFinding(
                "error",
                f"settling, within_arc_s = {within:g}",
                f"is below the encoder's step of {step:g} arc s on {name}: that axis never settles",
            )
    without = [name for name, axis in entry.axis.items() if axis.motor is None]
    if without and len(without) < len(entry.axis):
        told = "no motor, the others have one: --motion servo is refused"
        yield PresetFinding("warning", f"axis, {', '.join(without)}", told)


def _size(place: str, arc_s: float) -> Iterator[PresetFinding]:
    if arc_s > GREATEST:
        message = f"{arc_s:g} arc s is {arc_s / 3600:.2g} deg, no table is off by that: arc s?"
        yield PresetFinding("error", place, message)
    elif 0 < arc_s < FINEST:
        message = f"{arc_s:g} arc s is finer than any table: degrees or radians for arc s?"
        yield PresetFinding("error", place, message)


def _axis(name: str, axis: AxisEntry) -> Iterator[PresetFinding]:
    for key in _ERRORS:
        place = f"axis, {name}, errors, {key}_arc_s"
        yield from _size(place, getattr(axis.errors, f"{key}_arc_s"))
    if axis.errors.rate_ripple_percent > 1:
        told = f"{axis.errors.rate_ripple_percent:g} % of the rate: ppm or a part of one for %?"
        yield PresetFinding("warning", f"axis, {name}, errors, rate_ripple_percent", told)
    rate, acceleration, jerk = axis.rate_deg_s, axis.acceleration_deg_s2, axis.jerk_deg_s3
    if not SLOWEST <= rate <= FASTEST:
        told = f"{rate:g} deg/s: tables turn at {SLOWEST:g} to {FASTEST:g}; another unit?"
        yield PresetFinding("warning", f"axis, {name}, rate_deg_s", told)
    for key, ramp in (
        ("acceleration_deg_s2", rate / acceleration),
        ("jerk_deg_s3", acceleration / jerk),
    ):
        if not SHORTEST_RAMP <= ramp <= LONGEST_RAMP:
            told = f"the limit before it is reached in {ramp:.3g} s; another unit?"
            yield PresetFinding("warning", f"axis, {name}, {key}", told)
    if name in JOINTS[:3] and axis.travel_deg is None:
        told = "absent: a base that turns without end"
        yield PresetFinding("warning", f"axis, {name}, travel_deg", told)
    if axis.motor is not None:
        yield from _motor(f"axis, {name}, motor", axis.motor, rate)


def _motor(place: str, motor: MotorEntry, rate: float) -> Iterator[PresetFinding]:
    drag = motor.viscous_Nm_s * rate * DEG + motor.coulomb_Nm
    if drag >= motor.torque_Nm:
        told = (
            f"at {rate:g} deg/s friction takes {drag:.3g} of {motor.torque_Nm:g} N m: never reached"
        )
        yield PresetFinding("error", f"{place}, torque_Nm", told)
    if motor.bandwidth_hz > STIFFEST:
        told = f"{motor.bandwidth_hz:g} Hz: position loops end near {STIFFEST:g}; rad/s for Hz?"
        yield PresetFinding("warning", f"{place}, bandwidth_hz", told)
    if motor.damping < LEAST_DAMPING:
        told = f"{motor.damping:g}: rings for long"
        yield PresetFinding("warning", f"{place}, damping", told)
    for key in ("cogging_Nm", "coulomb_Nm"):
        if getattr(motor, key) > ROUGHEST * motor.torque_Nm:
            told = f"more than {ROUGHEST:g} of torque_Nm = {motor.torque_Nm:g}: mN m for N m?"
            yield PresetFinding("warning", f"{place}, {key}", told)
