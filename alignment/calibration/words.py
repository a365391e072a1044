"""What a test cannot tell of a unit, in words: by the directions that the readings do not see."""

from functools import lru_cache

import numpy as np

from alignment.arrays import Array
from alignment.calibration import terms
from alignment.calibration.design import Design, nuisance_source, term_source

UNSEEN = 0.05  # part of a prior's variance that the readings must take away to tell anything
FAINT = 0.3  # of a reading's sigma, by an unknown of one prior sigma: below it nothing shows
HEARD = 0.3  # of the largest effect: what does less to the readings goes unsaid
AXES = ("X1", "Y1", "Z1")
PAIRS = ("Y1-Z1", "Z1-X1", "X1-Y1")
MOST = 3  # rivals that are named


@lru_cache(maxsize=8)
def untold(design: Design) -> tuple[str, ...]:
    """A sentence for every term of which readings say next to nothing, along some direction.

    Either nothing depends on it as strongly as it is known beforehand, or other terms, or a
    nuisance, do the same to the readings: then these are named.
    """
    unit = np.flatnonzero(design.active < terms.COUNT)
    P = design.covariance / np.outer(design.sigmas, design.sigmas)
    left, directions = np.linalg.eigh(P[np.ix_(unit, unit)])
    effects = np.linalg.norm(design.W, axis=0)
    others = np.setdiff1d(np.arange(len(P)), unit)
    follow = P[np.ix_(others, unit)] @ np.linalg.inv(P[np.ix_(unit, unit)])
    found: dict[tuple[str, tuple[str, ...]], list[str]] = {}
    for vector, pivot in _reduced(directions[:, left > 1 - UNSEEN]):
        heard = np.zeros(len(P))
        heard[unit] = np.abs(vector) * effects[unit]
        heard[others] = np.abs(follow @ vector) * effects[others]
        at = unit[pivot]
        rivals: dict[str, float] = {}
        if heard[at] >= FAINT:
            for k in np.flatnonzero(heard >= HEARD * heard[at]):
                if k != at:
                    name = _name(design, int(k))
                    rivals[name] = max(rivals.get(name, 0.0), heard[k])
        told = tuple(sorted(rivals, key=lambda name: -rivals[name])[:MOST])
        found.setdefault((_name(design, int(at)), told), []).append(_axis(design, int(at)))
    return tuple(_sentence(name, rivals, axes) for (name, rivals), axes in sorted(found.items()))


def _sentence(name: str, rivals: tuple[str, ...], axes: list[str]) -> str:
    where = "" if len(axes) in (3, 9) and not rivals else f" ({', '.join(sorted(axes))})"
    if not rivals:
        return f"{name}{where}: no reading here depends on it beyond what is known already"
    rest = " and ".join("that of another axis" if r == name else r for r in rivals)
    return f"{name}{where}: cannot be told from {rest} here"


def _reduced(directions: Array) -> list[tuple[Array, int]]:
    """Directions (p, u) in reduced form: each 1 at a pivot of its own, the largest first."""
    left = [np.array(v) for v in directions.T]
    done: list[tuple[Array, int]] = []
    while left:
        sizes = [float(np.abs(v).max()) for v in left]
        best = int(np.argmax(sizes))
        v = left.pop(best)
        pivot = int(np.abs(v).argmax())
        v = v / v[pivot]
        left = [u - u[pivot] * v for u in left]
        done = [(u - u[pivot] * v, k) for u, k in done] + [(v, pivot)]
    return sorted(done, key=lambda one: one[1])


def _name(design: Design, k: int) -> str:
    at = int(design.active[k])
    if at >= terms.COUNT:
        return f"the {nuisance_source(design.model.unknowns.names[at - terms.COUNT])}"
    term = next(t for t in reversed(terms.UNIT) if t.at <= at)
    return term_source(term.sensor, term.name)


def _axis(design: Design, k: int) -> str:
    at = int(design.active[k])
    term = next(t for t in reversed(terms.UNIT) if t.at <= at)
    if term.size == len(AXES):
        return (PAIRS if term.name == "non_orthogonality" else AXES)[at - term.at]
    i, j = divmod(at - term.at, 3)
    return f"{AXES[i]} {'along' if term.name == 'lever_arm' else 'by'} {AXES[j]}"
