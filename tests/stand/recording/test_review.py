"""The review file: what went in comes out, nothing is lost that an eye would miss, it opens."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from rerun.blueprint.components import PlayState
from rerun.chunk import RrdReader
from scipy.spatial.transform import Rotation

from stand.errors import StandError
from stand.recording import viewer
from stand.recording.curves import AngleCurves, Phase
from stand.recording.review import ReviewWriter, writer
from stand.recording.review.estimates import exaggeration, relay
from stand.recording.review.style import KIND_COLORS, shaded
from stand.recording.thinning import Moved, Regrouped, Thinned, bin_length, min_max_bins
from stand.samples import ImuBlock, TruthBlock
from stand.table.joints import Body, Geom, Joint, StandModel

sys.path.insert(0, str(Path(__file__).parents[3] / "tools"))
from review_picture import NO_DRIVER, main, pictures

NO_TURN = (0.0, 0.0, 0.0, 1.0)
S = 1_000_000_000
PHASES = (
    Phase(0, 2 * S, "dwell", "X1 up"),
    Phase(2 * S, 3 * S, "move", "to Y1 up"),
    Phase(3 * S, 6 * S, "dwell", "Y1 up"),
)


def geom(kind: str, size: tuple[float, float, float], z: float = 0.0) -> Geom:
    return Geom("", kind, size, (0.0, 0.0, z), NO_TURN, (0.2, 0.4, 0.8, 1.0))


def body(name: str, parent: str, joint: Joint | None, *geoms: Geom, z: float = 0.0) -> Body:
    zero, one = (0.0, 0.0, 0.0), (1.0, 1.0, 1.0)
    return Body(name, parent, (0.0, 0.0, z), NO_TURN, joint, geoms, 1.0, zero, one, NO_TURN)


@pytest.fixture(scope="module")
def model() -> StandModel:
    floor = geom("plane", (0.0, 0.0, 0.1))
    return StandModel(
        bodies=(
            body("world", "world", None, floor, geom("box", (0.4, 0.4, 0.05))),
            body("pier", "world", None, geom("cylinder", (0.2, 0.1, 0.0)), z=0.2),
            body(
                "outer", "pier", Joint("outer", (0, 0, 1)), geom("capsule", (0.05, 0.3, 0)), z=0.2
            ),
            body("inner", "outer", Joint("inner", (0, 1, 0)), geom("sphere", (0.1, 0, 0)), z=0.3),
        ),
        imu_body="inner",
        imu_position=(0.0, 0.02, 0.1),
        imu_rotation=(0.5, 0.5, 0.5, 0.5),
        sha256="0" * 64,
    )


def samples(n: int, rate_hz: int) -> tuple[TruthBlock, ImuBlock]:
    """Two dwells with a move of the inner joint between, and noise on the IMU."""
    rng = np.random.default_rng(1)
    t_ns = np.arange(1, n + 1) * (S // rate_hz)
    s = np.clip(t_ns / S - 2.0, 0.0, 1.0)
    joints = np.zeros((n, 6))
    joints[:, 5] = np.pi / 2.0 * s**2 * (3.0 - 2.0 * s)
    w = np.tile([1e-5, 4e-5, -6e-5], (n, 1))
    f = Rotation.from_rotvec(joints[:, 5:] * [0.0, 1.0, 0.0]).inv().apply([0.0, 0.0, 9.81])
    truth = TruthBlock(t_ns, w, f, np.tile(NO_TURN, (n, 1)), joints, np.zeros((n, 6)))
    noise = rng.standard_normal((2, n, 3))
    return truth, ImuBlock(t_ns, w + 1e-4 * noise[0], f + 1e-2 * noise[1])


def pieces(n: int, length: int) -> list[slice]:
    return [slice(i, i + length) for i in range(0, n, length)]


def cut(block: TruthBlock | ImuBlock, rows: slice) -> dict[str, np.ndarray]:
    return {name: getattr(block, name)[rows] for name in block.__slots__}


def curves() -> list[AngleCurves]:
    """Two dwells of a method with sigmas and a drifting rival without."""
    found = []
    for phase in (PHASES[2], PHASES[0]):
        t_ns = np.linspace(phase.t_from_ns + S // 2, phase.t_to_ns, 40).astype(np.int64)
        s = (t_ns - phase.t_from_ns)[:, None] / S
        error = np.array([2e-5, 3e-4, -1e-5]) / np.sqrt(s)
        drift = np.array([1e-3, -2e-3, 3e-3]) * s
        for method, errors, sigma in (("six-position", error, 1.0), ("rk4", drift, 0.0)):
            sigmas = sigma * np.abs(errors)
            rows = (errors + np.array([0.1, 0.2, 0.3]), errors, sigmas, errors)
            found.append(AngleCurves(method, phase.label, t_ns, *rows))
    return found


def record(
    path: Path,
    model: StandModel,
    data: tuple[TruthBlock, ImuBlock],
    rate_hz: int,
    block: int = 250,
    phases: tuple[Phase, ...] = PHASES,
) -> Path:
    truth, imu = data
    n = len(truth)
    writer = ReviewWriter(
        path,
        model=model,
        run_id="run-7",
        title="Run 7",
        duration_s=n / rate_hz,
        rate_hz=rate_hz,
        phases=phases,
        w_ie_enu=[0.0, 4e-5, 6e-5],
        properties={"seed": 7, "mujoco": "4.0", "rate": 2.5},
    )
    with writer:
        for rows in pieces(n, block):
            writer.write(TruthBlock(**cut(truth, rows)), ImuBlock(**cut(imu, rows)))
        writer.event(S, "WARN", "near range")
        writer.angles(curves())
        writer.documents("# Report\n\nroll ±3σ ✓", "```toml\nseed = 7\n```")
    return path


@pytest.fixture(scope="module")
def run(model: StandModel) -> tuple[TruthBlock, ImuBlock]:
    return samples(1200, 200)


@pytest.fixture(scope="module")
def rrd(
    model: StandModel, run: tuple[TruthBlock, ImuBlock], tmp_path_factory: pytest.TempPathFactory
) -> Path:
    return record(tmp_path_factory.mktemp("review") / "run.rrd", model, run, 200)


def table(path: Path, entity: str, component: str) -> tuple[np.ndarray, list]:
    """Times [ns] and values of one component of one entity, in order of time."""
    times, values = [], []
    for chunk in RrdReader(path).stream():
        batch = chunk.to_record_batch()
        if chunk.entity_path == entity and component in batch.schema.names:
            values += batch.column(component).to_pylist()
            if not chunk.is_static:
                times.append(batch.column("sim_time").to_numpy().astype(np.int64))
    return (np.concatenate(times) if times else np.empty(0, dtype=np.int64)), values


def scalars(path: Path, entity: str) -> tuple[np.ndarray, np.ndarray]:
    t_ns, values = table(path, entity, "Scalars:scalars")
    return t_ns, np.array(values)


def blueprint_values(path: Path, component: str) -> list:
    """All values of a component in both blueprints: the first sent, and the one that replaces it.

    The reader lists them in no particular order.
    """
    values = []
    reader = RrdReader(path)
    for store in reader.blueprints():
        for chunk in reader.stream(store=store):
            batch = chunk.to_record_batch()
            if component in batch.schema.names:
                values += batch.column(component).to_pylist()
    return values


def test_samples_come_back_with_their_times_and_units(rrd, run):
    truth, imu = run
    expected = {
        "/stand/table": np.rad2deg(truth.joints[:, 3:]),
        "/stand/base": np.rad2deg(truth.joints[:, :3]),
        "/imu/accel": imu.f_b,
        "/imu/gyro": np.rad2deg(imu.w_ib_b),
        "/residual/accel": (imu.f_b - truth.f_b) / 9.80665e-3,
        "/residual/gyro": np.rad2deg(imu.w_ib_b - truth.w_ib_b) * 3600.0,
    }
    for entity, values in expected.items():
        t_ns, rows = scalars(rrd, entity)
        np.testing.assert_array_equal(t_ns, truth.t_ns)
        # Doubles all the way; the order of two factors may cost the last bits.
        np.testing.assert_allclose(rows, values, rtol=1e-14, atol=1e-12)


def test_one_milli_g_and_one_degree_per_hour_by_hand(model, tmp_path):
    t_ns = np.array([S, 2 * S])
    still, zero = np.tile(NO_TURN, (2, 1)), np.zeros((2, 6))
    truth = TruthBlock(t_ns, np.zeros((2, 3)), np.zeros((2, 3)), still, zero, zero)
    # 1 deg/h is 4.848137e-6 rad/s, 1 mg is 9.80665e-3 m/s^2.
    imu = ImuBlock(
        t_ns, [[4.848137e-6, 0, 0], [0, 9.696274e-6, 0]], [[0, 0, 9.80665e-3], [0, 0, 0]]
    )
    path = record(tmp_path / "units.rrd", model, (truth, imu), 1)
    np.testing.assert_allclose(
        scalars(path, "/residual/gyro")[1], [[1, 0, 0], [0, 2, 0]], rtol=1e-6
    )
    np.testing.assert_allclose(scalars(path, "/residual/accel")[1], [[0, 0, 1], [0, 0, 0]])


def test_poses_only_where_the_stand_moves(rrd, run):
    truth, _ = run
    t_ns, turns = table(rrd, "/world/pier/outer/inner", "Transform3D:quaternion")
    moving = t_ns[1:]
    assert t_ns[0] == truth.t_ns[0]
    assert moving.min() >= 2 * S
    assert moving.max() <= 3 * S + S // 50  # the first pose of the dwell, at most a tick late
    assert np.diff(moving).min() == S // 50
    last = np.array(turns[-1][0])
    # 90 degrees about y; quaternions are stored as float32.
    np.testing.assert_allclose(last, [0.0, np.sqrt(0.5), 0.0, np.sqrt(0.5)], atol=1e-6)
    assert len(table(rrd, "/world/pier/outer", "Transform3D:quaternion")[0]) == 1


def test_force_arrow_follows_the_force(rrd):
    _, vectors = table(rrd, "/world/pier/outer/inner/imu/f", "Arrows3D:vectors")
    first, last = np.array(vectors[0][0]), np.array(vectors[-1][0])
    np.testing.assert_allclose(first / np.linalg.norm(first), [0, 0, 1], atol=1e-6)
    np.testing.assert_allclose(last / np.linalg.norm(last), [-1, 0, 0], atol=1e-4)


def test_errors_and_sigmas_break_between_dwells(rrd):
    t_ns, rows = scalars(rrd, "/angles/yaw/0_six-position")
    first, second = curves()[2], curves()[0]  # the dwells are handed over in reverse
    np.testing.assert_array_equal(t_ns[:40], first.t_ns)
    np.testing.assert_array_equal(t_ns[41:81], second.t_ns)
    np.testing.assert_allclose(rows[41:81, 0], np.rad2deg(second.errors[:, 1]))
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(rows[:, 0])), [40, 81])
    _, sigma = scalars(rrd, "/angles/yaw/sigma")
    np.testing.assert_allclose(sigma[:40, 0], 3.0 * np.rad2deg(first.sigmas[:, 1]))
    np.testing.assert_array_equal(sigma[:40, 0], -sigma[:40, 1])
    assert len(scalars(rrd, "/angles/yaw/1_rk4")[0]) == 82


def test_estimated_axes_are_turned_by_the_exaggerated_error(rrd):
    t_ns, vectors = table(rrd, "/world/pier/outer/inner/imu/estimate", "Arrows3D:vectors")
    first = curves()[2]
    axes = np.array(vectors[int(np.argmin(t_ns))])
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    turned = Rotation.from_rotvec(1000.0 * first.error_rotations[0]).as_matrix()
    # The rows are the turned axes, so the columns of the matrix; 32-bit floats.
    np.testing.assert_allclose(axes, turned.T, atol=1e-6)
    assert [rows for rows in vectors if not rows] == [[], []]  # hidden after each dwell


@pytest.mark.parametrize(
    ("error", "factor"), [(1e-4, 1e3), (3e-3, 1e2), (0.1, 1.0), (2.0, 1.0), (0.0, 1e6)]
)
def test_exaggeration_is_a_power_of_ten_that_shows_degrees(error, factor):
    rows = np.array([[0.5, 0.0, 0.0], [0.0, error, 0.0], [0.0, 0.0, error]])
    curve = AngleCurves("m", "d", [1, 2, 3], rows, rows, rows, rows)
    assert exaggeration([curve]) == factor


def test_a_method_is_followed_by_the_one_that_takes_over_and_never_by_its_rival():
    def curve(method, *t_ns):
        rows = np.zeros((len(t_ns), 3))
        return AngleCurves(method, "d", t_ns, rows, rows, rows, rows)

    first = [curve("a", 20, 24), curve("a", 0, 4)]
    after = [curve("b", 4, 9), curve("b", 24, 29)]
    rival = [curve("rk4", 1, 9), curve("rk4", 21, 29), curve("rk4", 40, 44)]
    found = relay(first + after + rival)
    found = [(c.method, int(c.t_ns[0])) for c in found]
    assert found == [("a", 0), ("b", 4), ("a", 20), ("b", 24), ("rk4", 40)]


def test_phases_events_and_texts(rrd):
    t_ns, states = table(rrd, "/phase", "StateChange:state")
    assert t_ns.tolist() == [0, 2 * S, 3 * S, 6 * S]
    assert states == [["dwell X1 up"], ["move to Y1 up"], ["dwell Y1 up"], [""]]
    assert table(rrd, "/phase", "StateConfiguration:labels")[1] == [["X1 up", "to Y1 up", "Y1 up"]]
    assert ["near range"] in table(rrd, "/events", "TextLog:text")[1]
    assert "±3σ" in table(rrd, "/report", "TextDocument:text")[1][0][0]
    assert table(rrd, "/__properties/run", "seed")[1] == [["7"]]


def following(n: int) -> np.ndarray:
    """Six columns, told apart by their size; one spike of an arc minute."""
    lag = np.outer(np.sin(np.arange(n)), np.arange(1.0, 7.0)) * np.pi / 180 / 3600
    lag[n // 3, 4] = np.pi / 180 / 60
    return lag


def servo_review(path: Path, model: StandModel, n: int, rate_hz: int) -> Path:
    truth, imu = samples(n, rate_hz)
    lag = following(n)
    options = {"run_id": "s", "title": "S", "phases": PHASES, "properties": {}}
    with ReviewWriter(
        path,
        model=model,
        duration_s=n / rate_hz,
        rate_hz=rate_hz,
        w_ie_enu=[0.0, 4e-5, 6e-5],
        following=True,
        **options,
    ) as writer:
        for rows in pieces(n, 250):
            block, reported = TruthBlock(**cut(truth, rows)), ImuBlock(**cut(imu, rows))
            writer.write(block, reported, lag[rows])
        with pytest.raises(ValueError, match="following: must be given if and only if"):
            writer.write(block, reported)
    return path


def test_following_error_of_a_servo_run(model, rrd, tmp_path):
    path = servo_review(tmp_path / "servo.rrd", model, 600, 200)
    _, rows = scalars(path, "/stand/following")
    # 206264.806 arc seconds are a radian; the order of two factors may cost the last bits
    np.testing.assert_allclose(rows, following(600) * 206264.80624709636, rtol=1e-13)
    names = [name for (name,) in blueprint_values(path, "ViewBlueprint:display_name")]
    assert "Following error [arc s], -6 to 60" in names
    assert "Following error [arc s]" not in str(blueprint_values(rrd, "ViewBlueprint:display_name"))
    (styles,) = table(path, "/stand/following", "SeriesLines:names")[1]
    assert styles == ["base_roll", "base_pitch", "base_yaw", "outer", "middle", "inner"]


def test_a_spike_of_following_error_survives_thinning(model, tmp_path, monkeypatch):
    monkeypatch.setattr(writer, "ROW_BUDGET", 300)
    path = servo_review(tmp_path / "long.rrd", model, 5003, 1000)
    t_ns, rows = scalars(path, "/stand/following")
    assert len(t_ns) <= 302
    assert rows[:, 4].max() == pytest.approx(60.0, rel=1e-12)
    assert rows[:, 3].max() == pytest.approx(4.0, rel=1e-5)  # the sine's own peak


def lab(colors: np.ndarray) -> np.ndarray:
    """CIE L*a*b* (n, 3) of sRGB colours (n, 3; 0 to 255), white D65."""
    linear = colors / 255.0
    linear = np.where(linear <= 0.04045, linear / 12.92, ((linear + 0.055) / 1.055) ** 2.4)
    to_xyz = [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]
    t = linear @ np.transpose(to_xyz) / [0.9505, 1.0, 1.089]
    f = np.where(t > (6 / 29) ** 3, np.cbrt(t), t / (3 * (6 / 29) ** 2) + 4 / 29)
    return np.stack(
        [116 * f[:, 1] - 16, 500 * (f[:, 0] - f[:, 1]), 200 * (f[:, 1] - f[:, 2])], axis=1
    )


# Machado, Oliveira and Fernandes 2009, severity 1.0, applied to linear RGB there; to sRGB values
# directly, as many simulators do, which is enough for a comparison.
VISION = {
    "usual": np.eye(3),
    "protan": [[0.152, 1.053, -0.205], [0.115, 0.786, 0.099], [-0.004, -0.048, 1.052]],
    "deutan": [[0.367, 0.861, -0.228], [0.280, 0.673, 0.047], [-0.012, 0.043, 0.969]],
}


@pytest.mark.parametrize("vision", VISION)
def test_colours_of_the_kinds_are_told_apart(vision):
    """A difference of 10 in L*a*b* is seen at once; 2 is just noticeable."""
    colors = np.array(list(KIND_COLORS.values()), float)
    seen = lab(np.clip(colors @ np.transpose(VISION[vision]), 0.0, 255.0))
    apart = np.linalg.norm(seen[:, None] - seen[None, :], axis=2)
    assert apart[~np.eye(len(colors), dtype=bool)].min() > 10.0


def test_every_kind_of_step_has_a_colour():
    from typing import get_args

    from stand.procedure.steps import Step

    union, *_ = get_args(Step)
    kinds = {get_args(entry.model_fields["kind"].annotation)[0] for entry in get_args(union)}
    assert set(KIND_COLORS) == kinds


def test_neighbours_of_one_kind_are_told_apart():
    dwell, rate = KIND_COLORS["dwell"], KIND_COLORS["rate"]
    dark = (13, 89, 38)  # three quarters of (17, 119, 51)
    kinds = ["dwell", "rate", "rate", "rate", "dwell"]
    assert shaded(kinds) == [dwell, rate, dark, rate, dwell]


def test_layout_is_paused_and_names_method_factor_and_range(rrd):
    paused = [[PlayState.Paused.value]]
    assert blueprint_values(rrd, "TimePanelBlueprint:play_state") == 2 * paused
    names = [name for (name,) in blueprint_values(rrd, "ViewBlueprint:display_name")]
    assert "Stand, true axes; pale: six-position, error x1,000" in names
    assert any(name.startswith("Yaw error, ±3σ [deg], ") for name in names)
    assert "Table angles [deg], 0 to 90" in names


def writer_to(path: Path, model: StandModel) -> ReviewWriter:
    return ReviewWriter(
        path,
        model=model,
        run_id="cut",
        title="Cut",
        duration_s=6.0,
        rate_hz=200,
        phases=PHASES,
        w_ie_enu=[0.0, 4e-5, 6e-5],
        properties={},
    )


def test_a_file_is_whole_or_empty(model, tmp_path):
    """A run that ends early leaves no half of a review that a viewer would take for a whole one."""
    path = tmp_path / "cut.rrd"
    with pytest.raises(KeyError), writer_to(path, model):
        raise KeyError
    assert path.read_bytes() == b""
    writer = writer_to(path, model)
    assert path.read_bytes() == b""
    writer.close()
    writer.close()
    writer.abandon()
    data = path.read_bytes()
    assert b"Table angles" in data
    assert data.endswith(b"RRF2FOOT\x01\0\0\0")


@pytest.mark.parametrize(
    ("spoilt", "said"),
    [
        (lambda data: data[: len(data) // 2], "bytes are there, must be"),
        (lambda data: data[:-12] + bytes(12), "no footer"),
        (lambda data: data[:40] + bytes(400) + data[440:], ""),
    ],
)
def test_a_file_that_is_not_there_as_written_is_told(
    model, run, tmp_path, monkeypatch, spoilt, said
):
    """A disk that takes bytes and has not got them: the file is read back before it counts."""
    write = Path.write_bytes
    monkeypatch.setattr(Path, "write_bytes", lambda path, data: write(path, spoilt(data)))
    with pytest.raises(StandError, match=rf"a\.rrd: cannot be written: .*{said}") as caught:
        record(tmp_path / "a.rrd", model, run, 200)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("block", [200, 1000])
def test_nothing_depends_on_the_block(model, run, rrd, tmp_path, block, monkeypatch):
    monkeypatch.setattr(writer, "ROW_BUDGET", 500)
    one = record(tmp_path / "one.rrd", model, run, 200, block=333)
    two = record(tmp_path / "two.rrd", model, run, 200, block=block)
    # Drawing the layout anew gives its views new random names: compare the data alone.
    for entity in ("/imu/gyro", "/residual/accel", "/stand/table"):
        for left, right in zip(scalars(one, entity), scalars(two, entity), strict=True):
            np.testing.assert_array_equal(left, right)
    for entity, component in (("", "Transform3D:quaternion"), ("/imu/w", "Arrows3D:vectors")):
        place = f"/world/pier/outer/inner{entity}"
        left, right = table(one, place, component), table(two, place, component)
        np.testing.assert_array_equal(left[0], right[0])
        assert left[1] == right[1]


def test_long_runs_keep_every_spike(model, tmp_path, monkeypatch):
    monkeypatch.setattr(writer, "ROW_BUDGET", 300)
    truth, imu = samples(5003, 1000)
    f_b = imu.f_b.copy()
    f_b[1234, 0], f_b[5001, 2] = 1e3, -2e3  # one in the midst, one in the short last bin
    path = record(tmp_path / "long.rrd", model, (truth, ImuBlock(imu.t_ns, imu.w_ib_b, f_b)), 1000)
    t_ns, rows = scalars(path, "/imu/accel")
    assert len(t_ns) <= 302
    assert np.all(np.diff(t_ns) >= 0)
    np.testing.assert_array_equal(rows.max(axis=0), f_b.max(axis=0))
    np.testing.assert_array_equal(rows.min(axis=0), f_b.min(axis=0))
    at = t_ns[np.argmax(rows[:, 0])]
    assert abs(at - truth.t_ns[1234]) <= 34 * S // 1000  # the length of a bin


def test_bins_keep_the_order_of_extremes():
    t_ns = np.arange(7) * 10
    up_down = np.array([[0, 5], [1, 9], [7, -3], [2, 0], [4, 4], [3, 3], [2, 8]], dtype=float)
    times, rows = min_max_bins(t_ns, up_down, 4)
    assert times.tolist() == [0, 30, 40, 60]
    assert rows.tolist() == [[0, 9], [7, -3], [4, 3], [2, 8]]


@pytest.mark.parametrize(("n", "m"), [(99, 1), (100, 1), (101, 3), (151, 4), (5000, 100)])
def test_bin_length_keeps_the_budget(n, m):
    assert bin_length(n, 100) == m
    rows = n if m == 1 else 2 * -(-n // m)
    assert rows <= 100 + 2


def test_thinning_in_blocks_equals_thinning_at_once():
    rng = np.random.default_rng(3)
    t_ns, values = np.arange(1000), rng.standard_normal((1000, 2))
    stream = Thinned(2, 7, 64)
    got = [
        (t.copy(), v.copy())
        for rows in pieces(1000, 37)
        for t, v in stream.add(t_ns[rows], values[rows])
    ]
    got += [(t.copy(), v.copy()) for t, v in stream.rest()]
    want_t, want = min_max_bins(t_ns, values, 7)
    np.testing.assert_array_equal(np.concatenate([t for t, _ in got]), want_t)
    np.testing.assert_array_equal(np.concatenate([v for _, v in got]), want)
    assert {len(t) for t, _ in got[:-1]} == {64}


def test_regrouping_hands_on_every_row_once():
    stream = Regrouped(10, 1)
    got = []
    for rows in pieces(47, 13):
        t_ns = np.arange(47)[rows]
        got += [t.copy() for t, _ in stream.add(t_ns, t_ns[:, None] * 1.0)]
    got += [t.copy() for t, _ in stream.rest()]
    assert [len(t) for t in got] == [10, 10, 10, 10, 7]
    np.testing.assert_array_equal(np.concatenate(got), np.arange(47))


def test_a_slow_drift_is_not_taken_for_standing_still():
    drift = Moved(1, np.array([1.0]))
    t_ns, rows = drift.add(np.arange(100), np.arange(100)[:, None] * 0.1)
    assert len(t_ns) == 11  # 0 to 9.9 in steps of 1
    assert np.all(np.diff(rows[:, 0]) <= 1.1 + 1e-12)  # a quantum and a step


def test_verified_by_rerun_itself(rrd):
    command = [viewer.viewer_binary(), "rrd", "verify", str(rrd)]
    done = subprocess.run(
        command, env=viewer.quiet_environment(), capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr


def test_different_times_are_refused(model, run, tmp_path):
    truth, imu = run
    late = ImuBlock(imu.t_ns + 1, imu.w_ib_b, imu.f_b)
    with pytest.raises(ValueError, match="same t_ns"):
        record(tmp_path / "late.rrd", model, (truth, late), 200)


def test_paths_that_cannot_be_written_are_told_in_one_line(model, run, tmp_path):
    for path in (tmp_path / "nowhere" / "a.rrd", tmp_path):
        with pytest.raises(StandError, match="cannot be written") as caught:
            record(path, model, run, 200)
        assert "\n" not in str(caught.value)


def test_what_is_no_recording_is_not_opened(tmp_path):
    (tmp_path / "a.txt").write_text("no recording")
    with pytest.raises(StandError, match="no such file"):
        viewer.view(tmp_path / "absent.rrd")
    with pytest.raises(StandError, match=r"must end in \.rrd or \.mcap"):
        viewer.view(tmp_path / "a.txt")


def test_a_missing_viewer_is_told(rrd, monkeypatch):
    monkeypatch.setattr(viewer.importlib.util, "find_spec", lambda name: None)
    monkeypatch.setattr(viewer.shutil, "which", lambda *args, **kwargs: None)
    with pytest.raises(StandError, match="no rerun viewer found"):
        viewer.view(rrd)


def test_the_viewer_is_bound_to_this_machine_and_its_failure_told(rrd, tmp_path, monkeypatch):
    fake = tmp_path / "rerun"
    fake.write_text('#!/bin/sh\necho "$CI $@" >&2\necho "Error: no display" >&2\nexit 3\n')
    fake.chmod(0o755)
    monkeypatch.setattr(viewer, "viewer_binary", lambda: str(fake))
    with pytest.raises(StandError, match="Error: no display"):
        viewer.view(rrd)
    fake.write_text(f'#!/bin/sh\necho "$CI $@" > {tmp_path}/seen\n')
    viewer.view(rrd)
    assert (tmp_path / "seen").read_text().startswith("true --bind 127.0.0.1 --port auto")


@pytest.mark.slow
def test_the_screen_opens_without_a_report_and_leaves_home_alone(rrd, tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    try:
        (picture,), state = pictures(rrd, tmp_path / "dwell.png", [5.0], size="1280x800")
    except StandError as error:
        if str(error) != NO_DRIVER:
            raise
        pytest.skip(NO_DRIVER)
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert len(state.views) == 15
    assert [(view.name, view.reports) for view in state.views if view.reports] == []
    assert not list((tmp_path / "home").rglob("*rerun*"))


def test_the_picture_command_tells_what_is_wrong(tmp_path, capsys):
    assert main([str(tmp_path / "absent.rrd"), str(tmp_path / "out.png"), "1"]) == 2
    assert "no such file" in capsys.readouterr().err
