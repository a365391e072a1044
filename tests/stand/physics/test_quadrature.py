"""The law of the panels: closed forms by hand, and samples of every motion at every rate."""

from dataclasses import replace
from pathlib import Path

import chain
import numpy as np
import pytest
from scipy.special import roots_legendre

from alignment import Site
from stand.motion.moves import joined, move_piece, rest_piece
from stand.motion.polynomial import Motion
from stand.motion.sway import sway, vibration
from stand.motion.waves import coning, scorsby, sines
from stand.physics import quadrature
from stand.physics import truth as truths
from stand.physics.geometry import with_errors
from stand.physics.hinges import Hinges
from stand.physics.mjcf import describe, load_model
from stand.physics.quadrature import (
    Law,
    derivatives,
    first_alike,
    interpolation_constant,
    longest_panels,
    longest_whole,
    quadrature_constant,
)
from stand.physics.truth import Sampling, Truth
from stand.procedure.steps import (
    ConingMotion,
    ScorsbyMotion,
    SineMotion,
    SwayMotion,
    VibrationMotion,
)
from stand.table.joints import JOINTS
from stand.table.table import load_table
from stand.table.table_errors import PERFECT, draw

OUTER = JOINTS.index("outer")


@pytest.fixture(scope="module")
def model():
    return load_model()


def turning(rate_deg_s, duration):
    """Outer axis at a constant rate, middle and inner one tilted."""
    coefficients = np.zeros((2, 1, 6))
    coefficients[1, 0, OUTER + 1 :] = 0.3, -0.4
    coefficients[0, 0, OUTER] = np.radians(rate_deg_s)
    return Motion(np.array([0.0, duration]), coefficients)


def bounds_of(motion, piece=0, waves=()):
    return derivatives(motion, np.array([piece]), waves)


def test_constants_by_hand():
    """Largest of x (1 - x^2): 2/(3 sqrt3), at 1/sqrt3; of (1 - x^2)(1/5 - x^2): 1/5, at 0.

    Simpson's mean errs by h^4/2880 of the fourth derivative, that of four nodes by h^6/1512000.
    """
    assert interpolation_constant(3) == pytest.approx(2 / (3 * np.sqrt(3)), rel=1e-6)
    assert interpolation_constant(4) == pytest.approx(0.2, rel=1e-12)
    assert 1 / quadrature_constant(3) == pytest.approx(2880, rel=1e-12)
    assert 1 / quadrature_constant(4) == pytest.approx(1512000, rel=1e-12)


@pytest.mark.parametrize("rate_deg_s", [0.5, 4.0, 100.0])
@pytest.mark.parametrize(
    ("longest", "nodes", "turned"),
    [
        (longest_whole, 3, 0.02328),  # rad: g w^4 h^4/2880 = 1e-9: w h = (2.88e-6/9.80665)^(1/4)
        (longest_whole, 4, 0.23176),  # g w^6 h^6/1512000 = 1e-9: w h = (1.512e-3/9.80665)^(1/6)
        # g (w h/2)^3 0.3849/6 = 1e-12: w h = 2 (6e-12/(9.80665 0.3849))^(1/3)
        (longest_panels, 3, 2.3342e-4),
        (longest_panels, 4, 3.7406e-3),  # g (w h/2)^4 0.2/24 = 1e-12
    ],
)
def test_panel_of_a_uniform_turn_is_that_of_its_gravity(rate_deg_s, longest, nodes, turned):
    """One axis that turns evenly: its rate and centripetal force stand still in b."""
    (step,) = longest(nodes, bounds_of(turning(rate_deg_s, 3.0)))
    assert step * np.radians(rate_deg_s) == pytest.approx(turned, rel=1e-3)


