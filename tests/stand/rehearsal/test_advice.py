"""Which changes advice tries, how far it goes and what it says: every variant by hand.

The rehearsals themselves are told what to say, for it is the search that is tested.
"""

from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
from test_rehearsal import asked, case

from stand.rehearsal import advice
from stand.rehearsal.advice import with_advice
from stand.rehearsal.result import (
    Contribution,
    Duration,
    Judgement,
    Prediction,
    Rehearsal,
    StepDuration,
    Verdict,
)

REQUIRED = 'title = "A case"\ntable = "mid-class"\n[require]\nheading_deg = 1.0\n'
SITE = "[site]\nlatitude_deg = 48.5\n"
DWELL = '[[step]]\nkind = "dwell"\nlabel = "{}"\nduration_s = {}\n'
MOVE = '[[step]]\nkind = "move"\nlabel = "{}"\n{}\n'
TURN = '[[step]]\nkind = "rate"\nlabel = "round"\naxis = "outer"\n{}\n'


def procedure(methods, *steps, head=REQUIRED):
    quoted = ", ".join(f'"{m}"' for m in methods)
    return case(head + SITE + f"[estimate]\nmethods = [{quoted}]\n" + "".join(steps))


def seconds(entry):
    """Of rest and of turns."""
    rests = sum(s.duration_s for s in entry.step if s.kind == "dwell")
    rates = [s for s in entry.step if s.kind == "rate"]
    turns = sum(360 * s.turns / abs(s.rate_deg_s) * (1 + (s.directions == "both")) for s in rates)
    return rests + turns


def judged(quantity, sigma, verdict):
    return Judgement(
        quantity=quantity,
        method="triad",
        label="rest",
        required=np.radians(1.0),
        coverage=2.0,
        sigma=None if sigma is None else np.radians(sigma),
        guard=0.1,
        verdict=verdict,
    )


@pytest.fixture
def told(monkeypatch):
    """`with_advice` of a procedure, where a function of its entry says what comes of it.

    It answers the sigma of heading [deg] and whether that passes, or several such by quantity.
    Gives the advice, and all entries that were looked at.
    """

    def call(made, says):
        seen = []

        def rehearse(settings, judged_only=False):
            entry = settings.procedure.entry
            seen.append(entry)
            found = says(entry)
            found = found if isinstance(found, dict) else {"heading": found}
            total = seconds(entry)
            return Rehearsal(
                inputs=None,
                feasibility=(SimpleNamespace(feasible=True),),
                duration=Duration((StepDuration(1, "dwell", "", 0.0, total, 0.0, 0.0, total),)),
                predictions=(),
                observability=(),
                judgements=tuple(
                    judged(name, sigma, Verdict.PASS if well else Verdict.FAIL)
                    for name, (sigma, well) in found.items()
                ),
                advice=(),
                findings=(),
            )

        monkeypatch.setattr(advice, "rehearse", rehearse)
        return with_advice(asked(made)).advice, seen[1:]  # the first is of the procedure itself

    return call


def never(entry):
    """Nothing helps, and a longer stretch gains nothing."""
    return 5.0, False


def as_they_are(seen):
    """Of every variant its own length: the longer one that is tried then is left out."""
    return seen[::2]


# --- variants


def test_a_turn_goes_both_ways_slower_and_twice(told):
    turn = TURN.format("rate_deg_s = 20\nturns = 3")
    _, seen = told(procedure(["carousel"], turn), never)
    tried = [(s.directions, s.rate_deg_s, s.turns) for (s,) in (e.step for e in seen)]
    own = ("one", 20, 3), ("both", 20, 3), ("one", 10, 3), ("one", 20, 6)
    longer = ("one", 20, 6), ("both", 20, 6), ("one", 10, 6), ("one", 20, 12)
    assert tried == [one for pair in zip(own, longer, strict=True) for one in pair]


