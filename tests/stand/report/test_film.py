"""A recording as a film: what each picture shows, how many there are, what is refused."""

import shutil
from base64 import b64decode
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from pages import checked
from PIL import Image as Picture

from stand import api
from stand.errors import StandError
from stand.physics import ASIDE
from stand.physics import picture as drawing
from stand.physics.mjcf import models_folder
from stand.recording.mcap.reader import JointLog
from stand.report import film as films
from stand.report.encoding import KINDS, decode, encode
from stand.report.film import frame_times, moved
from stand.report.film_canvas import Canvas, Layout
from stand.report.film_scene import angles_of, scene_of
from stand.table.joints import JOINTS

SIZE = (320, 180)
TURN = 12.0, 14.4  # s of the short run: X1 goes up, middle from 0 to 90 deg


@pytest.fixture(scope="module")
def log(recorded):
    return api.read(recorded.folder)


def differ(a, b):
    """How far two pictures are apart, in levels of 255."""
    return float(np.abs(a.astype(int) - b).mean())


@pytest.mark.slow  # a process that draws, twice
def test_a_film_shows_the_table_turn(recorded, stand_command, tmp_path):
    """12 to 14.4 s at five times the speed: 0.48 s, 12 pictures. Where the two poses differ, the
    first is as the stand is drawn by itself at 0 deg, the last as at 90 deg."""
    out = tmp_path / "turn.mp4"
    said = ("film", recorded.folder, "--from", TURN[0], "--to", TURN[1], "--speed", 5,
            "--size", "320x180", "--camera", "side", "--out", out)  # fmt: skip
    done = stand_command(*said, "--json")
    assert done.code == 0, done.err
    images, duration = decode(out)
    assert len(images) == done.json["pictures"] == 12
    assert duration == pytest.approx(12 / 25)
    assert done.json["duration"] == pytest.approx(12 / 25)
    box = Layout(*SIZE).stand
    seen = [image[box.rows, box.columns] for image in images]
    angles = np.zeros((2, 6))
    angles[1, JOINTS.index("middle")] = np.pi / 2
    before, after = drawing.drawn(angles, "side", box.width, box.height, quick=True)
    apart = np.abs(before.astype(int) - after).sum(axis=2) > 120
    assert apart.mean() > 0.01
    # compression blurs colours over two points, which is half of what is 5 points wide
    for image, own, other in ((seen[0], before, after), (seen[-1], after, before)):
        assert differ(image[apart], own[apart]) < 0.5 * differ(image[apart], other[apart])
    refused = stand_command(*said)
    assert refused.code == 2
    assert "--force replaces it" in refused.err
    assert stand_command(*said, "--force").out.startswith(f"{out}: 12.00 to 14.40 s at 5 times")


def test_a_picture_is_of_its_moment(recorded, stand_command, tmp_path, monkeypatch):
    """At 20 s the encoders say middle 90 deg: that is drawn, and written on it."""
    angles = []
    real = films.pictures

    def seen(joints, *more):
        angles.append(np.degrees(joints[0]))
        return real(joints, *more)

    monkeypatch.setattr(films, "pictures", seen)
    out = tmp_path / "moment.png"
    said = ("picture", recorded.folder, "--out", out, "--size", "320x180", "--camera", "top")
    assert stand_command(*said, "--at", 20, "--method", "triad").code == 0
    np.testing.assert_allclose(angles[0], [0, 0, 0, 0, 90, 0], atol=0.01)
    with Picture.open(out) as file:
        assert file.size == SIZE
    assert stand_command(*said, "--at", 20).code == 2
    told = stand_command(*said, "--at", 99, "--force")
    assert told.code == 2
    assert "--at 99: must lie within the recording's 0.000 to 26" in told.err


def test_what_is_to_come_is_not_shown_yet(log):
    with scene_of(log) as scene:
        canvas = Canvas(scene, 0.0, 20.0, 640, 360)
    stand = np.zeros((canvas.layout.stand.height, canvas.layout.stand.width, 3), np.uint8)
    first, half, last = (canvas.frame(t, stand, np.zeros(6)) for t in (0.0, 10.0, 20.0))
    a, b = canvas.layout.plot
    middle = (a + b) // 2
    rows = canvas.layout.curves.rows
    # one column beyond for the cursor, one for the smoothing of what lies beside it
    np.testing.assert_array_equal(first[rows, middle + 2 : b], half[rows, middle + 2 : b])
    np.testing.assert_array_equal(half[rows, a + 2 : middle - 2], last[rows, a + 2 : middle - 2])
    assert differ(first[rows, a + 2 : middle], half[rows, a + 2 : middle]) > 0.5
    # the letters of clock and angles, and the caption of the stage, change with time
    assert differ(first[: canvas.layout.head], half[: canvas.layout.head]) > 0


