"""Two-sample strapdown integration: against closed forms of coning, turning and free fall."""

from math import cos, pi, radians, sin

import numpy as np
import pytest
from rocking import Angle, Motion, earth_n
from scipy.spatial.transform import Rotation

from alignment import ImuReadings, strapdown
from alignment.errors import AlignmentError
from alignment.methods import integration
from alignment.strapdown import (
    Made,
    carry,
    cross,
    integrate,
    matrices,
    quaternions,
    rates_at_edges,
    rotation_vectors,
    velocity_vectors,
)

ROCKING = Motion(
    yaw=Angle(0.7, amplitude=0.05, frequency=0.13),
    pitch=Angle(0.1, amplitude=0.09, phase=1.0),
    roll=Angle(-0.05, amplitude=0.07, frequency=0.17, phase=0.3),
    lever=(0.1, 0.05, -0.08),
)


def record(motion, seconds, rate, start=20.0):
    t, w, f, C = motion.readings(seconds, rate, start)
    return ImuReadings(t, w, f), C


def turn_error(q, C):
    """Rotation vector of what attitude `q` has beyond matrix C [rad]."""
    return Rotation.from_matrix(Rotation.from_quat(q).as_matrix() @ C.T).as_rotvec()


@pytest.mark.parametrize("seconds", [60.0, 60.03])
def test_instants_of_a_rocking_carry_as_their_means_do(seconds):
    """The first mean is off by 3 (w h)^3/8 (w = 1.1 1/s, h = 0.01 s: 5e-7) of 0.1 rad/s over
    0.01 s, at the most of two axes: 1e-9 rad, which leans 589 m/s; others by 11 (w h)^4/720.
    Taken for means they are half a sample late: 0.005 s times 0.1 rad/s leans that.
    """
    means, _ = record(ROCKING, seconds, 100.0)
    n = len(means)
    _, w, f = ROCKING.state(np.arange(1, n + 1) / 100.0)
    instants = ImuReadings(means.t, w, f, instants=True)
    one, other = (carry(r, 0.1) for r in (means, instants))
    late = carry(ImuReadings(means.t, w, f), 0.1)
    assert np.abs(other.q - one.q).max() < 1e-9
    assert np.abs(other.v - one.v).max() < 6e-7
    assert np.abs(late.v - one.v).max() > 1e-2


# --- the pieces -------------------------------------------------------------------------------


def test_cross_products_by_hand():
    x, y, z = np.eye(3)
    got = cross(np.array([x, y, z, x + 2 * y]), np.array([y, z, x, 3 * z]))
    np.testing.assert_array_equal(got, [z, x, y, 6 * x - 3 * y])


def test_quaternions_and_matrices_are_those_of_rotation_vectors():
    v = np.random.default_rng(2).normal(size=(50, 3))
    v[:2] = [[0, 0, 0], [1e-9, 0, -2e-9]]
    q = quaternions(v)
    # Rounding alone.
    np.testing.assert_allclose(np.linalg.norm(q, axis=1), 1, rtol=0, atol=1e-15)
    np.testing.assert_allclose(matrices(q), Rotation.from_rotvec(v).as_matrix(), rtol=0, atol=2e-15)


# --- coning -----------------------------------------------------------------------------------


def coning(c, w, h, n):
    """Exact mean rates (n, 3) of a cone about x with half angle c, and its attitudes (n + 1).

    b's rotation vector is ``c (0, cos wt, sin wt)``, so that its rate is
    ``w (cos c - 1, -sin c sin wt, sin c cos wt)``: integrated here in closed form.
    """
    t = h * np.arange(n + 1)
    zero, cosine, sine = np.zeros(n + 1), np.cos(w * t), np.sin(w * t)
    integral = np.stack([w * t * (np.cos(c) - 1), sin(c) * cosine, sin(c) * sine], axis=1)
    return np.diff(integral, axis=0) / h, Rotation.from_rotvec(
        c * np.stack([zero, cosine, sine], axis=1)
    )


