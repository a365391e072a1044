"""Calibration on a table: hand numbers, closed forms, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from alignment import Dwell, ImuReadings, Site, Turn
from alignment.calibration import terms
from alignment.calibration.bench import Bench, freed, trusting
from alignment.calibration.calibrate import calibrate, with_budget
from alignment.calibration.design import Design, candidate
from alignment.calibration.fit import fitted
from alignment.calibration.model import Model
from alignment.calibration.observe import observed
from alignment.calibration.result import Key
from alignment.calibration.session import Session, Station
from alignment.errors import AlignmentError, NotAtRest, Saturated
from alignment.information import InstrumentErrors, Stretch, TriadErrors
from alignment.information.drift import flicker
from alignment.methods.calibration import calibration
from alignment.options import Options, Priors
from alignment.units import DEG

G = 9.81
SITE = Site(0.0, local_gravity=G)  # on the equator: Earth rate is level
RATE = 50
DOWN = np.array([0.0, 0.0, -G])  # specific force in n
# each axis up, and down: Z up is a turn by 180 deg about north from level
FACES = Rotation.from_euler(
    "xyz",
    [[0, 0, 0], [180, 0, 0], [90, 0, 0], [-90, 0, 0], [0, 90, 0], [0, -90, 0]],
    degrees=True,
)
WIDE = TriadErrors(noise=1e-5, bias=1.0, scale=0.1, misalignment=0.1, non_orthogonality=0.1)
BENCH = Bench(unit=InstrumentErrors(WIDE, WIDE), gravity_sigma=0.0)
W_N = np.array([7.292115e-5, 0.0, 0.0])  # on the equator, by hand


def rest(label, C_nb, t_from, seconds=10.0, change=lambda w, f: (w, f)):
    n = round(seconds * RATE)
    t = t_from + np.arange(1, n + 1) / RATE
    w, f = change(C_nb.inv().apply(W_N), C_nb.inv().apply(DOWN))
    readings = ImuReadings(t, np.tile(w, (n, 1)), np.tile(f, (n, 1)))
    return Dwell(label, t_from, t_from + seconds, readings, C_nb)


def faces(change=lambda w, f: (w, f), seconds=10.0):
    return [rest(f"F{k}", C, 100.0 * k, seconds, change) for k, C in enumerate(FACES)]


def value(calibration, sensor, term, axis, toward=None):
    own = {p.key: p for p in calibration.parameters}
    return own[Key(sensor, term, axis, toward)]


# --- hand numbers


def test_six_faces_give_scale_and_bias_of_plus_and_minus_g():
    """X up reads (1 + s) g + b = 9.81981 + 0.05, X down -9.81981 + 0.05, s = 1e-3, by hand."""

    def unit(w, f):
        return w, np.array([{9.81: 9.86981, -9.81: -9.76981}.get(round(f[0], 6), 0.05), *f[1:]])

    found = calibrate([observed(faces(unit), SITE)], BENCH, SITE)
    # priors of 1 and 0.1 pull by 1e-12 of themselves
    assert value(found, "accel", "bias", 0).value == pytest.approx(0.05, abs=1e-9)
    assert value(found, "accel", "scale", 0).value == pytest.approx(1e-3, abs=1e-9)
    assert value(found, "accel", "bias", 1).value == pytest.approx(0.0, abs=1e-9)
    assert value(found, "accel", "scale", 2).value == pytest.approx(0.0, abs=1e-9)
    assert value(found, "accel", "scale", 0).basis == "data"


def test_misalignment_is_what_a_sensor_feels_of_another_axis():
    """Y feels 2 mrad of X: 9.81 x 0.002 = 0.01962 with X up, by hand."""

    def unit(w, f):
        return w, f + np.array([0.0, 0.002 * f[0], 0.0])

    dwells = faces(unit)
    assert sorted({round(float(d.readings.f_b[0, 1]), 5) for d in dwells}) == pytest.approx(
        [-9.81, -0.01962, 0.0, 0.01962, 9.81]
    )
    found = calibrate([observed(dwells, SITE)], BENCH, SITE)
    assert value(found, "accel", "misalignment", 1, 0).value == pytest.approx(0.002, abs=1e-9)
    assert value(found, "accel", "misalignment", 0, 1).value == pytest.approx(0.0, abs=1e-9)


def test_sigmas_of_six_faces_in_closed_form():
    """Of y = b + s x with x = g, -g and four zeros: N/sqrt(6 T) and N/(g sqrt(2 T))."""
    quiet = replace(WIDE, misalignment=0.0, non_orthogonality=0.0)
    bench = Bench(unit=InstrumentErrors(quiet, quiet), gravity_sigma=0.0)
    found = calibrate([observed(faces(seconds=10.0), SITE)], bench, SITE)
    bias, scale = (value(found, "accel", term, 0).sigma for term in ("bias", "scale"))
    # the model's own floor of 1e-6 m/s^2 beside 1e-5/sqrt(10) = 3.2e-6 of noise in each mean
    each = np.hypot(1e-5 / np.sqrt(10.0), 1e-6)
    assert bias == pytest.approx(each / np.sqrt(6), rel=1e-6)
    assert scale == pytest.approx(each / (G * np.sqrt(2)), rel=1e-6)


def test_gravity_goes_into_the_accelerometers_scale_factors():
    """5 mGal of 9.81 m/s^2 is 5.1 ppm; nothing else knows the difference."""
    bench = replace(BENCH, gravity_sigma=5e-5)
    fit = fitted([observed(faces(), SITE)], bench, SITE)
    found = with_budget(fit, calibrate([observed(faces(), SITE)], bench, SITE))
    assert value(found, "accel", "scale", 1).sigma == pytest.approx(5e-5 / G, rel=2e-2)
    row = [p.key for p in found.parameters].index(Key("accel", "scale", 1))
    gravity = next(one for one in found.budget if one.name == "gravity")
    assert gravity.sigmas[row] == pytest.approx(5e-5 / G, rel=1e-3)


# --- moves and turns


def moved(scale=0.0, bias=0.0):
    """Level, then turned by 180 deg about X in 2 s at 90 deg/s, as gyros with such errors read."""
    n, edge = 10 * RATE, 10.0
    t = np.arange(1, 2 * n + 2 * RATE + 1) / RATE
    moving = (t > edge + 1e-9) & (t <= edge + 2.0 + 1e-9)
    turned = np.clip((t - 0.5 / RATE - edge) * 90 * DEG, 0.0, np.pi)
    C = Rotation.from_rotvec(np.outer(turned, [1.0, 0.0, 0.0]))
    w = C.inv().apply(W_N)
    w[:, 0] += 90 * DEG * moving
    w[:, 0] = (1 + scale) * w[:, 0] + bias
    readings = ImuReadings(t, w, C.inv().apply(DOWN))
    ends = (0.0, edge), (edge + 2.0, 2 * edge + 2.0)
    return [
        Dwell(f"M{k}", *span, readings, attitude)
        for k, (span, attitude) in enumerate(zip(ends, FACES[:2], strict=True))
    ]


def test_a_move_between_rests_gives_the_gyros_scale_factor():
    """1000 ppm of 180 deg is 0.18 deg; the rests alone tell nothing of it."""
    dwells = moved(scale=1e-3)
    seen = observed(dwells, SITE)
    (move,) = seen.session.moves
    assert move.length == pytest.approx(2.5, abs=0.03)  # 0.25 s into either rest, in whole samples
    x = np.array(Model([seen.session], BENCH, SITE).unknowns.expected)
    left = Model([seen.session], BENCH, SITE).left(seen.y, x)
    assert np.degrees(left[6]) == pytest.approx(0.18, rel=1e-4)  # and 1e-3 of Earth rate
    found = calibrate([seen], BENCH, SITE)
    # 7e-5 rad/s of Earth rate over 2.5 s is 1.8e-4 rad, of which the scale factor is a part
    assert value(found, "gyro", "scale", 0).value == pytest.approx(1e-3, rel=1e-5)
    assert value(found, "gyro", "scale", 0).basis == "data"
    still = replace(seen.session, moves=())
    alone = Design(Model([still], BENCH, SITE))
    at = list(alone.active).index(terms.columns_of("gyro", "scale").start)
    # Earth rate alone shows it to no better than its prior of 10 %
    assert np.sqrt(alone.covariance[at, at]) > 0.01


def test_a_warm_unit_is_warm_in_moves():
    """10 K of 100 ppm/K are 1000 ppm, which is 0.18 deg of 180 deg."""
    seen = observed(moved(scale=1e-3), SITE, lambda t: np.full(len(t), 10.0))
    bench = replace(BENCH, temperature_scale=np.full(2, 1e-3))
    model = Model([seen.session], bench, SITE)
    x = np.array(model.unknowns.expected)
    cold = np.degrees(model.left(seen.y, x)[6])
    x[terms.columns_of("gyro", "temperature_scale")] = 1e-4
    assert cold == pytest.approx(0.18, rel=1e-4)
    assert np.degrees(model.left(seen.y, x)[6]) == pytest.approx(0.0, abs=1e-6)


def spun(label="S", t_from=0.0, rate=100 * DEG, turns=4, late=0.0, change=lambda w, f: (w, f)):
    """About X, level, means over samples that come `late`."""
    n = round(turns * 2 * np.pi / abs(rate) * RATE)
    t = t_from + np.arange(1, n + 1) / RATE
    angle = rate * (t - t_from)
    ends = [(angle - rate * late - back, angle) for back in (0.0, rate / RATE)]
    upper, lower = ends[0][0], ends[1][0]
    # of C_bn (0, 0, -g) about X1: (0, -g sin a, -g cos a), averaged over the sample
    f = np.stack(
        [
            np.zeros(n),
            -G * (np.cos(lower) - np.cos(upper)) / (upper - lower),
            -G * (np.sin(upper) - np.sin(lower)) / (upper - lower),
        ],
        axis=1,
    )
    w = np.tile([rate + W_N[0], 0.0, 0.0], (n, 1))
    w, f = change(w, f)
    level = Rotation.identity()
    turn = Turn(np.array([1.0, 0.0, 0.0]), angle)
    return Dwell(label, t_from, t_from + n / RATE, ImuReadings(t, w, f), level, turn)


def test_a_spin_about_the_horizontal_gives_the_accelerometers_lag():
    """At 100 deg/s a lag of 2 ms turns gravity by 0.2 deg, there and back: no axis does both."""
    bench = replace(BENCH, lag_sigma=np.full(2, 0.01), place_sigma=0.0)
    both = [spun(late=2e-3), spun("back", 100.0, -100 * DEG, late=2e-3)]
    found = calibrate([observed(both, SITE)], bench, SITE)
    for axis in (1, 2):
        # 4 turns are 14.4 s, whole samples: the rest is rounding and the pull of the prior
        assert value(found, "accel", "lag", axis).value == pytest.approx(2e-3, abs=1e-6)
    assert value(found, "accel", "lag", 1).basis == "data"
    assert value(found, "gyro", "scale", 0).value == pytest.approx(0.0, abs=1e-9)


def test_instants_of_a_spin_are_no_means_that_come_half_a_sample_early():
    """At 100 deg/s and 50 Hz half a sample is a degree of gravity: 0.17 m/s^2 each way."""
    dwells = faces()
    for label, way in (("S", 1), ("back", -1)):
        turn = spun(label, 1000.0 + 100 * way, way * 100 * DEG)
        C_nb = Rotation.from_rotvec(turn.turn.angle[:, None] * [1.0, 0.0, 0.0])
        w = np.tile([way * 100 * DEG, 0.0, 0.0], (len(turn.readings), 1)) + C_nb.inv().apply(W_N)
        instants = replace(turn.readings, w_ib_b=w, f_b=C_nb.inv().apply(DOWN), instants=True)
        dwells.append(replace(turn, readings=instants))
    found = calibration(dwells, SITE, Options(priors=Priors(gyro_walk=1e-6, accel_walk=1e-4)))
    assert not [flag for e in found for flag in e.flags if "left out" in flag]
    told = found[0].calibration
    for axis in (1, 2):
        assert value(told, "accel", "lag", axis).value == pytest.approx(0.0, abs=1e-5)


def test_an_arm_that_priors_have_is_sought():
    """0.1 m from the axis, at 100 deg/s, are pulled by 0.305 m/s^2."""
    arm = np.array([0.0, 0.1, 0.0])
    pull = (100 * DEG) ** 2 * arm
    # about X1: the pull is outward along Y1, against it in specific force
    dwells = [*faces(), spun("S", 1000.0, change=lambda w, f: (w, f - pull))]
    told = Options(priors=Priors(gyro_walk=1e-6, accel_walk=1e-4, lever_arm=0.1))
    assert not [flag for e in calibration(dwells, SITE, told) for flag in e.flags]
    blind = replace(told, priors=replace(told.priors, lever_arm=0.0))
    assert [flag for e in calibration(dwells, SITE, blind) for flag in e.flags]


@pytest.mark.parametrize("known", [12e-3, 0.0])
def test_a_lag_that_priors_have_tilts_nothing(known):
    """12 ms late at 100 deg/s are 1.2 deg of gravity; known, or of no sheet (10 ms, 1 sigma)."""
    priors = Priors(gyro_walk=1e-6, accel_walk=1e-4, nominal=0.01, lag=known, accel_bias=0.01)
    dwells = [rest("F", FACES[0], 0.0), spun("S", 100.0, late=12e-3)]
    dwells.append(spun("back", 200.0, -100 * DEG, late=12e-3))
    (found,) = calibration(dwells, SITE, Options(priors=priors))
    assert not found.flags
    assert np.degrees(found.C_nb.as_rotvec()) == pytest.approx([0.0, 0.0, 0.0], abs=1e-6)
    assert value(found.calibration, "accel", "lag", 1).value == pytest.approx(12e-3, abs=1e-5)


# --- the machine


def session():
    """Rests and a spin, planned."""
    stretches = [Stretch(f"P{k}", 20.0 * k, 15.0, C) for k, C in enumerate(FACES)]
    stretches.append(Stretch("S", 200.0, 14.4, FACES[0], 100 * DEG, np.array([1.0, 0, 0])))
    return Session(tuple(Station(s, np.zeros(0)) for s in stretches), (), 1 / RATE)


def drifting(sigma=1e-4):
    triad = replace(WIDE, drift=flicker(sigma), asymmetry=1e-4, g_sensitivity=1e-5)
    return Bench(
        unit=InstrumentErrors(triad, triad),
        gravity_sigma=1e-4,
        seat=1e-4,
        placement=1e-5,
        tilt=1e-5,
        azimuth=1e-5,
    )


def test_the_jacobian_is_that_of_the_readings():
    """Against central differences: what is left is second order, 1e-6 of a step's square."""
    model = Model([session()], freed(drifting(), ["k2", "k3"]), SITE)
    design = Design(model)
    y, x = np.zeros(len(design.J)), np.array(model.unknowns.expected)
    for at in design.active:
        step = np.zeros(len(x))
        step[at] = 1e-3 * model.unknowns.sigmas[at]
        change = model.left(y, x - step) - model.left(y, x + step)
        off = (change / (2 * step[at]) - design.J[:, at]) * model.unknowns.sigmas[at]
        assert np.abs(design.whitened(off)).max() < 2e-3, design.source(int(at))


