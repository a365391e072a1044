"""Reading messages, many at once, whoever wrote them: Imu, joints, satellites.

As ROS 2 writes them, in CDR: four bytes say how, and numbers are aligned. Or `packed`, as ROS 1
does: the first four bytes are a count, and nothing is aligned; the fields are the same.
"""

from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import DTypeLike, NDArray

from alignment.arrays import Array, IntArray
from alignment.units import DEG
from stand.errors import StandError
from stand.recording.mcap import schemas
from stand.recording.mcap.cdr import NS_PER_S, Bytes

Order = Literal[">", "<"]

MOST_FRAMES = 32  # of frame_ids that are told apart
_ENCAPSULATION_SIZE = 4
_STAMP_END = _ENCAPSULATION_SIZE + 8
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
_FIX = np.dtype([("place", "f8", 3), ("covariance", "f8", (3, 3)), ("kind", "u1")])
_TWIST = np.dtype([("v", "f8", 3), ("w", "f8", 3)])
_TWIST_WITH_COVARIANCE = np.dtype([*_TWIST.descr, ("covariance", "f8", (6, 6))])
_LITTLE = 0x0001
_ORDERS: dict[int, Order] = {0x0000: ">", _LITTLE: "<"}
"""Of the bytes, by the encapsulation's identifier."""


class ImuBatch(NamedTuple):
    """Decoded messages: `t_ns` (n,) header stamps, `w_ib_b`, `f_b` (n, 3), `q` (n, 4) x y z w.

    `none` (n, 2): whether a message says that it has no rates, no forces (covariance[0] = -1).
    """

    t_ns: IntArray
    w_ib_b: Array
    f_b: Array
    q: Array
    none: NDArray[np.bool_]


class JointBatch(NamedTuple):
    """Decoded messages: `t_ns` (n,), `angles`, `rates` (n, k) in the order of `names`.

    Where a message has no rates they are NaN.
    """

    names: tuple[str, ...]
    t_ns: IntArray
    angles: Array
    rates: Array


class FixBatch(NamedTuple):
    """Decoded messages: `t_ns` (n,), `status` (n,) (below 0: no fix), `place` (n, 3) latitude and
    longitude [rad], height [m], `variance` (n,) mean of the three [m^2], NaN where unknown.
    """

    t_ns: IntArray
    status: IntArray
    place: Array
    variance: Array


class VelocityBatch(NamedTuple):
    """Decoded messages: `t_ns` (n,), `v` (n, 3) [m/s], `variance` (n,) mean of the three, NaN
    where unknown.
    """

    t_ns: IntArray
    v: Array
    variance: Array


def decode_imu(
    data: Bytes, starts: IntArray, sizes: IntArray, first: int = 0, *, packed: bool = False
) -> ImuBatch:
    """Decode the sensor_msgs/msg/Imu at `starts` in `data`.

    Parameters
    ----------
    data : (bytes,) uint8
    starts, sizes : (n,) int64, n >= 1
        Where each message begins, and its length; all within `data`.
    first : int
        Number of the first message, for errors.
    packed : bool
        As ROS 1 writes them.

    Raises
    ------
    StandError
        A message too short for its type, or not in plain CDR.
    """
    kinds = _kinds(data, starts, sizes, first, schemas.IMU, packed)
    n = len(starts)
    batch = ImuBatch(
        t_ns=np.empty(n, np.int64),
        w_ib_b=np.empty((n, 3)),
        f_b=np.empty((n, 3)),
        q=np.empty((n, 4)),
        none=np.empty((n, 2), bool),
    )
    for kind, order in _ORDERS.items():
        rows = np.flatnonzero(kinds == kind)
        if len(rows):
            header = _headers(data, starts[rows], order)
            numbers = _numbers_start(header["frame_size"], packed)
            _check_sizes(sizes[rows], numbers + _NUMBERS.itemsize, first, schemas.IMU)
            values = gather(data, starts[rows] + numbers, _NUMBERS.newbyteorder(order))
            batch.t_ns[rows] = _stamp_ns(header)
            batch.w_ib_b[rows] = values["w"]
            batch.f_b[rows] = values["f"]
            batch.q[rows] = values["q"]
            for k, name in enumerate(("w_covariance", "f_covariance")):
                batch.none[rows, k] = values[name][:, 0] == -1.0
    return batch


