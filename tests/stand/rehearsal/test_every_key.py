"""Every key of a procedure: predictions and runs go together, whatever it says.

The procedures below set between them each key that there is. One key after another gets another
value, and the runs must come to what is then predicted; where a key changes neither, they still do.
A limit of a unit's constant changes the verdict, and what is looked for: it is tried by these.
"""

import tomllib
import types
from collections.abc import Iterator
from copy import deepcopy
from dataclasses import replace
from math import cos, pi, sin
from typing import Any, get_args

import pytest
from procedures import document
from pydantic import BaseModel

from stand import toml_files as catalogue
from stand.imu import load_imu
from stand.procedure.procedure import ProcedureEntry, procedure_from, table_of
from stand.rehearsal import scene
from stand.rehearsal.rehearse import rehearse
from stand.rehearsal.result import Verdict
from stand.rehearsal.verify import with_verification
from stand.simulation.settings import assembled
from stand.table.known_errors import stated

AMONG = 1000  # quantities compared at once in all these tests: chance makes none of them miss
SITE = """
[site]
latitude_deg = 48.5
longitude_deg = 30.0
height_m = 100.0
gravity_m_s2 = 9.81
deflection_north_arc_s = 5.0
deflection_east_arc_s = -5.0
"""
ERRORS = """
[table_errors]
drawn = true
base_tilt_arc_s = [200.0, -150.0]
base_azimuth_arc_s = 300.0
mounting_arc_s = [100.0, -150.0, 200.0]
[table_errors.axis.outer]
placement_arc_s = 120.0
encoder_once_arc_s = [150.0, -100.0]
encoder_twice_arc_s = [80.0, 60.0]
encoder_step_arc_s = 1.0
non_orthogonality_arc_s = 90.0
wobble_arc_s = 70.0
wobble_phase_deg = 30.0
rate_ripple_percent = 0.05
ripple_per_turn = 1
ripple_phase_deg = 40.0
"""
RESTS = f"""
title = "Rests"
description = "Half a turn and a quarter."
table = "precision"
{SITE}
[estimate]
methods = ["triad", "two-position", "six-position"]
offset_window_s = 8.0
sequences = "regular"
[move_limits]
rate_deg_s = 100.0
acceleration_deg_s2 = 100.0
jerk_deg_s3 = 400.0
[temperature]
time_s = [0.0, 60.0]
temperature_C = [25.0, 35.0]
[payload]
mass_kg = 1.0
offset_m = [0.01, 0.02, 0.03]
[require]
heading_deg = 5.0
pitch_deg = 1.0
roll_deg = 1.0
coverage = 2.0
guard = 0.1
method = "triad"
[[require.limit]]
part = "ring-laser"
grade = "any"
revision = "B"
heading_deg = 4.0
pitch_deg = 2.0
roll_deg = 2.0
{ERRORS}
[[step]]
kind = "dwell"
label = "first"
duration_s = 24.0
[[step]]
kind = "move"
label = "round"
rate_deg_s = 90.0
acceleration_deg_s2 = 70.0
jerk_deg_s3 = 300.0
joints_deg = {{ outer = 180.0 }}
[[step]]
kind = "dwell"
label = "second"
duration_s = 24.0
[[step]]
kind = "move"
label = "to an attitude"
attitude_deg = {{ roll = 4.0, yaw = 30.0, pitch = 6.0, sequence = "yaw-pitch-roll" }}
[[step]]
kind = "dwell"
label = "third"
duration_s = 24.0
"""
TURNS = f"""
title = "Turns"
table = "precision"
[site]
latitude_deg = 48.5
[estimate]
methods = ["carousel"]
{ERRORS}
[[step]]
kind = "rate"
label = "there and back"
axis = "outer"
rate_deg_s = 20.0
turns = 1.0
directions = "both"
acceleration_deg_s2 = 40.0
jerk_deg_s3 = 100.0
[[step]]
kind = "rate"
label = "for a time"
axis = "outer"
rate_deg_s = 24.0
duration_s = 20.0
[[step]]
kind = "sweep"
label = "two rates"
axis = "outer"
rates_deg_s = [18.0, -24.0]
turns = 1.0
directions = "one"
acceleration_deg_s2 = 40.0
jerk_deg_s3 = 100.0
[[step]]
kind = "sweep"
label = "two rates for a time"
axis = "outer"
rates_deg_s = [-20.0, 25.0]
duration_s = 20.0
"""
ROCKED = """
title = "Rocked"
table = "rocking-platform"
[site]
latitude_deg = 48.5
[estimate]
methods = ["inertial"]
[[step]]
kind = "dwell"
label = "rocking"
duration_s = 80.0
[[background]]
kind = "sine"
first = "rocking"
last = "rocking"
fade_s = 3.0
axes = { base_roll = { amplitude_deg = 1.0, frequency_hz = 0.2, phase_deg = 20.0 } }
[[background]]
kind = "scorsby"
first = "rocking"
last = "rocking"
fade_s = 3.0
period_s = 9.0
amplitude_deg = { base_pitch = 0.5 }
phase_deg = { base_pitch = 10.0 }
[[background]]
kind = "sway"
first = "rocking"
last = "rocking"
fade_s = 3.0
[background.axes]
base_yaw = { rms_deg = 0.3, frequency_hz = 0.1, damping = 0.2, cutoff_hz = 0.5 }
base_roll = { rms_deg = 0.2, psd_file = "berth.csv" }
[[background]]
kind = "vibration"
first = "rocking"
last = "rocking"
fade_s = 3.0
axes = { base_pitch = { rms_deg_s2 = 0.2, low_hz = 0.5, high_hz = 2.0 } }
"""
MOVED = """
title = "Moved"
table = "rocking-platform"
[site]
latitude_deg = 48.5
[estimate]
methods = ["triad"]
[[step]]
kind = "sine"
label = "sine"
duration_s = 5.0
fade_s = 2.0
axes = { base_roll = { amplitude_deg = 0.5, frequency_hz = 0.3, phase_deg = 20.0 } }
[[step]]
kind = "scorsby"
label = "scorsby"
duration_s = 9.0
fade_s = 3.0
period_s = 9.0
amplitude_deg = { base_pitch = 0.5 }
phase_deg = { base_pitch = 10.0 }
[[step]]
kind = "coning"
label = "coning"
duration_s = 5.0
fade_s = 2.0
axis = "Y1"
half_angle_deg = 0.3
frequency_hz = 0.3
[[step]]
kind = "sway"
label = "sway"
duration_s = 5.0
fade_s = 3.0
[step.axes]
base_yaw = { rms_deg = 0.2, frequency_hz = 0.1, damping = 0.2, cutoff_hz = 0.5 }
base_roll = { rms_deg = 0.1, psd_file = "berth.csv" }
[[step]]
kind = "vibration"
label = "vibration"
duration_s = 5.0
fade_s = 3.0
axes = { base_pitch = { rms_deg_s2 = 0.2, low_hz = 0.5, high_hz = 2.0 } }
[[step]]
kind = "profile"
label = "profile"
file = "slow.csv"
[[step]]
kind = "dwell"
label = "rest"
duration_s = 24.0
"""
# key of [require]: the rows that it limits begin so, its unit in SI, and its limit in FACES
CONSTANTS = {
    "gyro_bias_deg_h": (("gyro bias ",), pi / 180 / 3600, 10.0),
    "gyro_scale_ppm": (("gyro scale ",), 1e-6, 500.0),
    "accel_bias_ug": (("accel bias ",), 9.80665e-6, 100.0),
    "accel_scale_ppm": (("accel scale ",), 1e-6, 200.0),
    "misalignment_arc_s": (
        ("gyro misalignment ", "accel misalignment "),
        pi / 180 / 3600,
        100.0,
    ),
    "gyro_to_accel_arc_s": (("gyro to accel ",), pi / 180 / 3600, 50.0),
    "non_orthogonality_arc_s": (
        ("gyro non-orthogonality ", "accel non-orthogonality "),
        pi / 180 / 3600,
        100.0,
    ),
    "g_sensitivity_deg_h_g": (("gyro g sensitivity ",), pi / 180 / 3600 / 9.80665, 5.0),
}
LIMITS = "".join(f"{key} = {limit}\n" for key, (*_, limit) in CONSTANTS.items())
FACE = """
[[step]]
kind = "move"
label = "to {0}"
joints_deg = {{ outer = 0.0, middle = {1}, inner = {2} }}
[[step]]
kind = "dwell"
label = "{0}"
duration_s = 12.0
"""
PLACES = [
    ("Y1 up", 0.0, 0.0), ("Y1 down", 0.0, 180.0), ("Z1 down", 0.0, 90.0),
    ("Z1 up", 0.0, -90.0), ("X1 up", 90.0, 0.0), ("X1 down", -90.0, 0.0),
]  # fmt: skip
FACES = f"""
title = "Faces"
table = "precision"
[site]
latitude_deg = 48.5
[estimate]
methods = ["calibration"]
[require]
{LIMITS}
[[require.limit]]
part = "stim300"
{LIMITS}
""" + "".join(FACE.format(*place) for place in PLACES)