def test_contributions_add_up_to_the_variances():
    design = Design(Model([session()], drifting(), SITE))
    rows = np.eye(len(design.active))
    parts = design.contributions(rows)
    total = sum(part**2 for part in parts.values())
    np.testing.assert_allclose(total, design.covariance.diagonal(), rtol=1e-6)
    assert {"gyro white noise", "accelerometer bias instability", "seat", "gravity"} <= set(parts)


def test_information_of_candidates_adds_up_where_nothing_drifts():
    bench, planned = BENCH, session()
    design = Design(Model([planned], bench, SITE))
    names = design.model.unknowns.names
    told = [candidate(s, bench, SITE, planned.interval, names) for s in planned.stations]
    assert [c.seconds for c in told] == pytest.approx([15.0] * 6 + [14.4])
    information = sum(c.rows.T @ c.rows for c in told)
    whitened = design.whitened(design.J)
    whole = whitened.T @ whitened
    size = np.sqrt(whole.diagonal() + 1e-30)
    # entries of 1e12 beside such of 1e-2: rounding
    np.testing.assert_allclose((information - whole) / np.outer(size, size), 0, atol=1e-9)


def test_the_bias_of_the_session_is_known_better_than_that_of_switching_on():
    """A drift of 1e-4 is in the one, not in the other, whose sigma is the noise's."""
    found = calibrate([observed(faces(), SITE)], drifting(), SITE)
    mean = next(n for n in found.nuisance if n.name == "mean accel bias X1")
    on = value(found, "accel", "bias", 0)
    assert mean.sigma < 0.7 * on.sigma
    assert mean.unit == "m/s^2"


