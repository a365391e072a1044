"""Random motions at random rates in random blocks: the same bits; and means by Gauss's rule."""

from itertools import pairwise

import chain
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.special import roots_legendre

from alignment import Site
from stand.motion.moves import joined, move_piece, rest_piece
from stand.motion.polynomial import b_spline, fitted, summed
from stand.motion.waves import envelope
from stand.physics.mjcf import load_model
from stand.physics.truth import Sampling, Truth

FELT = ("t_ns", "w_ib_b", "f_b", "q_wb", "joints", "joint_rates", "encoders", "encoder_rates")
PLACES = np.array([[0.03, 0.0, -0.02], [0.0, 0.05, 0.01], [-0.01, 0.02, 0.04]])
SITE = Site(0.7)


@pytest.fixture(scope="module")
def model():
    return load_model()


def moves(rng):
    """Jerk-limited, up to 200 deg/s on the gimbals, with rests that end anywhere."""
    joints, pieces = np.zeros(6), [rest_piece(np.zeros(6), rng.uniform(0.1, 1.0))]
    limits = np.radians([20, 20, 20, 200, 200, 200]), np.full(6, 4.0), np.full(6, 20.0)
    for _ in range(3):
        target = np.radians(rng.uniform(-1, 1, 6) * [14, 14, 18, 170, 170, 170])
        pieces += [move_piece(joints, target, *limits), rest_piece(target, rng.uniform(0, 0.7))]
        joints = target
    return joined(pieces)


def swaying(rng):
    """A spline of steps of 5 to 80 ms, of a servo's degree or of a sway's."""
    step, axes = rng.uniform(0.005, 0.08), rng.uniform(size=6) < 0.6
    degree = int(rng.choice([5, 7]))
    weights = rng.normal(size=(int(4 / step) + degree, 6)) * np.radians(200 * step**2) * axes
    weights[: degree + 1] = weights[-degree - 1 :] = 0.0
    return b_spline(weights, step, degree=degree)


def waving(rng):
    size, pulse = np.radians(rng.uniform(0, 20, 6)), 2 * np.pi * rng.uniform(0.1, 2.0, 6)

    def angles(t):
        return envelope(t, 2.0, 1.0)[:, None] * size * np.sin(pulse * t[:, None])

    return fitted(angles, np.arange(0.0, 4.01, 0.05))


MAKERS = {
    "moves": moves,
    "sway": swaying,
    "waves": waving,
    "moves on a swaying base": lambda rng: summed([moves(rng), swaying(rng)]),
}


def reference(motion, edges):
    """Gauss's means of 30 points between edges and knots of the closed form."""
    inside = (motion.knots > edges[0]) & (motion.knots < edges[-1])
    ends = np.unique(np.concatenate([edges, motion.knots[inside]]))
    points, weights = roots_legendre(30)
    h = np.diff(ends)
    t = ends[:-1, None] + h[:, None] * (points + 1) / 2
    sensors = chain.sensors(*motion.joints(t.ravel()), SITE.latitude, SITE.gravity)
    felt = np.hstack(sensors).reshape(-1, 30, 6)
    parts = np.einsum("k,nkj->nj", weights / 2, felt) * h[:, None]
    starts = np.searchsorted(ends, edges[:-1])
    means = np.add.reduceat(parts, starts, axis=0) / np.add.reduceat(h, starts)[:, None]
    return means[:, :3], means[:, 3:]


@pytest.mark.parametrize("name", MAKERS)
@pytest.mark.parametrize("number", range(5))
def test_a_random_motion_at_a_random_rate(model, name, number):
    rng = np.random.default_rng([number, *name.encode()])
    motion, rate = MAKERS[name](rng), int(np.exp(rng.uniform(0, np.log(10_000))))
    truth = Truth(model, SITE, PLACES)
    first = int(rng.uniform(0, 0.7) * motion.duration * rate)
    last = min(first + 300, int(motion.duration * rate))
    cuts = np.unique(rng.integers(first, last + 1, 6))
    cuts = [first, *(int(c) for c in cuts if first < c < last), last]
    for sampling in Sampling:
        whole, felt = truth.block_and_sensed(motion, rate, sampling, first, last)
        for a, b in pairwise(cuts):
            part, own = truth.block_and_sensed(motion, rate, sampling, a, b)
            rows = slice(a - first, b - first)
            for field in FELT:
                there = getattr(whole, field)[rows]
                np.testing.assert_array_equal(getattr(part, field), there, err_msg=field)
            np.testing.assert_array_equal(own.f_b, felt.f_b[rows])
            np.testing.assert_array_equal(own.f_other, felt.f_other[rows])
        edges = np.arange(first, last + 1) / rate
        if sampling is Sampling.MEAN:
            w, f = reference(motion, edges)
            bounds = 1e-11, 1e-9  # the law's
        else:
            at = motion.joints(edges[1:])
            w, f = chain.sensors(*at, SITE.latitude, SITE.gravity)
            # the law's 1e-14 and 1e-12, and rounding; fitted waves of 50 rad/s^2 jump at knots,
            # by 1e-10 of it on an arm of 0.1 m
            bounds = (1e-11, 1e-9) if name == "waves" else (1e-13, 3e-12)
        assert np.abs(whole.w_ib_b - w).max() < bounds[0]
        assert np.abs(whole.f_b - f).max() < bounds[1]
        C, _ = chain.pose(whole.joints)
        turned = np.abs(Rotation.from_quat(whole.q_wb).as_matrix() - C).max()
        assert turned < 1e-13
