"""Several positions: biases cancel, placements do not; closed forms, chi-square, floors."""

import re
from math import atan, cos, degrees, pi, radians, sin, sqrt, tan

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import chi2, norm

from alignment import Dwell, ImuReadings, Options, Priors, Site
from alignment.errors import AlignmentError, NotAtRest, PoleError
from alignment.information import Stretch
from alignment.information.drift import Span, switched_on
from alignment.information.turns import double_sigma, time_needed, turn_pays
from alignment.methods.position_fit import (
    drift_covariance,
    equal_spans,
    fit_positions,
    pooled_variances,
    predicted_covariance,
    steady_drift,
)
from alignment.methods.position_gains import known_to
from alignment.methods.positions import half_turn_means, multi_position, two_position
from alignment.methods.triad import triad_attitude

W = 7.292115e-5  # rad/s
G = 9.8093587  # m/s^2 at 48.5 deg, by hand: methods.md section 0
DEG_H = pi / 180 / 3600
DEG_RT_H = pi / 180 / 60  # rad/sqrt(s)
MINUTE = pi / 180 / 60  # rad
MILLI_G = 9.80665e-3
N, E, D = np.eye(3)
LEVEL = np.column_stack([N, -D, E])  # X1 north, Y1 up, Z1 east
TILTED = Rotation.from_euler("ZYX", [115, 5, -5], degrees=True).as_matrix() @ LEVEL
HERE = Site(radians(48.5))


def about(axis, *angles_deg):
    """Relative attitudes (n, 3, 3) of turns about an axis of b."""
    return Rotation.from_rotvec(np.outer(np.radians(angles_deg), axis)).as_matrix()


TURNS = {
    "half turn": about([0, 1, 0], 0, 180),
    "quarter turn": about([0, 1, 0], 0, 90),
    "four": about([0, 1, 0], 0, 90, 180, 270),
}


def vectors_n(latitude, gravity=G):
    return np.array([W * cos(latitude), 0, -W * sin(latitude)]), np.array([0, 0, -gravity])


def readings_of(C, latitude, gravity=G):
    """Perfect readings (..., 6) at attitudes (..., 3, 3)."""
    C_bn = np.swapaxes(C, -1, -2)
    return np.concatenate([C_bn @ v for v in vectors_n(latitude, gravity)], axis=-1)


def error(found, truth):
    """Small rotations (..., 3) about n that take truth to what was found."""
    E_ = found @ np.swapaxes(truth, -1, -2)
    return Rotation.from_matrix(E_.reshape(-1, 3, 3)).as_rotvec().reshape(E_.shape[:-1])


def dwells_of(C, relative, bias=(0,) * 6, seconds=20.0, noise=None, latitude=HERE.latitude):
    """Dwells at 10 Hz with perfect placement; `noise`: generator and sigmas (6,) per sample."""
    dwells = []
    for k, C_k in enumerate(C @ relative):
        n = round(10 * seconds)
        y = np.tile(readings_of(C_k, latitude) + bias, (n, 1))
        if noise is not None:
            y = y + noise[1] * noise[0].normal(size=(n, 6))
        t = 100.0 * k + np.arange(1, n + 1) / 10
        felt = ImuReadings(t, y[:, :3], y[:, 3:])
        told = Rotation.from_matrix(LEVEL @ relative[k])  # the table's azimuth is not the truth
        dwells.append(Dwell(f"p{k}", 100.0 * k, 100.0 * k + seconds, felt, told))
    return dwells


# --- the estimators on dwells --------------------------------------------------------------------

BIAS = np.array([30, -20, 25, 0, 0, 0]) * DEG_H + np.array([0, 0, 0, 8, -5, 6]) * MILLI_G


@pytest.mark.parametrize("site", [HERE, Site(None)], ids=["latitude", "no latitude"])
def test_biases_of_any_size_are_found_with_turns_about_two_axes(site):
    relative = np.concatenate([about([0, 1, 0], 0, 120), about([1, 0, 0], 90)])
    dwells = dwells_of(TILTED, relative, BIAS)
    found = multi_position(dwells, site, Options())
    assert [e.label for e in found] == ["p0", "p1", "p2"]
    for estimate, R in zip(found, relative, strict=True):
        # gravity at hand has 8 digits; unknown biases have priors of 0.5 m/s^2, at 1e-9 nothing
        assert np.abs(error(estimate.C_nb.as_matrix(), TILTED @ R)).max() < 2e-8
        assert (estimate.t_from, estimate.t_to) == (0.0, 220.0)
        assert not any("biases not shown" in flag for flag in estimate.flags)
        # an Earth rate of 8 digits leaves 1e-8 of it; a gravity of 8 digits some 1e-7 m/s^2
        assert estimate.biases[:3] == pytest.approx(BIAS[:3], abs=1e-11)
        assert estimate.biases[3:] == pytest.approx(BIAS[3:], abs=3e-7)
        assert (estimate.bias_sigmas > 0).all()
    assert (found[0].latitude is None) == (site.latitude is not None)
    if found[0].latitude is not None:
        assert found[0].latitude == pytest.approx(radians(48.5), abs=1e-8)


def test_two_positions_with_ten_degrees_per_hour():
    """TRIAD of one position is lost; a half turn is exact, the latitude being known."""
    dwells = dwells_of(TILTED, TURNS["half turn"], BIAS)
    (found,) = two_position(dwells, HERE, Options())
    assert (found.method, found.label) == ("two-position", "p0")
    # tilts to 5 deg: all six biases show
    assert np.abs(error(found.C_nb.as_matrix(), TILTED)).max() < 2e-8
    alone = triad_attitude(
        dwells[0].readings.w_ib_b.mean(axis=0), dwells[0].readings.f_b.mean(axis=0)
    )
    assert abs(degrees(error(alone.as_matrix(), TILTED)[2])) > 30


def test_each_successive_pair_with_a_turn_counts():
    relative = about([0, 1, 0], 0, 180, 185, 10)
    found = two_position(dwells_of(LEVEL, relative), HERE, Options())
    assert [(e.label, e.t_from, e.t_to) for e in found] == [("p0", 0, 120), ("p2", 200, 320)]


def test_the_order_of_dwells_does_not_matter():
    dwells = dwells_of(TILTED, TURNS["four"], BIAS)
    for method in (two_position, multi_position):
        forward, backward = (method(d, HERE, Options()) for d in (dwells, dwells[::-1]))
        assert [e.label for e in forward] == [e.label for e in backward]
        for a, b in zip(forward, backward, strict=True):
            assert a.C_nb.as_quat().tolist() == b.C_nb.as_quat().tolist()


