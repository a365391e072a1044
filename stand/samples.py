"""The blocks of samples that flow from the stand to the recording."""

from dataclasses import dataclass, field, fields
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from alignment.arrays import Array, IntArray, set_owned

AXES = ("X1", "Y1", "Z1")  # of the instrument, b
CHANNELS = tuple(f"{sensor} {axis}" for sensor in ("gyro", "accel") for axis in AXES)
_OF_JOINTS = np.empty((0, 0))  # encoders that were not given


class Sampling(Enum):
    """What a sample is: the mean over the interval that ends at its stamp, or the instant."""

    MEAN = "mean"
    INSTANT = "instant"


def _own_readings(block: "Sensed | ImuBlock") -> None:
    n = len(block.t_ns)
    set_owned(
        block,
        t_ns=(block.t_ns, (n,), np.int64),
        w_ib_b=(block.w_ib_b, (n, 3), float),
        f_b=(block.f_b, (n, 3), float),
    )


@dataclass(frozen=True, slots=True, eq=False)
class TruthBlock:
    """What perfect sensors at the IMU's point would report over some samples.

    Attributes
    ----------
    t_ns : (n,) int64
        Time of each sample since the start of the run [ns]: the END of its interval.
    w_ib_b, f_b : (n, 3)
        Angular rate [rad/s] and specific force [m/s^2], in b.
    q_wb : (n, 4)
        Quaternion (x, y, z, w) of C_wb at `t_ns`: takes b components to ENU components.
    joints, joint_rates : (n, 6)
        True joint angles [rad] and rates [rad/s] at `t_ns`, in the order of `JOINTS`.
    encoders, encoder_rates : (n, 6)
        What the encoders say [rad], and the rates of what they measure [rad/s]; if not given,
        of a table without errors, the joints'.
    """

    t_ns: IntArray
    w_ib_b: Array
    f_b: Array
    q_wb: Array
    joints: Array
    joint_rates: Array
    encoders: Array = field(default_factory=lambda: _OF_JOINTS)
    encoder_rates: Array = field(default_factory=lambda: _OF_JOINTS)

    def __post_init__(self) -> None:
        n = len(self.t_ns)
        set_owned(
            self,
            t_ns=(self.t_ns, (n,), np.int64),
            w_ib_b=(self.w_ib_b, (n, 3), float),
            f_b=(self.f_b, (n, 3), float),
            q_wb=(self.q_wb, (n, 4), float),
            joints=(self.joints, (n, None), float),
            joint_rates=(self.joint_rates, (n, None), float),
        )
        for said, true in (("encoders", "joints"), ("encoder_rates", "joint_rates")):
            if getattr(self, said) is _OF_JOINTS:
                object.__setattr__(self, said, getattr(self, true))
            else:
                shape = getattr(self, true).shape
                set_owned(self, **{said: (getattr(self, said), shape, float)})

    def part(self, rows: slice) -> "TruthBlock":
        """Some of the samples."""
        return TruthBlock(*(getattr(self, field.name)[rows] for field in fields(self)))

    def __len__(self) -> int:
        return len(self.t_ns)


@dataclass(frozen=True, slots=True, eq=False)
class Sensed:
    """What perfect sensors at the unit's own places and sample times would report.

    As `TruthBlock`, but component i of `f_b` is felt where accelerometer i sits, and the samples
    are those that the unit's clock takes; `t_ns` are the stamps it gives them. `w_other`, `f_other`
    (n, 3): of samples that are means, what is felt at their ends, where it is known; of instants,
    the means up to them. A unit with a low-pass tells from both what was between.
    """

    t_ns: IntArray
    w_ib_b: Array
    f_b: Array
    w_other: Array | None = None
    f_other: Array | None = None

    def __post_init__(self) -> None:
        _own_readings(self)
        for name in ("w_other", "f_other"):
            if getattr(self, name) is not None:
                set_owned(self, **{name: (getattr(self, name), (len(self.t_ns), 3), float)})

    @property
    def others(self) -> tuple[Array, Array] | None:
        """`w_other` and `f_other`, where they are known."""
        w, f = self.w_other, self.f_other
        return None if w is None or f is None else (w, f)


@dataclass(frozen=True, slots=True, eq=False)
class ImuBlock:
    """What the IMU reports over the samples of a `TruthBlock`.

    Attributes
    ----------
    t_ns : (n,) int64
        As in the `TruthBlock` [ns].
    w_ib_b, f_b : (n, 3)
        Reported angular rate [rad/s] and specific force [m/s^2], in b. Units that report
        increments: the increment over the sample's nominal length.
    saturated : (n, 6) bool or None
        Which of the three gyros, then accelerometers, was beyond its range; None for none.
    """

    t_ns: IntArray
    w_ib_b: Array
    f_b: Array
    saturated: NDArray[np.bool_] | None = None

    def __post_init__(self) -> None:
        _own_readings(self)
        flags = np.zeros((len(self), 6), bool) if self.saturated is None else self.saturated
        set_owned(self, saturated=(flags, (len(self), 6), bool))

    def part(self, rows: slice) -> "ImuBlock":
        """Some of the samples."""
        return ImuBlock(*(getattr(self, field.name)[rows] for field in fields(self)))

    def increments(self, rate_hz: int) -> tuple[Array, Array]:
        """delta-theta [rad] and delta-v [m/s] (n, 3) of samples of length 1 / `rate_hz`."""
        return self.w_ib_b / rate_hz, self.f_b / rate_hz

    def __len__(self) -> int:
        return len(self.t_ns)
