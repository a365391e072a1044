"""What a review draws, read back from its file: lengths, places, colours and words by hand.

The stand of `stand` below reaches from (1, 1, 0) to (-1, 0, 1): its sphere stands about
(0, 0.5, 0.5) with a radius of sqrt(1.5) = 1.224745 m.
"""

from pathlib import Path

import numpy as np
import pytest
from rerun.chunk import RrdReader

from alignment import ImuReadings
from stand.recording.curves import AngleCurves, InnovationCurves, Phase
from stand.recording.review import ReviewWriter, excerpt, writer
from stand.recording.review.estimates import with_gaps
from stand.recording.review.excerpt import write_excerpt
from stand.recording.review.scene import rate_arrow, scene_of, turned_axes
from stand.recording.review.style import FOLLOWING, KIND_COLORS
from stand.samples import ImuBlock, TruthBlock
from stand.table.joints import Body, Geom, Joint, StandModel

S = 1_000_000_000
DEG = 0.017453292519943295
HALF = 0.7071067811865476
ABOUT_Z, ABOUT_X = (0.0, 0.0, HALF, HALF), (HALF, 0.0, 0.0, HALF)  # quarters
NO_TURN = (0.0, 0.0, 0.0, 1.0)
RADIUS = 1.5**0.5
EARTH = 5e-5  # rad/s, of (0, 3e-5, 4e-5)
PHASES = (Phase(0, 2 * S, "dwell", "a"), Phase(3 * S, 5 * S, "rate", "b"))
# Okabe and Ito's, and those lightened for a dark background
ORANGE, SKY, GREEN, YELLOW = 0xE69F00FF, 0x56B4E9FF, 0x00B282FF, 0xF0E442FF
RED, PINK, GREY, WHITE = 0xE65F1EFF, 0xD686B2FF, 0x8C8C8CFF, 0xEBEBEBFF
PALE = [0xFFB28CFF, 0x8CE6C8FF, 0xBEE4FFFF]


def body(name, parent, place, turn, joint, *geoms) -> Body:
    return Body(name, parent, place, turn, joint, geoms, 1.0, (0, 0, 0), (1, 1, 1), NO_TURN)


def geom(kind, size, place, turn=NO_TURN) -> Geom:
    return Geom("", kind, size, place, turn, (0.2, 0.4, 0.8, 1.0))


ARM = (
    geom("box", (0.1, 0.2, 0.3), (1.0, 0.0, 0.0), ABOUT_Z),
    geom("cylinder", (0.2, 0.15, 0.0), (0.0, 0.5, 0.0)),
    geom("capsule", (0.05, 0.3, 0.0), (0.0, 0.0, 0.5), ABOUT_X),
)


def stand() -> StandModel:
    """An arm a quarter about z, and on it a tip a quarter about x that turns about its y."""
    bodies = (
        body("world", "world", (0, 0, 0), NO_TURN, None, geom("plane", (0, 0, 1), (9.0, 9.0, 9.0))),
        body("arm", "world", (1.0, 0.0, 0.0), ABOUT_Z, None, *ARM),
        body(
            "tip",
            "arm",
            (0.0, 2.0, 0.0),
            ABOUT_X,
            Joint("inner", (0, 1, 0)),
            geom("sphere", (0.1, 0, 0), (0.0, 1.0, 0.0)),
        ),
    )
    return StandModel(bodies, "tip", (0.0, 0.02, 0.1), NO_TURN, "0" * 64)


def samples() -> tuple[TruthBlock, ImuBlock]:
    """Six seconds; Earth rate, then a hundred times as much, then none; 1 g and then 2 g."""
    t_ns = np.arange(1, 7) * S
    w = np.outer([1.0, 1.0, 1.0, 100.0, 100.0, 0.0], [0.0, 3e-5, 4e-5])
    f = np.outer([1.0, 1.0, 1.0, 1.0, 2.0, 2.0], [0.0, 0.0, 9.80665])
    joints = np.zeros((6, 6))
    joints[3:, 5] = 90 * DEG
    truth = TruthBlock(t_ns, w, f, np.tile(NO_TURN, (6, 1)), joints, np.zeros((6, 6)))
    return truth, ImuBlock(t_ns, w, f)


