"""Parts of the fine filter and of the inertial match against numbers written by hand."""

from dataclasses import replace
from math import exp, pi, sqrt
from types import SimpleNamespace

import numpy as np
import pytest
from rocking import Angle, G
from scipy.spatial.transform import Rotation
from test_inertial import STILL, site

from alignment import ImuReadings, Options, Priors
from alignment.errors import NotAtRest
from alignment.information.drift import GaussMarkov
from alignment.methods.fine import (
    Model,
    _Aim,
    _heave_density,
    _is_settled,
    _update_variance,
    error_matrices,
    model_of,
    states_of,
    sway_by_lag,
    update_of,
)
from alignment.methods.inertial import (
    Noise,
    Rest,
    arm_of,
    block_of,
    covariances,
    gravity_doubt,
    gravity_velocity,
    match,
    rest_covariance,
    sway_covariance,
    wander_doubt,
    wander_values,
)
from alignment.methods.rocking_gains import inertial_functional
from alignment.methods.updates import Pass, _root
from alignment.strapdown import carry

NONE = np.zeros(3)
LEVEL = replace(STILL, yaw=Angle(), pitch=Angle(), roll=Angle())


def model(priors: Priors, names=(), walks=(), drifts=(), noise=None, readings=None) -> Model:
    return Model(
        readings=readings or ImuReadings(np.arange(2.0), np.zeros((2, 3)), np.zeros((2, 3))),
        site=site(STILL),
        noise=noise or Noise(NONE, NONE),
        priors=priors,
        names=names,
        walks=walks,
        drifts=drifts,
    )


# --- what the filter holds at first ---------------------------------------------------------------


def test_variances_before_the_first_update():
    """0.3 rad of tilt, 10 of heading, 1 m/s, 1 m: as good as nothing; then what the priors say."""
    errors = [0.09, 0.09, 100.0, *[1.0] * 6]
    told = model(
        Priors(gyro_bias=1e-6, accel_scale=1e-4),
        names=("gyro_bias", "accel_scale"),
        walks=(3e-9, 0.0),
        drifts=(("gyro", GaussMarkov(2e-7, 10.0)),),
    )
    assert told.size == 10 + 3 * 3
    want = [*errors, 0.0, *[1e-12] * 3, *[1e-8] * 3, *[4e-14] * 3]
    np.testing.assert_allclose(told.start, want, rtol=1e-12)
    np.testing.assert_allclose(told.kept(5.0), [*[1.0] * 6, *[exp(-0.5)] * 3], rtol=1e-14)
    added = told.added(np.array([[0.1], [5.0]]))
    by_drift = [4e-14 * (1 - exp(-0.02)), 4e-14 * (1 - exp(-1.0))]
    want = [
        [*[s * 9e-18] * 3, *[0.0] * 3, *[d] * 3] for s, d in zip((0.1, 5.0), by_drift, strict=True)
    ]
    np.testing.assert_allclose(added, want, rtol=1e-12)


@pytest.mark.parametrize(
    ("priors", "free"),
    [
        (Priors(), 1e-4),  # 1 % of gravity's size where no accelerometer constant is stated
        (Priors(gyro_bias=1.0), 1e-4),
        (Priors(accel_bias=1e-9), 0.0),
        (Priors(accel_scale=1e-9), 0.0),
    ],
)
def test_gravitys_size_is_free_where_no_constant_is_stated(priors, free):
    assert model(priors).start[9] == pytest.approx(free)


class _Record:
    """Readings of which the number and the interval count."""

    def __init__(self, interval: float, count: int) -> None:
        self.interval, self.count = interval, count

    def __len__(self) -> int:
        return self.count


@pytest.mark.parametrize(
    ("interval", "count", "update"),
    [(0.01, 1000, 0.1), (0.1, 65536, 0.1), (0.1, 65536 * 3, 0.3), (0.5, 65536, 0.5)],
)
def test_seconds_between_updates(interval, count, update):
    assert update_of(_Record(interval, count)) == pytest.approx(update)


@pytest.mark.parametrize(
    ("span", "block"),
    [(16.0, 0.25), (32.0, 0.5), (100.0, 0.5), (2048.0, 0.5), (4096.0, 1.0)],
)
def test_seconds_of_a_block(span, block):
    """Half a second; a 64th of a record of less than 32 s, a 4096th of one beyond 2048."""
    assert block_of(_Record(0.01, round(span * 100))) == pytest.approx(block)


