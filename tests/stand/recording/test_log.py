"""Recordings as dwells and turns: schedules new and old, when settled, encoders of real tables."""

import json
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from mcap.writer import Writer
from scipy.spatial.transform import Rotation

from alignment import ImuReadings, Options, Priors, Site
from alignment.angles import SequenceRule
from stand.errors import StandError
from stand.motion.plan import PlannedStep, Turning
from stand.physics.mjcf import describe, load_model
from stand.recording.curves import Phase
from stand.recording.encoders import Encoders, axis_of_turn
from stand.recording.log import load_log
from stand.recording.mcap import EPOCH_NS, JointLog, McapWriter, cdr, schemas
from stand.recording.metadata import (
    LoggedStretch,
    describe_estimate,
    describe_schedule,
    describe_site,
)
from stand.recording.samples_review import write_review
from stand.samples import ImuBlock, TruthBlock

RATE = 10  # Hz
S = 1_000_000_000
DEG = np.pi / 180
C_NB = Rotation.from_euler("ZYX", [10.0, 20.0, 30.0], degrees=True)
AXIS_B = (0.0, 0.6, 0.8)
SPEED = 7.0  # deg/s


def steps() -> tuple[PlannedStep, ...]:
    """A dwell, a turn with ramps of a second, a rocking without rest, a dwell."""
    turning = Turning(5, SPEED * DEG, np.array(AXIS_B))
    zero = np.zeros(6)
    return (
        PlannedStep(0, "dwell", "A", 0.0, 4.0, 0.0, 4.0, zero, C_NB),
        PlannedStep(1, "rate", "turn", 4.0, 16.0, 5.0, 15.0, zero, C_NB.inv(), turning),
        PlannedStep(2, "sine", "rock", 16.0, 20.0, 17.0, 19.0, zero, C_NB),
        PlannedStep(3, "dwell", "B", 20.0, 24.0, 20.0, 24.0, zero, C_NB * C_NB),
    )


def samples(n: int = 240) -> tuple[TruthBlock, ImuBlock]:
    """The encoder of `inner` grows without end, 0.01 rad off the truth."""
    t_ns = (np.arange(n) + 1) * (S // RATE)
    rng = np.random.default_rng(2)
    joints, zero = np.zeros((n, 6)), np.zeros((n, 6))
    joints[:, 5] = SPEED * DEG * t_ns / S + 300.0
    q = Rotation.random(n, rng).as_quat()
    w, f = rng.normal(size=(2, n, 3))
    return TruthBlock(t_ns, w, f, q, joints, zero, joints + 0.01, zero), ImuBlock(t_ns, w, f)


def recording(
    path: Path,
    schedule: dict[str, str],
    settled: dict[str, str] | None = None,
    estimate: dict[str, str] | None = None,
) -> Path:
    metadata = {
        "run": {"stand_version": "0", "epoch_ns": str(EPOCH_NS)},
        "site": describe_site(Site(0.8)),
        "schedule": schedule,
        "estimate": estimate or {},
    }
    model = describe(load_model())
    with McapWriter(
        path,
        model=model,
        robot_description="",
        metadata=metadata,
        attachments={},
        rate_noise=np.zeros(3),
        force_noise=np.zeros(3),
    ) as file:
        file.write(*samples())
        if settled is not None:
            file.close(metadata={"settled": settled})
    return path


def load(path: Path, t_from=None, t_to=None, **more):
    return load_log(path, None, t_from, t_to, **more)


def refusal(path: Path, *arguments, **more) -> str:
    with pytest.raises(StandError) as caught:
        load(path, *arguments, **more)
    assert str(caught.value).isprintable()
    return str(caught.value)


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> Path:
    return recording(tmp_path_factory.mktemp("log") / "run.mcap", describe_schedule(steps()))


# --- our own recordings


def test_the_schedule_says_when_each_step_is_steady_and_what_turns():
    entries = json.loads(describe_schedule(steps())["json"])
    assert [e["kind"] for e in entries] == ["dwell", "rate", "sine", "dwell"]
    rate = entries[1]
    assert (rate["t_from_s"], rate["t_to_s"]) == (4.0, 16.0)
    assert (rate["steady_from_s"], rate["steady_to_s"]) == (5.0, 15.0)
    assert rate["turning"]["axis"] == "inner"
    assert rate["turning"]["rate_deg_s"] == pytest.approx(SPEED, rel=1e-15)
    assert rate["turning"]["axis_b"] == list(AXIS_B)
    assert entries[0]["turning"] is None


def test_dwells_and_turns_of_a_recording(run):
    truth, imu = samples()
    log = load(run)
    assert [(d.label, d.t_from, d.t_to) for d in log.dwells] == [
        ("A", 0.0, 4.0),
        ("turn", 5.0, 15.0),
        ("B", 20.0, 24.0),
    ]
    first, turning, _ = log.dwells
    assert first.turn is None
    assert turning.turn is not None
    np.testing.assert_array_equal(turning.turn.axis_b, AXIS_B)
    # sample k ends at (k + 1) / 10 s: 5 s to 15 s are samples 50 to 149
    np.testing.assert_array_equal(turning.readings.w_ib_b, imu.w_ib_b[50:150])
    np.testing.assert_array_equal(turning.turn.angle, truth.encoders[50:150, 5])
    assert len(turning.window()) == 100
    for dwell, C_nb in zip(log.dwells, (C_NB, C_NB.inv(), C_NB * C_NB), strict=True):
        assert (dwell.nominal * C_nb.inv()).magnitude() < 1e-15
    # world to north-east-down by hand; of a turn: its end turned back by the encoder's angle,
    # some 310 rad, which rounds to 3e-14
    ned = np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1]])
    end = ned @ Rotation.from_quat(truth.q_wb[[39, 149]]).as_matrix()
    back = Rotation.from_rotvec(-truth.encoders[149, 5] * np.array(AXIS_B)).as_matrix()
    np.testing.assert_allclose(log.truths[0].C_nb.as_matrix(), end[0], rtol=0, atol=1e-15)
    np.testing.assert_allclose(log.truths[1].C_nb.as_matrix(), end[1] @ back, rtol=0, atol=2e-13)


