"""Updates and steps of the fine filter: three ways through many of them, of one result.

By a root of the covariance where variances fall by twelve orders, by whole blocks where nobody
asks what each update found, and one by one.
"""

from dataclasses import dataclass, field, replace
from functools import cache
from typing import NamedTuple

import numpy as np

from alignment.arrays import Array
from alignment.estimate import determined

ERRORS = 10  # of attitude, velocity, displacement, and the size of gravity: the first states
BLOCK = 64  # updates that are one, where nobody asks what each found
_SYMMETRIC = 8  # updates after which rounding's asymmetry is taken out
_CONSISTENT = 5.0  # standard errors by which the innovations' mean square may exceed one
_TOLD = ("x", "variances", "attitude", "values", "scaled")  # of a pass, by each or by the last


class Steps(NamedTuple):
    """From each of k updates to the next: errors of the reference, driven by constants and drifts.

    `rows` (k, e, s): the errors' transition; `kept` (c,): what of each constant and drift is left;
    `walks` (k, e, e), `added` (k, c): covariance of errors and variances of the others that noise
    adds.
    """

    rows: Array
    kept: Array
    walks: Array
    added: Array

    @property
    def F(self) -> Array:
        """Transitions (k, s, s) of the whole state."""
        k, e, size = self.rows.shape
        kept = np.concatenate([np.zeros((len(self.kept), e)), np.diag(self.kept)], axis=1)
        below = np.broadcast_to(kept, (k, size - e, size))
        return np.concatenate([self.rows, below], axis=1)

    @property
    def Q(self) -> Array:
        """Covariances (k, s, s) that noise adds to the whole state."""
        k, e, size = self.rows.shape
        Q = np.zeros((k, size, size))
        Q[:, :e, :e] = self.walks
        own = np.arange(e, size)
        Q[:, own, own] = self.added
        return Q


@dataclass(frozen=True, slots=True, eq=False)
class Pass:
    """After each update, or the last alone: errors of the reference `x` (m, s), which are attitude
    about n [rad], velocity, displacement, constants; their `variances`; covariance `attitude`
    (m, 3, 3); innovations `values` (m, 3). Of all updates in any case: the innovations' variances
    `expected` (n, 3) and normalised squares `misfit` (n,), as far as they are told. `heading` (s,):
    covariances of heading's error with all, at the end. `scaled` (m, 3): of attitude's errors with
    the sum of the states `scale`, which a clock that runs fast is one of.
    """

    x: Array
    variances: Array
    attitude: Array
    values: Array
    expected: Array
    misfit: Array
    heading: Array = field(default_factory=lambda: np.zeros(0))
    scaled: Array = field(default_factory=lambda: np.zeros((0, 3)))
    scale: slice = field(default_factory=lambda: slice(0))

    @property
    def left(self) -> Array:
        """Errors (s,) of the reference at the end, to be corrected.

        Where heading is not determined it stays where it is, and the others are those of a heading
        that is right: biases make up for a wrong one, and tilt settles about any.
        """
        x, own = self.x[-1], self.heading
        if determined(np.sqrt(self.variances[-1, 2])):
            return x
        return np.asarray(x - own / own[2] * x[2])

    @property
    def inconsistent(self) -> bool:
        """Whether the innovations are larger than the filter holds possible."""
        allowed = 1 + _CONSISTENT * np.sqrt(2 / (3 * len(self.misfit)))
        return float(self.misfit.mean()) / 3 > allowed

    @property
    def last(self) -> "Pass":
        """Of the last update alone."""
        return replace(self, **{name: getattr(self, name)[-1:] for name in _TOLD})

    def ending(self, last: "Pass") -> "Pass":
        """With the answer of another pass at the end, which rounds otherwise."""
        ends = {n: np.concatenate([getattr(self, n)[:-1], getattr(last, n)]) for n in _TOLD}
        return replace(self, **ends, heading=last.heading)