def test_noise_of_an_update_by_hand():
    """A micrometre, and 100 r^2 N^2 T: mean of squares of 1, 2, 3 e-6 is 14/3 e-12; T 50 s."""
    carried = SimpleNamespace(t=np.array([100.0, 120.0, 150.0]))
    noise = Noise(np.array([1e-6, 2e-6, 3e-6]), NONE)
    assert _update_variance(carried, noise, Priors()) == pytest.approx(1e-12, abs=0)
    want = 1e-12 + 100 * 0.2**2 * 14 / 3 * 1e-12 * 50
    assert _update_variance(carried, noise, Priors(lever_arm=0.2)) == pytest.approx(
        want, rel=1e-12, abs=0
    )


@pytest.mark.parametrize(("leaned", "needed"), [(0.0, True), (0.99, True), (1.01, False)])
def test_noise_along_the_vertical_by_hand(leaned, needed):
    """``T s^2 (50 b^2 + 2/3 g^2 s^2)``: T 20 s, ``s^2 = N^2 T + B^2 T^2`` of N 1e-5, B 2e-6,
    b^2 of 3e-3 m/s^2 and of 4e-4 of g = 10; none beyond a lean of 10 s."""
    s2 = 1e-10 * 20 + (2e-6 * 20) ** 2
    b2 = 3e-3**2 + 4e-3**2
    # two blocks to either side: a variance of a^2 in one axis, half of that of each of two
    a = leaned * 10 * sqrt(2 * s2) * 10
    dv = np.array([[a, 0.0, 10.0], [-a, 0.0, 10.0]]) * [[8.0], [12.0]]
    carried = SimpleNamespace(t=np.array([100.0, 108.0, 120.0]), spans=np.array([8.0, 12.0]), dv=dv)
    priors = Priors(accel_bias=3e-3, accel_scale=4e-4, gyro_instability=2e-6)
    found = _heave_density(carried, Noise(np.full(3, 1e-5), NONE), priors, 10.0)
    want = 20 * s2 * (50 * b2 + 2 / 3 * 100 * s2) if needed else 0.0
    assert found == pytest.approx(want, rel=1e-12, abs=0)


@pytest.mark.parametrize(("turned", "folded"), [(0.0098, True), (0.0102, False)])
def test_what_rocks_has_triads_of_its_own(turned, folded):
    """0.01 rad of turn; a case that is turned as a whole stays one where nothing rocks."""
    q = Rotation.from_rotvec([[0.0, 0.0, 0.0], [0.0, turned, 0.0], [0.001, 0.0, 0.0]]).as_quat()
    priors = Priors(gyro_misalignment=1e-3, accel_non_orthogonality=2e-3)
    rested = SimpleNamespace(q=q, spans=np.ones(2), dtheta=np.zeros((2, 3)), dv=np.zeros((2, 3)))
    found = states_of(priors, rested, site(STILL))
    assert (found.gyro_misalignment == 0) == folded
    assert (found.accel_non_orthogonality == 0) == folded
    assert (found.accel_bias > 0) == folded  # of g times what is astray


# --- when it is content ---------------------------------------------------------------------------


def test_innovations_as_large_as_their_sigmas_allow():
    """Of 24 updates 72 numbers: a mean square of ``1 + 5 sqrt(2/72)`` = 1.8333, 5.5 of three."""
    zero = np.zeros((24, 3))
    for misfit, doubted in ((3.0, False), (5.49, False), (5.51, True)):
        run = Pass(zero, zero, zero, zero, zero, np.full(24, misfit))
        assert run.inconsistent == doubted


@pytest.mark.parametrize(
    ("turn", "bias", "sigma", "settled"),
    [
        (0.0099, 0.0, 0.5, True),
        (0.0101, 0.0, 0.5, False),
        (0.0, 0.00099, 0.5, True),  # in 10 s
        (0.0, 0.00101, 0.5, False),
        (0.0099, 0.00099, 0.5, True),  # the larger counts, not their sum
        (0.0166, 0.0, 0.53, True),  # rad of heading, 30.4 deg: tilt alone counts, 0.6 of it
        (0.0167, 0.0, 0.53, False),
        (0.0166, 0.0, 0.52, False),  # 29.8 deg
    ],
)
def test_a_correction_of_a_hundredth_is_settled(turn, bias, sigma, settled):
    """Length of a vector: 0.6 and 0.8 parts of it along two axes, the second heading."""
    x = np.zeros((2, 13))
    x[-1, [0, 2]] = turn * 0.6, turn * 0.8
    x[-1, [10, 11]] = -bias * 0.6, bias * 0.8
    reference = SimpleNamespace(carried=SimpleNamespace(t=np.array([50.0, 60.0])))
    held = model(Priors(gyro_bias=1.0), names=("gyro_bias",), walks=(0.0,))
    heading = np.eye(13)[2] * sigma**2
    run = Pass(x, np.full((2, 13), sigma**2), *(np.zeros(1),) * 4, heading)
    assert _is_settled(held, reference, run) == settled


