"""Reading logs of IMUs, joints and satellite fixes from MCAP files, our own and foreign ones."""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Metadata
from numpy.typing import NDArray

from alignment.arrays import Array, IntArray, owned
from stand.errors import StandError, unknown
from stand.recording.mcap import schemas
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
    frame_id,
)
from stand.recording.mcap.records import Directory, directory, opened, records, segments
from stand.recording.mcap.writer import (
    ENCODER_TOPIC,
    FIX_TOPIC,
    IMU_TOPIC,
    TRUTH_TOPIC,
    VELOCITY_TOPIC,
)

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
Decode = Callable[[Bytes, IntArray, IntArray, int], Batch]
"""A chunk, where its messages begin, their sizes, the first one's number: the messages."""


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
    """

    path: str
    topic: str
    frame_id: str
    t_ns: IntArray
    w_ib_b: Array
    f_b: Array
    metadata: dict[str, dict[str, str]]

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


def read_imu(path: str | Path, topic: str | None = None) -> ImuLog:
    """The IMU log of any MCAP file with sensor_msgs/msg/Imu in CDR.

    Parameters
    ----------
    path : str or Path
    topic : str, optional
        Without it /imu/data, or the only IMU topic there is.

    Raises
    ------
    StandError
        Not a whole, undamaged MCAP file; no such topic, or several to choose from; not CDR; a
        value that is not finite; stamps that do not increase.
    """
    with opened(path) as file:
        found = directory(file)
        topic = _chosen(found, topic, _IMU_TYPES, IMU_TOPIC)
        frames: list[str] = []

        def decode(data: Bytes, starts: IntArray, sizes: IntArray, first: int) -> ImuBatch:
            batch = decode_imu(data, starts, sizes, first)
            if not frames:
                frames.append(frame_id(data, int(starts[0])))
            return batch

        columns = _columns(file, found, topic, decode, ("t_ns", "w_ib_b", "f_b"))
        metadata = _metadata(file)
    return ImuLog(path=str(path), topic=topic, frame_id=frames[0], metadata=metadata, **columns)


def read_truth(path: str | Path) -> TruthLog:
    """The truth of a recorded run, from /imu/truth.

    Raises
    ------
    StandError
        As `read_imu`; or an orientation that is none.
    """
    with opened(path) as file:
        found = directory(file)
        topic = _chosen(found, TRUTH_TOPIC, _IMU_TYPES, IMU_TOPIC)
        columns = _columns(file, found, topic, decode_imu, ("t_ns", "q", "w_ib_b", "f_b"))
        with _told_of(topic):
            _check_turns(columns["q"])
    return TruthLog(path=str(path), q_wb=columns.pop("q"), **columns)


def read_joints(path: str | Path, topic: str | None = None) -> JointLog:
    """The joint angles of any MCAP file with sensor_msgs/msg/JointState in CDR.

    Parameters
    ----------
    path : str or Path
    topic : str, optional
        Without it /joint_states, or the only topic with joints there is.

    Raises
    ------
    StandError
        As `read_imu`; or a message with other joints than the first, or without an angle for each.
    """
    with opened(path) as file:
        found = directory(file)
        topic = _chosen(found, topic, _JOINT_TYPES, ENCODER_TOPIC)
        names: list[tuple[str, ...]] = []

        def decode(data: Bytes, starts: IntArray, sizes: IntArray, first: int) -> JointBatch:
            batch = decode_joints(data, starts, sizes, first, names[0] if names else None)
            if not names:
                names.append(batch.names)
            return batch

        columns = _columns(
            file, found, topic, decode, ("t_ns", "angles", "rates"), ("t_ns", "angles")
        )
    if not np.isfinite(columns["rates"]).all():  # many drivers have none, or leave them NaN
        columns["rates"] = None
    return JointLog(path=str(path), topic=topic, names=names[0], **columns)


def read_fixes(path: str | Path) -> FixLog:
    """The satellite fixes of any MCAP file with sensor_msgs/msg/NavSatFix in CDR.

    From /gnss/fix, or the only such topic there is; messages that say that they have no fix are
    left out.

    Raises
    ------
    StandError
        As `read_imu`; or no message has a fix.
    """
    with opened(path) as file:
        found = directory(file)
        topic = _chosen(found, None, _FIX_TYPES, FIX_TOPIC)

        def decode(data: Bytes, starts: IntArray, sizes: IntArray, first: int) -> FixBatch:
            batch = decode_fixes(data, starts, sizes, first)
            k = batch.status >= 0
            return FixBatch(batch.t_ns[k], batch.status[k], batch.place[k], batch.variance[k])

        names = ("t_ns", "place", "variance")
        columns = _columns(file, found, topic, decode, names, ("t_ns", "place"))
        if not len(columns["t_ns"]):
            raise StandError(f"{topic}: no message has a fix: their status is below 0")
    return FixLog(path=str(path), topic=topic, **columns)


def read_velocities(path: str | Path) -> VelocityLog:
    """The satellite velocities of any MCAP file that has them in CDR.

    From /gnss/velocity, or the only topic with geometry_msgs/msg/TwistWithCovarianceStamped or
    TwistStamped; the linear part counts, as east, north, up.

    Raises
    ------
    StandError
        As `read_imu`.
    """
    with opened(path) as file:
        found = directory(file)
        topic = _chosen(found, None, tuple(_VELOCITY_TYPES), VELOCITY_TOPIC)
        types = {c.topic: found.type_name(c) for c in found.channels.values()}
        has_covariance = _VELOCITY_TYPES[types[topic]]

        def decode(data: Bytes, starts: IntArray, sizes: IntArray, first: int) -> VelocityBatch:
            return decode_velocities(data, starts, sizes, first, has_covariance)

        names = ("t_ns", "v", "variance")
        columns = _columns(file, found, topic, decode, names, ("t_ns", "v"))
    return VelocityLog(path=str(path), topic=topic, **columns)


def read_metadata(path: str | Path) -> dict[str, dict[str, str]]:
    """The metadata records of an MCAP file, {name: {key: value}}; of equal names the last.

    Raises
    ------
    StandError
        Not a whole MCAP file.
    """
    with opened(path) as file:
        return _metadata(file)


def _metadata(file: BinaryIO) -> dict[str, dict[str, str]]:
    contents = [content for _, content in records(file, (Opcode.METADATA,))]
    found = [Metadata.read(ReadDataStream(BytesIO(content))) for content in contents]
    return {record.name: record.metadata for record in found}


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


def _columns(
    file: BinaryIO,
    found: Directory,
    topic: str,
    decode: Decode,
    names: Sequence[str],
    finite: Collection[str] | None = None,
) -> dict[str, Any]:
    """The named columns of all messages of the topic; all, or those in `finite`, checked."""
    growing: dict[str, _Growing] = {}
    for batch in _batches(file, found, topic, decode):
        for name in names:
            values = getattr(batch, name)
            growing.setdefault(name, _Growing(values)).extend(values)
    with _told_of(topic):
        if not growing:
            raise StandError("has no messages")
        columns = {name: growing[name].whole() for name in names}
        _check({name: columns[name] for name in finite or names})
    return columns


class _Growing:
    """An array that grows at its end in place.

    Joining a list of parts would hold the log twice: the parts' memory does not come back.
    """

    def __init__(self, like: NDArray[Any]) -> None:
        self._values = np.empty((0, *like.shape[1:]), like.dtype)
        self._end = 0

    def extend(self, part: NDArray[Any]) -> None:
        start, self._end = self._end, self._end + len(part)
        if self._end > len(self._values):
            self._resize(self._end + self._end // 8)
        self._values[start : self._end] = part

    def whole(self) -> NDArray[Any]:
        """The array at its length, read-only."""
        self._resize(self._end)
        self._values.flags.writeable = False
        return self._values

    def _resize(self, rows: int) -> None:
        # No view of the array leaves this class before `whole`, so nothing can dangle.
        self._values.resize((rows, *self._values.shape[1:]), refcheck=False)


@contextmanager
def _told_of(topic: str) -> Iterator[None]:
    """Faults of the messages, not of the file, are told with their topic."""
    try:
        yield
    except StandError as error:
        raise StandError(f"{topic}: {error}") from error


def _channel_ids(found: Directory, topic: str) -> list[int]:
    channels = [channel for channel in found.channels.values() if channel.topic == topic]
    for channel in channels:
        if channel.message_encoding != "cdr":
            raise StandError(f"message encoding {channel.message_encoding!r}, must be 'cdr'")
    return [channel.id for channel in channels]


def _batches(
    file: BinaryIO, found: Directory, topic: str, decode: Decode
) -> Iterator[tuple[Any, ...]]:
    """Decoded messages, chunk by chunk."""
    with _told_of(topic):
        channel_ids = _channel_ids(found, topic)
    count = 0
    for segment in segments(file, found):
        rows = np.isin(segment.channel, channel_ids)
        start, size = segment.start[rows], segment.size[rows]
        if len(start):
            with _told_of(topic):
                yield decode(segment.data, start, size, count)
            count += len(start)


def _check(columns: Mapping[str, NDArray[Any]]) -> None:
    for name, values in columns.items():
        within = tuple(range(1, values.ndim))
        odd = np.flatnonzero(~np.isfinite(values).all(axis=within))
        if len(odd):
            i = int(odd[0])
            raise StandError(f"message {i}: {_LABELS[name]} {values[i].tolist()} is not finite")
        most = _MOST.get(name, np.inf)
        odd = np.flatnonzero((np.abs(values) > most).any(axis=within))
        if len(odd):
            i = int(odd[0])
            told = f"{_LABELS[name]} {values[i].tolist()}: must be at most {most:g}"
            raise StandError(f"message {i}: {told}")
    t_ns = columns["t_ns"]
    back = np.flatnonzero(np.diff(t_ns) <= 0)
    if len(back):
        i = int(back[0])
        raise StandError(
            f"message {i + 1}: header stamp {t_ns[i + 1]} ns is not later than "
            f"{t_ns[i]} ns before it; stamps must increase"
        )


def _check_turns(q: Array) -> None:
    odd = np.flatnonzero(np.abs(np.linalg.norm(q, axis=1) - 1.0) > 1e-6)
    if len(odd):
        i = int(odd[0])
        raise StandError(f"message {i}: {_LABELS['q']} {q[i].tolist()}: must be of length 1")


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
        and values.base is None
        and not values.flags.writeable
        and values.dtype == dtype
        and values.shape == shape
    )
