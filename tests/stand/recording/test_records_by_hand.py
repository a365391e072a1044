"""Every number of a recording's metadata, as text by hand and read from text by hand.

One radian is 57.29577951 deg, 206264.8062 arc s.
"""

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from alignment import Options, Priors, Site
from alignment.angles import SequenceRule
from alignment.readings import Fixes
from stand.motion.plan import PlannedStep, Turning
from stand.recording.curves import InnovationCurves, innovations_csv
from stand.recording.metadata import (
    LoggedStretch,
    describe_drive,
    describe_estimate,
    describe_schedule,
    describe_site,
    drive_of,
    epoch_of,
    interrupted_at,
    planned_stretches,
    settings_of,
    settled_stretches,
)

PRIORS = (
    "prior_gyro_bias_rad_s", "prior_accel_bias_m_s2", "prior_gyro_scale_ratio",
    "prior_accel_scale_ratio", "prior_gyro_instability_rad_s", "prior_accel_instability_m_s2",
    "prior_gyro_walk_rad_rt_s", "prior_accel_walk_m_s_rt_s", "prior_turn_rad", "prior_seat_rad",
    "prior_nominal_rad", "prior_azimuth_rad", "prior_lever_arm_m", "prior_places_m", "prior_lag_s",
    "prior_clock_ratio", "prior_jitter_s",
    "prior_gyro_random_walk_rad_s_rt_s", "prior_accel_random_walk_m_s2_rt_s",
    "prior_gyro_ramp_rad_s2", "prior_accel_ramp_m_s3", "prior_gyro_scale_ramp_1_s",
    "prior_gyro_misalignment_rad",
    "prior_accel_misalignment_rad", "prior_gyro_non_orthogonality_rad",
    "prior_accel_non_orthogonality_rad", "prior_gyro_asymmetry_ratio",
    "prior_accel_asymmetry_ratio", "prior_gyro_g_sensitivity_s_m",
    "prior_gyro_g2_sensitivity_s3_m2", "prior_accel_quadratic_s2_m", "prior_accel_cubic_s4_m2",
    "prior_gyro_cubic_s2_rad2",
)  # fmt: skip
# a third of a turn about (1, 1, 1): X to Y, Y to Z, Z to X
THIRD = (0.5, 0.5, 0.5, 0.5)


def test_a_site_in_degrees_and_arc_seconds():
    site = Site(0.5, 120.0, local_gravity=9.81, longitude=-1.5, deflection=(2e-5, -3e-5))
    by_hand = {
        "latitude_deg": 28.64788975654116,
        "height_m": 120.0,
        "gravity_m_s2": 9.81,
        "longitude_deg": -85.94366926962348,
        "deflection_north_arc_s": 4.125296124941928,
        "deflection_east_arc_s": -6.187944187412891,
    }
    record = describe_site(site)
    assert {key: float(text) for key, text in record.items()} == pytest.approx(by_hand, rel=1e-13)
    text = {key: repr(number) for key, number in by_hand.items()}
    again, *_ = settings_of({"site": text})
    assert (again.latitude, again.height, again.local_gravity) == pytest.approx((0.5, 120.0, 9.81))
    assert (again.longitude, *again.deflection) == pytest.approx((-1.5, 2e-5, -3e-5), rel=1e-13)


def test_a_place_of_which_nothing_is_known():
    assert set(describe_site(Site(None))) == {
        "height_m", "longitude_deg", "deflection_north_arc_s", "deflection_east_arc_s",
    }  # fmt: skip
    site, options, methods = settings_of({})
    assert site == Site(None, 0.0, local_gravity=None, longitude=0.0, deflection=(0.0, 0.0))
    assert options == Options(10.0, SequenceRule.REGULAR, Priors())
    assert methods == ("triad",)


def test_what_is_estimated_in_si_by_names_with_units():
    record = {key: repr(0.25 + k) for k, key in enumerate(PRIORS)}
    record |= {"methods": "triad,fine", "offset_window_s": "7.5", "sequences": "published"}
    record |= {"accel_later_s": "0.0"}
    priors = Priors(*(0.25 + k for k in range(len(PRIORS))))
    options = Options(7.5, SequenceRule.PUBLISHED, priors)
    assert describe_estimate(options, ("triad", "fine")) == record
    _, found, methods = settings_of({"estimate": record})
    assert (found, methods) == (options, ("triad", "fine"))
    # before the azimuth had a number of its own it was as wrong as the level axes
    del record["prior_azimuth_rad"], record["prior_seat_rad"]
    _, found, _ = settings_of({"estimate": record})
    assert (found.priors.azimuth, found.priors.nominal, found.priors.seat) == (10.25, 10.25, 0.0)


def schedule(**changes) -> dict:
    made = {
        "kind": "rate",
        "label": "round",
        "t_from_s": 3.0,
        "t_to_s": 40.0,
        "steady_from_s": 5.0,
        "steady_to_s": 38.0,
        "joints_deg": [10.0, 20.0, 30.0, 40.0, 50.0, 60.0],
        "C_nb_xyzw": list(THIRD),
        "turning": {"axis": "outer", "rate_deg_s": -12.0, "axis_b": [0.0, 0.6, 0.8]},
    }
    return made | changes


