"""Frames, signs and sequences against matrices written by hand (methods.md section 0)."""

from math import cos, pi, radians, sin

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from alignment.angles import (
    C_N_NUE,
    C_nb_from_angles,
    Sequence,
    SequenceRule,
    angle_jacobian,
    angles_from_C_nb,
    heading_from_C_nb,
    near_singular,
    wrapped,
)
from alignment.estimate import AttitudeEstimate, angle_sigmas

YPR, YRP = Sequence.YAW_PITCH_ROLL, Sequence.YAW_ROLL_PITCH
both = pytest.mark.parametrize("sequence", [YPR, YRP])
FIXED = settings(derandomize=True, deadline=None, max_examples=120)
ROUNDING = 4e-16 * 8  # a product of three rotation matrices rounds by a few ulp

# North, up and east, each in NED, as columns.
NUE = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])

# X1, Y1 and Z1, each in NED, as columns: written from the picture, not from angles.
N, E, D = np.eye(3)
POSITIONS = {
    "X1 up": ((0, 0, 90), (-D, -N, E), (1, 0, 0)),
    "X1 down": ((0, 0, -90), (D, N, E), (-1, 0, 0)),
    "Y1 up": ((0, 0, 0), (N, -D, E), (0, 1, 0)),
    "Y1 down": ((-180, 0, 0), (N, D, -E), (0, -1, 0)),
    "Z1 up": ((-90, 0, 0), (N, -E, -D), (0, 0, 1)),
    "Z1 down": ((90, 0, 0), (N, E, D), (0, 0, -1)),
}
six = pytest.mark.parametrize(
    ("angles", "axes", "up"), list(POSITIONS.values()), ids=list(POSITIONS)
)


def Rx(a):
    return np.array([[1, 0, 0], [0, cos(a), -sin(a)], [0, sin(a), cos(a)]])


def Ry(a):
    return np.array([[cos(a), 0, sin(a)], [0, 1, 0], [-sin(a), 0, cos(a)]])


def Rz(a):
    return np.array([[cos(a), -sin(a), 0], [sin(a), cos(a), 0], [0, 0, 1]])


def by_hand(sequence, roll, yaw, pitch):
    """``C_nb`` (3, 3) by elementary matrices: yaw about up, then the other two in order."""
    if sequence is YPR:
        return NUE @ Ry(yaw) @ Rz(pitch) @ Rx(roll)
    return NUE @ Ry(yaw) @ Rx(roll) @ Rz(pitch)


def rotvec_between(truth, estimate):
    return Rotation.from_matrix(estimate @ truth.T).as_rotvec()


# --- signs -----------------------------------------------------------------------------------


def test_at_zero_angles_the_axes_are_north_up_east():
    np.testing.assert_allclose(C_N_NUE.as_matrix(), NUE, rtol=0, atol=ROUNDING)
    for sequence in Sequence:
        C = C_nb_from_angles(sequence, 0, 0, 0)
        np.testing.assert_allclose(C.apply([1, 0, 0]), N, rtol=0, atol=ROUNDING)
        np.testing.assert_allclose(C.apply([0, 1, 0]), -D, rtol=0, atol=ROUNDING)
        np.testing.assert_allclose(C.apply([0, 0, 1]), E, rtol=0, atol=ROUNDING)


@both
@pytest.mark.parametrize(
    ("roll", "yaw", "pitch", "axis", "where"),
    [
        (0, 90, 0, [1, 0, 0], [0, -1, 0]),  # yaw turns the nose west
        (0, 90, 0, [0, 0, 1], [1, 0, 0]),
        (0, 0, 90, [1, 0, 0], [0, 0, -1]),  # pitch lifts the nose
        (0, 0, 90, [0, 1, 0], [-1, 0, 0]),
        (90, 0, 0, [0, 1, 0], [0, 1, 0]),  # roll takes Y1 to where Z1 was: east
        (90, 0, 0, [0, 0, 1], [0, 0, 1]),  # and Z1 down
    ],
)
def test_signs_of_the_three_turns(sequence, roll, yaw, pitch, axis, where):
    C = C_nb_from_angles(sequence, *np.radians([roll, yaw, pitch]))
    np.testing.assert_allclose(C.apply(axis), where, rtol=0, atol=ROUNDING)


