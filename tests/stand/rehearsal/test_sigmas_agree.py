"""One sigma for one thing: what several positions claim in a run is what a rehearsal predicts."""

from dataclasses import replace

import numpy as np
import pytest
from stand.rehearsal.gains import AT_REST, Case

from alignment import ESTIMATORS
from stand.evaluation.score import suited
from stand.imu import load_imu
from stand.imu.priors import priors_of
from stand.physics.mjcf import describe, load_model
from stand.procedure.procedure import load_procedure, table_of
from stand.rehearsal.instrument import unit_of
from stand.rehearsal.response import Errors, Response
from stand.rehearsal.scene import Scene
from stand.simulation.monte_carlo import Trials
from stand.simulation.settings import Settings

RUNS = 5
RATE = 5  # Hz: sigmas of white noise are those of any rate
CASES = [
    (procedure, imu, method)
    for procedure, methods in (
        ("two-position", ("two-position",)),
        ("four-position", ("multi-position", "two-position")),
        ("six-position", ("multi-position", "two-position")),
    )
    for imu in ("stim300", "hg4930", "ring-laser", "psins-inertial", "hg9900")
    for method in methods
    # pairs of the six positions leave such gyros a heading of 3 to 20 deg, or its opposite: the
    # prediction is of first order, the claim reaches over to the other attitude
    if (procedure, method) != ("six-position", "two-position") or imu not in ("stim300", "hg4930")
]


@pytest.mark.parametrize(("procedure", "imu", "method"), CASES)
def test_what_a_run_claims_is_what_a_rehearsal_predicts(procedure, imu, method):
    loaded, unit = load_procedure(procedure), load_imu(imu)
    table, site = table_of(loaded), loaded.entry.site.site()
    options = replace(loaded.entry.estimate.options(), priors=priors_of(unit, table))
    trials = Trials(Settings(loaded, unit, table, site, options, RATE))
    scene = Scene(
        trials.plan, describe(load_model()), table, unit, site, options, RATE, lambda: None, None
    )
    answers = AT_REST[method](trials.plan.stretches, Case(site, options))
    claimed: dict[str, list] = {}
    for seed in range(RUNS):
        dwells, _ = trials.readings(seed)
        for e in ESTIMATORS[method].estimate(suited(method, dwells), site, options):
            claimed.setdefault(e.label, []).append(np.diag(e.covariance))
    assert list(claimed) == [answer.label for answer in answers]
    for answer in answers:
        parts = Response(answer, Errors(answer, scene, unit_of(unit))).attitude()
        predicted = np.sqrt(np.diag(sum(parts.values())))
        told = np.sqrt(np.median(claimed[answer.label], axis=0))
        # one record knows its noise to some per cent, the median of five to two; the
        # table's errors are three sigmas to the methods, and known axis by axis to the prediction
        np.testing.assert_allclose(told, predicted, rtol=0.10, err_msg=answer.label)


def test_what_a_sheet_says_goes_to_the_methods_by_its_own_name():
    """Misalignment and g-sensitivity are not biases: they change with the attitude."""
    priors = priors_of(load_imu("stim300"), None)
    assert priors.accel_misalignment == pytest.approx(1e-3)  # 1 mrad each, 0.2 mrad
    assert priors.gyro_misalignment == pytest.approx(1e-3)
    assert priors.gyro_non_orthogonality == pytest.approx(2e-4)
    assert priors.gyro_g_sensitivity == pytest.approx(np.pi / 180 / 3600 / 9.80665)  # 1 deg/h/g
    assert priors.accel_bias < 2.0e-3 * 9.80665  # 1.9 mg, with what is slow of 50 ug
    assert priors.accel_bias > 1.9e-3 * 9.80665 * (1 - 1e-9)
    # 200 ppm at 10 g
    assert priors.accel_cubic == pytest.approx(200e-6 / (10 * 9.80665) ** 2, rel=1e-6)
