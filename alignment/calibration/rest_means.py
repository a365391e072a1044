"""What each rest of a hand-held calibration reads, and how sure its means are."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from alignment.arrays import Array, set_owned
from alignment.information.drift import Span, flicker, gauss_markov
from alignment.noise import mean_variance
from alignment.readings import ImuReadings
from alignment.rounding import steps_of, waves

# Sigmas of means that no unit reaches: they keep a simulated one without noise from none at all.
LEAST_RATE, LEAST_FORCE = 1e-9, 1e-6  # rad/s, m/s^2
LEAST_WALK = 1e-8  # rad/sqrt(s)
BLURRED = 0.6  # steps of noise that one mean's values tell
TREMBLING = 4.0  # times the variance that all rests have, from which a rest's own counts


@dataclass(frozen=True, slots=True, eq=False)
class RestMeans:
    """Of k rests.

    `gyro`, `accel` (k, 3) means; `gyro_variance`, `accel_variance` (k, 3) of them; `spans` (k,)
    [s]; `walk`: density of a gyro's noise [rad^2/s], of the worst axis; `rounding`: variance of
    what rounding leaves of all of a gyro's means alike [(rad/s)^2], of the worst axis.
    """

    gyro: Array
    accel: Array
    gyro_variance: Array
    accel_variance: Array
    spans: Array
    walk: float
    rounding: float = 0.0

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
    a rest's own where it is far above that (a hand trembled, a motor ran). What rounding leaves of
    a gyro's means is one error of all, for each reads its bias: so much more variance has each.
    """
    parts = [readings.between(*rest) for rest in rests]
    spans = np.array([len(part) for part in parts]) * readings.interval
    found, density, left, steps = {}, 0.0, 0.0, steps_of(readings).reshape(2, 3)
    told = (("w_ib_b", LEAST_RATE, len(parts)), ("f_b", LEAST_FORCE, 1))
    for (name, least, alike), step in zip(told, steps, strict=True):
        values = [getattr(part, name) for part in parts]
        own = np.array([mean_variance(v) for v in values])
        pooled = np.average(own * spans[:, None], axis=0, weights=spans) / spans[:, None]
        variance = np.where(own > TREMBLING * pooled, own, pooled)
        means = np.array([v.mean(axis=0) for v in values])
        shown = np.array([v.var(axis=0) for v in values])
        shown = shown if alike > 1 else np.broadcast_to(shown.mean(axis=0), shown.shape)
        rounding = alike * rounding_variances(shown, step, BLURRED if alike > 1 else 0.0)
        found[name] = means, np.maximum(variance + rounding, least**2)
        if name == "w_ib_b":
            left = float(rounding.mean(axis=0).max()) / alike
            density = float((variance * spans[:, None]).mean(axis=0).max())
            density = max(density, float(step.max()) ** 2 / 12 * readings.interval)  # on the move
    density = max(density, LEAST_WALK**2)
    gyro, accel = found["w_ib_b"], found["f_b"]
    return RestMeans(gyro[0], accel[0], gyro[1], accel[1], spans=spans, walk=density, rounding=left)


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


def rounding_variances(shown: Array, steps: Array, least: float = 0.0) -> Array:
    """Variances (n, k) that rounding to `steps` (k,) leaves in means of values that vary by `shown`
    (n, k), by the noise in it, of `least` steps or more; where in a step the truth lies is not
    known.

    What is shown holds the rounding's own variance, ``q^2/12`` on average over a step: one place
    in it shows anything up to ``q^2/4`` without telling the noise.
    """
    noise = np.maximum(shown - steps**2 / 12, 0.0)
    noise = np.where(noise > (least * steps) ** 2, noise, 0.0)
    found = np.zeros(shown.shape)
    for n, k in np.ndindex(*shown.shape):
        if steps[k]:
            found[n, k] = waves(float(steps[k]), float(np.sqrt(noise[n, k])))[1].sum()
    return found
