"""Foreign logs: text or rows of binary numbers, brought to SI and one time base."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from alignment.arrays import Array, IntArray, set_owned
from alignment.sampling import bursts
from stand.errors import StandError, unknown
from stand.folder import file_beside, refuse_files, refuse_no_file
from stand.recording.log_columns import (
    CHANNELS,
    SensorUnit,
    columns_of,
    sensor_unit,
    time_unit_of_header,
)
from stand.recording.mcap.writer import EPOCH_NS, write_imu_log
from stand.recording.metadata import RUN
from stand.recording.text_table import TextLayout, is_text, layout_of, read_columns
from stand.recording.time_stamps import (
    NS,
    TIME_UNITS,
    YEAR_1990,
    YEAR_2038,
    likely_unit,
    parser_of,
)
from stand.versions import VERSION

FORMATS = ("csv", "f8le")  # and any numpy dtype
_TEXT_ENDINGS = (".csv", ".txt", ".tsv")  # which tell what an empty file is
_USUAL_TYPES = ("<f8", ">f8", "<f4", ">f4")
_NO_READING = 1e9  # no sensor reads so much in any unit
_SECOND = NS["s"]


@dataclass(frozen=True, slots=True, eq=False)
class ForeignLog:
    """A log in SI: `t_ns` (n,) int64 since `epoch_ns`, rates [rad/s], forces [m/s^2] (n, 3).

    `notes` say what was found out of the file and what was left out.
    """

    t_ns: IntArray
    w_ib_b: Array
    f_b: Array
    epoch_ns: int
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        n = len(self.t_ns)
        set_owned(
            self,
            t_ns=(self.t_ns, (n,), np.int64),
            w_ib_b=(self.w_ib_b, (n, 3), float),
            f_b=(self.f_b, (n, 3), float),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class LogForm:
    """What is told of a foreign log.

    Attributes
    ----------
    columns : str
        Names of the file's columns in order, out of t, sec, nanosec and `CHANNELS`, '-' for one
        to skip; or ``name=column`` by header or number. The IMU's axes must already be X1
        forward, Y1 up, Z1 right, or any right-handed triad whose attitude is wanted.
    gyro_unit, accel_unit : str or None
        As data sheets write them; of an angle or a speed: increments. None: as the header says.
    gyro_scale, accel_scale : float
        What one count is, in that unit.
    time_unit : str or None
        One of `TIME_UNITS`; None: as the header or the first stamp says, or else seconds.
    rate_hz : float or None
        Of a log without a time.
    file_format : str or None
        'csv' (any text), 'f8le' or another numpy type of binary rows; None: text if it looks so,
        little-endian float64 otherwise.
    skip_bytes : int
        Before the first binary row.
    """

    columns: str
    gyro_unit: str | None = None
    accel_unit: str | None = None
    gyro_scale: float = 1.0
    accel_scale: float = 1.0
    time_unit: str | None = None
    rate_hz: float | None = None
    file_format: str | None = None
    skip_bytes: int = 0

    def __post_init__(self) -> None:
        if self.time_unit is not None and self.time_unit not in TIME_UNITS:
            raise unknown("time unit", self.time_unit, TIME_UNITS)
        if self.rate_hz is not None and not 1e-3 <= self.rate_hz <= 1e6:
            raise StandError(f"--rate {self.rate_hz:g}: must be 0.001 to 1e6 Hz")
        if self.skip_bytes < 0:
            raise StandError(f"--skip-bytes {self.skip_bytes}: must be 0 or more")
        for sensor, scale in (("gyro", self.gyro_scale), ("accel", self.accel_scale)):
            if not (np.isfinite(scale) and scale > 0):
                raise StandError(f"--{sensor}-scale {scale:g}: must be above 0")


@dataclass(frozen=True, slots=True, eq=False)
class _Table:
    """Six channels (n, 6) in the file's units; `t_ns` None where there is no time; `row` from 0."""

    t_ns: IntArray | None
    row: IntArray
    values: Array
    headers: tuple[str, ...]
    notes: tuple[str, ...]


def import_foreign(file: Path, out: Path, form: LogForm, *, force: bool = False) -> ForeignLog:
    """Read a foreign log as `load_foreign` does, and write it as an MCAP that others read.

    Raises
    ------
    StandError
        As `load_foreign`; `out` is there (and not `force`), is the log itself, or has no folder.
    """
    refuse_files([out], force=force)
    itself = out.exists() and file.exists() and out.samefile(file)
    if out.is_dir() or itself:
        raise StandError(f"--out {out}: must be a new file")
    if not out.parent.is_dir():
        raise StandError(f"--out {out}: no folder {out.parent}")
    log = load_foreign(file, form)
    record = {
        "source": file.name,
        "columns": form.columns,
        "gyro_unit": form.gyro_unit or "",
        "accel_unit": form.accel_unit or "",
        "time_unit": form.time_unit or "",
        "epoch_ns": str(log.epoch_ns),
        "stand_version": VERSION,
    }
    with file_beside(out) as beside:
        write_imu_log(
            beside,
            t_ns=log.t_ns,
            w_ib_b=log.w_ib_b,
            f_b=log.f_b,
            epoch_ns=log.epoch_ns,
            metadata={RUN: record},
        )
    return log


