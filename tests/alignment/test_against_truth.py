import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from alignment.against_truth import angle_errors, heading_errors, rotation_error
from alignment.angles import C_nb_from_angles, Sequence, heading_row, headings
from alignment.estimate import heading_sigmas
from alignment.noise import FLICKER_FLOOR
from alignment.quaternions import turned_evenly
from alignment.units import DEG

YPR = Sequence.YAW_PITCH_ROLL


def nose(heading_deg: float, pitch_deg: float = 0.0) -> Rotation:
    """Yaw is positive from north to west: heading = -yaw."""
    return C_nb_from_angles(YPR, 0.0, -heading_deg * DEG, pitch_deg * DEG)


def test_three_ways_by_hand():
    """One degree to the east of true, across north: about down, and of yaw, which is westward."""
    found, true = nose(0.5), nose(359.5)
    assert rotation_error(found, true) / DEG == pytest.approx([0, 0, 1], abs=1e-12)
    assert angle_errors(YPR, found, true) / DEG == pytest.approx([0, -1, 0], abs=1e-12)
    assert heading_errors(found, true) / DEG == pytest.approx(1, abs=1e-12)
    assert float(headings(nose(-1e-20))) == 0.0  # not 2 pi


def test_vertical_x1_points_nowhere():
    assert np.isnan(heading_errors(nose(0, 89.6), nose(0)))
    assert np.isnan(heading_errors(nose(0), nose(0, -89.6)))
    assert heading_errors(nose(10, 89.4), nose(0)) / DEG == pytest.approx(10, abs=1e-9)
    assert heading_row(Rotation.from_matrix([[0, 0, 1], [0, 1, 0], [-1, 0, 0]])).tolist() == [0] * 3


def test_many_as_each():
    true = Rotation.random(20, random_state=1)
    found = Rotation.from_rotvec(0.01 * np.eye(3)[np.arange(20) % 3]) * true
    each = [heading_errors(a, b) for a, b in zip(found, true, strict=True)]
    np.testing.assert_allclose(heading_errors(found, true), each, rtol=0, atol=1e-15)
    np.testing.assert_allclose(
        rotation_error(found, true), 0.01 * np.eye(3)[np.arange(20) % 3], rtol=0, atol=1e-14
    )
    P = np.tile(np.diag([1.0, 4.0, 9.0]) * DEG**2, (20, 1, 1))
    sigmas = [heading_sigmas(a, p) for a, p in zip(true, P, strict=True)]
    np.testing.assert_allclose(heading_sigmas(true, P), sigmas, rtol=1e-14)


def test_heading_row_by_differences():
    """Raised by 30 deg and heading north, X1 turns by tan 30 of a roll about north, to the west."""
    raised, eta = nose(0, 30), 1e-6
    turned = Rotation.from_rotvec(np.eye(3) * eta) * raised
    by_differences = heading_errors(turned, raised) / eta
    assert heading_row(raised) == pytest.approx([np.tan(30 * DEG), 0, 1], abs=1e-12)
    assert by_differences == pytest.approx(heading_row(raised), abs=1e-6)  # second order of eta
    assert heading_sigmas(raised, np.diag([3.0, 1, 0]) * DEG**2) / DEG == pytest.approx(1.0)


def test_turned_evenly_by_hand():
    """A quarter turn in 2 s: 30 deg after 2/3 s; before the first and after the last it stays."""
    q = Rotation.from_euler("z", [[0], [90], [90]], degrees=True).as_quat()
    at = np.array([9.0, 10.0, 10 + 2 / 3, 12.0, 13.0, 99.0])
    found = turned_evenly(np.array([10.0, 12.0, 14.0]), q, at)
    assert found.as_euler("zyx", degrees=True)[:, 0] == pytest.approx([0, 0, 30, 90, 90, 90])


def test_floor_of_flicker_noise():
    assert pytest.approx(np.sqrt(2 * np.log(2) / np.pi), abs=5e-4) == FLICKER_FLOOR  # three digits