def test_what_goes_with_a_heading_that_is_not_determined_stays_too():
    """Sigma 1 rad, of covariance 0.02 with tilt north and -0.3 with the fourth: of 2 rad of
    heading 0.04 and -0.6 are its own; with 0.5 rad, 28.6 deg, all is corrected."""
    x = np.zeros((2, 4))
    x[-1] = 0.05, -0.01, 2.0, 0.1
    for sigma, left in ((1.0, [0.01, -0.01, 0.0, 0.7]), (0.5, x[-1])):
        heading = np.array([0.02, 0.0, 1.0, -0.3]) * sigma**2
        run = Pass(x, np.full((2, 4), sigma**2), *(np.zeros(1),) * 4, heading)
        np.testing.assert_allclose(run.left, left, atol=1e-15)


def test_what_a_heading_comes_to_is_aimed_at():
    """-0.6 of a correction left, then nothing: 1/1.6 of it. 0.5 left: twice. The wrong way: all."""
    aim = _Aim()
    assert aim.part(1.0) == 1.0
    assert aim.part(-0.6) == pytest.approx(1 / 1.6)
    # 0.625 of -0.6 was taken: -0.375 of 1.6 ways is all of it, and what is left is rounding
    assert aim.part(-1e-9) == pytest.approx(1 / 1.6, rel=1e-6)
    slow = _Aim()
    slow.part(1.0)
    assert slow.part(0.5) == pytest.approx(2.0)
    assert slow.part(0.001) == pytest.approx(2.0 / 0.998)
    away = _Aim()
    away.part(1.0)
    assert away.part(1.1) == 1.0
    crawling = _Aim()
    crawling.part(1.0)
    assert crawling.part(0.99) == 4.0  # of 100, the most
    leaping = _Aim()
    leaping.part(1.0)
    assert leaping.part(-9.0) == 0.25  # of a tenth, the least


# --- noise of an interval by its samples ----------------------------------------------------------


def test_noise_of_an_interval_is_that_of_its_samples():
    """What each sample of four does to attitude, velocity and place, squared and summed.

    In steps of two samples of 25 ms: the terms in (25 ms/0.1 s)^2 are 2 and 6 % here.
    """
    dt, gyro, accel = 0.025, np.array([1.0, 2.0, 3.0]) * 1e-5, np.array([3.0, 1.0, 2.0]) * 1e-4
    t, w, f, C = LEVEL.readings(0.4, 40.0, 100.0)
    readings = ImuReadings(t, w, f)
    base = carry(readings, 0.1)
    C_ni = C @ Rotation.from_quat(base.q[-1]).as_matrix().T
    push = np.diff(gravity_velocity(base.t, site(LEVEL))[0], axis=0)
    # attitude and velocity of gyros, velocity and place of accelerometers: what is summed exactly
    for sensor, levels, own in (("gyro", gyro, slice(0, 6)), ("accel", accel, slice(3, 9))):
        noise = replace(Noise(NONE, NONE), **{sensor: levels})
        held = model(Priors(), noise=noise, readings=readings)
        steps, _ = error_matrices(held, base, C_ni, push, slice(0, len(base.t)))
        want = np.zeros((9, 9))
        for k in range(4):
            for axis in range(3):
                step = 1e-6 * np.eye(3)[axis]
                moved = [w.copy(), f.copy()]
                moved[sensor == "accel"][k] += step
                other = carry(ImuReadings(t, *moved), 0.1)
                turned = Rotation.from_quat(other.q[1]) * Rotation.from_quat(base.q[1]).inv()
                rows = turned.as_rotvec(), other.v[1] - base.v[1], other.p[0] - base.p[0]
                row = np.concatenate([C_ni @ x for x in rows]) / 1e-6
                want += np.outer(row, row) * levels[axis] ** 2 / dt
        found, want = steps.Q[0][own, own], want[own, own]
        size = np.sqrt(want.diagonal())
        size = np.maximum(size, 1e-3 * size.max())  # gravity pushes nothing along itself
        scale = np.outer(size, size)
        np.testing.assert_allclose(found / scale, want / scale, atol=2e-3)


