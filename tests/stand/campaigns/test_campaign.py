"""A campaign at work: nothing made twice, nothing mixed, each run as `stand run` makes it."""

import hashlib
import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from swept import PROCEDURE, SWEEP, written

import stand
from alignment import ESTIMATORS
from alignment.errors import AlignmentError
from stand.campaigns import campaign as module
from stand.campaigns.campaign import Campaign, size_of
from stand.campaigns.folder import alone, read_sweep
from stand.campaigns.record import settings_of_run
from stand.campaigns.sweep import load_sweep
from stand.campaigns.trial import ENDED, ready
from stand.errors import StandError
from stand.simulation.parallel import RunFailed
from stand.simulation.work import Done, Lost


def digest(folder):
    return hashlib.sha256((folder / "results.parquet").read_bytes()).hexdigest()


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A campaign that went through, in this process: its folder and its sweep's file."""
    root = tmp_path_factory.mktemp("campaign")
    path = written(root / "files")
    made = Campaign(load_sweep(path), root / "out", workers=1)
    runs = list(made)
    assert [(r.case, r.seed) for r in runs] == [(c, s) for c in (1, 2, 3, 4) for s in range(6)]
    assert (made.done, made.total) == (24, 24)
    return root / "out", path


def test_the_folder_holds_all_that_it_depends_on(whole):
    folder, path = whole
    told = json.loads((folder / "campaign.json").read_text())
    assert (told["cases"], told["runs"]) == (4, 6)
    assert (folder / "sweep.toml").read_text() == path.read_text()
    texts = {(i["kind"], i["name"]): (folder / i["file"]).read_text() for i in told["inputs"]}
    assert texts["procedure", "short.toml"] == PROCEDURE
    assert texts.keys() == {("procedure", "short.toml"), ("imu", "hg9900"), ("table", "mid-class")}
    for i in told["inputs"]:
        text = (folder / i["file"]).read_bytes()
        assert hashlib.sha256(text).hexdigest() == i["sha256"]
    assert {"numpy_version", "mujoco_version", "ruckig_version"} <= told["identity"].keys()


def test_interrupted_it_keeps_what_was_made_and_makes_none_of_it_again(whole, tmp_path):
    folder, path = whole
    sweep = load_sweep(path)
    first = Campaign(sweep, tmp_path / "out", workers=1)
    runs = iter(first)
    early = [next(runs) for _ in range(9)]
    runs.close()
    second = Campaign(sweep, tmp_path / "out", resume=True, workers=1)
    assert 9 <= second.done < 24  # a batch comes whole
    rest = list(second)
    made = [(r.case, r.seed) for r in early + rest]
    assert len(set(made)) == len(made)
    assert digest(tmp_path / "out") == digest(folder)
    third = Campaign(sweep, tmp_path / "out", resume=True, workers=1)
    assert (third.done, list(third)) == (24, [])
    assert digest(tmp_path / "out") == digest(folder)


def test_more_runs_go_on_where_fewer_ended(whole, tmp_path):
    folder, path = whole
    few = load_sweep(written(tmp_path, SWEEP.replace("runs = 6", "runs = 3")))
    assert sum(1 for _ in Campaign(few, tmp_path / "out", workers=1)) == 12
    rest = Campaign(load_sweep(path), tmp_path / "out", resume=True, workers=1)
    assert rest.done == 12
    assert {r.seed for r in rest} == set(range(3, 6))
    assert digest(tmp_path / "out") == digest(folder)


@pytest.mark.parametrize(
    ("sweep", "procedure", "told"),
    [
        (SWEEP.replace("[10, 20]", "[10, 21]"), PROCEDURE, "sweep, vary 1 was .*20.*, is .*21"),
        (SWEEP.replace("rate_hz = 2", "rate_hz = 3"), PROCEDURE, "sweep, rate_hz was 2, is 3"),
        (SWEEP, PROCEDURE.replace("90.0", "80.0"), "procedure short.toml has changed"),
    ],
)
def test_changed_input_is_named_and_not_mixed(whole, tmp_path, sweep, procedure, told):
    other = load_sweep(written(tmp_path, sweep, procedure))
    with pytest.raises(StandError, match=f"is of another campaign: {told}"):
        Campaign(other, whole[0], resume=True)


