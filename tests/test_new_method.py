"""A new estimator is one module and one entry: every command has it, with no word elsewhere."""

from dataclasses import replace

import pytest
from procedures import HALF_TURN

from alignment import ESTIMATORS, Method, Window
from alignment.methods.triad import triad, triad_gains
from alignment.units import DEG

ID = "newcomer"
TITLE = "A method that nobody has heard of"
REASON = "what it does with its readings is not known to first order, and no bound of it is printed"


def estimate(dwells, site, options):
    """What a module of its own would hold: here the triad, once more by another name."""
    found = triad(dwells, site, options)
    return [replace(e, method=ID, window="late") for e in found if e.C_nb is not None]


def gains(stretches, site, options):
    return [replace(a, window="late") for a in triad_gains(stretches, site, options)]


ENTRY = {
    "title": TITLE,
    "source": "[S4] of a test",
    "note": "± of the test",
    "estimate": estimate,
    "windows": {"late": Window("late window")},
}


@pytest.fixture
def command(stand_command, monkeypatch, tmp_path):
    """`stand`, in a folder with a procedure that wants the method, which predicts or does not."""

    def enter(**prediction):
        monkeypatch.setitem(ESTIMATORS, ID, Method(**ENTRY, **prediction))

    monkeypatch.chdir(tmp_path)
    (tmp_path / "new.toml").write_text(HALF_TURN.replace('"triad"', f'"triad", "{ID}"'))
    stand_command.enter = enter
    return stand_command


def test_it_is_listed(command):
    command.enter(gains=gains)
    rows = {row["id"]: row for row in command("list", "methods", "--json").json}
    assert rows[ID]["title"] == TITLE
    assert ID in command("list", "methods").out


@pytest.mark.slow
def test_it_runs_and_is_reported(command, tmp_path):
    command.enter(gains=gains)
    ran = command("run", "new.toml", "--rate", 10, "--out", "ran", "--json")
    estimates = [e for e in ran.json["estimates"] if e["method"] == ID]
    assert [(e["label"], e["window"]) for e in estimates] == [("first", "late"), ("second", "late")]
    again = command("align", "ran", "--json")  # the recording names its methods
    assert {e["method"] for e in again.json["estimates"]} == {"triad", ID}
    assert command("report", "ran").code == 0
    page = next((tmp_path / "ran").glob("*.html")).read_text()
    assert f"{ID}, late window" in page
    assert TITLE in page


def test_it_is_compared_as_its_twin(command):
    command.enter(gains=gains)
    options = ("new.toml", "--runs", 3, "--rate", 10, "--json")
    rows = {row["method"]: row for row in command("compare", *options).json["methods"]}
    assert rows[ID]["estimates"] == 6
    assert rows[ID]["rms_heading_deg"] == rows["triad"]["rms_heading_deg"]
    assert rows[ID]["floor_heading_deg"] == rows["triad"]["floor_heading_deg"]


@pytest.mark.slow
def test_it_is_rehearsed_with_its_prediction(command, tmp_path):
    command.enter(gains=gains)
    options = ("new.toml", "--imu", "hg9900", "--report", "pages", "--json")
    told = command("rehearse", *options).json["predictions"]
    mine, twin = ([p for p in told if p["method"] == name] for name in (ID, "triad"))
    assert {p["window"] for p in mine} == {"late"}
    assert [p["sigma"] for p in mine] == [p["sigma"] for p in twin]
    heading = next(p for p in mine if p["quantity"] == "heading")
    # by hand: 0.0035 deg/h of bias over 9.96651 deg/h at 48.5 deg
    by_bias = 0.0035 / 9.96651 / DEG
    assert heading["contributions"]["gyro turn-on bias"] == pytest.approx(by_bias, rel=1e-3)
    (page,) = (tmp_path / "pages").glob("*.html")
    assert f"{ID}, late window" in page.read_text(encoding="utf-8")


def test_it_is_rehearsed_with_its_reason(command):
    command.enter(no_prediction=REASON)
    told = command("rehearse", "new.toml", "--json").json["predictions"]
    (mine,) = (p for p in told if p["method"] == ID)
    assert mine["sigma"] is None
    assert REASON in mine["reason"]
