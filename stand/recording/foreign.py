"""Foreign logs: text columns or raw float64, brought to SI and one time base."""

import warnings
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import TextIO

import numpy as np

from alignment.arrays import Array, IntArray, set_owned
from alignment.units import DEG, DEG_PER_HOUR, MILLI_G, STANDARD_GRAVITY
from stand.errors import StandError, unknown
from stand.folder import file_beside, refuse_files, refuse_no_file
from stand.recording.mcap.writer import EPOCH_NS, write_imu_log
from stand.recording.metadata import RUN
from stand.versions import VERSION

GYRO_UNITS = {"deg/s": DEG, "rad/s": 1.0, "deg/h": DEG_PER_HOUR}
ACCEL_UNITS = {"m/s^2": 1.0, "g": STANDARD_GRAVITY, "mg": MILLI_G}
TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
FORMATS = ("csv", "f8le")
COLUMNS = ("t", "gx", "gy", "gz", "ax", "ay", "az")
SKIP = "-"

YEAR_1990 = 631_152_000.0  # s, Unix: a later stamp is taken for Unix time
YEAR_2038 = 2_147_483_647.0  # ROS stamps end there


@dataclass(frozen=True, slots=True, eq=False)
class ForeignLog:
    """A log in SI: `t_ns` (n,) int64 since `epoch_ns`, rates [rad/s], forces [m/s^2] (n, 3)."""

    t_ns: IntArray
    w_ib_b: Array
    f_b: Array
    epoch_ns: int

    def __post_init__(self) -> None:
        n = len(self.t_ns)
        set_owned(
            self,
            t_ns=(self.t_ns, (n,), np.int64),
            w_ib_b=(self.w_ib_b, (n, 3), float),
            f_b=(self.f_b, (n, 3), float),
        )