def test_panel_of_a_rate_by_hand():
    """q = 1e4 t^5 for 1 ms: 1.2e6 h^4/2880 = 1e-11, h = (2.4e-14)^(1/4) = 0.3936 ms. Of its
    force g times the angle's fourth derivative is most, 1.2e4 m/s^6: that would allow 4 ms.
    The mean of four nodes is exact."""
    coefficients = np.zeros((6, 1, 6))
    coefficients[0, 0, OUTER] = 1e4
    motion = Motion(np.array([0.0, 1e-3]), coefficients)
    assert longest_whole(3, bounds_of(motion))[0] == pytest.approx(0.3936e-3, rel=1e-3)
    assert longest_whole(4, bounds_of(motion))[0] > 1e-3
    nodes, panels = Law(motion, []).choose(0, np.array([True]))
    assert (list(nodes), list(panels)) == ([4], [1])


def test_the_arm_of_two_axes_by_hand():
    """2 and 3 rad/s: all together turn by exp(5 t), a link's spin is 5 exp(3 t) as b sees it.

    Sixth derivatives: of gravity g 5^6 = 153 229 m/s^8; of what spins an arm of 1 m 5 3^7 = 10 935,
    of its centripetal force 25 6^6 = 1 166 400: h = (1.512e-3/1 330 564)^(1/6) = 32.30 ms. Without
    the arm the rate's 3 646 rad/s^7 would set it: (1.512e-5/3 646)^(1/6) = 40.1 ms.
    """
    coefficients = np.zeros((2, 1, 6))
    coefficients[0, 0, [OUTER, JOINTS.index("inner")]] = 2.0, 3.0
    bounds = bounds_of(Motion(np.array([0.0, 3.0]), coefficients))
    assert longest_whole(4, bounds)[0] == pytest.approx(32.30e-3, rel=1e-3)
    # fourth derivatives: g 5^4 + 5 3^5 + 25 6^4 = 39 744; of the rate 5 3^4 = 405: it is shorter
    simpson = longest_whole(3, bounds)[0]
    assert simpson == pytest.approx((2880e-11 / (405 + 7.292e-5 * 625)) ** 0.25, rel=1e-4)
    assert simpson < (2880e-9 / 39744) ** 0.25


def test_an_axis_that_slows_down_is_no_faster_than_at_its_start():
    """From 90 deg/s to rest in 100 s: of g turned by q, ``g (w^4 + 6 w^2 b + 3 b^2)`` at its start
    bounds the fourth derivative, b its braking. Centripetal force is a square of time."""
    w = np.radians(90.0)
    b = w / 100
    coefficients = np.zeros((3, 1, 6))
    coefficients[:2, 0, OUTER] = -b / 2, w
    motion = Motion(np.array([0.0, 100.0]), coefficients)
    bound = 9.80665 * (w**4 + 6 * w**2 * b + 3 * b**2)
    found = longest_whole(3, bounds_of(motion))[0]
    assert found == pytest.approx((2880e-9 / bound) ** 0.25, rel=1e-9)


def test_a_motion_at_rest_takes_any_panel():
    rest = Motion(np.array([0.0, 1.0]), np.zeros((4, 1, 6)))
    for longest in (longest_whole, longest_panels):
        assert longest(4, bounds_of(rest, waves=PERFECT.waves))[0] > 1000
    for whole in (True, False):
        nodes, panels = Law(rest, PERFECT.waves).choose(0, np.array([whole]))
        assert (list(nodes), list(panels)) == ([3], [1])


def test_a_piece_sets_its_own_panels_alone():
    slow, fast = (turning(rate, 1.0).coefficients for rate in (1.0, 90.0))
    both = Motion(np.array([0.0, 1.0, 2.0]), np.concatenate([slow, fast], axis=1))
    for longest in (longest_whole, longest_panels):
        each = [longest(5, bounds_of(turning(x, 1.0)))[0] for x in (1.0, 90.0)]
        found = longest(5, derivatives(both, np.array([0, 1]), []))
        np.testing.assert_array_equal(found, each)
        np.testing.assert_array_equal(longest(5, bounds_of(both, 1)), each[1:])


