"""The error budget against differences of the estimators, and the published figures."""

from math import atan2, cos, degrees, pi, radians, sin, tan

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from alignment.angles import Sequence, angles_from_C_nb
from alignment.information.budget import (
    OUTPUTS,
    ErrorSources,
    budget,
    double_worst,
    levelling_worst,
    sensitivities,
)
from alignment.levelling import level
from alignment.methods.single_gyro import gyro_latitude, single_gyro_attitude
from alignment.methods.triad import triad_attitude, triad_latitude

W = 7.292115e-5  # rad/s
G = 9.8093587  # m/s^2
DEG_H = pi / 180 / 3600
MINUTE = pi / 180 / 60
MILLI_G = 9.80665e-3
N, E, D = np.eye(3)
LEVEL = np.column_stack([N, -D, E])  # X1 north, Y1 up, Z1 east


def attitude(yaw, pitch, roll):
    """From NUE by yaw (to the west), pitch, roll [deg]: hand-made, columns north, up, east."""
    turns = Rotation.from_euler("YZX", [yaw, pitch, roll], degrees=True).as_matrix()
    return LEVEL @ turns


def readings_of(C, lat):
    w = np.array([W * cos(lat), 0, -W * sin(lat)])
    return np.concatenate([C.T @ w, C.T @ np.array([0, 0, -G])])


def outputs(y, lat, east):
    """All seven, by the estimators themselves."""
    w, f = y[:3], y[3:]
    roll, pitch = level(f, Sequence.YAW_PITCH_ROLL)
    full = triad_attitude(w, f)
    one = single_gyro_attitude(w[0], f, np.eye(3)[0], lat, east)
    assert angles_from_C_nb(Sequence.YAW_PITCH_ROLL, full)[2] == pytest.approx(pitch, abs=1e-12)
    x_full, x_one = full.apply([1.0, 0, 0]), one[:, 0]
    return np.array(
        [
            roll,
            np.arcsin(f[0] / G),
            pitch,
            atan2(x_full[1], x_full[0]),
            atan2(x_one[1], x_one[0]),
            triad_latitude(w, f),
            float(gyro_latitude(w, f)),
        ]
    )


CASES = [
    (yaw, pitch, roll, latitude)
    for yaw, pitch, roll in ((90, 5, 5), (-60, -20, 10), (30, 40, -35))
    for latitude in (48.5, -33.0, 75.0)
]


@pytest.mark.parametrize(("yaw", "pitch", "roll", "latitude"), CASES)
def test_every_contribution_by_differences(yaw, pitch, roll, latitude):
    C, lat = attitude(yaw, pitch, roll), radians(latitude)
    y = readings_of(C, lat)
    h = 1e-6
    table = budget(
        Rotation.from_matrix(C),
        lat,
        G,
        ErrorSources(
            gyro_bias=[h * W] * 3,
            gyro_scale=[h] * 3,
            gyro_noise=[h * W] * 3,
            gyro_g=[h * W / G] * 3,
            misalignment=[h] * 3,
            accel_bias=[h * G] * 3,
            accel_scale=[h] * 3,
            accel_noise=[h * G] * 3,
        ),
    )
    assert table.contributions.shape == (24, 7)
    for i, axis in enumerate(("X1", "Y1", "Z1")):
        unit = np.eye(3)[i]
        case = Rotation.from_rotvec(h * unit).as_matrix()
        w, f = y[:3], y[3:]
        zero = np.zeros(3)
        felt = {
            "gyro bias": (h * W * unit, zero),
            "gyro scale": (h * w * unit, zero),
            "gyro noise": (h * W * unit, zero),
            "gyro g-sensitivity": (h * W / G * f * unit, zero),
            "gyro misalignment": (case.T @ w - w, zero),
            "accelerometer bias": (zero, h * G * unit),
            "accelerometer scale": (zero, h * f * unit),
            "accelerometer noise": (zero, h * G * unit),
        }
        for name, (dw, df) in felt.items():
            step = np.concatenate([dw, df])
            difference = (outputs(y + step, lat, C[1, 0]) - outputs(y - step, lat, C[1, 0])) / 2
            found = [table.of(output)[f"{axis} {name}"] for output in OUTPUTS]
            # third order 1e-12 of it; rounding 1e-16 over cos(75 deg); misalignment's h^2/2
            np.testing.assert_allclose(found, difference, rtol=2e-6, atol=5e-12)


def test_methods_formulas_by_hand():
    """Level instrument, nose east, 48.5 deg: each number from the formula alone."""
    lat = radians(48.5)
    table = budget(
        Rotation.from_matrix(attitude(-90, 0, 0)),
        lat,
        G,
        ErrorSources(
            gyro_bias=[DEG_H, 0, DEG_H], accel_bias=[2 * MILLI_G] * 3, misalignment=[0, 1e-3, 0]
        ),
    )
    heading = table.of("heading, full vector")
    # X1 east: -dw_E/(W cos lat) = -1/9.96651 rad; Z1 south does not matter
    assert heading["X1 gyro bias"] == pytest.approx(-1 / 9.96651, rel=1e-5)
    assert heading["Z1 gyro bias"] == pytest.approx(0, abs=1e-15)
    # 2 mg east: tan(lat) b/g = 7.8'
    assert heading["X1 accelerometer bias"] / MINUTE == pytest.approx(7.77, abs=0.01)
    # the case turned by 1 mrad about up: 3.4', 1:1
    assert abs(heading["Y1 gyro misalignment"]) == pytest.approx(1e-3, rel=1e-12)
    assert degrees(1e-3) * 60 == pytest.approx(3.4, abs=0.04)
    roll, pitch = table.of("roll"), table.of("pitch by asin")
    assert roll["Z1 accelerometer bias"] == pytest.approx(-2 * MILLI_G / G, rel=1e-12)
    assert pitch["X1 accelerometer bias"] == pytest.approx(2 * MILLI_G / G, rel=1e-12)


