"""Truth against plain rotation matrices, closed forms and hand-written numbers."""

import chain
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from alignment import Site
from stand.motion.moves import joined, move_piece, rest_piece
from stand.motion.planner import plan
from stand.motion.polynomial import Motion, splined
from stand.physics.geometry import with_errors
from stand.physics.mjcf import describe, load_model
from stand.physics.truth import Sampling, Truth, sample_count, stamps_ns
from stand.procedure.procedure import load_procedure
from stand.table.joints import JOINTS
from stand.table.table import load_table
from stand.table.table_errors import PERFECT, TableErrors, draw

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
    w, f = oracle_means(motion, np.arange(n + 1) / hz, perfect_sensors(s))
    # what the quadrature promises
    assert np.abs(mean.f_b - f).max() < 1e-9
    assert np.abs(mean.w_ib_b - w).max() < 1e-11


def perfect_sensors(s):
    return lambda q, v, a: chain.sensors(q, v, a, s.latitude, s.gravity)


def oracle_means(motion, edges, sensors):
    """Means by five-point Gauss on every stretch between sample edges and jerk switches."""
    x, weight = np.polynomial.legendre.leggauss(5)
    inside = (motion.knots > edges[0]) & (motion.knots < edges[-1])
    ends = np.unique(np.concatenate([edges, motion.knots[inside]]))
    h = np.diff(ends)
    t = (ends[:-1, None] + h[:, None] * (x + 1) / 2).ravel()
    values = np.hstack(sensors(*motion.joints(t)))
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
    latitude = np.radians(48.5)
    earth = Rotation.from_rotvec(-turned * np.array([0, np.cos(latitude), np.sin(latitude)]))
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
    for step in (s for s in planned.steps if s.kind == "dwell"):
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


def test_dwells_cost_one_evaluation(model, rows):
    motion = Motion(np.array([0.0, 100.0]), np.zeros((4, 1, 6)))
    truth = Truth(model, site(10.0))
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


# --- a table with errors

EAST, NORTH, UP = np.eye(3)
# what each axis leans toward, and the two lines across it about which it nods
TOWARD = (None, NORTH, EAST, EAST, UP, EAST)
LINES = ((UP, EAST), (NORTH, UP), (EAST, NORTH), (EAST, NORTH), (NORTH, UP), (UP, EAST))
SIZE = 1500 * ARC_SECOND  # large, so that second orders would show

rng = np.random.default_rng(4)
FAULTS = {
    "tilt": {"base_tilt": SIZE * rng.normal(size=2)},
    "azimuth": {"base_azimuth": SIZE},
    "mounting": {"mounting": SIZE * rng.normal(size=3)},
    "placement": {"placement": SIZE * rng.normal(size=6)},
    "encoder once": {"encoder_once": SIZE * rng.normal(size=(6, 2))},
    "encoder twice": {"encoder_twice": SIZE * rng.normal(size=(6, 2))},
    "leaning axes": {"non_orthogonality": SIZE * np.append(0, rng.normal(size=5))},
    "wobble": {"wobble": SIZE * rng.normal(size=6), "wobble_phase": rng.uniform(-3, 3, 6)},
    "wobble of one": {"wobble": np.array([0, 0, 0, 0, SIZE, 0])},
    "ripple": {
        "rate_ripple": 0.01 * rng.normal(size=6),
        "ripple_per_turn": rng.integers(1, 40, 6),
        "ripple_phase": rng.uniform(-3, 3, 6),
    },
}
FAULTS["all"] = {name: value for fault in tuple(FAULTS.values()) for name, value in fault.items()}


