"""What a writer left that died: its whole chunks, with index, summary and footer made anew."""

from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import BinaryIO, NamedTuple

import numpy as np
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, Header, Metadata, Schema
from numpy.typing import NDArray

from stand.errors import StandError
from stand.recording.mcap.container import MAGIC, MESSAGE_HEAD, Container
from stand.recording.mcap.decode import gather
from stand.recording.mcap.records import (
    Directory,
    Segment,
    expanded,
    faults_of,
    parsed,
    segment,
    whole_records,
)

PARSED = {
    int(Opcode.SCHEMA): Schema.read,
    int(Opcode.CHANNEL): Channel.read,
    int(Opcode.METADATA): Metadata.read,
    int(Opcode.ATTACHMENT): Attachment.read,
}
Pairs = NDArray[np.uint64]


@dataclass(frozen=True, slots=True)
class Rebuilt:
    """What of a file was whole.

    Attributes
    ----------
    messages, chunks : int
    last_ns : int
        Log time of the last message [ns since the Unix epoch].
    finished : bool
        Its writer had closed it: nothing is missing.
    metadata : dict
        {record: {key: value}}; records of one name are joined, of equal keys the last.
    """

    messages: int
    chunks: int
    last_ns: int
    finished: bool
    metadata: dict[str, dict[str, str]]


def examine(path: Path) -> Rebuilt:
    """What `rebuild` would save of a file; `StandError` where it is no MCAP."""
    return _walk(path, None)


def rebuild(path: Path, out: Path, metadata: Mapping[str, Mapping[str, str]]) -> Rebuilt:
    """Copy what is whole into a new file, and these metadata records behind it.

    Chunks are copied as they are, so that their messages are the same bytes. What follows the
    first record that is not whole is left behind, as are messages outside of chunks.

    Raises
    ------
    StandError
        `path` is no MCAP file; `out` cannot be written.
    """
    with faults_of(path), open(path, "rb") as file:
        content = next((c for o, c in whole_records(file) if o == Opcode.HEADER), None)
        profile = "" if content is None else parsed(Header.read, content).profile
    with Container(out, profile=profile) as container:
        found = _walk(path, container)
        for name, values in metadata.items():
            container.metadata(name, values)
    return found


class _Whole(NamedTuple):
    """A record that is whole; of a chunk also its form, and (log time, place) by channel."""

    opcode: int
    content: bytes
    chunk: Chunk | None = None
    pairs: Mapping[int, Pairs] = MappingProxyType({})


def _walk(path: Path, container: Container | None) -> Rebuilt:
    messages, chunks, last, finished = 0, 0, 0, False
    metadata: dict[str, dict[str, str]] = {}
    found = Directory()
    with faults_of(path), open(path, "rb") as file:
        if file.read(len(MAGIC)) != MAGIC:
            raise StandError("not an MCAP file")
        for record in _whole(file, found):
            if record.opcode == Opcode.METADATA:
                one = parsed(Metadata.read, record.content)
                metadata[one.name] = metadata.get(one.name, {}) | one.metadata
            for pairs in record.pairs.values():
                messages, last = messages + len(pairs), max(last, int(pairs[:, 0].max()))
            chunks += record.chunk is not None
            finished = record.opcode == Opcode.DATA_END
            if container is not None:
                _copy(container, record, found)
    return Rebuilt(
        messages=messages, chunks=chunks, last_ns=last, finished=finished, metadata=metadata
    )


def _whole(file: BinaryIO, found: Directory) -> Iterator[_Whole]:
    """Up to the first record that is damaged; definitions go into `found`."""
    with suppress(StandError):
        for opcode, content in whole_records(file):
            chunk, pairs = None, {}
            if opcode == Opcode.CHUNK:
                chunk = parsed(Chunk.read, content)
                pairs = _pairs(segment(expanded(chunk), found))
            elif opcode in PARSED:
                parsed(PARSED[opcode], content)
                found.add(opcode, content)
            yield _Whole(opcode, content, chunk, pairs)


def _copy(container: Container, record: _Whole, found: Directory) -> None:
    if record.chunk is not None:
        for schema in found.schemas.values():  # also such as lie within chunks
            container.known(schema=schema)
        for channel in found.channels.values():
            container.known(channel=channel)
        container.copied_chunk(record.chunk, record.pairs)
    elif record.opcode in PARSED:
        container.copied(record.opcode, record.content)


def _pairs(part: Segment) -> dict[int, Pairs]:
    """Of a chunk's messages, by channel: (log time, place of the record), (n, 2)."""
    if not len(part.start):
        return {}
    places = part.start - MESSAGE_HEAD.itemsize
    times = gather(part.data, places, MESSAGE_HEAD)["log_time"]
    both = np.stack([times, places.astype(np.uint64)], axis=1).astype("<u8")
    return {int(c): both[part.channel == c] for c in np.unique(part.channel)}
