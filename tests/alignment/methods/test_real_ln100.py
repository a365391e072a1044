"""A ring-laser instrument's own logs, one axis up and then down: numbers of methods.md section 5.

The logs are not part of the project; where they lie beside it they are read, elsewhere these
tests are skipped.
"""

from math import degrees, radians
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from alignment import Dwell, ImuReadings, Options, Site
from alignment.methods.integration import integrate
from alignment.methods.triad import triad
from alignment.noise import check_at_rest, mean_variance

FOLDER = Path(__file__).resolve().parents[3].parent / "shared" / "data" / "real" / "ln100"
DEG_H = np.pi / 180 / 3600
ROUNDING = 0.005  # deg: of the published figures

pytestmark = pytest.mark.skipif(
    not (FOLDER / "x_LN100_up.ins").exists() or not (FOLDER / "x_LN100_down.ins").exists(),
    reason=f"the ring-laser logs are not part of the project; none in {FOLDER}",
)


def read(name):
    """Columns t [s], gyros [deg/s], accelerometers [m/s^2]: little-endian doubles.

    The first sample's interval began before its stamp. It belongs to the record: dither makes one
    sample in 19 000 worth 0.02 deg of latitude.
    """
    table = np.fromfile(FOLDER / f"x_LN100_{name}.ins", dtype="<f8").reshape(-1, 7)
    readings = ImuReadings(table[:, 0], np.radians(table[:, 1:4]), table[:, 4:7])
    return Dwell(name, readings.t[0] - readings.interval, readings.t[-1], readings)


@pytest.fixture(scope="module")
def dwells():
    return [read("up"), read("down")]


def test_latitudes(dwells):
    up, down, pair = triad(dwells, Site(None), Options())
    assert (up.label, down.label, pair.label) == ("up", "down", "up + down")
    assert degrees(up.latitude) == pytest.approx(51.08, abs=ROUNDING)
    assert degrees(down.latitude) == pytest.approx(52.36, abs=ROUNDING)
    assert degrees(pair.latitude) == pytest.approx(51.14, abs=ROUNDING)
    for estimate in (up, down):
        assert not estimate.singular  # X1 vertical is read by yaw-roll-pitch
        assert estimate.heading is None
        # Tenths of a degree by which they differ are gyro bias, and no flag is due for that.
        assert estimate.flags == ()
        # 0.006-0.017 deg/rt-h at the length of a block, over 300 s, against 15.04 deg/h.
        assert radians(0.07) < estimate.latitude_sigma < radians(0.23)


def test_tilt_from_the_mean_force(dwells):
    # Mean forces of the logs by hand: (9.80629, -0.00577, 0.05760), (-9.80714, -0.05037, -0.06002)
    for estimate, up_b in zip(
        triad(dwells, Site(None), Options()),
        ([9.80629, -0.00577, 0.05760], [-9.80714, -0.05037, -0.06002]),
        strict=False,
    ):
        got = estimate.C_nb.inv().apply([0, 0, -1])
        # The written means are rounded to 5e-6 m/s^2.
        np.testing.assert_allclose(got, np.array(up_b) / np.linalg.norm(up_b), rtol=0, atol=1e-6)


def test_bias_of_the_vertical_axis(dwells):
    rates = [d.window().w_ib_b[:, 0].mean() / DEG_H for d in dwells]
    # The Earth's part turns over with the axis, its bias does not.
    assert np.mean(rates) == pytest.approx(-0.25, abs=0.005)


def test_the_stamps_jitter_and_are_used(dwells):
    for dwell in dwells:
        steps = np.diff(dwell.readings.t)
        assert 0.02e-3 < steps.std() < 0.05e-3
        assert 0.3e-3 < np.ptp(steps) < 0.5e-3
        # A constant rate over these stamps turns by rate x elapsed, exactly so.
        n = len(steps) + 1
        w = np.array([0.01, -0.02, 0.03])
        constant = ImuReadings(dwell.readings.t, np.tile(w, (n, 1)), dwell.readings.f_b)
        ends = np.array([1, n // 3, n])
        found = integrate(constant, Rotation.identity(), np.zeros(3), np.zeros(3), ends)
        first = dwell.readings.t[0] - dwell.readings.interval
        want = Rotation.from_rotvec(np.outer(dwell.readings.t[ends - 1] - first, w))
        # 19 000 products of rounding 1e-16. Even spacing would miss by 1e-6 in the middle.
        assert (want.inv() * found).magnitude().max() < 1e-11


def test_it_is_at_rest(dwells):
    for dwell in dwells:
        check_at_rest(dwell)


def test_dither_looks_like_noise_but_is_not(dwells):
    for dwell in dwells:
        readings = dwell.window()
        white = readings.w_ib_b[:, 0].std(ddof=1) * np.sqrt(readings.interval)
        # The record over 32 is 9.4 s: what survives of 0.33 deg/rt-h there is near 0.01.
        duration = readings.interval * len(readings)
        slow = np.sqrt(mean_variance(readings.w_ib_b)[0] * duration)
        assert degrees(white) * 60 == pytest.approx(0.33, abs=ROUNDING)
        assert 0.005 < degrees(slow) * 60 < 0.02
