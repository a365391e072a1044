"""Times in order, sorted by the piece of a motion that each is in: sums go along rows."""

import numpy as np

from alignment.arrays import Array, IntArray


class Places:
    """Places `at` (m,) in pieces of numbers `piece` (m,), which never go down.

    They lie in a table of a row or column for each piece that has any, filled up with 0 where it
    has fewer than others: so what belongs to a piece is fetched once. A piece that has far more
    than others takes several: the table has room for 3 m places at most, or a few.

    Attributes
    ----------
    table : (rows, width) or (width, rows)
        Two places or more.
    rows : bool
        Whether pieces have rows.
    """

    def __init__(self, piece: IntArray, at: Array) -> None:
        own = piece - piece[0]
        counts = np.bincount(own)
        width = max(2, min(int(counts.max()), 2 * -(-len(own) // np.count_nonzero(counts))))
        taken = -(-counts // width)  # rows of each piece
        self._piece = np.repeat(np.arange(len(counts)) + piece[0], taken)
        rows = len(self._piece)
        self.rows = bool(width > rows)  # the longer way
        shape = (rows, width) if self.rows else (width, rows)
        self._index = None
        if self.rows and len(own) == rows * width:
            self.table = at.reshape(shape)
            return
        number = np.arange(len(own)) - (np.cumsum(counts) - counts)[own]
        row, column = (np.cumsum(taken) - taken)[own] + number // width, number % width
        self._index = row * width + column if self.rows else column * rows + row
        self.table = np.zeros(shape)
        self.table.flat[self._index] = at

    def of_pieces(self, values: Array) -> Array:
        """Values (..., k) of all pieces, those of each row or column (..., rows)."""
        return np.ascontiguousarray(np.take(values, self._piece, axis=-1))

    def beside(self, values: Array) -> Array:
        """As `of_pieces`, as they go with the table."""
        return np.expand_dims(self.of_pieces(values), -1 if self.rows else -2)

    def flat(self, found: Array) -> Array:
        """What was found (c, *) at the table's places, (c, m)."""
        found = found.reshape(len(found), self.table.size)
        return found if self._index is None else np.take(found, self._index, axis=1)
