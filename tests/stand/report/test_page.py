"""Pages of a rehearsal and of a recorded run: whole, and honest about what is missing."""

import json
import os
import re
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from pages import checked
from rehearsed import DEG, PROCEDURE, achieved, answer, infeasible, runs, verified

import stand
from stand.errors import StandError
from stand.folder import refuse_files
from stand.physics.picture import NoDriver, pictures, png
from stand.recording.mcap.writer import write_imu_log
from stand.rehearsal.result import Duration, Finding, Rehearsal, Severity, Verdict
from stand.rehearsal.verification import Verification
from stand.report import gallery as gallery_module
from stand.report.figures import (
    Against,
    Bar,
    Budget,
    RatioRow,
    budget,
    ratios,
    requirements,
    timeline,
)
from stand.report.gallery import MOST, Position, angles_text, gallery
from stand.report.log_page import page as log_page
from stand.report.page import _numeric, span_text
from stand.report.rehearsal import JSON, JUNIT, PAGE, page, write_report
from stand.report.run_page import write_run_page
from stand.report.tables import TableData
from stand.report.verified import MOST_ROWS, outcome, section

HOSTILE = "<script>alert(1)</script> \"'&amp; $x_{$ </svg> --> 日本 \u202e"


@pytest.fixture
def quick_pictures(monkeypatch):
    """Pictures without a driver: 4 by 4 pixels for each row of joint angles."""
    drawn = []

    def fake(joints, camera, width, height, model=None):
        drawn.append(np.asarray(joints))
        return [np.full((4, 4, 3), k, np.uint8) for k in range(len(joints))]

    monkeypatch.setattr(gallery_module, "pictures", fake)
    return drawn


# Rehearsal ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("verdict", list(Verdict))
def test_the_page_is_whole_and_says_the_verdict_first(quick_pictures, verdict):
    shown = checked(page(answer(verdict)))
    assert shown.said.startswith(f"{verdict.value}: rehearsal of Two positions, 180 degrees apart")
    head, _, rest = shown.said.partition("Required accuracy")
    assert verdict.value in head.split("Rehearsal:")[1]
    for heading in ("Duration", "Feasibility", "Accuracy", "The stand in each position"):
        assert heading in rest
    # requirements, timeline and budget; and the ratios of what runs contradict
    assert len(shown.of("svg")) == (4 if verdict is Verdict.CONTRADICTED else 3)
    # two different positions of three steps, the first on the first screen as well
    assert len(shown.of("img")) == 3


def test_the_page_says_what_the_answer_says(quick_pictures):
    said = checked(page(answer(Verdict.FAIL))).said
    for words in (
        "Will not be met: heading within 0.05°.",
        "Will be met: pitch within 0.01°.",
        "outer rate 320 of 300 deg/s (107 %), first beyond it at 296.750 s",
        "Rest 418 s instead of 296 s in both positions.",
        'step 1 "first", duration_s: 296 becomes 418',
        'step 4 "back": added, kind = move',
        "With it: sigma 0.038°, takes 14 min 04 s.",
        "sigma above 10 deg: the estimator is no longer linear there",
        "level at rest, accelerometer X bias cannot be told from pitch",
        "white noise 0.0332, bias instability 0.0281, table azimuth 0.0083, scale factor 0.0121",
        "warning , second: the class states no settling time",
        "ab" * 32,
        "latitude 48.5°",
        "outer 180°",
        "revision B",
        "numpy 2.3.0",
        "Table, calibration certificate",
    ):
        assert words in said, words
    assert PROCEDURE.splitlines()[-1] in said
    # 0.0332^2 of a sum of 0.0332^2 + 0.0281^2 + 0.0014^2 + 0.0083^2 + 0.0121^2 is 52 %
    labels = " ".join(a.get("aria-label") or "" for _, a in checked(page(answer())).tags)
    assert "two-position: heading 0.0459 deg: white noise 52 %, bias instability 37 %" in labels
    assert "Timeline of 3 steps over 10 min: motion 7.2 s, settling 1.7 s" in labels
    assert "heading 0.05°: FAIL, 184 %" in labels


