"""Paths over the rotating Earth against closed forms, and against integrating them back."""

import numpy as np
import pytest
from chain import skew
from scipy.spatial.transform import Rotation
from scipy.stats import chi2, kstest

from alignment.earth import normal_gravity
from alignment.units import DEG, DEG_PER_HOUR
from stand import toml_files as catalogue
from stand.errors import StandError
from stand.imu import Imu, load_imu
from stand.vehicle.path import Change, Path, Start, smooth
from stand.vehicle.scenario import (
    Leg,
    SatelliteEntry,
    drive_from,
    fixes_of,
    load_drive,
    path_of,
    programmed,
    readings_of,
    reported,
    sense,
)

W = 7.292115e-5  # rad/s, WGS 84
A, F = 6378137.0, 1 / 298.257223563
DRIVES = catalogue.ids("trajectories")


def still(start: Start, duration: float) -> Path:
    """Nothing changes: speed, heading, climb and roll of the start."""
    values = (start.speed, start.heading, start.climb, start.roll)
    return Path(start, *([Change(duration, v)] for v in values))


def winding() -> Path:
    """Every value changes, at times of its own."""
    start = Start(-33 * DEG, 2.6, 400.0, 250 * DEG, 15.0, 2 * DEG, -5 * DEG)
    return Path(
        start,
        [Change(20.0, 40.0), Change(30.0, 10.0), Change(10.0, 0.0)],
        [Change(13.7, 300 * DEG), Change(46.3, 100 * DEG)],
        [Change(31.1, -4 * DEG), Change(28.9, 3 * DEG)],
        [Change(10.0, 20 * DEG), Change(50.0, -20 * DEG)],
    )


# --- smooth changes


def test_a_change_passes_where_the_binomial_says():
    # the ninth-degree step is the chance of 5 or more of 9: at 1/4 12826/262144, at 1/2 a half
    curve = smooth(2.0, [Change(8.0, 6.0), Change(4.0, 5.0)])
    assert curve(2.0) == pytest.approx(2 + 4 * 12826 / 262144, abs=1e-14)
    assert curve(4.0) == pytest.approx(4.0, abs=1e-14)
    assert curve([0.0, 8.0, 12.0]) == pytest.approx([2.0, 6.0, 5.0], abs=1e-12)


def test_four_derivatives_vanish_where_changes_meet():
    curve = smooth(2.0, [Change(8.0, 6.0), Change(4.0, 5.0)])
    for order in range(1, 5):
        # of the size of eps times the largest coefficients, some 1e3
        assert curve.derivative(order)([0.0, 8.0, 12.0]) == pytest.approx(0, abs=1e-10)
    assert abs(curve.derivative(5)(8.0)) > 1e-2  # the fifth does not: C4 and no more


# --- closed forms


@pytest.mark.parametrize(
    ("latitude", "north", "up", "g"),
    [(48.5, 9.96651, 11.26509, 9.8093587), (-33, 12.61450, -8.19195, 9.7956607)],
)
def test_at_rest_it_feels_the_hand_numbers(latitude, north, up, g):
    for heading, rate in ((0.0, [north, up, 0.0]), (90.0, [0.0, up, -north])):
        motion = still(Start(latitude * DEG, heading=heading * DEG), 10.0).at(np.array([0.0, 7.0]))
        # methods.md section 0 gives five decimals of deg/h and seven of g
        assert motion.w_ib_b / DEG_PER_HOUR == pytest.approx(np.array([rate] * 2), abs=6e-6)
        assert motion.f_b == pytest.approx(np.array([[0, g, 0]] * 2), abs=6e-8)


def test_east_along_the_equator_weighs_less():
    # Eotvos: f = g - 2 W v - v^2/a; the rate is W + v/a about north, which is -Z1 when X1 is east
    v = 250.0
    motion = still(Start(0.0, heading=np.pi / 2, speed=v), 60.0).at(np.array([0.0, 60.0]))
    f, w = 9.7803253359 - 2 * W * v - v**2 / A, W + v / A
    assert motion.f_b == pytest.approx(np.array([[0, f, 0]] * 2), abs=1e-12)
    assert motion.w_ib_b == pytest.approx(np.array([[0, 0, -w]] * 2), abs=1e-17)
    assert motion.longitude[1] == pytest.approx(v * 60 / A, abs=1e-15)


