"""The MCAP container: chunks of messages built with numpy, then index, statistics and footer.

Messages of one part have one length, so a chunk is a few matrices of bytes whose rows are
scattered into time order; no Python object exists per message. mcap.dev/spec has the format.
"""

import os
import struct
import time
import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from io import BytesIO
from os import SEEK_END
from pathlib import Path
from typing import Any, Self

import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)
from numpy.typing import NDArray

from alignment.arrays import IntArray
from stand.errors import StandError
from stand.recording.mcap.cdr import Bytes

MAGIC = b"\x89MCAP0\r\n"
_LIBRARY = "imu-test-stand"
_ZSTD_LEVEL = 1
MESSAGE_HEAD = np.dtype(
    [
        ("opcode", "u1"),
        ("size", "<u8"),
        ("channel", "<u2"),
        ("sequence", "<u4"),
        ("log_time", "<u8"),
        ("publish_time", "<u8"),
    ]
)
_HEAD = struct.Struct("<BQ")
OPCODE_AND_SIZE = _HEAD.size
SYNC_S = 1.0
"""What the operating system holds for longer is brought to the disk with the next chunk."""


@dataclass(frozen=True, slots=True)
class Topic:
    """A topic, its type by ROS name, the type's definition and the publisher's QoS (YAML)."""

    name: str
    type_name: str
    definition: str
    qos: str


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """Messages of one topic and one length.

    `topic` counts from 0; `log_time` (n,) int64 [ns] does not decrease; `payload` (n, length).
    """

    topic: int
    log_time: IntArray
    payload: Bytes


@dataclass(slots=True)
class _Chunks:
    """The index of all chunks as the summary will have it: 0.1 kB each, of days 10 MB."""

    written: bytearray = field(default_factory=bytearray)
    count: int = 0
    start_ns: int = 0
    end_ns: int = 0

    def append(self, entry: ChunkIndex) -> None:
        self.written += _records([entry])
        first = entry.message_start_time
        self.start_ns = min(self.start_ns, first) if self.count else first
        self.end_ns = max(self.end_ns, entry.message_end_time)
        self.count += 1


@dataclass(slots=True)
class _Index:
    """What the summary will say."""

    chunks: _Chunks = field(default_factory=_Chunks)
    attachments: list[AttachmentIndex] = field(default_factory=list)
    metadata: list[MetadataIndex] = field(default_factory=list)
    counts: dict[int, int] = field(default_factory=dict)


