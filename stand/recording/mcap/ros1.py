"""Messages of a ROS 1 bag, version 2.0 (wiki.ros.org/Bags/Format/2.0).

Read from front to back, chunk by chunk, into the same segments as an MCAP: the library that reads
such bags makes several Python objects per message, which is gigabytes for an hour at 1 kHz. Every
length is held against what is there before anything is read or expanded.
"""

import bz2
import struct
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import BinaryIO

import numpy as np
from lz4.frame import LZ4FrameDecompressor
from mcap.records import Channel, Schema

from stand.errors import StandError
from stand.recording.mcap.cdr import NS_PER_S, Bytes
from stand.recording.mcap.decode import gather
from stand.recording.mcap.records import MOST_CHUNK_BYTES, Directory, Segment, no_messages

MAGIC = b"#ROSBAG V2.0\n"
_ANY_VERSION = b"#ROSBAG V"
_MESSAGE, _BAG, _CHUNK, _CONNECTION = 2, 3, 5, 7
_U4 = struct.Struct("<I")
_MOST_HEADER = 1 << 20  # bytes; a connection's has the type's definition, some kB
_LAYOUTS = 8  # of message headers that are read many at once; one writer has one

Fields = dict[str, bytes]


def is_ros1(file: BinaryIO) -> bool:
    """Whether an open file is a ROS 1 bag of any version."""
    file.seek(0)
    return file.read(len(_ANY_VERSION)) == _ANY_VERSION