def test_another_version_is_named(whole, monkeypatch):
    folder, path = whole
    newer = stand.campaigns.folder.versions() | {"numpy_version": "9.0"}
    monkeypatch.setattr("stand.campaigns.folder.versions", lambda: newer)
    with pytest.raises(StandError, match=f"numpy was {np.__version__}, is 9.0"):
        Campaign(load_sweep(path), folder, resume=True)


def test_a_folder_of_something_else_stays(whole, tmp_path):
    folder, path = whole
    with pytest.raises(StandError, match="a campaign is there; --resume goes on with it"):
        Campaign(load_sweep(path), folder)
    (tmp_path / "thesis.txt").write_text("mine")
    with pytest.raises(StandError, match="exists and is no campaign"):
        Campaign(load_sweep(path), tmp_path)


def test_two_do_not_work_in_one_folder(tmp_path):
    sweep = load_sweep(written(tmp_path / "files"))
    made = Campaign(sweep, tmp_path / "out", workers=1)
    with (
        alone(tmp_path / "out"),
        pytest.raises(StandError, match="a campaign is at work there"),
    ):
        next(iter(made))


def test_a_run_is_the_one_that_a_recording_has(whole, tmp_path):
    """Every estimate, error and sigma, to the last digit that is kept."""
    folder, _ = whole
    recorded = stand.run(settings_of_run(folder, 3, 4), tmp_path / "run")
    columns = stand.campaigns.results.Results(folder).columns()
    own = (columns["case"] == 3) & (columns["seed"] == 4)
    compared = 0
    for scored in recorded.scores:
        e = scored.estimate
        of = own & (columns["method"] == e.method) & (columns["place"] == e.label)
        (heading,) = np.flatnonzero(of & (columns["quantity"] == "heading"))
        assert columns["estimate"][heading] == e.heading
        assert columns["error"][heading] == np.float32(scored.heading_error)
        assert columns["sigma"][heading] == np.float32(e.heading_sigma)
        for k, name in enumerate(("roll", "yaw", "pitch")):
            (row,) = np.flatnonzero(of & (columns["quantity"] == name))
            assert columns["estimate"][row] == e.angles[k]
            assert columns["error"][row] == np.float32(scored.error[k])
        compared += 1
    assert compared == 3  # triad at both rests, two-position of both


def test_a_run_is_made_from_the_texts_in_the_folder(whole):
    folder, path = whole
    before = path.with_name("short.toml").read_text()
    path.with_name("short.toml").write_text("nothing")
    try:
        assert settings_of_run(folder, 1, 0).procedure.text.startswith('title = "Two short')
    finally:
        path.with_name("short.toml").write_text(before)
    for case, seed, told in (
        (5, 0, "case = 5: must be 1 to 4"),
        (1, 6, "--seed 6: must be 0 to"),
    ):
        with pytest.raises(StandError, match=told):
            settings_of_run(folder, case, seed)


def test_a_text_that_was_changed_since_is_told(whole, tmp_path):
    copied = tmp_path / "copy"
    shutil.copytree(whole[0], copied)
    (copied / "sweep.toml").write_text("title = 'other'")
    with pytest.raises(StandError, match=r"sweep\.toml: has changed since the campaign began"):
        read_sweep(copied)
    with pytest.raises(StandError, match="no campaign is there"):
        read_sweep(tmp_path)


def test_a_case_that_cannot_run_says_so_and_the_rest_goes_on(tmp_path):
    """200 deg/s of a move that the table's outer axis does with 200 at most, and 1000."""
    fast = SWEEP.partition("[[vary]]")[0].replace("runs = 6", "runs = 2")
    fast += '[[vary]]\nkey = "move_limits.rate_deg_s"\nvalues = [90, 1000]\n'
    made = stand.campaign(written(tmp_path, fast), tmp_path / "out", workers=1)
    refused = {(r.case, r.seed): r.rows[0].refusal for r in made if len(r.rows) == 1}
    assert set(refused) <= {(2, 0), (2, 1)}
    columns = made.columns()
    assert (columns["quantity"][columns["case"] == 1] == "heading").any()


def engine_of(*answers):
    def engine(supply):
        while (batch := supply.take()) is not None:
            if batch.case > 0:
                yield from answers
                yield None
                return

    return engine