def test_an_upright_film_has_the_curves_below():
    wide, high = Layout(1280, 720), Layout(720, 1280)
    assert wide.curves.x == wide.stand.width
    assert high.curves.y == high.stand.y + high.stand.height
    for layout in (wide, high):
        assert layout.curves.y + layout.curves.height + layout.foot == layout.height
        assert 0 < layout.plot[0] < layout.plot[1] < layout.width


@pytest.mark.parametrize("ending", KINDS)
def test_every_kind_keeps_number_time_and_colour(tmp_path, ending):
    """20 pictures, each of one colour more; a GIF's 256 colours are off by a sixth of 255."""
    out, kind = tmp_path / f"film{ending}", KINDS[ending]
    images = [np.full((90, 160, 3), (10 * k, 128, 40), np.uint8) for k in range(20)]
    assert encode(out, images, kind, kind.rate) == 20
    if ending == ".webp":  # FFmpeg writes moving ones, and reads still ones alone
        with Picture.open(out) as file:
            assert file.n_frames == 20
            file.seek(10)
            found, duration = np.asarray(file.convert("RGB")), 20 * file.info["duration"] / 1000
    else:
        frames, duration = decode(out)
        assert len(frames) == 20
        found = frames[10]
    assert duration == pytest.approx(20 / float(kind.rate))
    assert np.abs(found.mean(axis=(0, 1)) - images[10][0, 0]).max() < 26


def test_times_end_where_they_should():
    t = frame_times(10.0, 20.0, 4.0, 25.0)
    assert len(t) == 62  # 2.5 s of 25 a second
    assert t[-1] == 20.0
    np.testing.assert_allclose(np.diff(t), 10 / 62)
    assert len(frame_times(0.0, 0.01, 1.0, 25.0)) == 1


def test_nothing_is_drawn_while_nothing_moves():
    """Encoders that tremble by 0.01 deg, then creep: each 0.02 deg away is drawn."""
    angles = np.zeros((8, 6))
    angles[1::2, 3] = np.radians(0.01)
    angles[5:, 4] = np.radians([0.015, 0.03, 0.045])
    assert moved(angles).tolist() == [True, False, False, False, False, False, True, False]


def joint_log(*names):
    n = len(names)
    angles = np.arange(2 * n, dtype=float).reshape(2, n)
    return JointLog("log", "/joints", np.array([0, 10**9]), names, angles, None)


def test_joints_of_a_foreign_table():
    """Two rows: 0, 1 and 2, 3 rad."""
    own = angles_of(joint_log("inner", "outer"))
    np.testing.assert_array_equal(own, [[0, 0, 0, 1, 0, 0], [0, 0, 0, 3, 0, 2]])
    foreign = joint_log("yaw", "tilt")
    told = angles_of(foreign, "yaw=outer, tilt=-middle")
    np.testing.assert_array_equal(told, [[0, 0, 0, 0, -1, 0], [0, 0, 0, 2, -3, 0]])
    for assigned, line in (
        ("", "/joints: joints yaw, tilt: none is an axis of the stand"),
        ("roll=outer", "unknown /joints: joint 'roll'"),
        ("yaw=outward", "unknown --joints: axis of the stand 'outward': did you mean outer"),
        ("yaw", "unknown --joints: axis of the stand ''"),
    ):
        with pytest.raises(StandError, match=line):
            angles_of(foreign, assigned)


def test_a_log_without_joints_says_so(stand_command, tmp_path):
    rest = [[k / 10, 0, 1e-3, 0, 0, 9.81, 0] for k in range(40)]
    log = tmp_path / "log.csv"
    np.savetxt(
        log, rest, delimiter=",", header="t,gx_rad_s,gy_rad_s,gz_rad_s,ax_m_s2,ay_m_s2,az_m_s2"
    )
    told = stand_command("film", log, "--out", tmp_path / "x.mp4")
    assert told.code == 2
    assert "it has no joints" in told.err
    messages = tmp_path / "log.mcap"
    assert stand_command("import", log, "--out", messages).code == 0
    told = stand_command("film", messages, "--out", tmp_path / "x.mp4")
    assert told.err.startswith(f"stand: {messages}: no topic with sensor_msgs/msg/JointState")
    assert not (tmp_path / "x.mp4").exists()