def test_the_cheapest_panels_by_hand():
    """At 1 rad/s three nodes have the mean over 23.28 ms, four over 231.8 ms.

    Where samples end within, four do for 3.74 ms: 5 ms are two panels of them, six evaluations, or
    one of five nodes, four: ``g (h/2)^5 0.0941/120 = 1e-12`` allows h = 21 ms.
    """
    lengths = np.array([0.001, 0.0232, 0.0234, 0.231, 0.233])
    knots = np.append(0.0, np.cumsum(lengths))
    coefficients = np.zeros((2, 5, 6))
    coefficients[0, :, OUTER] = 1.0
    law = Law(Motion(knots, coefficients), [])
    nodes, panels = law.choose(0, np.ones(5, bool))
    assert list(nodes) == [3, 3, 4, 4, 5]
    assert list(panels) == [1] * 5
    law = Law(turning(np.degrees(1.0), 0.005), [])
    assert [int(x[0]) for x in law.choose(0, np.array([False]))] == [5, 1]


@pytest.mark.parametrize("count", [1, 2, 3, 16, 17, 33])
def test_the_last_piece_of_those_that_are_bounded_together_is_bounded(count):
    """Turns of 1 ms, and at the end one of 23.4 ms, whose mean three nodes do not have: 23.28."""
    knots = np.append(np.arange(count) * 0.001, (count - 1) * 0.001 + 0.0234)
    coefficients = np.zeros((2, count, 6))
    coefficients[0, :, OUTER] = 1.0
    nodes, panels = Law(Motion(knots, coefficients), []).choose(0, np.ones(count, bool))
    assert list(nodes) == [3] * (count - 1) + [4]
    assert list(panels) == [1] * count


def test_a_choice_does_not_depend_on_what_else_is_asked():
    """Five hundred pieces of all sizes, with the waves of a drawn table: bounded together or
    alone."""
    rng = np.random.default_rng(5)
    lengths = rng.uniform(1e-3, 5e-3, 500)
    quiet = np.repeat(rng.uniform(0, 1, 25), 20)[:, None] ** 10  # stretches of them
    c = rng.normal(size=(6, 500, 6)) * quiet * np.array([1e4, 1e3, 1e2, 3, 1, 1])[:, None, None]
    motion = Motion(np.append(0.0, np.cumsum(lengths)), c)
    waves = draw(load_table("mid-class"), 3, None, True).waves
    whole = rng.uniform(size=500) < 0.8
    nodes, panels = Law(motion, waves).choose(0, whole)
    assert len(np.unique(nodes[~whole])) > 3
    assert np.count_nonzero(nodes[whole] == 3) > 30
    law = Law(motion, waves)
    for first, last in ((0, 1), (3, 170), (171, 175), (160, 500)):
        again = law.choose(first, whole[first:last])
        np.testing.assert_array_equal(again[0], nodes[first:last])
        np.testing.assert_array_equal(again[1], panels[first:last])


# --- the promise, on every kind of motion


def tumbling():
    limits = np.radians([20, 20, 20, 60, 60, 60]), np.full(6, 1.0), np.full(6, 4.0)
    target = np.radians([14, -13, 18, 170, -160, 150.0])
    return joined([move_piece(np.zeros(6), target, *limits), rest_piece(target, 0.7303)])


def rng_of(axis):
    return np.random.default_rng([7, JOINTS.index(axis)])


def rocking(seconds=20.0, lead=5.0):
    entry = SwayMotion.model_validate(
        {
            "axes": {
                "base_roll": {"rms_deg": 2.0, "frequency_hz": 0.15, "damping": 0.1},
                "base_yaw": {"rms_deg": 1.0, "frequency_hz": 0.25, "damping": 0.2},
            }
        }
    )
    return sway(entry, seconds, lead, rng_of, Path())


def waving():
    axes = {
        "outer": {"amplitude_deg": 20.0, "frequency_hz": 0.3},
        "inner": {"amplitude_deg": 1.0, "frequency_hz": 1.0, "phase_deg": 40.0},
    }
    return sines(SineMotion.model_validate({"axes": axes}), 10.0, 4.0)


