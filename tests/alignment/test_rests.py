"""Rests found by themselves: times by hand, slow moves, noise, vibration, gaps, a real log."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from alignment.angles import Sequence, angles_from_C_nb
from alignment.errors import TooShort
from alignment.readings import ImuReadings
from alignment.rests import attitudes, find_stretches

XSENS = Path(__file__).resolve().parents[2].parent / "shared" / "data" / "real" / "imu_tk_xsens"
GRAVITY = 9.81
EARTH = np.array([4.8e-5, 5.5e-5, 0.0])  # rad/s about X1, Y1 at the start: 48.5 deg north
BIAS = np.radians([1.0, -2.0, 0.5])  # rad/s: a consumer unit's
# rest, half a turn about up, rest, a quarter about X1, rest: each (s, deg/s in b)
MOVES = ((30, (0, 0, 0)), (9, (0, 20, 0)), (30, (0, 0, 0)), (9, (10, 0, 0)), (40, (0, 0, 0)))
RESTS = ((0, 30), (39, 69), (78, 118))


def log(moves=MOVES, hz=100, gyro=0.05, accel=0.02, seed=0):
    """Readings of a unit that turns so, Y1 up at first; white noise [deg/s], [m/s^2]."""
    rng = np.random.default_rng(seed)
    C, w, f = Rotation.identity(), [], []
    for seconds, rate in moves:
        n = round(seconds * hz)
        turned = C * Rotation.from_rotvec(np.outer(np.arange(1, n + 1) / hz, np.radians(rate)))
        C = turned[-1]
        w.append(np.radians(rate) + turned.inv().apply(EARTH))
        f.append(turned.inv().apply([0, GRAVITY, 0]))
    w, f = np.concatenate(w), np.concatenate(f)
    n = len(w)
    w = w + BIAS + np.radians(gyro) * rng.normal(size=(n, 3))
    return ImuReadings(np.arange(1, n + 1) / hz, w, f + accel * rng.normal(size=(n, 3)))


def rests_of(readings, **options):
    return [s for s in find_stretches(readings, **options) if s.kind == "rest"]


def check(found, wanted, late=1.0):
    """As many as wanted, none beyond its true ends, nor short of them by more than `late` [s]."""
    assert len(found) == len(wanted)
    for one, (t_from, t_to) in zip(found, wanted, strict=True):
        # a block that straddles the end may hold a sample of the ramp too small to be seen
        assert t_from - 0.51 <= one.t_from <= t_from + late
        assert t_to - late <= one.t_to <= t_to + 0.51


@pytest.mark.parametrize("hz", [1, 5, 100])
def test_rests_between_moves(hz):
    check(rests_of(log(hz=hz)), RESTS, late=max(1.0, 2.1 / hz))


def test_a_steady_turn_about_the_vertical_is_told_with_its_rate():
    (turn,) = (s for s in find_stretches(log()) if s.kind == "turn")
    # 20 deg/s from 30 to 39 s; noise of the mean 0.05/sqrt(800) deg/s
    assert np.degrees(turn.rate) == pytest.approx(20.0, abs=0.01)
    assert turn.t_from == pytest.approx(30.5, abs=0.51)
    assert turn.t_to == pytest.approx(38.5, abs=0.51)


def test_attitudes_from_gravity_and_gyros():
    readings = log()
    found = rests_of(readings)
    angles = np.degrees(
        angles_from_C_nb(Sequence.YAW_PITCH_ROLL, Rotation.concatenate(attitudes(readings, found)))
    )
    # level; turned by 180 about up; then by 90 about X1. Yaw: noise 0.05 deg/s x sqrt(9 s/100)
    off = (angles - [[0, 0, 0], [0, 180, 0], [90, 180, 0]] + 180) % 360 - 180
    assert np.abs(off).max() < 0.1


def test_noise_of_a_consumer_unit():
    # 0.5 deg/s and 31 mg a sample: of a 0.5 s mean 0.07 deg/s and 4.3 mg
    found = rests_of(log(gyro=0.5, accel=0.3))
    check(found, RESTS)
    assert np.degrees(found[0].noise[:3]) == pytest.approx([0.5] * 3, rel=0.06)  # 3/sqrt(2 n)
    assert found[0].noise[3:] == pytest.approx([0.3] * 3, rel=0.06)


@pytest.mark.parametrize("when", [(0, 118), (35, 75)])
def test_vibration(when):
    r = log()
    on = (r.t > when[0]) & (r.t < when[1])
    shaken = r.f_b + 3.0 * np.sin(2 * np.pi * 31 * r.t)[:, None] * on[:, None] * [1, 0.5, 0.7]
    check(rests_of(ImuReadings(r.t, r.w_ib_b, shaken)), RESTS)


def test_coarse_numbers():
    r = log()
    q, a = np.radians(0.0625), 0.0383  # steps of a cheap unit
    rounded = ImuReadings(r.t, np.round(r.w_ib_b / q) * q, np.round(r.f_b / a) * a)
    check(rests_of(rounded), RESTS)


@pytest.mark.parametrize(("rate", "noise"), [(0.1, 1.0), (0.03, 0.1), (0.01, 0.1)])
def test_a_slow_move_is_no_rest(rate, noise):
    # ten degrees, so slowly that no half second shows it
    move = 10 / rate
    r = log(
        ((60, (0, 0, 0)), (move, (rate, 0, 0)), (60, (0, 0, 0))), 20, 0.05 * noise, 0.02 * noise
    )
    # 0.1 deg at this rate pass before means of 8 s or more differ by it, or 16 s at 0.01 deg/s
    check_slow(rests_of(r), [(0, 60), (60 + move, 120 + move)])


def check_slow(found, wanted):
    assert len(found) == len(wanted)
    for one, (t_from, t_to) in zip(found, wanted, strict=True):
        assert abs(one.t_from - t_from) < 9
        assert abs(one.t_to - t_to) < 9


def test_a_bump_and_a_gap_part_a_rest():
    r = log(((60, (0, 0, 0)),))
    f = r.f_b.copy()
    f[2000:2010] += 5.0
    check(rests_of(ImuReadings(r.t, r.w_ib_b, f)), [(0, 20), (20.1, 60)])
    there = (r.t < 20) | (r.t > 35)
    check(rests_of(ImuReadings(r.t[there], r.w_ib_b[there], r.f_b[there])), [(0, 20), (35, 60)])


def test_what_is_shorter_is_left_out():
    assert len(rests_of(log(), shortest=35.0)) == 1
    assert rests_of(log(((2.5, (0, 0, 0)),))) == []


def test_nothing_where_nothing_rests_or_falls():
    r = log(((60, (3, 4, 5)),))
    assert find_stretches(r) == []
    assert find_stretches(ImuReadings(r.t, 0 * r.w_ib_b, 0 * r.f_b)) == []
    with pytest.raises(TooShort, match="1 samples"):
        find_stretches(ImuReadings(r.t[:1], r.w_ib_b[:1], r.f_b[:1]))


@pytest.mark.skipif(not XSENS.exists(), reason="the recording is not here")
def test_the_recording_of_imu_tk():
    """A consumer unit turned by hand: against the published calibration of the same file.

    By the detector of its paper (Tedaldi, Pretto, Menegatti, ICRA 2014: the variance over 1 s,
    seven times that of the first 50 s) 38 rests are longer than 1 s; one of them lasts 2.8 s, which
    is below the 3 s asked for here.
    """
    acc, gyro = (np.loadtxt(XSENS / f"xsens_{name}.mat") for name in ("acc", "gyro"))
    bias, per_m_s2 = np.array([33124.2, 33275.2, 32364.4]), np.array([414.459, 412.01, 414.649])
    f = (acc[:, 1:] - bias) / per_m_s2
    w = (gyro[:, 1:] - [32777.1, 32459.8, 32511.8]) / [4777.96, 4764.21, 4773.66]
    found = find_stretches(ImuReadings(acc[:, 0], w, f))
    assert [s.kind for s in found] == ["rest"] * 37
    # Published misalignments, and the gravity of the place: what they leave of the rests found
    # here is of the size of what they leave of the published ones, 1.0 mm/s^2 rms.
    T = np.array([[1, -0.0033593, -0.00890639], [0, 1, -0.0213341], [0, 0, 1]])
    norms = np.linalg.norm([T @ s.f_b for s in found], axis=1)
    assert np.sqrt(np.mean((norms - 9.81744) ** 2)) < 1.2e-3
    # and none of them creeps: thirds of each agree as far as 0.1 deg of tilt lets them
    for one in found:
        inside = (acc[:, 0] > one.t_from) & (acc[:, 0] <= one.t_to)
        first, *_, last = (part.mean(axis=0) for part in np.array_split(f[inside], 3))
        assert np.linalg.norm(last - first) < np.radians(0.15) * GRAVITY
