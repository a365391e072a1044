"""What every catalogue entry and every estimator owes; a new one is tested without a line here."""

import ast
import re
from dataclasses import replace
from pathlib import Path

import chain
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from alignment import ESTIMATORS, Dwell, ImuReadings, Method, Options, Priors, Site, Turn
from alignment.calibration.session import Session, Station
from alignment.errors import NotAtRest, PoleError
from alignment.information import Stretch
from alignment.methods.rocking_gains import inertial_functional
from alignment.methods.triad import triad_gains
from alignment.methods.vectors import Fixes
from alignment.navigation import ecef
from alignment.sources import SOURCES
from alignment.units import DEG, DEG_PER_HOUR, DEG_PER_RT_HOUR, MILLI_G
from stand import toml_files as catalogue
from stand.imu import Imu, Stated, load_imu
from stand.motion.limits import check
from stand.motion.planner import plan
from stand.physics.mjcf import describe, load_model
from stand.procedure.procedure import load_procedure
from stand.procedure.steps import DwellStep as DwellStep
from stand.samples import TruthBlock
from stand.table.kinematics import attitude
from stand.table.table import load_table
from stand.vehicle.path import Start
from stand.vehicle.scenario import Leg, path_of, sense

ROOT = Path(__file__).resolve().parents[1]
STAND = describe(load_model())
LATITUDE = 48.5 * DEG
SITE = Site(LATITUDE)
# Earth rate and gravity in NED at 48.5 deg by hand: methods.md section 0
W_N = np.array([9.96651, 0.0, -11.26509]) * DEG / 3600
F_N = np.array([0.0, 0.0, -9.8093587])
OPTIONS = Options(offset_window=10.0)
TOLD = replace(  # a tactical unit, as its data sheet says
    OPTIONS,
    priors=Priors(
        gyro_bias=5 * DEG_PER_HOUR,
        accel_bias=2 * MILLI_G,
        gyro_walk=0.15 * DEG_PER_RT_HOUR,
        accel_walk=1e-3,
    ),
)
RATE = 10  # Hz
# five attitudes no axis of which is level or vertical, and the level one
NOT_TURNED = Rotation.identity()
Y1 = np.array([0.0, 1, 0])
LEVEL = Rotation.from_matrix([[1, 0, 0], [0, 0, 1], [0, -1, 0]])  # X1 north, Y1 up, Z1 east
ATTITUDES = Rotation.from_euler(
    "ZYX", [[0, 0, 0], [30, 20, 10], [-120, 35, 60], [200, -50, 170], [80, 5, -95]], degrees=True
)


# --- procedures


@pytest.mark.parametrize("name", catalogue.ids("procedures"))
def test_every_procedure_plans_and_names_its_dwells(name):
    procedure = load_procedure(name)
    assert procedure.entry.title
    assert procedure.entry.description
    assert procedure.text
    planned = plan(procedure, STAND, load_table(procedure.entry.table))
    wanted = [s for s in procedure.entry.step if isinstance(s, DwellStep)]
    rests = [s for s in planned.stretches if s.turning is None]
    assert [d.label for d in rests] == [s.label for s in wanted]
    labels = [s.label for s in planned.stretches]
    assert len(set(labels)) == len(labels)
    check(procedure, planned, load_table(procedure.entry.table))  # keeps the table's limits
    for turning in planned.stretches:
        if turning.turning is not None:
            t = np.linspace(turning.steady_from, turning.steady_to, 9)
            rates = planned.motion.joints(t)[1][:, turning.turning.axis]
            assert rates == pytest.approx([turning.turning.rate] * 9, rel=1e-9)
    for dwell, step in zip(rests, wanted, strict=True):
        assert dwell.t_to - dwell.t_from == pytest.approx(step.duration_s, abs=1e-9)
        there = attitude(STAND, dwell.joints)
        assert (there.inv() * dwell.C_nb).magnitude() < 1e-14
        middle = (dwell.t_from + dwell.t_to) / 2
        joints, rates, accelerations = planned.motion.joints([middle])
        still = planned.rests[planned.steps.index(dwell)]
        assert joints[0, still] == pytest.approx(dwell.joints[still], abs=1e-15)
        assert not rates[0, still].any()
        assert not accelerations[0, still].any()


