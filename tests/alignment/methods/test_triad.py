"""TRIAD and the latitude of a pair of positions, against truths written by hand."""

from dataclasses import replace
from math import cos, degrees, pi, radians, sin, sqrt, tan

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from scipy.stats import norm

from alignment import Dwell, ImuReadings, Options, Priors, Site
from alignment.angles import Sequence, SequenceRule
from alignment.errors import AlignmentError, NotAtRest, PoleError
from alignment.estimate import AttitudeEstimate
from alignment.methods.triad import pair_latitude, triad, triad_attitude, triad_latitude

W = 7.292115e-5  # rad/s
G = 9.81
DEG_H = pi / 180 / 3600
ARW = pi / 180 / 60  # rad/sqrt(s) for 1 deg/rt-h
MILLI_G = 9.80665e-3
FIXED = settings(derandomize=True, deadline=None, max_examples=100)
NOWHERE = Site(None)
N, E, D = np.eye(3)
LEVEL = np.column_stack([N, -D, E])  # X1 north, Y1 up, Z1 east
X1_UP = np.column_stack([-D, -N, E])
X1_DOWN = np.column_stack([D, N, E])


def turn_n(axis, angle):
    """Matrix of a turn about an axis of n, by Rodrigues' formula."""
    x, y, z = axis
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + sin(angle) * K + (1 - cos(angle)) * K @ K


TILTED = turn_n(D, radians(-60)) @ turn_n(E, radians(20)) @ turn_n(N, radians(-35)) @ LEVEL
ATTITUDES = {"level": LEVEL, "X1 up": X1_UP, "X1 down": X1_DOWN, "tilted": TILTED}
attitudes = pytest.mark.parametrize("C", list(ATTITUDES.values()), ids=list(ATTITUDES))
latitudes = pytest.mark.parametrize("latitude", [0.0, 48.5, -33.0, 80.0, -80.0])


def vectors_n(latitude):
    lat = radians(latitude)
    return np.array([W * cos(lat), 0, -W * sin(lat)]), np.array([0, 0, -G])


def rest(C, latitude, seconds=20.0, noise=None, bias=(0,) * 6, label="p", start=100.0, factor=1.0):
    """A dwell at rest at 10 Hz; `noise` (generator, gyro sigma, force sigma) per sample."""
    n = round(seconds * 10)
    w_n, f_n = vectors_n(latitude)
    w = np.tile(factor * (C.T @ w_n) + bias[:3], (n, 1))
    f = np.tile(C.T @ f_n + bias[3:], (n, 1))
    if noise is not None:
        rng, gyro, force = noise
        w = w + gyro * rng.normal(size=(n, 3))
        f = f + force * rng.normal(size=(n, 3))
    t = start + np.arange(1, n + 1) / 10
    return Dwell(label, start, start + seconds, ImuReadings(t, w, f))


def error(estimate, C):
    """Small rotation about n that takes truth to estimate [rad]."""
    return Rotation.from_matrix(estimate.as_matrix() @ C.T).as_rotvec()


# --- the two vectors --------------------------------------------------------------------------


@attitudes
@latitudes
def test_attitude_and_latitude_are_recovered(C, latitude):
    w_n, f_n = vectors_n(latitude)
    for rate, force in ((1.0, 1.0), (1.7, 0.2)):  # any common factor cancels
        w, f = rate * (C.T @ w_n), force * (C.T @ f_n)
        # Rounding over cos 80 deg.
        np.testing.assert_allclose(error(triad_attitude(w, f), C), 0, rtol=0, atol=1e-14)
        assert triad_latitude(w, f) == pytest.approx(radians(latitude), abs=1e-15 * 4)


