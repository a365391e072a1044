"""Sines, Scorsby motion and coning: published peaks, closed forms, rest at both ends, refusals."""

import numpy as np
import pytest
from chain import AXES, EARTH_RATE, pose, sensors, turn
from hypothesis import given
from hypothesis import strategies as st

from stand.errors import StandError
from stand.motion.polynomial import Motion
from stand.motion.waves import coning, envelope, fade_of, scorsby, sines, smooth_step
from stand.physics.mjcf import describe, load_model
from stand.procedure.steps import (
    ConingMotion,
    ScorsbyMotion,
    SineMotion,
    SwayMotion,
    VibrationMotion,
)

DEG = np.pi / 180
MODEL = describe(load_model())
STEADY, LEAD = 20.0, 4.0


def at(motion: Motion, t_from: float, t_to: float, n: int = 4001):
    t = np.linspace(t_from, t_to, n)
    return t, *motion.joints(t)


def assert_rests(motion: Motion, length: float) -> None:
    """From 0 to `length`, at zero offset and at rest at both ends."""
    assert motion.start == 0.0
    assert motion.duration == pytest.approx(length, rel=1e-15)
    angle, rate, acceleration = motion.joints([0.0, length])
    _, rates, accelerations = motion.joints(np.linspace(0, length, 2001))
    assert angle[0].tolist() == [0.0] * 6
    assert np.abs(angle[1]).max() < 1e-15  # rounding of a radian
    # the fit loses 1e-12 of a rate and 1e-10 of an acceleration, a fast fade ten times that;
    # attitudes of a radian round by 4e-16, in derivatives over a piece's 0.1 s by 1e-12, 1e-9
    assert np.abs(rate).max() < 2e-11 * np.abs(rates).max() + 1e-12
    assert np.abs(acceleration).max() < 2e-9 * np.abs(accelerations).max() + 1e-9


# ------------------------------------------------------------------------------------- fades


def test_the_step_is_four_times_smooth():
    # 126 x^5 - 420 x^6 + 540 x^7 - 315 x^8 + 70 x^9 at a half, by hand: symmetry says 1/2; at a
    # quarter 126/1024 - 420/4096 + 540/16384 - 315/65536 + 70/262144 = 12826/262144
    x = np.array([-1.0, 0.0, 0.25, 0.5, 1.0, 7.0])
    np.testing.assert_allclose(smooth_step(x), [0, 0, 12826 / 262144, 0.5, 1, 1], atol=1e-15)
    h = 1e-3
    near = smooth_step(np.array([h, 1 - h]))
    # 126 h^5: four derivatives vanish; rounding of 1 at the other end
    np.testing.assert_allclose([near[0], 1 - near[1]], 126 * h**5, rtol=0.01, atol=4e-16)


def test_the_envelope_is_full_for_as_long_as_it_should():
    t = np.array([0.0, 2.0, 4.0, 11.0, 24.0, 26.0, 28.0])
    np.testing.assert_allclose(envelope(t, STEADY, LEAD), [0, 0.5, 1, 1, 1, 0.5, 0], atol=1e-15)


def test_fades_by_default():
    wave = {"amplitude_deg": 1.0, "frequency_hz": 0.3}
    fast = {"amplitude_deg": 1.0, "frequency_hz": 40.0}
    sway = {"rms_deg": 1.0, "frequency_hz": 0.15}
    jitter = {"rms_deg_s2": 1.0, "low_hz": 5.0, "high_hz": 50.0}
    # two periods of the slowest in whole seconds: 2 / 0.3 = 6.67
    assert fade_of(SineMotion.model_validate({"axes": {"outer": wave, "inner": fast}})) == 7.0
    assert fade_of(SineMotion.model_validate({"axes": {"outer": fast}})) == 1.0
    assert fade_of(ScorsbyMotion(amplitude_deg={"base_yaw": 1.0}, period_s=6.0)) == 12.0
    assert fade_of(ConingMotion(axis="X1", half_angle_deg=1.0, frequency_hz=-0.2)) == 10.0
    assert fade_of(SwayMotion.model_validate({"axes": {"outer": sway}})) == 14.0
    assert (
        fade_of(SwayMotion.model_validate({"axes": {"outer": sway | {"frequency_hz": 9}}})) == 2.0
    )
    assert fade_of(SwayMotion.model_validate({"axes": {"outer": {"psd_file": "a.csv"}}})) == 10.0
    assert fade_of(VibrationMotion.model_validate({"axes": {"outer": jitter}})) == 2.0
    assert fade_of(SineMotion.model_validate({"axes": {"outer": wave}, "fade_s": 0.5})) == 0.5


# ------------------------------------------------------------------------------------- sines


