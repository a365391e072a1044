"""A ring-laser instrument's own logs, one axis up and then down: numbers of methods.md section 5.

The logs are not part of the project; where they lie beside it they are read, elsewhere these
tests are skipped.
"""

import re
from math import degrees, radians
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from alignment import ESTIMATORS, Dwell, ImuReadings, Options, Site
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
        # Tenths of a degree by which they differ are gyro bias, and no flag is due for that; the
        # accelerometers settle for minutes, by 23 to 27 ug, and where gyros see the base turn
        # meanwhile, by arc seconds, they may drift.
        flag, *more = estimate.flags
        assert all(one.startswith("may drift from end to end, gyros by 0.0") for one in more)
        assert re.match(r"drift from end to end .*: accelerometers by 2[37] ug: counted", flag)
        # Scatter of windows of 60 s is 0.13 to 0.18 deg and goes as 1/T to 1/sqrt(T).
        assert radians(0.13 / 5) < estimate.latitude_sigma < radians(0.18)


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
        # Adjacent means of 64 s differ by 0.0053 and 0.0060 deg/rt-h; those of the whole by less.
        duration = readings.interval * len(readings)
        slow = np.sqrt(mean_variance(readings.w_ib_b)[0] * duration)
        assert degrees(white) * 60 == pytest.approx(0.33, abs=ROUNDING)
        assert 0.002 < degrees(slow) * 60 < 0.008


# --- windows of a minute ------------------------------------------------------------------------

HERE = Site(radians(51.14))
TO_Y1 = {  # the axis that is vertical becomes Y1, up
    "up": np.array([[0, 0, 1.0], [1, 0, 0], [0, 1, 0]]),
    "down": np.array([[0, 0, 1.0], [-1, 0, 0], [0, -1, 0]]),
}


def windows(dwell, seconds, count):
    return [
        Dwell(dwell.label, a, min(a + seconds, dwell.t_to), dwell.readings)
        for a in dwell.t_from + seconds * np.arange(count)
    ]


def kinds(dwells, method):
    """Squared deviations of the windows' estimates from their mean, (3,) roll, yaw, pitch and
    latitude, summed, and the stated variances as often."""
    found = [e for d in dwells for e in ESTIMATORS[method].estimate([d], HERE, Options())]
    found = [e for e in found if e.window != "same"]
    angles = np.unwrap([e.angles for e in found], axis=0)
    values = {"tilt": angles[:, [0, 2]], "heading": angles[:, [1]]}
    stated = {k: np.array([e.sigmas[i] for e in found]) ** 2 for k, i in (("heading", [1]),)}
    stated["tilt"] = np.array([e.sigmas[[0, 2]] for e in found]) ** 2
    if found[0].latitude is not None:
        values["latitude"] = np.array([[e.latitude] for e in found])
        stated["latitude"] = np.array([[e.latitude_sigma] for e in found]) ** 2
    n = len(found)
    return {
        k: (np.sum(v.var(axis=0) * n), np.sum(stated[k].mean(axis=0)) * (n - 1))
        for k, v in values.items()
    }


@pytest.mark.parametrize(
    "method",
    ["triad", "single-gyro", "six-position", "rk4", "two-sample", "two-gyro", "inertial", "fine"],
)
def test_windows_of_a_minute_scatter_as_they_say(dwells, method):
    """Both logs, no data sheet: squares of deviations over those stated, per degree of freedom.

    Inertial and fine were 20 to 70 times too sure of nothing: 0.03 and less.
    """
    total = {}
    for dwell in dwells:
        if method == "two-gyro":
            P = TO_Y1[dwell.label]
            r = dwell.readings
            turned = ImuReadings(r.t, r.w_ib_b @ P.T, r.f_b @ P.T)
            dwell = Dwell(dwell.label, dwell.t_from, dwell.t_to, turned)
        for kind, sums in kinds(windows(dwell, 60.0, 5), method).items():
            total.setdefault(kind, []).append(sums)
    ratios = {k: np.sum(v, axis=0)[0] / np.sum(v, axis=0)[1] for k, v in total.items()}
    assert all(0.2 < ratio < 3 for ratio in ratios.values()), ratios


@pytest.mark.parametrize(("method", "seconds"), [("inertial", 100.0), ("fine", 150.0)])
def test_windows_begun_anywhere_scatter_as_they_say(dwells, method, seconds):
    """Of 100 s, every 20 s: eleven of each log overlap, worth five degrees of freedom at least.

    A log of 300 s has three windows side by side, whose headings happen to lie within 0.04 deg:
    0.02 to 0.08 of the variance that all of these have. The base turns by 8 arc seconds while it
    settles; gyros see it, so it is no drift of accelerometers, which would feign 0.41 deg, nor of
    gyros: ratios were 0.01 to 0.1, too. Of 150 s eight: those of the filter were a degree off, ten
    sigmas, where its noise differed from axis to axis as dither does.
    """
    sums = []
    for dwell in dwells:
        starts = dwell.t_from + np.arange(0.0, 301.0 - seconds, 20.0)
        ends = np.minimum(starts + seconds, dwell.t_to)
        parts = [
            Dwell(dwell.label, a, b, dwell.readings) for a, b in zip(starts, ends, strict=True)
        ]
        found = [ESTIMATORS[method].estimate([part], HERE, Options())[0] for part in parts]
        yaw = np.unwrap([e.angles[1] for e in found])
        sums.append((yaw.var(ddof=1), np.mean([e.sigmas[1] ** 2 for e in found])))
    ratio = float(np.divide(*np.sum(sums, axis=0)))
    assert 0.2 < ratio < 3, sums


@pytest.mark.parametrize("method", ["inertial", "fine"])
def test_whole_logs_are_not_stated_as_unknown(dwells, method):
    """300 s: 0.83 deg were stated; what a settling of the accelerometers would feign is 0.2, most
    of which gyros see as a turn of the base in one log: windows of 100 s, begun anywhere, scatter
    by 0.04 deg there and by 0.12 in the other, so three of them by 1/sqrt(3) of that at least."""
    least = {"up": 0.023, "down": 0.07}
    for estimate in ESTIMATORS[method].estimate(dwells, HERE, Options()):
        assert least[estimate.label] < degrees(estimate.sigmas[1]) < 0.3
        assert any("counted as one sigma" in flag for flag in estimate.flags)
