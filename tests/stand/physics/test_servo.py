"""The simulated servos against closed forms of one axis; the table classes on the whole stand."""

# pyright: reportAttributeAccessIssue=false

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import mujoco
import numpy as np
import pytest
import ruckig
from mujoco.batch import Batch
from numpy.typing import ArrayLike

from stand import toml_files as catalogue
from stand.errors import StandError
from stand.motion.polynomial import Motion, fitted
from stand.physics.dynamics import NO_PAYLOAD, Payload, inertias, required_torque, weights_model
from stand.physics.following import Account, Followed, ServoSteps, StepSpan
from stand.physics.mjcf import load_model
from stand.physics.servo import BLOCK, MotorDrive, Servo
from stand.table.joints import JOINTS
from stand.table.table import Table, load_table

DEG, ARC_SECOND = 0.017453292519943295, 4.84813681109536e-06
STAND = load_model()
OWN = 2.0  # kg m^2: inertia of the one axis that counts
_REST = 'inertial pos="0 0 0" mass="1e-6" diaginertia="1e-6 1e-6 1e-6"'
_AXES = ("0 1 0", "1 0 0", "0 0 1", "0 0 1", "1 0 0", "0 1 0")


def one_axis() -> mujoco.MjModel:
    """A chain in which all but base_roll weighs a millionth: base_roll is alone to about 1e-6."""
    heavy = f'inertial pos="0 0 0" mass="1" diaginertia="{OWN} {OWN} {OWN}"'
    opened = "".join(
        f'<body name="{name}"><joint name="{name}" axis="{axis}"/><{weight}/>'
        for name, axis, weight in zip(JOINTS, _AXES, [heavy, *[_REST] * 5], strict=True)
    )
    option = '<option gravity="0 0 -9.80665"/>'
    motors = "".join(
        f'<dcmotor name="{name}" joint="{name}" motorconst="1 1" resistance="1" input="pos"/>'
        for name in JOINTS
    )
    return mujoco.MjModel.from_xml_string(
        f"<mujoco>{option}<worldbody>{opened}{'</body>' * 6}</worldbody>"
        f"<actuator>{motors}</actuator></mujoco>"
    )


ALONE = one_axis()


@pytest.fixture
def table(tmp_path: Path):
    """A table whose base_roll has the given motor keys; other axes a plain soft servo."""

    def make(**keys: float) -> Table:
        motor = {"torque_Nm": 1e6, "bandwidth_hz": 10.0, **keys}
        text = ['title = "made"', 'source = "the test"']
        for name in JOINTS:
            has = motor if name == "base_roll" else {"torque_Nm": 1e3, "bandwidth_hz": 1.0}
            text += [f"[axis.{name}]", "rate_deg_s = 500.0", "acceleration_deg_s2 = 5000.0"]
            text += ["jerk_deg_s3 = 50000.0", f"[axis.{name}.motor]"]
            text += [f"{key} = {value}" for key, value in has.items()]
        path = tmp_path / "made.toml"
        path.write_text("\n".join(text))
        return load_table(str(path))

    return make


def told(drive: MotorDrive, n: int, angle: ArrayLike = 0.0, rate: ArrayLike = 0.0) -> np.ndarray:
    """Inputs of n steps: base_roll's angle and rate, no feedforward; the others at zero."""
    inputs = np.zeros((n, len(JOINTS), 3))
    inputs[:, 0, 0], inputs[:, 0, 1] = angle, rate
    return inputs.reshape(n, -1)


def rolled(drive: MotorDrive, inputs: np.ndarray) -> np.ndarray:
    """Angle of base_roll (n + 1,) at the start of each step and after the last."""
    out = Batch(drive.model, 1, nthread=1).rollout(len(inputs), inputs[None])
    return np.concatenate([[0.0], out["qpos"][0, :, 0]])


def turning(rate: float, duration: float, axis: int = 0) -> Motion:
    """Rest for 1 s, a ramp of 1 s to `rate` [rad/s], constant for `duration` s."""
    c = np.zeros((3, 3, len(JOINTS)))
    c[0, 1, axis] = c[2, 2, axis] = rate / 2
    c[1, 2, axis] = rate
    return Motion(np.array([0.0, 1.0, 2.0, 2.0 + duration]), c)


# --- one axis against the second-order system