def test_a_step_as_it_ran():
    turning = Turning(3, np.radians(-12.0), np.array([0.0, 0.6, 0.8]), angle=7.0)
    joints = np.radians([10.0, 20.0, 30.0, 40.0, 50.0, 60.0])
    turned = Rotation.from_rotvec(2 * np.pi / 3 / 3**0.5 * np.ones(3))
    times = 3.0, 40.0, 5.0, 38.0
    steps = [
        PlannedStep(0, "rate", "round", *times, joints, turned, turning),
        PlannedStep(1, "dwell", "rest", *times, joints, turned),
    ]
    first, second = json.loads(describe_schedule(steps)["json"])
    expected = schedule()
    for key in ("joints_deg", "C_nb_xyzw"):
        assert first.pop(key) == second.pop(key) == pytest.approx(expected.pop(key), rel=1e-13)
    told, by_hand = first.pop("turning"), expected.pop("turning")
    assert first == expected
    assert (told["axis"], told["axis_b"]) == (by_hand["axis"], by_hand["axis_b"])
    assert told["rate_deg_s"] == pytest.approx(-12.0, rel=1e-13)
    assert second == expected | {"kind": "dwell", "label": "rest", "turning": None}


def test_stretches_of_a_schedule():
    """Dwells and what turns, while steady; a radian is 57.3 deg; the old knew of steps alone."""
    steps = [
        schedule(),
        schedule(kind="dwell", label="rest", turning=None),
        schedule(kind="move", label="go", turning=None),
        {key: schedule()[key] for key in ("t_from_s", "t_to_s", "C_nb_xyzw")}
        | {"kind": "dwell", "label": "old"},
    ]
    turn, rest, old = planned_stretches({"schedule": {"json": json.dumps(steps)}})
    radians = [0.17453293, 0.34906585, 0.52359878, 0.6981317, 0.87266463, 1.04719755]
    for one in (turn, rest):
        assert (one.t_from, one.t_to, one.nominal) == (5.0, 38.0, THIRD)
        assert one.joints == pytest.approx(radians, abs=1e-8)
        assert (one.rate, one.angle) == (None, 0.0)  # its encoder tells
    assert (turn.label, turn.joint, turn.axis_b) == ("round", "outer", (0.0, 0.6, 0.8))
    assert (rest.label, rest.joint, rest.axis_b) == ("rest", None, None)
    assert old == LoggedStretch("old", 3.0, 40.0, THIRD)
    assert planned_stretches({}) == []


def test_stretches_from_when_the_table_had_settled():
    """Later than planned it counts, earlier not; what never settled or is over by then is out."""
    planned = [LoggedStretch(name, 10.0, 20.0) for name in "abcdef"]
    record = {"a": "12.5", "b": "9.0", "c": "never", "d": "20.0", "e": "inf"}
    found = settled_stretches(planned, {"settled": record})
    assert found == [
        LoggedStretch("a", 12.5, 20.0), LoggedStretch("b", 10.0, 20.0),
        LoggedStretch("f", 10.0, 20.0),
    ]  # fmt: skip


def test_a_drive_with_the_errors_of_its_fixes():
    two = np.zeros((2, 3))
    fixes = Fixes(np.array([0.0, 1.0]), two, two, 1.5, 0.25, 3.5, 0.125, 60.0)
    record = {
        "id": "harbour",
        "toml": "title = 1",
        "start_C_nb_xyzw": "[0.5, 0.5, 0.5, 0.5]",
        "start_sigma_rad": "0.0625",
        "position_sigma_m": "1.5",
        "velocity_sigma_m_s": "0.25",
        "position_drift_m": "3.5",
        "velocity_drift_m_s": "0.125",
        "drift_time_s": "60.0",
    }
    start = Rotation.from_quat(THIRD)
    assert describe_drive("harbour", "title = 1", fixes, start, 0.0625) == record
    found = drive_of({"drive": record})
    assert found is not None
    assert (found.label, found.start, found.start_sigma) == ("harbour", THIRD, 0.0625)
    assert found.errors == {
        "position_sigma": 1.5, "velocity_sigma": 0.25, "position_drift": 3.5,
        "velocity_drift": 0.125, "drift_time": 60.0,
    }  # fmt: skip
    assert drive_of({}) is None


def test_epoch_and_end():
    assert epoch_of({"run": {"epoch_ns": "1700000000000000001"}}) == 1700000000000000001
    assert interrupted_at({"interrupted": {"t_s": "12.5"}}) == 12.5
    assert interrupted_at({}) == float("inf")


def test_innovations_as_text():
    values = np.array([[0.001, -0.0234567891, 3.0], [4.0, 5.0, 6.0]])
    curve = InnovationCurves(
        "fine", 'a "b", c', np.array([500_000_000, 1_250_000_001]), values, values[::-1]
    )
    assert innovations_csv([curve]) == (
        "method,label,time_s,innovation_N_m,innovation_E_m,innovation_D_m,"
        "sigma_N_m,sigma_E_m,sigma_D_m\n"
        'fine,"a ""b"", c",0.500000000,0.001,-0.0234568,3,4,5,6\n'
        'fine,"a ""b"", c",1.250000001,4,5,6,0.001,-0.0234568,3\n'
    )
