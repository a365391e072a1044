"""Rests on a base that rocks: how far off their table's angles they were, and sigmas that hold."""

import numpy as np
import pytest
from rocking import Angle, Motion, noisy
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from alignment import ESTIMATORS, Dwell, Options, Site
from alignment.noise import check_rest
from alignment.options import Priors
from alignment.readings import ImuReadings
from alignment.rocked import rocked_covariance, rocked_doubt

RATE = 20
SITE = Site(latitude=np.radians(48.5), local_gravity=9.81)
LAST = ("rk4", "two-sample")  # methods that tell the attitude at the end
AMPLITUDE = np.radians(0.1)
GYRO, ACCEL = np.radians(0.05) / 60, 1e-4 * 9.81 / 10  # rad/rt-s, m/s^2/rt-Hz


def record(motion, seconds, seed=0, start=0.0):
    rng = np.random.default_rng(seed)
    t, w, f, _ = motion.readings(seconds, RATE, start)
    w, f = noisy(rng, w, f, RATE, 1, GYRO, ACCEL)
    return ImuReadings(t, w[0], f[0])


def rocks(**axes):
    waves = {name: Angle(amplitude=AMPLITUDE, frequency=0.1) for name in axes}
    return Motion(**waves)


def test_the_variance_of_a_wave_is_half_its_amplitude_squared():
    """Of whole periods, seen in 1 s means: those keep sinc(0.1) = 0.984 of a wave of 0.1 Hz."""
    wave, kept = AMPLITUDE**2 / 2, np.sinc(0.1) ** 2
    level = rocked_covariance(record(rocks(pitch=1), 100.0))
    # Y1 is up; a lean about one level axis counts for both, for nobody knows where north is
    assert level == pytest.approx(np.diag([0.5, 0, 0.5]) * wave * kept, rel=0.03, abs=0.03 * wave)
    round_it = rocked_covariance(record(rocks(yaw=1), 100.0))
    assert round_it == pytest.approx(np.diag([0, 1, 0]) * wave, rel=0.05, abs=1e-3 * wave)


def test_what_stands_still_or_drifts_has_not_rocked():
    still = record(Motion(), 600.0)
    assert not rocked_covariance(still).any()
    assert rocked_doubt(still) == ()
    drift = 0.05 * np.linspace(0, 1, len(still))[:, None]  # 5 mg in ten minutes, no gyro turns
    drifting = ImuReadings(still.t, still.w_ib_b, still.f_b + drift)
    assert not rocked_covariance(drifting).any()
    # all three gyros by 60 deg/h: 0.8 deg about each axis, of which two would have leaned
    alike = np.radians(60) / 3600 * np.sin(2 * np.pi * still.t[:, None] / 300)
    assert not rocked_covariance(ImuReadings(still.t, still.w_ib_b + alike, still.f_b)).any()
    one = np.outer(alike, [0.0, 1.0, 0.0])  # Y1 is up: by the gyro that no force can contradict
    found = rocked_covariance(ImuReadings(still.t, still.w_ib_b + one, still.f_b))
    turned = np.radians(60) / 3600 * 300 / (2 * np.pi)
    assert found[1, 1] == pytest.approx(turned**2 / 2, rel=0.2)


@pytest.mark.parametrize("method", ["triad", "single-gyro"])
def test_means_have_the_mean_attitude(method):
    """Of a wave of 0.1 deg, two and a quarter long, a good unit: off the mean by seconds of arc,
    off the end by 0.093 deg. A mean over t leaves ``(1 - cos(2 pi f t))/(2 pi f t)`` of it."""
    wave = Angle(amplitude=AMPLITUDE, frequency=0.1)
    motion = Motion(pitch=wave, latitude_deg=48.5)
    t, w, f, _ = motion.readings(22.5, RATE)
    still = ImuReadings(t, w, f)
    (told,) = ESTIMATORS[method].estimate([Dwell("a", 0.0, 22.5, still)], SITE, Options())
    states = Rotation.from_matrix(motion.state(np.linspace(0, 22.5, 4501))[0])
    mean, end = states.mean(), states[-1]
    off, late = (np.degrees((told.C_nb * C.inv()).apply([0.0, 0.0, 1.0])[:2]) for C in (mean, end))
    assert np.linalg.norm(off) < 1e-3
    share = 1 - (1 - np.cos(4.5 * np.pi)) / (4.5 * np.pi)
    assert np.linalg.norm(late) == pytest.approx(0.1 * share, abs=1e-3)
    assert any("this is the mean attitude" in flag for flag in told.flags)


@pytest.mark.parametrize("method", ["six-position", "rk4", "two-sample", "two-position"])
def test_sigmas_hold_on_a_base_that_rocks(method):
    """Rests of 7 s within a wave of 10 s, each begun anywhere in it: errors of 0.1 deg."""
    priors = Priors(gyro_bias=np.radians(0.01) / 3600, accel_bias=1e-5 * 9.81)
    squares = []
    for seed in range(40):
        rng = np.random.default_rng([seed, 1])
        dwells, truths = [], []
        for k, turn in enumerate((0.0, np.pi)):
            wave = Angle(amplitude=AMPLITUDE, frequency=0.1, phase=rng.uniform(0, 2 * np.pi))
            motion = Motion(yaw=Angle(start=turn), pitch=wave, latitude_deg=48.5)
            t0 = 20.0 * k
            readings = record(motion, 7.0, 2 * seed + k, t0)
            check_rest(readings, "")  # or there would be nothing to promise
            still = Motion(yaw=Angle(start=turn)).state(np.zeros(1))[0][0]
            dwells.append(Dwell(str(k), t0, t0 + 7.0, readings, Rotation.from_matrix(still)))
            states = motion.state(np.linspace(0, 7.0, 1401))[0]
            fresh = states[400:] if method == "six-position" else states
            mean = Rotation.from_matrix(fresh).mean()
            truths.append(Rotation.from_matrix(states[-1]) if method in LAST else mean)
        options = Options(offset_window=2.0, priors=priors, verdicts=False)
        for e in ESTIMATORS[method].estimate(dwells, SITE, options):
            if e.covariance is None:
                continue
            down = (e.C_nb * truths[int(e.label)].inv()).apply([0.0, 0.0, 1.0])
            tilt = np.array([-down[1], down[0]])
            squares.append(tilt @ np.linalg.solve(e.covariance[:2, :2], tilt) / 2)
            assert any("rocks by" in flag for flag in e.flags)
    assert len(squares) >= 40
    # a part of a wave looks like a drift, which counts too: sigmas are up to 8 times too large
    assert 0.01 < np.mean(squares) < chi2.ppf(0.999, 80) / 80