def rolling():
    amplitude = {"base_roll": 5.0, "base_pitch": 5.0, "base_yaw": 5.0}
    entry = ScorsbyMotion.model_validate({"amplitude_deg": amplitude, "period_s": 6.0})
    return scorsby(entry, 12.0, 4.0)


def nutating(seconds=6.0):
    entry = ConingMotion.model_validate({"axis": "X1", "half_angle_deg": 3.0, "frequency_hz": 0.5})
    return coning(entry, seconds, 2.0, np.zeros(6), describe(load_model()))


def shaking(axes=("outer",)):
    """200 deg/s^2 between 5 and 30 Hz."""
    jitter = {"rms_deg_s2": 200.0, "low_hz": 5.0, "high_hz": 30.0}
    entry = VibrationMotion.model_validate({"axes": dict.fromkeys(axes, jitter)})
    return vibration(entry, 2.0, 1.0, rng_of)


MOTIONS = {
    "slow turn": lambda: turning(4.0, 20.0),
    "fast turn": lambda: turning(200.0, 4.0),
    "moves": tumbling,
    "sway": rocking,
    "sines": waving,
    "scorsby": rolling,
    "coning": nutating,
    "vibration": lambda: shaking(("base_roll", "outer", "inner")),
}


@pytest.mark.parametrize("errors", ["perfect", "drawn"])
@pytest.mark.parametrize("name", MOTIONS)
def test_slow_samples_are_the_means_of_fast_ones(model, name, errors):
    """Both err by no more than the law's bounds."""
    motion, table = MOTIONS[name](), load_table("mid-class")
    wrong = PERFECT if errors == "perfect" else draw(table, 3, None, True)
    truth = Truth(with_errors(model, wrong), Site(np.radians(48.5)), errors=wrong)
    whole = int(motion.duration)
    fast = truth.block(motion, 1000, Sampling.MEAN, 0, 1000 * whole)
    for hz in (1, 20, 50, 100):
        slow = truth.block(motion, hz, Sampling.MEAN, 0, hz * whole)
        force = fast.f_b.reshape(hz * whole, -1, 3).mean(axis=1)
        rate = fast.w_ib_b.reshape(hz * whole, -1, 3).mean(axis=1)
        assert np.abs(slow.f_b - force).max() < 2e-9
        assert np.abs(slow.w_ib_b - rate).max() < 2e-11


RATES = (20, 100, 200, 1000)
VERTICAL_RATE = 7.292115e-5 * np.sin(np.radians(48.5))


@pytest.mark.parametrize("hz", RATES)
def test_mean_rate_of_a_sine_by_hand(model, hz):
    """1 deg, 3 Hz about the vertical for 4 s after 1 s of fade: the difference of the angle over
    the time, and the Earth's rate up. Y1 is up."""
    sine = {"outer": {"amplitude_deg": 1.0, "frequency_hz": 3.0}}
    motion = sines(SineMotion.model_validate({"axes": sine}), 4.0, 1.0)
    block = Truth(model, Site(np.radians(48.5))).block(motion, hz, Sampling.MEAN, hz, 5 * hz)
    angle = np.radians(1.0) * np.sin(6 * np.pi * (np.arange(hz, 5 * hz + 1) / hz - 1.0))
    # beside the bound, 1e-12 for the rounding of angles (1e-17) times hz and of the polynomials
    assert np.abs(block.w_ib_b[:, 1] - np.diff(angle) * hz - VERTICAL_RATE).max() < 1.1e-11


@pytest.mark.parametrize("hz", RATES)
def test_mean_rate_of_vibration_by_hand(model, hz):
    """Likewise; one step of Simpson's on each 4 ms of the spline would err by 2e-6 rad/s."""
    motion = shaking()
    block = Truth(model, Site(np.radians(48.5))).block(motion, hz, Sampling.MEAN, 0, 4 * hz)
    angle = motion.joints(np.arange(4 * hz + 1) / hz)[0][:, OUTER]
    assert np.abs(block.w_ib_b[:, 1] - np.diff(angle) * hz - VERTICAL_RATE).max() < 1.1e-11


