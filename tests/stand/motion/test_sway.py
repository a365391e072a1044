"""Sway and vibration: variance, spectrum, Gaussianity and independence within chance; refusals."""

import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stand.errors import StandError
from stand.motion.polynomial import Motion
from stand.motion.sway import sway, vibration
from stand.procedure.steps import SwayMotion, VibrationMotion
from stand.table.joints import JOINTS

DEG = np.pi / 180
HERE = Path()
F0, DAMPING, RMS = 0.5, 0.1, 2.0
CUTOFF = 5 * F0


def rng_of(seed):
    return lambda axis: np.random.default_rng([seed, JOINTS.index(axis)])


def entry(**axes) -> SwayMotion:
    return SwayMotion.model_validate({"axes": axes})


def resonant(**other) -> dict:
    return {"rms_deg": RMS, "frequency_hz": F0, "damping": DAMPING} | other


def shape(f):
    """The resonance's density, unscaled, from its transfer function 1 / (s^2 + 2 d w0 s + w0^2)."""
    s = 2j * np.pi * f
    w0 = 2 * np.pi * F0
    return np.abs(1 / (s * s + 2 * DAMPING * w0 * s + w0**2)) ** 2


def steady(motion: Motion, lead: float, length: float, rate: float, column: int = 0):
    """Angles (n, 6) [deg] of the part at full size, or its rates or accelerations."""
    t = lead + np.arange(round(length * rate)) / rate
    return motion.joints(t)[column] / DEG


RUNS, LENGTH, LEAD, RATE = 24, 400.0, 4.0, 16.0
SEEDS = range(100, 100 + RUNS)
# Correlation R = exp(-a t) cos(w t), a = 2 pi d f0. A mean square over T has variance
# 2 sigma^4 (integral of R^2) / T = sigma^4 / (a T): as of 2 a T independent draws. So have
# products of two such series; fourth powers forget faster, by R^4: 16/3 a T draws.
DRAWS = 2 * 2 * np.pi * DAMPING * F0 * LENGTH


@pytest.fixture(scope="module")
def many() -> np.ndarray:
    """Angles (runs, n, 2) [deg] of two axes alike in `RUNS` seeds."""
    both = entry(base_roll=resonant(), inner=resonant())
    runs = [
        steady(sway(both, LENGTH, LEAD, rng_of(seed), HERE), LEAD, LENGTH, RATE)[:, [0, 5]]
        for seed in SEEDS
    ]
    return np.array(runs)


def test_variance_is_as_stated(many):
    each = (many**2).mean(axis=1) / RMS**2
    sigma = np.sqrt(2 / DRAWS)
    assert each.mean() == pytest.approx(1.0, abs=4 * sigma / np.sqrt(each.size))
    assert np.abs(each - 1).max() < 4.5 * sigma  # of 48; a chi-square of 250 leans a little
    # they differ as chance has it: chi-square of 47, which varies by sqrt(2 / 47) = 0.21
    assert each.var(ddof=1) / sigma**2 == pytest.approx(1.0, abs=4 * 0.21)


def test_mean_is_zero_within_chance(many):
    means = many.mean(axis=1).ravel()
    fine = np.linspace(0, CUTOFF, 100001)
    density = RMS**2 * shape(0.0) / np.trapezoid(shape(fine), fine)
    # of a mean over T: density at 0 over 2 T. The series has twice the length and no bin at 0,
    # the first one has 1.5 bins' power: (1.5 sinc^2(1/2) + sinc^2(3/2) + ...) / 1 = 0.70 of it
    chi2 = (means**2).sum() / (0.70 * density / 2 / LENGTH)
    n = means.size
    assert chi2 == pytest.approx(n, abs=4 * np.sqrt(2 * n))
    assert abs(means.sum()) < 4 * np.sqrt((means**2).sum())