def test_refusals():
    still = dwells_of(LEVEL, about([0, 1, 0], 0, 29))
    with pytest.raises(AlignmentError, match="too little turn: no two successive dwells"):
        two_position(still, HERE, Options())
    with pytest.raises(AlignmentError, match="too little turn: no two dwells are 30 deg"):
        multi_position(still, HERE, Options())
    with pytest.raises(AlignmentError, match="1 dwells, at least 2"):
        multi_position(still[:1], HERE, Options())
    first, second = dwells_of(LEVEL, TURNS["half turn"])
    untold = Dwell("u", second.t_from, second.t_to, second.readings)
    with pytest.raises(AlignmentError, match="u: its attitude is not known"):
        two_position([first, untold], HERE, Options())
    r = second.readings
    late = (np.arange(200) >= 100)[:, None]
    moved = ImuReadings(r.t, r.w_ib_b, r.f_b + late * np.array([0.4, 0, 0]))
    with pytest.raises(NotAtRest, match=r"^m: not at rest"):
        multi_position([first, Dwell("m", 100.0, 120.0, moved, second.nominal)], HERE, Options())
    at_pole = dwells_of(LEVEL, TURNS["half turn"], latitude=pi / 2)
    for site in (Site(pi / 2), Site(None)):
        with pytest.raises(PoleError):
            two_position(at_pole, site, Options())


def test_what_the_turns_do_not_show_is_said():
    """Placements of 5' move gravity by 1.5 mg: a level bias of 0.1 mg cannot show.

    Except along X1, which points north: there the gyros and the latitude tell the tilt.
    """
    dwells = dwells_of(LEVEL, TURNS["half turn"])
    (free,) = two_position(dwells, HERE, Options())
    assert free.flags == ()
    priors = Priors(accel_bias=0.1 * MILLI_G, turn=5 * MINUTE)
    (found,) = two_position(dwells, HERE, Options(priors=priors))
    hidden = "biases not shown by these turns: Z1 accelerometer"
    assert hidden in found.flags


def test_two_attitudes_that_fit_alike_are_flagged():
    """One axis, free biases: the rate along it may have either sign. A second axis tells."""
    for relative, ambiguous in (
        (about([0, 0, 1], 0, 120), True),
        (np.concatenate([about([0, 0, 1], 0, 120), about([0, 1, 0], 90)]), False),
    ):
        C = Rotation.from_euler("ZYX", [30, 0, 0], degrees=True).as_matrix() @ LEVEL
        found = multi_position(dwells_of(C, relative), HERE, Options())
        assert any("ambiguous" in flag for flag in found[0].flags) == ambiguous
        if not ambiguous:
            assert np.abs(error(found[0].C_nb.as_matrix(), C)).max() < 2e-8


def test_the_likelier_of_two_attitudes_is_taken():
    """Any attitude, any axis of turning not level: latitude and gravity choose, bias or not."""
    rng = np.random.default_rng(65)
    priors = Priors(20 * DEG_H, 5 * MILLI_G)
    for _ in range(30):
        axis = rng.normal(size=3)
        axis /= np.linalg.norm(axis)
        C = Rotation.random(None, rng).as_matrix()
        if abs((C @ axis)[2]) < 0.2:
            continue
        bias = np.repeat([20 * DEG_H, 5 * MILLI_G], 3) * rng.normal(size=6)
        relative = about(axis, 0, rng.uniform(60, 180))
        y = readings_of(C @ relative, HERE.latitude) + bias
        variances = np.tile(np.repeat([1e-18, 1e-12], 3), (2, 1))
        fit = fit_positions(y, variances, relative, HERE.latitude, G, priors)
        # 5 mg along the axis of turning may stay: half a degree of tilt, the same of heading
        assert np.degrees(np.abs(error(fit.C_nb[0], C))).max() < 5
        assert fit.margin > 12


@pytest.mark.parametrize(("latitude", "heading"), [(48.5, 30.0), (-20.0, 215.0)])
def test_a_force_mirrored_in_the_plane_across_the_turn_fits_but_for_its_bias(latitude, heading):
    """Half a turn about X1, which leans by 3 deg: of what lies along it no turn knows the sign.

    A bias of -1.5 of g sin 3 deg and a lean up read as one of +0.5 and a lean down, which is the
    likelier: by ``(1.5^2 - 0.5^2) (g sin 3 deg/sigma)^2``, and the rate along X1 changes likewise.
    """
    lean, sigma = radians(3), 0.8 * G * sin(radians(3))
    C = Rotation.from_euler("ZYX", [heading, 3, 0], degrees=True).as_matrix() @ LEVEL
    relative = about([1, 0, 0], 0, 180)
    bias = np.array([0, 0, 0, -1.5 * G * sin(lean), 0.1, -0.2])
    y = readings_of(C @ relative, radians(latitude)) + bias
    variances = np.tile(np.repeat([1e-20, 1e-14], 3), (2, 1))
    priors = Priors(1000 * DEG_H, sigma)
    fit = fit_positions(y, variances, relative, radians(latitude), G, priors)
    x1 = C[:, 0]
    along = W * (cos(radians(latitude)) * x1[0] - sin(radians(latitude)) * x1[2])
    assert fit.biases[[0, 3]] == pytest.approx([2 * along, 0.5 * G * sin(lean)], rel=1e-3)
    assert fit.biases[[1, 2, 4, 5]] == pytest.approx([0, 0, 0.1, -0.2], abs=1e-4)
    gyros = (2 * along / (1000 * DEG_H)) ** 2
    margin = 2 * (G * sin(lean) / sigma) ** 2 - gyros
    assert float(fit.margin) == pytest.approx(margin, rel=1e-3)  # first order leaves 1e-4
    # the true tilt is 6 deg from this one, with the odds of that
    odds = np.exp(-margin / 2) / (1 + np.exp(-margin / 2))
    down = fit.C_nb[0] @ C.T @ D
    off = np.array([-down[1], down[0]])
    assert np.linalg.norm(off) == pytest.approx(sin(2 * lean), rel=1e-3)
    tilts = fit.covariance[0, :2, :2]
    assert tilts == pytest.approx(odds * np.outer(off, off), abs=1e-3 * odds * off @ off)
    # where the sheet allows no such bias the true one is found
    surer = fit_positions(
        y - [0, 0, 0, bias[3], 0, 0], variances, relative, radians(latitude), G,
        Priors(1000 * DEG_H, G * sin(lean) / 50),
    )  # fmt: skip
    assert np.abs(error(surer.C_nb[0], C)).max() < 1e-3
    assert np.sqrt(surer.covariance[0].diagonal()[:2]).max() < 1e-3


@pytest.mark.parametrize("heading", [40.0, -155.0])
def test_one_sure_gyro_across_the_turn_leaves_two_headings(heading):
    """Half a turn about the vertical takes the bias from X1, which shows ``W cos lat cos psi``: of
    psi and -psi Z1 tells little, whose noise is ten times that rate: ``2 (2 sin psi/10)^2`` of
    chi-square. What is known worst is the vertical rate, which tells nothing of it."""
    C = Rotation.from_euler("z", heading, degrees=True).as_matrix() @ LEVEL
    relative = about([0, 1, 0], 0, 180)
    y = readings_of(C @ relative, HERE.latitude)
    variances = np.tile(np.repeat([1e-20, 1e-14], 3), (2, 1))
    variances[:, 2] = (10 * W * cos(HERE.latitude)) ** 2
    fit = fit_positions(y, variances, relative, HERE.latitude, G, Priors(1000 * DEG_H, 1e-3))
    margin = 2 * (2 * sin(radians(heading)) / 10) ** 2
    assert float(fit.margin) == pytest.approx(margin, rel=1e-3)
    odds = np.exp(-margin / 2) / (1 + np.exp(-margin / 2))
    apart = radians(2 * min(abs(heading), 180 - abs(heading)))
    assert fit.covariance[0, 2, 2] == pytest.approx(odds * apart**2, rel=1e-3)


