"""What each option does, told by a number or a word it changes, and its exit code.

Those that other tests pass are found by reading the tests; the others are here. A new option
without a test is named by the last test of this file.
"""

import ast
import functools
from math import cos, radians, sin
from pathlib import Path

import numpy as np
import pytest
import typer
from procedures import resting

from stand.cli.app import app
from stand.recording.mcap import read_imu, read_joints, write_imu_log

TESTS = Path(__file__).parents[2]
TABLES = TESTS.parent / "stand" / "tables"
ACCEL = 9.80665
REST = resting(3)
SHORT_MOVE = """
[[step]]
kind = "move"
label = "round"
joints_deg = { outer = 10 }
[[step]]
kind = "dwell"
label = "X1 up"
duration_s = 3
"""


SWAY = """
[[background]]
kind = "sway"
axes.base_yaw = { rms_deg = 0.1, frequency_hz = 1.0, damping = 0.2 }
"""


@pytest.fixture
def here(stand_command, tmp_path, monkeypatch):
    """Commands in an empty folder but for `rest.toml` and `moved.toml`; exit code 0 is owed."""
    monkeypatch.chdir(tmp_path)
    Path("rest.toml").write_text(REST, encoding="utf-8")
    Path("moved.toml").write_text(REST + SHORT_MOVE, encoding="utf-8")

    def call(*arguments, code=0):
        outcome = stand_command(*arguments)
        assert outcome.code == code, outcome.err
        return outcome

    return call


# --- run


def recorded(here, *options, procedure="rest.toml"):
    """What `run` prints and the samples it leaves, of an ideal unit on a true table."""
    outcome = here("run", procedure, "--rate", 20, "--out", "run", "--force", "--json", *options)
    return outcome.json, read_imu(Path("run/run.mcap"))


IDEAL = ("--imu", "ideal", "--true-table")


def test_run_at_a_latitude_and_a_height(here):
    """Earth rate's vertical part by hand, W sin 30; gravity less by 3.086e-6 per metre."""
    _, low = recorded(here, *IDEAL, "--latitude", 30)
    told, high = recorded(here, *IDEAL, "--latitude", 30, "--height", 1000)
    assert (told["latitude_deg"], told["height_m"]) == pytest.approx((30.0, 1000.0), rel=1e-12)
    np.testing.assert_allclose(high.w_ib_b[:, 1], 7.292115e-5 / 2, rtol=1e-9)
    # free air gradient to a part in 300 over the Earth, and its second order of 1e-4
    fallen = low.f_b[:, 1].mean() - high.f_b[:, 1].mean()
    assert fallen == pytest.approx(3.086e-3, rel=5e-3)


def test_run_with_terms_off(here):
    """Without white noise a low-grade unit at rest repeats itself to its steps."""
    off = "white-noise,bias-instability,random-walk,ramp,quantisation"
    told, still = recorded(here, "--imu", "stim300", "--without", off)
    _, noisy = recorded(here, "--imu", "stim300")
    assert told["without"] == sorted(told["without"], key=told["without"].index)
    assert set(told["without"]) == set(off.split(","))
    assert np.ptp(still.w_ib_b, axis=0).max() < 1e-15
    assert np.ptp(noisy.w_ib_b, axis=0).min() > 1e-6


def test_run_on_a_true_table(here):
    """An ideal unit reads level on it, and not on one whose class may lean."""
    true, level = recorded(here, *IDEAL, "--table", "mid-class")
    drawn, leaning = recorded(here, "--imu", "ideal", "--table", "mid-class")
    assert (true["true_table"], drawn["true_table"]) == (True, False)
    assert np.abs(level.f_b[:, [0, 2]]).max() < 1e-12
    assert np.abs(leaning.f_b[:, [0, 2]]).max() > 1e-6 * ACCEL


