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
_TIMES = 10.0 ** np.arange(5)
_FLAT = 30.0  # onsets from which on the plateau is flat within 2 %
_LEAST = 0.5856  # its least height between 10 and 1000 peaks, per variance of one process: B^2
_USUAL = 0.5957  # its mean height there
_SMALL = 1e-3  # below, the closed form loses its digits, and its first term is as good
KEYS = tuple(term.key for term in TERMS)
FACTORS = np.array([term.factor for term in TERMS])
SLOPES = np.array([term.slope for term in TERMS])


def index(key: str) -> int:
    """The place of a term in `TERMS`; ValueError names those there are."""
    if key not in KEYS:
        raise ValueError(f"term {key!r}: must be one of {', '.join(KEYS)}")
    return KEYS.index(key)


def design(tau: Sequence[float] | Array, onset: float = 0.0) -> Array:
    """Variances (k, 5) of terms of value 1 at `tau` (k,), all in s or all in samples.

    `onset` is the shortest correlation time of the bias instability: see `plateau`.
    """
    tau = np.asarray(tau, dtype=float)
    columns = FACTORS * tau[:, None] ** SLOPES
    if onset > 0:
        columns[:, index("B")] = plateau(tau / onset)
    return columns


def plateau(x: Array) -> Array:
    """Height (k,) of the bias instability at x = tau / onset, over its least: 1.017 on the plateau.

    Flicker noise has no shortest correlation time and its plateau no beginning; a sum of
    Gauss-Markov processes has both. Here: correlation times of 1, 10, 100, ... onsets, of equal
    variance, each of Allan variance ``(2/y) (1 - (3 - 4 exp(-y) + exp(-2y)) / (2y))`` at
    y = tau/T (IEEE Std 952 eq. C.22).
    """
    y = np.minimum(x, _FLAT)[:, None] / _TIMES
    exact = 2 / y * (1 + (4 * np.expm1(-y) - np.expm1(-2 * y)) / (2 * y))
    total = np.where(y < _SMALL, 2 * y / 3, exact).sum(axis=1)
    return np.where(x >= _FLAT, _USUAL, total) / _LEAST


def value(weight: float, term: int, interval: float) -> float:
    """A term's value in SI from its weight in samples; `interval` [s] is one sample."""
    return float(np.sqrt(max(weight, 0.0) * interval ** -float(SLOPES[term])))


def weight(value: float, term: int, interval: float) -> float:
    """The inverse of `value`."""
    return float(value**2 * interval ** float(SLOPES[term]))


def variance(
    values: Sequence[float] | Array, tau: Sequence[float] | Array, onset: float = 0.0
) -> Array:
    """Allan variance (k,) of terms of the given SI values (5,) at `tau` (k,), `onset` [s]."""
    return design(tau, onset) @ np.asarray(values, dtype=float) ** 2
