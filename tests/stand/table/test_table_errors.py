"""Errors of a table: drawn as the class says, each from a stream of its own; set values; curves."""

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stand import toml_files as catalogue
from stand.errors import StandError
from stand.table.joints import JOINTS
from stand.table.table import AxisErrorsEntry, GeometryEntry, load_table
from stand.table.table_errors import PERFECT, TableErrors, TableErrorsEntry, draw

ARC_SECOND = np.pi / 180 / 3600
AXIS = {
    "placement_arc_s": 10.0,
    "encoder_arc_s": 4.0,
    "encoder_step_arc_s": 0.36,
    "non_orthogonality_arc_s": 5.0,
    "wobble_arc_s": 1.0,
    "rate_ripple_percent": 0.2,
    "ripple_per_turn": 36,
}
WHOLE = {"base_tilt_arc_s": 20.0, "base_azimuth_arc_s": 60.0, "mounting_arc_s": 30.0}


def table_of(axis=AXIS, whole=WHOLE):
    """The laboratory table with these figures on every axis (the first leans toward none)."""
    table = load_table("laboratory")
    each = {name: AxisErrorsEntry(**axis) for name in JOINTS}
    each["base_roll"] = AxisErrorsEntry(**(axis | {"non_orthogonality_arc_s": 0.0}))
    entries = {
        name: entry.model_copy(update={"errors": each[name]})
        for name, entry in table.entry.axis.items()
    }
    changed = {"axis": entries, "geometry": GeometryEntry(**whole)}
    return replace(table, entry=table.entry.model_copy(update=changed))


def entry_of(text):
    return catalogue.parse(catalogue.Source("errors", "errors.toml", text), TableErrorsEntry)


def values(errors):
    return {name: np.asarray(getattr(errors, name)) for name in TableErrors.__slots__}


# --- drawn


@pytest.fixture(scope="module")
def many():
    """1500 tables of one class, by field."""
    table = table_of()
    drawn = [values(draw(table, seed, None, True)) for seed in range(1500)]
    return {name: np.stack([d[name] for d in drawn]) for name in drawn[0]}


@pytest.mark.parametrize(
    ("name", "sigma"),
    [
        ("base_tilt", 20 * ARC_SECOND),
        ("base_azimuth", 60 * ARC_SECOND),
        ("mounting", 30 * ARC_SECOND),
        ("placement", 10 * ARC_SECOND),
        ("encoder_once", 4 / 2**0.5 * ARC_SECOND),
        ("encoder_twice", 4 / 2**0.5 * ARC_SECOND),
        ("wobble", 1 * ARC_SECOND),
        ("rate_ripple", 0.002),
    ],
)
def test_standard_deviations_are_the_class_s(many, name, sigma):
    x = many[name].reshape(1500, -1) / sigma
    n = len(x)
    # mean within 4.5 / sqrt n, mean square within 4.5 sqrt(2/n): 25 such columns, 1 in 3000 fails
    assert np.abs(x.mean(axis=0)).max() < 4.5 / np.sqrt(n)
    assert np.abs((x**2).mean(axis=0) - 1).max() < 4.5 * np.sqrt(2 / n)
    # streams are independent: neither axes nor components go together
    together = np.corrcoef(x.T) - np.eye(x.shape[1])
    assert np.abs(together).max() < 5 / np.sqrt(n)


def test_leaning_axes_and_phases(many):
    lean = many["non_orthogonality"] / (5 * ARC_SECOND)
    assert not lean[:, 0].any()  # no axis carries the first
    assert np.abs((lean[:, 1:] ** 2).mean(axis=0) - 1).max() < 4.5 * np.sqrt(2 / 1500)
    for name in ("wobble_phase", "ripple_phase"):
        phase = many[name]
        assert np.abs(phase).max() <= np.pi
        # uniform: mean cosine and sine vanish, with standard deviation 1/sqrt(2 n)
        around = np.exp(1j * phase).mean(axis=0)
        assert np.abs([around.real, around.imag]).max() < 4.5 / np.sqrt(2 * 1500)
    assert (many["ripple_per_turn"] == 36).all()
    np.testing.assert_allclose(many["encoder_step"], 0.36 * ARC_SECOND, rtol=1e-15)