@pytest.mark.parametrize(
    ("wrong", "line"),
    [
        (("--out", "x.avi"), "unknown --out x.avi: kind of film '.avi'"),
        (("--size", "321x180"), "--size 321x180: width must be even, 160 to 3840"),
        (("--size", "big"), "--size big: must be WIDTHxHEIGHT"),
        (("--size", "320x9000"), "height must be even, 90 to 2160"),
        (("--speed", 0), "--speed 0: must be"),
        (("--speed", "nan"), "--speed nan: must be"),
        (("--from", 20, "--to", 10), "from 20 to 10 s: must be a stretch within"),
        (("--from", "nan"), "must be a stretch within"),
        (("--method", "triads"), "unknown method 'triads': did you mean triad"),
        (("--camera", "front"), "unknown camera 'front'"),
        (("--topic", "/imu/dat"), "did you mean /imu/data"),
        (("--joints", "out=outer"), "unknown /joint_states: joint 'out': did you mean outer"),
    ],
)
def test_what_cannot_be_is_one_line(recorded, stand_command, tmp_path, monkeypatch, wrong, line):
    monkeypatch.chdir(tmp_path)
    told = stand_command(
        "film", recorded.folder, *wrong, *(("--out", "x.mp4") * ("--out" not in wrong))
    )
    assert told.code == 2
    assert line in told.err
    assert told.err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_options_of_a_picture_are_checked_as_well(recorded, stand_command, tmp_path):
    out = tmp_path / "x.png"
    for wrong in (("--joints", "out=outer"), ("--topic", "/imu/dat"), ("--size", "9x9")):
        assert stand_command("picture", recorded.folder, "--at", 1, "--out", out, *wrong).code == 2
    told = stand_command("picture", recorded.folder, "--at", 1, "--out", tmp_path / "x.jpg")
    assert "must end in .png" in told.err


def test_without_a_driver_it_is_one_line(recorded, stand_command, tmp_path, monkeypatch):
    monkeypatch.setenv("MUJOCO_GL", "nothing")
    told = stand_command("film", recorded.folder, "--out", tmp_path / "x.mp4")
    assert told.code == 2
    assert "no OpenGL driver (nothing: " in told.err
    assert list(tmp_path.iterdir()) == []


def test_another_driver_goes_on_where_one_stops(monkeypatch):
    """The first draws one of three; the second is asked for the other two."""
    asked = []

    def drawn_by(driver, request):
        asked.append((driver, len(request["joints"])))
        for k in range(1 if driver == "egl" else len(request["joints"])):
            yield np.full((2, 2, 3), 10 * len(asked) + k, np.uint8)
        if driver == "egl":
            raise drawing.Stopped("lost")

    monkeypatch.setattr(drawing, "drawn_by", drawn_by)
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    monkeypatch.delenv(ASIDE, raising=False)
    images = drawing.pictures(np.zeros((3, 6)), width=2, height=2)
    assert [int(image[0, 0, 0]) for image in images] == [10, 20, 21]
    assert asked == [("egl", 3), ("osmesa", 2)]


def test_a_film_that_cannot_be_finished_leaves_nothing(log, tmp_path):
    def stop(done):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        films.write_film(log, Path(tmp_path / "x.mp4"), size=SIZE, speed=100, progress=stop)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow  # a process that draws
def test_a_ball_of_a_stand_of_ones_own_is_round(tmp_path):
    """Drawn with two corners along it, as cylinders are, its outline would be a diamond: 2/pi of
    the round one's points. Seen from afar, beside the stand and larger than it."""
    shutil.copytree(models_folder(), tmp_path / "own")
    main = tmp_path / "own" / "turntable.xml"
    ball = '<geom type="sphere" pos="0 0 5" size="1" mass="0" rgba="1 0 1 1"/></worldbody>'
    main.write_text(main.read_text().replace("</worldbody>", ball))
    (image,) = drawing.pictures(np.zeros((1, 6)), "0,0,14", 160, 160, main)
    red, green, blue = (image[..., k].astype(int) for k in range(3))
    of_ball = (red > green + 25) & (blue > green + 25)
    down, across = (of_ball.any(axis=k).sum() for k in (1, 0))
    assert min(down, across) > 20
    # an ellipse in that box; its edge of a point's width is counted or not: 4 / 20 at the most
    assert of_ball.sum() == pytest.approx(np.pi / 4 * down * across, rel=0.1)


@pytest.mark.slow  # a process that draws
def test_a_page_of_a_run_holds_its_film_on_request(recorded, stand_command, tmp_path, monkeypatch):
    """26 s of run as a film of at most half a second: 6 pictures of 12.5 a second."""
    monkeypatch.setattr("stand.report.run_page.FILM_S", 0.5)
    monkeypatch.setattr("stand.report.run_page.FILM_SIZE", (160, 90))
    out = tmp_path / "page.html"
    assert stand_command("report", recorded.folder, "--film", "--out", out).code == 0
    page = checked(out.read_text(encoding="utf-8"))
    (film,) = (a for a in page.of("img") if "image/webp" in (a["src"] or ""))
    data = b64decode((film["src"] or "").partition(",")[2])
    with Picture.open(BytesIO(data)) as file:
        assert (file.size, file.n_frames) == ((160, 90), 6)
    assert "26.0 s, beside readings and estimate" in page.said
    copy = tmp_path / "copy.mcap"
    stand_command("import", recorded.folder, "--out", copy)
    told = stand_command("report", copy, "--film", "--out", tmp_path / "x.html")
    assert (told.code, "--film: of a recorded run" in told.err) == (2, True)
