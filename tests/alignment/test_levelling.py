"""Attitude from two mean vectors: exact recovery, signs and first-order budgets.

Readings are made by matrices written here: ``w_b = C^T w_n``, ``f_b = C^T f_n``.
"""

from math import asin, atan, cos, degrees, pi, radians, sin, tan

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from alignment.angles import Sequence
from alignment.levelling import (
    attitude_covariance,
    attitude_from_means,
    attitude_sensitivity,
    level,
    levelled,
)

YPR, YRP = Sequence.YAW_PITCH_ROLL, Sequence.YAW_ROLL_PITCH
W = 7.292115e-5  # rad/s
DEG_H = pi / 180 / 3600
MILLI_G = 9.80665e-3
NUE = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])  # north, up, east in NED, as columns
FIXED = settings(derandomize=True, deadline=None, max_examples=100)
LATITUDES = [0.0, 45.0, 48.5, -33.0, 80.0, -80.0]
GRAVITY = 9.8093587


def Rx(a):
    return np.array([[1, 0, 0], [0, cos(a), -sin(a)], [0, sin(a), cos(a)]])


def Ry(a):
    return np.array([[cos(a), 0, sin(a)], [0, 1, 0], [-sin(a), 0, cos(a)]])


def Rz(a):
    return np.array([[cos(a), -sin(a), 0], [sin(a), cos(a), 0], [0, 0, 1]])


def attitude(roll, yaw, pitch):
    """``C_nb`` (3, 3) by yaw-pitch-roll, in degrees."""
    return NUE @ Ry(radians(yaw)) @ Rz(radians(pitch)) @ Rx(radians(roll))


ATTITUDES = {
    "level, nose north": attitude(0, 0, 0),
    "level, nose east": attitude(0, -90, 0),
    "tilted": attitude(5, 60, -5),
    "far from level": attitude(-130, -160, 35),
    "X1 up": attitude(0, 30, 90),
    "Z1 down": attitude(90, 0, 0),
}
attitudes = pytest.mark.parametrize("C", list(ATTITUDES.values()), ids=list(ATTITUDES))


def vectors_n(latitude, gravity=GRAVITY):
    lat = radians(latitude)
    return np.array([W * cos(lat), 0, -W * sin(lat)]), np.array([0, 0, -gravity])


def regular(C):
    """The sequence that is not singular there."""
    return YRP if abs(C[2, 0]) > 0.9 else YPR


def error(C_est, C_true):
    """Small rotation about n that takes truth to estimate [rad]."""
    return Rotation.from_matrix(C_est.as_matrix() @ C_true.T).as_rotvec()


# --- levelling ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("f", "ypr", "yrp"),
    [
        ([0, 1, 0], (0, 0), (0, 0)),
        ([0.5, sin(radians(60)), 0], (0, 30), (0, 30)),  # nose up
        ([0, cos(radians(40)), -sin(radians(40))], (40, 0), (40, 0)),  # Y1 toward Z1: Z1 sinks
        ([1, 0, 0], None, (0, 90)),
        ([-1, 0, 0], None, (0, -90)),
        ([0, 0, 1], (-90, 0), None),
        ([0, 0, -1], (90, 0), None),
        ([0, -1, 0], (180, 0), (0, 180)),
    ],
)
def test_level_by_hand(f, ypr, yrp):
    for sequence, want in ((YPR, ypr), (YRP, yrp)):
        if want is None:
            continue  # singular there
        for length in (1.0, 9.81):
            got = np.degrees(level(length * np.array(f), sequence))
            assert np.abs(np.exp(1j * np.radians(got - want)) - 1).max() < 1e-15 * 2  # rounding


@FIXED
@given(st.floats(-pi, pi), st.floats(-1.5, 1.5), st.sampled_from(Sequence))
def test_levelled_readings_point_up(outer, middle, sequence):
    roll, pitch = (outer, middle) if sequence is YPR else (middle, outer)
    turn = Rz(pitch) @ Rx(roll) if sequence is YPR else Rx(roll) @ Rz(pitch)
    np.testing.assert_allclose(
        levelled(sequence, roll, pitch).as_matrix(), turn, rtol=0, atol=1e-15
    )
    f_b = turn.T @ [0, 9.81, 0]
    found = np.array(level(f_b, sequence))
    # Rounding 1e-16 over cos(1.5) = 0.07.
    assert np.abs(np.exp(1j * (found - [roll, pitch])) - 1).max() < 1e-14