def second_order(t: np.ndarray, w: float, damping: float) -> np.ndarray:
    """Step response of ``w^2 / (s^2 + 2 damping w s + w^2)`` to a unit step, damping < 1."""
    wd = w * np.sqrt(1 - damping**2)
    decay = np.exp(-damping * w * t)
    return 1 - decay * (np.cos(wd * t) + damping * w / wd * np.sin(wd * t))


def step_error(table, step: float) -> float:
    drive = MotorDrive(ALONE, table(damping=0.5), step=step)
    n = round(0.4 / step)
    got = rolled(drive, told(drive, n, 0.001)) / 0.001
    return float(np.abs(got - second_order(np.arange(n + 1) * step, 62.8318530717959, 0.5)).max())


def test_step_response_and_order_of_the_integrator(table):
    errors = [step_error(table, step) for step in (4e-3, 2e-3, 1e-3, 5e-4)]
    # semi-implicit Euler: the rate is half a step behind, w h / 2 of the step: 3 % at 1 ms
    assert errors[2] < 0.03
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    np.testing.assert_allclose(orders, 1.0, atol=0.15)  # second-order terms at 4 ms


def test_ramp_without_rate_demand_lags_by_two_damping_over_w(table):
    drive = MotorDrive(ALONE, table(damping=0.7))
    rate, n = 0.1, 2000
    got = rolled(drive, told(drive, n, rate * np.arange(n) * 1e-3))
    lag = rate * (n - 1) * 1e-3 - got[-2]
    # 2 * 0.7 / (2 pi 10) * 0.1 rad, and the angle's half-step lag behind the rate: none at rest
    assert lag == pytest.approx(2 * 0.7 / 62.8318530717959 * rate, rel=1e-4)


def test_viscous_friction_lags_and_the_integrator_takes_it_away(table):
    rate, n, step = 0.1, 6000, 1e-3
    lags = []
    for more in ({}, {"integral_s": 0.2}):
        drive = MotorDrive(ALONE, table(viscous_Nm_s=40.0, **more))
        got = rolled(drive, told(drive, n, rate * np.arange(n) * step, rate))
        lags.append(rate * (n - 1) * step - got[-2])
    kp = OWN * 62.8318530717959**2
    assert lags[0] == pytest.approx(40.0 * rate / kp, rel=1e-4)
    assert abs(lags[1]) < 1e-9 * rate  # the slowest mode, 0.2 s, has decayed by e^-30


def test_an_undisturbed_axis_follows_to_rounding(table):
    wave = fitted(
        lambda t: np.column_stack([1 - np.cos(3 * t), *[0 * t] * 5]), np.linspace(0, 10, 100)
    )
    servo = Servo(ALONE, table(viscous_Nm_s=3.0), wave, spans=[StepSpan(0, 10, False)])
    # rounding of angles up to 2 rad, differenced twice and integrated twice again; coupling 1e-6
    assert servo.followed()[0].greatest_error[0] < 1e-9


def test_torque_of_a_sine_is_inertia_times_w_squared_times_amplitude(table):
    w, amplitude = 5.0, 0.2

    def wave(t: np.ndarray) -> np.ndarray:
        fade = np.clip(t / 4, 0, 1) ** 3 * (
            10 - 15 * np.clip(t / 4, 0, 1) + 6 * np.clip(t / 4, 0, 1) ** 2
        )
        return np.column_stack([amplitude * fade * np.sin(w * t), *[0 * t] * 5])

    spans = [StepSpan(5.0, 15.0, False)]
    servo = Servo(ALONE, table(), fitted(wave, np.linspace(0, 16, 160)), spans=spans)
    (followed,) = servo.followed()
    # the others weigh 5e-6 of it; samples at 1 ms meet the crest within (w h)^2 / 8
    assert followed.peak_torque[0] == pytest.approx(OWN * w**2 * amplitude, rel=2e-5)
    assert followed.saturated_s[0] == 0


def test_settling_time_of_a_step(table):
    made = table(damping=0.5)
    drive, n, size = MotorDrive(ALONE, made), 3000, 100 * ARC_SECOND
    error = np.zeros((n, 6))
    error[:, 0] = size - rolled(drive, told(drive, n, size))[:-1]
    account = Account(made, 0.0, 1e-3, [StepSpan(0.0, 3.0, True)], 6)
    for first in range(0, n, 700):  # however it is cut
        part = error[first : first + 700]
        account.add(first, ServoSteps(np.zeros_like(part), part, np.zeros_like(part), drive.limit))
    t = np.arange(0, 3, 1e-5)
    away = np.abs(1 - second_order(t, 62.8318530717959, 0.5)) * size > 5 * ARC_SECOND
    expected = t[np.flatnonzero(away)[-1]]
    # first order, w h / 2 = 3 % of an envelope that falls at 31 / s: 1 ms; and a step or two
    assert account.followed()[0].settling_s[0] == pytest.approx(expected, abs=0.003)


