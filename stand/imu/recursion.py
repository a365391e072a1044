"""Recursive filters, block after block with the same bits wherever the blocks are cut.

What SciPy's `lfilter` does, by LAPACK's banded triangular solver: importing `scipy.signal` would
take half a second at every start of the command, `scipy.linalg` is there already.
"""

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import lapack

from alignment.arrays import Array


class Recursion:
    """``a0 y_k + a1 y_(k-1) + ... = b0 u_k + b1 u_(k-1) + ...`` along rows.

    Parameters
    ----------
    numerator, denominator : (up to m + 1,), (m + 1,)
        b and a, with a0 = 1.
    """

    def __init__(self, numerator: ArrayLike, denominator: ArrayLike) -> None:
        self._b, self._a = np.asarray(numerator, float), np.asarray(denominator, float)
        self._order = len(self._a) - 1
        self._inputs = self._outputs = self._band = np.empty((0, 0))

    def settle(self, u: Array, y: Array) -> None:
        """Start as if input and output had been `u`, `y` (r,) for ever."""
        self._inputs = np.repeat(np.asarray(u)[:, None], self._order, axis=1)
        self._outputs = np.repeat(np.asarray(y)[:, None], self._order, axis=1)

    def apply(self, u: Array) -> Array:
        """The next outputs (r, n) for the next inputs (r, n >= 1)."""
        m, n = self._order, u.shape[1]
        padded = np.hstack([self._inputs, u])
        stacked = np.hstack([self._outputs, u])
        driven = stacked[:, m:]
        driven *= self._b[0]
        for lag in range(1, len(self._b)):
            driven += self._b[lag] * padded[:, m - lag : m - lag + n]
        solve = lapack.dtbtrs  # pyright: ignore[reportAttributeAccessIssue]
        y, _ = solve(self._equations(n), stacked.T, uplo="L", diag="U", overwrite_b=True)
        self._inputs, self._outputs = padded[:, n:].copy(), np.ascontiguousarray(y[n:].T)
        return y[m:].T

    def _equations(self, n: int) -> Array:
        """The band of a matrix in which the last outputs stand before the n new ones."""
        rows = self._order + n
        if self._band.shape[1] != rows:
            self._band = np.asfortranarray(np.repeat(self._a[:, None], rows, axis=1))
            for row in range(1, self._order):  # no equation among the last outputs themselves
                self._band[row, : self._order - row] = 0.0
        return self._band
