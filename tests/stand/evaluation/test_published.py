"""The audit of the papers: rows with all they owe, verdicts that can be worked out by hand."""

import json
import re
from math import pi

import numpy as np
import pytest
from pages import checked

from alignment.units import ARC_MINUTE, DEG
from stand.errors import StandError
from stand.evaluation.published import PAPERS, Row, Verdict, audit, fixes, gyrocompassing, rocking
from stand.evaluation.published import six_position as six
from stand.evaluation.published.row import solved
from stand.report.published import audit_text, write_audit

W = 15.041067  # deg/h


def quiet(done):
    """Progress of a test."""


@pytest.fixture(scope="module")
def quick():
    """Rows of the papers that take no runs."""
    return {row.key: row for row in (*rocking.rows(quiet), *gyrocompassing.rows(quiet))}


def test_rows_owe_all_their_parts(quick):
    assert len(quick) == len(rocking.rows(quiet)) + len(gyrocompassing.rows(quiet))  # keys differ
    for row in quick.values():
        assert all((row.place, row.quantity, row.printed, row.ours, row.reason, row.command)), row
        assert row.command.startswith("stand "), row
        assert not re.search(r"\bnan\b|\binf\b", row.ours + row.nearest), row


def test_what_does_not_reproduce_says_what_would(quick):
    told = [r for r in quick.values() if r.verdict is Verdict.NOT_REPRODUCED]
    assert told
    assert [r.key for r in told if not r.nearest] == []


# --- [S4] by hand --------------------------------------------------------------------------------


def test_levelling_examples(quick):
    """methods.md section 2: 39.3' or 38.1'; 35.8' or 38.2'; 0.486' and 0.488' with another g."""
    at = {key.removeprefix("S4 example, "): row for key, row in quick.items()}
    assert at["roll at 0.1 m/s^2"].ours == "39.3' or 38.1'"
    assert at["pitch at 0.1 m/s^2"].ours == "35.8' or 38.2'"
    verdicts = [at[f"{a} at {b} m/s^2"].reproduced for b in (0.1, 0.001) for a in ("roll", "pitch")]
    assert verdicts == [True, False, False, True]
    # by hand: 41' by asin leaves K = (41' - b/(g cos 5))/tan 5
    b = 0.1 / 9.81 / np.cos(5 * DEG)
    K = (41 * ARC_MINUTE - b) / np.tan(5 * DEG)
    assert pytest.approx(0.0194, abs=1e-4) == K
    assert f"{K * 100:.2g} % by asin" in at["pitch at 0.1 m/s^2"].nearest


def test_double_examples(quick):
    row = quick["S4 example, double gyrocompassing"]
    assert row.ours == "1.6' (latitude 45 deg) to 2.0' (60 deg)"
    # 1.3' is D + K tan(lat) tan 5: at 45 deg D = 0.70'
    left = 1.3 - 0.002 * np.tan(5 * DEG) / ARC_MINUTE
    assert row.nearest.startswith(f"{left:.2f}' of placement")
    assert "58 to 927 days" in quick["S4 example, double gyrocompassing, noise"].ours
    assert "stim300 never" in quick["S4 example, double gyrocompassing, units"].ours
    # 10 sin 5 east, 15.041 cos 50 and 10 sin 5 cos 5 north: 283.6', and 339' where they oppose
    assert quick["S4 claim, constant biases cancel: Y1"].ours.startswith("284' (X1 south), 339'")
    # 1 deg/h/g times sin 5 over 9.96651 deg/h
    assert "30'" in quick["S4 claim, constant biases cancel: g-sensitivity"].ours
    assert pytest.approx(30, abs=0.1) == 0.0871557 / 9.96651 * 60 / DEG


def test_printed_half_turn_terms(quick):
    """Roll as printed is the error of a tangent; yaw leaves the levelling out."""
    for name in ("bias", "scale", "placement"):
        row = quick[f"S4 formula (13), roll, {name}"]
        printed, ours = (float(text.split("'")[0]) for text in (row.printed, row.ours))
        # digits of 0.01', and what is second order
        assert printed / ours == pytest.approx(1 / np.cos(12 * DEG) ** 2, abs=0.015)
        assert not row.reproduced
    for key in ("(13), pitch, scale", "(13), pitch, placement", "(15), yaw, scale"):
        assert quick[f"S4 formula {key}"].reproduced
    assert quick["S4 formula (15), yaw, placement"].reproduced
    assert not quick["S4 formula (15), yaw, levelled by the same turn"].reproduced


def test_chart_of_worst_heading():
    """No turn: bias over the horizontal rate, X1 west; a turn: the placement with K's floor."""
    alone, turned = gyrocompassing.worst_heading([0.01 * DEG / 3600], [10 * ARC_MINUTE])
    north = W * np.cos(50 * DEG) * np.cos(5 * DEG)
    assert alone[0] == pytest.approx(0.01 / north, rel=0.01)
    assert 10 < turned[0] / ARC_MINUTE < 13
    blind, _ = gyrocompassing.worst_heading([20 * DEG / 3600], [ARC_MINUTE])
    assert np.isnan(blind[0])  # more than the whole horizontal rate


# --- [S1] by hand --------------------------------------------------------------------------------


def test_real_gyros_by_hand(quick):
    # sqrt(2) 0.5 deg in 300 s are 8.485 deg/h, over 9.96651
    assert rocking.real_gyros(0.5 * DEG, 300.0, 48.5 * DEG) == pytest.approx(8.4853 / 9.96651, 1e-4)
    assert quick["S1 conclusion, any gyros"].ours == "49 deg"
    assert "23,009 times" in quick["S1 conclusion, any gyros"].reason  # 0.4 pi/(W sin 48.5)
    assert 0.4 * pi / (W * DEG / 3600 * np.sin(48.5 * DEG)) == pytest.approx(23009, abs=1)
    assert quick["S1 formula (15)"].reproduced