def test_place_and_attitude_share_what_an_angle_walk_does_to_both():
    """Of attitude ``w(t)``, velocity ``f w`` summed and place summed again: f over T = 0.1 s is D,
    and w, D w/2 and D w T/6 (its mean over the interval) covary as 1, 1/2, 1/6 and 1/3, 1/8, 1/20.
    """
    T, level = 0.1, 1e-5
    t, w, f, C = LEVEL.readings(0.4, 2000.0, 100.0)
    readings = ImuReadings(t, w, f)
    base = carry(readings, T)
    C_ni = C @ Rotation.from_quat(base.q[-1]).as_matrix().T
    push = np.diff(gravity_velocity(base.t, site(LEVEL))[0], axis=0)
    held = model(Priors(), noise=Noise(np.full(3, level), NONE), readings=readings)
    steps, _ = error_matrices(held, base, C_ni, push, slice(0, len(base.t)))
    q = level**2 * T
    by_turn = -np.array([np.cross(push[0], e) for e in np.eye(3)]).T
    assert np.abs(by_turn).max() == pytest.approx(9.81 * T, rel=1e-3)
    walked = {
        (0, 0): np.eye(3), (3, 0): by_turn / 2, (6, 0): by_turn * T / 6,
        (3, 3): by_turn @ by_turn.T / 3, (6, 3): by_turn @ by_turn.T * T / 8,
        (6, 6): by_turn @ by_turn.T * T**2 / 20,
    }  # fmt: skip
    for (row, column), part in walked.items():
        found = steps.Q[0][row : row + 3, column : column + 3] / q
        # steps of 0.5 ms beside 100 ms
        np.testing.assert_allclose(found, part, rtol=0, atol=2e-3 * np.abs(part).max())


# --- what a record at rest shows beside noise -----------------------------------------------------


def test_jitter_and_drifts_of_a_record_at_rest_by_differencing_the_match():
    """A constant and a ramp of each axis move the attitude at the end by so much, squared.

    Of an own drift both are as large; of a longer record's D, of which this is a quarter, the ramp
    is D/4 and the constant 3/4 D/sqrt(12).
    """
    motion = replace(STILL, yaw=Angle(0.4))
    t, w, f, _ = motion.readings(40.0, 10.0, 100.0)
    carried, where = carry(ImuReadings(t, w, f), 0.4), site(motion)
    matched = match(carried, where)
    own = np.array([1e-9, 2e-9, 4e-9, 2e-6, 1e-6, 3e-6])
    wide = np.array([8e-9, 0.0, 1e-9, 4e-6, 80e-6, 0.0])
    ramps = np.array([2e-9, 2e-9, 4e-9, 2e-6, 20e-6, 3e-6])
    constants = np.array([6e-9, 0, 0, 0, 60e-6, 0]) / sqrt(12)
    constants = np.where(constants > 0, constants, own)
    jitter = np.array([1e-12, 4e-12, 9e-12])
    rest = Rest(jitter, own[:3], own[3:], wide, 0.25)
    C_nb = matched.C_ni * Rotation.from_quat(carried.q[-1])
    want = C_nb.as_matrix() @ np.diag(jitter) @ C_nb.as_matrix().T
    alone = rest_covariance(carried, matched, Rest(jitter, NONE, NONE, np.zeros(6), 1.0))
    np.testing.assert_allclose(alone, want, rtol=1e-12, atol=1e-26)
    line = (t - t.mean())[:, None] / 40.0
    for axis in range(6):
        for size, shape in ((constants[axis], np.ones_like(line)), (ramps[axis], line)):
            by = 1e-8 if axis < 3 else 1e-5
            moved = np.concatenate([w, f], axis=1)
            moved[:, axis : axis + 1] += by * shape
            other = carry(ImuReadings(t, moved[:, :3], moved[:, 3:]), 0.4)
            end = match(other, where).C_ni * Rotation.from_quat(other.q[-1])
            slope = (end * C_nb.inv()).as_rotvec() / by
            want += np.outer(slope, slope) * size**2
    found = rest_covariance(carried, matched, rest)
    scale = np.sqrt(np.outer(want.diagonal(), want.diagonal()))
    # sums over blocks of 0.4 s against samples, and second order of the slopes
    np.testing.assert_allclose(found / scale, want / scale, atol=2e-3)