def oracle_of(errors):
    """Arguments of `chain.faulty_sensors` for the same table, made by other means."""
    axes = tuple(
        axis if toward is None else chain.leaning(axis, toward, lean)
        for axis, toward, lean in zip(chain.AXES, TOWARD, errors.non_orthogonality, strict=True)
    )
    waves, wobbles, quarter = [], [], np.pi / 2
    for i in range(6):
        n = int(errors.ripple_per_turn[i])
        waves += [
            (i, errors.placement[i], 0, 0.0),
            (i, errors.encoder_once[i, 0], 1, 0.0),
            (i, errors.encoder_once[i, 1], 1, -quarter),  # a sine
            (i, errors.encoder_twice[i, 0], 2, 0.0),
            (i, errors.encoder_twice[i, 1], 2, -quarter),
            (i, -errors.rate_ripple[i] / n, n, errors.ripple_phase[i]),
        ]
        first = LINES[i][0] - (LINES[i][0] @ axes[i]) * axes[i]
        first = first / np.linalg.norm(first)
        second = np.cross(axes[i], first)
        wobbles.append((i, errors.wobble[i], errors.wobble_phase[i], first, second))
    return {
        "base": [*errors.base_tilt, errors.base_azimuth],
        "mounting": errors.mounting,
        "axes": axes,
        "waves": waves,
        "wobbles": wobbles,
    }


def faulty(model, latitude, **fields):
    """The truth of a table with these errors."""
    errors = TableErrors(**fields)
    return Truth(with_errors(model, errors), site(latitude), errors=errors)


def test_both_oracles_agree_on_a_perfect_table():
    rng = np.random.default_rng(1)
    q, v, a = rng.uniform(-3, 3, (3, 500, 6))
    w, f = chain.sensors(q, v, a, 0.8, 9.81)
    w_faulty, f_faulty, C = chain.faulty_sensors(q, v, a, 0.8, 9.81)
    assert np.abs(w_faulty - w).max() < 1e-13  # rounding of rates of 10 rad/s
    assert np.abs(f_faulty - f).max() < 1e-12
    assert np.abs(C - chain.pose(q)[0]).max() < 1e-14


@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize("latitude", [48.5, -33.0])
def test_every_error_matches_the_product_rule(model, latitude, fault):
    rng = np.random.default_rng(1)
    q = rng.uniform(-3, 3, (1500, 6))
    v = rng.uniform(-1, 1, (1500, 6)) * np.radians([30, 30, 30, 200, 200, 400])
    a = rng.uniform(-1, 1, (1500, 6)) * np.radians([60, 60, 60, 200, 200, 400])
    errors = TableErrors(**FAULTS[fault])
    s = site(latitude)
    found = Truth(with_errors(model, errors), s, errors=errors).instants(q, v, a)
    w, f, C = chain.faulty_sensors(q, v, a, s.latitude, s.gravity, **oracle_of(errors))
    # rounding alone, as of the perfect table
    assert np.abs(found.f_b - f).max() < 1e-12
    assert np.abs(found.w_ib_b - w).max() < 1e-13
    assert np.abs(Rotation.from_quat(found.q_wb).as_matrix() - C).max() < 1e-14
    perfect, _ = chain.sensors(q, v, a, s.latitude, s.gravity)
    assert np.abs(w - perfect).max() > 1e-7  # the error does show


def test_accelerometers_at_their_places_on_a_faulty_table(model):
    """All at one place feel what the instrument's point would feel there."""
    place, errors = np.array([0.03, -0.02, 0.05]), TableErrors(**FAULTS["all"])
    built = with_errors(model, errors)
    there = with_errors(model, errors)
    sid = there.site("imu").id
    there.site_pos[sid] += Rotation.from_quat(there.site_quat[sid], scalar_first=True).apply(place)
    q, v, a = np.random.default_rng(1).uniform(-2, 2, (3, 300, 6))
    found = Truth(built, site(48.5), np.tile(place, (3, 1)), errors).instants(q, v, a)
    moved = Truth(there, site(48.5), errors=errors).instants(q, v, a)
    assert np.abs(found.f_places - moved.f_b).max() < 1e-12  # rounding of 100 m/s^2
    assert np.abs(found.f_places - found.f_b).max() > 0.1


