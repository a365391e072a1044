"""Whose messages an IMU topic has, when they came, and whether they say that they have nothing."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from alignment.arrays import IntArray
from stand.errors import StandError, unknown
from stand.recording.mcap.cdr import Bytes
from stand.recording.mcap.decode import ImuBatch, decode_imu, frame_ids

_FIELDS = {"w_ib_b": "angular_velocity", "f_b": "linear_acceleration"}
_CLOCKS = 0.01  # relative: the clock of no unit is so far off
_SPAN = 10.0  # s: of less the times of arrival tell nothing of a clock


class SharedTopic:
    """What the messages of an IMU say beside its readings, met chunk by chunk.

    Parameters
    ----------
    frame : str or None
        Whose messages count; None: there must be one frame_id alone.
    stamps : str
        Which are read, of the header or the log.
    """

    def __init__(self, frame: str | None, stamps: str) -> None:
        self._frame, self._stamps = frame, stamps
        self._names: list[str] = []
        self._rows: IntArray | None = None
        self._none = np.ones(2, bool)
        self._header, self._log = [0, 0], [0, 0]
        self._empty = True

    @property
    def frame(self) -> str:
        """The frame_id of the messages that count."""
        return self._names[0] if self._frame is None else self._frame

    def decode(
        self, data: Bytes, starts: IntArray, sizes: IntArray, first: int, *, packed: bool
    ) -> ImuBatch:
        """As `decode_imu`; `StandError` where several share the topic and none was chosen."""
        batch = decode_imu(data, starts, sizes, first, packed=packed)
        names, which = frame_ids(data, starts, packed=packed)
        self._names += [name for name in names if name not in self._names]
        wanted = self._frame
        if wanted is None and len(self._names) > 1:
            raise StandError(
                f"messages of {', '.join(name or '(no name)' for name in self._names[:4])} "
                "(frame_id) share this topic: choose one with --frame"
            )
        self._rows = None
        if wanted is not None:
            k = names.index(wanted) if wanted in names else -2
            self._rows = which == k
        return batch

    def rows(self, batch: ImuBatch, log_ns: IntArray) -> Any:
        """Which of the messages count."""
        keep = slice(None) if self._rows is None else self._rows
        t_ns, log_ns, none = batch.t_ns[keep], log_ns[keep], batch.none[keep]
        if len(t_ns):
            ends = (int(t_ns[-1]), int(log_ns[-1]))
            begins = (int(t_ns[0]), int(log_ns[0])) if self._empty else (None, None)
            for times, begin, end in zip((self._header, self._log), begins, ends, strict=True):
                times[:] = [times[0] if begin is None else begin, end]
            self._none &= none.all(axis=0)
            self._empty = False
        return keep

    def check(self, columns: Mapping[str, NDArray[Any]]) -> None:
        """`StandError` where no message is of the wanted frame, or the unit says it has nothing."""
        if not len(columns["t_ns"]):
            raise unknown("frame_id", self._frame, self._names)
        t_ns = columns["t_ns"]
        if self._stamps == "header" and len(t_ns) > 1 and not t_ns.any():
            raise StandError("the header stamps are all 0: --stamps log takes when it was written")
        for k, (name, field) in enumerate(
            (("w_ib_b", "angular_velocity"), ("f_b", "linear_acceleration"))
        ):
            if self._none[k] and not columns[name].any():
                raise StandError(
                    f"{field}_covariance[0] = -1 and {field} 0 in every message: the unit says "
                    "that it has none"
                )

    def doubts(self, columns: Mapping[str, NDArray[Any]]) -> tuple[str, ...]:
        """What may be meant, and may be wrong."""
        told = [
            f"{field}_covariance[0] = -1 says that there is no {field}; it is used"
            for field, none in zip(
                ("angular_velocity", "linear_acceleration"), self._none, strict=True
            )
            if none
        ]
        header, log = ((end - begin) * 1e-9 for begin, end in (self._header, self._log))
        if min(header, log) > _SPAN and abs(header / log - 1) > _CLOCKS:
            told.append(
                f"the header stamps span {header:.6g} s, the messages were written in {log:.6g} s: "
                "which clock is right? (--stamps log)"
            )
        return tuple(told)
