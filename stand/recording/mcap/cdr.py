"""CDR, the encoding of ROS 2 messages: many messages of one layout at once, as numpy rows.

XCDR version 1 (OMG DDS-RTPS 2.2, 10.5): four bytes of encapsulation, then the fields, each
aligned to its own size counted from behind the encapsulation. Strings carry their length with
the closing zero byte; sequences carry their count. Messages of fixed names have fixed layout,
so constant bytes are laid out once and only the varying fields are filled per message.
"""

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from alignment.arrays import Array, IntArray
from alignment.units import DEG

Bytes = NDArray[np.uint8]

NS_PER_S = 1_000_000_000
_LITTLE_ENDIAN = b"\x00\x01\x00\x00"
_HEAD = len(_LITTLE_ENDIAN)
_SERVICE_GPS, _COVARIANCE_DIAGONAL_KNOWN = 1, 2  # as sensor_msgs/msg/NavSatFix has them
_STAMP = np.dtype([("sec", "<i4"), ("nanosec", "<u4")])
_KEPT = 32  # layouts, of which a recording has some six: they are laid out once, not every second

_Numbers = tuple[float, ...]


@dataclass(frozen=True, slots=True, eq=False)
class _Form:
    """A finished layout: the bytes that all messages share, and the fields that vary."""

    template: Bytes
    fields: np.dtype[Any]

    def rows(self, n: int, **values: ArrayLike) -> Bytes:
        """`n` messages with their varying fields filled: (n, length)."""
        rows = np.empty((n, len(self.template)), np.uint8)
        rows[:] = self.template
        messages = rows.view(self.fields)[:, 0]
        for name, value in values.items():
            messages[name] = value
        return rows


class _Layout:
    """Collects the constant bytes of a message and the places of its varying fields."""

    def __init__(self) -> None:
        self.template = bytearray(_LITTLE_ENDIAN)
        self.fields: dict[str, tuple[Any, int]] = {}

    def align(self, size: int) -> None:
        self.template.extend(bytes((_HEAD - len(self.template)) % size))

    def constant(self, kind: str, *values: float) -> None:
        """Numbers of one struct `kind`, little endian."""
        self.align(struct.calcsize(f"<{kind}"))
        self.template += struct.pack(f"<{len(values)}{kind}", *values)

    def string(self, text: str) -> None:
        data = text.encode() + b"\0"
        self.constant("I", len(data))
        self.template += data

    def varying(self, name: str, dtype: Any, align: int) -> None:
        self.align(align)
        self.fields[name] = (dtype, len(self.template))
        self.template.extend(bytes(np.dtype(dtype).itemsize))

    def header(self, frame_id: str, stamp: str = "stamp") -> None:
        self.varying(stamp, _STAMP, 4)
        self.string(frame_id)

    def form(self) -> _Form:
        formats, offsets = zip(*self.fields.values(), strict=True)
        dtype = np.dtype(
            {
                "names": list(self.fields),
                "formats": formats,
                "offsets": offsets,
                "itemsize": len(self.template),
            }
        )
        return _Form(np.frombuffer(bytes(self.template), np.uint8), dtype)


def _stamps(t_ns: IntArray) -> NDArray[Any]:
    stamps = np.empty(len(t_ns), _STAMP)
    stamps["sec"], stamps["nanosec"] = np.divmod(t_ns, NS_PER_S)
    return stamps


def _variances(variances: ArrayLike) -> _Numbers:
    """Three, of a number for all or of three."""
    return tuple(np.broadcast_to(np.asarray(variances, float), 3).tolist())


def _diagonal(variances: _Numbers) -> list[float]:
    """All numbers of a diagonal covariance."""
    return np.diag(variances).ravel().tolist()


@lru_cache(_KEPT)
def _imu_form(frame_id: str, turned: bool, rate_noise: _Numbers, force_noise: _Numbers) -> _Form:
    layout = _Layout()
    layout.header(frame_id)
    if turned:
        layout.varying("q", ("<f8", 4), 8)
    else:
        layout.constant("d", 0.0, 0.0, 0.0, 1.0)
    layout.constant("d", 0.0 if turned else -1.0, *[0.0] * 8)
    layout.varying("w", ("<f8", 3), 8)
    layout.constant("d", *_diagonal(rate_noise))
    layout.varying("f", ("<f8", 3), 8)
    layout.constant("d", *_diagonal(force_noise))
    return layout.form()


def imu_messages(
    t_ns: IntArray,
    w_ib_b: Array,
    f_b: Array,
    *,
    frame_id: str,
    rate_noise: ArrayLike = 0.0,
    force_noise: ArrayLike = 0.0,
    q: Array | None = None,
) -> Bytes:
    """sensor_msgs/msg/Imu.

    Parameters
    ----------
    t_ns : (n,) int64
        Header stamps since the Unix epoch [ns].
    w_ib_b, f_b : (n, 3)
        Angular rate [rad/s] and specific force [m/s^2].
    frame_id : str
    rate_noise, force_noise : (3,) or a number
        Variances [(rad/s)^2], [(m/s^2)^2]; 0 means unknown.
    q : (n, 4), optional
        Orientation (x, y, z, w); without it the message says that there is none.

    Returns
    -------
    (n, length) uint8
    """
    form = _imu_form(frame_id, q is not None, _variances(rate_noise), _variances(force_noise))
    orientation = {} if q is None else {"q": q}
    return form.rows(len(t_ns), stamp=_stamps(t_ns), w=w_ib_b, f=f_b, **orientation)