# --- friction, cogging, saturation


def test_cogging_ripple(table):
    rate, poles, torque = 20 * DEG, 36, 0.5
    made = table(cogging_Nm=torque, cogging_per_turn=poles, damping=0.7)
    servo = Servo(ALONE, made, turning(rate, 20.0))
    n = 18000  # exactly one turn from 3 s on: 36 periods
    t = 3.0 + np.arange(n) * 1e-3
    ripple = servo.covering(3.0, 21.0).joints(t)[0][:, 0] - (rate / 2 + rate * (t - 2.0))
    spectrum = np.abs(np.fft.rfft(ripple)) * 2 / n
    assert np.argmax(spectrum[1:]) + 1 == poles  # cogging frequency = poles x rate: 2 Hz
    w, w0 = poles * rate, 62.8318530717959
    response = torque / OWN / abs(w0**2 - w**2 + 2j * 0.7 * w0 * w)
    # linear theory: cogging bends with the ripple itself, poles * amplitude = 2e-3; and w h / 2
    assert spectrum[poles] == pytest.approx(response, rel=0.01)


def rates_of(servo: Servo, t_from: float, t_to: float) -> np.ndarray:
    return servo.covering(t_from, t_to).joints(np.arange(t_from, t_to, 1e-3))[1][:, 0]


def test_sticks_and_slips_when_slow_and_glides_when_fast(table):
    made = table(
        bandwidth_hz=1.0,
        damping=0.05,
        coulomb_Nm=1.0,
        static_Nm=1.6,
        stribeck_deg_s=0.5,
        bristle_Nm_rad=20000.0,
    )
    slow, fast = 0.05 * DEG, 20 * DEG
    crawling = rates_of(Servo(ALONE, made, turning(slow, 120.0)), 40.0, 120.0) / slow
    assert np.mean(np.abs(crawling) < 0.1) > 0.5  # mostly stuck
    assert crawling.max() > 5  # and then it jumps
    starts = np.count_nonzero((crawling[1:] > 1) & (crawling[:-1] <= 1))
    assert starts >= 5  # again and again
    gliding = rates_of(Servo(ALONE, made, turning(fast, 60.0)), 50.0, 60.0) / fast
    # free decay of the loop, e^(-0.05 * 6.28 * 48) = 3e-7
    np.testing.assert_allclose(gliding, 1.0, atol=1e-5)


def test_saturation_is_counted(table):
    rate = 1.0  # rad/s within 1 s: 2 N m
    enough = Servo(ALONE, table(torque_Nm=2.1), turning(rate, 8.0), spans=[StepSpan(1, 2, False)])
    (followed,) = enough.followed()
    assert followed.saturated_s[0] == 0
    assert followed.peak_torque[0] == pytest.approx(2.0, rel=1e-4)  # coupling 5e-6 and its loops
    weak = Servo(ALONE, table(torque_Nm=1.5), turning(rate, 8.0), spans=[StepSpan(1, 2, False)])
    (followed,) = weak.followed()
    assert followed.saturated_s[0] == pytest.approx(1.0, abs=0.01)  # all of the ramp
    assert followed.peak_torque[0] == 1.5
    # short by 0.5 N m for 1 s: 0.5 / 2 / 2 rad behind
    assert followed.greatest_error[0] == pytest.approx(0.125, rel=0.01)


# --- energy, torque, imbalance on the whole stand


def waves(duration: float) -> Motion:
    sizes = np.array([0.1, 0.1, 0.1, 1.0, 1.0, 1.0])
    speeds = np.array([1.0, 1.1, 0.9, 0.7, 1.5, 2.0])
    knots = np.linspace(0, duration, round(duration * 5) + 1)
    return fitted(lambda t: sizes * (1 - np.cos(np.outer(t, speeds))), knots)


