"""Hand-held calibration: ranks by hand, the published result, truth, and logs that do not do."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import chi2
from turned_by_hand import LATITUDE, G, anyhow, log_of, unit_of

from alignment import ImuReadings, Priors, Site
from alignment.calibration import Gravity, Key, constants_of
from alignment.calibration.gravity import gravity_of
from alignment.calibration.hand_held import HandHeld, hand_held
from alignment.calibration.moves import moves_of, turned
from alignment.calibration.orientations import NAMES, additions, in_words, norm_rows, rank_of
from alignment.calibration.rest_means import drift_variances, rounding_variances
from alignment.errors import AlignmentError, TooShort
from stand.calibration.truth import true_values
from stand.imu.priors import priors_of

SHARED = Path(__file__).resolve().parents[3].parent / "shared" / "data" / "real" / "imu_tk_xsens"
SITE = Site(LATITUDE)
MEASURED = Gravity(value=G, sigma=3e-5)

FACES = np.r_[np.eye(3), -np.eye(3)]
EDGES = np.array(
    [v for v in np.stack(np.meshgrid(*[[-1, 0, 1]] * 3), -1).reshape(-1, 3) if abs(v).sum() == 2]
) / np.sqrt(2)
CORNERS = np.stack(np.meshgrid(*[[-1, 1]] * 3), -1).reshape(-1, 3) / np.sqrt(3)


# --- what can be told ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("up", "rank"),
    [
        (FACES, 6),
        (CORNERS, 7),
        (EDGES, 9),
        (Rotation.create_group("O").apply([0, 0, 1.0]), 6),  # 24 positions of a cube
        (np.r_[FACES, CORNERS], 9),
        (FACES[:1], 1),
    ],
    ids=["faces", "corners", "edges", "24 positions", "faces and corners", "one"],
)
def test_ranks_by_the_norm(up, rank):
    """Squares, products and components of the vertical: counted by hand, methods.md section 7."""
    found, condition, lost = rank_of(norm_rows(up))
    assert (found, len(lost)) == (rank, 9 - rank)
    assert (condition < 3) is (rank == 9)
    assert bool(additions(up)) is (rank < 9)


def test_what_cannot_be_told_in_words():
    told = in_words(rank_of(norm_rows(FACES))[2], NAMES)
    assert told == tuple(
        f"accelerometer non-orthogonality {pair}: not told at all"
        for pair in ("Y1-Z1", "Z1-X1", "X1-Y1")
    )
    (told,) = in_words(rank_of(norm_rows(CORNERS))[2], NAMES)
    assert told.startswith("cannot be told apart: accelerometer scale factor X1")
    # squares of two components: two faces
    assert len(additions(CORNERS)) == 2
    assert all(len(name.removesuffix(" up").strip("-")) == 2 for name in additions(CORNERS))


def log_of_verticals(ups):
    """A perfect unit's attitudes with these verticals in b."""
    up_n = np.array([0, 0, -1.0])
    return [Rotation.align_vectors([up_n], [u])[0].as_quat() for u in ups]


@pytest.mark.parametrize(
    ("ups", "said"),
    [
        (np.tile(FACES, (2, 1)), "rank 6 of 9 by gravity's norm: accelerometer non-orthogonality"),
        (np.tile(FACES, (2, 1)), ": add rests with "),
        (np.tile(CORNERS, (2, 1)), "cannot be told apart: accelerometer scale factor X1"),
        (np.tile(FACES[:1], (12, 1)), "rank 1 of 9"),
    ],
)
def test_attitudes_that_do_not_do(ups, said):
    log, _, _ = log_of(unit_of("hg9900", 1, 20), log_of_verticals(ups), rest_s=4)
    # rests one after the other in one attitude are one rest
    ran_together = len(np.unique(ups, axis=0)) == 1
    with pytest.raises(TooShort if ran_together else AlignmentError) as told:
        hand_held(log, MEASURED, SITE)
    assert ("one rest in" if ran_together else said) in str(told.value)


