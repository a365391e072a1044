"""The cross product, as a matrix and of many rows at once: its sign stands here alone."""

import numpy as np
from numpy.typing import ArrayLike

from alignment.arrays import Array


def cross_matrix(v: ArrayLike) -> Array:
    """Matrices (..., 3, 3) with ``cross_matrix(v) @ u = v x u`` of vectors `v` (..., 3).

    >>> cross_matrix([1, 2, 3])
    array([[ 0., -3.,  2.],
           [ 3.,  0., -1.],
           [-2.,  1.,  0.]])
    """
    v = np.asarray(v, dtype=float)
    matrix = np.zeros((*v.shape, 3))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        matrix[..., i, j], matrix[..., i, k] = -v[..., k], v[..., j]
    return matrix


def cross(a: Array, b: Array) -> Array:
    """Cross products of rows (n, 3), faster than the general one of numpy: in columns, as they are
    returned."""
    x, y = np.ascontiguousarray(a.T), np.ascontiguousarray(b.T)
    product = np.empty(np.broadcast_shapes(x.shape, y.shape))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        np.multiply(x[j], y[k], out=product[i])
        product[i] -= x[k] * y[j]
    return product.T