def test_admissible_rocking():
    """Fast rocking: 0.1 deg W cos lat T/sqrt 2; a base that hardly moves may rock by more."""
    fast = rocking.admissible(np.array([5.0]), 300.0)[0]
    assert fast == pytest.approx(0.1 * DEG / rocking.real_gyros(1.0, 300.0, 48.5 * DEG), rel=1e-6)
    slow = rocking.admissible(np.array([1e-5, 2e-5]), 300.0)
    # sqrt(1 - rho) is w T/sqrt 2 of a smooth rocking: half the frequency, twice the angle
    assert slow[0] / slow[1] == pytest.approx(2, rel=0.01)
    assert slow[0] == pytest.approx(fast * 2**0.5 / (2 * pi * 1e-5 * 300), rel=0.01)


# --- [S0], [S2] ----------------------------------------------------------------------------------


def test_printed_tables_give_the_printed_deviations():
    rows = six._sigma_rows()
    assert len(rows) == 6
    assert all(row.reproduced and row.ours.startswith(row.printed.split()[0]) for row in rows)


def test_error_integral_as_printed():
    still, turned = fixes._integral(0.0), fixes._integral(pi / 2)
    assert max(still) < 1e-4
    assert turned[0] > 0.5
    assert turned[1] < 1e-4


def test_closed_form_of_the_flight(monkeypatch):
    monkeypatch.setattr(fixes, "FLIGHTS", 2)
    found = fixes.flight.__wrapped__()
    k = int(np.searchsorted(found.t, 59.0))
    assert found.closed[k] == pytest.approx((25 + 2.95**2 + 17.405**2) ** 0.5)
    assert found.corrected.tolist() == [60.0, 120.0, 180.0]
    assert found.closed[k + 1] == 5.0


@pytest.mark.slow
def test_the_whole_audit(stand_command, tmp_path):
    told = stand_command("compare", "--published", "--json", "--out", tmp_path / "page")
    rows = told.json["published"]
    assert len(rows) >= 60
    keys = [f"{row['paper']} {row['place']}" for row in rows]
    assert len(set(keys)) == len(keys)
    counted = {p.letter: sum(row["paper"] == p.letter for row in rows) for p in PAPERS}
    assert min(counted.values()) >= 20
    positions = [r for r in rows if r["place"].startswith("table of errors") and ":" in r["place"]]
    values = [r for r in positions if r["place"].split(": ")[1].split(",")[0] != "sigma"]
    assert len(values) == 36
    drifts = [r for r in values if "Runge-Kutta" in r["place"]]
    assert sum(r["verdict"] == "reproduced" for r in drifts) >= 17  # 18 within 95 % as a family
    for row in rows:
        assert not re.search(r"\bnan\b", row["ours"] + row["nearest"]), row
        assert row["verdict"] != "not reproduced" or row["nearest"] or "zero by" in row["reason"]
    page = checked((tmp_path / "page" / "published.html").read_text())
    assert f"{len(rows)}" in page.said
    assert json.loads((tmp_path / "page" / "published.json").read_text())["published"] == rows
    pictures = sorted(path.name for path in (tmp_path / "page").glob("*.png"))
    assert pictures == [
        "s0-angles.png",
        "s0-signals.png",
        "s1-rocking.png",
        "s2-position.png",
        "s4-heading.png",
    ]


# --- the command ---------------------------------------------------------------------------------


def test_one_place_alone(stand_command, tmp_path):
    out = tmp_path / "page"
    told = stand_command("compare", "--published", "--only", "S4 formula (13), pitch", "--out", out)
    assert told.code == 0, told.err
    assert told.out.count("\n  printed  ") == 2
    assert "2 of 2 reproduced" in told.out
    assert sorted(path.name for path in out.iterdir()) == [
        "published.html",
        "published.json",
        "s4-heading.png",
    ]
    checked((out / "published.html").read_text())


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--published", "--only", "S3"), ["--only 'S3'", "S0, S1, S2, S4"]),
        (("--published", "--only", "S4 formula (99)"), ["no row"]),
        (("two-position", "--only", "S4"), ["--published"]),
    ],
)
def test_places_that_are_not_there(stand_command, arguments, words):
    told = stand_command("compare", *arguments)
    assert told.code == 2
    assert [word for word in words if word not in told.err] == []


def test_text_is_as_wide_as_wanted(quick):
    text = audit_text(list(quick.values()), 60)
    assert max(map(len, text.splitlines())) <= 60
    assert text.count("  again    stand") == len(quick)


def test_only_what_is_wanted_is_worked_out(monkeypatch):
    done: list[float] = []
    rows = audit("s1 formula", done.append)
    assert {row.paper for row in rows} == {"S1"}
    assert done[-1] == pytest.approx(1)
    with pytest.raises(StandError, match="no row"):
        audit("S1 nothing")


def test_search_by_hand():
    assert solved(lambda x: x**2, 2.0, 0.0, 2.0) == pytest.approx(2**0.5, rel=1e-10)
    assert solved(lambda x: x**2, 5.0, 0.0, 2.0) is None


def test_a_folder_that_is_a_file_is_told(tmp_path):
    (tmp_path / "file").write_text("")
    row = Row(paper="S4", place="p", quantity="q", printed="1", ours="1",
              verdict=Verdict.REPRODUCED, reason="r")  # fmt: skip
    with pytest.raises(StandError):
        write_audit([row], tmp_path / "file")