def test_a_table_that_is_trusted_claims_what_it_does_not_know():
    plain = calibrate([observed(faces(), SITE)], drifting(0.0), SITE)
    sure = calibrate([observed(faces(), SITE)], trusting(drifting(0.0)), SITE)
    key = ("accel", "misalignment", 0, 1)
    # the seat of 1e-4 rad, and placements of 1e-5
    assert value(plain, *key).sigma == pytest.approx(1e-4, rel=0.05)
    assert value(sure, *key).sigma < 2e-6


def test_known_constants_are_expected():
    keys = Key("accel", "bias", 0), Key("accel", "misalignment", 1, 0)
    values = dict.fromkeys((*keys, Key("accel", "misalignment", 0, 1)), 0.0)
    values |= {keys[0]: 0.05, keys[1]: 2e-3}
    known = tuple((key, x, 1e-5) for key, x in values.items())
    unknowns = Model([session()], replace(BENCH, known=known), SITE).unknowns
    told = terms.ALL.matrix @ unknowns.expected[: terms.COUNT]
    at = [terms.ALL.keys.index(key) for key, *_ in known]
    assert told[at] == pytest.approx([0.05, 2e-3, 0.0], abs=1e-15)


# --- what goes wrong


def test_a_bumped_rest_is_named_and_left_out():
    dwells = faces(seconds=20.0)
    dwells += [rest(f"again {k}", C, 1000.0 + 100 * k) for k, C in enumerate(FACES)]
    tilted = rest("bumped", Rotation.from_euler("y", 0.2, degrees=True), 2000.0)
    bumped = [*dwells, replace(tilted, nominal=FACES[0])]
    bench = replace(BENCH, placement=1e-5, seat=1e-5)
    found = calibrate([observed(bumped, SITE)], bench, SITE)
    assert [one.stretch for one in found.left_out] == ["bumped"]
    assert "contradicts all others" in found.left_out[0].reason
    assert found.enlarged == 1.0
    assert value(found, "accel", "scale", 0).value == pytest.approx(0.0, abs=1e-6)