def test_a_run_that_ended_its_process_is_named_and_done(tmp_path):
    sweep = load_sweep(written(tmp_path))
    made = Campaign(sweep, tmp_path / "out", engine=engine_of(Lost(2, 5)))
    (run,) = list(made)
    assert (run.case, run.seed, run.rows[0].refusal) == (2, 5, ENDED)
    assert made.lost == [Lost(2, 5)]
    assert Campaign(sweep, tmp_path / "out", resume=True).done == 1


def test_what_was_made_is_kept_when_a_bug_ends_it(tmp_path):
    sweep = load_sweep(written(tmp_path))

    def engine(supply):
        batch = supply.take()
        rows = [ready(sweep.case(1).settings)(seed) for seed in batch.seeds]
        yield Done(1, batch.seeds, rows, 0.1)
        raise RunFailed("run with seed 3: KeyError: 'x'")

    with pytest.raises(RunFailed, match="seed 3"):
        list(Campaign(sweep, tmp_path / "out", engine=engine))
    assert Campaign(sweep, tmp_path / "out", resume=True).done == 4


def test_rows_are_written_within_a_second_also_when_nothing_comes(tmp_path, monkeypatch):
    """A clock that goes a second a look: rows are there before the next result is waited for."""
    sweep = load_sweep(written(tmp_path))
    clock = iter(range(1000))
    monkeypatch.setattr(module.time, "monotonic", lambda: next(clock))
    seen = []

    def engine(supply):
        batch = supply.take()
        rows = [ready(sweep.case(1).settings)(seed) for seed in batch.seeds]
        yield Done(1, batch.seeds, rows, 0.1)
        yield None
        seen.append(sum(map(len, made.results.known().values())))

    made = Campaign(sweep, tmp_path / "out", engine=engine)
    list(made)
    assert seen == [4]


def test_a_plan_says_how_many_and_how_large(tmp_path):
    """Rows: heading, three angles, NEES of three estimates; 2 latitudes; 6 biases."""
    size = size_of(load_sweep(written(tmp_path)), known=4)
    assert (size.cases, size.runs, size.known) == (4, 24, 4)
    assert size.rows == 24 * (3 * 5 + 2 + 6)
    assert 0 < size.seconds < 20 * 5


def test_predictions_are_those_of_a_rehearsal(whole):
    folder, _ = whole
    found = json.loads((folder / "predictions.json").read_text())
    told = stand.rehearse(settings_of_run(folder, 2, 0)).predictions
    first = next(p for p in told if p.determined)
    same = [p for p in found["2"] if p["method"] == first.method and p["place"] == first.label]
    assert {p["quantity"]: p["rms"] for p in same}[first.quantity] == first.rms


def test_the_python_face(tmp_path):
    path = written(tmp_path, SWEEP.replace("runs = 6", "runs = 2"))
    made = stand.campaign(path, tmp_path / "out", workers=1)
    parts = []
    assert made.run(parts.append) is made
    assert parts[-1] == 1.0
    assert len(made.columns()["case"]) == made.table().num_rows == 8 * 23
    assert "Short rests: 8 of 8 runs" in repr(made)
    assert isinstance(made.write_page(), Path)
    with pytest.raises(StandError, match="workers = 0: must be 1 or more"):
        stand.campaign(path, tmp_path / "other", workers=0)


def test_a_stretch_that_is_refused_has_a_row_and_the_others_theirs(tmp_path, monkeypatch):
    """triad refuses the first of two rests: the second's numbers are all there."""
    estimate = ESTIMATORS["triad"].estimate

    def half_hearted(dwells, site, options):
        if dwells[0].label == "first":
            raise AlignmentError("first: not at rest")
        return estimate(dwells, site, options)

    monkeypatch.setitem(ESTIMATORS, "triad", replace(ESTIMATORS["triad"], estimate=half_hearted))
    sweep = load_sweep(written(tmp_path))
    rows = [row for row in ready(sweep.case(1).settings)(0) if row.method == "triad"]
    (refused,) = [row for row in rows if not row.quantity]
    assert (refused.place, refused.refusal) == ("first", "first: not at rest")
    assert {row.place for row in rows if row.quantity} == {"second rest"}
