"""`stand calibrate` on a table: against the simulator, against what units were given, outside."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from calibrated import case, outcomes, rms
from scipy.stats import chi2

import stand
from alignment.calibration import terms
from alignment.calibration.model import Model
from alignment.calibration.observe import observed
from alignment.units import ARC_SECOND, DEG_PER_HOUR, MICRO_G
from stand.calibration.on_table import on_table
from stand.calibration.truth import true_values
from stand.errors import StandError
from stand.simulation.monte_carlo import Trials
from stand.simulation.settings import table_errors_of
from stand.table.joints import JOINTS

ROOT = Path(stand.__file__).parents[1]
SHORT = """
title = "Six faces, one turn each way, a spin"
table = "{table}"
[site]
latitude_deg = 48.5
gravity_m_s2 = 9.80936
[estimate]
methods = ["calibration"]
"""
AT = [(0, 0, 0), (0, 0, 180), (0, 0, 90), (0, 0, -90), (0, 90, 0), (0, -90, 0)]


def move(label, outer, middle, inner):
    joints = f"{{ outer = {outer}, middle = {middle}, inner = {inner} }}"
    return f'[[step]]\nkind = "move"\nlabel = "to {label}"\njoints_deg = {joints}\n'


def rate(label, axis, turns):
    return (
        f'[[step]]\nkind = "rate"\nlabel = "{label}"\naxis = "{axis}"\nrate_deg_s = 100\n'
        f'turns = {turns}\ndirections = "both"\n'
    )


@pytest.fixture(scope="module")
def short(tmp_path_factory):
    """A quick calibration with rests, turns about the vertical and a spin."""
    text = SHORT.format(table="mid-class")
    for k, at in enumerate(AT):
        text += move(f"P{k}", *at)
        text += f'[[step]]\nkind = "dwell"\nlabel = "P{k}"\nduration_s = 8\n'
    for axis, k in (("Y", 0), ("Z", 2), ("X", 4)):
        text += move(f"{axis} up", *AT[k]) + rate(f"{axis} turns", "outer", 2)
    text += move("spin", 0, 0, 0) + rate("spin", "inner", 2)
    path = tmp_path_factory.mktemp("short") / "short.toml"
    path.write_text(text, encoding="utf-8")
    return str(path)


def table_values(errors):
    """The table's errors by the names of their leanings."""
    east, north = errors.base_tilt
    found = {"table tilt about east": east, "table tilt about north": north}
    found["table azimuth"] = errors.base_azimuth
    for axis, x in zip(("X1", "Y1", "Z1"), errors.mounting, strict=True):
        found[f"mounting about {axis}"] = x
    for k, joint in enumerate(JOINTS):
        found[f"placement of {joint}"] = errors.placement[k]
        found[f"non-orthogonality of {joint}"] = errors.non_orthogonality[k]
        for order, pair in ((1, errors.encoder_once), (2, errors.encoder_twice)):
            for part, x in zip(("cosine", "sine"), pair[k], strict=True):
                found[f"encoder of {joint}, {part} {order}"] = x
        n = errors.ripple_per_turn[k]
        for name, size, phase in (
            ("wobble", errors.wobble[k], errors.wobble_phase[k]),
            ("rate ripple", -errors.rate_ripple[k] / n, errors.ripple_phase[k]),
        ):
            found[f"{name} of {joint}, cosine"] = size * np.cos(phase)
            found[f"{name} of {joint}, sine"] = size * np.sin(phase)
    return found


def test_without_a_rest_there_are_constants_and_no_attitude(stand_command, tmp_path):
    """Two spins at 100 deg/s: a gyro's scale comes to noise over turns, an attitude to none."""
    spins = move("up", 0, 0, 0) + rate("up", "outer", 2) + move("over", 0, 90, 0)
    path = tmp_path / "spins.toml"
    text = SHORT.format(table="precision") + spins + rate("over", "outer", 2)
    path.write_text(text, encoding="utf-8")
    data = stand_command("run", path, "--rate", 50, "--out", tmp_path / "run", "--json").json
    (only,) = data["estimates"]
    assert only["label"] == "up +"
    assert only["flags"] == ["constants alone: a turning stretch has no attitude"]
    assert only["heading_deg"] is None
    scales = [one for one in only["constants"] if (one["sensor"], one["term"]) == ("gyro", "scale")]
    told = {one["axis"]: one["sigma"] for one in scales}
    # turns about Y1, then about X1; nothing turns about Z1
    assert max(told["X1"], told["Y1"]) < 0.1 * told["Z1"]
    plain = stand_command("run", path, "--rate", 50, "--out", tmp_path / "plain").out
    assert "calibration: no attitude" in plain