@pytest.mark.parametrize("name", catalogue.ids("procedures"))
def test_a_rest_is_called_after_the_axis_that_stands_up(name):
    """By the chain that is written by hand: "Z1 down" is where the accelerometer reads -g."""
    procedure = load_procedure(name)
    planned = plan(procedure, STAND, load_table(procedure.entry.table))
    for stretch in planned.stretches:
        named = re.search(r"([XYZ])1 (up|down)\b", stretch.label)
        if named is None or stretch.kind != "dwell":
            continue
        q, *_ = planned.motion.joints(np.array([(stretch.t_from + stretch.t_to) / 2]))
        C_wb, _ = chain.pose(q)  # w is east, north, up
        up = C_wb[0, 2, "XYZ".index(named[1])]
        # 0.6: the edges of twelve positions are called after one of the two axes that stand up
        assert up * {"up": 1, "down": -1}[named[2]] > 0.6, stretch.label


@pytest.mark.parametrize("name", catalogue.ids("procedures"))
def test_every_procedure_gives_its_estimators_what_they_need(name):
    entry = load_procedure(name).entry
    for method in entry.estimate.methods:
        if ESTIMATORS[method].needs_latitude:
            entry.site.site().horizontal_rate()  # raises at a pole
        if ESTIMATORS[method].needs_offset:
            rests = [s.duration_s for s in entry.step if isinstance(s, DwellStep)]
            assert min(rests) >= entry.estimate.offset_window_s


# --- presets


def stated_values(name: str) -> dict[str, Stated | None]:
    entry = load_imu(name).entry
    return {
        f"{sensor}.{key}": getattr(getattr(entry, sensor), key)
        for sensor in ("gyro", "accel")
        for key in type(getattr(entry, sensor)).model_fields
    }


@pytest.mark.parametrize("name", catalogue.ids("imus"))
def test_every_preset_states_its_values_with_kind_and_source(name):
    spec = load_imu(name)
    assert spec.title
    assert spec.entry.grade
    stated = {key: value for key, value in stated_values(name).items() if value is not None}
    assert {"gyro.turn_on_bias_deg_h", "gyro.angle_random_walk_deg_rt_h"} <= set(stated)
    assert {"accel.turn_on_bias_mg", "accel.velocity_random_walk_m_s_rt_h"} <= set(stated)
    for value in stated.values():
        assert value.kind
        assert len(value.source) > 10  # a document or a file, not a word
    if spec.entry.evidence == "none":
        assert {value.kind for value in stated.values()} == {"assumed"}


@pytest.mark.parametrize("name", catalogue.ids("imus"))
def test_every_preset_reports_finite_samples_of_stated_size(name):
    spec = load_imu(name)
    n = 400
    still = np.tile([0.0, 0, 0, 1], (n, 1))
    w, f = np.tile(W_N, (n, 1)), np.tile(F_N, (n, 1))
    truth = TruthBlock(
        np.arange(1, n + 1) * 10_000_000, w, f, still, np.zeros((n, 6)), w @ np.ones((3, 6))
    )
    reported = Imu(spec, 3, 100).report(truth)
    for values, perfect, triad, size in (
        (reported.w_ib_b, w, spec.gyro, 7.3e-5),
        (reported.f_b, f, spec.accel, 9.81),
    ):
        constant = triad.bias + (triad.scale + 2 * triad.misalignment) * size
        bound = 6 * (constant + triad.noise * 10)  # 6 sigma of all terms; sqrt(100 Hz) = 10
        assert (np.abs(values - perfect) <= bound).all()


# --- tables


@pytest.mark.parametrize("name", catalogue.ids("tables"))
def test_every_table_has_limits_for_all_axes(name):
    table = load_table(name)
    assert table.title
    assert table.outside(np.zeros(6)) == []
    for limits in (table.rate, table.acceleration, table.jerk):
        assert (limits > 0).all()
        assert np.isfinite(limits).all()


# --- estimators


def rest(label: str, C_nb: Rotation, t_from: float, seconds: float = 30.0) -> Dwell:
    """A dwell of perfect, constant readings, at its nominal attitude."""
    n = round(seconds * RATE)
    t = t_from + np.arange(1, n + 1) / RATE
    C_bn = C_nb.inv()
    w, f = np.tile(C_bn.apply(W_N), (n, 1)), np.tile(C_bn.apply(F_N), (n, 1))
    return Dwell(label, t_from, t_from + seconds, ImuReadings(t, w, f), C_nb)


def rests(turned: Rotation = NOT_TURNED) -> list[Dwell]:
    return [rest(f"P{k}", turned * C_nb, 100.0 * k) for k, C_nb in enumerate(ATTITUDES)]


