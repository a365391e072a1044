"""Walking through an MCAP file: its records, and the messages of its chunks, checked."""

import struct
import zlib
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import BinaryIO, Protocol, TypeVar

import numpy as np
import zstandard
from lz4.frame import LZ4FrameDecompressor
from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, DataEnd, Footer, Metadata, Schema

from alignment.arrays import IntArray
from stand.errors import StandError
from stand.folder import refuse_no_file
from stand.recording.mcap.cdr import Bytes
from stand.recording.mcap.container import MAGIC, MESSAGE_HEAD, OPCODE_AND_SIZE
from stand.recording.mcap.decode import gather

_HEAD = struct.Struct("<BQ")
_FOOTER_SIZE = _HEAD.size + 20
_ROS1 = b"#ROSBAG "  # which checks its own ends
_CRC_SIZE = 4
_SEGMENT_BYTES = 1 << 20
MOST_CHUNK_BYTES = 256 << 20
"""Of a chunk when it is expanded: ours have some 100 kB, those of others a few MB."""
_COMPRESSIONS = {"": "none", "lz4": "lz4", "zstd": "zstd"}
_DEFINITIONS = (Opcode.SCHEMA, Opcode.CHANNEL)


@dataclass(frozen=True, slots=True, eq=False)
class Segment:
    """Some records as they lie in the file: `data`, and where its messages are.

    Attributes
    ----------
    data : (bytes,) uint8
    channel, start, size : (n,) int64
        Of each message: its channel's id, and where its payload lies in `data`.
    log_ns : (n,) int64
        When it was written [ns].
    """

    data: Bytes
    channel: IntArray
    start: IntArray
    size: IntArray
    log_ns: IntArray


@dataclass(frozen=True, slots=True)
class Directory:
    """The channels and schemas met so far, by id."""

    channels: dict[int, Channel] = field(default_factory=dict)
    schemas: dict[int, Schema] = field(default_factory=dict)

    def add(self, opcode: int, content: bytes) -> None:
        """Take in a Schema or Channel record."""
        if opcode == Opcode.SCHEMA:
            schema = parsed(Schema.read, content)
            self.schemas[schema.id] = schema
        elif opcode == Opcode.CHANNEL:
            channel = parsed(Channel.read, content)
            self.channels[channel.id] = channel

    def type_name(self, channel: Channel) -> str:
        """The channel's message type."""
        schema = self.schemas.get(channel.schema_id)
        return schema.name if schema else "no type"


def opened(path: str | Path) -> BinaryIO:
    """An MCAP file from end to end.

    Raises
    ------
    StandError
        Missing, a folder, not MCAP, cut off.
    """
    with faults_of(path):
        refuse_no_file(Path(path))
        file = open(path, "rb")  # noqa: SIM115  the caller closes it
        try:
            _check_ends(file)
        except BaseException:
            file.close()
            raise
    return file


@contextmanager
def faults_of(path: str | Path) -> Iterator[None]:
    """Whatever is found wrong with a file is told with its name, as a `StandError`."""
    try:
        yield
    except FileNotFoundError as error:
        raise StandError(f"{path}: no such file") from error
    except IsADirectoryError as error:
        raise StandError(f"{path}: is a folder, must be an MCAP file") from error
    except OSError as error:
        raise StandError(f"{path}: cannot be read: {error.strerror}") from error
    except StandError as error:
        raise StandError(f"{path}: {str(error).removeprefix(f'{path}: ')}") from error


RecordT = TypeVar("RecordT")


def parsed(read: Callable[[ReadDataStream], RecordT], content: bytes) -> RecordT:
    """A record as the mcap package reads it; `StandError` where its bytes make no sense."""
    try:
        return read(ReadDataStream(BytesIO(content)))
    except (EndOfFile, struct.error, OverflowError) as error:  # lengths up to 2^64
        raise StandError("damaged: a record is too short") from error
    except UnicodeDecodeError as error:
        raise StandError(f"damaged: text of a record: {error}") from error


def _check_ends(file: BinaryIO) -> None:
    head = file.read(len(MAGIC))
    if head == _ROS1:
        return
    if head != MAGIC:
        raise StandError("not an MCAP file")
    size = file.seek(0, 2)
    file.seek(max(size - len(MAGIC), 0))
    if size < 2 * len(MAGIC) + _FOOTER_SIZE or file.read() != MAGIC:
        raise StandError("cut off before its end; stand recover saves what is whole")


