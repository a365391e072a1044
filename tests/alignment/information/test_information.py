"""Fisher information: floors, closed forms, an exact model differenced, chance, words."""

from itertools import product
from math import cos, degrees, pi, sin, sqrt, tan

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from alignment import Priors, Site
from alignment.errors import AlignmentError, TooShort
from alignment.information import (
    GaussMarkov,
    InstrumentErrors,
    Setting,
    Stretch,
    TriadErrors,
    assumed,
    information,
)
from alignment.information.drift import (
    Span,
    flicker,
    gauss_markov,
    ramp_coefficients,
    random_walk,
    sum_covariance,
)
from alignment.methods.carousel import carousel_attitude
from alignment.methods.harmonics import TurningVector
from alignment.methods.position_fit import fit_positions, predicted_covariance
from stand.imu.model import Imu
from stand.imu.model import without as without_terms
from stand.imu.preset import load_imu
from stand.imu.processes import Drift, plateau
from stand.samples import Sensed

W = 7.292115e-5  # rad/s
DEG = pi / 180
DEG_H = DEG / 3600
DEG_RT_H = DEG / 60  # rad/sqrt(s)
MINUTE = DEG / 60
MILLI_G = 9.80665e-3
N, E, D = np.eye(3)
LEVEL = Rotation.from_matrix(np.column_stack([N, -D, E]))  # X1 north, Y1 up, Z1 east
LATITUDES = [48.5, -33.0]
T = 600.0  # s of readings in all
ARW = 0.01 * DEG_RT_H
FINE = 1e-5  # m/s^2/sqrt(Hz): accelerometers whose noise hardly counts


def headed(heading, roll=0.0, pitch=0.0):
    """Attitude by heading, pitch, roll [deg]: turns about down, east, north of a level b."""
    return Rotation.from_euler("ZYX", [heading, pitch, roll], degrees=True) * LEVEL


def rests(*angles, axis=(0, 1, 0), total=T, gap=10.0):
    """Rests of `total` seconds in all at angles [deg] about an axis of b."""
    length = total / len(angles)
    return [
        Stretch(
            f"{a:g}", k * (length + gap), length, Rotation.from_rotvec(a * DEG * np.array(axis))
        )
        for k, a in enumerate(angles)
    ]


def carousel(*rates, turns=3, tilt=0.0, start=0.0):
    """Whole turns about Y1 (leaning toward X1 by `tilt` [deg]) at rates [deg/s]."""
    axis = np.array([sin(tilt * DEG), cos(tilt * DEG), 0.0])
    found = []
    for rate in rates:
        length = turns * 360 / abs(rate)
        found.append(
            Stretch(f"{rate:+g} deg/s", start, length, Rotation.identity(), rate * DEG, axis, 0.4)
        )
        start += length + 20
    return found


# the six positions [S0]: Y1 up, Y1 down, X1 up, X1 down, Z1 up, Z1 down from a level b
SIX = [
    Stretch(f"p{k}", 110.0 * k, 100.0, Rotation.from_euler("XYZ", angles, degrees=True))
    for k, angles in enumerate(
        [(0, 0, 0), (180, 0, 0), (0, 0, 90), (0, 0, -90), (90, 0, 0), (-90, 0, 0)]
    )
]
ALL_UNKNOWN = InstrumentErrors(TriadErrors(ARW, np.inf), TriadErrors(FINE, np.inf))


def floor(latitude, arw=ARW, total=T):
    return arw / (W * cos(latitude * DEG) * sqrt(total))


# --- floors --------------------------------------------------------------------------------------


@pytest.mark.parametrize(("latitude", "heading"), list(product(LATITUDES, [0.0, 30.0, 217.0])))
def test_floors(latitude, heading):
    """methods.md section 2: ARW/(W cos lat sqrt T) with two horizontal gyros, one: sqrt 2 times it.

    What else is in sigma: 1e-12 rad/s of rounding beside 1e-7, squared 7e-11; tilt by the
    accelerometers' noise, tan(lat) 4e-8 rad beside 2.5e-3, squared 4e-10; half of each.
    """
    site, C = Site(latitude * DEG), headed(heading)
    known = InstrumentErrors(TriadErrors(ARW), TriadErrors(FINE))
    one_gyro = InstrumentErrors(
        TriadErrors([ARW, np.inf, np.inf], np.inf), TriadErrors(FINE, np.inf)
    )
    cases = [
        (rests(0), known, 1.0),
        (rests(0, 180), ALL_UNKNOWN, 1.0),
        (rests(0, 90, 180, 270), ALL_UNKNOWN, 1.0),
        (rests(0, 90, 180, 270), one_gyro, sqrt(2)),
        (carousel(1.8), ALL_UNKNOWN, 1.0),
        (carousel(-1.8), one_gyro, sqrt(2)),
    ]
    for stretches, unit, factor in cases:
        predicted = information(stretches, C, site, unit).sigma("heading")
        assert predicted == pytest.approx(factor * floor(latitude), rel=1e-9)


def test_sensitivities_alone_cost_no_decomposition(monkeypatch):
    """Who asks for them alone, as a prediction of a given gain does, pays for none of it."""
    site = Site(48.5 * DEG)
    monkeypatch.setattr(np.linalg, "svd", None)
    monkeypatch.setattr(np.linalg, "cholesky", None)
    found = information(rests(0, 180), headed(75), site, ALL_UNKNOWN)
    assert found.J.shape == (12, len(found.parameters))
    with pytest.raises(TypeError):
        _ = found.root


def test_a_floor_by_hand():
    """0.01 deg/rt-h over 600 s at 48.5 deg: 0.01/sqrt(1/6) = 0.0244949 deg/h of 9.96651 deg/h."""
    site = Site(48.5 * DEG)
    found = information(rests(0, 180), headed(75), site, ALL_UNKNOWN)
    # the numbers on the right have six digits
    assert found.sigma("heading") == pytest.approx(0.0244949 / 9.96651, rel=2e-6)


@pytest.mark.parametrize("east", [90.0, 60.0])
def test_one_gyro_measures_the_sine_of_its_angle_from_north(east):
    unit = InstrumentErrors(TriadErrors([ARW, np.inf, np.inf]), TriadErrors(FINE))
    found = information(rests(0), headed(east), Site(48.5 * DEG), unit)
    assert found.sigma("heading") == pytest.approx(floor(48.5) / sin(east * DEG), rel=1e-9)


