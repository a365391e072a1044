"""Plain quaternion arrays (x, y, z, w) for hot loops, where `Rotation` is too slow."""

import numpy as np
from scipy.spatial.transform import Rotation

from alignment.arrays import Array

_RUN = 16  # quaternions of which each is multiplied by the one before


def multiply(p: Array, q: Array) -> Array:
    """Hamilton product of quaternions (..., 4), order x, y, z, w."""
    px, py, pz, pw = p[..., 0], p[..., 1], p[..., 2], p[..., 3]
    qx, qy, qz, qw = q[..., 0], q[..., 1], q[..., 2], q[..., 3]
    product = np.empty(np.broadcast_shapes(p.shape, q.shape))
    product[..., 0] = pw * qx + px * qw + py * qz - pz * qy
    product[..., 1] = pw * qy - px * qz + py * qw + pz * qx
    product[..., 2] = pw * qz + px * qy - py * qx + pz * qw
    product[..., 3] = pw * qw - px * qx - py * qy - pz * qz
    return product


def normalised(q: Array) -> Array:
    """Quaternions (..., 4) brought to norm one: the norm correction."""
    return q / np.sqrt(np.einsum("...i,...i->...", q, q))[..., None]


def prefix_product(q: Array) -> Array:
    """Running products ``q_0``, ``q_0 o q_1``, ... of quaternions (n, 4), norm-corrected.

    Runs of `_RUN` rows advance together; then each is multiplied by what those before it come to,
    which are running products too: little more than 2 n products in few numpy calls.
    """
    n = len(q)
    table = np.zeros((-(-n // _RUN), _RUN, 4))
    table[..., 3] = 1.0
    table.reshape(-1, 4)[:n] = q
    for k in range(1, _RUN):
        table[:, k] = normalised(multiply(table[:, k - 1], table[:, k]))
    if n > _RUN:
        before = prefix_product(table[:-1, -1])
        table[1:] = normalised(multiply(before[:, None], table[1:]))
    return table.reshape(-1, 4)[:n]


def turned_evenly(t: Array, q: Array, at: Array) -> Rotation:
    """Attitudes at times (m,) [s], turning evenly from each of the samples to the next.

    `q` (n, 4) holds at `t` (n,), n >= 2; before the first and after the last it stays.
    """
    k = np.clip(np.searchsorted(t, at), 1, len(t) - 1)
    before, after = (Rotation.from_quat(q[i]) for i in (k - 1, k))
    part = np.clip((at - t[k - 1]) / (t[k] - t[k - 1]), 0.0, 1.0)
    return before * Rotation.from_rotvec(part[:, None] * (before.inv() * after).as_rotvec())