class BagMessages:
    """Those of a ROS 1 bag that is open.

    Raises
    ------
    StandError
        Another version, encrypted, cut off, or damaged.
    """

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self._size = file.seek(0, 2)
        self.found = Directory()
        file.seek(0)
        head = file.read(len(MAGIC))
        if head != MAGIC:
            told = head.decode(errors="replace").strip()
            raise StandError(f"{told}: only version 2.0 is read: rosbag fix makes it so")
        fields, _ = self._record()
        if fields.get("op") != bytes([_BAG]):
            raise StandError("damaged: the bag's header is not where it must be")
        if fields.get("encryptor"):
            raise StandError("the bag is encrypted")
        self._first = file.tell()
        self._index(fields)

    def segments(self) -> Iterator[Segment]:
        """The messages chunk by chunk, in the order of the file; checked."""
        self._file.seek(self._first)
        while self._file.tell() < self._size:
            fields, data = self._record(wanted=(_CHUNK, _CONNECTION))
            op = _op(fields)
            if op == _CONNECTION:
                self._connect(fields, data)
            elif op == _CHUNK:
                yield self._segment(_expanded(fields, data))

    def metadata(self) -> dict[str, dict[str, str]]:
        """There is none in such bags."""
        return {}

    def done(self) -> float:
        """The part read, 0 to 1."""
        return self._file.tell() / self._size

    def close(self) -> None:
        self._file.close()

    def _index(self, fields: Fields) -> None:
        """The connections, of the index at the end; without one from the whole bag."""
        with suppress(StandError, KeyError, struct.error):
            self._file.seek(min(struct.unpack("<Q", fields["index_pos"])[0], self._size))
            while self._file.tell() < self._size:
                record, data = self._record(wanted=(_CONNECTION,))
                if _op(record) == _CONNECTION:
                    self._connect(record, data)
        if not self.found.channels:
            for _ in self.segments():
                pass

    def _record(self, wanted: tuple[int, ...] = ()) -> tuple[Fields, bytes]:
        """The next record: its header, and its data if it is of a wanted kind."""
        fields = _fields(self._part(_MOST_HEADER))
        if fields and _op(fields) in wanted:
            return fields, self._part(self._size)
        size = self._length()
        self._file.seek(size, 1)
        return fields, b""

    def _length(self) -> int:
        head = self._file.read(_U4.size)
        size = _U4.unpack(head)[0] if len(head) == _U4.size else self._size
        if size > self._size - self._file.tell():
            raise StandError(
                f"cut off or damaged at byte {self._file.tell()}; rosbag reindex saves what is "
                "whole"
            )
        return size

    def _part(self, most: int) -> bytes:
        size = self._length()
        if size > most:
            raise StandError(f"damaged: a header of {size} bytes at byte {self._file.tell()}")
        return self._file.read(size)

    def _connect(self, fields: Fields, data: bytes) -> None:
        """Take in a connection: a number, a topic, and its type."""
        more = fields | _fields(data)
        if not {"conn", "topic", "type"} <= set(more) or len(more["conn"]) != _U4.size:
            raise StandError("damaged: a connection without number, topic or type")
        number = _U4.unpack(more["conn"])[0]
        topic, kind = (more[name].decode(errors="replace") for name in ("topic", "type"))
        self.found.schemas[number + 1] = Schema(
            id=number + 1, name=kind, encoding="ros1msg", data=b""
        )
        self.found.channels[number] = Channel(
            id=number, topic=topic, message_encoding="ros1", metadata={}, schema_id=number + 1
        )

    def _segment(self, data: bytes) -> Segment:
        """Finds the messages of a chunk; the loop does no more than step from record to record."""
        places: list[tuple[int, int, int]] = []
        at, end, length = 0, len(data), _U4.unpack_from
        while at + 8 <= end:
            head = length(data, at)[0]
            body = at + 4 + head
            if body + 4 > end:
                break
            size = length(data, body)[0]
            places.append((at + 4, head, size))
            at = body + 4 + size
        if at != end:
            raise StandError("damaged: a record reaches past the end of its chunk")
        if not places:
            return no_messages(np.frombuffer(data, np.uint8))
        return self._located(np.frombuffer(data, np.uint8), np.array(places, np.int64))

    def _located(self, data: Bytes, places: np.ndarray) -> Segment:
        """The messages among records (n, 3): where the header begins, its size, the data's."""
        at, head, size = places.T
        op = np.zeros(len(at), np.int64)
        channel, log_ns = op.copy(), op.copy()
        left = np.ones(len(at), bool)
        for _ in range(_LAYOUTS):
            if not left.any():
                break
            row = int(np.argmax(left))
            alike = np.flatnonzero(left & (head == head[row]))
            heads = gather(data, at[alike], ("u1", (int(head[row]),))) if head[row] else None
            fields = _places(data[at[row] : at[row] + head[row]].tobytes())
            if heads is None or fields["op"][1] != 1:
                raise StandError("damaged: a record without a kind")
            same = _same(heads, int(np.searchsorted(alike, row)), fields)
            alike, heads = alike[same], heads[same]
            op[alike] = heads[:, fields["op"][0]]
            if op[row] == _MESSAGE:
                channel[alike] = _numbers(heads, fields, "conn", 1)[:, 0]
                time = _numbers(heads, fields, "time", 2)
                log_ns[alike] = time[:, 0] * NS_PER_S + time[:, 1]
            left[alike] = False
        for k in np.flatnonzero(left):
            self._one(data, places[k], (op, channel, log_ns), int(k))
        for k in np.flatnonzero(op == _CONNECTION):
            a, h, n = places[k]
            body = a + h + 4
            self._connect(_fields(data[a : a + h].tobytes()), data[body : body + n].tobytes())
        rows = op == _MESSAGE
        return Segment(
            data=data,
            channel=channel[rows],
            start=(at + head + 4)[rows],
            size=size[rows],
            log_ns=log_ns[rows],
        )

    def _one(self, data: Bytes, place: np.ndarray, found: tuple[np.ndarray, ...], k: int) -> None:
        """One record whose header is like none of many."""
        fields = _fields(data[place[0] : place[0] + place[1]].tobytes())
        found[0][k] = _op(fields)
        if found[0][k] == _MESSAGE:
            conn, time = fields.get("conn", b""), fields.get("time", b"")
            if len(conn) != 4 or len(time) != 8:
                raise StandError("damaged: a message without connection or time")
            found[1][k] = _U4.unpack(conn)[0]
            found[2][k] = _U4.unpack(time[:4])[0] * NS_PER_S + _U4.unpack(time[4:])[0]


