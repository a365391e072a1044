"""Covariances of vector matching against differences of it, and long intervals against short."""

import sys
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from test_vectors import RATE, VectorOptions, record

from alignment import ImuReadings, Priors
from alignment.errors import AlignmentError
from alignment.methods.vectors import observing
from alignment.methods.vectors.channel import (
    POS,
    POS_DRIFT,
    PSI,
    STATES,
    VEL,
    VEL_DRIFT,
    State,
    carried,
    steps,
)
from alignment.methods.vectors.effects import Effects
from alignment.methods.vectors.method import answer
from alignment.methods.vectors.observing import _isotropic
from alignment.navigation import gravitation, integrals
from alignment.readings import Fixes

# --- the observing form

SECONDS = 5
SIGMA_R, SIGMA_V = 5.0, 0.05
PRIORS = Priors(gyro_bias=3e-4, accel_bias=0.02, gyro_walk=4e-4)
OPTIONS = VectorOptions(priors=PRIORS, step=1.0, largest_sigma=0.5)


@pytest.fixture(scope="module")
def perfect():
    return record("fast", np.random.default_rng(0), noise=0, last=float(SECONDS))


def turned(run, readings=None, fixes=None):
    """The attitude at the last fix."""
    found = observing(readings or run.readings, fixes or run.fixes, run.start, OPTIONS)
    return found.C_nb[-1]


def moved(fixes, k, velocity, place):
    v, r = fixes.velocity.copy(), fixes.position.copy()
    v[k] += velocity
    r[k] += place
    return Fixes(fixes.t, r, v, SIGMA_R, SIGMA_V)


def responses(run):
    """Rotations about n per sigma of every source of error, by differencing; one row each."""
    base, r, fixes = turned(run), run.readings, run.fixes

    def per_sigma(found, part):
        return (found * base.inv()).as_rotvec() / part

    part = 0.01  # of a sigma: the response is straight
    rows = {"fixes": [], "constant": [], "walk": []}
    for axis in np.eye(3):
        for k in range(len(fixes.t)):
            for v, p in ((SIGMA_V, 0.0), (0.0, SIGMA_R)):
                there = moved(fixes, k, part * v * axis, part * p * axis)
                rows["fixes"].append(per_sigma(turned(run, fixes=there), part))
        for w, f in ((PRIORS.gyro_bias, 0.0), (0.0, PRIORS.accel_bias)):
            biased = ImuReadings(r.t, r.w_ib_b + part * w * axis, r.f_b + part * f * axis)
            rows["constant"].append(per_sigma(turned(run, biased), part))
        for k in range(SECONDS):  # a walk's turn in the middle of a second: half before, half after
            w = r.w_ib_b.copy()
            at = k * RATE + RATE // 2
            w[at - 1 : at + 1] += part * PRIORS.gyro_walk * axis * RATE / 2
            rows["walk"].append(per_sigma(turned(run, ImuReadings(r.t, w, r.f_b)), part))
    return {name: np.array(found) for name, found in rows.items()}


def test_covariance_of_the_observing_form_is_the_sum_of_its_responses(perfect):
    """Each source counts, none by less than a hundredth of what is compared."""
    rows = responses(perfect)
    found = observing(perfect.readings, perfect.fixes, perfect.start, OPTIONS)
    assert found.corrected[-1]
    want = sum(J.T @ J for J in rows.values())
    scale = np.sqrt(np.outer(want.diagonal(), want.diagonal()))
    # the weights move with the readings: a part in a hundred of a response to a part of a sigma
    np.testing.assert_allclose(found.covariance[-1] / scale, want / scale, atol=0.01)
    for name, J in rows.items():
        assert np.trace(J.T @ J / scale) > 0.03, name


def test_place_begins_where_all_fixes_say(perfect):
    """A first velocity wrong by 1 m/s and a first place by 20 m: both are found, and carried on.

    The attitude takes some of it, so that a third of a metre per second may be left of it.
    """
    fixes = moved(perfect.fixes, 0, np.array([0.6, 0.0, 0.8]), np.array([0.0, 20.0, 0.0]))
    found = observing(perfect.readings, fixes, perfect.start, OPTIONS)
    off = np.linalg.norm(found.position[-1] - perfect.fixes.position[-1])
    assert off < 0.35 * SECONDS + 20 / len(fixes.t)
    exact = observing(perfect.readings, perfect.fixes, perfect.start, OPTIONS)
    np.testing.assert_allclose(exact.position[-1], perfect.fixes.position[-1], atol=0.1)
    assert exact.estimates()[-1].flags == ()


