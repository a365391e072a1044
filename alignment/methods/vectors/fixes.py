"""What satellites say of a vehicle, the choices of the methods, and the shape of their answer."""

from dataclasses import dataclass, field
from itertools import pairwise
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from scipy.spatial.transform import Rotation

from alignment.angles import SequenceRule
from alignment.arrays import Array, IntArray, set_owned
from alignment.errors import AlignmentError, PoleError, TooShort
from alignment.estimate import AttitudeEstimate
from alignment.methods.vectors.effects import FINE, Effects, blocks_of, effects, without_drifts
from alignment.navigation import W_IE_X, C_ie, Integrals, geodetic, integrals
from alignment.options import Priors
from alignment.readings import EDGE, BoolArray, Fixes, ImuReadings
from alignment.rounding import with_rounding
from alignment.units import DEG


@dataclass(frozen=True, slots=True)
class VectorOptions:
    """Choices of the three solutions.

    Attributes
    ----------
    priors : Priors
        What the unit's sheet states of it (0: left out); nothing is taken from the readings.
    attitude_sigma : float
        Of the programmed start attitude, each axis [rad].
    largest_sigma : float
        A solution less sure than this about any axis is refused [rad].
    correct_at : float
        The solution as printed corrects where an invariant differs by this many sigma of its
        noise; 0: at every fix.
    step : float
        Longest time between points of the answer [s].
    rule : SequenceRule
        By which its angles are read.
    """

    priors: Priors = field(default_factory=Priors)
    attitude_sigma: float = 0.5 * DEG
    largest_sigma: float = 3.0 * DEG
    correct_at: float = 3.0
    step: float = 0.5
    rule: SequenceRule = SequenceRule.REGULAR


@dataclass(frozen=True, slots=True, eq=False)
class Matching:
    """One solution over time: attitude and place at each point, by the fixes up to then.

    Attributes
    ----------
    method : str
    t : (k,) s
    fixes : (k,) int
        How many fixes had come.
    at_fix : (k,) bool
        Whether one came at this point.
    corrected : (k,) bool
        Whether it corrected the attitude.
    C_nb : k rotations
        With no correction yet: the programmed attitude, carried by the gyros.
    covariance : (k, 3, 3)
        About n [rad^2].
    position : (k, 3) m
        In e.
    differences : (k, 3)
        dJ1 = ``|v|`` [m/s], dJ2 = ``|dr|`` [m], dJ3 = ``|dr x v|`` [m^2/s]: satellite minus
        inertial, before any correction; 0 where no fix came or a solution does not form them.
    doubts : tuple of str, one per point
        Why a fix did not correct, or what a reader must know; '' for nothing.
    rule : SequenceRule
    """

    method: str
    t: Array
    fixes: IntArray
    at_fix: BoolArray
    corrected: BoolArray
    C_nb: Rotation
    covariance: Array
    position: Array
    differences: Array
    doubts: tuple[str, ...]
    rule: SequenceRule

    def __post_init__(self) -> None:
        k = len(self.t)
        set_owned(
            self,
            t=(self.t, (k,), float),
            fixes=(self.fixes, (k,), np.int64),
            at_fix=(self.at_fix, (k,), bool),
            corrected=(self.corrected, (k,), bool),
            covariance=(self.covariance, (k, 3, 3), float),
            position=(self.position, (k, 3), float),
            differences=(self.differences, (k, 3), float),
        )

    def estimates(self) -> list[AttitudeEstimate]:
        """An estimate per fix from the second on: attitude at that fix; none where refused."""
        return [self._estimate(int(k)) for k in np.flatnonzero(self.at_fix)[1:]]

    def _estimate(self, k: int) -> AttitudeEstimate:
        C_nb, given = self.C_nb[k], bool(self.corrected[k])
        return AttitudeEstimate(
            self.method,
            f"{self.fixes[k]} fixes",
            float(self.t[0]),
            float(self.t[k]),
            C_nb=C_nb if given else None,
            sequence=self.rule.sequence_at(C_nb),
            covariance=self.covariance[k] if given else None,
            flags=(self.doubts[k],) if self.doubts[k] else (),
        )