@FIXED
@given(st.integers(0, 2**32 - 1), st.floats(-1.4, 1.4))
def test_any_attitude_is_recovered(seed, latitude):
    C = Rotation.random(None, np.random.default_rng(seed)).as_matrix()
    w_n, f_n = vectors_n(degrees(latitude))
    np.testing.assert_allclose(
        error(triad_attitude(C.T @ w_n, C.T @ f_n), C), 0, rtol=0, atol=3e-14
    )
    assert triad_latitude(C.T @ w_n, C.T @ f_n) == pytest.approx(latitude, abs=1e-14)


def test_signs_by_hand():
    # Level, nose east: X1 sees east, Z1 south, Y1 up. Rate: cos lat north, sin lat up.
    C = triad_attitude(np.array([0, 0.5, -sqrt(0.75)]), np.array([0, 1.0, 0])).as_matrix()
    np.testing.assert_allclose(C, np.column_stack([E, -D, -N]), rtol=0, atol=1e-15)
    up = np.array([0, 2.0, 0])
    for rate_up, latitude in ((0.5, 30), (-0.5, -30)):
        found = triad_latitude(np.array([0, rate_up, -sqrt(0.75)]), up)
        assert degrees(found) == pytest.approx(latitude, abs=1e-13)  # rounding


def test_no_vertical_and_no_north_are_refused():
    up = np.array([0, G, 0])
    with pytest.raises(AlignmentError, match="specific force is zero: no vertical"):
        triad_attitude(np.array([0, W, 0]), np.zeros(3))
    for w in ([0, W, 0], [0, -W, 0], [0, 0, 0], [0.9e-3 * W, W, 0]):  # within 0.06 deg of up
        with pytest.raises(PoleError, match="mean rate and vertical are collinear"):
            triad_attitude(np.array(w), up)
    triad_attitude(np.array([1.1e-3 * W, W, 0]), up)


# --- first order -----------------------------------------------------------------------------


@attitudes
@pytest.mark.parametrize("latitude", [0.0, 48.5, -33.0])
def test_leading_errors_of_latitude(C, latitude):
    """``(dw_U cos lat - dw_N sin lat)/W + b_N/g``, each alone and signed."""
    lat = radians(latitude)
    w_n, f_n = vectors_n(latitude)
    step = 1e-6
    for dw, df, want in (
        ([0, 0, -1], [0, 0, 0], cos(lat)),  # up
        ([1, 0, 0], [0, 0, 0], -sin(lat)),
        ([0, 1, 0], [0, 0, 0], 0),
        ([0, 0, 0], [1, 0, 0], 1),
        ([0, 0, 0], [0, 1, 0], 0),
        ([0, 0, 0], [0, 0, 1], 0),
    ):
        w = C.T @ (w_n + step * W * np.array(dw))
        f = C.T @ (f_n + step * G * np.array(df))
        # Second order: 1e-6 of it.
        assert triad_latitude(w, f) - lat == pytest.approx(step * want, abs=3e-6 * step)


def test_biases_come_through_as_the_budget_says():
    (level,) = triad([rest(LEVEL, 48.5, bias=(0, 0, DEG_H, 0, 0, 0))], NOWHERE, Options())
    # East gyro bias of 1 deg/h at 48.5 deg: heading -atan(1/9.966513) = -5.7297 deg.
    np.testing.assert_allclose(np.degrees(error(level.C_nb, LEVEL)), [0, 0, -5.7297], atol=1e-4)
    assert degrees(level.heading) == pytest.approx(354.2703, abs=1e-4)
    (level,) = triad([rest(LEVEL, 48.5, bias=(0, 0, 0, 0, 0, 2 * MILLI_G))], NOWHERE, Options())
    # 2 mg east: 7.77' and b/g = 0.2 % of second order.
    assert 60 * degrees(error(level.C_nb, LEVEL)[2]) == pytest.approx(7.77, abs=0.02)


# --- the estimator -----------------------------------------------------------------------------


