"""Rules and steps of the means: closed forms by hand, and samples of every motion at 1 kHz."""

from pathlib import Path

import numpy as np
import pytest

from alignment import Site
from stand.imperfection import PERFECT, draw
from stand.motion import Motion
from stand.physics.description import JOINTS
from stand.physics.geometry import with_errors
from stand.physics.mjcf import describe, load_model
from stand.physics.quadrature import Steps, longest_steps
from stand.physics.truth import Sampling, Truth
from stand.plan import joined, move_piece, rest_piece
from stand.steps import ConingMotion, ScorsbyMotion, SineMotion, SwayMotion
from stand.sway import sway
from stand.table import load_table
from stand.waves import coning, scorsby, sines

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


def mean_of_power(power, ends, long):
    steps = Steps(np.array(ends), np.array(long))
    values = steps.nodes[:, None] ** power * np.array([1.0, -2.0, 3.0])
    return steps.means(values, np.array([0, len(ends) - 1]))[0]


@pytest.mark.parametrize("power", range(6))
def test_rules_are_exact_for_their_powers(power):
    """Mean of t^p over [0, 2] by hand: 2^p/(p + 1); Simpson's rule is exact to the third."""
    ends = [0.0, 0.3, 1.1, 2.0]
    expected = 2.0**power / (power + 1) * np.array([1.0, -2.0, 3.0])
    for long in ([True] * 3, [False, True, False], [False] * 3):
        found = mean_of_power(power, ends, long)
        exact = all(long) or power < 4
        assert (np.abs(found - expected).max() < 1e-14) == exact  # rounding of 16/3 and less


def test_errors_of_the_rules_by_hand():
    """h^4/2880 of 24, the fourth derivative of t^4; h^6/1512000 of 720, the sixth of t^6."""
    h = 1.5
    simpson = mean_of_power(4, [0.0, h], [False])[0] - h**4 / 5
    assert simpson == pytest.approx(h**4 * 24 / 2880, rel=1e-12)
    lobatto = mean_of_power(6, [0.0, h], [True])[0] - h**6 / 7
    assert lobatto == pytest.approx(h**6 * 720 / 1512000, rel=1e-12)


def test_several_means_from_steps_of_both_kinds():
    steps = Steps(np.array([0.0, 1.0, 2.0, 4.0]), np.array([True, False, True]))
    assert list(steps.ends_at(np.arange(4))) == [0, 3, 5, 8]
    values = (steps.nodes**3)[:, None] * np.ones(3)
    # t^3 from 0 to 2: 4/2; from 2 to 4: 60/2
    np.testing.assert_allclose(steps.means(values, np.array([0, 2, 3]))[:, 0], [2, 30], rtol=1e-14)


@pytest.mark.parametrize("rate_deg_s", [0.5, 4.0, 100.0])
def test_step_of_a_uniform_turn_is_near_that_of_its_gravity(rate_deg_s):
    """g w^6 h^6/1512000 = 1e-9: w h = (1e-9 1512000/9.80665)^(1/6) = 0.2318 rad.

    The law also bounds what a point 1 m off feels, as if all axes turned at once: no matter where
    its centripetal force is far below g.
    """
    motion = turning(rate_deg_s, 3.0)
    (step,) = longest_steps(motion, np.array([0]), [])
    turned = step * np.radians(rate_deg_s)
    assert turned <= 0.2318
    assert turned > (0.2 if rate_deg_s < 5 else 0.05)


def test_a_motion_at_rest_takes_any_step():
    rest = Motion(np.array([0.0, 1.0]), np.zeros((4, 1, 6)))
    assert longest_steps(rest, np.array([0]), PERFECT.waves)[0] > 1000


def test_a_piece_sets_its_own_step_alone():
    slow, fast = (turning(rate, 1.0).coefficients for rate in (1.0, 90.0))
    both = Motion(np.array([0.0, 1.0, 2.0]), np.concatenate([slow, fast], axis=1))
    each = [longest_steps(turning(rate, 1.0), np.array([0]), [])[0] for rate in (1.0, 90.0)]
    np.testing.assert_array_equal(longest_steps(both, np.array([0, 1]), []), each)
    np.testing.assert_array_equal(longest_steps(both, np.array([1]), []), each[1:])