@lru_cache(_KEPT)
def _states_form(names: tuple[str, ...]) -> _Form:
    layout = _Layout()
    layout.header("")
    layout.constant("I", len(names))
    for name in names:
        layout.string(name)
    for field in ("angles", "rates"):
        layout.constant("I", len(names))
        layout.varying(field, ("<f8", len(names)), 8)
    layout.constant("I", 0)
    return layout.form()


def joint_states(t_ns: IntArray, names: Sequence[str], angles: Array, rates: Array) -> Bytes:
    """sensor_msgs/msg/JointState without efforts, (n, length).

    Parameters
    ----------
    t_ns : (n,) int64
        Header stamps since the Unix epoch [ns].
    names : k strings
    angles, rates : (n, k)
        [rad], [rad/s].
    """
    form = _states_form(tuple(names))
    return form.rows(len(t_ns), stamp=_stamps(t_ns), angles=angles, rates=rates)


@lru_cache(_KEPT)
def _transforms_form(frames: tuple[tuple[str, str], ...]) -> _Form:
    layout = _Layout()
    layout.constant("I", len(frames))
    for i, (parent, child) in enumerate(frames):
        layout.header(parent, stamp=f"stamp{i}")
        layout.string(child)
        layout.varying(f"translation{i}", ("<f8", 3), 8)
        layout.varying(f"rotation{i}", ("<f8", 4), 8)
    return layout.form()


def transforms(
    t_ns: IntArray, frames: Sequence[tuple[str, str]], translations: Array, rotations: Array
) -> Bytes:
    """tf2_msgs/msg/TFMessage of k transforms each, (n, length).

    Parameters
    ----------
    t_ns : (n,) int64
        Header stamps since the Unix epoch [ns].
    frames : k pairs of str
        Parent and child.
    translations : (n, k, 3)
        [m], in the parent.
    rotations : (n, k, 4)
        Quaternion (x, y, z, w): takes components in the child to the parent.
    """
    stamps, values = _stamps(t_ns), {}
    for i in range(len(frames)):
        values[f"stamp{i}"] = stamps
        values[f"translation{i}"] = translations[:, i]
        values[f"rotation{i}"] = rotations[:, i]
    return _transforms_form(tuple(frames)).rows(len(t_ns), **values)


@lru_cache(_KEPT)
def _fix_form(frame_id: str, variances: _Numbers) -> _Form:
    layout = _Layout()
    layout.header(frame_id)
    layout.constant("b", 0)  # a fix
    layout.constant("H", _SERVICE_GPS)
    layout.varying("place", ("<f8", 3), 8)
    layout.constant("d", *_diagonal(variances))
    layout.constant("B", _COVARIANCE_DIAGONAL_KNOWN)
    return layout.form()


def fix_messages(t_ns: IntArray, place: Array, *, frame_id: str, variance: float) -> Bytes:
    """sensor_msgs/msg/NavSatFix, (n, length).

    Parameters
    ----------
    t_ns : (n,) int64
        Header stamps since the Unix epoch [ns].
    place : (n, 3)
        Geodetic latitude, longitude [rad] and height above the ellipsoid [m], WGS 84.
    frame_id : str
        Of the antenna.
    variance : float
        Of each component [m^2].
    """
    form = _fix_form(frame_id, _variances(variance))
    return form.rows(len(t_ns), stamp=_stamps(t_ns), place=place / [DEG, DEG, 1.0])


@lru_cache(_KEPT)
def _velocity_form(frame_id: str, variances: _Numbers) -> _Form:
    layout = _Layout()
    layout.header(frame_id)
    layout.varying("v", ("<f8", 3), 8)
    layout.constant("d", *[0.0] * 3)
    layout.constant("d", *_diagonal((*variances, *[-1.0] * 3)))
    return layout.form()


def velocity_messages(t_ns: IntArray, v: Array, *, frame_id: str, variance: float) -> Bytes:
    """geometry_msgs/msg/TwistWithCovarianceStamped, (n, length).

    Parameters
    ----------
    t_ns : (n,) int64
        Header stamps since the Unix epoch [ns].
    v : (n, 3)
        [m/s], in the axes of `frame_id`.
    frame_id : str
    variance : float
        Of each component [(m/s)^2]; the angular rates are said to be unknown.
    """
    form = _velocity_form(frame_id, _variances(variance))
    return form.rows(len(t_ns), stamp=_stamps(t_ns), v=v)


def string_message(text: str) -> Bytes:
    """std_msgs/msg/String, (1, length)."""
    layout = _Layout()
    layout.string(text)
    return _single(layout)


def uint8_messages(values: IntArray) -> Bytes:
    """std_msgs/msg/UInt8 of each of `values` (n,): (n, length)."""
    layout = _Layout()
    layout.varying("data", "u1", 1)
    return layout.form().rows(len(values), data=values)


def log_message(t_ns: int, level: int, name: str, text: str) -> Bytes:
    """rcl_interfaces/msg/Log, (1, length), without a place in the code."""
    layout = _Layout()
    sec, nanosec = divmod(t_ns, NS_PER_S)
    layout.constant("i", sec)
    layout.constant("I", nanosec)
    layout.constant("B", level)
    for field in (name, text, "", ""):
        layout.string(field)
    layout.constant("I", 0)
    return _single(layout)


def _single(layout: _Layout) -> Bytes:
    return np.frombuffer(bytes(layout.template), np.uint8)[None, :]