def test_turns_about_one_axis_alone():
    """The vertical goes round in a plane: the gyro along the axis alone turns it."""
    quats = Rotation.from_euler("x", np.arange(0, 360, 15)[:, None], degrees=True).as_quat()
    log, _, _ = log_of(unit_of("stim300", 1, 20), quats, rest_s=4, move_s=2)
    with pytest.raises(AlignmentError, match="by gravity's norm"):
        hand_held(log, MEASURED, SITE)
    # with a sheet it is no fault of the log: what is not told is said
    priors = priors_of(unit_of("stim300", 1).sheet, None)
    found = hand_held(log, MEASURED, SITE, priors)
    by_key = {p.key: p for p in found.parameters}
    assert by_key[Key("accel", "bias", 0)].basis == "prior"
    assert by_key[Key("accel", "bias", 1)].basis == "data"
    assert any("rank" in line for line in found.notes)


# --- parts by hand -------------------------------------------------------------------------------

KEYS = [Key("gyro", "bias", 0), Key("gyro", "scale", 0), Key("gyro", "misalignment", 1, 0)]


def test_a_move_of_instants_is_that_of_its_means():
    """Of ``1 - cos 2 pi t`` rad/s at 20 Hz the wave's means are off by 11 (0.314)^4/720, 1.5e-4: by
    as much of the 1 rad that the other axis turns meanwhile, at most. Instants themselves are off
    by 0.314^2/24, 4e-3; half a sample late is no error of a move from rest to rest."""
    edges = np.arange(61) / 20
    inside = (edges >= 1.0) & (edges <= 2.0)
    rate = inside * (1 - np.cos(2 * np.pi * edges))
    angle = np.clip(edges, 1, 2) - np.sin(2 * np.pi * edges) * inside / (2 * np.pi)
    w = np.stack([rate, np.roll(rate, 4), 0 * rate], axis=1)[1:]
    mean = np.diff(angle) * 20
    means = np.stack([mean, np.roll(mean, 4), 0 * mean], axis=1)
    f, t = np.tile([0, 0, 9.8], (60, 1)), edges[1:]
    rests, none = [(0.0, 1.0), (2.4, 3.0)], constants_of(KEYS, [0.0] * 3, "gyro")
    turns = [
        Rotation.from_matrix(turned(moves, none, moves.f, KEYS).C[0])
        for moves in (
            moves_of(log, rests, set())
            for log in (
                ImuReadings(t, means, f),
                ImuReadings(t, w, f, instants=True),
                ImuReadings(t, w, f),
            )
        )
    ]
    right, wrong = ((turns[0].inv() * other).magnitude() for other in turns[1:])
    assert right < 1.5e-4
    assert wrong > 5e-4


def test_a_move_is_integrated():
    """90 deg about X1 in 1 s; a bias turns it further, a scale error by its part of it."""
    t = np.arange(1, 301) / 100
    w = np.zeros((300, 3))
    w[100:200, 0] = np.pi / 2
    log = ImuReadings(t, w, np.tile([0, 0, 9.8], (300, 1)))
    moves = moves_of(log, [(0.0, 1.0), (2.0, 3.0)], set())
    assert (len(moves.dt), moves.spans) == (100, pytest.approx([1.0]))

    def moved(values):
        return turned(moves, constants_of(KEYS, values, "gyro"), moves.f, KEYS)

    found = moved([0.0, 0.0, 0.0])
    by_hand = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]])  # Z1 goes to -Y1, Y1 to Z1
    np.testing.assert_allclose(found.C[0], by_hand, atol=1e-12)
    # what a positive error adds to a reading is taken from the truth
    np.testing.assert_allclose(found.by[0][:, 0], [-1, 0, 0], atol=1e-12)
    np.testing.assert_allclose(found.by[0][:, 1], [-np.pi / 2, 0, 0], atol=1e-12)
    # Y1 feels a part of X1's rate: about Y1, then about the axis it has become: integral of
    # (cos, sin) over a quarter turn, a step of 1/100 of it at a time (second order of 1e-4)
    np.testing.assert_allclose(found.by[0][:, 2], [0, -1, 1], atol=1e-4)
    for n in range(3):
        step = 1e-5
        ends = [Rotation.from_matrix(moved(np.eye(3)[n] * s).C[0]) for s in (step, -step)]
        seen = (ends[1].inv() * ends[0]).as_rotvec() / (2 * step)
        np.testing.assert_allclose(seen, found.by[0][:, n], atol=1e-4)


