"""Numbers of a drive are sane, not only finite: what no vehicle does is refused, and at once."""

import time

import pytest

from stand.errors import StandError
from stand.evaluation.drive_result import DriveSettings
from stand.imu import load_imu
from stand.toml_files import Source
from stand.vehicle.scenario import drive_from

LEG = {"label": '"a"', "duration_s": "10"}
START = {"latitude_deg": "48.5", "speed_m_s": "20"}


def drive(leg=(), start=(), satellite=(), legs=1):
    def keys(values):
        return "".join(f"{key} = {value}\n" for key, value in values.items())

    text = 'title = "t"\ndescription = "d"\n'
    text += "[start]\n" + keys(START | dict(start))
    text += "[satellite]\n" + keys(dict(satellite))
    text += ("[[leg]]\n" + keys(LEG | dict(leg))) * legs
    return drive_from(Source("mine", "mine.toml", text))


@pytest.mark.parametrize(
    ("parts", "said"),
    [
        ({"leg": {"duration_s": 2592000}}, 'leg 1 "a", duration_s = 2592000: must be less than'),
        ({"leg": {"duration_s": 1e-300}}, 'leg 1 "a", duration_s = 1e-300: must be greater than'),
        ({"leg": {"duration_s": 8000}, "legs": 2}, "together they take 16000 s, must be at most"),
        ({"leg": {"speed_m_s": 1e308}}, "speed_m_s = 1e+308: must be less than or equal to 3000"),
        ({"leg": {"turn_deg": -1e308}}, "turn_deg = -1e+308: must be greater than or equal to"),
        (
            {"leg": {"weaves": 1000, "weave_deg": 1}, "legs": 9},
            "leg: together they turn 18009 times, must be at most 5000",
        ),
        ({"start": {"speed_m_s": 1e9}}, "start, speed_m_s = 1000000000.0: must be less than"),
        ({"start": {"heading_deg": 1e300}}, "start, heading_deg = 1e+300: must be less than"),
        (
            {"start": {"speed_m_s": 3000, "climb_deg": 60}, "leg": {"duration_s": 1000}},
            "must be from -12000 to 120000 m",
        ),
        ({"satellite": {"interval_s": 1e-9}}, "satellite, interval_s = 1e-09: must be greater"),
        (
            {"satellite": {"interval_s": 0.01}, "leg": {"duration_s": 1000}},
            "satellite: 100000 fixes, must be at most 50000",
        ),
        ({"satellite": {"position_noise_m": 1e308}}, "position_noise_m = 1e+308: must be less"),
        ({"satellite": {"drift_time_s": 1e-300}}, "drift_time_s = 1e-300: must be greater"),
    ],
)
def test_what_no_vehicle_does_is_refused(parts, said):
    begin = time.process_time()
    with pytest.raises(StandError) as told:
        drive(**parts)
    assert said in str(told.value)
    assert str(told.value).startswith("mine.toml: ")
    assert "\n" not in str(told.value)
    assert time.process_time() - begin < 2.0


def test_more_samples_than_can_be_held_are_refused():
    long = drive(leg={"duration_s": 1200})
    with pytest.raises(StandError, match=r"rate = 10000 Hz: 1\.2e\+07 samples in 1200 s"):
        DriveSettings(long, load_imu("stim300"), rate_hz=10000)
    assert DriveSettings(long, load_imu("stim300"), rate_hz=8000).rate_hz == 8000
