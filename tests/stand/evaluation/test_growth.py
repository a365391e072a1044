"""Estimates as they grow: where they end, and against which truth they are set on the way."""

import numpy as np
import pytest

import stand
from stand.errors import StandError
from stand.evaluation.growth import growing, tracked

SWAY = """
title = "A minute of sway"
table = "rocking-platform"
[site]
latitude_deg = 48.5
[estimate]
methods = ["inertial"]
[[step]]
kind = "dwell"
label = "rocking"
duration_s = 100
[[background]]
kind = "sine"
axes = { base_roll = { amplitude_deg = 2.0, frequency_hz = 0.2 } }
"""


@pytest.fixture(scope="module")
def rocking(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sway")
    (folder / "sway.toml").write_text(SWAY, encoding="utf-8")
    settings = stand.settings(folder / "sway.toml", imu="ring-laser", rate_hz=20, seed=1)
    return stand.read(stand.run(settings, out=folder / "run").out)


def test_on_a_rocking_base_the_truth_is_that_of_each_time(rocking):
    """The base rolls by 2 deg; against where it is in the end, that would be the error."""
    (curve,) = growing(rocking, "inertial")
    late = slice(len(curve.t_ns) // 2, None)
    assert np.abs(curve.errors[late][:, [0, 2]]).max() < np.radians(0.1)
    (same,) = tracked(rocking, ["inertial"])
    np.testing.assert_array_equal(same.errors, curve.errors)


def test_it_ends_where_the_estimate_is(rocking, recorded):
    """Both to rounding: the truth is turned evenly between samples, and ends on one."""
    end = growing(rocking, "inertial")[0].errors[-1]
    (scored,) = stand.align(rocking, "inertial").scores
    np.testing.assert_allclose(end, scored.error, rtol=0, atol=1e-9)
    log = stand.read(recorded.folder)
    curves = growing(log, "triad")
    scores = {s.estimate.label: s for s in stand.align(log, "triad").scores}
    assert [c.label for c in curves] == ["Y1 up", "X1 up"]
    for curve in curves:
        np.testing.assert_allclose(curve.errors[-1], scores[curve.label].error, rtol=0, atol=1e-9)
        assert np.all(np.diff(curve.t_ns) > 0)


def test_without_a_truth_it_is_set_against_what_it_came_to(recorded, tmp_path, stand_command):
    copy = tmp_path / "copy.mcap"
    assert stand_command("import", recorded.folder, "--out", copy).code == 0
    (curve,) = growing(stand.read(copy, t_from_s=0.0, t_to_s=12.0))
    assert curve.method == "triad"
    np.testing.assert_array_equal(curve.errors[-1], 0)
    assert np.abs(curve.errors[0]).max() > 0


def test_a_method_that_answers_not_at_all_is_told(recorded):
    log = stand.read(recorded.folder)
    with pytest.raises(StandError, match="unknown method 'tried': did you mean triad"):
        growing(log, "tried")
    with pytest.raises(ValueError, match="constant rate"):
        growing(log, "carousel")
