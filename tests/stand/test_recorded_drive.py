"""Drives from the command to the recording, and back from recordings to the same estimates."""

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import Writer
from scipy.spatial.transform import Rotation

from alignment import ESTIMATORS, Options
from alignment.errors import AlignmentError, PoleError
from alignment.methods.vectors import Curve, Fixes
from alignment.methods.vectors.method import NO_PRIORS, vector_matching
from alignment.units import DEG
from stand import toml_files as catalogue
from stand.errors import StandError
from stand.evaluation.drive_result import DriveSettings
from stand.evaluation.milestones import doubts, needed, points
from stand.imu import load_imu
from stand.recorded_drive import run_drive
from stand.recording.log import load_log
from stand.recording.mcap import cdr, read_fixes, read_imu, read_truth, read_velocities, schemas
from stand.recording.mcap.reader import LogFile
from stand.recording.vehicle_log import Vehicle
from stand.vehicle.scenario import drive_from, load_drive

SHORT = """
title = "Short drive"
description = "From rest, then round a bend, fixes lost for a while."
[start]
latitude_deg = -33
longitude_deg = 151
height_m = 20
heading_deg = 30
[[leg]]
label = "away"
duration_s = 15
speed_m_s = 15
[[leg]]
label = "bend"
duration_s = 15
turn_deg = 90
[satellite]
interval_s = 0.7
outages_s = [[10, 14]]
position_drift_m = 1
"""
RATE = 50  # Hz: fixes every 0.7 s fall between samples every other time


@pytest.fixture(scope="module")
def driven(tmp_path_factory, stand_command):
    """One recorded drive, its file and what the command printed; read it, never change it."""
    root = tmp_path_factory.mktemp("driven")
    scenario, folder = root / "short.toml", root / "drive"
    scenario.write_text(SHORT, encoding="utf-8")
    options = ("--imu", "stim300", "--rate", RATE, "--seed", 4, "--out", folder, "--json")
    outcome = stand_command("drive", scenario, *options)
    assert outcome.code == 0, outcome.err
    return folder, scenario, outcome.json


@pytest.fixture
def refused(stand_command):
    """The one line of a command that must fail."""

    def call(*arguments: object) -> str:
        outcome = stand_command(*arguments)
        assert outcome.code == 2
        assert outcome.out == ""
        assert len(outcome.err.splitlines()) == 1
        return outcome.err.removeprefix("stand: ").removesuffix("\n")

    return call


# --- the command and what it leaves behind


def test_a_drive_leaves_a_recording_a_result_and_a_figure(driven):
    folder, _, printed = driven
    assert sorted(p.name for p in folder.iterdir()) == ["errors.png", "result.json", "run.mcap"]
    assert [p.name for p in folder.parent.iterdir() if p.name.startswith(".")] == []
    result = json.loads((folder / "result.json").read_text())
    assert printed == result | {"out": str(folder)}
    assert (result["drive"], result["imu"], result["seed"]) == ("short", "stim300", 4)
    # 30 s at 50 Hz; fixes at 0, 0.7 .. 29.4, without those from 10 up to 14 s (10.5 .. 13.3)
    assert (result["samples"], result["fixes"]) == (1500, 43 - 5)
    assert (folder / "errors.png").read_bytes().startswith(b"\x89PNG")
    with open(folder / "run.mcap", "rb") as file:
        reader = make_reader(file, validate_crcs=True)
        attached = {a.name: a.data for a in reader.iter_attachments()}
    assert attached["drive.toml"].decode() == SHORT
    # what estimators make of it lies beside: their last digits are of the processor
    assert set(attached) == {"drive.toml", "imu.toml"}


def test_the_result_tells_error_sigma_and_need_of_every_solution(driven):
    result = driven[2]
    assert [s["solution"] for s in result["solutions"]] == ["printed", "observing", "kalman"]
    for solution in result["solutions"]:
        assert [p["fixes"] for p in solution["after"]] == [5, 10, 30, 38]
        assert {p["state"] for p in solution["after"]} <= {"corrected", "carried", "start"}
        assert [need["below_deg"] for need in solution["fixes_needed"]] == pytest.approx([0.5, 0.1])
    printed, observing, kalman = result["solutions"]
    assert kalman["corrections"] == 37  # every fix but the first
    assert kalman["first_correction_s"] == pytest.approx(0.7)
    # standing and barely moving, no heading: refused by its own sigma, and said so
    assert 0 < observing["corrections"] < 37
    assert any("refused: predicted sigma" in d["text"] for d in observing["doubts"])
    if not printed["corrections"]:
        assert {p["state"] for p in printed["after"]} == {"start"}
        start = printed["after"][0]["error_deg"]
        # the programmed start, carried by the gyros: 5 deg/h of bias in 3 s are 0.004 deg
        assert start == pytest.approx(result["start_error_deg"], abs=0.02)