def test_drift_alike_and_apart():
    """Of rests over much less than a second nearly all instability is alike."""
    assert drift_variances([(0, 1), (2, 3)], 0.0) == (0.0, 0.0)
    common, apart = drift_variances([(0, 1e-4), (2e-4, 3e-4)], 1.0)
    # five unit processes over the level of their plateau
    assert common == pytest.approx(5 / 0.76475**2, rel=1e-3)
    assert apart < 1e-3 * common
    far = drift_variances([(k * 1e6, k * 1e6 + 1e-3) for k in range(4)], 1.0)
    assert far[0] == pytest.approx(5 / 4 / 0.76475**2, rel=1e-3)
    assert far[0] + far[1] == pytest.approx(5 / 0.76475**2, rel=1e-3)


def test_what_rounding_leaves():
    """Steps of 2 with noise of 0.6: the first wave's (2/pi) exp(-2 pi^2 0.09), its mean square
    half; without noise 2^2/12; noise below the steps that are asked for is none."""
    shown = np.array([[4 * (0.09 + 1 / 12), 0.0, 1.0]])
    first = (2 * np.exp(-2 * np.pi**2 * 0.09) / np.pi) ** 2 / 2
    found = rounding_variances(shown, np.array([2.0, 2.0, 0.0]))
    np.testing.assert_allclose(found, [[first, 4 / 12, 0.0]], rtol=0.01)  # waves beyond it
    (none,) = rounding_variances(shown[:, :1], np.array([2.0]), least=0.6)
    np.testing.assert_allclose(none, 4 / 12, rtol=0.01)


Q = np.radians(0.3)  # rad/s, a step of coarse gyros


def coarse(bias, attitudes, **how):
    """What a unit without noise that rounds to 0.3 deg/s and 10 mg is found to be: its calibration,
    gyro biases less the true ones and their sigmas, in steps."""
    log, _, _ = log_of(unit_of("ideal", 1, 25), attitudes, rest_s=5)
    w = Q * np.rint(log.w_ib_b / Q + bias)
    rounded = ImuReadings(log.t, w, 0.1 * np.rint(log.f_b / 0.1))
    found = hand_held(rounded, Gravity(value=G, sigma=1e-6), SITE, **how)
    own = [k for k, key in enumerate(found.keys) if (key.sensor, key.term) == ("gyro", "bias")]
    return found, found.values[own] / Q - bias, found.sigmas[own] / Q


def about_one_axis_each(count, seed):
    """Attitudes (count, 4) by quarter turns and others, about X1, Y1, Z1 in turn."""
    angles = np.radians(np.random.default_rng(seed).choice([90, -90, 120, 60], count))
    path = [Rotation.identity()]
    for k in range(count - 1):
        path.append(path[-1] * Rotation.from_rotvec(np.eye(3)[k % 3] * angles[k]))
    return Rotation.concatenate(path).as_quat()


def test_a_unit_too_coarse_for_its_noise():
    """Gyros read their bias alike in all rests: those tell it to a step over sqrt 12, however many
    they are. So does a move with the axes that it does not turn, two thirds of the time at least;
    one about any axis for the third in which the hand has not begun, or ends. 21 numbers."""
    bias = np.array([0.3, -0.45, 5.2])
    found, off, sigmas = coarse(bias, anyhow(20, 3))
    assert (sigmas > 0.3 / np.sqrt(12)).all()
    assert (sigmas < 0.6 / np.sqrt(12)).all()
    assert (np.abs(off) < 2.5 * sigmas).all()
    force = [k for k, key in enumerate(found.keys) if key.sensor == "accel"]
    assert 0.1 < np.mean((found.values / found.sigmas)[force] ** 2) < 3.0
    _, off, sigmas = coarse(bias, about_one_axis_each(20, 1))
    assert (sigmas > 0.67 / np.sqrt(12)).all()
    assert (np.abs(off) < 2.5 * sigmas).all()


