"""What an IMU said, and while it stood where: the input of every estimator."""

from dataclasses import dataclass, replace
from math import inf

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from alignment.arrays import Array, set_owned
from alignment.errors import TooShort
from alignment.once import once
from alignment.parts import parts, release

_CUBIC_ON = np.array([4.0, -6.0, 4.0, -1.0])  # of four values the next before them
_OF_A_PARABOLA = 3  # samples that it goes through
EDGE = 1e-6  # s: a stamp this near to an edge is on it (stamps are rounded to 1 ns)


@dataclass(frozen=True, slots=True)
class Grain:
    """How coarse a sensor's numbers are: the `step` that they are rounded to, and the `noise` of
    one sample before that, its standard deviation; both in the sensor's unit.

    `increment`: of one whose increments are rounded, remainders carried on, their step [rad] or
    [m/s].
    """

    step: float = 0.0
    noise: float = 0.0
    increment: float = 0.0


@dataclass(frozen=True, slots=True, eq=False, weakref_slot=True)
class ImuReadings:
    """Samples of one IMU.

    Attributes
    ----------
    t : (n,) s
        End of each sample's interval, strictly increasing; jitter is welcome.
    w_ib_b, f_b : (n, 3)
        Angular rate [rad/s] and specific force [m/s^2], in b: means over the interval that
        ends at `t` and began at the stamp before.
    ranges : (float, float)
        Full scale that the data sheet states of gyros [rad/s] and accelerometers [m/s^2]; infinite
        where nobody does.
    grains : (Grain, Grain) or None
        What is known of their rounding; None where nobody says.
    instants : bool
        The samples are not means but the values at `t`. What follows a motion takes `means`; over a
        rest sums are the same but for its ends.

    Raises
    ------
    ValueError
        Shapes that do not fit, values that are not finite, stamps that do not increase.
    """

    t: Array
    w_ib_b: Array
    f_b: Array
    ranges: tuple[float, float] = (inf, inf)
    grains: tuple[Grain, Grain] | None = None
    instants: bool = False

    def __post_init__(self) -> None:
        n = len(self.t)
        set_owned(
            self,
            t=(self.t, (n,), float),
            w_ib_b=(self.w_ib_b, (n, 3), float),
            f_b=(self.f_b, (n, 3), float),
        )
        for rows in parts(n):
            here = self.t[max(0, rows.start - 1) : rows.stop]
            back = np.flatnonzero(here[1:] <= here[:-1])
            if len(back):
                before, after = here[back[0]], here[back[0] + 1]
                k = max(0, rows.start - 1) + int(back[0]) + 1
                raise ValueError(
                    f"t: sample {k} at {after:.9f} s does not come after {before:.9f} s"
                )
            release(self.t)

    def __len__(self) -> int:
        return len(self.t)

    @property
    def interval(self) -> float:
        """Mean time between stamps [s]."""
        if len(self) < 2:
            raise TooShort(f"{len(self)} samples: at least 2 are needed")
        return float(self.t[-1] - self.t[0]) / (len(self) - 1)

    def means(self, rows: slice) -> tuple[Array, Array]:
        """Mean rates and forces over the intervals of some samples: of instants by `over_steps`."""
        if not self.instants:
            return self.w_ib_b[rows], self.f_b[rows]
        return over_steps(self.w_ib_b, rows), over_steps(self.f_b, rows)

    def twice_as_often(self) -> "ImuReadings":
        """Means over the halves of all intervals, of the quintic through the integral at the six
        edges around each: beyond the ends the means go on as the cubic through four.

        Notes
        -----
        A half's mean is ``m_0 + (22 (m_-1 - m_1) - 3 (m_-2 - m_2)) / 128``, the other's as much
        less; both are m_0 in the mean. Of what swings at w it is off by ``(w h)^5/100`` and less,
        at the ends by ``(w h)^4/20``.
        """
        halves = []
        for m in self.means(slice(0, len(self))):
            around = m
            if len(m) > _OF_A_PARABOLA:
                for _ in range(2):
                    first, last = (_CUBIC_ON @ x[:4] for x in (around, around[::-1]))
                    around = np.concatenate([[first], around, [last]])
                change = (22 * (around[1:-3] - around[3:-1]) - 3 * (around[:-4] - around[4:])) / 128
            else:
                change = np.zeros_like(m)
            halves.append(np.stack([m + change, m - change], axis=1).reshape(-1, 3))
        before = self.t - np.diff(self.t, prepend=self.t[0] - self.interval) / 2
        return ImuReadings(np.stack([before, self.t], axis=1).ravel(), *halves)

    def untold(self) -> Array:
        """By how much instants leave the last step's angle untold, (3,) [rad]; zeros of means.

        Notes
        -----
        What stands beyond the end is as far off the next as the third difference of the last four
        is from none, of which the mean over the step has 1/24; the cubic's own remainder sums to
        11/720 of it. Before, what one step has too much the next has too little.
        """
        if not self.instants or len(self) <= _OF_A_PARABOLA:
            return np.zeros(3)
        third = np.diff(self.w_ib_b[-_OF_A_PARABOLA - 1 :], 3, axis=0)[0]
        return np.asarray(self.interval * (1 / 24 + 11 / 720) * np.abs(third))

    def between(self, t_from: float, t_to: float) -> "ImuReadings":
        """The samples whose whole interval lies within [t_from, t_to] (seconds).

        A sample that began before `t_from` mixes in what happened then, so it is left out.
        """
        # sample i began at stamp i - 1, and the first one interval before its stamp
        first = np.searchsorted(self.t, t_from - EDGE) + 1
        if self.t[0] - self.interval >= t_from - EDGE:
            first = 0
        last = max(first, np.searchsorted(self.t, t_to + EDGE))
        part = slice(int(first), int(last))
        if part == slice(0, len(self)):
            return self
        return replace(self, t=self.t[part], w_ib_b=self.w_ib_b[part], f_b=self.f_b[part])