def energy_gap(step: float) -> tuple[float, float]:
    """Work of all torques less the gain of energy, and the greatest kinetic energy [J]."""
    drive = MotorDrive(STAND, load_table("rocking-platform"), step=step)
    drive.model.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_ENERGY)
    n = round(5.0 / step)
    inputs = drive.controls(waves(6.0).joints(np.arange(-1, n + 1) * step)[0])
    batch = Batch(drive.model, 1, nthread=1)
    drive.settle(batch, np.zeros(6))
    out = batch.rollout(n, inputs[None], record=("qpos", "qvel", "energy", "actuator_force"))
    angles, rates = out["qpos"][0], out["qvel"][0]
    # records: state after a step, force and energy at its start; a force works along the mean
    # of the rates before and after the step
    moved = (rates[1:] + rates[:-1]) / 2 * step
    work = np.einsum("ij,ij->", out["actuator_force"][0, 1:], moved)
    work -= np.einsum("ij,ij,j->", rates[:-1], moved, drive.model.dof_damping)
    energy = out["energy"][0].sum(axis=1)
    data = mujoco.MjData(drive.model)
    data.qpos[:], data.qvel[:] = angles[-1], rates[-1]
    mujoco.mj_forward(drive.model, data)
    gained = data.energy.sum() - energy[1]
    return work - gained, out["energy"][0, :, 1].max()


def test_work_of_the_motors_is_energy_gained_and_dissipated():
    (coarse, kinetic), (fine, _) = energy_gap(1e-3), energy_gap(5e-4)
    assert kinetic > 3  # J: there is something to balance
    assert abs(coarse) < 2e-3 * kinetic  # first order: (w h) of rates up to 2 rad/s
    assert fine / coarse == pytest.approx(0.5, abs=0.1)


def test_motor_torque_is_what_mujoco_applies(table):
    drive = MotorDrive(ALONE, table(torque_Nm=3.0, integral_s=0.3))  # no friction, no cogging
    rng = np.random.default_rng(3)
    inputs = rng.normal(size=(50, 18)) * 1e-3
    out = Batch(drive.model, 1, nthread=1).rollout(
        50, inputs[None], record=("qpos", "qvel", "act", "actuator_force")
    )
    got = drive.torques(inputs[1:], *(out[k][0, :-1] for k in ("qpos", "qvel", "act")))
    np.testing.assert_allclose(got, out["actuator_force"][0, 1:], rtol=1e-12, atol=1e-12)
    assert (np.abs(got[:, 0]) == 3.0).any()


def test_required_torque_is_inverse_dynamics():
    rng = np.random.default_rng(11)
    q, v, a = rng.normal(size=(3, 4, 6))
    v[2, 3] = 0.0
    made = load_table("mid-class")
    got = required_torque(STAND, made, NO_PAYLOAD, q, v, a)
    data = mujoco.MjData(STAND)
    viscous = np.array([8.0, 6.0, 4.0, 0.5, 0.1, 0.01])
    coulomb = np.array([2.0, 2.0, 1.5, 0.4, 0.1, 0.015])
    for row in range(4):
        data.qpos[:], data.qvel[:], data.qacc[:] = q[row], v[row], a[row]
        mujoco.mj_inverse(STAND, data)
        friction = viscous * v[row] + coulomb * np.sign(v[row])
        # rounding of torques up to 1000 N m
        np.testing.assert_allclose(got[row], data.qfrc_inverse + friction, rtol=0, atol=1e-10)


def test_imbalance_loads_its_motor_with_m_g_r():
    payload = Payload(2.0, np.array([0.05, 0.0, 0.0]))  # east of the inner axis, which is north
    still = Motion(np.array([0.0, 4.0]), np.zeros((1, 1, 6)))
    made = load_table("laboratory")
    torque = required_torque(STAND, made, payload, *np.zeros((3, 1, 6)))
    empty = required_torque(STAND, made, NO_PAYLOAD, *np.zeros((3, 1, 6)))
    assert abs(torque[0, 5] - empty[0, 5]) == pytest.approx(0.980665, rel=1e-12)
    servo = Servo(STAND, made, still, payload, spans=[StepSpan(0.0, 4.0, True)])
    (followed,) = servo.followed()
    assert followed.peak_torque[5] == pytest.approx(abs(torque[0, 5]), rel=1e-6)
    assert followed.greatest_error.max() < 1e-9  # settled from the start: rounding only
    assert followed.settled