def test_run_by_servos(here):
    """The joints then are simulated: not on the plan to the last bit, but close to it."""
    planned, _ = recorded(here, *IDEAL, procedure="moved.toml")
    told, _ = recorded(here, *IDEAL, "--motion", "servo", procedure="moved.toml")
    assert (planned["motion"], told["motion"]) == ("ideal", "servo")
    assert [s["label"] for s in told["steps"]] == ["up", "round", "X1 up"]
    assert planned["steps"] == []
    joints = read_joints(Path("run/run.mcap"))
    outer = np.degrees(joints.angles[-1, joints.names.index("outer")])
    assert outer == pytest.approx(10, abs=0.01)
    assert outer != 10.0


ORDERS = {
    "regular": ["yaw-pitch-roll", "yaw-roll-pitch"],
    "published": ["yaw-roll-pitch", "yaw-pitch-roll"],
}


def test_run_by_another_order_of_turns(here):
    """Y1 up, then X1 up: 'regular' is never singular; the published is the other way round."""
    steep = SHORT_MOVE.replace("joints_deg = { outer = 10 }", "attitude_deg = { pitch = 90 }")
    Path("steep.toml").write_text(REST + steep, encoding="utf-8")
    found = {}
    for rule in ("regular", "published"):
        told, _ = recorded(here, *IDEAL, "--sequences", rule, procedure="steep.toml")
        found[rule] = [e["sequence"] for e in told["estimates"]]
        aligned = {
            own: [e["sequence"] for e in here("align", "run", *said, "--json").json["estimates"]]
            for own, said in (("", ()), *((name, ("--sequences", name)) for name in ORDERS))
        }
        assert aligned[""] == found[rule]  # as it was recorded
        assert aligned == {"": found[rule], **ORDERS}
    assert found == ORDERS


def test_run_draws_by_its_seed(here):
    first, again, other = (
        recorded(here, "--imu", "stim300", "--seed", seed)[1].w_ib_b for seed in (4, 4, 5)
    )
    np.testing.assert_array_equal(first, again)
    assert np.abs(first - other).min(axis=0).max() > 0


# --- align


def test_align_at_a_height(here):
    """A level log at 30 deg: tilt is known to a bias over gravity, which falls with height."""
    W, lat = 7.292115e-5, radians(30)
    n = 200
    w = np.tile([W * cos(lat), W * sin(lat), 0.0], (n, 1))
    f = np.tile([0.0, 9.7932, 0.0], (n, 1))
    t_ns = np.arange(1, n + 1) * 100_000_000
    write_imu_log(Path("log.mcap"), t_ns=t_ns, w_ib_b=w, f_b=f, metadata={})
    said = ("--method", "inertial", "--imu", "stim300", "--latitude", 30, "--json")
    low, high = (
        here("align", "log.mcap", *said, "--height", h).json["estimates"][0]["sigma_pitch_deg"]
        for h in (0, 10_000)
    )
    # the accelerometer's bias over g; free air, to its second order
    assert high / low == pytest.approx(1 / (1 - 10_000 * 3.086e-6 / 9.7932), rel=2e-5)


def test_align_in_windows(here):
    """Three windows of 1 s and two of 1.5 s of a rest of 3 s; what hides in noise is null."""
    recorded(here, "--imu", "stim300")
    rows = here("align", "run", "--windows", "1,1.5", "--json").json["windows"]
    assert {(row["seconds"], row["windows"]) for row in rows} == {(1.0, 3), (1.5, 2)}
    pitch = next(row for row in rows if row["quantity"] == "pitch")
    assert pitch["scatter_low_deg"] < pitch["scatter_deg"] < pitch["scatter_high_deg"]
    assert rows[0]["scatter_deg"] is None
    here("align", "run", "--windows", "1,0", code=2)
    here("align", "run", "--windows", "1,x", code=2)
    here("align", "run", "--windows", "10", code=2)


def test_allan_of_a_topic(here):
    recorded(here, "--imu", "stim300")
    told = here("allan", "run", "--topic", "/imu/dat", code=2).err
    assert "unknown sensor_msgs/msg/Imu topic '/imu/dat': did you mean /imu/data" in told


