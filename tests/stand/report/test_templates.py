"""Templates of stand new: each loads, each has every key, and each key is as its model has it."""

import re
from pathlib import Path

import pytest
from pydantic import BaseModel

from stand import toml_files as catalogue
from stand.errors import StandError
from stand.imu.preset import ImuEntry, Places, Stated
from stand.motion.planner import plan
from stand.physics.mjcf import describe, load_model
from stand.procedure.procedure import ProcedureEntry, procedure_from
from stand.proposal.wanted import WantedEntry
from stand.report.templates import TEMPLATES, template
from stand.table.table import TableEntry, load_table, table_from

MODELS = {
    "imu": ImuEntry,
    "table": TableEntry,
    "procedure": ProcedureEntry,
    "requirement": WantedEntry,
}


def source(text: str) -> catalogue.Source:
    return catalogue.Source("own", "own.toml", text)


def models_in(model: type[BaseModel], found: set[type[BaseModel]]) -> set[type[BaseModel]]:
    """A model and all that its fields hold."""
    if model in found:
        return found
    found.add(model)
    for name, field in model.model_fields.items():
        for inner in re.findall(r"stand\.[\w.]+", str(field.annotation)) and _classes(field):
            assert name
            models_in(inner, found)
    return found


def _classes(field):
    from typing import get_args

    stack, classes = [field.annotation], []
    while stack:
        part = stack.pop()
        if isinstance(part, type) and issubclass(part, BaseModel):
            classes.append(part)
        stack += get_args(part)
    return classes


@pytest.mark.parametrize("what", TEMPLATES)
def test_every_template_loads_and_has_every_key(what):
    text = template(what, 'An "own" one')
    entry = catalogue.parse(source(text), MODELS[what])
    assert entry.title == 'An "own" one'
    found = models_in(MODELS[what], set())
    assert len(found) >= 5
    for model in found - {Stated, Places}:
        for key in model.model_fields:
            assert re.search(rf"\b{key}\b( =|\])|\b{key}\.|\[{key}", text), (model, key)


def uncommented(text: str) -> str:
    return re.sub(r"^# (?=[a-z][\w.]* = |\[)", "", text, flags=re.M)


@pytest.mark.parametrize("what", ["imu", "table"])
def test_every_key_loads_where_it_is_taken_from_behind_its_mark(what):
    text = re.sub(r"^# axes = .*\n", "", template(what, "x"), flags=re.M)  # or places_mm
    catalogue.parse(source(uncommented(text)), MODELS[what])


def test_every_section_of_a_procedure_loads_as_it_is_shown():
    """All keys of its head at once; those of steps exclude one another."""
    head, steps = template("procedure", "x").split("[[step]]", 1)
    shown = uncommented(head) + "[[step]]" + steps
    entry = catalogue.parse(source(shown), ProcedureEntry)
    assert entry.require is not None
    assert entry.temperature is not None


@pytest.mark.parametrize("kind", ["rate", "sweep", "sine", "scorsby", "coning", "vibration"])
def test_other_kinds_of_steps_load_as_they_are_shown(kind):
    text = template("procedure", "x")
    (block,) = re.findall(rf"# \[\[step\]\]\n(?:# .*\n)*?# kind = \"{kind}\"\n(?:# .*\n)*", text)
    block = re.sub(r"# turns = .*\n", "", block)  # or duration_s
    steps = catalogue.parse(source(text + uncommented(block)), ProcedureEntry).step
    assert steps[-1].kind == kind


def test_the_procedure_can_be_run_on_the_table():
    """What is written together fits together."""
    table = table_from(source(template("table", "x")))
    assert table.there == ("outer",)
    plan(procedure_from(source(template("procedure", "x"))), describe(load_model()), table)


def test_the_command(stand_command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = stand_command("new", "table", "mine")
    assert (done.code, done.out) == (0, "mine.toml\n")
    assert load_table("mine.toml").title == "mine"
    assert "mine.toml: exists; --force replaces it" in stand_command("new", "table", "mine").err
    Path("mine.toml").write_text("mine", encoding="utf-8")
    assert stand_command("new", "table", "mine").code == 2
    assert Path("mine.toml").read_text(encoding="utf-8") == "mine"
    assert stand_command("new", "table", "mine", "--force").out == "mine.toml\n"
    assert load_table("mine.toml").title == "mine"
    assert stand_command("new", "chair", "mine").code == 2
    for wrong in ("", ".toml", "there/.hidden"):
        refused = stand_command("new", "table", wrong)
        assert (refused.code, refused.err.count("\n")) == (2, 1)
    assert [path.name for path in tmp_path.iterdir()] == ["mine.toml"]
    with pytest.raises(StandError, match="unknown template 'chair'"):
        template("chair", "x")
