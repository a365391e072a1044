"""[S2]'s Rodrigues-Hamilton parameters and variations against exact rotations."""

from math import pi, radians, sqrt

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from alignment.methods.vectors.printed import corrected_vectors, cramer, invariants
from alignment.methods.vectors.rodrigues import (
    corrected_norm,
    error_as_printed,
    error_carried,
    from_half_angles,
    integrated,
    kinematics,
    orientation_matrix,
    start_error,
    turn_of,
    variations,
)

RNG = np.random.default_rng(4)
ANGLES = RNG.uniform(-1.4, 1.4, (20, 3))  # roll, yaw, pitch


def test_matrix_of_parameters():
    q = Rotation.random(20, random_state=RNG).as_quat()
    np.testing.assert_allclose(orientation_matrix(q), Rotation.from_quat(q).as_matrix(), atol=1e-15)
    np.testing.assert_allclose(orientation_matrix(2 * q), 4 * orientation_matrix(q), rtol=1e-13)


def test_half_angles_make_the_product_of_three_turns():
    roll, yaw, pitch = ANGLES.T
    turns = Rotation.from_euler("YZX", np.stack([yaw, pitch, roll], axis=1)).as_matrix()
    np.testing.assert_allclose(
        orientation_matrix(from_half_angles(roll, yaw, pitch)), turns, atol=1e-15
    )


def test_half_angles_by_hand():
    # a quarter turn of each alone, then all: c = s = sqrt(1/2)
    h = sqrt(0.5)
    np.testing.assert_allclose(from_half_angles(pi / 2, 0, 0), [h, 0, 0, h], atol=1e-15)
    np.testing.assert_allclose(from_half_angles(0, pi / 2, 0), [0, h, 0, h], atol=1e-15)
    np.testing.assert_allclose(from_half_angles(0, 0, pi / 2), [0, 0, h, h], atol=1e-15)
    all_three = from_half_angles(pi / 2, pi / 2, pi / 2)
    np.testing.assert_allclose(all_three, [2 * h**3, 2 * h**3, 0, 0], atol=1e-15)


@pytest.mark.parametrize("axis", range(3))
def test_start_error_of_one_angle(axis):
    """To first order a turn by that angle; halving it divides the remainder by four."""
    angles, left = np.array([0.3, -0.7, 0.4]), []
    q = from_half_angles(*angles)
    C = Rotation.from_quat(q)
    # axes about which roll, yaw and pitch turn, in start axes
    about = [C.apply([1, 0, 0]), [0, 1, 0], Rotation.from_euler("Y", -0.7).apply([0, 0, 1])][axis]
    for size in (0.02, 0.01):
        error = np.zeros(3)
        error[axis] = size
        found = turn_of(q, start_error(angles, error))
        left.append(np.linalg.norm(found - size * np.array(about)))
    # the vector part is 2 sin(size/2) with nothing of second order: a third-order remainder
    assert left[0] / left[1] == pytest.approx(8, rel=0.01)


def test_kinematics_by_differences():
    q = from_half_angles(0.2, 0.5, -0.3)
    w, h = np.array([0.3, -0.2, 0.5]), 1e-5
    ahead, behind = (Rotation.from_quat(q) * Rotation.from_rotvec(s * h * w) for s in (1, -1))
    found = (ahead.as_quat() - behind.as_quat()) / (2 * h)
    np.testing.assert_allclose(kinematics(q, w), found, atol=1e-10)  # h^2


def test_norm_on_a_threshold_turns_nothing():
    """What is not corrected is of the norm alone: the same attitude, with fewer corrections."""
    w, step = np.tile([0.4, -0.3, 0.6], (2000, 1)), 0.5
    q0 = from_half_angles(0.1, 0.2, 0.3)
    always, often = integrated(q0, w, step, 0.0)
    seldom, few = integrated(q0, w, step, 1e-5)
    never, none = integrated(q0, w, step, 1.0)
    assert often > 1900
    assert 10 < few < often / 5
    assert none == 0
    assert abs(np.linalg.norm(never[-1]) - 1) > 1e-6
    for other in (seldom, never):
        between = Rotation.from_quat(always[-1]).inv() * Rotation.from_quat(other[-1])
        assert between.magnitude() < 1e-12
    assert np.linalg.norm(corrected_norm(1.001 * q0, 0.01)) == pytest.approx(1.001)
    assert np.linalg.norm(corrected_norm(1.02 * q0, 0.01)) == pytest.approx(1)


