"""The low-pass on continuous signals: closed forms of filter and averaging, aliases included."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.stats import chi2

from alignment import Site
from stand.imu import Imu, ImuSpec, TriadSpec, load_imu
from stand.imu.filter import LowPass, noise_innovations, noise_variance, slow_variance
from stand.motion.polynomial import Motion
from stand.physics.mjcf import load_model
from stand.physics.truth import Truth
from stand.samples import Sampling, Sensed

DEG = np.pi / 180
INNER = 5  # joint: its axis is level at zero angles, so that gravity turns in b
W0 = 10.0 ** np.arange(-4, 4.5, 0.5)  # times the sample interval


def unit(**triad: float) -> ImuSpec:
    ideal = load_imu("ideal")
    return replace(ideal, gyro=TriadSpec(**triad), accel=TriadSpec(**triad))


def butterworth(f: np.ndarray | float, bandwidth: float) -> np.ndarray:
    """The textbook's transfer function, written with its poles."""
    s, w0 = 2j * np.pi * np.asarray(f, dtype=float), 2 * np.pi * bandwidth
    pole = w0 * np.exp(3j * np.pi / 4)
    return w0**2 / ((s - pole) * (s - np.conj(pole)))


def of_mean(f: float, rate_hz: float) -> complex:
    """What a mean over the interval before its stamp makes of a sine."""
    return complex(np.sinc(f / rate_hz) * np.exp(-1j * np.pi * f / rate_hz))


# --- the truth through it


def turned_gravity(rate_hz: int, sampling: Sampling) -> Sensed:
    """The stand turns by 100 deg/s about a level axis for ten turns and a bit."""
    coefficients = np.zeros((2, 1, 6))
    coefficients[0, 0, INNER] = 100 * DEG
    motion = Motion(np.array([0.0, 37.0]), coefficients)
    edges = np.arange(36.5 * rate_hz + 1) / rate_hz
    stamps = np.round(edges[1:] * 1e9).astype(np.int64)
    return Truth(load_model(), Site(48.5 * DEG)).sensed(motion, edges, stamps, sampling)


def phasor(sensed: object) -> complex:
    """Complex amplitude of Y1's force over the last ten turns (36 s)."""
    t = sensed.t_ns * 1e-9
    late = t > 0.5
    turn = 100 * DEG * t[late]
    A = np.stack([np.cos(turn), np.sin(turn), np.ones_like(turn)], axis=1)
    (c, s, _), *_ = np.linalg.lstsq(A, sensed.f_b[late, 1])
    return complex(c, -s)


@pytest.mark.parametrize("rate_hz", [100, 200, 1000])
@pytest.mark.parametrize("bandwidth", [30.0, 262.0])
def test_gravity_turned_at_100_deg_s_keeps_its_amplitude(rate_hz, bandwidth):
    """|H| sinc of what is felt at each instant, and its phase; means of whom no end is told, too.

    Held over its samples, gravity lost ``a (1 - a) (w dt)^2 / 2``, a = lag / dt: 22 ppm at 200 Hz.
    """
    instants = turned_gravity(rate_hz, Sampling.INSTANT)
    means = turned_gravity(rate_hz, Sampling.MEAN)
    f = 100 / 360
    H, mean = complex(butterworth(f, bandwidth)), of_mean(f, rate_hz)
    felt = phasor(instants)
    assert abs(felt) == pytest.approx(9.809, abs=0.01)
    # the mean itself, without a filter, is as exact as quadrature: 1e-9 m/s^2
    assert abs(phasor(means) / felt / mean - 1) < 1e-9
    spec = unit(bandwidth=bandwidth)
    plain, alone = (Sensed(x.t_ns, x.w_ib_b, x.f_b) for x in (means, instants))
    for sensed, sampling, gain, late in (
        (means, Sampling.MEAN, H * mean, 1e-9),
        (plain, Sampling.MEAN, H * mean, 1e-9),
        # a parabola's slope at its end is off by (w dt)^2/12: of a lag of 0.86 ms 22 ns at 100 Hz
        (instants, Sampling.INSTANT, H, 3e-8),
        (alone, Sampling.INSTANT, H, 3e-8),
    ):
        got = phasor(Imu(spec, 0, rate_hz, sampling=sampling).report(sensed)) / felt / gain
        # asked for: 0.1 ppm. (w dt)^4/720 is 1.3e-10 at 100 Hz, the plain means' some ten of it
        assert abs(abs(got) - 1) < 5e-9
        assert abs(np.angle(got)) < late * 100 * DEG