def test_axes_that_are_off_turn_a_tilt_that_nobody_knows_into_the_other_biases():
    """Half a turn about a level X1: its bias b of 20 mg is a tilt b/g that nothing tells.

    Accelerometers turned about Z1 by 10 mrad, which the turn shows as ``m g`` that changes sides on
    X1, make ``m b`` of it along Y1: 0.2 mg, where first order has the noise.
    """
    relative = about([1, 0, 0], 0, 180)
    y = readings_of(LEVEL @ relative, HERE.latitude)
    y[:, 3] += 0.01 * y[:, 4]  # Z1 is level, and nothing lies along X1
    # gyros as noisy as Earth rate is large tell no tilt
    variances = np.tile(np.repeat([1e-8, 1e-10], 3), (2, 1))
    b = 20 * MILLI_G
    for misalignment, expected in ((0.01, 0.01 * b), (0.0, 1e-5 / sqrt(2))):
        told = y if misalignment else readings_of(LEVEL @ relative, HERE.latitude)
        priors = Priors(1000 * DEG_H, b, accel_misalignment=misalignment)
        fit = fit_positions(told, variances, relative, HERE.latitude, G, priors, 5e-4)
        sigmas = np.sqrt(fit.bias_covariance.diagonal()[3:])
        assert sigmas[0] == pytest.approx(b, rel=0.01)
        assert sigmas[1] == pytest.approx(expected, rel=0.02)


def test_a_tilt_that_nobody_knows_bends_the_one_that_positions_tell_finely():
    """Upside down about a level axis, leaning: axes off by 20 mrad are a tilt about the turn's
    axis, and the tilt across it is told by how the lean makes forces differ, to minutes of arc.

    The product of both errors over the lean, ``0.02^2/0.16``, is 2.5 mrad there; with the straight
    line alone squares over covariances were 80 per degree of freedom.
    """
    C = Rotation.from_euler("ZYX", [20, -8, 5], degrees=True).as_matrix()
    turn = Rotation.from_rotvec(np.pi * np.array([0.85, 0.53, 0])).as_matrix()
    relative = np.stack([np.eye(3), turn @ about([0, 0, 1], -64)[0]])
    priors = Priors(gyro_bias=9e-5, accel_bias=0.15, accel_misalignment=0.02)
    rng = np.random.default_rng(11)
    runs, sigma = 400, np.repeat([1e-6, 1e-4], 3)
    true = readings_of(C @ relative, HERE.latitude)
    theta = 0.02 * rng.normal(size=(runs, 1, 3))
    bias = np.repeat([9e-5, 0.15], 3) * rng.normal(size=(runs, 1, 6))
    y = true + bias + sigma * rng.normal(size=(runs, 2, 6))
    y[..., 3:] += np.cross(theta, true[:, 3:])
    fit = fit_positions(y, np.tile(sigma**2, (2, 1)), relative, HERE.latitude, G, priors)
    # the true vertical as the estimate sees it, whatever its heading
    down = np.einsum("rij,j->ri", fit.C_nb[:, 0] @ C.T, D)
    tilt = np.stack([-down[:, 1], down[:, 0]], axis=-1)
    squares = np.einsum("ri,rij,rj->r", tilt, np.linalg.inv(fit.covariance[:, 0, :2, :2]), tilt)
    finest = np.sqrt(np.linalg.eigvalsh(fit.covariance[:, 0, :2, :2])[:, 0])
    assert np.median(finest) < radians(0.35)  # and not hidden in a sigma of degrees
    # 800 normal squares: 4 sigma are 0.2; bent squares have longer tails
    assert 0.6 < squares.sum() / (2 * runs) < 1.3


def test_gravity_may_differ_from_its_normal_value():
    """100 mgal: unremarked where nobody measured gravity, a contradiction where one did."""
    relative = about([1, 0, 0], 0, 90, 180, 270)
    readings = dwells_of(LEVEL, relative)
    heavier = [
        Dwell(
            d.label,
            d.t_from,
            d.t_to,
            ImuReadings(d.readings.t, d.readings.w_ib_b, d.readings.f_b * (1 + 1e-3 / G)),
            d.nominal,
        )
        for d in readings
    ]
    for gravity, doubted in ((None, False), (G, True)):
        found = multi_position(heavier, Site(HERE.latitude, local_gravity=gravity), Options())
        assert any("contradict" in flag for flag in found[0].flags) == doubted


def test_contradicting_positions_are_flagged():
    first, second = dwells_of(
        LEVEL, TURNS["half turn"], noise=(np.random.default_rng(1), np.repeat([1e-6, 1e-3], 3))
    )
    options = Options(priors=Priors(gyro_bias=10 * DEG_H, accel_bias=10 * MILLI_G))
    (fine,) = two_position([first, second], HERE, options)
    assert not any("contradict" in flag for flag in fine.flags)
    # Told 180, turned 182 deg about the vertical: means and biases can take that up as azimuth;
    # told 180 about another axis, by 2 deg, gravity says no.
    wrong = Rotation.from_matrix(LEVEL @ about([0, 1, 0.035], 180)[0])
    other = Dwell("p1", second.t_from, second.t_to, second.readings, wrong)
    tight = Options(priors=Priors(gyro_bias=1 * DEG_H, accel_bias=0.1 * MILLI_G))
    (doubted,) = two_position([first, other], HERE, tight)
    assert any("positions contradict one another" in flag for flag in doubted.flags)


def test_whether_the_turn_pays_is_part_of_the_answer():
    dwells = dwells_of(LEVEL, TURNS["half turn"])

    def verdict(gyro_bias, turn):
        priors = Priors(gyro_bias=gyro_bias, accel_bias=0.01 * MILLI_G, turn=turn)
        (found,) = two_position(dwells, HERE, Options(priors=priors))
        return [flag for flag in found.flags if flag.startswith("turns ")]

    # Bias alone: b/(W cos lat) = 5.73 deg per deg/h; 1' placement.
    (pays,) = verdict(DEG_H, MINUTE)
    assert pays.startswith("turns pay: heading sigma 0.0118 deg")  # 0.707'
    assert "against 5.75 deg of one position" in pays
    # A laser of 1e-4 deg/h on a table of 5': one position is as good, the prior keeps it so.
    assert verdict(1e-4 * DEG_H, 5 * MINUTE) != []
    assert verdict(0.0, MINUTE) == []
    # What 180 and 90 deg would give: (d1 - d0)/2, and nose north east of it the same here.
    half, quarter = pays.split("; ")[1].split(", ")
    assert half == "180 deg: 0.0118 deg"
    assert quarter.startswith("90 deg: ")


