"""What is probably wrong with a preset: unit mix-ups, impossible pairs, missing sources.

A fault that keeps the preset from loading, a mix-up of units and what no unit can do are errors;
what is merely unusual, or missing, is a warning. The Allan deviation ties two values together:
white noise N leaves ``N / sqrt(tau)``, bias instability B is the least value of the whole curve,
so white noise has come down to B at ``tau = (N / B)^2``:

- were that shorter than a sample, B would lie above the white noise at every tau there is, and
  nobody could have read N off the curve;
- were it longer than 1e5 s, nobody could have recorded B (ten times that, to see the curve turn);
- known units lie between 0.1 s (MEMS) and half a day (lasers); a factor of 60 in N is 3600 here.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import log2, sqrt
from typing import Literal

from stand import toml_files as catalogue
from stand.imu.bands import ACCEL_BANDS, GRADES, GYRO_BANDS, REFERENCE, SAMPLING_BANDS, Band, slips
from stand.imu.preset import ACCEL_KEYS, GYRO_KEYS, ImuEntry, Key, SamplingEntry, Stated

PLACEHOLDERS = {"todo", "tbd", "fixme", "xxx", "unknown", "none", "na", "source", ""}
SHORTEST_SOURCE = 8  # characters: a document and a page do not fit in less
CROSSING = (0.1, 5e4)  # s: where white noise meets the bias instability in units known
LONGEST_CROSSING = 1e5  # s
ASSUMED_RATE = 100.0  # Hz, of a unit that states neither rate nor bandwidth
NOISE_BANDWIDTH = 1.1107  # of a second-order Butterworth filter, in bandwidths
FINEST, COARSEST = 33, 8  # bits in a range


@dataclass(frozen=True, slots=True)
class PresetFinding:
    """One thing that is wrong ('error') or unusual ('warning'), where, and why."""

    severity: Literal["error", "warning"]
    place: str
    message: str


@dataclass(frozen=True, slots=True)
class _Sensor:
    """One triad of a preset as the rules see it: stated values by key."""

    name: str
    stated: Mapping[str, Stated]
    keys: Mapping[str, Key]
    bands: Mapping[str, Band]
    key_of: Mapping[str, str]
    grade: str | None
    output_rate: float | None

    def value(self, field: str) -> float:
        """The stated value of a term, in its key's unit; zero where it is not stated."""
        stated = self.stated.get(self.key_of[field])
        return 0.0 if stated is None else stated.value

    def si(self, field: str) -> float:
        """The same in SI."""
        return self.value(field) * self.keys[self.key_of[field]].unit

    def place(self, field: str) -> str:
        return f"{self.name}, {self.key_of[field]}"

    def shown(self, field: str) -> str:
        """'0.3 deg/h'."""
        return f"{self.value(field):g} {self.bands[self.key_of[field]].unit}"


def lint(source: catalogue.Source) -> list[PresetFinding]:
    """What is wrong with a preset's text, errors first; never raises for what is in it.

    A preset that cannot be loaded gets its faults alone: the rules need values.
    """
    faults = catalogue.faults(source, ImuEntry)
    if faults:
        return [PresetFinding("error", place or source.name, message) for place, message in faults]
    entry = catalogue.parse(source, ImuEntry)
    findings = list(_all(entry))
    return sorted(findings, key=lambda f: f.severity != "error")


def count(n: int, what: str) -> str:
    return f"{n or 'no'} {what}{'' if n == 1 else 's'}"


def grade_of(text: str) -> str | None:
    """The grade named first in a preset's `grade`, or None."""
    words = re.findall("[a-z]+", text.lower())
    return next((w for w in words if w in (*GRADES, REFERENCE)), None)


def _all(entry: ImuEntry) -> Iterator[PresetFinding]:
    grade = grade_of(entry.grade)
    sensors = [
        _sensor("gyro", entry, GYRO_KEYS, GYRO_BANDS, grade),
        _sensor("accel", entry, ACCEL_KEYS, ACCEL_BANDS, grade),
    ]
    sampling = {k: v for k, v in entry.sampling if isinstance(v, Stated)}
    yield from _provenance(entry, grade)
    for name, stated in (*((s.name, s.stated) for s in sensors), ("sampling", sampling)):
        yield from _sources(name, stated, entry.evidence)
    yield from _outputs(sensors, entry.sampling)
    if grade == REFERENCE:
        return
    if grade is None:
        known = ", ".join((*GRADES, REFERENCE))
        message = f"{entry.grade!r} names none of {known}: checked against all of them together"
        yield PresetFinding("warning", "grade", message)
    yield from _in_bands("sampling", sampling, SAMPLING_BANDS, grade)
    for sensor in sensors:
        outside = list(_in_bands(sensor.name, sensor.stated, sensor.bands, grade))
        yield from outside
        places = {f.place for f in outside}
        yield from _missing(sensor)
        if not places & {sensor.place("noise"), sensor.place("instability")}:
            yield from _crossing(sensor)
        yield from _drifts(sensor)
        yield from _resolution(sensor)
        yield from _bandwidth(sensor)


