"""What the table's servo did in each step: following error, saturation, torque, settling."""

from dataclasses import dataclass
from typing import Any

from alignment.arrays import Array, set_owned
from alignment.units import ARC_SECOND
from stand.table.joints import JOINTS


@dataclass(frozen=True, slots=True, eq=False)
class StepRecord:
    """One step of a servo run. Arrays (6,) are in the order of `JOINTS`.

    Attributes
    ----------
    label, kind : str
    t_from, t_to : float
        Of the whole step [s].
    following_max, following_rms : (6,) rad
        Greatest size and root mean square of demanded minus realised angle, over the whole step.
    saturated : (6,) s
        How long the motor was at its torque limit, over the whole step.
    torque_ratio : (6,)
        Greatest torque over its limit, over the whole step; 0 of an axis without a motor.
    rests : bool
        Whether the table was to stand still, and so had to settle.
    settled : float or None
        When it had settled, counted from the step's begin [s]; None: never (or the step does
        not rest).
    """

    label: str
    kind: str
    t_from: float
    t_to: float
    following_max: Array
    following_rms: Array
    saturated: Array
    torque_ratio: Array
    rests: bool
    settled: float | None = None

    def __post_init__(self) -> None:
        six = (len(JOINTS),)
        set_owned(
            self,
            following_max=(self.following_max, six, float),
            following_rms=(self.following_rms, six, float),
            saturated=(self.saturated, six, float),
            torque_ratio=(self.torque_ratio, six, float),
        )


def record_to_json(record: StepRecord) -> dict[str, Any]:
    """For machines: units in the keys, axes by name."""
    return {
        "label": record.label,
        "kind": record.kind,
        "t_from_s": record.t_from,
        "t_to_s": record.t_to,
        "following_max_arc_s": _by_axis(record.following_max / ARC_SECOND),
        "following_rms_arc_s": _by_axis(record.following_rms / ARC_SECOND),
        "saturated_s": _by_axis(record.saturated),
        "torque_percent": _by_axis(100.0 * record.torque_ratio),
        "rests": record.rests,
        "settled_after_s": record.settled,
    }


def _by_axis(values: Array) -> dict[str, float]:
    return dict(zip(JOINTS, values.tolist(), strict=True))