def test_allan_of_a_part(here):
    """Of a minute at 20 Hz, which begins with the first stamp: samples that begin from 10 s on, and
    those that end by 40 s."""
    n = 1200
    w = 1e-5 * np.random.default_rng(1).standard_normal((n, 3))
    f = np.array([0.0, 9.81, 0.0]) + 1e-3 * np.random.default_rng(2).standard_normal((n, 3))
    w[:200] *= 3
    w[800:] *= 5
    t_ns = np.arange(1, n + 1) * 50_000_000
    write_imu_log(Path("log.mcap"), t_ns=t_ns, w_ib_b=w, f_b=f, metadata={})

    def shown(*said):
        told = here("allan", "log.mcap", *said, "--json").json
        curve = next(c for c in told["curves"] if (c["sensor"], c["axis"]) == ("gyro", "x"))
        return next(v for k, v in curve.items() if k.startswith("deviation"))[0]

    late, early = shown("--from", 10), shown("--to", 40)
    # of one sample apart the Allan variance is the mean of half the squared steps
    per_hour = np.degrees(1) * 3600 / np.sqrt(2)
    for found, rows in ((late, w[201:]), (early, w[:801])):
        by_hand = np.sqrt(np.mean(np.diff(rows[:, 0]) ** 2)) * per_hour
        assert found == pytest.approx(by_hand, rel=1e-6)


# --- what a command hands on


class Said(Exception):
    """What a command made of its options."""


def handed(here, monkeypatch, target, *arguments):
    """What the function at `target` is given by a command."""

    def stop(*given, **named):
        raise Said((given, named))

    monkeypatch.setattr(target, stop)
    with pytest.raises(Said) as caught:
        here(*arguments)
    return caught.value.args[0]


def test_a_proposal_is_for_what_was_said(here, monkeypatch):
    said = ("--heading", 1.5, "--imu", "hg9900", "--rate", 20, "--latitude", 40, "--height", 300)
    said += ("--table", "laboratory", "--max-time", 900)
    (requirement,), given = handed(here, monkeypatch, "stand.propose", "propose", *said)
    assert requirement is None
    del given["progress"]
    assert given == {
        "imu": "hg9900", "table": "laboratory", "heading_deg": 1.5, "max_time_s": 900,
        "latitude_deg": 40, "height_m": 300, "rate_hz": 20,
    }  # fmt: skip


CALIBRATED = {
    "hand_held": False, "imu": None, "table": None, "trust_table": False, "free": [],
    "gravity_m_s2": None, "gravity_sigma_m_s2": None, "latitude_deg": None, "height_m": None,
    "shortest_s": 1.0, "as_published": False, "axes": "", "serial": "",
}  # fmt: skip


@pytest.mark.parametrize(
    ("said", "field", "value"),
    [
        (("--hand-held",), "hand_held", True),
        (("--imu", "hg9900"), "imu", "hg9900"),
        (("--table", "precision"), "table", "precision"),
        (("--trust-table",), "trust_table", True),
        (("--free", "k2, k3"), "free", ["k2", "k3"]),
        (("--gravity", 9.8), "gravity_m_s2", 9.8),
        (("--gravity-sigma", 1e-5), "gravity_sigma_m_s2", 1e-5),
        (("--latitude", 40), "latitude_deg", 40),
        (("--height", 300), "height_m", 300),
        (("--shortest", 2), "shortest_s", 2),
        (("--hand-held", "--as-published"), "as_published", True),
        (("--axes", "x,-z,y"), "axes", "x,-z,y"),
        (("--serial", "S7"), "serial", "S7"),
    ],
)
def test_a_calibration_is_asked_for_what_was_said(here, monkeypatch, said, field, value):
    def read(path, **given):
        assert path == Path("log.csv")
        assert (given["form"].axes or "") == (value if field == "axes" else "")

    monkeypatch.setattr("stand.api.read", read)
    _, given = handed(here, monkeypatch, "stand.api.calibrate", "calibrate", "log.csv", *said)
    also = {"hand_held": True} if "--hand-held" in said else {}
    assert given == CALIBRATED | also | {field: value}


