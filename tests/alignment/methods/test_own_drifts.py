"""Whose a drift is: the base's that turns, or the accelerometers', or the gyros'.

A unit at rest, X1 north, 300 s at 10 Hz, with white noise of good ring lasers; what settles
does so by exp(-t / 30 s). Small turns are written by hand: gyros feel their rate, accelerometers
gravity's share of their angle.
"""

from dataclasses import replace
from math import cos, radians, sin

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from alignment import Dwell, ImuReadings, Options, Priors, Site
from alignment.errors import AlignmentError
from alignment.methods.fine import fine
from alignment.methods.inertial import block_of, inertial, laid, own_parts, quieter
from alignment.methods.triad import triad
from alignment.methods.two_gyro import two_gyro
from alignment.noise import drift_of
from alignment.strapdown import carry

W, G, LAT = 7.292115e-5, 9.8123, radians(51.0)  # rad/s, m/s^2
HERE = Site(LAT, local_gravity=G)
HZ, SPAN, TAU = 10, 300.0, 30.0
ARW, VRW = 2e-7, 1e-5  # rad/sqrt(s): 0.0007 deg/rt-h; m/s/sqrt(s)
SETTLED = 30e-6 * G  # m/s^2: 30 ug, 6 arc seconds


def readings(seed, base=0.0, accel=0.0, gyro=0.0, straight=0.0, arw=ARW):
    """At rest, X1 north, Y1 up, Z1 east; `base` [m/s^2 of gravity's share along X1] and `accel`
    settle, `gyro` [rad/s] about Z1 too; `straight`: accelerometer X1 from end to end."""
    rng, n = np.random.default_rng(seed), round(SPAN * HZ)
    t = np.arange(1, n + 1) / HZ
    settling = np.exp(-(t - 0.5 / HZ) / TAU)
    w = np.tile([W * cos(LAT), W * sin(LAT), 0.0], (n, 1))
    f = np.tile([0.0, G, 0.0], (n, 1))
    # Z1 east: a turn by a about it takes Y1 away from X1, up has sin(a) along X1
    f[:, 0] += (base + accel) * settling + straight * (t / SPAN - 0.5)
    w[:, 2] += base / G * (-settling / TAU) + gyro * settling
    w += arw * np.sqrt(HZ) * rng.normal(size=w.shape)
    f += VRW * np.sqrt(HZ) * rng.normal(size=f.shape)
    return ImuReadings(t, w, f)


def parts_of(r):
    carried = carry(r, block_of(r))
    matched, noise, _ = laid(r, carried, HERE, Priors())
    return own_parts(carried, matched, noise, drift_of(r.w_ib_b))


@pytest.mark.parametrize("sensor", ["gyro", "accel"])
def test_noise_of_one_sensor_that_a_spectrum_made_too_large(sensor):
    """Eighteen velocities tell a variance to a third: within a factor of 2 of the truth is 3 sigma.

    Where the other's is a thousand times less, what the curve holds is all this one's.
    """
    told = {"gyro": ("gyro", 3e-6), "accel": ("accel", 1e-3)}[sensor]
    rng, n = np.random.default_rng(4), round(SPAN * HZ)
    r = readings(1, arw=0.0)
    own = told[1] * np.sqrt(HZ) * rng.normal(size=(n, 3))
    w, f = (r.w_ib_b + own, r.f_b) if sensor == "gyro" else (r.w_ib_b, r.f_b + own)
    r = ImuReadings(r.t, w, f)
    carried = carry(r, block_of(r))
    matched, noise, _ = laid(r, carried, HERE, Priors())
    true = replace(noise, gyro=np.full(3, 1e-9), accel=np.full(3, VRW), jitter=0.0)
    true = replace(true, **{sensor: np.full(3, told[1])})
    found = quieter(replace(true, **{sensor: 30 * getattr(true, sensor)}), carried, matched)
    np.testing.assert_allclose(np.log2(getattr(found, sensor) / told[1]), 0.0, atol=1.0)


def yaw_of(method, r):
    """Yaw, which is zero in truth, and its sigma [rad]."""
    (one,) = method([Dwell("p", 0.0, SPAN, r)], HERE, Options())
    assert one.angles is not None
    assert one.sigmas is not None
    return (one.angles[1] + np.pi) % (2 * np.pi) - np.pi, one.sigmas[1]