def turns(turned: Rotation = NOT_TURNED) -> list[Dwell]:
    """Three headings, level: each turns twice round about Y1 in 30 s, means as perfect gyros."""
    made = []
    angle = 4 * np.pi / 300 * np.arange(301)  # 30 s at 10 Hz
    half = 4 * np.pi / 600
    for k, heading in enumerate((0.0, 70.0, -160.0)):
        start = turned * Rotation.from_euler("z", heading, degrees=True) * LEVEL
        middle = start * Rotation.from_rotvec((angle[1:, None] - half) * Y1)
        # what turns past the axes, cos and sin, has a mean of sin(half)/half of its middle
        w = middle.inv().apply(W_N) * [np.sin(half) / half, 1, np.sin(half) / half]
        f = np.tile(start.inv().apply(F_N), (300, 1))  # along Y1
        t = 100.0 * k + np.arange(1, 301) / RATE
        readings = ImuReadings(t, w + 4 * np.pi / 30 * Y1, f)
        turn = Turn(Y1, angle[1:])
        made.append(Dwell(f"T{k}", 100.0 * k, 100.0 * k + 30, readings, start, turn))
    return made


def roads(turned: Rotation = NOT_TURNED) -> list[Dwell]:
    """Two headings, level: each from rest to 30 m/s in 30 s, perfect fixes once a second."""
    made = []
    for k, heading in enumerate((0.0, 70.0)):
        C_nb = turned * Rotation.from_euler("z", heading, degrees=True) * LEVEL
        north, east, _ = C_nb.apply([1.0, 0.0, 0.0])
        start = Start(LATITUDE, heading=float(np.arctan2(east, north)))
        path = path_of(start, [Leg(label="away", duration_s=30, speed_m_s=30)])
        felt, t = sense(path, RATE), np.arange(31.0)
        motion = path.at(t)
        fixes = Fixes(100.0 * k + t, motion.r_e, motion.v_e, 5.0, 0.05)
        readings = ImuReadings(100.0 * k + felt.t_ns * 1e-9, felt.w_ib_b, felt.f_b)
        made.append(Dwell(f"R{k}", 100.0 * k, 100.0 * k + 30, readings, C_nb, fixes=fixes))
    return made


def given(estimates):
    """Those with an attitude; a method's form without one says why."""
    assert all(e.C_nb is not None or e.flags for e in estimates)
    return [e for e in estimates if e.C_nb is not None]


def stretches(name: str, turned: Rotation = NOT_TURNED) -> list[Dwell]:
    """Perfect readings of what a method is for."""
    if ESTIMATORS[name].takes == "fixes":
        return roads(turned)
    if ESTIMATORS[name].needs_upright:
        headings = Rotation.from_euler("z", [[0], [40], [-130], [100]], degrees=True) * LEVEL
        return [rest(f"P{k}", turned * C_nb, 100.0 * k) for k, C_nb in enumerate(headings)]
    return turns(turned) if ESTIMATORS[name].takes == "turning" else rests(turned)


def planned(name: str) -> list[Stretch]:
    """The same as a plan has them."""
    turning = ESTIMATORS[name].takes == "turning"
    return [
        Stretch(d.label, d.t_from, d.t_to - d.t_from, d.nominal, 4 * np.pi / 30, Y1)
        if turning
        else Stretch(d.label, d.t_from, d.t_to - d.t_from, d.nominal)
        for d in stretches(name)
    ]


METHODS = pytest.mark.parametrize("name", list(ESTIMATORS))


@METHODS
def test_every_estimator_says_what_it_is(name):
    method = ESTIMATORS[name]
    assert method.title[0].isupper()
    assert re.match(r"\[(\w+)\] ", method.source)[1] in SOURCES
    assert "±" in method.note or "drift" in method.note
    assert name == name.lower()
    assert method.estimate.__doc__
    assert "Leading errors" in method.estimate.__doc__


@METHODS
def test_every_estimator_predicts_its_sigma_or_says_why_not(name):
    """By one of its ways; a reason is a sentence, not a word, and is not told of itself."""
    method = ESTIMATORS[name]
    if method.no_prediction:
        assert len(method.no_prediction.split()) > 8
        assert not method.no_prediction.endswith(".")
    elif method.gains is not None:
        answers = method.gains(planned(name), SITE, TOLD)
        assert answers
        for answer in answers:
            assert answer.gain.shape[0] == 3
            assert np.isfinite(answer.gain).all()
            assert len(answer.stretches) == len(answer.planned)
            assert answer.label in {s.label for s in planned(name)}
            assert answer.window in method.windows or not answer.window
    elif method.design is not None:
        stations = tuple(Station(s, np.zeros(0)) for s in planned(name))
        design = method.design(Session(stations, (), 0.1), SITE, TOLD)
        assert np.isfinite(design.covariance).all()
        # the readings tell something of every bias
        assert (np.sqrt(design.covariance.diagonal()) < design.sigmas)[:3].all()
    else:
        run = method.functional(stretches(name)[1].readings, SITE, TOLD)
        assert np.isfinite(run.gyro).all()
        assert run.gyro.any()
        assert (run.C_nb.inv() * stretches(name)[1].nominal).magnitude() < 3e-6  # hand numbers