def test_no_rounding_is_by_more_than_what_is_rounded():
    """A sheet's 0.02 steps of bias, and the Earth's 0.014: all is read as zero."""
    bias = np.array([0.018, -0.03, 0.005])
    known = Priors(gyro_bias=0.02 * Q)
    _, off, sigmas = coarse(bias, about_one_axis_each(20, 1), priors=known)
    assert (sigmas < 0.032).all()
    assert (np.abs(off) < 2.5 * sigmas).all()


def test_gravity_as_it_is_known():
    assert gravity_of(Site(None), 9.8, 1e-5) == Gravity(value=9.8, sigma=1e-5)
    assert gravity_of(Site(0.0)) == Gravity(value=Site(0.0).gravity, sigma=3e-4)
    anywhere = gravity_of(Site(None))
    for latitude in (0.0, np.pi / 2):
        assert abs(Site(latitude).gravity - anywhere.value) < 2 * anywhere.sigma
    with pytest.raises(AlignmentError, match=r"gravity = 1.62 m/s\^2: must be 9 to 10.5"):
        gravity_of(Site(None), 1.62)
    with pytest.raises(AlignmentError, match="gravity sigma = -1"):
        gravity_of(Site(None), 9.8, -1)


# --- against truth -------------------------------------------------------------------------------


def calibrated(sheet, seed, count=16, rate_hz=25):
    unit = unit_of(sheet, seed, rate_hz)
    g = G + MEASURED.sigma * np.random.default_rng(seed + 100).standard_normal()
    log, _, _ = log_of(unit, anyhow(count, seed), g=g, rest_s=5, move_s=3)
    found = hand_held(log, MEASURED, SITE, priors_of(unit.sheet, None))
    return found, true_values(found.keys, unit.gyro_errors, unit.accel_errors, unit.sheet)


def nees(found, truth):
    """Squared errors in units of the covariance, and how many directions it has."""
    z = (found.values - truth) / found.sigmas
    R = found.covariance / np.outer(found.sigmas, found.sigmas)
    sizes, axes = np.linalg.eigh(R)
    there = sizes > 1e-8 * sizes[-1]  # m_ij and m_ji of the accelerometers are one unknown
    return float(np.sum((axes[:, there].T @ z) ** 2 / sizes[there])), int(there.sum())


@pytest.mark.slow
@pytest.mark.parametrize("sheet", ["stim300", "hg9900"])
def test_errors_are_what_the_covariance_says(sheet):
    """NEES of six units within 99.9 % of chi-square, from both sides."""
    pairs = [nees(*calibrated(sheet, seed)) for seed in range(6)]
    total, dof = (sum(part) for part in zip(*pairs, strict=True))
    low, high = chi2.ppf([0.0005, 0.9995], dof)
    assert low < total < high


def test_the_budget_adds_up():
    found, _ = calibrated("stim300", 3)
    total = np.sum([one.sigmas**2 for one in found.budget], axis=0)
    np.testing.assert_allclose(total, found.covariance.diagonal(), rtol=1e-6)
    names = {one.name for one in found.budget}
    assert names >= {"readings at rests", "moves", "gravity", "data sheet", "rotation of the case"}


def test_residuals_are_of_one_sigma():
    """Each in its own sigma: their mean square is one, to 4 sqrt(2/n)."""
    found, _ = calibrated("stim300", 3)
    by_kind = {}
    for one in found.residuals:
        by_kind.setdefault(one.of, []).extend(one.sigmas)
    assert [len(v) for v in by_kind.values()] == [16, 48, 30]
    for values in by_kind.values():
        assert np.mean(np.square(values)) == pytest.approx(1, abs=4 * np.sqrt(2 / len(values)))


