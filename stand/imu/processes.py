"""Random processes of a sensor: white noise, bias instability, random walk.

Every process is generated in blocks of any length: the values do not depend on where the blocks
are cut. All arrays are (3, n): one row per axis, each axis with a random stream of its own.

Slow processes (bias instability, random walk) advance on a grid of their own, some samples apart,
and are held in between: their steps are a fifth of a process's own deviation at most, and the
stationary variance is kept exactly.
"""

from collections.abc import Callable, Sequence
from math import exp

import numpy as np

from alignment.arrays import Array
from stand.imu.recursion import Recursion

PEAK = 1.8926  # tau over correlation time where one Gauss-Markov process's Allan deviation peaks
STEPS_PER_CORNER = 50  # of the slow grid within the shortest correlation time
GRID_CHUNK = 1024  # values of the slow grid made at once
DEFAULT_CORNERS = (1.0, 10.0, 100.0, 1000.0, 10000.0)  # s


def gauss_markov_avar(tau: Array, corner: float) -> Array:
    """Allan variance at `tau` [s] of a first-order Gauss-Markov process of variance one.

    ``(T/tau)^2 (2 tau/T - 3 + 4 exp(-tau/T) - exp(-2 tau/T))`` with correlation time T: the
    variance of a mean over tau less the covariance of adjacent means (IEEE Std 952, annex C).
    """
    x = np.asarray(tau, dtype=float) / corner
    u = -np.expm1(-x)
    closed = (2 * (x - u) - u**2) / x**2
    # where x is small the terms cancel down to their third order: its series has the digits
    series = x * (2 / 3 - x * (1 / 2 - x * (7 / 30 - x * (1 / 12 - x * 31 / 1260))))
    return np.where(x < 0.01, series, closed)


def plateau(corners: Sequence[float]) -> float:
    """Least Allan deviation, between its inner corners, of a sum of unit processes."""
    inner = corners[1:-1] if len(corners) > 2 else corners
    tau = PEAK * np.geomspace(inner[0], inner[-1], 200)
    total = np.sum([gauss_markov_avar(tau, corner) for corner in corners], axis=0)
    return float(np.sqrt(total.min()))


class WhiteNoise:
    """Independent normal numbers, (3, n)."""

    def __init__(self, streams: Sequence[np.random.Generator]) -> None:
        self._streams = streams

    def take(self, n: int) -> Array:
        """The next n values of each axis."""
        values = np.empty((len(self._streams), n))
        for row, stream in zip(values, self._streams, strict=True):
            stream.standard_normal(out=row)
        return values


class BiasInstability:
    """Sum of Gauss-Markov processes whose Allan deviation has a plateau of height one.

    Parameters
    ----------
    streams : three Generators
    corners : sequence of float
        Correlation times [s], increasing.
    step : float
        Time between values [s].

    Notes
    -----
    Each process starts in its stationary state, so the ensemble variance is the same from the
    first value on. Between the inner corners the plateau is flat within some per cent.
    """

    def __init__(
        self, streams: Sequence[np.random.Generator], corners: Sequence[float], step: float
    ) -> None:
        self._streams = streams
        decay = np.array([exp(-step / corner) for corner in corners])
        self._kick = np.sqrt(1 - decay**2)
        self._sigma = 1.0 / plateau(corners)
        stationary = np.stack([s.standard_normal(len(corners)) for s in streams])
        self._memories = [Recursion(*one) for one in zip(decay, stationary.T, strict=True)]

    def next(self, n: int) -> Array:
        """The next n >= 1 values of each axis."""
        draws = np.stack([s.standard_normal((n, len(self._kick))) for s in self._streams])
        total = np.zeros((3, n))
        for i, memory in enumerate(self._memories):
            total += memory.apply(self._kick[i] * draws[:, :, i])
        return self._sigma * total


class RandomWalk:
    """Sum of independent steps from zero: grows by one standard deviation per root second."""

    def __init__(self, streams: Sequence[np.random.Generator], step: float) -> None:
        self._streams, self._size = streams, np.sqrt(step)
        self._state = np.zeros((3, 1))

    def next(self, n: int) -> Array:
        """The next n >= 1 values of each axis."""
        steps = self._size * np.stack([s.standard_normal(n) for s in self._streams])
        walk = np.cumsum(np.hstack([self._state, steps]), axis=1)
        self._state = walk[:, -1:]
        return walk[:, 1:]


class Drift:
    """What changes slowly: bias instability and random walk, on a grid of their own.

    Parameters
    ----------
    streams : function of a source's name ('instability', 'random_walk') to three Generators
    instability, random_walk : float
        Heights [u], [u/rt-s]; a process of height zero is not made at all.
    corners : sequence of float
        Correlation times of the bias instability [s].
    rate_hz : float
    """

    def __init__(
        self,
        streams: Callable[[str], Sequence[np.random.Generator]],
        instability: float,
        random_walk: float,
        corners: Sequence[float],
        rate_hz: float,
    ) -> None:
        self._hold = max(1, int(rate_hz * corners[0] / STEPS_PER_CORNER))
        step = self._hold / rate_hz
        self._sources: list[tuple[float, BiasInstability | RandomWalk]] = []
        if instability:
            process = BiasInstability(streams("instability"), corners, step)
            self._sources.append((instability, process))
        if random_walk:
            self._sources.append((random_walk, RandomWalk(streams("random_walk"), step)))
        self._grid = np.empty((3, 0))  # values not yet used up; the first is in force
        self._used = 0  # samples that the first of them has covered

    def __bool__(self) -> bool:
        return bool(self._sources)

    def take(self, n: int) -> Array:
        """The next n >= 1 samples of each axis."""
        needed = -(-(self._used + n) // self._hold)
        while self._grid.shape[1] < needed:
            more = np.sum([size * p.next(GRID_CHUNK) for size, p in self._sources], axis=0)
            self._grid = np.hstack([self._grid, more])
        held = np.repeat(self._grid[:, :needed], self._hold, axis=1)
        values = held[:, self._used : self._used + n]
        over, self._used = divmod(self._used + n, self._hold)
        self._grid = self._grid[:, over:]
        return values
