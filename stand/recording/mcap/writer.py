"""The interchange record `run.mcap`, of the stand and of a vehicle; IMU logs in the same form."""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from alignment.arrays import Array, IntArray, owned, set_owned
from stand.errors import StandError
from stand.recording.mcap import cdr, frames, schemas
from stand.recording.mcap.container import Container, Part, Topic
from stand.recording.urdf import IMU_FRAME
from stand.samples import ImuBlock, TruthBlock
from stand.table.joints import JOINTS, StandModel
from stand.table.table_errors import TableErrors

EPOCH_NS = 1_767_225_600 * cdr.NS_PER_S
"""2026-01-01 00:00 UTC: time zero of a simulated run. Viewers read small stamps as durations."""

IMU_TOPIC = "/imu/data"
TRUTH_TOPIC = "/imu/truth"
ENCODER_TOPIC = "/joint_states"
JOINT_TRUTH_TOPIC = "/joint_truth"
SATURATED_TOPIC = "/imu/saturated"
FIX_TOPIC = "/gnss/fix"
VELOCITY_TOPIC = "/gnss/velocity"
ENU_FRAME = "enu"
_CHUNK_NS = cdr.NS_PER_S
_LAST_NS = 2**31 * cdr.NS_PER_S  # seconds of a stamp are int32

# rosbag2's form; durability 1 keeps the last message for late subscribers, 2 does not.
_QOS = """- history: 1
  depth: {depth}
  reliability: 1
  durability: {durability}
  deadline:
    sec: 9223372036
    nsec: 854775807
  lifespan:
    sec: 9223372036
    nsec: 854775807
  liveliness: 1
  liveliness_lease_duration:
    sec: 9223372036
    nsec: 854775807
  avoid_ros_namespace_conventions: false
"""


def _topic(name: str, type_name: str, latched: bool = False) -> Topic:
    qos = _QOS.format(depth=1 if latched else 10, durability=1 if latched else 2)
    return Topic(name, type_name, schemas.definition(type_name), qos)


_TOPICS = (
    _topic(IMU_TOPIC, schemas.IMU),
    _topic(TRUTH_TOPIC, schemas.IMU),
    _topic(ENCODER_TOPIC, schemas.JOINT_STATE),
    _topic(JOINT_TRUTH_TOPIC, schemas.JOINT_STATE),
    _topic("/tf", schemas.TF_MESSAGE),
    _topic("/tf_static", schemas.TF_MESSAGE, latched=True),
    _topic("/robot_description", schemas.STRING, latched=True),
    _topic("/rosout", schemas.LOG),
    _topic(SATURATED_TOPIC, schemas.UINT8),
)
(
    _IMU,
    _TRUTH,
    _ENCODERS,
    _JOINT_TRUTH,
    _TF,
    _TF_STATIC,
    _DESCRIPTION,
    _ROSOUT,
    _SATURATED,
) = range(len(_TOPICS))


_DRIVE_TOPICS = (
    *_TOPICS[: _TRUTH + 1],
    _topic(FIX_TOPIC, schemas.NAV_SAT_FIX),
    _topic(VELOCITY_TOPIC, schemas.TWIST_WITH_COVARIANCE_STAMPED),
)
_FIX, _VELOCITY = len(_DRIVE_TOPICS) - 2, len(_DRIVE_TOPICS) - 1


