"""Truth against plain rotation matrices, closed forms and hand-written numbers."""

import chain
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from alignment import Site
from stand.motion import Motion
from stand.physics.mjcf import describe, load_model
from stand.physics.truth import Sampling, Truth, sample_count, stamps_ns
from stand.plan import joined, move_piece, plan, rest_piece
from stand.procedure import load_procedure
from stand.table import load_table

LATITUDES = (0.0, 48.5, -33.0, 89.0)
GRAVITY = {0.0: 9.7803253359, 48.5: 9.8093587, -33.0: 9.7956607, 89.0: 9.8321691}  # WGS 84
RATE = np.radians([20, 20, 20, 60, 60, 60.0])
ACCELERATION = np.radians([40, 40, 40, 60, 60, 60.0])
JERK = np.radians([200, 200, 200, 240, 240, 240.0])
ARC_SECOND = np.pi / 180 / 3600


def site(latitude):
    return Site(np.radians(latitude))


@pytest.fixture(scope="module")
def model():
    return load_model()


def tumbling(seed=3, moves=4):
    """Moves of all six axes at once, with rests between: slews up to 60 deg/s."""
    rng = np.random.default_rng(seed)
    joints, pieces = np.zeros(6), [rest_piece(np.zeros(6), 1.0)]
    for _ in range(moves):
        target = np.radians(rng.uniform(-1, 1, 6) * [14, 14, 18, 170, 170, 170])
        pieces.append(move_piece(joints, target, RATE, ACCELERATION, JERK))
        pieces.append(rest_piece(target, 0.7303))  # ends between samples on purpose
        joints = target
    return joined(pieces)


@pytest.mark.parametrize("latitude", LATITUDES)
def test_instants_match_the_closed_form_chain(model, latitude):
    rng = np.random.default_rng(1)
    q = rng.uniform(-3, 3, (2500, 6))
    v = rng.uniform(-1, 1, (2500, 6)) * np.radians([30, 30, 30, 200, 200, 400])
    a = rng.uniform(-1, 1, (2500, 6)) * np.radians([60, 60, 60, 200, 200, 400])
    s = site(latitude)
    found = Truth(model, s).instants(q, v, a)
    w, f = chain.sensors(q, v, a, s.latitude, s.gravity)
    # rounding alone: some 50 operations on values up to 100 m/s^2 and 10 rad/s
    assert np.abs(found.f_b - f).max() < 1e-12
    assert np.abs(found.w_ib_b - w).max() < 1e-13
    C, _ = chain.pose(q)
    assert np.abs(Rotation.from_quat(found.q_wb).as_matrix() - C).max() < 1e-14


def test_closed_form_chain_agrees_with_its_own_differences():
    """The oracle's own check: acceleration against a six-point stencil of the place."""
    h = 2e-3
    t = np.linspace(0.3, 4.0, 300)
    amplitude, pulse = np.radians([5, 3, 10, 40, 60, 170]), np.array([1.3, 2.1, 0.4, 0.7, 0.9, 0.5])

    def motion(t):
        x = pulse * t[:, None] + np.arange(6)
        return (
            amplitude * np.sin(x),
            amplitude * pulse * np.cos(x),
            -amplitude * pulse**2 * np.sin(x),
        )

    places = [chain.pose(motion(t + k * h)[0])[1] for k in (-3, -2, -1, 0, 1, 2, 3)]
    weights = np.array([2, -27, 270, -490, 270, -27, 2]) / (180 * h * h)
    acceleration = np.einsum("k,knj->nj", weights, places)
    C, _ = chain.pose(motion(t)[0])
    f = np.einsum("nji,nj->ni", C, acceleration + np.array([0, 0, 9.81]))
    _, closed = chain.sensors(*motion(t), 0.0, 9.81)
    # the Earth's Coriolis term stands in the closed form alone: taken out here
    earth_free = closed - _coriolis(motion, t)
    assert np.abs(f - earth_free).max() < 2e-9  # stencil: h^6/560 f(8) and 1e-16/h^2 rounding


def _coriolis(motion, t, h=1e-4):
    C, _ = chain.pose(motion(t)[0])
    velocity = (chain.pose(motion(t + h)[0])[1] - chain.pose(motion(t - h)[0])[1]) / (2 * h)
    earth = chain.EARTH_RATE * np.array([0.0, 1.0, 0.0])
    return np.einsum("nji,nj->ni", C, 2 * np.cross(earth, velocity))


