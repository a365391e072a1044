"""Procedures: units at the door, and every fault told by file, step, key, value, allowed."""

import copy

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from procedures import document

from alignment import ESTIMATORS
from alignment.angles import Sequence, SequenceRule
from stand.errors import StandError
from stand.procedure.procedure import Procedure, load_procedure, procedure_from
from stand.procedure.steps import DwellStep, MoveStep
from stand.toml_files import Source

HEAD = """title = "T"
[site]
latitude_deg = 48.5
[estimate]
methods = ["six-position"]
"""
DWELL = """[[step]]
kind = "dwell"
label = "A"
duration_s = 60
"""
MOVE = """[[step]]
kind = "move"
label = "M"
"""
METHODS = ", ".join(ESTIMATORS)
KINDS = (
    "'dwell', 'move', 'rate', 'sweep', 'sine', 'scorsby', 'coning', 'sway', 'vibration', 'profile'"
)
NOTHING = (
    "step: no dwell, rate or sweep to estimate from, must have at least one "
    "(or estimate, methods = [])"
)
JOINTS = "base_pitch, base_roll, base_yaw, inner, middle, outer"


def checked(text: str) -> Procedure:
    return procedure_from(Source("p", "p.toml", text))


def refusal(text: str) -> str:
    with pytest.raises(StandError) as caught:
        checked(text)
    return str(caught.value)


def test_a_procedure_in_si():
    text = HEAD + "offset_window_s = 5\nsequences = 'published'\n" + DWELL
    procedure = checked(text.replace("48.5", "48.5\nheight_m = 120\ngravity_m_s2 = 9.81"))
    site = procedure.entry.site.site()
    assert site.latitude == pytest.approx(0.8464846872172498, rel=1e-15)  # 48.5 pi / 180
    assert (site.height, site.gravity) == (120.0, 9.81)
    options = procedure.entry.estimate.options()
    assert (options.offset_window, options.rule) == (5.0, SequenceRule.PUBLISHED)


def test_steps_keep_their_order_and_defaults():
    attitude = "attitude_deg = { yaw = 30, sequence = 'yaw-roll-pitch' }\n"
    entry = checked(HEAD + MOVE + attitude + DWELL).entry
    move, dwell = entry.step
    assert isinstance(move, MoveStep)
    assert isinstance(dwell, DwellStep)
    assert move.attitude_deg is not None
    assert (move.attitude_deg.roll, move.attitude_deg.yaw, move.attitude_deg.pitch) == (0, 30, 0)
    assert move.attitude_deg.sequence is Sequence.YAW_ROLL_PITCH
    assert (dwell.label, dwell.duration_s) == ("A", 60.0)
    assert (entry.table, entry.estimate.offset_window_s) == ("laboratory", 10.0)


