"""Reading logs of IMUs, joints and satellite fixes from MCAP files, our own and foreign ones."""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from mmap import mmap
from pathlib import Path
from typing import Any

import numpy as np
from mcap.opcode import Opcode
from mcap.records import Attachment
from numpy.typing import NDArray

from alignment.arrays import Array, IntArray, owned
from alignment.parts import in_parts, parts, release
from stand.errors import StandError, located, unknown
from stand.recording.growing import Growing
from stand.recording.log_form import LogForm
from stand.recording.mcap import schemas
from stand.recording.mcap.bag import is_bag, joined
from stand.recording.mcap.cdr import Bytes
from stand.recording.mcap.decode import (
    FixBatch,
    ImuBatch,
    JointBatch,
    VelocityBatch,
    decode_fixes,
    decode_imu,
    decode_joints,
    decode_velocities,
)
from stand.recording.mcap.records import (
    Directory,
    McapMessages,
    Messages,
    faults_of,
    opened,
    parsed,
    records,
)
from stand.recording.mcap.ros1 import BagMessages, is_ros1
from stand.recording.mcap.shared_topic import SharedTopic
from stand.recording.mcap.writer import (
    ENCODER_TOPIC,
    FIX_TOPIC,
    IMU_TOPIC,
    TRUTH_TOPIC,
    VELOCITY_TOPIC,
)
from stand.recording.repeated import Repeated

# The second is the type's name in ROS 1 and some writers.
_IMU_TYPES = (schemas.IMU, "sensor_msgs/Imu")
_JOINT_TYPES = (schemas.JOINT_STATE, "sensor_msgs/JointState")
_FIX_TYPES = (schemas.NAV_SAT_FIX, "sensor_msgs/NavSatFix")
_VELOCITY_TYPES = {  # and whether they have a covariance
    schemas.TWIST_WITH_COVARIANCE_STAMPED: True,
    "geometry_msgs/TwistWithCovarianceStamped": True,
    schemas.TWIST_STAMPED: False,
    "geometry_msgs/TwistStamped": False,
}
_LABELS = {
    "t_ns": "stamp",
    "w_ib_b": "angular_velocity",
    "f_b": "linear_acceleration",
    "q": "orientation",
    "angles": "position",
    "place": "latitude, longitude (rad), altitude",
    "v": "twist.linear",
}

# What no unit reports and no vehicle reaches, some orders beyond: sums of squares stay numbers.
_MOST = {
    "w_ib_b": 1e6,  # rad/s
    "f_b": 1e9,  # m/s^2
    "angles": 1e9,  # rad
    "place": 1e9,  # m; its angles have bounds of their own
    "v": 1e9,  # m/s
}

Batch = ImuBatch | JointBatch | FixBatch | VelocityBatch
Decode = Callable[..., Batch]
"""A chunk, where its messages begin, their sizes, the first one's number, and whether they are
packed as ROS 1 does: the messages."""
_PACKED = {"cdr": False, "ros1": True}


@dataclass(frozen=True, slots=True, eq=False)
class ImuLog:
    """What an IMU reported, read from a file.

    Attributes
    ----------
    path, topic : str
        Where it was read.
    frame_id : str
        Of the first message.
    t_ns : (n,) int64
        Header stamps since the Unix epoch [ns], strictly increasing; n >= 1.
    w_ib_b, f_b : (n, 3)
        Angular rate [rad/s] and specific force [m/s^2].
    metadata : dict
        The file's metadata records: {name: {key: value}}.
    notes : tuple of str
        What was found out of the file: units, columns, what was left out.
    doubts : tuple of str
        What of it may make an answer wrong.
    """

    path: str
    topic: str
    frame_id: str
    t_ns: IntArray
    w_ib_b: Array
    f_b: Array
    metadata: dict[str, dict[str, str]]
    notes: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        _own(self, t_ns=(), w_ib_b=(3,), f_b=(3,))

    def __len__(self) -> int:
        return len(self.t_ns)


