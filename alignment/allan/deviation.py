"""The overlapping Allan variance of a record, at octaves of averaging time."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from alignment.allan.covariance import octaves, shares, stride
from alignment.allan.running import Grid, pieces, running_sum, second_differences, windows
from alignment.arrays import Array, set_owned
from alignment.errors import TooShort

FEWEST = 96  # samples: four octaves, 1 to 8 samples, with 12 averages at the longest
CANCELLED = 1e-12  # of the largest variance: less is a pattern that repeats
SILENT = 1e-13  # of the signal's size: a scatter this small is rounding


@dataclass(frozen=True, slots=True, eq=False)
class Deviation:
    """Allan variances of one channel.

    Attributes
    ----------
    lengths : tuple of int
        Samples of each stretch of the record.
    interval : float
        Of one sample [s].
    m : (k,) int64
        Averaging times in samples: powers of two, up to an eighth of the longest stretch.
    variance : (k,)
        Overlapping Allan variance [unit^2], over all stretches that are long enough for a tau;
        all zero where the signal is constant.
    """

    lengths: tuple[int, ...]
    interval: float
    m: np.ndarray
    variance: Array

    def __post_init__(self) -> None:
        k = len(self.m)
        set_owned(self, m=(self.m, (k,), np.int64), variance=(self.variance, (k,), float))

    @property
    def tau(self) -> Array:
        """Averaging times [s]."""
        return self.m * self.interval

    @property
    def silent(self) -> bool:
        """Whether there is nothing to see: a signal that is constant but for rounding."""
        return not self.variance.any()


def deviation(signal: Array | Sequence[Array], interval: float) -> Deviation:
    """Overlapping Allan variance of a signal, or of several stretches of one.

    Parameters
    ----------
    signal : (n,), or a sequence of such
        Equidistant samples, each the mean over its interval [any unit].
    interval : float
        [s].

    Raises
    ------
    TooShort
        Fewer than `FEWEST` samples in every stretch; shorter ones beside a longer are left out.

    Notes
    -----
    ``v(m) = <(x_{k+2m} - 2 x_{k+m} + x_k)^2> / (2 m^2)``, x the running sum (NIST SP 1065 eq.
    11). An averaging time of more than 32 samples starts at every m/32nd sample only, which costs
    less than 1 % of its certainty (white x excepted, see `covariance`). Stretches are pooled by
    the number of their squares; what lies between them is in none.
    """
    every = [signal] if isinstance(signal, np.ndarray) else list(signal)
    longest = max(map(len, every), default=0)
    if longest < FEWEST:
        raise TooShort(
            f"{longest} samples ({longest * interval:.3g} s): an Allan variance needs at least "
            f"{FEWEST} ({FEWEST * interval:.3g} s)"
        )
    parts = [part for part in every if len(part) >= FEWEST]
    lengths = tuple(map(len, parts))
    m = octaves(longest)
    found = np.zeros(len(m))
    for part, share in zip(parts, shares(lengths, tuple(map(int, m))), strict=True):
        own = octaves(len(part))
        found[: len(own)] += share[: len(own)] * _variances(part, own)
    # A pattern can cancel at one tau; a logarithm of it is needed all the same.
    return Deviation(lengths, interval, m, np.maximum(found, CANCELLED * found.max()))


def _variances(signal: Array, m: np.ndarray) -> Array:
    """Of one stretch; all zero where it is constant but for rounding."""
    first, total = float(signal[0]), 0.0
    low = high = first
    for piece in pieces(signal):
        low, high = min(low, float(piece.min())), max(high, float(piece.max()))
        total += float((piece - first).sum())
    if max(high - first, first - low) <= SILENT * max(high, -low):
        return np.zeros(len(m))
    return variances(running_sum(signal, first, total / len(signal)), m)


def variances(phase: Iterable[Array], m: np.ndarray) -> Array:
    """Overlapping Allan variances (k,) at m (k,) samples of a running sum, told in pieces."""
    steps = [stride(k) for k in m.tolist()]
    lags = [k // step for k, step in zip(m.tolist(), steps, strict=True)]
    longest: dict[int, int] = {}
    for step, lag in zip(steps, lags, strict=True):
        longest[step] = max(lag, longest.get(step, 0))
    rows = [[row for row, own in enumerate(steps) if own == step] for step in longest]
    grids = [Grid(*one) for one in longest.items()]
    squares, counts = np.zeros(len(m)), np.zeros(len(m), np.int64)
    for grid, window, held in windows(phase, grids):
        for row in rows[grid]:
            for some in second_differences(window, held, lags[row]):
                squares[row] += np.einsum("i,i", some, some)
                counts[row] += len(some)
    return squares / counts / (2.0 * (np.array(lags) * steps) ** 2)
