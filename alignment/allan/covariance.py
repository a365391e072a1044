"""How far an Allan variance is uncertain, and how much two taus of it say the same.

The overlapping estimate at m samples is the mean of M = n + 1 - 2m squares ``Z(k)^2 / (2 m^2)``,
Z the second difference of the integrated signal x. For Gaussian noise (Isserlis)

``Cov(v_i, v_j) = 2/(4 m_i^2 m_j^2 M_i M_j) * sum_u c(u) r_ij(u)^2``

with r_ij(u) the covariance of Z_i(k) and Z_j(k + u) and c(u) the number of such pairs. It follows
from the generalised autocovariance of x, ``|u|^a`` or ``u^2 ln|u|`` by term: this is Greenhall and
Riley's method for equivalent degrees of freedom (NIST SP 1065, 5.4; PTTI 2003), carried through
for a sum of terms and between taus. A ramp is no noise: it moves the mean of Z, and the covariance
by ``4 mu_i mu_j sum c(u) r_ij(u)``.

Leading errors: the sum over lags is an integral with 8 nodes per averaging time (below 1 %); taus
that were decimated by m/32 are taken as fully overlapping, but for Q (below 1 %).
"""

from collections import Counter
from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from alignment.allan.terms import KEYS, design
from alignment.arrays import Array

LONGEST = 8  # parts of a record that the longest averaging time must fit in
NODES = 8  # per averaging time
REACH = 64  # averaging times after which flicker's covariance, ~ u^-2, no longer counts
OVERLAP = 32  # start points per averaging time that are used of long taus

_Q, _N, _B, _K, _R = range(len(KEYS))
_DIFFERENCE = np.array([1.0, -2.0, 1.0])
_PAIRS = np.outer(_DIFFERENCE, _DIFFERENCE)
_B_SCALE = 1 / (4 * np.log(2))  # makes B^2 the variance: 4 ln 2 of it is E Z^2 / (2 m^2)


def stride(m: int) -> int:
    """Samples between start points of an averaging time of m samples."""
    return max(1, 2 ** int(np.log2(m / OVERLAP))) if m > OVERLAP else 1


@lru_cache(maxsize=64)
def table(n: int, m: tuple[int, ...]) -> Array:
    """Covariance of Allan variances as a quadratic form in the terms' weights.

    Parameters
    ----------
    n : int
        Samples.
    m : tuple of int
        Averaging times in samples, increasing, each at most n/4.

    Returns
    -------
    (5, 5, k, k)
        T of ``Cov_ij = sum_pq w_p w_q T_pqij``, weights w as in `terms`.
    """
    T = np.zeros((len(KEYS), len(KEYS), len(m), len(m)))
    for i, m_i in enumerate(m):
        for j in range(i, len(m)):
            T[:, :, i, j] = T[:, :, j, i] = _pair(n, m_i, m[j])
    T.flags.writeable = False
    return T


