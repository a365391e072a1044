"""`stand propose`: a procedure to run, a page, time against accuracy; one line where it cannot."""

from pathlib import Path

import pytest
from procedures import HALF_TURN


@pytest.fixture
def here(stand_command, tmp_path, monkeypatch):
    """Commands in a folder of their own; exit code 0 is owed."""
    monkeypatch.chdir(tmp_path)

    def call(*arguments, code=0):
        outcome = stand_command(*arguments)
        assert outcome.code == code, outcome.err
        return outcome

    return call


NORTH = ("propose", "--heading", 1.5, "--imu", "hg9900", "--rate", 20)


@pytest.mark.slow
def test_a_heading_to_a_procedure_that_passes(here):
    """stand propose --latitude --height --json --out --force"""
    told = here(*NORTH, "--latitude", 40, "--height", 300, "--json", "--out", "north.toml").json
    assert told["feasible"]
    assert told["total_s"] >= told["bound_s"] > 0
    (heading,) = told["quantities"]
    assert (heading["quantity"], heading["required"], heading["unit"]) == ("heading", 1.5, "deg")
    # twice the sigma and a guard band of 10 % within 1.5 deg
    assert 2 * 1.1 * heading["predicted"] <= 1.5
    assert heading["limited_by"] == "gyro white noise"
    assert Path("north.toml").read_text() == told["toml"]
    assert "latitude_deg = 40" in told["toml"]
    assert "height_m = 300" in told["toml"]
    again = ("rehearse", "north.toml", "--imu", "hg9900", "--rate", 20, "--table", "precision")
    assert here(*again).out.startswith("PASS")  # at the latitude that it was proposed for
    # nothing is lost, and nothing is replaced unless asked
    assert "--out north.toml: exists; --force" in here(*NORTH, "--out", "north.toml", code=2).err
    here(*NORTH, "--out", "north.toml", "--force")


@pytest.mark.slow
def test_too_little_time_is_exit_code_1_and_leaves_no_procedure_that_passes(here):
    asked = ("propose", "--heading", 1.5, "--imu", "stim300", "--max-time", 60)
    told = here(*asked, "--json", code=1).json
    assert not told["feasible"]
    assert "max_time_s = 60" in told["reason"]
    printed = here(*asked, code=1).out
    assert printed.startswith("NOT REACHED")


@pytest.mark.slow
def test_a_requirement_of_a_file_and_time_against_accuracy(here):
    here("new", "requirement", "own.toml")
    text = Path("own.toml").read_text().replace("heading_deg = 0.1", "heading_deg = 1.5", 1)
    Path("own.toml").write_text(text + "\n")
    own = ("propose", "own.toml", "--imu", "hg9900", "--rate", 20, "--table", "laboratory")
    curve = (*own, "--trade-off", "--procedure", "four-position", "--report", "best")
    told = here(*curve, "--json").json["trade_off"]
    times = [point["total_s"] for point in told["curve"]]
    assert times == sorted(times)
    assert [p["ratio"] for p in told["curve"]] == sorted(
        (p["ratio"] for p in told["curve"]), reverse=True
    )
    classical, four = told["procedures"]
    assert classical["total_s"] == 600
    assert classical["ratio"] < 1
    assert classical["shortened_s"] < classical["total_s"]
    assert four["title"] != classical["title"]
    for name in ("proposal.html", "proposal.json", "proposal.toml", "trade-off.png"):
        assert (Path("best") / name).stat().st_size > 100
    assert "exists; --force replaces it" in here(*curve, code=2).err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((), "has neither of a requirement's file and --heading"),
        (("a.toml", "--heading", 1), "has both of a requirement's file and --heading"),
        (("--heading", 0), "heading_deg"),
        (("--heading", "nan"), "heading_deg"),
        (("--heading", 1, "--max-time", 0), "max_time_s"),
        (("--heading", 1, "--procedure", "static"), "--procedure: of --trade-off"),
        (("--heading", 1, "--table", "no-such"), "unknown table 'no-such'"),
        (("missing.toml",), "missing.toml"),
        (("somewhere",), "unknown requirement 'somewhere'"),
    ],
)
def test_what_is_wrong_is_told_in_one_line(here, arguments, words):
    told = here("propose", *arguments, code=2).err
    assert words in told
    assert told.count("\n") == 1


ASKED = HALF_TURN.replace("duration_s = 24", "duration_s = 300").replace(
    'methods = ["triad"]', 'methods = ["two-position"]\n[require]\nheading_deg = 1.5'
)


@pytest.mark.slow
def test_a_rehearsal_offers_the_shorter_test(here):
    Path("long.toml").write_text(ASKED)
    asked = (
        "rehearse",
        "long.toml",
        "--imu",
        "hg9900",
        "--table",
        "precision",
        "--rate",
        20,
        "--json",
    )
    assert here(*asked).json["advice"] == []
    (advice,) = here(*asked, "--propose", "--latitude", 40).json["advice"]
    assert "another test keeps all of it in" in advice["text"]
    assert "instead of 60" in advice["text"]  # 2 x 300 s and the move
    assert "latitude_deg = 40" in advice["procedure_toml"]
    assert advice["duration_s"] < 60
