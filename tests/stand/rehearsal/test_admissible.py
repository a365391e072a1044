"""How much a base may rock: by hand for two gyros, and that what is admitted is predicted so."""

from math import pi

import numpy as np
import pytest
from pages import checked

from alignment.units import DEG
from stand.procedure.procedure import procedure_from
from stand.rehearsal.admissible import admissible, base_rocking, turned
from stand.rehearsal.rehearse import prepared, rehearse
from stand.rehearsal.result import Contribution, Prediction, Severity
from stand.rehearsal.result_json import rehearsal_json
from stand.report.rehearsal import page
from stand.simulation.settings import settings
from stand.toml_files import Source

TEXT = """
title = "Rocking"
table = "rocking-platform"
[site]
latitude_deg = 48.5
[estimate]
methods = ["two-gyro", "inertial"]
[require]
heading_deg = {limit}
coverage = 2
[[step]]
kind = "dwell"
label = "rocked"
duration_s = 120
[[background]]
kind = "sine"
fade_s = 4
[background.axes]
base_roll = {{ amplitude_deg = {amplitude}, frequency_hz = 0.2 }}
"""


def rehearsed(tmp_path, limit=2.0, amplitude=1.0, imu="hg9900"):
    path = tmp_path / "rocking.toml"
    path.write_text(TEXT.format(limit=limit, amplitude=amplitude))
    return rehearse(settings(str(path), imu, rate_hz=50))


def test_two_gyros_by_hand(tmp_path):
    """1 deg about a sensor's own axis over T is 1 deg/T of rate; sqrt 2 for both ends."""
    result = rehearsed(tmp_path)
    by_means, carried = result.rocking
    assert by_means.method == "two-gyro"
    assert by_means.planned / DEG == pytest.approx(1 / 2**0.5, rel=0.02)  # rms of a sine
    assert by_means.frequency == pytest.approx(0.2, rel=0.01)
    assert by_means.allowed / DEG == 1.0
    # W cos lat T/sqrt 2 of what is left of 1 deg beside the sensors; rho of 24 periods is nothing
    north, T = 9.96651 / 3600, 120.0
    left = (1.0 - (by_means.sensors / DEG) ** 2) ** 0.5
    assert by_means.rms / DEG == pytest.approx(left * north * T / 2**0.5 * DEG, rel=1e-3)
    assert by_means.sensors / DEG < 0.2
    # rocking of eight such periods is far below what it adds to the carried attitude
    assert not np.isfinite(carried.rms)
    texts = [f.text for f in result.findings if f.kind == "rocking"]
    assert texts[0].startswith("two-gyro: rocking of up to 0.0041 deg rms at 0.2 Hz")
    assert "ten times the planned 0.69 deg rms" in texts[1]


def test_slow_rocking_turns_little():
    T = 100.0
    f = np.array([1e-5, 5.0])
    slow, fast = turned(f, T)
    assert fast == pytest.approx(2**0.5, rel=1e-9)
    assert slow == pytest.approx(2 * pi * 1e-5 * T, rel=1e-2)


def test_sensors_that_are_too_much_admit_nothing(tmp_path):
    found = rehearsed(tmp_path, limit=0.01).rocking
    assert [r.rms for r in found] == [0.0, 0.0]
    assert "no rocking" in found[0].text
    assert "the sensors alone leave" in found[0].text


def test_machines_and_the_page(tmp_path):
    result = rehearsed(tmp_path)
    told = rehearsal_json(result)["admissible_rocking"]
    assert [r["method"] for r in told] == ["two-gyro", "inertial"]
    assert told[0]["admissible_rms_deg"] == pytest.approx(0.0041, abs=5e-5)
    assert told[1]["admissible_rms_deg"] is None
    assert len(told[0]["chart"]["frequency_hz"]) == len(told[0]["chart"]["admissible_rms_deg"])
    text = page(result)
    assert "How much the base may rock" in checked(text).said
    assert "mathdefault" not in text


def test_a_base_that_rests_is_not_asked():
    still = TEXT.format(limit=1, amplitude=1).split("[[background]]")[0]
    made = settings(procedure_from(Source("p", "p.toml", still)), "hg9900", rate_hz=50)
    assert rehearse(made).rocking == ()


def test_the_rocking_of_a_prediction_by_hand(tmp_path):
    """A sigma of 5 by rocking of 3 and the sensors' 4: of 4.5 are left 2.06 for it."""
    path = tmp_path / "rocking.toml"
    still = '[[step]]\nkind = "dwell"\nlabel = "still"\nduration_s = 20\n[[step]]'
    text = TEXT.format(limit=2.0, amplitude=1.0).replace("[[step]]", still, 1)
    path.write_text(text.replace('kind = "sine"', 'kind = "sine"\nfirst = "rocked"'))
    scene = prepared(settings(str(path), "hg9900", rate_hz=50))
    planned, frequency = base_rocking(scene, scene.plan.stretches[1])
    assert (planned / DEG, frequency) == pytest.approx((1 / 2**0.5, 0.2), rel=0.02)
    assert base_rocking(scene, scene.plan.stretches[0]) == (0.0, 0.0)

    def admitted(allowed, **sizes):
        parts = tuple(Contribution(name, size) for name, size in sizes.items())
        total = sum(size**2 for size in sizes.values()) ** 0.5
        one = Prediction("inertial", "", "rocked", "heading", "deg", DEG, total, parts)
        (found,) = admissible(scene, ["inertial", "fine"], [one], allowed)
        assert found.sensors == pytest.approx(sizes["noise"])
        return found.rms / planned

    assert admitted(4.5, motion=3.0, noise=4.0) == pytest.approx((4.5**2 - 16) ** 0.5 / 3)
    assert admitted(5.0, motion=3.0, noise=4.0) == pytest.approx(1.0)
    assert admitted(3.9, motion=3.0, noise=4.0) == 0.0
    assert admitted(9.9, motion=1.0, noise=0.1) == pytest.approx((9.9**2 - 0.01) ** 0.5)
    assert admitted(10.1, motion=1.0, noise=0.1) == np.inf
    assert admitted(4.5, noise=4.0) == np.inf
    assert admitted(3.9, noise=4.0) == 0.0


def test_half_a_turn_of_a_resonance_by_hand(tmp_path):
    """w T = pi, d = 0.1: u = 3.12584, rho = exp(-0.314159) (-0.999876 + 0.001583) = -0.729156."""
    assert turned(np.array([0.25]), 2.0)[0] == pytest.approx((2 * 1.729156) ** 0.5, abs=2e-6)
    means = rehearsed(tmp_path).rocking[0]
    assert means.frequencies[[0, -1]] == pytest.approx([0.01 / 120, 5.0])
    seen = means.curve * turned(means.frequencies, 120.0)
    assert seen == pytest.approx(means.rms * turned(np.array([means.frequency]), 120.0)[0])


def test_what_the_table_cannot_do_is_told_before_what_a_method_admits(tmp_path):
    told = [f.severity for f in rehearsed(tmp_path, amplitude=35.0).findings]
    assert Severity.WARNING in told
    first = told.index(Severity.WARNING)
    assert first > 0
    assert set(told[:first]) == {Severity.ERROR}
    assert Severity.ERROR not in told[first:]
