"""First-order recursions, block after block with the same bits wherever the blocks are cut.

What SciPy's `lfilter` does, by LAPACK's banded triangular solver: importing `scipy.signal` would
take half a second at every start of the command, `scipy.linalg` is there already.
"""

import numpy as np
from scipy.linalg import lapack

from alignment.arrays import Array


class Recursion:
    """``y_k = factor y_(k-1) + u_k`` along r rows.

    Parameters
    ----------
    factor : float or complex
        If it is complex, so are inputs and outputs.
    state : (r,)
        The output before the first.

    Attributes
    ----------
    state : (r,)
        The last output.
    """

    def __init__(self, factor: complex, state: Array) -> None:
        self._factor, self.state = factor, state
        self._band = np.empty((2, 0))

    def apply(self, u: Array) -> Array:
        """The next outputs (r, n) for the next inputs (r, n >= 1)."""
        stacked = np.hstack([self.state[:, None], u])
        size = stacked.shape[1]
        if self._band.shape[1] != size:
            self._band = np.asfortranarray(np.repeat([[1.0], [-self._factor]], size, axis=1))
        solve = lapack.ztbtrs if np.iscomplexobj(stacked) else lapack.dtbtrs  # pyright: ignore[reportAttributeAccessIssue]
        y, _ = solve(self._band, stacked.T, uplo="L", diag="U", overwrite_b=True)
        self.state = y[-1].copy()
        return y[1:].T
