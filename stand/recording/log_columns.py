"""Which column of a foreign log is what, and in which unit: as told, or as its header says."""

import re
from collections.abc import Sequence
from dataclasses import dataclass

from stand.errors import StandError, unknown
from stand.imu.stated_units import scale_of, spelled

CHANNELS = ("gx", "gy", "gz", "ax", "ay", "az")
STAMP = ("t",)
SPLIT_STAMP = ("sec", "nanosec")
SKIP = "-"
GPS_STAMP = ("week", "tow")
STAMPS = (STAMP, SPLIT_STAMP, GPS_STAMP)
ALLOWED = (*STAMP, *SPLIT_STAMP, *GPS_STAMP, *CHANNELS, SKIP)

GYRO_UNITS = ("deg/s", "rad/s", "deg/h", "dps", "mdps", "mrad/s", "deg", "rad", "arcsec")
ACCEL_UNITS = ("m/s^2", "g", "mg", "ug", "mm/s^2", "m/s")
_RATE, _ANGLE, _FORCE, _SPEED = (1, 0, -1, 0), (1, 0, 0, 0), (0, 1, -2, 0), (0, 1, -1, 0)
_KINDS = {"gyro": (_RATE, _ANGLE), "accel": (_FORCE, _SPEED)}
_SUFFIXES = {
    "rad_s": "rad/s",
    "rads": "rad/s",
    "rps": "rad/s",
    "deg_s": "deg/s",
    "degs": "deg/s",
    "dps": "deg/s",
    "mdps": "mdps",
    "deg_h": "deg/h",
    "m_s2": "m/s^2",
    "ms2": "m/s^2",
    "mps2": "m/s^2",
    "mss": "m/s^2",
    "g": "g",
    "mg": "mg",
    "s": "s",
    "ms": "ms",
    "us": "us",
    "ns": "ns",
}
_GUESSES = {
    "week": r"(gps_?)?(week|wn|week_?(no|num|number))",
    "tow": r"(gps_?)?(tow|sow|itow|time_?of_?week|sec(onds?)?_?of_?week)",
    "nanosec": r"nano_?sec(onds?)?|nsecs?",
    "sec": r"secs?|seconds",
    "t": r"t|time|zeit|temps|tiempo|stamp|timestamp|time_?stamp|systime|sampletimefine",
    "g": r"g(yro?|yroscope)?|w|omega|angular_?velocity|rate|ang_?vel",
    "a": r"a(cc|ccel|ccelerometer|cceleration)?|f|linear_?acceleration|lin_?acc|specific_?force",
}


@dataclass(frozen=True, slots=True)
class Columns:
    """Places, from 0, of `CHANNELS` in order and of the time, which is what `stamp` says: t,
    sec and nanosec, week and tow, or nothing. `width`: how many columns the log must have; None
    where only some were named. `notes`: what was guessed."""

    values: tuple[int, ...]
    times: tuple[int, ...]
    stamp: tuple[str, ...]
    width: int | None
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class SensorUnit:
    """SI of one unit; whether the values are increments over a sample; where it is from."""

    name: str
    scale: float
    increment: bool
    notes: tuple[str, ...]


def columns_of(columns: str, names: Sequence[str], width: int, *, timed: bool) -> Columns:
    """Take ``t,gx,-,...``, the log's columns in order, or ``t=time_us,gx=2,...``, some of them.

    Parameters
    ----------
    columns : str
    names : sequence of str
        Of the log's columns.
    width : int
        How many it has.
    timed : bool
        Whether a time is needed.

    Raises
    ------
    StandError
    """
    parts = [part.strip() for part in columns.split(",")]
    named = "=" in columns
    places: list[tuple[str, int]] = []
    for k, part in enumerate(parts):
        name, _, column = part.partition("=") if named else (part, "", "")
        name = name.strip()
        if name not in ALLOWED or (named and name == SKIP):
            raise unknown("column", name, ALLOWED)
        places.append((name, _place(column.strip(), names, width) if named else k))
    given = [name for name, _ in places]
    stamp = _stamp_of(columns, given, timed)
    for name in (*stamp, *CHANNELS):
        if given.count(name) != 1:
            raise StandError(
                f"--columns {columns}: {name} stands {given.count(name)} times, must stand once"
            )
    place = dict(places)
    return Columns(
        values=tuple(place[name] for name in CHANNELS),
        times=tuple(place[name] for name in stamp),
        stamp=stamp,
        width=None if named else len(parts),
    )


def _stamp_of(columns: str, given: Sequence[str], timed: bool) -> tuple[str, ...]:
    """The one kind of time that is among the names; none where none is needed."""
    used = [stamp for stamp in STAMPS if any(name in given for name in stamp)]
    if len(used) > 1:
        raise StandError(
            f"--columns {columns}: t, or sec and nanosec, or week and tow, not several"
        )
    return used[0] if used else STAMP if timed else ()


