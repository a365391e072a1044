"""Every command is told the same of unit and table, and refuses the same arguments."""

from collections.abc import Mapping
from dataclasses import fields, is_dataclass, replace
from math import hypot, pi, sqrt

import numpy as np
import pytest

from alignment import ESTIMATORS, Priors
from stand.errors import StandError
from stand.evaluation import comparison
from stand.evaluation.published import six_position
from stand.imu import TERMS, load_imu
from stand.motion.polynomial import MotionKind
from stand.physics.truth import Sampling
from stand.procedure.procedure import load_procedure
from stand.rehearsal import advice
from stand.simulation.settings import Settings, assembled, settings, stated_priors, with_procedure
from stand.table.joints import JOINTS
from stand.table.table import load_table, without_errors
from stand.toml_files import ids

ARC_SECOND = pi / 180 / 3600
PLACEMENT = ("turn", "seat", "nominal", "azimuth")
PROCEDURES = {name: load_procedure(name) for name in ids("procedures")}
IMUS = {name: load_imu(name) for name in ids("imus")}
TABLES = {name: load_table(name) for name in ids("tables")}


class Caught(Exception):
    """The settings that a command came to."""


def caught(stand_command, monkeypatch, *arguments):
    """What a command hands to the function that does its work."""

    def stop(settings, *rest, **more):
        raise Caught(settings)

    monkeypatch.setattr("stand.recorded_run.run", stop)
    monkeypatch.setattr(comparison, "compare", stop)
    monkeypatch.setattr(advice, "with_advice", stop)
    with pytest.raises(Caught) as raised:
        stand_command(*arguments)
    return raised.value.args[0]


def contents(told):
    """All that stands in it, field by field: by itself a `Bench` equals none but itself."""
    if is_dataclass(told):
        return type(told), {f.name: contents(getattr(told, f.name)) for f in fields(told)}
    if isinstance(told, np.ndarray):
        return told.dtype.str, told.shape, told.tolist()
    if isinstance(told, Mapping):
        return {key: contents(value) for key, value in told.items()}
    if isinstance(told, list | tuple):
        return [contents(value) for value in told]
    return told


# a unit and a table for each procedure, so that all of them are met
CASES = [
    (name, list(IMUS)[k % len(IMUS)], list(TABLES)[k % len(TABLES)])
    for k, name in enumerate([*PROCEDURES, *list(PROCEDURES)[:3]])
]


@pytest.mark.parametrize(("procedure", "imu", "table"), CASES)
def test_all_commands_state_the_same_priors(stand_command, monkeypatch, procedure, imu, table):
    # at one rate: what a sample's noise does to its rounding depends on it, and a comparison's own
    # is 20 Hz
    options = (procedure, "--imu", imu, "--table", table, "--rate", 20)
    told = [
        contents(caught(stand_command, monkeypatch, command, *options).options)
        for command in ("run", "compare", "rehearse")
    ]
    assert told[0] == told[1] == told[2]
    assert told[0] == contents(settings(procedure, imu, table, rate_hz=20).options)
    true = [
        contents(caught(stand_command, monkeypatch, command, *options, "--true-table").options)
        for command in ("run", "compare")
    ]
    assert true[0] == true[1]
    assert true[0] == contents(settings(procedure, imu, table, rate_hz=20, true_table=True).options)
    # a comparison by content that nothing fails would be none: these differ in the bench alone
    if ESTIMATORS[PROCEDURES[procedure].entry.estimate.methods[0]].design is not None:
        faster = settings(procedure, imu, table, rate_hz=200).options
        assert contents(faster) != told[0]


@pytest.mark.parametrize("procedure", PROCEDURES)
def test_every_unit_and_table_of_the_catalogue_is_told_as_its_sheet_says(procedure):
    loaded = PROCEDURES[procedure]
    for unit in IMUS.values():
        for table in TABLES.values():
            made = settings(loaded, unit, table)
            p = made.options.priors
            # 0.73 m: the unit's height above the crossing of the base's axes; (0.06, 0.05) m: its
            # place across the pitch axis, of the gimbal axes the farthest: 0.0552 m each way
            turns = {"rate", "sweep"} & {step.kind for step in loaded.entry.step}
            arm = hypot(0.73 * bool(loaded.entry.background), 0.05523 * bool(turns))
            assert p.lever_arm == pytest.approx(arm, rel=1e-4)
            assert (p.gyro_walk, p.accel_walk) == (unit.gyro.noise, unit.accel.noise)
            geometry = table.entry.geometry
            # the base's own axes stand off its zeros as well
            base = [table.entry.axis[joint].errors.placement_arc_s for joint in JOINTS[:3]]
            tilt = hypot(geometry.base_tilt_arc_s, max(base[:2])) * ARC_SECOND
            azimuth = hypot(geometry.base_azimuth_arc_s, base[2]) * ARC_SECOND
            assert (p.nominal, p.azimuth) == pytest.approx((tilt, azimuth), rel=1e-12)
            gimbals = [table.entry.axis[joint].errors for joint in JOINTS[3:]]
            zeros = sqrt(sum(e.placement_arc_s**2 for e in gimbals) / 3)
            seat = hypot(geometry.mounting_arc_s, zeros) * ARC_SECOND
            assert p.seat == pytest.approx(seat, rel=1e-12)
            # a table without errors has none to state, all else is as it was
            true = settings(loaded, unit, table, true_table=True).options.priors
            assert true == replace(p, turn=0.0, seat=0.0, nominal=0.0, azimuth=0.0)


