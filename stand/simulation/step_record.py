"""What the table's servo did in each step: following error, saturation, torque, settling."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, Json

from alignment.arrays import Array, set_owned
from alignment.units import ARC_SECOND
from stand.bounds import Time
from stand.table.joints import JOINTS
from stand.toml_files import checked

FOLLOWED = "followed "  # metadata records of steps that are over; behind it the first one's number


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


def records_from_json(name: str, text: str) -> tuple[StepRecord, ...]:
    """The records in the text of a `result.json`; none in that of a drive, which has no servo.

    Raises
    ------
    StandError
        One line: `name`, the key, the value, what is allowed.
    """
    steps = checked(name, {"result": text}, _Result).result.steps
    return tuple(step.record() for step in steps)


def describe_followed(first: int, records: Sequence[StepRecord]) -> dict[str, dict[str, str]]:
    """The metadata record of steps that are over, from number `first` on; none of none."""
    text = json.dumps([record_to_json(record) for record in records])
    return {f"{FOLLOWED}{first}": {"json": text}} if records else {}


def followed_steps(name: str, metadata: Mapping[str, Mapping[str, str]]) -> tuple[StepRecord, ...]:
    """What the metadata of a recording says of its steps, in their order; errors as those of
    `records_from_json`.
    """
    told = {
        int(key.removeprefix(FOLLOWED)): record.get("json", "")
        for key, record in metadata.items()
        if key.startswith(FOLLOWED) and key.removeprefix(FOLLOWED).isdecimal()
    }
    texts = (f'{{"steps": {told[first]}}}' for first in sorted(told))
    return tuple(step for text in texts for step in records_from_json(name, text))


def _by_axis(values: Array) -> dict[str, float]:
    return dict(zip(JOINTS, values.tolist(), strict=True))


def _all_axes(values: dict[str, float]) -> dict[str, float]:
    if set(values) != set(JOINTS):
        raise ValueError(f"must name the axes {', '.join(JOINTS)}")
    return values


# arc seconds, seconds and percent of a limit: of an axis that ran away, and some orders beyond
_Size = Annotated[float, Field(ge=0, le=1e12)]
_ByAxis = Annotated[dict[str, _Size], AfterValidator(_all_axes)]


class _Read(BaseModel):
    """Base of what is read back: finite numbers; more keys pass."""

    model_config = ConfigDict(frozen=True, allow_inf_nan=False, defer_build=True)


class _Step(_Read):
    """What `record_to_json` writes."""

    label: str
    kind: str
    t_from_s: Time
    t_to_s: Time
    following_max_arc_s: _ByAxis
    following_rms_arc_s: _ByAxis
    saturated_s: _ByAxis
    torque_percent: _ByAxis
    rests: bool
    settled_after_s: Time | None

    def record(self) -> StepRecord:
        """The same in SI."""
        return StepRecord(
            label=self.label,
            kind=self.kind,
            t_from=self.t_from_s,
            t_to=self.t_to_s,
            following_max=_in_order(self.following_max_arc_s, ARC_SECOND),
            following_rms=_in_order(self.following_rms_arc_s, ARC_SECOND),
            saturated=_in_order(self.saturated_s, 1.0),
            torque_ratio=_in_order(self.torque_percent, 0.01),
            rests=self.rests,
            settled=self.settled_after_s,
        )


class _Steps(_Read):
    steps: tuple[_Step, ...] = ()


class _Result(_Read):
    result: Json[_Steps]


def _in_order(values: dict[str, float], unit: float) -> Array:
    return np.array([values[joint] for joint in JOINTS]) * unit