def over_steps(x: Array, rows: slice) -> Array:
    """Means over the steps that end at some rows of instants x (n, k), evenly spaced.

    Notes
    -----
    ``(13 (x_k + x_(k-1)) - x_(k-2) - x_(k+1)) / 24``, the mean of the cubic through four: of a wave
    ``x exp(i w t)`` it leaves ``11 (w h)^4 / 720``. Beyond both ends stands the parabola through
    the three nearest, which leaves ``3 (w h)^3 / 8`` of the first mean, one step long; fewer than
    three are left as they are. The sum of means is that of the instants but for the ends, and so
    is its white noise.
    """
    if len(x) < _OF_A_PARABOLA:
        return x[rows]
    (a, b, c), (d, e, f) = x[:3], x[:-4:-1]
    before = [(6 * a - 8 * b + 3 * c)[None], (3 * a - 3 * b + c)[None]][rows.start :]
    after = [(3 * d - 3 * e + f)[None]][len(x) - rows.stop :]
    y = np.concatenate([*before, x[max(rows.start - 2, 0) : rows.stop + 1], *after])
    mean: Array = (13 * (y[2:-1] + y[1:-2]) - y[:-3] - y[3:]) / 24
    return mean


@dataclass(frozen=True, slots=True, eq=False)
class Turn:
    """A table's turning about one axis, as its encoder says.

    Attributes
    ----------
    axis_b : (3,)
        Unit vector in b about which b turns (right-handed).
    angle : (n,) rad
        Encoder angle at the stamps of the readings; it grows without end over several turns.
    """

    axis_b: Array
    angle: Array

    def __post_init__(self) -> None:
        set_owned(
            self, axis_b=(self.axis_b, (3,), float), angle=(self.angle, (len(self.angle),), float)
        )

    def back(self, C_nb: Rotation) -> Rotation:
        """``C_nb`` where the encoder reads zero, from ``C_nb`` at the last sample."""
        return C_nb * Rotation.from_rotvec(-self.angle[-1] * self.axis_b)