@dataclass(frozen=True, slots=True, eq=False)
class TruthLog:
    """What perfect sensors would have reported, and the attitude, read from a file.

    Attributes
    ----------
    path : str
    t_ns : (n,) int64
        As in `ImuLog`.
    q_wb : (n, 4)
        Quaternion (x, y, z, w): takes b components to ENU components.
    w_ib_b, f_b : (n, 3)
        [rad/s], [m/s^2].
    """

    path: str
    t_ns: IntArray
    q_wb: Array
    w_ib_b: Array
    f_b: Array

    def __post_init__(self) -> None:
        _own(self, t_ns=(), q_wb=(4,), w_ib_b=(3,), f_b=(3,))

    def __len__(self) -> int:
        return len(self.t_ns)


@dataclass(frozen=True, slots=True, eq=False)
class JointLog:
    """What encoders said, read from a file.

    Attributes
    ----------
    path, topic : str
    t_ns : (n,) int64
        As in `ImuLog`.
    names : k strings
    angles : (n, k)
        [rad].
    rates : (n, k) or None
        [rad/s]; None unless every message has them, all finite.
    """

    path: str
    topic: str
    t_ns: IntArray
    names: tuple[str, ...]
    angles: Array
    rates: Array | None

    def __post_init__(self) -> None:
        k = len(self.names)
        _own(self, t_ns=(), angles=(k,), **({} if self.rates is None else {"rates": (k,)}))

    def __len__(self) -> int:
        return len(self.t_ns)


@dataclass(frozen=True, slots=True, eq=False)
class FixLog:
    """Where satellites saw a vehicle, read from a file.

    Attributes
    ----------
    path, topic : str
    t_ns : (n,) int64
        As in `ImuLog`; n >= 1.
    place : (n, 3)
        Geodetic latitude, longitude [rad], height above the ellipsoid [m], WGS 84.
    variance : (n,)
        Mean of the three components' [m^2]; NaN where the message does not say.
    """

    path: str
    topic: str
    t_ns: IntArray
    place: Array
    variance: Array

    def __post_init__(self) -> None:
        _own(self, t_ns=(), place=(3,), variance=())

    def __len__(self) -> int:
        return len(self.t_ns)


@dataclass(frozen=True, slots=True, eq=False)
class VelocityLog:
    """How fast satellites saw a vehicle move, read from a file.

    Attributes
    ----------
    path, topic : str
    t_ns : (n,) int64
        As in `ImuLog`.
    v : (n, 3)
        East, north, up [m/s], relative to the Earth.
    variance : (n,)
        Mean of the three components' [(m/s)^2]; NaN where the message does not say.
    """

    path: str
    topic: str
    t_ns: IntArray
    v: Array
    variance: Array

    def __post_init__(self) -> None:
        _own(self, t_ns=(), v=(3,), variance=())

    def __len__(self) -> int:
        return len(self.t_ns)