def test_levels_by_accelerometer_and_gyro_noise():
    """Heading north: roll by accelerometers alone, pitch by gyros too, heading by tan(lat) roll.

    East gyro: ``W cos lat psi - W sin lat roll``: roll comes from Z1's specific force only. Pitch
    moves W across both other gyros: ``1/sigma^2 = T (g^2/VRW^2 + W^2/ARW^2)``.
    """
    vrw, arw = 1e-3, 1e-4 * DEG_RT_H
    gravity = 9.8093587  # by hand, 8 digits: methods.md section 0
    found = information(
        rests(0), headed(0), Site(48.5 * DEG), InstrumentErrors(TriadErrors(arw), TriadErrors(vrw))
    )
    roll = vrw / gravity / sqrt(T)
    assert found.sigma("roll") == pytest.approx(roll, rel=1e-8)
    pitch = 1 / sqrt(T * ((gravity / vrw) ** 2 + (W / arw) ** 2))
    # 1e-12 rad/s of rounding beside 1e-9 of noise, and gravity's digits
    assert found.sigma("pitch") == pytest.approx(pitch, rel=1e-6)
    expected = np.hypot(floor(48.5, arw), tan(48.5 * DEG) * roll)
    assert found.sigma("heading") == pytest.approx(expected, rel=1e-6)


def markov_avar(tau, time):
    """Allan variance of a Gauss-Markov process of variance one, IEEE Std 952 eq. C.22."""
    x = tau / time
    return 2 / x * (1 - (3 - 4 * np.exp(-x) + np.exp(-2 * x)) / (2 * x))


def test_an_instability_has_its_plateau():
    """Least Allan deviation between 10 and 1000 s: what was asked; nowhere there 10 % above it."""
    tau = np.geomspace(19, 1900, 100)
    adev = np.sqrt(sum(one.sigma**2 * markov_avar(tau, one.time) for one in flicker(3.0)))
    assert adev.min() == pytest.approx(3.0, rel=1e-4)
    assert adev.max() < 3.3
    assert flicker(0.0) == ()


@pytest.mark.parametrize("time", [3.0, 100.0, 5000.0])
def test_drift_of_a_half_turn_is_the_allan_deviation(time):
    """ADEV(T/2)/(sqrt 2 W cos lat) covers white noise and drift at once; no gap between rests."""
    sigma = 0.05 * DEG_H
    unit = InstrumentErrors(
        TriadErrors(ARW, np.inf, drift=(GaussMarkov(sigma, time),)),
        TriadErrors(FINE, np.inf),
    )
    found = information(rests(0, 180, gap=0.0), headed(20), Site(48.5 * DEG), unit)
    adev = sqrt(ARW**2 / (T / 2) + sigma**2 * markov_avar(T / 2, time))
    assert found.sigma("heading") == pytest.approx(
        adev / (sqrt(2) * W * cos(48.5 * DEG)),
        rel=1e-8,  # the Allan variance by hand cancels two digits
    )


# --- the exact model, differenced ----------------------------------------------------------------

SAMPLES = 720  # of a turn


def exact(stretches, C_np, latitude, gravity, errors):
    """Coefficients (m,) of an instrument with errors {label: value}: sampled, no formula shared."""

    def value(label):
        return errors.get(label, 0.0)

    def three(source, ends=("X1", "Y1", "Z1")):
        return np.array([value(f"{source} {end}") for end in ends])

    lat = latitude + value("latitude")
    w_n = W * np.array([cos(lat), 0, -sin(lat)])
    f_n = np.array([0, 0, -gravity - value("gravity")])
    table = [value(f"table about {axis}") for axis in ("north", "east", "down")]
    result = []
    for k, s in enumerate(stretches):
        n = SAMPLES if s.rate else 1
        t = s.start + s.span.length * (np.arange(n) + 0.5) / n
        beta = s.angle + s.rate * (t - s.start)
        late = beta - s.rate * value("lag")  # it reports what was
        placed = Rotation.from_rotvec(three(f"placement {k + 1} ({s.label}) about"))
        mounted = Rotation.from_rotvec(three("mounting about"))
        before = Rotation.from_rotvec(table) * C_np * s.C_pb * placed
        for_b = Rotation.from_rotvec(late[:, None] * s.axis_b) * mounted
        C_bn = (before * for_b).inv()
        w = C_bn.apply(w_n) + mounted.inv().apply(s.rate * s.axis_b)
        f = C_bn.apply(f_n)
        felt = []
        for sensor, x in (("gyro", w), ("accelerometer", f)):
            y = Rotation.from_rotvec(-three(f"{sensor} misalignment")).apply(x)
            yz, zx, xy = three(f"{sensor} non-orthogonality", ("Y1-Z1", "Z1-X1", "X1-Y1")) / 2
            y = y + y @ np.array([[0, xy, zx], [xy, 0, yz], [zx, yz, 0]])
            y = y + three(f"{sensor} asymmetry") * np.abs(y)
            y = y * (1 + three(f"{sensor} scale") + three(f"{sensor} quadratic") * y)
            y = y + three(f"{sensor} cubic") * y**3
            for name, force in (("g", f), ("g^2", f**2)):
                source = f"{sensor} {name}-sensitivity"
                G = np.array([three(f"{source} {a} by") for a in ("X1", "Y1", "Z1")])
                y = y + force @ G.T
            y = y + three(f"{sensor} bias") + three(f"{sensor} ramp") * t[:, None]
            felt.append(y)
        y = np.concatenate(felt, axis=1)
        shapes = [np.ones(n), 2 * np.cos(beta), 2 * np.sin(beta)] if s.rate else [np.ones(n)]
        result += [shape @ y / n for shape in shapes]
    return np.concatenate(result)


STRETCHES = [
    *carousel(4.0, -3.0, turns=2, tilt=3.0),
    *(
        Stretch(s.label, 600 + s.start, s.duration, Rotation.from_rotvec([0.2, 0.1, -0.3]) * s.C_pb)
        for s in rests(0, 100, axis=(0.6, 0, 0.8))
    ),
]


@pytest.mark.parametrize("latitude", LATITUDES)
def test_sensitivities_are_those_of_the_exact_model(latitude):
    site, C_np = Site(latitude * DEG), headed(130, 8, -6)
    names = [name for name in TriadErrors.__slots__ if name not in ("drift", "random_walk")]
    everything = TriadErrors(**dict.fromkeys(names, 1.0))  # pyright: ignore[reportArgumentType]
    found = information(
        STRETCHES,
        C_np,
        site,
        InstrumentErrors(everything, everything, 1.0),
        Setting(1.0, 1.0, 1.0, 1.0, 1.0),
    )
    at = exact(STRETCHES, C_np, site.latitude, site.gravity, {})
    size = np.where(np.arange(len(at)) % 6 < 3, W, site.gravity)
    assert len(found.parameters) == 3 + 2 * 42 + 3 + 3 + 3 * len(STRETCHES)
    for parameter, column in zip(found.parameters, found.J.T, strict=True):
        # a step small beside 1: second order 1e-6; a lag is a time, of a turn of 4 deg/s
        h = 1e-4
        up, down = (
            exact(STRETCHES, C_np, site.latitude, site.gravity, {parameter.label: e})
            for e in (h, -h)
        )
        differenced = (up - down) / (2 * h)
        # the kinks of |x| are sampled: (2 pi/720)^2 of it against 24 nodes' (2 pi/24)^2
        rel = 2e-2 if "asymmetry" in parameter.label else 1e-6
        # the middles of 720 samples against the integral of t cos(beta)
        rel = 1e-4 if "ramp" in parameter.label else rel
        scale = np.abs(differenced).max()
        assert scale > 0, parameter.label
        # rounding of the difference: 1e-16 of what is felt, over the step; per channel
        slack = 1e-11 * np.maximum(size, np.abs(at)) + rel * np.abs(differenced).max()
        assert (np.abs(column - differenced) <= slack).all(), parameter.label