def test_a_table_that_cannot_do_it_fails_whatever_the_accuracy(quick_pictures):
    said = checked(page(infeasible())).said
    assert said.startswith("FAIL")
    assert "The procedure cannot run as it is" in said
    assert 'Why it cannot run: Step 2 "half a turn": outer rate 320 of 300 deg/s' in said
    assert "Will be met: heading within 0.2°, pitch within 0.01°." in said


def test_without_requirements_advice_or_steps(quick_pictures):
    bare = replace(
        answer(Verdict.PASS), judgements=(), predictions=(), observability=(), findings=()
    )
    said = checked(page(bare)).said
    assert "It states no required accuracy." in said
    assert "Advice" not in said


def test_a_plan_that_cannot_be_made_says_why_at_once(quick_pictures):
    fault = Finding(Severity.ERROR, "plan", "", "joints_deg, base_roll = 80: allows -15 to 15 deg")
    empty = Rehearsal(answer().inputs, (), Duration(()), (), (), (), (), (fault,))
    said = checked(page(empty)).said
    head = said.partition("Before the run")[0]
    assert "✗ FAIL The procedure cannot run as it is." in head
    assert "Why it cannot run: joints_deg, base_roll = 80: allows -15 to 15 deg." in head
    assert "no required accuracy" not in said  # nobody has looked
    assert "no position in which anything is measured" in said


def hostile_runs() -> Verification:
    v = runs(heading=0.7)
    return replace(
        v,
        achieved=tuple(
            replace(a, method=HOSTILE, window=HOSTILE, label=HOSTILE) for a in v.achieved
        ),
        refused=tuple(replace(r, method=HOSTILE, reason=HOSTILE) for r in v.refused),
    )


def test_hostile_text_stays_text(quick_pictures):
    evil = answer(Verdict.FAIL, HOSTILE)
    evil = replace(
        evil,
        inputs=replace(evil.inputs, imu_title=HOSTILE, procedure_text=HOSTILE, revision=HOSTILE),
        feasibility=tuple(replace(s, label=HOSTILE) for s in evil.feasibility),
        duration=Duration(tuple(replace(s, label=HOSTILE) for s in evil.duration.steps)),
        predictions=tuple(replace(p, method=HOSTILE, label=HOSTILE) for p in evil.predictions),
        judgements=tuple(replace(j, reason=HOSTILE, label=HOSTILE) for j in evil.judgements),
        findings=tuple(replace(f, text=HOSTILE, step=HOSTILE) for f in evil.findings),
        advice=tuple(replace(a, text=HOSTILE, toml=HOSTILE) for a in evil.advice),
        verification=hostile_runs(),
    )
    text = page(evil)
    shown = checked(text)
    assert "<script" not in text
    assert " ".join(HOSTILE.split()) in shown.said


def test_files_are_written_whole_and_stay_unless_forced(tmp_path, quick_pictures):
    folder = tmp_path / "new" / "report"
    paths = write_report(answer(), folder)
    assert paths == [folder / name for name in (PAGE, JSON, JUNIT)]
    assert sorted(path.name for path in folder.iterdir()) == sorted((PAGE, JSON, JUNIT))
    assert json.loads((folder / JSON).read_text())["verdict"] == "FAIL"
    (folder / "notes.txt").write_text("mine")
    before = [path.read_bytes() for path in paths]
    with pytest.raises(StandError, match=r"rehearsal\.html: exists; --force replaces it"):
        write_report(answer(Verdict.PASS), folder)
    assert [path.read_bytes() for path in paths] == before
    write_report(answer(Verdict.PASS), folder, force=True)
    assert json.loads((folder / JSON).read_text())["verdict"] == "PASS"
    assert (folder / "notes.txt").read_text() == "mine"
    assert (folder / PAGE).stat().st_mode & 0o777 == 0o644


