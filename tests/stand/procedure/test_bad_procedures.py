"""Every way to spoil a procedure by one key: a line with file, step and key, exit code 2."""

import copy
import json
import math
import tomllib

import pytest
from hypothesis import given
from hypothesis import strategies as st
from procedures import document

from stand import toml_files as catalogue
from stand.errors import StandError
from stand.procedure.procedure import procedure_from

REQUIRED = (
    "\n[require]\nheading_deg = 1.0\npitch_deg = 0.1\nroll_deg = 0.1\ncoverage = 2.0\nguard = 0.1\n"
)
EVERY_KIND = """
title = "Every kind of step"
description = "Each once."
table = "mid-class"
[site]
latitude_deg = 48.5
height_m = 10.0
[estimate]
methods = ["triad"]
offset_window_s = 5.0
[move_limits]
rate_deg_s = 30.0
acceleration_deg_s2 = 30.0
jerk_deg_s3 = 120.0
[temperature]
time_s = [0, 100]
temperature_C = [20, 30]
[[step]]
kind = "dwell"
label = "rest"
duration_s = 20
[[step]]
kind = "move"
label = "turn"
joints_deg = { outer = 90 }
rate_deg_s = 20
[[step]]
kind = "rate"
label = "slow"
axis = "outer"
rate_deg_s = 20
turns = 1
directions = "both"
[[step]]
kind = "sine"
label = "rocking"
duration_s = 30
fade_s = 5
[step.axes]
base_roll = { amplitude_deg = 2, frequency_hz = 0.1 }
[[step]]
kind = "sway"
label = "swaying"
duration_s = 30
fade_s = 5
[step.axes]
base_pitch = { rms_deg = 1, frequency_hz = 0.2, damping = 0.2 }
"""


def sources():
    for name in catalogue.ids("procedures"):
        yield name, catalogue.find("procedures", "procedure", name).text + REQUIRED
    yield "every-kind", EVERY_KIND


DATA = {name: tomllib.loads(text) for name, text in sources()}


def keys_of(value, path=()):
    """Paths to every key of nested tables."""
    if isinstance(value, dict):
        for key, item in value.items():
            yield (*path, key)
            yield from keys_of(item, (*path, key))
    elif isinstance(value, list):
        for number, item in enumerate(value):
            yield from keys_of(item, (*path, number))


def at(data, path):
    for key in path:
        data = data[key]
    return data


def told(data):
    """The line of refusal; '' where it is taken."""
    try:
        procedure_from(catalogue.Source("case", "case.toml", document(data)))
    except StandError as error:
        return str(error)
    return ""


def check_line(line, data, path, *words):
    """One line that begins with the file, names the step by number or label, and says a word."""
    assert line.startswith("case.toml: "), line
    assert line.isprintable()
    if path[0] in ("step", "background") and len(path) > 2:
        entry = at(data, path[:2])
        named = (f"{path[0]} {path[1] + 1}", str(entry.get("label", "")) or "?")
        assert any(name in line for name in named), (line, named)
    assert any(word in line for word in words), (line, words)


PLACES = [(name, path) for name, data in DATA.items() for path in keys_of(data)]


def named(place):
    name, path = place
    return f"{name}:{'.'.join(map(str, path))}"


def misspelt(key):
    """Two letters in the middle changed places, or the last one left out."""
    k = len(key) // 2
    turned = key[: k - 1] + key[k] + key[k - 1] + key[k + 1 :]
    return turned if turned != key else key[:-1]


@pytest.mark.parametrize("name", DATA)
def test_the_whole_ones_are_taken(name):
    assert told(DATA[name]) == ""


@pytest.mark.parametrize("place", PLACES, ids=named)
def test_every_key_misspelt_in_turn(place):
    name, path = place
    data = copy.deepcopy(DATA[name])
    wrong = misspelt(path[-1])
    here = at(data, path[:-1])
    here[wrong] = here.pop(path[-1])
    # without its kind nobody knows what else a step may hold
    check_line(told(data), DATA[name], path, wrong, *(["kind"] if path[-1] == "kind" else []))