def test_the_same_seed_gives_the_same_recording(driven, tmp_path):
    folder, scenario, _ = driven
    settings = DriveSettings(load_drive(str(scenario)), load_imu("stim300"), RATE, 4)
    again = run_drive(settings, tmp_path / "again")
    assert (again.out / "run.mcap").read_bytes() == (folder / "run.mcap").read_bytes()
    other = run_drive(replace(settings, seed=5), tmp_path / "other")
    assert not np.array_equal(other.fixes.position, again.fixes.position)
    assert other.start_error != again.start_error


def test_a_drive_for_a_person(stand_command, driven, tmp_path):
    outcome = stand_command(
        "drive", driven[1], "--rate", RATE, "--seed", 4, "--out", tmp_path / "new"
    )
    assert outcome.code == 0, outcome.err
    shown = outcome.out
    for text in ("Short drive", "38 fixes", "solution", "below 0.1 deg", "printed", "observing"):
        assert text in shown
    after = driven[2]["solutions"][2]["after"][-1]
    assert f"{after['error_deg']:.3g} ± {after['sigma_deg']:.2g}" in shown
    assert "refused: predicted sigma" in shown
    assert "stand align" in shown


def test_what_is_refused_leaves_nothing(refused, driven, tmp_path):
    folder, scenario, _ = driven
    before = (folder / "run.mcap").read_bytes()
    told = refused("drive", scenario, "--out", folder)
    assert told == f"--out {folder}: a recording is there; --force replaces it"
    assert (folder / "run.mcap").read_bytes() == before
    assert "did you mean weaving?" in refused("drive", "weavin", "--out", tmp_path / "x")
    assert "unknown imu 'stim'" in refused("drive", "weaving", "--imu", "stim")
    assert refused("drive", "weaving", "--rate", 10) == "rate = 10 Hz: must be 20 to 10000"
    assert refused("drive", "weaving", "--seed", -1) == "seed = -1: must be 0 or more"
    wrong = tmp_path / "wrong.toml"
    wrong.write_text(SHORT.replace("speed_m_s = 15", "speed_m_s = -1"), encoding="utf-8")
    assert "speed_m_s = -1: must be greater" in refused("drive", wrong)
    assert [p.name for p in tmp_path.iterdir()] == ["wrong.toml"]


def test_force_replaces(stand_command, tmp_path, driven):
    options = ("--rate", 20, "--out", tmp_path / "run", "--json")
    assert stand_command("drive", driven[1], *options).code == 0
    assert stand_command("drive", driven[1], *options, "--force", "--seed", 2).code == 0
    assert json.loads((tmp_path / "run" / "result.json").read_text())["seed"] == 2


def test_a_solution_that_cannot_take_so_many_fixes_is_told(tmp_path):
    source = catalogue.Source("many", "many.toml", SHORT.replace("0.7", "0.025"))
    settings = DriveSettings(drive_from(source), load_imu("ring-laser"), RATE, 1)
    result = run_drive(settings, tmp_path / "many")
    assert "observing" not in result.matchings
    assert "the observing form takes 1000 at most" in result.refusals["observing"]
    assert "kalman" in result.curves


# --- aligning a recorded drive


def test_align_gives_what_the_drive_gave(stand_command, driven):
    folder, _, printed = driven
    own = stand_command("align", folder, "--json").json
    asked = stand_command("align", folder / "run.mcap", "--method", "vectors", "--json").json
    assert own["estimates"] == asked["estimates"]
    assert own["refusals"] == []
    assert [e["window"] for e in own["estimates"]] == ["printed", "observing", "kalman"]
    for found, made in zip(own["estimates"], printed["estimates"], strict=True):
        assert found.keys() == made.keys()
        for key, value in made.items():
            if isinstance(value, float):
                # places as degrees, and the truth between two samples: w' dt^2/8 of 1 deg/s^2
                assert found[key] == pytest.approx(value, abs=1e-4), key
            else:
                assert found[key] == value