def test_same_answer_same_bytes(quick_pictures):
    assert page(answer()) == page(answer())


def test_the_tables_certificate_fills_the_record(quick_pictures):
    from stand.table.table import load_table

    text = load_table("mid-class").text
    stated = '[certificate]\nserial_number = "T-17"\nvalid_until = "2027-03"\n' + text.partition(
        "[geometry]"
    )[2].join(["[geometry]", ""])
    text = text.partition("[geometry]")[0] + stated
    result = answer()
    result = replace(result, inputs=replace(result.inputs, table_text=text))
    shown = checked(page(result))
    assert "Table, serial number T-17" in shown.said
    assert "Valid until 2027-03" in shown.said
    blanks = [a for _, a in shown.tags if a.get("class") == "blank"]
    assert len(blanks) == 6  # of eight fields


# Runs beside the predictions ---------------------------------------------------------------------


def test_without_runs_nothing_is_said_of_them(quick_pictures):
    assert "Verified" not in checked(page(answer())).said


def test_runs_that_agree_are_told_at_the_top_and_in_their_section(quick_pictures):
    shown = checked(page(verified()))
    head, _, rest = shown.said.partition("Verified by 400 runs")
    # 7 % either way is less than the 10 % that is asked for: nothing is held back
    assert "400 runs of the whole stand agree with all 5 predictions within 10 %." in head
    assert "agree with 400 runs 5 of 5" in head
    for words in (
        "5 of 5 predictions agree with the runs",
        "400 runs, seeds 7 to 406, in 16 s, 25 runs/s",  # 400 in 16 s
        "two-position gave no answer in 3 of 400 runs: not at rest: it turns at 0.2 deg/s",
        # 0.04593 / 0.96 = 0.04784, over 1.07 and 0.93; 0.96 times 0.93 and 1.07
        "0.0459 deg 0.0478 (0.0447 to 0.0514) deg 0.96 (0.89 to 1.03) 0.89 to 1.03 400 yes",
        # no number was predicted: what came out, without a ratio
        "two-position roll first not determined 25 (23.4 to 26.9) deg 400",
    ):
        assert words in rest, words
    assert "Contradicted" not in shown.said
    assert "interrupted" not in shown.said
    assert len(shown.of("svg")) == 4
    labels = " ".join(a.get("aria-label") or "" for _, a in shown.tags)
    assert "triad: heading: 1.04 (0.97 to 1.11); two-position: heading: 0.96" in labels
    assert "roll: 25" not in labels


def test_contradicted_predictions_are_named_once_at_the_top_and_marked_below(quick_pictures):
    text = page(verified(heading=0.7))
    shown = checked(text)
    head, _, rest = shown.said.partition("Verified by 400 runs")
    told = (
        "400 runs of the whole stand contradict 1 of 5 predictions: two-position: heading (first)."
    )
    assert head.index("CONTRADICTED") < head.index(told) < head.index("The procedure can run")
    assert "Would be met by the prediction: heading within 0.2°" in head
    assert "Will be met" not in head
    assert "was predicted otherwise" not in shown.said  # that finding stands in the section
    assert "the class states no settling time" in head
    assert "Contradicted: two-position: heading (first)." in rest
    # 0.7 times 0.93 and 1.07; by a word, and in bold, not by colour alone
    assert "0.70 (0.65 to 0.75) contradicted" in rest
    assert re.search(r"font-weight: 700;[^>]*>0\.70 ", text)
    assert '<td class="short bad">no</td>' in text