def load_foreign(path: Path, form: LogForm) -> ForeignLog:
    """Read a foreign log.

    Raises
    ------
    StandError
        One line: file, row or line, column, value, what is allowed.
    """
    text = _is_text(path, form)
    table = _text(path, form) if text else _binary(path, form)
    if len(table.values) < 2:
        raise StandError(f"{path}: {len(table.values)} rows of data, at least 2 are needed")
    headers = table.headers or ("",) * 6
    gyro = sensor_unit("gyro", form.gyro_unit, headers[:3])
    accel = sensor_unit("accel", form.accel_unit, headers[3:])
    scales = np.repeat([gyro.scale * form.gyro_scale, accel.scale * form.accel_scale], 3)
    with np.errstate(all="ignore"):  # told by the check below
        si = table.values * scales
    _check_finite(path, table, si)
    t_ns, epoch_ns = _stamps(path, table, form.rate_hz)
    si, told = _rates(si, t_ns, gyro, accel)
    notes = (*table.notes, *gyro.notes, *accel.notes, *told)
    return ForeignLog(t_ns, si[:, :3], si[:, 3:], epoch_ns, notes=notes)


def _is_text(path: Path, form: LogForm) -> bool:
    refuse_no_file(path)
    if path.is_dir():
        raise StandError(f"{path}: is a folder, must be a file")
    try:
        if form.file_format is not None:
            return form.file_format in ("csv", "text")
        if path.stat().st_size == 0:
            return path.suffix.lower() in _TEXT_ENDINGS
        return is_text(path)
    except OSError as error:
        raise StandError(f"{path}: cannot read: {error.strerror}") from error


def _text(path: Path, form: LogForm) -> _Table:
    try:
        layout = layout_of(path)
    except OSError as error:
        raise StandError(f"{path}: cannot read: {error.strerror}") from error
    columns = columns_of(form.columns, layout.names, layout.width, timed=form.rate_hz is None)
    times = () if form.rate_hz is not None else columns.times
    unit, told = _time_unit(form, layout, times)
    found = read_columns(
        path,
        layout,
        width=columns.width,
        values=columns.values,
        times=times,
        to_ns=parser_of(unit, layout.decimal_comma),
    )
    notes = [*told]
    if found.empty:
        lines = ", ".join(map(str, found.empty[:3])) + (" ..." if len(found.empty) > 3 else "")
        rows = "row" if len(found.empty) == 1 else "rows"
        notes.append(
            f"{len(found.empty)} {rows} with an empty field left out, a gap each: line {lines}"
        )
    there = len(layout.names) > max(columns.values)
    headers = tuple(layout.names[k] for k in columns.values) if there else ()
    return _Table(found.t_ns, found.row, found.values, headers, notes=tuple(notes))


def _time_unit(
    form: LogForm, layout: TextLayout, times: Sequence[int]
) -> tuple[str, tuple[str, ...]]:
    """The unit of the time, and whether it was told by the file."""
    if form.time_unit is not None or len(times) != 1:
        return form.time_unit or "s", ()
    if len(layout.names) > times[0]:
        header = time_unit_of_header(layout.names[times[0]])
        if header in NS:
            return header, (f"time unit {header}: from the header",)
    first = next((row[times[0]] for row in layout.rows if len(row) > times[0]), "0")
    unit = likely_unit(first.strip()) if first.strip() else "s"
    return unit, (f"time unit {unit}: from the first stamp",) if unit != "s" else ()


def _binary(path: Path, form: LogForm) -> _Table:
    columns = columns_of(form.columns, (), form.columns.count(",") + 1, timed=form.rate_hz is None)
    if columns.width is None:
        raise StandError(f"--columns {form.columns}: binary rows need every column in order")
    kind = _number_type(form.file_format or "<f8")
    rows = _binary_rows(path, form, kind, columns.width)
    if not _reads(rows, columns.values, columns.times):
        others = [np.dtype(text) for text in _USUAL_TYPES if np.dtype(text) != kind]
        for other in others:
            raw = _binary_rows(path, form, other, columns.width, whole=False)
            if len(raw) > 1 and _reads(raw, columns.values, columns.times):
                big = "big endian" if other.str.startswith(">") else "little endian"
                raise StandError(
                    f"{path}: makes no sense as {kind.str}, but does as {other.str} ({big}): "
                    f"--format '{other.str}'"
                )
    with np.errstate(all="ignore"):
        values = rows[:, list(columns.values)].astype(float)
    times = () if form.rate_hz is not None else columns.times
    t_ns = _binary_stamps(path, rows, times, form.time_unit or "s") if times else None
    return _Table(t_ns, np.arange(len(rows)), values, (), notes=())


