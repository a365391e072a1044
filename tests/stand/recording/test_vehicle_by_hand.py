"""A vehicle's stretch by hand: which fixes count, where they are, whose word of errors holds."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from alignment import ImuReadings
from stand.errors import StandError
from stand.recording.mcap.reader import FixLog, VelocityLog
from stand.recording.metadata import LoggedDrive, LoggedStretch
from stand.recording.vehicle_log import Vehicle, vehicle_dwell, vehicle_of

S = 1_000_000_000
ORIGIN = 5 * S
READINGS = ImuReadings(np.arange(1.0, 10.0), np.zeros((9, 3)), np.ones((9, 3)))
HALF = (0.0, 0.0, 2**-0.5, 2**-0.5)  # a quarter about down
DRIVE = LoggedDrive("harbour", HALF, 0.02, {"position_sigma": 7.0, "drift_time": 50.0})
SAID = {"position_sigma": 4.0, "velocity_sigma": 0.5}


def logs(seconds=(1.0, 2.0, 4.0, 8.0), late=(0.0005, 0.0, 0.002, -0.001), variance=(4.0, np.nan)):
    """At the equator and Greenwich, a hundred metres up: to east 1, north 2, up 3 m/s and more."""
    n = len(seconds)
    t = np.round(np.array(seconds) * S).astype(np.int64) + ORIGIN
    v_t = t + np.round(np.array(late) * S).astype(np.int64)
    place = np.tile([0.0, 0.0, 100.0], (n, 1))
    v = np.outer(1.0 + np.arange(n), [1.0, 2.0, 3.0])
    stated = np.resize(variance, n).copy()
    stated.flags.writeable = False
    places = FixLog("log", "/fix", t, place, stated)
    return places, VelocityLog("log", "/v", v_t, v, np.resize([0.25, 0.25, 9.0], n))


def dwell(vehicle=None, drive=None, t_from=0.0, t_to=10.0, **how):
    places, velocities = logs(**how)
    file = SimpleNamespace(path="log", fixes=lambda: places, velocities=lambda: velocities)
    stretch = LoggedStretch("all of it", t_from, t_to)
    vehicle = Vehicle() if vehicle is None else vehicle
    return vehicle_dwell(file, stretch, READINGS, ORIGIN, drive, vehicle)


def test_fixes_with_a_velocity_of_their_time():
    """Within a millisecond, so not the third. Up is away from the Earth's axis, x of e; east is y,
    north z."""
    found = dwell()
    assert (found.label, found.t_from, found.t_to) == ("all of it", 1.0, 8.0)
    assert (found.nominal, found.nominal_sigma) == (None, None)
    fixes = found.fixes
    assert fixes.t.tolist() == [1.0, 2.0, 8.0]
    assert fixes.position == pytest.approx(np.tile([6378237.0, 0.0, 0.0], (3, 1)), abs=1e-6)
    by_hand = np.outer([1.0, 2.0, 4.0], [3.0, 1.0, 2.0])
    assert fixes.velocity == pytest.approx(by_hand, abs=1e-12)
    # of what messages state the usual: sqrt(4), and sqrt(0.25) of 0.25, 0.25 and 0.25
    assert (fixes.position_sigma, fixes.velocity_sigma) == (2.0, 0.5)
    assert (fixes.position_drift, fixes.velocity_drift, fixes.drift_time) == (0.0, 0.0, 100.0)


def test_of_a_stretch_those_at_its_ends_count():
    assert dwell(t_from=2.0, t_to=8.0, variance=(4.0,)).fixes.t.tolist() == [2.0, 8.0]
    assert dwell(t_from=1.0, t_to=7.99).fixes.t.tolist() == [1.0, 2.0]
    with pytest.raises(StandError) as caught:
        dwell(t_from=1.5, t_to=7.0)
    assert str(caught.value) == (
        "log: /fix: 1 fixes with a velocity from 1.500 to 7.000 s, at least 2 are needed"
    )
    with pytest.raises(StandError) as caught:
        dwell(late=(0.25, 0.25, 0.25, 0.5))
    assert str(caught.value) == (
        "log: /v: no velocity within 1 ms of any fix of /fix: the nearest is 0.25 s away"
    )


def test_what_is_said_counts_before_what_a_recording_says_and_that_before_messages():
    found = dwell(drive=DRIVE)
    fixes = found.fixes
    assert found.label == "harbour"
    assert (fixes.position_sigma, fixes.velocity_sigma, fixes.drift_time) == (7.0, 0.5, 50.0)
    assert found.nominal.as_quat() == pytest.approx(HALF)
    assert found.nominal_sigma == 0.02
    said = dwell(Vehicle(**SAID), DRIVE).fixes
    assert (said.position_sigma, said.velocity_sigma, said.drift_time) == (4.0, 0.5, 50.0)
    # how wrong the start is may be said alone
    found = dwell(Vehicle(start_sigma=0.5), DRIVE)
    assert (found.nominal_sigma, found.nominal.as_quat()[3]) == (0.5, pytest.approx(2**-0.5))
    other = Vehicle(Rotation.identity(), 0.25)
    found = dwell(other, DRIVE)
    assert (found.nominal.magnitude(), found.nominal_sigma) == (0.0, 0.25)
    # the programmed start is that of the first fix of all
    found = dwell(drive=DRIVE, t_from=1.5)
    assert (found.nominal, found.nominal_sigma) == (None, None)
    with pytest.raises(StandError) as caught:
        dwell(variance=(np.nan,))
    assert str(caught.value) == (
        "log: /fix: states no covariance: the noise of the fixes must be given"
    )


def test_what_a_person_says_of_a_vehicle():
    assert vehicle_of(False, None, None, None) is None
    assert vehicle_of(True, None, None, None) == Vehicle()
    found = vehicle_of(False, [0.0, 90.0, 0.0], 45.0, [3.0, 0.25])
    assert found.start_sigma == pytest.approx(0.7853981633974483)
    assert (found.position_sigma, found.velocity_sigma) == (3.0, 0.25)
    # a yaw of 90 deg to port: X1 to west, Y1 stays up
    north_west = found.start.apply([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    assert north_west == pytest.approx(np.array([[0, -1, 0], [0, 0, -1]]), abs=1e-15)
    assert vehicle_of(False, None, 180.0, None).start_sigma == pytest.approx(np.pi)
    for options, said in (
        (([1.0, 2.0], None, None), "start_attitude_deg = [1.0, 2.0]: must be 3 numbers"),
        (([1.0, 2.0, np.inf], None, None), "start_attitude_deg = [1.0, 2.0, inf]: must be 3"),
        ((None, 0.0, None), "--start-sigma 0: must be above 0, at most 180 deg"),
        ((None, 180.1, None), "--start-sigma 180.1: must be above 0, at most 180 deg"),
        ((None, None, [1.0]), "fix_sigma = [1.0]: must be 2 numbers"),
        ((None, None, [1.0, 0.0]), "--fix-sigma 1,0: both must be above 0"),
    ):
        with pytest.raises(StandError) as caught:
            vehicle_of(False, *options)
        assert str(caught.value).startswith(said)