def test_a_perfect_table_is_the_nominal_one_to_the_bit(model):
    motion = tumbling(moves=1)
    plain = Truth(model, site(48.5)).block(motion, 200, Sampling.MEAN, 0, 700)
    same = Truth(with_errors(model, PERFECT), site(48.5), errors=PERFECT)
    block = same.block(motion, 200, Sampling.MEAN, 0, 700)
    for name in block.__slots__:
        np.testing.assert_array_equal(getattr(block, name), getattr(plain, name), err_msg=name)
    assert block.encoders is block.joints


def test_the_model_given_stays_as_it_was(model):
    axes, base = model.jnt_axis.copy(), model.body_quat.copy()
    with_errors(model, TableErrors(**FAULTS["all"]))
    np.testing.assert_array_equal(model.jnt_axis, axes)
    np.testing.assert_array_equal(model.body_quat, base)


def at_angle(truth, **degrees):
    """Force [m/s^2] and rate [deg/h] at rest at these joint angles."""
    q = np.zeros((1, 6))
    for name, value in degrees.items():
        q[0, JOINTS.index(name)] = np.radians(value)
    found = truth.instants(q, 0 * q, 0 * q)
    return found.f_b[0], np.degrees(found.w_ib_b[0]) * 3600


def six(**of):
    return np.array([of.get(name, 0.0) for name in JOINTS])


# At 48.5 deg: g = 9.8093587 m/s^2; W cos lat = 9.96651, W sin lat = 11.26509 deg/h.
# sin 5'' = 2.424068e-5, sin 10'' = 4.848137e-5; g times these 2.377856e-4 and 4.755711e-4 m/s^2
# (24.2 and 48.5 ug). X1 = north, Y1 = up, Z1 = east at zero. Bounds: the last digit given, and
# 1e-13 for the rounding of g.
FIVE = 5 * ARC_SECOND


def test_inner_axis_leans_toward_the_middle_one_by_hand(model):
    """Axis N + 5'' E. At 90 deg X1 goes to the axis + sin 5'' (E x N = up): +g sin 5''.

    At 180 deg N goes to 2 a (a N) - N = N cos 10'' + E sin 10'', and Z1 = E to N sin 10'' - E: it
    feels W cos lat sin 10'' = 4.83190e-4 deg/h, and as the axis is level, nothing of gravity.
    """
    truth = faulty(model, 48.5, non_orthogonality=six(inner=FIVE))
    f, _ = at_angle(truth, inner=90)
    assert f[0] == pytest.approx(2.377856e-4, abs=1e-10)
    f, w = at_angle(truth, inner=180)
    assert f == pytest.approx([0, -9.8093587, 0], abs=5e-8)
    assert w[2] == pytest.approx(4.8319e-4, abs=1e-8)
    f, w = at_angle(truth)
    assert f[[0, 2]] == pytest.approx([0, 0], abs=1e-13)  # nothing changes at zero
    assert w[2] == pytest.approx(0, abs=1e-14)


def test_middle_axis_leans_toward_the_outer_one_by_hand(model):
    """Axis E + 5'' up. At 180 deg Z1 = E goes to 2 a (a E) - E = E cos 10'' + up sin 10''."""
    truth = faulty(model, 48.5, non_orthogonality=six(middle=FIVE))
    f, _ = at_angle(truth, middle=180)
    assert f[[0, 2]] == pytest.approx([0, 4.755711e-4], abs=1e-10)
    assert at_angle(truth)[0][2] == pytest.approx(0, abs=1e-13)


@pytest.mark.parametrize("axis", ["outer", "base_yaw"])
def test_an_upright_axis_leans_east_by_hand(model, axis):
    """Axis up + 5'' E. At 180 deg Z1 = E goes to 2 a sin 5'' - E: up by sin 10''."""
    truth = faulty(model, 48.5, non_orthogonality=six(**{axis: FIVE}))
    f, _ = at_angle(truth, **{axis: 180})
    assert f[[0, 2]] == pytest.approx([0, 4.755711e-4], abs=1e-10)