class LogFile:
    """An MCAP file that is open: any MCAP with messages in CDR, ours or a foreign one, or a ROS 2
    bag, whose files are joined.

    Its list of channels and its metadata are read once. Every method raises `StandError` where
    the file is not whole or damaged, where there is no such topic or several to choose from, where
    messages are not CDR, hold a value that is not finite, or stamps that do not increase.
    """

    def __init__(
        self,
        path: str | Path,
        form: LogForm | None = None,
        progress: Callable[[float], None] | None = None,
    ) -> None:
        self.path = str(path)
        self._form = form or LogForm()
        self._progress = progress
        with faults_of(path):
            file = joined(Path(path)) if is_bag(Path(path)) else opened(path)
            try:
                self._messages: Messages = (
                    BagMessages(file) if is_ros1(file) else McapMessages(file)
                )
            except BaseException:
                file.close()
                raise
        self._found = self._messages.found
        self._metadata: dict[str, dict[str, str]] | None = None

    def __enter__(self) -> "LogFile":
        return self

    def __exit__(self, *exc: object) -> None:
        self._messages.close()

    @property
    def metadata(self) -> dict[str, dict[str, str]]:
        """The metadata records, {name: {key: value}}; of equal names the last."""
        if self._metadata is None:
            with faults_of(self.path):
                self._metadata = self._messages.metadata()
        return self._metadata

    def topics(self) -> dict[str, str]:
        """The type of each topic."""
        return {c.topic: self._found.type_name(c) for c in self._found.channels.values()}

    def imu_topics(self) -> list[str]:
        """Those with an IMU's messages."""
        return [topic for topic, kind in self.topics().items() if kind in _IMU_TYPES]

    def imu(self, topic: str | None = None) -> ImuLog:
        """What the IMU said; without a `topic` /imu/data, or the only IMU topic there is."""
        with faults_of(self.path):
            topic = _chosen(self._found, topic, _IMU_TYPES, IMU_TOPIC)
            seen = SharedTopic(self._form.frame, self._form.stamps)
            twice = Repeated()
            names = ("t_ns", "w_ib_b", "f_b")
            columns = self._columns(topic, seen.decode, names, seen=seen, twice=twice)
            doubts = seen.doubts(columns)
        if (turn := self._form.turn()) is not None:
            columns |= {name: turn.of(columns[name]) for name in ("w_ib_b", "f_b")}
        return ImuLog(
            path=self.path,
            topic=topic,
            frame_id=seen.frame,
            metadata=self.metadata,
            notes=twice.notes(),
            doubts=doubts,
            **columns,
        )

    def truth(self) -> TruthLog:
        """The truth of a recorded run, from /imu/truth; its orientations have length 1."""
        with faults_of(self.path):
            topic = _chosen(self._found, TRUTH_TOPIC, _IMU_TYPES, IMU_TOPIC)
            columns = self._columns(topic, decode_imu, ("t_ns", "q", "w_ib_b", "f_b"))
            with located(topic):
                _check_turns(columns["q"])
        return TruthLog(path=self.path, q_wb=columns.pop("q"), **columns)

    def joints(self, topic: str | None = None) -> JointLog:
        """Joint angles; without a `topic` /joint_states, or the only one with joints there is.

        All messages must have the joints of the first, and an angle for each.
        """
        with faults_of(self.path):
            topic = _chosen(self._found, topic, _JOINT_TYPES, ENCODER_TOPIC)
            names: list[tuple[str, ...]] = []

            def decode(
                data: Bytes, starts: IntArray, sizes: IntArray, first: int, *, packed: bool
            ) -> JointBatch:
                known = names[0] if names else None
                batch = decode_joints(data, starts, sizes, first, known, packed=packed)
                if not names:
                    names.append(batch.names)
                return batch

            columns = self._columns(topic, decode, ("t_ns", "angles", "rates"), ("t_ns", "angles"))
        # many drivers have none, or leave them NaN
        if not all(np.isfinite(part).all() for part in in_parts(columns["rates"])):
            columns["rates"] = None
        return JointLog(path=self.path, topic=topic, names=names[0], **columns)

    def fixes(self) -> FixLog:
        """Satellite fixes, from /gnss/fix or the only such topic there is.

        Messages that say that they have no fix are left out; one must have.
        """
        with faults_of(self.path):
            topic = _chosen(self._found, None, _FIX_TYPES, FIX_TOPIC)

            names = ("t_ns", "place", "variance")
            columns = self._columns(topic, decode_fixes, names, ("t_ns", "place"))
            if not len(columns["t_ns"]):
                raise StandError(f"{topic}: no message has a fix: their status is below 0")
        return FixLog(path=self.path, topic=topic, **columns)

    def velocities(self) -> VelocityLog:
        """Satellite velocities, from /gnss/velocity or the only topic of their types.

        The linear part of geometry_msgs/msg/TwistWithCovarianceStamped or TwistStamped counts, as
        east, north, up.
        """
        with faults_of(self.path):
            topic = _chosen(self._found, None, tuple(_VELOCITY_TYPES), VELOCITY_TOPIC)
            has_covariance = _VELOCITY_TYPES[self.topics()[topic]]

            decode = partial(decode_velocities, covariance=has_covariance)
            columns = self._columns(topic, decode, ("t_ns", "v", "variance"), ("t_ns", "v"))
        return VelocityLog(path=self.path, topic=topic, **columns)

    def _columns(
        self,
        topic: str,
        decode: Decode,
        names: Sequence[str],
        finite: Collection[str] | None = None,
        seen: SharedTopic | None = None,
        twice: Repeated | None = None,
    ) -> dict[str, Any]:
        """The named columns of all messages of the topic; all, or those in `finite`, checked.

        `twice` takes note of those that are left out, for they repeat the one before.
        """
        growing: dict[str, Growing] = {}
        for batch, log_ns in self._batches(topic, decode):
            keep = slice(None) if seen is None else seen.rows(batch, log_ns)
            keep = batch.status >= 0 if isinstance(batch, FixBatch) else keep
            stamps = {"t_ns": log_ns} if self._form.stamps == "log" else {}
            read = {name: getattr(batch, name) for name in names} | stamps
            own = {name: values[keep] for name, values in read.items()}
            if twice is not None:
                once = twice.once(*own.values())
                own = {name: values[once] for name, values in own.items()}
            for name, values in own.items():
                growing.setdefault(name, Growing(values)).extend(values)
        with located(topic):
            if not growing:
                raise StandError("has no messages")
            columns = {name: growing[name].whole() for name in names}
            if seen is not None:
                seen.check(columns)
            _check({name: columns[name] for name in finite or names}, self._form.stamps)
        return columns

    def _batches(self, topic: str, decode: Decode) -> Iterator[tuple[Any, IntArray]]:
        """Decoded messages, chunk by chunk, and when they were written."""
        with located(topic):
            ids, packed = _channels(self._found, topic)
        count = 0
        for segment in self._messages.segments():
            rows = np.isin(segment.channel, ids)
            start, size = segment.start[rows], segment.size[rows]
            if len(start):
                with located(topic):
                    yield (
                        decode(segment.data, start, size, count, packed=packed),
                        segment.log_ns[rows],
                    )
                count += len(start)
            if self._progress is not None:
                self._progress(self._messages.done())


