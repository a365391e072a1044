"""First-order recursions, block after block with the same bits wherever the blocks are cut."""

from typing import Any

from numpy.typing import NDArray

from alignment.fixed_order import recursion


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

    def __init__(self, factor: complex, state: NDArray[Any]) -> None:
        self._factor = factor
        self.state: Any = state

    def apply(self, u: NDArray[Any]) -> Any:
        """The next outputs (r, n) for the next inputs (r, n >= 1)."""
        y = recursion([self._factor], u, self.state[:, None])
        self.state = y[:, -1].copy()
        return y