@pytest.mark.parametrize("sampling", list(Sampling))
def test_at_rest_nothing_changes_to_the_bit(sampling):
    still = np.tile([[0.1], [-9.81], [3.3e-7]], 500)
    for bandwidth in (0.02, 30.0, 1e6):
        for ends in (None, still):
            assert (LowPass(bandwidth, 200, sampling).apply(still, ends) == still).all()


@pytest.mark.parametrize("w0", [1e-4, 1e-2, 1.0, 1e2, 1e4])
def test_a_ramp_against_its_closed_form(w0):
    """``t - (sqrt2/w0) (1 - exp(-a) cos a)``, a = w0 t/sqrt2, from rest; means of it by hand."""
    n = int(max(50, 30 / w0))
    edges = np.arange(n + 1.0)
    a = edges * w0 / np.sqrt(2)
    lag = np.sqrt(2) / w0
    # int exp(-a) cos a da = exp(-a) (sin a - cos a) / 2
    area = edges**2 / 2 - lag * edges + lag**2 * np.exp(-a) * (np.sin(a) - np.cos(a)) / 2
    u, ends = (np.tile(x, (3, 1)) for x in (edges[1:] - 0.5, edges[1:]))
    y = LowPass(w0 / (2 * np.pi), 1.0).apply(u, ends)[1]
    # area grows to n^2/2 and is good to 1e-16 of it; the filter remembers some 1/w0 roundings
    assert np.abs(y - np.diff(area)).max() < 1e-15 * n**2
    instants = LowPass(w0 / (2 * np.pi), 1.0, Sampling.INSTANT).apply(ends, u)[1]
    assert np.abs(instants - (edges - lag * (1 - np.exp(-a) * np.cos(a)))[1:]).max() < 1e-15 * n**2


def test_nothing_is_left_in_instants_of_a_move_that_is_over():
    """A rate of 0, 1, 0 at 0, 1, 2 s between straight lines, then nothing: what the filter keeps
    falls by exp(-w0/sqrt2) a sample. A mean guessed from samples before was 1/24 of it, 0.05 deg/s.
    """
    instants, means = np.zeros((2, 3, 9))
    instants[:, 2] = 1.0
    means[:, 2:4] = 0.5
    y = LowPass(8.0, 1.0, Sampling.INSTANT).apply(instants, means)[0]
    assert abs(y[4]) < np.exp(-16 * np.pi / np.sqrt(2))  # 4e-16; a lag of 28 ms of 1/s^2 before
    assert (np.abs(y[5:]) < 1e-30).all()


def sine_response(bandwidth: float, f: float, rate_hz: int, *, ends: bool) -> complex:
    """Complex gain over the instantaneous sine, of means with or without their ends."""
    n = int(rate_hz * 20 / bandwidth) + 4000  # e^-89 of the start is left
    edges = np.arange(n + 1) / rate_hz
    x = np.exp(2j * np.pi * f * edges)
    u = np.diff(x) * rate_hz / (2j * np.pi * f)
    parts = [
        LowPass(bandwidth, rate_hz).apply(
            np.tile(part(u), (3, 1)), np.tile(part(x[1:]), (3, 1)) if ends else None
        )[2]
        for part in (np.real, np.imag)
    ]
    return complex(np.mean((parts[0] + 1j * parts[1])[-1000:] / x[-1000:]))