def test_spectrum_is_the_resonance_within_chance(many):
    n = many.shape[1]
    window = np.hanning(n)
    spectra = np.abs(np.fft.rfft(many * window[:, None], axis=1)) ** 2
    f = np.fft.rfftfreq(n, 1 / RATE)
    density = 2 * spectra.mean(axis=(0, 2)) / (RATE * (window**2).sum())
    fine = np.linspace(0, CUTOFF, 100001)
    exact = RMS**2 * shape(f) / np.trapezoid(shape(fine), fine)
    inside = (f > 0.05) & (f < CUTOFF - 0.02)
    # Bands of 16 bins, whose powers a Hann window correlates by 4/9 and 1/36 with the next two:
    # as of 8.5 independent ones, of 48 spectra. Curvature of the density under the window adds
    # 1e-3 (a bin is 1/40 of the resonance's width).
    ratio = density[inside] / exact[inside]
    bands = ratio[: len(ratio) // 16 * 16].reshape(-1, 16).mean(axis=1)
    chi = (bands - 1) * np.sqrt(8.5 * 48)
    assert np.abs(chi).max() < 4.2  # of 60 bands
    assert (chi**2).mean() == pytest.approx(1.0, abs=4 * np.sqrt(2 / len(chi)))
    beyond = (f > CUTOFF + 0.02) & (f < RATE / 2)
    assert density[beyond].max() < 1e-6 * exact[inside].min()


def test_angles_are_gaussian(many):
    x = many.reshape(-1) / many.std()
    draws = many.shape[0] * 2 * DRAWS
    # of n independent draws skewness varies by 6 / n, kurtosis by 24 / n
    assert abs((x**3).mean()) < 4 * np.sqrt(6 / draws)
    assert abs((x**4).mean() - 3) < 4 * np.sqrt(24 / (8 / 3 * draws))
    # 4.55 % lie beyond two sigma; of n draws that varies by sqrt(0.0455 * 0.9545 / n)
    assert (np.abs(x) > 2).mean() == pytest.approx(0.0455, abs=4 * 0.208 / np.sqrt(draws))


def test_axes_and_runs_are_independent(many):
    series = np.concatenate([many[:, :, 0], many[:, :, 1]])
    correlation = np.corrcoef(series) - np.eye(len(series))
    pairs = correlation[np.triu_indices(len(series), 1)]
    assert np.abs(pairs).max() < 4.8 / np.sqrt(DRAWS)  # of 1128 pairs
    assert pairs.std() == pytest.approx(1 / np.sqrt(DRAWS), rel=4 / np.sqrt(2 * 1128))


def test_halves_of_a_run_differ(many):
    half = many.shape[1] // 2
    for run in many:
        r = np.corrcoef(run[:half, 0], run[half:, 0])[0, 1]
        assert abs(r) < 4.5 / np.sqrt(DRAWS / 2)


def test_the_seed_says_all():
    both = entry(base_roll=resonant(), inner=resonant())
    one, same, other = (sway(both, 30.0, 4.0, rng_of(s), HERE) for s in (1, 1, 2))
    np.testing.assert_array_equal(one.coefficients, same.coefficients)
    assert np.abs(one.coefficients[-1] - other.coefficients[-1]).max() > 0.5 * DEG
    swapped = sway(entry(inner=resonant(), base_roll=resonant()), 30.0, 4.0, rng_of(1), HERE)
    np.testing.assert_array_equal(one.coefficients, swapped.coefficients)


@given(
    st.floats(0.02, 20), st.floats(1e-3, 10), st.floats(0.1, 20), st.floats(0.02, 10),
    st.integers(0, 100)
)  # fmt: skip
def test_any_sway_rests_at_both_ends_exactly(frequency, damping, length, lead, seed):
    axis = {"rms_deg": 1.0, "frequency_hz": frequency, "damping": damping}
    try:
        motion = sway(entry(outer=axis), length, lead, rng_of(seed), HERE)
    except StandError as error:
        assert "steps, allowed" in str(error)  # noqa: PT017
        return
    assert motion.start == 0.0
    assert motion.duration == pytest.approx(length + 2 * lead, rel=1e-14)
    angle, rate, acceleration = motion.joints([0.0, motion.duration])
    assert not angle.any()
    assert not rate[0].any()
    assert not acceleration[0].any()
    # the last piece ends in polynomials of weights that are zero: exactly too
    assert not rate[1].any()
    assert not acceleration[1].any()
    assert np.abs(motion.coefficients[-1, :, 3]).max() < 10 * DEG  # 10 sigma
    assert not motion.coefficients[:, :, [0, 1, 2, 4, 5]].any()


def test_it_is_at_full_size_from_the_lead_on():
    # the same weights under another fade: equal wherever both are at full size
    axis = entry(outer=resonant())
    short = sway(axis, 92.0, 4.0, rng_of(3), HERE)
    long = sway(axis, 80.0, 10.0, rng_of(3), HERE)
    t = np.linspace(10, 90, 1001)
    np.testing.assert_allclose(short.joints(t)[0], long.joints(t)[0], rtol=0, atol=1e-14)
    assert np.abs(short.joints([5.0])[0] - long.joints([5.0])[0]).max() > 1e-6


def test_sampling_hardly_colours_the_acceleration():
    # at 4 steps per period of the cutoff images have 1/3^10 + 1/5^10 = 1.70e-5 of its acceleration,
    # of slower waves less
    motion = sway(entry(outer=resonant()), 400.0, 4.0, rng_of(5), HERE)
    x = steady(motion, 4.0, 400.0, 320.0, column=2)[:, 3]
    spectrum = np.abs(np.fft.rfft(x * np.hanning(len(x)))) ** 2
    f = np.fft.rfftfreq(len(x), 1 / 320.0)
    images = spectrum[f > 1.5 * CUTOFF].sum() / spectrum[f < CUTOFF].sum()
    assert images < (1.04e-5) ** 2


def test_axes_of_very_different_speeds_go_together():
    axes = entry(
        base_yaw={"rms_deg": 5.0, "frequency_hz": 0.01, "damping": 0.3},
        inner={"rms_deg": 0.1, "frequency_hz": 5.0, "damping": 0.05},
    )
    mean_squares = np.zeros(2)
    for seed in range(20):
        motion = sway(axes, 100.0, 10.0, rng_of(seed), HERE)
        x = steady(motion, 10.0, 100.0, 50.0)[:, [2, 5]]
        mean_squares += (x**2).mean(axis=0) / 20
    # 2 a T draws of every run, as above: 2 * 2 pi 0.3 * 0.01 * 100 = 3.8 and 314
    np.testing.assert_allclose(mean_squares, [25, 0.01], rtol=4 * np.sqrt(2 / 75))
    assert mean_squares[1] == pytest.approx(0.01, rel=4 * np.sqrt(2 / 6280))


def test_motions_too_long_or_too_wide_are_refused_in_one_line():
    fast = entry(outer={"rms_deg": 0.1, "frequency_hz": 40.0})
    with pytest.raises(
        StandError,
        match=r"^3604 s with frequencies up to 200 Hz, faded in 2 s, "
        r"are 2883200 steps, allowed 1000000$",
    ):
        sway(fast, 3600.0, 2.0, rng_of(1), HERE)
    wide = entry(
        outer={"rms_deg": 0.1, "frequency_hz": 40.0}, inner={"rms_deg": 1.0, "frequency_hz": 1e-4}
    )
    with pytest.raises(
        StandError,
        match=r"^frequencies from 0\.0001 to 200 Hz: too far apart .* "
        r"ratio of 250000; make two of it$",
    ):
        sway(wide, 10.0, 2.0, rng_of(1), HERE)


# --------------------------------------------------------------------------------- vibration


def jitter(**axes) -> VibrationMotion:
    return VibrationMotion.model_validate({"axes": axes})


def test_vibration_has_its_rms_and_band():
    band = {"rms_deg_s2": 20.0, "low_hz": 5.0, "high_hz": 50.0}
    rate, length = 2000.0, 60.0
    spectra, mean_square = [], []
    for seed in range(8):
        motion = vibration(jitter(base_roll=band), length, 2.0, rng_of(seed))
        x = steady(motion, 2.0, length, rate, column=2)[:, 0]
        mean_square.append((x**2).mean())
        segments = x.reshape(60, -1) * np.hanning(round(rate))
        spectra.append(np.abs(np.fft.rfft(segments)) ** 2)
    # white in 45 Hz: 2 * 45 draws a second
    draws = 8 * length * 90
    assert np.mean(mean_square) == pytest.approx(400.0, rel=4 * np.sqrt(2 / draws))
    window = np.hanning(round(rate))
    density = 2 * np.mean(spectra, axis=(0, 1)) / (rate * (window**2).sum())
    f = np.fft.rfftfreq(round(rate), 1 / rate)
    inside = (f > 7.5) & (f < 47.5)
    # 400 / 45 deg^2/s^4/Hz, each bin of 480 segments
    chi = (density[inside] / (400 / 45) - 1) * np.sqrt(480)
    assert np.abs(chi).max() < 4
    # Hann's side lobes three bins away
    assert density[(f < 2.5) | ((f > 52.5) & (f < 300))].max() < 1e-4 * 400 / 45
    # the images about the sampling rate of 200 Hz: (1/3)^10 + (1/5)^10 = 1.7e-5 of the amplitude
    assert density[f > 145].max() < (1.7e-5) ** 2 * 400 / 45 * 1.5


def test_vibration_turns_by_what_its_density_says():
    # the angle's variance is that of acceleration / w^4 over the band, by hand:
    # A / (2 pi)^4 (1/low^3 - 1/high^3) / 3, A = 400 / 45
    band = {"rms_deg_s2": 20.0, "low_hz": 5.0, "high_hz": 50.0}
    exact = 400 / 45 / (2 * np.pi) ** 4 * (1 / 125 - 1 / 125000) / 3
    runs = [vibration(jitter(outer=band), 60.0, 2.0, rng_of(s)) for s in range(8)]
    got = np.mean([(steady(m, 2.0, 60.0, 400.0)[:, 3] ** 2).mean() for m in runs])
    # the angle lives in the lowest 2 Hz: about 4 draws a second
    assert got == pytest.approx(exact, rel=4 * np.sqrt(2 / (8 * 60 * 4)))
    assert all(not m.joints([0.0, 64.0])[1].any() for m in runs)


def test_long_vibration_needs_little_more_memory_than_its_polynomials():
    band = {"rms_deg_s2": 5.0, "low_hz": 5.0, "high_hz": 100.0}
    tracemalloc.start()
    motion = vibration(jitter(outer=band), 120.0, 2.0, rng_of(1))
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    # 72 coefficients a step; weights, knots and transforms are some 16 numbers more
    assert motion.coefficients.nbytes == 72 * 8 * 124 * 400
    assert peak < 1.6 * motion.coefficients.nbytes


# ------------------------------------------------------------------------------ density file

TRAPEZOID = """# measured at the berth
frequency_hz, density_deg2_hz
0.1, 0.0
0.3, 10.0
# a gap of the instrument

0.5, 10.0
1.0, 0.0
"""


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "berth.csv").write_text(TRAPEZOID, encoding="utf-8")
    return tmp_path