@pytest.mark.parametrize(
    ("settled", "found"),
    [
        ({"A": "1.25"}, [("A", 1.25), ("turn", 5.0), ("B", 20.0)]),
        ({"A": "never", "B": "20.5"}, [("turn", 5.0), ("B", 20.5)]),
        ({"A": "inf", "B": "24.0"}, [("turn", 5.0)]),
        ({"A": "-3"}, [("A", 0.0), ("turn", 5.0), ("B", 20.0)]),
    ],
)
def test_a_dwell_counts_from_when_it_had_settled(tmp_path, settled, found):
    path = recording(tmp_path / "run.mcap", describe_schedule(steps()), settled)
    assert [(d.label, d.t_from) for d in load(path).dwells] == found


def test_a_damaged_record_is_told_in_one_line(tmp_path):
    path = recording(tmp_path / "run.mcap", describe_schedule(steps()), {"A": "soon"})
    told = "metadata of the run is damaged: settled: A = 'soon': must be a valid number"
    assert told in refusal(path)


def test_recordings_from_before_turns_still_load(tmp_path):
    entries = json.loads(describe_schedule(steps())["json"])
    for entry in entries:
        for key in ("steady_from_s", "steady_to_s", "turning"):
            del entry[key]
    path = recording(tmp_path / "run.mcap", {"json": json.dumps(entries)})
    assert [(d.label, d.t_from, d.t_to) for d in load(path).dwells] == [
        ("A", 0.0, 4.0),
        ("B", 20.0, 24.0),
    ]


def test_a_stretch_keeps_what_is_known_of_where_it_lies(run):
    (dwell,) = load(run, 6.0, 9.0).dwells
    assert (dwell.label, dwell.t_from, dwell.t_to) == ("turn", 6.0, 9.0)
    assert dwell.turn is not None
    np.testing.assert_array_equal(dwell.turn.angle, samples()[0].encoders[60:90, 5])
    (across,) = load(run, 3.0, 9.0).dwells
    assert (across.label, across.nominal, across.turn) == ("run", None, None)


SKEWED = ((1.0, 0.0, 0.0), (0.0, 0.6, 0.8), (0.0, 0.0, 1.0))