@six
def test_six_positions(angles, axes, up):
    C = C_nb_from_angles(YPR, *np.radians(angles))
    np.testing.assert_allclose(C.as_matrix(), np.column_stack(axes), rtol=0, atol=ROUNDING)
    np.testing.assert_allclose(C.inv().apply([0, 0, -1]), up, rtol=0, atol=ROUNDING)


ANGLES = [(0.3, 1.1, -0.4), (-2.5, -0.7, 1.2), (0.9, 3.0, 0.2), (-1.3, -2.9, -2.2)]


@both
@pytest.mark.parametrize("angles", ANGLES)
def test_attitude_is_the_product_of_elementary_turns(sequence, angles):
    C = C_nb_from_angles(sequence, *angles)
    np.testing.assert_allclose(C.as_matrix(), by_hand(sequence, *angles), rtol=0, atol=ROUNDING)


@pytest.mark.parametrize("angles", ANGLES)
def test_vertical_in_b_as_the_methods_write_it(angles):
    ph, _, th = angles
    ypr = C_nb_from_angles(YPR, *angles).inv().apply([0, 0, -1])
    want = [sin(th), cos(th) * cos(ph), -cos(th) * sin(ph)]
    np.testing.assert_allclose(ypr, want, rtol=0, atol=ROUNDING)
    yrp = C_nb_from_angles(YRP, *angles).inv().apply([0, 0, -1])
    want = [sin(th) * cos(ph), cos(th) * cos(ph), -sin(ph)]
    np.testing.assert_allclose(yrp, want, rtol=0, atol=ROUNDING)


# --- angles and back -------------------------------------------------------------------------

turns = st.floats(-pi, pi)
middles = st.floats(-radians(89.4), radians(89.4))  # near_singular begins at 89.5 deg


@FIXED
@given(turns, turns, middles, st.sampled_from(Sequence))
def test_angles_there_and_back(outer, yaw, middle, sequence):
    roll, pitch = (outer, middle) if sequence is YPR else (middle, outer)
    angles = angles_from_C_nb(sequence, Rotation.from_matrix(by_hand(sequence, roll, yaw, pitch)))
    assert not near_singular(sequence, angles)
    # Rounding of the matrix, 1e-15, over cos 89.4 deg = 0.0105 for the outer turns.
    np.testing.assert_allclose(
        np.exp(1j * angles), np.exp(1j * np.array([roll, yaw, pitch])), rtol=0, atol=3e-13
    )
    assert np.all(np.abs(angles) <= pi)


@FIXED
@given(st.integers(0, 2**32 - 1), st.integers(2, 5), st.sampled_from(Sequence))
def test_attitude_there_and_back_for_many_at_once(seed, n, sequence):
    C = Rotation.random(n, np.random.default_rng(seed))
    angles = angles_from_C_nb(sequence, C)
    assert angles.shape == (n, 3)
    middle = angles[:, 2 if sequence is YPR else 0]
    assert np.all(np.abs(middle) <= pi / 2)
    for row, matrix in zip(angles, C.as_matrix(), strict=True):
        np.testing.assert_array_equal(
            angles_from_C_nb(sequence, Rotation.from_matrix(matrix)).shape, (3,)
        )
        # The attitude comes back to rounding even where its angles are badly conditioned.
        np.testing.assert_allclose(by_hand(sequence, *row), matrix, rtol=0, atol=1e-13)


@both
def test_wrap_edges(sequence):
    for yaw in (pi, -pi, pi - 1e-9, -pi + 1e-9):
        C = Rotation.from_matrix(by_hand(sequence, 0.2, yaw, -0.3))
        read = angles_from_C_nb(sequence, C)[1]
        assert -pi <= read <= pi
        assert abs(sin(read - yaw)) < 1e-14  # rounding of the matrix
        assert cos(read - yaw) > 0