@pytest.mark.parametrize(("frequency", "rate"), [(5.0, 100.0), (2.0, 50.0), (5.0, 200.0)])
def test_drift_under_coning_is_that_of_closed_form_beside_runge_kutta(frequency, rate):
    c, w, h = radians(1.0), 2 * pi * frequency, 1 / rate
    n = round(60 * rate)
    rates, attitude = coning(c, w, h, n)
    t = h * np.arange(1, n + 1)
    readings = ImuReadings(t, rates, np.zeros((n, 3)))
    ends = np.array([n // 2, n])
    drift = {}
    for method in (strapdown, integration):
        C = method.integrate(readings, attitude[0], np.zeros(3), np.zeros(3), ends)
        drift[method] = (C * attitude[ends].inv()).as_rotvec()[:, 0] / t[ends - 1]
    x = w * h
    # The next order is smaller by x^2/10 or so: 1 % at x = 0.31; the cone itself by c^2.
    np.testing.assert_allclose(drift[strapdown], -(c**2) * w * x**4 / 60, rtol=0.02)
    # Rates held over a sample leave out the whole of the coning within it.
    np.testing.assert_allclose(drift[integration], -(c**2) * w * x**2 / 12, rtol=0.02)


def test_error_of_one_step_is_of_fifth_order():
    """``c^2 x^5/30`` over two samples: halving the step divides it by 32."""
    errors = []
    for h in (0.04, 0.02):
        rates, attitude = coning(0.01, 2 * pi, h, 2)
        found = rotation_vectors(rates[:1] * h, rates[1:] * h)[0]
        exact = (attitude[0].inv() * attitude[2]).as_rotvec()
        errors.append(np.linalg.norm(found - exact))
    assert errors[0] / errors[1] == pytest.approx(32, rel=0.05)
    assert errors[0] == pytest.approx(0.01**2 * (2 * pi * 0.04) ** 5 / 30, rel=0.05)


# --- velocity ---------------------------------------------------------------------------------


def test_velocity_of_a_force_that_stands_still_in_inertial_space():
    """Whatever b does, the integral of a constant in i is its product with time."""
    readings, _ = record(ROCKING, 60.0, 100.0)
    f_i = np.array([1.0, -2.0, 9.0])
    C, _, _ = ROCKING.state(np.array([0.0]))
    nodes, weights = np.polynomial.legendre.leggauss(5)
    f_b = np.zeros((len(readings), 3))
    earth = earth_n(ROCKING.latitude_deg)
    for x, g in zip(nodes, weights, strict=True):
        t = readings.t - 20.0 - (1 - x) / 200
        turned = Rotation.from_rotvec(t[:, None] * earth).as_matrix() @ ROCKING.state(t)[0]
        f_b += g / 2 * np.einsum("nji,j->ni", turned, C[0] @ f_i)
    carried = carry(ImuReadings(readings.t, readings.w_ib_b, f_b), 0.5)
    elapsed = (carried.t - carried.t[0])[:, None]
    # Third order in the turn within a step, |w| 2 h = 0.003: 1e-9 of it, summed over 60 s.
    np.testing.assert_allclose(carried.v, f_i * elapsed, rtol=0, atol=1e-6)
    middles = 0.5 * (elapsed[1:] + elapsed[:-1]) * carried.spans[:, None]
    np.testing.assert_allclose(carried.p, f_i * middles, rtol=0, atol=1e-6)


def test_sculling_and_rotation_terms_by_one_term_at_a_time():
    zero, x, y = np.zeros((1, 3)), np.array([[0.02, 0, 0]]), np.array([[0, 0.1, 0]])
    # No turn: increments add. Turn in the first sample, force in the second: all of it turned,
    # x cross y = z, and a twelfth for the rate that ends and one for the force that begins.
    np.testing.assert_array_equal(sum(velocity_vectors(zero, zero, y, 2 * y)), 3 * y)
    got = sum(velocity_vectors(x, zero, zero, y))[0]
    part, s, c = 0.02 / 12, sin(0.02), cos(0.02)
    across = s + part * c
    expected = [0, c - part * s - part * across, across + part * (c - part * s)]
    np.testing.assert_allclose(got, 0.1 * np.array(expected), rtol=1e-12)
    assert got[2] == pytest.approx(0.1 * 0.02 * (1 / 2 + 2 / 3), rel=1e-3)
    # The other way round the turn comes too late for the force: 1/2 - 2/3 of it.
    got = sum(velocity_vectors(zero, x, y, zero))[0]
    assert got[2] == pytest.approx(0.1 * 0.02 * (1 / 2 - 2 / 3), rel=1e-12)


@pytest.mark.parametrize("turn", [0.02, 0.19])
def test_a_steady_turn_leaves_gravity_as_it_is(turn):
    """About an axis aslant to it, by 0.19 rad a sample: 2e-6 of it were lost by sculling alone, as
    much as 2 arc seconds to a filter. What is fixed in b is one of fourth order, ``turn^4/120``."""
    axis, g = np.array([1.0, 2.0, -2.0]) / 3, np.array([0.3, -0.4, 9.7])

    def sample(force, k):
        x, weights = np.polynomial.legendre.leggauss(9)
        at = Rotation.from_rotvec(-turn * (k + (1 + x[:, None]) / 2) * axis)
        return weights / 2 @ at.apply(force)

    angle = turn * axis[None]
    found = sum(velocity_vectors(angle, angle, sample(g, 0)[None], sample(g, 1)[None]))[0]
    np.testing.assert_allclose(found, 2 * g, rtol=0, atol=turn**6 * 1e-4 + 1e-14)
    found = sum(velocity_vectors(angle, angle, g[None], g[None]))[0]
    x, weights = np.polynomial.legendre.leggauss(9)
    exact = weights @ Rotation.from_rotvec(turn * (1 + x[:, None]) * axis).apply(g)
    np.testing.assert_allclose(found, exact, rtol=0, atol=10 * turn**4 / 30)


# --- carrying a record ------------------------------------------------------------------------


@pytest.mark.parametrize("seconds", [40.0, 40.01, 40.07])  # even, odd, and a partial first block
def test_attitude_and_velocity_come_back_to_the_truth(seconds):
    readings, C_end = record(ROCKING, seconds, 100.0)
    carried = carry(readings, 0.5)
    C_start, _, _ = ROCKING.state(np.array([0.0]))
    span = round(seconds * 100) / 100
    assert carried.t[0] == pytest.approx(20.0, abs=1e-9)
    assert carried.spans.sum() == pytest.approx(span, abs=1e-9)
    earth = Rotation.from_rotvec(span * earth_n(ROCKING.latitude_deg)).as_matrix()
    # Coning of some degrees at 0.2 Hz, (w h)^4/60 of it: below 1e-9 rad.
    error = turn_error(carried.q[-1], C_start[0].T @ earth @ C_end)
    np.testing.assert_allclose(error, 0, rtol=0, atol=1e-9)
    np.testing.assert_allclose(carried.dv.sum(axis=0), readings.f_b.sum(axis=0) / 100, rtol=1e-12)
    np.testing.assert_allclose(
        carried.dtheta.sum(axis=0), readings.w_ib_b.sum(axis=0) / 100, rtol=0, atol=1e-12
    )


def test_blocks_and_chunks_change_nothing(monkeypatch):
    readings, _ = record(ROCKING, 30.03, 100.0)
    fine, coarse = carry(readings, 0.1), carry(readings, 1.0)
    monkeypatch.setattr(strapdown, "_CHUNK", 170)
    pieces = carry(readings, 0.1)
    for name in ("q", "v", "p", "turned"):
        # Rounding of sums over 1500 steps of 0.2 m/s, at 300 m/s.
        np.testing.assert_allclose(getattr(pieces, name), getattr(fine, name), atol=1e-10)
    np.testing.assert_allclose(coarse.q[-1], fine.q[-1], rtol=0, atol=1e-13)
    np.testing.assert_allclose(coarse.v[-1], fine.v[-1], rtol=0, atol=1e-10)
    for name in ("p", "turned"):
        np.testing.assert_allclose(
            getattr(coarse, name).sum(axis=0), getattr(fine, name).sum(axis=0), atol=1e-8
        )


def test_what_sensors_make_of_what_is_true_is_undone():
    readings, _ = record(ROCKING, 10.0, 50.0)
    gain = np.array([[1.01, 0.02, 0.0], [0.0, 0.99, -0.01], [0.03, 0.0, 1.0]])
    gyro, accel = Made(np.array([1e-3, -2e-3, 3e-3]), gain), Made(np.array([0.1, 0.2, 0.0]), gain.T)
    w, f = readings.w_ib_b @ gain.T + gyro.offset, readings.f_b @ gain + accel.offset
    want = carry(readings, 0.5)
    found = carry(ImuReadings(readings.t, w, f), 0.5, gyro, accel)
    np.testing.assert_allclose(found.q, want.q, atol=1e-13)  # rounding of 500 steps
    np.testing.assert_allclose(found.v, want.v, rtol=0, atol=1e-10)


@pytest.mark.parametrize("first", [0, 1])
def test_places_are_those_of_a_force_that_swings(first):
    """``a sin(w t)`` along X1 five times a swing: the parabola in steps of 0.4 s is off by
    ``(0.4 w)^4/2880`` of the place, trapezoids by ``(0.4 w)^2/12``: 0.9 and 15 parts in a hundred.
    Of an odd number of samples the first step has one, and a line is all that it is known by."""
    rate, w, n = 5, 2 * np.pi * 0.54, 200 - first
    edges = np.arange(n + 1) / rate
    f = np.zeros((n, 3))
    f[:, 0] = -np.diff(np.cos(w * edges)) * rate / w
    carried = carry(ImuReadings(edges[1:], np.zeros((n, 3)), f), 0.4)
    steps = edges[first::2]  # v = (1 - cos w t)/w
    place = np.diff(steps - np.sin(w * steps) / w) / w
    swing = np.diff(np.sin(w * steps)) / w**2
    left = carried.p[first:, 0] - place
    assert np.abs(left).max() < 1.1 * (0.4 * w) ** 4 / 2880 * np.abs(swing).max()
    assert np.abs(left).max() > 0.5 * (0.4 * w) ** 4 / 2880 * np.abs(swing).max()


def test_rates_at_edges_are_those_of_a_parabola():
    """Means of ``t^2`` over 0.4 s are ``t^2 + 0.4^2/12``; edges are met, the last one too."""
    t = np.arange(1, 21) / 5
    w = np.zeros((20, 3))
    w[:, 1] = 1e-2 * ((t - 0.1) ** 2 + 0.2**2 / 12)
    carried = carry(ImuReadings(t, w, np.zeros((20, 3))), 0.4)
    np.testing.assert_allclose(rates_at_edges(carried)[:, 1], 1e-2 * carried.t**2, atol=1e-15)
    short = carry(ImuReadings(t[:4], w[:4], np.zeros((4, 3))), 0.4)
    means = short.dtheta / 0.4
    np.testing.assert_allclose(rates_at_edges(short), [means[0], *means], atol=1e-15)


def test_turned_is_the_integral_of_the_attitude():
    """Turning about Y1 at a constant rate: its matrix integrates to sines and cosines."""
    rate, n = 0.3, 400
    t = np.arange(1, n + 1) / 100
    readings = ImuReadings(t, np.tile([0, rate, 0], (n, 1)), np.zeros((n, 3)))
    total = carry(readings, 0.5).turned.sum(axis=0)
    s, c = np.sin(rate * 4) / rate, (1 - np.cos(rate * 4)) / rate
    # Trapezoids of 0.02 s: (0.3 * 0.02)^2/12 of 4 s.
    np.testing.assert_allclose(total, [[s, 0, c], [0, 4, 0], [-c, 0, s]], rtol=0, atol=2e-5)


def test_integrate_holds_the_earth_and_any_ends():
    """At rest attitude stays; ends after odd numbers of samples cost nothing there."""
    motion = Motion(yaw=Angle(1.0), pitch=Angle(0.2), latitude_deg=-33.0)
    readings, C = record(motion, 50.0, 10.0)
    offset = np.array([2e-4, -1e-4, 5e-5])
    raw = ImuReadings(readings.t, readings.w_ib_b + offset, readings.f_b)
    found = integrate(raw, Rotation.from_matrix(C), earth_n(-33.0), offset, np.array([1, 77, 500]))
    np.testing.assert_allclose(found.as_matrix(), [C] * 3, rtol=0, atol=1e-13)


def test_too_fast_for_the_sampling_rate_is_refused():
    n = 100
    fast = ImuReadings(np.arange(1, n + 1) / 10, np.tile([0, -3.0, 0], (n, 1)), np.zeros((n, 3)))
    with pytest.raises(AlignmentError, match=r"0\.30 rad in a sample"):
        carry(fast, 1.0)
