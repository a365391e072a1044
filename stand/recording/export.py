"""A recording out again: its samples as columns for other programs, and its stretches as TOML."""

import importlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from alignment.angles import Sequence, SequenceRule, angles_from_C_nb
from alignment.units import ARC_SECOND, DEG
from stand.errors import StandError, unknown
from stand.folder import file_beside, refuse_files, write_file
from stand.imu.priors import placement
from stand.recording.encoders import Encoders
from stand.recording.entrance import open_log
from stand.recording.log import Log
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

Columns = dict[str, NDArray[Any]]


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

    Returns
    -------
    dict of (n,)
        By names that end in their units: ``t_s``, `READINGS`, ``true_gx_rad_s`` ..., ``q_nb_x``
        ... (true ``C_nb``), ``outer_rad`` ...
    """
    found: Columns = {"t_s": log.readings.t}
    found |= _six(READINGS, log.readings.w_ib_b, log.readings.f_b)
    if not log.simulated or not Path(log.path).is_file():
        return found
    with open_log(log.path) as file:
        truth = file.truth()
        joints = file.joints() if SCHEDULE in log.imu.metadata else None
    if np.array_equal(truth.t_ns, log.imu.t_ns):
        found |= _six([f"true_{name}" for name in READINGS], truth.w_ib_b, truth.f_b)
        q_nb = (C_NW * Rotation.from_quat(truth.q_wb)).as_quat()
        found |= {f"q_nb_{axis}": q_nb[:, k] for k, axis in enumerate("xyzw")}
    if joints is not None:
        encoders = Encoders(joints, epoch_of(log.imu.metadata), counted=True)
        t = log.readings.t
        found |= {f"{name}_rad": encoders.angle(name, t) for name in joints.names}
    return found


def _six(names: Iterable[str], w: NDArray[Any], f: NDArray[Any]) -> Columns:
    columns = [*w.T, *f.T]
    return dict(zip(names, columns, strict=True))


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
        sequence = SequenceRule.REGULAR.sequence_for(C_nb.inv().apply([0.0, 0.0, -1.0]))
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
        file.write(",".join(columns) + "\n")
        file.writelines(_lines(columns))


def _lines(columns: Columns) -> Iterator[str]:
    """Rows of text: times to the nanosecond, other numbers as exact decimals."""
    t, *others = columns.values()
    for first in range(0, len(t), _ROWS):
        rows = np.column_stack([values[first : first + _ROWS] for values in others]).tolist()
        for stamp, row in zip(t[first : first + _ROWS].tolist(), rows, strict=True):
            yield f"{stamp:.9f},{','.join(map(repr, row))}\n"


def _npz(path: Path, columns: Columns) -> None:
    with path.open("wb") as file:
        np.savez(file, **columns)  # pyright: ignore[reportArgumentType]


def _mat(path: Path, columns: Columns) -> None:
    from scipy.io import savemat

    most = max(values.nbytes for values in columns.values())
    if most >= _LARGEST_MAT:
        raise StandError(f"mat: {most} bytes a column, must be below {_LARGEST_MAT}: npz would do")
    with path.open("wb") as file:
        savemat(file, columns, oned_as="column")


def _parquet(path: Path, columns: Columns) -> None:
    try:
        pyarrow = importlib.import_module("pyarrow")
        parquet = importlib.import_module("pyarrow.parquet")
    except ImportError:
        raise StandError(
            "parquet: is written by pyarrow: pip install 'imu-test-stand[logs]'"
        ) from None
    parquet.write_table(pyarrow.table(columns), path)


WRITERS: Mapping[str, Callable[[Path, Columns], None]] = MappingProxyType(
    {"csv": _csv, "npz": _npz, "mat": _mat, "parquet": _parquet}
)
