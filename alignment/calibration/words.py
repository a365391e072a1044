"""What a test cannot tell of a unit, in words: term by term, and what it cannot be told from."""

import numpy as np

from alignment.arrays import Array
from alignment.calibration import terms
from alignment.calibration.design import Design, nuisance_source, term_source

UNSEEN = 0.05  # part of a prior's variance that the readings must take away to tell anything
RESCUED = 0.5  # likewise, where something else is known: that is what it cannot be told from


def untold(design: Design) -> tuple[str, ...]:
    """A sentence for every term of which the readings say next to nothing on any axis.

    Either no reading depends on it as strongly as its prior, or some other term or a nuisance does
    the same to the readings: then that is named.
    """
    groups = _groups(design)
    information = design.W.T @ design.W
    whole = information + np.eye(len(information))
    posterior = np.linalg.inv(whole).diagonal()
    found = []
    for name, own in groups.items():
        if own[0] >= len(_unit(design)) or np.max(1 - posterior[own]) >= UNSEEN:
            continue
        alone = information.diagonal()[own]
        if np.max(alone / (1 + alone)) < UNSEEN:
            found.append(f"{name}: no reading here depends on it as much as what is known already")
            continue
        rivals = [
            other
            for other, theirs in groups.items()
            if other != name and _known(whole, own, theirs) >= RESCUED
        ]
        rest = " and ".join(rivals) if rivals else "several others together"
        found.append(f"{name}: cannot be told from {rest} here")
    return tuple(found)


def _unit(design: Design) -> Array:
    """Active unknowns of the unit, which come first."""
    return design.active[design.active < terms.COUNT]


def _groups(design: Design) -> dict[str, Array]:
    """Places among the active unknowns by term, and by group of nuisances."""
    found: dict[str, list[int]] = {}
    for k, at in enumerate(design.active.tolist()):
        if at < terms.COUNT:
            term = next(t for t in reversed(terms.UNIT) if t.at <= at)
            name = term_source(term.sensor, term.name)
        else:
            name = nuisance_source(design.model.unknowns.names[at - terms.COUNT])
        found.setdefault(name, []).append(k)
    return {name: np.array(own) for name, own in found.items()}


def _known(whole: Array, own: Array, others: Array) -> float:
    """Largest part of their prior's variance that unknowns lose where `others` are known."""
    kept = np.setdiff1d(np.arange(len(whole)), others)
    posterior = np.linalg.inv(whole[np.ix_(kept, kept)]).diagonal()
    return float(np.max(1 - posterior[np.isin(kept, own)]))
