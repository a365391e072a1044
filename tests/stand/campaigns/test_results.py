"""Rows of a campaign: the same bytes in any order, whole or not there, few files, small ones."""

import hashlib
import random
import time
from math import nan

import numpy as np
import pytest

from stand.campaigns import results as module
from stand.campaigns.results import COLUMNS, FILE, PARTS, NotWritten, Results
from stand.campaigns.trial import Row, Run
from stand.errors import StandError


def runs_of(cases, seeds, rng=None, places=("first", "second")):
    """Runs with some rows each, one of which is refused."""
    rng = rng or np.random.default_rng(0)
    made = []
    for case in range(1, cases + 1):
        for seed in range(seeds):
            rows = [
                Row("triad", "", place, quantity, *numbers)
                for place in places
                for quantity, numbers in zip(
                    ("heading", "roll", "pitch", "yaw", "NEES"),
                    rng.normal(size=(5, 3)) * [1.0, 1e-3, 1e-6] + [0, 0, 1e-3],
                    strict=True,
                )
            ]
            rows.append(Row("two-position", refusal="too short"))
            made.append(Run(case, seed, tuple(rows)))
    return made


def opened(folder):
    (folder / PARTS).mkdir(parents=True)
    return Results(folder)


def digest(folder):
    return hashlib.sha256((folder / FILE).read_bytes()).hexdigest()


def test_the_same_bytes_in_any_order_and_in_any_parts(tmp_path):
    runs, found = runs_of(3, 20), set()
    for n, size in enumerate((60, 7, 1)):
        results = opened(tmp_path / str(n))
        shuffled = runs[:]
        random.Random(n).shuffle(shuffled)
        for k in range(0, len(runs), size):
            results.add(shuffled[k : k + size])
        results.finish()
        assert [p.name for p in (tmp_path / str(n)).iterdir()] == [FILE]
        found.add(digest(tmp_path / str(n)))
    assert len(found) == 1


def test_rows_come_back_as_they_were(tmp_path):
    results = opened(tmp_path)
    row = Row("triad", "", "up", "heading", estimate=1 / 3, error=1e-3, sigma=nan, noise_only=True)
    results.add([Run(2, 7, (Row("triad", refusal="not at rest"), row))])
    columns = results.columns()
    assert list(columns) == list(COLUMNS)
    assert columns["case"].tolist() == [2, 2]
    assert columns["seed"].tolist() == [7, 7]
    assert columns["refusal"].tolist() == ["not at rest", ""]
    assert columns["noise_only"].tolist() == [False, True]
    assert columns["estimate"][1] == 1 / 3  # all digits
    assert columns["error"][1] == pytest.approx(1e-3, rel=6e-8)  # of a 24 bit number
    assert np.isnan([columns["estimate"][0], columns["error"][0], columns["sigma"][1]]).all()
    results.finish()
    for name, before in columns.items():
        np.testing.assert_array_equal(results.columns()[name], before)


def test_a_run_that_is_in_two_parts_counts_once(tmp_path):
    """As after an end between a part of several and the removal of these."""
    once, twice = opened(tmp_path / "a"), opened(tmp_path / "b")
    runs = runs_of(1, 6)
    once.add(runs)
    for part in (runs[:4], runs[2:], runs):
        twice.add(part)
    assert twice.known() == {1: set(range(6))}
    once.finish()
    twice.finish()
    assert digest(tmp_path / "a") == digest(tmp_path / "b")


def test_parts_are_gathered(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "GATHERED", 4)
    results = opened(tmp_path)
    runs = runs_of(1, 30)
    for run in runs:
        results.add([run])
        # of thirty parts of one run: 7 of four, 1 of sixteen
        assert len(results.files()) <= 9
    assert sorted(p.name[0] for p in (tmp_path / PARTS).iterdir()) == ["0", "0", "1", "1", "1", "2"]
    assert results.known() == {1: set(range(30))}


def test_what_is_whole_is_gone_on_with(tmp_path):
    results, other = opened(tmp_path / "a"), opened(tmp_path / "b")
    runs = runs_of(2, 10)
    results.add(runs[:11])
    results.finish()
    again = Results(tmp_path / "a")
    assert again.known() == {1: set(range(10)), 2: {0}}
    (tmp_path / "a" / PARTS).mkdir()
    again.add(runs[11:])
    again.finish()
    other.add(runs)
    other.finish()
    assert digest(tmp_path / "a") == digest(tmp_path / "b")


def test_100_000_rows_are_small_and_soon_known(tmp_path):
    """Two numbers of 7 digits and one of 16 in a row; what is said of time is a minute of slack."""
    results = opened(tmp_path)
    runs = runs_of(10, 910)
    rows = sum(len(run.rows) for run in runs)
    assert rows == 100_100
    for k in range(0, len(runs), 200):
        results.add(runs[k : k + 200])
    begin = time.process_time()
    known = results.known()
    assert time.process_time() - begin < 1.0
    assert sum(map(len, known.values())) == len(runs)
    results.finish()
    assert (tmp_path / FILE).stat().st_size < 1.5e6


def test_a_file_that_is_no_results_is_told(tmp_path):
    results = opened(tmp_path)
    (tmp_path / FILE).write_bytes(b"PAR1 no")
    with pytest.raises(StandError, match=r"results.parquet: is no results of a campaign"):
        results.known()


def test_what_cannot_be_written_is_told_and_leaves_nothing(tmp_path, monkeypatch):
    results = opened(tmp_path)
    results.add(runs_of(1, 2))
    monkeypatch.setattr(
        "stand.folder._write", lambda *a: (_ for _ in ()).throw(OSError(28, "No space left"))
    )
    with pytest.raises(NotWritten, match=r"parts.*: cannot write there: No space left"):
        results.add(runs_of(2, 2))
    assert len(list((tmp_path / PARTS).iterdir())) == 1
    assert results.known() == {1: {0, 1}}


def test_without_pyarrow_one_line(tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "pyarrow", None)
    with pytest.raises(StandError, match=r"pip install 'imu-test-stand\[campaign\]'"):
        Results(tmp_path)