def test_encoder_figure_is_the_rms_over_tables_and_angles():
    """Amplitudes of sigma / sqrt 2 each: four of them make sigma^2 at every angle."""
    table = table_of({"encoder_arc_s": 4.0}, {})
    q = np.repeat(np.linspace(0, 2 * np.pi, 12, endpoint=False)[:, None], 6, axis=1)
    error = np.stack(
        [draw(table, s, None, True).realised(q, 0 * q, 0 * q)[0] - q for s in range(500)]
    )
    # 500 tables x 6 axes, each of 4 numbers: mean square within 4.5 sqrt(2 / 12000)
    assert (error**2).mean() / (4 * ARC_SECOND) ** 2 == pytest.approx(1, abs=0.06)


def test_one_error_changes_no_other():
    table = table_of()
    plain = values(draw(table, 5, None, True))
    for key, name in (
        ("placement_arc_s", "placement"),
        ("wobble_arc_s", "wobble"),
        ("non_orthogonality_arc_s", "non_orthogonality"),
        ("rate_ripple_percent", "rate_ripple"),
    ):
        without = values(draw(table_of(AXIS | {key: 0.0}), 5, None, True))
        assert not without.pop(name).any()
        for other, value in without.items():
            np.testing.assert_array_equal(value, plain[other], err_msg=f"{key}: {other}")
    text = "[axis.outer]\nplacement_arc_s = 60.0\n"
    some = values(draw(table, 5, entry_of(text), True))
    assert some["placement"][3] == pytest.approx(2.908882e-4, rel=1e-6)  # 1 arc minute
    some["placement"] = np.where(np.arange(6) == 3, plain["placement"], some["placement"])
    for name, value in some.items():
        np.testing.assert_array_equal(value, plain[name], err_msg=name)


def test_same_seed_same_table():
    first, again, other = (values(draw(table_of(), seed, None, True)) for seed in (7, 7, 8))
    for name, value in first.items():
        np.testing.assert_array_equal(value, again[name])
    assert (first["placement"] != other["placement"]).all()
    assert len(np.unique(np.abs(first["placement"]))) == 6


def test_a_servo_has_its_own_ripple():
    text = "[axis.inner]\nrate_ripple_percent = 1.0\n"
    ideal = draw(table_of(), 1, entry_of(text), ideal_motion=True)
    servo = draw(table_of(), 1, entry_of(text), ideal_motion=False)
    assert ideal.rate_ripple[5] == 0.01
    assert not servo.rate_ripple.any()
    np.testing.assert_array_equal(servo.placement, ideal.placement)


# --- set


EVERY_KEY = """
drawn = false
base_tilt_arc_s = [10.0, -20.0]
base_azimuth_arc_s = 30.0
mounting_arc_s = [1.0, 2.0, 3.0]
[axis.outer]
placement_arc_s = 60.0
encoder_once_arc_s = [4.0, -5.0]
encoder_twice_arc_s = [6.0, 7.0]
encoder_step_arc_s = 0.36
non_orthogonality_arc_s = 5.0
wobble_arc_s = 8.0
wobble_phase_deg = 90.0
rate_ripple_percent = 0.5
ripple_per_turn = 72
ripple_phase_deg = -180.0
"""


def test_every_set_value_in_si_by_hand():
    errors = draw(table_of(), 0, entry_of(EVERY_KEY), True)
    second = 4.84813681109536e-6  # rad in an arc second
    assert errors.base_tilt == pytest.approx([10 * second, -20 * second], rel=1e-12)
    assert errors.base_azimuth == pytest.approx(30 * second, rel=1e-12)
    assert errors.mounting == pytest.approx([second, 2 * second, 3 * second], rel=1e-12)
    assert errors.placement[3] == pytest.approx(60 * second, rel=1e-12)
    assert errors.encoder_once[3] == pytest.approx([4 * second, -5 * second], rel=1e-12)
    assert errors.encoder_twice[3] == pytest.approx([6 * second, 7 * second], rel=1e-12)
    assert errors.encoder_step[3] == pytest.approx(0.36 * second, rel=1e-12)
    assert errors.non_orthogonality[3] == pytest.approx(5 * second, rel=1e-12)
    assert errors.wobble[3] == pytest.approx(8 * second, rel=1e-12)
    assert errors.wobble_phase[3] == pytest.approx(1.5707963267948966, rel=1e-12)
    assert errors.rate_ripple[3] == pytest.approx(0.005, rel=1e-12)
    assert errors.ripple_per_turn[3] == 72
    assert errors.ripple_phase[3] == pytest.approx(-3.141592653589793, rel=1e-12)
    others = [0, 1, 2, 4, 5]
    for name, value in values(errors).items():
        if value.shape[:1] == (6,) and name != "ripple_per_turn":
            assert not value[others].any(), name