def profile(amplitude: float, period: float) -> str:
    """There and back once: ``amplitude (1 - cos x)^2 / 4``, which begins and ends at rest."""
    rows = ["time_s,outer_deg,outer_deg_s,outer_deg_s2"]
    for k in range(41):
        c, s, w = cos(2 * pi * k / 40), sin(2 * pi * k / 40), 2 * pi / period
        rate, acceleration = w * (1 - c) * s, w**2 * (1 + c - 2 * c**2)
        half = amplitude / 2
        values = k * period / 40, half * (1 - c) ** 2 / 2, half * rate, half * acceleration
        rows.append(",".join(f"{value:.9f}" for value in values))
    return "\n".join(rows) + "\n"


DENSITY = "frequency_hz,density_deg2_hz\n0.05,0\n0.1,{}\n0.3,{}\n0.4,0\n"
FILES = {
    "berth.csv": DENSITY.format(0.2, 0.2),
    "steep.csv": DENSITY.format(0.3, 0.1),
    "slow.csv": profile(1.0, 8.0),
    "other.csv": profile(2.0, 12.0),
}
BASES = {"rests": RESTS, "turns": TURNS, "rocked": ROCKED, "moved": MOVED, "faces": FACES}
RUNS = {"rests": 30, "turns": 30, "rocked": 12, "moved": 30, "faces": 30}
UNITS = {
    "rests": "hg9900",
    "turns": "hg9900",
    "rocked": "hg9900",
    "moved": "ring-laser",
    "faces": "stim300",  # its sheet states all that is required
}
# what a number times 1.25, or four times of an error, is not allowed to be; and all that is text
OTHER: dict[str, Any] = {
    "title": "Another",
    "description": "Another.",
    "label": "another",
    "table": "mid-class",
    "sequences": "published",
    "gravity_m_s2": 9.78,
    "temperature_C": [25.0, 60.0],
    "guard": 0.2,
    "method": "two-position",
    "part": "hg9900",
    "grade": "another",
    "revision": "C",
    "encoder_step_arc_s": 3.0,
    "wobble_phase_deg": 120.0,
    "ripple_phase_deg": 130.0,
    "ripple_per_turn": 2,
    "sequence": "yaw-roll-pitch",
    "axis": "X1",
    "psd_file": "steep.csv",
    "file": "other.csv",
    "mounting_arc_s": [400.0, -600.0, 800.0],
    "base_azimuth_arc_s": 1200.0,
}
METHODS = {
    "rests": ["triad"],
    "turns": ["carousel"],  # the only one for turns
    "rocked": ["fine"],
    "moved": ["triad", "single-gyro"],
}
FIRST = {"kind"}  # says which model it is: another kind is another case