@pytest.mark.parametrize("latitude", LATITUDES)
def test_samples_of_moves_match_the_closed_form(model, latitude):
    """Instants at the sample times, and means against a fine Gauss quadrature of the oracle."""
    s, motion, hz = site(latitude), tumbling(), 200
    truth = Truth(model, s)
    n = sample_count(motion.duration, hz)
    instant = truth.block(motion, hz, Sampling.INSTANT, 0, n)
    t = np.arange(1, n + 1) / hz
    w, f = chain.sensors(*motion.joints(t), s.latitude, s.gravity)
    assert np.abs(instant.f_b - f).max() < 1e-9
    assert np.abs(instant.w_ib_b - w).max() < 1e-12
    mean = truth.block(motion, hz, Sampling.MEAN, 0, n)
    w, f = oracle_means(motion, np.arange(n + 1) / hz, s)
    # Simpson at 5 ms: h^4/2880 = 2e-13 s^4 of the fourth derivatives, some 100 m/s^6, rad/s^5
    assert np.abs(mean.f_b - f).max() < 1e-9
    assert np.abs(mean.w_ib_b - w).max() < 1e-10


def oracle_means(motion, edges, s):
    """Means by five-point Gauss on every stretch between sample edges and jerk switches."""
    x, weight = np.polynomial.legendre.leggauss(5)
    ends = np.unique(np.concatenate([edges, motion.knots[motion.knots < edges[-1]]]))
    h = np.diff(ends)
    t = (ends[:-1, None] + h[:, None] * (x + 1) / 2).ravel()
    values = np.hstack(chain.sensors(*motion.joints(t), s.latitude, s.gravity))
    parts = np.einsum("k,nkj->nj", weight / 2, values.reshape(-1, 5, 6)) * h[:, None]
    starts = np.searchsorted(ends, edges[:-1])
    means = np.add.reduceat(parts, starts) / np.add.reduceat(h, starts)[:, None]
    return means[:, :3], means[:, 3:]


def coning_increments(angle):
    """Centred three-sample rotation vectors: d + 7/120 (p x d + d x n) - p x n/60."""
    p, d, n = angle[:-2], angle[1:-1], angle[2:]
    return d + 7 / 120 * (np.cross(p, d) + np.cross(d, n)) - np.cross(p, n) / 60


def integrate_back(block, hz, latitude):
    """Largest angle [arc second] between the integrated mean rates and the recorded attitude."""
    steps = coning_increments(block.w_ib_b / hz)
    earth = chain.EARTH_RATE * np.array([0.0, np.cos(latitude), np.sin(latitude)]) / hz
    C = Rotation.from_quat(block.q_wb[0])
    worst = 0.0
    earth_back = Rotation.from_rotvec(-earth)
    for k, step in enumerate(steps, start=1):
        C = earth_back * C * Rotation.from_rotvec(step)
        worst = max(worst, (C.inv() * Rotation.from_quat(block.q_wb[k])).magnitude())
    return worst / ARC_SECOND


@pytest.mark.parametrize("latitude", LATITUDES)
def test_mean_rates_integrate_back_to_the_recorded_attitude(model, latitude):
    motion, hz = tumbling(seed=8, moves=3), 200
    n = sample_count(motion.duration, hz)
    s = site(latitude)
    block = Truth(model, s).block(motion, hz, Sampling.MEAN, 0, n)
    # 0.001 arc second is the published bound; a lost Earth rate would give 15'' a second
    assert integrate_back(block, hz, s.latitude) < 1e-3