def _sensor(
    name: str,
    entry: ImuEntry,
    keys: Mapping[str, Key],
    bands: Mapping[str, Band],
    grade: str | None,
) -> _Sensor:
    rate = entry.sampling.output_rate_hz
    return _Sensor(
        name=name,
        stated=getattr(entry, name).stated(),
        keys=keys,
        bands=bands,
        key_of={key.field: text for text, key in keys.items()},
        grade=grade,
        output_rate=None if rate is None else rate.value,
    )


# --- where the values come from


def _provenance(entry: ImuEntry, grade: str | None) -> Iterator[PresetFinding]:
    if entry.evidence == "none" and grade != REFERENCE:
        message = (
            "'none' for a unit of a real grade: state where the values come from, "
            f"or call it grade {REFERENCE!r}"
        )
        yield PresetFinding("warning", "evidence", message)


def _sources(name: str, stated: Mapping[str, Stated], evidence: str) -> Iterator[PresetFinding]:
    for key, value in stated.items():
        place = f"{name}, {key}"
        words = re.sub("[^a-z]", "", value.source.lower())
        if words in PLACEHOLDERS:
            message = f"source = {value.source!r}: a placeholder; name the document and page"
            yield PresetFinding("error", place, message)
        elif len(value.source) < SHORTEST_SOURCE:
            message = f"source = {value.source!r}: too short to find; name the document and page"
            yield PresetFinding("warning", place, message)
        if value.kind == "assumed" and evidence != "none":
            message = f"{value.value:g} is assumed in a unit with evidence {evidence}"
            yield PresetFinding("warning", place, message)
        elif value.kind != "assumed" and evidence == "none":
            message = f"kind = {value.kind!r} without evidence: must be 'assumed'"
            yield PresetFinding("error", place, message)


def _missing(sensor: _Sensor) -> Iterator[PresetFinding]:
    missing = [
        ("bias", "every unit is the same"),
        ("noise", "samples have no noise"),
        ("instability", "no drift is simulated or predicted, so long rests look too good"),
        ("scale", "readings are taken for true to size"),
        ("misalignment", "axes are taken for square and true to the case"),
    ]
    if "g_sensitivity" in sensor.key_of:
        missing.append(("g_sensitivity", "gyros do not feel gravity"))
    stated_instead = {"misalignment": "non_orthogonality", "instability": "random_walk"}
    for field, effect in missing:
        other = stated_instead.get(field, field)
        if not sensor.value(field) and not sensor.value(other):
            message = f"not stated, so zero: {effect}"
            yield PresetFinding("warning", sensor.place(field), message)


# --- one value at a time


def _in_bands(
    name: str, stated: Mapping[str, Stated], bands: Mapping[str, Band], grade: str | None
) -> Iterator[PresetFinding]:
    for key, entry in stated.items():
        band, value = bands[key], entry.value
        low, high = band.of(grade)
        if value == 0 or low <= value <= high:
            continue
        range_text = f"{grade or 'any'} grade has {low:g} to {high:g} {band.unit} ({band.why})"
        meant = [f"{u} (then {v:.3g} {band.unit})" for u, v in slips(value, band.unit, (low, high))]
        end = f"; is it in {' or '.join(meant)}?" if meant else ""
        message = f"{value:g} {band.unit}: {range_text}{end}"
        yield PresetFinding("error" if meant else "warning", f"{name}, {key}", message)


# --- two values against each other