def _places(header: bytes) -> dict[str, tuple[int, int]]:
    """Where in a header the value of each field begins, and its size."""
    found: dict[str, tuple[int, int]] = {}
    at = 0
    while at + 4 <= len(header):
        size = _U4.unpack_from(header, at)[0]
        name, equals, value = header[at + 4 : at + 4 + size].partition(b"=")
        if not equals or at + 4 + size > len(header):
            break
        found[name.decode(errors="replace")] = (at + 4 + size - len(value), len(value))
        at += 4 + size
    if at != len(header) or (header and "op" not in found):
        raise StandError("damaged: the header of a record")
    return found


def _fields(header: bytes) -> Fields:
    """The fields of a header; of a connection's data too, which has no kind."""
    found: Fields = {}
    at = 0
    while at + 4 <= len(header):
        size = _U4.unpack_from(header, at)[0]
        name, equals, value = header[at + 4 : at + 4 + size].partition(b"=")
        if not equals or at + 4 + size > len(header):
            break
        found[name.decode(errors="replace")] = value
        at += 4 + size
    if at != len(header):
        raise StandError("damaged: the header of a record")
    return found


def _op(fields: Fields) -> int:
    op = fields.get("op", b"")
    return op[0] if len(op) == 1 else 0


def _same(heads: Bytes, row: int, fields: dict[str, tuple[int, int]]) -> np.ndarray:
    """Which headers (n, size) have the layout and kind of that of `row`."""
    fixed = np.ones(heads.shape[1], bool)
    for name in ("conn", "time"):
        if name in fields:
            start, size = fields[name]
            fixed[start : start + size] = False
    return (heads[:, fixed] == heads[row, fixed]).all(axis=1)


def _numbers(heads: Bytes, fields: dict[str, tuple[int, int]], name: str, count: int) -> np.ndarray:
    """`count` numbers (n, count) of a field of headers."""
    start, size = fields.get(name, (0, 0))
    if size != 4 * count:
        raise StandError("damaged: a message without connection or time")
    part = np.ascontiguousarray(heads[:, start : start + size])
    return part.view("<u4").astype(np.int64)


def _bz2(data: bytes, size: int) -> bytes:
    return bz2.BZ2Decompressor().decompress(data, max_length=size + 1)


def _lz4(data: bytes, size: int) -> bytes:
    return LZ4FrameDecompressor().decompress(data, max_length=size + 1)


_EXPAND: dict[str, Callable[[bytes, int], bytes]] = {
    "none": lambda data, size: data,
    "bz2": _bz2,
    "lz4": _lz4,
}


def _expanded(fields: Fields, data: bytes) -> bytes:
    """A chunk's records."""
    compression = fields.get("compression", b"").decode(errors="replace")
    if compression not in _EXPAND:
        raise StandError(f"unknown compression {compression!r}: known: {', '.join(_EXPAND)}")
    if len(fields.get("size", b"")) != _U4.size:
        raise StandError("damaged: a chunk that does not state its size")
    size = _U4.unpack(fields["size"])[0]
    if size > MOST_CHUNK_BYTES:
        raise StandError(f"damaged: a chunk of {size} bytes, must be at most {MOST_CHUNK_BYTES}")
    try:
        found = _EXPAND[compression](data, size)
    except (OSError, RuntimeError, EOFError, ValueError) as error:
        raise StandError(f"damaged: a chunk cannot be expanded: {error}") from error
    if len(found) != size:
        raise StandError(f"damaged: a chunk holds other than the {size} bytes that it states")
    return found
