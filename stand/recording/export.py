"""A recording out again: its samples as columns for other programs, and its stretches as TOML."""

import importlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any
from zipfile import ZipFile, ZipInfo

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from alignment.angles import Sequence, SequenceRule, angles_from_C_nb
from alignment.parts import PART, equal, release
from alignment.units import ARC_SECOND, DEG
from stand.errors import StandError, unknown
from stand.folder import file_beside, refuse_files, write_file
from stand.imu.priors import placement
from stand.recording.encoders import Encoders
from stand.recording.entrance import open_log
from stand.recording.log import Log
from stand.recording.mcap.reader import JointLog
from stand.recording.metadata import (
    RUN,
    SCHEDULE,
    LoggedStretch,
    epoch_of,
    planned_stretches,
    settled_stretches,
)
from stand.table.kinematics import C_NW
from stand.table.table import load_table
from stand.toml_files import ids

READINGS = ("gx_rad_s", "gy_rad_s", "gz_rad_s", "ax_m_s2", "ay_m_s2", "az_m_s2")
"""Columns that `stand import` knows again by their names, units included."""
_ROWS = 20_000  # of text put together at once
_LARGEST_MAT = 2**31  # bytes of a variable of a MAT-file of version 5

Rows = Callable[[slice], NDArray[Any]]


@dataclass(frozen=True, slots=True, eq=False)
class Columns:
    """Columns of `length` rows by name, each worked out part by part from arrays that are `held`:
    a long recording lies in a file, and is not brought into memory as a whole.
    """

    length: int
    made: Mapping[str, Rows]
    held: tuple[NDArray[Any], ...]

    def parts(self, size: int | None = None) -> Iterator[slice]:
        """Successive rows, whose memory is given back behind whoever takes them."""
        size = size or PART
        for first in range(0, self.length, size):
            yield slice(first, min(first + size, self.length))
            release(*self.held)

    def whole(self) -> dict[str, NDArray[Any]]:
        """All at once."""
        return {name: column(slice(0, self.length)) for name, column in self.made.items()}


def stretches_file(out: Path) -> Path:
    """Where the stretches go: beside the samples."""
    return out.with_name(f"{out.stem}_stretches.toml")


def export_log(log: Log, out: Path, kind: str, *, force: bool = False) -> list[Path]:
    """Write the samples of a recording, and of one of ours its stretches, to new files.

    Parameters
    ----------
    log : Log
    out : Path
    kind : str
        One of `WRITERS`.
    force : bool
        Replace files that are there.

    Returns
    -------
    list of Path
        What was written.

    Raises
    ------
    StandError
        A format that is not known, or whose library is not installed; a file that is there (and
        not `force`) or cannot be written.
    """
    if kind not in WRITERS:
        raise unknown("format", kind, WRITERS)
    if out.name in ("", "..") or out.is_dir():
        raise StandError(f"--out {out}: must be a file")
    text = _stretches_text(log) if log.simulated else ""
    files = [out, *([stretches_file(out)] if text else [])]
    refuse_files(files, force=force)
    columns = columns_of(log)
    with file_beside(out) as beside:
        WRITERS[kind](beside, columns)
    if text:
        write_file(files[1], text)
    return files


def columns_of(log: Log) -> Columns:
    """Every sample: time [s], readings, and of a recording of ours truth and encoder angles.

    By names that end in their units: ``t_s``, `READINGS`, ``true_gx_rad_s`` ..., ``q_nb_x`` ...
    (true ``C_nb``), ``outer_rad`` ...
    """
    r = log.readings
    made = _single("t_s", r.t) | _six(READINGS, r.w_ib_b, r.f_b)
    if not log.simulated or not Path(log.path).is_file():
        return Columns(len(r), made, (r.t, r.w_ib_b, r.f_b))
    with open_log(log.path) as file:
        truth = file.truth()
        joints = file.joints() if SCHEDULE in log.imu.metadata else None
    held = [r.t, r.w_ib_b, r.f_b]
    if equal(truth.t_ns, log.imu.t_ns):
        made |= _six([f"true_{name}" for name in READINGS], truth.w_ib_b, truth.f_b)
        made |= {f"q_nb_{axis}": _attitude(truth.q_wb, k) for k, axis in enumerate("xyzw")}
        held += [truth.q_wb, truth.w_ib_b, truth.f_b]
    if joints is not None:
        made |= {f"{n}_rad": _angle(joints, n, log) for n in joints.names}
        held.append(joints.angles)
    return Columns(len(r), made, tuple(held))


def _single(name: str, values: NDArray[Any]) -> dict[str, Rows]:
    return {name: lambda rows: values[rows]}


def _six(names: Iterable[str], w: NDArray[Any], f: NDArray[Any]) -> dict[str, Rows]:
    found: dict[str, Rows] = {}
    for name, column in zip(names, (*w.T, *f.T), strict=True):
        found |= _single(name, column)
    return found


def _attitude(q_wb: NDArray[Any], k: int) -> Rows:
    """A component of the quaternion of ``C_nb``."""
    return lambda rows: (C_NW * Rotation.from_quat(q_wb[rows])).as_quat()[:, k]


def _angle(joints: JointLog, name: str, log: Log) -> Rows:
    """Of an encoder, at the stamps of the readings."""
    if equal(joints.t_ns, log.imu.t_ns):
        column = joints.angles[:, joints.names.index(name)]
        return lambda rows: column[rows]
    encoders = Encoders(joints, epoch_of(log.imu.metadata), counted=True)
    values = encoders.angle(name, log.readings.t)
    return lambda rows: values[rows]


# The stretches ----------------------------------------------------------------------------------


