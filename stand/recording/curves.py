"""What the estimators hand to the review: angles over time, as plain arrays."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from alignment.arrays import Array, IntArray, owned, set_owned
from stand.columns import cell

ANGLES = ("roll", "yaw", "pitch")


@dataclass(frozen=True, slots=True, eq=False)
class AngleCurves:
    """One method's angles over one dwell.

    Attributes
    ----------
    method : str
        As shown in legends, for example 'six-position' or 'rk4'.
    label : str
        The dwell's label, for example 'X1 up'.
    t_ns : (m,) int64
        Since the start of the run.
    angles, errors, sigmas : (m, 3)
        Roll, yaw, pitch [rad]: estimated, estimated minus true (wrapped), and predicted
        standard deviation (0 where the method gives none). NaN of an angle not determined.
    error_rotations : (m, 3)
        Rotation vector [rad], in b, that turns the true instrument axes onto the estimated ones;
        NaN where an angle is not determined.
    """

    method: str
    label: str
    t_ns: IntArray
    angles: Array
    errors: Array
    sigmas: Array
    error_rotations: Array

    def __post_init__(self) -> None:
        m = len(self.t_ns)
        set_owned(self, t_ns=(self.t_ns, (m,), np.int64))
        for name in ("angles", "errors", "sigmas", "error_rotations"):
            object.__setattr__(self, name, owned(getattr(self, name), name, (m, 3), nan=True))


@dataclass(frozen=True, slots=True, eq=False)
class InnovationCurves:
    """What a filter's updates over one stretch found beyond what it expected.

    `t_ns` (m,) int64 since the start of the run; `values` and their `sigmas` (m, 3) [m] toward
    N, E, D.
    """

    method: str
    label: str
    t_ns: IntArray
    values: Array
    sigmas: Array

    def __post_init__(self) -> None:
        m = len(self.t_ns)
        set_owned(
            self,
            t_ns=(self.t_ns, (m,), np.int64),
            values=(self.values, (m, 3), float),
            sigmas=(self.sigmas, (m, 3), float),
        )


def innovations_csv(curves: Sequence[InnovationCurves]) -> str:
    """The same as text: one row per update."""
    axes = [f"{kind}_{axis}_m" for kind in ("innovation", "sigma") for axis in "NED"]
    rows = [",".join(["method", "label", "time_s", *axes])]
    for curve in curves:
        name = f'{curve.method},"{cell(curve.label).replace(chr(34), chr(34) * 2)}"'
        numbers = np.column_stack([curve.values, curve.sigmas])
        for t, row in zip(curve.t_ns, numbers.tolist(), strict=True):
            rows.append(f"{name},{t * 1e-9:.9f}," + ",".join(f"{x:.6g}" for x in row))
    return "\n".join(rows) + "\n"


@dataclass(frozen=True, slots=True)
class Phase:
    """A step of the procedure as it ran; `kind` as in the procedure: 'dwell', 'move', 'rate'."""

    t_from_ns: int
    t_to_ns: int
    kind: str
    label: str