def clear_columns(path: object, names: Sequence[str], width: int, *, timed: bool) -> Columns:
    """The columns as their headers say, where each of `CHANNELS` and the time is clear.

    Raises
    ------
    StandError
        They are not, and how to say which is which.
    """
    guesses = guessed_columns(names, width) if names else [SKIP] * width
    every = [_guess_of(name) for name in names]
    twice = [name for name in CHANNELS if every.count(name) > 1]
    if twice:
        alike = ", ".join(n for n, g in zip(names, every, strict=True) if g == twice[0])
        raise StandError(
            f"{path}: {twice[0]} may be any of {alike}: give --columns t=HEADER,gx=HEADER,..."
        )
    stamp = next((s for s in STAMPS if set(s) <= set(guesses)), ()) if timed else ()
    missing = [name for name in CHANNELS if name not in guesses]
    if missing or (timed and not stamp):
        what = ", ".join([*(["a time"] if timed and not stamp else []), *missing])
        say = "no header" if not names else f"no header is clearly {what}"
        raise StandError(
            f"{path}: {say}: give --columns t,gx,gy,gz,ax,ay,az, in order (- skips one) or "
            f"t=HEADER,gx=HEADER,...{' or --rate HZ' if timed else ''}; stand import {path} shows "
            "the columns"
        )
    places = tuple(guesses.index(name) for name in (*stamp, *CHANNELS))
    told = ", ".join(
        f"{what}={names[k]}" for what, k in zip((*stamp, *CHANNELS), places, strict=True)
    )
    return Columns(
        values=places[len(stamp) :],
        times=places[: len(stamp)],
        stamp=tuple(stamp),
        width=None,
        notes=(f"columns by their headers: {told}",),
    )


def _place(column: str, names: Sequence[str], width: int) -> int:
    alike = [k for k, name in enumerate(names) if name == column]
    alike = alike or [k for k, name in enumerate(names) if name.lower() == column.lower()]
    if len(alike) == 1:
        return alike[0]
    if len(alike) > 1:
        raise StandError(f"column {column!r}: {len(alike)} have this name: give its number")
    if column.isdecimal() and 1 <= int(column) <= width:
        return int(column) - 1
    raise unknown("column of the log", column, names or [f"1 to {width}"])


def unit_of_header(name: str, dimensions: Sequence[tuple[float, ...]]) -> str | None:
    """The unit that a column's name ends in, if it is of one of these dimensions."""
    return named_unit(name, dimensions)[1]


def named_unit(name: str, dimensions: Sequence[tuple[float, ...]]) -> tuple[str, str | None]:
    """A column's name without the unit that it ends in, and that unit."""
    inside = re.search(r"\s*[\[(]([^\[\]()]+)[\])]\s*$", name)
    bare, told = (name[: inside.start()], inside[1].strip()) if inside else (name, "")
    if not inside:
        tail = re.split(r"[\s.]", name.lower())[-1]
        fitting = [s for s in _SUFFIXES if tail.endswith("_" + s)]
        if fitting:
            suffix = max(fitting, key=len)
            bare, told = name[: -len(suffix) - 1], _SUFFIXES[suffix]
    return (bare, told) if told and _dimension(told) in dimensions else (name, None)


def _dimension(unit: str) -> tuple[float, ...] | None:
    try:
        return scale_of(spelled(unit))[1]
    except StandError:
        return None


def sensor_unit(sensor: str, stated: str | None, headers: Sequence[str]) -> SensorUnit:
    """The unit of the gyros or accelerometers: as stated, or as their columns' names say.

    Raises
    ------
    StandError
        Not known, of another kind, or neither stated nor to be seen.
    """
    allowed = GYRO_UNITS if sensor == "gyro" else ACCEL_UNITS
    seen = {unit_of_header(name, _KINDS[sensor]) for name in headers}
    header = seen.pop() if len(seen) == 1 else None
    if stated is None and header is None:
        raise StandError(
            f"--{sensor}-unit: must be given, no header names one (known: {', '.join(allowed)})"
        )
    name = header if stated is None else stated
    assert name is not None
    if stated is not None and stated.lower() in ("lsb", "counts"):
        raise StandError(
            f"--{sensor}-unit {stated}: give the unit of one count here, and how many of it a "
            f"count is as --{sensor}-scale: --{sensor}-unit {allowed[0]} --{sensor}-scale 0.01"
        )
    if _dimension(name) not in _KINDS[sensor]:
        raise unknown(f"{sensor} unit", name, allowed)
    scale, dimension = scale_of(spelled(name))
    notes = ()
    if stated is None:
        notes = (f"{sensor} unit {name}: from the header",)
    elif header is not None and abs(scale_of(spelled(header))[0] / scale - 1) > 1e-9:
        notes = (f"the header says {header}, --{sensor}-unit says {stated}: {stated} is used",)
    return SensorUnit(name, scale, dimension == _KINDS[sensor][1], notes)


def time_unit_of_header(name: str) -> str | None:
    """s, ms, us or ns, if the name of the column says so."""
    found = unit_of_header(name, [(0, 0, 1, 0)])
    return spelled(found).replace("µ", "u").replace("μ", "u") if found else None


def guessed_columns(names: Sequence[str], width: int) -> list[str]:
    """What each column seems to be by its name, of `ALLOWED`; seven without names: the usual."""
    if not names:
        return [*STAMP, *CHANNELS] if width == 7 else [SKIP] * width
    found: list[str] = []
    for name in names:
        guess = _guess_of(name)
        found.append(guess if guess not in found else SKIP)
    if "t" in found:
        found = [SKIP if name in (*SPLIT_STAMP, *GPS_STAMP) else name for name in found]
    elif set(GPS_STAMP) <= set(found):
        found = [SKIP if name in SPLIT_STAMP else name for name in found]
    return found


def _guess_of(name: str) -> str:
    bare = re.sub(r"[\[(].*$", "", name).strip().lower()
    return _guess(re.sub(r"[\s./]+", "_", bare))


def _guess(name: str) -> str:
    for suffix in sorted(_SUFFIXES, key=len, reverse=True):
        name = name.removesuffix("_" + suffix) if name not in _SUFFIXES else name
    for what in ("week", "tow", "nanosec", "sec", "t"):
        if re.fullmatch(rf"(.*_)?({_GUESSES[what]})", name):
            return what
    for what in ("g", "a"):
        if axis := re.fullmatch(rf"(.*_)?({_GUESSES[what]})_?([xyz])", name):
            return what + axis[axis.lastindex or 0]
    return SKIP