def test_estimates_of_each_dwell():
    dwells = [rest(LEVEL, 48.5, label="a"), rest(TILTED, -33.0, label="b", start=200.0)]
    found = triad(dwells, NOWHERE, Options())  # no pair: the verticals are 40 deg apart
    assert [(e.label, e.window, e.t_from, e.t_to) for e in found] == [
        ("a", "", 100.0, 120.0),
        ("b", "", 200.0, 220.0),
    ]
    for estimate, C, latitude in zip(found, (LEVEL, TILTED), (48.5, -33.0), strict=True):
        assert estimate.method == "triad"
        assert estimate.C_nb.single
        # Means of equal numbers round at 1e-16.
        np.testing.assert_allclose(error(estimate.C_nb, C), 0, rtol=0, atol=1e-13)
        assert estimate.latitude == pytest.approx(radians(latitude), abs=1e-14)
        assert estimate.flags == ()


def test_the_sites_latitude_is_not_used():
    (here,) = triad([rest(TILTED, 48.5)], NOWHERE, Options())
    (there,) = triad([rest(TILTED, 48.5)], Site(-1.0), Options())
    np.testing.assert_array_equal(here.C_nb.as_matrix(), there.C_nb.as_matrix())
    assert here.latitude == there.latitude


def test_sequence_follows_the_rule():
    for rule, want in (
        (SequenceRule.REGULAR, [Sequence.YAW_ROLL_PITCH, Sequence.YAW_PITCH_ROLL]),
        (SequenceRule.PUBLISHED, [Sequence.YAW_PITCH_ROLL, Sequence.YAW_ROLL_PITCH]),
    ):
        found = triad([rest(X1_UP, 48.5), rest(LEVEL, 48.5)], NOWHERE, Options(rule=rule))
        assert [e.sequence for e in found] == want


def test_a_nominal_attitude_says_the_sequence():
    """The one that a position has in all methods, however the instrument lies in it."""
    lies = rest(LEVEL, 48.5)
    for nominal, want in (
        (X1_UP, Sequence.YAW_ROLL_PITCH),
        (X1_DOWN, Sequence.YAW_ROLL_PITCH),
        (LEVEL, Sequence.YAW_PITCH_ROLL),
        (np.column_stack([N, E, D]), Sequence.YAW_PITCH_ROLL),  # Z1 down
    ):
        placed = replace(lies, nominal=Rotation.from_matrix(nominal))
        (found,) = triad([placed], NOWHERE, Options())
        assert found.sequence is want
        assert SequenceRule.REGULAR.sequence_at(placed.nominal) is want


@pytest.mark.parametrize(
    ("factor", "doubted"), [(0.79, True), (0.81, False), (1.0, False), (1.19, False), (1.21, True)]
)
def test_a_rate_that_is_not_the_earths_is_flagged(factor, doubted):
    (estimate,) = triad([rest(TILTED, 48.5, factor=factor)], NOWHERE, Options())
    assert any("not Earth's 15.04 deg/h within 20 %" in f for f in estimate.flags) == doubted


def test_an_unsure_heading_is_flagged():
    rng = np.random.default_rng(41)
    # 0.15 deg/rt-h over 20 s: 0.15/sqrt(20/3600)/9.97 rad = 11.6 deg; a laser: 0.23 deg.
    for arw, flagged in ((0.15, True), (0.003, False)):
        dwell = rest(LEVEL, 48.5, noise=(rng, arw * ARW * sqrt(10), 1e-4))
        (estimate,) = triad([dwell], NOWHERE, Options())
        assert any("8 deg" in flag for flag in estimate.flags) == flagged