def test_a_density_file_gives_its_own_variance_and_shape(folder):
    axis = entry(base_pitch={"psd_file": "berth.csv"})
    rate, runs = 8.0, 20
    x = np.array(
        [
            steady(sway(axis, 400.0, 4.0, rng_of(s), folder), 4.0, 400.0, rate)[:, 1]
            for s in range(runs)
        ]
    )
    # area by hand: 0.2 * 10 / 2 + 0.2 * 10 + 0.5 * 10 / 2 = 5.5 deg^2; about 1 Hz wide
    assert (x**2).mean() == pytest.approx(5.5, rel=4 * np.sqrt(2 / (runs * 400)))
    segments = x.reshape(runs * 4, -1) * np.hanning(800)
    density = (
        2
        * (np.abs(np.fft.rfft(segments)) ** 2).mean(axis=0)
        / (rate * (np.hanning(800) ** 2).sum())
    )
    f = np.fft.rfftfreq(800, 1 / rate)
    exact = np.interp(f, [0.1, 0.3, 0.5, 1.0], [0, 10, 10, 0], left=0, right=0)
    # 80 segments; corners of the trapezoid spread over two bins
    assert np.abs(density - exact).max() < 4.5 * 10 / np.sqrt(80)
    away = (f < 0.07) | (f > 1.03)
    assert density[away].max() < 1e-3


