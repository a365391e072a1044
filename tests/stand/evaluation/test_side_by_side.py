"""Two recordings beside each other: differences put in by hand come back."""

from dataclasses import replace

import numpy as np
import pytest

import stand
from alignment.units import DEG_PER_HOUR, MILLI_G
from stand.evaluation.side_by_side import side_by_side

BIAS = 0.5 * DEG_PER_HOUR
FORCE = 0.2 * MILLI_G


@pytest.fixture(scope="module")
def log():
    """Two positions of an ideal unit: no noise of its own."""
    s = stand.settings("two-position", imu="ideal", rate_hz=5, true_table=True)
    return stand.simulate(s).log


def changed(log, *, noise=0.0, gyro=(0, 0, 0), force=(0, 0, 0), labels=None):
    """The same with white noise, biases and other names."""
    dwells = []
    for k, dwell in enumerate(log.dwells):
        r, rng = dwell.readings, np.random.default_rng(k)
        w = r.w_ib_b + gyro + noise * rng.normal(size=(len(r), 3))
        label = labels[k] if labels else dwell.label
        readings = type(r)(r.t, w, r.f_b + force)
        dwells.append(replace(dwell, readings=readings, label=label))
    return replace(log, dwells=tuple(dwells))


def test_biases_put_in_by_hand_come_back(log):
    # 'first' points X1 north, Y1 up, Z1 east: a force along Z1 is one to the east and leans the
    # levelled attitude about north by -b/g; about down it takes tan(lat) b/g
    other = changed(log, gyro=(0, 0, BIAS), force=(0, 0, FORCE))
    found = side_by_side(log, other, ["triad"])
    (first, _) = found.stretches
    assert first.means[1] - first.means[0] == pytest.approx([0, 0, BIAS, 0, 0, FORCE], abs=1e-12)
    (e, _) = found.estimates
    tilt = FORCE / 9.8093587
    north = 9.96651 * DEG_PER_HOUR  # horizontal Earth rate at 48.5 deg
    about_down = -BIAS / north + np.tan(np.radians(48.5)) * tilt
    # second order: half the square of an azimuth of 50 mrad
    assert e.off == pytest.approx([-tilt, 0, about_down], abs=0.6 * about_down**2)


def test_noise_is_told_of_both(log):
    noise = 1e-4
    found = side_by_side(changed(log, noise=noise), changed(log, noise=2 * noise), ["triad"])
    for s in found.stretches:
        # white noise of sigma a sample at 5 Hz has the density sigma / sqrt(5); 25 % a channel
        ratio = s.densities[1, :3] / s.densities[0, :3]
        assert s.densities[0, :3] == pytest.approx([noise / np.sqrt(5)] * 3, rel=0.4)
        assert ratio == pytest.approx([2] * 3, rel=1e-6)  # the same draws


def test_matched_by_name_or_by_order(log):
    renamed = changed(log, labels=("up", "down"))
    found = side_by_side(log, renamed, ["two-position"])
    assert found.notes == ("stretches matched by their order",)
    assert [(s.label, s.label_b) for s in found.stretches] == [("first", "up"), ("second", "down")]
    assert np.abs(found.estimates[0].off).max() < 1e-9
    one = replace(log, dwells=log.dwells[:1], truths=log.truths[:1])
    assert side_by_side(log, one, ["triad"]).notes == ("in one of them alone: second",)
    with pytest.raises(stand.StandError, match=r"2 stretches, .* 1, and no name is in both"):
        side_by_side(renamed, one)
    with pytest.raises(stand.StandError, match="unknown method 'traid': did you mean triad"):
        side_by_side(log, log, ["traid"])


def test_a_method_without_an_answer_is_told(log):
    one = replace(log, dwells=log.dwells[:1], truths=log.truths[:1])
    found = side_by_side(log, one, ["multi-position", "triad"])
    assert [r.method for r in found.refusals] == ["multi-position"]
    assert [e.a.method for e in found.estimates] == ["triad"]


def test_two_units_differ_within_their_sigmas():
    runs = [
        stand.simulate(stand.settings("two-position", imu="stim300", rate_hz=5, seed=seed))
        for seed in (1, 2)
    ]
    found = stand.side_by_side(*runs, ["two-position"])
    (e,) = found.estimates
    assert e.sigmas is not None
    assert np.all(np.abs(e.off) < 4 * e.sigmas)
    text = repr(found)
    assert "first" in text
    assert "deg/rt-h" in text
