"""Reading sensor_msgs/msg/Imu from CDR bytes, many messages at once, whoever wrote them."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import DTypeLike, NDArray

from alignment.arrays import Array, IntArray
from stand.errors import StandError

from .cdr import NS_PER_S, Bytes

_ENCAPSULATION_SIZE = 4
_HEADER = np.dtype([("sec", "i4"), ("nanosec", "u4"), ("frame_size", "u4")])
_NUMBERS = np.dtype(
    [
        ("q", "f8", 4),
        ("q_covariance", "f8", 9),
        ("w", "f8", 3),
        ("w_covariance", "f8", 9),
        ("f", "f8", 3),
        ("f_covariance", "f8", 9),
    ]
)
_LAYOUTS = {
    0x0000: (_HEADER.newbyteorder(">"), _NUMBERS.newbyteorder(">")),
    0x0001: (_HEADER.newbyteorder("<"), _NUMBERS.newbyteorder("<")),
}
"""Of header and numbers, by the encapsulation's identifier."""


class ImuBatch(NamedTuple):
    """Decoded messages: `t_ns` (n,) header stamps, `w_ib_b`, `f_b` (n, 3), `q` (n, 4) x y z w."""

    t_ns: IntArray
    w_ib_b: Array
    f_b: Array
    q: Array


def decode_imu(data: Bytes, starts: IntArray, sizes: IntArray, first: int = 0) -> ImuBatch:
    """Decode the messages at `starts` in `data`.

    Parameters
    ----------
    data : (bytes,) uint8
    starts, sizes : (n,) int64
        Where each message begins, and its length; all within `data`.
    first : int
        Number of the first message, for errors.

    Raises
    ------
    StandError
        A message too short for its type, or not in plain CDR.
    """
    _check_sizes(sizes, np.full_like(sizes, _ENCAPSULATION_SIZE + _HEADER.itemsize), first)
    kinds = data[starts].astype(np.int64) << 8 | data[starts + 1]
    _check_kinds(kinds, first)
    n = len(starts)
    batch = ImuBatch(np.empty(n, np.int64), np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 4)))
    for kind, (header_layout, numbers_layout) in _LAYOUTS.items():
        rows = np.flatnonzero(kinds == kind)
        if len(rows):
            header = gather(data, starts[rows] + _ENCAPSULATION_SIZE, header_layout)
            numbers = _numbers_start(header["frame_size"])
            _check_sizes(sizes[rows], numbers + _NUMBERS.itemsize, first)
            values = gather(data, starts[rows] + numbers, numbers_layout)
            batch.t_ns[rows] = header["sec"].astype(np.int64) * NS_PER_S + header["nanosec"]
            batch.w_ib_b[rows] = values["w"]
            batch.f_b[rows] = values["f"]
            batch.q[rows] = values["q"]
    return batch


def frame_id(data: Bytes, start: int) -> str:
    """The header's frame_id of the message at `start`, which `decode_imu` has accepted."""
    layout, _ = _LAYOUTS[int(data[start]) << 8 | int(data[start + 1])]
    at = start + _ENCAPSULATION_SIZE
    header = gather(data, np.array([at]), layout)
    text = data[at + _HEADER.itemsize :][: int(header["frame_size"][0])].tobytes()
    return text.rstrip(b"\0").decode(errors="replace")


def gather(data: Bytes, starts: IntArray, dtype: DTypeLike) -> NDArray[Any]:
    """One item of `dtype` from each byte offset: an overlapping view with a stride of 1 byte."""
    dtype = np.dtype(dtype)
    everywhere = np.ndarray((len(data) - dtype.itemsize + 1,), dtype, data, strides=(1,))
    return everywhere[starts]


def _numbers_start(frame_size: NDArray[Any]) -> IntArray:
    """Offset in the message of its numbers: behind the frame_id, aligned to 8."""
    end = _HEADER.itemsize + frame_size.astype(np.int64)
    return _ENCAPSULATION_SIZE + (end + 7) // 8 * 8


def _check_sizes(sizes: IntArray, wanted: IntArray, first: int) -> None:
    short = np.flatnonzero(sizes < wanted)
    if len(short):
        i = int(short[0])
        raise StandError(
            f"message {first + i}: {sizes[i]} bytes, sensor_msgs/msg/Imu needs {wanted[i]}"
        )


def _check_kinds(kinds: IntArray, first: int) -> None:
    odd = np.flatnonzero(~np.isin(kinds, list(_LAYOUTS)))
    if len(odd):
        i = int(odd[0])
        raise StandError(
            f"message {first + i}: encapsulation 0x{kinds[i]:04x}, "
            "must be plain CDR: 0x0000 (big endian) or 0x0001 (little endian)"
        )