def decode_fixes(
    data: Bytes, starts: IntArray, sizes: IntArray, first: int = 0, *, packed: bool = False
) -> FixBatch:
    """Decode the sensor_msgs/msg/NavSatFix at `starts` in `data`; all as in `decode_imu`."""
    kinds, n = _kinds(data, starts, sizes, first, schemas.NAV_SAT_FIX, packed), len(starts)
    batch = FixBatch(np.empty(n, np.int64), np.empty(n, np.int64), np.empty((n, 3)), np.empty(n))
    for kind, order in _ORDERS.items():
        rows = np.flatnonzero(kinds == kind)
        if len(rows):
            header = _headers(data, starts[rows], order)
            frame_end = _HEADER.itemsize + header["frame_size"].astype(np.int64)
            # one byte of status, then the services aligned to two
            numbers = _ENCAPSULATION_SIZE + (
                frame_end + 3 if packed else _up(_up(frame_end + 1, 2) + 2, 8)
            )
            _check_sizes(sizes[rows], numbers + _FIX.itemsize, first, schemas.NAV_SAT_FIX)
            status = gather(data, starts[rows] + _ENCAPSULATION_SIZE + frame_end, "i1")
            values = gather(data, starts[rows] + numbers, _FIX.newbyteorder(order))
            batch.t_ns[rows] = _stamp_ns(header)
            batch.status[rows] = status
            batch.place[rows] = values["place"] * [DEG, DEG, 1.0]
            batch.variance[rows] = np.where(values["kind"] > 0, _mean(values["covariance"]), np.nan)
    return batch


def decode_velocities(
    data: Bytes,
    starts: IntArray,
    sizes: IntArray,
    first: int = 0,
    covariance: bool = True,
    *,
    packed: bool = False,
) -> VelocityBatch:
    """Decode the geometry_msgs/msg/TwistWithCovarianceStamped at `starts` in `data`.

    Parameters
    ----------
    data, starts, sizes, first, packed
        As in `decode_imu`.
    covariance : bool
        False: they are TwistStamped, without one.
    """
    name = schemas.TWIST_WITH_COVARIANCE_STAMPED if covariance else schemas.TWIST_STAMPED
    layout = _TWIST_WITH_COVARIANCE if covariance else _TWIST
    kinds, n = _kinds(data, starts, sizes, first, name, packed), len(starts)
    batch = VelocityBatch(np.empty(n, np.int64), np.empty((n, 3)), np.full(n, np.nan))
    for kind, order in _ORDERS.items():
        rows = np.flatnonzero(kinds == kind)
        if len(rows):
            header = _headers(data, starts[rows], order)
            numbers = _numbers_start(header["frame_size"], packed)
            _check_sizes(sizes[rows], numbers + layout.itemsize, first, name)
            values = gather(data, starts[rows] + numbers, layout.newbyteorder(order))
            batch.t_ns[rows] = _stamp_ns(header)
            batch.v[rows] = values["v"]
            if covariance:
                batch.variance[rows] = _mean(values["covariance"][:, :3, :3])
    return batch


def _mean(covariances: Array) -> Array:
    """Mean variance (n,) of covariances (n, 3, 3); NaN where it says nothing: not above 0."""
    variance = np.trace(covariances, axis1=1, axis2=2) / 3
    return np.where(variance > 0, variance, np.nan)


def frame_ids(data: Bytes, starts: IntArray, *, packed: bool = False) -> tuple[list[str], IntArray]:
    """The frame_ids that there are, and which (n,) each message has.

    The messages must be such as `decode_imu` has accepted.
    """
    big = np.zeros(len(starts), bool) if packed else data[starts + 1] == 0
    size = np.where(
        big, _headers(data, starts, ">")["frame_size"], _headers(data, starts, "<")["frame_size"]
    ).astype(np.int64)
    names: list[str] = []
    which = np.full(len(starts), -1)
    left = np.ones(len(starts), bool)
    while left.any():
        row = int(np.argmax(left))
        alike = np.flatnonzero(left & (size == size[row]))
        at = starts[alike] + _ENCAPSULATION_SIZE + _HEADER.itemsize
        texts = gather(data, at, ("u1", (int(size[row]),))) if size[row] else at[:, None] * 0
        alike = alike[(texts == texts[0]).all(axis=1)]
        name = texts[0].astype("u1").tobytes().rstrip(b"\0").decode(errors="replace")
        names += [] if name in names else [name]
        which[alike], left[alike] = names.index(name), False
        if len(names) > MOST_FRAMES:
            break
    return names, which