def test_six_position_run_integrates_back(model):
    procedure = load_procedure("six-position")
    planned = plan(procedure, describe(model), load_table("laboratory"))
    s, hz = site(48.5), 200
    block = Truth(model, s).block(planned.motion, hz, Sampling.MEAN, 0, 200 * 384)
    start = slice(0, 200 * 5)  # a short part step by step; the whole by the product of all steps
    part = type(block)(*(getattr(block, k)[start] for k in block.__slots__))
    assert integrate_back(part, hz, s.latitude) < 1e-3
    steps = coning_increments(block.w_ib_b / hz)
    total = Rotation.from_rotvec(steps).as_matrix()
    while len(total) > 1:  # pairwise product of all 76 798 steps
        odd = total[-1:] if len(total) % 2 else total[:0]
        total = np.concatenate([total[: len(total) // 2 * 2 : 2] @ total[1::2], odd])
    turned = len(steps) / hz * chain.EARTH_RATE
    earth = Rotation.from_rotvec(-turned * np.array([0, np.cos(s.latitude), np.sin(s.latitude)]))
    end = earth * Rotation.from_quat(block.q_wb[0]) * Rotation.from_matrix(total[0])
    error = (end.inv() * Rotation.from_quat(block.q_wb[-2])).magnitude() / ARC_SECOND
    assert error < 1e-3


# X1 up, X1 down, Y1 up, Y1 down, Z1 up, Z1 down: what each axis feels, by hand
SIX = {
    "X1 up": (1, 0, 0),
    "X1 down": (-1, 0, 0),
    "Y1 up": (0, 1, 0),
    "Y1 down": (0, -1, 0),
    "Z1 up": (0, 0, 1),
    "Z1 down": (0, 0, -1),
}


@pytest.mark.parametrize("latitude", LATITUDES)
def test_rest_in_every_position_gives_gravity_and_earth_rate(model, latitude):
    planned = plan(load_procedure("six-position"), describe(model), load_table("laboratory"))
    truth, hz = Truth(model, site(latitude)), 200
    for step in planned.dwells:
        k = int(step.t_from) * hz
        block = truth.block(planned.motion, hz, Sampling.MEAN, k, k + 3)
        up = np.array(SIX[step.label])
        # published WGS 84 values have 7 decimals; the readings agree with the site's to 1e-9
        assert np.abs(block.f_b - up * site(latitude).gravity).max() < 1e-9
        assert np.abs(block.f_b - up * GRAVITY[latitude]).max() < 1e-7
        vertical = block.w_ib_b @ up
        # rounding of 1e-16 of the slew-free rate
        assert np.abs(vertical - 7.292115e-5 * np.sin(np.radians(latitude))).max() < 1e-19


def test_hand_numbers_at_zero_angles(model):
    """48.5 deg: X1 north 9.96651 deg/h, Y1 up 11.26509 deg/h, Z1 east none; f along Y1."""
    found = Truth(model, site(48.5)).instants(*np.zeros((3, 2, 6)))
    assert np.degrees(found.w_ib_b[0]) * 3600 == pytest.approx([9.96651, 11.26509, 0], abs=5e-6)
    assert found.f_b[1] == pytest.approx([0, 9.8093587, 0], abs=5e-8)


def test_coriolis_of_a_spinning_table_by_hand(model):
    """Outer axis at 2 rad/s at the pole: f = -w^2 r inward plus 2 W v, v = w r sideways."""
    rates = np.zeros((1, 6))
    rates[0, 3] = 2.0
    found = Truth(model, site(90.0)).instants(np.zeros((1, 6)), rates, np.zeros((1, 6)))
    east, north = 0.04, 0.06
    # centripetal -w^2 (east, north); Coriolis 2 W up x w up x r = -2 W w (east, north)
    factor = -(2.0**2) - 2 * 7.292115e-5 * 2.0
    assert found.f_b[0, [2, 0]] == pytest.approx([factor * east, factor * north], abs=1e-13)
    assert found.w_ib_b[0] == pytest.approx([0, 2.0 + 7.292115e-5, 0], abs=1e-14)


def test_result_does_not_depend_on_the_block_length(model):
    motion, truth = tumbling(), Truth(model, site(-33.0))
    whole = list(truth.blocks(motion, 160, Sampling.MEAN, block_s=100.0))
    parts = list(truth.blocks(motion, 160, Sampling.MEAN, block_s=0.07))
    assert len(whole) == 1
    assert len(parts) > 50
    for name in ("t_ns", "w_ib_b", "f_b", "q_wb", "joints"):
        joined_parts = np.concatenate([getattr(p, name) for p in parts])
        # bit for bit: nodes come from integer sample numbers
        assert np.array_equal(joined_parts, getattr(whole[0], name)), name


def test_slow_sampling_is_as_exact_as_fast(model):
    """At 4 Hz every interval is parted into 50 stretches: means equal those of 200 Hz samples."""
    motion, truth = tumbling(), Truth(model, site(48.5))
    n = sample_count(motion.duration, 4)
    slow = truth.block(motion, 4, Sampling.MEAN, 0, n)
    fast = truth.block(motion, 200, Sampling.MEAN, 0, 50 * n)
    assert np.abs(slow.f_b - fast.f_b.reshape(n, 50, 3).mean(axis=1)).max() < 1e-10


def test_dwells_cost_one_evaluation(model, monkeypatch):
    motion = Motion(np.array([0.0, 100.0]), np.zeros((4, 1, 6)))
    truth = Truth(model, site(10.0))
    rows = []
    original = truth.instants
    monkeypatch.setattr(truth, "instants", lambda q, v, a: rows.append(len(q)) or original(q, v, a))
    assert sum(len(b) for b in truth.blocks(motion, 1000, Sampling.MEAN)) == 100_000
    assert sum(rows) == 100  # one per block of a second


def test_stamps_are_whole_nanoseconds_without_drift():
    assert list(stamps_ns(np.array([1, 2, 3, 64]), 64)) == [15625000, 31250000, 46875000, 10**9]
    assert list(stamps_ns(np.array([1, 2, 3]), 3)) == [333333333, 666666667, 10**9]


def test_a_value_that_is_not_finite_is_named(model):
    q = np.zeros((4, 6))
    q[2, 4] = np.nan
    with pytest.raises(ValueError, match="q of joint middle: not finite at row 2"):
        Truth(model, site(0.0)).instants(q, np.zeros((4, 6)), np.zeros((4, 6)))
