"""Arrays that grow at their end in place: a log is never held twice."""

import mmap
import tempfile
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from stand import room

COLUMNS = 8  # that grow side by side, about


class Growing:
    """An array that grows at its end in place.

    Joining a list of parts would hold the log twice: the parts' memory does not come back. What is
    too much for memory goes on in a file without a name, see `stand.room`.
    """

    def __init__(self, like: NDArray[Any]) -> None:
        self._values = np.empty((0, *like.shape[1:]), like.dtype)
        self._end = 0
        self._file: IO[bytes] | None = None

    def extend(self, part: NDArray[Any]) -> None:
        start, self._end = self._end, self._end + len(part)
        if self._file is None and self._size() > room.IN_MEMORY // COLUMNS:
            self._file = tempfile.TemporaryFile()  # noqa: SIM115
            self._file.write(self._values[:start].data)
            self._values = self._values[:0].copy()
        if self._file is not None:
            self._file.write(np.ascontiguousarray(part, self._values.dtype).data)
            return
        if self._end > len(self._values):
            self._resize(self._end + self._end // 8)
        self._values[start : self._end] = part

    def whole(self) -> NDArray[Any]:
        """The array at its length, read-only."""
        if self._file is not None:
            with self._file as file:
                file.flush()
                mapped = mmap.mmap(file.fileno(), self._size(), access=mmap.ACCESS_READ)
            shape = (self._end, *self._values.shape[1:])
            return np.ndarray(shape, self._values.dtype, mapped)
        self._resize(self._end)
        self._values.flags.writeable = False
        return self._values

    def _size(self) -> int:
        """Bytes."""
        return self._end * int(np.prod(self._values.shape[1:])) * self._values.itemsize

    def _resize(self, rows: int) -> None:
        # No view of the array leaves this class before `whole`, so nothing can dangle.
        self._values.resize((rows, *self._values.shape[1:]), refcheck=False)