def test_refusals():
    n = 200
    r = rest(LEVEL, 48.5).readings
    late = (np.arange(n) >= n // 2)[:, None]
    moved = ImuReadings(r.t, r.w_ib_b, r.f_b + late * np.array([0.4, 0, 0]))
    with pytest.raises(NotAtRest, match=r"^p: not at rest near 1\d\d\.\d s: tilt 1\.\d\d deg"):
        triad([Dwell("p", 100.0, 120.0, moved)], NOWHERE, Options())
    with pytest.raises(PoleError, match="collinear"):
        triad([rest(LEVEL, 90.0)], NOWHERE, Options())


# --- pairs ------------------------------------------------------------------------------------


@pytest.mark.parametrize("latitude", [0.0, 48.5, -33.0])
def test_latitude_of_a_pair_is_free_of_its_axis_bias(latitude):
    w_n, f_n = vectors_n(latitude)
    bias = np.array([5 * DEG_H, 0, 0])
    found = pair_latitude(
        X1_UP.T @ w_n + bias, X1_UP.T @ f_n, X1_DOWN.T @ w_n + bias, 1.1 * (X1_DOWN.T @ f_n)
    )
    assert found == pytest.approx(radians(latitude), abs=1e-14)  # rounding
    alone = triad_latitude(X1_UP.T @ w_n + bias, X1_UP.T @ f_n)
    assert degrees(alone) - latitude > 5  # some asin(5/15.04) cos lat, 10 to 19 deg


def test_latitude_of_a_pair_by_hand():
    # 0.4 and 0.6 of Earth rate: half of it, so 30 deg.
    up, down = np.array([2.0, 0, 0]), np.array([-3.0, 0, 0])
    found = pair_latitude(np.array([0.4 * W, 9, 9]), up, np.array([-0.6 * W, 9, 9]), down)
    assert degrees(found) == pytest.approx(30.0, abs=1e-12)
    with pytest.raises(AlignmentError, match=r"mean vertical rate is 1\.100 of Earth rate"):
        pair_latitude(np.array([W, 0, 0]), up, np.array([-1.2 * W, 0, 0]), down)
    with pytest.raises(AlignmentError, match=r"mean vertical rate is -1\.100 of Earth rate"):
        pair_latitude(np.array([-W, 0, 0]), up, np.array([1.2 * W, 0, 0]), down)


def test_a_pair_turns_in_the_order_of_its_first_dwell():
    """A steep X1 is told by the other order, whichever way up; a level one by the usual."""
    for first, second, steep in ((X1_UP, X1_DOWN, True), (X1_DOWN, X1_UP, True)):
        dwells = [rest(first, 48.5, label="a"), rest(second, 48.5, label="b", start=200.0)]
        found = triad(dwells, NOWHERE, Options())[-1]
        assert found.window == "pair"
        assert (found.sequence is Sequence.YAW_ROLL_PITCH) is steep
    over = LEVEL @ np.diag([1.0, -1.0, -1.0])
    dwells = [rest(LEVEL, 48.5, label="a"), rest(over, 48.5, label="b", start=200.0)]
    found = triad(dwells, NOWHERE, Options())[-1]
    assert (found.window, found.sequence) == ("pair", Sequence.YAW_PITCH_ROLL)


def test_opposed_successive_dwells_give_a_pair():
    bias = (DEG_H, 0, 0, 0, 0, 0)
    dwells = [
        rest(C, 48.5, bias=bias, label=label, start=start)
        for C, label, start in (
            (LEVEL, "a", 100.0),
            (X1_UP, "b", 200.0),
            (X1_DOWN, "c", 300.0),
            (X1_UP, "d", 400.0),
        )
    ]
    found = triad(dwells, NOWHERE, Options())
    assert [e.label for e in found] == ["a", "b", "c", "d", "b + c", "c + d"]
    for pair, t_from, t_to in ((found[4], 200.0, 320.0), (found[5], 300.0, 420.0)):
        assert (pair.window, pair.t_from, pair.t_to) == ("pair", t_from, t_to)
        assert pair.C_nb is None
        assert pair.covariance is None
        assert pair.latitude == pytest.approx(radians(48.5), abs=1e-13)  # means round at 1e-16


@pytest.mark.parametrize(("off", "count"), [(4.0, 3), (6.0, 2)])
def test_a_pair_is_opposed_within_five_degrees(off, count):
    second = turn_n(E, radians(off)) @ X1_DOWN
    found = triad([rest(X1_UP, 48.5), rest(second, 48.5, start=200.0)], NOWHERE, Options())
    assert len(found) == count


# --- covariance: chi-square -------------------------------------------------------------------

RUNS = 400
REGIMES = {  # gyro [deg/rt-h], accelerometer [g/rt-Hz]
    "gyros dominate": (0.003, 10e-6),
    "accelerometers dominate": (1e-4, 1e-3),
}
# Two-sided, family-wise 95 %: four attitudes, four latitudes, four pairs.
K = norm.ppf(1 - 0.025 / 12)
# 32 equal blocks: F(1, 31) has mean 31/29 and variance 2 31^2 30/(29^2 27).
MEAN_F, VAR_F = 31 / 29, 2 * 31**2 * 30 / (29**2 * 27)


UNEQUAL = np.array([0.4, 2.0, 1.0])  # noise of the three axes: only so do transposes show


def noisy(regime, C, latitude, rng, start=100.0, axes=UNEQUAL):
    gyro, force = np.outer(REGIMES[regime], axes)
    noise = (rng, gyro * ARW * sqrt(10), force * G * sqrt(10))
    return rest(C, latitude, 12.8, noise=noise, start=start)


def test_noise_along_the_earths_axis_leaves_latitude_alone():
    """Only with gyros of unequal noise do the signs of latitude's two rate terms show."""
    sigma = 0.003 * ARW * sqrt(10)
    along = turn_n(E, radians(48.5)) @ LEVEL  # X1 to the celestial pole, Y1 across it, up
    for axis, want in ((0, 0.0), (1, 0.003 * ARW / sqrt(12.8) / W), (2, 0.0)):
        variances = []
        for seed in range(20):
            r = rest(along, 48.5, 12.8).readings
            sigmas = np.full(3, 1e-3 * sigma)
            sigmas[axis] = sigma
            w = r.w_ib_b + sigmas * np.random.default_rng([54, seed]).normal(size=(128, 3))
            dwell = Dwell("p", 100.0, 112.8, ImuReadings(r.t, w, r.f_b))
            (estimate,) = triad([dwell], NOWHERE, Options())
            variances.append(estimate.latitude_sigma**2)
        # Scatter of 20 variances sqrt(2/31/20) = 5.7 %, four times. Nothing but second order:
        # the estimated latitude is off by 0.004, 1e-5 of the variance gets through.
        full = (0.003 * ARW / W) ** 2 / 12.8
        assert np.mean(variances) == pytest.approx(want**2, rel=0.23, abs=1e-4 * full)


@pytest.mark.parametrize(
    ("regime", "latitude", "C"),
    [
        pytest.param("gyros dominate", 48.5, LEVEL, id="gyros, north, level"),
        pytest.param("gyros dominate", -70.0, TILTED, id="gyros, south, tilted"),
        pytest.param("accelerometers dominate", 48.5, TILTED, id="accelerometers, north, tilted"),
        pytest.param("accelerometers dominate", -70.0, LEVEL, id="accelerometers, south, level"),
    ],
)
def test_covariances(regime, C, latitude):
    """NEES of attitude (3 degrees of freedom) and of latitude (1), variances estimated.

    The variances have 31 degrees of freedom each and are independent of the means, so each
    expectation lies between its degrees of freedom (Jensen: the inverse is convex) and 31/29 of
    them (each component alone is F(1, 31); a mixture of variances is surer than one).
    """
    rng = np.random.default_rng(51)
    found = triad([noisy(regime, C, latitude, rng) for _ in range(RUNS)], NOWHERE, Options())
    eta = np.array([error(e.C_nb, C) for e in found])
    P = np.array([e.covariance for e in found])
    attitude = np.mean(np.einsum("ni,ni->n", eta, np.linalg.solve(P, eta[..., None])[..., 0]))
    spread = K * sqrt(3 * VAR_F / RUNS)
    assert 3 - spread < attitude < 3 * MEAN_F + spread
    ratio = np.array([(e.latitude - radians(latitude)) / e.latitude_sigma for e in found])
    spread = K * sqrt(VAR_F / RUNS)
    assert 1 - spread < np.mean(ratio**2) < MEAN_F + spread


@pytest.mark.parametrize("regime", ["gyros dominate", "accelerometers dominate"])
@pytest.mark.parametrize("latitude", [48.5, -70.0])
def test_sigma_of_a_pairs_latitude(regime, latitude):
    """As above, with one degree of freedom and the variances of two dwells."""
    runs = RUNS // 2
    rng = np.random.default_rng(52)
    ratio = []
    for _ in range(runs):
        dwells = [
            noisy(regime, C, latitude, rng, start)
            for C, start in ((X1_UP, 100.0), (X1_DOWN, 200.0))
        ]
        pair = triad(dwells, NOWHERE, Options())[-1]
        ratio.append((pair.latitude - radians(latitude)) / pair.latitude_sigma)
    spread = K * sqrt(VAR_F / runs)
    assert 1 - spread < np.mean(np.square(ratio)) < MEAN_F + spread


def test_predicted_sigmas_are_the_closed_forms():
    rng = np.random.default_rng(53)
    found = triad(
        [noisy("gyros dominate", LEVEL, 48.5, rng, axes=np.ones(3)) for _ in range(40)],
        NOWHERE,
        Options(),
    )
    gyro = (0.003 * ARW) ** 2 / 12.8
    force = (10e-6) ** 2 / 12.8  # of g
    lat = radians(48.5)
    # Relative scatter of a mean of 40 variances sqrt(2/31/40) = 4 %; four times.
    want = [force, force, gyro / (W * cos(lat)) ** 2 + tan(lat) ** 2 * force]
    found_variances = np.mean([np.diag(e.covariance) for e in found], axis=0)
    np.testing.assert_allclose(found_variances, want, rtol=0.16)
    # Latitude: cos^2 + sin^2 of the same rate noise, and the tilt's.
    assert np.mean([e.latitude_sigma**2 for e in found]) == pytest.approx(
        gyro / W**2 + force, rel=0.16
    )


# --- heading of a tilted instrument; pairs without a latitude -----------------------------------


@pytest.mark.parametrize("pitch", [0.0, 60.0, 80.0])
def test_heading_sigma_of_a_tilted_instrument(pitch):
    """Against differences: heading of exp(eta x) C for each unit of eta."""
    C = turn_n(D, radians(-60)) @ turn_n(E, radians(pitch)) @ turn_n(N, radians(20)) @ LEVEL
    rng = np.random.default_rng(4)
    root = rng.normal(size=(3, 3)) * 1e-4
    P = root @ root.T

    def heading(eta):
        x = Rotation.from_rotvec(eta).as_matrix() @ C @ [1.0, 0, 0]
        return np.arctan2(x[1], x[0])

    h = 1e-6
    j = np.array([(heading(h * e) - heading(-h * e)) / (2 * h) for e in np.eye(3)])
    estimate = AttitudeEstimate(
        "triad", "p", 0.0, 1.0, Rotation.from_matrix(C), Sequence.YAW_PITCH_ROLL, covariance=P
    )
    # differences: h^2 times the third derivative, which grows as tan^3 of the pitch
    assert estimate.heading_sigma == pytest.approx(np.sqrt(j @ P @ j), rel=1e-6)


def test_a_pair_beyond_earth_rate_is_flagged_and_silences_nothing():
    """25 deg/h of cross-axis bias in both: 15.04 sin 48.5 + 25 is no sine of a latitude."""
    up = rest(X1_UP, 48.5, bias=(25 * DEG_H, 0, 0, 0, 0, 0), label="up")
    down = rest(X1_DOWN, 48.5, bias=(-25 * DEG_H, 0, 0, 0, 0, 0), label="down", start=200.0)
    found = triad([up, down], NOWHERE, Options())
    assert [e.label for e in found] == ["up", "down", "up + down"]
    assert found[-1].latitude is None
    assert "mean vertical rate is 2.411 of Earth rate: no latitude" in found[-1].flags[0]


# --- constant errors by stated priors -------------------------------------------------------------

CONSTANT = {  # priors; noise as the regime of that name
    "gyro bias": Priors(gyro_bias=0.2 * DEG_H, accel_bias=1e-6),
    "accelerometer bias": Priors(gyro_bias=1e-3 * DEG_H, accel_bias=2 * MILLI_G),
    "scale": Priors(gyro_scale=5e-3, accel_scale=2e-3),
    "noise": Priors(gyro_bias=1e-4 * DEG_H, accel_bias=1e-6),
}
PLACES = (48.5, -33.0, 75.0)


@pytest.mark.parametrize("latitude", PLACES)
@pytest.mark.parametrize("name", CONSTANT)
def test_biases_drawn_from_their_priors_are_in_the_covariance(name, latitude):
    """NEES as above; the priors are exact, so what they dominate has a mean of 3."""
    runs, priors = 300, CONSTANT[name]
    rng = np.random.default_rng([55, list(CONSTANT).index(name), PLACES.index(latitude)])
    bias = np.repeat([priors.gyro_bias, priors.accel_bias], 3)
    scale = np.repeat([priors.gyro_scale, priors.accel_scale], 3)
    w, f = vectors_n(latitude)
    true = np.concatenate([TILTED.T @ w, TILTED.T @ f])
    size = 1.0 if name == "noise" else 0.02
    noise = (rng, size * 0.003 * ARW * sqrt(10), size * 10e-6 * G * sqrt(10))
    constants = (bias * rng.normal(size=6) + scale * true * rng.normal(size=6) for _ in range(runs))
    dwells = [rest(TILTED, latitude, 12.8, noise, drawn) for drawn in constants]
    found = triad(dwells, NOWHERE, Options(priors=priors))[:runs]
    eta = np.array([error(e.C_nb, TILTED) for e in found])
    P = np.array([e.covariance for e in found])
    assert np.degrees(np.sqrt(P[:, 2, 2].mean())) < 8
    cases = len(CONSTANT) * len(PLACES)
    spread = norm.ppf(1 - 0.025 / cases) * sqrt(3 * VAR_F / runs)
    mean = np.mean(np.einsum("ni,ni->n", eta, np.linalg.solve(P, eta[..., None])[..., 0]))
    assert 3 - spread < mean < 3 * MEAN_F + spread


def test_what_of_constant_errors_is_left_in_a_pairs_latitude():
    """By hand: biases of X1 up and X1 down cancel where Y1 turns over too, north for south.

    Turned over about Y1 instead, its accelerometer's bias is b/g of latitude. Scale error of the
    vertical gyro is tan(lat) of it, drift ``ADEV/(sqrt2 W cos lat)``.
    """
    lat = radians(48.5)
    up = rest(X1_UP, 48.5)
    over = np.column_stack([D, -N, -E])

    def sigma(C, **stated):
        options = Options(priors=Priors(**stated))
        return triad([up, rest(C, 48.5, start=200.0)], NOWHERE, options)[-1].latitude_sigma

    # differences of numbers of one size: rounding at 1e-16 of the bias, square-rooted at the worst
    assert sigma(X1_DOWN, gyro_bias=0.1 * DEG_H, accel_bias=MILLI_G) < 1e-9
    assert sigma(over, gyro_bias=0.1 * DEG_H) < 1e-9
    assert sigma(over, accel_bias=MILLI_G) == pytest.approx(MILLI_G / G, rel=1e-6)
    assert sigma(X1_DOWN, gyro_scale=1e-3) == pytest.approx(1e-3 * tan(lat), rel=1e-6)
    drift = 0.01 * DEG_H / (sqrt(2) * W * cos(lat))
    assert sigma(X1_DOWN, gyro_instability=0.01 * DEG_H) == pytest.approx(drift, rel=1e-6)