class Container:
    """An MCAP file being written; every chunk reaches the operating system as it is written, and
    the disk within a second: the first survives a process that is killed, the second a power cut.

    As a context manager it finishes the file, or abandons it after an exception. `profile` as in
    its head.

    Raises
    ------
    StandError
        The file cannot be created, or what follows cannot be written.
    """

    def __init__(
        self, path: str | Path, topics: Sequence[Topic] = (), profile: str = "ros2"
    ) -> None:
        self._path = path
        try:
            self._file = open(path, "wb")  # noqa: SIM115 (lives as long as the container)
        except OSError as error:
            raise self._fault(error) from error
        self._schemas = _schemas(topics)
        self._channels = _channels(topics, self._schemas)
        self._compressor = zstandard.ZstdCompressor(level=_ZSTD_LEVEL)
        self._index = _Index()
        self._position = 0
        self._crc = 0
        self._synced = time.monotonic()
        head = _records([Header(profile, _LIBRARY), *self._schemas, *self._channels])
        self._write(MAGIC + head)

    def metadata(self, name: str, values: Mapping[str, str]) -> None:
        """A Metadata record."""
        start = self._position
        # a file's name may be no text in UTF-8, which all strings here must be
        texts = {k: v.encode("utf-8", "replace").decode() for k, v in values.items()}
        self._write(_records([Metadata(name, texts)]))
        self._index.metadata.append(MetadataIndex(start, self._position - start, name))

    def attachment(self, name: str, media_type: str, data: bytes, time_ns: int) -> None:
        """An Attachment record."""
        start = self._position
        self._write(_records([Attachment(time_ns, time_ns, name, media_type, data)]))
        size = self._position - start
        self._index.attachments.append(
            AttachmentIndex(start, size, time_ns, time_ns, len(data), name, media_type)
        )

    def chunk(self, parts: Sequence[Part]) -> None:
        """One chunk: the parts' messages by log time; at equal times in the order of `parts`."""
        parts = [part for part in parts if len(part.log_time)]
        if not parts:
            return
        starts, end = _starts(parts)
        data = self._laid_out(parts, starts, end).data
        first = min(int(part.log_time[0]) for part in parts)
        last = max(int(part.log_time[-1]) for part in parts)
        record = Chunk(
            "zstd", self._compressor.compress(data), last, first, zlib.crc32(data), len(data)
        )
        entries: dict[int, list[NDArray[np.uint64]]] = {}
        for part, places in zip(parts, starts, strict=True):
            pairs = np.stack([part.log_time, places], axis=1).astype("<u8")
            entries.setdefault(part.topic + 1, []).append(pairs)
        self._indexed_chunk(record, {c: np.concatenate(pairs) for c, pairs in entries.items()})

    def copied_chunk(self, record: Chunk, pairs: Mapping[int, NDArray[np.uint64]]) -> None:
        """A chunk of another file as it is, indexed anew.

        `pairs` by channel: (log time, place in the expanded chunk) of its messages, (n, 2).
        """
        for channel, own in pairs.items():
            self._index.counts[channel] = self._index.counts.get(channel, 0) + len(own)
        self._indexed_chunk(record, pairs)

    def copied(self, opcode: int, content: bytes) -> None:
        """A record of another file as it is: a Schema, Channel, Metadata or Attachment."""
        start = self._position
        self._write(_HEAD.pack(opcode, len(content)) + content)
        size = self._position - start
        stream = ReadDataStream(BytesIO(content))
        if opcode == Opcode.SCHEMA:
            self.known(schema=Schema.read(stream))
        elif opcode == Opcode.CHANNEL:
            self.known(channel=Channel.read(stream))
        elif opcode == Opcode.METADATA:
            name = Metadata.read(stream).name
            self._index.metadata.append(MetadataIndex(start, size, name))
        elif opcode == Opcode.ATTACHMENT:
            a = Attachment.read(stream)
            self._index.attachments.append(
                AttachmentIndex(
                    start, size, a.create_time, a.log_time, len(a.data), a.name, a.media_type
                )
            )

    def known(self, schema: Schema | None = None, channel: Channel | None = None) -> None:
        """A definition that lies in the file already; the summary repeats it."""
        if schema is not None and schema.id not in [s.id for s in self._schemas]:
            self._schemas.append(schema)
        if channel is not None and channel.id not in [c.id for c in self._channels]:
            self._channels.append(channel)

    def _indexed_chunk(self, record: Chunk, pairs: Mapping[int, NDArray[np.uint64]]) -> None:
        """Write a chunk and a MessageIndex record per channel; flush, and sync in time."""
        position = self._position
        self._write(_records([record]))
        size = self._position - position
        places = {}
        for channel, own in pairs.items():
            places[channel] = self._position
            self._write(_message_index(channel, own))
        self._index.chunks.append(
            ChunkIndex(
                chunk_length=size,
                chunk_start_offset=position,
                compression=record.compression,
                compressed_size=len(record.data),
                message_end_time=record.message_end_time,
                message_index_length=self._position - position - size,
                message_index_offsets=places,
                message_start_time=record.message_start_time,
                uncompressed_size=record.uncompressed_size,
            )
        )
        with self._told():
            self._file.flush()
            if time.monotonic() - self._synced > SYNC_S:
                os.fsync(self._file.fileno())
                self._synced = time.monotonic()

    def finish(self) -> None:
        """Write what follows the data, close the file, and read back what every reader needs.

        Raises
        ------
        StandError
            It is not there as it was written. The chunks are not read again: what the operating
            system took without a complaint it gives back.
        """
        self._write(_records([DataEnd(self._crc)]))
        start = self._position
        summary, offsets = _summary(self._summary_groups(), start)
        footer = Footer(start, start + len(summary), 0)
        footer.summary_crc = zlib.crc32(summary + offsets + _records([footer])[:-4])
        end = summary + offsets + _records([footer]) + MAGIC
        self._write(end)
        with self._told():
            self._file.flush()
            os.fsync(self._file.fileno())
            self._file.close()
            with open(self._path, "rb") as file:
                size = file.seek(0, SEEK_END)
                file.seek(start)
                whole = size == self._position and file.read() == end
        if not whole:
            raise StandError(f"{self._path}: cannot be written: its end is not there")

    def abandon(self) -> None:
        """Close the file as it is: whole chunks, no summary, no footer."""
        with suppress(OSError):  # of a full disk once more: that was told
            self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is None:
            self.finish()
        else:
            self.abandon()

    @contextmanager
    def _told(self) -> Iterator[None]:
        """Faults of the disk end the file, and are told with its name."""
        try:
            yield
        except OSError as error:
            self.abandon()
            raise self._fault(error) from error

    def _fault(self, error: OSError) -> StandError:
        return StandError(f"{self._path}: cannot be written: {error.strerror}")

    def _write(self, data: bytes) -> None:
        with self._told():
            self._file.write(data)
        self._position += len(data)
        self._crc = zlib.crc32(data, self._crc)

    def _laid_out(self, parts: Sequence[Part], starts: Sequence[IntArray], end: int) -> Bytes:
        """The chunk's records; sequence numbers go on from the topics' earlier messages."""
        data = np.empty(end, np.uint8)
        for part, places in zip(parts, starts, strict=True):
            channel = part.topic + 1
            count = self._index.counts.get(channel, 0)
            _scatter(data, places, _heads(part, channel, count))
            _scatter(data, places + MESSAGE_HEAD.itemsize, part.payload)
            self._index.counts[channel] = count + len(places)
        return data

    def _summary_groups(self) -> list[tuple[Opcode, bytes]]:
        return [
            (Opcode.SCHEMA, _records(self._schemas)),
            (Opcode.CHANNEL, _records(self._channels)),
            (Opcode.STATISTICS, _records([self._statistics()])),
            (Opcode.CHUNK_INDEX, bytes(self._index.chunks.written)),
            (Opcode.ATTACHMENT_INDEX, _records(self._index.attachments)),
            (Opcode.METADATA_INDEX, _records(self._index.metadata)),
        ]

    def _statistics(self) -> Statistics:
        index = self._index
        return Statistics(
            attachment_count=len(index.attachments),
            channel_count=len(self._channels),
            channel_message_counts=index.counts,
            chunk_count=index.chunks.count,
            message_count=sum(index.counts.values()),
            message_end_time=index.chunks.end_ns,
            message_start_time=index.chunks.start_ns,
            metadata_count=len(index.metadata),
            schema_count=len(self._schemas),
        )


