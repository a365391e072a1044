"""Triads skewed by design: components, what becomes of noise, and who must know of it."""

from math import cos, radians, sin, sqrt

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from alignment import Dwell, ImuReadings, Options, Priors, Site
from alignment.constant_errors import constant_columns, constant_covariance
from alignment.errors import AlignmentError
from alignment.methods.two_gyro import two_gyro
from alignment.skew import back_from, by_planes, components, cone, correlated, spread, unit_axes

SKEWED = ((2.0, 0.0, 0.0), (0.0, 1.0, 1.0), (1.0, 0.0, 1.0))  # any length


def test_components_come_back():
    x = np.array([[1.0, -2.0, 3.0], [0.3, 9.8, -0.1]])
    A = unit_axes(SKEWED)
    np.testing.assert_allclose(np.linalg.norm(A, axis=1), 1)
    np.testing.assert_allclose(components(x @ A.T, SKEWED), x, atol=1e-14)
    np.testing.assert_array_equal(back_from(None), np.eye(3))


def test_noise_of_planes_by_hand():
    """w_z = (f2 - f1 cos th)/sin th: variance (1 + cos^2)/sin^2, shared -cos/sin with f1."""
    th = radians(60)
    S = spread(by_planes(th))
    assert S[0, 0] == pytest.approx(1)
    assert S[2, 2] == pytest.approx((1 + cos(th) ** 2) / sin(th) ** 2)
    assert S[0, 2] == pytest.approx(-cos(th) / sin(th))
    assert S[1, 1] == pytest.approx(1)
    np.testing.assert_allclose(spread(by_planes(radians(90))), np.eye(3), atol=1e-15)


def test_a_cone_is_square_at_its_own_angle():
    np.testing.assert_allclose(spread(cone(np.arccos(1 / sqrt(3)))), np.eye(3), atol=1e-14)


def test_correlation_keeps_the_variances():
    v = np.array([1.0, 2.0, 3.0])
    found = correlated(v, SKEWED)
    np.testing.assert_allclose(found.diagonal(), v)
    S = spread(SKEWED)
    assert found[0, 2] / sqrt(3) == pytest.approx(S[0, 2] / sqrt(S[0, 0] * S[2, 2]))
    np.testing.assert_array_equal(correlated(v, None), np.diag(v))


@pytest.mark.parametrize(
    ("axes", "words"),
    [
        (((1, 0, 0), (0, 1, 0), (1, 1, 0.01)), "nearly in one plane"),
        (((1, 0, 0), (0, 0, 0), (0, 0, 1)), "is zero"),
        (((1, 0), (0, 1)), "three axes of three"),
    ],
)
def test_axes_that_tell_nothing(axes, words):
    with pytest.raises(AlignmentError, match=words):
        unit_axes(axes)


def test_constant_errors_of_a_skewed_triad():
    """What one sensor's scale error makes of components, by hand; biases by their spread."""
    A = unit_axes(SKEWED)
    axes = tuple(map(tuple, A.tolist()))
    w, f = np.array([1e-4, 2e-4, -1e-4]), np.array([1.0, 9.0, -2.0])
    priors = Priors(accel_scale=1e-3, accel_bias=2e-3, accel_axes=axes)
    columns = constant_columns(w, f, priors)
    for k in range(3):
        wrong = A @ f
        wrong[k] *= 1 + 1e-3
        np.testing.assert_allclose(columns[3:, k], np.linalg.solve(A, wrong) - f, atol=1e-15)
    P = constant_covariance(np.concatenate([w, f]), priors)
    scale = columns[3:] @ columns[3:].T
    np.testing.assert_allclose(P[3:, 3:], scale + 4e-6 * spread(axes), rtol=1e-10)


def test_a_case_that_turns_is_not_skewed_again():
    """Turned as a whole a triad reads what turned: the same components, however it is skewed."""
    w, f = np.array([1e-4, 2e-4, -1e-4]), np.array([1.0, 9.0, -2.0])
    axes = by_planes(radians(50))
    found = constant_columns(w, f, Priors(gyro_misalignment=1e-3, gyro_axes=axes))
    plain = constant_columns(w, f, Priors(gyro_misalignment=1e-3))
    np.testing.assert_array_equal(found, plain)


@pytest.mark.parametrize("azimuth", [0.0, 40.0, 90.0, -50.0])
def test_two_gyros_are_as_sure_as_their_planes_allow(azimuth):
    """White noise of both gyros: sigma is `noise_gain` of what square planes give, by azimuth.

    Of readings that are noise about exact means: 400 runs of the estimate's own slopes would say
    the same; here the covariance is set against the closed form alone.
    """
    from alignment.information.sway_law import noise_gain

    theta, lat, T, walk = radians(55), radians(48.5), 400.0, 1e-6
    W = 7.292115e-5 * np.array([cos(lat), 0, -sin(lat)])
    C = (
        np.column_stack([[1, 0, 0], [0, 0, -1], [0, 1, 0]])
        @ Rotation.from_euler("Y", -radians(azimuth)).as_matrix()
    )
    n, rng = 20_000, np.random.default_rng(2)
    noise = walk * np.sqrt(n / T) * rng.standard_normal((n, 3))
    axes = by_planes(theta)
    w = C.T @ W + components(noise, axes)
    f = np.tile(C.T @ [0, 0, -9.81], (n, 1)) + 1e-9 * rng.standard_normal((n, 3))
    t = (np.arange(n) + 1) * T / n
    dwell = Dwell("d", 0.0, T, ImuReadings(t, w, f))
    (found,) = two_gyro([dwell], Site(lat), Options(priors=Priors(gyro_axes=axes)))
    floor = walk / (7.292115e-5 * cos(lat)) / sqrt(T)
    # densities of third differences of 20 000 samples: 1.2 % each; the sway's part 13/15 + 2/15
    expected = floor * float(noise_gain(radians(azimuth), theta))
    assert sqrt(found.covariance[2, 2]) == pytest.approx(expected, rel=0.1)