def test_the_model_is_the_simulators(short):
    """Without noise, told what unit and table really had: second orders are left, and no more."""
    quiet = ["white-noise", "bias-instability", "random-walk", "quantisation"]
    made = replace(case(short, "stim300", "mid-class", 100), without=tuple(quiet))
    trials = Trials(made)
    dwells, _ = trials.readings(3)
    seen = observed(dwells, made.site)
    model = Model([seen.session], made.options.bench, made.site)
    x = np.array(model.unknowns.expected)
    truth = true_values(terms.ALL.keys, *trials.units(3), made.unit)
    x[: terms.COUNT] = np.linalg.pinv(terms.ALL.matrix) @ truth
    values = table_values(table_errors_of(replace(made, seed=3)))
    for name in model.unknowns.names[1:]:
        x[model.unknowns.at(name)] = values[name]
    left, rows = model.left(seen.y, x), model.rows()[0]
    stations, moves = seen.session.stations, seen.session.moves
    assert len(stations) == 14
    assert len(moves) + len(seen.left_out) == 6  # one is too quick for these gyros
    assert all("full scale" in one.reason for one in seen.left_out)
    for station, own in zip(stations, rows, strict=False):
        half = len(own) // 2
        gyro, accel = np.abs(left[own[:half]]).max(), np.abs(left[own[half:]]).max()
        # (30'')^2 of a rate of 100 deg/s is 0.008 deg/h, the encoder's step over 7 s 0.05
        assert gyro < (0.1 if half > 3 else 1e-5) * DEG_PER_HOUR, station.stretch.label
        # its arm swings with 0.2 m/s^2, of which 30'' are 3 ug
        assert accel < (3.0 if half > 3 else 0.1) * MICRO_G, station.stretch.label
    off = np.abs(left[np.concatenate(rows[len(stations) :])])
    assert off.max() < 0.1 * ARC_SECOND  # noise of a move is 20'' of this unit


@pytest.mark.slow
@pytest.mark.parametrize(
    ("imu", "table"),
    [("stim300", "mid-class"), ("hg9900", "precision"), ("ring-laser", "precision"),
     ("adis16470", "mid-class")],
)  # fmt: skip
def test_sigmas_are_promises(short, imu, table):
    """NEES of 6 units within its bounds, once in a thousand each; `make proof` does fifty."""
    seeds = range(300, 306)
    made = case(short, imu, table, 100 if imu == "adis16470" else 50)
    plain, trusting = zip(*outcomes(made, seeds), strict=True)
    freedom = len(seeds) * plain[0].freedom
    low, high = chi2.ppf([5e-4, 1 - 5e-4], freedom) / freedom
    mean = np.mean([o.nees for o in plain]) / plain[0].freedom
    assert low < mean < high
    assert sum(o.left_out for o in plain) == 0
    name = "accel misalignment"
    if name in plain[0].errors:  # who trusts the table is wrong by the seat
        claimed = rms([o.sigmas[name] for o in trusting])
        assert rms([o.errors[name] for o in trusting]) > 1.2 * claimed


# --- from outside