@pytest.mark.parametrize("place", PLACES, ids=named)
@pytest.mark.parametrize("wrong", ["nonsense of a type", [[True]], {"a": {"b": 1}}], ids=type)
def test_every_value_of_a_wrong_type(place, wrong):
    name, path = place
    data = copy.deepcopy(DATA[name])
    right = at(data, path)
    if isinstance(right, str) and isinstance(wrong, str) and path[-1] in TEXTS:
        wrong = 7  # any text is right there; of tables the catalogue is asked later
    at(data, path[:-1])[path[-1]] = wrong
    check_line(told(data), DATA[name], path, str(path[-1]))


TEXTS = ("title", "description", "label", "table", "first", "last")
NUMBERS = [(n, p) for n, p in PLACES if isinstance(at(DATA[n], p), int | float)]
TIMES = [(n, p) for n, p in NUMBERS if p[-1].endswith("_s") and not p[-1].endswith("deg_s")]
ENDINGS = ("_s", "_deg", "_m", "_deg_s", "_hz", "_deg_s2", "_deg_s3")


@pytest.mark.parametrize("place", TIMES, ids=named)
@pytest.mark.parametrize("value", [-1.0, math.inf, math.nan])
def test_times_that_are_none(place, value):
    name, path = place
    data = copy.deepcopy(DATA[name])
    at(data, path[:-1])[path[-1]] = value
    check_line(told(data), DATA[name], path, path[-1])


@pytest.mark.parametrize("place", [p for p in NUMBERS if p[1][-1].endswith(ENDINGS)], ids=named)
def test_units_that_are_not_known(place):
    """rate_deg_s told as rate_rad_s, duration_s as duration_min, height_m as height_ft."""
    name, path = place
    other = {"s": "min", "deg": "rad", "m": "ft", "hz": "rpm", "s2": "s", "s3": "s"}
    first, _, unit = path[-1].rpartition("_")
    wrong = (
        f"{first}_{other[unit]}" if "_deg_" not in path[-1] else path[-1].replace("_deg_", "_rad_")
    )
    data = copy.deepcopy(DATA[name])
    here = at(data, path[:-1])
    here[wrong] = here.pop(path[-1])
    check_line(told(data), DATA[name], path, wrong)


def stretches(data):
    """Steps that methods estimate from."""
    return [step for step in data["step"] if step["kind"] in ("dwell", "rate", "sweep")]


@pytest.mark.parametrize("name", [n for n in DATA if len(stretches(DATA[n])) > 1])
def test_labels_twice(name):
    data = copy.deepcopy(DATA[name])
    first, *_, last = stretches(data)
    last["label"] = first["label"]
    number = next(k for k, step in enumerate(data["step"], start=1) if step is last)
    line = told(data)
    assert line.startswith(f'case.toml: step {number} "{first["label"]}", label: ')
    assert line.isprintable()


@given(st.sampled_from(PLACES), st.text("abcdefghij_", min_size=1, max_size=12))
def test_any_other_name_of_a_key(place, wrong):
    name, path = place
    data = copy.deepcopy(DATA[name])
    here = at(data, path[:-1])
    if wrong in here:
        return
    here[wrong] = here.pop(path[-1])
    line = told(data)
    if line:  # a base's axis may bear another's name; nothing else may
        check_line(line, DATA[name], path, wrong, str(path[-1]))
    else:
        assert path[-2] in ("axes", "joints_deg", "attitude_deg")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("duration_s = 60", "duration = 60"), ('step 2 "X1 up"', "duration")),
        (("duration_s = 60", "duration_s = -60"), ('step 2 "X1 up"', "duration_s", "-60")),
        (('label = "X1 down"', 'label = "X1 up"'), ("X1 up",)),
    ],
)
def test_the_command_says_it_in_a_line(change, words, tmp_path, stand_command):
    text = catalogue.find("procedures", "procedure", "six-position").text.replace(*change, 1)
    path = tmp_path / "mine.toml"
    path.write_text(text, encoding="utf-8")
    outcome = stand_command("rehearse", path, "--json")
    assert outcome.code == 2
    assert outcome.out == ""
    assert outcome.err.count("\n") == 1
    assert "mine.toml" in outcome.err
    for word in words:
        assert word in outcome.err, json.dumps(outcome.err)
