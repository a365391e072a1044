"""Faults of runs, in processes of their own too: a bug keeps its traceback."""

import operator
import subprocess
import sys
from functools import partial

import pytest

from alignment.errors import AlignmentError, Fault, TooShort
from stand.errors import StandError
from stand.simulation.parallel import RunFailed, campaign

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
