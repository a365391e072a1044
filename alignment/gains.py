"""How a method's answer follows its readings, to first order: what a prediction of sigma needs.

A method for rests or steady turns gives an `Answer` per estimate: a matrix from errors of the mean
readings of its stretches to the small rotation about n that takes truth to estimate. A method for
bases that rock gives a `Functional` per stretch: the same from errors of each moment. Neither
knows the instrument; whoever states its errors multiplies them in.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import sqrt
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.special import ndtr

from alignment.arrays import Array, owned, set_owned
from alignment.earth import Site
from alignment.information import Stretch
from alignment.levelling import attitude_sensitivity
from alignment.options import Options
from alignment.strapdown import Carried, changes_in_b

_FEWEST_STEPS = 3.0  # of increments in a record that shows fewer


class Mirror(NamedTuple):
    """Another attitude that readings may be taken for.

    `chi2`: by how much readings as they should be are against it. What the true one is off it:
    `turn` (3,), tilts about north and east and turn about down [rad], and `biases` by label.
    """

    chi2: float
    turn: Array
    biases: Mapping[str, float]

    @property
    def odds(self) -> float:
        """In how many cases it is taken for the true one, ``Q(sqrt(chi2)/2)``."""
        return float(ndtr(-sqrt(self.chi2) / 2))


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Answer:
    """One estimate that a method will give, and how it follows its readings.

    Attributes
    ----------
    label, window : str
        As the estimate's.
    stretches : tuple of Stretch
        Whose coefficients it uses: whole ones, or parts of them.
    planned : tuple of int
        Which of the planned stretches each of them belongs to.
    own : int
        Which of `stretches` holds the attitude that is told.
    gain : (3, m)
        From errors of the coefficients to the rotation about n: per stretch and coefficient
        (constant; of a turning one cosine and sine of the encoder angle too) rates and forces.
    biases : mapping
        Gain (m,) of each bias that is told, by the label of its parameter in `Information`.
    circle : (2, 2) or None
        Information of the horizontal Earth rate (`alignment.information.circle`), of a method that
        finds where on its circle it lies: what first order leaves out of heading.
    window_gain : (3, m) or None
        To the attitude that the offset's window would tell by itself, of a method that checks its
        vertical.
    unseen : mapping
        Angles that nothing tells the method, with what its readings cannot tell them from.
    mirrors : tuple of Mirror
        Other attitudes that a method which searches for the likeliest one may take for the true.
    """

    label: str
    stretches: tuple[Stretch, ...]
    planned: tuple[int, ...]
    gain: Array
    own: int = 0
    window: str = ""
    biases: Mapping[str, Array] = field(default_factory=dict)
    circle: Array | None = None
    window_gain: Array | None = None
    unseen: Mapping[str, str] = field(default_factory=dict)
    mirrors: tuple[Mirror, ...] = ()

    def __post_init__(self) -> None:
        set_owned(self, gain=(self.gain, (3, None), float))
        m = self.gain.shape[1]
        biases = {label: owned(row, label, (m,)) for label, row in self.biases.items()}
        object.__setattr__(self, "biases", MappingProxyType(biases))
        object.__setattr__(self, "unseen", MappingProxyType(dict(self.unseen)))
        if self.circle is not None:
            set_owned(self, circle=(self.circle, (2, 2), float))
        if self.window_gain is not None:
            set_owned(self, window_gain=(self.window_gain, (3, m), float))


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Functional:
    """Rotation about n at the end of a stretch, by errors of m blocks of readings.

    Attributes
    ----------
    t : (m + 1,) s
    gyro, accel : (m, 3, 3)
        Per mean error of rate, force [rad/s], [m/s^2] in b over the block.
    rate, force : (m, 3)
        True means over the blocks.
    motion : (3, 3) rad^2
        What the sway itself leaves.
    C_nb : Rotation
        At the end.
    changes : (m, 6) or None
        How fast rates and forces in b change in each block; None: not told.
    direction : Functional or None
        The same, and a fourth component: by how much the horizontal Earth rate is found larger, in
        parts of it, where heading is its direction: what first order leaves out of both.
    lever : (2,) or None
        Tilts N, E per radian by which heading is off, of a method whose tilt turns on by the
        Earth's level rate in the direction that is found; None: as heading has it.
    checked_by : Functional or None
        The match of velocity curves by which the method checks that the instrument does not
        travel; None: itself.
    """

    t: Array
    gyro: Array
    accel: Array
    rate: Array
    force: Array
    motion: Array
    C_nb: Rotation
    checked_by: "Functional | None" = None
    changes: Array | None = None
    direction: "Functional | None" = None
    circle: Array | None = None
    lever: Array | None = None

    def __post_init__(self) -> None:
        m = len(self.t) - 1
        set_owned(
            self,
            t=(self.t, (m + 1,), float),
            gyro=(self.gyro, (m, None, 3), float),
            accel=(self.accel, (m, None, 3), float),
            rate=(self.rate, (m, 3), float),
            force=(self.force, (m, 3), float),
            motion=(self.motion, (None, None), float),
        )
        if self.changes is not None:
            set_owned(self, changes=(self.changes, (m, 6), float))
        if self.circle is not None:
            set_owned(self, circle=(self.circle, (2, 2), float))
        if self.lever is not None:
            set_owned(self, lever=(self.lever, (2,), float))

    @property
    def changing(self) -> Array:
        """The same (m, 6), nothing where it is not told."""
        return np.zeros((len(self.t) - 1, 6)) if self.changes is None else self.changes

    @property
    def middle(self) -> Array:
        """Of each block (m,) [s]."""
        return np.asarray((self.t[1:] + self.t[:-1]) / 2)

    def answer(self, errors: Array) -> Array:
        """Rotation about n (3,) by mean errors (m, 6) of rates and forces in the blocks."""
        rates, forces = errors[:, :3], errors[:, 3:]
        by_rates = np.einsum("mij,mj->i", self.gyro, rates)
        return np.asarray(by_rates + np.einsum("mij,mj->i", self.accel, forces))


Gains = Callable[[Sequence[Stretch], Site, Options], list[Answer]]


def functional(
    carried: Carried,
    C_ni: Rotation,
    gyro: Array,
    accel: Array,
    motion: Array,
    checked_by: Functional | None = None,
) -> Functional:
    """A functional of the blocks of `carried`, of the attitude at their end."""
    spans = carried.spans[:, None]
    return Functional(
        t=carried.t,
        gyro=gyro,
        accel=accel,
        rate=carried.dtheta / spans,
        force=carried.dv / spans,
        motion=motion,
        C_nb=C_ni * Rotation.from_quat(carried.q[-1]),
        checked_by=checked_by,
        changes=changes_in_b(carried),
    )


def by_increments(gain: Array, spans: Array, moved: Array, ends: Array) -> Array:
    """Covariance (k, k) of functionals by what rounded increments leave of angle or velocity.

    Parameters
    ----------
    gain : (m, k, 3)
        Per mean rate or force over blocks of `spans` (m,) [s].
    moved : (m, 3)
        Sums of increments over the blocks.
    ends : (3,)
        Variances of what is left at any time, ``q^2/12``.

    Notes
    -----
    What is left stays about as long as the next step takes to come, by how far all moved: edges of
    blocks that are nearer have it together. Where hardly a step comes, it may come anywhere.
    """
    none = np.zeros((1, *gain.shape[1:]))
    edges = -np.diff(gain / spans[:, None, None], axis=0, prepend=none, append=none)
    t = np.concatenate([[0.0], np.cumsum(spans)])
    steps = np.abs(moved).sum(axis=0) / np.sqrt(12 * ends) if ends.all() else np.zeros(3)
    covariance = np.zeros((gain.shape[1],) * 2)
    for axis in range(3):
        kept = t[-1] / max(steps[axis], _FEWEST_STEPS)
        _, first = np.unique(np.floor(t / kept), return_index=True)
        together = np.add.reduceat(edges[:, :, axis], first, axis=0)
        covariance += ends[axis] * together.T @ together
    return covariance


def compass_gain(site: Site) -> Array:
    """Gain (3, 6) of levelling and of east by the horizontal rate, from errors of means in n.

    Raises
    ------
    PoleError
        No horizontal rate.
    """
    site.horizontal_rate()
    w = site.w_ie_n
    return attitude_sensitivity(w[0], -w[2], site.gravity)


def from_b(G: Array, C_nb: Rotation) -> Array:
    """The same gain (3, 6) from errors of means in b."""
    R = C_nb.as_matrix()
    return np.concatenate([G[:, :3] @ R, G[:, 3:] @ R], axis=1)


def each_alone(stretches: Sequence[Stretch], gain: Callable[[Rotation], Array]) -> list[Answer]:
    """Answers of a method that takes each rest by itself, by its `gain` (3, 6) at an attitude."""
    return [
        Answer(label=s.label, stretches=(s,), planned=(k,), gain=gain(s.C_pb))
        for k, s in enumerate(stretches)
    ]


def after_offset(
    stretches: Sequence[Stretch],
    site: Site,
    options: Options,
    gain: Callable[[Stretch], Array],
    window: str = "",
) -> list[Answer]:
    """Answers from what follows the offset's window less the mean of that window.

    `gain` (3, 6) from errors of the later part; what is constant cancels. Dwells that end with
    their window have none.
    """
    G = compass_gain(site)
    found = []
    for k, s in enumerate(stretches):
        left = s.duration - options.offset_window
        if left <= 0:
            continue
        first = replace(s, duration=options.offset_window)
        later = replace(s, start=s.start + options.offset_window, duration=left)
        by_later = gain(later)
        alone = from_b(G, s.C_pb)
        found.append(
            Answer(
                label=s.label,
                stretches=(first, later),
                planned=(k, k),
                own=1,
                gain=np.concatenate([-by_later, by_later], axis=1),
                window=window,
                window_gain=np.concatenate([alone, np.zeros((3, 6))], axis=1),
            )
        )
    return found