def test_base_pitch_leans_north_by_hand(model):
    """Axis E + 5'' N. At 90 deg Z1 = E goes to the axis + sin 5'' (N x E = down): -g sin 5''."""
    truth = faulty(model, 48.5, non_orthogonality=six(base_pitch=FIVE))
    f, _ = at_angle(truth, base_pitch=90)
    assert f[2] == pytest.approx(-2.377856e-4, abs=1e-10)


def test_placement_of_the_outer_axis_by_hand(model):
    """1' about up takes Z1 = E to E + N sin 1': it feels 9.96651 * 2.908882e-4 deg/h."""
    truth = faulty(model, 48.5, placement=six(outer=60 * ARC_SECOND))
    f, w = at_angle(truth)
    assert w[2] == pytest.approx(2.899140e-3, abs=2e-9)  # 9.96651 has six digits
    assert f[[0, 2]] == pytest.approx([0, 0], abs=1e-13)


def test_base_tilt_and_azimuth_by_hand(model):
    """About north by 10'': E goes down (N x E), Z1 feels -g sin 10''. About east: X1 = N goes up.

    Azimuth about up, as the placement of the outer axis: 9.96651 sin 10'' deg/h on Z1.
    """
    f, _ = at_angle(faulty(model, 48.5, base_tilt=np.array([0, 2 * FIVE])))
    assert f[[0, 2]] == pytest.approx([0, -4.755711e-4], abs=1e-10)
    f, _ = at_angle(faulty(model, 48.5, base_tilt=np.array([2 * FIVE, 0])))
    assert f[[0, 2]] == pytest.approx([4.755711e-4, 0], abs=1e-10)
    f, w = at_angle(faulty(model, 48.5, base_azimuth=2 * FIVE))
    assert f[[0, 2]] == pytest.approx([0, 0], abs=1e-13)
    assert w[2] == pytest.approx(4.8319e-4, abs=1e-8)


def test_a_tilted_base_stays_tilted_as_the_table_turns(model):
    """Outer at 90 deg takes X1 to -E, which the tilt about north lifts: +g sin 10''."""
    f, _ = at_angle(faulty(model, 48.5, base_tilt=np.array([0, 2 * FIVE])), outer=90)
    assert f[[0, 2]] == pytest.approx([4.755711e-4, 0], abs=1e-10)


def test_mounting_of_the_imu_by_hand(model):
    """x_b = x - m x x of what is nominal, f = (0, g, 0), w = (wN, wU, 0), at any table angle.

    About X1 by 10'': Z1 feels -g sin 10''. About Z1: X1 +g sin 10''. About Y1: Z1 turns to north,
    9.96651 sin 10'' deg/h.
    """
    turn = 2 * FIVE * np.eye(3)
    f, _ = at_angle(faulty(model, 48.5, mounting=turn[0]), outer=70)
    assert f[[0, 2]] == pytest.approx([0, -4.755711e-4], abs=1e-10)
    f, _ = at_angle(faulty(model, 48.5, mounting=turn[2]), outer=70)
    assert f[[0, 2]] == pytest.approx([4.755711e-4, 0], abs=1e-10)
    f, w = at_angle(faulty(model, 48.5, mounting=turn[1]))
    assert f[[0, 2]] == pytest.approx([0, 0], abs=1e-13)
    assert w[2] == pytest.approx(4.8319e-4, abs=1e-8)


def test_wobble_goes_once_per_turn_as_the_imu_feels_it(model):
    """At 0 deg the plate is turned about its east line: X1 up, +g sin 5''. At 90 deg about its
    north line, X1: Z1 down. At 180 and 270 deg the other way round."""
    truth = faulty(model, 48.5, wobble=six(outer=FIVE))
    level = 2.377856e-4
    for angle, expected in (
        (0, (level, 0)),
        (90, (0, -level)),
        (180, (-level, 0)),
        (270, (0, level)),
    ):
        f, _ = at_angle(truth, outer=angle)
        assert f[[0, 2]] == pytest.approx(expected, abs=1e-10), angle


