"""Several runs at once: the numbers of each alone, whatever it is with."""

from dataclasses import replace

import numpy as np
import pytest
from generated import generated
from procedures import HALF_TURN

from alignment import ESTIMATORS
from alignment.errors import AlignmentError
from stand import toml_files as catalogue
from stand.campaigns.trial import ready
from stand.evaluation.runs import Made, answers_to, made_by
from stand.evaluation.score import answered, answered_of_runs
from stand.imu import load_imu
from stand.procedure.procedure import procedure_from, table_of
from stand.simulation.monte_carlo import Trials
from stand.simulation.settings import assembled
from stand.simulation.work import Together

AT_ONCE = sorted(name for name, own in ESTIMATORS.items() if own.estimate_of_runs is not None)
SHORT = HALF_TURN.replace("duration_s = 24", "duration_s = 12")


def settings_of(procedure, unit, **changes):
    made = assembled(procedure, load_imu(unit), table_of(procedure), rate_hz=10)
    return replace(made, **changes)


def half_turn():
    return procedure_from(catalogue.Source("case", "case.toml", SHORT))


@pytest.fixture(scope="module")
def runs():
    trials = Trials(settings_of(half_turn(), "stim300", seed=1))
    return trials.settings, [made_by(trials, seed) for seed in range(1, 6)]


def numbers_of(estimate):
    parts = (estimate.covariance, estimate.biases, estimate.bias_sigmas)
    return (estimate.label, estimate.C_nb.as_quat().tobytes(), *(p.tobytes() for p in parts))


@pytest.mark.parametrize("method", AT_ONCE)
def test_a_run_has_its_numbers_whatever_it_is_with(runs, method):
    """Of one, two and five at once, in another order, with gravities that differ: to the bit."""
    settings, made = runs
    dwells = [one.dwells for one in made]
    sites = [replace(settings.site, local_gravity=9.80 + 0.001 * k) for k in range(len(made))]

    def found(order):
        own, at = [dwells[k] for k in order], [sites[k] for k in order]
        answers = answered_of_runs(method, own, at, settings.options)
        return [[numbers_of(e) for e in estimates] for estimates, _ in answers]

    alone = [found([k])[0] for k in range(len(made))]
    assert found(range(5)) == alone
    assert found([3, 1]) == [alone[3], alone[1]]
    assert len({own[0] for own in alone}) == len(made)  # they are five runs


@pytest.mark.parametrize("method", AT_ONCE)
def test_a_run_that_is_refused_costs_no_other_its_answer(runs, method):
    settings, made = runs
    moved = [replace(d, nominal=made[1].dwells[0].nominal) for d in made[1].dwells]  # no turn
    three, sites = [made[0].dwells, moved, made[2].dwells], [settings.site] * 3
    first, none, last = answered_of_runs(method, three, sites, settings.options)
    assert none == answered(method, moved, settings.site, settings.options)
    assert none[0] == []
    assert none[1][0].reason.startswith("too little turn")
    for dwells, found in ((three[0], first), (three[2], last)):
        alone, _ = answered(method, dwells, settings.site, settings.options)
        assert [numbers_of(e) for e in found[0]] == [numbers_of(e) for e in alone]
    estimate = ESTIMATORS[method].estimate_of_runs
    assert estimate is not None
    only = estimate(three, sites, settings.options)
    assert [isinstance(own, AlignmentError) for own in only] == [False, True, False]


def test_runs_of_other_stretches_are_asked_alone(runs):
    settings, made = runs
    several = [made[0].dwells, made[1].dwells[:1]]
    full, single = answered_of_runs(
        "multi-position", several, [settings.site] * 2, settings.options
    )
    assert len(full[0]) == 2
    assert single[1][0].reason.startswith("too little turn: 1 dwells")


def test_no_runs_have_no_answers(runs):
    settings, _ = runs
    assert answers_to([], AT_ONCE, lambda *_: settings.site, settings.options) == []


@pytest.mark.parametrize("number", [3, 8])
def test_rows_of_a_campaign_do_not_depend_on_what_is_made_at_once(number):
    """Of procedures by number, whose pairs take tens of steps, and several attitudes fit."""
    settings = settings_of(generated(number).procedure, "icm42688p")
    trial = ready(replace(settings, rate_hz=2))
    seeds = (5, 6, 7)
    assert isinstance(trial, Together)
    alone = [trial(seed) for seed in seeds]
    assert repr(trial.several(seeds)) == repr(alone)
    assert all(isinstance(row.error, float) for rows in alone for row in rows)


def test_so_many_at_once_as_there_is_room_for():
    """Of 400 000 samples in all, and 32 runs."""
    few, many = (
        Trials(replace(settings_of(half_turn(), "ring-laser"), rate_hz=rate)) for rate in (10, 1000)
    )
    total = few.plan.motion.duration
    assert few.at_once == 32
    assert many.at_once == int(400_000 / (total * 1000))
    made = made_by(few, 1)
    assert isinstance(made, Made)
    assert np.isfinite(made.biases).all()