def test_a_log_is_read_as_was_said(here, monkeypatch):
    said = ("--from", 1, "--to", 2, "--topic", "/a", "--turn-joint", "j")
    said += ("--turn-axis", "0,0.6,0.8")
    said += ("--start-attitude", "1,2,3", "--start-sigma", 4, "--fix-sigma", "5,6")
    said += ("--stretches", "s.toml", "--method", "vectors")
    (path,), given = handed(here, monkeypatch, "stand.api.read", "align", "log.csv", *said)
    del given["form"], given["progress"]
    assert path == Path("log.csv")
    assert {k: v if isinstance(v, bool) else str(v) for k, v in given.items()} == {
        "topic": "/a", "t_from_s": "1.0", "t_to_s": "2.0", "turn_joint": "j",
        "turn_axis": "(0.0, 0.6, 0.8)", "moving": True, "start_attitude_deg": "(1.0, 2.0, 3.0)",
        "start_sigma_deg": "4.0", "fix_sigma": "(5.0, 6.0)", "stretches": "s.toml",
    }  # fmt: skip
    said = ("--topic", "/a", "--stretches", "s.toml")
    _, given = handed(here, monkeypatch, "stand.api.read", "calibrate", "log.csv", *said)
    assert (given["topic"], str(given["stretches"])) == ("/a", "s.toml")


def test_a_drive_is_made_as_was_said(here, monkeypatch):
    said = ("--imu", "hg9900", "--rate", 50, "--seed", 7, "--out", "d", "--force")
    names, given = handed(here, monkeypatch, "stand.drive", "drive", "weaving", *said)
    del given["progress"]
    assert names == ("weaving", "hg9900")
    assert given == {"rate_hz": 50, "seed": 7, "out": Path("d"), "force": True}


def test_a_picture_is_drawn_as_was_said(here, monkeypatch):
    recorded(here, *IDEAL)
    said = ("--camera", "side", "--method", "triad", "--size", "320x180", "--joints", "a=outer")
    (log, at, out), given = handed(
        here, monkeypatch, "stand.report.film.write_picture",
        "picture", "run", "--at", 1.5, "--out", "x.png", "--force", *said,
    )  # fmt: skip
    assert (len(log.dwells), at, out) == (1, 1.5, Path("x.png"))
    assert given == {
        "camera": "side", "size": (320, 180), "method": "triad", "joints": "a=outer",
        "force": True,
    }  # fmt: skip


def test_a_film_is_drawn_as_was_said(here, monkeypatch):
    recorded(here, *IDEAL)
    said = ("--camera", "side", "--method", "triad", "--size", "320x180", "--joints", "a=outer")
    said += ("--from", 1, "--to", 2, "--speed", 4, "--force")
    (_, out), given = handed(
        here, monkeypatch, "stand.report.film.write_film",
        "film", "run", "--out", "x.mp4", *said,
    )  # fmt: skip
    del given["progress"]
    assert out == Path("x.mp4")
    assert given == {
        "t_from": 1, "t_to": 2, "speed": 4, "camera": "side", "size": (320, 180),
        "method": "triad", "joints": "a=outer", "force": True,
    }  # fmt: skip


def test_an_allan_analysis_is_of_what_was_said(here, monkeypatch):
    said = ("--imu", "hg9900", "--terms", "N, K", "--topic", "/a", "--from", 1, "--to", 2)
    _, given = handed(here, monkeypatch, "stand.api.allan", "allan", "log.csv", *said)
    del given["form"], given["progress"]
    assert list(given.pop("terms")) == ["N", "K"]
    assert given == {"imu": "hg9900", "topic": "/a", "t_from_s": 1, "t_to_s": 2}


def test_runs_are_compared_as_was_said(here, monkeypatch):
    said = ("--runs", 7, "--keep", "k", "--scheduler", "local", "--rate", 50, "--seed", 5)
    said += ("--without", "white-noise,range", "--true-table", "--methods", "triad,rk4")
    (made, runs), given = handed(here, monkeypatch, "stand.compare", "compare", "rest.toml", *said)
    del given["progress"]
    assert (runs, given) == (7, {"keep": Path("k"), "scheduler": "local"})
    assert (made.rate_hz, made.seed, made.true_table) == (50, 5, True)
    assert (set(made.without), made.methods) == ({"white-noise", "range"}, ("triad", "rk4"))