def test_payload_adds_its_inertia():
    offset = np.array([0.1, 0.2, -0.3])
    more = inertias(weights_model(STAND, Payload(3.0, offset))) - inertias(weights_model(STAND))
    # point mass: about north 3 (0.1^2 + 0.3^2), east 3 (0.2^2 + 0.3^2), up 3 (0.1^2 + 0.2^2)
    np.testing.assert_allclose(more[3:], [0.15, 0.39, 0.30], rtol=1e-12)
    # and about the base's axes, 0.68 m lower
    np.testing.assert_allclose(more[:2], [3 * (0.01 + 0.38**2), 3 * (0.04 + 0.38**2)], rtol=1e-12)


def test_a_servo_without_integrator_starts_where_it_balances(tmp_path):
    text = load_table("laboratory").text.replace("integral_s", "# integral_s")
    path = tmp_path / "soft.toml"
    path.write_text(text)
    payload = Payload(2.0, np.array([0.05, 0.0, 0.0]))
    still = Motion(np.array([0.0, 4.0]), np.zeros((1, 1, 6)))
    servo = Servo(STAND, load_table(str(path)), still, payload, spans=[StepSpan(0.0, 4.0, True)])
    angles, rates, _ = servo.covering(0.0, 3.0).joints(np.arange(0, 3, 0.01))
    assert np.abs(angles[0, 5]) > ARC_SECOND
    assert np.ptp(angles, axis=0).max() < 1e-9  # no jump
    assert np.abs(rates).max() < 1e-7
    assert servo.followed()[0].settling_s[5] is None  # m g r / kp is beyond 5 arc seconds


# --- streaming


def test_realised_motion_does_not_depend_on_how_it_is_asked():
    made, demand = load_table("mid-class"), waves(14.0)
    t = np.arange(0, 14.0, 0.00037)
    whole = Servo(STAND, made, demand).covering(0.0, 14.0).joints(t)
    for length in (5.0, 0.7):
        servo = Servo(STAND, made, demand)
        for first in np.arange(0, 14.0, length):
            part = (t >= first) & (t < min(first + length, 14.0))
            got = servo.covering(first, min(first + length, 14.0)).joints(t[part])
            for a, b in zip(got, whole, strict=True):
                np.testing.assert_array_equal(a, b[part])


def jumps(motion, powers):
    """Greatest jumps of the derivatives in units of the step, across all knots."""
    h, c, lengths = 1e-3, motion.coefficients, np.diff(motion.knots)
    for power in powers:
        left = 0.0
        for p, term in zip((5, 4, 3, 2, 1, 0), c, strict=True):
            factor = np.prod(np.arange(p, p - power, -1)) * (p >= power)
            left = left + factor * lengths[:, None] ** max(p - power, 0) * term
        right = c[5 - power] * np.prod(np.arange(power, 0, -1))
        yield np.abs(left[:-1] - right[1:]).max() * h**power


def test_the_seams_of_blocks_are_smooth(monkeypatch):
    """Rounding of angles up to 2 rad, carried through a few sums; joined pieces have the angles,
    rates and accelerations of the spline where they meet, and jerks that are off by what their
    accelerations are allowed to be, over some steps."""
    motion = Servo(STAND, load_table("mid-class"), waves(12.0)).covering(0.0, 12.0)
    assert len(motion.knots) < 4000
    assert max(jumps(motion, range(3))) < 1e-13
    monkeypatch.setattr("stand.physics.servo.SMOOTH", -1.0)
    spline = Servo(STAND, load_table("mid-class"), waves(12.0)).covering(0.0, 12.0)
    assert len(spline.knots) > 12000
    assert max(jumps(spline, range(5))) < 1e-13
    t = np.arange(0.0, 12.0, 0.00037)
    off = [np.abs(a - b).max() for a, b in zip(motion.joints(t), spline.joints(t), strict=True)]
    # 3e-7 rad/s^2 at the steps, below twice that between; over 20 ms, at whose ends rates and
    # angles agree, all of it one way for a half makes a rate of a h/4, for two quarters a h^2/16
    assert off[2] < 2 * 3e-7
    assert off[1] < 3e-7 * 0.02 / 4
    assert off[0] < 3e-7 * 0.02**2 / 16


def test_held_before_the_start_and_after_the_end():
    demand = turning(0.1, 0.0001, axis=3)
    servo = Servo(STAND, load_table("precision"), demand)
    motion = servo.covering(-1.0, 9.0)
    angles, _, _ = motion.joints([-0.5, 0.5, 9.0])
    end = demand.joints([99.0])[0][0, 3]
    np.testing.assert_allclose(angles[:, 3], [0, 0, end], atol=1e-9)