def test_the_plain_interval_stands_beside_that_of_all_at_once(quick_pictures):
    """Of 40 quantities the interval is 1.65 times as wide: log 0.95/0.86 and log 0.95/1.04."""
    made = runs(heading=0.86)  # 0.86 times 0.93 and 1.07: 0.80 to 0.92, which meets 0.9
    wide = replace(made, achieved=tuple(replace(a, among=40) for a in made.achieved))
    one = wide.achieved[2]
    assert one.ratio == pytest.approx((0.86, 0.86 * 0.93, 0.86 * 1.07))
    # 0.025/40 of the normal law lies beyond 3.2272 sigma, 0.025 beyond 1.95996
    power = 3.2272 / 1.95996
    assert one.widened == pytest.approx((0.86 * 0.93**power, 0.86 * 1.07**power), rel=1e-4)
    told = section(wide)
    assert any("0 of 5 plain 95 % intervals miss 0.9 to 1.1" in line for line in told.sentences)
    off = replace(one, low=one.low * 1.05)  # 0.80 to 0.88 alone, 0.76 to 0.90 of all
    off = replace(off, high=off.high, low=one.sigma / 1.03)
    assert (off.agrees_alone, off.agrees) == (False, True)
    lines = section(replace(wide, achieved=(off,))).sentences
    assert any("1 of 1 plain 95 % intervals miss 0.9 to 1.1" in line for line in lines)


def test_few_runs_do_not_claim_ten_percent():
    told = outcome(runs(wide=0.2))
    assert told == (
        "400 runs of the whole stand agree with all 5 predictions within 10 %, as far as so few "
        "can tell: ratios are known to ± 20 %."
    )


def test_an_interruption_is_told(quick_pictures):
    said = checked(page(verified(done=312))).said
    assert "Verified by 312 runs" in said
    assert "Interrupted: 312 of 400 runs, seeds 7 to 318" in said


def test_runs_that_nothing_can_be_compared_with(quick_pictures):
    roll = runs().achieved[-1]
    for achieved_then in ((roll,), ()):
        v = replace(runs(), achieved=achieved_then, done=1)
        shown = checked(page(replace(answer(), verification=v)))
        assert "1 run of the whole stand leaves nothing to compare with a prediction." in shown.said
        assert "Verified by 1 run No prediction could be compared with the runs." in shown.said
        assert len(shown.of("svg")) == 3


def test_the_table_has_all_stretches_and_those_alike_share_a_row():
    p = answer().predictions[2]
    three = tuple(
        achieved(p, ratio, label=name) for ratio, name in ((1, "a"), (1.1, "b"), (1, "c"))
    )
    made = section(replace(runs(), achieved=three))
    assert made.table is not None
    assert made.chart is not None
    assert [row[:3] for row in made.table.rows] == [
        ("two-position", "heading", "a, c"),
        ("two-position", "heading", "b"),
    ]
    assert made.chart.alt.count("two-position: heading") == 1


def test_a_chart_of_very_many_quantities_keeps_those_farthest_off():
    p = answer().predictions[2]
    rows = [achieved(replace(p, quantity=f"q{k}"), 1 + 0.001 * k) for k in range(MOST_ROWS + 5)]
    made = section(replace(runs(), achieved=(achieved(p, 0.5), *rows)))
    assert made.table is not None
    assert made.chart is not None
    assert (
        made.chart_note == f"The {MOST_ROWS} of {MOST_ROWS + 6} quantities that are farthest off."
    )
    assert "two-position: heading: 0.50" in made.chart.alt
    assert "q0:" not in made.chart.alt
    assert f"q{MOST_ROWS + 4}: 1.03" in made.chart.alt
    assert len(made.table.rows) == MOST_ROWS + 6


def test_many_contradicted_are_counted_at_the_top():
    p = answer().predictions[2]
    off = tuple(achieved(replace(p, quantity=f"q{k}"), 0.5) for k in range(5))
    told = outcome(replace(runs(), achieved=off))
    assert (
        "5 of 5 predictions: two-position: q0 (first), q1 (first), q2 (first) and 2 more." in told
    )