def _schemas(topics: Sequence[Topic]) -> list[Schema]:
    texts = {topic.type_name: topic.definition for topic in topics}
    return [
        Schema(id=i, data=text.encode(), encoding="ros2msg", name=name)
        for i, (name, text) in enumerate(texts.items(), start=1)
    ]


def _channels(topics: Sequence[Topic], schemas: Sequence[Schema]) -> list[Channel]:
    ids = {schema.name: schema.id for schema in schemas}
    return [
        Channel(
            id=i,
            topic=topic.name,
            message_encoding="cdr",
            metadata={"offered_qos_profiles": topic.qos},
            schema_id=ids[topic.type_name],
        )
        for i, topic in enumerate(topics, start=1)
    ]


def _records(records: Iterable[McapRecord]) -> bytes:
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    return builder.end()


def _heads(part: Part, channel: int, sequence: int) -> Bytes:
    """The heads of the part's message records, (n, 31)."""
    n, length = part.payload.shape
    head = np.empty(n, MESSAGE_HEAD)
    head["opcode"] = Opcode.MESSAGE
    head["size"] = MESSAGE_HEAD.itemsize - OPCODE_AND_SIZE + length
    head["channel"] = channel
    head["sequence"] = np.arange(sequence, sequence + n)
    head["log_time"] = part.log_time
    head["publish_time"] = part.log_time
    return head.view(np.uint8).reshape(n, MESSAGE_HEAD.itemsize)


def _starts(parts: Sequence[Part]) -> tuple[list[IntArray], int]:
    """Where each message record begins when all are put in order of time (stable); the end."""
    counts = [len(part.log_time) for part in parts]
    times = np.concatenate([part.log_time for part in parts])
    sizes = np.repeat([MESSAGE_HEAD.itemsize + part.payload.shape[1] for part in parts], counts)
    order = np.argsort(times, kind="stable")
    ends = np.cumsum(sizes[order])
    starts = np.empty(len(times), np.int64)
    starts[order] = ends - sizes[order]
    return np.split(starts, np.cumsum(counts)[:-1]), int(ends[-1])


def _scatter(out: Bytes, starts: IntArray, rows: Bytes) -> None:
    """Put each row of bytes at its place in `out`."""
    width = rows.shape[1]
    windows = np.ndarray((len(out) - width + 1, width), np.uint8, out.data, strides=(1, 1))
    windows[starts] = rows


def _message_index(channel: int, pairs: NDArray[Any]) -> bytes:
    """A MessageIndex record from (log time, offset) pairs, without a Python object per entry."""
    body = pairs.tobytes()
    head = np.zeros((), [("opcode", "u1"), ("size", "<u8"), ("channel", "<u2"), ("bytes", "<u4")])
    head["opcode"] = Opcode.MESSAGE_INDEX
    head["size"] = head.itemsize - OPCODE_AND_SIZE + len(body)
    head["channel"] = channel
    head["bytes"] = len(body)
    return head.tobytes() + body


def _summary(groups: Iterable[tuple[Opcode, bytes]], start: int) -> tuple[bytes, bytes]:
    """The summary section and the summary offset section."""
    summary = bytearray()
    offsets = []
    for opcode, data in groups:
        if data:
            offsets.append(SummaryOffset(opcode, start + len(summary), len(data)))
        summary += data
    return bytes(summary), _records(offsets)