def test_a_campaign_is_made_as_was_said(here, monkeypatch):
    said = ("--out", "c", "--resume", "--workers", 3, "--scheduler", "local")
    names, given = handed(here, monkeypatch, "stand.campaign", "campaign", "sweep.toml", *said)
    assert names == ("sweep.toml", Path("c"))
    assert given == {"resume": True, "workers": 3, "scheduler": "local"}


def test_a_rehearsal_s_runs_are_made_as_was_said(here, monkeypatch):
    said = ("--verify", 7, "--keep", "k", "--scheduler", "local", "--propose", "--seed", 5)
    said += ("--motion", "servo", "--revision", "C", "--terms", "N,B", "--rate", 50)
    (made,), given = handed(here, monkeypatch, "stand.rehearse", "rehearse", "rest.toml", *said)
    del given["progress"]
    assert given == {"verify": 7, "keep": Path("k"), "scheduler": "local", "propose": True}
    assert (made.seed, made.motion.value, made.revision, made.rate_hz) == (5, "servo", "C", 50)
    assert tuple(made.allan_terms) == ("N", "B")


# --- compare, export


def test_compare_by_servos_at_a_height_from_a_seed(here):
    said = ("--runs", 2, "--rate", 20, "--methods", "triad", "--json")
    plain = here("compare", "rest.toml", *said).json
    servo = here("compare", "rest.toml", *said, "--motion", "servo").json
    assert (plain["motion"], servo["motion"]) == ("ideal", "servo")
    other = here("compare", "rest.toml", *said, "--seed", 7).json
    assert (plain["seed"], other["seed"]) == (0, 7)
    assert plain["methods"][0]["rms_tilt_deg"] != other["methods"][0]["rms_tilt_deg"]
    # white noise over g: g falls by 3.086e-6 per metre
    high = here("compare", "rest.toml", *said, "--height", 5000).json["methods"][0]
    ratio = high["floor_tilt_deg"] / plain["methods"][0]["floor_tilt_deg"]
    assert ratio == pytest.approx(1 + 5000 * 3.086e-6 / 9.80936, rel=1e-5)
    assert "latitude_deg" in plain
    north = here("compare", "rest.toml", *said, "--latitude", 60).json
    assert north["latitude_deg"] == pytest.approx(60)


def test_export_of_a_drawn_sway(here):
    """Same seed, same file; another seed, another sway; another table, another motion."""
    Path("sway.toml").write_text(
        REST.replace("duration_s = 3", "duration_s = 6") + SWAY, encoding="utf-8"
    )
    texts = []
    for seed in (1, 1, 2):
        here("export", "sway.toml", "--out", "x.csv", "--seed", seed, "--force")
        texts.append(Path("x.csv").read_bytes())
    assert texts[0] == texts[1] != texts[2]
    here("export", "sway.toml", "--out", "x.csv", code=2)
    for table in ("laboratory", "precision"):
        here("export", "moved.toml", "--out", f"{table}.csv", "--table", table)
    assert Path("laboratory.csv").read_bytes() != Path("precision.csv").read_bytes()


# --- import


def imported(here, *options):
    here("import", "log.bin", "--out", "x.mcap", "--force", *options)
    return read_imu(Path("x.mcap"))


