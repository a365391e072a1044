"""[S1], formula by formula, against exact rotations and numeric derivatives."""

from math import cos, pi, radians, sin, sqrt, tan

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from alignment.errors import AlignmentError
from alignment.information.sway_law import (
    DISTRIBUTIONS,
    azimuth_between_planes,
    azimuth_error,
    exact_rms,
    expansion,
    known_sway,
    level_bound,
    noise_gain,
    normal,
    plane_error_gain,
    rms_error,
    sine,
    tilts_of_second,
    uniform,
)
from alignment.methods.two_gyro import Sway, azimuth_as_published, sway_bound

LEVEL = np.column_stack([[1, 0, 0], [0, 0, -1], [0, 1, 0]])  # X1 north, Y1 up, Z1 east
LAT = radians(57)
TILTED = [(0.0, 0.0), (0.1, -0.05), (-0.2, 0.3), (0.25, 0.15)]  # beta0, gamma0 [rad]


def attitudes(azimuth, beta, gamma):
    angles = np.stack(np.broadcast_arrays(-np.asarray(azimuth), -beta, gamma), axis=-1)
    return LEVEL @ Rotation.from_euler("YXZ", angles).as_matrix()


def signals(C, latitude, theta):
    """Earth rate along X1 and along the axis theta clockwise of it in the platform's plane."""
    w = np.swapaxes(C, -1, -2) @ np.array([cos(latitude), 0, -sin(latitude)])
    second = cos(theta) * w[..., 0] + sin(theta) * w[..., 2]
    return w[..., 0], second


# --- (1)-(3) --------------------------------------------------------------------------------------


@pytest.mark.parametrize("theta", [30, 60, 90, 120, -75])
@pytest.mark.parametrize(("beta", "gamma"), TILTED)
def test_general_angle_is_exact_at_north(theta, beta, gamma):
    f1, f2 = signals(attitudes(0.0, beta, gamma), LAT, radians(theta))
    found = azimuth_between_planes(f1, f2, beta, gamma, LAT, radians(theta))
    assert float(found) == pytest.approx(0, abs=1e-14)  # rounding


@pytest.mark.parametrize("theta", [20, 45, 90, 135])
def test_general_angle_level(theta):
    """f1 = k cos a, f2 = k cos(a + theta): the azimuth comes back."""
    a, k = np.linspace(-1.5, 1.5, 31), 3.7
    f2 = k * np.cos(a + radians(theta))
    found = azimuth_between_planes(k * np.cos(a), f2, 0, 0, LAT, radians(theta))
    np.testing.assert_allclose(found, a, atol=1e-13)  # rounding, over cos a
    if theta == 90:
        as_two = azimuth_as_published(k * np.cos(a), f2, 0, 0, LAT)
        np.testing.assert_allclose(found, as_two, atol=1e-14)


def test_elsewhere_the_general_angle_is_off_to_first_order():
    """Halving the tilts halves the error: (1) is no first-order formula away from north."""
    off = []
    for size in (1e-2, 5e-3):
        f1, f2 = signals(attitudes(0.8, size, -size), LAT, radians(60))
        found = azimuth_between_planes(f1, f2, size, -size, LAT, radians(60))
        off.append(float(found) - 0.8)
    assert off[0] / off[1] == pytest.approx(2, rel=0.05)


@pytest.mark.parametrize("theta", [0.0, 0.05, pi, pi + 0.05])
def test_parallel_planes_are_refused(theta):
    with pytest.raises(AlignmentError, match="must be 5 to 175"):
        azimuth_between_planes(1.0, 1.0, 0, 0, LAT, theta)


@pytest.mark.parametrize("theta", [radians(40), radians(90), radians(110)])
def test_gains_by_differences(theta):
    h = 1e-6
    for a in (-1.0, 0.0, 0.7):
        f1, f2 = cos(a), cos(a + theta)

        def at(df1=0.0, df2=0.0, turned=0.0, f1=f1, f2=f2):
            return float(azimuth_between_planes(f1 + df1, f2 + df2, 0, 0, LAT, theta + turned))

        slopes = [(at(h) - at(-h)) / (2 * h), (at(0, h) - at(0, -h)) / (2 * h)]
        assert float(noise_gain(a, theta)) == pytest.approx(np.hypot(*slopes), rel=1e-8)
        by_angle = (at(turned=h) - at(turned=-h)) / (2 * h)
        assert float(plane_error_gain(a, theta)) == pytest.approx(by_angle, abs=1e-8)
    assert float(noise_gain(0.3, pi / 2)) == pytest.approx(1)


def test_tilt_of_one_is_the_others_out_of_the_horizon():
    """(3): seen from Z1, whose own right hand is -X1, the raised end changes places."""
    beta, gamma = 0.02, -0.05
    up = attitudes(0.4, beta, gamma)[2] * -1  # components of up in b
    bet2, gam2 = tilts_of_second(beta, gamma)
    # out of the horizon, first order: X1 by gamma, Z1 by beta
    assert up[0] == pytest.approx(gamma, abs=beta**2) == pytest.approx(float(bet2), abs=1e-3)
    assert up[2] == pytest.approx(float(gam2), abs=gamma**2)


# --- (5)-(15) -------------------------------------------------------------------------------------