@dataclass(frozen=True, slots=True, eq=False)
class JointAngles:
    """Where the axes of a table stood: `angles` (k,) [rad], as its encoders say.

    `going_round`: the one that turned, whose angle counts as zero; -1 at rest. Where they stood
    elsewhere than they were told to: `C_nb` there, and the turning one's `axis_b` (3,).
    """

    angles: Array
    going_round: int = -1
    C_nb: Rotation | None = None
    axis_b: Array | None = None

    def __post_init__(self) -> None:
        set_owned(self, angles=(self.angles, (len(self.angles),), float))
        if self.axis_b is not None:
            set_owned(self, axis_b=(self.axis_b, (3,), float))


@dataclass(frozen=True, slots=True, eq=False, weakref_slot=True)
class Dwell:
    """Readings of an instrument that was told to stand still, or to turn at a constant rate.

    Or that moved with a vehicle whose `fixes` are known.

    Attributes
    ----------
    label : str
        The position's name.
    t_from, t_to : float
        When it stood, or turned at constant rate [s].
    readings : ImuReadings
        At least those between `t_from` and `t_to`; only those are used, but by a method that
        follows the moves from one stretch to the next.
    nominal : Rotation or None
        ``C_nb`` that the table was told to take (of a turning one: at encoder angle 0), or that
        was programmed into a vehicle, at its first fix; None where nobody said.
    turn : Turn or None
        Encoder angles of a turning table, one per sample of `readings`; None at rest.
    fixes : Fixes or None
        Of a vehicle, between `t_from` and `t_to`.
    nominal_sigma : float or None
        How wrong a vehicle's `nominal` is about each axis [rad]; None where nobody said.
    joints : JointAngles or None
        Of the table; None where nobody said.
    """

    label: str
    t_from: float
    t_to: float
    readings: ImuReadings
    nominal: Rotation | None = None
    turn: Turn | None = None
    fixes: "Fixes | None" = None
    nominal_sigma: float | None = None
    joints: JointAngles | None = None

    def window(self, start: float = 0.0, stop: float | None = None) -> ImuReadings:
        """Samples from `start` to `stop` seconds after the dwell began (to its end if None)."""
        return _all_of(self) if (start, stop) == (0.0, None) else self._part(start, stop)

    def _part(self, start: float, stop: float | None) -> ImuReadings:
        t_to = self.t_to if stop is None else min(self.t_to, self.t_from + stop)
        part = self.readings.between(self.t_from + start, t_to)
        if len(part) < 2:
            raise TooShort(
                f"{self.label}: {len(part)} samples between {self.t_from + start:.3f} and "
                f"{t_to:.3f} s, at least 2 are needed"
            )
        return part


@once  # several methods look at the same samples
def _all_of(dwell: Dwell) -> ImuReadings:
    return dwell._part(0.0, None)


BoolArray = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class Fixes:
    """Positions and velocities from satellite navigation; outages are longer steps of time.

    Attributes
    ----------
    t : (m,) s
        On the clock of the readings, strictly increasing.
    position : (m, 3) m
        In e (ECEF).
    velocity : (m, 3) m/s
        Relative to the Earth, in e.
    position_sigma, velocity_sigma : float
        White noise of each component [m], [m/s].
    position_drift, velocity_drift : float
        Standard deviation of a further error that is correlated over `drift_time` [s]
        (first-order Gauss-Markov); 0 for none.
    """

    t: Array
    position: Array
    velocity: Array
    position_sigma: float
    velocity_sigma: float
    position_drift: float = 0.0
    velocity_drift: float = 0.0
    drift_time: float = 100.0

    def __post_init__(self) -> None:
        m = len(self.t)
        set_owned(
            self,
            t=(self.t, (m,), float),
            position=(self.position, (m, 3), float),
            velocity=(self.velocity, (m, 3), float),
        )
        if not (np.diff(self.t) > 0).all():
            raise ValueError("t: fixes must increase in time")
        if not (self.position_sigma > 0 and self.velocity_sigma > 0 and self.drift_time > 0):
            raise ValueError("position_sigma, velocity_sigma, drift_time: must be above 0")

    def __len__(self) -> int:
        return len(self.t)
