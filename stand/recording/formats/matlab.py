"""MATLAB's .mat up to version 7 (MAT-File Level 5 of its "MAT-File Format"); 7.3 is HDF5.

Read here rather than by scipy, whose reader ends the process on some damaged files. Every length
and count is held against the bytes there are; matrices of numbers and the fields of structs are
read, the rest is passed over.
"""

import math
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stand.errors import StandError
from stand.recording.formats.table import ArrayTable, table_of

_HEADER = 128
_DEEPEST = 8  # structs within structs
_MOST_RATIO = 500  # of zlib; more is no log
_ALWAYS = 1 << 24  # bytes that are not counted so
_COMPRESSED, _MATRIX, _UINT32, _INT32 = 15, 14, 6, 5
_STRUCT = 2
_NUMERIC = range(6, 16)  # classes: double, single and integers
_NUMBERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8"}
_NUMBERS |= {13: "u8"}


def read_mat(path: Path, topic: str | None) -> ArrayTable:
    """Matrices by name, fields of structs as struct.field."""
    data = path.read_bytes()
    order = {b"IM": "<", b"MI": ">"}.get(data[126:128])
    if order is None:
        raise StandError(f"{path}: damaged: the header of a MATLAB file")
    found: dict[str, NDArray[Any]] = {}
    at = _HEADER
    try:
        while at < len(data):
            kind, body, at = _element(memoryview(data), at, order)
            if kind == _COMPRESSED:
                kind, body, _ = _element(memoryview(_inflated(body)), 0, order)
            if kind != _MATRIX:
                raise _Damaged(f"an element of kind {kind}, must be a matrix")
            _collect(_Parts(body, order), None, found, 0)
    except _Damaged as error:
        raise StandError(f"{path}: damaged before byte {at}: {error}") from None
    if not found:
        raise StandError(f"{path}: a MATLAB file without numbers: tables and objects are not read")
    return table_of(found, topic)


class _Damaged(Exception):
    """What is wrong with the bytes."""


def _element(data: memoryview, at: int, order: str) -> tuple[int, memoryview, int]:
    """An element's kind and content, and where the next begins."""
    if at + 8 > len(data):
        raise _Damaged("cut off")
    kind, size = (int(x) for x in np.frombuffer(data[at : at + 8], f"{order}u4"))
    if kind >> 16:  # small: its content lies in its own head
        size = kind >> 16
        if size > 4:
            raise _Damaged(f"a small element of {size} bytes")
        return kind & 0xFFFF, data[at + 4 : at + 4 + size], at + 8
    end = at + 8 + size
    if end > len(data):
        raise _Damaged(f"an element of {size} bytes, {len(data) - at - 8} are left")
    padded = end if kind == _COMPRESSED else at + 8 + (size + 7) // 8 * 8
    return kind, data[at + 8 : end], padded


def _inflated(body: memoryview) -> bytes:
    most = max(_ALWAYS, _MOST_RATIO * len(body))
    expander = zlib.decompressobj()
    try:
        found = expander.decompress(body, most)
    except zlib.error as error:
        raise _Damaged(f"cannot be expanded: {error}") from None
    if not expander.eof:
        raise _Damaged(f"expands to more than {most} bytes, or is cut off")
    return found


@dataclass(slots=True)
class _Parts:
    """The elements within a matrix, one after the other."""

    body: memoryview
    order: str
    at: int = 0

    def next(self, *kinds: int) -> tuple[int, memoryview]:
        kind, part, self.at = _element(self.body, self.at, self.order)
        if kinds and kind not in kinds:
            raise _Damaged(f"an element of kind {kind}, must be of {', '.join(map(str, kinds))}")
        return kind, part

    def numbers(self, kind: int) -> list[int]:
        _, part = self.next(kind)
        if len(part) % 4:
            raise _Damaged(f"{len(part)} bytes of numbers of 4")
        return np.frombuffer(part, f"{self.order}{'u4' if kind == _UINT32 else 'i4'}").tolist()


def _collect(parts: _Parts, known: str | None, found: dict[str, NDArray[Any]], depth: int) -> None:
    """Numbers of a matrix, and of the fields of a struct; `known` is the field it is."""
    if not len(parts.body):  # an empty field
        return
    flags = parts.numbers(_UINT32)
    kind = flags[0] & 0xFF if flags else 0
    if kind != _STRUCT and kind not in _NUMERIC:
        return  # text, cells, objects
    shape = parts.numbers(_INT32)
    _, own = parts.next()
    name = bytes(own).decode(errors="replace") if known is None else known
    if len(shape) < 2 or min(shape) < 0:
        raise _Damaged(f"{name}: of the shape {shape}")
    if kind in _NUMERIC:
        found[name] = _numbers(parts, name, shape)
    elif math.prod(shape) == 1 and depth < _DEEPEST:
        for field in _fields(parts):
            _, body = parts.next(_MATRIX)
            _collect(_Parts(body, parts.order), f"{name}.{field}", found, depth + 1)


def _numbers(parts: _Parts, name: str, shape: list[int]) -> NDArray[Any]:
    kind, part = parts.next(*_NUMBERS)
    dtype = np.dtype(f"{parts.order}{_NUMBERS[kind]}")
    if math.prod(shape) * dtype.itemsize != len(part):
        raise _Damaged(f"{name}: {shape} of {dtype.itemsize} bytes are not {len(part)} bytes")
    return np.frombuffer(part, dtype).reshape(shape, order="F")


def _fields(parts: _Parts) -> list[str]:
    """The names of a struct's fields."""
    (size, *_) = [*parts.numbers(_INT32), 0]
    _, part = parts.next()
    if size < 1 or len(part) % size:
        raise _Damaged(f"names of {size} bytes in {len(part)}")
    return [
        bytes(part[k : k + size]).split(b"\0")[0].decode(errors="replace")
        for k in range(0, len(part), size)
    ]