def drawn(errors, sensor):
    """Errors by label, from the constants that one triad of the stand was given."""
    M = errors.matrix
    lean = M + M.T - 2 * np.diag(np.diag(M))
    found = {
        "bias": errors.bias,
        "ramp": errors.ramp,
        "asymmetry": errors.asymmetry,
        "quadratic": errors.second_order,
        "scale": np.diag(M) - 1,
        "misalignment": [M[1, 2] - M[2, 1], M[2, 0] - M[0, 2], M[0, 1] - M[1, 0]],
    }
    labels = {
        f"{sensor} {name} {axis}": value
        for name, values in found.items()
        for axis, value in zip(("X1", "Y1", "Z1"), np.asarray(values), strict=True)
    }
    for axis in ("X1", "Y1", "Z1"):
        labels[f"{sensor} misalignment {axis}"] /= 2
    for pair, i, j in (("Y1-Z1", 1, 2), ("Z1-X1", 2, 0), ("X1-Y1", 0, 1)):
        labels[f"{sensor} non-orthogonality {pair}"] = lean[i, j]
    for name, G in (("g", errors.g_sensitivity), ("g^2", errors.g2_sensitivity)):
        for (i, a), (j, b) in product(enumerate(("X1", "Y1", "Z1")), repeat=2):
            labels[f"{sensor} {name}-sensitivity {a} by {b}"] = G[i, j]
    return labels