@pytest.mark.parametrize("ratio", [1e-3, 0.0, 40.0])
def test_a_ratio_far_beyond_stays_in_the_chart(ratio):
    row = RatioRow("a", "far", (ratio, 0.9 * ratio, 1.1 * ratio), False, ((1.0, True),))
    shown = ratios([row], (0.9, 1.1))
    assert "arrow: beyond the edge" in shown.caption
    assert "nan" not in shown.svg
    assert "inf" not in shown.svg
    assert "var(--hue1)" in shown.svg


def test_the_caption_tells_only_what_is_drawn():
    plain = ratios([RatioRow("a", "1", (1.0, 0.95, 1.05), True)], (0.9, 1.1)).caption
    assert plain == "Dot and bar: the ratio and its 95 % interval; shaded: 0.9 to 1.1."


# Figures -----------------------------------------------------------------------------------------


def test_many_steps_share_a_row_of_their_kind():
    bars = [Bar(f"s{k}", ("dwell", "move")[k % 2], (("dwell", k, k + 1.0),)) for k in range(200)]
    shown = timeline(bars, 200.0)
    assert "s17" not in shown.svg
    assert re.search(">dwell<", shown.svg)
    assert float(re.search(r'viewBox="0 0 720 ([\d.]+)"', shown.svg)[1]) < 150


def test_colours_are_the_pages_own():
    shown = budget([Budget("a", "1 deg", {"one": 3.0, "two": 1.0})])
    assert not re.search("#[0-9a-f]{6}", shown.svg)
    assert "var(--hue0)" in shown.svg
    assert shown.alt == "What each uncertainty is made of. a 1 deg: one 75 %, two 25 %"


def test_more_sources_than_colours_are_told_apart_by_hatching():
    many = {f"source {k}": 1.0 + k for k in range(20)}
    shown = budget([Budget("a", "1", many), Budget("none", "0", {})])
    assert shown.svg.count("<pattern") == 12  # all beyond the eight colours


def test_what_is_small_everywhere_shares_a_colour():
    rows = [
        Budget("a", "1", {"big": 1.0, "small": 0.004, "smaller": 0.0008}),
        Budget("b", "1", {"small": 0.002, "big": 1.0, "local": 0.5}),
    ]
    words = budget(rows).alt
    assert "a 1: big 100 %; b 1: big 67 %, local 33 %" in words
    assert "small" not in budget(rows).svg
    assert ">others<" in budget(rows).svg


def test_stretches_that_come_out_alike_share_a_row(quick_pictures):
    result = answer(Verdict.PASS)
    again = replace(result.predictions[0], label="second")
    said = checked(page(replace(result, predictions=(result.predictions[0], again)))).said
    # 0.028, 0.047 and 0.0083 are below a thousandth of 1.9^2
    assert "triad heading 1.9 deg first, second turn-on bias 1.9 Parts add up" in said


def test_a_prediction_far_beyond_is_cut_and_one_that_is_missing_is_said():
    shown = requirements(
        [Against("a", "FAIL", 40.0, 0.1), Against("b", "INDETERMINATE", None, 0.1)]
    )
    assert "FAIL, 4e+03 %" not in shown.svg
    assert "FAIL, 40 times" in shown.svg
    assert "INDETERMINATE, not determined" in shown.svg


@pytest.mark.parametrize(
    ("seconds", "told"),
    [(0, "0 s"), (1.234, "1.23 s"), (12.34, "12.3 s"), (60, "60 s"), (99.97, "1 min 40 s"),
     (600, "10 min"), (3599.7, "1 h 00 min"), (7440, "2 h 04 min")],
)  # fmt: skip
def test_durations_for_a_person(seconds, told):
    assert span_text(seconds) == told


def test_columns_of_numbers_stand_to_the_right():
    table = TableData(
        "t",
        ("a", "b", "c", "d", "e"),
        (("1", "1.5", "ab12", "-0.01 ± 0.2", "1.2.3"), ("2", "", "12ab", "± 3", "4")),
    )
    assert [_numeric(table, k) for k in range(5)] == [False, True, False, True, False]


# Pictures ----------------------------------------------------------------------------------------