@pytest.mark.parametrize(
    ("text", "line"),
    [
        (
            HEAD + DWELL + DWELL.replace("dwell", "spin").replace("A", "S"),
            f"step 2 \"S\", kind = 'spin': must be one of {KINDS}",
        ),
        (
            HEAD + DWELL.replace('kind = "dwell"\n', ""),
            f'step 1 "A", kind: must be one of {KINDS}',
        ),
        (
            HEAD + DWELL.replace("duration_s", "duration"),
            "step 1 \"A\": unknown key 'duration': did you mean duration_s? "
            "known: duration_s, kind, label",
        ),
        (
            HEAD.replace("[site]", "[place]") + DWELL,
            "unknown key 'place': known: background, description, estimate, "
            "move_limits, payload, require, site, step, table, table_errors, temperature, title",
        ),
        (
            HEAD + DWELL.replace("60", "nan"),
            'step 1 "A", duration_s = nan: must be a finite number',
        ),
        (
            HEAD + DWELL.replace("60", "inf"),
            'step 1 "A", duration_s = inf: must be a finite number',
        ),
        (HEAD + DWELL.replace("60", "-3"), 'step 1 "A", duration_s = -3: must be greater than 0'),
        (HEAD + DWELL.replace("60", "0"), 'step 1 "A", duration_s = 0: must be greater than 0'),
        (
            HEAD + DWELL.replace("60", "true"),
            'step 1 "A", duration_s = True: must be a valid number',
        ),
        (
            HEAD + DWELL.replace("60", "1e9"),
            'step 1 "A", duration_s = 1000000000.0: must be less than or equal to 2592000',
        ),
        (
            HEAD + DWELL + DWELL.replace("60", "5").replace("A", "B"),
            'step 2 "B", duration_s = 5: must be at least offset_window_s = 10',
        ),
        (
            HEAD + DWELL + MOVE + "joints_deg = { outer = 1 }\nattitude_deg = { yaw = 1 }\n",
            'step 2 "M": joints_deg, attitude_deg: has both, must have one of them',
        ),
        (
            HEAD + MOVE + DWELL,
            'step 1 "M": joints_deg, attitude_deg: has neither, must have one of them',
        ),
        (
            HEAD + MOVE + "joints_deg = { outr = 1 }\n" + DWELL,
            f"step 1 \"M\": joints_deg: unknown joint 'outr': did you mean outer? known: {JOINTS}",
        ),
        (
            HEAD + MOVE + "joints_deg = { outer = nan }\n" + DWELL,
            'step 1 "M", joints_deg, outer = nan: must be a finite number',
        ),
        (
            HEAD + MOVE + "joints_deg = { outer = 36001 }\n" + DWELL,
            'step 1 "M", joints_deg, outer = 36001: must be less than or equal to 36000',
        ),
        (
            HEAD + MOVE + "attitude_deg = { yaw = 1, sequence = 'roll-yaw-pitch' }\n" + DWELL,
            "step 1 \"M\", attitude_deg, sequence = 'roll-yaw-pitch': "
            "must be 'yaw-pitch-roll' or 'yaw-roll-pitch'",
        ),
        (
            HEAD + MOVE + "joints_deg = { outer = 1 }\nrate_deg_s = 0\n" + DWELL,
            'step 1 "M", rate_deg_s = 0: must be greater than or equal to 0.001',
        ),
        (
            HEAD + DWELL + MOVE + "joints_deg = { outer = 1 }\n" + DWELL,
            'step 3 "A", label: step 1 has it too, each stretch to estimate from must have its own',
        ),
        (
            HEAD + DWELL.replace('"A"', '" "'),
            "step 1 \" \", label: ' ': must be printable text in one line",
        ),
        (
            HEAD + MOVE + "joints_deg = { outer = 1 }\n",
            NOTHING,
        ),
        ("step = []\n" + HEAD, NOTHING),
        (HEAD, "step: required, but missing"),
        ("step = 1\n" + HEAD, "step = 1: must be an array"),
        ("step = [1]\n" + HEAD, "step 1 = 1: must be a table"),
        (HEAD.replace("[site]", "[[site]]") + DWELL, "site = an array: must be a table"),
        (
            HEAD.replace("48.5", "95") + DWELL,
            "site, latitude_deg = 95: must be less than or equal to 90",
        ),
        (
            HEAD.replace("48.5", "-90.1") + DWELL,
            "site, latitude_deg = -90.1: must be greater than or equal to -90",
        ),
        (
            HEAD.replace("48.5", '"48.5"') + DWELL,
            "site, latitude_deg = '48.5': must be a valid number",
        ),
        (
            HEAD.replace("six-position", "six-positon") + DWELL,
            "estimate, methods: unknown method 'six-positon': did you mean six-position or "
            "multi-position or two-position? "
            f"known: {', '.join(sorted(ESTIMATORS))}",
        ),
        (
            HEAD.replace('"six-position"', '"triad", "triad"') + DWELL,
            f"estimate, methods: must name some of {METHODS}, each once",
        ),
        (
            HEAD + "offset_window_s = 0\n" + DWELL,
            "estimate, offset_window_s = 0: must be greater than 0",
        ),
        (
            HEAD + "[move_limits]\njerk_deg_s3 = -1\n" + DWELL,
            "move_limits, jerk_deg_s3 = -1: must be greater than or equal to 0.001",
        ),
        (
            HEAD + "[[step\n",
            "not valid TOML: Expected ']]' at the end of an array declaration "
            "(at line 6, column 7)",
        ),
        ("", "title: required, but missing (and 3 more)"),
    ],
)
def test_faults(text, line):
    assert refusal(text) == f"p.toml: {line}"


def test_a_dwell_may_be_short_where_no_offset_is_taken():
    short = HEAD.replace("six-position", "triad") + DWELL.replace("60", "5")
    assert isinstance(checked(short).entry.step[0], DwellStep)


def test_a_dwell_as_long_as_the_window_is_long_enough():
    step = checked(HEAD + DWELL.replace("60", "10")).entry.step[0]
    assert isinstance(step, DwellStep)
    assert step.duration_s == 10.0