def test_nothing_drawn_and_nothing_set_is_perfect():
    assert PERFECT.perfect
    assert draw(table_of(), 3, entry_of("drawn = false"), True).perfect
    assert draw(table_of({}, {}), 3, None, True).perfect  # phases alone do no harm
    record = draw(table_of({}, {}), 3, None, True).record()
    assert not any("-0.0" in text for key, text in record.items() if "phase" not in key)
    assert not draw(table_of({}, {"base_azimuth_arc_s": 1.0}), 3, None, True).perfect
    for key in ("encoder_step_arc_s", "wobble_arc_s", "rate_ripple_percent"):
        assert not draw(table_of({key: 1.0}, {}), 3, None, True).perfect


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[axis.iner]\nplacement_arc_s = 1.0", "unknown axis 'iner': did you mean inner?"),
        ("[axis.inner]\nplacement = 1.0", "unknown key 'placement': did you mean placement_arc_s"),
        ("[axis.base_roll]\nnon_orthogonality_arc_s = 5.0", "axis base_roll, non_orthogonality"),
        ("[axis.outer]\nripple_per_turn = 0", "axis, outer, ripple_per_turn = 0"),
        ("[axis.outer]\nencoder_step_arc_s = -1.0", "encoder_step_arc_s = -1.0"),
        ("[axis.outer]\nencoder_once_arc_s = 4.0", "encoder_once_arc_s = 4.0: must be an array"),
        ("base_tilt_arc_s = [1.0]", "base_tilt_arc_s"),
        ("mounting_arc_s = [1.0, 2.0, 1e6]", "mounting_arc_s"),
    ],
)
def test_faults_are_one_clear_line(text, message):
    with pytest.raises(StandError) as fault:
        entry_of(text)
    assert message in str(fault.value)
    assert "\n" not in str(fault.value)


def test_records_of_faulty_numbers_are_refused():
    with pytest.raises(ValueError, match="placement: not finite"):
        TableErrors(placement=np.full(6, np.nan))
    with pytest.raises(ValueError, match="ripple_per_turn"):
        TableErrors(ripple_per_turn=np.zeros(6, int))
    with pytest.raises(ValueError, match="base_roll"):
        TableErrors(non_orthogonality=np.full(6, 1e-5))


def test_the_record_has_units_in_its_keys():
    record = draw(table_of(), 0, entry_of(EVERY_KEY), True).record()
    assert json.loads(record["axes"]) == list(JOINTS)
    found = {key: json.loads(value) for key, value in record.items()}
    assert found["base_tilt_arc_s"] == pytest.approx([10, -20])
    assert found["base_azimuth_arc_s"] == pytest.approx(30)
    assert found["placement_arc_s"] == pytest.approx([0, 0, 0, 60, 0, 0])
    assert found["encoder_once_arc_s"][3] == pytest.approx([4, -5])
    assert found["rate_ripple_percent"][3] == pytest.approx(0.5)
    assert found["ripple_per_turn"] == [36, 36, 36, 72, 36, 36]
    assert found["ripple_phase_deg"][3] == pytest.approx(-180)
    assert len(found) == 1 + len(values(PERFECT))


# --- curves


angle = st.floats(-50, 50)
small = st.floats(-0.01, 0.01)