def _number_type(text: str) -> np.dtype[Any]:
    try:
        kind = np.dtype("<f8" if text == "f8le" else text)
    except (TypeError, ValueError, SyntaxError):
        raise unknown("format", text, (*FORMATS, *_USUAL_TYPES)) from None
    if kind.kind not in "fiu":
        raise unknown("format", text, (*FORMATS, *_USUAL_TYPES))
    return kind


def _binary_rows(
    path: Path, form: LogForm, kind: np.dtype[Any], width: int, *, whole: bool = True
) -> np.ndarray:
    size = path.stat().st_size - form.skip_bytes
    row = kind.itemsize * width
    if size < 0:
        raise StandError(f"{path}: --skip-bytes {form.skip_bytes}: has {size + form.skip_bytes}")
    if size % row:
        if not whole:
            return np.empty((0, width))
        name = "float64" if kind == np.float64 else kind.str
        raise StandError(
            f"{path}: {size} bytes is not a whole number of rows of {width} {name} "
            f"({row} bytes): truncated, another --format, or other --columns"
        )
    return np.fromfile(path, dtype=kind, offset=form.skip_bytes).reshape(-1, width)


def _reads(rows: np.ndarray, values: Sequence[int], times: Sequence[int]) -> bool:
    """Whether binary rows are readings of a sensor, as far as that can be seen."""
    with np.errstate(all="ignore"):
        numbers = np.abs(rows[:, list(values)].astype(float))
        sound = bool(np.all(numbers < _NO_READING)) and bool(np.any(numbers > 1 / _NO_READING))
        stamps = rows[:, list(times)].astype(float)
        rising = bool((np.diff(stamps[:, 0]) >= 0).all()) if len(times) else True
    return sound and rising and bool(np.isfinite(stamps).all())


def _binary_stamps(path: Path, rows: np.ndarray, times: Sequence[int], unit: str) -> IntArray:
    if unit not in NS:
        raise StandError(f"{path}: binary rows have no times as {unit}")
    parts = [rows[:, k] for k in times]
    scales = (NS["s"], 1) if len(parts) == 2 else (NS[unit],)
    t_ns = np.zeros(len(rows), np.int64)
    for part, scale in zip(parts, scales, strict=True):
        with np.errstate(all="ignore"):
            most = np.abs(part.astype(float)) * scale
        bad = np.flatnonzero(~(most < 9e18))
        if len(bad):
            value = part[bad[0]]
            must = "must be finite" if not np.isfinite(value) else "is the time unit right?"
            raise StandError(f"{path}: row {bad[0] + 1}, column t = {value}: {must}")
        floats = part.dtype.kind == "f"
        whole = (np.floor(part) if floats else part).astype(np.int64)
        t_ns += whole * scale
        if floats:
            t_ns += np.round((part.astype(float) - whole) * scale).astype(np.int64)
    return t_ns


def _check_finite(path: Path, table: _Table, si: Array) -> None:
    bad = np.argwhere(~np.isfinite(si))
    if len(bad):
        k, column = bad[0]
        raise StandError(
            f"{path}: row {table.row[k] + 1}, column {CHANNELS[column]} = "
            f"{table.values[k, column]}: must be finite"
        )


def _stamps(path: Path, table: _Table, rate: float | None) -> tuple[IntArray, int]:
    """Nanoseconds since an epoch: Unix time's own, or a fixed one for times from anywhere else."""
    if table.t_ns is None:
        assert rate is not None
        return np.round((table.row + 1) * (_SECOND / rate)).astype(np.int64), EPOCH_NS
    t_ns = table.t_ns
    _check_increase(path, table)
    unix = t_ns[0] >= YEAR_1990 * _SECOND and t_ns[-1] < YEAR_2038 * _SECOND
    whole = int(t_ns[0]) // _SECOND * _SECOND if unix else 0
    if not unix and (t_ns[0] < 0 or t_ns[-1] > YEAR_2038 * _SECOND - EPOCH_NS):
        raise StandError(
            f"{path}: column t runs from {t_ns[0] / _SECOND:.9g} to {t_ns[-1] / _SECOND:.9g} s: "
            "must be seconds from 0 on, or Unix time between 1990 and 2038 (is the time unit "
            "right?)"
        )
    return t_ns - whole, whole or EPOCH_NS


def _check_increase(path: Path, table: _Table) -> None:
    t_ns = table.t_ns
    assert t_ns is not None
    back = np.flatnonzero(np.diff(t_ns) <= 0)
    if len(back):
        k = int(back[0]) + 1
        seconds = not np.any(t_ns % _SECOND)
        hint = ": whole seconds, are nanoseconds in another column (sec,nanosec)?"
        raise StandError(
            f"{path}: row {table.row[k] + 1}, column t = {t_ns[k] / _SECOND:.12g} s: must be "
            f"above the row before, {t_ns[k - 1] / _SECOND:.12g} s, by a nanosecond at least"
            + (hint if seconds and len(back) > len(t_ns) / 2 else "")
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
