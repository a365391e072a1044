"""What is left of the rounding of samples in the mean of many, by where in a step they lie."""

from dataclasses import dataclass
from math import sqrt

import numpy as np
from scipy.special import ndtr

from alignment.arrays import Array, set_owned
from alignment.rounding import waves
from stand.imu import ImuSpec
from stand.imu.grains import grains_of
from stand.samples import Sampling

_NOTHING = 1e-15  # of a step squared: waves below it are none
_ANYWHERE = 0.6  # steps that a place is known to, from which it may be any: the slope is 1 +- 0.002
_BLURRED = 2.0  # steps of noise that leave nothing: exp(-79)
_ORDERS = 100  # of Hermite functions: those beyond hold a tenth of a bare edge's variance at most
_REACH = 8.0  # standard deviations within which edges of steps count
_SHARPEST = 1e-9  # steps: less noise is none


@dataclass(frozen=True, slots=True, eq=False)
class Left:
    """Of readings at k places: what a mean over many samples makes of them.

    ``reading = place + slope (truth - place) + left + fresh``: `slope` (k,), mean products
    `moments` (k, k) of what is left, the variance `fresh` (k,) of what each sample has anew, white
    noise times `slope` apart. All three go together with nothing of the truth.
    """

    slope: Array
    moments: Array
    fresh: Array

    def __post_init__(self) -> None:
        k = len(self.slope)
        set_owned(
            self,
            slope=(self.slope, (k,), float),
            moments=(self.moments, (k, k), float),
            fresh=(self.fresh, (k,), float),
        )


@dataclass(frozen=True, slots=True)
class Rounding:
    """Samples rounded to a `step`, by what noise of `dither` (standard deviation) leaves of it;
    or sums of samples rounded to an `increment`, remainders carried on.

    Notes
    -----
    Rounding of x takes away ``sum_n (-1)^n q/(pi n) sin(2 pi n x / q)``. The mean over normal noise
    of sigma multiplies each wave by ``exp(-2 (pi n sigma / q)^2)``: what is left depends on where
    in a step x lies, and no time averages it out. All else is noise anew in each sample, the rest
    of ``q^2/12``. Where nobody knows in which part of a step x lies, as with a bias of many steps,
    two readings that are apart by d share ``cos(2 pi n d / q)`` of each wave, and as d is known to
    s only, that times ``exp(-2 (pi n s / q)^2)``. Source: B. Widrow and I. Kollar, Quantization
    Noise (2008), ch. 9.

    Where it is known to a part of a step, what is left goes together with the truth itself: a
    reading that stays on its step hides all that moves the truth. Of normal x the rounded value is
    ``sum_n c_n He_n``, the Hermite polynomials of its deviation, with
    ``c_n = q sum_k phi(t_k) He_(n-1)(t_k) / n!`` over the edges t of the steps; two values of
    correlation r share ``r^n n! c_n^2`` of each (Mehler). The first is the slope (Bussgang, 1952).
    """

    step: float
    dither: float
    increment: float = 0.0

    def _waves(self) -> tuple[Array, Array]:
        """Wave numbers (n,) per unit of a reading, and mean squares of each wave that is left."""
        return waves(self.step, self.dither)

    @property
    def noise(self) -> float:
        """Standard deviation of what is anew in each sample, at any place."""
        if not self.step:
            return 0.0
        return float(np.sqrt(max(self.step**2 / 12 - self._waves()[1].sum(), 0.0)))

    @property
    def end(self) -> float:
        """Standard deviation of a sum at any time by what its rounding carries on."""
        return self.increment / sqrt(12)

    @property
    def steepness(self) -> float:
        """Root mean square of the scale factor error that is left for less than a step."""
        if not self.step:
            return 0.0
        turns, squares = self._waves()
        return float(np.sqrt(np.sum(squares * turns**2)))

    def shared(self, apart: Array, doubt: Array) -> Array:
        """Covariance (...) of what is left in two readings that are `apart`, known to `doubt`."""
        result = np.zeros_like(apart)
        if self.step:
            for turn, square in zip(*self._waves(), strict=True):
                if square < _NOTHING * self.step**2:
                    break
                result += square * np.cos(turn * apart) * np.exp(-((turn * doubt) ** 2) / 2)
        return result

    def left(self, x: Array, known: Array) -> Left:
        """Of readings planned at `x` (k,) that will be normal about it, of covariance `known`."""
        slope, fresh = np.ones(len(x)), np.full(len(x), self.noise**2)
        moments = np.zeros_like(known)
        if self.step and self.dither < _BLURRED * self.step:
            size = known.diagonal()
            here = np.flatnonzero(size < (_ANYWHERE * self.step) ** 2)
            block = np.ix_(here, here)
            slope[here], moments[block], fresh[here] = self._at(x[here], known[block])
            there = np.flatnonzero(size >= (_ANYWHERE * self.step) ** 2)
            block, spread = np.ix_(there, there), size[there]
            apart = np.maximum(spread[:, None] + spread - 2 * known[block], 0.0)
            moments[block] = self.shared(x[there][:, None] - x[there], np.sqrt(apart))
        return Left(slope, moments, fresh)

    def _at(self, x: Array, known: Array) -> tuple[Array, Array, Array]:
        """Slopes (k,), moments (k, k) and what is anew (k,) where the place in a step counts."""
        if not len(x):
            return np.ones(0), np.zeros((0, 0)), np.zeros(0)
        size = known.diagonal()
        sigma = np.sqrt(np.maximum(size + self.dither**2, (_SHARPEST * self.step) ** 2))
        lowest = np.floor((x - _REACH * sigma) / self.step)
        steps = np.arange(int(np.ceil(2 * _REACH * sigma.max() / self.step)) + 2)
        t = ((lowest[:, None] + steps + 0.5) * self.step - x[:, None]) / sigma[:, None]
        above = ndtr(-t)
        off = (lowest + above.sum(axis=1)) * self.step - x
        spread = (above @ (2 * steps + 1) - above.sum(axis=1) ** 2) * self.step**2
        orders = self._orders(t)
        slope = orders[0] / sigma
        part = known / np.outer(sigma, sigma)
        powers = part[None] ** np.arange(1, len(orders) + 1)[:, None, None]
        shared = np.einsum("nij,ni,nj->nij", powers, orders, orders)
        fresh = spread - shared.sum(axis=0).diagonal() - (slope * self.dither) ** 2
        return slope, np.outer(off, off) + shared[1:].sum(axis=0), np.maximum(fresh, 0.0)

    def _orders(self, t: Array) -> Array:
        """Root mean squares (n, k), signed, of the orders of values with edges at `t` (k, e)."""
        before, now = np.zeros_like(t), np.exp(-(t**2) / 2) / np.sqrt(2 * np.pi)
        found = []
        for n in range(1, _ORDERS + 1):
            found.append(self.step * now.sum(axis=1) / sqrt(n))
            before, now = now, (t * now - sqrt(n - 1) * before) / sqrt(n)
        return np.array(found)


def roundings_of(
    imu: ImuSpec, rate_hz: int, sampling: Sampling = Sampling.MEAN
) -> tuple[Rounding, Rounding]:
    """Of gyros and of accelerometers; increments carry their remainders on."""
    gyro, accel = (
        Rounding(one.step, one.noise, one.increment) for one in grains_of(imu, rate_hz, sampling)
    )
    return gyro, accel