@pytest.mark.parametrize("psi", [90, 30, 120])
def test_single_gyro_formulas_of_the_paper(psi):
    """``dw_x/(W cos lat cos th sin psi)`` and ``-(dth)(tan lat - cos psi tan th)/sin psi``."""
    th, ph, lat = radians(7), radians(-4), radians(48.5)
    S = sensitivities(Rotation.from_matrix(attitude(psi, 7, -4)), lat, G)
    row = S[OUTPUTS.index("heading, X1 gyro")]
    s = sin(radians(psi))
    assert row[0] == pytest.approx(1 / (W * cos(lat) * cos(th) * s), rel=1e-12)
    assert row[1:3] == pytest.approx(0, abs=1e-9)  # of 1e4: no other gyro
    # Along the levelled pitch error alone: b = g dth (cos th, -sin th cos ph, sin th sin ph)
    dth = 1e-5
    b = G * dth * np.array([cos(th), -sin(th) * cos(ph), sin(th) * sin(ph)])
    assert S[0, 3:] @ b == pytest.approx(0, abs=1e-18)
    want = -dth * (tan(lat) - cos(radians(psi)) * tan(th)) / s
    assert row[3:] @ b == pytest.approx(want, rel=1e-9)


def test_worst_and_root_of_squares():
    table = budget(
        Rotation.from_matrix(attitude(-90, 0, 0)),
        radians(48.5),
        G,
        ErrorSources(accel_bias=[0.03 * G / 10, 0.0, -0.04 * G / 10]),
    )
    assert table.worst[0] == pytest.approx(0.004, rel=1e-12)
    rss = np.linalg.norm(table.contributions, axis=0)
    assert rss[1] == pytest.approx(0.003, rel=1e-12)
    # heading: only X1 looks east
    assert rss[3] == pytest.approx(0.003 * tan(radians(48.5)), rel=1e-12)


def test_x1_in_the_meridian_has_no_single_gyro_row():
    S = sensitivities(Rotation.from_matrix(LEVEL), radians(48.5), G)
    assert np.isnan(S[4]).all()
    assert np.isfinite(np.delete(S, 4, axis=0)).all()


# --- published ------------------------------------------------------------------------------------


def test_levelling_figures_by_hand():
    s, c = sin(radians(5)), cos(radians(5))
    noise = 0.01 / 12000**0.5
    roll_equal = 0.1 * (s + c) / (9.81 * c)
    roll_apart = roll_equal + s * c * 0.004
    asin = 0.1 / (9.81 * c) + 0.002 * s / c
    atan2_equal = 0.1 * (c + s * (c + s)) / 9.81
    atan2_apart = atan2_equal + s * c * 0.002 * 2
    found = levelling_worst(0.1, False, 0)
    np.testing.assert_allclose(found, [roll_apart, asin, atan2_apart], rtol=1e-12)
    found = levelling_worst(0.1, True, 0)
    np.testing.assert_allclose(found, [roll_equal, asin, atan2_equal], rtol=1e-12)
    np.testing.assert_allclose(
        np.array([roll_apart, roll_equal, asin, atan2_apart]) / MINUTE,
        [39.3, 38.1, 35.8, 39.4],  # methods.md section 2
        atol=0.05,
    )
    fine = levelling_worst(0.001, True, 3)
    want = (0.001 + 3 * noise) * np.array([(s + c) / c, c + s * (c + s)]) / 9.81
    np.testing.assert_allclose(fine[[0, 2]], want, rtol=1e-12)
    # methods.md section 2 has 0.486' and 0.488', with another g
    np.testing.assert_allclose(fine[[0, 2]] / MINUTE, [0.486, 0.488], atol=0.0015)


def test_double_gyrocompassing_headline():
    # methods.md section 2: 1.6' to 2.0', and 2.8' to 4.1' with 0.2 % of the accelerometers
    assert double_worst(radians(45)) / MINUTE == pytest.approx(1.6, abs=0.05)
    assert double_worst(radians(60)) / MINUTE == pytest.approx(2.0, abs=0.05)
    assert double_worst(radians(45), 0.002) / MINUTE == pytest.approx(2.8, abs=0.05)
    assert double_worst(radians(60), 0.002) / MINUTE == pytest.approx(4.1, abs=0.05)
    # by hand: 1' and K tan(lat) tan(5 deg)
    assert double_worst(radians(45)) == pytest.approx(MINUTE + 0.002 * tan(radians(5)), rel=1e-3)
