"""What each rest of a hand-held calibration reads, and how sure its means are."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from alignment.arrays import Array, set_owned
from alignment.information.drift import Span, flicker, gauss_markov
from alignment.noise import mean_variance
from alignment.readings import ImuReadings
from alignment.sampling import step_of

# Sigmas of means that no unit reaches: they keep a simulated one without noise from none at all.
LEAST_RATE, LEAST_FORCE = 1e-9, 1e-6  # rad/s, m/s^2
LEAST_WALK = 1e-8  # rad/sqrt(s)
TREMBLING = 4.0  # times the variance that all rests have, from which a rest's own counts


@dataclass(frozen=True, slots=True, eq=False)
class RestMeans:
    """Of k rests.

    `gyro`, `accel` (k, 3) means; `gyro_variance`, `accel_variance` (k, 3) of them; `spans` (k,)
    [s]; `walk`: density of a gyro's noise [rad^2/s], of the worst axis.
    """

    gyro: Array
    accel: Array
    gyro_variance: Array
    accel_variance: Array
    spans: Array
    walk: float

    def __post_init__(self) -> None:
        k = len(self.spans)
        names = ("gyro", "accel", "gyro_variance", "accel_variance")
        set_owned(
            self, **{name: (getattr(self, name), (k, 3), float) for name in names},
            spans=(self.spans, (k,), float),
        )  # fmt: skip


def rest_means(readings: ImuReadings, rests: Sequence[tuple[float, float]]) -> RestMeans:
    """Means of rests (from, to) [s], each with its own variance.

    A few seconds tell the density of their noise badly: what all rests show together counts, and
    a rest's own where it is far above that (a hand trembled, a motor ran).
    """
    parts = [readings.between(*rest) for rest in rests]
    spans = np.array([len(part) for part in parts]) * readings.interval
    found = {}
    for name, least in (("w_ib_b", LEAST_RATE), ("f_b", LEAST_FORCE)):
        values = [getattr(part, name) for part in parts]
        own = np.array([mean_variance(v) for v in values])
        pooled = np.average(own * spans[:, None], axis=0, weights=spans) / spans[:, None]
        variance = np.where(own > TREMBLING * pooled, own, pooled)
        means = np.array([v.mean(axis=0) for v in values])
        rounding = np.array([rounding_variance(v) for v in values])
        found[name] = means, np.maximum(variance + rounding, least**2)
    density = float((found["w_ib_b"][1] * spans[:, None]).mean(axis=0).max())
    density = max(density, LEAST_WALK**2)
    gyro, accel = found["w_ib_b"], found["f_b"]
    return RestMeans(gyro[0], accel[0], gyro[1], accel[1], spans=spans, walk=density)


def drift_variances(rests: Sequence[tuple[float, float]], plateau: float) -> tuple[float, float]:
    """What a bias instability of this plateau does to means over rests: alike to all, and apart.

    The first is that of their common mean, which no rest can tell from the bias at turn-on.
    """
    if not plateau:
        return 0.0, 0.0
    spans = [Span(a, b - a) for a, b in rests]
    both = sum(one.sigma**2 * gauss_markov(spans, one.time) for one in flicker(plateau))
    whole = np.asarray(both)
    common = float(whole.mean())
    return common, float(whole.diagonal().mean()) - common


def rounding_variance(values: Array) -> Array:
    """Variance (k,) that rounding leaves in means of values (n, k), by the noise on them.

    A mean is off by up to ``(q/pi) exp(-2 pi^2 sigma^2/q^2)``, q the step: B. Widrow and I. Kollar,
    Quantization Noise (2008), ch. 9; which part of a step the truth lies in is not known.
    """
    found = np.zeros(values.shape[1])
    for k in range(values.shape[1]):
        step = step_of(values[:, k])
        if step > 0:
            # what is seen holds the rounding's own variance, q^2/12
            noise = max(float(values[:, k].var()) - step**2 / 12, 0.0)
            found[k] = (step / np.pi * np.exp(-2 * np.pi**2 * noise / step**2)) ** 2 / 2
    return found