@given(angle, small, small, small, small, st.floats(-0.3, 0.3), st.integers(1, 90), angle)
def test_rates_and_accelerations_are_the_angle_s_derivatives(q, c1, s1, c2, s2, r, n, phase):
    """Along q(t) = q + 2 t + 1.5 t^2 the true angle is differentiated by a stencil."""
    six = np.ones(6)
    errors = TableErrors(
        placement=0.01 * six,
        encoder_once=np.outer(six, [c1, s1]),
        encoder_twice=np.outer(six, [c2, s2]),
        rate_ripple=r * six,
        ripple_per_turn=n * six.astype(int),
        ripple_phase=phase * six,
    )
    h = 1e-4
    t = h * np.arange(-3, 4)
    place = (q + 2 * t + 1.5 * t**2)[:, None] * six
    true, rate, acceleration = errors.realised(
        place, np.outer(2 + 3 * t, six), np.full_like(place, 3.0)
    )
    slope = np.array([-1, 9, -45, 0, 45, -9, 1]) @ true / (60 * h)
    bend = np.array([2, -27, 270, -490, 270, -27, 2]) @ true / (180 * h**2)
    # sixth order: (n q' h)^6 = 3e-11 of the ripple's r q' and r n q'^2 = 100; rounding of 50 rad
    # in the angle, 7e-15/h and 7e-15/h^2 and some
    assert rate[3] == pytest.approx(slope, abs=1e-9)
    assert acceleration[3] == pytest.approx(bend, abs=1e-5)


def test_a_quarter_turn_by_hand():
    """Once round 10'' in sine and twice 6'' in cosine: at 90 deg 10'' - 6'', at 45 deg 7.071''."""
    once, twice = np.zeros((6, 2)), np.zeros((6, 2))
    once[4, 1], twice[4, 0] = 10 * ARC_SECOND, 6 * ARC_SECOND
    errors = TableErrors(encoder_once=once, encoder_twice=twice)
    q = np.zeros((2, 6))
    q[:, 4] = np.radians([90, 45])
    off = (errors.realised(q, q, q)[0] - q) / ARC_SECOND
    # 1e-9 arc second is the rounding of an angle of a radian
    assert off[:, 4] == pytest.approx([4.0, 7.0710678], abs=1e-7)
    assert not off[:, [0, 1, 2, 3, 5]].any()


def test_nods_by_hand():
    """8'' with phase 30 deg at 60 deg of outer: 90 deg, so none about the first line."""
    errors = TableErrors(
        wobble=np.array([0, 0, 0, 8, 0, 1.0]) * ARC_SECOND,
        wobble_phase=np.radians([0, 0, 0, 30, 0, 0]),
    )
    q, v, a = np.zeros((3, 2, 6))
    q[0, 3], v[0, 3], a[0, 3] = np.radians(60), 2.0, 0.5
    angles, rates, accelerations = (x / ARC_SECOND for x in errors.nods(q, v, a))
    assert angles[0] == pytest.approx([0, 8, 1, 0], abs=1e-12)
    assert rates[0] == pytest.approx([-16, 0, 0, 0], abs=1e-12)
    # -c (sin a + cos v^2), c (cos a - sin v^2) at 90 deg
    assert accelerations[0] == pytest.approx([-4, -32, 0, 0], abs=1e-12)
    assert list(errors.wobbling) == [3, 5]


def test_readings_are_whole_steps():
    step = np.array([0, 0, 0, 3.6, 0.0, 36.0]) * ARC_SECOND
    q = np.radians(np.random.default_rng(2).uniform(-400, 400, (500, 6)))
    said = TableErrors(encoder_step=step).readings(q)
    np.testing.assert_array_equal(said[:, [0, 1, 2, 4]], q[:, [0, 1, 2, 4]])
    for axis in (3, 5):
        counts = said[:, axis] / step[axis]
        assert np.abs(counts - np.rint(counts)).max() < 1e-8  # rounding of 4e5 counts
        off = (said - q)[:, axis] / step[axis]
        assert np.abs(off).max() <= 0.5 + 1e-8
        # uniform over a step: variance 1/12, whose estimate has sqrt(1/180 n)
        assert off.var() == pytest.approx(1 / 12, abs=4.5 / np.sqrt(180 * 500))
