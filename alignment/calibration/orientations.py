"""What rests can tell of accelerometers by gravity's norm alone: rank, condition, what to add.

A rest shows one number: how far the norm of what it reads is from gravity. With u the vertical in
b (unit vector), scale errors s, angles n by which axes lean together and biases b show as ::

    sum s_i u_i^2 + sum n_ij u_i u_j + sum (b_i / g) u_i

so faces tell six of the nine, corners seven, and edges all. Source: D. Tedaldi, A. Pretto, E.
Menegatti, A robust and easy to implement method for IMU calibration without external equipments
(ICRA 2014), equation (10), to first order.
"""

from itertools import product

import numpy as np

from alignment.arrays import Array
from alignment.calibration.result import PAIRS

AXES = ("X1", "Y1", "Z1")
NAMES = (
    *(f"accelerometer scale factor {axis}" for axis in AXES),
    *(f"accelerometer non-orthogonality {AXES[i]}-{AXES[j]}" for i, j in PAIRS),
    *(f"accelerometer bias {axis}" for axis in AXES),
)
LEAST = 5e-3  # of the largest singular value: attitudes 0.3 deg off a face are still that face
SHARE = 0.1  # of a direction that cannot be told: parameters with less are not named


def norm_rows(up: Array) -> Array:
    """What the norm at rests shows (k, 9) of scales, leanings and biases over g; `up` (k, 3)."""
    leaning = [up[:, i] * up[:, j] for i, j in PAIRS]
    return np.column_stack([up**2, *leaning, up])


def rank_of(rows: Array, least: float = LEAST) -> tuple[int, float, Array]:
    """Rank of rows (k, p), condition (infinite where it is short), and directions not told (q, p).

    Condition is the ratio of the largest and the least singular value.
    """
    p = rows.shape[1]
    _, sizes, directions = np.linalg.svd(np.vstack([rows, np.zeros((p, p))]))
    rank = int(np.count_nonzero(sizes > least * sizes[0])) if sizes[0] else 0
    condition = float(sizes[0] / sizes[-1]) if rank == p else np.inf
    return rank, condition, np.asarray(directions[rank:])


def in_words(directions: Array, names: tuple[str, ...]) -> tuple[str, ...]:
    """Directions (q, p) that cannot be told: parameters alone, then such as are mixed up."""
    if not len(directions):
        return ()
    projector = directions.T @ directions
    alone = [n for n, size in enumerate(projector.diagonal()) if size > 1 - SHARE**2]
    mixed = [n for n, size in enumerate(projector.diagonal()) if size > SHARE**2 and n not in alone]
    told = [f"{names[n]}: not told at all" for n in alone]
    if mixed:
        told.append(f"cannot be told apart: {', '.join(names[n] for n in mixed)}")
    return tuple(told)


def additions(up: Array) -> tuple[str, ...]:
    """The fewest rests, by what is up, that would make `up` (k, 3) tell all nine; greedily."""
    names, candidates = _candidates()
    rows, found = norm_rows(up), []
    while rank_of(rows)[0] < len(NAMES) and len(found) < len(NAMES):
        more = [np.vstack([rows, norm_rows(one[None])]) for one in candidates]
        best = max(range(len(names)), key=lambda n: _told(more[n]))
        found.append(names[best])
        rows = more[best]
    return tuple(found)


def _told(rows: Array) -> tuple[int, float]:
    """Rank, then the volume of what is told: the larger the better."""
    rank = rank_of(rows)[0]
    sizes = np.linalg.svd(rows, compute_uv=False)[:rank]
    return rank, float(np.log(sizes).sum())


def _candidates() -> tuple[list[str], Array]:
    """The faces, edges and corners of a cube: names of what is up, unit vectors."""
    names, found = [], []
    for signs in product((1, 0, -1), repeat=3):
        if any(signs):
            parts = [f"{'-' if s < 0 else '+'}{a}" for s, a in zip(signs, AXES, strict=True) if s]
            names.append("".join(parts).removeprefix("+") + " up")
            found.append(np.array(signs) / np.sqrt(np.count_nonzero(signs)))
    return names, np.array(found)