def test_encoder_error_once_per_turn_by_hand(model):
    """Sine of 10'': at 90 deg the axis is 10'' further, X1 = -E - N sin 10''; at -90 deg less."""
    truth = faulty(model, 48.5, encoder_once=np.outer(six(outer=2 * FIVE), [0, 1]))
    _, w = at_angle(truth, outer=90)
    assert w[0] == pytest.approx(-4.8319e-4, abs=1e-8)
    _, w = at_angle(truth, outer=-90)
    # -10'' at -90 deg: X1 = E - N sin 10''
    assert w[0] == pytest.approx(-4.8319e-4, abs=1e-8)
    rates = six(outer=1.0)[None]
    found = truth.instants(0 * rates, rates, 0 * rates)
    # at 0 deg the true rate is 1 + sin 10'' cos 0; Earth's 7.292115e-5 sin 48.5 deg added
    assert found.w_ib_b[0, 1] == pytest.approx(1 + 4.848137e-5 + 5.461471e-5, abs=1e-10)


def test_ripple_of_a_constant_rate_by_hand(model):
    """0.1 %, 36 times per turn, phase 90 deg: the rate of 1 rad/s is 1.001 at 0 deg.

    At 2.5 deg (a quarter of its turn) the rate is right and falls by r n w^2 = 0.036 rad/s^2: the
    point at 0.04 m east, 0.06 m north feels that sideways, beside the centripetal and at the
    pole Coriolis force.
    """
    truth = faulty(
        model,
        90.0,
        rate_ripple=six(outer=1e-3),
        ripple_per_turn=np.full(6, 36),
        ripple_phase=six(outer=np.pi / 2),
    )
    rates = six(outer=1.0)[None]
    found = truth.instants(0 * rates, rates, 0 * rates)
    assert found.w_ib_b[0, 1] == pytest.approx(1.001 + 7.292115e-5, abs=1e-14)
    found = truth.instants(np.radians(2.5) * rates, rates, 0 * rates)
    assert found.w_ib_b[0, 1] == pytest.approx(1 + 7.292115e-5, abs=1e-14)
    inward = 1 + 2 * 7.292115e-5
    # up x (0.04 E + 0.06 N) = 0.04 N - 0.06 E, times -0.036
    expected = [-inward * 0.06 - 0.036 * 0.04, -inward * 0.04 + 0.036 * 0.06]
    assert found.f_b[0, [0, 2]] == pytest.approx(expected, abs=1e-13)


def test_encoders_and_true_joints_of_a_block(model):
    """Readings are whole steps of where the drive is; joints and rates are where the axes are."""
    motion, hz = tumbling(moves=2), 200
    step = six(outer=36.0, inner=3.6) * ARC_SECOND
    truth = faulty(
        model, 48.5, placement=six(outer=SIZE), encoder_step=step, rate_ripple=six(inner=0.01)
    )
    n = sample_count(motion.duration, hz)
    block = truth.block(motion, hz, Sampling.MEAN, 0, n)
    q, v, _ = motion.joints(np.arange(1, n + 1) / hz)
    off = block.encoders - q
    assert np.abs(off).max(axis=0) == pytest.approx(step / 2, rel=0.02)  # over 800 samples
    np.testing.assert_array_equal(block.encoder_rates, v)
    assert block.joints[:, 3] - q[:, 3] == pytest.approx(np.full(n, SIZE), abs=1e-14)
    assert block.joint_rates[:, 5] == pytest.approx(v[:, 5] * (1 + 0.01 * np.sin(q[:, 5])))
    np.testing.assert_array_equal(block.joints[:, [0, 1, 2, 4]], q[:, [0, 1, 2, 4]])