def test_what_goes_both_ways_already_is_not_turned_round(told):
    turn = TURN.format('rate_deg_s = 20\nturns = 3\ndirections = "both"')
    _, seen = told(procedure(["carousel"], turn), never)
    assert [(s.rate_deg_s, s.turns) for (s,) in (e.step for e in as_they_are(seen))] == [
        (20, 3), (10, 3), (20, 6),
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("lengths", "window", "tried"),
    [
        ((40, 30), "", 15.0),  # half of the shortest
        ((40, 20), "", None),  # no longer than the 10 s there are
        ((40, 21), "", 10.5),
        ((40, 30), "offset_window_s = 15\n", None),
        ((40, 30), "offset_window_s = 14\n", 15.0),
    ],
)
def test_offsets_over_half_of_the_shortest_dwell(told, lengths, window, tried):
    steps = DWELL.format("a", lengths[0]), DWELL.format("b", lengths[1])
    text = REQUIRED + SITE + f'[estimate]\nmethods = ["six-position"]\n{window}' + "".join(steps)
    _, seen = told(case(text), never)
    first = seen[0].estimate.offset_window_s
    windows = [e.estimate.offset_window_s for e in as_they_are(seen) if len(e.step) == 2]
    assert windows == [first] + ([] if tried is None else [tried])


def test_only_methods_that_need_offsets_get_a_longer_window(told):
    _, seen = told(procedure(["triad"], DWELL.format("a", 40)), never)
    assert {e.estimate.offset_window_s for e in seen} == {10.0}


def test_a_position_is_added_half_a_turn_on(told):
    steps = DWELL.format("a", 40), MOVE.format("go", "joints_deg = { outer = 30 }")
    _, seen = told(procedure(["triad"], *steps, DWELL.format("b", 20)), never)
    (added,) = (e for e in as_they_are(seen) if len(e.step) == 5)
    move, dwell = added.step[3:]
    assert (move.label, move.joints_deg) == ("to b turned 2", {"outer": 210.0})
    assert (dwell.label, dwell.duration_s) == ("b turned 2", 20.0)
    assert added.estimate.methods == ("triad", "multi-position")


def test_a_position_is_added_after_the_last_dwell_and_with_a_label_of_its_own(told):
    steps = [DWELL.format(name, 40) for name in ("a", "a turned 2", "a turned 2 turned 2")]
    tail = MOVE.format("back", "joints_deg = { outer = 0 }")
    last = DWELL.format("a", 40).replace('"a"', '"a turned 3"')
    _, seen = told(procedure(["multi-position"], *steps, last, tail), never)
    (added,) = (e for e in as_they_are(seen) if len(e.step) == 7)
    assert [s.label for s in added.step[3:]] == [
        "a turned 3", "to a turned 3 turned 2", "a turned 3 turned 2", "back",
    ]  # fmt: skip
    assert added.step[4].joints_deg == {"outer": 180.0}
    assert added.estimate.methods == ("multi-position",)
    first = DWELL.format("a turned 2", 40) + DWELL.format("a", 40)
    _, seen = told(procedure(["triad"], first), never)
    (added,) = (e for e in as_they_are(seen) if len(e.step) == 4)
    assert added.step[3].label == "a turned 3"


def test_the_method_that_is_asked_for_stays_the_only_one(told):
    head = REQUIRED + 'method = "triad"\n'
    _, seen = told(procedure(["triad"], DWELL.format("a", 40), head=head), never)
    assert {e.estimate.methods for e in seen} == {("triad",)}
    assert max(len(e.step) for e in seen) == 3


def test_no_position_is_added_where_nobody_knows_where_outer_stands(told):
    attitude = MOVE.format("up", "attitude_deg = { pitch = 90 }")
    _, seen = told(procedure(["triad"], attitude, DWELL.format("b", 20)), never)
    assert {len(e.step) for e in seen} == {2}
    rocking = '[[background]]\nkind = "sine"\naxes = { base_roll = { amplitude_deg = 1, '
    rocking += "frequency_hz = 0.5 } }\n"
    _, seen = told(procedure(["inertial"], DWELL.format("b", 60), rocking), never)
    assert {len(e.step) for e in seen} == {1}
    # after the last dwell it may stand anywhere
    _, seen = told(procedure(["triad"], DWELL.format("b", 20), attitude), never)
    assert 4 in {len(e.step) for e in seen}


