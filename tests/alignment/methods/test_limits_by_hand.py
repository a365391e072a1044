"""Where methods begin to refuse or to doubt, on both sides; means and densities by hand."""

from math import cos, radians, sin, sqrt
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from alignment import Dwell, ImuReadings, Options, Priors, Site
from alignment.errors import AlignmentError, TooShort
from alignment.methods.carousel import carousel_attitude, combined, lag_of, without_lag
from alignment.methods.harmonics import TurningVector
from alignment.methods.positions import _bias_sigmas, _doubts, _growth
from alignment.methods.single_gyro import gyro_latitude
from alignment.methods.two_gyro import azimuth_of_sway, two_gyro, white_density

W, G = 7.292115e-5, 9.81
HERE = Site(radians(48.5))
UP = np.array([0.0, 1.0, 0.0])


def resting(n: int, tilts) -> Dwell:
    """X1 north, Y1 up but for tilts (n,) [rad] of X1, at 10 Hz."""
    lat = radians(48.5)
    turn = Rotation.from_rotvec(np.outer(tilts, [0.0, 0.0, 1.0])).inv()
    w = turn.apply(np.tile([W * cos(lat), W * sin(lat), 0.0], (n, 1)))
    f = turn.apply(np.tile([0.0, G, 0.0], (n, 1)))
    return Dwell("p", 0.0, n / 10, ImuReadings(np.arange(1, n + 1) / 10, w, f))


# --- two gyros ------------------------------------------------------------------------------------


@pytest.mark.parametrize(("tilt", "allowed"), [(9.9, True), (-9.9, True), (10.1, False)])
def test_two_gyros_need_a_base_within_ten_degrees(tilt, allowed):
    dwell = resting(64, np.full(64, radians(tilt)))
    if allowed:
        two_gyro([dwell], HERE, Options())
    else:
        with pytest.raises(AlignmentError, match=r"^p: Y1 is 10\.1 deg off up on average, 10 are"):
            two_gyro([dwell], HERE, Options())


@pytest.mark.parametrize(("rms", "allowed"), [(4.95, True), (5.05, False)])
def test_two_gyros_need_a_sway_within_five_degrees(rms, allowed):
    """To and fro from sample to sample, 64 of them: unbiased, sqrt(63/64) of it is its size."""
    dwell = resting(64, radians(rms) * sqrt(63 / 64) * (-1.0) ** np.arange(64))
    if allowed:
        (found,) = two_gyro([dwell], HERE, Options())
        assert found.sway["variance_gamma"] == pytest.approx(radians(rms) ** 2, rel=1e-9)
    else:
        with pytest.raises(AlignmentError, match=r"^p: sway too large: 5\.\d deg rms, 5 are"):
            two_gyro([dwell], HERE, Options())


def test_two_gyros_need_32_samples():
    two_gyro([resting(32, np.zeros(32))], HERE, Options())
    with pytest.raises(TooShort, match=r"^p: 31 samples, at least 32 are needed"):
        two_gyro([resting(31, np.zeros(31))], HERE, Options())


def test_density_of_third_differences_by_hand():
    """1, 0, 0, 0, 2: thirds of -1 and 2; (1 + 4)/2/20 times an interval of 0.1 s."""
    values = np.array([[1.0, 0.0], [0.0, 1.0], [0.0, 4.0], [0.0, 9.0], [2.0, 16.0]])
    # a parabola has none
    np.testing.assert_allclose(white_density(values, 0.1), [0.0125, 0.0], atol=1e-15)


@pytest.mark.parametrize(("part", "told"), [(0.99, True), (1.01, False)])
def test_one_azimuth_up_to_the_colatitude(part, told):
    """Of latitude 60 a tilt of which tan(60) times the sine is one: 35.26 deg."""
    tilt = part * np.arcsin(1 / sqrt(3))
    if told:
        assert np.isfinite(azimuth_of_sway(1.0, 0.0, 0.0, tilt, radians(60)))
    else:
        with pytest.raises(AlignmentError, match=r"tilted by 35\.6 deg: .* below 35\.3 deg one"):
            azimuth_of_sway(1.0, 0.0, 0.0, tilt, radians(60))


# --- one gyro -------------------------------------------------------------------------------------


def test_the_vertical_rate_that_is_too_large_is_named():
    """Of several the worst, whatever its sign."""
    rates = W * np.array([[0.0, 0.5, 0.0], [0.3, -1.25, 0.0], [0.0, 1.1, 0.0]])
    with pytest.raises(AlignmentError, match=r"vertical rate is -1\.250 of Earth rate"):
        gyro_latitude(rates, np.tile(2 * UP, (3, 1)))
    np.testing.assert_allclose(np.degrees(gyro_latitude(rates[:1], 2 * UP)), [30.0])


# --- a carousel -----------------------------------------------------------------------------------


def vector(across, variance=1.0, constant=(0.0, 0.0, 0.0)) -> TurningVector:
    """What turns across an axis along Y1."""
    return TurningVector(np.array(across), np.array(variance), np.array(constant), np.full(3, 0.5))


@pytest.mark.parametrize(("tilt", "allowed"), [(29.9, True), (30.1, False)])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_axis_of_turning_is_within_thirty_degrees_of_the_vertical(tilt, allowed, sign):
    force = vector(
        [G * sin(radians(tilt)), 0.0, 0.0], 1e-6, [0.0, sign * G * cos(radians(tilt)), 0.0]
    )
    rate = vector([0.0, 0.0, W], 1e-18)
    if allowed:
        found = carousel_attitude(rate, force, UP, radians(30), Priors())
        assert np.isfinite(found.C_nb).all()
    else:
        with pytest.raises(AlignmentError, match="axis of turning is 30 deg off the vertical"):
            carousel_attitude(rate, force, UP, radians(30), Priors())