def test_two_units_are_refused():
    bench = replace(BENCH, placement=1e-5, seat=1e-5)
    other = faces(lambda w, f: (w, 1.01 * f + 0.1))
    with pytest.raises(AlignmentError, match="contradict"):
        calibrate([observed(faces(), SITE), observed(other, SITE)], bench, SITE)


def knocked(t_from=0.0):
    one = rest("knocked", FACES[0], t_from)
    f = one.readings.f_b.copy()
    f[250:] = Rotation.from_euler("x", 2, degrees=True).apply(f[250:])
    return replace(one, readings=replace(one.readings, f_b=f))


def test_a_rest_that_moves_is_left_out_where_enough_are_left():
    found = observed([*faces(), knocked(1000.0)], SITE)
    assert [one.stretch for one in found.left_out] == ["knocked"]
    with pytest.raises(NotAtRest, match="knocked"):
        observed([knocked()], SITE)


def test_a_single_turn_that_contradicts_its_table_is_refused():
    """By 0.2 m/s^2 on every axis, where the sheet has a bias of 1 mm/s^2."""
    off = spun(change=lambda w, f: (w, f + 0.2))
    fine = TriadErrors(noise=1e-5, bias=1e-3)
    bench = Bench(unit=InstrumentErrors(fine, fine), gravity_sigma=0.0)
    with pytest.raises(AlignmentError, match=r"S contradicts .* and no other stretch is left"):
        fitted([observed([off], SITE)], bench, SITE)