class McapWriter:
    """Writes a run block by block, in chunks of a second of the run at most.

    What is written is safe against the writer's death: `stand.recording.mcap.rebuild` brings back
    every whole chunk.

    Parameters
    ----------
    path : str or Path
        Overwritten if it exists.
    model : StandModel
        As it was built: its bodies become frames and joints.
    errors : TableErrors, optional
        Its wobbling axes nod in /tf, so that the frames end where /imu/truth says.
    robot_description : str
        URDF.
    epoch_ns : int
        Unix time of the run's time zero [ns].
    metadata : mapping of name to {key: value}
    attachments : mapping of name to (media type, bytes)
    rate_noise, force_noise : (3,)
        Variances of one sample [(rad/s)^2], [(m/s^2)^2], told with every IMU message.

    Raises
    ------
    StandError
        The file cannot be created, or the model has a hinge that is not one of `JOINTS`.

    Notes
    -----
    As a context manager it closes the file; after an exception without a footer, so that an
    unfinished run is never mistaken for a finished one.
    """

    def __init__(
        self,
        path: str | Path,
        *,
        model: StandModel,
        errors: TableErrors | None = None,
        robot_description: str,
        epoch_ns: int = EPOCH_NS,
        metadata: Mapping[str, Mapping[str, str]],
        attachments: Mapping[str, tuple[str, bytes]],
        rate_noise: ArrayLike,
        force_noise: ArrayLike,
    ) -> None:
        self._bodies = frames.hinged(model)
        self._columns = frames.columns(self._bodies)
        self._errors = errors
        self._rate_noise = owned(rate_noise, "rate_noise", (3,))
        self._force_noise = owned(force_noise, "force_noise", (3,))
        self._epoch_ns = epoch_ns
        self._last_ns: int | None = None
        self._logs: list[tuple[int, int, str]] = []
        self._open = True
        self._container = Container(path, _TOPICS)
        self._describe(metadata)
        self._attach(attachments)
        self._container.chunk(self._lasting_parts(model, robot_description))

    def write(self, truth: TruthBlock, imu: ImuBlock) -> None:
        """Append one block, in chunks of a second.

        Raises
        ------
        ValueError
            The two blocks' times differ, do not increase, or lie before what is written.
        """
        if len(truth) == 0:
            return
        self._check_times(truth, imu)
        stamps = self._epoch_ns + truth.t_ns
        parts = [
            Part(_IMU, stamps, self._imu_messages(stamps, imu)),
            Part(_TRUTH, stamps, _truth_messages(stamps, truth)),
            *self._joint_parts(stamps, truth),
            *_saturated_parts(stamps, imu),
        ]
        for rows in _whole_seconds(truth.t_ns):
            last_ns = int(truth.t_ns[rows.stop - 1])
            own = [_between(part, stamps[rows]) for part in parts]
            self._container.chunk([*own, *self._log_parts(until_ns=last_ns)])
            self._last_ns = last_ns

    def metadata(self, name: str, values: Mapping[str, str]) -> None:
        """A metadata record now: what the file says of what has been written so far."""
        self._container.metadata(name, values)

    def log(self, t_ns: int, level: int, text: str) -> None:
        """Note a text for /rosout; it is written with the block that reaches `t_ns`.

        `level` as in rcl_interfaces/msg/Log: 20 info, 30 warning, 40 error. The header keeps
        `t_ns`; a text about a time already written is filed behind what is written.
        """
        self._logs.append((t_ns, level, text))

    def close(
        self,
        attachments: Mapping[str, tuple[str, bytes]] | None = None,
        metadata: Mapping[str, Mapping[str, str]] | None = None,
    ) -> None:
        """Write the remaining texts, both of these, index and footer; again: does nothing."""
        if not self._open:
            return
        self._container.chunk(self._log_parts(until_ns=None))
        self._attach(attachments or {})
        self._describe(metadata or {})
        self._container.finish()
        self._open = False

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if kind is None:
            self.close()
        elif self._open:
            self._container.abandon()
            self._open = False

    def _describe(self, metadata: Mapping[str, Mapping[str, str]]) -> None:
        for name, values in metadata.items():
            self._container.metadata(name, values)

    def _attach(self, attachments: Mapping[str, tuple[str, bytes]]) -> None:
        for name, (media_type, data) in attachments.items():
            self._container.attachment(name, media_type, data, self._epoch_ns)

    def _lasting_parts(self, model: StandModel, robot_description: str) -> list[Part]:
        """What subscribers must know before the first sample."""
        stamp = np.array([self._epoch_ns])
        fixed = frames.fixed_frames(model)
        static = cdr.transforms(stamp, fixed.pairs, fixed.translations[None], fixed.rotations[None])
        return [
            Part(_TF_STATIC, stamp, static),
            Part(_DESCRIPTION, stamp, cdr.string_message(robot_description)),
        ]

    def _check_times(self, truth: TruthBlock, imu: ImuBlock) -> None:
        if not np.array_equal(truth.t_ns, imu.t_ns):
            raise ValueError("t_ns: truth and imu differ")
        before = truth.t_ns[0] - 1 if self._last_ns is None else self._last_ns
        if (np.diff(truth.t_ns, prepend=before) <= 0).any():
            raise ValueError("t_ns: must increase, within a block and from block to block")
        for name in ("joints", "encoders"):
            width = getattr(truth, name).shape[1]
            if width != len(JOINTS):
                raise ValueError(f"{name}: {width} columns, must be {len(JOINTS)}")

    def _imu_messages(self, stamps: IntArray, imu: ImuBlock) -> cdr.Bytes:
        return cdr.imu_messages(
            stamps,
            imu.w_ib_b,
            imu.f_b,
            frame_id=IMU_FRAME,
            rate_noise=self._rate_noise,
            force_noise=self._force_noise,
        )

    def _joint_parts(self, stamps: IntArray, truth: TruthBlock) -> list[Part]:
        """What the encoders say, what is, and the transforms that follow from what is."""
        if not self._bodies:
            return []
        names = [JOINTS[i] for i in self._columns]

        def states(angles: Array, rates: Array) -> cdr.Bytes:
            own = (angles[:, self._columns], rates[:, self._columns])
            return cdr.joint_states(stamps, names, *own)

        rows = frames.tf_rows(truth.t_ns, self._last_ns)
        moving = frames.moving_frames(
            self._bodies, truth.joints[rows][:, self._columns], self._nods(truth.encoders[rows])
        )
        tf = cdr.transforms(stamps[rows], moving.pairs, moving.translations, moving.rotations)
        return [
            Part(_ENCODERS, stamps, states(truth.encoders, truth.encoder_rates)),
            Part(_JOINT_TRUTH, stamps, states(truth.joints, truth.joint_rates)),
            Part(_TF, stamps[rows], tf),
        ]

    def _nods(self, q: Array) -> dict[int, Array]:
        """The nods of each wobbling axis at angles (n, 6), by the number of its body."""
        if self._errors is None or not len(self._errors.wobbling):
            return {}
        nods, _, _ = self._errors.nods(q, np.zeros_like(q), np.zeros_like(q))
        pairs = zip(self._errors.wobbling, np.split(nods, nods.shape[1] // 2, axis=1), strict=True)
        return {self._columns.index(int(k)): nod for k, nod in pairs if k in self._columns}

    def _log_parts(self, until_ns: int | None) -> list[Part]:
        """The texts due by `until_ns` (None: all), in order of time."""
        due = [log for log in self._logs if until_ns is None or log[0] <= until_ns]
        self._logs = [log for log in self._logs if log not in due]
        due.sort(key=lambda log: log[0])
        earliest = 0 if self._last_ns is None else self._last_ns
        return [
            Part(
                _ROSOUT,
                np.array([self._epoch_ns + max(t_ns, earliest)]),
                cdr.log_message(self._epoch_ns + t_ns, level, "stand", text),
            )
            for t_ns, level, text in due
        ]


def _between(part: Part, stamps: IntArray) -> Part:
    """Those of its messages from the first to the last of these times."""
    rows = slice(*np.searchsorted(part.log_time, [stamps[0], stamps[-1] + 1]))
    return Part(part.topic, part.log_time[rows], part.payload[rows])


def _saturated_parts(stamps: IntArray, imu: ImuBlock) -> list[Part]:
    """A message at each sample with a channel beyond its range: bit k is channel k.

    Channels count from gyro X1, Y1, Z1 to accelerometer X1, Y1, Z1.
    """
    assert imu.saturated is not None
    rows = np.flatnonzero(imu.saturated.any(axis=1))
    if not len(rows):
        return []
    bits = imu.saturated[rows] @ (1 << np.arange(imu.saturated.shape[1]))
    return [Part(_SATURATED, stamps[rows], cdr.uint8_messages(bits))]


def _truth_messages(stamps: IntArray, truth: TruthBlock) -> cdr.Bytes:
    return cdr.imu_messages(stamps, truth.w_ib_b, truth.f_b, frame_id=IMU_FRAME, q=truth.q_wb)


def write_imu_log(
    path: str | Path,
    *,
    t_ns: IntArray,
    w_ib_b: Array,
    f_b: Array,
    epoch_ns: int = EPOCH_NS,
    frame_id: str = IMU_FRAME,
    metadata: Mapping[str, Mapping[str, str]],
) -> None:
    """Write an IMU log as one topic /imu/data, in chunks of a second.

    Parameters
    ----------
    path : str or Path
        Overwritten if it exists.
    t_ns : (n,) int64
        Strictly increasing [ns].
    w_ib_b, f_b : (n, 3)
        [rad/s], [m/s^2].
    epoch_ns : int
        Unix time of `t_ns` = 0 [ns]; 0 if `t_ns` is Unix time.
    frame_id : str
    metadata : mapping of name to {key: value}

    Raises
    ------
    StandError
        The file cannot be created; the times do not increase, or do not fit into a stamp.
    """
    if (np.diff(t_ns) <= 0).any():
        raise StandError(f"{path}: times must increase")
    stamps = epoch_ns + t_ns
    if len(stamps) and not 0 <= stamps[0] <= stamps[-1] < _LAST_NS:
        raise StandError(f"{path}: times must lie between 1970 and 2038, as ROS stamps do")
    with Container(path, _TOPICS[:1]) as container:
        for name, values in metadata.items():
            container.metadata(name, values)
        for rows in _seconds(t_ns):
            messages = cdr.imu_messages(stamps[rows], w_ib_b[rows], f_b[rows], frame_id=frame_id)
            container.chunk([Part(_IMU, stamps[rows], messages)])


@dataclass(frozen=True, slots=True, eq=False)
class Satellites:
    """Fixes to be recorded: `t_ns` (m,) [ns]; `place` (m, 3) geodetic latitude, longitude [rad],
    height [m]; `v` (m, 3) east, north, up [m/s]; variances of each component [m^2], [(m/s)^2].
    """

    t_ns: IntArray
    place: Array
    v: Array
    place_variance: float
    v_variance: float

    def __post_init__(self) -> None:
        m = len(self.t_ns)
        set_owned(
            self,
            t_ns=(self.t_ns, (m,), np.int64),
            place=(self.place, (m, 3), float),
            v=(self.v, (m, 3), float),
        )


class DriveWriter:
    """Writes a vehicle's drive block by block, in chunks of a second at most.

    What the IMU said and what it should have said as in `McapWriter`, the fixes on /gnss/fix and
    /gnss/velocity, of an antenna at the IMU's place.

    Parameters
    ----------
    path : str or Path
        Overwritten if it exists.
    satellites : Satellites
        All of the drive; each goes with the samples up to its time.
    epoch_ns, metadata, attachments, rate_noise, force_noise
        As for `McapWriter`.

    Raises
    ------
    StandError
        The file cannot be created.
    """

    def __init__(
        self,
        path: str | Path,
        *,
        satellites: Satellites,
        epoch_ns: int = EPOCH_NS,
        metadata: Mapping[str, Mapping[str, str]],
        attachments: Mapping[str, tuple[str, bytes]],
        rate_noise: ArrayLike,
        force_noise: ArrayLike,
    ) -> None:
        self._satellites, self._epoch_ns = satellites, epoch_ns
        self._rate_noise = owned(rate_noise, "rate_noise", (3,))
        self._force_noise = owned(force_noise, "force_noise", (3,))
        self._fixes = 0  # written so far
        self._container = Container(path, _DRIVE_TOPICS)
        for name, values in metadata.items():
            self._container.metadata(name, values)
        for name, (media_type, data) in attachments.items():
            self._container.attachment(name, media_type, data, epoch_ns)

    def write(self, truth: TruthBlock, imu: ImuBlock) -> None:
        """Append samples, of equal times, with the fixes up to them; joints are not recorded."""
        for rows in _whole_seconds(imu.t_ns):
            stamps = self._epoch_ns + imu.t_ns[rows]
            w, f = imu.w_ib_b[rows], imu.f_b[rows]
            said = cdr.imu_messages(
                stamps,
                w,
                f,
                frame_id=IMU_FRAME,
                rate_noise=self._rate_noise,
                force_noise=self._force_noise,
            )
            true = _truth_messages(stamps, truth.part(rows))
            fixes = self._satellite_parts(until_ns=int(imu.t_ns[rows.stop - 1]))
            self._container.chunk([Part(_IMU, stamps, said), Part(_TRUTH, stamps, true), *fixes])

    def _satellite_parts(self, until_ns: int | None) -> list[Part]:
        """The fixes due by `until_ns` (None: all)."""
        t_ns = self._satellites.t_ns
        last = len(t_ns) if until_ns is None else int(np.searchsorted(t_ns, until_ns, "right"))
        rows, self._fixes = slice(self._fixes, last), last
        return _satellite_parts(self._satellites, rows, self._epoch_ns)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is None:
            self._container.chunk(self._satellite_parts(until_ns=None))
            self._container.finish()
        else:
            self._container.abandon()


def _satellite_parts(satellites: Satellites, rows: slice, epoch_ns: int) -> list[Part]:
    stamps = epoch_ns + satellites.t_ns[rows]
    fixes = cdr.fix_messages(
        stamps, satellites.place[rows], frame_id=IMU_FRAME, variance=satellites.place_variance
    )
    velocities = cdr.velocity_messages(
        stamps, satellites.v[rows], frame_id=ENU_FRAME, variance=satellites.v_variance
    )
    return [Part(_FIX, stamps, fixes), Part(_VELOCITY, stamps, velocities)]


def _whole_seconds(t_ns: IntArray) -> list[slice]:
    """Slices of samples by second of the run; that at 1.0 s, an interval's end, is the first's."""
    bounds = np.flatnonzero(np.diff((t_ns - 1) // _CHUNK_NS)) + 1
    return [slice(int(a), int(b)) for a, b in pairwise([0, *bounds, len(t_ns)]) if b > a]


def _seconds(t_ns: IntArray) -> list[slice]:
    """Slices of the samples by whole second since the first."""
    if len(t_ns) == 0:
        return []
    seconds = (t_ns - t_ns[0]) // _CHUNK_NS
    starts = np.flatnonzero(np.diff(seconds, prepend=-1))
    return [slice(a, b) for a, b in zip(starts, [*starts[1:], len(t_ns)], strict=True)]