def test_align_for_a_person(stand_command, driven):
    outcome = stand_command("align", driven[0])
    assert outcome.code == 0, outcome.err
    assert "vectors, Kalman filter [deg]" in outcome.out
    assert "± of the fixes" in outcome.out


def test_align_by_another_start(stand_command, driven):
    """The observing form does not care; the filter believes it as far as it is told to."""

    def aligned(*options):
        found = stand_command("align", driven[0], "--method", "vectors", *options, "--json").json
        return {e["window"]: e for e in found["estimates"]}

    told = aligned()
    off = ("--start-attitude", "0,-40,0")  # the truth is yaw -30
    sure, unsure = aligned(*off, "--start-sigma", "0.01"), aligned(*off, "--start-sigma", "5")
    for other in (sure, unsure):
        assert other["observing"]["yaw_deg"] == pytest.approx(told["observing"]["yaw_deg"])
    assert abs(sure["kalman"]["error_yaw_deg"]) > 5  # of 10 deg, most is left
    assert abs(unsure["kalman"]["error_yaw_deg"]) < 3 * unsure["kalman"]["sigma_yaw_deg"]
    assert unsure["kalman"]["sigma_yaw_deg"] > told["kalman"]["sigma_yaw_deg"]


def test_align_from_later_on_has_no_programmed_start(stand_command, driven):
    found = stand_command("align", driven[0], "--from", 12.01, "--json").json["estimates"]
    first, observing, last = found
    for refused in (first, last):
        assert refused["heading_deg"] is None
        assert "starts from a programmed attitude" in refused["flags"][0]
    # fixes every 0.7 s, the first after the outage at 14.0
    assert (observing["t_from_s"], observing["t_to_s"]) == pytest.approx((14.0, 29.4))
    assert abs(observing["error_yaw_deg"]) < 3.5 * observing["sigma_yaw_deg"]


def test_truth_between_samples_is_turned_evenly(driven):
    folder = driven[0]
    log = load_log(folder / "run.mcap", None, None, 24.6)  # the last fix: 24.5, on a sample edge
    (dwell,) = log.dwells
    assert dwell.t_to == pytest.approx(24.5)
    path = load_drive(str(driven[1])).path
    for t_to, last in ((24.6, 24.5), (25.3, 25.2), (24.0, 23.8), (23.5, 23.1)):
        (truth,) = load_log(folder / "run.mcap", None, None, t_to).truths
        (true,) = path.at(np.array([last])).C_nb
        # an even turn within 20 ms: w' dt^2/8 of 1 deg/s^2
        assert truth.C_nb is not None
        assert (true.inv() * truth.C_nb).magnitude() / DEG < 1e-4


@pytest.mark.parametrize(
    ("options", "line"),
    [
        (("--to", 0.5), "/gnss/fix: 1 fixes with a velocity from 0.000 to 0.500 s, at least 2 are"),
        (("--start-attitude", "1,2"), "--start-attitude 1,2: must be 3 numbers with commas"),
        (("--start-attitude", "1,2,x"), "--start-attitude 1,2,x: must be 3 numbers with commas"),
        (("--start-sigma", "0"), "--start-sigma 0: must be above 0, at most 180 deg"),
        (("--fix-sigma", "5"), "--fix-sigma 5: must be 2 numbers with commas between"),
        (("--fix-sigma", "5,0"), "--fix-sigma 5,0: both must be above 0"),
        (("--method", "triad"), "short: not at rest near"),
    ],
)
def test_align_refuses(refused, driven, options, line):
    assert line in refused("align", driven[0], *options)


def test_a_run_at_rest_has_no_fixes(refused, recorded):
    told = refused("align", recorded.folder, "--method", "vectors")
    assert "no topic with sensor_msgs/msg/NavSatFix; it has: /imu/data" in told


# --- logs of others