def test_what_was_to_be_estimated_comes_back(tmp_path):
    """Every prior with a value of its own, so that none takes another's place."""
    given: dict = {f.name: 0.1 + k for k, f in enumerate(fields(Priors))}
    given |= {"gyro_axes": SKEWED, "accel_axes": SKEWED[::-1]}
    options = Options(4.5, SequenceRule.PUBLISHED, Priors(**given))
    estimate = describe_estimate(options, ("triad", "carousel"))
    path = recording(tmp_path / "run.mcap", describe_schedule(steps()), estimate=estimate)
    log = load(path)
    assert log.options == options
    assert log.methods == ("triad", "carousel")
    del estimate["prior_turn_rad"]  # a recording from before
    path = recording(tmp_path / "old.mcap", describe_schedule(steps()), estimate=estimate)
    assert load(path).options.priors == replace(options.priors, turn=0.0)


# --- a stretch of it for the eye


@pytest.mark.parametrize(
    ("m", "shown"),
    [(1, "every sample"), (4, "two rows of 4 samples: a shorter stretch shows all")],
)
def test_a_stretch_for_review_has_the_steps_within_it(run, tmp_path, monkeypatch, m, shown):
    """Of 10 samples a second those from 3 to 18 s: steps are cut at both, what is over is out."""
    taken = []

    def written(path, *told):
        taken.append(told)
        path.write_bytes(b"rrd")
        return m

    monkeypatch.setattr("stand.recording.review.excerpt.write_excerpt", written)
    told = write_review(load(run), tmp_path / "a.rrd", 3.0, 18.04)
    ((name, readings, phases),) = taken
    assert name == f"{run}, 3.000 to 18.000 s"
    assert told == f"{name}: 151 samples, {shown}"
    assert readings.t == pytest.approx(np.arange(30, 181) / 10)
    np.testing.assert_array_equal(readings.f_b, samples()[1].f_b[29:180])
    assert phases == [
        Phase(3 * S, 4 * S, "dwell", "A"), Phase(4 * S, 16 * S, "rate", "turn"),
        Phase(16 * S, 18 * S, "sine", "rock"),
    ]  # fmt: skip
    write_review(load(run), tmp_path / "b.rrd", None, None)
    assert (len(taken[1][1]), taken[1][2][-1]) == (240, Phase(20 * S, 24 * S, "dwell", "B"))
    with pytest.raises(StandError, match=r"from 30 to 24 s: must hold .* 0\.100 to 24\.000 s$"):
        write_review(load(run), tmp_path / "c.rrd", 30.0, None)
    with pytest.raises(StandError, match=r"c\.mcap: must end in \.rrd"):
        write_review(load(run), tmp_path / "c.mcap", None, None)


# --- logs of real tables


def logged(path: Path, t, w, f, t_e, said) -> Path:
    """An IMU and the encoder of the joint `table`, as a log of no stand of ours."""
    imu = cdr.imu_messages(np.round(t * S).astype(np.int64), w, f, frame_id="imu")
    stamps = np.round(t_e * S).astype(np.int64)
    joints = cdr.joint_states(
        stamps, ("lid", "table"), np.stack([0 * said, said], axis=1), np.zeros((len(t_e), 2))
    )
    with open(path, "wb") as file:
        out = Writer(file)
        out.start(profile="ros2", library="table")
        for topic, kind, times, rows in (
            ("/imu", schemas.IMU, np.round(t * S), imu),
            ("/table/state", schemas.JOINT_STATE, stamps, joints),
        ):
            schema = out.register_schema(kind, "ros2msg", b"")
            channel = out.register_channel(topic, "cdr", schema)
            for stamp, row in zip(times, rows, strict=True):
                out.add_message(channel, int(stamp), row.tobytes(), int(stamp))
        out.finish()
    return path


def table_log(
    path: Path,
    rate=0.5,
    wrap=True,
    encoder_hz=20.0,
    sign=1.0,
    cover=(0.0, 60.0),
    tilt=0.02,
    bias=0.0,
) -> tuple[Path, np.ndarray]:
    """50 Hz of an IMU whose Y1 is up on a table, and its encoder on stamps of its own.

    `sign`: of the encoder about up. Returns the file and the exact angle at the IMU's stamps.
    """
    t = 100.0 + np.arange(1, 3001) / 50.0
    up = np.array([tilt, np.sqrt(1 - tilt**2), 0.0])
    w = sign * rate * np.tile(up, (len(t), 1)) + bias * up
    f = 9.8 * np.tile(up, (len(t), 1))
    t_e = 100.0 + np.arange(cover[0], cover[1] + 1e-9, 1.0 / encoder_hz)
    angle = rate * (t_e - 100.0) + 6.0
    logged(path, t, w, f, t_e, np.mod(angle, 2 * np.pi) if wrap else angle)
    return path, rate * (t - 100.0) + 6.0