def test_a_faults_line_names_step_from_one():
    told = str(checked(HEAD + DWELL).fault(0, "rate_deg_s", 500.0, "at most 200"))
    assert told == 'p.toml: step 1 "A", rate_deg_s = 500.0: at most 200'


# --- hypothesis: anything at all is a procedure or one line

GOOD = {
    "title": "T",
    "site": {"latitude_deg": 48.5, "height_m": 10.0},
    "estimate": {"methods": ["triad"], "offset_window_s": 4.0},
    "move_limits": {"rate_deg_s": 30.0},
    "step": [
        {"kind": "move", "label": "M", "joints_deg": {"outer": 30}},
        {"kind": "dwell", "label": "A", "duration_s": 12},
        {"kind": "move", "label": "N", "attitude_deg": {"roll": 10}, "jerk_deg_s3": 100.0},
        {"kind": "dwell", "label": "B", "duration_s": 13},
    ],
}
KEYS = ["kind", "label", "duration_s", "joints_deg", "outer", "step", "site", "methods", "tag", ""]
LEAVES = (
    st.none().map(lambda _: True)
    | st.integers(-(2**70), 2**70)
    | st.floats()
    | st.text(st.characters(exclude_categories=["Cs", "Cc"]), max_size=8)
    | st.sampled_from(["dwell", "move", "A", "B", "six-position", "yaw-pitch-roll"])
)
VALUES = st.recursive(
    LEAVES,
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(st.sampled_from(KEYS), inner, max_size=3)
    ),
    max_leaves=6,
)


def places(value: object, path: tuple = ()) -> list[tuple]:
    """Paths to everything inside a nested value."""
    inner = value.items() if isinstance(value, dict) else enumerate(value)
    found = []
    for key, item in inner:
        found.append((*path, key))
        if isinstance(item, dict | list):
            found += places(item, (*path, key))
    return found


def edited(path: tuple, change: str, value: object) -> dict:
    """`GOOD` with the value at `path` replaced, left out, or joined by a new one."""
    data = copy.deepcopy(GOOD)
    here: object = data
    for key in path[:-1]:
        here = here[key]
    if change == "replace":
        here[path[-1]] = value
    elif change == "leave out":
        del here[path[-1]]
    elif isinstance(here, dict):
        here["extra" if path[-1] == "title" else "tag"] = value
    else:
        here.append(value)
    return data


def outcome(data: dict) -> Procedure | str:
    try:
        return checked(document(data))
    except StandError as error:
        return str(error)


def test_the_good_one_is_good():
    assert isinstance(outcome(GOOD), Procedure)


@settings(max_examples=400)
@given(
    st.sampled_from(places(GOOD)),
    st.sampled_from(["replace", "leave out", "add"]),
    VALUES,
)
def test_any_edit_gives_a_procedure_or_one_line(path, change, value):
    told = outcome(edited(path, change, value))
    if isinstance(told, str):
        assert told.startswith("p.toml: ")
        assert told.isprintable()
    if change == "add" and isinstance(path[-1], str):
        assert isinstance(told, str)
        assert "tag" in told or "extra" in told


@given(st.dictionaries(st.sampled_from(KEYS), VALUES, max_size=4))
def test_any_table_gives_one_line(data):
    told = outcome(data)
    assert isinstance(told, str)
    assert told.startswith("p.toml: ")
    assert told.isprintable()


@given(st.text())
def test_any_text_gives_one_line(text):
    told = refusal(text)
    assert told.startswith("p.toml: ")
    assert told.isprintable()


@pytest.mark.parametrize(
    ("profile", "said"),
    [
        ("time_s = [0, 10]\ntemperature_C = [20]", "time_s has 2 values, temperature_C 1"),
        ("time_s = [0, 0]\ntemperature_C = [20, 30]", r"time_s = \[0.0, 0.0\]: must increase"),
        ("time_s = []\ntemperature_C = []", "at least one"),
        ("time_s = [0]\ntemperature_C = [900]", "less than or equal to 200"),
    ],
)
def test_temperature_profiles_are_checked(tmp_path, profile, said):
    path = tmp_path / "warm.toml"
    path.write_text(
        f'title = "t"\n[site]\nlatitude_deg = 1\n[estimate]\nmethods = ["triad"]\n'
        f'[temperature]\n{profile}\n[[step]]\nkind = "dwell"\nlabel = "a"\nduration_s = 5\n'
    )
    with pytest.raises(StandError, match=said) as caught:
        load_procedure(str(path))
    assert str(caught.value).startswith(f"{path}: temperature")