@pytest.mark.parametrize("preset", ["stim300", "mpu9250"])
def test_sensitivities_are_those_of_the_stands_instrument(preset):
    """What a simulated unit reports at rest, noise off, less what it should: first order."""
    site, C_np = Site(48.5 * DEG), headed(130, 8, -6)
    off = ("bias-instability", "white-noise", "random-walk", "quantisation", "bandwidth", "range")
    # scale errors of per cent times axes of mrad are of second order and left out here
    spec = without_terms(load_imu(preset), (*off, "scale-factor"))
    rate, seconds = 10, 100
    stretch = Stretch("rest", 0.0, seconds, Rotation.from_rotvec([0.3, -0.2, 0.5]))
    found = information([stretch], C_np, site, TACTICAL)
    C_bn = (C_np * stretch.C_pb).inv()
    true = np.concatenate([C_bn.apply(site.w_ie_n), C_bn.apply(site.f_n)])
    n = rate * seconds
    imu = Imu(spec, 4, rate)
    block = imu.report(
        Sensed(
            np.arange(1, n + 1) * (1_000_000_000 // rate),
            np.tile(true[:3], (n, 1)),
            np.tile(true[3:], (n, 1)),
        )
    )
    means = np.concatenate([block.w_ib_b.mean(axis=0), block.f_b.mean(axis=0)])
    errors = drawn(imu.gyro_errors, "gyro") | drawn(imu.accel_errors, "accelerometer")
    predicted = sum(
        column * errors.get(parameter.label, 0.0)
        for parameter, column in zip(found.parameters, found.J.T, strict=True)
    )
    wrong = means - true - predicted
    # axes of 10 mrad squared, and stamps at the ends of samples: half of 0.1 s of ramp
    assert np.abs(wrong[:3]).max() < 2e-4 * np.abs((means - true)[:3]).max()
    assert np.abs(wrong[3:]).max() < 1e-2 * np.abs((means - true)[3:]).max()
    assert np.abs(means - true).min() > 0


# --- drift ---------------------------------------------------------------------------------------

SPANS = [
    Span(5.0, 60.0),
    Span(70.0, 3 * 2 * pi / 0.2, 0.2, 0.7),
    Span(190.0, 40.0),
    Span(240.0, 2 * 2 * pi / 0.25, -0.25, -1.1),
]


def sampled(kernel):
    """Covariance of the coefficients by sums over the middles of 400 parts of each span."""
    rows, times = [], []
    n = 400
    for s in SPANS:
        t = s.length * (np.arange(n) + 0.5) / n
        beta = s.angle + s.rate * t
        shapes = [np.ones(n), 2 * np.cos(beta), 2 * np.sin(beta)] if s.rate else [np.ones(n)]
        rows.append(np.array(shapes) / n)
        times.append(s.start + t)
    edges = np.cumsum([0, *(len(r) for r in rows)])
    S = np.zeros((edges[-1], n * len(SPANS)))
    for k, r in enumerate(rows):
        S[edges[k] : edges[k + 1], n * k : n * (k + 1)] = r
    t = np.concatenate(times)
    return S @ kernel(t[:, None], t[None, :]) @ S.T


@pytest.mark.parametrize("time", [2.0, 30.0, 1e4])
def test_covariance_of_a_gauss_markov_process(time):
    expected = sampled(lambda t, s: np.exp(-np.abs(t - s) / time))
    # midpoints about the kernel's kink: h^2/12 of its slope's step 2/time per length, h = 0.3 s
    assert gauss_markov(SPANS, time) == pytest.approx(expected, abs=4e-4 * min(1.0, 2 / time * 4))


def test_drift_is_that_of_the_stands_instrument():
    """Means of two rests of the simulated process, 300 units of three axes."""
    corners, rate = (1.0, 10.0, 100.0, 1000.0), 10
    spans = [Span(0.0, 60.0), Span(80.0, 100.0)]
    runs = []
    for seed in range(300):
        streams = [np.random.default_rng([seed, axis]) for axis in range(3)]
        drift = Drift(lambda source, mine=streams: mine, 1.0, 0.0, corners, rate).take(rate * 180)
        runs.append([drift[:, : rate * 60].mean(axis=1), drift[:, rate * 80 :].mean(axis=1)])
    means = np.concatenate(np.array(runs).transpose(0, 2, 1))
    each = np.array([gauss_markov(spans, corner) for corner in corners])
    expected = each.sum(axis=0) / plateau(corners) ** 2
    nees = np.einsum("ri,ij,rj->", means, np.linalg.inv(expected), means)
    assert chi2.ppf(5e-4, 1800) < nees < chi2.isf(5e-4, 1800)
    difference = np.var(means[:, 0] - means[:, 1]) * 900
    assert (
        chi2.ppf(5e-4, 899)
        < difference / (expected[0, 0] + expected[1, 1] - 2 * expected[0, 1])
        < chi2.isf(5e-4, 899)
    )


def test_covariance_of_a_random_walk():
    expected = sampled(lambda t, s: np.minimum(t, s))
    # the kink again: h^2/12 per length, 4 times for harmonics: 1e-3 s at most, of up to 300 s
    assert random_walk(SPANS) == pytest.approx(expected, abs=1e-3)


def test_coefficients_of_a_ramp():
    """At rest the middle; turning -2/r sin(beta) by integration by parts, the angle from zero."""
    assert ramp_coefficients(Span(5, 60)) == pytest.approx([35.0])
    length = 2 * pi / 0.2
    assert ramp_coefficients(Span(5, length, 0.2)) == pytest.approx([5 + length / 2, 0, -10])
    assert ramp_coefficients(Span(5, length, -0.2)) == pytest.approx([5 + length / 2, 0, 10])


# --- beside the estimators, and chance -----------------------------------------------------------

PRIORS = [
    Priors(
        gyro_bias=10 * DEG_H,
        accel_bias=2 * MILLI_G,
        gyro_scale=1e-3,
        accel_scale=2e-4,
        gyro_walk=0.02 * DEG_RT_H,
        accel_walk=5e-4,
        turn=0.5 * MINUTE,
    ),
    Priors(
        gyro_bias=0.05 * DEG_H,
        accel_bias=0.05 * MILLI_G,
        gyro_walk=0.1 * DEG_RT_H,
        accel_walk=5e-4,
    ),
    Priors(
        gyro_bias=100 * DEG_H,
        accel_bias=5 * MILLI_G,
        gyro_scale=3e-3,
        accel_scale=3e-3,
        gyro_walk=0.001 * DEG_RT_H,
        accel_walk=5e-4,
        turn=5 * MINUTE,
    ),
    Priors(
        gyro_bias=10 * DEG_H,
        accel_bias=2 * MILLI_G,
        gyro_scale=1e-3,
        accel_scale=2e-4,
        gyro_walk=0.002 * DEG_RT_H,
        accel_walk=5e-4,
        turn=0.5 * MINUTE,
        gyro_misalignment=1e-3,
        accel_misalignment=2e-3,
        gyro_non_orthogonality=2e-4,
        accel_non_orthogonality=3e-4,
        gyro_asymmetry=1e-4,
        accel_asymmetry=2e-4,
        gyro_g_sensitivity=0.1 * DEG_H / 9.8,
        gyro_g2_sensitivity=0.01 * DEG_H / 96,
        accel_quadratic=1e-5,
        accel_cubic=1e-6,
    ),
]


@pytest.mark.parametrize(("priors", "latitude"), list(product(PRIORS, [48.5, -33.0, 75.0])))
@pytest.mark.parametrize("known", [True, False])
def test_the_multi_position_fit_predicts_the_same(priors, latitude, known):
    """Another way by other code: `alignment.methods.positions`, in each position."""
    site, C = Site(latitude * DEG), headed(115, -5, 5)
    stretches = rests(0, 90, 180)
    unit, setting = assumed(priors, known)
    if not known:  # what the fit takes for unknown: 1 rad, 0.03 m/s^2 beside normal gravity
        setting = Setting(placement=priors.turn, latitude=1.0, gravity=0.03)
    found = information(stretches, C, site, unit, setting)
    relative = Rotation.concatenate([s.C_pb for s in stretches]).as_matrix()
    density = np.repeat([priors.gyro_walk, priors.accel_walk], 3) ** 2
    expected = predicted_covariance(
        C.as_matrix(),
        np.tile(density / 200, (3, 1)),
        relative,
        site.known_latitude(),
        site.gravity,
        priors,
        not known,
    )
    for k in range(3):
        covariance = found.covariance(found.attitude_rows(k))
        # the fit adds rounding to noise, up to 1e-10 rad/s beside 2e-8, squared 2e-5
        assert np.diag(covariance) == pytest.approx(np.diag(expected[k]), rel=1e-4)
        size = np.sqrt(np.diag(covariance))
        # cross terms as parts of the sigmas
        assert covariance / np.outer(size, size) == pytest.approx(
            expected[k] / np.outer(size, size), abs=1e-4
        )


@pytest.mark.parametrize(("arw", "vrw"), [(ARW, 1e-4), (1e-4 * DEG_RT_H, 1e-3)])
@pytest.mark.parametrize("latitude", LATITUDES)
def test_the_carousel_predicts_the_same(arw, vrw, latitude):
    """Another way by other code: `alignment.methods.carousel`, which does not level by gyros."""
    site, C, stretches = Site(latitude * DEG), headed(70), carousel(4.0, turns=2)
    axis, length = np.array([0, 1.0, 0]), stretches[0].span.length

    def turning(vector_n, density):
        # each of two sensors gives both components, its harmonics with 2 density^2/T
        v = C.inv().apply(vector_n)
        variance = np.array(density**2 / length)
        return TurningVector(v - axis * (v @ axis), variance, v, np.full(3, 0.5))

    gyros, accels = turning(site.w_ie_n, arw), turning(site.f_n, vrw)
    fit = carousel_attitude(gyros, accels, axis, site.known_latitude(), Priors())
    # levels are those of accelerometers alone where Y1's constant rate is unknown, north or not
    unit = InstrumentErrors(TriadErrors(arw, np.inf), TriadErrors(vrw, [np.inf, 0, np.inf]))
    found = information(stretches, C, site, unit)
    covariance = found.covariance(found.attitude_rows())
    # the horizontal rate levels too: W^2/ARW^2 beside g^2/VRW^2, 4 % of pitch in the worse case
    assert np.diag(covariance) == pytest.approx(np.diag(fit.covariance), rel=0.05)
    assert covariance[2, 2] == pytest.approx(fit.covariance[2, 2], rel=1e-3)
    assert covariance[0, 2] == pytest.approx(fit.covariance[0, 2], rel=1e-3)


def simulated(found, site, runs, rng, mine):
    """Coefficients (runs, m) beside nominal with all errors drawn, and the errors (runs, p)."""
    drawn = rng.normal(size=(runs, len(found.parameters))) * mine
    noise = rng.multivariate_normal(np.zeros(len(found.used)), found.noises.sum(axis=0), runs)
    nominal = exact(found.stretches, found.C_np, site.latitude, site.gravity, {})
    labels = [p.label for p in found.parameters]
    y = [
        exact(found.stretches, found.C_np, site.latitude, site.gravity, dict(zip(labels, e)))  # noqa: B905
        for e in drawn
    ]
    return np.array(y) + noise - nominal, drawn


TACTICAL = InstrumentErrors(
    TriadErrors(
        0.02 * DEG_RT_H,
        1 * DEG_H,
        0.1 * DEG_H / 3600,
        3e-4,
        1e-4,
        0.0,
        0.0,
        2e-4,
        2e-4,
        0.02 * DEG_H / 9.8,
        0.002 * DEG_H / 96,
        (GaussMarkov(0.02 * DEG_H, 10.0), GaussMarkov(0.02 * DEG_H, 300.0)),
        1e-4 * DEG_H,
    ),
    TriadErrors(
        5e-4,
        1 * MILLI_G,
        0.0,
        3e-4,
        1e-4,
        1e-5 / 9.8,
        0.0,
        2e-4,
        2e-4,
        drift=(GaussMarkov(0.01 * MILLI_G, 100.0),),
    ),
    1e-4,
)
TABLE = Setting(placement=10 / 3600 * DEG, mounting=20 / 3600 * DEG)
SCENES = {
    "two": rests(0, 180),
    "four": rests(0, 90, 180, 270),
    "six": SIX,
    "carousel": carousel(4.0, -4.0, turns=2, tilt=1.0),
}


@pytest.mark.parametrize(("scene", "latitude"), list(product(SCENES, [48.5, -33.0])))
def test_the_best_gain_reaches_its_sigma_on_exact_readings(scene, latitude, monkeypatch):
    """Errors drawn from the priors, attitude within a third of a degree, readings exact."""
    monkeypatch.setattr(f"{__name__}.SAMPLES", 24)  # whole turns: harmonics to 22 are exact
    site = Site(latitude * DEG)
    found = information(SCENES[scene], headed(250), site, TACTICAL, TABLE)
    rng = np.random.default_rng([11, list(SCENES).index(scene), int(latitude + 90)])
    mine = np.where(np.isinf(found.prior), 0.3 * DEG, found.prior)
    runs = 300
    y, errors = simulated(found, site, runs, rng, mine)
    for quantity in ("heading", "roll", "pitch", "gyro bias X1", "accelerometer bias Z1"):
        assert found.determined(quantity)
        wrong = y @ found.gain(quantity) - errors @ found.row(quantity)
        ratio = np.sum((wrong / found.sigma(quantity)) ** 2)
        # 40 numbers, family-wise 1 %
        assert chi2.ppf(1.25e-4, runs) < ratio < chi2.isf(1.25e-4, runs), quantity


def test_the_fit_of_positions_reaches_the_predicted_sigma():
    """Least squares of the multi-position method on readings of 2000 runs, all biases drawn."""
    priors, site, C = PRIORS[0], Site(-33 * DEG), headed(40, 4, -3)
    stretches = rests(0, 90, 180, 270)
    found = information(stretches, C, site, *assumed(priors))
    rng = np.random.default_rng(5)
    runs, n = 2000, len(stretches)
    d = Rotation.from_rotvec(priors.turn * rng.normal(size=(runs * n, 3))).as_matrix()
    relative = Rotation.concatenate([s.C_pb for s in stretches]).as_matrix()
    truth = C.as_matrix() @ relative @ d.reshape(runs, n, 3, 3)
    C_bn = np.swapaxes(truth, -1, -2)
    true = np.concatenate([C_bn @ site.w_ie_n, C_bn @ site.f_n], axis=-1)
    scale = np.repeat([priors.gyro_scale, priors.accel_scale], 3)
    bias = np.repeat([priors.gyro_bias, priors.accel_bias], 3)
    variances = np.tile(np.repeat([priors.gyro_walk, priors.accel_walk], 3) ** 2 / (T / n), (n, 1))
    y = true * (1 + scale * rng.normal(size=(runs, 1, 6))) + bias * rng.normal(size=(runs, 1, 6))
    y = y + np.sqrt(variances) * rng.normal(size=y.shape)
    fit = fit_positions(y, variances, relative, site.latitude, site.gravity, priors)
    for k in (0, 3):
        turns = fit.C_nb[:, k] @ np.swapaxes(truth[:, k], -1, -2)
        wrong = Rotation.from_matrix(turns).as_rotvec()
        P = found.covariance(found.attitude_rows(k))
        nees = np.einsum("ri,ij,rj->", wrong, np.linalg.inv(P), wrong)
        # 2000 x 3 degrees of freedom, 99.9 %
        assert chi2.ppf(5e-4, 3 * runs) < nees < chi2.isf(5e-4, 3 * runs)
        heading = np.sum(wrong[:, 2] ** 2) / P[2, 2]
        assert chi2.ppf(5e-4, runs) < heading < chi2.isf(5e-4, runs)


# --- contributions -------------------------------------------------------------------------------


def total(contributions):
    return sqrt(sum(value**2 for value in contributions.values()))


SWITCHES = {
    "noise": {"noise": 0.0},
    "bias": {"bias": 0.0},
    "ramp": {"ramp": 0.0},
    "scale": {"scale": 0.0},
    "asymmetry": {"asymmetry": 0.0},
    "quadratic": {"quadratic": 0.0},
    "misalignment": {"misalignment": 0.0},
    "non-orthogonality": {"non_orthogonality": 0.0},
    "g-sensitivity": {"g_sensitivity": 0.0},
    "g^2-sensitivity": {"g2_sensitivity": 0.0},
    "bias-instability": {"drift": ()},
    "random-walk": {"random_walk": 0.0},
}


def without(unit, setting, source):
    """The unit and setting with one source switched off."""

    def fields(x):
        return {name: getattr(x, name) for name in x.__slots__}

    sensor, _, name = source.partition(" ")
    if name in SWITCHES:
        mine = "gyro" if sensor == "gyro" else "accel"
        triad = TriadErrors(**{**fields(getattr(unit, mine)), **SWITCHES[name]})
        return InstrumentErrors(**{**fields(unit), mine: triad}), setting
    if source == "lag":
        return InstrumentErrors(unit.gyro, unit.accel), setting
    return unit, Setting(**{**fields(setting), source: 0.0})


@pytest.mark.parametrize("scene", SCENES)
def test_each_source_adds_its_own(scene):
    """Gains frozen, one source off: its row is gone, all others stay, and so the total says."""
    site, C = Site(48.5 * DEG), headed(250, 4, -3)
    found = information(SCENES[scene], C, site, TACTICAL, TABLE)
    rows = {quantity: found.contributions(quantity) for quantity in ("heading", "pitch")}
    told = set()
    for quantity, mine in rows.items():
        sigma = found.sigma(quantity)
        assert total(mine) == pytest.approx(sigma, rel=1e-9)
        # gain J - row cancels: of 1 rad 1e-16 remain, times the condition's root of 1e5
        frozen = found.contributions(quantity, gain=found.gain(quantity))
        assert frozen == pytest.approx(mine, rel=1e-8, abs=1e-10 * sigma)
        told |= {name for name, value in mine.items() if value > 1e-9 * sigma}
    for source in told:
        less = information(SCENES[scene], C, site, *without(TACTICAL, TABLE, source))
        for quantity, mine in rows.items():
            sigma = found.sigma(quantity)
            left = less.contributions(quantity, gain=found.gain(quantity))
            # of a noise that is off 1e-12 rad/s of rounding remain
            assert left[source] < 1e-3 * sigma
            for other in told - {source}:
                assert left[other] == pytest.approx(mine[other], rel=1e-8, abs=1e-10 * sigma)
            expected = total(mine) ** 2 - mine[source] ** 2
            # that rounding again, squared
            assert total(left) ** 2 == pytest.approx(expected, abs=1e-6 * sigma**2)
    assert {"gyro noise", "accelerometer noise", "placement"} <= told


def unit_of(spec, lag=1e-3):
    """A preset's unit: its data sheet's values as standard deviations."""

    def triad(t):
        height = t.instability / plateau(spec.corners)
        return TriadErrors(
            *(t.noise, t.bias, t.ramp, t.scale, t.asymmetry, t.second_order),
            t.nonlinearity / t.full_scale**2,
            *(t.misalignment, t.non_orthogonality, t.g_sensitivity, t.g2_sensitivity),
            tuple(GaussMarkov(height, corner) for corner in spec.corners) if height else (),
            t.random_walk,
        )

    return InstrumentErrors(triad(spec.gyro), triad(spec.accel), lag)


@pytest.mark.parametrize("preset", ["ideal", "mpu9250", "stim300", "ring-laser"])
@pytest.mark.parametrize("scene", ["one", *SCENES])
def test_presets_of_every_grade(preset, scene):
    """The best gain, frozen, says what the information says; nothing is lost to rounding."""
    site, stretches = Site(48.5 * DEG), {"one": rests(0), **SCENES}[scene]
    found = information(stretches, headed(30, 3, 2), site, unit_of(load_imu(preset)), TABLE)
    sigma = found.sigma("heading")
    rows = found.contributions("heading")
    # a bias of 10^5 deg of heading keeps 8 digits of it
    assert total(rows) == pytest.approx(sigma, rel=1e-7)
    frozen = found.contributions("heading", gain=found.gain("heading"))
    assert frozen == pytest.approx(rows, rel=1e-6, abs=1e-6 * sigma)


def test_contributions_of_one_position_by_hand():
    """0.05 deg/h of 9.96651 deg/h is 5.01680 mrad; 2 mg at 48.5 deg 7.8' (methods.md section 2)."""
    unit = InstrumentErrors(
        TriadErrors(1e-4 * DEG_RT_H, 0.05 * DEG_H), TriadErrors(FINE, 2 * MILLI_G)
    )
    found = information(rests(0), headed(0), Site(48.5 * DEG), unit)
    rows = found.contributions("heading")
    # level by gyros of 0.05 deg/h is 2 times worse than by 2 mg: they mend a part of it
    assert rows["gyro bias"] == pytest.approx(5.0168e-3, rel=1e-2)
    assert rows["accelerometer bias"] / MINUTE == pytest.approx(7.8, rel=0.15)


def test_what_a_half_turn_leaves_by_hand():
    """[S4]: misalignment 1:1, placement (d180 - d0)/2, g-sensitivity 31' at 5 deg of roll."""
    site = Site(50 * DEG)
    unit = InstrumentErrors(
        TriadErrors(ARW, np.inf, misalignment=1e-3, g_sensitivity=DEG_H / 9.80665),
        TriadErrors(FINE, np.inf),
    )
    setting = Setting(placement=MINUTE)
    level = information(rests(0, 180), headed(0), site, unit, setting)
    rows = level.contributions("heading")
    # levels by gyros count for 1e-6 of it
    assert rows["gyro misalignment"] == pytest.approx(1e-3, rel=1e-5)
    assert rows["placement"] == pytest.approx(MINUTE / sqrt(2), rel=1e-3)
    assert rows["gyro g-sensitivity"] < 1e-3 * MINUTE
    tilted = information(rests(0, 180), headed(0, 5), site, unit, setting)
    # printed to the minute
    rolled = tilted.contributions("heading")["gyro g-sensitivity"]
    assert rolled / MINUTE == pytest.approx(31, abs=0.5)


def test_lag_of_one_way_is_rate_times_lag():
    """4 deg/s and 5 ms: 1.2'; both ways it is estimated, and contributes next to nothing."""
    site = Site(48.5 * DEG)
    unit = InstrumentErrors(TriadErrors(ARW, np.inf), TriadErrors(FINE, np.inf), 5e-3)
    one = information(carousel(4.0), headed(10), site, unit)
    assert one.contributions("heading")["lag"] == pytest.approx(1.2 * MINUTE, rel=1e-6)
    both = information(carousel(4.0, -4.0), headed(10), site, unit)
    free = information(carousel(4.0, -4.0), headed(10), site, ALL_UNKNOWN)
    assert both.contributions("heading")["lag"] < 1e-3 * MINUTE
    assert both.sigma("heading") == pytest.approx(free.sigma("heading"), rel=1e-6)


def test_the_gain_of_an_estimator_that_was_told_less():
    """Bias unknown to it, no drift: what drift makes of its gain adds to its own sigma."""
    site, C, stretches = Site(48.5 * DEG), headed(70), rests(0, 180, gap=0.0)
    priors = Priors(gyro_walk=ARW, accel_walk=FINE)
    told = information(stretches, C, site, *assumed(priors))
    sigma, time = 0.05 * DEG_H, 100.0
    unit = InstrumentErrors(
        TriadErrors(ARW, 100 * DEG_H, drift=(GaussMarkov(sigma, time),)), TriadErrors(FINE, np.inf)
    )
    real = information(stretches, C, site, unit)
    rows = real.contributions("heading", gain=told.gain("heading"))
    drift = sigma * sqrt(markov_avar(T / 2, time)) / (sqrt(2) * W * cos(48.5 * DEG))
    assert rows["gyro bias-instability"] == pytest.approx(drift, rel=1e-8)
    assert rows["gyro noise"] == pytest.approx(floor(48.5), rel=1e-9)
    # blind to constant biases: of the 10 rad that 100 deg/h would be 1e-13 remains
    assert rows["gyro bias"] < 1e-9 * floor(48.5)
    assert rows["accelerometer bias"] == 0.0
    assert total(rows) > real.sigma("heading") * (1 - 1e-12)


def test_a_gain_that_feels_what_nobody_knows():
    """One position's gain where biases are unknown: infinite, and said so."""
    site, C = Site(48.5 * DEG), headed(70)
    gain = information(
        rests(0), C, site, InstrumentErrors(TriadErrors(ARW), TriadErrors(FINE))
    ).gain("heading")
    unknown = information(rests(0), C, site, ALL_UNKNOWN)
    rows = unknown.contributions("heading", gain=gain)
    assert rows["gyro bias"] == np.inf
    assert rows["gyro noise"] == pytest.approx(floor(48.5), rel=1e-9)
    with pytest.raises(AlignmentError, match="heading is not determined: at rest in one"):
        unknown.contributions("heading")
    with pytest.raises(AlignmentError, match=r"not determined: .*heading cannot be told from"):
        unknown.covariance(unknown.attitude_rows())


def test_table_azimuth_enters_a_method_that_trusts_it():
    """No gain at all: the table's own attitude is the answer, and its error the answer's."""
    site = Site(48.5 * DEG)
    setting = Setting(attitude=[1e-4, 2e-4, 3e-3])
    found = information(rests(0), headed(0), site, TACTICAL, setting)
    rows = found.contributions("heading", gain=np.zeros(6))
    assert rows["table attitude"] == pytest.approx(3e-3)
    assert total(rows) == pytest.approx(3e-3)
    # a good azimuth is not mended by gyros of 1 deg/h
    assert found.sigma("heading") == pytest.approx(3e-3, rel=1e-2)


def test_motion_adds_to_the_noise():
    disturbed = Stretch(
        "swaying", 0.0, T, Rotation.identity(), disturbance=np.array([0, 0, 3e-7, 0, 0, 0])
    )
    found = information(
        [disturbed],
        headed(0),
        Site(48.5 * DEG),
        InstrumentErrors(TriadErrors(ARW), TriadErrors(FINE)),
    )
    expected = 3e-7 / (W * cos(48.5 * DEG))
    assert found.contributions("heading")["motion"] == pytest.approx(expected, rel=1e-6)


@pytest.mark.slow
@settings(max_examples=10, deadline=None)
@given(
    angles=st.tuples(st.floats(0, 360), st.floats(-60, 60), st.floats(-60, 60)),
    turns=st.lists(st.floats(-180, 180), min_size=1, max_size=3),
    latitude=st.floats(-80, 80),
)
def test_more_readings_never_tell_less(angles, turns, latitude):
    """And at any attitude contributions add up, and turning table and instrument is no change."""
    site, C = Site(latitude * DEG), headed(*angles)
    stretches = rests(*turns, total=100.0 * len(turns))
    found = information(stretches, C, site, TACTICAL, TABLE)
    more = information(
        [*stretches, Stretch("more", 1e3, 100.0, SIX[4].C_pb)], C, site, TACTICAL, TABLE
    )
    shift = Rotation.from_rotvec([0.4, -1.0, 2.0])
    moved = [Stretch(s.label, s.start, s.duration, shift.inv() * s.C_pb) for s in stretches]
    same = information(moved, C * shift, site, TACTICAL, TABLE)
    for quantity in ("heading", "roll", "pitch", "gyro bias X1"):
        sigma = found.sigma(quantity)
        # digits: condition's root of 1e4 to 1e6
        assert total(found.contributions(quantity)) == pytest.approx(sigma, rel=1e-8)
        assert more.sigma(quantity) <= sigma * (1 + 1e-8)
        assert same.sigma(quantity) == pytest.approx(sigma, rel=1e-7)


# --- rank and words ------------------------------------------------------------------------------


def said(found):
    return [c.text for c in found.unseen]


def blind(found):
    """Every combination leaves every reading as it is: differenced in the exact model."""
    W_ = found.J / np.sqrt(np.diag(found.noises.sum(axis=0)))[:, None]
    for c in found.unseen:
        terms = np.abs(W_) @ np.abs(c.vector)
        # 1e-12 of singular values pass as nothing
        assert np.all(np.abs(W_ @ c.vector) <= 1e-6 * terms.max())
        assert np.any(c.vector != 0)


def test_one_position_at_rest():
    """By hand: 1 deg of heading is 9.96651 deg/h pi/180 = 0.174 deg/h; 1 deg of tilt 17.5 mg."""
    found = information(rests(0), headed(0), Site(48.5 * DEG), ALL_UNKNOWN)
    assert (found.rank, found.sought) == (6, 9)
    assert said(found) == [
        "at rest in one position: heading cannot be told from gyro bias Z1 (0.174 deg/h per deg)",
        "at rest in one position: roll cannot be told from accelerometer bias Z1 (17.5 mg per deg)",
        "at rest in one position: pitch cannot be told from "
        "accelerometer bias X1 (17.5 mg per deg)",
    ]
    assert [c.name for c in found.unseen] == ["heading", "roll", "pitch"]
    assert found.sigma("heading") == np.inf
    assert not found.determined("heading")
    assert found.why("heading") == said(found)[0]
    assert found.why("accelerometer bias Y1") == ""
    assert found.why("gyro bias Y1") == said(found)[2]  # 0.197 deg/h per deg of pitch
    blind(found)


def test_one_position_in_other_azimuths_and_hemispheres():
    found = information(rests(0), headed(30), Site(-33 * DEG), ALL_UNKNOWN)
    # 12.6145 deg/h: 0.220 deg/h per deg
    assert said(found)[0] == (
        "at rest in one position: heading cannot be told from "
        "gyro bias along east (0.22 deg/h per deg)"
    )
    blind(found)


def test_a_fine_gyro_is_named_beside_the_accelerometer():
    """1 deg of roll: 17.45 mg, and 11.265 deg/h pi/180 = 0.197 deg/h: of priors 349 and 19.7."""
    unit = InstrumentErrors(TriadErrors(ARW, 0.01 * DEG_H), TriadErrors(FINE, 0.05 * MILLI_G))
    found = information(rests(0), headed(0), Site(48.5 * DEG), unit)
    assert said(found)[1] == (
        "at rest in one position: roll cannot be told from gyro bias Z1 (0.197 deg/h per deg) "
        "and accelerometer bias Z1 (17.5 mg per deg)"
    )
    # told by its prior alone: 0.01/9.96651
    assert found.determined("heading")
    assert found.sigma("heading") > 0.0099 / 9.96651
    assert "heading cannot be told from" in found.why("heading")


@pytest.mark.parametrize(
    "stretches",
    [rests(0, 180), rests(0, 90, 180, 270), SIX, carousel(4.0)],
    ids=["half turn", "four", "six", "carousel"],
)
@pytest.mark.parametrize("latitude", LATITUDES)
def test_attitude_and_biases_are_all_seen(stretches, latitude):
    found = information(stretches, headed(20), Site(latitude * DEG), ALL_UNKNOWN)
    assert (found.rank, found.sought) == (9, 9)
    assert said(found) == []
    assert np.isfinite(found.condition)
    assert found.determined("heading")


@pytest.mark.parametrize("latitude", LATITUDES)
def test_condition_by_hand(latitude):
    """One rest of a unit without constant errors: tilt shows as g over the accelerometers' noise,
    heading as W cos lat over the gyros'; of the Fisher matrix the squares count."""
    site = Site(latitude * DEG, local_gravity=9.81)
    found = information(
        rests(0), headed(20), site, InstrumentErrors(TriadErrors(ARW), TriadErrors(FINE))
    )
    ratio = 9.81 / FINE / (W * cos(latitude * DEG) / ARW)
    assert found.rank == found.sought == 3
    # a floor of 1e-9 m/s^2 beside 4e-7 of the mean: squared 6e-6
    assert found.condition == pytest.approx(ratio**2, rel=1e-5)


def test_condition_is_of_the_largest_and_the_least():
    """Accelerometers of three kinds: the tilts are seen to 1 and 2 parts, heading to W cos lat."""
    site = Site(48.5 * DEG, local_gravity=9.81)
    unit = InstrumentErrors(TriadErrors(ARW), TriadErrors((FINE, FINE, 4 * FINE)))
    found = information(rests(0), headed(0), site, unit)
    ratio = 9.81 / FINE / (W * cos(48.5 * DEG) / ARW)
    assert found.rank == 3
    assert found.condition == pytest.approx(ratio**2, rel=1e-4)


def test_turns_about_the_vertical_show_no_vertical_scale():
    """Four positions, nothing known of accelerometer scale: Y1's is its bias; X1, Z1 feel nothing.

    1 mg is 1000 ppm of standard gravity, 999.7 of 9.80936 m/s^2.
    """
    unit = InstrumentErrors(TriadErrors(ARW, np.inf), TriadErrors(FINE, np.inf, scale=np.inf))
    found = information(rests(0, 90, 180, 270), headed(0), Site(48.5 * DEG), unit)
    assert (found.rank, found.sought) == (9, 12)
    assert said(found) == [
        "at rest in 4 positions: accelerometer bias Y1 cannot be told from "
        "accelerometer scale Y1 (1e+03 ppm per mg)",
        "at rest in 4 positions: no reading depends on accelerometer scale X1",
        "at rest in 4 positions: no reading depends on accelerometer scale Z1",
    ]
    six = information(SIX, headed(0), Site(48.5 * DEG), unit)
    assert (six.rank, six.sought) == (12, 12)
    assert six.determined("accelerometer scale Y1")


def test_a_carousel_one_way_takes_its_lag_for_heading():
    """4 deg/s: 1 deg is 250 ms."""
    unit = InstrumentErrors(ALL_UNKNOWN.gyro, ALL_UNKNOWN.accel, np.inf)
    one = information(carousel(4.0), headed(0), Site(48.5 * DEG), unit)
    assert (one.rank, one.sought) == (9, 10)
    assert said(one) == ["turning one way: heading cannot be told from lag (250 ms per deg)"]
    assert not one.determined("heading")
    assert one.determined("pitch")
    blind(one)
    both = information(carousel(4.0, -4.0), headed(0), Site(48.5 * DEG), unit)
    assert (both.rank, both.sought) == (10, 10)
    rest = [Stretch("rest", 600.0, 60.0, Rotation.identity())]
    mixed = information(carousel(4.0) + rest, headed(0), Site(48.5 * DEG), unit)
    assert said(mixed) == []  # a rest has no lag


def test_near_a_pole():
    """Rank counts what shows at all; sigma says what it is worth; at the pole nothing shows."""
    near = information(rests(0, 180), headed(0), Site(89.9 * DEG), ALL_UNKNOWN)
    assert near.rank == 9
    assert near.sigma("heading") == pytest.approx(floor(89.9), rel=1e-6)
    assert degrees(near.sigma("heading")) == pytest.approx(53.4, abs=0.5)
    assert not near.determined("heading")
    assert near.determined("pitch")
    pole = information(rests(0, 180), headed(0), Site(pi / 2), ALL_UNKNOWN)
    assert (pole.rank, pole.sought) == (8, 9)
    assert said(pole) == ["at rest in 2 positions: no reading depends on heading"]
    assert pole.sigma("heading") == np.inf
    assert pole.determined("roll")


def test_an_x1_that_is_vertical_has_no_heading():
    up = Rotation.from_euler("Z", 90, degrees=True)
    found = information([Stretch("up", 0.0, T, up)], LEVEL, Site(48.5 * DEG), ALL_UNKNOWN)
    with pytest.raises(AlignmentError, match="up: X1 is vertical"):
        found.sigma("heading")
    assert [c.name for c in found.unseen] == ["azimuth", "tilt about north", "tilt about east"]
    known = information([Stretch("up", 0.0, T, up)], LEVEL, Site(48.5 * DEG), TACTICAL)
    # yaw is what azimuth is then: 1 deg/h of 9.97 deg/h and more
    assert known.sigma("yaw") == pytest.approx(1 / 9.96651, rel=0.05)


def test_heading_sees_tilt_when_x1_is_steep():
    """Differences of heading itself, X1 at 50 deg: tilt about its horizontal turns it sideways."""
    C = headed(200, 20, 50)
    found = information(rests(0), C, Site(48.5 * DEG), ALL_UNKNOWN)

    def heading(eta):
        north, east, _ = (Rotation.from_rotvec(eta) * C).apply([1.0, 0, 0])
        return np.arctan2(east, north)

    h = 1e-6
    differenced = [(heading(h * e) - heading(-h * e)) / (2 * h) for e in np.eye(3)]
    assert found.row("heading")[:3] == pytest.approx(differenced, abs=1e-9)


# --- what is refused -----------------------------------------------------------------------------


def test_refusals():
    site = Site(48.5 * DEG)
    with pytest.raises(TooShort, match=r"slow: 350\.0 deg, at least one whole turn"):
        Stretch("slow", 0.0, 87.5, Rotation.identity(), 4 * DEG)
    with pytest.raises(ValueError, match="never: duration"):
        Stretch("never", 0.0, 0.0, Rotation.identity())
    with pytest.raises(ValueError, match="long: axis_b"):
        Stretch("long", 0.0, 100.0, Rotation.identity(), 4 * DEG, np.array([0, 2.0, 0]))
    with pytest.raises(ValueError, match=r"bias: .*negative"):
        TriadErrors(bias=-1.0)
    with pytest.raises(ValueError, match=r"scale: .*NaN"):
        TriadErrors(scale=[0, np.nan, 0])
    with pytest.raises(ValueError, match="sigma"):
        GaussMarkov(1.0, 0.0)
    with pytest.raises(ValueError, match="at least one"):
        information([], LEVEL, site, ALL_UNKNOWN)
    a, b = rests(0, 180)
    with pytest.raises(ValueError, match="0: begins before 180 has ended"):
        information([b, a], LEVEL, site, ALL_UNKNOWN)
    with pytest.raises(AlignmentError, match="latitude"):
        information([a, b], LEVEL, Site(None), ALL_UNKNOWN)
    found = information(
        [a], LEVEL, site, InstrumentErrors(TriadErrors([ARW, np.inf, ARW]), TriadErrors(FINE))
    )
    with pytest.raises(AlignmentError, match="'bearing': must be one of heading, roll"):
        found.sigma("bearing")
    with pytest.raises(AlignmentError, match="sensor that is not there"):
        found.contributions("heading", gain=np.ones(6))


@pytest.mark.parametrize("m", [1, 2, 7, 8])
def test_sums_of_means_of_a_process_are_its_double_sum(m):
    """Two means of h seconds that are n apart covary by the double integral of exp(-|t - s|/T)."""
    h, process = 3.0, GaussMarkov(2.0, 5.0)
    rng = np.random.default_rng(m)
    gain = rng.normal(size=(m, 2, 3)) * (-1.0) ** np.arange(m)[:, None, None]  # not of one sign
    nodes, weights = np.polynomial.legendre.leggauss(60)
    t, w = (nodes + 1) * h / 2, weights / 2

    def shared(apart: int) -> float:
        if apart == 0:  # 2 (a - 1 + exp(-a))/a^2, at a = 0.6
            return 4.0 * 2 * (0.6 - 1 + np.exp(-0.6)) / 0.36
        return 4.0 * float(w @ np.exp(-np.abs(t[:, None] - t - apart * h) / 5.0) @ w)

    want = sum(shared(abs(i - j)) * gain[i] @ gain[j].T for i in range(m) for j in range(m))
    found = sum_covariance(gain, h, [process])
    np.testing.assert_allclose(found, want, rtol=1e-12, atol=1e-12 * np.abs(want).max())
