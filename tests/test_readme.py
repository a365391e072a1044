"""The README's promises: its procedure runs, its commands exist, its files are there."""

import json
import re
from pathlib import Path

import pytest

from stand.errors import StandError
from stand.motion.limits import check
from stand.motion.planner import plan
from stand.physics.mjcf import describe, load_model
from stand.procedure.procedure import load_procedure, procedure_from
from stand.table.table import load_table
from stand.table.table_errors import draw
from stand.toml_files import Source

ROOT = Path(__file__).resolve().parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def blocks(language):
    return re.findall(rf"```{language}\n(.*?)```", README, re.DOTALL)


def test_the_procedure_in_the_readme_runs(tmp_path, stand_command):
    text = next(block for block in blocks("toml") if "[[step]]" in block)
    path = tmp_path / "two.toml"
    path.write_text(text, encoding="utf-8")
    assert len(load_procedure(str(path)).entry.step) == 4
    done = stand_command("run", path, "--rate", 10, "--out", tmp_path / "run", "--json")
    assert done.code == 0, done.err
    estimates = done.json["estimates"]
    assert {e["label"] for e in estimates} >= {"first", "second"}
    second = next(e for e in estimates if e["label"] == "second" and e.get("window") == "same")
    # the instrument's attitude is what the step asks for, whatever the tilted base
    assert abs(second["roll_deg"]) == pytest.approx(180.0, abs=1e-6)
    assert second["yaw_deg"] == pytest.approx(90.0, abs=1e-6)


def test_the_steps_in_the_readme_plan():
    head = 'title = "T"\n[site]\nlatitude_deg = 48.5\n[estimate]\nmethods = []\n'
    text = next(block for block in blocks("toml") if "[[background]]" in block)
    procedure = procedure_from(Source("p", "p.toml", head + text))
    planned = plan(procedure, describe(load_model()), load_table("laboratory"))
    check(procedure, planned, load_table("laboratory"))
    assert [s.label for s in planned.stretches] == ["carousel +", "carousel -"]
    errors = draw(load_table("mid-class"), 0, procedure.entry.table_errors, True)
    assert json.loads(errors.record()["placement_arc_s"]) == pytest.approx([0, 0, 0, 60, 0, 0])


def test_the_rehearsal_in_the_readme_fails_and_its_advice_passes(tmp_path, stand_command):
    text = next(block for block in blocks("toml") if "[require]" in block)
    path = tmp_path / "north.toml"
    for seconds, code in (("120", 1), ("270", 0)):
        path.write_text(text.replace("duration_s = 120", f"duration_s = {seconds}"))
        told = stand_command("rehearse", path, "--imu", "ring-laser")
        assert told.code == code, told.err
        if code:
            assert "0.134" in told.out
            found = stand_command("rehearse", path, "--imu", "ring-laser", "--json").json
            heading = found["predictions"][0]
            assert heading["sigma"] == pytest.approx(0.0670, abs=5e-5)
            assert heading["contributions"]["gyro white noise"] == pytest.approx(0.0668, abs=5e-5)
            assert "270 instead of 120" in told.out


def test_the_refusal_in_the_readme_is_what_is_said():
    sine = (
        'title = "T"\n[site]\nlatitude_deg = 48.5\n[estimate]\nmethods = []\n'
        '[[step]]\nkind = "move"\nlabel = "lean"\njoints_deg = { outer = 10 }\n'
        '[[step]]\nkind = "sine"\nlabel = "rock"\nduration_s = 20\n'
        "axes = { base_roll = { amplitude_deg = 10, frequency_hz = 0.6 } }\n"
    )
    procedure, table = procedure_from(Source("p", "p.toml", sine)), load_table("laboratory")
    with pytest.raises(StandError) as caught:
        check(procedure, plan(procedure, describe(load_model()), table), table)
    assert f"stand: {caught.value}" in README.replace(";\n", "; ")


def test_every_command_and_option_in_the_readme_exists(stand_command):
    commands = re.findall(r"^stand (\w+)(.*)$", "\n".join(blocks("sh")), re.MULTILINE)
    assert len(commands) >= 8
    for command, rest in commands:
        help_text = stand_command(command, "--help").out
        for option in re.findall(r"--[a-z-]+", rest.split("#")[0].split("|")[0]):
            assert option in help_text, f"stand {command} {option}"


def test_every_file_in_the_readme_exists():
    for name in re.findall(r"\]\((docs/[^)]+)\)", README):
        assert (ROOT / name).stat().st_size > 10_000, name
    for name in re.findall(r"`((?:stand|alignment|tools)/[\w/]*)`", README):
        assert (ROOT / name).exists(), name