@pytest.mark.parametrize("hz", RATES)
@pytest.mark.parametrize("name", ["vibration", "sines", "moves"])
def test_means_match_a_fine_gauss_rule_of_the_closed_form(model, name, hz):
    """Eight points between edges and knots, exact to the fifteenth power, of `chain.sensors`.

    Pieces in which a sample ends are right to rounding: where sines of 2 rad/s^2 were fitted, their
    accelerations round, and differ across a knot, by 1e-11. Vibration's pieces of 4 ms lie within
    samples whole, at 1e-9 m/s^2 and 1e-11 rad/s by the law.
    """
    motion, site = MOTIONS[name](), Site(np.radians(48.5))
    block = Truth(model, site).block(motion, hz, Sampling.MEAN, hz, 3 * hz)
    edges = np.arange(hz, 3 * hz + 1) / hz
    inside = motion.knots[(motion.knots > edges[0]) & (motion.knots < edges[-1])]
    ends = np.unique(np.concatenate([edges, inside]))
    points, weights = roots_legendre(8)
    h = np.diff(ends)
    t = ends[:-1, None] + h[:, None] * (points + 1) / 2
    q, v, a = motion.joints(t.ravel())
    felt = np.hstack(chain.sensors(q, v, a, site.latitude, site.gravity)).reshape(-1, 8, 6)
    parts = np.einsum("k,nkj->nj", weights / 2, felt) * h[:, None]
    means = np.add.reduceat(parts, np.searchsorted(ends, edges[:-1]), axis=0) * hz
    assert np.abs(block.w_ib_b - means[:, :3]).max() < 1e-12
    assert np.abs(block.f_b - means[:, 3:]).max() < 1e-11


def test_evaluations_of_slow_and_fast_turns(model, rows):
    """At the cost of the motion: 1.4 rad in one panel or two, whatever the rate of the samples."""
    truth = Truth(model, Site(0.3))
    truth.block(turning(4.0, 20.0), 1, Sampling.MEAN, 0, 20)
    truth.block(turning(4.0, 20.0), 200, Sampling.MEAN, 0, 4000)
    truth.block(turning(4.0, 20.0), 10_000, Sampling.INSTANT, 0, 200_000)
    truth.block(turning(60.0, 20.0), 20, Sampling.MEAN, 0, 400)  # 21 rad
    assert rows == [12, 12, 12, 155]


def test_evaluations_of_sway(model, rows):
    """Four pieces a period of its fastest wave, 1.25 Hz: 11 instants of each at most."""
    truth, motion = Truth(model, Site(0.3)), rocking(lead=10.0)
    for hz in (50, 200):
        truth.block(motion, hz, Sampling.MEAN, 0, round(hz * motion.duration))
    periods = 1.25 * motion.duration
    assert max(rows) <= 4 * 11 * periods + 1


def test_turns_that_repeat_are_looked_at_once(model, rows):
    """Ten turns of a cone cost what three do."""
    for seconds in (6.0, 20.0):
        truth, motion = Truth(model, Site(0.3)), nutating(seconds)
        truth.block(motion, 20, Sampling.MEAN, 0, round(20 * motion.duration))
    assert rows[0] == rows[1]


