"""Logs that are tables, of any kind, brought to SI and one time base."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from alignment.arrays import Array, IntArray, set_owned
from alignment.sampling import bursts
from stand.errors import StandError
from stand.recording.binary_rows import binary_rows, number_type
from stand.recording.content import BINARY, COMPRESSED, KNOWN, MESSAGES, TEXT, kind_of
from stand.recording.formats import READERS
from stand.recording.formats.table import ArrayTable
from stand.recording.log_columns import (
    CHANNELS,
    Columns,
    SensorUnit,
    clear_columns,
    columns_of,
    sensor_unit,
    time_unit_of_header,
)
from stand.recording.log_form import LogForm
from stand.recording.mcap.writer import EPOCH_NS
from stand.recording.repeated import repeats, twice_text
from stand.recording.text_table import layout_of, read_columns
from stand.recording.time_stamps import (
    ISO,
    NS,
    YEAR_1990,
    YEAR_2038,
    array_ns,
    likely_unit,
    parser_of,
    time_unit_ns,
    told_apart,
    unwrapped,
)

_SECOND = NS["s"]
_BLOCK = 1 << 16  # rows
_MOST = np.repeat([1e6, 1e9], 3)  # rad/s, m/s^2: no unit reports more; squares stay numbers
_LONGEST_NS = 10**18  # of a counter: nanoseconds of 31 years, which whole numbers hold
Progress = Callable[[float], None]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ForeignLog:
    """A log in SI: `t_ns` (n,) int64 since `epoch_ns`, rates [rad/s], forces [m/s^2] (n, 3).

    `topic`: which of the file's columns it is. `notes` say what was found out of the file and
    what was left out.
    """

    t_ns: IntArray
    w_ib_b: Array
    f_b: Array
    epoch_ns: int
    topic: str = ""
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        n = len(self.t_ns)
        set_owned(
            self,
            t_ns=(self.t_ns, (n,), np.int64),
            w_ib_b=(self.w_ib_b, (n, 3), float),
            f_b=(self.f_b, (n, 3), float),
        )


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class _Table:
    """Six channels (n, 6) in the file's units; `t_ns` None where there is no time, which is in
    `unit`; `row` from 0."""

    t_ns: IntArray | None
    row: IntArray
    values: Array
    headers: tuple[str, ...]
    unit: str
    topic: str
    notes: tuple[str, ...]


def _quiet(done: float) -> None:
    """Progress that nobody watches."""


def load_foreign(
    path: Path, form: LogForm, topic: str | None = None, progress: Progress = _quiet
) -> ForeignLog:
    """Read a log that is a table.

    Parameters
    ----------
    path : Path
    form : LogForm
    topic : str or None
        Which group of columns, of a kind of file that has several.
    progress : callable
        Told the part read, 0 to 1.

    Raises
    ------
    StandError
        One line: file, row or line, column, value, what is allowed.
    """
    table, twice = _once(_table(path, form, topic, progress))
    if len(table.values) < 2:
        raise StandError(f"{path}: {len(table.values)} rows of data, at least 2 are needed")
    headers = table.headers or ("",) * 6
    gyro = sensor_unit("gyro", form.gyro_unit, headers[:3])
    accel = sensor_unit("accel", form.accel_unit, headers[3:])
    scales = np.repeat([gyro.scale * form.gyro_scale, accel.scale * form.accel_scale], 3)
    si = _in_si(path, table, scales)
    t_ns, epoch_ns, shared = _stamps(path, table, form)
    si, told = _rates(si, t_ns, gyro, accel)
    w_ib_b, f_b = _parted(si)
    if (turn := form.turn()) is not None:
        w_ib_b, f_b = turn.of(w_ib_b), turn.of(f_b)
    return ForeignLog(
        t_ns=t_ns,
        w_ib_b=w_ib_b,
        f_b=f_b,
        epoch_ns=epoch_ns,
        topic=table.topic,
        notes=(*table.notes, *twice, *shared, *gyro.notes, *accel.notes, *told),
    )


def _table(path: Path, form: LogForm, topic: str | None, progress: Progress) -> _Table:
    kind = kind_of(path)
    if kind in (TEXT, BINARY):
        if topic is not None:
            raise StandError(f"{path}: --topic: is for logs with topics, this is a table")
        told = form.file_format
        text = kind == TEXT if told is None else told in ("csv", "text")
        return _text(path, form, progress) if text else _binary(path, form)
    if kind in MESSAGES:
        raise StandError(f"{path}: holds messages, is no table")
    if kind in COMPRESSED:
        raise StandError(f"{path}: is compressed twice, expand it first")
    form.refuse(path, ("file_format", "skip_bytes"), f"is for binary rows, this is {KNOWN[kind]}")
    return _arrays(path, form, READERS[kind](path, topic))


def _once(table: _Table) -> tuple[_Table, tuple[str, ...]]:
    """Without rows that repeat the row before, time and readings alike, and a word of them.

    Where rows of one time differ as well, alike ones are but coarse.
    """
    t_ns = table.t_ns
    if t_ns is None:
        return table, ()
    again = repeats(t_ns, table.values)
    if not len(again) or (told_apart(t_ns) and len(again) < np.count_nonzero(np.diff(t_ns) == 0)):
        return table, ()
    once = np.delete(np.arange(len(t_ns)), again)
    kept = replace(table, t_ns=t_ns[once], row=table.row[once], values=table.values[once])
    return kept, (twice_text("row", table.row[again] + 1),)


def _text(path: Path, form: LogForm, progress: Progress) -> _Table:
    form.refuse(path, ("skip_bytes",), "is for binary rows, this is text")
    try:
        layout = layout_of(path)
    except OSError as error:
        raise StandError(f"{path}: cannot read: {error.strerror}") from error
    columns = _columns(path, form, layout.names, layout.width)
    first = next((row[columns.times[0]] for row in layout.rows if columns.times), "")
    unit, told = _time_unit(form, layout.names, columns, first.strip())
    found = read_columns(
        path,
        layout,
        width=columns.width,
        values=columns.values,
        times=columns.times,
        to_ns=parser_of(unit, columns.stamp, layout.decimal_comma),
        progress=progress,
    )
    notes = [*columns.notes, *told]
    if found.empty:
        lines = ", ".join(map(str, found.empty[:3])) + (" ..." if len(found.empty) > 3 else "")
        rows = "row" if len(found.empty) == 1 else "rows"
        notes.append(
            f"{len(found.empty)} {rows} with an empty or cut off field left out, a gap each: "
            f"line {lines}"
        )
    return _Table(
        t_ns=found.t_ns,
        row=found.row,
        values=found.values,
        headers=_headers(layout.names, columns),
        unit=unit,
        topic=_topic(layout.names, columns),
        notes=tuple(notes),
    )


def _columns(path: Path, form: LogForm, names: Sequence[str], width: int) -> Columns:
    """Which column is what, as stated or as the headers say."""
    timed = form.rate_hz is None
    if form.columns is None:
        return clear_columns(path, names, width, timed=timed)
    columns = columns_of(form.columns, names, width, timed=timed)
    return columns if timed else replace(columns, times=(), stamp=())


def _headers(names: Sequence[str], columns: Columns) -> tuple[str, ...]:
    there = len(names) > max(columns.values)
    return tuple(names[k] for k in columns.values) if there else ()


def _topic(names: Sequence[str], columns: Columns) -> str:
    """The columns that are read, in words."""
    places = (*columns.times, *columns.values)
    named = [names[k] if k < len(names) and names[k] else str(k + 1) for k in places]
    return f"columns {', '.join(named)}"


def _time_unit(
    form: LogForm, names: Sequence[str], columns: Columns, first: str
) -> tuple[str, tuple[str, ...]]:
    """The unit of the time, and whether it was told by the file."""
    if form.time_unit is not None or len(columns.times) != 1:
        return form.time_unit or "s", ()
    if len(names) > columns.times[0]:
        header = time_unit_of_header(names[columns.times[0]])
        if header in NS:
            return header, (f"time unit {header}: from the header",)
    unit = likely_unit(first) if first else "s"
    return unit, (f"time unit {unit}: from the first stamp",) if unit != "s" else ()


def _binary(path: Path, form: LogForm) -> _Table:
    if form.columns is None:
        raise StandError(
            f"{path}: not an MCAP file, nor another kind that is known by its content; rows of "
            "binary numbers need --columns t,gx,gy,gz,ax,ay,az (in order) and --format"
        )
    columns = _columns(path, form, (), form.columns.count(",") + 1)
    if columns.width is None:
        raise StandError(f"--columns {form.columns}: binary rows need every column in order")
    rows = binary_rows(
        path,
        number_type(form.file_format or "<f8"),
        columns.width,
        skip=form.skip_bytes,
        values=columns.values,
        times=columns.times,
    )
    table = ArrayTable(
        topic="", names=(), rows=len(rows), width=columns.width, column=lambda k: rows[:, k]
    )
    return _gathered(path, form, table, columns)


def _arrays(path: Path, form: LogForm, table: ArrayTable) -> _Table:
    columns = _columns(path, form, table.names, table.width)
    last = max([*columns.values, *columns.times])
    if last >= table.width:
        raise StandError(f"{path}: {table.width} columns, column {last + 1} is asked for")
    if columns.width not in (None, table.width):
        raise StandError(
            f"{path}: {table.width} columns, but --columns names {columns.width} (use - to skip "
            "one)"
        )
    return _gathered(path, form, table, columns)


def _gathered(path: Path, form: LogForm, table: ArrayTable, columns: Columns) -> _Table:
    """The six channels and the times of columns that are arrays."""
    values = np.empty((table.rows, 6))
    for k, place in enumerate(columns.values):
        column = table.column(place)
        if column.dtype.kind not in "fiub":
            name = table.names[place] if table.names else str(place + 1)
            raise StandError(f"{path}: column {name}: {column.dtype}, must be numbers")
        with np.errstate(all="ignore"):
            values[:, k] = column
    parts = [table.column(k) for k in columns.times]
    first = str(parts[0][0]) if len(parts) == 1 and len(parts[0]) else ""
    unit, told = _time_unit(form, table.names, columns, first)
    t_ns = array_ns(path, parts, columns.stamp, unit) if parts else None
    return _Table(
        t_ns=t_ns,
        row=np.arange(table.rows),
        values=values,
        headers=_headers(table.names, columns),
        unit=unit,
        topic=": ".join(filter(None, (table.topic, _topic(table.names, columns)))),
        notes=(*table.notes, *columns.notes, *told),
    )


def _in_si(path: Path, table: _Table, scales: Array) -> Array:
    """The values (n, 6) in SI, checked; in place, an hour at 1 kHz is 173 MB."""
    values = table.values
    for column, scale in enumerate(scales):
        with np.errstate(all="ignore"):  # told below
            bad = np.flatnonzero(~(np.abs(values[:, column]) * scale <= _MOST[column]))
        if len(bad):
            value = values[bad[0], column]
            where = f"{path}: row {table.row[bad[0]] + 1}, column {CHANNELS[column]} = {value:.17g}"
            if not np.isfinite(value):
                raise StandError(f"{where}: must be finite; leave out rows without a reading")
            unit = "rad/s" if column < 3 else "m/s^2"
            raise StandError(
                f"{where}: must be at most {_MOST[column]:g} {unit} "
                "(are the unit and the columns right?)"
            )
    if values.base is not None:  # mapped from a file that is only read
        return values * scales
    values.flags.writeable = True
    values *= scales
    return values


def _parted(si: Array) -> tuple[Array, Array]:
    """Rates and forces (n, 3) of both (n, 6), which is used up: nothing is held twice."""
    n, f_b, flat = len(si), si[:, 3:].copy(), si.reshape(-1)
    for a in range(0, n, _BLOCK):  # a row's new place is never behind its old one
        b = min(a + _BLOCK, n)
        flat[3 * a : 3 * b] = si[a:b, :3].ravel()
    del flat
    si.resize((n, 3), refcheck=False)
    for part in (si, f_b):
        part.flags.writeable = False
    return si, f_b


def _stamps(path: Path, table: _Table, form: LogForm) -> tuple[IntArray, int, tuple[str, ...]]:
    """Nanoseconds since an epoch: Unix time's own, or a fixed one for times from anywhere else.

    And what was made of them, in words.
    """
    if table.t_ns is None:
        assert form.rate_hz is not None
        even = np.round((table.row + 1) * (_SECOND / form.rate_hz)).astype(np.int64)
        return even, EPOCH_NS, ()
    t_ns = table.t_ns
    if form.wrap is not None:
        if table.unit == ISO:
            raise StandError(f"--wrap {form.wrap:g}: times as {ISO} do not wrap")
        period = form.wrap * time_unit_ns(table.unit)
        if not 1 <= period <= _LONGEST_NS:
            raise StandError(f"--wrap {form.wrap:g}: must be 1 ns to {_LONGEST_NS:g} ns (31 years)")
        t_ns = unwrapped(path, t_ns, round(period))
    t_ns, told = _told_apart(path, t_ns, table.values)
    _check_increase(path, t_ns, table.row)
    unix = t_ns[0] >= YEAR_1990 * _SECOND and t_ns[-1] < YEAR_2038 * _SECOND
    whole = int(t_ns[0]) // _SECOND * _SECOND if unix else 0
    if not unix and (t_ns[0] < 0 or t_ns[-1] > YEAR_2038 * _SECOND - EPOCH_NS):
        raise StandError(
            f"{path}: column t runs from {t_ns[0] / _SECOND:.9g} to {t_ns[-1] / _SECOND:.9g} s: "
            "must be seconds from 0 on, or Unix time between 1990 and 2038 (is the time unit "
            "right?)"
        )
    return t_ns - whole, whole or EPOCH_NS, told


def _told_apart(path: Path, t_ns: IntArray, values: Array) -> tuple[IntArray, tuple[str, ...]]:
    """Stamps of which none is another's, where rows shared them, and a word of it."""
    found = told_apart(t_ns)
    if found is None:
        return t_ns, ()
    apart, rows = found
    k = int(rows[0])
    if np.all(rows == k):  # two units have biases of their own
        turns = values.reshape(-1, k, values.shape[1])
        off, noise = np.ptp(turns.mean(axis=0), axis=0), turns.std(axis=0).min(axis=0)
        if np.any(off > noise):
            raise StandError(
                f"{path}: each stamp stands {k} times, with readings as different as those of "
                f"{k} units: leave one's rows"
            )
    times = len(t_ns) / len(rows)
    return apart, (
        f"a stamp stands {times:.3g} times: taken for samples that were handed over together",
    )


