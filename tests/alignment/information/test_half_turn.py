"""[S4] (11)-(16) against half turns made with rotations; the order of each remainder."""

from math import acos, asin, atan2, cos, pi, radians, sin, tan

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from alignment.information.half_turn import (
    Posture,
    TurnedErrors,
    better_turn,
    heading_limit,
    heading_turn_error,
    horizontal_readings,
    levelling_limit,
    pitch_terms,
    rate_across,
    rate_along,
    roll_terms,
    roll_terms_as_printed,
    yaw_by_pitch,
    yaw_terms,
)

W, G = 7.292115e-5, 9.81
MINUTE = pi / 180 / 60
SECOND = MINUTE / 60
POSTURES = [
    Posture(radians(roll), radians(pitch), radians(yaw), radians(latitude))
    for roll, pitch, yaw, latitude in ((5, 5, 90, 50), (-12, 8, 40, -33), (20, -15, -110, 65))
]


def attitude(p):
    """C from b to NUE: yaw about up, pitch about Z1, roll about X1."""
    return Rotation.from_euler("YZX", [p.yaw, p.pitch, p.roll])


def half_turn(p, errors, first, second, bias=0.0):
    """Mean rates and forces (6,): X1, Z1 half the difference, Y1 half the sum, of both positions.

    `bias` of every X1 and Z1 sensor: it must cancel.
    """
    w_n = W * np.array([cos(p.latitude), sin(p.latitude), 0.0])
    read = []
    for angle in (first, pi + second):
        C = attitude(p) * Rotation.from_rotvec([0.0, angle, 0.0])
        f = C.inv().apply([0.0, G, 0.0]) * (1 + np.array(errors.scale))
        w = C.inv().apply(w_n) * (1 + np.array([errors.gyro_scale, 0, 0]))
        f += [bias, errors.accel_y, bias]
        w += [1e-5 * bias, 0, 1e-5 * bias]
        read.append(np.concatenate([w, f]))
    sign = np.array([-1, 1, -1] * 2)
    return (read[0] + sign * read[1]) / 2


def errors_of(p, errors, known_pitch=None):
    """Errors of roll, pitch (asin), yaw of the analytic formulas; placed by D in both positions."""
    m = half_turn(p, errors, errors.placement, errors.placement, bias=0.3)
    roll, pitch = atan2(-m[5], m[4]), asin(m[3] / G)
    th = pitch if known_pitch is None else known_pitch
    cosine = (m[0] - W * sin(p.latitude) * sin(th)) / (W * cos(p.latitude) * cos(th))
    yaw = np.copysign(acos(cosine), p.yaw)
    return roll - p.roll, pitch - p.pitch, yaw - p.yaw


def order(exact, linear):
    """Remainders at full and half size of the errors: their ratio, 4 for a first-order formula."""
    return (exact(1.0) - linear) / (exact(0.5) - linear / 2)


TERMS = [
    ("bias", lambda s: TurnedErrors(accel_y=0.05 * s), 0),
    ("scale", lambda s: TurnedErrors(scale=(0.0, 0.002 * s, -0.003 * s)), 1),
    ("placement", lambda s: TurnedErrors(placement=2e-3 * s), 2),
]


@pytest.mark.parametrize("p", POSTURES)
@pytest.mark.parametrize(("name", "made", "k"), TERMS, ids=[t[0] for t in TERMS])
def test_roll_term_by_term(p, name, made, k):
    linear = roll_terms(p, G, made(1.0))
    assert np.delete(linear, k) == pytest.approx([0, 0], abs=0)
    ratio = order(lambda s: errors_of(p, made(s))[0], linear[k])
    assert ratio == pytest.approx(4, rel=0.05)  # next order: a part of some 0.5 % of itself
    # the printed terms are errors of the tangent
    printed = roll_terms_as_printed(p, G, made(1.0))[k]
    in_tangent = order(lambda s: tan(p.roll + errors_of(p, made(s))[0]) - tan(p.roll), printed)
    assert in_tangent == pytest.approx(4, rel=0.05)


def test_printed_roll_by_hand():
    """-(b_y/(g cos th cos ga)) tan ga and (K_z - K_y) tan ga and -tan th D/cos ga, 30 deg roll."""
    p = Posture(pi / 6, radians(10), 1.0, 0.8)
    found = roll_terms_as_printed(p, G, TurnedErrors(0.1, (0, 1e-3, 3e-3), 0.0, 1e-4))
    root = 3**0.5
    want = [
        -0.1 / (G * cos(radians(10)) * root / 2) / root,
        2e-3 / root,
        -tan(radians(10)) * 1e-4 / (root / 2),
    ]
    np.testing.assert_allclose(found, want, rtol=1e-12)