@pytest.mark.parametrize(("part", "said"), [(0.0099, False), (-0.0099, False), (0.0101, True)])
def test_gravity_that_is_off_by_more_than_a_hundredth(part, said):
    v = np.array([[0.0, 0.0, 0.0], [0.0, 6.0, 8.0]]) * (1 + part) * G / 10 * 5
    carried = SimpleNamespace(v=v, t=np.array([100.0, 105.0]))
    assert bool(gravity_doubt(carried, site(STILL))) == said


# --- what sways and wanders ----------------------------------------------------------------------

T = 40.0


@pytest.fixture(scope="module")
def laid_out():
    """A record at rest in blocks of 0.2 s, its match, and what it says of nothing but sway."""
    t, w, f, _ = STILL.readings(T, 10.0, 100.0)
    carried, where = carry(ImuReadings(t, w, f), 0.2), site(STILL)
    matched, none = match(carried, where), Noise(NONE, NONE)
    matched = replace(matched, residual=np.zeros_like(matched.residual))
    return carried, matched, none, arm_of(carried, matched, none, Priors(), where), where


def at_the_ends(carried, matched, where, variances) -> np.ndarray:
    """What displacements of these variances in the first and the last block make of attitude."""
    C_ni = matched.C_ni
    total = np.zeros((3, 3))
    for k in (0, -1):
        for axis in range(3):
            p = carried.p.copy()
            p[k] += 1e-4 * C_ni.inv().apply(np.eye(3)[axis])
            turned = (match(replace(carried, p=p), where).C_ni * C_ni.inv()).as_rotvec() / 1e-4
            total += variances[axis] * np.outer(turned, turned)
    return total


def test_a_sway_is_in_the_covariance_by_its_ends(laid_out):
    """2 mm at 0.5 Hz toward north: 2e-6 m^2, where the record begins and where it ends."""
    carried, matched, none, arm, where = laid_out
    middle = (carried.t[1:] + carried.t[:-1]) / 2 - 100.0
    residual = np.outer(np.cos(pi * middle), [2e-3 * pi, 0.0, 0.0])
    swaying = replace(matched, residual=residual)
    sway = sway_covariance(carried, swaying)
    # blocks of a tenth of a period make 3 % more of it, the first and the last of a period the rest
    np.testing.assert_allclose(sway, np.diag([2e-6, 0, 0]), atol=0.1 * 2e-6)
    found, wander = covariances(carried, swaying, none, Priors(), arm, where)
    want = at_the_ends(carried, matched, where, sway.diagonal())
    size = np.sqrt(want.diagonal())
    size = np.maximum(size, 1e-3 * size.max())
    np.testing.assert_allclose(found / np.outer(size, size), want / np.outer(size, size), atol=0.01)
    # of each order twice the sway, and a square micrometre
    want = np.kron(np.eye(3), 2 * sway + 1e-12 * np.eye(3))
    np.testing.assert_allclose(wander, want, rtol=1e-9, atol=1e-24)


def test_a_prediction_has_the_sway_by_the_same_ends():
    """2 mm toward north and 1 mm toward east, at 0.5 and 0.7 Hz, as perfect sensors feel them."""
    ways = (Angle(amplitude=2e-3, frequency=0.5), Angle(amplitude=1e-3, frequency=0.7))
    t, w, f, _ = replace(STILL, sway=(*ways, Angle())).readings(T, 20.0, 100.0)
    readings, where = ImuReadings(t, w, f), site(STILL)
    carried = carry(readings, block_of(readings))
    matched = match(carried, where)
    # blocks of 0.1 s show 1 % less of them, ends of the record some per cent more or less
    sway = sway_covariance(carried, matched)
    np.testing.assert_allclose(sway, np.diag([2e-6, 0.5e-6, 0]), atol=0.05 * 2e-6)
    stated = Options(priors=Priors(gyro_bias=1e-9))  # else the Earth's rate is of any size
    found = inertial_functional(readings, where, stated).motion
    want = at_the_ends(carried, matched, where, sway.diagonal())
    size = np.sqrt(want.diagonal())
    # what both axes share in this record, and second order
    np.testing.assert_allclose(found / np.outer(size, size), want / np.outer(size, size), atol=0.05)