def test_sines_by_hand():
    entry = SineMotion.model_validate(
        {
            "axes": {
                "outer": {"amplitude_deg": 2.0, "frequency_hz": 0.25, "phase_deg": 90.0},
                "base_pitch": {"amplitude_deg": 10.0, "frequency_hz": 0.5},
            }
        }
    )
    motion = sines(entry, STEADY, LEAD)
    assert_rests(motion, STEADY + 2 * LEAD)
    angle, rate, acceleration = (x / DEG for x in motion.joints([LEAD, LEAD + 0.5, LEAD + 1.0]))
    w = np.pi / 2  # of outer: cosine, quarter turns of phase per second
    half = 2 * np.sqrt(0.5)
    # fitted to 1e-12 of the rate and 2e-10 of the acceleration
    np.testing.assert_allclose(angle[:, 3], [2, half, 0], atol=1e-11)
    np.testing.assert_allclose(rate[:, 3], [0, -half * w, -2 * w], atol=1e-9)
    np.testing.assert_allclose(acceleration[:, 3], [-2 * w * w, -half * w * w, 0], atol=1e-8)
    np.testing.assert_allclose(angle[:, 1], [0, 10, 0], atol=1e-11)
    np.testing.assert_allclose(rate[:, 1], [10 * np.pi, 0, -10 * np.pi], atol=1e-8)
    assert not angle[:, [0, 2, 4, 5]].any()


@given(st.floats(0.05, 200), st.floats(-360, 360), st.floats(0.01, 5), st.floats(0.1, 5))
def test_any_sine_keeps_its_shape_and_rests(frequency, phase, lead, steady):
    wave = {"amplitude_deg": 3.0, "frequency_hz": frequency, "phase_deg": phase}
    motion = sines(SineMotion.model_validate({"axes": {"inner": wave}}), steady, lead)
    assert_rests(motion, steady + 2 * lead)
    t, angle, _, acceleration = at(motion, 0, steady + 2 * lead, 501)
    w = 2 * np.pi * frequency
    exact = envelope(t, steady, lead) * 3 * DEG * np.sin(w * (t - lead) + phase * DEG)
    # times round, and phases with them: 1e-16 of up to 2e4 rad
    rounding = 4e-16 * (w * (2 * lead + steady) + 10)
    np.testing.assert_allclose(angle[:, 5], exact, rtol=0, atol=1e-13 + rounding)
    inside = (t > lead) & (t < lead + steady)
    # in the second derivative of a fit 260 * 85 times as much, as in test_motion
    largest = 3 * DEG * max(w * w, 10 / lead**2) * (1e-9 + 260 * 85 * rounding)
    expected = -w * w * exact[inside]
    np.testing.assert_allclose(acceleration[inside, 5], expected, rtol=0, atol=largest)


def test_too_many_periods_are_refused_in_one_line():
    wave = {"amplitude_deg": 0.1, "frequency_hz": 100.0}
    entry = SineMotion.model_validate({"axes": {"outer": wave}})
    with pytest.raises(
        StandError,
        match=r"^frequency_hz = 100: 3602 s of it are 360200 periods, "
        r"allowed 40000$",
    ):
        sines(entry, 3600.0, 1.0)


# ----------------------------------------------------------------------------------- Scorsby


def test_scorsby_peaks_of_the_classical_test():
    entry = ScorsbyMotion(
        amplitude_deg={"base_roll": 20.0, "base_pitch": 20.0, "base_yaw": 20.0}, period_s=6.0
    )
    lead = fade_of(entry)
    motion = scorsby(entry, 60.0, lead)
    assert_rests(motion, 60 + 2 * lead)
    _, angle, rate, acceleration = at(motion, lead, lead + 60.0, 60001)
    # by hand: 20 * 2 pi / 6 = 20.94395 deg/s and 20 (2 pi / 6)^2 = 21.93245 deg/s^2
    np.testing.assert_allclose(np.abs(angle).max(axis=0) / DEG, [20] * 3 + [0] * 3, atol=1e-5)
    np.testing.assert_allclose(np.abs(rate).max(axis=0)[:3] / DEG, 20.94395, atol=1e-5)
    np.testing.assert_allclose(np.abs(acceleration).max(axis=0)[:3] / DEG, 21.93245, atol=2e-5)
    # pitch a quarter of the period ahead of roll and yaw: at the beginning it is at its peak
    np.testing.assert_allclose(angle[0, :3] / DEG, [0, 20, 0], atol=1e-10)
    np.testing.assert_allclose(angle[:-1500, 1], angle[1500:, 0], atol=1e-10)


