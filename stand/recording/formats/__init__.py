"""Files whose kind is known by their content and that are tables: one module per kind."""

from collections.abc import Callable, Mapping
from pathlib import Path

from stand.recording.formats.hdf5 import read_hdf5
from stand.recording.formats.matlab import read_mat
from stand.recording.formats.numpy_files import read_npy, read_npz
from stand.recording.formats.parquet import read_parquet
from stand.recording.formats.table import ArrayTable
from stand.recording.formats.ulog import read_ulog

READERS: Mapping[str, Callable[[Path, str | None], ArrayTable]] = {
    "npy": read_npy,
    "npz": read_npz,
    "mat": read_mat,
    "hdf5": read_hdf5,
    "parquet": read_parquet,
    "ulog": read_ulog,
}
"""By the kind: takes the file, and which group of columns, to a table."""