def test_gravitys_sigma_is_the_scales():
    """0.1 % of gravity is 0.1 % of every scale factor, and no bias."""
    unit = unit_of("hg9900", 4, 20)
    log, _, _ = log_of(unit, anyhow(14, 4), rest_s=4)
    fine, coarse = (
        hand_held(log, Gravity(value=G, sigma=sigma), SITE) for sigma in (0.0, 1e-3 * G)
    )
    more = coarse.sigmas**2 - fine.sigmas**2
    by_key = dict(zip(fine.keys, more, strict=True))
    for axis in range(3):
        # the scale error itself is below 1e-3 of that
        assert np.sqrt(by_key[Key("accel", "scale", axis)]) == pytest.approx(1e-3, rel=1e-3)
        assert abs(by_key[Key("accel", "bias", axis)]) < (1e-6) ** 2
    (gravity,) = coarse.nuisance
    assert (gravity.name, gravity.basis) == ("gravity", "prior")


def bumped(log, rest, by):
    """The forces of one rest, 5 s of it at 25 Hz and 8 s to the next, longer by a part."""
    f = np.array(log.f_b)
    first = rest * (5 + 3) * 25
    f[first : first + 125] *= 1 + by
    return replace(log, f_b=f)


def test_a_rest_that_was_none_is_named_and_left_out():
    unit = unit_of("stim300", 6, 25)
    log, _, _ = log_of(unit, anyhow(16, 6), rest_s=5, move_s=3)
    priors = priors_of(unit.sheet, None)
    clean = hand_held(log, MEASURED, SITE, priors)
    assert clean.left_out == ()
    found = hand_held(bumped(log, 5, 2e-3), MEASURED, SITE, priors)
    (out,) = found.left_out
    assert out.stretch.startswith("rest 6 (40.")
    assert "sigma: bumped, or not at rest" in out.reason
    # and without it the answer is the same within what one rest of sixteen tells
    z = (found.values - clean.values) / found.sigmas
    assert np.abs(z).max() < 1.5


def test_a_move_with_wild_gyros_is_named_and_left_out():
    unit = unit_of("stim300", 6, 25)
    log, _, _ = log_of(unit, anyhow(16, 6), rest_s=5, move_s=3)
    w = np.array(log.w_ib_b)
    w[25 * 5 + 30 : 25 * 5 + 34] += 1.0  # 0.16 rad in the first move
    found = hand_held(replace(log, w_ib_b=w), MEASURED, SITE, priors_of(unit.sheet, None))
    (out,) = found.left_out
    assert out.stretch.startswith("move from rest 1 (")


def test_a_gap_parts_the_chain():
    unit = unit_of("stim300", 7, 25)
    log, _, _ = log_of(unit, anyhow(18, 7), rest_s=5, move_s=3)
    there = np.ones(len(log), bool)
    there[25 * 62 : 25 * 64] = False  # in a move
    cut = ImuReadings(log.t[there], log.w_ib_b[there], log.f_b[there])
    found = hand_held(cut, MEASURED, SITE, priors_of(unit.sheet, None))
    assert any("gyros by 16 moves" in line for line in found.notes)
    truth = true_values(found.keys, unit.gyro_errors, unit.accel_errors, unit.sheet)
    total, dof = nees(found, truth)
    assert chi2.sf(total, dof) > 1e-4


# --- logs that are wrong -------------------------------------------------------------------------


@pytest.fixture(scope="module")
def a_log():
    log, _, _ = log_of(unit_of("stim300", 9, 25), anyhow(14, 9), rest_s=5, move_s=3)
    return log


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (
            lambda w, f: (w, f / 9.80665),
            "accelerometers read 0.9998 m/s^2 at rest, must be near 9.809",
        ),
        (lambda w, f: (w, f / 9.80665), "their unit seems to be g"),
        (lambda w, f: (w, f * 9.80665), "seems to be m/s^2, not g"),
        (lambda w, f: (np.degrees(w), f), "they seem to be in deg/s"),
        (lambda w, f: (-w, f), "mirrored axes, or rates of the wrong sign"),
        (lambda w, f: (w * [1, 1, -1], f * [1, 1, -1]), "mirrored axes"),
        (lambda w, f: (w[:, [1, 0, 2]], f[:, [1, 0, 2]]), "mirrored axes"),
        (lambda w, f: (w[:, [1, 2, 0]], f), "their axes should be z,x,y of what they are"),
        (lambda w, f: (0 * w, f), "wrong unit, or axes that are not the accelerometers'"),
    ],
)
def test_units_and_axes_that_are_wrong(a_log, change, said):
    w, f = change(a_log.w_ib_b, a_log.f_b)
    with pytest.raises(AlignmentError) as told:
        hand_held(ImuReadings(a_log.t, w, f), MEASURED, SITE)
    assert said in str(told.value)