def test_fades_hardly_add_to_the_peaks():
    entry = ScorsbyMotion(amplitude_deg={"base_roll": 20.0, "base_pitch": 20.0}, period_s=6.0)
    _, angle, rate, acceleration = at(scorsby(entry, 60.0, 12.0), 0, 84, 20001)
    assert np.abs(angle).max() / DEG < 20.001
    assert np.abs(rate).max() / DEG < 20.945
    # measured 22.37: the fade's own 2.46 / lead (peak slope of the step) is felt beside w = 1.05
    assert np.abs(acceleration).max() / DEG < 1.025 * 21.932


def test_scorsby_phases_as_told():
    entry = ScorsbyMotion(
        amplitude_deg={"base_roll": 5.0, "base_yaw": 3.0},
        period_s=2.0,
        phase_deg={"base_yaw": 90.0},
    )
    angle, _, _ = scorsby(entry, STEADY, LEAD).joints([LEAD, LEAD + 0.5])
    # half a second is a quarter of the period
    np.testing.assert_allclose(angle[:, :3] / DEG, [[0, 0, 3], [5, 0, 0]], atol=1e-10)


# ------------------------------------------------------------------------------------ coning

UNIT = {"X1": 0, "Y1": 1, "Z1": 2}
PLACES = {
    "north-up-east": [0.0] * 6,
    "base tilted, gimbals anywhere": [0.2, -0.1, 0.3, 2.5, 0.5, -1.0],
    "middle beyond 90 deg": [0.0, 0.1, 0.0, -3.0, 2.4, 7.0],
}


def seen(motion: Motion, joints, t):
    """C_wb (n, 3, 3) and w_ib_b without Earth rate (n, 3), by the independent chain."""
    q, v, a = motion.joints(t)
    q = q + joints
    C_wb, _ = pose(q)
    rate, _ = sensors(q, v, a, 0.7, 9.8)
    earth = EARTH_RATE * np.array([0.0, np.cos(0.7), np.sin(0.7)])
    return C_wb, rate - np.einsum("nji,j->ni", C_wb, earth)


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("axis", UNIT)
@pytest.mark.parametrize(("half_angle", "frequency"), [(1.0, 5.0), (25.0, -0.5)])
def test_coning_is_the_classical_one(axis, half_angle, frequency, place):
    joints = np.array(PLACES[place])
    entry = ConingMotion(axis=axis, half_angle_deg=half_angle, frequency_hz=frequency)
    motion = coning(entry, STEADY, LEAD, joints, MODEL)
    assert_rests(motion, STEADY + 2 * LEAD)
    t = np.linspace(LEAD, LEAD + STEADY, 2001)
    C_wb, rate = seen(motion, joints, t)
    start, _ = pose(joints[None])
    i = UNIT[axis]
    k, e1, e2 = (np.eye(3)[(i + n) % 3] for n in range(3))
    alpha, w = half_angle * DEG, 2 * np.pi * frequency
    p = w * (t - LEAD)
    u = np.cos(p)[:, None] * e1 + np.sin(p)[:, None] * e2
    across = -np.sin(p)[:, None] * e1 + np.cos(p)[:, None] * e2  # k x u
    # the attitude: Rodrigues' formula about u by alpha, row by row
    turned = np.concatenate([turn(axis_b, np.array([alpha])) for axis_b in u[::100]])
    np.testing.assert_allclose(C_wb[::100], start @ turned, rtol=0, atol=1e-11)
    # the rate: sin(alpha) w about k x u, and a constant -(1 - cos(alpha)) w about the cone's axis
    exact = w * (np.sin(alpha) * across - (1 - np.cos(alpha)) * k)
    # gimbal angles fitted to 1e-12, in their rate 260 times and per piece of a tenth of a period
    np.testing.assert_allclose(rate, exact, rtol=0, atol=1e-9 * abs(w))
    # the mean over whole turns, which integrates to the classical drift
    assert np.mean(rate[:-1, i]) == pytest.approx(-(1 - np.cos(alpha)) * w, abs=1e-9)


def test_coning_drift_by_hand():
    # 1 deg at 5 Hz: 2 pi 5 (1 - cos 1 deg) = 31.41593 * 1.523048e-4 rad/s = 0.274149 deg/s
    entry = ConingMotion(axis="X1", half_angle_deg=1.0, frequency_hz=5.0)
    motion = coning(entry, STEADY, LEAD, np.zeros(6), MODEL)
    _, rate = seen(motion, np.zeros(6), np.linspace(LEAD, LEAD + 10, 5001)[:-1])
    np.testing.assert_allclose(rate.mean(axis=0) / DEG, [-0.274149, 0, 0], atol=1e-6)