def test_an_answer_without_its_verdict_has_the_same_numbers():
    dwells = dwells_of(LEVEL, TURNS["half turn"])
    priors = Priors(gyro_bias=DEG_H, accel_bias=0.01 * MILLI_G, turn=MINUTE)
    (told,) = two_position(dwells, HERE, Options(priors=priors))
    (short,) = two_position(dwells, HERE, Options(priors=priors, verdicts=False))
    np.testing.assert_array_equal(told.C_nb.as_quat(), short.C_nb.as_quat())
    np.testing.assert_array_equal(told.covariance, short.covariance)
    assert short.flags == tuple(flag for flag in told.flags if not flag.startswith("turns "))


def shown_verdict(priors, seconds, seed, walk):
    """(several, one, 180 deg, 90 deg) in arc minutes, as the words of the verdict say them."""
    sigmas = np.repeat([walk * sqrt(10), 1e-7], 3)  # per sample at 10 Hz
    dwells = dwells_of(LEVEL, TURNS["half turn"], seconds=seconds[0])
    longer = dwells_of(LEVEL, TURNS["half turn"], seconds=seconds[1])
    rng = np.random.default_rng(seed)
    noisy = []
    for d in (dwells[0], longer[1]):
        y = np.concatenate([d.readings.w_ib_b, d.readings.f_b], axis=1)
        y = y + sigmas * rng.normal(size=y.shape)
        felt = ImuReadings(d.readings.t, y[:, :3], y[:, 3:])
        noisy.append(Dwell(d.label, d.t_from, d.t_to, felt, d.nominal))
    (found,) = two_position(noisy, HERE, Options(priors=priors))
    (flag,) = [flag for flag in found.flags if flag.startswith("turns ")]
    pattern = (
        r"turns (do not )?pay: heading sigma ([\d.]+) deg against ([\d.]+) deg of one position in "
        r"the same time; 180 deg: ([\d.]+) deg, 90 deg: ([\d.]+) deg"
    )
    told = re.fullmatch(pattern, flag)
    assert told is not None, flag
    return told[1] is None, [60 * float(number) for number in told.groups()[1:]]


def test_the_noise_of_the_verdict_is_that_of_the_whole_time():
    """A unit without biases to speak of: 20 s and 60 s of rest are 80 s, turned or not."""
    walk = 0.003 * DEG_RT_H
    floor = walk / sqrt(80) / (W * cos(HERE.latitude)) / MINUTE  # 6.93'
    assert floor == pytest.approx(6.93, abs=0.02)
    found = []
    for seed in range(10):
        priors = Priors(gyro_bias=1e-6 * DEG_H, accel_bias=1e-9)
        found.append(shown_verdict(priors, (20.0, 60.0), [66, seed], walk)[1])
    # each knows the noise by 62 blocks or so to 9 %: three sigma of ten of them
    assert np.mean(found, axis=0)[:3] == pytest.approx([floor] * 3, rel=0.09)
    # a bias that is known leaves the quarter turn as good
    assert np.mean(found, axis=0)[3] == pytest.approx(floor, rel=0.09)


def test_the_words_of_the_verdict():
    """1 deg/h is 345' in one position; the turn leaves noise, at 90 deg sqrt 2 of it; and the other
    way round a table of 5' under a unit that needs no turn: it pays by nothing."""
    walk = 0.003 * DEG_RT_H
    floor = walk / sqrt(40) / (W * cos(HERE.latitude)) / MINUTE  # 9.81'
    told = [shown_verdict(Priors(DEG_H, 1e-9), (20.0, 20.0), [67, k], walk) for k in range(20)]
    assert all(pays for pays, _ in told)
    numbers = np.mean([numbers for _, numbers in told], axis=0)
    # each record tells the noise of an axis to 9 %, the quarter turn by two of them: of the means
    # of 20 records three sigma; words have three digits
    assert numbers[0] == pytest.approx(floor, rel=0.07)
    assert numbers[1] == pytest.approx(345, abs=1.0)
    assert numbers[2] == pytest.approx(numbers[0], rel=0.02)
    assert numbers[3] / numbers[2] == pytest.approx(sqrt(2), rel=0.06)


@pytest.mark.parametrize("north", [10.0, -25.0])
def test_a_deflection_is_taken_out_of_the_latitude(north):
    """What gravity and Earth rate show is astronomical; geodetic is that less xi."""
    second = pi / 180 / 3600
    relative = np.concatenate([about([0, 1, 0], 0, 120), about([1, 0, 0], 90)])
    dwells = dwells_of(TILTED, relative, latitude=radians(48.5))
    site = Site(None, deflection=(north * second, 0.0))
    for estimate in multi_position(dwells, site, Options()):
        assert estimate.latitude == pytest.approx(radians(48.5) - north * second, abs=1e-8)


def test_positions_that_contradict_one_another_are_less_sure():
    """Told 2 deg off, about an axis that gravity shows: all sigmas grow by the same factor."""
    noise = (np.random.default_rng(1), np.repeat([1e-6, 1e-3], 3))
    first, second = dwells_of(LEVEL, TURNS["half turn"], noise=noise)
    wrong = Rotation.from_matrix(LEVEL @ about([0, 1, 0.035], 180)[0])
    other = Dwell("p1", second.t_from, second.t_to, second.readings, wrong)
    options = Options(priors=Priors(gyro_bias=DEG_H, accel_bias=0.1 * MILLI_G))
    (fine,) = two_position([first, second], HERE, options)
    (doubted,) = two_position([first, other], HERE, options)
    (flag,) = [flag for flag in doubted.flags if "contradict" in flag]
    told = re.search(r"chi-square (\d+) for 9 degrees .* sigmas are ([\d.]+) times as large", flag)
    assert told is not None, flag
    assert float(told[2]) == pytest.approx(sqrt(float(told[1]) / 7), rel=0.01)
    grown = np.sqrt(np.diag(doubted.covariance) / np.diag(fine.covariance))
    # the wrong turn changes the geometry by 2 deg, the noise is the same
    assert grown == pytest.approx(np.full(3, float(told[2])), rel=0.05)
    assert not any(flag.startswith("turns ") for flag in doubted.flags)


def test_a_contradiction_of_three_residuals_leaves_nothing_determined():
    """No latitude, no bias stated, and gravity was told 1 % less than the half difference of both,
    which no bias can make. The least is left where X1 is level: its bias is not told by the force's
    size there, and three of twelve readings are left over.
    """
    dwells = dwells_of(TILTED, about([1, 0, 0], 0, 180))
    (found,) = two_position(dwells, Site(None, local_gravity=0.99 * G), Options())
    assert any("contradict one another: " in flag for flag in found.flags)
    assert any("3 degrees of freedom" in flag for flag in found.flags)
    assert abs(found.C_nb.as_matrix()[2, 0]) < 1e-6
    assert np.all(np.sqrt(np.diag(found.covariance)) > 1e3 * pi)


