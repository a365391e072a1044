"""What a unit does with its temperature: a profile that moves, and a recording at each of three."""

from pathlib import Path

import numpy as np
import pytest
from scipy.stats import chi2

import stand

AT = [(0, 0, 0), (0, 0, 180), (0, 0, 90), (0, 0, -90), (0, 90, 0), (0, -90, 0)]
HEAD = """
title = "Six faces, some times over"
table = "precision"
[site]
latitude_deg = 48.5
gravity_m_s2 = 9.80936
[estimate]
methods = ["calibration"]
[temperature]
"""
STATED = ', kind = "assumed", source = "of a test" }'
SHEETS = {
    "[accel]": f"""bias_temperature_deg_h_K = {{ value = 2{STATED}
scale_temperature_ppm_K = {{ value = 20{STATED}
""",
    "[sampling]": f"""bias_temperature_ug_K = {{ value = 50{STATED}
scale_temperature_ppm_K = {{ value = 10{STATED}
""",
}
# by hand, in the unit of each term: X1, Y1, Z1
SET = {
    ("gyro", "temperature_bias", "deg/h/K"): (3.0, -2.0, 1.0),
    ("gyro", "temperature_scale", "ppm/K"): (30.0, -20.0, 10.0),
    ("accel", "temperature_bias", "ug/K"): (60.0, -40.0, 20.0),
    ("accel", "temperature_scale", "ppm/K"): (15.0, -10.0, 5.0),
}
SIZES = {"deg/h/K": 4.8481368e-6, "ppm/K": 1e-6, "ug/K": 9.80665e-6}
RATE = 10


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A sheet with spreads, the same with coefficients set by hand, and procedures."""
    folder = tmp_path_factory.mktemp("warm")
    sheet = (Path(stand.__file__).parent / "imus" / "stim300.toml").read_text(encoding="utf-8")
    for before, lines in SHEETS.items():
        sheet = sheet.replace(before, lines + before, 1)
    known = [
        f'{{ sensor = "{s}", term = "{term}", axis = "{axis}", value = {x}, unit = "{unit}" }},'
        for (s, term, unit), values in SET.items()
        for axis, x in zip(("X1", "Y1", "Z1"), values, strict=True)
    ]
    texts = {"sheet": sheet, "set": "known = [\n" + "\n".join(known) + "\n]\n" + sheet}
    profiles = {"ramp": ([0.0, 300.0], [-5.0, 55.0], 3)}
    profiles |= {name: ([0.0], [c], 1) for name, c in (("cold", -5.0), ("hot", 55.0))}
    for name, (times, temperatures, rounds) in profiles.items():
        texts[name] = HEAD + f"time_s = {times}\ntemperature_C = {temperatures}\n"
        for n in range(rounds):
            for k, (outer, middle, inner) in enumerate(AT):
                joints = f"{{ outer = {outer}, middle = {middle}, inner = {inner} }}"
                texts[name] += f"""
[[step]]
kind = "move"
label = "to {n}.{k}"
joints_deg = {joints}
[[step]]
kind = "dwell"
label = "{n}.{k}"
duration_s = 10
"""
    for name, text in texts.items():
        (folder / f"{name}.toml").write_text(text, encoding="utf-8")
    return {name: str(folder / f"{name}.toml") for name in texts}


def simulated(files, name, imu, seed):
    return stand.simulate(stand.settings(files[name], imu=files[imu], rate_hz=RATE, seed=seed))


def of_temperature(record):
    """Parameters by sensor and term, with their places among all."""
    found = {}
    for n, p in enumerate(record.calibration.parameters):
        if p.key.term.startswith("temperature"):
            found.setdefault((p.key.sensor, p.key.term), []).append(n)
    return found


def test_a_profile_gives_the_coefficients_set_by_hand(files):
    """Over 60 K biases of 180 deg/h and 3.6 mg and scale factors of 1800 ppm come and go."""
    found = stand.calibrate(simulated(files, "ramp", "set", 4), imu=files["sheet"])
    places, errors = of_temperature(found), np.array(found.errors)
    for (sensor, term, unit), values in SET.items():
        for n, by_hand in zip(places[sensor, term], values, strict=True):
            p, size = found.calibration.parameters[n], SIZES[unit]
            assert abs(p.value / size - by_hand) < 4 * p.sigma / size, (sensor, term, n)
            assert errors[n] == pytest.approx(p.value - by_hand * size, abs=1e-6 * size)
            assert p.sigma < 0.25 * p.prior_sigma
            assert p.basis == "data"


def test_sigmas_of_coefficients_are_promises(files):
    """NEES of 12 coefficients of 4 drawn units, on both sides once in a thousand."""
    total = 0.0
    for seed in range(20, 24):
        found = stand.calibrate(simulated(files, "ramp", "sheet", seed))
        own = [n for at in of_temperature(found).values() for n in at]
        assert len(own) == 12
        z = np.array(found.errors)[own] / found.calibration.sigmas[own]
        scale = np.outer(found.calibration.sigmas[own], found.calibration.sigmas[own])
        P = found.calibration.covariance[np.ix_(own, own)] / scale
        total += z @ np.linalg.solve(P, z)
    low, high = chi2.ppf([5e-4, 1 - 5e-4], 48)
    assert low < total < high


def test_recordings_at_two_temperatures_tell_scale_factors_and_gyros(files):
    """Each was switched on anew: of 1.9 mg, half of it (variance) anew, 60 K show 22 ug/K."""
    logs = [simulated(files, name, "set", seed) for name, seed in (("cold", 4), ("hot", 4))]
    found = stand.calibrate(logs, imu=files["sheet"])
    places = of_temperature(found)
    sigmas = {key: found.calibration.sigmas[at] for key, at in places.items()}
    # two biases' spread of 1.9 mg sqrt(1/2) over 60 K: 31.7 ug/K, with a prior of 50: 26.7
    assert sigmas["accel", "temperature_bias"] / 9.80665e-6 == pytest.approx([26.7] * 3, rel=0.02)
    assert np.all(sigmas["accel", "temperature_scale"] < 1e-6)  # of 10 ppm/K
    # 4 deg/h sqrt(1/2) sqrt(2) over 60 K is 0.067 deg/h/K, noise adds 0.06
    assert np.all(sigmas["gyro", "temperature_bias"] < 0.15 * 4.848e-6)
    errors = np.array(found.errors)
    for at in places.values():
        assert np.all(np.abs(errors[at]) < 4 * found.calibration.sigmas[at])
