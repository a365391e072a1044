"""The instrument: signs and sizes of its errors by hand, its noise, and its random streams."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import chi2

from stand.imu import Imu, ImuSpec, TriadSpec, load_imu
from stand.imu import without as switched_off
from stand.imu.model import Triad, draw, stream, streams
from stand.samples import TruthBlock
from stand.toml_files import ids

STILL = TriadSpec()
ROUNDING = 1e-15  # relative, of a few products


def truth(n: int, seed: int = 1) -> TruthBlock:
    rng = np.random.default_rng(seed)
    w, f = rng.normal(size=(2, n, 3))
    t_ns = (np.arange(n) + 1) * 5_000_000
    return TruthBlock(
        t_ns, w, f, np.tile([0.0, 0, 0, 1], (n, 1)), np.zeros((n, 6)), np.ones((n, 6))
    )


def rows(block: TruthBlock, a: int, b: int) -> TruthBlock:
    return TruthBlock(*(getattr(block, name)[a:b] for name in TruthBlock.__slots__))


def with_gyro(spec: ImuSpec, **changes: float) -> ImuSpec:
    return replace(spec, gyro=replace(spec.gyro, **changes))


# --- presets in SI, by hand


@pytest.mark.parametrize(
    ("name", "gyro", "accel"),
    [
        # deg/h = 4.8481368e-6 rad/s; deg/rt-h = 2.9088821e-4 rad/s/rt-Hz;
        # mg = 9.80665e-3 m/s^2; m/s/rt-h = 1/60 m/s^2/rt-Hz
        (
            "stim300",
            (1.9392547e-5, 500e-6, 1e-3, 4.3633231e-5),
            (1.8632635e-2, 200e-6, 1e-3, 4.0e-4),
        ),
        ("adis16488", (3.4906585e-3, 0.0, 0.0, 8.7266463e-5), (0.1569064, 0.0, 0.0, 4.8333333e-4)),
        (
            "ring-laser",
            (1.6968479e-8, 5e-6, 4.85e-5, 8.7266463e-7),
            (2.4516625e-4, 100e-6, 4.85e-5, 5.8833333e-4),
        ),
        ("ideal", (0.0,) * 4, (0.0,) * 4),
    ],
)
def test_presets_by_hand(name, gyro, accel):
    spec = load_imu(name)
    for triad, hand in ((spec.gyro, gyro), (spec.accel, accel)):
        values = (triad.bias, triad.scale, triad.misalignment, triad.noise)
        assert values == pytest.approx(hand, rel=1e-7)  # the hand numbers have eight digits


def test_further_values_of_a_preset_by_hand():
    """STIM300: deg/h = 4.8481368e-6 rad/s, g = 9.80665 m/s^2, deg = 1.7453293e-2 rad."""
    gyro, accel = load_imu("stim300").gyro, load_imu("stim300").accel
    assert (gyro.instability, gyro.nonlinearity, gyro.non_orthogonality) == pytest.approx(
        (1.4544410e-6, 20e-6, 0.2e-3), rel=1e-7
    )
    assert (gyro.g_sensitivity, gyro.bandwidth, gyro.range, gyro.resolution) == pytest.approx(
        (4.9437236e-7, 262.0, 6.9813170, 1.0663962e-6), rel=1e-7
    )
    assert (accel.instability, accel.nonlinearity, accel.bandwidth) == pytest.approx(
        (4.903325e-5, 200e-6, 248.0), rel=1e-12
    )
    assert (accel.range, accel.resolution) == pytest.approx((98.0665, 1.8632635e-5), rel=1e-12)
    assert (gyro.full_scale, accel.full_scale) == (gyro.range, accel.range)


# Each key of a preset with the value 1, and what it is in SI by hand: deg = 1.745329252e-2 rad,
# g = 9.80665 m/s^2, an hour has 3600 s and its root 60 rt-s.
ONES = {
    "gyro": {
        "turn_on_bias_deg_h": ("bias", 4.848136811e-6),
        "bias_instability_deg_h": ("instability", 4.848136811e-6),
        "angle_random_walk_deg_rt_h": ("noise", 2.908882087e-4),
        "rate_random_walk_deg_h_rt_h": ("random_walk", 8.080228018e-8),
        "rate_ramp_deg_h_h": ("ramp", 1.346704670e-9),
        "scale_factor_ppm": ("scale", 1e-6),
        "scale_asymmetry_ppm": ("asymmetry", 1e-6),
        "scale_nonlinearity_ppm": ("nonlinearity", 1e-6),
        "misalignment_mrad": ("misalignment", 1e-3),
        "non_orthogonality_mrad": ("non_orthogonality", 1e-3),
        "g_sensitivity_deg_h_g": ("g_sensitivity", 4.943723709e-7),
        "g2_sensitivity_deg_h_g2": ("g2_sensitivity", 5.041195219e-8),
        "bias_temperature_deg_h_K": ("bias_temperature", 4.848136811e-6),
        "scale_temperature_ppm_K": ("scale_temperature", 1e-6),
        "bandwidth_hz": ("bandwidth", 1.0),
        "range_deg_s": ("range", 1.745329252e-2),
        "resolution_deg_s": ("resolution", 1.745329252e-2),
        "increment_lsb_arc_s": ("increment_lsb", 4.848136811e-6),
    },
    "accel": {
        "turn_on_bias_mg": ("bias", 9.80665e-3),
        "bias_instability_ug": ("instability", 9.80665e-6),
        "velocity_random_walk_m_s_rt_h": ("noise", 1.666666667e-2),
        "acceleration_random_walk_ug_rt_h": ("random_walk", 1.634441667e-7),
        "acceleration_ramp_ug_h": ("ramp", 2.724069444e-9),
        "scale_factor_ppm": ("scale", 1e-6),
        "scale_asymmetry_ppm": ("asymmetry", 1e-6),
        "scale_nonlinearity_ppm": ("nonlinearity", 1e-6),
        "misalignment_mrad": ("misalignment", 1e-3),
        "non_orthogonality_mrad": ("non_orthogonality", 1e-3),
        "second_order_ug_g2": ("second_order", 1.019716213e-7),
        "bias_temperature_ug_K": ("bias_temperature", 9.80665e-6),
        "scale_temperature_ppm_K": ("scale_temperature", 1e-6),
        "bandwidth_hz": ("bandwidth", 1.0),
        "range_g": ("range", 9.80665),
        "resolution_mg": ("resolution", 9.80665e-3),
        "increment_lsb_m_s": ("increment_lsb", 1.0),
    },
}


def test_every_key_of_a_users_own_preset_in_si(tmp_path):
    said = 'kind = "assumed", source = "made up for this test"'
    lines = ['title = "Own"', 'grade = "reference"', 'evidence = "none"']
    lines += ["bias_corners_s = [2, 30.0]", "reference_temperature_C = 20"]
    for sensor, keys in ONES.items():
        lines += [f"[{sensor}]", *(f"{key} = {{ value = 1, {said} }}" for key in keys)]
    lines += [f"places_mm = {{ value = [[1, 2, 3], [4, 5, 6], [7, 8, 9]], {said} }}"]
    lines += ["[sampling]", 'output = "increment"']
    for key in ("clock_offset_ppm", "jitter_us", "latency_ms", "output_rate_hz"):
        lines.append(f"{key} = {{ value = 1, {said} }}")
    path = tmp_path / "own.toml"
    path.write_text("\n".join(lines))
    spec = load_imu(str(path))
    for sensor, keys in ONES.items():
        triad = getattr(spec, sensor)
        for field, hand in keys.values():
            assert getattr(triad, field) == pytest.approx(hand, rel=1e-9), field  # ten digits
        named = {field for field, _ in keys.values()} | {"full_scale", "bounded", "axes", "known"}
        others = {"second_order"} if sensor == "gyro" else {"g_sensitivity", "g2_sensitivity"}
        assert named == set(TriadSpec.__slots__) - others
    assert (spec.clock.offset, spec.clock.jitter, spec.clock.latency) == (1e-6, 1e-6, 1e-3)
    np.testing.assert_allclose(spec.places, np.arange(1, 10).reshape(3, 3) * 1e-3, rtol=1e-15)
    assert (spec.corners, spec.reference_temperature, spec.increments) == ((2.0, 30.0), 20.0, True)
    assert (spec.id, spec.title) == ("own", "Own")


# --- errors by hand


def test_scale_misalignment_and_bias_by_hand():
    """Rows of the matrix make the reported axes: a transpose or a sign would show."""
    gyros = Triad(load_imu("ideal"), "gyro", 0, 100)
    matrix = [[1.001, 0.002, 0.0], [0.0, 1.0, -0.003], [0.0, 0.0, 0.9995]]
    gyros.errors = replace(gyros.errors, matrix=matrix, bias=[1e-4, 0.0, -2e-4])
    w = np.array([[0.1, 0.2, 0.3], [1.0, 0.0, 0.0]])
    reported, saturated = gyros.report(w.T, w.T, np.zeros(2), None)
    hand = [[0.1006, 0.1991, 0.29965], [1.0011, 0.0, -0.0002]]
    np.testing.assert_allclose(reported.T, hand, rtol=0, atol=ROUNDING)
    assert not saturated.any()


def test_scale_is_on_the_diagonal_and_misalignment_off_it():
    z = np.array([s.standard_normal() for s in streams(7, "gyro", "scale")])
    scaled = draw(replace(STILL, scale=1e-3), 7, "gyro")
    np.testing.assert_allclose(scaled.matrix, np.diag(1 + 1e-3 * z), rtol=0, atol=ROUNDING)
    assert not scaled.bias.any()
    turned = draw(replace(STILL, misalignment=1e-3), 7, "gyro").matrix - np.eye(3)
    np.testing.assert_array_equal(turned, -turned.T)  # the case turned: a small rotation
    skewed = draw(replace(STILL, non_orthogonality=1e-3), 7, "gyro").matrix - np.eye(3)
    np.testing.assert_array_equal(skewed, skewed.T)
    for matrix in (turned, skewed):
        off = matrix[np.triu_indices(3, 1)]
        assert len(set(np.abs(off))) == 3  # three small angles, each its own
        assert ((np.abs(off) > 0) & (np.abs(off) < 5e-3)).all()  # 5 sigma


def test_draws_have_the_stated_spread():
    """600 units: the variance of a sensor's draws lies within chi-square's bounds."""
    spec = TriadSpec(bias=2.0, scale=3e-4, misalignment=5e-4)
    units = [draw(spec, seed, "accel") for seed in range(600)]
    bias = np.array([u.bias for u in units])
    matrix = np.array([u.matrix for u in units]) - np.eye(3)
    # family of 9 sums, 1e-4 in all: two-sided bounds of 600 degrees of freedom
    low, high = chi2.ppf([0.5e-4 / 9, 1 - 0.5e-4 / 9], 600)
    for k in range(3):
        assert low < (bias[:, k] ** 2).sum() / 2.0**2 < high
        assert low < (matrix[:, k, k] ** 2).sum() / 3e-4**2 < high
    for i, k in ((0, 1), (0, 2), (1, 2)):
        assert low < (matrix[:, i, k] ** 2).sum() / 5e-4**2 < high


def test_ideal_reports_the_truth_bit_exactly():
    here = truth(257)
    reported = Imu(load_imu("ideal"), 5, 200).report(here)
    assert reported.w_ib_b.tobytes() == here.w_ib_b.tobytes()
    assert reported.f_b.tobytes() == here.f_b.tobytes()


# --- noise


@pytest.mark.parametrize("rate_hz", [1, 20, 1000])
def test_white_noise_has_the_stated_density(rate_hz):
    """Variance of a sample: density^2 times rate (ARW 0.15 deg/rt-h = 4.3633e-5 rad/s/rt-Hz)."""
    spec = load_imu("stim300")
    quiet = replace(
        spec,
        gyro=replace(STILL, noise=spec.gyro.noise),
        accel=replace(STILL, noise=spec.accel.noise),
    )
    n = 20_000
    still = replace(truth(n), w_ib_b=np.zeros((n, 3)), f_b=np.zeros((n, 3)))
    reported = Imu(quiet, 11, rate_hz).report(still)
    low, high = chi2.ppf([1e-6, 1 - 1e-6], n)
    for values, density in ((reported.w_ib_b, 4.3633231e-5), (reported.f_b, 4.0e-4)):
        sums = (values**2).sum(axis=0) / (density**2 * rate_hz)
        assert ((low < sums) & (sums < high)).all(), sums
        # white: neighbours and axes uncorrelated, 1/sqrt(n) each, 5 sigma
        ahead = (values[1:] * values[:-1]).mean(axis=0) / values.var(axis=0)
        assert (np.abs(ahead) < 5 / np.sqrt(n)).all()
        across = np.corrcoef(values.T)[[0, 0, 1], [1, 2, 2]]
        assert (np.abs(across) < 5 / np.sqrt(n)).all()
    both = np.corrcoef(reported.w_ib_b.T, reported.f_b.T)[:3, 3:]
    assert (np.abs(both) < 5 / np.sqrt(n)).all()


def test_sigmas_that_the_recording_states():
    """Of the samples, behind the low-pass: ``1 - 1/(2 a)`` of the variance of white noise.

    a = 2 pi 2.62/sqrt2 = 11.640 of the gyros, 2 pi 2.48/sqrt2 = 11.019 of the accelerometers.
    """
    imu = Imu(load_imu("stim300"), 0, 100)
    # exp(-11) (cos a - sin a), left out here, is 1e-5 at most, of 1/22
    assert imu.gyro_sigma == pytest.approx(4.3633231e-4 * 0.978287, rel=2e-6)
    assert imu.accel_sigma == pytest.approx(4.0e-3 * 0.977048, rel=2e-6)
    bare = switched_off(load_imu("stim300"), ["bandwidth"])
    assert Imu(bare, 0, 100).gyro_sigma == pytest.approx(4.3633231e-4, rel=1e-7)
    assert Imu(bare, 0, 100).accel_sigma == pytest.approx(4.0e-3, rel=1e-12)


SKEWED = ((0.9, 0.3, 0.0), (0.0, 0.8, 0.5), (0.2, 0.0, 1.0))


@pytest.mark.parametrize("bandwidth", [np.inf, 20.0])
@pytest.mark.parametrize("rounded", ["", "samples", "increments", "samples, of skewed axes"])
def test_variances_that_the_recording_states_are_those_of_its_samples(bandwidth, rounded):
    """At rest, in all channels: noise of 0.01, rounded to as much."""
    ideal, n = load_imu("ideal"), 4000
    steps = {"increment_lsb": 1e-4} if rounded == "increments" else {"resolution": 0.01}
    triad = TriadSpec(noise=1e-3, bandwidth=bandwidth, **(steps if rounded else {}))
    triad = replace(triad, axes=SKEWED if "skewed" in rounded else None)
    unit = replace(ideal, gyro=triad, accel=triad, increments=rounded == "increments")
    imu = Imu(unit, 5, 100)
    still = truth(n)
    still = replace(still, w_ib_b=np.full((n, 3), 0.0123), f_b=np.full((n, 3), -0.0457))
    seen = imu.report(still)
    for values, told in zip((seen.w_ib_b, seen.f_b), imu.variances, strict=True):
        # of 4000 samples, a filter's lasting for one or two: 4 sigma of sqrt(2 x 2 / 4000)
        assert values.var(axis=0) == pytest.approx(told, rel=0.13)


# --- streams


def joined(spec: ImuSpec, seed: int, here: TruthBlock, edges: list[int]) -> tuple[bytes, bytes]:
    """Bytes of rates and forces reported in blocks between `edges`."""
    unit = Imu(spec, seed, 100)
    parts = [unit.report(rows(here, a, b)) for a, b in pairwise(edges)]
    w, f = (np.concatenate([getattr(p, name) for p in parts]) for name in ("w_ib_b", "f_b"))
    return w.tobytes(), f.tobytes()


@settings(max_examples=20)
@given(st.lists(st.integers(1, 59), max_size=6), st.integers(0, 2**70))
def test_same_seed_same_bytes_whatever_the_blocks(cuts, seed):
    spec, here = load_imu("stim300"), truth(60)
    edges = sorted({0, 60, *cuts})
    assert joined(spec, seed, here, edges) == joined(spec, seed, here, [0, 60])


@pytest.mark.parametrize("name", ids("imus"))
def test_same_bytes_in_blocks_of_one_sample(name):
    spec, here = load_imu(name), truth(60)
    assert joined(spec, 3, here, list(range(61))) == joined(spec, 3, here, [0, 60])


def test_another_seed_is_another_unit():
    here, spec = truth(3), load_imu("ring-laser")
    one, two = Imu(spec, 1, 100), Imu(spec, 2, 100)
    assert not np.any(one.gyro_errors.bias == two.gyro_errors.bias)
    assert not np.any(one.report(here).w_ib_b == two.report(here).w_ib_b)


SOURCES = (
    *("bias", "scale", "misalignment", "noise", "instability", "random_walk", "ramp", "asymmetry"),
    *("nonlinearity", "non_orthogonality", "g_sensitivity", "g2_sensitivity", "second_order"),
    *("bias_temperature", "scale_temperature"),
)


def test_every_source_and_axis_has_its_own_stream():
    keys = [(s, e, axis) for s in ("gyro", "accel") for e in SOURCES for axis in range(3)]
    keys += [("clock", "clock_offset", 0), ("clock", "jitter", 0)]
    first = [stream(3, *key).standard_normal() for key in keys]
    assert len(set(first)) == len(keys)
    assert stream(3, "gyro", "bias", 0).standard_normal() == first[0]


def test_noise_does_not_touch_the_other_draws():
    spec = load_imu("stim300")
    plain, noisy = Imu(spec, 4, 100), Imu(with_gyro(spec, noise=1.0), 4, 100)
    for name in ("gyro_errors", "accel_errors"):
        a, b = getattr(plain, name), getattr(noisy, name)
        np.testing.assert_array_equal(a.bias, b.bias)
        np.testing.assert_array_equal(a.matrix, b.matrix)
    here = truth(5)
    first, second = plain.report(here), noisy.report(here)
    np.testing.assert_array_equal(first.f_b, second.f_b)
    assert not np.any(first.w_ib_b == second.w_ib_b)


def test_bias_does_not_touch_noise_or_scale():
    spec = replace(load_imu("ideal"), gyro=TriadSpec(bias=1e-3, scale=1e-3, noise=1e-4))
    off = with_gyro(spec, bias=0.0)
    here = truth(5)
    plain, without = Imu(spec, 4, 100), Imu(off, 4, 100)
    np.testing.assert_array_equal(plain.gyro_errors.matrix, without.gyro_errors.matrix)
    difference = plain.report(here).w_ib_b - without.report(here).w_ib_b
    np.testing.assert_allclose(
        difference, np.tile(plain.gyro_errors.bias, (5, 1)), rtol=0, atol=4 * np.finfo(float).eps
    )  # rates of up to 3 rad/s rounded twice


def test_drawn_errors_are_read_only():
    errors = Imu(load_imu("stim300"), 0, 100).gyro_errors
    with pytest.raises(ValueError, match="read-only"):
        errors.bias[0] = 0.0
    with pytest.raises(ValueError, match="read-only"):
        errors.matrix[0, 0] = 0.0