def test_import_of_counts_after_a_header(here):
    """Ten bytes, then rows of t in ms, rates of 0.5 deg/h and forces of 2 mg a count."""
    rows = np.array([[0, 4, 0, 0, 0, 500, 0], [20, 0, 6, 0, 500, 0, 0], [40, 0, 0, 8, 0, 0, 500]])
    Path("log.bin").write_bytes(b"0123456789" + rows.astype("<i4").tobytes())
    log = imported(
        here, "--skip-bytes", 10, "--format", "<i4", "--columns", "t,gx,gy,gz,ax,ay,az",
        "--time-unit", "ms", "--gyro-unit", "deg/h", "--gyro-scale", 0.5,
        "--accel-unit", "mg", "--accel-scale", 2,
    )  # fmt: skip
    np.testing.assert_array_equal(np.diff(log.t_ns), 20_000_000)
    # 2, 3 and 4 deg/h; one g
    np.testing.assert_allclose(log.w_ib_b, np.diag([2, 3, 4]) * 4.84813681109536e-6, rtol=1e-12)
    order = np.eye(3)[[1, 0, 2]]
    np.testing.assert_allclose(log.f_b, order * ACCEL, rtol=1e-12)
    for wrong in (("--time-unit", "min"), ("--format", "txt"), ("--skip-bytes", -1)):
        here("import", "log.bin", "--out", "x.mcap", "--force", "--columns", "t,gx,gy,gz,ax,ay,az",
             "--gyro-unit", "deg/h", "--accel-unit", "mg", *wrong, code=2)  # fmt: skip


# --- logs of others: the options that align, allan and import share


FORM = {
    "--columns": ("columns", "t,gx,gy,gz,ax,ay,az"),
    "--gyro-unit": ("gyro_unit", "dps"),
    "--accel-unit": ("accel_unit", "mg"),
    "--gyro-scale": ("gyro_scale", 0.5),
    "--accel-scale": ("accel_scale", 2.0),
    "--time-unit": ("time_unit", "ms"),
    "--rate": ("rate_hz", 50.0),
    "--wrap": ("wrap", 65536.0),
    "--format": ("file_format", "<i4"),
    "--skip-bytes": ("skip_bytes", 10),
    "--axes": ("axes", "x,-z,y"),
    "--stamps": ("stamps", "log"),
    "--frame": ("frame", "imu_b"),
    "--sampling": ("sampling", "instant"),
}


TAKING = ("align", "allan", "apply", "calibrate", "import", "report", "stretches", "view")
TAKING += ("compare", "export")
BESIDE = {("compare", "--rate"): "--log-rate", ("export", "--format"): "--log-format"}
"""Where a command has an option of that name of its own."""


@pytest.mark.parametrize("command", TAKING)
def test_every_option_of_a_form_arrives_by_itself(here, monkeypatch, command):
    def stop(**given):
        raise Said(given)

    monkeypatch.setattr("stand.recording.log_form.LogForm", stop)
    files = {"apply": ("c.json", "log.csv"), "compare": ("log.csv",) * 2}.get(command, ("log.csv",))
    out = ("--out", "x.mcap") if command in ("apply", "import", "export") else ()
    with pytest.raises(Said) as caught:
        here(command, *files, *out)
    plain = caught.value.args[0]
    for option, (field, value) in FORM.items():
        with pytest.raises(Said) as caught:
            here(command, *files, *out, BESIDE.get((command, option), option), value)
        assert caught.value.args[0] == plain | {field: value}
        assert plain[field] != value
    assert set(plain) == {field for field, _ in FORM.values()}


def test_a_table_without_a_header_needs_no_import(here):
    """Its stretches, page and samples come from the table itself, in the units stated."""
    turn = np.degrees(7.292115e-5)
    rows = [[k / 10, 0, turn, 0, 0, 1000, 0] for k in range(1, 201)]
    Path("log.txt").write_text("\n".join(",".join(map(str, row)) for row in rows), "utf-8")
    said = ("--columns", "t,gx,gy,gz,ax,ay,az", "--gyro-unit", "dps", "--accel-unit", "mg")
    (rest,) = here("stretches", "log.txt", *said, "--json").json["stretches"]
    assert (rest["from_s"], rest["to_s"]) == pytest.approx((0, 20))  # the first sample's begin
    here("report", "log.txt", *said, "--latitude", 48.5, "--out", "page.html")
    assert "9.807" in Path("page.html").read_text(encoding="utf-8")  # m/s^2, of 1000 mg
    here("view", "log.txt", *said, "--out", "x.rrd")
    assert Path("x.rrd").stat().st_size > 1000
    here("export", "log.txt", *said, "--out", "x.csv")
    assert Path("x.csv").read_text("utf-8").splitlines()[1].split(",")[5] == "9.80665"
    Path("s.toml").write_text(
        '[site]\nlatitude_deg = 48.5\n[[stretch]]\nkind = "dwell"\nlabel = "a"\n'
        "from_s = 0\nto_s = 20\n",
        "utf-8",
    )
    pair = ("--stretches", "s.toml", "--methods", "triad", "--json")
    here("import", "log.txt", *said, "--out", "log.mcap")
    for a, b in (("log.txt", "log.mcap"), ("log.mcap", "log.txt")):  # the MCAP says it itself
        (found,) = here("compare", a, b, *said, *pair).json["stretches"]
        assert found["label"] == "a"
    here("compare", "rest.toml", *said, code=2)
    here("export", "rest.toml", *said, "--out", "y.csv", code=2)
    for command, out in (("report", "page.html"), ("view", "y.rrd")):
        here(command, "log.txt", *said, "--gyro-scale", 0, "--out", out, code=2)
    assert not Path("y.rrd").exists()


