"""Predicted sigmas: table errors against the stand itself, rows one by one, closed forms."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from alignment import Site
from alignment.earth import EARTH_RATE
from alignment.units import DEG, DEG_PER_HOUR, DEG_PER_RT_HOUR, MILLI_G, STANDARD_GRAVITY
from stand.imperfection import TableErrors
from stand.imu import load_imu, without
from stand.physics.description import JOINTS
from stand.physics.geometry import with_errors
from stand.physics.mjcf import describe, load_model
from stand.physics.truth import Truth
from stand.procedure import load_procedure, table_of
from stand.rehearsal.instrument import leanings
from stand.rehearsal.rehearse import rehearse, request
from stand.table import load_table

MODEL = load_model()
STAND = describe(MODEL)
LAT = 48.5 * DEG
EPS = 1e-4  # rad: second order is 1e-4 of the effect


# --- errors of the table


def one(name, place, shape, value=EPS):
    array = np.zeros(shape)
    array[place] = value
    return {name: array}


def errors_in_order():
    """Each error alone, in the order in which `leanings` tells them."""
    for axis in range(3):
        yield one("base_tilt", axis, 2) if axis < 2 else {"base_azimuth": EPS}
        yield one("mounting", axis, 3)
    for i in range(len(JOINTS)):
        yield one("placement", i, 6)
        for name in ("encoder_once", "encoder_twice"):
            yield one(name, (i, 0), (6, 2))
            yield one(name, (i, 1), (6, 2))
        if i:
            yield one("non_orthogonality", i, 6)
        yield one("wobble", i, 6)
        yield one("wobble", i, 6) | one("wobble_phase", i, 6, np.pi / 2)


def test_table_errors_turn_the_instrument_as_the_stand_does():
    """Against the truth of MuJoCo with that error built in."""
    joints = np.array([[0.1, 0.2, -0.1, 0.5, 0.7, -1.2], [0, 0, 0, np.pi, -0.3, 2.0]])

    def attitude(errors):
        truth = Truth(with_errors(MODEL, errors), Site(LAT), None, errors)
        still = np.zeros_like(joints)
        return Rotation.from_quat(truth.instants(joints, still, still).q_wb)

    perfect = attitude(TableErrors())
    found = leanings(load_table("mid-class"), STAND, joints)
    alone = list(errors_in_order())
    assert len(found) == len(alone)
    for leaning, error in zip(found, alone, strict=True):
        turned = (perfect.inv() * attitude(TableErrors(**error))).as_rotvec() / EPS
        assert turned == pytest.approx(leaning.turns, abs=5e-4), leaning.source


# --- predictions


def predictions(name, unit, table=None):
    procedure = load_procedure(name)
    chosen = load_table(table) if table else table_of(procedure)
    asked = request(procedure, unit, chosen, procedure.entry.site.site())
    return asked, {
        (p.method, p.label, p.quantity): p for p in rehearse(asked).predictions if p.determined
    }


def parts(prediction):
    return {c.source: c.sigma for c in prediction.contributions}


def test_one_position_by_hand():
    """[S4]: bias over the horizontal rate, ARW over rate and root time, b/g, tan(lat) b/g."""
    _, found = predictions("static", load_imu("hg9900"))
    horizontal = EARTH_RATE * np.cos(LAT)
    own = parts(found["triad", "rest", "heading"])
    assert own["gyro turn-on bias"] == pytest.approx(0.0035 * DEG_PER_HOUR / horizontal, rel=1e-6)
    walk = 0.002 * DEG_PER_RT_HOUR / np.sqrt(3600)
    assert own["gyro white noise"] == pytest.approx(walk / horizontal, rel=1e-4)
    tilt = 0.025 * MILLI_G / 9.8093587
    assert own["accelerometer turn-on bias"] == pytest.approx(np.tan(LAT) * tilt, rel=1e-5)
    assert parts(found["triad", "rest", "pitch"])["accelerometer turn-on bias"] == pytest.approx(
        tilt, rel=1e-5
    )


def test_half_a_turn_leaves_noise_and_takes_the_bias():
    """ARW / (W cos lat sqrt(2 x 296 s)); gyro biases cancel, and so does a part of what drifts."""
    _, found = predictions("two-position", load_imu("hg9900"))
    own = parts(found["two-position", "first", "heading"])
    floor = 0.002 * DEG_PER_RT_HOUR / (EARTH_RATE * np.cos(LAT) * np.sqrt(592))
    # the weight of a placement that is not quite known, some 0.1 %
    assert own["gyro white noise"] == pytest.approx(floor, rel=5e-3)
    assert own["gyro turn-on bias"] < 0.01 * 0.0035 * DEG_PER_HOUR / (EARTH_RATE * np.cos(LAT))


def test_case_misalignment_enters_heading_as_it_is():
    """methods.md: 1:1, and it survives every turn; the part across the vertical is tan(lat)'s."""
    unit = load_imu("hg9900")
    unit = replace(unit, gyro=replace(unit.gyro, misalignment=1e-4))
    for name, key in (
        ("two-position", ("two-position", "first")),
        ("carousel", ("carousel", "carousel +")),
    ):
        _, found = predictions(name, unit)
        size = parts(found[*key, "heading"])["gyro case misalignment"]
        assert size == pytest.approx(1e-4, rel=0.02), name


