"""Runs on several processes: every seed once, in order, whatever is left over."""

import operator
from functools import partial

import pytest

from stand.errors import StandError
from stand.simulation.parallel import campaign

TRIPLED = partial(partial, operator.mul, 3)  # makes what makes a run of a seed


@pytest.mark.parametrize("count", [1, 7, 35])
def test_every_seed_has_its_result_in_order(count):
    """35 seeds for two processes go in chunks of two: the last has one."""
    seeds = range(100, 100 + count)
    assert list(campaign(TRIPLED, seeds, 2)) == [3 * seed for seed in seeds]
    assert list(campaign(TRIPLED, seeds, 1)) == [3 * seed for seed in seeds]


def test_a_run_that_fails_in_a_process_is_told_with_its_seed():
    """1 // seed, of seeds 0 to 5."""
    by_zero = partial(partial, operator.floordiv, 1)
    made = campaign(by_zero, range(6), 2)
    with pytest.raises(StandError, match="run with seed 0 failed: ZeroDivisionError"):
        list(made)
