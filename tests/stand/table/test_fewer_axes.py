"""Tables of one, two or three axes; the lint of a table's file."""

import numpy as np
import pytest

from alignment.angles import C_nb_from_angles, Sequence
from stand import toml_files as catalogue
from stand.errors import StandError
from stand.motion.missing_axes import same_vertical
from stand.motion.planner import plan
from stand.physics.mjcf import describe, load_model
from stand.procedure.procedure import load_procedure, procedure_from
from stand.table.joints import JOINTS
from stand.table.lint import lint
from stand.table.table import table_from

STAND = describe(load_model())
AXIS = "rate_deg_s = 100.0\nacceleration_deg_s2 = 100.0\njerk_deg_s3 = 500.0\n"
HEAD = 'title = "Mine"\nsource = "data sheet rev. 3, p. 7"\n'
SITE = 'title = "x"\n[site]\nlatitude_deg = 48.5\n[estimate]\nmethods = ["triad"]\n'
DWELL = '[[step]]\nkind = "dwell"\nlabel = "d"\nduration_s = 10.0\n'


def text(*axes: str, more: str = "") -> str:
    return HEAD + more + "".join(f"[axis.{name}]\n{AXIS}" for name in axes)


def table(*axes: str, more: str = ""):
    return table_from(catalogue.Source("mine", "mine.toml", text(*axes, more=more)))


def procedure(step: str):
    return procedure_from(catalogue.Source("p", "p.toml", SITE + step + DWELL))


def move(target: str) -> str:
    return f'[[step]]\nkind = "move"\nlabel = "m"\n{target}\n'


def test_an_axis_that_is_left_out_is_not_there():
    two = table("outer", "inner")
    assert two.there == ("outer", "inner")
    assert two.missing == ("base_roll", "base_pitch", "base_yaw", "middle")
    off = np.zeros(6)
    off[JOINTS.index("middle")] = 1e-3
    assert two.outside(off) == [JOINTS.index("middle")]


@pytest.mark.parametrize("name", ["two-position", "four-position", "carousel", "static"])
def test_one_axis_does_for_turns_about_the_vertical(name):
    planned = plan(load_procedure(name), STAND, table("outer"))
    q, _, _ = planned.motion.joints(np.linspace(0, planned.motion.duration, 500))
    assert not q[:, [k for k in range(6) if k != JOINTS.index("outer")]].any()


@pytest.mark.parametrize(
    ("name", "axes", "line"),
    [
        ("six-position", ("outer",), r'"to X1 up", attitude_deg = 90.000 deg on axis middle: table '
         r"mine has no axis middle, it has outer$"),
        ("six-position", ("outer", "middle"), r'"to Z1 up", .* has no axis inner, it has outer'),
        ("random-sway", ("outer",), r"background 1, axes = base_roll: table mine has no axis base"),
        ("carousel", ("middle",), r"axis = outer: table mine has no axis outer, it has middle$"),
    ],
)  # fmt: skip
def test_what_needs_a_missing_axis_is_refused_with_its_name(name, axes, line):
    with pytest.raises(StandError, match=line):
        plan(load_procedure(name), STAND, table(*axes))


def test_y1_down_is_half_a_turn_of_either_axis():
    """What the inner axis would do, outer and middle do together: no refusal."""
    down = "attitude_deg = { roll = 180.0, yaw = 0.0, pitch = 0.0 }"
    planned = plan(procedure(move(down)), STAND, table("outer", "middle"))
    # by hand: b's Y1 points along +D, X1 still north
    assert planned.steps[-1].C_nb.apply([0, 1, 0]) == pytest.approx([0, 0, 1], abs=1e-9)
    assert planned.steps[-1].C_nb.apply([1, 0, 0]) == pytest.approx([1, 0, 0], abs=1e-9)


def test_the_attitude_that_the_axes_there_reach_is_told_and_does():
    """Without an axis about the vertical a heading cannot be turned to; the position can."""
    two = table("middle", "inner")
    up = "attitude_deg = { roll = -90.0, yaw = 90.0, pitch = 0.0 }"
    with pytest.raises(StandError, match=r"no axis outer, .*; attitude_deg = \{") as e:
        plan(procedure(move(up)), STAND, two)
    told = str(e.value).split("; attitude_deg = ")[1].split(" has the same")[0]
    planned = plan(procedure(move(f"attitude_deg = {told}")), STAND, two)
    # by hand: b's Z1 points up, that is along -D
    assert planned.steps[-1].C_nb.apply([0, 0, 1]) == pytest.approx([0, 0, -1], abs=1e-9)
    # Z1 up is reached by no other pair: outer and middle leave Z1 level
    with pytest.raises(StandError, match=r"it has outer, middle$"):
        plan(procedure(move(up)), STAND, table("outer", "middle"))


