"""The true mean attitude of a stretch, and which methods are judged by it."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import stand
from alignment import ESTIMATORS, Dwell, ImuReadings
from stand.evaluation.score import Truths
from stand.procedure.procedure import load_procedure, procedure_from
from stand.recording.log import mean_attitude
from stand.simulation.monte_carlo import Trials, watch
from stand.table.kinematics import C_NW
from stand.toml_files import Source


def test_a_mean_attitude_lies_between():
    """Half of the time 0.04 rad about one axis, half of it none: 0.02 rad; samples before do not
    count."""
    turned = Rotation.from_rotvec([[0, 0, 2.0], [0, 0, 0.04], [0, 0, 0.04], [0, 0, 0], [0, 0, 0]])
    t = np.arange(5.0)
    dwell = Dwell("d", 0.0, 4.0, ImuReadings(t, np.zeros((5, 3)), np.zeros((5, 3))))
    mean = mean_attitude(t, turned.as_quat(), dwell)
    assert mean is not None
    assert (C_NW.inv() * mean).as_rotvec() == pytest.approx([0, 0, 0.02], abs=1e-12)


def test_only_what_tells_a_mean_is_judged_by_it():
    end, mean = Rotation.from_rotvec([0.1, 0, 0]), Rotation.identity()
    truths = Truths(end, mean=mean)
    for method, told in ESTIMATORS.items():
        assert truths.of(method) is (mean if told.tells_mean else end)
    of_means = {m for m, told in ESTIMATORS.items() if told.tells_mean}
    assert of_means == {
        "six-position",
        "triad",
        "single-gyro",
        "two-position",
        "multi-position",
        "two-gyro",
    }
    assert Truths(end).of("two-gyro") is end


def test_runs_keep_the_mean_of_what_rocks():
    """In blocks, by sums of squares of quaternions, as of all samples at once."""
    text = load_procedure("random-sway").text.replace("duration_s = 600", "duration_s = 60")
    procedure = procedure_from(Source("sway", "sway.toml", text))
    made = stand.settings(procedure, "hg9900", rate_hz=20)
    _, attitudes = Trials(made).readings(3)
    run = watch(stand.settings(procedure, "hg9900", rate_hz=20, seed=3))
    (dwell,) = run.dwells
    own = (run.t > dwell.t_from + 1e-6) & (run.t < dwell.t_to + 1e-6)
    want = Rotation.from_quat(run.q_nb[own]).mean()
    assert (attitudes.means[0] * want.inv()).magnitude() < 1e-9  # rounding of squares, 1e-16
    assert (attitudes[0] * want.inv()).magnitude() > 1e-4