def test_a_sensor_at_full_scale(a_log):
    """Gyros that end at 2 rad/s: the moves in which they did are named, or too few are left."""
    peaks = np.abs(a_log.w_ib_b).max(axis=0)
    log = replace(a_log, w_ib_b=np.clip(a_log.w_ib_b, *(0.9 * peaks.max() * np.array([-1, 1]))))
    found = hand_held(log, MEASURED, SITE)
    assert {out.reason.partition(" gyro ")[2] for out in found.left_out} == {"at full scale"}
    assert found.chi_square < 2 * found.dof
    with pytest.raises(AlignmentError, match=r"rank \d of 9|no move between .* gyro at full"):
        hand_held(replace(a_log, w_ib_b=np.clip(a_log.w_ib_b, -0.7, 0.7)), MEASURED, SITE)


def test_moves_too_quick_for_their_samples():
    """A half turn in half a second at 10 Hz: no sigma can be enlarged for that."""
    unit = unit_of("stim300", 1, 10)
    log, _, _ = log_of(unit, anyhow(14, 1), rest_s=5, move_s=0.5)
    with pytest.raises(AlignmentError, match=r"contradict one another by \d+ times their noise"):
        hand_held(log, MEASURED, SITE)


def test_a_unit_without_noise():
    unit = unit_of("ideal", 1, 25)
    log, _, _ = log_of(unit, anyhow(14, 1), rest_s=5)
    found = hand_held(log, Gravity(value=G), SITE)
    # the truth is made of samples' means, and integrated to the third order of 0.1 rad
    assert np.abs(found.values).max() < 1e-6
    assert np.abs(found.values / found.sigmas).max() < 4


def test_a_gravity_that_is_odd_for_the_site(a_log):
    found = hand_held(a_log, Gravity(value=9.79), SITE)
    assert any("gravity 9.79 m/s^2 is -0.0194 off normal gravity" in n for n in found.notes)
    assert not any("off normal gravity" in n for n in hand_held(a_log, MEASURED, SITE).notes)


def test_too_few_rests(a_log):
    with pytest.raises(TooShort, match="3 rests in 24 s: at least 9 are needed"):
        hand_held(a_log.between(0, 24), MEASURED, SITE)
    rng = np.random.default_rng(1)
    never = ImuReadings(a_log.t, rng.normal(0, 1, a_log.w_ib_b.shape), a_log.f_b)
    with pytest.raises(TooShort, match="no rest in"):
        hand_held(never, MEASURED, SITE, choices=HandHeld(shortest=1000.0))


# --- the published result ------------------------------------------------------------------------

PUBLISHED = {
    "T": [-0.0033593, -0.00890639, -0.0213341],
    "1/K": [414.459, 412.01, 414.649],
    "b": [33124.2, 33275.2, 32364.4],
    "gyro T": [0.00593634, 0.00111101, 0.00808812, -0.0535569, 0.0253067, -0.0025513],
    "gyro 1/K": [4777.96, 4764.21, 4773.66],
    "gyro b": [32777.1, 32459.8, 32511.8],
}
ACCEL_LSB, GYRO_LSB, MIDDLE = 1 / 414, 1 / 4778, 32768  # nominal, of a count

there = pytest.mark.skipif(
    not (SHARED / "xsens_acc.mat").exists(),
    reason=f"the log of imu_tk is not part of the project; none in {SHARED}",
)