def records(
    file: BinaryIO, wanted: Collection[int], start: int = len(MAGIC), checked: bool = False
) -> Iterator[tuple[int, bytes]]:
    """(opcode, content) of the wanted records from byte `start` up to the footer.

    `checked` reads also the rest, and compares the checksums of the data (from the file's
    start) and of the summary.
    """
    end = file.seek(0, 2) - len(MAGIC)
    crc = zlib.crc32(MAGIC)
    if start > end:
        raise StandError(f"damaged: the summary is said to begin at byte {start}, behind the end")
    file.seek(start)
    opcode = None
    while opcode != Opcode.FOOTER:
        head = file.read(_HEAD.size)
        if len(head) < _HEAD.size:
            raise StandError("damaged: a record is too short")
        opcode, size = _HEAD.unpack(head)
        if file.tell() + size > end:
            raise StandError(f"damaged: a record reaches past the end, at byte {file.tell()}")
        if not checked and opcode not in wanted:
            file.seek(size, 1)
            continue
        content = file.read(size)
        if checked:
            crc = _checked_crc(opcode, head, content, crc)
        if opcode in wanted:
            yield opcode, content


def whole_records(file: BinaryIO) -> Iterator[tuple[int, bytes]]:
    """(opcode, content) of the records of a file that may be cut off: up to DataEnd, or to the
    first that is not whole.
    """
    end = file.seek(0, 2)
    file.seek(len(MAGIC))
    while True:
        head = file.read(_HEAD.size)
        if len(head) < _HEAD.size:
            return
        opcode, size = _HEAD.unpack(head)
        if opcode == 0 or size > end - file.tell():  # zeros: what a power cut leaves
            return
        yield opcode, file.read(size)
        if opcode == Opcode.DATA_END:
            return


def _checked_crc(opcode: int, head: bytes, content: bytes, crc: int) -> int:
    """The running checksum after a record; the data's ends at DataEnd, the summary's begins."""
    if opcode == Opcode.DATA_END:
        stated = parsed(DataEnd.read, content).data_section_crc
        _compare("the data", stated, crc)
        return 0
    if opcode == Opcode.FOOTER:
        stated = parsed(Footer.read, content).summary_crc
        _compare("the summary", stated, zlib.crc32(head + content[:-_CRC_SIZE], crc))
    return zlib.crc32(head + content, crc)


def _compare(what: str, stated: int, found: int) -> None:
    """Checksums must agree; 0 means that the writer gave none."""
    if stated not in (0, found):
        raise StandError(f"damaged: checksum of {what} is {found:#010x}, must be {stated:#010x}")


class Messages(Protocol):
    """Messages as they lie in a file, whatever its kind."""

    found: Directory

    def segments(self) -> Iterator[Segment]: ...
    def metadata(self) -> dict[str, dict[str, str]]: ...
    def done(self) -> float: ...
    def close(self) -> None: ...


