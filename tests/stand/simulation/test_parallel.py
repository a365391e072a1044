"""Faults of runs, in processes of their own too: a bug keeps its traceback."""

import operator
import os
import signal
import subprocess
import sys
from functools import partial
from itertools import chain
from time import sleep

import pytest

from alignment.errors import AlignmentError, Fault, TooShort
from stand.errors import StandError
from stand.simulation import work
from stand.simulation.parallel import RunFailed, campaign, pool
from stand.simulation.work import (
    Done,
    Lost,
    Supply,
    Task,
    Together,
    here,
    made_in_order,
    recipe_of,
)

TRIPLED = partial(partial, operator.mul, 3)  # makes what makes a run of a seed


@pytest.mark.parametrize("count", [1, 7, 35])
def test_every_seed_has_its_result_in_order(count):
    """35 seeds for two processes go in chunks of two: the last has one."""
    seeds = range(100, 100 + count)
    assert list(campaign(TRIPLED, seeds, 2)) == [3 * seed for seed in seeds]
    assert list(campaign(TRIPLED, seeds, 1)) == [3 * seed for seed in seeds]


def trial(seed):
    if seed == 3:
        return [][seed]
    if seed == 5:
        raise TooShort("1 sample: at least 2 are needed")
    return seed


def ready():
    return trial


def test_all_known_faults_have_one_base():
    assert issubclass(StandError, Fault)
    assert issubclass(AlignmentError, Fault)
    assert not issubclass(RunFailed, Fault)


@pytest.mark.parametrize("workers", [1, 2])
def test_a_bug_keeps_its_traceback_and_names_its_seed(workers):
    with pytest.raises(RunFailed, match="run with seed 3: IndexError: list index") as raised:
        list(campaign(ready, range(5), workers))
    cause = raised.value.__cause__
    # here the very error; from another process its traceback as text, with the line that failed
    assert isinstance(cause, IndexError) or "return [][seed]" in str(cause)


@pytest.mark.parametrize("workers", [1, 2])
def test_a_known_fault_is_told_with_its_seed(workers):
    with pytest.raises(StandError) as raised:
        list(campaign(ready, [4, 5], workers))
    assert str(raised.value) == "run with seed 5: 1 sample: at least 2 are needed"


def fatal():
    """What ends its process at seed 5; a longer batch than two in any case."""
    return lambda seed: os.kill(os.getpid(), signal.SIGKILL) if seed == 5 else seed


@pytest.mark.slow
def test_a_run_that_ends_its_process_is_named_and_the_rest_is_made():
    supply = Supply([Task(3, recipe_of(fatal), range(8)), Task(4, recipe_of(ready), [1, 2])])
    found = list(pool(supply, 2))
    assert [one for one in found if isinstance(one, Lost)] == [Lost(3, 5)]
    made = [(one.case, seed) for one in found if isinstance(one, Done) for seed in one.seeds]
    assert sorted(made) == [(3, s) for s in (0, 1, 2, 3, 4, 6, 7)] + [(4, 1), (4, 2)]
    with pytest.raises(StandError, match="run with seed 5: ended the process that made it"):
        list(campaign(fatal, range(4, 7), 2))


def test_when_every_run_ends_its_process_it_is_said():
    supply = Supply([Task(0, b"", range(100))])
    told = "11 runs have ended their process, the last with seed 10"
    with pytest.raises(StandError, match=told):
        [supply.lost(batch) for batch in iter(supply.take, None)]


def test_a_batch_goes_on_where_its_time_was_up(monkeypatch):
    """A clock that goes a second a look: one run a batch, the rest goes back, in order."""
    clock = iter(range(1000))
    monkeypatch.setattr(work.time, "perf_counter", lambda: next(clock))
    supply = Supply([Task(0, recipe_of(TRIPLED), range(6))])
    found = list(here(supply))
    assert [one.results for one in found] == [[3 * seed] for seed in range(6)]
    assert supply.empty


def test_the_command_ends_with_code_1_and_the_traceback():
    code = (
        "import stand.evaluation.comparison as c\n"
        "c.floors = lambda *a: 1 / 0\n"
        "import sys\n"
        "from stand.cli.app import main\n"
        "sys.argv = ['stand', 'compare', 'two-position', '--runs', '1', '--seed', '9',"
        " '--rate', '5', '--methods', 'triad', '--json']\n"
        "main()\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert done.stdout == ""
    assert "ZeroDivisionError: division by zero" in done.stderr
    assert done.stderr.splitlines()[-1].endswith(
        "run with seed 9: ZeroDivisionError: division by zero"
    )


def _together(made):
    def several(seeds):
        made.append(tuple(seeds))
        if 7 in seeds:
            raise ValueError("seven")
        return [2 * seed for seed in seeds]

    return Together(several, at_once=4)


def test_runs_made_together_come_in_order_and_no_more_at_once_than_may_be():
    made = []
    assert list(chain(*made_in_order(_together(made), range(7)))) == [0, 2, 4, 6, 8, 10, 12]
    assert made == [(0,), (1, 2, 3, 4), (5, 6)]
    assert _together(made)(3) == 6


def test_of_runs_made_together_the_one_that_fails_is_named():
    """Those before it are told; it fails again alone, with its seed."""
    made = made_in_order(_together([]), range(5, 10))
    assert [next(made), next(made)] == [[10], [12]]
    with pytest.raises(RunFailed, match="run with seed 7: ValueError: seven"):
        next(made)


def test_a_slow_run_is_made_alone():
    def several(seeds):
        sleep(0.02 * len(seeds))
        return list(seeds)

    sizes = [len(some) for some in made_in_order(Together(several, at_once=1000), range(40))]
    assert sizes[0] == 1
    assert max(sizes) <= 25  # of half a second