@pytest.mark.parametrize("p", POSTURES)
def test_pitch_term_by_term(p):
    for k, made in (
        (0, lambda s: TurnedErrors(scale=(0.002 * s, 0.0, 0.0))),
        (1, lambda s: TurnedErrors(placement=2e-3 * s)),
    ):
        linear = pitch_terms(p, made(1.0))
        assert linear[1 - k] == 0
        ratio = order(lambda s, made=made: errors_of(p, made(s))[1], linear[k])
        assert ratio == pytest.approx(4, rel=0.05)


@pytest.mark.parametrize("p", POSTURES)
def test_yaw_term_by_term(p):
    """(15) with the pitch known; with the pitch of the same turn, what it leaves out too."""
    scale = yaw_terms(p, TurnedErrors(gyro_scale=0.002))[0]
    by_scale = order(lambda s: errors_of(p, TurnedErrors(gyro_scale=0.002 * s), p.pitch)[2], scale)
    # at psi = 90 deg the arc cosine does not bend: third order
    assert by_scale == pytest.approx(8 if abs(cos(p.yaw)) < 1e-12 else 4, rel=0.05)
    placed = TurnedErrors(placement=1e-3)
    alone = yaw_terms(p, placed)[1]
    ratio = order(lambda s: errors_of(p, TurnedErrors(placement=1e-3 * s), p.pitch)[2], alone)
    assert ratio == pytest.approx(4, rel=0.05)
    whole = alone + yaw_by_pitch(p, pitch_terms(p, placed)[1])
    ratio = order(lambda s: errors_of(p, TurnedErrors(placement=1e-3 * s))[2], whole)
    assert ratio == pytest.approx(4, rel=0.05)
    assert abs(whole - alone) > 0.03 * abs(alone)  # it is not little


@pytest.mark.parametrize("p", POSTURES)
def test_rates_in_b(p):
    w = attitude(p).inv().apply(W * np.array([cos(p.latitude), sin(p.latitude), 0.0]))
    assert rate_along(p) == pytest.approx(w[0], rel=1e-12)
    assert rate_across(p) == pytest.approx(w[2], rel=1e-12)
    across = w[2] / (W * cos(p.latitude) * cos(p.pitch) * sin(p.yaw))
    assert yaw_terms(p, TurnedErrors(placement=1.0))[1] == pytest.approx(across, rel=1e-12)


def test_readings_of_both_positions():
    """(11)-(12): exact but for the cosine of the placement, d^2/2."""
    p, (first, second) = POSTURES[1], (1e-3, -2e-3)
    found = horizontal_readings(p, G, first, second)
    readings = np.transpose(found)  # by position
    for k, angle in enumerate((first, pi + second)):
        C = attitude(p) * Rotation.from_rotvec([0.0, angle, 0.0])
        f = C.inv().apply([0.0, G, 0.0])
        np.testing.assert_allclose(readings[k], f[[0, 2]], atol=G * 2e-3**2 / 2)
    # half the difference is what `placement` says: g sin th + g cos th sin ga D
    D = (sin(first) + sin(second)) / 2
    half = (found[0][0] - found[0][1]) / 2
    assert half == pytest.approx(G * (sin(p.pitch) + cos(p.pitch) * sin(p.roll) * D), rel=1e-12)


def test_when_the_turn_pays_by_hand():
    # [S4] prints 1'' at 5e-5 m/s^2 and 1.7' at 5e-3
    assert levelling_limit(5e-5, G) / SECOND == pytest.approx(1.0513, abs=1e-4)
    assert levelling_limit(5e-3, G) / MINUTE == pytest.approx(1.752, abs=1e-3)
    # X1 west, level, latitude 60: the whole horizontal rate is across, W/2
    p = Posture(0.0, 0.0, pi / 2, pi / 3)
    assert rate_across(p) == pytest.approx(W / 2, rel=1e-12)
    assert heading_limit(p, W / 2 * MINUTE) == pytest.approx(MINUTE, rel=1e-12)
    assert heading_turn_error(p, MINUTE) == pytest.approx(W / 2 * MINUTE, rel=1e-12)
    assert better_turn(p, W / 2 * MINUTE, 0.99 * MINUTE) == 180
    assert better_turn(p, W / 2 * MINUTE, 1.01 * MINUTE) == 90
    north = Posture(0.0, 0.0, 0.0, pi / 3)
    assert better_turn(north, 0.0, 1.0) == 180  # nothing is mixed in: the turn always pays