def test_long_runs_forget():
    servo = Servo(STAND, load_table("mid-class"), waves(60.0))
    for first in range(0, 60, 5):
        servo.covering(first, first + 5)
    assert len(servo._pieces) * BLOCK * 1e-3 < 30  # s
    with pytest.raises(ValueError, match="kept from"):
        servo.covering(1.0, 2.0)
    # blocks of 4 s, each less the 48 steps that the next one changes: the tenth ends at 39.952 s,
    # before the 40 s that lie 15 s before the last span
    with pytest.raises(ValueError, match=r"t_from = 39.9515: kept from 39.952 s on only"):
        servo.covering(39.9515, 41.0)
    assert servo.covering(39.9525, 41.0).start == pytest.approx(39.952)


# --- accounts by hand


def account_of(spans: Sequence[StepSpan], error: np.ndarray) -> list[Followed]:
    made = load_table("laboratory")  # within 5 arc seconds for 0.2 s
    account = Account(made, 10.0, 0.1, spans, 1)
    demand = np.where(np.arange(len(error)) < 10, np.arange(len(error)), 10.0)[:, None]
    torque = np.linspace(0, 2.0, len(error))[:, None]
    rows = ServoSteps(
        demand, np.asarray(error, float)[:, None] * ARC_SECOND, torque, np.array([1.95])
    )
    account.add(0, rows.part(0, 13))
    account.add(13, rows.part(13, len(error)))
    return account.followed()


def test_account_by_hand():
    error = np.full(30, 4.0)
    error[3], error[12], error[15] = -40.0, 8.0, -6.0
    moving, resting, late = account_of(
        [StepSpan(10.0, 11.0, False), StepSpan(11.0, 12.5, True), StepSpan(12.5, 13.0, True)], error
    )
    assert moving.greatest_error[0] / ARC_SECOND == pytest.approx(40.0)
    assert moving.rms_error[0] / ARC_SECOND == pytest.approx(np.sqrt((9 * 16 + 1600) / 10))
    assert not moving.rests[0]
    assert moving.settling_s == (None,)
    assert resting.rests[0]
    assert resting.settling_s[0] == pytest.approx(0.6)  # step 15 is the last outside: 16 - 10
    assert resting.saturated_s[0] == 0
    assert late.settling_s == (0.0,)
    assert late.saturated_s[0] == pytest.approx(0.1)  # only the last, 2.0 of 1.95
    assert late.peak_torque[0] == 2.0


def test_never_settled():
    error = np.full(30, 1.0)
    error[28] = 9.0  # 0.1 s before the end, less than the hold
    (resting,) = account_of([StepSpan(11.0, 13.0, True)], error)
    assert resting.settling_s == (None,)
    assert not resting.settled


# --- refusals


def test_missing_motor(tmp_path):
    path = tmp_path / "bare.toml"
    bare = "\n".join(
        f"[axis.{name}]\nrate_deg_s = 1.0\nacceleration_deg_s2 = 1.0\njerk_deg_s3 = 1.0"
        for name in JOINTS
    )
    path.write_text(f'title = "t"\nsource = "s"\n{bare}')
    still = Motion(np.array([0.0, 1.0]), np.zeros((1, 1, 6)))
    with pytest.raises(
        StandError, match="table bare: axis base_roll, motor: required for --motion"
    ):
        Servo(STAND, load_table(str(path)), still)


def test_an_axis_that_runs_away_is_named():
    heavy = Payload(10.0, np.array([0.1, 0.0, 0.0]))  # 9.8 N m on a motor of 3 N m
    still = Motion(np.array([0.0, 4.0]), np.zeros((1, 1, 6)))
    servo = Servo(STAND, load_table("laboratory"), still, heavy)
    for _ in range(2):  # asked again it fails again
        with pytest.raises(StandError, match=r"axis inner ran away from its demand at 0\.\d+ s"):
            servo.covering(0.0, 4.0)


def test_divergence_is_raised_with_time_and_axis_and_leaves_no_file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    still = Motion(np.array([2.0, 6.0]), np.zeros((1, 1, 6)))
    servo = Servo(STAND, load_table("laboratory"), still)
    servo._batch.qvel[0, 4] = 1e11  # beyond what MuJoCo takes for a rate
    with pytest.raises(StandError, match=r"diverged at 2\.00[01] s, axis middle: .*QVEL"):
        servo.covering(2.0, 4.0)
    assert list(tmp_path.iterdir()) == []


