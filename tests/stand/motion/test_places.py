"""Places in tables: each comes back, with what belongs to its piece, and the table stays small."""

import numpy as np
import pytest

from stand.motion.places import Places


@pytest.mark.parametrize(
    "counts",
    [[1], [5], [3, 3, 3], [2, 0, 0, 7], [10_000, *[10] * 600], [0, 1] * 500, [1] * 40, [400, 399]],
)
def test_any_counts(counts):
    piece = np.repeat(np.arange(len(counts)), counts) + 3
    at = np.arange(1.0, len(piece) + 1)
    places = Places(piece, at)
    owners = np.arange(len(counts) + 3.0)
    assert places.table.size <= 3 * len(at) + 2 * len(set(piece))
    np.testing.assert_array_equal(places.flat(places.table[None])[0], at)
    both = places.table + 1e6 * places.beside(owners)
    np.testing.assert_array_equal(places.flat(both[None])[0], at + 1e6 * piece)
    assert places.table.shape[-1] > 1