def test_offsets_cancel_what_is_constant():
    """Zero offsets in ten seconds of sixty: white noise sqrt(1/10 + 1/50) and nothing constant."""
    _, found = predictions("six-position", load_imu("hg9900"))
    one = found["six-position", "Y1 up", "heading"]
    floor = 0.002 * DEG_PER_RT_HOUR / (EARTH_RATE * np.cos(LAT)) * np.sqrt(1 / 10 + 1 / 50)
    assert one.sigma == pytest.approx(floor, rel=1e-3)
    assert "gyro turn-on bias" not in parts(one)
    drift = found["rk4", "Y1 up", "heading"]
    walk = 0.002 * DEG_PER_RT_HOUR * 50 * np.sqrt(1 / 10 + 1 / 50)
    assert drift.sigma == pytest.approx(walk, rel=1e-3)


TERMS = {
    "white-noise": ("white noise",),
    "turn-on-bias": ("turn-on bias",),
    "bias-instability": ("bias instability",),
    "scale-factor": ("scale",),
    "misalignment": ("case misalignment",),
    "g-sensitivity": ("g-sensitivity",),
}


@pytest.mark.parametrize("term", TERMS)
def test_a_source_switched_off_takes_its_row_away(term):
    """Gains frozen: the estimators go on being told what the whole unit's sheet says."""
    unit = load_imu("stim300")
    asked, whole = predictions("two-position", unit)
    less = rehearse(replace(asked, imu=without(unit, [term])))
    changed = 0
    for p in less.predictions:
        before = whole.get((p.method, p.label, p.quantity))
        if before is None or p.sigma is None:
            continue
        gone = sum(
            c.sigma**2 for c in before.contributions if c.source.split(" ", 1)[-1] in TERMS[term]
        )
        changed += gone > 1e-6 * before.sigma**2
        # rows below a millionth are not told: 1e-12 of the square
        expected = before.sigma**2 - gone
        assert p.sigma**2 == pytest.approx(expected, rel=1e-6, abs=1e-9 * before.sigma**2)
    assert changed


def test_more_than_ten_degrees_is_no_number():
    _, found = predictions("static", load_imu("mpu9250"))
    assert ("triad", "rest", "heading") not in found
    assert found["triad", "rest", "pitch"].sigma == pytest.approx(
        60e-3 * STANDARD_GRAVITY / 9.8093587, rel=0.1
    )


def test_what_cannot_be_told_apart_is_in_words():
    asked, _ = predictions("static", load_imu("stim300"))
    seen = rehearse(asked).observability[0]
    assert seen.rank == 6
    assert seen.sought == 9
    assert any("heading cannot be told from gyro bias" in text for text in seen.unseen)
    asked, _ = predictions("two-position", load_imu("stim300"))
    seen = rehearse(asked).observability[1]
    assert (seen.rank, seen.unseen) == (9, ())
