"""Times of day and of counters as text, to whole nanoseconds: a double has 256 ns since 1970."""

from collections.abc import Callable, Sequence
from datetime import UTC, datetime

NS = {"s": 1_000_000_000, "ms": 1_000_000, "us": 1_000, "ns": 1}
ISO = "iso"
TIME_UNITS = (*NS, ISO)
YEAR_1990 = 631_152_000  # s, Unix: a later stamp is taken for Unix time
YEAR_2038 = 2_147_483_647  # ROS stamps end there


def parser_of(unit: str, decimal_comma: bool = False) -> Callable[[Sequence[str]], int]:
    """What takes the fields of a time, one or (s, ns), to nanoseconds; `ValueError` if it cannot.

    Parameters
    ----------
    unit : str
        Of `TIME_UNITS`; of two fields the first is in seconds.
    decimal_comma : bool
    """

    def parse(fields: Sequence[str]) -> int:
        if len(fields) == 2:
            return int(fields[0]) * NS["s"] + int(fields[1])
        text = fields[0].replace(",", ".") if decimal_comma else fields[0]
        return iso_ns(text) if unit == ISO else decimal_ns(text, NS[unit])

    return parse


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