def test_a_base_that_turns_is_no_drift_of_accelerometers():
    """Their own part is what the noise of the gyros leaves open: 0.0007 deg/rt-h wanders by
    ``ARW sqrt(T/12)``, 0.2 arc seconds, where the base turns by 6 and bends by 1."""
    parts = np.array([parts_of(readings(seed, base=SETTLED)) for seed in range(4)])
    assert np.all(parts < 0.4), parts


def test_accelerometers_that_settle_do_so_by_themselves():
    """And feign a turn of heading that is stated, though what settles early is no ramp: it was
    six sigmas off."""
    parts, squares = [], []
    for seed in range(4):
        r = readings(seed, accel=SETTLED)
        parts.append(parts_of(r)[1])
        squares.append(np.divide(*yaw_of(inertial, r)) ** 2)
    assert np.all(np.array(parts) > 0.7), parts
    assert 0.12 < np.mean(squares) < 2.8  # chi-square of 4 degrees of freedom, 95 %


def test_a_straight_drift_of_accelerometers_is_theirs():
    """Nothing bends, and heading takes it up whole: ``d/(g W T cos lat)``, 0.12 deg of 30 ug."""
    r = readings(0, straight=SETTLED)
    assert parts_of(r)[1] > 0.99
    _, sigma = yaw_of(inertial, r)
    assert sigma > 0.95 * SETTLED / (G * W * SPAN * cos(LAT))  # as its fit finds it


def test_gyros_that_drift_do_so_by_themselves():
    drift = radians(0.2) / 3600
    for seed in range(4):
        assert parts_of(readings(seed, gyro=drift))[0] > 0.8


@pytest.mark.parametrize("method", [inertial, fine])
def test_heading_is_as_sure_as_what_turned_lets_it_be(method):
    """What accelerometers feign is stated, and what turned the base is not, by half at most."""
    sigmas = {}
    for name in ("base", "accel"):
        off, sigmas[name] = yaw_of(method, readings(1, **{name: SETTLED}))
        assert abs(off) < 3 * sigmas[name], name
    assert sigmas["base"] < 0.5 * sigmas["accel"]


def mean_of(values, count=20):
    """Means of so many samples each, held for as many: what a slow unit's log is."""
    means = values.reshape(-1, count, 3).mean(axis=1)
    return np.repeat(means, count, axis=0)


@pytest.mark.parametrize("method", [triad, two_gyro, inertial, fine])
def test_samples_that_are_means_held_for_long_make_nothing_surer(method):
    """The mean of 300 s has the same noise. Twelve velocities tell a variance to 40 %, sigma to
    20 %: three of them. The spectrum alone made it 0.05 to 0.5 of what it is."""
    r = readings(11)
    held = ImuReadings(r.t, mean_of(r.w_ib_b), mean_of(r.f_b))
    off, sigma = yaw_of(method, held)
    assert 0.6 < sigma / yaw_of(method, r)[1] < 1.6
    assert abs(off) < 3 * sigma


def test_accelerometers_that_jump_tell_the_filter_no_heading():
    """Seven steps of up to 50 ug, as a compensation makes: heading was 8 sigmas off."""
    r = readings(0)
    step = np.floor(np.arange(len(r)) * 7 / len(r))
    jumps = np.outer(2 * ((step * 0.61) % 1) - 1, 50e-6 * G * np.array([1.0, 0.5, -1.0]))
    off, sigma = yaw_of(fine, ImuReadings(r.t, r.w_ib_b, r.f_b + jumps))
    assert abs(off) < 3 * sigma