def octaves(n: int) -> np.ndarray:
    """Averaging times in samples for a record of n samples."""
    return 2 ** np.arange(int(np.log2(n // LONGEST)) + 1)


def shares(lengths: Sequence[int], m: tuple[int, ...]) -> Array:
    """What each stretch (of `lengths` samples) has in the pooled variance at each tau: (s, k).

    By their squares: M = n + 1 - 2m of them, none where tau is too long for a stretch.
    """
    n, tau = np.asarray(lengths)[:, None], np.asarray(m)
    squares = np.where(tau * LONGEST <= n, n + 1.0 - 2 * tau, 0.0)
    return squares / squares.sum(axis=0)


@lru_cache(maxsize=64)
def pooled(lengths: tuple[int, ...], m: tuple[int, ...]) -> Array:
    """`table` of Allan variances that are pooled from stretches, whose noise is independent."""
    if len(lengths) == 1:
        return table(lengths[0], m)
    T = np.zeros((len(KEYS), len(KEYS), len(m), len(m)))
    part = shares(lengths, m)
    for n, times in Counter(lengths).items():
        k = int(np.count_nonzero(np.asarray(m) * LONGEST <= n))
        own = part[lengths.index(n), :k]
        T[:, :, :k, :k] += times * table(n, m[:k]) * np.outer(own, own)
    T.flags.writeable = False
    return T


def covariance(T: Array, weights: Array) -> Array:
    """Covariance (k, k) of Allan variances from `table` for the terms' weights (5,)."""
    products = (weights[:, None] * weights).ravel()
    return (products @ T.reshape(len(products), -1)).reshape(T.shape[2:])


def degrees_of_freedom(lengths: tuple[int, ...], m: tuple[int, ...], weights: Array) -> Array:
    """Equivalent degrees of freedom (k,): ``2 E[v]^2 / Var v``, noise and ramp of these weights."""
    expected = design(m) @ weights
    variances = np.diag(covariance(pooled(lengths, m), weights))
    return 2 * expected**2 / np.maximum(variances, 2e-12 * expected**2)  # a ramp alone has none


def _pair(n: int, m_i: int, m_j: int) -> Array:
    """The quadratic form (5, 5) for one pair of averaging times, m_i <= m_j."""
    pairs = (n + 1 - 2 * m_i, n + 1 - 2 * m_j)
    form = np.zeros((len(KEYS), len(KEYS)))
    lags, products, at, spikes, crossed, ends = _lag_products(m_i, m_j)
    form[_N : _K + 1, _N : _K + 1] = products @ _count(lags, *pairs)
    count = _count(at, *pairs) * stride(m_i)
    form[_Q, _N : _K + 1] = form[_N : _K + 1, _Q] = crossed @ (spikes * count)
    form[_Q, _Q] = spikes**2 @ count
    form /= 2.0 * float(m_i) ** 2 * float(m_j) ** 2
    form[_R, :_R] = form[:_R, _R] = _ramp(n, m_i, m_j, ends) / 2
    return form / (float(pairs[0]) * pairs[1])


@lru_cache(maxsize=2048)
def _lag_products(m_i: int, m_j: int) -> tuple[Array, Array, Array, Array, Array, Array]:
    """What does not depend on the record's length: sums of `_pair` but for the counts."""
    lags, steps = _lags(m_i, m_j)
    r = _cross(lags, m_i, m_j)
    at, spikes = _spikes(m_i, m_j)
    products = r[:, None, :] * r[None, :, :] * steps
    return lags, products, at, spikes, _cross(at, m_i, m_j), _ends(m_i, m_j)


def _lags(m_i: int, m_j: int) -> tuple[Array, Array]:
    """Lags to sum over, dense where r has its kinks, and how many lags each stands for."""
    kinks = np.array([a * m_i - b * m_j for a in range(3) for b in range(3)])
    fine = max(1, m_i // NODES) * np.arange(-3 * NODES, 3 * NODES + 1)
    coarse = max(1, m_j // (4 * NODES)) * np.arange(-12 * NODES, 12 * NODES + 1)
    tail = np.rint(np.geomspace(2 * m_j + 2 * m_i, REACH * m_j, 32)).astype(np.int64)
    lags = np.unique(np.concatenate([(kinks[:, None] + fine).ravel(), coarse, tail, -tail]))
    gaps = np.concatenate([[1], np.diff(lags), [1]])
    return lags.astype(float), (gaps[:-1] + gaps[1:]) / 2


def _count(lags: Array, M_i: int, M_j: int) -> Array:
    """Pairs (k, k + u) with k < M_i and k + u < M_j."""
    return np.maximum(0.0, np.minimum(M_i, M_j - lags) - np.maximum(0.0, -lags))


def _cross(lags: Array, m_i: int, m_j: int) -> Array:
    """r_ij (3, k) of N, B and K at weight 1."""
    steps = np.arange(3)
    at = lags[:, None, None] + m_j * steps[None, :] - m_i * steps[:, None]
    u = np.abs(at)
    log = np.log(np.where(u > 0, u, 1.0))
    kernels = np.stack([-u / 2, _B_SCALE * u * u * log, u * u * u / 12])
    r = np.einsum("pkab,ab->pk", kernels, _PAIRS)
    # Outside their support N and K are zero but for rounding, which the cube makes large.
    r[::2, (lags <= -2 * m_j) | (lags >= 2 * m_i)] = 0.0
    return r


def _spikes(m_i: int, m_j: int) -> tuple[Array, Array]:
    """The lags at which white x correlates, and r_ij there."""
    at = np.array([[a * m_i - b * m_j for b in range(3)] for a in range(3)])
    lags, which = np.unique(at, return_inverse=True)
    r = np.bincount(which.ravel(), _PAIRS.ravel())
    return lags.astype(float), r.astype(float)


def _ramp(n: int, m_i: int, m_j: int, ends: Array) -> Array:
    """``sum_u c(u) r_ij(u)`` (4,) of Q, N, B, K: the covariance of the sums of Z_i and of Z_j.

    A sum of second differences telescopes to boxes of x at both ends of the record, which see each
    other through R''.
    """
    between = n - m_i - m_j
    apart = np.array([0.0, 0.0, _B_SCALE * (2 * np.log(between) + 3), between / 2])
    return 2 * (ends + float(m_i) ** 2 * float(m_j) ** 2 * apart)


def _ends(m_i: int, m_j: int) -> Array:
    """What one end of the record contributes: F is the second integral of the autocovariance."""
    steps = np.arange(3)
    u = np.abs(np.subtract.outer(m_i * steps, m_j * steps)).astype(float)
    log = np.log(np.where(u > 0, u, 1.0))
    F = np.stack([u / 2, -(u**3) / 12, _B_SCALE * u**4 * (log / 12 - 7 / 144), u**5 / 240])
    return -np.einsum("pab,ab->p", F, _PAIRS)