@pytest.mark.parametrize("whole", [0, 1, -1, 3, -7])
def test_wrapped_takes_out_whole_turns(whole):
    errors = np.array([[0.0, 0.5], [-0.5, 3.0], [-3.0, 1e-12]])
    # Whole turns are subtracted from numbers up to 44: rounding 7e-15.
    np.testing.assert_allclose(wrapped(errors + 2 * pi * whole), errors, rtol=0, atol=2e-14)


def test_wrapped_at_the_edge():
    # Half a turn is half a turn either way: what counts is its size.
    assert wrapped(pi) == -pi
    assert wrapped(-pi) == -pi
    assert wrapped(np.radians(359.9)) == pytest.approx(np.radians(-0.1), abs=2e-15)
    assert wrapped(np.radians(-180.1)) == pytest.approx(np.radians(179.9), abs=2e-15)


@FIXED
@given(st.floats(-100.0, 100.0))
def test_wrapped_stays_within_half_a_turn(angle):
    assert -pi <= wrapped(angle) <= pi  # both ends: -pi - 4e-16 rounds up to +pi
    assert abs(np.exp(1j * wrapped(angle)) - np.exp(1j * angle)) < 1e-13  # 2 ulp of 100 rad


# --- heading ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("yaw", "heading"),
    [(0, 0), (-90, 90), (90, 270), (180, 180), (-30, 30), (0.1, 359.9), (-359, 359)],
)
@pytest.mark.parametrize("roll", [0.0, 40.0])
@pytest.mark.parametrize("pitch", [0.0, -20.0, 60.0])
def test_heading_is_minus_yaw_from_north_through_east(yaw, heading, roll, pitch):
    C = Rotation.from_matrix(by_hand(YPR, *np.radians([roll, yaw, pitch])))
    found = heading_from_C_nb(C)
    assert found is not None
    assert 0 <= found < 2 * pi
    assert abs(np.exp(1j * found) - np.exp(1j * radians(heading))) < 1e-14  # rounding


def test_heading_of_a_vertical_axis_does_not_exist():
    for pitch in (90, -90, 89.6, -89.6):
        for yaw in (0, 70):
            C = Rotation.from_matrix(by_hand(YPR, 0.3, radians(yaw), radians(pitch)))
            assert heading_from_C_nb(C) is None
    for pitch in (89.4, -89.4):
        C = Rotation.from_matrix(by_hand(YPR, 0.3, -1.0, radians(pitch)))
        assert heading_from_C_nb(C) == pytest.approx(1.0, abs=1e-13)  # rounding over 0.01


def test_a_heading_that_rounds_up_to_a_whole_turn_is_zero():
    # 1e-17 west of north: 2 pi minus that rounds to 2 pi.
    tiny = Rotation.from_quat([0.0, 0.0, -0.5e-17, 1.0])  # about down
    x1 = tiny.apply([1, 0, 0])
    assert x1[1] < 0  # or the test tests nothing
    assert heading_from_C_nb(tiny) == 0.0


# --- sequences and their singularities ----------------------------------------------------------


def test_singular_middles():
    for sign in (1, -1):
        assert near_singular(YPR, np.radians([0, 0, sign * 89.6]))
        assert not near_singular(YPR, np.radians([sign * 90, 0, sign * 89.4]))
        assert near_singular(YRP, np.radians([sign * 89.6, 0, 0]))
        assert not near_singular(YRP, np.radians([sign * 89.4, 0, sign * 90]))
    many = np.radians([[0, 0, 90], [90, 0, 0], [90, 0, 90], [0, 90, 0]])
    np.testing.assert_array_equal(near_singular(YPR, many), [True, False, True, False])
    np.testing.assert_array_equal(near_singular(YRP, many), [False, True, True, False])


