"""Reading IMU logs from MCAP files, our own and foreign ones."""

from collections.abc import Iterator, Mapping, Sequence
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

from . import schemas
from .decode import ImuBatch, decode_imu, frame_id
from .records import Directory, directory, opened, records, segments
from .writer import IMU_TOPIC, TRUTH_TOPIC

_IMU_TYPES = (schemas.IMU, "sensor_msgs/Imu")  # the second is its name in ROS 1 and some writers
_LABELS = {
    "t_ns": "stamp",
    "w_ib_b": "angular_velocity",
    "f_b": "linear_acceleration",
    "q": "orientation",
}


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
        topic = _chosen(found, topic)
        frame, columns = _columns(file, found, topic, ("t_ns", "w_ib_b", "f_b"))
        metadata = _metadata(file)
    return ImuLog(path=str(path), topic=topic, frame_id=frame, metadata=metadata, **columns)


def read_truth(path: str | Path) -> TruthLog:
    """The truth of a recorded run, from /imu/truth.

    Raises
    ------
    StandError
        As `read_imu`.
    """
    with opened(path) as file:
        found = directory(file)
        topic = _chosen(found, TRUTH_TOPIC)
        _, columns = _columns(file, found, topic, ("t_ns", "q", "w_ib_b", "f_b"))
    return TruthLog(path=str(path), q_wb=columns.pop("q"), **columns)


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


def _chosen(found: Directory, topic: str | None) -> str:
    """The topic to read: the asked one, /imu/data, or the only one."""
    types = {channel.topic: found.type_name(channel) for channel in found.channels.values()}
    imus = sorted(name for name, kind in types.items() if kind in _IMU_TYPES)
    if not imus:
        there = ", ".join(f"{name} ({kind})" for name, kind in sorted(types.items()))
        raise StandError(f"no topic with {schemas.IMU}; it has: {there or 'no topics'}")
    if topic is not None and topic not in imus:
        raise unknown(f"{schemas.IMU} topic", topic, imus)
    if topic is None and len(imus) > 1 and IMU_TOPIC not in imus:
        raise StandError(f"several IMU topics, choose one with --topic: {', '.join(imus)}")
    return topic or (IMU_TOPIC if IMU_TOPIC in imus else imus[0])


def _columns(
    file: BinaryIO, found: Directory, topic: str, names: Sequence[str]
) -> tuple[str, dict[str, NDArray[Any]]]:
    """The topic's frame_id and the named columns of all its messages, checked."""
    frame = ""
    growing: dict[str, _Growing] = {}
    for frame_here, batch in _batches(file, found, topic):
        frame = frame or frame_here
        for name in names:
            values = getattr(batch, name)
            growing.setdefault(name, _Growing(values)).extend(values)
    with _told_of(topic):
        if not growing:
            raise StandError("has no messages")
        columns = {name: growing[name].whole() for name in names}
        _check(columns)
    return frame, columns


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


def _batches(file: BinaryIO, found: Directory, topic: str) -> Iterator[tuple[str, ImuBatch]]:
    """Decoded messages with the frame_id of their first, chunk by chunk."""
    with _told_of(topic):
        channel_ids = _channel_ids(found, topic)
    count = 0
    for segment in segments(file, found):
        rows = np.isin(segment.channel, channel_ids)
        start, size = segment.start[rows], segment.size[rows]
        if len(start):
            with _told_of(topic):
                batch = decode_imu(segment.data, start, size, first=count)
            yield frame_id(segment.data, int(start[0])), batch
            count += len(start)


def _check(columns: Mapping[str, NDArray[Any]]) -> None:
    for name, values in columns.items():
        odd = np.flatnonzero(~np.isfinite(values).reshape(len(values), -1).all(axis=1))
        if len(odd):
            i = int(odd[0])
            raise StandError(f"message {i}: {_LABELS[name]} {values[i].tolist()} is not finite")
    t_ns = columns["t_ns"]
    back = np.flatnonzero(np.diff(t_ns) <= 0)
    if len(back):
        i = int(back[0])
        raise StandError(
            f"message {i + 1}: header stamp {t_ns[i + 1]} ns is not later than "
            f"{t_ns[i]} ns before it; stamps must increase"
        )


def _own(log: ImuLog | TruthLog, **shapes: tuple[int, ...]) -> None:
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
