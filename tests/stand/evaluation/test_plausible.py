"""What a record says of itself: units, signs, sites and stamps that cannot be, each by its name.

The readings are written by hand: Earth's rate and gravity of a level unit, in the axes that a
heading gives.
"""

import numpy as np
import pytest

import stand
from alignment.errors import Fault
from stand.recording.mcap import write_imu_log

RATE, G = 7.292115e-5, 9.81  # rad/s, m/s^2


def record(
    path, latitude=48.5, heading=30.0, n=6000, rate_hz=100, scale=(1.0, 1.0), t=None, noise=1e-5
):
    """FLU level at rest; noise 1e-5 rad/s a sample: latitude from 60 s to 0.1 deg."""
    rng = np.random.default_rng(4)
    lat, head = np.radians([latitude, heading])
    north, up = RATE * np.cos(lat), RATE * np.sin(lat)
    w = np.array([north * np.cos(head), north * np.sin(head), up])
    w = w + noise * rng.normal(size=(n, 3))
    f = np.array([0.0, 0.0, G]) + 1e-3 * rng.normal(size=(n, 3))
    t = np.arange(1, n + 1) / rate_hz if t is None else t
    write_imu_log(
        path,
        t_ns=np.round(t * 1e9).astype(np.int64),
        w_ib_b=w * scale[0],
        f_b=f * scale[1],
        metadata={},
    )
    return path


def flags(path, method="triad", **more):
    (estimate,) = stand.align(path, method, **more).estimates
    return estimate.flags


def refused(path, method, **more):
    with pytest.raises(Fault) as caught:
        stand.align(path, method, **more)
    return str(caught.value)


@pytest.mark.parametrize("latitude", [-33.9, 48.5, 69.6])
@pytest.mark.parametrize("method", ["inertial", "fine"])
def test_latitude_of_the_wrong_sign_is_refused(tmp_path, latitude, method):
    path = record(tmp_path / "a.mcap", latitude)
    told = refused(path, method, latitude_deg=-latitude)
    assert f"gives latitude {latitude:.3g}"[:-3] in told
    assert told.endswith("its sign, or that of the accelerometers, is wrong")
    (estimate,) = stand.align(path, method, latitude_deg=latitude).estimates
    assert np.degrees(estimate.heading) == pytest.approx(30.0, abs=1.5)  # 5 sigma at 69.6 deg
    assert not [flag for flag in estimate.flags if "latitude" in flag]


def test_specific_force_of_the_wrong_sign(tmp_path):
    path = record(tmp_path / "a.mcap", scale=(1.0, -1.0))
    assert "that of the accelerometers" in refused(path, "inertial", latitude_deg=48.5)
    assert "that of the accelerometers" in flags(path, latitude_deg=48.5)[-1]
    assert not flags(path)  # without a stated latitude nobody can tell


def test_another_site_is_flagged(tmp_path):
    path = record(tmp_path / "a.mcap")
    assert flags(path, latitude_deg=30.0)[-1].endswith("another site, or gyro biases")
    assert not flags(path, latitude_deg=47.0)


@pytest.mark.parametrize(
    ("unit", "si"), [("deg/s", 57.29578), ("deg/h", 206264.8), ("mdps", 57295.78)]
)
def test_rates_in_another_unit(tmp_path, unit, si):
    """Flagged for triad, which needs no scale; refused where the stated latitude confirms it."""
    path = record(tmp_path / "a.mcap", scale=(si, 1.0), noise=1e-9)
    assert flags(path)[-1].endswith(f"times Earth's: {unit} for rad/s?")
    told = refused(path, "inertial", latitude_deg=48.5)
    assert told.endswith(f"times Earth's: {unit} for rad/s?")


@pytest.mark.parametrize(
    ("scale", "words"),
    [
        (1 / 9.80665, "specific force 1: g for m/s^2?"),
        (1e3 / 9.80665, "specific force 1000: mg for m/s^2?"),
        (16384 / 9.80665, "specific force 1.639e+04 m/s^2, gravity is 9.8: in counts?"),
    ],
)
def test_forces_in_another_unit(tmp_path, scale, words):
    path = record(tmp_path / "a.mcap", scale=(1.0, scale))
    assert flags(path)[-1] == words
    assert refused(path, "inertial", latitude_deg=48.5).endswith(words)


def test_a_poor_unit_says_nothing(tmp_path):
    """A bias of 3 Earth rates: its mean rate is of no known mix-up and has no latitude."""
    path = record(tmp_path / "a.mcap", scale=(3.0, 1.0))
    assert not [flag for flag in flags(path, latitude_deg=-48.5) if "latitude" in flag]


@pytest.mark.parametrize(("size", "apart"), [(2, 1e-3), (4, 1e-4), (10, 1e-5)])
def test_bursts_are_evened_and_told(tmp_path, size, apart):
    n = 6000
    even = np.arange(1, n + 1) / 100
    t = np.repeat(even[size - 1 :: size], size) + np.tile(np.arange(size) * apart, n // size)
    log = stand.read(record(tmp_path / "a.mcap", t=t))
    (told,) = log.doubts
    assert told.startswith(f"{n // size} bursts of {size} samples: the stamps are those of arrival")
    steps = np.diff(log.dwells[0].readings.t)
    np.testing.assert_allclose(steps, steps[0], rtol=1e-6)
    # a line through the stamps: its slope is off by the first and last burst alone
    assert steps[0] == pytest.approx(0.01, rel=2 * size / n)
    assert told in flags(tmp_path / "a.mcap")


@pytest.mark.parametrize("times", [2, 3])
def test_values_that_repeat_are_told(tmp_path, times):
    path = record(tmp_path / "a.mcap")
    read = stand.read(path).imu
    k = np.repeat(np.arange(len(read)), times)
    write_imu_log(
        tmp_path / "b.mcap",
        t_ns=10_000_000 // times * np.arange(1, len(k) + 1),
        w_ib_b=read.w_ib_b[k],
        f_b=read.f_b[k],
        metadata={},
    )
    told = flags(tmp_path / "b.mcap")
    assert told[-2:] == tuple(f"{s}: every value stands {times} times" for s in ("gyro", "accel"))
    assert not flags(path)
