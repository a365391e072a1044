"""The door for TOML: ids, near matches, files, and the one line of every fault."""

from importlib.resources import files
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import Field

from stand import toml_files as catalogue
from stand.errors import StandError, unknown
from stand.imu import load_imu
from stand.procedure.procedure import load_procedure
from stand.table.table import load_table
from stand.toml_files import Entry, Source

AXES = ("outer", "middle", "inner", "base_roll", "base_pitch", "base_yaw")
AXIS = "rate_deg_s = 200.0\nacceleration_deg_s2 = 100.0\njerk_deg_s3 = 500.0\n"


class Inner(Entry):
    length_m: float = Field(gt=0)
    name: str = ""


class Outer(Entry):
    count: int = 0
    part: tuple[Inner, ...] = ()


def fault(text: str) -> str:
    with pytest.raises(StandError) as caught:
        catalogue.parse(Source("x", "x.toml", text), Outer)
    return str(caught.value)


def outcome(text: str) -> Outer | str:
    try:
        return catalogue.parse(Source("x", "x.toml", text), Outer)
    except StandError as error:
        return str(error)


def refusal(load, name: object) -> str:
    with pytest.raises(StandError) as caught:
        load(str(name))
    return str(caught.value)


@pytest.mark.parametrize("folder", ["procedures", "imus", "tables"])
def test_ids_are_the_toml_files(folder):
    there = sorted(f.name[:-5] for f in (files("stand") / folder).iterdir() if ".toml" in f.name)
    assert catalogue.ids(folder) == there
    assert len(there) >= 1


def test_an_entry_is_found_with_its_text():
    source = catalogue.find("imus", "imu", "stim300")
    assert (source.id, source.name) == ("stim300", "stim300.toml")
    assert 'title = "Safran STIM300' in source.text


