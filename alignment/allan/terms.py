"""The five terms of an Allan variance, and what each looks like.

``sigma^2(tau) = 3 Q^2/tau^2 + N^2/tau + B^2 + K^2 tau/3 + R^2 tau^2/2``

B is the height of the plateau itself, the minimum of the Allan deviation of the bias-instability
process: it is *not* divided by 0.664 = sqrt(2 ln 2 / pi), which turns that height into the
coefficient of a 1/f spectrum.

Inside, time counts in samples: the `weights` of the terms (their variances at tau = one sample, but
for the factors 3, 1/3 and 1/2) are all in the unit of the signal squared, whatever the rate is.

Source: IEEE Std 952-1997 annex C, eq. C.10-C.24 (signs and factors); D = 0.664 there is left out.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from alignment.arrays import Array


@dataclass(frozen=True, slots=True)
class Term:
    """One power law: ``factor * value^2 * tau^slope`` [unit^2], tau in s.

    `slope` is that of the variance; the deviation's is half of it.
    """

    key: str
    name: str
    factor: float
    slope: int


TERMS = (
    Term("Q", "quantisation", 3.0, -2),
    Term("N", "random walk", 1.0, -1),
    Term("B", "bias instability", 1.0, 0),
    Term("K", "rate random walk", 1 / 3, 1),
    Term("R", "ramp", 0.5, 2),
)
KEYS = tuple(term.key for term in TERMS)
FACTORS = np.array([term.factor for term in TERMS])
SLOPES = np.array([term.slope for term in TERMS])


def index(key: str) -> int:
    """The place of a term in `TERMS`; ValueError names those there are."""
    if key not in KEYS:
        raise ValueError(f"term {key!r}: must be one of {', '.join(KEYS)}")
    return KEYS.index(key)


def design(tau: Sequence[float] | Array) -> Array:
    """Variances (k, 5) of terms of value 1 at `tau` (k,), both in s or both in samples."""
    return FACTORS * np.asarray(tau, dtype=float)[:, None] ** SLOPES


def value(weight: float, term: int, interval: float) -> float:
    """A term's value in SI from its weight in samples; `interval` [s] is one sample."""
    return float(np.sqrt(max(weight, 0.0) * interval ** -float(SLOPES[term])))


def weight(value: float, term: int, interval: float) -> float:
    """The inverse of `value`."""
    return float(value**2 * interval ** float(SLOPES[term]))


def variance(values: Sequence[float] | Array, tau: Sequence[float] | Array) -> Array:
    """Allan variance (k,) of terms of the given SI values (5,) at `tau` (k,) [s]."""
    return design(tau) @ np.asarray(values, dtype=float) ** 2
