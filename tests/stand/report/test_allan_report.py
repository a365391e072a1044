"""A recording's Allan analysis as JSON, tables, picture and page; and every fault's one line."""

import json
import re
from math import pi, sqrt

import numpy as np
import pytest

from alignment.allan import FoundTerm, MissingTerm
from alignment.errors import NotAtRest, Saturated, TooShort
from stand.errors import StandError
from stand.evaluation.allan import UNITS, AllanReport, analyse, sheet_of, to_json
from stand.imu import load_imu
from stand.recording.mcap.writer import write_imu_log
from stand.report.allan import HTML, PNG, in_percent, tables, verdict, with_bounds, write_pictures

DEG_RT_H = pi / 180 / 60
RATE = 100


def log(path, seconds=60, gap=0.0, metadata=None, moved=False, dead=False):
    """White noise of 0.15 deg/rt-h and 0.024 m/s/rt-h, by plain numpy."""
    rng = np.random.default_rng(1)
    n = seconds * RATE
    t_ns = (np.arange(n) + 1) * (10**9 // RATE)
    t_ns[n // 3 :] += int(gap * 1e9)
    w = 0.15 * DEG_RT_H * sqrt(RATE) * rng.standard_normal((n, 3))
    f = [0, 9.81, 0] + 0.024 / 60 * sqrt(RATE) * rng.standard_normal((n, 3))
    w[n // 2 :, 0] += 0.1 * moved
    w[:, 1] *= not dead
    write_imu_log(path, t_ns=t_ns, w_ib_b=w, f_b=f, metadata=metadata or {})
    return path


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    return analyse(log(tmp_path_factory.mktemp("allan") / "log.mcap"), imu="stim300")


@pytest.fixture(scope="module")
def pictures(report, tmp_path_factory):
    return write_pictures(report, tmp_path_factory.mktemp("allan") / "out" / "deep")


# Units and data sheets ---------------------------------------------------------------------------


def test_units_by_hand():
    second, hour = 1.0, 3600.0
    deg_h = pi / 180 / hour
    by_hand = {
        ("gyro", "N"): pi / 180 / sqrt(hour),
        ("gyro", "B"): deg_h,
        ("gyro", "K"): deg_h / sqrt(hour),
        ("gyro", "Q"): pi / 180 / 3600,
        ("gyro", "R"): deg_h / hour,
        ("accel", "N"): 1 / sqrt(hour),
        ("accel", "B"): 9.80665e-6,
        ("accel", "K"): 9.80665e-6 / sqrt(hour),
        ("accel", "Q"): second,
        ("accel", "R"): 9.80665e-6 / hour,
    }
    for key, si in by_hand.items():
        assert UNITS[key].si == pytest.approx(si, rel=1e-12), key


def test_sheet_of_a_preset():
    sheet = sheet_of(load_imu("stim300"))
    assert sheet["gyro", "N"] == pytest.approx(0.15 * DEG_RT_H)
    assert sheet["gyro", "B"] == pytest.approx(0.3 * pi / 180 / 3600)
    assert sheet["accel", "N"] == pytest.approx(0.024 / 60)
    assert ("gyro", "K") not in sheet
    # Increments of 2^-19 rad, rounded: errors even over one of them, of sigma 1/sqrt(12).
    assert sheet_of(load_imu("ln200s"))["gyro", "Q"] == pytest.approx(2**-19 / sqrt(12), rel=1e-2)


def test_the_recordings_own_preset_is_used(tmp_path):
    text = load_imu("stim300").text
    path = log(tmp_path / "own.mcap", 5, metadata={"imu": {"toml": text}})
    report = analyse(path)
    assert report.sheet_title == "Safran STIM300, 10 g accelerometers (imu)"
    assert report.sheet == sheet_of(load_imu("stim300"))
    assert analyse(log(tmp_path / "none.mcap", 5)).sheet_title is None


# JSON --------------------------------------------------------------------------------------------


def test_json(report):
    data = json.loads(json.dumps(to_json(report), allow_nan=False))
    assert data["rate_hz"] == pytest.approx(100)
    assert data["duration_s"] == pytest.approx(60)
    assert data["gaps"] == data["rate_changes"] == []
    assert len(data["terms"]) + len(data["not_identifiable"]) == 30
    noise = {(t["sensor"], t["axis"]): t for t in data["terms"] if t["term"] == "N"}
    assert set(noise) == {(s, a) for s in ("gyro", "accel") for a in "xyz"}
    for (sensor, _), entry in noise.items():
        stated, unit = (0.15, "deg/rt-h") if sensor == "gyro" else (0.024, "m/s/rt-h")
        assert entry["unit"] == unit
        assert entry["datasheet"] == pytest.approx(stated)
        assert entry["low"] < entry["value"] < entry["high"]
        assert entry["value"] == pytest.approx(stated, rel=0.05)
    b = next(e for e in data["not_identifiable"] if e["sensor"] == "gyro" and e["term"] == "B")
    assert b["needs_h"] > 2
    assert b["upper"] > b["datasheet"] == pytest.approx(0.3)
    curve = data["curves"][0]
    # Of white noise, N/sqrt(tau): 0.15 deg/rt-h at 0.01 s is 90 deg/h.
    assert curve["unit"] == "deg/h"
    assert curve["deviation"][0] == pytest.approx(90, rel=0.05)
    assert curve["tau_s"][:3] == pytest.approx([0.01, 0.02, 0.04])


def test_gaps_are_told(tmp_path):
    report = analyse(log(tmp_path / "gap.mcap", gap=2.0))
    (gap,) = to_json(report)["gaps"]
    # Times count from the first sample of a log that is not ours.
    assert gap["at_s"] == pytest.approx(22.0)
    assert gap["missing_s"] == pytest.approx(2.0)
    assert report.notes[0].startswith("mean rate ")
    assert report.notes[1:3] == (
        "gaps: 2 s before 22 s",
        "used together, without what lies between: 0 to 19.99 s, 22 to 61.99 s",
    )


def test_a_dead_channel_is_no_better_than_its_sheet(tmp_path):
    report = analyse(log(tmp_path / "dead.mcap", dead=True), imu="stim300")
    assert verdict(report, "gyro", "N") == "xz agrees, y constant"
    assert "gyro y: every reading is the same: dead, or its noise below a step" in report.notes
    data = json.loads(json.dumps(to_json(report), allow_nan=False))
    dead = [e for e in data["not_identifiable"] if (e["sensor"], e["axis"]) == ("gyro", "y")]
    assert [e["upper"] for e in dead] == [None] * 5
    (row, *_) = tables(report)[0].rows
    assert row[2] == "constant"


def test_a_stretch(tmp_path):
    path = log(tmp_path / "a.mcap")
    assert analyse(path, t_from=10, t_to=30).analysis.duration == pytest.approx(20, abs=0.02)


def schedule(steps):
    """The record of a recording of ours; every step has a nominal attitude there."""
    return {"json": json.dumps([step | {"C_nb_xyzw": [0.0, 0.0, 0.0, 1.0]} for step in steps])}


def test_all_rests_of_a_run_of_ours_are_used_together(tmp_path):
    steps = [
        {"kind": "dwell", "label": "A", "t_from_s": 0.0, "t_to_s": 20.0},
        {"kind": "move", "label": "B", "t_from_s": 20.0, "t_to_s": 25.0},
        {"kind": "dwell", "label": "C", "t_from_s": 25.0, "t_to_s": 60.0},
    ]
    epoch = 1_767_225_600 * 10**9
    metadata = {"schedule": schedule(steps), "run": {"epoch_ns": str(epoch)}}
    report = analyse(log(tmp_path / "run.mcap", metadata=metadata))
    assert report.notes[0] == "used 2 rests together: A (20 s), C (35 s)"
    assert report.analysis.duration == pytest.approx(55, abs=0.02)
    rests = to_json(report)["rests"]
    ends = [r[key] for r in rests for key in ("from_s", "to_s")]
    assert ends == pytest.approx([0.01, 20.0, 25.01, 60.0], abs=1e-9)


def test_a_rest_that_moved_is_left_out_and_named(tmp_path):
    """Turned at half time: of three rests the last two are one attitude each."""
    steps = [
        {"kind": "dwell", "label": "A", "t_from_s": 0.0, "t_to_s": 20.0},
        {"kind": "dwell", "label": "B", "t_from_s": 20.0, "t_to_s": 50.0},
        {"kind": "dwell", "label": "C", "t_from_s": 50.0, "t_to_s": 60.0},
    ]
    metadata = {
        "schedule": schedule(steps),
        "run": {"epoch_ns": str(1_767_225_600 * 10**9)},
        "settled": {"C": "52.5"},
    }
    report = analyse(log(tmp_path / "run.mcap", metadata=metadata, moved=True))
    assert report.notes[:2] == (
        "used 2 rests together: A (20 s), C (7.5 s)",
        "left out, not at rest: B",
    )
    with pytest.raises(NotAtRest, match=r"--from 31\.1 --to 59\.9 is one"):
        analyse(log(tmp_path / "one.mcap", moved=True))


def test_mean_rate_and_force_stand_beside_the_terms(tmp_path):
    """Level at 48.5 deg with X1 north; and the same gyros in deg/s taken for rad/s."""
    n = 1000
    rng = np.random.default_rng(2)
    t_ns = (np.arange(n) + 1) * 10**7
    deg_h = pi / 180 / 3600
    w = np.array([9.96651, 11.26509, 0.0]) * deg_h + 1e-7 * rng.standard_normal((n, 3))
    f = [0.0, 9.8093587, 0.0] + 1e-4 * rng.standard_normal((n, 3))
    write_imu_log(tmp_path / "a.mcap", t_ns=t_ns, w_ib_b=w, f_b=f, metadata={})
    report = analyse(tmp_path / "a.mcap")
    # sqrt(9.96651^2 + 11.26509^2); noise 1e-7/sqrt(1000) rad/s is 0.0007 deg/h
    said = "mean rate 15.04 deg/h (Earth: 15.04), mean specific force 9.80936 m/s^2"
    assert report.notes == (said,)
    assert said in tables(report)[1].notes
    (rest,) = to_json(report)["rests"]
    assert rest["mean_rate_deg_h"] == pytest.approx([9.96651, 11.26509, 0.0], abs=0.003)
    assert rest["mean_force_m_s2"] == pytest.approx([0.0, 9.8093587, 0.0], abs=2e-5)
    slipped = np.degrees(w)
    write_imu_log(tmp_path / "b.mcap", t_ns=t_ns, w_ib_b=slipped, f_b=f / 9.8093587, metadata={})
    (note, *_) = analyse(tmp_path / "b.mcap").notes
    assert "mean rate 861.8 deg/h" in note
    assert note.endswith("57.3 times Earth's: deg/s for rad/s?, specific force 1: g for m/s^2?")


def test_below_resolution_is_said_in_every_cell(tmp_path):
    """Noise of 0.01 deg/s in steps of 0.0625: 0.06 deg/rt-h at 100 Hz, which nobody can tell."""
    rng, n = np.random.default_rng(11), 6000
    rate = np.array([0.31, -0.52, 0.12]) + 0.01 * rng.standard_normal((n, 3))
    w = np.radians(0.0625 * np.rint(rate / 0.0625))
    f = [0.5, -0.3, 9.82] + 0.02 * rng.standard_normal((n, 3))
    t_ns = (np.arange(n) + 1) * 10**7
    write_imu_log(tmp_path / "a.mcap", t_ns=t_ns, w_ib_b=w, f_b=f, metadata={})
    report = analyse(tmp_path / "a.mcap", imu="stim300")
    row = tables(report)[0].rows[0]
    # half a step a sample: 0.03125 deg/s sqrt(0.01 s) x 60
    assert row[1:4] == ("< 0.19, below resolution",) * 3
    assert row[-1] == "below resolution"
    assert any(
        "gyro x: below resolution: its noise is lost in steps of 0.0625" in note
        for note in report.notes
    )
    noise = [e for e in to_json(report)["not_identifiable"] if e["term"] == "N"]
    assert [e["below_resolution"] for e in noise] == [True] * 3
    assert all(e["upper"] > 0.060 for e in noise)
    assert {t["sensor"] for t in to_json(report)["terms"]} == {"accel"}
    assert len(write_pictures(report, tmp_path)) == 2


def test_full_scale_of_the_data_sheet_is_refused(tmp_path):
    rng, n = np.random.default_rng(12), 2000
    w = 1e-4 * rng.standard_normal((n, 3))
    f = np.clip([0.0, 98.2, 0.0] + 0.5 * rng.standard_normal((n, 3)), None, 10 * 9.80665)
    t_ns = (np.arange(n) + 1) * 10**7
    write_imu_log(tmp_path / "a.mcap", t_ns=t_ns, w_ib_b=w, f_b=f, metadata={})
    # 0.1335 below the mean, of a sigma of 0.5: 60.5 % of a Gaussian lie beyond, +- 1 %
    with pytest.raises(Saturated, match="Y1 accelerometer at full scale in 6"):
        analyse(tmp_path / "a.mcap", imu="stim300")


# Tables ------------------------------------------------------------------------------------------


def test_tables(report):
    gyro, accel = tables(report)
    assert gyro.columns == ("term", "x", "y", "z", "unit", "data sheet", "verdict")
    assert [row[0][0] for row in gyro.rows] == list("NBKQR")
    assert gyro.rows[0][0] == "N angle random walk"
    assert accel.rows[0][0] == "N velocity random walk"
    assert re.fullmatch(r"0\.1[45]\d* ±[\d.]+ %|0\.1[45]\d* -[\d.]+/\+[\d.]+ %", gyro.rows[0][1])
    assert gyro.rows[0][4:6] == ("deg/rt-h", "0.15")
    assert re.fullmatch(r"< [\d.]+, [\d.]+ (h|d|years)|< .*never", gyro.rows[1][1])
    assert gyro.rows[1][6] == "not shown"
    assert "6000 samples at 100 Hz, 60 s" in accel.notes[0]


def test_no_sheet_no_verdict(report):
    bare = AllanReport(report.path, report.topic, report.analysis, {}, None, ())
    assert tables(bare)[0].columns == ("term", "x", "y", "z", "unit")


@pytest.mark.parametrize(
    ("value", "low", "high", "written", "percent"),
    [
        (0.14996, 0.1487, 0.1512, "0.1500 (0.1487–0.1512)", "0.1500 ±0.83 %"),
        (5.0, 4.0, 7.0, "5.00 (4.00–7.00)", "5.0 -20/+40 %"),
        (123456.0, 1e5, 1.5e5, "1.23e+05 (1e+05–1.5e+05)", "1.2e+05 ±20 %"),
        (1.234e-5, 1.1e-5, 1.3e-5, "1.23e-05 (1.1e-05–1.3e-05)", "1.2e-05 -11/+5.3 %"),
    ],
)
def test_numbers_keep_the_digits_they_have(value, low, high, written, percent):
    assert with_bounds(value, low, high) == written
    assert in_percent(value, low, high) == percent


def test_verdicts(report):
    n = report.sheet["gyro", "N"]

    def judged(factor):
        sheet = {("gyro", "N"): factor * n, ("gyro", "B"): factor}
        told = AllanReport("", "", report.analysis, sheet, "t", ())
        return verdict(told, "gyro", "N"), verdict(told, "gyro", "B")

    assert judged(0.5)[0] == "worse"
    assert judged(2.0) == ("better", "better")  # 2 rad/s of B would have been seen
    assert verdict(report, "gyro", "K") == ""
    assert isinstance(report.analysis.channels[0].found[0], FoundTerm)
    assert isinstance(report.analysis.channels[0].missing[0], MissingTerm)


# Picture and page --------------------------------------------------------------------------------


def test_the_picture_is_a_png_of_its_size(pictures):
    assert [path.name for path in pictures] == [PNG, HTML]
    data = pictures[0].read_bytes()
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    assert (int.from_bytes(data[16:20]), int.from_bytes(data[20:24])) == (1680, 792)


def test_the_page_needs_nothing_else(pictures, report):
    text = pictures[1].read_text(encoding="utf-8")
    assert not re.search(r"(src|href|srcset)=\"(?!data:)", text)
    assert not re.search("https?:", re.sub(r"data:[^\"]*", "", text))
    assert text.count("data:image/png;base64,") == 2  # for light and for dark
    assert "prefers-color-scheme: dark" in text
    assert "not divided by 0.664" in text
    assert "Safran STIM300, 10 g accelerometers (stim300)" in text
    for name in ("angle random walk", "velocity random walk", "deg/h/rt-h", "arc second"):
        assert name in text
    assert "needs" in text


def test_names_are_escaped(report):
    evil = AllanReport("<b>.mcap", "<i>", report.analysis, {}, None, ("<script>",))
    from stand.report.allan import page

    text = page(evil, b"", b"")
    assert "<script>" not in text
    assert "&lt;script&gt;" in text


def test_a_silent_unit_has_a_picture(tmp_path):
    n = 300
    still = np.tile([0.0, 9.81, 0.0], (n, 1))
    t_ns = (np.arange(n) + 1) * 10**7
    write_imu_log(tmp_path / "s.mcap", t_ns=t_ns, w_ib_b=0 * still, f_b=still, metadata={})
    report = analyse(tmp_path / "s.mcap", imu="ideal")
    assert to_json(report)["terms"] == []
    assert {e["needs_h"] for e in to_json(report)["not_identifiable"]} == {None}
    assert len(write_pictures(report, tmp_path)) == 2


# Faults ------------------------------------------------------------------------------------------


def test_faults_are_one_line_each(tmp_path):
    path = log(tmp_path / "a.mcap", 5)
    with pytest.raises(StandError, match=r"--from 4 --to 9: must be a stretch within"):
        analyse(path, t_from=4, t_to=9)
    with pytest.raises(StandError, match=r"--from nan"):
        analyse(path, t_from=float("nan"))
    with pytest.raises(StandError, match="unknown imu 'stim30'"):
        analyse(path, imu="stim30")
    with pytest.raises(TooShort, match=r"a\.mcap: .*needs at least 96"):
        analyse(path, t_from=1.0, t_to=1.5)
    with pytest.raises(TooShort, match=r"a\.mcap: K is not identifiable in .* needs"):
        analyse(path, terms=["K"])
    with pytest.raises(NotAtRest, match="choose a rest with --from and --to"):
        analyse(log(tmp_path / "m.mcap", 20, moved=True))
    broken = log(tmp_path / "b.mcap", 5, metadata={"imu": {"toml": "title = 3"}})
    with pytest.raises(StandError, match=r"b\.mcap: the preset in its metadata: imu\.toml"):
        analyse(broken)
    damaged = log(tmp_path / "d.mcap", 5, metadata={"schedule": {"json": "{"}})
    with pytest.raises(StandError, match="metadata of the run is damaged"):
        analyse(damaged)