class McapMessages:
    """Those of an MCAP file that is open."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self._size = max(file.seek(0, 2), 1)
        self.found = directory(file)

    def segments(self) -> Iterator[Segment]:
        """The messages, as `segments` of an open file."""
        return segments(self._file, self.found)

    def metadata(self) -> dict[str, dict[str, str]]:
        """The metadata records, {name: {key: value}}; of equal names the last."""
        contents = [content for _, content in records(self._file, (Opcode.METADATA,))]
        found = [parsed(Metadata.read, content) for content in contents]
        return {record.name: record.metadata for record in found}

    def done(self) -> float:
        """The part read, 0 to 1."""
        return self._file.tell() / self._size

    def close(self) -> None:
        self._file.close()


def directory(file: BinaryIO) -> Directory:
    """All channels and schemas: from the summary, or else from the whole file."""
    found = Directory()
    file.seek(-len(MAGIC) - _FOOTER_SIZE + _HEAD.size, 2)
    start = parsed(Footer.read, file.read(_FOOTER_SIZE - _HEAD.size)).summary_start
    if start:
        for opcode, content in records(file, _DEFINITIONS, start):
            found.add(opcode, content)
    if not found.channels:
        for _ in segments(file, found):
            pass
    return found


def segments(file: BinaryIO, found: Directory) -> Iterator[Segment]:
    """The file's messages chunk by chunk (those outside of chunks by megabyte), in file order.

    Adds the schemas and channels it meets to `found`. All checksums are compared.
    """
    loose = bytearray()
    for opcode, content in records(
        file, (*_DEFINITIONS, Opcode.MESSAGE, Opcode.CHUNK), checked=True
    ):
        is_chunk = opcode == Opcode.CHUNK
        if not is_chunk:
            loose += _HEAD.pack(opcode, len(content)) + content
        if loose and (is_chunk or len(loose) > _SEGMENT_BYTES):
            yield segment(bytes(loose), found)
            loose.clear()
        if is_chunk:
            yield segment(expanded(parsed(Chunk.read, content)), found)
    yield segment(bytes(loose), found)


def expanded(chunk: Chunk) -> bytes:
    """What a chunk holds, its length and checksum compared.

    Raises
    ------
    StandError
        It is damaged, or larger than `MOST_CHUNK_BYTES`.
    """
    if chunk.compression not in _COMPRESSIONS:
        known = ", ".join(_COMPRESSIONS.values())
        raise StandError(f"unknown compression {chunk.compression!r}: known: {known}")
    if chunk.uncompressed_size > MOST_CHUNK_BYTES:
        raise StandError(
            f"damaged: a chunk of {chunk.uncompressed_size} bytes, must be at most "
            f"{MOST_CHUNK_BYTES}"
        )
    try:
        data = _DECOMPRESS[chunk.compression](chunk.data, chunk.uncompressed_size)
    except (zstandard.ZstdError, RuntimeError) as error:  # the second is lz4's
        raise StandError(f"damaged: a chunk cannot be expanded: {error}") from error
    if len(data) != chunk.uncompressed_size:
        raise StandError(
            f"damaged: a chunk holds other than the {chunk.uncompressed_size} bytes that it states"
        )
    _compare("a chunk", chunk.uncompressed_crc, zlib.crc32(data))
    return data


def _from_zstd(data: bytes, size: int) -> bytes:
    """At most `size` bytes: the frame's own word for its size is held against that first."""
    stated = zstandard.frame_content_size(data)
    if stated > size:
        return b""
    return zstandard.ZstdDecompressor().decompress(data, max_output_size=size)


def _from_lz4(data: bytes, size: int) -> bytes:
    """At most `size` bytes and one, which tells that there are more."""
    return LZ4FrameDecompressor().decompress(data, max_length=size + 1)


_DECOMPRESS = {"": lambda data, size: data, "lz4": _from_lz4, "zstd": _from_zstd}


def segment(data: bytes, found: Directory) -> Segment:
    """Finds the messages; the loop does no more than step from record to record."""
    places = []
    at, end, head_at, message = 0, len(data), _HEAD.unpack_from, int(Opcode.MESSAGE)
    while at + OPCODE_AND_SIZE <= end:
        opcode, size = head_at(data, at)
        if opcode == message:
            places.append(at)
        elif opcode in _DEFINITIONS:
            found.add(opcode, data[at + OPCODE_AND_SIZE : at + OPCODE_AND_SIZE + size])
        at += OPCODE_AND_SIZE + size
    if at != end:
        raise StandError("damaged: a record reaches past the end of its chunk")
    return _located(np.frombuffer(data, np.uint8), np.array(places, np.int64))


def _located(data: Bytes, places: IntArray) -> Segment:
    if len(places) == 0:
        return no_messages(data)
    smallest = MESSAGE_HEAD.itemsize - OPCODE_AND_SIZE
    if (gather(data, places + 1, "<u8") < smallest).any():
        raise StandError("damaged: a message record is too short")
    head = gather(data, places, MESSAGE_HEAD)
    start = places + MESSAGE_HEAD.itemsize
    size = head["size"].astype(np.int64) - smallest
    return Segment(
        data=data,
        channel=head["channel"].astype(np.int64),
        start=start,
        size=size,
        log_ns=head["log_time"].astype(np.int64),
    )


def no_messages(data: Bytes) -> Segment:
    """A segment in which there are none."""
    nothing = np.empty(0, np.int64)
    return Segment(data=data, channel=nothing, start=nothing, size=nothing, log_ns=nothing)