# --- exact recovery --------------------------------------------------------------------------


@attitudes
@pytest.mark.parametrize("latitude", LATITUDES)
def test_attitude_is_recovered(C, latitude):
    w_n, f_n = vectors_n(latitude)
    found = attitude_from_means(C.T @ w_n, C.T @ f_n, regular(C))
    assert found.single
    # Rounding of the vertical rate over the horizontal one: 1e-16 tan(80 deg) a few times.
    np.testing.assert_allclose(error(found, C), 0, rtol=0, atol=1e-14)


def test_many_attitudes_at_once_are_those_of_each():
    w_n, f_n = vectors_n(48.5)
    cases = [ATTITUDES["tilted"], ATTITUDES["level, nose east"], ATTITUDES["far from level"]]
    w, f = (np.array([C.T @ v for C in cases]) for v in (w_n, f_n))
    found = attitude_from_means(w, f, YPR).as_matrix()
    np.testing.assert_allclose(found, cases, rtol=0, atol=1e-14)  # rounding
    roll, pitch = level(f, YPR)
    np.testing.assert_allclose(np.degrees(roll), [5, 0, -130], rtol=0, atol=1e-12)
    np.testing.assert_allclose(np.degrees(pitch), [-5, 0, 35], rtol=0, atol=1e-12)


@FIXED
@given(st.integers(0, 2**32 - 1), st.floats(-1.4, 1.4), st.sampled_from(Sequence))
def test_any_attitude_is_recovered_by_either_sequence(seed, latitude, sequence):
    # As a matrix it is unique even where a sequence's angles are not.
    C = Rotation.random(None, np.random.default_rng(seed)).as_matrix()
    w_n, f_n = vectors_n(degrees(latitude))
    found = attitude_from_means(C.T @ w_n, C.T @ f_n, sequence)
    np.testing.assert_allclose(error(found, C), 0, rtol=0, atol=3e-14)  # rounding times tan 80


@attitudes
def test_common_factors_cancel(C):
    w_n, f_n = vectors_n(-33.0)
    found = attitude_from_means(1.7 * (C.T @ w_n), 0.2 * (C.T @ f_n), regular(C))
    np.testing.assert_allclose(error(found, C), 0, rtol=0, atol=1e-14)


# --- first-order budgets ---------------------------------------------------------------------


@pytest.mark.parametrize("latitude", LATITUDES)
@attitudes
def test_sensitivity_against_differences(C, latitude):
    w_n, f_n = vectors_n(latitude)
    step = 1e-6  # of W and of g; central: truncation tan^3(80) step^2 = 2e-10, rounding 1e-9
    J = np.empty((3, 6))
    for k in range(6):
        ends = []
        for sign in (1, -1):
            d = np.zeros(6)
            d[k] = sign * step * (W if k < 3 else GRAVITY)
            found = attitude_from_means(C.T @ (w_n + d[:3]), C.T @ (f_n + d[3:]), regular(C))
            ends.append(error(found, C))
        J[:, k] = (ends[0] - ends[1]) / 2
    G = attitude_sensitivity(w_n[0], -w_n[2], GRAVITY)
    scale = step * np.array([W] * 3 + [GRAVITY] * 3)
    np.testing.assert_allclose(G * scale, J, rtol=0, atol=step * 2e-8)


def test_sensitivity_by_hand():
    # At 45 deg with W cos = W sin = 2 and g = 10: written from methods.md section 2.
    want = [
        [0, 0, 0, 0, -0.1, 0],
        [0, 0, 0, 0.1, 0, 0],
        [0, -0.5, 0, 0, 0.1, 0],
    ]
    np.testing.assert_allclose(attitude_sensitivity(2.0, 2.0, 10.0), want, rtol=1e-15)
    # South of the equator the up rate is negative: the tilt's part of heading changes sign.
    assert attitude_sensitivity(2.0, -4.0, 10.0)[2, 4] == pytest.approx(-0.2, rel=1e-15)


def heading_error(latitude, dw_n=(0, 0, 0), df_n=(0, 0, 0)):
    C = ATTITUDES["tilted"]
    w_n, f_n = vectors_n(latitude)
    found = attitude_from_means(C.T @ (w_n + dw_n), C.T @ (f_n + df_n), YPR)
    return error(found, C)[2]