def test_a_density_file_is_scaled_to_an_rms(folder):
    axis = entry(base_pitch={"psd_file": "berth.csv", "rms_deg": 0.5})
    plain = entry(base_pitch={"psd_file": "berth.csv"})
    scaled = sway(axis, 50.0, 4.0, rng_of(1), folder)
    full = sway(plain, 50.0, 4.0, rng_of(1), folder)
    expected = full.coefficients[-1] * (0.5 / np.sqrt(5.5))
    np.testing.assert_allclose(scaled.coefficients[-1], expected, rtol=0, atol=1e-15)  # rounding


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "berth.csv: has no row of numbers"),
        ("0.1, 1\n", "berth.csv: has one row, must have two or more"),
        ("f, g\n0.1, 1\n0.2, 1\n", "berth.csv: must have two columns: frequency_hz, density_deg2"),
        ("0.1\n0.2\n", "berth.csv: must have two columns"),
        ("0.1, 1\n0.2, x\n", "berth.csv: line 2, column 2 = 'x': must be a finite number"),
        ("0.1, 1\n0.2, nan\n", "berth.csv: line 2, column 2 = 'nan': must be a finite number"),
        ("0.1, 1\n0.2, 1, 3\n", "berth.csv: line 2: has 3 values, must have 2"),
        ("-0.1, 1\n0.2, 1\n", "line 1, frequency_hz = -0.1: must be from 0 to 1000"),
        ("0.1, 1\n0.1, 1\n", "line 2, frequency_hz = 0.1: must increase from row to row, by 1e-6"),
        ("#c\n0.1, 1\n\n0.2, -1\n", "line 4, density_deg2_hz = -1: must not be negative"),
        ("0.1, 0\n0.2, 0\n", "berth.csv: rms = 0 deg: must be 1e-09 to 180"),
        ("0.1, 1e8\n0.2, 1e8\n", "berth.csv: rms = 3162.28 deg: must be 1e-09 to 180"),
        (b"\xff\xfe0", "berth.csv: not UTF-8 text"),
    ],
)
def test_density_files_that_are_not_right(tmp_path, text, message):
    path = tmp_path / "berth.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(StandError) as caught:
        sway(entry(outer={"psd_file": "berth.csv"}), 10.0, 4.0, rng_of(1), tmp_path)
    assert message in str(caught.value)
    assert str(caught.value).startswith("berth.csv: ")


