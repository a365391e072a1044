"""Owned arrays: nobody can change them afterwards."""

from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from alignment.arrays import Array, owned, set_owned

FIXED = settings(derandomize=True, deadline=None, max_examples=100)
finite = st.floats(-1e300, 1e300)
tables = hnp.arrays(np.float64, st.tuples(st.integers(2, 6), st.just(3)), elements=finite)
layouts = st.sampled_from(["C", "Fortran", "reversed", "strided", "locked view", "float32", "list"])


def laid_out(table, layout):
    """The same values as the caller may hold them, and the writable memory behind them."""
    if layout == "Fortran":
        values = np.asfortranarray(table)
        return values, values
    if layout == "reversed":
        memory = table[::-1].copy()
        return memory[::-1], memory
    if layout == "strided":
        memory = np.repeat(table, 2, axis=0)
        return memory[::2], memory
    if layout == "locked view":
        view = table.view()
        view.flags.writeable = False
        return view, table
    if layout == "float32":
        with np.errstate(over="ignore"):
            memory = np.clip(table, -1e30, 1e30).astype(np.float32)
        return memory, memory
    if layout == "list":
        return table.tolist(), table
    return table, table


@FIXED
@given(tables, layouts)
def test_writing_to_the_callers_array_changes_nothing(table, layout):
    values, memory = laid_out(table, layout)
    before = np.array(values, dtype=float)
    mine = owned(values, "w", (None, 3))
    np.testing.assert_array_equal(mine, before)
    assert not np.shares_memory(mine, memory)
    memory[...] = 7.0
    np.testing.assert_array_equal(mine, before)
    assert mine.flags.c_contiguous
    assert mine.dtype == np.float64


@FIXED
@given(tables)
def test_the_result_is_read_only_and_is_not_copied_again(table):
    mine = owned(table, "w", (None, 3))
    with pytest.raises(ValueError, match="read-only"):
        mine[0, 0] = 1.0
    assert owned(mine, "w", (None, 3)) is mine
    part = mine[1:]
    assert owned(part, "w", (None, 3)) is part  # a view of what nobody can write to


@FIXED
@given(
    tables, st.data(), st.sampled_from([float("nan"), float("inf"), -float("inf")]), st.booleans()
)
def test_a_value_that_is_not_finite_is_named_with_its_place(table, data, bad, locked):
    row = data.draw(st.integers(0, len(table) - 1))
    column = data.draw(st.integers(0, 2))
    table[row, column] = bad
    table.flags.writeable = not locked
    with pytest.raises(ValueError) as caught:
        owned(table, "f_b", (None, 3))
    assert str(caught.value) == f"f_b: not finite at index ({row}, {column})"


@pytest.mark.parametrize(
    ("shape", "message"),
    [
        ((None, 4), "w: shape (2, 3), must be ('any', 4)"),
        ((3, 3), "w: shape (2, 3), must be (3, 3)"),
        ((6,), "w: shape (2, 3), must be (6,)"),
        ((None, None, 3), "w: shape (2, 3), must be ('any', 'any', 3)"),
    ],
)
def test_a_shape_that_does_not_fit_is_named(shape, message):
    with pytest.raises(ValueError) as caught:
        owned([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]], "w", shape)
    assert str(caught.value) == message


def test_integers_keep_their_type():
    edges = owned([[1, 2], [3, 5]], "edges", (2, 2), np.int64)
    assert edges.dtype == np.int64
    np.testing.assert_array_equal(edges, [[1, 2], [3, 5]])


@dataclass(frozen=True, slots=True, eq=False)
class Pair:
    first: Array
    second: Array

    def __post_init__(self):
        set_owned(self, first=(self.first, (2,), float), second=(self.second, (2, 2), float))


def test_fields_of_a_frozen_dataclass_become_owned():
    a, b = np.array([1.0, 2.0]), np.array([[3.0, 4.0], [5.0, 6.0]])
    pair = Pair(a, b)
    a[:], b[:] = 0.0, 0.0
    np.testing.assert_array_equal(pair.first, [1, 2])
    np.testing.assert_array_equal(pair.second, [[3, 4], [5, 6]])
    assert not pair.first.flags.writeable
    assert not pair.second.flags.writeable
    with pytest.raises(ValueError, match="second: shape"):
        Pair(a, a)