# --- placement, scale, noise: first order, by hand ------------------------------------------------


def test_placement_enters_by_half_its_difference():
    d0, d1 = 3 * MINUTE, -5 * MINUTE
    told = TURNS["half turn"]
    actual = LEVEL @ told @ about([0, 1, 0], degrees(d0), degrees(d1))
    means = readings_of(actual, HERE.latitude)
    # no placement prior: all of it goes into the common attitude, d about Y1 is -d about down
    fit = fit_positions(means, np.full((2, 6), 1e-20), told, HERE.latitude, G, Priors())
    assert fit.C_nb.shape == (2, 3, 3)
    against_actual = error(fit.C_nb[0], actual[0])[2]
    against_told = error(fit.C_nb[0], LEVEL)[2]
    # sin d for d: 1e-6 of it
    assert against_actual == pytest.approx(-(d1 - d0) / 2, rel=1e-5)
    assert against_told == pytest.approx(-(d0 + d1) / 2, rel=1e-5)


EAST = np.column_stack([E, -D, -N])  # X1 east, Y1 up, Z1 south


def sigma_minutes(turn_deg, priors, gyros, estimated=False, seconds=3600.0):
    """Predicted sigma of heading [arc minutes], X1 east, accelerometers perfect."""
    relative = about([0, 1, 0], 0, turn_deg)
    walk = np.where(gyros, priors.gyro_walk, 1e3)
    noise = np.concatenate([walk**2 * 2 / seconds, np.full(3, 1e-18)])
    P = predicted_covariance(
        EAST, np.tile(noise, (2, 1)), relative, HERE.latitude, G, priors, estimated
    )
    return sqrt(P[0, 2, 2]) / MINUTE


ONE, TWO = (True, False, False), (True, False, True)
UNIT = Priors(gyro_bias=10 * DEG_H, accel_bias=1e-9, gyro_walk=1e-10)


def test_turn_error_at_half_and_quarter_turns():
    table = Priors(gyro_bias=10 * DEG_H, accel_bias=1e-9, gyro_walk=1e-10, turn=MINUTE)
    # half turn: (d1 - d0)/2, 1'/sqrt 2
    assert sigma_minutes(180, table, ONE) == pytest.approx(sqrt(0.5), rel=1e-4)
    assert sigma_minutes(180, table, TWO) == pytest.approx(sqrt(0.5), rel=1e-4)
    # quarter turn, east then north: no turn error to first order; the floor of means 1e-10 rad/s
    assert sigma_minutes(90, table, ONE) < 0.02
    # Two gyros and no latitude: d/2 of each placement at any turn (a wide prior of latitude and
    # of 1 mrad of north rate leave 1e-3 of it).
    for turn in (180, 120, 90, 60):
        assert sigma_minutes(turn, table, TWO, estimated=True) == pytest.approx(sqrt(0.5), rel=5e-3)


def test_scale_error_at_half_and_quarter_turns():
    scale = Priors(gyro_bias=10 * DEG_H, accel_bias=1e-9, gyro_walk=1e-10, gyro_scale=0.002)
    assert sigma_minutes(180, scale, ONE) < 0.01
    # K = 0.2 % of the north reading: 0.002 rad
    assert sigma_minutes(90, scale, ONE) == pytest.approx(6.875, abs=0.01)


def test_noise_at_half_and_quarter_turns():
    walk = 0.003 * DEG_RT_H
    unit = Priors(gyro_bias=10 * DEG_H, accel_bias=1e-9, gyro_walk=walk)
    floor = walk / sqrt(3600) / (W * cos(HERE.latitude)) / MINUTE  # 1.03'
    assert sigma_minutes(180, unit, TWO) == pytest.approx(floor, rel=1e-3)
    assert sigma_minutes(90, unit, TWO) == pytest.approx(sqrt(2) * floor, rel=1e-3)
    # One gyro east then west loses nothing; east then north it doubles.
    assert sigma_minutes(180, unit, ONE) == pytest.approx(floor, rel=1e-3)
    assert sigma_minutes(90, unit, ONE) == pytest.approx(2 * floor, rel=1e-3)


def test_turn_pays_weighs_table_against_unit():
    def pays(bias, turn, gyros=(True, True, True), scale=0.0):
        priors = Priors(bias, 1e-9, scale, gyro_walk=1e-10, accel_walk=1e-10, turn=turn)
        return turn_pays(Rotation.from_matrix(EAST), HERE, priors, 600.0, gyros=gyros)

    coarse = pays(10 * DEG_H, MINUTE)
    assert coarse.one_position == pytest.approx(10 / 9.96651, rel=1e-5)  # rad, b/(W cos lat)
    assert coarse.pays
    assert coarse.half_turn / MINUTE == pytest.approx(sqrt(0.5), rel=1e-3)
    assert coarse.verdict.endswith("90 deg is the better turn")
    scaled = pays(10 * DEG_H, MINUTE, scale=0.002)
    assert scaled.half_turn < scaled.quarter_turn
    assert scaled.verdict.startswith("turns pay: heading sigma 0.0118 deg against 57.5 deg")
    assert scaled.verdict.endswith("180 deg is the better turn")
    fine = pays(1e-4 * DEG_H, 10 * MINUTE, scale=0.002)
    # A tight prior of bias keeps both; the turns add only their own error.
    assert not fine.pays
    assert fine.verdict.startswith("turns do not pay")
    with pytest.raises(AlignmentError, match="gyro_bias: not stated"):
        pays(0.0, MINUTE)


def test_half_turn_means_by_hand():
    first = np.array([1.0, 2, 3, 4, 5, 6])
    second = np.array([10.0, 20, 30, 40, 50, 60])
    want = [(1 - 10) / 2, (2 + 20) / 2, (3 - 30) / 2, (4 - 40) / 2, (5 + 50) / 2, (6 - 60) / 2]
    np.testing.assert_array_equal(half_turn_means(first, second), want)
    along_x = half_turn_means(first, second, axis=0)
    assert along_x[[0, 1, 3]].tolist() == [5.5, -9.0, 22.0]


def tilted_50():
    """Nose north and 5 deg down, roll 5 deg: Y1 leans north and east."""
    C_nue_b = Rotation.from_euler("YZX", [0, -5, 5], degrees=True).as_matrix()
    return np.column_stack([N, -D, E]) @ C_nue_b


def double_triad(bias_w, per_g=0.0):
    """TRIAD of the half-turn means at 50 deg: heading error [arc minutes], vertical rate over W."""
    C = tilted_50() @ TURNS["half turn"]
    y = readings_of(C, radians(50))
    y[:, :3] += bias_w
    y[:, :3] += per_g * y[:, 3:] / 9.80665
    m = half_turn_means(y[0], y[1])
    found = triad_attitude(m[:3], m[3:]).as_matrix()
    return error(found, C[0])[2] / MINUTE, m[:3] @ m[3:] / np.linalg.norm(m[3:]) / W