@pytest.mark.parametrize(("late", "passes"), [(10e-3, True), (1e-6, False), (0.0, False)])
def test_forces_that_come_late_pass_for_sway_by_hand(late, passes):
    """Of 1.136 deg about north at 0.276 Hz gravity pulls ``g c w cos(w t)`` more or less by 10 ms:
    ``g c late/w`` of place, 1.12 mm, half of its square in the mean, and a third of that an axis.
    Of a microsecond 0.1 um are below what an update is good for."""
    c, w = np.radians(1.136), 2 * pi * 0.276
    rocking = replace(STILL, roll=Angle(amplitude=c, frequency=0.276))
    t, rates, forces, _ = rocking.readings(60.0, 20.0, 100.0)
    readings = ImuReadings(t, rates, forces)
    priors = Priors(gyro_bias=1e-7, accel_bias=1e-3, gyro_walk=1e-6, accel_walk=1e-4)
    priors = replace(priors, lever_arm=0.7, accel_later=late)
    noise = Noise(np.full(3, 1e-6), np.full(3, 1e-4))
    own = model_of(readings, site(rocking), noise, priors)
    sway = sway_by_lag(own, carry(readings, 0.1), 1e-9)
    assert sway == pytest.approx((G * c * late / w) ** 2 / 6 if passes else 0.0, rel=0.1)


@pytest.mark.parametrize(("sigmas", "counted"), [(4.95, False), (5.05, True)])
def test_a_slow_sway_counts_where_an_axis_shows_it(laid_out, sigmas, counted):
    """Velocity a P4 of time holds ``a T/9`` of displacement; a micrometre hides root 3 of 5."""
    carried, matched, none, arm, where = laid_out
    x = (carried.t[1:] + carried.t[:-1] - 200.0) / T - 1
    fourth = (35 * x**4 - 30 * x**2 + 3) / 8
    moved = sigmas * sqrt(3) * 1e-6
    slow = replace(matched, residual=np.outer(fourth, [moved * 9 / T, 0.0, 0.0]))
    values = wander_values(carried, slow).reshape(3, 3)
    np.testing.assert_allclose(values[1], [moved, 0.0, 0.0], rtol=1e-3, atol=1e-10)
    found, _ = covariances(carried, slow, none, Priors(), arm, where)
    want = at_the_ends(carried, matched, where, [counted * moved**2, 0.0, 0.0])
    scale = max(want.max(), 1e-20)
    np.testing.assert_allclose(found / scale, want / scale, atol=0.01)


def test_wandering_is_remarked_at_five_sigmas_and_refused_at_ten(laid_out):
    """Of nine numbers: 0.3 m in one of 1 m sigma is 0.1; refused beyond 0.1 m/s alone."""
    carried, matched, _, _, _ = laid_out
    x = (carried.t[1:] + carried.t[:-1] - 200.0) / T - 1
    fourth = (35 * x**4 - 30 * x**2 + 3) / 8

    def doubt(moved: float, sigmas: float) -> tuple[str, ...]:
        slow = replace(matched, residual=np.outer(fourth, [0.0, moved * 9 / T, 0.0]))
        covariance = (moved / 3 / sigmas) ** 2 * np.eye(9)
        return wander_doubt("p", carried, slow, covariance)

    assert doubt(1.0, 4.95) == ()
    (said,) = doubt(1.0, 5.05)
    assert said == "velocity wanders by 0.025 m/s, 5 times what noise makes: slow motion or " + (
        "drifting biases"
    )
    assert doubt(3.9, 20.0)  # 3.9 m in 40 s
    assert doubt(4.1, 9.9)
    with pytest.raises(NotAtRest, match=r"^p: velocity wanders by 0\.102 m/s, 20 times what noise"):
        doubt(4.1, 20.0)


def test_a_root_of_a_variance_that_rounding_left_below_nothing():
    """1, 2 and what is left of 3 metres squared: rounding of the last makes no root of it."""
    P = np.array([[1.0, 1.0, 0.0], [1.0, 4.0, 0.0], [0.0, 0.0, -1.8e-23]])
    S = _root(P)
    np.testing.assert_allclose(S.T @ S, [[1, 1, 0], [1, 4, 0], [0, 0, 0]], rtol=1e-14, atol=1e-15)
    assert not S[:, 2].any()