@pytest.mark.parametrize("turns", [10, 9.95, 10.05, 10 + 1e-9, 1])
def test_coning_turn_after_turn(turns):
    """Whole turns repeat one, others are fitted throughout (9.95 in as many pieces as 10)."""
    entry = ConingMotion(axis="X1", half_angle_deg=2.0, frequency_hz=5.0)
    motion = coning(entry, turns / 5.0, 1.0, np.zeros(6), MODEL)
    t = 1 + np.linspace(0, turns / 5.0, 3001)
    C_wb, rate = seen(motion, np.zeros(6), t)
    assert abs(np.linalg.norm(rate, axis=1) / (20 * np.pi * np.sin(1 * DEG)) - 1).max() < 1e-8
    # X1 leans toward u x X1, u = Y1 cos p + Z1 sin p: its part along Y1 is sin(2 deg) sin p
    start, _ = pose(np.zeros((1, 6)))
    part = np.einsum("j,njk,k->n", start[0, :, 1], C_wb, [1.0, 0.0, 0.0])
    wanted = np.sin(2 * DEG) * np.sin(10 * np.pi * (t - 1))
    assert np.abs(part - wanted).max() < 1e-12  # the fit's, of the angle


def test_the_other_joints_stay_and_the_base_moves_never():
    entry = ConingMotion(axis="Y1", half_angle_deg=10.0, frequency_hz=1.0)
    motion = coning(entry, STEADY, LEAD, np.array([0.1, 0.2, 0.3, 0, 0, 0]), MODEL)
    assert not motion.coefficients[:, :, :3].any()
    assert len(AXES) == motion.coefficients.shape[2]


def test_large_cones_are_followed_as_exactly():
    entry = ConingMotion(axis="X1", half_angle_deg=60.0, frequency_hz=5.0)
    motion = coning(entry, 2.0, 1.0, np.zeros(6), MODEL)
    t = np.linspace(1, 3, 3001)
    _, rate = seen(motion, np.zeros(6), t)
    # |w_b| is constant: w sqrt(sin^2 + (1 - cos)^2) = 2 w sin(alpha / 2) = w at 60 deg
    np.testing.assert_allclose(np.linalg.norm(rate, axis=1), 10 * np.pi, rtol=1e-9)


@given(
    st.floats(-7, 7),
    st.floats(-78, 78),
    st.floats(-7, 7),
    st.sampled_from(["X1", "Y1", "Z1"]),
    st.floats(0.1, 60),
)
def test_coning_comes_back_or_is_refused(outer, middle, inner, axis, half_angle):
    joints = np.array([0.0, 0.0, 0.0, outer, middle * DEG, inner])
    entry = ConingMotion(axis=axis, half_angle_deg=half_angle, frequency_hz=1.0)
    try:
        motion = coning(entry, 1.0, 2.0, joints, MODEL)
    except StandError:
        # only where the cone reaches the vertical: |middle| + half angle >= 89 deg
        assert abs(middle) + half_angle > 88.9
        return
    assert_rests(motion, 5.0)
    t = np.linspace(2, 3, 11)
    C_wb, _ = seen(motion, joints, t)
    start, _ = pose(joints[None])
    turned = np.einsum("ji,njk->nik", start[0], C_wb)
    angle = np.arccos(np.clip((np.trace(turned, axis1=1, axis2=2) - 1) / 2, -1, 1))
    np.testing.assert_allclose(angle, half_angle * DEG, rtol=0, atol=1e-7)  # arccos of rounding


def test_gimbal_lock_is_told_with_time_axis_and_distance():
    def entry(axis, half_angle):
        return ConingMotion(axis=axis, half_angle_deg=half_angle, frequency_hz=1.0)

    joints = np.array([0, 0, 0, 0, 80 * DEG, 0])
    with pytest.raises(
        StandError,
        match=r"^gimbal lock at 2\.250 s: middle comes within 0\.50 deg of \+-90 deg, allowed 1 ",
    ):
        coning(entry("X1", 9.5), 10.0, 2.0, joints, MODEL)
    with pytest.raises(
        StandError, match=r"^gimbal lock inside the cone, nearest at .* deg of \+-90"
    ) as inside:
        coning(entry("X1", 20.0), 10.0, 2.0, joints, MODEL)
    # at full size 10 deg beyond the lock, on the way there nearer, and not so near as not allowed
    assert 1 < float(str(inside.value).partition("within ")[2].partition(" ")[0]) < 10
    assert coning(entry("X1", 8.9), 10.0, 2.0, joints, MODEL).duration == 14.0
    # no whole turn at full size, and still the lock is met or gone round
    with pytest.raises(StandError, match=r"^gimbal lock"):
        coning(entry("X1", 20.0), 0.1, 2.0, joints, MODEL)