def import_foreign(
    file: Path,
    out: Path,
    *,
    columns: str,
    gyro_unit: str,
    accel_unit: str,
    time_unit: str = "s",
    file_format: str | None = None,
    force: bool = False,
) -> ForeignLog:
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
    log = load_foreign(file, columns, gyro_unit, accel_unit, time_unit, file_format)
    record = {
        "source": file.name,
        "columns": columns,
        "gyro_unit": gyro_unit,
        "accel_unit": accel_unit,
        "time_unit": time_unit,
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


def load_foreign(
    path: Path,
    columns: str,
    gyro_unit: str,
    accel_unit: str,
    time_unit: str = "s",
    file_format: str | None = None,
) -> ForeignLog:
    """Read a foreign log.

    Parameters
    ----------
    path : Path
    columns : str
        Names of the file's columns in order, comma-separated, out of `COLUMNS` (each once) and
        '-' for a column to skip. The IMU's axes must already be X1 forward, Y1 up, Z1 right, or
        any right-handed triad whose attitude is wanted.
    gyro_unit, accel_unit, time_unit : str
        One of `GYRO_UNITS`, `ACCEL_UNITS`, `TIME_UNITS`.
    file_format : str or None
        'csv' (text with commas, semicolons or blanks; a header is skipped) or 'f8le' (rows of
        little-endian float64); None goes by the file's ending.

    Raises
    ------
    StandError
        One line: file, row, column, value, what is allowed.
    """
    order = _columns(columns)
    scales = [
        _unit("time unit", time_unit, TIME_UNITS),
        _unit("gyro unit", gyro_unit, GYRO_UNITS),
        _unit("accel unit", accel_unit, ACCEL_UNITS),
    ]
    table = _table(path, file_format, len(order))
    if len(table) < 2:
        raise StandError(f"{path}: {len(table)} rows of data, at least 2 are needed")
    place = {name: order.index(name) for name in COLUMNS}
    chosen = table[:, [place[name] for name in COLUMNS]]
    with np.errstate(over="ignore"):  # told by the check below
        si = chosen * np.repeat(scales, [1, 3, 3])
    _check_finite(path, chosen, si)
    t_ns, epoch_ns = _stamps(path, si[:, 0])
    return ForeignLog(t_ns, si[:, 1:4], si[:, 4:7], epoch_ns)


def _columns(columns: str) -> list[str]:
    order = [name.strip() for name in columns.split(",")]
    for name in order:
        if name != SKIP and name not in COLUMNS:
            raise unknown("column", name, [*COLUMNS, SKIP])
    for name in COLUMNS:
        if order.count(name) != 1:
            raise StandError(
                f"--columns {columns}: {name} stands {order.count(name)} times, must stand once"
            )
    return order


def _unit(what: str, name: str, allowed: dict[str, float]) -> float:
    if name not in allowed:
        raise unknown(what, name, allowed)
    return allowed[name]


def _table(path: Path, file_format: str | None, width: int) -> Array:
    refuse_no_file(path)
    if file_format is None:
        file_format = "csv" if path.suffix.lower() in (".csv", ".txt", ".tsv") else "f8le"
    if file_format not in FORMATS:
        raise unknown("format", file_format, FORMATS)
    try:
        return _binary(path, width) if file_format == "f8le" else _text(path, width)
    except OSError as error:
        raise StandError(f"{path}: cannot read: {error.strerror}") from error


def _binary(path: Path, width: int) -> Array:
    if path.is_dir():
        raise StandError(f"{path}: is a folder, must be a file")
    size = path.stat().st_size
    if size % (8 * width):
        raise StandError(
            f"{path}: {size} bytes is not a whole number of rows of {width} float64 "
            f"({8 * width} bytes): truncated, another --format, or other --columns"
        )
    return np.fromfile(path, dtype="<f8").reshape(-1, width)


def _text(path: Path, width: int) -> Array:
    with _opened(path) as file:
        first = file.readline()
    separator = next((s for s in ",;" if s in first), None)
    header = 0 if _is_numbers(first, separator) else 1
    try:
        with _opened(path) as file, warnings.catch_warnings():
            warnings.simplefilter("error")  # a file without rows only warns
            table = np.loadtxt(islice(file, header, None), delimiter=separator, ndmin=2)
    except (ValueError, UserWarning) as error:
        raise StandError(f"{path}: {_fault(path, separator, header, width)}") from error
    if table.shape[1] != width:
        raise StandError(f"{path}: {_wrong_width(table.shape[1], width)}")
    return table


def _opened(path: Path) -> TextIO:
    """As text; a byte order mark is dropped, and bytes of another encoding may be in a header."""
    return path.open(encoding="utf-8-sig", errors="replace")


def _fault(path: Path, separator: str | None, header: int, width: int) -> str:
    """What is wrong with text that NumPy could not read: its first line that does not fit."""
    empty = True
    with _opened(path) as file:
        for number, line in islice(enumerate(file, start=1), header, None):
            fields = line.split("#")[0].strip().split(separator)
            if not any(fields):
                continue
            empty = False
            if len(fields) != width:
                return f"line {number}: {_wrong_width(len(fields), width)}"
            for column, field in enumerate(fields, start=1):
                if not _is_numbers(field, separator):
                    return f"line {number}, column {column} = {field.strip()!r}: must be a number"
    return "no rows of data" if empty else "not a table of numbers"


def _wrong_width(found: int, width: int) -> str:
    return f"{found} columns, but --columns names {width} (use - to skip one)"


def _is_numbers(line: str, separator: str | None) -> bool:
    try:
        [float(field) for field in line.split(separator)]
    except ValueError:
        return False
    return True


def _check_finite(path: Path, table: Array, si: Array) -> None:
    bad = np.argwhere(~np.isfinite(si))
    if len(bad):
        row, column = bad[0]
        value = table[row, column]
        raise StandError(
            f"{path}: row {row + 1}, column {COLUMNS[column]} = {value}: must be finite"
        )


def _stamps(path: Path, t: Array) -> tuple[IntArray, int]:
    """Nanoseconds since an epoch: Unix time's own, or a fixed one for times from anywhere else."""
    _check_increase(path, t, np.diff(t))
    whole = int(t[0]) if t[0] >= YEAR_1990 and t[-1] < YEAR_2038 else 0
    if not whole and (t[0] < 0 or t[-1] > YEAR_2038 - EPOCH_NS * 1e-9):
        raise StandError(
            f"{path}: column t runs from {t[0]:.9g} to {t[-1]:.9g} s: must be seconds from 0 on, "
            "or Unix time between 1990 and 2038 (is the time unit right?)"
        )
    t_ns = np.round((t - whole) * 1e9).astype(np.int64)
    _check_increase(path, t, np.diff(t_ns))
    return t_ns, whole * 1_000_000_000 or EPOCH_NS


def _check_increase(path: Path, t: Array, steps: Array | IntArray) -> None:
    back = np.flatnonzero(steps <= 0)
    if len(back):
        k = int(back[0]) + 1
        raise StandError(
            f"{path}: row {k + 1}, column t = {t[k]:.12g} s: must be above the row before, "
            f"{t[k - 1]:.12g} s, by a nanosecond at least"
        )