@pytest.fixture(scope="module")
def recording(short, tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs") / "one"
    stand.run(stand.settings(short, imu="stim300", rate_hz=50, seed=7), out=folder)
    return folder


def test_a_recording_gives_parameters_with_errors(recording, stand_command, tmp_path):
    out = tmp_path / "c.json"
    outcome = stand_command("calibrate", str(recording), "--out", str(out), "--json")
    assert outcome.code == 0
    told = json.loads(out.read_text(encoding="utf-8"))
    assert told["parameters"] == outcome.json["parameters"]
    scaled = [p["error"] / p["sigma"] for p in told["parameters"] if p["told_by"] == "data"]
    assert len(scaled) > 15
    assert np.abs(scaled).max() < 4.5  # of 30 numbers: once in 5000
    assert told["source"]["table"] == "mid-class"
    assert told["gravity"] == {"value_m_s2": 9.80936, "sigma_m_s2": 2e-6}
    assert {"gyro white noise", "mounting", "gravity"} <= {b["source"] for b in told["budget"]}
    means = [n for n in told["nuisance"] if n["name"].startswith("mean gyro bias")]
    assert len(means) == 3


@pytest.mark.slow
def test_options_change_what_they_say(recording):
    run = stand.read(recording)
    plain = stand.calibrate(run)
    sure = stand.calibrate(run, trust_table=True)
    freed = stand.calibrate(run, free=["k2"])
    other = stand.calibrate(run, gravity_m_s2=9.80936, gravity_sigma_m_s2=3e-4)

    def sigma(found, term):
        return max(p.sigma for p in found.calibration.parameters if p.key.term == term)

    assert sigma(sure, "misalignment") < 0.5 * sigma(plain, "misalignment")
    assert "taken for perfect" in " ".join(sure.calibration.notes)
    assert {p.key.term for p in freed.calibration.parameters} >= {"k2"}
    assert not {p.key.term for p in plain.calibration.parameters} & {"k2"}
    assert sigma(other, "scale") > 30e-6 > sigma(plain, "scale")
    with pytest.raises(StandError, match="term 'kk': must be one of bias, scale"):
        stand.calibrate(run, free=["kk"])


def test_several_recordings_of_one_unit_share_its_constants(recording):
    made = stand.settings("tumble-6", imu="stim300", table="mid-class", rate_hz=10, seed=7)
    both = stand.calibrate([stand.read(recording), stand.simulate(made)])
    names = {n.name for n in both.calibration.nuisance}
    assert {"recording 2: gyro bias X1", "recording 1: mounting about X1"} <= names
    assert both.calibration.enlarged == 1.0
    other = stand.simulate(replace(made, seed=8))
    with pytest.raises(StandError, match="contradict"):
        stand.calibrate([stand.read(recording), other])


def test_a_servo_is_calibrated_by_its_encoders_after_its_run_ups(short):
    """A navigation-grade unit sees how the run-up shakes the other axes, by 2'' for half a second.

    Over 7 s that is 0.3 deg/h beside 0.04 deg/h of noise, or 0.8 ppm of its scale factors.
    """
    made = stand.settings(short, imu="hg9900", rate_hz=25, seed=6, motion="servo")
    found = stand.calibrate(stand.simulate(made))
    assert found.calibration.left_out == ()
    assert found.calibration.enlarged == 1.0
    scales = [n for n, p in enumerate(found.calibration.parameters)
              if (p.key.sensor, p.key.term) == ("gyro", "scale")]  # fmt: skip
    errors, sigmas = np.array(found.errors)[scales], found.calibration.sigmas[scales]
    assert np.all(sigmas < 0.4e-6)
    assert np.all(np.abs(errors) < 3.5 * sigmas)


def test_a_stand_of_ones_own_comes_with_its_recording(tmp_path):
    """Its model is what the recording has attached, or what was run in memory."""
    own = tmp_path / "own"
    shutil.copytree(ROOT / "models", own)
    text = (ROOT / "stand" / "tables" / "precision.toml").read_text(encoding="utf-8")
    (own / "mine.toml").write_text(f'model = "turntable.xml"\n{text}', encoding="utf-8")
    made = stand.settings("tumble-6", imu="stim300", table=own / "mine.toml", rate_hz=5, seed=2)
    here = stand.calibrate(stand.simulate(made)).calibration
    stand.run(made, out=tmp_path / "run")
    shutil.rmtree(own)
    there = stand.calibrate(stand.read(tmp_path / "run")).calibration
    np.testing.assert_allclose(there.sigmas, here.sigmas, rtol=1e-6)


LOG = """
table = "mid-class"
[site]
latitude_deg = 48.5
gravity_m_s2 = 9.80936
"""


@pytest.mark.slow
def test_a_log_of_ones_own_with_stretches_and_joint_angles(recording, tmp_path):
    """The same recording as a plain table of numbers, its stretches named by hand."""
    run = stand.read(recording)
    csv = tmp_path / "log.csv"
    table = np.column_stack([run.readings.t, run.readings.w_ib_b, run.readings.f_b])
    header = "time_s,gyro_x_rad_s,gyro_y_rad_s,gyro_z_rad_s,accel_x_m_s2,accel_y_m_s2,accel_z_m_s2"
    np.savetxt(csv, table, delimiter=",", header=header, comments="", fmt="%.9g")
    text = LOG
    origin = float(run.readings.t[0])
    for dwell in [d for d in run.dwells if d.turn is None]:
        joints = dict(zip(JOINTS, np.degrees(dwell.joints.angles).tolist(), strict=True))
        told = ", ".join(f"{name} = {angle:.9g}" for name, angle in joints.items())
        text += (
            f'[[stretch]]\nkind = "dwell"\nlabel = "{dwell.label}"\n'
            f"from_s = {dwell.t_from - origin + 0.02:.6f}\nto_s = {dwell.t_to - origin:.6f}\n"
            f"joints_deg = {{ {told} }}\n"
        )
    named = tmp_path / "stretches.toml"
    named.write_text(text, encoding="utf-8")
    log = stand.read(csv, stretches=named)
    found = stand.calibrate(log, imu="stim300", table="mid-class")
    ours = stand.calibrate(run)
    assert found.errors is None
    assert found.unit["id"] == "stim300"
    own = {p.key: p for p in ours.calibration.parameters}
    for p in found.calibration.parameters:
        if p.key.term in ("bias", "scale") and p.basis == "data":
            # rests alone against rests, turns and spins
            assert abs(p.value - own[p.key].value) < 5 * np.hypot(p.sigma, own[p.key].sigma)


COLUMNS = "t=t_s,gx=gx_rad_s,gy=gy_rad_s,gz=gz_rad_s,ax=ax_m_s2,ay=ay_m_s2,az=az_m_s2"


def test_turns_of_a_log_of_ones_own(recording, stand_command, tmp_path):
    """No encoder, only attitudes and rates: where the unit sits on the table comes out, too."""
    run = stand.read(recording)
    csv = tmp_path / "log.csv"
    assert stand_command("export", str(recording), "--out", str(csv)).code == 0
    named = csv.with_name("log_stretches.toml")
    form = stand.LogForm(columns=COLUMNS)
    log = stand.read(csv, stretches=named, form=form)
    found = stand.calibrate(log, imu="stim300", table="mid-class")
    arms = [n for n in found.calibration.nuisance if n.name.startswith("place on the table")]
    # of the shipped stand 60, 50 and 40 mm; the accelerometers' own places are known to 2 mm each
    for arm, by_hand in zip(arms, (0.060, 0.050, 0.040), strict=True):
        assert abs(arm.value - by_hand) < 4 * arm.sigma
        assert arm.sigma < 3e-3
    own = {p.key: p for p in stand.calibrate(run).calibration.parameters}
    compared = [p for p in found.calibration.parameters if p.key.term in ("bias", "scale")]
    assert len(compared) == 12
    for p in compared:
        assert abs(p.value - own[p.key].value) < 4 * np.hypot(p.sigma, own[p.key].sigma)
    assert found.calibration.enlarged == 1.0
    assert found.calibration.left_out == ()


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--free", "kk"), "term 'kk'"),
        (("--table", "nowhere"), "nowhere"),
        (("--gravity", "8"), "gravity = 8 m/s^2"),
        (("--hand-held", "--trust-table"), "--trust-table: not with --hand-held"),
        (("--as-published",), "--as-published: needs --hand-held"),
        (("--stretches", "none.toml"), "none.toml"),
    ],
)
def test_bad_options_are_one_line(recording, stand_command, options, said):
    outcome = stand_command("calibrate", str(recording), "--json", *options)
    assert outcome.code == 2
    assert outcome.err.count("\n") == 1
    assert said in outcome.err


def test_one_position_is_refused_in_one_line(tmp_path):
    run = stand.simulate(stand.settings("static", imu="stim300", rate_hz=5))
    with pytest.raises(StandError, match="one position only") as caught:
        on_table([run.log])
    assert "\n" not in str(caught.value)