def test_axes_and_a_wrapping_counter(here):
    """X1 is the log's x, Y1 its -z, Z1 its y; a counter in ms begins anew after 100."""
    rows = [[t, 1, 2, 3, 4, 5, 6] for t in (10, 50, 90, 30)]
    text = "\n".join(",".join(map(str, row)) for row in rows)
    Path("log.bin").write_text(text + "\n", encoding="utf-8")
    said = ("--columns", "t,gx,gy,gz,ax,ay,az", "--gyro-unit", "rad/s", "--accel-unit", "m/s^2")
    log = imported(here, *said, "--time-unit", "ms", "--wrap", 100, "--axes", "x,-z,y")
    np.testing.assert_array_equal(np.diff(log.t_ns), 40_000_000)
    np.testing.assert_array_equal(log.w_ib_b, [[1, -3, 2]] * 4)
    np.testing.assert_array_equal(log.f_b, [[4, -6, 5]] * 4)
    for wrong in (("--axes", "x,y,-z"), ("--wrap", -1), ("--stamps", "soon")):
        here("import", "log.bin", "--out", "x.mcap", "--force", *said, *wrong, code=2)


def test_a_table_is_looked_over_for_machines_too(here):
    """Clean as shipped; an error of 1801 arc s, half a degree, is an error and exit code 1."""
    assert here("check-table", "precision", "--json").json["findings"] == []
    text = (TABLES / "precision.toml").read_text(encoding="utf-8")
    wrong = text.replace("base_tilt_arc_s = 1.0", "base_tilt_arc_s = 1801.0")
    Path("wrong.toml").write_text(wrong, encoding="utf-8")
    (found,) = here("check-table", "wrong.toml", "--json", code=1).json["findings"]
    assert (found["severity"], found["place"]) == ("error", "geometry, base_tilt_arc_s")


# --- stretches, topics and windows of a recording


def test_stretches_of_a_recording(here):
    recorded(here, *IDEAL, procedure="moved.toml")
    rests = here("stretches", "run", "--shortest", 1, "--json").json["stretches"]
    assert [row["kind"] for row in rests] == ["dwell", "dwell"]
    assert here("stretches", "run", "--shortest", 100, "--json").json["stretches"] == []
    here("stretches", "run", "--shortest", 1, "--out", "s.toml")
    here("stretches", "run", "--shortest", 1, "--out", "s.toml", code=2)
    here("stretches", "run", "--shortest", 1, "--out", "s.toml", "--force")
    text = Path("s.toml").read_text(encoding="utf-8").replace("dwell 1", "mine")
    Path("s.toml").write_text(text, encoding="utf-8")
    found = here("align", "run", "--stretches", "s.toml", "--method", "triad", "--json").json
    assert {e["label"] for e in found["estimates"]} >= {"mine", "dwell 2"}
    here("align", "run", "--stretches", "none.toml", code=2)
    # logs that bring none of their own: those of the file
    here("import", "run", "--out", "a.mcap", "--topic", "/imu/truth")
    pair = ("compare", "a.mcap", "a.mcap", "--methods", "triad", "--latitude", 48.5, "--json")
    told = here(*pair, "--stretches", "s.toml").json
    assert [row["label"] for row in told["stretches"]] == ["mine", "dwell 2"]


