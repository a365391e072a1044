"""What a rehearsal's answer says of itself, by hand."""

from dataclasses import replace
from math import inf, sqrt

import numpy as np
import pytest
from rehearsed import answer, infeasible, margins, prediction, verified

from alignment.earth import Site
from alignment.information.circle import Rival
from stand.rehearsal.predictions import prediction as predicted
from stand.rehearsal.predictions import rounder, withheld
from stand.rehearsal.result import Finding, Judgement, Severity, Verdict


def of(*verdicts):
    """An answer that the table can make, with these verdicts of quantities."""
    made = answer(Verdict.PASS)
    (one, *_) = made.judgements
    return replace(made, judgements=tuple(replace(one, verdict=v) for v in verdicts))


@pytest.mark.parametrize(
    ("verdicts", "accurate", "whole"),
    [
        ((), True, "PASS"),
        (("PASS", "PASS"), True, "PASS"),
        (("PASS", "INDETERMINATE"), False, "INDETERMINATE"),
        (("INDETERMINATE", "FAIL"), False, "FAIL"),
        (("FAIL",), False, "FAIL"),
    ],
)
def test_the_worst_verdict_is_that_of_the_whole(verdicts, accurate, whole):
    made = of(*map(Verdict, verdicts))
    assert (made.accurate, made.feasible, made.verdict) == (accurate, True, Verdict(whole))


def test_what_forbids_a_run():
    assert not infeasible().feasible
    assert (infeasible().accurate, infeasible().verdict) == (True, Verdict.FAIL)
    for severity, feasible in ((Severity.ERROR, False), (Severity.WARNING, True)):
        made = replace(of(Verdict.PASS), findings=(Finding(severity, "plan", "", "no"),))
        assert made.feasible == feasible
        assert (made.verdict is Verdict.PASS) == feasible
    # what runs contradict is no verdict, whatever else there is
    assert verified(Verdict.PASS).verdict is Verdict.PASS
    assert verified(Verdict.FAIL, heading=0.7).verdict is Verdict.CONTRADICTED


def test_margins_of_a_step():
    kept, broken = (replace(answer().feasibility[0], margins=margins(b)) for b in (False, True))
    assert (kept.feasible, broken.feasible) == (True, False)
    # 30 of 200 deg/s^2 is nearest, 0.85 of it are left; 320 of 300 deg/s is beyond
    assert kept.worst is not None
    assert (kept.worst.quantity, kept.worst.margin) == ("acceleration", 0.85)
    assert broken.worst is not None
    assert (broken.worst.quantity, broken.worst.kept) == ("rate", False)
    assert broken.worst.margin == pytest.approx(-1 / 15)
    assert replace(kept, margins=()).worst is None


def test_sums_of_the_durations():
    made = answer().duration
    assert (made.motion, made.settling, made.dwell) == pytest.approx((7.2, 1.7, 590.9))
    assert made.total == 600.0


def test_sigma_and_bias_in_quadrature():
    one = replace(prediction("triad", "a", "heading", "deg", 0.1, ("noise", 30.0)), bias=-4.0)
    assert one.rms == 5.0
    assert one.drawn == 5.0
    assert replace(one, assumed=3.0).drawn == 4.0
    assert replace(one, assumed=6.0).drawn == 0.0  # rounding of the last digit
    none = replace(one, sigma=None, beyond=0.5)
    assert (none.rms, none.drawn, none.determined, one.determined) == (None, None, False, True)
    # those with a number come first, the best before the others
    better = replace(one, sigma=1.0, bias=0.0)
    worst = replace(none, beyond=inf)
    assert sorted([worst, none, one, better], key=lambda p: p.rank) == [better, one, none, worst]


def made_of(limit, bias=0.0, **sizes):
    return predicted("triad", "", "a", "roll", ("deg", 0.1), sizes, limit, lambda: "why", bias)


def test_sources_of_a_prediction_in_their_order():
    one = made_of(10.0, noise=3.0, drift=4.0, nothing=4e-6)
    assert one.sigma == pytest.approx(5.0)
    assert [(c.source, c.sigma) for c in one.contributions] == [("drift", 4.0), ("noise", 3.0)]
    one = made_of(13.1, bias=-12.0, noise=3.0, drift=4.0)
    assert (one.sigma, one.bias) == (pytest.approx(5.0), -12.0)
    assert one.contributions[0].sigma == 12.0
    assert one.rms == pytest.approx(13.0)


def test_what_is_beyond_first_order_has_no_number():
    """Five of something are not below five; a bias of twelve and a sigma of five make thirteen."""
    assert made_of(5.0001, noise=3.0, drift=4.0).determined
    none = made_of(5.0, noise=3.0, drift=4.0)
    assert (none.sigma, none.beyond, none.contributions) == (None, 5.0, ())
    assert none.reason == "not determined: sigma of 50 deg is beyond first order; why"
    none = made_of(13.0, bias=12.0, noise=5.0)
    assert none.reason.startswith("not determined: error that is known of 130 deg is beyond")
    assert made_of(float("inf"), noise=float("nan")).sigma is None


def test_a_number_is_withheld_where_there_is_a_reason():
    found = [made_of(9.0, noise=1.0), replace(made_of(9.0, noise=1.0), quantity="pitch")]
    roll, pitch = withheld(found, ("roll",), "it rocks")
    assert (roll.sigma, roll.reason) == (None, "not determined: it rocks")
    assert pitch is found[1]
    assert list(withheld(found, ("roll", "pitch"), "")) == found


def test_the_circle_of_headings_adds_to_the_variance_of_heading_alone():
    """A rms of 1.25 times that of first order: 0.5625 of its variance more."""
    parts = {"a": np.diag([1.0, 2.0, 3.0]), "b": np.diag([1.0, 1.0, 1.0])}
    more = rounder(parts, Rival(1.25, 1.0, 9.0), Site(0.8))
    assert more.pop("heading beyond first order") == pytest.approx(np.diag([0, 0, 2.25]))
    assert more == parts
    assert rounder(parts, Rival(1.0, 0.0, np.inf), Site(0.8)) == parts
    assert rounder(parts, Rival(0.9, 0.0, np.inf), Site(0.8)) == parts  # it makes nothing better


def test_an_expanded_uncertainty():
    one = Judgement("heading", "triad", "a", 1.0, 3.0, 1.0, 0.1, Verdict.PASS, bias=-1.0)
    assert one.expanded == pytest.approx(3 * sqrt(2))
    assert (replace(one, sigma=None).rms, replace(one, sigma=None).expanded) == (None, None)