def test_means_of_a_rippling_table_match_the_closed_form(model):
    """Waves of 36 and 90 per turn at 60 deg/s: the quadrature steps are short enough for them."""
    motion, hz, s = tumbling(), 100, site(-33.0)
    fields = {
        "rate_ripple": six(outer=0.01, inner=0.001),
        "ripple_per_turn": np.array([1, 1, 1, 36, 1, 90]),
        "wobble": six(middle=60 * ARC_SECOND),
        "encoder_twice": np.full((6, 2), 60 * ARC_SECOND),
    }
    n = sample_count(motion.duration, hz)
    mean = faulty(model, -33.0, **fields).block(motion, hz, Sampling.MEAN, 0, n)
    oracle = oracle_of(TableErrors(**fields))

    def sensors(q, v, a):
        w, f, _ = chain.faulty_sensors(q, v, a, s.latitude, s.gravity, **oracle)
        return w, f

    w, f = oracle_means(motion, np.arange(n + 1) / hz, sensors)
    assert np.abs(mean.f_b - f).max() < 1e-9  # what the quadrature promises
    assert np.abs(mean.w_ib_b - w).max() < 1e-11


# --- a servo's motion: quintic pieces of 1 ms


def servo_like(duration, ripple=0.0, ripple_hz=20.0):
    """Rocking on all six axes from rest to rest, as quintic pieces of 1 ms.

    `ripple` [rad/s]: amplitude of a rate ripple on every axis.
    """
    t = np.arange(round(duration * 1000) + 1) / 1000
    size = np.radians([10, 10, 8, 60, 60, 170])
    pulse = 2 * np.pi * np.array([0.17, 0.21, 0.13, 0.05, 0.11, 0.07])
    part = np.clip(np.minimum(t, duration - t) / 2, 0, 1)
    fade = part**6 * (462 - 1980 * part + 3465 * part**2 - 3080 * part**3 + 1386 * part**4)
    fade = (fade - 252 * part**11)[:, None]  # five derivatives vanish at its ends
    shake = ripple / (2 * np.pi * ripple_hz) * np.sin(2 * np.pi * ripple_hz * t)[:, None]
    return splined(fade * (size * np.sin(pulse * t[:, None] + np.arange(6)) + shake), 1e-3)


def window(motion, first, last):
    """Pieces `first` to `last` - 1 of a motion."""
    return Motion(motion.knots[first : last + 1], motion.coefficients[:, first:last])


def test_windows_of_a_motion_give_what_the_whole_gives(model):
    motion, hz = servo_like(6.0), 200
    truth = Truth(model, site(48.5))
    whole = truth.block(motion, hz, Sampling.MEAN, 0, 1200)
    for first, last in ((0, 400), (400, 401), (401, 1199)):
        # to the bit if the piece that begins with the last sample is there, else by rounding
        bare = truth.block(window(motion, 5 * first, 5 * last), hz, Sampling.MEAN, first, last)
        part = truth.block(window(motion, 5 * first, 5 * last + 1), hz, Sampling.MEAN, first, last)
        assert np.abs(bare.w_ib_b - part.w_ib_b).max() < 1e-11
        for name in part.__slots__:
            rows = getattr(whole, name)[first:last]
            np.testing.assert_array_equal(getattr(part, name), rows, err_msg=name)
    # a clock of its own: intervals from between the knots to between the knots
    edges = np.arange(400, 801) / hz * 1.0001 - 0.00123
    stamps = stamps_ns(np.arange(401, 801), hz)
    felt = truth.sensed(motion, edges, stamps, Sampling.MEAN)
    part = truth.sensed(window(motion, 1990, 4010), edges, stamps, Sampling.MEAN)
    np.testing.assert_array_equal(part.f_b, felt.f_b)
    np.testing.assert_array_equal(part.w_ib_b, felt.w_ib_b)