@pytest.mark.parametrize("bandwidth", [5.0, 50.0, 262.0])
@pytest.mark.parametrize("part", [0.01, 0.05, 0.2, 0.4])
@pytest.mark.parametrize("rate_hz", [200, 2000])
def test_sine_gives_butterworth_times_sinc(bandwidth, part, rate_hz):
    """Of the continuous truth, not of what is held over a sample: no images of it."""
    f, turn = part * rate_hz, 2 * np.pi * part
    want = complex(butterworth(f, bandwidth)) * of_mean(f, rate_hz)
    known = sine_response(bandwidth, f, rate_hz, ends=True)
    alone = sine_response(bandwidth, f, rate_hz, ends=False)
    # of the sine itself; 1e-12: 4000 roundings
    assert abs(known - want) < turn**4 / 500 + 1e-12
    assert abs(alone - want) < turn**4 / 10 + 1e-12


# --- the noise through it


def covariances(w0: float, sampling: Sampling, lags: int) -> np.ndarray:
    """Of samples of unit white noise, filtered: closed forms, in units of density^2 times rate."""
    L, k = w0 * np.exp(3j * np.pi / 4), np.arange(1, lags + 1)
    if sampling is Sampling.INSTANT:
        a = np.arange(lags + 1) * w0 / np.sqrt(2)
        return w0 / np.sqrt(8) * np.exp(-a) * (np.cos(a) + np.sin(a))
    # int int of Re(q exp(L t)), q = -L/2, over two intervals that are k - 1 apart
    apart = -(np.expm1(L) ** 2 * np.exp((k - 1) * L) / L).real / 2
    return np.append(1 - (np.expm1(L) / L).real, apart)


@pytest.mark.parametrize("w0", [0.03, 1.0, 8.231])
def test_the_closed_forms_against_integrals(w0):
    """R(t) once and over the triangle of two intervals; and R(t) is |H|^2 of the frequencies."""

    def R(t: float) -> float:
        a = abs(t) * w0 / np.sqrt(2)
        return w0 / np.sqrt(8) * np.exp(-a) * (np.cos(a) + np.sin(a))

    def seen(f: float) -> float:
        return 2 * abs(butterworth(f, w0 / (2 * np.pi))) ** 2

    assert quad(seen, 0, np.inf)[0] == pytest.approx(R(0), rel=1e-6)
    for k, found in enumerate(covariances(w0, Sampling.MEAN, 2)):
        want = quad(lambda t, k=k: (1 - abs(t)) * R(t + k), -1, 1, points=[0], epsabs=1e-12)[0]
        assert found == pytest.approx(want, rel=1e-8, abs=1e-11)
    assert noise_variance(w0 / (2 * np.pi), 1.0) == pytest.approx(
        covariances(w0, Sampling.MEAN, 0)[0], rel=1e-12
    )


@pytest.mark.parametrize("sampling", list(Sampling))
@pytest.mark.parametrize("w0", W0)
def test_the_innovations_make_that_process(w0, sampling):
    """All covariances of it, whatever the bandwidth: one number per sample loses nothing."""
    one, factor = noise_innovations(w0, sampling), np.exp(w0 * np.exp(3j * np.pi / 4))
    S = one.start.T @ one.start  # of real and imaginary part
    kick = np.array([one.kick.real, one.kick.imag])
    turn = np.array([[factor.real, -factor.imag], [factor.imag, factor.real]])
    # stationary, but for roundings; below 1e-30 of a sample it is nothing
    size = S.max() + 1e-30 * one.direct**2
    np.testing.assert_allclose(turn @ S @ turn.T + np.outer(kick, kick), S, atol=1e-14 * size)
    found = [S[0, 0] + one.direct**2]
    state = turn @ S[:, 0] + kick * one.direct  # covariance of the state with the sample before it
    for _ in range(6):
        found.append(state[0])
        state = turn @ state
    want = covariances(w0, sampling, 6)
    # expm1 leaves 1e-16/w0 of the closed variance
    np.testing.assert_allclose(found, want, rtol=0, atol=want[0] * (1e-14 + 4e-16 / w0))