def test_a_servo_too_stiff_for_the_step_is_refused(table):
    with pytest.raises(StandError) as refused:
        MotorDrive(ALONE, table(bandwidth_hz=150.0, damping=1.0))
    # (w h)^2 + 4 w h < 4 at a step of 1.25 ms: w h < 2 sqrt 2 - 2, so 105.5 Hz
    assert "axis base_roll, bandwidth_hz = 150: must be 105 or less at steps of 1 ms" in str(
        refused.value
    )
    MotorDrive(ALONE, table(bandwidth_hz=104.0, damping=1.0))
    MotorDrive(ALONE, table(bandwidth_hz=150.0, damping=1.0), step=5e-4)


@pytest.mark.parametrize(("bandwidth_hz", "grows"), [(129.0, False), (134.0, True)])
def test_the_limit_of_stiffness_is_where_the_simulation_rings_up(table, bandwidth_hz, grows):
    motors = [m for m in table(bandwidth_hz=bandwidth_hz, damping=1.0).motors if m is not None]
    model = weights_model(ALONE, NO_PAYLOAD, motors)  # unchecked: the limit is 131.8 Hz
    batch = Batch(model, 1, nthread=1)
    batch.qpos[0, 0] = 1e-6
    out = batch.rollout(400, np.zeros((1, 400, 18)))["qpos"][0, :, 0]
    assert (np.abs(out[-10:]).max() > 1e-6) == grows


def test_bristles_too_stiff_for_the_step_are_refused(table):
    with pytest.raises(StandError, match=r"bristle_Nm_rad = 1e\+08: too stiff for steps of 1 ms"):
        MotorDrive(ALONE, table(coulomb_Nm=1.0, bristle_Nm_rad=1e8))


# --- the table classes


def moves(table: Table, stops: Sequence[np.ndarray], dwell: float) -> tuple[Motion, list[StepSpan]]:
    """Moves of all axes at the table's full limits from stop to stop, a dwell at each."""
    knots, pieces, spans, at = [0.0], [], [], np.zeros(6)

    def add(length: float, cubic: Sequence[np.ndarray]) -> None:
        knots.append(knots[-1] + length)
        pieces.append(np.array(cubic))

    def rest() -> None:
        spans.append(StepSpan(knots[-1], knots[-1] + dwell, True))
        add(dwell, [np.zeros(6), np.zeros(6), np.zeros(6), at])

    rest()
    for stop in stops:
        begun = knots[-1]
        for length, cubic in _cubics(table, at, stop):
            add(length, cubic)
        spans.append(StepSpan(begun, knots[-1], False))
        at = np.array(stop)
        rest()
    return Motion(np.array(knots), np.stack(pieces, axis=1)), spans


def _cubics(table: Table, at: np.ndarray, stop: np.ndarray) -> list[tuple[float, list[np.ndarray]]]:
    way = ruckig.InputParameter(6)
    way.current_position, way.target_position = list(at), list(stop)
    way.max_velocity, way.max_acceleration = list(table.rate), list(table.acceleration)
    way.max_jerk, way.synchronization = list(table.jerk), ruckig.Synchronization.No
    found = ruckig.Trajectory(6)
    ruckig.Ruckig(6).calculate(way, found)
    switches = np.concatenate([np.cumsum(p.t) for p in found.profiles[0]])
    inner = np.unique(switches[(switches > 1e-8) & (switches < found.duration - 1e-8)])
    inner = inner[np.append(np.diff(inner), 1.0) > 1e-8]
    ends = np.concatenate([[0.0], inner, [found.duration]])
    pieces = []
    for first, last in pairwise(ends):
        q, v = (np.array(x) for x in found.at_time(first)[:2])
        late = np.array(found.at_time(last - 1e-10)[2])
        early = np.array(found.at_time(first + 1e-10)[2])
        pieces.append((last - first, [(late - early) / (last - first) / 6, early / 2, v, q]))
    return pieces


# greatest following error of base and gimbals in moves of all six at their full limits [arc
# seconds]: as measured, and about half as much again
FOLLOWS = {
    "precision": (12.0, 9.0),
    "laboratory": (60.0, 35.0),
    "mid-class": (60.0, 60.0),
    "rocking-platform": (600.0, 60.0),
}