@dataclass(frozen=True, slots=True, eq=False)
class Record:
    """Readings and fixes brought together on common points in time.

    `t` (k,) holds every fix and points between, `step` apart at most; `at_fix` (k,) tells which.
    `sensed`: strapdown integrals from the first fix to each; `effects`: what the unit's errors but
    biases add to them; `r_i`, `v_i` (m, 3): the fixes in i, which coincides with e at the first
    fix; `C_ib` (3, 3): the programmed start in i; `priors`: of biases and walks, as this record
    holds them, and of what is not in `effects`.
    """

    t: Array
    at_fix: BoolArray
    sensed: Integrals
    effects: Effects
    r_i: Array
    v_i: Array
    C_ib: Array
    priors: Priors


class _Felt(NamedTuple):
    """The points of a record, and what was felt till each of them: as in `Record`."""

    t: Array
    at_fix: BoolArray
    sensed: Integrals
    effects: Effects
    priors: Priors


_LAST: WeakKeyDictionary[ImuReadings, tuple[Fixes, Priors, float, _Felt]] = WeakKeyDictionary()


def joined(
    readings: ImuReadings, fixes: Fixes, C_nb0: Rotation, C_en0: Array, options: VectorOptions
) -> Record:
    """Bring readings and fixes together; `C_nb0` is the programmed attitude at the first fix.

    What was felt is worked out once for all solutions that have the same fixes and options.
    """
    *of, felt = _LAST.get(readings, (None, None, None, None))
    if felt is None or of != [fixes, options.priors, options.step]:
        felt = _felt(readings, fixes, options)
        _LAST[readings] = fixes, options.priors, options.step, felt
    r_i, v_i = inertial_fixes(fixes)
    return Record(
        felt.t,
        felt.at_fix,
        felt.sensed,
        felt.effects,
        r_i=r_i,
        v_i=v_i,
        C_ib=C_en0 @ C_nb0.as_matrix(),
        priors=felt.priors,
    )


def _felt(readings: ImuReadings, fixes: Fixes, options: VectorOptions) -> _Felt:
    t, at_fix = _points(fixes.t, options.step)
    often, shown = _points(t, FINE)
    sensed = integrals(readings, often)
    blocks = blocks_of(sensed)
    known = with_rounding(options.priors, readings)
    priors, gyro, accel = without_drifts(known, blocks, readings.interval)
    found = effects(blocks, priors, gyro, accel)
    return _Felt(
        t=t, at_fix=at_fix, sensed=sensed.at(shown), effects=found.at(shown), priors=priors
    )


def check(fixes: Fixes) -> None:
    """Two fixes at least, and not at a pole."""
    if len(fixes) < 2:
        raise TooShort(f"{len(fixes)} fixes: at least 2 are needed")
    latitude, _, height = geodetic(fixes.position)
    if np.abs(height).max() > 1e5:
        raise AlignmentError(
            f"fixes lie {np.abs(height).max():.3g} m off the ellipsoid: not ECEF metres?"
        )
    if np.cos(latitude).min() < 1e-3:
        raise PoleError("fixes within 0.06 deg of a pole: heading is undefined")


def _points(fixes: Array, step: float) -> tuple[Array, BoolArray]:
    """Every fix, and evenly spaced points between neighbours that are further than `step`."""
    t, at_fix = [fixes[:1]], [np.array([True])]
    for a, b in pairwise(fixes):
        pieces = max(1, int(np.ceil((b - a) / step - EDGE)))
        t.append(np.linspace(a, b, pieces + 1)[1:])
        at_fix.append(np.arange(1, pieces + 1) == pieces)
    return np.concatenate(t), np.concatenate(at_fix)


def turned(C: Array, x: Array) -> Array:
    return np.einsum("...ij,...j->...i", C, x)


def inertial_fixes(fixes: Fixes) -> tuple[Array, Array]:
    """Places and velocities (m, 3) of fixes in i, which coincides with e at the first of them."""
    turn = C_ie(fixes.t - fixes.t[0])
    v = fixes.velocity + fixes.position @ W_IE_X.T
    return turned(turn, fixes.position), turned(turn, v)
