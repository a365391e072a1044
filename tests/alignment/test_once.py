"""What is worked out once of a record."""

import gc
import weakref

import numpy as np
import pytest

from alignment import Dwell, ImuReadings
from alignment.errors import NotAtRest
from alignment.noise import check_rest, mean_and_variance
from alignment.once import once


def readings(seed: int = 0, n: int = 200) -> ImuReadings:
    rng = np.random.default_rng(seed)
    t = 0.1 * np.arange(1, n + 1)
    return ImuReadings(t, 1e-6 * rng.standard_normal((n, 3)), rng.standard_normal((n, 3)) + 9.8)


def test_each_object_is_worked_out_once_and_forgotten_with_it() -> None:
    asked = []

    @once
    def length(one: ImuReadings) -> int:
        asked.append(id(one))
        return len(one)

    first, second = readings(n=20), readings(n=30)
    assert [length(one) for one in (first, second, first, second)] == [20, 30, 20, 30]
    assert len(asked) == 2
    gone = weakref.ref(first)
    del first
    gc.collect()
    assert gone() is None  # nobody holds an hour of samples because its mean was asked for


def test_what_is_raised_is_raised_anew() -> None:
    @once
    def refused(one: ImuReadings) -> None:
        raise ValueError(len(one))

    one = readings()
    for _ in range(2):
        with pytest.raises(ValueError, match="200"):
            refused(one)


def test_a_refusal_names_the_stretch_of_whoever_asks() -> None:
    t = 0.1 * np.arange(1, 201)
    tilting = np.column_stack([0.05 * t, 0 * t, 0 * t + 9.8])
    moved = ImuReadings(t, np.zeros((200, 3)), tilting)
    for label in ("first", "second"):
        with pytest.raises(NotAtRest, match=f"^{label}: not at rest near"):
            check_rest(moved, label)


def test_one_answer_for_all_cannot_be_changed() -> None:
    means, variances = mean_and_variance(readings())
    for array in (means, variances):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0


def test_a_dwell_has_one_window_and_no_other_where_it_is_all_of_its_readings() -> None:
    own = readings()
    whole = Dwell("whole", 0.0, 20.0, own)
    part = Dwell("part", 5.0, 15.0, own)
    assert whole.window() is own
    assert part.window() is part.window()
    assert len(part.window()) == 100  # 5.1 to 15.0 s
    assert len(part.window(1.0)) == 90