def leaves(data: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Paths of all that is a value: text, number, yes or no, or a list of these."""
    if isinstance(data, dict):
        for key, value in data.items():
            yield from leaves(value, (*path, key))
    elif isinstance(data, list) and data and isinstance(data[0], dict):
        for k, value in enumerate(data):
            yield from leaves(value, (*path, k))
    else:
        yield path


def another(key: str, value: Any, in_errors: bool) -> Any:
    """Another value of a key."""
    if key in OTHER:
        assert OTHER[key] != value, key
        return OTHER[key]
    if key == "directions":
        return {"one": "both", "both": "one"}[value]
    if isinstance(value, bool):
        return not value
    if isinstance(value, list):
        return [another("", one, in_errors) for one in value]
    assert isinstance(value, int | float), key
    return (4.0 if in_errors else 1.25) * value


def changed(base: str, *paths: tuple[Any, ...]) -> dict[str, Any]:
    """The data of a base with another value at each path."""
    data = tomllib.loads(BASES[base])
    for path in paths:
        change(base, data, path)
    return data


def change(base: str, data: dict[str, Any], path: tuple[Any, ...]) -> None:
    """Give what lies at a path another value, in place."""
    at: Any = data
    for key in path[:-1]:
        at = at[key]
    if path[-1] == "methods":
        at["methods"] = METHODS[base]
        return
    at[path[-1]] = another(path[-1], at[path[-1]], path[0] == "table_errors")
    if path[-1] == "label" and base == "rocked":  # what names it goes along
        for behind in data["background"]:
            behind["first"] = behind["last"] = at["label"]


def cases() -> Iterator[Any]:
    """Two keys that lie far apart at a time: half the runs, and who is at fault is soon found."""
    for base, text in BASES.items():
        if base == "faces":  # its own keys change no run: see the verdicts below
            continue
        paths = [path for path in leaves(tomllib.loads(text)) if is_tried(base, path)]
        half = (len(paths) + 1) // 2
        for k, path in enumerate(paths[:half]):
            both = (path, *paths[half + k : half + k + 1])
            name = "+".join(".".join(map(str, one)) for one in both)
            yield pytest.param(base, both, id=f"{base}-{name}")


def is_tried(base: str, path: tuple[Any, ...]) -> bool:
    """Whether a key is one that can have another value alone."""
    if base == "turns" and path[-1] == "axis":
        return False
    return path[-1] not in FIRST | {"first", "last"}  # of a background: there is but one step


def verified(base: str, data: dict[str, Any], folder: Any):
    for name, text in FILES.items():
        (folder / name).write_text(text, encoding="utf-8")
    path = str(folder / "case.toml")
    procedure = procedure_from(catalogue.Source("case", path, document(data)))
    unit = load_imu(UNITS[base])
    # gyros that feel the warmth: 0.01 deg/h per K
    unit = replace(unit, gyro=replace(unit.gyro, bias_temperature=5e-8))
    site = procedure.entry.site.site()
    asked = assembled(procedure, unit, table_of(procedure), site, 20)
    result = rehearse(asked)
    assert result.feasible, result.findings
    made = with_verification(result, asked, RUNS[base], workers=1).verification
    assert made is not None
    return result, made


def off(made) -> list[Any]:
    return [
        (a.method, a.label, a.quantity, a.ratio)
        for a in made.achieved
        if replace(a, among=AMONG).agrees is False
    ]


@pytest.mark.slow
@pytest.mark.parametrize(("base", "paths"), list(cases()))
def test_runs_come_to_what_other_values_predict(base, paths, tmp_path):
    result, made = verified(base, changed(base, *paths), tmp_path)
    assert off(made) == []
    assert made.refused == ()
    assert any(a.ratio is not None for a in made.achieved)
    assert any(p.determined for p in result.predictions)


LONG = {"faces"}  # over 2 s


@pytest.mark.parametrize(
    "base", [pytest.param(b, marks=[pytest.mark.slow] * (b in LONG)) for b in BASES]
)
def test_so_do_they_as_it_stands(base, tmp_path):
    _, made = verified(base, tomllib.loads(BASES[base]), tmp_path)
    assert off(made) == []
    assert made.refused == ()


@pytest.mark.parametrize("key", ["encoder_once_arc_s", "wobble_arc_s", "mounting_arc_s"])
def test_a_key_that_is_not_read_is_noticed(key, tmp_path, monkeypatch):
    """The contract broken once: a rehearsal that looks at the table's class alone."""
    monkeypatch.setattr(scene, "stated", lambda table, entry, ideal: stated(table, None, ideal))
    path = (
        ("table_errors", key) if key == "mounting_arc_s" else ("table_errors", "axis", "outer", key)
    )
    _, made = verified("rests", changed("rests", path), tmp_path)
    assert off(made) != []


# --- limits of a unit's constants


def faces(unit: str, require: dict[str, Any]):
    """A rehearsal of the six faces with these limits, at a low rate."""
    data = tomllib.loads(FACES) | {"require": require}
    procedure = procedure_from(catalogue.Source("case", "case.toml", document(data)))
    return rehearse(assembled(procedure, load_imu(unit), table_of(procedure), rate_hz=20))


def worst(result, begins: tuple[str, ...]) -> float:
    return max(p.sigma for p in result.predictions if p.quantity.startswith(begins))


@pytest.fixture(scope="module")
def six_faces():
    return faces("stim300", {"gyro_bias_deg_h": 1e3})


@pytest.mark.parametrize("key", CONSTANTS)
def test_the_limit_of_a_constant_decides(key, six_faces):
    """Twice the worst axis's sigma against it, 10 % either way: a quarter above, a fifth below."""
    begins, unit, _ = CONSTANTS[key]
    expanded = 2 * worst(six_faces, begins) / unit
    own = {"part": "stim300", key: 0.8 * expanded}
    (kept,) = faces("stim300", {key: 1.25 * expanded}).judgements
    (missed,) = faces("stim300", {key: 1.25 * expanded, "limit": [own]}).judgements
    (others,) = faces("stim300", {key: 1.25 * expanded, "limit": [own | {"part": "x"}]}).judgements
    assert [kept.verdict, missed.verdict, others.verdict] == [
        Verdict.PASS, Verdict.FAIL, Verdict.PASS,
    ]  # fmt: skip
    assert kept.sigma == pytest.approx(worst(six_faces, begins), rel=1e-9)
    assert kept.required == pytest.approx(1.25 * expanded * unit, rel=1e-9)
    assert missed.required == pytest.approx(0.8 * expanded * unit, rel=1e-9)


@pytest.mark.parametrize("key", [key for key in CONSTANTS if "bias" not in key])
def test_what_is_limited_is_looked_for(key):
    """The gyros of this sheet state nothing but bias and noise: the rest is told if it matters."""
    begins = CONSTANTS[key][0]
    plain, asked = (faces("ln200s", r) for r in ({"gyro_bias_deg_h": 1.0}, {key: 1.0}))
    told = [
        {p.quantity for p in r.predictions if p.quantity.startswith(begins)} for r in (plain, asked)
    ]
    assert told[0] < told[1]


# --- that it is every key


def models(annotation: Any) -> Iterator[type[BaseModel]]:
    """The models that an annotation speaks of, unions and containers opened."""
    if isinstance(annotation, type) and not isinstance(annotation, types.GenericAlias):
        if issubclass(annotation, BaseModel):
            yield annotation
        return
    for part in get_args(annotation):
        yield from models(part)


def every_key(model: type[BaseModel], seen: set[type[BaseModel]]) -> Iterator[tuple[str, str]]:
    """All keys of a model and of those within it."""
    seen.add(model)
    for name, field in model.model_fields.items():
        inner = list(models(field.annotation))
        yield model.__name__, name
        for one in inner:
            if one not in seen:
                yield from every_key(one, seen)


def keys_set(entry: BaseModel) -> Iterator[tuple[str, str]]:
    """The keys that an entry was given."""
    for name in entry.model_fields_set:
        yield type(entry).__name__, name
        yield from _within(getattr(entry, name))


def _within(value: Any) -> Iterator[tuple[str, str]]:
    if isinstance(value, BaseModel):
        yield from keys_set(value)
    elif isinstance(value, dict):
        for one in value.values():
            yield from _within(one)
    elif isinstance(value, tuple):
        for one in value:
            yield from _within(one)


def test_every_key_there_is_has_a_case():
    """A key that a model gets and no procedure above sets would be one that nobody has tried."""
    there = set(every_key(ProcedureEntry, set()))
    assert {
        ("AxisSetEntry", "wobble_arc_s"),
        ("SwayEntry", "psd_file"),
        ("RateStep", "turns"),
    } <= there
    tried: set[tuple[str, str]] = set()
    for name, text in BASES.items():
        source = catalogue.Source(name, f"{name}.toml", text)
        tried |= set(keys_set(catalogue.parse(source, ProcedureEntry)))
    assert there - tried == set()
    # and each of them gets another value, but for those that say what the case is
    touched = {path[-1] for text in BASES.values() for path in leaves(tomllib.loads(text))}
    assert {"drawn", "latitude_deg", "fade_s", "turns"} <= touched
    assert deepcopy(OTHER).keys() <= touched