def test_another_azimuth_where_it_matters(told):
    steps = DWELL.format("a", 40), MOVE.format("to azimuth 90", "joints_deg = { outer = 30 }")
    _, seen = told(procedure(["single-gyro"], *steps, DWELL.format("b", 20)), never)
    turned = [e for e in as_they_are(seen) if e.step[0].kind == "move"]
    assert [(e.step[0].label, e.step[0].joints_deg, e.step[2].joints_deg) for e in turned] == [
        ("to azimuth 45", {"outer": 45.0}, {"outer": 75.0}),
        ("to azimuth 90 first", {"outer": 90.0}, {"outer": 120.0}),
        ("to azimuth 135", {"outer": 135.0}, {"outer": 165.0}),
    ]
    _, seen = told(procedure(["triad"], *steps, DWELL.format("b", 20)), never)
    assert all(e.step[0].kind == "dwell" for e in seen)
    attitude = MOVE.format("up", "attitude_deg = { pitch = 90 }")
    _, seen = told(procedure(["single-gyro"], DWELL.format("a", 40), attitude), never)
    assert all(e.step[0].kind == "dwell" for e in seen)


# --- how long


PASSES = 1 / (2 * 1.1)  # deg: the sigma that passes 1 deg, with coverage 2 and a guard of 10 %


def lengths_tried(told, sigma):
    """Of one dwell of 100 s, as it is otherwise, and the first piece of advice."""

    def says(entry):
        size = sigma(seconds(entry))
        return size, len(entry.step) == 1 and size <= PASSES

    (first, *_), seen = told(procedure(["triad"], DWELL.format("a", 100)), says)
    return first, [seconds(e) for e in seen if len(e.step) == 1]


def test_lengths_that_the_slope_does_not_reach_are_not_tried(told):
    """530 s are needed of 100, by noise that averages out: after 200 s that is known. The least of
    lengths an eighth of an octave apart is 550; 500 is out of reach, so it is not looked at."""
    first, tried = lengths_tried(told, lambda t: PASSES * (530 / t) ** 0.5)
    assert tried == [100, 200, 550]
    assert [(c.where, c.before, c.after) for c in first.changes] == [
        ('step 1 "a", duration_s', "100", "550")
    ]
    assert first.duration == 550
    assert first.sigma == pytest.approx(np.radians(PASSES * (530 / 550) ** 0.5))
    assert first.text == (
        'step 1 "a", duration_s: 550 instead of 100: heading then has a sigma of 0.446 deg by '
        "triad, in 550 s"
    )
    assert "duration_s = 550" in first.toml


@pytest.mark.parametrize("floor", [0.0, 0.3, 0.7, 0.9, 0.97])
@pytest.mark.parametrize("needed", [1.05, 1.9, 2.1, 3.0, 8.5, 40.0])
def test_the_least_of_all_lengths_is_found(told, floor, needed):
    """Beside a floor (a part of what passes) that does not average out the slope so far promises
    too much: the answer is the least that passes all the same, in fewer looks than all."""
    lengths = [100 * 2.0**k * (1 + n / 8) for k in range(6) for n in range(1, 9)]

    def sigma(t):
        return PASSES * ((1 - floor**2) * 100 * needed / t + floor**2) ** 0.5

    first, tried = lengths_tried(told, sigma)
    least = next(np.ceil(t) for t in lengths if sigma(np.ceil(t)) <= PASSES)
    assert first.duration == least
    assert len(tried) <= 9  # as doubling and halving would


def test_progress_is_told_of_variants(told, monkeypatch):
    seen = []
    watched = partial(advice.with_advice, progress=seen.append)
    monkeypatch.setitem(globals(), "with_advice", watched)
    told(procedure(["carousel"], TURN.format("rate_deg_s = 20\nturns = 3")), never)
    assert seen == [0.0, 0.25, 0.5, 0.75, 1.0]


def test_out_of_reach_is_told_by_the_longest(told):
    """Ten thousand times as long would do: 64 times is looked at to say what that comes to."""
    first, tried = lengths_tried(told, lambda t: PASSES * (1e6 / t) ** 0.5)
    assert tried == [100, 200, 6400]
    assert first.sigma is None
    assert "up to 64 times as long" in first.text


def test_lengths_and_turns_are_whole_and_windows_grow_along(told):
    """33 s and 1 turn by 1.5: 50 s (49.5) and 2 turns; a window beyond 10 s by as much."""

    def says(entry):
        return 5 / seconds(entry), seconds(entry) >= 50 + 2 * 18

    steps = DWELL.format("a", 33), TURN.format("rate_deg_s = 20\nturns = 1")
    text = REQUIRED + SITE + '[estimate]\nmethods = ["six-position"]\noffset_window_s = {}\n'
    for window, grown in ((12, 15.0), (10, 10.0), (4, 4.0)):
        made = case(text.format(window) + "".join(steps))
        _, seen = told(made, says)
        own = [e for e in seen if [s.kind for s in e.step] == ["dwell", "rate"]]
        own = [e for e in own if (e.step[1].directions, e.step[1].rate_deg_s) == ("one", 20)]
        longer = next(e for e in own if e.step[0].duration_s == 42)  # 33 x 1.25 = 41.25
        assert longer.step[1].turns == 2
        assert longer.estimate.offset_window_s == grown