@pytest.mark.parametrize("wrap", [True, False])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_real_table_turns_about_the_vertical(tmp_path, sign, wrap):
    path, angle = table_log(tmp_path / "log.mcap", sign=sign, wrap=wrap)
    (dwell,) = load(path, turn_joint="table").dwells
    assert dwell.turn is not None
    assert dwell.nominal is None
    # 0.02 rad off Y1; up or down, so that the encoder grows about it
    hand = sign * np.array([0.02, 0.99979998, 0.0])
    np.testing.assert_allclose(dwell.turn.axis_b, hand, atol=1e-8)
    # straight between readings of a constant rate; stamps round to 1 ns
    grown = dwell.turn.angle - dwell.turn.angle[0]
    np.testing.assert_allclose(grown, angle - angle[0], atol=5e-9)
    assert grown[-1] > 4 * 2 * np.pi


def test_a_stretch_and_a_told_axis_of_a_real_table(tmp_path):
    path, _ = table_log(tmp_path / "log.mcap")
    (dwell,) = load(path, 10.0, 20.0, turn_joint="table", turn_axis=(0.0, 2.0, 0.0)).dwells
    assert (dwell.t_from, dwell.t_to) == (10.0, 20.0)
    np.testing.assert_array_equal(dwell.turn.axis_b, [0.0, 1.0, 0.0])
    assert len(dwell.turn.angle) == len(dwell.readings) == 500


def test_a_told_axis_stands_where_a_bias_could_hide_the_rate(tmp_path):
    """A table at 0.03 deg/s under gyros with 0.5 deg/s of bias."""
    path, _ = table_log(tmp_path / "log.mcap", rate=0.03 * DEG, bias=0.5 * DEG)
    (dwell,) = load(path, turn_joint="table", turn_axis=(0.0, 1.0, 0.0)).dwells
    np.testing.assert_array_equal(dwell.turn.axis_b, [0.0, 1.0, 0.0])
    assert "times as fast about (0.020, 1.000, 0.000) as table does" in refusal(
        path, turn_joint="table"
    )


@pytest.mark.parametrize(
    ("options", "arguments", "text"),
    [
        ({}, {"turn_joint": "tabel"}, "/table/state: joint 'tabel': did you mean table? known"),
        ({}, {"turn_joint": "lid"}, "log: lid does not turn"),
        (
            {"cover": (1.0, 60.0)},
            {"turn_joint": "table"},
            "/table/state: from 0.980 to 59.980 s, must hold all of the IMU's stretch",
        ),
        (
            {"encoder_hz": 0.25, "rate": 0.5},
            {"turn_joint": "table"},
            "/table/state: steps of 114.6 deg between readings: must be at most 90",
        ),
        (
            {},
            {"turn_joint": "table", "turn_axis": (0.0, -1.0, 0.0)},
            "the gyros turn -1.000 times as fast about (0.000, -1.000, 0.000) as table does",
        ),
        ({}, {"turn_joint": "table", "turn_axis": (0, 0, 0)}, "must be three numbers, not all"),
        ({}, {"turn_axis": (0, 1, 0)}, "turn axis: must have a turn joint with it"),
    ],
)
def test_faults_of_turns(tmp_path, options, arguments, text):
    path, _ = table_log(tmp_path / "log.mcap", **options)
    assert text in refusal(path, **arguments)


def test_encoders_between_readings_by_hand():
    """Readings at 0, 1, 2 s of 350, 10, 20 deg: at 0.5 s it is 360."""
    angles = np.radians([[350.0], [10.0], [20.0]])
    log = JointLog("", "/j", np.array([0, S, 2 * S]), ("table",), angles, None)
    at = Encoders(log, 0, counted=False).angle("table", np.array([0.5, 1.0, 1.75]))
    np.testing.assert_allclose(np.degrees(at), [360.0, 370.0, 377.5], rtol=1e-15)
    # our own count turns themselves, however fast: nothing is added
    same = Encoders(log, 0, counted=True).angle("table", np.array([0.5, 1.0]))
    np.testing.assert_allclose(np.degrees(same), [180.0, 10.0], rtol=1e-14)