def test_two_milli_g_east_turn_the_heading_by_eight_arc_minutes():
    # methods.md: 7.8'. tan(48.5 deg) 2 mg/g = 7.77'; second order adds b/g of that, 0.2 %.
    assert 60 * degrees(heading_error(48.5, df_n=[0, 2 * MILLI_G, 0])) == pytest.approx(
        7.77, abs=0.02
    )
    assert heading_error(-48.5, df_n=[0, 2 * MILLI_G, 0]) < 0
    # North and vertical biases leave heading alone; second order is (b/g)^2 = 4e-6.
    assert abs(heading_error(48.5, df_n=[2 * MILLI_G, 0, 2 * MILLI_G])) < 1e-5


@pytest.mark.parametrize("latitude", [0.0, 48.5, -33.0])
def test_a_degree_per_hour_east_turns_the_heading_west(latitude):
    found = heading_error(latitude, dw_n=[0, DEG_H, 0])
    ratio = 1 / (15.041067 * cos(radians(latitude)))
    assert found == pytest.approx(-atan(ratio), rel=1e-7)  # exact; the rate has eight digits
    assert found == pytest.approx(-ratio, rel=ratio**2)  # first order
    assert abs(heading_error(latitude, dw_n=[DEG_H, 0, DEG_H])) < 1e-14  # nothing: rounding


def test_an_accelerometer_bias_tilts_by_its_part_of_gravity():
    C = ATTITUDES["level, nose north"]
    w_n, f_n = vectors_n(0.0)
    found = error(attitude_from_means(C.T @ w_n, C.T @ (f_n + np.array([0.01, 0, 0])), YPR), C)
    # Force to the north: the nose seems up, a turn about east. Exact: atan(b/g).
    np.testing.assert_allclose(found, [0, atan(0.01 / GRAVITY), 0], rtol=0, atol=1e-15)
    found = error(attitude_from_means(C.T @ w_n, C.T @ (f_n + np.array([0, 0.01, 0])), YPR), C)
    np.testing.assert_allclose(found, [-atan(0.01 / GRAVITY), 0, 0], rtol=0, atol=1e-15)
    assert asin(0.01 / GRAVITY) == pytest.approx(0.0010194, abs=1e-7)


def test_covariance_by_hand_with_its_cross_terms():
    # Nose east: X1 along east, Z1 along south. Forces: X1 sees east, Z1 minus north.
    C = Rotation.from_matrix(ATTITUDES["level, nose east"])
    w_n, _ = vectors_n(48.5)
    G = attitude_sensitivity(w_n[0], -w_n[2], 10.0)
    gyro = np.array([4.0, 9.0, 16.0]) * DEG_H**2
    force = np.array([1.0, 2.0, 3.0]) * 1e-6
    P = attitude_covariance(C, np.concatenate([gyro, force]), G)
    north = 1e-8  # east force, X1: 1e-6/10^2
    east = 3e-8  # north force, Z1
    t = tan(radians(48.5))
    down = 4.0 / (15.041067 * cos(radians(48.5))) ** 2 + t**2 * north
    want = [[north, 0, -t * north], [0, east, 0], [-t * north, 0, down]]
    # W is given to eight digits.
    np.testing.assert_allclose(P, want, rtol=1e-7, atol=1e-8 * 1e-14)


@attitudes
def test_covariance_is_that_of_perturbed_means(C):
    # Columns of G times one standard deviation along each body axis, squared and summed.
    rng = np.random.default_rng(7)
    w_n, f_n = vectors_n(-33.0)
    sigmas = 1e-6 * np.concatenate([W * rng.uniform(0.5, 2, 3), rng.uniform(1, 9, 3)])
    columns = []
    for k in range(6):
        d = np.zeros(6)
        d[k] = sigmas[k]
        found = attitude_from_means(C.T @ w_n + d[:3], C.T @ f_n + d[3:], regular(C))
        columns.append(error(found, C))
    want = np.array(columns).T @ np.array(columns)
    G = attitude_sensitivity(w_n[0], -w_n[2], GRAVITY)
    P = attitude_covariance(Rotation.from_matrix(C), sigmas**2, G)
    # Entries reach (2e-6)^2; second order is 1e-6 of that.
    np.testing.assert_allclose(P, want, rtol=0, atol=2e-17)