def decode_joints(
    data: Bytes,
    starts: IntArray,
    sizes: IntArray,
    first: int = 0,
    names: tuple[str, ...] | None = None,
    *,
    packed: bool = False,
) -> JointBatch:
    """Decode the sensor_msgs/msg/JointState at `starts` in `data`.

    Parameters
    ----------
    data, starts, sizes, first, packed
        As in `decode_imu`.
    names : k strings, optional
        Which joints every message must have, in any order; without it those of the first.

    Raises
    ------
    StandError
        A message too short, not in plain CDR, with other joints, or without an angle for each.

    Notes
    -----
    Messages whose names and counts lie byte for byte alike are decoded together.
    """
    kinds = _kinds(data, starts, sizes, first, schemas.JOINT_STATE, packed)
    left = np.ones(len(starts), bool)
    unit = 1 if packed else 8

    def layout_of(row: int) -> _JointLayout:
        message = data[starts[row] : starts[row] + sizes[row]]
        return _joint_layout(message, _ORDERS[int(kinds[row])], first + row, unit)

    names = names or layout_of(0).names
    shape = (len(starts), len(names))
    batch = JointBatch(names, np.empty(len(starts), np.int64), np.empty(shape), np.empty(shape))
    while left.any():
        row = int(np.argmax(left))
        layout = layout_of(row)
        if sorted(layout.names) != sorted(names):
            here, there = ", ".join(layout.names) or "none", ", ".join(names)
            raise StandError(f"message {first + row}: joints {here}, must be {there} as before")
        rows = np.flatnonzero(left & (kinds == kinds[row]) & (sizes >= layout.dtype.itemsize))
        messages = gather(data, starts[rows], layout.dtype)
        alike = _alike(messages, row=int(np.searchsorted(rows, row)))
        rows, messages = rows[alike], messages[alike]
        order = [layout.names.index(name) for name in names]
        batch.t_ns[rows] = _stamp_ns(messages)
        batch.angles[rows] = messages["angles"][:, order]
        batch.rates[rows] = messages["rates"][:, order] if layout.has_rates else np.nan
        left[rows] = False
    return batch


class _JointLayout(NamedTuple):
    """Where one JointState has what: the fields `_CONSTANT` hold what makes the layout."""

    names: tuple[str, ...]
    dtype: np.dtype
    has_rates: bool


_CONSTANT = ("head", "rate_count")  # frame, names and count of angles; count of rates


def _alike(messages: NDArray[Any], row: int) -> NDArray[np.bool_]:
    """Which messages have the layout of message `row`."""
    same = np.ones(len(messages), bool)
    for name in _CONSTANT:
        same &= (messages[name] == messages[name][row]).all(axis=1)
    return same