def test_the_longest_step_of_an_encoder():
    """A quarter is counted; a thousandth more is refused."""
    angles = np.array([[1.5], [1.0], [0.5], [0.0]]) * np.pi
    log = JointLog("", "/j", np.arange(4) * S, ("table",), angles, None)
    t = np.arange(4.0)
    at = Encoders(log, 0, counted=False).angle("table", t)
    np.testing.assert_array_equal(at, angles[:, 0])
    far = JointLog("", "/j", np.arange(4) * S, ("table",), angles * 1.001, None)
    with pytest.raises(
        StandError, match=r"steps of 90\.1 deg between readings: must be at most 90,"
    ):
        Encoders(far, 0, counted=False).angle("table", t)


@pytest.mark.parametrize(
    ("first", "last", "spanned"),
    [(0.0, 3.0, True), (-0.9e-6, 3.0 + 0.9e-6, True), (-2e-6, 3.0, False), (0.0, 3.000002, False)],
)
def test_encoders_span_the_readings_to_a_microsecond(first, last, spanned):
    log = JointLog("", "/j", np.arange(4) * S, ("table",), np.arange(4.0)[:, None] * 0.1, None)
    if spanned:
        found = Encoders(log, 0, counted=True).angle("table", np.array([first, 1.5, last]))
        np.testing.assert_allclose(found, [0.0, 0.15, 0.3], atol=1e-15)
    else:
        with pytest.raises(StandError, match=r"from 0\.000 to 3\.000 s, must hold all"):
            Encoders(log, 0, counted=True).angle("table", np.array([first, last]))


def test_two_samples_lie_between_encoders():
    log = JointLog("", "/j", np.arange(4) * S, ("table",), np.arange(4.0)[:, None] * 0.1, None)
    at = Encoders(log, S, counted=True)  # whose time zero is a second later
    np.testing.assert_allclose(at.angle("table", np.array([0.0, 0.5])), [0.1, 0.15])
    with pytest.raises(StandError, match="two samples or more"):
        at.angle("table", np.array([0.5]))


def turned_by(factor: float, speed: float, up=(0.0, 1.0, 0.0), **told) -> np.ndarray:
    """Gyros that turn `factor` times as fast as an encoder at `speed` [rad/s] about Y1."""
    t = np.arange(1, 11) / 10
    angle = speed * t
    w, f = np.outer(np.ones(10), [0.0, factor * speed, 0.0]), np.outer(np.ones(10), up)
    stretch = LoggedStretch("s", 0.0, 1.0, joint="table", **told)
    return axis_of_turn(stretch, ImuReadings(t, w, f), angle)


def test_gyros_may_be_half_as_fast_as_the_encoder_and_half_faster():
    for factor in (0.51, 1.0, 1.49):
        np.testing.assert_allclose(turned_by(factor, 0.5), [0.0, 1.0, 0.0])
        # unknown: the axis is that about which the encoder grows
        np.testing.assert_allclose(turned_by(-factor, 0.5), [0.0, -1.0, 0.0])
        np.testing.assert_allclose(turned_by(factor, 0.5, up=(0.0, -3.0, 0.0)), [0.0, 1.0, 0.0])
        np.testing.assert_allclose(turned_by(factor, 0.5, axis_b=(0.0, 1.0, 0.0)), [0.0, 1.0, 0.0])
    for factor in (0.49, 1.51):
        for told in ({}, {"axis_b": (0.0, 1.0, 0.0)}):
            with pytest.raises(StandError, match=rf"s: the gyros turn {factor:.3f} times as fast"):
                turned_by(factor, 0.5, **told)


def test_a_told_axis_stands_within_a_bias_of_one_degree_a_second():
    """Of an encoder at 1 deg/s gyros at 0.05 deg/s are 0.95 off, at -0.05 deg/s 1.05."""
    np.testing.assert_allclose(turned_by(0.05, DEG, axis_b=(0.0, 1.0, 0.0)), [0.0, 1.0, 0.0])
    with pytest.raises(StandError, match=r"turn -0\.050 times as fast .* must be 0\.5 to 1\.5: "):
        turned_by(-0.05, DEG, axis_b=(0.0, 1.0, 0.0))
    with pytest.raises(StandError, match=r"turn 0\.050 times as fast"):
        turned_by(0.05, DEG)


def test_the_schedules_axis_needs_no_gyros():
    nominal = (0.0, 0.0, 0.0, 1.0)
    given = {"axis_b": (0.6, 0.8, 0.0), "nominal": nominal}
    np.testing.assert_array_equal(turned_by(9.0, 0.5, **given), [0.6, 0.8, 0.0])
    with pytest.raises(StandError, match="as fast"):  # what was told with a rate is compared
        turned_by(9.0, 0.5, rate=0.5, **given)