def test_a_window_costs_two_evaluations_a_step(model, rows):
    """Knots at 0.001 k s and samples at k / 200 s meet though they differ by rounding. Clear of
    the fades, whose jerk may ask for three."""
    truth = Truth(model, site(10.0))
    truth.block(window(servo_like(8.0), 3000, 4000), 200, Sampling.MEAN, 600, 800)
    assert rows == [2001]


@pytest.mark.parametrize("ripple_hz", [5.0, 20.0, 97.0])
def test_means_of_a_servo_s_motion_match_a_finer_quadrature(model, ripple_hz):
    """0.007 deg/s of ripple on every axis. At 97 Hz one step of Simpson's on every millisecond
    would err by ``1.2e-4 rad/s (610/s)^4 (1 ms)^4/2880 = 6e-9 rad/s``."""
    s, hz = site(48.5), 200
    motion = servo_like(8.0, np.radians(0.007), ripple_hz)
    mean = Truth(model, s).block(motion, hz, Sampling.MEAN, 500, 1100)
    w, f = oracle_means(motion, np.arange(500, 1101) / hz, perfect_sensors(s))
    assert np.abs(mean.f_b - f).max() < 1e-9
    assert np.abs(mean.w_ib_b - w).max() < 1e-11


def drift(block, hz, latitude):
    """As `integrate_back`, from the residue of each step: their sum while it is small."""
    n = len(block)
    earth = chain.EARTH_RATE * np.array([0.0, np.cos(latitude), np.sin(latitude)]) / hz
    inertial = Rotation.from_rotvec(np.arange(n)[:, None] * earth)
    C_ib = inertial * Rotation.from_quat(block.q_wb)
    steps = Rotation.from_rotvec(coning_increments(block.w_ib_b / hz))  # of samples 1 to n - 2
    residue = (C_ib[1:-1].inv() * C_ib[:-2] * steps).as_rotvec()
    return np.linalg.norm(np.cumsum(C_ib[1:-1].apply(residue), axis=0), axis=1).max() / ARC_SECOND


@pytest.mark.parametrize(("hz", "bound"), [(200, 0.005), (1000, 0.0001)])
def test_rocking_of_all_six_axes_integrates_back(model, hz, bound):
    """120 s; the bounds are the published ones, coning between the samples sets the first."""
    motion = servo_like(120.0)
    s = site(48.5)
    truth = Truth(model, s)
    block = truth.block(motion, hz, Sampling.MEAN, 0, 120 * hz)
    assert drift(block, hz, s.latitude) < bound
    part = type(block)(*(getattr(block, k)[: 4 * hz] for k in block.__slots__))
    if hz == 200:  # both ways of adding up agree
        one_by_one = integrate_back(part, hz, s.latitude)
        assert drift(part, hz, s.latitude) == pytest.approx(one_by_one, rel=1e-3, abs=1e-8)


@pytest.mark.parametrize("table", ["laboratory", "mid-class"])
def test_a_truth_that_changed_its_table_is_that_of_the_other_one(model, table):
    """To the bit: six axes that wobble, and none; one after the other in the same models."""
    wrong = [draw(load_table(table), seed, None, True) for seed in (1, 2, 3)]
    rng = np.random.default_rng(5)
    q, v, a = rng.uniform(-1, 1, (3, 20, 6))
    changing, built = Truth(with_errors(model, PERFECT), site(48.5), errors=PERFECT), None
    for errors in [*wrong, PERFECT, wrong[0]]:
        built = with_errors(model, errors, into=built)
        changing.change(built, errors)
        fresh = Truth(with_errors(model, errors), site(48.5), errors=errors).instants(q, v, a)
        found = changing.instants(q, v, a)
        for name in ("w_ib_b", "f_b", "q_wb", "joints", "joint_rates"):
            np.testing.assert_array_equal(getattr(found, name), getattr(fresh, name), err_msg=name)