def test_it_is_given_up_at_sixty_four_times_and_where_nothing_is_gained(told):
    one = procedure(["triad"], DWELL.format("a", 10))
    for exponent, last in ((-0.5, 640), (-0.02, 640), (-0.01, 20)):  # 0.986 and 0.993 a doubling

        def says(entry, exponent=exponent):
            return 50 * seconds(entry) ** exponent, False

        (nothing,), seen = told(one, says)
        assert max(seconds(e) for e in seen if len(e.step) == 1) == last
        assert not nothing.helps
        assert nothing.sigma is nothing.duration is None
        longest = max(seconds(e) for e in seen)
        assert f"none of {len(seen)} procedures tried, up to 64 times as long" in nothing.text
        assert f"({longest:.0f} s), reaches 1 deg with coverage 2: " in nothing.text


def test_what_has_no_number_yet_may_get_one(told):
    """Where nothing is determined a longer stretch is tried all the same."""

    def says(entry):
        rest = seconds(entry)
        return (None if rest < 160 else 0.2), len(entry.step) == 1 and rest >= 160

    (first, *_), _ = told(procedure(["triad"], DWELL.format("a", 10)), says)
    assert first.duration == 160


def test_of_all_that_pass_the_shortest_three_come_first(told):
    """Nothing beyond three times the shortest found is tried, nor anything beyond a week."""
    made = procedure(["single-gyro"], DWELL.format("a", 100))

    def says(entry):
        azimuth = entry.step[0].joints_deg.get("outer") if entry.step[0].kind == "move" else None
        positions = sum(s.kind == "dwell" for s in entry.step)
        needed = {45.0: 180, 90.0: 130, 135.0: 390}.get(azimuth, 210 * positions)
        return 90 / seconds(entry), seconds(entry) >= needed

    found, seen = told(made, says)
    # 200 halved to 150, 125 and 138 s; to 150, 175 and 188; 400 to 300, 250 and 225
    assert [one.duration for one in found] == [138, 188, 225]
    assert all(a.helps for a in found)
    # 135 deg take 400 s, below three times 138; two positions 800, beyond three times 225
    assert max(seconds(e) for e in seen if e.step[0].kind == "move") == 400
    text = procedure(["triad"], DWELL.format("a", 86_400 * 3))
    (nothing,), _ = told(text, lambda e: (90 / seconds(e), False))
    assert f"as long ({86_400 * 6} s), reaches" in nothing.text


def test_several_quantities_together_or_each_by_itself(told):
    made = procedure(["triad"], DWELL.format("a", 100), head=REQUIRED + "pitch_deg = 1.0\n")

    def together(entry):
        rest = seconds(entry)
        return {"heading": (90 / rest, rest >= 200), "pitch": (9 / rest, rest >= 300)}

    found, _ = told(made, together)
    assert {one.quantity for one in found} == {"heading", "pitch"}
    assert min(one.duration for one in found) == 300

    def apart(entry):  # what helps one harms the other
        rest = seconds(entry)
        return {"heading": (90 / rest, rest >= 200), "pitch": (rest / 100, False)}

    found, _ = told(made, apart)
    assert [(one.quantity, one.helps) for one in found if one.quantity == "pitch"] == [
        ("pitch", False)
    ]
    assert min(one.duration for one in found if one.helps) == 200


def test_what_passes_needs_no_advice(told):
    found, seen = told(procedure(["triad"], DWELL.format("a", 100)), lambda e: (0.1, True))
    assert (found, seen) == ((), [])


# --- words


def said(monkeypatch, made, says):
    """Advice of a procedure of which `says` (entry) gives the judgement and the predictions."""

    def rehearse(settings, judged_only=False):
        entry = settings.procedure.entry
        judgement, predictions = says(entry)
        total = seconds(entry)
        return Rehearsal(
            inputs=None,
            feasibility=(SimpleNamespace(feasible=True),),
            duration=Duration((StepDuration(1, "dwell", "", 0.0, total, 0.0, 0.0, total),)),
            predictions=predictions,
            observability=(),
            judgements=(judgement,),
            advice=(),
            findings=(),
        )

    monkeypatch.setattr(advice, "rehearse", rehearse)
    return with_advice(asked(made)).advice