# --- a real table's carousel, from the command line -----------------------------------------------


def carousel_log(path: Path, heading: float = 30.0) -> Path:
    """A table at 6 deg/s for two turns, nose at `heading` [deg] where its encoder reads zero."""
    rate, hz, n = 6 * DEG, 20.0, 2400
    t = np.arange(1, n + 1) / hz
    # middle of the sample, part of the mean of a harmonic over it
    turned, part = rate * (t - 0.5 / hz), np.sinc(rate / hz / 2 / np.pi)
    yaw = turned - heading * DEG  # north to west
    north, up = np.array([9.96651, 11.26509]) * DEG / 3600
    w = np.stack(
        [part * north * np.cos(yaw), rate + up + 0 * t, part * north * np.sin(yaw)], axis=1
    )
    f = np.tile([0.0, 9.8093587, 0.0], (n, 1))
    t_e = np.arange(0, n + 1) / hz
    return logged(path, t, w, f, t_e, np.mod(rate * t_e, 2 * np.pi))


@pytest.mark.parametrize("axis", [(), ("--turn-axis", "0,1,0")])
def test_a_real_tables_carousel_from_the_command_line(tmp_path, stand_command, axis):
    path = carousel_log(tmp_path / "table.mcap")
    arguments = ("--method", "carousel", "--latitude", "48.5", "--turn-joint", "table", *axis)
    told = stand_command("align", path, *arguments, "--json").json
    (estimate,) = told["estimates"]
    # readings are exact but for a gravity and an Earth rate of seven digits
    assert estimate["heading_deg"] == pytest.approx(30.0, abs=1e-5)
    assert estimate["roll_deg"] == pytest.approx(0.0, abs=1e-5)


@pytest.mark.parametrize(
    ("options", "line"),
    [
        (("--turn-joint", "tabel"), "joint 'tabel': did you mean table?"),
        (("--turn-joint", "table", "--turn-axis", "0,1"), "--turn-axis 0,1: must be 3 numbers"),
        (("--turn-joint", "table", "--turn-axis", "up"), "--turn-axis up: must be 3 numbers"),
        (("--turn-axis", "0,1,0"), "turn axis: must have a turn joint with it"),
    ],
)
def test_faults_of_turns_on_the_command_line(tmp_path, stand_command, options, line):
    path = carousel_log(tmp_path / "table.mcap")
    said = stand_command("align", path, "--method", "carousel", "--latitude", "48.5", *options)
    assert said.code == 2
    assert line in said.err


def test_a_data_sheet_enters_the_sigmas_of_a_real_log(tmp_path, stand_command):
    """hg9900 at rest: 0.0035 deg/h over 9.96651 deg/h, 25 ug of levelling, tan(lat) of it."""
    n = 1200
    t, noise = np.arange(1, n + 1) / 20, np.random.default_rng(1)
    w = np.tile(np.array([9.96651, 11.26509, 0.0]) * DEG / 3600, (n, 1))
    f = np.tile([0.0, 9.8093587, 0.0], (n, 1))
    w, f = w + 1e-9 * noise.standard_normal((n, 3)), f + 1e-6 * noise.standard_normal((n, 3))
    path = logged(tmp_path / "still.mcap", t, w, f, t, 0 * t)
    plain = stand_command("align", path, "--latitude", 48.5, "--json").json["estimates"][0]
    told = stand_command("align", path, "--latitude", 48.5, "--imu", "hg9900", "--json").json
    (stated,) = told["estimates"]
    assert plain["sigma_heading_deg"] < 1e-4  # of the noise alone
    tilt = 0.025 * 9.80665e-3 / 9.8093587 / DEG
    heading = np.hypot(0.0035 / 9.96651 / DEG, 1.1303 * tilt)
    # drift that outlasts a dwell is a bias, too: below 1 % of it
    assert stated["sigma_pitch_deg"] == pytest.approx(tilt, rel=0.01)
    assert stated["sigma_heading_deg"] == pytest.approx(heading, rel=0.01)
    assert stated["heading_deg"] == pytest.approx(plain["heading_deg"], abs=1e-9)
    said = stand_command("align", path, "--imu", "hg9901")
    assert (said.code, said.err.count("\n")) == (2, 1)
    assert "hg9900" in said.err