@pytest.mark.parametrize("hz", [7, 20, 190])
def test_repeated_turns_are_as_right_as_the_first(model, monkeypatch, hz):
    """The same bits in any block; beside each turn looked at for itself, times round by 1e-15 s:
    of 0.2 rad/s at pi rad/s by 1e-15 rad/s, of 10 m/s^2 by 1e-14 m/s^2, and sums of them more."""
    motion, truth = nutating(20.0), Truth(model, Site(0.5))
    (whole,) = truth.blocks(motion, hz, Sampling.MEAN, block_s=100.0)
    parts = list(truth.blocks(motion, hz, Sampling.MEAN, block_s=0.71))
    assert len(parts) > 30
    for name in ("w_ib_b", "f_b", "q_wb", "joints"):
        joined_parts = np.concatenate([getattr(p, name) for p in parts])
        np.testing.assert_array_equal(joined_parts, getattr(whole, name), err_msg=name)
    monkeypatch.setattr(quadrature, "first_alike", lambda motion: np.arange(len(motion.knots) - 1))
    (each,) = Truth(model, Site(0.5)).blocks(motion, hz, Sampling.MEAN, block_s=100.0)
    assert np.abs(each.w_ib_b - whole.w_ib_b).max() < 1e-13
    assert np.abs(each.f_b - whole.f_b).max() < 1e-12
    assert np.abs(each.q_wb - whole.q_wb).max() < 1e-14


def test_what_is_alike():
    """Pieces 1 and 3 are of the same numbers and so are the next; 0 has another next than 2."""
    one, two, three = (np.full(6, x) for x in (1.0, 2.0, 3.0))
    c = np.array([[two, one, two, one, two, three], np.zeros((6, 6))])
    assert first_alike(Motion(np.arange(7.0), c)).tolist() == [0, 1, 0, 1, 4, 5]
    knots = np.array([0, 1, 2, 3, 4.001, 5, 6])  # 3 is longer, and 2's next
    assert first_alike(Motion(knots, c)).tolist() == [0, 1, 2, 3, 4, 5]


@pytest.mark.parametrize("hz", [20, 190])
def test_slow_samples_do_not_depend_on_the_block_length(model, hz):
    truth, motion = Truth(model, Site(0.5)), rocking()
    (whole,) = truth.blocks(motion, hz, Sampling.MEAN, block_s=100.0)
    parts = list(truth.blocks(motion, hz, Sampling.MEAN, block_s=0.31))
    assert len(parts) > 50
    for name in ("t_ns", "w_ib_b", "f_b", "q_wb", "joints"):
        joined_parts = np.concatenate([getattr(p, name) for p in parts])
        np.testing.assert_array_equal(joined_parts, getattr(whole, name), err_msg=name)


@pytest.mark.parametrize("table", ["perfect", "mid-class", "rocking-platform"])
def test_axes_that_stand_still_need_no_hinges(model, monkeypatch, table):
    """The base sways below three gimbals that stand askew, or they cone on a base that does: the
    same by all 18 hinges, which a window of a motion takes: each rounds by 2e-16, of 10 m/s^2 and
    of the shaken rates of 3 rad/s."""
    monkeypatch.setattr(truths, "MANY", 0)
    axes, sensed = [], Hinges.sensed
    monkeypatch.setattr(Hinges, "sensed", lambda h, *x: axes.append(len(h.axes)) or sensed(h, *x))
    wrong = PERFECT if table == "perfect" else draw(load_table(table), 3, None, True)
    askew = np.array([0.1, -0.2, 0.15, 1.0, -0.7, 2.5])
    places = np.array([[0.03, 0.01, 0.0], [0.0, 0.05, -0.02], [0.01, 0.0, 0.04]])
    truth = Truth(with_errors(model, wrong), Site(0.7), places, wrong)
    for motion in (rocking(), nutating(), shaking(("base_pitch", "middle"))):
        c = motion.coefficients.copy()
        c[-1] += askew
        motion = Motion(motion.knots, c)
        edges = np.arange(200, 1000) / 190.0
        for sampling in Sampling:
            one = truth.over(motion, edges, sampling)
            assert axes[-1] < len(JOINTS)
            other = truth.over(replace(motion, whole=False), edges, sampling)
            assert axes[-1] == len(JOINTS)
            for name, most in (("w_ib_b", 1e-14), ("f_b", 1e-13), ("f_places", 1e-13)):
                assert np.abs(getattr(one, name) - getattr(other, name)).max() < most
            assert np.abs(one.q_wb - other.q_wb).max() < 4e-15
            for name in ("joints", "joint_rates", "encoders", "encoder_rates"):
                np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
