"""What a film shows of a recording: joint angles, readings, phases, the estimate as it grows."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from alignment import ImuReadings
from alignment.arrays import Array, set_owned
from alignment.readings import EDGE
from stand.errors import StandError, located, unknown
from stand.evaluation.growth import growing
from stand.imu.preset import ImuEntry
from stand.procedure.procedure import ProcedureEntry
from stand.recording.attached_model import attached_model
from stand.recording.content import COMPRESSED, MESSAGES, kind_of
from stand.recording.curves import AngleCurves
from stand.recording.entrance import log_file, open_log, origin_of
from stand.recording.log import Log
from stand.recording.mcap.reader import JointLog
from stand.recording.metadata import MODEL_FOLDER, RUN, recorded_steps
from stand.table.joints import JOINTS
from stand.toml_files import Entry, Source, parse


@dataclass(frozen=True, slots=True)
class Stage:
    """A step as it ran, or a stretch of a log: from, to [s]."""

    label: str
    kind: str
    t_from: float
    t_to: float


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Scene:
    """All of a recording that can be seen.

    `stamps` (m,) [s] and `angles` (m, 6) [rad], in the order of `JOINTS`, are the encoders';
    `true`: whether the errors of `estimate` are against the truth, else against what each stretch
    came to; `noise_only`: the sensors of which nothing but noise is known; `model`: the MJCF of a
    stand that is not the shipped one.
    """

    title: str
    subtitle: str
    readings: ImuReadings
    stages: tuple[Stage, ...]
    stamps: Array
    angles: Array
    estimate: tuple[AngleCurves, ...]
    true: bool
    noise_only: frozenset[str]
    model: Path | None

    def __post_init__(self) -> None:
        m = len(self.stamps)
        set_owned(
            self,
            stamps=(self.stamps, (m,), float),
            angles=(self.angles, (m, len(JOINTS)), float),
        )

    def joints(self, t: Array) -> Array:
        """Angles (n, 6) [rad] at times (n,) [s], straight between the encoders' readings."""
        columns = [np.interp(t, self.stamps, column) for column in self.angles.T]
        return np.column_stack(columns)

    def stage(self, t: float) -> int | None:
        """Which stage is on at a time [s]."""
        on = [k for k, s in enumerate(self.stages) if s.t_from - EDGE < t <= s.t_to + EDGE]
        return on[0] if on else None


@contextmanager
def scene_of(log: Log, method: str | None = None, joints: str = "") -> Iterator[Scene]:
    """The scene of a recording; its own model lies in a folder that lives as long.

    Parameters
    ----------
    log : Log
    method : str, optional
        Whose estimate is shown; see `growing`.
    joints : str
        Which joint of a foreign table is which axis of the stand: 'yaw=outer,pitch=-middle', a
        minus where it turns the other way.

    Raises
    ------
    StandError
        A log without joints, or with joints that are no axes of the stand; no such method.
    """
    with open_log(log.path) as file:
        measured = file.joints()
        with located(log.path):
            angles = angles_of(measured, joints)
    metadata = log.imu.metadata
    run = metadata.get(RUN, {})
    titles = [_title(key, model, metadata) for key, model in _ENTRIES.items()]
    with _own_model(Path(log.path), run.get("model")) as model:
        yield Scene(
            title=titles[0] or Path(log.path).stem,
            subtitle=titles[1] or log.topic,
            readings=log.readings,
            stages=_stages(log),
            stamps=(measured.t_ns - origin_of(log.imu)) * 1e-9,
            angles=angles,
            estimate=tuple(growing(log, method)),
            true=log.simulated,
            noise_only=log.options.priors.noise_only,
            model=model,
        )


def refuse_tables(path: Path) -> None:
    """`StandError` of a table of readings, which has no joints: before it is asked for its units.

    Raises also what opening it does.
    """
    if kind_of(log_file(path)) not in (*MESSAGES, *COMPRESSED):
        raise StandError(f"{path}: a table of readings, it has no joints that would turn the stand")


def angles_of(measured: JointLog, assigned: str = "") -> Array:
    """Angles (m, 6) [rad] of the stand's axes; those that the log does not have stay at zero."""
    places = _assigned(measured, assigned) if assigned else _same(measured)
    angles = np.zeros((len(measured), len(JOINTS)))
    for name, (axis, sign) in places.items():
        angles[:, JOINTS.index(axis)] = sign * measured.angles[:, measured.names.index(name)]
    return angles


def _same(measured: JointLog) -> dict[str, tuple[str, float]]:
    places = {name: (name, 1.0) for name in measured.names if name in JOINTS}
    if not places:
        raise StandError(
            f"{measured.topic}: joints {', '.join(measured.names)}: none is an axis of the stand "
            f"({', '.join(JOINTS)}); --joints {measured.names[0]}=outer says which is which"
        )
    return places


def _assigned(measured: JointLog, assigned: str) -> dict[str, tuple[str, float]]:
    places: dict[str, tuple[str, float]] = {}
    for part in filter(None, map(str.strip, assigned.split(","))):
        name, _, axis = part.partition("=")
        if name not in measured.names:
            raise unknown(f"{measured.topic}: joint", name, measured.names)
        if axis.removeprefix("-") not in JOINTS:
            raise unknown("--joints: axis of the stand", axis.removeprefix("-"), JOINTS)
        places[name] = axis.removeprefix("-"), -1.0 if axis.startswith("-") else 1.0
    return places


def _stages(log: Log) -> tuple[Stage, ...]:
    steps = recorded_steps(log.imu.metadata)
    if steps:
        return tuple(Stage(s.label or s.kind, s.kind, s.t_from_s, s.t_to_s) for s in steps)
    return tuple(
        Stage(d.label, "dwell" if d.turn is None else "rate", d.t_from, d.t_to) for d in log.dwells
    )


_ENTRIES: Mapping[str, type[Entry]] = {"procedure": ProcedureEntry, "imu": ImuEntry}


def _title(key: str, model: type[Entry], metadata: Mapping[str, Mapping[str, str]]) -> str:
    """What a recorded file calls itself; '' where there is none, or of another version."""
    text = metadata.get(key, {}).get("toml", "")
    try:
        return str(getattr(parse(Source(key, key, text), model), "title", "")) if text else ""
    except StandError:
        return ""


@contextmanager
def _own_model(file: Path, main: str | None) -> Iterator[Path | None]:
    if main is None:
        yield None
        return
    with TemporaryDirectory() as folder:
        with located(file):
            model = attached_model(file, MODEL_FOLDER + main, Path(folder))
        yield model


def stretch_of(scene: Scene, t_from: float | None, t_to: float | None) -> tuple[float, float]:
    """The stretch to be shown [s], which must lie within the recording."""
    t = scene.readings.t
    begin, end = float(t[0]) - scene.readings.interval, float(t[-1])
    a, b = begin if t_from is None else t_from, end if t_to is None else t_to
    if not begin - EDGE <= a < b <= end + EDGE:  # also of what is no number
        raise StandError(
            f"from {a:g} to {b:g} s: must be a stretch within the recording's {begin:.3f} to "
            f"{end:.3f} s"
        )
    return a, b


def readouts(angles: Array) -> list[str]:
    """'outer    90.00' of each axis, for angles [rad] in the order of `JOINTS`."""
    shown = np.round(np.degrees(angles), 2) + 0.0  # no minus before a zero
    return [f"{name:<10}{angle:8.2f}°" for name, angle in zip(JOINTS, shown, strict=True)]