def test_the_observing_form_takes_so_many_fixes(perfect, monkeypatch):
    module = sys.modules[observing.__module__]
    count = len(perfect.fixes.t)
    monkeypatch.setattr(module, "MOST", count)
    turned(perfect)
    monkeypatch.setattr(module, "MOST", count - 1)
    with pytest.raises(AlignmentError) as caught:
        turned(perfect)
    assert str(caught.value) == (
        f"{count} fixes: the observing form takes {count - 1} at most: take fewer"
    )


# --- the inertial channel


def at_rest(P=None):
    zero = np.zeros(3)
    C = Rotation.from_rotvec([0.3, -0.5, 0.8]).as_matrix()
    r = np.array([6.4e6, 0.0, 0.0])
    P = np.zeros((STATES, STATES)) if P is None else P
    none = np.zeros(0)
    return State(C, zero, r, zero, accel=zero, r_drift=zero, v_drift=zero, more=none, P=P)


def propagated(times, state, fixes, priors):
    """Through an even force, without turning, over the stretches between `times`."""
    n = round(times[-1] * 10)
    t = np.arange(1, n + 1) / 10
    readings = ImuReadings(t, np.zeros((n, 3)), np.tile([2.0, -9.0, 4.0], (n, 1)))
    sensed = integrals(readings, np.asarray(times))
    none = Effects(*np.zeros((3, len(times), 3, 0)))
    stretches = steps(SimpleNamespace(t=times, sensed=sensed, effects=none))
    for k in range(len(times) - 1):
        state = carried(state, stretches, k, times[k], fixes, priors)
    return state


def drifting(position=0.0, velocity=0.0):
    return SimpleNamespace(position_drift=position, velocity_drift=velocity, drift_time=3.0)


def test_a_fast_vehicle_falls_as_gravitation_changes_on_its_way():
    """Outward at 1 km/s for 4 s: gravitation falls by 2/r of itself per metre, to first order.

    ``dg/dt = 2 g v/r`` moves it by ``T^3/6`` of that, 33 mm; the rest is 0.02 of it at most.
    """
    outward = replace(at_rest(), v=np.array([1000.0, 0.0, 0.0]))
    r0 = outward.r[0]
    g = gravitation(outward.r, 0.0)
    found = propagated([0.0, 4.0], outward, drifting(), Priors())
    pushed = outward.C @ np.array([2.0, -9.0, 4.0])
    steady = outward.r + 4 * outward.v + 8 * (g + pushed)
    moved = found.r - steady
    by_hand = -2 * g[0] * 1000 / r0 * 4**3 / 6
    assert by_hand == pytest.approx(0.0325, rel=0.02)
    assert moved[0] == pytest.approx(by_hand, rel=0.05)


@pytest.mark.parametrize("name", ["gyro_walk", "accel_walk", "gyro_bias", "accel_bias"])
def test_a_long_stretch_is_its_short_ones(name):
    priors = replace(Priors(), **{name: 1e-3})
    P = np.zeros((STATES, STATES))
    for sensor, first in (("gyro", 9), ("accel", 12)):
        own = slice(first, first + 3)
        P[own, own] = getattr(priors, f"{sensor}_bias") ** 2 * np.eye(3)
    once = propagated([0.0, 2.0], at_rest(P), drifting(), priors).P
    often = propagated(np.linspace(0, 2, 11), at_rest(P), drifting(), priors).P
    size = np.sqrt(once.diagonal())
    size[size == 0] = 1.0
    np.testing.assert_allclose(often / np.outer(size, size), once / np.outer(size, size), atol=1e-9)
    np.testing.assert_allclose(once, once.T, atol=1e-20)