def test_a_course_north_is_held_against_coriolis():
    # on the rotating Earth 2 W v sin(lat) to the west holds it on course; latitude grows by the
    # meridian's radius
    v = 100.0
    start = Start(45 * DEG, speed=v)
    motion = still(start, 60.0).at(np.array([0.0, 60.0]))
    e2 = F * (2 - F)
    meridian = A * (1 - e2) / (1 - e2 / 2) ** 1.5
    east = motion.C_nb[0].apply(motion.f_b[0])[1]
    assert east == pytest.approx(-2 * W * v * np.sin(45 * DEG), abs=1e-12)
    # the meridian's radius grows by 1 part in 1e5 over 6 km: second order in the step, 1e-10 rad
    assert motion.latitude[1] - 45 * DEG == pytest.approx(v * 60 / meridian, rel=2e-5)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_circle_about_the_pole_turns_about_the_axis(sign):
    # in inertial space: radius p, rate W + v/p about the axis; f = -rate^2 p - gravitation, and
    # gravitation is gravity with the centrifugal W^2 p taken out
    latitude, v = sign * 89.9 * DEG, 300.0
    path = still(Start(latitude, heading=np.pi / 2, speed=v), 100.0)
    motion = path.at(np.array([0.0, 40.0, 100.0]))
    s, c = np.sin(latitude), np.cos(latitude)
    p = A / np.sqrt(1 - F * (2 - F) * s**2) * c
    rate = W + v / p
    inward = (rate**2 - W**2) * p  # toward the axis, level with the equator
    # n components: the axis is (c, 0, -s); outward is (-s, 0, -c)
    f_n = np.array([s * inward, 0.0, c * inward - 9.8321849])
    assert motion.latitude == pytest.approx(latitude, abs=1e-14)
    assert motion.C_nb.apply(motion.w_ib_b) == pytest.approx(
        np.array([rate * np.array([c, 0, -s])] * 3), rel=1e-12, abs=1e-15
    )
    # gravity 0.1 deg from the pole is less than the polar one by 5.2e-2 * c^2 = 1.6e-7
    assert motion.C_nb.apply(motion.f_b) == pytest.approx(np.array([f_n] * 3), abs=2.5e-7)


def test_attitude_is_heading_climb_and_roll():
    path = still(Start(0.3, heading=30 * DEG, climb=10 * DEG, roll=20 * DEG), 1.0)
    x1, y1, z1 = path.at(np.zeros(1)).C_nb[0].as_matrix().T
    c = np.cos(10 * DEG)
    assert x1 == pytest.approx([c * np.cos(30 * DEG), c * 0.5, -np.sin(10 * DEG)], abs=1e-15)
    assert -y1[2] == pytest.approx(c * np.cos(20 * DEG), abs=1e-15)
    assert z1[2] == pytest.approx(c * np.sin(20 * DEG), abs=1e-15)  # Y1 rolled toward the right


# --- integrating back


def test_place_velocity_and_attitude_are_each_others_derivatives():
    path, h = winding(), 1e-3
    t = np.array([3.0, 17.2, 33.3, 44.0])
    before, now, after = (path.at(t + k * h) for k in (-1, 0, 1))
    # second order: h^2/6 times jerk of some 5 m/s^3, and rounding of 6e6 m over h
    assert (after.r_e - before.r_e) / (2 * h) == pytest.approx(now.v_e, abs=3e-6)
    turn = (before.C_nb.inv() * after.C_nb).as_rotvec() / (2 * h)
    e = np.array([np.cos(now.latitude), 0 * t, -np.sin(now.latitude)]).T * W
    transport = (
        np.cross(np.array([0, 0, 1.0]), now.v_n) / -A
    )  # of n over the sphere: 1e-7 rad/s off
    transport[:, 2] = -now.v_n[:, 1] / A * np.tan(now.latitude)
    w_nb = now.w_ib_b - now.C_nb.apply(e + transport, inverse=True)
    assert turn == pytest.approx(w_nb, abs=2e-7)


def test_means_integrate_back_in_the_earths_frame():
    # another way, sharing nothing: Rodrigues steps, ECEF mechanisation, trapezoids
    path, rate = winding(), 200
    sensed = sense(path, rate)
    start, end = path.at(np.array([0.0])), path.at(np.array([path.duration]))
    C = C_ne(start).T @ start.C_nb[0].as_matrix()
    r, v, h = start.r_e[0], start.v_e[0], 1 / rate
    earth = np.array([0.0, 0.0, W])
    half = Rotation.from_rotvec(-earth * h / 2).as_matrix()
    turns = Rotation.from_rotvec(sensed.w_ib_b * h).as_matrix()
    halves = Rotation.from_rotvec(sensed.w_ib_b * h / 2).as_matrix()
    coriolis = np.linalg.inv(np.eye(3) + skew(earth) * h)  # implicit midpoint
    for k, f in enumerate(sensed.f_b):
        force = half @ C @ halves[k] @ f + plumb(r + v * h / 2)
        after = coriolis @ ((np.eye(3) - skew(earth) * h) @ v + force * h)
        r, v, C = r + (v + after) * h / 2, after, half @ half @ C @ turns[k]
    there = C_ne(end).T @ end.C_nb[0].as_matrix()
    turned = Rotation.from_matrix(C @ there.T).magnitude()
    # coning of 5 ms samples (w x w') h^2/12, with w x w' some 0.03 rad^2/s^3 at most: below
    # 6e-8 rad/s, of either sign over the 60 s (measured: 3e-7 in all at 10 ms)
    assert turned < 3e-7
    assert v == pytest.approx(end.v_e[0], abs=1e-4)
    assert r == pytest.approx(end.r_e[0], abs=3e-3)