def careful_updates(
    state: Array, given: tuple[Steps, Array, Array, float], part: slice, out: Pass
) -> None:
    """As `one_by_one`, by a root S of the covariance, ``P = S^T S``, and orthogonal triangles.

    ``[[r, 0], [S H^T, S]]`` becomes ``[[W, K], [0, S]]`` with ``W^T W`` the innovation's covariance
    and ``K^T W^-T`` the gain: G. J. Bierman, Factorization Methods for Discrete Sequential
    Estimation (1977), chapter V. Differences of variances, of which one metre squared less itself
    leaves nothing of a square micrometre, do not arise.
    """
    (rows, kept, walks, added), H, z, variance = given
    size, free = len(state), ERRORS
    S, x = _root(state[:, :-1]), state[:, -1].copy()
    walked, spread = _root(walks), np.sqrt(added)
    observed = np.zeros((3 + size, 3 + size))
    moved = np.zeros((2 * size, size))
    observed[:3, :3] = np.sqrt(variance) * np.eye(3)
    own = np.arange(free, size)
    for k, h in enumerate(H):
        observed[3:, :3], observed[3:, 3:] = S @ h.T, S
        triangle = _triangle(observed)
        W, S = triangle[:3, :3], triangle[3:, 3:]
        value = z[k] - h @ x
        unit = np.linalg.solve(W.T, value)
        x = x + triangle[:3, 3:].T @ unit
        at = part.start + k
        out.x[at], out.variances[at] = x, np.sum(S * S, axis=0)
        out.attitude[at] = S[:, :3].T @ S[:, :3]
        out.scaled[at] = S[:, :3].T @ S[:, out.scale].sum(axis=1)
        out.values[at], out.misfit[at] = value, unit @ unit
        out.expected[at] = np.sum(W * W, axis=0)
        if k < len(rows):
            moved[:size, :free] = S @ rows[k].T
            np.multiply(S[:, free:], kept, out=moved[:size, free:])
            moved[size : size + free, :free] = walked[k]
            moved[size + own, own] = spread[k]
            S = _triangle(moved)
            x = np.concatenate([rows[k] @ x, kept * x[free:]])
    state[:, :-1], state[:, -1] = S.T @ S, x


def by_blocks(
    state: Array, given: tuple[Steps, Array, Array, float], part: slice, out: Pass
) -> None:
    """As `one_by_one`, by whole blocks whose updates are one, where constants stand still; of `out`
    only the misfit, of each block the mean.

    What `_seen` makes of a block is an update by W of noise 1 and a step by A and C, both by roots
    of the covariance as in `careful_updates`: ``P = S^T S`` becomes ``S^T B^-1 S`` with
    ``B = 1 + (W S^T)^T (W S^T)``, in which nothing cancels.
    """
    try:
        seen, stepped, added = _seen(*given)
    except np.linalg.LinAlgError:  # rounding leaves no covariance: to be told as it is there
        one_by_one(state, given, part, out)
        return
    size, free = len(state), ERRORS
    S, x, added = _root(state[:, :-1]), state[:, -1].copy(), _root(added)
    moved, told = np.zeros((size + free, size)), np.empty(len(seen))
    for k, (W, A) in enumerate(zip(seen, stepped, strict=True)):
        V, value = W[:, :-1] @ S.T, -(W[:, :-1] @ x + W[:, -1])
        B = np.linalg.cholesky(np.eye(size) + V.T @ V)
        solved = np.linalg.solve(B, np.column_stack([S, V.T @ value]))
        S, unit = solved[:, :-1], solved[:, -1]
        told[k] = value @ value - unit @ unit
        x = x + S.T @ unit
        x[:free] = A[:, :-1] @ x + A[:, -1]
        moved[:size, :free], moved[:size, free:] = S @ A[:, :-1].T, S[:, free:]
        moved[size:, :free] = added[k]
        S = _triangle(moved)
    out.misfit[part], out.expected[part] = np.repeat(told / BLOCK, BLOCK), np.inf
    state[:, :-1], state[:, -1] = S.T @ S, x


def _seen(steps: Steps, H: Array, z: Array, variance: float) -> tuple[Array, Array, Array]:
    """What n blocks of b updates tell of the state x before each, and make of its errors.

    Returns
    -------
    W : (n, 3 b, s + 1)
        Innovations ``-W [x 1]``, each of variance 1, of a filter that knows x.
    A, C : (n, e, s + 1), (n, e, e)
        Errors after the block: ``A [x 1]``, with covariance C by that filter.

    Notes
    -----
    It starts without covariance, so that its gains follow neither x nor the block before: all
    blocks advance together, an update at a time. S. Sarkka and A. F. Garcia-Fernandez, Temporal
    Parallelization of Bayesian Smoothers, IEEE Trans. Autom. Control 66 (2021) 299.
    """
    e, size = steps.rows.shape[1:]
    rows, walks, H, z = (
        x.reshape(-1, BLOCK, *x.shape[1:]) for x in (steps.rows, steps.walks, H, z)
    )
    both = np.zeros((len(H), e, size + 1 + e))  # [A C]
    both[:, :, :e] = np.eye(e)
    own, moved = slice(size + 1, None), slice(6, 9)
    W = np.empty((*H.shape[:3], size + 1))
    for k in range(BLOCK):
        found = both[:, moved].copy()  # H is that of displacement and of constants
        spread = found[:, :, own][:, :, moved] + variance * np.eye(3)
        found[:, :, e:size] += H[:, k, :, e:]
        found[:, :, size] -= z[:, k]
        white = np.linalg.inv(np.linalg.cholesky(spread)) @ found
        W[:, k] = white[:, :, : size + 1]
        both -= white[:, :, own].transpose(0, 2, 1) @ white
        F = rows[:, k, :, :e]
        both = F @ both
        both[:, :, e:size] += rows[:, k, :, e:]
        both[:, :, own] = both[:, :, own] @ F.transpose(0, 2, 1) + walks[:, k]
    return W.reshape(len(W), -1, size + 1), both[:, :, : size + 1], both[:, :, own]