@pytest.fixture(scope="module")
def xsens():
    accel, gyro = (np.loadtxt(SHARED / f"xsens_{name}.mat") for name in ("acc", "gyro"))
    f, w = (accel[:, 1:] - MIDDLE) * ACCEL_LSB, (gyro[:, 1:] - MIDDLE) * GYRO_LSB
    return ImuReadings(accel[:, 0], w, f)


def as_imu_tk(found):
    """The same numbers in its frame: ``T K (X - b)``, T of the accelerometers upper triangular."""
    accel, gyro = (constants_of(found.keys, found.values, s) for s in ("accel", "gyro"))
    # b turned until the correction of the accelerometers is triangular
    Q, U = np.linalg.qr(np.linalg.inv(accel.scale_and_axes))
    signs = np.sign(U.diagonal())
    U, back = signs[:, None] * U, (Q * signs).T
    V = back @ np.linalg.inv(gyro.scale_and_axes)
    T, own = U / U.diagonal(), V / V.diagonal()
    return {
        "T": T[[0, 0, 1], [1, 2, 2]],
        "1/K": 1 / (ACCEL_LSB * U.diagonal()),
        "b": MIDDLE + accel.bias / ACCEL_LSB,
        "gyro T": own[[0, 0, 1, 1, 2, 2], [1, 2, 0, 2, 0, 1]],
        "gyro 1/K": 1 / (GYRO_LSB * V.diagonal()),
        "gyro b": MIDDLE + gyro.bias / GYRO_LSB,
    }


@pytest.fixture(scope="module")
def published(xsens):
    return hand_held(xsens, Gravity(value=9.81744), choices=HandHeld(as_published=True))


@there
def test_the_published_result(published):
    """The method to the letter, on its authors' own log.

    Bounds: what two ways to find rests and to weigh samples differ by, a third of its own sigmas.
    """
    found = as_imu_tk(published)
    np.testing.assert_allclose(found["T"], PUBLISHED["T"], atol=1e-3)
    np.testing.assert_allclose(found["1/K"], PUBLISHED["1/K"], rtol=150e-6)
    np.testing.assert_allclose(found["b"], PUBLISHED["b"], atol=0.5)
    np.testing.assert_allclose(found["gyro T"], PUBLISHED["gyro T"], atol=1e-3)
    np.testing.assert_allclose(found["gyro 1/K"], PUBLISHED["gyro 1/K"], rtol=300e-6)
    np.testing.assert_allclose(found["gyro b"], PUBLISHED["gyro b"], atol=0.5)


@pytest.mark.slow
@there
def test_what_the_published_method_leaves(xsens, published):
    """Its gyros feel gravity, 13 steps per g: told, the misses fit their noise."""
    ours = hand_held(xsens, Gravity(value=9.81744))
    assert published.chi_square > 10 * published.dof
    assert ours.chi_square < 1.5 * ours.dof
    by_key = {p.key: p for p in ours.parameters}
    strongest = by_key[Key("gyro", "g_sensitivity", 1, 0)]
    # the slope of the means of rates at rest over the vertical, counted apart: 12.6 steps per g
    assert strongest.value * 9.81744 / GYRO_LSB == pytest.approx(-13, abs=1)
    assert abs(strongest.value) > 20 * strongest.sigma
    # and the published numbers are where their own sigmas say
    keys = set(published.keys) & set(ours.keys)
    theirs = {p.key: p for p in published.parameters}
    z = [(by_key[k].value - theirs[k].value) / theirs[k].sigma for k in keys if k.term != "bias"]
    assert np.abs(z).max() < 3


def test_nothing_is_known_before_without_a_sheet(a_log):
    found = hand_held(a_log, MEASURED, SITE)
    assert all(p.prior_sigma == np.inf for p in found.parameters)
    known = hand_held(a_log, MEASURED, SITE, Priors(gyro_bias=1e-5))
    by_key = {p.key: p.prior_sigma for p in known.parameters}
    assert by_key[Key("gyro", "bias", 0)] == 1e-5
    assert by_key[Key("gyro", "scale", 0)] == np.inf