# --- the promise, on every kind of motion


def tumbling():
    limits = np.radians([20, 20, 20, 60, 60, 60]), np.full(6, 1.0), np.full(6, 4.0)
    target = np.radians([14, -13, 18, 170, -160, 150.0])
    return joined([move_piece(np.zeros(6), target, *limits), rest_piece(target, 0.7303)])


def rng_of(axis):
    return np.random.default_rng([7, JOINTS.index(axis)])


def rocking(seconds=20.0):
    entry = SwayMotion.model_validate(
        {
            "axes": {
                "base_roll": {"rms_deg": 2.0, "frequency_hz": 0.15, "damping": 0.1},
                "base_yaw": {"rms_deg": 1.0, "frequency_hz": 0.25, "damping": 0.2},
            }
        }
    )
    return sway(entry, seconds, 5.0, rng_of, Path())


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


def nutating():
    entry = ConingMotion.model_validate({"axis": "X1", "half_angle_deg": 3.0, "frequency_hz": 0.5})
    return coning(entry, 6.0, 2.0, np.zeros(6), describe(load_model()))


MOTIONS = {
    "slow turn": lambda: turning(4.0, 20.0),
    "fast turn": lambda: turning(200.0, 4.0),
    "moves": tumbling,
    "sway": rocking,
    "sines": waving,
    "scorsby": rolling,
    "coning": nutating,
}


@pytest.mark.parametrize("errors", ["perfect", "drawn"])
@pytest.mark.parametrize("name", MOTIONS)
def test_slow_samples_are_the_means_of_fast_ones(model, name, errors):
    """Bounds: of force that of the law; of rates ten times it, as the pieces that knots cut off
    below 5 ms take Simpson's rule, which errs by ``h^4/2880 = 2e-13`` of an angle's fifth
    derivative: here some 200 rad/s^5. So does the reference, by 1/625 of that."""
    motion, table = MOTIONS[name](), load_table("mid-class")
    wrong = PERFECT if errors == "perfect" else draw(table, 3, None, True)
    truth = Truth(with_errors(model, wrong), Site(np.radians(48.5)), errors=wrong)
    whole = int(motion.duration)
    fast = truth.block(motion, 1000, Sampling.MEAN, 0, 1000 * whole)
    for hz in (1, 20, 50, 100):
        slow = truth.block(motion, hz, Sampling.MEAN, 0, hz * whole)
        force = fast.f_b.reshape(hz * whole, -1, 3).mean(axis=1)
        rate = fast.w_ib_b.reshape(hz * whole, -1, 3).mean(axis=1)
        assert np.abs(slow.f_b - force).max() < 1e-9
        assert np.abs(slow.w_ib_b - rate).max() < 1e-10


def test_slow_motion_takes_three_evaluations_a_sample(model, monkeypatch):
    truth, rows = Truth(model, Site(0.3)), []
    original = truth.instants
    monkeypatch.setattr(truth, "instants", lambda q, v, a: rows.append(len(q)) or original(q, v, a))
    truth.block(turning(4.0, 20.0), 20, Sampling.MEAN, 0, 400)
    truth.block(turning(4.0, 20.0), 200, Sampling.MEAN, 0, 4000)  # two of Simpson's
    assert rows == [1201, 8001]


@pytest.mark.parametrize("hz", [20, 190])
def test_slow_samples_do_not_depend_on_the_block_length(model, hz):
    truth, motion = Truth(model, Site(0.5)), rocking()
    (whole,) = truth.blocks(motion, hz, Sampling.MEAN, block_s=100.0)
    parts = list(truth.blocks(motion, hz, Sampling.MEAN, block_s=0.31))
    assert len(parts) > 50
    for name in ("t_ns", "w_ib_b", "f_b", "q_wb", "joints"):
        joined_parts = np.concatenate([getattr(p, name) for p in parts])
        np.testing.assert_array_equal(joined_parts, getattr(whole, name), err_msg=name)