def _crossing(sensor: _Sensor) -> Iterator[PresetFinding]:
    """White noise against bias instability: see the top of this file."""
    noise, instability = sensor.si("noise"), sensor.si("instability")
    if not (noise and instability):
        return
    tau = (noise / instability) ** 2
    if CROSSING[0] <= tau <= CROSSING[1]:
        return
    shortest = 1 / (sensor.output_rate or ASSUMED_RATE)
    both = f"{sensor.shown('noise')} with a bias instability of {sensor.shown('instability')}"
    if tau < CROSSING[0]:
        why = f"white noise is below it after {tau:.2g} s already"
    else:
        why = f"white noise hides it for {tau:.2g} s"
    impossible = tau < shortest or tau > LONGEST_CROSSING
    hints = list(_crossing_hints(sensor, tau))
    severity = "error" if impossible or hints else "warning"
    end = f"; is {' or '.join(hints)}?" if hints else ""
    yield PresetFinding(severity, sensor.place("noise"), f"{both}: {why}{end}")


def _crossing_hints(sensor: _Sensor, tau: float) -> Iterator[str]:
    """Mix-ups of either value that would put the crossing where units have it."""
    for field, power in (("noise", 2), ("instability", -2)):
        key = sensor.key_of[field]
        unit, value = sensor.bands[key].unit, sensor.value(field)
        # the factors that would do, as a band for the value; the grade's band holds as well
        ends = sorted(value * (end / tau) ** (1 / power) for end in CROSSING)
        grade = sensor.bands[key].of(sensor.grade)
        span = max(ends[0], grade[0]), min(ends[1], grade[1])
        for other, right in slips(value, unit, span):
            yield f"{key} in {other} (then {right:.3g} {unit})"


def _drifts(sensor: _Sensor) -> Iterator[PresetFinding]:
    """Bias instability against what must lie above and below it."""
    bias, instability = sensor.si("bias"), sensor.si("instability")
    if bias and instability > bias:
        message = (
            f"{sensor.shown('instability')} in a run, but only {sensor.shown('bias')} from run to "
            "run: no one could measure the latter"
        )
        yield PresetFinding("error", sensor.place("instability"), message)
    # N^2/tau + K^2 tau/3 is least at tau = sqrt3 N/K
    floor = sqrt(2 * sensor.si("noise") * sensor.si("random_walk") / sqrt(3))
    if 0 < instability < 0.9 * floor:
        unit = sensor.bands[sensor.key_of["instability"]].unit
        least = floor / sensor.keys[sensor.key_of["instability"]].unit
        message = (
            f"{sensor.shown('instability')}: white noise and random walk alone leave "
            f"{least:.3g} {unit} at every averaging time"
        )
        yield PresetFinding("warning", sensor.place("instability"), message)


def _resolution(sensor: _Sensor) -> Iterator[PresetFinding]:
    step, noise, limit = sensor.si("resolution"), sensor.si("noise"), sensor.si("range")
    if not step:
        return
    rate = sensor.output_rate or ASSUMED_RATE
    if bandwidth := sensor.value("bandwidth"):
        rate = min(rate, 2 * NOISE_BANDWIDTH * bandwidth)
    if noise and step > 2 * noise * sqrt(rate):
        unit = sensor.bands[sensor.key_of["resolution"]].unit
        sample = noise * sqrt(rate) / sensor.keys[sensor.key_of["resolution"]].unit
        message = (
            f"{sensor.shown('resolution')}: more than twice the noise of a sample, {sample:.2g} "
            f"{unit}; readings will stick"
        )
        yield PresetFinding("warning", sensor.place("resolution"), message)
    if limit and not COARSEST <= (bits := log2(2 * limit / step)) <= FINEST:
        message = f"{sensor.shown('resolution')}: {bits:.0f} bits in {sensor.shown('range')}"
        yield PresetFinding("error", sensor.place("resolution"), message)


def _bandwidth(sensor: _Sensor) -> Iterator[PresetFinding]:
    bandwidth, rate = sensor.value("bandwidth"), sensor.output_rate
    if not rate or bandwidth <= rate / 2:
        return
    above = "the output rate" if bandwidth > rate else "half the output rate"
    message = f"{bandwidth:g} Hz: above {above}, {rate:g} Hz; faster motion is folded back"
    severity = "error" if bandwidth > rate else "warning"
    yield PresetFinding(severity, sensor.place("bandwidth"), message)


def _outputs(sensors: Sequence[_Sensor], sampling: SamplingEntry) -> Iterator[PresetFinding]:
    """A rounding that the chosen kind of output does not use."""
    unused = "increment_lsb" if sampling.output == "rate" else "resolution"
    for sensor in sensors:
        if sensor.value(unused):
            message = f"{sensor.shown(unused)}: without effect on output = {sampling.output!r}"
            yield PresetFinding("warning", sensor.place(unused), message)