def test_biases_that_cancel_and_those_that_do_not():
    assert abs(double_triad([10 * DEG_H, 0, 10 * DEG_H])[0]) < 1e-6
    heading, ratio = double_triad([0, 10 * DEG_H, 0])
    # 10 sin 5 east, cos 50 and 10 sin 5 cos 5 north: methods.md section 2 says 283'
    by_hand = atan(10 * cos(radians(5)) * sin(radians(5)) / (15.04107 * cos(radians(50)) + 0.8682))
    assert abs(heading) == pytest.approx(60 * degrees(by_hand), abs=1.5)
    assert abs(heading) == pytest.approx(283, abs=1.5)
    assert ratio > 1.3  # no sine of a latitude


def test_g_sensitivity_does_not_cancel_when_tilted():
    # 1 deg/h/g of every gyro to its own axis: tilt 5 deg across, some half a degree
    heading, _ = double_triad([0, 0, 0], per_g=DEG_H)
    across = 60 * degrees(atan(sin(radians(5)) / (15.04107 * cos(radians(50)))))
    # Y1 sees 1 deg/h too, tilted back by 5 deg; what is left is of the order of one axis alone
    assert across == pytest.approx(31, abs=0.1)  # the number of methods.md section 2
    C = tilted_50() @ TURNS["half turn"]
    y = readings_of(C, radians(50))
    y[:, 2] += DEG_H * y[:, 5] / 9.80665  # Z1 alone, nearly east
    m = half_turn_means(y[0], y[1])
    alone = error(triad_attitude(m[:3], m[3:]).as_matrix(), C[0])[2] / MINUTE
    assert abs(alone) == pytest.approx(31, abs=0.5)
    assert abs(heading) < abs(alone)


# --- how long noise takes ------------------------------------------------------------------------


def test_times_that_noise_needs():
    days = [time_needed(1.3 * MINUTE, radians(45), arw * DEG_RT_H) / 86400 for arw in (0.15, 0.6)]
    assert days[0] == pytest.approx(58, abs=0.5)  # methods.md section 2
    assert days[1] == pytest.approx(930, abs=5)
    # 0.3 deg/h of bias instability: floor 0.3/(sqrt 2 10.6) = 1.1 deg, never 1.3'
    assert time_needed(1.3 * MINUTE, radians(45), 0.15 * DEG_RT_H, 0.3 * DEG_H) is None
    # rate random walk alone ends it too
    assert time_needed(1.3 * MINUTE, radians(45), 0.15 * DEG_RT_H, 0.0, 1e-3 * DEG_H) is None


@pytest.mark.parametrize(("instability", "rate_walk"), [(0.0, 0.0), (1e-3, 0.0), (1e-3, 1e-5)])
def test_time_needed_reaches_its_target(instability, rate_walk):
    walk, floor, k = 0.003 * DEG_RT_H, instability * DEG_H, rate_walk * DEG_H
    target = 2 * MINUTE
    seconds = time_needed(target, radians(48.5), walk, floor, k)
    tau = seconds / 2
    adev = sqrt(walk**2 / tau + floor**2 + k**2 * tau / 3)
    assert double_sigma(adev, radians(48.5)) == pytest.approx(target, rel=1e-12)  # rounding
    sooner = sqrt(walk**2 / (0.9 * tau) + floor**2 + k**2 * 0.9 * tau / 3)
    assert double_sigma(sooner, radians(48.5)) > target


# --- chi-square ----------------------------------------------------------------------------------

RUNS = 500
REGIMES = {  # priors, gyro [deg/rt-h]; 600 s, accelerometers 50 ug/rt-Hz
    "noise": (Priors(10 * DEG_H, MILLI_G), 0.05),
    "bias and scale": (Priors(10 * DEG_H, MILLI_G, 1e-3, 1e-4), 1e-4),
    "placement": (Priors(DEG_H, MILLI_G, 1e-4, 1e-5, turn=5 * MINUTE), 1e-4),
    "biases free": (Priors(), 0.05),
}
LATITUDES = (48.5, -33.0, 75.0, -75.0)
CASES = [(r, t, lat) for r in REGIMES for t in TURNS for lat in LATITUDES]
# Two-sided, family-wise 95 %: attitude of each case, and attitude with biases.
K = norm.ppf(1 - 0.025 / (2 * len(CASES)))


def simulated(priors, walk, relative, latitude, rng, runs):
    """Means (runs, n, 6), their variances as 32 blocks each would show them, true C, biases."""
    n = len(relative)
    bias = np.repeat([priors.gyro_bias, priors.accel_bias], 3) * rng.normal(size=(runs, 6))
    scale = np.repeat([priors.gyro_scale, priors.accel_scale], 3) * rng.normal(size=(runs, 6))
    placed = Rotation.from_rotvec(priors.turn * rng.normal(size=(runs * n, 3)))
    C = TILTED @ relative @ placed.as_matrix().reshape(runs, n, 3, 3)
    density = np.repeat([walk * DEG_RT_H, 50e-6 * 9.81], 3) * [0.5, 1, 1.5, 1.5, 1, 0.5]
    variance = np.tile(density**2 * n / 600.0, (n, 1))
    y = (1 + scale[:, None]) * readings_of(C, latitude) + bias[:, None]
    y = y + np.sqrt(variance) * rng.normal(size=(runs, n, 6))
    freedom = 31 * n
    shown = variance * rng.chisquare(freedom, size=(runs, 1, 6)) / freedom
    return y, shown, C, bias


def check_nees(x, P, freedom_of_variance):
    """Mean of x^T P^-1 x within K sigma of its bounds.

    Variances from f degrees of freedom inflate the expectation by at most f/(f - 2).
    """
    d = x.shape[-1]
    nees = np.mean(np.einsum("ni,ni->n", x, np.linalg.solve(P, x[..., None])[..., 0]))
    f = freedom_of_variance
    spread = K * sqrt(2 * d / len(x)) * f / (f - 4)
    assert d - spread < nees < d * f / (f - 2) + spread


@pytest.mark.slow
@pytest.mark.parametrize(("regime", "turns", "latitude"), CASES)
def test_covariances(regime, turns, latitude):
    """NEES of attitude (3) and of attitude with all biases (9): every cross term."""
    priors, walk = REGIMES[regime]
    seed = [61, *(CASES.index((regime, turns, latitude)).to_bytes(2, "big"))]
    rng = np.random.default_rng(seed)
    drawn = priors if priors.gyro_bias else Priors(10 * DEG_H, MILLI_G)
    relative, lat = TURNS[turns], radians(latitude)
    y, shown, C, bias = simulated(drawn, walk, relative, lat, rng, RUNS)
    fit = fit_positions(y, shown, relative, lat, G, priors)
    last = len(relative) - 1
    eta = error(fit.C_nb[:, last], C[:, last])
    P = fit.covariance[:, last]
    assert np.degrees(np.sqrt(P[:, 2, 2].mean())) < 8
    freedom = 31 * len(relative)
    check_nees(eta, P, freedom)
    whole = np.concatenate([eta, fit.biases - bias], axis=1)
    cross = fit.cross[:, last]
    P9 = np.block([[P, cross], [np.swapaxes(cross, 1, 2), fit.bias_covariance]])
    scale = np.concatenate([np.ones(3), np.full(3, 1e-4), np.full(3, 1.0)])  # near one size
    check_nees(whole / scale, P9 / np.outer(scale, scale), freedom)
    assert np.mean(fit.chi2) == pytest.approx(
        np.mean(fit.freedom), abs=K * sqrt(2 * 6 * len(relative) / RUNS) + 0.15 * len(relative)
    )


