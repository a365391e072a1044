"""Hand-over of a motion: read back by a profile step it is the same."""

import numpy as np
import pytest

from alignment.units import DEG
from stand import toml_files as catalogue
from stand.motion.planner import plan
from stand.physics.mjcf import describe, load_model
from stand.procedure.procedure import load_procedure, procedure_from
from stand.table.table import load_table

STAND = describe(load_model())


@pytest.mark.parametrize("name", ["two-position", "carousel", "six-position", "scorsby"])
def test_what_is_exported_is_read_back(name, stand_command, tmp_path):
    out = tmp_path / "motion.csv"
    assert stand_command("export", name, "--out", str(out)).code == 0
    text = (
        'title = "Back"\n[site]\nlatitude_deg = 0\n[estimate]\nmethods = []\n'
        '[[step]]\nkind = "profile"\nlabel = "all"\nfile = "motion.csv"\n'
    )
    source = catalogue.Source("back", str(tmp_path / "back.toml"), text)
    original = load_procedure(name)
    table = load_table(original.entry.table)
    first = plan(original, STAND, table).motion
    again = plan(procedure_from(source), STAND, table).motion
    t = np.arange(0.0, first.duration, 0.01)
    for a, b, allowed in zip(first.joints(t), again.joints(t), (1e-9, 1e-7, 1e-5), strict=True):
        # angles to 1e-9 deg; the file's digits and the polynomials' powers of a 10 ms step make
        # a hundred times as much of each derivative
        assert np.abs(a - b).max() / DEG < allowed
    # between the rows: a jerk switch J within a step of 10 ms leaves J h^3 / 384 at most, with
    # both ends' values given; 2000 deg/s^3 make 5e-6 deg
    between = first.joints(t + 0.005)[0] - again.joints(t + 0.005)[0]
    assert np.abs(between).max() / DEG < 6e-6
    steps = (tmp_path / "motion_steps.csv").read_text(encoding="utf-8").splitlines()
    assert len(steps) == len(plan(original, STAND, table).steps) + 1
    assert steps[0].startswith("step,kind,label,t_from_s")


def test_what_is_there_stays(stand_command, tmp_path):
    out = tmp_path / "motion.csv"
    out.write_text("mine", encoding="utf-8")
    outcome = stand_command("export", "carousel", "--out", str(out))
    assert outcome.code == 2
    assert out.read_text(encoding="utf-8") == "mine"
    assert stand_command("export", "carousel", "--out", str(out), "--format", "xls").code == 2