def foreign(path: Path, folder: Path, every: int = 1, shift_ns: int = 0, stated: bool = True):
    """A recorded drive as another's log: own topics, plain TwistStamped, no metadata."""
    imu, fixes, speeds = (
        read(folder / "run.mcap") for read in (read_imu, read_fixes, read_velocities)
    )
    rows = (
        (
            "/microstrain/imu", schemas.IMU, imu.t_ns,
            cdr.imu_messages(imu.t_ns, imu.w_ib_b, imu.f_b, frame_id="base"),
        ),
        (
            "/ublox/fix", schemas.NAV_SAT_FIX, fixes.t_ns[::every],
            cdr.fix_messages(
                fixes.t_ns, fixes.place, frame_id="gps", variance=26.0 if stated else 0.0
            )[::every],
        ),
        (
            "/ublox/vel", schemas.TWIST_WITH_COVARIANCE_STAMPED, speeds.t_ns + shift_ns,
            cdr.velocity_messages(
                speeds.t_ns + shift_ns, speeds.v, frame_id="gps", variance=0.0025 if stated else 0.0
            ),
        ),
    )  # fmt: skip
    with open(path, "wb") as file:
        out = Writer(file)
        out.start(profile="ros2", library="another")
        for topic, kind, times, payloads in rows:
            schema = out.register_schema(kind, "ros2msg", b"")
            channel = out.register_channel(topic, "cdr", schema)
            for t, payload in zip(times.tolist(), payloads, strict=True):
                out.add_message(channel, log_time=t, publish_time=t, data=payload.tobytes())
        out.finish()
    return path


def test_a_foreign_log_with_fixes_is_aligned(stand_command, refused, driven, tmp_path):
    path = foreign(tmp_path / "road.mcap", driven[0])
    command = ("align", path, "--method", "vectors", "--json")
    alone = {e["window"]: e for e in stand_command(*command).json["estimates"]}
    assert alone["kalman"]["heading_deg"] is None
    told = {e["window"]: e for e in driven[2]["estimates"]}["observing"]
    # without the data sheet it knows of no bias: some mg over 1 m/s^2 come through, 0.6 deg each
    off = alone["observing"]["heading_deg"] - told["heading_deg"]
    assert abs(off) < 2
    assert NO_PRIORS in alone["observing"]["flags"]
    assert alone["observing"]["sigma_heading_deg"] < told["sigma_heading_deg"]
    started = stand_command(*command, "--start-attitude", "0,-30,0").json["estimates"]
    assert started[2]["heading_deg"] is not None
    assert "not at rest" in refused("align", path, "--method", "triad")


def test_half_of_the_velocities_are_enough(driven, tmp_path):
    path = foreign(tmp_path / "road.mcap", driven[0], every=2)
    (dwell,) = load_log(path, None, None, None, vehicle=Vehicle()).dwells
    assert dwell.fixes is not None
    assert len(dwell.fixes) == 19
    # what the messages state: 5 m white and 1 m of drift in one
    assert dwell.fixes.position_sigma == pytest.approx(np.sqrt(26.0))
    assert dwell.fixes.velocity_sigma == pytest.approx(0.05)
    told = Vehicle(position_sigma=3.0, velocity_sigma=0.2)
    (dwell,) = load_log(path, None, None, None, vehicle=told).dwells
    assert dwell.fixes is not None
    assert (dwell.fixes.position_sigma, dwell.fixes.velocity_sigma) == (3.0, 0.2)


def test_foreign_logs_that_will_not_do(refused, driven, tmp_path):
    late = foreign(tmp_path / "late.mcap", driven[0], shift_ns=200_000_000)
    told = refused("align", late, "--method", "vectors")
    assert told.endswith(
        "no velocity within 1 ms of any fix of /ublox/fix: the nearest is 0.2 s away"
    )
    silent = foreign(tmp_path / "silent.mcap", driven[0], stated=False)
    told = refused("align", silent, "--method", "vectors")
    assert "/ublox/fix: states no covariance: the noise of the fixes must be given" in told
    (dwell,) = load_log(
        silent, None, None, None, vehicle=Vehicle(position_sigma=5.0, velocity_sigma=0.05)
    ).dwells
    assert dwell.fixes is not None


def test_a_damaged_record_of_a_drive_is_one_line(driven, tmp_path, monkeypatch):
    whole = LogFile.imu

    def damaged(file, topic=None):
        log = whole(file, topic)
        record = log.metadata["drive"] | {"start_sigma_rad": "much"}
        return replace(log, metadata=log.metadata | {"drive": record})

    monkeypatch.setattr(LogFile, "imu", damaged)
    with pytest.raises(StandError, match=r"is damaged: drive: start_sigma_rad = 'much': must be"):
        load_log(driven[0] / "run.mcap", None, None, None)