def test_a_bias_along_north_tilts_the_match_by_what_is_stated():
    """0.3 deg/h: the match lays the record's middle right, the end is off by half of what the bias
    turned, 45 arc seconds about north."""
    r, truth = readings(2), np.array([[1.0, 0, 0], [0, 0, 1.0], [0, -1.0, 0]])
    by_hand = radians(0.3) / 3600 * SPAN / 2
    w = r.w_ib_b + np.array([radians(0.3) / 3600, 0.0, 0.0])
    (one,) = inertial([Dwell("p", 0.0, SPAN, ImuReadings(r.t, w, r.f_b))], HERE, Options())
    assert one.C_nb is not None
    assert one.covariance is not None
    off = Rotation.from_matrix(one.C_nb.as_matrix() @ truth.T).as_rotvec()
    assert abs(off[0]) == pytest.approx(by_hand, rel=0.05)  # noise: 1 arc second
    assert np.sqrt(one.covariance[0, 0]) == pytest.approx(by_hand, rel=0.05)
    assert np.sqrt(one.covariance[1, 1]) < 0.2 * by_hand


@pytest.mark.parametrize("method", [inertial, fine])
def test_gyros_that_say_nothing_tell_no_heading(method):
    r = readings(2)
    _, sigma = yaw_of(method, ImuReadings(r.t, np.zeros_like(r.w_ib_b), r.f_b))
    assert sigma > radians(100)


@pytest.mark.parametrize("method", [inertial, fine, two_gyro])
def test_a_bias_that_hides_half_of_the_earth_makes_heading_half_as_sure(method):
    """Gyros read half of the Earth's level rate: by hand, noise turns that by twice as much."""
    sigmas = []
    for part in (0.0, 0.5):
        r = readings(2, arw=50 * ARW)  # quieter ones see what second order of so large a bias does
        w = r.w_ib_b - np.array([part * W * cos(LAT), 0.0, 0.0])
        sigmas.append(yaw_of(method, ImuReadings(r.t, w, r.f_b))[1])
    assert sigmas[1] / sigmas[0] == pytest.approx(2.0, rel=0.1)  # as finely as noise is told


@pytest.mark.parametrize(("method", "bias"), [(inertial, 0.2), (inertial, 10.0), (fine, 0.2)])
def test_a_bias_along_north_neither_tilts_nor_turns_the_answer(method, bias):
    """Of gyros of unlike noise, 1, 1 and 2 times 0.0007 deg/rt-h, 0.7 rad off north, it took the
    filter's heading 38 sigmas off and its tilt about north 18, the match's 64: 0.2 deg/h, of which
    300 s make 60 arc seconds. Nor does the Earth turn with it: of 10 deg/h by 0.02 rad.

    Chi-square of 12 degrees of freedom within one in 1000 on either side.
    """
    c, s = cos(0.7), sin(0.7)
    P = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])  # to X1, Y1, Z1 from north, up, east
    truth = np.array([[1.0, 0, 0], [0, 0, 1.0], [0, -1.0, 0]]) @ P.T
    north, squares = np.array([radians(bias) / 3600, 0.0, 0.0]), []
    for seed in range(12):
        r, rng = readings(seed), np.random.default_rng(seed + 50)
        w = (r.w_ib_b + north) @ P.T
        w[:, 2] += np.sqrt(3 * HZ) * ARW * rng.normal(size=len(r))
        one = method([Dwell("p", 0.0, SPAN, ImuReadings(r.t, w, r.f_b @ P.T))], HERE, Options())[0]
        assert one.C_nb is not None
        assert one.covariance is not None
        error = Rotation.from_matrix(one.C_nb.as_matrix() @ truth.T).as_rotvec()
        squares.append(error**2 / np.diag(one.covariance))
    found = np.sum(squares, axis=0)
    assert np.all((found > 2.2) & (found < 32.9)), found


@pytest.mark.parametrize("method", [inertial, fine])
@pytest.mark.parametrize(
    ("bias", "told"), [(0.2, "seems 1.02 of"), (-3.0, "seems 0.68 of"), (0, "")]
)
def test_what_shows_of_a_bias_is_said_of_what_does_not(method, bias, told):
    """By hand: ``W cos lat`` is 9.465 deg/h at 51 deg, which 0.2 and -3 make 1.021 and 0.683 of
    itself; as much to the east turns heading by 1.2 and 18 deg."""
    r = readings(2)
    w = r.w_ib_b + np.array([radians(bias) / 3600, 0.0, 0.0])
    (one,) = method([Dwell("p", 0.0, SPAN, ImuReadings(r.t, w, r.f_b))], HERE, Options())
    flags = [flag for flag in one.flags if "level rate seems" in flag]
    assert bool(flags) == bool(told)
    assert all(told in flag for flag in flags)


