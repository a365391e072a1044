"""What a campaign says, against numbers by hand: rows are written here, nothing is simulated."""

from dataclasses import replace
from math import nan, sqrt

import numpy as np
import pytest
from pages import checked
from swept import PROCEDURE, SWEEP, written

from alignment.units import DEG
from stand.campaigns.folder import opened
from stand.campaigns.summary import (
    Series,
    clopper_pearson,
    sensitivities,
    summarised,
    summary_json,
)
from stand.campaigns.sweep import load_sweep
from stand.campaigns.trial import NEES, Row, Run
from stand.errors import StandError
from stand.report.campaign import answer, page, tables, write_page, yield_text

HEADING = Series("two-position", "", "first", "heading")


def kept(folder, runs, sweep=SWEEP, procedure=PROCEDURE):
    """A campaign's folder that holds these runs."""
    out = folder / "out"
    opened(out, load_sweep(written(folder / "files", sweep, procedure)), False).add(runs)
    return out


def run_of(case, seed, error, sigma=0.1 * DEG, refusal="", nees=3.0):
    rows = (
        Row("two-position", "", "first", "heading", 0.1, error, sigma, refusal),
        Row("two-position", "", "first", NEES, nees),
        Row("two-position", "", "all", "gyro bias X1", 1e-8, 2e-8, 3e-8),
    )
    return Run(case, seed, rows)


@pytest.fixture
def four(tmp_path):
    """Four cases of four runs, errors 1, -1, 2, -2 times 0.02, 0.04, 0.06, 0.08 deg."""
    sizes = (1, -1, 2, -2)
    runs = [
        run_of(case, seed, 0.02 * case * size * DEG)
        for case in (1, 2, 3, 4)
        for seed, size in enumerate(sizes)
    ]
    return summarised(kept(tmp_path, runs))


def test_errors_and_their_interval_by_hand(four):
    """Root mean square of 1, 1, 2, 2 is sqrt 2.5; chi-square of 4 is 0.4844 and 11.1433."""
    cells = four.of(HEADING)
    assert [cell.case for cell in cells] == [1, 2, 3, 4]
    for cell in cells:
        rms = 0.02 * cell.case * DEG * sqrt(2.5)
        assert cell.rms == pytest.approx(rms, rel=1e-6)
        assert cell.low == pytest.approx(rms * sqrt(4 / 11.1433), rel=1e-4)
        assert cell.high == pytest.approx(rms * sqrt(4 / 0.4844), rel=1e-4)
        assert cell.mean == pytest.approx(0, abs=1e-12)
        assert cell.stated == pytest.approx(0.1 * DEG, rel=1e-6)
        assert cell.predicted is None
        assert cell.parts[2] == pytest.approx(0, abs=1e-9)
    assert (four.done, four.total) == (16, 24)
    assert four.shown == (HEADING,)


def test_the_interval_of_a_share_as_tables_have_it():
    """95 %: 8 of 10 44.39 to 97.48 %, none of 10 to 30.85 %, none of 20 to 16.84 %."""
    assert clopper_pearson(8, 10) == pytest.approx((0.4439, 0.9748), abs=5e-5)
    assert clopper_pearson(0, 10) == pytest.approx((0.0, 0.3085), abs=5e-5)
    assert clopper_pearson(20, 20) == pytest.approx((1 - 0.1684, 1.0), abs=5e-5)


def test_yield_is_of_units_within_every_limit(four):
    """Within 0.1 deg: of 0.02 to 0.04 and 0.04 to 0.08 all, of 0.06, 0.12 and 0.08, 0.16 half."""
    by_case = {y.case: (y.passed, y.runs) for y in four.yields}
    assert by_case == {1: (4, 4), 2: (4, 4), 3: (2, 4), 4: (2, 4), 0: (12, 16)}
    whole = next(y for y in four.yields if not y.case)
    assert yield_text(whole) == "75.0 % (47.6-92.7) of 16 units pass by two-position."
    many = replace(whole, passed=9930, runs=10000, low=0.99117, high=0.99454)
    assert yield_text(many) == "99.3 % (99.1-99.5) of 10 000 units pass by two-position."


def test_an_answer_that_is_missing_or_cannot_stand_does_not_pass(tmp_path):
    runs = [
        run_of(1, 0, 0.0),
        run_of(1, 1, 0.0, refusal="sigma of 40 deg is above 30 deg"),
        Run(1, 2, (Row("two-position", refusal="not at rest"),)),
        Run(1, 3, (Row(refusal="ended the process that made it"),)),
    ]
    found = summarised(kept(tmp_path, runs))
    assert {y.case: (y.passed, y.runs) for y in found.yields} == {1: (1, 4), 0: (1, 4)}
    reasons = {(r.method, r.reason, r.runs) for r in found.refused}
    assert reasons == {
        ("two-position", "heading not determined: sigma is above 30 deg", 1),
        ("two-position", "not at rest", 1),
        ("", "ended the process that made it", 1),
    }


def test_a_place_that_is_refused_costs_the_unit_and_not_its_other_places(tmp_path):
    """Of three runs one has no answer at its second rest: 2 pass, and 3 errors at the first."""
    silent = Row("two-position", place="second rest", refusal="second rest: not at rest")
    lost = Run(1, 2, (*run_of(1, 2, 0.0).rows, silent))
    found = summarised(kept(tmp_path, [run_of(1, 0, 0.0), run_of(1, 1, 0.0), lost]))
    yields = {y.case: (y.method, y.window, y.passed, y.runs) for y in found.yields}
    assert yields == dict.fromkeys((0, 1), ("two-position", "", 2, 3))
    assert [cell.runs for cell in found.of(HEADING)] == [3]
    assert [(r.reason, r.runs, r.seed) for r in found.refused] == [
        ("second rest: not at rest", 1, 2)
    ]


