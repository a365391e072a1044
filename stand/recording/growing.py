"""Arrays that grow at their end in place: a log is never held twice."""

from typing import Any

import numpy as np
from numpy.typing import NDArray


class Growing:
    """An array that grows at its end in place.

    Joining a list of parts would hold the log twice: the parts' memory does not come back.
    """

    def __init__(self, like: NDArray[Any]) -> None:
        self._values = np.empty((0, *like.shape[1:]), like.dtype)
        self._end = 0

    def extend(self, part: NDArray[Any]) -> None:
        start, self._end = self._end, self._end + len(part)
        if self._end > len(self._values):
            self._resize(self._end + self._end // 8)
        self._values[start : self._end] = part

    def whole(self) -> NDArray[Any]:
        """The array at its length, read-only."""
        self._resize(self._end)
        self._values.flags.writeable = False
        return self._values

    def _resize(self, rows: int) -> None:
        # No view of the array leaves this class before `whole`, so nothing can dangle.
        self._values.resize((rows, *self._values.shape[1:]), refcheck=False)