def test_positions_that_look_alike_share_a_picture(quick_pictures):
    turned = np.array([0, 0, 0, 2 * np.pi, 0, 0])
    shown = gallery(
        [Position("a", np.zeros(6)), Position("b", turned), Position("c", np.full(6, 0.1))]
    )
    assert [p.caption.split(":")[0] for p in shown.photos] == ["a, b", "c"]
    (drawn,) = quick_pictures
    np.testing.assert_array_equal(drawn, [np.zeros(6), np.full(6, 0.1)])


def test_very_many_positions_are_cut_and_told(quick_pictures):
    shown = gallery([Position(str(k), np.full(6, 0.01 * k)) for k in range(MOST + 3)])
    assert len(shown.photos) == MOST
    assert shown.note == "3 further positions are not shown."


def test_without_a_driver_the_page_says_so(monkeypatch):
    monkeypatch.setenv("MUJOCO_GL", "osmosis")
    with pytest.raises(NoDriver, match=r"osmosis.*install libegl1"):
        pictures(np.zeros(6))
    said = checked(page(answer())).said
    assert "No pictures: no OpenGL driver (osmosis:" in said


@pytest.mark.slow
def test_a_broken_driver_ends_nothing_but_the_pictures(tmp_path):
    # MuJoCo cannot even be imported with this choice, by the command's own process
    done = subprocess.run(
        [
            sys.executable, "-c", "from stand.cli.app import main; main()",
            "rehearse", "two-position", "--report", tmp_path / "r",
        ],
        env=os.environ | {"MUJOCO_GL": "osmosis"}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode in (0, 1), done.stderr
    said = checked((tmp_path / "r" / PAGE).read_text(encoding="utf-8")).said
    assert "No pictures: no OpenGL driver (osmosis:" in said


@pytest.mark.slow
def test_the_stand_is_drawn(monkeypatch):
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    rest, tilted = pictures([np.zeros(6), [0, 0, 0, 0, 60 * DEG, 0]], width=160, height=120)
    assert rest.shape == (120, 160, 3)
    assert rest.std() > 20  # not one colour
    changed = np.abs(rest.astype(int) - tilted).max(axis=2) > 30
    assert 0.01 < changed.mean() < 0.5  # the gimbals and their shadows, not the whole scene
    with pytest.raises(StandError, match="unknown camera 'nose'"):
        pictures(np.zeros(6), "nose", 16, 16)
    data = png(rest)
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    assert (int.from_bytes(data[16:20]), int.from_bytes(data[20:24])) == (160, 120)


def test_angles_for_a_person():
    assert angles_text(np.zeros(6)) == "all at zero"
    assert angles_text(np.array([0, 0, 0, np.pi / 2, 0, -0.5 * DEG])) == "outer 90°, inner -0.5°"


# Files -------------------------------------------------------------------------------------------


def test_a_link_counts_as_there(tmp_path):
    (tmp_path / "link").symlink_to(tmp_path / "nowhere")
    with pytest.raises(StandError, match="exists"):
        refuse_files([tmp_path / "link"])


# A recorded run ----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def run_page(recorded, tmp_path_factory):
    path = tmp_path_factory.mktemp("page") / "run.html"
    return write_run_page(recorded.folder, path).read_text(encoding="utf-8")


@pytest.mark.slow
def test_the_page_of_a_run(run_page, recorded):
    shown = checked(run_page)
    assert shown.said.startswith("Run: Short test Recorded run: Short test")
    assert "six-position, same window [deg]" in shown.said
    # six-position has two windows; rk4 one; triad follows nothing over time; and the timeline;
    # and the channels
    assert len(shown.of("svg")) == 5
    assert "no servo was simulated" in shown.said
    text = (recorded.folder / "run.mcap").read_bytes()
    from hashlib import sha256

    assert sha256(text).hexdigest() in shown.said
    # the numbers of the table are those of the recording
    rk4 = next(e for e in recorded.printed["estimates"] if e["method"] == "rk4")
    assert f"{rk4['error_pitch_deg']:+.3f}"[:6] in shown.said


def test_the_servos_table(recorded, tmp_path, quick_pictures):
    folder = tmp_path / "run"
    folder.mkdir()
    (folder / "run.mcap").symlink_to(recorded.folder / "run.mcap")
    result = json.loads((recorded.folder / "result.json").read_text())
    by_axis = dict.fromkeys(
        ("base_roll", "base_pitch", "base_yaw", "outer", "middle", "inner"), 0.0
    )
    result["steps"] = [
        {
            "label": "Y1 up", "kind": "dwell", "t_from_s": 0.0, "t_to_s": 12.0,
            "following_max_arc_s": by_axis | {"middle": 7.25},
            "following_rms_arc_s": by_axis | {"middle": 3.5},
            "saturated_s": by_axis, "torque_percent": by_axis | {"outer": 41.0}, "rests": True,
            "settled_after_s": 0.4,
        }
    ]  # fmt: skip
    (folder / "result.json").write_text(json.dumps(result))
    said = checked(write_run_page(folder).read_text(encoding="utf-8")).said
    assert "7.25 middle 3.5 0.40 0 41 outer" in said
    assert (folder / "report.html").is_file()


def test_the_command(stand_command, recorded, tmp_path, quick_pictures):
    page_path = tmp_path / "page.html"
    done = stand_command("report", recorded.folder, "--out", page_path)
    assert (done.code, done.out.strip()) == (0, str(page_path))
    done = stand_command("report", recorded.folder, "--out", page_path)
    assert done.code == 2
    assert "exists; --force replaces it" in done.err
    assert stand_command("report", recorded.folder, "--out", tmp_path).code == 2
    done = stand_command("report", tmp_path)
    assert (done.code, done.err.count("\n")) == (2, 1)


def test_a_foreign_log_is_not_a_run(tmp_path):
    from stand.recording.mcap.writer import write_imu_log

    still = np.tile([0.0, 9.81, 0.0], (30, 1))
    t_ns = (np.arange(30) + 1) * 10**7
    path = tmp_path / "log.mcap"
    write_imu_log(path, t_ns=t_ns, w_ib_b=0 * still, f_b=still, metadata={})
    with pytest.raises(StandError, match="not a recording of stand run"):
        write_run_page(path)


def test_a_drive_has_neither_table_nor_steps(stand_command, tmp_path):
    done = stand_command("drive", "straight", "--rate", 20, "--out", tmp_path / "drive", "--json")
    assert done.code == 0, done.err
    shown = checked(write_run_page(tmp_path / "drive").read_text(encoding="utf-8"))
    assert shown.said.startswith("Run: straight Recorded run: straight")
    assert "vectors" in shown.said
    assert "The stand in each position" not in shown.said
    assert "Table, serial number" not in shown.said


# A log -------------------------------------------------------------------------------------------


def test_the_page_of_a_log_says_first_what_was_found(tmp_path, recorded):
    """Rests give an attitude with its sigma; what never rests gives none."""
    found = checked(log_page(stand.read(recorded.folder))).said
    head = found.partition("Rests and steady turns")[0]
    assert "Of the longest stretch: " in head
    assert re.search(r"pitch -?[\d.]+° ± [\d.]+°, by \w+", head)
    t = np.arange(1, 1201) / 20
    turning = np.column_stack([np.sin(0.7 * t), np.cos(0.9 * t), np.sin(1.3 * t)])
    write_imu_log(
        tmp_path / "tumbling.mcap", t_ns=np.round(t * 1e9).astype(np.int64), w_ib_b=turning,
        f_b=9.81 * turning, metadata={},
    )  # fmt: skip
    said = checked(log_page(stand.read(tmp_path / "tumbling.mcap"))).said
    assert "✗ NO ATTITUDE" in said.partition("Rests and steady turns")[0]