def _check_increase(path: Path, t_ns: IntArray, row: IntArray) -> None:
    back = np.flatnonzero(np.diff(t_ns) <= 0)
    if len(back):
        k = int(back[0]) + 1
        seconds = not np.any(t_ns % _SECOND)
        hint = ": whole seconds, are nanoseconds in another column (sec,nanosec)?"
        anew = (t_ns[k] - t_ns[0]) * 20 < t_ns[k - 1] - t_ns[0]  # far back, near the beginning
        raise StandError(
            f"{path}: row {row[k] + 1}, column t = {t_ns[k] / _SECOND:.12g} s: must be "
            f"above the row before, {t_ns[k - 1] / _SECOND:.12g} s, by a nanosecond at least"
            + (hint if seconds and len(back) > len(t_ns) / 2 else "")
            + ("; a counter that begins anew takes --wrap" if anew and k > 1 else "")
        )


def _rates(
    si: Array, t_ns: IntArray, gyro: SensorUnit, accel: SensorUnit
) -> tuple[Array, tuple[str, ...]]:
    """Increments over a sample as means over it: by the usual step, which a lost one leaves."""
    if not (gyro.increment or accel.increment):
        return si, ()
    t = t_ns * 1e-9
    steps = np.diff(t)
    step = float(steps.mean() if bursts(t) else np.median(steps))
    over = np.repeat([step if unit.increment else 1.0 for unit in (gyro, accel)], 3)
    kinds = [name for name, u in (("gyro", gyro), ("accel", accel)) if u.increment]
    return si / over, (f"{' and '.join(kinds)}: increments, taken over {step:.6g} s each",)
