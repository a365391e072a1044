"""Runs of `rehearse --verify` and `compare` that are kept: none is made twice, nothing is mixed."""

import json
from dataclasses import replace

import pytest
from swept import PROCEDURE, written

import stand
from stand.campaigns.sweep import load_sweep
from stand.errors import StandError
from stand.evaluation.comparison import compare
from stand.rehearsal.rehearse import rehearse
from stand.rehearsal.verify import errors_of_runs, with_verification
from stand.simulation.journal import Journal
from stand.simulation.work import here


@pytest.fixture
def settings(tmp_path):
    return load_sweep(written(tmp_path / "files")).case(1).settings


def counted(made):
    """An engine in this process that counts the runs it makes."""

    def engine(supply):
        for done in here(supply):
            made.extend(done.seeds)
            yield done

    return engine


def test_a_verification_goes_on_where_it_was_to_the_last_bit(settings, tmp_path):
    keep, made = tmp_path / "kept" / "runs.jsonl", []
    result = rehearse(settings)
    whole = with_verification(result, settings, 6, workers=1).verification
    for runs in (2, 6, 6, 4):
        found = with_verification(result, settings, runs, engine=counted(made), keep=keep)
        assert found.verification.done == runs
        if runs == 6:
            assert replace(found.verification, seconds=0) == replace(whole, seconds=0)
    assert len(made) == len(set(made)) == 6
    assert len(keep.read_text().splitlines()) == 7


def test_a_comparison_goes_on_where_it_was(settings, tmp_path):
    keep, made = tmp_path / "runs.jsonl", []
    whole = compare(settings, 4, workers=1).tallies
    for runs in (1, 4):
        found = compare(settings, runs, engine=counted(made), keep=keep).tallies
    assert made == [0, 1, 2, 3]
    # as text: what is no number is not even itself
    assert repr([replace(t, seconds=0) for t in found]) == repr(
        [replace(t, seconds=0) for t in whole]
    )


def test_a_line_that_was_not_finished_does_not_count(settings, tmp_path):
    path = tmp_path / "runs.jsonl"
    with Journal(path, "verify a", settings).adding() as journal:
        journal.add([1.1, float("nan")])
        journal.add([2])
    path.write_bytes(path.read_bytes()[:-2])
    again = Journal(path, "verify a", settings)
    assert json.dumps(again.runs) == "[[1.1, NaN]]"
    again.add([3])
    assert Journal(path, "verify a", settings).runs[1:] == [[3]]


def test_what_it_is_not_of_is_named(settings, tmp_path):
    path = tmp_path / "runs.jsonl"
    Journal(path, "verify a", settings)
    for other, what, told in (
        (settings, "verify b", "is of another runs of"),
        (replace(settings, seed=1), "verify a", "is of another case"),
    ):
        with pytest.raises(StandError, match=told):
            Journal(path, what, other)
    path.write_text("mine\n")
    with pytest.raises(StandError, match="holds no runs of a command"):
        Journal(path, "verify a", settings)
    with pytest.raises(StandError, match="cannot write there"):
        Journal(path / "x", "verify a", settings)
    path.unlink()
    first, second = (Journal(path, "verify a", settings) for _ in range(2))
    with first.adding(), pytest.raises(StandError, match="at work"), second.adding():
        pass


def test_runs_at_a_scheduler_are_the_same(settings):
    """The engine that is given makes them; a word that is no address is told."""
    result, made = rehearse(settings), []
    plain = list(errors_of_runs(result, settings, range(3), 1))
    assert list(errors_of_runs(result, settings, range(3), engine=counted(made))) == plain
    with pytest.raises(StandError, match="--scheduler here: must be as tcp"):
        stand.compare(settings, 1, scheduler="here")


def test_the_commands_keep_their_runs(stand_command, tmp_path, monkeypatch):
    of_nothing = PROCEDURE.replace('[require]\nheading_deg = 0.1\nmethod = "two-position"\n', "")
    written(tmp_path, procedure=of_nothing)
    monkeypatch.chdir(tmp_path)
    verify = ("rehearse", "short.toml", "--imu", "hg9900", "--rate", 2, "--json", "--verify")
    first = stand_command(*verify, 2, "--keep", "v.jsonl").json["verification"]
    again = stand_command(*verify, 2, "--keep", "v.jsonl").json["verification"]
    assert again | {"seconds": 0} == first | {"seconds": 0}
    assert len((tmp_path / "v.jsonl").read_text().splitlines()) == 3
    beside = ("compare", "short.toml", "--runs", 2, "--rate", 2, "--json", "--methods", "triad")
    assert stand_command(*beside, "--keep", "c.jsonl").code == 0
    assert len((tmp_path / "c.jsonl").read_text().splitlines()) == 3
    told = stand_command(*beside, "--scheduler", "here")
    assert "--scheduler here: must be as tcp://127.0.0.1:8786, or local" in told.err