def read_imu(path: str | Path, topic: str | None = None) -> ImuLog:
    """`LogFile.imu` of a file that nothing else is read from."""
    with LogFile(path) as file:
        return file.imu(topic)


def read_truth(path: str | Path) -> TruthLog:
    """`LogFile.truth` of a file that nothing else is read from."""
    with LogFile(path) as file:
        return file.truth()


def read_joints(path: str | Path, topic: str | None = None) -> JointLog:
    """`LogFile.joints` of a file that nothing else is read from."""
    with LogFile(path) as file:
        return file.joints(topic)


def read_fixes(path: str | Path) -> FixLog:
    """`LogFile.fixes` of a file that nothing else is read from."""
    with LogFile(path) as file:
        return file.fixes()


def read_velocities(path: str | Path) -> VelocityLog:
    """`LogFile.velocities` of a file that nothing else is read from."""
    with LogFile(path) as file:
        return file.velocities()


def read_metadata(path: str | Path) -> dict[str, dict[str, str]]:
    """`LogFile.metadata` of a file that nothing else is read from."""
    with LogFile(path) as file:
        return file.metadata


def read_attachments(path: str | Path) -> dict[str, bytes]:
    """The attached files of an MCAP file by name; of equal names the last.

    Raises
    ------
    StandError
        Not a whole MCAP file.
    """
    with opened(path) as file, faults_of(path):
        contents = [content for _, content in records(file, (Opcode.ATTACHMENT,))]
        found = [parsed(Attachment.read, content) for content in contents]
    return {record.name: record.data for record in found}


