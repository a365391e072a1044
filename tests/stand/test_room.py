"""Room for samples: in memory, or in a file without a name."""

import errno

import numpy as np
import pytest

from stand import room
from stand.room import Room


def test_arrays_are_handed_out_one_after_another(monkeypatch, tmp_path):
    monkeypatch.setattr(room, "IN_MEMORY", 0)
    own = Room(8 * 10, tmp_path)
    first, none, second = own.array((4,)), own.array((0,)), own.array((2, 3))
    first[:], second[:] = 1.0, 2.0
    own.written()
    np.testing.assert_array_equal(first, np.full(4, 1.0))
    np.testing.assert_array_equal(second, np.full((2, 3), 2.0))
    assert none.shape == (0,)
    assert list(tmp_path.iterdir()) == []  # it has no name: nothing is left of it


def test_a_disk_without_such_room_is_found_before_the_work(monkeypatch, tmp_path):
    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("os.posix_fallocate", full)
    with pytest.raises(OSError, match="No space left"):
        Room(room.IN_MEMORY + 1, tmp_path)
    Room(room.IN_MEMORY, tmp_path)  # in memory