def test_latitude_is_estimated_with_its_sigma():
    relative = np.concatenate([about([0, 1, 0], 0, 120, 240), about([1, 0, 0], 90)])
    priors = Priors(10 * DEG_H, MILLI_G)
    for latitude in (48.5, -33.0):
        rng = np.random.default_rng(62)
        y, shown, C, _ = simulated(priors, 0.01, relative, radians(latitude), rng, RUNS)
        fit = fit_positions(y, shown, relative, None, G, priors)
        eta = np.column_stack([error(fit.C_nb[:, 0], C[:, 0]), fit.latitude - radians(latitude)])
        check_nees(eta[:, :3], fit.covariance[:, 0], 31 * 4)
        check_nees(eta[:, 3:], fit.latitude_sigma[:, None, None] ** 2, 31 * 4)


FLOOR_RUNS = 2000


@pytest.mark.parametrize("turns", ["half turn", "four"])
@pytest.mark.parametrize("latitude", [48.5, -33.0])
def test_white_noise_floor(turns, latitude):
    """RMS of heading over ``ARW/(W cos lat sqrt T)``: its 95 % interval meets [1.00, 1.10]."""
    relative, lat = TURNS[turns], radians(latitude)
    rng = np.random.default_rng(63)
    n = len(relative)
    floor = radians(4.0)
    walk = floor * W * cos(lat) * sqrt(600.0)
    variance = np.tile(np.repeat([walk**2, (50e-6 * 9.81) ** 2], 3) * n / 600.0, (n, 1))
    bias = np.repeat([10 * DEG_H, MILLI_G], 3) * rng.normal(size=(FLOOR_RUNS, 1, 6))
    y = readings_of(LEVEL @ relative, lat) + bias
    y = y + np.sqrt(variance) * rng.normal(size=(FLOOR_RUNS, n, 6))
    shown = variance * rng.chisquare(31 * n, size=(FLOOR_RUNS, 1, 6)) / (31 * n)
    # flat priors, so that nothing but the readings speaks
    fit = fit_positions(y, shown, relative, lat, G, Priors())
    ratio = sqrt(np.mean(error(fit.C_nb[:, 0], LEVEL)[:, 2] ** 2)) / floor
    low, high = sqrt(FLOOR_RUNS) / np.sqrt(chi2.ppf([0.975, 0.025], FLOOR_RUNS))
    assert ratio * high > 1.00
    assert ratio * low < 1.10


def test_pooled_variances_by_hand():
    variances = np.array([[2.0, 10.0], [4.0, 5.0]])
    # densities 20, 100 and 80, 100 per s; means 50, 100
    np.testing.assert_allclose(
        pooled_variances(variances, np.array([10.0, 20.0])), [[5, 10], [2.5, 5]], rtol=1e-15
    )


def test_sigmas_from_the_scatter_of_dwells():
    """The wrapper end to end: heading sigma at its floor, tan(lat) x tilt in its cross term."""
    relative = TURNS["half turn"]
    walk, force = 0.003 * DEG_RT_H, 1e-3 * 9.81
    sigmas = np.repeat([walk, force], 3) * sqrt(10)  # per sample at 10 Hz
    P = []
    for seed in range(40):
        dwells = dwells_of(LEVEL, relative, noise=(np.random.default_rng([64, seed]), sigmas))
        P.append(two_position(dwells, HERE, Options())[0].covariance)
    mean = np.mean(P, axis=0)
    tilt = force**2 / 40.0 / G**2
    turned = (walk / (W * cos(HERE.latitude))) ** 2 / 40.0
    # 40 variances of 62 degrees of freedom scatter by 2.8 %: four times
    np.testing.assert_allclose(np.diag(mean)[:2], [tilt, tilt], rtol=0.12)
    assert mean[2, 2] == pytest.approx(turned + tan(HERE.latitude) ** 2 * tilt, rel=0.12)
    assert mean[0, 2] == pytest.approx(-tan(HERE.latitude) * tilt, rel=0.12)


# --- the instrument's seat, drift between positions -----------------------------------------------


@pytest.mark.parametrize("latitude", [48.5, -33.0])
def test_a_seat_off_is_one_unknown_of_all_positions(latitude):
    """NEES of four positions whose turns are those about axes that a seat of 30'' turns in b."""
    runs, lat = 200, radians(latitude)
    rng = np.random.default_rng([61, latitude > 0])
    priors = Priors(gyro_bias=DEG_H, accel_bias=0.05 * MILLI_G, seat=30 * MINUTE / 60)
    told = Rotation.from_rotvec(np.outer(np.arange(4) * pi / 2, [0, 1, 0]))
    sigma = np.repeat([1e-4 * DEG_H, 1e-6], 3)
    y, C_0 = np.zeros((runs, 4, 6)), Rotation.from_matrix(EAST)
    for run in range(runs):
        seat = Rotation.from_rotvec(priors.seat * rng.normal(size=3))
        bias = np.repeat([priors.gyro_bias, priors.accel_bias], 3) * rng.normal(size=6)
        for k, turn in enumerate(told):
            C_bn = (C_0 * seat.inv() * turn * seat).inv()
            w_n = W * np.array([cos(lat), 0, -sin(lat)])
            felt = np.concatenate([C_bn.apply(w_n), C_bn.apply([0, 0, -G])])
            y[run, k] = felt + bias + sigma * rng.normal(size=6)
    fit = fit_positions(y, np.tile(sigma**2, (4, 1)), told.as_matrix(), lat, G, priors)
    eta = Rotation.from_matrix(fit.C_nb[:, 0] @ EAST.T).as_rotvec()
    P = fit.covariance[:, 0]
    mean = np.mean(np.einsum("ri,ri->r", eta, np.linalg.solve(P, eta[..., None])[..., 0]))
    low, high = chi2.ppf([0.0125, 0.9875], 3 * runs) / runs  # two latitudes, 95 %
    assert low < mean < high


def test_drift_between_positions_by_hand():
    """Barnes (1969), Tables of bias functions, NBS TN 375: flicker over n positions on end scatters
    by ``n ln n / (2 (n - 1) ln 2)`` of its Allan variance: 1 of two, 4/3 of four."""
    priors = Priors(gyro_instability=3.0, accel_instability=2.0)
    for n, ratio in ((2, 1.0), (4, 4 / 3)):
        # about the common mean: what all positions share is a bias
        apart = np.eye(n) - 1 / n
        D = apart @ drift_covariance(priors, equal_spans(n, 100.0 * n)) @ apart
        scatter = np.trace(D, axis1=1, axis2=2) / (n - 1)
        # five processes a decade apart keep their plateau within some per cent
        np.testing.assert_allclose(scatter, [9 * ratio, 4 * ratio], rtol=0.08)