@pytest.mark.parametrize(
    ("position", "regular", "published"),
    [
        ("X1 up", YRP, YPR),
        ("X1 down", YRP, YPR),
        ("Y1 up", YPR, YRP),
        ("Y1 down", YPR, YRP),
        ("Z1 up", YPR, YRP),
        ("Z1 down", YPR, YRP),
    ],
)
def test_which_sequence_reads_a_position(position, regular, published):
    _, axes, up = POSITIONS[position]
    C = Rotation.from_matrix(np.column_stack(axes))
    for length in (1.0, 9.81, 1e-3):
        scaled = length * np.array(up)
        assert SequenceRule.REGULAR.sequence_for(scaled) is regular
        assert SequenceRule.PUBLISHED.sequence_for(scaled) is published
    assert not near_singular(regular, angles_from_C_nb(regular, C))
    singular = near_singular(published, angles_from_C_nb(published, C))
    assert singular == (position[:2] != "Y1")  # singular for X1 and for Z1, regular for Y1


def test_x1_counts_as_vertical_within_45_deg():
    assert SequenceRule.REGULAR.sequence_for([sin(radians(46)), cos(radians(46)), 0]) is YRP
    assert SequenceRule.REGULAR.sequence_for([-sin(radians(46)), 0, cos(radians(46))]) is YRP
    assert SequenceRule.REGULAR.sequence_for([sin(radians(44)), 0, -cos(radians(44))]) is YPR


@six
def test_regular_reading_of_the_six_positions(angles, axes, up):
    C = Rotation.from_matrix(np.column_stack(axes))
    sequence = SequenceRule.REGULAR.sequence_for(up)
    read = np.degrees(angles_from_C_nb(sequence, C))
    # Read back as published, half a turn of roll of either sign; 1e-13 deg is rounding.
    assert np.abs(np.exp(1j * np.radians(read - angles)) - 1).max() < 1e-14


def test_y1_down_read_by_yaw_roll_pitch_turns_all_but_roll_over():
    C = Rotation.from_matrix(np.column_stack(POSITIONS["Y1 down"][1]))
    roll, yaw, pitch = angles_from_C_nb(YRP, C)
    assert roll == pytest.approx(0, abs=1e-15)
    assert abs(yaw) == pytest.approx(pi, abs=1e-15)
    assert abs(pitch) == pytest.approx(pi, abs=1e-15)


# --- small rotations ----------------------------------------------------------------------------


@both
@pytest.mark.parametrize("angles", [*ANGLES[:3], (0, 0, 0), (1.2, -2.0, -1.3)])
def test_jacobian_against_central_differences(sequence, angles):
    truth = by_hand(sequence, *angles)
    angles = angles_from_C_nb(sequence, Rotation.from_matrix(truth))
    step = 1e-5  # truncation step^2 tan^3(middle) < 1e-8, rounding 1e-16/step = 1e-11
    J = np.empty((3, 3))
    for k, axis in enumerate(np.eye(3)):
        plus, minus = (
            angles_from_C_nb(sequence, Rotation.from_rotvec(s * axis) * Rotation.from_matrix(truth))
            for s in (step, -step)
        )
        J[:, k] = (np.exp(1j * (plus - minus)).imag) / (2 * step)
    np.testing.assert_allclose(angle_jacobian(sequence, *angles), J, rtol=0, atol=2e-8)


@both
def test_jacobian_of_many_is_that_of_each(sequence):
    rows = np.array(ANGLES)
    J = angle_jacobian(sequence, *rows.T)
    assert J.shape == (4, 3, 3)
    for row, matrix in zip(rows, J, strict=True):
        # Entries up to 1/cos(middle) = 3; rounding.
        np.testing.assert_allclose(angle_jacobian(sequence, *row), matrix, rtol=0, atol=1e-14)


def test_jacobian_at_zero_by_hand():
    # Roll is a turn about north, pitch about east, yaw about up: minus down.
    want = [[1, 0, 0], [0, 0, -1], [0, 1, 0]]
    for sequence in Sequence:
        np.testing.assert_allclose(angle_jacobian(sequence, 0, 0, 0), want, rtol=0, atol=ROUNDING)


