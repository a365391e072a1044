"""Small products, norms and recursions whose additions have one order on every processor.

BLAS and LAPACK pick their kernels by the processor, and kernels differ in the last digit: in the
order of a sum, or by a fused multiplication and addition. Whatever decides a sample of a
recording is computed with these instead, so that the same seed makes the same bytes anywhere.
"""

import importlib.util
from functools import cache, reduce
from importlib.machinery import PathFinder
from math import hypot
from pathlib import Path
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from alignment.arrays import Array

_TERMS = 40  # of a matrix exponential's series: of a norm of 2 the last counts 1e-36


def product(*factors: Array) -> Array:
    """Matrices and vectors multiplied as by ``a @ b @ ...``, from the left."""
    return reduce(_times, factors)


def _times(a: Array, b: Array) -> Array:
    left = "j" if a.ndim == 1 else "...ij"
    right = "j" if b.ndim == 1 else "...jk"
    out = ("" if a.ndim == 1 else "...i") + ("" if b.ndim == 1 else "k")
    return np.einsum(f"{left},{right}->{out}", a, b)


def norm(vector: Any) -> float:
    """Length of a vector (n,)."""
    return hypot(*(float(x) for x in vector))


def exponential(matrix: Array) -> Array:
    """Of a matrix (n, n) whose norm is 2 at most, by its series."""
    term = total = np.eye(len(matrix))
    for k in range(1, _TERMS):
        term = _times(term, matrix) / k
        total = total + term
    return total


def recursion(feedback: Any, u: NDArray[Any], last: NDArray[Any]) -> NDArray[Any]:
    """``y_k = u_k + feedback[0] y_(k-1) + feedback[1] y_(k-2) + ...`` along r rows.

    Parameters
    ----------
    feedback : (m,)
        One, real or complex, or two that are real.
    u : (r, n)
    last : (r, m)
        The outputs before the first, the latest first.

    Returns
    -------
    (r, n)
        The same bits as of a loop, wherever a run is cut into blocks.
    """
    if not u.shape[1]:
        return u
    kind = complex if np.iscomplexobj(feedback) or np.iscomplexobj(u) else float
    one, a = np.ones(1, kind), np.array([1.0, *(-np.asarray(feedback, kind))], kind)
    if len(a) == 2:  # the output before goes in first, and comes out as it is
        u, state = np.hstack([last, u]), np.zeros((len(u), 1), kind)
        return _linear_filter()(one, a, np.ascontiguousarray(u, kind), -1, state)[0][:, 1:]
    # of the filter's transposed form; real, as numpy's product of complex numbers may be fused
    state = np.stack([-a[1] * last[:, 0] - a[2] * last[:, 1], -a[2] * last[:, 0]], axis=1)
    return _linear_filter()(one, a, np.ascontiguousarray(u, kind), -1, state)[0]


@cache
def _linear_filter() -> Any:
    """The compiled loop behind `scipy.signal.lfilter`, without the second that all of
    `scipy.signal` takes to import; with it, where SciPy keeps the loop elsewhere.
    """
    folder = Path(scipy.__file__).parent / "signal"
    spec = PathFinder.find_spec("_sigtools", [str(folder)])
    if spec is not None and spec.loader is not None:
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        return module._linear_filter
    from scipy.signal import lfilter  # pragma: no cover

    return lambda b, a, x, axis, zi: lfilter(b, a, x, axis=axis, zi=zi)