def _joint_layout(message: Bytes, order: Order, number: int, unit: int) -> _JointLayout:
    """The layout of one message, read field by field; its numbers align to `unit` at most."""

    def fail(fault: str) -> StandError:
        return StandError(f"message {number}: {fault}")

    def count(at: int) -> tuple[int, int]:
        """A count at the next multiple of four behind `at`, and where it ends."""
        at = _aligned(at, min(4, unit))
        if at + 4 > len(message):
            raise fail(f"{len(message)} bytes, {schemas.JOINT_STATE} needs {at + 4} or more")
        return int(message[at : at + 4].view(f"{order}u4")[0]), at + 4

    def skipped(at: int) -> tuple[str, int]:
        size, at = count(at)
        return message[at : at + size].tobytes().rstrip(b"\0").decode(errors="replace"), at + size

    _, at = skipped(_STAMP_END)
    total, at = count(at)
    names = []
    while len(names) < total:  # ends with the message, however large a damaged count is
        name, at = skipped(at)
        names.append(name)
    angle_count, head_end = count(at)
    if not names or len(set(names)) < len(names):
        raise fail(f"joints {', '.join(names) or 'none'}: must be one or more, each once")
    if angle_count != total:
        raise fail(f"{angle_count} angles, must be {total}, one for each joint")
    angles = _aligned(head_end, unit)
    rate_count, rates_head_end = count(angles + 8 * total)
    if rate_count not in (0, total):
        raise fail(f"{rate_count} rates, must be {total}, one for each joint, or none")
    rates = _aligned(rates_head_end, unit)
    end = rates + 8 * rate_count if rate_count else rates_head_end
    if end > len(message):
        raise fail(f"{len(message)} bytes, {schemas.JOINT_STATE} needs {end} or more")
    fields: dict[str, tuple[Any, int]] = {
        "sec": (f"{order}i4", _ENCAPSULATION_SIZE),
        "nanosec": (f"{order}u4", _ENCAPSULATION_SIZE + 4),
        "head": (("u1", (head_end - _STAMP_END,)), _STAMP_END),
        "angles": ((f"{order}f8", (total,)), angles),
        "rate_count": (("u1", (4,)), rates_head_end - 4),
        "rates": ((f"{order}f8", (rate_count,)), rates if rate_count else end),
    }
    formats, offsets = zip(*fields.values(), strict=True)
    dtype = np.dtype(
        {"names": list(fields), "formats": formats, "offsets": offsets, "itemsize": end}
    )
    return _JointLayout(tuple(names), dtype, rate_count > 0)


def _aligned(at: int, size: int) -> int:
    """The next multiple of `size`, counted from behind the encapsulation."""
    return _ENCAPSULATION_SIZE + -(-(at - _ENCAPSULATION_SIZE) // size) * size


def gather(data: Bytes, starts: IntArray, dtype: DTypeLike) -> NDArray[Any]:
    """One item of `dtype` from each byte offset: an overlapping view with a stride of 1 byte."""
    dtype = np.dtype(dtype)
    everywhere = np.ndarray((len(data) - dtype.itemsize + 1,), dtype, data, strides=(1,))
    return everywhere[starts]


def _headers(data: Bytes, starts: IntArray, order: Order) -> NDArray[Any]:
    return gather(data, starts + _ENCAPSULATION_SIZE, _HEADER.newbyteorder(order))


def _stamp_ns(messages: NDArray[Any]) -> IntArray:
    return messages["sec"].astype(np.int64) * NS_PER_S + messages["nanosec"]


def _numbers_start(frame_size: NDArray[Any], packed: bool) -> IntArray:
    """Offset in the message of its numbers: behind the frame_id, aligned to 8 or packed."""
    end = _HEADER.itemsize + frame_size.astype(np.int64)
    return _ENCAPSULATION_SIZE + (end if packed else _up(end, 8))


def _up(at: IntArray, size: int) -> IntArray:
    """The next multiples of `size`."""
    return (at + size - 1) // size * size


def _check_sizes(sizes: IntArray, wanted: IntArray, first: int, type_name: str) -> None:
    short = np.flatnonzero(sizes < wanted)
    if len(short):
        i = int(short[0])
        raise StandError(f"message {first + i}: {sizes[i]} bytes, {type_name} needs {wanted[i]}")


def _kinds(
    data: Bytes,
    starts: IntArray,
    sizes: IntArray,
    first: int,
    type_name: str,
    packed: bool,
) -> IntArray:
    """The encapsulation's identifier of each message, which must be long enough for a header.

    Packed messages have none, and are little-endian.
    """
    least = np.full_like(sizes, _ENCAPSULATION_SIZE + _HEADER.itemsize)
    _check_sizes(sizes, least, first, type_name)
    if packed:
        return np.full(len(starts), _LITTLE)
    kinds = data[starts].astype(np.int64) << 8 | data[starts + 1]
    odd = np.flatnonzero(~np.isin(kinds, list(_ORDERS)))
    if len(odd):
        i = int(odd[0])
        raise StandError(
            f"message {first + i}: encapsulation 0x{kinds[i]:04x}, "
            "must be plain CDR: 0x0000 (big endian) or 0x0001 (little endian)"
        )
    return kinds