@pytest.mark.parametrize(("beta", "gamma"), TILTED)
@pytest.mark.parametrize("latitude", [0.3, 1.0, -0.8])
def test_slopes_by_numeric_derivatives(beta, gamma, latitude):
    s, c, h = sin(latitude), cos(latitude), 1e-5

    def A(b, g):
        return s * cos(b) * sin(g) + c * cos(g)

    def B(b, g):
        return s * sin(b)

    e = expansion(beta, gamma, latitude)
    assert (A(beta, gamma), B(beta, gamma)) == pytest.approx((e.A, e.B), rel=1e-14)
    for f, by_beta, by_gamma in ((A, e.A_beta, e.A_gamma), (B, e.B_beta, 0.0)):
        # central differences: h^2/6 of the third derivative, 2e-11
        assert (f(beta + h, gamma) - f(beta - h, gamma)) / (2 * h) == pytest.approx(
            by_beta, abs=1e-9
        )
        assert (f(beta, gamma + h) - f(beta, gamma - h)) / (2 * h) == pytest.approx(
            by_gamma, abs=1e-9
        )


def sample_error(beta, gamma, xi, eta, latitude, theta=pi / 2):
    """Exact: gyros under the sway, read with the mean tilts, X1 north."""
    f1, f2 = signals(attitudes(0.0, beta + xi, gamma + eta), latitude, theta)
    return float(azimuth_between_planes(f1, f2, beta, gamma, latitude, theta))


@pytest.mark.parametrize(("beta", "gamma"), TILTED)
@pytest.mark.parametrize("theta", [radians(50), pi / 2])
def test_first_order_of_a_sample(beta, gamma, theta):
    """Halving the sway divides the remainder by four; the planes' angle changes nothing."""
    left = []
    for size in (0.02, 0.01):
        xi, eta = size, -0.7 * size
        linear = float(azimuth_error(beta, gamma, xi, eta, LAT))
        # a sample's azimuth is off by alpha* - alpha: minus what atan(B/A) grows
        left.append(sample_error(beta, gamma, xi, eta, LAT, theta) + linear)
    assert left[0] / left[1] == pytest.approx(4, rel=0.12)  # third order: 2 % of it, over 2


@pytest.mark.parametrize("kind", DISTRIBUTIONS)
@pytest.mark.parametrize(("beta", "gamma"), TILTED)
def test_root_mean_square_and_bound(kind, beta, gamma):
    """(13) below (14); both of the exact expectation but for second order, relatively."""
    off = []
    for size in (0.02, 0.01):
        xi, eta = DISTRIBUTIONS[kind](size), DISTRIBUTIONS[kind](0.5 * size)
        sway = known_sway(beta, gamma, xi, eta)
        exact, first = exact_rms(beta, gamma, xi, eta, LAT), rms_error(sway, LAT)
        assert first <= sway_bound(sway, LAT) * (1 + 1e-12)
        off.append(exact / first - 1)
    assert abs(off[0]) < 2e-3
    assert off[0] / off[1] == pytest.approx(4, rel=0.1)
    if beta == gamma == 0:
        assert first == pytest.approx(sway_bound(sway, LAT), rel=1e-12)
        assert first == pytest.approx(level_bound(LAT, sway.variance_beta), rel=1e-12)


def test_the_bound_is_met_where_z1_and_z2_go_against_each_other():
    """(14) is no waste: with the tilts' sways tied together it is reached."""
    e = expansion(0.2, 0.3, LAT)
    # z1 = -k z2 for k > 0 (A*, B* > 0): eta = -(A_beta + k B_beta) xi/A_gamma, k = 1
    slope = -(e.A_beta + e.B_beta) / e.A_gamma
    tied = Sway(0.2, 0.3, 1e-4, slope**2 * 1e-4, slope * 1e-4)
    assert rms_error(tied, LAT) == pytest.approx(sway_bound(tied, LAT), rel=1e-12)


def test_distributions_by_hand():
    for found, variance, fourth in (
        (normal(0.1), 1e-2, 3e-4),
        (uniform(0.3), 0.03, 0.3**4 / 5),
        (sine(0.2), 0.02, 3 / 8 * 0.2**4),
    ):
        assert found.variance == pytest.approx(variance, rel=1e-12)
        assert found.weights.sum() == pytest.approx(1, rel=1e-12)
        assert found.weights @ found.nodes**2 == pytest.approx(variance, rel=1e-10)
        assert found.weights @ found.nodes**4 == pytest.approx(fourth, rel=1e-10)


def test_near_level_by_hand():
    # 0.5 deg at 48.5 deg: 1.130294 of it
    sway = Sway(0.0, 0.0, radians(0.5) ** 2, radians(2.0) ** 2, 0.0)
    assert rms_error(sway, radians(48.5)) == pytest.approx(radians(0.5) * 1.130294, rel=1e-6)
    assert level_bound(radians(48.5), radians(0.5) ** 2) == pytest.approx(
        tan(radians(48.5)) * radians(0.5)
    )
    assert level_bound(0.0, 1.0) == 0
    assert sqrt(known_sway(0, 0, sine(1.0), sine(1.0)).variance_beta) == pytest.approx(sqrt(0.5))