@pytest.mark.parametrize(
    ("rows", "allowed"),
    [
        (((0, 1), (5, 1)), True),
        (((0.1, 0), (0.100001, 9e8), (0.100002, 1e9)), True),  # 1e-6 Hz apart, as dense as may be
        (((0.1, 0), (0.1000009, 1)), False),
        (((0.1, 0), (0.100001, 1.01e9)), False),
        (((1, 1), (1000.1, 1)), False),
        (((1, 180**2), (2, 180**2)), True),  # 180 deg rms
        (((1, 180.1**2), (2, 180.1**2)), False),
    ],
)
def test_the_ends_of_what_a_density_may_be(tmp_path, rows, allowed):
    (tmp_path / "a.csv").write_text("".join(f"{f!r}, {d!r}\n" for f, d in rows), encoding="utf-8")
    axis = entry(outer={"psd_file": "a.csv"})
    if allowed:
        assert np.isfinite(sway(axis, 2.0, 1.0, rng_of(1), tmp_path).coefficients).all()
    else:
        with pytest.raises(StandError, match=r"^a\.csv: "):
            sway(axis, 2.0, 1.0, rng_of(1), tmp_path)


def test_a_density_file_that_is_not_there(tmp_path):
    with pytest.raises(StandError, match=r"^no\.csv: cannot read this file: No such file"):
        sway(entry(outer={"psd_file": "no.csv"}), 10.0, 4.0, rng_of(1), tmp_path)


def test_keys_of_a_resonance_do_not_stand_beside_a_file():
    with pytest.raises(ValueError, match="cutoff_hz: must not stand beside psd_file"):
        entry(outer={"psd_file": "a.csv", "cutoff_hz": 3.0})
    with pytest.raises(ValueError, match="damping: must not stand beside psd_file"):
        entry(outer={"psd_file": "a.csv", "damping": 0.3})


@given(st.text(alphabet="0123456789.,-+e# \nfrequncy_hzdsti2\t\"'", max_size=60))
def test_any_text_is_a_spectrum_or_one_line(tmp_path_factory, text):
    folder = tmp_path_factory.mktemp("psd", numbered=True)
    (folder / "a.csv").write_text(text, encoding="utf-8")
    try:
        sway(entry(outer={"psd_file": "a.csv"}), 2.0, 1.0, rng_of(1), folder)
    except StandError as error:
        assert "\n" not in str(error)  # noqa: PT017
