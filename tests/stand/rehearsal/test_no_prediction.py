"""Why there is no number, in words, for each way there can be none, and the case beside it that
just has one; what is refused of exports and verifications."""

from dataclasses import replace
from enum import Enum
from types import SimpleNamespace

import pytest
from test_traps import DWELL, case

from stand.errors import StandError
from stand.imu import load_imu
from stand.procedure.procedure import table_of
from stand.rehearsal.accuracy import predict
from stand.rehearsal.export import MOST_ROWS, export, exported
from stand.rehearsal.rehearse import prepared, rehearse
from stand.rehearsal.verify import with_verification
from stand.rehearsal.wording import toml_of
from stand.simulation.settings import assembled

TURN = '[[step]]\nkind = "rate"\nlabel = "turn"\naxis = "outer"\nrate_deg_s = 10\nturns = 1\n'
ROCKED = (
    '[[background]]\nkind = "sway"\nfirst = "a"\nlast = "b"\n'
    "axes.base_yaw = {{ rms_deg = {}, frequency_hz = 1.0, damping = 0.2 }}\n"
)
REFUSES = "behind it, which this method refuses"


def made(methods, *steps, imu="hg9900", rate_hz=20):
    procedure = case(methods, *steps)
    return assembled(procedure, load_imu(imu), table_of(procedure), rate_hz=rate_hz)


def reasons(methods, *steps, imu="hg9900"):
    told = rehearse(made(methods, *steps, imu=imu)).predictions
    return {p.method: p.reason for p in told if p.quantity == "heading" or not p.determined}


@pytest.mark.parametrize(
    ("method", "there", "lacks", "words"),
    [
        ("triad", DWELL.format("a", 20), TURN, "no stretch at rest"),
        ("carousel", TURN, DWELL.format("a", 20), "no stretch at constant rate"),
        ("two-position", DWELL.format("a", 20), TURN, "no stretch at rest"),
    ],
)
def test_a_method_without_its_stretch(method, there, lacks, words):
    assert reasons([method], lacks)[method].startswith(words)
    assert not reasons([method], lacks, there)[method].startswith("no stretch")


WITHOUT = {"fine": "no stretch to estimate from", "calibration": "no stretch to estimate from"}


@pytest.mark.parametrize("method", WITHOUT)
def test_a_method_for_any_stretch_of_a_plan_that_has_none(method):
    """Files of procedures have one or more; a plan of one's own need not."""
    scene = prepared(made([method], DWELL.format("a", 20)))
    assert not reasons([method], DWELL.format("a", 20)).get(method, "").startswith("no stretch")
    empty = replace(scene, plan=replace(scene.plan, steps=()))
    (told,), _ = predict(empty, [method])
    assert told.reason == WITHOUT[method]
    assert not told.determined


def test_a_method_that_makes_no_prediction_says_why():
    told = reasons(["vectors"], DWELL.format("a", 20))["vectors"]
    assert told.startswith("no prediction is made: it needs satellite fixes")
    assert told.endswith("; see --verify")


@pytest.mark.parametrize("method", ["triad", "calibration"])
def test_a_base_that_moves_behind_a_rest(method):
    rests = DWELL.format("a", 30) + DWELL.format("b", 30)
    assert reasons([method], rests, ROCKED.format(0.1))[method].startswith("a: the base")
    assert reasons([method], rests, ROCKED.format(0.1))[method].endswith(REFUSES)
    assert REFUSES not in reasons([method], rests).get(method, "")


@pytest.mark.parametrize("seconds", [10, 11])
def test_an_offset_window_may_take_all_of_a_dwell(seconds):
    """It lasts 10 s if nothing else is said; rk4 estimates from what follows it."""
    told = reasons(["rk4"], DWELL.format("a", seconds))["rk4"]
    everything = "every dwell ends with its offset window: nothing is left to estimate"
    assert (told == everything) == (seconds == 10)


# --- exports and verifications


def test_an_export_needs_a_file_in_a_folder(tmp_path):
    settings = made([], DWELL.format("a", 1))
    for out, words in (
        (tmp_path, "must be a file"),
        (tmp_path / "..", "must be a file"),
        (tmp_path / "none" / "x.csv", f"no folder {tmp_path / 'none'}"),
    ):
        with pytest.raises(StandError, match=words):
            exported(settings, out)
    assert exported(settings, tmp_path / "x.csv") == 101  # 1 s at 100 Hz, both ends
    steps = (tmp_path / "x_steps.csv").read_text(encoding="utf-8").splitlines()
    assert len(steps) == 2


def test_an_export_has_no_more_rows_than_are_read_back(tmp_path):
    """At 100 Hz; both ends have a row."""
    planned = prepared(made([], DWELL.format("a", 1))).plan
    longer = replace(planned, motion=SimpleNamespace(duration=MOST_ROWS / 100))
    with pytest.raises(StandError, match=rf"{MOST_ROWS + 1} rows at 100 Hz, at most {MOST_ROWS}"):
        export(longer, tmp_path / "x.csv")
    assert not (tmp_path / "x.csv").exists()


def test_what_is_not_verified_says_so():
    settings = made([], DWELL.format("a", 20))
    result = rehearse(settings)
    with pytest.raises(StandError, match=r"^verify = 0: must be 1 or more$"):
        with_verification(result, settings, 0)
    told = with_verification(result, settings, 1)
    assert told.verification is None
    assert told.findings[-1].text == "not verified: no method is named in [estimate]"
    short = made(["triad"], DWELL.format("a", 1), rate_hz=2)  # three samples would take 1.5 s
    told = with_verification(rehearse(short), short, 1)
    assert told.verification is None
    assert told.findings[-1].text == "not verified: it cannot run as it is"


class _Kind(Enum):
    SWAY = "sway"


def test_a_procedure_as_text_by_hand():
    """Plain values, then tables, then arrays of them in the order given; inline within."""
    data = {
        "step": [{"kind": _Kind.SWAY, "axes": {"a": {"rms_deg": 0.1}}}, {"rates": (1, -2.5)}],
        "title": 'A "b"',
        "site": {"latitude_deg": 48.5, "known": True},
        "none": [],
    }
    assert toml_of(data) == (
        'title = "A \\"b\\""\nnone = []\n\n'
        '[[step]]\nkind = "sway"\naxes = { a = { rms_deg = 0.1 } }\n\n'
        "[[step]]\nrates = [1, -2.5]\n\n"
        "[site]\nlatitude_deg = 48.5\nknown = true\n"
    )