def test_a_rehearsal_that_changes_the_procedure_is_told_anew():
    made = settings("six-position", table="mid-class", sequences="published")
    rocked = with_procedure(made, PROCEDURES["random-sway"])
    assert (made.options.priors.lever_arm, rocked.options.priors.lever_arm) == (0.0, 0.73)
    assert rocked.options.rule == made.options.rule
    assert rocked.options.priors == stated_priors(rocked)


def test_published_figures_are_of_the_settings_of_a_run(monkeypatch):
    def stop(settings):
        raise Caught(settings)

    monkeypatch.setattr(six_position, "Trials", stop)
    with pytest.raises(Caught) as raised:
        six_position.runs()
    made = raised.value.args[0]
    assert made.options == settings(six_position.TEST, six_position.UNIT).options


def test_switched_off_terms_are_not_told():
    made = settings("six-position", "stim300", without=tuple(TERMS), true_table=True)
    assert made.options.priors == Priors()
    assert made.unit.gyro.noise == 0.0
    assert made.imu.gyro.noise > 0.0


def test_a_true_table_keeps_its_limits():
    table = TABLES["mid-class"]
    true = without_errors(table)
    assert (true.rate == table.rate).all()
    assert true.motors == table.motors
    assert true.entry.settling == table.entry.settling
    assert all(e.errors.placement_arc_s == 0 for e in true.entry.axis.values())


def test_what_is_not_given_is_the_procedures_own():
    loaded = PROCEDURES["random-sway"]
    made = assembled(loaded, IMUS["hg9900"])
    assert made.table.id == loaded.entry.table
    assert made.site.latitude == pytest.approx(loaded.entry.site.latitude_deg * pi / 180)
    assert made.options.offset_window == loaded.entry.estimate.offset_window_s
    assert made.methods is None


@pytest.mark.parametrize(
    ("given", "line"),
    [
        ({"latitude_deg": 95}, "latitude = 95 deg: must be -90 to 90"),
        ({"height_m": 2e4}, "height = 20000 m: must be -1000 to 10000"),
        ({"rate_hz": 0}, "rate = 0 Hz: must be 1 to 10000"),
        ({"rate_hz": 2.5}, "rate = 2.5 Hz: must be a whole number"),
        ({"rate_hz": "fast"}, "rate = 'fast': must be a whole number of Hz"),
        ({"seed": -1}, "seed = -1: must be 0 or more"),
        ({"seed": 1.5}, "seed = 1.5: must be a whole number, 0 or more"),
        ({"latitude_deg": "x"}, "latitude = 'x': must be a number"),
        ({"height_m": "x"}, "height = 'x': must be a number"),
        ({"true_table": "yes"}, "true_table = 'yes': must be True or False"),
        ({"motion": None}, "unknown motion None: known: ideal, servo"),
        ({"methods": [1]}, "methods = [1]: must be a list of words"),
        ({"imu": None}, "imu = None: must be an id, a path, or one that is loaded"),
        ({"table": 3}, "table = 3: must be an id, a path, or one that is loaded"),
        ({"latitude": 48.5}, "unknown argument 'latitude': did you mean latitude_deg? known: "),
        ({"rate": 20}, "unknown argument 'rate': did you mean rate_hz"),
        ({"sampling": "means"}, "unknown sampling 'means': did you mean mean? known: instant, m"),
        ({"motion": "x"}, "unknown motion 'x': known: ideal, servo"),
        ({"sequences": "mine"}, "unknown sequences 'mine': known: published, regular"),
        ({"methods": ["traid"]}, "unknown method 'traid': did you mean triad? known: "),
        ({"methods": "triad"}, "methods = 'triad': must be a list of words"),
        ({"without": ["wite-noise"]}, "unknown error term 'wite-noise': did you mean white-noise"),
        ({"allan_terms": ["X"]}, "unknown term 'X': known: B, K, N, Q, R"),
        ({"imu": "stim30"}, "unknown imu 'stim30': did you mean stim300? known: "),
        ({"table": "laboratry"}, "unknown table 'laboratry': did you mean laboratory? known: "),
    ],
)
def test_a_wrong_argument_costs_one_line(given, line):
    with pytest.raises(StandError) as raised:
        settings("six-position", **given)
    assert str(raised.value).startswith(line)
    assert "\n" not in str(raised.value)


def test_bare_settings_are_of_the_plainest_run():
    made = assembled(PROCEDURES["static"], IMUS["stim300"], TABLES["mid-class"])
    bare = Settings(
        procedure=made.procedure, imu=made.imu, table=made.table, site=made.site,
        options=made.options,
    )  # fmt: skip
    for one in (bare, made):
        assert (one.seed, one.true_table, one.without, one.methods) == (0, False, (), None)
        assert (one.sampling, one.motion) == (Sampling.MEAN, MotionKind.IDEAL)
        assert (one.revision, one.allan_terms) == ("", ())
    assert bare.rate_hz == 200


def test_what_nobody_says_of_a_run():
    """As `stand run --help` has it."""
    for made in (
        settings("static", "stim300"),
        assembled(
            PROCEDURES["static"],
            IMUS["stim300"],
            TABLES["precision"],
            PROCEDURES["static"].entry.site.site(),
        ),
    ):
        told = made.rate_hz, made.sampling, made.seed, made.without, made.motion
        assert told == (200, Sampling.MEAN, 0, (), MotionKind.IDEAL)
        assert (made.true_table, made.methods, made.revision, made.allan_terms) == (
            False, None, "", (),
        )  # fmt: skip