@pytest.mark.parametrize(
    ("axes", "wanted", "told"),
    [
        # X1 30 deg up by middle alone; Y1 50 deg over by inner alone, to either side
        (("middle",), (Sequence.YAW_PITCH_ROLL, 0.0, 40.0, 30.0), "roll = 0, yaw = 0, pitch = 30"),
        (("inner",), (Sequence.YAW_PITCH_ROLL, 50.0, 40.0, 0.0), "roll = 50, yaw = 0, pitch = 0"),
        (("inner",), (Sequence.YAW_PITCH_ROLL, -50.0, 9.0, 0.0), "roll = -50, yaw = 0, pitch = 0"),
        # both: middle first is pitch, inner roll
        (("middle", "inner"), (Sequence.YAW_PITCH_ROLL, 50.0, 40.0, -30.0),
         "roll = 50, yaw = 0, pitch = -30"),
        # X1 60 deg up and Y1 below level: middle at 120 deg, past its top
        (("middle",), (Sequence.YAW_PITCH_ROLL, 180.0, 40.0, 60.0),
         "roll = 180, yaw = 180, pitch = 60"),
        (("middle",), (Sequence.YAW_PITCH_ROLL, 50.0, 40.0, 30.0), ""),
        (("outer",), (Sequence.YAW_PITCH_ROLL, 0.0, 40.0, 30.0), ""),
    ],
)  # fmt: skip
def test_the_same_vertical_by_hand(axes, wanted, told):
    C_nb = C_nb_from_angles(wanted[0], *np.radians(wanted[1:]))
    found = same_vertical(C_nb, np.zeros(6), wanted[0], STAND, table(*axes))
    by_hand = f"; attitude_deg = {{ {told} }} has the same vertical and can be reached"
    assert found.replace("= -180", "= 180") == (by_hand if told else "")  # rounding has the sign


def test_joints_by_name_and_joints_that_stay():
    with pytest.raises(StandError, match="joints_deg = inner: table mine has no axis inner"):
        plan(procedure(move("joints_deg = { inner = 90.0 }")), STAND, table("outer"))
    plan(procedure(move("joints_deg = { inner = 0.0, outer = 90.0 }")), STAND, table("outer"))


def test_names_of_axes_are_checked():
    with pytest.raises(StandError, match="unknown axis 'outter': did you mean outer"):
        table("outter")
    with pytest.raises(StandError, match="axis: has none, must have one or more"):
        table_from(catalogue.Source("m", "m.toml", HEAD + "axis = {}\n"))


# The lint ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", catalogue.ids("tables"))
def test_shipped_tables_have_nothing_to_object_to(name):
    assert lint(catalogue.find("tables", "table", name)) == []


def test_a_sound_table_passes():
    assert lint(catalogue.Source("mine", "mine.toml", text("outer", "middle"))) == []


@pytest.mark.parametrize(
    ("planted", "place"),
    [
        ("[axis.outer.errors]\nplacement_arc_s = 0.0028", "placement_arc_s"),  # deg for arc s
        ("[axis.outer.errors]\nwobble_arc_s = 7200.0", "wobble_arc_s"),
        ("[axis.outer.errors]\nencoder_step_arc_s = 20.0", "settling, within_arc_s = 5"),
        ("[axis.outer.motor]\ntorque_Nm = 1.0\nbandwidth_hz = 20.0\nviscous_Nm_s = 2.0",
         "torque_Nm"),  # 100 deg/s are 1.745 rad/s: 3.5 N m
    ],
)  # fmt: skip
def test_what_cannot_be_is_an_error(planted, place):
    found = lint(catalogue.Source("mine", "mine.toml", text("outer") + planted))
    errors = [f for f in found if f.severity == "error"]
    assert len(errors) == 1
    assert place in errors[0].place


@pytest.mark.parametrize(
    ("planted", "place"),
    [
        ("[axis.outer.motor]\ntorque_Nm = 10.0\nbandwidth_hz = 125.0", "bandwidth_hz"),
        ("[axis.outer.motor]\ntorque_Nm = 10.0\nbandwidth_hz = 20.0\ndamping = 0.1", "damping"),
        ("[axis.outer.motor]\ntorque_Nm = 10.0\nbandwidth_hz = 20.0\ncogging_Nm = 5.0", "cogging"),
        ("[axis.outer.errors]\nrate_ripple_percent = 5.0", "rate_ripple_percent"),
        ("[axis.base_roll]\n" + AXIS, "travel_deg"),
    ],
)
def test_what_is_unusual_is_a_warning(planted, place):
    found = lint(catalogue.Source("mine", "mine.toml", text("outer") + planted))
    assert [f.severity for f in found] == ["warning"]
    assert place in found[0].place


def test_faults_of_the_file_are_told_and_so_is_a_missing_source():
    (fault, *_) = lint(catalogue.Source("m", "m.toml", HEAD + "[axis.outer]\nrate_deg_s = -1\n"))
    assert fault.severity == "error"
    bare = text("outer").replace("data sheet rev. 3, p. 7", "todo")
    assert [f.place for f in lint(catalogue.Source("m", "m.toml", bare))] == ["source"]
