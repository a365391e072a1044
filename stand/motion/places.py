"""Times in order, sorted by the piece of a motion that each is in: sums go along rows."""

import numpy as np

from alignment.arrays import Array, IntArray


class Places:
    """Places `at` (m,) in pieces of numbers `piece` (m,), which never go down.

    They lie in a table of a row or column for each piece, filled up with 0 where it has fewer than
    others: so what belongs to a piece is fetched once.

    Attributes
    ----------
    table : (pieces, most) or (most, pieces)
        Two places or more.
    pieces : slice
        Which have a row or column.
    rows : bool
        Whether they have rows.
    """

    def __init__(self, piece: IntArray, at: Array) -> None:
        own = piece - piece[0]
        counts = np.bincount(own)
        pieces, most = len(counts), int(counts.max())
        most = max(most, 2) if pieces == 1 else most
        self.pieces = slice(int(piece[0]), int(piece[0]) + pieces)
        self.rows = most > pieces  # the longer way
        shape = (pieces, most) if self.rows else (most, pieces)
        if self.rows and len(own) == pieces * most:
            self._index = None
            self.table = at.reshape(shape)
            return
        number = np.arange(len(own)) - (np.cumsum(counts) - counts)[own]
        self._index = own * most + number if self.rows else number * pieces + own
        self.table = np.zeros(shape)
        self.table.flat[self._index] = at

    def of_pieces(self, values: Array) -> Array:
        """Values (..., k) of all pieces, as they go with the table."""
        return np.expand_dims(values[..., self.pieces], -1 if self.rows else -2)

    def flat(self, found: Array) -> Array:
        """What was found (c, *) at the table's places, (c, m)."""
        found = found.reshape(len(found), self.table.size)
        return found if self._index is None else np.take(found, self._index, axis=1)


def filled(piece: IntArray) -> float:
    """Which part of its table such places, in order, would fill."""
    counts = np.bincount(piece - piece[0])
    return len(piece) / (len(counts) * int(counts.max()))