def test_heading_grows_with_a_rotation_about_down():
    truth = by_hand(YPR, 0.1, -0.7, 0.2)
    turned = Rotation.from_rotvec([0, 0, 1e-3]).as_matrix() @ truth
    found = heading_from_C_nb(Rotation.from_matrix(turned))
    assert found == pytest.approx(0.7 + 1e-3, abs=1e-15 * 4)
    np.testing.assert_allclose(rotvec_between(truth, turned), [0, 0, 1e-3], rtol=0, atol=1e-15)


@FIXED
@given(st.integers(0, 2**32 - 1), st.sampled_from(Sequence))
def test_sigmas_of_angles_are_those_of_perturbed_attitudes(seed, sequence):
    rng = np.random.default_rng(seed)
    truth = Rotation.random(None, rng)
    angles = angles_from_C_nb(sequence, truth)
    assume(abs(angles[2 if sequence is YPR else 0]) < radians(80))
    root = 1e-6 * rng.normal(size=(3, 3))  # small: second order is tan(80 deg)^2 1e-12/1e-6
    sigmas = angle_sigmas(sequence, angles, root @ root.T)
    # J P J^T by differences along each column of the root: its three terms add in squares.
    moved = np.stack(
        [
            angles_from_C_nb(sequence, Rotation.from_rotvec(column) * truth)
            - angles_from_C_nb(sequence, Rotation.from_rotvec(-column) * truth)
            for column in root.T
        ]
    )
    expected = np.linalg.norm(np.exp(1j * moved).imag / 2, axis=0)
    np.testing.assert_allclose(sigmas, expected, rtol=1e-6)  # truncation 1e-9, rounding 1e-9


@both
def test_no_sigmas_at_the_singularity(sequence):
    angles = np.radians([5.0, 10.0, 90.0] if sequence is YPR else [90.0, 10.0, 5.0])
    regular = np.array([0.3, 0.7, -0.2])
    P = np.diag([1.0, 2.0, 3.0])
    sigmas = angle_sigmas(sequence, np.array([angles, regular, -angles]), np.array([P, 4 * P, P]))
    assert np.isnan(sigmas[[0, 2]]).all()
    # Rows do not mix: only the order of sums may differ.
    alone = angle_sigmas(sequence, regular, P)
    np.testing.assert_allclose(sigmas[1], 2 * alone, rtol=1e-14)
    C = Rotation.from_matrix(by_hand(sequence, *angles))
    estimate = AttitudeEstimate("m", "p", 0, 1, C, sequence, covariance=np.diag([1.0, 2, 3]))
    assert estimate.singular
    assert estimate.sigmas is None


def test_an_estimate_without_attitude_has_no_angles():
    estimate = AttitudeEstimate("m", "a + b", 0, 1, None, YPR, latitude=0.9)
    assert estimate.angles is None
    assert estimate.heading is None
    assert estimate.sigmas is None
    assert not estimate.singular


def test_an_estimate_owns_its_covariance():
    covariance = np.diag([0.01, 0.02, 0.03])  # a radian of sigma would leave no angle
    C = Rotation.from_matrix(by_hand(YPR, 0.1, -0.7, 0.2))
    estimate = AttitudeEstimate("m", "p", 0, 1, C, YPR, covariance=covariance)
    covariance[:] = 0
    np.testing.assert_array_equal(estimate.covariance, np.diag([0.01, 0.02, 0.03]))
    assert estimate.heading == pytest.approx(0.7, abs=1e-15 * 4)  # rounding
    np.testing.assert_allclose(estimate.angles, [0.1, -0.7, 0.2], rtol=0, atol=1e-15 * 4)
    with pytest.raises(ValueError, match=r"covariance: shape \(2, 2\)"):
        AttitudeEstimate("m", "p", 0, 1, C, YPR, covariance=np.eye(2))