@pytest.mark.parametrize(
    "ways",
    [
        {},
        {"gains": triad_gains, "no_prediction": "nobody knows"},
        {"gains": triad_gains, "functional": inertial_functional},
    ],
)
def test_a_method_says_one_thing_of_its_prediction(ways):
    with pytest.raises(ValueError, match="needs one of gains, functional, design, no_prediction"):
        Method(title="A", source="[S0] a", note="±", estimate=ESTIMATORS["rk4"].estimate, **ways)


NAMED = {  # files that may name a method: its own module, the list
    "alignment/estimators.py": None,
    "stand/recording/urdf.py": {"inertial"},  # a tag of URDF
}


def test_a_method_is_told_in_one_place():
    """No module but its own and the list holds a method's id, so that none asks for it by name."""
    own: dict[str, list[str]] = {}
    for package in ("alignment", "stand"):
        for path in sorted((ROOT / package).rglob("*.py")):
            file = path.relative_to(ROOT).as_posix()
            if NAMED.get(file, ()) is None:
                continue
            found = ids_in(path.read_text(encoding="utf-8")) - NAMED.get(file, set())
            for name in found:
                own.setdefault(name, []).append(file)
    for name, files in own.items():
        assert len(files) == 1, f"{name} is named in {files}"
        assert files[0].startswith("alignment/methods/"), f"{name} is named in {files}"
    assert set(own) == set(ESTIMATORS)


def ids_in(source: str) -> set[str]:
    """The methods' ids among the strings of a module."""
    nodes = ast.walk(ast.parse(source))
    strings = {n.value for n in nodes if isinstance(n, ast.Constant) and isinstance(n.value, str)}
    return strings & set(ESTIMATORS)


def test_a_name_is_seen():
    assert ids_in('if method == "inertial": pass') == {"inertial"}
    assert ids_in('"""An inertial method."""') == set()


@METHODS
def test_every_estimator_recovers_the_attitude_of_perfect_readings(name):
    dwells = stretches(name)
    estimates = given(ESTIMATORS[name].estimate(dwells, SITE, OPTIONS))
    truths = {d.label: d.nominal for d in dwells}
    assert len({e.label for e in estimates}) >= len(dwells) - 1  # or one per pair
    for e in estimates:
        assert e.method == name
        # the hand numbers of Earth rate and gravity hold to 1e-6 and 1e-8: so do the angles
        assert (truths[e.label].inv() * e.C_nb).magnitude() < 3e-6
        assert dwells[0].t_from <= e.t_from < e.t_to <= dwells[-1].t_to
        if e.latitude is not None:
            assert e.latitude == pytest.approx(LATITUDE, abs=1e-6)
        if e.covariance is not None:
            np.testing.assert_allclose(e.covariance, e.covariance.T, rtol=0, atol=1e-30)
            sizes = np.linalg.eigvalsh(e.covariance)
            assert (sizes >= -1e-15 * sizes[-1] - 1e-20).all()


@pytest.mark.parametrize("name", [n for n, m in ESTIMATORS.items() if m.alone])
def test_what_a_method_answers_alone_it_answers_so_among_others(name):
    ask, dwells = ESTIMATORS[name].estimate, stretches(name)

    def told(estimates):
        return [(e.label, e.window, e.C_nb.as_quat().tolist()) for e in given(estimates)]

    apart = [e for d in dwells for e in ask([d], SITE, OPTIONS)]
    assert told(ask(dwells, SITE, OPTIONS)) == told(apart)


@METHODS
def test_every_estimator_keeps_positions_apart(name):
    """The same dwells in another order give the same estimates, bit by bit."""
    forward = ESTIMATORS[name].estimate(stretches(name), SITE, OPTIONS)
    backward = ESTIMATORS[name].estimate(stretches(name)[::-1], SITE, OPTIONS)

    def attitudes(estimates):
        return {(e.label, e.window): e.C_nb.as_quat().tolist() for e in given(estimates)}

    assert attitudes(forward) == attitudes(backward)