@pytest.mark.parametrize("method", [inertial, fine])
def test_a_dither_that_differs_from_axis_to_axis_turns_no_heading(method):
    """Jitter of 1, 1 and 10 arc seconds about X1, Y1, Z1, which stand 0.7 rad off north: a bias of
    0.2 deg/h along north is noise of none, and took the filter's heading 1.5 deg off, by 20 to 80
    sigmas. By hand it leaves heading as it is: what is felt across north tells that."""
    c, s = cos(0.7), sin(0.7)
    P = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    for seed in range(3):
        r, rng = readings(seed, arw=2 * ARW), np.random.default_rng(seed + 10)
        jitter = radians(1 / 3600) * rng.normal(size=(len(r) + 1, 3)) * [1.0, 1.0, 10.0]
        north = np.array([radians(0.2) / 3600, 0.0, 0.0])
        w = (r.w_ib_b + north) @ P.T + np.diff(jitter, axis=0) * HZ
        yaw, sigma = yaw_of(method, ImuReadings(r.t, w, r.f_b @ P.T))
        assert abs(yaw + 0.7) < 3 * sigma
        assert sigma < radians(0.2)


SLAM = radians(0.05) * 0.1  # rad: 0.05 deg/s for 0.1 s, which the base did not turn by


@pytest.mark.parametrize("method", [triad, two_gyro, inertial, fine])
def test_a_slam_that_the_base_did_not_follow_is_counted(method):
    """By hand: the mean rate about east is off by ``SLAM/T``, heading by ``SLAM/(T W cos lat)``:
    0.363 deg. To the match of velocity curves a slam at x of the record is a bend, whose order 2
    is ``30 x^2 (1-x)^2`` of that of a constant: 1.9 in mid-record, next to nothing at its ends."""
    by_hand = SLAM / (SPAN * W * cos(LAT))
    assert by_hand == pytest.approx(radians(0.363), rel=0.002)
    for at in (11.0, 150.5, 290.0):
        r = readings(3)
        w = r.w_ib_b.copy()
        w[round(at * HZ), 2] += SLAM * HZ
        off, sigma = yaw_of(method, ImuReadings(r.t, w, r.f_b))
        bend = 30 * (at / SPAN) ** 2 * (1 - at / SPAN) ** 2
        made = {inertial: bend, fine: np.hypot(bend, 1.0)}.get(method, 1.0)
        assert 0.9 * made * by_hand < sigma < (1.5 * made + 0.3) * by_hand, at
        assert abs(off) < 2 * sigma, at


@pytest.mark.parametrize("method", [triad, two_gyro, fine])
def test_gyros_that_settle_early_are_counted(method):
    """0.2 deg/h with 10 s: by hand the mean holds ``0.2 x 10/300``, heading 0.04 deg of it; the
    first sixteenth, 18.75 s, has 0.85 of that."""
    by_hand = radians(0.2) / 3600 * 10.0 / SPAN / (W * cos(LAT))
    r = readings(4, arw=ARW / 4)
    w = r.w_ib_b.copy()
    w[:, 2] += radians(0.2) / 3600 * np.exp(-r.t / 10.0)
    off, sigma = yaw_of(method, ImuReadings(r.t, w, r.f_b))
    assert 0.8 * by_hand < sigma < 2.2 * by_hand
    assert abs(off) < 2 * sigma


@pytest.mark.parametrize(("turn", "told"), [(90.0, "22.5"), (36.0, "")])
def test_a_turn_between_two_rests_has_no_mean_attitude(turn, told):
    """By hand: a step by a amid a record is ``a sqrt(1/4 - 3/16) = a/4`` rms about its line."""
    r = readings(5)
    w = r.w_ib_b.copy()
    w[round(SPAN * HZ) // 2, 1] += radians(turn) * HZ
    dwell = Dwell("p", 0.0, SPAN, ImuReadings(r.t, w, r.f_b))
    if not told:
        assert two_gyro([dwell], HERE, Options())
        return
    with pytest.raises(AlignmentError, match=f"heading turns by {told} deg rms, 10 are allowed"):
        two_gyro([dwell], HERE, Options())