def _triangle(rows: Array) -> Array:
    """R with ``R^T R = rows^T rows``, upper triangular."""
    size = rows.shape[1]
    reflectors, _ = np.linalg.qr(rows, mode="raw")
    return np.asarray(np.where(_upper(size), reflectors.T[:size], 0.0))


@cache
def _upper(size: int) -> Array:
    """Which of a triangle's elements there are."""
    return np.triu(np.ones((size, size), dtype=bool))


def _root(P: Array) -> Array:
    """Matrices S with ``S^T S = P`` (..., n, n), each variance to its own last digits.

    One that rounding has left below 0, of a displacement that one interval's noise does not reach
    yet, is none.
    """
    sigmas = np.sqrt(np.maximum(np.diagonal(P, axis1=-2, axis2=-1), 0.0))
    unit = np.where(sigmas > 0, sigmas, 1.0)
    values, vectors = np.linalg.eigh(P / (unit[..., None] * unit[..., None, :]))
    root = np.sqrt(np.maximum(values, 0.0))[..., None] * np.swapaxes(vectors, -1, -2)
    return np.asarray(root * sigmas[..., None, :])


def one_by_one(
    state: Array, given: tuple[Steps, Array, Array, float], part: slice, out: Pass
) -> None:
    """Update and propagate `state` (s, s + 1), covariance and errors ``[P x]``, through `part`.

    One product with H gives ``H P`` and ``H x``. The constants stand still, and drifts fade: only
    the rows of the first `ERRORS` states are propagated, and mirrored.
    """
    (rows, kept, walks, added), H, z, variance = given
    n, size, free = len(z), len(state), ERRORS
    R = variance * np.eye(3)
    seen, spread = np.empty((n, 3, size + 1)), np.empty((n, 3, 3))
    after, moved = np.empty((n, size, size + 1)), np.empty((free, size + 1))
    drifting = bool(added.any())
    kept = np.concatenate([np.ones(free), kept, [1.0]])
    fading = kept[:-1, None] * kept if np.any(kept < 1) else None
    # views, made once
    P, innovations = state[:, :-1], seen[:, :, -1]
    moving, mixed, mirrored = state[:free, :free], state[:free, free:], state[free:, :free]
    moved_P, moved_mixed, moved_back = moved[:, :-1], moved[:, free:], moved[:, free:-1].T
    constants = state.reshape(-1)[free * (size + 2) :: size + 2]  # their variances
    for k, (h, found, S) in enumerate(zip(H, seen, spread, strict=True)):
        np.dot(h, state, out=found)
        innovations[k] -= z[k]
        HP = found[:, :-1]
        np.add(HP.dot(h.T), R, out=S)
        np.subtract(state, HP.T.dot(_inverse(S).dot(found)), out=state)
        after[k] = state
        if k == len(rows):
            break
        row = rows[k]
        np.dot(row, state, out=moved)
        np.add(moved_P.dot(row.T), walks[k], out=moving)
        if fading is not None:
            np.multiply(state, fading, out=state)
            np.multiply(moved_mixed, kept[free:], out=moved_mixed)
        mixed[:] = moved_mixed
        mirrored[:] = moved_back
        if drifting:
            constants += added[k]
        if k % _SYMMETRIC == 0:
            P[:] = 0.5 * (P + P.T)
    out.x[part] = after[:, :, -1]
    out.variances[part] = np.diagonal(after, axis1=1, axis2=2)
    out.attitude[part] = after[:, :3, :3]
    out.scaled[part] = after[:, :3, out.scale].sum(axis=2)
    values = -innovations
    out.values[part] = values
    out.expected[part] = np.diagonal(spread, axis1=1, axis2=2)
    out.misfit[part] = (values * np.linalg.solve(spread, values[..., None])[..., 0]).sum(axis=1)


def _inverse(S: Array) -> Array:
    """Of a covariance (3, 3), by ``L D L^T``: in a third of the time of np.linalg's."""
    (a, b, c), (_, d, e), (_, _, f) = S.tolist()
    p, q = b / a, c / a
    d_left, e_left = d - p * b, e - p * c
    r = e_left / d_left
    s = p * r - q  # of the inverse of L: rows (1), (-p, 1), (s, -r, 1)
    third = 1 / (f - q * c - r * e_left)
    second = 1 / d_left
    xy, xz, yz = -p * second - s * r * third, s * third, -r * third
    xx, yy = 1 / a + p * p * second + s * xz, second - r * yz
    return np.array(((xx, xy, xz), (xy, yy, yz), (xz, yz, third)))