def curve(method: str, first: int, errors, sigmas, turns) -> AngleCurves:
    """Eleven rows from `first` [s] on, a tenth of a second apart; errors [deg]."""
    t_ns = first * S + np.arange(11) * (S // 10)
    errors, sigmas = np.array(errors).T * DEG, np.array(sigmas).T * DEG
    turns = np.outer(np.ones(11), turns)
    turns[np.isnan(errors).any(axis=1)] = np.nan
    return AngleCurves(method, "a", t_ns, errors + DEG, errors, sigmas, turns)


UP, ZERO, NONE = np.arange(11.0), np.zeros(11), np.full(11, np.nan)


class Written:
    """All that stands in an .rrd: values by entity and component, and its blueprints' likewise."""

    def __init__(self, path: Path) -> None:
        reader = RrdReader(path)
        self.timed, self.lasting, self.screens = {}, {}, {}
        for chunk in reader.stream():
            batch = chunk.to_record_batch()
            for name in batch.schema.names:
                key = f"{chunk.entity_path} {name}"
                values = batch.column(name)
                if name == "sim_time":
                    rows = values.to_numpy().astype(np.int64).tolist()
                else:
                    rows = values.to_pylist()
                (self.lasting if chunk.is_static else self.timed).setdefault(key, []).extend(rows)
        for store in reader.blueprints():
            for chunk in reader.stream(store=store):
                batch = chunk.to_record_batch()
                for name in batch.schema.names:
                    if ":" in name:
                        self.screens.setdefault(name, []).extend(batch.column(name).to_pylist())

    def at(self, entity: str, component: str) -> np.ndarray:
        return np.array(self.timed[f"{entity} {component}"])

    def once(self, entity: str, component: str) -> list:
        (values,) = self.lasting[f"{entity} {component}"]
        return values


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Written:
    path = tmp_path_factory.mktemp("review") / "hand.rrd"
    truth, imu = samples()
    with ReviewWriter(
        path,
        model=stand(),
        run_id="hand",
        title="Hand",
        duration_s=6.0,
        rate_hz=1,
        phases=PHASES,
        w_ie_enu=[0.0, 3e-5, 4e-5],
        properties={},
        following=True,
    ) as file:
        file.write(truth, imu, np.zeros((6, 6)))
        # 90 % of the errors are up to 9 deg of roll and of three sigmas up to 27 of yaw
        tested = curve("a", 0, [UP, ZERO, NONE], [ZERO, UP, NONE], [0.0, 0.0, 0.02])
        known = curve("b", 2, [UP, ZERO, ZERO], [ZERO, UP, ZERO], [0.0, 0.0, 0.02])
        rival = curve("c", 0, [100 + ZERO, 161 + ZERO, ZERO], [ZERO] * 3, [0.0, 0.0, 1.0])
        file.angles([tested, rival, known])
        t_ns = np.array([S, 2 * S])
        values = np.array([[1e-3, -2e-3, 3e-3], [-5e-3, 1e-3, 2e-3]])
        sigmas = np.array([[1e-3, 2e-3, 3e-3], [4e-3, 1e-3, 2e-3]])
        file.innovations([InnovationCurves("a", "a", t_ns, values, sigmas)])
        file.innovations([])
    return Written(path)


# --- the stand ------------------------------------------------------------------------------------


def test_where_the_stand_is_and_how_large():
    scene = scene_of(stand())
    assert scene.entities == {"world": "world", "arm": "world/arm", "tip": "world/arm/tip"}
    assert scene.imu == "world/arm/tip/imu"
    # two more solids stand about (0.5, 0, 0) and (1, 0, 0.5): within
    np.testing.assert_allclose(scene.center, [0.0, 0.5, 0.5], atol=1e-15)
    assert scene.radius == pytest.approx(RADIUS, rel=1e-14)


@pytest.mark.parametrize(
    ("geoms", "center", "radius"),
    [((), (0.5, 0.5, 0.5), 0.75**0.5), ((geom("box", (1, 1, 1), (2.0, 3, 4)),), (2, 3, 4), 1.0)],
)
def test_a_stand_of_no_solid_and_of_one(geoms, center, radius):
    model = StandModel(
        (body("world", "world", (0, 0, 0), NO_TURN, None, *geoms),),
        "world",
        (0, 0, 0),
        NO_TURN,
        "0" * 64,
    )
    scene = scene_of(model)
    np.testing.assert_array_equal(scene.center, center)
    assert scene.radius == pytest.approx(radius)


def test_solids_have_their_sizes(written):
    place = "/world/arm/solids"
    assert written.once(f"{place}/box", "Boxes3D:centers") == [[1.0, 0.0, 0.0]]
    np.testing.assert_allclose(
        written.once(f"{place}/box", "Boxes3D:half_sizes"), [[0.1, 0.2, 0.3]], rtol=1e-6
    )
    np.testing.assert_allclose(written.once(f"{place}/box", "Boxes3D:quaternions"), [ABOUT_Z])
    assert written.once(f"{place}/box", "Boxes3D:colors") == [0x3366CCFF]  # 0.2, 0.4, 0.8 of 255
    assert written.once(f"{place}/cylinder", "Cylinders3D:radii") == pytest.approx([0.2])
    assert written.once(f"{place}/cylinder", "Cylinders3D:lengths") == pytest.approx([0.3])
    assert written.once(f"{place}/cylinder", "Cylinders3D:centers") == [[0.0, 0.5, 0.0]]
    assert written.once(f"{place}/capsule", "Capsules3D:radii") == pytest.approx([0.05])
    assert written.once(f"{place}/capsule", "Capsules3D:lengths") == pytest.approx([0.6])
    # turned a quarter about x its axis points to -y, and it begins half its length before
    np.testing.assert_allclose(
        written.once(f"{place}/capsule", "Capsules3D:translations"), [[0.0, 0.3, 0.5]], atol=1e-7
    )
    ball = "/world/arm/tip/solids/sphere"
    np.testing.assert_allclose(
        written.once(ball, "Ellipsoids3D:half_sizes"), [[0.1] * 3], rtol=1e-6
    )
    assert written.once(ball, "Ellipsoids3D:centers") == [[0.0, 1.0, 0.0]]
    assert not any("plane" in key for key in written.lasting)


def test_a_hinge_turns_about_its_own_axis(written):
    """A quarter about x, then about the new y: the product of quaternions is 1/2 (1, 1, 1, 1)."""
    assert written.at("/world/arm/tip", "sim_time").tolist() == [S, 4 * S]
    turns = written.at("/world/arm/tip", "Transform3D:quaternion")
    np.testing.assert_allclose(turns[:, 0], [ABOUT_X, [0.5] * 4], atol=1e-7)
    places = written.at("/world/arm/tip", "Transform3D:translation")
    np.testing.assert_allclose(places[:, 0], [[0.0, 2.0, 0.0]] * 2)


# --- arrows ---------------------------------------------------------------------------------------


def test_force_and_rate_arrows_have_their_lengths(written):
    """0.6 radii per g; of Earth rate a quarter of that, and as much longer at a hundred times."""
    imu = "/world/arm/tip/imu"
    times = written.at(f"{imu}/f", "sim_time")
    assert times.tolist() == [S, 4 * S, 5 * S, 6 * S]  # where something has changed
    force = written.at(f"{imu}/f", "Arrows3D:vectors")[:, 0] / (0.6 * RADIUS)
    np.testing.assert_allclose(force, np.outer([1, 1, 2, 2], [0, 0, 1]), atol=1e-6)
    rate = written.at(f"{imu}/w", "Arrows3D:vectors")[:, 0] / (0.6 * RADIUS)
    np.testing.assert_allclose(rate, np.outer([0.25, 0.5, 0.5, 0], [0, 0.6, 0.8]), atol=1e-6)


def test_rates_on_a_log_scale():
    rates = np.outer([1.0, 10.0, 0.1, 0.01, 0.001, 0.0], [0.0, 0.0, -EARTH])
    found = rate_arrow(rates, EARTH)[:, 2]
    np.testing.assert_allclose(found, [-0.25, -0.375, -0.125, 0, 0, 0], atol=1e-12)
    # without Earth rate from 1e-14 rad/s on
    found = rate_arrow(np.array([[1e-12, 0.0, 0.0], [0.0, 1e-14, 0.0]]), 0.0)
    np.testing.assert_allclose(found, [[0.25, 0, 0], [0, 0, 0]], atol=1e-12)


def test_axes_are_turned_by_sixty_degrees_at_most():
    small, large = turned_axes(np.array([[0.0, 0.0, 0.01], [0.0, 0.0, 1.0]]), 10.0)
    c, s = np.cos(0.1), np.sin(0.1)
    np.testing.assert_allclose(small, [[c, s, 0], [-s, c, 0], [0, 0, 1]], atol=1e-15)
    c, s = 0.5, 0.75**0.5
    np.testing.assert_allclose(large, [[c, s, 0], [-s, c, 0], [0, 0, 1]], atol=1e-15)


def test_true_and_estimated_axes_are_as_long(written):
    """0.35 radii; the estimate's error of 0.02 rad is shown ten times, in every row."""
    imu, length = "/world/arm/tip/imu", 0.35 * RADIUS
    truth = written.once(f"{imu}/truth", "Arrows3D:vectors")
    np.testing.assert_allclose(truth, np.eye(3) * length, rtol=1e-6)
    assert written.once(f"{imu}/truth", "Arrows3D:labels") == ["X1", "Y1", "Z1"]
    assert written.once(f"{imu}/truth", "Arrows3D:radii") == pytest.approx([0.008 * RADIUS])
    # of the first stretch an angle is not known: no axes; behind each none
    key = f"{imu}/estimate"
    shown = [rows for rows in written.timed[f"{key} Arrows3D:vectors"] if rows]
    assert len(shown) == 11
    times = written.timed[f"{key} sim_time"]
    assert sorted(times) == [S + 1, *(2 * S + np.arange(11) * (S // 10)), 3 * S + 1]
    c, s = np.cos(0.2), np.sin(0.2)
    np.testing.assert_allclose(
        np.array(shown[0]) / length, [[c, s, 0], [-s, c, 0], [0, 0, 1]], atol=1e-6
    )
    assert written.once(key, "Arrows3D:radii") == pytest.approx([0.005 * RADIUS])


def test_the_worlds_arrows_stand_beside_the_stand(written):
    """Down, along the Earth's axis and north (y), 0.35 radii long, at a corner."""
    vectors = np.array(written.once("/world/reference", "Arrows3D:vectors")) / (0.35 * RADIUS)
    np.testing.assert_allclose(vectors, [[0, 0, -1], [0, 0.6, 0.8], [0, 1, 0]], atol=1e-6)
    corner = np.array([0.0, 0.5, 0.5]) + RADIUS * np.array([-0.95, -0.8, 0.25])
    origins = written.once("/world/reference", "Arrows3D:origins")
    np.testing.assert_allclose(origins, [corner] * 3, rtol=1e-6)
    assert written.once("/world/reference", "Arrows3D:labels") == ["g", "Earth rate", "N"]
    assert written.once("/world/reference", "Arrows3D:radii") == pytest.approx([0.008 * RADIUS])


# --- curves ---------------------------------------------------------------------------------------


def test_curves_are_in_degrees(written):
    for entity, add in (("/angles/roll/0_a", 0.0), ("/angles/values/0_a", 1.0)):
        rows = written.at(entity, "Scalars:scalars")
        np.testing.assert_allclose(rows[:11, 0], UP + add, atol=1e-13)
        assert np.isnan(rows[11]).all()
    np.testing.assert_allclose(
        written.at("/angles/values/1_c", "Scalars:scalars")[0], [101, 162, 1]
    )
    sigma = written.at("/angles/yaw/sigma", "Scalars:scalars")
    np.testing.assert_allclose(sigma[:11], np.outer(UP, [3, -3]), atol=1e-13)
    # the second method takes over from the first, with a line and a colour of its own
    assert written.at("/angles/yaw/2_b", "sim_time")[0] == 2 * S
    assert written.at("/angles/yaw/sigma", "sim_time")[12] == 2 * S


def test_innovations_are_in_millimetres_within_the_largest_sigmas(written):
    found = written.at("/innovations/found", "Scalars:scalars")
    np.testing.assert_allclose(found[:2], [[1, -2, 3], [-5, 1, 2]], rtol=1e-14)
    bound = written.at("/innovations/sigma", "Scalars:scalars")
    np.testing.assert_allclose(bound[:2], [[9, -9], [12, -12]], rtol=1e-14)
    assert written.once("/innovations/found", "SeriesLines:names") == ["N", "E", "D"]


def test_many_rows_become_extremes(monkeypatch):
    monkeypatch.setattr("stand.recording.review.estimates.CURVE_BUDGET", 4)
    t_ns, values = np.arange(4), np.array([[1.0], [9.0], [-3.0], [2.0]])
    times, rows = with_gaps([(t_ns, values), (t_ns + 100, values)])
    # 8 rows for 4: bins of four, of two rows each, and a gap behind
    assert times.tolist() == [0, 3, 4, 100, 103, 104]
    np.testing.assert_array_equal(rows[:, 0], [9, -3, np.nan, 9, -3, np.nan])


# --- colours and lines ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("entity", "colors", "width"),
    [
        ("stand/base", [SKY, ORANGE, GREEN], 1.2),
        ("stand/table", [SKY, ORANGE, GREEN], 1.2),
        ("stand/following", [YELLOW, PINK, RED, SKY, ORANGE, GREEN], 1.2),
        ("imu/accel", [RED, GREEN, SKY], 1.2),
        ("imu/gyro", [RED, GREEN, SKY], 1.2),
        ("residual/accel", [RED, GREEN, SKY], 1.2),
        ("residual/gyro", [RED, GREEN, SKY], 1.2),
        ("innovations/found", [RED, GREEN, SKY], 1.2),
        ("innovations/sigma", [GREY, GREY], 1.2),
        ("angles/yaw/sigma", [GREY, GREY], 1.2),
        ("angles/yaw/0_a", [SKY], 2.0),  # under test, and what takes over
        ("angles/yaw/1_c", [ORANGE], 1.2),
        ("angles/yaw/2_b", [PINK], 2.0),
        ("angles/values/0_a", [RED, GREEN, SKY], 2.0),
        ("angles/values/1_c", PALE, 1.2),
    ],
)
def test_lines_have_their_colours(written, entity, colors, width):
    assert written.once(f"/{entity}", "SeriesLines:colors") == colors
    assert written.once(f"/{entity}", "SeriesLines:widths") == pytest.approx([width] * len(colors))


def test_arrows_have_the_colours_of_their_axes(written):
    imu = "/world/arm/tip/imu"
    for entity, colors in (
        (f"{imu}/truth", [RED, GREEN, SKY]),
        (f"{imu}/estimate", PALE),
        (f"{imu}/f", [PINK]),
        (f"{imu}/w", [YELLOW]),
        ("/world/reference", [WHITE, YELLOW, RED]),
    ):
        assert written.once(entity, "Arrows3D:colors") == colors
    for name in "fw":
        assert written.once(f"{imu}/{name}", "Arrows3D:radii") == pytest.approx([0.005 * RADIUS])


def test_the_colours_of_the_kinds():
    """As in pictures made already: a step keeps its colour from one version to the next."""
    packed = {kind: f"{r:02x}{g:02x}{b:02x}" for kind, (r, g, b) in KIND_COLORS.items()}
    assert packed == {
        "dwell": "266eaa",
        "move": "be781e",
        "rate": "117733",
        "sweep": "44aa99",
        "sine": "b450dc",
        "scorsby": "ddcc77",
        "coning": "88ccee",
        "sway": "cc6677",
        "vibration": "882255",
        "profile": "dddddd",
    }


def test_states_end_where_nothing_follows(written):
    assert written.at("/phase", "sim_time").tolist() == [0, 2 * S, 3 * S, 5 * S]
    assert written.timed["/phase StateChange:state"] == [["dwell a"], [""], ["rate b"], [""]]
    assert written.once("/phase", "StateConfiguration:colors") == [0x266EAAFF, 0x117733FF]


# --- the screen -----------------------------------------------------------------------------------


def test_the_screen_shows_the_method_under_test_where_a_rival_drifts_away(written):
    """Six times what 90 % of its errors, or three sigmas, stay below: 54 and 162 deg."""
    limits = [tuple(span) for (span,) in written.screens["ScalarAxis:range"]]
    assert limits == [pytest.approx((-54.0, 54.0))]  # the rival's 161 deg of yaw are within 162
    names = {name for (name,) in written.screens["ViewBlueprint:display_name"]}
    assert "Stand, true axes; pale: a, b, error x10" in names
    assert "Roll error, ±3σ [deg], 0 to 100" in names
    assert "Yaw error, ±3σ [deg], -30 to 161" in names
    assert "Pitch error, ±3σ [deg], 0 to 0" in names
    assert "Innovations of the filter [mm], ±3σ, -12 to 12" in names
    assert "Estimated angles [deg], 1 to 162" in names


def test_the_whole_run_with_room_for_legends(written):
    """From 1 % before the begin to 14 % behind the end of 6 s; the first screen sent likewise."""
    spans = [(v["start"], v["end"]) for (v,) in written.screens["TimeAxis:view_range"]]
    assert spans == [(-60_000_000, 6_840_000_000)] * 2
    assert {link for (link,) in written.screens["TimeAxis:link"]} == {2}  # all plots move together
    assert written.screens["TimePanelBlueprint:timeline"] == [["sim_time"]] * 2


def test_parts_of_the_screen(written):
    """The stand three fifths of the left side, which is two fifths; a strip of phases."""
    assert written.screens["ContainerBlueprint:col_shares"] == [[2.0, 3.0]] * 2
    rows = [
        np.round(shares, 6).tolist() for shares in written.screens["ContainerBlueprint:row_shares"]
    ]
    # a tenth of a plot for each row: eight with the angles, five before
    assert sorted(rows) == sorted([[3.0, 2.0]] * 2 + [[0.5, *[1.0] * 4], [0.8, *[1.0] * 7]])
    target = np.array([0.0, 0.5, 0.5])
    for eye, look in zip(
        written.screens["EyeControls3D:position"],
        written.screens["EyeControls3D:look_target"],
        strict=True,
    ):
        np.testing.assert_allclose(look[0], target, atol=1e-6)
        np.testing.assert_allclose(eye[0], target + RADIUS * np.array([1.6, -1.8, 1.0]), rtol=1e-6)
    assert written.screens["EyeControls3D:eye_up"] == [[[0.0, 0.0, 1.0]]] * 2
    assert written.screens["LineGrid3D:spacing"] == [[0.25]] * 2
    assert written.screens["LineGrid3D:visible"] == [[True]] * 2
    assert written.screens["Background:color"] == [[0x181A1EFF]] * 2
    tabs = [tab for (tab,) in written.screens["ContainerBlueprint:active_tab"]]
    firsts = {contents[0] for contents in written.screens["ContainerBlueprint:contents"]}
    assert set(tabs) <= firsts  # of each the first is on top
    names = {name for (name,) in written.screens["ViewBlueprint:display_name"]}
    assert f"{FOLLOWING.title}, 0 to 0" in names


def test_an_angle_that_is_not_determined_anywhere(tmp_path):
    path = tmp_path / "a.rrd"
    with ReviewWriter(
        path,
        model=stand(),
        run_id="a",
        title="A",
        duration_s=1.0,
        rate_hz=1,
        phases=(),
        w_ie_enu=np.zeros(3),
        properties={},
    ) as file:
        # of sigma zero: no lines of it; 10 deg at most of 6 times 9: not limited
        whole = curve("a", 0, [UP, ZERO, NONE], [ZERO, ZERO, NONE], [0.0, 0.0, 0.0])
        rows = whole.angles[:1], whole.errors[:1], whole.sigmas[:1], whole.error_rotations[:1]
        point = AngleCurves("a", "point", [3 * S], *rows)
        file.angles([point, whole])
    found = Written(path)
    times = found.at("/angles/roll/0_a", "sim_time")
    assert times[12:].tolist() == [3 * S, 3 * S + 1]  # one row and its gap
    names = {name for (name,) in found.screens["ViewBlueprint:display_name"]}
    assert "Pitch error: not determined" in names
    assert "Stand, true axes; pale: a, error x1" in names
    assert "ScalarAxis:range" not in found.screens
    assert not any("sigma" in key or key.startswith("/phase") for key in found.timed)
    # without Earth rate its arrow has no length
    vectors = found.once("/world/reference", "Arrows3D:vectors")
    assert vectors[1] == [0.0, 0.0, 0.0]


@pytest.mark.parametrize(
    ("rate", "budget", "every"),
    [(49, 100, 1), (50, 100, 1), (51, 100, 2), (101, 100, 3), (40, 8, 2)],
)
def test_poses_of_a_fast_run_are_fewer(tmp_path, monkeypatch, rate, budget, every):
    """50 a second at most, and within their budget: 12 samples for 8 rows are every second one."""
    monkeypatch.setattr(writer, "POSE_BUDGET", budget)
    n = 12
    t_ns = np.arange(1, n + 1) * (S // rate)
    joints = np.zeros((n, 6))
    joints[:, 5] = np.arange(n) * 0.1
    still, zero = np.tile(NO_TURN, (n, 1)), np.zeros((n, 3))
    path = tmp_path / "a.rrd"
    with ReviewWriter(
        path,
        model=stand(),
        run_id="a",
        title="A",
        duration_s=n / rate,
        rate_hz=rate,
        phases=(),
        w_ie_enu=[0.0, 3e-5, 4e-5],
        properties={},
    ) as file:
        file.write(TruthBlock(t_ns, zero, zero, still, joints, joints), ImuBlock(t_ns, zero, zero))
    shown = Written(path).at("/world/arm/tip", "sim_time")
    np.testing.assert_array_equal(shown, t_ns[::every])


# --- a stretch of samples -------------------------------------------------------------------------


def test_a_stretch_of_samples_by_hand(tmp_path):
    t = np.array([10.0, 10.5, 11.0, 11.5, 12.0])
    w = np.outer([1.0, 2.0, 3.0, 4.0, 5.0], [DEG, -2 * DEG, 0.0])
    f = np.outer([1.0, 2.0, 3.0, 4.0, -5.0], [0.0, 1.0, 9.0])
    phases = (Phase(10 * S, 11 * S, "dwell", "rest 1"),)
    assert write_excerpt(tmp_path / "a.rrd", "log, 10 to 12 s", ImuReadings(t, w, f), phases) == 1
    found = Written(tmp_path / "a.rrd")
    for entity, values in (("/imu/accel", f), ("/imu/gyro", w / DEG)):
        assert found.at(entity, "sim_time").tolist() == (t * S).astype(int).tolist()
        np.testing.assert_allclose(found.at(entity, "Scalars:scalars"), values, rtol=1e-14)
        assert found.once(entity, "SeriesLines:colors") == [RED, GREEN, SKY]
        assert found.once(entity, "SeriesLines:widths") == pytest.approx([1.2] * 3)
    assert found.timed["/phase StateChange:state"] == [["dwell rest 1"], [""]]
    assert found.at("/phase", "sim_time").tolist() == [10 * S, 11 * S]
    names = {name for (name,) in found.screens["ViewBlueprint:display_name"]}
    assert "Phase" in names
    assert "Specific force of the IMU [m/s²], -45 to 36" in names
    assert "Angular rate of the IMU [deg/s], -10 to 5" in names
    # 1 % before 10 s, 14 % of 2 s behind 12
    assert found.screens["TimeAxis:view_range"] == [
        [{"start": 9_980_000_000, "end": 12_280_000_000}]
    ]
    (rows,) = found.screens["ContainerBlueprint:row_shares"]
    np.testing.assert_allclose(rows, [0.2, 1.0, 1.0], rtol=1e-6)


def test_a_long_stretch_without_phases(tmp_path, monkeypatch):
    monkeypatch.setattr(excerpt, "ROW_BUDGET", 4)
    t = np.arange(1.0, 9.0)
    values = np.outer([1.0, 9.0, -3.0, 2.0, 0.0, 1.0, 7.0, 4.0], np.ones(3))
    m = write_excerpt(tmp_path / "a.rrd", "long", ImuReadings(t, values * DEG, values))
    assert m == 4  # eight samples in four rows: two bins of four
    found = Written(tmp_path / "a.rrd")
    for entity in ("/imu/accel", "/imu/gyro"):
        rows = found.at(entity, "Scalars:scalars")
        np.testing.assert_allclose(rows[:, 0], [9, -3, 0, 7])
        assert found.at(entity, "sim_time").tolist() == [S, 4 * S, 5 * S, 8 * S]
    assert "/phase sim_time" not in found.timed
    assert ["Phase"] not in found.screens["ViewBlueprint:display_name"]
    assert found.screens["ContainerBlueprint:row_shares"] == [[1.0, 1.0]]


def test_a_stretch_a_little_too_long(tmp_path, monkeypatch):
    monkeypatch.setattr(excerpt, "ROW_BUDGET", 4)
    t, values = np.arange(1.0, 7.0), np.ones((6, 3))
    assert write_excerpt(tmp_path / "a.rrd", "a", ImuReadings(t, values, values)) == 3