def test_a_bias_is_told_beside_the_sigma_in_the_unit_of_what_is_judged(monkeypatch):
    def says(entry):
        well = seconds(entry) >= 200
        one = judged("gyro bias", 1.0, Verdict.PASS if well else Verdict.FAIL)
        return replace(one, unit="rad", per=1.0, sigma=0.25, bias=0.125), ()

    first, *_ = said(monkeypatch, procedure(["triad"], DWELL.format("a", 100)), says)
    assert first.text == (
        'step 1 "a", duration_s: 200 instead of 100: gyro bias then has a sigma of 0.25 rad '
        "beside a bias of 0.125 rad by triad, in 200 s"
    )


def test_what_is_added_is_told_as_a_whole(monkeypatch):
    def says(entry):
        well = len(entry.step) > 1
        return judged("heading", 1.0, Verdict.PASS if well else Verdict.FAIL), ()

    first, *_ = said(monkeypatch, procedure(["triad"], DWELL.format("a", 100)), says)
    assert first.text == (
        "estimate, methods: triad, multi-position instead of triad; add step 2 "
        '"to a turned 2": kind = move, joints_deg = outer 180; add step 3 "a turned 2": '
        "kind = dwell, duration_s = 100: heading then has a sigma of 1 deg by triad, in 200 s"
    )


def test_what_stands_in_the_way_is_the_largest_part_of_the_best(monkeypatch):
    """2 x 4 deg in 100 s and 2 x 3 from 200 s on: by that slope only the longest could do, 6400 s.
    A second position is as good in 200 s, and no better in 400: three lengths and two. Of equals
    the first that was tried is the best; the row that is judged says what is in its way."""

    def says(entry):
        t = seconds(entry)
        size = 3.0 if t > 150 or len(entry.step) > 1 else 4.0
        one = judged("heading", size, Verdict.FAIL)
        parts = (Contribution("table tilt", np.radians(2.5)), Contribution("noise", 1e-3))
        row = Prediction("triad", "", "rest", "heading", "deg", np.pi / 180, one.sigma, parts)
        other = replace(row, label="elsewhere", contributions=parts[::-1])
        wrong = replace(row, method="fine", contributions=parts[::-1])
        return one, (other, wrong, row)

    (nothing,) = said(monkeypatch, procedure(["triad"], DWELL.format("a", 100)), says)
    assert nothing.text == (
        "none of 5 procedures tried, up to 64 times as long (6400 s), reaches 1 deg with coverage "
        "2: table tilt (2.5 deg) stands in the way in the best, which comes to 6 deg in 200 s "
        '(step 1 "a", duration_s: 200 instead of 100)'
    )


@pytest.mark.parametrize(
    ("reason", "what"),
    [("not determined: it rocks; by other words", "triad, not determined: it rocks,"),
     ("", "the errors of the unit")],
)  # fmt: skip
def test_what_has_no_number_anywhere_stands_in_the_way_by_its_reason(monkeypatch, reason, what):
    def says(entry):
        return replace(judged("heading", None, Verdict.FAIL), reason=reason), ()

    (nothing,) = said(monkeypatch, procedure(["triad"], DWELL.format("a", 100_000)), says)
    assert nothing.text.endswith(f"reaches 1 deg with coverage 2: {what} stands in the way")


def test_the_best_has_a_number_and_of_those_without_the_least_is_the_best(monkeypatch):
    """As it is there is no number, of whatever size; twice as long is 2 x 5 deg, and no better."""

    def says(entry):
        t = seconds(entry)
        one = judged("heading", 5.0 if t > 100 else None, Verdict.FAIL)
        return replace(one, beyond=np.radians(0.1)), ()

    one = procedure(["triad"], DWELL.format("a", 100))
    (nothing,) = said(monkeypatch, one, says)
    assert "in the best, which comes to 10 deg in 200 s (step 1" in nothing.text

    def never(entry):
        t = seconds(entry)
        return replace(judged("heading", None, Verdict.FAIL), beyond=500.0 / t), ()

    (nothing,) = said(monkeypatch, one, never)
    assert "in the best, which comes in 12800 s" in nothing.text  # two positions, 64 times as long