def turning(rate, dw, start, T=10.0, n=2001):
    """True parameters, the channel's by wrong rates from a wrong start, and what went in."""
    t = np.linspace(0, T, n)
    q0 = Rotation.from_quat(from_half_angles(0.2, -0.4, 0.1))
    true = q0 * Rotation.from_rotvec(np.outer(t, rate))
    wrong = Rotation.from_rotvec(start) * q0 * Rotation.from_rotvec(np.outer(t, rate + dw))
    q, found = true.as_quat(), wrong.as_quat()
    found *= np.sign(np.sum(q * found, axis=1))[:, None]
    return t, q, found, np.tile(dw, (n, 1))


def test_carried_error_is_the_exact_one_to_first_order():
    rate, left = np.array([0.2, -0.5, 0.3]), []
    for size in (1.0, 0.5):
        dw, start = size * np.array([1e-3, 2e-3, -1e-3]), size * np.array([0.01, -0.02, 0.01])
        t, q, found, rates = turning(rate, dw, start)
        carried = error_carried(t, q, rates, found[0] - q[0])
        left.append(np.abs(carried[-1] - (found[-1] - q[-1])).max())
    assert left[0] / left[1] == pytest.approx(4, rel=0.1)


def test_printed_error_integral_holds_without_a_turn():
    for rate, share in ((np.zeros(3), 1e-3), (np.array([0.0, 0.6, 0.0]), 0.5)):
        t, q, found, rates = turning(rate, np.array([1e-4, 0.0, 0.0]), np.zeros(3))
        printed = error_as_printed(t, q, rates, found[0] - q[0])
        off = np.linalg.norm(printed[-1] - (found[-1] - q[-1]))
        relative = off / np.linalg.norm(found[-1] - q[-1])
        assert relative < share if not rate.any() else relative > share


@pytest.mark.parametrize("which", ["dr", "v", "both"])
def test_variations_of_the_invariants(which):
    """(2)-(4): halving the errors divides the remainder by four."""
    dr, v = np.array([[120.0, 30.0, -8.0], [5.0, 7.0, 9.0]]), np.array([[20.0, -5, 1], [1, 0, -2]])
    e, u = (
        np.array([[3.0, -2, 1], [0.1, 0.2, -0.3]]),
        np.array([[0.4, 0.6, -1], [0.02, 0.01, 0.05]]),
    )
    if which != "both":
        e, u = (e, 0 * u) if which == "dr" else (0 * e, u)
    left = [
        invariants(dr + s * e, v + s * u) - invariants(dr, v) - variations(dr, v, s * e, s * u)
        for s in (0.02, 0.01)
    ]
    there = np.abs(left[0]) > 1e-9
    assert there.any()
    np.testing.assert_allclose(left[0][there] / left[1][there], 4, rtol=0.02)


def test_equal_corrections_per_axis():
    """(5): dJ/sqrt(3) on each axis changes the modulus by dJ cos(eps), turns by dJ sin(eps)/|v|."""
    v, dr, dJ = np.array([20.0, 0, 0]), np.array([0.0, 100.0, 0]), 1e-3
    _, found, _ = corrected_vectors(dr, v, np.array([dJ, 0, 0]))
    eps = np.arccos(1 / sqrt(3))
    assert np.linalg.norm(found) - 20 == pytest.approx(dJ * np.cos(eps), rel=1e-4)
    turn = np.arccos(found @ v / 20 / np.linalg.norm(found))
    assert turn == pytest.approx(dJ * np.sin(eps) / 20, rel=1e-4)


def test_cramer_gives_the_matrix_of_exact_vectors():
    """(6)-(7)."""
    C = Rotation.from_euler("YZX", [0.4, 0.2, -0.6]).as_matrix()
    start = np.array([[1.0, 0.2, 0.1], [0.1, 1.0, -0.4], [0.5, 0.3, 1.0]])
    np.testing.assert_allclose(cramer(start @ C, start), C, atol=1e-14)
    assert radians(180) == pi
