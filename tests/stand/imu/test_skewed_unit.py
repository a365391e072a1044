"""Units whose triads are skewed by design: from the sheet to readings, records and sigmas."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from alignment import ESTIMATORS, Dwell, Options, Priors, Site
from alignment.errors import AlignmentError
from alignment.methods.vectors import VectorOptions, against
from alignment.methods.vectors.solutions import SOLUTIONS
from alignment.readings import ImuReadings
from alignment.skew import by_planes, components, cone, spread, unit_axes
from alignment.units import DEG, DEG_PER_HOUR
from stand.errors import StandError
from stand.imu import Imu, imu_from, load_imu
from stand.imu.priors import priors_of
from stand.recording.metadata import describe_estimate, describe_site, settings_of
from stand.samples import Sensed
from stand.toml_files import Source
from stand.vehicle.scenario import drive_from, fixes_of, load_drive, programmed, sense, started

HEAD = 'title = "Skewed"\ngrade = "reference"\nevidence = "none"\n'
STATED = 'kind = "assumed", source = "of this test alone"'
CONE = cone(25 * DEG)


def sheet(gyro="", accel=""):
    return imu_from(Source("skewed", "skewed.toml", f"{HEAD}[gyro]\n{gyro}\n[accel]\n{accel}\n"))


def axes_line(axes):
    rows = ", ".join(f"[{x:.17g}, {y:.17g}, {z:.17g}]" for x, y, z in axes)
    return f"axes = {{ value = [{rows}], {STATED} }}"


def sensed(w, f, n):
    t = np.arange(1, n + 1) * 10_000_000
    return Sensed(t, np.tile(w, (n, 1)), np.tile(f, (n, 1)))


W_TRUE, F_TRUE = np.array([1e-3, -2e-3, 3e-3]), np.array([1.0, 9.7, -2.0])


def test_an_ideal_skewed_unit_reports_the_truth():
    angle = f"plane_angle_deg = {{ value = 60, {STATED} }}"
    unit = Imu(sheet(angle, axes_line(CONE)), 0, 100)
    block = unit.report(sensed(W_TRUE, F_TRUE, 5))
    np.testing.assert_allclose(block.w_ib_b, np.tile(W_TRUE, (5, 1)), rtol=1e-12)
    np.testing.assert_allclose(block.f_b, np.tile(F_TRUE, (5, 1)), rtol=1e-12)


def test_errors_are_of_the_sensors_along_their_own_axes():
    """A bias and a scale error per sensor, by hand; the range cuts a sensor, not a component."""
    bias = f"turn_on_bias_mg = {{ value = 5, {STATED} }}"
    scale = f"scale_factor_ppm = {{ value = 900, {STATED} }}"
    unit = Imu(sheet(accel="\n".join((axes_line(CONE), bias, scale))), 3, 100)
    found = unit.report(sensed(W_TRUE, F_TRUE, 1)).f_b[0]
    e, A = unit.accel_errors, unit_axes(CONE)
    felt = e.matrix @ F_TRUE + e.bias
    np.testing.assert_allclose(found, np.linalg.solve(A, felt), rtol=1e-12)
    cut = Imu(sheet(accel=axes_line(CONE) + f"\nrange_g = {{ value = 0.9, {STATED} }}"), 0, 100)
    block = cut.report(sensed(W_TRUE, F_TRUE, 1))
    limited = np.clip(A @ F_TRUE, -0.9 * 9.80665, 0.9 * 9.80665)
    assert block.saturated[0, 3:].tolist() == (np.abs(A @ F_TRUE) > 0.9 * 9.80665).tolist()
    np.testing.assert_allclose(block.f_b[0], np.linalg.solve(A, limited), rtol=1e-12)


def test_noise_of_components_is_what_the_axes_make_of_it():
    noise = f"angle_random_walk_deg_rt_h = {{ value = 0.1, {STATED} }}"
    unit = Imu(sheet(f"plane_angle_deg = {{ value = 50, {STATED} }}\n{noise}"), 1, 100)
    n = 20_000
    found = np.cov(unit.report(sensed(W_TRUE, F_TRUE, n)).w_ib_b.T)
    sigma2 = (0.1 * DEG / 60) ** 2 * 100
    # a variance of n samples is known to sqrt(2/n), 1 %; 4 sigma
    np.testing.assert_allclose(found / sigma2, spread(by_planes(50 * DEG)), atol=4 * 0.01 * 2.4)


@pytest.mark.parametrize(
    ("gyro", "accel", "words"),
    [
        ("", axes_line([[1, 0, 0], [0, 1, 0], [1, 1, 0]]), "nearly in one plane"),
        (f"plane_angle_deg = {{ value = 2, {STATED} }}", "", "plane_angle_deg"),
        (
            f"plane_angle_deg = {{ value = 60, {STATED} }}\n" + axes_line(CONE),
            "",
            "axes and plane_angle_deg: not both",
        ),
        (
            "",
            axes_line(CONE) + f"\nplaces_mm = {{ value = [[0,0,1],[0,0,2],[0,0,3]], {STATED} }}",
            "axes and places_mm: not both",
        ),
    ],
)
def test_sheets_that_are_not_right(gyro, accel, words):
    with pytest.raises(StandError, match=words):
        sheet(gyro, accel)


def test_axes_come_through_a_record():
    spec = sheet(f"plane_angle_deg = {{ value = 60, {STATED} }}", axes_line(CONE))
    priors = priors_of(spec, None)
    record = {
        "site": describe_site(Site(0.8)),
        "estimate": describe_estimate(Options(priors=priors), ["two-gyro"]),
    }
    back = settings_of(record)[1].priors
    np.testing.assert_allclose(back.gyro_axes, by_planes(60 * DEG), atol=1e-15)
    np.testing.assert_allclose(back.accel_axes, unit_axes(CONE), atol=1e-15)
    square = describe_estimate(Options(), ["triad"])
    assert not any("axes" in key for key in square)  # older records read as before
    damaged = record | {"estimate": record["estimate"] | {"gyro_axes": "[[1, 0, 0]]"}}
    with pytest.raises(StandError, match="gyro_axes"):
        settings_of(damaged)


def test_rehearsal_does_not_predict_what_it_does_not_know():
    from stand.rehearsal.rehearse import rehearse
    from stand.simulation.settings import settings

    spec = sheet(f"plane_angle_deg = {{ value = 60, {STATED} }}")
    made = replace(settings("static", "ideal"), imu=spec)
    reasons = {p.reason for p in rehearse(made).predictions}
    assert reasons == {
        "no prediction is made: the gyros of skewed are skewed by design; see --verify"
    }


# --- in the channel of a drive -------------------------------------------------------------------

RUNS = 10


def skewed_runs(name, told):
    """NEES after half a minute of runs whose sensors are biased along a cone.

    By then the accelerometers' biases are most of the tilt.
    """
    drive = load_drive("weaving")
    satellite = drive.satellite.model_copy(update={"outages_s": ((30.0, 121.0),)})
    felt = sense(drive.path, 20)
    axes = tuple(map(tuple, CONE.tolist()))
    own = {"gyro_axes": axes, "accel_axes": axes} if told else {}
    priors = Priors(accel_bias=0.01, gyro_bias=5 * DEG_PER_HOUR, **own)
    found = []
    for seed in range(RUNS):
        rng = np.random.default_rng(seed)
        biases = rng.standard_normal((2, 3)) * [[5 * DEG_PER_HOUR], [0.01]]
        wrong = components(biases, CONE)
        readings = ImuReadings(felt.t_ns * 1e-9, felt.w_ib_b + wrong[0], felt.f_b + wrong[1])
        fixes = fixes_of(drive.path, satellite, rng)
        start = programmed(drive.path, 0.5 * DEG, rng)
        solved = SOLUTIONS[name](readings, fixes, start, VectorOptions(priors=priors, step=1.0))
        found.append(against(solved, drive.path.at(fixes.t).C_nb).nees[-1])
    return float(np.sum(found))


@pytest.mark.parametrize("name", ["kalman", "observing"])
def test_the_channels_covariance_knows_the_axes(name):
    low, high = chi2.ppf([0.005, 0.995], 3 * RUNS)  # both solutions within 99 % each
    informed = skewed_runs(name, told=True)
    assert low < informed < high
    assert skewed_runs(name, told=False) > 1.5 * informed  # the same runs: not for nothing


# --- the start of a drive ------------------------------------------------------------------------


def test_start_errors_as_three_angles():
    text = load_drive("weaving").text
    stated = text + "\n[start_error]\nroll_deg = 0.4\nheading_deg = -1.5\npitch_deg = 0.2\n"
    drive = drive_from(Source("own", "own.toml", stated))
    rng = np.random.default_rng(0)
    true = drive.path.at(np.zeros(1)).C_nb[0]
    ahead = started(drive, 0.5 * DEG, rng).apply([1.0, 0, 0])
    heading = np.arctan2(ahead[1], ahead[0])
    x = true.apply([1.0, 0, 0])
    assert (heading - np.arctan2(x[1], x[0])) / DEG == pytest.approx(-1.5, abs=1e-9)
    assert np.arcsin(-ahead[2]) / DEG == pytest.approx(0.2, abs=1e-9)  # level before
    right = started(drive, 0.5 * DEG, rng).apply([0.0, 0, 1.0])
    # roll is positive where Y1 goes toward Z1: Z1 sinks
    assert np.arcsin(right[2] / np.cos(0.2 * DEG)) / DEG == pytest.approx(0.4, abs=1e-9)
    plain = load_drive("weaving")
    a, b = (f(plain if f is started else plain.path, 0.5 * DEG, np.random.default_rng(4))
            for f in (started, programmed))  # fmt: skip
    assert (a * b.inv()).magnitude() == 0  # same seed, same start
    assert load_imu("stim300").gyro.axes is None


@pytest.mark.parametrize("method", [name for name, m in ESTIMATORS.items() if m.takes != "fixes"])
def test_methods_that_do_not_know_skew_refuse_the_unit(method):
    """Those that know it go on to what they need."""
    t = np.arange(1, 601) / 10
    readings = ImuReadings(t, np.tile(W_TRUE, (600, 1)), np.tile(F_TRUE, (600, 1)))
    dwell = Dwell("rest", 0.0, 60.0, readings)
    options = Options(priors=replace(Priors(), accel_axes=unit_axes(CONE)))
    try:
        ESTIMATORS[method].estimate([dwell], Site(latitude=0.8), options)
        told = ""
    except AlignmentError as error:
        told = str(error)
    assert ("skewed by design" in told) == (not ESTIMATORS[method].knows_skew)