def test_walk_and_ramp_between_positions_by_hand():
    """Two means of T on end differ by K sqrt(2 T/3) of a walk, and by r T of a ramp."""
    spans = equal_spans(2, 200.0)
    walk = drift_covariance(Priors(gyro_random_walk=3.0), spans)
    ramp = drift_covariance(Priors(accel_ramp=2.0), spans)
    apart = np.array([1.0, -1.0])
    assert apart @ walk[0] @ apart == pytest.approx(9.0 * 2 * 100.0 / 3, rel=1e-12)
    assert apart @ ramp[1] @ apart == pytest.approx((2.0 * 100.0) ** 2, rel=1e-12)
    assert not walk[1].any()
    assert not ramp[0].any()
    # beside the bias that was switched on: K^2 T/3, then K^2 (T + T/3); r T/2, then 3 r T/2
    np.testing.assert_allclose(walk[0], [[300.0, 450.0], [450.0, 1200.0]], rtol=1e-12)
    np.testing.assert_allclose(ramp[1], [[1e4, 3e4], [3e4, 9e4]], rtol=1e-12)


def test_the_bias_that_was_switched_on_is_found_by_hand():
    """A ramp r known to s/10 per second; means at 10 and 30 s, each of noise s, along the vertical.

    Weights w and 1 - w leave ``s^2 (w^2 + (1 - w)^2 + (3 - 2 w)^2)`` of the bias at 0 s: least at
    w = 7/6, with 11/6 s^2. Their mean, w = 1/2, would leave 9/2.
    """
    s = 1e-5
    drift = drift_covariance(Priors(accel_ramp=s / 10), [Span(0.0, 20.0), Span(20.0, 20.0)])
    lat, relative = HERE.latitude, TURNS["half turn"]
    y = readings_of(LEVEL @ relative, lat)
    y[:, 4] += [6e-3, 12e-3]
    variances = np.tile(np.repeat([1e-14, s**2], 3), (2, 1))
    fit = fit_positions(y, variances, relative, lat, G, Priors(), drift=drift)
    assert fit.biases[4] == pytest.approx(7 / 6 * 6e-3 - 12e-3 / 6, rel=1e-3)
    assert fit.bias_covariance[4, 4] == pytest.approx(11 / 6 * s**2, rel=1e-3)


def test_a_drift_that_hides_a_bias_is_no_fault_of_the_turns():
    """Of a bias of 1 deg/h that has drifted by as much since, half a variance can be told: it is.

    Along the vertical gravity is all of 9.8 m/s^2, of which nothing is known: that is the turn's.
    """
    drift = np.zeros((6, 2, 2))
    drift[:3], lat = DEG_H**2, HERE.latitude
    relative, priors = TURNS["half turn"], Priors(gyro_bias=DEG_H, accel_bias=0.1 * MILLI_G)
    variances = np.tile(np.repeat([1e-12, 1e-6], 3) ** 2, (2, 1))
    fit = fit_positions(
        readings_of(LEVEL @ relative, lat), variances, relative, lat, None, priors, drift=drift
    )
    sigmas = np.sqrt(np.diag(fit.bias_covariance))
    np.testing.assert_allclose(sigmas[:3], DEG_H * sqrt(0.5), rtol=1e-3)
    np.testing.assert_array_equal(fit.unseen, [False, False, False, False, True, False])


def test_what_is_left_to_switching_on_by_hand():
    """Flicker of plateau 1: five processes of 1/0.76475, three of which outlast a minute."""
    told = switched_on(Priors(gyro_bias=3.0, gyro_instability=1.0, accel_bias=2.0))
    assert told.gyro_bias == pytest.approx(sqrt(9 - 3 / 0.76475**2), rel=1e-12)
    assert told.accel_bias == 2.0
    # all of it drifts: one that is stated stays so, one that nobody knows too
    told = switched_on(Priors(gyro_bias=1.0, gyro_instability=1.0, accel_instability=1.0))
    assert (told.gyro_bias, told.accel_bias) == (0.01, 0.0)


@pytest.mark.parametrize("instability", [0.0, 0.3])
def test_biases_are_known_as_well_as_they_are_predicted_to_be(instability):
    """Drifts for hours: the fit's sigmas beside those of `alignment.information`, by other code."""
    priors = Priors(
        gyro_bias=DEG_H,
        gyro_walk=0.1 * DEG_RT_H,
        gyro_instability=instability * DEG_H,
        gyro_random_walk=0.3 * DEG_H / 60,
        gyro_ramp=0.3 * DEG_H / 3600,
        accel_bias=0.2 * MILLI_G,
        accel_walk=5e-4,
        accel_instability=instability * 0.05 * MILLI_G,
        accel_random_walk=0.02 * MILLI_G / 60,
        accel_ramp=0.02 * MILLI_G / 3600,
    )
    relative = np.concatenate([TURNS["four"], about([1, 0, 0], 90, 180)])
    spans = [Span(start, T) for start, T in zip(np.cumsum([50.0, *[1500.0] * 5]), [5, *[900] * 5])]  # noqa: B905
    rests = [
        Stretch(f"{k}", s.start, s.length, Rotation.from_matrix(TILTED @ R))
        for k, (s, R) in enumerate(zip(spans, relative, strict=True))
    ]
    site = Site(HERE.latitude, local_gravity=G)
    known = known_to(rests, site, Options(priors=priors))
    told, lengths = switched_on(priors), np.array([s.length for s in spans])
    density = np.repeat([priors.gyro_walk, priors.accel_walk], 3) ** 2
    fit = fit_positions(
        readings_of(TILTED @ relative, HERE.latitude),
        density / lengths[:, None],
        relative,
        HERE.latitude,
        G,
        told,
        drift=drift_covariance(told, spans),
    )
    labels = [f"{s} bias {a}" for s in ("gyro", "accelerometer") for a in ("X1", "Y1", "Z1")]
    expected = [known.sigma(label) for label in labels]
    np.testing.assert_allclose(np.sqrt(np.diag(fit.bias_covariance)), expected, rtol=1e-4)
    for k in range(6):
        np.testing.assert_allclose(
            np.diag(fit.covariance[k]),
            np.diag(known.covariance(known.attitude_rows(k))),
            rtol=1e-4,
        )


def test_steady_drift_by_hand():
    """From end to end of T: r T of a ramp, K sqrt(4 T/3) of a walk, whenever it begins."""
    span = Span(500.0, 90.0)
    ramp = steady_drift(Priors(gyro_ramp=2.0), span)
    walk = steady_drift(Priors(accel_random_walk=3.0), span)
    np.testing.assert_allclose(ramp, [(2.0 * 90.0) ** 2, 0.0], rtol=1e-9)
    np.testing.assert_allclose(walk, [0.0, 9.0 * 4 * 90.0 / 3], rtol=1e-9)