def test_what_walks_come_to_in_a_stretch_by_hand():
    """Angle walk N: N^2 T of attitude; through a force f across: f^2 N^2 T^3/3 and /20 of T^5.

    Velocity walk A: A^2 T, A^2 T^3/3, and A^2 T^2/2 between them.
    """
    T, N, A = 2.0, 1e-3, 1e-2
    P = propagated([0.0, T], at_rest(), drifting(), Priors(gyro_walk=N)).P
    f = at_rest().C @ [2.0, -9.0, 4.0]
    across = f @ f * np.eye(3) - np.outer(f, f)
    np.testing.assert_allclose(P[PSI, PSI], N**2 * T * np.eye(3), rtol=1e-12)
    np.testing.assert_allclose(P[VEL, VEL], N**2 * T**3 / 3 * across, rtol=1e-9)
    np.testing.assert_allclose(P[POS, POS], N**2 * T**5 / 20 * across, rtol=1e-9)
    P = propagated([0.0, T], at_rest(), drifting(), Priors(accel_walk=A)).P
    np.testing.assert_allclose(P[VEL, VEL], A**2 * T * np.eye(3), rtol=1e-12)
    np.testing.assert_allclose(P[POS, POS], A**2 * T**3 / 3 * np.eye(3), rtol=1e-12)
    np.testing.assert_allclose(P[POS, VEL], A**2 * T**2 / 2 * np.eye(3), rtol=1e-12)
    assert not P[PSI, PSI].any()


def test_satellite_drifts_keep_their_size_and_fade():
    """Of a place's drift of 4 m and a velocity's of 0.3 m/s; exp(-2/3) is left after 2 s of 3 s."""
    P = np.zeros((STATES, STATES))
    P[POS_DRIFT, POS_DRIFT], P[VEL_DRIFT, VEL_DRIFT] = 16 * np.eye(3), 0.09 * np.eye(3)
    start = replace(at_rest(P), r_drift=np.array([1.0, 2, 3]), v_drift=np.array([0.1, 0.2, -0.3]))
    after = propagated([0.0, 2.0], start, drifting(4.0, 0.3), Priors())
    np.testing.assert_allclose(after.P[POS_DRIFT, POS_DRIFT], 16 * np.eye(3), rtol=1e-12)
    np.testing.assert_allclose(after.P[VEL_DRIFT, VEL_DRIFT], 0.09 * np.eye(3), rtol=1e-12)
    np.testing.assert_allclose(after.r_drift, 0.5134171 * start.r_drift, rtol=1e-6)
    np.testing.assert_allclose(after.v_drift, 0.5134171 * start.v_drift, rtol=1e-6)


def test_noise_of_fixes_and_of_a_walk_by_hand():
    """Of a walk of 2 m/s/sqrt(s) at 1 and 2 s: velocity ``min``, place ``a^2 (3b - a)/6``, mixed
    ``b a - a^2/2`` with a the earlier; and white noise of each fix."""
    fixes = Fixes(np.array([1.0, 2.0]), *np.zeros((2, 2, 3)), 3.0, 0.5)
    found = _isotropic(np.array([1.0, 2.0]), fixes, 2.0).reshape(2, 2, 2, 2)
    velocity, place, mixed = (
        [[1, 1], [1, 2]],
        [[1 / 3, 5 / 6], [5 / 6, 8 / 3]],
        [[0.5, 1.5], [0.5, 2]],
    )
    np.testing.assert_allclose(found[:, 0, :, 0], 4 * np.array(velocity) + 0.25 * np.eye(2))
    np.testing.assert_allclose(found[:, 1, :, 1], 4 * np.array(place) + 9 * np.eye(2))
    np.testing.assert_allclose(found[:, 0, :, 1], 4 * np.array(mixed))
    np.testing.assert_allclose(found[:, 1, :, 0], 4 * np.array(mixed).T)


@pytest.mark.parametrize(
    ("corrected", "told"),
    [
        ([True, True, True, True], ("d",)),
        ([True, True, False, False], ("b", "d")),
        ([True, False, False, False], ("a", "d")),
        ([False, False, False, False], ("d",)),
    ],
)
def test_a_solution_tells_what_is_doubted_at_its_last_correction_and_now(corrected, told):
    matching = SimpleNamespace(
        t=np.arange(4.0),
        corrected=np.array(corrected),
        doubts=["a", "b", "c", "d"],
        C_nb=Rotation.from_rotvec(0.1 * np.ones((4, 3))),
        covariance=np.tile(1e-6 * np.eye(3), (4, 1, 1)),
        rule=VectorOptions().rule,
    )
    found = answer("observing", "drive", matching, PRIORS)
    assert found.flags == told
    assert (found.C_nb is None) == (not any(corrected))