def test_stim300_by_hand():
    """262 Hz at 200 Hz: a = 2 pi 1.31/sqrt2 = 5.820, 1 - (1 - e^-a (cos a - sin a))/(2 a) = 0.914.

    An instant has w0/(2 sqrt2) = 2 pi 262/2.828 = 582 Hz of it, 2.91 times the rate.
    """
    assert noise_variance(262.0, 200) == pytest.approx(0.914, abs=5e-4)
    assert noise_variance(262.0, 200, Sampling.INSTANT) == pytest.approx(2.910, abs=1e-3)
    assert noise_variance(np.inf, 200) == 1.0
    spec = load_imu("stim300")
    # 0.15 deg/rt-h is 2.5e-3 deg/s/rt-Hz: 4.3633e-5 rad/s/rt-Hz, times root 200, root 0.914
    assert Imu(spec, 0, 200).gyro_sigma == pytest.approx(5.9006e-4, rel=3e-4)


def noise(bandwidth: float, rate_hz: int, sampling: Sampling, n: int) -> np.ndarray:
    """White noise of density one alone, (6, n)."""
    imu = Imu(unit(noise=1.0, bandwidth=bandwidth), 3, rate_hz, sampling=sampling)
    t_ns = np.arange(1, n + 1) * (1_000_000_000 // rate_hz)
    out = imu.report(Sensed(t_ns, np.zeros((n, 3)), np.zeros((n, 3))))
    return np.hstack([out.w_ib_b, out.f_b]).T


@pytest.mark.parametrize("sampling", list(Sampling))
@pytest.mark.parametrize("rate_hz", [100, 200, 1000])
@pytest.mark.parametrize("bandwidth", [40.0, 262.0])
def test_power_density_against_filter_and_averaging(rate_hz, bandwidth, sampling):
    """Sum over the images of |H|^2 sinc^2, or |H|^2, in 16 bands up to half the rate."""
    n = 2**16
    y = noise(bandwidth, rate_hz, sampling, n)
    power = (np.abs(np.fft.rfft(y)[:, 1 : n // 2]) ** 2).mean(axis=0) / n / rate_hz
    f = np.arange(1, n // 2) * rate_hz / n
    images = f[:, None] + rate_hz * np.arange(-60, 61)
    seen = np.abs(butterworth(images, bandwidth)) ** 2
    if sampling is Sampling.MEAN:
        seen *= np.sinc(images / rate_hz) ** 2
    ratio = power / seen.sum(axis=1)
    for band in np.array_split(ratio, 16):
        # 6 channels, exponential each; images beyond 60 rates: below 2e-4 of the least
        assert abs(band.mean() - 1) < 5 / np.sqrt(6 * len(band)) + 1e-3


def test_minus_three_decibel_where_the_sheet_says():
    """At 4000 Hz means and images do little: half the power at 262 Hz, and a 16th at twice it."""
    n, rate = 2**17, 4000
    y = noise(262.0, rate, Sampling.MEAN, n)
    power = (np.abs(np.fft.rfft(y)) ** 2).mean(axis=0) / n / rate
    f = np.arange(n // 2 + 1) * rate / n
    for at, want in ((5.0, 1.0), (262.0, 1 / 2), (524.0, 1 / 17)):
        own = np.abs(f - at) < 4.5
        # |H|^2 = 1/(1 + (f/262)^4); sinc^2 of 0.131 is 0.94; a band of 9 Hz bends by 1e-3
        told = want * np.sinc(at / rate) ** 2
        assert power[own].mean() == pytest.approx(told, rel=5 / np.sqrt(6 * own.sum()) + 5e-3)


@pytest.mark.parametrize("rate_hz", [100, 200, 1000])
def test_variance_and_covariance_of_neighbours(rate_hz):
    n = 200_000
    y = noise(262.0, rate_hz, Sampling.MEAN, n) / np.sqrt(rate_hz)
    variance, beside, after = covariances(2 * np.pi * 262 / rate_hz, Sampling.MEAN, 2)
    # of products of neighbours: Bartlett's formula, sums of squares of correlations below 2
    sigma = variance * np.sqrt(2 * (1 + 2 * (beside / variance) ** 2) / (6 * n))
    assert abs((y**2).mean() - variance) < 5 * sigma
    assert abs((y[:, 1:] * y[:, :-1]).mean() - beside) < 5 * sigma
    assert abs((y[:, 2:] * y[:, :-2]).mean() - after) < 5 * sigma


@pytest.mark.parametrize("sampling", list(Sampling))
def test_noise_begins_as_it_goes_on(sampling):
    """The very first sample of 200 units of a bandwidth of a 60th of the rate."""
    spec = unit(noise=1.0, bandwidth=3.0)
    t_ns, nothing = np.array([5_000_000]), np.zeros((1, 3))
    out = [Imu(spec, s, 200, sampling=sampling) for s in range(200)]
    first = [imu.report(Sensed(t_ns, nothing, nothing)) for imu in out]
    squares = sum((b.w_ib_b**2).sum() + (b.f_b**2).sum() for b in first) / out[0].gyro_sigma ** 2
    low, high = chi2.ppf([1e-6, 1 - 1e-6], 1200)
    assert low < squares < high


# --- blocks


def told_ends(n: int) -> tuple[np.ndarray, ...]:
    rng = np.random.default_rng(4)
    return tuple(rng.normal(size=(4, n, 3)))


@pytest.mark.parametrize("sampling", list(Sampling))
@pytest.mark.parametrize("known", [False, True])
@settings(max_examples=15)
@given(cuts=st.sets(st.integers(1, 599), max_size=12))
def test_the_same_bits_wherever_it_is_cut(sampling, known, cuts):
    w, f, w_end, f_end = told_ends(600)
    t_ns = np.arange(1, 601) * 5_000_000

    def report(edges: list[int]) -> bytes:
        imu = Imu(unit(noise=1e-2, bandwidth=30.0), 1, 200, sampling=sampling)
        out = []
        for a, b in pairwise(edges):
            ends = (w_end[a:b], f_end[a:b]) if known else ()
            out.append(imu.report(Sensed(t_ns[a:b], w[a:b], f[a:b], *ends)))
        return np.concatenate([np.hstack([o.w_ib_b, o.f_b]) for o in out]).tobytes()

    assert report([0, *sorted(cuts), 600]) == report([0, 600])


@pytest.mark.parametrize("known", [False, True])
def test_its_state_is_all_that_it_remembers(known):
    w, _, ends, normals = (x.T for x in told_ends(300))

    def fed(one: LowPass, a: int, b: int) -> np.ndarray:
        return one.apply(w[:, a:b], ends[:, a:b] if known else None, normals[:, a:b])

    whole, other = (LowPass(30.0, 200, Sampling.MEAN, 0.1, np.ones((3, 2))) for _ in range(2))
    fed(whole, 0, 200)
    kept = whole.state
    assert kept.shape == (3, 6)
    expected = fed(whole, 200, 300)
    other.state = kept
    assert fed(other, 200, 300).tobytes() == expected.tobytes()


@pytest.mark.parametrize(("bandwidth", "rate"), [(262.0, 20.0), (262.0, 200.0), (50.0, 7.0)])
def test_instants_fold_what_is_above_half_of_their_rate_into_their_mean(bandwidth, rate):
    """Every alias: ``sum_k |H(k f)|^2`` of Butterworth's ``1/(1 + (k f/bandwidth)^4)``."""
    k = np.arange(-20000, 20001)
    by_hand = np.sum(1 / (1 + (k * rate / bandwidth) ** 4))
    # what is left out falls with the cube of the number of aliases
    assert slow_variance(bandwidth, rate, Sampling.INSTANT) == pytest.approx(by_hand, rel=1e-9)
    assert slow_variance(bandwidth, rate, Sampling.MEAN) == 1.0
    assert slow_variance(np.inf, rate, Sampling.INSTANT) == 1.0
