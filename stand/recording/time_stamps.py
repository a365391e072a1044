"""Times of day and of counters as text, to whole nanoseconds: a double has 256 ns since 1970."""

import re
from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from typing import Any

import numpy as np
from numpy.typing import NDArray

from alignment.arrays import IntArray
from stand.errors import StandError, unknown

NS = {"s": 1_000_000_000, "ms": 1_000_000, "us": 1_000, "ns": 1}
ISO = "iso"
TIME_UNITS = (*NS, ISO)
YEAR_1990 = 631_152_000  # s, Unix: a later stamp is taken for Unix time
YEAR_2038 = 2_147_483_647  # ROS stamps end there
GPS_EPOCH = 315_964_800  # s, Unix: 6 January 1980
GPS_WEEK = 604_800  # s
SHARED = 0.05  # of all rows that have the stamp of the row before: fewer is a fault, no habit
FEWEST_STAMPS = 32
CLOSE = 0.75  # of the usual time between rows: so much is there at least where rows share a stamp
SHORT_WEEKS = 1024  # of a week number of ten bits
SHORT_EPOCH = 2048  # weeks: since 7 April 2019 it counts from here


def time_unit_ns(unit: str) -> int:
    """Nanoseconds of a unit of time: s, ms, us, ns, or a number of them (100us); of iso 1.

    Raises
    ------
    StandError
        Not known, or not a whole number of nanoseconds.
    """
    if unit == ISO:
        return 1
    found = re.fullmatch(r"(\d*\.?\d*)\s*(s|ms|us|ns)", unit)
    size = float(found[1] or 1) * NS[found[2]] if found and found[1] != "." else 0.0
    if not 1 <= size <= 1e15 or abs(size - round(size)) > 1e-6:
        raise unknown("time unit", unit, (*TIME_UNITS, "100us (a counter's tick)"))
    return round(size)


def parser_of(
    unit: str, stamp: Sequence[str], decimal_comma: bool = False
) -> Callable[[Sequence[str]], int]:
    """What takes the fields of a time to nanoseconds; `ValueError` if it cannot.

    Parameters
    ----------
    unit : str
        As `time_unit_ns` takes it; of two fields that of the seconds of a week.
    stamp : sequence of str
        What the fields are: t; sec and nanosec; or week and tow.
    decimal_comma : bool
    """
    size = time_unit_ns(unit)

    def number(text: str) -> str:
        return text.replace(",", ".") if decimal_comma else text

    def parse(fields: Sequence[str]) -> int:
        text = number(fields[0])
        return iso_ns(text) if unit == ISO else decimal_ns(text, size)

    def split(fields: Sequence[str]) -> int:
        return int(fields[0]) * NS["s"] + int(fields[1])

    def gps(fields: Sequence[str]) -> int:
        week = float(number(fields[0]))
        return gps_ns(week) + decimal_ns(number(fields[1]), size)

    return {"sec": split, "week": gps}.get(stamp[0] if stamp else "t", parse)


def gps_ns(week: float) -> int:
    """Where a week of GPS begins, on GPS's own clock [ns since 1970]; ten bits: since 2019."""
    if not (week.is_integer() and 0 <= week < 10_000):
        raise ValueError(week)
    number = int(week) + (SHORT_EPOCH if week < SHORT_WEEKS else 0)
    return (GPS_EPOCH + number * GPS_WEEK) * NS["s"]


def array_ns(
    path: object, parts: Sequence[NDArray[Any]], stamp: Sequence[str], unit: str
) -> IntArray:
    """Nanoseconds (n,) of columns that are times: `parts` are of what `stamp` says.

    Raises
    ------
    StandError
        The first row that is no time.
    """
    if len(parts) == 1 and parts[0].dtype.kind in "Mm":
        return parts[0].astype(f"{parts[0].dtype.kind}8[ns]").astype(np.int64)
    if unit == ISO or any(part.dtype.kind not in "fiu" for part in parts):
        parse = parser_of(unit, stamp)
        rows = zip(*parts, strict=True)
        return np.array([_parsed(path, k, row, parse) for k, row in enumerate(rows)])
    size = time_unit_ns(unit)
    if tuple(stamp) == ("week", "tow"):
        weeks, which = np.unique(parts[0], return_inverse=True)
        try:
            starts = np.array([gps_ns(float(week)) for week in weeks])
        except ValueError as error:
            raise StandError(f"{path}: column week = {error}: must be a week of GPS") from None
        return starts[which] + _whole_ns(path, parts[1], size, "tow")
    if tuple(stamp) == ("sec", "nanosec"):
        return _whole_ns(path, parts[0], NS["s"], "sec") + _whole_ns(path, parts[1], 1, "nanosec")
    return _whole_ns(path, parts[0], size, "t")