def _chosen(found: Directory, topic: str | None, kinds: Sequence[str], usual: str) -> str:
    """The topic to read, of one of the types `kinds`: the asked one, the usual, or the only one."""
    types = {channel.topic: found.type_name(channel) for channel in found.channels.values()}
    fitting = sorted(name for name, kind in types.items() if kind in kinds)
    if not fitting:
        there = ", ".join(f"{name} ({kind})" for name, kind in sorted(types.items()))
        raise StandError(f"no topic with {kinds[0]}; it has: {there or 'no topics'}")
    if topic is not None and topic not in fitting:
        raise unknown(f"{kinds[0]} topic", topic, fitting)
    if topic is None and len(fitting) > 1 and usual not in fitting:
        several = ", ".join(fitting)
        if kinds is _IMU_TYPES:
            raise StandError(f"several IMU topics, choose one with --topic: {several}")
        raise StandError(f"several topics with {kinds[0]} and none is {usual}: {several}")
    return topic or (usual if usual in fitting else fitting[0])


def _channels(found: Directory, topic: str) -> tuple[list[int], bool]:
    """The ids of the channels of a topic, and whether their messages are packed."""
    channels = [channel for channel in found.channels.values() if channel.topic == topic]
    for channel in channels:
        if channel.message_encoding not in _PACKED:
            raise StandError(
                f"message encoding {channel.message_encoding!r}, must be 'cdr' or 'ros1'"
            )
    kinds = {_PACKED[channel.message_encoding] for channel in channels}
    if len(kinds) > 1:
        raise StandError("messages in 'cdr' and in 'ros1': must be of one encoding")
    return [channel.id for channel in channels], kinds.pop()


def _check(columns: Mapping[str, NDArray[Any]], stamps: str) -> None:
    for name, values in columns.items():
        i = _first(values, lambda part: ~np.isfinite(part))
        if i is not None:
            raise StandError(f"message {i}: {_LABELS[name]} {values[i].tolist()} is not finite")
        most = _MOST.get(name, np.inf)
        i = _first(values, lambda part, most=most: np.abs(part) > most)
        if i is not None:
            told = f"{_LABELS[name]} {values[i].tolist()}: must be at most {most:g}"
            raise StandError(f"message {i}: {told}")
    t_ns = columns["t_ns"]
    i = _first(t_ns, lambda part: np.diff(part) <= 0, more=1)
    if i is not None:
        kind, other = ("header stamp", "log") if stamps == "header" else ("log time", "header")
        raise StandError(
            f"message {i + 1}: {kind} {t_ns[i + 1]} ns is not later than "
            f"{t_ns[i]} ns before it; stamps must increase (or try --stamps {other})"
        )


def _check_turns(q: Array) -> None:
    with np.errstate(over="ignore"):  # of any number that stands there
        i = _first(q, lambda part: np.abs(np.linalg.norm(part, axis=1) - 1.0) > 1e-6)
    if i is not None:
        raise StandError(f"message {i}: {_LABELS['q']} {q[i].tolist()}: must be of length 1")


def _first(
    values: NDArray[Any], odd: Callable[[NDArray[Any]], NDArray[np.bool_]], more: int = 0
) -> int | None:
    """The first row with anything odd; `more` rows behind a part are told with it."""
    for rows in parts(len(values)):
        told = odd(values[rows.start : rows.stop + more])
        found = np.flatnonzero(told.reshape(len(told), -1).any(axis=1))
        release(values)
        if len(found):
            return rows.start + int(found[0])
    return None


Log = ImuLog | TruthLog | JointLog | FixLog | VelocityLog


def _own(log: Log, **shapes: tuple[int, ...]) -> None:
    """Make the arrays owned and read-only; those which already are, as the reader's, stay."""
    for name, shape in shapes.items():
        values = getattr(log, name)
        kind = np.int64 if name == "t_ns" else np.float64
        shape = (len(log.t_ns), *shape)
        if not _is_owned(values, shape, kind):
            object.__setattr__(log, name, owned(values, name, shape, kind))


def _is_owned(values: object, shape: tuple[int, ...], dtype: type) -> bool:
    """Whether it is already what `owned` would make of it."""
    return (
        isinstance(values, np.ndarray)
        and (values.base is None or isinstance(values.base, mmap))
        and not values.flags.writeable
        and values.dtype == dtype
        and values.shape == shape
    )