def C_ne(motion) -> np.ndarray:
    """n from e at one instant, written out."""
    s, c = np.sin(motion.latitude[0]), np.cos(motion.latitude[0])
    sl, cl = np.sin(motion.longitude[0]), np.cos(motion.longitude[0])
    return np.array([[-s * cl, -s * sl, c], [-sl, cl, 0.0], [-c * cl, -c * sl, -s]])


def plumb(r: np.ndarray) -> np.ndarray:
    """Gravity in e, latitude by plain iteration."""
    level, e2 = np.hypot(r[0], r[1]), F * (2 - F)
    latitude = np.arctan2(r[2], level * (1 - e2))
    prime = A
    for _ in range(8):
        prime = A / np.sqrt(1 - e2 * np.sin(latitude) ** 2)
        latitude = np.arctan2(r[2] + e2 * prime * np.sin(latitude), level)
    up = np.array(
        [np.cos(latitude) * r[0] / level, np.cos(latitude) * r[1] / level, np.sin(latitude)]
    )
    height = level * up[:2] @ r[:2] / level + r[2] * up[2] - A**2 / prime
    return -normal_gravity(latitude, height) * up


def test_means_are_exact_over_unaligned_knots():
    # against ten times finer quadrature that is cut at the knots as well; and knots within samples
    path = winding()
    edges = np.linspace(0, 60, 60 * 50 + 1)
    fine = np.unique(np.concatenate([np.linspace(0, 60, 60 * 500 + 1), path.knots]))
    coarse_w, coarse_f = path.means(edges)
    w, f = (np.cumsum(x * np.diff(fine)[:, None], axis=0) for x in path.means(fine))
    last = np.searchsorted(fine, edges[1:] - 1e-9)
    for coarse, summed in ((coarse_w, w), (coarse_f, f)):
        means = np.diff(summed[last - 1], axis=0, prepend=0) * 50
        assert coarse == pytest.approx(means, abs=2e-10)  # rounding of sums of 600 m/s times 50


def test_blocks_of_quadrature_join():
    path = still(Start(0.5, speed=10.0), 300.0)
    edges = np.linspace(0, 300, 300 * 100 + 1)  # more than one chunk
    w, f = path.means(edges)
    assert len(w) == len(f) == 30000
    # 3 km north: gravity grows by 0.0519 sin(2 lat) 4.7e-4 = 2.05e-5, and no step where chunks join
    assert np.ptp(f[:, 1]) == pytest.approx(0.0519 * np.sin(1.0) * 3000 / 6.36e6, rel=0.02)
    assert np.abs(np.diff(f[:, 1])).max() < 2 * np.ptp(f[:, 1]) / len(f)


# --- refusals of paths


def test_paths_say_what_is_wrong():
    with pytest.raises(StandError, match="durations differ"):
        Path(Start(0.5), [Change(1.0, 0.0)], [Change(2.0, 0.0)], [Change(1.0, 0)], [Change(1.0, 0)])
    with pytest.raises(StandError, match="of a pole"):
        still(Start(89.9 * DEG, speed=300.0), 60.0)


# --- drives


@pytest.mark.parametrize("name", DRIVES)
def test_every_drive_of_the_catalogue_can_be_driven(name):
    drive = load_drive(name)
    assert drive.title
    assert drive.text
    motion = drive.path.at(np.linspace(0, drive.path.duration, 200))
    assert np.linalg.norm(motion.f_b, axis=1).max() < 3 * 9.81
    assert len(drive.satellite.times(drive.path.duration)) > 50


TEXT = """
title = "A drive"
description = "For tests."
[start]
latitude_deg = 48.5
speed_m_s = 20
[[leg]]
label = "weaves"
duration_s = 40
weave_deg = 30
weaves = 2
[[leg]]
label = "turn"
duration_s = 20
turn_deg = 90
speed_m_s = 10
[satellite]
interval_s = 2
outages_s = [[10, 20]]
"""


def drive(text: str = TEXT):
    return drive_from(catalogue.Source("own", "own.toml", text))


def test_a_drive_does_as_it_says():
    path = drive().path
    t = np.array([0.0, 5.0, 15.0, 25.0, 35.0, 40.0, 60.0])
    x1 = path.at(t).C_nb.apply([1.0, 0.0, 0.0])
    heading = np.arctan2(x1[:, 1], x1[:, 0]) / DEG
    assert heading == pytest.approx([0, 30, -30, 30, -30, 0, 90], abs=1e-9)
    speed = np.linalg.norm(path.at(t).v_n, axis=1)
    assert speed == pytest.approx([20] * 6 + [10], abs=1e-9)


