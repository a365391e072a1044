"""`stand campaign`: a sweep run, read, gone on with; one run of it recorded."""

import json
from pathlib import Path

import pytest
from swept import SWEEP, written

ONE = SWEEP.partition("[[vary]]")[0].replace("runs = 6", "runs = 2")


@pytest.fixture
def here(stand_command, tmp_path, monkeypatch):
    """Commands in a folder with `sweep.toml`; exit code 0 is owed."""
    monkeypatch.chdir(tmp_path)
    written(tmp_path, ONE)

    def call(*arguments, code=0):
        outcome = stand_command("campaign", *arguments)
        assert outcome.code == code, outcome.err
        return outcome

    return call


def test_from_a_sweep_to_a_page_and_to_a_recording(here):
    out = ("--out", "made", "--workers", 1)
    told = here("sweep.toml", *out, "--json").json
    assert (told["runs"], told["wanted"], Path(told["page"]).exists()) == (2, 2, True)
    assert "a campaign is there; --resume goes on" in here("sweep.toml", *out, code=2).err
    more = Path("sweep.toml").read_text().replace("runs = 2", "runs = 3")
    Path("sweep.toml").write_text(more)
    plan = here("sweep.toml", *out, "--resume", "--plan", "--json").json
    assert (plan["cases"], plan["runs"], plan["known"]) == (1, 3, 2)
    assert (
        "1 case, 3 runs, 2 of them are there" in here("sweep.toml", *out, "--resume", "--plan").out
    )
    answer = here("sweep.toml", *out, "--resume").out
    assert "of 3 units pass by two-position" in answer
    assert here("made").out == answer
    here("record", "made", "--case", 1, "--seed", 2, "--json")
    recorded = Path("made/recordings/case1_seed2")
    assert json.loads((recorded / "result.json").read_text())["seed"] == 2
    record = ("record", "made", "--case", 1, "--seed", 2, "--out", "again")
    assert "Recorded in again" in here(*record).out
    here(*record, code=2)
    here(*record, "--force")


def test_where_results_go_if_nobody_says(here):
    here("sweep.toml")
    assert Path("recordings/campaign_sweep/results.parquet").exists()


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("record",), "stand campaign record: must have DIR, --case and --seed"),
        (("record", "sweep.toml", "--case", 1), "must have DIR, --case and --seed"),
        (("sweep.toml", "--case", 1), "--case: of stand campaign record"),
        (("sweep.toml", "more"), "DIR: of stand campaign record"),
        (("no.toml",), "no.toml: cannot read this sweep: No such file"),
        ((".",), "no campaign is there"),
        (("sweep.toml", "--workers", 0), "workers = 0: must be 1 or more"),
        (("sweep.toml", "--scheduler", "here"), "must be as tcp://127.0.0.1:8786, or local"),
    ],
)
def test_a_fault_is_one_line(here, arguments, told):
    outcome = here(*arguments, code=2)
    assert told in outcome.err
    assert outcome.err.count("\n") == 1