def test_the_worst_units_are_named_with_their_limit(four):
    """0.16 of 0.1 deg is 1.6 times: seeds 2 and 3 of case 4, the first first."""
    worst = [(w.case, w.seed, round(w.times, 6)) for w in four.worst[:3]]
    assert worst == [(4, 2, 1.6), (4, 3, 1.6), (3, 2, 1.2)]
    (table,) = [t for t in tables(four) if t.title.startswith("Worst")]
    assert table.notes[0].endswith("--case 4 --seed 2")


def test_honesty_by_hand(four):
    """Of 4 runs: chi-square of 12 at 2.5 and 97.5 % is 4.4038 and 23.3367, over 4."""
    for h in four.honesty:
        assert (h.mean, h.low, h.high) == pytest.approx((3.0, 4.4038 / 4, 23.3367 / 4), rel=1e-4)


def test_sensitivities_of_every_value_with_every_other(four):
    """Rests of 10 s: cases 1, 2; so 0.02 sqrt((1 + 4)/2 2.5), and 0.02 sqrt((9 + 16)/2 2.5)."""
    rest, walk = sensitivities(four, HEADING)
    assert (rest.label, rest.values) == ("rest [s]", ("10", "20"))
    unit = 0.02 * DEG * sqrt(2.5)
    assert rest.rms == pytest.approx((unit * sqrt(2.5), unit * sqrt(12.5)), rel=1e-6)
    assert walk.rms == pytest.approx((unit * sqrt(5), unit * sqrt(10)), rel=1e-6)


def test_sensitivities_of_samples_by_a_fit(tmp_path):
    """Errors of 0.1 deg times the walk over 0.001, whatever the latitude: 1 to 10 of them."""
    drawn = SWEEP.partition("[[vary]]")[0].replace(
        "runs = 6", 'runs = 2\ncombine = "latin-hypercube"\nsamples = 16'
    )
    key = "imu.gyro.angle_random_walk_deg_rt_h"
    drawn += f'[[vary]]\nkey = "{key}"\nrange = {{ low = 0.001, high = 0.01, scale = "log" }}\n'
    drawn += '[[vary]]\nkey = "site.latitude_deg"\nrange = { low = 0, high = 50 }\n'
    sweep = load_sweep(written(tmp_path, drawn))
    runs = [
        run_of(case, seed, sign * 0.1 * DEG * walk / 0.001)
        for case, (walk, _) in enumerate(sweep.values, start=1)
        for seed, sign in enumerate((1, -1))
    ]
    walk, latitude = sensitivities(summarised(kept(tmp_path / "a", runs, drawn)), HEADING)
    assert walk.label == key
    assert np.array(walk.span) / DEG == pytest.approx((0.1, 1.0), rel=1e-5)
    assert latitude.span[1] / latitude.span[0] == pytest.approx(1, rel=1e-5)


def test_for_machines_in_units_that_are_named(four):
    told = summary_json(four)
    heading = next(e for e in told["errors"] if e["quantity"] == "heading" and e["case"] == 3)
    assert heading["unit"] == "deg"
    assert heading["rms"] == pytest.approx(0.06 * sqrt(2.5), rel=1e-6)
    bias = next(e for e in told["errors"] if e["quantity"] == "gyro bias X1")
    # 2e-8 rad/s are 2e-8 x 180/pi x 3600 deg/h
    assert (bias["unit"], bias["rms"]) == ("deg/h", pytest.approx(4.1253e-3, rel=1e-4))
    assert told["cases"][2] == {
        "case": 3,
        "values": dict(zip(told["varied"], (20, 0.001), strict=True)),
    }
    assert told["yield"][-1]["case"] is None


def test_the_page_says_it_all(four):
    """And loads nothing: one file, its figures in words too."""
    text = page(four)
    for word in ("Yield", "What matters", "Worst units", "Distribution", "short.toml"):
        assert word in text
    assert "75.0 % (47.6-92.7) of 16 units pass" in text
    assert "16 of 24 runs are there" in " ".join(answer(four))
    assert len([a for _, a in checked(text).tags if a.get("role") == "img"]) == 6
    assert write_page(four).name == "campaign.html"


def test_predictions_stand_beside(tmp_path):
    from stand.campaigns.campaign import Campaign

    one = SWEEP.partition("[[vary]]")[0].replace("runs = 6", "runs = 4")
    made = Campaign(load_sweep(written(tmp_path, one)), tmp_path / "out", workers=1)
    list(made)
    summary = summarised(tmp_path / "out")
    (cell,) = [c for c in summary.cells if c.series == HEADING]
    assert cell.predicted == pytest.approx(cell.stated, rel=0.3)
    assert summary.of(HEADING)[0].parts[0] <= summary.of(HEADING)[0].parts[-1]


def test_nothing_there_yet_is_told(tmp_path):
    out = kept(tmp_path, [])
    with pytest.raises(StandError, match="holds no runs yet"):
        summarised(out)


def test_a_unit_without_errors_is_shown_as_such(tmp_path):
    """Errors of exactly nothing: no logarithm, no ratio, a page all the same."""
    runs = [run_of(case, seed, 0.0, nees=nan) for case in (1, 2, 3, 4) for seed in range(2)]
    summary = summarised(kept(tmp_path, runs))
    assert sensitivities(summary, HEADING) == []
    assert "<svg" in page(summary)