def test_a_users_file_is_found_by_its_path(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text("count = 3\n", encoding="utf-8")
    source = catalogue.find("imus", "imu", str(path))
    assert source == Source("mine", str(path), "count = 3\n")
    assert catalogue.parse(source, Outer).count == 3


@pytest.mark.parametrize(
    ("load", "folder", "name", "near"),
    [
        (load_imu, "imus", "stim30", "did you mean stim300? "),
        (load_procedure, "procedures", "six-postion", "did you mean six-position or "),
        (load_table, "tables", "laborotory", "did you mean laboratory? "),
        (load_table, "tables", "123456789", "known: "),
    ],
)
def test_unknown_ids_name_near_matches_and_all_there_are(load, folder, name, near):
    told = refusal(load, name)
    assert told.startswith(f"unknown {folder[:-1]} {name!r}: {near}")
    assert told.endswith(f"known: {', '.join(catalogue.ids(folder))}")


def test_a_file_of_that_name_is_offered(tmp_path, monkeypatch):
    """`stand new procedure mine` writes mine.toml: who then says `mine` means that."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.toml").touch()
    assert "did you mean mine.toml? " in refusal(load_procedure, "mine")


def test_unknown_sorts_and_offers_at_most_three():
    text = str(unknown("colour", "gre", ["green", "grey", "great", "greed", "red"]))
    near, known = text.removeprefix("unknown colour 'gre': did you mean ").split("? known: ")
    assert len(near.split(" or ")) == 3
    assert known == "great, greed, green, grey, red"


def test_missing_file(tmp_path):
    path = tmp_path / "none.toml"
    line = f"{path}: cannot read this imu: No such file or directory"
    assert refusal(load_imu, path) == line


def test_folder_instead_of_a_file(tmp_path):
    path = tmp_path / "folder.toml"
    path.mkdir()
    assert refusal(load_procedure, path) == f"{path}: cannot read this procedure: Is a directory"


def test_not_utf8(tmp_path):
    path = tmp_path / "latin.toml"
    path.write_bytes(b'title = "M\xfcnchen"\n')
    assert refusal(load_procedure, path) == f"{path}: not UTF-8 text (byte 10)"


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("count = ", "x.toml: not valid TOML: Invalid value (at end of document)"),
        ("count = 1.5", "x.toml: count = 1.5: must be a valid integer"),
        ("count = true", "x.toml: count = True: must be a valid integer"),
        ("count = '3'", "x.toml: count = '3': must be a valid integer"),
        ("cout = 1", "x.toml: unknown key 'cout': did you mean count? known: count, part"),
        ("part = 1", "x.toml: part = 1: must be an array"),
        ("part = [1]", "x.toml: part 1 = 1: must be a table"),
        ("[[part]]\nlength_m = [1]", "x.toml: part 1, length_m = an array: must be a valid number"),
        (
            '[[part]]\nlength_m = 1\n[[part]]\nname = "N"',
            "x.toml: part 2, length_m: required, but missing",
        ),
        (
            f"count = '{'a' * 99}'",
            f"x.toml: count = '{'a' * 59}...: must be a valid integer",
        ),
        (
            "count = 'a'\n[[part]]\nlength_m = -1",
            "x.toml: count = 'a': must be a valid integer (and 1 more)",
        ),
    ],
)
def test_faults_name_file_place_value_and_what_is_allowed(text, line):
    assert fault(text) == line


@pytest.mark.parametrize("value", ["nan", "inf", "-inf"])
def test_numbers_must_be_finite(value):
    told = fault(f"[[part]]\nlength_m = {value}")
    assert told == f"x.toml: part 1, length_m = {value}: must be a finite number"


@pytest.mark.parametrize("text", [f"count = {'9' * 5000}", "count = " + "[" * 5000])
def test_more_digits_or_brackets_than_python_takes(text):
    assert fault(text).startswith("x.toml: not valid TOML: ")


def test_entries_are_immutable():
    entry = catalogue.parse(Source("x", "x.toml", "count = 3"), Outer)
    with pytest.raises(ValueError, match="frozen"):
        entry.count = 4
    assert entry.count == 3


@given(st.text())
def test_any_message_is_one_printable_line(text):
    told = str(StandError(text))
    assert told.isprintable()
    assert len(told) == len(text)
    assert all(
        a == b or (b == " " and not a.isprintable()) for a, b in zip(text, told, strict=True)
    )


@given(st.text())
def test_any_text_is_an_entry_or_one_line(text):
    told = outcome(text)
    if isinstance(told, str):
        assert told.startswith("x.toml: ")
        assert told.isprintable()


def table_file(tmp_path: Path, axes: dict[str, str]) -> Path:
    path = tmp_path / "own.toml"
    head = 'title = "Own"\nsource = "made up"\n'
    path.write_text(head + "".join(f"[axis.{a}]\n{text}" for a, text in axes.items()))
    return path


def test_table_in_si(tmp_path):
    axes = dict.fromkeys(AXES, AXIS) | {"base_yaw": AXIS + "travel_deg = [-20, 30.0]\n"}
    table = load_table(str(table_file(tmp_path, axes)))
    # 200 deg/s = 3.490658..., 100 deg/s^2 = 1.745329..., 500 deg/s^3 = 8.726646... rad
    assert table.rate.tolist() == pytest.approx([3.490658503988659] * 6, rel=1e-15)
    assert table.acceleration.tolist() == pytest.approx([1.7453292519943295] * 6, rel=1e-15)
    assert table.jerk.tolist() == pytest.approx([8.726646259971648] * 6, rel=1e-15)
    assert (table.low[2], table.high[2]) == pytest.approx((-0.3490658503988659, 0.5235987755982988))
    assert table.low[3:] == (-float("inf"),) * 3
    assert table.outside([0, 0, 0.53, 1e9, 0, 0]) == [2]
    assert table.outside([0, 0, -0.34, 0, 0, 0]) == []
    with pytest.raises(ValueError, match="read-only"):
        table.rate[0] = 1.0


@pytest.mark.parametrize(
    ("axes", "told"),
    [
        ({}, ": axis: required, but missing"),
        ({"sideways": AXIS}, ": axis: unknown axis 'sideways': known: "),
        (
            dict.fromkeys(AXES, AXIS) | {"inner": AXIS + "travel_deg = [5, 9]\n"},
            ": axis, inner: travel_deg = [5.0, 9.0]: must contain 0, low end first",
        ),
        (
            dict.fromkeys(AXES, AXIS) | {"inner": AXIS + "travel_deg = [5, -9]\n"},
            ": axis, inner: travel_deg = [5.0, -9.0]: must contain 0, low end first",
        ),
        (
            dict.fromkeys(AXES, AXIS) | {"outer": AXIS.replace("200.0", "0")},
            ": axis, outer, rate_deg_s = 0: must be greater than 0",
        ),
    ],
)
def test_tables_that_are_not_right(tmp_path, axes, told):
    path = table_file(tmp_path, axes)
    assert told in refusal(load_table, path)
    assert refusal(load_table, path).startswith(str(path))


def test_presets_that_are_not_right(tmp_path):
    good = catalogue.find("imus", "imu", "ideal").text
    path = tmp_path / "own.toml"
    for text, told in (
        (good.replace("value = 0.0, kind", "value = -1.0, kind", 1), "value = -1.0: must be gr"),
        (good.replace('kind = "assumed"', 'kind = "guess"', 1), "kind = 'guess': must be 'typ"),
        (good.replace("turn_on_bias_deg_h", "turn_on_bias_deg_s"), "did you mean "),
        (good.replace("perfect by definition", "", 1), "source = '': "),
    ):
        path.write_text(text, encoding="utf-8")
        assert told in refusal(load_imu, path)
        assert refusal(load_imu, path).startswith(f"{path}: gyro")
