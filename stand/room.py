"""Room for the samples of a run or a log: in memory, or in a file where that would be too much."""

import mmap
import os
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from alignment.parts import parts, release

IN_MEMORY = 2**28  # bytes: what is more lies in a file


def seconds(t_ns: NDArray[np.int64], origin: int) -> NDArray[np.float64]:
    """Times (n,) [s] of stamps [ns] since an `origin`, read-only."""
    found = Room(8 * len(t_ns)).array((len(t_ns),))
    for rows in parts(len(t_ns)):
        found[rows] = (t_ns[rows] - origin) * 1e-9
        release(t_ns, found)
    found.flags.writeable = False
    return found


class Room:
    """Room for so many bytes of arrays, handed out once each.

    Beyond `IN_MEMORY` they lie in a file without a name, mapped, which is gone with its last array
    or with the process: to everybody they are arrays like any other, and `alignment.parts` goes
    through them in little memory.

    Parameters
    ----------
    size : int
        Bytes in all.
    folder : path, optional
        Where the file is; else that for temporary files.

    Raises
    ------
    OSError
        The disk has no such room: found now, not in the middle of the work.
    """

    def __init__(self, size: int, folder: Path | None = None) -> None:
        self._used = 0
        self._map: mmap.mmap | None = None
        if size <= IN_MEMORY:
            return
        with tempfile.TemporaryFile(dir=folder) as file:
            if hasattr(os, "posix_fallocate"):
                os.posix_fallocate(file.fileno(), 0, size)
            else:
                file.truncate(size)
            self._map = mmap.mmap(file.fileno(), size)

    def array(self, shape: Sequence[int]) -> NDArray[Any]:
        """An array of float64 to be filled."""
        if self._map is None:
            return np.empty(shape)
        found = np.ndarray(shape, float, self._map, self._used)
        self._used += found.nbytes
        return found

    def written(self) -> None:
        """Give back the memory of what has been filled so far."""
        if self._map is not None:
            release(np.ndarray((), np.uint8, self._map))
