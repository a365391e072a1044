"""Proposals: numbers by hand for search and bound; every proposal passes its own rehearsal."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from alignment.calibration import terms
from alignment.calibration.design import Design
from alignment.calibration.model import Model
from alignment.calibration.session import Session
from alignment.earth import EARTH_RATE
from alignment.units import DEG, DEG_PER_HOUR, MICRO_G
from stand.errors import StandError
from stand.procedure.procedure import procedure_from
from stand.proposal import search
from stand.proposal.candidates import Candidate, Clock, candidates
from stand.proposal.heading import floor_time
from stand.proposal.information import Problem, settings_of
from stand.proposal.preparation import request
from stand.proposal.propose import propose
from stand.proposal.trim import dwells, trimmed
from stand.proposal.wanted import wanted_of
from stand.rehearsal.rehearse import prepared, rehearse
from stand.rehearsal.result import Verdict
from stand.simulation.settings import settings as settings_for
from stand.table.table import load_table
from stand.toml_files import Source

CASE = {
    "accel_bias_ug": 100.0,
    "accel_scale_ppm": 50.0,
    "misalignment_arc_s": 10.0,
    "gyro_scale_ppm": 20.0,
    "gyro_bias_deg_h": 1.0,
    "coverage": 1.0,
    "guard": 0.0,
}


def like(imu="stim300", table="precision", rate_hz=50):
    return settings_for("two-position", imu, table, rate_hz=rate_hz)


class Line:
    """Two candidates and one unknown: what the search sees of a problem, worked out by hand.

    A second of the first is worth 4, of the second 1; the prior is worth 1.
    """

    def __init__(self, most):
        self.rows = [np.array([[2.0]]), np.array([[1.0]])]
        self.told = self.rows
        self.wanted_rows = np.array([[1 / np.sqrt(most)]])
        self.candidates = (Candidate((0.0, 0.0, 0.0)), Candidate((90.0, 0.0, 0.0)))

    def covariance(self, t):
        return np.array([[1 / (1 + 4 * t[0] + t[1])]])

    def squares(self, t):
        return np.diag(self.wanted_rows.T @ self.covariance(t) @ self.wanted_rows)


def test_the_weights_and_the_bound_of_one_unknown_are_those_by_hand():
    # variance 1 / (1 + 4 t) = 1/41: t = 10 s of the better one, and that is the bound too
    found = search.convex(Line(1 / 41), rounds=200)
    assert found.t[0] == pytest.approx(10.0, rel=2e-3)
    assert found.t[1] < 1e-3
    assert found.bound == pytest.approx(10.0, rel=2e-3)
    assert found.bound <= 10.0 + 1e-9


@given(st.floats(1.5, 1e4))
@settings(max_examples=30, deadline=None)
def test_the_bound_is_never_above_the_best(precision):
    # 1 + 4 t = precision
    found = search.convex(Line(1 / precision), rounds=60)
    assert found.bound <= (precision - 1) / 4 * (1 + 1e-9)


def test_a_rest_counts_down_by_less_than_a_fifth():
    lengths = np.array(dwells(1.0, 3000.0))
    assert lengths[0] == 1.0
    assert np.all(np.diff(lengths) > 0)
    assert np.all(lengths[1:] * 0.8 <= lengths[:-1] + 1e-9)


def test_trimming_leaves_nothing_that_could_go():
    # kept while a and b together have 30 s and b alone 7: c is of no use
    a, b, c = (Candidate((angle, 0.0, 0.0)) for angle in (0.0, 90.0, 180.0))

    def keeps(amounts):
        own = dict(amounts)
        return own.get(a, 0) + own.get(b, 0) >= 30 and own.get(b, 0) >= 7

    found = dict(trimmed(((a, 60.0), (b, 20.0), (c, 5.0)), keeps, 2.0))
    assert c not in found
    assert found.get(a, 0) + found[b] == 30


def test_times_are_those_of_the_planner():
    clock = Clock(load_table("precision"))
    # 90 deg at 200 deg/s^2 and 1000 deg/s^3 (inner): a/j = 0.2 s each, v = 124.2 deg/s at most:
    # 2 (0.1 + sqrt(0.01 + 90/200)) = 1.556 s, so 2 s
    assert clock.move((0, 0, 0), (0, 0, 90)) == 2.0
    # middle at 50 deg/s: 150 deg/s^2, 600 deg/s^3: 50/150 + 150/600 = 0.583 s; ends after
    # 1 + 7.2 + 0.583 s, so 9 s each way
    turns = Candidate((0.0, 0.0, 0.0), "middle", 50.0)
    assert clock.ramp(turns) == pytest.approx(50 / 150 + 150 / 600)
    assert clock.length(turns, 14.4) == 18.0


def test_the_search_counts_what_the_calibration_counts():
    wanted, made = request(None, imu="stim300", table="mid-class", heading_deg=1.0, rate_hz=50)
    wanted = wanted_of(CASE, {})
    those = candidates(wanted, made.imu, made.table)[::5]
    problem = Problem(wanted, those, made, wanted.entry.require.limits())
    t = np.zeros(len(those))
    for k, one in enumerate(those):
        t[k] = (3 * one.quantum or 17.0) * (k % 2)
    spans, numbers = problem._spans(t)
    stations = [
        replace(
            problem._all()[n],
            stretch=replace(
                problem._all()[n].stretch, start=s.start, duration=s.length * (1 + 1e-9)
            ),
        )
        for s, n in zip(spans, numbers, strict=True)
    ]
    design = Design(Model([Session(tuple(stations), (), 1 / 50)], problem._bench, made.site))
    rows = np.zeros((len(problem.goal.names), design.model.count))
    rows[:, : terms.COUNT] = problem.goal.rows
    rows = rows[:, design.active] / problem.goal.limits[:, None]
    expected = np.einsum("ka,ab,kb->k", rows, design.covariance, rows)
    assert problem.exact(t) == pytest.approx(expected, rel=1e-8)  # of like sums in another order


def test_an_accelerometer_bias_by_hand():
    """Two faces say bias + seat: more time of both leaves noise / sqrt(T) of it, and the prior."""
    wanted = wanted_of({"accel_bias_ug": 1e6, "coverage": 1.0, "guard": 0.0}, {})
    made = settings_of_unit()
    those = [Candidate((0.0, 0.0, 0.0)), Candidate((0.0, 0.0, 180.0))]
    problem = Problem(wanted, those, made, wanted.entry.require.limits())
    y1 = 1  # of X1, Y1, Z1
    t = np.full(2, 10.0)
    sigma = np.sqrt(problem.squares(t)[y1]) * 1e6 * MICRO_G
    unit = made.imu.accel
    noise, bias = float(np.max(unit.noise)), float(np.max(unit.bias))
    # Y1 up and down: half the sum of the means is the bias, its noise that of 20 s
    by_hand = 1 / np.sqrt(20.0 / noise**2 + 1 / bias**2)
    assert sigma == pytest.approx(by_hand, rel=0.02)  # asymmetry and quadratic terms beside it


def settings_of_unit():
    return like("hg9900")


def test_white_noise_alone_takes_so_long():
    made = like("stim300")
    # ARW 0.15 deg/rt-h: (0.15 deg/rt-h / (15.04 deg/h cos 48.5 deg 2.273 deg))^2 = 0.1438 h
    seconds = floor_time(made, 5 / 2.2 * DEG)
    horizontal = EARTH_RATE * np.cos(48.5 * DEG) / DEG_PER_HOUR
    assert seconds == pytest.approx((0.15 / (horizontal * 5 / 2.2 * DEG)) ** 2 * 3600, rel=1e-9)


# --- whole proposals -----------------------------------------------------------------------------


def own_rehearsal(found):
    return rehearse(settings_of(found.text, found.settings))


def neighbours(text):
    """The procedure with each station left out, and with each rest a fifth shorter."""
    data = procedure_from(Source("p", "p", text)).entry
    for k, step in enumerate(data.step):
        if step.kind == "move":
            continue
        yield data.model_copy(update={"step": (*data.step[:k], *data.step[k + 1 :])})
        if step.kind == "dwell" and step.duration_s > 2.0 * 1.01:
            less = step.model_copy(update={"duration_s": 0.8 * step.duration_s})
            yield data.model_copy(update={"step": (*data.step[:k], less, *data.step[k + 1 :])})


def rehearsed(entry, made):
    from stand.rehearsal.wording import toml_of

    data = entry.model_dump(exclude_unset=True, exclude_none=True, mode="json")
    try:
        return rehearse(settings_of(toml_of(data), made)).verdict
    except StandError:  # nothing is left to estimate from
        return Verdict.FAIL


@pytest.mark.slow
@pytest.mark.parametrize(
    ("imu", "table", "most"), [("stim300", "precision", 165.0), ("hg9900", "precision", 40.0)]
)
def test_a_calibration_as_short_as_known_to_be_possible(imu, table, most):
    made = like(imu, table)
    found = propose(wanted_of(CASE, {}), made)
    assert found.feasible
    assert found.bound < found.total <= most
    assert own_rehearsal(found).verdict is Verdict.PASS
    assert own_rehearsal(found).duration.total == found.total
    for other in neighbours(found.text):
        assert rehearsed(other, made) is not Verdict.PASS


CASES = (
    (0.3, "hg9900", "laboratory", 48.5),
    (8.0, "stim300", "mid-class", -20.0),
    (0.1, "ring-laser", "precision", 60.0),
)


@pytest.mark.slow
@pytest.mark.parametrize(("heading", "imu", "table", "latitude"), CASES)
def test_a_heading_near_the_floor_of_noise(heading, imu, table, latitude):
    wanted, made = request(
        None, imu=imu, table=table, heading_deg=heading, latitude_deg=latitude, rate_hz=50
    )
    found = propose(wanted, made)
    assert found.feasible
    data = sum(s.seconds for s in found.stations)
    assert found.bound <= data
    # within 2 % of sigma is 4 % of time, and a rest or a turn is whole
    assert data <= 1.1 * found.bound + 40.0
    assert own_rehearsal(found).verdict is Verdict.PASS
    for other in neighbours(found.text):
        assert rehearsed(other, made) is not Verdict.PASS


@pytest.mark.slow
def test_what_cannot_be_reached_names_its_floor():
    found = propose(wanted_of({"misalignment_arc_s": 2.0, "coverage": 1.0}, {}), like())
    assert not found.feasible
    # the seat's 5'' about each axis, less a little that gravity and Earth rate tell of it
    left = float(found.reason.partition("alone leave ")[2].partition(" ")[0])
    assert left == pytest.approx(5.0, rel=0.05)
    assert "required 2" in found.reason


@pytest.mark.slow
def test_too_little_time_is_told():
    wanted, made = request(None, imu="hg9900", heading_deg=0.3, max_time_s=10.0, rate_hz=50)
    found = propose(wanted, made)
    assert not found.feasible
    assert "max_time_s = 10" in found.reason


@pytest.mark.parametrize(
    ("require", "allowed", "words"),
    [
        ({}, {}, "has none, must have one or more"),
        ({"heading_deg": 0.0}, {}, "heading_deg"),
        ({"heading_deg": -1.0}, {}, "heading_deg"),
        ({"speed": 1.0}, {}, "speed"),
        ({"heading_deg": 1.0}, {"max_time_s": 1.0}, "shortest_dwell_s"),
        ({"heading_deg": 1.0}, {"turning": ("outer", "outer")}, "each axis once"),
        ({"heading_deg": 1.0}, {"positions": ()}, "positions"),
    ],
)
def test_a_bad_requirement_is_one_line(require, allowed, words):
    with pytest.raises(StandError) as told:
        wanted_of(require, allowed)
    assert words in str(told.value)
    assert "\n" not in str(told.value)


def test_what_the_table_has_not_is_one_line(tmp_path):
    wanted = wanted_of({"gyro_scale_ppm": 100.0}, {"turn_rates_deg_s": (1000.0,)})
    with pytest.raises(StandError, match="turns at 200 deg/s at most"):
        candidates(wanted, like().imu, like().table)
    text = (
        'title = "One axis"\nsource = "by hand"\n[axis.outer]\nrate_deg_s = 100.0\n'
        "acceleration_deg_s2 = 100.0\njerk_deg_s3 = 400.0\n"
    )
    (tmp_path / "one.toml").write_text(text)
    one = load_table(str(tmp_path / "one.toml"))
    wanted = wanted_of({"gyro_scale_ppm": 100.0}, {"turning": ("inner",)})
    with pytest.raises(StandError, match="has no axis inner, it has outer"):
        candidates(wanted, like().imu, one)
    # where nothing was asked, only what it has is looked at
    own = candidates(wanted_of({"gyro_scale_ppm": 100.0}, {}), like().imu, one)
    assert {c.axis for c in own} == {"", "outer"}
    assert all(c.position[1:] == (0.0, 0.0) for c in own)


def test_a_method_that_does_not_find_it_is_one_line():
    wanted = wanted_of({"gyro_scale_ppm": 100.0, "method": "triad"}, {})
    with pytest.raises(StandError, match='method = "triad": does not find gyro scale'):
        propose(wanted, like())


def test_a_constant_that_the_sheet_does_not_state_is_looked_for():
    made = like("hg9900")
    assert not made.imu.gyro.misalignment
    wanted = wanted_of({"misalignment_arc_s": 300.0, "coverage": 1.0, "guard": 0.0}, {})
    problem = Problem(wanted, [Candidate((0.0, 0.0, 0.0))], made, wanted.entry.require.limits())
    assert "misalignment" in problem.goal.names
    # within ten times a usual unit's 1 mrad of 206.3'', beside the non-orthogonality that it has
    before = np.sqrt(problem.squares(np.zeros(1)).max()) * 300.0
    assert before == pytest.approx(2062.6, rel=0.002)


def test_scenes_of_other_tables_keep_their_times():
    """A plan's length is what the clock said before it was planned."""
    for table in ("laboratory", "mid-class", "precision"):
        made = like(table=table)
        wanted = wanted_of({"gyro_scale_ppm": 100.0}, {})
        those = candidates(wanted, made.imu, made.table)[::9]
        problem = Problem(wanted, those, made, wanted.entry.require.limits())
        t = np.array([one.quantum or 7.0 for one in those])
        order = problem.order(t)
        from stand.proposal.text import procedure_of

        amounts = [(those[k], float(t[k])) for k in order]
        text = procedure_of(wanted, amounts, ("calibration",), table=table)
        scene = prepared(settings_of(text, made))
        assert scene.plan.motion.duration == pytest.approx(problem.total(t), abs=1e-9)


def test_a_position_is_named():
    names = SimpleNamespace(a=Candidate((0.0, 90.0, 0.0)), b=Candidate((90.0, 0.0, 180.0)))
    assert names.a.label() == "X1 up"
    assert names.b.label() == "Y1 down, 90 deg"
    assert Candidate((0.0, 0.0, 0.0), "outer", 50.0).label() == "outer at 50 deg/s from Y1 up"