def _stretches_text(log: Log) -> str:
    """What the procedure told: stretches with attitudes and turns, site, methods, table."""
    metadata = log.imu.metadata
    stretches = settled_stretches(planned_stretches(metadata), metadata)
    if not stretches:
        return ""
    site = log.site
    lines = [f"# The stretches of {Path(log.path).parent.name or log.path}, as they were told"]
    table = metadata.get(RUN, {}).get("table", "")
    if table in ids("tables") and _placed_by(table, log):
        lines.append(f'table = "{table}"')
    lines += ["", "[site]", f"latitude_deg = {(site.latitude or 0.0) / DEG!r}"]
    lines += [f"longitude_deg = {site.longitude / DEG!r}", f"height_m = {site.height!r}"]
    if site.local_gravity is not None:
        lines.append(f"gravity_m_s2 = {site.local_gravity!r}")
    for name, angle in zip(("north", "east"), site.deflection, strict=True):
        lines.append(f"deflection_{name}_arc_s = {angle / ARC_SECOND!r}")
    methods = ", ".join(f'"{name}"' for name in log.methods)
    lines += ["", "[estimate]", f"methods = [{methods}]"]
    lines += [f"offset_window_s = {log.options.offset_window!r}"]
    lines += [f'sequences = "{log.options.rule.value}"']
    for stretch in stretches:
        lines += ["", *_entry(stretch, log)]
    return "\n".join(lines) + "\n"


def _placed_by(table: str, log: Log) -> bool:
    """Whether the recording's priors of placement are those of this table."""
    known = log.options.priors
    told = (known.turn, known.seat, known.nominal, known.azimuth)
    return np.allclose(placement(load_table(table)), told, rtol=1e-9)


def _entry(stretch: LoggedStretch, log: Log) -> list[str]:
    label = stretch.label.replace("\\", "\\\\").replace('"', '\\"')
    kind = "dwell" if stretch.joint is None else "turn"
    lines = ["[[stretch]]", f'kind = "{kind}"', f'label = "{label}"']
    lines += [f"from_s = {stretch.t_from!r}", f"to_s = {stretch.t_to!r}"]
    if stretch.nominal is not None:
        C_nb = Rotation.from_quat(stretch.nominal)
        sequence = SequenceRule.REGULAR.sequence_at(C_nb)
        lines.append(f"attitude_deg = {attitude_text(sequence, angles_from_C_nb(sequence, C_nb))}")
    if stretch.joint is not None and stretch.axis_b is not None:
        dwell = next(d for d in log.dwells if d.label == stretch.label)
        assert dwell.turn is not None
        rate, start = np.polyfit(dwell.readings.t - stretch.t_from, dwell.turn.angle, 1) / DEG
        lines.append(f"axis = {list(stretch.axis_b)}")
        lines += [f"rate_deg_s = {float(rate)!r}", f"angle_deg = {float(start)!r}"]
    return lines


def attitude_text(sequence: Sequence, angles: NDArray[Any]) -> str:
    """Roll, yaw, pitch (3,) [rad] as an inline table."""
    names = ("roll", "yaw", "pitch")
    parts = [f"{n} = {float(a) + 0.0!r}" for n, a in zip(names, angles / DEG, strict=True)]
    if sequence is not Sequence.YAW_PITCH_ROLL:
        parts.append(f'sequence = "{sequence.value}"')
    return f"{{ {', '.join(parts)} }}"


# The formats ------------------------------------------------------------------------------------


def _csv(path: Path, columns: Columns) -> None:
    with path.open("w", encoding="utf-8", newline="\n") as file:
        file.write(",".join(columns.made) + "\n")
        file.writelines(_lines(columns))


def _lines(columns: Columns) -> Iterator[str]:
    """Rows of text: times to the nanosecond, other numbers as exact decimals."""
    for part in columns.parts(_ROWS):
        t, *others = (column(part) for column in columns.made.values())
        rows = np.column_stack(others).tolist()
        for stamp, row in zip(t.tolist(), rows, strict=True):
            yield f"{stamp:.9f},{','.join(map(repr, row))}\n"


def _npz(path: Path, columns: Columns) -> None:
    """As `numpy.savez` does, part by part."""
    head = {"descr": "<f8", "fortran_order": False, "shape": (columns.length,)}
    with ZipFile(path, "w") as archive:
        for name, column in columns.made.items():
            with archive.open(ZipInfo(f"{name}.npy"), "w", force_zip64=True) as file:
                np.lib.format.write_array_header_1_0(file, head)
                for part in columns.parts():
                    file.write(np.ascontiguousarray(column(part), "<f8").tobytes())


def _mat(path: Path, columns: Columns) -> None:
    from scipy.io import savemat

    most = columns.length * np.float64().nbytes
    if most >= _LARGEST_MAT:
        raise StandError(f"mat: {most} bytes a column, must be below {_LARGEST_MAT}: npz would do")
    with path.open("wb") as file:
        savemat(file, columns.whole(), oned_as="column")


def _parquet(path: Path, columns: Columns) -> None:
    try:
        pyarrow = importlib.import_module("pyarrow")
        parquet = importlib.import_module("pyarrow.parquet")
    except ImportError:
        raise StandError(
            "parquet: is written by pyarrow: pip install 'imu-test-stand[logs]'"
        ) from None
    schema = pyarrow.schema([(name, pyarrow.float64()) for name in columns.made])
    with parquet.ParquetWriter(path, schema) as writer:
        for part in columns.parts():
            rows = {name: column(part) for name, column in columns.made.items()}
            writer.write_table(pyarrow.table(rows, schema=schema))


WRITERS: Mapping[str, Callable[[Path, Columns], None]] = MappingProxyType(
    {"csv": _csv, "npz": _npz, "mat": _mat, "parquet": _parquet}
)
