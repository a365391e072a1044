"""What a unit's errors do to turn, velocity and place: those that grow with what is felt, and
drifts of biases in time.

Constant biases alone are states of their own; here are all others, each as so many unknowns of
variance one: scale, axes that are off, g-sensitivity, higher orders by `constant_columns`, a lag of
the readings, drifts by the shapes in time that their covariance is made of.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from alignment.arrays import Array, set_owned
from alignment.constant_errors import constant_form
from alignment.cross import cross_matrix
from alignment.methods.drifting import Held, held
from alignment.navigation import Integrals, twice
from alignment.options import Priors
from alignment.skew import Axes, back_from

FINE = 0.05  # s: within so much, what is felt counts by its mean
_NODES = 128  # points in time of a drift's covariance
_KEPT = 0.99  # part of its variance that its shapes keep, or as many shapes as this:
_SHAPES = 16


@dataclass(frozen=True, slots=True, eq=False)
class Effects:
    """Of each of q errors, per standard deviation, from a start to each of k times.

    `turn` [rad], `velocity` [m/s], `place` [m] (k, 3, q), in b of the start.
    """

    turn: Array
    velocity: Array
    place: Array

    def __post_init__(self) -> None:
        k, _, q = self.turn.shape
        set_owned(
            self, **{name: (getattr(self, name), (k, 3, q), float) for name in self.__slots__}
        )

    @property
    def count(self) -> int:
        """How many errors there are."""
        return self.turn.shape[2]

    def at(self, k: np.ndarray) -> "Effects":
        """At some of the times."""
        return Effects(self.turn[k], self.velocity[k], self.place[k])

    def between(self, sensed: Integrals) -> "Effects":
        """From each time to the next, in b at the former; `sensed` (k,): what was felt till then.

        A turn that was wrong before is an error of the attitude there, and none of the stretch.
        """
        first, last = np.s_[:-1], np.s_[1:]
        back = np.swapaxes(sensed.turn[first], 1, 2)
        T = np.diff(sensed.duration)
        dv = sensed.velocity[last] - sensed.velocity[first]
        dr = sensed.place[last] - sensed.place[first] - sensed.velocity[first] * T[:, None]
        before = self.turn[first]
        velocity = self.velocity[last] - self.velocity[first] + cross_matrix(dv) @ before
        place = self.place[last] - self.place[first] - self.velocity[first] * T[:, None, None]
        return Effects(
            back @ (self.turn[last] - before),
            back @ velocity,
            back @ (place + cross_matrix(dr) @ before),
        )


@dataclass(frozen=True, slots=True, eq=False)
class Blocks:
    """Means over blocks (n,) of a record: `t` of their middles and `h` [s], `x` (n, 6) rates and
    forces in b, `middle` (n, 3, 3) takes b there to b of the start, `change` (n, 6) of x [1/s]."""

    t: Array
    h: Array
    x: Array
    middle: Array
    change: Array


def blocks_of(sensed: Integrals) -> Blocks:
    """What was felt between the times of `sensed` (k,), which are `FINE` apart at most."""
    h = np.diff(sensed.duration)
    before = Rotation.from_matrix(sensed.turn[:-1])
    turned = (before.inv() * Rotation.from_matrix(sensed.turn[1:])).as_rotvec()
    middle = (before * Rotation.from_rotvec(turned / 2)).as_matrix()
    force = np.diff(sensed.velocity, axis=0) / h[:, None]
    x = np.concatenate([turned / h[:, None], np.einsum("kji,kj->ki", middle, force)], axis=1)
    t = sensed.duration[:-1] + h / 2
    change = np.gradient(x, t, axis=0) if len(t) > 1 else np.zeros_like(x)
    return Blocks(t, h, x, middle, change=change)


def without_drifts(priors: Priors, record: Blocks, interval: float) -> tuple[Priors, Held, Held]:
    """The priors whose biases and walks hold what needs no shape of its own, and what gyros and
    accelerometers drift by besides.

    Samples `interval` [s] apart whose times tremble are noise wherever readings change.
    """
    span = float(record.h.sum())
    gyro, accel = (held(priors, s, getattr(priors, f"{s}_walk"), span) for s in ("gyro", "accel"))
    trembling = priors.jitter * np.sqrt(interval * np.mean(record.change**2, axis=0))
    simple = replace(
        priors,
        gyro_bias=gyro.bias,
        accel_bias=accel.bias,
        gyro_walk=float(np.linalg.norm([priors.gyro_walk, gyro.white, trembling[:3].max()])),
        accel_walk=float(np.linalg.norm([priors.accel_walk, accel.white, trembling[3:].max()])),
    )
    return simple, gyro, accel


def effects(record: Blocks, priors: Priors, gyro: Held, accel: Held) -> Effects:
    """Of every error that `priors` state but biases and noise, of late readings, and of drifts.

    Notes
    -----
    First order. Within a block rate and force are their means, at the middle of its turn.
    """
    h, middle, span = record.h, record.middle, float(record.h.sum())
    columns = np.concatenate(
        [
            constant_form(priors).columns(record.x),
            _late(record, priors),
            _drift_columns(gyro, priors.gyro_axes, record.t, span, first=0),
            _drift_columns(accel, priors.accel_axes, record.t, span, first=3),
        ],
        axis=2,
    )
    rate = middle @ columns[:, :3]
    turn, _ = twice(rate, h)
    at_middle = turn[:-1] + h[:, None, None] / 2 * rate
    pushed = cross_matrix(np.einsum("kij,kj->ki", middle, record.x[:, 3:]))
    return Effects(turn, *twice(middle @ columns[:, 3:] - pushed @ at_middle, h))


def _late(record: Blocks, priors: Priors) -> Array:
    """Columns (n, 6, q) of readings that come late, and later and later by a clock that is fast."""
    later = np.repeat([priors.lag, priors.lag + priors.accel_later], 3)
    both = np.stack([later * record.change, priors.clock * record.t[:, None] * record.change], 2)
    return both[:, :, [bool(later.any()), priors.clock > 0]]


def _drift_columns(drift: Held, axes: Axes | None, t: Array, span: float, first: int) -> Array:
    """Columns (k, 6, q) at times `t` (k,) of one triad's drift, whose axes begin at `first`."""
    shapes = drift_shapes(drift, t, span)
    columns = np.zeros((len(t), 6, 3 * shapes.shape[1]))
    own = shapes[:, None, :, None] * back_from(axes)[:, None, :]
    columns[:, first : first + 3] = own.reshape(len(t), 3, -1)
    return columns


def drift_shapes(drift: Held, t: Array, span: float) -> Array:
    """Shapes in time (k, j): a drift along one axis is their sum, each with a variance of one.

    The eigenvectors of its covariance, the largest first (Karhunen-Loeve), so many that they keep
    `_KEPT` of its variance, `_SHAPES` at most: the rest is faster than a tenth of the record.
    """
    if not drift.walk and not drift.states:
        return np.zeros((len(t), 0))
    nodes = (np.arange(_NODES) + 0.5) * span / _NODES
    apart = np.abs(nodes[:, None] - nodes)
    K = drift.walk**2 * np.minimum(nodes[:, None], nodes)
    for one in drift.states:
        K += one.sigma**2 * np.exp(-apart / one.time)
    variances, vectors = np.linalg.eigh(K)
    variances, vectors = variances[::-1], vectors[:, ::-1]
    kept = int(np.searchsorted(np.cumsum(variances), _KEPT * np.trace(K))) + 1
    some = slice(0, min(kept, _SHAPES))
    shapes = vectors[:, some] * np.sqrt(variances[some])
    return np.stack([np.interp(t, nodes, shape) for shape in shapes.T], axis=1)