# --- the method on the list


def test_the_method_tells_when_nothing_answers(driven):
    (dwell,) = load_log(driven[0] / "run.mcap", None, None, None).dwells
    assert dwell.fixes is not None
    few = replace(dwell, nominal=None, t_to=2.0, fixes=part(dwell.fixes, slice(0, 3)))
    with pytest.raises(AlignmentError, match="refused: predicted sigma"):
        vector_matching([few], None, Options())  # pyright: ignore[reportArgumentType]
    north = replace(dwell.fixes, position=np.tile([0.0, 0, 6356752.3], (len(dwell.fixes), 1)))
    with pytest.raises(PoleError):
        vector_matching([replace(dwell, fixes=north)], None, Options())  # pyright: ignore[reportArgumentType]
    assert ESTIMATORS["vectors"].suited(dwell)
    assert not ESTIMATORS["vectors"].suited(replace(dwell, fixes=None))
    assert ESTIMATORS["inertial"].suited(dwell)


def part(fixes: Fixes, rows) -> Fixes:
    return replace(
        fixes, t=fixes.t[rows], position=fixes.position[rows], velocity=fixes.velocity[rows]
    )


def curve(errors, sigmas, given) -> Curve:
    m = len(errors)
    error = np.zeros((m, 3))
    error[:, 1] = errors
    P = np.zeros((m, 3, 3))
    P[:, 0, 0] = np.square(sigmas)
    return Curve("", np.arange(2, m + 2), error, P, np.array(given, bool))


def test_fixes_needed_by_hand():
    found = curve(
        [0.05, 0.3, 0.08, 0.2, 0.09, 0.01], [0.9, 0.5, 0.2, 0.05, 0.04, 0.2], [0, 0, 1, 0, 1, 1]
    )
    # fixes 2 to 7: the error stays below 0.1 from fix 6 on, below 0.25 from the first corrected;
    # sigma ends at 0.2
    assert needed(found, 0.1) == (6, None)
    assert needed(found, 0.25) == (4, 4)
    assert needed(found, 1.0) == (4, 4)
    assert [(p.fixes, p.state) for p in points(found)] == [(5, "carried"), (7, "corrected")]
    assert points(found)[0].sigma == pytest.approx(0.05)
    never = curve([0.01] * 3, [0.01] * 3, [0, 0, 0])
    assert needed(never, 1.0) == (None, None)
    assert points(never)[0].state == "start"


def test_doubts_are_gathered_by_kind():
    said = ("", "sigma 1e+03 deg", "sigma 4.5 deg", "", "other", "sigma 3 deg")
    matching = SimpleNamespace(
        at_fix=np.ones(6, bool),
        fixes=np.arange(1, 7),
        corrected=np.array([0, 0, 0, 1, 1, 0], bool),
        doubts=said,
    )
    told = [(d.count, d.first, d.last, d.text) for d in doubts(matching)]  # pyright: ignore
    assert told == [(3, 2, 6, "sigma 3 deg"), (1, 5, 5, "other")]


def test_the_list_shows_the_trajectories(stand_command):
    rows = stand_command("list", "trajectories", "--json").json
    assert [row["id"] for row in rows] == catalogue.ids("trajectories")
    outage = next(row for row in rows if row["id"] == "aircraft-outage")
    # 210 s: 211 fixes without those from 60 to 99 s
    assert (outage["duration_s"], outage["fixes"], outage["outages s"]) == (210, 171, "60 to 100")
    assert stand_command("list", "trajectories").code == 0
    methods = stand_command("list", "methods", "--json").json
    assert "vectors" in [row["id"] for row in methods]


def test_truth_and_readings_of_a_recorded_drive(driven):
    """The unit's attitude as recorded, in world axes by hand: heading 30 deg, X1 forward."""
    truth = read_truth(driven[0] / "run.mcap")
    x1 = Rotation.from_quat(truth.q_wb[0]).apply([1.0, 0, 0])  # east, north, up
    # 20 ms from rest: nothing has turned
    assert x1 == pytest.approx([0.5, np.sqrt(0.75), 0.0], abs=1e-9)
    at_rest = truth.f_b[0]
    assert at_rest == pytest.approx([0, 9.7956607 - 3.086e-6 * 20, 0], abs=2e-6)  # 2 um/s^2 per m