def mirrored(w, f):
    return w * [1, -1, 1], f * [1, -1, 1]


@pytest.mark.parametrize(
    ("dwells", "said"),
    [
        ([], "no stretch"),
        ([rest("a", FACES[0], 0.0), rest("b", FACES[0], 50.0)], "one position only: .* 2 rests"),
        (faces(mirrored), "mirrored axes: Y1 reads -Y1"),
        (faces(lambda w, f: (w, f[[1, 2, 0]])), "other axes: X1 reads Y1, Y1 reads"),
        (faces(lambda w, f: (w, f / 9.81)), "another unit"),
        ([spun(change=lambda w, f: (-w, f))], "mirrored axes, or an encoder that counts"),
        ([spun(change=lambda w, f: (w * 180 / np.pi, f))], "taken for degrees"),
        ([spun(change=lambda w, f: (w * np.pi / 180, f))], "taken for radians"),
        ([spun(change=lambda w, f: (2 * w, f))], "another axis, joint or rate"),
        ([replace(rest("a", FACES[0], 0.0), nominal=None)], "a: its attitude is not known"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_one_line(dwells, said):
    with pytest.raises(AlignmentError, match=said) as caught:
        observed(dwells, SITE)
    assert "\n" not in str(caught.value)


def test_saturated_turns_are_refused():
    turn = spun(change=lambda w, f: (w, np.clip(f, -9.5, 9.5)))
    limited = replace(turn, readings=replace(turn.readings, ranges=(10.0, 9.5)))
    with pytest.raises(Saturated, match="S: "):
        observed([limited], SITE)


def test_gyros_that_turn_otherwise_in_a_move_are_refused():
    dwells = moved()
    readings = replace(dwells[0].readings, w_ib_b=0.8 * dwells[0].readings.w_ib_b)
    wrong = [replace(d, readings=readings) for d in dwells]
    with pytest.raises(AlignmentError, match="M0 to M1: the gyros turn 36 deg"):
        calibrate([observed(wrong, SITE)], BENCH, SITE)


def test_means_of_like_values_are_rounded_alike():
    """Noise of 0.2 steps: a mean errs by step/pi exp(-2 pi^2 0.04) = 0.14453 steps, by hand."""
    step = 1e-3
    bench = replace(BENCH, steps=np.array([0.0, step]), dither=np.array([0.0, 0.2 * step]))
    fit = Design(Model([session()], bench, SITE))
    rounding = fit.noises["accelerometer rounding"]
    rows = [own[3] for own in fit.model.rows()[0][:6]]  # X1's mean at each rest
    size = (0.14453 * step) ** 2 / 2
    flat = [k for k in range(6) if abs(FACES[k].inv().apply(DOWN)[0]) < 1e-6]
    assert len(flat) == 4
    a, b = rows[flat[0]], rows[flat[1]]
    assert rounding[a, b] == pytest.approx(size, rel=1e-3)
    up = next(k for k in range(6) if FACES[k].inv().apply(DOWN)[0] > 9)
    assert rounding[a, rows[up]] == 0.0