def _parsed(path: object, k: int, row: Sequence[Any], parse: Callable[[Sequence[str]], int]) -> int:
    try:
        return parse([str(field) for field in row])
    except (ValueError, OverflowError):
        raise StandError(f"{path}: row {k + 1}, column t = {row[0]!r}: is no time") from None


def _whole_ns(path: object, part: NDArray[Any], size: int, name: str) -> IntArray:
    """Numbers of units of `size` ns, to the nearest nanosecond."""
    with np.errstate(all="ignore"):
        most = np.abs(part.astype(float)) * size
    bad = np.flatnonzero(~(most < 4e18))
    if len(bad):
        value = part[bad[0]]
        must = "must be finite" if not np.isfinite(value) else "is the time unit right?"
        raise StandError(f"{path}: row {bad[0] + 1}, column {name} = {value}: {must}")
    floats = part.dtype.kind == "f"
    whole = (np.floor(part) if floats else part).astype(np.int64)
    t_ns = whole * size
    if floats:
        t_ns += np.round((part.astype(float) - whole) * size).astype(np.int64)
    return t_ns


def unwrapped(path: object, t_ns: IntArray, period: int) -> IntArray:
    """Times (n,) of a counter that begins anew after `period` [ns], as if it never did.

    Raises
    ------
    StandError
        A time that the counter cannot have.
    """
    beyond = np.flatnonzero((t_ns < 0) | (t_ns > period))
    if len(beyond):
        k = int(beyond[0])
        raise StandError(
            f"{path}: row {k + 1}, column t = {t_ns[k] / NS['s']:.12g} s: must be within 0 and "
            f"--wrap, {period / NS['s']:.12g} s"
        )
    back = np.diff(t_ns, prepend=t_ns[:1]) < -period // 2
    return t_ns + period * np.cumsum(back)


def separated(t_ns: IntArray) -> tuple[IntArray, IntArray] | None:
    """Stamps (n,) of rows that share them, told apart, and how many rows each had; None: few do.

    Samples that are handed over together, or whose stamps are rounded, have one stamp: the last of
    them keeps it, and those before are the usual step apart, or less where the stamp before is
    near; what the end of the log cuts off follows the stamp before. Whole seconds are left as they
    are: their nanoseconds may be in another column. So is what has no more time than others have
    for one row.
    """
    steps = np.diff(t_ns)
    if np.any(steps < 0) or np.count_nonzero(steps == 0) < max(1.0, SHARED * len(steps)):
        return None
    last = np.flatnonzero(np.append(steps > 0, True))
    rows = np.diff(last, prepend=-1)
    if len(rows) < FEWEST_STAMPS or not np.any(t_ns % NS["s"]):
        return None
    each = np.diff(t_ns[last]) / rows[1:]
    usual = float(np.median(each))
    if np.median(each[rows[1:] > 1]) < CLOSE * usual:  # no time for them: two readings of one time
        return None
    each = np.minimum(usual, np.append(usual, each))
    if each.min() < 1:
        return None
    before = np.repeat(last, rows) - np.arange(len(t_ns))
    apart = t_ns - np.floor(before * np.repeat(each, rows)).astype(np.int64)
    if rows[-1] < rows[-2]:
        follows = np.arange(1, rows[-1] + 1)
        apart[-rows[-1] :] = t_ns[last[-2]] + np.floor(follows * each[-1]).astype(np.int64)
    return apart + (max(0, -int(apart[0])) if t_ns[0] >= 0 else 0), rows


def decimal_ns(text: str, unit_ns: int) -> int:
    """The nearest nanosecond of a decimal number of units."""
    whole, _, part = text.partition(".")
    if not (whole.isdecimal() and (part.isdecimal() or not part)):
        return round(float(text) * unit_ns)
    if not part:
        return int(whole) * unit_ns
    scale = 10 ** len(part)
    return int(whole) * unit_ns + (int(part) * unit_ns + scale // 2) // scale


def iso_ns(text: str) -> int:
    """Nanoseconds since 1970 of an ISO 8601 time, UTC where no zone is told."""
    head, dot, tail = text.replace(",", ".").partition(".")
    digits = len(tail) - len(tail.lstrip("0123456789"))
    if dot and not digits:
        raise ValueError(text)
    time = datetime.fromisoformat(head + tail[digits:])
    time = time.replace(tzinfo=UTC) if time.tzinfo is None else time
    return round(time.timestamp()) * NS["s"] + int(tail[:digits].ljust(9, "0")[:9])


def likely_unit(text: str) -> str:
    """The unit in which a first stamp lies between 1990 and 2038, ISO 8601, or else seconds."""
    try:
        value = float(text.replace(",", "."))
    except ValueError:
        return ISO
    return next((u for u, n in NS.items() if YEAR_1990 <= value * n / NS["s"] < YEAR_2038), "s")