def test_a_page_of_a_log(here):
    """Of a log without a procedure: where it was, which topic, and what to estimate from."""
    recorded(here, *IDEAL, procedure="moved.toml")
    here("stretches", "run", "--shortest", 1, "--out", "s.toml")
    here("import", "run", "--out", "a.mcap")
    said = ("report", "a.mcap", "--out", "a.html", "--force")
    here(*said, "--latitude", 48.5)
    plain = Path("a.html").read_text(encoding="utf-8")
    here(*said, "--latitude", 48.5, "--stretches", "s.toml", "--topic", "/imu/data")
    assert "dwell 2" in Path("a.html").read_text(encoding="utf-8")
    assert "dwell 2" not in plain
    wrongs = ("--latitude", 95), ("--topic", "/imu/dat"), ("--stretches", "none.toml")
    for wrong in (*wrongs, ("--imu", "nobody")):
        here(*said, *wrong, code=2)


def test_one_topic_of_several(here):
    """What perfect sensors read is the same in every sample of a rest, what a unit reads is not."""
    recorded(here, "--imu", "stim300")
    here("import", "run", "--out", "truth.mcap", "--topic", "/imu/truth")
    assert np.ptp(read_imu(Path("truth.mcap")).w_ib_b, axis=0).max() == 0
    here("export", "run", "--out", "x.csv", "--topic", "/imu/truth")
    here("export", "run", "--out", "y.csv")
    assert Path("x.csv").read_bytes() != Path("y.csv").read_bytes()
    here("stretches", "run", "--topic", "/imu/truth", "--json")
    here("view", "run", "--out", "v.rrd", "--from", 0.5, "--to", 1, "--topic", "/imu/truth")
    for command in ("import", "export", "stretches", "view"):
        file = () if command == "stretches" else ("--out", "none.x")
        told = here(command, "run", *file, "--topic", "/imu/dat", code=2).err
        assert "unknown sensor_msgs/msg/Imu topic '/imu/dat': did you mean /imu/data" in told


def test_a_stretch_to_look_at(here):
    """From 0.5 to 1 s at 20 Hz: samples at both ends and nine between."""
    recorded(here, "--imu", "stim300")
    told = here("view", "run", "--out", "v.rrd", "--from", 0.5, "--to", 1).out
    assert "0.500 to 1.000 s: 11 samples" in told
    here("view", "run", "--out", "v.rrd", "--from", 0.5, "--to", 1, code=2)
    here("view", "run", "--out", "v.rrd", "--from", 0.5, "--to", 1, "--force")
    here("view", "run", "--out", "w.rrd", "--from", 2, "--to", 1, code=2)


# --- every option


def commands():
    return typer.main.get_command(app).commands.items()


OPTIONS = [
    (name, option.opts[0])
    for name, command in commands()
    for option in command.params
    if option.opts[0].startswith("--")
]


@functools.cache
def passed() -> frozenset[tuple[str, str]]:
    """Commands and options that stand as words in one and the same test or its helpers."""
    found: set[tuple[str, str]] = set()
    names = {name for name, _ in OPTIONS}
    for path in TESTS.rglob("*.py"):
        for part in ast.parse(path.read_text(encoding="utf-8")).body:
            words = {
                word
                for node in ast.walk(part)
                if isinstance(node, ast.Constant) and isinstance(node.value, str)
                for word in node.value.replace("=", " ").split()
            }
            for name in names & words:
                found |= {(name, word) for word in words if word.startswith("--")}
    return frozenset(found)


# by a helper or a table of its file, whose command stands elsewhere
BY_A_HELPER = {("run", "--without")}
BY_A_HELPER |= {(c, BESIDE.get((c, option), option)) for c in TAKING for option in FORM}


@pytest.mark.parametrize(("command", "option"), OPTIONS)
def test_every_option_is_passed_by_a_test(command, option):
    assert (command, option) in passed() | BY_A_HELPER


def test_an_option_that_nobody_passes_would_be_found():
    assert ("export", "--" + "windows") not in passed()