def test_every_class_has_its_figures_here():
    assert set(FOLLOWS) == set(catalogue.ids("tables"))


@pytest.mark.parametrize("name", sorted(FOLLOWS))
def test_a_table_follows_moves_at_its_full_limits(name):
    table = load_table(name)
    base, half = np.array(table.high[:3]), np.full(3, np.pi / 2)
    none = np.zeros(3)
    stops = [
        np.concatenate(stop)
        for stop in (
            (none, half),
            (none, -2 * half),
            (base, half),
            (-base, -3 * half),
            (base * [-1, 1, 0], none),
            (none, none),
        )
    ]
    demand, spans = moves(table, stops, dwell=3.0)
    t = np.arange(0, demand.duration, 0.005)
    needed = np.abs(required_torque(STAND, table, NO_PAYLOAD, *demand.joints(t))).max(axis=0)
    assert (needed * 1.25 < table.torque).all()  # reserve for the servo's own needs
    servo = Servo(STAND, table, demand, spans=spans)
    followed = servo.followed()
    assert len(followed) == len(spans)
    assert not np.any([f.saturated_s for f in followed])
    assert all(f.settled for f in followed)
    worst = np.max([f.greatest_error for f in followed], axis=0) / ARC_SECOND
    assert (worst < np.repeat(FOLLOWS[name], 3)).all()
    # no limit cycle: in the last second of a rest the axes creep within settling, and do not swing
    end = demand.duration
    last = servo.covering(end - 1, end).joints(np.arange(end - 1, end, 1e-3))[0]
    assert np.ptp(last, axis=0).max() < 0.05 * table.settle_within
    swings = np.diff(np.sign(np.diff(last, axis=0)), axis=0)
    moved = np.abs(np.diff(last, axis=0)).max(axis=0) > 1e-12
    assert (np.count_nonzero(swings, axis=0)[moved] < 5).all()


def test_scorsby_on_the_rocking_platform():
    table = load_table("rocking-platform")
    w, size = 2 * np.pi / 6, 20 * DEG

    def scorsby(t: np.ndarray) -> np.ndarray:
        u = np.clip(t / 10, 0, 1)
        fade = size * u**3 * (10 - 15 * u + 6 * u**2)
        waves = [np.sin(w * t + phase) for phase in (0.0, np.pi / 2, np.pi)]
        return np.column_stack([*(fade * wave for wave in waves), *[0 * t] * 3])

    spans = [StepSpan(12.0, 36.0, False)]
    servo = Servo(STAND, table, fitted(scorsby, np.linspace(0, 40, 400)), spans=spans)
    (followed,) = servo.followed()
    assert not followed.saturated_s.any()
    # arc minutes on the base (measured 5), arc seconds on the gimbals it carries (measured 9)
    assert (followed.greatest_error[:3] < 480 * ARC_SECOND).all()
    assert (followed.greatest_error[3:] < 15 * ARC_SECOND).all()


def test_halving_the_step_changes_the_realised_motion_to_first_order():
    table, demand = load_table("rocking-platform"), waves(4.0)
    t, steps = np.arange(0, 4.0, 0.008), (2e-3, 1e-3, 5e-4, 2.5e-4)
    runs = [Servo(STAND, table, demand, step=h).covering(0, 4.0).joints(t)[0] for h in steps]
    changes = np.array([np.abs(a - b).max() for a, b in pairwise(runs)])
    # second-order terms: 3 % of an order at 2 ms
    np.testing.assert_allclose(np.log2(changes[:-1] / changes[1:]), 1.0, atol=0.1)


def test_light_bodies_turn_about_their_common_centre():
    """0.1 and 0.3 kg at 0 and 0.4 m: 0.3 0.4^2 = 0.048 kg m^2 about the hinge at 0, and spheres
    of 1 cm add 2/5 m r^2; their centre is at 0.3 m."""
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><body name="a"><joint name="a" axis="0 0 1"/>'
        '<geom type="sphere" size="0.01" mass="0.1"/>'
        '<geom type="sphere" size="0.01" mass="0.3" pos="0.4 0 0"/></body></worldbody></mujoco>'
    )
    whole = weights_model(model)
    np.testing.assert_allclose(whole.body_ipos[-1], [0.3, 0, 0], atol=1e-12)
    assert inertias(whole) == pytest.approx([0.048 + 0.4 * 0.4 * 1e-4], rel=1e-9)