def test_legs_keep_what_they_do_not_name():
    legs = [Leg(label="a", duration_s=10, climb_deg=5, speed_m_s=3), Leg(label="b", duration_s=10)]
    motion = path_of(Start(0.1), legs).at(np.array([20.0]))
    assert motion.v_n[0] == pytest.approx([3 * np.cos(5 * DEG), 0, -3 * np.sin(5 * DEG)], abs=1e-12)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("weaves = 2", "weaves = 2\nturn_deg = 10", "turns or weaves"),
        ("weaves = 2", "", "both or neither"),
        ("[[10, 20]]", "[[20, 10]]", "must end after it begins"),
        ("duration_s = 20", "duration_s = 0", "duration_s = 0"),
        ("interval_s = 2", "interval_s = 100", "fewer than 2 fixes"),
        ("latitude_deg = 48.5", "latitude_deg = 95", "latitude_deg"),
        ("speed_m_s = 20", "sped_m_s = 20", "speed_m_s"),
    ],
)
def test_a_wrong_drive_is_refused_in_one_line(old, new, said):
    with pytest.raises(StandError, match=said) as caught:
        drive(TEXT.replace(old, new, 1))
    assert str(caught.value).startswith("own.toml")
    assert "\n" not in str(caught.value)


def test_a_drive_into_a_pole_names_its_file():
    with pytest.raises(StandError, match=r"own.toml: path: comes within 6 km of a pole"):
        drive(TEXT.replace("48.5", "89.89").replace("speed_m_s = 20", "speed_m_s = 900"))


def test_outages_leave_gaps():
    satellite = drive().satellite
    assert satellite.times(30.0).tolist() == [0, 2, 4, 6, 8, 20, 22, 24, 26, 28, 30]
    assert SatelliteEntry().times(3.0).tolist() == [0, 1, 2, 3]


def test_fixes_err_as_stated():
    # white: chi-square of all components; drift: its variance, and correlation exp(-1/5) a step on
    satellite = SatelliteEntry(
        interval_s=0.02, position_noise_m=5, velocity_noise_m_s=0.05, position_drift_m=100,
        velocity_drift_m_s=1, drift_time_s=0.1,
    )  # fmt: skip
    path = still(Start(0.7, speed=10.0), 60.0)
    fixes = fixes_of(path, satellite, np.random.default_rng(4))
    truth = path.at(fixes.t)
    for errors, white, drift in (
        (fixes.position - truth.r_e, 5, 100),
        (fixes.velocity - truth.v_e, 0.05, 1),
    ):
        n = len(errors)
        # variance of a variance of correlated values: (1 + r^2)/(1 - r^2) = 5.1 times 2/n; 5 sigma
        assert errors.var() == pytest.approx(white**2 + drift**2, rel=5 * np.sqrt(10.2 / (3 * n)))
        step = (errors[1:] * errors[:-1]).mean() / drift**2
        assert step == pytest.approx(np.exp(-0.2), abs=5 * np.sqrt(10.2 / (3 * n)))
    only = fixes_of(path, SatelliteEntry(interval_s=0.1), np.random.default_rng(4))
    normal = ((only.position - path.at(only.t).r_e) / 5).ravel()
    assert kstest(normal, "norm").pvalue > 1e-3
    assert only.position_sigma == 5
    assert only.velocity_sigma == 0.05


def test_the_same_seed_gives_the_same_fixes():
    path = drive().path
    first, again, other = (
        fixes_of(path, SatelliteEntry(), np.random.default_rng(s)).position for s in (1, 1, 2)
    )
    assert first.tobytes() == again.tobytes()
    assert first.tobytes() != other.tobytes()


def test_a_programmed_start_is_wrong_by_its_sigma():
    path = still(Start(0.7, heading=1.0), 1.0)
    true = path.at(np.zeros(1)).C_nb[0]
    rng = np.random.default_rng(8)
    errors = np.array([(programmed(path, 0.01, rng) * true.inv()).as_rotvec() for _ in range(400)])
    low, high = chi2.ppf([5e-4, 1 - 5e-4], 1200)
    assert low < np.sum(errors**2) / 0.01**2 < high


def test_an_ideal_unit_reports_what_is_felt():
    path = drive().path
    sensed = sense(path, 50)
    readings = readings_of(reported(sensed, Imu(load_imu("ideal"), 1, 50)))
    assert readings.t == pytest.approx(np.arange(1, 3001) / 50, abs=1e-12)
    assert readings.f_b == pytest.approx(sensed.f_b, abs=1e-13)
    assert readings.w_ib_b == pytest.approx(sensed.w_ib_b, abs=1e-16)
