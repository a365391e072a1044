"""Whether one part of a record at rest lies apart from all others: a unit that settles after it is
switched on, a door that slams, a cable that is touched.

Such a part is no noise, and no steady drift; the mean holds its share of it.
"""

from typing import NamedTuple

import numpy as np

from alignment.arrays import Array

PARTS = 16
_CHANCE = 1.64 / 3  # that three axes of white noise, flicker or random walk come to once in 1000
_NONE = 1e-24  # (rad/s)^2, (m/s^2)^2: rounding of double precision


class Apart(NamedTuple):
    """From when to when [s] readings lie apart from the others, and by how much (6,)."""

    t_from: float
    t_to: float
    off: Array

    def of(self, gyro: float, accel: float) -> "Apart":
        """The same of a part of gyros' and of accelerometers'."""
        return self._replace(off=self.off * np.repeat([gyro, accel], 3))

    def share(self, t_from: float, t_to: float) -> float:
        """The part of a stretch that it takes."""
        common = min(t_to, self.t_to) - max(t_from, self.t_from)
        return max(common, 0.0) / (t_to - t_from)


def apart(means: Array) -> tuple[int, Array]:
    """Which of successive means (m, k) of one triad lies apart, and by how much (k,); else zeros.

    Notes
    -----
    With x off the mean of the others and s^2 the sum of their squares about it, the likelihood
    ratio of normal values: the mean over axes of ``log(1 + (m-1)/m x^2/s^2)``, the largest of m.
    """
    m = len(means)
    about = means - means.mean(axis=0)
    off = about * m / (m - 1)
    own = (m - 1) / m * off**2
    left = np.maximum(np.sum(about**2, axis=0) - own, 0.0) + _NONE  # 0 but for rounding
    told = np.mean(np.log1p(own / left), axis=1)
    k = int(np.argmax(told))
    return k, off[k] if told[k] > _CHANCE else np.zeros_like(off[k])