@pytest.mark.parametrize("name", [n for n, m in ESTIMATORS.items() if not m.needs_offset])
def test_every_estimator_without_offset_turns_with_the_instrument(name):
    """Turned 25 deg to the west: so is the estimate, and nothing else changes."""
    turned = Rotation.from_rotvec([0, 0, -25 * DEG])  # about up is -D
    before, after = (
        given(ESTIMATORS[name].estimate(stretches(name, by), SITE, OPTIONS))
        for by in (NOT_TURNED, turned)
    )
    for a, b in zip(before, after, strict=True):
        turn = np.degrees((b.C_nb * a.C_nb.inv()).as_rotvec())
        assert turn == pytest.approx([0, 0, -25], abs=2e-4)  # 3e-6 rad: the hand numbers' digits


@pytest.mark.parametrize(
    "name", [n for n, m in ESTIMATORS.items() if m.takes in ("rest", "turning")]
)
@pytest.mark.parametrize("moved", ["tilted", "turned"])
def test_every_estimator_refuses_data_that_move(name, moved):
    first, second = stretches(name)[:2]
    w, f = second.readings.w_ib_b.copy(), second.readings.f_b.copy()
    if moved == "tilted":
        f[200:] = Rotation.from_euler("x", 1, degrees=True).apply(f[200:])
    else:
        w[200:220] += np.radians(0.5)
    readings = ImuReadings(second.readings.t, w, f)
    knocked = replace(second, label="knocked", readings=readings)
    with pytest.raises(NotAtRest, match=r"knocked: .* near 1"):
        ESTIMATORS[name].estimate([first, knocked], SITE, OPTIONS)


def standing(latitude: float, t_from: float) -> Fixes:
    """Perfect fixes of a vehicle that does not move for 30 s."""
    t = t_from + np.arange(31.0)
    place = np.tile(ecef(latitude, 0.0, 0.0), (31, 1))
    return Fixes(t, place, np.zeros((31, 3)), 5.0, 0.05)


@METHODS
def test_no_estimator_finds_a_heading_at_a_pole(name):
    """Rate and vertical along one line: refused, or the attitude that was known before."""
    n = 300
    t = np.arange(1, n + 1) / RATE
    rate = 4 * np.pi / 30 if ESTIMATORS[name].takes == "turning" else 0.0
    w, f = np.tile((7.292115e-5 + rate) * Y1, (n, 1)), np.tile(9.8321849 * Y1, (n, 1))
    turn = Turn(Y1, rate * t) if rate else None
    quarter = LEVEL * Rotation.from_rotvec(np.pi / 2 * Y1)
    dwells = [
        Dwell(
            f"pole {k}", 50.0 * k, 50.0 * k + 30, ImuReadings(50.0 * k + t, w, f), C_nb, turn, there
        )
        for k, C_nb, there in (
            (0, LEVEL, standing(90 * DEG, 0.0)),
            (1, quarter, standing(90 * DEG, 50.0)),
        )
    ]
    try:
        found = ESTIMATORS[name].estimate(dwells, Site(90 * DEG), OPTIONS)
    except PoleError:
        return
    assert ESTIMATORS[name].needs_offset or ESTIMATORS[name].carries_nominal
    for e, d in zip(found, dwells, strict=True):
        assert (d.nominal.inv() * e.C_nb).magnitude() < 1e-12  # rounding


@METHODS
def test_every_estimator_leaves_the_readings_alone(name):
    dwells = stretches(name)
    before = [(d.readings.w_ib_b.tobytes(), d.readings.f_b.tobytes()) for d in dwells]
    ESTIMATORS[name].estimate(dwells, SITE, OPTIONS)
    assert [(d.readings.w_ib_b.tobytes(), d.readings.f_b.tobytes()) for d in dwells] == before


@pytest.mark.parametrize("name", [n for n, m in ESTIMATORS.items() if m.tracks])
def test_tracks_end_where_the_estimates_are(name):
    method = ESTIMATORS[name]
    assert method.tracks is not None
    dwell = rests()[2]
    ends = {e.C_nb.as_quat().round(12).tobytes() for e in method.estimate([dwell], SITE, OPTIONS)}
    tracks = method.tracks(dwell, SITE, OPTIONS)
    assert tracks
    for track in tracks:
        assert track.label == dwell.label
        assert track.method.startswith(name)
        assert (np.diff(track.t) > 0).all()
        assert dwell.t_from <= track.t[0] < track.t[-1] <= dwell.t_to + 1e-9
        assert len(track.C_nb) == len(track.t)
        assert track.C_nb[-1].as_quat().round(12).tobytes() in ends