def test_stretches_are_combined_by_their_variances():
    """Weights 1 and 3; turned back by rate times lag, a quarter each way about Y1 (Z1 to X1)."""
    forth = vector([1.0, 0.0, 0.0], 1.0, [0.0, 4.0, 0.0])
    back = vector([-1.0, 0.0, 0.0], 1 / 3, [0.0, 8.0, 0.0])
    found = combined([forth, back], [2.0, -2.0], UP, np.pi / 4)
    # a quarter back about Y1 takes X1 to Z1, a quarter on takes -X1 there too
    np.testing.assert_allclose(found.across, [0.0, 0.0, 1.0], atol=1e-15)
    assert found.variance == pytest.approx(0.25)
    np.testing.assert_allclose(found.constant, [0.0, 7.0, 0.0])


def test_a_lag_by_hand():
    """At 2 rad/s and -1 rad/s phases that differ by 0.3 rad: a lag of 0.1 s.

    Weights 4 and 2 of sizes 2 and 1 and variances 1 and 1/2: a mean rate of 1, 4 + 2 * 4 = 12 in
    the denominator, so 1/12 is added.
    """
    forth = vector([2.0, 0.0, 0.0], 1.0)
    # about Y1 by -0.3: from X1 toward Z1
    back = vector([cos(0.3), 0.0, sin(0.3)], 0.5)
    np.testing.assert_allclose(lag_of([forth, back], [2.0, -1.0], UP), [0.1, 1 / 12])
    np.testing.assert_array_equal(lag_of([forth, back], [2.0, 1.0], UP), [0.0, 0.0])


@pytest.mark.parametrize(("noise", "own"), [(0.099, True), (0.101, False)])
def test_accelerometers_have_a_lag_of_their_own_where_the_axis_leans(noise, own):
    """Gyros without a lag, accelerometers that lag by 0.1 s, of 10 times their noise or just not.

    At 2 and -1 rad/s, alike in noise: phases of 0.2 and -0.1 that are one without the lag, or
    ``cos 0.15`` of one at their mean. Mean rate 1/2, squares about it 9/2 over the variance: a lag
    adds (1/4)/(9/2) of the variance.
    """
    rates = [2.0, -1.0]
    gyros = [vector([1.0, 0.0, 0.0], 1e-4)] * 2
    turned = [vector([cos(r / 10), 0.0, -sin(r / 10)], noise**2) for r in rates]
    seen, felt = without_lag(gyros, turned, rates, UP)
    assert seen.variance == pytest.approx(1e-4 * (1 / 2 + 1 / 18))
    size = 1.0 if own else cos(0.15)
    assert np.linalg.norm(felt.across) == pytest.approx(size)
    assert felt.variance == pytest.approx(noise**2 / 2 + (noise**2 if own else 1e-4) * size**2 / 18)


# --- positions ------------------------------------------------------------------------------------


def fitted(**changes) -> SimpleNamespace:
    fit = {"growth": 1.0, "chi2": 9.0, "freedom": 4.0, "margin": 1e9}
    return SimpleNamespace(**fit | {"unseen": [False] * 6, "contradicted": False} | changes)


@pytest.mark.parametrize(
    ("sigma", "growth", "across", "along"),
    [
        (1e-3, 1.0, 1e-6, 0.75e-12),
        (100.0, 1.0, 0.5, 1.5),
        (0.5, 4.0, 0.43233, 0.354606),  # as one of 1 rad
    ],
)
def test_biases_of_a_heading_on_its_circle_by_hand(sigma, growth, across, along):
    """Y1 stays north, Z1 east, X1 goes up and down: of a horizontal rate R, `sigma` off, Z1 has
    sin h and Y1 has 1 - cos h, beside s of its own; X1 and the accelerometers have s alone."""
    rate, s = W * cos(radians(48.5)), 1e-6
    up = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [-1.0, 0.0, 0.0]])
    down = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
    cross = np.zeros((2, 3, 6))
    cross[:, 2, 2] = rate * sigma**2
    own = np.full(6, s**2)
    own[2] += (rate * sigma) ** 2
    fit = fitted(
        C_nb=np.array([up, down]),
        covariance=np.tile(np.diag([1.0, 1.0, sigma**2]), (2, 1, 1)),
        bias_covariance=np.diag(own),
        cross=cross,
        latitude=None,
    )
    want = np.full(6, growth * s**2)
    want[1] += rate**2 * along
    want[2] += rate**2 * across
    np.testing.assert_allclose(_bias_sigmas(fit, growth, HERE) ** 2, want, rtol=1e-4)
    unknown = fitted(**(vars(fit) | {"latitude": radians(48.5)}))
    np.testing.assert_array_equal(
        _bias_sigmas(unknown, growth, Site(None)), _bias_sigmas(fit, growth, HERE)
    )


def test_doubts_of_positions_by_hand():
    assert _doubts(fitted()) == ()
    (hidden,) = _doubts(fitted(unseen=[False, True, False, False, False, True]))
    assert hidden == "biases not shown by these turns: Y1 gyro, Z1 accelerometer"
    assert _doubts(fitted(margin=12.01)) == ()
    (near,) = _doubts(fitted(margin=11.94))
    assert "another attitude fits nearly as well (chi-square 11.9 more)" in near
    (said,) = _doubts(fitted(contradicted=True, growth=2.25))
    assert "chi-square 9 for 4 degrees of freedom" in said
    assert said.endswith("sigmas are 1.5 times as large for it")
    assert _growth(fitted(growth=2.25)) == 2.25
    with pytest.raises(AlignmentError, match="chi-square 9 for 4 degrees of freedom, too few"):
        _growth(fitted(growth=np.inf))
